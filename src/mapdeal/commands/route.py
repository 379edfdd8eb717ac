"""``mapdeal route``: ways through a map, between two points or between many pairs of them."""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, cast, overload

from mapdeal import errors, records
from mapdeal.command import FACTOR, METRES, REPULSION, OnlyInPython, Output, Words, command
from mapdeal.compatibility import Unpack
from mapdeal.grid import reaching, route_graph, values
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint, FootprintLike, shape_of
from mapdeal.grid.frame import Point
from mapdeal.grid.reach import Method, Route, reach_radius
from mapdeal.maps.route_graphs import read_route_graph
from mapdeal.pictures import canvas, layers
from mapdeal.pictures.overlay import Overlays, RouteOverlay
from mapdeal.pictures.reach import GraphOverlay
from mapdeal.pipeline import inputs
from mapdeal.pipeline.folder import Spread, rounded, rounded_place
from mapdeal.pipeline.recipe import Recipe, load_recipe, planned_shape
from mapdeal.planning import routes
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import NumberLines, read_pairs
from mapdeal.stages.potential import CAP, GAIN, potential

# Uses of the distance field: none, in the cost of a step, or in the heuristic.
SEARCHES = ("plain", "cost", "heuristic")

_RECIPE = "nav2"
# bytes for each cell, those of the recipe included
_PER_CELL: dict[Method, float] = {"astar": 36, "descent": 126, "geodesic": 56, "graph": 36}
_PER_CELL_OF_PAIRS, _PER_CELL_OF_HEURISTIC = 60.0, 16.0
_HEURISTIC_WEIGHT = 2.0  # default at an obstacle, metres: the lack of a clearance of 2 m
_FIELD_WEIGHT = 1.0  # default for the search cost: at an obstacle a metre costs one more
_MEANS = {  # columns of the table of means: attributes of routes, and how they are written
    "mean_clearance": "{:.3f} m",
    "min_clearance": "{:.3f} m",
    "length": "{:.2f} m",
    "cost": "{:.2f}",
    "expanded": "{:.0f}",
}


