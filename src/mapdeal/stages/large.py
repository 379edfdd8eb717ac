"""The stages on grids too large for memory: what they make is made by rows, when asked for.

Each takes the parameters of the stage that it is named after and gives, cell by cell, the same.
Where a cell depends on its neighbourhood alone, a stage works on the rows that are asked for with
some more on both sides. Distances depend on the whole grid: `large_esdf` looks at all of it once,
slab by slab, and keeps what slabs must know of each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.large import LargeCosts, LargeField, LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, UNKNOWN, Convention, UnknownPolicy
from mapdeal.kernels.column_runs import joined, runs_of
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.kernels.rows import MadeRows
from mapdeal.stages.active import box_around
from mapdeal.stages.esdf import Measuring, View, ViewScale
from mapdeal.stages.exponential_cost import FallOff, costs_before
from mapdeal.stages.field_values import deepest_in, largest_distance_in
from mapdeal.stages.inflate import Growth
from mapdeal.stages.obstacle_source import check_lethal_threshold
from mapdeal.stages.ring_cost import check_rings, rings_around
from mapdeal.stages.threshold_cost import check_clip, table_of_views

LargeSource = LargeMap | LargeField
Window = OccupancyGrid | DistanceField


def large_active_region(
    grid: LargeMap, *, margin: float, canvas: Literal["crop", "full"], min_component: int
) -> LargeMap:
    """Return the bounding box of all known cells, see `mapdeal.active_region`."""
    if min_component > 1:
        rule = "groups of cells cannot be counted in a map that does not fit into memory"
        raise ParameterError(rule, place="min_component", got=min_component)
    layer = grid.occupancy
    in_rows, in_cols = np.zeros(grid.shape[0], dtype=bool), np.zeros(grid.shape[1], dtype=bool)
    for slab in layer.slabs():
        known = layer[slab] != UNKNOWN
        in_rows[slab] = known.any(axis=1)
        in_cols |= known.any(axis=0)
    rows, cols = box_around(in_rows, in_cols, margin, grid.resolution)
    if canvas == "full":
        return replace(grid, occupancy=_masked(layer, rows, cols))
    shape = (rows.stop - rows.start, cols.stop - cols.start)
    frame = grid.frame.window(rows.start, cols.start, *shape)

    def make(first: int, end: int) -> NDArray[np.int8]:
        return layer[rows.start + first : rows.start + end][:, cols]

    return LargeMap(layer.like(np.int8, make, shape), grid.resolution, frame.origin)


def _masked(layer: MadeRows, rows: slice, cols: slice) -> MadeRows:
    """Return a layer with everything outside of a box unknown."""

    def make(first: int, end: int) -> NDArray[np.int8]:
        values = np.full((end - first, layer.shape[1]), UNKNOWN, dtype=np.int8)
        low, high = max(first, rows.start), min(end, rows.stop)
        if low < high:
            values[low - first : high - first, cols] = layer[low:high][:, cols]
        return values

    return layer.like(np.int8, make)


def large_inflate(
    grid: LargeMap,
    *,
    radius: float,
    footprint: Footprint | None,
    kernel: Literal["disc", "square"],
    lethal_threshold: int,
    inflate_unknown: bool,
) -> LargeMap:
    """Return the map with every obstacle grown by a radius, see `mapdeal.inflate`."""
    growth = Growth.of(radius, footprint, kernel, lethal_threshold, inflate_unknown)
    growth.warn_of_no_effect(grid.resolution)

    def grown(window: Window) -> NDArray[np.int8]:
        values = window.occupancy.copy()
        whole = OccupancyGrid(window.occupancy, grid.resolution)
        set_where(values, growth.grown(whole, whole.occupied(lethal_threshold)), OCCUPIED)
        return values

    reach = growth.reach(grid.resolution, max(grid.shape))
    inflated = _by_windows(grid, reach, np.int8, grown)
    is_full = _holds_everywhere(inflated, lambda values: values == OCCUPIED)
    if is_full and not _holds_everywhere(grid.occupancy, lambda v: v >= lethal_threshold):
        growth.warn_of_nothing_free()
    return replace(grid, occupancy=inflated)


def large_esdf(
    grid: LargeMap,
    *,
    unknown: UnknownPolicy,
    convention: Convention,
    max_distance: float | None,
    lethal_threshold: int,
    strength: float,
) -> LargeField:
    """Return the distance field, see `mapdeal.esdf`. Looks at the whole grid once."""
    measuring = Measuring(unknown, convention, max_distance, lethal_threshold, strength)
    layer = grid.occupancy

    def obstacles(rows: slice) -> NDArray[np.bool_]:
        return measuring.obstacles(grid.part(rows))

    beside = joined([runs_of(obstacles(slab)) for slab in layer.slabs()])

    def make(first: int, end: int) -> NDArray[np.float32]:
        known = beside[first // layer.together]
        return measuring.distance(obstacles(slice(first, end)), grid.resolution, known)

    return LargeField(
        layer.slab_by_slab(np.float32, make), layer, grid.resolution, grid.origin,
        convention=convention, strength=strength, max_distance=max_distance,
        lethal_threshold=lethal_threshold, unknown=unknown,
    )  # fmt: skip


def large_field_view(field: LargeField, *, view: View, view_range: float) -> LargeMap:
    """Return the field as values 0..100, see `mapdeal.field_view`."""
    scale = _view_scale(field, view, view_range)

    def make(first: int, end: int) -> NDArray[np.int8]:
        part = field.part(slice(first, end))
        return scale.values_of(part, part.obstacles())

    return LargeMap(field.distance.like(np.int8, make), field.resolution, field.origin)


def large_exponential_cost(
    source: LargeSource,
    *,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float,
    inflate_unknown: bool,
    inflate_around_unknown: bool,
    lethal_threshold: int | None,
    circumscribed_radius: float | None,
) -> LargeCosts:
    """Return the costs of costmap_2d's inflation, see `mapdeal.exponential_cost`."""
    threshold = _threshold(source, lethal_threshold)
    fall_off = FallOff.of(
        inscribed_radius, inflation_radius, cost_scaling_factor,
        inflate_unknown=inflate_unknown, inflate_around_unknown=inflate_around_unknown,
        resolution=source.resolution, shape=source.shape,
    )  # fmt: skip
    circumscribed_cost = fall_off.cost_at(circumscribed_radius)

    def around_seeds(window: Window) -> NDArray[np.uint8]:
        obstacles = _obstacles(window, threshold)
        cost = costs_before(window, obstacles)
        if fall_off.reach > 0:
            fall_off.raise_around_seeds(cost, obstacles)
        return cost

    def from_field(rows: slice, field: LargeField) -> NDArray[np.uint8]:
        part = field.part(rows)
        obstacles = part.obstacles()
        cost = costs_before(part, obstacles)
        fall_off.raise_from_field(cost, part, obstacles)
        return cost

    if (
        isinstance(source, LargeField)
        and fall_off.reach > 0
        and not (inflate_around_unknown and _has_unknown_beside_obstacles(source))
        and fall_off.is_in(source)
    ):
        field = source
        cost = source.occupancy.slab_by_slab(
            np.uint8, lambda first, end: from_field(slice(first, end), field)
        )
    else:
        cost = _by_windows(source, fall_off.cells, np.uint8, around_seeds)
    return LargeCosts(
        cost, source.resolution, source.origin, circumscribed_cost=circumscribed_cost
    )  # fmt: skip


