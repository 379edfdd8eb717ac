"""Costmap parameters of ROS 1, read as by rosparam and interpreted as by costmap_2d.

Values are those of PyYAML's safe loader, YAML 1.1: ``1e-1`` is text, ``010`` is eight and ``yes``
is true. Nested mappings become namespaces, which are merged; later values replace earlier ones.
Some parameters are searched for in the costmap's namespace and in all namespaces above it.

References
----------
The constructor of ``Costmap2DROS``, ``loadOldParameters`` and ``copyParentParameters``, the layers'
``onInitialize``, and dynamic_reconfigure, which reads each number again, uses defaults for other
types, and clamps it to its limits.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.files import yaml_text
from mapdeal.files.source import read_file
from mapdeal.layers.catalogue import ROS1_PLUGINS
from mapdeal.layers.layer import PluginEntry
from mapdeal.layers.stack import CostmapArea
from mapdeal.records import dataclass, field, replace
from mapdeal.ros import robot
from mapdeal.ros.robot import CostmapName, Level, ListedLayer, ParameterValue, Problem
from mapdeal.ros.ros2_files import line_of

_INT32 = 1 << 31


def _value_of(source: Path, node: yaml.Node) -> Any:
    try:
        return yaml.SafeLoader("").construct_document(node)
    # If a tag does not fit its value, PyYAML's constructors raise any of these.
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError,
            OverflowError) as error:  # fmt: skip
        rule = f"cannot be read ({yaml_text.one_line_of(error)})"
        raise MalformedInputError(rule, source=source, place=f"line {line_of(node)}") from None


def _kind_of(value: Any) -> str:
    names = {bool: "bool", int: "int", float: "double", str: "string", list: "list", dict: "struct"}
    return "nothing" if value is None else names.get(type(value), type(value).__name__)


def why_unsendable(value: Any) -> tuple[str, str, str | None] | None:
    """Return why roslaunch cannot send a value to the parameter server: check, text and hint."""
    if value is None:
        hint = "give it a value, or remove the line"
        return "params.empty", "has no value, and roslaunch exits", hint
    if isinstance(value, bool | str | float):
        return None
    if isinstance(value, int):
        text = "roslaunch sends 32-bit integers only"
        return None if -_INT32 <= value < _INT32 else ("params.type", text, None)
    if isinstance(value, list):
        return next(filter(None, map(why_unsendable, value)), None)
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value):
            return "params.name", "names must be text", "put them in quotes"
        return next(filter(None, map(why_unsendable, value.values())), None)
    text = f"is a {_kind_of(value)}, which roslaunch cannot send"
    return "params.type", text, "put it in quotes"


_LIMITS = yaml_text.YamlLimits(bytes=1 << 20, nodes=50_000, aliases=200)
_ROOT = ""  # top-level key, in a file's tree, of the names that begin with a slash
_UNSENDABLE = "unsendable"  # kind of a value that roslaunch cannot send, reported as a fault

_Path = tuple[str, ...]


@dataclass(frozen=True)
class Ros1Namespace:
    """Parameters and nested namespaces by name, in the order of loading."""

    kind: ClassVar[str] = "struct"
    value: ClassVar[Any] = None
    text: ClassVar[str] = ""

    line: int = 0
    source: Path | None = None
    members: dict[str, ParameterValue | Ros1Namespace] = field(default_factory=dict)

    def get(self, path: _Path) -> ParameterValue | Ros1Namespace | None:
        member: ParameterValue | Ros1Namespace | None = self
        for name in path:
            if not isinstance(member, Ros1Namespace):
                return None
            member = member.members.get(name)
        return member

    def values(self) -> Iterator[tuple[_Path, ParameterValue]]:
        for name, member in self.members.items():
            if isinstance(member, Ros1Namespace):
                yield from (((name, *path), value) for path, value in member.values())
            else:
                yield (name,), member

    def namespaces(self) -> Iterator[tuple[_Path, Ros1Namespace]]:
        for name, member in self.members.items():
            if isinstance(member, Ros1Namespace):
                yield (name,), member
                yield from (((name, *path), namespace) for path, namespace in member.namespaces())

    def below(self, path: _Path, source: Path | None, line: int) -> Ros1Namespace:
        """Return the namespace at a path; create it, also in place of values on the path."""
        namespace = self
        for name in path:
            member = namespace.members.get(name)
            if not isinstance(member, Ros1Namespace):
                member = namespace.members[name] = Ros1Namespace(line, source)
            namespace = member
        return namespace

    def set(self, path: _Path, value: ParameterValue) -> None:
        self.below(path[:-1], value.source, value.line).members[path[-1]] = value

    def merge(self, prefix: _Path, namespace: Ros1Namespace) -> None:
        for path, value in namespace.values():
            self.set((*prefix, *path), value)
        for path, nested in namespace.namespaces():  # lint reports empty namespaces, too
            self.below((*prefix, *path), nested.source, nested.line)


@dataclass(frozen=True)
class Ros1File:
    source: Path
    sha256: str
    parameters: Ros1Namespace
    faults: tuple[Problem, ...] = ()


def read_ros1_parameters(path: Path) -> Ros1File:
    return parse_ros1_parameters(path, read_file(path, limit=_LIMITS.bytes))


def parse_ros1_parameters(path: Path, data: bytes) -> Ros1File:
    reader = _Reader(path)
    documents = yaml_text.compose_documents(path, data, _LIMITS)
    for node in documents:
        if not isinstance(node, yaml.MappingNode):
            kind = "list" if isinstance(node, yaml.SequenceNode) else "single value"
            raise MalformedInputError(f"must be a mapping of parameters, is a {kind}", source=path)
        reader.add((), node)
    if len(documents) > 1:
        text = "roslaunch reads files of one document"
        hint = "remove the ---, or load the file with rosparam load"
        reader.fault("params.syntax", "refused", text, line_of(documents[1]), hint=hint)
    return Ros1File(path, hashlib.sha256(data).hexdigest(), reader.tree, tuple(reader.faults))


class _Reader:
    def __init__(self, source: Path) -> None:
        self.source, self.tree = source, Ros1Namespace(1, source)
        self.faults: list[Problem] = []

    def fault(
        self, check: str, level: Level, text: str, line: int, parameter: str = "",
        got: str | None = None, hint: str | None = None,
    ) -> None:  # fmt: skip
        self.faults.append(Problem(check, level, text, parameter, self.source, line, got, hint))

    def add(self, path: _Path, node: yaml.MappingNode) -> None:
        for key, value in self._pairs(path, node):
            if not (parameter := _joined(path, key)):
                continue
            if isinstance(value, yaml.MappingNode) and not value.tag.startswith("!"):
                self.tree.below(parameter, self.source, line_of(value))
                self.add(parameter, value)
            else:
                self._set(parameter, value)

    def _pairs(self, path: _Path, node: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node]]:
        """Yield names and nodes of a mapping; of a repeated name only the last node."""
        pairs: dict[str, tuple[int, yaml.Node]] = {}
        own_keys = {id(key) for key, _ in node.value}
        for key, value in yaml_text.flattened(self.source, node):
            name, line = _value_of(self.source, key), line_of(key)
            if not isinstance(name, str):
                parameter, got = "/".join((*path, str(key.value))), f"{_kind_of(name)} {key.value}"
                self.fault("params.name", "refused", "names must be text", line, parameter, got,
                           "put it in quotes")  # fmt: skip
                continue
            if name in pairs and id(key) in own_keys and pairs[name][0] > 0:
                first, earlier = pairs[name]
                is_equal = _value_of(self.source, earlier) == _value_of(self.source, value)
                problem = robot.repetition(first, line, is_equal=is_equal)
                self.fault(*problem, line, "/".join((*path, name)))
            pairs.pop(name, None)
            pairs[name] = (line if id(key) in own_keys else 0, value)
        for name, (_, value) in pairs.items():
            yield name, value

    def _set(self, path: _Path, node: yaml.Node) -> None:
        value = _value_of(self.source, node)
        text, line = yaml_text.source_text(node), line_of(node)
        kind = _kind_of(value)
        if (reason := why_unsendable(value)) is not None:
            check, rule, hint = reason
            kind = _UNSENDABLE
            self.fault(check, "refused", rule, line, "/".join(path).lstrip("/"), text or None, hint)
        self.tree.set(path, ParameterValue(value, kind, self.source, line, text))


def _joined(path: _Path, name: str) -> _Path:
    """Return path and name joined, as ``ns_join``; a leading slash starts at the root."""
    parts = tuple(part for part in name.split("/") if part)
    return (_ROOT, *parts) if name.startswith("/") else (*path, *parts)


_NAMES: tuple[CostmapName, ...] = ("global", "local")
_COSTMAPS = tuple(f"{name}_costmap" for name in _NAMES)
_NODE, _RECONFIGURE = "move_base", "dynamic_reconfigure"
_KINDS = {"bool": "true or false", "int": "a whole number", "double": "a number", "string": "text"}

_Value = TypeVar("_Value", bool, int, float, str)


@dataclass
class Ros1Server:
    node: _Path
    costmap: CostmapName
    files: tuple[Ros1File, ...] = ()
    root: Ros1Namespace = field(default_factory=Ros1Namespace)
    problems: list[Problem] = field(default_factory=list)

    @property
    def path(self) -> _Path:
        return (*self.node, f"{self.costmap}_costmap")

    def find(self, *below: str) -> ParameterValue | None:
        member = self.root.get((*self.path, *below))
        return member if isinstance(member, ParameterValue) else None

    def search(self, name: str) -> tuple[_Path, ParameterValue | Ros1Namespace] | None:
        """Return what ``searchParam`` finds: in the costmap's namespace, or the nearest above."""
        for depth in range(len(self.path), -1, -1):
            if (member := self.root.get((*self.path[:depth], name))) is not None:
                return self.path[:depth], member
        return None

    def place(self, layer: str, parameter: str) -> _Path:
        """Return the path of a layer's parameter: the costmap's own value has precedence."""
        return (layer, parameter) if self.find(parameter) is None else (parameter,)

    @property
    def is_substituted(self) -> bool:
        """Whether a launch file replaces a value, so that results would be meaningless."""
        return any(problem.check == "params.substitution" for problem in self.problems)

    def boolean(self, default: bool, *below: str) -> bool:
        """Return a parameter as ``param(name, bool, default)``: other types give the default."""
        return self._typed(default, "bool", below)

    def double(self, default: float, *below: str, unit: str = "") -> float:
        """Return a number as ``param(name, double, default)``: integers are converted."""
        return self._typed(default, "double", below, unit)

    def text(self, default: str, *below: str) -> str:
        value = self.find(*below)
        return value.value if value is not None and value.kind == "string" else default

    def integer(self, default: int, *below: str) -> int:
        """Return an integer as ``param(name, int, default)``: doubles are rounded."""
        value = self.find(*below)
        if value is None or value.kind != "double" or not math.isfinite(value.value):
            return self._typed(default, "int", below)
        number = float(value.value)
        # as in roscpp: fmod of a negative number is at most 0, so negative numbers are rounded down
        rounded: int = math.floor(number) if math.fmod(number, 1.0) < 0.5 else math.ceil(number)
        if rounded != number:
            text = f"must be a whole number; roscpp rounds it to {rounded}"
            self.problem("params.silent-default", "warning", text, below)
        return rounded

    def clamp(
        self, number: float, upper: float, component: str, below: _Path, unit: str = "",
        value: ParameterValue | Ros1Namespace | None = None,
    ) -> float:  # fmt: skip
        clamped = max(min(number, upper), 0.0)
        if clamped != number:
            text = f"must be 0 .. {upper:g}{unit}; {component} clamps it to {clamped:g}"
            self.problem("params.range", "warning", text, below, value=value)
        return clamped

    def _typed(self, default: _Value, kind: str, below: _Path, unit: str = "") -> _Value:
        value = self.find(*below)
        if value is None or value.kind == _UNSENDABLE:
            return default
        if isinstance(value.value, float) and not math.isfinite(value.value):
            self.problem("params.not-finite", "refused", "must be finite", below)
        elif value.kind == kind or (kind == "double" and value.kind == "int"):
            return type(default)(value.value)
        elif not self.refuse_substitution(value, _KINDS[kind], below):
            shown = f"{float(default):g}" if kind == "double" else str(default).lower()
            text = f"must be {_KINDS[kind]}; roscpp silently uses its default, {shown}{unit}"
            self.problem("params.silent-default", "warning", text, below, _type_hint(value, kind))
        return default

    def refuse_substitution(
        self, value: ParameterValue | Ros1Namespace, expected: str, below: _Path,
        replacement: str = "the value itself",
    ) -> bool:  # fmt: skip
        """Return whether a launch file replaces a text; record a problem if so."""
        if value.kind != "string" or "$(" not in str(value.value):
            return False
        text = f"must be {expected}, which a launch file would replace"
        hint = f"write {replacement}, in this file or in one that comes after it"
        self.problem("params.substitution", "refused", text, below, hint, value)
        return True

    def problem(
        self, check: str, level: Level, text: str, below: _Path = (), hint: str | None = None,
        value: ParameterValue | Ros1Namespace | None = None,
    ) -> None:  # fmt: skip
        value = value or (self.find(*below) if below else None) or Ros1Namespace()
        source = value.source or (self.files[-1].source if self.files else None)
        place = "/".join(below), source, value.line or None, value.text or None
        self.problems.append(Problem(check, level, text, *place, hint))


