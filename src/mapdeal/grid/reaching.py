"""What a robot can reach, and the passages that limit it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid import footprint, frame as frames, reach, values as map_values
from mapdeal.grid.frame import Frame, Point, check_point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage, Reach
from mapdeal.kernels import components, distance, paths, polygons, threads
from mapdeal.kernels.arrays import Bytes, Floats, Mask, Metres, SquaredDistances
from mapdeal.kernels.components import ClearanceTree, RootedTree, joined
from mapdeal.records import dataclass, field

Cell = tuple[int, int]
Indices = NDArray[np.intp]
DEFAULT_HEADINGS = 72
_TURN = 2 * math.pi
_DECIMALS = 9


def cell_of_point(frame: Frame, point: Point, name: str) -> Cell:
    cells, inside = frame.bounded_rowcol_from_xy([check_point(point, name)])
    if not inside[0]:
        corners_xy = frames.corners_of(frame).round(6) + 0.0
        (x, y), (right, top) = corners_xy.min(axis=0).tolist(), corners_xy.max(axis=0).tolist()
        hint = f"the map lies within x {x:.10g} .. {right:.10g}, y {y:.10g} .. {top:.10g}"
        raise ParameterError("lies outside of the map", place=name, got=point, hint=hint)
    row, col = cells[0].tolist()
    return row, col


def nearest_open_text(frame: Frame, is_open: Mask, cell: Cell) -> str:
    nearest = nearest_marked(is_open, cell)
    if nearest is None:
        return "no cell of the map is open"
    x, y = frame.xy_from_rowcol([nearest])[0].round(6).tolist()
    metres = math.dist(nearest, cell) * frame.resolution
    return f"the nearest open cell is {metres:.3g} m away, at {x + 0.0:.10g},{y + 0.0:.10g}"


def nearest_marked(marked: Mask, cell: Cell) -> Cell | None:
    """Return the marked cell nearest to a cell, if there is one; of several the first by rows."""
    # The cell may lie outside. Rows are searched from it on: a list of all marked cells would take
    # much memory.
    best: tuple[float, int, int] = (math.inf, -1, -1)
    for row in sorted(range(len(marked)), key=lambda row: abs(row - cell[0])):
        away = (row - cell[0]) ** 2
        if away > best[0]:
            break
        cols = np.flatnonzero(marked[row])
        if len(cols):
            col = int(cols[np.argmin(np.abs(cols - cell[1]))])
            best = min(best, (away + (col - cell[1]) ** 2, row, col))
    return None if best[0] == math.inf else best[1:]


@dataclass(frozen=True, eq=False)
class PassageTree:
    """The clearance tree of a map on its frame: passages in metres, areas as masks of cells."""

    tree: ClearanceTree
    squared: SquaredDistances
    frame: Frame
    _gap_ends: dict[int, tuple[Point, Point]] = field(default_factory=dict, init=False, repr=False)

    @property
    def cell_area(self) -> float:
        return self.frame.resolution * self.frame.resolution

    def counts(self, mask: Mask) -> Floats:
        counts, lock = np.zeros(len(self.tree.peaks)), Lock()

        def add(rows: slice) -> None:
            inside = self.tree.basins[rows][mask[rows]]
            inside = inside[inside >= 0]  # a robot may stand beside its centre, in an obstacle
            if not len(inside):
                return
            first = int(inside.min())  # numbered by rows: those of a few rows are close
            in_basins = np.bincount(inside - first)
            with lock:
                counts[first : first + len(in_basins)] += in_basins

        threads.for_rows(add, mask.shape)
        return counts

    def min_count(self, area: float) -> float:
        """Return the cells in an area in square metres, slightly less to allow for rounding."""
        return area / self.cell_area * (1 - frames.CELL_TOLERANCE)

    def gap(self, saddle: int) -> tuple[Point, Point]:
        """Return the ends of the gap around a cell, given by its flat index; computed once."""
        if saddle not in self._gap_ends:
            row, col = divmod(saddle, self.frame.width)
            ends = components.gap_at(self.squared, self.tree.basins, (row, col))
            first, second = self.frame.xy_from_rowcol(ends).tolist()
            self._gap_ends[saddle] = (first[0], first[1]), (second[0], second[1])
        return self._gap_ends[saddle]

    def middle(self, saddle: int) -> Point:
        (x, y), (other_x, other_y) = self.gap(saddle)
        return (x + other_x) / 2, (y + other_y) / 2

    def is_open(self, closed_up_to: int) -> Mask:
        return self.cells_of(np.ones(len(self.tree.peaks), dtype=np.bool_), closed_up_to)

    def in_largest_area(self, closed_up_to: int) -> Mask | None:
        # Areas are connected by the four straight neighbours. Of areas of equal size, the one whose
        # first basin comes first is returned.
        tree = self.tree
        areas = paths.basin_areas(tree, self.squared, closed_up_to)
        if not areas.any():
            return None
        is_wider = tree.squares > closed_up_to
        labels, _ = joined(len(areas), tree.firsts[is_wider], tree.seconds[is_wider])
        return self.cells_of(labels == np.argmax(np.bincount(labels, weights=areas)), closed_up_to)

    def cells_of(self, is_chosen: Mask, closed_up_to: int) -> Mask:
        by_basin = np.append(is_chosen, False)  # cells without a basin have -1, the last entry
        cells = np.empty(self.squared.shape, dtype=np.bool_)

        def fill(rows: slice) -> None:
            np.greater(self.squared[rows], closed_up_to, out=cells[rows])
            cells[rows] &= by_basin[self.tree.basins[rows]]

        threads.for_rows(fill, cells.shape)
        return cells

    def rooted_at(self, start: Cell) -> RootedPassageTree:
        basin = int(self.tree.basins[start])
        return RootedPassageTree(self, start, None if basin < 0 else paths.rooted(self.tree, basin))


@dataclass(frozen=True, eq=False)
class Ground:
    occupancy: NDArray[np.int8]
    frame: Frame
    through_unknown: bool
    keepout: Mask | None = None
    """Cells that the robot's centre must not enter; they are no obstacles to its shape."""

    # The masks are computed on each access to save memory.

    @property
    def obstacles(self) -> Mask:
        return np.equal(self.occupancy, map_values.OCCUPIED)

    @property
    def blocked(self) -> Mask:
        """Mask of cells that the robot's centre must not enter."""
        blocked = self.untouchable
        if self.keepout is not None:
            blocked |= self.keepout
        return blocked

    @property
    def untouchable(self) -> Mask:
        """Mask of cells that no part of the robot may touch."""
        blocked = self.obstacles
        if not self.through_unknown:
            blocked |= self.occupancy == map_values.UNKNOWN
        return blocked

    def passage_tree(self) -> PassageTree:
        squared = squares_to(self.obstacles)
        traversable = self.blocked
        np.logical_not(traversable, out=traversable)
        return PassageTree(paths.clearance_tree(squared, traversable), squared, self.frame)


