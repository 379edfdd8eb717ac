"""Kind of a file, by its first bytes, and the command that accepts it.

Commands that get a wrong kind of file print one line from here.
"""

from __future__ import annotations

import re
import shlex
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mapdeal import errors, records
from mapdeal.files import source, text as texts, yaml_text
from mapdeal.files.json_values import LARGEST_DOCUMENT, document_kind, finite_or_text, read_json
from mapdeal.grid.values import join_words
from mapdeal.maps import formats, images, npz

MAP, CLOUD, SCANS, POSES, NUMBERS = "map", "point cloud", "laser scans", "poses", "numbers"
IMAGE, RECIPE, SHAPES, BAG, POINTER = "image", "recipe", "shapes", "bag", "Git LFS pointer"
PARAMETERS, WORLD = "ROS parameters", "world"

_HEAD = 1 << 16
_MOST_COUNTED = 1 << 28  # largest text in bytes whose lines are counted
_SCAN_WORDS = re.compile(rb"(?m)^[ \t]*(FLASER|ROBOTLASER1|RAWLASER1)[ \t]")
_JSON_START = re.compile(rb"\s*\{\s*\"")
_STAGES_KEY = re.compile(rb"(?m)^stages[ \t]*:")
_KEY = re.compile(rb"(?m)^[ \t{]*[\"']?([\w/]+)[\"']?[ \t]*:")
_COSTMAP_KEYS = frozenset((
    "ros__parameters", "local_costmap", "global_costmap",
    "obstacle_layer", "inflation_layer", "static_layer",
    "footprint", "footprint_padding", "robot_radius", "inflation_radius", "cost_scaling_factor",
    "static_map", "map_type", "rolling_window", "robot_base_frame", "track_unknown_space",
    "trinary_costmap", "lethal_cost_threshold", "unknown_cost_value", "obstacle_range",
    "raytrace_range", "observation_sources",
))  # fmt: skip
"""Keys that only parameter files have: one at any depth identifies such a file."""
_COMMON_KEYS = frozenset((
    "plugins", "transform_tolerance", "global_frame", "update_frequency", "publish_frequency",
    "always_send_full_costmap", "map_topic", "max_obstacle_height",
))  # fmt: skip
"""Keys that other files may have, too: two of them identify a parameter file."""
_TUM, _PLANAR = 8, 3
_MOST_OF_A_POINT = 16
_KITTI_POINT = 16  # bytes: x, y, z and the reflectance
_NEAREST, _FARTHEST_LIKELY = 1e-3, 1e4  # metres

_METADATA = "metadata.yaml"
_BAG_ENDINGS = (".mcap", ".db3")
_OTHER_ENDINGS_IN_BAGS = (".zstd", ".db3-wal", ".db3-shm", ".txt")
_UNKNOWN = "is not a kind of file that mapdeal knows"
_MAPS_ARE = f"a map is {join_words(entry.name for entry in formats.FORMATS)}"

_MAP_USE = "mapdeal info {path} describes it, mapdeal run {path} -o DIR processes it"
_CLOUD_USE = (
    "mapdeal build --cloud {path} -o MAP.yaml makes a map of it, mapdeal local one around a robot"
)
_SCANS_USE = "mapdeal build {path} -o OUT.yaml makes a map of it"
_POSES_USE = "--poses {path} gives it to mapdeal build and mapdeal local"
_BAG_USE = "mapdeal info {path} lists its topics; convert, build [--cloud], local --cloud take them"
_PARAMETERS_USE = (
    "mapdeal run MAP -o DIR --params-file {path} takes it, mapdeal lint --params-file {path} "
    "checks it; in Python mapdeal.read_robot_parameters reads it"
)
_WORLD_USE = "mapdeal build --world {path} --height 0.2 -o MAP.yaml makes a map of it"
_REPORT_USE = "mapdeal report {path} -o OUT.html shows it"
_GRAPH_USE = "mapdeal lint MAP --graph {path} checks it, mapdeal route MAP --graph {path} uses it"
_OF_A_MAP_USE = "mapdeal report MAP {path} -o OUT.html shows it on its map"


@records.dataclass(frozen=True)
class FileKind:
    name: str
    what: str
    use: str
    figures: Callable[[], dict[str, Any]] = dict
    form: str = ""  # of a format whose header has further figures


