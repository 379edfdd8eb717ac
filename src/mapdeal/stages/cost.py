"""Stage ``cost``: what its models share. Each model is a function in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import Parameters, stage
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.costmap import UNIFORM_SHARE
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, INSCRIBED_PUBLISHED, OCCUPIED

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
    """Turn a function into a cost model; see `mapdeal.command.Stage`."""

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


ObstacleSource = OccupancyGrid | DistanceField


def check_lethal_threshold(source: ObstacleSource, lethal_threshold: int | None) -> int:
    """Return the threshold to use: the field's own for a field, else the given or 100."""
    refuse_view(source)
    if isinstance(source, DistanceField):
        if lethal_threshold not in (None, source.lethal_threshold):
            rule = f"the distance field was made with {source.lethal_threshold}"
            raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
        return source.lethal_threshold
    return DEFAULT_LETHAL_THRESHOLD if lethal_threshold is None else lethal_threshold


def refuse_view(source: ObstacleSource) -> None:
    """Raise a `ParameterError` if a map is the view of a field."""
    if isinstance(source, FieldView):
        rule = "is the 0..100 view of a distance field, not a map"
        hint = "only costs of model threshold are made of it; take the map or the npz of the field"
        raise ParameterError(rule, hint=hint)


def warn_of_strength(source: ObstacleSource, model: str) -> None:
    """Warn where costs are made of a field whose strength the model takes no account of."""
    if isinstance(source, DistanceField) and source.strength != 1:
        text = f"cost: model {model} takes no account of the field's strength"
        text += f", {source.strength:g}; views and model threshold do"
        emit_warning(text, stacklevel=4)


def obstacles_of(source: ObstacleSource, lethal_threshold: int) -> NDArray[np.bool_]:
    if isinstance(source, DistanceField):
        return source.obstacles()
    return source.occupied(lethal_threshold)


def occupancy_with_obstacles(
    occupancy: NDArray[np.int8], obstacles: NDArray[np.bool_]
) -> NDArray[np.int8]:  # fmt: skip
    """Return a copy of the occupancy in which every obstacle is 100."""
    copy = np.array(occupancy)
    copy[obstacles] = OCCUPIED
    return copy
