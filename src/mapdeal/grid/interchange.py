"""Grids as numpy, matplotlib, xarray, rasterio and ROS messages know them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mapdeal.errors import ParameterError

if TYPE_CHECKING:
    from mapdeal.grid.frame import Frame


class Interchange(ABC):
    """What all grids offer to other libraries; the libraries are imported when they are used."""

    kind: ClassVar[str]
    layer_names: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """Geometry of the grid."""

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the main layer, shape (H, W), row 0 in the south."""
        layer = getattr(self, self.layer_names[0])
        array: NDArray[Any] = np.asarray(layer[0 : layer.shape[0]], dtype=dtype)
        return array.copy() if copy else array

    @property
    def transform(self) -> NDArray[np.float64]:
        """Matrix from column, row, 1 (cells, whole at edges) to x, y, 1 (metres), shape (3, 3).

        ``rasterio.Affine(*grid.transform[:2].ravel())`` is the same in rasterio's words.
        """
        x, y, yaw = self.frame.origin
        cos, sin = (self.frame.resolution * f(yaw) for f in (math.cos, math.sin))
        return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x and largest y of the grid's corners, metres."""
        height, width = self.frame.shape
        corners = [(0, 0), (height, 0), (0, width), (height, width)]
        xs, ys, _ = zip(
            *(self.frame.window(*corner, 1, 1).origin for corner in corners), strict=True
        )
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
        left, bottom, right, top = self.bounds
        return left, right, bottom, top

    def plot(self, ax: Any = None, **options: Any) -> Any:
        """Draw the main layer with matplotlib, in metres; unknown cells stay transparent.

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
        axes = _library("matplotlib.pyplot").gca() if ax is None else ax
        height, width = (count * self.frame.resolution for count in self.frame.shape)
        x, y, yaw = self.frame.origin
        place = _library("matplotlib.transforms").Affine2D().rotate(yaw).translate(x, y)
        image = axes.imshow(
            self._drawn_values(),
            **{
                "origin": "lower", "interpolation": "nearest", "cmap": self._colours(),
                "extent": (0.0, width, 0.0, height), **options,
            },
        )  # fmt: skip
        image.set_transform(place + axes.transData)
        left, bottom, right, top = self.bounds
        axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, m", ylabel="y, m")
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
        name = self.layer_names[0]
        attributes = {
            "resolution": self.frame.resolution, "origin": self.frame.origin, "units": "m",
        }  # fmt: skip
        coordinates: dict[str, Any]
        if self.frame.origin[2] == 0:
            x = self.frame.xy_from_rowcol(np.stack([0 * cols, cols], axis=1))[:, 0]
            y = self.frame.xy_from_rowcol(np.stack([rows, 0 * rows], axis=1))[:, 1]
            dimensions, coordinates = ("y", "x"), {"y": y, "x": x}
        else:
            cells = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
            xy = self.frame.xy_from_rowcol(cells).reshape(height, width, 2)
            dimensions = ("row", "col")
            coordinates = {"x": (dimensions, xy[..., 0]), "y": (dimensions, xy[..., 1])}
        array = _library("xarray").DataArray
        return array(np.asarray(self), coordinates, dimensions, name, attributes)

    def _drawn_values(self) -> NDArray[Any]:
        return np.asarray(self)

    def _colours(self) -> str:
        return "viridis"


def message_of(
    frame: Frame, values: NDArray[Any], frame_id: str, message_type: Callable[[], Any] | None
) -> Any:
    x, y, yaw = frame.origin
    stamp = {"sec": 0, "nanosec": 0}
    document = {
        "header": {"stamp": dict(stamp), "frame_id": frame_id},
        "info": {
            "map_load_time": dict(stamp), "resolution": float(np.float32(frame.resolution)),
            "width": frame.width, "height": frame.height,
            "origin": {
                "position": {"x": x, "y": y, "z": 0.0},
                "orientation": {
                    "x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2),
                },
            },
        },
        "data": np.ascontiguousarray(values).reshape(-1).tolist(),
    }  # fmt: skip
    if message_type is None:
        return document
    message = message_type()
    _fill(message, document)
    return message


def _fill(message: Any, document: Mapping[str, Any]) -> None:
    for name, value in document.items():
        if not isinstance(value, Mapping):
            setattr(message, name, value)
        elif name not in ("stamp", "map_load_time"):  # ROS 1 and 2 differ, and zero is the default
            _fill(getattr(message, name), value)


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        hint = f"pip install {package}"
        raise ParameterError("is not installed", source=package, hint=hint) from None
