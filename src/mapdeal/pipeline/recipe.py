"""Recipes: which stages run, in which order, with which parameters, a robot's own among them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import yaml

from mapdeal import command, records
from mapdeal.errors import MalformedInputError, ParameterError, as_known, emit_warning
from mapdeal.files.source import YAML, exists
from mapdeal.files.yaml_text import OF_RECIPES, Entry, parse_value, read_mapping
from mapdeal.grid import frame, occupancy
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.field import View
from mapdeal.grid.footprint import Footprint, FootprintLike, shape_of
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OneLineRepr, check_choice
from mapdeal.layers.stack import CostmapLayers
from mapdeal.maps import kinds, npz
from mapdeal.maps.dialects import Dialect
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import CostmapName, RobotParameters
from mapdeal.stages.catalogue import STAGE_NAMES, STAGES, models_of
from mapdeal.stages.structured import layers_with

_NO_STAGES = "a recipe needs stages: a list of stages"
_LOOKS = 'a recipe is the key stages: and below it a list of items like "- inflate: {radius: 0.3}"'
_LINE = re.compile(r"(?:(?P<key>[^(]*) \()?line (?P<line>\d+)(?:, (?P<column>column \d+))?\)?")
BUILT_IN = ("default", "nav2", "local", "arena", "design-real", "design-sim", "design-local")


def setting_words() -> Iterable[str]:
    words: dict[str, None] = {}  # models of a stage share parameters
    for stage in STAGES:
        if stage.model:
            words[f"{stage.name}.model={stage.model}"] = None
        for name, parameter in stage.parameters.items():
            choices = ("yes", "no") if parameter.kind is bool else parameter.choices
            words |= dict.fromkeys(f"{stage.name}.{name}={choice}" for choice in choices or ("",))
    return words


RecipeName = Annotated[str | None, command.Words("NAME|FILE", completed=lambda: BUILT_IN)]
Changes = Annotated[
    list[str] | None, command.Words("STAGE.PARAMETER=VALUE", name="set", completed=setting_words)
]


class StageValues(dict[str, object]):
    def __init__(
        self, values: Mapping[str, object] | None = None, sources: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(values or {})
        self.sources = dict(sources or {})

    def set_values(self, values: Mapping[str, object], source: str | None = None) -> None:
        self.update(values)
        for name in values:
            self.sources.pop(name, None)
            if source is not None:
                self.sources[name] = source

    def located(self, error: ParameterError, stage: str) -> ParameterError:
        place = (error.place or "").replace(" ", ".")  # "inflate.footprint vertex 1"
        for name, source in self.sources.items():
            if error.source is None and f"{place}.".startswith(f"{stage}.{name}."):
                error.source = source
        return error


Draft = dict[str, StageValues]


def read_recipe_file(path: Path, name: str) -> Draft:
    """Return the stages of a recipe's file, of which only names and order are checked."""
    try:
        entries = _entries_in(path)
        for key, entry in entries.items():
            if key != "stages":
                error = command.unknown_name("key", key, ["stages"])
                error.hint = _LOOKS if models_of(as_known(key, STAGE_NAMES)) else error.hint
                raise _at(entry, error, name)
        if not entries:
            raise ParameterError(_NO_STAGES, source=name, hint=_LOOKS)
        listed = entries["stages"]
        if not isinstance(listed.node, yaml.SequenceNode) or not listed.node.value:
            raise _at(listed, ParameterError(_NO_STAGES, hint=_LOOKS), name)
        draft: Draft = {}
        for item in listed.items():
            stage, values = _stage_of(item, name)
            _check_place(item, stage, [*draft], name)
            draft[stage] = values
    except MalformedInputError as error:  # one of usage, with the line behind the file's name
        error.source = name
        if found := _LINE.fullmatch(error.place or ""):
            error.source += f":{found['line']}"
            error.place = found["key"] or found["column"]
        raise ParameterError(str(error), hint=error.hint) from None
    return draft


def _entries_in(path: Path) -> dict[str, Entry]:
    with kinds.recognised(path, "a recipe", kinds.RECIPE):
        try:
            entries = read_mapping(path, OF_RECIPES)
        except MalformedInputError as error:
            if error.place is None:  # no mapping: an empty file, or stages without their key
                error.hint = error.hint or _LOOKS
            raise
    kind = None if "stages" in entries else kinds.kind_of(path)
    if kind is not None:
        raise kinds.other_kind(path, kind, "a recipe")
    return entries