@records.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlannedRoute(Route, Spread):
    """A `Route` through a map, with the costs that it was planned on.

    Parameters
    ----------
    map : MapInput
        The map.
    costs : Costmap
        Costs of the map, or those that were given.
    graph : RouteGraph, optional
        The graph that the route goes by.
    has_robot : bool
        Whether the costs were given, or are those of a given robot.
    """

    spread = ("points",)
    map: inputs.MapInput
    costs: Costmap
    graph: route_graph.RouteGraph | None = None
    has_robot: bool = True

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether the goal is reached, or the border on the way to one beyond the map."""
        return self.reached or self.beyond_window

    def document(self) -> dict[str, Any]:
        return route_document(self)

    def lines(self) -> Iterator[str]:
        if not len(self.points_xy):
            yield "not reached"
            return
        text = f"{self.length:.2f} m, cost {self.cost:.2f}, {len(self.points_xy)} points"
        if math.isfinite(self.min_clearance):
            text += f", at least {self.min_clearance:.2f} m from obstacles"
            text += f", {self.mean_clearance:.2f} m on average"
        text += "" if self.has_robot else f"; no robot is given: recipe {_RECIPE}, radius 0.22 m"
        ending = "to the border, the goal is beyond it" if self.beyond_window else "not reached"
        yield text if self.reached else f"{ending}: {text}"

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        if title is None:
            title = f"{self.map.title}: route, {self.method}"
            has_field = self.method == "astar" and not self.optimal
            title += ", field in the heuristic" if has_field else ""
        below = () if self.graph is None else (GraphOverlay(self.graph, is_below=True),)
        overlay = Overlays((*below, RouteOverlay(self)))
        return layers.cost_image(self.costs, title=title, overlay=overlay, **look)

    def check(self) -> None:
        """Raise FindingError if the goal is not reached, nor the border on the way to it."""
        if self.passes:
            return
        goal = f"{self.goal[0]:.10g}, {self.goal[1]:.10g}"
        hint = None
        if self.local_minimum is not None:
            x, y = (round(value, 3) + 0.0 for value in self.local_minimum)
            rule = f"stopped at {x:.10g}, {y:.10g}, in a local minimum of the potential over "
            rule += "open cells"
            hint = "every potential may have some; --method geodesic finds its way around them"
        elif len(self.points_xy):
            rule = f"stopped after {self.length:.4g} m on the way to {goal}"
        elif self.method == "graph":
            rule = f"no route on the graph leads to {goal}"
            hint = "mapdeal lint MAP --graph checks it: parts, one-way edges, nodes in walls"
        else:
            rule = f"no route leads to {goal}"
            hint = "lethal and inscribed cells are closed; --image shows them"
            if (self.costs.cost == self.costs.unknown_value).any():
                hint = "lethal, inscribed and unknown cells are closed; --image shows them, "
                hint += "--through-unknown opens the unknown ones"
        raise errors.FindingError(rule, source=self.map.name, hint=hint)


@records.dataclass(frozen=True, eq=False, repr=False)
class PairedRoutes(Spread):
    """Routes of many pairs of points, found as these are read; `searches` finds one each way."""

    pairs: Iterable[NumberLines]
    pairs_in: Path | str
    searches: Mapping[str, Callable[[Point, Point], Route]]
    counts: Counter[str] = records.field(default_factory=Counter)
    sums: dict[tuple[str, str], float] = records.field(default_factory=lambda: defaultdict(float))

    def parts(self) -> Iterator[str]:
        for line, places, error in chain.from_iterable(map(NumberLines.rows, self.pairs)):
            self.counts["pairs"] += 1
            number = self.counts["pairs"]
            found, failure = self._found(places, error)
            if failure:
                self.counts["failed"] += 1
                yield json.dumps({"pair": number, "line": line, **failure})
                continue
            is_reached = all(route.reached for route in found.values())
            self.counts["unreached"] += not is_reached
            for search, route in found.items():
                for name in _MEANS if is_reached else ():
                    figure = getattr(route, name)
                    self.sums[search, name] += math.nan if figure is None else figure
                yield json.dumps({"pair": number, "method": search, **_entries(route)})
        if not self.counts["pairs"]:
            raise errors.MalformedInputError("holds no pairs of points", source=self.pairs_in)

    def _found(
        self, places: Sequence[float], error: str | None
    ) -> tuple[dict[str, Route], dict[str, Any]]:
        if error is not None:
            return {}, {"error": error}
        start, goal = (places[0], places[1]), (places[2], places[3])
        try:
            return {name: find(start, goal) for name, find in self.searches.items()}, {}
        except errors.ParameterError as refusal:
            ends = {"start": rounded_place(*start), "goal": rounded_place(*goal)}
            return {}, {**ends, "error": str(refusal), **_without_none(hint=refusal.hint)}

    @property
    def reached(self) -> int:
        return self.counts["pairs"] - self.counts["failed"] - self.counts["unreached"]

    def document(self) -> dict[str, Any]:
        return {"routes": list(map(json.loads, self.parts()))}

    def summary(self, output: Path) -> Iterator[str]:
        yield f"{output}: {self.counts['pairs']} pairs by {', '.join(self.searches)}"

    def lines(self) -> Iterator[str]:
        for entry in map(json.loads, self.parts()):
            text = "not reached"
            if "error" in entry:
                text = entry["error"]
            elif entry["reached"]:
                text = f"{entry['length_m']:.2f} m, cost {entry['cost']:.2f}"
            by = f", {entry['method']}" if "method" in entry else ""
            yield f"pair {entry['pair']}{by}: {text}"

    def remarks(self) -> Iterator[str]:
        if not self.reached:
            return
        titles = (name.replace("_", " ") for name in _MEANS)
        rows = [[f"means of {values.count_text(self.reached, 'pair')}", *titles]]
        for search in self.searches:
            means = {name: self.sums[search, name] / self.reached for name in _MEANS}
            texts = [_MEANS[name].format(mean) if math.isfinite(mean) else "-"
                     for name, mean in means.items()]  # fmt: skip
            rows.append([f"  {search}", *texts])
        first, *widths = (max(map(len, column)) for column in zip(*rows, strict=True))
        for head, *texts in rows:
            yield "  ".join([head.ljust(first), *map(str.rjust, texts, widths)])

    def check(self) -> None:
        count, failed, unreached = (self.counts[key] for key in ("pairs", "failed", "unreached"))
        if failed:
            rule = f"{failed} of {count} pairs have no routes"
            raise errors.BatchError(rule, source=self.pairs_in)
        if unreached:
            rule = f"no route leads from start to goal in {unreached} of {count} pairs"
            raise errors.FindingError(rule, source=self.pairs_in)


def route_document(route: Route) -> dict[str, Any]:
    document = {"method": route.method, **_entries(route)}
    if route.method == "descent":
        document["local_minimum"] = route.local_minimum and rounded_place(*route.local_minimum)
    if route.beyond_window:
        document["beyond_window"] = True
    return {**document, "points": [list(map(rounded, point)) for point in route.points_xy.tolist()]}


def _entries(route: Route) -> dict[str, Any]:
    return {
        "reached": route.reached, "start": rounded_place(*route.start),
        "goal": rounded_place(*route.goal), "length_m": rounded(route.length),
        "min_clearance_m": rounded(route.min_clearance),
        "mean_clearance_m": rounded(route.mean_clearance), "cost": rounded(route.cost),
        "expanded": route.expanded, "optimal": route.optimal,
    }  # fmt: skip


def _point(text: str) -> tuple[float, ...]:
    return inputs.numbers_of(text, "X,Y")


@overload
def route(map: inputs.Map, *, start: Point, goal: Point, **options: Any) -> PlannedRoute: ...
@overload
def route(map: inputs.Map, *, pairs: str | PathLike[str], **options: Any) -> PairedRoutes: ...
@command(  # type: ignore[misc]  # it has names for all options
    group="Questions about a map",
    output=Output(
        "OUT.json", "Write the result to a file, with --pairs a .jsonl; by default it is printed, "
        "on a terminal as lines, elsewhere as JSON.",
        is_required=False, streams=False,
    ),
    json="default",
    shared=("robot", "mask", "files"),
    example="""\
