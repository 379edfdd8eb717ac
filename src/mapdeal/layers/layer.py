"""The base class of costmap layers, and the master grid that they change in order.

A new layer is one module in this package with a subclass of `CostmapLayer`: `catalogue` finds it,
and recipes, parameter files, ``lint`` and ``info`` know it from then on.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, Protocol, get_type_hints

import numpy as np

from mapdeal import records
from mapdeal.command import split_optional
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OneLineRepr
from mapdeal.kernels.arrays import Array, Bytes, Floats, Mask, SignedBytes
from mapdeal.kernels.threads import for_rows

Window = tuple[slice, slice]  # rows and columns of a grid
TYPES = {bool: "bool", int: "integer", float: "double", str: "string"}


def grown(window: Window, cells: int) -> Window:
    rows, cols = (slice(max(0, side.start - cells), side.stop + cells) for side in window)
    return rows, cols


def within(window: Window, outer: Window) -> Window:
    """Return a window as seen from the first cell of an outer one."""
    sides = zip(window, outer, strict=True)
    rows, cols = (slice(side.start - wide.start, side.stop - wide.start) for side, wide in sides)
    return rows, cols


@dataclass(eq=False)
class MasterGrid:
    """Rows of a costmap while its layers are applied, and the inputs that layers read."""

    costs: Bytes  # on scale costmap2d, shape (H, W); layers change them in place
    rows: slice  # of the whole costmap
    shape: tuple[int, int]  # of the whole costmap
    cell_size: float  # metres, as the costmap has it: often the float32 of a map message
    default_cost: int  # of an empty costmap, 0 or 255
    occupancy: SignedBytes  # of the map at each cell
    in_map: Mask | None = None  # which cells lie in the map; None if all do
    lay_mask_over: Callable[[Array, slice], object] | None = None  # raises costs of some rows
    under_robot: Mask | None = None  # cells below its footprint; None if it stands outside

    def part(self, window: Window) -> MasterGrid:
        """Return a part of the grid, whose costs are a view."""
        masks = (self.in_map, self.under_robot)
        in_map, under_robot = (None if mask is None else mask[window] for mask in masks)
        return replace(
            self, costs=self.costs[window], rows=window[0], occupancy=self.occupancy[window],
            in_map=in_map, under_robot=under_robot,
        )  # fmt: skip

    def raise_to(
        self, costs: Bytes, *, within: Mask | None = None, unknown_is_highest: bool = False
    ) -> None:
        """Raise costs, as ``updateWithMax`` does: unknown never wins, and any cost replaces it."""
        # rolling static layers of older releases compare bytes instead, of which 255 is the highest
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


class Bounds:
    """The rectangle that an update of a costmap changes, metres; empty until it is touched."""

    def __init__(self) -> None:
        self.low, self.high = [1e30, 1e30], [-1e30, -1e30]

    def touch(self, *coordinates: Floats) -> None:
        """Enlarge the rectangle to points, given by all x and all y."""
        for axis, values in enumerate(coordinates):
            if len(values):
                self.low[axis] = min(self.low[axis], float(values.min()))
                self.high[axis] = max(self.high[axis], float(values.max()))


@dataclass
class Update:
    """One update of a costmap: the time, nanoseconds, and the robot's footprint, metres."""

    time: int
    footprint: tuple[Floats, Floats]
    bounds: Bounds


@records.dataclass(frozen=True)
class LivePlace:
    frame: Frame  # before the first update
    map_frame: Frame | None  # of the map of static layers, in the costmap's frame of reference
    is_rolling: bool
    size_margin: float  # cells by which its size in metres is less: 0.5 in ROS 1 and older Nav2
    is_ros1: bool


class LiveLayer:
    """A layer in a costmap that is updated again and again, as the robot does."""

    def __init__(self, layer: CostmapLayer, place: LivePlace) -> None:
        self.layer, self.place, self.frame = layer, place, place.frame

    def move(self, frame: Frame, rows: int, cols: int) -> None:
        """Move with a rolling costmap, by rows and columns."""
        self.frame = frame

    def update_bounds(self, update: Update) -> None:
        """Enlarge the bounds of an update to the cells that the layer changes."""

    def update_costs(self, master: MasterGrid, window: Window) -> None:
        part = master.part(window)
        self.layer.apply(part)
        master.costs[window] = part.costs


