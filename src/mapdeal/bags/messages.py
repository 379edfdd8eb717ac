"""Messages: decoding by the definitions of their types, conversion, and writing to bags."""

from __future__ import annotations

import math
import mmap
import re
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple, TypeVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from mapdeal.bags import bag as bags, chunked
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import access_to, chunks_of, claim
from mapdeal.files.transaction import Transaction, temporary_folder
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.records import dataclass

LASER_SCAN = "sensor_msgs/msg/LaserScan"
LIVOX_TYPES = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
CLOUD_TYPES = (POINT_CLOUD, *LIVOX_TYPES)
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
NAV2_COSTMAP = "nav2_msgs/msg/Costmap"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
GRID_TYPES = (OCCUPANCY_GRID, NAV2_COSTMAP)

_SECOND = 10**9
# numpy's types for the constants of a PointField.
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_UPRIGHT = math.cos(math.radians(10))
_MOST_POINTS = 1 << 32
_LARGEST_ANGLE = 1000.0

_LIVOX_POINT = 19  # bytes: the time as uint32, x, y and z as float32, and three uint8
_BEFORE_POINTS = 20  # bytes: timebase, point_num, lidar_id, rsvd, and the number of points

_CHUNK, _DATA_END, _FOOTER = 0x06, 0x0F, 0x02
_BEFORE_CHECKSUM = {_CHUNK: 24, _DATA_END: 0, _FOOTER: 16}  # bytes of a record


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
        return self.start + self.step * np.arange(len(self.ranges), dtype=np.float64)

    @property
    def geometry(self) -> tuple[str, float, float, int]:
        return self.frame, self.start, self.step, len(self.ranges)

    def beam_times(self) -> NDArray[np.int64]:
        delays = np.arange(len(self.ranges)) * (self.between * _SECOND)
        return np.asarray(self.time + np.rint(delays).astype(np.int64))


def time_of(stamp: Any) -> int:
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def frame_of(header: Any) -> str:
    return str(header.frame_id).lstrip("/")


def laser_scan_of(message: Any) -> LaserScan:
    # REP 117: a beam of range inf hits nothing, -inf means too near, nan is invalid.
    # sensor_msgs/LaserScan: discard ranges below ``range_min`` and above ``range_max``. As with
    # gmapping's ``maxRange``, a range of ``range_max`` means that the beam hits nothing.
    start, step = float(message.angle_min), float(message.angle_increment)
    ranges = np.array(message.ranges, dtype=np.float64)
    last = start + step * max(0, len(ranges) - 1)
    if not (abs(start) <= _LARGEST_ANGLE and abs(last) <= _LARGEST_ANGLE):  # refuses nan, too
        rule = "angle_min and angle_increment must be angles in radians"
        raise MalformedInputError(rule, got=(start, step))
    if step == 0 and len(ranges) > 1:
        raise MalformedInputError("angle_increment must not be 0", got=f"{len(ranges)} ranges")
    least, most = float(message.range_min), float(message.range_max)
    with np.errstate(invalid="ignore"):
        if math.isfinite(most) and most > 0:
            ranges[ranges >= most] = np.inf
        if math.isfinite(least):
            ranges[ranges < least] = np.nan
    interval = float(message.time_increment)
    return LaserScan(
        frame_of(message.header), time_of(message.header.stamp), start, step,
        interval if math.isfinite(interval) else 0.0, ranges,
    )  # fmt: skip


def transforms_of(message: Any) -> list[Stamped]:
    parts = ((item, item.transform) for item in message.transforms)
    return [_stamped(item, part.translation, part.rotation) for item, part in parts]


def odometry_of(message: Any) -> Stamped:
    pose = message.pose.pose
    return _stamped(message, pose.position, pose.orientation)


def _stamped(item: Any, translation: Any, rotation: Any) -> Stamped:
    return Stamped(
        frame_of(item.header), str(item.child_frame_id).lstrip("/"), time_of(item.header.stamp),
        (float(translation.x), float(translation.y), float(translation.z)),
        (float(rotation.x), float(rotation.y), float(rotation.z), float(rotation.w)),
    )  # fmt: skip


