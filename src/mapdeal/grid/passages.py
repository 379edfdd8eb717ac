"""The narrow places of a map that matter to a robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.open_cells import Cell
from mapdeal.grid.reach import Bottleneck, Passage, width_of
from mapdeal.grid.ways import Ground, Ways, WaysFrom, largest_closed_square
from mapdeal.kernels.clearance_tree import ClearanceTree, RootedTree
from mapdeal.kernels.meetings import joined, saddles_between, sums_behind

DEFAULT_MARGIN = 0.1
"""Of radius, metres: a robot that is larger by as much would be stopped."""

DEFAULT_MIN_AREA = 1.0
"""Square metres on each side of a passage."""


def passages(
    ways: Ways,
    is_open: NDArray[np.bool_],
    start: Cell,
    *,
    radius: float,
    margin: float = DEFAULT_MARGIN,
    min_area: float = DEFAULT_MIN_AREA,
    circumscribed_radius: float | None = None,
    is_reached: NDArray[np.bool_] | None = None,
) -> tuple[Passage, ...]:
    """Return the passages that stop a robot or barely let it pass, the narrowest first."""
    tree = ways.tree
    root = int(tree.basins[start])
    if root < 0 or not len(tree.squares):
        return ()
    closed, tight = (
        largest_closed_square(one, ways.frame) for one in (radius, radius + margin)
    )  # fmt: skip
    levels = [(closed, -1), (tight, closed)]
    if is_reached is not None and circumscribed_radius is not None:
        levels.append((largest_closed_square(circumscribed_radius, ways.frame), tight))
    counts, least = ways.counts(is_open), ways.least_count(min_area)
    meetings = [
        _meetings(tree, counts, root, wide, narrow, least)
        for wide, narrow in levels
        if wide > narrow
    ]
    edges = np.concatenate(meetings)
    if not len(edges):
        return ()
    values = counts[:, np.newaxis]
    if is_reached is not None:
        values = np.column_stack([counts, ways.counts(is_reached)])
    behind, near, far = _behind(tree, edges, root, values)
    is_passed = tree.squares[edges] > closed
    is_kept = behind[:, 0] > 0  # nan: there is no way
    if is_reached is not None:
        is_passed = behind[:, 1] >= np.minimum(least, behind[:, 0] / 2)
        is_kept &= (tree.squares[edges] <= tight) | (~is_passed & (near[:, 1] > 0))
    cells = [(int(tree.cells[edges[which]]), which) for which in np.flatnonzero(is_kept).tolist()]
    stops = is_kept & ~is_passed
    begin = 0
    for level in meetings:
        of_level = slice(begin, begin := begin + len(level))
        if stops[of_level].any():
            doors = _other_doors(ways, level, far[of_level], behind[of_level, 0])
            cells += [(cell, of_level.start + i) for cell, i in doors if stops[of_level][i]]
    made = [
        _passage(ways, cell, float(behind[which, 0]), bool(is_passed[which]))
        for cell, which in cells
    ]
    return tuple(sorted(made, key=_order))


def _order(one: Passage) -> tuple[object, ...]:
    return one.width, -one.cut_off, one.ends


def disconnected(
    grid: OccupancyGrid, radius: float, min_area: float = DEFAULT_MIN_AREA
) -> list[Passage]:
    """Return the passages that stop a round robot between areas of a map.

    If no way at all connects some parts of the map, each part is seen from its own largest area.
    """
    ways, is_open = _ways_of(grid, radius)
    counts, basins = _regions(ways, is_open, radius)
    parts, _ = joined(len(counts), ways.tree.one, ways.tree.other)
    _, first, which = np.unique(parts[basins], return_index=True, return_inverse=True)
    largest = counts[basins[first]]
    others = np.bincount(which, counts[basins], minlength=len(first)) - largest
    is_parted = np.minimum(largest, others) >= ways.least_count(min_area)
    found: list[Passage] = []
    for basin in basins[first[is_parted]].tolist():
        start = divmod(int(ways.tree.peak_cells[basin]), grid.frame.width)
        found += passages(ways, is_open, start, radius=radius, margin=0.0, min_area=min_area)
    return sorted(found, key=_order)


def bottleneck_on_way(from_start: WaysFrom, goal: Cell) -> Bottleneck | None:
    """Return the narrowest place on the widest way from the start to a goal."""
    ways, start, rooted = from_start.ways, from_start.start, from_start.rooted
    tree, squared = ways.tree, ways.squared
    basin = int(tree.basins[goal])
    if rooted is None or basin < 0 or rooted.bottlenecks[basin] < 0:
        return None
    at_start, at_goal, on_way = (
        int(square) for square in (squared[start], squared[goal], rooted.bottlenecks[basin])
    )
    square = min(at_start, at_goal, on_way)
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
        basin = int(tree.one[edge]) + int(tree.other[edge]) - basin
    return None


def _meetings(
    tree: ClearanceTree,
    counts: NDArray[np.float64],
    root: int,
    wide: int,
    narrow: int,
    least: float,
) -> NDArray[np.intp]:
    """Return the edges at which large regions meet, of squares above `narrow` and up to `wide`.

    A region is what is connected by wider edges; that of the root may be small. Where a robot is
    stopped, small regions that lie behind one another are a large one together.
    """
    first, end = (_first_not_above(tree.squares, limit) for limit in (wide, narrow))
    count = len(counts)
    labels, _ = joined(count, tree.one[:first], tree.other[:first])
    sizes = np.bincount(labels, counts, minlength=count)
    is_large = sizes >= least
    is_large[labels[root]] = True
    is_large &= tree.peaks > wide
    ends = labels[np.array([tree.one[first:end], tree.other[first:end]])]
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
    ends = labels[np.array([tree.one[edges], tree.other[edges], np.full(len(edges), root)])]
    used, ends = np.unique(ends, return_inverse=True)
    ends = ends.reshape(3, -1)
    sums = np.column_stack(
        [np.bincount(labels, column, minlength=len(values))[used] for column in values.T]
    )
    behind, near, far = sums_behind(ends[0], ends[1], int(ends[2, 0]), sums)
    return behind, sums[near], np.where(far < 0, -1, used[far])


def _parted(tree: ClearanceTree, edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return for each basin a basin that stands for all that it is joined to without some edges."""
    is_other = np.ones(len(tree.one), dtype=np.bool_)
    is_other[edges] = False
    return joined(len(tree.peaks), tree.one[is_other], tree.other[is_other])[0]


