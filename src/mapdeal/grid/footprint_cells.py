"""The cells that a robot covers when it stands in the middle of a cell, heading by heading."""

from __future__ import annotations

import math
from itertools import pairwise, starmap

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.kernels.polygons import stacked_spans
from mapdeal.kernels.spans import Spans

_ROUNDING = 1e-9
"""Cells within which a corner on the edge between two cells counts as in the upper one, whatever
the cosine and the division did to its last bits."""

_FARTHEST = float(1 << 40)
"""Cells; more than any grid has, and whole numbers still convert."""


def footprint_spans(footprint: Footprint, frame: Frame, heading_count: int) -> tuple[Spans, ...]:
    """Return the cells that a footprint covers in each heading, relative to the robot's cell.

    Notes
    -----
    The robot's centre is the middle of its cell. A corner is in the cell
    ``floor(0.5 + coordinate / resolution)``, and from there on cells are those that costmap_2d
    draws: the lines between the corners, and what is inside (`mapdeal.kernels.polygons`).
    """
    shape = footprint if footprint.vertices else Footprint.sixteen_gon(footprint.radius)
    vertices = np.array(shape.vertices, dtype=np.float64)
    yaw = frame.origin[2]
    turns = [2 * math.pi * k / heading_count - yaw for k in range(heading_count)]
    corners = [_corner_cells(vertices, turn, frame.resolution) for turn in turns]
    fitting = [k for k, cells in enumerate(corners) if _fits(cells, frame)]
    spans = [Spans(cells[:, 0], cells[:, 1], cells[:, 1] + 1) for cells in corners]
    drawn = _drawn([corners[k] for k in fitting]) if fitting else []
    for k, found in zip(fitting, drawn, strict=True):
        spans[k] = found
    return tuple(spans)


def _corner_cells(
    corners: NDArray[np.float64], turn: float, resolution: float
) -> NDArray[np.int64]:
    """Return row and column of each corner's cell, shape (N, 2)."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = corners.T
    turned = np.stack([x * sin + y * cos, x * cos - y * sin], axis=1)
    with np.errstate(over="ignore"):
        cells = np.floor(0.5 + turned / resolution + _ROUNDING)
    return np.clip(cells, -_FARTHEST, _FARTHEST).astype(np.int64)


def _fits(corners: NDArray[np.int64], frame: Frame) -> bool:
    """Return whether a polygon between these cells is no larger than the grid."""
    height, width = (np.ptp(corners, axis=0) + 1).tolist()
    return bool(height <= frame.height and width <= frame.width)


def _drawn(polygons: list[NDArray[np.int64]]) -> list[Spans]:
    """Return the cells of polygons between these cells, each around its own (0, 0).

    They are drawn at once, one above the other.
    """
    least = np.array([cells.min(axis=0) for cells in polygons])
    sizes = np.array([cells.max(axis=0) for cells in polygons]) - least + 1
    tops = np.cumsum(sizes[:, 0])
    shifts = least.copy()
    shifts[:, 0] -= tops - sizes[:, 0]
    rings = [(cells - shift).tolist() for cells, shift in zip(polygons, shifts, strict=True)]
    parts = list(stacked_spans(rings, (int(tops[-1]), int(sizes[:, 1].max()))))
    rows, starts, stops = map(np.concatenate, zip(*parts, strict=True))
    edges = np.searchsorted(rows, [0, *tops.tolist()])
    return [
        Spans(rows[some] + row, starts[some] + col, stops[some] + col)
        for some, (row, col) in zip(starmap(slice, pairwise(edges)), shifts.tolist(), strict=True)
    ]
