"""``mapdeal lint``: check and repair maps, and check a robot's parameter files."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from mapdeal import errors
from mapdeal.checks import lint as checks, map_checks, parameter_checks
from mapdeal.checks.facts import PairFacts, RoomFacts, gather, without_rounding_noise
from mapdeal.checks.findings import CHECKS, Finding, Selections, named_checks
from mapdeal.checks.lint import LintReport, MapReport, ReportForm, repair_lines
from mapdeal.command import AT_LEAST_1, Output, Words, command
from mapdeal.commands.mask import info_of, mask_facts, read_mask
from mapdeal.commands.reach import COSTS_PER_CELL, GoalOption, StartOption, lethal_cells
from mapdeal.files import source, yaml_text
from mapdeal.files.transaction import Transaction
from mapdeal.grid import canvas, filters, reach
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import check_choice, count_text
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import dialects, formats, images, map_server
from mapdeal.maps.listing import MapListing, list_maps
from mapdeal.maps.reading import open_map, output_paths, write_grid
from mapdeal.pipeline import batch, inputs, recipe
from mapdeal.pipeline.settings import ProgressCallback, Settings, report_nothing
from mapdeal.records import dataclass, replace
from mapdeal.ros.load import by_robot, flavour_of_file
from mapdeal.ros.robot import CostmapName, RobotParameters
from mapdeal.version import __version__

Names = str | PathLike[str] | Iterable[str | PathLike[str]]

_CELLS_PER_FILE = 250_000  # cells that can be checked in the time that opening a file takes
_SAMPLED_MAPS = 16  # maps whose sizes are read to estimate the number of all cells
_CELLS_WORTH_WORKERS = 500_000_000  # checked in 2 or 3 s, about the time to start two processes

_COSTS_RULE = "holds costs, which are not repaired"
_NUMBERS = ("resolution", "origin", "occupied_thresh", "free_thresh")
_COPY_HINT = "mapdeal lint MAP --fix -o OUT writes a repaired copy"

_GRAPH_BYTES_PER_CELL = 24  # distances, open cells, collisions of the robot
_REPAIR_BYTES_PER_CELL = 3  # the cells, and the pixels being written
_TURNED_BYTES_PER_CELL = 5  # of a turned map
_RESAMPLED_BYTES_PER_CELL = 3  # of its resampled copy


def _as_names(argument: Names) -> tuple[str, ...]:
    names: Any = argument
    is_single = isinstance(names, str | bytes) or not isinstance(names, Iterable)
    names = (names,) if is_single else tuple(names)
    for name in names:
        if not isinstance(name, str | PathLike):
            raise errors.ParameterError("takes names or paths", source="lint", got=name)
    return tuple(map(str, names))


def _split_names(texts: Iterable[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in texts for name in text.split(","))


def _check_words(incomplete: str) -> Iterable[str]:
    earlier = incomplete.rpartition(",")[0]
    return [f"{earlier},{name}" if earlier else name for name in sorted(CHECKS)]


MaskFile = Annotated[str | PathLike[str], Words("MASK", name="mask", typed=Path)]
Checks = Annotated[Names, Words("IDS", _split_names, is_repeated=True, completed=_check_words)]


@command(
    group="CI and reports",
    output=Output("OUT", is_required=False, about=(
        f"{formats.or_other_formats('Where to write the repaired copy: .yaml, .pgm, .png')}."
    )),
    shared=("footprint", "robot_radius", "footprint_padding", "robot_16_gon", "resolution",
            "origin", "max_cells", "force", "max_memory"),
    texts={
        "footprint": "Corners of the robot around its centre, metres: find rooms that it "
        "cannot enter, by its inscribed radius.",
        "robot_radius": "Radius of a round robot, metres: find rooms that it cannot enter.",
        "strict": "Exit with 1 for warnings as well.",
    },
    example="""\