def grid_of(message: Any, name: str, *, is_costs: bool) -> OccupancyGrid | Costmap:
    # Both types have a float32 resolution. It becomes the shortest decimal of the same float32:
    # 0.05, not 0.05000000074505806.
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
    wrong = values[(values < -1) | (values > 100)]
    if len(wrong):
        raise MalformedInputError("must be -1 to 100", place="data", got=int(wrong[0]))
    if is_costs:
        return Costmap(values, resolution, origin, "occupancy")
    return OccupancyGrid(values, resolution, origin)


def from_msg(message: Any, onto: OccupancyGrid | None = None) -> OccupancyGrid | Costmap:
    """Return the grid of a ROS message: the inverse of ``grid.to_msg()``.

    Parameters
    ----------
    message : object or dict
        OccupancyGrid, OccupancyGridUpdate or nav2_msgs/Costmap of ROS 1 or 2, or its fields.
    onto : OccupancyGrid, optional
        Map that an update changes.

    Returns
    -------
    OccupancyGrid or Costmap
        A costmap for ``nav2_msgs/Costmap``.

    Raises
    ------
    MalformedInputError
        If the message lacks a field or values, or is rotated out of the plane.
    ParameterError
        If `onto` is missing for an update, or does not contain it.

    Examples
    --------
    >>> message = OccupancyGrid([[0, 100, -1]], 0.5, (1.0, 2.0, 0.0)).to_msg()
    >>> from_msg(message)
    OccupancyGrid(3 x 1 cells, 0.5 m, origin (1, 2, 0), 1 occupied, 1 free, 1 unknown)
    >>> update = {"x": 1, "y": 0, "width": 2, "height": 1, "data": [0, 0]}
    >>> from_msg(update, onto=from_msg(message)).occupancy.tolist()
    [[0, 0, 0]]
    """
    fields = _as_object(message)
    try:
        if hasattr(fields, "metadata"):
            return grid_of(fields, NAV2_COSTMAP, is_costs=True)
        if hasattr(fields, "info"):
            return grid_of(fields, OCCUPANCY_GRID, is_costs=False)
        values = np.asarray(fields.data, dtype=np.int8).reshape(fields.height, fields.width)
        x, y = int(fields.x), int(fields.y)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        reason = f"it has no {error.name}" if isinstance(error, AttributeError) else error
        raise MalformedInputError(f"is no grid message: {reason}", source="message") from None
    height, width = values.shape
    if onto is None:
        raise ParameterError("an update needs the map that it changes", place="onto")
    if not (0 <= y <= y + height <= onto.shape[0] and 0 <= x <= x + width <= onto.shape[1]):
        raise ParameterError("the update lies outside of the map", place="onto", got=onto.shape)
    changed = onto.occupancy.copy()
    changed[y : y + height, x : x + width] = values
    return onto.with_values(changed)


def _as_object(value: Any) -> Any:
    if not isinstance(value, Mapping):
        return value
    return SimpleNamespace(**{str(name): _as_object(field) for name, field in value.items()})


def _planar(pose: Any) -> tuple[float, float, float]:
    position, rotation = pose.position, pose.orientation
    parts = [float(part) for part in (rotation.x, rotation.y, rotation.z, rotation.w)]
    if not any(parts):  # some publishers never set it; map_server reads it as yaw 0, too
        parts = [0.0, 0.0, 0.0, 1.0]
    length = math.hypot(*parts)
    if not math.isfinite(length):
        raise MalformedInputError("must be finite", place="origin")
    x, y, z, w = (part / length for part in parts)
    if 1 - 2 * (x * x + y * y) < _UPRIGHT:
        rule = "must lie in the plane: it leans by more than 10 degrees"
        raise MalformedInputError(rule, place="origin")
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(position.x), float(position.y), yaw


