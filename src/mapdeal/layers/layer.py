"""The base class of costmap layers, and the master grid that they change in order.

A new layer is one module in this package with a subclass of `CostmapLayer`: `catalogue` finds it,
and recipes, parameter files, ``lint`` and ``info`` know it from then on.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Protocol, get_type_hints

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import split_optional
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OneLine
from mapdeal.kernels.threads import for_rows

Costs = NDArray[np.uint8]
Mask = NDArray[np.bool_]


class KeepoutCosts(Protocol):
    """Costs of a keepout mask at the cells of a costmap."""

    def lay_over(self, costs: NDArray[Any], rows: slice) -> None:
        """Raise the costs of some rows, in place, to those of the mask."""


@dataclass(eq=False)
class MasterGrid:
    """Rows of a costmap while its layers are applied, and the inputs that layers read.

    Parameters
    ----------
    costs : numpy.ndarray of uint8, shape (H, W)
        Costs so far, on scale ``costmap2d``. Layers change them in place.
    rows : slice
        Which rows of the whole costmap these are.
    shape : tuple of int
        Rows and columns of the whole costmap.
    cell_size : float
        Side of a cell as the costmap has it, metres: often the float32 of a map message.
    default_cost : int
        Cost of an empty costmap, 0 or 255.
    occupancy : numpy.ndarray of int8, shape (H, W)
        Value of the map at each cell.
    in_map : numpy.ndarray of bool, shape (H, W), optional
        Which cells lie in the map; None if all do.
    keepout : KeepoutCosts, optional
        The keepout mask, if there is one.
    under_robot : numpy.ndarray of bool, shape (H, W), optional
        Cells that the robot's footprint covers; None if it stands outside of the costmap.
    """

    costs: Costs
    rows: slice
    shape: tuple[int, int]
    cell_size: float
    default_cost: int
    occupancy: NDArray[np.int8]
    in_map: Mask | None = None
    keepout: KeepoutCosts | None = None
    under_robot: Mask | None = None

    def overwrite(self, costs: Costs, *, within: Mask | None = None) -> None:
        """Replace costs, of the cells in a mask or all, as ``updateWithTrueOverwrite`` does."""
        self.costs = costs if within is None else np.where(within, costs, self.costs)

    def raise_to(
        self, costs: Costs, *, within: Mask | None = None, unknown_is_highest: bool = False
    ) -> None:
        """Raise costs, as ``updateWithMax`` does: unknown never wins, and any cost replaces it.

        Rolling static layers of older releases compare bytes instead, of which 255 is the highest.
        """
        if within is not None:
            lowest = FREE_SPACE if unknown_is_highest else NO_INFORMATION
            costs = np.where(within, costs, np.uint8(lowest))
        raised = self.costs
        if unknown_is_highest:
            np.maximum(raised, costs, out=raised)
            return

        def raise_rows(rows: slice) -> None:
            # Adding 1 wraps 255 (unknown) to 0, so that unknown never wins.
            raised[rows] += np.uint8(1)
            np.maximum(raised[rows], costs[rows] + np.uint8(1), out=raised[rows])
            raised[rows] -= np.uint8(1)

        for_rows(raise_rows, raised.shape)


class Nav2Values(Protocol):
    """Interface through which layers read the parameters of a Nav2 node."""

    parameters: Mapping[str, Any]
    older: bool

    def get(self, name: str, kind: str, default: Any, *, level: Any = ...) -> Any: ...
    def flag(self, name: str, default: bool = ...) -> bool: ...
    def number(self, name: str, default: float, *, least: float = ...) -> float: ...
    def check_types(self, parameters: Mapping[str, str], prefix: str = ...) -> None: ...
    def problem(
        self, check: str, level: Any, text: str, name: str = ..., hint: str | None = ...
    ) -> None: ...


class Ros1Values(Protocol):
    """Interface through which layers read ROS 1's parameters below a costmap's namespace."""

    @property
    def is_substituted(self) -> bool: ...
    def find(self, *below: str) -> Any: ...
    def place(self, layer: str, parameter: str) -> tuple[str, ...]: ...
    def boolean(self, default: bool, *below: str) -> bool: ...
    def double(self, default: float, *below: str, unit: str = ...) -> float: ...
    def integer(self, default: int, *below: str) -> int: ...
    def limited(
        self, number: float, most: float, who: str, below: tuple[str, ...], unit: str = ...
    ) -> float: ...
    def problem(
        self, check: str, level: Any, text: str, below: tuple[str, ...] = ...,
        hint: str | None = ...,
    ) -> None: ...  # fmt: skip


@dataclass(frozen=True)
class PluginEntry:
    """An entry of a costmap's list of plugins, with the robot's inscribed radius, metres."""

    name: str
    plugin: str
    inscribed_radius: float


_TYPES = {bool: "bool", int: "integer", float: "double", str: "string"}


@dataclass(frozen=True, repr=False)
class CostmapLayer(OneLine):
    """Settings of one costmap layer, and its effect on the costs below it.

    The fields of a subclass are the parameters that recipes accept, with their defaults and, in
    ``Annotated``, their conditions.
    """

    name: str = ""

    key: ClassVar[str] = ""
    """Kind of layer in recipes."""

    nav2_plugins: ClassVar[tuple[str, ...]] = ()
    ros1_plugins: ClassVar[tuple[str, ...]] = ()

    about: ClassVar[str] = ""
    """One line for tables: what the layer does to the costs."""

    reads_map: ClassVar[bool] = False

    spreads: ClassVar[bool] = False
    """Whether it spreads costs around lethal cells."""

    marks_obstacles: ClassVar[bool] = False
    """Whether it writes lethal costs that a later inflation layer has to see."""

    needs: ClassVar[str] = ""
    """Input besides the map without which the layer is idle, such as observations."""

    memory: ClassVar[float] = 0.0
    """Bytes for each cell that it takes while it is applied."""

    nav2_parameters: ClassVar[Mapping[str, str]] = {}
    """Types of parameters that Nav2 declares below the layer, besides the fields."""

    other_parameters: ClassVar[frozenset[str]] = frozenset()
    """Names without effect on a map that some release reads, here or at another level."""

    costmap_parameters: ClassVar[tuple[str, ...]] = ()
    """Parameters that Nav2 reads from the costmap: below the layer they have no effect."""

    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = ()
    """Parameters of a costmap that override those of the layer in ROS 1."""

    @property
    def overwrites_all(self) -> bool:
        """Whether the layer replaces all costs below it."""
        return False

    def why_idle(self, has_unknown: bool) -> str | None:
        """Return why the layer changes no cost; `has_unknown`: cells below may be unknown."""
        return None

    def unknown_after(self, is_unknown: bool) -> bool:
        """Return whether a cell unknown in the map is unknown after this layer is applied.

        `is_unknown` is whether the cell was unknown before.
        """
        return is_unknown

    def may_leave_unknown(self, may_be_unknown: bool) -> bool:
        """Return whether any cell may be unknown after this layer is applied.

        `may_be_unknown` is whether any cell may be unknown before.
        """
        return self.unknown_after(may_be_unknown)

    def halo(self, shape: tuple[int, int], cell_size: float) -> int:
        """Return the largest number of rows between a cell and a cell that it affects."""
        return 0

    @abstractmethod
    def apply(self, master: MasterGrid) -> None:
        """Change the costs of the master grid, in place."""

    def effect(self) -> str:
        return self.about

    @classmethod
    def from_nav2(cls, values: Nav2Values, entry: PluginEntry) -> CostmapLayer:
        """Return the layer with its parameters; each is a field of the class."""
        values.check_types(cls.nav2_parameters, f"{entry.name}.")
        settings = {
            field: values.get(f"{entry.name}.{field}", _TYPES[kind], default)
            for field, (kind, default) in cls._plain_fields().items()
        }
        return cls(entry.name, **settings)

    @classmethod
    def from_ros1(cls, server: Ros1Values, entry: PluginEntry) -> CostmapLayer:
        readers: dict[type, Any] = {
            bool: server.boolean, int: server.integer, float: server.double
        }  # fmt: skip
        settings = {
            field: readers[kind](default, entry.name, field)
            for field, (kind, default) in cls._plain_fields().items()
        }
        return cls(entry.name, **settings)

    @classmethod
    def known_parameters(cls, plugin: str) -> frozenset[str]:
        """Return the parameter names that ``lint`` accepts below a layer of this class."""
        names = (field.name for field in fields(cls) if field.name != "name")
        return frozenset({"plugin", "enabled", *names, *cls.nav2_parameters, *cls.other_parameters})

    @classmethod
    def _plain_fields(cls) -> dict[str, tuple[type, Any]]:
        hints = get_type_hints(cls)
        return {
            field.name: (split_optional(hints[field.name])[0], field.default)
            for field in fields(cls)
            if field.name != "name"
        }

    def with_inscribed_radius(self, before: float, footprint: Footprint) -> CostmapLayer:
        """Return the layer for a footprint, if its inscribed radius was that of the old one."""
        return self

    def described(self) -> dict[str, dict[str, Any]]:
        return {self.key: asdict(self)}

    def _repr_parts(self) -> Iterator[str]:
        yield self.name
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "name" and value != field.default:
                yield f"{field.name} {value}"
