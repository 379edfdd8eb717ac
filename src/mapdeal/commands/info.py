"""What files hold."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import FileAccessError, MalformedInputError, kept_warnings
from mapdeal.files.source import exists, is_folder, sha256_of, status_of, sums_of_reads
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reach import robot_text
from mapdeal.grid.values import UNKNOWN
from mapdeal.inputs.kinds import BAG, IMAGE, MAP, PARAMETERS, POINTER, kind_of
from mapdeal.maps.map_yaml import Dialect
from mapdeal.maps.npz import holds_reach, read_reach
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.folder import MANIFEST, manifest_in, stages_behind
from mapdeal.pipeline.inputs import claim_work
from mapdeal.pipeline.settings import ProgressCallback
from mapdeal.ros.load import is_ros2, read_robot
from mapdeal.ros.robot import CostmapName, effect_of, on_map


def describe_robot(
    paths: Sequence[Path],
    *,
    costmap: CostmapName = "global",
    namespace: str | None = None,
    dialect: Dialect = "nav2",
    map_path: Path | None = None,
) -> dict[str, Any]:
    """Return what a robot's parameter files say of one of its costmaps, as JSON can hold it."""
    # Beside all that was resolved, each layer has its ``effect`` on a map that is a file, and
    # ``warnings`` are what reading has warned of. With a map there is ``on_map``: what inflation
    # comes to there.
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


_OF_POTENTIAL, _OF_OTHERS = 62.0, 2.0
"""Bytes for each cell that figures take; those of a potential are of layers that it does not have
until they are asked for."""

_ANSWERS = ("goals", "passages", "closed_passages")
"""Figures of what can be reached that an npz does not hold."""

_SHOWN_KEYS = ("image", "mode", "negate", "occupied_thresh", "free_thresh")


def describe_file(
    path: Path,
    *,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    progress: ProgressCallback | None = None,
) -> dict[str, Any]:
    """Return what there is to know of a map, costmap or field, as JSON can hold it."""
    # ``known_box`` is row, column, height and width of the known cells' bounding box, row 0 in the
    # south; ``sha256`` is of the layer's bytes in that order. ``made_by`` has the stages that have
    # made the file, with the parameters that took effect, where it lies in the folder of the run
    # that wrote it. A folder of a run, or its manifest, is described as a whole. Of a file that is
    # no map there is what it ``is``, the ``figures`` of its header, and its ``use``; of a bag what
    # `describe_bag` returns.
    is_run = path.name == MANIFEST or exists(path / MANIFEST)
    if is_run:
        return _describe_run(path)
    try:
        if path.suffix.lower() == ".npz" and holds_reach(path):
            return _describe_reach(path, max_cells)
        return _describe_map(path, dialect, max_cells)
    except (MalformedInputError, FileAccessError) as error:
        # an error about a file that a map names is not about what the map is
        kind = kind_of(path) if str(error.source) == str(path) else None
        if kind is None or kind.name in (MAP, IMAGE, POINTER):
            raise _without_run(path) if kind is None and is_folder(path) else error from None
    if kind.name == BAG:
        from mapdeal.pipeline.bag_maps import describe_bag  # not loaded for a map

        return describe_bag(path, progress=progress)
    report = {"file": str(path), "kind": kind.name, "is": kind.what}
    return report | {"figures": kind.figures(), "use": kind.use}


def _describe_map(path: Path, dialect: Dialect, max_cells: int | None) -> dict[str, Any]:
    with sums_of_reads() as sums, open_map(path, dialect=dialect, max_cells=max_cells) as file:
        source = file.read()
        named = file.sums_by_name(sums)
    grid = source.grid
    claim_work(path, grid, _OF_POTENTIAL if isinstance(grid, PotentialField) else _OF_OTHERS)
    report: dict[str, Any] = {"file": str(path), "kind": grid.kind}
    report |= {name: getattr(grid, name) for name in grid.parameter_names}
    report |= grid.figures()
    if source.metadata is not None:
        report["dialect"] = dialect
        report |= {key: getattr(source.metadata, key) for key in _SHOWN_KEYS}
    if not isinstance(grid, Costmap):
        report["known_box"] = _known_box(grid.occupancy)
    report["sha256"] = hashlib.sha256(grid.layer.data).hexdigest()
    stages = stages_behind(path.name, path.parent, named)
    return report if stages is None else report | {"made_by": stages}


def _describe_reach(path: Path, max_cells: int | None) -> dict[str, Any]:
    """Return what an npz contains of what a robot can reach; its results are in another file."""
    grid = read_reach(path, max_cells=max_cells)
    claim_work(path, grid, _OF_OTHERS)
    report: dict[str, Any] = {
        "file": str(path),
        "kind": grid.kind,
        "layers": list(grid.layer_names),
    }
    told = grid.figures()
    report |= {key: told[key] for key in told if key not in _ANSWERS}
    report |= {"robot": robot_text(grid.robot), "heading_count": grid.heading_count}
    report |= {"through_unknown": grid.through_unknown, "known_box": _known_box(grid.occupancy)}
    report["sha256"] = hashlib.sha256(grid.layer.data).hexdigest()
    stages = stages_behind(path.name, path.parent, {path.name: sha256_of(path)})
    return report if stages is None else report | {"made_by": stages}


def _describe_run(path: Path) -> dict[str, Any]:
    """Return the content of the manifest of a run, except the checksums of its outputs."""
    folder = path if is_folder(path) else path.parent
    status_of(folder / MANIFEST)
    manifest = manifest_in(folder)
    keys = ("version", "inputs", "options", "stages", "figures", "warnings")
    report = {"file": str(path), "kind": "run"} | {key: manifest.get(key) for key in keys}
    return report | {key: manifest[key] for key in ("robot",) if key in manifest}


def _without_run(path: Path) -> FileAccessError:
    rule = f"is a directory without the {MANIFEST} of a run"
    return FileAccessError(rule, source=path, hint="name the maps in it")


def _known_box(occupancy: Any) -> list[int] | None:
    known = occupancy != UNKNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if rows.size == 0:
        return None
    row, col = int(rows[0]), int(cols[0])
    return [row, col, int(rows[-1]) - row + 1, int(cols[-1]) - col + 1]