@dataclass(frozen=True, eq=False)
class RootedPassageTree:
    passage_tree: PassageTree
    start: Cell
    rooted: RootedTree | None

    def reachable(self, closed_up_to: int) -> Bytes:
        squared = self.passage_tree.squared
        if self.rooted is None or squared[self.start] <= closed_up_to:
            return np.zeros(squared.shape, dtype=np.uint8)
        is_reached = self.rooted.bottlenecks > closed_up_to
        return self.passage_tree.cells_of(is_reached, closed_up_to).view(np.uint8)

    def widest(self) -> Metres:
        """Return the least clearance on the widest path to each cell, metres, 0 without a path."""
        squared = self.passage_tree.squared
        if self.rooted is None:
            return np.zeros(squared.shape, dtype=np.float32)
        tree, side = self.passage_tree.tree, self.passage_tree.frame.resolution
        return paths.widest_metres(tree, self.rooted, squared, self.start, side)


def squares_to(marked: Mask) -> SquaredDistances:
    """Return the squared distance of each cell to the nearest cell that is marked or outside."""
    squared = distance.squared_distance(marked)
    steps = (np.arange(1, length + 1, dtype=np.int64) for length in squared.shape)
    row_squares, col_squares = ((np.minimum(n, n[::-1]) ** 2).astype(squared.dtype) for n in steps)

    def lower(rows: slice) -> None:
        np.minimum(squared[rows], col_squares, out=squared[rows])
        np.minimum(squared[rows], row_squares[rows, np.newaxis], out=squared[rows])

    threads.for_rows(lower, squared.shape)
    return squared


