"""``mapdeal report``: one page of runs, maps, and results about them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from contextvars import copy_context
from functools import cached_property
from itertools import islice, tee
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from mapdeal import errors, records, version
from mapdeal.checks.lint import LintReport
from mapdeal.command import Output, Result, Words, command
from mapdeal.commands import build, reach, report_documents as documents, report_entries as entries
from mapdeal.commands.lint import lint
from mapdeal.commands.plan import PlanGoal, check_map, planner_of, pose_of, report_on
from mapdeal.commands.plan_changes import PlannerOnMap
from mapdeal.commands.report_entries import Draft, Grids, Opened
from mapdeal.files import json_values, source
from mapdeal.files.transaction import Transaction
from mapdeal.grid import filters, occupancy, values
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import dialects, formats, kinds, map_server
from mapdeal.pipeline import batch, recipe
from mapdeal.pipeline.folder import MANIFEST, reach_document
from mapdeal.pipeline.inputs import KeepoutMask, Work, map_input, mask_of, read_input
from mapdeal.pipeline.settings import Settings, adding_warnings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.report.document import Claim, Report, State, Table, Verdict, page_layers, worst_of
from mapdeal.report.page import page_of
from mapdeal.report.verdict import most_urgent, portable_command, verdicts_of
from mapdeal.ros import planners, ros2_files
from mapdeal.ros.robot import RobotParameters

File = str | PathLike[str]
_LARGEST_PAGE = 25_000_000  # bytes: the limit of many e-mail servers
_PAGE, VERDICT, _VERDICT_FORMAT = "report.html", "report.json", "mapdeal-report/1"
ENDINGS = (".html", ".htm")
_GENERATOR, _HEAD = b'<meta name="generator" content="mapdeal', 1 << 12


@records.dataclass(frozen=True)
class GoalAnswer:
    path: Path
    lines: Sequence[str]
    document: Mapping[str, Any]
    problem: str | None = None


@records.dataclass(frozen=True)
class RunChecks:
    settings: Settings
    footprint: Footprint | None = None
    robot: RobotParameters | None = None
    start: tuple[float, ...] | None = None
    goals: Sequence[Goal] = records.field(default=())
    map_of_folder: Mapping[Path, Path] = records.field(default_factory=dict)
    _answered: set[int] = records.field(default_factory=set)

    @property
    def _shape(self) -> Footprint | None:
        return recipe.planned_shape(self.robot, self.footprint)

    @property
    def question(self) -> documents.ReachQuestion:
        robot, words = self.robot, [*documents.robot_words(self.footprint)]
        if robot is not None:
            for path in robot.paths:
                words += ["--params-file", documents.typed_path(path)]
            words += [] if robot.costmap == "global" else ["--costmap", robot.costmap]
            namespace, _, node = robot.node.partition(f"/{robot.costmap}_costmap/")
            words += ["--namespace", namespace] if namespace and node else []
        mask = self.settings.mask
        words += [] if mask is None else ["--mask", documents.typed_path(mask)]
        planner = "plan" if self._is_planned else "route"
        ends = tuple(self.start or ()), tuple(self.goals)
        return documents.ReachQuestion(*ends, tuple(words), planner)

    @cached_property
    def _is_planned(self) -> bool:
        robot = None if self.footprint is not None else self.robot
        if robot is None or (robot.flavour, robot.costmap) != ("nav2", "global"):
            return False
        listed, _ = planners.planners_of(robot, parameters := ros2_files.read_ros2(robot.paths))
        return planners.has_server(parameters) and bool(listed) and listed[0].planner is not None

    @cached_property
    def _mask(self) -> KeepoutMask | None:
        return mask_of(self.settings.mask, self.settings)

    @cached_property
    def _step(self) -> Step:
        robot = {"goals": tuple(self.goals), "footprint": self._shape}
        return make_step("reach", robot if self.start is None else {"start": self.start, **robot})

    def findings(self, paths: Sequence[Path]) -> documents.Results:
        def linted() -> LintReport:
            Work.current.set(None)  # lint runs as a function, not as the command
            limits: Any = {k: getattr(self.settings, k) for k in ("max_cells", "max_memory")}
            return lint(paths, footprint=self._shape, **limits)

        document = json.loads(json_values.encode_json(copy_context().run(linted).document()))
        return documents.results_of(json_values.JsonValue(Path("lint"), document))

    def reachability(self, path: Path) -> reach.Reachability:
        source = map_input(read_input(path, self.settings), path, self.settings)
        found = reach.reach_on_input(source, self._step, self.robot, self._mask)
        return reach.Reachability(source, found, self._step.title)

    def plans(self, path: Path) -> documents.Results | None:
        """Return the plans of the robot's own planner to each goal, if it is modelled."""
        if self.robot is None or self.start is None or not (self.goals and self._is_planned):
            return None
        source = map_input(read_input(path, self.settings), path, self.settings)
        check_map(source)
        mask = self._mask
        up_to_kilted = self.settings.dialect != "nav2"
        work = PlannerOnMap(source, self.robot, *planner_of(self.robot, None), mask, up_to_kilted)
        goals = [PlanGoal(goal.x, goal.y, name=goal.name) for goal in self.goals]
        plans = report_on(work, pose_of(self.start, "start"), goals, has_changes=False)
        results = documents.results_of(json_values.JsonValue(path, plans.document()))
        items = [item for item in results.items if item.kind == "route" or item.tone == "error"]
        return records.replace(results, items=items)

    def answer(self, path: Path) -> GoalAnswer:
        answer = GoalAnswer(path, [], {})
        try:
            found = self.reachability(path)
            with_goals = islice(found.lines(), 1 + len(found.reach.goals))  # without passages
            answer = GoalAnswer(path, list(with_goals), found.document())
            found.check()
        except errors.MapdealError as error:
            answer = records.replace(answer, problem=str(error.found_in(path)))
        return answer

    def add_reach(self, draft: Draft, path: Path, *, with_layer: bool, grid_bytes: int) -> None:
        """Add the reach of the robot on a map to its draft, unless its recipe computed it."""
        is_computed = any(claim.about == "goals" for claim in draft.claims)
        has_goals = bool(self.goals) or self.start is not None
        if is_computed and (not has_goals or id(draft) in self._answered):
            return
        self._answered.add(id(draft))
        if self._shape is None and not has_goals:
            text = "Where a robot can go was not checked: no robot and no goals were given"
            draft.claims.append(Claim("goals", "unknown", text))
            return
        texts: list[str] = []
        try:
            with adding_warnings(texts), source.holding(grid_bytes):
                found = self.reachability(path).reach
                plans = self.plans(path)
        except errors.MapdealError as error:
            state: State = "error"
            if error.hint is not None and "--max-memory" in error.hint:  # the map is too large
                state = "unknown"
                draft.lacks("where the robot can go", path, error)
            rule = ": ".join(filter(None, (error.place, error.rule)))
            words = f"Where the robot can go was not found: {rule}"
            draft.claims.append(Claim("goals", state, documents.short(errors.one_line(words))))
            return
        draft.warn(texts, [path])
        draft.add(documents.results_of(json_values.JsonValue(path, reach_document(found))))
        if plans is not None:
            (table,) = plans.tables
            command = draft.next_command(self.settings, plans.claims)
            rows = *table.rows, ("Next", portable_command(command))
            draft.add(records.replace(plans, tables=[records.replace(table, rows=rows)]))
        if with_layer:
            title, name = self._step.title, draft.free_name("reach")
            # only reachable cells: distances would enlarge the page
            draft.layers += page_layers(found, name, title[:1].upper() + title[1:])[-1:]


