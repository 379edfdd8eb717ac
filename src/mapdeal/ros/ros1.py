"""Costmap parameters of ROS 1, as costmap_2d takes them.

A list is printed with six significant digits, and a string is read as float32: the polygon in use
has been through both. Names are searched for in the costmap's namespace and all above it.

The rules are those of the constructor of ``Costmap2DROS``, ``loadOldParameters`` and
``copyParentParameters``, of the layers' ``onInitialize``, and of dynamic_reconfigure, which reads
each number once more, takes defaults for other types and moves it into its limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from pathlib import Path
from typing import Literal, TypeVar

from mapdeal.errors import MalformedInputError
from mapdeal.grid.costmap import CostmapLayer, InflationLayer, StaticLayer
from mapdeal.grid.footprint import Footprint
from mapdeal.ros.robot import (
    INJECTED,
    MOST_CORNERS,
    CostmapName,
    FootprintStringError,
    ListedLayer,
    ParameterFile,
    RobotParameters,
    corners_of_string,
    oddities_of,
    padded_corners,
    radii_of,
    sixteen_corners,
    up_to_millimetres,
)
from mapdeal.ros.ros1_files import (
    ROOT,
    UNSENDABLE,
    Path1,
    Ros1File,
    Ros1Namespace,
    merge,
    read_ros1_parameters,
)
from mapdeal.ros.values import ParameterValue, Problem

COSTMAPS = ("global_costmap", "local_costmap")
_NODE = "move_base"
_SUBSTITUTION = "$("
_KINDS = {
    "bool": "true or false", "int": "a whole number", "double": "a number", "string": "text",
}  # fmt: skip

Value = TypeVar("Value", bool, int, float, str)


@dataclass
class Ros1Server:
    """The parameters of one robot, and what was found wrong while they were read."""

    node: Path1
    costmap: CostmapName
    files: tuple[Ros1File, ...] = ()
    root: Ros1Namespace = field(default_factory=Ros1Namespace)
    problems: list[Problem] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The costmap's own namespace, as ROS prints it."""
        return "/" + "/".join(self.path)

    @property
    def path(self) -> Path1:
        """The costmap's own namespace."""
        return (*self.node, f"{self.costmap}_costmap")

    def find(self, *below: str) -> ParameterValue | None:
        """Return a parameter below the costmap; namespaces are none."""
        found = self.root.get((*self.path, *below))
        return found if isinstance(found, ParameterValue) else None

    def has(self, *below: str) -> bool:
        """Return whether there is a parameter or a namespace of this name below the costmap."""
        return self.root.get((*self.path, *below)) is not None

    def search(self, name: str) -> tuple[Path1, ParameterValue | Ros1Namespace] | None:
        """Return what ``searchParam`` finds: in the costmap's namespace, or the nearest above."""
        for depth in range(len(self.path), -1, -1):
            place = self.path[:depth]
            found = self.root.get((*place, name))
            if found is not None:
                return place, found
        return None

    def boolean(self, default: bool, *below: str) -> bool:
        """Return a parameter as ``param(name, bool, default)`` does: other types leave that."""
        return self._typed(default, "bool", below)

    def double(self, default: float, *below: str, unit: str = "") -> float:
        """Return a number as ``param(name, double, default)`` does: whole numbers are numbers."""
        return self._typed(default, "double", below, unit)

    def integer(self, default: int, *below: str) -> int:
        """Return a whole number as ``param(name, int, default)`` does: others are rounded."""
        value = self.find(*below)
        if value is None or value.kind != "double" or not math.isfinite(value.value):
            return self._typed(default, "int", below)
        number = float(value.value)
        # roscpp's own rounding: fmod of a number below 0 is never 0.5 or more
        whole: int = math.floor(number) if math.fmod(number, 1.0) < 0.5 else math.ceil(number)
        if whole != number:
            text = f"must be a whole number; roscpp rounds it to {whole}"
            self.problem("params.silent-default", "warning", text, value, below)
        return whole

    def _typed(self, default: Value, kind: str, below: Path1, unit: str = "") -> Value:
        value = self.find(*below)
        if value is None:
            return default
        fits = ("double", "int") if kind == "double" else (kind,)
        if value.kind == UNSENDABLE:
            return default
        if isinstance(value.value, float) and not math.isfinite(value.value):
            self.problem("params.not-finite", "refused", "must be finite", value, below)
            return default
        if value.kind in fits:
            return type(default)(value.value)
        self._wrong_type(value, kind, below, f"{shown_default(default)}{unit}")
        return default

    def _wrong_type(self, value: ParameterValue, kind: str, below: Path1, default: str) -> None:
        if value.kind == "string" and _SUBSTITUTION in value.value:
            text = f"must be {_KINDS[kind]}, which a launch file would replace"
            hint = "write the value itself, in this file or in one that comes after it"
            self.problem("params.substitution", "refused", text, value, below, hint)
            return
        text = f"must be {_KINDS[kind]}; roscpp silently uses its default, {default}"
        self.problem("params.silent-default", "warning", text, value, below, type_hint(value, kind))

    def problem(
        self,
        check: str,
        level: Literal["refused", "warning", "note"],
        text: str,
        value: ParameterValue | Ros1Namespace | None = None,
        below: Path1 = (),
        hint: str | None = None,
    ) -> None:
        got = value.text if isinstance(value, ParameterValue) else None
        source, line = (None, None) if value is None else (value.source, value.line or None)
        if source is None and self.files:
            source = self.files[-1].source
        self.problems.append(
            Problem(check, level, text, "/".join(below), source, line, got or None, hint)
        )


