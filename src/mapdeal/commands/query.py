"""``mapdeal query``: what a distance field says of points, and costs of a robot at poses."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import Result, Words, command
from mapdeal.errors import FindingError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.text import Form, Kind, row_texts
from mapdeal.grid import values
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint, FootprintRule, sample_poses
from mapdeal.kernels.lookup import look_up
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.step import make_step
from mapdeal.records import dataclass, field
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import NumberLines, read_points, read_pose_lines
from mapdeal.stages.esdf import esdf

_END = "}\n"  # of an answer
_STATES = ("free", "occupied", "unknown")
_FREE, _OCCUPIED, _UNKNOWN = range(len(_STATES))
_STATES_OF_COSTS = ("free", "collision", "unknown", "outside")
_FREE_COST, _COLLISION, _UNKNOWN_COST, _OUTSIDE = range(len(_STATES_OF_COSTS))
# of x, y, row, col, distance, both slopes, and the distance of the cell
_OF_POINTS: list[Kind] = [
    "exact", "exact", "integer", "integer", "single", "single", "single", "single",
]  # fmt: skip
_OF_POSES: list[Kind] = ["exact", "exact", "exact", "integer"]  # of x, y, yaw and the cost
_PER_CELL, _OF_ROBOT = 1.0, 3.0  # bytes: the costs of a map, and what a robot's take to make
# Returns a JSON object for each line that asks, and which of the places are inside of the map.
Answer = Callable[[NumberLines], tuple[str, NDArray[np.bool_]]]


def _form(template: str) -> Form:
    first, *parts = template.split("@")
    return Form((first, *(text[1:] for text in parts)), tuple(int(text[0]) for text in parts))


def _forms_of_points() -> Iterator[Form]:
    keys = ("row", "col", "state", "distance", "gradient", "cell_distance")
    nothing = "".join(f', "{key}": null' for key in keys)
    yield _form(f'{{"x": @0, "y": @1, "inside": false{nothing}{_END}')
    for state in _STATES:
        text = f'{{"x": @0, "y": @1, "inside": true, "row": @2, "col": @3, "state": "{state}"'
        for gradient in ("null", "[@5, @6]"):
            end = f'"gradient": {gradient}, "cell_distance": @7{_END}'
            yield _form(f'{text}, "distance": @4, {end}')


def _forms_of_poses() -> Iterator[Form]:
    pose = '{"x": @0, "y": @1, "yaw": @2, "inside": '
    for state in _STATES_OF_COSTS:
        inside = "false" if state == "outside" else "true"
        yield _form(f'{pose}{inside}, "cost": @3, "state": "{state}"{_END}')
    yield _form(f'{pose}false, "cost": null, "state": null{_END}')


_FORMS_OF_POINTS, _FORMS_OF_POSES = list(_forms_of_points()), list(_forms_of_poses())


@dataclass(frozen=True, eq=False, repr=False)
class Answers(Result):
    """Values of a field at points, or costs of a robot at poses, found as these are read."""

    map: inputs.MapInput
    unit: Literal["point", "pose"]
    questions: Iterable[NumberLines]
    asked_in: Path | str
    answer: Answer
    is_strict: bool = False
    counts: Counter[str] = field(default_factory=Counter)

    def parts(self) -> Iterator[str]:
        for some in self.questions:
            text, is_inside = self.answer(some)
            turned = np.abs(some.numbers[:, 2:]) > 2 * math.pi  # only poses have a third column
            self.counts["all"] += len(is_inside)
            self.counts["outside"] += int(np.count_nonzero(~is_inside))
            self.counts["bad"] += len(some.errors)
            self.counts["turned"] += int(np.count_nonzero(turned))
            if text:
                yield _with_errors(text, some).removesuffix("\n")

    def document(self) -> dict[str, Any]:
        lines = (line for part in self.parts() for line in part.splitlines())
        return {"answers": list(map(json.loads, lines))}

    def lines(self) -> Iterator[str]:
        for part in self.parts():
            yield from map(_answer_text, map(json.loads, part.splitlines()))

    def details(self) -> Iterator[str]:
        counts = self.counts
        yield f"{counts['all']} {self.unit}s, {counts['outside']} of them outside of the map"

    def check(self) -> None:
        counts, count = self.counts, self.counts["all"]
        if not count:
            raise MalformedInputError(f"holds no {self.unit}s", source=self.asked_in)
        if counts["bad"]:
            text = f"{counts['bad']} of {count} hold no finite {self.unit}"
            if counts["bad"] == count:
                raise FindingError(text, source=str(self.asked_in))
            emit_warning(f"{self.asked_in}: {text}")
        if counts["turned"]:
            rule = "have a yaw of more than a turn; is it in degrees?"
            emit_warning(f"{counts['turned']} of {count} poses {rule}")
        if self.is_strict and counts["outside"]:
            rule = f"{counts['outside']} of {count} {self.unit}s are not inside of the map"
            raise FindingError(rule, source=self.map.name)


def _answer_text(answer: Mapping[str, Any]) -> str:
    if "error" in answer:
        return str(answer["error"])
    place = ",".join(f"{answer[key]:.10g}" for key in ("x", "y", "yaw") if key in answer)
    if not answer["inside"]:
        return f"{place}: outside of the map"
    if "cost" in answer:
        return f"{place}: cost {answer['cost']}, {answer['state']}"
    text = f"{place}: {answer['distance']:.4g} m, {answer['state']}"
    if answer["gradient"] is not None:
        text += f", gradient {answer['gradient'][0]:.3f},{answer['gradient'][1]:.3f}"
    return f"{text}, cell row {answer['row']}, col {answer['col']}"


def _with_errors(text: str, question: NumberLines) -> str:
    answers = text.splitlines(keepends=True) if question.errors else [text]
    for index, error in question.errors.items():
        line = f', "line": {question.lines[index]}' if question.lines[index] else ""
        document = f'{line}, "error": {json.dumps(error)}'
        answers[index] = f"{answers[index].removesuffix(_END)}{document}{_END}"
    return "".join(answers)


@command(
    group="Questions about a map",
    json="default",
    shared=(
        "footprint", "robot_radius", "footprint_padding", "params_file", "costmap", "namespace",
        "mask", "dialect", "resolution", "origin", "max_cells", "threads", "max_memory",
    ),
    texts={
        "footprint": "Report the cost of a robot at poses: its corners around its centre, metres.",
        "robot_radius": "The same for a round robot, metres: a polygon of 16 corners as in "
        "costmap_2d.",
        "params_file": "The same for a robot's own parameters: a Nav2 file, or ROS 1's costmap "
        "files, which also define the costs of a map.",
        "strict": "Exit with 1 if a point or a robot lies outside the map, or if there is a "
        "warning.",
    },
    example="""\
