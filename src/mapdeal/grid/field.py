"""Distance fields, and their views in steps of a grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError, as_known
from mapdeal.grid.canvas import FieldGrid, padded
from mapdeal.grid.display import count_text, numbers_text
from mapdeal.grid.frame import Origin, Region
from mapdeal.grid.framed import Figures, as_layer
from mapdeal.grid.occupancy import OccupancyGrid, as_occupancy_layer
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, UNKNOWN, Convention, UnknownPolicy
from mapdeal.kernels.blocks import mapped, swept
from mapdeal.kernels.lookup import interpolate
from mapdeal.kernels.threads import in_parallel

_POINTS_TOGETHER = 1 << 13
"""Whose arrays stay in the cache on their way through the steps."""


class FieldSamples(NamedTuple):
    """Samples of a distance field at points.

    Parameters
    ----------
    distance : numpy.ndarray of float64, shape (N,)
        Distances in the field's convention, metres; nan for points outside the field or where it
        has no distance.
    gradient : numpy.ndarray of float64, shape (N, 2)
        Gradients along x and y of the map frame, pointing away from obstacles, metres per metre;
        nan for points outside the field or where distances are infinite.
    inside : numpy.ndarray of bool, shape (N,)
        Whether each point lies in a cell of the field.
    """

    distance: NDArray[np.float64]
    gradient: NDArray[np.float64]
    inside: NDArray[np.bool_]

    def __repr__(self) -> str:
        """Return one line: the sample of a single point, or the range of many."""
        parts = [
            f"{count_text(len(self.distance), 'point')}, {np.count_nonzero(self.inside)} inside"
        ]
        known = self.distance[~np.isnan(self.distance)]
        if len(self.distance) == 1 and len(known):
            parts.append(f"distance {known[0]:.6g} m, gradient {numbers_text(self.gradient[0])}")
        elif len(known):
            parts.append(f"distance {known.min():.6g} .. {known.max():.6g} m")
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, eq=False, repr=False)
class DistanceField(FieldGrid):
    """A signed distance field together with the map that it was computed from.

    Parameters
    ----------
    distance : array_like of float32, shape (H, W)
        Signed distances, metres: positive in free space, negative or 0 inside obstacles, +inf
        everywhere if the map has no obstacle, -inf if it has nothing else. They may be nan in
        unknown cells outside one box of cells, if the field was computed for the box only.
    occupancy : array_like of int8, shape (H, W)
        Map that the distances belong to.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).
    convention : {'fast-planner', 'center', 'border'}
        Points that the distances are measured between; see `mapdeal.esdf`.
    strength : float
        Factor applied to positive distances.
    max_distance : float, optional
        Limit to which distances of both signs were clipped, before applying `strength`, metres.
    lethal_threshold : int
        Least occupancy of an obstacle.
    unknown : {'free', 'occupied'}
        What unknown cells count as.
    region : Region, optional
        Box of the cells that have a distance, None if all have one. It is detected for arrays.
    """

    kind = "distance field"
    layer_names = ("distance", "occupancy")
    parameter_names = ("unknown", "max_distance", "strength", "lethal_threshold")

    distance: NDArray[np.float32]
    occupancy: NDArray[np.int8]
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)
    convention: Convention = "fast-planner"
    strength: float = 1.0
    max_distance: float | None = None
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD
    unknown: UnknownPolicy = "free"
    region: Region | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "convention", as_known(self.convention, get_args(Convention)))
        if self.convention not in get_args(Convention):
            rule = "convention must be fast-planner, center or border"
            raise ParameterError(rule, got=self.convention)
        if self.unknown not in ("free", "occupied"):
            raise ParameterError("unknown must be free or occupied", got=self.unknown)
        if not 1e-6 <= self.strength <= 1e6:
            raise ParameterError("strength must lie between 1e-6 and 1e6", got=self.strength)
        if self.max_distance is not None and not 0 < self.max_distance < math.inf:
            raise ParameterError("max_distance must be finite and above 0", got=self.max_distance)
        if not 1 <= self.lethal_threshold <= 100:
            rule = "lethal_threshold must lie between 1 and 100"
            raise ParameterError(rule, got=self.lethal_threshold)
        self._freeze(
            distance=as_layer(self.distance, np.float32, "distance"),
            occupancy=as_occupancy_layer(self.occupancy),
        )
        self._find_region()

    def _own_figures(self) -> Figures:
        mask = self.obstacles()
        obstacles, lowest, highest = 0, math.inf, -math.inf
        for rows in swept(self.distance):
            distance = self.distance[rows]
            obstacles += int(np.count_nonzero(mask[rows]))
            lowest = min(lowest, float(distance.min()))
            highest = max(highest, float(distance.max()))
        finite = math.isfinite(lowest) and math.isfinite(highest)
        return {
            "convention": self.convention,
            "obstacles": obstacles,
            "lowest_distance": lowest if finite else None,
            "highest_distance": highest if finite else None,
        }

    def _told_of_parameters(self) -> Iterator[str]:
        yield f"convention {self.convention}"
        if self.strength != 1.0:
            yield f"strength {self.strength:g}"
        if self.max_distance is not None:
            yield f"max_distance {self.max_distance:g} m"

    def _told_of_values(self) -> Iterator[str]:
        figures = self.figures()
        lowest, highest = figures["lowest_distance"], figures["highest_distance"]
        if lowest is None:
            yield "no obstacle" if figures["obstacles"] == 0 else "nothing but obstacles"
            return
        yield f"{lowest + 0.0:.6g} .. {highest:.6g} m"
        yield count_text(figures["obstacles"], "obstacle cell")

    def entries(self) -> dict[str, Any]:
        """Return the distances, the map they were computed from, and the parameters."""
        limit = np.inf if self.max_distance is None else self.max_distance
        return {
            "distance": self.distance,
            "occupancy": self.occupancy,
            "convention": self.convention,
            "strength": np.float64(self.strength),
            "max_distance": np.float64(limit),
            "lethal_threshold": np.int64(self.lethal_threshold),
            "unknown": self.unknown,
        }

    @property
    def grid(self) -> OccupancyGrid:
        """Map that the field was computed from."""
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    def obstacles(self) -> NDArray[np.bool_]:
        """Return the mask of cells that the field counts as obstacles."""
        if self.region is not None and self.unknown == "occupied":  # around the box none are
            inner, (height, width) = self.cropped.obstacles(), self.shape
            return padded(inner, (height, width), self.region, fill=False)
        return obstacles_in(self.occupancy, self.lethal_threshold, self.unknown)

    def query(self, points_xy: ArrayLike) -> FieldSamples:
        """Return distances and gradients at points, interpolated between cell centres.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, or a single point, metres.

        Returns
        -------
        FieldSamples
            The arrays `distance` (N,), `gradient` (N, 2) and `inside` (N,).

        Raises
        ------
        ParameterError
            If `points_xy` has another shape.

        Notes
        -----
        Interpolation is bilinear between the four nearest cells. The gradient is that of the
        interpolant, per metre along both axes and rotated into the map frame; it is discontinuous
        across lines of cell centres. Between the outermost centres and the border, values are
        those at the centres. Distances are those of the field: clipped to its `max_distance` and
        scaled by its `strength`. Points outside have distance nan and are marked in `inside`.

        References
        ----------
        ``evaluateEDTWithGrad`` in ``edt_environment.cpp`` of Fast-Planner.

        Examples
        --------
        >>> from mapdeal import OccupancyGrid, esdf
        >>> field = esdf(OccupancyGrid([[100, 0, 0, 0]], resolution=0.5))
        >>> distance, gradient, inside = field.query([[1.0, 0.25], [9.0, 0.0]])
        >>> distance
        array([0.75,  nan])
        >>> gradient
        array([[ 1.,  0.],
               [nan, nan]])
        >>> inside
        array([ True, False])
        """
        points = np.asarray(points_xy, dtype=np.float64)
        if points.shape == (2,):
            points = points.reshape(1, 2)
        if points.ndim != 2 or points.shape[1] != 2:
            rule = "points must be an array of x, y pairs, shape (N, 2)"
            raise ParameterError(rule, got=points.shape)
        count = len(points)
        distance, gradient = np.empty(count), np.empty((count, 2))
        inside = np.empty(count, dtype=np.bool_)

        def ask(first: int, end: int) -> None:
            for start in range(first * _POINTS_TOGETHER, end * _POINTS_TOGETHER, _POINTS_TOGETHER):
                some = slice(start, start + _POINTS_TOGETHER)
                distance[some], gradient[some], inside[some] = self._query(points[some])

        in_parallel(ask, -(-count // _POINTS_TOGETHER))
        return FieldSamples(distance, gradient, inside)

    def _query(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        frame, region = self.frame, self.region
        places, inside = frame.bounded_continuous_rowcol_from_xy(points)
        if region is not None:
            places = places - (region.row, region.col)
        distance, slopes = interpolate(self.cropped.distance, places)
        gradient = frame.xy_vectors_from_rowcol(slopes) / self.resolution
        outside = ~inside
        if region is not None:
            outside |= ~region.holds(frame.bounded_rowcol_from_xy(points)[0])
        if outside.any():
            distance[outside] = np.nan
            gradient[outside] = np.nan
        return distance, gradient, inside


def obstacles_in(
    occupancy: NDArray[np.int8], lethal_threshold: int, unknown: UnknownPolicy
) -> NDArray[np.bool_]:
    """Return the mask of cells that count as obstacles for a distance field."""

    def are_obstacles(values: NDArray[np.int8]) -> NDArray[np.bool_]:
        occupied: NDArray[np.bool_] = values >= lethal_threshold
        if unknown == "occupied":
            occupied |= values == UNKNOWN
        return occupied

    return mapped(occupancy, bool, are_obstacles)


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
