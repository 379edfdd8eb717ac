from pathlib import Path

import numpy as np
import pytest
from benchmarks import clouds

import mapdeal
from mapdeal import MapdealWarning, build_map, build_map_from_log, read_map

ANGLES = np.radians(np.arange(-90, 90))
TRIPLE = "--poses p.txt --angles a.txt --ranges r.txt"


def flaser(readings, pose, number):
    """The line of a log for one scan."""
    words = ["FLASER", len(readings), *readings, *pose, 0, 0, 0, number, "host", number]
    return " ".join(map(str, words)) + "\n"


@pytest.fixture
def run(here):
    """Five scans in a hall of 6 m x 4 m, from a robot that walks along it: arrays and files."""
    poses = np.array([[1 + 0.5 * k, 2.0 + 0.1 * k, 0.3 * k + 0.01] for k in range(5)])
    ranges = np.empty((5, 180))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + ANGLES), np.sin(yaw + ANGLES)
        ranges[k] = np.minimum(
            np.where(c > 0, (6.02 - x) / c, (0.03 - x) / c),
            np.where(s > 0, (4.01 - y) / s, (0.02 - y) / s),
        ).round(3)
    ranges[2, 40:60] = 81.83
    ranges[3, 7] = 0.0
    scans = zip(ranges.tolist(), poses.tolist(), range(5), strict=True)
    Path("hall.log").write_text("# a run\n" + "".join(flaser(*scan) for scan in scans))
    np.savez("hall.npz", poses=poses, angles=ANGLES, ranges=ranges)
    for name, table in (("p", poses), ("a", ANGLES[np.newaxis]), ("r", ranges)):
        np.savetxt(f"{name}.txt", table, delimiter=",", fmt="%.17g")
    return poses, ANGLES, ranges


@pytest.mark.parametrize("method", ["log-odds", "counting", "tsdf"])
def test_build_writes_what_the_library_makes(sh, run, method):
    out = sh.ok(f"build hall.log -o m.yaml --method {method} --layers l.npz --image m.png")
    built = build_map(*run, method=method)
    found = read_map("m.yaml")
    assert np.array_equal(found.occupancy, built.grid.occupancy)
    assert (found.origin, found.resolution) == (built.grid.origin, 0.05)
    assert np.array_equal(read_map("l.npz").occupancy, built.grid.occupancy)
    with np.load("l.npz") as layers:
        for name, layer in built.layers.items():
            np.testing.assert_array_equal(layers[name], layer)
    assert "  5 scans, 900 beams: 879 hits, 20 without return, 1 bad" in out
    x, y, _ = built.grid.origin
    assert f" cells at {x:.10g}, {y:.10g}, " in out
    assert Path("m.png").stat().st_size > 1000


def test_every_kind_of_source_gives_the_same_map(sh, run):
    for name, source in (("a", "hall.log"), ("b", "hall.npz"), ("c", TRIPLE)):
        sh.ok(f"build {source} -o {name}.npz")
    of_log, of_arrays, of_tables = (read_map(f"{name}.npz").occupancy for name in "abc")
    # angles of a log are degrees made radians
    assert np.count_nonzero(of_log != of_arrays) < 5
    assert np.array_equal(of_arrays, of_tables)
    sh.ok(f"build {TRIPLE} -o flipped.npz --flip-y")
    flipped = build_map(run[0] * (1, -1, 1), *run[1:]).grid
    assert np.array_equal(read_map("flipped.npz").occupancy, flipped.occupancy)


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("words", "options"), [
    (
        ("--resolution 0.1 --size 5,3 --origin 0.25,-0.5 --range-min 0.5 --range-max 4 --values"
         " --clear-max 2 --log-free -0.5 --log-occ 0.9 --log-min 20 --log-max 90"),
        {"resolution": 0.1, "size": (5, 3), "origin": (0.25, -0.5), "range_min": 0.5,
         "range_max": 4, "clear_max": 2, "log_free": -0.5, "log_occ": 0.9, "log_min": 20,
         "log_max": 90, "values": True},
    ),
    ("--method counting --ratio 0.1", {"method": "counting", "ratio": 0.1}),
    ("--method tsdf --truncation 4", {"method": "tsdf", "truncation": 4}),
    ("--method tsdf --truncation-behind 3", {"method": "tsdf", "truncation_behind": 3}),
    ("--method tsdf --as-written", {"method": "tsdf", "as_written": True}),
], ids=["log-odds", "ratio", "truncation", "behind", "as written"])  # fmt: skip
def test_options_reach_the_method_the_grid_and_python(sh, run, words, options):
    sh(f"build hall.log -o m.npz --layers l.npz {words}")
    built, found = build_map_from_log("hall.log", **options), read_map("m.npz")
    assert found.frame == built.grid.frame
    assert np.array_equal(found.occupancy, built.grid.occupancy)
    assert (len(np.unique(found.occupancy)) > 5) == ("--values" in words)
    with np.load("l.npz") as layers:
        for name, layer in built.layers.items():
            assert np.array_equal(layers[name], layer, equal_nan=True)


