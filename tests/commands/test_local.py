import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from bad_maps import tree
from clouds import pcd, ply
from drawn import grid_from_text
from mapdeal import LocalOptions, esdf, inflate, local_map, read_map, ring_cost, write_map
from mapdeal.pipeline.local import sequence_of

NAMES = [
    *(f"{stem}.{end}" for stem in ("local", "inflated") for end in ("pgm", "yaml", "png")),
    *(f"{stem}.{end}" for stem in ("esdf", "cost") for end in ("npz", "pgm", "yaml", "png")),
    "manifest.json",
]
POSE = (-1.5, 0.7, 1.2)
LOCAL = "local --cloud scan.pcd --pose -1.5,0.7,1.2 --size 3,2 --resolution 0.1"


@pytest.fixture
def points(here):
    found = np.random.default_rng(8).uniform(-1.4, 1.4, (300, 3)).round(3).astype("f4")
    found = found.astype(float)
    fields = [("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1)]
    Path("scan.pcd").write_bytes(pcd(fields, [[[v] for v in p] for p in found.tolist()]))
    return found


def expected_map(points, pose=POSE, **options):
    return local_map(points, pose, size=(3, 2), resolution=0.1, **options)


def manifest_of(folder="o", name="manifest"):
    return json.loads(Path(folder, f"{name}.json").read_text())


def assert_same_map(folder, expected):
    found = read_map(f"{folder}/local.yaml")
    assert np.array_equal(found.occupancy, expected.occupancy)
    assert found.origin == expected.origin


def test_local_writes_a_map_and_the_results_of_its_stages(sh, points):
    out = sh.ok(f"{LOCAL} -o o --min-range 0.5")
    assert sorted(tree(Path("o"))) == sorted(NAMES)
    local = expected_map(points, min_range=0.5)
    inflated = inflate(local, radius=0.3)
    assert_same_map("o", local)
    assert local.origin == (-3.0, -0.3, 0.0)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    assert np.array_equal(read_map("o/esdf.npz").distance, esdf(inflated).distance)
    rings = ring_cost(inflated, values=(90, 70, 50))
    assert np.array_equal(read_map("o/cost.npz").cost, rings.cost)
    assert "points in the window" in out
    assert "robot's back at -1.942" in out


def test_the_manifest_counts_used_and_dropped_points(sh, here, points):
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


def test_both_frames_of_one_cloud_give_one_map(sh, points):
    x, y, yaw = POSE
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    placed = points[:, :2] @ turn.T + (x, y) + (0.5, -2.0)
    fields = [("y", "f8"), ("x", "f8")]
    Path("m.ply").write_bytes(ply(fields, placed[:, ::-1].tolist(), "binary_big_endian"))
    assert sh(f"{LOCAL.replace('scan.pcd', 'm.ply')} --frame map --offset 0.5,-2 -o b")[0] == 0
    # rounding may move a point that lies on a border
    moved = read_map("b/local.yaml").occupancy != expected_map(points).occupancy
    assert np.count_nonzero(moved) <= 4


def test_a_global_map_is_joined(sh, points):
    known = grid_from_text("#..#\n....\n.#..", 0.1, (-2.0, 0.5, 0.0))
    write_map("known.yaml", known)
    assert "3 cells from the map" in sh(f"{LOCAL} --map known.yaml -o o")[1]
    assert_same_map("o", expected_map(points, global_map=known))
    assert set(manifest_of()["inputs"]) == {"scan.pcd", "known.yaml", "known.pgm"}
    write_map("grey.npz", known.with_values(np.array([[80, 0, 0, 0]] * 3)))
    line = f"{LOCAL} --map grey.npz -o p --set inflate.lethal_threshold="
    assert "0 cells from the map" in sh(f"{line}100")[1]
    assert "3 cells from the map" in sh(f"{line}70 --force")[1]


def test_a_global_map_outside_the_window_gives_a_warning(sh, points):
    write_map("known.yaml", grid_from_text("#..#\n....", 0.1, (8.0, 0.5, 0.3)))
    code, out, err = sh(f"{LOCAL} --map known.yaml -o o --min-range 0.5")
    message = "the map does not reach into the window around -1.5, 0.7"
    assert (code, err) == (0, f"warning: known.yaml: {message}\n")
    assert "0 cells from the map" in out


def test_parameters_and_the_robot_s_shape_reach_the_stages(sh, points):
    assert sh(f"{LOCAL} -o o --robot-radius 0.12 --set cost.values=80,40")[0] == 0
    inflated = inflate(expected_map(points), radius=0.12)
    assert np.array_equal(read_map("o/inflated.yaml").occupancy, inflated.occupancy)
    assert np.array_equal(read_map("o/cost.npz").cost, ring_cost(inflated, values=(80, 40)).cost)


def test_points_on_the_robot_itself_give_a_warning(sh):
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
        np.savetxt(f"scans/{k}.csv", [] if k == 2 else points[10 * k : 10 * k + 10], delimiter=",")
    Path("poses.txt").write_text("\n".join(f"{k * 0.1:.1f} 0 0.{k}" for k in range(12)))


def test_a_sequence_gets_numbered_folders_in_order(sh, points, sequence):
    code, out, err = sh(f"{SEQUENCE} scans")
    assert code == 0
    assert err.startswith("warning: ")
    assert "2.csv: no point marks a cell: it holds no points" in err
    assert out.startswith("o: 12 done, 0 unchanged, 0 failed, ")
    folders = sorted(p.name for p in Path("o").iterdir() if p.is_dir())
    assert folders == [f"{k:04}" for k in range(12)]
    entries = manifest_of(name="summary")["maps"]
    assert [(entry["cloud"], entry["folder"]) for entry in entries[9:]] == [
        ("9.csv", "0009"), ("10.csv", "0010"), ("11.csv", "0011"),
    ]  # fmt: skip
    no_point, uniform = entries[2]["warnings"]
    assert "no point marks a cell" in no_point
    assert uniform.endswith("100 % of the open cells cost 0: there is no obstacle")
    for k in (0, 11):
        pose = (k * 0.1, 0, float(f"0.{k}"))
        assert_same_map(f"o/{k:04}", expected_map(points[10 * k : 10 * k + 10], pose))


def test_a_sequence_continues_where_it_stopped(sh, sequence):
    line = f"{SEQUENCE} 'scans/*.csv'"
    assert sh(line)[0] == 0
    Path("scans/5.csv").write_text("0.5,0.5,0\n")
    Path("o/0007/cost.npz").write_bytes(b"changed")
    err = sh.err(line, 5)  # changed outputs are not overwritten
    problems = [text.split("/")[1] for text in err.splitlines() if text.startswith("error: o/0")]
    assert problems == ["0005", "0007"]
    Path("poses.txt").rename("scans/poses.csv")  # poses in the folder of clouds are not a cloud
    line = SEQUENCE.replace("poses.txt", "scans/poses.csv")
    assert sh(f"{line} scans --force")[1].startswith("o: 12 done, 0 unchanged, 0 failed")
    assert sh(f"{line} scans")[1].startswith("o: 0 done, 12 unchanged, 0 failed")


def test_a_bad_cloud_stops_no_other_and_folders_of_longer_sequences_are_named(sh, sequence):
    Path("scans/4.csv").write_text("a b\n")
    code, out, err = sh(f"{SEQUENCE} scans")
    assert (code, "error: scans/4.csv: line 1" in err) == (5, True)
    assert "11 done, 0 unchanged, 1 failed" in out
    assert not Path("o/0004").exists()
    failed = manifest_of(name="summary")["maps"][4]
    assert (failed["status"], failed["exit_code"]) == ("failed", 3)
    Path("poses.txt").write_text("0 0 0\n")
    warning = sh.err(f"{SEQUENCE} scans/3.csv --force").splitlines()[-1]
    assert warning == "warning: 10 folders are not of this sequence, such as o/0001"


def test_many_warnings_of_a_sequence_are_counted(sh, sequence):
    for path in Path("scans").iterdir():
        path.write_text("0,0\n")
    lines = sh.err(f"{SEQUENCE} scans").splitlines()
    assert len(lines) == 11
    assert lines[-1] == "warning: 2 more warnings; o/summary.json has them all"


def test_folders_have_as_many_digits_as_the_last_number(here, monkeypatch):
    monkeypatch.setattr("mapdeal.pipeline.local._DIGITS", 1)
    names = [f"{k}.csv" for k in range(11)]
    for name in names:
        Path(name).write_text("1,1\n")
    for clouds, digits in ((10, 1), (11, 2)):
        Path("poses.txt").write_text("0 0 0\n" * clouds)
        jobs = sequence_of(names[:clouds], here / "poses.txt", here / "o")
        assert [job.folder.name for job in jobs] == [f"{k:0{digits}}" for k in range(clouds)]


def test_a_progress_bar_is_shown_only_on_a_terminal(sh, sequence, shown_on_terminal):
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


ROLLING = "local --cloud scans --poses poses.txt --size 3,2 --resolution 0.1 --no-images -o o"


@pytest.fixture
def known(here):
    """A map whose corner is not a multiple of its cells, and a cloud."""
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("known.yaml", mapdeal.OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.0)))
    np.savetxt("c.csv", [[0.62, 0.04], [-0.41, 0.33]], delimiter=",")
    return read_map("known.yaml")


