"""Stage ``potential``: repulsion from all obstacles, attraction to a goal."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from mapdeal import command, errors
from mapdeal.grid import costmap, frame as frames, values
from mapdeal.grid.field import LARGEST_GAIN, LARGEST_REPULSION, DistanceField, PotentialField
from mapdeal.grid.footprint import Footprint, FootprintLike, shape_of
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import reach_radius, robot_text
from mapdeal.kernels import arrays, lookup
from mapdeal.stages.cost import obstacles_of

GAIN = command.Condition(f"between 0 and {LARGEST_GAIN:g}", lambda v: 0 <= v <= LARGEST_GAIN)
CAP = command.Condition(
    f"above 0, at most {LARGEST_REPULSION:g}", lambda value: 0 < value <= LARGEST_REPULSION
)
MULTIPLIER = command.Condition("between 0 and 1e6", lambda value: 0 <= value <= 1e6)
LEAST_DISTANCE = 0.001  # metres; nearer terms are omitted, as that of the cell itself


@command.stage(
    name="potential",
    group="Questions about a map",
    example="""\
mapdeal potential examples/maps/office.yaml -o out/potential.npz --goal 9,5 \\
    --attractive-gain 50 --image out/potential.png""",
    summary="Compute the artificial potential field of a map.",
    details="Repulsion is the sum of 1 / distance to every obstacle cell. MAP may also be a "
    "distance field, whose obstacles then count. With a goal, cost_to_go is the length of the "
    "shortest path to it around obstacles, for the given robot; --cost-travel-multiplier weighs it "
    "by the costs of MAP or of the robot.",
    title=lambda parameters: "potential field" if parameters["goal"] else "repulsive field",
    memory=125.0,
    of_library=20_000_000,  # scipy.fft
    is_whole=lambda _: True,
    passes_output_on=False,
    remark=command.remark_on_obstacles,
    needs_costs=lambda parameters: parameters["cost_travel_multiplier"] > 0,
    robot=command.RobotShape("radius", ("footprint",), lambda footprint: {"footprint": footprint}),
    in_place_of={"footprint": command.InPlaceOf("radius", lambda p: reach_radius(p["footprint"]))},
    where_it_fits=("with_cost_to_go", "cost_to_go and its gradient", 200.0),
)
def potential(
    source: OccupancyGrid | DistanceField | costmap.Costmap,
    *,
    goal: Annotated[tuple[float, float], command.POINT] | None = None,
    repulsive_cap: Annotated[float, CAP, command.REPULSION] = 1e5,
    attractive_gain: Annotated[float, GAIN, command.FACTOR] = 1.0,
    repulsive_gain: Annotated[float, GAIN, command.FACTOR] = 1.0,
    lethal_threshold: command.LethalThreshold | None = None,
    radius: Annotated[float, command.AT_LEAST_0, command.METRES, command.FromRobot] = 0.0,
    footprint: FootprintLike | None = None,
    through_unknown: bool = False,
    cost_travel_multiplier: Annotated[float, MULTIPLIER, command.FACTOR] = 0.0,
    with_cost_to_go: Annotated[bool, command.OnlyInPython] = True,
) -> PotentialField:
    """Compute the artificial potential field of a map.

    Parameters
    ----------
    source : OccupancyGrid, DistanceField or Costmap
        The map, or its distance field, whose obstacles are then used, or costs as ROS publishes
        them; paths to the goal do not lead through closed costs, 253 and 254.
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
    radius : float
        Radius of a round robot, for `cost_to_go`, metres; 0 is a point.
    footprint : Footprint, optional
        The robot's corners, instead of a radius, or in a recipe {radius: R} for a round robot.
    through_unknown : bool
        Whether paths to the goal lead through unknown cells.
    cost_travel_multiplier : float
        Weight of costs against length in `cost_to_go`, as for `route`; above 0 for costs.
    with_cost_to_go : bool
        Whether to compute `cost_to_go` if there is a goal.

    Returns
    -------
    PotentialField
        Its layers: ``repulsive``, min(repulsive_cap, sum of 1 / d over ALL obstacle cells) with d
        in metres between cell centres, omitting terms with d <= 0.001 m; ``attractive``, the
        distance to the goal in metres; ``potential``, the sum of both times their gains;
        ``gradient`` and ``gradient_magnitude`` of the potential, or of the repulsion if there is no
        goal; ``cost_to_go``, the length of the shortest way to the goal around obstacles, metres,
        inf where `reach` does not get to, and ``cost_to_go_gradient``. With
        `cost_travel_multiplier` k, a metre costs 1 + k * cost / 252, or / 98 on scale
        ``occupancy``.

    Raises
    ------
    ParameterError
        If the goal lies in an obstacle, or a map has no costs to weigh.

    Warns
    -----
    MapdealWarning
        If the goal lies outside the map, or the robot cannot stand there.

    Notes
    -----
    Ways lead through the cells that are open to the robot in `reach`. Their lengths are those of
    the eikonal equation of first order, over the eight triangles around each cell centre: exact
    within 10 cells of the goal in sight of it, at most 1.2 % too long in the open, and up to a cell
    too long for each corner that a way passes, 2 % on average in dense clutter.

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
    costs = source if isinstance(source, costmap.Costmap) else None
    if cost_travel_multiplier and costs is None:
        hint = "give a costmap, --params-file, or in a recipe the stage cost before"
        raise errors.ParameterError("needs costs", place="cost_travel_multiplier", hint=hint)
    source = source.to_occupancy() if isinstance(source, costmap.Costmap) else source
    obstacles = np.asarray(obstacles_of(source, lethal_threshold))
    occupancy = np.where(obstacles, np.int8(values.OCCUPIED), np.asarray(source.occupancy))
    cost_to_go = cost_to_go_of = None
    if goal is not None:
        cells, inside = source.frame.bounded_rowcol_from_xy([frames.check_point(goal, "goal")])
        if not inside[0]:
            text = f"potential: the goal {goal[0]:.10g}, {goal[1]:.10g} lies outside of the map"
            errors.emit_warning(text)
        elif obstacles[tuple(cells[0])]:
            raise errors.ParameterError("lies in an obstacle", place="goal", got=goal)
        if with_cost_to_go:
            robot = shape_of(footprint) or (Footprint.circle(radius) if radius > 0 else None)
            options = robot, costs, cost_travel_multiplier, through_unknown
            cost_to_go = _costs_to(goal, occupancy, source.frame, *options)
            cost_to_go_of = robot_text(robot)
            if inside[0] and np.isinf(cost_to_go[tuple(cells[0])]):
                text = f"the goal {goal[0]:.10g}, {goal[1]:.10g} is closed to {cost_to_go_of}"
                errors.emit_warning(f"potential: {text}: cost_to_go is inf everywhere")
    least = LEAST_DISTANCE * (1 + 1e-9)
    repulsive = lookup.sum_of_inverse_distances(obstacles, scale=source.resolution, least=least)
    return PotentialField(
        np.minimum(repulsive, repulsive_cap), occupancy, source.resolution, source.origin,
        goal=goal, attractive_gain=attractive_gain, repulsive_gain=repulsive_gain,
        repulsive_cap=repulsive_cap, cost_to_go=cost_to_go, cost_to_go_of=cost_to_go_of,
        cost_travel_multiplier=0.0 if cost_to_go is None else cost_travel_multiplier,
    )  # fmt: skip


def _costs_to(
    goal: frames.Point, occupancy: arrays.SignedBytes, frame: frames.Frame, robot: Footprint | None,
    costs: costmap.Costmap | None, weight: float, through_unknown: bool,
) -> arrays.Floats:  # fmt: skip
    """Return the least cost of a way from each cell to a goal, in metres; inf if none."""
    from mapdeal.grid.reaching import Ground, cells_open_to  # slow to import
    from mapdeal.kernels.paths import lengths_to, weighted_lengths_to

    place = frame.place_in_cell(goal)
    if place is None:
        return np.full(occupancy.shape, np.inf)
    ground = Ground(occupancy, frame, through_unknown)
    is_open = cells_open_to(ground, robot, (math.floor(place[0]), math.floor(place[1])))
    if costs is None:
        return lengths_to(is_open, place) * frame.resolution
    weights = costmap.travel_weights(costs, weight, through_unknown=through_unknown)
    classes = np.where(is_open, costs.cost.view(np.uint8), np.uint8(values.LETHAL_OBSTACLE))
    return weighted_lengths_to(classes, weights, place) * frame.resolution
