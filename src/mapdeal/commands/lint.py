"""``mapdeal lint``: what is wrong with maps, and with a robot's parameter files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Annotated, TypeVar

from mapdeal.checks.facts import RoomFacts
from mapdeal.checks.findings import CHECKS
from mapdeal.checks.formats import LintReport, MapReport, ReportForm, repair_lines
from mapdeal.checks.lint import (
    LEFT_OUT,
    Found,
    checks_of,
    found_in,
    found_in_parameters,
    not_checked,
)
from mapdeal.checks.map_checks import RUN_FOLDERS
from mapdeal.checks.parameter_checks import robot_in
from mapdeal.checks.selection import Selections
from mapdeal.command import AT_LEAST_1, Output, Words, command
from mapdeal.commands.lint_repair import ImageUsers, repair_copy, repair_in_place
from mapdeal.errors import MapdealError, ParameterError, kept_warnings
from mapdeal.files.budget import SHARE_OF_JOB
from mapdeal.files.source import is_folder
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import reach_radius
from mapdeal.grid.values import check_choice
from mapdeal.inputs.listing import list_maps
from mapdeal.maps.reading import MapFile, open_map
from mapdeal.pipeline.batch import Job, Outcome, attempt, dispatch, jobs_at_once
from mapdeal.pipeline.inputs import Work, memory_budget
from mapdeal.pipeline.settings import ProgressCallback, Settings, report_nothing
from mapdeal.ros.robot import CostmapName
from mapdeal.version import __version__

T = TypeVar("T")

Names = str | PathLike[str] | Iterable[str | PathLike[str]]

_CELLS_OF_ANY = 250_000
"""Cells that are checked in the time that a file takes, however small it is."""

_LOOKED_AT = 16
"""Maps of which the size is looked at; the others are taken to be like them."""

_CELLS_WORTH_WORKERS = 500_000_000
"""Checked in two or three seconds: of fewer, two processes save less than they take to start."""


def _several(given: Names) -> tuple[str, ...]:
    names: Iterable[object] = (given,)
    if isinstance(given, Iterable) and not isinstance(given, str | bytes):
        names = tuple(given)
    for one in names:
        if not isinstance(one, str | PathLike):
            raise ParameterError("takes names or paths", source="lint", got=one)
    return tuple(map(str, names))


def _separated(texts: Iterable[str]) -> tuple[str, ...]:
    """Return names that were given with commas between them, or option by option."""
    return tuple(name.strip() for text in texts for name in text.split(","))


def _check_words(incomplete: str) -> Iterable[str]:
    """Return the names of the checks, behind those that are already listed."""
    listed = incomplete.rpartition(",")[0]
    return [f"{listed},{name}" if listed else name for name in sorted(CHECKS)]


Checks = Annotated[Names, Words("IDS", _separated, is_repeated=True, completed=_check_words)]


@command(
    group="CI and reports",
    output=Output(
        "OUT", "Where to write the repaired copy: .yaml, .pgm, .png, .npz.",
        is_required=False, streams=False,
    ),
    shared=(
        "footprint", "robot_radius", "footprint_padding", "robot_16_gon", "max_cells", "force",
        "max_memory",
    ),
    texts={
        "footprint": "Corners of the robot around its centre, metres: find rooms that it "
        "cannot enter, by its inscribed radius.",
        "robot_radius": "Radius of a round robot, metres: find rooms that it cannot enter.",
        "strict": "Exit with 1 for warnings as well.",
    },
    json="never",
    example="""\
