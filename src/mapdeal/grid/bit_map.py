"""The bit map: an obstacle mask with eight cells per byte."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Origin, Point
from mapdeal.grid.framed import Figures, Framed, as_layer
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.shapes import Circle, Line
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OCCUPIED, OverlayType
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.polygons import Spans, paint


@dataclass(frozen=True, eq=False, repr=False)
class BitMap(Framed):
    """A grid of bits, packed eight cells per byte.

    Parameters
    ----------
    packed : array_like of uint8, shape (H, ceil(W / 8))
        Packed bits. The first cell of a row is the highest bit of its first byte, as in PBM P4
        and ``numpy.packbits``. Row 0 is the south. Kept as a read-only view; bits beyond the last
        cell of a row are set to 0.
    width : int
        Number of cells in a row, W; it need not be a multiple of 8.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).

    Raises
    ------
    ParameterError
        If the bytes do not fit the width, or the geometry is not finite.

    Notes
    -----
    Like all grids, a bit map is immutable: methods that change cells return a new one. It is
    cheapest to make many changes at once, by ``set`` with many cells or `mapdeal.draw` with many
    shapes.

    Examples
    --------
    >>> bits = BitMap.from_mask([[0, 1, 0], [0, 0, 7]], 0.5, (1.0, 2.0, 0.0))
    >>> bits.packed.tolist(), bits.get([[0, 1], [1, 1]]).tolist()
    ([[64], [32]], [True, False])
    """

    kind = "bit map"
    layer_names = ("packed",)

    packed: NDArray[np.uint8]
    width: int
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        packed = as_layer(self.packed, np.uint8, "packed")
        if packed.ndim != 2 or self.width < 1 or packed.shape[1] != (self.width + 7) // 8:
            rule = "packed must have two axes, the second as long as the width divided by 8"
            raise ParameterError(rule, got=(packed.shape, self.width))
        padding = 0xFF >> (self.width % 8) if self.width % 8 else 0
        if padding and (packed[:, -1] & padding).any():
            packed = packed.copy()
            packed[:, -1] &= 0xFF ^ padding
        self._freeze(packed=packed)

    def _own_figures(self) -> Figures:
        ones, cells = self.count(), self.shape[0] * self.shape[1]
        return {"occupied": ones, "free": cells - ones, "unknown": 0, "between": 0}

    def _told_of_values(self) -> Iterator[str]:
        yield f"{self.count()} ones"

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.packed.shape[0], self.width

    @classmethod
    def from_mask(
        cls, mask: ArrayLike, resolution: float, origin: Origin = (0.0, 0.0, 0.0)
    ) -> BitMap:
        """Create a bit map from an array, shape (H, W); every value above 0 is a 1.

        Examples
        --------
        >>> BitMap.from_mask([[-1, 0, 1, 200]], 0.5).packed.tolist()
        [[48]]
        """
        values = np.asarray(mask)
        if values.ndim != 2 or 0 in values.shape:
            rule = "a mask must be two-dimensional and not empty"
            raise ParameterError(rule, got=values.shape)
        ones = values if values.dtype == np.bool_ else values > 0  # of bool numpy compares slowly
        return cls(np.packbits(ones, axis=1), values.shape[1], resolution, origin)

    @classmethod
    def from_occupancy(
        cls, grid: OccupancyGrid, lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD
    ) -> BitMap:
        """Create the obstacle mask of a map: the cells at or above `lethal_threshold`.

        Unknown cells become 0.
        """
        return cls.from_mask(grid.occupied(lethal_threshold), grid.resolution, grid.origin)

    def to_mask(self) -> NDArray[np.bool_]:
        """Return the bits as an array of bool, shape (H, W)."""
        return np.unpackbits(self.packed, axis=1, count=self.width).view(np.bool_)

    def to_occupancy(self) -> OccupancyGrid:
        """Return a map whose obstacles are the ones and whose free cells are the zeros.

        Examples
        --------
        >>> BitMap.from_mask([[0, 1]], 0.5).to_occupancy().occupancy.tolist()
        [[0, 100]]
        """
        values = np.unpackbits(self.packed, axis=1, count=self.width).view(np.int8)
        values *= OCCUPIED
        return OccupancyGrid(values, self.resolution, self.origin)

    def contains(self, cells_rowcol: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each cell (row, column), shape (N, 2), lies in the grid."""
        rows, cols = np.asarray(cells_rowcol).reshape(-1, 2).T
        height, width = self.shape
        inside: NDArray[np.bool_] = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        return inside

    def get(self, cells_rowcol: ArrayLike) -> NDArray[np.bool_]:
        """Return the bits of cells.

        Parameters
        ----------
        cells_rowcol : array_like of int, shape (N, 2)
            Rows and columns.

        Returns
        -------
        numpy.ndarray of bool, shape (N,)

        Raises
        ------
        ParameterError
            If a cell lies outside the grid.
        """
        rows, cols = self._checked(cells_rowcol)
        bits: NDArray[np.bool_] = (self.packed[rows, cols >> 3] << (cols & 7) & 0x80) != 0
        return bits

    def set(self, cells_rowcol: ArrayLike, value: bool = True) -> BitMap:
        """Return a bit map with the given cells set to a value.

        Parameters
        ----------
        cells_rowcol : array_like of int, shape (N, 2)
            Rows and columns.
        value : bool
            New value of the cells.

        Raises
        ------
        ParameterError
            If a cell lies outside the grid.

        Examples
        --------
        >>> BitMap.from_mask([[0, 0, 0]], 0.5).set([[0, 2]]).to_mask().tolist()
        [[False, False, True]]
        """
        rows, cols = self._checked(cells_rowcol)
        mask = self.to_mask()
        mask[rows, cols] = value
        return self.with_packed(np.packbits(mask, axis=1))

    def fill(self, value: bool = True) -> Self:
        """Return a bit map with all cells set to a value."""
        return self.with_packed(np.full_like(self.packed, 0xFF if value else 0))

    def line(
        self, points_xy: Sequence[Point], *, thickness: float = 0.0, value: bool = True
    ) -> BitMap:  # fmt: skip
        """Return a bit map with a line drawn, clipped to the grid; see `mapdeal.Line`.

        Parameters
        ----------
        points_xy : sequence of (x, y)
            Points in the map frame, metres; each is joined to the next, ends included.
        thickness : float
            Thickness, metres; up to the side of a cell, the line is one cell wide.
        value : bool
            New value of the covered cells.

        Examples
        --------
        >>> bits = BitMap.from_mask([[0, 0, 0, 0]], 1.0).line([(1.5, 0.5), (2.5, 0.5)])
        >>> bits.to_mask().tolist()
        [[False, True, True, False]]
        """
        spans = Line(points_xy, thickness).spans(self.frame)
        return self.painted((part, value) for part in spans)

    def circle(self, center_xy: Point, radius: float, *, value: bool = True) -> BitMap:
        """Return a bit map with a filled circle drawn, clipped to the grid; see `mapdeal.Circle`.

        Parameters
        ----------
        center_xy : tuple of float
            Center in the map frame, metres.
        radius : float
            Radius, metres; 0 for the center's cell only.
        value : bool
            New value of the covered cells.

        Examples
        --------
        >>> bits = BitMap.from_mask([[0, 0, 0, 0], [0, 0, 0, 0]], 1.0).circle((2.5, 0.5), 1.0)
        >>> bits.to_mask().astype(int).tolist()
        [[0, 1, 1, 1], [0, 0, 1, 0]]
        """
        spans = Circle(center_xy, radius).spans(self.frame)
        return self.painted((part, value) for part in spans)

    def copy(self) -> BitMap:
        """Return a copy with its own bytes."""
        return self.with_packed(self.packed.copy())

    def count(self) -> int:
        """Return the number of ones."""
        ones = np.unpackbits(np.arange(256, dtype=np.uint8)[:, np.newaxis], axis=1).sum(axis=1)
        return int(histogram(self.packed) @ ones)

    def with_packed(self, packed: NDArray[np.uint8]) -> Self:
        """Return a bit map with the same geometry and other bits."""
        return replace(self, packed=packed)

    def painted(self, strokes: Iterable[tuple[Spans, int]], overlay: OverlayType = "seq") -> Self:
        """Return a bit map with the cells of spans set to their values, one span after the other.

        With overlay ``max`` only ones are painted, with ``min`` only zeros.
        """
        mask = self.to_mask()
        for spans, value in strokes:
            if overlay == "seq" or (overlay == "max") == bool(value):
                paint(mask, spans, bool(value))
        return self.with_packed(np.packbits(mask, axis=1))

    def accept_value(self, value: float, name: str = "value") -> int:
        """Return `value`, which must be 0 or 1."""
        if value not in (0, 1):
            raise ParameterError("must be 0 or 1, the values of a bit map", place=name, got=value)
        return int(value)

    def _checked(self, cells_rowcol: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        cells = np.asarray(cells_rowcol)
        if cells.size and cells.dtype.kind not in "iu":
            raise ParameterError("cells must be whole numbers", got=cells.dtype.name)
        if cells.size and (cells.ndim != 2 or cells.shape[1] != 2):
            rule = "cells must be pairs of row and column, shape (N, 2)"
            raise ParameterError(rule, got=cells.shape)
        cells = cells.reshape(-1, 2).astype(np.int64, copy=False)
        inside = self.contains(cells)
        if not inside.all():
            first = tuple(cells[int(np.argmin(inside))].tolist())
            rule = f"lies outside of the {self.shape[0]} x {self.shape[1]} cells"
            raise ParameterError(rule, place="cell", got=first)
        return cells[:, 0], cells[:, 1]
