"""Parameters of stages that are more than a line of text, as written in recipes and manifests.

Layers of costmap_2d form a list of mappings, each with one key, the kind of the layer, and its
settings below::

    - static: {track_unknown_space: no}
    - inflation: {inflation_radius: 0.7, cost_scaling_factor: 3.0}
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from typing import Any, get_type_hints

from mapdeal.command import (
    ABOVE_0,
    AT_LEAST_0,
    PERCENT,
    Bound,
    Parameter,
    accept_parameters,
    split_optional,
    structured,
    unknown_name,
)
from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import CostmapLayer, InflationLayer, StaticLayer
from mapdeal.grid.frame import MOST_CELLS, Frame, check_origin, check_resolution
from mapdeal.grid.reach import Goal

_FRAME = {
    "height": Parameter("height", None, int, optional=False, bounds=(ABOVE_0,)),
    "width": Parameter("width", None, int, optional=False, bounds=(ABOVE_0,)),
    "resolution": Parameter("resolution", None, float, optional=False, bounds=(ABOVE_0,)),
    "origin": Parameter("origin", None, tuple[float, float, float], optional=False, bounds=()),
}
_FRAME_LOOKS = "{height: 60, width: 80, resolution: 0.05, origin: [-2, -1.5, 0]}"


def accept_frame(name: str, value: object) -> Frame:
    if isinstance(value, Frame):
        return value
    if not isinstance(value, Mapping) or set(value) != set(_FRAME):
        raise ParameterError(f"must look like {_FRAME_LOOKS}", place=name, got=value)
    found = accept_parameters(_FRAME, value, name)
    if found["height"] * found["width"] > MOST_CELLS:
        raise ParameterError(f"must not have more than {MOST_CELLS} cells", place=name, got=value)
    check_resolution(found["resolution"])
    return Frame(**{**found, "origin": check_origin(found["origin"])})


structured(Frame, accept_frame)


_LOOKS = "{kitchen: [7.1, 3.2], ...} or [[7.1, 3.2], ...]"


def accept_goals(name: str, value: object) -> tuple[Goal, ...]:
    goals = tuple(_goals(name, value))
    names = set()
    for goal in goals:
        if goal.name in names:
            raise ParameterError("two goals have this name", place=name, got=goal.name)
        if goal.name is not None:
            names.add(goal.name)
    return goals


def described_goals(goals: Sequence[Goal]) -> dict[str, list[float]] | list[Any]:
    """Return goals as JSON or YAML can hold them, which `accept_goals` reads again."""
    places = [(goal.name, [goal.x, goal.y]) for goal in goals]
    named = {name: place for name, place in places if name is not None}
    if named and len(named) == len(goals):
        return named
    return [place if name is None else {name: place} for name, place in places]


def _goals(name: str, value: object) -> Iterator[Goal]:
    if isinstance(value, Goal) or _is_pair(value):
        value = [value]
    elif isinstance(value, str):
        value = _places_in(value)
    if isinstance(value, Mapping):
        yield from _named(name, value)
    elif isinstance(value, Iterable) and not isinstance(value, (str, bytes)):
        for number, item in enumerate(value, start=1):
            place = f"{name} {number}"
            if isinstance(item, Mapping):
                if len(item) != 1:
                    rule = "must be a place, or one name and its place"
                    raise ParameterError(rule, place=place, got=dict(item))
                yield from _named(name, item)
            elif isinstance(item, Goal):
                yield _named_goal(place, item.name, (item.x, item.y))
            else:
                yield _named_goal(place, None, item)
    else:
        raise ParameterError(f"must look like {_LOOKS}", place=name, got=value)


def _named(name: str, places: Mapping[Any, object]) -> Iterator[Goal]:
    for key, place in places.items():
        yield _named_goal(f"{name} {key}", _name(name, key), place)


def _named_goal(place: str, name: str | None, value: object) -> Goal:
    x, y = Parameter(place, None, tuple[float, float], optional=False, bounds=()).accept(value)
    return Goal(x, y, None if name is None else _name(place, name))


def _name(place: str, value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):  # YAML's reading of a room's number
        value = str(value)
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        hint = None if isinstance(value, str) else "put it into quotes"
        raise ParameterError("a goal's name must be text", place=place, got=value, hint=hint)
    return value


def _is_pair(value: object) -> bool:
    """Return whether it is a single place as numbers, rather than a list of places."""
    return (
        isinstance(value, (list, tuple))
        and bool(value)
        and all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in value)
    )


def _places_in(text: str) -> list[str]:
    """Return the places in a text such as ``7.1, 3.2 1.5,-2``.

    Examples
    --------
    >>> _places_in("7.1, 3.2 1.5,-2")
    ['7.1,3.2', '1.5,-2']
    """
    return ",".join(part.strip() for part in text.split(",")).split()


Goals = tuple[Goal, ...]
"""Places that a robot should get to, as a parameter of a stage."""

structured(Goals, accept_goals)


_KINDS: dict[str, type[StaticLayer] | type[InflationLayer]] = {
    "static": StaticLayer,
    "inflation": InflationLayer,
}
_BYTE = Bound("a byte, 0 to 255, or -1 for 255", lambda value: -1 <= value <= 255)
_BOUNDS = {
    "lethal_cost_threshold": PERCENT,
    "unknown_cost_value": _BYTE,
    "inscribed_obstacle_cost_value": _BYTE,
    "inscribed_radius": AT_LEAST_0,
    "inflation_radius": AT_LEAST_0,
    "cost_scaling_factor": AT_LEAST_0,
}
_NAMES = {"lethal_threshold": "lethal_cost_threshold"}
"""What model ``exponential`` calls otherwise than ROS."""

_LAYER_PARAMETERS_LOOKS = "[{static: {}}, {inflation: {inflation_radius: 0.55}}]"


def accept_layers(name: str, value: object) -> tuple[CostmapLayer, ...]:
    if not isinstance(value, (list, tuple)):
        raise ParameterError(
            f"must be a list of layers such as {_LAYER_PARAMETERS_LOOKS}", place=name, got=value
        )
    return tuple(_layer(f"{name} {number}", item) for number, item in enumerate(value, start=1))


def described_layer(layer: CostmapLayer) -> dict[str, dict[str, Any]]:
    """Return a layer with all its settings, ready for JSON or YAML.

    Examples
    --------
    >>> described_layer(InflationLayer())["inflation"]["inflation_radius"]
    0.55
    """
    (kind,) = (kind for kind, made in _KINDS.items() if isinstance(layer, made))
    return {kind: asdict(layer)}


def layers_with(
    layers: tuple[CostmapLayer, ...], name: str, value: object
) -> tuple[CostmapLayer, ...] | None:
    """Return layers with a new value for the parameter of a name in model ``exponential``."""
    name = _NAMES.get(name, name)
    made = next((one for one in _KINDS.values() if name in _parameters_of(one)), None)
    if made is None:
        return None
    owners = [one for one in layers if isinstance(one, made)]
    if made is InflationLayer and name != "lookup" and len(owners) != 1:
        names = ", ".join(one.name for one in owners) or "none"
        rule = f"there must be one inflation layer for it to be of, there are: {names}"
        raise ParameterError(rule, place=name)
    accepted = _parameters_of(made)[name].accept(value)
    return tuple(
        replace(one, **{name: accepted}) if isinstance(one, made) else one for one in layers
    )


def _layer(place: str, item: object) -> CostmapLayer:
    given: Mapping[str, object] = {}
    if isinstance(item, (StaticLayer, InflationLayer)):
        ((item, given),) = described_layer(item).items()
    elif isinstance(item, Mapping) and len(item) == 1:
        ((item, below),) = item.items()
        if not isinstance(below, Mapping) and below is not None:
            raise ParameterError(
                f"must look like {_LAYER_PARAMETERS_LOOKS}", place=place, got={item: below}
            )
        given = below or {}
    if not isinstance(item, str):
        raise ParameterError(
            f"must look like one of {_LAYER_PARAMETERS_LOOKS}", place=place, got=item
        )
    if item not in _KINDS:
        raise unknown_name("kind of layer", item, _KINDS, place=place)
    made = _KINDS[item]
    known = _parameters_of(made)
    values: dict[str, Any] = {}
    for key, value in given.items():
        if key == "name":
            values[key] = _layer_parameters_name(f"{place} {item}.{key}", value)
        elif key in known:
            try:
                values[key] = known[key].accept(value)
            except ParameterError as error:
                error.place = f"{place} {item}.{error.place}"
                raise
        else:
            raise unknown_name("parameter", key, known, place=f"{place} {item}")
    for key in ("unknown_cost_value", "inscribed_obstacle_cost_value"):
        if values.get(key) == -1:
            values[key] = 255
    return made(**values)


def _parameters_of(made: type[StaticLayer] | type[InflationLayer]) -> dict[str, Parameter]:
    """Return what can be set of a kind of layer besides its name."""
    hints = get_type_hints(made)
    found = {}
    for one in fields(made):
        if one.name != "name":
            kind, optional = split_optional(hints[one.name])
            bounds = (_BOUNDS[one.name],) if one.name in _BOUNDS else ()
            found[one.name] = Parameter(one.name, one.default, kind, optional, bounds)
    return found


def _layer_parameters_name(place: str, value: object) -> str:
    if not isinstance(value, str) or not value.isprintable() or not value:
        raise ParameterError("must be a word", place=place, got=value)
    return value


LayerList = tuple[CostmapLayer, ...]
"""Layers of a costmap, as a parameter of a stage."""

structured(LayerList, accept_layers)
