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
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import configuration_numpy as configuration_twin
from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Spans

Pose = tuple[int, int, int]
"""Heading, row and column."""

MOST_HEADINGS = 255
"""As many as a byte can count."""


@dataclass(frozen=True, eq=False)
class Reached:
    """What can be reached from some poses."""

    reachable: NDArray[np.uint8]
    headings: NDArray[np.bool_]


class ConfigurationSpace:
    """The poses in which a footprint touches no blocked cell and nothing outside of the grid."""

    def __init__(self, blocked: Layer, footprints: Sequence[Spans]) -> None:
        if not 1 <= len(footprints) <= MOST_HEADINGS:
            raise ValueError(f"there must be 1 to {MOST_HEADINGS} headings")
        if not all(len(spans.rows) and (spans.starts < spans.stops).all() for spans in footprints):
            raise ValueError("a footprint without cells, or with an empty run")
        self.shape = blocked.shape
        self._count = len(footprints)
        self._poses = _open_poses(blocked, footprints)
        self.headings = self._poses.headings

    def open_headings(self, row: int, col: int) -> NDArray[np.bool_]:
        """Return in which headings a cell is open, shape (K,)."""
        self._check(row, col)
        return self._poses.at(row, col)

    def reach(self, seeds: Sequence[Pose], cells: Sequence[tuple[int, int]] = ()) -> Reached:
        """Return what can be reached.

        Parameters
        ----------
        seeds : sequence of tuple of int
            Heading, row and column of the poses to start from; those that are not open lead
            nowhere.
        cells : sequence of tuple of int
            Row and column of cells whose headings are asked for.

        Raises
        ------
        IndexError
            If the grid has no such cell, or there is no such heading.

        Notes
        -----
        The first call takes the planes of open poses; a later one makes them again.
        """
        for heading, row, col in seeds:
            self._check(row, col, heading)
        for row, col in cells:
            self._check(row, col)
        return Reached(*self._poses.reach(seeds, cells))

    def _check(self, row: int, col: int, heading: int = 0) -> None:
        height, width = self.shape
        if not (0 <= row < height and 0 <= col < width and 0 <= heading < self._count):
            raise IndexError("no such cell, or no such heading")


def memory(shape: tuple[int, int], heading_count: int, extent: int) -> int:
    """Return how many bytes a `ConfigurationSpace` and what can be reached take at most."""
    # Without the cells that are blocked, of which the caller has one byte each, or a lazy layer.
    if engine_name() == "compiled":
        from mapdeal.kernels import configuration_compiled as compiled_configuration

        return compiled_configuration.memory(shape, heading_count, extent)
    return configuration_twin.memory(shape, heading_count, extent)


class _OpenPoses(Protocol):
    """What both engines make."""

    headings: NDArray[np.uint8]
    """In how many headings each cell is open, shape (H, W)."""

    def at(self, row: int, col: int) -> NDArray[np.bool_]: ...
    def reach(
        self, seeds: Sequence[Pose], cells: Sequence[tuple[int, int]]
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]: ...


def _open_poses(blocked: Layer, footprints: Sequence[Spans]) -> _OpenPoses:
    if engine_name() == "compiled":
        from mapdeal.kernels import configuration_compiled as compiled_configuration

        return compiled_configuration.OpenPoses(blocked, footprints)
    return configuration_twin.OpenPoses(blocked, footprints)
