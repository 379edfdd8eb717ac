"""Decoded messages as what mapdeal works with: scans, transforms, grids, points."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.records import dataclass

LASER_SCAN = "sensor_msgs/msg/LaserScan"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
NAV2_COSTMAP = "nav2_msgs/msg/Costmap"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
GRID_TYPES = (OCCUPANCY_GRID, NAV2_COSTMAP)

_SECOND = 10**9
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""The types of numbers in a PointField, by its constants."""

_UPRIGHT = math.cos(math.radians(10))
_MOST_POINTS = 1 << 32
_LARGEST_ANGLE = 1000.0


class Stamped(NamedTuple):
    parent: str
    child: str
    time: int
    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class LaserScan:
    frame: str
    time: int
    start: float
    step: float
    between: float
    ranges: NDArray[np.float64]

    @property
    def angles(self) -> NDArray[np.float64]:
        """Of the beams, shape (M,), radians."""
        return self.start + self.step * np.arange(len(self.ranges), dtype=np.float64)

    @property
    def geometry(self) -> tuple[str, float, float, int]:
        """Frame, first angle, step and number of readings."""
        return self.frame, self.start, self.step, len(self.ranges)

    def beam_times(self) -> NDArray[np.int64]:
        """Return when each beam was measured, shape (M,), nanoseconds."""
        after = np.arange(len(self.ranges)) * (self.between * _SECOND)
        return np.asarray(self.time + np.rint(after).astype(np.int64))

    def at(self, time: int) -> LaserScan:
        return replace(self, time=time)


def time_of(stamp: Any) -> int:
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def frame_of(header: Any) -> str:
    return str(header.frame_id).lstrip("/")


def laser_scan_of(message: Any) -> LaserScan:
    """Return a ``sensor_msgs/LaserScan``."""
    # Source: REP 117: a reading of inf hits nothing, one of -inf is too near, one of nan means
    # nothing. sensor_msgs/LaserScan: readings below ``range_min`` or above ``range_max`` are to be
    # discarded. A reading of ``range_max`` is that of a beam that hits nothing, as with gmapping's
    # ``maxRange``.
    start, step = float(message.angle_min), float(message.angle_increment)
    ranges = np.array(message.ranges, dtype=np.float64)
    last = start + step * max(0, len(ranges) - 1)
    if not (abs(start) <= _LARGEST_ANGLE and abs(last) <= _LARGEST_ANGLE):  # refuses nan, too
        rule = "angle_min and angle_increment must be angles in radians"
        raise MalformedInputError(rule, got=(start, step))
    least, most = float(message.range_min), float(message.range_max)
    with np.errstate(invalid="ignore"):
        if math.isfinite(most) and most > 0:
            ranges[ranges >= most] = np.inf
        if math.isfinite(least):
            ranges[ranges < least] = np.nan
    between = float(message.time_increment)
    return LaserScan(
        frame_of(message.header), time_of(message.header.stamp), start, step,
        between if math.isfinite(between) else 0.0, ranges,
    )  # fmt: skip


def transforms_of(message: Any) -> list[Stamped]:
    """Return the transforms of a ``tf2_msgs/TFMessage`` or ``tf/tfMessage``."""
    return [_stamped(one) for one in message.transforms]


