"""What checks look at in a robot's parameter files: its values, and what they come to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.robot.parameters import CostmapName, Flavour, RobotParameters
from mapdeal.robot.values import Name


@dataclass(frozen=True, eq=False)
class ParameterFacts:
    """The values of one costmap, whatever they mean.

    Parameters
    ----------
    flavour : {'nav2', 'ros1'}
        Whose parameters they are.
    costmap : {'global', 'local'}
        Which costmap this is.
    values : mapping of names to ParameterValue
        All parameters below it.
    plugins : tuple of (str, str)
        Names and classes of its layers and filters; a class is empty where the file has none.
    """

    flavour: Flavour
    costmap: CostmapName
    values: Mapping[Name, ParameterValue]
    plugins: tuple[tuple[str, str], ...]

    def shown(self, *name: str) -> str:
        """Return a name as ROS writes it."""
        return ("." if self.flavour == "nav2" else "/").join(name)

    def section(self, *name: str) -> dict[Name, ParameterValue]:
        """Return the values below a name, with their names from the costmap on."""
        return {path: one for path, one in self.values.items() if path[: len(name)] == name != path}

    def sections(self) -> Iterator[str]:
        """Yield the names right below the costmap that have parameters below them."""
        yield from dict.fromkeys(path[0] for path in self.values if len(path) > 1)


@dataclass(frozen=True, eq=False)
class RobotFacts:
    """What the values of one costmap come to.

    Parameters
    ----------
    robot : RobotParameters
        The robot and its costmap.
    parameters : ParameterFacts
        Where that comes from.
    other : RobotParameters, optional
        Its other costmap, once: of the two, the first one has it.
    map_resolutions : tuple of (str, float)
        Names and resolutions, metres, of the maps that are looked at together with it.
    """

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