def largest_closed_square(radius: float, frame: Frame) -> int:
    """Return the largest squared distance in cells that is closed to a round robot."""
    # Cells at this distance have cost 253 around an obstacle, those beyond it less.
    return frames.largest_square_within(min(radius, max(frame.size_xy)), frame.resolution)


def passages(
    passage_tree: PassageTree, is_open: Mask, start: Cell, *, radius: float, min_area: float,
    margin: float = 0.0, circumscribed_radius: float | None = None, is_reached: Mask | None = None,
) -> tuple[Passage, ...]:  # fmt: skip
    """Return the passages that stop a robot, or a robot larger by a margin, and cut off an area."""
    tree = passage_tree.tree
    root = int(tree.basins[start])
    if root < 0 or not len(tree.squares):
        return ()
    closed = largest_closed_square(radius, passage_tree.frame)
    tight = largest_closed_square(radius + margin, passage_tree.frame)
    levels = [(closed, -1), (tight, closed)]
    if is_reached is not None and circumscribed_radius is not None:
        levels.append((largest_closed_square(circumscribed_radius, passage_tree.frame), tight))
    levels = [(upper, lower) for upper, lower in levels if upper > lower]
    counts, min_count = passage_tree.counts(is_open), passage_tree.min_count(min_area)
    edges_of_levels = [_meetings(tree, counts, root, *level, min_count) for level in levels]
    edges = np.concatenate(edges_of_levels)
    if not len(edges):
        return ()
    values = counts[:, np.newaxis]
    if is_reached is not None:
        values = np.column_stack([counts, passage_tree.counts(is_reached)])
    beyond, before, basins_beyond = _sides_of(tree, edges, root, values)
    open_beyond = beyond[:, 0]
    is_passed = tree.squares[edges] > closed
    is_kept = open_beyond > 0  # nan if the root is not connected to the edge
    if is_reached is not None:
        is_passed = beyond[:, 1] >= np.minimum(min_count, open_beyond / 2)
        # Behind a closed passage, a further passage certainly stops the robot only if it is too
        # narrow for the inscribed circle.
        limits = np.where(is_passed, tight, closed)
        is_kept &= (tree.squares[edges] <= limits) | (~is_passed & (before[:, 1] > 0))
    doors = [(int(tree.cells[edges[index]]), index) for index in np.flatnonzero(is_kept).tolist()]
    stops = is_kept & ~is_passed
    begin = 0
    for level_edges in edges_of_levels:
        level = slice(begin, begin := begin + len(level_edges))
        if stops[level].any():
            beyond_level = basins_beyond[level], open_beyond[level]
            further = _further_doors(passage_tree, level_edges, *beyond_level)
            doors += [(cell, level.start + i) for cell, i in further if stops[level][i]]
    found = []
    for cell, index in doors:
        square = int(passage_tree.squared.flat[cell])
        width = reach.width_of(square, passage_tree.frame.resolution)
        area = float(open_beyond[index]) * passage_tree.cell_area
        x, y = passage_tree.middle(cell)
        found.append(Passage(x, y, width, area, bool(is_passed[index]), passage_tree.gap(cell)))
    return tuple(sorted(found, key=_passage_order))


def _passage_order(passage: Passage) -> tuple[object, ...]:
    return passage.width, -passage.cut_off, passage.ends


def disconnected(grid: OccupancyGrid, radius: float, min_area: float) -> list[Passage]:
    # Where no path at all connects two components of the map, passages are those seen from the
    # largest area of each.
    passage_tree = Ground(grid.occupancy, grid.frame, through_unknown=False).passage_tree()
    tree = passage_tree.tree
    is_open = passage_tree.is_open(largest_closed_square(radius, grid.frame))
    counts, basins = _regions(passage_tree, is_open, radius)
    labels, _ = joined(len(counts), tree.firsts, tree.seconds)
    _, first, component = np.unique(labels[basins], return_index=True, return_inverse=True)
    largest = counts[basins[first]]
    remaining = np.bincount(component, counts[basins], minlength=len(first)) - largest
    is_divided = np.minimum(largest, remaining) >= passage_tree.min_count(min_area)
    found: list[Passage] = []
    for basin in basins[first[is_divided]].tolist():
        start = divmod(int(tree.peak_cells[basin]), grid.frame.width)
        found += passages(passage_tree, is_open, start, radius=radius, min_area=min_area)
    return sorted(found, key=_passage_order)


