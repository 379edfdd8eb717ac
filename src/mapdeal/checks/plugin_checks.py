"""Checks of sensors and planners in parameter files, and of names that Nav2 ignores.

References
----------
``onInitialize`` in ``obstacle_layer.cpp`` and ``voxel_layer.cpp``, of Nav2 and of ROS 1: since
Galactic, ranges have a minimum and a maximum. docs.nav2.org, Iron to Jazzy: names with ``::``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

from mapdeal.checks.facts import PlannerFacts, RobotFacts, check
from mapdeal.checks.findings import Remark
from mapdeal.grid.frame import Frame
from mapdeal.layers.catalogue import class_name
from mapdeal.layers.obstacle import ObservationSource, Sensing, VoxelLayer
from mapdeal.ros import load, planners, robot, ros2_files

_RENAMED = {
    "obstacle_range": ("obstacle_max_range", 2.5), "raytrace_range": ("raytrace_max_range", 3.0)
}  # fmt: skip
"""Renamed parameters of Nav2: the old names, the new ones and their defaults, metres."""
_OBSTACLE_LAYERS = ("ObstacleLayer", "VoxelLayer")
_USUAL_RESOLUTION = 0.05  # metres; used without a map


def _sensing_layers(facts: RobotFacts) -> Iterator[tuple[robot.ListedLayer, Sensing]]:
    for listed in facts.robot.layers:
        if isinstance(listed.sensing, Sensing) and listed.is_enabled:
            yield listed, listed.sensing


def _sources(facts: RobotFacts) -> Iterator[tuple[robot.ListedLayer, ObservationSource]]:
    for listed, sensing in _sensing_layers(facts):
        yield from ((listed, source) for source in sensing.sources)


def _setting_of(
    facts: RobotFacts, listed: robot.ListedLayer, source: str, *names: str
) -> robot.ParameterValue | None:
    """Return the parameter that sets a source's value, or the list of sources."""
    for name in names:
        for path in ((listed.name, source, name), (source, name), (listed.name, name), (name,)):
            if facts.value(*path) is not None:
                return facts.value(*path)
    return facts.of_layer(listed.name, "observation_sources")


def _has_section(facts: RobotFacts, listed: robot.ListedLayer, source: ObservationSource) -> bool:
    sections = ((listed.name, source.name), (source.name,))
    return any(path[: len(s)] == s for path in facts.parameters.values for s in sections)


@check("params.marks-beyond-rays", "warning")
def marks_beyond_rays(facts: RobotFacts) -> Iterator[Remark]:
    """A source that marks obstacles farther away than any ray clears them.
    Such an obstacle stays after it has left, until the robot comes closer: it plans around nothing.
    Example: `obstacle_layer: {observation_sources: scan, scan: {max_obstacle_height: 2.0,
    clearing: true, obstacle_max_range: 5.0, raytrace_max_range: 3.0}}`.
    Fix: Set raytrace_max_range above obstacle_max_range.
    """
    names = "obstacle_max_range", "raytrace_max_range"
    if facts.robot.flavour == "ros1":
        names = "obstacle_range", "raytrace_range"
    for listed, sensing in _sensing_layers(facts):
        rays = [source.raytrace_max_range for source in sensing.sources if source.clearing]
        for source in sensing.sources:
            if source.marking and rays and source.obstacle_max_range > max(rays):
                text = f"{source.name} marks as far as {names[0]} {source.obstacle_max_range:g} m, "
                text += f"and no ray clears beyond {names[1]} {max(rays):g} m; raise {names[1]}"
                yield Remark(text, at=_setting_of(facts, listed, source.name, *names))


