import json
import math
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer

import mapdeal
from bags import making
from bags.making import SECOND, START, Maker, of_yaw, scan, tf
from drawn import grid_from_text
from mapdeal import Scans, build_map, read_map
from mapdeal.bags import bag as chunked

LASER, TF = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"
pytestmark = pytest.mark.usefixtures("here")
ODOMETRY, MAP = "nav_msgs/msg/Odometry", "nav_msgs/msg/OccupancyGrid"
COSTMAP, CLOUD = "nav2_msgs/msg/Costmap", "sensor_msgs/msg/PointCloud2"
MOUNT = (0.2, -0.1, 0.4)
FIRST_ANGLE, STEP, BEAMS = -1.5, 0.05, 61
SCANS = 8
FIFTH = SECOND // 5
GRID = grid_from_text("..#?\n#...\n?.#.", 0.1)
PUBLISHED = "/global_costmap/costmap"


def product(first, second):
    """Return the pose that one pose has seen from another."""
    c, s = math.cos(first[2]), math.sin(first[2])
    x, y, yaw = second
    return first[0] + c * x - s * y, first[1] + s * x + c * y, first[2] + yaw


def map_to_odom(share):
    return 0.3 + 0.2 * share, -0.2, 0.1 + 0.05 * share


def odom_to_base(share):
    return 1.0 + 0.5 * share, 2.0 + 0.1 * share, 0.2 * share


def robot_at(k, more=0.0):
    """Return where the robot is at scan k, a quarter of the way between transforms."""
    return product(map_to_odom(k + 0.25 + more), odom_to_base(k + 0.25 + more))


class Drive:
    """A robot that drives through a hall of 6 by 4 m, and sees its walls.

    Transforms come every 0.2 s, scans 0.05 s behind them; a transform is linear in between.
    """

    def __init__(self, mount=MOUNT, *, is_flipped=False):
        self.mount, self.is_flipped = mount, is_flipped
        self.angles = np.float64(np.float32(FIRST_ANGLE))
        self.angles = self.angles + np.float64(np.float32(STEP)) * np.arange(BEAMS)
        self.turns = -self.angles if is_flipped else self.angles
        self.times = [START + k * FIFTH for k in range(SCANS + 1)]
        self.poses = [product(robot_at(k), mount) for k in range(SCANS)]
        self.ranges = [self.ranges_at(*pose) for pose in self.poses]

    def ranges_at(self, x, y, yaw):
        c, s = np.cos(yaw + self.turns), np.sin(yaw + self.turns)
        found = np.minimum(
            np.where(c > 0, (7.02 - x) / c, (-0.53 - x) / c),
            np.where(s > 0, (4.01 - y) / s, (0.02 - y) / s),
        )
        return found.astype(np.float32)

    def moving(self, maker, name=TF):
        for k, time in enumerate(self.times):
            for parent, child, (x, y, yaw) in (
                ("map", "odom", map_to_odom(k)), ("odom", "base_link", odom_to_base(k))
            ):  # fmt: skip
                move = tf(time, (parent, child, (x, y, 0), of_yaw(yaw)), name=name)
                maker.add("/tf", name, time, move)

    def mounted(self, maker, frame="laser", turn=None):
        x, y, yaw = self.mount
        if self.is_flipped:  # around the sensor's own x axis
            turn = (math.cos(yaw / 2), math.sin(yaw / 2), 0.0, 0.0)
        move = ("base_link", frame, (x, y, 0.3), turn or of_yaw(yaw))
        maker.add("/tf_static", TF, START, tf(START, move))

    def scans(self, maker, topic="/scan", frame="laser", *, is_timed=True, **options):
        for time, ranges in zip(self.times, self.ranges, strict=False):
            time += FIFTH // 4
            stamp = time if is_timed else 0
            message = scan(stamp, ranges, frame=frame, start=FIRST_ANGLE, step=STEP, **options)
            maker.add(topic, LASER, time, message)

    def full_bag(self, turn=None, **options):
        maker = Maker()
        self.mounted(maker, turn=turn)
        self.moving(maker)
        self.scans(maker, **options)
        return maker

    def map(self, **options):
        return build_map(self.poses, self.turns, np.float64(self.ranges), **options).grid

    def as_scans(self):
        return Scans(self.poses, self.turns, np.float64(self.ranges))


