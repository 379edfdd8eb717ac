"""The potential field: repulsion from obstacles and attraction to a goal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.canvas import FieldGrid, layer_of_box, put_around
from mapdeal.grid.display import count_text, numbers_text
from mapdeal.grid.frame import Origin, Point, Region, check_point
from mapdeal.grid.framed import Figures, as_layer
from mapdeal.grid.occupancy import OccupancyGrid, as_occupancy_layer
from mapdeal.grid.values import OCCUPIED

_TOP_OF_NORMALISED = 10.0

LARGEST_GAIN = 1e9
LARGEST_REPULSION = 1e15
"""Beyond what any map has; within, no layer overflows."""


@dataclass(frozen=True, eq=False, repr=False)
class PotentialField(FieldGrid):
    """A potential on a map, high at obstacles and low at the goal.

    Parameters
    ----------
    repulsive : array_like of float64, shape (H, W)
        Sum of 1 / distance over all obstacle cells, at least 0, per metre. It may be nan in unknown
        cells outside one box of cells; all other layers are then nan there, as well.
    occupancy : array_like of int8, shape (H, W)
        The map; its cells of value 100 are the obstacles.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).
    goal : tuple of float, optional
        x and y of the goal in the map frame, metres.
    attractive_gain, repulsive_gain : float
        Weights of the two parts of `potential`.
    repulsive_cap : float
        Upper bound of `repulsive`, per metre.
    region : Region, optional
        Box of the cells that have a potential, None if all have one. It is detected for arrays.

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
    origin: Origin = (0.0, 0.0, 0.0)
    goal: Point | None = None
    attractive_gain: float = 1.0
    repulsive_gain: float = 1.0
    repulsive_cap: float = 1e5
    region: Region | None = None

    def __post_init__(self) -> None:
        repulsive = as_layer(self.repulsive, np.float64, "repulsive")
        if repulsive.size and (  # nan has a rule of its own
            np.fmin.reduce(repulsive, axis=None) < 0
            or np.fmax.reduce(repulsive, axis=None) > LARGEST_REPULSION
        ):
            rule = f"repulsive must lie between 0 and {LARGEST_REPULSION:g}"
            raise ParameterError(rule)
        for name in ("attractive_gain", "repulsive_gain"):
            value = getattr(self, name)
            if not 0 <= value <= LARGEST_GAIN:
                rule = f"must lie between 0 and {LARGEST_GAIN:g}"
                raise ParameterError(rule, place=name, got=value)
        if not 0 < self.repulsive_cap <= LARGEST_REPULSION:
            rule = f"must be above 0, at most {LARGEST_REPULSION:g}"
            raise ParameterError(rule, place="repulsive_cap", got=self.repulsive_cap)
        if self.goal is not None:
            object.__setattr__(self, "goal", check_point(self.goal, "goal"))
        self._freeze(repulsive=repulsive, occupancy=as_occupancy_layer(self.occupancy))
        self._find_region()

    def _own_figures(self) -> Figures:
        return {
            "goal": None if self.goal is None else list(self.goal),
            "obstacles": int(np.count_nonzero(self.obstacles())),
            "lowest_potential": float(self.potential.min()),
            "highest_potential": float(self.potential.max()),
            "steepest_gradient": float(self.gradient_magnitude.max()),
        }

    def _told_of_parameters(self) -> Iterator[str]:
        yield "no goal" if self.goal is None else f"goal {numbers_text(self.goal)}"

    def _told_of_values(self) -> Iterator[str]:
        # Of its own layer alone: the others are arrays that are made when they are asked for.
        yield f"repulsion up to {np.fmax.reduce(self.repulsive, axis=None):.6g} per metre"
        yield count_text(int(np.count_nonzero(self.obstacles())), "obstacle cell")

    def entries(self) -> dict[str, Any]:
        """Return all layers, the map, and the parameters they were computed with."""
        entries: dict[str, Any] = {"repulsive": self.repulsive, "normalised": self.normalised}
        if self.goal is not None:
            entries |= {"attractive": self.attractive, "potential": self.potential}
        entries |= {"gradient": self.gradient, "gradient_magnitude": self.gradient_magnitude}
        if self.goal is not None:
            entries["goal"] = np.array(self.goal)
        return entries | {
            "occupancy": self.occupancy,
            "attractive_gain": np.float64(self.attractive_gain),
            "repulsive_gain": np.float64(self.repulsive_gain),
            "repulsive_cap": np.float64(self.repulsive_cap),
        }

    @property
    def grid(self) -> OccupancyGrid:
        """Map that the potential belongs to."""
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    def obstacles(self) -> NDArray[np.bool_]:
        """Return the mask of obstacle cells."""
        obstacles: NDArray[np.bool_] = self.occupancy == OCCUPIED
        return obstacles

    @layer_of_box
    def attractive(self) -> NDArray[np.float64] | None:
        """Distance from each cell centre to the goal, metres, shape (H, W); None without a goal."""
        if self.goal is None:
            return None
        row, col = self.frame.continuous_rowcol_from_xy([self.goal])[0]
        rows = np.arange(self.shape[0])[:, np.newaxis] + 0.5 - row
        distance: NDArray[np.float64] = np.hypot(rows, np.arange(self.shape[1]) + 0.5 - col)
        distance *= self.resolution
        return _read_only(distance)

    @layer_of_box
    def potential(self) -> NDArray[np.float64]:
        """Sum of both parts times their gains, shape (H, W); `repulsive` if there is no goal."""
        if self.attractive is None:
            return self.repulsive
        total = self.attractive_gain * self.attractive + self.repulsive_gain * self.repulsive
        return _read_only(total)

    @layer_of_box
    def normalised(self) -> NDArray[np.float64]:
        """Potential scaled to 0..10, shape (H, W); all 0 if it is constant."""
        low, high = float(self.potential.min()), float(self.potential.max())
        if high == low:
            return _read_only(np.zeros(self.shape))
        return _read_only(_TOP_OF_NORMALISED * (self.potential - low) / (high - low))

    @layer_of_box
    def gradient(self) -> NDArray[np.float64]:
        """Gradient of the potential along x and y of the map frame, per metre, shape (2, H, W).

        It points uphill; without a goal it is the gradient of the repulsion. It is computed by
        central differences, one-sided at the border, and is 0 along an axis of a single cell. Next
        to an obstacle, the differences include the obstacle cell, whose own term is missing from
        the sum; `downhill_surface` adds it.
        """
        return _read_only(self._slopes(self.potential))

    @layer_of_box
    def gradient_magnitude(self) -> NDArray[np.float64]:
        """Magnitude of the gradient, per metre, shape (H, W)."""
        return _read_only(np.hypot(*self.gradient))

    def downhill_surface(self) -> NDArray[np.float64]:
        """Return the potential with obstacle cells raised, shape (H, W), for descending it.

        The sum in an obstacle cell has no term for the cell itself, which is at distance 0, so
        that a single obstacle cell would be a pit. Here the term of the cell's edge is added,
        2 / resolution.
        """
        if self.region is not None:
            return put_around(self.cropped.downhill_surface(), self.shape, self.region)
        gain = 1.0 if self.goal is None else self.repulsive_gain
        surface = self.potential.copy()
        surface[self.obstacles()] += 2.0 * gain / self.resolution
        return surface

    def downhill(self) -> NDArray[np.float64]:
        """Return the direction of steepest descent, shape (2, H, W).

        It consists of unit vectors along x and y of the map frame on the `downhill_surface`; they
        are 0 where the surface is level or there is no potential.
        """
        if self.region is not None:
            return put_around(self.cropped.downhill(), self.shape, self.region, fill=0.0)
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
        yaw = self.origin[2]
        cos, sin = math.cos(yaw), math.sin(yaw)
        slopes = np.empty((2, height, width))
        np.subtract(along_cols * cos, along_rows * sin, out=slopes[0])
        np.add(along_cols * sin, along_rows * cos, out=slopes[1])
        slopes /= self.resolution
        return slopes


def _read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.flags.writeable = False
    return array
