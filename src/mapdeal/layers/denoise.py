"""Costmap layer ``denoise``: frees small groups of obstacle cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from mapdeal.command import AT_LEAST_0, Condition
from mapdeal.grid.values import FREE_SPACE, INSCRIBED_INFLATED_OBSTACLE, NO_INFORMATION
from mapdeal.kernels import components, lookup
from mapdeal.layers.layer import CostmapLayer, MasterGrid, Nav2Values, PluginEntry

_CONNECTIVITY = Condition("4 or 8", lambda value: value in (4, 8))


@dataclass(frozen=True, repr=False)
class DenoiseLayer(CostmapLayer):
    """Settings of Nav2's denoise layer, which frees small groups of obstacles.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    minimal_group_size : int
        Number of cells that a group needs to stay; with 1 or less the layer has no effect.
    group_connectivity_type : int
        8 if cells that share a corner are one group, 4 if only those that share an edge are.

    References
    ----------
    ``denoise_layer.cpp`` of nav2_costmap_2d.
    """

    name: str = "denoise_layer"
    minimal_group_size: Annotated[int, AT_LEAST_0] = 2
    group_connectivity_type: Annotated[int, _CONNECTIVITY] = 8
    key: ClassVar[str] = "denoise"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::DenoiseLayer",)
    about: ClassVar[str] = "frees small groups of obstacle cells"
    memory: ClassVar[float] = 14.0  # labels of groups, with their sizes and masks

    def why_idle(self, has_unknown: bool) -> str | None:
        return "minimal_group_size is 1" if self.minimal_group_size <= 1 else None

    def halo(self, shape: tuple[int, int], cell_size: float) -> int:
        # A group that reaches from here to the edge of a window has enough cells to stay.
        return min(self.minimal_group_size, shape[0])

    def apply(self, master: MasterGrid) -> None:
        costs = master.costs
        obstacles = costs >= INSCRIBED_INFLATED_OBSTACLE
        if master.default_cost == NO_INFORMATION:  # otherwise unknown cells belong to groups
            obstacles &= costs != NO_INFORMATION
        corners = self.group_connectivity_type == 8
        large = components.drop_small_groups(obstacles, self.minimal_group_size, corners=corners)
        lookup.set_where(costs, obstacles & ~large, FREE_SPACE)

    def effect(self) -> str:
        shared = "an edge or a corner" if self.group_connectivity_type == 8 else "an edge"
        groups = f"groups of fewer than {self.minimal_group_size} obstacle cells"
        return f"frees {groups} that share {shared}"

    @classmethod
    def from_nav2(cls, values: Nav2Values, entry: PluginEntry) -> DenoiseLayer:
        name = entry.name
        size, connectivity = f"{name}.minimal_group_size", f"{name}.group_connectivity_type"
        minimal, neighbours = values.get(size, "integer", 2), values.get(connectivity, "integer", 8)
        if minimal <= 1:
            text = "must be above 1; the layer has no effect"
            values.problem("params.range", "warning", text, size)
        if neighbours not in (4, 8):
            values.problem("params.range", "warning", "must be 4 or 8; Nav2 uses 8", connectivity)
            neighbours = 8
        return cls(name, max(minimal, 1), neighbours)
