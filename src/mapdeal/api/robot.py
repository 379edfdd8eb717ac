"""A robot's own parameter files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.grid.values import check_choice
from mapdeal.maps.map_yaml import Dialect
from mapdeal.ros.load import read_robot
from mapdeal.ros.robot import CostmapName, RobotParameters

StrPath = str | PathLike[str]


def read_robot_parameters(
    paths: StrPath | Sequence[StrPath],
    *,
    costmap: CostmapName = "global",
    namespace: str | None = None,
    dialect: Dialect = "nav2",
) -> RobotParameters:
    """Read a robot's shape and costmap from its own parameter files, like ``--params-file``.

    Parameters
    ----------
    paths : path, str or sequence of them
        A Nav2 parameter file, or ROS 1 costmap files; later files override earlier ones. A ROS 1
        file without a costmap's name at the top level is loaded into the requested costmap.
    costmap : {'global', 'local'}
        Costmap to read.
    namespace : str, optional
        Namespace of the robot, if the files describe several.
    dialect : {'nav2', 'humble', 'ros1'}
        Version of the inflation layer for a Nav2 file: the current one (``nav2``), or the one of
        Humble to Kilted and ROS 1.

    Returns
    -------
    RobotParameters
        Parameters that can be used instead of a recipe: ``run(path, output, robot)``.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If the actual ROS node would not start with these files.
    ParameterError
        If Nav2 and ROS 1 files are mixed, or no file is given.

    Warns
    -----
    MapdealWarning
        If the resulting costmap may not be the one that the author of the files expects.

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
        [Path(one) for one in given], costmap=costmap, namespace=namespace, older=dialect != "nav2"
    )
