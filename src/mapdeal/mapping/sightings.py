"""Latest evidence for each cell from a sequence of clouds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.region import Region
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.bresenham import FARTHEST_CELL
from mapdeal.kernels.rays import Odds, weigh_rays

Cells = NDArray[np.int64]


class Sightings:
    """Cells of a lattice in which clouds leave obstacles, and through which beams clear.

    Notes
    -----
    A cell is what the last cloud says that has an end of a beam in it, an obstacle, or a beam
    through it, free; where a cloud has both it is an obstacle, as in costmap_2d, which clears
    first and marks then. So one number a cell is enough: which cloud it was, and what it said.

    Examples
    --------
    >>> seen = Sightings(Region(0, 0, 1, 4), keep=2)
    >>> sensor, wall, beyond = np.array([0, 0]), np.array([[0, 2]]), np.array([[0, 3]])
    >>> seen.add(sensor, wall, wall)
    >>> seen.evidence(Region(0, 0, 1, 4)).tolist()
    [[0, 0, 100, -1]]
    >>> seen.add(sensor, beyond, beyond)
    >>> seen.evidence(Region(0, 1, 1, 4)).tolist()
    [[0, 0, 100, -1]]
    """

    def __init__(self, region: Region, keep: int | None = None) -> None:
        self._region = region
        self._keep = keep
        self._count = 0
        # 2 k where the k-th cloud was the last to say something, one more if that was an obstacle
        self._words = np.zeros((region.height, region.width), dtype=np.int32)

    def move(self, region: Region) -> None:
        """Remember the cells of another region from now on; those of both are kept.

        Nothing moves if they are among those that are remembered.

        References
        ----------
        costmap_2d's ``updateOrigin``: the origin moves by whole cells, so that none blurs.
        """
        rows, cols = _place_in(self._region, region).shared_with(self._words.shape)
        if rows.stop - rows.start == region.height and cols.stop - cols.start == region.width:
            return
        words = np.zeros((region.height, region.width), dtype=np.int32)
        _copy(self._words, self._region, words, region)
        self._region, self._words = region, words

    def skip(self) -> None:
        """Take the turn of a cloud that says nothing."""
        self._count += 1

    def add(self, sensor: Cells, ends: Cells, marks: Cells) -> None:
        """Clear along beams, then mark obstacles."""
        self._count += 1
        corner = np.array(self._region[:2])
        start = sensor - corner
        ends = ends - corner
        if (np.abs(start) <= FARTHEST_CELL).all():
            ends = ends[(np.abs(ends) <= FARTHEST_CELL).all(axis=1)]
            starts = np.broadcast_to(start, ends.shape)
            # what is added reaches the upper bound from anywhere: each cell becomes just that
            word = Odds(2 * self._count, 1, 0, 2 * self._count)
            is_hit, seen = np.zeros(len(ends), np.bool_), np.zeros(self._words.shape, np.uint8)
            weigh_rays(starts, ends, is_hit, word, self._words, seen)
        marks = marks - corner
        marks = marks[((marks >= 0) & (marks < self._words.shape)).all(axis=1)]
        self._words[marks[:, 0], marks[:, 1]] = 2 * self._count + 1

    def evidence(self, region: Region) -> NDArray[np.int8]:
        """Return what the clouds that count say of the cells of a region: -1, 0 or 100.

        Cells that are not remembered are unknown.
        """
        words = self._words_in(region)
        values = np.full(words.shape, UNKNOWN, dtype=np.int8)
        counts = words >= 2 * self._oldest
        values[counts & (words % 2 == 0)] = FREE
        values[counts & (words % 2 == 1)] = OCCUPIED
        return values

    def count_earlier(self, region: Region) -> int:
        """Return how many cells of a region are obstacles by a cloud before the newest."""
        words = self._words_in(region)
        earlier = (words >= 2 * self._oldest) & (words < 2 * self._count) & (words % 2 == 1)
        return int(np.count_nonzero(earlier))

    @property
    def _oldest(self) -> int:
        return 1 if self._keep is None else max(1, self._count - self._keep + 1)

    def _words_in(self, region: Region) -> NDArray[np.int32]:
        words = np.zeros((region.height, region.width), dtype=np.int32)
        _copy(self._words, self._region, words, region)
        return words


def _copy(
    source: NDArray[np.int32], place: Region, target: NDArray[np.int32], other: Region
) -> None:
    """Copy the cells that two regions share from an array of the first into one of the second."""
    region = _place_in(place, other)
    rows, cols = region.shared_with(source.shape)
    if rows.start < rows.stop and cols.start < cols.stop:
        target[region.place_of(rows, cols)] = source[rows, cols]


def _place_in(place: Region, other: Region) -> Region:
    """Return the second region, its corner counted from that of the first."""
    return Region(other.row - place.row, other.col - place.col, other.height, other.width)
