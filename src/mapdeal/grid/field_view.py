"""The 0..100 view of a distance field: pixels that stand for distances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import Origin
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.records import dataclass
from mapdeal.spelling import as_known

View = Literal["metric", "per-map"]

ESDF_VIEW = "esdf_view"
"""What files call the layer."""


def whole_parts(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return products without their fractions; what is whole on paper is rounded to it first.

    Examples
    --------
    >>> 0.58 * 50
    28.999999999999996
    >>> whole_parts(np.array([64.99999999999999, 28.999999999999996, 64.99])).tolist()
    [65.0, 29.0, 64.0]
    """
    whole: NDArray[np.float64] = np.trunc(np.round(products, 9))
    return whole


@dataclass(frozen=True)
class ViewScale:
    """Scale that converts distances to view values 0..100.

    Parameters
    ----------
    view : {'metric', 'per-map'}
        ``metric``: scaled by `view_range`; ``per-map``: scaled by the extremes of the map.
    view_range : float
        Distance at which the metric view is 0, metres.
    farthest, deepest : float
        Extremes for the per-map view: the largest distance outside obstacles, times the field's
        strength, and the largest distance inside obstacles, metres.

    Raises
    ------
    ParameterError
        If the view is unknown, or a length is invalid.
    """

    view: View = "metric"
    view_range: float = 2.0
    farthest: float = 0.0
    deepest: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "view", as_known(self.view, get_args(View)))
        if self.view not in get_args(View):
            raise ParameterError("must be metric or per-map", place="view", got=self.view)
        if not 0 < self.view_range < math.inf:
            rule = "must be a finite number, above 0"
            raise ParameterError(rule, place="view_range", got=self.view_range)
        for name in ("farthest", "deepest"):
            if not 0 <= getattr(self, name) < math.inf:  # nan is refused, too
                rule = "must be a finite number, at least 0"
                raise ParameterError(rule, place=name, got=getattr(self, name))

    @property
    def end(self) -> float:
        """Distance at and beyond which the view is 0, metres."""
        return self.view_range if self.view == "metric" else self.farthest

    def values_of(self, metres: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
        """Return the view values of distances between cell centres.

        Parameters
        ----------
        metres : numpy.ndarray of float64
            Distances times the field's strength, possibly +inf, metres.
        resolution : float
            Side of a cell, metres.

        Examples
        --------
        >>> ViewScale("metric", 2.0).values_of(np.array([0.7, 3.0]), 0.05).tolist()
        [65.0, 0.0]
        """
        if self.view == "metric":
            return whole_parts(100 * (1 - np.minimum(metres, self.view_range) / self.view_range))
        # no obstacle cell is less than a cell deep, though a clip may hide that
        span = self.farthest + max(self.deepest - resolution, 0.0)
        if span == 0:
            return np.zeros_like(metres)
        return whole_parts(100 * (self.farthest - np.minimum(metres, self.farthest)) / span)

    def value_at(self, distance: float, resolution: float) -> int:
        """Return the view value of one distance."""
        return int(self.values_of(np.array([distance]), resolution)[0])

    @staticmethod
    def keys_of(view: View) -> tuple[str, ...]:
        """Return the names of the lengths that a view depends on."""
        return ("view_range",) if view == "metric" else ("farthest", "deepest")

    def entries(self) -> dict[str, Any]:
        """Return the entries that describe the scale in a file, by key."""
        lengths = {name: float(getattr(self, name)) for name in self.keys_of(self.view)}
        return {"view": self.view, **lengths}

    def described(self) -> str:
        """Return a description of the scale."""
        return f"{self.view}, 0 at {self.end:.4g} m"


@dataclass(frozen=True, eq=False, repr=False)
class FieldView(OccupancyGrid):
    """A distance field as values 0..100 that grow towards obstacles.

    Parameters
    ----------
    occupancy : array_like of int8, shape (H, W)
        View values: 100 on obstacles, -1 on unknown cells that are not obstacles.
    resolution, origin
        As for `OccupancyGrid`.
    scale : ViewScale
        Scale of the values.
    """

    kind = "view of a distance field"

    scale: ViewScale = ViewScale()

    def with_values(self, values: NDArray[Any], origin: Origin | None = None) -> FieldView:
        """Return a view with the same scale and other values."""
        return replace(self, occupancy=values, origin=origin or self.origin)

    def as_map(self) -> OccupancyGrid:
        """Return the view values as a map."""
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    def as_amcl_sees_it(self) -> OccupancyGrid:
        """Return the view as amcl interprets it: free, occupied or unknown."""
        return self.as_map().as_amcl_sees_it()

    def entries(self) -> dict[str, Any]:
        """Return the values and their scale."""
        return {**super().entries(), "layer": ESDF_VIEW, **self.scale.entries()}

    def _told_of_parameters(self) -> Iterator[str]:
        yield f"view {self.scale.described()}"

    def _own_figures(self) -> Figures:
        return {**super()._own_figures(), **self.scale.entries()}