def _stage_of(item: Entry, name: str) -> tuple[str, StageValues]:
    rule = "an item of stages must look like stage: {parameter: value}"
    if isinstance(item.node, yaml.ScalarNode) and not item.is_nothing():
        return item.text(), StageValues()
    if not isinstance(item.node, yaml.MappingNode) or len(item.node.value) != 1:
        raise item.error(rule)
    ((stage, below),) = item.fields().items()
    if below.is_nothing():
        return stage, StageValues()
    if not isinstance(below.node, yaml.MappingNode):
        raise item.error(rule)
    fields = below.merged_fields()
    values: dict[str, object] = {
        key: Entry(field.source, f"{stage}.{key}", field.node).plain_value()
        for key, field in fields.items()
    }
    lines = {key: f"{name}:{field.line}" for key, field in fields.items()}
    return stage, StageValues(values, lines)


def _check_place(item: Entry, added: str, before: Sequence[str], name: str) -> None:
    if not models_of(added):
        raise _at(item, command.unknown_name("stage", added, STAGE_NAMES), name)
    if added in before:
        raise _at(item, ParameterError("a stage can run once", place=added), name)
    *earlier, own = (next(iter(models_of(stage_name).values())) for stage_name in (*before, added))
    works_on = next((stage for stage in reversed(earlier) if stage.passes_output_on), None)
    if works_on and works_on.is_last and works_on.product_type not in own.takes:
        raise _at(item, ParameterError(f"cannot follow {works_on.name}", place=added), name)


def _at(entry: Entry, error: ParameterError, name: str) -> ParameterError:
    error.source = f"{name}:{entry.line}"
    return error


def draft_for(layers: CostmapLayers) -> Draft:
    # Each stage knows whether it has a part in that; of several models the first one that can do
    # all that the layers do is taken.
    draft: Draft = {}
    for name in STAGE_NAMES:
        for model, stage in models_of(name).items():
            if (values := stage.parameters_from_layers(layers)) is not None:
                model_value = {} if model is None else {"model": model}
                draft[name] = StageValues({**model_value, **values})
                break
    return draft


def _model_of(name: str, model: object) -> command.Stage | None:
    return models_of(name).get(model if isinstance(model, str) else None)


def planned_shape(
    robot: RobotParameters | None, footprint: Footprint | None = None
) -> Footprint | None:
    """Return a given footprint, or else the shape with which planners check a robot."""
    if robot is None or footprint is not None:
        return footprint
    if robot.robot_radius is None:
        return robot.footprint
    return Footprint.circle(robot.inscribed_radius)


def step_for(name: str, robot: RobotParameters, values: Mapping[str, object]) -> Step:
    is_placed = values.get("pose") is not None or values.get("map_to_odom") is not None
    layers = robot.layers_around_robot if is_placed else robot.costmap_layers
    if (own := _own_of(name, layers, values.get("model"))) is not None:
        for key, value in values.items():
            put_value(name, own, key, value)
        return make_step(name, own)
    stage = _model_of(name, values.get("model", next(iter(models_of(name)))))
    shaped_values: dict[str, object] = {}
    if stage is not None and stage.robot is not None and stage.robot.replaces not in values:
        shaped_values |= stage.robot.parameters(robot.footprint)
    static_layers = robot.costmap_layers.static_layers
    if stage is not None and "lethal_threshold" in stage.parameters and static_layers:
        shaped_values["lethal_threshold"] = max(static_layers[-1].lethal_cost_threshold, 1)
    if stage is not None and "through_unknown" in stage.parameters:
        shaped_values["through_unknown"] = not robot.costmap_layers.keeps_unknown
    return make_step(name, {**shaped_values, **values})


def _own_of(name: str, layers: CostmapLayers, model: object) -> StageValues | None:
    """Return the parameters of a stage for a robot's layers, if it, or its model, follows them."""
    own = draft_for(layers).get(name)
    if own is None or model is None or model == own.get("model"):
        return own
    stage = _model_of(name, model)
    values = None if stage is None else stage.parameters_from_layers(layers)
    if stage is not None and stage.robot is not None and values is None:
        rule = "cannot make what the layers of the parameter file make"
        hint = f"model {own['model']} can, which is taken without it"
        raise ParameterError(rule, place=f"{name}.model", got=model, hint=hint)
    return None if values is None else StageValues({"model": model, **values})


