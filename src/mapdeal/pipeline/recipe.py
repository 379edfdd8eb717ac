"""Recipes: which stages run, in which order, with which parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.formats.endings import YAML
from mapdeal.formats.source import exists, is_folder
from mapdeal.formats.yaml_text import parse_value
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.display import OneLine
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.recipe_file import Draft, Given, read_recipe_file
from mapdeal.pipeline.robot import draft_for, put_map_rules, put_value
from mapdeal.pipeline.step import Step, make_step
from mapdeal.records import dataclass
from mapdeal.robot.parameters import RobotParameters
from mapdeal.stages.catalogue import STAGE_NAMES, STAGES, models_of
from mapdeal.stages.definition import Stage
from mapdeal.stages.parameters import unknown_name

DEFAULT = "default"

BUILT_IN = (DEFAULT, "nav2", "local", "arena", "design-real", "design-sim", "design-local")


@dataclass(frozen=True, repr=False)
class Recipe(OneLine):
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
        return any(step.is_smaller for step in self.steps)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings from loading the parameters, which manifests record."""
        of_robot = () if self.robot is None else self.robot.remarks
        return (*of_robot, *_remarks_on(self.steps))

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that the robot's parameters were read from."""
        return () if self.robot is None else self.robot.paths

    def _told(self) -> Iterator[str]:
        yield " -> ".join(" ".join(filter(None, (s.name, s.stage.model))) for s in self.steps)

    def described(self) -> list[dict[str, Any]]:
        """Return the steps with all their parameters, as values that JSON or YAML can represent."""
        return [one.described() for one in self.steps]


def load_recipe(
    name: str | None,
    *,
    sim: bool = False,
    footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
    settings: Sequence[str] = (),
    changes: Mapping[str, object] | None = None,
    prefix: str = "--",
) -> Recipe:
    """Return a recipe, adapted and checked.

    Parameters
    ----------
    name : str, optional
        One of `BUILT_IN`, or the path of a YAML file; by default the costmap of the robot, or
        ``default`` without a robot.
    sim : bool
        Whether the map is of a simulated world: inserts ``active`` at the start if the recipe has
        none, and makes the field count unknown cells as occupied.
    footprint : Footprint, optional
        The robot's shape: sets the radius of inflate, or the radii of cost if nothing is inflated.
    robot : RobotParameters, optional
        The robot's own parameters. A named recipe takes only the shape from them; its stages that
        pass nothing on to later ones also read the map as the robot's static layer does.
    settings : sequence of str
        Settings ``stage.parameter=value``, which override everything else.
    changes : mapping of str to object, optional
        Settings as values by ``stage.parameter``.
    prefix : str
        Prefix of the options ``recipe`` and ``set`` in error messages.

    Raises
    ------
    ParameterError
        If the recipe is malformed or a parameter is not allowed.
    FileAccessError
        If the recipe's file cannot be read.

    Warns
    -----
    MapdealWarning
        If the robot's radius would count twice.
    """
    if name == "":
        raise ParameterError("must not be empty", source=f"{prefix}recipe")
    if robot is not None:
        robot = robot if footprint is None else robot.with_shape(footprint)
        footprint = robot.footprint
    if robot is not None and name is None:
        draft, name, footprint = draft_for(robot), "of the robot", None
    else:
        name = DEFAULT if name is None else name
        draft = _read_draft(name)
        if robot is not None:
            put_map_rules(draft, robot)
    if sim:
        _adapt_to_sim(draft)
    if footprint is not None:
        round_one = None if robot is None or robot.robot_radius is None else robot.inscribed_radius
        seen = footprint if round_one is None else Footprint.circle(round_one)
        _adapt_to_footprint(draft, footprint, seen, name)
    for setting in settings:
        _apply_setting(draft, setting, name, f"{prefix}set")
    for target, given in (changes or {}).items():
        _apply_change(draft, target, given, name, "changes")
    steps = tuple(_made(stage, given) for stage, given in draft)
    for text in _remarks_on(steps):
        emit_warning(text, stacklevel=2)
    return Recipe(steps, robot)


def _made(stage: str, given: Given) -> Step:
    try:
        return make_step(stage, given)
    except ParameterError as error:
        raise given.located(error, stage) from None


@contextmanager
def _recipes() -> Iterator[Path]:
    folder = Path(__file__).with_name("recipes")
    if is_folder(folder):
        yield folder
        return
    from importlib import resources  # slow to import; the package lies in an archive

    with resources.as_file(resources.files("mapdeal.pipeline") / "recipes") as unpacked:
        yield unpacked


def _read_draft(name: str) -> Draft:
    if name in BUILT_IN:
        with _recipes() as folder:
            draft = read_recipe_file(folder / f"{name}.yaml", name)
        return [(stage, Given(given)) for stage, given in draft]
    path = Path(name)
    if path.suffix not in YAML and not exists(path):
        raise unknown_name("recipe", name, BUILT_IN)
    return read_recipe_file(path, name)


def _find(draft: Draft, stage: str) -> Given | None:
    return next((given for done, given in draft if done == stage), None)


