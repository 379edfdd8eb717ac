"""What a robot can reach, and the passages that limit it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid.footprint import Footprint, footprint_spans
from mapdeal.grid.frame import (
    CELL_TOLERANCE,
    Frame,
    Point,
    check_point,
    largest_square_within,
    warn_of_degrees,
)
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import (
    Bottleneck,
    Goal,
    GoalReach,
    Passage,
    Reach,
    reach_radius,
    robot_text,
    width_of,
)
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels import components, paths
from mapdeal.kernels.arrays import Bytes, Mask, SquaredDistances
from mapdeal.kernels.components import ClearanceTree, RootedTree, joined
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.polygons import Pose
from mapdeal.kernels.threads import for_rows

Cell = tuple[int, int]


def cell_of_point(frame: Frame, point: Point, name: str) -> Cell:
    cells, inside = frame.bounded_rowcol_from_xy([check_point(point, name)])
    if not inside[0]:
        corners = [[row, col] for row in (0, frame.height) for col in (0, frame.width)]
        corners_xy = frame.xy_from_continuous_rowcol(corners).round(6) + 0.0
        (x, y), (right, top) = corners_xy.min(axis=0).tolist(), corners_xy.max(axis=0).tolist()
        hint = f"the map lies within x {x:.10g} .. {right:.10g}, y {y:.10g} .. {top:.10g}"
        raise ParameterError("lies outside of the map", place=name, got=point, hint=hint)
    row, col = cells[0].tolist()
    return row, col


def nearest_open_text(frame: Frame, is_open: NDArray[np.bool_], cell: Cell) -> str:
    nearest = nearest_marked(is_open, cell)
    if nearest is None:
        return "no cell of the map is open"
    x, y = frame.xy_from_rowcol([nearest])[0].round(6).tolist()
    metres = math.dist(nearest, cell) * frame.resolution
    return f"the nearest open cell is {metres:.3g} m away, at {x + 0.0:.10g},{y + 0.0:.10g}"


def nearest_marked(marked: NDArray[np.bool_], cell: Cell) -> Cell | None:
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
class Ways:
    """The widths of the ways between the cells of a map: its clearance tree, in metres."""

    tree: ClearanceTree
    squared: SquaredDistances
    frame: Frame
    _gaps: dict[int, tuple[Point, Point]] = field(default_factory=dict, init=False, repr=False)

    @property
    def cell_area(self) -> float:
        return self.frame.resolution * self.frame.resolution

    def counts(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        counts, lock = np.zeros(len(self.tree.peaks)), Lock()

        def add(rows: slice) -> None:
            inside = self.tree.basins[rows][mask[rows]]
            inside = inside[inside >= 0]  # a robot may stand beside its centre, in an obstacle
            if not len(inside):
                return
            first = int(inside.min())  # basins are numbered by rows: a few are near together
            found = np.bincount(inside - first)
            with lock:
                counts[first : first + len(found)] += found

        for_rows(add, mask.shape)
        return counts

    def least_count(self, area: float) -> float:
        """Return how many cells make an area in square metres, exact multiples exactly."""
        return area / self.cell_area * (1 - CELL_TOLERANCE)

    def gap(self, saddle: int) -> tuple[Point, Point]:
        """Return the ends of the gap that a cell, by its flat index, lies in; computed once."""
        if saddle not in self._gaps:
            row, col = divmod(saddle, self.frame.width)
            ends = components.gap_at(self.squared, self.tree.basins, (row, col))
            first, second = self.frame.xy_from_rowcol(ends).tolist()
            self._gaps[saddle] = (first[0], first[1]), (second[0], second[1])
        return self._gaps[saddle]

    def middle(self, saddle: int) -> Point:
        (x, y), (other_x, other_y) = self.gap(saddle)
        return (x + other_x) / 2, (y + other_y) / 2

    def is_open(self, closed_up_to: int) -> NDArray[np.bool_]:
        """Return the cells that ways may use above a square, shape (H, W)."""
        return self.cells_of(np.ones(len(self.tree.peaks), dtype=np.bool_), closed_up_to)

    def in_largest_area(self, closed_up_to: int) -> NDArray[np.bool_] | None:
        """Return the cells of the largest area above a square, shape (H, W), if there is one."""
        # Areas are connected by the four straight neighbours. Of areas of equal size, the one whose
        # first basin comes first is returned.
        tree = self.tree
        areas = paths.basin_areas(tree, self.squared, closed_up_to)
        if not areas.any():
            return None
        is_wider = tree.squares > closed_up_to
        labels, _ = joined(len(areas), tree.firsts[is_wider], tree.seconds[is_wider])
        largest = np.argmax(np.bincount(labels, weights=areas))
        return self.cells_of(labels == largest, closed_up_to)

    def cells_of(self, is_chosen: NDArray[np.bool_], closed_up_to: int) -> NDArray[np.bool_]:
        """Return the cells above a square that are in some of the basins, shape (H, W)."""
        by_basin = np.append(is_chosen, False)  # -1 is the last one
        found = np.empty(self.squared.shape, dtype=np.bool_)

        def fill(rows: slice) -> None:
            np.greater(self.squared[rows], closed_up_to, out=found[rows])
            found[rows] &= by_basin[self.tree.basins[rows]]

        for_rows(fill, found.shape)
        return found

    def begun_at(self, start: Cell) -> WaysFrom:
        basin = int(self.tree.basins[start])
        return WaysFrom(self, start, None if basin < 0 else paths.rooted(self.tree, basin))


@dataclass(frozen=True, eq=False)
class Ground:
    """The map that a robot moves on."""

    occupancy: NDArray[np.int8]
    frame: Frame
    through_unknown: bool
    keepout: NDArray[np.bool_] | None = None
    """Cells that the robot's centre must not enter; they are no obstacles to its shape."""

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """Mask of obstacles, computed on each access to save memory."""
        return np.equal(self.occupancy, OCCUPIED)

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """Mask of cells that no way leads through, computed on each access."""
        blocked = self.untouchable
        if self.keepout is not None:
            blocked |= self.keepout
        return blocked

    @property
    def untouchable(self) -> NDArray[np.bool_]:
        """Mask of cells that no part of the robot may touch, computed on each access."""
        blocked = self.obstacles
        if not self.through_unknown:

            def close_unknown(rows: slice) -> None:
                blocked[rows] |= self.occupancy[rows] == UNKNOWN

            for_rows(close_unknown, blocked.shape)
        return blocked

    def ways(self) -> Ways:
        squared = squares_to(self.obstacles)
        traversable = self.blocked
        np.logical_not(traversable, out=traversable)
        return Ways(paths.clearance_tree(squared, traversable), squared, self.frame)


