"""Routes on the map or the costs in a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from mapdeal.errors import BatchError, FindingError, MalformedInputError, ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import reach_radius
from mapdeal.grid.reaching import largest_closed_square, squares_to
from mapdeal.grid.route import Method, Route
from mapdeal.grid.values import INSCRIBED_INFLATED_OBSTACLE, LETHAL_OBSTACLE, OCCUPIED
from mapdeal.maps.reading import Source
from mapdeal.pictures.overlay import RouteOverlay
from mapdeal.pipeline.documents import failed_line, route_json, route_line
from mapdeal.pipeline.inputs import (
    add_picture,
    errors_named,
    outputs_of,
    read_input,
    warn_of_potential,
    warn_of_published_costs,
)
from mapdeal.pipeline.recipe import Recipe, load_recipe, planned_shape
from mapdeal.pipeline.settings import Settings
from mapdeal.planning.routes import (
    Terrain,
    descend,
    route_over,
    shortest_route,
    surcharges_near_obstacles,
)
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import PairLine
from mapdeal.stages.potential import potential

Heuristic = Literal["octile", "field"]

_RECIPE = "nav2"
_PER_CELL: dict[Method, float] = {"astar": 36.0, "descent": 126.0}
"""Bytes for each cell, those of the recipe included."""

_OF_HEURISTIC = 16.0
"""Bytes for each cell that the field in the heuristic takes."""

PLACES_OF_FIELD = ("plain", "cost", "heuristic")
"""Where the distance field acts: nowhere, in the cost of a step, or in the heuristic."""

HEURISTIC_WEIGHT = 2.0
"""Metres that the field adds to the heuristic at an obstacle, if no weight is given: what is
missing there to a clearance of 2 m."""


@dataclass(frozen=True)
class RouteReport:
    """A route, and its JSON text."""

    route: Route
    text: str


def route_file(
    path: Path,
    output: Path | None,
    options: Settings,
    *,
    start: tuple[float, float],
    goal: tuple[float, float],
    method: Method = "astar",
    footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
    weights: Mapping[str, Any] | None = None,
    gains: Mapping[str, Any] | None = None,
) -> RouteReport:
    """Find a route through the map or the costs in a file, and write it if `output` is given."""
    if output is not None and output.suffix != ".json":
        raise ParameterError("a route is written as .json", source=output)
    has_field = bool(weights and weights.get("heuristic_weight"))
    source = read_input(path, options, _PER_CELL[method] + has_field * _OF_HEURISTIC)
    outputs = [] if output is None else [output]
    inputs = [*source.files, *(robot.paths if robot else ())]
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            costmap = costs_of(source, path, footprint, robot)
            if method == "astar":
                route = shortest_route(costmap, start, goal, **(weights or {}))
            else:
                published = costmap.to_occupancy()
                lethal = published.with_values(published.occupied().astype("int8") * OCCUPIED)
                field = potential(lethal, goal=goal, **(gains or {}))
                route = descend(costmap, field, start, **(weights or {}))
        text = route_json(route)
        if output is not None:
            transaction.write_bytes(output, f"{text}\n".encode())
        title = f"{path.stem}: route, {method}"
        title += ", field in the heuristic" if has_field else ""
        add_picture(transaction, options, costmap, title, RouteOverlay(route))
    return RouteReport(route, text)


def check_reached(route: Route, path: Path) -> None:
    if route.reached:
        return
    goal = f"{route.goal[0]:.10g}, {route.goal[1]:.10g}"
    if route.local_minimum is None and len(route.points_xy):
        raise FindingError(f"stopped after {route.length:.4g} m on the way to {goal}", source=path)
    if route.local_minimum is None:
        rule = f"no route leads to {goal}"
        hint = "lethal, inscribed and unknown cells are closed; --image shows them, "
        hint += "--through-unknown opens the unknown ones"
        raise FindingError(rule, source=path, hint=hint)
    x, y = (round(value, 3) + 0.0 for value in route.local_minimum)
    rule = f"stopped at {x:.10g}, {y:.10g}, in a local minimum of the potential over open cells"
    hint = "every potential may have some; --method astar finds its way around them"
    raise FindingError(rule, source=path, hint=hint)


def costs_of(
    source: Source, path: Path, footprint: Footprint | None, robot: RobotParameters | None = None
) -> Costmap:
    """Return the costs in a file, or those of its map: the robot's, or the recipe ``nav2``'s."""
    grid = source.grid
    if isinstance(grid, Costmap):
        if footprint is not None or robot is not None:
            rule = "applies to maps: these costs are already computed"
            option = "--footprint, --robot-radius" if robot is None else "--params-file"
            raise ParameterError(rule, source=option)
        return grid
    warn_of_published_costs(source, path)
    warn_of_potential(grid, path)
    for step in _recipe_for(footprint, robot).steps:
        if not (step.stage.makes is DistanceField and isinstance(grid, DistanceField)):
            grid = step.apply(grid, path)
    if not isinstance(grid, Costmap):
        raise TypeError("the recipe of routes must end in costs")
    shape = footprint
    if shape is None and robot is not None:
        shape = planned_shape(robot)
    return grid if shape is None else _closed_to(shape, grid, obstacles=robot is None)


def _closed_to(robot: Footprint, costs: Costmap, *, obstacles: bool) -> Costmap:
    """Return costs with 253 at the edge, and around obstacles, wherever ``reach`` is closed."""
    # Without `obstacles` the costs have the last word around these, to the last bit.
    cost = costs.cost.copy()
    is_lethal = cost == LETHAL_OBSTACLE
    squared = squares_to(is_lethal & obstacles)
    closed = largest_closed_square(reach_radius(robot), costs.frame)
    cost[(squared <= closed) & ~is_lethal] = INSCRIBED_INFLATED_OBSTACLE
    return replace(costs, cost=cost)


def _recipe_for(footprint: Footprint | None, robot: RobotParameters | None = None) -> Recipe:
    """Return the recipe, for a large robot with as much room for its costs as for its own."""
    if robot is not None:
        return load_recipe(None, footprint=footprint, robot=robot)
    recipe = load_recipe(_RECIPE)
    if footprint is None:
        return recipe
    cost = recipe.steps[-1].parameters
    beyond = cost["inflation_radius"] - cost["inscribed_radius"]
    reach = max(footprint.inscribed_radius + beyond, footprint.circumscribed_radius)
    setting = f"{recipe.steps[-1].name}.inflation_radius={max(cost['inflation_radius'], reach)!r}"
    return load_recipe(_RECIPE, footprint=footprint, settings=[setting])


FIELD_WEIGHT = 1.0
"""Of method ``cost``, if none is given: at an obstacle a metre costs one more."""

_PER_CELL_OF_PAIRS = 60.0
"""Bytes for each cell, those of the recipe included."""

_AVERAGED = ("mean_clearance", "min_clearance", "length", "cost", "expanded")


@dataclass(frozen=True)
class PairsReport:
    """What has become of pairs of points."""

    pairs: int
    failed: int
    unreached: int
    means: dict[str, dict[str, float]]

    @property
    def reached(self) -> int:
        return self.pairs - self.failed - self.unreached

    def check(self, source: Path | str) -> None:
        """Raise an error if a pair has no routes, or its goal was not reached."""
        if self.failed:
            raise BatchError(f"{self.failed} of {self.pairs} pairs have no routes", source=source)
        if self.unreached:
            rule = f"no route leads from start to goal in {self.unreached} of {self.pairs} pairs"
            raise FindingError(rule, source=source)


class _Tally:
    """Counts and sums of routes, whose points are not kept: there may be any number of pairs."""

    def __init__(self, methods: Iterable[str]) -> None:
        self._sums = {method: dict.fromkeys(_AVERAGED, 0.0) for method in methods}
        self._failed = self._reached = self._unreached = 0

    def add(self, found: Mapping[str, Route]) -> None:
        """Count a pair by what each method has found; nothing if it could not be planned."""
        if not found:
            self._failed += 1
        elif not all(route.reached for route in found.values()):
            self._unreached += 1
        else:
            self._reached += 1
            for method, route in found.items():
                for name in _AVERAGED:
                    self._sums[method][name] += getattr(route, name)

    def report(self) -> PairsReport:
        """Return what was counted."""
        pairs = self._failed + self._reached + self._unreached
        means = {
            method: {name: value / self._reached for name, value in sums.items()}
            for method, sums in self._sums.items()
            if self._reached
        }
        return PairsReport(pairs, self._failed, self._unreached, means)


def compare_pairs(
    path: Path,
    asked: Iterable[PairLine],
    output: Path | None,
    options: Settings,
    *,
    asked_from: Path | str,
    methods: Sequence[str] = PLACES_OF_FIELD,
    footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
    weights: Mapping[str, Any] | None = None,
    field_weight: float = FIELD_WEIGHT,
    heuristic_weight: float = HEURISTIC_WEIGHT,
    show: Callable[[str], object] = lambda _: None,
) -> PairsReport:
    """Find routes of pairs of points by each method, and write a line of JSON for each."""
    if output is not None and output.suffix != ".jsonl":
        raise ParameterError("routes of pairs are written as .jsonl", source=output)
    if not methods or not set(methods) <= set(PLACES_OF_FIELD):
        rule = f"must be some of {', '.join(PLACES_OF_FIELD)}"
        raise ParameterError(rule, source="--compare", got=",".join(methods))
    if options.image is not None:
        raise ParameterError("applies to one route, not to --pairs", source="--image")
    source = read_input(path, options, _PER_CELL_OF_PAIRS)
    outputs = [] if output is None else [output]
    inputs = [*source.files, *(robot.paths if robot else ())]
    inputs += [asked_from] if isinstance(asked_from, Path) else []
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            terrain = Terrain.of(costs_of(source, path, footprint, robot), **(weights or {}))
            searches = {
                method: _search_of(method, terrain, field_weight, heuristic_weight)
                for method in dict.fromkeys(methods)
            }
        tally = _Tally(searches)
        lines = _lines_of(asked, terrain, searches, tally)
        if output is None:
            for line in lines:
                show(line)
        else:
            transaction.write_parts(output, (f"{line}\n".encode() for line in lines))
        report = tally.report()
        if report.pairs == 0:
            raise MalformedInputError("holds no pairs of points", source=asked_from)
    return report


def _search_of(
    method: str, terrain: Terrain, field_weight: float, heuristic_weight: float
) -> dict[str, Any]:
    """Return what a method hands to `route_over`."""
    if method == "cost":
        return {"weights": terrain.weights_near_obstacles(field_weight)}
    if method == "heuristic":
        return {"surcharges": surcharges_near_obstacles(terrain, heuristic_weight)}
    return {}


def _lines_of(
    asked: Iterable[PairLine],
    terrain: Terrain,
    searches: Mapping[str, Mapping[str, Any]],
    tally: _Tally,
) -> Iterator[str]:
    """Yield the lines of each pair once it is planned, and counted."""
    for pair, one in enumerate(asked, 1):
        found, texts = _answer(pair, one, terrain, searches)
        tally.add(found)
        yield from texts


def _answer(
    pair: int, asked: PairLine, terrain: Terrain, searches: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Route], list[str]]:
    """Return the route of each method between two points, and the lines that describe them."""
    if asked.start is None or asked.goal is None:
        return {}, [failed_line(asked, pair=pair, error=str(asked.error))]
    try:
        found = {
            method: route_over(terrain, asked.start, asked.goal, **search)
            for method, search in searches.items()
        }
    except ParameterError as error:
        return {}, [failed_line(asked, pair=pair, error=str(error), hint=error.hint)]
    return found, [route_line(route, pair=pair, method=method) for method, route in found.items()]