def _stage_in(draft_item: tuple[str, Mapping[str, object]]) -> Stage:
    """Return the stage of an item, in the model that it asks for; an unknown one fails later."""
    name, given = draft_item
    models = models_of(name)
    model = given.get("model")
    known = models.get(model) if isinstance(model, str) else None
    return known or next(iter(models.values()))


def _adapt_to_sim(draft: Draft) -> None:
    for stage in reversed(STAGES):
        rule = stage.in_simulation
        given = _find(draft, stage.name)
        if rule is not None and given is None and rule.is_added:
            given = Given()
            draft.insert(0, (stage.name, given))
        if rule is not None and given is not None:
            given.put(rule.parameters)


def _adapt_to_footprint(draft: Draft, footprint: Footprint, seen: Footprint, name: str) -> None:
    """Apply the robot's shape to the first stage that needs it, and to those that only look."""
    # These are the ones that hand nothing on. In what a stage has made with the shape they would
    # count it twice; only costs tell obstacles from what is around them. What they are given,
    # `seen`, is of a robot that its own files say is round a circle, as its planner has it.
    shaped: Stage | None = None
    grown, is_used = False, False
    for item in draft:
        stage = _stage_in(item)
        if stage.robot is None or grown or (stage.hands_on and shaped is not None):
            continue
        item[1].pop(stage.robot.replaces, None)
        item[1].put(stage.robot.parameters(footprint if stage.hands_on else seen))
        is_used = True
        if stage.hands_on:
            shaped, grown = stage, stage.makes is not Costmap
    if not is_used:
        rule = "the recipe has no stage that uses a robot's shape"
        raise ParameterError(rule, source=name)


def _apply_setting(draft: Draft, setting: str, name: str, option: str) -> None:
    target, equals, value = setting.partition("=")
    if not (equals and all(target.strip().partition("."))):
        rule = "must look like stage.parameter=value"
        hint = _hint_for(draft, target) if equals else None
        raise ParameterError(rule, source=option, got=setting, hint=hint)
    _apply_change(draft, target.strip(), _value_of(target, value, option), name, option, setting)


def _value_of(target: str, text: str, option: str) -> object:
    """Return the value that a setting asks for: text, or of parameters that need it YAML."""
    stage, _, parameter = target.strip().partition(".")
    known = [one.parameters.get(parameter.replace("-", "_")) for one in models_of(stage).values()]
    if not any(one is not None and one.is_yaml for one in known):
        return text.strip()
    try:
        return parse_value(text, option)
    except MalformedInputError as error:
        error.source = error.place = None
        raise ParameterError(str(error), source=option, place=target.strip()) from None


def _apply_change(
    draft: Draft, target: str, value: object, name: str, option: str, setting: str | None = None
) -> None:
    """Set ``stage.parameter`` to a value; errors show the setting that asks for it."""
    setting = setting or target
    stage, dot, parameter = str(target).partition(".")
    if not (dot and stage and parameter):
        rule = "must look like {'stage.parameter': value}"
        raise ParameterError(rule, source=option, got=target, hint=_hint_for(draft, target))
    given = _find(draft, stage)
    if given is None:
        if not models_of(stage):
            raise unknown_name("stage", stage, STAGE_NAMES, place=option)
        rule = f"recipe {name} has no stage {stage}"
        hint = f"its stages are {', '.join(done for done, _ in draft)}"
        raise ParameterError(rule, source=option, got=setting, hint=hint)
    parameter = parameter.replace("-", "_")
    for by, other in _stage_in((stage, given)).in_place_of.items():  # one takes the other's place
        if parameter in (by, other.parameter):
            given.pop(by, None)
            given.pop(other.parameter, None)
    put_value(stage, given, parameter, value, option)


def _hint_for(draft: Draft, target: object) -> str | None:
    """Return which parameters of the recipe a name without a stage may mean."""
    asked = str(target).strip().replace("-", "_")
    found = [f"{one[0]}.{asked}" for one in draft if asked in _stage_in(one).parameters]
    return f"did you mean {' or '.join(found)}?" if found else None


def _remarks_on(steps: Sequence[Step]) -> Iterator[str]:
    """Yield a text where the robot's radius counts in a stage, and once more in one after it."""
    before: Step | None = None
    for one in steps:
        found = _radius_in(one)
        if found is None:
            continue
        name, radius = found
        if before is None:
            before = one if one.stage.hands_on else None
        elif radius > 0 and not (before.stage.makes is Costmap and Costmap in one.stage.takes):
            yield (
                f"{one.name}: {name} {radius:g} m comes on top of stage {before.name} "
                "before it, so the robot's radius counts twice"
            )


def _radius_in(step: Step) -> tuple[str, float] | None:
    """Return which radius of a robot a step holds, and how long it is; None if it has none."""
    robot, radius_in = step.stage.robot, step.stage.radius_in
    if robot is None:
        return None if radius_in is None else radius_in(step.parameters)
    radius = step.parameters[robot.replaces]
    shapes = [step.parameters[name] for name in robot.sets]
    for name, shape in zip(robot.sets, shapes, strict=True):
        if not radius and isinstance(shape, Footprint):
            return name, shape.circumscribed_radius
    return robot.replaces, radius