def same(found, expected):
    assert np.array_equal(found.occupancy, expected.occupancy)
    assert found.frame == expected.frame


def same_as_of(found, parts, method="counting"):
    builder = mapdeal.MapBuilder(found.frame, method)
    for part in parts:
        builder.add(part)
    same(found, builder.result().grid)


def bag_of(maker, form="mcap"):
    folder = Path(f"made{len(list(Path().glob('made*')))}").absolute()
    folder.mkdir()
    return maker.write(folder, form)


def contents(path):
    files = [path] if path.is_file() else sorted(path.iterdir())
    return {file.name: file.read_bytes() for file in files}


def built(sh, path, options="", warning=""):
    code, _, err = sh(f"build {path} -o m.yaml {options}")
    assert (code, warning in err, bool(err)) == (0, True, bool(warning)), err
    return read_map("m.yaml")


@pytest.mark.parametrize(
    ("form", "is_flipped"), [("ros1-bz2", False), ("sqlite3", True), ("mcap", False)]
)
def test_a_map_of_a_bag_is_that_of_its_scans(sh, form, is_flipped):
    drive = Drive(is_flipped=is_flipped)
    out = sh.ok(f"build {bag_of(drive.full_bag(), form=form)} -o m.yaml --method counting")
    assert f"{SCANS} scans, {SCANS * BEAMS} beams" in out
    same(read_map("m.yaml"), drive.map(method="counting"))


def test_compared_methods_take_bags(sh):
    drive = Drive()
    assert sh.json(f"build {bag_of(drive.full_bag())} -o all --compare --json")["scans"] == SCANS
    same_as_of(read_map("all/counting.yaml"), [drive.as_scans()])


def test_old_transforms_are_taken_and_frames_may_begin_with_a_slash(sh):
    drive, maker = Drive(), Maker()
    old = "tf/msg/tfMessage"
    drive.moving(maker, name=old)
    x, y, yaw = MOUNT
    for time in drive.times:  # as before there was /tf_static
        move = ("/base_link", "/laser", (x, y, 0), of_yaw(yaw))
        maker.add("/tf", old, time, tf(time, move, name=old))
    drive.scans(maker, frame="/laser")
    same(built(sh, bag_of(maker, "ros1"), "--topic scan"), drive.map())


def test_scans_outside_of_the_transforms_are_left_out_and_counted(sh):
    drive = Drive()
    maker = drive.full_bag()
    first, last = drive.times[2], drive.times[6]
    maker.messages = [m for m in maker.messages if m[1] != "/tf" or first <= m[0] <= last]
    left_out = "4 of 8 scans are left out: where laser was is known from 1700000000.4"
    found = built(sh, bag_of(maker), warning=f"{left_out}00 to 1700000001.2")
    drive.poses, drive.ranges = drive.poses[2:6], drive.ranges[2:6]
    same(found, drive.map())


def test_assumptions_about_a_bag_are_warned_of_and_change_no_map(sh):
    drive = Drive()
    both_kinds = drive.full_bag()
    stale = tf(drive.times[4], ("odom", "base_link", (9, 9, 0), (0, 0, 0, 1)))
    both_kinds.add("/tf_static", TF, drive.times[4], stale)
    for maker, warning in (
        (both_kinds, "odom -> base_link is both static and dynamic: the more frequent kind"),
        (drive.full_bag(is_timed=False), "8 scans have no time: that of their recording is taken"),
    ):
        same(built(sh, bag_of(maker), "--force", warning=warning), drive.map())


