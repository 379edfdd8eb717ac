"""Drafts of route graphs: undirected nodes and edges over the cells that a robot reaches.

Nodes lie on lattices in halls, and elsewhere on the lines of a skeleton, which are chains of cells
between crossings, without spurious branches.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from mapdeal import command, errors
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Reach, reach_radius
from mapdeal.grid.reaching import Ground, squares_to
from mapdeal.grid.route_graph import RouteEdge, RouteGraph, RouteNode, Sweeps, closed_costs
from mapdeal.grid.values import FREE, LETHAL_OBSTACLE, NO_INFORMATION, OCCUPIED, UNKNOWN
from mapdeal.kernels import components, distance, skeleton
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask
from mapdeal.records import dataclass, replace

Cells = Integers  # rows and columns, shape (N, 2)
Chain = list[int]  # cells from start to end, both included
Place = tuple[float, float]  # continuous row and column
_MOST_ACROSS_NARROW = 2  # places across a narrow part of a hall
_LEAST_DISTANCE = 0.7  # of places, as a share of the spacing
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


def lattices_in(
    points: Floats, halls: Array, direction: float, spacing: float, step: float,
    is_usable: Callable[[Floats], Mask],
) -> tuple[list[Place], Integers]:  # fmt: skip
    """Return places in the halls of some points, and the pairs of neighbours in one hall."""
    cos, sin = math.cos(direction), math.sin(direction)
    axes = np.array([[sin, cos], [cos, -sin]])  # both directions, as steps in rows and columns
    order = np.argsort(halls, kind="stable")
    bounds = [*np.flatnonzero(np.diff(halls[order], prepend=-1)).tolist(), len(order)]
    parts = [points[order[first:stop]] for first, stop in pairwise(bounds)]
    by_hall = [_lattice_in(part, axes, spacing, step, is_usable) for part in parts]
    places = [place for part in by_hall for place in part]
    if len(places) < 2:
        return places, np.zeros((0, 2), dtype=np.int64)
    from scipy.spatial import cKDTree

    near = cKDTree(np.array(places)).query_pairs(1.5 * spacing, output_type="ndarray")
    hall_of = np.repeat(np.arange(len(by_hall)), list(map(len, by_hall)))
    pairs = np.sort(near[hall_of[near[:, 0]] == hall_of[near[:, 1]]], axis=1).astype(np.int64)
    return places, pairs[np.lexsort(pairs.T[::-1])]


def _lattice_in(
    hall: Floats, axes: Floats, spacing: float, step: float, is_usable: Callable[[Floats], Mask]
) -> list[Place]:
    # Parts that are wide in both directions share one lattice for the hall, so that a pillar only
    # removes places. Parts that are narrow in one direction, such as aisles, are divided evenly.
    along_axes = (hall[:, 0] * axis[0] + hall[:, 1] * axis[1] for axis in axes)
    ticks = [_ticks(float(along.min()), float(along.max()), spacing) for along in along_axes]
    is_small = all(len(values) <= _MOST_ACROSS_NARROW for values in ticks)
    narrow, regular = list[Floats](), list[Floats]()
    for k in (0, 1):
        line = np.arange(ticks[k][0] - spacing, ticks[k][-1] + spacing, step)
        across = ticks[1 - k][:, np.newaxis, np.newaxis] * axes[1 - k]
        places = line[:, np.newaxis] * axes[k] + across
        usable = is_usable(places.reshape(-1, 2)).reshape(places.shape[:2])
        edges = np.argwhere(np.diff(usable.view(np.int8), prepend=0, append=0, axis=1)).tolist()
        runs = [
            _Run(float(ticks[1 - k][row]), float(line[first]), float(line[stop - 1]))
            for (row, first), (_, stop) in zip(edges[::2], edges[1::2], strict=True)
        ]
        for run, middle in _with_shared_middles(runs, spacing):
            count = len(_ticks(run.low, run.high, spacing))
            is_narrow = count <= _MOST_ACROSS_NARROW and not is_small
            if is_narrow:
                positions = middle + spacing * (np.arange(count) - (count - 1) / 2)
                positions = np.clip(positions, run.low, run.high)
            else:
                positions = ticks[k][(ticks[k] >= run.low) & (ticks[k] <= run.high)]
            line_places = positions[:, np.newaxis] * axes[k] + run.tick * axes[1 - k]
            (narrow if is_narrow else regular).append(line_places)
    # those of narrow parts come first, and so are selected
    return _select_places(np.concatenate([np.empty((0, 2)), *narrow, *regular]), spacing)


def _select_places(candidates: Floats, spacing: float) -> list[Place]:
    """Return the places of the candidates, skipping those too close to an earlier one."""
    selected: list[Place] = []
    by_square: defaultdict[tuple[int, int], list[Place]] = defaultdict(list)
    for row, col in candidates.tolist():
        up, right = int(row // spacing), int(col // spacing)
        squares = ((up + u, right + v) for u in (-1, 0, 1) for v in (-1, 0, 1))
        near = (place for square in squares for place in by_square[square])
        if all(math.dist((row, col), place) > _LEAST_DISTANCE * spacing for place in near):
            selected.append((row, col))
            by_square[up, right].append((row, col))
    return selected


def _ticks(low: float, high: float, spacing: float) -> Floats:
    """Return evenly spaced numbers, centred between two limits."""
    count = int((high - low) / spacing) + 1
    first = (low + high - (count - 1) * spacing) / 2
    return np.asarray(first + spacing * np.arange(count), dtype=np.float64)


class _Run(NamedTuple):
    """A part of a line through a hall, and the line's position across the hall."""

    tick: float
    low: float
    high: float


