"""All stages, in the order in which they are listed: a new one is a line here.

The line makes the function part of the public API, too.
"""

from __future__ import annotations

# isort: off - the order counts; of models of one stage the first is the default
from mapdeal.stages.active import active_region as active_region
from mapdeal.stages.definition import Stage, stages_among

# The order counts; of the models of one stage the first is the default.
# isort: off
from mapdeal.stages.inflate import inflate as inflate
from mapdeal.stages.esdf import esdf as esdf
from mapdeal.stages.potential import potential as potential
from mapdeal.stages.exponential_cost import exponential_cost as exponential_cost
from mapdeal.stages.threshold_cost import threshold_cost as threshold_cost
from mapdeal.stages.ring_cost import ring_cost as ring_cost
# isort: on

STAGES: tuple[Stage, ...] = stages_among(globals())

STAGE_NAMES: tuple[str, ...] = tuple(dict.fromkeys(stage.name for stage in STAGES))


def models_of(name: str) -> dict[str | None, Stage]:
    """Return the models of a stage by their names, the default first; a lone one has none.

    Empty if there is no such stage.
    """
    return {stage.model: stage for stage in STAGES if stage.name == name}


def stage_named(name: str, model: str | None = None) -> Stage:
    """Return a stage, by default in its default model.

    Raises
    ------
    KeyError
        If there is no such stage or model.
    """
    models = models_of(name)
    if not models:
        raise KeyError(name)
    return next(iter(models.values())) if model is None else models[model]