def test_two_scanners_make_one_map(sh):
    front, rear = Drive(), Drive(mount=(-0.3, 0.1, 3.0), is_flipped=True)
    maker = front.full_bag()
    rear.mounted(maker, "rear")
    rear.scans(maker, "/back", "rear")
    path = bag_of(maker)
    found = built(sh, path, "--topic /back --topic /scan --method counting")
    same_as_of(found, [front.as_scans(), rear.as_scans()])
    err = sh.err(f"build {path} -o n.yaml", 3)
    assert "has 2 topics of laser scans" in err
    assert "--topic names one of /back (sensor_msgs/msg/LaserScan), /scan" in err


def test_a_sensor_that_leans_sees_less_far_and_beyond_10_degrees_nothing(sh):
    drive = Drive(mount=(*MOUNT[:2], 0))
    less, more = (math.radians(degrees) / 2 for degrees in (8, 12))
    maker = drive.full_bag(turn=(0, math.sin(less), 0, math.cos(less)))
    across, along = np.cos(drive.angles) * math.cos(2 * less), np.sin(drive.angles)
    reach = np.float64(drive.ranges) * np.hypot(across, along)
    visible = Scans(drive.poses, np.arctan2(along, across), reach)
    same_as_of(built(sh, bag_of(maker), "--method counting"), [visible])
    maker = drive.full_bag(turn=(0, math.sin(more), 0, math.cos(more)))
    err = sh.err(f"build {bag_of(maker)} -o b.yaml", 3)
    assert "8 of 8 scans are left out: their sensor leans by more than 10 degrees" in err


def test_odometry_serves_where_transforms_do_not_lead(sh):
    drive, maker = Drive(), Maker()
    drive.mounted(maker)
    for k, time in enumerate(drive.times):
        maker.add("/odom", ODOMETRY, time, making.odometry(time, *odom_to_base(k)))
    drive.scans(maker)
    warning = "no transforms lead to map: the map is made in odom, with whatever its odometry"
    path = bag_of(maker, "ros1-lz4")
    found = built(sh, path, warning=warning)
    drive.poses = [product(odom_to_base(k + 0.25), MOUNT) for k in range(SCANS)]
    same(found, drive.map())
    err = sh.err(f"build {path} -o n.yaml --fixed-frame map", 3)
    assert "no transforms lead from 'map' to 'laser': frames are base_link, laser, odom" in err


def test_poses_of_a_file_and_a_mount_stand_for_transforms(sh):
    drive, maker = Drive(), Maker()
    drive.scans(maker)
    path = bag_of(maker)
    err = sh.err(f"build {path} -o m.yaml", 3)
    assert "no transforms lead from 'map' to 'laser': there are none" in err
    assert "hint: --poses FILE" in err
    for name, poses in (("sensor", drive.poses), ("base", map(robot_at, range(SCANS)))):
        with open(f"{name}.txt", "w") as file:
            for time, (x, y, yaw) in zip(drive.times, poses, strict=False):
                turn = f"{math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}"
                file.write(f"{(time + FIFTH // 4) / 1e9:.9f} {x!r} {y!r} 0 0 0 {turn}\n")
    mount = "--mount " + ",".join(map(str, MOUNT))
    message = "sensor.txt is taken for the poses of laser"
    for options, words in (("--poses sensor.txt", message), (f"--poses base.txt {mount}", "")):
        # times in text are as good as a float64 of seconds, about 0.2 microseconds
        found = built(sh, path, f"{options} --force", words).occupancy
        assert np.count_nonzero(found != drive.map().occupancy) <= 3
    Path("flat.txt").write_text("0 0 0\n")
    assert "has poses without times" in sh.err(f"build {path} -o o.yaml --poses flat.txt", 3)
    drive.scans(maker, "/back", "rear")
    both = f"build {bag_of(maker)} --topic scan --topic back -o p.yaml --poses base.txt"
    message = "no transforms lead from base_link to laser, rear: whose poses are they?"
    assert message in sh.err(both, 3)
    assert "--mount: applies to one sensor, and there are" in sh.err(f"{both} {mount}", 2)


