"""One map of several: their cells on the lattice of the first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.editing.conflicts import MapCounts, compared, states_of
from mapdeal.editing.evidence import (
    EVEN,
    ChosenLayers,
    Layers,
    chosen_layers,
    evidence_of,
    in_beams,
)
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.display import Drawn, count_text
from mapdeal.grid.field_view import FieldView
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import MOST_CELLS, Region
from mapdeal.grid.resample import region_on_lattice, resampled
from mapdeal.grid.transform import Transform
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, check_choice
from mapdeal.records import dataclass

Rule = Literal["occupied", "newest", "evidence"]

FEWEST = 2
"""Maps that can be merged."""

_TOUCHING = 1e-6
"""In cells: borders that differ by less are the same on paper."""

Values = NDArray[np.int8]


@dataclass(frozen=True, eq=False, repr=False)
class Merged(Drawn):
    """Result of `merge`: several maps combined into one.

    Parameters
    ----------
    grid : OccupancyGrid
        Merged map.
    conflicts : numpy.ndarray of uint8, shape of the grid
        1 where the first map is occupied and another free, 2 where the first is free and another
        occupied, 3 where only other maps contradict each other; 0 elsewhere.
    maps : tuple of MapCounts
        Counts for each map, in the order given.
    common : int
        Number of cells known in two or more maps.
    log_odds : numpy.ndarray of float64, shape of the grid, optional
        Sum that decided each cell under rule ``evidence``, on the scale of `build_map`: 50 is
        even, nan where nothing is known. None under other rules.
    """

    grid: OccupancyGrid
    conflicts: NDArray[np.uint8]
    maps: tuple[MapCounts, ...]
    common: int
    log_odds: NDArray[np.float64] | None = None

    def _told(self) -> Iterator[str]:
        height, width = self.grid.shape
        yield f"{len(self.maps)} maps"
        yield f"{width} x {height} cells"
        yield count_text(self.conflict_count, "conflict")

    @property
    def conflict_count(self) -> int:
        """Number of cells that are occupied in one map and free in another."""
        return int(np.count_nonzero(self.conflicts))


def merge(
    maps: Sequence[OccupancyGrid],
    *,
    transforms: Sequence[Transform | None] | None = None,
    rule: Rule = "occupied",
    evidence: Sequence[Layers | None] | None = None,
) -> Merged:
    """Merge several maps into one.

    The result lies on the lattice of the first map, whose cells keep their places, extended by
    whole cells to cover what the other maps know.

    Parameters
    ----------
    maps : sequence of OccupancyGrid
        Two or more maps; size, origin, yaw and resolution may differ.
    transforms : sequence of Transform, optional
        One for each map but the first, from the first map's frame to the frame of that map, as
        `align` finds it: p_map = T p_first. None, for one map or for all, means the same frame.
    rule : {'occupied', 'newest', 'evidence'}
        How to combine the values of a cell. ``occupied``: the largest value wins, so that
        occupied wins over free, and free over unknown; every obstacle of every map is kept.
        ``newest``: the last map in the sequence that knows the cell wins. ``evidence``: the sign
        of the summed evidence for and against an obstacle decides; ties go by ``occupied``.
    evidence : sequence of mapping, optional
        Layers of each map for rule ``evidence``, as returned by `build_map`: ``log_odds``, or
        ``hits`` and ``misses``. None or an empty mapping stands for a map without layers; each of
        its cells has one vote.

    Returns
    -------
    Merged
        The merged map, the conflicts, and the counts for each map.

    Raises
    ------
    ParameterError
        If there are fewer than two maps, one of them is not a map, `transforms` or `evidence` do
        not fit the maps or the rule, or the maps are too far apart for one grid.

    Warns
    -----
    MapdealWarning
        If a map adds nothing, has no known cell in common with another, or contradicts the others
        so strongly that it is probably misaligned; if a map has no layers under rule ``evidence``.

    Notes
    -----
    For a map on another lattice, ``occupied`` and ``newest`` mark every cell that overlaps one of
    its obstacles, however little, and use the value at the centre of all other cells. Conflicts
    and votes use the value at the centre, or, if the map is finer than the result, any obstacle in
    the cell, which could be missed otherwise. Layers of evidence are sampled at the centre.

    For conflicts and votes, a cell is occupied at 65 and above and free at 25 and below, the
    defaults of Nav2's map_saver.

    The unit of evidence is one passing beam. ``log_odds`` count from 50, a hit in ``hits`` weighs
    7/3 (so that the sum is positive above a share of hits of 0.3, the default of method
    ``counting``), and a vote weighs 1.

    References
    ----------
    ``updateWithMax`` of costmap_2d also lets the largest value win. The sum follows H. Moravec and
    A. Elfes, "High Resolution Maps from Wide Angle Sonar", 1985.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> before = OccupancyGrid([[100, 0, 0, -1]], 0.5, (1.0, 2.0, 0.0))
    >>> after = OccupancyGrid([[0, 100, 100, 0]], 0.5, (1.5, 2.0, 0.0))
    >>> merged = merge([before, after])
    >>> merged.grid.occupancy.tolist(), merged.conflicts.tolist()
    ([[100, 0, 100, 100, 0]], [[0, 0, 2, 0, 0]])
    >>> merge([before, after], rule="newest").grid.occupancy.tolist()
    [[100, 0, 100, 100, 0]]
    """
    layers = _checked(maps, transforms, rule, evidence)
    frames = placed(maps, transforms)
    merged = merged_on(lattice_around(maps, frames), maps, frames, rule=rule, evidence=layers)
    names = [f"map {number}" for number in range(1, len(maps) + 1)]
    for text in remarks_on(merged, names, rule, without_layers(layers)):
        emit_warning(text, stacklevel=2)
    return merged


def placed(
    maps: Sequence[OccupancyGrid], transforms: Sequence[Transform | None] | None
) -> list[Frame]:
    """Return where each map lies in the frame of the first."""
    further = [None] * (len(maps) - 1) if transforms is None else transforms
    return [
        grid.frame if transform is None else transform.inverse().frame(grid.frame)
        for grid, transform in zip(maps, [None, *further], strict=True)
    ]


def lattice_around(maps: Sequence[OccupancyGrid], frames: Sequence[Frame]) -> Frame:
    """Return the cells of the first map's lattice that hold it and all known cells."""
    first = frames[0]
    low, high = np.zeros(2), np.array(first.shape, dtype=np.float64)
    for grid, frame in zip(maps[1:], frames[1:], strict=True):
        corners = _corners_of_known(grid.occupancy)
        if len(corners):
            places = first.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
            low = np.minimum(low, np.floor(places.min(axis=0) + _TOUCHING))
            high = np.maximum(high, np.ceil(places.max(axis=0) - _TOUCHING))
    row, col = (int(edge) for edge in low)
    height, width = (int(edge) for edge in high - low)
    if height * width > MOST_CELLS:
        rule = f"the maps lie too far apart: {width} x {height} cells hold them all"
        raise ParameterError(rule, place="origin")
    return Region(row, col, height, width).frame_in(first)