def large_ring_cost(
    source: LargeSource, *, values: tuple[int, ...], lethal_threshold: int | None
) -> LargeCosts:
    """Return costs that fall off ring by ring, see `mapdeal.ring_cost`."""
    threshold = _threshold(source, lethal_threshold)
    check_rings(values)

    def rings(window: Window) -> NDArray[np.int8]:
        return rings_around(window, values, threshold)

    cost = _by_windows(source, len(values), np.int8, rings)
    return LargeCosts(cost, source.resolution, source.origin, scale="occupancy")


def large_threshold_cost(
    source: LargeSource,
    *,
    down: float,
    up: float,
    down_factor: float,
    up_factor: float,
    view: View,
    view_range: float,
    lethal_threshold: int | None,
) -> LargeCosts:
    """Return costs by thresholds on the field's view, see `mapdeal.threshold_cost`."""
    table = table_of_views(down, up, down_factor, up_factor)
    threshold = _threshold(source, lethal_threshold)
    if isinstance(source, LargeMap):
        source = large_esdf(
            source, unknown="free", convention="seed", max_distance=None,
            lethal_threshold=threshold, strength=1.0,
        )  # fmt: skip
    if source.max_distance is not None:
        for slab in source.distance.slabs():
            check_clip(source.part(slab), down, view, view_range)
    values = large_field_view(source, view=view, view_range=view_range).occupancy
    cost = values.slab_by_slab(np.int8, lambda first, end: look_up(values[first:end], table))
    return LargeCosts(cost, source.resolution, source.origin, scale="occupancy")


def _by_windows(
    source: LargeSource, reach: int, dtype: Any, change: Callable[[Window], NDArray[Any]]
) -> MadeRows:
    """Return what `change` makes of windows that are `reach` rows larger on both sides."""
    height = source.shape[0]

    def make(first: int, end: int) -> NDArray[Any]:
        low, high = max(first - reach, 0), min(end + reach, height)
        return change(_window(source, slice(low, high)))[first - low : end - low]

    return source.occupancy.slab_by_slab(dtype, make)


def _window(source: LargeSource, rows: slice) -> Window:
    """Return some rows, for what looks at obstacles but not at distances."""
    if isinstance(source, LargeMap):
        return source.part(rows)
    occupancy = source.occupancy[rows]
    return DistanceField(
        np.zeros(occupancy.shape, dtype=np.float32), occupancy, source.resolution,
        lethal_threshold=source.lethal_threshold, unknown=source.unknown,
    )  # fmt: skip


def _obstacles(window: Window, threshold: int) -> NDArray[np.bool_]:
    if isinstance(window, DistanceField):
        return window.obstacles()
    return window.occupied(threshold)


def _threshold(source: LargeSource, given: int | None) -> int:
    rows = slice(0, 1)
    return check_lethal_threshold(_window(source, rows), given)


def _view_scale(field: LargeField, view: View, view_range: float) -> ViewScale:
    obstacles = field.obstacles()
    has_obstacles = not _holds_everywhere(obstacles, np.logical_not)
    has_others = not _holds_everywhere(obstacles, lambda values: values)
    farthest = deepest = 0.0
    if view == "seed" and has_obstacles:
        for slab in obstacles.slabs():
            part, mask = field.part(slab), obstacles[slab]
            farthest = max(farthest, largest_distance_in(part, mask))
            deepest = max(deepest, deepest_in(part, mask))
    return ViewScale(view, view_range, field.shape, has_obstacles, has_others, farthest, deepest)


def _has_unknown_beside_obstacles(field: LargeField) -> bool:
    layer = field.occupancy
    obstacles = field.obstacles()
    return any(((layer[s] == UNKNOWN) & ~obstacles[s]).any() for s in layer.slabs())


def _holds_everywhere(
    layer: MadeRows, test: Callable[[NDArray[Any]], NDArray[np.bool_]]
) -> bool:  # fmt: skip
    """Return whether a test holds for all cells; looks no further than it must."""
    return all(test(layer[slab]).all() for slab in layer.slabs())