mapdeal lint examples/maps --strict
mapdeal lint examples/maps --format sarif > lint.sarif
mapdeal lint --params-file examples/robots/nav2_params.yaml""",
)  # fmt: skip
def lint(
    paths: Annotated[Names, Words("MAP...", typed=list[str], streams=True)] = (),
    *,
    params_file: Annotated[Names, Words("FILE", typed=list[Path])] = (),
    costmap: CostmapName | None = None,
    namespace: Annotated[str | None, Words("NS")] = None,
    footprint: Footprint | None = None,
    select: Checks = (),
    ignore: Checks = (),
    strict: bool = False,
    config: Annotated[str | PathLike[str] | bool, Words("FILE", typed=Path)] = True,
    no_config: bool = False,
    form: Annotated[ReportForm, Words(name="format")] = "text",
    jobs: Annotated[int | None, AT_LEAST_1, Words("N", short="j")] = None,
    fix: bool = False,
    output: Annotated[str | PathLike[str] | None, Words(typed=Path)] = None,
    in_place: bool = False,
    max_cells: int | None = None,
    max_memory: int | None = None,
    force: bool = False,
) -> LintReport:
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

    Parameters
    ----------
    paths : path or str, or several
        Maps, folders of maps or runs, quoted patterns, or @LIST.txt. Files are map_server
        ``.yaml``, ``.pbm`` with its YAML next to it, and ``.npz``.
    params_file : path or str, or several
        A robot's own parameters: a Nav2 file, or ROS 1's costmap files; can be repeated, later
        files win.
    costmap : {'global', 'local'}, optional
        Costmap of --params-file  [default: both]. Only costmaps that the files define are checked.
    namespace : str, optional
        Robot of --params-file, if it contains several.
    footprint : Footprint, optional
        Shape of a robot that should be able to pass through the maps. Areas connected only by
        passages too narrow for its inscribed radius are reported. By default the shape in the
        parameter files, if any.
    select : str or several
        Checks, or areas of checks such as image, to run; separated by commas  [default: all].
        In Python several names are a list.
    ignore : str or several
        Checks, or areas of checks, to leave out.
    strict : bool
        Whether warnings also make `LintReport.passes` false.
    config : path, str or bool
        Configuration file for all maps  [default: the nearest mapdeal.toml or pyproject.toml of
        each map]. In Python True stands for the nearest, False for none.
    no_config : bool
        Read no configuration file.
    form : {'text', 'json', 'github', 'sarif', 'junit'}
        Text, one JSON document, GitHub annotations, SARIF 2.1.0, or JUnit XML.
    jobs : int, optional
        Processes to use for many maps  [default: all cores]. In Python the default is one.
    fix : bool
        Repair what can be repaired: one map with -o, any number with --in-place.
    output : path or str, optional
        Where to write the repaired copy: .yaml, .pgm, .png, .npz.
    in_place : bool
        Repair maps in place, and report what is left.
    max_cells : int, optional
        Maximum size of a file to read, cells; by default 2e8 for compressed images, 1e9 for
        others.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.
    force : bool
        Whether to replace an existing `output`.

    Returns
    -------
    LintReport
        Sequence of `Finding`; ``print`` shows each one as the command does. A file that cannot be
        read is a finding, not an error.

    Raises
    ------
    ParameterError
        If there are neither maps nor parameter files, a check is unknown, a pattern matches no
        map, `footprint` is not a footprint or is given without maps, or a configuration is
        invalid.
    FileAccessError, MalformedInputError
        If a list or configuration file cannot be read.

    Examples
    --------
    In a script for CI::

        report = mapdeal.lint("maps", ignore="yaml.origin-off-lattice")
        for finding in report:
            print(finding)
        sys.exit(0 if report.passes else 1)
    """
    settings = Settings(max_cells=max_cells, max_memory=max_memory, force=force)
    work = Work.current.get()
    names, files = _several(paths), tuple(map(Path, _several(params_file)))
    for place, value in (("costmap", costmap), ("namespace", namespace)):
        if value is not None and not files:
            raise ParameterError("needs --params-file", place=place)
    if costmap is not None:
        check_choice(costmap, CostmapName, "costmap")
    if footprint is not None and not isinstance(footprint, Footprint):
        raise ParameterError("must be a Footprint", place="footprint", got=footprint)
    for place, is_given in (("params_file", bool(files)), ("footprint", footprint is not None)):
        if fix and is_given:
            rule, hint = "cannot be given together with --fix", "--fix repairs maps only"
            raise ParameterError(rule, place=place, hint=hint)
    if output is not None and in_place:
        raise ParameterError("cannot be given together with -o", place="in_place")
    if fix and output is None and not in_place:
        raise ParameterError("needs -o OUT or --in-place", place="fix")
    if not fix and (output is not None or in_place):
        raise ParameterError("needs --fix", place="in_place" if output is None else "output")
    if footprint is not None and not names:
        raise ParameterError("needs a MAP", place="footprint")
    if not names and not files:
        raise ParameterError("names no map: needs a MAP, or --params-file", source="lint")
    if no_config and not isinstance(config, bool):
        raise ParameterError("cannot be given together with --no-config", place="config")
    nearest = config and not no_config if isinstance(config, bool) else Path(config)
    with settings.memory():
        chunks = _no_standard_input if work is None else work.terminal.input_chunks
        listing = list_maps(names, None, chunks, whole_folders=RUN_FOLDERS)
        maps = [one.path for one in listing.maps]
        if output is not None:
            return _repaired_copy(maps, Path(output), settings)
        at_once = min(jobs or 1, len(maps))
        counted: ProgressCallback = report_nothing
        if work is not None:
            listing.say(work.terminal, "checked")
            at_once = jobs_at_once(jobs, len(maps), work.terminal)
            if len(maps) > 1:
                counted = partial(work.terminal.counted, what="map")
        lint_maps = _Lint(
            Selections(_several(select), _several(ignore), strict=strict, config=nearest),
            settings,
            _radius_of(footprint, files, costmap, namespace) if maps else None,
            at_once,
        )
        reports = lint_maps.parameters(files, costmap, namespace, maps) if files else []
        with counted(len(maps)) as done:
            reports += lint_maps(maps, done)
        problems = _repair_in_place(maps, reports, lint_maps) if in_place else []
    report = LintReport(tuple(reports), __version__, form, tuple(problems))
    if work is not None:
        work.terminal.remark(repair_lines(report) if form != "text" else ())
        for problem in problems[1:]:
            work.terminal.error(problem)  # `LintReport.check` raises the first
    return report


