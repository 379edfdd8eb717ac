"""``mapdeal info``: descriptions of maps, runs, bags and a robot's parameter files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timezone
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from mapdeal import errors, records
from mapdeal.command import Result, Words, command
from mapdeal.files.source import exists, is_folder, sha256_of, status_of, sums_of_reads
from mapdeal.grid import field, filters, occupancy
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.reach import Reach, robot_text
from mapdeal.grid.values import UNKNOWN, count_text, table_lines
from mapdeal.maps import dialects, kinds
from mapdeal.maps.listing import list_maps
from mapdeal.maps.reading import open_map
from mapdeal.pictures.overlay import known_box
from mapdeal.pipeline.folder import MANIFEST, format_value, manifest_in, stages_behind, summary_of
from mapdeal.pipeline.inputs import InShell, Work, claim_work
from mapdeal.pipeline.settings import ProgressCallback, Settings
from mapdeal.ros.load import by_robot, read_robot
from mapdeal.ros.planners import has_server, planners_of
from mapdeal.ros.robot import CostmapName, effect_of, on_map
from mapdeal.ros.ros2_files import read_ros2

Report = dict[str, Any]
Row = tuple[str, str]

_OF_POTENTIAL, _OF_OTHERS = 62.0, 2.0  # bytes per cell: figures of a potential need its layers
_ANSWERS = ("goals", "passages", "closed_passages")  # figures of a reach that an npz lacks
_SHOWN_KEYS = ("image", "mode", "negate", "occupied_thresh", "free_thresh")
_OF_RUN = ("version", "inputs", "options", "stages", "figures", "warnings")

_LATEST = 253402300799  # seconds up to which Python has dates: the year 9999
_NAMES = {"distance field": "distances", "potential field": "values", "reach": "area"}
_RADII = ("inscribed_radius", "circumscribed_radius")
_STACKS = {"nav2": "Nav2", "ros1": "ROS 1"}


def info(
    path: str | PathLike[str], *, dialect: dialects.Dialect = "nav2", max_cells: int | None = None,
    max_memory: int | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Describe a map, distance field, costmap or run folder.

    Parameters
    ----------
    path : path or str
        A ``.yaml``, ``.pbm`` or ``.npz`` file, or a folder with a manifest.
    dialect, max_cells, max_memory
        As for `read_map`.

    Returns
    -------
    dict of str to object
        The description that ``mapdeal info --json`` prints: size, origin, cell counts, checksum
        and, for the outputs of a run, the stages that made them.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the file or folder cannot be read.
    """
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    with settings.reading():
        return _described(Path(path), settings)


@records.dataclass(frozen=True, repr=False)
class Descriptions(Result):
    reports: Iterator[Report]
    failed: list[errors.MapdealError] = records.field(default_factory=list)  # those met so far

    def document(self) -> dict[str, Any]:
        return next(self.reports)

    def parts(self) -> Iterator[str]:
        yield from map(json.dumps, self.reports)

    def lines(self) -> Iterator[str]:
        # errors are on stderr
        described = (report for report in self.reports if report["kind"] != "error")
        for index, report in enumerate(described):
            if index:
                yield ""
            yield from _lines_of(report)

    def check(self) -> None:
        if self.failed:
            raise errors.BatchError(f"{count_text(len(self.failed), 'file')} cannot be described")