def test_each_beam_has_the_pose_of_its_own_time(sh):
    """The same beams, one by one, with poses that are interpolated here."""
    drive, between = Drive(), 0.002
    found = built(sh, bag_of(drive.full_bag(between=between)), "--deskew --method counting")
    step = round(float(np.float32(between)) * 1e9) / FIFTH
    beams = []
    for m, angle in enumerate(drive.angles):
        poses = [product(robot_at(k, m * step), MOUNT) for k in range(SCANS)]
        beams.append(Scans(poses, [angle], [[ranges[m]] for ranges in drive.ranges]))
    same_as_of(found, beams)
    assert not np.array_equal(found.occupancy, drive.map(method="counting").occupancy)
    warning = "no scan has a time between beams: --deskew has no effect"
    built(sh, bag_of(drive.full_bag()), "--deskew --force", warning)


def of_maps():
    maker = Maker()
    older = np.where(GRID.occupancy == 100, 0, GRID.occupancy)
    maker.add("/map", MAP, START, making.occupancy(START, older, 0.1, GRID.origin))
    maker.add("/map", MAP, START + 5, making.occupancy(START + 5, GRID.occupancy, 0.1, GRID.origin))
    published = making.occupancy(START, [[0, 50, 99], [100, -1, 1]], 0.25, (1, 2, 0))
    maker.add(PUBLISHED, MAP, START, published)
    raw = making.costmap(START, [[0, 253, 254, 255]], 0.25, (1, 2, 0.5))
    maker.add("/costmap_raw", COSTMAP, START, raw)
    return maker


def test_the_last_map_of_a_topic_is_converted_by_default(sh):
    path = bag_of(of_maps(), form="sqlite3")
    line = f"convert {path} --topic map"
    sh.ok(f"{line} -o m.yaml")
    found = read_map("m.yaml")
    np.testing.assert_array_equal(found.occupancy, GRID.occupancy)
    assert found.resolution == 0.1
    np.testing.assert_allclose(found.origin, GRID.origin, atol=1e-15)
    sh.ok(f"{line} -o n.npz --index 0")
    assert not (read_map("n.npz").occupancy == 100).any()
    sh.ok(f"{line} -o o.npz --index -1")
    assert sh.ok(f"{line} --all -o maps") == f"maps: 2 of {path}\n"
    assert set(contents(Path("maps"))) == {"0000.pgm", "0000.yaml", "0001.pgm", "0001.yaml"}
    for name in ("o.npz", "maps/0001.yaml"):
        np.testing.assert_array_equal(read_map(name).occupancy, GRID.occupancy)
    assert sh(f"{line} --all -o maps")[0] == 4


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("words", "scale", "cost"), [
    (PUBLISHED, "occupancy", [[0, 50, 99], [100, -1, 1]]),
    ("/map --read-as costs", "occupancy", GRID.occupancy.tolist()),
    ("/costmap_raw", "costmap2d", [[0, 253, 254, 255]]),
])  # fmt: skip
def test_costs_keep_their_scale_by_default(sh, words, scale, cost):
    path = bag_of(of_maps())
    sh(f"convert {path} --topic {words} -o c.npz")
    found = read_map("c.npz")
    assert (found.scale, found.cost.tolist()) == (scale, cost)
    sh(f"convert {path} --topic {PUBLISHED} --read-as map -o m.npz")
    assert read_map("m.npz").kind == "occupancy grid"


