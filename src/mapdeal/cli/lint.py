"""``mapdeal lint``: what is wrong with maps."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.checks.reports.as_text import repair_lines, sum_of
from mapdeal.checks.reports.catalogue import REPORTS, ReportForm
from mapdeal.cli import terminal
from mapdeal.cli.many_maps import jobs_at_once, say_listing
from mapdeal.cli.options import OR_STDIN
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.errors import MapdealError, ParameterError
from mapdeal.pipeline.lint import LintRules, lint_maps, list_sources, repair_maps
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
            help=f"Maps, folders of maps or runs, quoted patterns, or @LIST.txt. {OR_STDIN}",
        ),
        FROM_STDIN,
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
        bool,
        typer.Option(
            "--fix",
            help="Take out the traps that can be taken out: of one map with -o, of all with "
            "--in-place.",
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT", help="A repaired copy: .yaml, .pgm, .png, .npz."
        ),
    ] = None,
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Repair maps in their own files, and say what is left."),
    ] = False,
    *,
    settings: Settings,
) -> None:
    """Report what is wrong with maps, by named checks.

    Errors make the exit code 1: they make a map wrong or unsafe for some reader. Warnings are
    traps, notes are good to know. A file that cannot be read is a finding; the others go on.

    A MAP is a .yaml of map_server, a .pbm beside its .yaml, or an .npz; a folder, for all maps
    and folders of runs in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt,
    a file with such names, one a line (@- reads them from stdin).

    A comment "# mapdeal: ignore ID, ID" in a map's .yaml takes these checks out for that map.
    """
    listing = list_sources(sources, terminal.input_chunks)
    paths = [one.path for one in listing.maps]
    _check_fix(fix=fix, has_output=output is not None, in_place=in_place)
    if output is not None:
        _write_copy(paths, output, settings)
        return
    say_listing(listing, "checked")
    rules = LintRules(_names(select), _names(ignore), strict, config, is_isolated)
    at_once = jobs_at_once(jobs, len(paths))
    problems: list[MapdealError] = []
    with ExitStack() as stack:
        done: Callable[[int], object] = int  # one map is no progress
        if len(paths) > 1:
            done = stack.enter_context(terminal.progress(len(paths), what="map")).advance
        if in_place:
            report, problems = repair_maps(paths, rules, settings, jobs=at_once, done=done)
        else:
            report = lint_maps(paths, rules, settings, jobs=at_once, done=done)
    for line in REPORTS[form](report):
        terminal.result(line)
    if form == "text":
        terminal.summary([sum_of(report)])
    else:
        terminal.remark(repair_lines(report))
    for problem in problems[1:]:
        terminal.error(problem)
    if problems:
        raise problems[0]
    if not report.passes:
        raise typer.Exit(1)


def _names(given: list[str] | None) -> tuple[str, ...]:
    """Return names that were given with commas between them, or option by option."""
    return tuple(name.strip() for text in given or () for name in text.split(","))


def _check_fix(*, fix: bool, has_output: bool, in_place: bool) -> None:
    if has_output and in_place:
        raise ParameterError("cannot be given together with -o", source="--in-place")
    if fix and not (has_output or in_place):
        raise ParameterError("needs -o OUT or --in-place", source="--fix")
    if not fix and (has_output or in_place):
        raise ParameterError("needs --fix", source="-o" if has_output else "--in-place")


def _write_copy(sources: list[Path], output: Path, options: Settings) -> None:
    if len(sources) != 1:
        hint = "--in-place repairs any number of maps"
        raise ParameterError("is for one map", source="-o", got=len(sources), hint=hint)
    done = repair_file(sources[0], output, options)
    terminal.summary([f"{sources[0]} -> {output}", *(f"  {line}" for line in done)])