@command(
    name="info",
    group="Questions about a map",
    shared=("dialect", "resolution", "origin", "max_cells", "max_memory"),
    example="""\
mapdeal info examples/maps/office.yaml
mapdeal info examples/robots/nav2_params.yaml --map examples/maps/office.yaml
mapdeal info examples/bags/office.mcap""",
)
def describe(
    sources: Annotated[Sequence[Path], Words("MAP...", typed=list[Path], streams=True)], *,
    work: InShell, of_map: Annotated[Path | None, Words("MAP", name="map")] = None,
    costmap: CostmapName | None = None, namespace: Annotated[str | None, Words("NS")] = None,
    dialect: dialects.Dialect = "nav2", max_cells: int | None = None,
) -> Descriptions:  # fmt: skip
    """Describe maps, runs, bags and a robot's parameter files.

    For maps: size, origin, cell counts, checksum, and the run that made them. For bags: topics and
    transforms. For a robot's parameter files: shape and costmap layers as the robot resolves them;
    consecutive ones belong to one robot until one sets a costmap's layers again, and later files
    win. A folder stands for the maps in it and below. With --json there is one JSON object per file
    or robot, one per line. If one of several files cannot be read, the others are described, and
    the exit code is 5.

    Parameters
    ----------
    sources : sequence of path
        Maps, costmaps, fields, bags, folders of runs or of maps.
    of_map : path, optional
        With parameter files of one robot: report what they resolve to on this map.
    costmap : {'global', 'local'}, optional
        With a robot's parameter files: which costmap  [default: global].
    namespace : str, optional
        With a robot's parameter files: which robot.
    dialect, max_cells : str, int, optional
        As for `read_map`.
    """
    settings = Settings(dialect=dialect, max_cells=max_cells)
    groups = [(True, list(sources))]
    if costmap is None and namespace is None and of_map is None:
        named, groups = [path for source in sources for path in maps_in(source, work)], []
        for flavour, group in by_robot(named):
            groups += [(False, [path]) for path in group] if flavour is None else [(True, group)]
    failed: list[errors.MapdealError] = []

    def reports() -> Iterator[Report]:
        for is_robot, group in groups:
            try:
                if is_robot:
                    yield _describe_robot(group, costmap or "global", namespace, dialect, of_map)
                else:
                    yield _described(group[0], settings, work.counted)
            except errors.MapdealError as error:
                if len(groups) == 1:
                    raise
                failed.append(error)
                work.terminal.error(error)
                yield {"file": str(group[-1]), "kind": "error", "error": str(error)}

    return Descriptions(reports(), failed)


def maps_in(path: Path, work: Work) -> list[Path]:
    if not is_folder(path) or exists(path / MANIFEST) or kinds.kind_of(path) is not None:
        return [path]
    return [entry.path for entry in list_maps([str(path)], None, work.terminal.input_chunks).maps]


def _describe_robot(
    paths: Sequence[Path], costmap: CostmapName, namespace: str | None, dialect: dialects.Dialect,
    map_path: Path | None,
) -> Report:  # fmt: skip
    up_to_kilted = dialect != "nav2"
    with errors.capture_warnings():
        robot = read_robot(paths, costmap=costmap, namespace=namespace, up_to_kilted=up_to_kilted)
    report = {"file": str(paths[-1]), "kind": "robot parameters", **robot.described()}
    for entry, layer in zip(report["layers"], robot.layers, strict=True):
        entry["effect"] = effect_of(layer, robot)
    report["warnings"] = list(robot.remarks)
    if robot.flavour == "nav2" and costmap == "global" and has_server(own := read_ros2(paths)):
        report["planners"] = [
            {"name": entry.name, "plugin": entry.plugin, "parameters": dict(entry.settings)}
            for entry in planners_of(robot, own)[0]
        ]
    if map_path is not None:
        with open_map(map_path, dialect=dialect) as file:
            report |= {"map": str(map_path), "on_map": on_map(robot, file.frame().resolution)}
    return report


def _described(path: Path, settings: Settings, progress: ProgressCallback | None = None) -> Report:
    if path.name == MANIFEST or exists(path / MANIFEST):
        folder = path if is_folder(path) else path.parent
        status_of(folder / MANIFEST)
        manifest = manifest_in(folder)
        report = {"file": str(path), "kind": "run", **{key: manifest.get(key) for key in _OF_RUN}}
        return report | ({"robot": manifest["robot"]} if "robot" in manifest else {})
    try:
        return _describe_map(path, settings.dialect, settings.max_cells)
    except (errors.MalformedInputError, errors.FileAccessError) as error:
        # an error about a file that a map names is not about what the map is
        kind = kinds.kind_of(path) if str(error.source) == str(path) else None
        if kind is None or kind.name in (kinds.MAP, kinds.IMAGE, kinds.POINTER):
            raise error from None
    if kind.name == kinds.BAG:
        from mapdeal.pipeline.bag_maps import describe_bag  # not loaded for a map

        return describe_bag(path, progress=progress)
    report = {"file": str(path), "kind": kind.name, "is": kind.what}
    return report | {"figures": figures_of(path, kind), "use": kind.use}


