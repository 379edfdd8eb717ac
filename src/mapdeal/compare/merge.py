"""Merging of several maps of one place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid import canvas, field
from mapdeal.grid.frame import MOST_CELLS, Frame, Region
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, OneLineRepr, count_text
from mapdeal.kernels import components, distance, lookup, threads
from mapdeal.kernels.arrays import Integers, Mask, unreachable
from mapdeal.records import dataclass, replace

NO_CONFLICT, BY_FIRST, BY_OTHERS, AMONG_OTHERS = range(4)
"""No conflict; the first map is occupied; it is free; it is neither, and the others differ."""
OCCUPIED_FROM, FREE_UP_TO = 65, 25  # defaults of Nav2's map_saver for occupied and free cells
_NEAR = 2  # cells within which obstacles of two maps may be the same
_ROWS_AT_ONCE = 256
_MANY = 0.01  # share of common cells: aligned maps have fewer conflicts
NOTHING, _IS_FREE, _IS_OCCUPIED, BETWEEN = range(4)
States = NDArray[np.uint8]
Numbers = NDArray[np.uint16]


@dataclass(frozen=True, repr=False)
class MapCounts(OneLineRepr):
    """Comparison of one map with the others in a merge, in cells of the merged map.

    Parameters
    ----------
    known : int
        Number of cells known in this map.
    common : int
        Known cells that are known in another map as well.
    added : int
        Cells that this map is the first to know, or the first to show as occupied.
    occupied_here : int
        Cells occupied in this map and free in another.
    free_here : int
        Cells free in this map and occupied in another.
    walls : int
        Cells occupied in this map and known in another.
    met : int
        Cells of `walls` with an obstacle of another map within two cells; most of them, if the
        maps are aligned.
    same_wall : float
        Distance within which walls of this map and of earlier ones count as one, metres.
    within_cell, within_same_wall : float or None
        Share of this map's obstacles, if any, with an obstacle of the result within a cell, and
        within `same_wall` (for the first map the largest).
    thickness : float or None
        Mean thickness of its own walls, metres.
    """

    known: int
    common: int
    added: int
    occupied_here: int
    free_here: int
    walls: int
    met: int
    same_wall: float = 0.0
    within_cell: float | None = None
    within_same_wall: float | None = None
    thickness: float | None = None

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.known} known"
        yield f"{self.common} in common"
        yield f"{self.added} added"
        yield count_text(self.conflicts, "conflict")
        yield f"{self.met} of {self.walls} walls met"

    @property
    def conflicts(self) -> int:
        """Number of cells in which this map and another contradict each other."""
        return self.occupied_here + self.free_here

    @property
    def conflict_share(self) -> float:
        """Conflicts as a share of `common`; 0 if no cell is common."""
        return self.conflicts / self.common if self.common else 0.0

    @property
    def is_contradicted(self) -> bool:
        """Whether the map is probably misaligned: many conflicts, and few walls met."""
        # Moved furniture and walls one cell apart cause conflicts, too.
        return self.conflict_share > _MANY and 2 * self.met < self.walls


def states_of(values: NDArray[np.int8]) -> States:
    table = np.full(256, BETWEEN, dtype=np.uint8)
    table[: FREE_UP_TO + 1] = _IS_FREE
    table[OCCUPIED_FROM:] = _IS_OCCUPIED
    table[UNKNOWN] = NOTHING
    return lookup.look_up(values, table)


def compared(
    states: Sequence[States], reach: float = 0.0
) -> tuple[States, tuple[MapCounts, ...], int]:
    """Return the conflicts of maps, the counts of each, and the number of common cells."""
    # A free cell contradicts no wall of another map if its own map has a wall within the reach.
    shape = states[0].shape
    occupied = _maps_with((cells == _IS_OCCUPIED for cells in states), shape)
    free = _maps_with((_clear(cells, reach) for cells in states), shape)
    known = _maps_with((cells != NOTHING for cells in states), shape)
    differ = (occupied > 0) & (free > 0)
    conflicts = np.where(differ, np.uint8(AMONG_OTHERS), np.uint8(NO_CONFLICT))
    conflicts[differ & (states[0] == _IS_OCCUPIED)] = BY_FIRST
    conflicts[differ & (states[0] == _IS_FREE)] = BY_OTHERS
    return conflicts, tuple(_counts(states, reach, occupied, free, known)), _count(known > 1)


def _clear(states: States, reach: float) -> Mask:
    """Return the free cells of a map that are farther than the reach, cells, from its walls."""
    free: Mask = states == _IS_FREE
    if reach > 0:
        free &= ~distance.within_distance(states == _IS_OCCUPIED, int(reach * reach))
    return free


def _maps_with(masks: Iterable[Mask], shape: tuple[int, ...]) -> Numbers:
    numbers = np.zeros(shape, dtype=np.uint16)
    for mask in masks:
        numbers += mask
    return numbers


def _count(mask: Mask) -> int:
    return int(np.count_nonzero(mask))


def _counts(
    states: Sequence[States], reach: float, occupied: Numbers, free: Numbers, known: Numbers
) -> Iterator[MapCounts]:
    known_before, occupied_before = np.zeros((2, *states[0].shape), dtype=np.bool_)
    for cells in states:
        own_known, own_occupied = cells != NOTHING, cells == _IS_OCCUPIED
        own_free = _clear(cells, reach)
        shared, other_occupied = own_known & (known > own_known), occupied > own_occupied
        walls = own_occupied & shared
        yield MapCounts(
            known=_count(own_known),
            common=_count(shared),
            added=_count((own_known & ~known_before) | (own_occupied & ~occupied_before)),
            occupied_here=_count(own_occupied & (free > own_free)),
            free_here=_count(own_free & other_occupied),
            walls=_count(walls),
            met=_count(walls & distance.within_distance(other_occupied, _NEAR**2)),
        )
        known_before |= own_known
        occupied_before |= own_occupied


Layers = Mapping[str, ArrayLike]  # by the names that `build_map` gives them
ChosenLayers = Mapping[str, NDArray[Any]]  # layers with evidence about hits, checked
EVEN = 50.0  # of ``log_odds``: evidence for and against an obstacle is equal
_PASS, _HIT = 3 << 16, 7 << 16
"""Evidence of passing and of hitting beams: occupied above 30 % of hits. Integers sum exactly."""
_MOST = 1e9  # largest value of a layer, so that sums of many fit 64 bits
_LOG_ODDS, _HITS, _MISSES = "log_odds", "hits", "misses"


def chosen_layers(layers: Layers, shape: tuple[int, int]) -> ChosenLayers:
    """Return a map's layers with evidence about hits, if it has any."""
    keys = (_LOG_ODDS,) if _LOG_ODDS in layers else (_HITS, _MISSES)
    if not any(key in layers for key in keys):
        return {}
    chosen = {}
    for key in keys:
        if key not in layers:
            raise ParameterError("is missing", place=key)
        layer = np.asarray(layers[key])
        if layer.shape != shape:
            raise ParameterError(f"must be of the map's {shape[1]} x {shape[0]} cells", place=key)
        if layer.dtype.kind not in "fiu":
            raise ParameterError("must be numbers", place=key, got=str(layer.dtype))
        least = -_MOST if key == _LOG_ODDS else 0.0
        invalid = (layer < least) | (layer > _MOST)
        if key != _LOG_ODDS:  # there, nan means that no beam passed
            invalid |= np.isnan(layer)
        if invalid.any():
            rule = f"must lie in {least:g}..{_MOST:g}"
            raise ParameterError(rule, place=key, got=layer[invalid][0].item())
        chosen[key] = layer
    return chosen