def points_of(message: Any) -> NDArray[np.float64]:
    fields = {str(field.name): field for field in message.fields}
    if not {"x", "y"} <= fields.keys():
        raise MalformedInputError("must name x and y", place="fields", got=" ".join(fields))
    order = ">" if message.is_bigendian else "<"
    width, height = int(message.width), int(message.height)
    step, row_step = int(message.point_step), int(message.row_step)
    if not width or not height:
        return np.empty((0, 3 if "z" in fields else 2))
    if width * height > _MOST_POINTS:
        raise MalformedInputError("has too many points", place="width, height")
    if row_step < width * step:  # some drivers leave it 0
        row_step = width * step
    data = np.ascontiguousarray(message.data).view(np.uint8)
    if len(data) < (height - 1) * row_step + width * step:
        rule = f"must have {height} rows of {row_step} bytes, has {len(data)}"
        raise MalformedInputError(rule, place="data")
    axes = [fields[name] for name in ("x", "y", "z") if name in fields]
    points = np.empty((height, width, len(axes)))
    for axis, field in enumerate(axes):
        place, number, offset = f"field {field.name}", int(field.datatype), int(field.offset)
        if number not in _NUMBERS:
            raise MalformedInputError("must be of a datatype from 1 to 8", place=place, got=number)
        kind = np.dtype(order + _NUMBERS[number])
        if offset + kind.itemsize > step:
            rule = f"must lie within a point of {step} bytes"
            raise MalformedInputError(rule, place=place, got=offset)
        with np.errstate(invalid="ignore"):  # conversion of a signalling nan
            points[..., axis] = np.ndarray((height, width), kind, data, offset, (row_step, step))
    return points.reshape(-1, len(axes))


def points_of_livox(data: bytes, encoding: str) -> NDArray[np.float64]:
    """Return the points of a ``CustomMsg``, for which rosbags would make many objects."""
    # `msg/CustomMsg.msg` and `msg/CustomPoint.msg`, which are identical in both drivers
    is_ros1 = encoding == "ros1"
    order = "<" if is_ros1 or data[1:2] == b"\x01" else ">"
    try:
        (length,) = struct.unpack_from(f"{order}I", data, 12)
        start = 16 + length
        if not is_ros1:  # CDR aligns 64-bit numbers, counted from the end of its 4-byte header
            start = 4 + -(-(start - 4) // 8) * 8
        (count,) = struct.unpack_from(f"{order}I", data, start + _BEFORE_POINTS - 4)
    except struct.error:
        raise MalformedInputError("ends within its header") from None
    first, stride = start + _BEFORE_POINTS, _LIVOX_POINT if is_ros1 else _LIVOX_POINT + 1
    if first + (count - 1) * stride + _LIVOX_POINT > len(data):
        rule = f"must have {count} points of {stride} bytes"
        raise MalformedInputError(rule, place="points", got=f"{max(0, len(data) - first)} bytes")
    if not count:
        return np.empty((0, 3))
    return np.ndarray((count, 3), f"{order}f4", data, first + 4, (stride, 4)).astype(np.float64)


def points_of_scan(message: Any) -> NDArray[np.float64]:
    scan = laser_scan_of(message)
    hit = np.isfinite(scan.ranges)
    ranges, angles = scan.ranges[hit], scan.angles[hit]
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)


