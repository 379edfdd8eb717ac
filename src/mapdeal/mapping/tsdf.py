"""Maps from truncated signed distances."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import CELLS, Bound, Words
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.dilation import dilate_square
from mapdeal.kernels.rays import DISTANCE_UNIT, count_rays, measure_rays
from mapdeal.mapping.beams import Beams
from mapdeal.mapping.evidence import OFTEN, Evidence, HitGroups, Layers

Field = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Crossings(NamedTuple):
    """Pairs of neighbours of different sign, and cells that are exactly zero."""

    along_rows: Mask
    along_cols: Mask
    at_zero: Mask
    field: Field

    def places(self) -> Field:
        """Return where the field is zero, continuous row and column, shape (N, 2).

        Between two centres the field is taken for linear.
        """
        parts = [np.argwhere(self.at_zero) + 0.5]
        for axis, changes in ((1, self.along_rows), (0, self.along_cols)):
            cells = np.argwhere(changes)
            near = self.field[tuple(cells.T)]
            cells[:, axis] += 1
            far = self.field[tuple(cells.T)]
            places = cells + 0.5
            places[:, axis] += near / (near - far) - 1.0  # from the second cell's centre back
            parts.append(places)
        return np.concatenate(parts)


def crossings_of(field: Field) -> Crossings:
    """Return where a field, nan where there are no values, changes its sign."""
    with np.errstate(invalid="ignore"):
        positive, negative = field > 0, field < 0
    along_rows = positive[:, :-1] & negative[:, 1:] | negative[:, :-1] & positive[:, 1:]
    along_cols = positive[:-1] & negative[1:] | negative[:-1] & positive[1:]
    return Crossings(along_rows, along_cols, field == 0, field)


def thin_surface(field: Field, crossings: Crossings) -> Mask:
    """Return cells that part positive from negative ones, as few as leave no gap.

    Of each pair that the sign changes between at least one cell is chosen: the one nearer to
    zero. Where a cell's partners are all chosen themselves it is not needed, and is left out, those
    farthest from zero first.
    """
    size = np.abs(field)
    chosen = crossings.at_zero.copy()
    for changes, first, second in _sides(crossings):
        # of equal ones that behind the surface, so that free space stays
        nearer = (size[first] < size[second]) | (size[first] == size[second]) & (field[first] < 0)
        chosen[first] |= changes & nearer
        chosen[second] |= changes & ~nearer
    needed = np.zeros(field.shape, dtype=np.int64)  # partners that are not chosen
    partners = np.zeros(field.shape, dtype=np.int64)
    for changes, first, second in _sides(crossings):
        needed[first] += changes & ~chosen[second]
        needed[second] += changes & ~chosen[first]
        partners[first] += changes
        partners[second] += changes
    spare = np.argwhere(chosen & (needed == 0) & (partners > 0) & ~crossings.at_zero)
    for index in np.argsort(-size[tuple(spare.T)], kind="stable").tolist():
        row, col = spare[index].tolist()
        if needed[row, col] == 0:
            chosen[row, col] = False
            for other in _partners_of(crossings, row, col):
                needed[other] += 1
    thin_blocks(chosen, size)
    return chosen


def thin_blocks(chosen: Mask, size: Field) -> None:
    """Take cells out of blocks of 2 x 2, in place, that the wall is as connected without.

    Noise leaves such blocks where the sign changes to and fro. Those farthest from zero go first.
    """
    padded = np.pad(chosen, 1)
    blocks = padded[1:, 1:] & padded[1:, :-1] & padded[:-1, 1:] & padded[:-1, :-1]
    in_block = blocks[1:, 1:] | blocks[1:, :-1] | blocks[:-1, 1:] | blocks[:-1, :-1]
    cells = np.argwhere(in_block)
    for index in np.argsort(-size[tuple(cells.T)], kind="stable").tolist():
        row, col = cells[index].tolist()
        ring = [bool(padded[row + 1 + y, col + 1 + x]) for y, x in _RING]
        if _has_corner(ring) and _is_simple(ring):
            padded[row + 1, col + 1] = chosen[row, col] = False


_RING = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""The neighbours of a cell, one after the other."""


def _has_corner(ring: list[bool]) -> bool:
    """Return whether three neighbours in a row, a diagonal one in the middle, are all set."""
    return any(ring[k] and ring[k + 1] and ring[(k + 2) % 8] for k in (0, 2, 4, 6))


def _is_simple(ring: list[bool]) -> bool:
    """Return whether what a cell connects is connected without it, diagonal steps included.

    That is so if Yokoi's connectivity number is 1.
    """
    free = [not value for value in ring]
    return sum(free[k] - (free[k] and free[k + 1] and free[(k + 2) % 8]) for k in (0, 2, 4, 6)) == 1


_Slices = tuple[slice, slice]


def _sides(crossings: Crossings) -> list[tuple[Mask, _Slices, _Slices]]:
    """Return for both directions the changes, and where their first and second cells are."""
    every = slice(None)
    return [
        (crossings.along_rows, (every, slice(None, -1)), (every, slice(1, None))),
        (crossings.along_cols, (slice(None, -1), every), (slice(1, None), every)),
    ]


def _partners_of(crossings: Crossings, row: int, col: int) -> list[tuple[int, int]]:
    rows, cols = crossings.along_rows, crossings.along_cols
    found = []
    if col < rows.shape[1] and rows[row, col]:
        found.append((row, col + 1))
    if col > 0 and rows[row, col - 1]:
        found.append((row, col - 1))
    if row < cols.shape[0] and cols[row, col]:
        found.append((row + 1, col))
    if row > 0 and cols[row - 1, col]:
        found.append((row - 1, col))
    return found


_FARTHEST = 1000.0
"""Cells that distances, and beams behind what they hit, reach at most."""

_TRUNCATION = Bound(f"1 to {_FARTHEST:g}", lambda value: 1 <= value <= _FARTHEST)

_Truncation = Annotated[float, _TRUNCATION, CELLS]

_TENTHS_OF_THIN = 3
"""Share of hits above which free cells are thin obstacles: that of method counting."""


class Tsdf(Evidence):
    """The mean of each cell's signed distances along the beams to what they hit.

    Parameters
    ----------
    frame : Frame
        Geometry of the map.
    truncation : float
        Truncation distance, cells.
    truncation_behind : float
        How far beams continue behind a hit, in truncation distances.

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
        self,
        frame: Frame,
        *,
        truncation: _Truncation = 2.0,
        truncation_behind: Annotated[float, Words("N")] = 1.0,
    ) -> None:
        super().__init__(frame)
        self._truncation, self._behind = truncation, truncation_behind
        self.reach_behind = truncation * truncation_behind
        if not 1 <= self.reach_behind <= _FARTHEST:
            least, most = 1 / truncation, _FARTHEST / truncation
            rule = f"must be {least:.6g} to {most:.6g} truncations: 1 to {_FARTHEST:g} cells"
            raise ParameterError(rule, place="truncation_behind", got=truncation_behind)
        self._sums: NDArray[Any] = np.zeros(frame.shape, dtype=np.int64)
        self._weights, self._hits, self._misses = np.zeros((3, *frame.shape), dtype=np.int32)

    def add(self, beams: Beams) -> None:
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
        return self._hits >= OFTEN

    def advice(self, vanished: HitGroups) -> str:
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
        self, frame: Frame, *, truncation: _Truncation = 2.0, truncation_behind: float = 3.0
    ) -> None:
        super().__init__(frame, truncation=truncation, truncation_behind=truncation_behind)
        self._sums = np.zeros(frame.shape)  # means

    def add(self, beams: Beams) -> None:
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
