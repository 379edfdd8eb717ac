"""Stage ``inflate``: obstacles grown by the robot's radius."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal import command, errors
from mapdeal.command import AT_LEAST_0, METRES, InPlaceOf, LethalThreshold, RobotShape
from mapdeal.grid.footprint import FootprintLike, shape_of
from mapdeal.grid.frame import RADIUS_TOLERANCE, cells_to_cover, largest_square_within
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import holds_everywhere, made_by_windows
from mapdeal.kernels.distance import inflated


@command.stage(
    name="inflate",
    group="Maps, distance fields, costmaps",
    example="""\
mapdeal inflate examples/maps/office.yaml -o out/inflated.yaml --radius 0.25
mapdeal inflate examples/maps/office.yaml -o out/shape.yaml \\
    --footprint '[[0.3,0.2],[0.3,-0.2],[-0.3,-0.2],[-0.3,0.2]]'""",
    product="inflated",
    summary="Grow obstacles by a radius or by a robot's shape.",
    title=lambda parameters: f"inflated by {parameters['radius']:.4g} m ({parameters['kernel']})",
    memory=2.0,
    robot=RobotShape("radius", ("footprint",), lambda footprint: {"footprint": footprint}),
    remark=command.remark_on_obstacles,
    in_place_of={"footprint": InPlaceOf("radius", lambda p: p["footprint"].circumscribed_radius)},
)
def inflate(
    grid: OccupancyGrid,
    *,
    radius: Annotated[float, AT_LEAST_0, METRES] = 0.3,
    footprint: FootprintLike | None = None,
    kernel: Literal["disc", "square"] = "disc",
    lethal_threshold: LethalThreshold = DEFAULT_LETHAL_THRESHOLD,
    inflate_unknown: bool = True,
) -> OccupancyGrid:
    """Grow all obstacles of a map by a radius.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    radius : float
        Inflation radius, metres.
    footprint : Footprint, optional
        The robot's corners, or in a recipe {radius: R} for a round robot; the circumscribed radius
        replaces `radius`.
    kernel : {'disc', 'square'}
        Shape to grow obstacles by: a disc, or a square of cells.
        ``disc``: cells whose centre lies within `radius` of an obstacle cell's centre.
        ``square``: cells within ceil(radius / resolution) cells along both axes.
    lethal_threshold : int
        Least occupancy of an obstacle, 1..100.
    inflate_unknown : bool
        Whether inflation covers unknown cells. Those inside the kernel then become occupied;
        otherwise they stay unknown.

    Returns
    -------
    OccupancyGrid
        The map with cells inside the kernel set to 100; all others keep their value.

    Warns
    -----
    MapdealWarning
        If a disc covers no cell but its own, or every cell becomes occupied.

    Examples
    --------
    >>> grid = OccupancyGrid([[0, 0, -1, 0, 100]], resolution=0.1)
    >>> inflate(grid, radius=0.2).occupancy.tolist()
    [[0, 0, 100, 100, 100]]
    """
    if (shape := shape_of(footprint)) is not None:
        radius = shape.circumscribed_radius
    side = grid.resolution
    write = partial(inflated, value=OCCUPIED, protected=None if inflate_unknown else UNKNOWN)
    if kernel == "disc" and 0 < radius < side - RADIUS_TOLERANCE:
        text = f"inflate: radius {radius:g} m is below a cell of {side:g} m and has no effect"
        errors.emit_warning(text)

    def inflated_rows(rows: slice) -> NDArray[np.int8]:
        values = grid.occupancy[rows]
        if kernel == "square":
            reach = cells_to_cover(min(radius, max(values.shape) * side), side)
            return write(values, lethal_threshold, reach=reach)
        limit = largest_square_within(min(radius, math.hypot(*values.shape) * side), side)
        return write(values, lethal_threshold, square=limit)

    halo = cells_to_cover(min(radius, max(grid.shape) * side), side) + 1
    occupancy = made_by_windows(grid.occupancy, np.int8, inflated_rows, halo=halo)
    is_full = holds_everywhere(occupancy, lambda values: values == OCCUPIED)
    if is_full and not holds_everywhere(grid.occupancy, lambda v: v >= lethal_threshold):
        errors.emit_warning(f"inflate: radius {radius:g} m leaves no cell of the map free")
    return OccupancyGrid(occupancy, side, grid.origin)
