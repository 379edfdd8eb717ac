"""Checks of plugins in parameter files: costmap filters with their masks, sensors and planners.

References
----------
navigation2: ``costmap_filter.cpp``, ``keepout_filter.cpp``, ``speed_filter.cpp``,
``binary_filter.cpp`` and ``costmap_filter_info_server.cpp``; ``onInitialize`` in
``obstacle_layer.cpp`` and ``voxel_layer.cpp``, also of ROS 1: since Galactic, ranges have a minimum
and a maximum. docs.nav2.org, Iron to Jazzy: names with ``::``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from mapdeal.checks.facts import FilterFacts, MaskFacts, PlannerFacts, RobotFacts, check
from mapdeal.checks.findings import Remark
from mapdeal.compare.difference import middle_xy
from mapdeal.grid.filters import limits_in
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, count_text, decimal_text
from mapdeal.kernels import distance, lookup
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.components import Labels, labelled
from mapdeal.layers.catalogue import class_name
from mapdeal.layers.obstacle import ObservationSource, Sensing, VoxelLayer
from mapdeal.ros import filters, load, planners, robot, ros2_files

_TOLERANCE = 1e-6  # metres, and radians
_LEAST_AREA = 1.0  # m2 that a zone must cut off to be reported
_MOST_ZONES = 50
_MOST = 10
_TYPES_OF_PLUGIN = {
    "KeepoutFilter": (0,), "SpeedFilter": (1, 2), "BinaryFilter": (3,), "ZoneParameterFilter": (4,)
}  # fmt: skip


@check("mask.geometry", "warning")
def geometry(facts: MaskFacts) -> Iterator[Remark]:
    """A mask of another resolution, size or origin than its map.
    Zones are displaced against the walls by the difference, unless it is meant.
    Example: A mask of the map before it was cropped.
    Fix: Draw the mask anew with mapdeal mask.
    """
    mask, grid = facts.mask.frame, facts.grid.frame
    if not math.isclose(mask.resolution, grid.resolution, rel_tol=_TOLERANCE):
        text = f"resolution {mask.resolution:g} m; the map has {grid.resolution:g} m"
        yield Remark(text, "resolution")
    sizes = [f"{grid_frame.width} x {grid_frame.height} cells" for grid_frame in (mask, grid)]
    if mask.shape != grid.shape:
        yield Remark(f"{sizes[0]}; the map has {sizes[1]}", "image")
    origins = zip(mask.origin, grid.origin, strict=True)
    if any(abs(mask_value - map_value) > _TOLERANCE for mask_value, map_value in origins):
        texts = [", ".join(f"{v:g}" for v in grid_frame.origin) for grid_frame in (mask, grid)]
        yield Remark(f"origin {texts[0]}; the map has {texts[1]}", "origin")
    if abs(math.remainder(mask.origin[2], math.tau)) > _TOLERANCE:
        yield Remark(f"yaw {mask.origin[2]:g}, which Nav2 takes for 0", "origin")


@check("mask.elsewhere", "error")
def elsewhere(facts: MaskFacts) -> Iterator[Remark]:
    """A mask without any cell where the map is known.
    No zone has an effect where the robot drives.
    Example: A mask of another floor, 100 m away.
    Fix: Give the mask the origin of its map.
    """
    if not facts.covered:
        yield Remark(f"covers no known cell of {facts.map_name}: it lies elsewhere", "origin")


@check("mask.part", "warning")
def part(facts: MaskFacts) -> Iterator[Remark]:
    """A mask that does not cover all known cells of the map.
    Outside of the mask there is no zone: the robot may drive there, at full speed.
    Example: A mask drawn before the map was extended.
    Fix: Draw it anew on the map of today.
    """
    if 0 < facts.covered < 1:
        share = f"{math.floor(1000 * facts.covered) / 10:g} %"
        yield Remark(f"covers {share} of the known cells of {facts.map_name}", "image")


@check("mask.nothing", "error")
def nothing(facts: MaskFacts) -> Iterator[Remark]:
    """A mask whose mode and thresholds leave no zone.
    The filter has no effect, and the robot drives through every zone.
    Example: Zones of grey 100 with `occupied_thresh: 0.65`.
    Fix: Paint zones black, or use mode: scale.
    """
    if lookup.histogram(facts.mask.occupancy)[FREE + 1 : OCCUPIED + 1].any():
        return
    if facts.pair is None:
        yield Remark(f"the {facts.info.kind} mask has no zone on the map")
        return
    metadata, greys = facts.pair.metadata, facts.pair.pixels.greys
    if len(greys) < 2:
        yield Remark(f"the {facts.info.kind} mask has no zone: all pixels are alike", "image")
        return
    threshold = f" with occupied_thresh {metadata.occupied_thresh:g}"
    cause = f"mode {metadata.mode}{'' if metadata.mode == 'raw' else threshold}"
    text = f"its image has {len(greys)} greys, but {cause} makes no cell of them more than 0"
    yield Remark(text, "occupied_thresh", places=facts.pair.places_of_greys(list(greys)[:_MOST]))


@check("mask.all-or-nothing", "warning")
def all_or_nothing(facts: MaskFacts) -> Iterator[Remark]:
    """A speed mask in mode trinary: full speed or one limit.
    All zones get the same limit, whatever their grey.
    Example: Zones of 30 % and 60 % with `mode: trinary`.
    Fix: Write mode: scale with thresholds 1.0 and 0.0.
    """
    is_trinary = facts.pair is not None and facts.pair.metadata.mode == "trinary"
    if facts.info.kind == "speed" and is_trinary:
        limit = facts.info.limit_of(OCCUPIED)
        limit_text = "no limit" if limit is None else f"{limit:g} {facts.info.sign}"
        text = f"mode trinary knows 0 and 100 only: every zone gets {limit_text}"
        yield Remark(f"{text}; write mode: scale, with thresholds 1.0 and 0.0", "mode")


@check("mask.no-limit", "warning")
def no_limit(facts: MaskFacts) -> Iterator[Remark]:
    """Zones of a speed mask that Nav2 reads as 'no limit'.
    The robot drives at full speed in a zone that was meant to be slow.
    Example: A zone of value 0 with base 0.
    Fix: Use values whose limit is between 0 and 100 %.
    """
    if facts.info.kind != "speed":
        return
    occupancy = np.asarray(facts.mask.occupancy)
    for value, limit, cells in limits_in(facts.info, lookup.histogram(occupancy)):
        if limit is None:
            speed = facts.info.base + value * facts.info.multiplier
            text = f"{count_text(cells, 'cell')} of value {value}: {speed:g} {facts.info.sign} "
            place = middle_xy(facts.mask.frame, np.argwhere(occupancy == value))
            yield Remark(f"{text}is no limit to Nav2", places=[place])


@check("mask.unknown", "warning")
def unknown_in_mask(facts: MaskFacts) -> Iterator[Remark]:
    """Unknown cells in a speed mask, where the last limit persists.
    The robot stays slow or fast after it has left the zone, and Nav2 logs an error.
    Example: Grey 205 around the zones.
    Fix: Paint everything outside of zones white.
    """
    unknown = np.asarray(facts.mask.occupancy) == UNKNOWN
    count = int(np.count_nonzero(unknown))
    if facts.info.kind == "speed" and count:
        text = f"{count_text(count, 'cell')} are unknown: there the last limit stays, with an error"
        yield Remark(text, places=[middle_xy(facts.mask.frame, np.argwhere(unknown))])


@check("mask.frees-unknown", "warning")
def frees_unknown(facts: MaskFacts) -> Iterator[Remark]:
    """A keepout mask of 0 where the map is unknown, which Nav2 then reads as free.
    The filter overwrites unknown by free: planners lead the robot through unexplored space.
    Example: A white mask around a few black zones.
    Fix: Leave unknown cells of the map unknown.
    """
    if facts.info.kind != "keepout" or facts.mask.frame != facts.grid.frame:
        return
    freed = np.asarray(facts.mask.occupancy) == FREE
    freed &= np.asarray(facts.grid.occupancy) == UNKNOWN
    count = int(np.count_nonzero(freed))
    if count:
        text = f"{count_text(count, 'cell')} of 0 are unknown in the map: the filter makes them "
        place = middle_xy(facts.grid.frame, np.argwhere(freed))
        yield Remark(f"{text}free; unknown cells of a mask change nothing", places=[place])


@check("mask.start", "error")
def start(facts: MaskFacts) -> Iterator[Remark]:
    """A start that a keepout mask covers.
    Planners refuse to start in a closed cell, so the robot does not move.
    Example: A charging place within a zone.
    Fix: Cut the zone back around the start.
    """
    if facts.start_is_closed and facts.start is not None:
        x, y = facts.start[:2]
        yield Remark(f"the start {x:g},{y:g} lies in a keepout zone", places=[(x, y)])


@check("mask.goal", "error")
def goal(facts: MaskFacts) -> Iterator[Remark]:
    """A place, such as a dock, that a keepout mask covers or cuts off.
    The robot never gets there while the filter is active.
    Example: A zone across the only corridor to the dock.
    Fix: Leave a lane to the place.
    """
    if facts.reaches is None:
        return
    before, after = (reach.goals for reach in facts.reaches)
    for unmasked, masked in zip(before, after, strict=True):
        if not unmasked.reachable or masked.reachable:
            continue
        xy = (masked.goal.x, masked.goal.y)
        row, col = facts.grid.frame.unbounded_rowcol_from_xy([xy])[0].tolist()
        why = "lies in a keepout zone" if facts.closed[row, col] else "is cut off by keepout zones"
        yield Remark(f"{masked.goal.label} {why}", places=[xy])


@check("mask.closes", "warning")
def closes(facts: MaskFacts) -> Iterator[Remark]:
    """A keepout zone that closes the only way to a part of the map.
    All goals in that part fail while the filter is active.
    Example: A zone across a corridor.
    Fix: Make the zone narrower, or open another way.
    """
    if facts.reaches is None:
        return
    before, after = facts.reaches
    reachable, kept_reachable = before.reachable.view(np.bool_), after.reachable.view(np.bool_)
    parts = labelled(reachable & ~kept_reachable & ~facts.closed, corners=True)
    areas = parts.sizes * before.cell_area
    zones = labelled(facts.closed & reachable, corners=True)
    for number in (np.argsort(-areas[1:], kind="stable")[:_MOST] + 1).tolist():
        if areas[number] < _LEAST_AREA:
            break
        cells = parts.cells == number
        blocking = _blocking(facts, zones, cells, reachable, kept_reachable)
        places = [middle_xy(facts.grid.frame, np.argwhere(zones.cells == z)) for z in blocking]
        x, y = middle_xy(facts.grid.frame, np.argwhere(cells))
        zone_texts = (f"{facts.name_of(xy) or 'the zone'} at {_text_of(xy)}" for xy in places[:3])
        zones_text = " and ".join(zone_texts) + (" cuts" if len(places) == 1 else " together cut")
        text = f"{zones_text} off {decimal_text(areas[number])} m2 around {_text_of((x, y))}; "
        text += f"reachable are {decimal_text(before.reachable_area)} m2 without the mask, "
        text += f"{decimal_text(after.reachable_area)} m2 "
        yield Remark(f"{text}with it", places=[*places, (x, y)])


def _blocking(
    facts: MaskFacts, zones: Labels, cells: Mask, reachable: Mask, still_reachable: Mask
) -> list[int]:
    values = np.unique(zones.cells[distance.dilate_square(cells, 1)])
    neighbours: list[int] = values[values > 0][:_MOST_ZONES].tolist()
    for zone in neighbours:
        without_zone = labelled(reachable & (~facts.closed | (zones.cells == zone)), corners=False)
        joined = np.zeros(len(without_zone.sizes), dtype=np.bool_)
        joined[without_zone.cells[still_reachable]] = True
        if joined[without_zone.cells[cells]].any():
            return [zone]
    return neighbours


def _text_of(xy: tuple[float, float]) -> str:
    return ",".join(f"{round(v, 3) + 0.0:g}" for v in xy)


@check("params.filter-topic", "warning")
def filter_topic(facts: FilterFacts) -> Iterator[Remark]:
    """A topic of a filter or its info server that no server in the files publishes.
    The filter waits for its mask for ever: keepout zones and speed limits are not respected.
    Example: `filter_info_topic: /zones` while the server publishes /info.
    Fix: Write the same topic in both places.
    """
    servers = facts.servers
    published = {filters.topic_of(server.info_topic) for server in servers.info}
    for listed in _filters(facts):
        value = facts.robot.value(listed.name, "filter_info_topic")
        if value is None:
            text = f"{listed.name} has no filter_info_topic; Nav2 does not start"
            yield Remark(text, at=facts.robot.value(listed.name, "plugin"))
        elif published and filters.topic_of(value.value) not in published:
            topics = ", ".join(sorted(published))
            text = f"{listed.name} waits for {value.value}, and the servers here publish {topics}"
            yield Remark(text, at=value)
    masks = {filters.topic_of(topic) for topic in servers.mask_topics}
    for server in servers.info:
        topic = server.get("mask_topic", "filter_mask")
        if masks and filters.topic_of(topic) not in masks:
            text = f"{server.name} names the mask {topic}, which no map server here publishes"
            yield Remark(text, at=server.values["mask_topic"])


@check("params.filter-type", "error")
def filter_type(facts: FilterFacts) -> Iterator[Remark]:
    """An info server of a type that the filter refuses.
    The filter ignores the mask: the robot drives through its zones.
    Example: A KeepoutFilter with `type: 1`, a speed limit.
    Fix: Set the type that the message names.
    """
    pairs = [(listed, server) for listed in _filters(facts) for server in facts.servers.info]
    for listed, server in pairs:
        value = facts.robot.value(listed.name, "filter_info_topic")
        if value is None or filters.topic_of(value.value) != filters.topic_of(server.info_topic):
            continue
        plugin = listed.plugin.rpartition(":")[2]
        types, kind = _TYPES_OF_PLUGIN.get(plugin), server.get("type", 0)
        at = server.values.get("type", server.first)
        if types is not None and kind not in types:
            needed = " or ".join(map(str, types))
            yield Remark(f"{server.name} has type {kind}, and {plugin} needs {needed}", at=at)
        scale = server.get("base", 0.0), server.get("multiplier", 1.0)
        if plugin == "KeepoutFilter" and scale != (0.0, 1.0):
            text = f"{plugin} takes base 0.0 and multiplier 1.0 only, and {server.name} has others"
            yield Remark(text, at=server.values.get("base", server.values.get("multiplier", at)))


@check("params.filter-lifecycle", "warning")
def filter_lifecycle(facts: FilterFacts) -> Iterator[Remark]:
    """A server of a filter that no lifecycle manager in the files activates.
    Such a server stays silent, so the filter runs without a mask.
    Example: An info server missing from `node_names`.
    Fix: Add the server to node_names.
    """
    managed = facts.servers.managed
    for server in facts.servers.info if managed else ():
        name = server.name.rpartition("/")[2]
        if name not in managed:
            yield Remark(f"{name} is in no node_names: it stays unconfigured", at=server.first)


def _filters(facts: FilterFacts) -> Iterator[robot.ListedLayer]:
    for listed in facts.robot.robot.layers:
        if listed.is_enabled and listed.plugin.rpartition(":")[2] in _TYPES_OF_PLUGIN:
            yield listed


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