mapdeal lint examples/maps --strict
mapdeal lint examples/maps --format sarif > lint.sarif
mapdeal lint examples/robots/nav2_params.yaml""",
)  # fmt: skip
def lint(
    paths: Annotated[Names, Words("MAP...", typed=list[str], streams=True)] = (), *,
    params_file: Annotated[Names, Words("FILE", typed=list[Path])] = (),
    costmap: CostmapName | None = None, namespace: Annotated[str | None, Words("NS")] = None,
    graph: Annotated[str | PathLike[str] | None, Words("GRAPH.geojson", typed=Path)] = None,
    footprint: Footprint | None = None, filter_mask: MaskFile | None = None,
    mask_kind: filters.FilterKind | None = None, start: StartOption = None,
    goals: GoalOption = (), select: Checks = (), ignore: Checks = (), strict: bool = False,
    config: bool = True, form: Annotated[ReportForm, Words(name="format")] = "text",
    statistics: bool = False, explain: Checks = (),
    jobs: Annotated[int | None, AT_LEAST_1, Words("N", short="j")] = None, fix: bool = False,
    output: Annotated[str | PathLike[str] | None, Words(typed=Path)] = None, in_place: bool = False,
    max_cells: int | None = None, max_memory: int | None = None, force: bool = False,
) -> LintReport:  # fmt: skip
    """Check maps, and a robot's parameter files, for errors and pitfalls.

    Errors are wrong or unsafe for some reader, and make the exit code 1. Warnings are pitfalls;
    notes are good to know. If a file cannot be read, that is a finding, and the others are checked.

    A MAP is a map_server .yaml, a .pbm with its .yaml, or an .npz; a folder, for all maps and runs
    in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt, a file with one such
    name per line (@- reads standard input).

    A robot's parameter file, named among the maps or by --params-file, is checked for values that
    ROS refuses or silently ignores, and for costs that do not fit the shape. Consecutive files
    belong to one robot until one sets a costmap's layers again, and later files win. Those of a
    folder are checked if it holds no map.

    With --graph a route graph is checked on the MAP, for the robot's shape: what Nav2's route
    server refuses, nodes and edges on which the robot hits something, and parts without a way back.

    With a robot's shape, lint reports areas that are connected only by passages too narrow for it.

    With --mask the mask of a costmap filter is checked against one MAP: its position, the effect of
    its mode and thresholds, and passages that a keepout zone closes.

    A comment "# mapdeal: ignore ID, ID" in a .yaml file turns these checks off for that file.

    Parameters
    ----------
    paths : path or str, or several
        Maps, folders of maps or runs, quoted patterns, @LIST.txt, or a robot's parameter files.
    params_file : path or str, or several
        A robot's own parameters: a Nav2 file, or ROS 1's costmap files; repeatable, later ones win.
    costmap : {'global', 'local'}, optional
        Costmap of the parameter files  [default: both]. Only those that they define are checked.
    namespace : str, optional
        Robot of the parameter files, if they contain several.
    graph : path or str, optional
        Route graph to check on the one MAP: a GeoJSON file for Nav2's route server.
    footprint : Footprint, optional
        Shape of a robot that should be able to pass through the maps: areas connected only by
        passages too narrow for its inscribed radius are reported. By default that in the files.
    filter_mask : path or str, optional
        Mask of a costmap filter, checked against the one map.
    mask_kind : {'keepout', 'speed', 'binary'}, optional
        Kind of the mask. [default: as its .yaml says, else speed in mode scale, keepout otherwise]
    start : tuple of float, optional
        With a keepout mask: start of the robot, metres and radians. [default: the widest place]
    goals : sequence of Goal
        With a keepout mask: place that must stay reachable, such as a dock; more may follow.
    select : str or several
        Checks, or groups such as image, to run; separated by commas  [default: all but
        those on request]. In Python several names are a list.
    ignore : str or several
        Checks, or groups, to leave out.
    strict : bool
        Whether warnings also make `LintReport.passes` false.
    config : bool
        Apply the nearest mapdeal.toml or pyproject.toml of each map.
    form : {'text', 'json', 'github', 'sarif', 'junit'}
        Text, one JSON document, GitHub annotations, SARIF 2.1.0, or JUnit XML.
    statistics : bool
        Print the number of findings of each check, most frequent first, instead of findings.
    explain : str or several
        Print what these checks, a group of them or all find, why it matters, and what to do.
    jobs : int, optional
        Processes to use for many maps  [default: all cores]. In Python the default is one.
    fix : bool
        Repair what can be repaired: one map with -o, any number with --in-place.
    output : path or str, optional
        Where to write the repaired copy: .yaml, .pgm, .png, .npz.
    in_place : bool
        Repair maps in place, and report the remaining findings.
    max_cells, max_memory : int, optional
        As for `read_map`.
    force : bool
        Whether to replace an existing `output`.

    Returns
    -------
    LintReport
        Sequence of `Finding`; ``print`` shows each one as the command does.

    Raises
    ------
    ParameterError
        If there are neither maps nor parameter files, a pattern matches no map, or a check, the
        `footprint` or a configuration is invalid.
    FileAccessError, MalformedInputError
        If a list or configuration file cannot be read.

    Examples
    --------
    In a script for CI::

        report = mapdeal.lint("maps", ignore="map.specks")
        for finding in report:
            print(finding)
        sys.exit(0 if report.passes else 1)
    """
    if (statistics or explain) and form not in ("text", "json"):
        rule = f"cannot be given together with {'--statistics' if statistics else '--explain'}"
        raise errors.ParameterError(rule, place="form", got=form)
    if explain:
        rule = "cannot be given together with --explain"
        if paths:
            raise errors.ParameterError(rule, source=_as_names(paths)[0])
        inputs.refuse(rule, params_file=params_file)
        named = named_checks(_as_names(explain), "--explain")
        return LintReport((), __version__, form, explained=named)
    settings = Settings(max_cells=max_cells, max_memory=max_memory, force=force)
    if (work := inputs.Work.current.get()) is not None:  # also has the resolution of bare images
        settings = work.settings
    groups = list(by_robot(_as_names(paths)))
    names = [name for flavour, group in groups if flavour is None for name in group]
    robots = [tuple(map(Path, group)) for flavour, group in groups if flavour is not None]
    files = tuple(map(Path, _as_names(params_file)))
    if fix:
        rule, hint = "cannot be given together with --fix", "--fix repairs maps only"
        if robots:
            raise errors.ParameterError("is a parameter file", source=robots[0][0], hint=hint)
        inputs.refuse(rule, hint, params_file=files, footprint=footprint)
        if output is None and not in_place:
            raise errors.ParameterError("needs -o OUT or --in-place", place="fix")
        inputs.refuse(rule, graph=graph, filter_mask=filter_mask)
    else:
        inputs.refuse("needs --fix", output=output, in_place=in_place)
    robots += [files] if files else []
    if costmap is not None:
        check_choice(costmap, CostmapName, "costmap")
    if output is not None:
        inputs.refuse("cannot be given together with -o", in_place=in_place)
    if not names:
        inputs.refuse("needs a MAP", footprint=footprint)
    if filter_mask is None:
        inputs.refuse("needs --mask", mask_kind=mask_kind, start=start, goals=tuple(goals))
    if not names and not robots:
        raise errors.ParameterError("names no map: needs a MAP, or --params-file", source="lint")
    with settings.reading():
        chunks = _no_standard_input if work is None else work.terminal.input_chunks
        listing = list_maps(names, None, chunks, exempt=map_checks.RUN_FOLDERS)
        in_folders = {} if fix else _parameters_in_folders(listing)
        maps = [entry.path for entry in listing.maps if entry.path not in in_folders]
        for paths_in_folder in in_folders.values():
            robots += [tuple(group) for _, group in by_robot(paths_in_folder)]
        checked = {path for files in robots for path in files}
        left_out = tuple(path for path in listing.left_out if path not in checked)
        listing = replace(listing, left_out=left_out)
        if not robots:
            inputs.refuse("needs --params-file", costmap=costmap, namespace=namespace)
        if len(maps) != 1:
            inputs.refuse(f"needs one MAP, not {len(maps)}", graph=graph)
            inputs.refuse("needs one MAP, which the mask is for", filter_mask=filter_mask)
        if in_place and any(map(map_server.is_bare_image, maps)):
            rule = "cannot repair an image alone"
            raise errors.ParameterError(rule, place="in_place", hint=_COPY_HINT)
        if output is not None:
            return _repaired_copy(maps, Path(output), settings)
        processes = min(jobs or 1, len(maps))
        counted: ProgressCallback = report_nothing
        if work is not None:
            listing.print_notes(work.terminal, "checked")
            processes = batch.jobs_at_once(jobs, len(maps), work.terminal)
            if len(maps) > 1:
                counted = partial(work.terminal.counted, noun="map")
        robot, shape = None, footprint  # with which planners check collisions
        if len(robots) == 1 and maps:
            robot = parameter_checks.first_robot(robots[0], costmap=costmap, namespace=namespace)
        if footprint is None and robot is not None:
            footprint, shape = robot.footprint, recipe.planned_shape(robot)
        selections = Selections(_as_names(select), _as_names(ignore), strict=strict, config=config)
        radius = None if footprint is None or not maps else reach.reach_radius(footprint)
        graph_and_robot = None if graph is None else (Path(graph), shape, robot)
        lint_maps = _Lint(selections, settings, radius, processes, graph_and_robot)
        reports: list[MapReport] = []
        for robot_files in robots:
            reports += lint_maps.parameters(robot_files, costmap, namespace, maps)
        with counted(len(maps)) as advance:
            reports += lint_maps(maps, advance)
        if filter_mask is not None:
            with errors.capture_warnings():  # the findings include them
                map_read = inputs.map_input(inputs.read_input(maps[0], settings), maps[0], settings)
            mask = Path(filter_mask)
            reports.append(lint_maps.mask(mask, map_read, mask_kind, footprint, start, goals))
        problems = _repair_in_place(maps, reports, lint_maps) if in_place else []
    report = LintReport(tuple(reports), __version__, form, tuple(problems), only_counts=statistics)
    if work is not None:
        work.terminal.remark(repair_lines(report) if form != "text" else ())
        for problem in problems[1:]:
            work.terminal.error(problem)  # `LintReport.check` raises the first
    return report


def _parameters_in_folders(listing: MapListing) -> dict[Path, list[Path]]:
    """Return the parameter files in each folder that holds neither maps nor runs."""
    marks = (map_checks.RUN_FOLDERS.mark, map_checks.RUN_FOLDERS.summary)
    folders = [entry.path for entry in listing.maps if source.is_folder(entry.path)
               and not any(source.exists(entry.path / mark) for mark in marks)]  # fmt: skip
    files = [path for path in listing.left_out if flavour_of_file(path)] if folders else []
    found = {folder: [path for path in files if folder in path.parents] for folder in folders}
    return {folder: paths for folder, paths in found.items() if paths}


def _no_standard_input() -> Iterable[bytes]:
    hint = "give the names as a list"
    raise errors.ParameterError("applies to the command line", source="@-", hint=hint)


@dataclass
class _Lint:
    selections: Selections
    settings: Settings
    radius: float | None = None
    jobs: int = 1
    graph: tuple[Path, Footprint | None, RobotParameters | None] | None = None

    def parameters(
        self, files: Sequence[Path], costmap: CostmapName | None, namespace: str | None,
        maps: Sequence[Path],
    ) -> list[MapReport]:  # fmt: skip
        for path in maps:
            self.selections.of(path)  # errors in configurations come first
        named = ((path.name, _frame_of(path, self.settings)) for path in maps)
        frames = [(name, frame) for name, frame in named if frame is not None]
        findings = checks.check_parameters(files, costmap, namespace, frames)
        return [self._report(path, found, is_parameters=True) for path, found in findings.items()]

    def __call__(self, paths: Sequence[Path], advance: Callable[[int], object]) -> list[MapReport]:
        robot_checks = {*checks.checks_of(RoomFacts)}
        selected = [path for path in paths if self.selections.of(path).checks & robot_checks]
        radii = {} if self.radius is None else dict.fromkeys(selected, self.radius)
        findings_of: dict[int, checks.Findings] = {}

        def collect(index: int, findings: checks.Findings) -> None:
            findings_of[index] = findings
            advance(1)

        if self.jobs > 1 and len(paths) > 1 and _are_worth_workers(paths, self.settings):
            _lint_in_processes(paths, self.settings, radii, min(self.jobs, len(paths)), collect)
        else:
            for index, path in enumerate(paths):
                collect(index, checks.check_map(path, self.settings.max_cells, radii.get(path)))
        reports = []
        for index, path in enumerate(paths):
            findings = findings_of[index]
            if self.graph is not None:
                graph_findings = _graph_findings(path, *self.graph, self.settings)
                findings = replace(findings, findings=(*findings.findings, *graph_findings))
            reports.append(self._report(path, findings, is_folder=source.is_folder(path)))
        return reports

    def mask(
        self, path: Path, map_read: inputs.MapInput, kind: filters.FilterKind | None,
        robot: Footprint | None, start: tuple[float, ...] | None, goals: Sequence[reach.Goal],
    ) -> MapReport:  # fmt: skip
        mask, pair = read_mask(path, self.settings, map_read)
        ends: Any = {"start": start, "goals": tuple(goals)}
        info = info_of(pair.metadata, kind)
        if info.kind != "keepout":
            inputs.refuse(f"applies to keepout masks, not to {info.kind}", **ends)
        facts = mask_facts(map_read, mask.grid, info, pair=pair, robot=robot, **ends)
        findings = tuple(checks.lint_mask(path, facts))
        return self._report(path, checks.Findings(findings, checks.read_ignored_names(path)))

    def _report(self, path: Path, found: checks.Findings, **kind: Any) -> MapReport:
        selection = self.selections.of(path)
        judged = selection.apply(found.findings, found.ignored_names)
        return MapReport(str(path), *judged, selection.strict, **kind)


def _graph_findings(
    path: Path, graph: Path, shape: Footprint | None, robot: RobotParameters | None,
    settings: Settings,
) -> Sequence[Finding]:  # fmt: skip
    from mapdeal.checks.graph_checks import check_graph  # rarely used, and slow to import

    try:
        with errors.capture_warnings(), open_map(path, max_cells=settings.max_cells) as file:
            height, width = file.shape()
            per_cell = _GRAPH_BYTES_PER_CELL + (0 if robot is None else COSTS_PER_CELL)
            source.claim(path, int(per_cell * height * width))
            map_read = inputs.map_input(file.read(), path, settings)
            grid = map_read.occupancy if robot is None else lethal_cells(robot, map_read)
            return check_graph(graph, grid, shape)
    except errors.MapdealError as error:  # `check_graph` reports those of the graph
        return checks.not_checked(graph, f"its map cannot be read: {error}").findings


def _repair_in_place(
    paths: Sequence[Path], reports: list[MapReport], lint_maps: _Lint
) -> list[errors.MapdealError]:  # fmt: skip
    """Repair maps in their own files, and replace their reports by those after the repair."""
    # Findings of deselected checks and suppressed findings are not repaired.
    problems = []
    for index, (path, report) in enumerate(zip(paths, reports, strict=True)):
        repairs_due = {found.check for found in report.findings}
        if report.is_folder or not repairs_due:
            continue
        try:
            repairs = _repaired_in_place(path, repairs_due, lint_maps.settings)
        except errors.MapdealError as error:
            problems.append(error)
            continue
        if repairs:
            (after,) = lint_maps([path], int)
            reports[index] = replace(after, repairs=tuple(repairs))
    return problems


def _frame_of(path: Path, settings: Settings) -> Frame | None:
    """Return the frame in a map's header; None if that is unreadable."""
    with (
        errors.capture_warnings(),  # checks repeat them
        suppress(errors.MapdealError),
        open_map(path, max_cells=settings.max_cells) as file,
    ):
        return file.frame()
    return None


