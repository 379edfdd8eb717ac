"""The layers and filters of Nav2's costmap, as ``Costmap2DROS`` loads them.

References
----------
costmap_2d_ros.cpp, static_layer.cpp, inflation_layer.cpp, legacy_inflation_layer.cpp,
asymmetric_inflation_layer.cpp and costmap_plugins.xml of nav2_costmap_2d.
"""

from __future__ import annotations

from difflib import SequenceMatcher

from mapdeal.grid.costmap_layers import InflationLayer, StaticLayer
from mapdeal.robot.footprints import up_to_millimetres
from mapdeal.robot.nav2_values import Nav2Values
from mapdeal.robot.parameters import ListedLayer

_OWN = "nav2_costmap_2d::"
STATIC, INFLATION = _OWN + "StaticLayer", _OWN + "InflationLayer"
_LEGACY, _ASYMMETRIC = _OWN + "LegacyInflationLayer", _OWN + "AsymmetricInflationLayer"
_INFLATIONS = (INFLATION, _LEGACY, _ASYMMETRIC)
_OBSTACLE, _VOXEL, _RANGE = (
    _OWN + name for name in ("ObstacleLayer", "VoxelLayer", "RangeSensorLayer")
)
_CONTAINER = _OWN + "PluginContainerLayer"
_UNMODELLED = {
    _OWN + "DenoiseLayer": "removes small groups of obstacles",
    _CONTAINER: "contains layers of its own",
}
_FILTERS = tuple(
    _OWN + name for name in ("KeepoutFilter", "SpeedFilter", "BinaryFilter", "ZoneParameterFilter")
)
_LAYERS = (STATIC, *_INFLATIONS, _OBSTACLE, _VOXEL, _RANGE, *_UNMODELLED)
_MISSPELT = 0.95
"""As alike as this, a class is misspelt; below it is somebody's own."""

_LONGEST = 100
"""Characters of a name that are compared with names of classes."""
MOST_LAYERS = 200

_SENSORS = (
    "obstacle", "voxel", "range", "sonar", "cloud", "scan", "laser", "lidar", "camera", "depth",
    "segmentation", "semantic", "observation", "detection", "people", "person", "social",
    "proxemic", "dynamic", "tracking", "radar", "ultrasonic", "bumper", "cliff", "sensor", "ground",
)  # fmt: skip
"""Words in the names of layers that do nothing without live data."""

DEFAULT_PLUGINS = ("static_layer", "obstacle_layer", "inflation_layer")
_DEFAULT_CLASSES = (STATIC, _OBSTACLE, INFLATION)

_SENSOR_PARAMETERS = {
    "enabled": "bool", "footprint_clearing_enabled": "bool", "min_obstacle_height": "double",
    "max_obstacle_height": "double", "combination_method": "integer",
    "observation_sources": "string", "origin_z": "double", "z_resolution": "double",
    "z_voxels": "integer", "unknown_threshold": "integer", "mark_threshold": "integer",
    "publish_voxel_map": "bool",
}  # fmt: skip
_SOURCE_PARAMETERS = {
    "topic": "string", "sensor_frame": "string", "observation_persistence": "double",
    "expected_update_rate": "double", "data_type": "string", "min_obstacle_height": "double",
    "max_obstacle_height": "double", "inf_is_valid": "bool", "marking": "bool",
    "clearing": "bool", "obstacle_max_range": "double", "obstacle_min_range": "double",
    "raytrace_max_range": "double", "raytrace_min_range": "double",
}  # fmt: skip


