"""A robot's own parameters as a recipe: its layers become the stages that do what they do."""

from __future__ import annotations

from typing import Any

from mapdeal.pipeline.recipe_file import Draft, Given
from mapdeal.robot.parameters import RobotParameters
from mapdeal.stages.catalogue import STAGE_NAMES, models_of


def draft_for(robot: RobotParameters) -> Draft:
    """Return the stages that make a robot's costmap of a map.

    Each stage knows whether it has a part in that; of several models the first one that can do
    all that the layers do is taken.

    Parameters
    ----------
    robot : RobotParameters
        The robot: its layers that are switched on, and its shape.

    Returns
    -------
    list of (str, Given)
        ``esdf`` and ``cost``, with their parameters. Without any layer that reads the map
        there is no ``esdf``.
    """
    draft: Draft = []
    for name in STAGE_NAMES:
        for model, stage in models_of(name).items():
            values = stage.of_layers(robot.costmap_layers)
            if values is not None:
                given: dict[str, Any] = {} if model is None else {"model": model}
                draft.append((name, Given({**given, **values})))
                break
    return draft