# As in the latest ROS 2, for bags without definitions, which are older than Iron. These types have
# never changed.
_TYPES = """\
builtin_interfaces/Time: int32 sec; uint32 nanosec
builtin_interfaces/Duration: int32 sec; uint32 nanosec
std_msgs/Header: builtin_interfaces/Time stamp; string frame_id
geometry_msgs/Vector3: float64 x; float64 y; float64 z
geometry_msgs/Point: float64 x; float64 y; float64 z
geometry_msgs/Quaternion: float64 x; float64 y; float64 z; float64 w
geometry_msgs/Pose: Point position; Quaternion orientation
geometry_msgs/PoseWithCovariance: Pose pose; float64[36] covariance
geometry_msgs/Twist: Vector3 linear; Vector3 angular
geometry_msgs/TwistWithCovariance: Twist twist; float64[36] covariance
geometry_msgs/Transform: Vector3 translation; Quaternion rotation
geometry_msgs/TransformStamped: Header header; string child_frame_id; Transform transform
tf2_msgs/TFMessage: geometry_msgs/TransformStamped[] transforms
nav_msgs/Odometry: Header header; string child_frame_id; geometry_msgs/PoseWithCovariance pose; \
geometry_msgs/TwistWithCovariance twist
nav_msgs/MapMetaData: builtin_interfaces/Time map_load_time; float32 resolution; uint32 width; \
uint32 height; geometry_msgs/Pose origin
nav_msgs/OccupancyGrid: Header header; MapMetaData info; int8[] data
nav2_msgs/CostmapMetaData: builtin_interfaces/Time map_load_time; \
builtin_interfaces/Time update_time; string layer; float32 resolution; uint32 size_x; \
uint32 size_y; geometry_msgs/Pose origin
nav2_msgs/Costmap: Header header; CostmapMetaData metadata; uint8[] data
sensor_msgs/LaserScan: Header header; float32 angle_min; float32 angle_max; \
float32 angle_increment; float32 time_increment; float32 scan_time; float32 range_min; \
float32 range_max; float32[] ranges; float32[] intensities
sensor_msgs/PointField: string name; uint32 offset; uint8 datatype; uint32 count
sensor_msgs/PointCloud2: Header header; uint32 height; uint32 width; PointField[] fields; \
bool is_bigendian; uint32 point_step; uint32 row_step; uint8[] data; bool is_dense
"""
KNOWN = {name: fields for name, _, fields in (line.partition(": ") for line in _TYPES.splitlines())}

_FORMATS = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_ROS1_NAMES = {
    "Header": "std_msgs/msg/Header", "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
}  # fmt: skip
_FIELD = re.compile(
    r"(?P<kind>[\w/]+)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<length>\d*)\])?\s+\w+\s*(?P<constant>=)?"
)
_LONGEST_DEFINITION = 100_000  # characters; definitions of common types have a few thousand
_LONGEST_ARRAYS = 10_000


class _Field(NamedTuple):
    name: str
    kind: str
    length: int | None  # None for a single value, 0 for a sequence of any length
    size: int  # bytes of a single number; 0 for all other fields


FieldGroups = Mapping[str, list[tuple[int, list[_Field], str]]]


def decoded(data: bytes, name: str, types: FieldGroups, *, is_ros1: bool) -> Any:
    message = _Message(data, types, is_ros1=is_ros1)
    value = message.read(name)
    if not 0 <= len(data) - message.at <= (0 if is_ros1 else 3):
        raise ValueError(f"has {len(data)} bytes, of which {message.at} are described")
    return value


@lru_cache(maxsize=32)
def types_in(name: str, definition: str) -> FieldGroups:
    """Return the fields of all types in a definition, single numbers of equal size in groups."""
    if len(definition) > _LONGEST_DEFINITION:
        raise ValueError(f"{len(definition)} characters, the limit is {_LONGEST_DEFINITION}")
    texts = dict(KNOWN)
    if definition:
        texts = {key: KNOWN[key] for key in KNOWN if key.startswith("builtin_interfaces/")}
        texts[name], *sections = re.split(r"(?m)^=+\s*^MSG:", definition)
        for section in sections:
            title, _, lines = section.partition("\n")
            texts[title.strip()] = lines
    fields_by_type = {
        bags.normalised_type(key): _fields_of(lines, key.partition("/")[0])
        for key, lines in texts.items()
    }
    if name not in fields_by_type:
        raise ValueError("it has no definition")
    fields = [field for fields in fields_by_type.values() for field in fields]
    check_array_lengths([field.length for field in fields if field.length])
    return {
        key: [
            (size, members, "".join(_FORMATS.get(member.kind, "") for member in members))
            for size, group in groupby(fields, key=lambda field: field.size)
            for members in ([list(group)] if size else [[field] for field in group])
        ]
        for key, fields in fields_by_type.items()
    }


def _fields_of(lines: str, package: str) -> list[_Field]:
    fields = []
    for line in re.split(r"\n|; ", lines):
        text = line.partition("#")[0].strip()
        match = _FIELD.match(text)
        if match is None and text:
            raise ValueError(f"invalid line {text!r}")
        if match is None or match["constant"]:
            continue
        kind = match["kind"]
        if kind not in (*_FORMATS, "string"):
            full_name = kind if "/" in kind else f"{package}/{kind}"
            kind = _ROS1_NAMES.get(kind) or bags.normalised_type(full_name)
        is_fixed = match["array"] and match["length"] and not match["bound"]
        length = None if not match["array"] else int(match["length"]) if is_fixed else 0
        size = struct.calcsize(_FORMATS[kind]) if length is None and kind in _FORMATS else 0
        fields.append(_Field(text[: match.end()].split()[1], kind, length, size))
        if is_fixed:
            check_array_lengths([int(match["length"])])
    return fields


