"""``mapdeal graph``: a graph of nodes and edges that Nav2's route server follows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, cast

from mapdeal import errors, records
from mapdeal.command import ABOVE_0, METRES, Output, Result, Words, command
from mapdeal.commands.reach import RobotOption, StartOption, goals_of, lethal_costs
from mapdeal.compatibility import Unpack
from mapdeal.grid import costmap, route_graph
from mapdeal.grid.footprint import FootprintLike, shape_of
from mapdeal.grid.reach import Goal, Reach, reach_radius
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.maps.route_graphs import write_graph
from mapdeal.pictures import canvas, layers
from mapdeal.pictures.reach import GraphOverlay
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.folder import rounded
from mapdeal.pipeline.step import make_step
from mapdeal.planning import graph_drafts, route_graphs
from mapdeal.ros.robot import RobotParameters

_PER_CELL, _PER_COARSE_CELL = 46.0, 70.0  # bytes besides those of the reach, and of the skeleton
_LIBRARIES = 55_000_000  # bytes that parts of scipy take
_LITTLE = 1e-6  # of the area


@records.dataclass(frozen=True, eq=False, repr=False)
class PlannedGraph(Result):
    """A route graph of a map, and how much of the robot's reach it covers.

    Parameters
    ----------
    map : MapInput
        The map.
    reach : Reach
        The cells that the robot reaches.
    result : GraphResult
        The graph, and the areas that it covers.
    cover : float
        Longest path from a reached cell to a node, metres.
    """

    map: inputs.MapInput
    reach: Reach
    result: graph_drafts.GraphResult
    cover: float

    @property
    def graph(self) -> route_graph.RouteGraph:
        """The graph."""
        return self.result.graph

    @property
    def min_clearance(self) -> float:
        """Least distance from the edges to cells that are not free, metres; 0 without edges."""
        found = (float(edge.metadata["min_clearance"]) for edge in self.graph.edges)
        return min(found, default=0.0)

    def document(self) -> dict[str, Any]:
        kinds = Counter(str(node.metadata["kind"]) for node in self.graph.nodes)
        return {
            "nodes": len(self.graph.nodes), "edges": len(self.graph.edges),
            "kinds": dict(sorted(kinds.items())), "reachable_m2": rounded(self.result.reachable),
            "covered_m2": rounded(self.result.covered), "cover_m": self.cover,
            "parts": self.result.parts, "min_clearance_m": rounded(self.min_clearance),
            "length_m": rounded(float(self.graph.lengths.sum())), "tight_ways": self.result.tight,
            "near_unknown_ways": self.result.near_unknown,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        text = f"{self.map.title}: {len(self.graph.nodes)} nodes, {len(self.graph.edges)} edges, "
        areas = f"{decimal_text(self.result.covered)} of {decimal_text(self.result.reachable)} m2"
        text += f"covers {areas} within {self.cover:g} m, "
        yield f"{text}least clearance {self.min_clearance:.2f} m"

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        look = {"image_extent": "known", **look, "overlay": GraphOverlay(self.graph)}
        title = title or f"{self.map.title}: route graph"
        return layers.occupancy_image(self.reach.grid, title=title, **look)

    def write(self, transaction: Any, output: Path) -> None:
        write_graph(transaction, output, self.graph)


@command(
    group="Questions about a map",
    output=Output("GRAPH.geojson", "Where to write the graph.", ending=".geojson"),
    shared=("robot", "files"),
    example="""\
mapdeal graph examples/maps/office.yaml --robot-radius 0.22 \\
    -o out/graph.geojson --image out/graph.png
