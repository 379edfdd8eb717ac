"""Outlines of marked cells: polygons with holes on the lattice of cell corners, and simpler ones.

Corners are found all at once, by the pattern of the four cells around each lattice point, and
joined along rows and columns. A ring has the marked cells on its left: outer rings run
anticlockwise, holes clockwise. Two marked cells that share a corner alone are not joined there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.kernels.components import labelled

Ring = NDArray[np.float64]  # corners (row, col) in cells, shape (N, 2); the last is not the first

_E, _N, _W, _S = range(4)
# Of the cells south-west 1, south-east 2, north-west 4 and north-east 8 of a corner: by which
# direction a ring comes and goes, and one marked cell there, as offsets of row and column. Where
# marked cells face each other across the corner, 6 and 9, there are two turns.
_TURNS = {
    1: (_N, _W, -1, -1), 2: (_W, _S, -1, 0), 4: (_E, _N, 0, -1), 8: (_S, _E, 0, 0),
    14: (_E, _S, 0, 0), 13: (_N, _E, 0, -1), 11: (_S, _W, -1, 0), 7: (_W, _N, -1, -1),
}  # fmt: skip
_CROSSINGS = {9: (1, 8), 6: (2, 4)}

MOST_TOLERANCE = 0.5
"""Cells within which outlines may be moved: lattice lines are 1 apart, so none can meet."""

_BELOW = 1 - 1e-6
_LONG = 2  # cells of both edges of a corner that is no step of a slanted wall
_LEAST_SHARE = 0.01  # of a polygon's area that simpler outlines may change
_LEAST_OF_RING = 0.05  # of a ring's
_MOST_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class Outline:
    """The outer ring of a 4-connected component, its holes, and its number of cells."""

    shell: Ring
    holes: tuple[Ring, ...]
    cells: int

    @property
    def rings(self) -> tuple[Ring, ...]:
        return (self.shell, *self.holes)

    @property
    def area(self) -> float:
        """Its area in cells; holes run the other way round."""
        return sum(map(area_of, self.rings))


def area_of(ring: Ring) -> float:
    """Return the area of a ring in cells, negative if it runs clockwise."""
    rows, cols = (ring - ring[0]).T
    return float((cols * np.roll(rows, -1) - rows * np.roll(cols, -1)).sum()) / 2


def corner_count(marked: Mask) -> int:
    """Return how many corners the outlines of marked cells have, twice those that two share."""
    counts = np.bincount(_codes(marked).reshape(-1), minlength=16)
    return int(counts[list(_TURNS)].sum() + 2 * counts[list(_CROSSINGS)].sum())


def outlines(marked: Mask, tolerance: float = 0.0) -> list[Outline]:
    """Return the outlines of marked cells, the largest first, moved by at most `tolerance` cells.

    Rings do not cross, and touch at corners of cells alone. The area of each polygon changes by at
    most 1 %. With tolerance 0 rings are those of the cells.
    """
    components = labelled(marked, corners=False)
    if len(components.sizes) == 1:
        return []
    shells: dict[int, _Ring] = {}
    holes: dict[int, list[_Ring]] = {}
    for ring in _rings(marked, components.cells):
        if ring.area > 0:
            shells[ring.component] = ring
        else:
            holes.setdefault(ring.component, []).append(ring)
    found = [
        _outline([shell, *holes.get(number, ())], int(components.sizes[number]), tolerance)
        for number, shell in shells.items()
    ]
    return sorted(found, key=lambda one: (-one.cells, *one.shell[0]))


@dataclass(frozen=True, eq=False)
class _Ring:
    corners: Floats  # (row, col), shape (N, 2)
    stays: Mask  # which corners have to stay, shape (N,)
    component: int
    area: float


def _rings(marked: Mask, labels: NDArray[np.int32]) -> Iterator[_Ring]:
    nodes = _corners(marked)
    follows = _joined(nodes).tolist()
    points = (nodes.row * (marked.shape[1] + 1) + nodes.col).tolist()
    crossings = set(np.flatnonzero(nodes.is_crossing).tolist())
    order: list[int] = []
    ends: list[int] = []
    seen = bytearray(len(follows))
    for first in range(len(follows)):
        if seen[first]:
            continue
        ring, node = [], first
        while not seen[node]:
            seen[node] = 1
            ring.append(node)
            node = follows[node]
        for part in [ring] if crossings.isdisjoint(ring) else _parts(ring, points):
            order += part
            ends.append(len(order))
    yield from _measured(nodes, np.array(order), np.array(ends), labels)


def _measured(
    nodes: _Corners, order: Integers, ends: Integers, labels: NDArray[np.int32]
) -> Iterator[_Ring]:
    """Yield rings that are one after the other, all of them measured together."""
    # Corners of two long edges stay, both ends of an edge at which the ring turns the same way, as
    # of the end of a wall, and corners that another outline goes through. Between them are steps of
    # slanted lines.
    starts = np.concatenate([[0], ends[:-1]])
    after, before = np.arange(1, len(order) + 1), np.arange(-1, len(order) - 1)
    after[ends - 1], before[starts] = starts, ends - 1
    corners = np.stack([nodes.row[order], nodes.col[order]], axis=1).astype(np.float64)
    ahead = corners[after] - corners
    length, behind = np.abs(ahead).sum(axis=1), ahead[before]
    turn = behind[:, 1] * ahead[:, 0] - behind[:, 0] * ahead[:, 1]
    is_end = turn * turn[after] > 0
    stays = nodes.is_crossing[order] | is_end | is_end[before]
    stays |= (length >= _LONG) & (length[before] >= _LONG)
    rows, cols = corners.T
    areas = np.add.reduceat(cols * ahead[:, 0] - rows * ahead[:, 1], starts) / 2
    firsts = order[starts]
    owners = labels[nodes.inside_row[firsts], nodes.inside_col[firsts]]
    for start, end, owner, area in zip(
        starts.tolist(), ends.tolist(), owners.tolist(), areas.tolist(), strict=True
    ):
        yield _Ring(corners[start:end], stays[start:end], owner, area)


def _parts(ring: list[int], points: list[int]) -> Iterator[list[int]]:
    """Yield the rings that a ring falls into at the corners that it goes through twice."""
    stack: list[int] = []
    place: dict[int, int] = {}
    for node in ring:
        point = points[node]
        if point in place:
            start = place[point]
            yield stack[start:]
            for other in stack[start + 1 :]:
                del place[points[other]]
            del stack[start + 1 :]
        else:
            place[point] = len(stack)
            stack.append(node)
    yield stack


@dataclass(frozen=True, eq=False)
class _Corners:
    """Turns of rings: where they are, how rings come and go, and a marked cell beside each."""

    row: Integers
    col: Integers
    comes: Integers
    goes: Integers
    inside_row: Integers
    inside_col: Integers
    is_crossing: Mask


def _codes(marked: Mask) -> NDArray[np.uint8]:
    """Return which of the four cells around each lattice point are marked, shape (H + 1, W + 1)."""
    cells = np.pad(marked, 1).view(np.uint8)
    codes: NDArray[np.uint8] = cells[:-1, :-1].copy()
    for weight, part in ((2, cells[:-1, 1:]), (4, cells[1:, :-1]), (8, cells[1:, 1:])):
        codes += part * np.uint8(weight)
    return codes


def _corners(marked: Mask) -> _Corners:
    codes = _codes(marked)
    is_turn = np.zeros(16, dtype=np.bool_)
    is_turn[[*_TURNS, *_CROSSINGS]] = True
    at = np.flatnonzero(is_turn[codes])
    code = codes.reshape(-1)[at]
    is_crossing = np.isin(code, list(_CROSSINGS))
    second = np.flatnonzero(is_crossing)
    first_turn, second_turn = np.arange(16), np.arange(16)
    for both, (one, other) in _CROSSINGS.items():
        first_turn[both], second_turn[both] = one, other
    turns = np.concatenate([first_turn[code], second_turn[code[second]]])
    at = np.concatenate([at, at[second]])
    table = np.zeros((16, 4), dtype=np.int64)
    for turn, values in _TURNS.items():
        table[turn] = values
    comes, goes, down, left = table[turns].T
    row, col = np.divmod(at, codes.shape[1])
    crossing = np.concatenate([is_crossing, np.ones(len(second), dtype=np.bool_)])
    return _Corners(row, col, comes, goes, row + down, col + left, crossing)


def _joined(nodes: _Corners) -> Integers:
    """Return the turn that follows each one along its ring."""
    # Edges of one direction in one row or column do not overlap: the starts of all of them, in
    # order, belong to their ends in order.
    follows = np.empty(len(nodes.row), dtype=np.int64)
    for direction in (_E, _N, _W, _S):
        keys = (nodes.col, nodes.row) if direction in (_E, _W) else (nodes.row, nodes.col)
        ends = []
        for has in (nodes.goes, nodes.comes):
            some = np.flatnonzero(has == direction)
            ends.append(some[np.lexsort([key[some] for key in keys])])
        follows[ends[0]] = ends[1]
    return follows


def _outline(rings: list[_Ring], cells: int, tolerance: float) -> Outline:
    """Return the rings of a component, simplified as far as its area allows."""
    made = [ring.corners for ring in rings]
    simple = [] if tolerance == 0 else [i for i, one in enumerate(rings) if not one.stays.all()]
    allowed = dict.fromkeys(simple, min(tolerance, MOST_TOLERANCE) * _BELOW)
    areas = [ring.area for ring in rings]
    wrong = simple
    for _ in range(_MOST_HALVINGS):
        for index in wrong:
            made[index] = _simplified(rings[index], allowed[index])
            areas[index] = area_of(made[index])
            allowed[index] /= 2
        is_off = abs(sum(areas) - cells) > _LEAST_SHARE * cells
        wrong = [
            index
            for index in simple
            if (is_off and areas[index] != rings[index].area)
            or abs(areas[index] - rings[index].area) > _LEAST_OF_RING * abs(rings[index].area)
        ]
        if not wrong:
            break
    for index in wrong:
        made[index] = rings[index].corners
    return Outline(made[0], tuple(made[1:]), cells)


def _simplified(ring: _Ring, tolerance: float) -> Ring:
    """Return a ring with fewer points, whose corners lie within some cells of it."""
    # New corners lie on the ring: at its corners, or half-way between two.
    corners, stays = ring.corners, ring.stays
    if not stays.any():
        off = np.square(corners - corners.mean(axis=0)).sum(axis=1)
        stays = np.arange(len(corners)) == off.argmax()
    first = int(stays.argmax())
    order = (np.arange(len(corners) + 1) + first) % len(corners)
    points = np.empty((2 * len(corners) + 1, 2))
    points[::2] = corners[order]
    points[1::2] = (points[:-2:2] + points[2::2]) / 2
    ends = (2 * np.flatnonzero(stays[order])).tolist()
    kept = [0]
    rows, cols = points[:, 0].tolist(), points[:, 1].tolist()
    for start, end in pairwise(ends):
        if end - start == 2:
            kept.append(end)
        else:
            kept += _along(rows, cols, start, end, tolerance)
    made = points[kept[:-1]]
    to, on = made - np.roll(made, 1, axis=0), np.roll(made, -1, axis=0) - made
    turns: Mask = to[:, 0] * on[:, 1] != to[:, 1] * on[:, 0]
    return made[turns]


def _along(
    rows: list[float], cols: list[float], start: int, end: int, tolerance: float
) -> Iterator[int]:
    """Yield the points that stay behind the start of a chain, the last of which is its end."""
    # From each the next is the farthest one to which a line passes all corners within the
    # tolerance: these narrow the angle of such lines. It is half-way between corners if possible:
    # from a corner no line passes between those on both sides for long.
    at = start
    while at < end:
        row, col = rows[at], cols[at]
        best, low, high = at + 1, -math.inf, math.inf
        base: float | None = None
        for index in range(at + 1, end + 1):
            up, right = rows[index] - row, cols[index] - col
            far = math.hypot(up, right)
            if far <= tolerance:
                continue
            angle = math.atan2(up, right)
            if base is None:
                base = angle
            angle = math.remainder(angle - base, math.tau)
            if low <= angle <= high and (index % 2 or index == end):
                best = index
            if index % 2 == 0:
                spread = math.asin(tolerance / far)
                low, high = max(low, angle - spread), min(high, angle + spread)
                if low > high:
                    break
        yield best
        at = best