def kind_of(path: Path) -> FileKind | None:
    if source.is_folder(path):
        kind = _kind_of_folder(path)
    else:
        head = source.head_of(path, _HEAD).removeprefix(texts.BYTE_ORDER_MARK)
        kind = next(filter(None, (detect(path, head) for detect in _DETECTORS)), None)
    as_typed = shlex.quote(str(path))
    return None if kind is None else records.replace(kind, use=kind.use.format(path=as_typed))


def readable_kind(path: Path) -> FileKind | None:
    with suppress(errors.MapdealError):
        return kind_of(path)
    return None


def is_bag(path: Path) -> bool:
    if path.suffix.lower() in formats.MAP_ENDINGS and path.name != _METADATA:
        return False
    kind = readable_kind(path)
    return kind is not None and kind.name == BAG


@contextmanager
def recognised(path: Path, expected: str, *kinds: str) -> Iterator[None]:
    """Name the kind of a file in errors if it is not the one expected."""
    try:
        yield
    except (errors.MalformedInputError, errors.FileAccessError) as error:
        if str(error.source) != str(path):
            raise
        kind = readable_kind(path)
        if kind is None and MAP in kinds and path.suffix.lower() not in formats.MAP_ENDINGS:
            error.hint = error.hint or _MAPS_ARE
            if isinstance(error, errors.MalformedInputError):
                raise errors.MalformedInputError(_UNKNOWN, source=path, hint=_MAPS_ARE) from None
        if kind is None or kind.name in kinds:
            raise
        raise other_kind(path, kind, expected) from None


def other_kind(path: Path, kind: FileKind, expected: str) -> errors.MalformedInputError:
    return errors.MalformedInputError(f"is {kind.what}, not {expected}", source=path, hint=kind.use)


def _kind_of_folder(path: Path) -> FileKind | None:
    metadata, key = path / _METADATA, b"rosbag2_bagfile_information"
    if source.exists(metadata) and key in source.head_of(metadata, _HEAD):
        return FileKind(BAG, "a folder with a ROS 2 bag", _BAG_USE)
    if source.exists(path / "summary.json"):
        return _kind_of_json(path / "summary.json", b"{")
    with suppress(errors.FileAccessError):
        suffixes = {Path(name).suffix.lower() for name in source.contents_of(path)[1]}
        if suffixes & set(_BAG_ENDINGS) and suffixes <= {*_BAG_ENDINGS, *_OTHER_ENDINGS_IN_BAGS}:
            return FileKind(BAG, "a folder with a ROS 2 bag, without its metadata", _BAG_USE)
    return None


_MAGIC: tuple[tuple[bytes | tuple[bytes, ...], tuple[str, ...], str], ...] = (
    ((b"#ROSBAG V", b"#ROSRECORD V", b"#ROSLOG V"), (), "a ROS 1 bag"),
    (b"\x89MCAP0\r\n", (), "a bag (MCAP)"),
    (b"SQLite format 3\0", (".db3",), "a ROS 2 bag (SQLite)"),
    (b"SQLite format 3\0", (), "an SQLite database"),
    (b"\x28\xb5\x2f\xfd", (".mcap", ".db3"), "a ROS 2 bag, compressed with zstd"),
)
"""First bytes of bags, allowed endings of their names (none: any), and descriptions."""


def _kind_by_magic(path: Path, head: bytes) -> FileKind | None:
    if head.startswith(source.LFS_POINTER):
        found = re.search(rb"(?m)^size (\d{1,18})$", head)
        size = f" to a file of {int(found[1])} bytes" if found else ""
        return FileKind(POINTER, f"a Git LFS pointer{size}", "git lfs pull fetches the file itself")
    suffixes = {suffix.lower() for suffix in path.suffixes}
    for magic, endings, description in _MAGIC:
        if head.startswith(magic) and (not endings or suffixes.intersection(endings)):
            return FileKind(BAG, description, _BAG_USE, lambda: {"bytes": _size_of(path)})
    return None


def _size_of(path: Path) -> int:
    return source.status_of(path).st_size


def _kind_of_map(_: Path, head: bytes) -> FileKind | None:
    names = (form.name for form in formats.FORMATS if form.magic and head.startswith(form.magic))
    return next((FileKind(MAP, name, _MAP_USE) for name in names), None)


