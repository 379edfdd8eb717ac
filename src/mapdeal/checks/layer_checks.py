"""Checks of the list of layers, and of the names in a robot's parameter files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from difflib import get_close_matches

from mapdeal.checks.check import check
from mapdeal.checks.finding import Remark
from mapdeal.checks.parameter_facts import ParameterFacts, RobotFacts
from mapdeal.checks.parameter_names import (
    ABOVE_LAYERS,
    BELOW_INFLATION,
    LOOKS_LIKE_A_LAYER,
    OF_AN_IDLE_LAYER,
    SECTIONS_OF_OLD,
    known_names,
)
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.grid.costmap_layers import InflationLayer
from mapdeal.robot.values import Name

_ALIKE = 0.85
_MOST, _LONGEST = 1000, 60
"""Unknown names that are compared with all known ones, and the characters that they may have."""
_MARKING = (
    "StaticLayer", "ObstacleLayer", "VoxelLayer", "RangeSensorLayer", "NonPersistentVoxelLayer",
    "SpatioTemporalVoxelLayer",
)  # fmt: skip
"""Classes that write lethal cells, by their names without a package."""


def class_of(plugin: str) -> str:
    """Return the class of a plugin without its package."""
    return plugin.replace("/", "::").rpartition("::")[2]


@check(
    "params.layer-after-inflation",
    "warning",
    "a layer that writes obstacles after the inflation layer: they are not inflated",
)
def layer_after_inflation(facts: RobotFacts) -> Iterator[Remark]:
    """Look for layers that mark cells after inflation, and so uninflated ones."""
    inflation = None
    for one in facts.robot.layers:
        if not one.is_enabled or one.is_filter:
            continue
        if isinstance(one.layer, InflationLayer):
            inflation = one.name
        elif inflation is not None and class_of(one.plugin) in _MARKING:
            overwrites = one.layer is not None and not getattr(one.layer, "use_maximum", False)
            effect = "it overwrites the costs" if overwrites else "its obstacles are not inflated"
            text = f"{one.name} comes after {inflation}: {effect}"
            yield Remark(text, at=facts.value("plugins"))


@check("params.two-inflations", "warning", "two inflation layers that are both switched on")
def two_inflations(facts: RobotFacts) -> Iterator[Remark]:
    """Count inflation layers; of two, each cell gets the higher cost."""
    names = [one.name for one in facts.robot.inflation_layers]
    if len(set(names)) > 1:
        text = f"{' and '.join(names)} both inflate: a cell gets the higher of their costs"
        yield Remark(text, at=facts.value("plugins"))


@check("params.layer-disabled", "note", "a layer that is listed, and switched off")
def layer_disabled(facts: RobotFacts) -> Iterator[Remark]:
    """Look for ``enabled: false``."""
    for one in facts.robot.layers:
        is_last = isinstance(one.layer, InflationLayer) and not facts.robot.inflation_layers
        if not one.is_enabled and not is_last:  # which params.no-inflation tells
            yield Remark(f"{one.name} is switched off", at=facts.value(one.name, "enabled"))


@check("params.plugin-twice", "warning", "a layer that is listed twice")
def plugin_twice(facts: ParameterFacts) -> Iterator[Remark]:
    """Count names in the list."""
    for name, count in Counter(name for name, _ in facts.plugins).items():
        if count > 1:
            text = f"{name} is listed {count} times"
            yield Remark(text, at=facts.values.get(("plugins",)))


@check(
    "params.unused-section", "note", "parameters of a layer that the list of plugins does not name"
)
def unused_section(facts: ParameterFacts) -> Iterator[Remark]:
    """Look for parameters of layers that nobody loads: often the list spells them otherwise.

    A file of ROS 1 that both costmaps load has the layers of either; and every second Nav2 file
    has the static layer of Nav2's example in its local costmap, which changes nothing.
    """
    listed = {name for name, _ in facts.plugins} | set(_named_within(facts))
    for name, section in facts.sections.items():
        names = {path[1] for path in section}
        if name in listed or names.isdisjoint(LOOKS_LIKE_A_LAYER):
            continue
        near = get_close_matches(name, listed, n=1, cutoff=_ALIKE)
        if not near and (facts.flavour == "ros1" or names <= OF_AN_IDLE_LAYER):
            continue
        text = f"{name} is not in the list of plugins: its parameters have no effect"
        hint = f"; did you mean {near[0]}?" if near else ""
        yield Remark(text + hint, at=next(iter(section.values())))


def _named_within(facts: ParameterFacts) -> Iterator[str]:
    """Yield what layers of layers, and of sensors, name in lists of their own."""
    for path, one in facts.values.items():
        if len(path) == 2 and path[1] in ("plugins", "observation_sources"):
            yield from _words(one.value)


def _words(value: object) -> list[str]:
    if isinstance(value, str):
        return value.split()
    return [one for one in value if isinstance(one, str)] if isinstance(value, list | tuple) else []


@check("params.misspelt", "warning", "a name that is nearly that of a parameter")
def misspelt(facts: ParameterFacts) -> Iterator[Remark]:
    """Compare names with those that the costmap and its layers read."""
    unknown = 0
    for places, known in _places(facts):
        for path, value in places.items():
            name = path[-1]
            if name in known or len(name) > _LONGEST or (unknown := unknown + 1) > _MOST:
                continue
            near = get_close_matches(name, known, n=1, cutoff=_ALIKE)
            if near and (*path[:-1], near[0]) not in facts.values:
                text = f"no parameter is called {facts.shown(*path)}: did you mean {near[0]}?"
                yield Remark(text, at=value)


def _places(
    facts: ParameterFacts,
) -> Iterator[tuple[dict[Name, ParameterValue], frozenset[str]]]:
    """Yield the parameters of the costmap and of each layer, with the names known there."""
    own: dict[Name, ParameterValue] = {}
    own |= {path: one for path, one in facts.values.items() if len(path) == 1}
    yield own, known_names(facts.flavour, "")
    for name, plugin in dict(facts.plugins).items():
        known = known_names(facts.flavour, class_of(plugin))
        if known:
            section = facts.section(name)
            yield {path: one for path, one in section.items() if len(path) == 2}, known


@check("params.misplaced", "warning", "a parameter where nobody reads it")
def misplaced(facts: ParameterFacts) -> Iterator[Remark]:
    """Look for names that are read at another level."""
    inflations = [name for name, kind in facts.plugins if kind.endswith("InflationLayer")]
    for path, value in facts.values.items():
        if facts.flavour == "nav2" and len(path) == 1 and path[0] in BELOW_INFLATION:
            where = f"it belongs below {inflations[0]}" if inflations else "no layer takes it"
            yield Remark(f"{path[0]} has no effect here: {where}", at=value)
        if len(path) == 2 and path[1] in ABOVE_LAYERS[facts.flavour]:
            classes = ABOVE_LAYERS[facts.flavour][path[1]]
            if any(name == path[0] and class_of(kind) in classes for name, kind in facts.plugins):
                text = f"{facts.shown(*path)} has no effect: it is a parameter of the costmap"
                yield Remark(text, at=value)


@check("params.without-effect", "note", "parameters of ROS 1 that a list of plugins makes useless")
def without_effect(facts: ParameterFacts) -> Iterator[Remark]:
    """Look for what pre-Hydro costmaps read, as ``warnForOldParameters`` does."""
    if facts.flavour != "ros1" or ("plugins",) not in facts.values:
        return
    for name in SECTIONS_OF_OLD:
        value = facts.values.get((name,))
        if value is not None:
            yield Remark(f"{name} has no effect: the layers are those of plugins", at=value)
