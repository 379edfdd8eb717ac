"""Checks of the sensors of obstacle and voxel layers in a robot's parameter files.

References
----------
``onInitialize`` in ``obstacle_layer.cpp`` and ``voxel_layer.cpp``, of Nav2 and of ROS 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from mapdeal.checks.facts import RobotFacts, check
from mapdeal.checks.findings import Remark
from mapdeal.layers.obstacle import ObservationSource, Sensing, VoxelLayer
from mapdeal.ros.robot import ListedLayer, ParameterValue


def _sensing_layers(facts: RobotFacts) -> Iterator[tuple[ListedLayer, Sensing]]:
    for listed in facts.robot.layers:
        if isinstance(listed.sensing, Sensing) and listed.is_enabled:
            yield listed, listed.sensing


def _place_of(
    facts: RobotFacts, listed: ListedLayer, source: str, *names: str
) -> ParameterValue | None:
    """Return the parameter that sets a source's value, or the list of sources."""
    for name in names:
        for path in ((listed.name, source, name), (source, name), (listed.name, name), (name,)):
            if facts.value(*path) is not None:
                return facts.value(*path)
    return facts.of_layer(listed.name, "observation_sources")


def _has_section(facts: RobotFacts, listed: ListedLayer, source: ObservationSource) -> bool:
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
    is_ros1 = facts.robot.flavour == "ros1"
    names = ("obstacle_range", "raytrace_range") if is_ros1 else _RANGES
    for listed, sensing in _sensing_layers(facts):
        rays = [source.raytrace_max_range for source in sensing.sources if source.clearing]
        for source in sensing.sources:
            if source.marking and rays and source.obstacle_max_range > max(rays):
                text = f"{source.name} marks as far as {names[0]} {source.obstacle_max_range:g} m, "
                text += f"and no ray clears beyond {names[1]} {max(rays):g} m; raise {names[1]}"
                yield Remark(text, at=_place_of(facts, listed, source.name, *names))


_RANGES = ("obstacle_max_range", "raytrace_max_range")


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
            yield Remark(text, at=_place_of(facts, listed, sources[0].name, "clearing"))


@check("params.source-height", "warning")
def source_height(facts: RobotFacts) -> Iterator[Remark]:
    """A source whose heights let no reading above the floor through.

    The sensor neither marks nor clears, and the robot does not see obstacles. Nav2's default of a
    source's max_obstacle_height is 0.
    Example: `obstacle_layer: {observation_sources: scan, scan: {topic: /scan, clearing: true}}`.
    Fix: Set max_obstacle_height of the source, such as 2.0.
    """
    for listed, sensing in _sensing_layers(facts):
        for source in sensing.sources:
            has_no_reading = source.max_obstacle_height <= max(source.min_obstacle_height, 0.0)
            if has_no_reading and _has_section(facts, listed, source):
                at = _place_of(facts, listed, source.name, "max_obstacle_height")
                text = f"{source.name} takes heights of {source.min_obstacle_height:g} to "
                text += f"{source.max_obstacle_height:g} m only; raise its max_obstacle_height"
                yield Remark(text, at=at)


@check("params.voxel-ceiling", "note")
def voxel_ceiling(facts: RobotFacts) -> Iterator[Remark]:
    """Voxels that end below max_obstacle_height of a source of clouds.

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
        heights = [
            source.max_obstacle_height
            for source in sensing.sources
            if source.marking and source.data_type != "LaserScan"
        ]
        highest = min(sensing.max_obstacle_height, max(heights, default=-math.inf))
        if ceiling < highest - _LEAST_GAP:
            text = f"the voxels of {listed.name} end at {ceiling:g} m, and obstacles up to "
            text += f"{highest:g} m are accepted: those above are not marked"
            yield Remark(text, at=_place_of(facts, listed, "", "z_voxels", "z_resolution"))


_LEAST_GAP = 1e-6  # metres


@check("params.expected-rate", "note")
def expected_rate(facts: RobotFacts) -> Iterator[Remark]:
    """A source with expected_update_rate.

    Whenever its messages are later than that, the costmap is not current and the robot stops.
    Example: `obstacle_layer: {observation_sources: scan, scan: {max_obstacle_height: 2.0,
    clearing: true, expected_update_rate: 0.1}}`.
    Fix: Remove it, or set it to several periods of the sensor.
    """
    for listed, sensing in _sensing_layers(facts):
        for source in sensing.sources:
            if source.expected_update_rate > 0:
                text = f"the robot stops if {source.name} is later than "
                text += f"{source.expected_update_rate:g} s (expected_update_rate)"
                yield Remark(text, at=_place_of(facts, listed, source.name, "expected_update_rate"))


@check("params.source-section", "warning")
def source_section(facts: RobotFacts) -> Iterator[Remark]:
    """A name in observation_sources without parameters.

    The source has defaults only: a topic of its own name, no clearing, and in Nav2 a
    max_obstacle_height of 0.
    Example: `obstacle_layer: {observation_sources: scan}`.
    Fix: Add a section of this name, or take it out of the list.
    """
    for listed, sensing in _sensing_layers(facts):
        for source in sensing.sources:
            if not _has_section(facts, listed, source):
                text = (
                    f"{source.name} is in observation_sources of {listed.name}, without a section"
                )
                yield Remark(text, at=_place_of(facts, listed, source.name))
