"""Drafts of route graphs: undirected nodes and edges over the cells that a robot reaches."""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import numpy as np

from mapdeal import command, errors
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Reach, reach_radius
from mapdeal.grid.reaching import Ground, squares_to
from mapdeal.grid.route_graph import RouteEdge, RouteGraph, RouteNode, Sweeps, closed_costs
from mapdeal.grid.values import FREE, LETHAL_OBSTACLE, NO_INFORMATION, OCCUPIED, UNKNOWN
from mapdeal.kernels import components, distance, skeleton
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask
from mapdeal.planning.graph_layouts import Cells, Place
from mapdeal.records import dataclass, replace

Kind = Literal["way", "crossing", "door", "narrow", "end", "hall", "goal"]
LaneSide = Literal["right"]
_Line = tuple[list[int], bool, float, float, float]
"""Numbers of both ends, whether it leads back, length, clearance and width of a door in metres."""
_COARSEST = 0.15  # metres: cells of the skeleton
_DECIMALS = 4  # of positions: a tenth of a millimetre
_SLOWEST = 10.0  # percent
_TOUCHING = 1e-4  # in cells: more than the rounding of places
_BETWEEN_CENTRES = 1.67  # cells by which centres may be farther apart than a line and a square
SHARE = 0.85  # least clearance of a straight line, relative to that of the path it replaces


@dataclass(frozen=True)
class GraphOptions:
    spacing: Annotated[float, command.ABOVE_0] = 2.0
    hall: Annotated[float, command.ABOVE_0] = 4.0
    cover: Annotated[float, command.ABOVE_0] = 3.0
    slow_below: Annotated[float | None, command.ABOVE_0] = None
    one_way: LaneSide | None = None
    keep_from_unknown: Annotated[float | None, command.ABOVE_0] = None

    def __post_init__(self) -> None:
        for name, parameter in command.parameters_of(GraphOptions).items():
            object.__setattr__(self, name, parameter.accept(getattr(self, name)))

    def bounded(self, cells: int, side: float) -> GraphOptions:
        """Return the options with lengths cut off to the longest possible path over the cells."""
        longest = min(cells, _LONGEST_PATH) * side
        return replace(self, **{name: min(getattr(self, name), longest) for name in _LENGTHS})


_LENGTHS = ("spacing", "hall", "cover")
_LONGEST_PATH = 1 << 25  # cells: path weights of longer ones would be too large


def coarse_step(radius: float, resolution: float) -> int:
    """Return the side of a skeleton's cell, in cells of the map."""
    # Skeleton cells must not bridge walls, which are as wide as the robot for its centre.
    return max(1, min(int(radius / resolution / 1.5), int(_COARSEST / resolution)))


@dataclass(frozen=True, eq=False)
class GraphResult:
    """A graph, and how much of the robot's reach it covers.

    Areas are in square metres. `tight` counts edges of a round robot, both directions once, that
    are open by the costs of their cells but on which the robot's circle, or its outline of 16
    corners as in costmap_2d, touches an obstacle; `near_unknown` those nearer to an unknown cell
    than the radius, and `from_unknown` how near. `missed` names the goals without an edge.
    """

    graph: RouteGraph
    reachable: float
    covered: float
    parts: int
    tight: int
    missed: tuple[str, ...] = ()
    near_unknown: int = 0
    from_unknown: float = math.inf


def band_around_unknown(grid: Any, width: float) -> OccupancyGrid:
    """Return a keepout mask of the cells in which a line may come too near to unknown cells."""
    unknown = np.asarray(grid.occupancy) == UNKNOWN
    limit = (width / grid.resolution + _BETWEEN_CENTRES) ** 2
    values = np.where((distance.squared_distance(unknown) <= limit) & ~unknown, OCCUPIED, FREE)
    return OccupancyGrid(values.astype(np.int8), grid.resolution, grid.origin)