def shown_default(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, float) else str(value)


def type_hint(value: ParameterValue, kind: str) -> str | None:
    if kind in ("int", "double") and value.kind == "string":
        try:
            number = float(value.value)
        except ValueError:
            return None
        if not math.isfinite(number):
            return None
        quoted = value.text[:1] in ("'", '"')
        why = "" if quoted else "; YAML 1.1 takes this for text"
        written = repr(number)
        if "." not in written:  # 1e-05 is text, too
            written = written.replace("e", ".0e")
        return f"write {written}{', without quotes' if quoted else why}"
    if kind == "bool" and value.value in (0, 1, "true", "false", "True", "False"):
        return f"write {'true' if value.value in (1, 'true', 'True') else 'false'}"
    return None


def load_server(
    paths: Sequence[Path], costmap: CostmapName, namespace: str | None
) -> tuple[Ros1Server, bool]:
    """Return the parameter server after files were loaded, and whether the robot is in it."""
    files, problems = [], []
    for path in paths:
        try:
            one = read_ros1_parameters(path)
        except MalformedInputError as error:
            problems.append(_of_error(error, path))
            continue
        problems += one.faults
        files.append(one)
    owners = [_nodes_in(one.parameters) for one in files]
    node, why_not = _chosen_node([node for found in owners for node in found], namespace)
    server = Ros1Server(node, costmap, tuple(files), problems=problems)
    if why_not is not None:
        server.problems.append(why_not)
        return server, False
    for one, found in zip(files, owners, strict=True):
        if not found and len(files) > 1 and costmap_of_name(one.source) not in (None, costmap):
            text = "is left out: by its name it is a file of the other costmap; "
            text += f"{costmap} was requested"
            hint = "pass it with the files of its own costmap only, or rename it"
            server.problems.append(
                Problem("params.other-costmap", "warning", text, source=one.source, hint=hint)
            )
            continue
        merge(server.root, _place_of(found, node, costmap), _without_root(one.parameters))
        absolute = one.parameters.members.get(ROOT)
        if isinstance(absolute, Ros1Namespace):
            merge(server.root, (), absolute)
    return server, len(files) == len(paths)


def costmap_of_name(path: Path) -> CostmapName | None:
    """Return the costmap that a file is of by its name, where nothing else shows it."""
    names: tuple[CostmapName, CostmapName] = ("global", "local")
    found = [name for name in names if name in path.stem.lower()]
    return found[0] if len(found) == 1 else None


