import gzip
import io
import json
import shlex
import struct
from pathlib import Path

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.commands.info import figures_of
from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.maps.kinds import kind_of, recognised

FLASER = b"FLASER 180 " + b"1.0 " * 180 + b"0 0 0 0 0 0 12.5 host 12.5\n"


def saved(save, *args, **kwargs):
    """The bytes of a file by numpy itself."""
    file = io.BytesIO()
    save(file, *args, **kwargs)
    return file.getvalue()


PCD = (
    b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
    b"WIDTH 3\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 6\nDATA binary\n"
)
PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    b"end_header\n"
) + struct.pack("<8f", *range(8))
ROUTE = {"reached": True, "start": [0, 0], "length_m": 1.5, "points": [[0, 0], [1, 1], [2, 1]]}
NAV2 = b"amcl:\n  ros__parameters:\n    alpha1: 0.2\nglobal_costmap: {}\n"

CLOUD, INFO, BUILD = "mapdeal build --cloud", "mapdeal info", "mapdeal build"
WORLD = "mapdeal build --world"
EDIT, REPORT = "mapdeal edit polygon", "mapdeal report MAP "

# Name and contents of a file; its kind; words of its description; figures; a command for it.
FILES = {
    "c.pcd": (PCD, "point cloud", "PCD", {"encoding": "binary", "points": 6, "fields": "x y z rgb"},
              CLOUD),
    "c.ply": (PLY, "point cloud", "PLY",
              {"encoding": "binary_little_endian", "points": 4, "fields": "x y"}, CLOUD),
    "c.npy": (saved(np.save, np.zeros((7, 3), np.float32)), "point cloud", "npy",
              {"shape": "7 x 3", "type": "float32"}, CLOUD),
    "c.npz": (saved(np.savez, points=np.zeros((5, 2))), "point cloud", "npz", {"shape": "5 x 2"},
              CLOUD),
    "scans.npz": (saved(np.savez, poses=np.zeros((4, 3)), angles=[0] * 9, ranges=np.ones((4, 9))),
                  "laser scans", "npz", {"scans": 4, "beams": 9}, BUILD),
    "w.world": (b"<?xml version='1.0'?>\n<sdf version='1.7'>\n", "world", "SDF", {}, WORLD),
    "r.urdf": (b"<robot name='r'>\n", "world", "URDF", {}, WORLD),
    "m.dae": (b"<COLLADA version='1.4.1'>\n", "world", "DAE", {}, WORLD),
    "c.csv": (b"x,y,z,intensity\n1,2,3,4\n5,6,7,8\n", "numbers", "4 numbers a line", {"lines": 3},
              CLOUD),
    "c.txt": (b"1 2\n3 4\n5 6", "numbers", "2 numbers a line", {"lines": 3}, CLOUD),
    "either.txt": (b"# a comment\n1 2 3\n4 5 6\n", "numbers", "3 numbers a line", {"lines": 3},
                   "--poses"),
    "angles.txt": (b"0.1 " * 40 + b"\n", "numbers", "40 numbers a line", {"lines": 1},
                   "mapdeal build --poses P --angles A --ranges R"),
    "tum.txt": (b"1.5 0 0 0 0 0 0 1\n2.5 1 0 0 0 0 0 1\n", "poses", "TUM", {"lines": 2}, "--poses"),
    "scans.log": (b"# log\nODOM 0 0 0 0 0 0 1 host 1\n" + 3 * FLASER, "laser scans", "CARMEN",
                  {"scans": 3}, BUILD),
    "scans.log.gz": (gzip.compress(b"# log\n" + 2 * FLASER), "laser scans", "CARMEN", {"scans": 2},
                     BUILD),
    "scans.clf": (2 * FLASER, "laser scans", "CARMEN", {"scans": 2}, BUILD),
    "a.bag": (b"#ROSBAG V2.0\n\x45\0\0\0", "bag", "ROS 1", {"bytes": 17}, INFO),
    "a.mcap": (b"\x89MCAP0\r\n\x01", "bag", "MCAP", {"bytes": 9}, INFO),
    "a.db3": (b"SQLite format 3\0\x10\0", "bag", "ROS 2", {"bytes": 18}, INFO),
    "metadata.yaml": (b"rosbag2_bagfile_information:\n  version: 5\n", "bag", "ROS 2", {}, INFO),
    "r.yaml": (b"stages:\n  - inflate: {radius: 1}\n  - esdf\n", "recipe", "recipe",
               {"stages": "inflate, esdf"}, "--recipe"),
    "s.yaml": (b"shapes:\n- {type: circle, center: [0, 0], radius: 1}\n", "shapes", "YAML",
               {"shapes": 1}, EDIT),
    "s.geojson": (json.dumps({"type": "FeatureCollection", "features": [{}, {}]}).encode(),
                  "shapes", "GeoJSON", {"shapes": 2}, EDIT),
    "nav2.yaml": (NAV2, "ROS parameters", "ROS parameters", {"nodes": "amcl, global_costmap"},
                  "--params-file"),
    "ros1.yaml": (b"obstacle_layer: {enabled: true}\nfootprint: []\n", "ROS parameters", "ROS",
                  {"nodes": "obstacle_layer, footprint"}, "--params-file"),
    "nested.yaml": (b"move_base:\n  global_costmap: {a: 0.1}\n", "ROS parameters", "ROS",
                    {"nodes": "move_base"}, "--params-file"),
    "slash.yaml": (b"/robot/move_base/robot_radius: 0.2\n", "ROS parameters", "ROS",
                   {"nodes": "/robot/move_base/robot_radius"}, "--params-file"),
    "list.yaml": (b'plugins:\n- {name: s, type: "costmap_2d::StaticLayer"}\n', "ROS parameters",
                  "ROS", {"nodes": "plugins"}, "--params-file"),
    "frames.yaml": (b"global_frame: map\nupdate_frequency: 5.0\n", "ROS parameters", "ROS",
                    {"nodes": "global_frame, update_frequency"}, "--params-file"),
    "route.json": (json.dumps(ROUTE).encode(), "route", "route", {"points": 3, "length_m": 1.5},
                   REPORT),
    "reach.json": (b'{"reachable_m2": 8.5, "goals": [{}, {}], "passages": [{}]}', "reach",
                   "robot can reach", {"reachable_m2": 8.5, "passages": 1, "goals": 2}, REPORT),
    "lint.json": (b'{"maps": [], "errors": 1, "warnings": 2, "notes": 0, "suppressed": 0}', "lint",
                  "lint has found", {"maps": 0, "errors": 1, "warnings": 2, "notes": 0},
                  "mapdeal report "),
    "diff.json": (b'{"common_cells": 9, "differing": 2, "confusion": {}, "walls": {}}', "diff",
                  "differs between two maps", {"cells": 9, "differing": 2}, "mapdeal report "),
    "alignment.json": (b'{"format": "mapdeal-alignment/1", "same_place": true}', "alignment",
                       "lies in the frame of another", {"same_place": True}, "mapdeal report "),
    "score.json": (b'{"format": "mapdeal-score/1", "bounds": [{}, {}], "passes": false}', "score",
                   "score of a map", {"bounds": 2}, "mapdeal report "),
    "comparison.json": (b'{"format": "mapdeal-comparison/1", "methods": {"tsdf": {}, "beams": 1}}',
                        "comparison", "methods of mapping", {"methods": "tsdf, beams"},
                        "mapdeal report "),
    "summary.json": (b'{"maps": [{"status": "done"}, {"status": "failed"}, {"status": "done"}]}',
                     "summary", "batch", {"maps": 3, "done": 2, "failed": 1}, INFO),
    "old.json": (b'{"outputs": {}, "stages": [], "figures": {}}', "manifest", "run", {}, INFO),
    "m.pgm": (b"P5\n3 2\n255\n123456", "image", "PNM", {"pixels": "3 x 2"}, ".yaml"),
    "lfs.pgm": (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n",
                "Git LFS pointer", "12345 bytes", {}, "git lfs pull"),
}  # fmt: skip
UNKNOWN = {
    "words.txt": b"hello world\n", "empty": b"", "some.bin": bytes(range(256)),
    "words.md": b"# A title\n\nText: more `text`.\nnot: [a map\n", "list.json": b"[1, 2]",
    "keys.md": b"# Keys\n\nfootprint: [a\n", "robot.json": b'{"footprint": [], "a": 1}',
    "recipe.yaml": b"stages:\n- cost:\n    inflation_radius: [\n", "amcl.yaml": b"alpha1: 0.2\n",
    "b.json": b"{}", "launch.xml": b"<launch>\n</launch>\n",
    "long.json": b'{"a": [' + b"1, " * 9_000 + b"1]}",
    "cut.json": b'{"maps": [', "broken.yaml": b"stages: [\n", "mixed.csv": b"1,2\n3,x\n",
    "names.csv": b"x,y\n", "cut.gz": b"\x1f\x8b\x08hello", "other.npz": saved(np.savez, a=1, b=2),
}  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, (data, *_) in FILES.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_bytes(FILES["metadata.yaml"][0])
    write_map("map.yaml", grid_from_text("..#\n.?."))
    write_map("map.npz", grid_from_text("..#\n.?."))
    return tmp_path