def evidence_of(
    lattice: Frame, states: Sequence[States], frames: Sequence[Frame],
    layers: Sequence[ChosenLayers],
) -> Integers:  # fmt: skip
    total = np.zeros(lattice.shape, dtype=np.int64)
    for state, frame, own in zip(states, frames, layers, strict=True):
        if own:
            _add_layers(total, lattice, own, frame)
        else:
            total[state == _IS_OCCUPIED] += _PASS
            total[state == _IS_FREE] -= _PASS
    return total


def _add_layers(total: Integers, lattice: Frame, layers: ChosenLayers, source: Frame) -> None:
    def add(part: slice) -> None:
        numbers = np.arange(part.start, part.stop)
        cells = np.stack(np.meshgrid(numbers, np.arange(lattice.width), indexing="ij"), axis=-1)
        at, inside = source.bounded_rowcol_from_xy(lattice.xy_from_rowcol(cells.reshape(-1, 2)))
        row, col = at[inside].T
        rows = total[part].reshape(-1)  # a view, since rows are contiguous
        if _LOG_ODDS in layers:
            units = np.rint((layers[_LOG_ODDS][row, col].astype(np.float64) - EVEN) * _PASS)
            rows[inside] += np.where(np.isnan(units), 0.0, units).astype(np.int64)
        else:
            hits, misses = (layers[name][row, col].astype(np.int64) for name in (_HITS, _MISSES))
            rows[inside] += hits * _HIT - misses * _PASS

    threads.for_rows(add, lattice.shape)


