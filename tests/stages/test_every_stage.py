"""What holds for every stage."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import cells
from mapdeal import MalformedInputError, OccupancyGrid, ParameterError
from mapdeal.command import parameters_of
from mapdeal.pipeline.step import grid_of, make_step
from mapdeal.stages import catalogue

STAGES = {" ".join(filter(None, (stage.name, stage.model))): stage for stage in catalogue.STAGES}
NEEDED = {
    "window": {"size": (1.0, 0.5), "corner": (0.0, 0.0)},
    "shift": {"origin": (0.25, 0.0)},
    "rotate": {"yaw": np.pi / 2},
    "rescale": {"resolution": 0.125},
}
"""Parameters of stages that cannot do without."""
MAPS = {
    "one free cell": ".",
    "one occupied cell": "#",
    "a row": "..#.?.+",
    "a column": ".\n#\n?\n.",
    "all free": "....\n....\n....",
    "all occupied": "####\n####",
    "all unknown": "???\n???",
    "obstacle in the last corner": "...#\n....",
}
pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def applied(stage, grid):
    model = {"model": stage.model} if stage.model else {}
    step = make_step(stage.name, {**model, **NEEDED.get(stage.name, {})})
    return grid_of(step.result_of(grid, None))


def _layers(grid):
    return {name: getattr(grid, name) for name in grid.layer_names}


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
@pytest.mark.parametrize("drawing", MAPS.values(), ids=MAPS)
def test_input_is_untouched_output_frozen_and_the_same_again(stage, drawing):
    occupancy = cells(drawing)
    before = occupancy.copy()
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    nothing = {"active": (-1,), "reach": (-1, 100)}.get(stage.name, ())  # to work on
    if np.isin(occupancy, nothing).all():
        with pytest.raises(MalformedInputError):
            applied(stage, grid)
        return
    first, second = applied(stage, grid), applied(stage, grid)
    assert np.array_equal(occupancy, before)
    assert first.resolution == (0.125 if stage.name == "rescale" else 0.25)
    for name, layer in _layers(first).items():
        assert not layer.flags.writeable
        assert np.array_equal(layer, getattr(second, name))
    if stage.name != "active" and not stage.moves:
        assert (first.shape, first.origin) == (grid.shape, grid.origin)


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
def test_a_bare_array_is_refused_with_what_to_pass_and_a_view_where_fields_are_meant(stage):
    with pytest.raises(ParameterError, match="OccupancyGrid"):
        applied(stage, np.zeros((2, 3), np.int8))
    if mapdeal.DistanceField in stage.takes and mapdeal.FieldView not in stage.takes:
        with pytest.raises(ParameterError, match="view of a distance field"):
            stage.function(mapdeal.field_view(mapdeal.esdf(OccupancyGrid([[100, 0, 0]], 0.25))))


@pytest.mark.parametrize("stage", [s for s in STAGES.values() if not s.edits], ids=lambda s: s.name)
def test_grids_that_a_stage_does_not_take_are_refused(stage):
    grid = OccupancyGrid([[100, 0, 0]], 0.25)
    field = mapdeal.esdf(grid)
    grids = [field, mapdeal.ring_cost(grid), mapdeal.potential(grid), mapdeal.reach(grid), 5]
    for refused in (source for source in grids if not isinstance(source, stage.takes)):
        with pytest.raises(ParameterError, match=f"takes a grid: .*got '{type(refused).__name__}'"):
            stage.function(refused)


def test_every_stage_of_the_folder_is_listed():
    folder = Path(catalogue.__file__).parent
    in_folder = {
        p.stem
        for p in folder.glob("*.py")
        if re.search(r"^@(command\.)?(stage|cost_model)\(", p.read_text(), re.MULTILINE)
    }
    listed = {stage.function.__module__.rpartition(".")[2] for stage in catalogue.STAGES}
    assert in_folder == listed


@pytest.mark.parametrize("stage", [stage for stage in catalogue.STAGES if stage.edits],
                         ids=lambda stage: stage.name)  # fmt: skip
def test_what_a_stage_needs_is_named_and_described_as_it_is_read(stage):
    step = make_step(stage.name, NEEDED.get(stage.name, {}))
    ((name, values),) = step.described().items()
    assert make_step(name, json.loads(json.dumps(values))) == step
    if stage.name in NEEDED:
        with pytest.raises(ParameterError, match=rf"{name}\.[\w, ]+: .*required"):
            make_step(name, {})


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [("goal", "1.5,-2", (1.5, -2.0)), ("goal", "none", None), ("goal", None, None)],
)
def test_only_optional_parameters_accept_none(name, text, value):
    parameters = parameters_of(mapdeal.potential)
    assert parameters[name].accept(text) == value
    with pytest.raises(ParameterError, match="repulsive_cap"):
        parameters["repulsive_cap"].accept("none")
