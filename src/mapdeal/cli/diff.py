"""``mapdeal diff``: what differs between two maps."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.checks.selection import STATES, Bound, Bounds, Difference, WallShift
from mapdeal.cli import terminal
from mapdeal.cli.options import OR_STDIN
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.diff import DiffReport, diff_files
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_SHOWN = tuple("1..99" if state == "between" else state for state in STATES)


@app.command()
@shared_options("files")
def diff(
    first: Annotated[
        Path,
        typer.Argument(metavar="A", help=f"A map: .yaml, .pbm or .npz. {OR_STDIN}"),
        FROM_STDIN,
    ],
    second: Annotated[
        Path, typer.Argument(metavar="B", help="Another map; one of the two can be -."), FROM_STDIN
    ],
    tolerance: float = 0.0,
    max_shift: Annotated[float | None, typer.Option(min=0)] = None,
    max_differing: Annotated[float | None, typer.Option(min=0, max=100)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Compare two maps of one place.

    Size, origin and resolution may differ: cells are compared where both maps have some. Exit code
    0 if the maps are equal within the tolerance, 1 if not. With --max-shift or --max-differing the
    exit code is 0 if the differences in the common area stay within these bounds, whatever the
    geometry of the maps.

    Options
    -------
    --tolerance CELLS: Ignore differences with a matching cell in the other map within N cells.
    --max-shift M: Pass if the directed Hausdorff distances between the obstacles, both ways, are
        at most this, metres.
    --max-differing PERCENT: Pass if at most this share of the common cells differs.
    """
    bounds = Bounds(max_shift, max_differing)
    report = diff_files(first, second, settings, tolerance=tolerance, bounds=bounds)
    terminal.document(report, None if as_json else _lines(first, second, report, tolerance))
    if not report.passes:
        raise typer.Exit(1)


def _lines(first: Path, second: Path, report: DiffReport, tolerance: float) -> list[str]:
    found = report.found
    lines = [f"{first}, {second}: {_verdict(report)}"]
    for what, pairs in (("geometry", found.geometry), ("metadata", report.metadata)):
        lines += [f"  {what:<9} {name} {a} -> {b}" for name, (a, b) in pairs.items()]
    told = f"  cells     {found.common} in both, {found.differing} differ"
    if tolerance:
        told += f", {found.beyond} beyond a tolerance of {tolerance:g} cells"
    lines.append(f"{told}; rows: A, columns: B" if found.differing else told)
    if found.differing:
        lines += _matrix(found)
    if found.symmetry is not None:
        lines.append(f"  symmetry  B is much more like A if it is {found.symmetry}")
    for name, shift in (("A to B", found.walls[0]), ("B to A", found.walls[1])):
        lines.append(f"  walls     {_shift(name, shift)}")
    lines += [f"  bound     {_judged(bound)}" for bound in report.bounds]
    return lines


def _verdict(report: DiffReport) -> str:
    verdict = "equal" if report.found.is_equal else "different"
    if not report.bounds:
        return verdict
    return f"{verdict}, {'within the bounds' if report.passes else 'beyond the bounds'}"


def _judged(bound: Bound) -> str:
    told = f"--{bound.name} {bound.allowed:g} {bound.unit}: {'holds' if bound.holds else 'missed'}"
    if math.isnan(bound.found):
        return f"{told}, the maps have no common cell"
    if math.isinf(bound.found):
        return f"{told}, only one of the maps has obstacles"
    # 9 digits: a figure that is shown as the bound itself is not beyond it
    return f"{told}, found {bound.found:.9g} {bound.unit}"


def _matrix(found: Difference) -> list[str]:
    """Return the confusion matrix, without states that neither map has."""
    table = found.confusion
    used = [k for k in range(len(STATES)) if table[k].any() or table[:, k].any()]
    head = "".join(f"{_SHOWN[k]:>12}" for k in used)
    lines = [f"            {'':>12}{head}"]
    for k in used:
        row = "".join(f"{table[k, other]:>12}" for other in used)
        lines.append(f"            {_SHOWN[k]:>12}{row}")
    return lines


def _shift(name: str, shift: WallShift | None) -> str:
    if shift is None:
        return f"{name}: no obstacles"
    return (
        f"directed Hausdorff distance {name}: {shift.largest:.4g} m; "
        f"95 % within {shift.percentile_95:.4g} m, mean {shift.mean:.4g} m"
    )