def _are_worth_workers(paths: Sequence[Path], settings: Settings) -> bool:
    cells = _CELLS_PER_FILE * len(paths)
    step = -(-len(paths) // _SAMPLED_MAPS)
    for path in paths[::step]:
        if cells >= _CELLS_WORTH_WORKERS:
            return True
        frame = _frame_of(path, settings)
        cells += 0 if frame is None else step * frame.height * frame.width
    return cells >= _CELLS_WORTH_WORKERS


def _lint_in_processes(
    paths: Sequence[Path], settings: Settings, radii: Mapping[Path, float], jobs: int,
    advance: Callable[[int, checks.Findings], None],
) -> None:  # fmt: skip
    from mapdeal.pipeline.workers import ProcessWorkers  # slow to import

    def collect(index: int, outcome: batch.Outcome) -> None:
        path, result = paths[index], outcome.result
        if not isinstance(result, checks.Findings):
            result = checks.not_checked(path, str(result))
        elif any(source.SHARE_OF_JOB in finding.message for finding in result.findings):
            # the map needs more than a job's share of the memory: check it here, with all of it
            result = checks.check_map(path, settings.max_cells, radii.get(path))
        advance(index, result)

    memory = inputs.memory_budget(settings.max_memory, jobs)
    shared = replace(settings, max_memory=memory, memory_is_chosen=settings.max_memory is not None)
    all_jobs = [batch.Job(path, path, str(path), str(path)) for path in paths]
    work = partial(batch.attempt, partial(_check_job, shared, radii))
    batch.dispatch(len(paths), all_jobs.__getitem__, work, ProcessWorkers(jobs), collect)


def _check_job(settings: Settings, radii: Mapping[Path, float], job: batch.Job) -> checks.Findings:
    with settings.reading(anew=True):
        return checks.check_map(job.path, settings.max_cells, radii.get(job.path))


def repaired(
    path: Path, pair: PairFacts | None, *, max_cells: int | None = None
) -> tuple[OccupancyGrid, list[str]]:
    changes: list[str] = []
    with errors.capture_warnings():  # lint has reported these already
        if pair is not None:
            grid: Any = _map_of_pair(pair, max_cells, changes)
        else:
            with open_map(path, max_cells=max_cells) as file:
                grid = file.cells()
    if isinstance(grid, Costmap):
        raise errors.MalformedInputError(_COSTS_RULE, source=path)
    grid = grid if isinstance(grid, OccupancyGrid) else grid.grid
    source.claim(path, _REPAIR_BYTES_PER_CELL * grid.occupancy.size)
    resolution = _plain(grid.resolution)
    x, y, yaw = map(_plain, grid.origin)
    if (resolution, (x, y, yaw)) != (grid.resolution, grid.origin):
        changes.append(f"resolution {resolution!r}, origin {x!r}, {y!r}, {yaw!r} without noise")
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, yaw))
    if canvas.is_turned(grid.frame):
        changes.append(f"yaw {yaw:g} rad is in the cells now")
        lattice = Frame(1, 1, resolution)
        region = region_around(lattice, grid.frame)
        needed = _TURNED_BYTES_PER_CELL * grid.occupancy.size + source.PIECES
        source.claim(path, needed + _RESAMPLED_BYTES_PER_CELL * region.cells)
        grid = canvas.resampled(grid, region.frame_in(lattice))  # keeps every obstacle
    elif yaw:
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, 0.0))
    return grid, changes


