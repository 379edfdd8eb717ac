"""Recipes: what they come to, what is wrong with a file of one, and on which line of it."""

import hashlib
import json
import pickle
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from mapdeal import Footprint, MapdealWarning, OccupancyGrid, esdf, read_map
from mapdeal.errors import ParameterError
from mapdeal.pipeline.recipe import BUILT_IN, load_recipe
from mapdeal.stages.catalogue import STAGES

SHAPE = Footprint.polygon([[0.3, 0.4], [0.3, -0.4], [-0.3, -0.4], [-0.3, 0.4]])


def described(*arguments, **options):
    return {
        k: v for step in load_recipe(*arguments, **options).described() for k, v in step.items()
    }


def write(tmp_path, text):
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    return str(path)


def test_the_default_recipe_has_the_documented_defaults():
    assert load_recipe("default").described() == [
        {"inflate": {"radius": 0.3, "footprint": None, "kernel": "disc", "lethal_threshold": 100,
                     "inflate_unknown": True}},
        {"esdf": {"unknown": "free", "convention": "fast-planner", "max_distance": None,
                  "lethal_threshold": 100, "strength": 1.0, "view": "metric", "view_range": 2.0}},
        {"cost": {"model": "exponential", "inscribed_radius": 0.0, "inflation_radius": 0.55,
                  "cost_scaling_factor": 10.0, "inflate_unknown": False,
                  "inflate_around_unknown": False, "lethal_threshold": None,
                  "trinary_costmap": True, "track_unknown_space": True,
                  "inscribed_obstacle_cost_value": None,
                  "lookup": "exact", "float32_resolution": False, "circumscribed_radius": None}},
    ]  # fmt: skip


@pytest.mark.parametrize(("name", "stages"), [
    ("default", ["inflate", "esdf", "cost"]),
    ("nav2", ["esdf", "cost"]),
    ("local", ["inflate", "esdf", "cost"]),
    ("arena", ["inflate", "esdf", "cost"]),
    ("design-real", ["inflate", "esdf", "cost"]),
    ("design-sim", ["active", "inflate", "esdf", "cost"]),
    ("design-local", ["inflate", "esdf", "cost"]),
])  # fmt: skip
def test_the_stages_of_the_built_in_recipes(name, stages):
    assert name in BUILT_IN
    assert list(described(name)) == stages
    recipe = load_recipe(name)  # and can be sent to workers
    assert pickle.loads(pickle.dumps(recipe)) == recipe  # noqa: S301 - our own


def test_the_recipes_of_the_design_document():
    real, sim = described("design-real"), described("design-sim")
    assert (real["inflate"]["kernel"], real["inflate"]["radius"]) == ("square", 0.5)
    assert (real["esdf"]["unknown"], sim["esdf"]["unknown"]) == ("free", "occupied")
    for recipe in (real, sim):
        assert (recipe["esdf"]["view"], recipe["cost"]["view"]) == ("per-map", "per-map")
        assert recipe["cost"]["model"] == "threshold"
    local = described("design-local")
    assert (local["inflate"]["kernel"], local["inflate"]["radius"]) == ("square", 0.3)
    assert local["esdf"]["unknown"] == "free"
    assert (local["cost"]["model"], local["cost"]["values"]) == ("rings", [90, 70, 50])


def test_thresholds_in_metres_take_the_place_of_values():
    arena = described("arena")["cost"]
    assert (arena["down_distance"], arena["down"]) == (1.0, None)
    assert (arena["up_distance"], arena["up"]) == (0.5, None)
    value = described("arena", changes=["cost.down=30"])["cost"]
    assert (value["down_distance"], value["down"], value["up"]) == (None, 30, None)
    metres = described("design-real", changes=["cost.view=metric", "cost.down_distance=1.5"])[
        "cost"
    ]
    assert (metres["down_distance"], metres["down"], metres["up"]) == (1.5, None, 54)


@pytest.mark.parametrize(
    "name",
    ["LihanChen2004__pb_rm_simulation/map/RMUC.yaml",
     "LihanChen2004__pb_rm_simulation/map/RMUL.yaml",
     "turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10.yaml",
     "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
     "ros-navigation__navigation2/nav2_bringup/maps/warehouse.yaml"],
)  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_arena_recipe_grades_a_fifth_near_obstacles_on_real_maps(real_maps, name):
    original = grid = read_map(real_maps / name)
    for step in load_recipe("arena").steps:
        grid = step.apply(grid, real_maps / name)
    metres = esdf(original, convention="center").distance
    near = (original.occupancy == 0) & (metres <= 2)
    assert np.mean((grid.cost[near] > 0) & (grid.cost[near] < 99)) >= 0.2