def costmaps_named(files: Sequence[Ros1File]) -> tuple[CostmapName, ...]:
    named: set[str] = set()
    for one in files:
        own = {path[-1] for path, _ in one.parameters.namespaces()} & set(COSTMAPS)
        of_name = None if own else costmap_of_name(one.source)
        named |= own or ({f"{of_name}_costmap"} if of_name else set())
    names: tuple[CostmapName, CostmapName] = ("global", "local")
    return tuple(name for name in names if f"{name}_costmap" in named)


def _without_root(namespace: Ros1Namespace) -> Ros1Namespace:
    members = {name: one for name, one in namespace.members.items() if name != ROOT}
    return Ros1Namespace(namespace.line, namespace.source, members)


def _nodes_in(namespace: Ros1Namespace) -> list[Path1]:
    """Return the names above a costmap's in a file, those nearest to its top alone."""
    found = [
        path[:-1]
        for path, value in (*namespace.namespaces(), *namespace.values())
        if path[-1] in COSTMAPS
    ]
    nearest = min((len(path) for path in found), default=0)
    return list(dict.fromkeys(path for path in found if len(path) == nearest))


def _chosen_node(
    found: Sequence[Path1], namespace: str | None
) -> tuple[Path1, Problem | None]:  # fmt: skip
    """Return the name of the node that has the costmaps, and why it is not known."""
    plain = {tuple(name for name in path if name != ROOT) for path in found}
    longest = [
        path for path in sorted(plain)
        if path and not any(len(o) > len(path) and o[-len(path) :] == path for o in plain)
    ]  # fmt: skip
    asked = tuple(part for part in (namespace or "").split("/") if part)
    spaces = {path[:-1] for path in longest}
    if namespace is not None:
        if any(asked == space for space in spaces):
            longest = [path for path in longest if path[:-1] == asked]
        elif spaces - {()}:
            names = ", ".join("/".join(space) or "/" for space in sorted(spaces))
            text = f"no robot has the namespace {'/'.join(asked) or '/'}"
            return (*asked, _NODE), Problem("params.namespace", "refused", text,
                                            hint=f"namespaces are {names}")  # fmt: skip
        else:
            longest = [(*asked, *path) for path in longest]
    if len(longest) > 1:
        names = ", ".join("/".join(path) for path in longest)
        text = f"costmaps stand below several names: {names}"
        hint = f"choose one with --namespace {'/'.join(longest[0][:-1])}" if spaces - {()} else None
        return longest[0], Problem("params.namespace", "refused", text, hint=hint)
    return (longest[0] if longest else (*asked, _NODE)), None


def _place_of(found: Sequence[Path1], node: Path1, costmap: CostmapName) -> Path1:
    if not found:
        return (*node, f"{costmap}_costmap")
    for path in found:
        below = tuple(name for name in path if name != ROOT)
        if len(below) <= len(node) and node[len(node) - len(below) :] == below:
            return node[: len(node) - len(below)]
    return ()  # it names other robots alone


def _of_error(error: MalformedInputError, path: Path) -> Problem:
    place = error.place or ""
    digits = place.removeprefix("line ").partition(",")[0]
    line = int(digits) if place.startswith("line ") and digits.isdigit() else None
    text = error.rule if line is not None or not place else f"{place}: {error.rule}"
    return Problem("params.syntax", "refused", text, source=path, line=line, hint=error.hint)


_FOOTPRINT, _RADIUS = "footprint", "robot_radius"
_DEFAULT_RADIUS, _LARGEST_RADIUS = 0.46, 10.0
_RADIUS_OF_WRONG_TYPE = 1.234
_LARGEST_SINGLE = 3.4e38
_AS_POLYGON = "write [[x1, y1], [x2, y2], [x3, y3], ...], metres"

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
    server.problem("params.footprint-unused", "warning", text, value, (_FOOTPRINT,), _AS_POLYGON)
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
                "params.footprint-unused", "warning", text, value, (_FOOTPRINT,), _AS_POLYGON
            )
        else:
            text = f"{error}, and there is no robot_radius: the robot has no footprint"
            server.problem("params.footprint", "refused", text, value, (_FOOTPRINT,), _AS_POLYGON)
        return None


