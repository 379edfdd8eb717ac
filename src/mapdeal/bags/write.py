"""Bags with one map or costmap, to be replayed."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mapdeal.bags.bag import bag_paths, check_frame, check_topic, name_inside
from mapdeal.bags.messages import NAV2_COSTMAP, OCCUPANCY_GRID, costmap_types
from mapdeal.bags.reader import needs_bags
from mapdeal.errors import FileAccessError, emit_warning
from mapdeal.files.budget import claim
from mapdeal.files.source import access_to, chunks_of
from mapdeal.files.transaction import Transaction, temporary_folder
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid

MAP_TOPIC, COSTS_TOPIC, FRAME = "/map", "/costmap", "map"

_STAMP = 1
"""Seconds: ROS 1 refuses 0, and the same map has to make the same bytes."""

_NANOSECONDS = _STAMP * 10**9
_VERSION: Literal[8] = 8
"""Of the metadata: rosbag2 of Humble and newer reads it, 9 only newer ones."""

_COPIES = 5
"""Bytes for each cell that are there at the same time, at most."""


def write_bag(
    transaction: Transaction, output: Path, grid: OccupancyGrid | Costmap, *,
    topic: str | None = None, frame: str = FRAME,
) -> None:  # fmt: skip
    needs_bags(output, "rosbags.rosbag1", "rosbags.rosbag2")
    claim(output, _COPIES * grid.layer.size, what="messages of this size")
    is_ros1 = output.suffix == ".bag"
    if isinstance(grid, Costmap) and grid.scale == "costmap2d" and is_ros1:
        text = f"{output}: ROS 1 publishes costs as 0 to 100; those of costmap_2d are made so"
        emit_warning(text, stacklevel=2)
        grid = grid.to_occupancy()
        topic = COSTS_TOPIC if topic is None else topic
    if topic is None:
        topic = COSTS_TOPIC if isinstance(grid, Costmap) else MAP_TOPIC
    topic, frame = check_topic(topic), check_frame(frame)
    write = _write_ros1 if is_ros1 else _write_ros2
    with write(output, grid, topic, frame) as files:
        for path, file in zip(bag_paths(output), files, strict=True):
            transaction.write_parts(path, chunks_of(file))


@contextmanager
def _write_ros1(
    output: Path, grid: OccupancyGrid | Costmap, topic: str, frame: str
) -> Iterator[tuple[Path, ...]]:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with _scratch(output) as folder:
        file = folder / "bag"
        with Writer(file) as writer:
            connection = writer.add_connection(
                topic, OCCUPANCY_GRID, typestore=store, callerid="/mapdeal", latching=1
            )
            message = _message(store.types, grid, frame, is_ros1=True)
            writer.write(connection, _NANOSECONDS, store.serialize_ros1(message, OCCUPANCY_GRID))
        yield (file,)


@contextmanager
def _write_ros2(
    output: Path, grid: OccupancyGrid | Costmap, topic: str, frame: str
) -> Iterator[tuple[Path, ...]]:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
    from rosbags.interfaces import QosTime as Time
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(costmap_types())
    is_own = isinstance(grid, Costmap) and grid.scale == "costmap2d"
    name = NAV2_COSTMAP if is_own else OCCUPANCY_GRID
    plugin = StoragePlugin.MCAP if output.suffix == ".mcap" else StoragePlugin.SQLITE3
    unset = Time(sec=0, nsec=0)
    # as map_server publishes: whoever subscribes later gets the last one, too
    latched = Qos(
        history=QosHistory.KEEP_LAST, depth=1, reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL, deadline=unset, lifespan=unset,
        liveliness=QosLiveliness.AUTOMATIC, liveliness_lease_duration=unset,
        avoid_ros_namespace_conventions=False,
    )  # fmt: skip
    with _scratch(output) as folder:
        bag = folder / name_inside(output)
        with Writer(bag, version=_VERSION, storage_plugin=plugin) as writer:
            connection = writer.add_connection(
                topic, name, typestore=store, offered_qos_profiles=[latched]
            )
            message = _message(store.types, grid, frame, is_ros1=False)
            writer.write(connection, _NANOSECONDS, store.serialize_cdr(message, name))
        file = bag / f"{bag.name}{output.suffix}"
        yield (file,) if output.suffix == ".mcap" else (file, bag / "metadata.yaml")


@contextmanager
def _scratch(output: Path) -> Iterator[Path]:
    """Yield a folder for rosbags to write to, which accepts names but no open files."""
    with access_to(output, "written"), temporary_folder() as folder:
        try:
            yield folder
        except sqlite3.Error as error:  # such as a full disk, or a map beyond its largest blob
            raise FileAccessError(f"cannot be written: {error}", source=output) from None


def _message(
    types: Mapping[str, Callable[..., Any]], grid: OccupancyGrid | Costmap, frame: str, *,
    is_ros1: bool,
) -> Any:  # fmt: skip
    time = types["builtin_interfaces/msg/Time"](sec=_STAMP, nanosec=0)
    number = {"seq": 0} if is_ros1 else {}
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **number)
    x, y, yaw = grid.origin
    origin = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)
        ),
    )
    height, width = grid.shape
    resolution = float(np.float32(grid.resolution))
    values = np.ascontiguousarray(grid.layer).reshape(-1)
    if isinstance(grid, Costmap) and grid.scale == "costmap2d":
        info = types["nav2_msgs/msg/CostmapMetaData"](
            map_load_time=time, update_time=time, layer="master", resolution=resolution,
            size_x=width, size_y=height, origin=origin,
        )  # fmt: skip
        return types[NAV2_COSTMAP](header=header, metadata=info, data=values.view(np.uint8))
    info = types["nav_msgs/msg/MapMetaData"](
        map_load_time=time, resolution=resolution, width=width, height=height, origin=origin
    )
    return types[OCCUPANCY_GRID](header=header, info=info, data=values.view(np.int8))
