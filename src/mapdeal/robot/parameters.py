"""A robot as described by its own parameter files."""

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
    """Layer or filter in a robot's list, and its effect on a map file."""

    name: str
    plugin: str
    layer: CostmapLayer | None
    is_enabled: bool = True
    is_filter: bool = False
    why_ignored: str = ""


@dataclass(frozen=True)
class ParameterFile:
    """Parameter file that was read, with the SHA-256 of its bytes."""

    path: Path
    sha256: str


@dataclass(frozen=True, repr=False)
class RobotParameters(OneLine):
    """Shape of a robot and the layers of one of its costmaps, as ROS resolves them.

    Parameters
    ----------
    flavour : {'nav2', 'ros1'}
        Kind of parameter files.
    costmap : {'global', 'local'}
        Which of the robot's costmaps this is.
    node : str
        Full name of the node, such as ``/global_costmap/global_costmap``; for ROS 1, the
        namespace of the costmap.
    footprint : Footprint
        Padded polygon, metres; for a round robot a polygon of 16 vertices, as in ROS.
    footprint_padding : float
        Distance by which the vertices were moved outwards, metres.
    robot_radius : float, optional
        Radius from which the polygon was made, metres; None if the file lists the vertices.
    track_unknown_space : bool
        Whether the costmap is initially unknown rather than free.
    rolling_window : bool
        Whether the costmap moves with the robot.
    layers : tuple of ListedLayer
        All layers in the order of the file, followed by the filters.
    files : tuple of ParameterFile
        Files that were read.
    inscribed_radius, circumscribed_radius : float
        Radii of the padded footprint, as computed by ``calculateMinAndMaxDistances``, metres.
    remarks : tuple of str
        Warnings from reading the files.
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
        """Paths of the files that were read."""
        return tuple(file.path for file in self.files)

    @property
    def effective_layers(self) -> tuple[CostmapLayer, ...]:
        """Enabled layers that affect the costs of a map file, in order."""
        return tuple(one.layer for one in self.layers if one.layer is not None and one.is_enabled)

    @property
    def costmap_layers(self) -> CostmapLayers:
        """Effective layers, with the cost that the costmap starts from."""
        cost = NO_INFORMATION if self.track_unknown_space else FREE_SPACE
        return CostmapLayers(self.effective_layers, cost, self.circumscribed_radius)

    @property
    def ignored(self) -> tuple[ListedLayer, ...]:
        """Layers and filters that have no effect on a map file."""
        return tuple(one for one in self.layers if one.layer is None)

    @property
    def static_layers(self) -> tuple[StaticLayer, ...]:
        """Enabled static layers."""
        return tuple(one for one in self.effective_layers if isinstance(one, StaticLayer))

    @property
    def inflation_layers(self) -> tuple[InflationLayer, ...]:
        """Enabled inflation layers."""
        return tuple(one for one in self.effective_layers if isinstance(one, InflationLayer))

    def with_shape(self, footprint: Footprint) -> RobotParameters:
        """Return the robot with another footprint, used as it is, without padding.

        Inflation layers get its inscribed radius, unless the file sets one for them.
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
        """Return everything that was resolved, as values that JSON can represent."""
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
    """Return a layer as values for JSON: its settings, or the reason why it has no effect."""
    entry: dict[str, Any] = {"name": one.name, "plugin": one.plugin}
    if one.is_filter:
        entry["filter"] = True
    if one.layer is None:
        return entry | {"ignored": one.why_ignored}
    values = asdict(one.layer)
    values.pop("name")
    return entry | {"enabled": one.is_enabled} | values