def _of_list(server: Ros1Server, value: ParameterValue) -> Corners | None:
    reason = _why_no_footprint(value.value)
    if reason is not None:
        text = f"{reason}; move_base exits"
        server.problem("params.footprint", "refused", text, value, (_FOOTPRINT,), _AS_POLYGON)
        return None
    # writeFootprintToParam prints doubles as a C++ stream does, and readFootprintFromConfig
    # reads what it has printed
    written = ",".join(f"[{float(x):g},{float(y):g}]" for x, y in value.value)
    return corners_of_string(f"[{written}]")


def _why_no_footprint(points: list[object]) -> str | None:
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


_STATIC, _INFLATION = "costmap_2d::StaticLayer", "costmap_2d::InflationLayer"
_OBSTACLE, _VOXEL = "costmap_2d::ObstacleLayer", "costmap_2d::VoxelLayer"
_OWN = (_STATIC, _INFLATION, _OBSTACLE, _VOXEL)
_PARENTS = {
    _STATIC: ("map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space"),
    _INFLATION: ("cost_scaling_factor", "inflation_radius"),
}
"""Parameters of a costmap that override those of its layers."""
_MISSPELT = 0.95
"""As alike as this, a type is misspelt; below it is a plugin of somebody's own."""
_OF_COSTMAPS = frozenset(
    {"always_send_full_costmap", "cost_scaling_factor", "footprint", "footprint_padding",
     "global_frame", "inflation_radius", "lethal_cost_threshold", "map_topic", "map_type",
     "max_obstacle_height", "observation_sources", "obstacle_range", "plugins",
     "publish_frequency", "raytrace_range", "resolution", "robot_base_frame", "robot_radius",
     "rolling_window", "static_map", "track_unknown_space", "transform_tolerance",
     "trinary_costmap", "unknown_cost_value", "update_frequency"}
)  # fmt: skip
"""One of these, of the costmap or of a layer, tells its file from one of another node."""
_LIKE_THIS = 'write - {name: static_layer, type: "costmap_2d::StaticLayer"}'


def ros1_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None
) -> tuple[RobotParameters | None, tuple[Problem, ...]]:
    """Return what ROS 1's costmap files say of a robot and one of its costmaps."""
    server, is_whole = load_server(paths, costmap, namespace)
    if not is_whole:
        return None, tuple(server.problems)
    found = server.root.get(server.path)
    if isinstance(found, Ros1Namespace) and not _is_of_costmap(found) and not _is_named(server):
        names = list(found.members)
        text = f"holds no parameter of a costmap; it has {', '.join(names[:3])}"
        text += ", ..." if len(names) > 3 else ""
        hint = "give Nav2's parameters, with ros__parameters, or the costmap files of ROS 1"
        server.problem("params.namespace", "refused", text, hint=hint)
        return None, tuple(server.problems)
    if found is None:
        text = f"no parameters of {server.name}"
        hint = f"a file of it has {costmap}_costmap: at its top, or no costmap's name at all"
        server.problem("params.namespace", "refused", text, hint=hint)
        return None, tuple(server.problems)
    robot = _resolved(server)
    if any(one.check == "params.substitution" for one in server.problems):
        robot = None  # nobody knows what the launch file says
    places: dict[object, Problem] = {}
    for one in server.problems:
        places.setdefault((one.check, one.source, one.line, one.parameter), one)
    return robot, tuple(places.values())


def _is_of_costmap(namespace: Ros1Namespace) -> bool:
    return any(path[-1] in _OF_COSTMAPS for path, _ in namespace.values())