def put_map_rules(draft: Draft, robot: RobotParameters) -> None:
    """Make stages that look at a map for a robot read it as the robot's static layer does."""
    # This sets the occupancy at which a cell is lethal, and whether unknown cells are free. Values
    # set in the draft stay, and stages on a field or on costs do not need the first.
    layers = robot.costmap_layers
    if not layers.static_layers:
        return
    threshold = max(layers.static_layers[-1].lethal_cost_threshold, 1)
    of_map = {} if threshold == DEFAULT_LETHAL_THRESHOLD else {"lethal_threshold": threshold}
    of_all = {} if layers.keeps_unknown else {"through_unknown": True}
    works_on: type[Any] = occupancy.OccupancyGrid
    for name, values in draft.items():
        stage = next(iter(models_of(name).values()))
        if stage.passes_output_on:
            works_on = stage.product_type
        elif stage.robot is not None:
            rules = {**of_all, **(of_map if works_on is occupancy.OccupancyGrid else {})}
            new = {k: v for k, v in rules.items() if k in stage.parameters and k not in values}
            values.set_values(new)


def put_value(
    name: str, own: StageValues, key: str, value: object, source: str | None = None
) -> None:
    stage = _model_of(name, own.get("model"))
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
    own.set_values({key: value}, source)


DEFAULT = "default"
SET = "--set"  # what errors call a change that is given as text


@records.dataclass(frozen=True, repr=False)
class Recipe(OneLineRepr):
    """Checked sequence of stages with their parameters.

    Parameters
    ----------
    steps : tuple of Step
        Steps of the pipeline, in order; see `described`.
    robot : RobotParameters, optional
        Robot whose parameter files the recipe follows.
    """

    steps: tuple[Step, ...]
    robot: RobotParameters | None = None

    @property
    def is_smaller(self) -> bool:
        """Whether a product may cover only a part of the map."""
        return any(step.stage.is_smaller(step.parameters) for step in self.steps)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings from loading the parameters, which manifests record."""
        return (*(self.robot.remarks if self.robot else ()), *_remarks_on(self.steps))

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that the robot's parameters were read from."""
        return () if self.robot is None else self.robot.paths

    def _repr_parts(self) -> Iterator[str]:
        yield " -> ".join(" ".join(filter(None, (s.name, s.stage.model))) for s in self.steps)

    def described(self) -> list[dict[str, Any]]:
        """Return the steps with all their parameters, as values that JSON or YAML can represent."""
        return [step.described() for step in self.steps]


RecipeLike = str | PathLike[str] | Recipe | RobotParameters
"""A built-in recipe, a file, a recipe that was loaded, or a robot, whose costmap it is."""


def load_recipe(
    recipe: RecipeLike | None = DEFAULT,
    changes: Mapping[str, object] | Sequence[str] | None = None, *,
    footprint: FootprintLike | None = None, sim: bool = False, robot: RobotParameters | None = None,
    robot_radius: float | None = None,
) -> Recipe:  # fmt: skip
    """Load a recipe, apply changes to it, and check all its parameters.

    Parameters
    ----------
    recipe : str, path, Recipe or RobotParameters
        Name of a built-in recipe, such as ``default`` or ``nav2`` (see ``mapdeal run --help``),
        or a YAML file. A loaded recipe is returned unchanged. Robot parameters, from
        `read_robot_parameters`, become a recipe for the costmap that they describe. None stands
        for `robot`, or for ``default`` without one.
    changes : mapping of str to object, or sequence of str, optional
        Parameters by ``stage.parameter``, such as ``{"inflate.radius": 0.3}``, or as texts like
        those of ``--set``. They override everything else.
    footprint : Footprint, optional
        Robot shape. It sets the radius of `inflate`, or the radii of the costs if the recipe
        does not inflate.
    sim : bool
        Whether the map shows a simulated world: its active region is cropped first, and the field
        treats unknown cells as obstacles.
    robot : RobotParameters, optional
        Robot whose shape a named recipe takes. Stages that pass nothing on to later ones also read
        the map as the robot's static layer does.
    robot_radius : float, optional
        Radius of a round robot, metres, instead of a footprint.

    Returns
    -------
    Recipe
        Recipe for `apply_recipe` and `run`; `Recipe.described` lists all its parameters.

    Raises
    ------
    ParameterError
        If the recipe does not exist or is malformed, a parameter is unknown or invalid, or changes
        are given for a loaded recipe.
    FileAccessError
        If the recipe file cannot be read.

    Warns
    -----
    MapdealWarning
        If the robot's radius would be applied twice.

    Examples
    --------
    >>> load_recipe("nav2", {"cost.inflation_radius": 0.8})
    Recipe(esdf -> cost exponential)
    """
    footprint = shape_of(footprint, robot_radius)
    if isinstance(recipe, Recipe):
        if changes or footprint is not None or sim or robot is not None:
            rule = "a recipe that was loaded cannot be changed"
            raise ParameterError(rule, place="recipe", hint="give the changes to load_recipe")
        return recipe
    if isinstance(recipe, RobotParameters):
        recipe, robot = None, recipe
    if recipe is not None and not isinstance(recipe, str | PathLike):
        rule = "must be the name of a recipe, a file, a robot, or what load_recipe returns"
        raise ParameterError(rule, place="recipe", got=recipe)
    if recipe == "":
        raise ParameterError("must not be empty", place="recipe")
    if robot is not None:
        robot = robot if footprint is None else robot.with_shape(footprint)
        footprint = None if recipe is None else robot.footprint
    if robot is not None and recipe is None:
        draft, name = draft_for(robot.costmap_layers), "of the robot"
    else:
        name = DEFAULT if recipe is None else str(recipe)
        draft = _read_draft(name)
        if robot is not None:
            put_map_rules(draft, robot)
    if sim:
        draft = _adapt_to_sim(draft)
    steps = _steps_of(draft, name, changes, footprint, robot)
    for text in _remarks_on(steps):
        emit_warning(text)
    return Recipe(tuple(steps), robot)