def _type_hint(value: ParameterValue | Ros1Namespace, kind: str) -> str | None:
    if kind in ("int", "double") and value.kind == "string":
        with suppress(ValueError):
            number = float(value.value)
            is_quoted = value.text[:1] in ("'", '"')
            why = ", without quotes" if is_quoted else "; YAML 1.1 takes this for text"
            shown = repr(number) if "." in repr(number) else repr(number).replace("e", ".0e")
            return f"write {shown}{why}" if math.isfinite(number) else None  # 1e-05 is text, too
    if kind == "bool" and value.value in (0, 1, "true", "false", "True", "False"):
        return f"write {'true' if value.value in (1, 'true', 'True') else 'false'}"
    return None


def load_server(
    paths: Sequence[Path], costmap: CostmapName, namespace: str | None
) -> tuple[Ros1Server, bool]:
    files: list[Ros1File] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            files.append(read_ros1_parameters(path))
            problems += files[-1].faults
        except MalformedInputError as error:
            problems.append(robot.syntax_problem(error, path))
    nodes_by_file = [_nodes_in(file.parameters) for file in files]
    node, problem = _select_node([path for nodes in nodes_by_file for path in nodes], namespace)
    server = Ros1Server(node, costmap, tuple(files), problems=problems)
    if problem is not None:
        problems.append(problem)
        return server, False
    for file, nodes in zip(files, nodes_by_file, strict=True):
        if not nodes and len(files) > 1 and _costmap_of_name(file.source) not in (None, costmap):
            problems.append(_other_costmap(file.source, costmap))
        else:
            members = dict(file.parameters.members)
            absolute = members.pop(_ROOT, None)
            server.root.merge(_place_of(nodes, node, costmap), Ros1Namespace(members=members))
            if isinstance(absolute, Ros1Namespace):  # names with a leading slash
                server.root.merge((), absolute)
    return server, len(files) == len(paths)


