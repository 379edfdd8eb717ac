"""Footprints of robots: their polygons, cells and costs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise, starmap
from numbers import Real
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError, emit_warning, require
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import FARTHEST, Frame, Point, are_near, as_float32, as_numbers, turned
from mapdeal.grid.values import OneLineRepr, check_choice, points_text
from mapdeal.kernels.arrays import Floats, Integers
from mapdeal.kernels.polygons import Lattice, Spans, costs_at_poses, edges_of_rings, stacked_spans
from mapdeal.records import dataclass

_FEW = 16  # edges up to which plain Python is faster than numpy
_LARGEST_COORDINATE = 1000.0
_MOST_VERTICES = 500
_NUMBER = re.compile(
    r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?[nN]a[nN]|[-+]?\.?[iI]nf"
)
_ROUNDING = 1e-9  # cells: a corner this close below an edge is in the upper cell
_FARTHEST = float(1 << 40)  # cells; more than any grid has, and whole numbers still convert


def checked_corners(
    points: Sequence[Sequence[float]], name: str, *, least: int, most: int, within: float = FARTHEST
) -> tuple[Point, ...]:
    is_list = isinstance(points, Iterable) and not isinstance(points, (str, bytes))
    require(is_list, f"a {name} takes a list of vertices [x, y]", name, got=points)
    points = list(points)
    count = len(points)
    require(count <= most, f"a {name} has at most {most} vertices", name, got=count)
    corners: list[Point] = []
    for number, vertex in enumerate(points, start=1):
        numbers = as_numbers(vertex)
        if len(numbers) != 2 or not are_near(numbers, within):
            place, rule = f"{name} vertex {number}", "a vertex must be a pair of numbers [x, y]"
            require(len(numbers) == 2, rule, place, got=vertex)
            rule = f"coordinates must be finite and within {within:g} m"
            raise ParameterError(rule, place=place, got=numbers)
        corners.append((numbers[0], numbers[1]))
    words = {1: "one vertex", 2: "two vertices", 3: "three vertices"}[least]
    require(count >= least, f"a {name} needs at least {words}", name, got=count)
    return tuple(corners)


def edges_of(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(pairwise([*points, points[0]]))


def check_simple(points: Sequence[Point], shape: str) -> None:
    starts = np.array(points, dtype=np.float64)
    ends = np.concatenate([starts[1:], starts[:1]])
    is_few = len(points) <= _FEW
    for i, candidates in _near_edges_of_few(points) if is_few else _near_edges(starts, ends):
        a, b, c, d = starts[i], ends[i], starts[candidates], ends[candidates]
        crosses = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
        if crosses.any():
            crossed = int(candidates[np.argmax(crosses)])
            rule = f"the edge crosses the one that starts at vertex {crossed + 1}"
            raise ParameterError(rule, place=f"{shape} vertex {i + 1}", got=points[i])


def _near_edges(starts: Floats, ends: Floats) -> Iterator[tuple[int, Integers]]:
    """Yield each edge, and the later ones whose bounding boxes meet its own."""
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    for i in range(len(starts) - 1):
        near = (low[i + 1 :, 0] <= high[i, 0]) & (high[i + 1 :, 0] >= low[i, 0])
        near &= (low[i + 1 :, 1] <= high[i, 1]) & (high[i + 1 :, 1] >= low[i, 1])
        yield i, i + 1 + np.flatnonzero(near)


def _near_edges_of_few(points: Sequence[Point]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield what `_near_edges` does, without edges that share a corner, which cannot cross."""
    edges = edges_of(points)
    boxes = [(min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)) for (ax, ay), (bx, by) in edges]
    for i, (low_x, high_x, low_y, high_y) in enumerate(boxes):
        later = [
            j
            for j in range(i + 2, len(boxes) - (i == 0))
            if boxes[j][0] <= high_x and boxes[j][1] >= low_x
            and boxes[j][2] <= high_y and boxes[j][3] >= low_y
        ]  # fmt: skip
        if later:
            yield i, np.array(later)


