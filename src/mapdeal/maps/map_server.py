"""A map_server pair, yaml and image: the place where rows are flipped."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path, PureWindowsPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealWarning,
    ParameterError,
    emit_warning,
)
from mapdeal.files.budget import use_memory
from mapdeal.files.source import (
    BIT_MAP,
    YAML,
    contents_of,
    exists,
    is_same_file,
    read_file,
    status_of,
    yaml_at,
)
from mapdeal.files.transaction import RowsWriter, Transaction, Writer
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import FieldView
from mapdeal.grid.framed import Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, CostScale, occupancy_from_cost
from mapdeal.kernels.blocks import (
    CacheBudget,
    Layer,
    counts_of,
    is_lazy,
    lazy_layer,
    looked_up,
    mapped,
)
from mapdeal.kernels.lookup import look_up
from mapdeal.maps.dialects import cells_of
from mapdeal.maps.images import open_strips
from mapdeal.maps.map_yaml import Dialect, MapMetadata, Mode, read_metadata, yaml_of
from mapdeal.maps.picture import LARGEST_CELLS, Picture
from mapdeal.maps.png import write_grey_png, write_rgba_png
from mapdeal.maps.pnm import BinaryRows, begin_pgm, decode_pbm, write_pbm
from mapdeal.maps.remarks import PixelRemarks


def read_cells(
    yaml_path: Path, metadata: MapMetadata, image_path: Path, *, dialect: Dialect = "nav2",
    max_cells: int | None = None,
) -> OccupancyGrid | Costmap:  # fmt: skip
    with open_strips(image_path, max_cells=max_cells) as strips:
        if metadata.cost_scale is not None:
            cost = np.empty(strips.shape, dtype=np.uint8)
            for rows, picture in strips.placed():
                cost[rows] = costs_of(picture, image_path)[::-1]
            return Costmap(cost, metadata.resolution, metadata.origin)
        occupancy = np.empty(strips.shape, dtype=np.int8)
        remarks = PixelRemarks(metadata, dialect)
        for rows, picture in strips.placed():
            cells_of(picture, metadata, dialect, out=occupancy[rows])
            remarks.add(picture, occupancy[rows])
    remarks.warn(yaml_path, image_path)
    return _grid_of(occupancy, metadata)


def lazy_cells(
    metadata: MapMetadata, pixels: BinaryRows, *, block_height: int,
    budget: CacheBudget | None = None, dialect: Dialect = "nav2",
) -> OccupancyGrid:  # fmt: skip
    """Return the map in an image whose rows are read when they are asked for."""
    # It gives, cell by cell, what `read_cells` gives.

    def occupancy(rows: slice) -> NDArray[np.int8]:
        part = pixels.part(rows)
        cells = np.empty(part.shape, dtype=np.int8)
        for where, picture in part.placed():
            cells_of(picture, metadata, dialect, out=cells[where])
        return cells

    layer = lazy_layer(
        pixels.shape, np.int8, occupancy, block_height=block_height, budget=budget
    )  # fmt: skip
    return _grid_of(layer, metadata)


def check_rows(
    yaml_path: Path, metadata: MapMetadata, pixels: BinaryRows, dialect: Dialect = "nav2"
) -> None:
    """Go through an image that is read by rows for pixels that `read_cells` warns of."""
    remarks = PixelRemarks(metadata, dialect)
    for _, picture in pixels.strips().placed():
        if not remarks.are_possible(picture):
            break
        remarks.add(picture, cells_of(picture, metadata, dialect))
    remarks.warn(yaml_path, pixels.image)


def _grid_of(occupancy: Layer, metadata: MapMetadata) -> OccupancyGrid:
    """Return the map of some values, or the view of a field if the YAML file calls them one."""
    if metadata.view is not None:
        return FieldView(occupancy, metadata.resolution, metadata.origin, metadata.view)
    return OccupancyGrid(occupancy, metadata.resolution, metadata.origin)


def find_image(yaml_path: Path, image: str) -> Path:
    """Return the image file that a map's YAML names."""
    # Relative names are relative to the YAML file. A name that only makes sense elsewhere, an
    # absolute path of another machine or one with backslashes, falls back to what it must mean
    # here, with a warning.
    if _expanded(image) != image:
        _warn_path(yaml_path, f"{image} was expanded; map_server does not")
    path, *others = image_places(yaml_path.parent, image)
    if exists(path):
        return path
    for other in others:
        if exists(other):
            _warn_path(yaml_path, f"{image} does not exist here; using {other}")
            return other
    hint = _nearest_name(path)
    raise FileAccessError(
        "the image does not exist", source=yaml_path, place="image", got=image, hint=hint
    )