def _other_costmap(path: Path, costmap: CostmapName) -> Problem:
    text = f"is ignored: by its name it belongs to the other costmap; {costmap} was requested"
    hint = "pass it with the files of its own costmap only, or rename it"
    return Problem("params.other-costmap", "warning", text, source=path, hint=hint)


def _costmap_of_name(path: Path) -> CostmapName | None:
    names = [name for name in _NAMES if name in path.stem.lower()]
    return names[0] if len(names) == 1 else None


def costmaps_named(files: Sequence[Ros1File]) -> tuple[CostmapName, ...]:
    named: set[str | None] = set()
    for file in files:
        costmaps = {path[-1] for path, _ in file.parameters.namespaces()} & set(_COSTMAPS)
        names = {name.removesuffix("_costmap") for name in costmaps}
        named |= names or {_costmap_of_name(file.source)}
    return tuple(name for name in _NAMES if name in named)


def settings_of_robot(file: Ros1File) -> set[_Path]:
    """Return where a file sets a costmap's layers and shape: its namespace, and which of them."""
    kinds = {"plugins": "plugins", _FOOTPRINT: _FOOTPRINT, _RADIUS: _FOOTPRINT}
    named = _costmap_of_name(file.source) or ""
    return {
        (*(path[:-1] or (named,)), kinds[path[-1]])
        for path, _ in file.parameters.values() if path[-1] in kinds
    }  # fmt: skip


