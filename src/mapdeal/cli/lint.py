"""``mapdeal lint``: what is wrong with maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.checks.reports.as_text import sum_of
from mapdeal.checks.reports.catalogue import REPORTS, ReportForm
from mapdeal.cli import terminal
from mapdeal.cli.many_maps import jobs_at_once, say_listing
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import ParameterError
from mapdeal.pipeline.lint import LintRules, lint_maps, list_sources
from mapdeal.pipeline.repair import repair_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("max_cells", "force", "max_memory")
def lint(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="MAP...",
            help="Maps, folders of maps or runs, quoted patterns, or @LIST.txt.",
        ),
    ],
    select: Annotated[
        list[str] | None,
        typer.Option(
            metavar="IDS",
            help="Checks that count, or their areas, such as image; several with commas.  "
            "[default: all]",
        ),
    ] = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option(metavar="IDS", help="Checks, or areas, that do not count."),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Warnings, too, make the exit code 1.")
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Configuration of all maps.  [default: the nearest mapdeal.toml or "
            "pyproject.toml of each]",
        ),
    ] = None,
    is_isolated: Annotated[
        bool, typer.Option("--no-config", help="Read no file of configuration.")
    ] = False,
    form: Annotated[
        ReportForm,
        typer.Option(
            "--format",
            help="Text, one JSON document, annotations of a GitHub workflow, SARIF 2.1.0, or "
            "JUnit XML.",
        ),
    ] = "text",
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            metavar="N",
            min=1,
            help="Processes, if there is enough for them to do.  [default: the processors]",
        ),
    ] = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="Write a map without the traps that can be taken out.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT", help="With --fix: .yaml, .pgm, .png, .npz."),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Say what is wrong with maps, by named checks.

    Errors make the exit code 1: they make a map wrong or unsafe for some reader. Warnings are
    traps, notes are good to know. A file that cannot be read is a finding; the others go on.

    A MAP is a .yaml of map_server, a .pbm beside its .yaml, or an .npz; a folder, for all maps
    and folders of runs in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt,
    a file with such names, one a line (@- reads them from stdin).

    A comment "# mapdeal: ignore ID, ID" in a map's .yaml takes these checks out for that map.
    """
    listing = list_sources(sources, terminal.input_chunks)
    paths = [one.path for one in listing.maps]
    if fix or output is not None:
        _fix(paths, output, settings, wanted=fix)
        return
    say_listing(listing, "checked")
    rules = LintRules(_names(select), _names(ignore), strict, config, is_isolated)
    with terminal.progress(len(paths), what="map") as bar:
        report = lint_maps(
            paths, rules, settings, jobs=jobs_at_once(jobs, len(paths)), done=bar.advance
        )
    for line in REPORTS[form](report):
        terminal.result(line)
    if form == "text":
        terminal.summary([sum_of(report)])
    if not report.passes:
        raise typer.Exit(1)


def _names(given: list[str] | None) -> tuple[str, ...]:
    """Return names that were given with commas between them, or option by option."""
    return tuple(name.strip() for text in given or () for name in text.split(","))


def _fix(
    sources: list[Path], output: Path | None, options: Settings, *, wanted: bool
) -> None:  # fmt: skip
    if not wanted or output is None:
        missing, given = ("--fix", "-o") if not wanted else ("-o OUT", "--fix")
        raise ParameterError(f"needs {missing}", source=given)
    if len(sources) != 1:
        raise ParameterError("is for one map", source="--fix", got=len(sources))
    done = repair_file(sources[0], output, options)
    terminal.summary([f"{sources[0]} -> {output}", *(f"  {line}" for line in done)])