Rule = Literal["occupied", "newest", "evidence"]
FEWEST = 2  # maps that can be merged
_TOUCHING = 1e-6  # cells: borders that differ by less are equal
_SNAPPED = 0.1  # cells: a map whose corners are off by less is moved onto the first map's cells
_PERCENT_PAIRED, _LEAST_APART, _MOST_APART = 85, 1.5, 0.3
"""Walls of two maps count as one within the distance that 85 % of them have, plus a cell; at least
1.5 cells, at most 0.3 m."""
_PAIRING_REACH = 0.5  # metres, at least three cells: walls farther apart are not paired
Values = NDArray[np.int8]


def snapped(frame: Frame, lattice: Frame) -> Frame:
    """Return a frame, moved onto the cells of a lattice if it is close to them."""
    if not math.isclose(frame.resolution, lattice.resolution, rel_tol=1e-9):
        return frame
    height, width = frame.shape
    corners = np.array([[0, 0], [0, width], [height, 0], [height, width]])
    places = lattice.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
    first = np.rint(places[0])
    if np.abs(places - (first + corners)).max() >= _SNAPPED:
        return frame
    return lattice.window(int(first[0]), int(first[1]), height, width)


def lattice_around(maps: Sequence[OccupancyGrid], frames: Sequence[Frame]) -> Frame:
    """Return the frame on the first map's lattice around it and all known cells."""
    first = frames[0]
    low, high = np.zeros(2), np.array(first.shape, dtype=np.float64)
    for grid, frame in zip(maps[1:], frames[1:], strict=True):
        corners = _corners_of_known(grid.occupancy)
        if len(corners):
            places = first.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
            low = np.minimum(low, np.floor(places.min(axis=0) + _TOUCHING))
            high = np.maximum(high, np.ceil(places.max(axis=0) - _TOUCHING))
    row, col, height, width = map(int, [*low, *(high - low)])
    if height * width > MOST_CELLS:
        rule = f"the maps lie too far apart: {width} x {height} cells hold them all"
        raise ParameterError(rule, place="origin")
    return Region(row, col, height, width).frame_in(first)


def merged_on(
    lattice: Frame, maps: Sequence[OccupancyGrid], frames: Sequence[Frame], rule: Rule,
    evidence: Sequence[ChosenLayers], same_wall: float | None,
) -> dict[str, Any]:  # fmt: skip
    """Return the result of a merge, without its inputs: the fields of `Merged` by name."""
    values = np.full(lattice.shape, UNKNOWN, dtype=np.int8)
    states: list[States] = []
    apart = [0.0]  # cells within which walls of a map and of earlier ones count as one
    for grid, frame in zip(maps, frames, strict=True):
        safe, at_centres = _resampled(lattice, grid, frame)
        state = states_of(at_centres)
        if states:
            apart.append(_same_wall_cells(states, state, lattice.resolution, same_wall))
            if rule != "evidence":
                safe = safe if safe.flags.writeable else safe.copy()
                _drop_doubled(values, safe, apart[-1], keeps_new=rule == "newest")
        states.append(state)
        if rule == "newest":
            np.copyto(values, safe, where=safe != UNKNOWN)
        else:
            np.maximum(values, at_centres if rule == "evidence" else safe, out=values)
        del safe, at_centres
    log_odds = None
    if rule == "evidence":
        total = evidence_of(lattice, states, frames, evidence)
        values[total > 0] = OCCUPIED
        values[total < 0] = FREE
        log_odds = total / _PASS
        del total
        log_odds += EVEN
        log_odds[values == UNKNOWN] = np.nan
    widest = max(apart)
    conflicts, counts, common = compared(states, widest if widest > _LEAST_APART else 0.0)
    grid = OccupancyGrid(values, lattice.resolution, lattice.origin)
    walls = values >= OCCUPIED_FROM
    map_counts = []
    for source, count, state, reach in zip(maps, counts, states, [widest, *apart[1:]], strict=True):
        own = state == _IS_OCCUPIED
        near, nearest = (_share_within(own, walls, cells) for cells in (math.sqrt(2), reach))
        map_counts.append(replace(
            count, same_wall=reach * lattice.resolution, within_cell=near, within_same_wall=nearest,
            thickness=thickness(source),
        ))  # fmt: skip
    fields = {"grid": grid, "conflicts": conflicts, "maps": tuple(map_counts), "common": common}
    kept_count = _count((states[-1] == NOTHING) & (values != UNKNOWN))
    return fields | {"log_odds": log_odds, "thickness": thickness(grid), "kept": kept_count}