def bottleneck_on_way(from_start: RootedPassageTree, goal: Cell) -> Bottleneck | None:
    passage_tree, rooted = from_start.passage_tree, from_start.rooted
    tree, squared = passage_tree.tree, passage_tree.squared
    start = from_start.start
    basin = int(tree.basins[goal])
    if rooted is None or basin < 0 or rooted.bottlenecks[basin] < 0:
        return None
    at_start = int(squared[start])
    square = min(at_start, int(squared[goal]), int(rooted.bottlenecks[basin]))
    width = reach.width_of(square, passage_tree.frame.resolution)
    while (edge := int(rooted.parent_edges[basin])) >= 0:  # the first one that is as narrow
        if tree.squares[edge] <= square:
            x, y = passage_tree.middle(int(tree.cells[edge]))
            return Bottleneck(x, y, width, "passage")
        basin = int(tree.firsts[edge]) + int(tree.seconds[edge]) - basin
    limits_at_start = at_start == square
    x, y = passage_tree.frame.xy_from_rowcol([start if limits_at_start else goal])[0].tolist()
    return Bottleneck(x, y, width, "start" if limits_at_start else "goal")


def _meetings(
    tree: ClearanceTree, counts: Floats, root: int, upper: int, lower: int, min_count: float
) -> Indices:
    """Return the edges at which large regions meet, of squares above `lower`, up to `upper`."""
    # A region is a set of basins connected by wider edges; that of the root may be small.
    begin, end = (_first_not_above(tree.squares, limit) for limit in (upper, lower))
    count = len(counts)
    regions, _ = joined(count, tree.firsts[:begin], tree.seconds[:begin])
    sizes = np.bincount(regions, counts, minlength=count).astype(np.float64)
    is_wide = tree.peaks > upper
    is_large = sizes >= min_count
    is_large[regions[root]] = True
    is_large &= is_wide
    ends = regions[np.array([tree.firsts[begin:end], tree.seconds[begin:end]])]
    if lower >= 0:
        return begin + joined(count, ends[0], ends[1], is_large)[1]
    is_region = is_large | ((sizes > 0) & is_wide)
    return begin + _closed_meetings(ends, sizes, is_region, is_large, min_count)


def _closed_meetings(
    ends: Indices, sizes: Floats, is_region: Mask, is_large: Mask, min_count: float
) -> Indices:
    # Adjacent small regions beyond a closed passage are counted as one region.
    count = len(sizes)
    regions, edges = joined(count, ends[0], ends[1], is_region)
    ends = regions[ends[:, edges]]
    is_meeting = np.zeros(len(edges), dtype=np.bool_)
    is_meeting[joined(count, ends[0], ends[1], is_large)[1]] = True
    is_small = ~is_large[ends]
    small_ends = ends[:, is_small.all(axis=0) & ~is_meeting]
    clusters, _ = joined(count, small_ends[0], small_ends[1])
    cluster_sizes = np.bincount(clusters, np.where(is_large, 0, sizes), minlength=count)
    size_of_small = np.where(is_small, cluster_sizes[clusters[ends]], 0).max(axis=0)
    is_meeting |= (is_small.sum(axis=0) == 1) & (size_of_small >= min_count)
    return edges[is_meeting]


def _sides_of(
    tree: ClearanceTree, edges: Indices, root: int, values: Floats
) -> tuple[Floats, Floats, Indices]:
    """Return the sums of values beyond each edge and in the component before it, from the root."""
    # Their shape is (edges, values). The third array has a basin of the component just beyond each
    # edge, or -1.
    labels = _components_without(tree, edges)
    ends = labels[np.array([tree.firsts[edges], tree.seconds[edges], np.full(len(edges), root)])]
    used, ends = np.unique(ends, return_inverse=True)
    firsts, seconds, roots = ends.reshape(3, -1)
    columns = [np.bincount(labels, column, minlength=len(values)) for column in values.T]
    sums = np.column_stack(columns)[used]
    beyond, near, far = components.sums_behind(firsts, seconds, int(roots[0]), sums)
    return beyond, sums[near], np.where(far < 0, -1, used[far])