@dataclass(frozen=True, eq=False)
class WaysFrom:
    ways: Ways
    start: Cell
    rooted: RootedTree | None

    def reachable(self, closed_up_to: int) -> NDArray[np.uint8]:
        """Return 1 for cells that a way staying above a square leads to, else 0, shape (H, W)."""
        squared = self.ways.squared
        if self.rooted is None or squared[self.start] <= closed_up_to:
            return np.zeros(squared.shape, dtype=np.uint8)
        is_reached = self.rooted.bottlenecks > closed_up_to
        return self.ways.cells_of(is_reached, closed_up_to).view(np.uint8)

    def widest(self) -> NDArray[np.float32]:
        """Return the least clearance on the widest way to each cell, metres, 0 if there is none."""
        tree, squared, resolution = self.ways.tree, self.ways.squared, self.ways.frame.resolution
        if self.rooted is None:
            return np.zeros(squared.shape, dtype=np.float32)
        return paths.widest_metres(
            tree, self.rooted, squared, self.start, resolution, in_place=True
        )


def squares_to(marked: NDArray[np.bool_]) -> SquaredDistances:
    """Return the squared distance of each cell to the nearest cell that is marked or outside."""
    squared = squared_distance(marked)
    up, right = (np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1), dtype=squared.dtype) ** 2
                 for n in squared.shape)  # fmt: skip

    def lower(rows: slice) -> None:
        np.minimum(squared[rows], right, out=squared[rows])
        np.minimum(squared[rows], up[rows, np.newaxis], out=squared[rows])

    for_rows(lower, squared.shape)
    return squared


