"""Outlines of marked cells, polygons with holes along cell edges; and solids of marked cells.

A lattice point is a corner if the pattern of the four cells around it makes a turn. Corners are
joined along rows and columns. A ring has the marked cells on its left: outer rings run
anticlockwise, holes clockwise. Marked cells that share only a corner are separate there.

Solids are few boxes, or one closed surface of triangles. Equal runs of marked cells in consecutive
rows form a rectangle. Its upper and lower edges are divided at the corners of adjacent rectangles,
so that triangles meet edge to edge and the surface is closed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mapdeal.kernels import engine, lookup, polygons
from mapdeal.kernels.arrays import Bytes, Floats, Integers, Integers32, Mask
from mapdeal.kernels.components import labelled
from mapdeal.records import dataclass

_E, _N, _W, _S = range(4)
# Keys are sums of the marked cells around a corner (south-west 1, south-east 2, north-west 4,
# north-east 8). Values are the directions in which a ring arrives and leaves, and the row and
# column offset of a marked cell. Two diagonal cells, 6 and 9, make two turns.
_TURNS = {
    1: (_N, _W, -1, -1), 2: (_W, _S, -1, 0), 4: (_E, _N, 0, -1), 8: (_S, _E, 0, 0),
    14: (_E, _S, 0, 0), 13: (_N, _E, 0, -1), 11: (_S, _W, -1, 0), 7: (_W, _N, -1, -1),
}  # fmt: skip
_CROSSINGS = {9: (1, 8), 6: (2, 4)}
MOST_TOLERANCE = 0.5  # cells: lattice lines are 1 apart, so moved outlines cannot meet
_BELOW = 1 - 1e-6
_LONG_EDGE = 2  # cells: steps of slanted walls are shorter on at least one side
_MOST_CHANGE = 0.01  # share of a polygon's area that simplification may change
_MOST_RING_CHANGE = 0.05  # the same of a ring
_MOST_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class Polygons:
    """Outlines of 4-connected components: each outer ring is followed by its holes."""

    corners: Floats  # (row, col) in cells, shape (N, 2); rings do not repeat their first corner
    ring_ends: Integers  # the end of each ring among the corners
    shells: Integers  # the index of each polygon's outer ring
    cells: Integers  # number of cells of each component

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def areas(self) -> Floats:
        areas = _areas(self.corners, self.ring_ends)
        return np.add.reduceat(areas, self.shells) if len(self) else areas


def _neighbours(ends: Integers) -> tuple[Integers, Integers]:
    """Return the indices of the corners before and after each corner in its ring."""
    starts = np.concatenate([[0], ends[:-1]])
    starts, ends = starts[starts < ends], ends[starts < ends]
    count = ends[-1] if len(ends) else 0
    before, after = np.arange(-1, count - 1), np.arange(1, count + 1)
    before[starts], after[ends - 1] = ends - 1, starts
    return before, after


def _areas(corners: Floats, ends: Integers) -> Floats:
    ahead = corners[_neighbours(ends)[1]] - corners
    doubled = corners[:, 1] * ahead[:, 0] - corners[:, 0] * ahead[:, 1]
    ring_of = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    return np.bincount(ring_of, doubled, minlength=len(ends)) / 2


def corner_count(marked: Mask) -> int:
    counts = lookup.histogram(_codes(marked))
    return int(counts[list(_TURNS)].sum() + 2 * counts[list(_CROSSINGS)].sum())


def outlines(marked: Mask, tolerance: float = 0.0) -> Polygons:
    """Return outlines of marked cells, the largest first, moved by at most `tolerance` cells."""
    # Rings do not cross, and touch only at corners of cells. Areas change by at most 1 %.
    components = labelled(marked, corners=False)
    cells = components.sizes[1:]
    rings = _rings(marked, components.cells)
    del components
    corners, starts, stops = _simplify(rings, cells, tolerance)
    is_shell = rings.areas > 0
    shells = np.flatnonzero(is_shell)
    cells = cells[rings.owners[shells]]
    order = np.lexsort([*corners[starts[shells]].T[::-1], -cells])
    places = np.empty(len(cells), dtype=np.int64)
    places[rings.owners[shells[order]]] = np.arange(len(cells))
    ring_order = np.lexsort([~is_shell, places[rings.owners]])
    starts, stops = starts[ring_order], stops[ring_order]
    corners = corners[polygons.enumerated(starts, stops)[1]]
    shells = np.flatnonzero(is_shell[ring_order])
    return Polygons(corners, np.cumsum(stops - starts), shells, cells[order])


class _Rings(NamedTuple):
    corners: Floats  # (row, col), shape (N, 2)
    stays: Mask  # corners that must not move, shape (N,)
    ends: Integers
    owners: Integers  # component of each ring, from 0
    areas: Floats


def _rings(marked: Mask, labels: Integers32) -> _Rings:
    # Three kinds of corners stay: between two long edges; at both ends of an edge if the ring turns
    # to the same side there, as at the end of a wall; and where another outline passes. All others
    # are steps of slanted lines.
    nodes = _corners(marked)
    order, ends = _traced(_next_turns(nodes), nodes.partner)
    before, after = _neighbours(ends)
    corners = np.stack([nodes.row[order], nodes.col[order]], axis=1).astype(np.float64)
    ahead = corners[after] - corners
    length, behind = np.abs(ahead).sum(axis=1), ahead[before]
    turn = behind[:, 1] * ahead[:, 0] - behind[:, 0] * ahead[:, 1]
    is_end = turn * turn[after] > 0
    stays = (nodes.partner[order] >= 0) | is_end | is_end[before]
    stays |= (length >= _LONG_EDGE) & (length[before] >= _LONG_EDGE)
    firsts = order[np.concatenate([[0], ends])[: len(ends)]]
    owners = labels[nodes.inside_row[firsts], nodes.inside_col[firsts]] - 1
    return _Rings(corners, stays, ends, owners, _areas(corners, ends))


def _traced(follows: Integers, partner: Integers) -> tuple[Integers, Integers]:
    """Return the turns in the order of rings, and the end of each ring."""
    # A ring that passes a lattice point twice is split there.
    order, ends = np.empty_like(follows), np.empty_like(follows)
    if engine.engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        stack, in_stack = np.empty_like(follows), np.full_like(follows, -2)
        count = _compiled.trace_rings(follows, partner, stack, in_stack, order, ends)
        return order, ends[:count]
    count = size = 0
    following, partners = follows.tolist(), partner.tolist()
    is_seen = bytearray(len(following))
    for first in range(len(following)):
        node = first
        ring: list[int] = []
        places: dict[int, int] = {}
        while not is_seen[node]:
            is_seen[node] = 1
            start = places.get(partners[node])
            if start is None:
                places[node] = len(ring)
                ring.append(node)
            else:
                order[size : size + len(ring) - start] = ring[start:]
                size += len(ring) - start
                ends[count], count = size, count + 1
                for inner in ring[start + 1 :]:
                    del places[inner]
                del ring[start + 1 :]
            node = following[node]
        if ring:
            order[size : size + len(ring)] = ring
            size += len(ring)
            ends[count], count = size, count + 1
    return order, ends[:count]


class _Corners(NamedTuple):
    """Turns of rings: lattice points, directions before and after, and an adjacent marked cell."""

    row: Integers
    col: Integers
    arrives: Integers
    leaves: Integers
    inside_row: Integers
    inside_col: Integers
    partner: Integers  # the other turn at the same lattice point, -1 without one


def _codes(marked: Mask) -> Bytes:
    """Return which of the four cells around each lattice point are marked, shape (H + 1, W + 1)."""
    cells = np.pad(marked, 1).view(np.uint8)
    codes: Bytes = cells[:-1, :-1].copy()
    for weight, part in ((2, cells[:-1, 1:]), (4, cells[1:, :-1]), (8, cells[1:, 1:])):
        codes += part * np.uint8(weight)
    return codes


def _corners(marked: Mask) -> _Corners:
    codes = _codes(marked)
    is_turn = np.zeros(16, dtype=np.bool_)
    is_turn[[*_TURNS, *_CROSSINGS]] = True
    at = np.flatnonzero(is_turn[codes])
    code = codes.reshape(-1)[at]
    second = np.flatnonzero(np.isin(code, list(_CROSSINGS)))
    first_turn, second_turn = np.arange(16), np.arange(16)
    for code_of_two, turns_there in _CROSSINGS.items():
        first_turn[code_of_two], second_turn[code_of_two] = turns_there
    turns = np.concatenate([first_turn[code], second_turn[code[second]]])
    at = np.concatenate([at, at[second]])
    table = np.zeros((16, 4), dtype=np.int64)
    for turn, values in _TURNS.items():
        table[turn] = values
    arrives, leaves, row_offset, col_offset = table[turns].T
    row, col = np.divmod(at, codes.shape[1])
    partner = np.full(len(at), -1)
    partner[second], partner[len(code) :] = np.arange(len(code), len(at)), second
    return _Corners(row, col, arrives, leaves, row + row_offset, col + col_offset, partner)


def _next_turns(nodes: _Corners) -> Integers:
    # Edges of one direction never overlap in a row or column, so the n-th start in order belongs to
    # the n-th end.
    follows = np.empty(len(nodes.row), dtype=np.int64)
    row, col = (places.astype(np.min_scalar_type(places.max(initial=0)))  # 16 bits: a radix sort
                for places in (nodes.row, nodes.col))  # fmt: skip
    for direction in (_E, _N, _W, _S):
        keys = (col, row) if direction in (_E, _W) else (row, col)
        ends = []
        for directions in (nodes.leaves, nodes.arrives):
            turns = np.flatnonzero(directions == direction)
            ends.append(turns[np.lexsort([key[turns] for key in keys])])
        follows[ends[0]] = ends[1]
    return follows


def _simplify(
    rings: _Rings, cells: Integers, tolerance: float
) -> tuple[Floats, Integers, Integers]:
    """Return simplified corners, and each ring's start and stop among them."""
    parts = [rings.corners]
    starts, stops = np.concatenate([[0], rings.ends])[: len(rings.ends)], rings.ends.copy()
    if not tolerance or not len(starts):
        return rings.corners, starts, stops
    can_move = ~np.logical_and.reduceat(rings.stays, starts)
    allowed = np.full(len(starts), min(tolerance, MOST_TOLERANCE) * _BELOW)
    areas, wrong = rings.areas.copy(), np.flatnonzero(can_move)
    for _ in range(_MOST_HALVINGS):
        if not len(wrong):
            break
        corners, ends = _simplify_rings(rings, wrong, allowed[wrong])
        size = sum(map(len, parts))
        starts[wrong], stops[wrong] = size + np.concatenate([[0], ends[:-1]]), size + ends
        parts.append(corners)
        areas[wrong] = _areas(corners, ends)
        allowed[wrong] /= 2
        is_off = np.abs(np.bincount(rings.owners, areas) - cells) > _MOST_CHANGE * cells
        change = np.abs(areas - rings.areas)
        is_wrong = is_off[rings.owners] & (change > 0)
        is_wrong |= change > _MOST_RING_CHANGE * abs(rings.areas)
        wrong = np.flatnonzero(can_move & is_wrong)
    stops[wrong] = rings.ends[wrong]
    starts[wrong] = np.concatenate([[0], rings.ends])[wrong]
    return np.concatenate(parts), starts, stops