def listed_layers(
    values: Nav2Values, inscribed_radius: float, *, older: bool
) -> tuple[ListedLayer, ...] | None:
    """Return all layers in their order, then the filters; None where one has no class."""
    names = tuple(values.get("plugins", "string_array", DEFAULT_PLUGINS))
    filters = tuple(values.get("filters", "string_array", ()))
    defaults = (
        dict(zip(DEFAULT_PLUGINS, _DEFAULT_CLASSES, strict=True))
        if names == DEFAULT_PLUGINS
        else {}
    )
    if len(names) + len(filters) > MOST_LAYERS:
        text = f"more than {MOST_LAYERS} layers and filters"
        values.problem("params.plugins", "refused", text, "plugins")
        return None
    classes = [_class_of(values, name, defaults.get(name)) for name in (*names, *filters)]
    if None in classes:
        return None
    found = []
    for index, (name, kind) in enumerate(zip((*names, *filters), classes, strict=True)):
        if index >= len(names):
            found.append(_filter(values, name, kind or ""))
        else:
            found.append(_layer(values, name, kind or "", inscribed_radius, older=older))
    _tell_topics(values, found)
    return tuple(found)


def _tell_topics(values: Nav2Values, layers: list[ListedLayer]) -> None:
    """Warn where static layers read different maps: there is one map, and all of them get it."""
    own_map = values.get("map_topic", "string", "map")
    first: str | None = None
    for one in layers:
        if not (isinstance(one.layer, StaticLayer) and one.is_enabled):
            continue
        parameter = f"{one.name}.map_topic"
        topic = (values.get(parameter, "string", "") or own_map).lstrip("/")
        if first is not None and topic != first:
            text = f"reads {topic}, another map than {first}; here it gets the same map"
            values.problem("params.other-map", "warning", text, parameter)
        first = first or topic


def static_layer(values: Nav2Values, name: str, *, older: bool) -> StaticLayer:
    """Return a static layer: all but its name are parameters of the node."""
    lethal = values.get("lethal_cost_threshold", "integer", 100)
    clamped = max(min(lethal, 100), 0)
    if clamped != lethal:
        text = f"must be 0 .. 100; the static layer takes it for {clamped}"
        values.problem("params.range", "warning", text, "lethal_cost_threshold")
    inscribed = None
    if not older:
        inscribed = values.get("inscribed_obstacle_cost_value", "integer", 99) % 256
    return StaticLayer(
        name=name,
        track_unknown_space=values.get("track_unknown_space", "bool", False),
        lethal_cost_threshold=clamped,
        trinary_costmap=values.get("trinary_costmap", "bool", True),
        unknown_cost_value=values.get("unknown_cost_value", "integer", 255) % 256,
        inscribed_obstacle_cost_value=inscribed,
        use_maximum=values.get("use_maximum", "bool", False),
    )


def _class_of(values: Nav2Values, name: str, default: str | None) -> str | None:
    """Return the class of a layer or filter, or the one that is meant; None if none is given."""
    parameter = f"{name}.plugin"
    kind: str | None = values.get(parameter, "string", default)
    if kind is None:
        if not values.has(parameter):
            text = f"{name} is listed, but has no {parameter}; Nav2 does not start"
            hint = f'write {name}: {{plugin: "{_guess(name)}"}}, or take it out of the list'
            values.problem("params.plugins", "refused", text, _list_of(values, name), hint)
        return None
    meant = _meant_by(kind)
    if meant is not None:
        text = f"unknown class {kind[:_LONGEST]}; Nav2 does not start"
        values.problem("params.plugins", "refused", text, parameter, f"did you mean {meant}?")
    return meant or kind


def _list_of(values: Nav2Values, name: str) -> str:
    """Return the list that a name stands in."""
    filters = values.get("filters", "string_array", ())
    return "filters" if name in filters else "plugins"


def _guess(name: str) -> str:
    """Return the class that a layer of a name probably has."""
    wanted = name.replace("_", "").lower()
    likeness = {
        one: SequenceMatcher(None, one.removeprefix(_OWN).lower(), wanted[:_LONGEST]).ratio()
        for one in (STATIC, INFLATION, _OBSTACLE, _VOXEL, *_FILTERS)
    }
    return max(likeness, key=likeness.__getitem__)


