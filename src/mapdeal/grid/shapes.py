"""Shapes in the map frame, in metres, and the cells of a grid that they cover."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from typing import ClassVar

import numpy as np

from mapdeal.errors import ParameterError, require
from mapdeal.grid import footprint, values
from mapdeal.grid.frame import CELL_TOLERANCE, FARTHEST, Frame, Point
from mapdeal.kernels import arrays, polygons
from mapdeal.records import dataclass, field

_MOST_VERTICES = 10_000
_ROWS_TOGETHER = 1 << 14  # of polygons: larger arrays leave the cache
_FLAT = 1e-12  # largest area that counts as none, relative to the extent squared


@dataclass(frozen=True, repr=False)
class Polygon(values.OneLineRepr):
    """A filled polygon, convex or concave, with or without holes.

    Parameters
    ----------
    points_xy : sequence of (x, y)
        Corners in the map frame, clockwise or anticlockwise, metres.
    holes_xy : sequence of sequences of (x, y)
        Corners of each hole, metres. Cells on the edge of a hole belong to the polygon; parts of a
        hole outside the polygon are ignored.
    value : int, optional
        Value to draw with.
    source : str
        File and place that the shape was read from, for messages.

    Raises
    ------
    ParameterError
        If there are fewer than three corners, or more than 10,000 including those of the holes, a
        coordinate is not finite, or edges of the outline or of a hole cross.

    Notes
    -----
    The edges are costmap_2d's lines between the corners' cells, and the cells in between are
    filled, as ``setConvexPolygonCost`` does; bays of concave polygons stay empty.

    Examples
    --------
    >>> room = Polygon([(0.5, 0.5), (2.5, 0.5), (2.5, 1.5), (0.5, 1.5)], value=100)
    >>> (spans,) = room.spans(Frame(4, 9, 1.0))  # columns 0 .. 2 of rows 0 and 1
    >>> spans.rows.tolist(), spans.starts.tolist(), spans.stops.tolist()
    ([0, 1], [0, 0], [3, 3])
    >>> room.has_extent(), Polygon([(0, 0), (1, 1), (2, 2)]).has_extent()
    (True, False)
    """

    points_xy: Sequence[Point]
    holes_xy: Sequence[Sequence[Point]] = ()
    value: int | None = None
    source: str = field(default="", compare=False, repr=False)
    kind: ClassVar[str] = "polygon"

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_xy", _ring(self.points_xy, "polygon"))
        vertices_left = _MOST_VERTICES - len(self.points_xy)
        holes = []
        for index, points in enumerate(self.holes_xy):
            holes.append(_ring(points, f"hole {index + 1}", vertices_left))
            vertices_left -= len(holes[-1])
        object.__setattr__(self, "holes_xy", tuple(holes))

    def _repr_parts(self) -> Iterator[str]:
        yield values.points_text(self.points_xy)
        if self.holes_xy:
            yield values.count_text(len(self.holes_xy), "hole")
        if self.value is not None:
            yield f"value {self.value}"

    def spans(self, frame: Frame) -> Iterator[polygons.Spans]:
        """Return the cells of a grid that the polygon covers, in parts."""
        rings = [_cells(frame, ring, self.kind) for ring in (self.points_xy, *self.holes_xy)]
        return polygons.polygon_spans(rings, frame.shape)

    def outside_part(self, frame: Frame) -> str | None:
        """Return a description of the first corner outside a grid; upper edges are outside."""
        return _outside_vertex(frame, self.points_xy)

    def has_extent(self) -> bool:
        """Return whether the corners do not all lie on one line."""
        extent = float(np.ptp(np.array(self.points_xy), axis=0).max())
        return footprint.area_of(self.points_xy) > _FLAT * extent**2


@dataclass(frozen=True, repr=False)
class Line(values.OneLineRepr):
    """A line through two or more points, including both ends.

    Parameters
    ----------
    points_xy : sequence of (x, y)
        Points in the map frame, metres; each is joined to the next.
    thickness : float
        Thickness, metres; up to the side of a cell, the line is one cell wide.
    value : int, optional
        Value to draw with.
    source : str
        File and place that the shape was read from, for messages.

    Raises
    ------
    ParameterError
        If there are fewer than two or more than 10,000 points, a number is not finite, or the
        thickness is negative.

    Notes
    -----
    The line consists of the cells of costmap_2d's ``raytraceLine``. If it is thicker than a cell,
    every cell whose centre lies within half the thickness is added. The ends are round.

    Examples
    --------
    >>> (spans,) = Line([(0.5, 0.5), (3.5, 0.5)]).spans(Frame(2, 9, 1.0))
    >>> spans.rows.tolist(), spans.starts.tolist(), spans.stops.tolist()
    ([0], [0], [4])
    """

    points_xy: Sequence[Point]
    thickness: float = 0.0
    value: int | None = None
    source: str = field(default="", compare=False, repr=False)
    kind: ClassVar[str] = "line"

    def __post_init__(self) -> None:
        points = footprint.checked_corners(self.points_xy, "line", least=2, most=_MOST_VERTICES)
        object.__setattr__(self, "points_xy", points)
        _check_length(self.thickness, "line thickness")

    def _repr_parts(self) -> Iterator[str]:
        yield values.points_text(self.points_xy)
        yield f"thickness {self.thickness:.6g} m"
        if self.value is not None:
            yield f"value {self.value}"

    def spans(self, frame: Frame) -> Iterator[polygons.Spans]:
        edges = polygons.edges_through(_cells(frame, self.points_xy, self.kind))
        thin = polygons.line_spans(edges, frame.shape)
        if self._reach(frame) == 0:
            return thin
        radius = _checked_cells(frame, self.thickness, "line thickness") / 2
        ends = pairwise(_positions(frame, self.points_xy))
        return chain(thin, (polygons.capsule_spans(a, b, radius, frame.shape) for a, b in ends))

    def outside_part(self, frame: Frame) -> str | None:
        """Return a description of the first point, or the thickness, outside a grid."""
        if vertex := _outside_vertex(frame, self.points_xy):
            return vertex
        beyond = _reaches_beyond(frame, self.points_xy, self._reach(frame))
        return "its thickness" if beyond else None

    def _reach(self, frame: Frame) -> float:
        is_thin = self.thickness <= frame.resolution * (1 + CELL_TOLERANCE)
        return 0.0 if is_thin else self.thickness / 2

    def has_extent(self) -> bool:
        """Return True: a line need not have an area."""
        return True


@dataclass(frozen=True)
class Circle:
    """A filled circle.

    Parameters
    ----------
    center_xy : (x, y)
        Center in the map frame, metres.
    radius : float
        Radius, metres.
    value : int, optional
        Value to draw with.
    source : str
        File and place that the shape was read from, for messages.

    Raises
    ------
    ParameterError
        If a number is not finite, or the radius is negative.

    Notes
    -----
    The circle covers every cell whose centre lies within the radius, as in `mapdeal.inflate`, and
    the cell that contains its own centre.

    Examples
    --------
    >>> Circle((2.0, 2.0), 0.5).outside_part(Frame(4, 9, 1.0)) is None
    True
    >>> Circle((2.0, 2.0), 2.5).outside_part(Frame(4, 9, 1.0))
    'its rim'
    """

    center_xy: Point
    radius: float
    value: int | None = None
    source: str = field(default="", compare=False, repr=False)
    kind: ClassVar[str] = "circle"

    def __post_init__(self) -> None:
        (center,) = footprint.checked_corners([self.center_xy], "circle", least=1, most=1)
        object.__setattr__(self, "center_xy", center)
        _check_length(self.radius, "circle radius")

    def spans(self, frame: Frame) -> Iterator[polygons.Spans]:
        (cell,) = _cells(frame, [self.center_xy], self.kind)
        (place,) = _positions(frame, [self.center_xy])
        radius = _checked_cells(frame, self.radius, "circle radius")
        center = []
        if frame.holds(cell):
            row, col = (np.array([index]) for index in cell)
            center.append(polygons.Spans(row, col, col + 1))
        if radius == 0:
            return iter(center)
        return chain(center, [polygons.capsule_spans(place, place, radius, frame.shape)])

    def outside_part(self, frame: Frame) -> str | None:
        """Return a description of the center, or else the rim, if outside a grid."""
        if not frame.contains([self.center_xy])[0]:
            return "its center"
        return "its rim" if _reaches_beyond(frame, [self.center_xy], self.radius) else None

    def has_extent(self) -> bool:
        """Return True: a circle covers at least its own cell."""
        return True


Shape = Polygon | Line | Circle


class PlainPolygons:
    """Polygons without holes (`is_plain`) that lie in the grid (`fits`), found together."""

    def __init__(self, frame: Frame, shapes: Sequence[Shape]) -> None:
        self._shape = frame.shape
        plain = {
            index: shape.points_xy for index, shape in enumerate(shapes)
            if isinstance(shape, Polygon) and not shape.holes_xy
        }  # fmt: skip
        chosen, rings = list(plain), list(plain.values())
        sizes = np.array([*map(len, rings)], dtype=np.int64)
        points = np.array([*chain.from_iterable(rings)], dtype=np.float64).reshape(-1, 2)
        self._ends = np.cumsum(sizes)
        self._firsts = self._ends - sizes
        self._after = np.arange(1, len(points) + 1)
        self._after[self._ends - 1] = self._firsts
        self._cells = frame.unbounded_rowcol_from_xy(points)
        self.is_plain, self.fits = np.zeros((2, len(shapes)), dtype=np.bool_)
        self._number = np.zeros(len(shapes), dtype=np.int64)
        self._number[chosen] = np.arange(len(chosen))
        if not chosen:
            return
        self._bottom = np.minimum.reduceat(self._cells[:, 0], self._firsts)
        self._height = np.maximum.reduceat(self._cells[:, 0], self._firsts) - self._bottom + 1
        is_near = np.abs(self._cells).max(axis=1) <= polygons.FARTHEST_CELL
        is_low = self._height <= 2 * frame.height
        self.is_plain[chosen] = np.logical_and.reduceat(is_near, self._firsts) & is_low
        inside = np.logical_and.reduceat(frame.contains(points), self._firsts)
        corners = points - np.repeat(points[self._firsts], sizes, axis=0)
        ahead = corners[self._after]
        doubled = corners[:, 0] * ahead[:, 1] - corners[:, 1] * ahead[:, 0]
        areas = np.abs(np.add.reduceat(doubled, self._firsts)) / 2
        low, high = (bound.reduceat(points, self._firsts) for bound in (np.minimum, np.maximum))
        # Rounding decides nothing here: polygons with less than twice the least area are looked at.
        self.fits[chosen] = inside & (areas > 2 * _FLAT * (high - low).max(axis=1) ** 2)

    def spans(self, indices: Sequence[int]) -> Iterator[tuple[polygons.Spans, arrays.Integers]]:
        """Yield the runs of cells of some shapes in order, and the index of each run's shape."""
        # Each polygon gets rows of its own in a stack of all.
        chosen = np.array(indices)
        heights = self._height[self._number[chosen]]
        part_of = (np.cumsum(heights) - heights) // _ROWS_TOGETHER
        for some in np.split(chosen, np.flatnonzero(np.diff(part_of)) + 1):
            numbers = self._number[some]
            heights = self._height[numbers]
            offsets = np.cumsum(heights) - heights
            polygon_of, at = polygons.enumerated(self._firsts[numbers], self._ends[numbers])
            shifts = offsets - self._bottom[numbers]
            rows, cols = self._cells[:, 0], self._cells[:, 1]
            up, ahead = shifts[polygon_of], self._after[at]
            edges = polygons.Edges(rows[at] + up, cols[at], rows[ahead] + up, cols[ahead])
            for spans in polygons.stacked_spans(edges, (int(heights.sum()), self._shape[1])):
                polygon_of_run = np.searchsorted(offsets, spans.rows, side="right") - 1
                rows_of_runs = spans.rows - shifts[polygon_of_run]
                inside = (rows_of_runs >= 0) & (rows_of_runs < self._shape[0])
                columns = (column[inside] for column in (rows_of_runs, *spans[1:]))
                yield polygons.Spans(*columns), some[polygon_of_run[inside]]


