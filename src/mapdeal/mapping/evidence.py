"""Common base of the methods that make maps from beams."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.bresenham import FARTHEST_CELL
from mapdeal.mapping.beams import Beams
from mapdeal.mapping.hit_groups import HitGroups, vanished_groups

Cells = NDArray[np.int64]
Layers = dict[str, NDArray[Any]]


class Evidence(ABC):
    """Evidence for and against obstacles, gathered cell by cell."""

    reach_behind = 0.0
    """Distance behind hits up to which beams have an effect, cells."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame

    @property
    def bytes_per_cell(self) -> int:
        """Memory that the evidence takes per cell, bytes."""
        return sum(v.itemsize for v in vars(self).values() if isinstance(v, np.ndarray))

    @abstractmethod
    def add(self, beams: Beams) -> None:
        """Add the evidence of beams, in order; beams that leave the grid count inside it."""

    @abstractmethod
    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W): -1, 0..100."""

    @abstractmethod
    def often_hit(self) -> NDArray[np.bool_]:
        """Return which cells `OFTEN` or more beams have hit, shape (H, W); see `hit_groups`."""

    @abstractmethod
    def layers(self) -> Layers:
        """Return the layers of evidence by their keys in an npz."""

    @abstractmethod
    def advice(self, vanished: HitGroups) -> str:
        """Return advice on how to keep the vanished groups of hits on the map."""

    def vanished_from(self, grid: OccupancyGrid) -> HitGroups:
        """Return the groups of hits that are missing from the map of the evidence."""
        return vanished_groups(self.often_hit(), grid.occupancy == OCCUPIED)

    def grid(self) -> OccupancyGrid:
        """Return the map of the evidence so far."""
        return OccupancyGrid(self.occupancy(), self.frame.resolution, self.frame.origin)

    def cells_of(self, beams: Beams, beyond: float = 0.0) -> tuple[Beams, Cells, Cells]:
        """Return beams with the cells, shape (K, 2), that they begin and end in.

        Cells may lie outside of the grid; beams more than 2^30 cells away, which cannot be
        followed in whole numbers of 64 bits and come nowhere near it, are left out.
        """
        starts = self.frame.unbounded_rowcol_from_xy(beams.sensors_xy)
        ends = self.frame.unbounded_rowcol_from_xy(beams.ends_xy(beyond))
        near = (np.abs(starts) <= FARTHEST_CELL) & (np.abs(ends) <= FARTHEST_CELL)
        kept = near[:, 0] & near[:, 1]
        if kept.all():
            return beams, starts, ends
        return beams.chosen(kept), starts[kept], ends[kept]
