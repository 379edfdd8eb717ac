"""Writing a map_server pair: which pixel stands for which value, and the YAML beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.formats.map_yaml import MapMetadata, Mode, yaml_of
from mapdeal.formats.png import write_grey_png, write_rgba_png
from mapdeal.formats.pnm import begin_pgm
from mapdeal.formats.temporary import Writer
from mapdeal.formats.transaction import RowsWriter, Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import FieldView
from mapdeal.grid.framed import Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, CostScale, occupancy_from_cost
from mapdeal.kernels.blocks import Layer, counts_of, is_lazy, lazy_layer, looked_up, mapped
from mapdeal.kernels.lookup import look_up

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