def _nodes_in(namespace: Ros1Namespace) -> list[_Path]:
    """Return the paths of the nodes above a file's costmaps, only those of the least depth."""
    members = (*namespace.namespaces(), *namespace.values())
    nodes = [path[:-1] for path, _ in members if path[-1] in _COSTMAPS]
    least_depth = min(map(len, nodes), default=0)
    return list(dict.fromkeys(node for node in nodes if len(node) == least_depth))


def _select_node(paths: Sequence[_Path], namespace: str | None) -> tuple[_Path, Problem | None]:
    relative_paths = {tuple(name for name in path if name != _ROOT) for path in paths}
    ends = {path[start:] for path in relative_paths for start in range(1, len(path) + 1)}
    nodes = sorted(relative_paths - ends - {()})
    requested = tuple(part for part in (namespace or "").split("/") if part)
    spaces = {path[:-1] for path in nodes}
    if requested in spaces and namespace is not None:
        nodes = [path for path in nodes if path[:-1] == requested]
    elif namespace is not None and spaces - {()}:
        names = ", ".join("/".join(space) or "/" for space in sorted(spaces))
        text = f"no robot has the namespace {'/'.join(requested) or '/'}"
        hint = f"namespaces are {names}"
        return (*requested, _NODE), Problem("params.namespace", "refused", text, hint=hint)
    else:
        nodes = [(*requested, *path) for path in nodes]
    if len(nodes) > 1:
        text = f"costmaps have several parent nodes: {', '.join(map('/'.join, nodes))}"
        choice = f"choose one with --namespace {'/'.join(nodes[0][:-1])}" if spaces - {()} else None
        return nodes[0], Problem("params.namespace", "refused", text, hint=choice)
    return (nodes[0] if nodes else (*requested, _NODE)), None


