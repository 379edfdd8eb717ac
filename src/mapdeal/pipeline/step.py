"""A step: one stage with all its parameters, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapdeal import command, records
from mapdeal.errors import MapdealError, ParameterError, emit_warning
from mapdeal.files.source import room, size_text
from mapdeal.grid import canvas, costmap, frame, reach
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.blocks import activity
from mapdeal.layers.stack import CostmapArea
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import as_occupancy
from mapdeal.stages import catalogue, structured


@records.dataclass(frozen=True)
class Step:
    stage: command.Stage
    parameters: Mapping[str, Any]
    view: Mapping[str, Any] = records.field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.stage.name

    @property
    def title(self) -> str:
        return self.stage.title(self.parameters)

    @property
    def memory(self) -> float:
        """Bytes for each cell of a map in memory, see `Stage`; 0 if `claim_step` does that."""
        if self.stage.cells is not None and self.moves:
            return 0.0
        return self.stage.memory + self.stage.more_memory(self.parameters)

    @property
    def moves(self) -> bool:
        return self.stage.moves(self.parameters)

    @property
    def accepts_mask(self) -> bool:
        return self.stage.accepts_mask(self.parameters)

    def apply(self, grid: Grid, source: Path | None, *, mask: OccupancyGrid | None = None) -> Grid:
        return grid_of(self.result_of(self.input_of(grid, source), source, mask=mask))

    def result_of(
        self, grid: Grid, source: Path | None, *, mask: OccupancyGrid | None = None
    ) -> Any:
        known = self.stage.own_parameters
        values = {known[key].name: value for key, value in self.parameters.items()}
        if mask is not None and self.accepts_mask:
            values["mask"] = mask
        if self.stage.where_it_fits is not None:
            argument, products, per_cell = self.stage.where_it_fits
            cells, available = grid.shape[0] * grid.shape[1], room()
            values[argument] = available is None or per_cell * cells <= available
            if not values[argument]:
                size = size_text(int(per_cell * cells))
                text = f"{self.name}: {products} are left out: with them it would take {size} of"
                emit_warning(f"{text} memory, which --max-memory can allow")
        try:
            with activity(self.name):
                return self.stage.function(grid, **values)
        except MapdealError as error:
            raise error if source is None else error.found_in(source) from None

    def curve_on(self, grid: Grid) -> costmap.CostCurve | None:
        accepted = self.input_of(grid)
        box = accepted.cropped if isinstance(accepted, canvas.FieldGrid) else accepted
        return self.stage.curve(box, self.parameters)

    def no_curve(self) -> ParameterError:
        rule = "no cost depends on the distance from an obstacle, so it has no curve"
        return ParameterError(rule, source=" ".join(filter(None, [self.name, self.stage.model])))

    def input_of(self, grid: Grid, source: Path | None = None) -> Grid:
        kind = DistanceField if isinstance(grid, FieldView) else type(grid)
        return grid if kind in self.stage.takes else as_occupancy(grid, source or "the input")

    def remark_on(self, figures: frame.Figures) -> str | None:
        text = self.stage.remark({**self.parameters, **self.view}, figures)
        return None if text is None else f"{self.name}: {text}"

    def described(self) -> dict[str, Any]:
        model = {"model": self.stage.model} if self.stage.model else {}
        values = {**model, **self.parameters, **self.view}
        return {self.name: {key: _plain(value) for key, value in values.items()}}


def grid_of(result: Any) -> Grid:
    grid: Grid = result if isinstance(result, Grid) else result.grid
    return grid


def make_step(name: str, values: Mapping[str, object]) -> Step:
    models = catalogue.models_of(name)
    if not models:
        raise command.unknown_name("stage", name, catalogue.STAGE_NAMES)
    stage, values = _in_model(name, models, dict(values))
    for key in values:
        if key not in stage.parameters:
            raise command.unknown_parameter(key, stage.parameters, name)
    own, view = ({key: value for key, value in values.items() if key in known}
                 for known in (stage.own_parameters, stage.view_parameters))  # fmt: skip
    parameters = command.accept_parameters(stage.own_parameters, own, name)
    for by, rule in stage.in_place_of.items():
        if parameters[by] is None:
            continue
        key, value = rule.parameter, rule.value(parameters)
        old = parameters[key]
        is_same = value is old if value is None or old is None else math.isclose(value, old)
        if key in own and not is_same:
            effect = "" if value is None else f", which makes it {value:g}"
            conflict = f"cannot be given together with {by}{effect}"
            raise ParameterError(conflict, place=f"{stage.name}.{key}", got=old)
        parameters[key] = value
    try:
        parameters.update(stage.derived(parameters))
    except ParameterError as error:
        error.place = ".".join(filter(None, (stage.name, error.place)))
        raise
    return Step(stage, parameters, command.accept_parameters(stage.view_parameters, view, name))


def _in_model(
    name: str, models: Mapping[str | None, command.Stage], values: dict[str, object]
) -> tuple[command.Stage, dict[str, object]]:
    if None in models:
        return models[None], values
    model = values.pop("model", next(iter(models)))
    if not isinstance(model, str) or model not in models:
        raise command.unknown_name(f"{name} model", model, map(str, models), place=f"{name}.model")
    stage = models[model]
    for key in values:
        owners = [str(m) for m, owner in models.items() if key in owner.parameters]
        if owners and key not in stage.parameters:
            rule = f"is a parameter of model {' and '.join(owners)}, not of {model}"
            raise ParameterError(rule, place=f"{name}.{key}")
    return stage, values


def _plain(value: Any) -> Any:
    if hasattr(value, "vertices"):
        return [list(vertex) for vertex in value.vertices] or {"radius": value.radius}
    if isinstance(value, CostmapArea):
        return {key: _plain(field) for key, field in records.asdict(value).items()}
    if hasattr(value, "described"):
        return value.described()
    if isinstance(value, tuple) and value and all(isinstance(item, reach.Goal) for item in value):
        return structured.described_goals(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
