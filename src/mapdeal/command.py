"""Definitions of stages and commands: a function, and a record with all further facts.

The keyword-only arguments of the function are its parameters. Their names, defaults, types and
conditions are in its signature and their descriptions in its docstring, for the shell, Python and
recipes alike; help texts and the tables of the docs are generated from them.

A stage turns a grid into a grid and has the decorator `stage`; its record also serves recipes,
memory planning, manifests and titles. A command returns a `Result` and has the decorator `command`.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import re
import types
import typing
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence as AbcSequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from mapdeal import errors
from mapdeal.compatibility import Unpack
from mapdeal.grid import canvas, costmap, frame
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, Drawn
from mapdeal.kernels.blocks import holds_everywhere
from mapdeal.records import dataclass, field, is_dataclass, replace


@dataclass(frozen=True)
class Condition:
    """A condition on a number, in words and as a test; numbers are always finite."""

    rule: str
    holds: Callable[[Any], bool]


AT_LEAST_0 = Condition("at least 0", lambda value: value >= 0)
AT_LEAST_1 = Condition("at least 1", lambda value: value >= 1)
ABOVE_0 = Condition("above 0", lambda value: value > 0)
PERCENT = Condition("between 0 and 100", lambda value: 0 <= value <= 100)
STRENGTH = Condition("between 1e-6 and 1e6", lambda value: 1e-6 <= value <= 1e6)
LETHAL = Condition("between 1 and 100", lambda value: 1 <= value <= 100)
HEADINGS = Condition("between 4 and 255", lambda value: 4 <= value <= 255)


@dataclass(frozen=True)
class Unit:
    symbol: str
    metavar: str


METRES = Unit("m", "M")
CELLS = Unit("cells", "CELLS")
PER_METRE = Unit("1/m", "K")
REPULSION = Unit("1/m", "V")
FACTOR = Unit("", "K")
OCCUPANCY = Unit("occupancy", "N")
COST = Unit("cost", "N")
VIEW_VALUE = Unit("view", "V")
POINT = Unit("m", "X,Y")
RADIANS = Unit("rad", "A")
VALUE = Unit("", "V")
POSE = Unit("m, rad", "X,Y[,YAW]")
SQUARE_METRES = Unit("m2", "M2")


@dataclass(frozen=True)
class Words:
    """A parameter in the shell: placeholder of its value, name, parser and completion."""

    metavar: str | None = None
    read: Callable[[Any], Any] | None = None
    name: str | None = None
    is_repeated: bool = False
    streams: bool = False
    completed: Callable[..., Iterable[str]] | None = None
    short: str | None = None
    typed: Any = None
    """Type of the shell's value if it needs no conversion, such as a list of files."""


class FromRobot:
    """Mark of a parameter set by a robot's shape: recipes can set it, but there is no option."""


class OnlyInPython:
    """Mark of a parameter without an option in the shell."""


LethalThreshold = Annotated[int, LETHAL, OCCUPANCY]  # occupancy from which a cell is an obstacle


