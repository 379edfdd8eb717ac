"""Grids extended to a larger extent, and fields that have numbers only in part of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, TypeVar, cast

import numpy as np

from mapdeal import errors, records
from mapdeal.compatibility import Self
from mapdeal.grid import reach, values as map_values
from mapdeal.grid.frame import Figures, Frame, Framed, Region, ValueGrid, corners_of
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import blocks, threads
from mapdeal.kernels.arrays import Array, Bytes, Floats, Mask, SignedBytes
from mapdeal.kernels.lookup import TOUCHING, Lattice, largest_under, nearest_under

ResamplingRule = Literal["area", "nearest"]  # largest under the cell's area, or at its centre
V = TypeVar("V", bound=ValueGrid)
_CELLS_AT_ONCE = 1 << 20


def resampled(grid: V, frame: Frame, *, rule: ResamplingRule = "area") -> V:
    map_values.check_choice(rule, ResamplingRule, "rule")
    check_values(grid)
    part = _under(frame, grid.values, grid.frame)
    values = np.full(frame.shape, grid.unknown_value, dtype=grid.values.dtype)
    if part is not None:
        cells, lattice = part
        found, inside = nearest_under(cells, frame.shape, lattice)
        np.copyto(values.view(np.uint8), found, where=inside)
        del found, inside
        if rule == "area":
            # adding 1 wraps unknown, -1 or 255, to 0, so it never is the largest
            shifted = cells + np.uint8(1)
            shifted[shifted == 1] = 0
            largest = largest_under(shifted, frame.shape, lattice)
            np.subtract(largest, 1, out=values.view(np.uint8), where=largest > 0)
    layers: dict[str, Any] = {grid.layer_names[0]: values}
    return replaced(grid, resolution=frame.resolution, origin=frame.origin, **layers)


def check_values(grid: object) -> None:
    if not isinstance(grid, ValueGrid):
        rule, hint = "must be a map or a costmap", "edit the map, then run esdf or potential on it"
        raise errors.ParameterError(rule, place="grid", got=type(grid).__name__, hint=hint)


def obstacles_in(frame: Frame, obstacles: Mask, source: Frame) -> Mask:
    """Return which cells of a frame overlap an obstacle of a grid with another frame."""
    part = _under(frame, obstacles, source)
    if part is None:
        return np.zeros(frame.shape, dtype=np.bool_)
    values, lattice = part
    return largest_under(values, frame.shape, lattice).view(np.bool_)


def contained_in(frame: Frame, cells: Mask, source: Frame) -> Mask:
    if region_on_lattice(source, frame) is not None:
        return obstacles_in(frame, cells, source)
    return _wholly_inside(frame, source) & ~obstacles_in(frame, ~cells, source)


def sampled(frame: Frame, values: SignedBytes, source: Frame) -> tuple[SignedBytes, Mask]:
    """Return the values of a grid at the centres of a frame's cells, and which are inside it."""
    part = _under(frame, values.view(np.uint8), source)
    if part is None:
        return np.zeros(frame.shape, np.int8), np.zeros(frame.shape, np.bool_)
    cells, lattice = part
    found, inside = nearest_under(cells, frame.shape, lattice)
    return found.view(np.int8), inside


def region_on_lattice(lattice: Frame, frame: Frame) -> Region | None:
    """Return a frame's cells as a region of a lattice; None if their borders differ."""
    if frame.resolution != lattice.resolution or is_turned(lattice, frame.origin[2]):
        return None
    corner = lattice.continuous_rowcol_from_xy([frame.origin[:2]])[0]
    row, col = np.rint(corner)
    tolerance = max(TOUCHING, lattice.tolerance_at([frame.origin[:2]])[0, 0])
    if np.abs(corner - (row, col)).max() > tolerance:
        return None
    return Region(int(row), int(col), *frame.shape)


def is_turned(frame: Frame, yaw: float = 0.0) -> bool:
    """Return whether a grid's axes differ from a yaw by enough to displace cells."""
    return abs(_turn(frame, yaw)) * max(frame.shape) > TOUCHING


def _turn(frame: Frame, yaw: float) -> float:
    return math.remainder(yaw - frame.origin[2], 2 * math.pi)


