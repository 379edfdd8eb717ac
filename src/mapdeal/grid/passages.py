"""The narrow places of a map that matter to a robot."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.open_cells import Cell
from mapdeal.grid.reach import Bottleneck, Passage, width_of
from mapdeal.grid.ways import Ground, Ways, WaysFrom, largest_closed_square
from mapdeal.kernels.clearance_tree import ClearanceTree, RootedTree
from mapdeal.kernels.meetings import joined, sums_behind
from mapdeal.kernels.squares import unreachable

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
    """Return the passages that stop a robot or barely let it pass, the narrowest first.

    Parameters
    ----------
    ways : Ways
        Ways of the map and their widths.
    is_open : numpy.ndarray of bool, shape (H, W)
        Cells in which the robot can stand in some heading.
    start : tuple of int
        Row and column of the start, a cell that ways may use.
    radius : float
        Inscribed radius of the robot, metres.
    margin : float
        A passage barely lets the robot pass if it would stop a robot whose radius is larger by
        this margin, metres.
    min_area : float
        Least area on each side of a passage, square metres, counting open cells that are connected
        without it. The start's side may be smaller.
    circumscribed_radius : float, optional
        Circumscribed radius of the robot, metres. A robot that is not round may be stopped by
        passages up to this radius.
    is_reached : numpy.ndarray of bool, shape (H, W), optional
        Cells that its centre can reach, for a robot that is not round.

    Returns
    -------
    tuple of Passage
        One for each pair of areas connected by a way: the narrowest place of the widest way.
        Areas that no way connects have none.
    """
    tree = ways.tree
    root = int(tree.basins[start])
    if root < 0 or not len(tree.squares):
        return ()
    edge_radii, peak_radii = ways.metres(tree.squares), ways.metres(tree.peaks)
    areas = ways.areas(is_open)
    limits = [(radius, -math.inf), (radius + margin, radius)]
    if is_reached is not None and circumscribed_radius is not None:
        limits.append((max(circumscribed_radius, radius + margin), radius + margin))
    found = [
        _meetings(tree, edge_radii, peak_radii, areas, root, wide, narrow, min_area)
        for wide, narrow in limits
        if wide > narrow
    ]
    edges = np.concatenate(found)
    if not len(edges):
        return ()
    values = areas[:, np.newaxis]
    if is_reached is not None:
        values = np.column_stack([areas, ways.areas(is_reached)])
    behind, near = _behind(tree, edges, root, values)
    is_passed = edge_radii[edges] > radius
    is_kept = behind[:, 0] > 0  # nan: there is no way
    if is_reached is not None:
        is_passed = behind[:, 1] >= np.minimum(min_area, behind[:, 0] / 2)
        is_kept &= (edge_radii[edges] <= radius + margin) | (~is_passed & (near[:, 1] > 0))
    made = [
        _passage(ways, int(edge), float(area), passed)
        for edge, area, passed in zip(
            edges[is_kept], behind[is_kept, 0], is_passed[is_kept].tolist(), strict=True
        )
    ]
    return tuple(sorted(made, key=_order))


def _order(one: Passage) -> tuple[object, ...]:
    return one.width, -one.cut_off, one.ends


def disconnected(
    grid: OccupancyGrid, radius: float, min_area: float = DEFAULT_MIN_AREA
) -> list[Passage]:
    """Return the passages that stop a round robot between areas of a map.

    If no way at all connects some parts of the map, each part is seen from its own largest area.

    Parameters
    ----------
    grid : OccupancyGrid
        The map; ways lead over free cells.
    radius : float
        Radius of the robot, metres.
    min_area : float
        Least area on each side of a passage, as for `passages`, square metres.

    Returns
    -------
    list of Passage
        The narrowest first; all of them are closed.
    """
    ways, is_open = _ways_of(grid, radius)
    areas, basins = _regions(ways, is_open, radius)
    basins = basins[areas[basins] >= min_area]
    parts, _ = joined(len(areas), ways.tree.one, ways.tree.other)
    first, counts = np.unique(parts[basins], return_index=True, return_counts=True)[1:]
    found: list[Passage] = []
    for basin in basins[first[counts > 1]].tolist():
        start = divmod(int(ways.tree.peak_cells[basin]), grid.frame.width)
        found += passages(ways, is_open, start, radius=radius, margin=0.0, min_area=min_area)
    return sorted(found, key=_order)


def bottleneck_on_way(from_start: WaysFrom, goal: Cell) -> Bottleneck | None:
    """Return the narrowest place on the widest way from the start to a goal.

    Parameters
    ----------
    from_start : WaysFrom
        The ways from the start.
    goal : tuple of int
        Row and column of a cell in the grid.

    Returns
    -------
    Bottleneck or None
        A passage if one is at least as narrow as the start and the goal themselves; of several
        equally narrow ones, the one nearest to the goal. None if nothing limits the way, or there
        is no way.
    """
    ways, start, rooted = from_start.ways, from_start.start, from_start.rooted
    tree, squared = ways.tree, ways.squared
    basin = int(tree.basins[goal])
    if rooted is None or basin < 0 or rooted.bottlenecks[basin] < 0:
        return None
    at_start, at_goal, on_way = (
        int(square) for square in (squared[start], squared[goal], rooted.bottlenecks[basin])
    )
    square = min(at_start, at_goal, on_way)
    resolution = ways.frame.resolution
    if square == unreachable(squared):
        return None
    width = width_of(square, resolution)
    edge = _first_edge(tree, rooted, basin, square)
    if edge is not None:
        x, y = ways.middle(edge)
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
    edge_radii: NDArray[np.float64],
    peak_radii: NDArray[np.float64],
    areas: NDArray[np.float64],
    root: int,
    wide: float,
    narrow: float,
    min_area: float,
) -> NDArray[np.intp]:
    """Return the edges at which large regions meet, above `narrow` and up to `wide`.

    A region is what is connected by wider edges; that of the root may be small.
    """
    first, end = (_first_not_above(edge_radii, limit) for limit in (wide, narrow))
    labels, _ = joined(len(areas), tree.one[:first], tree.other[:first])
    is_large = np.bincount(labels, areas, minlength=len(areas)) >= min_area
    is_large[labels[root]] = True
    is_large &= peak_radii > wide
    narrower = slice(first, end)
    _, edges = joined(
        len(areas), labels[tree.one[narrower]], labels[tree.other[narrower]], is_large
    )
    return first + edges


def _behind(
    tree: ClearanceTree, edges: NDArray[np.intp], root: int, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sum of what lies behind each of some edges, and what is right before it."""
    is_other = np.ones(len(tree.one), dtype=np.bool_)
    is_other[edges] = False
    labels, _ = joined(len(values), tree.one[is_other], tree.other[is_other])
    ends = labels[np.array([tree.one[edges], tree.other[edges], np.full(len(edges), root)])]
    used, ends = np.unique(ends, return_inverse=True)
    ends = ends.reshape(3, -1)
    sums = np.column_stack(
        [np.bincount(labels, column, minlength=len(values))[used] for column in values.T]
    )
    behind, near, _ = sums_behind(ends[0], ends[1], int(ends[2, 0]), sums)
    return behind, sums[near]


