"""Bags on the command line: maps out of them, maps of what they hold, and maps into them."""

import json
import math
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import mapdeal
from bags.making import (
    FORMATS,
    SECOND,
    START,
    Maker,
    cloud,
    costmap,
    occupancy,
    odometry,
    of_yaw,
    ros2_store,
    scan,
    tf,
    words,
)
from drawn import grid_from_text
from mapdeal import build_map, read_map
from mapdeal.bags import bag as chunked

LASER, TF = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"
ODOMETRY, MAP = "nav_msgs/msg/Odometry", "nav_msgs/msg/OccupancyGrid"
COSTMAP, CLOUD = "nav2_msgs/msg/Costmap", "sensor_msgs/msg/PointCloud2"
MOUNT = (0.2, -0.1, 0.4)
ANGLES = (-1.5, 0.05, 61)
STEPS = 8
FIFTH = SECOND // 5
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)
GRID = grid_from_text("..#?\n#..7\n?.#.".replace("7", "."), 0.1)


def product(first, second):
    c, s = math.cos(first[2]), math.sin(first[2])
    x, y, yaw = second
    return first[0] + c * x - s * y, first[1] + s * x + c * y, first[2] + yaw


def map_to_odom(share):
    return 0.3 + 0.2 * share, -0.2, 0.1 + 0.05 * share


def odom_to_base(share):
    return 1.0 + 0.5 * share, 2.0 + 0.1 * share, 0.2 * share


class Drive:
    """A robot that drives through a hall of 6 by 4 m, and sees its walls.

    Transforms come every 0.2 s, scans 0.05 s behind them; a transform is linear in between.
    """

    def __init__(self, mount=MOUNT, *, is_flipped=False):
        self.mount, self.is_flipped = mount, is_flipped
        start, step, count = ANGLES
        self.angles = np.float64(np.float32(start)) + np.float64(np.float32(step)) * np.arange(
            count
        )
        self.times = [START + k * FIFTH for k in range(STEPS + 1)]
        self.poses, self.ranges = [], []
        for k in range(STEPS):
            pose = product(product(map_to_odom(k + 0.25), odom_to_base(k + 0.25)), mount)
            self.poses.append(pose)
            self.ranges.append(self.seen(pose))

    def seen(self, pose):
        x, y, yaw = pose
        turns = -self.angles if self.is_flipped else self.angles
        c, s = np.cos(yaw + turns), np.sin(yaw + turns)
        found = np.minimum(
            np.where(c > 0, (7.02 - x) / c, (-0.53 - x) / c),
            np.where(s > 0, (4.01 - y) / s, (0.02 - y) / s),
        )
        return found.astype(np.float32)

    def moving(self, maker, topic="/tf", name=TF, *, parents=("map", "odom")):
        for k, time in enumerate(self.times):
            for parent, child, pose in (
                ("map", "odom", map_to_odom(k)), ("odom", "base_link", odom_to_base(k))
            ):  # fmt: skip
                if parent in parents:
                    x, y, yaw = pose
                    move = tf(time, (parent, child, (x, y, 0), of_yaw(yaw)), name=name)
                    maker.add(topic, name, time, move)

    def mounted(self, maker, frame="laser"):
        x, y, yaw = self.mount
        turn = of_yaw(yaw)
        if self.is_flipped:  # around the sensor's own x axis
            turn = (math.cos(yaw / 2), math.sin(yaw / 2), 0.0, 0.0)
        make = tf(START, ("base_link", frame, (x, y, 0.3), turn))
        maker.add("/tf_static", TF, START, make)

    def scans(self, maker, topic="/scan", frame="laser", **options):
        start, step, _ = ANGLES
        for time, ranges in zip(self.times, self.ranges, strict=False):
            time += FIFTH // 4
            made = scan(time, ranges, frame=frame, start=start, step=step, **options)
            maker.add(topic, LASER, time, made)

    def map(self, **options):
        angles = -self.angles if self.is_flipped else self.angles
        return build_map(self.poses, angles, np.float64(self.ranges), **options).grid


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def whole(drive):
    maker = Maker()
    drive.mounted(maker)
    drive.moving(maker)
    drive.scans(maker)
    return maker


def same(found, wanted):
    assert np.array_equal(found.occupancy, wanted.occupancy)
    assert found.frame == wanted.frame


# build


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("is_flipped", [False, True])
def test_a_map_of_a_bag_is_that_of_its_scans(command, tmp_path, form, is_flipped):
    drive = Drive(is_flipped=is_flipped)
    path = whole(drive).write(tmp_path, form)
    code, out, err = command("build", path, "-o", "m.yaml", "--method", "counting")
    assert (code, err) == (0, "")
    assert f"{STEPS} scans, {STEPS * ANGLES[2]} beams" in out
    same(read_map("m.yaml"), drive.map(method="counting"))
    shifted = Drive(mount=(0.0, 0.0, 0.0), is_flipped=is_flipped)
    shifted.ranges = drive.ranges
    assert not np.array_equal(shifted.map().occupancy, drive.map().occupancy)