def _other_doors(
    ways: Ways,
    edges: NDArray[np.intp],
    far: NDArray[np.intp],
    behind: NDArray[np.float64],
) -> Iterator[tuple[int, int]]:
    """Yield the other doors between areas than the edges, the widest ones, that part them.

    Each is the flat index of its narrowest cell, and which of the edges leads to the same area.
    What is less than half as wide as that edge is left out: a laser's walls are full of holes.
    """
    labels = _parted(ways.tree, edges)
    leading_to = {
        label: which
        for which, label in enumerate(np.where(far < 0, -1, labels[far]).tolist())
        if label >= 0
    }
    cells, squares = ways.tree.cells[edges].tolist(), ways.tree.squares[edges].tolist()
    for cell, *ends in saddles_between(ways.squared, ways.tree.basins, labels).tolist():
        found = [leading_to[label] for label in ends if label in leading_to]
        if found and cell not in cells:
            which = min(found, key=lambda which: float(behind[which]))
            if 4 * ways.squared.flat[cell] >= squares[which]:
                yield cell, which


def _passage(ways: Ways, cell: int, behind: float, is_open: bool) -> Passage:
    x, y = ways.middle(cell)
    width = width_of(int(ways.squared.flat[cell]), ways.frame.resolution)
    return Passage(x, y, width, behind * ways.cell_area, is_open, ways.gap(cell))


def _first_not_above(falling: NDArray[np.int64], limit: int) -> int:
    return int(np.searchsorted(-falling, -limit, side="left"))


def _ways_of(grid: OccupancyGrid, radius: float) -> tuple[Ways, NDArray[np.bool_]]:
    """Return how wide the ways over the free cells of a map are, and where a robot fits."""
    ways = Ground(grid.occupancy, grid.frame, through_unknown=False).ways()
    return ways, ways.is_open(largest_closed_square(radius, grid.frame))


def _regions(
    ways: Ways, is_open: NDArray[np.bool_], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return how many cells each basin's region has, and a basin of each, the largest first.

    A region's basin is the one with its widest place.
    """
    tree = ways.tree
    end = _first_not_above(tree.squares, largest_closed_square(radius, ways.frame))
    labels, _ = joined(len(tree.peaks), tree.one[:end], tree.other[:end])
    own = ways.counts(is_open)
    counts: NDArray[np.float64] = np.bincount(labels, own, len(labels))[labels].astype(np.float64)
    order = np.lexsort((-tree.peaks, labels))
    widest = order[np.flatnonzero(np.diff(labels[order], prepend=-1))]
    widest = widest[counts[widest] > 0]
    return counts, widest[np.lexsort((widest, -counts[widest]))]
