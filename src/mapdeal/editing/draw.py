"""Drawing shapes into maps, costmaps and bit maps."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, Self, TypeVar

from mapdeal.errors import FindingError, MapdealWarning, ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.grid.shapes import Shape
from mapdeal.kernels.spans import Spans


class Paintable(Protocol):
    """A grid that can be drawn on: `mapdeal.OccupancyGrid`, `Costmap` or `BitMap`."""

    @property
    def frame(self) -> Frame:
        """The geometry of the grid."""
        ...

    def accept_value(self, value: float) -> int:
        """Return a value that the grid can hold, or raise."""
        ...

    def painted(self, strokes: Iterable[tuple[Spans, int]]) -> Self:
        """Return the grid with spans of cells at new values."""
        ...


G = TypeVar("G", bound=Paintable)


def draw(
    grid: G, shapes: Sequence[Shape] | Shape, *, value: int | None = None, strict: bool = False
) -> G:
    """Return a grid with shapes drawn into it, one over the other.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap or BitMap
        What to draw on; its yaw is honoured.
    shapes : Polygon, Line or Circle, or a sequence of them
        In metres in the map frame, the last on top.
    value : int, optional
        For shapes that bring none of their own, on the grid's own scale: -1..100 for a map,
        0..255 for costs on scale ``costmap2d``, 0 or 1 for a bit map.
    strict : bool
        Whether a shape that does not lie in the grid as a whole, or a polygon without area, is
        an error; nothing is drawn then.

    Returns
    -------
    OccupancyGrid, Costmap or BitMap
        Of the kind and geometry of `grid`.

    Raises
    ------
    ParameterError
        If a shape has no value, or one that is not on the grid's scale.
    FindingError
        If `strict` finds something.

    Warns
    -----
    MapdealWarning
        For each of these shapes otherwise: it is drawn as far as the grid goes, or as a line.

    References
    ----------
    ``setConvexPolygonCost`` of costmap_2d draws nothing if one vertex is outside; that is
    `strict`. Lines and circles are those of design document 003, with both ends drawn.

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
    each = list(shapes) if isinstance(shapes, Sequence) else [shapes]
    values = [_value_of(grid, shape, name, value) for shape, name in _named(each)]
    for text, consequence in _findings(grid, each):
        if strict:
            raise FindingError(f"{text}; nothing was drawn")
        warnings.warn(f"{text}; {consequence}", MapdealWarning, stacklevel=2)
    strokes = [
        (_spans_of(shape, name, grid.frame), number)
        for (shape, name), number in zip(_named(each), values, strict=True)
    ]
    return grid.painted(strokes)


def _named(shapes: Sequence[Shape]) -> Iterator[tuple[Shape, str]]:
    """Return each shape and what a message calls it."""
    for index, shape in enumerate(shapes):
        yield shape, shape.kind if len(shapes) == 1 else f"shape {index + 1}, {shape.kind}"


def _value_of(grid: Paintable, shape: Shape, name: str, value: int | None) -> int:
    number = shape.value if shape.value is not None else value
    if number is None:
        raise ParameterError("needs a value to be drawn with", place=name)
    with _named_in_errors(name):
        return grid.accept_value(number)


def _spans_of(shape: Shape, name: str, frame: Frame) -> Spans:
    with _named_in_errors(name):
        return shape.spans(frame)


@contextmanager
def _named_in_errors(name: str) -> Iterator[None]:
    """Have errors about one shape of several say which."""
    try:
        yield
    except ParameterError as error:
        if not str(error.place).startswith(name):
            error.place = f"{name}: {error.place}"
        raise


def _findings(grid: Paintable, shapes: Sequence[Shape]) -> Iterator[tuple[str, str]]:
    """Return what of each shape cannot be drawn as it is meant, and what is drawn instead."""
    for shape, name in _named(shapes):
        if not shape.has_extent():
            yield f"{name}: has no area, its corners lie on a line", "only the line is drawn"
        if part := shape.outside_part(grid.frame):
            empty = _spans_of(shape, name, grid.frame).rows.size == 0
            drawn = "nothing of the shape is drawn" if empty else "the shape is clipped"
            yield f"{name}: {part} lies outside of the map", drawn
