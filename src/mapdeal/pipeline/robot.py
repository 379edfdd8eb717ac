"""A robot's own parameter files, and the costs that it has over the distance from obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, get_args

import numpy as np

from mapdeal.errors import ParameterError, as_known
from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.field import View
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import check_choice
from mapdeal.maps.map_yaml import Dialect
from mapdeal.maps.npz import Grid
from mapdeal.pipeline.recipe import step_for
from mapdeal.pipeline.step import make_step
from mapdeal.ros.load import read_robot
from mapdeal.ros.robot import CostmapName, RobotParameters

_UNKNOWN_MAP = np.zeros((1, 1), dtype=np.int8)


def read_robot_parameters(
    paths: str | PathLike[str] | Sequence[str | PathLike[str]],
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


def cost_curve(
    cells: Grid | float,
    *,
    model: str | None = None,
    footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
    **parameters: Any,
) -> CostCurve:
    """Return the costs of a cost model by distance from the nearest obstacle.

    Parameters
    ----------
    cells : OccupancyGrid, DistanceField, FieldView or float
        Map that the costs are for, or only the side of its cells, metres.
    model : {'exponential', 'layers', 'threshold', 'rings'}, optional
        Cost model. By default that of `robot`, or ``exponential`` without a robot.
    footprint : Footprint, optional
        Robot shape, instead of ``inscribed_radius``; only for model ``exponential``.
    robot : RobotParameters, optional
        Robot's own parameters, from `read_robot_parameters`. Other arguments override them.
    **parameters
        Parameters of the model: those of `exponential_cost`, `layered_cost`, `threshold_cost` or
        `ring_cost`.

    Returns
    -------
    CostCurve
        Each distance that occurs between cells, with the cost of a free cell there.

    Raises
    ------
    ParameterError
        If a parameter is unknown, invalid or missing; if view ``per-map``, which depends on the
        extremes of a map, is given without a map; or if layers lack a static layer.

    Examples
    --------
    >>> curve = cost_curve(0.05, inscribed_radius=0.1, inflation_radius=0.12)
    >>> curve.distance.round(3).tolist()
    [0.0, 0.05, 0.071, 0.1, 0.112, 0.141, 0.15]
    >>> curve.cost.tolist()
    [254, 253, 253, 253, 223, 166, 152]
    """
    if isinstance(cells, Real) and not isinstance(cells, bool):
        if as_known(str(parameters.get("view")), get_args(View)) == "per-map":
            hint = "give a map instead of the side of its cells"
            raise ParameterError(
                "per-map is scaled by the extremes of a map", place="view", hint=hint
            )
        cells = OccupancyGrid(_UNKNOWN_MAP, float(cells))
    if not isinstance(cells, Framed):
        raise ParameterError("must be a grid, or a length in metres", place="cells", got=cells)
    given = {**({} if model is None else {"model": model}), **parameters}
    if robot is not None:
        step = step_for("cost", robot if footprint is None else robot.with_shape(footprint), given)
    else:
        step = make_step("cost", given)
    if footprint is not None and robot is None:
        shaped = step.stage.robot
        if shaped is None:
            rule = "costs of this model do not depend on the robot's shape"
            raise ParameterError(rule, place="footprint")
        if shaped.replaces in parameters:
            rule = f"cannot be given together with {shaped.replaces}"
            raise ParameterError(rule, place="footprint")
        step = make_step("cost", {**given, **shaped.parameters(footprint)})
    curve = step.curve_on(cells)
    if curve is None:
        raise step.no_curve()
    return curve