def figures_of(path: Path, kind: kinds.FileKind) -> Report:
    if not kind.form:
        return kind.figures()
    from mapdeal.sensors import clouds, scans  # not loaded for a map

    if kind.form == "CARMEN":
        return {"scans": scans.CarmenLog(path, max_bad=0).count}
    return clouds.header_figures(path, kind.form)


def _describe_map(path: Path, dialect: dialects.Dialect, max_cells: int | None) -> Report:
    with sums_of_reads() as sums, open_map(path, dialect=dialect, max_cells=max_cells) as file:
        if (reach := file.layers_of(Reach)) is not None:
            return _describe_reach(path, reach)
        source = file.read()
        described = file.described()
        named = file.sums_by_name(sums)
    grid = source.grid
    claim_work(path, grid, _OF_POTENTIAL if isinstance(grid, field.PotentialField) else _OF_OTHERS)
    report: Report = {"file": str(path), "kind": grid.kind}
    report |= {name: getattr(grid, name) for name in grid.parameter_names}
    report |= grid.figures() | described
    if source.metadata is not None:
        report["dialect"] = dialect
        report |= {key: getattr(source.metadata, key) for key in _SHOWN_KEYS}
        info = filters.FilterInfo.of(source.metadata.extra)
        if info is not None and isinstance(grid, occupancy.OccupancyGrid):
            report["filter"] = filters.mask_description(info, grid)
    return report | _origin_of(path, grid, named)


def _describe_reach(path: Path, grid: Reach) -> Report:
    """Return what an npz contains of what a robot can reach; its results are in another file."""
    claim_work(path, grid, _OF_OTHERS)
    return {
        "file": str(path), "kind": grid.kind, "layers": list(grid.layer_names),
        **{key: value for key, value in grid.figures().items() if key not in _ANSWERS},
        "robot": robot_text(grid.robot), "heading_count": grid.heading_count,
        "through_unknown": grid.through_unknown,
        **_origin_of(path, grid, {path.name: sha256_of(path)}),
    }  # fmt: skip


def _origin_of(path: Path, grid: Any, sums: Mapping[str, str]) -> Report:
    """Return the extent of what a grid knows, its checksum, and the stages that have made it."""
    report: Report = {}
    if not isinstance(grid, Costmap):
        box = known_box(grid.occupancy, UNKNOWN)  # row 0 is in the south
        report["known_box"] = None if box is None else list(box)
    report["sha256"] = hashlib.sha256(grid.layer.data).hexdigest()
    stages = stages_behind(path.name, path.parent, sums)
    return report if stages is None else report | {"made_by": stages}


def _lines_of(report: Report) -> Iterator[str]:
    rows = _ROWS.get(report["kind"], _rows_of_file if "use" in report else _rows_of_map)
    is_robot = rows is _rows_of_robot
    names = [file["name"] for file in report["files"]] if is_robot else []
    yield ", ".join(names) if len(names) > 1 else str(report["file"])
    width = 13 if is_robot else 11
    yield from (f"  {key:<{width}} {value}" for key, value in rows(report))


def _rows_of_run(report: Report) -> Iterator[Row]:
    yield "kind", f"run of mapdeal {format_value(report['version'])}"
    yield "inputs", _listed(report["inputs"], with_values=False)
    yield "options", _listed(report["options"])
    if "robot" in report:
        yield "robot", _robot_of_run(report["robot"])
    for name, parameters in chain.from_iterable(map(dict.items, report["stages"])):
        yield name, _listed(parameters)
        yield "", _figures(report["figures"].get(name, {}))
    for text in report["warnings"] if isinstance(report["warnings"], list) else ():
        yield "warning", str(text)