def check_array_lengths(lengths: Sequence[int]) -> None:
    if min(lengths, default=1) < 1 or sum(lengths) > _LONGEST_ARRAYS:
        rule = f"fixed lengths of arrays must be 1 or more, and {_LONGEST_ARRAYS} together at most"
        raise ValueError(rule)


class _Message:
    def __init__(self, data: bytes, types: FieldGroups, *, is_ros1: bool) -> None:
        if not is_ros1 and data[:2] not in (b"\0\0", b"\0\1"):
            raise ValueError(f"is in another encoding than CDR: {data[:2].hex()}")
        self._data, self._types, self._is_ros1 = data, types, is_ros1
        # the place up to which it has been read; CDR has a header, whose second byte is the order
        self.at = 0 if is_ros1 else 4
        self._order = "<" if is_ros1 or data[1] & 1 else ">"

    def read(self, kind: str) -> SimpleNamespace:
        values: dict[str, Any] = {}
        for size, fields, formats in self._types[kind]:
            if size:
                self._align(size)
                numbers = struct.unpack_from(self._order + formats, self._data, self.at)
                values |= zip((field.name for field in fields), numbers, strict=True)
                self.at += size * len(numbers)
            else:
                values[fields[0].name] = self._value(fields[0])
        return SimpleNamespace(**values)

    def _value(self, field: _Field) -> Any:
        read = self._text if field.kind == "string" else lambda: self.read(field.kind)
        if field.length is None:
            return read()
        length = field.length or self._length()
        if length > len(self._data):  # so that no length makes more objects than there are bytes
            raise ValueError(f"{field.name} cannot have {length} elements")
        if field.kind not in _FORMATS:
            return [read() for _ in range(length)]
        kind = np.dtype(self._order + _FORMATS[field.kind])
        if length:
            self._align(kind.itemsize)
        array = np.frombuffer(self._data, kind, length, self.at)
        self.at += array.nbytes
        return array

    def _length(self) -> int:
        self._align(4)
        (length,) = struct.unpack_from(f"{self._order}I", self._data, self.at)
        self.at += 4
        return int(length)

    def _text(self) -> str:
        length = self._length()
        text = self._data[self.at : self.at + length]
        if len(text) < length:
            raise ValueError("ends within a text")
        self.at += length
        return text.decode() if self._is_ros1 else text[:-1].decode()

    def _align(self, size: int) -> None:
        if not self._is_ros1:
            self.at += (4 - self.at) % size


_T = TypeVar("_T")

_ARRAY_FACTOR, _OBJECT_FACTOR = 4, 30  # memory for decoding a message, relative to its length