@dataclass(frozen=True)
class Parameter:
    name: str
    default: object
    kind: Any
    optional: bool
    conditions: tuple[Condition, ...]
    unit: Unit | None = None
    from_robot: bool = False
    words: Words | None = None

    @property
    def key(self) -> str:
        """Its name in the shell and in recipes."""
        return (self.words and self.words.name) or self.name

    @property
    def is_required(self) -> bool:
        return self.default is inspect.Parameter.empty

    @property
    def is_structured(self) -> bool:
        """Whether its value needs more than a line of text: only recipes can set it."""
        return self.kind in _STRUCTURED

    @property
    def is_yaml(self) -> bool:
        """Whether a text for it is parsed as YAML, as lists and mappings are, but no footprint."""
        return self.is_structured and self.kind is not Footprint

    @property
    def is_as_typed(self) -> bool:
        """Whether the shell's value needs no conversion: paths, and texts that can be repeated."""
        is_typed = self.words is not None and self.words.typed is not None
        return is_typed or self.kind in (str, Path) or get_origin(self.kind) in (list, AbcSequence)

    @property
    def choices(self) -> tuple[str, ...]:
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def accept(self, value: object) -> Any:
        # Text is read as written in a recipe or a shell: ``0.3``, ``yes``, ``90,70,50``.
        if self.optional and (value is None or (isinstance(value, str) and value == "none")):
            return None
        if self.choices:
            word = errors.as_known(value, self.choices) if isinstance(value, str) else None
            if word in self.choices:
                return word
            error = self._error(f"one of {', '.join(self.choices)}", value)
            error.hint = errors.nearest_hint(str(value), self.choices)
            raise error
        if self.kind in _STRUCTURED:
            return _STRUCTURED[self.kind](self.key, value)
        if self.kind is bool:
            return self._accept_bool(value)
        if get_origin(self.kind) is tuple:
            values = value.strip().strip("[]").split(",") if isinstance(value, str) else value
            if not isinstance(values, Iterable) or isinstance(values, Mapping):
                raise self._error("a list of numbers", value)
            kind, *more_kinds = get_args(self.kind)
            accepted = tuple(self._accept_number(kind, item) for item in values)
            if more_kinds != [Ellipsis] and len(accepted) != (count := 1 + len(more_kinds)):
                metavar = (self.words and self.words.metavar) or (self.unit and self.unit.metavar)
                raise self._error(f"{count} numbers {metavar or ''}".rstrip(), value)
            return accepted
        return self._accept_number(self.kind, value)

    def _accept_bool(self, value: object) -> bool:
        if isinstance(value, bool):
            return value
        words = {"yes": True, "true": True, "on": True, "no": False, "false": False, "off": False}
        if isinstance(value, str) and value.lower() in words:
            return words[value.lower()]
        raise self._error("yes or no", value)

    def _accept_number(self, kind: type, value: object) -> float:
        number = math.nan
        if isinstance(value, (Real, str)) and not isinstance(value, bool):  # numpy's, too
            with suppress(ValueError, OverflowError):
                number = float(value) if is_plain(value) else math.nan
        is_number = math.isfinite(number) and not (kind is int and number % 1)
        if not is_number or not all(condition.holds(number) for condition in self.conditions):
            number_kind = "a whole number" if kind is int else "a finite number"
            rules = [number_kind, *(condition.rule for condition in self.conditions)]
            raise self._error(", ".join(rules), value)
        return int(number) if kind is int else number

    def _error(self, rule: str, value: object) -> errors.ParameterError:
        return errors.ParameterError(f"must be {rule}", place=self.key, got=value)


def is_plain(value: object) -> bool:
    """Return whether a text is a number in other languages, too; True for other values."""
    # Python accepts ``1_000`` and digits of all scripts.
    return not isinstance(value, str) or (value.isascii() and "_" not in value)


@functools.cache
def parameters_of(function: Any, *, of_stage: bool = False) -> dict[str, Parameter]:
    """Return the keyword-only arguments of a function or class; of a stage all but the first."""
    function = inspect.unwrap(function)
    is_class = isinstance(function, type)
    hints = hints_of(function.__init__ if is_class else function, with_marks=True)
    found: dict[str, Parameter] = {}
    for number, (name, argument) in enumerate(inspect.signature(function).parameters.items()):
        is_named = argument.kind is argument.POSITIONAL_OR_KEYWORD and (
            is_dataclass(function) or (of_stage and number)
        )
        if argument.kind is not argument.KEYWORD_ONLY and not is_named:
            continue
        kind, marks = _split_annotated(hints[name])
        kind, optional = split_optional(kind)
        kind, inner_marks = _split_annotated(kind)
        marks += inner_marks
        if OnlyInPython in marks:
            continue
        words = _mark_in(marks, Words)
        if words is None and not _is_supported(kind):
            rule = f"{function.__name__}: a parameter cannot be of this type"
            raise TypeError(f"{rule}: {name}: {hints[name]}")
        default = argument.default
        unit = _mark_in(marks, Unit)
        of_robot = FromRobot in marks
        conditions = tuple(mark for mark in marks if isinstance(mark, Condition))
        found[name] = Parameter(name, default, kind, optional, conditions, unit, of_robot, words)
    return found


def _mark_in(marks: Iterable[Any], kind: type[Any]) -> Any:
    return next((mark for mark in marks if isinstance(mark, kind)), None)


def accept_parameters(
    known: Mapping[str, Parameter], values_by_name: Mapping[str, object], owner: str
) -> dict[str, Any]:
    """Return all parameters of a stage: the checked values, and defaults for the others."""
    values = {name: parameter.default for name, parameter in known.items()}
    for name, value in values_by_name.items():
        if name not in known:
            raise unknown_parameter(name, known, owner)
        try:
            values[name] = known[name].accept(value)
        except errors.ParameterError as error:
            error.place = f"{owner}.{error.place or name}"
            raise
    for name, parameter in known.items():
        if parameter.is_required and name not in values_by_name:
            raise errors.ParameterError("is required", place=f"{owner}.{name}")
    return values


