import hashlib
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from mapdeal import (
    FileAccessError,
    Footprint,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    esdf,
    read_map,
)
from mapdeal.pipeline.recipe import BUILT_IN, load_recipe

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


@pytest.mark.parametrize(
    ("name", "stages"),
    [
        ("default", ["inflate", "esdf", "cost"]),
        ("nav2", ["esdf", "cost"]),
        ("local", ["inflate", "esdf", "cost"]),
        ("arena", ["inflate", "esdf", "cost"]),
        ("design-real", ["inflate", "esdf", "cost"]),
        ("design-sim", ["active", "inflate", "esdf", "cost"]),
        ("design-local", ["inflate", "esdf", "cost"]),
    ],
)
def test_the_stages_of_the_built_in_recipes(name, stages):
    assert name in BUILT_IN
    assert list(described(name)) == stages


def test_the_recipes_of_the_design_document():
    real, sim = described("design-real"), described("design-sim")
    assert (real["inflate"]["kernel"], real["inflate"]["radius"]) == ("square", 0.5)
    assert (real["esdf"]["unknown"], sim["esdf"]["unknown"]) == ("free", "occupied")
    for recipe in (real, sim):
        assert (recipe["esdf"]["view"], recipe["cost"]["view"]) == ("per-map", "per-map")
        assert recipe["cost"]["model"] == "threshold"


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


def test_a_threshold_is_a_value_or_a_distance(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("stages: [{cost: {model: threshold, down: 30, down_distance: 1.0}}]")
    with pytest.raises(ParameterError, match=r"cost\.down: .*together with down_distance"):
        load_recipe(str(path))
    path.write_text("stages: [{cost: {model: threshold, down: none, down_distance: 1.0}}]")
    load_recipe(str(path))  # as a manifest says it


def drawn_arena():
    """An arena of 9.05 x 6 m in cells of 5 cm, with nine blocks, as of the ICRA challenges."""
    cells = np.full((120, 181), 0, np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    blocks = [
        (0, 1.0, 1.0, 0.2), (1.5, 0, 0.2, 1.0), (1.5, 3.0, 0.8, 0.2),
        (3.6, 0.94, 1.0, 0.2), (4.2, 2.7, 0.35, 0.35), (4.2, 4.3, 1.0, 0.2),
        (7.2, 1.8, 0.8, 0.2), (7.2, 4.8, 0.2, 1.0), (8.0, 4.7, 1.0, 0.2),
    ]  # fmt: skip
    for x, y, width, height in blocks:
        col, row = round(x / 0.05), round(y / 0.05)
        cells[row : row + round(height / 0.05), col : col + round(width / 0.05)] = 100
    return OccupancyGrid(cells, 0.05, (-1.0, 0.5, 0.0))


def test_the_arena_recipe_grades_an_arena_that_those_of_the_design_document_do_not():
    shares = {}
    for name in ("arena", "design-real"):
        grid = drawn_arena()
        for step in load_recipe(name).steps:
            grid = step.apply(grid, Path("arena.yaml"))
        free = drawn_arena().occupancy == 0
        shares[name] = np.mean((grid.cost[free] > 0) & (grid.cost[free] < 99))
        is_told = step.remark_on(grid.figures()) is not None
        assert is_told == (name == "design-real")
    assert shares["arena"] > 0.5
    assert shares["design-real"] == 0


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


def test_the_recipe_around_a_robot_has_a_square_kernel_and_rings():
    recipe = described("design-local")
    assert (recipe["inflate"]["kernel"], recipe["inflate"]["radius"]) == ("square", 0.3)
    assert recipe["esdf"]["unknown"] == "free"
    assert (recipe["cost"]["model"], recipe["cost"]["values"]) == ("rings", [90, 70, 50])


def test_sim_cuts_out_the_active_region_and_counts_unknown_as_occupied():
    recipe = described("default", sim=True)
    assert list(recipe) == ["active", "inflate", "esdf", "cost"]
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


@pytest.mark.parametrize(
    "shape",
    [
        SHAPE,
        Footprint.circle(0.3),
        Footprint.sixteen_gon(0.3),
        Footprint.polygon([[0.4, 0.1], [0.1, 0.3], [-0.2, -0.3]]).padded(0.01),
    ],
)
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
@pytest.mark.parametrize("name", ["default", "nav2"])
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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stages: []\n", "stages"),
        ("steps:\n  - esdf:\n", "no such key"),
        ("stages:\n  - inflat:\n", "did you mean inflate|no such stage"),
        ("stages:\n  - inflate: {radios: 1}\n", "no such parameter"),
        ("stages:\n  - inflate: {radius: wide}\n", "inflate.radius"),
        ("stages:\n  - inflate: {radius: -1}\n", "inflate.radius"),
        (
            "stages:\n  - inflate: {radius: 0.4, footprint: {radius: 0.3}}\n",
            "makes it 0.3, got 0.4",
        ),
        (
            "stages:\n  - inflate: {footprint: {radius: 0}}\n",
            "footprint.radius: must be .* above 0",
        ),
        ("stages:\n  - inflate: {footprint: {width: 1}}\n", "look like"),
        ("stages:\n  - esdf:\n  - esdf:\n", "once"),
        ("stages:\n  - cost:\n  - esdf:\n", "follow cost"),
        ("stages:\n  - cost: {model: rings, down: 4}\n", "threshold"),
        ("stages:\n  - cost: {model: ring}\n", "no such cost model"),
        ("stages:\n  - inflate: 3\n", "look like"),
        ("stages: [\n", "YAML"),
        ("- a\n", "mapping"),
    ],
)
def test_malformed_recipes_are_refused_as_usage(tmp_path, text, said):
    with pytest.raises(ParameterError, match=said):
        load_recipe(write(tmp_path, text))


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("radius=0.3", "look like"),
        ("inflate.radius", "look like"),
        ("inflat.radius=1", "no such stage"),
        ("active.margin=1", "no stage active"),
        ("inflate.radios=1", "no such parameter"),
        ("inflate.inflate_unknown=maybe", "yes or no"),
        ("esdf.lethal_threshold=101", "between 1 and 100"),
    ],
)
def test_settings_that_cannot_be_are_refused(setting, said):
    with pytest.raises(ParameterError, match=said):
        load_recipe("default", changes=[setting])