def largest_closed_square(radius: float, frame: Frame) -> int:
    """Return the largest squared distance in cells that is closed to a round robot."""
    # Cells at this distance have cost 253 around an obstacle, those beyond it less.
    return largest_square_within(min(radius, max(frame.size_xy)), frame.resolution)


DEFAULT_HEADINGS = 72


def passages(
    clearances: Ways, is_open: NDArray[np.bool_], start: Cell, *, radius: float, margin: float,
    min_area: float, circumscribed_radius: float | None = None,
    is_reached: NDArray[np.bool_] | None = None,
) -> tuple[Passage, ...]:  # fmt: skip
    """Return the passages that stop a robot, or a robot larger by a margin, and cut off an area."""
    tree = clearances.tree
    root = int(tree.basins[start])
    if root < 0 or not len(tree.squares):
        return ()
    closed, tight = (largest_closed_square(r, clearances.frame) for r in (radius, radius + margin))
    levels = [(closed, -1), (tight, closed)]
    if is_reached is not None and circumscribed_radius is not None:
        levels.append((largest_closed_square(circumscribed_radius, clearances.frame), tight))
    counts, least = clearances.counts(is_open), clearances.least_count(min_area)
    rising = [(wide, narrow) for wide, narrow in levels if wide > narrow]
    meetings = [_meetings(tree, counts, root, wide, narrow, least) for wide, narrow in rising]
    edges = np.concatenate(meetings)
    if not len(edges):
        return ()
    values = counts[:, np.newaxis]
    if is_reached is not None:
        values = np.column_stack([counts, clearances.counts(is_reached)])
    behind, near, far = _behind(tree, edges, root, values)
    is_passed = tree.squares[edges] > closed
    is_kept = behind[:, 0] > 0  # nan: there is no way
    if is_reached is not None:
        is_passed = behind[:, 1] >= np.minimum(least, behind[:, 0] / 2)
        # A passage behind a closed one stops the robot for sure only if its inscribed circle does.
        limits = np.where(is_passed, tight, closed)
        is_kept &= (tree.squares[edges] <= limits) | (~is_passed & (near[:, 1] > 0))
    cells = [(int(tree.cells[edges[which]]), which) for which in np.flatnonzero(is_kept).tolist()]
    stops = is_kept & ~is_passed
    begin = 0
    for level in meetings:
        of_level = slice(begin, begin := begin + len(level))
        if stops[of_level].any():
            doors = _other_doors(clearances, level, far[of_level], behind[of_level, 0])
            cells += [(cell, of_level.start + i) for cell, i in doors if stops[of_level][i]]
    found = []
    for cell, which in cells:
        width = width_of(int(clearances.squared.flat[cell]), clearances.frame.resolution)
        area, passes = float(behind[which, 0]) * clearances.cell_area, bool(is_passed[which])
        found.append(Passage(*clearances.middle(cell), width, area, passes, clearances.gap(cell)))
    return tuple(sorted(found, key=_order))


def _order(passage: Passage) -> tuple[object, ...]:
    return passage.width, -passage.cut_off, passage.ends


def disconnected(grid: OccupancyGrid, radius: float, min_area: float) -> list[Passage]:
    # If no way at all connects some parts of the map, each part is seen from its own largest area.
    ways = Ground(grid.occupancy, grid.frame, through_unknown=False).ways()
    is_open = ways.is_open(largest_closed_square(radius, grid.frame))
    counts, basins = _regions(ways, is_open, radius)
    parts, _ = joined(len(counts), ways.tree.firsts, ways.tree.seconds)
    _, first, which = np.unique(parts[basins], return_index=True, return_inverse=True)
    largest = counts[basins[first]]
    remaining = np.bincount(which, counts[basins], minlength=len(first)) - largest
    is_parted = np.minimum(largest, remaining) >= ways.least_count(min_area)
    found: list[Passage] = []
    for basin in basins[first[is_parted]].tolist():
        start = divmod(int(ways.tree.peak_cells[basin]), grid.frame.width)
        found += passages(ways, is_open, start, radius=radius, margin=0.0, min_area=min_area)
    return sorted(found, key=_order)