mapdeal graph examples/maps/office.yaml --robot-radius 0.22 \\
    --to kitchen=3,-4 lab=9,4 --slow-below 0.6 -o out/slow.geojson""",
)
def graph(
    map: inputs.Map, *, start: StartOption = None,  # noqa: A002 - what it is
    goals: Annotated[Sequence[Goal], Words("NAME=X,Y", goals_of, "to", is_repeated=True)] = (),
    spacing: Annotated[float, ABOVE_0, METRES] = 2.0, hall: Annotated[float, ABOVE_0, METRES] = 4.0,
    cover: Annotated[float, ABOVE_0, METRES] = 3.0,
    slow_below: Annotated[float | None, ABOVE_0, METRES] = None,
    one_way: graph_drafts.LaneSide | None = None,
    keep_from_unknown: Annotated[float | None, ABOVE_0, METRES] = None,
    through_unknown: bool = False, footprint: FootprintLike | None = None,
    robot: RobotOption = None, **reading: Unpack[inputs.Reading],
) -> PlannedGraph:  # fmt: skip
    """Make a graph of nodes and edges for Nav2's route server.

    Nodes lie in the middle of corridors, doors and crossings, and on a lattice in halls. Every edge
    is straight, and the robot's shape was swept along it without a collision. Every cell that the
    robot reaches has a node nearby, and all nodes are connected. The file is GeoJSON, for the
    server's parameter graph_filepath.

    Parameters
    ----------
    map : path, str or grid
        The map, or costs (.npz).
    start : tuple of float, optional
        Where the robot starts, metres; by default the widest place of the largest free area. The
        graph covers the cells that the robot reaches from there.
    goals : sequence of Goal, optional
        Goal that gets a node of its own with its name, metres; more may follow.
    spacing : float
        Distance between nodes on straight lines and in halls, metres.
    hall : float
        Least width of spaces that get a grid of nodes, metres.
    cover : float
        Longest free path from a reached cell to a node, metres.
    slow_below : float, optional
        Clearance below which edges have a speed_limit below 100 percent, metres. [default: none]
    one_way : {'right'}, optional
        Lanes on the right side, where there is room for two robots, not lines for both directions.
    keep_from_unknown : float, optional
        Least distance of edges from unknown cells, metres.
    through_unknown : bool
        Treat unknown cells as free.
    footprint, robot : Footprint, RobotParameters, optional
        The robot's shape and own parameters.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to a file.

    Returns
    -------
    PlannedGraph
        The graph, as `PlannedGraph.graph`, and how much it covers.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read, or the robot cannot stand anywhere.
    ParameterError
        If the start lies outside the map, or the robot cannot stand there.
    FindingError
        If a goal cannot be reached.

    Examples
    --------
    >>> from mapdeal import Footprint, OccupancyGrid
    >>> corridor = OccupancyGrid([[0] * 40] * 8, 0.25)
    >>> found = graph(corridor, footprint=Footprint.circle(0.3))
    >>> found.graph, {node.y for node in found.graph.nodes} <= {0.875, 1.125}
    (RouteGraph(5 nodes, 8 edges), True)
    """
    if robot is not None and not isinstance(robot, RobotParameters):
        hint = "mapdeal.read_robot_parameters reads a robot's files"
        raise errors.ParameterError("must be RobotParameters", place="robot", got=robot, hint=hint)
    lanes = slow_below, one_way, keep_from_unknown
    options = graph_drafts.GraphOptions(spacing, hall, cover, *lanes)
    if through_unknown:
        inputs.refuse("needs unknown cells to be closed", keep_from_unknown=keep_from_unknown)
    inputs.need_ending(".geojson")
    also = robot.paths if robot else ()
    (source,) = inputs.open_inputs(map, names=("map",), also=also, **reading)
    planned = graph_of(source, options, start=start, goals=goals, through_unknown=through_unknown,
                       footprint=footprint, robot=robot)  # fmt: skip
    result = planned.result
    if result.near_unknown and keep_from_unknown is None:
        radius = decimal_text(reach_radius(planned.reach.robot), 4)
        text = f"{result.near_unknown} ways pass unknown cells within the robot's radius, as near "
        text += f"as {result.from_unknown:.2f} m; --keep-from-unknown {radius} keeps away"
        errors.emit_warning(f"{source.name}: {text}")
    return planned


def graph_of(
    source: inputs.MapInput, options: graph_drafts.GraphOptions, *,
    start: tuple[float, ...] | None = None, goals: Sequence[Goal] = (),
    through_unknown: bool = False, footprint: FootprintLike | None = None,
    robot: RobotParameters | None = None,
) -> PlannedGraph:  # fmt: skip
    if footprint is None and robot is None:
        text = "no robot is given, by --robot-radius, --footprint or --params-file: the graph is"
        errors.emit_warning(f"{text} that of a point")
    shape = recipe.planned_shape(robot, shape_of(footprint))
    parameters = {"footprint": shape, "through_unknown": through_unknown, "start": start}
    step = make_step("reach", {**parameters, "goals": goals})
    coarse = graph_drafts.coarse_step(reach_radius(shape), source.grid.resolution) ** 2
    per_cell = step.memory + _PER_CELL + _PER_COARSE_CELL / coarse
    with (
        source.settings.reading(),
        inputs.claiming_work(source.name, source.grid, per_cell, besides=_LIBRARIES),
        inputs.errors_named(source.name),
    ):
        grid = source.grid
        graph_drafts.check_options(options, grid.resolution)
        if not isinstance(grid, costmap.Costmap):
            inputs.warn_of_values(source)
            if robot is not None:
                inputs.warn_of_robot(source.name, grid, robot)
                grid = lethal_costs(robot, source)
        mask = None
        if options.keep_from_unknown is not None:
            published = grid.to_occupancy() if isinstance(grid, costmap.Costmap) else grid
            mask = graph_drafts.band_around_unknown(published, options.keep_from_unknown)
        found = cast("Reach", step.apply(grid, source.path, mask=mask))
        if missed := next((goal for goal in found.goals if not goal.reachable), None):
            why = missed.stopped_by or "no way leads there"
            raise errors.FindingError(f"goal {missed.goal.label} is not reachable: {why}")
        result = route_graphs.route_graph_of(found, options)
    for text in _problems(result, options.cover, shape is not None and bool(shape.vertices)):
        errors.emit_warning(f"{source.name}: {text}")
    return PlannedGraph(source, found, result, options.cover)


def _problems(result: graph_drafts.GraphResult, cover: float, has_corners: bool) -> Iterator[str]:
    missing = result.reachable - result.covered
    if missing > _LITTLE * result.reachable:
        why = "it would take too many nodes; take a longer cover"
        if has_corners:
            why = "it gets there only sideways, or turning as it goes"
        areas = f"{decimal_text(missing, 3)} of {decimal_text(result.reachable)} m2"
        yield f"{areas} that the robot reaches are farther than {cover:g} m from all nodes: {why}"
    if result.parts > 1:
        yield f"the graph is in {result.parts} parts that no edge joins"
    if result.missed:
        yield f"no straight edges lead to {', '.join(result.missed)}"
    if result.tight:
        text = f"on {count_text(result.tight, 'connection')} the outline of the robot touches an "
        text += "obstacle, although the costs of the cells are open: less than a cell is to spare"
        yield text
