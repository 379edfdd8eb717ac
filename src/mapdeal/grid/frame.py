"""Where cells lie."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.display import OneLine
from mapdeal.kernels.clouds import Precision, cells_of_points

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


ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Of a coordinate: what storing it, subtracting the origin and turning leave uncertain."""

_PRECISION = Precision(ROUNDING, CELL_TOLERANCE, FARTHEST)


@dataclass(frozen=True, slots=True)
class Frame:
    """The geometry of a grid: its size and its place in the map frame.

    Parameters
    ----------
    height, width : int
        Number of rows and columns. Row 0 is the south, the smallest y of an unrotated grid.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).

    Notes
    -----
    The grid is half-open: its upper edges belong to no cell. The centre of a cell lies half a
    cell from its corner along both axes.
    """

    height: int
    width: int
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.height, self.width

    @property
    def size_xy(self) -> tuple[float, float]:
        """Width and height, metres: columns and rows times the resolution."""
        return self.width * self.resolution, self.height * self.resolution

    @classmethod
    def centred(cls, height: int, width: int, resolution: float, yaw: float = 0.0) -> Frame:
        """Create a frame centred on (0, 0) of the map frame.

        (0, 0) is the lower corner of cell (height // 2, width // 2), so that without a yaw the
        cell of a point is floor(y / resolution) + height // 2, floor(x / resolution) + width // 2,
        even for negative coordinates. Row 0 is the south, not the top of a picture.

        Examples
        --------
        >>> frame = Frame.centred(4, 7, 0.5)
        >>> frame.origin
        (-1.5, -1.0, 0.0)
        >>> frame.unbounded_rowcol_from_xy([[0.0, 0.0], [-0.1, -0.1]]).tolist()
        [[2, 3], [1, 2]]
        """
        unturned = cls(height, width, resolution, (0.0, 0.0, yaw))
        return unturned.window(-(height // 2), -(width // 2), height, width)

    def continuous_rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Convert points to fractional cell coordinates.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres.

        Returns
        -------
        numpy.ndarray of float64, shape (N, 2)
            Row and column coordinates, as in Nav2's ``worldToMapContinuous``: whole numbers are
            edges between cells, cell centres are at +0.5.

        Raises
        ------
        ParameterError
            If a coordinate is not finite, or beyond 1e12 m.
        """
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        near = np.abs(points) <= FARTHEST  # refuses nan too
        if not near.all():
            rule = f"coordinates must be finite and within {FARTHEST:g} m"
            first = points[int(np.argmin(near.all(axis=1)))]
            raise ParameterError(rule, place="point", got=tuple(first.tolist()))
        x, y, yaw = self.origin
        cells_xy = turned(points - np.array([x, y]), -yaw) / self.resolution
        return cells_xy[:, ::-1]

    def tolerance_at(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Return the rounding error of the coordinates of points, shape (N, 2), in cells.

        It is at least `CELL_TOLERANCE`, and more far from the map frame's origin, where the
        coordinates themselves are coarser.
        """
        points = np.abs(np.asarray(points_xy, dtype=np.float64).reshape(-1, 2))
        x, y, _ = self.origin
        largest = np.maximum(points[:, :1], points[:, 1:])  # faster than max along short rows
        np.maximum(largest, max(abs(x), abs(y)), out=largest)
        tolerance: NDArray[np.float64] = ROUNDING * largest / self.resolution
        return np.maximum(CELL_TOLERANCE, tolerance)

    def unbounded_rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.int64]:
        """Convert points to cells, as if the grid were unbounded.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres.

        Returns
        -------
        numpy.ndarray of int64, shape (N, 2)
            Row and column of each; negative or beyond the size for points outside.

        Raises
        ------
        ParameterError
            If a coordinate is not finite, or beyond 1e12 m.

        References
        ----------
        costmap_2d's ``worldToMapNoBounds``, but with floor: costmap_2d truncates towards zero and
        assigns points just below the lower edges to row or column 0.

        Examples
        --------
        >>> frame = Frame(2, 3, 0.1, (-0.2, 0.2, 0.0))
        >>> frame.unbounded_rowcol_from_xy([[0.05, 0.35], [-0.3, 0.2]]).tolist()
        [[1, 2], [0, -1]]
        """
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        cells = cells_of_points(points, self.origin, self.resolution, _PRECISION)
        if cells is None:
            cells = cells_at(self.continuous_rowcol_from_xy(points), self.tolerance_at(points))
        return cells

    def clamped_rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.int64]:
        """Convert points to cells; points outside the grid go to the nearest border cell.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres.

        Returns
        -------
        numpy.ndarray of int64, shape (N, 2)
            Row and column of each, always inside the grid.

        Raises
        ------
        ParameterError
            If a coordinate is not finite, or beyond 1e12 m.

        References
        ----------
        costmap_2d's ``worldToMapEnforceBounds``. Nav2's version returns a cell beyond the last
        one for a point exactly on an upper edge; this method does not.

        Examples
        --------
        >>> frame = Frame(2, 3, 0.1, (-0.2, 0.2, 0.0))
        >>> frame.clamped_rowcol_from_xy([[0.05, 0.35], [-9.0, 0.4]]).tolist()
        [[1, 2], [1, 0]]
        """
        last = np.array([self.height - 1, self.width - 1])
        return np.clip(self.unbounded_rowcol_from_xy(points_xy), 0, last)

    def bounded_rowcol_from_xy(
        self, points_xy: ArrayLike
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Convert points to cells, and return which points lie inside the grid.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres; non-finite points are outside.

        Returns
        -------
        cells : numpy.ndarray of int64, shape (N, 2)
            Row and column of each; (-1, -1) for points outside.
        inside : numpy.ndarray of bool, shape (N,)
            Whether each point lies in a cell of the grid.

        References
        ----------
        costmap_2d's ``worldToMap``, whose return value is `inside`.

        Examples
        --------
        >>> frame = Frame(2, 3, 0.1, (-0.2, 0.2, 0.0))
        >>> cells, inside = frame.bounded_rowcol_from_xy([[0.05, 0.35], [0.1, 0.2]])
        >>> cells.tolist(), inside.tolist()
        ([[1, 2], [-1, -1]], [True, False])
        """
        places, inside, tolerance = self._bounded(points_xy)
        cells = cells_at(places, tolerance)
        return np.where(inside[:, np.newaxis], cells, -1), inside

    def bounded_continuous_rowcol_from_xy(
        self, points_xy: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Convert points to fractional cell coordinates, and return which lie inside the grid.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres; non-finite points are outside.

        Returns
        -------
        places : numpy.ndarray of float64, shape (N, 2)
            As for `continuous_rowcol_from_xy`, but points that are off a centre line of cells only
            by rounding are moved onto it; meaningless for non-finite points.
        inside : numpy.ndarray of bool, shape (N,)
            Whether each point lies in a cell of the grid.
        """
        places, inside, tolerance = self._bounded(points_xy)
        nearest = np.rint(places - 0.5) + 0.5
        return np.where(np.abs(places - nearest) <= tolerance, nearest, places), inside

    def _bounded(
        self, points_xy: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Return the places of points, which are inside, and the tolerance of each place."""
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        near = np.abs(points) <= FARTHEST  # refuses nan too
        known = near[:, 0] & near[:, 1]
        if not known.all():
            points = np.where(known[:, np.newaxis], points, 0.0)
        places = self.continuous_rowcol_from_xy(points)
        tolerance = self.tolerance_at(points)
        shifted = places + tolerance
        row, col = shifted[:, 0], shifted[:, 1]
        inside = known & (row >= 0) & (row < self.height) & (col >= 0) & (col < self.width)
        return places, inside, tolerance

    def rowcol_ahead(self, pose: Sequence[float], distance: float) -> tuple[int, int]:
        """Return the cell of a point ahead of a robot, inside the grid or not.

        Parameters
        ----------
        pose : sequence of float
            x, y (metres) and yaw (radians, 0 along x, anticlockwise) of the robot.
        distance : float
            Distance of the point, metres; negative for a point behind the robot.

        Examples
        --------
        >>> Frame.centred(20, 20, 0.1).rowcol_ahead((0.05, 0.05, math.pi / 2), 0.4)
        (14, 10)
        """
        point = xy_ahead(pose, distance)
        row, col = self.unbounded_rowcol_from_xy([point])[0].tolist()
        return row, col

    def xy_from_rowcol(self, cells_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Return the centres of cells in the map frame.

        Parameters
        ----------
        cells_rowcol : array_like, shape (N, 2)
            Rows and columns, inside the grid or not.

        Returns
        -------
        numpy.ndarray of float64, shape (N, 2)
            x and y of each centre, metres.

        Examples
        --------
        >>> Frame(2, 3, 0.5, (1.0, 2.0, 0.0)).xy_from_rowcol([[0, 0], [1, 2]])
        array([[1.25, 2.25],
               [2.25, 2.75]])
        """
        cells = np.asarray(cells_rowcol, dtype=np.float64).reshape(-1, 2)
        return self._xy_from_cells(cells[:, ::-1] + 0.5)

    def xy_from_continuous_rowcol(self, places_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Convert fractional cell coordinates, shape (N, 2), to points.

        This is the inverse of `continuous_rowcol_from_xy`.
        """
        places = np.asarray(places_rowcol, dtype=np.float64).reshape(-1, 2)
        return self._xy_from_cells(places[:, ::-1])

    def xy_vectors_from_rowcol(self, vectors_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Rotate vectors along rows and columns into the map frame, keeping their length.

        Parameters
        ----------
        vectors_rowcol : array_like of float, shape (N, 2)
            Components in the directions of increasing row and increasing column.

        Returns
        -------
        numpy.ndarray of float64, shape (N, 2)
            Components along x and y of the map frame, in the same unit.

        Examples
        --------
        >>> Frame(2, 3, 0.5, (1.0, 2.0, math.pi / 2)).xy_vectors_from_rowcol([[0, 3]]).round(9)
        array([[0., 3.]])
        """
        vectors = np.asarray(vectors_rowcol, dtype=np.float64).reshape(-1, 2)
        return turned(vectors[:, ::-1], self.origin[2])

    def _xy_from_cells(self, cells_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, yaw = self.origin
        points: NDArray[np.float64] = turned(cells_xy * self.resolution, yaw) + np.array([x, y])
        return points

    def holds(self, cell: tuple[int, int]) -> bool:
        """Return whether a cell (row, column) lies in the grid."""
        return 0 <= cell[0] < self.height and 0 <= cell[1] < self.width

    def contains(self, points_xy: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point, shape (N, 2), lies in a cell of the grid."""
        return self.bounded_rowcol_from_xy(points_xy)[1]

    def window(self, row: int, col: int, height: int, width: int) -> Frame:
        """Return the frame of `height` x `width` cells, starting at cell (`row`, `col`).

        Its origin is the corner of that cell, so that every cell keeps its place in the map frame
        whatever the yaw.
        """
        x, y, yaw = self.origin
        if yaw == 0.0:
            origin = (_stepped(x, col, self.resolution), _stepped(y, row, self.resolution), yaw)
        else:
            corner = self._xy_from_cells(np.array([[col, row]], dtype=np.float64))[0]
            origin = (float(corner[0]), float(corner[1]), yaw)
        return Frame(height, width, self.resolution, origin)


def xy_ahead(pose: Sequence[float], distance: float) -> tuple[float, float]:
    """Return the point `distance` metres ahead of a pose (x, y, yaw), in the same frame.

    Examples
    --------
    >>> xy_ahead((1.0, 2.0, math.pi), 0.5)
    (0.5, 2.0)
    """
    x, y, yaw = (float(value) for value in pose)
    return x + distance * math.cos(yaw), y + distance * math.sin(yaw)


def _stepped(start: float, steps: int, step: float) -> float:
    """Return start + steps * step in decimals: -50 + 789 * 0.05 is -10.55, with no noise."""
    # Origins and resolutions are decimal numbers in a file; the sum of the floats nearest to them
    # would put the last digits of binary rounding into the next file.
    from decimal import Decimal  # slow to import

    return float(Decimal(repr(start)) + steps * Decimal(repr(step)))


@dataclass(frozen=True, slots=True, repr=False)
class Transform(OneLine):
    """A rigid transform from one map frame to another: p_to = R(yaw) p_from + (x, y).

    Parameters
    ----------
    x, y : float
        Translation in the target frame, metres.
    yaw : float
        Rotation, anticlockwise, normalised to -pi..pi, radians.

    Raises
    ------
    ParameterError
        If a number is not finite, or larger than 1e12.

    Examples
    --------
    >>> quarter = Transform(1.0, 2.0, math.pi / 2)
    >>> quarter.points([[3.0, 0.0]]).round(9).tolist()
    [[1.0, 5.0]]
    >>> quarter.inverse().points([[1.0, 5.0]]).round(9).tolist()
    [[3.0, 0.0]]
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            value = float(getattr(self, name))
            if not abs(value) <= FARTHEST:  # refuses nan too
                raise ParameterError("must be a finite number", place=name, got=value)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "yaw", math.remainder(self.yaw, 2 * math.pi))

    def _told(self) -> Iterator[str]:
        yield f"x {self.x:.10g} m"
        yield f"y {self.y:.10g} m"
        yield f"yaw {self.yaw:.10g} rad"

    @property
    def pose(self) -> tuple[float, float, float]:
        """Translation and rotation as x, y (metres) and yaw (radians)."""
        return self.x, self.y, self.yaw

    @classmethod
    def from_pose(cls, pose: Sequence[float]) -> Transform:
        """Create the transform from the frame whose origin is at a pose x, y, yaw."""
        x, y, yaw = pose
        return cls(x, y, yaw)

    def points(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Transform points, shape (N, 2), metres."""
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        moved = turned(points, self.yaw)
        moved += (self.x, self.y)
        return moved

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        x, y = turned(np.array([[-self.x, -self.y]]), -self.yaw)[0]
        return Transform(x, y, -self.yaw)

    def after(self, first: Transform) -> Transform:
        """Return the transform that applies `first` and then this one.

        Examples
        --------
        >>> shift, turn = Transform(1.0, 0.0), Transform(yaw=math.pi / 2)
        >>> turn.after(shift).points([[0.0, 0.0]]).round(9).tolist()
        [[0.0, 1.0]]
        """
        x, y = self.points([[first.x, first.y]])[0]
        return Transform(x, y, first.yaw + self.yaw)

    def frame(self, frame: Frame) -> Frame:
        """Transform the frame of a grid.

        The cells stay the same; their corner is moved and their axes are rotated.
        """
        if self.pose == (0.0, 0.0, 0.0):
            return frame
        x, y = self.points([frame.origin[:2]])[0]
        yaw = math.remainder(frame.origin[2] + self.yaw, 2 * math.pi)
        return Frame(*frame.shape, frame.resolution, (float(x), float(y), yaw))


MOST_CELLS = 1_000_000_000
"""Of a window that is made."""


_TOUCHING = 1e-6
"""In cells: borders that differ by less are the same on paper."""


class Region(NamedTuple):
    """A rectangle of cells, inside a grid or not: its first cell and its size."""

    row: int
    col: int
    height: int
    width: int

    @property
    def cells(self) -> int:
        return self.height * self.width

    def shared_with(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Return the rows and columns of a grid that lie in the region; they may be none."""
        rows = _overlap(self.row, self.height, shape[0])
        return rows, _overlap(self.col, self.width, shape[1])

    def holds(self, cells_rowcol: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether each cell, shape (N, 2), lies in the region."""
        from_first = cells_rowcol - (self.row, self.col)
        inside: NDArray[np.bool_] = (from_first >= 0) & (from_first < (self.height, self.width))
        return inside[:, 0] & inside[:, 1]

    def place_of(self, rows: slice, cols: slice) -> tuple[slice, slice]:
        """Return where rows and columns of the grid lie in an array of the region's size."""
        return (
            slice(rows.start - self.row, rows.stop - self.row),
            slice(cols.start - self.col, cols.stop - self.col),
        )

    def frame_in(self, frame: Frame) -> Frame:
        if self.height * self.width > MOST_CELLS:
            rule = f"a window must not have more than {MOST_CELLS} cells"
            raise ParameterError(rule, place="size", got=(self.width, self.height))
        return frame.window(self.row, self.col, self.height, self.width)


def region_of(
    frame: Frame, size_xy: Point, *, corner_xy: Point | None = None, center_xy: Point | None = None
) -> Region:
    """Return the cells of a region in metres."""
    size_x, size_y = check_point(size_xy, "size")
    corner_xy, center_xy = (
        None if point is None else check_point(point, name)
        for point, name in ((corner_xy, "corner"), (center_xy, "center"))
    )
    if not (size_x > 0 and size_y > 0):
        rule = "must be two numbers of metres above 0"
        raise ParameterError(rule, place="size", got=(size_x, size_y))
    if corner_xy is not None and center_xy is None:
        row, col = frame.unbounded_rowcol_from_xy([corner_xy])[0].tolist()
    elif center_xy is not None and corner_xy is None:
        middle = frame.continuous_rowcol_from_xy([center_xy])[0]
        half = np.array([size_y, size_x]) / frame.resolution / 2
        row, col = cells_at(middle - half, frame.tolerance_at([center_xy])[0]).tolist()
    else:
        raise ParameterError("either a corner or a center must be given", place="region")
    height, width = (cells_to_cover(size, frame.resolution) for size in (size_y, size_x))
    return Region(row, col, max(height, 1), max(width, 1))


def region_around(frame: Frame, other: Frame) -> Region:
    """Return the cells of a lattice that hold all of another grid."""
    corners = [[row, col] for row in (0, other.height) for col in (0, other.width)]
    places = frame.continuous_rowcol_from_xy(other.xy_from_continuous_rowcol(corners))
    row, col = np.floor(places.min(axis=0) + _TOUCHING).astype(int).tolist()
    top, right = np.ceil(places.max(axis=0) - _TOUCHING).astype(int).tolist()
    return Region(row, col, top - row, right - col)


def _overlap(first: int, count: int, size: int) -> slice:
    """Return the part of `first` .. `first` + `count` that lies in 0 .. `size`, perhaps empty."""
    start = min(max(first, 0), size)
    return slice(start, max(start, min(first + count, size)))