def bottleneck_on_way(from_start: WaysFrom, goal: Cell) -> Bottleneck | None:
    ways, start, rooted = from_start.ways, from_start.start, from_start.rooted
    tree, squared = ways.tree, ways.squared
    basin = int(tree.basins[goal])
    if rooted is None or basin < 0 or rooted.bottlenecks[basin] < 0:
        return None
    at_start = int(squared[start])
    square = min(at_start, int(squared[goal]), int(rooted.bottlenecks[basin]))
    width = width_of(square, ways.frame.resolution)
    edge = _first_edge(tree, rooted, basin, square)
    if edge is not None:
        x, y = ways.middle(int(tree.cells[edge]))
        return Bottleneck(x, y, width, "passage")
    place = start if at_start == square else goal
    x, y = ways.frame.xy_from_rowcol([place])[0].tolist()
    return Bottleneck(x, y, width, "start" if at_start == square else "goal")


def _first_edge(tree: ClearanceTree, rooted: RootedTree, basin: int, square: int) -> int | None:
    """Return the first edge towards the root that is as narrow as a square."""
    while (edge := int(rooted.parent_edges[basin])) >= 0:
        if tree.squares[edge] <= square:
            return edge
        basin = int(tree.firsts[edge]) + int(tree.seconds[edge]) - basin
    return None


def _meetings(
    tree: ClearanceTree, counts: NDArray[np.float64], root: int, wide: int, narrow: int,
    least: float,
) -> NDArray[np.intp]:  # fmt: skip
    """Return the edges at which large regions meet, of squares above `narrow` and up to `wide`."""
    # A region is a set of basins connected by wider edges; that of the root may be small. If the
    # robot is stopped, consecutive small regions count together as a large one.
    first, end = (_first_not_above(tree.squares, limit) for limit in (wide, narrow))
    count = len(counts)
    labels, _ = joined(count, tree.firsts[:first], tree.seconds[:first])
    sizes = np.bincount(labels, counts, minlength=count)
    is_large = sizes >= least
    is_large[labels[root]] = True
    is_large &= tree.peaks > wide
    ends = labels[np.array([tree.firsts[first:end], tree.seconds[first:end]])]
    if narrow >= 0:
        return first + joined(count, ends[0], ends[1], is_large)[1]
    is_piece = is_large | ((sizes > 0) & (tree.peaks > wide))
    pieces, between = joined(count, ends[0], ends[1], is_piece)
    ends = pieces[ends[:, between]]
    is_meeting = np.zeros(len(between), dtype=np.bool_)
    is_meeting[joined(count, ends[0], ends[1], is_large)[1]] = True
    is_small = ~is_large[ends]
    within = ends[:, is_small.all(axis=0) & ~is_meeting]
    clusters, _ = joined(count, within[0], within[1])
    in_clusters = np.bincount(clusters, np.where(is_large, 0, sizes), minlength=count)
    hidden = np.where(is_small, in_clusters[clusters[ends]], 0).max(axis=0)
    is_meeting |= (is_small.sum(axis=0) == 1) & (hidden >= least)
    return first + between[is_meeting]