def _steps_of(
    draft: Draft, name: str, changes: object, footprint: Footprint | None,
    robot: RobotParameters | None, *, source: str | None = "changes",
) -> list[Step]:  # fmt: skip
    if footprint is not None:
        radius = None if robot is None or robot.robot_radius is None else robot.inscribed_radius
        planner_shape = footprint if radius is None else Footprint.circle(radius)
        _adapt_to_footprint(draft, footprint, planner_shape, name)
    _apply_changes(draft, changes, name, source)
    steps = []
    for stage, values in draft.items():
        try:
            steps.append(make_step(stage, values))
        except ParameterError as error:
            raise values.located(error, stage) from None
    return steps


def step_of_recipe(
    recipe: str, name: str, values: Mapping[str, object], *, footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
) -> Step:  # fmt: skip
    draft = {stage: own for stage, own in _read_draft(recipe).items() if stage == name}
    if not draft:
        raise ParameterError(f"has no stage {name}", source=f"recipe {recipe}")
    if footprint is None and robot is not None:
        footprint = robot.footprint
    changes = {f"{name}.{key}": value for key, value in values.items()}
    (step,) = _steps_of(draft, recipe, changes, footprint, robot, source=None)
    return step


def _read_draft(name: str) -> Draft:
    if name in BUILT_IN:
        built_in = Path(__file__).with_name("recipes") / f"{name}.yaml"
        draft = read_recipe_file(built_in, name)
        return {stage: StageValues(values) for stage, values in draft.items()}
    path = Path(name)
    if path.suffix not in YAML and not exists(path):
        raise command.unknown_name("recipe", name, BUILT_IN)
    return read_recipe_file(path, name)


def _stage_in(name: str, values: StageValues) -> command.Stage:
    """Return the stage of an item, in the model that it asks for; an unknown one fails later."""
    return _model_of(name, values.get("model")) or next(iter(models_of(name).values()))


def _adapt_to_sim(draft: Draft) -> Draft:
    for stage in reversed(STAGES):
        rule = stage.in_simulation
        if rule is not None and rule.is_added and stage.name not in draft:
            draft = {stage.name: StageValues(), **draft}
        if rule is not None and stage.name in draft:
            draft[stage.name].set_values(rule.parameters)
    return draft


def _adapt_to_footprint(
    draft: Draft, footprint: Footprint, of_planner: Footprint, name: str
) -> None:
    """Apply the robot's shape to the first stage that needs it, and to side stages."""
    # After a stage that grows obstacles by the shape, a later stage would apply it twice. Costs
    # still distinguish obstacles from the cells around them. Side stages, which pass nothing on,
    # get the shape `of_planner`: a circle if the robot's own files define it as round.
    shaped: command.Stage | None = None
    grown, is_used = False, False
    for stage_name, values in draft.items():
        stage = _stage_in(stage_name, values)
        if stage.robot is None or grown or (stage.passes_output_on and shaped is not None):
            continue
        values.pop(stage.robot.replaces, None)
        shape = footprint if stage.passes_output_on else of_planner
        values.set_values(stage.robot.parameters(shape))
        is_used = True
        if stage.passes_output_on:
            shaped, grown = stage, stage.product_type is not Costmap
    if not is_used:
        raise ParameterError("the recipe has no stage that uses a robot's shape", source=name)


