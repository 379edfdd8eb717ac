"""Where a robot can go from a start, the passages that stop it, and a route to a goal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.grid import footprint, frame
from mapdeal.grid.occupancy import OccupancyGrid, as_occupancy_layer
from mapdeal.grid.values import UNKNOWN, OneLineRepr, count_text, decimal_text, numbers_text

PlaceOfLimit = Literal["passage", "start", "goal"]
Method = Literal["astar", "descent", "geodesic", "graph"]
_ROUNDING = 12  # decimals of widths: twice six cells of 0.05 m are 0.6 m, not a last bit more
_DECIMALS = 9  # of figures; further digits are rounding errors
MOST_HEADINGS = 255  # as many as a byte of the layer `Reach.headings` can count


@records.dataclass(frozen=True, repr=False)
class Goal(OneLineRepr):
    """A place that a robot should reach.

    Parameters
    ----------
    x, y : float
        Position in the map frame, metres.
    name : str, optional
        Name of the goal.
    """

    x: float
    y: float
    name: str | None = None

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            value = getattr(self, name)
            errors.require(isinstance(value, Real), "must be a number", name, got=value)

    @property
    def label(self) -> str:
        """Name of the goal, or its position if it has no name."""
        return f"{self.x + 0.0:.10g},{self.y + 0.0:.10g}" if self.name is None else self.name

    def _repr_parts(self) -> Iterator[str]:
        if self.name is not None:
            yield self.name
        yield numbers_text((self.x, self.y))


@records.dataclass(frozen=True, repr=False)
class Bottleneck(OneLineRepr):
    """The narrowest place on the widest route to a goal.

    Parameters
    ----------
    x, y : float
        Position in the map frame, metres.
    width : float
        Twice the distance from this place to the centre of the nearest obstacle cell or cell
        outside the map, metres. A round robot passes if its diameter is smaller.
    at : {'passage', 'start', 'goal'}
        Kind of place: along the route, or the start or the goal itself.
    """

    x: float
    y: float
    width: float
    at: PlaceOfLimit = "passage"

    @property
    def text(self) -> str:
        """Short description of the place and its width."""
        if self.at != "passage":
            return f"the room at the {self.at} is {self.width:.4g} m wide"
        return f"a passage at {self.x + 0.0:.4g},{self.y + 0.0:.4g} is {self.width:.4g} m wide"

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.width:.4g} m at {numbers_text((self.x, self.y))}"
        yield f"the {self.at}"


@records.dataclass(frozen=True, repr=False)
class GoalReach(OneLineRepr):
    """Whether a robot can reach a goal, and what limits it.

    Parameters
    ----------
    goal : Goal
        The goal.
    reachable : bool
        Whether the robot can reach it in any heading.
    heading_count : int
        Number of headings in which it can reach the goal; all or none for a round robot.
    widest_radius : float
        Limit below which the radius of a round robot must lie to reach the goal, metres; 0 if no
        robot can, however small.
    limited_by : Bottleneck, optional
        Place that limits this radius; None for a wall without a passage.
    reason : str, optional
        Why the robot cannot stand at the goal; None if it can.
    nearest_open : tuple of float, optional
        Centre of the nearest cell in which the robot can stand, if not at the goal itself.
    """

    goal: Goal
    reachable: bool
    heading_count: int
    widest_radius: float
    limited_by: Bottleneck | None = None
    reason: str | None = None
    nearest_open: frame.Point | None = None

    @property
    def stopped_by(self) -> str | None:
        """Why the robot does not get there, in words; None if it does, or for want of a way."""
        if self.reachable:
            return None
        if self.reason is not None:
            return f"its cell is {self.reason}"
        return None if self.limited_by is None else self.limited_by.text

    def _repr_parts(self) -> Iterator[str]:
        yield repr(self.goal)
        headings = count_text(self.heading_count, "heading")
        yield f"reachable in {headings}" if self.reachable else "not reachable"
        yield f"widest_radius {self.widest_radius:.4g} m"
        if self.limited_by is not None:
            yield repr(self.limited_by)


@records.dataclass(frozen=True, repr=False)
class Passage(OneLineRepr):
    """A place that stops a robot or barely lets it pass.

    Parameters
    ----------
    x, y : float
        Midpoint in the map frame, metres.
    width : float
        Width as in `Bottleneck`, metres.
    cut_off : float
        Area behind the passage, seen from the start, that is open to the robot and lost if it
        cannot pass, square metres.
    is_open : bool
        Whether the robot can pass.
    ends : tuple of two points
        Centres of the cells on either side at the narrowest point, obstacles or outside the map.
    """

    x: float
    y: float
    width: float
    cut_off: float
    is_open: bool
    ends: tuple[frame.Point, frame.Point]

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.width:.4g} m at {numbers_text((self.x, self.y))}"
        yield "open" if self.is_open else "closed"
        yield f"{decimal_text(self.cut_off)} m2 behind it"


@records.dataclass(frozen=True, eq=False, repr=False)
class Reach(frame.Framed):
    """The cells that a robot can reach from a start, and the widths of the routes.

    Parameters
    ----------
    reachable : array_like of uint8, shape (H, W)
        1 where the robot's centre can get to in any heading, else 0.
    headings : array_like of uint8, shape (H, W)
        Number of headings in which the robot can stand in the cell, reached or not; all or none
        for a round robot.
    clearance : array_like of float32, shape (H, W)
        Distance from the cell centre to that of the nearest obstacle cell or cell outside the map,
        metres; 0 in obstacles, nan outside the analysed part of the map.
    widest : array_like of float32, shape (H, W)
        Limit below which the radius of a round robot must lie to get there from the start,
        metres; 0 where no robot can.
    occupancy : array_like of int8, shape (H, W)
        The map: 100 is an obstacle, -1 unknown, everything else free.
    resolution, origin
        As for `OccupancyGrid`.
    start : tuple of float
        x and y in the map frame (metres), and the yaw (radians) if one was given.
    robot : Footprint, optional
        Robot shape; None for a point.
    heading_count : int
        Number of headings, evenly spaced from 0.
    through_unknown : bool
        Whether unknown cells are open.
    goals : tuple of GoalReach
        Results for the goals.
    passages : tuple of Passage
        Passages that stop the robot or barely let it pass, the narrowest first.
    """

    kind = "reach"
    layer_names = ("reachable", "headings", "clearance", "widest", "occupancy")
    parameter_names = ("start", "robot", "heading_count", "through_unknown")
    reachable: NDArray[np.uint8]
    headings: NDArray[np.uint8]
    clearance: NDArray[np.float32]
    widest: NDArray[np.float32]
    occupancy: NDArray[np.int8]
    resolution: float
    origin: frame.Origin = (0.0, 0.0, 0.0)
    start: tuple[float, ...] = (0.0, 0.0)
    robot: footprint.Footprint | None = None
    heading_count: int = 72
    through_unknown: bool = False
    goals: tuple[GoalReach, ...] = ()
    passages: tuple[Passage, ...] = ()

    def __post_init__(self) -> None:
        count, rule = self.heading_count, f"must be from 1 to {MOST_HEADINGS}"
        errors.require(1 <= count <= MOST_HEADINGS, rule, "heading_count", got=count)
        dtypes: tuple[type[np.generic], ...] = (np.uint8, np.uint8, np.float32, np.float32)
        named = zip(self.layer_names, dtypes, strict=False)  # the map is checked apart
        layers = {name: frame.as_layer(getattr(self, name), dtype, name) for name, dtype in named}
        self._freeze(**layers, occupancy=as_occupancy_layer(self.occupancy))

    @property
    def grid(self) -> OccupancyGrid:
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    @property
    def outside_values(self) -> dict[str, float]:
        """Value of each layer in cells added around the grid."""
        closed = dict.fromkeys(("reachable", "headings", "widest"), 0)
        return {**closed, "clearance": np.nan, "occupancy": UNKNOWN}

    @property
    def cell_area(self) -> float:
        """Area of a cell, square metres."""
        return self.resolution * self.resolution

    @property
    def reachable_area(self) -> float:
        """Area of the cells that the robot's centre can get to, square metres."""
        return int(np.count_nonzero(self.reachable)) * self.cell_area

    @property
    def open_area(self) -> float:
        """Area of the cells in which the robot can stand, reached or not, square metres."""
        return int(np.count_nonzero(self.headings)) * self.cell_area

    @property
    def free_area(self) -> float:
        """Area of the free cells, square metres; unknown cells count if they are open."""
        least = -1 if self.through_unknown else 0
        free = (self.occupancy >= least) & (self.occupancy < 100) & ~np.isnan(self.clearance)
        return int(np.count_nonzero(free)) * self.cell_area

    @property
    def share(self) -> float:
        """Reachable area as a share of the free area; 0 if nothing is free."""
        free = self.free_area
        return self.reachable_area / free if free else 0.0

    def _own_figures(self) -> frame.Figures:
        reasons = [(answer.goal.label, answer.stopped_by) for answer in self.goals]
        return {
            "start": list(self.start),
            "reachable_m2": round(self.reachable_area, _DECIMALS),
            "open_m2": round(self.open_area, _DECIMALS),
            "free_m2": round(self.free_area, _DECIMALS),
            "share": round(self.share, _DECIMALS),
            "goals": {answer.goal.label: answer.reachable for answer in self.goals},
            "passages": len(self.passages),
            "closed_passages": sum(not passage.is_open for passage in self.passages),
            "stopped_by": {label: reason for label, reason in reasons if reason is not None},
        }

    def _repr_parameters(self) -> Iterator[str]:
        yield f"start {numbers_text(self.start)}"
        yield "a point" if self.robot is None else repr(self.robot)

    def _repr_values(self) -> Iterator[str]:
        yield f"reaches {decimal_text(self.reachable_area)} of {decimal_text(self.open_area)} m2"
        if self.goals:
            got = sum(answer.reachable for answer in self.goals)
            yield f"{got} of {count_text(len(self.goals), 'goal')}"
        yield count_text(len(self.passages), "passage")

    def entries(self) -> dict[str, Any]:
        """Return the layers, the map, the start and the robot; the results are in the JSON."""
        entries = {**super().entries(), "start": np.array(self.start, dtype=np.float64)}
        entries["heading_count"] = np.uint8(self.heading_count)
        entries["through_unknown"] = np.uint8(self.through_unknown)
        if self.robot is not None:
            vertices = np.array(self.robot.vertices, dtype=np.float64).reshape(-1, 2)
            entries |= {"robot": vertices, "robot_radius": np.float64(self.robot.radius)}
        return entries


