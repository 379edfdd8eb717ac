"""Drawing shapes into maps, costmaps and bit maps; regions that are reset."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, Self, TypeVar

import numpy as np

from mapdeal.errors import FindingError, ParameterError, emit_warning
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.frame import Frame, Point, region_of
from mapdeal.grid.framed import ValueGrid
from mapdeal.grid.shapes import Shape
from mapdeal.grid.values import OverlayType
from mapdeal.kernels.polygons import Spans


class Paintable(Protocol):
    """A grid that can be drawn on: `mapdeal.OccupancyGrid`, `Costmap` or `BitMap`."""

    @property
    def frame(self) -> Frame:
        """The geometry of the grid."""
        ...

    def accept_value(self, value: float, name: str = "value") -> int:
        """Return a value that the grid can hold, or raise."""
        ...

    def painted(self, strokes: Iterable[tuple[Spans, int]], overlay: OverlayType = "seq") -> Self:
        """Return the grid with spans of cells at new values."""
        ...


G = TypeVar("G", bound=Paintable)
D = TypeVar("D", bound=ValueGrid | BitMap)


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
        Whether a shape that is not entirely inside the grid, or a polygon without area, is an
        error; nothing is drawn then.

    Returns
    -------
    OccupancyGrid, Costmap or BitMap
        Grid of the same kind and geometry.

    Raises
    ------
    ParameterError
        If a shape has no value, or one that is not on the grid's scale.
    MalformedInputError
        If this applies to a shape that was read from a file.
    FindingError
        If `strict` is set and a shape is not entirely inside the grid or has no area.

    Warns
    -----
    MapdealWarning
        For each such shape if `strict` is not set: it is clipped to the grid, or drawn as a line.

    References
    ----------
    ``setConvexPolygonCost`` of costmap_2d draws nothing if any vertex is outside the map, which
    corresponds to `strict`.

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
    if overlay not in ("seq", "max", "min"):
        raise ParameterError("must be one of seq, max, min", place="overlay", got=overlay)
    each = list(shapes) if isinstance(shapes, Iterable) else [shapes]
    for one in each:
        if not hasattr(one, "spans"):
            rule = "must be Polygon, Line or Circle, or a sequence of them"
            raise ParameterError(rule, place="shapes", got=one)
    strokes = []
    for shape, name in _named(each):
        with _about(shape, name):  # cells are made when they are painted, but refused here
            strokes.append((shape.spans(grid.frame), _value_of(grid, shape, value)))
    for shape, name in _named(each):
        for text, consequence in _findings(grid, shape):
            if strict:
                source = shape.source or None
                raise FindingError(f"{text}; nothing was drawn", source=source, place=name)
            where = ": ".join(part for part in (shape.source, name) if part)
            emit_warning(f"{where}: {text}; {consequence}", stacklevel=2)
    return grid.painted(((spans, number) for parts, number in strokes for spans in parts), overlay)


def _named(shapes: Sequence[Shape]) -> Iterator[tuple[Shape, str]]:
    """Return each shape and what a message calls it, beside where it was read from."""
    for index, shape in enumerate(shapes):
        alone = shape.source or len(shapes) == 1
        yield shape, shape.kind if alone else f"shape {index + 1}, {shape.kind}"


def _value_of(grid: Paintable, shape: Shape, value: int | None) -> int:
    number = shape.value if shape.value is not None else value
    if number is None:
        raise ParameterError("needs a value to be drawn with")
    return grid.accept_value(number)


@contextmanager
def _about(shape: Shape, name: str) -> Iterator[None]:
    """Add the shape's name to errors; for a shape from a file, blame the file."""
    try:
        yield
    except ParameterError as error:
        if shape.source:
            raise error.in_file(shape.source, name) from None
        error.place = ": ".join(part for part in (name, error.place) if part)
        raise


def _findings(grid: Paintable, shape: Shape) -> Iterator[tuple[str, str]]:
    """Return what of a shape cannot be drawn as it is meant, and what is drawn instead."""
    if not shape.has_extent():
        yield "has no area, its corners lie on a line", "only the line is drawn"
    if part := shape.outside_part(grid.frame):
        some = any(spans.rows.size for spans in shape.spans(grid.frame))
        drawn = "the shape is clipped" if some else "nothing of the shape is drawn"
        yield f"{part} lies outside of the map", drawn


def reset_region(
    grid: D,
    *,
    size_xy: Point,
    corner_xy: Point | None = None,
    center_xy: Point | None = None,
    value: int | None = None,
    strict: bool = False,
) -> D:
    """Return a grid in which one region is set to a single value.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or BitMap
        Grid to change.
    size_xy, corner_xy, center_xy : tuple of float
        Region, as in `window`.
    value : int, optional
        Value on the grid's scale; unknown if not given. Required for a bit map, which has no
        unknown cells.
    strict : bool
        Whether a region that extends beyond the grid is an error; nothing is changed then.

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
            rule = "reaches beyond the map; nothing was changed"
            raise FindingError(rule, place="region")
        outside = rows.start == rows.stop or cols.start == cols.stop
        text = "lies outside of the map" if outside else "reaches beyond the map, it is clipped"
        emit_warning(f"region: {text}", stacklevel=2)
    if isinstance(grid, BitMap):
        mask = grid.to_mask()
        mask[rows, cols] = number
        return grid.with_packed(np.packbits(mask, axis=1))
    values = grid.values.copy()
    values[rows, cols] = number
    return grid.with_values(values)


def blank(grid: D, value: int = 0) -> D:
    """Return a grid of the same kind and geometry with the same value in every cell.

    Useful for drawing a mask: a mask that is unknown outside its shapes changes nothing there.
    """
    if isinstance(grid, BitMap):
        return grid.fill(bool(grid.accept_value(value, "background")))
    return grid.with_values(np.full_like(grid.values, grid.accept_value(value, "background")))
