"""``mapdeal info``: what a file holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import one_line
from mapdeal.pipeline.figures import summary_of
from mapdeal.pipeline.inspect import describe_file
from mapdeal.pipeline.settings import Settings

_NAMES = {"distance field": "distances", "potential field": "values"}

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("dialect", "max_cells", "max_memory")
def info(
    sources: Annotated[
        list[Path], typer.Argument(metavar="MAP...", help="Maps, costmaps or fields.")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object per file, each on a line.")
    ] = False,
    *,
    settings: Settings,
) -> None:
    """Tell size, origin, cell counts and checksum of files."""
    for index, source in enumerate(sources):
        report = describe_file(source, dialect=settings.dialect, max_cells=settings.max_cells)
        if as_json:
            terminal.result(json.dumps(report))
        else:
            terminal.result("\n" * (index > 0) + _text(report))


def _text(report: dict[str, Any]) -> str:
    width, height, resolution = report["width"], report["height"], report["resolution"]
    x, y, yaw = report["origin"]
    rows = [
        ("kind", report["kind"]),
        ("size", f"{width} x {height} cells, {width * resolution:g} x {height * resolution:g} m"),
        ("resolution", f"{resolution!r} m"),
        ("origin", f"x {x!r} m, y {y!r} m, yaw {yaw!r} rad"),
        (_NAMES.get(report["kind"], "cells"), summary_of(report)),
    ]
    if "attractive_gain" in report:
        names = ("attractive_gain", "repulsive_gain", "repulsive_cap")
        rows.append(("made with", ", ".join(f"{name} {report[name]:g}" for name in names)))
    if "lowest_distance" in report:
        limit = "none" if report["max_distance"] is None else f"{report['max_distance']:g} m"
        made = f"unknown {report['unknown']}, lethal_threshold {report['lethal_threshold']}, "
        made += f"max_distance {limit}, strength {report['strength']:g}"
        rows.append(("made with", made))
    if report.get("known_box"):
        row, col, box_height, box_width = report["known_box"]
        rows.append(
            (
                "known box",
                f"{box_width} x {box_height} cells from row {row}, col {col}; row 0 south",
            )
        )
    if "mode" in report:
        how = str(report["mode"])
        if report["mode"] != "raw":
            how += f", occupied {report['occupied_thresh']:g}, free {report['free_thresh']:g}"
        how += ", negate" if report["negate"] else ""
        rows.append(("image", str(report["image"])))
        rows.append(("read as", f"{how}, dialect {report['dialect']}"))
    rows.append(("sha256", report["sha256"]))
    lines = [f"  {name:<11} {value}" for name, value in rows]
    return "\n".join(one_line(line) for line in [str(report["file"]), *lines])
