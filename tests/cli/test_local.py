"""The command local: clouds, sequences, what it says and what it leaves."""

import json
import math
import os
import pty
import subprocess
import sys

import numpy as np
import pytest

from clouds import pcd, ply
from drawn import grid_from_text
from mapdeal import OccupancyGrid, esdf, inflate, local_map, read_map, ring_cost, write_map
from mapdeal.cli.terminal import few_warnings
from mapdeal.pipeline.local import sequence_of

NAMES = [
    *(f"{stem}.{end}" for stem in ("local", "inflated") for end in ("pgm", "yaml", "png")),
    *(f"{stem}.{end}" for stem in ("esdf", "cost") for end in ("npz", "pgm", "yaml", "png")),
    "manifest.json",
]
POSE = "-1.5,0.7,1.2"
OPTIONS = ["--size", "3,2", "--resolution", "0.1"]


@pytest.fixture
def points():
    rng = np.random.default_rng(8)
    return np.round(rng.uniform(-1.4, 1.4, (300, 3)), 3).astype("f4").astype(float)


@pytest.fixture
def cloud(tmp_path, monkeypatch, points):
    monkeypatch.chdir(tmp_path)
    fields = [("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1)]
    path = tmp_path / "scan.pcd"
    path.write_bytes(pcd(fields, [[[v] for v in p] for p in points.tolist()]))
    return path


def made_of(points, **options):
    pose = tuple(float(v) for v in POSE.split(","))
    return local_map(points, pose, size=(3, 2), resolution=0.1, **options)


def contents(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_local_writes_a_map_and_what_is_made_of_it(command, cloud, points):
    code, out, err = command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "-o", "o",
                             "--min-range", "0.5")  # fmt: skip
    assert (code, err) == (0, "")
    assert sorted(contents(cloud.parent / "o")) == sorted(NAMES)
    local = made_of(points, min_range=0.5)
    inflated = inflate(local, radius=0.3)
    found = read_map("o/local.yaml")
    assert np.array_equal(found.occupancy, local.occupancy)
    assert found.origin == local.origin == (-3.0, -0.3, 0.0)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    assert np.array_equal(read_map("o/esdf.npz").distance, esdf(inflated).distance)
    rings = ring_cost(inflated, values=(90, 70, 50))
    assert np.array_equal(read_map("o/cost.npz").cost, rings.cost)
    assert "points in the window" in out
    assert "robot's back at -1.942" in out


def test_the_manifest_tells_what_became_of_the_points(command, cloud, points):
    command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "-o", "o", "--max-height", "1",
            "--no-images")  # fmt: skip
    manifest = json.loads((cloud.parent / "o" / "manifest.json").read_text())
    figures = manifest["figures"]["local"]
    assert figures["points"] == 300
    assert figures["beyond_height"] == int((points[:, 2] > 1).sum())
    assert figures["pose"] == [-1.5, 0.7, 1.2]
    assert figures["rear_heading"] == pytest.approx(1.2 - math.pi)
    angles = np.sort(np.arctan2(points[:, 1], points[:, 0])[points[:, 2] <= 1])
    gap = max(np.diff(angles).max(), angles[0] + 2 * math.pi - angles[-1])
    assert figures["angle_max"] - figures["angle_min"] == pytest.approx(2 * math.pi - gap)
    assert list(manifest["inputs"]) == ["scan.pcd"]
    assert manifest["stages"][0]["local"]["max_height"] == 1.0
    assert not list((cloud.parent / "o").glob("*.png"))
    assert str(cloud.parent) not in json.dumps(manifest)


def test_the_stage_commands_give_the_same_bytes(command, cloud):
    command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "-o", "o")
    command("inflate", "o/local.yaml", "-o", "inflated.yaml", "--radius", "0.3")
    command("esdf", "inflated.yaml", "-o", "esdf.npz")
    command("cost", "esdf.npz", "-o", "cost.npz", "--model", "rings")
    for name in ("inflated.pgm", "inflated.yaml", "esdf.npz", "cost.npz"):
        assert (cloud.parent / name).read_bytes() == (cloud.parent / "o" / name).read_bytes()


