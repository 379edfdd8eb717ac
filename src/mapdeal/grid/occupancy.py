"""The occupancy grid: the contents of a map file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal import errors, records
from mapdeal.grid.frame import Figures, Origin, ValueGrid, as_layer, library
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels import blocks, lookup


@records.dataclass(frozen=True, eq=False, repr=False)
class OccupancyGrid(ValueGrid):
    """A grid of occupancy values, like ``nav_msgs/OccupancyGrid``.

    Parameters
    ----------
    occupancy : array_like of int8, shape (H, W)
        Occupancy: -1 unknown, 0 free, 100 occupied, 1..99 in between; or bool, True for occupied
        cells. Row 0 is the south. Kept as a read-only view: do not modify the underlying array.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).

    Raises
    ------
    ParameterError
        If a value lies outside -1..100, or the geometry is not finite.

    Examples
    --------
    >>> grid = OccupancyGrid([[0, 100, -1]], resolution=0.05, origin=(1.0, 2.0, 0.0))
    >>> grid.shape, grid.occupied().tolist()
    ((1, 3), [[False, True, False]])
    """

    kind = "occupancy grid"
    layer_names: ClassVar[tuple[str, ...]] = ("occupancy",)
    occupancy: NDArray[np.int8]
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    if TYPE_CHECKING:  # callers may pass lists

        def __init__(
            self, occupancy: ArrayLike, resolution: float, origin: Sequence[float] = ...
        ) -> None: ...

    def __post_init__(self) -> None:
        self._freeze(occupancy=as_occupancy_layer(self.occupancy))

    def _own_figures(self) -> Figures:
        return occupancy_figures(blocks.counts_of(self.occupancy))

    def _repr_values(self) -> Iterator[str]:
        figures = occupancy_figures(blocks.counts_of(self.occupancy))
        if figures["between"]:
            yield f"{figures['between']} in 1..99"
        yield from (f"{figures[name]} {name}" for name in ("occupied", "free", "unknown"))

    @property
    def value_range(self) -> tuple[int, int]:
        return UNKNOWN, OCCUPIED

    @property
    def unknown_value(self) -> int:
        return UNKNOWN

    def to_occupancy(self) -> OccupancyGrid:
        """Return the map itself, which ROS publishes as it is."""
        return self

    def _colours(self) -> dict[str, Any]:
        cmap = library("matplotlib").colormaps["gray_r"].with_extremes(bad="lightsteelblue")
        return {"cmap": cmap, "vmin": FREE, "vmax": OCCUPIED}

    def amcl_states(self) -> NDArray[np.int8]:
        """Return amcl's view of the map: -1 free, +1 occupied, 0 unknown; int8, shape (H, W).

        Like -1, values 1..99 are unknown to amcl: ``convertMap`` in ``amcl_node.cpp``.

        Examples
        --------
        >>> OccupancyGrid([[0, 1, 99, 100, -1]], 0.05).amcl_states()
        array([[-1,  0,  0,  1,  0]], dtype=int8)
        """
        table = np.zeros(256, dtype=np.int8)
        table[[FREE, OCCUPIED]] = -1, 1
        return lookup.look_up(self.occupancy, table)

    def as_amcl_sees_it(self) -> OccupancyGrid:
        """Return the map as amcl interprets it: 0 free, 100 occupied, all other values unknown."""
        table = np.full(256, UNKNOWN, dtype=np.int8)
        table[[FREE, OCCUPIED]] = FREE, OCCUPIED
        return self.with_values(lookup.look_up(self.occupancy, table))

    def occupied(self, lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD) -> NDArray[np.bool_]:
        """Return the mask of obstacle cells, those at or above `lethal_threshold`."""
        return blocks.mapped(self.occupancy, bool, lambda values: values >= lethal_threshold)

    def unknown(self) -> NDArray[np.bool_]:
        """Return the mask of unknown cells."""
        return blocks.mapped(self.occupancy, bool, lambda values: values == UNKNOWN)


@records.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CloudLayers(OccupancyGrid):
    """A map made of point clouds, with the layers of ``CloudMap.layers``."""

    kind = "cloud"
    layer_names = ("occupancy", "floor_height", "obstacle_height", "slope", "points")
    floor_height: NDArray[np.float32]
    obstacle_height: NDArray[np.float32]
    slope: NDArray[np.float32]
    points: NDArray[np.int32]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._freeze(**{name: getattr(self, name) for name in self.layer_names})

    def with_values(self, values: NDArray[Any], origin: Origin | None = None) -> Any:
        grid = OccupancyGrid(self.occupancy, self.resolution, self.origin)
        return grid.with_values(values, origin)  # the other layers may not fit


def occupancy_figures(counts: NDArray[np.int64]) -> Figures:
    occupied, free, unknown = (int(counts[value]) for value in (OCCUPIED, FREE, UNKNOWN))
    between = int(counts.sum()) - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}


def as_occupancy_layer(values: ArrayLike) -> NDArray[np.int8]:
    rule = "occupancy must hold -1 (unknown), whole numbers from 0 to 100, or bool"
    occupancy = as_layer(values, np.int8, "occupancy", true=OCCUPIED, rule=rule)
    if blocks.is_lazy(occupancy):
        return occupancy
    if occupancy.size and (occupancy.min() < UNKNOWN or occupancy.max() > OCCUPIED):
        raise errors.ParameterError(rule, got=(int(occupancy.min()), int(occupancy.max())))
    return occupancy
