"""``mapdeal info``: what a file holds."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.info_bag import text_of_bag
from mapdeal.cli.info_robot import line_of_robot, text_of_robot
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.errors import one_line
from mapdeal.pipeline.figures import said, summary_of
from mapdeal.pipeline.inspect import describe_file
from mapdeal.pipeline.inspect_robot import describe_robot, robots_among
from mapdeal.pipeline.settings import Settings
from mapdeal.robot.parameters import CostmapName

_NAMES = {"distance field": "distances", "potential field": "values", "reach": "area"}

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("dialect", "max_cells", "max_memory")
def info(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MAP...",
            help=f"Maps, costmaps, fields, bags, or folders of runs. {opt.OR_STDIN}",
        ),
        FROM_STDIN,
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object per file, one per line.")
    ] = False,
    of_map: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="MAP",
            help="With parameter files of one robot: report what they resolve to on this map.",
        ),
    ] = None,
    costmap: Annotated[
        CostmapName | None,
        typer.Option(
            help="With a robot's parameter files: which costmap.  [default: global]",
            show_default=False,
        ),
    ] = None,
    namespace: Annotated[
        str | None,
        typer.Option(metavar="NS", help="With a robot's parameter files: which robot."),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Describe maps, runs, bags and a robot's parameter files.

    For maps: size, origin, cell counts, checksum, and the run that made them. For bags: topics and
    transforms. For a robot's parameter files: shape and costmap layers as the robot resolves them;
    consecutive ROS 1 files belong to one robot.
    """
    is_of_robot = any(one is not None for one in (costmap, namespace, of_map))
    reports = (
        describe_file(
            group[0],
            dialect=settings.dialect,
            max_cells=settings.max_cells,
            progress=terminal.counted,
        )
        if not is_robot
        else describe_robot(
            group,
            costmap=costmap or "global",
            namespace=namespace,
            dialect=settings.dialect,
            map_path=of_map,
        )
        for is_robot, group in robots_among(sources, is_one=is_of_robot)
    )
    for index, report in enumerate(reports):
        if as_json:
            terminal.result(json.dumps(report))
        else:
            terminal.result("\n" * (index > 0) + _text(report))


def _text(report: dict[str, Any]) -> str:
    if report["kind"] == "robot parameters":
        return text_of_robot(report)
    if report["kind"] == "bag":
        return text_of_bag(report)
    rows_of = _rows_of_file if "use" in report else _rows_of_map
    rows = _rows_of_run(report) if report["kind"] == "run" else rows_of(report)
    lines = [f"  {name:<11} {value}" for name, value in rows]
    return "\n".join(one_line(line) for line in [str(report["file"]), *lines])


def _rows_of_run(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what there is to say of a run: its inputs, and each stage with its figures."""
    rows = [
        ("kind", f"run of mapdeal {said(report['version'])}"),
        ("inputs", _listed(report["inputs"], with_values=False)),
        ("options", _listed(report["options"])),
    ]
    if "robot" in report:
        rows.append(("robot", line_of_robot(report["robot"])))
    for name, parameters in _stages(report["stages"]):
        rows.append((name, _listed(parameters)))
        rows.append(("", _figures(report["figures"].get(name, {}))))
    warned = report["warnings"]
    rows += [("warning", str(text)) for text in (warned if isinstance(warned, list) else ())]
    return rows


def _rows_of_file(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what there is to say of a file that is no map."""
    rows = [("kind", str(report["is"]))]
    if report["figures"]:
        rows.append(("holds", _measured(report["figures"])))
    return [*rows, ("use", str(report["use"]))]


def _figures(figures: dict[str, Any]) -> str:
    """Return what a stage has made; of a manifest that somebody has changed as it is."""
    try:
        text = f"{figures['width']} x {figures['height']} cells, {summary_of(figures)}"
    except (LookupError, TypeError, ValueError, ZeroDivisionError):
        return _listed(figures)
    return text


def _stages(stages: list[dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    for stage in stages:
        yield from stage.items()


def _listed(values: object, *, with_values: bool = True) -> str:
    if not isinstance(values, dict):
        return said(values)
    return ", ".join(f"{key} {said(one)}" if with_values else key
                     for key, one in values.items())  # fmt: skip


def _measured(figures: dict[str, Any]) -> str:
    """Return figures with counts in front of what they count: ``5 points, encoding ascii``."""
    parts = []
    for name, value in figures.items():
        is_count = isinstance(value, int)
        parts.append(f"{value} {name}" if is_count else f"{name} {said(value)}")
        if value == 1:
            parts[-1] = parts[-1].removesuffix("s")
    return ", ".join(parts)


def _rows_of_map(report: dict[str, Any]) -> list[tuple[str, str]]:
    width, height, resolution = report["width"], report["height"], report["resolution"]
    x, y, yaw = report["origin"]
    rows = [
        ("kind", report["kind"]),
        ("size", f"{width} x {height} cells, {width * resolution:g} x {height * resolution:g} m"),
        ("resolution", f"{resolution!r} m"),
        ("origin", f"x {x!r} m, y {y!r} m, yaw {yaw!r} rad"),
        (_NAMES.get(report["kind"], "cells"), summary_of(report)),
    ]
    if "layers" in report:
        rows.append(("layers", ", ".join(report["layers"])))
        unknown = "open" if report["through_unknown"] else "closed"
        rows.append(
            (
                "made for",
                f"{report['robot']}, {report['heading_count']} headings, unknown {unknown}",
            )
        )
    if "attractive_gain" in report:
        names = ("attractive_gain", "repulsive_gain", "repulsive_cap")
        rows.append(("made with", ", ".join(f"{name} {report[name]:g}" for name in names)))
    if "lowest_distance" in report:
        limit = "none" if report["max_distance"] is None else f"{report['max_distance']:g} m"
        made = f"unknown {report['unknown']}, lethal_threshold {report['lethal_threshold']}, "
        made += f"max_distance {limit}, strength {report['strength']:g}"
        rows.append(("made with", made))
    if "view" in report:
        end = report.get("view_range", report.get("farthest"))
        rows.append(("view", f"{report['view']}, 0 at {end:.4g} m"))
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
    for name, parameters in _stages(report.get("made_by", [])):
        rows.append(("made by", f"{name}: {_listed(parameters)}"))
    rows.append(("sha256", report["sha256"]))
    return rows
