"""What differs between two costmaps, cell by cell, on costmap_2d's scale."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.compare.difference import Change, ChangeKind, frame_around, geometry_pairs
from mapdeal.grid.canvas import sampled
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    INSCRIBED_PUBLISHED,
    NO_INFORMATION,
    CostScale,
    OneLine,
    cost_from_occupancy,
    count_text,
    decimal_text,
)
from mapdeal.kernels.lookup import look_up

Costs = NDArray[np.uint8]
Mask = NDArray[np.bool_]

SIZES = ((1, 9), (10, 49), (50, 127), (128, 254))
"""Smallest and largest change of the cost in each bin of `CostChange.by_size`."""

MOST_REGIONS = 20


@dataclass(frozen=True, repr=False)
class CostChange(OneLine):
    """Cells of which the cost has changed in one way.

    Parameters
    ----------
    kind : {'rose', 'fell', 'closed', 'opened', 'unknown', 'known'}
        Higher or lower cost in cells known in both costmaps; cells that became closed (253 or 254),
        ceased to be closed, became unknown, ceased to be unknown. A cell that became closed has
        risen, too, unless it was unknown.
    cells : int
        Number of cells.
    area : float
        Their area, square metres.
    regions : int
        Number of connected regions that they form, corners included.
    largest : tuple of Change
        The largest of these, at most 20, each with its area and a place in its middle.
    by_size : dict of int
        For 'rose' and 'fell', number of cells by the size of the change: 1-9, 10-49, 50-127 and
        128-254.
    """

    kind: ChangeKind
    cells: int
    area: float
    regions: int
    largest: tuple[Change, ...]
    by_size: dict[str, int]

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.kind}, {count_text(self.cells, 'cell')}, {decimal_text(self.area)} m2"
        yield count_text(self.regions, "region")


@dataclass(frozen=True, eq=False, repr=False)
class CostDifference(OneLine):
    """Differences between two costmaps, A and B, on costmap_2d's scale.

    Parameters
    ----------
    geometry : dict
        Pairs of values for each of width, height, resolution and origin that differs.
    scale : {'costmap2d', 'occupancy'}
        ``occupancy`` if either costmap has this scale: then both are taken as ROS publishes them,
        99 as inscribed and other values times 2.54.
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
    scale: CostScale
    common_cells: int
    differing: int
    not_compared: int
    changes: dict[ChangeKind, CostChange]
    frame: Frame
    first_costs: Costs
    second_costs: Costs
    is_common: Mask
    masks: dict[ChangeKind, Mask]

    @property
    def is_equal(self) -> bool:
        """Whether the costmaps have the same geometry and costs."""
        return not self.geometry and not self.differing

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.differing} of {self.common_cells} common cells differ"
        yield from (f"{kind} {change.cells}" for kind, change in self.changes.items())


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
    scale: CostScale = "costmap2d" if {first.scale, second.scale} == {"costmap2d"} else "occupancy"
    a, in_first = _costs_on(frame, first, scale)
    b, in_second = _costs_on(frame, second, scale)
    is_common = in_first & in_second
    masks = _masks_of_changes(a, b, is_common)
    return CostDifference(
        geometry=geometry_pairs(first.frame, second.frame), scale=scale,
        common_cells=int(np.count_nonzero(is_common)),
        differing=int(np.count_nonzero(is_common & (a != b))),
        not_compared=int(np.count_nonzero(in_first & ~is_common & (a != NO_INFORMATION))),
        changes={kind: _change(kind, mask, a, b, frame) for kind, mask in masks.items()},
        frame=frame, first_costs=a, second_costs=b, is_common=is_common, masks=masks,
    )  # fmt: skip


def _masks_of_changes(first: Costs, second: Costs, is_common: Mask) -> dict[ChangeKind, Mask]:
    unknown = [costs == NO_INFORMATION for costs in (first, second)]
    closed = [(costs >= INSCRIBED_INFLATED_OBSTACLE) & (costs != NO_INFORMATION)
              for costs in (first, second)]  # fmt: skip
    is_known = is_common & ~unknown[0] & ~unknown[1]
    return {
        "closed": is_common & ~closed[0] & closed[1],
        "opened": is_common & closed[0] & ~closed[1],
        "unknown": is_common & ~unknown[0] & unknown[1],
        "known": is_common & unknown[0] & ~unknown[1],
        "rose": is_known & (second > first),
        "fell": is_known & (second < first),
    }


def _costs_on(frame: Frame, costmap: Costmap, scale: CostScale) -> tuple[Costs, Mask]:
    """Return costs at the centres of a frame's cells on costmap_2d's scale, and where there are."""
    costs = np.asarray(costmap.cost)
    if scale == "occupancy":  # of one costmap at least: both as ROS publishes them
        table = cost_from_occupancy()
        table[INSCRIBED_PUBLISHED] = INSCRIBED_INFLATED_OBSTACLE
        costs = look_up(np.asarray(costmap.to_occupancy().occupancy), table)
    values, is_inside = sampled(frame, costs.view(np.int8), costmap.frame)
    return values.view(np.uint8), is_inside


def _change(
    kind: ChangeKind, marked: Mask, first: Costs, second: Costs, frame: Frame
) -> CostChange:
    by_size = {}
    if kind in ("rose", "fell"):
        low, high = (first, second) if kind == "rose" else (second, first)
        sizes = np.bincount(high[marked] - low[marked], minlength=256)
        by_size = {f"{least}-{most}": int(sizes[least : most + 1].sum()) for least, most in SIZES}
    largest, regions = Change.largest(kind, marked, frame, MOST_REGIONS)
    count = int(np.count_nonzero(marked))
    return CostChange(kind, count, count * frame.resolution**2, regions, tuple(largest), by_size)