@pytest.fixture
def own(here):
    mapdeal.write_map("map.npz", GRID)
    costs = np.array([[0, 100, 253], [254, 255, 1]], np.uint8)
    mapdeal.write_map("c.npz", mapdeal.Costmap(costs, 0.25, (1, 2, 0.5)))
    return read_map("c.npz")


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize("suffix", ["mcap", "db3", "bag"])
def test_a_map_in_a_bag_is_read_back_by_others(sh, here, suffix):
    path = here / f"out.{suffix}"
    line = f"convert map.npz -o out.{suffix} --topic robot/map --frame-id world"
    sh.ok(line)
    with AnyReader([path]) as bag:
        ((connection, time, data),) = bag.messages()
        message = bag.deserialize(data, connection.msgtype)
        qos = getattr(connection.ext, "offered_qos_profiles", None)
        assert getattr(connection.ext, "latching", 1) == 1
    assert (connection.topic, connection.msgtype, time) == ("/robot/map", MAP, SECOND)
    if qos is not None:
        assert [profile.durability.name for profile in qos] == ["TRANSIENT_LOCAL"]
    assert message.header.frame_id == "world"
    assert message.data.tolist() == GRID.occupancy.ravel().tolist()
    assert (message.info.height, message.info.width) == GRID.shape
    assert message.info.resolution == np.float32(0.1)
    place, turn = message.info.origin.position, message.info.origin.orientation
    assert (place.x, place.y) == GRID.origin[:2]
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(GRID.origin[2], abs=1e-15)
    sh.ok(f"convert {path} -o back.npz")
    back = read_map("back.npz")
    np.testing.assert_array_equal(back.occupancy, GRID.occupancy)
    assert back.resolution == 0.1
    assert sh(line)[0] == 4  # it exists
    before = contents(path)
    sh.ok(f"{line} --force")
    assert contents(path) == before
    assert not list(here.glob(".*"))


@pytest.mark.usefixtures("own")
def test_an_mcap_file_is_read_by_the_package_of_its_makers_with_all_checksums(sh):
    sh.ok("convert map.npz -o out.mcap")
    with open("out.mcap", "rb") as file:
        ((schema, channel, message),) = make_reader(file, validate_crcs=True).iter_messages()
    assert (schema.name, schema.encoding, channel.topic) == (MAP, "ros2msg", "/map")
    decoded = making.ros2_store().deserialize_cdr(message.data, MAP)
    assert decoded.data.tolist() == GRID.occupancy.ravel().tolist()
    with open("out.mcap", "rb") as file:
        records = StreamReader(file, emit_chunks=True, validate_crcs=True).records
        by_type = {type(record).__name__: record for record in records}
    assert by_type["Chunk"].uncompressed_crc
    assert by_type["DataEnd"].data_section_crc
    assert by_type["Footer"].summary_crc


def test_costs_become_the_message_of_their_scale(sh, own):
    sh.ok("convert c.npz -o c.mcap")
    sh.ok("convert c.mcap -o back.npz")
    back = read_map("back.npz")
    assert (back.scale, back.cost.tolist()) == ("costmap2d", own.cost.tolist())
    assert "ROS 1 publishes costs as 0 to 100" in sh.err("convert c.npz -o c.bag")
    sh("convert c.bag -o published.npz")
    published, expected = read_map("published.npz"), own.to_occupancy().occupancy.tolist()
    assert (published.scale, published.cost.tolist()) == ("occupancy", expected)


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize("more", ["", "--force"])
def test_a_folder_with_a_recording_of_others_is_left_alone(sh, more):
    recorded = bag_of(Drive().full_bag(), form="sqlite3").rename("rec.db3")
    (recorded / "bag.db3").rename(recorded / "rec_0.db3")
    before = contents(recorded)
    err = sh.err(f"convert map.npz -o rec.db3 {more}", 4)
    assert "is a folder with more than the bag of a map in it: rec_0.db3" in err
    assert contents(recorded) == before


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize("name", ["a%41.db3", "a?b#c.db3", "a b.mcap", "ä.bag"])
def test_any_name_is_written_and_read_back(sh, name):
    sh.ok(f"convert map.npz -o '{name}'")
    sh.ok(f"convert '{name}' -o back.npz")
    np.testing.assert_array_equal(read_map("back.npz").occupancy, GRID.occupancy)


@pytest.mark.usefixtures("own")
def test_a_database_that_cannot_be_written_is_one_error(sh, monkeypatch):
    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr(Writer, "write", full)
    err = sh.err("convert map.npz -o a.db3", 4)
    assert err == "error: a.db3: cannot be written: database or disk is full\n"
    assert not Path("a.db3").exists()


HANGING = (-0.5, 0.1, 1.0)
POINTS = np.array([[1, 0.5, 0.2], [2, -0.75, 1.5], [np.nan, 0, 0], [0.4, 3, -1]], np.float32)
WINDOW = "--size 12,9 --resolution 0.1 --no-images"