def _is_named(server: Ros1Server) -> bool:
    """Return whether a file has a costmap's name, and so is of one whatever it holds there."""
    return any(
        path[-1] in COSTMAPS for one in server.files for path, _ in one.parameters.namespaces()
    )


def _resolved(server: Ros1Server) -> RobotParameters | None:
    rolling = server.boolean(False, "rolling_window")
    track = server.boolean(False, "track_unknown_space")
    plugins = _plugins(server) if server.has("plugins") else _old_plugins(server)
    shape = ros1_shape(server)
    inscribed = 0.0 if shape is None else shape.inscribed_radius
    layers = tuple(_layer(server, name, kind, inscribed) for name, kind in plugins or ())
    if plugins is None or shape is None:  # the layers' own problems are told all the same
        return None
    if not any(isinstance(one.layer, StaticLayer) for one in layers):
        if server.costmap == "local":
            injected = StaticLayer(INJECTED)
            layers = (ListedLayer(INJECTED, _STATIC, injected), *layers)
        else:
            text = "no static layer: the costmap does not read the map, and all cells are "
            value = "255, unknown" if track else "0, free"
            server.problem(
                "params.no-static-layer", "warning", text + value, hint=_static_hint(server)
            )
    return RobotParameters(
        flavour="ros1",
        costmap=server.costmap,
        node=server.name,
        footprint=shape.footprint,
        footprint_padding=shape.padding,
        robot_radius=shape.robot_radius,
        track_unknown_space=track,
        rolling_window=rolling,
        layers=layers,
        files=tuple(ParameterFile(one.source, one.sha256) for one in server.files),
        inscribed_radius=shape.inscribed_radius,
        circumscribed_radius=shape.circumscribed_radius,
    )


def _static_hint(server: Ros1Server) -> str:
    return _LIKE_THIS if server.has("plugins") else "set static_map: true"


def _old_plugins(server: Ros1Server) -> list[tuple[str, str]]:
    """Return the layers of a costmap without a list of plugins, as ``loadOldParameters``."""
    voxel = server.find("map_type")
    is_voxel = voxel is not None and voxel.value == "voxel"
    obstacles = ("obstacle_layer", _VOXEL if is_voxel else _OBSTACLE)
    layers = [obstacles, ("inflation_layer", _INFLATION)]
    is_static = server.boolean(False, "static_map")
    return [("static_layer", _STATIC), *layers] if is_static else layers


def _plugins(server: Ros1Server) -> list[tuple[str, str]] | None:
    """Return names and types of the plugins; None if move_base ends over them."""
    value = server.find("plugins")
    if value is not None and value.kind == UNSENDABLE:
        return None
    if value is None or value.kind != "list":
        text = "must be a list of {name, type}; move_base exits"
        server.problem("params.plugins", "refused", text, value, ("plugins",), _LIKE_THIS)
        return None
    found, is_good = [], True
    for index, entry in enumerate(value.value, 1):
        reason, hint = _why_not(entry)
        if reason is None:
            found.append((entry["name"], entry["type"]))
            continue
        is_good = False
        text = f"entry {index} {reason}; move_base exits"
        server.problem("params.plugins", "refused", text, value, ("plugins",), hint)
    return found if is_good else None


def _why_not(entry: object) -> tuple[str | None, str | None]:
    """Return why the costmap cannot load a plugin, and a hint."""
    if not isinstance(entry, dict):
        hint = f"plugins as bare names are Nav2's; {_LIKE_THIS}"
        return "must be a name and a type", hint if isinstance(entry, str) else _LIKE_THIS
    for key in ("name", "type"):
        if not isinstance(entry.get(key), str) or not entry[key]:
            return f"has no {key}", _LIKE_THIS
    kind = entry["type"]
    if kind in _OWN:
        return None, None
    likeness = {own: SequenceMatcher(None, own, kind).ratio() for own in _OWN}
    near = max(_OWN, key=likeness.__getitem__)
    if kind.startswith("nav2_costmap_2d") or likeness[near] >= _MISSPELT:
        return f"has an unknown type, {kind}", f"did you mean {near}?"
    return None, None