@records.dataclass(frozen=True, repr=False)
class WrittenReport(Result):
    """Result of `write_report`.

    Parameters
    ----------
    path : Path
        Path of the page.
    maps : int
        Number of maps on the page.
    size : int
        File size, bytes.
    verdicts : tuple of Verdict
        Verdict of the page on each map.
    """

    path: Path
    maps: int
    size: int
    verdicts: tuple[Verdict, ...] = ()

    @property
    def state(self) -> State:
        """The worst state of any map."""
        states = [verdict.state for verdict in self.verdicts]
        states += [claim.state for verdict in self.verdicts for claim in verdict.claims]
        return worst_of(states) or "unknown"

    def _repr_parts(self) -> Iterator[str]:
        yield str(self.path)
        yield values.count_text(self.maps, "map")
        yield f"{self.size} bytes"

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints: the page, and the verdict on each map."""
        listed = [records.asdict(verdict) for verdict in self.verdicts]
        for entry in listed:
            entry["next"] = portable_command(entry.pop("next_command"))
            for claim in entry["claims"]:
                del claim["evidence"]  # a place on the page
        return {
            "format": _VERDICT_FORMAT, "path": str(self.path), "maps": self.maps,
            "bytes": self.size, "state": self.state, "entries": listed,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        """Yield what ``mapdeal report`` prints."""
        yield f"{self.path}: {values.count_text(self.maps, 'map')}, {source.size_text(self.size)}"
        if command := most_urgent(self.verdicts):
            yield f"Next: {command}"

    def check(self) -> None:
        """Raise FindingError if a map on the page has a problem."""
        problems = [
            verdict for verdict in self.verdicts
            if "error" in (verdict.state, *(claim.state for claim in verdict.claims))
        ]  # fmt: skip
        if not problems:
            return
        first, *later = problems
        texts = (claim.text for claim in first.claims if claim.state == "error")
        rule = f"{first.name}: {next(texts, 'has a problem, see the page')}"
        rule += f"; {len(later)} more of {self.maps} maps have problems" if later else ""
        raise errors.FindingError(rule, source=self.path)


@command(
    name="report",
    group="CI and reports",
    output=Output("OUT.html", "Page to write.", ending=".html", parameter="path"),
    shared=("dialect", "resolution", "origin", "max_cells", "force", "threads", "max_memory"),
    example="""\