@records.dataclass(frozen=True, eq=False, repr=False)
class Route(OneLineRepr):
    """A route from a start to a goal.

    Parameters
    ----------
    method : {'astar', 'descent', 'geodesic', 'graph'}
        Search method.
    reached : bool
        Whether the last point is the goal.
    start, goal : tuple of float
        x and y in the map frame, metres.
    points_xy : numpy.ndarray of float64, shape (N, 2)
        Points of the route in the map frame, from the start, metres; empty if there is no route.
    length : float
        Length of the route, metres.
    cost : float
        Sum over the segments of length in metres times the weight of the cell where they end.
    min_clearance : float
        Smallest distance from a point of the route to the centre of an obstacle cell, metres;
        +inf without obstacles, nan without points.
    local_minimum : tuple of float, optional
        Local minimum of the potential, other than the goal, in which a descent ended.
    mean_clearance : float
        Mean distance to obstacles along the route, metres: each segment counts with its length
        and the mean clearance of its two ends; +inf without obstacles, nan without points.
    expanded : int, optional
        Number of cells, or nodes of a graph, that the search expanded; None for a descent.
    optimal : bool
        Whether the search guarantees the lowest cost.
    beyond_window : bool
        Whether the route ends at the border of the map, on the best way found to a goal beyond it.
    """

    method: Method
    reached: bool
    start: tuple[float, float]
    goal: tuple[float, float]
    points_xy: NDArray[np.float64] = records.field(default_factory=lambda: np.empty((0, 2)))
    length: float = math.nan
    cost: float = math.nan
    min_clearance: float = math.nan
    local_minimum: tuple[float, float] | None = None
    mean_clearance: float = math.nan
    expanded: int | None = None
    optimal: bool = False
    beyond_window: bool = False

    def __post_init__(self) -> None:
        points = np.asarray(self.points_xy, dtype=np.float64).reshape(-1, 2).view()
        points.flags.writeable = False
        object.__setattr__(self, "points_xy", points)

    def _repr_parts(self) -> Iterator[str]:
        yield self.method
        beyond = ", beyond the window" if self.beyond_window else ""
        yield "reached" if self.reached else f"not reached{beyond}"
        yield f"{numbers_text(self.start)} to {numbers_text(self.goal)}"
        if len(self.points_xy):
            yield count_text(len(self.points_xy), "point")
            yield f"{self.length:.6g} m"
            yield f"cost {self.cost:.6g}"
            yield f"clearance {self.min_clearance:.4g} m"
        if self.local_minimum is not None:
            yield f"local minimum at {numbers_text(self.local_minimum)}"


def reach_radius(robot: footprint.Footprint | None) -> float:
    """Return the radius of the largest round robot that fits wherever a robot does, metres."""
    # For a robot with corners it is the inscribed radius, or 0 if the centre lies outside of it.
    if robot is None or (robot.vertices and not footprint.contains_centre(robot.vertices)):
        return 0.0
    return robot.inscribed_radius


def robot_text(robot: footprint.Footprint | None) -> str:
    if robot is None:
        return "a point"
    if not robot.vertices:
        return f"a robot of radius {robot.radius:.4g} m"
    radii = f"{robot.inscribed_radius:.4g} to {robot.circumscribed_radius:.4g} m"
    return f"a robot with {len(robot.vertices)} corners, radius {radii}"


def width_of(square: int, resolution: float) -> float:
    """Return the width of a place, metres, given its squared distance from obstacles in cells."""
    # It is twice the distance: a round robot passes if its radius is below half of it.
    return round(2 * math.sqrt(square) * resolution, _ROUNDING)
