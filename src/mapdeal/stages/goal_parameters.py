"""Goals as a parameter of a stage: how recipes, manifests and settings write them.

A mapping of names and places, or a list of places::

    goals: {kitchen: [7.1, 3.2], hall: [1.5, -2]}
    goals: [[7.1, 3.2], [1.5, -2]]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from mapdeal.errors import ParameterError
from mapdeal.grid.reach import Goal
from mapdeal.stages.parameters import Parameter, structured

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
