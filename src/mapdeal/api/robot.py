"""A robot's own parameter files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.values import check_choice
from mapdeal.robot.load import read_robot
from mapdeal.robot.parameters import CostmapName, RobotParameters

StrPath = str | PathLike[str]


def read_robot_parameters(
    paths: StrPath | Sequence[StrPath],
    *,
    costmap: CostmapName = "global",
    namespace: str | None = None,
    dialect: Dialect = "nav2",
) -> RobotParameters:
    """Read a robot's shape and costmap from its own parameter files, as ``--params-file`` does.

    Parameters
    ----------
    paths : path, str or sequence of them
        A Nav2 parameter file, or ROS 1's costmap files; of several, later ones win. A ROS 1 file
        without a costmap's name at its top is loaded into the costmap that is asked for.
    costmap : {'global', 'local'}
        Which costmap.
    namespace : str, optional
        Which robot, where files hold several.
    dialect : {'nav2', 'humble', 'ros1'}
        Whose inflation layer a Nav2 file is for: today's, or that of Humble to Kilted and ROS 1.

    Returns
    -------
    RobotParameters
        Takes the place of a recipe: ``run(path, output, robot)``.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If the real node would not start with these files.
    ParameterError
        If files of Nav2 and ROS 1 are mixed, or there is none.

    Warns
    -----
    MapdealWarning
        Of what makes the costmap another one than its owner may think.

    Examples
    --------
    >>> robot = read_robot_parameters("examples/robots/nav2_params.yaml")
    >>> round(robot.inscribed_radius, 3), [layer.name for layer in robot.ignored]
    (0.19, ['obstacle_layer', 'keepout_filter'])
    """
    check_choice(costmap, CostmapName, "costmap")
    check_choice(dialect, Dialect, "dialect")
    given = [paths] if isinstance(paths, str | PathLike) else paths
    if not isinstance(given, Sequence) or not all(isinstance(one, str | PathLike) for one in given):
        raise ParameterError("takes paths of parameter files", place="paths", got=paths)
    return read_robot(
        [Path(one) for one in given],
        costmap=costmap,
        namespace=namespace,
        older=dialect != "nav2",
    )
