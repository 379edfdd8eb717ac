"""Stage ``esdf``: the exact signed Euclidean distance field, and its 0..100 view."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.field import DistanceField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    DEFAULT_LETHAL_THRESHOLD,
    FREE,
    OCCUPIED,
    UNKNOWN,
    Convention,
    UnknownPolicy,
)
from mapdeal.kernels.distance import signed_squared_distance, unreachable
from mapdeal.stages.parameters import ABOVE_0, LETHAL, STRENGTH, stage

View = Literal["metric", "seed"]


@stage
def esdf(
    grid: OccupancyGrid,
    *,
    unknown: UnknownPolicy = "free",
    convention: Convention = "seed",
    max_distance: Annotated[float, ABOVE_0] | None = None,
    lethal_threshold: Annotated[int, LETHAL] = DEFAULT_LETHAL_THRESHOLD,
    strength: Annotated[float, STRENGTH] = 1.0,
) -> DistanceField:
    """Return the signed distance of every cell to the nearest obstacle's edge.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    unknown : {'free', 'occupied'}
        What unknown cells count as.
    convention : {'seed', 'center', 'border'}
        With d the distance from a free cell's centre to the nearest obstacle cell's centre, and
        d_in from an obstacle cell's centre to the nearest free cell's, in metres:
        ``seed`` d and resolution - d_in, so 0 on the outermost obstacle cells (Fast-Planner
        and design document 000); ``center`` d and -d_in; ``border`` d - resolution / 2 and
        resolution / 2 - d_in, zero on the edge between the cells (grid_map).
    max_distance : float, optional
        Metres to clip both signs to.
    lethal_threshold : int
        Occupancy from which a cell is an obstacle.
    strength : float
        Factor for the positive distances, applied after clipping: the k of design document 000.

    Returns
    -------
    DistanceField
        float32 metres, exact squared distances rounded once. All +inf for a map without
        obstacles, all -inf for one without free cells, before clipping.

    Examples
    --------
    >>> grid = OccupancyGrid([[100, 100, 0, 0]], resolution=0.5)
    >>> esdf(grid).distance.tolist()
    [[-0.5, 0.0, 0.5, 1.0]]
    >>> esdf(grid, convention="border").distance.tolist()
    [[-0.75, -0.25, 0.25, 0.75]]
    """
    occupied = grid.occupied(lethal_threshold)
    if unknown == "occupied":
        occupied = occupied | grid.unknown()
    squared = signed_squared_distance(occupied)
    endless = np.abs(squared) == unreachable(squared)
    metres = np.sqrt(np.abs(squared), dtype=np.float64)
    metres *= grid.resolution
    metres[endless] = np.inf
    if convention == "border":
        metres -= 0.5 * grid.resolution
    np.negative(metres, out=metres, where=occupied)
    if convention == "seed":
        np.add(metres, grid.resolution, out=metres, where=occupied)
    if max_distance is not None:
        np.clip(metres, -max_distance, max_distance, out=metres)
    if strength != 1.0:
        np.multiply(metres, strength, out=metres, where=~occupied)
    return DistanceField(
        metres.astype(np.float32),
        grid.occupancy,
        grid.resolution,
        grid.origin,
        convention=convention,
        strength=strength,
        max_distance=max_distance,
        lethal_threshold=lethal_threshold,
        unknown=unknown,
    )


@stage
def field_view(
    field: DistanceField,
    *,
    view: View = "metric",
    view_range: Annotated[float, ABOVE_0] = 2.0,
) -> OccupancyGrid:
    """Return the field as values 0..100 that grow towards obstacles.

    Parameters
    ----------
    field : DistanceField
        The field; its convention and strength make no difference, since the view is of the
        distance between cell centres.
    view : {'metric', 'seed'}
        ``metric``: trunc(100 (1 - min(d, view_range) / view_range)), the same on every map.
        ``seed``: trunc(100 (D - d) / (D - resolution + I)), scaled between the map's own
        largest free distance D and deepest obstacle I, as design document 000 has it.
    view_range : float
        Metres at which the metric view reaches 0.

    Returns
    -------
    OccupancyGrid
        100 on obstacles, -1 on unknown cells that are not obstacles, 0 elsewhere if the map
        has no obstacle.

    Examples
    --------
    >>> grid = OccupancyGrid([[100, 0, 0, -1]], resolution=0.5)
    >>> field_view(esdf(grid)).occupancy.tolist()
    [[100, 75, 50, -1]]
    """
    obstacles = field.obstacles()
    values = np.full(field.shape, FREE, dtype=np.int8)
    if obstacles.any():
        distance = _centre_distance(field)
        if view == "metric":
            values[:] = 100 * (1 - np.minimum(distance, view_range) / view_range)
        elif not obstacles.all():
            farthest = float(distance[~obstacles].max())
            deepest = float(field.depth_in_obstacle().max())
            span = farthest - field.resolution + deepest
            values[~obstacles] = (100 * (farthest - distance) / span)[~obstacles]
    values[field.occupancy == UNKNOWN] = UNKNOWN
    values[obstacles] = OCCUPIED
    return OccupancyGrid(values, field.resolution, field.origin)


def _centre_distance(field: DistanceField) -> NDArray[np.float64]:
    """Return metres to the nearest obstacle's centre, as far as the field has kept them."""
    distance = np.sqrt(field.squared_cells_to_obstacle()) * field.resolution
    if field.max_distance is not None:
        furthest = field.max_distance
        if field.convention == "border":
            furthest += 0.5 * field.resolution
        np.minimum(distance, furthest, out=distance)
    return distance


def reach_is_kept(field: DistanceField, reach: float) -> bool:
    """Return whether the field tells all distances up to `reach` metres apart.

    A clipped field does not know its cells at exactly the clip from those beyond it.
    """
    if field.max_distance is None:
        return True
    kept = field.max_distance
    if field.convention == "border":
        kept += 0.5 * field.resolution
    return kept > reach * (1 + 1e-6) and math.isfinite(reach)