def _layer(server: Ros1Server, name: str, kind: str, inscribed: float) -> ListedLayer:
    if kind == _STATIC:
        _hand_down(server, name, kind)
        return ListedLayer(name, kind, _static(server, name), _is_enabled(server, name))
    if kind == _INFLATION:
        _hand_down(server, name, kind)
        layer: CostmapLayer = _inflation(server, name, inscribed)
        return ListedLayer(name, kind, layer, _is_enabled(server, name))
    why = "reads sensors" if kind in (_OBSTACLE, _VOXEL) else "not of costmap_2d; needs live data"
    return ListedLayer(name, kind, None, _is_enabled(server, name), why_ignored=why)


def _is_enabled(server: Ros1Server, name: str) -> bool:
    return server.boolean(True, name, "enabled")


def _hand_down(server: Ros1Server, name: str, kind: str) -> None:
    """Report where the costmap's own value overrides that of a layer."""
    for parameter in _PARENTS[kind]:
        own, above = server.find(name, parameter), server.find(parameter)
        if own is not None and above is not None and own.value != above.value:
            text = f"has no effect: the costmap's own {parameter}, {above.text}, takes its place"
            where = f"on line {above.line}" + (
                "" if above.source == own.source else f" of {above.source.name}"
            )
            server.problem("params.overridden", "warning", text, own, (name, parameter),
                           f"remove one of them; the other stands {where}")  # fmt: skip


def _handed(server: Ros1Server, name: str, parameter: str) -> tuple[str, ...]:
    """Return where a layer's parameter is read: from the costmap, if that has it."""
    return (parameter,) if isinstance(server.find(parameter), ParameterValue) else (name, parameter)


def _static(server: Ros1Server, name: str) -> StaticLayer:
    lethal = server.integer(100, *_handed(server, name, "lethal_cost_threshold"))
    clamped = max(min(lethal, 100), 0)
    if clamped != lethal:
        where = _handed(server, name, "lethal_cost_threshold")
        text = f"must be 0 .. 100; the static layer makes it {clamped}"
        server.problem("params.range", "warning", text, server.find(*where), where)
    track = _handed(server, name, "track_unknown_space")
    return StaticLayer(
        name=name,
        track_unknown_space=server.boolean(True, *track),
        lethal_cost_threshold=clamped,
        trinary_costmap=server.boolean(True, name, "trinary_costmap"),
        unknown_cost_value=server.integer(-1, *_handed(server, name, "unknown_cost_value")) % 256,
        use_maximum=server.boolean(False, name, "use_maximum"),
    )


def _inflation(server: Ros1Server, name: str, inscribed: float) -> InflationLayer:
    def number(parameter: str, default: float, largest: float, unit: str) -> float:
        where = _handed(server, name, parameter)
        value = server.double(default, *where, unit=unit)
        clamped = max(min(value, largest), 0.0)
        if clamped != value:
            text = f"must be 0 .. {largest:g}{unit}; dynamic_reconfigure makes it {clamped:g}"
            server.problem("params.range", "warning", text, server.find(*where), where)
        return clamped

    radius = number("inflation_radius", 0.55, 50.0, " m")
    is_known = all(one.check != "params.substitution" for one in server.problems)
    if 0 < radius < inscribed and is_known:
        where = _handed(server, name, "inflation_radius")
        text = f"{radius:g} m is less than the inscribed radius, {inscribed:.4g} m"
        hint = f"set it to {up_to_millimetres(inscribed)} or more"
        found = server.find(*where)
        server.problem("params.inflation-radius", "warning", text, found, where, hint)
    return InflationLayer(
        name=name,
        inscribed_radius=inscribed,
        inflation_radius=radius,
        cost_scaling_factor=number("cost_scaling_factor", 10.0, 100.0, ""),
        inflate_unknown=server.boolean(False, name, "inflate_unknown"),
        lookup="exact",
    )
