"""A robot's own parameters as a recipe: its layers become the stages that do what they do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD
from mapdeal.pipeline.recipe_file import Draft, Given
from mapdeal.pipeline.step import Step, make_step
from mapdeal.robot.parameters import RobotParameters
from mapdeal.stages.catalogue import STAGE_NAMES, models_of
from mapdeal.stages.layer_parameters import layers_with


def draft_for(robot: RobotParameters) -> Draft:
    """Return the stages that make a robot's costmap of a map."""
    # Each stage knows whether it has a part in that; of several models the first one that can do
    # all that the layers do is taken.
    draft: Draft = []
    for name in STAGE_NAMES:
        for model, stage in models_of(name).items():
            values = stage.of_layers(robot.costmap_layers)
            if values is not None:
                given: dict[str, Any] = {} if model is None else {"model": model}
                draft.append((name, Given({**given, **values})))
                break
    return draft


def planned_shape(robot: RobotParameters) -> Footprint:
    """Return a robot's shape as the costs of its planner have it."""
    if robot.robot_radius is None:
        return robot.footprint
    return Footprint.circle(robot.inscribed_radius)


def step_for(name: str, robot: RobotParameters, given: Mapping[str, object]) -> Step:
    """Return the step of one stage for a robot; what is given wins over the robot's parameters."""
    models = models_of(name)
    own = _own_of(name, robot, given.get("model"))
    if own is not None:
        for key, value in given.items():
            put_value(name, own, key, value)
        return make_step(name, own)
    wanted = given.get("model", next(iter(models)))
    stage = models.get(wanted if isinstance(wanted, str) else None)
    values: dict[str, object] = {}
    if stage is not None and stage.robot is not None and stage.robot.replaces not in given:
        values |= stage.robot.parameters(robot.footprint)
    if stage is not None and "lethal_threshold" in stage.parameters and robot.static_layers:
        values["lethal_threshold"] = max(robot.static_layers[-1].lethal_cost_threshold, 1)
    return make_step(name, {**values, **given})


def _own_of(name: str, robot: RobotParameters, model: object) -> Given | None:
    """Return the parameters of a stage for a robot's layers, if it, or its model, follows them."""
    own = dict(draft_for(robot)).get(name)
    if own is None or model is None or model == own.get("model"):
        return own
    stage = models_of(name).get(model if isinstance(model, str) else None)
    values = None if stage is None else stage.of_layers(robot.costmap_layers)
    if stage is not None and stage.robot is not None and values is None:
        rule = "cannot make what the layers of the parameter file make"
        hint = f"model {own['model']} can, which is taken without it"
        raise ParameterError(rule, place=f"{name}.model", got=model, hint=hint)
    return None if values is None else Given({"model": model, **values})


def put_map_rules(draft: Draft, robot: RobotParameters) -> None:
    """Make stages that look at a map for a robot read it as the robot's static layer does."""
    # This sets the occupancy at which a cell is lethal, and whether unknown cells are free. Values
    # set in the draft stay, and stages on a field or on costs do not need the first.
    if not robot.static_layers:
        return
    layer = robot.static_layers[-1]
    threshold = max(layer.lethal_cost_threshold, 1)
    of_map = {} if threshold == DEFAULT_LETHAL_THRESHOLD else {"lethal_threshold": threshold}
    of_all = {} if layer.track_unknown_space else {"through_unknown": True}
    works_on: type[Any] = OccupancyGrid
    for name, given in draft:
        stage = next(iter(models_of(name).values()))
        if stage.hands_on:
            works_on = stage.makes
        elif stage.robot is not None:
            rules = {**of_all, **(of_map if works_on is OccupancyGrid else {})}
            given.put({k: v for k, v in rules.items() if k in stage.parameters and k not in given})


def put_value(
    name: str, own: Given, key: str, value: object, source: str | None = None
) -> None:  # fmt: skip
    """Set a parameter of a stage, or of one of its layers if only layers have it."""
    model = own.get("model")
    stage = models_of(name).get(model if isinstance(model, str) else None)
    layers: Any = own.get("layers")
    if stage is not None and key not in stage.parameters and isinstance(layers, tuple):
        try:
            changed = layers_with(layers, key, value)
        except ParameterError as error:
            error.place = f"{name}.{error.place}"
            error.source = error.source or source
            raise
        if changed is not None:
            key, value = "layers", changed
    own.put({key: value}, source)
