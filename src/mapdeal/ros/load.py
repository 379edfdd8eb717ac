"""Read a robot's parameters from files of ROS 1 or ROS 2, and find likely mistakes in them."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cached_property
from itertools import chain, groupby
from pathlib import Path
from typing import TypeVar

from mapdeal.errors import MalformedInputError, MapdealError, ParameterError, emit_warning
from mapdeal.files.source import exists, is_folder, read_file
from mapdeal.layers.catalogue import class_name, layer_named
from mapdeal.records import dataclass, replace
from mapdeal.ros import nav2, ros1, ros2_files
from mapdeal.ros.robot import CostmapName, Flavour, ParameterValue, Problem, RobotParameters

Name = tuple[str, ...]  # of a parameter in a costmap: ("inflation_layer", "inflation_radius")
Plugins = tuple[tuple[str, str], ...]  # names and classes
F = TypeVar("F", str, Path)

_KEY = b"ros__parameters"
_ALMOST_ROS2 = re.compile(rb"""\s*["']?(ros_+param\w*)["']?\s*:|.*\b(nav2_costmap_2d(?:::|/)\w+)""")
_LARGEST = 1 << 24
_ABOUT_COSTS = frozenset(
    {"params.custom-inscribed-radius", "params.inflation-radius", "params.no-static-layer",
     "params.not-modelled", "params.old-plugins", "params.other-map", "params.erases-map"}
)  # fmt: skip
"""Checks whose warnings concern costs only; commands that need just the shape skip them."""


@dataclass(frozen=True, eq=False)
class ParameterFacts:
    """The values in one costmap's section of the files, without interpretation."""

    flavour: Flavour
    values: Mapping[Name, ParameterValue]
    plugins: Plugins

    def label(self, *name: str) -> str:
        return ("." if self.flavour == "nav2" else "/").join(name)

    @cached_property
    def sections(self) -> dict[str, dict[Name, ParameterValue]]:
        sections: dict[str, dict[Name, ParameterValue]] = {}
        for path, value in self.values.items():
            if len(path) > 1:
                sections.setdefault(path[0], {})[path] = value
        return sections


def read_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None,
    up_to_kilted: bool = False, shape_only: bool = False,
) -> RobotParameters:  # fmt: skip
    robot, problems, _ = load_robot(
        paths, costmap=costmap, namespace=namespace, up_to_kilted=up_to_kilted
    )
    refused = [problem for problem in problems if problem.level == "refused"]
    if refused or robot is None:
        raise error_of(refused[0], paths)
    texts = tuple(
        _line_of(problem, paths) for problem in problems
        if problem.level == "warning" and not (shape_only and problem.check in _ABOUT_COSTS)
    )  # fmt: skip
    for text in texts:
        emit_warning(text)
    return replace(robot, remarks=texts, namespace=namespace)


def load_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None,
    up_to_kilted: bool = False,
) -> tuple[RobotParameters | None, tuple[Problem, ...], ParameterFacts]:  # fmt: skip
    if not paths:
        raise ParameterError("takes at least one file", place="params_files")
    ros2_paths = [path for path in paths if is_ros2(path)]
    if ros2_paths and len(ros2_paths) < len(paths):
        ros1_path = next(path for path in paths if path not in ros2_paths)
        rule = f"contains no parameters of ROS 2, but {ros2_paths[0].name} does"
        raise ParameterError(rule, source=ros1_path, hint="pass the files of one robot")
    flavour: Flavour = "nav2" if ros2_paths else "ros1"
    faults = filter(None, chain(map(_other_kind, paths), map(_without_key, paths)))
    fault = None if ros2_paths else next(faults, None)
    robot: RobotParameters | None = None
    problems: tuple[Problem, ...] = () if fault is None else (fault,)
    if ros2_paths:
        robot, problems = nav2.nav2_robot(
            paths, costmap=costmap, namespace=namespace, up_to_kilted=up_to_kilted
        )
    elif fault is None:
        robot, problems = ros1.ros1_robot(paths, costmap=costmap, namespace=namespace)
    values = _values_of(paths, flavour, costmap, _node_of(robot, costmap, namespace), namespace)
    parameters = ParameterFacts(flavour, values, _listed_plugins(flavour, values, robot))
    if fault is not None:
        return robot, problems, parameters
    lengths = tuple(_unusual_lengths(parameters, robot))
    if lengths:  # advice on the costs would be misleading
        problems = tuple(p for p in problems if p.check != "params.inflation-radius")
    return robot, (*problems, *lengths, *_misspelt_names(parameters)), parameters