def accepted_by(function: Callable[..., Any], values: Mapping[str, object]) -> dict[str, Any]:
    return accept_parameters(parameters_of(function), values, function.__name__)


def unknown_parameter(name: str, known: Iterable[str], owner: str) -> errors.ParameterError:
    error = unknown_name("parameter", name, known)
    return errors.ParameterError(error.rule, place=f"{owner}.{name}", hint=error.hint)


def unknown_name(
    noun: str, name: object, known: Iterable[str], *, place: str | None = None
) -> errors.ParameterError:
    names = list(known)
    hint = errors.nearest_hint(str(name), names) or f"known: {', '.join(names)}"
    return errors.ParameterError(f"no such {noun}", place=place, got=name, hint=hint)


def _is_supported(kind: Any) -> bool:
    if kind in _STRUCTURED:
        return True
    if get_origin(kind) is tuple:
        return all(part in (int, float, Ellipsis) for part in get_args(kind))
    if get_origin(kind) in (list, AbcSequence):
        return get_args(kind)[0] in (str, Path)
    return kind in (bool, int, float, str, Path) or get_origin(kind) is Literal


def split_optional(hint: Any) -> tuple[Any, bool]:
    if get_origin(hint) not in (typing.Union, types.UnionType):
        return hint, False
    arms = [arm for arm in get_args(hint) if arm is not type(None)]
    kind = arms[0] if len(arms) == 1 else typing.Union[tuple(arms)]  # noqa: UP007 - decorate of a list
    return kind, len(arms) < len(get_args(hint))


