"""The stages that recipes and commands know. A new stage is one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from mapdeal.errors import MapdealError, ParameterError
from mapdeal.formats.maps import as_occupancy
from mapdeal.formats.npz import AnyGrid, Grid
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.large import LargeCosts, LargeField, LargeGrid, LargeMap
from mapdeal.stages.active import active_region
from mapdeal.stages.esdf import esdf, field_view
from mapdeal.stages.exponential_cost import exponential_cost
from mapdeal.stages.inflate import inflate
from mapdeal.stages.large import (
    large_active_region,
    large_esdf,
    large_exponential_cost,
    large_inflate,
    large_ring_cost,
    large_threshold_cost,
)
from mapdeal.stages.parameters import accept_parameters, parameters_of, unknown_name
from mapdeal.stages.potential import potential
from mapdeal.stages.ring_cost import ring_cost
from mapdeal.stages.threshold_cost import threshold_cost

COST_MODELS: dict[str, Callable[..., Costmap]] = {
    "exponential": exponential_cost,
    "threshold": threshold_cost,
    "rings": ring_cost,
}
LARGE_COST_MODELS: dict[str, Callable[..., LargeCosts]] = {
    "exponential": large_exponential_cost,
    "threshold": large_threshold_cost,
    "rings": large_ring_cost,
}
DEFAULT_MODEL = "exponential"


@dataclass(frozen=True)
class Step:
    """One stage of a recipe with all its parameters, checked.

    Parameters
    ----------
    name : str
        The stage, one of `STAGES`.
    parameters : mapping
        Every parameter of the stage's function.
    view : mapping
        For esdf, the parameters of its 0..100 view.
    model : str, optional
        For cost, the model.
    """

    name: str
    parameters: Mapping[str, Any]
    view: Mapping[str, Any]
    model: str | None = None

    @overload
    def apply(self, grid: Grid, source: Path) -> Grid: ...

    @overload
    def apply(self, grid: AnyGrid, source: Path) -> AnyGrid: ...

    def apply(self, grid: AnyGrid, source: Path) -> AnyGrid:
        """Return what the stage makes of `grid`; errors name the file it came from."""
        try:
            return self._apply(grid)
        except MapdealError as error:
            raise error.found_in(source) from None

    def _apply(self, grid: AnyGrid) -> AnyGrid:
        if isinstance(grid, LargeGrid):
            return self._apply_to_large(grid)
        if self.name == "active":
            return active_region(as_occupancy(grid), **self.parameters)
        if self.name == "inflate":
            return inflate(as_occupancy(grid), **self.parameters)
        if self.name == "esdf":
            return esdf(as_occupancy(grid), **self.parameters)
        source = grid if isinstance(grid, DistanceField) else as_occupancy(grid)
        if self.name == "potential":
            return potential(source, **self.parameters)
        return COST_MODELS[self.model or DEFAULT_MODEL](source, **self.parameters)

    def _apply_to_large(self, grid: LargeGrid) -> LargeGrid:
        if self.name == "potential" or isinstance(grid, LargeCosts):
            raise ParameterError("needs a map that fits into memory", place=self.name)
        if self.name == "cost":
            return LARGE_COST_MODELS[self.model or DEFAULT_MODEL](grid, **self.parameters)
        map_ = grid.grid if isinstance(grid, LargeField) else grid
        return _LARGE_FUNCTIONS[self.name](map_, **self.parameters)

    @property
    def hands_on(self) -> bool:
        """Whether the next stage works on the result; after a potential, on what that was of."""
        return self.name != "potential"

    def described(self) -> dict[str, Any]:
        """Return stage, model and parameters as JSON can hold them."""
        model = {"model": self.model} if self.model else {}
        values = {**model, **self.parameters, **self.view}
        return {self.name: {key: _plain(value) for key, value in values.items()}}


STAGES: tuple[str, ...] = ("active", "inflate", "esdf", "potential", "cost")
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "active": active_region,
    "inflate": inflate,
    "esdf": esdf,
    "potential": potential,
}
_LARGE_FUNCTIONS: dict[str, Callable[..., LargeMap | LargeField]] = {
    "active": large_active_region,
    "inflate": large_inflate,
    "esdf": large_esdf,
}


def step(name: str, given: Mapping[str, object]) -> Step:
    """Return the step of a stage with the given parameters, all checked.

    Raises
    ------
    ParameterError
        If the stage or a parameter is not known, or a value not allowed.
    """
    if name not in STAGES:
        raise unknown_name("stage", name, STAGES)
    if name == "cost":
        return _cost_step(dict(given))
    view: dict[str, Any] = {}
    if name == "esdf":
        view_names = parameters_of(field_view)
        view = {key: value for key, value in given.items() if key in view_names}
        given = {key: value for key, value in given.items() if key not in view_names}
        _check_names(given, (*parameters_of(esdf), *view_names), name)
        view = accept_parameters(field_view, view, name)
    return Step(name, accept_parameters(_FUNCTIONS[name], given, name), view)


def _cost_step(given: dict[str, object]) -> Step:
    model = given.pop("model", DEFAULT_MODEL)
    if not isinstance(model, str) or model not in COST_MODELS:
        raise unknown_name("cost model", model, COST_MODELS, place="cost.model")
    function = COST_MODELS[model]
    for key in given:
        others = [m for m, f in COST_MODELS.items() if key in parameters_of(f)]
        if others and key not in parameters_of(function):
            rule = f"is a parameter of model {' and '.join(others)}, not of {model}"
            raise ParameterError(rule, place=f"cost.{key}")
    return Step("cost", accept_parameters(function, given, "cost"), {}, model)


def _check_names(given: Mapping[str, object], known: tuple[str, ...], owner: str) -> None:
    for key in given:
        if key not in known:
            raise unknown_name("parameter", key, known, place=owner)


def _plain(value: Any) -> Any:
    if hasattr(value, "vertices"):
        return [list(vertex) for vertex in value.vertices] or {"radius": value.radius}
    return list(value) if isinstance(value, tuple) else value
