"""Checks of costmap filters: a mask against its map, and the parameters of the servers.

References
----------
``costmap_filter.cpp``, ``keepout_filter.cpp``, ``speed_filter.cpp``, ``binary_filter.cpp`` and
``costmap_filter_info_server.cpp`` of navigation2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapdeal.checks.facts import FilterFacts, MaskFacts, check
from mapdeal.checks.findings import Remark
from mapdeal.compare.difference import middle_xy
from mapdeal.grid.filters import limits_in
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, count_text, decimal_text
from mapdeal.kernels import distance, lookup
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.components import Labels, labelled
from mapdeal.ros import filters, robot

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