def _same_wall_cells(
    before: Sequence[States], state: States, resolution: float, same_wall: float | None
) -> float:
    """Return the cells within which walls of a map and of earlier ones count as one."""
    if same_wall is not None:
        return min(same_wall / resolution, math.hypot(*state.shape))
    walls = np.zeros(state.shape, dtype=np.bool_)
    for earlier in before:
        walls |= earlier == _IS_OCCUPIED
    reach = max(_PAIRING_REACH / resolution, 3.0)
    squares = distance.squared_distance(walls, limit=int(reach * reach))[state == _IS_OCCUPIED]
    squares = squares[squares != unreachable(squares)]
    paired = math.sqrt(np.percentile(squares, _PERCENT_PAIRED)) if len(squares) else 0.0
    return min(max(paired + 1, _LEAST_APART), max(_MOST_APART / resolution, _LEAST_APART))


def _drop_doubled(earlier: Values, later: Values, reach: float, *, keeps_new: bool) -> None:
    """Remove walls that both maps have from one of them, in place."""
    if reach <= 0:
        return
    base, reduced = (later, earlier) if keeps_new else (earlier, later)
    own, walls = reduced >= OCCUPIED_FROM, base >= OCCUPIED_FROM
    doubled = own & distance.within_distance(walls, int(reach * reach))
    # an obstacle that stands out from the walls of the base, such as a closed door, stays whole
    stands_out = own & ~distance.within_distance(walls, int(4 * reach * reach))
    doubled &= ~distance.within_distance(stands_out, int((2 * reach + 1) ** 2))
    # unknown, so that the value of the base counts there
    reduced[doubled & ~walls] = UNKNOWN


def _share_within(own: Mask, walls: Mask, cells: float) -> float | None:
    count = _count(own)
    square = int(cells * cells + _TOUCHING)
    return _count(own & distance.within_distance(walls, square)) / count if count else None


def thickness(grid: OccupancyGrid) -> float | None:
    cells = components.thickness_of(np.asarray(grid.occupancy) >= OCCUPIED_FROM)
    return float(cells.mean()) * grid.resolution if len(cells) else None


def check_is_map(grid: object, name: str) -> OccupancyGrid:
    if not isinstance(grid, OccupancyGrid) or isinstance(grid, field.FieldView):
        rule = "is not a map; merge the maps, and compute costs and fields from the result"
        raise ParameterError(rule, source=name)
    return grid


def _resampled(lattice: Frame, grid: OccupancyGrid, frame: Frame) -> tuple[Values, Values]:
    """Return a map on the lattice: without losing an obstacle, and its values at cell centres."""
    placed = replace(grid, origin=frame.origin)
    coincides = canvas.region_on_lattice(frame, lattice) is not None
    safe = canvas.resampled(placed, lattice, rule="nearest" if coincides else "area").occupancy
    if coincides or frame.resolution < lattice.resolution:
        return safe, safe
    return safe, canvas.resampled(placed, lattice, rule="nearest").occupancy


def _corners_of_known(occupancy: Values) -> Integers:
    """Return corners of cells, shape (N, 2), whose hull contains all known cells."""
    height, width = occupancy.shape
    ends = []
    for start in range(0, height, _ROWS_AT_ONCE):  # the masks of all rows are as large as the map
        known = occupancy[start : start + _ROWS_AT_ONCE] != UNKNOWN
        rows = np.flatnonzero(known.any(axis=1))
        first, last = known[rows].argmax(axis=1), width - known[rows, ::-1].argmax(axis=1)
        sides = product((start + rows, start + rows + 1), (first, last))
        ends += [np.stack(side, axis=1) for side in sides]
    return np.concatenate(ends)
