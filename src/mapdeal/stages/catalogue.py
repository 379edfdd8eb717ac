"""All stages, in the order of `mapdeal.stages.listed`."""

from __future__ import annotations

from mapdeal.command import Stage, stages_among
from mapdeal.stages import listed

STAGES: tuple[Stage, ...] = stages_among(vars(listed))
STAGE_NAMES: tuple[str, ...] = tuple(dict.fromkeys(stage.name for stage in STAGES))


def models_of(name: str) -> dict[str | None, Stage]:
    """Return the models of a stage by name, the default first; a single model has no name."""
    return {stage.model: stage for stage in STAGES if stage.name == name}
