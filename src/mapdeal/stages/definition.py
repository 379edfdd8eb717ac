"""What a stage is: a function, and a record of all that the rest of the program needs of it.

A stage stands in one file: a plain function whose keyword-only arguments are its parameters,
under the decorator `stage`, which takes the record. Recipes, commands, the memory plan, manifests,
titles, help texts and tables in the docs are made from both; nothing else names a stage.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import field
from os import PathLike
from typing import Any, ParamSpec, Protocol, TypeVar, get_args, get_type_hints

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.canvas import FieldGrid, on_canvas
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.costmap_layers import CostmapLayers
from mapdeal.grid.field import DistanceField
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


class RowsAlone(Protocol):
    """A stage whose rows are computed by workers that know the others from a summary alone.

    That is a distance field: `mapdeal.pipeline.block_jobs` says how it is done.
    """

    convention: Any

    def obstacles(self, grid: Any) -> Any:
        """Return the mask of obstacles of some rows of a map."""

    def distance(self, obstacles: Any, resolution: float, halo: Any = None) -> Any:
        """Return the distances of these rows, given what lies before and after them."""


@dataclass(frozen=True)
class RobotShape:
    """What a stage makes of a robot's shape.

    Parameters
    ----------
    replaces : str
        The parameter that a shape takes the place of: only one of the two can be given.
    sets : tuple of str
        The parameters that a shape sets.
    parameters : callable
        Returns these, given a footprint.
    """

    replaces: str
    sets: tuple[str, ...]
    parameters: Callable[[Footprint], dict[str, object]]


@dataclass(frozen=True)
class InPlaceOf:
    """What a parameter does to another one that it takes the place of where it is given.

    Parameters
    ----------
    parameter : str
        The other one.
    value : callable
        Returns, given all parameters, what the other one comes to; None if the map decides.
    """

    parameter: str
    value: Callable[[Parameters], float | None]


@dataclass(frozen=True)
class InSimulation:
    """What the option --sim does to a stage.

    Parameters
    ----------
    parameters : mapping
        Those that it sets.
    is_added : bool
        Whether the stage is put in front of recipes that have none.
    """

    parameters: Parameters
    is_added: bool = False


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage of recipes, or one model of a stage that has several.

    Parameters
    ----------
    function : callable
        Takes a map, or a map or field, and the parameters as keyword arguments.
    name : str
        What recipes and the command line call it.
    summary : str
        What its command does, a sentence for ``--help``.
    title : callable
        Returns what has been done, given all parameters, for a picture's title.
    memory : float
        Bytes for each cell of a map in memory, outputs that wait to be written included: the
        peak of whole commands on 4000 x 4000 cells, measured and rounded up.
    more_memory : callable
        Returns, given all parameters, the bytes for each cell that they take beyond that.
    product : str, optional
        What its files are called, without their endings; `name` if not given.
    details : str
        Further sentences for ``--help``.
    model : str, optional
        Which model of the stage this is, if it has several. The first one listed is the default.
    view : callable, optional
        Returns the map that is written as pixels, if the product itself is none. Its
        parameters are parameters of the stage.
    view_passes : callable
        How often the view goes through the product before it is written, given its own
        parameters.
    passes : int
        How often the stage goes through a map that is processed block by block before it returns.
    is_whole : callable
        Whether, with some parameters, the whole map must be in memory at once.
    is_smaller : callable
        Whether, with some parameters, the product may cover a part of the map alone.
    hands_on : bool
        Whether the next stage works on the product, or on what this one has worked on.
    is_last : bool
        Whether no stage can follow but those that take what it makes as it is.
    robot : RobotShape, optional
        What it makes of a robot's shape; None if that does not matter to it.
    radius_in : callable, optional
        Returns, given all parameters, which radius of a robot they hold, and how long it is, where
        that is no parameter that a shape could replace.
    in_simulation : InSimulation, optional
        What ``--sim`` does to it.
    in_place_of : mapping of str to InPlaceOf
        The parameters that take the place of others where they are given.
    settled : callable
        Returns, given all parameters, those whose values others decide, as they take effect.
    remark : callable
        Returns what there is to warn of in the product, given all parameters and its figures;
        None if there is nothing.
    curve : callable
        Returns the costs over the distance from the nearest obstacle, given the grid that the stage
        works on and its parameters; None if, with these, there is no one cost for a distance.
    rows_alone : callable, optional
        Returns, given its parameters, how workers of a cluster compute it.
    of_layers : callable
        Returns the parameters with which it does its part of what a robot's costmap layers do;
        None if it has none, or cannot.
    """

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
    rows_alone: Callable[[Parameters], RowsAlone] | None = None
    of_layers: Callable[[CostmapLayers], dict[str, object] | None] = lambda _: None

    def __post_init__(self) -> None:
        object.__setattr__(self, "product", self.product or self.name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to other processes as the function's name: the rest is known there."""
        return stage_of, (self.function,)

    @functools.cached_property
    def own_parameters(self) -> dict[str, Parameter]:
        """The parameters of the function, by name."""
        return parameters_of(self.function)

    @functools.cached_property
    def view_parameters(self) -> dict[str, Parameter]:
        """The parameters of the view, by name."""
        return {} if self.view is None else parameters_of(self.view)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters, those of the view last."""
        return {**self.own_parameters, **self.view_parameters}

    @functools.cached_property
    def meanings(self) -> dict[str, str]:
        """What each parameter means, from the docstrings of function and view."""
        functions = [self.function, *([] if self.view is None else [self.view])]
        described = [meanings_of(function) for function in functions]
        return {name: text for texts in described for name, text in texts.items()}

    @functools.cached_property
    def makes(self) -> type[Any]:
        """The type of the product."""
        made: type[Any] | None = get_type_hints(inspect.unwrap(self.function)).get("return")
        if made is None:
            raise TypeError(f"stage {self.name}: the function must say what it returns")
        return made

    @functools.cached_property
    def takes(self) -> tuple[type[Any], ...]:
        """The types of grids that it works on as they are; of others it gets the map in them."""
        function = inspect.unwrap(self.function)
        first = next(iter(inspect.signature(function).parameters))
        taken = get_type_hints(function)[first]
        return get_args(taken) or (taken,)

    @property
    def takes_field(self) -> bool:
        """Whether it works on distance fields as they are, and not on the maps they are of."""
        return DistanceField in self.takes


def stage(
    *,
    name: str,
    summary: str,
    title: Callable[[Parameters], str],
    memory: float,
    **more: Any,
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a function a stage, with the record that `Stage` describes.

    Its keyword arguments are checked and converted as those of a `checked` function. To be
    known it needs a line in `mapdeal.stages.listed`.
    """

    def made(function: Callable[P, R]) -> Callable[P, R]:
        wrapped = checked(function)
        _STAGES[wrapped] = Stage(wrapped, name, summary, title, memory, **more)
        return wrapped

    return made


def stage_of(function: Callable[..., Any]) -> Stage:
    """Return the record of a stage's function."""
    return _STAGES[function]


def stages_among(values: Mapping[str, object]) -> tuple[Stage, ...]:
    """Return the stages whose functions are among some values, in their order.

    Raises
    ------
    ValueError
        If two have the same name and model.
    """
    found = [_STAGES[value] for value in values.values() if callable(value) and value in _STAGES]
    names = [" ".join(filter(None, (one.name, one.model))) for one in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"two stages have one name: {', '.join(sorted(twice))}")
    return tuple(found)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make `function` check and convert its keyword arguments by its own signature.

    Of a field that has numbers in one box of cells alone, it is given the box; what it makes is
    put onto the field's canvas.
    """
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
    """Return what each parameter means, as the numpydoc of a function has it, on one line.

    Examples
    --------
    >>> def grow(*, radius=0.3):
    ...     '''Grow.
    ...
    ...     Parameters
    ...     ----------
    ...     radius : float
    ...         How far, metres.
    ...     '''
    >>> meanings_of(grow)
    {'radius': 'How far, metres.'}
    """
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
