"""Where a robot can go on the map or the costs in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FindingError, ParameterError, emit_warning
from mapdeal.grid.costmap import Costmap, InflationLayer
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import RADIUS_TOLERANCE
from mapdeal.grid.reach import GoalReach, Reach, reach_radius
from mapdeal.grid.values import UNKNOWN
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import write_grid
from mapdeal.pipeline.documents import reach_json
from mapdeal.pipeline.inputs import (
    add_picture,
    errors_named,
    outputs_of,
    read_input,
    warn_of_potential,
    warn_of_published_costs,
)
from mapdeal.pipeline.recipe import load_recipe, planned_shape
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import RobotParameters

_COSTS_PER_CELL = 8.0
"""Bytes for each cell that the costs of a robot's own layers take."""


@dataclass(frozen=True)
class ReachReport:
    """What a robot can reach, and its JSON text."""

    reach: Reach
    text: str


def reach_file(
    path: Path,
    output: Path | None,
    options: Settings,
    *,
    layers: Path | None = None,
    robot: RobotParameters | None = None,
    footprint: Footprint | None = None,
    parameters: Mapping[str, Any] | None = None,
    also_read: Sequence[Path] = (),
) -> ReachReport:
    """Find where a robot can go on the map or the costs in a file, and write what is asked for."""
    for name, file, ending in (("--output", output, ".json"), ("--layers", layers, ".npz")):
        if file is not None and file.suffix != ending:
            rule = f"must end in {ending}"
            raise ParameterError(rule, source=name, got=str(file))
    step = _step_for(robot, footprint, parameters or {})
    source = read_input(path, options, step.memory + _COSTS_PER_CELL * (robot is not None))
    outputs = [one for one in (output, layers) if one is not None]
    inputs = [*source.files, *(robot.paths if robot else ()), *also_read]
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            grid = source.grid
            if not isinstance(grid, Costmap):
                warn_of_published_costs(source, path)
                warn_of_potential(grid, path)
            if robot is not None and not isinstance(grid, Costmap):
                occupancy = np.asarray(grid.occupancy)
                for one in load_recipe(None, robot=_without_inflation(robot)).steps:
                    grid = one.apply(grid, path)
                _warn_of_free_unknown(occupancy, grid, path)
            found = step.apply(grid, path)
        if not isinstance(found, Reach):
            raise TypeError("the stage reach must make a Reach")
        if "start" not in (parameters or {}):
            x, y = found.start[:2]
            emit_warning(
                f"no start is given: it is {x:.10g},{y:.10g}, the widest place of the largest "
                "open area"
            )
        text = reach_json(found)
        if output is not None:
            transaction.write_bytes(output, f"{text}\n".encode())
        if layers is not None:
            write_grid(transaction, layers, found)
        add_picture(transaction, options, found, f"{path.stem}: {step.title}")
    return ReachReport(found, text)


def _step_for(
    robot: RobotParameters | None, footprint: Footprint | None, parameters: Mapping[str, Any]
) -> Step:
    """Return the step, for the shape that was given by hand or else by parameters."""
    shape = footprint
    if shape is None and robot is not None:
        shape = planned_shape(robot)
    given = {} if shape is None else {"footprint": shape}
    return make_step("reach", {**parameters, **given})


def _without_inflation(robot: RobotParameters) -> RobotParameters:
    """Return a robot whose costs say what is lethal and what unknown, and nothing else."""
    # Inscribed costs would cover unknown cells.
    layers = (one for one in robot.layers if not isinstance(one.layer, InflationLayer))
    return replace(robot, layers=tuple(layers))


def _warn_of_free_unknown(occupancy: NDArray[np.int8], costs: Grid, path: Path) -> None:
    """Warn that a robot's costmap makes free space of the unknown cells of a map."""
    unknown = np.count_nonzero(occupancy == UNKNOWN)
    if unknown and isinstance(costs, Costmap) and not (costs.cost == costs.unknown_value).any():
        text = (
            f"{path}: the robot's costmap treats unknown cells as free, "
            f"{100 * unknown / occupancy.size:.3g} % of the map: the robot drives through; "
            "track_unknown_space: true closes them"
        )
        emit_warning(text, stacklevel=2)


def check_reached(found: Reach, path: Path) -> None:
    """Raise FindingError if a goal is not reachable; it names the first, and what stops it."""
    missed = [one for one in found.goals if not one.reachable]
    if not missed:
        return
    rule = not_reachable_text(missed[0], found)
    if len(missed) > 1:
        rule += f"; nor are {len(missed) - 1} more of {len(found.goals)} goals"
    raise FindingError(rule, source=path, hint=_hint_for(missed[0], found))


def not_reachable_text(missed: GoalReach, found: Reach) -> str:
    goal = missed.goal
    what = f"goal {goal.x + 0.0:.10g},{goal.y + 0.0:.10g}"
    what += "" if goal.name is None else f" ({goal.name})"
    text = f"{what} is not reachable"
    if missed.reason is not None:
        return f"{text}: {missed.stopped_by}"
    limit = missed.limited_by
    if limit is None:
        return f"{text} by any robot, however small: no way leads there"
    needs = 2 * reach_radius(found.robot)
    if limit.width <= needs + 2 * RADIUS_TOLERANCE:
        return f"{text}: {limit.text}; the robot needs more than {needs:.4g} m"
    return (
        f"{text} with this footprint, though a round robot of up to {limit.width:.4g} m gets there"
    )


def _hint_for(missed: GoalReach, found: Reach) -> str | None:
    if missed.nearest_open is not None:
        x, y = (round(value, 6) + 0.0 for value in missed.nearest_open)
        return f"the nearest open cell is at {x:.10g},{y:.10g}"
    if missed.limited_by is None and not found.through_unknown:
        return "unknown cells are closed; --through-unknown opens them"
    return "--image shows where the robot can go"