def yaml_beside(path: Path) -> Path:
    """Return the YAML file beside a ``.pbm``."""
    found = yaml_at(path)
    if found is None:
        status_of(path)
        rule = f"has no {path.with_suffix('.yaml').name} beside it, which gives its place"
        hint = "a bit map is two files, as mapdeal pack writes them"
        raise FileAccessError(rule, source=path, hint=hint)
    return found


def find_bits(path: Path, yaml_path: Path, metadata: MapMetadata) -> Path:
    """Return the image that the YAML file beside a ``.pbm`` names, which must be that one."""
    status_of(path)
    image = find_image(yaml_path, metadata.image)
    if not is_same_file(image, path):
        rule = f"names another image than {path.name}"
        raise MalformedInputError(rule, source=yaml_path, place="image", got=metadata.image)
    return image


def image_places(folder: Path, image: str) -> list[Path]:
    """Return where the image may be that a YAML file in a folder names: the first there counts."""
    name = _expanded(image)
    path = folder / name
    places = [path]
    if "\\" in image:
        places.append(folder / image.replace("\\", "/"))
    if path.is_absolute() and not name.startswith(str(folder)):
        places.append(folder / path.name)
    windows_path = PureWindowsPath(image)
    if windows_path.is_absolute():
        places.append(folder / windows_path.name)
    return places


def _expanded(image: str) -> str:
    """Return the name with a leading ``~`` replaced by the home folder, if there is one."""
    try:
        return os.path.expanduser(image) if image.startswith("~") else image  # noqa: PTH111
    except ValueError:
        return image


def _warn_path(yaml_path: Path, text: str) -> None:
    warning = MapdealWarning(f"{yaml_path}: image: {text}", "image.foreign-path")
    emit_warning(warning, stacklevel=3)


def _nearest_name(path: Path) -> str | None:
    """Return a hint that names the files most like `path`, other case or ending included."""
    try:
        names = contents_of(path.parent)[1]
    except FileAccessError:
        return None
    import difflib

    images = [n for n in names if n != path.name and not n.endswith(YAML)]
    lower = {n.lower(): n for n in images}
    near = [n for n in images if Path(n).stem.lower() == path.stem.lower()]
    near += [
        lower[n] for n in difflib.get_close_matches(path.name.lower(), lower, n=3, cutoff=0.75)
    ]
    unique = list(dict.fromkeys(near))
    return f"the folder has {', '.join(unique)}" if unique else None


def costs_of(picture: Picture, path: Path) -> NDArray[np.uint8]:
    """Return the costs in a picture, row 0 in the north."""
    if picture.colour != "grey" or picture.maxval != 255 or picture.alpha is not None:
        rule = "an image of costs must have one 8-bit grey channel"
        raise MalformedInputError(rule, source=path, got=picture.colour)
    return picture.samples.astype(np.uint8, copy=False)


Encoding = Literal["occupancy", "costmap2d"]

_MADE_TOGETHER = 1 << 20
_FREE_PIXEL, _UNKNOWN_PIXEL, _OCCUPIED_PIXEL = 254, 205, 0
_TRINARY_FREE, _TRINARY_OCCUPIED = 25, 65
"""Percent; map_saver's defaults for values between free and occupied."""


def pair_paths(output: Path) -> tuple[Path, Path]:
    """Return the image and the YAML file that `output` stands for."""
    # ``.pgm`` and ``.png`` name the image, ``.yaml`` the YAML file of a pgm pair.
    if output.suffix in (".pgm", ".png"):
        return output, output.with_suffix(".yaml")
    return output.with_suffix(".pgm"), output


