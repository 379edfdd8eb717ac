"""The parameters of a stage, read from its function's signature.

A stage is a plain function whose keyword-only arguments are its parameters. Their names,
defaults, types and bounds are defined in the signature and nowhere else; they apply to recipes,
the command line and Python callers alike.
"""

from __future__ import annotations

import functools
import inspect
import math
import types
from collections.abc import Callable, Iterable, Mapping
from numbers import Real
from typing import Annotated, Any, Literal, Union, get_args, get_origin
from typing import get_type_hints as hints_of

from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.records import dataclass
from mapdeal.spelling import as_known, meant


@dataclass(frozen=True)
class Bound:
    """A condition on a number, in words and as a test; numbers are always finite."""

    rule: str
    holds: Callable[[Any], bool]


AT_LEAST_0 = Bound("at least 0", lambda value: value >= 0)
ABOVE_0 = Bound("above 0", lambda value: value > 0)
PERCENT = Bound("between 0 and 100", lambda value: 0 <= value <= 100)
STRENGTH = Bound("between 1e-6 and 1e6", lambda value: 1e-6 <= value <= 1e6)
LETHAL = Bound("between 1 and 100", lambda value: 1 <= value <= 100)
HEADINGS = Bound("between 4 and 255", lambda value: 4 <= value <= 255)


@dataclass(frozen=True)
class Unit:
    """Unit of a parameter."""

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
POSE = Unit("m, rad", "X,Y[,YAW]")
SQUARE_METRES = Unit("m2", "M2")


class FromRobot:
    """Mark of a parameter set by a robot's shape: recipes can set it, but there is no option."""


LethalThreshold = Annotated[int, LETHAL, OCCUPANCY]
"""Occupancy from which a cell is an obstacle."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a stage: its name, default, type, bounds and unit."""

    name: str
    default: object
    kind: Any
    optional: bool
    bounds: tuple[Bound, ...]
    unit: Unit | None = None
    from_robot: bool = False

    @property
    def is_structured(self) -> bool:
        """Whether it needs more than a line of text: recipes can set it, options cannot."""
        return self.kind in _STRUCTURED

    @property
    def is_yaml(self) -> bool:
        """Whether a text that sets it is read as YAML first: lists and mappings, not a shape."""
        return self.is_structured and self.kind is not Footprint

    @property
    def choices(self) -> tuple[str, ...]:
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def accept(self, value: object) -> Any:
        """Convert `value` to the parameter's type."""
        # Text is read as written in a recipe or a shell: ``0.3``, ``yes``, ``90,70,50``.
        if self.optional and (value is None or (isinstance(value, str) and value == "none")):
            return None
        if self.choices:
            word = as_known(value, self.choices) if isinstance(value, str) else value
            if word in self.choices:
                return word
            error = self._error(f"one of {', '.join(self.choices)}", value)
            error.hint = meant(str(value), self.choices)
            raise error
        if self.kind in _STRUCTURED:
            return _STRUCTURED[self.kind](self.name, value)
        if self.kind is bool:
            return self._accept_bool(value)
        if get_origin(self.kind) is tuple:
            values = value.strip().strip("[]").split(",") if isinstance(value, str) else value
            if not isinstance(values, Iterable) or isinstance(values, Mapping):
                raise self._error("a list of numbers", value)
            kind, *others = get_args(self.kind)
            accepted = tuple(self._accept_number(kind, item) for item in values)
            if others != [Ellipsis] and len(accepted) != 1 + len(others):
                raise self._error(f"a list of {1 + len(others)} numbers", value)
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
        number: float | None = None
        if isinstance(value, (Real, str)) and not isinstance(value, bool):  # numpy's, too
            try:
                number = float(value) if is_plain(value) else None
            except (ValueError, OverflowError):
                number = None
        what = "a whole number" if kind is int else "a finite number"
        rule = ", ".join([what, *(bound.rule for bound in self.bounds)])
        if number is None or not math.isfinite(number) or (kind is int and number % 1):
            raise self._error(rule, value)
        if not all(bound.holds(number) for bound in self.bounds):
            raise self._error(rule, value)
        return int(number) if kind is int else number

    def _error(self, rule: str, value: object) -> ParameterError:
        return ParameterError(f"must be {rule}", place=self.name, got=value)