def _apply_changes(draft: Draft, changes: object, name: str, source: str | None) -> None:
    if isinstance(changes, Mapping):
        for target, value in changes.items():
            _apply_change(draft, target, value, name, source)
        return
    texts: Any = () if changes is None else changes
    is_list = isinstance(texts, Sequence) and not isinstance(texts, str)
    if not is_list or not all(isinstance(text, str) for text in texts):
        raise ParameterError("must be values by name", place="changes", got=changes)
    for setting in texts:
        target, equals, value = map(str.strip, setting.partition("="))
        if not (equals and all(target.partition("."))):
            rule = "must look like stage.parameter=value"
            hint = _hint_for(draft, target) if equals else None
            raise ParameterError(rule, source=SET, got=setting, hint=hint)
        _apply_change(draft, target, _value_of(target, value), name, SET, setting)


def _value_of(target: str, text: str) -> object:
    stage, _, parameter = target.partition(".")
    name, models = parameter.replace("-", "_"), models_of(stage).values()
    if not any(model.parameters[name].is_yaml for model in models if name in model.parameters):
        return text
    try:
        return parse_value(text, SET)
    except MalformedInputError as error:
        error.source = error.place = None
        raise ParameterError(str(error), source=SET, place=target) from None


def _apply_change(
    draft: Draft, target: str, value: object, name: str, option: str | None,
    setting: str | None = None,
) -> None:  # fmt: skip
    setting = setting or target
    stage, _, parameter = parts = str(target).partition(".")
    if not all(parts):
        rule = "must look like {'stage.parameter': value}"
        raise ParameterError(rule, source=option, got=target, hint=_hint_for(draft, target))
    if (values := draft.get(stage)) is None:
        if not models_of(stage):
            raise command.unknown_name("stage", stage, STAGE_NAMES, place=option)
        rule = f"recipe {name} has no stage {stage}"
        hint = f"its stages are {', '.join(draft)}"
        raise ParameterError(rule, source=option, got=setting, hint=hint)
    parameter = parameter.replace("-", "_")
    for by, replacement in _stage_in(stage, values).in_place_of.items():
        if parameter in (by, replacement.parameter):
            values.pop(by, None)
            values.pop(replacement.parameter, None)
    put_value(stage, values, parameter, value, option)


def _hint_for(draft: Draft, target: object) -> str | None:
    name = str(target).replace("-", "_")
    stages = (_stage_in(stage, own) for stage, own in draft.items())
    found = [f"{stage.name}.{name}" for stage in stages if name in stage.parameters]
    return f"did you mean {' or '.join(found)}?" if found else None


def _remarks_on(steps: Sequence[Step]) -> Iterator[str]:
    """Yield a text where the robot's radius counts in a stage, and once more in one after it."""
    before: Step | None = None
    for step in steps:
        name, radius = _radius_in(step) or ("", None)
        if radius is None:
            continue
        if before is None:
            before = step if step.stage.passes_output_on else None
        elif radius > 0 and not (
            before.stage.product_type is Costmap and Costmap in step.stage.takes
        ):
            text = f"{step.name}: {name} {radius:g} m comes on top of stage {before.name}"
            yield f"{text} before it, so the robot's radius counts twice"


def _radius_in(step: Step) -> tuple[str, float] | None:
    robot, radius_in = step.stage.robot, step.stage.radius_in
    if robot is None:
        return None if radius_in is None else radius_in(step.parameters)
    radius = step.parameters[robot.replaces]
    for name in robot.sets:
        shape = step.parameters[name]
        if not radius and isinstance(shape, Footprint):
            return name, shape.circumscribed_radius
    return robot.replaces, radius


