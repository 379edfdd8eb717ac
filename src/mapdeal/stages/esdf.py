"""Stage ``esdf``: the exact signed Euclidean distance field, and its 0..100 view."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import numpy as np

from mapdeal import command
from mapdeal.grid import values as map_values
from mapdeal.grid.field import DistanceField, FieldView, View, ViewScale, obstacles_in
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.arrays import Bytes, Floats, Mask, Metres, SignedBytes
from mapdeal.kernels.blocks import Halo, blocks_of, holds_everywhere, made_by_rows, swept
from mapdeal.kernels.distance import halos_of, runs_of, signed_distance
from mapdeal.kernels.lookup import bytes_of_distances, squares_of_distances
from mapdeal.kernels.threads import for_rows
from mapdeal.layers.stack import CostmapLayers

LARGER_MAX_DISTANCE = "make the field with a larger max_distance, or none"  # a hint
_LARGEST_TABLE = 1 << 22
_CLIP_TOLERANCE = 2.0**-23  # relative: distances are float32, the clip is not
# from view values and their distances in metres to costs
CostOfView = Callable[[Floats, Floats], Floats]


def squares_in(field: DistanceField, obstacles: Mask, rows: slice = slice(None)) -> Floats:
    """Return the squared distance to the nearest obstacle centre, in cells."""
    # Undoes convention and strength, then rounds: distances between cell centres are square roots
    # of whole numbers n of cells. A float32 is off by 2**-24 of its value at most, so its square by
    # n * 2**-23: exact below n = 2**22, 2048 cells, and beyond within one part in 2**22.
    return squares_of_distances(field.distance[rows], obstacles[rows], **_measure(field))


def bytes_in(field: DistanceField, obstacles: Mask, table: Bytes) -> Bytes:
    """Return a table's entry for each cell's square, the last one for all beyond."""
    return bytes_of_distances(field.distance, obstacles, table, **_measure(field))


def _bytes_of_metres(
    field: DistanceField, obstacles: Mask, value_of: Callable[[Floats], Floats], farthest: float
) -> SignedBytes:
    """Return a function's values of each cell's distance, the same from the farthest on."""
    furthest = furthest_kept(field)
    cells = min(farthest, furthest) / field.resolution
    if cells * cells < _LARGEST_TABLE:
        squares = np.arange(math.ceil(cells * cells) + 2, dtype=np.float64)
        squares[-1] = math.inf
        metres = np.minimum(np.sqrt(squares) * field.resolution, furthest)
        return bytes_in(field, obstacles, value_of(metres).astype(np.uint8)).view(np.int8)
    values = np.empty(field.shape, dtype=np.int8)

    def part(rows: slice) -> None:
        metres = np.sqrt(squares_in(field, obstacles, rows)) * field.resolution
        values[rows] = value_of(np.minimum(metres, furthest))

    for_rows(part, field.shape)
    return values


def _largest_distance_in(field: DistanceField, obstacles: Mask) -> float:
    """Return the largest distance between centres, in metres, as far as the field has kept it."""
    squares: list[float] = []
    for_rows(lambda rows: squares.append(squares_in(field, obstacles, rows).max()), field.shape)
    return min(math.sqrt(max(squares)) * field.resolution, furthest_kept(field))


def _deepest_in(field: DistanceField, obstacles: Mask) -> float:
    """Return the largest distance from an obstacle cell to a free cell, between centres, metres."""
    depth = -float(field.distance.min(where=obstacles, initial=math.inf))
    _, shift = _shifts(field.convention, field.resolution)
    if field.max_distance is not None and depth >= field.max_distance * (1 - _CLIP_TOLERANCE):
        return shift + field.max_distance
    cells = max(shift + depth, 0.0) / field.resolution
    return math.sqrt(round(cells * cells)) * field.resolution if math.isfinite(cells) else cells


def furthest_kept(field: DistanceField) -> float:
    """Return the distance between centres beyond which the field was clipped, metres."""
    if field.max_distance is None:
        return math.inf
    return field.max_distance - _shifts(field.convention, field.resolution)[0]


def _measure(field: DistanceField) -> dict[str, Any]:
    limit = math.inf if field.max_distance is None else field.max_distance
    shift = 0.0 - _shifts(field.convention, field.resolution)[0]
    clip = limit * (1 - _CLIP_TOLERANCE)
    return {"scale": field.resolution, "shift": shift, "gain": field.strength, "clip": clip}


def _shifts(convention: map_values.Convention, resolution: float) -> tuple[float, float]:
    """Return the offsets of a convention for distances outside and inside of obstacles, metres."""
    shifts = {"fast-planner": (0.0, 1.0), "center": (0.0, 0.0), "border": (-0.5, 0.5)}
    outside, inside = shifts[convention]
    return outside * resolution, inside * resolution


@command.checked
def field_view(
    field: DistanceField,
    *,
    view: View = "metric",
    view_range: Annotated[float, command.ABOVE_0, command.METRES] = 2.0,
) -> FieldView:
    """Convert a distance field to values 0..100 that increase towards obstacles.

    Parameters
    ----------
    field : DistanceField
        Field to convert. The view shows the distance d between cell centres times the field's
        strength, whatever the convention.
    view : {'metric', 'per-map'}
        How distances become 0..100. ``metric``: trunc(100 (1 - min(d, view_range) /
        view_range)), the same on every map. ``per-map``: trunc(100 (D - d) / (D - resolution + I)),
        scaled between the map's largest free distance D and deepest obstacle I (robot_costmap).
    view_range : float
        Distance at which the metric view is 0, metres.

    Returns
    -------
    FieldView
        View values: 100 on obstacles, -1 on unknown cells that are not obstacles, and 0 elsewhere
        if the map has no obstacle.

    Examples
    --------
    >>> grid = OccupancyGrid([[100, 0, 0, -1]], resolution=0.5)
    >>> field_view(esdf(grid)).occupancy.tolist()
    [[100, 75, 50, -1]]
    """
    viewer = Viewer(field, view, view_range)
    return FieldView(viewer.values(), field.resolution, field.origin, viewer.scale)


class Viewer:
    """Converter of a field to its view, in blocks, after the extremes of the field are known."""

    def __init__(self, field: DistanceField, view: View, view_range: float) -> None:
        self._field, self._obstacles = field, field.obstacles()
        self._is_free = holds_everywhere(self._obstacles, np.logical_not)
        self._is_occupied = holds_everywhere(self._obstacles, lambda values: values)
        farthest = deepest = 0.0
        if view == "per-map" and not self._is_free and not self._is_occupied:
            for block in swept(self._obstacles):
                part, mask = field.part(block), self._obstacles[block]
                farthest = max(farthest, field.strength * _largest_distance_in(part, mask))
                deepest = max(deepest, _deepest_in(part, mask))
        # rounding writes 0.15 instead of 0.15000000000000002, three cells of 0.05 m, into files
        farthest, deepest = (float(f"{metres:.15g}") for metres in (farthest, deepest))
        self.scale = ViewScale(view, view_range, farthest, deepest)

    def values(self, cost_of: CostOfView | None = None) -> SignedBytes:
        make = partial(self._values_of_rows, cost_of)
        return made_by_rows(self._field.distance, np.int8, make, is_cached=cost_of is not None)

    def _values_of_rows(self, cost_of: CostOfView | None, rows: slice) -> SignedBytes:
        field, obstacles = self._field.part(rows), self._obstacles[rows]

        def value_of(metres: Floats) -> Floats:
            metres = field.strength * metres
            view = self.scale.values_of(metres, field.resolution)
            np.minimum(view, map_values.OCCUPIED - 1, out=view)
            return view if cost_of is None else cost_of(view, metres)

        if self._is_free:
            values = np.zeros(field.shape, dtype=np.int8)
        elif self._is_occupied:
            values = np.full(field.shape, map_values.OCCUPIED, dtype=np.int8)
        else:
            constant_from = self.scale.end / field.strength
            farthest = min(constant_from, math.hypot(*self._field.shape) * field.resolution)
            values = _bytes_of_metres(field, obstacles, value_of, farthest)

        def set_rows(rows: slice) -> None:
            is_unknown = field.occupancy[rows] == map_values.UNKNOWN
            np.copyto(values[rows], map_values.UNKNOWN, where=is_unknown)
            np.copyto(values[rows], map_values.OCCUPIED, where=obstacles[rows])

        for_rows(set_rows, values.shape)
        return values


def _parameters_from_layers(layers: CostmapLayers) -> dict[str, object] | None:
    rule = layers.obstacle_rule
    return None if rule is None else {"lethal_threshold": rule[0], "unknown": rule[1]}


@command.stage(
    name="esdf",
    group="Maps, distance fields, costmaps",
    example="""\