def test_a_real_log_gives_a_map(sh, real_maps):
    triple = real_maps / "derived" / "run1_triple"
    words = f"--poses {triple}/pose.txt --angles {triple}/scanAngles.txt"
    out = sh(f"build {words} --ranges {triple}/ranges.txt -o m.yaml")[1]
    assert "460 scans, 124660 beams: 123824 hits, 0 without return, 836 bad" in out


def write_poles(*places):
    """A log of poles, three cells long, that 3 of 12 beams hit; the others go by to a wall."""
    scans = [
        ([0.0] * 90 + [reading] + [0.0] * 89, (0.0125, place + y, 0.0))
        for place in places
        for y in (0.0125, 0.0525, 0.0925)
        for reading in [2.0] * 3 + [6.0] * 9
    ]
    Path("poles.log").write_text("".join(flaser(*scan, k) for k, scan in enumerate(scans)))


@pytest.mark.parametrize(("method", "advice"), [
    ("log-odds", "--log-occ above 2 keeps more, --values keeps their evidence"),
    ("counting", "--ratio 0.24 keeps all of them"),
    ("tsdf", "--method counting with a small --ratio keeps them"),
])  # fmt: skip
def test_groups_of_hits_that_the_map_lacks_are_counted(sh, here, method, advice):
    line = f"build poles.log -o m.npz --force --method {method} --resolution 0.04"
    write_poles(1.0, 3.0)
    assert sh.err(line) == (
        "warning: poles.log: 2 groups of cells hit 3 times and more left nothing occupied within 2 "
        f"cells; the largest has 3 cells, around 2.02, 1.06; {advice}; --compare shows what each "
        "method loses\n"
    )
    write_poles(1.0)
    err = sh.err(line)
    assert ": 1 group of cells hit 3 times and more left nothing" in err
    assert "; it has 3 cells, around 2.02, 1.06; " in err


def test_what_is_advised_keeps_them(sh, here):
    write_poles(1.0, 3.0)
    for words in ("--method counting --ratio 0.24", "--log-occ 3.1", "--values"):
        sh.ok(f"build poles.log -o m.npz --force {words} --resolution 0.04")


def test_a_sequence_with_poses_makes_the_map_of_its_points(sh, here):
    path = [(1, 1, 0.6), (4, 1, 0.6), (4, 3, 0.6), (1, 3, 0.6)]
    world = clouds.World([clouds.ground(0, 5, 0, 4), *clouds.room(0, 5, 0, 4)], path)
    world.steps, world.azimuths, lines = 6, 360, []
    for k, scan in enumerate(world.scan()):
        np.save(f"scan{k:02}.npy", scan.points.astype(np.float32))
        x, y, z, yaw = scan.pose
        lines.append(f"{k} {x} {y} {z} 0 0 {np.sin(yaw / 2)} {np.cos(yaw / 2)}")
    Path("poses.txt").write_text("\n".join(lines))
    sh.ok("build --cloud . --poses poses.txt -o map.yaml")
    expected, found = clouds.ours_with_poses(world), read_map("map.yaml")
    assert found.shape == expected.shape
    assert (found.occupancy == expected.occupancy).mean() > 0.995  # float32, and rounded poses
    Path("poses.txt").write_text("\n".join(lines[1:]))
    err = sh.err("build --cloud . --poses poses.txt -o map.yaml --force", 3)
    assert "must have a pose for each of 6 clouds" in err


def test_lines_that_are_wrong_are_passed_over_up_to_a_number(here):
    last = {1: 1.0, 2: "near", 3: 2.0}
    lines = (flaser([*[1.5] * 179, last[x]], (x, 2, 0.3), x) for x in last)
    Path("two.log").write_text("".join(lines))
    with pytest.warns(MapdealWarning, match="line 2"):
        built = build_map_from_log("two.log", resolution=0.5)
    assert built.counts.scans == 2
    with pytest.raises(mapdeal.MalformedInputError, match="line 2"):
        build_map_from_log("two.log", resolution=0.5, max_bad=0)