def _no_standard_input() -> Iterable[bytes]:
    hint = "give the names as a list"
    raise ParameterError("applies to the command line", source="@-", hint=hint)


def _radius_of(
    footprint: Footprint | None, files: Sequence[Path], costmap: CostmapName | None,
    namespace: str | None,
) -> float | None:  # fmt: skip
    """Return the inscribed radius of the robot whose shape, or whose files, are given."""
    if footprint is None and files:
        robot = robot_in(files, costmap=costmap, namespace=namespace)
        footprint = None if robot is None else robot.footprint
    return None if footprint is None else reach_radius(footprint)


@dataclass
class _Lint:
    """Lint by some rules, of a robot's files or, so many at the same time, of maps."""

    selections: Selections
    settings: Settings
    radius: float | None = None
    jobs: int = 1

    def parameters(
        self, files: Sequence[Path], costmap: CostmapName | None, namespace: str | None,
        maps: Sequence[Path],
    ) -> list[MapReport]:  # fmt: skip
        """Return what is wrong with a robot's parameter files, also beside maps."""
        for path in maps:
            self.selections.of(path)  # what is wrong with their rules is told of first
        headers = [
            (path.name, found)
            for path in maps
            if (found := _of_header(path, self.settings, lambda file: file.frame().resolution))
        ]
        found_by_file = found_in_parameters(files, costmap, namespace, headers)
        reports = [self._report(path, found) for path, found in found_by_file.items()]
        return [replace(one, is_parameters=True) for one in reports]

    def __call__(self, paths: Sequence[Path], done: Callable[[int], object]) -> list[MapReport]:
        """Return what is wrong with maps."""
        of_robot = checks_of(RoomFacts)
        radii = {
            path: self.radius
            for path in paths
            if not self.selections.of(path).checks.isdisjoint(of_robot) and self.radius is not None
        }
        found: dict[int, Found] = {}

        def take(index: int, one: Found) -> None:
            found[index] = one
            done(1)

        if self.jobs > 1 and _are_worth_workers(paths, self.settings):
            _lint_in_processes(paths, self.settings, radii, min(self.jobs, len(paths)), take)
        else:
            for index, path in enumerate(paths):
                take(index, found_in(path, self.settings.max_cells, radii.get(path)))
        reports = []
        for index, path in enumerate(paths):
            is_left_out = any(one.check == LEFT_OUT for one in found[index].findings)
            without = of_robot if is_left_out or path not in radii else ()
            report = self._report(path, found[index], without)
            reports.append(replace(report, is_folder=is_folder(path)))
        return reports

    def _report(self, path: Path, found: Found, without: Iterable[str] = ()) -> MapReport:
        selection = self.selections.of(path)
        judged = selection.judged(path, found.findings, found.comments, without=without)
        return MapReport(str(path), *judged, selection.strict)


