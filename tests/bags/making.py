"""Small bags with known contents, in every format, by rosbags and the mcap package."""

import math
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SECOND = 10**9
START = 1_700_000_000 * SECOND

ROS1 = {"ros1": None, "ros1-bz2": "BZ2", "ros1-lz4": "LZ4"}
ROS2 = {
    "sqlite3": (StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite3-message": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "sqlite3-file": (StoragePlugin.SQLITE3, CompressionMode.FILE),
    "mcap": (StoragePlugin.MCAP, CompressionMode.NONE),
    "mcap-chunk": (StoragePlugin.MCAP, CompressionMode.STORAGE),
    "mcap-message": (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "mcap-file": (StoragePlugin.MCAP, CompressionMode.FILE),
}
OF_MCAP = {
    "mcap-lz4": CompressionType.LZ4,
    "mcap-zstd": CompressionType.ZSTD,
    "mcap-plain": CompressionType.NONE,
}
FORMATS = (*ROS1, *ROS2, *OF_MCAP)
"""All of them; the last are single files by the mcap package."""

COSTMAP = {
    "nav2_msgs/msg/Costmap": (
        "std_msgs/Header header\nnav2_msgs/CostmapMetaData metadata\nuint8[] data\n"
    ),
    "nav2_msgs/msg/CostmapMetaData": (
        "builtin_interfaces/Time map_load_time\nbuiltin_interfaces/Time update_time\n"
        "string layer\nfloat32 resolution\nuint32 size_x\nuint32 size_y\n"
        "geometry_msgs/Pose origin\n"
    ),
}
_POINT = (
    "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line"
)
_CUSTOM = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points\n"
)
LIVOX = {
    f"{driver}/msg/{name}": text
    for driver in ("livox_ros_driver", "livox_ros_driver2")
    for name, text in (
        ("CustomPoint", _POINT),
        ("CustomMsg", _CUSTOM),
    )
}  # fmt: skip
OLD_TF = {"tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n"}
TF = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}


class Maker:
    """Messages that are written to bags in any format: functions of a store of types."""

    def __init__(self):
        self.messages = []

    def add(self, topic, name, time, make):
        self.messages.append((time, topic, name, make))

    def write(self, folder, form):
        """Write a bag named bag into a folder; return its path."""
        if form in ROS1:
            return self._write_ros1(Path(folder) / "bag.bag", ROS1[form])
        if form in ROS2:
            return self._write_ros2(Path(folder) / "bag", *ROS2[form])
        return self._write_mcap(Path(folder) / "bag.mcap", OF_MCAP[form])

    def _write_ros1(self, path, compression):
        store = ros1_store()
        writer = Ros1Writer(path)
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression])
        return self._write_all(writer, store, store.serialize_ros1)

    def _write_ros2(self, path, plugin, mode):
        store = ros2_store()
        writer = Writer(path, version=9, storage_plugin=plugin)
        if mode != CompressionMode.NONE:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        return self._write_all(writer, store, store.serialize_cdr)

    def _write_all(self, writer, store, serialize):
        connections = {}
        with writer:
            for time, topic, name, make in self.messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=store)
                writer.write(connections[topic], time, bytes(serialize(make(store), name)))
        return writer.path

    def _write_mcap(self, path, compression, **options):
        store = ros2_store()
        with path.open("wb") as file:
            writer = McapWriter(file, compression=compression, chunk_size=1024, **options)
            writer.start(profile="ros2")
            channels = {}
            for number, (time, topic, name, make) in enumerate(self.messages):
                if topic not in channels:
                    text = store.generate_msgdef(name, ros_version=2)[0]
                    schema = writer.register_schema(name, "ros2msg", text.encode())
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                data = bytes(store.serialize_cdr(make(store), name))
                writer.add_message(channels[topic], time, data, time, number)
            writer.finish()
        return path


def _store(version, texts):
    store = get_typestore(version)
    for name, text in texts.items():
        store.register(get_types_from_msg(text, name))
    return store


def ros1_store():
    return _store(Stores.ROS1_NOETIC, {**TF, **OLD_TF, **LIVOX})


def ros2_store():
    return _store(Stores.ROS2_HUMBLE, {**COSTMAP, **OLD_TF, **LIVOX})


