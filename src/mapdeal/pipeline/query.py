"""Questions to a distance field, answered as lines of JSON; of poses see `query_poses`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.formats.maps import as_occupancy
from mapdeal.formats.number_texts import Form, Kind, row_texts
from mapdeal.formats.points import NumberLines
from mapdeal.grid.field import DistanceField
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import errors_named, read_input, warn_of_potential
from mapdeal.pipeline.memory import check_fits, claim_work
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step
from mapdeal.records import dataclass
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