def _robot_of_run(robot: Any) -> str:
    """Return what a manifest says of the robot, on one line; changed by somebody, as it is."""
    try:
        names = ", ".join(file["name"] for file in robot["files"])
        radii = ", ".join(f"{name} {robot[name]:.6g} m" for name in _RADII)
        return f"{robot['node']} of {names}, {radii}"
    except (LookupError, TypeError, ValueError):
        return format_value(robot)


def _rows_of_file(report: Report) -> Iterator[Row]:
    yield "kind", str(report["is"])
    parts = []
    for name, value in report["figures"].items():
        text = f"{value} {name}" if isinstance(value, int) else f"{name} {format_value(value)}"
        parts.append(text.removesuffix("s") if value == 1 else text)
    if parts:
        yield "holds", ", ".join(parts)
    yield "use", str(report["use"])


def _figures(figures: Report) -> str:
    try:
        return f"{figures['width']} x {figures['height']} cells, {summary_of(figures)}"
    except (LookupError, TypeError, ValueError, ZeroDivisionError):
        return _listed(figures)


def _listed(values: object, *, with_values: bool = True) -> str:
    if not isinstance(values, dict):
        return format_value(values)
    return ", ".join(f"{key} {format_value(value)}" if with_values else key
                     for key, value in values.items())  # fmt: skip


def _rows_of_map(report: Report) -> Iterator[Row]:
    width, height, cell = report["width"], report["height"], report["resolution"]
    x, y, yaw = report["origin"]
    yield "kind", report["kind"]
    yield "size", f"{width} x {height} cells, {width * cell:g} x {height * cell:g} m"
    yield "resolution", f"{cell!r} m"
    yield "origin", f"x {x!r} m, y {y!r} m, yaw {yaw!r} rad"
    yield _NAMES.get(report["kind"], "cells"), summary_of(report)
    if "layers" in report:
        yield "layers", ", ".join(report["layers"])
        unknown = "unknown open" if report["through_unknown"] else "unknown closed"
        yield "made for", f"{report['robot']}, {report['heading_count']} headings, {unknown}"
    if "attractive_gain" in report:
        names = ("attractive_gain", "repulsive_gain", "repulsive_cap")
        yield "made with", ", ".join(f"{name} {report[name]:g}" for name in names)
    if "lowest_distance" in report:
        limit = "none" if report["max_distance"] is None else f"{report['max_distance']:g} m"
        conventions = f"unknown {report['unknown']}, lethal_threshold {report['lethal_threshold']}"
        yield "made with", f"{conventions}, max_distance {limit}, strength {report['strength']:g}"
    if "view" in report:
        end = report.get("view_range", report.get("farthest"))
        yield "view", f"{report['view']}, 0 at {end:.4g} m"
    if report.get("known_box"):
        row, col, rows, cols = report["known_box"]
        yield "known box", f"{cols} x {rows} cells from row {row}, col {col}; row 0 south"
    if "mode" in report:
        mode_text = str(report["mode"])
        if report["mode"] != "raw":
            mode_text += f", occupied {report['occupied_thresh']:g}, free {report['free_thresh']:g}"
        mode_text += ", negate" if report["negate"] else ""
        yield "image", str(report["image"])
        yield "read as", f"{mode_text}, dialect {report['dialect']}"
    if "submaps" in report:
        unfinished = report["unfinished"]
        text = f"{report['submaps']} of Cartographer, format version {report['format_version']}"
        yield "submaps", text + (f", {unfinished} unfinished" if unfinished else "")
    for path in report.get("trajectories", ()):
        covered = f"{path['length_m']:.6g} m in {path['duration_s']:.6g} s"
        yield "trajectory", f"{path['id']}: {count_text(path['poses'], 'pose')}, {covered}"
    if "filter" in report:
        yield from filters.mask_rows(report["filter"])
    for name, parameters in chain.from_iterable(map(dict.items, report.get("made_by", ()))):
        yield "made by", f"{name}: {_listed(parameters)}"
    yield "sha256", report["sha256"]