def _place_of(nodes: Sequence[_Path], node: _Path, costmap: CostmapName) -> _Path:
    if not nodes:
        return (*node, f"{costmap}_costmap")
    for path in nodes:
        relative = tuple(name for name in path if name != _ROOT)
        depth = len(node) - len(relative)
        if depth >= 0 and node[depth:] == relative:
            return node[:depth]
    return ()  # the file names only other robots


_FOOTPRINT, _RADIUS = "footprint", "robot_radius"
_DEFAULT_RADIUS, _LARGEST_RADIUS = 0.46, 10.0
_RADIUS_OF_WRONG_TYPE = 1.234
_LARGEST_SINGLE = 3.4e38
_POLYGON_HINT = "write [[x1, y1], [x2, y2], [x3, y3], ...], metres"


def _shape(server: Ros1Server) -> robot.Shape | None:
    padding = server.double(0.01, "footprint_padding", unit=" m")
    place, value = server.search(_FOOTPRINT) or ((), None)
    corners = None if value is None else _corners(server, place, value)
    radius = None
    if corners is None:
        if any(p.level == "refused" and p.parameter == _FOOTPRINT for p in server.problems):
            return None
        radius = _radius(server)
        corners = robot.sixteen_corners(radius)
    report = partial(server.problem, below=(_FOOTPRINT,), value=value)
    return robot.shape_of(corners, padding, radius, report)


