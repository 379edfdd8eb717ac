"""Stage ``potential``: repulsion from all obstacles, attraction to a goal."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mapdeal.command import FACTOR, POINT, REPULSION, Condition, LethalThreshold, stage
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.field import LARGEST_GAIN, LARGEST_REPULSION, PotentialField
from mapdeal.grid.frame import check_point
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.lookup import sum_of_inverse_distances
from mapdeal.stages.cost import ObstacleSource, obstacles_of

GAIN = Condition(f"between 0 and {LARGEST_GAIN:g}", lambda value: 0 <= value <= LARGEST_GAIN)
CAP = Condition(
    f"above 0, at most {LARGEST_REPULSION:g}", lambda value: 0 < value <= LARGEST_REPULSION
)

LEAST_DISTANCE = 0.001
"""Metres up to which terms are omitted: the distance of a cell to itself is 0."""


@stage(
    name="potential",
    group="Questions about a map",
    example="""\
mapdeal potential examples/maps/office.yaml -o out/potential.npz --goal 9,5 \\
    --attractive-gain 50 --image out/potential.png""",
    summary="Compute the artificial potential field of a map.",
    details="Repulsion is the sum of 1 / distance to every obstacle cell. MAP may also be a "
    "distance field, whose obstacles then count.",
    title=lambda parameters: "potential field" if parameters["goal"] else "repulsive field",
    memory=125.0,
    is_whole=lambda _: True,
    passes_output_on=False,
)
def potential(
    source: ObstacleSource,
    *,
    goal: Annotated[tuple[float, float], POINT] | None = None,
    repulsive_cap: Annotated[float, CAP, REPULSION] = 1e5,
    attractive_gain: Annotated[float, GAIN, FACTOR] = 1.0,
    repulsive_gain: Annotated[float, GAIN, FACTOR] = 1.0,
    lethal_threshold: LethalThreshold | None = None,
) -> PotentialField:
    """Compute the artificial potential field of a map.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map, or its distance field, whose obstacles are then used.
    goal : tuple of float, optional
        Attracting point in the map frame. Without one there is only repulsion.
    repulsive_cap : float
        Upper bound of the repulsion, per metre.
    attractive_gain : float
        Weight of the distance to the goal.
    repulsive_gain : float
        Weight of the repulsion.
    lethal_threshold : int, optional
        Least occupancy of an obstacle, 1..100; 100 for a map, the field's own for a field.

    Returns
    -------
    PotentialField
        Its layers: ``repulsive``, min(repulsive_cap, sum of 1 / d over ALL obstacle cells) with d
        in metres between cell centres, omitting terms with d <= 0.001 m; ``attractive``, the
        distance to the goal in metres; ``potential``, the sum of both times their gains;
        ``gradient`` and ``gradient_magnitude`` of the potential, or of the repulsion if there is no
        goal.

    Raises
    ------
    ParameterError
        If the goal lies in an obstacle.

    Warns
    -----
    MapdealWarning
        If the goal lies outside the map.

    Notes
    -----
    The sums are exact up to rounding. Every obstacle cell counts, so that repulsion grows with the
    number of cells in a wall: with cells of half the size it is twice as strong. For the distance
    to the nearest obstacle see `esdf`.

    References
    ----------
    O. Khatib, "Real-Time Obstacle Avoidance for Manipulators and Mobile Robots", 1986, for the
    idea. The sum over all obstacle cells follows the ROS package robot_costmap.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> field = potential(OccupancyGrid([[100, 0, 100, 0]], resolution=0.5), goal=(1.75, 0.25))
    >>> field.repulsive.round(6).tolist()
    [[1.0, 4.0, 1.0, 2.666667]]
    >>> field.attractive.round(6).tolist()
    [[1.5, 1.0, 0.5, 0.0]]
    """
    obstacles = np.asarray(obstacles_of(source, lethal_threshold))
    if goal is not None:
        cells, inside = source.frame.bounded_rowcol_from_xy([check_point(goal, "goal")])
        if not inside[0]:
            text = f"potential: the goal {goal[0]:.10g}, {goal[1]:.10g} lies outside of the map"
            emit_warning(text, stacklevel=3)
        elif obstacles[tuple(cells[0])]:
            raise ParameterError("lies in an obstacle", place="goal", got=goal)
    repulsive = sum_of_inverse_distances(
        obstacles, scale=source.resolution, least=LEAST_DISTANCE * (1 + 1e-9)
    )
    return PotentialField(
        np.minimum(repulsive, repulsive_cap),
        np.where(obstacles, np.int8(OCCUPIED), np.asarray(source.occupancy)),
        source.resolution,
        source.origin,
        goal=goal,
        attractive_gain=attractive_gain,
        repulsive_gain=repulsive_gain,
        repulsive_cap=repulsive_cap,
    )