@check("params.never-cleared", "warning")
def never_cleared(facts: RobotFacts) -> Iterator[Remark]:
    """A layer with sources that mark, none of which clears.
    Whoever walks past the robot leaves a wall behind.
    Example: `obstacle_layer: {observation_sources: scan, scan: {max_obstacle_height: 2.0,
    clearing: false}}`.
    Fix: Set clearing: true for one of the sources.
    """
    for listed, sensing in _sensing_layers(facts):
        sources = sensing.sources
        if any(source.marking for source in sources) and not any(s.clearing for s in sources):
            text = f"no source of {listed.name} has clearing: true, so its obstacles stay"
            yield Remark(text, at=_setting_of(facts, listed, sources[0].name, "clearing"))


@check("params.source-height", "warning")
def source_height(facts: RobotFacts) -> Iterator[Remark]:
    """A source whose height limits drop all readings above the floor.
    The sensor neither marks nor clears, and the robot does not see obstacles. Nav2's default of a
    source's max_obstacle_height is 0.
    Example: `obstacle_layer: {observation_sources: scan, scan: {topic: /scan, clearing: true}}`.
    Fix: Set max_obstacle_height of the source, such as 2.0.
    """
    for listed, source in _sources(facts):
        low, high = source.min_obstacle_height, source.max_obstacle_height
        if high <= max(low, 0.0) and _has_section(facts, listed, source):
            text = f"{source.name} takes heights of {low:g} to {high:g} m only"
            at = _setting_of(facts, listed, source.name, "max_obstacle_height")
            yield Remark(f"{text}; raise its max_obstacle_height", at=at)


@check("params.voxel-ceiling", "note")
def voxel_ceiling(facts: RobotFacts) -> Iterator[Remark]:
    """Voxels that end below the max_obstacle_height of a cloud source.
    Obstacles in between are not marked, although their height is accepted.
    Example: `{plugins: [voxels], voxels: {plugin: "nav2_costmap_2d::VoxelLayer", z_resolution:
    0.05, observation_sources: camera, camera: {data_type: PointCloud2, clearing: true,
    max_obstacle_height: 2.0}}}`.
    Fix: Raise z_resolution or z_voxels, at most 16, or lower max_obstacle_height.
    """
    for listed, sensing in _sensing_layers(facts):
        if listed.layer is None or listed.layer.key != VoxelLayer.key:
            continue
        ceiling = sensing.origin_z + sensing.z_voxels * sensing.z_resolution
        clouds = (s for s in sensing.sources if s.marking and s.data_type != "LaserScan")
        heights = (source.max_obstacle_height for source in clouds)
        highest = min(sensing.max_obstacle_height, max(heights, default=-math.inf))
        if ceiling < highest - 1e-6:  # metres
            text = f"the voxels of {listed.name} end at {ceiling:g} m, and obstacles up to "
            text += f"{highest:g} m are accepted: those above are not marked"
            yield Remark(text, at=_setting_of(facts, listed, "", "z_voxels", "z_resolution"))


@check("params.expected-rate", "note")
def expected_rate(facts: RobotFacts) -> Iterator[Remark]:
    """A source with expected_update_rate.
    Whenever its messages are later than that, the costmap is not current and the robot stops.
    Example: `obstacle_layer: {observation_sources: scan, scan: {max_obstacle_height: 2.0,
    clearing: true, expected_update_rate: 0.1}}`.
    Fix: Remove it, or set it to several periods of the sensor.
    """
    for listed, source in _sources(facts):
        if source.expected_update_rate > 0:
            text = f"the robot stops if {source.name} is later than "
            text += f"{source.expected_update_rate:g} s (expected_update_rate)"
            yield Remark(text, at=_setting_of(facts, listed, source.name, "expected_update_rate"))


@check("params.source-section", "warning")
def source_section(facts: RobotFacts) -> Iterator[Remark]:
    """A name in observation_sources without parameters.
    The source has defaults only: a topic of its own name, no clearing, and in Nav2 a
    max_obstacle_height of 0.
    Example: `obstacle_layer: {observation_sources: scan}`.
    Fix: Add a section of this name, or take it out of the list.
    """
    for listed, source in _sources(facts):
        if not _has_section(facts, listed, source):
            text = f"{source.name} is in observation_sources of {listed.name}, without a section"
            yield Remark(text, at=_setting_of(facts, listed, source.name))


