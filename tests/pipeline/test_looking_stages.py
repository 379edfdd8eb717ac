"""Stages that only look at a grid: which grids they accept, and which get a robot's shape."""

import warnings

import numpy as np
import pytest

import made_up_stages
from mapdeal import Footprint, MapdealWarning, OccupancyGrid, ParameterError, esdf, layered_cost
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.step import make_step
from mapdeal.stages.esdf import field_view

MAP = OccupancyGrid([[0, 100, 0], [0, -1, 0]], 0.25, (1.5, -2.0, 0.4))
ROUND = Footprint.circle(0.2)


@pytest.fixture(autouse=True)
def visit(monkeypatch):
    """The stage ``visit``, listed; returns the grids that it was given."""
    made_up_stages.list_visit(monkeypatch)
    made_up_stages.visited.clear()
    return made_up_stages.visited


def recipe(tmp_path, stages, **options):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n" + "".join(f"  - {stage}\n" for stage in stages.split()))
    return {step.name: step for step in load_recipe(str(path), **options).steps}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "grid", [MAP, esdf(MAP), layered_cost(MAP), field_view(esdf(MAP))],
    ids=["map", "field", "costs", "view"],
)  # fmt: skip
def test_a_stage_passes_the_parameters_of_its_function(visit, grid):
    make_step("visit", {}).apply(grid, None)
    assert visit == [grid]


@pytest.mark.parametrize(("name", "grid", "message"), [
    *[(name, layered_cost(MAP), "contains costs") for name in ("inflate", "esdf", "cost")],
    ("inflate", field_view(esdf(MAP)), "view of a distance field"),
])  # fmt: skip
def test_a_stage_that_takes_no_costs_or_views_gets_the_map_in_them(name, grid, message):
    with pytest.warns(MapdealWarning, match=message):
        assert type(make_step(name, {}).input_of(grid)) is OccupancyGrid


@pytest.mark.parametrize(
    "setting", ["visit.radius=0.4", "visit.footprint=[[0.4,0],[-0.2,0.3],[-0.2,-0.3]]"]
)
def test_a_radius_that_counts_twice_is_warned_of_after_inflation_alone(tmp_path, setting):
    with pytest.warns(MapdealWarning, match=r"visit: (radius|footprint) 0.4 m comes on top of"):
        recipe(tmp_path, "inflate visit", changes=[setting])
    inscribed = "cost.inscribed_radius=0.3"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recipe(tmp_path, "visit inflate", changes=[setting])
        recipe(tmp_path, "cost visit", changes=[setting, inscribed])
    with pytest.warns(MapdealWarning, match="cost: inscribed_radius 0.3 m comes on top of stage i"):
        recipe(tmp_path, "visit inflate cost", changes=[inscribed])


def test_only_a_stage_that_takes_costs_can_follow_cost(tmp_path, visit):
    steps = recipe(tmp_path, "cost visit")
    grid = steps["cost"].apply(MAP, None)
    steps["visit"].apply(grid, None)
    np.testing.assert_array_equal(visit[-1].cost, grid.cost)
    for stages in ("cost esdf", "cost visit esdf", "esdf cost potential"):
        with pytest.raises(ParameterError, match=rf"{stages.split()[-1]}: cannot follow cost"):
            recipe(tmp_path, stages)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("stages", "expected"), [
    ("visit inflate esdf cost", {"visit": ROUND, "inflate": ROUND, "cost": 0.0}),
    ("visit esdf cost", {"visit": ROUND, "cost": 0.2}),
    ("visit", {"visit": ROUND}),
    ("inflate visit", {"inflate": ROUND, "visit": None}),  # no shape on top
    ("cost visit", {"cost": 0.2, "visit": ROUND}),  # costs hold obstacles, not the shape
])  # fmt: skip
def test_a_shape_goes_to_stages_that_look_and_to_the_first_that_hands_on(
    tmp_path, stages, expected
):
    steps = recipe(tmp_path, stages, footprint=ROUND)
    for name, value in expected.items():
        key = "inscribed_radius" if name == "cost" else "footprint"
        assert steps[name].parameters[key] == value