mapdeal esdf examples/maps/office.yaml -o out/esdf.npz --image out/esdf.png
mapdeal esdf examples/maps/office.yaml -o out/view.yaml --view-range 1.0""",
    summary="Compute the exact signed distance field of a map.",
    title=lambda _: "signed distance field",
    memory=6.0,
    view=field_view,
    view_passes=lambda view: 1 if view["view"] == "per-map" else 0,
    passes=1,
    in_simulation=command.InSimulation({"unknown": "occupied"}),
    remark=command.remark_on_obstacles,
    parameters_from_layers=_parameters_from_layers,
)
def esdf(
    grid: OccupancyGrid,
    *,
    unknown: map_values.UnknownPolicy = "free",
    convention: map_values.Convention = "fast-planner",
    max_distance: Annotated[float, command.ABOVE_0, command.METRES] | None = None,
    lethal_threshold: command.LethalThreshold = map_values.DEFAULT_LETHAL_THRESHOLD,
    strength: Annotated[float, command.STRENGTH, command.FACTOR] = 1.0,
) -> DistanceField:
    """Compute the exact signed Euclidean distance field of a map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    unknown : {'free', 'occupied'}
        What unknown cells count as.
    convention : {'fast-planner', 'center', 'border'}
        Where the distance is zero; see the documentation. With d the distance from a free cell's
        centre to the nearest obstacle cell's centre, and d_in from an obstacle cell's centre to
        the nearest free cell's, in metres: ``fast-planner`` d and resolution - d_in, zero on the
        outermost obstacle cells (Fast-Planner and robot_costmap); ``center`` d and -d_in;
        ``border`` d - resolution / 2 and resolution / 2 - d_in, zero on the edge between the cells
        (grid_map).
    max_distance : float, optional
        Distance to which both signs are clipped, metres.
    lethal_threshold : int
        Least occupancy of an obstacle, 1..100.
    strength : float
        Factor of positive distances. It is applied after clipping. Views and threshold costs use
        the distances times the factor; the other costs ignore it.

    Returns
    -------
    DistanceField
        Distances in metres as float32: exact squared distances, rounded once. Before clipping they
        are all +inf for a map without obstacles, and all -inf for a map without free cells.

    Examples
    --------
    >>> grid = OccupancyGrid([[100, 100, 0, 0]], resolution=0.5)
    >>> esdf(grid).distance.tolist()
    [[-0.5, 0.0, 0.5, 1.0]]
    >>> esdf(grid, convention="border").distance.tolist()
    [[-0.75, -0.25, 0.25, 0.75]]
    """
    obstacles = obstacles_in(grid.occupancy, lethal_threshold, unknown)
    blocks = list(blocks_of(obstacles))
    halos: list[Halo | None] = [None]
    if len(blocks) > 1:
        halos = [*halos_of([runs_of(obstacles[block]) for block in swept(obstacles)])]
    by_start = {block.start: halo for block, halo in zip(blocks, halos, strict=True)}
    outside_shift, inside_shift = _shifts(convention, grid.resolution)

    def distances(rows: slice) -> Metres:
        return signed_distance(
            obstacles[rows], scale=grid.resolution, outside_shift=outside_shift,
            inside_shift=inside_shift, clip=math.inf if max_distance is None else max_distance,
            gain=strength, halo=by_start[rows.start],
        )  # fmt: skip

    return DistanceField(
        made_by_rows(obstacles, np.float32, distances, is_cached=True), grid.occupancy,
        grid.resolution, grid.origin, convention=convention, strength=strength,
        max_distance=max_distance, lethal_threshold=lethal_threshold, unknown=unknown,
    )  # fmt: skip
