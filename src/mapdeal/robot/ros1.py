"""ROS 1's costmap files as noetic's costmap_2d resolves them.

The rules are those of the constructor of ``Costmap2DROS``, ``loadOldParameters`` and
``copyParentParameters``, of the layers' ``onInitialize``, and of dynamic_reconfigure, which reads
each number once more, takes defaults for other types and moves it into its limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import SequenceMatcher
from pathlib import Path

from mapdeal.formats.ros_parameters.problem import Problem
from mapdeal.formats.ros_parameters.ros1 import UNSENDABLE, Ros1Namespace
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.grid.costmap_layers import CostmapLayer, InflationLayer, StaticLayer
from mapdeal.robot.footprints import up_to_millimetres
from mapdeal.robot.parameters import (
    INJECTED,
    CostmapName,
    ListedLayer,
    ParameterFile,
    RobotParameters,
)
from mapdeal.robot.ros1_footprint import ros1_shape
from mapdeal.robot.ros1_server import COSTMAPS, Ros1Server, load_server

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
