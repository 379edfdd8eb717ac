"""What every grid type shares: layers of cells that lie in a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import Origin, check_origin, check_resolution
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import Overlay
from mapdeal.kernels.spans import Spans, paint


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


class ValueGrid(Framed):
    """A grid of one value a cell: a map or a costmap, on whatever scale."""

    @property
    @abstractmethod
    def value_range(self) -> tuple[int, int]:
        """The smallest and the largest value of the scale."""

    @property
    @abstractmethod
    def unknown_value(self) -> int:
        """The value of a cell that nothing is known of."""

    @property
    def values(self) -> NDArray[Any]:
        """The values, shape (H, W), read-only."""
        return self._layer

    @abstractmethod
    def with_values(self, values: NDArray[Any], origin: Origin | None = None) -> Self:
        """Return a grid of the same kind with other values, at another origin if one is given."""

    def painted(self, strokes: Iterable[tuple[Spans, int]], overlay: Overlay = "seq") -> Self:
        """Return a grid in which the cells of spans have their values, one after the other.

        What a cell has already gives way to any value (``seq``), to a larger (``max``) or to a
        smaller one (``min``); unknown gives way to all, and wins only with ``seq``.
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
        """Return `value`, a whole number on the grid's scale.

        Raises
        ------
        ParameterError
            If it is anything else; the error calls it `name`.
        """
        lowest, highest = self.value_range
        if isinstance(value, bool) or not lowest <= value <= highest or value % 1:
            rule = f"must be a whole number from {lowest} to {highest}, the scale of this grid"
            raise ParameterError(rule, place=name, got=value)
        return int(value)


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