def _rows_of_bag(report: Report) -> Iterator[Row]:
    yield "kind", report["is"]
    messages = "none"
    if report["messages"]:
        messages = f"{report['messages']} in {report['duration_s']:.6g} s"
        seconds = report["start_ns"] / 1e9
        if 0 < seconds <= _LATEST:
            start = datetime.fromtimestamp(seconds, timezone.utc)
            messages += f", from {start:%Y-%m-%d %H:%M:%S} UTC"
    yield "messages", messages
    topics, edges = report["topics"], report["transforms"]
    digits = max((len(str(topic["count"])) for topic in topics), default=0)
    rows: list[tuple[str, ...]] = [
        (topic["topic"], topic["type"], str(topic["count"]).rjust(digits),
         "" if topic["frame"] is None else f"in {topic['frame']}",
         f"for {', '.join(topic['commands'])}" if topic["commands"] else "")
        for topic in topics
    ]  # fmt: skip
    yield from _under("topics", table_lines(rows))
    digits = max((len(str(edge["count"])) for edge in edges), default=0)
    rows = []
    for edge in edges:
        name = f"{edge['parent']} -> {edge['child']}"
        rows.append((name, f"{edge['count']:>{digits}} on {edge['topic']}"))
    yield from _under("transforms", table_lines(rows))
    yield from _under("use", report["use"])


def _under(name: str, lines: Iterable[str]) -> Iterator[Row]:
    for index, line in enumerate(lines):
        yield "" if index else name, line


def _rows_of_robot(report: Report) -> Iterator[Row]:
    window = ", a window that moves with the robot" if report["rolling_window"] else ""
    yield "kind", f"robot parameters of {_STACKS[report['flavour']]}"
    yield "costmap", f"{report['costmap']}, {report['node']}{window}"
    yield "shape", _shape_of(report)
    yield "inscribed", f"{report['inscribed_radius']:.6g} m"
    yield "circumscribed", f"{report['circumscribed_radius']:.6g} m"
    yield "starts out", "unknown" if report["track_unknown_space"] else "free"
    rows = []
    for layer in report["layers"]:
        kind = "filter" if layer.get("filter") else layer["plugin"].rpartition(":")[2]
        rows.append((f"{layer['name']} ({kind})", layer["effect"]))
    yield from _under("layers", table_lines(rows))
    for planner in report.get("planners", ()):
        values = (f"{name} {format_value(value)}" for name, value in planner["parameters"].items())
        yield "planner", ", ".join([planner["name"], planner["plugin"], *values])
    for item in report.get("on_map", ()):
        text = f"{Path(report['map']).name}: {item['layer']} reaches "
        text += f"{item['cell_inflation_radius']} cells, {item['reach']:.4g} m; cost at the"
        yield "on the map", f"{text} circumscribed radius {item['circumscribed_cost']}"
    for text in report["warnings"]:
        yield "warning", text
    for file in report["files"]:
        yield "sha256", file["sha256"] + (f"  {file['name']}" if len(report["files"]) > 1 else "")


def _shape_of(report: Report) -> str:
    footprint, padding = report["footprint"], report["footprint_padding"]
    if isinstance(footprint, dict):
        return f"round, radius {footprint['radius']:.6g} m"
    if report["robot_radius"] is not None:
        padded = f", moved outwards by {padding:.6g} m" if padding else ""
        radius = f"round, robot_radius {report['robot_radius']:g} m"
        return f"{radius}: a polygon of {len(footprint)} corners{padded}"
    corners = ", ".join(f"[{x:.6g}, {y:.6g}]" for x, y in footprint)
    return f"[{corners}]" + (f", with footprint_padding {padding:.6g} m" if padding else "")


_ROWS = {"robot parameters": _rows_of_robot, "bag": _rows_of_bag, "run": _rows_of_run}
