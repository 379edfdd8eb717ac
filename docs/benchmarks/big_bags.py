"""Big bags, made fast: few laser scans and transforms among millions of other messages.

    python docs/benchmarks/big_bags.py FOLDER [--megabytes 1000]

writes ``big.bag`` (ROS 1, lz4), ``big.mcap`` (zstd) and ``big.db3``, all with the same messages:
2,000 scans, 4,000 transforms, and 500 bytes of text in each of the others, and then times
``mapdeal build`` and ``mapdeal info`` on them. Nothing of it is kept by git.
"""

import argparse
import sqlite3
import struct
import subprocess
import sys
import time
from pathlib import Path

import lz4.frame
import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START, SECOND = 1_700_000_000, 10**9
SCANS, BEAMS, TALKERS, LETTERS = 2000, 360, 8, 496
LASER, TF, STRING = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"
TYPES = {"/scan": LASER, "/tf": TF, **{f"/talk{k}": STRING for k in range(TALKERS)}}


def stores():
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    ros1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return ros1, get_typestore(Stores.ROS2_HUMBLE)


def messages(store, *, is_ros1, count):
    """Yield time (ns), topic and bytes: a robot that goes round in a room of 12 by 8 m."""
    types = store.types
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    # letters that hardly repeat, so that compressed bags are big, too
    letters = np.random.Generator(np.random.PCG64(1)).integers(97, 123, 1 << 22, dtype=np.uint8)
    pool = letters.tobytes()
    talk = bytes(serialize(types[STRING](data="x" * LETTERS), STRING))
    before, after = talk.split(b"x" * LETTERS)
    every = max(1, count // (3 * SCANS))
    duration = SCANS * SECOND // 10
    for k in range(count):
        moment = START * SECOND + duration * k // count
        if k % every == 0 and k // every < 3 * SCANS:
            number = k // every
            if number % 3 == 2:
                yield moment, "/scan", bytes(serialize(scan(types, is_ros1, moment), LASER))
            else:
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
    x, y, yaw = place(moment)
    if number % 3 == 0:
        x, y, yaw, parent, child = 0.0, 0.0, 0.0, "map", "odom"
    else:
        parent, child = "odom", "laser"
    transform = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=0.0),
        rotation=types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2))
        ),
    )
    stamped = types["geometry_msgs/msg/TransformStamped"](
        header=header(types, is_ros1, moment, parent), child_frame_id=child, transform=transform
    )
    return types[TF](transforms=[stamped])


def write_ros1(path, count):
    """Write a bag of ROS 1 by its records, a chunk at a time."""
    store, _ = stores()
    numbers = {topic: number for number, topic in enumerate(TYPES)}

    def record(op, data, **fields):
        head = b"".join(
            struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
            for name, value in {"op": bytes([op]), **fields}.items()
        )
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    def connection(topic):
        name = TYPES[topic].replace("/msg/", "/")
        text, digest = store.generate_msgdef(TYPES[topic])
        fields = {"topic": topic, "type": name, "md5sum": digest, "message_definition": text}
        data = b"".join(
            struct.pack("<I", len(key) + 1 + len(value.encode())) + f"{key}={value}".encode()
            for key, value in fields.items()
        )
        number = struct.pack("<I", numbers[topic])
        return record(7, data, conn=number, topic=topic.encode())

    with path.open("wb") as file:
        file.write(b"#ROSBAG V2.0\n")
        head = file.tell()
        file.write(bytes(4096))
        infos = []

        def flush(chunk, index):
            at = file.tell()
            data = lz4.frame.compress(bytes(chunk))
            size = struct.pack("<I", len(chunk))
            file.write(record(5, data, compression=b"lz4", size=size))
            counts = b""
            for number, entries in index.items():
                count = struct.pack("<I", len(entries))
                conn = struct.pack("<I", number)
                file.write(record(4, b"".join(entries), ver=b"\1\0\0\0", conn=conn, count=count))
                counts += conn + count
            first = min(entries[0][:8] for entries in index.values())
            last = max(entries[-1][:8] for entries in index.values())
            infos.append(record(6, counts, ver=b"\1\0\0\0", chunk_pos=struct.pack("<Q", at),
                                start_time=first, end_time=last,
                                count=struct.pack("<I", len(index))))  # fmt: skip

        chunk, index = bytearray(), {}
        for moment, topic, data in messages(store, is_ros1=True, count=count):
            stamp = struct.pack("<II", moment // SECOND, moment % SECOND)
            index.setdefault(numbers[topic], []).append(stamp + struct.pack("<I", len(chunk)))
            chunk += record(2, data, conn=struct.pack("<I", numbers[topic]), time=stamp)
            if len(chunk) > 768 * 1024:
                flush(chunk, index)
                chunk, index = bytearray(), {}
        if chunk:
            flush(chunk, index)
        at = file.tell()
        for topic in TYPES:
            file.write(connection(topic))
        file.write(b"".join(infos))
        file.seek(head)
        words = {"index_pos": struct.pack("<Q", at), "conn_count": struct.pack("<I", len(TYPES)),
                 "chunk_count": struct.pack("<I", len(infos))}  # fmt: skip
        short = record(3, b"", **words)
        file.write(record(3, b" " * (4096 - len(short)), **words))


def write_mcap(path, count):
    _, store = stores()
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        channels = {}
        for topic, name in TYPES.items():
            text = store.generate_msgdef(name, ros_version=2)[0]
            schema = writer.register_schema(name, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for moment, topic, data in messages(store, is_ros1=False, count=count):
            writer.add_message(channels[topic], moment, data, moment)
        writer.finish()


def write_sqlite(path, count):
    _, store = stores()
    path.unlink(missing_ok=True)
    db = sqlite3.connect(path)
    db.execute("PRAGMA journal_mode = OFF")
    db.execute(
        "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT "
        "NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    db.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
               "timestamp INTEGER NOT NULL, data BLOB NOT NULL)")  # fmt: skip
    numbers = {topic: number for number, topic in enumerate(TYPES, 1)}
    for topic, number in numbers.items():
        row = (number, topic, TYPES[topic], "cdr", "")
        db.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
    db.executemany(
        "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
        (
            (numbers[topic], moment, data)
            for moment, topic, data in messages(store, is_ros1=False, count=count)
        ),
    )
    db.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    db.commit()
    db.close()


WRITERS = {"big.bag": write_ros1, "big.mcap": write_mcap, "big.db3": write_sqlite}


def main():
    words = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    words.add_argument("folder", type=Path)
    words.add_argument("--megabytes", type=int, default=1000)
    given = words.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for name, write in WRITERS.items():
        path = given.folder / name
        if not path.exists():
            write(path, given.megabytes * 2000)
        for command in (["info"], ["build", "-o", str(given.folder / "map.yaml"), "--force"]):
            line = [sys.executable, "-m", "mapdeal", *command, str(path)]
            started = time.perf_counter()
            done = subprocess.run(
                ["/usr/bin/time", "-f", "%M", *line], capture_output=True, text=True, check=True
            )
            seconds = time.perf_counter() - started
            peak = int(done.stderr.split()[-1]) / 1024
            size = path.stat().st_size / 1e6
            print(f"{name} ({size:.0f} MB) {command[0]}: {seconds:.2f} s, {peak:.0f} MiB at most")


if __name__ == "__main__":
    main()
