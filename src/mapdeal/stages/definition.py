"""Definition of a stage: a function, and a record of everything else the program needs to know.

Each stage is defined in one file: a plain function whose keyword-only arguments are its parameters,
with the decorator `stage`, which takes the record. Recipes, commands, the memory plan, manifests,
titles, help texts and tables in the docs are derived from both; nothing else names a stage.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import field
from os import PathLike
from typing import Any, ParamSpec, TypeVar, get_args, get_type_hints

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.canvas import FieldGrid, on_canvas
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.costmap import CostmapLayers
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures
from mapdeal.records import dataclass
from mapdeal.stages.parameters import Parameter, parameters_of

P = ParamSpec("P")
R = TypeVar("R")

Parameters = Mapping[str, Any]

_STAGES: dict[Callable[..., Any], Stage] = {}

_ENTRY = re.compile(r"(?m)^ {4}(?P<names>[a-z_0-9, ]+) : ")
_SECTION = re.compile(r"(?m)^ {4}(?P<name>\w+)\n {4}-+\n")


@dataclass(frozen=True)
class RobotShape:
    """How a stage uses a robot's shape."""

    replaces: str
    sets: tuple[str, ...]
    parameters: Callable[[Footprint], dict[str, object]]


@dataclass(frozen=True)
class InPlaceOf:
    """How a parameter, if given, replaces another one."""

    parameter: str
    value: Callable[[Parameters], float | None]


@dataclass(frozen=True)
class InSimulation:
    """Effect of the option ``--sim`` on a stage."""

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
    model: str | None = None
    view: Callable[..., Any] | None = None
    view_passes: Callable[[Parameters], int] = lambda _: 0
    passes: int = 0
    more_memory: Callable[[Parameters], float] = lambda _: 0.0
    is_whole: Callable[[Parameters], bool] = lambda _: False
    is_smaller: Callable[[Parameters], bool] = lambda _: False
    hands_on: bool = True
    is_last: bool = False
    robot: RobotShape | None = None
    radius_in: Callable[[Parameters], tuple[str, float]] | None = None
    in_simulation: InSimulation | None = None
    in_place_of: Mapping[str, InPlaceOf] = field(default_factory=dict)
    settled: Callable[[Parameters], Parameters] = lambda _: {}
    remark: Callable[[Parameters, Figures], str | None] = lambda *_: None
    curve: Callable[[Any, Parameters], CostCurve | None] = lambda *_: None
    of_layers: Callable[[CostmapLayers], dict[str, object] | None] = lambda _: None

    def __post_init__(self) -> None:
        object.__setattr__(self, "product", self.product or self.name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the function's name; other processes look up the rest."""
        return stage_of, (self.function,)

    @functools.cached_property
    def own_parameters(self) -> dict[str, Parameter]:
        return parameters_of(self.function)

    @functools.cached_property
    def view_parameters(self) -> dict[str, Parameter]:
        return {} if self.view is None else parameters_of(self.view)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters, with those of the view last."""
        return {**self.own_parameters, **self.view_parameters}

    @functools.cached_property
    def meanings(self) -> dict[str, str]:
        """Description of each parameter, from the docstrings of function and view."""
        functions = [self.function, *([] if self.view is None else [self.view])]
        described = [meanings_of(function) for function in functions]
        return {name: text for texts in described for name, text in texts.items()}

    @functools.cached_property
    def makes(self) -> type[Any]:
        made: type[Any] | None = get_type_hints(inspect.unwrap(self.function)).get("return")
        if made is None:
            raise TypeError(f"stage {self.name}: the function must say what it returns")
        return made

    @functools.cached_property
    def takes(self) -> tuple[type[Any], ...]:
        """Types of grids that it works on directly; of other grids it receives the map."""
        function = inspect.unwrap(self.function)
        first = next(iter(inspect.signature(function).parameters))
        taken = get_type_hints(function)[first]
        return get_args(taken) or (taken,)


def stage(
    *, name: str, summary: str, title: Callable[[Parameters], str], memory: float, **more: Any
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Turn a function into a stage, with the record that `Stage` describes."""
    # Its keyword arguments are checked and converted as by `checked`. It must also be listed in
    # `mapdeal.stages.listed`.

    def made(function: Callable[P, R]) -> Callable[P, R]:
        wrapped = checked(function)
        _STAGES[wrapped] = Stage(wrapped, name, summary, title, memory, **more)
        return wrapped

    return made


def stage_of(function: Callable[..., Any]) -> Stage:
    return _STAGES[function]


def stages_among(values: Mapping[str, object]) -> tuple[Stage, ...]:
    """Return the stages whose functions are among some values, in their order."""
    found = [_STAGES[value] for value in values.values() if callable(value) and value in _STAGES]
    names = [" ".join(filter(None, (one.name, one.model))) for one in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"two stages have one name: {', '.join(sorted(twice))}")
    return tuple(found)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make `function` check and convert its keyword arguments according to its signature."""
    # If a field has numbers only in one box of cells, the function receives the box, and its result
    # is extended to the field's frame.
    known = parameters_of(function)

    @functools.wraps(function)
    def with_checks(*args: P.args, **kwargs: P.kwargs) -> R:
        accepted: dict[str, Any] = {
            name: known[name].accept(value) if name in known else value
            for name, value in kwargs.items()
        }
        if args and isinstance(args[0], np.ndarray):
            rule = "takes a grid: OccupancyGrid(array, resolution, origin)"
            raise ParameterError(rule, source=function.__name__)
        if args and isinstance(args[0], (str, PathLike)):
            raise ParameterError("takes a grid: read_map(path)", source=function.__name__)
        field: Any = args[0] if args else None
        if isinstance(field, FieldGrid) and field.region is not None:
            make: Any = function
            whole: R = on_canvas(make(field.cropped, *args[1:], **accepted), field.frame)
            return whole
        return function(*args, **accepted)

    return with_checks


def meanings_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return the description of each parameter in a numpydoc docstring, on one line each."""
    text = inspect.getdoc(function) or ""
    indented = "\n".join(f"    {line}" if line else "" for line in text.splitlines()) + "\n"
    sections = _SECTION.split(indented)
    body = next((b for n, b in zip(sections[1::2], sections[2::2], strict=True)
                 if n == "Parameters"), "")  # fmt: skip
    entries = list(_ENTRY.finditer(body))
    meanings: dict[str, str] = {}
    ends = [*(entry.start() for entry in entries[1:]), len(body)]
    for entry, end in zip(entries, ends, strict=False):
        described = body[entry.end() : end]
        meaning = " ".join(described.partition("\n")[2].split())
        for name in entry["names"].split(","):
            meanings[name.strip()] = meaning
    return meanings
