"""Method ``log-odds``: each beam adds to the cell that it hits, and takes from those it passes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.rays import A_HIT, SEEN, Odds, weigh_rays
from mapdeal.mapping.beams import Beams, as_number
from mapdeal.mapping.evidence import Evidence, Layers
from mapdeal.mapping.hit_groups import OFTEN, HitGroups

_UNIT = 1 << 16
"""What an evidence of 1 is: in whole numbers sums are exact, in whatever order they are made."""

_EVEN = 50


class LogOdds(Evidence):
    """Evidence as one number per cell, which starts at 50.

    References
    ----------
    H. Moravec and A. Elfes, "High Resolution Maps from Wide Angle Sonar", 1985, which sums
    logarithms of odds. Here, a beam does not pass the cell that it hits.

    Examples
    --------
    >>> from mapdeal.mapping.beams import BeamLimits, Scans, beams_of
    >>> evidence = LogOdds(Frame(1, 5, 1.0))
    >>> evidence.add(beams_of(Scans([[0.5, 0.5, 0.0]], [0.0], [[3.0]]), BeamLimits()))
    >>> evidence.occupancy().tolist()
    [[0, 0, 0, 100, -1]]
    """

    def __init__(
        self,
        frame: Frame,
        *,
        log_free: float = -1.0,
        log_occ: float = 2.0,
        log_min: float = 0.0,
        log_max: float = 100.0,
        values: bool = False,
    ) -> None:
        super().__init__(frame)
        self._odds = Odds(
            _whole(log_free, "log_free", -100 * _UNIT, -1, "below 0, at least -100"),
            _whole(log_occ, "log_occ", 1, 100 * _UNIT, "above 0, at most 100"),
            _whole(log_min, "log_min", 0, _EVEN * _UNIT - 1, "at least 0, below 50"),
            _whole(
                log_max, "log_max", _EVEN * _UNIT + 1, 100 * _UNIT, f"above {_EVEN}, at most 100"
            ),
        )
        self._publish_values = values
        self._values = np.full(frame.shape, _EVEN * _UNIT, dtype=np.int32)
        self._seen = np.zeros(frame.shape, dtype=np.uint8)

    def add(self, beams: Beams) -> None:
        """Add the evidence of beams; see `Evidence.add`."""
        beams, starts, ends = self.cells_of(beams)
        weigh_rays(starts, ends, beams.is_hit, self._odds, self._values, self._seen)

    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W)."""
        if self._publish_values:
            rounded = np.rint(self._values / _UNIT).astype(np.int8)
        else:
            rounded = np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
            rounded[self._values < _EVEN * _UNIT] = FREE
            rounded[self._values > _EVEN * _UNIT] = OCCUPIED
        rounded[self._seen == 0] = UNKNOWN
        return rounded

    def often_hit(self) -> NDArray[np.bool_]:
        """Return which cells were hit often; see `Evidence.often_hit`."""
        return self._seen >= SEEN + OFTEN * A_HIT

    def vanished_from(self, grid: OccupancyGrid) -> HitGroups:
        """Return the groups that have vanished; none if the map contains values."""
        return HitGroups.none() if self._publish_values else super().vanished_from(grid)

    def advice(self, vanished: HitGroups) -> str:
        """Return what keeps groups of hits; see `Evidence.advice`."""
        now = self._odds.on_hit / _UNIT
        more, all_ = ("may keep it", "its") if len(vanished) == 1 else ("keeps more", "their")
        return f"--log-occ above {now:g} {more}, --values keeps {all_} evidence"

    def layers(self) -> Layers:
        """Return ``log_odds``: the numbers, float64, nan where no beam has passed or hit."""
        return {"log_odds": np.where(self._seen > 0, self._values / _UNIT, np.nan)}


def _whole(value: float, name: str, least: int, most: int, rule: str) -> int:
    """Return a parameter in whole units, within bounds after rounding."""
    units = as_number(value, name) * _UNIT
    if not (math.isfinite(units) and least <= round(units) <= most):
        raise ParameterError(f"must be {rule}", place=name, got=value)
    return round(units)
