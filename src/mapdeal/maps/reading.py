"""Reading and writing a grid by its file's name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, get_args, overload

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.source import status_of, use_memory
from mapdeal.files.transaction import Transaction
from mapdeal.grid import costmap, field, occupancy, reach, values
from mapdeal.kernels.arrays import Array
from mapdeal.maps import formats, kinds
from mapdeal.maps.dialects import Dialect, Mode
from mapdeal.maps.map_file import Grid, MapFile, Painting, Source
from mapdeal.maps.map_server import Encoding

__all__ = ["MapFile", "Source"]  # of use to all who read maps

GridType = TypeVar("GridType", bound=Grid)


@contextmanager
def open_map(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> Iterator[MapFile]:
    """Open a map: its header is read, its cells are not."""
    map_format = formats.format_of(path)
    header = map_format.header(path)
    status_of(header)  # a file that is missing is no file of another kind
    with ExitStack() as opened:
        with kinds.recognised(header, "a map", kinds.MAP):
            file = map_format.open(path, opened, dialect, max_cells)
        yield file


def read_source(path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None) -> Source:
    with open_map(path, dialect=dialect, max_cells=max_cells) as file:
        return file.read()


def as_occupancy(grid: Grid, source: Path | str) -> occupancy.OccupancyGrid:
    """Return the occupancy of a grid: a field's own map, or costs as ROS would publish them."""
    if isinstance(grid, (field.DistanceField, field.PotentialField, reach.Reach)):
        return grid.grid
    if isinstance(grid, costmap.Costmap):
        text = f"{source}: contains costs; read as the occupancy that ROS would publish for them"
        emit_warning(text)
        return grid.to_occupancy()
    if isinstance(grid, field.FieldView):
        text = f"{source}: is the 0..100 view of a distance field; its values are read as a map's"
        emit_warning(text)
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
    >>> from mapdeal import OccupancyGrid
    >>> read_map("examples/maps/office.yaml", OccupancyGrid).shape
    (544, 544)
    """
    values.check_choice(dialect, Dialect, "dialect")
    with use_memory(max_memory):
        grid = read_source(Path(path), dialect=dialect, max_cells=max_cells).grid
    if kind is not None and not isinstance(grid, kind):
        rule = f"must hold a grid of type {kind.__name__}"
        raise ParameterError(rule, source=Path(path), got=type(grid).__name__)
    return grid


def output_paths(output: Path, more: Sequence[str] = ()) -> tuple[Path, ...]:
    return formats.output_format(output, more).paths(output)


def write_grid(
    transaction: Transaction, output: Path, grid: Grid, *, mode: Mode | None = None,
    encoding: Encoding = "occupancy", extra: dict[str, Any] | None = None,
    more: Mapping[str, Array] | None = None, painted: Painting | None = None,
) -> None:  # fmt: skip
    """Write a grid in the format of the output's ending; fields and `more` layers need an npz."""
    # An image is `painted`, if the grid has been read from that.
    map_format = formats.output_format(output)
    if mode is not None and not map_format.images:
        raise ParameterError(f"an {output.suffix[1:]} has no mode", place="mode", got=mode)
    if not map_format.can_hold(type(grid)) or map_format.write is None:
        raise ParameterError(f"a {grid.kind} is written as npz", source=output)
    map_format.write(
        transaction, output, grid, mode=mode, encoding=encoding, extra=extra, more=more,
        painted=painted,
    )  # fmt: skip


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
        If a file exists and `force` is not set, or cannot be written; nothing is changed then.
    ParameterError
        If the suffix, mode or encoding is unknown or does not fit the grid.
    """
    if mode is not None:
        values.check_choice(mode, Mode, "mode")
    values.check_choice(encoding, Encoding, "encoding")
    output = Path(path)
    if not isinstance(grid, get_args(Grid)):
        raise ParameterError("must be a grid", place="grid", got=grid)
    with Transaction(output_paths(output), force=force) as transaction:
        write_grid(transaction, output, grid, mode=mode, encoding=encoding)
