"""Questions to a distance field, answered as lines of JSON; of poses see `query_poses`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.files.text import Form, Kind, row_texts
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
from mapdeal.maps.reading import as_occupancy
from mapdeal.pipeline.inputs import (
    check_fits,
    claim_work,
    errors_named,
    read_input,
    warn_of_potential,
    warn_of_published_costs,
)
from mapdeal.pipeline.recipe import step_for
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import NumberLines
from mapdeal.stages.definition import parameters_of
from mapdeal.stages.esdf import esdf

END = "}\n"
"""Of an answer."""

_STATES = ("free", "occupied", "unknown")
_FREE, _OCCUPIED, _UNKNOWN = range(len(_STATES))

_KINDS = [
    Kind.EXACT, Kind.EXACT, Kind.WHOLE, Kind.WHOLE,
    Kind.SINGLE, Kind.SINGLE, Kind.SINGLE, Kind.SINGLE,
]  # fmt: skip
"""Of x, y, row, col, distance, both slopes, and the distance of the cell."""


def _forms() -> Iterator[Form]:
    """Yield the form of the answer outside, and for each state without and with a gradient."""
    start = ('{"x": ', ', "y": ')
    keys = ("row", "col", "state", "distance", "gradient", "cell_distance")
    nothing = "".join(f', "{key}": null' for key in keys)
    yield Form((*start, f', "inside": false{nothing}{END}'), (0, 1))
    for state in _STATES:
        begin = (*start, ', "inside": true, "row": ', ', "col": ', f', "state": "{state}", ')
        distance, last = '"distance": ', '"cell_distance": '
        head = (*begin[:-1], begin[-1] + distance)
        yield Form((*head, f', "gradient": null, {last}', END), (0, 1, 2, 3, 4, 7))
        slopes = (', "gradient": [', ", ", f"], {last}")
        yield Form((*head, *slopes, END), (0, 1, 2, 3, 4, 5, 6, 7))


_FORMS = list(_forms())


@dataclass(frozen=True)
class Answers:
    """Values of a field at some points, or of costs at some poses."""

    text: str
    count: int
    outside: int


def field_to_ask(path: Path, options: Settings, parameters: Mapping[str, object]) -> DistanceField:
    """Return the field in a file, or the one that `parameters` of `esdf` make of its map."""
    source = read_input(path, options)
    if isinstance(source.grid, DistanceField):
        for name in parameters:
            option = f"--{name.replace('_', '-')}"
            raise ParameterError("applies to maps: this field is already computed", source=option)
        with options.memory():
            claim_work(path, source.grid, 0.0)
        return source.grid
    with options.memory():
        check_fits(path, source.grid.shape, [make_step("esdf", {})], None)
    warn_of_potential(source.grid, path)
    with use_threads(options.threads), errors_named(path):
        return esdf(as_occupancy(source.grid, path), **parameters)  # type: ignore[arg-type]


def answers_of(field: DistanceField, asked: NumberLines) -> Answers:
    """Return what a field says of points, one JSON object for each line asked."""
    cells, inside = field.frame.bounded_rowcol_from_xy(asked.numbers)
    samples = field.query(asked.numbers)
    at = cells[:, 0], cells[:, 1]
    values = np.column_stack(
        [asked.numbers, cells, samples.distance, samples.gradient, field.distance[at]]
    )
    occupancy = field.occupancy[at]  # whatever the field counts unknown cells as
    states = np.where(occupancy >= field.lethal_threshold, _OCCUPIED, _FREE)
    states = np.where(occupancy == UNKNOWN, _UNKNOWN, states)
    # of each state the form without a gradient, then that with one
    chosen = 2 * states + np.isfinite(samples.gradient[:, 0]) + 1
    chosen[~inside] = 0
    text = row_texts(values, _KINDS, _FORMS, chosen.astype(np.uint8))
    text = with_errors(text, asked.errors, asked.lines)
    return Answers(text, len(inside), len(inside) - int(inside.sum()))


def with_errors(text: str, errors: Mapping[int, str], lines: Sequence[int]) -> str:
    """Return answers of which some say what is wrong with the line that was asked."""
    if not errors:
        return text
    answers = text.splitlines(keepends=True)
    for index, error in errors.items():
        line = f', "line": {lines[index]}' if lines[index] else ""
        told = f'{line}, "error": {json.dumps(error)}'
        answers[index] = f"{answers[index].removesuffix(END)}{told}{END}"
    return "".join(answers)


_PER_CELL, _OF_ROBOT = 1.0, 3.0
"""Bytes for each cell: the costs of a map, and what a robot's take to make."""

_STATES_OF_COSTS = ("free", "collision", "unknown", "outside")
_FREE_COST, _COLLISION, _UNKNOWN_COST, _OUTSIDE = range(len(_STATES_OF_COSTS))

_OF_POSES = [Kind.EXACT, Kind.EXACT, Kind.EXACT, Kind.WHOLE]
"""Of x, y, yaw and the cost."""


def _forms_of_poses() -> Iterator[Form]:
    """Yield the form of the answer for each state, and for a line without a pose."""
    start = ('{"x": ', ', "y": ', ', "yaw": ')
    for state in _STATES_OF_COSTS:
        inside = "false" if state == "outside" else "true"
        cost = f', "inside": {inside}, "cost": '
        yield Form((*start, cost, f', "state": "{state}"{END}'), (0, 1, 2, 3))
    yield Form((*start, f', "inside": false, "cost": null, "state": null{END}'), (0, 1, 2))


_FORMS_OF_POSES = list(_forms_of_poses())


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
    states = np.where(samples.cost == LETHAL_OBSTACLE, _COLLISION, _FREE_COST)
    states = np.where(samples.cost == NO_INFORMATION, _UNKNOWN_COST, states)
    chosen = np.where(samples.inside, states, _OUTSIDE).astype(np.uint8)
    chosen[list(asked.errors)] = len(_STATES_OF_COSTS)
    values = np.column_stack([asked.numbers, samples.cost])
    text = with_errors(
        row_texts(values, _OF_POSES, _FORMS_OF_POSES, chosen), asked.errors, asked.lines
    )
    return Answers(text, len(chosen), len(chosen) - int(samples.inside.sum()))