def of_clouds(frame="lidar"):
    """Return a bag with three clouds of a sensor that hangs upside down behind the robot."""
    drive, maker = Drive(), Maker()
    drive.moving(maker)
    move = ("base_link", "lidar", HANGING, (1.0, 0.0, 0.0, 0.0))
    maker.add("/tf_static", TF, START, tf(START, move))
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    for k, time in enumerate(drive.times[:3]):
        time += FIFTH // 4
        data = (POINTS + np.float32([k, 0, 0])).tobytes()
        message = making.cloud(time, data, fields, width=4, step=12, frame=frame)
        maker.add("/points", CLOUD, time, message)
    return maker


def as_robot_sees(k):
    return (np.float64(POINTS) + np.array([k, 0, 0])) * [1, -1, -1] + HANGING


def same_window(folder, points, pose, **options):
    expected = mapdeal.local_map(points, pose, size=(12, 9), resolution=0.1, **options)
    found = read_map(f"{folder}/local.yaml")
    assert np.array_equal(found.occupancy, expected.occupancy)
    np.testing.assert_allclose(found.origin, expected.origin, atol=1e-9)


@pytest.mark.filterwarnings("ignore")
def test_a_cloud_is_brought_to_the_robot_and_the_robot_to_the_map(sh):
    line = f"local --cloud {bag_of(of_clouds(), form='ros1')} {WINDOW} --max-height 1.2"
    assert sh(f"{line} -o out")[0] == 0
    same_window("out", as_robot_sees(2), robot_at(2), max_height=1.2)
    sh(f"{line} --index 0 --pose 1,2,0.5 -o own")
    same_window("own", as_robot_sees(0), (1, 2, 0.5), max_height=1.2)
    options = json.loads(Path("out/manifest.json").read_text())["options"]
    assert (options["topic"], options["message"]) == ("/points", "2")


@pytest.mark.filterwarnings("ignore")
def test_a_bag_is_a_sequence(sh):
    line = f"local --cloud {bag_of(of_clouds())} {WINDOW}"
    assert "seq: 3 done, 0 unchanged, 0 failed" in sh(f"{line} --all -o seq")[1]
    for k in range(3):
        same_window(f"seq/{k:04}", as_robot_sees(k), robot_at(k))
        np.savetxt(f"{k}.csv", as_robot_sees(k)[[0, 1, 3]], delimiter=",")
    assert "0 done, 3 unchanged" in sh(f"{line} --all -o seq")[1]
    np.savetxt("poses.txt", [robot_at(k) for k in range(3)], fmt="%.17g")
    sh(f"{line} --keep 2 -o kept")
    files = "--cloud 0.csv --cloud 1.csv --cloud 2.csv"
    sh(f"local {files} --poses poses.txt {WINDOW} --keep 2 -o files")
    sh(f"{line} --poses poses.txt -o posed")
    for first, second in (("kept", "files"), ("posed", "seq")):
        for k in range(3):
            maps = [read_map(f"{name}/{k:04}/local.yaml") for name in (first, second)]
            assert np.array_equal(maps[0].occupancy, maps[1].occupancy)


@pytest.mark.filterwarnings("ignore")
def test_scans_are_clouds(sh):
    drive = Drive()
    sh(f"local --cloud {bag_of(drive.full_bag())} --index 3 {WINDOW} -o out")
    points = np.stack([np.cos(drive.angles), np.sin(drive.angles)], 1)
    points *= np.float64(drive.ranges[3])[:, np.newaxis]
    c, s = math.cos(MOUNT[2]), math.sin(MOUNT[2])
    same_window("out", points @ np.array([[c, s], [-s, c]]) + MOUNT[:2], robot_at(3))