def test_without_a_cloud_the_local_map_is_a_window_of_the_map(sh, known):
    out = sh.ok("local --map known.yaml --pose 0.52,0.31,1.2 -o o --size 3,2 --no-images")
    assert out.startswith("known.yaml -> o: ")
    window = read_map("o/local.yaml")
    assert (window.resolution, window.shape) == (0.1, (20, 30))  # the map's, not 0.05
    (first,) = known.frame.unbounded_rowcol_from_xy(window.frame.xy_from_rowcol([[0, 0]]))
    assert first.tolist() == [3, 10]
    assert np.array_equal(window.occupancy, known.occupancy[3:23, 10:40])
    manifest = manifest_of("o")
    assert set(manifest["inputs"]) == {"known.yaml", "known.pgm"}
    figures = manifest["figures"]["local"]
    assert (figures["from_map"], "points" in figures) == (figures["occupied"], False)


def test_unknown_keep_without_map_or_memory_gives_a_warning(sh, known):
    line = "local --cloud c.csv --pose 0,0,0 --size 3,2 --resolution 0.1 --no-images -o"
    message = "--unknown keep has no effect without --map or --keep: cells without points are free"
    assert sh.err(f"{line} a --unknown keep") == f"warning: {message}\n"
    sh.ok(f"{line} b")
    assert set(np.unique(read_map("a/local.yaml").occupancy)) == {0, 100}


