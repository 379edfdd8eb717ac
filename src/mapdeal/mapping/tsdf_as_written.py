"""Method ``tsdf`` as design document 004 lists it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.rays import count_rays, measure_rays
from mapdeal.mapping.beams import Beams
from mapdeal.mapping.tsdf import Tsdf


class TsdfAsWritten(Tsdf):
    """`Tsdf` with the rules of design document 004, to compare maps with its author's.

    Notes
    -----
    The distance is the range of the beam minus the distance from the centre of the sensor's cell to
    that of the cell, and counts all along the beam; the last cell of the line does not count. Hits
    outside the grid are left out, and beams that would end outside end at their hit. Of two
    neighbours of different sign the one nearer to zero is occupied, and everything else is unknown.
    The document's search from cell (0, 0) compares each cell with the one it was reached from: the
    one below it, or in row 0 that to its left. Where the sign changes along another row, there is
    no wall.

    Examples
    --------
    >>> from mapdeal.mapping.beams import BeamLimits, Scans, beams_of
    >>> evidence = TsdfAsWritten(Frame(1, 12, 1.0))
    >>> evidence.add(beams_of(Scans([[0.9, 0.5, 0.0]], [0.0], [[3.2]]), BeamLimits()))
    >>> evidence.occupancy().tolist()
    [[-1, -1, -1, 100, -1, -1, -1, -1, -1, -1, -1, -1]]
    """

    def __init__(
        self, frame: Frame, *, truncation: float = 2.0, truncation_behind: float = 3.0
    ) -> None:
        super().__init__(frame, truncation=truncation, truncation_behind=truncation_behind)
        self._sums = np.zeros(frame.shape)  # means

    def add(self, beams: Beams) -> None:
        """Add the evidence of beams; see `Evidence.add`."""
        resolution = self.frame.resolution
        near, starts, ends = self.cells_of(beams)
        kept = self._inside(ends) | ~near.is_hit
        near, starts, ends = near.chosen(kept), starts[kept], ends[kept]
        count_rays(starts, ends, near.is_hit, self._hits, self._misses)
        far = self.frame.unbounded_rowcol_from_xy(near.ends_xy(self.reach_behind * resolution))
        ends = np.where(self._inside(far)[:, np.newaxis], far, ends)
        ranges = np.where(near.is_hit, near.ranges, np.inf)
        sensors = starts.astype(np.float64) + 0.5
        measure_rays(
            starts, ends, sensors, ranges, self._truncation * resolution, np.inf,
            self._sums, self._weights, resolution,
        )  # fmt: skip

    def _inside(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        inside = (cells >= 0) & (cells < self.frame.shape)
        return inside[:, 0] & inside[:, 1]

    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W)."""
        field, walls = self._sums, np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
        pairs = [np.s_[1:, :], np.s_[:-1, :]], [np.s_[:1, 1:], np.s_[:1, :-1]]
        # the search comes back to the first cell, which it has not marked: from the next in its row
        width = self.frame.width
        back = [np.s_[:1, :1], np.s_[:1, 1:2] if width > 1 else np.s_[1:2, :1]]
        for reached, source in (*pairs, back):
            if not field[source].size:  # a map of one cell
                continue
            changes = field[reached] * field[source] < 0  # 0 where no beam has been
            is_nearer = np.abs(field[reached]) < np.abs(field[source])
            walls[reached][changes & is_nearer] = OCCUPIED
            walls[source][changes & ~is_nearer] = OCCUPIED
        return walls

    def _field(self) -> NDArray[np.float64]:
        return np.where(self._weights > 0, self._sums, np.nan)