def _behind(
    tree: ClearanceTree, edges: NDArray[np.intp], root: int, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Return the sum behind each of some edges, that right before it, and a basin behind it."""
    labels = _parted(tree, edges)
    ends = labels[np.array([tree.firsts[edges], tree.seconds[edges], np.full(len(edges), root)])]
    used, ends = np.unique(ends, return_inverse=True)
    ends = ends.reshape(3, -1)
    columns = [np.bincount(labels, column, minlength=len(values)) for column in values.T]
    sums = np.column_stack(columns)[used]
    behind, near, far = components.sums_behind(ends[0], ends[1], int(ends[2, 0]), sums)
    return behind, sums[near], np.where(far < 0, -1, used[far])


def _parted(tree: ClearanceTree, edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return for each basin a basin that stands for all that it is joined to without some edges."""
    is_other = np.ones(len(tree.firsts), dtype=np.bool_)
    is_other[edges] = False
    return joined(len(tree.peaks), tree.firsts[is_other], tree.seconds[is_other])[0]


def _other_doors(
    ways: Ways, edges: NDArray[np.intp], far: NDArray[np.intp], behind: NDArray[np.float64]
) -> Iterator[tuple[int, int]]:
    """Yield the other doors between areas than the edges, the widest ones, that part them."""
    # Each is the flat index of its narrowest cell, and which of the edges leads to the same area.
    # Doors less than half as wide as that edge are skipped: walls seen by lasers are full of holes.
    labels = _parted(ways.tree, edges)
    labels_beyond = enumerate(np.where(far < 0, -1, labels[far]).tolist())
    leading_to = {label: which for which, label in labels_beyond if label >= 0}
    cells, squares = ways.tree.cells[edges].tolist(), ways.tree.squares[edges].tolist()
    for cell, *ends in components.saddles_between(ways.squared, ways.tree.basins, labels).tolist():
        found = [leading_to[label] for label in ends if label in leading_to]
        if found and cell not in cells:
            # of two that lead to the same cells, as nobody fits between them, the wider one
            which = min(found, key=lambda which: (float(behind[which]), -squares[which]))
            if 4 * ways.squared.flat[cell] >= squares[which]:
                yield cell, which


def _first_not_above(falling: NDArray[np.int64], limit: int) -> int:
    return int(np.searchsorted(-falling, -limit, side="left"))


def _regions(
    ways: Ways, is_open: NDArray[np.bool_], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    # A region's basin is the one with its widest place.
    tree = ways.tree
    end = _first_not_above(tree.squares, largest_closed_square(radius, ways.frame))
    labels, _ = joined(len(tree.peaks), tree.firsts[:end], tree.seconds[:end])
    own = ways.counts(is_open)
    counts: NDArray[np.float64] = np.bincount(labels, own, len(labels))[labels].astype(np.float64)
    order = np.lexsort((-tree.peaks, labels))
    widest = order[np.flatnonzero(np.diff(labels[order], prepend=-1))]
    widest = widest[counts[widest] > 0]
    return counts, widest[np.lexsort((widest, -counts[widest]))]


_TURN = 2 * math.pi
_DECIMALS = 9


def reach_on(
    ground: Ground, robot: Footprint | None, *, start: Sequence[float] | None,
    goals: Sequence[Goal], headings: int, margin: float, min_area: float,
) -> Reach:  # fmt: skip
    """Compute where a robot can go; see the stage ``reach``."""
    if start is not None and len(start) not in (2, 3):
        raise ParameterError("must be x,y or x,y,yaw", place="start", got=tuple(start))
    pose = None if start is None else tuple(start)
    if pose is not None and len(pose) == 3:
        warn_of_degrees(pose[2], "start")
    first = None if pose is None else cell_of_point(ground.frame, (pose[0], pose[1]), "start")
    names = ["goal" if goal.name is None else f"goal {goal.name}" for goal in goals]
    points = [check_point((goal.x, goal.y), name) for goal, name in zip(goals, names, strict=True)]
    cells = [(row, col) for row, col in ground.frame.unbounded_rowcol_from_xy(points).tolist()]
    inside = [cell for cell in cells if ground.frame.holds(cell)]
    # robots with corners first: what both need at once would take twice the memory
    stood = _stood(ground, robot, headings, first, pose, inside)
    ways = ground.ways() if stood.ways is None else stood.ways
    from_start = ways.begun_at(stood.first)
    is_open = stood.headings > 0
    counts = dict(zip(inside, stood.goal_headings.sum(axis=1).tolist(), strict=True))
    answers = [_answer(goal, cell, counts.get(cell, 0), from_start, ground, robot, is_open)
               for goal, cell in zip(goals, cells, strict=True)]  # fmt: skip
    has_corners = robot is not None and bool(robot.vertices)
    found = passages(
        ways, is_open, stood.first, radius=reach_radius(robot), margin=margin, min_area=min_area,
        circumscribed_radius=robot.circumscribed_radius if robot is not None else None,
        is_reached=stood.reachable.view(np.bool_) if has_corners else None,
    )  # fmt: skip
    del is_open
    widest = from_start.widest()  # in the memory of the basins, which are of no more use
    clearance = paths.clearance_metres(ways.squared, ground.frame.resolution, in_place=True)
    return Reach(
        stood.reachable, stood.headings, clearance, widest, ground.occupancy,
        ground.frame.resolution, ground.frame.origin, start=stood.start, robot=robot,
        heading_count=headings, through_unknown=ground.through_unknown, goals=tuple(answers),
        passages=found,
    )  # fmt: skip


def cells_open_to(ground: Ground, robot: Footprint | None, start: Cell) -> NDArray[np.bool_]:
    # Those that are open to a round robot need not all be connected.
    if robot is None or not robot.vertices:
        closed_up_to = largest_closed_square(reach_radius(robot), ground.frame)
        return np.asarray((squares_to(ground.obstacles) > closed_up_to) & ~ground.blocked)
    footprints = footprint_spans(robot, ground.frame, DEFAULT_HEADINGS)
    poses = paths.open_poses(ground.untouchable, footprints, ground.keepout)
    seeds = [(int(heading), *start) for heading in np.flatnonzero(poses.at(*start))]
    return poses.reach(seeds, [])[0].view(np.bool_)


class _RoundPoses(paths.OpenPoses):
    """The poses of a round robot, which fits in all headings or none."""

    def __init__(self, ways: Ways, closed_up_to: int, heading_count: int) -> None:
        self._ways, self._closed_up_to = ways, closed_up_to
        self._heading_count = heading_count
        self.headings = ways.is_open(closed_up_to).view(np.uint8)
        self.headings *= np.uint8(heading_count)

    def at(self, row: int, col: int) -> Mask:
        return np.full(self._heading_count, self.headings[row, col] > 0)

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell]) -> tuple[Bytes, Mask]:
        reachable = self._ways.begun_at(seeds[0][1:]).reachable(self._closed_up_to)
        is_reached = np.array([reachable[cell] > 0 for cell in cells], dtype=np.bool_)
        return reachable, np.repeat(is_reached[:, np.newaxis], self._heading_count, axis=1)


