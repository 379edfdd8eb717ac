"""Entries of a report: the content of files, of runs in folders, and of maps in documents."""

from __future__ import annotations

import re
import shlex
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from functools import partial
from itertools import islice
from pathlib import Path, PurePath
from typing import Any, TypeGuard, TypeVar, get_args

import numpy as np

from mapdeal import errors
from mapdeal.commands import diff, report_documents as documents
from mapdeal.commands.build import DOCUMENT
from mapdeal.commands.report_documents import ReachQuestion, Results, Subject
from mapdeal.commands.two_maps import names_of_two
from mapdeal.compare.difference import CostDifference
from mapdeal.files import json_values, source as file_source
from mapdeal.files.source import claim, contents_of, exists, is_same_file, room, sums_of_reads
from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.occupancy import CloudLayers, OccupancyGrid
from mapdeal.grid.reach import Goal, Reach
from mapdeal.kernels.blocks import Layer, blocks_of, is_lazy, lazy_layer
from mapdeal.maps import map_file, map_server, reading
from mapdeal.maps.listing import folders_below
from mapdeal.pictures.styles import cost_change_style, difference_style
from mapdeal.pipeline.batch import SUMMARY
from mapdeal.pipeline.folder import MANIFEST, format_value, manifest_in, product_of, warnings_in
from mapdeal.pipeline.inputs import bytes_of, map_input, mask_of, read_together
from mapdeal.pipeline.settings import Settings, adding_warnings, portable
from mapdeal.pipeline.step import Step, make_step
from mapdeal.records import dataclass, field, replace
from mapdeal.report import document as contents, tiles, verdict
from mapdeal.report.document import MAP, About, Claim, Entry, Item, PageLayer, State, Table
from mapdeal.ros.load import read_robot

Kind = TypeVar("Kind")

_MOST_LISTED = 5000  # items, tables, rows or warnings of an entry: browsers get slow beyond
_ABSOLUTE = re.compile(r"(?<![\w./\\-])(?=/|[A-Za-z]:[\\/]|\\\\)")
_SEPARATOR = re.compile(r"[\\/]")
_MOST_SEPARATORS = 32  # up to which a name in a text is compared with folders, for linear time
_BYTES_OF_PAGE = 20_000_000  # while it is made
_BYTES_PER_LINE = 16  # per row and column of a map
_GRIDS_SHARE = 4  # grids in memory may use a quarter of the free memory
_BAND_ROWS = 512  # of a file that is read by rows
_BAND_COPIES = 9  # held at a time
_NO_LIMIT = 1 << 62
NOT_SHOWN = "not shown"  # the status of a run of a batch that is in no folder of it
_GRIDS = (".npz", ".yaml")  # the files of a product that hold its values, the most exact first
_MOST_WRONG = 20  # files of a run that are warned of one by one
_LARGEST_FIGURE = 1e15  # floats represent all integers up to here
_FINISHED = ("done", "unchanged")
_DIGITS = 6  # of numbers as people write them: ROS's float32 has 0.19 as 0.19000000692903996
_LARGEST_ROUNDED = 1e6
_MAP_COLUMNS = ("occupied %", "free %", "unknown %")
_BY_URGENCY: tuple[About, ...] = ("run", "map", "goals")
_OF_TWO_MAPS: set[About] = {"obstacles", "cells", "geometry"}
_SHAPES = {"--robot-radius", "--footprint", "--params-file"}
_NAV2_RADIUS = ("--robot-radius", "0.22")  # the default of Nav2
_UNKNOWN_MAP = np.full((1, 1), -1, dtype=np.int8)


