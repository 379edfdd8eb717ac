"""mapdeal info."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.info import describe_file, describe_robot, robots_among
from mapdeal.errors import one_line
from mapdeal.pipeline.folder import said, summary_of
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import CostmapName

_LATEST = 253402300799
"""Seconds up to which Python has dates: the year 9999."""


def text_of_bag(report: dict[str, Any]) -> str:
    lines = [f"  {name:<11} {value}" for name, value in _rows(report)]
    return "\n".join(one_line(line) for line in [str(report["file"]), *lines])


def _rows(report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "kind", report["is"]
    yield "messages", _when(report)
    for index, line in enumerate(_table(report["topics"])):
        yield "topics" if index == 0 else "", line
    for index, line in enumerate(_transforms(report["transforms"])):
        yield "transforms" if index == 0 else "", line
    for index, line in enumerate(report["use"]):
        yield "use" if index == 0 else "", line


def _when(report: dict[str, Any]) -> str:
    if not report["messages"]:
        return "none"
    text = f"{report['messages']} in {report['duration_s']:.6g} s"
    seconds = report["start_ns"] / 1e9
    if 0 < seconds <= _LATEST:
        text += f", from {datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return text


def _table(topics: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each topic, in columns."""
    rows = [
        (
            one["topic"],
            one["type"],
            str(one["count"]),
            "" if one["frame"] is None else f"in {one['frame']}",
            f"for {', '.join(one['commands'])}" if one["commands"] else "",
        )
        for one in topics
    ]
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(5)]
    for row in rows:
        topic, name, count, frame, use = row
        yield (
            f"{topic:<{widths[0]}}  {name:<{widths[1]}}  {count:>{widths[2]}}  "
            f"{frame:<{widths[3]}}  {use}"
        ).rstrip()


def _transforms(edges: list[dict[str, Any]]) -> Iterator[str]:
    width = max((len(f"{one['parent']} -> {one['child']}") for one in edges), default=0)
    digits = max((len(str(one["count"])) for one in edges), default=0)
    for one in edges:
        edge = f"{one['parent']} -> {one['child']}"
        yield f"{edge:<{width}}  {one['count']:>{digits}} on {one['topic']}"


_RADII = ("inscribed_radius", "circumscribed_radius")
_STACKS = {"nav2": "Nav2", "ros1": "ROS 1"}


def text_of_robot(report: Mapping[str, Any]) -> str:
    """Return the report of `describe_robot` as lines for a person."""
    names = [file["name"] for file in report["files"]]
    lines = [f"  {name:<13} {value}" for name, value in _rows_of(report)]
    first = ", ".join(names) if len(names) > 1 else str(report["file"])
    return "\n".join(one_line(line) for line in [first, *lines])


def line_of_robot(robot: Any) -> str:
    """Return what a manifest says of the robot, on one line; changed by somebody, as it is."""
    try:
        names = ", ".join(file["name"] for file in robot["files"])
        radii = [f"{name} {robot[name]:.6g} m" for name in _RADII]
        return f"{robot['node']} of {names}, {', '.join(radii)}"
    except (LookupError, TypeError, ValueError):
        return said(robot)


def _rows_of(report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    window = ", a window that moves with the robot" if report["rolling_window"] else ""
    yield "kind", f"robot parameters of {_STACKS[report['flavour']]}"
    yield "costmap", f"{report['costmap']}, {report['node']}{window}"
    yield "shape", _shape_of(report)
    yield "inscribed", f"{report['inscribed_radius']:.6g} m"
    yield "circumscribed", f"{report['circumscribed_radius']:.6g} m"
    yield "starts out", "unknown" if report["track_unknown_space"] else "free"
    width = max((len(_name_of(one)) for one in report["layers"]), default=0)
    for index, one in enumerate(report["layers"]):
        yield "" if index else "layers", f"{_name_of(one):<{width}}  {one['effect']}"
    for one in report.get("on_map", ()):
        yield "on the map", _on_map(one, Path(report["map"]).name)
    for text in report["warnings"]:
        yield "warning", text
    for file in report["files"]:
        yield (
            "sha256",
            f"{file['sha256']}" + (f"  {file['name']}" if len(report["files"]) > 1 else ""),
        )


def _shape_of(report: Mapping[str, Any]) -> str:
    footprint, padding = report["footprint"], report["footprint_padding"]
    if isinstance(footprint, dict):
        return f"round, radius {footprint['radius']:.6g} m"
    padded = f", moved outwards by {padding:.6g} m" if padding else ""
    if report["robot_radius"] is not None:
        corners = f"a polygon of {len(footprint)} corners"
        return f"round, robot_radius {report['robot_radius']:g} m: {corners}{padded}"
    corners = ", ".join(f"[{x:.6g}, {y:.6g}]" for x, y in footprint)
    return f"[{corners}]" + (f", with footprint_padding {padding:.6g} m" if padding else "")


def _name_of(layer: Mapping[str, Any]) -> str:
    kind = "filter" if layer.get("filter") else layer["plugin"].rpartition(":")[2]
    return f"{layer['name']} ({kind})"


def _on_map(one: Mapping[str, Any], name: str) -> str:
    text = f"{name}: {one['layer']} reaches {one['cell_inflation_radius']} cells, "
    text += f"{one['reach']:.4g} m; cost at the circumscribed radius {one['circumscribed_cost']}"
    return text


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
    as_json: Annotated[bool, typer.Option("--json")] = False,
    of_map: Annotated[Path | None, typer.Option("--map")] = None,
    costmap: CostmapName | None = None,
    namespace: str | None = None,
    *,
    settings: Settings,
) -> None:
    """Describe maps, runs, bags and a robot's parameter files.

    For maps: size, origin, cell counts, checksum, and the run that made them. For bags: topics and
    transforms. For a robot's parameter files: shape and costmap layers as the robot resolves them;
    consecutive ROS 1 files belong to one robot.

    Options
    -------
    --costmap: With a robot's parameter files: which costmap.  [default: global]
    --namespace NS: With a robot's parameter files: which robot.
    --json: Print one JSON object per file, one per line.
    --map MAP: With parameter files of one robot: report what they resolve to on this map.
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
