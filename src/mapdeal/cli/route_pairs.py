"""``mapdeal route --pairs``: routes of many pairs of points, by several methods."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mapdeal.cli import terminal
from mapdeal.errors import ParameterError
from mapdeal.formats.points import PairLine, read_pairs
from mapdeal.formats.source import chunks_of
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.route_pairs import PairsReport, compare_pairs
from mapdeal.pipeline.settings import Settings
from mapdeal.robot.parameters import RobotParameters

_STDIN = Path("-")

_COLUMNS = {
    "mean clearance": ("mean_clearance", "{:.3f} m"),
    "min clearance": ("min_clearance", "{:.3f} m"),
    "length": ("length", "{:.2f} m"),
    "cost": ("cost", "{:.2f}"),
    "expanded": ("expanded", "{:.0f}"),
}


def report_on_pairs(
    source: Path,
    pairs: Path,
    output: Path | None,
    settings: Settings,
    *,
    methods: Sequence[str],
    footprint: Footprint | None,
    robot: RobotParameters | None,
    weights: Mapping[str, Any],
    of_field: Mapping[str, Any],
) -> None:
    """Find the routes, print or write a line for each, and print what they are on the mean."""
    name = "standard input" if pairs == _STDIN else pairs
    for option, method in (("field_weight", "cost"), ("heuristic_weight", "heuristic")):
        if option in of_field and method not in methods:
            rule = f"needs {method} among the methods of --compare"
            raise ParameterError(rule, source=f"--{option.replace('_', '-')}")
    report = compare_pairs(
        source, _asked(pairs, name), output, settings, asked_from=name, methods=methods,
        footprint=footprint, robot=robot, weights=weights, **of_field, show=_show,
    )  # fmt: skip
    if output is not None:
        terminal.summary([f"{output}: {report.pairs} pairs by {', '.join(methods)}"])
    terminal.remark(_table(report))
    report.check(name)


def _asked(path: Path, name: Path | str) -> Iterator[PairLine]:
    """Yield the pairs as long as there is somebody to read the answers."""
    chunks = terminal.input_chunks() if path == _STDIN else chunks_of(path)
    for pair in read_pairs(chunks, name):
        if not terminal.is_read():
            return
        yield pair


def _show(line: str) -> None:
    terminal.result(line)
    terminal.flush()


def _table(report: PairsReport) -> list[str]:
    """Return the means of each method's routes, as lines."""
    if not report.reached:
        return []
    plural = "s" if report.reached > 1 else ""
    rows = [[f"means of {report.reached} pair{plural}", *_COLUMNS]]
    rows += [
        [f"  {method}", *(_text(form, figures[key]) for key, form in _COLUMNS.values())]
        for method, figures in report.means.items()
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if index else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def _text(form: str, value: float) -> str:
    return form.format(value) if math.isfinite(value) else "-"
