"""Reading and writing a grid by its file's name: a map_server pair or an npz."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, get_args, overload

from numpy.typing import NDArray

from mapdeal.errors import (
    MalformedInputError,
    MapdealError,
    MapdealWarning,
    ParameterError,
    capture_warnings,
    emit_warning,
)
from mapdeal.files.source import (
    BIT_MAP,
    YAML,
    FileState,
    check_state,
    exists,
    sha256_of,
    state_of,
    status_of,
    use_memory,
    yaml_at,
)
from mapdeal.files.transaction import Transaction, locked
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, FieldView, PotentialField
from mapdeal.grid.frame import Frame, Origin
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.values import check_choice
from mapdeal.inputs.kinds import MAP, recognised
from mapdeal.kernels.blocks import CacheBudget, activity
from mapdeal.maps import map_server
from mapdeal.maps.dialects import Dialect, MapMetadata, Mode, read_metadata
from mapdeal.maps.images import IMAGE_SUFFIXES, BinaryRows, PnmImage, open_image
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.npz import Grid, holds_reach, npz_frame, npz_memory, read_npz, write_npz
from mapdeal.maps.picture import OpenImage

GridType = TypeVar("GridType", bound=Grid)


@dataclass(frozen=True)
class Source:
    """A grid that was read, and where it came from."""

    grid: Grid
    files: tuple[Path, ...]
    metadata: MapMetadata | None = None
    sums: Mapping[str, str] = field(default_factory=dict)


class MapFile:
    """An open map, whose cells can be read all at once or by rows."""

    def __init__(
        self, files: Mapping[Path, FileState], opened: ExitStack, *, dialect: Dialect = "nav2",
        max_cells: int | None = None, metadata: MapMetadata | None = None,
    ) -> None:  # fmt: skip
        self.files = tuple(files)
        self.path = self.files[0]
        self.metadata = metadata
        self._states = files
        self._opened = opened
        self._dialect: Dialect = dialect
        self._max_cells = max_cells

    @cached_property
    def _image(self) -> OpenImage:
        return self._opened.enter_context(open_image(self.files[-1], max_cells=self._max_cells))

    @cached_property
    def _rows(self) -> BinaryRows | None:
        if self.metadata is None or self.metadata.cost_scale is not None:
            return None
        # Faults of the image are reported when the map is read.
        with capture_warnings() as self._remarks, suppress(MapdealError):
            if isinstance(self._image, PnmImage):
                return self._image.rows()
        return None

    @property
    def shape_by_rows(self) -> tuple[int, int] | None:
        """Rows and columns, if the map can be read by rows."""
        return None if self._rows is None else self._rows.shape

    def memory_to_read(self) -> int:
        """Return the peak memory of `read` in bytes, estimated from the headers."""
        return npz_memory(self.path) if self.metadata is None else self._image.memory()

    def shape(self) -> tuple[int, int]:
        return npz_frame(self.path).shape if self.metadata is None else self._image.shape

    def frame(self) -> Frame:
        if self.metadata is None:
            return npz_frame(self.path)
        return Frame(*self.shape(), self.metadata.resolution, self.metadata.origin)

    def read(self) -> Source:
        with activity(f"reading {self.path.name}"):
            return self._source_of(self._grid())

    def _grid(self) -> Grid:
        if self.metadata is None:
            grid: Grid = read_npz(self.path, max_cells=self._max_cells)
            if type(grid) is OccupancyGrid and holds_reach(self.path):
                text = "is a result of reach; only its map is used"
                emit_warning(f"{self.path}: {text}", stacklevel=2)
        else:
            grid = map_server.read_cells(self.path, self.metadata, self._image, self._dialect)
        self.check_unchanged()
        return grid

    def by_rows(self, *, block_height: int, budget: CacheBudget | None = None) -> Source:
        """Return the map with rows that are read on demand, which needs `shape_by_rows`."""
        self.check_unchanged()
        rows, metadata = self._rows, self.metadata
        if rows is None or metadata is None:
            raise ValueError(f"{self.path} cannot be read by rows")
        self._image.check_limit()
        for remark in self._remarks:
            emit_warning(remark, stacklevel=2)
        grid = map_server.lazy_cells(
            metadata, rows, block_height=block_height, budget=budget, dialect=self._dialect
        )
        map_server.check_rows(self.path, metadata, rows, self._dialect)
        return self._source_of(grid)

    def _source_of(self, grid: Grid) -> Source:
        if isinstance(grid, Costmap):
            map_server.warn_if_uniform(self.path, grid)
        elif isinstance(grid, OccupancyGrid):
            map_server.warn_of_nothing_known(self.path, grid.occupancy)
        return Source(grid, self.files, self.metadata)

    def sums_by_name(self, known_sums: Mapping[Path, str]) -> dict[str, str]:
        """Return the sha256 of each file by name: a known one, or that of the file as it is now."""
        sums = {path.name: known_sums.get(path) or self._sum_of(path) for path in self.files}
        self.check_unchanged()
        return sums

    def _sum_of(self, path: Path) -> str:
        return sha256_of(path) if path == self.path else self._image.file.sha256()

    def check_unchanged(self) -> None:
        """Refuse files that were replaced or changed since their headers were read."""
        # Another process may have replaced the image and the YAML file between our two reads.
        with locked({path.parent for path in self.files}):
            pass  # wait until a concurrent writer has renamed both files
        for path, state in self._states.items():
            check_state(path, state)


_bare_images: ContextVar[tuple[float, Origin] | None] = ContextVar("bare_images", default=None)


@contextmanager
def bare_images(resolution: float, origin: Origin) -> Iterator[None]:
    """Read images named in place of a YAML file as maps, with the usual thresholds."""
    token = _bare_images.set((resolution, origin))
    try:
        yield
    finally:
        _bare_images.reset(token)


def is_bare_image(path: Path) -> bool:
    """Return whether a file is an image that is read as a map without a YAML file."""
    return _bare_images.get() is not None and path.suffix.lower() in IMAGE_SUFFIXES


def bare_image(path: Path) -> MapMetadata | None:
    """Return the metadata of an image that is read without a YAML file; None for other files."""
    plain_image = _bare_images.get()
    if plain_image is None or not is_bare_image(path):
        return None
    if yaml_at(path):
        text = "is read with --resolution; the .yaml beside it is ignored"
        emit_warning(MapdealWarning(f"{path}: {text}", "image.yaml-not-read"), stacklevel=4)
    return MapMetadata(path.name, *plain_image)


@contextmanager
def open_map(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> Iterator[MapFile]:
    """Open the map in a ``.yaml`` pair or an ``.npz``: its header is read, its cells are not."""
    # A ``.pbm`` stands for the ``.yaml`` beside it.
    with ExitStack() as opened:
        if path.suffix.lower() == ".npz":
            yield MapFile({path: state_of(path)}, opened, max_cells=max_cells)
            return
        bits = path if path.suffix.lower() == BIT_MAP else None
        if bits is None and (metadata := bare_image(path)) is not None:
            states = {path: state_of(path)}
            yield MapFile(states, opened, dialect=dialect, max_cells=max_cells, metadata=metadata)
            return
        if bits is None:
            _refuse_image(path)
        else:
            path = map_server.yaml_beside(bits)
        states = {path: state_of(path)}
        with recognised(path, "a map", MAP):
            metadata = read_metadata(path, dialect=dialect)
        if bits is None:
            image = map_server.find_image(path, metadata.image)
        else:
            image = map_server.find_bits(bits, path, metadata)
        states[image] = state_of(image)
        yield MapFile(states, opened, dialect=dialect, max_cells=max_cells, metadata=metadata)


def read_source(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> Source:  # fmt: skip
    """Return the grid in a ``.yaml`` pair or an ``.npz``, with the files it came from."""
    with open_map(path, dialect=dialect, max_cells=max_cells) as file:
        return file.read()


def _refuse_image(path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix in IMAGE_SUFFIXES:
        sibling = path.with_suffix(".yaml")
        hint = "pass its .yaml, or --resolution R to read the image without one"
        hint = f"pass {sibling}" if exists(sibling) else hint
        status_of(path)
        raise MalformedInputError("looks like an image, not a map's YAML", source=path, hint=hint)


def as_occupancy(grid: Grid, source: Path | str) -> OccupancyGrid:
    """Return the occupancy of a grid: a field's own map, or costs as ROS would publish them."""
    if isinstance(grid, (DistanceField, PotentialField, Reach)):
        return grid.grid
    if isinstance(grid, Costmap):
        text = f"{source}: contains costs; read as the occupancy that ROS would publish for them"
        emit_warning(text, stacklevel=2)
        return grid.to_occupancy()
    if isinstance(grid, FieldView):
        text = f"{source}: is the 0..100 view of a distance field; its values are read as a map's"
        emit_warning(text, stacklevel=2)
        return grid.as_map()
    return grid