mapdeal route examples/maps/office.yaml --from -7.5,2.5 --to 9,5 \\
    -o out/route.json --image out/route.png
mapdeal route examples/maps/office.yaml \\
    --pairs examples/points/office_pairs.csv -o out/pairs.jsonl""",
)  # fmt: skip
def route(
    map: inputs.Map,  # noqa: A002 - what it is
    *,
    start: Annotated[Point | None, Words("X,Y", _point, "from")] = None,
    goal: Annotated[Point | None, Words("X,Y", _point, "to")] = None,
    pairs: Annotated[str | PathLike[str] | None, Words("FILE|-", typed=Path)] = None,
    compare: Annotated[Sequence[str] | None, Words("METHOD,...", lambda t: t.split(","))] = None,
    method: Method | None = None,
    graph: Annotated[Path | None, Words("GRAPH.geojson")] = None,
    global_map: Annotated[inputs.Map | None, Words("GLOBAL", name="map", typed=Path)] = None,
    through_unknown: bool = False,
    cost_travel_multiplier: Annotated[float, FACTOR] = 2.0,
    field_weight: Annotated[float | None, Words("W")] = None,
    heuristic: Literal["octile", "field"] | None = None,
    heuristic_weight: Annotated[float | None, METRES] = None,
    attractive_gain: Annotated[float | None, GAIN, FACTOR] = None,
    repulsive_gain: Annotated[float | None, GAIN, FACTOR] = None,
    repulsive_cap: Annotated[float | None, CAP, REPULSION] = None,
    footprint: FootprintLike | None = None,
    robot_radius: Annotated[float | None, OnlyInPython] = None,
    robot: Annotated[RobotParameters | None, Words()] = None,
    mask: Annotated[inputs.Map | None, Words()] = None,
    **reading: Unpack[inputs.Reading],
) -> PlannedRoute | PairedRoutes:
    """Find a route between two points.

    Lethal, inscribed and unknown cells are closed. A map gets the costs of --params-file, or else
    those of the recipe nav2; the shape of a robot replaces its radius of 0.22 m. With
    --pairs, one line is printed for each pair and method, and their means on stderr. To a goal
    beyond the map, the route ends at the border cell with the least cost so far plus remaining
    distance, with a warning.

    Parameters
    ----------
    map : path, str or grid
        Costs (.npz), or a map to compute costs from.
    start : tuple of float
        Start, metres.
    goal : tuple of float
        Goal, metres.
    pairs : path, optional
        File of starts and goals, one x,y,x,y or JSON each, instead of both; - reads stdin.
    compare : sequence of {'plain', 'cost', 'heuristic'}, optional
        With pairs: search without the distance field (plain), with it in the cost, or in the
        heuristic; by default all three.
    method : {'astar', 'descent', 'geodesic', 'graph'}, optional
        Cheapest route over cells (astar, the default), steepest descent of the potential (descent),
        shortest route in any direction (geodesic), or the cheapest on a graph (the default there).
    graph : path, optional
        Route graph to follow: a GeoJSON file for Nav2's route server.
    global_map : path or grid, optional
        Map or costs of the surroundings, for the distance from the border to a goal outside the map
        or in a closed-off part of it; the straight distance by default.
    through_unknown : bool
        Treat unknown cells as free, at the highest cost.
    cost_travel_multiplier : float
        Weight of costs against length.
    field_weight : float, optional
        astar: weight of the distance field in the cost, within 2 m of obstacles; 0 by default, 1
        for the method cost of --pairs.
    heuristic : {'octile', 'field'}, optional
        astar: estimate of the remaining cost, the octile distance (octile, the default), or that
        plus a penalty within 2 m of obstacles (field).
    heuristic_weight : float, optional
        Penalty of the heuristic field at an obstacle, metres; 2 by default.
    attractive_gain : float, optional
        descent: weight of the distance to the goal; 1 by default.
    repulsive_gain : float, optional
        descent: weight of the repulsion; 1 by default.
    repulsive_cap : float, optional
        descent: upper bound of the repulsion; 1e5 by default.
    footprint, robot : Footprint, RobotParameters, optional
        The robot's shape and own parameters, for the costs of a map.
    robot_radius : float, optional
        Radius of a round robot, metres, instead of a footprint.
    mask : path or grid, optional
        Keepout mask over the costs, as for `apply_keepout_mask`.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to a file.

    Returns
    -------
    PlannedRoute or PairedRoutes
        The route, also if it does not reach the goal, see `Route.reached`; with pairs, the routes
        of all of them, found as their `parts` are read.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If start or goal is outside the map or in a closed cell, or parameters do not go together.

    Examples
    --------
    >>> from mapdeal import Costmap
    >>> wall = Costmap([[0, 0, 0], [0, 254, 254], [0, 0, 0]], 0.5)
    >>> found = route(wall, start=(1.25, 0.25), goal=(1.25, 1.25))
    >>> found.reached, round(found.length, 6)
    (True, 2.414214)
    """
    footprint = shape_of(footprint, robot_radius)
    repulsion: Any = {"repulsive_gain": repulsive_gain, "repulsive_cap": repulsive_cap}
    gains = _without_none(attractive_gain=attractive_gain, **repulsion)
    of_field = _without_none(field_weight=field_weight, heuristic_weight=heuristic_weight)
    weights: Any = {"cost_travel_multiplier": cost_travel_multiplier}
    weights["through_unknown"] = through_unknown
    if method is None:
        method = "astar" if graph is None else "graph"
    if method == "graph" and graph is None:
        raise errors.ParameterError("graph needs --graph, a file", place="method")
    if method != "graph":
        inputs.refuse(f"does not apply to method {method}", graph=graph)
    if pairs is not None:
        of_one = {"start": start, "goal": goal, "heuristic": heuristic}
        image = inputs.settings_of(**reading).image
        inputs.refuse("applies to one route, not to pairs", **of_one, image=image)
        if method == "graph":
            inputs.refuse("are for methods astar, descent and geodesic", pairs=pairs)
        compared: tuple[str, ...] = (method,)
        if method == "astar":
            compared = tuple(dict.fromkeys(SEARCHES if compare is None else compare))
            if not compared or not set(compared) <= set(SEARCHES):
                rule = f"must be some of {', '.join(SEARCHES)}"
                raise errors.ParameterError(rule, place="compare", got=",".join(compared))
        for name, search in (("field_weight", "cost"), ("heuristic_weight", "heuristic")):
            if name in of_field and search not in compared:
                rule = f"needs {search} among the methods to compare"
                raise errors.ParameterError(rule, place=name)
        if method != "astar":
            inputs.refuse("compares routes of method astar", compare=compare)
        if method != "descent":
            inputs.refuse(f"does not apply to method {method}", **gains)
        inputs.need_ending(".jsonl")
        chunks, pairs_in = inputs.text_in(pairs)
        files = [pairs_in] if isinstance(pairs_in, Path) else []
        per_cell = max(_PER_CELL_OF_PAIRS, _PER_CELL[method])
        source, costs = _costs_of(map, footprint, robot, mask, files, per_cell, reading)
        with inputs.errors_named(source.name):
            terrain = routes.Terrain.of(costs, **weights)
            searches = {name: _search_by(name, terrain, gains, **of_field) for name in compared}
        return PairedRoutes(read_pairs(chunks, pairs_in), pairs_in, searches)
    inputs.refuse("applies to pairs alone", compare=compare)
    if start is None or goal is None:
        rule = "both are required, unless pairs are given"
        raise errors.ParameterError(rule, place="start, goal")
    inputs.numbers_of(goal, "X,Y", place="goal")
    if method != "descent":
        inputs.refuse(f"does not apply to method {method}", **gains)
    if method != "astar":
        inputs.refuse(f"does not apply to method {method}", **of_field, heuristic=heuristic)
    if heuristic == "field":
        of_field.setdefault("heuristic_weight", _HEURISTIC_WEIGHT)
    elif heuristic_weight is not None:
        raise errors.ParameterError("applies to heuristic field alone", place="heuristic_weight")
    inputs.need_ending(".json")
    per_cell = _PER_CELL[method] + _PER_CELL_OF_HEURISTIC * bool(of_field.get("heuristic_weight"))
    followed = None if graph is None else read_route_graph(graph)
    files = [] if graph is None else [graph]
    shape = (footprint, robot, mask, files, per_cell, reading)
    source, costs = _costs_of(map, *shape, is_local=global_map is not None)
    global_costs = None if global_map is None else _costs_of(global_map, *shape)[1]
    known = None if global_costs is None else routes.Terrain.of(global_costs, **weights)
    with inputs.errors_named(source.name):
        terrain = routes.Terrain.of(costs, **weights, **_without_none(field_weight=field_weight))
        if followed is not None:
            found = routes.route_on_graph(terrain, followed, start, goal)
        else:
            name = "heuristic" if heuristic == "field" else method
            weight = _without_none(heuristic_weight=heuristic_weight)
            find, by_length = _search_by(name, terrain, gains, **weight), method != "astar"
            found = routes.route_in_window(
                terrain, find, start, goal, by_length=by_length, known=known
            )
            warn_of_border(found, costs)
    has_robot = footprint is not None or robot is not None or isinstance(source.grid, Costmap)
    return PlannedRoute(**vars(found), map=source, costs=costs, graph=followed, has_robot=has_robot)


def warn_of_border(route: Route, costs: Costmap) -> None:
    """Warn if a route to a goal beyond a map ends at its border, so that --strict refuses it."""
    if route.beyond_window:
        (x, y), (end_x, end_y) = route.goal, route.points_xy[-1].round(3).tolist()
        place = "not reachable within" if costs.frame.contains([route.goal])[0] else "beyond"
        text = f"the goal {x:.10g}, {y:.10g} is {place} the map: the route ends at its border, at "
        errors.emit_warning(f"{text}{end_x + 0.0:.10g}, {end_y + 0.0:.10g}")


def _without_none(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _search_by(
    name: str, terrain: routes.Terrain, gains: Mapping[str, Any], *,
    field_weight: float = _FIELD_WEIGHT, heuristic_weight: float = _HEURISTIC_WEIGHT,
) -> Callable[[Point, Point], Route]:  # fmt: skip
    if name == "geodesic":
        return partial(routes.shortest_over, terrain)
    if name == "descent":
        published = terrain.costmap.to_occupancy()
        lethal = published.with_values(published.occupied().astype("int8") * values.OCCUPIED)
        repulsion = potential(lethal, **gains)

        def descend(start: Point, goal: Point) -> Route:
            surface = records.replace(repulsion, goal=goal).downhill_surface()
            return routes.descend_on(terrain, surface, start, goal)

        return descend
    search: dict[str, Any] = {}
    if name == "cost":
        search = {"weights": terrain.weights_near_obstacles(field_weight)}
    elif name == "heuristic":
        search = {"surcharges": routes.surcharges_near_obstacles(terrain, heuristic_weight)}
    return partial(routes.route_over, terrain, **search)


def _costs_of(
    map: inputs.Map,  # noqa: A002 - as the command calls it
    footprint: Footprint | None, robot: RobotParameters | None, mask: inputs.Map | None,
    files: Sequence[Path], per_cell: float, reading: inputs.Reading, *, is_local: bool = False,
) -> tuple[inputs.MapInput, Costmap]:  # fmt: skip
    """Return a map and its costs: those in the file, the robot's, or the recipe ``nav2``'s."""
    over = inputs.mask_of(mask, inputs.settings_of(**reading))
    also = [*(robot.paths if robot else ()), *files, *(over.files if over else ())]
    (source,) = inputs.open_inputs(map, names=("map",), also=also, **reading)
    inputs.claim_cells(source, per_cell, measures=True)
    grid = source.grid
    if isinstance(grid, Costmap):
        rule = "applies to maps: these costs are already computed"
        if not is_local:  # otherwise they are for the global map
            inputs.refuse(rule, robot=robot, footprint=footprint)
        return source, grid if over is None else over.over(grid)
    if getattr(grid, "cost_travel_multiplier", 0):
        rule = "is a weighted potential field: routes do not follow its cost_to_go"
        hint = "route COSTS.npz --method astar --cost-travel-multiplier K weighs costs"
        raise errors.ParameterError(rule, source=source.name, hint=hint)
    inputs.warn_of_values(source)
    if robot is not None:
        inputs.warn_of_robot(source.name, grid, robot)
    with inputs.errors_named(source.name):
        for step in _recipe_for(footprint, robot).steps:
            if over is not None and step.accepts_mask:
                grid, over = over.costs_of(step, grid, source.path)[1], None
            elif not (step.stage.product_type is DistanceField and isinstance(grid, DistanceField)):
                grid = step.apply(grid, source.path)
        shape = planned_shape(robot, footprint)
        costs = cast("Costmap", grid)
        costs = costs if shape is None else _closed_to(shape, costs, obstacles=robot is None)
        return source, costs if over is None else over.over(costs)


def _closed_to(robot: Footprint, costs: Costmap, *, obstacles: bool) -> Costmap:
    """Return costs with 253 at the edge, and around obstacles, wherever ``reach`` is closed."""
    # Without `obstacles` the costs have the last word around these, to the last bit.
    cost = costs.cost.copy()
    is_lethal = cost == values.LETHAL_OBSTACLE
    closed = reaching.largest_closed_square(reach_radius(robot), costs.frame)
    is_closed = reaching.squares_to(is_lethal & obstacles) <= closed
    cost[is_closed & ~is_lethal] = values.INSCRIBED_INFLATED_OBSTACLE
    return records.replace(costs, cost=cost)


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
    change = {"cost.inflation_radius": max(cost["inflation_radius"], reach)}
    return load_recipe(_RECIPE, change, footprint=footprint)