@dataclass
class Draft:
    name: str
    path: Path
    sums: set[str] = field(default_factory=set)
    paths: list[Path] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    status: str = ""
    layers: list[PageLayer] = field(default_factory=list)
    items: list[Item] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    warnings: dict[str, None] = field(default_factory=dict)
    figures: dict[str, str | float] = field(default_factory=dict)
    curve: CostCurve | None = None
    compared: tuple[str, str] | None = None
    opens_swiped: bool = True
    claims: list[Claim] = field(default_factory=list)
    outputs: set[str] = field(default_factory=set)  # checksums of what the run wrote
    subjects: list[tuple[Path, Subject]] = field(default_factory=list)
    map_path: Path | None = None  # of the map that this is about
    question: ReachQuestion | None = None
    replays: tuple[Path, ...] = ()  # runs that are one costmap at several times

    @property
    def places(self) -> tuple[Path, ...]:
        return (self.path, *self.paths)

    def warn(self, texts: Iterable[str], files: Iterable[Path] = ()) -> None:
        self.warnings |= dict.fromkeys(portable(texts, files))

    def miss(self, text: str, file: Path) -> None:
        errors.emit_warning(text)
        self.warn([text], [file])

    def lacks(self, content: str, file: Path, error: errors.MapdealError) -> None:
        self.miss(f"{errors.one_line(str(error))}, so {content} is not shown", file)

    def compare_sums(self, file: Path, found: object, named: object, claim: str) -> None:
        if named and found != named:
            self.miss(f"{file}: is not the map that {claim}: its checksum differs", file)

    def add_subjects(self, path: Path, subjects: Iterable[Subject]) -> None:
        for subject in subjects:
            for first, earlier in self.subjects:
                if earlier.kind == subject.kind and subject.differs(earlier):
                    text = f"{path}: another {subject.kind} than in {first}: "
                    self.miss(f"{text}{subject.text}, not {earlier.text}", path)
                    break
            self.subjects.append((path, subject))

    def add_about(self, path: Path, results: Results) -> None:
        known = self.sums | self.outputs
        for named in results.maps:
            if named is not None and known and not set(named.sha256.values()) <= known:
                self.miss(f"{path}: another map than here: {documents.short(named.file)}", path)
        self.add_subjects(path, results.subjects)
        self.add(results)

    def add(self, results: Results) -> None:
        self.items += results.items
        self.tables += results.tables
        self.claims += results.claims
        self.question = self.question or results.question

    def free_name(self, name: str) -> str:
        used = {layer.name for layer in self.layers}
        names = (name if number == 1 else f"{name}-{number}" for number in range(1, len(used) + 2))
        return next(candidate for candidate in names if candidate not in used)

    def next_command(self, settings: Settings, claims: Iterable[Claim]) -> str:
        """Return the command that follows from the claims about the map; empty if there is none."""
        by_subject = {claim.about: claim for claim in claims}
        if by_subject.keys() & _OF_TWO_MAPS:
            return ""
        about_map = [by_subject[about] for about in _BY_URGENCY if about in by_subject]
        worst = min(about_map, key=lambda claim: get_args(State).index(claim.state), default=None)
        goals, question = by_subject.get("goals"), self.question or ReachQuestion((), (), ())
        robot = question.robot
        robot = robot if _SHAPES & {*robot} else (*_NAV2_RADIUS, *robot)
        options = [] if settings.max_cells is None else ["--max-cells", str(settings.max_cells)]
        if self.map_path is not None and map_server.is_bare_image(self.map_path) and self.layers:
            frame = self.layers[0].frame
            origin = ",".join(f"{value:.9g}" for value in frame.origin)
            options += ["--resolution", f"{frame.resolution:.9g}", "--origin", origin]
        dialect = [] if settings.dialect == "nav2" else ["--dialect", settings.dialect]
        if self.map_path is None:
            named = next(path for path in (self.path, *self.path.parents) if exists(path))
            words = ["info", documents.typed_path(named)]
        elif worst is None or (worst is not goals and worst.state != "good"):
            words = ["lint", documents.typed_path(self.map_path), *options]
        elif "costmap" in by_subject and (goals is None or goals.state == "unknown"):
            words = ["run", documents.typed_path(self.map_path), *options, *dialect, "-o", "nav2"]
            words += ["--recipe", "nav2", *robot, "--report"]
        else:
            start, targets, planner = question.start, question.goals, "reach"
            if goals is not None and not goals.evidence:  # reach refused the start
                start = ()
            is_good = goals is not None and goals.state == "good"
            if start and targets and (is_good or question.planner == "plan"):
                planner = question.planner
            is_routed = planner == "route"
            words = [planner, documents.typed_path(self.map_path), *options, *dialect]
            words += ["--from", _numbers(start[: 2 if is_routed else 3])] if start else []
            texts = [_numbers((targets[0].x, targets[0].y))] if is_routed else map(_goal, targets)
            words += ["--to", *texts] if targets else []
            words += robot
        line = shlex.join(["mapdeal", *words])
        return line if line == errors.one_line(line) else ""

    def entry(self, settings: Settings, folders: Collection[str] = ()) -> Entry:
        """Return the entry; lists of thousands of items, tables or rows are cut off."""
        # Names of files in texts lose the absolute `folders` of this machine or the document's.
        shown = partial(without_folders, folders=folders)
        items = _first(self.items, lambda text: Item("finding", text, "note"))
        tables = []
        for table in _first(self.tables, lambda text: Table(text, ())):
            rows = _first(table.rows, lambda text: (text, ""))
            tables.append(Table(shown(table.title), tuple((shown(k), shown(v)) for k, v in rows)))
        claims = verdict.settled(self.claims)
        return Entry(
            shown(self.name), tuple(self.layers),
            tuple(replace(item, text=shown(item.text)) for item in items), tuple(tables),
            tuple(map(shown, _first(tuple(self.warnings), str))), self.status,
            dict(self.figures), self.curve, self.compared, tiles.extent_of(self.layers, self.items),
            tuple(replace(claim, text=shown(claim.text)) for claim in claims),
            self.opens_swiped, self.next_command(settings, claims), bool(self.replays),
        )  # fmt: skip


