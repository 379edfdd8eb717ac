"""What ``mapdeal info`` says of a robot's parameter files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mapdeal.errors import one_line
from mapdeal.pipeline.figures import said

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