def frames_overlap(first: Frame, second: Frame) -> bool:
    for frame, source in ((first, second), (second, first)):
        places = source.continuous_rowcol_from_xy(corners_of(frame))
        beyond = places.min(axis=0) >= np.subtract(source.shape, TOUCHING)
        if (places.max(axis=0) <= TOUCHING).any() or beyond.any():
            return False
    return True


def rows_and_cols_under(frame: Frame, source: Frame) -> tuple[slice, slice]:
    places = source.continuous_rowcol_from_xy(corners_of(frame))
    first = np.clip(np.floor(places.min(axis=0)) - 1, 0, source.shape).astype(int)
    last = np.clip(np.ceil(places.max(axis=0)) + 1, 0, source.shape).astype(int)
    return slice(first[0], last[0]), slice(first[1], last[1])


def _under(frame: Frame, values: Array, source: Frame) -> tuple[Bytes, Lattice] | None:
    """Return the cells under a frame, if any, turned by quarter turns towards its axes."""
    rows, cols = rows_and_cols_under(frame, source)
    if rows.start >= rows.stop or cols.start >= cols.stop:
        return None
    cells = np.asarray(values[rows])[:, cols].view(np.uint8)
    part = source.window(rows.start, cols.start, *cells.shape)
    quarters = round(_turn(part, frame.origin[2]) / (math.pi / 2))
    part, cells = _quartered(part, quarters), np.rot90(cells, quarters)
    turn = _turn(part, frame.origin[2])
    side = frame.resolution / part.resolution
    if abs(turn) * max(*part.shape, *(side * count for count in frame.shape)) <= TOUCHING:
        turn = 0.0
    corner = [frame.origin[:2]]
    row, col = part.continuous_rowcol_from_xy(corner)[0].tolist()
    return cells, Lattice(row, col, side, turn, float(part.tolerance_at(corner)[0, 0]))


def _quartered(frame: Frame, quarters: int) -> Frame:
    """Return the frame of the same cells after ``np.rot90`` by `quarters` quarter turns."""
    height, width = frame.shape
    corners = [(0, 0), (0, width), (height, width), (height, 0)]
    if quarters % 4 == 0:
        return frame
    x, y = frame.xy_from_continuous_rowcol([corners[quarters % 4]])[0].tolist()
    shape = frame.shape if quarters % 2 == 0 else (width, height)
    return Frame(*shape, frame.resolution, (x, y, frame.origin[2] + quarters * math.pi / 2))


def _wholly_inside(frame: Frame, source: Frame) -> Mask:
    result = np.zeros(frame.shape, dtype=np.bool_)

    def test_rows(part: slice) -> None:
        corners = np.indices((part.stop - part.start + 1, frame.width + 1)).reshape(2, -1).T
        corners[:, 0] += part.start
        places = source.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
        is_inside = ((places >= -TOUCHING) & (places <= np.add(source.shape, TOUCHING))).all(axis=1)
        corner = is_inside.reshape(-1, frame.width + 1)
        result[part] = corner[:-1, :-1] & corner[1:, :-1] & corner[:-1, 1:] & corner[1:, 1:]

    threads.for_rows(test_rows, frame.shape)
    return result


class FieldGrid(Framed):
    """A grid of computed numbers, which may be confined to one box of cells."""

    # The field was computed for the box and then extended: outside the box the numbers are nan and
    # the map is unknown. Derived layers are computed and extended in the same way.

    occupancy: SignedBytes
    region: Region | None  # the box; None if it is all of the grid

    @property
    def outside_values(self) -> dict[str, float]:
        """Value of each layer in cells added around the grid: nan or unknown."""
        return {self.layer_names[0]: np.nan, "occupancy": map_values.UNKNOWN}

    @property
    def grid(self) -> OccupancyGrid:
        """Map that the field was computed from."""
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    @cached_property
    def cropped(self) -> Self:
        if self.region is None:
            return self
        frame = self.region.frame_in(self.frame)
        layers = {name: cut_out(getattr(self, name), self.region) for name in self.layer_names}
        return replaced(self, origin=frame.origin, region=None, **layers)

    def figures(self) -> Figures:
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

    def with_layer(self, layer: blocks.Layer) -> Self:
        copy = super().with_layer(layer)
        copy.__dict__.pop("cropped", None)
        return copy

    def _find_region(self) -> None:
        """Detect the region from the layers; for lazy layers it must be known."""
        if not blocks.is_lazy(self.layer):
            region = _box_of_numbers(self.layer, self.occupancy, self.layer_names[0])
            object.__setattr__(self, "region", region)