def test_names_of_recipes_that_are_none():
    with pytest.raises(ParameterError, match="no such recipe") as caught:
        load_recipe("nav")
    assert caught.value.hint == "did you mean nav2?"
    with pytest.raises(FileAccessError):
        load_recipe("missing.yaml")


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


def test_a_simulation_adds_no_second_active_region():
    assert list(described("design-sim", sim=True)) == ["active", "inflate", "esdf", "cost"]
    assert [step.name for step in load_recipe("design-sim", sim=True).steps].count("active") == 1
    assert list(described("default", sim=True)) == ["active", "inflate", "esdf", "cost"]


def test_a_parameter_of_no_model_is_unknown_and_one_of_another_is_that_model_s():
    with pytest.raises(ParameterError) as caught:
        load_recipe("default", changes=["cost.inscribed_radis=1"])
    assert "inscribed_radius" in f"{caught.value} {caught.value.hint}"
    assert "is a parameter of model" not in str(caught.value)
    with pytest.raises(ParameterError, match="is a parameter of model rings, not of exponential"):
        load_recipe("default", changes=["cost.values=1"])


@pytest.mark.parametrize(
    ("setting", "hint"),
    [
        ("inflation_radius=1", "did you mean cost.inflation_radius?"),
        ("inflation-radius = 1", "did you mean cost.inflation_radius?"),
        ("lethal_threshold=60", "did you mean esdf.lethal_threshold or cost.lethal_threshold?"),
        ("nothing=1", None),
        ("inflation_radius", None),
    ],
)
def test_a_parameter_without_its_stage_is_told_the_stages_that_have_it(setting, hint):
    with pytest.raises(ParameterError, match=r"must look like stage\.parameter=value") as caught:
        load_recipe("nav2", changes=[setting])
    assert caught.value.hint == hint