def merged_on(
    lattice: Frame,
    maps: Sequence[OccupancyGrid],
    frames: Sequence[Frame],
    *,
    rule: Rule = "occupied",
    evidence: Sequence[ChosenLayers] = (),
) -> Merged:
    """Return maps, each at its place, as one on a lattice; see `merge`, which says what is odd."""
    values = np.full(lattice.shape, UNKNOWN, dtype=np.int8)
    states = []
    for grid, frame in zip(maps, frames, strict=True):
        kept, said = _brought(lattice, grid, frame)
        states.append(states_of(said))
        if rule == "newest":
            np.copyto(values, kept, where=kept != UNKNOWN)
        else:
            np.maximum(values, said if rule == "evidence" else kept, out=values)
        del kept, said
    log_odds = None
    if rule == "evidence":
        total = evidence_of(lattice, states, frames, evidence)
        values[total > 0] = OCCUPIED
        values[total < 0] = FREE
        log_odds = in_beams(total)
        del total
        log_odds += EVEN
        log_odds[values == UNKNOWN] = np.nan
    conflicts, counts, common = compared(states)
    grid = OccupancyGrid(values, lattice.resolution, lattice.origin)
    return Merged(grid, conflicts, counts, common, log_odds)


def without_layers(evidence: Sequence[ChosenLayers]) -> list[int]:
    """Return the indices of the maps whose layers say nothing of hits."""
    return [k for k, layers in enumerate(evidence) if not layers]