class Decoder:
    # The bag's own definition of a type is used. Bags before ROS 2 Iron have none; they use the
    # definitions of the latest ROS 2, which have never changed for the types read here.
    def __init__(self, bag: bags.Bag) -> None:
        self._bag = bag
        self._connections = {connection.id: connection for connection in bag.connections}

    def message(self, place: bags.Place) -> Any:
        connection = self._connections[place.connection]
        name, is_ros1 = connection.type, connection.encoding == "ros1"
        try:
            types = types_in(name, connection.definition)
        except Exception as error:  # noqa: BLE001 - parsers of damaged texts fail in many ways
            rule = f"its type {name} cannot be parsed: {error}"
            raise self._bag.malformed(rule, connection.topic) from None
        data = self._bag.read_message(place)
        needed = (_OBJECT_FACTOR if name in TF_TYPES else _ARRAY_FACTOR) * len(data)
        claim(self._bag.path, needed, what=f"the {len(data)} bytes of a message")
        try:
            return decoded(data, name, types, is_ros1=is_ros1)
        except Exception as error:  # noqa: BLE001 - decoders of damaged bytes fail in many ways
            reason = error or type(error).__name__
            rule = f"a message at {place.time} ns is not a valid {name}: {reason}"
            raise self._bag.malformed(rule, connection.topic) from None

    def read(self, place: bags.Place, make: Callable[[Any], _T]) -> _T:
        message, connection = self.message(place), self._connections[place.connection]
        try:
            return make(message)
        except ParameterError as error:
            raise error.in_file(self._bag.path, connection.topic) from None
        except MalformedInputError as error:
            if error.source is None:
                error.place = ": ".join(part for part in (connection.topic, error.place) if part)
            raise error.found_in(self._bag.path) from None
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            rule = f"the bag has another {connection.type}: {error}"
            raise self._bag.malformed(rule, connection.topic) from None

    def header(self, place: bags.Place) -> tuple[int, str]:
        data, connection = self._bag.read_message(place), self._connections[place.connection]
        order = "<" if connection.encoding == "ros1" or data[1:2] == b"\x01" else ">"
        try:  # preceded by a sequence number in ROS 1, by CDR's byte order in ROS 2
            seconds, nanoseconds, length = struct.unpack_from(f"{order}III", data, 4)
            frame = data[16 : 16 + length]
            if len(frame) < length:
                raise ValueError
            text = frame.rstrip(b"\0").decode()
        except (struct.error, ValueError):
            rule = f"a message at {place.time} ns has no header"
            raise self._bag.malformed(rule, connection.topic) from None
        return seconds * _SECOND + nanoseconds, text.lstrip("/")


MAP_TOPIC, COSTS_TOPIC, FRAME = "/map", "/costmap", "map"

_NANOSECONDS = _SECOND  # constant, so that equal maps give equal bytes; ROS 1 refuses 0
_VERSION: Literal[8] = 8  # of the metadata: Humble cannot read version 9
_COPIES = 5  # peak memory, bytes per cell

_Types = Mapping[str, Callable[..., Any]]
_Record = tuple[str, str, int, Any]  # topic, type, time in nanoseconds, message


def write_bag(
    transaction: Transaction, output: Path, grid: OccupancyGrid | Costmap, *,
    topic: str | None = None, frame: str = FRAME,
) -> None:  # fmt: skip
    bags.import_rosbags(output, "rosbags.typesys", "rosbags.rosbag1", "rosbags.rosbag2")
    claim(output, _COPIES * grid.layer.size, what="messages of this size")
    is_ros1 = output.suffix == ".bag"
    if topic is None:
        topic = COSTS_TOPIC if isinstance(grid, Costmap) else MAP_TOPIC
    if isinstance(grid, Costmap) and grid.scale == "costmap2d" and is_ros1:
        text = f"{output}: ROS 1 publishes costs as 0 to 100; those of costmap_2d are made so"
        emit_warning(text)
        grid = grid.to_occupancy()
    topic = bags.check_topic(topic)
    if not frame or not frame.isprintable() or frame.startswith("/"):
        rule = "must be the name of a frame, without a slash in front"
        raise ParameterError(rule, source="--frame-id", got=frame)
    name = NAV2_COSTMAP if _is_nav2_costmap(grid) else OCCUPANCY_GRID

    def records(types: _Types) -> Iterator[_Record]:
        yield topic, name, _NANOSECONDS, _message(types, grid, frame, is_ros1=False)

    with _scratch(transaction, output) as bag:
        if is_ros1:
            _write_ros1(bag, grid, topic, frame)
        else:
            _write_ros2(bag, output.suffix, records, {topic})