def area_of(points: Sequence[Point]) -> float:
    corners = np.array(points, dtype=np.float64) - np.array(points[0])
    return abs(float(_cross(corners, np.roll(corners, -1, axis=0)).sum())) / 2


def distance_to_edge(a: Point, b: Point) -> float:
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
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _side(a: Floats, b: Floats, p: Floats) -> Floats:
    """Return the side of the line through `a` and `b` on which a point lies: -1, 1, or 0 on it."""
    # Decimal coordinates that touch exactly differ by rounding; they still count as touching.
    along, beside = b - a, p - a
    rounding = 8 * np.finfo(np.float64).eps * np.maximum(np.abs(a), np.maximum(abs(b), abs(p)))
    tolerance = _near_product(along, rounding) + _near_product(rounding, beside)
    cross = _cross(along, beside)
    return np.where(np.abs(cross) <= tolerance, 0.0, np.sign(cross))


def _near_product(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.abs(u[..., 0] * v[..., 1]) + np.abs(u[..., 1] * v[..., 0])


def _cross(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


@dataclass(frozen=True, repr=False)
class Footprint(OneLineRepr):
    """The outline of a robot around its centre of rotation, a polygon or a circle.

    Parameters
    ----------
    vertices : tuple of (x, y)
        Corners in the robot's frame, clockwise or anticlockwise, metres; empty for a circle.
    radius : float
        Radius of a circle, metres; 0 for a polygon.

    Notes
    -----
    The radii are those of costmap_2d's ``calculateMinAndMaxDistances``: from the centre to the
    nearest edge and to the farthest corner. A circle is exact; ROS's 16-gon is `sixteen_gon`.

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
        rule = "robot radius must be a finite number of metres above 0, "
        is_radius = isinstance(radius, Real) and 0 < radius <= _LARGEST_COORDINATE
        require(is_radius, f"{rule}{_LARGEST_COORDINATE:g} at most", got=radius)
        return cls(radius=radius)

    @classmethod
    def sixteen_gon(cls, radius: float) -> Footprint:
        """Create the 16 corners of costmap_2d's ``makeFootprintFromRadius`` for a round robot."""
        radius = cls.circle(radius).radius
        angles = [index * 2 * math.pi / 16 for index in range(16)]
        return cls(tuple((radius * math.cos(a), radius * math.sin(a)) for a in angles))

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]]) -> Footprint:
        """Create a footprint with the given corners, (x, y) in metres."""
        points = checked_corners(
            vertices, "footprint", within=_LARGEST_COORDINATE, least=3, most=_MOST_VERTICES
        )
        check_simple(points, "footprint")
        if not contains_centre(points):
            text = "the robot's centre (0, 0) lies outside; its radii are meaningless"
            emit_warning(f"footprint: {text}")
        return cls(vertices=points)

    @classmethod
    def parse(cls, text: str) -> Footprint:
        """Create a polygon from a string in ROS form, ``[[x1, y1], [x2, y2], ...]``."""
        pairs = _pairs(text) if isinstance(text, str) else []
        corners = [[part.strip() for part in pair.split(",")] for pair in pairs]
        is_list = corners and all(_NUMBER.fullmatch(part) for pair in corners for part in pair)
        rule = "a footprint must look like [[x1, y1], [x2, y2], ...]"
        require(bool(is_list), rule, "footprint", got=text)
        # YAML's .nan and .inf are parsed, so that the error is about a number that is not finite
        return cls.polygon([[float(part.lower().replace(".n", "n").replace(".i", "i"))
                             for part in pair] for pair in corners])  # fmt: skip

    def padded(self, padding: float) -> Footprint:
        """Return the footprint with all coordinates moved away from 0, as ``padFootprint`` does."""
        rule = "footprint padding must be a finite number of metres of at least 0"
        require(isinstance(padding, Real) and 0 <= padding < math.inf, rule, got=padding)
        if not self.vertices:
            return Footprint.circle(self.radius + padding)

        def pad(value: float) -> float:
            return value + math.copysign(padding, value) if value else value

        return Footprint(vertices=tuple((pad(x), pad(y)) for x, y in self.vertices))

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners in the robot's frame, shape (N, 2), metres; of a circle those of ROS's 16-gon."""
        shape = self if self.vertices else Footprint.sixteen_gon(self.radius)
        return np.array(shape.vertices, dtype=np.float64)

    def _repr_parts(self) -> Iterator[str]:
        if not self.vertices:
            yield f"circle, radius {self.radius:.6g} m"
            return
        yield points_text(self.vertices)
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"circumscribed_radius {self.circumscribed_radius:.6g} m"

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle around the centre that the robot covers, metres."""
        edges = edges_of(self.vertices) if self.vertices else ()
        return min((distance_to_edge(a, b) for a, b in edges), default=self.radius)

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the smallest circle around the centre that covers the robot, metres."""
        return max((math.hypot(x, y) for x, y in self.vertices), default=self.radius)


def _pairs(text: str) -> list[str]:
    """Return the texts in the inner brackets of ``[[...], [...]]``; none for other texts."""
    # The time is linear in the length of any text, unlike that of a regular expression.
    outer = text.strip()
    if not (outer.startswith("[") and outer.endswith("]")):
        return []
    pieces = outer[1:-1].split("]")
    pairs = []
    for index, piece in enumerate(pieces[:-1]):
        lead, bracket, inner = piece.partition("[")
        if not bracket or "[" in inner or lead.strip() != ("," if index else ""):
            return []
        pairs.append(inner)
    return [] if pieces[-1].strip() else pairs


def footprint_spans(footprint: Footprint, frame: Frame, heading_count: int) -> tuple[Spans, ...]:
    """Return the cells that a footprint covers in each heading, relative to the robot's cell."""
    # The robot's centre is the middle of its cell. The cells are those that costmap_2d draws.
    yaw, vertices = frame.origin[2], footprint.corners
    turns = [2 * math.pi * k / heading_count - yaw for k in range(heading_count)]
    with np.errstate(over="ignore"):
        places = [0.5 + turned(vertices, turn)[:, ::-1] / frame.resolution for turn in turns]
    rounded_down = (np.floor(place + _ROUNDING).clip(-_FARTHEST, _FARTHEST) for place in places)
    corners = [cells.astype(np.int64) for cells in rounded_down]
    # a footprint larger than the grid fits nowhere
    fitting = [k for k, cells in enumerate(corners) if (np.ptp(cells, axis=0) < frame.shape).all()]
    spans = [Spans(cells[:, 0], cells[:, 1], cells[:, 1] + 1) for cells in corners]
    drawn = _polygon_cells([corners[k] for k in fitting]) if fitting else []
    for k, drawn_spans in zip(fitting, drawn, strict=True):
        spans[k] = drawn_spans
    return tuple(spans)