def write_pair(
    transaction: Transaction, output: Path, grid: OccupancyGrid | Costmap, *,
    mode: Mode | None = None, encoding: Encoding = "occupancy",
    extra: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    image, yaml_path = pair_paths(output)
    cost_scale: CostScale | None = None
    if isinstance(grid, Costmap):
        if mode not in (None, "raw"):
            raise ParameterError("costs are written in mode raw", place="mode", got=mode)
        mode = "raw"
        if encoding == "costmap2d":
            if grid.scale != "costmap2d":
                rule = "these costs are on the occupancy scale and have no costmap2d bytes"
                raise ParameterError(rule, place="encoding", got=encoding)
            cost_scale = "costmap2d"
            text = f"{yaml_path}: holds costmap_2d's bytes, which map_server would misread"
            emit_warning(text, stacklevel=2)
            write_image = _pixel_writer(image, grid.cost, grid)
        else:
            write_image = _pixel_writer(image, _published_pixels(grid), grid)
    else:
        is_raw = isinstance(grid, FieldView) or _has_between(grid.occupancy)
        mode = mode or ("raw" if is_raw else "trinary")
        if mode == "trinary":
            grid = in_trinary(grid)
        write_image = _occupancy_writer(image, grid, mode)
    scaled = mode == "scale"
    metadata = MapMetadata(
        image=image.name, resolution=grid.resolution, origin=grid.origin, mode=mode,
        occupied_thresh=1.0 if scaled else 0.65, free_thresh=0.0 if scaled else 0.196,
        cost_scale=cost_scale,
        view=grid.scale if isinstance(grid, FieldView) and mode == "raw" else None,
        extra=extra or {},
    )  # fmt: skip
    transaction.write(image, write_image)
    transaction.write_bytes(yaml_path, yaml_of(metadata))


def write_map_image(transaction: Transaction, image: Path, grid: OccupancyGrid) -> Mode:
    mode: Mode = "raw" if _has_between(grid.occupancy) else "trinary"
    transaction.write(image, _occupancy_writer(image, grid, mode))
    return mode


def in_trinary(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the map that is left of `grid` in mode trinary, with a warning if that is less."""
    # As map_saver does by default: 0..25 free, 65..100 occupied, all else unknown.
    lost = int(counts_of(grid.occupancy)[FREE + 1 : OCCUPIED].sum())
    if not lost:
        return grid
    text = f"{lost} values between 1 and 99 are lost in mode trinary"
    emit_warning(text, stacklevel=3)
    table = np.full(256, UNKNOWN, dtype=np.int8)
    table[FREE : _TRINARY_FREE + 1] = FREE
    table[_TRINARY_OCCUPIED : OCCUPIED + 1] = OCCUPIED
    return grid.with_values(looked_up(grid.occupancy, table))


def _has_between(values: Layer) -> bool:
    return bool(counts_of(values)[FREE + 1 : OCCUPIED].any())


def _occupancy_writer(image: Path, grid: OccupancyGrid, mode: Mode) -> Writer:
    values = grid.occupancy
    if mode == "raw":
        return _pixel_writer(image, _raw_pixels(values), grid)
    if mode == "trinary":
        return _pixel_writer(image, _pixels_of(values, _trinary_table()), grid)
    values = np.asarray(values)  # the opacity of unknown cells is a second layer
    scaled = look_up(values, _scale_table())
    unknown = values == UNKNOWN
    if not unknown.any():
        return _pixel_writer(image, scaled, grid)
    if image.suffix != ".png":
        rule = "mode scale needs transparent pixels for unknown cells, which pgm has not"
        hint = "write to a .png, or in mode raw"
        raise ParameterError(rule, source=image, place="mode", got=mode, hint=hint)
    rgba = np.dstack([scaled, scaled, scaled, np.where(unknown, 0, 255).astype(np.uint8)])
    return lambda file: write_rgba_png(file, np.ascontiguousarray(rgba[::-1]))


def _pixel_writer(image: Path, pixels: Layer, grid: Framed) -> Writer:
    """Return what writes grey pixels given south first, as cells are."""
    comment = f"CREATOR: mapdeal {grid.resolution!r} m/pix"
    if image.suffix == ".png":
        whole = pixels[:]  # as for pictures: no larger than fits
        return lambda file: write_grey_png(file, np.ascontiguousarray(whole[::-1]))
    return RowsWriter(pixels, lambda file: (begin_pgm(file, pixels, comment=comment), lambda: None))


def _published_pixels(costmap: Costmap) -> Layer:
    """Return the values that ROS would publish, as mode raw has them."""
    if costmap.scale == "occupancy":
        return _raw_pixels(costmap.cost)
    return _pixels_of(costmap.cost, occupancy_from_cost().view(np.uint8))


def _pixels_of(values: Layer, table: NDArray[np.uint8]) -> Layer:
    """Return the pixels of values, which are made band by band when they are written."""
    # An array of them would take its memory until its turn has come.
    if is_lazy(values):
        return looked_up(values, table)
    height = max(1, _MADE_TOGETHER // values.shape[1])
    return lazy_layer(
        values.shape, np.uint8, lambda rows: look_up(values[rows], table), block_height=height
    )


def _raw_pixels(values: Layer) -> Layer:
    return mapped(values, np.uint8, lambda part: part.view(np.uint8))  # -1 is 255 already


def _trinary_table() -> NDArray[np.uint8]:
    """Return the pixel of each value, indexed by its byte (-1 is the last)."""
    table = np.full(256, _UNKNOWN_PIXEL, dtype=np.uint8)
    table[FREE] = _FREE_PIXEL
    table[OCCUPIED] = _OCCUPIED_PIXEL
    return table


def _scale_table() -> NDArray[np.uint8]:
    """Return the pixel of each value in mode scale, unknown mid grey."""
    value = np.clip(np.arange(256), 0, 100)
    table = np.rint((100 - value) / 100 * 255).astype(np.uint8)
    table[255] = 128
    return table


def read_bit_map(
    path: Path | str, *, max_cells: int | None = None, max_memory: int | None = None
) -> BitMap:
    """Read a bit map without expanding it to one byte per cell.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file with its ``.yaml`` next to it.
    max_cells : int, optional
        Largest number of cells to read, 1e9 by default.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    BitMap
        Black pixels are obstacles, 1; with ``negate: 1`` in the YAML file, white ones are.

    Raises
    ------
    FileAccessError
        If one of the files cannot be read.
    MalformedInputError
        If one of the files is malformed, or they do not belong together.
    """
    with use_memory(max_memory):
        return read_bit_map_pair(Path(path), max_cells=max_cells)[0]


def read_bit_map_pair(
    path: Path, *, max_cells: int | None = None
) -> tuple[BitMap, MapMetadata, tuple[Path, Path]]:
    """Return a bit map, what its YAML says, and the files it came from, see `read_bit_map`."""
    if path.suffix.lower() != BIT_MAP:
        rule = "a bit map must be a .pbm"
        hint = "pass the .pbm that the YAML names" if path.suffix in YAML else None
        raise ParameterError(rule, source=path, got=path.suffix, hint=hint)
    yaml_path = yaml_beside(path)
    metadata = read_metadata(yaml_path)
    find_bits(path, yaml_path, metadata)
    if metadata.cost_scale is not None:
        rule = "a bit map cannot hold costs"
        raise MalformedInputError(rule, source=yaml_path, place="cost_scale")
    if metadata.mode == "raw":
        rule = "must be trinary for a bit map"
        raise MalformedInputError(rule, source=yaml_path, place="mode", got=metadata.mode)
    limit = LARGEST_CELLS if max_cells is None else max_cells
    packed, width = decode_pbm(read_file(path), path, max_cells=limit)
    packed = packed[::-1]  # image rows run from the north, grid rows from the south
    packed = ~packed if metadata.negate else packed
    bits = BitMap(packed, width, metadata.resolution, metadata.origin)
    return bits, metadata, (path, yaml_path)


def bit_map_paths(output: Path) -> tuple[Path, Path]:
    """Return the files that writing a bit map to `output` makes, the picture first."""
    if output.suffix != BIT_MAP:
        raise ParameterError("a bit map must end in .pbm", source=output, got=output.suffix)
    return output, output.with_suffix(".yaml")


def write_bit_map_pair(
    transaction: Transaction, output: Path, bits: BitMap, *, extra: Mapping[str, Any] | None = None
) -> None:
    """Write a bit map as PBM P4 and its YAML, which any map_server reads as a trinary map."""
    # `extra` are further keys for the YAML.
    picture, yaml_path = bit_map_paths(output)
    metadata = MapMetadata(
        image=picture.name, resolution=bits.resolution, origin=bits.origin, extra=extra or {}
    )
    transaction.write(picture, lambda file: write_pbm(file, bits.packed[::-1], bits.width))
    transaction.write_bytes(yaml_path, yaml_of(metadata))


def write_bit_map(path: Path | str, bits: BitMap, *, force: bool = False) -> None:
    """Write a bit map.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file; its ``.yaml`` is written next to it. Missing folders are created.
    bits : BitMap
        Bit map to write.
    force : bool
        Whether to replace existing files.

    Raises
    ------
    FileAccessError
        If a file exists and `force` is not set, or a file cannot be written; nothing is changed
        then.
    """
    output = Path(path)
    with Transaction(bit_map_paths(output), force=force) as transaction:
        write_bit_map_pair(transaction, output, bits)