class Nav2Values(Protocol):
    """Interface through which layers read the parameters of a Nav2 node."""

    parameters: Mapping[str, Any]
    up_to_kilted: bool  # whether the node is that of Nav2 Kilted or an earlier release

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
    def search(self, name: str) -> Any: ...
    def place(self, layer: str, parameter: str) -> tuple[str, ...]: ...
    def boolean(self, default: bool, *below: str) -> bool: ...
    def double(self, default: float, *below: str, unit: str = ...) -> float: ...
    def integer(self, default: int, *below: str) -> int: ...
    def clamp(
        self, number: float, upper: float, component: str, below: tuple[str, ...], unit: str = ...
    ) -> float: ...
    def problem(
        self, check: str, level: Any, text: str, below: tuple[str, ...] = ...,
        hint: str | None = ...,
    ) -> None: ...  # fmt: skip


@records.dataclass(frozen=True)
class PluginEntry:
    """An entry of a costmap's list of plugins, with the robot's inscribed radius, metres."""

    name: str
    plugin: str
    inscribed_radius: float


@dataclass(frozen=True, repr=False)
class CostmapLayer(OneLineRepr):
    """Settings of one costmap layer, and its effect on the costs below it.

    The fields of a subclass are the parameters that recipes accept, with their defaults and, in
    ``Annotated``, their conditions.
    """

    name: str = ""

    key: ClassVar[str] = ""  # kind of layer in recipes
    nav2_plugins: ClassVar[tuple[str, ...]] = ()
    ros1_plugins: ClassVar[tuple[str, ...]] = ()
    about: ClassVar[str] = ""  # for tables: what the layer does to the costs
    reads_map: ClassVar[bool] = False
    spreads: ClassVar[bool] = False  # costs around lethal cells
    marks_obstacles: ClassVar[bool] = False  # lethal costs that a later inflation sees
    needs: ClassVar[str] = ""  # input besides the map without which it is idle
    memory: ClassVar[float] = 0.0  # bytes per cell while it is applied
    nav2_parameters: ClassVar[Mapping[str, str]] = {}  # types, besides those of fields
    other_parameters: ClassVar[frozenset[str]] = frozenset()  # names without effect
    costmap_parameters: ClassVar[tuple[str, ...]] = ()  # that Nav2 reads from the costmap
    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = ()  # of a costmap, before the layer's

    @property
    def overwrites_all(self) -> bool:
        """Whether the layer replaces all costs below it."""
        return False

    def why_idle(self, has_unknown: bool) -> str | None:
        """Return why the layer changes no cost; `has_unknown`: cells below may be unknown."""
        return None

    def unknown_after(self, is_unknown: bool) -> bool:
        """Return whether a cell unknown in the map stays unknown, given whether it was before."""
        return is_unknown

    def may_leave_unknown(self, may_be_unknown: bool) -> bool:
        """Return whether any cell may be unknown afterwards, given whether one may be before."""
        return self.unknown_after(may_be_unknown)

    def halo(self, shape: tuple[int, int], cell_size: float) -> int:
        """Return the largest number of rows between a cell and a cell that it affects."""
        return 0

    @abstractmethod
    def apply(self, master: MasterGrid) -> None:
        """Change the costs of the master grid, in place."""

    def live(self, place: LivePlace, sensing: Any) -> LiveLayer:
        """Return the layer as a robot updates it; `sensing` is what `sensing_from_nav2` returns."""
        return LiveLayer(self, place)

    @classmethod
    def sensing_from_nav2(cls, values: Nav2Values, name: str) -> Any:
        """Return the parameters that have an effect only with observations, if there are any."""
        return None

    @classmethod
    def sensing_from_ros1(cls, server: Ros1Values, name: str) -> Any:
        return None

    def effect(self) -> str:
        return self.about

    @classmethod
    def from_nav2(cls, values: Nav2Values, entry: PluginEntry) -> CostmapLayer:
        """Return the layer with its parameters; each is a field of the class."""
        values.check_types(cls.nav2_parameters, f"{entry.name}.")
        settings = {
            field: values.get(f"{entry.name}.{field}", TYPES[kind], default)
            for field, (kind, default) in cls._plain_fields().items()
        }
        return cls(entry.name, **settings)

    @classmethod
    def from_ros1(cls, server: Ros1Values, entry: PluginEntry) -> CostmapLayer:
        readers: dict[type, Any]
        readers = {bool: server.boolean, int: server.integer, float: server.double}
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
        own = [field for field in fields(cls) if field.name != "name"]
        return {field.name: (split_optional(hints[field.name])[0], field.default) for field in own}

    def with_inscribed_radius(self, previous_radius: float, footprint: Footprint) -> CostmapLayer:
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
