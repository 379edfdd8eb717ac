"""Method ``tsdf``: a truncated signed distance field, and the surface where it changes sign."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.dilation import dilate_square
from mapdeal.kernels.rays import DISTANCE_UNIT, count_rays, measure_rays
from mapdeal.mapping.beams import Beams, as_number
from mapdeal.mapping.evidence import Evidence, Layers
from mapdeal.mapping.hit_groups import OFTEN, HitGroups
from mapdeal.mapping.zero_crossings import crossings_of, thin_blocks, thin_surface

_FARTHEST = 1000.0
"""Cells that distances, and beams behind what they hit, reach at most."""

_TENTHS_OF_THIN = 3
"""Share of hits above which free cells are thin obstacles: that of method counting."""


class Tsdf(Evidence):
    """The mean of each cell's signed distances along the beams to what they hit.

    Notes
    -----
    The distance is the range of the beam minus the distance from the sensor to the cell's centre:
    positive in front of a hit. All beams weigh the same. Cells more than a truncation behind a hit,
    which are only reached with a `truncation_behind` above 1, count as -1: the space behind a
    thinner wall becomes solid, unless beams from there outweigh it. A cell is occupied if the field
    changes sign between it and a neighbour in its row or column, beams have reached both, and it
    is the one nearer to zero; such walls are thinned to one cell. Of the other cells, those with a
    positive field are free, and the rest is unknown.

    Around an obstacle thinner than about a cell that is seen from several sides, the field is
    positive everywhere, because each side pushes its free space through it. Therefore, free cells
    that were hit by more than three in ten of the beams that reached them are occupied as well,
    unless a neighbouring cell belongs to the surface.

    References
    ----------
    B. Curless and M. Levoy, "A Volumetric Method for Building Complex Models from Range Images",
    1996.

    Examples
    --------
    >>> from mapdeal.mapping.beams import BeamLimits, Scans, beams_of
    >>> evidence = Tsdf(Frame(1, 7, 1.0))
    >>> evidence.add(beams_of(Scans([[0.5, 0.5, 0.0]], [0.0], [[3.2]]), BeamLimits()))
    >>> evidence.occupancy().tolist()
    [[0, 0, 0, 100, -1, -1, -1]]
    >>> evidence.layers()["surface"].round(5).tolist()
    [[3.7, 0.5]]
    """

    def __init__(
        self, frame: Frame, *, truncation: float = 2.0, truncation_behind: float = 1.0
    ) -> None:
        super().__init__(frame)
        if not 1 <= as_number(truncation, "truncation") <= _FARTHEST:  # nan too
            rule = f"must be 1 to {_FARTHEST:g} cells"
            raise ParameterError(rule, place="truncation", got=truncation)
        self._truncation = float(truncation)
        self._behind = as_number(truncation_behind, "truncation_behind")
        self.reach_behind = self._truncation * self._behind
        if not 1 <= self.reach_behind <= _FARTHEST:
            least, most = 1 / self._truncation, _FARTHEST / self._truncation
            rule = f"must be {least:.6g} to {most:.6g} truncations: 1 to {_FARTHEST:g} cells"
            raise ParameterError(rule, place="truncation_behind", got=truncation_behind)
        self._sums: NDArray[Any] = np.zeros(frame.shape, dtype=np.int64)
        self._weights, self._hits, self._misses = np.zeros((3, *frame.shape), dtype=np.int32)

    def add(self, beams: Beams) -> None:
        """Add the evidence of beams; see `Evidence.add`."""
        near, starts, ends = self.cells_of(beams)
        count_rays(starts, ends, near.is_hit, self._hits, self._misses)
        near, starts, ends = self.cells_of(beams, self.reach_behind * self.frame.resolution)
        sensors = self.frame.continuous_rowcol_from_xy(near.sensors_xy)
        ranges = np.where(near.is_hit, near.ranges / self.frame.resolution, np.inf)
        measure_rays(
            starts, ends, sensors, ranges, self._truncation, self._behind,
            self._sums, self._weights,
        )  # fmt: skip

    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W)."""
        values = np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
        values[self._sums > 0] = FREE
        field = self._field()
        surface = thin_surface(field, crossings_of(field))
        values[surface] = OCCUPIED
        thin = (values == FREE) & self._is_mostly_hit() & ~dilate_square(surface, 1)
        thin_blocks(thin, field)
        values[thin] = OCCUPIED
        return values

    def _is_mostly_hit(self) -> NDArray[np.bool_]:
        visits = self._hits.astype(np.int64) + self._misses
        return self._hits * np.int64(10) > _TENTHS_OF_THIN * visits

    def often_hit(self) -> NDArray[np.bool_]:
        """Return which cells were hit often; see `Evidence.often_hit`."""
        return self._hits >= OFTEN

    def advice(self, vanished: HitGroups) -> str:
        """Return what keeps groups of hits; see `Evidence.advice`."""
        which = "it" if len(vanished) == 1 else "them"
        return f"--method counting with a small --ratio keeps {which}"

    def layers(self) -> Layers:
        """Return the field, its weights, and the surface in parts of cells.

        ``tsdf``: float32, shares of the truncation, -1..1, nan where no beam has been;
        ``weight``: int32, beams of each cell; ``surface``: float64, shape (N, 2), x and y in the
        map frame where the field, interpolated between two neighbours, is zero.
        """
        field = self._field()
        places = crossings_of(field).places()
        return {
            "tsdf": field.astype(np.float32),
            "weight": self._weights,
            "surface": self.frame.xy_from_continuous_rowcol(places),
        }

    def _field(self) -> NDArray[np.float64]:
        with np.errstate(invalid="ignore"):
            field: NDArray[np.float64] = self._sums / (self._weights * float(DISTANCE_UNIT))
        return field
