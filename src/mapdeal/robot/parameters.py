"""A robot as its own parameter files describe it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

from mapdeal.grid.costmap_layers import (
    CostmapLayer,
    CostmapLayers,
    InflationLayer,
    StaticLayer,
)
from mapdeal.grid.display import OneLine
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION
from mapdeal.records import dataclass

Flavour = Literal["nav2", "ros1"]
CostmapName = Literal["global", "local"]

INJECTED = "injected_static"
"""The static layer that a local costmap without one is given: the map is what is asked about."""


@dataclass(frozen=True)
class ListedLayer:
    """A layer or filter in a robot's list, and what it does to a map that is a file.

    Parameters
    ----------
    name : str
        Its name in the list.
    plugin : str
        Its class, as the file has it.
    layer : StaticLayer or InflationLayer, optional
        What is set; None if it does nothing to a file, or mapdeal does not know it.
    is_enabled : bool
        Whether it is switched on.
    is_filter : bool
        Whether it is one of the costmap's filters, which come after all layers.
    why_ignored : str
        Why it has no effect on a file, in a few words; empty if it has one.
    """

    name: str
    plugin: str
    layer: CostmapLayer | None
    is_enabled: bool = True
    is_filter: bool = False
    why_ignored: str = ""


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file that was read, and the sha256 of its bytes."""

    path: Path
    sha256: str


@dataclass(frozen=True, repr=False)
class RobotParameters(OneLine):
    """A robot's shape and the layers of one of its costmaps, as ROS resolves them.

    Parameters
    ----------
    flavour : {'nav2', 'ros1'}
        Whose parameters they are.
    costmap : {'global', 'local'}
        Which of its costmaps this is.
    node : str
        The node's full name, ``/global_costmap/global_costmap``; of ROS 1 the costmap's namespace.
    footprint : Footprint
        The padded polygon, metres; a round robot is a polygon of 16 corners, as ROS has it.
    footprint_padding : float
        How far its corners were moved outwards, metres.
    robot_radius : float, optional
        The radius that it was made of; None if the file gives the corners.
    track_unknown_space : bool
        Whether the costmap starts out unknown, rather than free.
    rolling_window : bool
        Whether it moves with the robot.
    layers : tuple of ListedLayer
        All layers in the file's order, then the filters.
    files : tuple of ParameterFile
        What was read.
    inscribed_radius, circumscribed_radius : float
        Of the padded footprint, as ``calculateMinAndMaxDistances`` has them, metres.
    remarks : tuple of str
        What reading has warned of.
    """

    flavour: Flavour
    costmap: CostmapName
    node: str
    footprint: Footprint
    footprint_padding: float
    robot_radius: float | None
    track_unknown_space: bool
    rolling_window: bool
    layers: tuple[ListedLayer, ...]
    files: tuple[ParameterFile, ...]
    inscribed_radius: float
    circumscribed_radius: float
    remarks: tuple[str, ...] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that were read."""
        return tuple(file.path for file in self.files)

    @property
    def effective_layers(self) -> tuple[CostmapLayer, ...]:
        """The layers that change the costs of a map that is a file, in their order."""
        return tuple(one.layer for one in self.layers if one.layer is not None and one.is_enabled)

    @property
    def costmap_layers(self) -> CostmapLayers:
        """The layers that change the costs, and what they start from."""
        cost = NO_INFORMATION if self.track_unknown_space else FREE_SPACE
        return CostmapLayers(self.effective_layers, cost, self.circumscribed_radius)

    @property
    def ignored(self) -> tuple[ListedLayer, ...]:
        """The layers and filters that have no effect on a file."""
        return tuple(one for one in self.layers if one.layer is None)

    @property
    def static_layers(self) -> tuple[StaticLayer, ...]:
        """The static layers that are switched on."""
        return tuple(one for one in self.effective_layers if isinstance(one, StaticLayer))

    @property
    def inflation_layers(self) -> tuple[InflationLayer, ...]:
        """The inflation layers that are switched on."""
        return tuple(one for one in self.effective_layers if isinstance(one, InflationLayer))

    def with_shape(self, footprint: Footprint) -> RobotParameters:
        """Return the robot with another shape, taken as it is, without padding.

        Inflation layers get its inscribed radius, unless the file gives them one of their own.
        """
        own = self.inscribed_radius
        layers = tuple(
            replace(one, layer=replace(one.layer, inscribed_radius=footprint.inscribed_radius))
            if isinstance(one.layer, InflationLayer) and one.layer.inscribed_radius == own
            else one
            for one in self.layers
        )
        return replace(
            self,
            footprint=footprint,
            footprint_padding=0.0,
            robot_radius=footprint.radius or None,
            layers=layers,
            inscribed_radius=footprint.inscribed_radius,
            circumscribed_radius=footprint.circumscribed_radius,
        )

    def described(self) -> dict[str, Any]:
        """Return all that was resolved, as JSON can hold it."""
        shape = [list(corner) for corner in self.footprint.vertices]
        return {
            "flavour": self.flavour,
            "files": [{"name": file.path.name, "sha256": file.sha256} for file in self.files],
            "costmap": self.costmap,
            "node": self.node,
            "footprint": shape or {"radius": self.footprint.radius},
            "robot_radius": self.robot_radius,
            "footprint_padding": self.footprint_padding,
            "inscribed_radius": self.inscribed_radius,
            "circumscribed_radius": self.circumscribed_radius,
            "track_unknown_space": self.track_unknown_space,
            "rolling_window": self.rolling_window,
            "layers": [_described(one) for one in self.layers],
        }

    def _told(self) -> Iterator[str]:
        yield self.node
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"circumscribed_radius {self.circumscribed_radius:.6g} m"
        for one in self.layers:
            yield one.name


def _described(one: ListedLayer) -> dict[str, Any]:
    """Return a layer of the list as JSON can hold it: what is set, or why it has no effect."""
    entry: dict[str, Any] = {"name": one.name, "plugin": one.plugin}
    if one.is_filter:
        entry["filter"] = True
    if one.layer is None:
        return entry | {"ignored": one.why_ignored}
    values = asdict(one.layer)
    values.pop("name")
    return entry | {"enabled": one.is_enabled} | values