def _numbers(values: Iterable[float]) -> str:
    return ",".join(f"{value + 0.0:.9g}" for value in values)


def _goal(goal: Goal) -> str:
    name = "" if goal.name is None or "=" in goal.name else f"{goal.name}="
    return f"{name}{_numbers((goal.x, goal.y))}"


def folder_of(name: str) -> str | None:
    end = max(name.rfind("/"), name.rfind("\\"))
    return errors.one_line(name[:end]) if end > 0 and _ABSOLUTE.match(name) else None


def without_folders(text: str, folders: Collection[str]) -> str:
    shown, copied_to = "", 0
    for start in (match.start() for match in _ABSOLUTE.finditer(text)):
        separators = islice(_SEPARATOR.finditer(text, start + 1), _MOST_SEPARATORS)
        ends = [match.end() for match in separators if text[start : match.start()] in folders]
        if ends and start >= copied_to:
            shown, copied_to = shown + text[copied_to:start], ends[-1]
    return shown + text[copied_to:]


def _first(items: Sequence[Kind], make_item: Callable[[str], Kind]) -> tuple[Kind, ...]:
    if len(items) <= _MOST_LISTED:
        return tuple(items)
    return (*items[:_MOST_LISTED], make_item(f"{len(items) - _MOST_LISTED} more are not listed"))


@dataclass(frozen=True)
class Opened:
    path: Path
    kind: type[Any]
    files: tuple[Path, ...]
    sums: Mapping[str, str]
    warnings: tuple[str, ...]
    trajectories: Mapping[int, Any]


