"""``mapdeal score``: how good a map is, on its own or against a true one."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.score import Asked, ScoreReport, score_files
from mapdeal.compare.bounds import (
    AGAINST_TRUTH,
    ALONE,
    COUNT,
    DISTANCES,
    METRES,
    SHARE,
    THICKNESS,
    ScoreBound,
    figure_in,
    figure_text,
    figures_named,
    unit_of,
    why_missing,
)
from mapdeal.errors import ParameterError
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_COLUMNS = (
    ("n", "n", COUNT, 9),
    ("mean", "mean", METRES, 13),
    ("median", "median", METRES, 13),
    ("p95", "p95", METRES, 13),
    ("max", "max", METRES, 13),
    ("within 0.1 m", "share_le_0p1", SHARE, 14),
)

_AFTER_THICKNESS = [
    "share_one_cell_thick", "corners", "enclosed_areas", "enclosed_m2", "enclosed_pockets"
]  # fmt: skip


@app.command()
@shared_options("files", help_texts={"image": "Write a picture of the distances between walls."})
def score(
    source: opt.MapArgument,
    truth: Annotated[
        Path | None, typer.Option(metavar="MAP", help="True map to compare with."), FROM_STDIN
    ] = None,
    align: bool = False,
    transform: Path | None = None,
    minimum: Annotated[list[str] | None, typer.Option("--min")] = None,
    maximum: Annotated[list[str] | None, typer.Option("--max")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Score a map, on its own or against a true map.

    With --truth: the distances between its walls and the true ones, the share of the known area
    that it covers, the agreement of cells. Without: shares of cells, thickness of walls, corners,
    enclosed areas. Exit code 1 if a bound is missed.

    Options
    -------
    --align: Align the map with the true one first.
    --transform FILE.json: Or apply a transform from its frame to that of the true map, as align
        writes it.
    --min NAME=VALUE: Pass if a figure is at least this value, such as coverage=0.9; can be
        repeated.
    --max NAME=VALUE: Pass if a figure is at most this value, such as dist_est_to_truth_m.mean=0.1;
        can be repeated.
    """
    asked = Asked(
        _bounds(minimum, "--min"), _bounds(maximum, "--max"), None, transform, align
    )  # fmt: skip
    report = score_files(source, truth, settings, asked)
    terminal.document(report, None if as_json else _lines(source, truth, report))
    if not report.passes:
        raise typer.Exit(1)


def _bounds(texts: list[str] | None, option: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise ParameterError("must be NAME=VALUE", source=option, got=text)
        name = name.strip()
        if name in found:
            raise ParameterError(f"{name} is given twice", source=option)
        (found[name],) = opt.numbers(value, 1, "VALUE", f"{option} {name}")
    return found


def _lines(source: Path, truth: Path | None, report: ScoreReport) -> list[str]:
    frame = report.frame
    size = f"{frame.width} x {frame.height} cells of {frame.resolution:.6g} m"
    if truth is None:
        return [f"{source}: {size}", *_alone(report), *_judged(report)]
    return [
        f"{source} against {truth}: {size}",
        f"  transform  {_moved(report)}",
        *_distances(report),
        *_table([
            (name, meaning, figure_text(report.values[name], unit))
            for name, (unit, meaning) in AGAINST_TRUTH.items()
        ]),
        *_judged(report)
    ]  # fmt: skip


def _moved(report: ScoreReport) -> str:
    if report.transform is None or report.way == "frames":
        return "none: both maps are taken to be in one frame"
    x, y, yaw = report.transform.pose
    found = "found by align" if report.way == "align" else "as given"
    return f"x {x:.6g} m, y {y:.6g} m, yaw {math.degrees(yaw):.6g} deg, {found}"


def _distances(report: ScoreReport) -> list[str]:
    wide = max(len(meaning) for meaning in DISTANCES.values())
    head = f"  {'distance to the nearest wall':<{wide}}"
    lines = ["", head + "".join(f"{title:>{room}}" for title, _, _, room in _COLUMNS)]
    for name, meaning in DISTANCES.items():
        told = report.values[name]
        cells = "".join(
            f"{figure_text(told[key], unit):>{room}}" for _, key, unit, room in _COLUMNS
        )
        lines.append(f"  {meaning:<{wide}}{cells}  {name}")
    return [*lines, ""]


def _alone(report: ScoreReport) -> list[str]:
    names = figures_named(with_truth=False)
    order = [name for name in ALONE if name not in _AFTER_THICKNESS]
    order += [f"{THICKNESS}.{key}" for key in ("mean", "median", "p95")]
    order += _AFTER_THICKNESS
    return _table([
        (name, names[name][1], figure_text(figure_in(report.values, name), names[name][0]))
        for name in order
    ])  # fmt: skip


def _table(rows: list[tuple[str, str, str]]) -> list[str]:
    wide = max(len(meaning) for _, meaning, _ in rows)
    return [f"  {meaning:<{wide}}  {value:<10}  {name}" for name, meaning, value in rows]


def _judged(report: ScoreReport) -> list[str]:
    with_truth = report.comparison is not None
    return [f"  bound     {_bound(bound, with_truth=with_truth)}" for bound in report.bounds]


def _bound(bound: ScoreBound, *, with_truth: bool) -> str:
    unit = unit_of(bound.name, with_truth=with_truth)
    told = f"--{bound.side} {bound.name}={bound.allowed:g}{unit}: "
    told += "holds" if bound.holds else "missed"
    if bound.found is None:
        return f"{told}, not measured: {why_missing(bound.name)}"
    # 9 digits: a figure that is shown as the bound itself is within it
    return f"{told}, found {bound.found:.9g}{unit}"
