"""Where a grid lies in the map frame, and how cells and points convert."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError

CELL_TOLERANCE = 1e-9
"""In cells. Lengths that are exact multiples of the resolution on paper may come out of a
division one part in 1e16 short or long; the tolerance keeps them on their cell."""

Origin = tuple[float, float, float]

# Far beyond any robot; inside of them no product of lengths and cells overflows.
_SMALLEST_CELL, _LARGEST_CELL = 1e-6, 1e6
_FARTHEST = 1e12


def cells_to_cover(length: float, resolution: float) -> int:
    """Return how many cells it takes to cover `length` metres, exact multiples exactly.

    Examples
    --------
    >>> cells_to_cover(0.3, 0.1)  # 0.3 / 0.1 is 2.9999999999999996, and 0.6 / 0.2 too
    3
    >>> cells_to_cover(0.31, 0.1)
    4
    """
    return math.ceil(length / resolution - CELL_TOLERANCE)


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
    if len(values) != 3 or not all(abs(value) <= _FARTHEST for value in values):
        rule = f"origin must be three numbers x, y, yaw within {_FARTHEST:g}"
        raise ParameterError(rule, got=tuple(origin))
    return values[0], values[1], values[2]


@dataclass(frozen=True, slots=True)
class Frame:
    """The geometry of a grid: its size and its place in the map frame.

    Parameters
    ----------
    height, width : int
        Number of rows and of columns. Row 0 is the south, the smallest y of an unrotated grid.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).

    Notes
    -----
    The grid is half open: its upper edges belong to no cell. A cell's centre lies half a
    cell from its corner.
    """

    height: int
    width: int
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    def _turn(self, vectors_xy: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
        cos, sin = math.cos(angle), math.sin(angle)
        turned: NDArray[np.float64] = vectors_xy @ np.array([[cos, sin], [-sin, cos]])
        return turned

    def rowcol_from_xy(self, points_xy: ArrayLike) -> NDArray[np.int64]:
        """Return the cells that points fall into, whether inside the grid or not.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, metres; finite.

        Returns
        -------
        numpy.ndarray of int64, shape (N, 2)
            Row and column of each; negative or beyond the size for points outside.

        Examples
        --------
        >>> Frame(2, 3, 0.1, (-0.2, 0.2, 0.0)).rowcol_from_xy([[0.05, 0.35], [-0.3, 0.2]])
        array([[ 1,  2],
               [ 0, -1]])
        """
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        x, y, yaw = self.origin
        cells_xy = self._turn(points - np.array([x, y]), -yaw) / self.resolution
        return np.floor(cells_xy[:, ::-1] + CELL_TOLERANCE).astype(np.int64)

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

    def _xy_from_cells(self, cells_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, yaw = self.origin
        points: NDArray[np.float64] = self._turn(cells_xy * self.resolution, yaw) + np.array([x, y])
        return points

    def contains(self, points_xy: ArrayLike) -> NDArray[np.bool_]:
        """Return for each point, shape (N, 2), whether a cell of the grid holds it."""
        cells = self.rowcol_from_xy(points_xy)
        inside: NDArray[np.bool_] = np.all((cells >= 0) & (cells < self.shape), axis=1)
        return inside

    def window(self, row: int, col: int, height: int, width: int) -> Frame:
        """Return the frame of the `height` x `width` cells whose first is (`row`, `col`).

        Its corner is that cell's corner, so that every cell keeps its place in the map frame
        whatever the yaw.
        """
        x, y, yaw = self.origin
        if yaw == 0.0:
            origin = (_stepped(x, col, self.resolution), _stepped(y, row, self.resolution), yaw)
        else:
            corner = self._xy_from_cells(np.array([[col, row]], dtype=np.float64))[0]
            origin = (float(corner[0]), float(corner[1]), yaw)
        return Frame(height, width, self.resolution, origin)


def _stepped(start: float, steps: int, step: float) -> float:
    """Return start + steps * step in decimals: -50 + 789 * 0.05 is -10.55, with no noise.

    Origins and resolutions are decimal numbers in a file; the sum of the floats nearest to them
    would put the last digits of binary rounding into the next file.
    """
    return float(Decimal(repr(start)) + steps * Decimal(repr(step)))


class Framed(ABC):
    """What every grid type shares: a resolution, an origin, and a frame made of both."""

    resolution: float
    origin: Origin

    @property
    @abstractmethod
    def _layer(self) -> NDArray[Any]:
        """The layer that all others have the shape of."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        height, width = self._layer.shape
        return height, width

    @property
    def frame(self) -> Frame:
        """The geometry of the grid."""
        return Frame(*self.shape, self.resolution, self.origin)

    def _freeze(self, **layers: NDArray[Any]) -> None:
        """Check the geometry and store each layer as a read-only view."""
        object.__setattr__(self, "resolution", check_resolution(self.resolution))
        object.__setattr__(self, "origin", check_origin(self.origin))
        shapes = {array.shape for array in layers.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
            rule = "layers must be two-dimensional, of one shape and not empty"
            raise ParameterError(rule, got=sorted(shapes))
        for name, array in layers.items():
            view = np.ascontiguousarray(array).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)


def as_layer(values: ArrayLike, dtype: type[np.generic], name: str) -> NDArray[Any]:
    """Return `values` as an array of `dtype`, refusing conversions that change a value."""
    array = np.asarray(values)
    if array.dtype != dtype:
        converted = array.astype(dtype)
        if not np.array_equal(converted, array, equal_nan=array.dtype.kind == "f"):
            rule = f"{name} must hold values of {np.dtype(dtype).name}"
            raise ParameterError(rule, got=array.dtype.name)
        array = converted
    return array