@dataclass(frozen=True)
class SimulatedRun:
    """A run of a robot with a laser scanner: `rate` scans a second, poses of shape (N, 3)."""

    grid: OccupancyGrid
    rate: float
    odometry: NDArray[np.float64]
    odometry_frames: NDArray[np.float64]
    mount: tuple[float, float, float]
    start: float
    step: float
    ranges: NDArray[np.float64]
    range_limits: tuple[float, float]

    def records(self, types: _Types) -> Iterator[_Record]:
        # a stamp of 0 means that there is none
        times = np.rint(np.arange(1, len(self.odometry) + 1) * (_SECOND / self.rate))
        first = int(times[0])
        grid = _message(types, self.grid, FRAME, is_ros1=False, time=first)
        yield MAP_TOPIC, OCCUPANCY_GRID, first, grid
        yaws = self.odometry[:, 2]
        moves = np.diff(self.odometry, axis=0, prepend=self.odometry[:1]) * self.rate
        speeds = np.cos(yaws) * moves[:, 0] + np.sin(yaws) * moves[:, 1]
        last = self.start + self.step * (self.ranges.shape[1] - 1)
        nothing, make = np.zeros(36), partial(_geometry, types)
        for k, time in enumerate(times.astype(np.int64).tolist()):
            stamp = types["builtin_interfaces/msg/Time"](*divmod(time, _SECOND))

            def header(frame: str, stamp: Any = stamp) -> Any:
                return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

            transforms = []
            for parent, child, (x, y, yaw) in (
                (FRAME, "odom", self.odometry_frames[k]), ("odom", "base_link", self.odometry[k]),
                ("base_link", "laser", self.mount),
            ):  # fmt: skip
                move = make("Vector3", float(x), float(y), 0.0)
                transform = make("Transform", move, _upright(types, yaw))
                transforms.append(make("TransformStamped", header(parent), child, transform))
            yield "/tf", TF_TYPES[0], time, types[TF_TYPES[0]](transforms)
            pose = make("PoseWithCovariance", _pose(types, *self.odometry[k].tolist()), nothing)
            linear = make("Vector3", float(speeds[k]), 0.0, 0.0)
            angular = make("Vector3", 0.0, 0.0, float(moves[k, 2]))
            twist = make("TwistWithCovariance", make("Twist", linear, angular), nothing)
            yield "/odom", ODOMETRY, time, types[ODOMETRY](header("odom"), "base_link", pose, twist)
            # rounded up: beams end inside of the cell that they hit
            ranges = self.ranges[k].astype(np.float32)
            ranges[ranges < self.ranges[k]] *= np.float32(1 + 2**-23)
            scan = types[LASER_SCAN](
                header("laser"), self.start, last, self.step, 0.0, 1 / self.rate,
                *self.range_limits, ranges, np.empty(0, dtype=np.float32),
            )  # fmt: skip
            yield "/scan", LASER_SCAN, time, scan


def write_run(transaction: Transaction, output: Path, run: SimulatedRun) -> None:
    with _scratch(transaction, output) as bag:
        _write_ros2(bag, output.suffix, run.records, {MAP_TOPIC})


def _write_ros1(file: Path, grid: OccupancyGrid | Costmap, topic: str, frame: str) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(file) as writer:
        connection = writer.add_connection(
            topic, OCCUPANCY_GRID, typestore=store, callerid="/mapdeal", latching=1
        )
        message = _message(store.types, grid, frame, is_ros1=True)
        writer.write(connection, _NANOSECONDS, store.serialize_ros1(message, OCCUPANCY_GRID))


def _write_ros2(
    bag: Path, suffix: str, records: Callable[[_Types], Iterator[_Record]], latched: set[str]
) -> None:
    from rosbags import interfaces as qos
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    costmap_types: dict[str, Any] = {}
    for name in ("nav2_msgs/Costmap", "nav2_msgs/CostmapMetaData"):  # missing in rosbags
        text = KNOWN[name].replace("; ", "\n")
        costmap_types |= get_types_from_msg(text, bags.normalised_type(name))
    store.register(costmap_types)
    plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
    unset = qos.QosTime(sec=0, nsec=0)
    # as map_server publishes: later subscribers get the last message, too
    as_latched = qos.Qos(
        history=qos.QosHistory.KEEP_LAST, depth=1, reliability=qos.QosReliability.RELIABLE,
        durability=qos.QosDurability.TRANSIENT_LOCAL, deadline=unset, lifespan=unset,
        liveliness=qos.QosLiveliness.AUTOMATIC, liveliness_lease_duration=unset,
        avoid_ros_namespace_conventions=False,
    )  # fmt: skip
    connections: dict[str, Any] = {}
    with Writer(bag, version=_VERSION, storage_plugin=plugin) as writer:
        for topic, name, time, message in records(store.types):
            if topic not in connections:
                profiles = [as_latched] if topic in latched else []
                connections[topic] = writer.add_connection(
                    topic, name, typestore=store, offered_qos_profiles=profiles
                )
            writer.write(connections[topic], time, store.serialize_cdr(message, name))
    if plugin is StoragePlugin.MCAP:
        add_checksums(bag / f"{bag.name}{suffix}")


