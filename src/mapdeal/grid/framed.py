"""What every grid type shares: layers of cells that lie in a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from copy import copy
from typing import Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.display import MOST_COUNTED, Drawn, numbers_text
from mapdeal.grid.frame import Frame, Origin, check_origin, check_resolution
from mapdeal.grid.values import OverlayType
from mapdeal.kernels.blocks import Layer, LazyLayer, is_lazy
from mapdeal.kernels.polygons import Spans, paint

Figures = dict[str, Any]
"""The figures of a grid, as JSON can hold them."""


class Framed(Drawn, ABC):
    """Base class of all grids, with layers, a resolution, an origin, and a frame.

    Layers are arrays, or lazy layers (`mapdeal.kernels.blocks`) of a map that is processed block
    by block; `layer[rows]` works for both.
    """

    kind: ClassVar[str]
    """What a person calls such a grid."""

    layer_names: ClassVar[tuple[str, ...]]
    """The attributes that hold layers, the grid's own first."""

    parameter_names: ClassVar[tuple[str, ...]] = ()
    """The attributes that the grid was made with."""

    resolution: float
    origin: Origin

    @property
    def layer(self) -> Layer:
        """Main layer, whose shape all other layers share."""
        own: Layer = getattr(self, self.layer_names[0])
        return own

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
        other = copy(self)
        object.__setattr__(other, self.layer_names[0], layer)
        return other

    def figures(self) -> Figures:
        """Return the grid's size, place and counts as a JSON-serialisable dict."""
        return {**self.frame_figures(), **self._own_figures()}

    def frame_figures(self) -> Figures:
        """Return the grid's size and place as a JSON-serialisable dict."""
        return {
            "width": self.shape[1],
            "height": self.shape[0],
            "resolution": self.resolution,
            "origin": list(self.origin),
        }

    @abstractmethod
    def _own_figures(self) -> Figures:
        """Return the figures that only this type of grid has."""

    def _told(self) -> Iterator[str]:
        """Yield size and place, and of grids that are counted at once what they hold."""
        height, width = self.shape
        yield f"{width} x {height} cells"
        yield f"{self.resolution:.10g} m"
        yield f"origin {numbers_text(self.origin)}"
        yield from self._told_of_parameters()
        if not self.is_lazy and height * width <= MOST_COUNTED:
            yield from self._told_of_values()

    def _told_of_parameters(self) -> Iterator[str]:
        """Yield what the values stand for, without a look at them."""
        yield from ()

    @abstractmethod
    def _told_of_values(self) -> Iterator[str]:
        """Yield what there is to say of the values."""

    def entries(self) -> dict[str, Any]:
        """Return the entries of an npz besides the geometry: layers and parameters by key."""
        return {name: getattr(self, name) for name in self.layer_names}

    @property
    def frame(self) -> Frame:
        """Geometry of the grid."""
        return Frame(*self.shape, self.resolution, self.origin)

    def _freeze(self, **layers: Layer) -> None:
        """Check the geometry and store each layer as a read-only view."""
        object.__setattr__(self, "resolution", check_resolution(self.resolution))
        object.__setattr__(self, "origin", check_origin(self.origin))
        shapes = {array.shape for array in layers.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
            rule = "layers must be two-dimensional, of one shape and not empty"
            raise ParameterError(rule, got=sorted(shapes))
        for name, layer in layers.items():
            if is_lazy(layer):
                object.__setattr__(self, name, layer)
                continue
            view = np.ascontiguousarray(layer).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)


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

    @abstractmethod
    def with_values(self, values: NDArray[Any], origin: Origin | None = None) -> Self:
        """Return a grid of the same kind with other values and, if given, another origin."""

    def painted(self, strokes: Iterable[tuple[Spans, int]], overlay: OverlayType = "seq") -> Self:
        """Return a grid with the cells of spans set to their values, one span after the other.

        A cell's value is replaced by any value (``seq``), only by a larger one (``max``) or only
        by a smaller one (``min``). Unknown is replaced by any value, and replaces others only
        with ``seq``.
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
        if isinstance(value, bool) or not lowest <= value <= highest or value % 1:
            rule = f"must be a whole number from {lowest} to {highest}, the scale of this grid"
            raise ParameterError(rule, place=name, got=value)
        return int(value)


def as_layer(values: ArrayLike, dtype: type[np.generic], name: str) -> Layer:
    """Return `values` as a layer of `dtype`, refusing conversions that change a value.

    The values of a lazy layer are the business of who makes them.
    """
    if isinstance(values, LazyLayer) and values.dtype == dtype:
        return cast("Layer", values)
    array = np.asarray(values)
    if array.dtype != dtype:
        converted = array.astype(dtype)
        if not np.array_equal(converted, array, equal_nan=array.dtype.kind == "f"):
            rule = f"{name} must hold values of {np.dtype(dtype).name}"
            raise ParameterError(rule, got=array.dtype.name)
        array = converted
    return array
