"""Poses, cell and heading, in which a footprint touches nothing, and ways between them.

A pose is open if no cell of the footprint there is blocked or outside of the grid. From an open
pose there is a way to the same cell in the heading before and after it, and to the four cells
beside it in the same heading, as far as these are open; headings form a circle.

Of each pose there is one bit, in one plane a heading. Poses that are reached are taken out of the
planes, so that there is no second set of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import configuration_twin
from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.spans import Spans

Pose = tuple[int, int, int]
"""Heading, row and column."""

MOST_HEADINGS = 255
"""As many as a byte can count."""


@dataclass(frozen=True, eq=False)
class Reached:
    """What can be reached from some poses.

    Parameters
    ----------
    reachable : numpy.ndarray of uint8, shape (H, W)
        1 where a cell is reached in any heading, else 0.
    headings : numpy.ndarray of bool, shape (N, K)
        Of each cell that was asked for, the headings in which it is reached.
    """

    reachable: NDArray[np.uint8]
    headings: NDArray[np.bool_]


class ConfigurationSpace:
    """The poses in which a footprint touches no blocked cell and nothing outside of the grid.

    Parameters
    ----------
    blocked : layer of bool, shape (H, W)
        The cells that the footprint must not touch; an array, or a lazy layer. Not kept.
    footprints : sequence of Spans
        Of each heading the cells that the footprint covers, relative to the robot's cell; at
        least one heading with at least one cell each, at most `MOST_HEADINGS`.

    Attributes
    ----------
    headings : numpy.ndarray of uint8, shape (H, W)
        In how many headings each cell is open.

    Examples
    --------
    >>> blocked = np.array([[0, 0, 0, 0], [0, 0, 1, 0]], dtype=bool)
    >>> along = Spans(np.array([0]), np.array([0]), np.array([2]))
    >>> across = Spans(np.array([0, 1]), np.array([0, 0]), np.array([1, 1]))
    >>> space = ConfigurationSpace(blocked, [along, across])
    >>> space.headings
    array([[2, 2, 1, 1],
           [1, 0, 0, 0]], dtype=uint8)
    >>> space.reach([(0, 1, 0)], [(0, 3)]).reachable
    array([[1, 1, 1, 0],
           [1, 0, 0, 0]], dtype=uint8)
    """

    def __init__(self, blocked: Layer, footprints: Sequence[Spans]) -> None:
        if not 1 <= len(footprints) <= MOST_HEADINGS:
            raise ValueError(f"there must be 1 to {MOST_HEADINGS} headings")
        if not all(len(spans.rows) and (spans.starts < spans.stops).all() for spans in footprints):
            raise ValueError("a footprint without cells, or with an empty run")
        self.shape = blocked.shape
        self._planes = configuration_twin.OpenPoses(blocked, footprints)
        self.headings = self._planes.counted()

    def open_headings(self, row: int, col: int) -> NDArray[np.bool_]:
        """Return in which headings a cell is open, shape (K,)."""
        return self._planes.at(row, col)

    def reach(self, seeds: Sequence[Pose], cells: Sequence[tuple[int, int]] = ()) -> Reached:
        """Return what can be reached.

        Parameters
        ----------
        seeds : sequence of tuple of int
            Heading, row and column of the poses to start from; those that are not open lead
            nowhere.
        cells : sequence of tuple of int
            Row and column of cells whose headings are asked for.
        """
        return Reached(*self._planes.reach(seeds, cells))
