"""Lengths, coordinates and cells: what they may be, and how they are rounded."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError

CELL_TOLERANCE = 1e-9
"""In cells. Lengths that are exact multiples of the resolution on paper may come out of a
division one part in 1e16 short or long; the tolerance keeps them on their cell."""

RADIUS_TOLERANCE = 1e-9
"""In metres: a cell whose centre lies exactly at the radius, on paper, lies within it. Products
such as 6 * 0.05 and 0.3 differ in their last bits."""

Origin = tuple[float, float, float]
Point = tuple[float, float]

# Far beyond any robot; inside of them no product of lengths and cells overflows.
_SMALLEST_CELL, _LARGEST_CELL = 1e-6, 1e6
FARTHEST = 1e12
"""Largest coordinate and length, metres."""


def as_float32(value: float) -> float:
    """Return a number as messages of ROS carry it, in 32 bits; infinity if it is too large.

    Examples
    --------
    >>> as_float32(0.05), as_float32(1e300)
    (0.05000000074505806, inf)
    """
    with np.errstate(over="ignore"):
        return float(np.float32(value))


def cells_to_cover(length: float, resolution: float) -> int:
    """Return how many cells it takes to cover `length` metres, exact multiples exactly."""
    return math.ceil(length / resolution - CELL_TOLERANCE)


def largest_square_within(radius: float, resolution: float) -> int:
    """Return the largest whole number s with sqrt(s) * resolution <= radius, exact ones exactly.

    Examples
    --------
    >>> largest_square_within(0.3, 0.1), largest_square_within(0.25, 0.1)
    (9, 6)
    """
    bound = radius + RADIUS_TOLERANCE
    square = math.floor((bound / resolution) ** 2)
    while math.sqrt(square + 1) * resolution <= bound:
        square += 1
    while square > 0 and math.sqrt(square) * resolution > bound:
        square -= 1
    return square


def check_resolution(resolution: float) -> float:
    """Return `resolution` as a float; it must be a length that a cell can have."""
    value = float(resolution)
    if not _SMALLEST_CELL <= value <= _LARGEST_CELL:  # refuses nan too
        rule = f"resolution must lie between {_SMALLEST_CELL:g} and {_LARGEST_CELL:g} m"
        raise ParameterError(rule, got=resolution)
    return value


def check_origin(origin: Sequence[float]) -> Origin:
    """Return `origin` as a tuple (x, y, yaw) of finite floats."""
    values = tuple(float(v) for v in origin)
    if len(values) != 3 or not all(abs(value) <= FARTHEST for value in values):
        rule = f"origin must be three numbers x, y, yaw within {FARTHEST:g}"
        raise ParameterError(rule, got=tuple(origin))
    return values[0], values[1], values[2]


def check_point(point: Sequence[float], name: str) -> Point:
    """Return `point` as two finite floats x, y; an error calls it `name`."""
    try:
        x, y = (float(value) for value in point)
    except (TypeError, ValueError):
        raise ParameterError("must be two numbers x, y", place=name, got=point) from None
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST):  # refuses nan too
        rule = f"must be two numbers x, y within {FARTHEST:g} m"
        raise ParameterError(rule, place=name, got=(x, y))
    return x, y


def turned(vectors_xy: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return vectors, shape (N, 2), turned anticlockwise by an angle, radians."""
    cos, sin = math.cos(angle), math.sin(angle)
    # not a product of matrices, whose rounding depends on how many vectors there are
    x, y = vectors_xy[:, 0], vectors_xy[:, 1]
    result = np.empty_like(vectors_xy)
    result[:, 0] = x * cos - y * sin
    result[:, 1] = x * sin + y * cos
    return result


def cells_at(
    places_rowcol: ArrayLike, tolerance: ArrayLike = CELL_TOLERANCE
) -> NDArray[np.int64]:  # fmt: skip
    """Return the cells that continuous cell coordinates lie in, exact multiples exactly."""
    return np.floor(np.asarray(places_rowcol) + tolerance).astype(np.int64)