class _Stood(NamedTuple):
    """Where a robot can stand, and where it gets to from its start."""

    headings: Bytes
    start: tuple[float, ...]
    first: Cell
    reachable: Bytes
    goal_headings: Mask
    ways: Ways | None


def _stood(
    ground: Ground, robot: Footprint | None, heading_count: int, first: Cell | None,
    start: tuple[float, ...] | None, cells: Sequence[Cell],
) -> _Stood:  # fmt: skip
    ways = None
    closed_up_to = largest_closed_square(reach_radius(robot), ground.frame)
    poses: paths.OpenPoses
    widest = None
    if robot is None or not robot.vertices:
        ways = ground.ways()
        if start is None:
            widest = _widest_place(ground, ways, closed_up_to)
        poses = _RoundPoses(ways, closed_up_to, heading_count)
    else:
        if start is None:
            widest = _widest_place(ground, ground.ways(), closed_up_to)
        footprints = footprint_spans(robot, ground.frame, heading_count)
        poses = paths.open_poses(ground.untouchable, footprints, ground.keepout)
    if not poses.headings.any():
        raise MalformedInputError(f"no cell is open to {robot_text(robot)}")
    if first is None or start is None:
        # the robot's corners may not fit there, and even its inscribed circle may fit nowhere
        first = nearest_marked(poses.headings > 0, widest or (0, 0)) or (0, 0)
        start = tuple(ground.frame.xy_from_rowcol([first])[0].round(_DECIMALS).tolist())
    seeds = [(heading, *first) for heading in _headings_at(poses, first, start, ground, robot)]
    return _Stood(poses.headings, start, first, *poses.reach(seeds, cells), ways)