class Grids(AbstractContextManager["Grids"]):
    """The grids of files, as many of them in memory as there is room for."""

    # Files that are read row by row stay open until the ``with`` block ends.

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        free = room()
        self._room = _NO_LIMIT if free is None else free // _GRIDS_SHARE
        self._stack = ExitStack()
        self._opened: dict[Path, Opened] = {}
        self._grids: OrderedDict[Path, map_file.Grid] = OrderedDict()
        self._layer_read: tuple[tuple[Path, int], Layer] | None = None

    def __exit__(self, *_: object) -> None:
        self._grids.clear()
        self._layer_read = None
        self._stack.close()

    @property
    def files(self) -> tuple[Path, ...]:
        return tuple(file for opened in self._opened.values() for file in opened.files)

    @property
    def bytes_in_memory(self) -> int:
        return sum(0 if grid.is_lazy else bytes_of(grid) for grid in self._grids.values())

    def open(self, path: Path, *, quietly: bool = False) -> Opened:
        """Read a file once, and store its warnings; `quietly` does not emit them."""
        if path not in self._opened:
            texts: list[str] = []
            muted = errors.capture_warnings() if quietly else nullcontext()
            with muted, adding_warnings(texts), sums_of_reads() as read:
                grid, file = self._read(path)
                sums = file.sums_by_name(read)
            self._keep(path, grid)
            results = tuple(texts), file.trajectories()
            self._opened[path] = Opened(path, type(grid), file.files, sums, *results)
        return self._opened[path]

    def is_there(self, path: Path, draft: Draft, content: str, *, quietly: bool = False) -> bool:
        """Open a file as `open` does; if it cannot be read, warn that `content` is not shown."""
        try:
            self.open(path, quietly=quietly)
        except errors.MapdealError as error:
            draft.lacks(content, path, error)
            return False
        return True

    def grid(self, path: Path) -> map_file.Grid:
        # Raises `FileAccessError` if the file has changed since it was opened.
        if path not in self._grids:
            # the warnings were given when it was opened
            with errors.capture_warnings(), sums_of_reads() as read:
                grid, file = self._read(path)
                sums = file.sums_by_name(read)
            if sums != self._opened[path].sums:
                raise errors.FileAccessError(file_source.CHANGED, source=path)
            self._keep(path, grid)
        self._grids.move_to_end(path)
        return self._grids[path]

    def layers(self, path: Path, name: str, title: str) -> list[PageLayer]:
        grid = self.grid(path)
        kinds = enumerate(contents.kinds_of(grid))
        return [self._reread(kind.of(grid, name, title), path, index) for index, kind in kinds]

    def _read(self, path: Path) -> tuple[map_file.Grid, map_file.MapFile]:
        settings = self.settings
        with ExitStack() as stack:
            opened = reading.open_map(path, dialect=settings.dialect, max_cells=settings.max_cells)
            file = stack.enter_context(opened)
            lines_bytes = file_source.bytes_of_lines(file.shape(), _BYTES_PER_LINE)
            claim(path, page_bytes := _BYTES_OF_PAGE + lines_bytes)
            for kind in (Reach, CloudLayers):
                if (grid := file.layers_of(kind)) is not None:
                    return grid, file
            is_small = file.memory_to_read() <= self._room
            if is_small or not (file.has_lazy_rows or file.shape_by_rows):
                return file.read().grid, file
            height = max(file.shape()[0], _BAND_ROWS)
            band_bytes = _BAND_COPIES * file.memory_to_read() * _BAND_ROWS // height
            # besides the share of the grids in memory
            claim(path, (page_bytes + band_bytes) * _GRIDS_SHARE // (_GRIDS_SHARE - 1))
            self._stack.enter_context(stack.pop_all())
            return file.by_rows(block_height=_BAND_ROWS).grid, file

    def _reread(self, layer: PageLayer, path: Path, index: int) -> PageLayer:
        if is_lazy(layer.values):
            return layer

        def read_rows(rows: slice) -> Any:
            if self._layer_read is None or self._layer_read[0] != (path, index):
                grid = self.grid(path)
                self._layer_read = (path, index), contents.kinds_of(grid)[index].values(grid)
            return self._layer_read[1][rows]

        dtype = layer.values.dtype
        values = lazy_layer(layer.frame.shape, dtype, read_rows, block_height=_BAND_ROWS)
        return replace(layer, values=values)

    def _keep(self, path: Path, grid: map_file.Grid) -> None:
        """Store a grid, and drop the least recently used ones if memory runs out."""
        self._grids[path] = grid
        while len(self._grids) > 1 and self.bytes_in_memory > self._room:
            dropped, _ = self._grids.popitem(last=False)
            if self._layer_read is not None and self._layer_read[0][0] == dropped:
                self._layer_read = None


def runs_in(folder: Path) -> list[Draft] | None:
    """Return a draft for each run in a folder: its own, those of a batch, or those below it."""
    # The draft of a failed run comes from the summary of its batch.
    if exists(folder / MANIFEST):
        local = (name for name in contents_of(folder)[0] if exists(folder / name / MANIFEST))
        drafts = [Draft(f"{folder.name}/{name}", folder / name) for name in local]
        return [Draft(folder.name or str(folder), folder), *drafts]
    entries = _nested_value(json_values.read_json(folder / SUMMARY), "maps")
    if isinstance(entries, list) and entries and all(isinstance(row, dict) for row in entries):
        drafts = [draft for record in entries for draft in _drafts_of_batch(folder, record)]
        paths = tuple(draft.path for draft in drafts)
        if len(paths) > 1 and all(_time_of_replay(path) is not None for path in paths):
            return [Draft(folder.name or str(folder), folder, replays=paths)]
        return drafts
    runs = [path for path, files in folders_below([folder], contents_of) if MANIFEST in files]
    return [Draft(str(path.relative_to(folder)), path) for path in sorted(runs)] or None


def _drafts_of_batch(folder: Path, record: Mapping[str, Any]) -> Iterator[Draft]:
    place, status, name = (str(record.get(key)) for key in ("folder", "status", "map"))
    parts = PurePath(place).parts
    if not parts or ".." in parts or PurePath(place).is_absolute():  # even if a run is there
        draft = Draft(place, folder, status=NOT_SHOWN)
        rule = "is in no folder of this batch, so it is not shown"
        draft.miss(f"{folder / SUMMARY}: {errors.one_line(place)} {rule}", folder / SUMMARY)
        yield draft
        return
    # "unchanged" is a run that was there already
    status = _FINISHED[0] if status in _FINISHED else status
    draft = Draft(place, folder / place, status=status, names={name})
    if status not in _FINISHED:
        draft.tables.append(Table("Input", (("map", name),)))
        reason = str(record.get("error", status))
        draft.warn([reason])
        shown = documents.short(reason).removeprefix(f"{errors.one_line(name)}: ")
        draft.claims.append(Claim("run", "error", f"Processing failed: {shown}", "finding"))
    yield draft
    if "local" in record:
        yield Draft(f"{place}/local", folder / place / "local", status=status)


def _nested_value(value: Any, *keys: str) -> Any:
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _time_of_replay(folder: Path) -> float | None:
    time = _nested_value(json_values.read_json(folder / MANIFEST), "figures", "replay", "time")
    return time if isinstance(time, float) else None


def _fill_from_replays(draft: Draft, grids: Grids) -> None:
    """Fill an entry with a layer for each time, whose title is the seconds since the first."""
    first = _time_of_replay(draft.replays[0]) or 0.0
    for path in draft.replays:
        run = Draft(path.name, path)
        fill_from_run(run, grids)
        title = f"{(_time_of_replay(path) or 0.0) - first:.3f} s"
        draft.layers += [replace(layer, name=path.name, title=title) for layer in run.layers]
        draft.tables, draft.curve = run.tables, run.curve
        draft.warnings |= run.warnings
        draft.outputs |= run.outputs


def fill_from_run(draft: Draft, grids: Grids) -> None:
    if draft.replays:
        _fill_from_replays(draft, grids)
        return
    # Missing files, and files that differ from the manifest, become warnings.
    if draft.status and draft.status not in _FINISHED and not exists(draft.path / MANIFEST):
        return
    manifest = manifest_in(draft.path)
    inputs = manifest.get("inputs")
    if isinstance(inputs, dict):
        draft.sums |= set(map(str, inputs.values()))
        draft.files |= set(map(str, inputs))
    draft.outputs |= set(map(str, manifest["outputs"].values()))
    draft.add_subjects(draft.path, _subjects_of_run(manifest))
    _check_outputs(draft, manifest)
    for stage in manifest["stages"]:
        name, parameters = next(iter(stage.items()))
        step: Step | None = None
        with suppress(errors.ParameterError):
            step = make_step(name, parameters)
        _add_product(draft, name, name if step is None else step.title, manifest["outputs"], grids)
        if (document := f"{product_of(name)}.json") in manifest["outputs"]:
            try:
                draft.add(documents.read_results(draft.path / document))
            except errors.MapdealError as error:
                draft.miss(errors.one_line(str(error)), draft.path / document)
        figures = manifest["figures"].get(name)
        draft.tables.append(Table(f"{name}: parameters", rows_of(parameters)))
        draft.tables.append(Table(f"{name}: figures", rows_of(figures)))
        resolution = _nested_value(figures, "resolution")
        with suppress(errors.MapdealError):
            if step is not None and _is_figure(resolution):
                draft.curve = step.curve_on(OccupancyGrid(_UNKNOWN_MAP, resolution)) or draft.curve
    version = ("mapdeal", format_value(manifest.get("version")))
    draft.tables += [
        Table("Run", (version, *rows_of(manifest.get("options")))),
        Table("Robot", rows_of(manifest.get("robot"))),
        Table("Files read, and their SHA-256", rows_of(inputs)),
        Table("Files written, and their SHA-256", rows_of(manifest["outputs"])),
    ]
    draft.tables = [table for table in draft.tables if table.rows]
    # shares of cells after a stage do not describe the map: once inflated, most of it is occupied
    columns = columns_of(manifest["figures"])
    draft.figures |= {name: value for name, value in columns.items() if name not in _MAP_COLUMNS}
    draft.warn(warnings_in(manifest))
    if (costs := verdict.on_costs(manifest)) is not None:
        draft.claims.append(replace(costs, text=documents.short(costs.text)))


def _subjects_of_run(manifest: Mapping[str, Any]) -> Iterator[Subject]:
    robot = manifest.get("robot")
    stages = {name: values for stage in manifest["stages"] for name, values in stage.items()}
    shapes = (_nested_value(values, "footprint") for values in stages.values())
    shape = next((shape for shape in shapes if isinstance(shape, dict) or shape), None)
    inner = _nested_value(stages, "cost", "inscribed_radius")
    outer = None
    if isinstance(robot, dict):
        files = robot.get("files")
        if isinstance(files, list) and all(isinstance(file, dict) for file in files):
            named = [(str(file.get("name")), str(file.get("sha256"))) for file in files]
            yield documents.costmap_subject(str(robot.get("costmap")), named)
        inner = robot.get("inscribed_radius")
        if robot.get("robot_radius") is None:
            outer = robot.get("circumscribed_radius")
    elif shape is not None:
        inner = _nested_value(shape, "radius")
        if isinstance(shape, list):
            with suppress(errors.MapdealError):
                footprint = documents.checked_shape(shape)
                inner, outer = footprint.inscribed_radius, footprint.circumscribed_radius
    if _is_figure(inner) and inner > 0:
        outer = outer if _is_figure(outer) else None
        text = f"a robot of radius {inner:.4g} m" + ("" if outer is None else f" to {outer:.4g} m")
        yield documents.robot_subject(text, inner, outer)


def _check_outputs(draft: Draft, manifest: Mapping[str, Any]) -> None:
    wrong: dict[Path, str] = {}
    for name, digest in manifest["outputs"].items():
        path = draft.path / Path(name).name
        if not exists(path):
            wrong[path] = "is missing, though the manifest lists it"
        elif not file_source.holds(path, digest):
            wrong[path] = "is not what the run wrote: its checksum differs"
    for path in islice(wrong, _MOST_WRONG):
        draft.miss(f"{path}: {wrong[path]}", path)
    if (unlisted := len(wrong) - _MOST_WRONG) > 0:
        rule = f"{unlisted} more of the files that it lists are missing, or are others"
        draft.miss(f"{draft.path / MANIFEST}: {rule}", draft.path / MANIFEST)


def _add_product(draft: Draft, stage: str, title: str, outputs: Any, grids: Grids) -> None:
    product = product_of(stage)
    names = [f"{product}{ending}" for ending in _GRIDS]
    path = next((draft.path / name for name in names if name in outputs), None)
    if path is None:
        rule = f"the run wrote no values of stage {stage}"
        draft.miss(f"{draft.path / MANIFEST}: {rule}", draft.path / MANIFEST)
    elif grids.is_there(path, draft, f"layer {product}", quietly=True):  # the run has warned of it
        add_layers(draft, grids.layers(path, product, title[:1].upper() + title[1:]))


def add_layers(draft: Draft, layers: Iterable[PageLayer]) -> None:
    """Append layers to a draft; a map that it already has is not repeated."""
    replacements: dict[str | None, str] = {}
    for layer in layers:
        if layer.name.endswith(f"-{MAP}"):
            equal = next((earlier for earlier in draft.layers if _are_equal(earlier, layer)), None)
            if equal is not None:
                replacements[layer.name] = equal.name
                continue
        draft.layers.append(replace(layer, states=replacements.get(layer.states, layer.states)))


def _are_equal(layer: PageLayer, earlier: PageLayer) -> bool:
    colours, earlier_colours = layer.style.by_value, earlier.style.by_value
    if layer.frame != earlier.frame or colours is None or earlier_colours is None:
        return False
    if not np.array_equal(colours, earlier_colours):
        return False
    blocks = blocks_of(layer.values)
    return all(np.array_equal(layer.values[rows], earlier.values[rows]) for rows in blocks)


def columns_of(figures: Mapping[str, Any]) -> dict[str, str | float]:
    columns: dict[str, str | float] = {}
    for record in figures.values():
        if isinstance(record, dict):
            columns |= {**_columns_of_grid(record), **columns}  # the first record counts
    return columns


def _columns_of_grid(figures: Mapping[str, Any]) -> dict[str, str | float]:
    """Return the columns of figures that are numbers; those of foreign manifests may be others."""
    known = {name: value for name, value in figures.items() if _is_figure(value)}
    cells = known.get("width", 0) * known.get("height", 0)
    columns: dict[str, str | float] = {}
    if cells > 0:
        columns["cells"] = f"{known['width']} x {known['height']}"
    if "resolution" in known:
        columns["m per cell"] = float(known["resolution"])
    # the free and unknown cells of a costmap are not those of a map
    for name in ("lethal",) if "lethal" in known else ("occupied", "free", "unknown"):
        if name in known and cells > 0:
            columns[f"{name} %"] = round(100 * known[name] / cells, 2)
    if "reachable_m2" in known:
        columns["reachable m2"] = round(float(known["reachable_m2"]), 3)
    return columns


def _is_figure(value: object) -> TypeGuard[int | float]:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= _LARGEST_FIGURE


def rows_of(values: object) -> tuple[tuple[str, str], ...]:
    pairs = values.items() if isinstance(values, dict) else ()
    texts = {str(name): format_value(_with_rounded_numbers(value)) for name, value in pairs}
    return tuple((name, errors.one_line(text)) for name, text in texts.items())


def _with_rounded_numbers(value: object) -> object:
    if isinstance(value, dict):
        return {key: _with_rounded_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_rounded_numbers(item) for item in value]
    if isinstance(value, float) and abs(value) < _LARGEST_ROUNDED:
        return float(f"{value:.{_DIGITS}g}")
    return value


def drafts_about(file: str, drafts: Sequence[Draft]) -> list[Draft]:
    # First the drafts of this map or folder, wherever lint was started; then those whose name in a
    # batch ends the path; then the only run that read a file of this name.
    path = Path(file)
    same = [draft for draft in drafts if any(is_same_file(path, place) for place in draft.places)]
    tails = {path.parts[k:] for k in range(len(path.parts))}
    ends = [draft for draft in drafts if any(Path(name).parts in tails for name in draft.names)]
    named = [draft for draft in drafts if path.name in draft.files]
    return same or ends or (named if len(named) == 1 else [])


def place_of(name: str, document: Path) -> Path:
    """Return where a file is: as it was named, or beside the document."""
    beside = document.parent / Path(name).name
    return beside if exists(beside) and not exists(Path(name)) else Path(name)


def give_score(document: Path, results: Results, drafts: list[Draft], grids: Grids) -> None:
    (scored,) = results.maps
    place = None if scored is None else place_of(scored.file, document)
    owners = [] if place is None else drafts_about(str(place), drafts)
    if not owners and len(drafts) == 1:
        owners = drafts
    for draft in owners:
        draft.tables += results.tables
        for path in draft.paths:
            if scored is not None and place is not None and is_same_file(place, path):
                sums = sorted(grids.open(path).sums.values())
                named = sorted(scored.sha256.values())
                draft.compare_sums(path, sums, named, f"{document.name} scores")
    if not owners:
        name = "a map that is not a file" if scored is None else documents.short(scored.file)
        rule = f"the score of {name} is left out: the map is not shown here"
        errors.emit_warning(f"{document}: {rule}")


def methods_in(folder: Path, grids: Grids) -> Draft:
    results = documents.read_results(folder / DOCUMENT)
    if results.kind != json_values.COMPARISON:
        raise errors.MalformedInputError("is not a comparison of methods", source=folder / DOCUMENT)
    draft = Draft(folder.name or str(folder), folder, tables=list(results.tables))
    for method in results.parts:
        name, path = method.name, folder / Path(f"{method.name}.yaml").name
        if path not in draft.paths:  # names of methods may differ only by a folder
            draft.paths.append(path)
            if grids.is_there(path, draft, f"layer {name}"):
                draft.layers += grids.layers(path, name, f"Map by {name}")
                draft.tables.append(Table(f"{name}: SHA-256", rows_of(grids.open(path).sums)))
        draft.items += method.items
    if len(draft.layers) > 1:
        draft.compared = draft.layers[0].name, draft.layers[1].name
    return draft


def two_maps(path: Path, results: Results, grids: Grids) -> Draft:
    # The maps are read again. A map that is missing, or has changed since, is reported.
    first, second = results.maps
    is_diff = results.kind in (json_values.DIFF, json_values.COST_DIFF)
    if first is None or second is None:
        hint = "mapdeal diff A B --json also writes their names" if is_diff else None
        raise errors.MalformedInputError("does not name its two maps", source=path, hint=hint)
    names = names_of_two(Path(first.file), Path(second.file))
    draft = Draft(f" {'and' if is_diff else 'on'} ".join(names), path, tables=list(results.tables))
    readable: list[Path] = []
    for named, name in ((first, "first"), (second, "second")):
        place = place_of(named.file, path)
        if not grids.is_there(place, draft, "this map"):
            continue
        readable.append(place)
        sums = grids.open(place).sums
        draft.compare_sums(place, dict(sums), dict(named.sha256), f"{path.name} names")
        transform = results.transform if (named is second) == is_diff else None
        if transform is not None and is_diff:  # differences are shown on the lattice of the first
            transform = transform.inverse()
        title = f"{name.capitalize()} map{'' if transform is None else ', moved'}: {place.name}"
        layers = grids.layers(place, name, title)
        if transform is not None:
            layers = [replace(layer, frame=transform.frame(layer.frame)) for layer in layers]
        if is_diff:
            layers = layers[-1:]
            draft.paths.append(place)
        else:
            draft.tables.append(Table(f"{name}: SHA-256", rows_of(sums)))
        draft.layers += layers
    if len(draft.layers) > 1:
        draft.compared = draft.layers[0].name, draft.layers[-1].name
        draft.opens_swiped = not is_diff
    if is_diff and len(readable) == 2:
        _add_difference(draft, readable, grids, results)
    draft.claims += results.claims
    return draft


def _add_difference(draft: Draft, paths: Sequence[Path], grids: Grids, results: Results) -> None:
    settings = grids.settings
    with errors.capture_warnings():  # they were given when the maps were opened
        sources = zip(paths, read_together(paths, settings), strict=True)
        maps = [map_input(grid, path, settings) for path, grid in sources]
        if results.kind == json_values.DIFF:
            move, tolerance = results.transform, results.tolerance
            difference = diff.compared(maps, tolerance=tolerance, move=move)
    if results.kind == json_values.COST_DIFF:
        try:
            costs = diff.costmaps_compared(maps, results.transform, None).costs
            add_cost_changes(draft, costs)
            draft.items += documents.cost_change_items(costs.changes.values(), costs.frame)
            draft.claims += verdict.on_cost_difference(costs)
        except errors.ParameterError as error:  # a map has replaced the costs in a file
            draft.lacks("what differs", Path(str(error.source)), error)
        return
    style, title = difference_style(), "What differs"
    draft.layers.append(PageLayer("difference", title, difference.frame, difference.changes, style))
    changes, unlisted = difference.largest_changes(documents.MOST_CHANGES)
    draft.items += documents.change_items(changes, unlisted, difference.frame)
    draft.claims += verdict.on_difference(difference, changes, unlisted)


def two_robots(path: Path, results: Results, grids: Grids) -> Draft:
    (named, named_mask), settings = results.maps, grids.settings
    if named is None:
        raise errors.MalformedInputError("does not name its map", source=path)
    place = place_of(named.file, path)
    draft = Draft("", path, paths=[place])
    with errors.capture_warnings():
        robots = [
            read_robot(
                [place_of(name, path) for name, _ in robot.files],
                costmap=robot.costmap, namespace=robot.namespace,
                up_to_kilted=settings.dialect != "nav2",
            )
            for robot in results.robots
        ]  # fmt: skip
        (source,) = read_together([place], settings)
        mask_path = None if named_mask is None else place_of(named_mask.file, path)
        mask = mask_of(mask_path, settings, source.grid)
        comparison = diff.robots_compared(
            map_input(source, place, settings), (robots[0], robots[1]), results.start,
            results.goals, mask,
        )  # fmt: skip
    sums = grids.open(place).sums
    draft.compare_sums(place, dict(sums), dict(named.sha256), f"{path.name} names")
    if named_mask and mask and mask_path:
        draft.paths.append(mask_path)
        draft.compare_sums(mask_path, mask.sums, dict(named_mask.sha256), f"{path.name} names")
    for robot, named_robot in zip(robots, results.robots, strict=True):
        for file, (_, sha256) in zip(robot.files, named_robot.files, strict=False):
            if file.sha256 != sha256:
                draft.miss(f"{file.path}: is not the file that {path.name} names", file.path)
    draft.name = f"{Path(place).stem}: {' → '.join(comparison.names)}"
    draft.layers += grids.layers(place, "map", f"Map: {place.name}")[-1:]
    named_costs = zip(("first", "second"), comparison.names, comparison.costmaps, strict=True)
    for name, shown, costmap in named_costs:
        draft.layers += contents.page_layers(costmap, name, f"Costs of {shown}")
    pairs = {name: " → ".join(map(diff.value_text, pair))
             for name, pair in comparison.parameters.items()}  # fmt: skip
    draft.tables.append(Table("Parameters that differ", rows_of(pairs)))
    reach_rows = ("reached", comparison.reach_text()), *comparison.goal_rows()
    draft.tables.append(Table("Reach", reach_rows))
    draft.compared, draft.opens_swiped = ("first", "second"), False
    after = comparison.reaches[1]
    draft.items += documents.passage_change_items(comparison.closed, "closes", "error")
    draft.items += documents.passage_change_items(comparison.opened, "opens", "good")
    draft.items += documents.goal_items(after.goals, after.robot, after.heading_count)
    add_cost_changes(draft, comparison.costs)
    reach_text = comparison.reach_text().replace("->", "→")
    draft.claims += verdict.on_robots(
        list(pairs), comparison.verdict, reach_text, comparison.costs, passes=comparison.passes
    )
    return draft


def add_cost_changes(draft: Draft, costs: CostDifference) -> None:
    codes, style = diff.change_codes(costs), cost_change_style()
    draft.layers.append(PageLayer("difference", "Change of the cost", costs.frame, codes, style))
    changes = [change for change in costs.changes.values() if change.cells]
    rows = tuple((change.kind, diff.change_text(change)) for change in changes)
    draft.tables.append(Table(verdict.COST_CHANGES, rows or (("changes", "none"),)))