def _node_of(robot: RobotParameters | None, costmap: CostmapName, namespace: str | None) -> str:
    if robot is not None:
        return robot.node
    name = f"{costmap}_costmap"
    return "/".join(["", *(part for part in (namespace or "").split("/") if part), name, name])


def is_ros2(path: Path) -> bool:
    data = read_file(path, limit=_LARGEST)
    return any(_KEY in line.partition(b"#")[0] for line in data.splitlines())


def flavour_of_file(path: Path) -> Flavour | None:
    from mapdeal.maps.kinds import PARAMETERS, kind_of

    with suppress(MapdealError):
        kind = kind_of(path) if exists(path) and not is_folder(path) else None
        if kind is not None and kind.name == PARAMETERS:
            return "nav2" if is_ros2(path) else "ros1"
    return None


def by_robot(paths: Sequence[F]) -> Iterator[tuple[Flavour | None, list[F]]]:
    """Yield consecutive files of one kind; those of parameters robot by robot."""
    # A file that sets a costmap's layers, or in ROS 1 its shape, again is another robot's.
    for flavour, files in groupby(paths, lambda path: flavour_of_file(Path(path))):
        group: list[F] = []
        settings: set[Name] = set()
        for path in files:
            is_new = flavour is not None and path not in group
            own = _settings_of_robot(Path(path)) if is_new else set()
            if own & settings:
                yield flavour, group
                group, settings = [], set()
            group.append(path)
            settings |= own
        yield flavour, group


def _settings_of_robot(path: Path) -> set[Name]:
    with suppress(MalformedInputError):
        if is_ros2(path):
            nodes = ros2_files.read_ros2([path]).nodes
            return {(node.name,) for node in nodes if "plugins" in dict(node.entries)}
        return ros1.settings_of_robot(ros1.read_ros1_parameters(path))
    return set()


def _other_kind(path: Path) -> Problem | None:
    """Return a problem if the file is a map, recipe etc.; ROS 1 would load its keys, too."""
    from mapdeal.maps.kinds import PARAMETERS, other_kind, readable_kind  # only needed for ROS 1

    kind = readable_kind(path)
    if kind is None or kind.name == PARAMETERS:
        return None
    error = other_kind(path, kind, "a file of ROS parameters")
    return Problem("params.other-kind", "refused", error.rule, source=path, hint=error.hint)


def _without_key(path: Path) -> Problem | None:
    """Return a problem if the file is one of Nav2, but lacks the key that ROS 2 looks for."""
    for number, line in enumerate(read_file(path, limit=_LARGEST).splitlines(), 1):
        if match := _ALMOST_ROS2.match(line.partition(b"#")[0]):
            name = (match[1] or match[2]).decode()
            rule = f"has no key {_KEY.decode()}, without which Nav2 does not start"
            hint = "did you mean that key?" if match[1] else "each node's parameters lie below it"
            return Problem(
                "params.syntax", "refused", rule, source=path, line=number, got=name, hint=hint
            )
    return None


def error_of(problem: Problem, paths: Sequence[Path]) -> MalformedInputError:
    place = f"line {problem.line}" if problem.line is not None else None
    if problem.parameter:
        place = f"{problem.parameter} ({place})" if place else problem.parameter
    extra = {} if problem.got is None else {"got": problem.got}
    source = problem.source or paths[-1]
    return MalformedInputError(problem.text, source=source, place=place, hint=problem.hint, **extra)


def _line_of(problem: Problem, paths: Sequence[Path]) -> str:
    line = "" if problem.line is None else f":{problem.line}"
    parameter = f"{problem.parameter}: " if problem.parameter else ""
    text = f"{problem.source or paths[-1]}{line}: {parameter}{problem.text}"
    return f"{text}; {problem.hint}" if problem.hint else text


def costmaps_in(paths: Sequence[Path], namespace: str | None) -> tuple[CostmapName, ...]:
    if any(map(is_ros2, paths)):
        return ("global", "local")
    server, _ = ros1.load_server(paths, "global", namespace)
    return ros1.costmaps_named(server.files) or ("global",)


def _values_of(
    paths: Sequence[Path], flavour: Flavour, costmap: CostmapName, node: str, namespace: str | None
) -> dict[Name, ParameterValue]:
    # ROS 1 also searches the namespaces above the costmap for footprint and radius.
    if flavour == "nav2":
        try:
            parameters = ros2_files.read_ros2(paths).for_node(node)
        except MalformedInputError:  # load_robot reports this error
            return {}
        return {tuple(name.split(".")): value for name, value in parameters.items()}
    server, _ = ros1.load_server(paths, costmap, namespace)
    member = server.root.get(server.path)
    values = dict(member.values()) if isinstance(member, ros1.Ros1Namespace) else {}
    for name in ("footprint", "robot_radius"):
        inherited = server.search(name)
        if inherited is not None and isinstance(inherited[1], ParameterValue):
            values[(name,)] = inherited[1]
    return values


