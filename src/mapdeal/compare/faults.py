"""Faults of a map compared with a true one: kind, amount and place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mapdeal.compare.align import bend_between
from mapdeal.compare.difference import middle_xy
from mapdeal.compare.score import FREE, LEAST_PIECE, OCCUPIED, UNKNOWN, States
from mapdeal.compare.walls import pooled
from mapdeal.grid import values as map_values
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import decimal_text
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.components import drop_small_groups, touching_groups
from mapdeal.kernels.distance import within_distance
from mapdeal.records import dataclass

_MIDDLE = 1 / 3  # of the way from the centre to the border: still called the middle


def place_text(grid: OccupancyGrid, point_xy: tuple[float, float]) -> str:
    """Return the part of a map's known area that contains a point, and the point, in words."""
    known = np.asarray(grid.occupancy) != map_values.UNKNOWN
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    at = f"at {point_xy[0] + 0.0:.4g},{point_xy[1] + 0.0:.4g}"
    if not len(rows):
        return at
    ends = [(row, col) for row in (rows[0], rows[-1]) for col in (cols[0], cols[-1])]
    corners = grid.frame.xy_from_rowcol(ends)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = np.maximum((high - low) / 2, grid.resolution)
    x, y = (np.asarray(point_xy) - (low + high) / 2) / half
    north = "north" if y > _MIDDLE else "south" if y < -_MIDDLE else ""
    east = "east" if x > _MIDDLE else "west" if x < -_MIDDLE else ""
    part = "-".join(word for word in (north, east) if word) or "middle"
    return f"in the {part}, {at}"


NO_FAULT = "no fault found"
_LEAST = {"ghost walls": 0.05, "missing area": 0.05, "faded walls": 0.1, "noisy": 0.03, "bent": 1.0}
"""Least share that is a fault: of walls, known area, true walls, and walls; for bends a multiple of
`_LEAST_BEND`. The fault that exceeds its least share most names the verdict."""
_NEAR, _NEAR_CELLS = 0.15, 1.5  # distance within which walls are the same: metres, least in cells
_LEAST_BEND, _LEAST_GAIN = 0.1, 0.08
"""Least bend that is a fault, metres (at least two cells), and gain in walls that then coincide."""
_MAPPED = 2.0  # cells from free space within which a map should show a wall


@dataclass(frozen=True)
class Fault:
    """One fault of a map; severity: multiple of the least share that is a fault."""

    kind: str
    amount: float
    unit: str
    share: float | None
    x: float
    y: float
    place: str
    severity: float

    @property
    def text(self) -> str:
        amount = decimal_text(self.amount, 3) if self.unit else f"{self.amount:.0f}"
        amount += f" {self.unit}" if self.unit else ""
        if self.share is None:
            return f"{self.kind}: by up to {amount}, most {self.place}"
        reference = {
            "missing area": "of what the other map knows",
            "faded walls": "of the other map's walls",
        }.get(self.kind, "of the map's walls")
        noun = "" if self.unit else " small components"
        share = f"{100 * self.share:.3g} % {reference}"
        return f"{self.kind}: {amount}{noun} ({share}), most of it {self.place}"


def faults_of(estimate: States, truth: States, frame: Frame) -> tuple[Fault, ...]:
    if not (estimate == OCCUPIED).any() or not (truth == OCCUPIED).any():
        return ()
    return tuple(sorted(_faults_in(estimate, truth, frame), key=lambda fault: -fault.severity))


def verdict(faults: tuple[Fault, ...]) -> str:
    return faults[0].kind if faults else NO_FAULT


def _faults_in(estimate: States, truth: States, frame: Frame) -> Iterator[Fault]:
    table = np.array([map_values.UNKNOWN, map_values.FREE, map_values.OCCUPIED], dtype=np.int8)
    cell = frame.resolution
    maps = [OccupancyGrid(table[states], cell, frame.origin) for states in (estimate, truth)]
    near = max(_NEAR, _NEAR_CELLS * cell)

    def fault(kind: str, cells: Mask, amount: float, unit: str, total: Mask) -> Iterator[Fault]:
        share = float(cells.sum() / max(1, total.sum()))
        if share >= _LEAST[kind]:
            place = _most_of(cells, frame)
            severity = share / _LEAST[kind]
            yield Fault(kind, amount, unit, share, *place, place_text(maps[1], place), severity)

    bend = bend_between(*maps)
    least = max(_LEAST_BEND, 2 * cell)
    if bend.metres >= least and bend.share_bent - bend.share >= _LEAST_GAIN:
        place = place_text(maps[1], bend.point_xy)
        severity = bend.metres / least
        yield Fault("bent", bend.metres, "m", None, *bend.point_xy, place, severity)
        near += bend.metres
    walls, true_walls = estimate == OCCUPIED, truth == OCCUPIED
    square = int((near / cell) ** 2)
    astray = walls & (truth == FREE) & ~within_distance(true_walls, square)
    specks = astray & ~drop_small_groups(walls, LEAST_PIECE)
    ghosts = astray & ~specks
    yield from fault("ghost walls", ghosts, float(ghosts.sum()) * cell, "m", walls)
    pieces = float(touching_groups(specks)[1].max() + 1) if specks.any() else 0.0
    yield from fault("noisy", specks, pieces, "", walls)
    known = (truth != UNKNOWN) & ~true_walls
    missing = known & (estimate == UNKNOWN)
    yield from fault("missing area", missing, float(missing.sum()) * cell**2, "m2", known)
    mapped = true_walls & within_distance(estimate == FREE, int(_MAPPED**2))
    faded = mapped & ~within_distance(walls, square)
    yield from fault("faded walls", faded, float(faded.sum()) * cell, "m", mapped)


_BLOCK = 1.0  # metres: cells in touching blocks of this side are at one place


def _most_of(cells: Mask, frame: Frame) -> tuple[float, float]:
    """Return the cell in the middle of the largest cluster of cells, metres."""
    factor = max(1, round(_BLOCK / frame.resolution))
    counts = pooled(cells, factor)
    blocks, groups = touching_groups(counts > 0)
    sizes = np.bincount(groups, counts[tuple(blocks.T)])
    in_part = np.zeros(counts.shape, dtype=np.bool_)
    in_part[tuple(blocks[groups == sizes.argmax()].T)] = True
    cluster = np.argwhere(cells)
    return middle_xy(frame, cluster[in_part[tuple(cluster.T // factor)]])


def document_of(faults: tuple[Fault, ...]) -> list[dict[str, Any]]:
    keys = ("kind", "amount", "unit", "share", "x", "y")
    return [{key: getattr(fault, key) for key in keys} for fault in faults]


def lines_of(faults: tuple[Fault, ...]) -> Iterator[str]:
    if not faults:
        yield f"  verdict   {NO_FAULT}"
    for number, fault in enumerate(faults):
        yield f"  {'and' if number else 'verdict':<9} {fault.text}"