ROLLING_POSES = [(0.05 * k, 0.03 * k, 0.1 * k) for k in range(7)]


@pytest.fixture
def rolling(here):
    """Seven clouds around a moving robot."""
    Path("scans").mkdir()
    rng = np.random.default_rng(1)
    for k in range(7):
        np.savetxt(f"scans/{k}.csv", rng.uniform(-1.6, 1.6, (9, 2)), delimiter=",")
    np.savetxt("poses.txt", ROLLING_POSES, fmt="%.17g")


def check_rolled(keep, unreadable=(), not_written=(), *, global_map=None, **options):
    """Compare the local maps with those of `RollingMapper`; return the latter."""
    options = LocalOptions(size=(3, 2), resolution=0.1, **options)
    mapper = mapdeal.RollingMapper(ROLLING_POSES, options, keep=keep, global_map=global_map)
    rolled = {}
    for k in range(7):
        if k in unreadable:
            mapper.skip()
            continue
        mapper.add(np.loadtxt(f"scans/{k}.csv", delimiter=",", ndmin=2))
        rolled[k] = mapper.result()
        if k not in not_written:
            found = read_map(f"o/{k:04}/local.yaml")
            assert np.array_equal(found.occupancy, rolled[k].grid.occupancy)
            assert found.origin == rolled[k].grid.origin
    return rolled