def test_both_frames_of_one_cloud_give_one_map(command, cloud, points):
    x, y, yaw = (float(v) for v in POSE.split(","))
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    placed = points[:, :2] @ turn.T + (x, y) + (0.5, -2.0)
    fields = [("y", "f8"), ("x", "f8")]
    data = ply(fields, placed[:, ::-1].tolist(), "binary_big_endian")
    (cloud.parent / "m.ply").write_bytes(data)
    command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "-o", "a")
    code, _, _ = command("local", "--cloud", "m.ply", "--pose", POSE, "--frame", "map",
                           "--offset", "0.5,-2", *OPTIONS, "-o", "b")  # fmt: skip
    assert code == 0
    first, second = (read_map(f"{folder}/local.yaml") for folder in "ab")
    # rounding may move a point that lies on a border
    assert np.count_nonzero(first.occupancy != second.occupancy) <= 4


def test_a_global_map_is_joined(command, cloud, points):
    known = grid_from_text("#..#\n....\n.#..", 0.1, (-2.0, 0.5, 0.0))
    write_map("known.yaml", known)
    code, out, _ = command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "--map",
                           "known.yaml", "-o", "o")  # fmt: skip
    assert code == 0
    assert "3 cells from the map" in out
    local = read_map("o/local.yaml")
    assert np.array_equal(local.occupancy, made_of(points, global_map=known).occupancy)
    cells = local.frame.unbounded_rowcol_from_xy(known.frame.xy_from_rowcol([[0, 1], [2, 0]]))
    assert local.occupied()[tuple(cells.T)].all()
    manifest = json.loads((cloud.parent / "o" / "manifest.json").read_text())
    assert set(manifest["inputs"]) == {"scan.pcd", "known.yaml", "known.pgm"}


def test_a_global_map_elsewhere_is_warned_of(command, cloud):
    write_map("known.yaml", grid_from_text("#..#\n....", 0.1, (8.0, 0.5, 0.3)))
    code, out, err = command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "--map",
                             "known.yaml", "-o", "o", "--min-range", "0.5")  # fmt: skip
    told = "the map does not reach into the window around -1.5, 0.7"
    assert (code, err) == (0, f"warning: known.yaml: {told}\n")
    assert "0 cells from the map" in out


@pytest.mark.parametrize("size", ["6,6", "0.04,0.04"])
def test_a_window_of_one_cell_need_not_hold_the_robot(command, cloud, size):
    code, _, _ = command("local", "--cloud", cloud, "--pose", "0,0,0", "--size", size, "-o", "o",
                         "--resolution", size.split(",")[0], "--no-images")  # fmt: skip
    assert code == 0


def test_lower_values_of_the_map_count_where_the_recipe_says_so(command, cloud, points):
    known = grid_from_text("#...", 0.1, (-2.0, 0.5, 0.0)).with_values(np.array([[80, 0, 0, 0]]))
    write_map("known.npz", known)
    words = ["--map", "known.npz", "-o", "o", "--set", "inflate.lethal_threshold=70"]
    code, out, _ = command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, *words)
    assert code == 0
    assert "1 cells from the map" in out


def test_parameters_and_the_robot_s_shape_reach_the_stages(command, cloud, points):
    code, _, _ = command("local", "--cloud", cloud, "--pose", POSE, *OPTIONS, "-o", "o",
                         "--robot-radius", "0.12", "--set", "cost.values=80,40")  # fmt: skip
    assert code == 0
    inflated = inflate(made_of(points), radius=0.12)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    rings = ring_cost(inflated, values=(80, 40))
    assert np.array_equal(read_map("o/cost.npz").cost, rings.cost)


def test_the_robot_s_own_points_are_warned_of(command, cloud):
    (cloud.parent / "own.xyz").write_text("0 0 0\n1 0 0\n")
    small = ["--size", "3,3", "--no-images"]
    _, _, err = command("local", "--cloud", "own.xyz", "--pose", "0,0,0", "-o", "a", *small)
    assert err.startswith("warning: own.xyz: the robot's own cell is an obstacle once inflated")
    assert len(err.splitlines()) == 1
    _, _, err = command("local", "--cloud", "own.xyz", "--pose", "0,0,0", "-o", "b", *small,
                        "--min-range", "0.1")  # fmt: skip
    assert err == ""


@pytest.fixture
def sequence(cloud, points):
    """Twelve clouds whose names sort by number, and their poses; the third has no points."""
    folder = cloud.parent / "scans"
    folder.mkdir()
    lines = []
    for k in range(12):
        rows = [] if k == 2 else points[10 * k : 10 * k + 10]
        np.savetxt(folder / f"{k}.csv", rows, delimiter=",")
        lines.append(f"{k * 0.1:.1f} 0 0.{k}")
    (cloud.parent / "poses.txt").write_text("\n".join(lines))
    return folder