def _meant_by(kind: str) -> str | None:
    """Return the class that is meant by one that pluginlib cannot load; None if it may."""
    known = (*_LAYERS, *_FILTERS)
    if kind in known:
        return None
    package, _, plain = kind.replace("::", "/").rpartition("/")
    own = _OWN + plain
    if own in known and package in ("nav2_costmap_2d", "costmap_2d", ""):
        return own  # a slash, ROS 1's package, or none
    likeness = {one: SequenceMatcher(None, one, kind[:_LONGEST]).ratio() for one in known}
    near = max(known, key=likeness.__getitem__)
    return near if likeness[near] >= _MISSPELT else None


def _layer(
    values: Nav2Values, name: str, kind: str, inscribed_radius: float, *, older: bool
) -> ListedLayer:
    if kind == STATIC:
        return _static(values, name, older=older)
    if kind in _INFLATIONS:
        layer = _inflation(values, name, kind, inscribed_radius, older=older or kind == _LEGACY)
        return ListedLayer(name, kind, layer, values.get(f"{name}.enabled", "bool", True))
    if kind in (_OBSTACLE, _VOXEL, _RANGE):
        is_enabled = _sensor(values, name)
        return ListedLayer(name, kind, None, is_enabled, why_ignored="reads sensors")
    return _foreign(values, name, kind)


def _static(values: Nav2Values, name: str, *, older: bool) -> ListedLayer:
    is_enabled = values.get(f"{name}.enabled", "bool", True)
    for parameter, kind in (
        ("subscribe_to_updates", "bool"), ("map_subscribe_transient_local", "bool"),
        ("footprint_clearing_enabled", "bool"), ("restore_cleared_footprint", "bool"),
        ("map_topic", "string"), ("transform_tolerance", "double"),
    ):  # fmt: skip
        if older and parameter in ("footprint_clearing_enabled", "restore_cleared_footprint"):
            continue
        values.get(f"{name}.{parameter}", kind, None)
    if not older and values.get(f"{name}.footprint_clearing_enabled", "bool", False):
        text = "frees the cells below the robot; that depends on where it is, and is left out"
        parameter = f"{name}.footprint_clearing_enabled"
        values.problem("params.footprint-clearing", "note", text, parameter)
    return ListedLayer(name, STATIC, static_layer(values, name, older=older), is_enabled)


def _inflation(
    values: Nav2Values, name: str, kind: str, inscribed_radius: float, *, older: bool
) -> InflationLayer:
    is_asymmetric = kind == _ASYMMETRIC
    radius = values.number(f"{name}.inflation_radius", 2.0 if is_asymmetric else 0.55)
    if is_asymmetric:
        factor = _factor_without_path(values, name)
    else:
        factor = values.number(f"{name}.cost_scaling_factor", 10.0, least=0.0)
    if not older:
        values.get(f"{name}.num_threads", "integer", -1)
    if not (older or is_asymmetric):
        custom = values.number(f"{name}.custom_inscribed_radius", -1.0)
        if custom >= 0.0:
            text = (
                f"takes the place of the footprint's own inscribed radius, {inscribed_radius:.4g} m"
            )
            hint = "unsafe unless all that reads the costmap is made for it; remove it"
            parameter = f"{name}.custom_inscribed_radius"
            values.problem("params.custom-inscribed-radius", "warning", text, parameter, hint)
            inscribed_radius = custom
    if radius < inscribed_radius:
        text = f"{radius:g} m is less than the inscribed radius, {inscribed_radius:.4g} m"
        hint = f"set it to {up_to_millimetres(inscribed_radius)} or more"
        values.problem("params.inflation-radius", "warning", text, f"{name}.inflation_radius", hint)
    return InflationLayer(
        name=name,
        inscribed_radius=inscribed_radius,
        inflation_radius=max(radius, 0.0),
        cost_scaling_factor=factor,
        inflate_unknown=values.get(f"{name}.inflate_unknown", "bool", False),
        inflate_around_unknown=values.get(f"{name}.inflate_around_unknown", "bool", False),
        lookup="exact" if older else "nav2",
    )


