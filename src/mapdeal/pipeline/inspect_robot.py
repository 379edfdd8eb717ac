"""Figures of a robot's parameter files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mapdeal.errors import kept_warnings
from mapdeal.formats.kinds import PARAMETERS, kind_of
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import open_map
from mapdeal.formats.source import exists, is_folder
from mapdeal.robot.effects import effect_of, on_map
from mapdeal.robot.load import is_ros2, read_robot
from mapdeal.robot.parameters import CostmapName


def describe_robot(
    paths: Sequence[Path],
    *,
    costmap: CostmapName = "global",
    namespace: str | None = None,
    dialect: Dialect = "nav2",
    map_path: Path | None = None,
) -> dict[str, Any]:
    """Return what a robot's parameter files say of one of its costmaps, as JSON can hold it.

    Beside all that was resolved, each layer has its ``effect`` on a map that is a file, and
    ``warnings`` are what reading has warned of. With a map there is ``on_map``: what inflation
    comes to there.
    """
    with kept_warnings():
        robot = read_robot(paths, costmap=costmap, namespace=namespace, older=dialect != "nav2")
    report: dict[str, Any] = {"file": str(paths[-1]), "kind": "robot parameters"}
    report |= robot.described()
    for entry, one in zip(report["layers"], robot.layers, strict=True):
        entry["effect"] = effect_of(one, robot)
    report["warnings"] = list(robot.remarks)
    if map_path is not None:
        with open_map(map_path, dialect=dialect) as file:
            resolution = file.frame().resolution
        report["map"] = str(map_path)
        report["on_map"] = on_map(robot, resolution)
    return report


def robots_among(
    paths: Sequence[Path], *, is_one: bool
) -> Iterator[tuple[bool, list[Path]]]:  # fmt: skip
    """Yield files one by one, and parameter files that are of one robot together."""
    if is_one:
        yield True, list(paths)
        return
    stack: list[Path] = []
    for path in paths:
        kind = kind_of(path) if exists(path) and not is_folder(path) else None
        is_parameters = kind is not None and kind.name == PARAMETERS
        if is_parameters and not is_ros2(path):
            stack.append(path)
            continue
        if stack:
            yield True, stack
            stack = []
        yield is_parameters, [path]
    if stack:
        yield True, stack
