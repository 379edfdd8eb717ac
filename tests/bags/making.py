"""Small bags with known contents, in every format, by rosbags and the mcap package."""

import math
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
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
IN_MCAP = {"mcap-lz4": CompressionType.LZ4, "mcap-zstd": CompressionType.ZSTD}
IN_MCAP["mcap-plain"] = CompressionType.NONE
FORMATS = (*ROS1, *ROS2, *IN_MCAP)
"""All formats; those of the mcap package are single files."""

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
_POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
_POINT += "uint8 reflectivity\nuint8 tag\nuint8 line"
_CUSTOM = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points\n"
)
LIVOX = {
    f"{driver}/msg/{name}": text for driver in ("livox_ros_driver", "livox_ros_driver2")
    for name, text in (("CustomPoint", _POINT), ("CustomMsg", _CUSTOM))
}  # fmt: skip
OLD_TF = {"tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n"}
TF = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}


class Maker:
    """Messages for bags of any format, as functions that create them from a store of types."""

    def __init__(self):
        self.messages = []

    def add(self, topic, name, time, make):
        self.messages.append((time, topic, name, make))

    def write(self, folder, storage):
        """Write a bag named bag into a folder; return its path."""
        if storage in ROS1:
            return self._write_ros1(Path(folder) / "bag.bag", ROS1[storage])
        if storage in ROS2:
            return self._write_ros2(Path(folder) / "bag", *ROS2[storage])
        return self._write_mcap(Path(folder) / "bag.mcap", IN_MCAP[storage])

    def _write_ros1(self, path, compression):
        store, writer = ros1_store(), Ros1Writer(path)
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression])
        return self._write_all(writer, store, store.serialize_ros1)

    def _write_ros2(self, path, plugin, mode):
        store, writer = ros2_store(), Writer(path, version=9, storage_plugin=plugin)
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
    """Return a function that creates a message from a store of types; missing fields are 0."""

    def make(store, name=name, values=values):
        fields = {}
        for field, (kind, item_type) in store.fielddefs[name][1]:
            value = values.get(field)
            if kind == Nodetype.NAME:
                value = make(store, item_type, value or {})
            elif kind == Nodetype.BASE:
                value = ("" if item_type[0] == "string" else 0) if value is None else value
            elif item_type[0][0] == Nodetype.NAME:
                value = [make(store, item_type[0][1], item) for item in value]
            elif value is None:
                value = np.zeros(item_type[1], item_type[0][1][0])
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
    stamped = [
        {"header": header(time, parent), "child_frame_id": child,
         "transform": {"translation": vector(*translation), "rotation": turn(quaternion)}}
        for parent, child, translation, quaternion in transforms
    ]  # fmt: skip
    return message(name, transforms=stamped)


def odometry(time, x, y, yaw, frame="odom", child="base_link"):
    return message(
        "nav_msgs/msg/Odometry", header=header(time, frame), child_frame_id=child,
        pose={"pose": pose(x, y, yaw)},
    )  # fmt: skip


def cloud(time, data, fields, *, width, height=1, step, row=None, is_big=False, frame="base_link"):
    """Return a PointCloud2 of bytes; fields are name, offset, datatype."""
    named_fields = [{"name": n, "offset": o, "datatype": d, "count": 1} for n, o, d in fields]
    return message(
        "sensor_msgs/msg/PointCloud2", header=header(time, frame), height=height, width=width,
        fields=named_fields, is_bigendian=is_big, point_step=step,
        row_step=width * step if row is None else row, data=np.frombuffer(bytes(data), np.uint8),
    )  # fmt: skip


def words(text):
    """Return a message of a type that mapdeal ignores."""
    return message("std_msgs/msg/String", data=text)


def custom(time, points, driver, frame="livox_frame"):
    lidar_points = [
        {"offset_time": k, "x": x, "y": y, "z": z, "reflectivity": 9, "tag": 1, "line": k % 6}
        for k, (x, y, z) in enumerate(points)
    ]
    return message(f"{driver}/msg/CustomMsg", header=header(time, frame), timebase=time,
                   point_num=len(lidar_points), lidar_id=3, points=lidar_points)  # fmt: skip
