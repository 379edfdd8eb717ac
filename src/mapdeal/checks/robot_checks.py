"""Checks of a robot's shape and inflation, as its parameter files come to."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mapdeal.checks.check import check
from mapdeal.checks.finding import Remark
from mapdeal.checks.parameter_facts import RobotFacts
from mapdeal.grid.costmap_layers import InflationLayer
from mapdeal.robot.parameters import INJECTED

_INSCRIBED_COST = 252
_STEEP = 0.5
_CLIFF = 128
_ALIKE = 1e-6
_SIDES = ("", "_left", "_right")
"""Ends of the names of a factor: an AsymmetricInflationLayer has two."""


def _widest(facts: RobotFacts) -> InflationLayer | None:
    """Return the inflation layer that reaches farthest, if any has an effect."""
    layers = [one for one in facts.robot.inflation_layers if one.inflation_radius > 0]
    return max(layers, key=lambda one: one.inflation_radius, default=None)


@check(
    "params.inflation-below-circumscribed",
    "warning",
    "an inflation radius between the footprint's inscribed and circumscribed radius",
)
def inflation_below_circumscribed(facts: RobotFacts) -> Iterator[Remark]:
    """Compare them: planners that trust in cost 0 turn the footprint into walls."""
    layer, robot = _widest(facts), facts.robot
    if layer is None or robot.robot_radius is not None:
        return  # of a round robot, headings make no difference
    if robot.inscribed_radius <= layer.inflation_radius < robot.circumscribed_radius:
        yield Remark(
            f"{_reach(layer)} is below the circumscribed radius, "
            f"{robot.circumscribed_radius:.4g} m: cost 0 does not mean that every heading is free",
            at=facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.no-inflation", "warning", "a costmap in which no inflation layer has an effect")
def no_inflation(facts: RobotFacts) -> Iterator[Remark]:
    """Look for an inflation layer that is switched on and reaches anywhere."""
    robot = facts.robot
    if _widest(facts) is not None:
        return
    if robot.flavour == "nav2" and robot.inflation_layers:
        return  # of radius 0, which params.inflation-radius tells
    listed = [one for one in robot.layers if isinstance(one.layer, InflationLayer)]
    why = "no inflation layer is listed" if not listed else f"{listed[0].name} is switched off"
    at = facts.value("plugins")
    if listed and listed[0].is_enabled:
        why = f"{listed[0].name}'s inflation_radius is 0"
        at = facts.of_layer(listed[0].name, "inflation_radius")
    elif listed:
        at = facts.value(listed[0].name, "enabled")
    yield Remark(
        f"{why}: cells beside obstacles cost 0, although the robot collides there "
        f"(inscribed radius {robot.inscribed_radius:.4g} m)",
        at=at,
    )


@check("params.cost-cliff", "note", "costs that are still high where inflation ends")
def cost_cliff(facts: RobotFacts) -> Iterator[Remark]:
    """Take the cost at the inflation radius."""
    layer = _widest(facts)
    if layer is None or layer.inflation_radius <= layer.inscribed_radius:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    cost = math.floor(_INSCRIBED_COST * math.exp(-layer.cost_scaling_factor * beyond))
    if cost >= _CLIFF:
        fades = "cost_scaling_factor is 0"
        if layer.cost_scaling_factor > 0:
            ends = layer.inscribed_radius + math.log(_INSCRIBED_COST) / layer.cost_scaling_factor
            fades = f"cost_scaling_factor {layer.cost_scaling_factor:g} lets them fade out at "
            fades += f"{ends:.3g} m"
        yield Remark(
            f"costs drop from {cost} to 0 at {_reach(layer)}; {fades}",
            at=facts.of_layer(layer.name, "cost_scaling_factor")
            or facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.cost-ends-early", "note", "costs that are 0 long before inflation ends")
def cost_ends_early(facts: RobotFacts) -> Iterator[Remark]:
    """Take the distance at which costs become 0."""
    layer = _widest(facts)
    if layer is None or layer.cost_scaling_factor <= 0:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    fades = math.log(_INSCRIBED_COST) / layer.cost_scaling_factor
    if fades < _STEEP * beyond:
        yield Remark(
            f"costs are 0 from {layer.inscribed_radius + fades:.3g} m on: with cost_scaling_factor "
            f"{layer.cost_scaling_factor:g} the rest of {_reach(layer)} has none",
            at=facts.of_layer(layer.name, "cost_scaling_factor")
            or facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.inflation-defaults", "note", "an inflation layer that leaves ROS's defaults")
def inflation_defaults(facts: RobotFacts) -> Iterator[Remark]:
    """Look for a radius or a scaling factor that nobody has chosen."""
    for layer in facts.robot.inflation_layers:
        told = [
            f"{name} is {value:g}{unit}"
            for name, value, unit in (
                ("inflation_radius", layer.inflation_radius, " m"),
                ("cost_scaling_factor", layer.cost_scaling_factor, ""),
            )
            if not any(facts.of_layer(layer.name, f"{name}{side}") for side in _SIDES)
        ]
        if told:
            section = facts.parameters.section(layer.name)
            at = next(iter(section.values()), facts.value("plugins"))
            yield Remark(f"{layer.name}: not set, and so {' and '.join(told)}", at=at)


@check(
    "params.radius-and-footprint",
    "warning",
    "a robot_radius beside a footprint: it has no effect",
)
def radius_and_footprint(facts: RobotFacts) -> Iterator[Remark]:
    """Look for both: ``setRobotFootprint`` takes the polygon."""
    radius = facts.value("robot_radius")
    if facts.robot.robot_radius is None and radius is not None:
        footprint = facts.value("footprint")
        where = f", which stands on line {footprint.line}" if footprint is not None else ""
        yield Remark(f"robot_radius has no effect: footprint counts{where}", at=radius)


@check(
    "params.unknown-is-free",
    "warning",
    "unknown space that is free to drive in, as track_unknown_space is not set",
)
def unknown_is_free(facts: RobotFacts) -> Iterator[Remark]:
    """Look for a static layer that does not keep unknown cells."""
    layers = [one for one in facts.robot.static_layers if one.name != INJECTED]
    free = [one for one in layers if not one.track_unknown_space]
    own = facts.value("track_unknown_space")  # of Nav2 the costmap's alone
    if free and own is None and facts.of_layer(free[0].name, "track_unknown_space") is None:
        text = "track_unknown_space is not set, and is false: the map's unknown cells cost 0"
        yield Remark(text, at=facts.value("plugins"))


@check(
    "params.costmaps-differ",
    "note",
    "a global and a local costmap of robots of different shape",
)
def costmaps_differ(facts: RobotFacts) -> Iterator[Remark]:
    """Compare the radii of both costmaps."""
    robot, other = facts.robot, facts.other
    if other is None:
        return
    radii = [(one.inscribed_radius, one.circumscribed_radius) for one in (robot, other)]
    if all(abs(a - b) <= _ALIKE for a, b in zip(*radii, strict=True)):
        return
    shapes = " and ".join(
        f"in the {r.costmap} one {r.inscribed_radius:.4g} m and {r.circumscribed_radius:.4g} m"
        for r in (robot, other)
    )
    yield Remark(
        f"the robot differs between the costmaps: inscribed and circumscribed radius are {shapes}",
        at=facts.value("footprint") or facts.value("robot_radius"),
    )


@check(
    "params.resolution",
    "note",
    "a resolution of the global costmap that is not that of the map",
)
def resolution(facts: RobotFacts) -> Iterator[Remark]:
    """Compare it with the map, whose geometry the static layer gives the costmap."""
    value = facts.value("resolution")
    if value is None or facts.robot.rolling_window or not facts.robot.static_layers:
        return
    if not isinstance(value.value, int | float) or isinstance(value.value, bool):
        return
    maps: dict[float, list[str]] = {}
    for name, cell in facts.map_resolutions:
        maps.setdefault(cell, []).append(name)
    for cell, names in maps.items():
        if not math.isclose(value.value, cell, rel_tol=1e-6):
            of = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
            text = f"has no effect: the static layer takes the map's, {cell:g} m ({of})"
            yield Remark(f"resolution {value.value:g} m {text}", at=value)


def _reach(layer: InflationLayer) -> str:
    return f"inflation_radius {layer.inflation_radius:g} m"