class Draft:
    """An unfinished graph: undirected, with nodes by index. Places and lengths are in cells."""

    missing: Mask  # reached cells far from all nodes

    def __init__(self, reach: Reach, options: GraphOptions) -> None:
        robot, self.cell = reach.robot, reach.resolution
        self.radius = reach_radius(robot) / self.cell
        self.turning = self.radius if robot is None else robot.circumscribed_radius / self.cell
        self.has_corners = robot is not None and bool(robot.vertices)
        self.reachable = reach.reachable_area
        self.sweeps = _sweeps_around(reach, math.ceil(self.turning) + 3)
        self.frame = self.sweeps.frame
        self.is_open, self.squares = self.sweeps.is_open, self.sweeps.squared  # -1 in closed cells
        self.options = options.bounded(self.is_open.size, self.cell)
        self.spacing = self.options.spacing / self.cell
        self.limit = int(self.options.cover / self.cell * skeleton.STRAIGHT)  # of paths to a node
        self.step = coarse_step(self.radius * self.cell, self.cell)
        self.coarse = skeleton.largest_of_blocks(self.squares, self.step)
        self.places: list[Place] = []
        self.kinds: list[Kind] = []
        self.names: dict[int, str] = {}
        self.widths: dict[int, float] = {}
        self.edges: dict[tuple[int, int], float] = {}  # least clearances
        self.beside: defaultdict[int, dict[int, float]] = defaultdict(dict)
        self.gone: set[int] = set()  # removed nodes
        self.share = SHARE
        self.lanes: list[tuple[int, int]] = []  # directed edges

    def add_node(self, place: Place, kind: Kind) -> int:
        self.places.append(place)
        self.kinds.append(kind)
        return len(self.places) - 1

    def add_edge(self, start: int, end: int, clearance: float) -> None:
        if start != end:
            self.edges[min(start, end), max(start, end)] = clearance
            self.beside[start][end] = self.beside[end][start] = self.length(start, end)

    def drop_edge(self, start: int, end: int) -> float:
        del self.beside[start][end], self.beside[end][start]
        return self.edges.pop((min(start, end), max(start, end)))

    def drop_node(self, node: int) -> None:
        for end in list(self.beside[node]):
            self.drop_edge(node, end)
        self.gone.add(node)

    def length(self, start: int, end: int) -> float:
        return math.dist(self.places[start], self.places[end])

    def rounded(self, places: Any) -> Floats:
        return self.places_of(self.frame.xy_from_continuous_rowcol(places).round(_DECIMALS))

    def places_of(self, points_xy: Any) -> Floats:
        places = self.frame.continuous_rowcol_from_xy(points_xy)
        return np.maximum(places, self.frame.unbounded_rowcol_from_xy(points_xy))

    def at(self, indices: Iterable[int]) -> Floats:
        return np.array([self.places[index] for index in indices]).reshape(-1, 2)

    def clearances_at(self, places: Floats) -> Floats:
        rows, cols = np.floor(places).astype(np.int64).T
        squares = np.maximum(self.squares[rows, cols], 0)
        return np.asarray(np.sqrt(squares), dtype=np.float64)

    def parts(self) -> Array:
        ends = np.array([*self.edges, *self.lanes], dtype=np.int64).reshape(-1, 2)
        return components.joined(len(self.places), ends[:, 0], ends[:, 1])[0]

    def has_short_detour(self, start: int, end: int, limit: float) -> bool:
        beside, beyond = self.beside[start], self.beside[end]
        return any(beside[k] + beyond[k] <= limit for k in beside.keys() & beyond.keys())

    def length_on_graph(
        self, start: int, end: int, limit: float, avoided: int | None = None
    ) -> float:
        """Return the length of the shortest path that avoids a node; infinite above the limit."""
        best = {start: 0.0, avoided: 0.0}  # length 0 keeps the search from entering `avoided`
        places, goal = self.places, self.places[end]
        heap = [(0.0, 0.0, start)]
        while heap:
            _, length, node = heapq.heappop(heap)
            if node == end:
                return length
            if length > best[node]:
                continue
            for following, step in self.beside[node].items():
                total = length + step
                if total < best.get(following, math.inf):
                    best[following] = total
                    estimate = total + math.dist(places[following], goal)
                    if estimate <= limit:
                        heapq.heappush(heap, (estimate, total, following))
        return math.inf

    def nodes(self) -> list[int]:
        return [node for node in range(len(self.places)) if node not in self.gone]

    def cells_of(self, nodes: Sequence[int], step: int = 1) -> Cells:
        return skeleton.flat_cells(self.at(nodes), self.is_open.shape, step)

    def uncovered(self, nodes: Sequence[int], step: int = 1) -> Mask:
        """Return the reached cells, or blocks of cells, farther than `cover` from all the nodes."""
        is_open = self.is_open if step == 1 else self.coarse >= 0
        return skeleton.far_from(is_open, self.at(nodes) / step, self.limit // step)

    def move_all(self, moves: Sequence[tuple[int, int, Sequence[int]]]) -> list[bool]:
        """Merge nodes into their replacements where the robot can follow the new edges."""
        lines = [(target, end) for _, target, ends in moves for end in ends]
        starts, ends = self.at(line[0] for line in lines), self.at(line[1] for line in lines)
        is_clear, clearances = self.sweeps.along(starts, ends)
        begin, has_moved = 0, []
        for gone, target, new_ends in moves:
            of_move = slice(begin, begin := begin + len(new_ends))
            old_clearances = [self.edges[min(gone, end), max(gone, end)] for end in new_ends]
            is_wide = clearances[of_move] >= self.share * np.array(old_clearances) - 0.5
            fits = bool(is_clear[of_move].all() and is_wide.all())
            has_moved.append(fits)
            if fits:
                self.drop_node(gone)
                for end, clearance in zip(new_ends, clearances[of_move].tolist(), strict=True):
                    self.add_edge(target, end, clearance)
        return has_moved

    def result(self) -> GraphResult:
        points = self.frame.xy_from_continuous_rowcol(self.places).round(_DECIMALS) + 0.0
        used = np.array(self.nodes())
        order = used[np.lexsort(points[used].T)]
        points = points[order]
        places_xy = zip(order.tolist(), points.tolist(), strict=True)
        nodes = tuple(
            RouteNode(number, x, y, metadata=self._metadata(node))
            for number, (node, (x, y)) in enumerate(places_xy, start=1)
        )
        ends, leads_back = self._numbered_ends(order)
        starts_xy, stops_xy = points[ends[:, 0] - 1], points[ends[:, 1] - 1]
        starts = self.frame.continuous_rowcol_from_xy(starts_xy)
        stops = self.frame.continuous_rowcol_from_xy(stops_xy)
        is_clear, least = self.sweeps.along(starts, stops)
        door_widths = np.array([self.widths.get(node, math.inf) for node in order.tolist()])
        lines = zip(
            ends.tolist(), leads_back.tolist(), np.hypot(*(stops_xy - starts_xy).T).tolist(),
            (least * self.cell).tolist(), door_widths[ends - 1].min(axis=1).tolist(), strict=True,
        )  # fmt: skip
        missing = float(np.count_nonzero(self.missing)) * self.cell**2
        touches, from_unknown = self._distances_of_lines(starts, stops, least)
        return GraphResult(
            graph=RouteGraph(nodes, self._directed_edges(lines, len(nodes) + 1)),
            reachable=self.reachable,
            covered=self.reachable - missing,
            parts=len(np.unique(self.parts()[used])),
            tight=int((touches | ~is_clear).sum()),
            missed=tuple(name for node, name in self.names.items() if node in self.gone),
            near_unknown=int((from_unknown < self.radius - _TOUCHING).sum()),
            from_unknown=float(from_unknown.min(initial=math.inf)) * self.cell,
        )

    def _numbered_ends(self, order: Integers) -> tuple[Integers, Mask]:
        """Return the node numbers of edges and lanes, sorted, and which of them lead back."""
        number_of = np.zeros(len(self.places), dtype=np.int64)
        number_of[order] = np.arange(1, len(order) + 1)
        numbers = number_of[np.array([*self.edges, *self.lanes], dtype=np.int64).reshape(-1, 2)]
        leads_back = np.arange(len(numbers)) < len(self.edges)
        numbers[leads_back] = np.sort(numbers[leads_back], axis=1)
        in_order = np.lexsort(numbers.T[::-1])
        return numbers[in_order], leads_back[in_order]

    def _directed_edges(self, lines: Iterable[_Line], first_number: int) -> tuple[RouteEdge, ...]:
        edges: list[RouteEdge] = []
        slow_below = self.options.slow_below
        for ends, leads_back, length, clearance, door_width in lines:
            metadata = {"length": round(length, 3), "min_clearance": round(clearance, 3)}
            if door_width < math.inf:
                metadata["door_width"] = round(door_width, 3)
            if slow_below is not None:
                speed = min(100.0, max(_SLOWEST, 100.0 * clearance / slow_below))
                metadata["speed_limit"] = round(speed, 1)
            for start, end in (ends, ends[::-1]) if leads_back else (ends,):
                number = first_number + len(edges)
                edges.append(RouteEdge(number, start, end, metadata["length"], metadata=metadata))
        return tuple(edges)

    def _distances_of_lines(
        self, starts: Floats, ends: Floats, least: Floats
    ) -> tuple[Mask, Floats]:
        """Return on which lines a round robot touches obstacles, and distances to unknown cells."""
        # Lines that are certainly far from both have an infinite distance.
        radius = self.radius
        touches, from_unknown = np.zeros(len(least), dtype=np.bool_), np.full(len(least), math.inf)
        for k in () if self.has_corners else np.flatnonzero(least < radius + _BETWEEN_CENTRES):
            line = starts[k], ends[k], radius
            touches[k] = self.sweeps.distance_to(LETHAL_OBSTACLE, *line) < radius - _TOUCHING
            from_unknown[k] = self.sweeps.distance_to(NO_INFORMATION, *line)
        return touches, from_unknown

    def _metadata(self, node: int) -> dict[str, Any]:
        metadata: dict[str, Any] = {"kind": self.kinds[node]}
        if node in self.names:
            metadata["name"] = self.names[node]
        if node in self.widths:
            metadata["width"] = round(self.widths[node], 3)
        return metadata


def _sweeps_around(reach: Reach, margin: int) -> Sweeps:
    is_open = reach.reachable > 0
    open_cells = [np.flatnonzero(is_open.any(axis=axis)) for axis in (1, 0)]
    low = [max(int(cells[0]) - margin, 0) for cells in open_cells]
    high = [int(cells[-1]) + margin + 1 for cells in open_cells]
    window = slice(low[0], high[0]), slice(low[1], high[1])
    ground = Ground(reach.occupancy, reach.frame, reach.through_unknown)
    squared = np.ascontiguousarray(squares_to(ground.blocked)[window])
    np.copyto(squared, -1, where=~is_open[window])
    occupancy = reach.occupancy[window]
    unknown = (occupancy == UNKNOWN) & (not reach.through_unknown)
    closed = closed_costs(occupancy == OCCUPIED, unknown)
    frame = reach.frame.window(*low, *squared.shape)
    return Sweeps(is_open[window].copy(), closed, squared, frame, reach.robot)


def check_options(options: GraphOptions, resolution: float) -> None:
    rule = f"must be at least four cells, {4 * resolution:g} m"
    for name in _LENGTHS:
        if (value := getattr(options, name)) < 4 * resolution:
            raise errors.ParameterError(rule, place=name, got=value)
