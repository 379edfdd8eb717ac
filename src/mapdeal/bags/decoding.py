"""Decoding of messages of ROS 1 and ROS 2 by the definitions of their types."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from mapdeal.bags.bag import normalised_type

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

    @property
    def size(self) -> int:
        """Bytes of a single number; 0 for all other fields."""
        is_number = self.length is None and self.kind in _FORMATS
        return struct.calcsize(_FORMATS[self.kind]) if is_number else 0


Types = Mapping[str, list[tuple[int, list[_Field], str]]]


def decoded(data: bytes, name: str, types: Types, *, is_ros1: bool) -> Any:
    message = _Message(data, types, is_ros1=is_ros1)
    value = message.read(name)
    if not 0 <= len(data) - message.at <= (0 if is_ros1 else 3):
        raise ValueError(f"has {len(data)} bytes, of which {message.at} are described")
    return value


@lru_cache(maxsize=32)
def types_in(name: str, definition: str) -> Types:
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
        normalised_type(key): _fields_of(lines, key.partition("/")[0])
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
            kind = _ROS1_NAMES.get(kind) or normalised_type(full_name)
        is_fixed = match["array"] and match["length"] and not match["bound"]
        length = None if not match["array"] else int(match["length"]) if is_fixed else 0
        fields.append(_Field(text[: match.end()].split()[1], kind, length))
        if is_fixed:
            check_array_lengths([int(match["length"])])
    return fields


def check_array_lengths(lengths: Sequence[int]) -> None:
    if min(lengths, default=1) < 1 or sum(lengths) > _LONGEST_ARRAYS:
        rule = f"fixed lengths of arrays must be 1 or more, and {_LONGEST_ARRAYS} together at most"
        raise ValueError(rule)


class _Message:
    def __init__(self, data: bytes, types: Types, *, is_ros1: bool) -> None:
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