def _widest_place(ground: Ground, ways: Ways, closed_up_to: int) -> Cell | None:
    """Return where to start if nobody says: in the largest area, the place with the most room."""
    # Unknown cells that are closed count here, too: a stray beam far from all obstacles is no room.
    inside = ways.in_largest_area(closed_up_to)
    if inside is None:
        return None
    room = squares_to(ground.blocked)
    room[~inside] = -1
    is_widest = room == room.max()
    np.copyto(room, ways.squared, where=is_widest)  # of equal ones the one farthest from walls
    room[~is_widest] = -1
    row, col = divmod(int(np.argmax(room)), room.shape[1])
    return row, col


def _headings_at(
    poses: paths.OpenPoses, first: Cell, start: Sequence[float], ground: Ground,
    robot: Footprint | None,
) -> list[int]:  # fmt: skip
    is_open = poses.at(*first)
    turns = np.flatnonzero(is_open)
    if not len(turns):
        square = int(squares_to(ground.obstacles)[first])
        rule = f"lies in a closed cell ({_closed_text(ground, first, square, robot)})"
        hint = nearest_open_text(ground.frame, poses.headings > 0, first)
        raise ParameterError(rule, place="start", got=tuple(start[:2]), hint=hint)
    if len(start) == 2:
        return list(map(int, turns))
    count = len(is_open)
    heading = round(start[2] / _TURN * count) % count
    if not is_open[heading]:
        away = np.abs((turns - heading + count // 2) % count - count // 2)
        nearest = float(turns[np.argmin(away)]) * _TURN / count
        rule = f"the robot cannot stand there in this heading, only in {len(turns)} of {count}"
        hint = f"the nearest open heading is {nearest:.4g}; without a yaw all that are open count"
        raise ParameterError(rule, place="start", got=tuple(start), hint=hint)
    return [heading]


def _closed_text(ground: Ground, cell: Cell, square: int, robot: Footprint | None) -> str:
    if not ground.frame.holds(cell):
        return "outside of the map"
    if ground.occupancy[cell] == OCCUPIED:
        return "an obstacle"
    if ground.keepout is not None and ground.keepout[cell]:
        return "in a keepout area"
    if ground.occupancy[cell] == UNKNOWN and not ground.through_unknown:
        return "unknown"
    if robot is not None and robot.vertices:
        return "too narrow for the robot in every heading"
    clearance = width_of(square, ground.frame.resolution) / 2
    row, col = cell
    height, width = ground.frame.shape
    to_edge = min(row + 1, height - row, col + 1, width - col)
    nearest = "the map's edge" if to_edge**2 == square else "an obstacle"
    return f"{clearance:.4g} m from {nearest}, the robot's radius is {reach_radius(robot):.4g} m"


def _answer(
    goal: Goal, cell: Cell, heading_count: int, from_start: WaysFrom, ground: Ground,
    robot: Footprint | None, is_open: NDArray[np.bool_],
) -> GoalReach:  # fmt: skip
    frame = ground.frame
    widest, limited_by, square = 0.0, None, 0
    if frame.holds(cell):
        square = int(from_start.ways.squared[cell])
        limited_by = bottleneck_on_way(from_start, cell)
        widest = 0.0 if limited_by is None else limited_by.width / 2
        if is_open[cell]:
            return GoalReach(goal, heading_count > 0, heading_count, widest, limited_by)
    reason = _closed_text(ground, cell, square, robot)
    x, y = frame.xy_from_rowcol([nearest_marked(is_open, cell) or cell])[0].tolist()
    return GoalReach(goal, False, 0, widest, limited_by, reason, (x, y))
