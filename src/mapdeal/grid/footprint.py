"""The robot's shape seen from above, and the two radii that inflation asks for."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from mapdeal.errors import MapdealWarning, ParameterError

_LARGEST_COORDINATE = 1000.0
_MOST_VERTICES = 500
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?[nN]a[nN]|[-+]?\.?[iI]nf"

Point = tuple[float, float]


@dataclass(frozen=True)
class Footprint:
    """The outline of a robot around its centre of rotation, a polygon or a circle.

    Parameters
    ----------
    vertices : tuple of (x, y)
        Corners in the robot's frame, metres, in either sense of rotation; empty for a circle.
    radius : float
        Radius of a circle, metres; 0 for a polygon.

    Notes
    -----
    Radii as in costmap_2d's ``calculateMinAndMaxDistances``: inscribed is the smallest distance
    from the centre to an edge, circumscribed the largest to a corner. A circle is a circle
    here, not the 16-gon of ``makeFootprintFromRadius``, whose inscribed radius is 1.9 % short.

    Examples
    --------
    >>> Footprint.parse("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]").inscribed_radius
    0.2
    """

    vertices: tuple[Point, ...] = ()
    radius: float = 0.0

    @classmethod
    def circle(cls, radius: float) -> Footprint:
        """Return a round robot of `radius` metres."""
        if not (math.isfinite(radius) and 0 < radius <= _LARGEST_COORDINATE):
            rule = "robot radius must be a finite number of metres above 0"
            raise ParameterError(rule, got=radius)
        return cls(radius=radius)

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]]) -> Footprint:
        """Return a robot with the given corners, (x, y) in metres."""
        if len(vertices) > _MOST_VERTICES:
            rule = f"a footprint has at most {_MOST_VERTICES} vertices"
            raise ParameterError(rule, place="footprint", got=len(vertices))
        points: list[Point] = []
        for index, vertex in enumerate(vertices):
            place = f"footprint vertex {index + 1}"
            try:
                x, y = (float(v) for v in vertex)
            except (TypeError, ValueError):
                rule = "a vertex must be a pair of numbers [x, y]"
                raise ParameterError(rule, place=place, got=vertex) from None
            if not all(abs(v) <= _LARGEST_COORDINATE for v in (x, y)):  # refuses nan too
                rule = f"coordinates must be finite and within {_LARGEST_COORDINATE:g} m"
                raise ParameterError(rule, place=place, got=(x, y))
            points.append((x, y))
        if len(points) < 3:
            rule = "a footprint needs at least three vertices"
            raise ParameterError(rule, place="footprint", got=len(points))
        _check_simple(points)
        if not _contains_centre(points):
            text = "footprint: the robot's centre (0, 0) lies outside; its radii mean little"
            warnings.warn(text, MapdealWarning, stacklevel=2)
        return cls(vertices=tuple(points))

    @classmethod
    def parse(cls, text: str) -> Footprint:
        """Return the polygon that a string in ROS form ``[[x1, y1], [x2, y2], ...]`` describes."""
        number = rf"\s*(?:{_NUMBER})\s*"
        pair = rf"\s*\[{number}(?:,{number})*\]\s*"
        if not re.fullmatch(rf"\s*\[{pair}(?:,{pair})*\]\s*", text):
            rule = "a footprint must look like [[x1, y1], [x2, y2], ...]"
            raise ParameterError(rule, place="footprint", got=text)
        inner = re.findall(r"\[([^\[\]]*)\]", text)
        return cls.polygon(
            [[float(number.replace(".n", "n").replace(".i", "i")) for number in pair.split(",")]
             for pair in inner]
        )  # fmt: skip

    def padded(self, padding: float) -> Footprint:
        """Return the shape with every coordinate moved outwards by `padding` metres.

        As costmap_2d's ``padFootprint``: each coordinate by its own sign, 0 stays 0.
        """
        if not (math.isfinite(padding) and padding >= 0):
            rule = "footprint padding must be a finite number of metres of at least 0"
            raise ParameterError(rule, got=padding)
        if not self.vertices:
            return Footprint.circle(self.radius + padding)

        def pad(value: float) -> float:
            return value + math.copysign(padding, value) if value else value

        return Footprint(vertices=tuple((pad(x), pad(y)) for x, y in self.vertices))

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle around the centre that the robot covers, metres."""
        if not self.vertices:
            return self.radius
        return min(_distance_to_edge(a, b) for a, b in _edges(self.vertices))

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the smallest circle around the centre that covers the robot, metres."""
        if not self.vertices:
            return self.radius
        return max(math.hypot(x, y) for x, y in self.vertices)


def _edges(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(pairwise([*points, points[0]]))


def _distance_to_edge(a: Point, b: Point) -> float:
    """Return the distance from the centre to the segment from `a` to `b`."""
    (ax, ay), (bx, by) = a, b
    length_squared = (bx - ax) ** 2 + (by - ay) ** 2
    if length_squared == 0.0:  # a repeated corner; costmap_2d divides by zero here
        return math.hypot(ax, ay)
    along = min(1.0, max(0.0, -(ax * (bx - ax) + ay * (by - ay)) / length_squared))
    return math.hypot(ax + along * (bx - ax), ay + along * (by - ay))


def _contains_centre(points: Sequence[Point]) -> bool:
    """Return whether (0, 0) lies in the polygon or on its outline."""
    if min(_distance_to_edge(a, b) for a, b in _edges(points)) == 0.0:
        return True
    inside = False
    for (ax, ay), (bx, by) in _edges(points):
        if (ay > 0) != (by > 0) and ax + (bx - ax) * (-ay) / (by - ay) > 0:
            inside = not inside
    return inside


def _check_simple(points: Sequence[Point]) -> None:
    """Refuse outlines whose edges cross, naming the edge by its first corner."""
    edges = _edges(points)
    for i, (a, b) in enumerate(edges):
        for j, (c, d) in enumerate(edges[i + 1 :], i + 1):
            if _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0:
                rule = f"the edge crosses the one that starts at vertex {j + 1}"
                raise ParameterError(rule, place=f"footprint vertex {i + 1}", got=points[i])


def _side(a: Point, b: Point, p: Point) -> float:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
