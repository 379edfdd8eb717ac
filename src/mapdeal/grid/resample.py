"""Obstacles of one grid in the cells of another, none lost."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.region import Region
from mapdeal.kernels.threads import for_rows

_TOUCHING = 1e-6
"""In cells. Cells that overlap by less only touch: their borders are the same on paper."""

_TOGETHER = 1 << 16

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def obstacles_in(frame: Frame, obstacles: Mask, source: Frame) -> Mask:
    """Return which cells of a frame overlap an obstacle of a grid with another frame.

    Parameters
    ----------
    frame : Frame
        The cells to be told of.
    obstacles : numpy.ndarray of bool, shape (H, W)
        The obstacle cells of the other grid.
    source : Frame
        Where that grid lies; resolution, corner and yaw may be any.

    Returns
    -------
    numpy.ndarray of bool, shape of `frame`
        Where a cell and an obstacle share an area, however small: every point of an obstacle
        lies in a cell that is set, so that no wall is lost and no gap opens in one. A cell that
        is set may reach beyond its obstacle by less than a cell. Where both lattices are the
        same this is a copy.

    Examples
    --------
    >>> wall = np.array([[False, True, False]])
    >>> obstacles_in(Frame(1, 7, 0.5), wall, Frame(1, 3, 1.0)).tolist()
    [[False, False, True, True, False, False, False]]
    >>> obstacles_in(Frame(1, 3, 1.0), wall, Frame(1, 3, 1.0, (0.25, 0.0, 0.0))).tolist()
    [[False, True, True]]
    """
    found = np.zeros(frame.shape, dtype=np.bool_)
    region = region_on_lattice(source, frame)
    if region is not None:
        rows, cols = region.shared_with(source.shape)
        if rows.start < rows.stop and cols.start < cols.stop:
            found[region.place_of(rows, cols)] = obstacles[rows, cols]
        return found
    rows, cols = rows_and_cols_under(frame, source)
    if source.resolution >= frame.resolution:
        _look_up(found, frame, obstacles, source, rows, cols)
    else:
        _mark(found, frame, obstacles, source, rows, cols)
    return found


def wholly_in(frame: Frame, cells: Mask, source: Frame) -> Mask:
    """Return which cells of a frame lie, with all of their area, in cells of a grid that are set.

    Parameters
    ----------
    frame : Frame
        The cells to be told of.
    cells : numpy.ndarray of bool, shape (H, W)
        The cells of the other grid.
    source : Frame
        Where that grid lies; resolution, corner and yaw may be any.

    Returns
    -------
    numpy.ndarray of bool, shape of `frame`
        Where a cell shares no area with a cell that is not set, and does not reach beyond the
        grid. Where both lattices are the same this is a copy.

    Examples
    --------
    >>> known = np.array([[True, True, False]])
    >>> wholly_in(Frame(1, 3, 0.8), known, Frame(1, 3, 1.0)).tolist()
    [[True, True, False]]
    >>> wholly_in(Frame(1, 2, 1.0), known, Frame(1, 3, 1.0, (0.25, 0.0, 0.0))).tolist()
    [[False, True]]
    """
    if region_on_lattice(source, frame) is not None:
        return obstacles_in(frame, cells, source)
    return _inside(frame, source) & ~obstacles_in(frame, ~cells, source)


def sampled(frame: Frame, values: NDArray[np.int8], source: Frame) -> tuple[NDArray[np.int8], Mask]:
    """Return the values of a grid at the centres of another frame's cells, and where it has any.

    Parameters
    ----------
    frame : Frame
        Whose cells.
    values : numpy.ndarray of int8, shape (H, W)
        Of the grid.
    source : Frame
        Where the grid lies; resolution, corner and yaw may be any.

    Returns
    -------
    values : numpy.ndarray of int8, shape of `frame`
        0 where the grid has no cell.
    inside : numpy.ndarray of bool, shape of `frame`
        Where it has one.

    Examples
    --------
    >>> values, inside = sampled(Frame(1, 3, 0.5), np.array([[7, 9]], np.int8), Frame(1, 2, 0.6))
    >>> values.tolist(), inside.tolist()
    ([[7, 9, 0]], [[True, True, False]])
    """
    found = np.zeros(frame.shape, dtype=np.int8)
    inside = np.zeros(frame.shape, dtype=np.bool_)
    region = region_on_lattice(source, frame)
    if region is not None:
        rows, cols = region.shared_with(source.shape)
        if rows.start < rows.stop and cols.start < cols.stop:
            place = region.place_of(rows, cols)
            found[place], inside[place] = values[rows, cols], True
        return found, inside

    def look(part: slice) -> None:
        numbers = np.arange(part.start, part.stop)
        cells = np.stack(np.meshgrid(numbers, np.arange(frame.width), indexing="ij"), axis=-1)
        centres = frame.xy_from_rowcol(cells.reshape(-1, 2))
        hit, within = source.bounded_rowcol_from_xy(centres)
        row, col = hit.T
        part_values = np.where(within, values[row, col], np.int8(0))
        found[part] = part_values.reshape(-1, frame.width)
        inside[part] = within.reshape(-1, frame.width)

    for_rows(look, frame.shape)
    return found, inside


def region_on_lattice(lattice: Frame, frame: Frame) -> Region | None:
    """Return a frame's cells as cells of a lattice, or None if their borders are not the same.

    Examples
    --------
    >>> region_on_lattice(Frame(4, 9, 0.1, (0.3, 0.0, 0.0)), Frame(2, 3, 0.1, (0.0, 0.2, 0.0)))
    Region(row=2, col=-3, height=2, width=3)
    """
    if frame.resolution != lattice.resolution or is_turned(lattice, frame.origin[2]):
        return None
    corner = lattice.continuous_rowcol_from_xy([frame.origin[:2]])[0]
    row, col = np.rint(corner)
    tolerance = max(_TOUCHING, lattice.tolerance_at([frame.origin[:2]])[0, 0])
    if np.abs(corner - (row, col)).max() > tolerance:
        return None
    return Region(int(row), int(col), *frame.shape)


def is_turned(frame: Frame, yaw: float = 0.0) -> bool:
    """Return whether a grid's axes differ from a yaw by so much that its cells show it."""
    turn = math.remainder(frame.origin[2] - yaw, 2 * math.pi)
    return abs(turn) * max(frame.shape) > _TOUCHING


