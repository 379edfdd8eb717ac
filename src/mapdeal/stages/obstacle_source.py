"""What a stage on obstacles starts from: a map, or the distance field of one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OCCUPIED

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
