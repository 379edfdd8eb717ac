"""Costmap layer ``static``: the map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from mapdeal.command import PERCENT, Condition
from mapdeal.grid import values as map_values
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OCCUPIED
from mapdeal.kernels import arrays, lookup
from mapdeal.layers import layer as base

_BYTE = Condition("a byte, 0 to 255, or -1 for 255", lambda value: -1 <= value <= 255)


@dataclass(frozen=True, repr=False)
class StaticLayer(base.CostmapLayer):
    """Settings of costmap_2d's static layer, which converts map values to costs.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    track_unknown_space : bool
        Whether cells of `unknown_cost_value` become 255 instead of 0.
    lethal_cost_threshold : int
        Least value that becomes 254, 0..100.
    trinary_costmap : bool
        Whether lower values become 0 instead of their share of 254.
    unknown_cost_value : int
        Value that means unknown, as a byte 0..255; 255 is -1.
    inscribed_obstacle_cost_value : int, optional
        Value that becomes 253. Nav2 newer than Kilted uses 99; None for all others.
    use_maximum : bool
        Whether the layer only raises the costs of the layers below it, with no effect in its
        unknown cells. Otherwise it replaces them.
    unknown_is_highest : bool
        Whether, with `use_maximum`, 255 counts as the highest cost, so that unknown replaces
        lethal. Rolling costmaps of ROS 1 and of Nav2 before pull request 6516 do so.
    footprint_clearing_enabled : bool
        Whether the cells below the robot are free, if its pose is known.

    References
    ----------
    ``interpretValue`` and ``updateCosts`` in ``static_layer.cpp``.
    """

    name: str = "static_layer"
    track_unknown_space: bool = True
    lethal_cost_threshold: Annotated[int, PERCENT] = 100
    trinary_costmap: bool = True
    unknown_cost_value: Annotated[int, _BYTE] = 255
    inscribed_obstacle_cost_value: Annotated[int, _BYTE] | None = None
    use_maximum: bool = False
    unknown_is_highest: bool = False
    footprint_clearing_enabled: bool = False
    key: ClassVar[str] = "static"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::StaticLayer",)
    ros1_plugins: ClassVar[tuple[str, ...]] = ("costmap_2d::StaticLayer",)
    about: ClassVar[str] = "converts the values of the map to costs"
    reads_map: ClassVar[bool] = True
    marks_obstacles: ClassVar[bool] = True
    nav2_parameters: ClassVar[Mapping[str, str]] = {
        "subscribe_to_updates": "bool", "map_subscribe_transient_local": "bool",
        "footprint_clearing_enabled": "bool", "restore_cleared_footprint": "bool",
        "map_topic": "string", "transform_tolerance": "double",
    }  # fmt: skip
    other_parameters: ClassVar[frozenset[str]] = frozenset({"first_map_only", "resize_master"})
    costmap_parameters: ClassVar[tuple[str, ...]] = (
        "track_unknown_space", "lethal_cost_threshold", "unknown_cost_value", "trinary_costmap",
        "use_maximum", "inscribed_obstacle_cost_value",
    )  # fmt: skip
    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = (
        "map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("unknown_cost_value", "inscribed_obstacle_cost_value"):
            if getattr(self, name) == -1:
                object.__setattr__(self, name, NO_INFORMATION)

    @property
    def overwrites_all(self) -> bool:
        return not self.use_maximum

    def unknown_after(self, is_unknown: bool) -> bool:
        return self.may_leave_unknown(is_unknown, self.unknown_cost_value == NO_INFORMATION)

    def may_leave_unknown(self, may_be_unknown: bool, has_value: bool = True) -> bool:
        # `has_value` is whether cells have `unknown_cost_value`: those of a map may have any value.
        tracks = self.track_unknown_space and has_value
        if not self.use_maximum:
            return tracks
        return tracks or may_be_unknown if self.unknown_is_highest else tracks and may_be_unknown

    def apply(self, master: base.MasterGrid) -> None:
        inscribed, unknown = self.inscribed_obstacle_cost_value, self.unknown_cost_value
        table = map_values.static_layer_cost_from_occupancy(
            lethal_threshold=self.lethal_cost_threshold,
            trinary=self.trinary_costmap,
            track_unknown=self.track_unknown_space,
            inscribed_value=inscribed if inscribed is not None and inscribed <= OCCUPIED else None,
            unknown_value=unknown,
        )
        if inscribed == NO_INFORMATION != unknown:  # the byte of -1
            table[inscribed] = map_values.INSCRIBED_INFLATED_OBSTACLE
        costs: arrays.Bytes = lookup.look_up(master.occupancy, table)
        if self.footprint_clearing_enabled and master.under_robot is not None:
            lookup.set_where(costs, master.under_robot, FREE_SPACE)
        in_map = master.in_map
        if self.use_maximum:
            master.raise_to(costs, within=in_map, unknown_is_highest=self.unknown_is_highest)
        else:  # as ``updateWithTrueOverwrite``
            master.costs = costs if in_map is None else np.where(in_map, costs, master.costs)

    def live(self, place: base.LivePlace, sensing: None) -> LiveStatic:
        return LiveStatic(self, place)

    def effect(self) -> str:
        least = self.lethal_cost_threshold
        lethal = f"{least}" if least == OCCUPIED else f"{least}..{OCCUPIED}"
        text = f"occupancy {lethal} is lethal"
        if self.inscribed_obstacle_cost_value is not None and not self.trinary_costmap:
            text += f", {self.inscribed_obstacle_cost_value} inscribed"
        text += ", all else free" if self.trinary_costmap else ", less costs its share of 254"
        if self.unknown_cost_value != NO_INFORMATION:
            text += f"; {self.unknown_cost_value} counts as unknown, and -1 as lethal"
        text += ", unknown " + ("stays unknown" if self.track_unknown_space else "becomes free")
        if not self.use_maximum:
            return text
        text += "; costs are only raised"
        return f"{text}, unknown above lethal" if self.unknown_is_highest else text

    @classmethod
    def from_nav2(cls, values: base.Nav2Values, entry: base.PluginEntry) -> StaticLayer:
        name = entry.name
        values.check_types(cls.nav2_parameters, f"{name}.")
        parameter = f"{name}.footprint_clearing_enabled"
        is_legacy = values.up_to_kilted
        clears = not is_legacy and values.flag(parameter)
        if clears:
            text = "frees the cells below the robot; only cost --pose does so"
            values.problem("params.footprint-clearing", "note", text, parameter)
        lethal = values.get("lethal_cost_threshold", "integer", 100)
        clamped = max(min(lethal, 100), 0)
        if clamped != lethal:
            text = f"must be 0 .. 100; the static layer uses {clamped}"
            values.problem("params.range", "warning", text, "lethal_cost_threshold")
        inscribed = None
        if not is_legacy:
            inscribed = values.get("inscribed_obstacle_cost_value", "integer", 99) % 256
        use_maximum = values.flag("use_maximum")
        return cls(
            name=name, track_unknown_space=values.flag("track_unknown_space"),
            lethal_cost_threshold=clamped, trinary_costmap=values.flag("trinary_costmap", True),
            unknown_cost_value=values.get("unknown_cost_value", "integer", 255) % 256,
            inscribed_obstacle_cost_value=inscribed, use_maximum=use_maximum,
            unknown_is_highest=use_maximum and is_legacy and values.flag("rolling_window"),
            footprint_clearing_enabled=clears,
        )  # fmt: skip

    @classmethod
    def from_ros1(cls, server: base.Ros1Values, entry: base.PluginEntry) -> StaticLayer:
        name = entry.name
        threshold = server.place(name, "lethal_cost_threshold")
        lethal = server.clamp(server.integer(100, *threshold), 100, "the static layer", threshold)
        unknown = server.place(name, "unknown_cost_value")
        use_maximum = server.boolean(False, name, "use_maximum")
        tracks = server.boolean(True, *server.place(name, "track_unknown_space"))
        trinary = server.boolean(True, name, "trinary_costmap")
        unknown_cost = server.integer(-1, *unknown) % 256
        return cls(
            name, tracks, int(lethal), trinary, unknown_cost, use_maximum=use_maximum,
            unknown_is_highest=use_maximum and server.boolean(False, "rolling_window"),
        )  # fmt: skip

    def _repr_parts(self) -> Iterator[str]:
        yield self.name
        yield f"lethal from {self.lethal_cost_threshold}"
        yield "unknown tracked" if self.track_unknown_space else "unknown free"


class LiveStatic(base.LiveLayer):
    """A map that is new in the first update, or lies below a rolling costmap."""

    _is_new = True

    def update_bounds(self, update: base.Update) -> None:
        rolls = self.place.is_rolling
        frame = self.place.map_frame
        if rolls and not self.place.size_margin:  # Nav2 newer than Kilted
            frame = self.frame
        if frame is not None and (rolls or self._is_new):
            x, y, _ = frame.origin
            width, height = frame.size_xy
            ends = np.array([[x, x + width], [y, y + height]]) + frame.resolution / 2
            update.bounds.touch(*ends)
        self._is_new = False
        if isinstance(self.layer, StaticLayer) and self.layer.footprint_clearing_enabled:
            update.bounds.touch(*update.footprint)