def test_a_sequence_gets_numbered_folders_in_order(command, sequence, points):
    code, out, err = command("local", "--cloud", sequence, "--poses", "poses.txt", *OPTIONS,
                             "-o", "o", "--no-images")  # fmt: skip
    assert code == 0
    assert err.startswith("warning: ")
    assert "2.csv: no point marks a cell: it holds no points" in err
    assert out.startswith("o: 12 done, 0 unchanged, 0 failed, ")
    folders = sorted(p.name for p in sequence.parent.joinpath("o").iterdir() if p.is_dir())
    assert folders == [f"{k:04}" for k in range(12)]
    summary = json.loads(sequence.parent.joinpath("o", "summary.json").read_text())["maps"]
    assert [(e["cloud"], e["folder"]) for e in summary][9:] == [
        ("9.csv", "0009"), ("10.csv", "0010"), ("11.csv", "0011")
    ]  # fmt: skip
    no_point, uniform = summary[2]["warnings"]
    assert "no point marks a cell" in no_point
    assert uniform.endswith("100 % of the open cells cost 0: there is no obstacle")
    for k in (0, 11):
        expected = local_map(points[10 * k : 10 * k + 10], (k * 0.1, 0, float(f"0.{k}")),
                             size=(3, 2), resolution=0.1)  # fmt: skip
        found = read_map(f"o/{k:04}/local.yaml")
        assert np.array_equal(found.occupancy, expected.occupancy)
        assert found.origin == expected.origin


def test_the_poses_are_no_cloud_even_if_the_folder_says_so(command, sequence):
    (sequence / "poses.csv").write_text((sequence.parent / "poses.txt").read_text())
    code, out, _ = command("local", "--cloud", sequence, "--poses", sequence / "poses.csv",
                           *OPTIONS, "-o", "o", "--no-images")  # fmt: skip
    assert (code, out[:10]) == (0, "o: 12 done")


def test_a_sequence_goes_on_where_it_stopped(command, sequence):
    words = ["local", "--cloud", "scans/*.csv", "--poses", "poses.txt", *OPTIONS, "-o", "o",
             "--no-images", "-q"]  # fmt: skip
    assert command(*words)[0] == 0
    sequence.joinpath("5.csv").write_text("0.5,0.5,0\n")
    (sequence.parent / "o" / "0007" / "cost.npz").write_bytes(b"changed")
    code, _, err = command(*words)
    assert code == 5  # what has changed is not overwritten
    problems = [line.split("/")[1] for line in err.splitlines() if line.startswith("error: o/")]
    assert problems == ["0005", "0007"]
    code, out, _ = command(*words[:-1], "--force")
    assert (code, out[:30]) == (0, "o: 12 done, 0 unchanged, 0 fai")
    code, out, _ = command(*words[:-1])
    assert (code, out[:30]) == (0, "o: 0 done, 12 unchanged, 0 fai")


def test_a_bad_cloud_does_not_stop_the_others(command, sequence):
    sequence.joinpath("4.csv").write_text("a b\n")
    code, out, err = command("local", "--cloud", sequence, "--poses", "poses.txt", *OPTIONS,
                             "-o", "o", "--no-images")  # fmt: skip
    assert code == 5
    assert "error: scans/4.csv: line 1" in err.replace(str(sequence.parent) + "/", "")
    assert "11 done, 0 unchanged, 1 failed" in out
    assert not sequence.parent.joinpath("o", "0004").exists()
    summary = json.loads(sequence.parent.joinpath("o", "summary.json").read_text())["maps"]
    assert (summary[4]["status"], summary[4]["exit_code"]) == ("failed", 3)


def test_a_longer_sequence_before_is_warned_of(command, sequence):
    words = ["local", "--poses", "poses.txt", *OPTIONS, "-o", "o", "--no-images", "--force"]
    assert command(*words, "--cloud", sequence)[0] == 0
    (sequence.parent / "poses.txt").write_text("0 0 0\n")
    _, _, err = command(*words, "--cloud", "scans/3.csv")
    assert err.splitlines()[-1] == (
        "warning: 11 folders are not of this sequence, such as o/0001"
    )  # fmt: skip


def test_many_warnings_of_a_sequence_are_counted(command, sequence):
    for path in sequence.iterdir():
        path.write_text("0,0\n")
    _, _, err = command("local", "--cloud", sequence, "--poses", "poses.txt", *OPTIONS, "-o", "o",
                        "--no-images")  # fmt: skip
    lines = err.splitlines()
    assert len(lines) == 11
    assert lines[-1] == "warning: 2 more warnings; o/summary.json has them all"