def _with_shared_middles(runs: Sequence[_Run], spacing: float) -> Iterator[tuple[_Run, float]]:
    """Yield runs with their middle, which neighbouring runs of similar extent share."""
    groups: list[list[_Run]] = []
    growing: list[list[_Run]] = []
    for run in runs:
        growing = [group for group in growing if group[-1].tick >= run.tick - 1.5 * spacing]
        for group in growing:
            last = group[-1]
            is_similar = abs(last.low + last.high - run.low - run.high) < spacing
            is_similar &= min(last.high, run.high) > max(last.low, run.low)
            if last.tick < run.tick and is_similar:
                group.append(run)
                break
        else:
            groups.append([run])
            growing.append(groups[-1])
    for group in groups:
        middle = median((run.low + run.high) / 2 for run in group)
        for run in group:
            yield run, middle


class Tracing:
    """Lines of a skeleton as chains of cells between their ends and crossings."""

    # Nodes and cells are indices into `cells`, which are blocks of `step` x `step` cells of a
    # map; `mouths` are ends at which a hall begins. Squares of closed cells are negative.

    def __init__(self, squares: Array, step: int, lines: Mask, halls: Mask) -> None:
        self.cells = np.argwhere(lines)
        self.fine = _best_in_blocks(squares, step, self.cells)
        self.clearances: list[float] = np.sqrt(squares[self.fine[:, 0], self.fine[:, 1]]).tolist()
        self._places: list[list[int]] = self.cells.tolist()
        self.step = step
        self.mouths: set[int] = set()
        self.chains: dict[int, Chain] = {}
        self.chains_of: defaultdict[int, list[int]] = defaultdict(list)
        self._count = 0
        self._beside = self._adjacent(lines)
        if len(self.cells):
            at_hall = distance.dilate_square(halls, 1)[self.cells[:, 0], self.cells[:, 1]]
            self.mouths = set(np.flatnonzero(at_hall).tolist())
        self._trace()

    def _adjacent(self, lines: Mask) -> list[list[int]]:
        """Return the neighbours of each cell; diagonal ones only without straight steps."""
        height, width = lines.shape
        index = np.full((height + 2, width + 2), -1)
        rows, cols = self.cells[:, 0] + 1, self.cells[:, 1] + 1
        index[rows, cols] = np.arange(len(self.cells))
        columns = [index[rows + row, cols + col] for row, col in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        for row, col in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
            there = index[rows + row, cols + col]
            is_connected = (index[rows + row, cols] >= 0) | (index[rows, cols + col] >= 0)
            columns.append(np.where(is_connected, -1, there))
        table = np.column_stack(columns)
        is_there = table >= 0
        beside = table[is_there].tolist()
        bounds = np.append(0, np.cumsum(is_there.sum(axis=1))).tolist()
        return [beside[first:stop] for first, stop in pairwise(bounds)]

    def _trace(self) -> None:
        degrees = [len(neighbours) for neighbours in self._beside]
        ends = [k for k, degree in enumerate(degrees) if degree != 2 or k in self.mouths]
        is_end = set(ends)
        traced: set[tuple[int, int]] = set()
        passed = set(ends)
        for end in ends:
            for following in self._beside[end]:
                if (end, following) in traced:
                    continue
                cells = self._follow(end, following, is_end)
                traced.add((cells[-1], cells[-2]))
                traced.add((end, following))
                passed.update(cells)
                self.add(cells)
        for alone in self.mouths:
            if not self._beside[alone]:
                self.add([alone, alone])
        for start in range(len(self.cells)):  # loops without a crossing
            if start not in passed and self._beside[start]:
                cells = self._follow(start, self._beside[start][0], {start})
                passed.update(cells)
                self.add(cells)

    def _follow(self, start: int, following: int, ends: set[int]) -> list[int]:
        cells = [start, following]
        while cells[-1] not in ends:
            (following,) = (cell for cell in self._beside[cells[-1]] if cell != cells[-2])
            cells.append(following)
        return cells

    def add(self, cells: list[int]) -> None:
        self._count += 1
        self.chains[self._count] = cells
        self.chains_of[cells[0]].append(self._count)
        self.chains_of[cells[-1]].append(self._count)

    def drop(self, number: int) -> Chain:
        chain = self.chains.pop(number)
        self.chains_of[chain[0]].remove(number)
        self.chains_of[chain[-1]].remove(number)
        return chain

    def length(self, chain: Chain) -> float:
        places = [self._places[cell] for cell in chain]
        return sum(map(math.dist, places, places[1:])) * self.step

    def width_around(self, node: int, besides: int, reach: float) -> float:
        """Return the largest clearance on the chains at a node, except one, within a reach."""
        count, largest = max(1, int(reach / self.step)), 0.0
        for number in self.chains_of[node]:
            if number != besides:
                cells = self.chains[number]
                near = cells[:count] if cells[0] == node else cells[-count:]
                largest = max(largest, *(self.clearances[cell] for cell in near))
        return largest

    def prune(self, shortest: float, loop: float) -> None:
        for number in sorted(self.chains, key=lambda k: (len(self.chains[k]), k)):
            if number in self.chains:
                self._contract(number)
        self._open_loops(loop)
        waiting = [(self.length(chain), number) for number, chain in self.chains.items()]
        heapq.heapify(waiting)
        while waiting:
            length, number = heapq.heappop(waiting)
            if number not in self.chains:
                continue
            chain = self.chains[number]
            for end, base in ((chain[0], chain[-1]), (chain[-1], chain[0])):
                is_dead = len(self.chains_of[end]) == 1 and end not in self.mouths
                if not is_dead or base == end or len(self.chains_of[base]) < 2:
                    continue
                if length >= max(shortest, self.clearances[base]):
                    continue
                self.drop(number)
                merged = self._merge(base)
                if merged is not None:
                    heapq.heappush(waiting, (self.length(self.chains[merged]), merged))
                break

    def _open_loops(self, max_length: float) -> None:
        """Drop the narrower of two chains around an obstacle if both are short."""
        lengths = {number: self.length(chain) for number, chain in self.chains.items()}
        narrowest = {number: min(self.clearances[cell] for cell in chain)
                     for number, chain in self.chains.items()}  # fmt: skip
        for number in sorted(self.chains, key=lambda k: (narrowest[k], k)):
            chain = self.chains[number]
            if chain[0] == chain[-1]:
                if lengths[number] <= 2 * max_length and len(self.chains_of[chain[0]]) > 2:
                    self.drop(number)
            elif lengths[number] <= max_length and self._has_detour(number, lengths, max_length):
                self.drop(number)
        for node in list(self.chains_of):
            self._merge(node)

    def _has_detour(self, number: int, lengths: dict[int, float], max_length: float) -> bool:
        chain = self.chains[number]
        best, heap = {chain[0]: 0.0}, [(0.0, chain[0])]
        while heap:
            length, node = heapq.heappop(heap)
            if node == chain[-1]:
                return True
            for beside in self.chains_of[node]:
                total = length + lengths[beside]
                link = self.chains[beside]
                following = link[-1] if link[0] == node else link[0]
                is_short = total <= max_length and total < best.get(following, math.inf)
                if beside != number and is_short:
                    best[following] = total
                    heapq.heappush(heap, (total, following))
        return False

    def _merge(self, node: int) -> int | None:
        numbers = self.chains_of[node]
        if len(numbers) != 2 or numbers[0] == numbers[1] or node in self.mouths:
            return None
        first, second = (self.drop(number) for number in list(numbers))
        head = first if first[-1] == node else first[::-1]
        tail = second if second[0] == node else second[::-1]
        self.add([*head, *tail[1:]])
        return self._count

    def _contract(self, number: int) -> None:
        """Merge the crossings at both ends of a chain if it is within half their clearance."""
        chain = self.chains[number]
        ends = chain[0], chain[-1]
        if chain[0] == chain[-1] or not self.mouths.isdisjoint(ends):
            return
        if min(len(self.chains_of[end]) for end in ends) < 3:
            return
        clearance = max(self.clearances[end] for end in ends)
        if self.length(chain) > max(2 * self.step, 0.5 * clearance):
            return
        if min(self.clearances[cell] for cell in chain) < 0.8 * clearance:
            return  # a narrow place lies between them
        is_start = self.clearances[chain[0]] >= self.clearances[chain[-1]]  # the wider crossing
        gone, link = (ends[1], chain) if is_start else (ends[0], chain[::-1])
        self.drop(number)
        for moved_number in list(self.chains_of[gone]):
            if moved_number in self.chains:  # a loop is listed twice
                moved = self.drop(moved_number)
                head = link[:-1] if moved[0] == gone else []
                tail = link[-2::-1] if moved[-1] == gone else []
                self.add([*head, *moved, *tail])


def _best_in_blocks(squares: Array, step: int, blocks: Cells) -> Cells:
    """Return the cell of the largest square in each block; of equal ones the most central."""
    if step == 1 or not len(blocks):
        return blocks
    offsets = np.array([(row, col) for row in range(step) for col in range(step)])
    away = ((offsets - (step - 1) / 2) ** 2).sum(axis=1)
    best, best_cells = np.full(len(blocks), -1, dtype=np.int64), np.zeros_like(blocks)
    for offset in offsets[np.argsort(away, kind="stable")]:
        cells = blocks * step + offset
        inside = (cells < squares.shape).all(axis=1)
        rows, cols = np.where(inside[:, np.newaxis], cells, 0).T
        values = np.where(inside, squares[rows, cols], -1)
        is_better = values > best
        best[is_better] = values[is_better]
        best_cells[is_better] = cells[is_better]
    return best_cells


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


class GraphResult(NamedTuple):
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
        return np.asarray(np.sqrt(np.maximum(self.squares[rows, cols], 0)), dtype=np.float64)

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