@overload
def read_map(
    path: str | PathLike[str], kind: type[GridType], *, dialect: Dialect = "nav2",
    max_cells: int | None = None, max_memory: int | None = None,
) -> GridType: ...  # fmt: skip
@overload
def read_map(
    path: str | PathLike[str], kind: None = None, *, dialect: Dialect = "nav2",
    max_cells: int | None = None, max_memory: int | None = None,
) -> Any: ...  # fmt: skip
def read_map(
    path: str | PathLike[str], kind: type[Any] | None = None, *, dialect: Dialect = "nav2",
    max_cells: int | None = None, max_memory: int | None = None,
) -> Any:  # fmt: skip
    """Read a map.

    Parameters
    ----------
    path : path or str
        A map_server ``.yaml`` file, a ``.pbm`` file with its ``.yaml`` next to it, or an ``.npz``
        file written by mapdeal.
    kind : type, optional
        Type of grid that is expected, such as ``mapdeal.Costmap``: any other is an error, and type
        checkers know the result.
    dialect : {'nav2', 'humble', 'ros1'}
        map_server whose reading of the image to follow: Nav2 since Jazzy, Nav2 Humble, or ROS 1.
    max_cells : int, optional
        Largest number of cells to read; by default 2e8 for compressed images, 1e9 for others.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    OccupancyGrid, Costmap, DistanceField or PotentialField
        An occupancy grid for every ordinary map; the type of the saved grid for an npz file, or a
        costmap for a YAML file with ``cost_scale``.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If a file is malformed.
    ParameterError
        If the dialect is unknown, or the file holds another kind of grid than expected.

    Warns
    -----
    MapdealWarning
        For each assumption that had to be made, such as a default for a missing key.

    Examples
    --------
    >>> read_map("examples/maps/office.yaml", OccupancyGrid).shape
    (544, 544)
    """
    check_choice(dialect, Dialect, "dialect")
    with use_memory(max_memory):
        grid = read_source(Path(path), dialect=dialect, max_cells=max_cells).grid
    if kind is not None and not isinstance(grid, kind):
        rule = f"must hold a grid of type {kind.__name__}"
        raise ParameterError(rule, source=Path(path), got=type(grid).__name__)
    return grid


