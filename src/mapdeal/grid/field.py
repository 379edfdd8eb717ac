"""The signed Euclidean distance field (ESDF)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.canvas import FieldGrid, padded
from mapdeal.grid.coordinates import Origin
from mapdeal.grid.display import count_text, numbers_text
from mapdeal.grid.framed import Figures, as_layer
from mapdeal.grid.occupancy import OccupancyGrid, as_occupancy_layer
from mapdeal.grid.region import Region
from mapdeal.grid.values import (
    DEFAULT_LETHAL_THRESHOLD,
    UNKNOWN,
    Convention,
    UnknownPolicy,
)
from mapdeal.kernels.bilinear import interpolate
from mapdeal.kernels.blocks import mapped, swept
from mapdeal.kernels.threads import in_parallel
from mapdeal.records import dataclass
from mapdeal.spelling import as_known

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