def test_sim_cuts_out_the_active_region_and_counts_unknown_as_occupied():
    recipe = described("default", sim=True)
    assert list(recipe) == ["active", "inflate", "esdf", "cost"]
    steps = load_recipe("design-sim", sim=True).steps  # which has no second one
    assert [step.name for step in steps] == ["active", "inflate", "esdf", "cost"]
    assert recipe["esdf"]["unknown"] == "occupied"


def test_settings_win_over_sim_and_shape():
    recipe = described(
        "nav2", sim=True, footprint=SHAPE,
        changes=["esdf.unknown=free", "cost.inscribed_radius=0.1", "active.margin=5e-1"],
    )  # fmt: skip
    assert recipe["esdf"]["unknown"] == "free"
    assert recipe["cost"]["inscribed_radius"] == 0.1
    assert recipe["active"]["margin"] == 0.5


def test_a_shape_goes_into_inflate_or_else_into_cost():
    inflated = described("default", footprint=SHAPE)
    assert inflated["inflate"]["footprint"] == [[0.3, 0.4], [0.3, -0.4], [-0.3, -0.4], [-0.3, 0.4]]
    assert inflated["cost"]["inscribed_radius"] == 0.0
    plain = described("nav2", footprint=SHAPE)
    assert plain["cost"]["inscribed_radius"] == pytest.approx(0.3)
    assert plain["cost"]["circumscribed_radius"] == pytest.approx(0.5)


@pytest.mark.parametrize("shape", [
    SHAPE,
    Footprint.circle(0.3),
    Footprint.sixteen_gon(0.3),
    Footprint.polygon([[0.4, 0.1], [0.1, 0.3], [-0.2, -0.3]]).padded(0.01),
])  # fmt: skip
@pytest.mark.parametrize("recipe", ["default", "nav2", "local", "design-real"])
def test_the_radius_that_is_told_is_the_one_that_acts(recipe, shape):
    """Stages without the shape, with what was recorded as the radius, make the same cells."""
    grid = OccupancyGrid(np.eye(12, 17, dtype=np.int8) * 100, 0.1, (1.5, -2.0, 0.4))
    told = load_recipe(recipe, footprint=shape)
    settings = []
    for step in told.steps:
        if step.stage.robot is not None:
            name = step.stage.robot.replaces
            settings.append(f"{step.name}.{name}={step.described()[step.name][name]!r}")
    by_radius = load_recipe(recipe, changes=settings)
    for with_shape, without in zip(told.steps, by_radius.steps, strict=True):
        assert with_shape.title == without.title
        made = [step.apply(grid, Path("m")) for step in (with_shape, without)]
        np.testing.assert_array_equal(made[0].layer, made[1].layer)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_recipe_nav2_makes_the_costs_of_nav2_bringup_s_own_parameters(real_maps):
    """The real code's costmaps of nav2_params.yaml, recorded; and a shape makes the same robot."""
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())["cases"]
    own = "params/ros-navigation__navigation2/nav2_bringup/params/nav2_params.yaml"
    cases = [case for case in recorded if case["params_files"] == [own]]
    cases = [case for case in cases if case["costmap"] == "global_costmap"]
    assert len(cases) == 3
    real = Footprint.sixteen_gon(0.22).padded(0.01)
    for case, shape in [*((case, None) for case in cases), (cases[0], real)]:
        grid = read_map(real_maps / case["map"])
        for step in load_recipe("nav2", footprint=shape).steps:
            grid = step.apply(grid, Path("m"))
        made = hashlib.sha256(np.ascontiguousarray(grid.cost).tobytes()).hexdigest()
        assert made == case["distance_transform"]["sha256"], case["id"]


def test_a_shape_gives_inflate_the_radius_that_is_recorded():
    # by hand: 0.3 and 0.4 are the sides of a triangle of 0.5; padded 0.33, 0.44 and 0.55
    assert described("default", footprint=SHAPE)["inflate"]["radius"] == pytest.approx(0.5)
    padded = Footprint.polygon([[0.3, 0.41], [0.3, -0.41], [-0.3, -0.41]]).padded(0.03)
    assert described("default", footprint=padded)["inflate"]["radius"] == pytest.approx(0.55)
    circle = described("design-real", footprint=Footprint.circle(0.25))["inflate"]
    assert (circle["radius"], circle["footprint"]) == (0.25, {"radius": 0.25})