def _map_of_pair(pair: PairFacts, max_cells: int | None, changes: list[str]) -> OccupancyGrid:
    """Read a map again, with a lower free_thresh if that frees map_saver's unknown cells."""
    if pair.metadata.cost_scale is not None:
        raise errors.MalformedInputError(_COSTS_RULE, source=pair.path)
    metadata = repaired_metadata = pair.metadata
    freed: dict[dialects.Dialect, map_server.FreedCells] = {"nav2": pair.pixels.freed["nav2"]}
    if map_server.remark_on_freed(freed, pair.pixels.size, metadata) is not None:
        free_thresh = min(map_server.USUAL_FREE_THRESH, metadata.free_thresh)
        repaired_metadata = replace(metadata, free_thresh=free_thresh)
    changed = 0
    image = images.open_image(pair.image_path, max_cells=max_cells)
    with image as opened, opened.strips() as strips:
        occupancy = np.empty(strips.shape, dtype=np.int8)
        for rows, picture in strips.placed():
            dialects.cells_of(picture, repaired_metadata, "nav2", out=occupancy[rows])
            if repaired_metadata is not metadata:
                before = dialects.cells_of(picture, metadata, "nav2")
                changed += int(np.count_nonzero(before != occupancy[rows]))
    if changed:
        cells = f"{count_text(changed, 'cell')} {'is' if changed == 1 else 'are'}"
        changes.append(f"{cells} now unknown instead of free: map_saver's grey for unknown")
    return OccupancyGrid(occupancy, metadata.resolution, metadata.origin)