G = TypeVar("G", bound=ValueGrid | FieldGrid | reach.Reach)


class layer_of_box(cached_property[Floats]):  # noqa: N801 - a decorator
    """A cached, read-only layer of a field, shape (..., H, W), computed for its box only."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        def compute(field: FieldGrid) -> Any:
            if field.region is not None:
                inner = getattr(field.cropped, function.__name__)
                return None if inner is None else embedded(inner, field.shape, field.region)
            layer = function(field)
            if layer is not None:
                layer.flags.writeable = False
            return layer

        compute.__doc__ = function.__doc__
        super().__init__(compute)


def on_canvas(grid: G, frame: Frame, *, fill: int | None = None) -> G:
    if frame == grid.frame:
        return grid
    place = region_on_lattice(frame, grid.frame)
    if place is None:
        raise errors.ParameterError("the cells of the two grids are not aligned", place="canvas")
    rows, cols = place.shared_with(frame.shape)
    if (rows.stop - rows.start, cols.stop - cols.start) != grid.shape:
        raise errors.ParameterError("does not contain the whole grid", place="canvas")
    values = grid.outside_values | ({} if fill is None else {grid.layer_names[0]: fill})
    layers = {name: padded(getattr(grid, name), frame.shape, place, value)
              for name, value in values.items()}  # fmt: skip
    if not isinstance(grid, FieldGrid):
        return replaced(grid, origin=frame.origin, **layers)
    inner = grid.region or Region(0, 0, *grid.shape)
    region = inner._replace(row=place.row + inner.row, col=place.col + inner.col)
    extended = replaced(grid, origin=frame.origin, region=region, **layers)
    if extended.region is not None:
        object.__setattr__(extended, "cropped", grid.cropped)
    return extended


def cut_out(layer: blocks.Layer, region: Region) -> blocks.Layer:
    cols = slice(region.col, region.col + region.width)

    def cut(rows: slice) -> Array:
        return layer[region.row + rows.start : region.row + rows.stop][:, cols]

    return blocks.made_by_rows(layer, layer.dtype, cut, shape=(region.height, region.width))


def embedded(values: Array, shape: tuple[int, int], region: Region, fill: float = np.nan) -> Array:
    extended = np.full((*values.shape[:-2], *shape), fill, dtype=values.dtype)
    rows, cols = region.shared_with(shape)
    extended[..., rows, cols] = values
    extended.flags.writeable = False
    return extended


def replaced(grid: G, **changes: Any) -> G:
    return cast("G", records.replace(cast("Any", grid), **changes))


def padded(layer: blocks.Layer, shape: tuple[int, int], place: Region, fill: float) -> blocks.Layer:
    cols = slice(place.col, place.col + place.width)

    def make(rows: slice) -> Array:
        values = np.full((rows.stop - rows.start, shape[1]), fill, dtype=layer.dtype)
        low, high = max(rows.start, place.row), min(rows.stop, place.row + place.height)
        if low < high:
            inner = layer[low - place.row : high - place.row]
            values[low - rows.start : high - rows.start, cols] = inner
        return values

    return blocks.made_by_rows(layer, layer.dtype, make, shape=shape)


def _box_of_numbers(layer: Array, occupancy: SignedBytes, name: str) -> Region | None:
    if not np.isnan(layer.min()):  # the minimum of values with a nan is nan
        return None
    has_number = [np.zeros(length, dtype=bool) for length in layer.shape]
    count = known = 0
    step = max(1, _CELLS_AT_ONCE // layer.shape[1])
    for first in range(0, layer.shape[0], step):
        band = slice(first, first + step)
        numbers = ~np.isnan(layer[band])
        has_number[0][band] = numbers.any(axis=1)
        has_number[1] |= numbers.any(axis=0)
        count += int(np.count_nonzero(numbers))
        known += int(np.count_nonzero((occupancy[band] != map_values.UNKNOWN) & ~numbers))
    region = Region.spanning(*has_number)
    if region is None:
        raise errors.ParameterError(f"{name} must not hold nan everywhere")
    if count != region.cells or known:
        rule = f"{name} may hold nan only around one box of numbers, where the map is unknown"
        raise errors.ParameterError(rule)
    return region
