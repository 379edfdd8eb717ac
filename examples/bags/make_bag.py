"""Write office.mcap: the drive of the example log as a robot would have recorded it.

Needs the extra bags. Run from the project's folder:

    python examples/bags/make_bag.py
"""

import math
import tempfile
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import mapdeal

HERE = Path(__file__).parent
LOG = HERE.parent / "logs" / "office.log"
MAP = HERE.parent / "maps" / "office.yaml"

START = 1_700_000_000 * 10**9
MOUNT = (0.12, 0.0, 0.05)
"""x, y and yaw of the laser on the robot; it hangs upside down."""

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types


def _product(first, second):
    c, s = math.cos(first[2]), math.sin(first[2])
    x, y, yaw = second
    return first[0] + c * x - s * y, first[1] + s * x + c * y, first[2] + yaw


def _inverse(pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y, yaw = pose
    return -c * x - s * y, s * x - c * y, -yaw


def _map_to_odom(seconds):
    """Return what a SLAM corrects: odometry drifts slowly."""
    return 0.4 + 0.01 * seconds, -0.2 + 0.004 * seconds, 0.1 - 0.002 * seconds


def _scans():
    """Yield seconds, the laser's pose and its ranges."""
    for line in LOG.read_text().splitlines():
        words = line.split()
        if words[0] == "FLASER":
            count = int(words[1])
            ranges = np.array(words[2 : 2 + count], float)
            pose = tuple(map(float, words[2 + count : 5 + count]))
            yield float(words[-1]), pose, np.where(ranges > 80, np.inf, ranges)


def _stamp(time):
    return TYPES["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)


def _header(time, frame):
    return TYPES["std_msgs/msg/Header"](stamp=_stamp(time), frame_id=frame)


def _quaternion(x, y, z, w):
    return TYPES["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _transform(time, parent, child, pose, *, is_flipped=False):
    x, y, yaw = pose
    c, s = math.cos(yaw / 2), math.sin(yaw / 2)
    turn = _quaternion(c, s, 0.0, 0.0) if is_flipped else _quaternion(0.0, 0.0, s, c)
    move = TYPES["geometry_msgs/msg/Vector3"](x=x, y=y, z=0.0)
    made = TYPES["geometry_msgs/msg/TransformStamped"](
        header=_header(time, parent),
        child_frame_id=child,
        transform=TYPES["geometry_msgs/msg/Transform"](translation=move, rotation=turn),
    )
    return TYPES["tf2_msgs/msg/TFMessage"](transforms=[made])


def _laser_scan(time, ranges):
    step = math.pi / 180
    return TYPES["sensor_msgs/msg/LaserScan"](
        header=_header(time, "laser"),
        angle_min=math.pi / 2 - 179 * step,
        angle_max=math.pi / 2,
        angle_increment=step,
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.05,
        range_max=30.0,
        ranges=ranges[::-1].astype(np.float32),  # clockwise, since it hangs upside down
        intensities=np.zeros(0, np.float32),
    )


def _occupancy_grid(time):
    grid = mapdeal.read_map(MAP)
    x, y, yaw = grid.origin
    origin = TYPES["geometry_msgs/msg/Pose"](
        position=TYPES["geometry_msgs/msg/Point"](x=x, y=y, z=0.0),
        orientation=_quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
    )
    height, width = grid.shape
    info = TYPES["nav_msgs/msg/MapMetaData"](
        map_load_time=_stamp(time), resolution=grid.resolution, width=width, height=height,
        origin=origin,
    )  # fmt: skip
    return TYPES["nav_msgs/msg/OccupancyGrid"](
        header=_header(time, "map"), info=info, data=grid.occupancy.ravel()
    )


def _messages():
    """Yield time, topic, type and message, in the order of time."""
    tf, laser = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/LaserScan"
    mount = _transform(START, "base_link", "laser", MOUNT, is_flipped=True)
    yield START, "/map", "nav_msgs/msg/OccupancyGrid", _occupancy_grid(START)
    yield START, "/tf_static", tf, mount
    for seconds, pose, ranges in _scans():
        time = START + round(seconds * 1e9)
        correction = _map_to_odom(seconds)
        base = _product(_inverse(correction), _product(pose, _inverse(MOUNT)))
        yield time, "/tf", tf, _transform(time, "map", "odom", correction)
        yield time, "/tf", tf, _transform(time, "odom", "base_link", base)
        yield time, "/scan", laser, _laser_scan(time, ranges)


def main() -> None:
    """Write the bag."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "office"
        writer = Writer(bag, version=8, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for time, topic, name, message in _messages():
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=STORE)
                writer.write(connections[topic], time, STORE.serialize_cdr(message, name))
        (HERE / "office.mcap").write_bytes((bag / "office.mcap").read_bytes())


if __name__ == "__main__":
    main()