def _yaml_repair(
    pair: PairFacts, frame: Frame | None, checks_found: Collection[str]
) -> tuple[dict[str, Any], bool]:
    """Return repaired values of a map's YAML file, and whether its cells must change too."""
    metadata, entries = pair.metadata, pair.entries
    values: dict[str, Any] = {}
    if "yaml.defaults" in checks_found:
        filled_in = {"negate": int(metadata.negate)}
        filled_in |= {key: getattr(metadata, key) for key in ("occupied_thresh", "free_thresh")}
        values |= {key: value for key, value in filled_in.items() if key not in entries}
    if "yaml.number-as-text" in checks_found:
        for key in (name for name in _NUMBERS if name in entries):
            numbers = entries[key].items() if key == "origin" else [entries[key]]
            if any(number.is_yaml_1_1_text for number in numbers):
                values[key] = getattr(metadata, key)
    usual = map_server.USUAL_FREE_THRESH
    if "thresholds.unknown-becomes-free" in checks_found and metadata.free_thresh > usual:
        values["free_thresh"] = usual
    if "yaml.resolution-noise" in checks_found:
        values["resolution"] = _plain(metadata.resolution)
    needs_cells, (x, y, yaw) = False, metadata.origin
    if "yaml.origin-yaw" in checks_found and frame is not None:
        needs_cells = canvas.is_turned(frame)
        yaw = yaw if needs_cells else 0.0
    if (x, y, yaw) != metadata.origin or "yaml.nan-yaw" in checks_found:
        values["origin"] = (x, y, yaw)
    if {"yaml.mode-case", "yaml.legacy-mode"} & set(checks_found):
        values["mode"] = metadata.mode
    if "yaml.negate-word" in checks_found:
        values["negate"] = int(metadata.negate)
    if (image := _image_name(pair, checks_found)) is not None:
        values["image"] = image
    return values, needs_cells