def _polygon_cells(polygons: list[NDArray[np.int64]]) -> list[Spans]:
    least = np.array([cells.min(axis=0) for cells in polygons])
    sizes = np.array([cells.max(axis=0) for cells in polygons]) - least + 1
    tops = np.cumsum(sizes[:, 0])
    shifts = least.copy()
    shifts[:, 0] -= tops - sizes[:, 0]
    rings = [(cells - shift).tolist() for cells, shift in zip(polygons, shifts, strict=True)]
    parts = list(stacked_spans(edges_of_rings(rings), (int(tops[-1]), int(sizes[:, 1].max()))))
    rows, starts, stops = map(np.concatenate, zip(*parts, strict=True))
    edges = np.searchsorted(rows, [0, *tops.tolist()])
    return [
        Spans(rows[part] + row, starts[part] + col, stops[part] + col)
        for part, (row, col) in zip(starmap(slice, pairwise(edges)), shifts.tolist(), strict=True)
    ]


if TYPE_CHECKING:  # what callers pass; functions get the footprint made of it
    FootprintLike = Footprint | ArrayLike
else:
    FootprintLike = Footprint

FootprintRule = Literal["outline", "full"]  # cells that count: Nav2's, or all of the footprint


def footprint_costs(
    costmap: Costmap, footprint: FootprintLike, poses: ArrayLike, *, rule: FootprintRule = "outline"
) -> NDArray[np.uint8]:
    """Return the costs that Nav2's collision checker computes for a robot at poses.

    Parameters
    ----------
    costmap : Costmap
        Costs on scale ``costmap2d``; use `Costmap.from_static_layer` for a map.
    footprint : Footprint
        Robot shape. A circle is treated as `Footprint.sixteen_gon`, as in Nav2.
    poses : array_like of float, shape (N, 3)
        Poses of the robot's centre in the map frame, or one pose: x, y (metres) and yaw (radians).
    rule : {'outline', 'full'}
        Cells that count: those of the outline only, as in Nav2, or all cells of the footprint.

    Returns
    -------
    numpy.ndarray of uint8, shape (N,)
        Largest cost of these cells: below 254 there is no collision; 254 if an obstacle is hit, a
        corner is outside the map, or a number is not finite; 255 if unknown cells are touched.

    Raises
    ------
    ParameterError
        If `poses` has another shape, the costs are on another scale, or the rule is unknown.

    Notes
    -----
    This is ``FootprintCollisionChecker::footprintCostAtPose``. With ``outline``, 255 may hide 254,
    as in Nav2: an edge that meets 254 ends the search, unless an earlier one has met 255. With
    ``full``, 254 in any cell gives 254. The resolution is rounded to float32, as in every ROS
    costmap, and the yaw of the costmap is taken into account.

    Examples
    --------
    >>> costmap = Costmap([[0, 0, 0, 7, 254], [0, 0, 0, 7, 254], [0, 0, 0, 7, 254]], 0.5)
    >>> robot = Footprint.polygon([[0.4, 0.1], [0.4, -0.1], [-0.4, -0.1], [-0.4, 0.1]])
    >>> footprint_costs(costmap, robot, [[0.75, 0.75, 0], [1.25, 0.75, 0], [1.25, 0.75, 1.5708]])
    array([0, 7, 0], dtype=uint8)
    """
    costs, _ = sample_poses(costmap, cast("Footprint", footprint), poses, rule=rule)
    return costs