def is_plain(value: object) -> bool:
    """Return whether a value is not text, or is text that not only Python reads as a number."""
    # Python accepts ``1_000`` and digits of all scripts.
    return not isinstance(value, str) or (value.isascii() and "_" not in value)


@functools.cache
def parameters_of(function: Callable[..., Any]) -> dict[str, Parameter]:
    """Return the parameters of a stage's function: its keyword-only arguments."""
    function = inspect.unwrap(function)
    hints = hints_of(function, include_extras=True)
    found: dict[str, Parameter] = {}
    for name, argument in inspect.signature(function).parameters.items():
        if argument.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        kind, marks = _split_annotated(hints[name])
        kind, optional = split_optional(kind)
        kind, inner_marks = _split_annotated(kind)
        marks += inner_marks
        if not _is_supported(kind):
            rule = f"{function.__name__}: a parameter cannot be of this type"
            raise TypeError(f"{rule}: {name}: {hints[name]}")
        found[name] = Parameter(
            name,
            argument.default,
            kind,
            optional,
            tuple(mark for mark in marks if isinstance(mark, Bound)),
            next((mark for mark in marks if isinstance(mark, Unit)), None),
            FromRobot in marks,
        )
    return found


def accept_parameters(
    function: Callable[..., Any], given: Mapping[str, object], owner: str
) -> dict[str, Any]:
    """Return all parameters of a stage: those given, checked, and the defaults of the rest."""
    known = parameters_of(function)
    values = {name: parameter.default for name, parameter in known.items()}
    for name, value in given.items():
        if name not in known:
            raise unknown_parameter(name, known, owner)
        try:
            values[name] = known[name].accept(value)
        except ParameterError as error:
            error.place = f"{owner}.{error.place or name}"
            raise
    return values


def unknown_parameter(name: str, known: Iterable[str], owner: str) -> ParameterError:
    error = unknown_name("parameter", name, known)
    return ParameterError(error.rule, place=f"{owner}.{name}", hint=error.hint)


def unknown_name(
    what: str, name: object, known: Iterable[str], *, place: str | None = None
) -> ParameterError:
    """Return the error for a name that is not among the `known` ones, suggesting the nearest."""
    names = list(known)
    hint = meant(str(name), names) or f"known: {', '.join(names)}"
    return ParameterError(f"no such {what}", place=place, got=name, hint=hint)


def _is_supported(kind: Any) -> bool:
    if kind in _STRUCTURED:
        return True
    if get_origin(kind) is tuple:
        return all(one in (int, float, Ellipsis) for one in get_args(kind))
    return kind in (bool, int, float) or get_origin(kind) is Literal


def split_optional(hint: Any) -> tuple[Any, bool]:
    """Return a type without None, and whether None is allowed.

    Examples
    --------
    >>> split_optional(float | None)
    (<class 'float'>, True)
    """
    if get_origin(hint) not in (Union, types.UnionType):
        return hint, False
    (kind,) = (arm for arm in get_args(hint) if arm is not type(None))
    return kind, True


def _split_annotated(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    if get_origin(hint) is Annotated:
        kind, *marks = get_args(hint)
        return kind, tuple(marks)
    return hint, ()


_RADIUS = Parameter("footprint.radius", None, float, optional=False, bounds=(ABOVE_0,))


def _footprint(_: str, value: object) -> Footprint:
    if isinstance(value, Footprint):
        return value
    if isinstance(value, str):
        return Footprint.parse(value)
    if isinstance(value, (list, tuple)):
        return Footprint.polygon(value)
    if isinstance(value, Mapping) and list(value) == ["radius"]:
        return Footprint.circle(_RADIUS.accept(value["radius"]))
    rule = "must look like [[x1, y1], [x2, y2], ...] or {radius: R}"
    raise ParameterError(rule, place="footprint", got=value)


_STRUCTURED: dict[Any, Callable[[str, object], Any]] = {Footprint: _footprint}
"""Types that are more than a line of text, and what makes them, given the parameter's name."""


def structured(kind: Any, accept: Callable[[str, object], Any]) -> None:
    """Allow parameters of a type that a function converts from YAML values."""
    _STRUCTURED[kind] = accept