@pytest.mark.filterwarnings("ignore")
def test_points_of_the_map_stay_where_they_are(sh):
    maker = of_clouds(frame="map")
    maker.messages = [entry for entry in maker.messages if entry[1] == "/points"]
    line = f"local --cloud {bag_of(maker)} --pose 1,2,0 {WINDOW} -o a"
    assert "the points of /points are in frame map" in sh.err(line, 2)
    sh(f"{line} --frame map")
    same_window("a", np.float64(POINTS) + np.array([2, 0, 0]), (1, 2, 0), frame="map")


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    """Inputs of all kinds, and bags of scans, maps and clouds."""
    folder = tmp_path_factory.mktemp("odd")
    maps = of_maps()
    maps.messages.pop()  # ROS 1 has no such message
    for name, maker in (("scans", Drive().full_bag()), ("maps", maps), ("clouds", of_clouds())):
        (folder / name).mkdir()
        maker.write(folder / name, "ros1").rename(folder / f"{name}.bag")
    mapdeal.write_map(folder / "map.npz", GRID)
    mapdeal.write_map(folder / "field.npz", mapdeal.esdf(GRID))
    for name, text in (("a.log", ""), ("c.csv", "1,1\n"), ("two.txt", "0 0 0\n0 0 0\n")):
        (folder / name).write_text(text)
    (folder / "early.bag").write_bytes(b"#ROSRECORD V1.2\n" + bytes(30))
    return folder


LAST = "convert maps.bag --topic /map -o o"
CLOUDS, ONE_CLOUD = "local -o o --cloud clouds.bag", "local -o o --cloud c.csv --pose 0,0,0"


@pytest.mark.parametrize(("code", "line", "message"), [
    *((2, f"build a.log -o o.yaml {option}", f"{option.split()[0]}: needs a bag for LOG")
      for option in ("--topic /scan", "--deskew", "--mount 1,2,3", "--fixed-frame m")),
    (2, "build scans.bag -o o.yaml --flip-y", "--flip-y: does not apply to bags"),
    (3, "build scans.bag -o o.yaml --mount 1,2,3", "already give the pose of laser on base_link"),
    (3, "inflate scans.bag -o o.yaml", "is a ROS 1 bag, not a map"),
    (3, "convert scans.bag --topic /scan -o o.yaml", "is of type sensor_msgs/LaserScan; maps and"),
    (2, "convert field.npz -o o.mcap", "ROS has no message"),
    (2, "convert map.npz -o o.mcap --mode raw", "applies to pixels"),
    (2, "convert map.npz -o o.npz --topic /map", "--topic: applies to bags"),
    (2, "convert map.npz -o o.npz --index 1", "--index: applies to reading bags"),
    (2, "convert map.npz -o o.npz --frame-id m", "--frame-id: applies to writing bags"),
    (2, "convert map.npz --all -o o --topic /map", ""),
    (3, "convert maps.bag -o o.npz", "topics of maps and costmaps"),
    (2, f"{LAST}.npz --index 2", "/map has 2 messages: 0 to 1, or -1 to -2, got 2"),
    *((2, f"{LAST} --all {more}", "") for more in ("--index 1", "--mode raw", "--image a.png")),
    *((3, f"{line} early.bag", "is a bag of version 1.2; 2.0 is read")
      for line in ("info", "build -o o.yaml", "local -o o --cloud")),
    *((2, f"convert map.npz -o o.mcap --topic '{name}'", "--topic: must be the name of a")
      for name in ("", "/", "//map", "/1map", "/map/", "/a-b", "/mäp", "/a b")),
    *((2, f"convert map.npz -o o.mcap --frame-id '{name}'", "--frame-id: must be the name of a")
      for name in ("", "/map", "a\nb")),
    (2, f"{CLOUDS} --index 3", "/points has 3 messages"),
    (2, f"{CLOUDS} --index 1 --all", "--index: applies to one cloud"),
    (2, f"{CLOUDS} --pose 0,0,0 --all", "--pose: applies to one cloud"),
    (3, f"{CLOUDS} --poses two.txt", "must have a pose for each of 3 clouds"),
    (3, f"{CLOUDS} --topic /tf", "/tf is of type tf2_msgs/TFMessage"),
    (2, f"{ONE_CLOUD} --all", "--all: needs a bag"),
    (2, f"{ONE_CLOUD} --topic /p", "--topic: needs a bag"),
    (2, "local -o o --cloud c.csv", "--pose or --poses is required"),
])  # fmt: skip
def test_what_is_refused_is_one_line(sh, odd, monkeypatch, code, line, message):
    monkeypatch.chdir(odd)
    err = sh.err(line, code)
    assert message in err
    assert err.count("error: ") == 1
    assert not list(odd.glob("o*"))


