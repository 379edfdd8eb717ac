"""Polygons as lists of corners: edges, crossings, area."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import Point


def checked_corners(
    points: Sequence[Sequence[float]], what: str, *, within: float, least: int, most: int
) -> tuple[Point, ...]:
    """Return `points` as pairs of finite floats."""
    if not isinstance(points, Iterable) or isinstance(points, (str, bytes)):
        raise ParameterError(f"a {what} takes a list of vertices [x, y]", place=what, got=points)
    points = list(points)
    if len(points) > most:
        raise ParameterError(f"a {what} has at most {most} vertices", place=what, got=len(points))
    corners: list[Point] = []
    for index, vertex in enumerate(points):
        place = f"{what} vertex {index + 1}"
        try:
            x, y = (float(v) for v in vertex)
        except (TypeError, ValueError, OverflowError):
            rule = "a vertex must be a pair of numbers [x, y]"
            raise ParameterError(rule, place=place, got=vertex) from None
        if not all(abs(v) <= within for v in (x, y)):  # refuses nan too
            rule = f"coordinates must be finite and within {within:g} m"
            raise ParameterError(rule, place=place, got=(x, y))
        corners.append((x, y))
    if len(corners) < least:
        words = {1: "one vertex", 2: "two vertices", 3: "three vertices"}[least]
        raise ParameterError(f"a {what} needs at least {words}", place=what, got=len(corners))
    return tuple(corners)


def edges_of(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Return the edges of a closed polygon, the one back to the first corner included."""
    return list(pairwise([*points, points[0]]))


def check_simple(points: Sequence[Point], what: str) -> None:
    """Refuse outlines whose edges cross, naming the edge by its first corner."""
    starts = np.array(points, dtype=np.float64)
    ends = np.roll(starts, -1, axis=0)
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    for i in range(len(points) - 1):
        # Most edges are far from each other, which four comparisons tell.
        near = (low[i + 1 :, 0] <= high[i, 0]) & (high[i + 1 :, 0] >= low[i, 0])
        near &= (low[i + 1 :, 1] <= high[i, 1]) & (high[i + 1 :, 1] >= low[i, 1])
        others = i + 1 + np.flatnonzero(near)
        a, b, c, d = starts[i], ends[i], starts[others], ends[others]
        apart = _side(a, b, c) * _side(a, b, d) < 0
        crosses = apart & (_side(c, d, a) * _side(c, d, b) < 0)
        if crosses.any():
            other = int(others[np.argmax(crosses)])
            rule = f"the edge crosses the one that starts at vertex {other + 1}"
            raise ParameterError(rule, place=f"{what} vertex {i + 1}", got=points[i])


def area_of(points: Sequence[Point]) -> float:
    """Return the area of a polygon, square metres, whichever way it goes round.

    Examples
    --------
    >>> area_of([(1, 1), (1, 3), (4, 3), (4, 1)])
    6.0
    """
    corners = np.array(points, dtype=np.float64) - np.array(points[0])
    return abs(float(_cross(corners, np.roll(corners, -1, axis=0)).sum())) / 2


def distance_to_edge(a: Point, b: Point) -> float:
    """Return the distance from (0, 0) to the segment from `a` to `b`."""
    (ax, ay), (bx, by) = a, b
    length_squared = (bx - ax) ** 2 + (by - ay) ** 2
    if length_squared == 0.0:  # a repeated corner; costmap_2d divides by zero here
        return math.hypot(ax, ay)
    along = min(1.0, max(0.0, -(ax * (bx - ax) + ay * (by - ay)) / length_squared))
    return math.hypot(ax + along * (bx - ax), ay + along * (by - ay))


def contains_centre(points: Sequence[Point]) -> bool:
    """Return whether (0, 0) lies in the polygon or on its outline."""
    if min(distance_to_edge(a, b) for a, b in edges_of(points)) == 0.0:
        return True
    inside = False
    for (ax, ay), (bx, by) in edges_of(points):
        if (ay > 0) != (by > 0) and ax + (bx - ax) * (-ay) / (by - ay) > 0:
            inside = not inside
    return inside


def is_number(value: object) -> bool:
    """Return whether a value is a number, nan and infinity included."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _side(
    a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return on which side of the line through `a` and `b` a point lies: -1, 1, or 0 on it.

    Decimal coordinates that touch on paper are apart by their rounding, and count as touching.
    """
    along, beside = b - a, p - a
    rounding = 8 * np.finfo(np.float64).eps * np.maximum(np.abs(a), np.maximum(abs(b), abs(p)))
    slack = _near_product(along, rounding) + _near_product(rounding, beside)
    cross = _cross(along, beside)
    sign: NDArray[np.float64] = np.where(np.abs(cross) <= slack, 0.0, np.sign(cross))
    return sign


def _near_product(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = np.abs(u[..., 0] * v[..., 1]) + np.abs(u[..., 1] * v[..., 0])
    return product


def _cross(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    crossed: NDArray[np.float64] = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return crossed
