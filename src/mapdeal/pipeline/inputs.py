"""Maps in memory or block by block: which of the two a map needs, and how it is opened."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from contextvars import ContextVar
from functools import cached_property
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol, TypedDict, TypeVar, cast

import numpy as np

from mapdeal import command, records
from mapdeal.compatibility import Unpack
from mapdeal.errors import MalformedInputError, MapdealError, ParameterError, emit_warning, one_line
from mapdeal.files import source as sources
from mapdeal.files.transaction import Transaction
from mapdeal.grid.canvas import FieldGrid
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import FieldView, PotentialField
from mapdeal.grid.frame import Framed, Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels import arrays, engine, lookup
from mapdeal.kernels.blocks import CacheBudget, counts_of, lazy_layer, swept
from mapdeal.kernels.threads import tables_claimed, thread_count, use_threads
from mapdeal.maps import dialects, npz
from mapdeal.maps.reading import MapFile, Source, as_occupancy, open_map
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Canvas, ProgressCallback, Settings
from mapdeal.pipeline.step import Step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.cost import apply_keepout_mask

_BYTES_PER_PIXEL = 10  # of pictures while they are drawn, two at the same time
_DRAWING_LIBRARY = 11_000_000  # bytes of Pillow and its fonts
_BYTES_PER_LONG_SQUARE = 10  # additional bytes per cell where squares of distances have 64 bits
_BYTES_PER_LINE = 16  # per row and column
# per row and column where distances are measured: bands have one row or more, scipy has long sides
_BYTES_PER_MEASURED_LINE = 130
_CANVAS_SHARE = 0.9  # memory to extend a product to the full canvas, as a share of the stage's
_BYTES_PER_CELL_READ = 1.0  # reading releases everything else before stages begin


class _Demand(NamedTuple):  # of an engine, bytes
    base: int  # of the process
    per_cell: float  # of whole maps
    per_block_cell: int


_DEMANDS = {"compiled": _Demand(50_000_000, 0.0, 40), "scipy": _Demand(100_000_000, 12.0, 90)}
_RUN_BYTES_PER_COLUMN = 20  # for the runs at each block's edge: `mapdeal.kernels.distance`
_BLOCK_CELLS = 1 << 22
_LONGEST_RUN = (1 << 16) - 1  # rows
_NO_LIMIT = 1 << 62


def bytes_in_memory(
    shape: tuple[int, int], steps: Sequence[Step], image_max: int | None, *,
    canvas: Canvas = "crop", reading_bytes: int = 0,
) -> int:  # fmt: skip
    """Estimate the process memory while stages are applied to a map in memory."""
    products = sum(step.memory for step in steps)
    if canvas == "full":
        products *= 1 + _CANVAS_SHARE
    per_cell = _DEMANDS[engine.engine_name()].per_cell + _BYTES_PER_CELL_READ + products
    libraries = max((step.stage.of_library for step in steps), default=0)
    working = _base_bytes(shape, image_max) + libraries + int(per_cell * shape[0] * shape[1])
    working += _bytes_to_measure(shape) if steps else 0
    return max(working, bytes_to_read(reading_bytes))


def bytes_to_read(reading_bytes: int) -> int:
    """Estimate the process memory while reading a map; `reading_bytes` is what the reader needs."""
    return _DEMANDS[engine.engine_name()].base + reading_bytes


def _bytes_to_measure(shape: tuple[int, int]) -> int:
    is_long = arrays.dtype_of_squares(shape) is np.int64
    squares = _BYTES_PER_LONG_SQUARE * shape[0] * shape[1] if is_long else 0
    return squares + sources.bytes_of_lines(shape, _BYTES_PER_MEASURED_LINE)


def _base_bytes(shape: tuple[int, int], image_max: int | None) -> int:
    base = _DEMANDS[engine.engine_name()].base + sources.bytes_of_lines(shape, _BYTES_PER_LINE)
    if image_max is None:
        return base
    height, width = shape
    step = max(1, -(-max(shape) // image_max)) if image_max else 1
    return base + _DRAWING_LIBRARY + _BYTES_PER_PIXEL * -(-height // step) * -(-width // step)


@contextmanager
def opened_map(
    path: Path, steps: Sequence[Step], settings: Settings, *, image_max: int | None,
    with_sums: bool = False,
) -> Iterator[Source]:  # fmt: skip
    """Open a map for stages: in memory if it fits, else block by block."""
    with ExitStack() as stack:
        with sources.sums_of_reads(is_wanted=with_sums) as sums:
            file = stack.enter_context(opened_input(path, settings))
            source = _read(file, steps, image_max, settings.canvas)
        shape = source.grid.shape
        work = bytes_in_memory(shape, steps, image_max, canvas=settings.canvas) - bytes_to_read(0)
        cells = f"{shape[1]} x {shape[0]} cells"
        stack.enter_context(tables_claimed(lambda n: sources.claim(path, work + n, what=cells)))
        yield records.replace(source, sums=file.sums_by_name(sums) if with_sums else {})


def _read(file: MapFile, steps: Sequence[Step], image_max: int | None, canvas: Canvas) -> Source:
    limit = sources.current_budget().limit
    budget = _NO_LIMIT if limit is None else limit
    plan = _plan_memory(file, file.shape(), steps, budget, image_max, canvas)
    if plan.blocks is not None and file.shape_by_rows is not None:
        return file.by_rows(block_height=plan.blocks.height, budget=plan.blocks.cache)
    source = file.read()
    grid, box_bytes = source.grid, _bytes_of_box(source.grid)
    canvas = "full" if box_bytes else canvas  # products of the box are extended
    needed = bytes_in_memory(grid.shape, steps, image_max, canvas=canvas) + box_bytes
    if needed <= budget:
        return source
    if not isinstance(grid, OccupancyGrid):
        raise _too_large(file.path, grid.shape, needed, budget)
    values, shape = grid.occupancy, grid.shape
    base = _base_bytes(shape, image_max) + values.nbytes
    height, cache = _block_plan(file.path, shape, steps, budget, base, needed=needed)
    layer = lazy_layer(shape, np.int8, lambda k: values[k], block_height=height, budget=cache)
    return records.replace(source, grid=grid.with_values(layer))


class BlockPlan(NamedTuple):
    height: int  # rows of a block
    cache: CacheBudget  # for the blocks of layers


class MemoryPlan(NamedTuple):
    needed: int  # bytes of a map in memory
    blocks: BlockPlan | None = None  # if that exceeds the budget


def _plan_memory(
    file: MapFile, shape: tuple[int, int], steps: Sequence[Step], budget: int,
    image_max: int | None, canvas: Canvas,
) -> MemoryPlan:  # fmt: skip
    reading_bytes = file.memory_to_read()
    needed = bytes_in_memory(shape, steps, image_max, canvas=canvas, reading_bytes=reading_bytes)
    if needed <= budget:
        return MemoryPlan(needed)
    base = _base_bytes(shape, image_max)
    if file.shape_by_rows is None:  # the image is decoded as a whole, and its cells are kept
        if bytes_to_read(reading_bytes) > budget:
            raise _too_large(file.path, shape, bytes_to_read(reading_bytes), budget)
        base += shape[0] * shape[1]
    return MemoryPlan(needed, _block_plan(file.path, shape, steps, budget, base, needed=needed))


def check_fits(
    path: Path | str, shape: tuple[int, int], steps: Sequence[Step], image_max: int | None
) -> None:
    count = bytes_in_memory(shape, steps, image_max) - _DEMANDS[engine.engine_name()].base
    sources.claim(path, count, what=f"{shape[1]} x {shape[0]} cells")


def claim_work(path: Path | str, grid: Framed, per_cell: float, **options: Any) -> None:
    """Claim the memory of work on a grid, see `claiming_work`; by default it measures nothing."""
    with claiming_work(path, grid, per_cell, **{"measures": False, **options}):
        pass


def claiming_work(
    path: Path | str, grid: Framed, per_cell: float, *, cells: int | None = None,
    besides: int = 0, measures: bool = True,
) -> AbstractContextManager[None]:  # fmt: skip
    """Claim the memory of work on a grid while the context is open, with the tables it makes."""
    height, width = grid.shape
    working = int(per_cell * (height * width if cells is None else cells))
    if box_bytes := _bytes_of_box(grid):  # stages work on the box, then extend the product
        working = 2 * working + box_bytes
    working += sources.bytes_of_lines(grid.shape, _BYTES_PER_LINE)
    working += _bytes_to_measure(grid.shape) if measures else 0
    needed = bytes_of(grid) + working + besides
    return sources.claimed(path, needed, what=f"{width} x {height} cells")


def claim_step(path: Path, grid: npz.Grid, step: Step) -> None:
    if grid.is_lazy:
        return
    if step.stage.cells is None or not step.moves:
        claim_work(path, grid, step.memory, besides=step.stage.of_library, measures=True)
        return
    with errors_named(path):
        for count in step.stage.cells(grid, step.parameters):
            claim_work(path, grid, step.stage.memory, cells=count, measures=True)


def bytes_of(grid: Framed) -> int:
    return sum(int(getattr(grid, name).nbytes) for name in grid.layer_names)


def _bytes_of_box(grid: Framed) -> int:
    if not isinstance(grid, FieldGrid) or grid.region is None:
        return 0
    return bytes_of(grid) * grid.region.cells // (grid.shape[0] * grid.shape[1])


def need_of(
    file: MapFile, shape: tuple[int, int], steps: Sequence[Step], settings: Settings
) -> MemoryPlan:
    """Return the memory that a run will take; in blocks, layers are kept while there is room."""
    budget, image_max = memory_budget(settings.max_memory), settings.picture_size
    with use_threads(settings.threads):
        plan = _plan_memory(file, shape, steps, budget, image_max, settings.canvas)
    return plan if plan.blocks is None else plan._replace(needed=budget)


def memory_budget(max_memory: int | None, jobs: int = 1) -> int:
    if max_memory is not None:
        return max_memory
    limit = sources.default_limit(jobs)
    return _NO_LIMIT if limit is None else limit


def _block_plan(
    path: Path, shape: tuple[int, int], steps: Sequence[Step], budget: int, base: int, *,
    needed: int,
) -> BlockPlan:  # fmt: skip
    """Return blocks that fit the budget together with `base` and the layers cached of each."""
    if any(step.stage.is_whole(step.parameters) for step in steps):
        raise _too_large(path, shape, needed, budget)
    height, width = shape
    per_row = _DEMANDS[engine.engine_name()].per_block_cell * width * (thread_count() + 1)

    def height_limits(free_bytes: int) -> tuple[int, int]:
        """Return the fewest and most rows: blocks may take half of the bytes, runs a quarter."""
        fewest = -(-_RUN_BYTES_PER_COLUMN * width * height // max(free_bytes // 4, 1))
        return max(fewest, 1), free_bytes // 2 // per_row

    free_bytes = budget - base
    fewest, most = height_limits(free_bytes)
    while most < fewest:  # increase until blocks would fit: the error names that amount
        free_bytes = max(free_bytes + free_bytes // 50, per_row)
        fewest, most = height_limits(free_bytes)
    if free_bytes > budget - base:
        raise _too_large(path, shape, min(needed, int(1.01 * (base + free_bytes))), budget)
    rows = int(min(max(_BLOCK_CELLS // width, fewest), most, height, _LONGEST_RUN))
    run_bytes = _RUN_BYTES_PER_COLUMN * width * -(-height // rows)
    return BlockPlan(rows, CacheBudget(free_bytes - per_row * rows - run_bytes))


def _too_large(path: Path, shape: tuple[int, int], needed: int, budget: int) -> MalformedInputError:
    height, width = shape
    allowed = sources.current_budget()
    amounts = f"{sources.size_text(needed)} of memory, {sources.size_text(budget)} may be used"
    origin = allowed.origin if budget == allowed.limit else ""
    rule = f"{width} x {height} cells need {amounts}{origin}"
    hint = "raise --max-memory if there is more; binary .pgm maps take least"
    return MalformedInputError(rule, source=path, hint=hint)


@contextmanager
def opened_input(path: Path, settings: Settings) -> Iterator[MapFile]:
    opened = open_map(path, dialect=settings.dialect, max_cells=settings.max_cells)
    with settings.reading(), use_threads(settings.threads), opened as file:
        yield file


def read_input(path: Path, settings: Settings, *, with_sums: bool = False) -> Source:
    with sources.sums_of_reads(is_wanted=with_sums) as sums, opened_input(path, settings) as file:
        return records.replace(file.read(), sums=file.sums_by_name(sums) if with_sums else {})


def read_together(paths: Sequence[Path], settings: Settings) -> list[Source]:
    maps_read: list[Source] = []
    with settings.reading():
        for path in paths:
            with sources.holding(sum(bytes_of(source.grid) for source in maps_read)):
                maps_read.append(read_input(path, settings, with_sums=True))
    return maps_read


_ENDINGS_OF_FILES = (".yaml", ".yml", ".npz", ".pgm", ".pbm", ".png", ".html", ".json")
Map = str | PathLike[str] | npz.Grid


class Reading(TypedDict, total=False):
    dialect: dialects.Dialect
    max_cells: int | None
    max_memory: int | None


@records.dataclass(frozen=True, eq=False)
class MapInput(Source):
    """A map that a command works on; without files if it was given as a grid."""

    name: str = ""
    path: Path | None = None
    settings: Settings = DEFAULT_SETTINGS

    @property
    def title(self) -> str:
        return one_line(self.name if self.path is None else self.path.stem)

    @cached_property
    def occupancy(self) -> OccupancyGrid:
        return as_occupancy(self.grid, self.path or self.name)

    def document(self) -> dict[str, Any] | None:
        return None if self.path is None else {"file": str(self.path), "sha256": dict(self.sums)}


def map_input(source: Source, path: Path, settings: Settings) -> MapInput:
    return MapInput(**vars(source), name=str(path), path=path, settings=settings)


class Terminal(Protocol):
    """Output of a command in progress, see `mapdeal.cli.terminal`."""

    def detail(self, text: str) -> None: ...
    def remark(self, lines: Iterable[str]) -> None: ...
    def summary(self, lines: Iterable[str]) -> None: ...
    def result(self, text: str) -> None: ...
    def warn(self, text: str) -> None: ...
    def error(self, problem: MapdealError) -> None: ...
    def input_chunks(self) -> Iterator[bytes]: ...
    def few_warnings(self, hint: str) -> AbstractContextManager[Callable[[str], None]]: ...
    def counted(
        self, steps: int, noun: str | None = None
    ) -> AbstractContextManager[Callable[..., object]]: ...


class Work:
    current: ContextVar[Work | None] = ContextVar("work", default=None)

    def __init__(
        self, settings: Settings, outputs: Sequence[Path], stack: ExitStack, terminal: Terminal, *,
        as_json: bool = False,
    ) -> None:  # fmt: skip
        self.as_json = as_json
        self.settings, self.outputs, self.terminal = settings, list(outputs), terminal
        self.counted: ProgressCallback = terminal.counted
        self._stack = stack
        self._transaction: Transaction | None = None

    def begin(self, inputs: Sequence[Path] = ()) -> Transaction:
        """Check the outputs against the inputs before any work, once."""
        if self._transaction is None:
            transaction = outputs_of(self.outputs, inputs, self.settings)
            self._transaction = self._stack.enter_context(transaction)
        return self._transaction


InShell = Annotated[Work, command.OnlyInPython]  # which the shell passes to commands


def settings_of(**reading: Unpack[Reading]) -> Settings:
    work = Work.current.get()
    return Settings(**reading) if work is None else work.settings


def need_ending(ending: str) -> None:
    work = Work.current.get()
    for output in () if work is None else work.outputs:
        if output.suffix != ending:
            raise ParameterError(f"must end in {ending}", source="--output", got=str(output))


def need_folder(output: Path) -> None:
    if output.suffix.lower() in _ENDINGS_OF_FILES and not sources.exists(output):
        rule, hint = "must be a folder, not a file", f"such as {output.with_suffix('')}"
        raise ParameterError(rule, source="--output", got=str(output), hint=hint)


def text_in(path: str | PathLike[str]) -> tuple[Iterable[bytes], Path | str]:
    """Return the chunks of a text file, in the shell for ``-`` of standard input, and its name."""
    work, path = Work.current.get(), Path(path)
    if work is None or path != Path("-"):
        return sources.chunks_of(path), path
    return work.terminal.input_chunks(), "standard input"


def open_inputs(
    *maps: Map, names: Sequence[str], also: Sequence[Path] = (), **reading: Unpack[Reading]
) -> list[MapInput]:
    work, settings = Work.current.get(), settings_of(**reading)
    for source, name in zip(maps, names, strict=True):
        if not isinstance(source, str | PathLike | npz.Grid):
            hint = command.grid_hint(source)
            raise ParameterError("must be a file or a grid", place=name, got=source, hint=hint)
    paths = [Path(source) for source in maps if isinstance(source, str | PathLike)]
    files_read = map(map_input, read_together(paths, settings), paths, repeat(settings))
    opened = [
        MapInput(source, (), name=name, settings=settings) if isinstance(source, npz.Grid)
        else next(files_read) for source, name in zip(maps, names, strict=True)
    ]  # fmt: skip
    if work is not None:
        work.begin([*(file for source in opened for file in source.files), *also])
    return opened


AnyMask = TypeVar("AnyMask")  # a keepout mask, its grid or its file


@records.dataclass(frozen=True, eq=False)
class KeepoutMask:
    grid: OccupancyGrid
    path: Path | str = "the mask"
    files: tuple[Path, ...] = ()
    sums: Mapping[str, str] = records.field(default_factory=dict)

    def document(self) -> dict[str, Any] | None:
        return {"file": str(self.path), "sha256": dict(self.sums)} if self.files else None

    def over(self, costs: Costmap) -> Costmap:
        with errors_named(self.path):
            return apply_keepout_mask(costs, self.grid)

    def costs_of(self, step: Step, grid: npz.Grid, path: Path | None) -> tuple[Costmap, Costmap]:
        """Return the costs that a step makes of a grid without the mask, and those with it."""
        unmasked = cast("Costmap", step.apply(grid, path))
        if not step.accepts_mask:
            return unmasked, self.over(unmasked)
        masked = cast("Costmap", step.apply(grid, path, mask=self.grid))
        if all((masked.cost[rows] == unmasked.cost[rows]).all() for rows in swept(masked.cost)):
            emit_warning(f"{self.path}: the mask changes no cost")
        return unmasked, masked


def used_mask(mask: AnyMask, robot: RobotParameters | None) -> AnyMask | None:
    if robot is None or mask is None or robot.why_mask_unused is None:
        return mask
    emit_warning(f"the keepout mask has no effect: {robot.why_mask_unused} (params.mask-unused)")
    return None


def mask_of(mask: Map | None, settings: Settings, *beside: Framed) -> KeepoutMask | None:
    if mask is None:
        return None
    if not isinstance(mask, str | PathLike):
        return KeepoutMask(as_occupancy(mask, "the mask"))
    path = Path(mask)
    taken_bytes = sum(bytes_of(grid) for grid in beside if not grid.is_lazy)
    with settings.reading(), sources.holding(taken_bytes):
        source = read_input(path, settings, with_sums=True)
    return KeepoutMask(as_occupancy(source.grid, path), path, source.files, source.sums)


def refuse(rule: str, hint: str | None = None, /, **values: object) -> None:
    for name, value in values.items():
        if value is not None and value is not False and value != ():
            raise ParameterError(rule, place=name, hint=hint)


def pop_parameters(values: dict[str, Any], kind: Any) -> dict[str, Any]:
    return {name: values.pop(name) for name in command.parameters_of(kind) if name in values}


def transform_of(value: object, *, place: str | None = None) -> Transform | None:
    if value is None or isinstance(value, Transform):
        return value
    rule = "must be a transform, or three numbers x, y, yaw"
    return Transform(*numbers_of(value, "X,Y,YAW", place=place, rule=rule, finite=False))


def numbers_of(
    value: Any, form: str, *, place: str | None = None, rule: str | None = None,
    finite: bool = True,
) -> tuple[float, ...]:  # fmt: skip
    """Return numbers that may be given as text, as many as a form such as ``X,Y`` has."""
    count = form.count(",") + 1
    try:
        if isinstance(value, str) and not command.is_plain(value):
            raise ValueError
        numbers = tuple(map(float, value.split(",") if isinstance(value, str) else value))
        if len(numbers) != count:
            raise ValueError
    except (TypeError, ValueError):
        rule = rule or f"must be {'three' if count > 2 else 'two'} numbers {form}"
        raise ParameterError(rule, place=place, got=value) from None
    if finite and not all(map(math.isfinite, numbers)):
        raise ParameterError("must be finite", place=place, got=value)
    return numbers


def claim_cells(map_read: MapInput, per_cell: float, *, measures: bool = False) -> None:
    with map_read.settings.reading():
        claim_work(map_read.name, map_read.grid, per_cell, measures=measures)


def claim_for(maps: Sequence[MapInput], count: int, purpose: str, *, of_picture: int = 0) -> None:
    settings = maps[0].settings
    if settings.image is not None:
        count = max(count, of_picture)
    held_bytes = sum(bytes_of(map_read.grid) for map_read in maps)
    with settings.reading():
        sources.claim(maps[-1].name, held_bytes + count, what=purpose)


@contextmanager
def outputs_of(
    outputs: Sequence[Path], inputs: Sequence[Path], settings: Settings, *,
    curve: Path | None = None,
) -> Iterator[Transaction]:  # fmt: skip
    """Write `outputs`, the picture, and that of a cost curve together, or not at all."""
    all_outputs = list(outputs)
    for option, picture in (("--image", settings.image), ("--curve", curve)):
        if picture is None:
            continue
        if picture.suffix != ".png":
            raise ParameterError("a picture must end in .png", place=option, got=str(picture))
        if picture in all_outputs:
            raise ParameterError("is an output already", place=option, got=str(picture))
        all_outputs.append(picture)
        with settings.reading():
            sources.claim(picture, _DRAWING_LIBRARY, what="pictures")
    with (
        use_threads(settings.threads),
        Transaction(all_outputs, inputs=inputs, force=settings.force) as transaction,
    ):
        yield transaction


def warn_of_potential(map_read: MapInput) -> None:
    if isinstance(map_read.grid, PotentialField):
        text = f"{map_read.name}: is a potential field; its map is used, its goal and gains are not"
        emit_warning(text)


def warn_of_robot(name: Path | str, grid: Framed, *robots: RobotParameters) -> None:
    """Warn of what robots' costmaps ignore: the yaw of a map, and which cells are unknown."""
    if grid.origin[2]:
        text = "the robot's costmap ignores the yaw of the map, so places on it differ"
        emit_warning(f"{name}: {text}; rotate --yaw 0 turns the cells instead")
    if isinstance(grid, OccupancyGrid) and any(robot.frees_unknown for robot in robots):
        unknown = int(counts_of(grid.occupancy)[UNKNOWN])
        if unknown:
            share = f"{100 * unknown / math.prod(grid.shape):.3g} % of the map"
            text = f"{name}: the robot's costmap treats unknown cells as free, {share}: the robot"
            emit_warning(f"{text} drives through; track_unknown_space: true closes them")


def warn_of_values(map_read: MapInput) -> None:
    """Warn if values of a map are ignored: published costs, or a potential's goal and gains."""
    grid, metadata = map_read.grid, map_read.metadata
    is_view = isinstance(grid, FieldView)  # views of fields are warned of or refused elsewhere
    if isinstance(grid, OccupancyGrid) and metadata and metadata.mode == "raw" and not is_view:
        between = lookup.histogram(grid.occupancy)[FREE + 1 : OCCUPIED].sum()
        if between:
            text = f"{map_read.name}: {between} cells of 1..99 are not obstacles"
            emit_warning(f"{text}; costs are read from an npz")
    warn_of_potential(map_read)


@contextmanager
def errors_named(path: Path | str) -> Iterator[None]:
    """Add the file of the grid to errors that do not name a file already."""
    try:
        yield
    except MapdealError as error:
        raise error.found_in(path) from None