def output_paths(output: Path, more: Sequence[str] = ()) -> tuple[Path, ...]:
    """Return the files that a map becomes; errors also list `more` endings of the command."""
    if output.suffix == ".npz":
        return (output,)
    if output.suffix in (*YAML, ".pgm", ".png"):
        return map_server.pair_paths(output)
    *first, last = (".yaml", ".npz", ".pgm", ".png", *more)
    rule = f"an output must end in {', '.join(first)} or {last}"
    hint = "mapdeal pack makes a bit map of a map" if output.suffix == BIT_MAP else None
    raise ParameterError(rule, source=output, hint=hint)


def write_grid(
    transaction: Transaction, output: Path, grid: Grid, *, mode: Mode | None = None,
    encoding: Encoding = "occupancy", extra: dict[str, Any] | None = None,
    more: Mapping[str, NDArray[Any]] | None = None,
) -> None:  # fmt: skip
    """Write a grid in the format of the output's ending; fields and `more` layers need an npz."""
    if output.suffix == ".npz":
        if mode is not None:
            raise ParameterError("an npz has no mode", place="mode", got=mode)
        transaction.write(output, lambda file: write_npz(file, grid, more=more))
        return
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        raise ParameterError(f"a {grid.kind} is written as npz", source=output)
    map_server.write_pair(transaction, output, grid, mode=mode, encoding=encoding, extra=extra)


def write_map(
    path: Path | str, grid: Grid, *, mode: Mode | None = None, encoding: Encoding = "occupancy",
    force: bool = False,
) -> None:  # fmt: skip
    """Write a map, costmap or field.

    Parameters
    ----------
    path : path or str
        ``.yaml`` or ``.pgm`` for a PGM pair, ``.png`` for a PNG pair, or ``.npz`` for all layers
        without loss. Missing folders are created.
    grid : OccupancyGrid, Costmap, DistanceField, PotentialField or Reach
        Grid to write; fields and results of reach can only be written to an npz file.
    mode : {'trinary', 'scale', 'raw'}, optional
        How values become pixels; by default ``raw`` if any value lies in 1..99, else ``trinary``.
    encoding : {'occupancy', 'costmap2d'}
        Scale of the costs in the pixels of a costmap.
    force : bool
        Whether to replace existing files.

    Raises
    ------
    FileAccessError
        If a file exists and `force` is not set, or a file cannot be written; nothing is changed
        then.
    ParameterError
        If the suffix, mode or encoding is unknown or does not fit the grid.
    """
    if mode is not None:
        check_choice(mode, Mode, "mode")
    check_choice(encoding, Encoding, "encoding")
    if not isinstance(grid, get_args(Grid)):
        raise ParameterError("must be a grid", place="grid", got=grid)
    output = Path(path)
    with Transaction(output_paths(output), force=force) as transaction:
        write_grid(transaction, output, grid, mode=mode, encoding=encoding)
