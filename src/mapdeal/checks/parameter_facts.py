"""Facts about a robot's parameter files for the checks: the values, and their effect."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.records import dataclass
from mapdeal.robot.parameters import CostmapName, Flavour, RobotParameters
from mapdeal.robot.values import Name


@dataclass(frozen=True, eq=False)
class ParameterFacts:
    """The values of one costmap, whatever they mean."""

    flavour: Flavour
    costmap: CostmapName
    values: Mapping[Name, ParameterValue]
    plugins: tuple[tuple[str, str], ...]

    def shown(self, *name: str) -> str:
        """Return a name as ROS writes it."""
        return ("." if self.flavour == "nav2" else "/").join(name)

    def section(self, name: str) -> Mapping[Name, ParameterValue]:
        """Return the values below a name, with their names from the costmap on."""
        return self.sections.get(name, {})

    @cached_property
    def sections(self) -> dict[str, dict[Name, ParameterValue]]:
        """The values below each name right below the costmap that has some."""
        found: dict[str, dict[Name, ParameterValue]] = {}
        for path, value in self.values.items():
            if len(path) > 1:
                found.setdefault(path[0], {})[path] = value
        return found


@dataclass(frozen=True, eq=False)
class RobotFacts:
    """Effective parameters of one costmap."""

    robot: RobotParameters
    parameters: ParameterFacts
    other: RobotParameters | None = None
    map_resolutions: tuple[tuple[str, float], ...] = ()

    def value(self, *name: str) -> ParameterValue | None:
        """Return a parameter of the costmap, if it is set."""
        return self.parameters.values.get(name)

    def of_layer(self, layer: str, parameter: str) -> ParameterValue | None:
        """Return a parameter of a layer, or that of the costmap that a layer of ROS 1 takes."""
        own = self.value(layer, parameter)
        above = self.value(parameter) if self.robot.flavour == "ros1" else None
        return above or own