def read_robot_parameters(
    paths: str | PathLike[str] | Sequence[str | PathLike[str]], *,
    costmap: CostmapName = "global", namespace: str | None = None, dialect: Dialect = "nav2",
) -> RobotParameters:  # fmt: skip
    """Read a robot's shape and costmap from its own parameter files, like ``--params-file``.

    Parameters
    ----------
    paths : path, str or sequence of them
        A Nav2 parameter file, or ROS 1 costmap files; later files override earlier ones. A ROS 1
        file without a costmap's name at the top level is loaded into the requested costmap.
    costmap : {'global', 'local'}
        Costmap to read.
    namespace : str, optional
        Namespace of the robot, if the files describe several.
    dialect : {'nav2', 'humble', 'ros1'}
        Version of the inflation layer for a Nav2 file: the current one (``nav2``), or the one of
        Humble to Kilted and ROS 1.

    Returns
    -------
    RobotParameters
        Parameters that can be used instead of a recipe: ``run(path, output, robot)``.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If the actual ROS node would not start with these files.
    ParameterError
        If Nav2 and ROS 1 files are mixed, or no file is given.

    Warns
    -----
    MapdealWarning
        If the resulting costmap may not be the one that the author of the files expects.

    Examples
    --------
    >>> robot = read_robot_parameters("examples/robots/nav2_params.yaml")
    >>> round(robot.inscribed_radius, 3), [layer.name for layer in robot.ignored]
    (0.19, ['obstacle_layer', 'keepout_filter'])
    """
    from mapdeal.ros.load import read_robot  # of use to few commands

    check_choice(costmap, CostmapName, "costmap")
    check_choice(dialect, Dialect, "dialect")
    names = [paths] if isinstance(paths, str | PathLike) else paths
    if not (isinstance(names, Sequence) and all(isinstance(n, str | PathLike) for n in names)):
        is_shape = isinstance(paths, Sequence | np.ndarray | Footprint)
        name, noun = ("footprint=...", "corners") if is_shape else ("robot_radius=0.2", "a radius")
        hint = f"costmap(map, {name}) takes {noun}"
        raise ParameterError("takes paths of parameter files", place="robot", got=paths, hint=hint)
    files, up_to_kilted = list(map(Path, names)), dialect != "nav2"
    return read_robot(files, costmap=costmap, namespace=namespace, up_to_kilted=up_to_kilted)


def cost_curve(
    cells: npz.Grid | float, *, model: str | None = None, footprint: FootprintLike | None = None,
    robot: RobotParameters | None = None, **parameters: Any,
) -> CostCurve:  # fmt: skip
    """Return the costs of a cost model by distance from the nearest obstacle.

    Parameters
    ----------
    cells : OccupancyGrid, DistanceField, FieldView or float
        Map that the costs are for, or only the side of its cells, metres.
    model : {'exponential', 'layers', 'threshold', 'rings'}, optional
        Cost model. By default that of `robot`, or ``exponential`` without a robot.
    footprint : Footprint, optional
        Robot shape, instead of ``inscribed_radius``; only for model ``exponential``.
    robot : RobotParameters, optional
        Robot's own parameters, from `read_robot_parameters`. Other arguments override them.
    **parameters
        Parameters of the model: those of `exponential_cost`, `layered_cost`, `threshold_cost` or
        `ring_cost`.

    Returns
    -------
    CostCurve
        Each distance that occurs between cells, with the cost of a free cell there.

    Raises
    ------
    ParameterError
        If a parameter is unknown, invalid or missing; if view ``per-map``, which depends on the
        extremes of a map, is given without a map; or if layers lack a static layer.

    Examples
    --------
    >>> curve = cost_curve(0.05, inscribed_radius=0.1, inflation_radius=0.12)
    >>> curve.distance.round(3).tolist()
    [0.0, 0.05, 0.071, 0.1, 0.112, 0.141, 0.15]
    >>> curve.cost.tolist()
    [254, 253, 253, 253, 223, 166, 152]
    """
    if isinstance(cells, Real) and not isinstance(cells, bool):
        if as_known(str(parameters.get("view")), get_args(View)) == "per-map":
            rule = "per-map is scaled by the extremes of a map"
            hint = "give a map instead of the side of its cells"
            raise ParameterError(rule, place="view", hint=hint)
        cells = occupancy.OccupancyGrid(np.zeros((1, 1), dtype=np.int8), float(cells))
    if not isinstance(cells, frame.Framed):
        raise ParameterError("must be a grid, or a length in metres", place="cells", got=cells)
    values = {**({} if model is None else {"model": model}), **parameters}
    shape = shape_of(footprint)
    if robot is not None:
        step = step_for("cost", robot if shape is None else robot.with_shape(shape), values)
    else:
        step = make_step("cost", values)
    shaped = step.stage.robot
    if shape is not None and robot is None:
        rule = "costs of this model do not depend on the robot's shape"
        if shaped is None or shaped.replaces in parameters:
            rule = f"cannot be given together with {shaped.replaces}" if shaped else rule
            raise ParameterError(rule, place="footprint")
        step = make_step("cost", {**values, **shaped.parameters(shape)})
    if (curve := step.curve_on(cells)) is None:
        raise step.no_curve()
    return curve