def test_one_warning_more_is_one(capsys):
    with few_warnings("o/summary.json has them all") as warn:
        for number in range(11):
            warn(f"{number}")
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "warning: 1 more warning; o/summary.json has them all"


def test_one_cloud_may_be_a_sequence(command, cloud):
    (cloud.parent / "poses.txt").write_text("0,0,0\n")
    assert (
        command("local", "--cloud", cloud, "--poses", "poses.txt", "-o", "o", "--no-images")[0] == 0
    )
    assert (cloud.parent / "o" / "0000" / "manifest.json").exists()


def test_bytes_do_not_depend_on_threads_or_engine(cloud):
    """Also not on the working directory, nor on how the cloud is named."""
    known = OccupancyGrid((np.indices((40, 50)).sum(axis=0) % 7 == 0) * 100, 0.07, (-3, -1, 0.4))
    write_map("known.npz", known)
    found = []
    for threads, engine, where in ((1, "scipy", "."), (2, "", ".."), (1, "", ".")):
        out = cloud.parent / f"o{len(found)}"
        subprocess.run(
            [sys.executable, "-m", "mapdeal", "local", "--cloud", cloud, "--pose", POSE, *OPTIONS,
             "--map", cloud.parent / "known.npz", "-o", out, "--threads", str(threads)],
            cwd=cloud.parent / where, env={**os.environ, "MAPDEAL_KERNELS": engine}, check=True,
            capture_output=True,
        )  # fmt: skip
        found.append(contents(out))
    assert found[0] == found[1] == found[2]


def test_a_bar_is_shown_on_a_terminal_alone(sequence):
    words = [sys.executable, "-m", "mapdeal", "local", "--cloud", str(sequence), "--poses",
             "poses.txt", *OPTIONS, "--no-images", "-o"]  # fmt: skip
    master, slave = pty.openpty()
    subprocess.run([*words, "a"], stderr=slave, stdout=subprocess.DEVNULL, check=True)
    os.close(slave)
    shown = b""
    while True:
        try:
            shown += os.read(master, 65536)
        except OSError:
            break
    os.close(master)
    assert b"12/12" in shown
    assert b"\x1b[Kwarning: " in shown
    done = subprocess.run([*words, "b"], capture_output=True, check=True)
    assert b"12/12" not in done.stderr
    assert all(line.startswith(b"warning: ") for line in done.stderr.splitlines())


def test_real_clouds_give_local_maps(command, real_maps, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = real_maps / "koide3__fast_gicp" / "251370668.pcd"
    second = real_maps / "koide3__small_gicp" / "target.ply"
    for cloud, out in ((first, "a"), (second, "b")):
        code, _, _ = command("local", "--cloud", cloud, "--pose", "2,-1,0.4", "--min-height",
                             "-1.5", "--max-height", "0.5", "-o", out, "--no-images")  # fmt: skip
        assert code == 0
    a, b = (contents(tmp_path / name) for name in "ab")
    for name in (n for n in NAMES if not n.endswith((".png", ".json"))):
        assert a[name] == b[name], name
    middles = {"car6": "-37,-65", "curve2d": "0,0", "lamppost": "-10,0", "office1_keypoints": "0,0"}
    for name, middle in middles.items():
        cloud = real_maps / "PointCloudLibrary__pcl" / f"{name}.pcd"
        code, _, _ = command("local", "--cloud", cloud, "--pose", f"{middle},1", "--frame", "map",
                               "--size", "24,24", "-o", name, "--no-images")  # fmt: skip
        assert code == 0
        assert read_map(f"{name}/local.yaml").occupied().sum() > 20


@pytest.mark.parametrize(("clouds", "digits"), [(10, 1), (11, 2), (100, 2), (101, 3)])
def test_folders_have_as_many_digits_as_the_last_number(tmp_path, monkeypatch, clouds, digits):
    monkeypatch.setattr("mapdeal.pipeline.local._DIGITS", 1)
    names = []
    for k in range(clouds):
        (tmp_path / f"{k}.csv").write_text("1,1\n")
        names.append(str(tmp_path / f"{k}.csv"))
    (tmp_path / "poses.txt").write_text("0 0 0\n" * clouds)
    jobs = sequence_of(names, tmp_path / "poses.txt", tmp_path / "o")
    assert [job.folder.name for job in jobs] == [f"{k:0{digits}}" for k in range(clouds)]
    assert [job.cloud.path.stem for job in jobs] == [str(k) for k in range(clouds)]