_LEAST_SIMILARITY = 0.85
# Limits of the search for misspelt names, which compares each name with all known ones.
MOST_NAMES, _LONGEST_NAME = 1000, 60

_COSTMAP: dict[Flavour, frozenset[str]] = {
    "ros1": ros1.COSTMAP_PARAMETERS | {
        "combination_method", "enabled", "first_map_only", "footprint_clearing_enabled",
        "footprint_topic", "height", "inflate_unknown", "mark_threshold", "max_obstacle_range",
        "meter_scoring", "min_obstacle_height", "obstacle_layer", "origin_x", "origin_y",
        "origin_z", "publish_voxel_map", "published_footprint_topic", "static_layer",
        "subscribe_to_updates", "unknown_threshold", "use_maximum", "width", "z_resolution",
        "z_voxels",
    },
    "nav2": frozenset(nav2.DECLARED) | {
        "allow_parameter_qos_overrides", "always_reset_initial_pose", "autostart_node",
        "bond_heartbeat_period", "enable_stamped_cmd_vel", "footprint_topic", "introspection_mode",
        "node_namespace", "observation_sources", "odom_topic", "plugin_names", "plugin_types",
        "published_footprint_topic", "service_introspection_mode", "stamped_footprint",
        "transform_timeout", "unknown_threshold", "use_radius", "use_sim_time",
    },
}  # fmt: skip
"""Parameters of costmaps, and of nodes beside them, that some release reads."""


def _listed_plugins(
    flavour: Flavour, values: Mapping[Name, ParameterValue], robot: RobotParameters | None
) -> Plugins:
    if robot is not None:
        return tuple((listed.name, listed.plugin) for listed in robot.layers)
    lists = [values[key,].value for key in ("plugins", "filters") if (key,) in values]
    entries = [entry for items in lists if isinstance(items, list | tuple) for entry in items]
    if flavour == "ros1":
        mappings = [entry for entry in entries if isinstance(entry, dict)]
        return tuple((str(m.get("name", "")), str(m.get("type", ""))) for m in mappings)
    names = [entry for entry in entries if isinstance(entry, str)]
    classes = [values[name, "plugin"].value if (name, "plugin") in values else "" for name in names]
    kinds = [kind if isinstance(kind, str) else "" for kind in classes]
    return tuple(zip(names, kinds, strict=True))


_LENGTHS = {
    "robot_radius": 10.0, "footprint": 10.0, "inflation_radius": 10.0, "footprint_padding": 1.0,
    "resolution": 2.0,
}  # fmt: skip
"""Parameters in metres, and the length from which the unit is doubtful."""


def closest_name(name: str, known: Collection[str]) -> str | None:
    if name in known or len(name) > _LONGEST_NAME:
        return None
    return next(iter(get_close_matches(name, known, n=1, cutoff=_LEAST_SIMILARITY)), None)


def _misspelt_names(parameters: ParameterFacts) -> Iterator[Problem]:
    known_names: dict[Name, frozenset[str]] = {(): _COSTMAP[parameters.flavour]}
    for name, plugin in parameters.plugins:
        if layer := layer_named(class_name(plugin)):
            known_names[name,] = layer.known_parameters(class_name(plugin))
    unknown = 0
    for (*section, name), value in parameters.values.items():
        known = known_names.get(tuple(section), frozenset({name}))
        if name in known or (unknown := unknown + 1) > MOST_NAMES:
            continue
        closest = closest_name(name, known)
        if closest and (*section, closest) not in parameters.values:
            label = parameters.label(*section, name)
            text = f"no parameter is called {label}: did you mean {closest}?"
            yield Problem("params.misspelt", "warning", text, "", value.source, value.line)


def _unusual_lengths(
    parameters: ParameterFacts, robot: RobotParameters | None
) -> Iterator[Problem]:
    for path, value in parameters.values.items():
        limit = _LENGTHS.get(path[-1], math.inf) if len(path) <= 2 else math.inf
        length, part = value.value, ""
        if path == ("footprint",) and robot is not None and robot.robot_radius is None:
            length, part = robot.circumscribed_radius, " from the centre to a corner"
        if isinstance(length, int | float) and limit <= length < math.inf:
            unit = "centimetres" if length < 10 * limit else "millimetres"
            text = f"{length:.4g} m{part} is unusual; is it in {unit}?"
            place = parameters.label(*path), value.source, value.line
            yield Problem("params.units", "warning", text, *place)