def test_a_parameter_file_that_only_ros_1_reads_is_one(tmp_path):
    (tmp_path / "twice.yaml").write_text("robot_radius: 0.1\nrobot_radius: 0.2\n")
    assert kind_of(tmp_path / "twice.yaml").name == "ROS parameters"


# For bags and parameters info prints more, and images are refused as maps.
OTHER_KINDS = ("bag", "ROS parameters", "image", "Git LFS pointer")


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_what_it_is_by_its_bytes_whatever_its_name(command, tmp_path, name):
    data, kind, description, figures, use = FILES[name]
    path = tmp_path / name
    path.write_bytes(data)
    found = kind_of(path)
    assert (found.name, figures_of(path, found)) == (kind, figures)
    assert description in found.what
    assert use in found.use
    assert "{" not in found.use
    if kind not in OTHER_KINDS:
        code, out, err = command("info", path)
        first, kind_line, *of_figures, last = out.splitlines()
        assert (code, err, first, len(of_figures)) == (0, "", str(path), 1 if figures else 0)
        assert found.what in kind_line
        assert use in last
        assert all(str(value) in of_figures[0] for value in figures.values())
        report = json.loads(command("info", path, "--json")[1])
        assert (report["kind"], report["figures"]) == (kind, figures)
    moved = path.rename(tmp_path / "braces {path} of nothing")
    renamed = kind_of(moved)
    if name == "a.db3":  # SQLite is used by others, too: its name counts
        assert renamed.what == "an SQLite database"
    else:
        assert (renamed.name, renamed.what) == (kind, found.what)
        assert figures_of(moved, renamed) == figures


