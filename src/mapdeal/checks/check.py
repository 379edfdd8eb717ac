"""The decorator that adds a function to the list of checks."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, get_type_hints

from mapdeal.checks.facts import GridFacts, PairFacts, ParameterFacts, RobotFacts, RoomFacts
from mapdeal.checks.finding import Check, Remark, Severity, add_check

_FACTS = (PairFacts, GridFacts, RoomFacts, ParameterFacts, RobotFacts)

CheckFunction = TypeVar(
    "CheckFunction",
    bound=Callable[[PairFacts], Iterator[Remark | str]]
    | Callable[[GridFacts], Iterator[Remark | str]]
    | Callable[[RoomFacts], Iterator[Remark | str]]
    | Callable[[ParameterFacts], Iterator[Remark | str]]
    | Callable[[RobotFacts], Iterator[Remark | str]],
)


def check(name: str, severity: Severity, about: str) -> Callable[[CheckFunction], CheckFunction]:
    def added(function: CheckFunction) -> CheckFunction:
        add_check(Check(name, severity, about, function, _facts_of(name, function)))
        return function

    return added


def _facts_of(name: str, function: Callable[..., Any]) -> type:
    hints = get_type_hints(function)
    annotations = [hints.get(parameter) for parameter in inspect.signature(function).parameters]
    for facts in _FACTS:
        if annotations == [facts]:
            return facts
    known = " or ".join(facts.__name__ for facts in _FACTS)
    rule = f"check {name} must have one parameter, annotated {known}"
    raise TypeError(f"{rule}, got {annotations}")