def _stamped(one: Any) -> Stamped:
    move, turn = one.transform.translation, one.transform.rotation
    return Stamped(
        frame_of(one.header), str(one.child_frame_id).lstrip("/"), time_of(one.header.stamp),
        (float(move.x), float(move.y), float(move.z)),
        (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
    )  # fmt: skip


def odometry_of(message: Any) -> Stamped:
    """Return the pose of a ``nav_msgs/Odometry`` as the transform that it stands for."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return Stamped(
        frame_of(message.header), str(message.child_frame_id).lstrip("/"),
        time_of(message.header.stamp), (float(place.x), float(place.y), float(place.z)),
        (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
    )  # fmt: skip


def grid_of(message: Any, name: str, *, is_costs: bool) -> OccupancyGrid | Costmap:
    """Return a ``nav_msgs/OccupancyGrid`` or a ``nav2_msgs/Costmap``."""
    # The resolution is a float32 in both: it becomes the number with the fewest digits that stands
    # for it, 0.05 and not 0.05000000074505806. The time that the map was loaded is left out.
    if name == NAV2_COSTMAP:
        info = message.metadata
        width, height = int(info.size_x), int(info.size_y)
    else:
        info = message.info
        width, height = int(info.width), int(info.height)
    if len(message.data) != width * height:
        rule = f"must have {width} x {height} values, has {len(message.data)}"
        raise MalformedInputError(rule, place="data")
    if not width * height:
        raise MalformedInputError("has no cells", place="data")
    resolution = float(str(np.float32(info.resolution)))
    origin = _planar(info.origin)
    data = np.asarray(message.data).reshape(height, width)
    if name == NAV2_COSTMAP:
        return Costmap(data.astype(np.uint8), resolution, origin, "costmap2d")
    values = data.astype(np.int8)
    if (values < -1).any() or (values > 100).any():
        wrong = values[(values < -1) | (values > 100)][0]
        raise MalformedInputError("must be -1 to 100", place="data", got=int(wrong))
    if is_costs:
        return Costmap(values, resolution, origin, "occupancy")
    return OccupancyGrid(values, resolution, origin)


def _planar(pose: Any) -> tuple[float, float, float]:
    """Return x, y and yaw of a pose in the plane."""
    place, turn = pose.position, pose.orientation
    x, y, z, w = (float(part) for part in (turn.x, turn.y, turn.z, turn.w))
    length = math.hypot(x, y, z, w)
    if length == 0:  # of publishers that never set it: map_server takes it for no turn, too
        x, y, z, w, length = 0.0, 0.0, 0.0, 1.0, 1.0
    if not math.isfinite(length):
        raise MalformedInputError("must be finite", place="origin")
    x, y, z, w = x / length, y / length, z / length, w / length
    if 1 - 2 * (x * x + y * y) < _UPRIGHT:
        raise MalformedInputError("must lie in the plane: it leans by more than 10 degrees",
                                  place="origin")  # fmt: skip
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(place.x), float(place.y), yaw


def points_of(message: Any) -> NDArray[np.float64]:
    """Return the points of a ``sensor_msgs/PointCloud2``."""
    fields = {str(one.name): one for one in message.fields}
    if not {"x", "y"} <= fields.keys():
        raise MalformedInputError("must name x and y", place="fields", got=" ".join(fields))
    order = ">" if message.is_bigendian else "<"
    width, height = int(message.width), int(message.height)
    step, row = int(message.point_step), int(message.row_step)
    if not width or not height:
        return np.empty((0, 3 if "z" in fields else 2))
    if width * height > _MOST_POINTS:
        raise MalformedInputError("has too many points", place="width, height")
    if row < width * step:  # of drivers that leave it 0
        row = width * step
    data = np.ascontiguousarray(message.data).view(np.uint8)
    if len(data) < (height - 1) * row + width * step:
        rule = f"must have {height} rows of {row} bytes, has {len(data)}"
        raise MalformedInputError(rule, place="data")
    axes = [fields[name] for name in ("x", "y", "z") if name in fields]
    points = np.empty((height, width, len(axes)))
    for k, one in enumerate(axes):
        if int(one.datatype) not in _NUMBERS:
            rule = "must be of a datatype from 1 to 8"
            raise MalformedInputError(rule, place=f"field {one.name}", got=int(one.datatype))
        kind = np.dtype(order + _NUMBERS[int(one.datatype)])
        if int(one.offset) + kind.itemsize > step:
            rule = f"must lie within a point of {step} bytes"
            raise MalformedInputError(rule, place=f"field {one.name}", got=int(one.offset))
        with np.errstate(invalid="ignore"):  # of a signalling nan, which is one like others
            points[..., k] = np.ndarray(
                (height, width), kind, data.tobytes() if not data.flags.c_contiguous else data,
                int(one.offset), (row, step),
            )  # fmt: skip
    return points.reshape(-1, len(axes))


def points_of_scan(scan: LaserScan) -> NDArray[np.float64]:
    """Return the points that a scan hits, in the frame of its sensor, shape (M, 2)."""
    angles, hit = scan.angles, np.isfinite(scan.ranges)
    ranges, angles = scan.ranges[hit], angles[hit]
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)
