"""``mapdeal lint``: what is wrong with maps."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.checks.formats import REPORTS, ReportForm, repair_lines, sum_of
from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.completion import check_words
from mapdeal.cli.many_maps import jobs_at_once, say_listing
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.lint import (
    LintRules,
    ParameterFiles,
    lint_maps,
    list_sources,
    repair_file,
    repair_maps,
)
from mapdeal.errors import MapdealError, ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import CostmapName

_SHAPE = ("footprint", "robot_radius", "footprint_padding", "robot_16_gon")

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options(
    *_SHAPE,
    "max_cells",
    "force",
    "max_memory",
    help_texts={
        "footprint": "Corners of the robot around its centre, metres: find rooms that it "
        "cannot enter, by its inscribed radius.",
        "robot_radius": "Radius of a round robot, metres: find rooms that it cannot enter.",
        "strict": "Exit with 1 for warnings as well.",
    },
)
def lint(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="MAP...",
            help=f"Maps, folders of maps or runs, quoted patterns, or @LIST.txt. {opt.OR_STDIN}",
        ),
        FROM_STDIN,
    ] = None,
    params_file: list[Path] | None = None,
    costmap: CostmapName | None = None,
    namespace: str | None = None,
    select: Annotated[list[str] | None, typer.Option(autocompletion=check_words)] = None,
    ignore: Annotated[list[str] | None, typer.Option(autocompletion=check_words)] = None,
    config: Path | None = None,
    is_isolated: Annotated[bool, typer.Option("--no-config")] = False,
    form: Annotated[ReportForm, typer.Option("--format")] = "text",
    jobs: Annotated[
        int | None, opt.jobs_option("Processes to use for many maps.  [default: all cores]")
    ] = None,
    fix: bool = False,
    output: Annotated[
        Path | None,
        opt.output_argument("OUT", "Where to write the repaired copy: .yaml, .pgm, .png, .npz."),
    ] = None,
    in_place: bool = False,
    *,
    footprint: Footprint | None,
    settings: Settings,
) -> None:
    """Check maps, and a robot's parameter files, for errors and pitfalls.

    Errors are wrong or unsafe for some reader, and make the exit code 1. Warnings are pitfalls;
    notes are good to know. A file that cannot be read is a finding, and the other files are still
    checked.

    A MAP is a map_server .yaml, a .pbm with its .yaml, or an .npz; a folder, for all maps and runs
    in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt, a file with one such
    name per line (@- reads standard input).

    With --params-file a robot's own parameters are checked as well: what ROS refuses or silently
    ignores, and how shape and costs fit together. A MAP is optional then.

    With a robot's shape, areas are reported that only passages too narrow for the robot connect.

    A comment "# mapdeal: ignore ID, ID" in a map's .yaml or in a parameter file turns these checks
    off for that file.

    Options
    -------
    --params-file FILE: A robot's own parameters: a Nav2 file, or ROS 1's costmap files; can be
        repeated, later files win.
    --costmap: Costmap of --params-file.  [default: both]
    --namespace NS: Robot of --params-file, if it contains several.
    --config FILE: Configuration file for all maps.  [default: the nearest mapdeal.toml or
        pyproject.toml of each map]
    --fix: Repair what can be repaired: one map with -o, any number with --in-place.
    --in-place: Repair maps in place, and report what is left.
    --select IDS: Checks, or areas of checks such as image, to run; separated by commas.  [default:
        all]
    --ignore IDS: Checks, or areas of checks, to leave out.
    --no-config: Read no configuration file.
    --format: Text, one JSON document, GitHub annotations, SARIF 2.1.0, or JUnit XML.
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
    rules = LintRules(_names(select), _names(ignore), settings.strict, config, is_isolated)
    at_once = jobs_at_once(jobs, len(paths))
    problems: list[MapdealError] = []
    with ExitStack() as stack:
        done: Callable[[int], object] = int  # one map is no progress
        if len(paths) > 1:
            done = stack.enter_context(terminal.Progress(len(paths), what="map")).advance
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
            raise ParameterError(rule, source=option, hint="--fix repairs maps only")
    if has_output and in_place:
        raise ParameterError("cannot be given together with -o", source="--in-place")
    if fix and not (has_output or in_place):
        raise ParameterError("needs -o OUT or --in-place", source="--fix")
    if not fix and (has_output or in_place):
        raise ParameterError("needs --fix", source="-o" if has_output else "--in-place")


def _write_copy(sources: list[Path], output: Path, options: Settings) -> None:
    if len(sources) != 1:
        hint = "--in-place repairs any number of maps"
        raise ParameterError("takes one map", source="-o", got=len(sources), hint=hint)
    done = repair_file(sources[0], output, options)
    terminal.summary([f"{sources[0]} -> {output}", *(f"  {line}" for line in done)])