def remarks_on(
    merged: Merged,
    names: Sequence[str],
    rule: Rule,
    layerless: Sequence[int],
    *,
    advice: str = "",
) -> Iterator[str]:
    """Yield what there is to warn of."""
    if rule == "evidence" and len(layerless) == len(names):
        yield "no map has evidence layers; each of their cells counts as one vote"
    elif rule == "evidence":
        for k in layerless:
            yield f"{names[k]}: has no evidence layers; each of its cells counts as one vote"
    for name, counts in list(zip(names, merged.maps, strict=True))[1:]:
        if not counts.common:
            yield f"{name}: knows no cell that another map knows"
        elif not counts.added and (rule == "occupied" or not counts.conflicts):
            yield f"{name}: adds nothing: the maps before it know all of its cells and obstacles"
        if counts.is_contradicted:
            share = 100 * counts.conflict_share
            yield (
                f"{name}: contradicts the other maps on {share:.1f} % of the cells that it shares "
                f"with them, and only {counts.met} of its {counts.walls} wall cells there have a "
                f"wall of theirs near: it is hardly aligned{advice}"
            )


def _checked(
    maps: Sequence[OccupancyGrid],
    transforms: Sequence[Transform | None] | None,
    rule: Rule,
    evidence: Sequence[Layers | None] | None,
) -> list[ChosenLayers]:
    """Refuse what cannot be merged; return the layers of each map."""
    check_choice(rule, Rule, "rule")
    if len(maps) < FEWEST:
        raise ParameterError("takes two maps or more", place="maps", got=len(maps))
    for number, grid in enumerate(maps, 1):
        check_is_map(grid, f"map {number}")
    if transforms is not None and len(transforms) != len(maps) - 1:
        rule_ = f"must be {len(maps) - 1}, one for each map but the first"
        raise ParameterError(rule_, place="transforms", got=len(transforms))
    if evidence is None:
        return [{} for _ in maps]
    if rule != "evidence":
        raise ParameterError("is for rule evidence alone", place="evidence")
    if len(evidence) != len(maps):
        raise ParameterError(
            f"must be {len(maps)}, one for each map", place="evidence", got=len(evidence)
        )
    chosen = []
    for number, (layers, grid) in enumerate(zip(evidence, maps, strict=True), 1):
        try:
            chosen.append(chosen_layers(layers or {}, grid.shape))
        except ParameterError as error:
            raise error.found_in(f"map {number}") from None
    return chosen


def check_is_map(grid: object, name: str) -> OccupancyGrid:
    """Return a map, refusing what is none."""
    if not isinstance(grid, OccupancyGrid) or isinstance(grid, FieldView):
        rule = "is not a map; merge the maps, and compute costs and fields from the result"
        raise ParameterError(rule, source=name)
    return grid


def _brought(lattice: Frame, grid: OccupancyGrid, frame: Frame) -> tuple[Values, Values]:
    """Return a map in cells of the lattice: with all of its obstacles, and what it says there."""
    there = replace(grid, origin=frame.origin)
    if region_on_lattice(frame, lattice) is not None:
        kept = resampled(there, lattice, rule="nearest").occupancy
        return kept, kept
    kept = resampled(there, lattice).occupancy
    if frame.resolution < lattice.resolution:
        return kept, kept
    return kept, resampled(there, lattice, rule="nearest").occupancy


def _corners_of_known(occupancy: Values) -> NDArray[np.int64]:
    """Return corners of cells, shape (N, 2), whose hull holds all known cells."""
    known = occupancy != UNKNOWN
    rows = np.flatnonzero(known.any(axis=1))
    first = known[rows].argmax(axis=1)
    last = known.shape[1] - known[rows, ::-1].argmax(axis=1)
    ends = [np.stack([rows + up, col], axis=1) for up in (0, 1) for col in (first, last)]
    return np.concatenate(ends)