@check("params.renamed", "warning")
def renamed(facts: load.ParameterFacts) -> Iterator[Remark]:
    """A parameter that Nav2 has renamed.
    Nav2 ignores the old name and uses the default: the robot sees obstacles later or earlier than
    set.
    Example: `obstacle_layer: {obstacle_range: 5.0}`.
    Fix: Write the new name.
    """
    layers = {name for name, plugin in facts.plugins if class_name(plugin) in _OBSTACLE_LAYERS}
    for path, value in facts.values.items() if facts.flavour == "nav2" else ():
        if path[-1] not in _RENAMED or (len(path) > 1 and path[0] not in layers):
            continue
        name, default = _RENAMED[path[-1]]
        if (*path[:-1], name) not in facts.values:
            text = f"{facts.label(*path)} has no effect since Galactic, and {name} is {default:g} m"
            yield Remark(f"{text} by default: write {name}", at=value)


@check("params.planner-misspelt", "warning")
def planner_misspelt(facts: PlannerFacts) -> Iterator[Remark]:
    """A misspelt parameter or class of a planner.
    Nav2 ignores it and plans with the default.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", tolerances: 0.5}}}`.
    Fix: Write the name that the message proposes.
    """
    for name, _, closest in _undeclared_names(facts):
        if closest:
            text = f"no parameter is called {name}: did you mean {closest}?"
            yield Remark(text, at=facts.values[name])
    plugins = planners.plugins_in(facts.values)
    for section, kind in plugins.items():
        if closest := load.closest_name(planners.full_name(kind), planners.PLANNER_PARAMETERS):
            text = f"no planner of Nav2 is called {kind}: did you mean {closest}?"
            yield Remark(text, at=facts.values[f"{section}.plugin"])
    first_values = reversed([*islice(facts.values.items(), load.MOST_NAMES)])
    sections = {name.partition(".")[0]: value for name, value in first_values if "." in name}
    for section, value in reversed(sections.items()):
        if closest := load.closest_name(section, plugins):
            yield Remark(f"no planner is called {section}: did you mean {closest}?", at=value)


def _undeclared_names(facts: PlannerFacts) -> Iterator[tuple[str, str, str | None]]:
    """Yield names that Nav2 ignores, the planner's class or the node, and the name meant."""
    plugins = planners.plugins_in(facts.values)
    of_any_planner = set().union(*planners.PLANNER_PARAMETERS.values())
    for name in islice(facts.values, load.MOST_NAMES):
        section, dot, parameter = name.partition(".")
        if dot and section not in plugins:
            continue
        owner = planners.full_name(plugins[section]) if dot else planners.PLANNER_SERVER
        declared = planners.PLANNER_PARAMETERS.get(owner, {}) if dot else planners.SERVER_PARAMETERS
        parameter = parameter or name
        if parameter in {"plugin", *declared, *planners.OTHER_NAMES.get(owner, ())}:
            continue
        parent, _, last = parameter.rpartition(".")
        paths = [path.rpartition(".") for path in ("plugin", *declared)]
        closest = load.closest_name(last, {path[2] for path in paths if path[0] == parent})
        if parameter in of_any_planner or f"{name.removesuffix(last)}{closest}" in facts.values:
            closest = None
        if closest or declared:
            yield name, owner, closest


@check("params.planner-slash", "note")
def planner_slash(facts: PlannerFacts) -> Iterator[Remark]:
    """A planner's class written with a slash, as in Nav2 up to Iron.
    Since Jazzy no class has this name: the planner server does not start.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner/NavfnPlanner"}}}`.
    Fix: Write :: in place of the slash for Jazzy and later.
    """
    for section, kind in planners.plugins_in(facts.values).items():
        name = planners.full_name(kind)
        if "/" in kind and name in planners.PLANNER_PARAMETERS:
            text = f"{kind} is a class of Nav2 up to Iron; since Jazzy it is {name} only"
            yield Remark(text, at=facts.values[f"{section}.plugin"])


