import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from scipy import ndimage

import mapdeal
from drawn import grid_from_text
from mapdeal.kernels import engine

FORMATS = ["scans.npz", "scans.log", "scans.mcap", "scans.db3"]
ROOMS = """
    ####################
    #........#.........#
    #........#.........#
    #..................#
    #........#.........#
    ####.#####....##...#
    #........#....##...#
    #........#.........#
    #..................#
    #........#.........#
    ####################
"""
SENSOR = ["--tour", "--robot-radius=0.12", "--sensor-at=0.05,-0.02,0.4", "--odom-noise=0.1"]
SLOW = ["--rate=1", "--beams=90"]


@pytest.fixture
def rooms(here):
    values = np.kron(grid_from_text(ROOMS).occupancy, np.ones((3, 3), np.int8))
    grid = mapdeal.OccupancyGrid(values, 0.1, (-1.3, 2.7, 0.0))
    mapdeal.write_map("rooms.yaml", grid)
    return grid


def near(mask, cells=1):
    return ndimage.binary_dilation(mask, np.ones((3, 3)), cells)


@pytest.mark.parametrize("name", FORMATS)
def test_build_finds_the_walls_again(rooms, command, name):
    code, out, err = command("scan", "rooms.yaml", *SENSOR, "-o", name)
    assert (code, err) == (0, "")
    assert "sees 100.00 %" in out
    height, width = rooms.shape
    size = f"{width / 10},{height / 10}"
    line = ["build", name, "-o", "built.yaml", "--resolution", 0.1, "--size", size]
    line += ["--origin=-1.3,2.7", "--method", "counting"]
    assert command(*line)[::2] == (0, "")
    built, walls = mapdeal.read_map("built.yaml").occupied(), rooms.occupied()
    in_sight = walls & ndimage.binary_dilation(~walls)  # corners may be out of sight
    assert (built & in_sight).sum() > 0.95 * in_sight.sum()
    assert not (in_sight & ~near(built)).any()
    assert not (built & ~walls).any()