def _is_nav2_costmap(grid: OccupancyGrid | Costmap) -> bool:
    return isinstance(grid, Costmap) and grid.scale == "costmap2d"


@contextmanager
def _scratch(transaction: Transaction, output: Path) -> Iterator[Path]:
    """Yield a temporary path for a bag, because rosbags writes to paths; then write the output."""
    with access_to(output, "written"), temporary_folder() as folder:
        bag = folder / bags.name_inside(output)
        try:
            yield bag
        except sqlite3.Error as error:  # such as a full disk, or a map beyond its largest blob
            raise FileAccessError(f"cannot be written: {error}", source=output) from None
        is_file = output.suffix == ".bag"
        files = [bag] if is_file else [bag / f"{bag.name}{output.suffix}", bag / bags.METADATA]
        for path, file in zip(bags.bag_paths(output), files, strict=False):
            transaction.write_parts(path, chunks_of(file))


def _geometry(types: _Types, kind: str, *values: Any) -> Any:
    return types[f"geometry_msgs/msg/{kind}"](*values)


def _upright(types: _Types, yaw: float) -> Any:
    return _geometry(types, "Quaternion", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def _pose(types: _Types, x: float, y: float, yaw: float) -> Any:
    return _geometry(types, "Pose", _geometry(types, "Point", x, y, 0.0), _upright(types, yaw))


def _message(
    types: _Types, grid: OccupancyGrid | Costmap, frame: str, *, is_ros1: bool,
    time: int = _NANOSECONDS,
) -> Any:  # fmt: skip
    stamp = types["builtin_interfaces/msg/Time"](*divmod(time, _SECOND))
    sequence = {"seq": 0} if is_ros1 else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **sequence)
    origin = _pose(types, *grid.origin)
    height, width = grid.shape
    resolution = float(np.float32(grid.resolution))
    values = np.ascontiguousarray(grid.layer).reshape(-1)
    if _is_nav2_costmap(grid):
        info = types["nav2_msgs/msg/CostmapMetaData"](
            map_load_time=stamp, update_time=stamp, layer="master", resolution=resolution,
            size_x=width, size_y=height, origin=origin,
        )  # fmt: skip
        return types[NAV2_COSTMAP](header=header, metadata=info, data=values.view(np.uint8))
    info = types["nav_msgs/msg/MapMetaData"](
        map_load_time=stamp, resolution=resolution, width=width, height=height, origin=origin
    )
    return types[OCCUPANCY_GRID](header=header, info=info, data=values.view(np.int8))


def add_checksums(path: Path) -> None:
    """Write the checksums of the chunks, which must be uncompressed, the data and the summary."""
    # mcap.dev, "MCAP Format Specification": CRC-32 of a chunk's records; of all bytes before the
    # record DataEnd; and of those from the summary to the footer's own checksum. DataEnd's checksum
    # covers those of the chunks, which therefore come first.
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as data, memoryview(data) as view:
        position, opcode = len(chunked.MCAP_MAGIC), 0
        while opcode != _FOOTER:
            opcode, length = struct.unpack_from("<BQ", data, position)
            start = position + 9
            position = start + length
            if opcode not in _BEFORE_CHECKSUM:
                continue
            place = start + _BEFORE_CHECKSUM[opcode]
            first, end = 0, start - 9
            if opcode == _CHUNK:
                (name,) = struct.unpack_from("<I", data, place + 4)
                first, end = place + 4 + 4 + name + 8, position
            elif opcode == _FOOTER:
                (first,) = struct.unpack_from("<Q", data, start)
                if not first:  # there is no summary
                    continue
                end = place
            struct.pack_into("<I", data, place, crc32(view[first:end]))