def test_a_bag_with_nothing_in_it_says_so(sh):
    path = bag_of(Maker())
    code, out, err = sh(f"info {path}")
    assert (code, "messages    none" in out, "holds no messages" in err) == (0, True, True)
    for line in ("build -o out.yaml", "convert -o out.yaml", "local -o out --cloud"):
        assert sh.err(f"{line} {path}", 3).count("error: ") == 1
    maker = Maker()
    maker.add("/map", MAP, START, making.occupancy(START, [[-1, -1]], 0.1, (0, 0, 0)))
    assert sh.err(f"convert {bag_of(maker)} -o m.yaml").endswith(": every cell is unknown\n")


def test_info_lists_topics_transforms_and_uses(sh):
    maker = Drive().full_bag()
    maker.add("/talk", "std_msgs/msg/String", START + 7, making.words("hello"))
    path = bag_of(maker)
    lines = sh.ok(f"info {path}").splitlines()
    assert lines[1] == "  kind        a folder with a ROS 2 bag"
    assert lines[4] == "              /talk       std_msgs/msg/String         1"
    assert lines[7:] == [
        "  transforms  map -> odom         9 on /tf",
        "              odom -> base_link   9 on /tf",
        "              base_link -> laser  1 on /tf_static",
        f"  use         mapdeal build {path} --topic /scan -o OUT.yaml",
    ]
    report = sh.json(f"info {path} --json")
    assert (report["start_ns"], report["end_ns"]) == (START, START + SCANS * FIFTH)
    assert [topic["count"] for topic in report["topics"]] == [8, 1, 18, 1]
    # types are spelled as the bag does
    assert "/tf         tf2_msgs/TFM" in sh.ok(f"info {bag_of(Drive().full_bag(), form='ros1')}")


def without(monkeypatch, *names):
    """Make imports of packages fail, as where they are not installed."""
    for module in [name for name in sys.modules if name.partition(".")[0] in (*names, "rosbags")]:
        monkeypatch.delitem(sys.modules, module)
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize("name", ["rosbags", "apsw"])
def test_without_the_extra_bags_are_read_and_not_written(sh, monkeypatch, name):
    paths = [bag_of(Drive().full_bag(), form=form) for form in ("ros1", "mcap", "sqlite3")]
    lines = [f"info {path} --json" for path in paths]
    path = bag_of(Drive().full_bag(), form="ros1-lz4")
    described = [sh.ok(line) for line in lines]
    maps = [built(sh, path, "--force") for path in paths]
    without(monkeypatch, name, "lz4", "backports")
    assert [sh.ok(line) for line in lines] == described
    for bag, grid in zip(paths, maps, strict=True):
        np.testing.assert_array_equal(built(sh, bag, "--force").occupancy, grid.occupancy)
    code, out, err = sh(f"info {path}")
    assert (code, "/scan       sensor_msgs/LaserScan" in out) == (0, True)
    assert f"{path}: needs the extra 'bags' for frames and transforms" in err
    assert "needs the extra 'bags'" in sh.err(f"build {path} -o b.npz", 2)
    err = sh.err("convert map.npz -o a.mcap", 2)
    assert "needs the extra 'bags'" in err
    assert err.endswith("hint: pip install 'rosbags>=0.11'\n")
    assert not list(Path().glob("a.*"))


def test_a_chunk_is_not_called_damaged_for_lack_of_memory(monkeypatch, here):
    def without_memory(*_):
        raise MemoryError

    monkeypatch.setitem(chunked._EXPANDERS, "lz4", without_memory)
    with pytest.raises(MemoryError):  # and no MalformedInputError of a damaged bag
        chunked.decompress(b"abc", "lz4", 10, here, partly=True)
