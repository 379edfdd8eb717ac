"""Every reader of the project and its good files.

A new reader gets an entry in `READERS`; the suite fails as long as it has none.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealError, ParameterError
from mapdeal.maps.dialects import DIALECTS
from robustness import reading, seeds
from robustness.mutation import words_of
from robustness.seeds import files_of

BAG_WORDS, CLOUD_WORDS, IMAGE_WORDS, JSON_WORDS, NPY_WORDS, SCAN_WORDS, TEXT_WORDS = map(
    words_of, ("bag", "cloud", "image", "json", "npy", "scan", "text")
)
YAML_WORDS, TOML_WORDS = words_of("yaml"), words_of("toml")
ROS1_WORDS, ROS2_WORDS = words_of("yaml", "ros1"), words_of("yaml", "ros2")


@dataclass(frozen=True)
class Seed:
    """A good file: its name, the data to damage, and the other files of its folder."""

    name: str
    data: bytes
    packed: Callable[[bytes], bytes] = bytes
    """Makes a file of damaged data, with checksums that are right."""
    beside: Mapping[str, bytes] = field(default_factory=dict)
    """Names may have a slash."""


@dataclass(frozen=True)
class Reader:
    """A reader under test: its name, on which the mutants depend, too, and its good files.

    ``read(path, data)`` reads a file or a text, checks the result, and may return it.
    """

    name: str
    seeds: Sequence[Seed]
    read: Callable[[Path, bytes], object]
    words: Sequence[bytes] = ()
    """What may be put into its files."""
    refusals: tuple[type[MapdealError], ...] = (MalformedInputError,)
    """Errors that it may raise."""
    is_file: bool = True
    """Whether errors must name the file."""
    share: float = 1.0
    """How many mutants it gets, as a part of what others get: less where they take long."""


def _seeds(files, name, **options):
    return [Seed(name, data, **options) for data in files]


def _stored(folder, name):
    return _seeds(files_of(folder), name)


def _zips(names, called):
    """Return stored npz files as they are, and to be zipped when their arrays are damaged."""
    files = files_of("npz", *(f"{name}.npz" for name in names.split()))
    arrays = [seeds.npy_members(data) for data in files]
    return _seeds(files, called) + _seeds(arrays, called, packed=seeds.zipped) * 2


def _pictures(folder):
    found = _seeds(files_of(folder), "m.image")
    again = _seeds(files_of(folder), "m.image", packed=seeds.with_checksums)
    return found + again if folder == "png" else found


def _states():
    whole = seeds.states_of_two()
    messages = Seed("m.pbstream", seeds.messages_of(whole), packed=seeds.as_state)
    return [Seed("m.pbstream", whole), messages, messages]


def _logs():
    logs = files_of("carmen")
    short = _seeds(logs[1:3], "a.log", packed=seeds.gzipped)
    return _seeds(logs, "a.log") + short + _seeds([seeds.gzipped(logs[1])], "a.log")


def _scan_texts():
    texts = {f"{name}.txt": files_of("scan_texts", f"{name}.txt")[0]
             for name in ("poses", "angles", "ranges")}  # fmt: skip
    return [Seed(name, data, beside=texts) for name, data in texts.items()]


def _dumped(folder):
    documents = seeds.documents_of(folder)
    return {name: json.dumps(document).encode() for name, document in documents.items()}


def _documents(folder):
    return [Seed(f"{name}.json", data) for name, data in _dumped(folder).items()]


_RUNS = _dumped("runs")


def _manifests():
    good = _RUNS["manifest"]
    golden = good.replace(b'"2222', b'"5222').replace(b"0.3", b"0.4").replace(b"-0.5", b"-0.7")
    return [Seed("manifest.json", good, beside={"golden/run/manifest.json": golden})]


def _shown():
    """Return a run and a batch for a page, each with the layers of a run beside it."""
    field_, costs = files_of("npz", "field.npz", "costs.npz")
    run = {"manifest.json": _RUNS["shown"], "esdf.npz": field_, "cost.npz": costs}
    batch = {f"a/m/{name}": data for name, data in run.items()}
    return [Seed("manifest.json", run.pop("manifest.json"), beside=run),
            Seed("summary.json", _RUNS["summary"], beside=batch)]  # fmt: skip


def _of_all_kinds():
    folders = ("pcd", "ply", "npy", "carmen", "shapes", "recipes")
    files = [
        *(files_of(folder)[0] for folder in folders), _dumped("geojson")["00"],
        files_of("poses")[0], files_of("png", "03_grey_8.png")[0], seeds.MAP_YAML, seeds.MAP_PGM,
        _RUNS["manifest"], b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n",
        b"a:\n  ros__parameters: {b: 1}\n",
    ]  # fmt: skip
    return _seeds(files, "f") + _zips("scans", "f")


def _bags():
    names = ["plain.bag", "lz4.bag", "none.mcap", "zstd.mcap", "bag.db3", "metadata.yaml"]
    *files, database, metadata = map(Seed, names, files_of("bags", *names))
    return [*files, database, replace(metadata, beside={"bag.db3": database.data})]


_PNM = files_of("pnm")
_MAP_FILES = {"m.pgm": seeds.MAP_PGM, "n.png": files_of("png", "03_grey_8.png")[0]}
_RAW_YAML = b"{image: n.png, resolution: .5, origin: [0, 0, 0], mode: raw}"
_MAP_SEEDS = _seeds([seeds.MAP_YAML, _RAW_YAML], "m.yaml", beside=_MAP_FILES)
_BY_ROWS = _seeds([data for data in _PNM if data[:2] in (b"P4", b"P5", b"P6")], "m.pgm")
_BIT_YAML = seeds.MAP_YAML.replace(b"m.pgm", b"m.pbm")
_BIT_IMAGES = _seeds([data for data in _PNM if data[:2] in (b"P1", b"P4")], "m.pbm")
_BIT_SEEDS = [
    Seed("m.pbm", _BIT_IMAGES[0].data, beside={"m.yaml": _BIT_YAML}),
    Seed("m.yaml", _BIT_YAML, beside={"m.pbm": _BIT_IMAGES[1].data}),
]
_LISTED = {
    "maps/m.yaml": seeds.MAP_YAML, "maps/m.pgm": seeds.MAP_PGM, "maps/deep/n.yaml": seeds.MAP_YAML,
    "maps/no.yaml": b"a: 1\n", "maps/m2.npz": b"",
}  # fmt: skip
_LISTS = [b"# maps\nmaps/m.yaml\nmaps/deep\n", b"maps/**/*.yaml\nmaps/[mn]?.npz\n", b"maps\r\n"]
_GRIDS = "occupancy field costs potential"

_IMAGES = {"PNM": 1.0, "PNG": 1.0, "BMP": 0.7, "TIFF": 0.6, "JPEG": 0.6}

_USAGE = (ParameterError,)
_PAIR = (MalformedInputError, FileAccessError)  # a file that it names may be missing


def _text(name, file, read, share=1.0):
    """Return a reader of texts of one line, which lie in one file."""
    (lines,) = files_of("texts", f"{file}.txt")
    good = _seeds(lines.splitlines(), "")
    return Reader(name, good, read, TEXT_WORDS, _USAGE, is_file=False, share=share)


_LINES = {"points": "points", "poses": "pose_lines", "named": "named_points", "pairs": "pairs"}
READERS = [
    *(
        Reader(f"map yaml, {dialect}", _MAP_SEEDS, reading.map_reader(dialect), YAML_WORDS, _PAIR,
               share=0.15 if dialect == "humble" else 0.35)
        for dialect in DIALECTS
    ),
    *(Reader(f"{name} image", _pictures(name.lower()), reading.read_picture, IMAGE_WORDS,
            share=share) for name, share in _IMAGES.items()),
    Reader("PNM by rows", _BY_ROWS, reading.read_by_rows, IMAGE_WORDS, share=0.4),
    Reader("bits", _BIT_IMAGES, reading.decode_bits, IMAGE_WORDS),
    Reader("bit map", _BIT_SEEDS, reading.read_bits, YAML_WORDS, _PAIR, share=0.2),
    Reader("grid npz", _zips(_GRIDS, "g.npz"), reading.read_grid, NPY_WORDS, share=0.7),
    Reader("grid npz by rows", _zips(_GRIDS, "g.npz"), reading.read_npz_by_rows, NPY_WORDS,
          share=0.3),
    Reader("state", _states(), reading.read_state, share=0.7),
    Reader("lint", _MAP_SEEDS, reading.lint, YAML_WORDS, (), share=0.02),
    Reader("pcd", _stored("pcd", "c.pcd"), reading.read_cloud_points, CLOUD_WORDS),
    Reader("ply", _stored("ply", "c.ply"), reading.read_cloud_points, CLOUD_WORDS),
    Reader("cloud as text", _stored("text_clouds", "c.csv"), reading.read_text_points, CLOUD_WORDS),
    Reader("octomap bt", _seeds(files_of("octomap", "00.bt"), "c.bt"), reading.read_octree_points,
           CLOUD_WORDS, share=0.5),
    Reader("octomap ot", _seeds(files_of("octomap", "01.ot", "02.ot"), "c.ot"),
           reading.read_octree_points, CLOUD_WORDS, share=0.5),
    Reader("kitti", _stored("kitti", "c.bin"), reading.read_cloud_points, CLOUD_WORDS, share=0.5),
    Reader("counted text", _stored("pts", "c.pts"), reading.read_cloud_points, CLOUD_WORDS,
           share=0.5),
    Reader("cloud npy", _stored("npy", "c.npy"), reading.read_cloud_points, NPY_WORDS),
    Reader("reach npz", _zips("reach", "r.npz"), reading.read_reached, NPY_WORDS, share=0.5),
    Reader("evidence npz", _zips("odds hits", "e.npz"), reading.read_evidence_layers,
          NPY_WORDS, share=0.5),
    Reader("cloud npz", _zips("points", "c.npz"), reading.read_cloud_points, NPY_WORDS),
    Reader("CARMEN log", _logs(), reading.read_log, SCAN_WORDS),
    Reader("bag", _bags(), reading.read_bag, BAG_WORDS, _PAIR, share=0.25),
    Reader("kinds of files", _of_all_kinds(), reading.kind_of_file, YAML_WORDS, share=0.5),
    Reader("scans npz", _zips("scans", "s.npz"), reading.read_log, NPY_WORDS, share=0.7),
    Reader("scans as text", _scan_texts(), reading.read_scan_texts, CLOUD_WORDS),
    Reader("poses", _stored("poses", "p.txt"), reading.read_all_poses, CLOUD_WORDS),
    *(Reader(f"lines of {kind}", _stored(folder, "p.csv"), reading.lines_of(kind),
             JSON_WORDS, is_file=False, share=0.5) for kind, folder in _LINES.items()),
    Reader("shapes yaml", _stored("shapes", "s.yaml"), reading.read_all_shapes, YAML_WORDS,
          share=0.4),
    Reader("GeoJSON", _documents("geojson"), reading.read_all_shapes, JSON_WORDS),
    Reader("route graph", _documents("route_graphs"), reading.read_one_graph, JSON_WORDS),
    Reader("zones", _documents("geojson"), reading.read_all_zones, JSON_WORDS, share=0.5),
    Reader("answers", _documents("answers"), reading.read_one_answer, JSON_WORDS, share=0.5),
    Reader("transform", _documents("transforms"), reading.read_one_transform, JSON_WORDS,
          share=0.5),
    Reader("manifest", _manifests(), reading.compare_with_golden, JSON_WORDS),
    Reader("runs on a page", _shown(), reading.show_runs, JSON_WORDS, _PAIR, share=0.15),
    Reader("recipe", _stored("recipes", "r.yaml"), reading.load_one_recipe, YAML_WORDS, _USAGE,
           is_file=False, share=0.4),
    Reader("configuration of lint", _stored("lint_configs", "c.toml"), reading.read_config,
           TOML_WORDS, (MalformedInputError, ParameterError), is_file=False, share=0.4),
    Reader("lint of parameters", _seeds(files_of("ros1") + files_of("ros2"), "p.yaml"),
           reading.lint_parameter_files, ROS1_WORDS, (), share=0.1),
    Reader("parameters of ROS 1", _stored("ros1", "p.yaml"), reading.read_ros1_robot,
           ROS1_WORDS, share=0.5),
    Reader("parameters of ROS 2", _stored("ros2", "p.yaml"),
          reading.read_ros2_parameters, ROS2_WORDS, share=0.4),
    Reader("robot of Nav2", _stored("ros2", "p.yaml"), reading.read_nav2_robot,
          ROS2_WORDS, share=0.4),
    Reader("list of maps", _seeds(_LISTS, "maps.txt", packed=reading.within_folder, beside=_LISTED),
           reading.list_all_maps, TEXT_WORDS, (ParameterError, FileAccessError), is_file=False,
           share=0.25),
    _text("--set", "settings", reading.load_settings, share=0.15),
    _text("--set of layers", "layer_settings", reading.load_layers, share=0.3),
    _text("parameters of stages", "parameters", reading.accept_parameters, share=0.7),
    _text("footprint", "footprints", reading.parse_footprint),
    _text("size", "sizes", reading.parse_size),
    _text("pair of numbers", "number_pairs", reading.parse_numbers),
]  # fmt: skip
