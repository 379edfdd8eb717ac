"""Questions to a distance field, answered as lines of JSON; of poses see `query_poses`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.formats.maps import as_occupancy
from mapdeal.formats.points import PointLines
from mapdeal.grid.field import DistanceField
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import errors_named, read_input, warn_of_potential
from mapdeal.pipeline.memory import check_fits, claim_work
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step
from mapdeal.records import dataclass
from mapdeal.stages.esdf import esdf

_NULL = "null"
_NOISE = 1e-12
"""Metres, and metres per metre: what rounding leaves of a 0 between cells."""


@dataclass(frozen=True)
class Answers:
    """What a field says of some points, or costs of some poses.

    Parameters
    ----------
    lines : list of str
        A JSON object for each.
    outside : int
        How many of them no cell holds.
    """

    lines: list[str]
    outside: int


def field_to_ask(path: Path, options: Settings, parameters: Mapping[str, object]) -> DistanceField:
    """Return the field in a file, or the one that `parameters` of `esdf` make of its map."""
    source = read_input(path, options)
    if isinstance(source.grid, DistanceField):
        for name in parameters:
            option = f"--{name.replace('_', '-')}"
            raise ParameterError("is for maps: this field is made already", source=option)
        with options.memory():
            claim_work(path, source.grid, 0.0)
        return source.grid
    with options.memory():
        check_fits(path, source.grid.shape, [make_step("esdf", {})], None)
    warn_of_potential(source.grid, path)
    with use_threads(options.threads), errors_named(path):
        return esdf(as_occupancy(source.grid), **parameters)  # type: ignore[arg-type]


def answers_of(field: DistanceField, asked: PointLines) -> Answers:
    """Return what a field says of points, one JSON object for each line asked."""
    cells, inside = field.frame.bounded_rowcol_from_xy(asked.points_xy)
    samples = field.query(asked.points_xy)
    columns = [
        exact_texts(asked.points_xy[:, 0]),
        exact_texts(asked.points_xy[:, 1]),
        _texts(samples.distance),
        _texts(samples.gradient[:, 0]),
        _texts(samples.gradient[:, 1]),
        _texts(field.distance[cells[:, 0], cells[:, 1]].astype(np.float64)),
    ]
    states = _states_of(field, cells)
    lines = []
    for index, (x, y, distance, gx, gy, own) in enumerate(zip(*columns, strict=True)):
        if not inside[index]:
            lines.append(_nothing_at(x, y, asked, index))
            continue
        gradient = "null" if gx == _NULL else f"[{gx}, {gy}]"
        lines.append(
            f'{{"x": {x}, "y": {y}, "inside": true, '
            f'"row": {cells[index, 0]}, "col": {cells[index, 1]}, "state": "{states[index]}", '
            f'"distance": {distance}, "gradient": {gradient}, "cell_distance": {own}}}'
        )
    return Answers(lines, len(lines) - int(inside.sum()))


def _states_of(field: DistanceField, cells: NDArray[np.int64]) -> list[str]:
    """Return what the map says of cells, whatever the field counts unknown ones as."""
    occupancy = field.occupancy[cells[:, 0], cells[:, 1]]
    states = np.where(occupancy >= field.lethal_threshold, "occupied", "free")
    return np.where(occupancy == UNKNOWN, "unknown", states).tolist()  # type: ignore[no-any-return]


def _nothing_at(x: str, y: str, asked: PointLines, index: int) -> str:
    """Return the answer for a point outside, or for a line without a point."""
    keys = ("row", "col", "state", "distance", "gradient", "cell_distance")
    nothing = ", ".join(f'"{key}": {_NULL}' for key in keys)
    error = key_of_error(asked.errors, asked.lines, index)
    return f'{{"x": {x}, "y": {y}, "inside": false, {nothing}{error}}}'


def key_of_error(errors: Mapping[int, str], lines: Sequence[int], index: int) -> str:
    """Return the end of an answer that says what is wrong with its line, if anything is."""
    if index not in errors:
        return ""
    error = f', "error": {json.dumps(errors[index])}'
    return f', "line": {lines[index]}{error}' if lines[index] else error


def exact_texts(values: NDArray[np.float64]) -> list[str]:
    """Return numbers as JSON, null for what is not finite."""
    return [repr(value) if math.isfinite(value) else _NULL for value in values.tolist()]


def _texts(values: NDArray[np.float64]) -> list[str]:
    """Return numbers as JSON with no more digits than they are good for.

    Distances are float32. One that is still such a number is written in as few digits as tell
    it from its neighbours, one between cells in nine.
    """
    values = np.where(np.abs(values) < _NOISE, 0.0, values)
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32)
    short = single.astype(str).tolist()
    pairs = zip(values.tolist(), short, (single == values).tolist(), strict=True)
    return [
        (text if is_single else f"{value:.9g}") if math.isfinite(value) else _NULL
        for value, text, is_single in pairs
    ]