def _passage(ways: Ways, edge: int, cut_off: float, is_open: bool) -> Passage:
    x, y = ways.middle(edge)
    width = width_of(int(ways.tree.squares[edge]), ways.frame.resolution)
    return Passage(x, y, width, cut_off, is_open, ways.gap(edge))


def _first_not_above(falling: NDArray[np.float64], limit: float) -> int:
    return int(np.searchsorted(-falling, -limit, side="left"))


def _ways_of(grid: OccupancyGrid, radius: float) -> tuple[Ways, NDArray[np.bool_]]:
    """Return how wide the ways over the free cells of a map are, and where a robot fits."""
    ways = Ground(grid.occupancy, grid.frame, through_unknown=False).ways()
    return ways, ways.is_open(largest_closed_square(radius, grid.frame))


def _regions(
    ways: Ways, is_open: NDArray[np.bool_], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the area that each basin's region has, and one basin for each, the largest first.

    A region's basin is the one with its widest place.
    """
    tree = ways.tree
    end = _first_not_above(ways.metres(tree.squares), radius)
    labels, _ = joined(len(tree.peaks), tree.one[:end], tree.other[:end])
    own = ways.areas(is_open)
    areas: NDArray[np.float64] = np.bincount(labels, own, len(labels))[labels].astype(np.float64)
    order = np.lexsort((-tree.peaks, labels))
    widest = order[np.flatnonzero(np.diff(labels[order], prepend=-1))]
    widest = widest[areas[widest] > 0]
    return areas, widest[np.lexsort((widest, -areas[widest]))]