@check("params.planner-without-effect", "warning")
def planner_without_effect(facts: PlannerFacts) -> Iterator[Remark]:
    """A planner's parameter at a level where no planner declares it.
    Nav2 ignores it: the robot plans as without the line, or with NavFn if the class is missing.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", minimum_turning_radius: 0.4}}}`.
    Fix: Remove the line, indent it, or choose a planner that declares it.
    """
    plugins = planners.plugins_in(facts.values)
    of_any_planner = {"plugin"}.union(*planners.PLANNER_PARAMETERS.values())
    are_known = planners.PLANNER_PARAMETERS.keys() >= set(map(planners.full_name, plugins.values()))
    names = [name for name in facts.values if name.partition(".")[0] not in plugins]
    misplaced = [name for name in names if name in of_any_planner]
    if misplaced and are_known:
        more = f" and {len(misplaced) - 1} more lines have" if misplaced[1:] else " has"
        text = f"{misplaced[0]}{more} no effect here: planners read them below their names"
        text += f", such as {next(iter(plugins))}" if plugins else ""
        yield Remark(text, at=facts.values[misplaced[0]])
    for name, owner, closest in _undeclared_names(facts):
        parameter = name.partition(".")[2]
        if closest or not (parameter or (are_known and name not in of_any_planner)):
            continue
        declared = planners.PLANNER_PARAMETERS.items()
        readers = [kind for kind, names in declared if parameter in names]
        text = f"{class_name(owner)} does not declare {parameter or name}: it has no effect"
        would = f"; {' and '.join(map(class_name, readers))} would read it" if readers else ""
        yield Remark(text + would, at=facts.values[name])


@check("params.planner-tolerance", "warning")
def planner_tolerance(facts: PlannerFacts) -> Iterator[Remark]:
    """A planner's tolerance above 0 that is less than a cell.
    A goal in an obstacle fails nearly as often as with a tolerance of 0.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", tolerance: 0.01}}}`.
    Fix: Write at least the side of a cell, or 0.0.
    """
    cell = max((frame.resolution for _, frame in facts.map_frames), default=_USUAL_RESOLUTION)
    for section in planners.plugins_in(facts.values):
        value = facts.values.get(f"{section}.tolerance")
        if value is not None and value.kind == "double" and 0 < value.value < cell:
            text = f"less than a cell of {cell:g} m: hardly any place but the goal's cell is tried"
            yield Remark(f"{text}; write {cell:g} or more, or 0.0", at=value)


@check("params.planner-turning-radius", "warning")
def planner_turning_radius(facts: PlannerFacts) -> Iterator[Remark]:
    """A turning radius with which a forward-only robot cannot turn round on the map.
    Turning round takes twice the radius: there is no path to most goals behind the robot.
    Example: `minimum_turning_radius: 40.0` with a map of 20 m by 20 m.
    Fix: Write metres, or set motion_model_for_search to REEDS_SHEPP.
    """
    for section, plugin in planners.plugins_in(facts.values).items():
        radius = facts.values.get(f"{section}.minimum_turning_radius")
        model = facts.values.get(f"{section}.motion_model_for_search")
        if class_name(plugin) != "SmacPlannerHybrid" or radius is None or radius.kind != "double":
            continue
        for name, frame in facts.map_frames if model is None or model.value == "DUBIN" else ():
            farthest = math.hypot(*frame.shape) * frame.resolution
            if 2 * radius.value > farthest:
                text = f"turning round without reversing takes {2 * radius.value:g} m, and {name} "
                yield Remark(f"{text}has {farthest:.4g} m from corner to corner", at=radius)


def planner_facts(
    parameters: ros2_files.Ros2Parameters, map_frames: Sequence[tuple[str, Frame]]
) -> Iterator[PlannerFacts]:
    for node in parameters.nodes:
        if node.name.rpartition("/")[2] == planners.PLANNER_SERVER:
            yield PlannerFacts(parameters.for_node(node.name), map_frames)
