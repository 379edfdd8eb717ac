"""Parameters of stages with structured values in recipes and manifests.

Layers of costmap_2d form a list of mappings, each with one key, the kind of the layer, and its
settings below::

    - static: {track_unknown_space: no}
    - denoise: {minimal_group_size: 2}
    - inflation: {inflation_radius: 0.7, cost_scaling_factor: 3.0}
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mapdeal.command import Parameter, parameters_of, structured, unknown_name
from mapdeal.errors import ParameterError, require
from mapdeal.grid.footprint import is_number
from mapdeal.grid.reach import Goal
from mapdeal.layers.layer import CostmapLayer
from mapdeal.records import replace

_GOALS_EXAMPLE = "{kitchen: [7.1, 3.2], ...} or [[7.1, 3.2], ...]"
_LAYERS_EXAMPLE = "[{static: {}}, {inflation: {inflation_radius: 0.55}}]"


def accept_goals(name: str, value: object) -> tuple[Goal, ...]:
    goals = tuple(_goals(name, value))
    for goal_name, count in Counter(goal.name for goal in goals if goal.name is not None).items():
        require(count == 1, "two goals have this name", name, got=goal_name)
    return goals


def described_goals(goals: Sequence[Goal]) -> dict[str, list[float]] | list[Any]:
    """Return goals as JSON-serialisable values, which `accept_goals` converts back."""
    places = [(goal.name, [goal.x, goal.y]) for goal in goals]
    named = {name: place for name, place in places if name is not None}
    if named and len(named) == len(goals):
        return named
    return [place if name is None else {name: place} for name, place in places]


def _goals(name: str, value: object) -> Iterator[Goal]:
    is_pair = isinstance(value, list | tuple) and value and all(is_number(x) for x in value)
    if isinstance(value, Goal) or is_pair:  # one place, not a list of places
        value = [value]
    elif isinstance(value, str):  # such as ``7.1, 3.2 1.5,-2``
        value = ",".join(part.strip() for part in value.split(",")).split()
    elif isinstance(value, Mapping):
        value = [{key: place} for key, place in value.items()]
    if not isinstance(value, Iterable) or isinstance(value, bytes):
        raise ParameterError(f"must look like {_GOALS_EXAMPLE}", place=name, got=value)
    for number, item in enumerate(value, start=1):
        place = f"{name} {number}"
        if isinstance(item, Mapping):
            require(len(item) == 1, "must be a place, or one name and its place", place, got=item)
            ((key, xy),) = item.items()
            yield _goal(f"{name} {key}", xy, _goal_name(name, key))
        elif isinstance(item, Goal):
            named = None if item.name is None else _goal_name(place, item.name)
            yield _goal(place, (item.x, item.y), named)
        else:
            yield _goal(place, item)


def _goal(place: str, xy: object, name: str | None = None) -> Goal:
    x, y = Parameter(place, None, tuple[float, float], optional=False, conditions=()).accept(xy)
    return Goal(x, y, name)


def _goal_name(place: str, value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):  # YAML's reading of a room's number
        value = str(value)
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        hint = None if isinstance(value, str) else "put it into quotes"
        raise ParameterError("a goal's name must be text", place=place, got=value, hint=hint)
    return value


if TYPE_CHECKING:  # what callers pass; a stage gets the goals made of it
    Goals = Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | Sequence[Goal]
else:
    Goals = tuple[Goal, ...]
    structured(Goals, accept_goals)


LayerList = tuple[CostmapLayer, ...]  # layers of a costmap as a parameter of a stage


def accept_layers(name: str, value: object) -> LayerList:
    if not isinstance(value, list | tuple):
        rule = f"must be a list of layers such as {_LAYERS_EXAMPLE}"
        raise ParameterError(rule, place=name, got=value)
    return tuple(_layer(f"{name} {number}", item) for number, item in enumerate(value, start=1))


def layers_with(layers: LayerList, name: str, value: object) -> LayerList | None:
    """Return layers with a new value for a parameter that is named as in model ``exponential``."""
    from mapdeal.layers.catalogue import KINDS  # all layers: few runs need them

    if name == "lethal_threshold":
        name = "lethal_cost_threshold"  # as ROS calls it
    kind = next((kind for kind in KINDS.values() if name in _parameters_of(kind)), None)
    if kind is None:
        return None
    owners = [layer for layer in layers if layer.key == kind.key]
    if kind.spreads and name != "lookup" and len(owners) != 1:
        names = ", ".join(layer.name for layer in owners) or "none"
        raise ParameterError(f"needs exactly one inflation layer, found: {names}", place=name)
    accepted: Any = {name: _parameters_of(kind)[name].accept(value)}
    return tuple(replace(layer, **accepted) if layer.key == kind.key else layer for layer in layers)


def _layer(place: str, item: object) -> CostmapLayer:
    from mapdeal.layers.catalogue import KINDS

    settings: object = None
    if hasattr(item, "described"):  # a layer
        item = item.described()
    if isinstance(item, Mapping) and len(item) == 1:
        ((item, settings),) = item.items()
    if settings is not None and not isinstance(settings, Mapping):
        raise ParameterError(f"must look like {_LAYERS_EXAMPLE}", place=place, got={item: settings})
    if not isinstance(item, str):
        raise ParameterError(f"must look like one of {_LAYERS_EXAMPLE}", place=place, got=item)
    if item not in KINDS:
        raise unknown_name("kind of layer", item, KINDS, place=place)
    known = _parameters_of(KINDS[item])
    values: dict[str, Any] = {}
    for key, value in (settings or {}).items():
        if key == "name":
            is_word = isinstance(value, str) and value.isprintable() and value != ""
            require(is_word, "must be a word", f"{place} {item}.{key}", got=value)
            values[key] = value
        elif key in known:
            try:
                values[key] = known[key].accept(value)
            except ParameterError as error:
                error.place = f"{place} {item}.{error.place}"
                raise
        else:
            raise unknown_name("parameter", key, known, place=f"{place} {item}")
    return KINDS[item](**values)


def _parameters_of(kind: type[CostmapLayer]) -> dict[str, Parameter]:
    fields: Any = kind
    return {name: own for name, own in parameters_of(fields).items() if name != "name"}


structured(LayerList, accept_layers)
