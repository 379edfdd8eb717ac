"""Stage ``cost``: what its models share. Each model is a function in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from mapdeal.grid.costmap import UNIFORM_SHARE
from mapdeal.grid.framed import Figures
from mapdeal.grid.values import INSCRIBED_PUBLISHED
from mapdeal.stages.definition import Parameters, stage

P = ParamSpec("P")
R = TypeVar("R")

Advice = Callable[[Parameters, int], str]
"""Returns which parameter to change, given all of them and the cost that most cells have."""


def cost_model(
    name: str,
    *,
    title: Callable[[Parameters], str],
    memory: float,
    advice: Advice,
    when_closed: str,
    **more: Any,
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Turn a function into a cost model; see `mapdeal.stages.definition.Stage`."""

    def remark(parameters: Parameters, figures: Figures) -> str | None:
        return _remark_on_uniform_costs(figures, parameters, advice, when_closed)

    return stage(
        name="cost",
        model=name,
        summary="Turn a map or its distance field into a costmap.",
        title=title,
        memory=memory,
        is_last=True,
        remark=remark,
        **more,
    )


def _remark_on_uniform_costs(
    figures: Figures, parameters: Parameters, advice: Advice, when_closed: str
) -> str | None:
    """Return what to say of costs that are the same nearly everywhere, None of others."""
    common = figures["most_common"]
    if common is None:
        cells = figures["width"] * figures["height"]
        if figures["unknown"] == cells:
            return "every cell is unknown"
        return f"every known cell is lethal or inscribed: {when_closed}"
    if common["share"] <= UNIFORM_SHARE:
        return None
    cost, cells = common["cost"], f"{100 * common['share']:.4g} % of the open cells"
    if not figures["lethal"]:
        return f"{cells} cost {cost}: there is no obstacle"
    if figures["cost_scale"] == "occupancy" and cost < INSCRIBED_PUBLISHED:
        cells += f" (below {INSCRIBED_PUBLISHED})"
    return f"{cells} cost {cost}: {advice(parameters, cost)}"