mapdeal run examples/maps/office.yaml -o out
mapdeal report out/office examples/maps/office.yaml -o out/report.html""",
)
def write_report(
    path: File, sources: Annotated[File | Sequence[File], Words("PATH...", typed=list[Path])], *,
    dialect: dialects.Dialect = "nav2", max_cells: int | None = None, force: bool = False,
    threads: int | None = None, max_memory: int | None = None,
) -> WrittenReport:  # fmt: skip
    """Write one HTML page about runs, maps, findings and routes.

    The page is a single file that needs no network. It begins with a verdict on each map. Below are
    all layers to zoom and pan, with the values under the pointer; findings, passages and routes in
    their places; parameters, figures and checksums. Several maps become a table with thumbnails.
    Polygons drawn over a map are saved as zones for mapdeal mask.

    Each run and each map is an entry of its own. The map that a run was made from joins that run;
    a field or costmap joins the entry named before it, if it covers the same cells. JSON of reach
    and route, and shapes, belong to the entry named before them; findings of lint belong to the
    maps that they name; a diff shows its two maps one over the other.

    Parameters
    ----------
    path : path or str
        Output path, ``.html``. Missing folders are created.
    sources : path or str, or a sequence of them
        Folders of runs or batches; maps, fields and costs; shapes; JSON of other commands.
    dialect, max_cells, max_memory
        As for `read_map`.
    force : bool
        Whether to replace an existing file.
    threads : int, optional
        Number of threads; by default one per core.

    Returns
    -------
    WrittenReport
        Path and size of the page, the number of maps on it, and the verdict on each.

    Raises
    ------
    FileAccessError
        If a source cannot be read, a folder contains no run, or the page already exists or cannot
        be written. No file is changed then.
    MalformedInputError
        If a source is malformed.
    ParameterError
        If a document belongs to none of the maps, or an argument is invalid.

    Warns
    -----
    MapdealWarning
        If something is missing or does not match; the page shows the same warning.
    """
    settings = Settings(
        dialect=dialect, max_cells=max_cells, force=force, threads=threads, max_memory=max_memory
    )
    named = [sources] if isinstance(sources, str | PathLike) else sources
    if not named:
        raise errors.ParameterError("needs at least one", place="sources")
    return written(Path(path), list(map(Path, named)), settings)


def written(
    output: Path, paths: Sequence[Path], settings: Settings, checks: RunChecks | None = None
) -> WrittenReport:
    # With what a run has asked of its maps, the verdict goes beside the page as JSON.
    if output.suffix.lower() not in ENDINGS:
        raise errors.ParameterError("the page must end in .html", source=output)
    with settings.reading(), use_threads(settings.threads), Grids(settings) as grids:
        report = gathered(paths, grids, checks)
        read = [*paths, *grids.files]
        verdict = [] if checks is None else [output.with_name(VERDICT)]
        verdicts = verdicts_of(report.entries)
        with Transaction([output, *verdict], inputs=read, force=settings.force) as transaction:
            parts, written_parts = tee(page_of(report, size=_LARGEST_PAGE))
            transaction.write_parts(output, parts)
            size = sum(map(len, written_parts))
            report_written = WrittenReport(output, len(report.entries), size, verdicts)
            for path in verdict:
                transaction.write_json(path, report_written.document())
    return report_written


def page_in(folder: Path) -> Path:
    """Return where the page of runs goes; refuse to replace there what mapdeal has not made."""
    page, verdict = folder / _PAGE, folder / VERDICT
    marks = {page: ("page", _GENERATOR), verdict: ("verdict", _VERDICT_FORMAT.encode())}
    for path, (noun, mark) in marks.items():
        if source.exists(path) and mark not in source.head_of(path, _HEAD):
            rule = f"exists, and is not a {noun} written by mapdeal"
            raise errors.FileAccessError(rule, source=path, hint="move it: --report writes there")
    return page


def gathered(paths: Sequence[Path], grids: Grids, checks: RunChecks | None = None) -> Report:
    gathering = _Gathering(grids)
    known_paths: set[object] = set()
    known: set[object] = set()
    paths = [path for path in paths if _is_first(path, known_paths)]
    entries_of = {path: _entries_of(path, grids, known) for path in paths}
    gathering.runs = [draft for found in entries_of.values() for draft in found or ()]
    if checks is not None:
        for draft in gathering.runs:
            draft.map_path = checks.map_of_folder.get(draft.path)
            draft.question = checks.question
    for path in paths:
        found = entries_of[path]
        if found is not None:
            gathering.drafts += found
        elif _is_grid(path):
            gathering.add_grid(path)
        else:
            gathering.add_document(path)
    if checks is not None:
        inputs = list(checks.map_of_folder.values())
        for path in inputs:
            with suppress(errors.MapdealError):  # the run has reported this error
                for run in gathering.add_input(grids.open(path, quietly=True)):
                    memory = grids.bytes_in_memory
                    checks.add_reach(run, path, with_layer=len(inputs) == 1, grid_bytes=memory)
        gathering.add_lint(inputs, checks)
    gathering.settle(paths[0])
    files = {*paths, *grids.files, *(place for draft in gathering.drafts for place in draft.places)}
    names = {*gathering.named, *map(str, files)}
    folders = {folder for name in names if (folder := entries.folder_of(name)) is not None}
    shown = tuple(draft.entry(grids.settings, folders) for draft in gathering.drafts)
    title = shown[0].name if len(shown) == 1 else values.count_text(len(shown), "map")
    return Report(title, shown, version.__version__)


def _entries_of(path: Path, grids: Grids, known: set[object]) -> list[Draft] | None:
    folder = path.parent if path.name in (MANIFEST, batch.SUMMARY, build.DOCUMENT) else path
    source.status_of(folder)
    if not source.is_folder(folder):
        return None
    if source.exists(folder / build.DOCUMENT):
        return [entries.methods_in(folder, grids)] if _is_first(folder, known) else []
    found = entries.runs_in(folder)
    if found is None:
        rule = f"contains no run: no {MANIFEST} in it or below"
        hint = "mapdeal run MAP -o DIR makes one; maps in a folder are named one by one"
        raise errors.FileAccessError(rule, source=folder, hint=hint)
    is_hidden = entries.NOT_SHOWN
    found = [draft for draft in found if draft.status == is_hidden or _is_first(draft.path, known)]
    for draft in found:
        try:
            entries.fill_from_run(draft, grids)
        except errors.MapdealError as error:
            if len(found) == 1:
                raise
            draft.lacks("this run", draft.path, error)
    return found


def _is_first(path: Path, known: set[object]) -> bool:
    count = len(known)
    known.add(source.identity_of(path) or path)
    return len(known) > count


def _is_grid(path: Path) -> bool:
    if path.suffix.lower() not in formats.MAP_ENDINGS:
        return map_server.is_bare_image(path)
    kind = kinds.kind_of(path)
    return kind is None or kind.name != kinds.SHAPES


class _Gathering:
    def __init__(self, grids: Grids) -> None:
        self._grids = grids
        self.runs: list[Draft] = []
        self.drafts: list[Draft] = []
        self.named: set[str] = set()
        self._known_files: set[object] = set()
        self._waiting: list[tuple[Path, documents.Results, Draft | None]] = []

    def add_grid(self, path: Path) -> None:
        if not _is_first(path, self._known_files):
            return
        opened = self._grids.open(path)
        if self.add_input(opened):
            return
        grid, draft = self._grids.grid(path), self.drafts[-1] if self.drafts else None
        fits = draft is not None and any(layer.frame == grid.frame for layer in draft.layers)
        if draft is None or opened.kind is occupancy.OccupancyGrid or not fits:
            draft = Draft(path.stem, path)
            self.drafts.append(draft)
        if opened.kind is occupancy.OccupancyGrid and draft.map_path is None:
            draft.map_path = path
        name = draft.free_name(path.stem)
        entries.add_layers(draft, self._grids.layers(path, name, grid.kind.capitalize()))
        draft.paths.append(path)
        draft.sums |= set(opened.sums.values())
        figures = grid.figures()
        draft.figures |= {**entries.columns_of({name: figures}), **draft.figures}
        if path.suffix in source.YAML and isinstance(grid, occupancy.OccupancyGrid):
            with errors.capture_warnings():  # they were given when the map was read
                info = filters.FilterInfo.of(dialects.read_metadata(path).extra)
            if info is not None:
                rows = tuple(filters.mask_rows(filters.mask_description(info, grid)))
                draft.tables.append(Table(f"{name}: zones", rows))
        draft.tables.append(Table(f"{name}: figures", entries.rows_of(figures)))
        draft.tables.append(Table(f"{name}: SHA-256", entries.rows_of(opened.sums)))
        draft.items += documents.trajectory_items(opened.trajectories)
        draft.warn(opened.warnings, opened.files)

    def add_input(self, opened: Opened) -> list[Draft]:
        runs = [run for run in self.runs if opened.sums and run.sums >= {*opened.sums.values()}]
        for run in runs:
            name = run.free_name("input")
            above = run.layers
            run.layers = self._grids.layers(opened.path, name, "Map as read")
            entries.add_layers(run, above)
            of_map = entries.columns_of({name: self._grids.grid(opened.path).figures()})
            run.figures = {**of_map, **run.figures, **of_map}
            run.paths.append(opened.path)
            run.map_path = opened.path
            run.items += documents.trajectory_items(opened.trajectories)
            run.warn(opened.warnings, opened.files)
        return runs

    def add_document(self, path: Path) -> None:
        """Read a document; its content goes where it belongs, at the end."""
        results = documents.read_results(path)
        self.named |= set(results.files)
        if results.kind in (json_values.DIFF, json_values.COST_DIFF, json_values.ALIGNMENT):
            self.drafts.append(entries.two_maps(path, results, self._grids))
        elif results.kind == json_values.ROBOT_DIFF:
            self.drafts.append(entries.two_robots(path, results, self._grids))
        elif results.kind == json_values.COMPARISON:
            rule = "is what build --compare has written beside its maps"
            raise errors.ParameterError(rule, source=path, hint=f"name the folder, {path.parent}")
        else:
            self._waiting.append((path, results, self.drafts[-1] if self.drafts else None))

    def settle(self, first: Path) -> None:
        linted, scored = (
            [(path, results) for path, results, _ in self._waiting if results.kind == kind]
            for kind in (json_values.LINT, json_values.SCORE)
        )
        if not self.drafts:
            for _, results in linted:
                self._add_maps(Path(part.name) for part in results.parts if part.claims)
            maps = [(own, path) for path, results in scored for own in results.maps]
            places = (entries.place_of(own.file, path) for own, path in maps if own is not None)
            self._add_maps(places)
        if not self.drafts:  # such as findings about parameter files alone
            rule = "belongs to a map or a run, and none is named"
            raise errors.ParameterError(rule, source=first, hint="name it before this file")
        for path, results, draft in self._waiting:
            if results.kind not in (json_values.LINT, json_values.SCORE):
                (draft or self.drafts[0]).add_about(path, results)
        for path, results in linted:
            self.add_findings(path, results)
        for path, results in scored:
            entries.give_score(path, results, self.drafts, self._grids)

    def _add_maps(self, paths: Iterable[Path]) -> None:
        for path in paths:
            try:
                self.add_grid(path)
            except errors.MapdealError as error:
                self.drafts.append(Draft(path.stem, path, map_path=path))
                self.drafts[-1].lacks("this map", path, error)

    def add_lint(self, paths: Sequence[Path], checks: RunChecks) -> None:
        try:
            results = checks.findings(paths)
        except errors.MapdealError as error:
            text = f"{errors.one_line(str(error))}, so findings of lint are not shown"
            words = "The map was not checked: the configuration of lint is invalid"
            errors.emit_warning(text)
            for draft in self.drafts:
                draft.warn([text])
                draft.claims.append(Claim("map", "unknown", words))
        else:
            self.add_findings(Path(json_values.LINT), results)

    def add_findings(self, path: Path, results: documents.Results) -> None:
        self.named |= set(results.files)
        lost = []
        for part in results.parts:
            drafts = entries.drafts_about(part.name, self.drafts)
            if not drafts and len(results.parts) == len(self.drafts) == 1:
                drafts = self.drafts
            for draft in drafts:
                draft.add(part)
            lost += [errors.one_line(part.name)] if part.items and not drafts else []
        if lost:
            rule = f"findings of {values.few_text(lost, 1)} are left out: the map is not shown here"
            errors.emit_warning(f"{path}: {rule}")
