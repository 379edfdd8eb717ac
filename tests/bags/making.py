"""Small bags with known contents, in every format, by rosbags and the mcap package."""

import math
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
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
OLD_TF = {"tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n"}
TF = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}


class Maker:
    """Messages that are written to bags in any format.

    Messages are functions of a dictionary of types and of whether they are for ROS 1.
    """

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
        with writer:
            self._write_all(writer, store, store.serialize_ros1, is_ros1=True)
        return path

    def _write_ros2(self, path, plugin, mode):
        store = ros2_store()
        writer = Writer(path, version=9, storage_plugin=plugin)
        if mode != CompressionMode.NONE:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            self._write_all(writer, store, store.serialize_cdr, is_ros1=False)
        return path

    def _write_all(self, writer, store, serialize, *, is_ros1):
        connections = {}
        for time, topic, name, make in self.messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            message = make(store.types, is_ros1)
            writer.write(connections[topic], time, bytes(serialize(message, name)))

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
                data = bytes(store.serialize_cdr(make(store.types, False), name))
                writer.add_message(channels[topic], time, data, time, number)
            writer.finish()
        return path


def ros1_store():
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in {**TF, **OLD_TF}.items():
        store.register(get_types_from_msg(text, name))
    return store


def ros2_store():
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in {**COSTMAP, **OLD_TF}.items():
        store.register(get_types_from_msg(text, name))
    return store


def stamp(types, time):
    return types["builtin_interfaces/msg/Time"](sec=time // SECOND, nanosec=time % SECOND)


def header(types, is_ros1, time, frame):
    more = {"seq": 0} if is_ros1 else {}
    return types["std_msgs/msg/Header"](stamp=stamp(types, time), frame_id=frame, **more)


def pose(types, x, y, quaternion, z=0.0):
    return types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=turn(types, quaternion),
    )


def turn(types, quaternion):
    x, y, z, w = map(float, quaternion)
    return types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def of_yaw(yaw):
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def occupancy(time, cells, resolution, origin, frame="map"):
    cells = np.asarray(cells, np.int8)

    def make(types, is_ros1):
        info = types["nav_msgs/msg/MapMetaData"](
            map_load_time=stamp(types, time), resolution=resolution, width=cells.shape[1],
            height=cells.shape[0], origin=pose(types, *origin[:2], of_yaw(origin[2])),
        )  # fmt: skip
        head = header(types, is_ros1, time, frame)
        return types["nav_msgs/msg/OccupancyGrid"](header=head, info=info, data=cells.ravel())

    return make


def costmap(time, cells, resolution, origin, frame="odom"):
    cells = np.asarray(cells, np.uint8)

    def make(types, is_ros1):
        info = types["nav2_msgs/msg/CostmapMetaData"](
            map_load_time=stamp(types, time), update_time=stamp(types, time), layer="master",
            resolution=resolution, size_x=cells.shape[1], size_y=cells.shape[0],
            origin=pose(types, *origin[:2], of_yaw(origin[2])),
        )  # fmt: skip
        head = header(types, is_ros1, time, frame)
        return types["nav2_msgs/msg/Costmap"](header=head, metadata=info, data=cells.ravel())

    return make


def scan(time, ranges, *, frame="laser", start=-1.5, step=0.01, limits=(0.1, 20.0), between=0.0):
    ranges = np.asarray(ranges, np.float32)

    def make(types, is_ros1):
        return types["sensor_msgs/msg/LaserScan"](
            header=header(types, is_ros1, time, frame), angle_min=start,
            angle_max=start + step * (len(ranges) - 1), angle_increment=step,
            time_increment=between, scan_time=0.1, range_min=limits[0], range_max=limits[1],
            ranges=ranges, intensities=np.zeros(0, np.float32),
        )  # fmt: skip

    return make


def tf(time, *transforms, name="tf2_msgs/msg/TFMessage"):
    """Return a message with transforms: parent, child, x y z, quaternion."""

    def make(types, is_ros1):
        made = [
            types["geometry_msgs/msg/TransformStamped"](
                header=header(types, is_ros1, time, parent),
                child_frame_id=child,
                transform=types["geometry_msgs/msg/Transform"](
                    translation=types["geometry_msgs/msg/Vector3"](
                        x=float(move[0]), y=float(move[1]), z=float(move[2])
                    ),
                    rotation=turn(types, quaternion),
                ),
            )
            for parent, child, move, quaternion in transforms
        ]
        return types[name](transforms=made)

    return make


def odometry(time, x, y, yaw, frame="odom", child="base_link"):
    def make(types, is_ros1):
        zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        twist = types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
        return types["nav_msgs/msg/Odometry"](
            header=header(types, is_ros1, time, frame),
            child_frame_id=child,
            pose=types["geometry_msgs/msg/PoseWithCovariance"](
                pose=pose(types, x, y, of_yaw(yaw)), covariance=np.zeros(36)
            ),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist=twist, covariance=np.zeros(36)
            ),
        )

    return make


def cloud(time, data, fields, *, width, height=1, step, row=None, is_big=False, frame="base_link"):
    """Return a PointCloud2 of bytes; fields are name, offset, datatype."""

    def make(types, is_ros1):
        made = [
            types["sensor_msgs/msg/PointField"](name=n, offset=o, datatype=d, count=1)
            for n, o, d in fields
        ]
        return types["sensor_msgs/msg/PointCloud2"](
            header=header(types, is_ros1, time, frame), height=height, width=width, fields=made,
            is_bigendian=is_big, point_step=step, row_step=width * step if row is None else row,
            data=np.frombuffer(bytes(data), np.uint8), is_dense=False,
        )  # fmt: skip

    return make


def words(text):
    """Return a message of a type that nothing is made of."""

    def make(types, _):
        return types["std_msgs/msg/String"](data=text)

    return make
