"""Lattices of places in halls, along two directions."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Floats, Integers, Mask

Place = tuple[float, float]  # continuous row and column
Places = NDArray[np.float64]
_MOST_ACROSS_NARROW = 2  # places across a narrow part of a hall
_LEAST_DISTANCE = 0.7  # of places, as a share of the spacing


def lattices_in(
    points: Places, halls: NDArray[np.integer[Any]], direction: float, spacing: float, step: float,
    is_usable: Callable[[Places], Mask],
) -> tuple[list[Place], Integers]:  # fmt: skip
    """Return places in the halls of some points, and the pairs of neighbours in one hall."""
    cos, sin = math.cos(direction), math.sin(direction)
    axes = np.array([[sin, cos], [cos, -sin]])  # both directions, as steps in rows and columns
    order = np.argsort(halls, kind="stable")
    bounds = [*np.flatnonzero(np.diff(halls[order], prepend=-1)).tolist(), len(order)]
    parts = [points[order[first:stop]] for first, stop in pairwise(bounds)]
    by_hall = [_lattice_in(part, axes, spacing, step, is_usable) for part in parts]
    places = list(chain.from_iterable(by_hall))
    if len(places) < 2:
        return places, np.zeros((0, 2), dtype=np.int64)
    from scipy.spatial import cKDTree

    near = cKDTree(np.array(places)).query_pairs(1.5 * spacing, output_type="ndarray")
    hall_of = np.repeat(np.arange(len(by_hall)), list(map(len, by_hall)))
    pairs = np.sort(near[hall_of[near[:, 0]] == hall_of[near[:, 1]]], axis=1).astype(np.int64)
    return places, pairs[np.lexsort(pairs.T[::-1])]


def _lattice_in(
    hall: Places, axes: Places, spacing: float, step: float, is_usable: Callable[[Places], Mask]
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


def _select_places(candidates: Places, spacing: float) -> list[Place]:
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