SMALL = grid_from_text("#..?\n....\n.#..", 0.1, (-0.5, 0.5, 0.0))


@pytest.mark.parametrize(("words", "number", "options"), [
    ("3", 3, {}), ("all", None, {}),
    ("3 --map small.npz --unknown free --max-range 1.2 --raytrace-range 1", 3,
     {"global_map": SMALL, "unknown": "free", "max_range": 1.2, "raytrace_range": 1.0}),
])  # fmt: skip
def test_a_rolling_sequence(sh, words, number, options, rolling):
    write_map("small.npz", SMALL)
    assert sh(f"{ROLLING} --keep {words}")[1].startswith("o: 7 done")
    for k, rolled in check_rolled(number, **options).items():
        manifest = manifest_of(f"o/{k:04}")
        figures = manifest["figures"]["local"]
        assert figures["clouds"] == min(k + 1, number or 7)
        assert figures["from_earlier"] == rolled.from_earlier
        assert manifest["stages"][0]["local"]["keep"] == (number or "all")
        assert next(iter(manifest["inputs"])) == f"{k}.csv"


@pytest.mark.parametrize("keep", ["2", "all"])
def test_a_rolling_sequence_continues_where_it_stopped(sh, here, keep, rolling):
    def contents():
        return {name: data for name, data in tree(here / "o").items() if name != "summary.json"}

    assert sh(f"{ROLLING} --keep {keep}")[0] == 0
    before = contents()
    for k in (3, 5, 6):
        shutil.rmtree(f"o/{k:04}")
    code, out, _ = sh(f"{ROLLING} --keep {keep}")
    assert (code, out[:27]) == (0, "o: 3 done, 4 unchanged, 0 f")
    assert contents() == before


def test_a_cloud_that_changes_changes_the_maps_after_it(sh, rolling):
    line = f"{ROLLING} --keep 3"
    assert sh(line)[0] == 0
    np.savetxt("scans/2.csv", [[0.5, 0.1]], delimiter=",")
    err = sh.err(line, 5)
    folders = [text.split("/")[1] for text in err.splitlines() if text.startswith("error: o/0")]
    assert folders == ["0002", "0003", "0004"]
    np.savetxt("poses.txt", [*ROLLING_POSES[:-2], (0.4, 0, 0), ROLLING_POSES[-1]])
    sh(f"{line} --force")
    code, out, _ = sh(line)
    assert (code, out[:11]) == (0, "o: 0 done, ")


def test_a_bad_cloud_is_left_out_of_the_maps_after_it(sh, rolling):
    Path("scans/3.csv").write_text("0.5,0.5\na,b\n")
    code, out, err = sh(f"{ROLLING} --keep 3")
    assert (code, "6 done, 0 unchanged, 1 failed" in out) == (5, True)
    assert "error: scans/3.csv: line 2" in err
    message = "1 of the clouds before it could not be read: the map is without them"
    warned = [line.split(":")[1].strip() for line in err.splitlines() if message in line]
    assert warned == ["scans/4.csv", "scans/5.csv"]
    check_rolled(3, unreadable=[3])
    assert not Path("o/0003").exists()
    code, out, _ = sh(f"{ROLLING} --keep 3")
    assert (code, out[:24]) == (5, "o: 0 done, 6 unchanged, ")


def test_a_cloud_whose_output_exists_still_counts_in_later_maps(sh, rolling):
    Path("o/0003").mkdir(parents=True)
    Path("o/0003/cost.npz").write_bytes(b"somebody's")
    assert sh(f"{ROLLING} --keep 3")[0] == 5
    check_rolled(3, not_written=[3])


def test_windows_too_far_apart_for_the_memory_are_refused(sh, rolling):
    np.savetxt("poses.txt", [(1e5 * k, 1e5 * k, 0) for k in range(7)])
    err = sh.err(f"{ROLLING} --keep all", 3)
    assert err.startswith("error: scans/0.csv: 6000030 x 6000020 cells to remember need ")
    assert err.endswith("; a smaller --keep takes less\n")
    assert not Path("o").exists()
    assert sh(f"{ROLLING} --keep 1")[0] == 0
