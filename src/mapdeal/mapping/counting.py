"""Method ``counting``: the share of beams that hit a cell among those that came to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.rays import count_rays
from mapdeal.mapping.beams import Beams, as_number
from mapdeal.mapping.evidence import Evidence, Layers
from mapdeal.mapping.hit_groups import OFTEN, HitGroups

_UNIT = 1_000_000


class Counting(Evidence):
    """Evidence as counts of the beams that hit each cell and of those that pass it.

    References
    ----------
    gmapping's ``PointAccumulator``. As there, a cell that beams have reached is either occupied or
    free.
    """

    def __init__(self, frame: Frame, *, ratio: float = 0.3) -> None:
        super().__init__(frame)
        if not 0 <= as_number(ratio, "ratio") < 1:  # refuses nan too
            raise ParameterError("must be at least 0, below 1", place="ratio", got=ratio)
        self._ratio = round(ratio * _UNIT)
        self._hits, self._misses = np.zeros((2, *frame.shape), dtype=np.int32)

    def add(self, beams: Beams) -> None:
        """Add the evidence of beams; see `Evidence.add`."""
        beams, starts, ends = self.cells_of(beams)
        count_rays(starts, ends, beams.is_hit, self._hits, self._misses)

    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W)."""
        visits = self._hits + self._misses
        # in whole numbers, so that no rounding lifts a share above itself
        occupied = self._hits.astype(np.int64) * _UNIT > visits.astype(np.int64) * self._ratio
        values = np.where(occupied, np.int8(OCCUPIED), np.int8(FREE))
        values[visits == 0] = UNKNOWN
        return values

    def often_hit(self) -> NDArray[np.bool_]:
        """Return which cells were hit often; see `Evidence.often_hit`."""
        return self._hits >= OFTEN

    def advice(self, vanished: HitGroups) -> str:
        """Return the ratio that keeps groups of hits; see `Evidence.advice`."""
        at = tuple(vanished.cells.T)
        hits = self._hits[at].astype(np.int64)
        # of each cell the largest number of percent below its share of hits
        percent = (100 * hits - 1) // (hits + self._misses[at])
        most = np.maximum.reduceat(percent, vanished.starts).min()
        which = "it" if len(vanished) == 1 else "all of them"
        return f"--ratio {most / 100:g} keeps {which}"

    def layers(self) -> Layers:
        """Return ``hits`` and ``misses``, int32."""
        return {"hits": self._hits, "misses": self._misses}
