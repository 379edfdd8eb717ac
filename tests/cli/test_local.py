"""The command local: clouds, sequences, what it says and what it leaves."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bad_maps import tree
from clouds import pcd
from drawn import grid_from_text
from mapdeal import esdf, inflate, local_map, read_map, ring_cost, write_map

NAMES = [
    *(f"{stem}.{end}" for stem in ("local", "inflated") for end in ("pgm", "yaml", "png")),
    *(f"{stem}.{end}" for stem in ("esdf", "cost") for end in ("npz", "pgm", "yaml", "png")),
    "manifest.json",
]
POSE = (-1.5, 0.7, 1.2)
LOCAL = "local --cloud scan.pcd --pose -1.5,0.7,1.2 --size 3,2 --resolution 0.1"


@pytest.fixture
def points(here):
    """Points of a cloud that lies in scan.pcd."""
    found = np.random.default_rng(8).uniform(-1.4, 1.4, (300, 3)).round(3).astype("f4")
    found = found.astype(float)
    fields = [("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1)]
    Path("scan.pcd").write_bytes(pcd(fields, [[[v] for v in p] for p in found.tolist()]))
    return found


def made_of(points, pose=POSE, **options):
    return local_map(points, pose, size=(3, 2), resolution=0.1, **options)


def manifest_of(folder="o"):
    return json.loads(Path(folder, "manifest.json").read_text())


def same_map(folder, expected):
    found = read_map(f"{folder}/local.yaml")
    assert np.array_equal(found.occupancy, expected.occupancy)
    assert found.origin == expected.origin


def test_local_writes_a_map_and_what_is_made_of_it(sh, points):
    out = sh.ok(f"{LOCAL} -o o --min-range 0.5")
    assert sorted(tree(Path("o"))) == sorted(NAMES)
    local = made_of(points, min_range=0.5)
    inflated = inflate(local, radius=0.3)
    same_map("o", local)
    assert local.origin == (-3.0, -0.3, 0.0)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    assert np.array_equal(read_map("o/esdf.npz").distance, esdf(inflated).distance)
    rings = ring_cost(inflated, values=(90, 70, 50))
    assert np.array_equal(read_map("o/cost.npz").cost, rings.cost)
    assert "points in the window" in out
    assert "robot's back at -1.942" in out


def test_the_manifest_tells_what_became_of_the_points(sh, here, points):
    sh(f"{LOCAL} -o o --max-height 1 --no-images")
    manifest = manifest_of()
    figures = manifest["figures"]["local"]
    assert (figures["points"], figures["pose"]) == (300, list(POSE))
    assert figures["beyond_height"] == int((points[:, 2] > 1).sum())
    assert figures["rear_heading"] == pytest.approx(1.2 - math.pi)
    angles = np.sort(np.arctan2(points[:, 1], points[:, 0])[points[:, 2] <= 1])
    gap = max(np.diff(angles).max(), angles[0] + 2 * math.pi - angles[-1])
    assert figures["angle_max"] - figures["angle_min"] == pytest.approx(2 * math.pi - gap)
    assert list(manifest["inputs"]) == ["scan.pcd"]
    assert manifest["stages"][0]["local"]["max_height"] == 1.0
    assert not list(Path("o").glob("*.png"))
    assert str(here) not in json.dumps(manifest)


def test_a_global_map_is_joined(sh, points):
    known = grid_from_text("#..#\n....\n.#..", 0.1, (-2.0, 0.5, 0.0))
    write_map("known.yaml", known)
    assert "3 cells from the map" in sh(f"{LOCAL} --map known.yaml -o o")[1]
    same_map("o", made_of(points, global_map=known))
    assert set(manifest_of()["inputs"]) == {"scan.pcd", "known.yaml", "known.pgm"}
    write_map("grey.npz", known.with_values(np.array([[80, 0, 0, 0]] * 3)))
    line = f"{LOCAL} --map grey.npz -o p --set inflate.lethal_threshold="
    assert "0 cells from the map" in sh(f"{line}100")[1]
    assert "3 cells from the map" in sh(f"{line}70 --force")[1]


def test_a_global_map_elsewhere_is_warned_of(sh, points):
    write_map("known.yaml", grid_from_text("#..#\n....", 0.1, (8.0, 0.5, 0.3)))
    code, out, err = sh(f"{LOCAL} --map known.yaml -o o --min-range 0.5")
    told = "the map does not reach into the window around -1.5, 0.7"
    assert (code, err) == (0, f"warning: known.yaml: {told}\n")
    assert "0 cells from the map" in out


@pytest.mark.parametrize("size", ["6", "0.04"])
def test_a_window_of_one_cell_need_not_hold_the_robot(sh, points, size):
    line = f"--pose 0,0,0 --size {size},{size} -o o --resolution {size} --no-images"
    assert sh(f"local --cloud scan.pcd {line}")[0] == 0


def test_parameters_and_the_robot_s_shape_reach_the_stages(sh, points):
    assert sh(f"{LOCAL} -o o --robot-radius 0.12 --set cost.values=80,40")[0] == 0
    inflated = inflate(made_of(points), radius=0.12)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    rings = ring_cost(inflated, values=(80, 40))
    assert np.array_equal(read_map("o/cost.npz").cost, rings.cost)


def test_the_robot_s_own_points_are_warned_of(sh):
    Path("own.xyz").write_text("0 0 0\n1 0 0\n")
    line = "local --cloud own.xyz --pose 0,0,0 --size 3,3 --no-images -o"
    err = sh.err(f"{line} a")
    assert err.startswith("warning: own.xyz: the robot's own cell is an obstacle once inflated")
    assert len(err.splitlines()) == 1
    sh.ok(f"{line} b --min-range 0.1")


SEQUENCE = "local --poses poses.txt --size 3,2 --resolution 0.1 --no-images -o o --cloud"


@pytest.fixture
def sequence(points):
    """Twelve clouds whose names sort by number, and their poses; the third has no points."""
    Path("scans").mkdir()
    for k in range(12):
        rows = [] if k == 2 else points[10 * k : 10 * k + 10]
        np.savetxt(f"scans/{k}.csv", rows, delimiter=",")
    Path("poses.txt").write_text("\n".join(f"{k * 0.1:.1f} 0 0.{k}" for k in range(12)))


def summary():
    return json.loads(Path("o/summary.json").read_text())["maps"]


def test_a_sequence_gets_numbered_folders_in_order(sh, points, sequence):
    code, out, err = sh(f"{SEQUENCE} scans")
    assert code == 0
    assert err.startswith("warning: ")
    assert "2.csv: no point marks a cell: it holds no points" in err
    assert out.startswith("o: 12 done, 0 unchanged, 0 failed, ")
    folders = sorted(p.name for p in Path("o").iterdir() if p.is_dir())
    assert folders == [f"{k:04}" for k in range(12)]
    last = [(entry["cloud"], entry["folder"]) for entry in summary()][9:]
    assert last == [("9.csv", "0009"), ("10.csv", "0010"), ("11.csv", "0011")]
    no_point, uniform = summary()[2]["warnings"]
    assert "no point marks a cell" in no_point
    assert uniform.endswith("100 % of the open cells cost 0: there is no obstacle")
    for k in (0, 11):
        pose = (k * 0.1, 0, float(f"0.{k}"))
        same_map(f"o/{k:04}", made_of(points[10 * k : 10 * k + 10], pose))


def test_a_sequence_goes_on_where_it_stopped(sh, sequence):
    line = f"{SEQUENCE} 'scans/*.csv'"
    assert sh(line)[0] == 0
    Path("scans/5.csv").write_text("0.5,0.5,0\n")
    Path("o/0007/cost.npz").write_bytes(b"changed")
    err = sh.err(line, 5)  # what has changed is not overwritten
    problems = [text.split("/")[1] for text in err.splitlines() if text.startswith("error: o/")]
    assert problems == ["0005", "0007"]
    Path("poses.txt").rename("scans/poses.csv")  # which is no cloud even if the folder says so
    line = SEQUENCE.replace("poses.txt", "scans/poses.csv")
    assert sh(f"{line} scans --force")[1].startswith("o: 12 done, 0 unchanged, 0 failed")
    assert sh(f"{line} scans")[1].startswith("o: 0 done, 12 unchanged, 0 failed")


def test_a_bad_cloud_does_not_stop_the_others_and_a_longer_sequence_is_warned_of(sh, sequence):
    Path("scans/4.csv").write_text("a b\n")
    code, out, err = sh(f"{SEQUENCE} scans")
    assert (code, "error: scans/4.csv: line 1" in err) == (5, True)
    assert "11 done, 0 unchanged, 1 failed" in out
    assert not Path("o/0004").exists()
    assert (summary()[4]["status"], summary()[4]["exit_code"]) == ("failed", 3)
    Path("poses.txt").write_text("0 0 0\n")
    told = sh.err(f"{SEQUENCE} scans/3.csv --force").splitlines()[-1]
    assert told == "warning: 10 folders are not of this sequence, such as o/0001"


def test_many_warnings_of_a_sequence_are_counted(sh, sequence):
    for path in Path("scans").iterdir():
        path.write_text("0,0\n")
    lines = sh.err(f"{SEQUENCE} scans").splitlines()
    assert len(lines) == 11
    assert lines[-1] == "warning: 2 more warnings; o/summary.json has them all"


def test_a_bar_is_shown_on_a_terminal_alone(sh, sequence, shown_on_terminal):
    shown = shown_on_terminal(f"{SEQUENCE} scans")
    assert b"12/12" in shown
    assert b"\x1b[K\x1b[33mwarning:" in shown
    err = sh.err(f"{SEQUENCE} scans --force")
    assert all(line.startswith("warning: ") for line in err.splitlines())


def test_real_clouds_give_local_maps(sh, here, real_maps):
    first = real_maps / "koide3__fast_gicp" / "251370668.pcd"
    second = real_maps / "koide3__small_gicp" / "target.ply"
    heights = "--pose 2,-1,0.4 --min-height -1.5 --max-height 0.5 --no-images"
    for cloud, out in ((first, "a"), (second, "b")):
        assert sh(f"local --cloud {cloud} {heights} -o {out}")[0] == 0
    a, b = (tree(here / name) for name in "ab")
    for name in (n for n in NAMES if not n.endswith((".png", ".json"))):
        assert a[name] == b[name], name
    middles = {"car6": "-37,-65", "curve2d": "0,0", "lamppost": "-10,0", "office1_keypoints": "0,0"}
    for name, middle in middles.items():
        cloud = real_maps / "PointCloudLibrary__pcl" / f"{name}.pcd"
        line = f"local --cloud {cloud} --pose {middle},1 --frame map --size 24,24 --no-images"
        assert sh(f"{line} -o {name}")[0] == 0
        assert read_map(f"{name}/local.yaml").occupied().sum() > 20
