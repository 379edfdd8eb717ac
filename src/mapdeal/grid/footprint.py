"""The robot's shape seen from above, and the two radii that inflation needs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.coordinates import Point
from mapdeal.grid.display import OneLine, points_text
from mapdeal.grid.outline import (
    check_simple,
    checked_corners,
    contains_centre,
    distance_to_edge,
    edges_of,
)
from mapdeal.records import dataclass

_LARGEST_COORDINATE = 1000.0
_MOST_VERTICES = 500
_NUMBER = re.compile(
    r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?[nN]a[nN]|[-+]?\.?[iI]nf"
)


@dataclass(frozen=True, repr=False)
class Footprint(OneLine):
    """The outline of a robot around its centre of rotation, a polygon or a circle.

    Parameters
    ----------
    vertices : tuple of (x, y)
        Corners in the robot's frame, clockwise or anticlockwise, metres; empty for a circle.
    radius : float
        Radius of a circle, metres; 0 for a polygon.

    Notes
    -----
    The radii are those of costmap_2d's ``calculateMinAndMaxDistances``: the inscribed radius is
    the smallest distance from the centre to an edge, the circumscribed radius the largest distance
    to a corner. A circle is an exact circle, not the 16-gon of ``makeFootprintFromRadius``, whose
    inscribed radius is 1.9 % smaller; use `sixteen_gon` for that.

    Examples
    --------
    >>> Footprint.parse("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]").inscribed_radius
    0.2
    """

    vertices: tuple[Point, ...] = ()
    radius: float = 0.0

    @classmethod
    def circle(cls, radius: float) -> Footprint:
        """Create the footprint of a round robot of `radius` metres."""
        if not (math.isfinite(radius) and 0 < radius <= _LARGEST_COORDINATE):
            most = f"{_LARGEST_COORDINATE:g} at most"
            rule = f"robot radius must be a finite number of metres above 0, {most}"
            raise ParameterError(rule, got=radius)
        return cls(radius=radius)

    @classmethod
    def sixteen_gon(cls, radius: float) -> Footprint:
        """Create the footprint of a round robot as in costmap_2d: 16 corners on the circle.

        This is costmap_2d's ``makeFootprintFromRadius``. The inscribed radius is that of the
        polygon, cos(pi / 16) = 0.981 of `radius`.

        Examples
        --------
        >>> round(Footprint.sixteen_gon(0.5).inscribed_radius, 5)
        0.49039
        """
        circle = cls.circle(radius)
        angles = [index * 2 * math.pi / 16 for index in range(16)]
        return cls(
            tuple((circle.radius * math.cos(a), circle.radius * math.sin(a)) for a in angles)
        )

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]]) -> Footprint:
        """Create a footprint with the given corners, (x, y) in metres."""
        points = checked_corners(
            vertices, "footprint", within=_LARGEST_COORDINATE, least=3, most=_MOST_VERTICES
        )
        check_simple(points, "footprint")
        if not contains_centre(points):
            text = "footprint: the robot's centre (0, 0) lies outside; its radii are meaningless"
            emit_warning(text, stacklevel=2)
        return cls(vertices=points)

    @classmethod
    def parse(cls, text: str) -> Footprint:
        """Create a polygon from a string in ROS form, ``[[x1, y1], [x2, y2], ...]``."""
        corners = [[part.strip() for part in pair.split(",")] for pair in _pairs(text)]
        if not corners or not all(_NUMBER.fullmatch(part) for pair in corners for part in pair):
            rule = "a footprint must look like [[x1, y1], [x2, y2], ...]"
            raise ParameterError(rule, place="footprint", got=text)
        # YAML's .nan and .inf are numbers, too, and refused as such
        return cls.polygon([[float(part.lower().replace(".n", "n").replace(".i", "i"))
                             for part in pair] for pair in corners])  # fmt: skip

    def padded(self, padding: float) -> Footprint:
        """Return the footprint with every coordinate moved outwards by `padding` metres.

        As in costmap_2d's ``padFootprint``, each coordinate moves away from 0, and 0 stays 0.
        """
        if not (math.isfinite(padding) and padding >= 0):
            rule = "footprint padding must be a finite number of metres of at least 0"
            raise ParameterError(rule, got=padding)
        if not self.vertices:
            return Footprint.circle(self.radius + padding)

        def pad(value: float) -> float:
            return value + math.copysign(padding, value) if value else value

        return Footprint(vertices=tuple((pad(x), pad(y)) for x, y in self.vertices))

    def _told(self) -> Iterator[str]:
        if not self.vertices:
            yield f"circle, radius {self.radius:.6g} m"
            return
        yield points_text(self.vertices)
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"circumscribed_radius {self.circumscribed_radius:.6g} m"

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle around the centre that the robot covers, metres."""
        if not self.vertices:
            return self.radius
        return min(distance_to_edge(a, b) for a, b in edges_of(self.vertices))

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the smallest circle around the centre that covers the robot, metres."""
        if not self.vertices:
            return self.radius
        return max(math.hypot(x, y) for x, y in self.vertices)


def _pairs(text: str) -> list[str]:
    """Return what stands in the inner brackets of ``[[...], [...]]``; nothing of other text.

    Each character is looked at a few times, whatever the text.
    """
    whole = text.strip()
    if not (whole.startswith("[") and whole.endswith("]")):
        return []
    pieces = whole[1:-1].split("]")
    pairs = []
    for index, piece in enumerate(pieces[:-1]):
        lead, bracket, inner = piece.partition("[")
        if not bracket or "[" in inner or lead.strip() != ("," if index else ""):
            return []
        pairs.append(inner)
    return [] if pieces[-1].strip() else pairs