def _components_without(tree: ClearanceTree, edges: Indices) -> Indices:
    is_left = np.ones(len(tree.firsts), dtype=np.bool_)
    is_left[edges] = False
    return joined(len(tree.peaks), tree.firsts[is_left], tree.seconds[is_left])[0]


def _further_doors(
    passage_tree: PassageTree, edges: Indices, basins_beyond: Indices, open_beyond: Floats
) -> Iterator[tuple[int, int]]:
    """Yield the narrowest cells of further doors, flat, and the edge to the same area."""
    # Each edge is the widest door between its two areas. Doors less than half as wide as that edge
    # are skipped: walls seen by lasers are full of holes.
    tree = passage_tree.tree
    areas = _components_without(tree, edges)
    areas_beyond = np.where(basins_beyond < 0, -1, areas[basins_beyond]).tolist()
    edge_to = {area: index for index, area in enumerate(areas_beyond) if area >= 0}
    cells, squares = tree.cells[edges].tolist(), tree.squares[edges].tolist()
    saddles = components.saddles_between(passage_tree.squared, tree.basins, areas)
    for cell, *ends in saddles.tolist():
        candidates = [edge_to[area] for area in ends if area in edge_to]
        if candidates and cell not in cells:
            # of two edges with equal areas beyond them, take the wider one
            index = min(candidates, key=lambda i: (float(open_beyond[i]), -squares[i]))
            if 4 * passage_tree.squared.flat[cell] >= squares[index]:
                yield cell, index


def _first_not_above(falling: NDArray[np.int64], limit: int) -> int:
    return int(np.searchsorted(-falling, -limit, side="left"))


def _regions(passage_tree: PassageTree, is_open: Mask, radius: float) -> tuple[Floats, Indices]:
    """Return the open cells in the region of each basin, and the widest basin of each region."""
    # The regions with the most cells come first.
    tree = passage_tree.tree
    end = _first_not_above(tree.squares, largest_closed_square(radius, passage_tree.frame))
    labels, _ = joined(len(tree.peaks), tree.firsts[:end], tree.seconds[:end])
    sizes = np.bincount(labels, passage_tree.counts(is_open), len(labels))
    counts: Floats = sizes[labels].astype(np.float64)
    order = np.lexsort((-tree.peaks, labels))
    widest = order[np.flatnonzero(np.diff(labels[order], prepend=-1))]
    widest = widest[counts[widest] > 0]
    return counts, widest[np.lexsort((widest, -counts[widest]))]


def reach_on(
    ground: Ground, robot: footprint.Footprint | None, *, start: Sequence[float] | None,
    goals: Sequence[Goal], headings: int, margin: float, min_area: float,
) -> Reach:  # fmt: skip
    if start is not None and len(start) not in (2, 3):
        raise ParameterError("must be x,y or x,y,yaw", place="start", got=tuple(start))
    pose = None if start is None else tuple(start)
    if pose is not None and len(pose) == 3:
        frames.warn_of_degrees(pose[2], "start")
    start_cell = None if pose is None else cell_of_point(ground.frame, (pose[0], pose[1]), "start")
    names = ["goal" if goal.name is None else f"goal {goal.name}" for goal in goals]
    points = [check_point((goal.x, goal.y), name) for goal, name in zip(goals, names, strict=True)]
    cells = [(row, col) for row, col in ground.frame.unbounded_rowcol_from_xy(points).tolist()]
    inside = [cell for cell in cells if ground.frame.holds(cell)]
    # Compute the poses before the clearance tree: holding both at once would double the memory.
    poses = _standing_poses(ground, robot, headings, start_cell, pose, inside)
    passage_tree = ground.passage_tree() if poses.passage_tree is None else poses.passage_tree
    from_start = passage_tree.rooted_at(poses.start_cell)
    is_open = poses.headings > 0
    counts = dict(zip(inside, poses.goal_headings.sum(axis=1).tolist(), strict=True))
    answers = [_answer(goal, cell, counts.get(cell, 0), from_start, ground, robot, is_open)
               for goal, cell in zip(goals, cells, strict=True)]  # fmt: skip
    has_corners = robot is not None and bool(robot.vertices)
    found = passages(
        passage_tree, is_open, poses.start_cell,
        radius=reach.reach_radius(robot), margin=margin, min_area=min_area,
        circumscribed_radius=robot.circumscribed_radius if robot is not None else None,
        is_reached=poses.reachable.view(np.bool_) if has_corners else None,
    )  # fmt: skip
    del is_open
    resolution = ground.frame.resolution
    widest = from_start.widest()  # overwrites the basins, which are no longer needed
    clearance = paths.clearance_metres(passage_tree.squared, resolution)
    return Reach(
        reachable=poses.reachable, headings=poses.headings, clearance=clearance, widest=widest,
        occupancy=ground.occupancy, resolution=resolution, origin=ground.frame.origin,
        start=poses.start, robot=robot, heading_count=headings,
        through_unknown=ground.through_unknown, goals=tuple(answers), passages=found,
    )  # fmt: skip


