"""The costs over the distance from the nearest obstacle, without a costmap."""

from __future__ import annotations

from numbers import Real
from typing import Any, get_args

import numpy as np

from mapdeal.errors import ParameterError, as_known
from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.field import View
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.maps.npz import Grid
from mapdeal.pipeline.recipe import step_for
from mapdeal.pipeline.step import make_step
from mapdeal.ros.robot import RobotParameters

_UNKNOWN_MAP = np.zeros((1, 1), dtype=np.int8)


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