mapdeal query examples/maps/office.yaml --at 0.5,0.3 -5,0.3
mapdeal query examples/maps/office.yaml --points examples/points/office.csv
mapdeal query examples/maps/office.yaml --at 0.5,-0.5,1.57 \\
    --params-file examples/robots/nav2_params.yaml""",
)  # fmt: skip
def query(
    map: inputs.Map,  # noqa: A002 - what it is
    *,
    at: Annotated[Sequence[str | Sequence[float]] | None, Words("X,Y[,YAW]")] = None,
    points: Annotated[Path | None, Words("FILE|-")] = None,
    poses: Annotated[Path | None, Words("FILE|-")] = None,
    rule: FootprintRule | None = None,
    footprint: Footprint | None = None,
    robot: Annotated[RobotParameters | None, Words()] = None,
) -> Answers:
    """Report distances and gradients at points, or a robot's cost at poses.

    Prints one line of JSON for each, in order. Distances and gradients are interpolated between
    the centres of cells. The gradient points away from obstacles, in the map frame. The cost of a
    robot is that of its footprint in Nav2's collision checker.

    Parameters
    ----------
    map : path, str or grid
        A distance field (.npz), or a map to compute it from; with a footprint, costs or a map.
    at : sequence, optional
        Point, metres, or with a footprint a pose; more may follow.
    points : path, optional
        File of points, one x,y or JSON object per line; - reads standard input.
    poses : path, optional
        With a footprint: file of poses, one x,y,yaw, TUM line or JSON object each; - reads stdin.
    rule : {'outline', 'full'}, optional
        With a footprint: cells that count, its outline (the default, as in Nav2) or all (full).
    footprint : Footprint, optional
        The robot's shape, instead of that of `robot`.
    """
    if robot is not None:
        robot = robot if footprint is None else robot.with_shape(footprint)
        footprint = robot.footprint
    if footprint is None:
        inputs.refuse("needs --footprint, --robot-radius or --params-file", poses=poses, rule=rule)
        unit, form, file, read = "point", "X,Y", points, read_points
    else:
        inputs.refuse("is for points; poses of a footprint are given by --poses", points=points)
        unit, form, file, read = "pose", "X,Y,YAW", poses, read_pose_lines
    if not at and file is None:
        raise ParameterError("one of the two is required", place=f"at, {unit}s")
    settings = inputs.settings_of()
    if footprint is None:
        inputs.refuse("applies to costs of a robot, not to distances", mask=settings.mask)
    first = _rows(at or (), form)
    chunks, asked_in = ((), "--at") if file is None else inputs.text_in(file)
    (map_read,) = inputs.open_inputs(map, names=("map",))
    answer: Answer
    if footprint is None:
        answer = partial(_answers_of, _field_of(map_read))
    else:
        costs = _costs_of(map_read, robot, inputs.mask_of(settings.mask, settings, map_read.grid))
        answer = partial(_answers_at, costs, footprint, rule or "outline")
    questions = chain([first] if at else [], read(chunks, asked_in))
    return Answers(map_read, cast("Any", unit), questions, asked_in, answer, settings.strict)


def _rows(at: Sequence[str | Sequence[float]], form: str) -> NumberLines:
    try:
        numbers = [inputs.numbers_of(place, form, place="at", finite=False) for place in at]
    except ParameterError as error:
        texts = [place for place in at if isinstance(place, str)]
        if form == "X,Y" and any(text.count(",") > 1 for text in texts):
            error.hint = "a pose X,Y,YAW is asked for a robot, by --footprint or --robot-radius"
        raise
    rows = np.array(numbers, dtype=np.float64).reshape(-1, form.count(",") + 1)
    finite = np.isfinite(rows).all(axis=1)
    errors = {k: f"must be finite, got {at[k]}" for k in np.flatnonzero(~finite).tolist()}
    return NumberLines(rows, [0] * len(at), errors)


def _field_of(map_read: inputs.MapInput) -> DistanceField:
    if isinstance(map_read.grid, DistanceField):
        inputs.claim_cells(map_read, 0.0)
        return map_read.grid
    inputs.check_fits(map_read.name, map_read.grid.shape, [make_step("esdf", {})], None)
    inputs.warn_of_potential(map_read)
    with inputs.errors_named(map_read.name):
        return esdf(map_read.occupancy)


def _answers_of(field: DistanceField, questions: NumberLines) -> tuple[str, NDArray[np.bool_]]:
    cells, inside = field.frame.bounded_rowcol_from_xy(questions.numbers)
    samples = field.query(questions.numbers)
    at = cells[:, 0], cells[:, 1]
    measured = samples.distance, samples.gradient, field.distance[at]
    columns = np.column_stack([questions.numbers, cells, *measured])
    occupancy = field.occupancy[at]
    states = np.where(occupancy >= field.lethal_threshold, _OCCUPIED, _FREE)
    states[occupancy == values.UNKNOWN] = _UNKNOWN  # whatever the field counts unknown cells as
    # of each state the form without a gradient, then that with one
    chosen = 2 * states + np.isfinite(samples.gradient[:, 0]) + 1
    chosen[~inside] = 0
    return row_texts(columns, _OF_POINTS, _FORMS_OF_POINTS, chosen.astype(np.uint8)), inside


def _costs_of(
    source: inputs.MapInput, robot: RobotParameters | None, mask: inputs.KeepoutMask | None
) -> Costmap:
    """Return the costs in a file, or those of its map: a robot's, or of obstacles alone."""
    grid = source.grid
    if isinstance(grid, DistanceField):
        rule = "is a distance field; a footprint is asked of costs or a map"
        hint = f"mapdeal cost {source.name} -o cost.npz makes costs of it"
        raise ParameterError(rule, source=source.name, hint=hint)
    inputs.claim_cells(source, _PER_CELL if robot is None else _OF_ROBOT)
    if isinstance(grid, Costmap):
        if grid.scale != "costmap2d":
            rule = "costs on the occupancy scale do not show what a footprint hits"
            hint = "mapdeal cost --model exponential writes costmap_2d's own as .npz"
            raise ParameterError(rule, source=source.name, hint=hint)
        return grid if mask is None else mask.over(grid)
    inputs.warn_of_values(source)
    with inputs.errors_named(source.name):
        if robot is not None:
            step = recipe.step_for("cost", robot, {})
            if mask is not None:
                return mask.costs_of(step, grid, source.path)[1]
            return cast("Costmap", step.apply(grid, source.path))
        table = values.static_layer_cost_from_occupancy(inscribed_value=None)
        cells = source.occupancy
        costs = Costmap(look_up(cells.occupancy, table), cells.resolution, cells.origin)
        return costs if mask is None else mask.over(costs)


def _answers_at(
    costmap: Costmap, footprint: Footprint, rule: FootprintRule, questions: NumberLines
) -> tuple[str, NDArray[np.bool_]]:
    costs, inside = sample_poses(costmap, footprint, questions.numbers, rule=rule)
    states = np.where(costs == values.LETHAL_OBSTACLE, _COLLISION, _FREE_COST)
    states = np.where(costs == values.NO_INFORMATION, _UNKNOWN_COST, states)
    chosen = np.where(inside, states, _OUTSIDE).astype(np.uint8)
    chosen[list(questions.errors)] = len(_STATES_OF_COSTS)
    columns = np.column_stack([questions.numbers, costs])
    return row_texts(columns, _OF_POSES, _FORMS_OF_POSES, chosen), inside