def _corners(
    server: Ros1Server, place: _Path, value: ParameterValue | Ros1Namespace
) -> robot.Corners | None:
    def report(text: str, check: str = "params.footprint-unused", level: Level = "warning") -> None:
        server.problem(check, level, text, (_FOOTPRINT,), _POLYGON_HINT, value)

    points = value.value
    if value.kind == _UNSENDABLE:
        return None
    if value.kind == "list":
        if (reason := _footprint_fault(points)) is None:
            return _round_trip(points)
        report(f"{reason}; move_base exits", "params.footprint", "refused")
    elif value.kind != "string":
        report("must be a list of points or a string; it is ignored, and robot_radius is used")
    elif points not in ("", "[]") and not server.refuse_substitution(
        value, "a list of points", (_FOOTPRINT,), "the points themselves"
    ):
        try:
            return _round_trip(robot.corners_of_string(points))
        except robot.FootprintStringError as error:
            if place != server.path or server.search(_RADIUS) is not None:
                report(f"{error}; it is ignored, and robot_radius is used")
            else:
                text = f"{error}, and there is no robot_radius: the robot has no footprint"
                report(text, "params.footprint", "refused")
    return None


def _round_trip(points: Sequence[Sequence[float]]) -> robot.Corners:
    # writeFootprintToParam prints doubles as a C++ stream does, with six significant digits;
    # readFootprintFromConfig parses that text
    text = ",".join(f"[{float(x):g},{float(y):g}]" for x, y in points)
    return robot.corners_of_string(f"[{text}]")


def _footprint_fault(points: list[object]) -> str | None:
    """Return the reason why ``makeFootprintFromXMLRPC`` throws; None if it succeeds."""
    if len(points) < 3:
        return f"a footprint needs three points or more, has {len(points)}"
    for index, point in enumerate(points, 1):
        kinds = {_kind_of(coordinate) for coordinate in point} if isinstance(point, list) else set()
        if not isinstance(point, list) or len(point) != 2 or not kinds <= {"int", "double"}:
            return f"point {index} is not a pair of numbers"
        if not all(abs(coordinate) <= _LARGEST_SINGLE for coordinate in point):
            return f"point {index} is out of range"
    return None


def _radius(server: Ros1Server) -> float:
    if (found_radius := server.search(_RADIUS)) is None:
        text = f"neither footprint nor robot_radius is set; ROS uses a radius of {_DEFAULT_RADIUS}"
        server.problem("params.no-shape", "warning", f"{text} m", hint="set one of them")
        return _DEFAULT_RADIUS
    value = found_radius[1]
    if value.kind == _UNSENDABLE:
        return _DEFAULT_RADIUS
    if value.kind not in ("int", "double"):
        if not server.refuse_substitution(value, "a number", (_RADIUS,)):
            text = f"must be a number; costmap_2d silently uses {_RADIUS_OF_WRONG_TYPE} m"
            hint = _type_hint(value, "double")
            server.problem("params.silent-default", "warning", text, (_RADIUS,), hint, value)
        return _RADIUS_OF_WRONG_TYPE
    radius = float(value.value)
    if not math.isfinite(radius):
        server.problem("params.not-finite", "refused", "must be finite", (_RADIUS,), value=value)
        return _DEFAULT_RADIUS
    return server.clamp(radius, _LARGEST_RADIUS, _RECONFIGURE, (_RADIUS,), " m", value)


_STATIC, _INFLATION = "costmap_2d::StaticLayer", "costmap_2d::InflationLayer"
_OBSTACLE, _VOXEL = "costmap_2d::ObstacleLayer", "costmap_2d::VoxelLayer"
_PREFIX = "costmap_2d::"
COSTMAP_PARAMETERS = frozenset(
    {"always_send_full_costmap", "cost_scaling_factor", "footprint", "footprint_padding",
     "global_frame", "inflation_radius", "lethal_cost_threshold", "map_topic", "map_type",
     "max_obstacle_height", "observation_sources", "obstacle_range", "plugins",
     "publish_frequency", "raytrace_range", "resolution", "robot_base_frame", "robot_radius",
     "rolling_window", "static_map", "track_unknown_space", "transform_tolerance",
     "trinary_costmap", "unknown_cost_value", "update_frequency"}
)  # fmt: skip
"""Names that identify a file of costmap parameters, at the costmap's level or at a layer's."""
_PLUGIN_HINT = 'write - {name: static_layer, type: "costmap_2d::StaticLayer"}'


