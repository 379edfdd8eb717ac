"""Differences of exact costs from those of the queue in older inflation layers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.errors import kept_warnings
from mapdeal.grid.costmap import InflationLayer
from mapdeal.pipeline.files import read_input
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.stages.queue_costs import queue_difference

_PER_CELL = 60.0
"""Bytes for each cell that the queue takes, measured and rounded up."""


def told_of_queue(path: Path, step: Step, settings: Settings) -> str | None:
    """Return how costs of exact distances differ from those of an older inflation layer's queue."""
    if not _has_queue(step):
        return None
    with settings.memory(), kept_warnings():  # all of it was said when the costs were made
        taken: Any = step.taken(read_input(path, settings, _PER_CELL).grid)
        cells, largest = queue_difference(taken, step.parameters)
    if not cells:
        return f"{step.name}: no cell differs from the queue of older inflation layers"
    differ = "1 cell differs" if cells == 1 else f"{cells} cells differ"
    return f"{step.name}: {differ} from the queue of older inflation layers, by {largest} at most"


def _has_queue(step: Step) -> bool:
    layers = step.parameters.get("layers")
    if layers is None:
        return step.parameters.get("lookup") == "exact"
    return any(isinstance(one, InflationLayer) and one.lookup == "exact" for one in layers)
