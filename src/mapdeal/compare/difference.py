"""What differs between two maps, cell by cell, and bounds on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np

from mapdeal import errors, records
from mapdeal.grid import canvas, values as codes
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import MOST_CELLS, Frame, Region, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import components, lookup, threads
from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask, SignedBytes
from mapdeal.kernels.distance import within_distance

STATES = ("occupied", "free", "unknown", "between")  # of cells; "between" are the values 1..99
SYMMETRIES: dict[str, Callable[[SignedBytes], SignedBytes]] = {
    "mirrored upside down": np.flipud,
    "mirrored left to right": np.fliplr,
    "turned by 180 degrees": lambda cells: cells[::-1, ::-1],
    "turned by 90 degrees": np.rot90,
    "turned by -90 degrees": lambda cells: np.rot90(cells, -1),
    "transposed": np.transpose,
    "transposed and turned by 180 degrees": lambda cells: cells.T[::-1, ::-1],
}
"""Ways in which the cells of a map are often confused."""

# What a cell of the comparison shows; where cells share a pixel the largest does.
OUTSIDE, BOTH_UNKNOWN, BOTH_FREE, CHANGED, COMMON, REMOVED, ADDED = range(7)
_MOST_TOLERANCE = 1000.0


@records.dataclass(frozen=True)
class WallShift:
    """Distances from the obstacles of one map to the nearest of the other, metres."""

    largest: float
    percentile_95: float
    mean: float


_ROUNDING = 1e-9  # of distances: six cells of 0.05 m are 0.30000000000000004 m


@records.dataclass(frozen=True)
class Bound:
    """Bound on the difference between two maps, and the value found.

    Parameters
    ----------
    name : str
        Option that sets the bound, without the leading dashes.
    unit : str
        Unit of both values.
    allowed : float
        Largest value allowed.
    found : float
        Value found; infinite if only one map has obstacles, nan without a common cell.
    """

    name: str
    unit: str
    allowed: float
    found: float

    @classmethod
    def on_share(cls, allowed: float, differing: int, common_cells: int) -> Bound:
        share = 100 * differing / common_cells if common_cells else math.nan
        return cls("max-differing", "%", allowed, share)

    @property
    def holds(self) -> bool:
        """Whether the value found is within the bound, allowing for floating-point rounding."""
        return self.found <= self.allowed * (1 + _ROUNDING)  # never true of nan

    @property
    def text(self) -> str:
        """The bound, whether it holds, and the value found."""
        text = f"--{self.name} {self.allowed:g} {self.unit}: {'holds' if self.holds else 'missed'}"
        if math.isnan(self.found):
            return f"{text}, the maps have no common cell"
        if math.isinf(self.found):
            return f"{text}, only one of the maps has obstacles"
        # 9 digits: a figure that is shown as the bound itself is not beyond it
        return f"{text}, found {self.found:.9g} {self.unit}"

    def document(self) -> dict[str, Any]:
        """Return the bound as values that JSON can represent."""
        found = self.found if math.isfinite(self.found) else None
        return {"allowed": self.allowed, "found": found, "holds": self.holds}


ChangeKind = Literal["added", "removed", "closed", "opened", "unknown", "known", "rose", "fell"]


def middle_xy(frame: Frame, cells: Integers) -> tuple[float, float]:
    """Return the centre of the cell that is nearest to the mean place of cells, shape (N, 2)."""
    away = np.square(cells - cells.mean(axis=0)).sum(axis=1)
    x, y = frame.xy_from_rowcol(cells[[away.argmin()]])[0].tolist()
    return x, y


@records.dataclass(frozen=True)
class Change:
    """Cells that touch and have changed in the same way; x and y are those of a middle cell."""

    kind: ChangeKind
    area: float
    x: float
    y: float
    cells: Integers = records.field(repr=False, compare=False)

    @classmethod
    def largest(
        cls, kind: ChangeKind, marked: Mask, frame: Frame, most: int
    ) -> tuple[list[Change], int]:
        """Return the largest regions of cells that touch, corners included, and how many exist."""
        cells = np.flatnonzero(marked)
        labels = components.labelled(marked, corners=True)
        regions, sizes = labels.cells.ravel()[cells], labels.sizes[1:]
        changes = []
        for region in np.argsort(-sizes, kind="stable")[:most] + 1:
            own = np.stack(np.divmod(cells[regions == region], marked.shape[1]), axis=1)
            changes.append(cls(kind, len(own) * frame.resolution**2, *middle_xy(frame, own), own))
        return changes, len(sizes)

    @property
    def place(self) -> str:
        return f"{codes.decimal_text(self.area, 3)} m2 at {self.x + 0.0:.6g},{self.y + 0.0:.6g}"


@records.dataclass(frozen=True, eq=False, repr=False)
class Difference:
    """Differences between two maps, as `mapdeal.DiffReport` describes them."""

    geometry: dict[str, tuple[Any, Any]]
    common_cells: int
    differing: int
    beyond_tolerance: int
    not_compared: int
    confusion: dict[str, dict[str, int]]
    first_to_second: WallShift | None
    second_to_first: WallShift | None
    symmetry: str | None
    tolerance: float
    frame: Frame
    changes: Bytes
    beyond: Mask

    def largest_changes(self, most: int) -> tuple[list[Change], int]:
        """Return the largest regions of obstacles of one map alone, and the number of others."""
        is_added, is_removed = ((self.changes == code) & self.beyond for code in (ADDED, REMOVED))
        added, added_count = Change.largest("added", is_added, self.frame, most)
        removed, removed_count = Change.largest("removed", is_removed, self.frame, most)
        changes = sorted(added + removed, key=lambda change: -change.area)[:most]
        return changes, added_count + removed_count - len(changes)

    @property
    def is_equal(self) -> bool:
        """Whether the maps have the same geometry and cells, within the tolerance."""
        return not self.geometry and self.beyond_tolerance == 0

    def bounds_of(self, max_shift: float | None, max_differing: float | None) -> tuple[Bound, ...]:
        """Return the bounds that are given; only the common area is judged."""
        found = []
        if max_shift is not None:
            in_first = sum(self.confusion["occupied"].values())
            in_second = sum(row["occupied"] for row in self.confusion.values())
            pairs = (in_first, self.first_to_second), (in_second, self.second_to_first)
            shifts = [math.inf if shift is None else shift.largest for n, shift in pairs if n]
            largest = max(shifts, default=0.0) if self.common_cells else math.nan
            found.append(Bound("max-shift", "m", max_shift, largest))
        if max_differing is not None:
            found.append(Bound.on_share(max_differing, self.beyond_tolerance, self.common_cells))
        return tuple(found)


def compare(first: OccupancyGrid, second: OccupancyGrid, *, tolerance: float = 0.0) -> Difference:
    if not 0 <= tolerance <= _MOST_TOLERANCE:  # refuses nan too
        rule = f"must be 0 to {_MOST_TOLERANCE:g} cells"
        raise errors.ParameterError(rule, place="tolerance", got=tolerance)
    frame = frame_around(first.frame, second.frame)
    a, in_a = canvas.sampled(frame, first.occupancy, first.frame)
    b, in_b = canvas.sampled(frame, second.occupancy, second.frame)
    both = in_a & in_b
    state_a, state_b = states_of(a), states_of(b)
    counts = confusion_of(state_a[both], state_b[both]).tolist()
    differs = beyond = both & (a != b)
    if tolerance > 0:
        beyond = differs & _is_beyond(state_a, state_b, both, math.floor(tolerance**2))
    known = np.count_nonzero(first.occupancy >= 0) - np.count_nonzero(both & (a >= 0))
    walls = [grid.frame.xy_from_rowcol(np.argwhere(grid.occupied())) for grid in (first, second)]
    in_both = [(cells == codes.OCCUPIED) & both for cells in (a, b)]
    in_common = [frame.xy_from_rowcol(np.argwhere(cells)) for cells in in_both]
    if canvas.region_on_lattice(frame, second.frame) is None:  # other cells
        apart = [np.ones(len(walls_xy), np.bool_) for walls_xy in in_common]
    else:
        apart = [~in_both[1 - k][in_both[k]] for k in (0, 1)]
    rows = [dict(zip(STATES, row, strict=True)) for row in counts]
    return Difference(
        geometry=geometry_pairs(first.frame, second.frame), common_cells=int(both.sum()),
        differing=int(differs.sum()), beyond_tolerance=int(beyond.sum()), not_compared=int(known),
        confusion=dict(zip(STATES, rows, strict=True)),
        first_to_second=_shift(in_common[0], walls[1], apart[0]),
        second_to_first=_shift(in_common[1], walls[0], apart[1]),
        symmetry=_better_symmetry(first.occupancy, second.occupancy), tolerance=tolerance,
        frame=frame, changes=changes_of(state_a, state_b, both), beyond=beyond,
    )  # fmt: skip


_SAME_ORIGIN = 1e-5  # cells: the digits of files, and of an alignment, end before


def geometry_pairs(first: Frame, second: Frame) -> dict[str, tuple[Any, Any]]:
    pairs: dict[str, tuple[Any, Any]] = {
        "width": (first.width, second.width),
        "height": (first.height, second.height),
        "resolution": (first.resolution, second.resolution),
        "origin": (list(first.origin), list(second.origin)),
    }
    if np.allclose(first.origin, second.origin, rtol=0, atol=_SAME_ORIGIN * first.resolution):
        del pairs["origin"]
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def states_of(values: SignedBytes) -> Bytes:
    table = np.full(256, STATES.index("between"), dtype=np.uint8)
    table[[codes.OCCUPIED, codes.FREE]] = STATES.index("occupied"), STATES.index("free")
    table[128:] = STATES.index("unknown")
    return table[values.view(np.uint8)]


def confusion_of(first: Bytes, second: Bytes) -> Integers:
    """Return the number of cells by state in one map (rows) and in the other, shape (4, 4)."""
    pairs = first.ravel().astype(np.int64) * len(STATES) + second.ravel()
    return np.bincount(pairs, minlength=len(STATES) ** 2).reshape(len(STATES), -1)


def frame_around(first: Frame, second: Frame) -> Frame:
    """Return the cells of the first lattice that both maps lie in."""
    second_region = region_around(first, second)
    row, col = min(second_region.row, 0), min(second_region.col, 0)
    height = max(second_region.row + second_region.height, first.height) - row
    width = max(second_region.col + second_region.width, first.width) - col
    if height * width > MOST_CELLS:
        rule = f"the maps lie too far apart: {width} x {height} cells hold both"
        raise errors.ParameterError(rule, place="origin")
    return Region(row, col, height, width).frame_in(first)


def _is_beyond(first: Bytes, second: Bytes, both: Mask, square: int) -> Mask:
    """Return cells of which one of the maps has no like within a distance in the other."""
    beyond = np.zeros(both.shape, dtype=np.bool_)
    for state in range(len(STATES)):
        of_first, of_second = (first == state) & both, (second == state) & both
        for own, opposite in ((of_first, of_second), (of_second, of_first)):
            if own.any():
                beyond |= own & ~within_distance(opposite, square)
    return beyond


def _better_symmetry(first: SignedBytes, second: SignedBytes) -> str | None:
    if first.shape not in (second.shape, second.shape[::-1]):
        return None
    as_it_is = int((first == second).sum()) if first.shape == second.shape else 0
    best, most = None, as_it_is + (first.size - as_it_is) // 2
    for name, turn in SYMMETRIES.items():
        turned = turn(second)
        agreeing = int((first == turned).sum()) if turned.shape == first.shape else 0
        if agreeing > most:
            best, most = name, agreeing
    return best


def _shift(walls: Floats, opposite_walls: Floats, apart: Mask) -> WallShift | None:
    """Return how far walls are from the opposite ones; those not `apart` share a cell."""
    if not len(walls) or not len(opposite_walls):
        return None
    from scipy.spatial import cKDTree

    tree = cKDTree(opposite_walls, balanced_tree=False, compact_nodes=False)  # three times as fast
    distance, _ = tree.query(walls[apart])
    clean = np.zeros(len(walls))
    clean[apart] = np.where(distance < 1e-9, 0.0, distance)
    return WallShift(float(clean.max()), float(np.percentile(clean, 95)), float(clean.mean()))


def changes_of(first: Bytes, second: Bytes, both: Mask) -> Bytes:
    """Return what each cell shows, `OUTSIDE` to `ADDED`, given its states and if both have it."""
    occupied, unknown = STATES.index("occupied"), STATES.index("unknown")
    changes = np.where(first == second, np.uint8(BOTH_FREE), np.uint8(CHANGED))
    changes[(first == unknown) & (second == unknown)] = BOTH_UNKNOWN
    changes[(first == occupied) & (second == occupied)] = COMMON
    changes[(first == occupied) & (second != occupied)] = REMOVED
    changes[(first != occupied) & (second == occupied)] = ADDED
    changes[~both] = OUTSIDE
    return changes


SIZES = ((1, 9), (10, 49), (50, 127), (128, 254))  # changes of the cost in `CostChange.by_size`
MOST_REGIONS = 20


@records.dataclass(frozen=True, repr=False)
class CostChange(codes.OneLineRepr):
    """Cells of which the cost has changed in one way.

    Parameters
    ----------
    kind : {'rose', 'fell', 'closed', 'opened', 'unknown', 'known'}
        Higher or lower cost in cells known in both costmaps; cells that became closed (253 or 254),
        ceased to be closed, became unknown, ceased to be unknown. A cell that became closed has
        risen, too, unless it was unknown.
    cells, area : int, float
        Number of cells, and their area, square metres.
    regions : int
        Number of connected regions that they form, corners included.
    largest : tuple of Change
        The largest of these, at most 20, each with its area and a place in its middle.
    by_size : dict of int
        For 'rose' and 'fell', number of cells by the change: 1-9, 10-49, 50-127 and 128-254.
    """

    kind: ChangeKind
    cells: int
    area: float
    regions: int
    largest: tuple[Change, ...]
    by_size: dict[str, int]

    def _repr_parts(self) -> Iterator[str]:
        area = codes.decimal_text(self.area)
        yield f"{self.kind}, {codes.count_text(self.cells, 'cell')}, {area} m2"
        yield codes.count_text(self.regions, "region")


@records.dataclass(frozen=True, eq=False, repr=False)
class CostDifference(codes.OneLineRepr):
    """Differences between two costmaps, A and B, on costmap_2d's scale.

    Parameters
    ----------
    geometry : dict
        Pairs of values for each of width, height, resolution and origin that differs.
    scale : {'costmap2d', 'occupancy'}
        ``occupancy`` if either costmap has it: both then as ROS publishes them, 99 as inscribed.
    common_cells, differing : int
        Number of cells that both costmaps cover, and of those with different costs.
    not_compared : int
        Number of known cells of A that B does not cover.
    changes : dict of CostChange
        The cells that have changed in each way, by its name.
    frame : Frame
        Geometry of the part of A's lattice that covers both costmaps.
    first_costs, second_costs : numpy.ndarray of uint8, shape of `frame`
        Costs of both; those of B are sampled at the centres of the cells.
    is_common : numpy.ndarray of bool, shape of `frame`
        Cells that both costmaps cover.
    masks : dict of numpy.ndarray of bool, shape of `frame`
        Cells that have changed in each way, by its name.
    """

    geometry: dict[str, tuple[Any, Any]]
    scale: codes.CostScale
    common_cells: int
    differing: int
    not_compared: int
    changes: dict[ChangeKind, CostChange]
    frame: Frame
    first_costs: Bytes
    second_costs: Bytes
    is_common: Mask
    masks: dict[ChangeKind, Mask]

    @property
    def is_equal(self) -> bool:
        """Whether the costmaps have the same geometry and costs."""
        return not self.geometry and not self.differing

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.differing} of {self.common_cells} common cells differ"
        yield from (f"{kind} {change.cells}" for kind, change in self.changes.items())


_PER_CHANGE = 30  # bytes of a changed cell, for each kind of change


def compare_costmaps(first: Costmap, second: Costmap) -> CostDifference:
    """Compare the costs of two costmaps, such as those of two versions of a robot's parameters.

    Parameters
    ----------
    first, second : Costmap
        The costmaps, A and B. Size, origin, yaw and resolution may differ.

    Returns
    -------
    CostDifference
        Differences on A's lattice.

    Raises
    ------
    ParameterError
        If the costmaps are too far apart.

    Examples
    --------
    >>> before, after = Costmap([[0, 90, 254, 255]], 0.5), Costmap([[0, 120, 254, 253]], 0.5)
    >>> compare_costmaps(before, after).changes["rose"].by_size
    {'1-9': 0, '10-49': 1, '50-127': 0, '128-254': 0}
    >>> compare_costmaps(before, after).changes["closed"]
    CostChange(closed, 1 cell, 0.25 m2, 1 region)
    """
    frame = frame_around(first.frame, second.frame)
    is_of_bytes = first.scale == second.scale == "costmap2d"
    scale: codes.CostScale = "costmap2d" if is_of_bytes else "occupancy"
    a, in_first = _costs_on(frame, first, scale)
    b, in_second = _costs_on(frame, second, scale)
    is_common = in_first & in_second
    masks = _masks_of_changes(a, b, is_common)
    threads.claim_tables(_PER_CHANGE * sum(int(np.count_nonzero(mask)) for mask in masks.values()))
    return CostDifference(
        geometry=geometry_pairs(first.frame, second.frame), scale=scale,
        common_cells=int(np.count_nonzero(is_common)),
        differing=int(np.count_nonzero(is_common & (a != b))),
        not_compared=int(np.count_nonzero(in_first & ~is_common & (a != codes.NO_INFORMATION))),
        changes={kind: _change(kind, mask, a, b, frame) for kind, mask in masks.items()},
        frame=frame, first_costs=a, second_costs=b, is_common=is_common, masks=masks,
    )  # fmt: skip


def _masks_of_changes(first: Bytes, second: Bytes, is_common: Mask) -> dict[ChangeKind, Mask]:
    unknown = [costs == codes.NO_INFORMATION for costs in (first, second)]
    least = codes.INSCRIBED_INFLATED_OBSTACLE
    closed = [(costs >= least) & (costs != codes.NO_INFORMATION) for costs in (first, second)]
    is_known = is_common & ~unknown[0] & ~unknown[1]
    return {
        "closed": is_common & ~closed[0] & closed[1],
        "opened": is_common & closed[0] & ~closed[1],
        "unknown": is_common & ~unknown[0] & unknown[1],
        "known": is_common & unknown[0] & ~unknown[1],
        "rose": is_known & (second > first),
        "fell": is_known & (second < first),
    }


def _costs_on(frame: Frame, costmap: Costmap, scale: codes.CostScale) -> tuple[Bytes, Mask]:
    """Return costs at the centres of a frame's cells on costmap_2d's scale, and where there are."""
    costs = np.asarray(costmap.cost)
    if scale == "occupancy":  # of one costmap at least: both as ROS publishes them
        table = codes.cost_from_occupancy()
        table[codes.INSCRIBED_PUBLISHED] = codes.INSCRIBED_INFLATED_OBSTACLE
        costs = lookup.look_up(np.asarray(costmap.to_occupancy().occupancy), table)
    values, is_inside = canvas.sampled(frame, costs.view(np.int8), costmap.frame)
    return values.view(np.uint8), is_inside


def _change(
    kind: ChangeKind, marked: Mask, first: Bytes, second: Bytes, frame: Frame
) -> CostChange:
    by_size = {}
    if kind in ("rose", "fell"):
        low, high = (first, second) if kind == "rose" else (second, first)
        sizes = np.bincount(high[marked] - low[marked], minlength=256)
        by_size = {f"{least}-{most}": int(sizes[least : most + 1].sum()) for least, most in SIZES}
    largest, regions = Change.largest(kind, marked, frame, MOST_REGIONS)
    count = int(np.count_nonzero(marked))
    return CostChange(kind, count, count * frame.resolution**2, regions, tuple(largest), by_size)
