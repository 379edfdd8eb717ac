"""Big bags, made fast: few laser scans and transforms among millions of other messages.

    python docs/benchmarks/big_bags.py FOLDER [--megabytes 1000]

writes ``big.bag`` (ROS 1, lz4), ``big.mcap`` (zstd) and ``big.db3``, all with the same messages:
2,000 scans, 4,000 transforms, and 500 bytes of text in each of the others, and then times
``mapdeal build`` and ``mapdeal info`` on them.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START, SECOND = 1_700_000_000, 10**9
SCANS, BEAMS, TALKERS, LETTERS = 2000, 360, 8, 496
LASER, TF, STRING = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"
TYPES = {"/scan": LASER, "/tf": TF, **{f"/talk{k}": STRING for k in range(TALKERS)}}


def messages(store, *, is_ros1, count):
    """Yield time (ns), topic and bytes: a robot that goes round in a room of 12 by 8 m."""
    types = store.types
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    # letters that hardly repeat, so that compressed bags are big, too
    pool = np.random.default_rng(1).integers(97, 123, 1 << 22, dtype=np.uint8).tobytes()
    talk = bytes(serialize(types[STRING](data="x" * LETTERS), STRING))
    before, after = talk.split(b"x" * LETTERS)
    every = max(1, count // (3 * SCANS))
    for k in range(count):
        moment = START * SECOND + SCANS * SECOND // 10 * k // count
        number, rest = divmod(k, every)
        if rest == 0 and number % 3 == 2 and number < 3 * SCANS:
            yield moment, "/scan", bytes(serialize(scan(types, is_ros1, moment), LASER))
        elif rest == 0 and number < 3 * SCANS:
            yield moment, "/tf", bytes(serialize(moved(types, is_ros1, moment, number), TF))
        else:
            at = k * 4099 % (len(pool) - LETTERS)
            yield moment, f"/talk{k % TALKERS}", before + pool[at : at + LETTERS] + after


def header(types, is_ros1, moment, frame):
    stamp = types["builtin_interfaces/msg/Time"](sec=moment // SECOND, nanosec=moment % SECOND)
    more = {"seq": 0} if is_ros1 else {}
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def place(moment):
    turn = (moment - START * SECOND) / SECOND / 8
    return 2.5 * np.cos(turn), 1.5 * np.sin(turn), turn + np.pi / 2


def scan(types, is_ros1, moment):
    x, y, yaw = place(moment)
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False) + yaw
    with np.errstate(divide="ignore"):
        to_sides = np.where(np.cos(angles) > 0, 6 - x, -6 - x) / np.cos(angles)
        to_ends = np.where(np.sin(angles) > 0, 4 - y, -4 - y) / np.sin(angles)
    return types[LASER](
        header=header(types, is_ros1, moment, "laser"), angle_min=-np.pi, angle_max=np.pi,
        angle_increment=2 * np.pi / BEAMS, time_increment=0.0, scan_time=0.1, range_min=0.05,
        range_max=20.0, ranges=np.minimum(to_sides, to_ends).astype(np.float32),
        intensities=np.zeros(0, np.float32),
    )  # fmt: skip


def moved(types, is_ros1, moment, number):
    x, y, yaw = place(moment) if number % 3 else (0.0, 0.0, 0.0)
    parent, child = ("odom", "laser") if number % 3 else ("map", "odom")
    turn = {"z": float(np.sin(yaw / 2)), "w": float(np.cos(yaw / 2))}
    transform = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=0.0),
        rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, **turn),
    )
    stamped = types["geometry_msgs/msg/TransformStamped"](
        header=header(types, is_ros1, moment, parent), child_frame_id=child, transform=transform
    )
    return types[TF](transforms=[stamped])


def write_ros1(path, count):
    writer = rosbag1.Writer(path)
    writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    write_all(writer, store, is_ros1=True, count=count)


def write_ros2(path, count):
    """Write the file alone, without the folder and metadata.yaml of rosbag2."""
    is_mcap, folder = path.suffix == ".mcap", path.with_suffix(".folder")
    plugin = StoragePlugin.MCAP if is_mcap else StoragePlugin.SQLITE3
    writer = rosbag2.Writer(folder, version=8, storage_plugin=plugin)
    if is_mcap:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    write_all(writer, get_typestore(Stores.ROS2_HUMBLE), is_ros1=False, count=count)
    next(folder.glob(f"*{path.suffix}")).rename(path)
    shutil.rmtree(folder)


def write_all(writer, store, *, is_ros1, count):
    with writer:
        topics = {one: writer.add_connection(one, TYPES[one], typestore=store) for one in TYPES}
        for moment, topic, data in messages(store, is_ros1=is_ros1, count=count):
            writer.write(topics[topic], moment, data)


WRITERS = {"big.bag": write_ros1, "big.mcap": write_ros2, "big.db3": write_ros2}


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    words.add_argument("folder", type=Path)
    words.add_argument("--megabytes", type=int, default=1000)
    given = words.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    print("| bag | MB | command | seconds | peak MiB |\n|---|---|---|---|---|")
    for name, write in WRITERS.items():
        path = given.folder / name
        if not path.exists():
            write(path, given.megabytes * 2000)
        size = path.stat().st_size / 1e6
        for command in (["info"], ["build", "-o", str(given.folder / "map.yaml"), "--force"]):
            # GNU time, as the peak of a child of this large process begins with its own
            line = ["/usr/bin/time", "-f", "%e %M", sys.executable, "-m", "mapdeal", *command, path]
            done = subprocess.run(line, capture_output=True, text=True, check=True)
            seconds, peak = done.stderr.split()[-2:]
            print(f"| {name} | {size:.0f} | {command[0]} | {seconds} | {int(peak) / 1024:.0f} |")