def ros1_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None
) -> tuple[robot.RobotParameters | None, tuple[Problem, ...]]:
    server, is_complete = load_server(paths, costmap, namespace)
    if not is_complete or not _has_costmap(server):
        return None, tuple(server.problems)
    resolved = _robot_from(server)
    distinct: dict[object, Problem] = {}
    for p in server.problems:
        distinct.setdefault((p.check, p.source, p.line, p.parameter), p)
    # of a robot with substitutions the values that the launch file sets are unknown
    return None if server.is_substituted else resolved, tuple(distinct.values())


def _has_costmap(server: Ros1Server) -> bool:
    """Return whether the files have parameters of the costmap; record a problem if not."""
    if (costmap := server.root.get(server.path)) is None:
        text = f"no parameters of /{'/'.join(server.path)}"
        hint = f"write {server.costmap}_costmap: at the top of its file, or no name of a costmap"
        (sibling,) = set(_NAMES) - {server.costmap}
        if server.root.get((*server.node, f"{sibling}_costmap")) is not None:
            hint = f"--costmap {sibling} selects the costmap that the files have"
        server.problem("params.namespace", "refused", text, hint=hint)
        return False
    if not isinstance(costmap, Ros1Namespace) or any(
        path[-1] in COSTMAP_PARAMETERS for path, _ in costmap.values()
    ):
        return True
    spaces = [path for file in server.files for path, _ in file.parameters.namespaces()]
    if any(path[-1] in _COSTMAPS for path in spaces):
        return True  # a file that names a costmap is a costmap file, whatever its parameters
    names = ", ".join([*costmap.members][:3]) + ", ..." * (len(costmap.members) > 3)
    text = f"holds no parameter of a costmap; it has {names}"
    hint = "give Nav2's parameters, with ros__parameters, or the costmap files of ROS 1"
    server.problem("params.namespace", "refused", text, hint=hint)
    return False


def _robot_from(server: Ros1Server) -> robot.RobotParameters | None:
    is_rolling = server.boolean(False, "rolling_window")
    track = server.boolean(False, "track_unknown_space")
    has_list = server.root.get((*server.path, "plugins")) is not None
    plugins = _plugins(server) if has_list else _old_plugins(server)
    shape = _shape(server)
    inscribed = 0.0 if shape is None else shape.inscribed_radius
    layers = tuple(_layer(server, name, kind, inscribed) for name, kind in plugins or ())
    statics = [entry.name for entry in layers if entry.plugin == _STATIC and entry.is_enabled]
    places = [server.place(name, "map_topic") for name in statics]
    topics = ((place, server.text("map", *place).lstrip("/")) for place in places)
    for place, text in robot.other_maps(topics):
        server.problem("params.other-map", "warning", text, place)
    if plugins is None or shape is None:  # after reading the layers, to report their problems
        return None
    for name, text in robot.erasing_layers(layers):
        server.problem("params.erases-map", "warning", text, (name, "combination_method"))
    if not any(listed.plugin == _STATIC for listed in layers):
        if server.costmap == "local":
            static = ROS1_PLUGINS[_STATIC](robot.INJECTED)
            layers = (ListedLayer(robot.INJECTED, _STATIC, static), *layers)
        else:
            text = "no static layer: the costmap does not read the map, and all cells are "
            text += "255, unknown" if track else "0, free"
            hint = _PLUGIN_HINT if has_list else "set static_map: true"
            server.problem("params.no-static-layer", "warning", text, hint=hint)
    files = tuple(robot.ParameterFile(file.source, file.sha256) for file in server.files)
    area = _area(server, is_rolling=is_rolling)
    return robot.RobotParameters(
        **vars(shape), flavour="ros1", costmap=server.costmap, node=f"/{'/'.join(server.path)}",
        layers=layers, files=files, track_unknown_space=track, area=area,
        rolling_window=area is not None and area.is_rolling,
        base_frame=server.text("base_link", "robot_base_frame").lstrip("/"),
    )  # fmt: skip