def _split_annotated(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    inner, is_optional = split_optional(hint)
    if is_optional and get_origin(inner) is Annotated and split_optional(get_args(inner)[0])[1]:
        hint = inner  # Python 3.10 adds another Optional for a default of None
    if get_origin(hint) is Annotated:
        kind, *marks = get_args(hint)
        return kind, tuple(marks)
    return hint, ()


def _footprint(_: str, value: object) -> Footprint:
    if isinstance(value, Footprint):
        return value
    if isinstance(value, str):
        return Footprint.parse(value)
    if isinstance(value, np.ndarray) and value.ndim == 2:
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return Footprint.polygon(value)
    if isinstance(value, Mapping) and list(value) == ["radius"]:
        radius = Parameter("footprint.radius", None, float, optional=False, conditions=(ABOVE_0,))
        return Footprint.circle(radius.accept(value["radius"]))
    rule = "must look like [[x1, y1], [x2, y2], ...] or {radius: R}"
    hint = _ROUND if isinstance(value, Real) else None
    raise errors.ParameterError(rule, place="footprint", got=value, hint=hint)


_STRUCTURED: dict[Any, Callable[[str, object], Any]] = {Footprint: _footprint}
"""Functions that convert values to structured types, given the parameter's name."""


def structured(kind: Any, accept: Callable[[str, object], Any]) -> None:
    """Allow parameters of a type that a function converts from YAML values."""
    _STRUCTURED[kind] = accept


P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C", bound=Callable[..., Any])
Parameters = Mapping[str, Any]
_STAGES: dict[Callable[..., Any], Stage] = {}
_ENTRY = re.compile(r"(?m)^ {4}(?P<names>[a-z_0-9, ]+) : ")
_SECTION = re.compile(r"(?m)^ {4}(?P<name>\w+)\n {4}-+\n")


@dataclass(frozen=True)
class RobotShape:
    replaces: str
    sets: tuple[str, ...]
    parameters: Callable[[Footprint], dict[str, object]]


@dataclass(frozen=True)
class InPlaceOf:
    parameter: str
    value: Callable[[Parameters], float | None]


@dataclass(frozen=True)
class InSimulation:
    parameters: Parameters
    is_added: bool = False


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage of recipes, or one model of a stage that has several."""

    function: Callable[..., Any]
    name: str
    summary: str
    title: Callable[[Parameters], str]
    memory: float
    product: str = ""
    details: str = ""
    group: str = ""
    example: str = ""  # as of `Command`; of a stage that has several models, the first has both
    model: str | None = None
    view: Callable[..., Any] | None = None
    view_passes: Callable[[Parameters], int] = lambda _: 0
    passes: int = 0
    more_memory: Callable[[Parameters], float] = lambda _: 0.0
    of_library: int = 0  # bytes of a library, in addition to those per cell
    where_it_fits: tuple[str, str, float] | None = None
    """Argument of the function that is False where memory is short, the products left out then, and
    the bytes for each cell of a run with these products."""

    cells: Callable[[Any, Parameters], Iterable[int]] | None = None
    """Yields the cells that need `memory` each, as several numbers; by default all cells."""

    edits: bool = False  # whether the output has the type of the input
    moves: Callable[[Parameters], bool] = lambda _: False  # its product may have other cells
    shows_changes: bool = False  # in the picture that its command draws
    is_whole: Callable[[Parameters], bool] = lambda _: False
    is_smaller: Callable[[Parameters], bool] = lambda _: False
    passes_output_on: bool = True  # to the next stage, which else gets the same input
    needs_costs: Callable[[Parameters], bool] = lambda _: False
    """Whether its command makes a robot's costs of a map first, if --params-file has them."""

    accepts_mask: Callable[[Parameters], bool] = lambda _: False
    """Whether it applies the keepout mask of a run itself, by its parameter `mask`."""

    is_last: bool = False
    robot: RobotShape | None = None
    radius_in: Callable[[Parameters], tuple[str, float]] | None = None
    in_simulation: InSimulation | None = None
    in_place_of: Mapping[str, InPlaceOf] = field(default_factory=dict)
    derived: Callable[[Parameters], Parameters] = lambda _: {}
    remark: Callable[[Parameters, frame.Figures], str | None] = lambda *_: None
    curve: Callable[[Any, Parameters], costmap.CostCurve | None] = lambda *_: None
    parameters_from_layers: Callable[[Any], dict[str, object] | None] = lambda _: None
    """Returns the parameters equivalent to a `CostmapLayers`, if there are any."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "product", self.product or self.name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the function's name; other processes look up the rest."""
        return stage_of, (self.function,)

    @functools.cached_property
    def own_parameters(self) -> dict[str, Parameter]:
        own = parameters_of(self.function, of_stage=True).values()
        return {parameter.key: parameter for parameter in own}

    @functools.cached_property
    def view_parameters(self) -> dict[str, Parameter]:
        return {} if self.view is None else parameters_of(self.view)

    @property
    def parameters(self) -> dict[str, Parameter]:
        return {**self.own_parameters, **self.view_parameters}

    @functools.cached_property
    def meanings(self) -> dict[str, str]:
        functions = [self.function, *([] if self.view is None else [self.view])]
        texts = {k: text for function in functions for k, text in meanings_of(function).items()}
        names = {key: parameter.name for key, parameter in self.parameters.items()}
        return {key: texts[name] for key, name in names.items() if name in texts}

    @functools.cached_property
    def returns(self) -> Any:
        if (returned := hints_of(self.function).get("return")) is None:
            raise TypeError(f"stage {self.name}: the function must say what it returns")
        return returned

    @functools.cached_property
    def product_type(self) -> type[Any]:
        """Type of its product; for a stage that edits, the type in recipes."""
        returned: type[Any] = self.returns
        return OccupancyGrid if self.edits else returned

    @functools.cached_property
    def takes(self) -> tuple[type[Any], ...]:
        """Types of grids that it accepts; other grids are converted to their map."""
        return (OccupancyGrid,) if self.edits else input_types_of(self.function)


def input_types_of(function: Callable[..., Any]) -> tuple[type[Any], ...]:
    input_type = hints_of(function)[next(iter(inspect.signature(function).parameters))]
    return get_args(input_type) or (input_type,)


@dataclass(frozen=True)
class Output:
    metavar: str
    about: str
    is_required: bool = True
    streams: bool = True
    ending: str = ".npz"  # of data on standard output
    paths: Callable[[Path], Iterable[Path]] = lambda path: [path]
    parameter: str = "output"  # parameter for functions that write themselves


class Result(Drawn):
    """Result of a command: document, lines of text, and a picture if it has one."""

    passes = True  # False makes the command end with exit code 1

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return the JSON-serialisable dict that ``--json`` prints."""

    @abstractmethod
    def lines(self) -> Iterable[str]:
        """Return the lines to print without ``--json``."""

    def _repr_parts(self) -> Iterator[str]:
        yield from map(str.strip, self.lines())

    def summary(self, _output: Path) -> Iterable[str]:
        """Return the lines to print if the result is written to a file."""
        return self.lines()

    def parts(self) -> Iterable[str]:
        """Yield the document as text, in parts as soon as they are known."""
        yield json.dumps(self.document(), indent=2)

    def details(self) -> Iterable[str]:
        """Return the additional lines of a verbose command."""
        return ()

    def closing(self) -> Iterable[str]:
        """Return the lines to print last, without ``--json``, unless the command is quiet."""
        return ()

    def found(self) -> Iterable[str]:
        """Return the lines to print below the summary even if the command is quiet."""
        return ()

    def remarks(self) -> Iterable[str]:
        """Return the remarks to print on stderr."""
        return ()

    def drawn(self, **_: Any) -> Any:
        """Return the picture that `draw_picture` draws, with its options."""
        raise errors.ParameterError("has no picture", place=type(self).__name__.lower())

    def write(self, transaction: Any, output: Path) -> None:
        """Write the output of ``-o``: by default the document."""
        transaction.write_json(output, self.document())

    def check(self) -> None:
        """Raise the error with which the command ends after it has printed the result."""


@dataclass(frozen=True, eq=False)
class Command:
    """A command: a function, and facts that only the shell needs."""

    function: Callable[..., Any]
    group: str
    example: str
    name: str = ""
    output: Output | None = None
    shared: tuple[str, ...] = ("files",)
    texts: Mapping[str, str] = field(default_factory=dict)
    also: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Functions and classes that receive keyword arguments, by the prefix of their help texts."""

    words: Mapping[str, Words] = field(default_factory=dict)
    """`Words` of parameters that are declared without them."""

    json: Literal["asked", "default", "never"] = "asked"
    makes_costs: Callable[[Mapping[str, Any]], bool] = lambda _: True

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.function.__name__)

    @property
    def help(self) -> str:
        return (inspect.getdoc(self.function) or "").partition("\n\nParameters\n")[0]

    @functools.cached_property
    def meanings(self) -> dict[str, str]:
        found = {
            name: f"{prefix}: {text[:1].lower()}{text[1:]}" if prefix else text
            for prefix, owner in self.also.items()
            for name, text in meanings_of(owner).items()
        }
        return found | meanings_of(self.function)

    @functools.cached_property
    def parameters(self) -> dict[str, Parameter]:
        found: dict[str, Parameter] = {}
        for owner in (self.function, *self.also.values()):
            found |= {k: own for k, own in parameters_of(owner).items() if k not in found}
        return found | {name: replace(found[name], words=w) for name, w in self.words.items()}

    @functools.cached_property
    def takes_output(self) -> bool:
        """Whether the function receives the output and writes it itself."""
        return self.output is not None and self.output.parameter in {*self.inputs, *self.parameters}

    @property
    def may_have_picture(self) -> bool:
        returned = hints_of(self.function).get("return")
        kinds = (kind for kind in get_args(returned) or (returned,) if isinstance(kind, type))
        results = (kind for kind in kinds if issubclass(kind, Result))
        return any(kind is Result or kind.drawn is not Result.drawn for kind in results)

    @functools.cached_property
    def takes_work(self) -> bool:
        """Whether it, or a function that it passes arguments on to, takes the work in progress."""
        owners = (self.function, *self.also.values())
        return any("work" in inspect.signature(owner).parameters for owner in owners)

    @functools.cached_property
    def inputs(self) -> dict[str, tuple[Any, Words, bool]]:
        hints = hints_of(self.function, with_marks=True)
        found = {}
        for name, argument in inspect.signature(self.function).parameters.items():
            if argument.kind is argument.POSITIONAL_OR_KEYWORD:
                kind, marks = _split_annotated(hints[name])
                words = _mark_in(marks, Words) or Words()
                found[name] = kind, words, argument.default is argument.empty
        return found