CHANGES = {
    "mark": ((".csv", ".txt", ".yaml", "s.log", "json"), lambda data: b"\xef\xbb\xbf" + data),
    "large number and many bytes": (
        "json", lambda data: data[:-1] + b', "more": 1e400}' + b" " * (5 << 20)),
    "long comment": ("s.yaml", lambda data: data + b"#" + b" " * 900_000),
}  # fmt: skip


@pytest.mark.parametrize(("change", "name"), [
    (change, name) for change, (endings, _) in CHANGES.items() for name in FILES
    if name.endswith(endings)
])  # fmt: skip
def test_marks_large_numbers_and_many_bytes_change_no_kind(tmp_path, change, name):
    data, kind, _, figures, _ = FILES[name]
    (tmp_path / name).write_bytes(CHANGES[change][1](data))
    found = kind_of(tmp_path / name)
    assert (found.name, figures_of(tmp_path / name, found)) == (kind, figures)


def test_figures_too_large_for_a_number_are_shown_as_they_are(tmp_path, command):
    (tmp_path / "reach.json").write_bytes(FILES["reach.json"][0].replace(b"8.5", b"-1e400"))
    code, out, _ = command("info", tmp_path / "reach.json", "--json")
    assert (code, json.loads(out)["figures"]["reachable_m2"]) == (0, "-1e400")


