"""Stage ``cost``: what its models share. Each model is a function in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from mapdeal.stages.definition import Parameters, stage

P = ParamSpec("P")
R = TypeVar("R")


def cost_model(
    name: str, *, title: Callable[[Parameters], str], memory: float, **more: Any
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a function a model of costs; see `mapdeal.stages.definition.Stage`."""
    return stage(
        name="cost",
        model=name,
        summary="Turn a map or its distance field into a costmap.",
        title=title,
        memory=memory,
        is_last=True,
        **more,
    )
