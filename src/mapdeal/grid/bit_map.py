"""The bit map, an obstacle mask with eight cells per byte, and drawing into grids of any kind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mapdeal.compatibility import Self
from mapdeal.errors import FindingError, ParameterError, emit_warning, require
from mapdeal.grid.frame import Figures, Framed, Origin, Point, ValueGrid, as_layer, region_of
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.shapes import Circle, Line, PlainPolygons, Shape
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OCCUPIED, OverlayType, check_choice
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.polygons import Spans, paint
from mapdeal.records import dataclass, replace


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
    resolution, origin
        As for `OccupancyGrid`.

    Raises
    ------
    ParameterError
        If the bytes do not fit the width, or the geometry is infinite or nan.

    Notes
    -----
    Like all grids, a bit map is immutable: methods that change cells return a new one.

    Examples
    --------
    >>> bits = BitMap.from_mask([[0, 1, 0], [0, 0, 7]], 0.5)
    >>> bits.packed.tolist(), bits.get([[0, 1], [1, 1]]).tolist()
    ([[64], [32]], [True, False])
    >>> bits.set([[0, 2]]).line([(0.25, 0.75), (0.75, 0.75)]).to_mask().astype(int).tolist()
    [[0, 1, 1], [1, 1, 1]]
    """

    kind = "bit map"
    layer_names = ("packed",)
    packed: NDArray[np.uint8]
    width: int
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        packed = as_layer(self.packed, np.uint8, "packed")
        is_grid = packed.ndim == 2 and self.width > 0 and packed.shape[1] == (self.width + 7) // 8
        rule = "packed must have two axes, the second as long as the width divided by 8"
        require(is_grid, rule, got=(packed.shape, self.width))
        padding = 0xFF >> (self.width % 8) if self.width % 8 else 0
        if padding and (packed[:, -1] & padding).any():
            packed = packed.copy()
            packed[:, -1] &= 0xFF ^ padding
        self._freeze(packed=packed)

    def _own_figures(self) -> Figures:
        occupied, cells = self.count(), self.shape[0] * self.shape[1]
        return {"occupied": occupied, "free": cells - occupied, "unknown": 0, "between": 0}

    def _repr_values(self) -> Iterator[str]:
        yield f"{self.count()} ones"

    @property
    def shape(self) -> tuple[int, int]:
        return self.packed.shape[0], self.width

    @classmethod
    def from_mask(
        cls, mask: ArrayLike, resolution: float, origin: Origin = (0.0, 0.0, 0.0)
    ) -> BitMap:
        """Create a bit map from an array, shape (H, W); every value above 0 is a 1."""
        values = np.asarray(mask)
        is_grid = values.ndim == 2 and 0 not in values.shape
        require(is_grid, "a mask must be two-dimensional and not empty", got=values.shape)
        is_set = values if values.dtype == np.bool_ else values > 0
        return cls(np.packbits(is_set, axis=1), values.shape[1], resolution, origin)

    @classmethod
    def from_occupancy(
        cls, grid: OccupancyGrid, lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD
    ) -> BitMap:
        """Create the obstacle mask of a map: 1 in cells at or above `lethal_threshold`."""
        return cls.from_mask(grid.occupied(lethal_threshold), grid.resolution, grid.origin)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.to_mask(), dtype=dtype)

    def to_mask(self) -> NDArray[np.bool_]:
        """Return the bits as an array of bool, shape (H, W)."""
        return np.unpackbits(self.packed, axis=1, count=self.width).view(np.bool_)

    def to_occupancy(self) -> OccupancyGrid:
        """Return a map whose obstacles are the ones and whose free cells are the zeros."""
        values = np.unpackbits(self.packed, axis=1, count=self.width).view(np.int8)
        values *= OCCUPIED
        return OccupancyGrid(values, self.resolution, self.origin)

    def contains(self, cells_rowcol: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each cell (row, column), shape (N, 2), lies in the grid."""
        rows, cols = np.asarray(cells_rowcol).reshape(-1, 2).T
        height, width = self.shape
        return (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)

    def get(self, cells_rowcol: ArrayLike) -> NDArray[np.bool_]:
        """Return the bits of cells (row, column) of the grid, shape (N, 2), as bool, shape (N,).

        Raises
        ------
        ParameterError
            If a cell lies outside the grid.
        """
        rows, cols = self._checked(cells_rowcol)
        return np.asarray((self.packed[rows, cols >> 3] << (cols & 7) & 0x80) != 0)

    def set(self, cells_rowcol: ArrayLike, value: bool = True) -> BitMap:
        """Return a bit map with cells (row, column) of the grid, shape (N, 2), set to a value.

        Raises
        ------
        ParameterError
            If a cell lies outside the grid.
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
    ) -> BitMap:
        """Return a bit map with a `mapdeal.Line` drawn, clipped to the grid."""
        return self.painted((part, value) for part in Line(points_xy, thickness).spans(self.frame))

    def circle(self, center_xy: Point, radius: float, *, value: bool = True) -> BitMap:
        """Return a bit map with a `mapdeal.Circle` drawn, clipped to the grid."""
        return self.painted((part, value) for part in Circle(center_xy, radius).spans(self.frame))

    def copy(self) -> BitMap:
        """Return a copy with its own bytes."""
        return self.with_packed(self.packed.copy())

    def count(self) -> int:
        """Return the number of ones."""
        every_byte = np.arange(256, dtype=np.uint8)[:, np.newaxis]
        return int(histogram(self.packed) @ np.unpackbits(every_byte, axis=1).sum(axis=1))

    def with_packed(self, packed: NDArray[np.uint8]) -> Self:
        """Return a bit map with the same geometry and other bits."""
        return replace(self, packed=packed)

    def painted(
        self, strokes: Iterable[tuple[Spans, int | NDArray[np.int64]]], overlay: OverlayType = "seq"
    ) -> Self:
        """Return a bit map with spans painted; with ``max`` only ones, with ``min`` only zeros."""
        mask = self.to_mask()
        for spans, value in strokes:
            if overlay == "seq" or (overlay == "max") == bool(value):
                paint(mask, spans, value)
        return self.with_packed(np.packbits(mask, axis=1))

    def accept_value(self, value: float, name: str = "value") -> int:
        """Return `value`, which must be 0 or 1."""
        require(value in (0, 1), "must be 0 or 1, the values of a bit map", name, got=value)
        return int(value)

    def _checked(self, cells_rowcol: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        cells = np.asarray(cells_rowcol)
        if cells.size:
            is_whole, is_list = cells.dtype.kind in "iu", cells.ndim == 2 and cells.shape[1] == 2
            require(is_whole, "cells must be whole numbers", got=cells.dtype.name)
            rule = "cells must be pairs of row and column, shape (N, 2)"
            require(is_list, rule, got=cells.shape)
        cells = cells.reshape(-1, 2).astype(np.int64, copy=False)
        inside = self.contains(cells)
        if not inside.all():
            first = tuple(cells[int(np.argmin(inside))].tolist())
            rule = f"lies outside of the {self.shape[0]} x {self.shape[1]} cells"
            raise ParameterError(rule, place="cell", got=first)
        return cells[:, 0], cells[:, 1]


G = TypeVar("G", bound=ValueGrid | BitMap)


def draw(
    grid: G,
    shapes: Iterable[Shape] | Shape,
    *,
    value: int | None = None,
    overlay: OverlayType = "seq",
    strict: bool = False,
) -> G:
    """Return a grid with shapes drawn into it, in order.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or BitMap
        Grid to draw on; its yaw is taken into account.
    shapes : Polygon, Line or Circle, or a sequence of them
        Shapes to draw, in the map frame, metres.
    value : int, optional
        Value of shapes that have none of their own, on the grid's scale: -1..100 for a map,
        0..255 for costs on scale ``costmap2d``, 0 or 1 for a bit map.
    overlay : {'seq', 'max', 'min'}
        Which value wins where a cell already has one, from the grid or from another shape: the
        later, the larger or the smaller one, as in Nav2's vector object server. Any value
        replaces unknown, but unknown replaces other values only with ``seq``.
    strict : bool
        Whether to refuse shapes that reach beyond the grid, and polygons without area, as
        ``setConvexPolygonCost`` of costmap_2d does; nothing is drawn then.

    Returns
    -------
    OccupancyGrid, Costmap or BitMap
        Grid of the same kind and geometry.

    Raises
    ------
    ParameterError
        If a shape lacks a value, or its value is off the grid's scale; MalformedInputError if the
        shape was read from a file.
    FindingError
        If `strict` is set and a shape reaches beyond the grid or has no area.

    Warns
    -----
    MapdealWarning
        For each such shape if `strict` is false: it is clipped to the grid, or drawn as a line.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid, Polygon
    >>> import numpy as np
    >>> grid = OccupancyGrid(np.zeros((3, 5), np.int8), 0.5, (1.0, 2.0, 0.0))
    >>> drawn = draw(grid, Polygon([(1.2, 2.2), (2.2, 2.2), (2.2, 2.8), (1.2, 2.8)]), value=100)
    >>> drawn.occupancy
    array([[100, 100, 100,   0,   0],
           [100, 100, 100,   0,   0],
           [  0,   0,   0,   0,   0]], dtype=int8)
    """
    check_choice(overlay, OverlayType, "overlay")
    shape_list = list(shapes) if isinstance(shapes, Iterable) else [shapes]
    for shape in shape_list:
        rule = "must be Polygon, Line or Circle, or a sequence of them"
        require(isinstance(shape, Shape), rule, "shapes", got=shape)
    plain = PlainPolygons(grid.frame, shape_list)
    strokes: list[tuple[Iterable[Spans] | None, int]] = []
    for index, (shape, name) in enumerate(_numbered(shape_list)):
        with _located_errors(shape, name):  # cells are made when they are painted, but refused here
            spans = None if plain.is_plain[index] else shape.spans(grid.frame)
            number = value if shape.value is None else shape.value
            if number is None:
                raise ParameterError("needs a value to be drawn with")
            strokes.append((spans, grid.accept_value(number)))
    for index, (shape, name) in enumerate(_numbered(shape_list)):
        for text, consequence in () if plain.fits[index] else _drawing_problems(grid, shape):
            if strict:
                source = shape.source or None
                raise FindingError(f"{text}; nothing was drawn", source=source, place=name)
            where = ": ".join(part for part in (shape.source, name) if part)
            emit_warning(f"{where}: {text}; {consequence}")
    return cast("G", grid.painted(_together(plain, strokes, overlay), overlay))


def _together(
    plain: PlainPolygons, strokes: list[tuple[Iterable[Spans] | None, int]], overlay: OverlayType
) -> Iterator[tuple[Spans, int | NDArray[np.int64]]]:
    values = np.array([value for _, value in strokes], dtype=np.int64)
    for is_plain, items in groupby(enumerate(strokes), lambda item: item[1][0] is None):
        some = list(items)
        if not is_plain:
            yield from ((part, value) for _, (parts, value) in some for part in parts or ())
            continue
        for spans, shape_of in plain.spans([index for index, _ in some]):
            own = values[shape_of]
            distinct = np.unique(own).tolist()
            if overlay == "seq" and len(distinct) > 1:
                yield spans, own
                continue
            for value in distinct:  # their order makes no difference
                yield Spans(*(column[own == value] for column in spans)), value


def _numbered(shapes: Sequence[Shape]) -> Iterator[tuple[Shape, str]]:
    for index, shape in enumerate(shapes):
        alone = shape.source or len(shapes) == 1
        yield shape, shape.kind if alone else f"shape {index + 1}, {shape.kind}"


@contextmanager
def _located_errors(shape: Shape, name: str) -> Iterator[None]:
    """Add the shape's name to errors; errors of a shape from a file name the file."""
    try:
        yield
    except ParameterError as error:
        if shape.source:
            raise error.in_file(shape.source, name) from None
        error.place = ": ".join(part for part in (name, error.place) if part)
        raise


def _drawing_problems(grid: ValueGrid | BitMap, shape: Shape) -> Iterator[tuple[str, str]]:
    if not shape.has_extent():
        yield "has no area, its corners lie on a line", "only the line is drawn"
    if part := shape.outside_part(grid.frame):
        is_visible = any(spans.rows.size for spans in shape.spans(grid.frame))
        drawn = "the shape is clipped" if is_visible else "nothing of the shape is drawn"
        yield f"{part} lies outside of the map", drawn


def reset_region(
    grid: G,
    *,
    size_xy: Point,
    corner_xy: Point | None = None,
    center_xy: Point | None = None,
    value: int | None = None,
    strict: bool = False,
) -> G:
    """Return a grid in which one region is set to a single value.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or BitMap
        Grid to change.
    size_xy, corner_xy, center_xy : tuple of float
        Region, as in `window`.
    value : int, optional
        Value on the grid's scale; unknown by default. Required for a bit map.
    strict : bool
        Whether to refuse a region that extends beyond the grid; nothing is changed then.

    Raises
    ------
    ParameterError
        As in `window`, or if `value` is not on the grid's scale or is missing for a bit map.
    FindingError
        If `strict` is set and the region extends beyond the grid.

    Warns
    -----
    MapdealWarning
        If `strict` is not set and the region extends beyond the grid.

    References
    ----------
    ``resetMap`` of costmap_2d and ``resetMapToValue`` of Nav2.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 0, 0], [0, 0, 0]], 0.5, (1.0, 2.0, 0.0))
    >>> region = {"corner_xy": (1.5, 2.0), "size_xy": (0.5, 1.0)}
    >>> reset_region(grid, value=100, **region).occupancy.tolist()
    [[0, 100, 0], [0, 100, 0]]
    """
    if value is not None:
        number = grid.accept_value(value)
    elif isinstance(grid, BitMap):
        raise ParameterError("is needed, 0 or 100: a bit map has no unknown cells", place="value")
    else:
        number = grid.unknown_value
    region = region_of(grid.frame, size_xy, corner_xy=corner_xy, center_xy=center_xy)
    rows, cols = region.shared_with(grid.shape)
    if (rows.stop - rows.start, cols.stop - cols.start) != region[2:]:
        if strict:
            raise FindingError("reaches beyond the map; nothing was changed", place="region")
        outside = rows.start == rows.stop or cols.start == cols.stop
        text = "lies outside of the map" if outside else "reaches beyond the map, it is clipped"
        emit_warning(f"region: {text}")
    ends = np.broadcast_to([[cols.start], [cols.stop]], (2, rows.stop - rows.start))
    return cast("G", grid.painted([(Spans(np.arange(rows.start, rows.stop), *ends), number)]))


def blank(grid: G, value: int = 0) -> G:
    """Return a grid of the same kind and geometry with the same value in every cell."""
    if isinstance(grid, BitMap):
        return grid.fill(bool(grid.accept_value(value, "background")))
    return grid.with_values(np.full_like(grid.values, grid.accept_value(value, "background")))
