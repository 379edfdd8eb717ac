"""Grids extended to a larger extent, and fields that have numbers only in part of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame, Region
from mapdeal.grid.framed import Figures, Framed, ValueGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.resample import region_on_lattice
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import Layer, is_lazy, made_by_rows

_LOOKED_AT_TOGETHER = 1 << 20


class FieldGrid(Framed):
    """A grid of computed numbers, which may be limited to one box of cells."""

    # Outside the box the numbers are nan and the map is unknown: the field was computed for the box
    # and then extended. Further products are computed for the box and extended likewise.

    occupancy: NDArray[np.int8]
    region: Region | None
    """The box; None if it is all of the grid."""

    @property
    def outside_values(self) -> dict[str, float]:
        """Value of each layer in cells added around the grid: nan or unknown."""
        return {self.layer_names[0]: np.nan, "occupancy": UNKNOWN}

    @cached_property
    def cropped(self) -> Self:
        if self.region is None:
            return self
        frame = self.region.frame_in(self.frame)
        layers = {name: cut_out(getattr(self, name), self.region) for name in self.layer_names}
        return replaced(self, origin=frame.origin, region=None, **layers)

    def figures(self) -> Figures:
        """Return the grid's size, place and counts; statistics cover only cells with a number."""
        if self.region is None:
            return super().figures()
        height, width = self.shape
        count = height * width - self.region.cells
        return {**self.cropped.figures(), **self.frame_figures(), "without_value": count}

    def part(self, rows: slice) -> Self:
        """Return some rows, loaded into memory, at their place in the map frame."""
        part = super().part(rows)
        if part is not self:
            part.__dict__.pop("cropped", None)
            if self.region is not None:
                first, end, _ = rows.indices(self.shape[0])
                inner, _ = self.region.shared_with((end, self.shape[1]))
                low = min(max(inner.start, first), inner.stop)
                region = self.region._replace(row=low - first, height=inner.stop - low)
                object.__setattr__(part, "region", region)
        return part

    def with_layer(self, layer: Layer) -> Self:
        other = super().with_layer(layer)
        other.__dict__.pop("cropped", None)
        return other

    def _find_region(self) -> None:
        """Set the region to what the layers say; of lazy ones it must be known."""
        if not is_lazy(self.layer):
            region = _box_of_numbers(self.layer, self.occupancy, self.layer_names[0])
            object.__setattr__(self, "region", region)


G = TypeVar("G", bound=ValueGrid | FieldGrid | Reach)


class layer_of_box(cached_property[NDArray[np.float64]]):  # noqa: N801 - a decorator
    """A property of a field, an array of shape (..., H, W), that is made once, of its box alone."""

    # Around the box it is nan.

    def __init__(self, function: Callable[[Any], Any]) -> None:
        def made(field: FieldGrid) -> Any:
            if field.region is None:
                return function(field)
            inner = getattr(field.cropped, function.__name__)
            return None if inner is None else put_around(inner, field.shape, field.region)

        made.__doc__ = function.__doc__
        super().__init__(made)


def on_canvas(grid: G, frame: Frame, *, fill: int | None = None) -> G:
    if frame == grid.frame:
        return grid
    place = region_on_lattice(frame, grid.frame)
    if place is None:
        raise ParameterError("the two grids do not have their cells in common", place="canvas")
    rows, cols = place.shared_with(frame.shape)
    if (rows.stop - rows.start, cols.stop - cols.start) != grid.shape:
        raise ParameterError("does not hold all of the grid", place="canvas")
    values = grid.outside_values
    if fill is not None:
        values = {**values, grid.layer_names[0]: fill}
    layers = {
        name: padded(getattr(grid, name), frame.shape, place, value)
        for name, value in values.items()
    }
    if not isinstance(grid, FieldGrid):
        return replaced(grid, origin=frame.origin, **layers)
    inner = grid.region or Region(0, 0, *grid.shape)
    region = inner._replace(row=place.row + inner.row, col=place.col + inner.col)
    whole = replaced(grid, origin=frame.origin, region=region, **layers)
    if whole.region is not None:
        object.__setattr__(whole, "cropped", grid.cropped)  # it is there already
    return whole


def cut_out(layer: Layer, region: Region) -> Layer:
    cols = slice(region.col, region.col + region.width)

    def cut(rows: slice) -> NDArray[Any]:
        return layer[region.row + rows.start : region.row + rows.stop][:, cols]

    return made_by_rows(layer, layer.dtype, cut, shape=(region.height, region.width))


def put_around(
    values: NDArray[Any], shape: tuple[int, int], region: Region, fill: float = np.nan
) -> NDArray[Any]:
    """Return an array of shape (..., H, W) in a larger one, read-only, the rest of it filled."""
    whole = np.full((*values.shape[:-2], *shape), fill, dtype=values.dtype)
    rows, cols = region.shared_with(shape)
    whole[..., rows, cols] = values
    whole.flags.writeable = False
    return whole


def replaced(grid: G, **changes: Any) -> G:
    grid_of_any_type: Any = grid
    made: G = replace(grid_of_any_type, **changes)
    return made


def padded(layer: Layer, shape: tuple[int, int], place: Region, fill: float) -> Layer:
    top = place.row + place.height

    def make(rows: slice) -> NDArray[Any]:
        values = np.full((rows.stop - rows.start, shape[1]), fill, dtype=layer.dtype)
        low, high = max(rows.start, place.row), min(rows.stop, top)
        if low < high:
            inner = layer[low - place.row : high - place.row]
            values[low - rows.start : high - rows.start, place.col : place.col + place.width] = (
                inner
            )
        return values

    return made_by_rows(layer, layer.dtype, make, shape=shape)


def _box_of_numbers(layer: NDArray[Any], occupancy: NDArray[np.int8], name: str) -> Region | None:
    if not np.isnan(layer.min()):  # min hands nan on
        return None
    has_number = (np.zeros(layer.shape[0], dtype=bool), np.zeros(layer.shape[1], dtype=bool))
    count = known = 0
    step = max(1, _LOOKED_AT_TOGETHER // layer.shape[1])
    for first in range(0, layer.shape[0], step):
        band = slice(first, first + step)
        numbers = ~np.isnan(layer[band])
        has_number[0][band] = numbers.any(axis=1)
        has_number[1][:] |= numbers.any(axis=0)
        count += int(np.count_nonzero(numbers))
        known += int(np.count_nonzero((occupancy[band] != UNKNOWN) & ~numbers))
    if count == 0:
        raise ParameterError(f"{name} must not hold nan everywhere")
    (row, top), (col, right) = (
        (int(i[0]), int(i[-1]) + 1) for i in map(np.flatnonzero, has_number)
    )
    region = Region(row, col, top - row, right - col)
    if count != region.cells or known:
        rule = f"{name} may hold nan only around one box of numbers, where the map is unknown"
        raise ParameterError(rule)
    return region