def test_of_a_radius_and_a_shape_the_later_setting_counts():
    shape = "inflate.footprint=[[0.3, 0.4], [0.3, -0.4], [-0.3, -0.4], [-0.3, 0.4]]"
    settings = ["inflate.radius=0.2", shape]
    inflated = described("design-real", changes=settings)["inflate"]
    assert (inflated["radius"], inflated["kernel"]) == (0.5, "square")
    settings.reverse()
    inflated = described("design-real", changes=settings)["inflate"]
    assert (inflated["radius"], inflated["footprint"]) == (0.2, None)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [SHAPE, Footprint.circle(0.3), None])
@pytest.mark.parametrize("name", ["default", "nav2", "arena"])
def test_the_stages_of_a_manifest_are_a_recipe(tmp_path, name, shape):
    steps = load_recipe(name, footprint=shape).described()
    path = write(tmp_path, json.dumps({"stages": steps}))
    assert load_recipe(path).described() == steps


def test_a_radius_that_counts_twice_is_warned_of():
    with pytest.warns(MapdealWarning, match="twice"):
        load_recipe("default", changes=["cost.inscribed_radius=0.2"])
    layers = "cost.layers=[static, inflation: {inscribed_radius: 0.2}, inflation]"
    with pytest.warns(
        MapdealWarning, match=r"inscribed_radius 0.2 m comes on top of stage inflate"
    ):
        load_recipe("default", changes=["cost.model=layers", layers])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recipe("nav2")
        load_recipe("default", changes=["cost.model=layers"])


def test_a_recipe_file_in_every_way_of_writing(tmp_path):
    path = write(
        tmp_path,
        "stages:\n  - active\n  - inflate:\n  - esdf: {max_distance: none, strength: 5e-1}\n"
        "  - cost:\n      model: rings\n      values: [80, 40]\n",
    )
    recipe = described(path)
    assert list(recipe) == ["active", "inflate", "esdf", "cost"]
    assert (recipe["esdf"]["max_distance"], recipe["esdf"]["strength"]) == (None, 0.5)
    assert recipe["cost"] == {"model": "rings", "values": [80, 40], "lethal_threshold": None}


def test_the_numbers_of_recipe_nav2_are_those_of_nav2_bringup():
    assert load_recipe("nav2").described() == [
        {"esdf": {"unknown": "free", "convention": "fast-planner", "max_distance": None,
                  "lethal_threshold": 100, "strength": 1.0, "view": "metric", "view_range": 2.0}},
        {"cost": {"model": "exponential", "inscribed_radius": 0.22549849949589046,
                  "inflation_radius": 0.7, "cost_scaling_factor": 3.0, "inflate_unknown": False,
                  "inflate_around_unknown": False, "lethal_threshold": None,
                  "trinary_costmap": True, "track_unknown_space": True,
                  "inscribed_obstacle_cost_value": 99,
                  "lookup": "nav2", "float32_resolution": True, "circumscribed_radius": None}},
    ]  # fmt: skip


# In each text, the line that is at fault ends with this mark; it is a comment to YAML.
MARK = "# here"