def _ring(points: Sequence[Point], name: str, most: int = _MOST_VERTICES) -> tuple[Point, ...]:
    corners = footprint.checked_corners(points, name, least=3, most=most)
    footprint.check_simple(corners, name)
    return corners


def _check_length(length: float, place: str) -> None:
    is_length = footprint.is_number(length) and 0 <= length <= FARTHEST
    require(is_length, "must be a finite number of metres of at least 0", place, got=length)


def _cells(frame: Frame, points: Sequence[Point], kind: str) -> list[polygons.Cell]:
    cells = frame.unbounded_rowcol_from_xy(points)
    far = np.abs(cells).max(axis=1) > polygons.FARTHEST_CELL
    if far.any():
        index = int(np.argmax(far))
        rule = f"lies more than {polygons.FARTHEST_CELL} cells from the map"
        raise ParameterError(rule, place=f"{kind} vertex {index + 1}", got=points[index])
    return [(row, col) for row, col in cells.tolist()]


def _positions(frame: Frame, points: Sequence[Point]) -> list[tuple[float, float]]:
    return [(row, col) for row, col in frame.continuous_rowcol_from_xy(points).tolist()]


def _checked_cells(frame: Frame, length: float, place: str) -> float:
    cells, rule = length / frame.resolution, f"must not be more than {polygons.FARTHEST_CELL} cells"
    require(cells <= polygons.FARTHEST_CELL, rule, place, got=length)  # larger ones would overflow
    return cells


def _outside_vertex(frame: Frame, points: Sequence[Point]) -> str | None:
    inside = frame.contains(points)
    if inside.all():
        return None
    index = int(np.argmin(inside))
    x, y = points[index]
    past = frame.continuous_rowcol_from_xy([points[index]])[0] - frame.shape
    is_on_edge = bool(np.abs(past).min() <= 2 * frame.tolerance_at([points[index]]))
    edge = " (upper edges belong to no cell)" if is_on_edge else ","
    return f"vertex {index + 1}, ({x:.10g}, {y:.10g}){edge}"


def _reaches_beyond(frame: Frame, points: Sequence[Point], radius: float) -> bool:
    reach = radius / frame.resolution - float(frame.tolerance_at(points).max())
    places = np.array(_positions(frame, points))
    below, above = places.min() - reach, (places - np.array(frame.shape)).max() + reach
    return radius > 0 and bool(below < 0 or above > 0)
