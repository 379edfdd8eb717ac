"""The stage reach in recipes: where a robot's shape goes, and what its own files say of the map."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import Footprint, MapdealWarning, read_map
from mapdeal.pipeline.recipe import load_recipe

OFFICE = Path(__file__).parents[2] / "examples" / "maps" / "office.yaml"
RECIPE = "recipe.yaml"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with a recipe, where reach comes first."""
    monkeypatch.chdir(tmp_path)
    text = "stages:\n  - reach: {start: [-8, 0], radius: 0.3}\n  - inflate:\n  - esdf:\n  - cost:\n"
    Path(RECIPE).write_text(text)


@pytest.mark.filterwarnings("error")
def test_a_shape_goes_to_reach_and_to_inflate():
    shape = Footprint.circle(0.2)
    reach, inflate, _, cost = load_recipe(RECIPE, footprint=shape).steps
    assert (reach.parameters["footprint"], reach.parameters["radius"]) == (shape, 0.2)
    assert (inflate.parameters["footprint"], inflate.parameters["radius"]) == (shape, 0.2)
    assert cost.parameters["inscribed_radius"] == 0.0
    later = load_recipe(RECIPE, footprint=shape, changes=["reach.radius=0.5"]).steps[0]
    assert (later.parameters["footprint"], later.parameters["radius"]) == (None, 0.5)


def test_after_inflation_the_radius_would_count_twice():
    Path("r.yaml").write_text("stages:\n  - inflate:\n  - reach: {start: [-8, 0]}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, reach = load_recipe("r.yaml", footprint=Footprint.circle(0.2)).steps
    assert reach.parameters["radius"] == 0.0
    with pytest.warns(MapdealWarning, match=r"reach: radius 0.2 m comes on top of stage inflate"):
        load_recipe("r.yaml", changes=["reach.radius=0.2"])


def test_it_looks_at_the_lethal_cells_of_costs():
    """After cost as in front of it: inscribed costs are no obstacles.

    They cover unknown cells, so that smaller robots, and `widest`, may find other ways.
    """
    Path("r.yaml").write_text("stages:\n  - cost: {inscribed_radius: 0.3}\n  - reach\n")
    settings = ["reach.start=-8,0", "reach.radius=0.3"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recipe = load_recipe("r.yaml", changes=settings)
        made = mapdeal.apply_recipe(read_map(OFFICE), recipe)
    alone = mapdeal.reach(read_map(OFFICE), start=(-8, 0), radius=0.3)
    for name in ("reachable", "headings", "clearance"):
        np.testing.assert_array_equal(getattr(made["reach"], name), getattr(alone, name))


# A robot's own files

PARAMETERS = """
global_costmap:
  global_costmap:
    ros__parameters:
      {shape}
      footprint_padding: 0.0
      plugins: [static_layer]
      static_layer:
        plugin: "nav2_costmap_2d::StaticLayer"
      lethal_cost_threshold: {threshold}
      track_unknown_space: {track}
"""


def robot(shape="robot_radius: 0.25", threshold=100, track="true"):
    text = PARAMETERS.format(shape=shape, threshold=threshold, track=track)
    Path("p.yaml").write_text(text)
    return mapdeal.read_robot_parameters("p.yaml")


@pytest.mark.usefixtures("mapdeal_warnings")
def test_it_takes_the_map_as_the_robot_does():
    own = robot(threshold=65)
    reach = load_recipe(RECIPE, robot=own).steps[0]
    assert reach.parameters["lethal_threshold"] == own.static_layers[-1].lethal_cost_threshold == 65
    assert not reach.parameters["through_unknown"]
    # round as the planner has it, whose circle lies within the polygon of 16 corners
    assert reach.parameters["footprint"] == Footprint.circle(own.inscribed_radius)
    free = load_recipe(RECIPE, robot=robot(track="false")).steps[0].parameters
    assert (free["through_unknown"], free["lethal_threshold"]) == (True, None)
    corners = "footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]'"
    polygon = load_recipe(RECIPE, robot=robot(corners)).steps[0].parameters["footprint"]
    assert len(polygon.vertices) == 4


@pytest.mark.usefixtures("mapdeal_warnings")
def test_what_the_recipe_says_itself_stays():
    Path("r.yaml").write_text("stages:\n  - reach: {through_unknown: no, lethal_threshold: 90}\n")
    reach = load_recipe("r.yaml", robot=robot(threshold=65, track="false")).steps[0]
    assert not reach.parameters["through_unknown"]
    assert reach.parameters["lethal_threshold"] == 90
    Path("r.yaml").write_text("stages:\n  - esdf: {lethal_threshold: 65}\n  - reach\n")
    reach = load_recipe("r.yaml", robot=robot(threshold=65)).steps[1]
    assert reach.parameters["lethal_threshold"] is None  # the field knows


@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_recipe_of_a_robot_has_no_reach():
    names = [step.name for step in load_recipe(None, robot=robot()).steps]
    assert "reach" not in names
