"""What costs say of a robot's shape at poses, answered as lines of JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.formats.maps import as_occupancy
from mapdeal.formats.number_texts import Form, Kind, row_texts
from mapdeal.formats.points import NumberLines
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint, FootprintRule, sample_poses
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    DEFAULT_LETHAL_THRESHOLD,
    FREE_SPACE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    UNKNOWN,
    static_layer_cost_from_occupancy,
)
from mapdeal.kernels.lookup import look_up
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import (
    errors_named,
    read_input,
    warn_of_potential,
    warn_of_published_costs,
)
from mapdeal.pipeline.memory import claim_work
from mapdeal.pipeline.query import END, Answers, with_errors
from mapdeal.pipeline.robot import step_for
from mapdeal.pipeline.settings import Settings
from mapdeal.robot.parameters import RobotParameters
from mapdeal.stages.esdf import esdf
from mapdeal.stages.parameters import parameters_of

_PER_CELL, _OF_ROBOT = 1.0, 3.0
"""Bytes for each cell: the costs of a map, and what a robot's take to make."""

_STATES = ("free", "collision", "unknown", "outside")
_FREE, _COLLISION, _UNKNOWN, _OUTSIDE = range(len(_STATES))

_KINDS = [Kind.EXACT, Kind.EXACT, Kind.EXACT, Kind.WHOLE]
"""Of x, y, yaw and the cost."""


def _forms() -> Iterator[Form]:
    """Yield the form of the answer for each state, and for a line without a pose."""
    start = ('{"x": ', ', "y": ', ', "yaw": ')
    for state in _STATES:
        inside = "false" if state == "outside" else "true"
        cost = f', "inside": {inside}, "cost": '
        yield Form((*start, cost, f', "state": "{state}"{END}'), (0, 1, 2, 3))
    yield Form((*start, f', "inside": false, "cost": null, "state": null{END}'), (0, 1, 2))


_FORMS = list(_forms())


def costs_to_ask(
    path: Path,
    options: Settings,
    parameters: Mapping[str, Any],
    robot: RobotParameters | None = None,
) -> Costmap:
    """Return the costs in a file, or those of its map: a robot's, or of obstacles alone."""
    accepted = {name: parameters_of(esdf)[name].accept(one) for name, one in parameters.items()}
    source = read_input(path, options)
    grid = source.grid
    if isinstance(grid, DistanceField):
        rule = "is a distance field; a footprint is asked of costs or a map"
        hint = f"mapdeal cost {path} -o cost.npz makes costs of it"
        raise ParameterError(rule, source=path, hint=hint)
    with options.memory():
        claim_work(path, grid, _PER_CELL if robot is None else _OF_ROBOT)
    if isinstance(grid, Costmap):
        for name in parameters:
            option = f"--{name.replace('_', '-')}"
            raise ParameterError("applies to maps: these costs are already computed", source=option)
        if grid.scale != "costmap2d":
            rule = "costs on the occupancy scale do not show what a footprint hits"
            hint = "mapdeal cost --model exponential writes costmap_2d's own as .npz"
            raise ParameterError(rule, source=path, hint=hint)
        return grid
    warn_of_published_costs(source, path)
    warn_of_potential(grid, path)
    with use_threads(options.threads), errors_named(path):
        if robot is None:
            return _static_costs(as_occupancy(grid, path), **accepted)
        made: Any = step_for("cost", robot, {}).apply(grid, path)
        return cast("Costmap", made)


def _static_costs(
    occupancy: OccupancyGrid,
    *,
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    unknown: str | None = None,
) -> Costmap:
    """Return 254 for obstacles, 255 for unknown cells, or what these are to be, and 0."""
    table = static_layer_cost_from_occupancy(
        lethal_threshold=lethal_threshold, inscribed_value=None
    )
    of_unknown = {"free": FREE_SPACE, "occupied": LETHAL_OBSTACLE, None: NO_INFORMATION}
    table[UNKNOWN] = of_unknown[unknown]
    costs = look_up(occupancy.occupancy, table)
    return Costmap(costs, occupancy.resolution, occupancy.origin)


def answers_at_poses(
    costmap: Costmap, footprint: Footprint, asked: NumberLines, rule: FootprintRule
) -> Answers:
    samples = sample_poses(costmap, footprint, asked.numbers, rule=rule)
    states = np.where(samples.cost == LETHAL_OBSTACLE, _COLLISION, _FREE)
    states = np.where(samples.cost == NO_INFORMATION, _UNKNOWN, states)
    chosen = np.where(samples.inside, states, _OUTSIDE).astype(np.uint8)
    chosen[list(asked.errors)] = len(_STATES)
    values = np.column_stack([asked.numbers, samples.cost])
    text = with_errors(row_texts(values, _KINDS, _FORMS, chosen), asked.errors, asked.lines)
    return Answers(text, len(chosen), len(chosen) - int(samples.inside.sum()))