def _kind_of_world(path: Path, head: bytes) -> FileKind | None:
    is_xml = head.lstrip().startswith(b"<")
    root = re.search(rb"<(sdf|robot|COLLADA)[\s>]", head) if is_xml else None
    by_root = {b"sdf": "a world (SDF)", b"robot": "a robot (URDF)", b"COLLADA": "a mesh (DAE)"}
    by_ending = {".stl": "a mesh (STL)", ".obj": "a mesh (OBJ)"}
    name = by_root[root[1]] if root else by_ending.get(path.suffix.lower())
    return FileKind(WORLD, name, _WORLD_USE) if name else None


def _kind_of_cloud(path: Path, head: bytes) -> FileKind | None:
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith(b"#"))
    first_word = next(lines, b"#").split(maxsplit=1)[0]
    if head.startswith((b"ply\n", b"ply\r")):
        return FileKind(CLOUD, "a point cloud (PLY)", _CLOUD_USE, form="PLY")
    if first_word in (b"VERSION", b"FIELDS", b"COLUMNS"):
        return FileKind(CLOUD, "a point cloud (PCD)", _CLOUD_USE, form="PCD")
    if head.startswith(b"# Octomap OcTree"):
        return FileKind(CLOUD, "an octree of occupied voxels (OctoMap)", _CLOUD_USE, form="OctoMap")
    if path.suffix.lower() == ".bin" and _looks_like_kitti(head, _size_of(path)):
        points = {"points": _size_of(path) // _KITTI_POINT}
        return FileKind(CLOUD, "a point cloud (KITTI)", _CLOUD_USE, lambda: points)
    if head.startswith(b"\x93NUMPY"):
        return FileKind(CLOUD, "an array of numpy (npy)", f"of points, {_CLOUD_USE}", form="npy")
    return None


def _looks_like_kitti(head: bytes, size: int) -> bool:
    """Return whether the first bytes of a file are likely points; the format has no header."""
    numbers = np.frombuffer(head, "<f4", len(head) // _KITTI_POINT * 4).reshape(-1, 4)
    if size % _KITTI_POINT or not len(numbers) or not np.isfinite(numbers).all():
        return False
    xyz = np.abs(numbers[:, :3])
    is_likely = float(np.median(xyz)) > _NEAREST and float(xyz.max()) < _FARTHEST_LIKELY
    return is_likely and bool(((numbers[:, 3] >= 0) & (numbers[:, 3] <= 255)).all())


def _kind_of_npz(path: Path, head: bytes) -> FileKind | None:
    if not head.startswith(b"PK"):
        return None
    with npz.NpzReader(path, 1) as reader:
        names = reader.names()
        if "format" in names:
            return FileKind(MAP, npz.NPZ.name, _MAP_USE)
        if {"poses", "angles", "ranges"} <= names:
            scans = reader.header("ranges").shape
            figures = {"scans": scans[0], "beams": scans[1]} if len(scans) == 2 else {}
            return FileKind(SCANS, "laser scans (npz)", _SCANS_USE, lambda: figures)
        if "points" in names or len(names) == 1:
            shape = reader.header("points" if "points" in names else next(iter(names))).shape
            text, use = " x ".join(map(str, shape)), f"of points, {_CLOUD_USE}"
            return FileKind(CLOUD, "an array of numpy (npz)", use, lambda: {"shape": text})
    return None


def _kind_of_image(path: Path, head: bytes) -> FileKind | None:
    if (image := images.recognised_format(head)) is None:
        return None

    def figures() -> dict[str, Any]:
        height, width = images.read_image_size(path)
        return {"pixels": f"{width} x {height}"}

    beside = [p for p in map(path.with_suffix, source.YAML) if p != path and source.exists(p)]
    use = "pass its .yaml; mapdeal convert {path} --resolution R -o MAP.yaml makes a map "
    use += "without one"
    if beside:
        use = f"pass the map: {str(beside[0]).replace('{', '{{').replace('}', '}}')}"
    return FileKind(IMAGE, f"an image ({image.name})", use, figures)


def _kind_of_log(path: Path, head: bytes) -> FileKind | None:
    if head.startswith(b"\x1f\x8b"):
        with suppress(OSError, EOFError, zlib.error):
            expanded = zlib.decompressobj(wbits=31).decompress(head, _HEAD)
            return _kind_of_log(path, expanded) if expanded[:2] != b"\x1f\x8b" else None
        return None
    if not _SCAN_WORDS.search(head):
        return None
    return FileKind(SCANS, "a log of laser scans (CARMEN)", _SCANS_USE, form="CARMEN")


_DOCUMENTS = {
    "manifest": ("the manifest of a run", "", "mapdeal info on its folder describes the run"),
    "summary": (
        "the summary of a batch", "#maps", "mapdeal info describes the folder of each of its maps"
    ),
    "route": ("a route (JSON)", "#points length_m", _OF_A_MAP_USE),
    "reach": ("what a robot can reach (JSON)", "reachable_m2 #passages #goals", _OF_A_MAP_USE),
    "lint": ("what lint has found (JSON)", "#maps errors warnings notes", _REPORT_USE),
    "diff": ("what differs between two maps (JSON)", "cells=common_cells differing", _REPORT_USE),
    "difference of costs": (
        "what differs between two costmaps (JSON)", "cells=common_cells differing", _REPORT_USE
    ),
    "difference of robots": ("what a change of a robot's parameters means (JSON)", "", _REPORT_USE),
    "plan": ("plans of a robot's planner (JSON)", "#goals", "mapdeal plan --expect compares it"),
    "alignment": (
        "where one map lies in the frame of another (JSON)", "same_place",
        f"{_REPORT_USE}; mapdeal merge --by takes it",
    ),
    "score": ("the score of a map (JSON)", "#bounds", _REPORT_USE),
    "comparison": ("methods of mapping compared (JSON)", "", _REPORT_USE),
    "route graph": ("a route graph (GeoJSON)", "#features", _GRAPH_USE),
}  # fmt: skip
"""JSON of mapdeal: description, figures (# for the length of a list), and use."""


def _figures_of(value: dict[str, Any], names: str) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for word in names.split():
        name, _, key = word.lstrip("#").partition("=")
        value_of_key = value.get(key or name)
        if word[0] != "#":
            figures[name] = value_of_key
        elif isinstance(value_of_key, list):
            figures[name] = len(value_of_key)
    return figures


def _kind_of_json(path: Path, head: bytes) -> FileKind | None:
    if head.lstrip()[:1] != b"{":
        return None
    value = read_json(path, limit=LARGEST_DOCUMENT, parse_float=finite_or_text)
    name = document_kind(value)
    if value is None or name is None:
        return None
    if name == SHAPES:
        return _shapes("GeoJSON", _figures_of(value, "#shapes=features"))
    description, figure_names, use = _DOCUMENTS[name]
    figures = _figures_of(value, figure_names)
    if name == "summary":
        figures |= Counter(str(map_entry["status"]) for map_entry in value["maps"])
    if name == "comparison" and isinstance(value.get("methods"), dict):
        figures["methods"] = ", ".join(value["methods"])
    return FileKind(name, description, use, lambda: figures)


def _shapes(form: str, figures: dict[str, Any]) -> FileKind:
    use = "mapdeal edit polygon MAP --file {path} -o OUT.yaml draws them"
    return FileKind(SHAPES, f"a file of shapes ({form})", use, lambda: figures)


def _kind_of_yaml(path: Path, head: bytes) -> FileKind | None:
    if b":" not in head or b"\0" in head or _JSON_START.match(head):
        return None
    if source.IMAGE_KEY.search(head):
        return FileKind(MAP, "a map", _MAP_USE)
    entries = {}
    try:
        entries = yaml_text.read_mapping(path, yaml_text.OF_SHAPES)
    except errors.MalformedInputError:
        if path.suffix.lower() not in source.YAML or _STAGES_KEY.search(head):
            return None
    if "image" in entries:
        return FileKind(MAP, "a map", _MAP_USE)
    if "stages" in entries:
        use = "mapdeal run MAP -o DIR --recipe {path} takes it"
        stages: list[str] = []
        with suppress(errors.MalformedInputError):
            for stage in entries["stages"].items():
                is_name = isinstance(stage.node, yaml.ScalarNode)
                stages.append(stage.text() if is_name else next(iter(stage.fields()), ""))
        return FileKind(RECIPE, "a recipe", use, lambda: {"stages": ", ".join(stages)})
    if "shapes" in entries:
        with suppress(errors.MalformedInputError):
            return _shapes("YAML", {"shapes": len(entries["shapes"].items())})
    if "rosbag2_bagfile_information" in entries:
        return FileKind(BAG, "the description of a ROS 2 bag", _BAG_USE)
    names = {key.decode().rpartition("/")[2] for key in _KEY.findall(head)}
    if names & _COSTMAP_KEYS or len(names & _COMMON_KEYS) > 1 or b"costmap_2d::" in head:
        nodes = {"nodes": ", ".join(entries)} if entries else {}
        return FileKind(PARAMETERS, "a file of ROS parameters", _PARAMETERS_USE, lambda: nodes)
    return None


def _kind_of_numbers(path: Path, head: bytes) -> FileKind | None:
    lines = [line.strip().decode("latin-1") for line in head.split(b"\n")[:-1] or [head]]
    rows = [line for line in lines if line and not line.startswith("#")]
    if not rows or b"\0" in head:
        return None
    if len(rows) > 2 and rows[0].isdigit() and len(rows[1].split()) > 1:
        del rows[0]  # the number of points, as in .pts
    delimiter = texts.delimiter_of(rows[-1])
    names = [texts.coordinate_name(word) for word in rows[0].removeprefix("//").split(delimiter)]
    has_names = {"x", "y"} <= set(names) and len(rows) > 1
    width = len(rows[-1].split(delimiter))
    for row in rows[has_names:]:
        words = row.split(delimiter)
        if len(words) != width or not all(map(texts.is_number, words)):
            return None

    def figures() -> dict[str, Any]:
        if _size_of(path) > _MOST_COUNTED:
            return {"bytes": _size_of(path)}
        count, last = 0, b"\n"
        for chunk in source.chunks_of(path):
            count, last = count + chunk.count(b"\n"), chunk[-1:]
        return {"lines": count + (last != b"\n")}

    if has_names or (2 <= width <= _MOST_OF_A_POINT and width not in (_PLANAR, _TUM)):
        description = f"a point cloud (text with {width} numbers a line)"
        return FileKind(NUMBERS, description, _CLOUD_USE, figures)
    if width == _TUM:
        return FileKind(POSES, "a file of poses (TUM)", _POSES_USE, figures)
    description = f"a text with {width} number{'s' if width > 1 else ''} a line"
    if width == _PLANAR:
        use = f"of points x y z, {_CLOUD_USE}; of poses x y yaw, {_POSES_USE}"
        return FileKind(NUMBERS, description, use, figures)
    use = "mapdeal build --poses P --angles A --ranges R takes scans in three texts"
    return FileKind(NUMBERS, description, use, figures)


# Tried in this order, the fastest first; the first result counts.
_DETECTORS: tuple[Callable[[Path, bytes], FileKind | None], ...] = (
    _kind_by_magic, _kind_of_map, _kind_of_cloud, _kind_of_npz, _kind_of_image, _kind_of_log,
    _kind_of_json, _kind_of_world, _kind_of_numbers, _kind_of_yaml,
)  # fmt: skip

STDIN, STDOUT = "standard input", "standard output"

_ZIP = b"PK\3\4"
_HINT = "a map comes by a pipe as an npz: mapdeal convert MAP -o - makes one of any map"


def save_npz(chunks: Iterable[bytes], folder: Path) -> Path:
    # Readers need a file: they seek, and compare its size and state.
    path = folder / f"{STDIN}.npz"
    length, head = 0, b""
    with source.access_to(path, "written"), path.open("wb") as file:
        for chunk in chunks:
            length += len(chunk)
            file.write(chunk)
            head += chunk[: max(_HEAD - len(head), 0)]
            if len(head) >= _HEAD and not head.startswith(_ZIP):
                break
            if source.current_budget().limit is not None:
                source.claim(STDIN, length)
            elif length > source.LONGEST_STREAM:
                rule = f"must not be larger than {source.LONGEST_STREAM} bytes"
                raise errors.MalformedInputError(rule, source=STDIN)
    if not head:
        hint = "the command before it in the pipe has written nothing"
        raise errors.MalformedInputError("is empty", source=STDIN, hint=hint)
    if not head.startswith(_ZIP):
        kind = readable_kind(path)
        rule = "is not an npz" if kind is None else f"is {kind.what}, not an npz"
        raise errors.MalformedInputError(rule, source=STDIN, hint=_HINT)
    return path
