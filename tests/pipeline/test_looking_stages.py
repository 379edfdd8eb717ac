"""Stages that only look at a grid: which grids they accept, and which get a robot's shape."""

import warnings

import pytest

from mapdeal import Footprint, MapdealWarning, OccupancyGrid, ParameterError, esdf, layered_cost
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.step import make_step
from mapdeal.stages.esdf import field_view

MAP = OccupancyGrid([[0, 100, 0], [0, -1, 0]], 0.25, (1.5, -2.0, 0.4))
ROUND = Footprint.circle(0.2)


def recipe(tmp_path, stages, **options):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n" + "".join(f"  - {stage}\n" for stage in stages.split()))
    return {step.name: step for step in load_recipe(str(path), **options).steps}


@pytest.mark.parametrize(("name", "grid", "message"), [
    *[(name, layered_cost(MAP), "contains costs") for name in ("inflate", "esdf", "cost")],
    ("inflate", field_view(esdf(MAP)), "view of a distance field"),
])  # fmt: skip
def test_a_stage_that_takes_no_costs_or_views_gets_the_map_in_them(name, grid, message):
    with pytest.warns(MapdealWarning, match=message):
        assert type(make_step(name, {}).input_of(grid)) is OccupancyGrid


@pytest.mark.parametrize(
    "setting", ["reach.radius=0.4", "reach.footprint=[[0.4,0],[-0.2,0.3],[-0.2,-0.3]]"]
)
def test_a_radius_that_counts_twice_is_warned_of_after_inflation_alone(tmp_path, setting):
    with pytest.warns(MapdealWarning, match=r"reach: radius (0.4|0.178885) m comes on top of"):
        recipe(tmp_path, "inflate reach", changes=[setting])
    inscribed = "cost.inscribed_radius=0.3"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recipe(tmp_path, "reach inflate", changes=[setting])
        recipe(tmp_path, "cost reach", changes=[setting, inscribed])
    with pytest.warns(MapdealWarning, match="cost: inscribed_radius 0.3 m comes on top of stage i"):
        recipe(tmp_path, "reach inflate cost", changes=[inscribed])


def test_only_a_stage_that_takes_costs_can_follow_cost(tmp_path):
    assert list(recipe(tmp_path, "cost reach potential")) == ["cost", "reach", "potential"]
    for stages in ("cost esdf", "cost reach esdf", "cost potential inflate"):
        with pytest.raises(ParameterError, match=rf"{stages.split()[-1]}: cannot follow cost"):
            recipe(tmp_path, stages)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("stages", "expected"), [
    ("reach inflate esdf cost", {"reach": ROUND, "inflate": ROUND, "cost": 0.0}),
    ("reach esdf cost", {"reach": ROUND, "cost": 0.2}),
    ("reach", {"reach": ROUND}),
    ("inflate reach", {"inflate": ROUND, "reach": None}),  # no shape on top
    ("cost reach", {"cost": 0.2, "reach": ROUND}),  # costs hold obstacles, not the shape
])  # fmt: skip
def test_a_shape_goes_to_stages_that_look_and_to_the_first_that_hands_on(
    tmp_path, stages, expected
):
    steps = recipe(tmp_path, stages, footprint=ROUND)
    for name, value in expected.items():
        key = "inscribed_radius" if name == "cost" else "footprint"
        assert steps[name].parameters[key] == value
