"""Route graphs, as Nav2's route server follows them, and whether a robot can drive along them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import pairwise, starmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid import costmap, footprint, frame as frames
from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE, NO_INFORMATION, OneLineRepr, count_text
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.kernels.lookup import least_along, places_along
from mapdeal.records import dataclass, field

_SAMPLES = 1 << 16  # positions that are checked at once; arrays of twice as many fit in the cache
_STEP = 0.5  # of a cell
_NEAR_EDGE = 2.5e-3  # of a cell: more than the rounding of coordinates
_ROUNDING = 1e-6  # metres
_CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])  # of a cell
_SLACK = 1.5
"""Cells by which a footprint may touch beyond its radius: half the diagonals of a touched cell and
of the centre's cell."""


@dataclass(frozen=True, eq=False)
class RouteNode:
    """A place of a route graph.

    Parameters
    ----------
    id : int
        Its number, unique over the nodes and edges of a graph.
    x, y : float
        Position in `frame`, metres.
    frame : str
        Name of the frame of the coordinates.
    metadata : mapping
        Further values; generated nodes have ``kind``, ``name`` of a goal, ``width`` of a door in
        metres.
    """

    id: int
    x: float
    y: float
    frame: str = "map"
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RouteEdge:
    """A directed, straight edge of a route graph.

    Parameters
    ----------
    id : int
        Its number, unique over the nodes and edges of a graph.
    start, end : int
        Ids of the nodes that it leads from and to.
    cost : float
        Its cost, if no scorer may change it.
    overridable : bool
        Whether scorers may change the cost.
    metadata : mapping
        Further values; generated edges have ``length``, ``min_clearance`` and ``door_width`` in
        metres, ``speed_limit`` in percent.
    """

    id: int
    start: int
    end: int
    cost: float = 0.0
    overridable: bool = True
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class RouteGraph(OneLineRepr):
    """Nodes and directed edges between them.

    Parameters
    ----------
    nodes : tuple of RouteNode
        The nodes.
    edges : tuple of RouteEdge
        The edges; both ends of each are among the nodes.
    """

    nodes: tuple[RouteNode, ...]
    edges: tuple[RouteEdge, ...]

    def _repr_parts(self) -> Iterator[str]:
        yield count_text(len(self.nodes), "node")
        yield count_text(len(self.edges), "edge")

    @cached_property
    def points_xy(self) -> NDArray[np.float64]:
        """Positions of the nodes, metres, shape (N, 2)."""
        return np.array([(node.x, node.y) for node in self.nodes], dtype=np.float64).reshape(-1, 2)

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """Indices of the nodes that each edge joins, shape (M, 2)."""
        index = {node.id: number for number, node in enumerate(self.nodes)}
        ends = [(index[edge.start], index[edge.end]) for edge in self.edges]
        return np.array(ends, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths of the edges, metres, shape (M,)."""
        starts, ends = self.points_xy[self.ends[:, 0]], self.points_xy[self.ends[:, 1]]
        return np.asarray(np.hypot(*(ends - starts).T), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Test of whether a robot can drive along lines, by its centre and its footprint."""

    is_open: NDArray[np.bool_]  # cells that the robot's centre may be in
    closed: NDArray[np.uint8]  # costs of costmap_2d: 254 in obstacles, 255 in unknown cells
    squared: NDArray[Any]  # to the nearest cell that is not free, in cells; below 0 counts as 0
    frame: frames.Frame
    robot: footprint.Footprint | None  # None for a point

    @cached_property
    def _costmap(self) -> costmap.Costmap:
        return costmap.Costmap(self.closed, self.frame.resolution, self.frame.origin)

    def along(
        self, starts: Floats, ends: Floats, *, touches: bool = True, step: float = _STEP
    ) -> tuple[Mask, Floats]:
        """Return whether lines can be driven both ways, and their least clearances in cells."""
        # Lines are given by continuous rows and columns, shape (N, 2) each. The robot looks along
        # its line, and is tried at every `step`, in cells: its centre must be in an open cell, and
        # with `touches` its footprint must be free by Nav2's collision checker.
        if not len(starts):
            return np.zeros(0, dtype=np.bool_), np.zeros(0)
        counts = np.ceil(np.hypot(*(ends - starts).T) / step).astype(np.int64) + 1
        size = np.array(self.is_open.shape)
        first, last = (np.clip(points, 0, size - _ROUNDING) for points in (starts, ends))
        off = np.maximum(np.abs(starts - first), np.abs(ends - last))
        is_inside = (off <= _NEAR_EDGE).all(axis=1)
        is_clear, least = np.empty(len(starts), dtype=np.bool_), np.empty(len(starts))
        for part in _parts(counts):
            squares, is_clear[part] = least_along(
                self.squared, self.is_open, first[part], last[part], counts[part], near=_NEAR_EDGE
            )
            least[part] = np.sqrt(np.maximum(squares, 0))
        is_clear &= is_inside
        if touches and self.robot is not None:
            reach = self.robot.circumscribed_radius / self.frame.resolution + _SLACK
            tight = np.flatnonzero(is_clear & (least < reach))
            for part in _parts(counts[tight]):
                lines = tight[part]
                is_clear[lines] = self._fits(first[lines], last[lines], counts[lines], reach)
        return is_clear, least * is_inside

    def distance_to(self, cost: int, start: Floats, end: Floats, reach: float) -> float:
        """Return the exact distance of a line to the squares of cells of a cost within a reach."""
        low = np.maximum(np.minimum(start, end) - reach - 1, 0).astype(np.int64)
        high = (np.maximum(start, end) + reach).astype(np.int64) + 1
        squares = np.argwhere(self.closed[low[0] : high[0], low[1] : high[1]] == cost) + low
        along = end - start
        corners = (squares[:, np.newaxis] + _CORNERS).reshape(-1, 2)
        shares = np.sum((corners - start) * along, axis=-1) / max(np.sum(along**2), _ROUNDING)
        shares = np.clip(shares, 0, 1)
        gaps = [corners - start - shares[:, np.newaxis] * along]
        tips = np.array([[start], [end]])
        gaps += [*np.maximum(np.maximum(squares - tips, tips - squares - 1), 0)]
        return float(np.hypot(*np.concatenate(gaps).T).min(initial=np.inf))

    def worst_place(self, start: Floats, end: Floats, *, touches: bool) -> Floats:
        """Return the place with the least clearance on a line that the robot cannot pass."""
        count = math.ceil(float(np.hypot(*(end - start))) / _STEP) + 1
        places = start + np.linspace(0, 1, count)[:, np.newaxis] * (end - start)
        # short pieces, so that the robot looks along the line in each
        is_free, least = self.along(places[:-1], places[1:], touches=touches)
        return np.asarray(places[np.where(is_free, np.inf, least).argmin()])

    def _fits(self, starts: Floats, ends: Floats, counts: Integers, reach: float) -> Mask:
        """Return which lines are free for the footprint, tested only near obstacles."""
        places, lines, firsts = places_along(starts, ends, counts)
        rows, cols = places.astype(np.int64).T
        tight = np.flatnonzero(self.squared[rows, cols] < reach * reach)
        directions = self.frame.xy_vectors_from_rowcol((ends - starts)[lines[tight]])
        places_xy = self.frame.xy_from_continuous_rowcol(places[tight])
        is_free = np.ones(len(places), dtype=np.bool_)
        is_free[tight] = self._is_free(places_xy, np.arctan2(directions[:, 1], directions[:, 0]))
        return np.asarray(np.logical_and.reduceat(is_free, firsts), dtype=np.bool_)

    def _is_free(self, places_xy: Floats, yaws: Floats) -> Mask:
        """Return where the robot is free in both directions of a line."""
        # Unknown cells count only for robots with corners. Rounding may put a corner into either of
        # two cells, so both must be free: the padded shape tests the outer ones.
        robot = self.robot
        is_free = np.ones(len(yaws), dtype=np.bool_)
        if robot is None:
            return is_free
        for turn in (0.0, math.pi) if robot.vertices else (0.0,):
            poses = np.column_stack([places_xy, yaws + turn])
            for shape in (robot, robot.padded(_ROUNDING)):
                costs, _ = footprint.sample_poses(self._costmap, shape, poses)
                is_free &= (costs == FREE_SPACE) if robot.vertices else (costs != LETHAL_OBSTACLE)
        return is_free


def _parts(counts: NDArray[np.int64]) -> Iterator[slice]:
    """Yield slices of lines, each of fewer than `_SAMPLES` places besides its first line."""
    groups = np.cumsum(counts) // _SAMPLES
    bounds = [*np.flatnonzero(np.diff(groups, prepend=-1)).tolist(), len(counts)]
    yield from starmap(slice, pairwise(bounds))


def closed_costs(occupied: NDArray[np.bool_], unknown: NDArray[np.bool_]) -> NDArray[np.uint8]:
    costs = np.full(occupied.shape, FREE_SPACE, dtype=np.uint8)
    costs[unknown] = NO_INFORMATION
    costs[occupied] = LETHAL_OBSTACLE
    return costs
