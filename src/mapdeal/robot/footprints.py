"""Polygons of costmap_2d: read from a text, of a radius, padded, and their radii.

The same in ROS 1 and Nav2, to the last bit.

References
----------
array_parser.cpp, footprint.cpp and costmap_math.cpp of costmap_2d and nav2_costmap_2d.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import as_float32
from mapdeal.grid.outline import check_simple, contains_centre

Corners = tuple[tuple[float, float], ...]

MOST_CORNERS = 2000
"""Corners that a robot may have: looking for edges that cross takes the time of their square."""

_DIGITS = frozenset("0123456789")
_C_SPACES = frozenset(" \t\n\v\f\r")


class FootprintStringError(ValueError):
    """Why ``parseVVF`` or ``makeFootprintFromString`` takes no footprint from a text."""


def corners_of_string(text: str) -> Corners:
    """Return the corners that a text has, each coordinate a float32.

    Notes
    -----
    Numbers are read as a C++ stream reads them: ``0.3-0.2`` is two numbers, and behind ``0.3m``
    nothing is read any more. An end of a line is a blank to it, but only within the inner
    brackets.
    """
    groups: list[list[float]] = []
    current: list[float] = []
    depth, at = 0, 0
    while at < len(text):
        char = text[at]
        if char == "[":
            depth += 1
            current = []
            if depth > 2:
                raise FootprintStringError("brackets are nested deeper than two")
        elif char == "]":
            depth -= 1
            if depth < 0:
                raise FootprintStringError("more closing than opening brackets")
            if depth == 1:
                groups.append(current)
        elif char not in ", \t":
            if depth != 2:
                raise FootprintStringError(f"{char!r} stands outside the inner brackets")
            value, at = _number_at(text, at)
            current.append(value)
            continue
        at += 1
    if depth:
        raise FootprintStringError("a bracket is not closed")
    if len(groups) < 3:
        raise FootprintStringError(f"a footprint needs three points or more, has {len(groups)}")
    if any(len(group) != 2 for group in groups):
        raise FootprintStringError("points must be pairs of numbers")
    return tuple((x, y) for x, y in groups)


def _number_at(text: str, at: int) -> tuple[float, int]:
    """Return the number that a stream of C++ reads at a place, and where it stops."""
    start = at
    while start < len(text) and text[start] in _C_SPACES:
        start += 1
    end = _end_of_number(text, start)
    try:
        value = float(text[start:end])
    except ValueError:  # what is accepted bit by bit may be no number in the end, as "1e"
        word = text[start : max(end, start + 1) + 9].split("]")[0].split(",")[0].strip()
        raise FootprintStringError(f"{word!r} is not a number") from None
    single = as_float32(value)
    if math.isinf(single):
        raise FootprintStringError(f"{text[start:end][:20]!r} is too large")
    return single, end


def _end_of_number(text: str, at: int) -> int:
    """Return where characters end that a number can have, at most one point and one e."""
    has_digit = has_point = has_exponent = False
    before = ""
    while at < len(text):
        char = text[at]
        if char in _DIGITS:
            has_digit = True
        elif char in "+-":
            if before and before not in "eE":
                break
        elif char == "." and not has_point and not has_exponent:
            has_point = True
        elif char in "eE" and has_digit and not has_exponent:
            has_exponent = True
        else:
            break
        before = char
        at += 1
    return at


def sixteen_corners(radius: float) -> Corners:
    """Return the corners of a round robot, as ``makeFootprintFromRadius``."""
    angles = [index * 2 * math.pi / 16 for index in range(16)]
    return tuple((math.cos(a) * radius, math.sin(a) * radius) for a in angles)


def padded_corners(corners: Corners, padding: float) -> Corners:
    """Return the corners moved outwards, each coordinate by its own sign, as ``padFootprint``."""

    def pad(v: float) -> float:
        return v + (-1.0 if v < 0 else 1.0 if v > 0 else 0.0) * padding

    return tuple((pad(x), pad(y)) for x, y in corners)


def radii_of(corners: Corners) -> tuple[float, float]:
    """Return inscribed and circumscribed radius, as ``calculateMinAndMaxDistances``."""
    least, most = math.inf, 0.0
    for first, second in zip(corners, (*corners[1:], corners[0]), strict=True):
        # numpy's hypot is that of C, which Python's own is not
        edge = float(np.hypot(*_nearest_to_centre(first, second)))
        corner = float(np.hypot(*first))
        least, most = min(least, edge, corner), max(most, edge, corner)
    return least, most


def up_to_millimetres(radius: float) -> str:
    """Return a radius for a hint, rounded up to millimetres.

    Examples
    --------
    >>> up_to_millimetres(0.22549849949589046)
    '0.226'
    """
    scaled = radius * 1000
    return f"{math.ceil(scaled) / 1000 if math.isfinite(scaled) else radius:g}"


def _nearest_to_centre(
    first: tuple[float, float], second: tuple[float, float]
) -> tuple[float, float]:
    """Return the point of an edge that is nearest to (0, 0), as ``distanceToLine`` finds it."""
    (x0, y0), (x1, y1) = first, second
    c, d = x1 - x0, y1 - y0
    square = c * c + d * d
    share = (-x0 * c + -y0 * d) / square if square else 0.0
    if share < 0:
        return first
    if share > 1:
        return second
    return x0 + share * c, y0 + share * d


def oddities_of(corners: Corners) -> Iterator[str]:
    """Yield what makes radii and costs of a polygon mean little; costmap_2d looks at neither."""
    try:
        check_simple(corners, "footprint")
    except ParameterError as error:
        yield f"the outline crosses itself ({error.place}: {error.rule})"
    if not contains_centre(corners):
        yield "the robot's centre (0, 0) lies outside of the outline"
