"""The footprint of ROS 1's costmap_2d: ``makeFootprintFromParams`` and what comes after it.

A list is printed with six significant digits, and a string is read as float32: the polygon in use
has been through both. Names are searched for in the costmap's namespace and all above it.
"""

from __future__ import annotations

import math

from mapdeal.formats.ros_parameters.ros1 import UNSENDABLE, Path1, Ros1Namespace
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.grid.footprint import Footprint
from mapdeal.records import dataclass
from mapdeal.robot.footprints import (
    MOST_CORNERS,
    FootprintStringError,
    corners_of_string,
    oddities_of,
    padded_corners,
    radii_of,
    sixteen_corners,
)
from mapdeal.robot.ros1_server import Ros1Server, type_hint

_FOOTPRINT, _RADIUS = "footprint", "robot_radius"
_DEFAULT_RADIUS, _LARGEST_RADIUS = 0.46, 10.0
_RADIUS_OF_WRONG_TYPE = 1.234
_LARGEST_SINGLE = 3.4e38
_LIKE_THIS = "write [[x1, y1], [x2, y2], [x3, y3], ...], metres"

Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Ros1Shape:
    """The padded polygon, its radii, and the radius that it was made of."""

    footprint: Footprint
    padding: float
    robot_radius: float | None
    inscribed_radius: float
    circumscribed_radius: float


def ros1_shape(server: Ros1Server) -> Ros1Shape | None:
    """Return the robot's shape; None if the node ends before there is one."""
    padding = server.double(0.01, "footprint_padding", unit=" m")
    found = server.search(_FOOTPRINT)
    radius = None
    corners = None if found is None else _of_parameter(server, *found)
    if corners is None:
        if any(one.level == "refused" and one.parameter == _FOOTPRINT for one in server.problems):
            return None
        radius = _radius(server)
        corners = sixteen_corners(radius)
    if len(corners) > MOST_CORNERS:
        text = f"must not have more than {MOST_CORNERS} points"
        value = None if found is None else found[1]
        server.problem("params.too-large", "refused", text, value, (_FOOTPRINT,))
        return None
    padded = padded_corners(corners, padding)
    for text in oddities_of(padded) if radius is None else ():
        value = None if found is None else found[1]
        text = f"{text}; its radii are meaningless"
        server.problem("params.outline", "warning", text, value, (_FOOTPRINT,))
    inscribed, circumscribed = radii_of(padded)
    return Ros1Shape(Footprint(vertices=padded), padding, radius, inscribed, circumscribed)


def _of_parameter(
    server: Ros1Server, place: Path1, value: ParameterValue | Ros1Namespace
) -> Corners | None:
    """Return the corners that ``footprint`` has; None where the radius counts."""
    if isinstance(value, ParameterValue) and value.kind == "list":
        return _of_list(server, value)
    if isinstance(value, ParameterValue) and value.kind == "string":
        return _of_string(server, value, is_own=place == server.path)
    if isinstance(value, ParameterValue) and value.kind == UNSENDABLE:
        return None
    text = "must be a list of points or a string; it is ignored, and robot_radius is used"
    server.problem("params.footprint-unused", "warning", text, value, (_FOOTPRINT,), _LIKE_THIS)
    return None


def _of_string(server: Ros1Server, value: ParameterValue, *, is_own: bool) -> Corners | None:
    if value.value in ("", "[]"):
        return None
    if "$(" in value.value:
        text = "must be a list of points, which a launch file would replace"
        hint = "write the points themselves, in this file or in one that comes after it"
        server.problem("params.substitution", "refused", text, value, (_FOOTPRINT,), hint)
        return None
    try:
        written = ",".join(f"[{x:g},{y:g}]" for x, y in corners_of_string(value.value))
        return corners_of_string(f"[{written}]")
    except FootprintStringError as error:
        if not is_own or server.search(_RADIUS) is not None:
            text = f"{error}; it is ignored, and robot_radius is used"
            server.problem(
                "params.footprint-unused", "warning", text, value, (_FOOTPRINT,), _LIKE_THIS
            )
        else:
            text = f"{error}, and there is no robot_radius: the robot has no footprint"
            server.problem("params.footprint", "refused", text, value, (_FOOTPRINT,), _LIKE_THIS)
        return None


def _of_list(server: Ros1Server, value: ParameterValue) -> Corners | None:
    reason = _why_not(value.value)
    if reason is not None:
        text = f"{reason}; move_base exits"
        server.problem("params.footprint", "refused", text, value, (_FOOTPRINT,), _LIKE_THIS)
        return None
    # writeFootprintToParam prints doubles as a C++ stream does, and readFootprintFromConfig
    # reads what it has printed
    written = ",".join(f"[{float(x):g},{float(y):g}]" for x, y in value.value)
    return corners_of_string(f"[{written}]")


def _why_not(points: list[object]) -> str | None:
    """Return why ``makeFootprintFromXMLRPC`` throws; None if it does not."""
    if len(points) < 3:
        return f"a footprint needs three points or more, has {len(points)}"
    for index, point in enumerate(points, 1):
        if not isinstance(point, list) or len(point) != 2:
            return f"point {index} is not a pair of numbers"
        if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in point):
            return f"point {index} is not a pair of numbers"
        if not all(abs(one) <= _LARGEST_SINGLE for one in point):
            return f"point {index} is out of range"
    return None


def _radius(server: Ros1Server) -> float:
    """Return the radius that is in use where there are no corners."""
    found = server.search(_RADIUS)
    if found is None:
        text = f"neither footprint nor robot_radius is set; ROS uses a radius of {_DEFAULT_RADIUS}"
        server.problem("params.no-shape", "warning", f"{text} m", hint="set one of them")
        return _DEFAULT_RADIUS
    value = found[1]
    if isinstance(value, ParameterValue) and value.kind == UNSENDABLE:
        return _DEFAULT_RADIUS
    if not isinstance(value, ParameterValue) or value.kind not in ("int", "double"):
        _wrong_radius(server, value)
        return _RADIUS_OF_WRONG_TYPE
    radius = float(value.value)
    if not math.isfinite(radius):
        server.problem("params.not-finite", "refused", "must be finite", value, (_RADIUS,))
        return _DEFAULT_RADIUS
    clamped = min(max(radius, 0.0), _LARGEST_RADIUS)
    if clamped != radius:
        text = f"must be 0 .. {_LARGEST_RADIUS:g} m; dynamic_reconfigure makes it {clamped:g}"
        server.problem("params.range", "warning", text, value, (_RADIUS,))
    return clamped


def _wrong_radius(server: Ros1Server, value: ParameterValue | Ros1Namespace) -> None:
    if isinstance(value, ParameterValue) and value.kind == "string" and "$(" in value.value:
        text = "must be a number, which a launch file would replace"
        hint = "write the value itself, in this file or in one that comes after it"
        server.problem("params.substitution", "refused", text, value, (_RADIUS,), hint)
        return
    text = f"must be a number; costmap_2d silently uses {_RADIUS_OF_WRONG_TYPE} m"
    own_hint = type_hint(value, "double") if isinstance(value, ParameterValue) else None
    server.problem("params.silent-default", "warning", text, value, (_RADIUS,), own_hint)