def _simplify_rings(rings: _Rings, chosen: Integers, tolerances: Floats) -> tuple[Floats, Integers]:
    """Return chosen rings with fewer corners: old ones, or midpoints of edges."""
    stops = rings.ends[chosen]
    begins = np.concatenate([[0], rings.ends])[chosen]
    ring_of, at = polygons.enumerated(begins, stops)
    stays = rings.stays[at]
    sizes = stops - begins
    offsets = np.cumsum(sizes) - sizes
    has_none = ~np.logical_or.reduceat(stays, offsets)
    if has_none.any():  # the corner farthest from the ring's middle stays
        corners = rings.corners[at]
        sums = [np.bincount(ring_of, places) for places in corners.T]
        middles = np.stack(sums, axis=1) / sizes[:, np.newaxis]
        away = np.square(corners - middles[ring_of]).sum(axis=1)
        is_farthest = away == np.maximum.reduceat(away, offsets)[ring_of]
        stays[_firsts_of(ring_of, is_farthest & has_none[ring_of])] = True
    # each ring starts and ends at its first corner that stays
    shifts = _firsts_of(ring_of, stays) - offsets
    ring_of, number = polygons.enumerated(np.zeros_like(sizes), sizes + 1)
    order = (number + shifts[ring_of]) % sizes[ring_of] + offsets[ring_of]
    corners, bounds = rings.corners[at[order]], np.flatnonzero(stays[order])
    stays_at = np.zeros(2 * len(corners), dtype=np.bool_)
    stays_at[2 * bounds] = True
    chains = np.stack([bounds[:-1], bounds[1:]])[:, np.diff(bounds) > 1]
    _straighten(corners, chains, tolerances[ring_of[chains[0]]], stays_at)
    stays_at[2 * (np.cumsum(sizes + 1) - 1)] = False
    remaining = np.flatnonzero(stays_at)
    corners = (corners[remaining // 2] + corners[(remaining + 1) // 2]) / 2
    ring_of = ring_of[remaining // 2]
    before, after = _neighbours(np.cumsum(np.bincount(ring_of)))
    behind, ahead = corners - corners[before], corners[after] - corners
    is_turn = behind[:, 0] * ahead[:, 1] != behind[:, 1] * ahead[:, 0]
    return corners[is_turn], np.cumsum(np.bincount(ring_of[is_turn], minlength=len(sizes)))


def _firsts_of(ring_of: Integers, chosen: Mask) -> Integers:
    at = np.flatnonzero(chosen)
    return np.asarray(at[np.diff(ring_of[at], prepend=-1) != 0])


def _straighten(corners: Floats, chains: Integers, tolerances: Floats, stays_at: Mask) -> None:
    """Mark the places of chains that stay: 2 k is corner k, 2 k + 1 the next midpoint."""
    # The next place is the farthest one whose line passes all corners before it within the
    # tolerance: each corner narrows the range of angles. Midpoints are preferred, since
    # lines between them stay between the steps on both sides for longer.
    if engine.engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        ends = np.ascontiguousarray(chains)
        _compiled.straighten(corners, ends, tolerances, stays_at.view(np.uint8))
        return
    for first, last, tolerance in zip(*chains.tolist(), tolerances.tolist(), strict=True):
        points = np.repeat(corners[first : last + 1], 2, axis=0)[:-1]
        points[1::2] = (points[:-2:2] + points[2::2]) / 2
        rows, cols = points.T.tolist()
        at, end = 0, len(rows) - 1
        while at < end:
            best, low, high = at + 1, -math.inf, math.inf
            base: float | None = None
            for index in range(at + 1, end + 1):
                up, right = rows[index] - rows[at], cols[index] - cols[at]
                far = math.sqrt(up * up + right * right)
                if far <= tolerance:
                    continue
                angle = math.atan2(up, right)
                base = angle if base is None else base
                angle = math.remainder(angle - base, math.tau)
                if low <= angle <= high and (index % 2 or index == end):
                    best = index
                if index % 2 == 0:
                    spread = math.asin(tolerance / far)
                    low, high = max(low, angle - spread), min(high, angle + spread)
                    if low > high:
                        break
            stays_at[2 * first + best] = True
            at = best


def run_count(marked: Mask) -> int:
    return int(np.count_nonzero(marked[:, 0]) + np.count_nonzero(marked[:, 1:] & ~marked[:, :-1]))


class Rectangles(NamedTuple):
    """Rows and columns of rectangles, half open, each shape (N,)."""

    first_row: Integers
    end_row: Integers
    first_col: Integers
    end_col: Integers


def rectangles(marked: Mask) -> Rectangles:
    # A straight wall across the rows has many short runs along rows, but few along columns.
    across = _rectangles_by_rows(marked)
    first_col, end_col, first_row, end_row = _rectangles_by_rows(np.ascontiguousarray(marked.T))
    along = Rectangles(first_row, end_row, first_col, end_col)
    components = labelled(marked, corners=False)
    count = len(components.sizes)
    owners = [components.cells[found.first_row, found.first_col] for found in (across, along)]
    few = np.bincount(owners[0], minlength=count) <= np.bincount(owners[1], minlength=count)
    is_across, is_along = few[owners[0]], ~few[owners[1]]
    both = zip(across, along, strict=True)
    columns = [np.concatenate([rows[is_across], cols[is_along]]) for rows, cols in both]
    order = np.lexsort(columns[2::-2])
    return Rectangles(*(column[order] for column in columns))


def _rectangles_by_rows(marked: Mask) -> Rectangles:
    width = marked.shape[1]
    edges = np.diff(np.pad(marked, ((0, 0), (1, 1))).view(np.int8), axis=1)
    row, start = np.nonzero(edges == 1)
    _, stop = np.nonzero(edges == -1)
    places = np.min_scalar_type(width)  # up to 16 bits: a radix sort in linear time
    order = np.lexsort([stop.astype(places), start.astype(places)])
    row, start, stop = row[order], start[order], stop[order]
    key = start * (width + 1) + stop
    is_first = np.ones(len(row), dtype=np.bool_)
    is_first[1:] = (key[1:] != key[:-1]) | (row[1:] != row[:-1] + 1)
    is_last = np.roll(is_first, -1)
    if len(row):
        is_last[-1] = True
    return Rectangles(row[is_first], row[is_last] + 1, start[is_first], stop[is_first])


class Surface(NamedTuple):
    corners: Integers  # row and column in cells, shape (N, 2)
    levels: Bytes  # of corners, shape (N,): 0 is the floor, 2 the top, 1 half-way
    triangles: Integers  # shape (M, 3), anticlockwise seen from outside


def surface(marked: Mask) -> Surface:
    # Each edge belongs to exactly two triangles. Where two marked cells share only a corner, four
    # walls meet: the vertical edge is divided at half height for two of these walls.
    found = _rectangles_by_rows(marked)
    stride = marked.shape[1] + 1
    lower, upper = found.first_row * stride, found.end_row * stride
    is_corner = np.zeros((marked.shape[0] + 1) * stride, dtype=np.bool_)
    for edge in (lower, upper):
        for col in found[2:]:
            is_corner[edge + col] = True
    keys = np.flatnonzero(is_corner)
    points = np.stack([keys // stride, keys % stride], axis=1)
    number_of = np.cumsum(is_corner, dtype=np.int32) - np.int32(1)
    # for each rectangle the indices in `points` of the ends of its lower and upper edge
    low, low_end = (number_of[lower + col].astype(np.int64) for col in found[2:])
    top, top_end = (number_of[upper + col].astype(np.int64) for col in found[2:])
    caps = np.concatenate([_fan(low, low_end, top), _fan(top, top_end, low_end, turned=True)])
    count = len(keys)
    cells = np.pad(marked, 1)
    rows, cols = points.T
    south_west, south_east = cells[rows, cols], cells[rows, cols + 1]
    north_west, north_east = cells[rows + 1, cols], cells[rows + 1, cols + 1]
    pinched = (south_west == north_east) & (south_east == north_west) & (south_west != south_east)
    # walls, with the marked cells on their left: begin, end, and whether each end is divided
    _, bottom = polygons.enumerated(low, low_end)
    _, above = polygons.enumerated(top, top_end)
    bottom = bottom[~cells[rows[bottom], cols[bottom] + 1]]
    above = above[~cells[rows[above] + 1, cols[above] + 1]]
    begin = np.concatenate([bottom, low_end, above + 1, top])
    end = np.concatenate([bottom + 1, top_end, above, low])
    of_bottom, of_side = np.zeros(len(bottom), np.bool_), np.zeros(len(top), np.bool_)
    begin_divided = np.concatenate([of_bottom, of_side, pinched[above + 1], pinched[top]])
    end_divided = np.concatenate([of_bottom, pinched[top_end], pinched[above], of_side])
    middles = np.flatnonzero(pinched)
    middle_of = np.zeros(count, dtype=np.int64)
    middle_of[middles] = 2 * count + np.arange(len(middles))
    walls = _walls(begin, end, begin_divided, end_divided, count, middle_of)
    levels = np.repeat(np.array([0, 2, 1], dtype=np.uint8), [count, count, len(middles)])
    triangles = np.concatenate([caps[:, ::-1], caps + count, walls])
    return Surface(np.concatenate([points, points, points[middles]]), levels, triangles)


def _fan(first: Integers, last: Integers, apex: Integers, *, turned: bool = False) -> Integers:
    """Return anticlockwise triangles from the pieces of edges to the apex of each edge."""
    whose, number = polygons.enumerated(first, last)
    ends = (number + 1, number) if turned else (number, number + 1)
    return np.stack([*ends, apex[whose]], axis=1)


def _walls(
    begin: Integers, end: Integers, begin_divided: Mask, end_divided: Mask, count: int,
    middle_of: Integers,
) -> Integers:  # fmt: skip
    """Return the triangles of walls; divided ends have a corner at half height."""
    parts = []
    for from_middle, to_middle in ((False, False), (True, False), (False, True), (True, True)):
        chosen = (begin_divided == from_middle) & (end_divided == to_middle)
        p, q = begin[chosen], end[chosen]
        p_top, q_top, p_mid, q_mid = p + count, q + count, middle_of[p], middle_of[q]
        corners = {
            (False, False): [(p, q, q_top), (p, q_top, p_top)],
            (True, False): [(p, q, p_mid), (p_mid, q, q_top), (p_mid, q_top, p_top)],
            (False, True): [(p, q, q_mid), (p, q_mid, p_top), (p_top, q_mid, q_top)],
            (True, True): [(p, q, q_mid), (p, q_mid, p_mid), (p_mid, q_mid, q_top),
                           (p_mid, q_top, p_top)],
        }[from_middle, to_middle]  # fmt: skip
        parts += [np.stack(triangle, axis=1) for triangle in corners]
    return np.concatenate(parts)