def _plain(value: float) -> float:
    return without_rounding_noise(value) or value


def _image_name(pair: PairFacts, checks_found: Collection[str]) -> str | None:
    """Return a repaired relative name of an image in or below the folder of its map."""
    if "yaml.image-unquoted" in checks_found:
        return pair.metadata.image
    if not {"image.absolute-path", "image.foreign-path"} & set(checks_found):
        return None
    folder = pair.path.parent
    if not pair.image_path.is_relative_to(folder):
        return None
    relative = pair.image_path.relative_to(folder)
    return None if ".." in relative.parts else relative.as_posix()


def _repaired_copy(paths: Sequence[Path], output: Path, settings: Settings) -> LintReport:
    if len(paths) != 1:
        hint = "--in-place repairs any number of maps"
        raise errors.ParameterError("takes one map", source="-o", got=len(paths), hint=hint)
    path, outputs = paths[0], output_paths(output)
    pair, cells, findings = gather(path, max_cells=settings.max_cells)
    if cells is None:
        messages = (found.message for found in findings if found.severity == "error")
        raise errors.MalformedInputError(next(messages, _COSTS_RULE), source=path)
    files = [path, *([pair.path, pair.image_path] if pair is not None else [])]
    with inputs.outputs_of(outputs, files, settings) as transaction:
        with inputs.errors_named(path):
            grid, changes = repaired(path, pair, max_cells=settings.max_cells)
        write_grid(transaction, output, grid)
    if pair is not None:
        changes += [found.message for found in findings if found.check == "yaml.nan-yaw"]
        changes.append(f"image {outputs[0].name}, usual thresholds")
    report = MapReport(str(path), (), repairs=tuple(changes))
    return LintReport((report,), __version__, output=output)