_COMMANDS: dict[Callable[..., Any], Command] = {}


def command(*, group: str, example: str, **more: Any) -> Callable[[C], C]:
    def decorate(function: C) -> C:
        _COMMANDS[function] = Command(function, group, example, **more)
        return function

    return decorate


def commands_named(name: str) -> dict[str, Command]:
    # Their module must have been imported.
    found = {own.name: own for own in _COMMANDS.values() if f"{own.name} ".startswith(f"{name} ")}
    return {full_name.removeprefix(name).strip(): own for full_name, own in found.items()}


def stage(
    *, name: str, summary: str, title: Callable[[Parameters], str], memory: float, **more: Any
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Turn a function into a stage, with the fields of `Stage`."""
    # `checked` converts its keyword arguments. `mapdeal.stages.listed` must list the stage.

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        with_checks = checked(function, is_cropped=not more.get("edits"))

        @functools.wraps(function)
        def wrapped(*args: P.args, **kwargs: P.kwargs) -> Any:
            product: Any = with_checks(*args, **kwargs)
            # Recipes and commands add the remark themselves.
            if "remark" in more and errors.is_called_by_user() and not _has_obstacle(*args[:1]):
                text = remark_on_obstacles({}, product.figures())
                if text is not None:
                    errors.emit_warning(f"{name}: {text}")
            return product

        _STAGES[wrapped] = Stage(wrapped, name, summary, title, memory, **more)
        return wrapped

    return decorate


NO_OBSTACLE = "there is no obstacle"


def _has_obstacle(grid: object = None) -> bool:
    """Return whether a grid certainly has an obstacle, which its first rows usually show."""
    occupancy = getattr(grid, "occupancy", None)
    return occupancy is not None and not holds_everywhere(occupancy, lambda row: row < OCCUPIED)


def check_one_of(parameters: Parameters, name: str, alternative: str) -> Parameters:
    values = parameters[name], parameters[alternative]
    count = sum(value is not None and value is not False for value in values)
    if count == 0:
        raise errors.ParameterError("one of the two is required", place=f"{name}, {alternative}")
    if count == 2:
        raise errors.ParameterError(f"cannot be given together with {alternative}", place=name)
    return {}


def remark_on_obstacles(_: Parameters, figures: frame.Figures) -> str | None:
    names = ("obstacles", "occupied", "lethal", "inscribed")
    counts = [figures[name] for name in names if name in figures]
    return NO_OBSTACLE if counts and not any(counts) else None


def stage_of(function: Callable[..., Any]) -> Stage:
    return _STAGES[function]


def stages_among(values: Mapping[str, object]) -> tuple[Stage, ...]:
    found = [_STAGES[value] for value in values.values() if callable(value) and value in _STAGES]
    names = [" ".join(filter(None, (record.name, record.model))) for record in found]
    if duplicates := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"two stages have one name: {', '.join(sorted(duplicates))}")
    return tuple(found)


def checked(function: Callable[P, R], *, is_cropped: bool = True) -> Callable[P, R]:
    """Wrap a function to check and convert its keyword arguments by its signature."""
    # With `is_cropped`, the function receives only the box of a field that has numbers in one box
    # of cells, and its result is extended to the field's frame.
    # evaluated on first use, since a run uses few stages
    signature = functools.cache(partial(inspect.signature, function))
    parameters = functools.cache(partial(parameters_of, function, of_stage=True))
    accepted_types = functools.cache(partial(input_types_of, function))

    @functools.wraps(function)
    def with_checks(*args: P.args, **kwargs: P.kwargs) -> Any:
        bound = _bound(function.__name__, signature(), args, kwargs)
        known = parameters()
        accepted: dict[str, Any] = {
            name: known[name].accept(value) if name in known else value
            for name, value in kwargs.items()
        }
        first, grid = next(iter(bound.arguments.items()))
        accepted.pop(first, None)
        error = partial(errors.ParameterError, source=function.__name__)
        if hint := grid_hint(grid):
            raise error(f"{first} must be a grid", got=grid, hint=hint)
        if is_cropped and not isinstance(grid, accepted_types()):
            rule = f"takes a grid: {' or '.join(kind.__name__ for kind in accepted_types())}"
            is_costs = getattr(grid, "layer_names", ())[:1] == ("cost",)
            hint = "to_occupancy() makes a map of it" if is_costs else None
            raise error(rule, got=type(grid).__name__, hint=hint)
        make: Any = function
        is_part = is_cropped and isinstance(grid, canvas.FieldGrid) and grid.region is not None
        with _types_checked(function, bound):
            product = make(grid.cropped if is_part else grid, *args[1:], **accepted)
        return canvas.on_canvas(product, grid.frame) if is_part else product

    return with_checks


def with_plain_errors(function: Callable[P, R]) -> Callable[P, R]:
    """Make wrong arguments of a public function a `ParameterError`, not a TypeError from inside."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked_call(*args: P.args, **kwargs: P.kwargs) -> R:
        bound = _bound(function.__name__, signature, args, kwargs)
        if bound.arguments.get("footprint") is not None:
            bound.arguments["footprint"] = _footprint("footprint", bound.arguments["footprint"])
        is_by_user = errors.is_called_by_user()
        for name, value in bound.arguments.items() if is_by_user else ():
            hint = hints_of(function).get(name) if isinstance(value, str) else None
            if get_origin(split_optional(_split_annotated(hint)[0])[0]) is Literal:
                _check_type(value, hint, f"{function.__name__}()", name)
        naming = errors.reworded(partial(_in_python, function)) if is_by_user else nullcontext()
        with naming, _types_checked(function, bound):
            return function(*bound.args, **bound.kwargs)

    return checked_call


@contextmanager
def _types_checked(function: Callable[..., Any], bound: inspect.BoundArguments) -> Iterator[None]:
    """Make an error from an argument of a wrong type a `ParameterError` about the argument."""
    try:
        yield
    except errors.MapdealError:
        raise
    except (TypeError, AttributeError, ValueError):
        hints, name = hints_of(function), function.__name__
        _bound(name, _with_all_names(bound.signature, hints), bound.args, bound.kwargs)
        for argument, value in bound.arguments.items():
            if bound.signature.parameters[argument].kind in _NAMED:
                _check_type(value, hints.get(argument, Any), f"{name}()", argument)
        raise


@functools.cache  # looked up late: types are slow to import
def hints_of(function: Callable[..., Any], *, with_marks: bool = False) -> dict[str, Any]:
    return get_type_hints(inspect.unwrap(function), include_extras=with_marks)


_OPTION = re.compile(r"--([a-z][a-z-]*)(?: ([A-Z]\S*|-?[xyz]\b))?")
_OF_ROBOTS = {"robot_radius": "footprint", "params_file": "robot"}  # if without the name


def _in_python(function: Callable[..., Any], text: str) -> str:
    """Return a text that names the parameters of a function in place of options."""
    if "--" not in text or "mapdeal " in text:  # which names a command
        return text
    parameters = {**_with_all_names(inspect.signature(function), hints_of(function)).parameters}
    for name, hint in hints_of(function, with_marks=True).items():
        words = _mark_in(_split_annotated(hint)[1], Words)
        if words is not None and words.name:
            parameters[words.name] = parameters[name]
    any_other = next((p for p in parameters.values() if p.kind is p.VAR_KEYWORD), None)

    def named(match: re.Match[str]) -> str:
        name = match[1].replace("-", "_")
        found = parameters.get(name) or parameters.get(_OF_ROBOTS.get(name, "")) or any_other
        if found is None:
            return match[0]
        name = name if found is any_other else found.name
        value = match[2] or ("True" if found.default is False else "")
        value = f'"{value}"' if value.islower() else value
        return f"{name}={value}" if value else name

    return _OPTION.sub(named, text).replace("footprint, footprint", "footprint")


def _with_all_names(signature: inspect.Signature, hints: Mapping[str, Any]) -> inspect.Signature:
    """Return a signature with the names of a typed dictionary of further keyword arguments."""
    parameters = []
    for parameter in signature.parameters.values():
        hint = hints.get(parameter.name)
        if parameter.kind is parameter.VAR_KEYWORD and get_origin(hint) is Unpack:
            names = get_args(hint)[0].__annotations__
            parameters += [
                inspect.Parameter(n, parameter.KEYWORD_ONLY, default=None) for n in names
            ]
        else:
            parameters.append(parameter)
    return signature.replace(parameters=parameters)


def _bound(name: str, signature: inspect.Signature, args: tuple[Any, ...],
           kwargs: Mapping[str, Any]) -> inspect.BoundArguments:  # fmt: skip
    """Return the arguments of a call by name; refuse those that do not fit the signature."""
    try:
        return signature.bind(*args, **kwargs)
    except TypeError as error:
        text = str(error)
    parameters = signature.parameters
    by_name = [p.name for p in parameters.values() if p.kind is p.KEYWORD_ONLY]
    positional = [p for p in parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    unknown, hint = [word for word in kwargs if word not in parameters], None
    if unknown:
        is_radius = unknown[0] in ("radius", "robot_radius") and "footprint" in parameters
        hint = errors.nearest_hint(unknown[0], parameters) or (_ROUND if is_radius else None)
    elif len(args) > len(positional) and by_name:
        hint = f"further arguments are named, as {by_name[0]}=..."
        if "Sequence[" in str(positional[0].annotation):
            hint = f"pass one list: {name}([a, b])"
    raise errors.ParameterError(text, source=f"{name}()", hint=hint)


_ROUND = "footprint=mapdeal.Footprint.circle(0.2) is a round robot"
_AS_GRID: dict[type[Any], str] = {
    str: "mapdeal.read_map(path) reads a map",
    np.ndarray: "mapdeal.OccupancyGrid(array, resolution, origin) is a map",
}


def grid_hint(value: object) -> str | None:
    return _AS_GRID.get(str if isinstance(value, PathLike) else type(value))


_ACCEPTED: dict[Any, Any] = {  # types of more values than the annotation states
    int: Real, float: Real, tuple: Iterable, AbcSequence: Iterable, Iterable: Iterable
}  # fmt: skip
_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def _check_type(value: object, hint: Any, function: str, name: str) -> None:
    """Refuse a value that an annotation excludes: of None, numbers, paths, sequences, grids."""
    kind, is_optional = split_optional(_split_annotated(hint)[0])
    kind = getattr(kind, "__bound__", None) or kind  # of a TypeVar
    if isinstance(kind, TypeVar) or kind in (Any, object):
        return
    error = partial(errors.ParameterError, source=function, place=name)
    if value is None and not is_optional:
        raise error("must not be None")
    if get_origin(kind) is AbcSequence and not (value is None or hasattr(value, "__len__")):
        raise error("must be a sequence", got=value)
    is_list = get_origin(kind) in (tuple, AbcSequence) and get_args(kind)[0] in (int, float)
    is_list = is_list and value is not None
    if is_list or kind == ArrayLike:
        try:
            dimensions = np.asarray(value, dtype=np.float64).ndim
        except (TypeError, ValueError):
            dimensions = 0
        if not dimensions or (is_list and dimensions > 1):
            raise error("must be a list of numbers" if is_list else "must be numbers", got=value)
    if get_origin(kind) is Literal and value is not None:
        Parameter(name, None, kind, optional=False, conditions=()).accept(value)
    kinds = get_args(kind) if get_origin(kind) in (typing.Union, types.UnionType) else (kind,)
    words = [word for arm in kinds if get_origin(arm) is Literal for word in get_args(arm)]
    arms = [get_origin(arm) or arm for arm in kinds if get_origin(arm) is not Literal]
    if value is None or value in words or not (arms and all(map(_is_checked, arms))):
        return
    items = [get_args(arm)[0] for arm in kinds if get_origin(arm) in (list, AbcSequence)]
    if items and isinstance(value, Iterable) and not isinstance(value, str):
        item_arms = [get_origin(arm) or arm for arm in get_args(items[0]) or [items[0]]]
        for item in value if {str, PathLike, Path}.issuperset(item_arms) else ():
            _check_type(item, items[0], function, name)
    if not isinstance(value, tuple(_ACCEPTED.get(arm, arm) for arm in arms)):
        hint = grid_hint(value) if any(hasattr(arm, "layer_names") for arm in arms) else None
        if name == "path" and hasattr(value, "layer_names"):
            hint = "the path comes first"
        if any(arm.__name__ == "RobotParameters" for arm in arms):
            hint = "mapdeal.read_robot_parameters reads a robot's files"
        raise error(f"must be {' or '.join(arm.__name__ for arm in arms)}", got=value, hint=hint)


def _is_checked(arm: Any) -> bool:
    is_plain_type = arm in (str, PathLike, Path, bool, type, Mapping, *_ACCEPTED)
    return isinstance(arm, type) and (is_plain_type or arm.__module__.startswith("mapdeal."))


def meanings_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return the description of each parameter in a numpydoc docstring, on one line each."""
    text = inspect.getdoc(function) or ""
    indented = "\n".join(f"    {line}" if line else "" for line in text.splitlines()) + "\n"
    sections = _SECTION.split(indented)
    bodies = dict(zip(sections[1::2], sections[2::2], strict=True))
    body = bodies.get("Parameters", "").partition("\n    **")[0]
    _, *parts = _ENTRY.split(body)
    meanings: dict[str, str] = {}
    for names, text in zip(parts[::2], parts[1::2], strict=True):
        meaning = " ".join(text.partition("\n")[2].split())
        meanings |= dict.fromkeys(map(str.strip, names.split(",")), meaning)
    return meanings