def frames_overlap(one: Frame, other: Frame) -> bool:
    """Return whether two grids share an area: no line along a side of one parts them.

    Examples
    --------
    >>> frames_overlap(Frame(2, 2, 1.0), Frame(2, 2, 1.0, (2.2, 1.0, 0.8)))
    True
    >>> frames_overlap(Frame(2, 2, 1.0), Frame(2, 2, 1.0, (2.2, 1.9, 0.8)))
    False
    """
    for frame, source in ((one, other), (other, one)):
        places = source.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(_corners(frame)))
        if (places.max(axis=0) <= 0).any() or (places.min(axis=0) >= source.shape).any():
            return False
    return True


def rows_and_cols_under(frame: Frame, source: Frame) -> tuple[slice, slice]:
    """Return rows and columns of a grid, outside of which none of its cells overlaps a frame."""
    places = source.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(_corners(frame)))
    first = np.clip(np.floor(places.min(axis=0)) - 1, 0, source.shape).astype(int)
    last = np.clip(np.ceil(places.max(axis=0)) + 1, 0, source.shape).astype(int)
    return slice(first[0], last[0]), slice(first[1], last[1])


def _inside(frame: Frame, source: Frame) -> Mask:
    """Return which cells of a frame reach nowhere beyond a grid: those whose corners do not."""
    found = np.zeros(frame.shape, dtype=np.bool_)

    def look(part: slice) -> None:
        rows, cols = np.arange(part.start, part.stop + 1), np.arange(frame.width + 1)
        corners = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
        places = source.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
        within = ((places >= -_TOUCHING) & (places <= np.add(source.shape, _TOUCHING))).all(axis=1)
        held = within.reshape(len(rows), -1)
        found[part] = held[:-1, :-1] & held[1:, :-1] & held[:-1, 1:] & held[1:, 1:]

    for_rows(look, frame.shape)
    return found


def _corners(frame: Frame) -> list[list[int]]:
    return [[row, col] for row in (0, frame.height) for col in (0, frame.width)]


def _look_up(
    found: Mask, frame: Frame, obstacles: Mask, source: Frame, rows: slice, cols: slice
) -> None:
    """Set the cells, each at most as large as those of the source, that overlap an obstacle."""
    if not obstacles[rows, cols].any():
        return

    def look(part: slice) -> None:
        numbers = np.arange(part.start, part.stop)
        cells = np.stack(np.meshgrid(numbers, np.arange(frame.width), indexing="ij"), axis=-1)
        hit = np.zeros(cells.shape[0] * cells.shape[1], dtype=np.bool_)
        for which, row, col in _overlapping(cells.reshape(-1, 2), frame, source):
            hit[which] |= obstacles[row, col]
        found[part] = hit.reshape(-1, frame.width)

    for_rows(look, frame.shape)


def _mark(
    found: Mask, frame: Frame, obstacles: Mask, source: Frame, rows: slice, cols: slice
) -> None:
    """Set the cells that obstacles, all smaller than a cell, overlap."""
    together = max(1, _TOGETHER // max(1, cols.stop - cols.start))
    for first in range(rows.start, rows.stop, together):
        some = slice(first, min(first + together, rows.stop))
        marked = np.argwhere(obstacles[some, cols]) + np.array([some.start, cols.start])
        for _, row, col in _overlapping(marked, source, frame):
            found[row, col] = True


def _overlapping(
    cells: Indices, small: Frame, large: Frame
) -> Iterator[tuple[Indices, Indices, Indices]]:
    """Yield pairs that overlap: index of a small cell, row and column of a large one.

    Two squares overlap unless a line along a side of one of them parts them.
    """
    centres = large.continuous_rowcol_from_xy(small.xy_from_rowcol(cells))
    base = np.floor(centres).astype(np.int64)
    half = small.resolution / large.resolution / 2
    turn = small.origin[2] - large.origin[2]
    cos, sin = math.cos(turn), math.sin(turn)
    wide = abs(cos) + abs(sin)
    # In cells of the large grid, of which a small cell, even turned, reaches the next at most.
    along, across = 0.5 + half * wide - _TOUCHING, half + 0.5 * wide - _TOUCHING
    for step in product((-1, 0, 1), repeat=2):
        row, col = (base + step).T
        y, x = (base + step + 0.5 - centres).T
        overlap = (np.abs(x) < along) & (np.abs(y) < along)
        overlap &= np.abs(x * cos + y * sin) < across
        overlap &= np.abs(y * cos - x * sin) < across
        overlap &= (row >= 0) & (row < large.height) & (col >= 0) & (col < large.width)
        which = np.flatnonzero(overlap)
        yield which, row[which], col[which]
