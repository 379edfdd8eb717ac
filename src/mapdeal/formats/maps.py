"""Reading and writing a grid by its file's name: a map_server pair or an npz."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, MapdealWarning, ParameterError
from mapdeal.formats.image import read_image_size
from mapdeal.formats.map_server import find_image, read_pair
from mapdeal.formats.map_writer import Encoding, pair_paths, write_pair
from mapdeal.formats.map_yaml import Dialect, MapMetadata, Mode, read_metadata
from mapdeal.formats.npz import AnyGrid, Grid, npz_size, read_npz, write_npz
from mapdeal.formats.source import exists, status_of
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.large import LargeField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField

_IMAGE_SUFFIXES = (".pgm", ".pbm", ".ppm", ".pnm", ".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")


@dataclass(frozen=True)
class Source:
    """A grid that was read, and where it came from.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        The cells.
    files : tuple of Path
        All files that were read, the named one first.
    metadata : MapMetadata, optional
        What the YAML file said, if there is one.
    """

    grid: Grid
    files: tuple[Path, ...]
    metadata: MapMetadata | None = field(default=None)


def read_source(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> Source:  # fmt: skip
    """Return the grid in a ``.yaml`` pair or an ``.npz``, with the files it came from.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If a file is malformed, or not of these two kinds.
    """
    if path.suffix.lower() == ".npz":
        return Source(read_npz(path, max_cells=max_cells), (path,))
    _refuse_image(path)
    pair = read_pair(path, dialect=dialect, max_cells=max_cells)
    return Source(pair.grid, pair.files, pair.metadata)


@dataclass(frozen=True)
class SourceHeader:
    """What is known of a map before its cells are read.

    Parameters
    ----------
    height, width : int
        Cells.
    files : tuple of Path
        All files that hold it, the named one first.
    """

    height: int
    width: int
    files: tuple[Path, ...]


def read_header(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> SourceHeader:  # fmt: skip
    """Return size and files of what `read_source` would read, from headers alone.

    Raises
    ------
    FileAccessError, MalformedInputError
        As `read_source`, as far as headers tell.
    """
    if path.suffix.lower() == ".npz":
        return SourceHeader(*npz_size(path), (path,))
    _refuse_image(path)
    image = find_image(path, read_metadata(path, dialect=dialect).image)
    return SourceHeader(*read_image_size(image, max_cells=max_cells), (path, image))


def _refuse_image(path: Path) -> None:
    if path.suffix.lower() in _IMAGE_SUFFIXES:
        sibling = path.with_suffix(".yaml")
        hint = f"pass {sibling}" if exists(sibling) else "pass the .yaml that names the image"
        status_of(path)
        raise MalformedInputError("looks like an image, not a map's YAML", source=path, hint=hint)


def as_occupancy(grid: Grid, what: str = "the input") -> OccupancyGrid:
    """Return the map in a grid: a field's own, a costmap's as ROS would publish it."""
    if isinstance(grid, (DistanceField, PotentialField)):
        return grid.grid
    if isinstance(grid, Costmap):
        text = f"{what} holds costs; taken as the occupancy that ROS would publish for them"
        warnings.warn(text, MapdealWarning, stacklevel=2)
        return grid.to_occupancy()
    return grid


def read_map(
    path: Path | str, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> Grid:  # fmt: skip
    """Read a map.

    Parameters
    ----------
    path : path or str
        A map_server ``.yaml``, or an ``.npz`` that mapdeal wrote.
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading of the image to follow: Nav2 from jazzy on, Nav2 humble, or ROS 1.
    max_cells : int, optional
        Cells up to which a file is read; by default 2e8 for compressed images, 1e9 for others.

    Returns
    -------
    OccupancyGrid, Costmap, DistanceField or PotentialField
        An occupancy grid for every ordinary map; what the file holds for an npz, or for a YAML
        with ``cost_scale``.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If a file is malformed.

    Warns
    -----
    MapdealWarning
        For each choice that had to be made, such as a missing key.
    """
    return read_source(Path(path), dialect=dialect, max_cells=max_cells).grid


def output_paths(output: Path) -> tuple[Path, ...]:
    """Return the files that writing a grid to `output` makes.

    Raises
    ------
    ParameterError
        If its ending is none that mapdeal writes.
    """
    if output.suffix == ".npz":
        return (output,)
    if output.suffix in (".yaml", ".yml", ".pgm", ".png"):
        return pair_paths(output)
    rule = "an output must end in .yaml, .npz, .pgm or .png"
    raise ParameterError(rule, source=output, got=output.suffix)


def write_grid(
    transaction: Transaction,
    output: Path,
    grid: AnyGrid,
    *,
    mode: Mode | None = None,
    encoding: Encoding = "occupancy",
    extra: dict[str, Any] | None = None,
    more: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write a grid to `output` as its ending says; a field and `more` layers only fit an npz."""
    if output.suffix == ".npz":
        if mode is not None:
            raise ParameterError("an npz has no mode", place="mode", got=mode)
        transaction.write(output, lambda file: write_npz(file, grid, more=more))
        return
    if isinstance(grid, (DistanceField, LargeField, PotentialField)):
        what = "a potential" if isinstance(grid, PotentialField) else "a distance"
        raise ParameterError(f"{what} field is written as npz", source=output)
    write_pair(transaction, output, grid, mode=mode, encoding=encoding, extra=extra)


def write_map(
    path: Path | str,
    grid: Grid,
    *,
    mode: Mode | None = None,
    encoding: Encoding = "occupancy",
    force: bool = False,
) -> None:
    """Write a map, costmap or field.

    Parameters
    ----------
    path : path or str
        ``.yaml`` or ``.pgm`` for a pgm pair, ``.png`` for a png pair, ``.npz`` for every layer
        exactly. Folders that are missing are made.
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        The cells; a field only fits an npz.
    mode : {'trinary', 'scale', 'raw'}, optional
        How values become pixels; raw if any lies in 1..99, else trinary.
    encoding : {'occupancy', 'costmap2d'}
        What pixels of costs hold.
    force : bool
        Whether to replace files that exist.

    Raises
    ------
    FileAccessError
        If a file exists already or cannot be written; nothing is changed then.
    """
    output = Path(path)
    with Transaction(output_paths(output), force=force) as transaction:
        write_grid(transaction, output, grid, mode=mode, encoding=encoding)