def _area(server: Ros1Server, *, is_rolling: bool) -> CostmapArea | None:
    area, first = None, len(server.problems)
    number = server.double(0.05, "resolution")
    resolution = server.clamp(number, 50.0, _RECONFIGURE, ("resolution",))
    if resolution > 0:
        sides = [max(server.integer(10, side), 0) for side in ("height", "width")]
        area = CostmapArea(
            int(sides[0] / resolution), int(sides[1] / resolution), resolution,
            (server.double(0.0, "origin_x"), server.double(0.0, "origin_y")),
            is_rolling=is_rolling, size_margin=0.5, global_frame=server.text("map", "global_frame"),
        )  # fmt: skip
    # If a map defines the size, these values have no effect: a note suffices.
    server.problems[first:] = [replace(p, level="note") for p in server.problems[first:]]
    return area


def _old_plugins(server: Ros1Server) -> list[tuple[str, str]]:
    """Return the layers of a costmap without a list of plugins, as ``loadOldParameters``."""
    static = [("static_layer", _STATIC)] if server.boolean(False, "static_map") else []
    obstacle = ("obstacle_layer", _VOXEL if server.text("", "map_type") == "voxel" else _OBSTACLE)
    return [*static, obstacle, ("inflation_layer", _INFLATION)]


def _plugins(server: Ros1Server) -> list[tuple[str, str]] | None:
    value = server.find("plugins")
    if value is not None and value.kind == _UNSENDABLE:
        return None
    faults = [("must be a list of {name, type}", _PLUGIN_HINT)]
    if value is not None and value.kind == "list":
        checked = [(index, _plugin_fault(entry)) for index, entry in enumerate(value.value, 1)]
        faults = [(f"entry {index} {fault[0]}", fault[1]) for index, fault in checked if fault]
    for rule, hint in faults:
        server.problem("params.plugins", "refused", f"{rule}; move_base exits", ("plugins",), hint)
    return None if faults or value is None else [(e["name"], e["type"]) for e in value.value]


def _plugin_fault(entry: object) -> tuple[str, str] | None:
    if not isinstance(entry, dict):
        hint = f"plugins as bare names are Nav2's; {_PLUGIN_HINT}"
        return "must be a name and a type", hint if isinstance(entry, str) else _PLUGIN_HINT
    for key in ("name", "type"):
        if not isinstance(entry.get(key), str) or not entry[key]:
            return f"has no {key}", _PLUGIN_HINT
    nearest = robot.suggested_class(entry["type"], tuple(ROS1_PLUGINS), _PREFIX)
    hint = f"did you mean {nearest}?"
    return None if nearest is None else (f"has an unknown type, {entry['type']}", hint)


def _layer(server: Ros1Server, name: str, kind: str, inscribed: float) -> ListedLayer:
    is_enabled, layer_class = server.boolean(True, name, "enabled"), ROS1_PLUGINS.get(kind)
    if layer_class is not None:
        for parameter in layer_class.ros1_costmap_parameters:
            local, above = server.find(name, parameter), server.find(parameter)
            if local is not None and above is not None and local.value != above.value:
                text = f"the costmap's own {parameter}, {above.text}, takes its place"
                file = f" of {above.source.name}" if above.source != local.source else ""
                advice = f"remove one of them; the other stands on line {above.line}{file}"
                rule, place = f"has no effect: {text}", (name, parameter)
                server.problem("params.overridden", "warning", rule, place, advice)
        layer = layer_class.from_ros1(server, PluginEntry(name, kind, inscribed))
        sensing = layer_class.sensing_from_ros1(server, name)
        return ListedLayer(name, kind, layer, is_enabled, sensing=sensing)
    if is_enabled:
        text = f"{name} ({kind}) is not modelled: its costs are left out"
        hint = robot.hint_on_class(kind, _PREFIX)
        server.problem("params.not-modelled", "warning", text, ("plugins",), hint)
    return ListedLayer(name, kind, None, is_enabled, why_ignored=robot.NOT_MODELLED)
