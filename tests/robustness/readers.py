"""Every reader of the project and its good files.

A new reader gets an entry in `READERS`; the suite fails as long as it has none.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealError, ParameterError
from mapdeal.maps.dialects import DIALECTS
from mapdeal.maps.images import IMAGE_FORMATS
from robustness import reading, seeds
from robustness.words import (
    BAG_WORDS,
    CLOUD_WORDS,
    IMAGE_WORDS,
    JSON_WORDS,
    NPY_WORDS,
    ROS1_WORDS,
    ROS2_WORDS,
    SCAN_WORDS,
    TEXT_WORDS,
    TOML_WORDS,
    YAML_WORDS,
)


@dataclass(frozen=True)
class Seed:
    """A good file.

    Parameters
    ----------
    name : str
        What it is called.
    data : bytes
        What is damaged.
    packed : callable
        Makes a file of damaged `data`, with checksums that are right.
    beside : mapping of str to bytes
        Other files of its folder; a name may have a slash.
    """

    name: str
    data: bytes
    packed: Callable[[bytes], bytes] = bytes
    beside: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Reader:
    """A reader under test.

    Parameters
    ----------
    name : str
        What failures call it; the mutants depend on it.
    seeds : sequence of Seed
        Good files.
    read : callable
        ``read(path, data)`` reads a file, or a text, checks what it is given, and returns that.
    refusals : tuple of exception types
        What it may raise.
    words : sequence of bytes
        What may be put into its files.
    is_file : bool
        Whether errors must name the file.
    share : float
        How many mutants it gets, as a part of what others get: less where they take long.
    """

    name: str
    seeds: Sequence[Seed]
    read: Callable[[Path, bytes], object]
    refusals: tuple[type[MapdealError], ...] = (MalformedInputError,)
    words: Sequence[bytes] = ()
    is_file: bool = True
    share: float = 1.0


def _seeds(files, name, **options):
    return [Seed(name, data, **options) for data in files]


def _zips(names, called):
    """Return stored npz files as they are, and to be zipped when their arrays are damaged."""
    files = seeds.stored(*names)
    arrays = [seeds.npy_members(data) for data in files]
    return _seeds(files, called) + _seeds(arrays, called, packed=seeds.zipped) * 2


def _pictures(name):
    files = {
        "PNM": seeds.pnm_files, "PNG": seeds.png_files, "BMP": seeds.bmp_files,
        "TIFF": seeds.tiff_files, "JPEG": seeds.jpeg_files,
    }[name]()  # fmt: skip
    made = _seeds(files, "m.image")
    return made + _seeds(files, "m.image", packed=seeds.with_checksums) if name == "PNG" else made


def _logs():
    logs = seeds.carmen_logs()
    short = _seeds(logs[1:3], "a.log", packed=seeds.gzipped)
    return _seeds(logs, "a.log") + short + _seeds([seeds.gzipped(logs[1])], "a.log")


def _scan_texts():
    texts = seeds.scan_texts()
    return [Seed(name, data, beside=texts) for name, data in texts.items()]


def _manifests():
    good = json.dumps(seeds.MANIFEST).encode()
    other = good.replace(b'"2222', b'"5222').replace(b"0.3", b"0.4").replace(b"-0.5", b"-0.7")
    return [Seed("manifest.json", good, beside={"golden/run/manifest.json": other})]


def _shown():
    """Return a run and a batch for a page, each with the layers of a run beside it."""
    good = json.dumps(seeds.SHOWN_RUN).encode()
    layers = dict(
        zip(("esdf.npz", "cost.npz"), seeds.stored("field.npz", "costs.npz"), strict=True)
    )
    below = {f"a/m/{name}": data for name, data in [("manifest.json", good), *layers.items()]}
    batch = json.dumps(seeds.SUMMARY).encode()
    return [Seed("manifest.json", good, beside=layers), Seed("summary.json", batch, beside=below)]


def _answers():
    return [Seed(f"{name}.json", json.dumps(one).encode()) for name, one in seeds.ANSWERS.items()]


def _of_all_kinds():
    files = [
        seeds.pcd_files()[0], seeds.ply_files()[0], seeds.npy_files()[0], seeds.carmen_logs()[0],
        seeds.SHAPES_YAML[0], seeds.RECIPES[0], seeds.geojson_files()[0], seeds.pose_files()[0],
        seeds.png(8, 0), seeds.MAP_YAML, seeds.MAP_PGM, json.dumps(seeds.MANIFEST).encode(),
        b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"a:\n  ros__parameters: {b: 1}\n",
    ]  # fmt: skip
    return _seeds(files, "f") + _zips(["scans.npz"], "f")


def _bags():
    names = ["plain.bag", "lz4.bag", "none.mcap", "zstd.mcap", "bag.db3"]
    *files, database = map(Seed, names, seeds.stored(*names))
    metadata = seeds.bag_metadata("bag.db3", "sqlite3")
    return [*files, database, Seed("metadata.yaml", metadata, beside={"bag.db3": database.data})]


_BY_ROWS = [data for data in seeds.pnm_files() if data[:2] in (b"P4", b"P5", b"P6")]
_MAP_FILES = {"m.pgm": seeds.MAP_PGM, "n.png": seeds.png(8, 0)}
_MAP_SEEDS = [
    Seed("m.yaml", seeds.MAP_YAML, beside=_MAP_FILES),
    Seed(
        "m.yaml", b"{image: n.png, resolution: .5, origin: [0, 0, 0], mode: raw}", beside=_MAP_FILES
    ),
]
_BIT_YAML = seeds.MAP_YAML.replace(b"m.pgm", b"m.pbm")
_BIT_IMAGES = _seeds([data for data in seeds.pnm_files() if data[:2] in (b"P1", b"P4")], "m.pbm")
_BIT_SEEDS = [
    Seed("m.pbm", _BIT_IMAGES[0].data, beside={"m.yaml": _BIT_YAML}),
    Seed("m.yaml", _BIT_YAML, beside={"m.pbm": _BIT_IMAGES[1].data}),
]
_LISTED = {
    "maps/m.yaml": seeds.MAP_YAML, "maps/m.pgm": seeds.MAP_PGM, "maps/deep/n.yaml": seeds.MAP_YAML,
    "maps/no.yaml": b"a: 1\n", "maps/m2.npz": b"",
}  # fmt: skip
_LISTS = [b"# maps\nmaps/m.yaml\nmaps/deep\n", b"maps/**/*.yaml\nmaps/[mn]?.npz\n", b"maps\r\n"]
_GRIDS = ["occupancy.npz", "field.npz", "costs.npz", "potential.npz"]

_SHARES = {"BMP": 0.7, "TIFF": 0.6, "JPEG": 0.6}
_USAGE = (ParameterError,)
_PAIR = (MalformedInputError, FileAccessError)  # what is named may not be there


def _file(name, good, read, words, **options):
    return Reader(name, good, read, words=words, **options)


def _text(name, texts, read, share=1.0):
    return Reader(name, _seeds(texts, ""), read, _USAGE, TEXT_WORDS, is_file=False, share=share)


READERS = [
    *(
        Reader(f"map yaml, {dialect}", _MAP_SEEDS, reading.map_reader(dialect), _PAIR, YAML_WORDS,
               share=0.15 if dialect == "humble" else 0.35)
        for dialect in DIALECTS
    ),
    *(_file(f"{name} image", _pictures(name), reading.read_picture, IMAGE_WORDS,
            share=_SHARES.get(name, 1.0)) for name in IMAGE_FORMATS),
    _file("PNM by rows", _seeds(_BY_ROWS, "m.pgm"), reading.read_by_rows, IMAGE_WORDS, share=0.4),
    _file("bits", _BIT_IMAGES, reading.decode_bits, IMAGE_WORDS),
    Reader("bit map", _BIT_SEEDS, reading.read_bits, _PAIR, YAML_WORDS, share=0.2),
    _file("grid npz", _zips(_GRIDS, "g.npz"), reading.read_grid, NPY_WORDS, share=0.7),
    _file("grid npz by rows", _zips(_GRIDS, "g.npz"), reading.read_npz_by_rows, NPY_WORDS,
          share=0.3),
    Reader("lint", _MAP_SEEDS, reading.lint, (), YAML_WORDS, share=0.02),
    _file("pcd", _seeds(seeds.pcd_files(), "c.pcd"), reading.read_cloud_points, CLOUD_WORDS),
    _file("ply", _seeds(seeds.ply_files(), "c.ply"), reading.read_cloud_points, CLOUD_WORDS),
    _file("cloud as text", _seeds(seeds.text_clouds(), "c.csv"), reading.read_text_points,
          CLOUD_WORDS),
    _file("cloud npy", _seeds(seeds.npy_files(), "c.npy"), reading.read_cloud_points, NPY_WORDS),
    _file("reach npz", _zips(["reach.npz"], "r.npz"), reading.read_reached, NPY_WORDS, share=0.5),
    _file("evidence npz", _zips(["odds.npz", "hits.npz"], "e.npz"), reading.read_evidence_layers,
          NPY_WORDS, share=0.5),
    _file("cloud npz", _zips(["points.npz"], "c.npz"), reading.read_cloud_points, NPY_WORDS),
    _file("CARMEN log", _logs(), reading.read_log, SCAN_WORDS),
    Reader("bag", _bags(), reading.read_bag, (MalformedInputError, FileAccessError), BAG_WORDS,
           share=0.25),
    _file("kinds of files", _of_all_kinds(), reading.kind_of_file, YAML_WORDS, share=0.5),
    _file("scans npz", _zips(["scans.npz"], "s.npz"), reading.read_log, NPY_WORDS, share=0.7),
    _file("scans as text", _scan_texts(), reading.read_scan_texts, CLOUD_WORDS),
    _file("poses", _seeds(seeds.pose_files(), "p.txt"), reading.read_all_poses, CLOUD_WORDS),
    Reader("points", _seeds(seeds.point_files(), "p.csv"), reading.read_point_lines,
           words=JSON_WORDS, is_file=False, share=0.7),
    Reader("poses as lines", _seeds(seeds.pose_line_files(), "p.csv"), reading.read_poses_of_lines,
           words=JSON_WORDS, is_file=False, share=0.5),
    Reader("points with names", _seeds(seeds.named_point_files(), "p.csv"),
           reading.read_named_point_lines, words=JSON_WORDS, is_file=False, share=0.5),
    Reader("pairs of points", _seeds(seeds.pair_files(), "p.csv"), reading.read_pair_lines,
           words=JSON_WORDS, is_file=False, share=0.5),
    _file("shapes yaml", _seeds(seeds.SHAPES_YAML, "s.yaml"), reading.read_all_shapes, YAML_WORDS,
          share=0.4),
    _file("GeoJSON", _seeds(seeds.geojson_files(), "s.json"), reading.read_all_shapes, JSON_WORDS),
    _file("answers", _answers(), reading.read_one_answer, JSON_WORDS, share=0.5),
    _file("transform", _seeds(seeds.TRANSFORMS, "t.json"), reading.read_one_transform, JSON_WORDS,
          share=0.5),
    _file("manifest", _manifests(), reading.compare_with_golden, JSON_WORDS),
    Reader("runs on a page", _shown(), reading.show_runs, _PAIR, JSON_WORDS, share=0.15),
    Reader("recipe", _seeds(seeds.RECIPES, "r.yaml"), reading.load_one_recipe, _USAGE, YAML_WORDS,
           is_file=False, share=0.4),
    Reader("configuration of lint", _seeds(seeds.LINT_CONFIGS, "c.toml"), reading.read_config,
           (MalformedInputError, ParameterError), TOML_WORDS, is_file=False, share=0.4),
    Reader("lint of parameters",
           _seeds([*seeds.ROS1_PARAMETERS, *seeds.ROS2_PARAMETERS], "p.yaml"),
           reading.lint_parameter_files, (), ROS1_WORDS, share=0.1),
    Reader("parameters of ROS 1", _seeds(seeds.ROS1_PARAMETERS, "p.yaml"), reading.read_ros1_robot,
           words=ROS1_WORDS, share=0.5),
    _file("parameters of ROS 2", _seeds(seeds.ROS2_PARAMETERS, "p.yaml"),
          reading.read_ros2_parameters, ROS2_WORDS, share=0.4),
    _file("robot of Nav2", _seeds(seeds.ROS2_PARAMETERS, "p.yaml"), reading.read_nav2_robot,
          ROS2_WORDS, share=0.4),
    Reader("list of maps", _seeds(_LISTS, "maps.txt", packed=reading.within_folder, beside=_LISTED),
           reading.list_all_maps, (ParameterError, FileAccessError), TEXT_WORDS, is_file=False,
           share=0.25),
    _text("--set", seeds.SETTINGS, reading.load_settings, share=0.15),
    _text("--set of layers", seeds.LAYER_SETTINGS, reading.load_layers, share=0.3),
    _text("parameters of stages", seeds.PARAMETERS, reading.accept_parameters, share=0.7),
    _text("footprint", seeds.FOOTPRINTS, reading.parse_footprint),
    _text("size", seeds.SIZES, reading.parse_size),
    _text("pair of numbers", seeds.PAIRS, reading.parse_numbers),
]  # fmt: skip
