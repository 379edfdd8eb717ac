"""``mapdeal diff``: what differs between two maps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.checks.difference import STATES, Difference, WallShift
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import one_line
from mapdeal.pipeline.diff import DiffReport, diff_files
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A map: .yaml or .npz.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another.")],
    tolerance: Annotated[
        float,
        typer.Option(metavar="CELLS", help="Let cells pass whose like is so near in the other."),
    ] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Tell what differs between two maps.

    Size, origin and resolution may differ: cells are compared where both maps have some. The
    exit code is 0 if they are equal within the tolerance, 1 if not.
    """
    report = diff_files(first, second, settings, tolerance=tolerance)
    if as_json:
        terminal.result(json.dumps(report.document(), indent=2))
    else:
        for line in _lines(first, second, report, tolerance):
            terminal.result(one_line(line))
    if not report.found.is_equal:
        raise typer.Exit(1)


def _lines(first: Path, second: Path, report: DiffReport, tolerance: float) -> list[str]:
    found = report.found
    lines = [f"{first}, {second}: {'equal' if found.is_equal else 'different'}"]
    for what, pairs in (("geometry", found.geometry), ("metadata", report.metadata)):
        lines += [f"  {what:<9} {name} {a} -> {b}" for name, (a, b) in pairs.items()]
    told = f"  cells     {found.common} in both, {found.differing} differ"
    if tolerance:
        told += f", {found.beyond} beyond a tolerance of {tolerance:g} cells"
    lines.append(told)
    if found.differing:
        lines += _matrix(found)
    if found.symmetry is not None:
        lines.append(f"  symmetry  B is much more like A if it is {found.symmetry}")
    for name, shift in (("A to B", found.walls[0]), ("B to A", found.walls[1])):
        lines.append(f"  walls     {name}: {_shift(shift)}")
    return lines


def _matrix(found: Difference) -> list[str]:
    """Return the confusion matrix, without states that neither map has."""
    table = found.confusion
    used = [k for k in range(len(STATES)) if table[k].any() or table[:, k].any()]
    head = "".join(f"{STATES[k]:>12}" for k in used)
    lines = [f"            {'A, down; B':>12}{head}"]
    for k in used:
        row = "".join(f"{table[k, other]:>12}" for other in used)
        lines.append(f"            {STATES[k]:>12}{row}")
    return lines


def _shift(shift: WallShift | None) -> str:
    if shift is None:
        return "no obstacles"
    return (
        f"at most {shift.largest:.4g} m, 95 % {shift.percentile_95:.4g} m, mean {shift.mean:.4g} m"
    )