def message(name, **values):
    """Return what makes a message with a store of types; what is not given is 0 or empty."""

    def make(store, name=name, values=values):
        fields = {}
        for field, (kind, of) in store.fielddefs[name][1]:
            value = values.get(field)
            if kind == Nodetype.NAME:
                value = make(store, of, value or {})
            elif kind == Nodetype.BASE:
                value = ("" if of[0] == "string" else 0) if value is None else value
            elif of[0][0] == Nodetype.NAME:
                value = [make(store, of[0][1], one) for one in value]
            elif value is None:
                value = np.zeros(of[1], of[0][1][0])
            fields[field] = value
        return store.types[name](**fields)

    return make


def header(time, frame):
    return {"stamp": stamp(time), "frame_id": frame}


def stamp(time):
    return {"sec": time // SECOND, "nanosec": time % SECOND}


def vector(x, y, z=0.0):
    return {"x": float(x), "y": float(y), "z": float(z)}


def turn(quaternion):
    return dict(zip("xyzw", map(float, quaternion), strict=True))


def pose(x, y, yaw):
    return {"position": vector(x, y), "orientation": turn(of_yaw(yaw))}


def of_yaw(yaw):
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def occupancy(time, cells, resolution, origin, frame="map"):
    cells = np.asarray(cells, np.int8)
    info = {"resolution": resolution, "width": cells.shape[1], "height": cells.shape[0],
            "origin": pose(*origin)}  # fmt: skip
    head = header(time, frame)
    return message("nav_msgs/msg/OccupancyGrid", header=head, info=info, data=cells.ravel())


def costmap(time, cells, resolution, origin, frame="odom"):
    cells = np.asarray(cells, np.uint8)
    info = {"layer": "master", "resolution": resolution, "size_x": cells.shape[1],
            "size_y": cells.shape[0], "origin": pose(*origin)}  # fmt: skip
    head = header(time, frame)
    return message("nav2_msgs/msg/Costmap", header=head, metadata=info, data=cells.ravel())


def scan(time, ranges, *, frame="laser", start=-1.5, step=0.01, limits=(0.1, 20.0), between=0.0):
    return message(
        "sensor_msgs/msg/LaserScan", header=header(time, frame), angle_min=start,
        angle_max=start + step * (len(ranges) - 1), angle_increment=step, time_increment=between,
        scan_time=0.1, range_min=limits[0], range_max=limits[1],
        ranges=np.asarray(ranges, np.float32),
    )  # fmt: skip


def tf(time, *transforms, name="tf2_msgs/msg/TFMessage"):
    """Return a message with transforms: parent, child, x y z, quaternion."""
    made = [
        {"header": header(time, parent), "child_frame_id": child,
         "transform": {"translation": vector(*move), "rotation": turn(quaternion)}}
        for parent, child, move, quaternion in transforms
    ]  # fmt: skip
    return message(name, transforms=made)


def odometry(time, x, y, yaw, frame="odom", child="base_link"):
    return message(
        "nav_msgs/msg/Odometry", header=header(time, frame), child_frame_id=child,
        pose={"pose": pose(x, y, yaw)},
    )  # fmt: skip


def cloud(time, data, fields, *, width, height=1, step, row=None, is_big=False, frame="base_link"):
    """Return a PointCloud2 of bytes; fields are name, offset, datatype."""
    made = [{"name": n, "offset": o, "datatype": d, "count": 1} for n, o, d in fields]
    return message(
        "sensor_msgs/msg/PointCloud2", header=header(time, frame), height=height, width=width,
        fields=made, is_bigendian=is_big, point_step=step,
        row_step=width * step if row is None else row, data=np.frombuffer(bytes(data), np.uint8),
    )  # fmt: skip


def words(text):
    """Return a message of a type that nothing is made of."""
    return message("std_msgs/msg/String", data=text)


def custom(time, points, driver, frame="livox_frame"):
    """Return what makes the message of a Livox lidar."""
    named = [
        {"offset_time": k, "x": x, "y": y, "z": z, "reflectivity": 9, "tag": 1, "line": k % 6}
        for k, (x, y, z) in enumerate(points)
    ]
    return message(f"{driver}/msg/CustomMsg", header=header(time, frame), timebase=time,
                   point_num=len(named), lidar_id=3, points=named)  # fmt: skip