def test_info_describes_the_shapes_that_edit_draws(tmp_path, command):
    ring = [[1.5, -2.0], [2.0, -2.0], [2.0, -1.5], [1.5, -2.0]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    text = json.dumps({"type": "Feature", "properties": {"a": 0.0}, "geometry": shape})
    path = tmp_path / "s.geojson"
    path.write_text("\ufeff" + text.replace("0.0}", "1e400}") + " " * (5 << 20), encoding="utf-8")
    write_map(tmp_path / "map.yaml", grid_from_text("..#\n.?."))
    edit = ["edit", "polygon", tmp_path / "map.yaml", "--value", "100", "--file", path]
    assert command(*edit, "-o", tmp_path / "o.yaml")[0] == 0
    code, out, _ = command("info", path)
    assert (code, out.splitlines()[1]) == (0, "  kind        a file of shapes (GeoJSON)")


@pytest.mark.slow
@pytest.mark.parametrize("name", UNKNOWN)
def test_what_is_not_known_is_nothing(tmp_path, name, command):
    (tmp_path / name).write_bytes(UNKNOWN[name])
    assert kind_of(tmp_path / name) is None
    if name.endswith((".md", ".bin", ".txt", ".xml", "long.json")):
        for words in (["info"], ["esdf", "-o", tmp_path / "o.npz"]):
            code, _, err = command(*words, tmp_path / name)
            message, hint = err.splitlines()
            assert code == 3
            assert message.endswith(f"{name}: is not a kind of file that mapdeal knows")
            assert hint.startswith("hint: a map is a map_server .yaml")


DAMAGED = {
    "map.txt": (b"image: m.pgm\nresolution: fast\norigin: [1.0, -2.0, 0.3]\n",
                "resolution (line 2): must be a number, got 'fast'"),
    "c.pcd": (PCD.replace(b"SIZE 4 4 4 4", b"SIZE 4 4"), "SIZE: must have 4 entries"),
    # Python refuses to convert numbers of many thousand digits.
    "odd.bin": (b"version https://git-lfs.github.com/spec/v1\nsize " + b"9" * 5000 + b"\n",
                "is a Git LFS pointer"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_file_of_a_known_kind_is_refused_with_its_fault(command, tmp_path, name):
    data, message = DAMAGED[name]
    (tmp_path / name).write_bytes(data)
    code, out, err = command("info", tmp_path / name)
    assert (code, out) == (3, "")
    assert f"{name}: {message}" in err


def test_maps_and_folders_with_a_bag_and_of_a_batch(here):
    assert kind_of(here / "map.yaml").name == kind_of(here / "map.npz").name == "map"
    for name in ("summary.json", "a.db3"):
        (here / f"of {name}").mkdir()
        (here / name).rename(here / f"of {name}" / name)
    assert kind_of(here / "bag").what == "a folder with a ROS 2 bag"
    assert kind_of(here / "of summary.json").figures()["maps"] == 3
    assert kind_of(here / "of a.db3").what == "a folder with a ROS 2 bag, without its metadata"
    (here / "metadata.yaml").unlink()
    assert kind_of(here) is None


@pytest.mark.parametrize(("error", "message"), [
    (MalformedInputError("some rule", source="c.pcd"), r"is a point cloud \(PCD\), not a map"),
    (MalformedInputError("some rule", source="other.pgm"), "some rule"),
    (MalformedInputError("some rule"), "some rule"),
    (ParameterError("some rule", source="c.pcd"), "some rule"),
], ids=str)  # fmt: skip
def test_only_errors_about_the_file_itself_are_changed(here, error, message):
    with pytest.raises(type(error), match=message), recognised(Path("c.pcd"), "a map", "map"):
        raise error


WRONG = [
    ("inflate {} -o o.npz", "c.pcd", "is a point cloud (PCD), not a map"),
    ("run {} -o out", "c.pcd", "is a point cloud (PCD), not a map"),
    ("esdf {} -o o.npz", "a.bag", "is a ROS 1 bag, not a map"),
    ("query {} --at 1,1", "scans.npz", "is laser scans (npz), not a map"),
    ("diff map.yaml {}", "a.mcap", "is a bag (MCAP), not a map"),
    ("cost map.yaml -o o.npz --robot-radius 1 --mask {}", "r.yaml", "is a recipe, not a map"),
    ("build {} -o o.yaml", "map.yaml", "is a map, not a log of laser scans"),
    ("build {} -o o.yaml", "map.npz", "is an .npz written by mapdeal, not a log of laser scans"),
    ("build {} -o o.yaml", "c.ply", "is a point cloud (PLY), not a log of laser scans"),
    ("local --cloud {} --pose 0,0,0 -o out", "map.yaml", "is a map, not a point cloud"),
    ("local --cloud {} --pose 0,0,0 -o out", "scans.log",
     "is a log of laser scans (CARMEN), not a point cloud"),
    ("local --cloud c.txt --poses {} -o out", "c.pcd",
     "is a point cloud (PCD), not a file of poses"),
    ("edit line map.yaml --value 1 -o o.yaml --file {}", "r.yaml",
     "is a recipe, not a file of shapes"),
    ("info {}", "lfs.pgm", "looks like an image"),
    ("run {} -o out", "bag", "is a folder with a ROS 2 bag, not a folder of maps"),
    ("inflate {} -o o.npz", "bag", "is a folder with a ROS 2 bag, not a map"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "name", "rule"), WRONG)
def test_every_command_names_the_kind_of_a_wrong_file(command, here, words, name, rule):
    before = sorted(here.iterdir())
    code, out, err = command(*words.format(name).split())
    message, hint = err.splitlines()
    assert (code, out) == (3, "")
    assert message.startswith(f"error: {name}: {rule}")
    assert hint.startswith("hint: ")
    assert sorted(here.iterdir()) == before


def test_a_recipe_that_is_a_map_is_usage_and_lint_finds_what_files_and_folders_are(command, here):
    code, _, err = command("run", "map.yaml", "-o", "out", "--recipe", "map.yaml")
    assert (code, err.splitlines()[0]) == (2, "error: map.yaml: is a map, not a recipe")
    code, out, _ = command("lint", "c.pcd", "bag")
    assert code == 1
    assert "is a point cloud (PCD), not a map (mapdeal build --cloud c.pcd" in out
    assert "bag: error: run.no-manifest: is a folder with a ROS 2 bag, not a folder of maps" in out


def test_info_of_a_run_prints_a_table(command, here):
    assert command("run", "map.yaml", "-o", "out", "-q", "--no-images")[0] == 0
    code, out, _ = command("info", "out/map")
    assert code == 0
    assert "  inflate     radius 0.3, " in out
    assert "\n              3 x 2 cells, occupied " in out
    assert "\n              3 x 2 cells, lethal " in out
    assert "{" not in out
    assert "[" not in out


def test_commands_that_are_proposed_can_be_typed(command, tmp_path):
    path = tmp_path / "it's one $cloud; and more.pcd"
    path.write_bytes(PCD)
    use = json.loads(command("info", path, "--json")[1])["use"]
    assert shlex.split(use)[:4] == ["mapdeal", "build", "--cloud", str(path)]


STACKS = {"Nav2": "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2}}}",
          "ROS 1": "robot_radius: 0.2\nobstacle_layer: {enabled: true}"}  # fmt: skip


@pytest.mark.parametrize("stack", STACKS)
def test_info_names_the_stack_of_parameter_files(command, tmp_path, stack):
    (tmp_path / "p.yaml").write_text(STACKS[stack])
    code, out, _ = command("info", tmp_path / "p.yaml")
    assert (code, out.splitlines()[1]) == (0, f"  kind          robot parameters of {stack}")


@pytest.mark.parametrize(("name", "data"), [("m.stl", bytes(84)), ("m.OBJ", b"v 0 0 0\n")])
def test_meshes_without_first_bytes_of_their_own_are_known_by_their_names(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    kind = kind_of(tmp_path / name)
    assert (kind.name, name[-3:].upper() in kind.what) == ("world", True)
    (tmp_path / "m").write_bytes(data)
    assert kind_of(tmp_path / "m") is None