def sample_poses(
    costmap: Costmap, footprint: Footprint, poses: ArrayLike, *, rule: FootprintRule = "outline"
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the result of `footprint_costs`, and whether all corners lie on the map."""
    check_choice(rule, FootprintRule, "rule")
    if costmap.scale != "costmap2d":
        text = "footprints are checked against costs on scale costmap2d"
        hint = "published costs, and those of rings and thresholds, do not show what a footprint "
        hint += "hits"
        raise ParameterError(text, place="cost scale", got=costmap.scale, hint=hint)
    places = np.asarray(poses, dtype=np.float64)
    if places.shape == (3,):
        places = places.reshape(1, 3)
    is_list = places.ndim == 2 and places.shape[1] == 3
    require(is_list, "poses must be an array of x, y, yaw, shape (N, 3)", got=places.shape)
    lattice = Lattice(as_float32(costmap.resolution), *costmap.origin)
    costs, corners = np.asarray(costmap.cost).view(np.uint8), footprint.corners
    return costs_at_poses(costs, lattice, corners, places, filled=rule == "full")


def shape_of(shape: FootprintLike | None, robot_radius: float | None = None) -> Footprint | None:
    if robot_radius is None:
        return cast("Footprint | None", shape)
    if shape is not None:
        raise ParameterError("cannot be given together with a footprint", place="robot_radius")
    return Footprint.circle(robot_radius)