def _factor_without_path(values: Nav2Values, name: str) -> float:
    """Return the factor of both sides where there is no path: the larger one counts."""
    for parameter, kind, least in (
        (f"{name}.inflation_radius", "double", 0), (f"{name}.num_threads", "integer", -1),
        (f"{name}.cost_scaling_factor_left", "double", 0),
        (f"{name}.cost_scaling_factor_right", "double", 0),
        (f"{name}.goal_distance_threshold", "double", 0), ("transform_tolerance", "double", 0),
    ):  # fmt: skip
        if values.get(parameter, kind, least) < least:
            text = f"must not be below {least}; Nav2 does not start"
            values.problem("params.not-positive", "refused", text, parameter)
    values.get(f"{name}.plan_topic", "string", None)
    sides = {side: f"{name}.cost_scaling_factor_{side}" for side in ("left", "right")}
    factors = {side: values.number(parameter, 4.0) for side, parameter in sides.items()}
    wider = min(factors, key=factors.__getitem__)
    factor = max(factors.values())
    if factors[wider] < factor:
        text = (
            f"raises costs {wider} of the robot's path; here there is no path, and {factor:g} "
            "counts on both sides"
        )
        place = next(one for one in (sides[wider], *sides.values()) if values.has(one))
        values.problem("params.asymmetric", "note", text, place)
    return factor


def _sensor(values: Nav2Values, name: str) -> bool:
    """Return whether a layer of sensors is on; other types in it end the node all the same."""
    sources = set(values.get(f"{name}.observation_sources", "string", "", level="warning").split())
    for parameter in values.values:
        prefix, _, own = parameter.removeprefix(f"{name}.").rpartition(".")
        kinds = _SOURCE_PARAMETERS if prefix in sources else {} if prefix else _SENSOR_PARAMETERS
        if own in kinds and parameter.startswith(f"{name}."):
            values.get(parameter, kinds[own], None, level="warning")
    return bool(values.get(f"{name}.enabled", "bool", True, level="warning"))


def _foreign(values: Nav2Values, name: str, kind: str) -> ListedLayer:
    """Return a layer that is not modelled, and warn unless it needs live data."""
    is_enabled = _enabled_of_any(values, name)
    plain = kind.replace("::", "/").rpartition("/")[2].lower()
    if kind in _FILTERS:
        return _filter(values, name, kind, is_filter=False)
    if kind not in _UNMODELLED and any(word in plain for word in _SENSORS):
        return ListedLayer(name, kind, None, is_enabled, why_ignored="reads sensors")
    what = _UNMODELLED.get(kind, "a custom class")
    if kind == _CONTAINER and is_enabled:
        _tell_contents(values, name)
    if is_enabled:
        text = f"{kind} is not modelled, which changes the costs: {what}"
        values.problem("params.not-modelled", "warning", text, f"{name}.plugin")
    return ListedLayer(name, kind, None, is_enabled, why_ignored=f"not modelled: {what}")


def _tell_contents(values: Nav2Values, name: str) -> None:
    """Refuse a container whose layers make the costs: without them, hardly any are left."""
    for one in values.get(f"{name}.plugins", "string_array", ()):
        parameter = f"{name}.{one}.plugin"
        if values.get(parameter, "string", "") in (STATIC, *_INFLATIONS):
            text = f"stands in {name}, whose layers are not modelled; the costs are meaningless"
            hint = f"list {one} in plugins itself"
            values.problem("params.plugins", "refused", text, parameter, hint)


def _filter(values: Nav2Values, name: str, kind: str, *, is_filter: bool = True) -> ListedLayer:
    is_enabled = _enabled_of_any(values, name)
    why = "a filter without its mask"
    return ListedLayer(name, kind, None, is_enabled, is_filter=is_filter, why_ignored=why)


def _enabled_of_any(values: Nav2Values, name: str) -> bool:
    """Return whether a layer is on; nav2_bringup's own file leaves that of filters to launch."""
    found = values.values.get(f"{name}.enabled")
    return found is None or found.value is not False