def _repair_in_place(
    paths: Sequence[Path], reports: list[MapReport], lint_maps: _Lint
) -> list[MapdealError]:  # fmt: skip
    """Repair maps in their own files, and put what is left in the place of their reports."""
    # Only findings that count are mended: neither those of checks that are not wanted, nor
    # suppressed ones.
    users: ImageUsers = {}
    problems = []
    for index, (path, one) in enumerate(zip(paths, reports, strict=True)):
        wanted = {found.check for found in one.findings}
        if one.is_folder or not wanted:
            continue
        try:
            repairs = repair_in_place(path, wanted, lint_maps.settings, users)
        except MapdealError as error:
            problems.append(error)
            continue
        if repairs:
            (after,) = lint_maps([path], int)
            reports[index] = replace(after, repairs=tuple(repairs))
    return problems


def _repaired_copy(paths: Sequence[Path], output: Path, settings: Settings) -> LintReport:
    if len(paths) != 1:
        hint = "--in-place repairs any number of maps"
        raise ParameterError("takes one map", source="-o", got=len(paths), hint=hint)
    done = repair_copy(paths[0], output, settings)
    report = MapReport(str(paths[0]), (), repairs=tuple(done))
    return LintReport((report,), __version__, output=output)


def _of_header(path: Path, settings: Settings, take: Callable[[MapFile], T]) -> T | None:
    """Return what a function takes from the header of a map; None if there is none to read."""
    if is_folder(path):
        return None
    with (
        kept_warnings(),  # reading itself warns
        suppress(MapdealError),
        open_map(path, max_cells=settings.max_cells) as file,
    ):
        return take(file)
    return None


def _are_worth_workers(paths: Sequence[Path], settings: Settings) -> bool:
    """Return whether sharing maps out saves more time than starting processes takes."""
    if len(paths) < 2:
        return False
    cells = _CELLS_OF_ANY * len(paths)
    step = -(-len(paths) // _LOOKED_AT)  # to look at all of many small ones is what takes long
    for path in paths[::step]:
        if cells >= _CELLS_WORTH_WORKERS:
            return True
        height, width = _of_header(path, settings, lambda file: file.shape()) or (0, 0)
        cells += step * height * width
    return cells >= _CELLS_WORTH_WORKERS


def _lint_in_processes(
    paths: Sequence[Path],
    settings: Settings,
    radii: Mapping[Path, float],
    jobs: int,
    done: Callable[[int, Found], None],
) -> None:
    from mapdeal.pipeline.workers import ProcessWorkers  # slow to import

    def take(index: int, outcome: Outcome) -> None:
        path, found = paths[index], outcome.result
        if not isinstance(found, Found):
            found = not_checked(path, str(found))
        elif any(SHARE_OF_JOB in one.message for one in found.findings):
            found = found_in(path, settings.max_cells, radii.get(path))  # alone it may have all
        done(index, found)

    of_each = memory_budget(settings.max_memory, jobs)
    is_chosen = settings.max_memory is not None
    shared = replace(settings, max_memory=of_each, memory_is_chosen=is_chosen)
    all_jobs = [Job(path, path, str(path), str(path)) for path in paths]
    work = partial(attempt, _LintJob(shared, radii))
    dispatch(len(paths), all_jobs.__getitem__, work, ProcessWorkers(jobs), take)


@dataclass(frozen=True)
class _LintJob:
    """Lint with its options, as it is sent to workers."""

    settings: Settings
    radii: Mapping[Path, float]

    def __call__(self, job: Job) -> Found:
        with self.settings.memory(anew=True):
            return found_in(job.path, self.settings.max_cells, self.radii.get(job.path))
