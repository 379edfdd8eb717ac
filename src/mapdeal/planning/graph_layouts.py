"""Layouts of route graphs: lattices in halls, and elsewhere lines of a skeleton.

The lines are chains of cells between crossings, without spurious branches.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

from mapdeal.kernels.arrays import Array, Floats, Integers, Mask
from mapdeal.kernels.distance import dilate_square

Cells = Integers  # rows and columns, shape (N, 2)
Chain = list[int]  # cells from start to end, both included
Place = tuple[float, float]  # continuous row and column
_MOST_ACROSS_NARROW = 2  # places across a narrow part of a hall
_LEAST_DISTANCE = 0.7  # of places, as a share of the spacing


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
        clearances = np.sqrt(squares[self.fine[:, 0], self.fine[:, 1]])
        self.clearances: list[float] = clearances.tolist()
        self._places: list[list[int]] = self.cells.tolist()
        self.step = step
        self.mouths: set[int] = set()
        self.chains: dict[int, Chain] = {}
        self.chains_of: defaultdict[int, list[int]] = defaultdict(list)
        self._count = 0
        self._beside = self._adjacent(lines)
        if len(self.cells):
            at_hall = dilate_square(halls, 1)[self.cells[:, 0], self.cells[:, 1]]
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