def cells_open_to(ground: Ground, robot: footprint.Footprint | None, start: Cell) -> Mask:
    # Those that are open to a round robot need not all be connected.
    if robot is None or not robot.vertices:
        closed_up_to = largest_closed_square(reach.reach_radius(robot), ground.frame)
        return np.asarray((squares_to(ground.obstacles) > closed_up_to) & ~ground.blocked)
    footprints = footprint.footprint_spans(robot, ground.frame, DEFAULT_HEADINGS)
    poses = paths.open_poses(ground.untouchable, footprints, ground.keepout)
    seeds = [(int(heading), *start) for heading in np.flatnonzero(poses.at(*start))]
    return poses.reach(seeds, [])[0].view(np.bool_)


class _RoundPoses(paths.OpenPoses):
    """The poses of a round robot, which fits in all headings or none."""

    def __init__(self, passage_tree: PassageTree, closed_up_to: int, heading_count: int) -> None:
        self._passage_tree = passage_tree
        self._closed_up_to = closed_up_to
        self._heading_count = heading_count
        self.headings = passage_tree.is_open(closed_up_to).view(np.uint8)
        self.headings *= np.uint8(heading_count)

    def at(self, row: int, col: int) -> Mask:
        return np.full(self._heading_count, self.headings[row, col] > 0)

    def reach(self, seeds: Sequence[polygons.Pose], cells: Sequence[Cell]) -> tuple[Bytes, Mask]:
        reachable = self._passage_tree.rooted_at(seeds[0][1:]).reachable(self._closed_up_to)
        is_reached = np.array([reachable[cell] > 0 for cell in cells], dtype=np.bool_)
        return reachable, np.repeat(is_reached[:, np.newaxis], self._heading_count, axis=1)


class _StandingPoses(NamedTuple):
    headings: Bytes
    start: tuple[float, ...]
    start_cell: Cell
    reachable: Bytes
    goal_headings: Mask
    passage_tree: PassageTree | None  # of a round robot, whose poses follow from it


def _standing_poses(
    ground: Ground, robot: footprint.Footprint | None, heading_count: int, start_cell: Cell | None,
    start: tuple[float, ...] | None, goal_cells: Sequence[Cell],
) -> _StandingPoses:  # fmt: skip
    closed_up_to = largest_closed_square(reach.reach_radius(robot), ground.frame)
    passage_tree = None
    default_start = None
    poses: paths.OpenPoses
    if robot is None or not robot.vertices:
        passage_tree = ground.passage_tree()
        if start is None:
            default_start = _default_start(ground, passage_tree, closed_up_to)
        poses = _RoundPoses(passage_tree, closed_up_to, heading_count)
    else:
        if start is None:
            default_start = _default_start(ground, ground.passage_tree(), closed_up_to)
        footprints = footprint.footprint_spans(robot, ground.frame, heading_count)
        poses = paths.open_poses(ground.untouchable, footprints, ground.keepout)
    if not poses.headings.any():
        raise MalformedInputError(f"no cell is open to {reach.robot_text(robot)}")
    if start_cell is None or start is None:
        # The robot's corners may not fit at the default start, and its inscribed circle nowhere.
        start_cell = nearest_marked(poses.headings > 0, default_start or (0, 0)) or (0, 0)
        start = tuple(ground.frame.xy_from_rowcol([start_cell])[0].round(_DECIMALS).tolist())
    start_headings = _headings_at(poses, start_cell, start, ground, robot)
    seeds = [(heading, *start_cell) for heading in start_headings]
    reachable, goal_headings = poses.reach(seeds, goal_cells)
    return _StandingPoses(poses.headings, start, start_cell, reachable, goal_headings, passage_tree)


