"""Geometry of grids: frames, regions, transforms, and the base classes of all grids."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from importlib import import_module
from numbers import Real
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mapdeal.compatibility import Self
from mapdeal.errors import ParameterError, emit_warning, is_called_by_user, require
from mapdeal.grid import values as map_values
from mapdeal.grid.values import OneLineRepr, OverlayType, numbers_text
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.kernels.blocks import Layer, LazyLayer, is_lazy
from mapdeal.kernels.polygons import Spans, paint
from mapdeal.records import dataclass, replace

CELL_TOLERANCE = 1e-9  # cells: a length divided by the resolution may be off by 1e-16 of itself
RADIUS_TOLERANCE = 1e-9  # metres: 6 * 0.05 and 0.3 differ in their last bits
Origin = tuple[float, float, float]
Point = tuple[float, float]
CloudFrame = Literal["robot", "map"]  # of the coordinates in a point cloud
_Real = TypeVar("_Real", bound=np.floating[Any])

# Far beyond any robot; within these limits no product of lengths and cells overflows.
_SMALLEST_CELL, _LARGEST_CELL = 1e-6, 1e6
FARTHEST = 1e12  # largest coordinate and length, metres
_RESOLUTION_RULE = f"resolution must lie between {_SMALLEST_CELL:g} and {_LARGEST_CELL:g} m"
_ORIGIN_RULE = f"origin must be three numbers x, y, yaw within {FARTHEST:g}"
_POINT_RULE = f"must be two numbers x, y within {FARTHEST:g} m"
ROUNDING = 4 * float(np.finfo(np.float64).eps)  # relative, of a coordinate less the origin, turned
_PRECISION = (ROUNDING, CELL_TOLERANCE, FARTHEST)
MOST_CELLS = 1_000_000_000  # of a new window
_TOUCHING = 1e-6  # cells; borders that differ by less coincide
Figures = dict[str, Any]  # the figures of a grid, as JSON can hold them


def as_float32(value: float) -> float:
    """Return a number rounded to float32, as in ROS messages; infinity if it is too large."""
    with np.errstate(over="ignore"):
        return float(np.float32(value))


def cells_to_cover(length: float, resolution: float) -> int:
    """Return how many cells it takes to cover `length` metres, exact multiples exactly."""
    return math.ceil(length / resolution - CELL_TOLERANCE)


def largest_square_within(radius: float, resolution: float) -> int:
    """Return the largest whole number s with sqrt(s) * resolution <= radius, exact ones exactly."""
    bound = radius + RADIUS_TOLERANCE
    square = math.floor((bound / resolution) ** 2)
    while math.sqrt(square + 1) * resolution <= bound:
        square += 1
    while square > 0 and math.sqrt(square) * resolution > bound:
        square -= 1
    return square


def as_numbers(values: Iterable[float]) -> tuple[float, ...]:
    """Return values as floats; empty unless all are numbers."""
    try:
        return tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        return ()


def warn_of_degrees(yaw: float, place: str) -> None:
    if abs(yaw) > 2 * math.pi:
        emit_warning(f"{place}: a yaw of {yaw:.6g} rad is more than a turn; is it in degrees?")


def are_near(values: Iterable[float], limit: float = FARTHEST) -> bool:
    return all(abs(value) <= limit for value in values)  # refuses nan too


def check_resolution(resolution: float) -> float:
    (value,) = as_numbers([resolution]) or (math.nan,)
    require(_SMALLEST_CELL <= value <= _LARGEST_CELL, _RESOLUTION_RULE, got=resolution)
    return value


def check_origin(origin: Sequence[float]) -> Origin:
    values = as_numbers(origin)
    require(len(values) == 3 and are_near(values), _ORIGIN_RULE, got=origin)
    return values[0], values[1], values[2]


def check_point(point: Sequence[float], name: str) -> Point:
    values = as_numbers(point)
    require(len(values) == 2, "must be two numbers x, y", name, got=point)
    require(are_near(values), _POINT_RULE, name, got=values)
    return values[0], values[1]


def turned(vectors_xy: NDArray[_Real], angle: float) -> NDArray[_Real]:
    """Return vectors, shape (N, 2), turned anticlockwise by an angle, radians."""
    cos, sin = math.cos(angle), math.sin(angle)
    # the rounding of a matrix product would depend on the number of vectors
    x, y = vectors_xy[:, 0], vectors_xy[:, 1]
    result = np.empty_like(vectors_xy)
    result[:, 0] = x * cos - y * sin
    result[:, 1] = x * sin + y * cos
    return result


def cells_at(places_rowcol: ArrayLike, tolerance: ArrayLike) -> NDArray[np.int64]:
    return np.floor(np.asarray(places_rowcol) + tolerance).astype(np.int64)


@dataclass(frozen=True)
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

    All methods take array_like arguments of shape (N, 2): points are x and y in the map frame,
    metres; cells are row and column, int64 where they are returned; places are fractional cells,
    float64, whole at the edges between cells and at +0.5 in their centres. A point that is not
    finite, or beyond 1e12 m, raises ParameterError, unless the method returns a mask of inside.
    """

    height: int
    width: int
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("height", "width"):
            require(getattr(self, name) >= 0, "must not be negative", name, got=getattr(self, name))
        # the repr of numpy's numbers includes their type
        object.__setattr__(self, "resolution", float(self.resolution))
        x, y, yaw = map(float, self.origin)
        if is_called_by_user(above=1):
            warn_of_degrees(yaw, "origin")
        object.__setattr__(self, "origin", (x, y, yaw))

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
        """Create a frame centred on (0, 0), the lower corner of cell (height // 2, width // 2).

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
        """Convert points to places, as Nav2's ``worldToMapContinuous`` does."""
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        near = np.abs(points) <= FARTHEST  # refuses nan too
        if not near.all():
            rule = f"coordinates must be finite and within {FARTHEST:g} m"
            first = points[near.all(axis=1).argmin()]
            raise ParameterError(rule, place="point", got=tuple(first.tolist()))
        x, y, yaw = self.origin
        return (turned(points - np.array([x, y]), -yaw) / self.resolution)[:, ::-1]

    def tolerance_at(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Return the rounding error of coordinates in cells, shape (N, 1), larger far away."""
        points = np.abs(np.asarray(points_xy, dtype=np.float64).reshape(-1, 2))
        x, y, _ = self.origin
        largest = np.maximum(points[:, :1], points[:, 1:])  # faster than max along short rows
        np.maximum(largest, max(abs(x), abs(y)), out=largest)
        tolerance: NDArray[np.float64] = ROUNDING * largest / self.resolution
        return np.maximum(CELL_TOLERANCE, tolerance)

    def unbounded_rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.int64]:
        """Convert points to cells, as if the grid were unbounded.

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
        from mapdeal.kernels.sensing import cells_of_points  # slow to import

        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        cells = cells_of_points(points, self.origin, self.resolution, _PRECISION)
        if cells is None:
            cells = cells_at(self.continuous_rowcol_from_xy(points), self.tolerance_at(points))
        return cells

    def clamped_rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.int64]:
        """Convert points to cells; points outside the grid go to the nearest border cell.

        References
        ----------
        costmap_2d's ``worldToMapEnforceBounds``. Nav2's version returns a cell beyond the last
        one for a point exactly on an upper edge; this method does not.
        """
        last = np.array([self.height - 1, self.width - 1])
        return np.clip(self.unbounded_rowcol_from_xy(points_xy), 0, last)

    def bounded_rowcol_from_xy(self, points_xy: ArrayLike) -> tuple[Integers, Mask]:
        """Convert points to cells, (-1, -1) outside, and return which are inside, bool (N,).

        References
        ----------
        costmap_2d's ``worldToMap``, whose return value is the second array.
        """
        places, inside, tolerance = self._bounded(points_xy)
        return np.where(inside[:, np.newaxis], cells_at(places, tolerance), -1), inside

    def bounded_continuous_rowcol_from_xy(self, points_xy: ArrayLike) -> tuple[Floats, Mask]:
        """Convert points to places, and return which are inside the grid, bool (N,).

        Places are moved by rounding errors onto centre lines; those of nan and inf mean nothing.
        """
        places, inside, tolerance = self._bounded(points_xy)
        nearest = np.rint(places - 0.5) + 0.5
        return np.where(np.abs(places - nearest) <= tolerance, nearest, places), inside

    def place_in_cell(self, point_xy: Point) -> tuple[float, float] | None:
        """Return the place of a point, inside the cell that contains it; None outside the grid.

        A point at an edge is moved off it by 1e-9 cells: rounding may put it into the cell beside,
        and lines that end on a corner may come from any of four cells.
        """
        places, inside = self.bounded_continuous_rowcol_from_xy([point_xy])
        if not inside[0]:
            return None
        cell = self.bounded_rowcol_from_xy([point_xy])[0][0]
        row, col = np.clip(places[0], cell + CELL_TOLERANCE, cell + 1 - CELL_TOLERANCE).tolist()
        return row, col

    def _bounded(self, points_xy: ArrayLike) -> tuple[Floats, Mask, Floats]:
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
        """Return the cell of a point `distance` metres ahead of a pose, inside the grid or not.

        Examples
        --------
        >>> Frame.centred(20, 20, 0.1).rowcol_ahead((0.05, 0.05, math.pi / 2), 0.4)
        (14, 10)
        """
        row, col = self.unbounded_rowcol_from_xy([xy_ahead(pose, distance)])[0].tolist()
        return row, col

    def xy_from_rowcol(self, cells_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Return the centres of cells, inside the grid or not, as points, float64."""
        return self.xy_from_continuous_rowcol(np.asarray(cells_rowcol, dtype=np.float64) + 0.5)

    def xy_from_continuous_rowcol(self, places_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Convert places to points, float64: the inverse of `continuous_rowcol_from_xy`."""
        x, y, yaw = self.origin
        places = np.asarray(places_rowcol, dtype=np.float64).reshape(-1, 2)
        points: NDArray[np.float64] = turned(places[:, ::-1] * self.resolution, yaw)
        points += (x, y)
        return points

    def xy_vectors_from_rowcol(self, vectors_rowcol: ArrayLike) -> NDArray[np.float64]:
        """Rotate vectors along rows and columns into the map frame, float64, same length."""
        vectors = np.asarray(vectors_rowcol, dtype=np.float64).reshape(-1, 2)
        return turned(vectors[:, ::-1], self.origin[2])

    def holds(self, cell: tuple[int, int]) -> bool:
        """Return whether a cell (row, column) lies in the grid."""
        return 0 <= cell[0] < self.height and 0 <= cell[1] < self.width

    def contains(self, points_xy: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point lies in a cell of the grid, bool (N,)."""
        return self.bounded_rowcol_from_xy(points_xy)[1]

    def window(self, row: int, col: int, height: int, width: int) -> Frame:
        """Return the frame of `height` x `width` cells from cell (`row`, `col`) on, in place."""
        x, y, yaw = self.origin
        if yaw == 0.0:
            x, y = _stepped(x, col, self.resolution), _stepped(y, row, self.resolution)
        else:
            x, y = self.xy_from_continuous_rowcol([[row, col]])[0].tolist()
        return Frame(height, width, self.resolution, (x, y, yaw))


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
    # a sum of floats would write the digits of binary rounding into files
    from decimal import Decimal  # slow to import

    return float(Decimal(repr(start)) + steps * Decimal(repr(step)))


@dataclass(frozen=True, repr=False)
class Transform(OneLineRepr):
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
            value = getattr(self, name)
            is_number = isinstance(value, Real) and are_near([float(value)])
            require(is_number, "must be a finite number", name, got=value)
            object.__setattr__(self, name, float(value))
        warn_of_degrees(self.yaw, "yaw")
        object.__setattr__(self, "yaw", math.remainder(self.yaw, 2 * math.pi))

    def _repr_parts(self) -> Iterator[str]:
        yield from (f"x {self.x:.10g} m", f"y {self.y:.10g} m", f"yaw {self.yaw:.10g} rad")

    @property
    def pose(self) -> tuple[float, float, float]:
        """Translation and rotation as x, y (metres) and yaw (radians)."""
        return self.x, self.y, self.yaw

    def points(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Transform points, shape (N, 2), metres."""
        moved = turned(np.asarray(points_xy, dtype=np.float64).reshape(-1, 2), self.yaw)
        moved += (self.x, self.y)
        return moved

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        x, y = turned(np.array([[-self.x, -self.y]]), -self.yaw)[0]
        return Transform(x, y, -self.yaw)

    def after(self, first: Transform) -> Transform:
        """Return the transform that applies `first` and then this one."""
        x, y = self.points([[first.x, first.y]])[0]
        return Transform(x, y, first.yaw + self.yaw)

    def frame(self, frame: Frame) -> Frame:
        """Transform the frame of a grid: its corner is moved and its axes are turned."""
        if self.pose == (0.0, 0.0, 0.0):
            return frame
        x, y = self.points([frame.origin[:2]])[0]
        yaw = math.remainder(frame.origin[2] + self.yaw, 2 * math.pi)
        return Frame(*frame.shape, frame.resolution, (float(x), float(y), yaw))


class Region(NamedTuple):
    """A rectangle of cells, which may reach beyond the grid: its first cell and its size."""

    row: int
    col: int
    height: int
    width: int

    @classmethod
    def spanning(cls, in_rows: Mask, in_cols: Mask, *, grow: int = 0) -> Region | None:
        """Return the region of all marked rows and columns, grown by cells within the grid."""
        spans = []
        for lines in (in_rows, in_cols):
            if not lines.any():
                return None
            first = max(int(lines.argmax()) - grow, 0)
            end = min(len(lines) - int(lines[::-1].argmax()) + grow, len(lines))
            spans.append((first, end - first))
        (row, height), (col, width) = spans
        return cls(row, col, height, width)

    @property
    def cells(self) -> int:
        return self.height * self.width

    def shared_with(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        return _overlap(self.row, self.height, shape[0]), _overlap(self.col, self.width, shape[1])

    def holds(self, cells_rowcol: NDArray[np.int64]) -> NDArray[np.bool_]:
        from_first = cells_rowcol - (self.row, self.col)
        inside: NDArray[np.bool_] = (from_first >= 0) & (from_first < (self.height, self.width))
        return inside[:, 0] & inside[:, 1]

    def place_of(self, rows: slice, cols: slice) -> tuple[slice, slice]:
        """Return the rows and columns of the grid as slices of an array of the region."""
        from_first = slice(rows.start - self.row, rows.stop - self.row)
        return from_first, slice(cols.start - self.col, cols.stop - self.col)

    def frame_in(self, frame: Frame) -> Frame:
        rule = f"a window must not have more than {MOST_CELLS} cells"
        require(self.cells <= MOST_CELLS, rule, "size", got=(self.width, self.height))
        return frame.window(self.row, self.col, self.height, self.width)


def region_of(
    frame: Frame, size_xy: Point, *, corner_xy: Point | None = None, center_xy: Point | None = None
) -> Region:
    size = size_x, size_y = check_point(size_xy, "size")
    require(min(size) > 0, "must be two numbers of metres above 0", "size", got=size)
    if corner_xy is not None and center_xy is None:
        row, col = frame.unbounded_rowcol_from_xy([check_point(corner_xy, "corner")])[0].tolist()
    elif center_xy is not None and corner_xy is None:
        center = [check_point(center_xy, "center")]
        half = np.divide(size[::-1], frame.resolution) / 2
        first = frame.continuous_rowcol_from_xy(center)[0] - half
        row, col = cells_at(first, frame.tolerance_at(center)[0]).tolist()
    else:
        raise ParameterError("needs either a corner or a center", place="region")
    height, width = (cells_to_cover(size, frame.resolution) for size in (size_y, size_x))
    return Region(row, col, max(height, 1), max(width, 1))


def corners_of(frame: Frame) -> Floats:
    corners = [[row, col] for row in (0, frame.height) for col in (0, frame.width)]
    return frame.xy_from_continuous_rowcol(corners)


def region_around(frame: Frame, contents: Frame) -> Region:
    places = frame.continuous_rowcol_from_xy(corners_of(contents))
    row, col = np.floor(places.min(axis=0) + _TOUCHING).astype(int).tolist()
    top, right = np.ceil(places.max(axis=0) - _TOUCHING).astype(int).tolist()
    return Region(row, col, top - row, right - col)


def _overlap(first: int, count: int, size: int) -> slice:
    start = min(max(first, 0), size)
    return slice(start, max(start, min(first + count, size)))


class Framed(map_values.Drawn, ABC):
    """Base class of all grids; layers are arrays or lazy: `layer[rows]` works for both."""

    kind: ClassVar[str]  # name of the type in messages
    layer_names: ClassVar[tuple[str, ...]]  # attributes with layers, the main one first
    parameter_names: ClassVar[tuple[str, ...]] = ()  # attributes with parameters
    resolution: float
    origin: Origin

    @property
    def layer(self) -> Layer:
        """Main layer, whose shape all other layers share."""
        return cast("Layer", getattr(self, self.layer_names[0]))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        height, width = self.layer.shape
        return height, width

    @property
    def is_lazy(self) -> bool:
        """Whether the layers are computed block by block, on demand."""
        return is_lazy(self.layer)

    def part(self, rows: slice) -> Self:
        """Return some rows, loaded into memory, at their place in the map frame."""
        first, end, _ = rows.indices(self.shape[0])
        if not self.is_lazy and (first, end) == (0, self.shape[0]):
            return self
        part = copy(self)
        frame = self.frame.window(first, 0, end - first, self.shape[1])
        object.__setattr__(part, "origin", frame.origin)
        for name in self.layer_names:
            object.__setattr__(part, name, getattr(self, name)[rows])
        return part

    def with_layer(self, layer: Layer) -> Self:
        """Return the grid with its layer replaced by another one with the same values."""
        copied = copy(self)
        object.__setattr__(copied, self.layer_names[0], layer)
        return copied

    def figures(self) -> Figures:
        """Return the grid's size, place and counts as a JSON-serialisable dict."""
        return {**self.frame_figures(), **self._own_figures()}

    def frame_figures(self) -> Figures:
        """Return the grid's size and place as a JSON-serialisable dict."""
        height, width = self.shape
        place = {"resolution": self.resolution, "origin": list(self.origin)}
        return {"width": width, "height": height, **place}

    @abstractmethod
    def _own_figures(self) -> Figures: ...

    def _repr_parts(self) -> Iterator[str]:
        height, width = self.shape
        yield f"{width} x {height} cells"
        yield f"{self.resolution:.10g} m"
        yield f"origin {numbers_text(self.origin)}"
        yield from self._repr_parameters()
        if not self.is_lazy and height * width <= map_values.MOST_COUNTED:
            yield from self._repr_values()

    def _repr_parameters(self) -> Iterator[str]:
        yield from ()

    @abstractmethod
    def _repr_values(self) -> Iterator[str]: ...

    def entries(self) -> dict[str, Any]:
        """Return the entries of an npz besides the geometry: layers and parameters by key."""
        return {name: getattr(self, name) for name in self.layer_names}

    @property
    def frame(self) -> Frame:
        """Geometry of the grid."""
        return Frame(*self.shape, self.resolution, self.origin)

    def equals(self, other: object) -> bool:
        """Return whether another grid is of the same type, frame, values and parameters.

        As in xarray, nan equals nan. The operator ``==`` compares the identity of the objects.

        Parameters
        ----------
        other : object
            Usually a grid; anything else differs.
        """
        if type(other) is not type(self) or other.frame != self.frame:
            return False
        mine, theirs = (
            {name: np.asarray(value[:] if is_lazy(value) else value) for name, value in entries}
            for entries in (self.entries().items(), other.entries().items())
        )
        return mine.keys() == theirs.keys() and all(
            np.array_equal(array, theirs[name], equal_nan=array.dtype.kind == "f")
            for name, array in mine.items()
        )

    # What other libraries take; they are imported when they are used.

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the main layer, shape (H, W), row 0 in the south."""
        array: NDArray[Any] = np.asarray(self.layer[0 : self.shape[0]], dtype=dtype)
        return array.copy() if copy else array

    @property
    def transform(self) -> NDArray[np.float64]:
        """Matrix from column, row, 1 (cells, whole at edges) to x, y, 1 (metres), shape (3, 3)."""
        x, y, yaw = self.frame.origin
        cos, sin = (self.frame.resolution * f(yaw) for f in (math.cos, math.sin))
        return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x and largest y of the grid's corners, metres."""
        height, width = self.frame.shape
        corners = [(0, 0), (height, 0), (0, width), (height, width)]
        corners_xy = [self.frame.window(*corner, 1, 1).origin for corner in corners]
        xs, ys, _ = zip(*corners_xy, strict=True)
        return min(xs), min(ys), max(xs), max(ys)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top, metres: what ``plt.imshow(grid, extent=...)`` takes.

        Raises
        ------
        ParameterError
            If the grid is rotated: `plot` draws it, `straighten` turns it back.
        """
        if self.frame.origin[2] != 0:
            rule = "has no meaning for a rotated grid"
            hint = "grid.plot() draws it rotated, mapdeal.straighten(grid) turns it back"
            raise ParameterError(rule, place="extent", got=self.frame.origin, hint=hint)
        x_min, y_min, x_max, y_max = self.bounds
        return x_min, x_max, y_min, y_max

    def plot(self, ax: Any = None, **options: Any) -> Any:
        """Draw the main layer with matplotlib, in metres.

        Free cells of maps are white, obstacles black and unknown cells light blue. In costmaps,
        free cells are white, graded costs yellow to purple, inscribed cells cyan, lethal cells
        black and unknown cells grey.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default the current ones.
        **options
            Further arguments of ``Axes.imshow``, such as ``cmap`` and ``vmax``.

        Returns
        -------
        matplotlib.axes.Axes
            The axes drawn on.

        Raises
        ------
        ParameterError
            If matplotlib is not installed.
        """
        axes = library("matplotlib.pyplot").gca() if ax is None else ax
        height, width = (count * self.frame.resolution for count in self.frame.shape)
        x, y, yaw = self.frame.origin
        place = library("matplotlib.transforms").Affine2D().rotate(yaw).translate(x, y)
        look: Any = {"origin": "lower", "interpolation": "nearest"}
        look["extent"] = (0.0, width, 0.0, height)
        colours = {} if "norm" in options else self._colours()
        image = axes.imshow(self._drawn_values(), **{**look, **colours, **options})
        image.set_transform(place + axes.transData)
        x_min, y_min, x_max, y_max = self.bounds
        axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), xlabel="x, m", ylabel="y, m")
        return axes

    def to_xarray(self) -> Any:
        """Return the main layer as an ``xarray.DataArray`` with coordinates of cell centres.

        Returns
        -------
        xarray.DataArray
            Dimensions ``y`` and ``x`` with coordinates in metres; of a rotated grid ``row`` and
            ``col``, with coordinates ``x`` and ``y`` of shape (H, W). Its attributes are
            ``resolution``, ``origin`` and ``units`` of the coordinates.

        Raises
        ------
        ParameterError
            If xarray is not installed.
        """
        height, width = self.frame.shape
        rows, cols = np.arange(height), np.arange(width)
        place = {"resolution": self.frame.resolution, "origin": self.frame.origin, "units": "m"}
        coordinates: dict[str, Any]
        if self.frame.origin[2] == 0:
            x = self.frame.xy_from_rowcol(np.stack([0 * cols, cols], axis=1))[:, 0]
            y = self.frame.xy_from_rowcol(np.stack([rows, 0 * rows], axis=1))[:, 1]
            dimensions, coordinates = ("y", "x"), {"y": y, "x": x}
        else:
            cells = np.indices((height, width)).reshape(2, -1).T
            xy = self.frame.xy_from_rowcol(cells).reshape(height, width, 2)
            dimensions = ("row", "col")
            coordinates = {"x": (dimensions, xy[..., 0]), "y": (dimensions, xy[..., 1])}
        array = library("xarray").DataArray
        return array(np.asarray(self), coordinates, dimensions, self.layer_names[0], place)

    def _drawn_values(self) -> NDArray[Any]:
        return np.asarray(self)

    def _colours(self) -> dict[str, Any]:
        return {"cmap": "viridis"}

    def _freeze(self, **layers: Layer) -> None:
        object.__setattr__(self, "resolution", check_resolution(self.resolution))
        object.__setattr__(self, "origin", check_origin(self.origin))
        if is_called_by_user(above=2):  # a file's yaw was checked as it was read
            warn_of_degrees(self.origin[2], "origin")
        shape, *more_shapes = {array.shape for array in layers.values()}
        rule = "layers must be two-dimensional, of one shape and not empty"
        if more_shapes or len(shape) != 2 or 0 in shape:
            raise ParameterError(rule, got=sorted([shape, *more_shapes]))
        for name, layer in layers.items():
            if not is_lazy(layer):
                layer = np.ascontiguousarray(layer).view()
                layer.flags.writeable = False
            object.__setattr__(self, name, layer)


class CellSamples(NamedTuple):
    """Values of a grid's cells at N points.

    Parameters
    ----------
    values : numpy.ndarray of int8 or uint8, shape (N,)
        Value of the cell that contains each point, on the grid's scale; unknown outside.
    inside : numpy.ndarray of bool, shape (N,)
        Whether each point lies within the grid.
    """

    values: NDArray[Any]
    inside: NDArray[np.bool_]

    def __repr__(self) -> str:
        points = map_values.count_text(len(self.values), "point")
        return f"CellSamples({points}, {np.count_nonzero(self.inside)} inside)"


class ValueGrid(Framed):
    """A grid with one value per cell: a map or a costmap, on any scale."""

    @property
    @abstractmethod
    def value_range(self) -> tuple[int, int]:
        """Smallest and largest value of the scale."""

    @property
    @abstractmethod
    def unknown_value(self) -> int:
        """Value of an unknown cell."""

    @property
    def outside_values(self) -> dict[str, float]:
        """Value of each layer in cells added around the grid: unknown."""
        return {self.layer_names[0]: self.unknown_value}

    @property
    def values(self) -> NDArray[Any]:
        """Values of the cells, shape (H, W), read-only."""
        return self.layer

    def query(self, points_xy: ArrayLike) -> CellSamples:
        """Return the values of the cells that contain some points.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, or a single point, metres.

        Raises
        ------
        ParameterError
            If `points_xy` has another shape.

        Examples
        --------
        >>> from mapdeal import OccupancyGrid
        >>> samples = OccupancyGrid([[0, 100, -1]], 0.5).query([[0.7, 0.1], [9.0, 0.0]])
        >>> samples, samples.values.tolist()
        (CellSamples(2 points, 1 inside), [100, -1])
        """
        points = as_points(points_xy)
        cells = self.frame.unbounded_rowcol_from_xy(points)
        inside = np.all((cells >= 0) & (cells < self.shape), axis=1)
        values = np.full(len(points), self.unknown_value, dtype=self.values.dtype)
        values[inside] = np.asarray(self)[tuple(cells[inside].T)]
        return CellSamples(values, inside)

    @abstractmethod
    def to_occupancy(self) -> ValueGrid:
        """Return the grid as ROS publishes it, -1..100."""

    def to_msg(
        self, message_type: Callable[[], Any] | None = None, *, frame_id: str = "map"
    ) -> Any:
        """Return the grid as a ``nav_msgs/OccupancyGrid``; `mapdeal.from_msg` reads it.

        Parameters
        ----------
        message_type : type, optional
            ``nav_msgs.msg.OccupancyGrid`` of ROS 1 or 2; by default a plain dict is returned.
        frame_id : str
            Frame of the header. Costs are as ROS publishes them, and time stamps are 0.

        Examples
        --------
        >>> from mapdeal import OccupancyGrid
        >>> message = OccupancyGrid([[0, 100, -1]], 0.5).to_msg()
        >>> message["data"], message["info"]["width"]
        ([0, 100, -1], 3)
        """
        x, y, yaw = self.origin
        half = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
        document = {
            "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id},
            "info": {
                "map_load_time": {"sec": 0, "nanosec": 0},
                "resolution": float(np.float32(self.resolution)),
                "width": self.shape[1],
                "height": self.shape[0],
                "origin": {"position": {"x": x, "y": y, "z": 0.0}, "orientation": half},
            },
            "data": np.asarray(self.to_occupancy()).ravel().tolist(),
        }
        if message_type is None:
            return document
        message = message_type()
        rule = "must be nav_msgs.msg.OccupancyGrid"
        require(hasattr(message, "header"), rule, "message_type", got=message_type)
        _fill(message, document)
        return message

    def _drawn_values(self) -> NDArray[Any]:
        return np.ma.masked_equal(np.asarray(self), self.unknown_value)

    def with_values(self, values: NDArray[Any], origin: Origin | None = None) -> Self:
        """Return a grid of the same kind with other values and, if given, another origin.

        Raises
        ------
        ParameterError
            If the values have another shape, and no origin is given.
        """
        shape = values.shape if is_lazy(values) else np.shape(values)
        rule = f"must have the shape of the grid, {self.shape}, unless an origin is given"
        require(origin is not None or shape == self.shape, rule, "values", got=shape)
        changes: dict[str, Any] = {self.layer_names[0]: values, "origin": origin or self.origin}
        return cast("Self", replace(cast("Any", self), **changes))

    def painted(
        self, strokes: Iterable[tuple[Spans, int | NDArray[np.int64]]], overlay: OverlayType = "seq"
    ) -> Self:
        """Return a grid with the cells of spans set to their values, one span after the other.

        For `overlay` see `mapdeal.draw`; with ``seq`` each run may have a value of its own.
        """
        values = self.values.copy()
        old = np.arange(256, dtype=np.uint8).view(values.dtype)
        unknown = old == self.unknown_value
        for spans, value in strokes:
            if overlay == "seq":
                paint(values, spans, value)
            elif value != self.unknown_value:
                wins = old < value if overlay == "max" else old > value
                paint(values, spans, value, over=wins | unknown)
        return self.with_values(values)

    def accept_value(self, value: float, name: str = "value") -> int:
        """Return `value`, a whole number on the grid's scale."""
        lowest, highest = self.value_range
        is_value = not isinstance(value, bool) and value in range(lowest, highest + 1)
        rule = f"must be a whole number from {lowest} to {highest}, the scale of this grid"
        require(is_value, rule, name, got=value)
        return int(value)


def as_points(points_xy: ArrayLike) -> NDArray[np.float64]:
    rule = "points must be an array of x, y pairs, shape (N, 2)"
    try:
        points = np.asarray(points_xy, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(rule, got=points_xy) from None
    if points.shape == (2,):
        points = points.reshape(1, 2)
    require(points.ndim == 2 and points.shape[1] == 2, rule, got=points.shape)
    return points


def as_layer(
    values: ArrayLike, dtype: type[np.generic], name: str, *, true: int = 1, rule: str | None = None
) -> Layer:
    """Return `values` as a layer of `dtype`, refusing conversions that change a value.

    In place of True the layer has the value `true`.
    """
    # The producer of a lazy layer is responsible for its values.
    if isinstance(values, LazyLayer) and values.dtype == dtype:
        return cast("Layer", values)
    if type(values).__name__ == "MaskedArray" and np.any(values.mask):  # type: ignore[union-attr]
        hint = "array.filled(value) gives masked cells a value, such as that of unknown cells"
        raise ParameterError(f"{name} must not have masked cells", hint=hint)
    rule = rule or f"{name} must hold values of {np.dtype(dtype).name}"
    try:
        array = np.asarray(values)
        array = array * np.uint8(true) if array.dtype == bool else array
        converted = array.astype(dtype, copy=False)
    except (TypeError, ValueError):
        raise ParameterError(rule, got=values) from None
    is_float = array.dtype.kind == "f"
    if array.dtype != dtype and not np.array_equal(converted, array, equal_nan=is_float):
        changed = array[(converted != array) & (array == array)]
        raise ParameterError(rule, got=changed.flat[0].item() if changed.size else array)
    return converted


def _fill(message: Any, document: Mapping[str, Any]) -> None:
    for name, value in document.items():
        if not isinstance(value, Mapping):
            setattr(message, name, value)
        elif name not in ("stamp", "map_load_time"):  # ROS 1 and 2 differ, and zero is the default
            _fill(getattr(message, name), value)


def library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        package, rule = name.partition(".")[0], "is not installed"
        raise ParameterError(rule, source=package, hint=f"pip install {package}") from None