def _repaired_in_place(path: Path, checks_found: Collection[str], settings: Settings) -> list[str]:
    # In the YAML file only values are replaced: comments, order and other keys stay. A map that is
    # turned gets a new image beside the YAML, since other maps may use the old one.
    states = {path: source.state_of(path)}  # before the first read
    pair, cells, _ = gather(path, max_cells=settings.max_cells)
    if pair is None:
        return []
    values, needs_cells = _yaml_repair(pair, None if cells is None else cells.frame, checks_found)
    if not values and not needs_cells:
        return []
    states[pair.image_path] = source.state_of(pair.image_path)
    geometry = {"resolution", "origin"} if needs_cells else set()  # reported with the cells
    texts = {key: str(value) for key, value in values.items() if key not in geometry}
    if "origin" in texts:
        texts["origin"] = ", ".join(map(repr, values["origin"]))
    changes = [f"{key} {text}" for key, text in texts.items()]
    outputs = [target := source.real_path(pair.path)]
    image = target.with_name(f"{target.stem}_turned.pgm")
    if needs_cells:
        is_link = target.parent != source.real_path(pair.path.parent)
        if is_link or source.exists(image):
            rule = f"its turned image would be {image.name}, "
            rule += "beside a link to the YAML" if is_link else "which exists"
            raise errors.FileAccessError(rule, source=pair.path, hint=_COPY_HINT)
        outputs = [image, target]
        changes.append(f"{image.name} written beside {pair.image_path.name}")
    with (
        use_threads(settings.threads),
        inputs.errors_named(pair.path),
        Transaction(outputs, force=True) as transaction,
    ):
        if needs_cells:
            grid, cell_changes = repaired(pair.path, pair, max_cells=settings.max_cells)
            changes = [*cell_changes, *changes]
            turned: dict[str, Any] = {
                "mode": map_server.write_map_image(transaction, image, grid),
                "resolution": grid.resolution, "origin": tuple(grid.origin), "negate": 0,
                "occupied_thresh": 0.65, "free_thresh": 0.196, "image": image.name,
            }  # fmt: skip
            values |= {k: v for k, v in turned.items() if getattr(pair.metadata, k) != v}
        has_mark = source.head_of(pair.path, len(BOM_UTF8)) == BOM_UTF8
        data = (BOM_UTF8 if has_mark else b"") + yaml_text.with_values(pair.entries, values)
        edited = None
        with errors.capture_warnings(), suppress(errors.MalformedInputError):
            edited = dialects.metadata_of(yaml_text.parse_mapping(pair.path, data), pair.path)
        if edited != replace(pair.metadata, **values):
            rule = "its YAML is written in a way that cannot be edited"
            raise errors.MalformedInputError(rule, source=pair.path, hint=_COPY_HINT)
        transaction.write_bytes(target, data)
        for path, state in states.items():
            source.check_state(path, state)
    return changes