def test_bags_have_the_topics_that_slam_needs(rooms, command):
    for name in FORMATS:
        assert command("scan", "rooms.yaml", *SENSOR, *SLOW, "--range-max=3.5", "-o", name)[0] == 0
    known = np.load("scans.npz")
    for name in FORMATS[2:]:
        with AnyReader([Path(name)]) as reader:
            first, *messages = [
                (connection.topic, time, reader.deserialize(data, connection.msgtype))
                for connection, time, data in reader.messages()
            ]
        assert first[0] == "/map"
        assert (first[2].data.reshape(rooms.shape) == rooms.occupancy).all()
        assert [topic for topic, *_ in messages] == ["/tf", "/odom", "/scan"] * len(known["poses"])
        groups = zip(messages[::3], messages[1::3], messages[2::3], strict=True)
        for k, ((_, _, tf), (_, _, odometry), (_, time, scan)) in enumerate(groups):
            stamp = scan.header.stamp
            assert time == (k + 1) * 10**9 == stamp.sec * 10**9 + stamp.nanosec
            moved = np.eye(3)
            chain = [(item.header.frame_id, item.child_frame_id) for item in tf.transforms]
            assert chain == [("map", "odom"), ("odom", "base_link"), ("base_link", "laser")]
            for item in tf.transforms:
                place, turn = item.transform.translation, item.transform.rotation
                cos, sin = turn.w**2 - turn.z**2, 2 * turn.w * turn.z
                moved = moved @ [[cos, -sin, place.x], [sin, cos, place.y], [0, 0, 1]]
            np.testing.assert_allclose(moved[:2, 2], known["poses"][k, :2], atol=1e-9)
            assert odometry.pose.pose.position.x == tf.transforms[1].transform.translation.x
            angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            np.testing.assert_allclose(angles, known["angles"], atol=1e-12)
            np.testing.assert_allclose(scan.ranges, known["ranges"][k], rtol=3e-7)
            assert (scan.ranges >= known["ranges"][k]).all()
    with open("scans.mcap", "rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == len(messages) + 1
    text = Path("scans.log").read_text().split()
    assert float(text[5]) == 3.5
    assert "4.5000000" in text  # no return: above the maximum


def test_the_bytes_do_not_depend_on_engine_and_threads(rooms, command, monkeypatch):
    Path("poses.txt").write_text("-0.5 3.2 0\n4 5.5 3\n")
    sums, noisy = {}, [*SENSOR[2:], *SLOW, "--noise=0.02", "--dropout=0.1", "--force"]
    for name, threads in [("scipy", 1), ("compiled", 3), ("compiled", 1)]:
        if name == "scipy" or engine.compiled_module() is not None:
            monkeypatch.setenv(engine.VARIABLE, name)
        of_tour = ["scan", "rooms.yaml", *SENSOR[:2], *noisy, "--threads", threads]
        assert command(*of_tour, "-o", "tour.npz")[0] == 0
        for output in FORMATS:
            line = ["scan", "rooms.yaml", "--poses", "poses.txt", *noisy, "--threads", threads]
            assert command(*line, "-o", output)[0] == 0
        files = [Path("tour.npz"), *map(Path, FORMATS[:3]), *sorted(Path("scans.db3").iterdir())]
        for file in files:
            sums.setdefault(file, set()).add(hashlib.sha256(file.read_bytes()).hexdigest())
    assert len(files) == 6
    assert {len(found) for found in sums.values()} == {1}


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_batch_writes_the_log_of_each_map_that_can_be_read(rooms, command, jobs):
    mapdeal.write_map("maps/turned.yaml", mapdeal.OccupancyGrid(rooms.occupancy.T.copy(), 0.1))
    maps, line = ["rooms.yaml", "maps", "missing.yaml"], [*SENSOR, *SLOW, "--strict"]
    code, out, err = command("scan", *maps, *line, "-o", "logs", "--format", "log", "-j", jobs)
    assert (code, out.splitlines()[-1]) == (5, "logs: 2 done, 1 failed")
    assert "error: missing.yaml: cannot be read" in err
    assert command("scan", "rooms.yaml", *line, "-o", "rooms.log")[0] == 0
    assert Path("logs/rooms.log").read_bytes() == Path("rooms.log").read_bytes()
    entries = json.loads(Path("logs/summary.json").read_text())["maps"]
    assert [entry["status"] for entry in entries] == ["done", "done", "failed"]
    assert entries[1]["scan"]["seen_wall_cells"] > 100
    assert "exists" in command("scan", "maps", *line, "-o", "logs", "--format", "log")[2]


def test_routes_and_files_of_poses_are_followed(rooms, command):
    route = ["route", "rooms.yaml", "--from=-0.9,3.2", "--to", "4,5.5", "-o", "r.json"]
    assert command(*route, "--robot-radius", "0.12")[0] == 0
    code, out, _ = command("scan", "rooms.yaml", "--route", "r.json", "-o", "r.npz", "--json",
                           "--image", "r.png")  # fmt: skip
    figures, points = json.loads(out), json.loads(Path("r.json").read_text())["points"]
    assert code == 0
    assert figures["visible_wall_cells"] is None
    assert figures["length_m"] == pytest.approx(np.hypot(*np.diff(points, axis=0).T).sum(), abs=0.1)
    Path("poses.txt").write_text("# x y yaw\n-0.5 3.2 0\n4 5.5 3\n-9 0 0\n")
    code, _, err = command("scan", "rooms.yaml", "--poses", "poses.txt", "-o", "p.npz")
    assert code == 0
    assert "1 of 3 poses of the scanner lie in obstacles" in err
    assert "pose 3: they see nothing" in err
    ranges = np.load("p.npz")["ranges"]
    assert np.isfinite(ranges[:2]).all()
    assert np.isinf(ranges[2]).all()
    grid = mapdeal.scan(rooms, poses=np.array([[-0.5, 3.2, 0.0]]))
    np.testing.assert_array_equal(grid.scans.ranges, ranges[:1])


@pytest.mark.parametrize(("words", "code", "text"), [
    ("", 2, "--poses, --route, --tour: exactly one of these is needed"),
    ("--tour --poses p.txt", 2, "exactly one of these is needed"),
    ("--poses p.txt --from 0,0", 2, "--from: applies to a tour"),
    ("--poses p.txt --robot-radius 1", 2, "--robot-radius: applies to a tour"),
    ("--poses p.txt", 3, "p.txt: 1 of 1 poses of the scanner lie in obstacles"),
    ("--poses none.txt", 4, "none.txt: cannot be read"),
    ("--route p.txt", 3, "p.txt: line 1, column 4: invalid JSON"),
    ("--route empty.json", 3, "empty.json: points: has no points"),
    ("--tour --range-min 9 --range-max 3", 2, "--range-max: must be above range_min"),
    ("--tour --fov 7", 2, "--fov: must be a finite number, above 0, at most a full turn"),
    ("--tour --rate 0", 2, "--rate: must be a finite number, between 0.001 and 10000"),
    ("--tour --speed 1e-7 --robot-radius 0.1", 2, "--speed, --rate: "),
    ("--tour --sensor-at 0,nan,0", 2, "--sensor-at: must be finite, got '0,nan,0'"),
    ("--tour --jobs 2", 2, "--jobs: applies to several maps"),
    ("p.txt --poses p.txt", 2, "--tour: is required for several maps"),
    ("p.txt --tour --image x.png", 2, "--image: applies to one map"),
    ("--tour -o x.bag", 2, "--output: must end in .npz, .log, .mcap or .db3, got 'x.bag'"),
])  # fmt: skip
def test_bad_input_is_one_line(rooms, command, words, code, text):
    Path("p.txt").write_text("-9 0 0\n")
    Path("empty.json").write_text('{"points": []}')
    output = [] if "-o" in words else ["-o", "x.npz"]
    got, _, err = command("scan", "rooms.yaml", *words.split(), *output)
    assert got == code
    (error,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert text in error
    assert not Path("x.npz").exists()


@pytest.mark.parametrize(("name", "value"), [
    ("beams", 1), ("fov", 7.0), ("noise", -1.0), ("dropout", 2.0), ("rate", 0.0),
    ("sensor_at", (1, 2)), ("poses", [["a", 0, 0]]), ("poses", [[0, 0, float("nan")]]),
])  # fmt: skip
def test_python_refuses_the_values_that_the_shell_refuses(name, value):
    with pytest.raises(mapdeal.ParameterError, match=name):
        mapdeal.scan(grid_from_text("..."), **{"poses": [[0.0, 0.0, 0.0]], name: value})


@pytest.mark.thorough
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("name", [
    "ROBOTIS-GIT__turtlebot3/turtlebot3_navigation2/map/map.yaml",
    "WPI-RAIL__rail_maps/maps/ilab.yaml",
    "at-wat__neonavigation/neonavigation_launch/map/demo_map.yaml",
    "avidbots__flatland/conestogo_office_test/map.yaml",
    "f1tenth__f1tenth_gym/maps/skirk.yaml",
    "mit-racecar__racecar_simulator/maps/building_31.yaml",
    "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
    "ros-navigation__navigation2/nav2_bringup/maps/warehouse.yaml",
    "ryuichiueda__value_iteration/maps/house.yaml",
    "turtlebot__turtlebot_simulator/turtlebot_stdr/maps/frieburg.yaml",
])  # fmt: skip
@pytest.mark.parametrize(("noise", "cells"), [(0.0, 1), (0.02, 2)])
def test_build_finds_the_walls_of_real_maps(real_maps, name, noise, cells):
    grid = mapdeal.read_map(real_maps / name)
    robot = mapdeal.Footprint.circle(0.22)
    exact = mapdeal.scan(grid, tour=True, footprint=robot)
    noisy = mapdeal.scan(grid, tour=True, footprint=robot, noise=noise)
    built = mapdeal.build_map(
        noisy.scans.poses, noisy.scans.angles, noisy.scans.ranges,
        resolution=grid.resolution, size=grid.frame.size_xy, origin=grid.origin[:2],
    ).grid.occupied()  # fmt: skip
    scans = exact.scans
    hit = np.isfinite(scans.ranges)
    headings, lengths = (scans.poses[:, 2:] + scans.angles)[hit], scans.ranges[hit]
    ends = np.repeat(scans.poses[:, :2], hit.sum(axis=1), axis=0)
    ends += lengths[:, np.newaxis] * np.column_stack([np.cos(headings), np.sin(headings)])
    seen = np.zeros(grid.shape, dtype=bool)
    seen[tuple(grid.frame.bounded_rowcol_from_xy(ends)[0].T)] = True
    seen &= grid.occupied()
    assert (seen & near(built, cells)).sum() >= 0.99 * seen.sum()
    # of ten thousands of noisy beams, a few are off by more than three standard deviations
    wrong = np.count_nonzero(built & ~near(grid.occupied(), cells))
    assert wrong <= 1e-3 * built.sum() * (noise > 0)
