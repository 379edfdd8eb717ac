"""Distance fields, and their views in steps of a grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError, as_known, require
from mapdeal.grid import canvas, frame as frames, values as map_values
from mapdeal.grid.occupancy import OccupancyGrid, as_occupancy_layer
from mapdeal.grid.values import OCCUPIED, UNKNOWN, count_text, numbers_text
from mapdeal.kernels import blocks, lookup, threads
from mapdeal.kernels.arrays import Floats
from mapdeal.records import dataclass

_POINTS_AT_ONCE = 1 << 13  # their arrays stay in the processor's cache
View = Literal["metric", "per-map"]
ESDF_VIEW = "esdf_view"  # name of the layer in files
LARGEST_GAIN = 1e9
LARGEST_REPULSION = 1e15  # more than any map has; up to here no layer overflows


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
        points = count_text(len(self.distance), "point")
        text = f"{points}, {np.count_nonzero(self.inside)} inside"
        known = self.distance[~np.isnan(self.distance)]
        if len(self.distance) == 1 and len(known):
            text += f", distance {known[0]:.6g} m, gradient {numbers_text(self.gradient[0])}"
        elif len(known):
            text += f", distance {known.min():.6g} .. {known.max():.6g} m"
        return f"{type(self).__name__}({text})"


@dataclass(frozen=True, eq=False, repr=False)
class DistanceField(canvas.FieldGrid):
    """A signed distance field together with the map that it was computed from.

    Parameters
    ----------
    distance : array_like of float32, shape (H, W)
        Signed distances, metres: positive in free space, negative or 0 inside obstacles, +inf
        everywhere if the map has no obstacle, -inf if all cells are obstacles. They may be nan in
        unknown cells outside one box of cells, if the field was computed for the box only.
    occupancy : array_like of int8, shape (H, W)
        Map that the distances belong to.
    resolution, origin
        As for `OccupancyGrid`.
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
    origin: frames.Origin = (0.0, 0.0, 0.0)
    convention: map_values.Convention = "fast-planner"
    strength: float = 1.0
    max_distance: float | None = None
    lethal_threshold: int = map_values.DEFAULT_LETHAL_THRESHOLD
    unknown: map_values.UnknownPolicy = "free"
    region: frames.Region | None = None

    def __post_init__(self) -> None:
        conventions = get_args(map_values.Convention)
        object.__setattr__(self, "convention", as_known(self.convention, conventions))
        limit = 1.0 if self.max_distance is None else self.max_distance
        for name, holds, rule in (
            ("convention", self.convention in conventions, "be fast-planner, center or border"),
            ("unknown", self.unknown in ("free", "occupied"), "be free or occupied"),
            ("strength", 1e-6 <= self.strength <= 1e6, "lie between 1e-6 and 1e6"),
            ("max_distance", 0 < limit < math.inf, "be finite and above 0"),
            ("lethal_threshold", 1 <= self.lethal_threshold <= 100, "lie between 1 and 100"),
        ):
            require(holds, f"{name} must {rule}", got=getattr(self, name))
        distance = frames.as_layer(self.distance, np.float32, "distance")
        self._freeze(distance=distance, occupancy=as_occupancy_layer(self.occupancy))
        self._find_region()

    def _own_figures(self) -> frames.Figures:
        mask = self.obstacles()
        obstacles, lowest, highest = 0, math.inf, -math.inf
        for rows in blocks.swept(self.distance):
            distance = self.distance[rows]
            obstacles += int(np.count_nonzero(mask[rows]))
            lowest = min(lowest, float(distance.min()))
            highest = max(highest, float(distance.max()))
        figures = {"convention": self.convention, "obstacles": obstacles}
        is_finite = math.isfinite(lowest) and math.isfinite(highest)
        low, high = (lowest, highest) if is_finite else (None, None)
        return {**figures, "lowest_distance": low, "highest_distance": high}

    def _repr_parameters(self) -> Iterator[str]:
        yield f"convention {self.convention}"
        if self.strength != 1.0:
            yield f"strength {self.strength:g}"
        if self.max_distance is not None:
            yield f"max_distance {self.max_distance:g} m"

    def _repr_values(self) -> Iterator[str]:
        figures = self.figures()
        lowest, highest = figures["lowest_distance"], figures["highest_distance"]
        if lowest is None:
            yield "no obstacle" if figures["obstacles"] == 0 else "nothing but obstacles"
            return
        yield f"{lowest + 0.0:.6g} .. {highest:.6g} m"
        yield count_text(figures["obstacles"], "obstacle cell")

    def entries(self) -> dict[str, Any]:
        limit = math.inf if self.max_distance is None else self.max_distance
        entries = {**super().entries(), "convention": self.convention}
        entries |= {"strength": np.float64(self.strength), "max_distance": np.float64(limit)}
        entries["lethal_threshold"] = np.int64(self.lethal_threshold)
        return {**entries, "unknown": self.unknown}

    def obstacles(self) -> NDArray[np.bool_]:
        """Return the mask of cells that the field counts as obstacles."""
        if self.region is not None and self.unknown == "occupied":  # around the box is no obstacle
            return canvas.padded(self.cropped.obstacles(), self.shape, self.region, fill=False)
        return obstacles_in(self.occupancy, self.lethal_threshold, self.unknown)

    def query(self, points_xy: ArrayLike) -> FieldSamples:
        """Return distances and gradients at points, interpolated between cell centres.

        Parameters
        ----------
        points_xy : array_like of float, shape (N, 2)
            Points in the map frame, or a single point, metres.

        Raises
        ------
        ParameterError
            If `points_xy` has another shape.

        Notes
        -----
        Interpolation is bilinear, as in ``evaluateEDTWithGrad`` of Fast-Planner, and constant from
        the outermost centres to the border. The gradient is that of the interpolant; it jumps at
        lines of cell centres. Distances are clipped and scaled as the field is.

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
        points = frames.as_points(points_xy)
        count = len(points)
        samples = FieldSamples(np.empty(count), np.empty((count, 2)), np.empty(count, np.bool_))

        def sample(first: int, end: int) -> None:
            for start in range(first * _POINTS_AT_ONCE, end * _POINTS_AT_ONCE, _POINTS_AT_ONCE):
                part = slice(start, start + _POINTS_AT_ONCE)
                for array, values in zip(samples, self._query(points[part]), strict=True):
                    array[part] = values

        threads.in_parallel(sample, -(-count // _POINTS_AT_ONCE))
        return samples

    def _query(self, points: NDArray[np.float64]) -> FieldSamples:
        frame, region = self.frame, self.region
        places, inside = frame.bounded_continuous_rowcol_from_xy(points)
        if region is not None:
            places = places - (region.row, region.col)
        distance, slopes = lookup.interpolate(self.cropped.distance, places)
        gradient = frame.xy_vectors_from_rowcol(slopes) / self.resolution
        outside = ~inside
        if region is not None:
            outside |= ~region.holds(frame.bounded_rowcol_from_xy(points)[0])
        if outside.any():
            distance[outside] = np.nan
            gradient[outside] = np.nan
        return FieldSamples(distance, gradient, inside)


def obstacles_in(
    occupancy: NDArray[np.int8], lethal_threshold: int, unknown: map_values.UnknownPolicy
) -> NDArray[np.bool_]:
    def are_obstacles(values: NDArray[np.int8]) -> NDArray[np.bool_]:
        occupied: NDArray[np.bool_] = values >= lethal_threshold
        if unknown == "occupied":
            occupied |= values == UNKNOWN
        return occupied

    return blocks.mapped(occupancy, bool, are_obstacles)


def truncated(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return products truncated after rounding errors are removed: 0.58 * 50 gives 29, not 28."""
    return np.trunc(np.round(products, 9))


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
        require(self.view in get_args(View), "must be metric or per-map", "view", got=self.view)
        is_length, rule = 0 < self.view_range < math.inf, "must be a finite number"
        require(is_length, f"{rule}, above 0", "view_range", got=self.view_range)
        for name in ("farthest", "deepest"):
            value = getattr(self, name)
            require(0 <= value < math.inf, f"{rule}, at least 0", name, got=value)

    @property
    def end(self) -> float:
        """Distance at and beyond which the view is 0, metres."""
        return self.view_range if self.view == "metric" else self.farthest

    def values_of(self, metres: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
        """Return the view values of distances times the field's strength, metres, possibly +inf."""
        if self.view == "metric":
            return truncated(100 * (1 - np.minimum(metres, self.view_range) / self.view_range))
        # every obstacle cell is at least a cell deep, although a clipped field may show less
        span = self.farthest + max(self.deepest - resolution, 0.0)
        if span == 0:
            return np.zeros_like(metres)
        return truncated(100 * (self.farthest - np.minimum(metres, self.farthest)) / span)

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

    def as_map(self) -> OccupancyGrid:
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    def as_amcl_sees_it(self) -> OccupancyGrid:
        return self.as_map().as_amcl_sees_it()

    def entries(self) -> dict[str, Any]:
        return {**super().entries(), "layer": ESDF_VIEW, **self.scale.entries()}

    def _repr_parameters(self) -> Iterator[str]:
        yield f"view {self.scale.described()}"

    def _own_figures(self) -> frames.Figures:
        return {**super()._own_figures(), **self.scale.entries()}


@dataclass(frozen=True, eq=False, repr=False)
class PotentialField(canvas.FieldGrid):
    """A potential on a map, high at obstacles and low at the goal.

    Parameters
    ----------
    repulsive : array_like of float64, shape (H, W)
        Sum of 1 / distance over all obstacle cells, at least 0, per metre. It may be nan in unknown
        cells outside one box of cells; all other layers are then nan there, as well.
    occupancy : array_like of int8, shape (H, W)
        The map; its cells of value 100 are the obstacles.
    resolution, origin
        As for `OccupancyGrid`.
    goal : tuple of float, optional
        x and y of the goal in the map frame, metres.
    attractive_gain, repulsive_gain : float
        Weights of the two parts of `potential`.
    repulsive_cap : float
        Upper bound of `repulsive`, per metre.
    region : Region, optional
        Box of the cells that have a potential, None if all have one. It is detected for arrays.
    cost_to_go : array_like of float64, shape (H, W), optional
        Length of the shortest way around obstacles to the goal, metres; inf where there is none.
    cost_to_go_of : str, optional
        The robot whose ways these are, in words.
    cost_travel_multiplier : float
        Weight of costs against length in `cost_to_go`.

    Raises
    ------
    ParameterError
        If a value is negative or too large, or an occupancy is outside -1..100.
    """

    kind = "potential field"
    layer_names = ("repulsive", "occupancy")
    parameter_names = ("attractive_gain", "repulsive_gain", "repulsive_cap")
    repulsive: NDArray[np.float64]
    occupancy: NDArray[np.int8]
    resolution: float
    origin: frames.Origin = (0.0, 0.0, 0.0)
    goal: frames.Point | None = None
    attractive_gain: float = 1.0
    repulsive_gain: float = 1.0
    repulsive_cap: float = 1e5
    region: frames.Region | None = None
    cost_to_go: NDArray[np.float64] | None = None
    cost_to_go_of: str | None = None
    cost_travel_multiplier: float = 0.0

    def __post_init__(self) -> None:
        repulsive = frames.as_layer(self.repulsive, np.float64, "repulsive")
        lowest, highest = (f.reduce(repulsive, axis=None, initial=0.0) for f in (np.fmin, np.fmax))
        if lowest < 0 or highest > LARGEST_REPULSION:  # `_find_region` checks nan
            raise ParameterError(f"repulsive must lie between 0 and {LARGEST_REPULSION:g}")
        for name in ("attractive_gain", "repulsive_gain"):
            gain, rule = getattr(self, name), f"must lie between 0 and {LARGEST_GAIN:g}"
            require(0 <= gain <= LARGEST_GAIN, rule, name, got=gain)
        cap, rule = self.repulsive_cap, f"must be above 0, at most {LARGEST_REPULSION:g}"
        require(0 < cap <= LARGEST_REPULSION, rule, "repulsive_cap", got=cap)
        if self.goal is not None:
            object.__setattr__(self, "goal", frames.check_point(self.goal, "goal"))
        layers = {"repulsive": repulsive, "occupancy": as_occupancy_layer(self.occupancy)}
        if self.cost_to_go is not None:
            layers["cost_to_go"] = frames.as_layer(self.cost_to_go, np.float64, "cost_to_go")
        object.__setattr__(self, "layer_names", tuple(layers))
        self._freeze(**layers)
        self._find_region()

    @property
    def outside_values(self) -> dict[str, float]:
        lengths = {} if self.cost_to_go is None else {"cost_to_go": math.inf}
        return {**super().outside_values, **lengths}

    def _own_figures(self) -> frames.Figures:
        return {
            "goal": None if self.goal is None else list(self.goal),
            **({} if self.cost_to_go_of is None else {"cost_to_go_of": self.cost_to_go_of}),
            **({"cost_to_go_unit": self.cost_to_go_unit} if self.cost_travel_multiplier else {}),
            "obstacles": int(np.count_nonzero(self.obstacles())),
            "lowest_potential": float(self.potential.min()),
            "highest_potential": float(self.potential.max()),
            "steepest_gradient": float(self.gradient_magnitude.max()),
        }

    @property
    def cost_to_go_unit(self) -> str:
        """Unit of `cost_to_go` in words: m, or metres that cost more in expensive cells."""
        weight = self.cost_travel_multiplier
        return f"m * (1 + {weight:g} * cost / highest open cost)" if weight else "m"

    def _repr_parameters(self) -> Iterator[str]:
        yield "no goal" if self.goal is None else f"goal {numbers_text(self.goal)}"

    def _repr_values(self) -> Iterator[str]:
        # Only from the stored layer: all others would have to be computed.
        yield f"repulsion up to {np.fmax.reduce(self.repulsive, axis=None):.6g} per metre"
        yield count_text(int(np.count_nonzero(self.obstacles())), "obstacle cell")

    def entries(self) -> dict[str, Any]:
        """Return all layers, the map, and the parameters they were computed with."""
        entries: dict[str, Any] = {"repulsive": self.repulsive, "normalised": self.normalised}
        if self.goal is not None:
            entries |= {"attractive": self.attractive, "potential": self.potential}
        entries |= {"gradient": self.gradient, "gradient_magnitude": self.gradient_magnitude}
        if self.cost_to_go is not None:
            entries["cost_to_go"] = self.cost_to_go
            entries["cost_to_go_gradient"] = self.cost_to_go_gradient
        if self.cost_travel_multiplier:
            entries["cost_travel_multiplier"] = np.float64(self.cost_travel_multiplier)
        if self.goal is not None:
            entries["goal"] = np.array(self.goal)
        parameters = {name: np.float64(getattr(self, name)) for name in self.parameter_names}
        return {**entries, "occupancy": self.occupancy, **parameters}

    def obstacles(self) -> NDArray[np.bool_]:
        """Return the mask of obstacle cells."""
        return np.equal(self.occupancy, OCCUPIED)

    @canvas.layer_of_box
    def attractive(self) -> NDArray[np.float64] | None:
        """Distance from each cell centre to the goal, metres, shape (H, W), if there is a goal."""
        if self.goal is None:
            return None
        row, col = self.frame.continuous_rowcol_from_xy([self.goal])[0]
        rows = np.arange(self.shape[0])[:, np.newaxis] + 0.5 - row
        return np.asarray(np.hypot(rows, np.arange(self.shape[1]) + 0.5 - col) * self.resolution)

    @canvas.layer_of_box
    def potential(self) -> NDArray[np.float64]:
        """Sum of both parts times their gains, shape (H, W); `repulsive` if there is no goal."""
        if self.attractive is None:
            return self.repulsive
        return self.attractive_gain * self.attractive + self.repulsive_gain * self.repulsive

    @canvas.layer_of_box
    def normalised(self) -> NDArray[np.float64]:
        """Potential scaled to 0..10, shape (H, W); all 0 if it is constant."""
        low, high = float(self.potential.min()), float(self.potential.max())
        return np.zeros(self.shape) if high == low else 10 * (self.potential - low) / (high - low)

    @canvas.layer_of_box
    def gradient(self) -> NDArray[np.float64]:
        """Gradient of the potential along x and y of the map frame, per metre, shape (2, H, W).

        It points uphill: central differences, one-sided at the border. Those next to an obstacle
        include its cell, whose own term is missing from the sum; `downhill_surface` adds it.
        """
        return self._slopes(self.potential)

    @canvas.layer_of_box
    def gradient_magnitude(self) -> NDArray[np.float64]:
        """Magnitude of the gradient, per metre, shape (H, W)."""
        return np.asarray(np.hypot(*self.gradient))

    @canvas.layer_of_box
    def cost_to_go_gradient(self) -> NDArray[np.float64] | None:
        """Gradient of `cost_to_go`, as `gradient`, shape (2, H, W); nan where that is infinite."""
        if self.cost_to_go is None:
            return None
        return self._along_map_axes(*(_rises(self.cost_to_go, axis) for axis in (0, 1)))

    def downhill_surface(self) -> NDArray[np.float64]:
        """Return the potential with 2 / resolution added in obstacle cells, shape (H, W).

        The sum has no term for the cell itself, so that a lone obstacle would be a pit.
        """
        if self.region is not None:
            return canvas.embedded(self.cropped.downhill_surface(), self.shape, self.region)
        gain = 1.0 if self.goal is None else self.repulsive_gain
        surface = self.potential.copy()
        surface[self.obstacles()] += 2.0 * gain / self.resolution
        return surface

    def downhill(self) -> NDArray[np.float64]:
        """Return unit vectors down the `downhill_surface`, shape (2, H, W), 0 where it is level."""
        if self.region is not None:
            return canvas.embedded(self.cropped.downhill(), self.shape, self.region, fill=0.0)
        slopes = self._slopes(self.downhill_surface())
        length = np.hypot(*slopes)
        directions = np.zeros_like(slopes)
        np.divide(-slopes, length, out=directions, where=length > 0)
        return directions

    def _slopes(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives along x and y of the map frame, per metre, shape (2, H, W)."""
        height, width = self.shape
        along_rows = np.gradient(values, axis=0) if height > 1 else np.zeros(self.shape)
        along_cols = np.gradient(values, axis=1) if width > 1 else np.zeros(self.shape)
        return self._along_map_axes(along_rows, along_cols)

    def _along_map_axes(self, along_rows: Floats, along_cols: Floats) -> Floats:
        cos, sin = math.cos(self.origin[2]), math.sin(self.origin[2])
        slopes = np.empty((2, *self.shape))
        np.subtract(along_cols * cos, along_rows * sin, out=slopes[0])
        np.add(along_cols * sin, along_rows * cos, out=slopes[1])
        slopes /= self.resolution
        return slopes


def _rises(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return central differences of finite values along an axis, one-sided beside others, nan."""
    with np.errstate(invalid="ignore"):
        steps = np.diff(values, axis=axis)
    is_known = np.isfinite(steps)
    steps[~is_known] = 0
    total, count = np.zeros_like(values), np.zeros(values.shape, np.uint8)
    for side in (np.s_[1:], np.s_[:-1]):
        cells = side if axis == 0 else (np.s_[:], side)
        total[cells] += steps
        count[cells] += is_known
    total /= np.maximum(count, 1)
    total[~np.isfinite(values)] = np.nan
    return total
