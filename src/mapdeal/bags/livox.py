"""Messages of Livox lidars: ``CustomMsg`` of livox_ros_driver and livox_ros_driver2.

They are decoded with numpy: rosbags would make an object of each of the many thousand points.

References
----------
``msg/CustomMsg.msg`` and ``msg/CustomPoint.msg``, which are identical in both drivers.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError

CUSTOM_TYPES = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")

_POINT = 19  # bytes: the time as uint32, x, y and z as float32, and three uint8
_BEFORE_POINTS = 20  # bytes: timebase, point_num, lidar_id, rsvd, and the number of points


def points_of_custom(data: bytes, encoding: str) -> NDArray[np.float64]:
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
    first, stride = start + _BEFORE_POINTS, _POINT if is_ros1 else _POINT + 1
    if first + (count - 1) * stride + _POINT > len(data):
        rule = f"must have {count} points of {stride} bytes"
        raise MalformedInputError(rule, place="points", got=f"{max(0, len(data) - first)} bytes")
    if not count:
        return np.empty((0, 3))
    return np.ndarray((count, 3), f"{order}f4", data, first + 4, (stride, 4)).astype(np.float64)
