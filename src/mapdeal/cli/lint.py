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
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.lint import LintRules, ParameterFiles, lint_maps, list_sources, repair_maps
from mapdeal.pipeline.repair import repair_file
from mapdeal.pipeline.settings import Settings
from mapdeal.robot.parameters import CostmapName

_SHAPE = ("footprint", "robot_radius", "footprint_padding", "robot_16_gon")

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options(
    *_SHAPE,
    "max_cells",
    "force",
    "max_memory",
    help_texts={
        "footprint": "The robot's corners around its centre: look for rooms that it is cut off "
        "from, by its inscribed radius.",
        "robot_radius": "The radius of a round robot: look for rooms that it is cut off from.",
    },
)
def lint(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="MAP...",
            help=f"Maps, folders of maps or runs, quoted patterns, or @LIST.txt. {OR_STDIN}",
        ),
        FROM_STDIN,
    ] = None,
    params_file: Annotated[
        list[Path] | None,
        typer.Option(
            "--params-file",
            metavar="FILE",
            help="A robot's own parameters: a Nav2 file, or ROS 1's costmap files; can be "
            "repeated, later ones win.",
        ),
    ] = None,
    costmap: Annotated[
        CostmapName | None,
        typer.Option(help="Which costmap of --params-file.  [default: both]", show_default=False),
    ] = None,
    namespace: Annotated[
        str | None,
        typer.Option(metavar="NS", help="Which robot of --params-file, if it holds several."),
    ] = None,
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
    footprint: Footprint | None,
    settings: Settings,
) -> None:
    """Report what is wrong with maps, and with a robot's parameter files, by named checks.

    Errors make the exit code 1: they make a map wrong or unsafe for some reader. Warnings are
    traps, notes are good to know. A file that cannot be read is a finding; the others go on.

    A MAP is a .yaml of map_server, a .pbm beside its .yaml, or an .npz; a folder, for all maps
    and folders of runs in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt,
    a file with such names, one a line (@- reads them from stdin).

    With --params-file a robot's own parameters are looked at, too: what ROS refuses, or passes over
    in silence, and what its shape and its costs make of one another. A MAP is not needed then.

    With a robot's shape, of options or of parameter files, areas of a map are looked for that only
    passages too narrow for the robot join.

    A comment "# mapdeal: ignore ID, ID" in a map's .yaml takes these checks out for that map, and
    in a parameter file for that file.
    """
    parameters = _parameters_of(params_file, costmap, namespace)
    _check_fix(
        fix=fix,
        has_output=output is not None,
        in_place=in_place,
        has_parameters=parameters is not None,
        has_shape=footprint is not None,
    )
    if footprint is not None and not sources:
        option = "--footprint" if footprint.vertices else "--robot-radius"
        raise ParameterError("needs a MAP", source=option)
    if not sources and parameters is None:
        raise ParameterError("needs a MAP, or --params-file", source="lint")
    listing = list_sources(sources or (), terminal.input_chunks)
    paths = [one.path for one in listing.maps]
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
            report = lint_maps(
                paths,
                rules,
                settings,
                parameters=parameters,
                footprint=footprint,
                jobs=at_once,
                done=done,
            )
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


def _parameters_of(
    files: list[Path] | None, costmap: CostmapName | None, namespace: str | None
) -> ParameterFiles | None:
    """Return the robot's parameter files, if there are any."""
    if files:
        return ParameterFiles(tuple(files), costmap, namespace)
    for option, value in (("--costmap", costmap), ("--namespace", namespace)):
        if value is not None:
            raise ParameterError("needs --params-file", source=option)
    return None


def _check_fix(
    *, fix: bool, has_output: bool, in_place: bool, has_parameters: bool, has_shape: bool
) -> None:
    for option, is_given in (("--params-file", has_parameters), ("a robot's shape", has_shape)):
        if fix and is_given:
            rule = "cannot be given together with --fix"
            raise ParameterError(rule, source=option, hint="--fix repairs maps alone")
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
