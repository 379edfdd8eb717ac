"""Polygons of costmap_2d: read from a string, of a radius, padded, and their radii."""

from __future__ import annotations

import math

import numpy as np

_LARGEST = 3.4028234663852886e38
Corners = tuple[tuple[float, float], ...]


class FootprintStringError(ValueError):
    """Why ``parseVVF`` or ``makeFootprintFromString`` takes no footprint from a string."""


def corners_of_string(text: str) -> Corners:
    """Return the corners that a string has, float32 as ``parseVVF`` reads them."""
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
            end = at
            while end < len(text) and text[end] not in "[], \t":
                end += 1
            try:
                number = float(text[at:end])
                if not abs(number) <= _LARGEST:
                    raise ValueError
                current.append(float(np.float32(number)))
            except ValueError:
                raise FootprintStringError(f"{text[at:end]!r} is no number") from None
            at = end - 1
        at += 1
    if depth:
        raise FootprintStringError("a bracket is not closed")
    if len(groups) < 3:
        raise FootprintStringError(f"a footprint needs three points or more, has {len(groups)}")
    if any(len(group) != 2 for group in groups):
        raise FootprintStringError("points must be pairs of numbers")
    return tuple((x, y) for x, y in groups)


def sixteen_corners(radius: float) -> Corners:
    """Return the corners of a round robot, as ``makeFootprintFromRadius``."""
    angles = [index * 2 * math.pi / 16 for index in range(16)]
    return tuple((math.cos(a) * radius, math.sin(a) * radius) for a in angles)


def padded_corners(corners: Corners, padding: float) -> Corners:
    """Return the corners moved outwards, as ``padFootprint``."""

    def pad(v: float) -> float:
        return v + (-1.0 if v < 0 else 1.0 if v > 0 else 0.0) * padding

    return tuple((pad(x), pad(y)) for x, y in corners)


def radii_of(corners: Corners) -> tuple[float, float]:
    """Return inscribed and circumscribed radius, as ``calculateMinAndMaxDistances``."""
    least, most = math.inf, 0.0
    for (x0, y0), (x1, y1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        c, d = x1 - x0, y1 - y0
        square = c * c + d * d
        share = (-x0 * c + -y0 * d) / square if square else 0.0
        share = min(max(share, 0.0), 1.0)
        edge = float(np.hypot(x0 + share * c, y0 + share * d))
        corner = float(np.hypot(x0, y0))
        least, most = min(least, edge, corner), max(most, edge, corner)
    return least, most