def test_compared_methods_take_bags(command, tmp_path):
    drive = Drive()
    path = whole(drive).write(tmp_path, "mcap")
    code, out, err = command("build", path, "-o", "all", "--compare", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["scans"] == STEPS
    found = read_map("all/counting.yaml")
    builder = mapdeal.MapBuilder(found.frame, "counting")
    builder.add(mapdeal.Scans(drive.poses, drive.angles, np.float64(drive.ranges)))
    same(found, builder.result().grid)


def test_old_transforms_are_taken_and_frames_may_begin_with_a_slash(command, tmp_path):
    drive, maker = Drive(), Maker()
    old = "tf/msg/tfMessage"
    drive.moving(maker, name=old)
    x, y, yaw = MOUNT
    for time in drive.times:  # as before there was /tf_static
        move = ("/base_link", "/laser", (x, y, 0), of_yaw(yaw))
        maker.add("/tf", old, time, tf(time, move, name=old))
    drive.scans(maker, frame="/laser")
    path = maker.write(tmp_path, "ros1")
    assert command("build", path, "-o", "m.yaml", "--topic", "scan")[::2] == (0, "")
    same(read_map("m.yaml"), drive.map())


def test_scans_outside_of_the_transforms_are_left_out_and_counted(command, tmp_path):
    drive = Drive()
    maker = whole(drive)
    maker.messages = [one for one in maker.messages
                      if one[1] != "/tf" or drive.times[2] <= one[0] <= drive.times[6]]  # fmt: skip
    path = maker.write(tmp_path, "mcap")
    code, out, err = command("build", path, "-o", "m.yaml")
    assert code == 0
    assert "4 scans" in out
    told = "4 of 8 scans are left out: where laser was is known from 1700000000.400 to "
    assert f"{told}1700000001.200 s" in err
    drive.poses, drive.ranges = drive.poses[2:6], drive.ranges[2:6]
    same(read_map("m.yaml"), drive.map())


def test_a_transform_of_both_kinds_is_warned_of_and_keeps_its_samples(command, tmp_path):
    drive = Drive()
    maker = whole(drive)
    stale = tf(drive.times[4], ("odom", "base_link", (9, 9, 0), (0, 0, 0, 1)))
    maker.add("/tf_static", TF, drive.times[4], stale)
    code, _, err = command("build", maker.write(tmp_path, "mcap"), "-o", "m.yaml")
    assert code == 0
    assert "odom -> base_link is both static and dynamic: the more frequent kind" in err
    same(read_map("m.yaml"), drive.map())


def test_two_scanners_make_one_map(command, tmp_path):
    front, rear = Drive(), Drive(mount=(-0.3, 0.1, 3.0), is_flipped=True)
    maker = whole(front)
    rear.mounted(maker, "rear")
    rear.scans(maker, "/back", "rear")
    path = maker.write(tmp_path, "mcap")
    code, _, err = command("build", path, "-o", "m.yaml")
    assert code == 3
    assert "has 2 topics of laser scans" in err
    assert "--topic names one of /back (sensor_msgs/msg/LaserScan), /scan" in err
    words_ = ["build", path, "--topic", "/back", "--topic", "/scan", "--method", "counting"]
    assert command(*words_, "-o", "m.yaml")[0] == 0
    both = mapdeal.MapBuilder(read_map("m.yaml").frame, "counting")
    for drive in (front, rear):
        angles = -drive.angles if drive.is_flipped else drive.angles
        both.add(mapdeal.Scans(drive.poses, angles, np.float64(drive.ranges)))
    same(read_map("m.yaml"), both.result().grid)


def test_a_sensor_that_leans_sees_less_far_and_one_that_leans_much_nothing(command, tmp_path):
    drive = Drive()
    for degrees, name in ((8, "a"), (12, "b")):
        maker = whole(drive)
        lean = math.radians(degrees) / 2
        turn = (0, math.sin(lean), 0, math.cos(lean))
        maker.messages[0] = (
            START, "/tf_static", TF,
            tf(START, ("base_link", "laser", (0.2, -0.1, 0), turn)),
        )  # fmt: skip
        (tmp_path / name).mkdir()
        path = maker.write(tmp_path / name, "mcap")
        code, _, err = command("build", path, "-o", f"{name}.yaml")
        if degrees == 12:
            assert code == 3
            assert "8 of 8 scans are left out: their sensor leans by more than 10 degrees" in err
            continue
        assert (code, err) == (0, "")
        poses = [product(product(map_to_odom(k + 0.25), odom_to_base(k + 0.25)), (0.2, -0.1, 0))
                 for k in range(STEPS)]  # fmt: skip
        c, s = np.cos(drive.angles), np.sin(drive.angles)
        flat_x = c * math.cos(math.radians(degrees))
        builder = mapdeal.MapBuilder(read_map("a.yaml").frame, "log-odds")
        for pose, ranges in zip(poses, drive.ranges, strict=True):
            reach = np.float64(ranges) * np.hypot(flat_x, s)
            builder.add(mapdeal.Scans([pose], np.arctan2(s, flat_x), [reach]))
        same(read_map("a.yaml"), builder.result().grid)


def test_odometry_serves_where_transforms_do_not_lead(command, tmp_path):
    drive, maker = Drive(), Maker()
    drive.mounted(maker)
    for k, time in enumerate(drive.times):
        maker.add("/odom", ODOMETRY, time, odometry(time, *odom_to_base(k)))
    drive.scans(maker)
    path = maker.write(tmp_path, "ros1-lz4")
    code, _, err = command("build", path, "-o", "m.yaml")
    assert code == 0
    assert "no transforms lead to map: the map is made in odom, with whatever its odometry" in err
    drive.poses = [product(odom_to_base(k + 0.25), MOUNT) for k in range(STEPS)]
    same(read_map("m.yaml"), drive.map())
    code, _, err = command("build", path, "-o", "n.yaml", "--fixed-frame", "map")
    assert code == 3
    assert "no transforms lead from 'map' to 'laser': frames are base_link, laser, odom" in err


def test_poses_of_a_file_and_a_mount_stand_for_transforms(command, tmp_path):
    drive, maker = Drive(), Maker()
    drive.scans(maker)
    path = maker.write(tmp_path, "mcap")
    code, _, err = command("build", path, "-o", "m.yaml")
    assert code == 3
    assert "no transforms lead from 'map' to 'laser': there are none" in err
    assert "hint: --poses FILE" in err

    def line(time, pose):
        x, y, yaw = pose
        return f"{time / 1e9:.9f} {x!r} {y!r} 0 0 0 {math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}\n"

    stamps = [time + FIFTH // 4 for time in drive.times]
    own = "".join(map(line, stamps, drive.poses))
    (tmp_path / "sensor.txt").write_text(own)
    code, _, err = command("build", path, "-o", "m.yaml", "--poses", "sensor.txt")
    assert code == 0
    assert "sensor.txt is taken for the poses of laser" in err
    # times in text are as good as a float64 of seconds, about 0.2 microseconds
    assert np.count_nonzero(read_map("m.yaml").occupancy != drive.map().occupancy) <= 3

    base = [product(map_to_odom(k + 0.25), odom_to_base(k + 0.25)) for k in range(STEPS)]
    (tmp_path / "base.txt").write_text("".join(map(line, stamps, base)))
    mount = ["--mount", ",".join(map(str, MOUNT))]
    code, _, err = command("build", path, "-o", "n.yaml", "--poses", "base.txt", *mount)
    assert (code, err) == (0, "")
    assert np.count_nonzero(read_map("n.yaml").occupancy != drive.map().occupancy) <= 3
    drive.scans(maker, "/back", "rear")
    (tmp_path / "two").mkdir()
    path = maker.write(tmp_path / "two", "mcap")
    both = ["build", path, "--topic", "scan", "--topic", "back", "-o", "p.yaml"]
    code, _, err = command(*both, "--poses", "base.txt")
    assert code == 3
    assert "no transforms lead from base_link to laser, rear: whose poses are they?" in err
    code, _, err = command(*both, "--poses", "base.txt", *mount)
    assert code == 2
    assert "--mount: applies to one sensor, and there are laser, rear" in err
    path = path.parent.parent / "bag"
    (tmp_path / "flat.txt").write_text("0 0 0\n")
    code, _, err = command("build", path, "-o", "o.yaml", "--poses", "flat.txt")
    assert code == 3
    assert "has poses without times" in err


def test_each_beam_has_the_pose_of_its_own_time(command, tmp_path):
    """The same beams, one by one, with poses that are interpolated here."""
    drive = Drive()
    between = 0.002
    maker = Maker()
    drive.mounted(maker)
    drive.moving(maker)
    drive.scans(maker, between=between)
    path = maker.write(tmp_path, "mcap")
    assert command("build", path, "-o", "m.yaml", "--deskew", "--method", "counting")[::2] == (
        0,
        "",
    )
    step = round(float(np.float32(between)) * 1e9) / FIFTH
    builder = mapdeal.MapBuilder(read_map("m.yaml").frame, "counting")
    for k in range(STEPS):
        for m, angle in enumerate(drive.angles):
            share = k + 0.25 + m * step
            pose = product(product(map_to_odom(share), odom_to_base(share)), MOUNT)
            builder.add(mapdeal.Scans([pose], [angle], [[drive.ranges[k][m]]]))
    same(read_map("m.yaml"), builder.result().grid)
    assert not np.array_equal(read_map("m.yaml").occupancy, drive.map().occupancy)
    (tmp_path / "level").mkdir()
    plain = whole(drive).write(tmp_path / "level", "mcap")
    code, out, err = command("build", plain, "-o", "p.yaml", "--deskew")
    assert (code, f"{STEPS} scans" in out) == (0, True)
    assert "no scan has a time between beams: --deskew has no effect" in err


def test_a_scan_without_time_has_that_of_its_recording(command, tmp_path):
    drive, maker = Drive(), Maker()
    drive.mounted(maker)
    drive.moving(maker)
    start, step, _ = ANGLES
    for time, ranges in zip(drive.times, drive.ranges, strict=False):
        made = scan(0, ranges, start=start, step=step)
        maker.add("/scan", LASER, time + FIFTH // 4, made)
    code, _, err = command("build", maker.write(tmp_path, "mcap"), "-o", "m.yaml")
    assert code == 0
    assert "8 scans have no time: that of their recording is taken" in err
    same(read_map("m.yaml"), drive.map())


def test_options_of_bags_need_one(command, tmp_path):
    (tmp_path / "a.log").write_text("")
    for words_ in (
        ["--topic", "/scan"],
        ["--deskew"],
        ["--mount", "1,2,3"],
        ["--fixed-frame", "m"],
    ):
        code, _, err = command("build", "a.log", "-o", "m.yaml", *words_)
        assert code == 2
        assert f"{words_[0]}: needs a bag for LOG" in err
    path = whole(Drive()).write(tmp_path, "mcap")
    code, _, err = command("build", path, "-o", "m.yaml", "--flip-y")
    assert code == 2
    assert "--flip-y: does not apply to bags" in err
    code, _, err = command("build", path, "-o", "m.yaml", "--mount", "1,2,3")
    assert code == 3
    assert "transforms already give the pose of laser on base_link" in err


# convert


def of_maps():
    maker = Maker()
    older = np.where(GRID.occupancy == 100, 0, GRID.occupancy)
    maker.add("/map", MAP, START, occupancy(START, older, 0.1, GRID.origin))
    maker.add("/map", MAP, START + 5, occupancy(START + 5, GRID.occupancy, 0.1, GRID.origin))
    published = [[0, 50, 99], [100, -1, 1]]
    maker.add("/global_costmap/costmap", MAP, START, occupancy(START, published, 0.25, (1, 2, 0)))
    maker.add(
        "/costmap_raw", COSTMAP, START, costmap(START, [[0, 253, 254, 255]], 0.25, (1, 2, 0.5))
    )
    return maker


@pytest.mark.parametrize("form", ["ros1-bz2", "sqlite3", "mcap-chunk"])
def test_the_last_map_of_a_topic_is_converted(command, tmp_path, form):
    maker = of_maps()
    if form.startswith("ros1"):
        maker.messages.pop()
    path = maker.write(tmp_path, form)
    assert command("convert", path, "--topic", "map", "-o", "m.yaml")[::2] == (0, "")
    found = read_map("m.yaml")
    np.testing.assert_array_equal(found.occupancy, GRID.occupancy)
    assert found.resolution == 0.1
    np.testing.assert_allclose(found.origin, GRID.origin, atol=1e-15)
    assert command("convert", path, "--topic", "/map", "--index", "0", "-o", "n.npz")[0] == 0
    assert not (read_map("n.npz").occupancy == 100).any()
    assert command("convert", path, "--topic", "/map", "--index", "-1", "-o", "o.npz")[0] == 0
    np.testing.assert_array_equal(read_map("o.npz").occupancy, GRID.occupancy)
    code, _, err = command("convert", path, "--topic", "/map", "--index", "2", "-o", "p.npz")
    assert code == 2
    assert "/map has 2 messages: 0 to 1, or -1 to -2, got 2" in err


@pytest.mark.usefixtures("mapdeal_warnings")
def test_costs_keep_their_scale_and_a_map_can_be_asked_for(command, tmp_path):
    path = of_maps().write(tmp_path, "mcap")
    topic = ["--topic", "/global_costmap/costmap"]
    assert command("convert", path, *topic, "-o", "c.npz")[0] == 0
    found = read_map("c.npz")
    assert (found.scale, found.cost.tolist()) == ("occupancy", [[0, 50, 99], [100, -1, 1]])
    assert command("convert", path, *topic, "--read-as", "map", "-o", "m.npz")[0] == 0
    assert read_map("m.npz").kind == "occupancy grid"
    assert command("convert", path, "--topic", "/map", "--read-as", "costs", "-o", "k.npz")[0] == 0
    costs = read_map("k.npz")
    assert (costs.scale, costs.cost.tolist()) == ("occupancy", GRID.occupancy.tolist())
    assert command("convert", path, "--topic", "/costmap_raw", "-o", "r.npz")[0] == 0
    raw = read_map("r.npz")
    assert (raw.scale, raw.cost.tolist()) == ("costmap2d", [[0, 253, 254, 255]])


def test_all_messages_go_into_a_folder(command, tmp_path):
    path = of_maps().write(tmp_path, "mcap")
    code, out, err = command("convert", path, "--topic", "/map", "--all", "-o", "maps")
    assert (code, out, err) == (0, f"maps: 2 of {path}\n", "")
    names = ["0000.pgm", "0000.yaml", "0001.pgm", "0001.yaml"]
    assert sorted(one.name for one in (tmp_path / "maps").iterdir()) == names
    np.testing.assert_array_equal(read_map("maps/0001.yaml").occupancy, GRID.occupancy)
    assert command("convert", path, "--topic", "/map", "--all", "-o", "maps")[0] == 4
    for more in (["--index", "1"], ["--mode", "raw"], ["--image", "a.png"]):
        assert command("convert", path, "--topic", "/map", "--all", "-o", "other", *more)[0] == 2
        assert not (tmp_path / "other").exists()


def test_a_map_that_says_nothing_is_warned_of(command, tmp_path):
    maker = Maker()
    maker.add("/map", MAP, START, occupancy(START, [[-1, -1]], 0.1, (0, 0, 0)))
    code, _, err = command("convert", maker.write(tmp_path, "mcap"), "-o", "m.yaml")
    assert code == 0
    assert err.endswith(": every cell is unknown\n")


def write_grid(grid, name):
    mapdeal.write_map(name, grid)
    return name


@pytest.mark.parametrize("suffix", ["mcap", "db3", "bag"])
def test_a_map_in_a_bag_is_read_back_by_others(command, tmp_path, suffix):
    write_grid(GRID, "map.npz")
    out = f"out.{suffix}"
    words_ = ["convert", "map.npz", "-o", out, "--topic", "robot/map", "--frame-id", "world"]
    assert command(*words_)[::2] == (0, "")
    with AnyReader([tmp_path / out]) as bag:
        ((connection, time, data),) = bag.messages()
        message = bag.deserialize(data, connection.msgtype)
        qos = getattr(connection.ext, "offered_qos_profiles", None)
        assert getattr(connection.ext, "latching", 1) == 1
    assert (connection.topic, connection.msgtype, time) == ("/robot/map", MAP, SECOND)
    if qos is not None:
        assert [one.durability.name for one in qos] == ["TRANSIENT_LOCAL"]
    assert message.header.frame_id == "world"
    assert message.data.tolist() == GRID.occupancy.ravel().tolist()
    assert (message.info.height, message.info.width) == GRID.shape
    assert message.info.resolution == np.float32(0.1)
    place, turn = message.info.origin.position, message.info.origin.orientation
    assert (place.x, place.y) == GRID.origin[:2]
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(GRID.origin[2], abs=1e-15)
    assert command("convert", out, "-o", "back.npz")[0] == 0
    back = read_map("back.npz")
    np.testing.assert_array_equal(back.occupancy, GRID.occupancy)
    assert back.resolution == 0.1
    assert command(*words_)[0] == 4  # it exists
    before = contents(tmp_path / out)
    assert command(*words_, "--force")[0] == 0
    assert contents(tmp_path / out) == before
    assert not list(tmp_path.glob(".*"))


def contents(path):
    files = [path] if path.is_file() else sorted(path.iterdir())
    return {one.name: one.read_bytes() for one in files}


def test_an_mcap_file_is_read_by_the_package_of_its_makers(command, tmp_path):
    write_grid(GRID, "map.npz")
    assert command("convert", "map.npz", "-o", "out.mcap")[0] == 0
    with (tmp_path / "out.mcap").open("rb") as file:
        ((schema, channel, message),) = make_reader(file, validate_crcs=True).iter_messages()
    assert (schema.name, schema.encoding, channel.topic) == (MAP, "ros2msg", "/map")
    decoded = ros2_store().deserialize_cdr(message.data, MAP)
    assert decoded.data.tolist() == GRID.occupancy.ravel().tolist()


def test_costs_become_the_message_of_their_scale(command, tmp_path):
    own = mapdeal.Costmap(np.array([[0, 100, 253], [254, 255, 1]], np.uint8), 0.25, (1, 2, 0.5))
    write_grid(own, "c.npz")
    assert command("convert", "c.npz", "-o", "c.mcap")[::2] == (0, "")
    assert command("convert", "c.mcap", "-o", "back.npz")[0] == 0
    back = read_map("back.npz")
    assert (back.scale, back.cost.tolist()) == ("costmap2d", own.cost.tolist())
    code, _, err = command("convert", "c.npz", "-o", "c.bag")
    assert code == 0
    assert "ROS 1 publishes costs as 0 to 100" in err
    assert command("convert", "c.bag", "-o", "published.npz")[0] == 0
    published = read_map("published.npz")
    assert (published.scale, published.cost.tolist()) == (
        "occupancy", own.to_occupancy().occupancy.tolist()
    )  # fmt: skip


def test_a_folder_with_a_recording_of_others_is_left_alone(command, tmp_path):
    write_grid(GRID, "map.npz")
    recorded = whole(Drive()).write(tmp_path, "sqlite3").rename(tmp_path / "rec.db3")
    before = contents(recorded)
    (recorded / "bag.db3").rename(recorded / "rec_0.db3")
    for more in ([], ["--force"]):
        code, _, err = command("convert", "map.npz", "-o", "rec.db3", *more)
        assert code == 4
        assert "is a folder with more than the bag of a map in it: rec_0.db3" in err
    assert (recorded / "metadata.yaml").read_bytes() == before["metadata.yaml"]


@pytest.mark.parametrize("name", ["a%41.db3", "a?b#c.db3", "a b.mcap", "ä.db3", "ä.bag"])
def test_any_name_is_written_and_read_back(command, tmp_path, name):
    write_grid(GRID, "map.npz")
    assert command("convert", "map.npz", "-o", name)[::2] == (0, "")
    assert command("convert", name, "-o", "back.npz")[::2] == (0, "")
    np.testing.assert_array_equal(read_map("back.npz").occupancy, GRID.occupancy)


@pytest.mark.parametrize(
    ("option", "value"),
    [("--topic", one) for one in ("", "/", "//map", "/1map", "/map/", "/a-b", "/mäp", "/a b")]
    + [("--frame-id", one) for one in ("", "/map", "a\nb")],
)
def test_names_that_ros_refuses_are_refused(command, tmp_path, option, value):
    write_grid(GRID, "map.npz")
    code, _, err = command("convert", "map.npz", "-o", "a.mcap", option, value)
    assert (code, f"{option}: must be the name of a" in err) == (2, True)
    assert not (tmp_path / "a.mcap").exists()


def test_a_database_that_cannot_be_written_is_one_error(command, tmp_path, monkeypatch):
    import sqlite3

    from rosbags.rosbag2 import Writer

    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    write_grid(GRID, "map.npz")
    monkeypatch.setattr(Writer, "write", full)
    code, _, err = command("convert", "map.npz", "-o", "a.db3")
    assert (code, err) == (4, "error: a.db3: cannot be written: database or disk is full\n")
    assert not (tmp_path / "a.db3").exists()


def test_fields_and_odd_words_are_refused(command, tmp_path):
    write_grid(GRID, "map.npz")
    assert command("esdf", "map.npz", "-o", "field.npz")[0] == 0
    path = of_maps().write(tmp_path, "mcap")
    for words_, code, told in [
        (["field.npz", "-o", "a.mcap"], 2, "ROS has no message"),
        (["map.npz", "-o", "a.mcap", "--topic", "/"], 2, "must be the name of a topic"),
        (["map.npz", "-o", "a.mcap", "--mode", "raw"], 2, "applies to pixels"),
        (["map.npz", "-o", "a.npz", "--topic", "/map"], 2, "--topic: applies to bags"),
        (["map.npz", "-o", "a.npz", "--index", "1"], 2, "--index: applies to reading bags"),
        (["map.npz", "-o", "a.npz", "--frame-id", "m"], 2, "--frame-id: applies to writing bags"),
        (["map.npz", "--all", "-o", "a", "--topic", "/map"], 2, ""),
        ([path, "-o", "a.npz"], 3, "has 3 topics of maps and costmaps"),
    ]:
        got, _, err = command("convert", *words_)
        assert (got, told in err, err.count("error: ")) == (code, True, 1), words_
        assert not list(tmp_path.glob("a*"))


# local


POINTS = np.array(
    [[1.0, 0.5, 0.2], [2.0, -0.75, 1.5], [np.nan, 0, 0], [0.4, 3.0, -1.0]], np.float32
)


def of_clouds(count=3, frame="lidar"):
    """Return a bag with clouds of a sensor that hangs upside down behind the robot."""
    drive, maker = Drive(), Maker()
    drive.moving(maker)
    move = ("base_link", "lidar", (-0.5, 0.1, 1.0), UPSIDE_DOWN)
    maker.add("/tf_static", TF, START, tf(START, move))
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    for k in range(count):
        time = drive.times[k] + FIFTH // 4
        data = (POINTS + np.float32([k, 0, 0])).tobytes()
        maker.add("/points", CLOUD, time, cloud(time, data, fields, width=4, step=12, frame=frame))
    return maker


def as_robot_sees(k):
    turned = (np.float64(POINTS) + np.array([k, 0, 0])) * [1, -1, -1]
    return turned + np.array([-0.5, 0.1, 1.0])


def robot_at(k):
    return product(map_to_odom(k + 0.25), odom_to_base(k + 0.25))


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
@pytest.mark.filterwarnings("ignore")
def test_a_cloud_is_brought_to_the_robot_and_the_robot_to_the_map(command, tmp_path, form):
    path = of_clouds().write(tmp_path, form)
    rest = ["--size", "12,9", "--resolution", "0.1", "--no-images", "--max-height", "1.2"]
    assert command("local", "--cloud", path, *rest, "-o", "out")[0] == 0
    found = read_map("out/local.yaml")
    options = {"size": (12, 9), "resolution": 0.1, "max_height": 1.2}
    wanted = mapdeal.local_map(as_robot_sees(2), robot_at(2), **options)
    assert np.array_equal(found.occupancy, wanted.occupancy)
    np.testing.assert_allclose(found.origin, wanted.origin, atol=1e-9)
    words_ = ["local", "--cloud", path, *rest, "--index", "0", "--pose", "1,2,0.5", "-o", "own"]
    assert command(*words_)[0] == 0
    wanted = mapdeal.local_map(as_robot_sees(0), (1, 2, 0.5), **options)
    assert np.array_equal(read_map("own/local.yaml").occupancy, wanted.occupancy)
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["options"]["topic"] == "/points"
    assert manifest["options"]["message"] == "2"


@pytest.mark.filterwarnings("ignore")
def test_a_bag_is_a_sequence(command, tmp_path):
    path = of_clouds().write(tmp_path, "mcap")
    rest = ["--size", "8,8", "--resolution", "0.25", "--no-images"]
    code, out, _ = command("local", "--cloud", path, *rest, "--all", "-o", "seq")
    assert code == 0
    assert "seq: 3 done, 0 unchanged, 0 failed" in out
    for k in range(3):
        wanted = mapdeal.local_map(as_robot_sees(k), robot_at(k), size=(8, 8), resolution=0.25)
        found = read_map(f"seq/{k:04}/local.yaml")
        assert np.array_equal(found.occupancy, wanted.occupancy)
    code, out, _ = command("local", "--cloud", path, *rest, "--all", "-o", "seq")
    assert "0 done, 3 unchanged" in out
    code, out, _ = command("local", "--cloud", path, *rest, "--keep", "2", "-o", "kept")
    assert code == 0
    for k in range(3):
        np.savetxt(tmp_path / f"{k}.csv", as_robot_sees(k)[[0, 1, 3]], delimiter=",")
    (tmp_path / "poses.txt").write_text(
        "".join(" ".join(map(repr, map(float, robot_at(k)))) + "\n" for k in range(3))
    )
    files = [word for k in range(3) for word in ("--cloud", f"{k}.csv")]
    words_ = ["local", *files, "--poses", "poses.txt", *rest, "--keep", "2", "-o", "files"]
    assert command(*words_)[0] == 0
    for k in range(3):
        one, other = (read_map(f"{name}/{k:04}/local.yaml") for name in ("kept", "files"))
        assert np.array_equal(one.occupancy, other.occupancy)
    words_ = ["local", "--cloud", path, *rest, "--poses", "poses.txt", "-o", "posed"]
    assert command(*words_)[0] == 0
    one, other = (read_map(f"{name}/0001/local.yaml") for name in ("posed", "seq"))
    assert np.array_equal(one.occupancy, other.occupancy)


@pytest.mark.filterwarnings("ignore")
def test_scans_are_clouds_and_points_of_the_map_stay_where_they_are(command, tmp_path):
    drive = Drive()
    path = whole(drive).write(tmp_path, "mcap")
    rest = ["--size", "12,9", "--resolution", "0.1", "--no-images"]
    assert command("local", "--cloud", path, "--index", "3", *rest, "-o", "out")[0] == 0
    hits = np.isfinite(drive.ranges[3])
    points = np.stack([np.cos(drive.angles), np.sin(drive.angles)], 1)[hits]
    points = points * np.float64(drive.ranges[3])[hits, np.newaxis]
    c, s = math.cos(MOUNT[2]), math.sin(MOUNT[2])
    points = points @ np.array([[c, s], [-s, c]]) + MOUNT[:2]
    wanted = mapdeal.local_map(points, robot_at(3), size=(12, 9), resolution=0.1)
    assert np.array_equal(read_map("out/local.yaml").occupancy, wanted.occupancy)
    (tmp_path / "map").mkdir()
    maker = of_clouds(frame="map")
    maker.messages = [one for one in maker.messages if one[1] == "/points"]
    placed = maker.write(tmp_path / "map", "mcap")
    code, _, err = command("local", "--cloud", placed, "--pose", "1,2,0", *rest, "-o", "a")
    assert code == 2
    assert "the points of /points are in frame map" in err
    words_ = ["local", "--cloud", placed, "--pose", "1,2,0", "--frame", "map", *rest, "-o", "a"]
    assert command(*words_)[0] == 0
    wanted = mapdeal.local_map(np.float64(POINTS) + np.array([2, 0, 0]), (1, 2, 0), frame="map",
                               size=(12, 9), resolution=0.1)  # fmt: skip
    assert np.array_equal(read_map("a/local.yaml").occupancy, wanted.occupancy)


def test_local_says_what_does_not_fit(command, tmp_path):
    path = of_clouds().write(tmp_path, "mcap")
    (tmp_path / "c.csv").write_text("1,1\n")
    (tmp_path / "two.txt").write_text("0 0 0\n0 0 0\n")
    for words_, code, told in [
        (["--cloud", path, "--index", "3"], 2, "/points has 3 messages"),
        (["--cloud", path, "--index", "1", "--all"], 2, "--index: applies to one cloud"),
        (["--cloud", path, "--pose", "0,0,0", "--all"], 2, "--pose: applies to one cloud"),
        (["--cloud", path, "--poses", "two.txt"], 3, "must have a pose for each of 3 clouds"),
        (["--cloud", path, "--topic", "/tf"], 3, "/tf is of type tf2_msgs/msg/TFMessage"),
        (["--cloud", "c.csv", "--pose", "0,0,0", "--all"], 2, "--all: needs a bag"),
        (["--cloud", "c.csv", "--pose", "0,0,0", "--topic", "/p"], 2, "--topic: needs a bag"),
        (["--cloud", "c.csv"], 2, "--pose or --poses is required"),
    ]:
        got, _, err = command("local", *words_, "-o", "out")
        assert (got, told in err, err.count("error: ")) == (code, True, 1), (words_, err)
        assert not (tmp_path / "out").exists()


# info, and the extra


def test_info_lists_topics_transforms_and_uses(command, tmp_path):
    maker = whole(Drive())
    maker.add("/talk", "std_msgs/msg/String", START + 7, words("hello"))
    path = maker.write(tmp_path, "mcap")
    code, out, err = command("info", path)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        str(path),
        "  kind        a folder with a ROS 2 bag",
        "  messages    28 in 1.6 s, from 2023-11-14 22:13:20 UTC",
        "  topics      /scan       sensor_msgs/msg/LaserScan   8  in laser  for build, local",
        "              /talk       std_msgs/msg/String         1",
        "              /tf         tf2_msgs/msg/TFMessage     18            for build, local",
        "              /tf_static  tf2_msgs/msg/TFMessage      1            for build, local",
        "  transforms  map -> odom         9 on /tf",
        "              odom -> base_link   9 on /tf",
        "              base_link -> laser  1 on /tf_static",
        f"  use         mapdeal build {path} --topic /scan -o OUT.yaml",
    ]
    report = json.loads(command("info", path, "--json")[1])
    assert (report["kind"], report["messages"]) == ("bag", 28)
    assert (report["start_ns"], report["end_ns"]) == (START, START + STEPS * FIFTH)
    assert {one["topic"]: one["count"] for one in report["topics"]} == {
        "/scan": 8, "/talk": 1, "/tf": 18, "/tf_static": 1
    }  # fmt: skip


def test_types_are_spelled_as_the_bag_does(command, tmp_path):
    path = whole(Drive()).write(tmp_path, "ros1")
    out = command("info", path)[1]
    assert "/scan       sensor_msgs/LaserScan" in out
    assert "/tf         tf2_msgs/TFMessage" in out
    assert f"mapdeal build {path} --topic /scan -o OUT.yaml" in out
    _, _, err = command("convert", path, "--topic", "/scan", "-o", "m.yaml")
    assert "/scan is of type sensor_msgs/LaserScan; maps and costmaps are of" in err


def test_an_empty_bag_says_so(command, tmp_path):
    path = Maker().write(tmp_path, "mcap")
    code, out, err = command("info", path)
    assert code == 0
    assert "messages    none" in out
    assert "holds no messages" in err
    for words_ in (["build"], ["convert"], ["local", "--cloud"]):
        code, _, err = command(*words_, path, "-o", "out.yaml")
        assert (code, err.count("error: ")) == (3, 1)


@pytest.mark.parametrize("name", ["rosbags", "apsw"])
def test_the_missing_extra_is_one_line(command, tmp_path, monkeypatch, name):
    path = whole(Drive()).write(tmp_path, "ros1")
    write_grid(GRID, "map.npz")
    for module in [one for one in sys.modules if one.partition(".")[0] in ("rosbags", name)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    for words_ in (
        ["info", path],
        ["build", path, "-o", "a.yaml"],
        ["local", "--cloud", path, "--no-images", "-o", "b"],
        ["convert", path, "--topic", "/scan", "-o", "c.yaml"],
        ["convert", "map.npz", "-o", "d.mcap"],
    ):
        code, _, err = command(*words_)
        if name == "apsw" and words_[-1] != "d.mcap":  # reading does without
            assert "needs the extra" not in err
            continue
        assert code == 2
        assert "needs the extra 'bags'" in err
        assert err.endswith("hint: pip install 'mapdeal[bags]'\n")
        assert not (tmp_path / words_[-1]).exists() or words_[0] == "info"


def test_an_extra_without_room_is_not_called_missing(command, tmp_path, monkeypatch):
    def without_room(name):
        raise ImportError("failed to map", name=name, path="backend.so")

    monkeypatch.setattr("mapdeal.bags.reader.import_module", without_room)
    code, _, err = command("info", whole(Drive()).write(tmp_path, "ros1"))
    assert (code, err.splitlines()[0]) == (4, "error: a library cannot be loaded: failed to map")


def test_a_chunk_is_not_called_damaged_for_lack_of_memory(monkeypatch, tmp_path):
    def without_memory(*_):
        raise MemoryError

    monkeypatch.setitem(chunked._EXPANDERS, "lz4", without_memory)
    with pytest.raises(MemoryError):  # and not what comes before it, as of a truncated bag
        chunked.expanded(b"abc", "lz4", 10, tmp_path, partly=True)


def test_a_bag_is_no_map(command, tmp_path):
    path = whole(Drive()).write(tmp_path, "ros1")
    code, _, err = command("inflate", path, "-o", "a.yaml")
    assert code == 3
    assert "is a ROS 1 bag, not a map" in err
    assert "hint: mapdeal info" in err