WRONG = {
    "unknown key": ("# a recipe\nsteps: # here\n  - esdf\n", "no such key"),
    "no list": ("# a recipe\n\nstages: esdf # here\n", "a list of stages"),
    "empty list": ("stages: [] # here\n", "a list of stages"),
    "unknown stage": ("stages:\n  - esdf\n  - inflat: # here\n", "no such stage"),
    "once": ("stages:\n  - esdf\n  - esdf: # here\n", "esdf: a stage can run once"),
    "order": ("stages:\n  - cost\n  - esdf # here\n", "esdf: cannot follow cost"),
    "no mapping": ("stages:\n  - esdf\n  - inflate: 3 # here\n", "must look like"),
    "nothing": ("stages:\n  - esdf\n  - # here\n", "must look like"),
    "syntax": ("stages:\n  - inflate: {radius: 1]} # here\n", "not valid YAML"),
    "tab": ("stages:\n\t- inflate # here\n", "not valid YAML"),
    "in a merged mapping": (
        "stages:\n  - inflate: &a\n      radius: 0.3 # here\n  - esdf:\n      <<: *a\n",
        "esdf.radius: no such parameter",
    ),
}
# of the stage that a line is of
WRONG |= {
    line: (f"stages:\n  - active\n  - {stage}:\n      {line} # here\n", rule)
    for stage, line, rule in [
        ("inflate", "kernel: disc\n      radios: 1", "inflate.radios: no such parameter"),
        ("cost", "model: rings\n      down: 4", "cost.down: is a parameter of model"),
        ("cost", "model: rings\n      values: [80, -5]", "cost.values: "),
        ("cost", "model: threshold\n      down_distance: 1.0\n      down: 3",
         "cannot be given together"),
        ("inflate", "radius: wide", "inflate.radius: must be a finite number"),
        ("inflate", "radius: -1",
         "inflate.radius: must be a finite number, at least 0, got -1"),
        ("inflate", "kernel: round", "inflate.kernel: must be one of"),
        ("cost", "model: ring", "cost.model: no such cost model"),
        ("inflate", "inflate_unknown: maybe", "must be yes or no"),
        ("inflate", "footprint: {radius: 0}", "inflate.footprint.radius: must be"),
        ("inflate", "footprint: {width: 1}", "look like"),
        ("inflate", "footprint: {radius: 0.3}\n      radius: 0.4",
         "inflate.radius: cannot be given together"),
        ("inflate", "radius: !!python/none 1", "tag not allowed"),
        ("inflate", "radius: 010", "must be a decimal number"),
        ("inflate", "radius: 1:30", "must be a decimal number"),
        ("esdf", "strength: 1_0", "must be a decimal number"),
    ]
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_the_line_that_is_wrong_is_named(tmp_path, name):
    text, rule = WRONG[name]
    (line,) = [k for k, one in enumerate(text.splitlines(), 1) if one.endswith(MARK)]
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(str(path))
    said = str(caught.value)
    assert said.startswith(f"{path}:{line}: "), said
    assert rule in said


def test_every_parameter_of_every_stage_has_its_line(tmp_path):
    path = tmp_path / "r.yaml"
    for stage in STAGES:
        for name in stage.parameters:
            model = f"      model: {stage.model}\n" if stage.model else ""
            path.write_text(f"stages:\n\n  - {stage.name}:\n{model}      {name}: [[a, b], {{}}]\n")
            with pytest.raises(ParameterError) as caught:
                load_recipe(str(path))
            assert str(caught.value).startswith(f"{path}:{5 if model else 4}: {stage.name}.{name}")


def test_what_an_option_has_set_names_the_option_and_not_the_file(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - inflate:\n      radius: 0.3\n      kernel: disc\n")
    with pytest.raises(ParameterError, match=r"^--set: inflate\.radius: must be"):
        load_recipe(str(path), changes=["inflate.radius=-1"])


def test_mappings_that_are_merged_give_way_to_what_stands_beside_them(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(
        "stages:\n  - inflate: &a {lethal_threshold: &n 60}\n"
        "  - esdf: &b {lethal_threshold: 70}\n"
        "  - cost:\n      <<: [{lethal_threshold: 80, model: threshold}, *b]\n"
    )
    steps = load_recipe(str(path)).steps
    assert [step.parameters["lethal_threshold"] for step in steps] == [60, 70, 80]
    path.write_text(path.read_text() + "      lethal_threshold: *n\n")
    assert load_recipe(str(path)).steps[2].parameters["lethal_threshold"] == 60
    path.write_text(path.read_text() + "      lethal_threshold: 50\n")
    with pytest.raises(ParameterError, match="appears twice, on lines 6 and 7"):
        load_recipe(str(path))


@pytest.mark.parametrize("text", [
    "- inflate: {radius: 0.3}\n- esdf\n",  # the list without its key
    "inflate: {radius: 0.3}\nesdf:\n",
    "",
    "stages:\n",
    "stages: esdf\n",
])  # fmt: skip
def test_a_recipe_of_another_shape_is_told_how_one_looks(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(str(path))
    assert str(caught.value).startswith(f"{path}:")
    example = re.search(r'"(.*)"', caught.value.hint)[1]
    path.write_text(f"stages:\n{example}\n")
    assert [step.name for step in load_recipe(str(path)).steps] == ["inflate"]
