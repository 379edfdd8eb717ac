"""Resampling of one grid to the cells of another, without losing obstacles."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal, NamedTuple, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame, Region
from mapdeal.grid.framed import ValueGrid
from mapdeal.kernels.overlaps import TOUCHING, Lattice, largest_under, nearest_under
from mapdeal.kernels.threads import for_rows

ResamplingRule = Literal["area", "nearest"]
"""How cells get their values: the largest that they overlap, or the one at their centre."""

Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
V = TypeVar("V", bound=ValueGrid)


def resampled(grid: V, frame: Frame, *, rule: ResamplingRule = "area") -> V:
    """Resample a map or costmap to the cells of another frame."""
    check_rule(rule)
    check_values(grid)
    part = _under(frame, grid.values, grid.frame)
    values = np.full(frame.shape, grid.unknown_value, dtype=grid.values.dtype)
    if part is not None:
        found, inside = nearest_under(part.values, frame.shape, part.lattice)
        np.copyto(values.view(np.uint8), found, where=inside)
        del found, inside
        if rule == "area":
            # of both scales unknown, -1 or 255, becomes 0 as free is: 1 is added to all others
            above = part.values + np.uint8(1)
            above[above == 1] = 0
            largest = largest_under(above, frame.shape, part.lattice)
            np.subtract(largest, 1, out=values.view(np.uint8), where=largest > 0)
    layers: dict[str, Any] = {grid.layer_names[0]: values}
    like_any: Any = grid
    made: V = replace(like_any, resolution=frame.resolution, origin=frame.origin, **layers)
    return made


def check_rule(rule: str) -> None:
    if rule not in get_args(ResamplingRule):
        known = ", ".join(get_args(ResamplingRule))
        raise ParameterError(f"must be one of {known}", place="rule", got=rule)


def check_values(grid: object) -> None:
    """Refuse a grid that is neither a map nor a costmap."""
    if not isinstance(grid, ValueGrid):
        rule, hint = "must be a map or a costmap", "edit the map, then run esdf or potential on it"
        raise ParameterError(rule, place="grid", got=type(grid).__name__, hint=hint)


def obstacles_in(frame: Frame, obstacles: Mask, source: Frame) -> Mask:
    """Return which cells of a frame overlap an obstacle of a grid with another frame."""
    return _largest(frame, obstacles.view(np.uint8), source).view(np.bool_)


def wholly_in(frame: Frame, cells: Mask, source: Frame) -> Mask:
    if region_on_lattice(source, frame) is not None:
        return obstacles_in(frame, cells, source)
    return _inside(frame, source) & ~obstacles_in(frame, ~cells, source)


def sampled(frame: Frame, values: NDArray[np.int8], source: Frame) -> tuple[NDArray[np.int8], Mask]:
    """Return the values of a grid at the centres of another frame's cells, and where it has any.

    Examples
    --------
    >>> values, inside = sampled(Frame(1, 3, 0.5), np.array([[7, 9]], np.int8), Frame(1, 2, 0.6))
    >>> values.tolist(), inside.tolist()
    ([[7, 9, 0]], [[True, True, False]])
    """
    part = _under(frame, values.view(np.uint8), source)
    if part is None:
        return np.zeros(frame.shape, np.int8), np.zeros(frame.shape, np.bool_)
    found, inside = nearest_under(part.values, frame.shape, part.lattice)
    return found.view(np.int8), inside


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
    tolerance = max(TOUCHING, lattice.tolerance_at([frame.origin[:2]])[0, 0])
    if np.abs(corner - (row, col)).max() > tolerance:
        return None
    return Region(int(row), int(col), *frame.shape)


def is_turned(frame: Frame, yaw: float = 0.0) -> bool:
    """Return whether a grid's axes differ from a yaw by so much that its cells show it."""
    turn = math.remainder(frame.origin[2] - yaw, 2 * math.pi)
    return abs(turn) * max(frame.shape) > TOUCHING


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


class _Part(NamedTuple):
    """The cells of a grid that lie under a frame, turned by quarter turns toward its axes."""

    values: Bytes
    lattice: Lattice


def _under(frame: Frame, values: NDArray[Any], source: Frame) -> _Part | None:
    """Return where a frame's cells lie in a grid of bytes, None if it lies beside the grid."""
    rows, cols = rows_and_cols_under(frame, source)
    if rows.start >= rows.stop or cols.start >= cols.stop:
        return None
    some = np.asarray(values[rows])[:, cols].view(np.uint8)
    part = source.window(rows.start, cols.start, *some.shape)
    turn = math.remainder(frame.origin[2] - part.origin[2], 2 * math.pi)
    quarters = round(turn / (math.pi / 2))
    part, some = _quartered(part, quarters), np.rot90(some, quarters)
    turn = math.remainder(frame.origin[2] - part.origin[2], 2 * math.pi)
    side = frame.resolution / part.resolution
    if abs(turn) * max(*part.shape, *(side * count for count in frame.shape)) <= TOUCHING:
        turn = 0.0
    corner = [frame.origin[:2]]
    row, col = part.continuous_rowcol_from_xy(corner)[0].tolist()
    slack = float(part.tolerance_at(corner)[0, 0])
    return _Part(some, Lattice(row, col, side, turn, slack))


def _quartered(frame: Frame, quarters: int) -> Frame:
    """Return the frame of the same cells after ``np.rot90`` of them, by so many quarter turns."""
    height, width = frame.shape
    corners = [(0, 0), (0, width), (height, width), (height, 0)]
    if quarters % 4 == 0:
        return frame
    x, y = frame.xy_from_continuous_rowcol([corners[quarters % 4]])[0].tolist()
    yaw = frame.origin[2] + quarters * math.pi / 2
    shape = frame.shape if quarters % 2 == 0 else (width, height)
    return Frame(*shape, frame.resolution, (x, y, yaw))


def _inside(frame: Frame, source: Frame) -> Mask:
    """Return which cells of a frame reach nowhere beyond a grid: those whose corners do not."""
    found = np.zeros(frame.shape, dtype=np.bool_)

    def look(part: slice) -> None:
        rows, cols = np.arange(part.start, part.stop + 1), np.arange(frame.width + 1)
        corners = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
        places = source.continuous_rowcol_from_xy(frame.xy_from_continuous_rowcol(corners))
        within = ((places >= -TOUCHING) & (places <= np.add(source.shape, TOUCHING))).all(axis=1)
        held = within.reshape(len(rows), -1)
        found[part] = held[:-1, :-1] & held[1:, :-1] & held[:-1, 1:] & held[1:, 1:]

    for_rows(look, frame.shape)
    return found


def _largest(frame: Frame, values: Bytes, source: Frame) -> Bytes:
    """Return the largest value that each cell of a frame overlaps; 0 where a grid has none."""
    part = _under(frame, values, source)
    if part is None:
        return np.zeros(frame.shape, dtype=np.uint8)
    return largest_under(part.values, frame.shape, part.lattice)


def _corners(frame: Frame) -> list[list[int]]:
    return [[row, col] for row in (0, frame.height) for col in (0, frame.width)]