def _default_start(ground: Ground, passage_tree: PassageTree, closed_up_to: int) -> Cell | None:
    """Return the default start: the cell with the most clearance in the largest open area."""
    # Closed unknown cells limit the clearance, too: a stray beam into unknown space is not roomy.
    inside = passage_tree.in_largest_area(closed_up_to)
    if inside is None:
        return None
    squared = squares_to(ground.blocked)
    squared[~inside] = -1
    is_widest = squared == squared.max()
    # of several such cells, the one farthest from obstacles
    np.copyto(squared, passage_tree.squared, where=is_widest)
    squared[~is_widest] = -1
    row, col = divmod(int(np.argmax(squared)), squared.shape[1])
    return row, col


def _headings_at(
    poses: paths.OpenPoses, cell: Cell, start: Sequence[float], ground: Ground,
    robot: footprint.Footprint | None,
) -> list[int]:  # fmt: skip
    is_open = poses.at(*cell)
    open_headings = np.flatnonzero(is_open)
    if not len(open_headings):
        square = int(squares_to(ground.obstacles)[cell])
        rule = f"lies in a closed cell ({_closed_text(ground, cell, square, robot)})"
        hint = nearest_open_text(ground.frame, poses.headings > 0, cell)
        raise ParameterError(rule, place="start", got=tuple(start[:2]), hint=hint)
    if len(start) == 2:
        return list(map(int, open_headings))
    count = len(is_open)
    heading = round(start[2] / _TURN * count) % count
    if not is_open[heading]:
        away = np.abs((open_headings - heading + count // 2) % count - count // 2)
        nearest = float(open_headings[np.argmin(away)]) * _TURN / count
        open_count = len(open_headings)
        rule = f"the robot cannot stand there in this heading, only in {open_count} of {count}"
        hint = f"the nearest open heading is {nearest:.4g}; without a yaw all that are open count"
        raise ParameterError(rule, place="start", got=tuple(start), hint=hint)
    return [heading]


def _closed_text(ground: Ground, cell: Cell, square: int, robot: footprint.Footprint | None) -> str:
    if not ground.frame.holds(cell):
        return "outside of the map"
    if ground.occupancy[cell] == map_values.OCCUPIED:
        return "an obstacle"
    if ground.keepout is not None and ground.keepout[cell]:
        return "in a keepout area"
    if ground.occupancy[cell] == map_values.UNKNOWN and not ground.through_unknown:
        return "unknown"
    if robot is not None and robot.vertices:
        return "too narrow for the robot in every heading"
    clearance = reach.width_of(square, ground.frame.resolution) / 2
    row, col = cell
    height, width = ground.frame.shape
    to_edge = min(row + 1, height - row, col + 1, width - col)
    nearest = "the map's edge" if to_edge**2 == square else "an obstacle"
    radius = reach.reach_radius(robot)
    return f"{clearance:.4g} m from {nearest}, the robot's radius is {radius:.4g} m"


def _answer(
    goal: Goal, cell: Cell, heading_count: int, from_start: RootedPassageTree, ground: Ground,
    robot: footprint.Footprint | None, is_open: Mask,
) -> GoalReach:  # fmt: skip
    frame = ground.frame
    widest, limited_by, square = 0.0, None, 0
    if frame.holds(cell):
        square = int(from_start.passage_tree.squared[cell])
        limited_by = bottleneck_on_way(from_start, cell)
        widest = 0.0 if limited_by is None else limited_by.width / 2
        if is_open[cell]:
            return GoalReach(goal, heading_count > 0, heading_count, widest, limited_by)
    reason = _closed_text(ground, cell, square, robot)
    x, y = frame.xy_from_rowcol([nearest_marked(is_open, cell) or cell])[0].tolist()
    return GoalReach(goal, False, 0, widest, limited_by, reason, (x, y))
