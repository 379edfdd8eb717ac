import hashlib
import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, MapdealWarning, OccupancyGrid, ParameterError, esdf, read_map
from mapdeal.pipeline.recipe import BUILT_IN, load_recipe
from mapdeal.pipeline.step import make_step
from mapdeal.stages.esdf import field_view

CORNERS = [[0.3, 0.4], [0.3, -0.4], [-0.3, -0.4], [-0.3, 0.4]]
SHAPE = Footprint.polygon(CORNERS)
SHAPES = [SHAPE, Footprint.circle(0.3), Footprint.sixteen_gon(0.3),
          Footprint.polygon([[0.4, 0.1], [0.1, 0.3], [-0.2, -0.3]]).padded(0.01)]  # fmt: skip


def described(*arguments, **options):
    steps = load_recipe(*arguments, **options).described()
    return {name: values for step in steps for name, values in step.items()}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "recipe.yaml"
    return lambda text: (path.write_text(text), str(path))[1]


INFLATE = {"radius": 0.3, "footprint": None, "kernel": "disc", "lethal_threshold": 100,
           "inflate_unknown": True}  # fmt: skip
ESDF = {"unknown": "free", "convention": "fast-planner", "max_distance": None,
        "lethal_threshold": 100, "strength": 1.0, "view": "metric", "view_range": 2.0}  # fmt: skip
COST = {"model": "exponential", "inscribed_radius": 0.0, "inflation_radius": 0.55,
        "cost_scaling_factor": 10.0, "inflate_unknown": False, "inflate_around_unknown": False,
        "lethal_threshold": None, "trinary_costmap": True, "track_unknown_space": True,
        "inscribed_obstacle_cost_value": None, "lookup": "exact", "float32_resolution": False,
        "circumscribed_radius": None}  # fmt: skip
# those of nav2_bringup
NAV2 = {"inscribed_radius": 0.22549849949589046, "inflation_radius": 0.7,
        "cost_scaling_factor": 3.0, "inscribed_obstacle_cost_value": 99, "lookup": "nav2",
        "float32_resolution": True}  # fmt: skip
INFLATED, ARENA = ["inflate", "esdf", "cost"], {"down_distance": 1.0, "up_distance": 0.5}
PER_MAP = {"inflate": {"kernel": "square", "radius": 0.5},
           "cost": {"model": "threshold", "view": "per-map"}}  # fmt: skip


@pytest.mark.parametrize(("name", "stages", "values"), [
    ("default", INFLATED, {"inflate": INFLATE, "esdf": ESDF, "cost": COST}),
    ("nav2", ["esdf", "cost"], {"esdf": ESDF, "cost": {**COST, **NAV2}}),
    ("local", INFLATED, {}),
    ("arena", INFLATED, {"cost": {"down": None, "up": None, **ARENA}}),
    ("design-real", INFLATED, {**PER_MAP, "esdf": {"unknown": "free", "view": "per-map"}}),
    ("design-sim", ["active", *INFLATED],
     {**PER_MAP, "esdf": {"unknown": "occupied", "view": "per-map"}}),
    ("design-local", INFLATED, {"inflate": {"kernel": "square", "radius": 0.3},
     "esdf": {"unknown": "free"}, "cost": {"model": "rings", "values": [90, 70, 50]}}),
])  # fmt: skip
def test_the_built_in_recipes_have_the_documented_values(name, stages, values):
    assert name in BUILT_IN
    found = described(name)
    assert list(found) == stages
    assert name not in ("default", "nav2") or found == values
    for stage, expected in values.items():
        assert found[stage] == {**found[stage], **expected}
    recipe = load_recipe(name)  # and can be sent to workers
    assert pickle.loads(pickle.dumps(recipe)) == recipe  # noqa: S301 - our own


@pytest.mark.parametrize(("name", "changes", "values"), [
    ("arena", ["cost.down=30"], {"down_distance": None, "down": 30, "up": None}),
    ("design-real", ["cost.view=metric", "cost.down_distance=1.5"],
     {"down_distance": 1.5, "down": None, "up": 54}),
])  # fmt: skip
def test_thresholds_in_metres_take_the_place_of_values(name, changes, values):
    cost = described(name, changes=changes)["cost"]
    assert cost == {**cost, **values}


@pytest.mark.parametrize("name", [
    "LihanChen2004__pb_rm_simulation/map/RMUC", "LihanChen2004__pb_rm_simulation/map/RMUL",
    "turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10",
    "ros-navigation__navigation2/nav2_bringup/maps/depot",
    "ros-navigation__navigation2/nav2_bringup/maps/warehouse",
])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_arena_recipe_grades_a_fifth_near_obstacles_on_real_maps(real_maps, name):
    original = grid = read_map(real_maps / f"{name}.yaml")
    for step in load_recipe("arena").steps:
        grid = step.apply(grid, Path("m"))
    near = (original.occupancy == 0) & (esdf(original, convention="center").distance <= 2)
    assert np.mean((grid.cost[near] > 0) & (grid.cost[near] < 99)) >= 0.2


@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_recipe_nav2_makes_the_costs_of_nav2_bringup_s_own_parameters(real_maps):
    """The real code's costmaps of nav2_params.yaml, recorded; and a shape makes the same robot."""
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())["cases"]
    own = "params/ros-navigation__navigation2/nav2_bringup/params/nav2_params.yaml"
    cases = [case for case in recorded if case["params_files"] == [own]
             and case["costmap"] == "global_costmap"]  # fmt: skip
    assert len(cases) == 3
    real = Footprint.sixteen_gon(0.22).padded(0.01)
    for case, shape in [*((case, None) for case in cases), (cases[0], real)]:
        grid = read_map(real_maps / case["map"])
        for step in load_recipe("nav2", footprint=shape).steps:
            grid = step.apply(grid, Path("m"))
        found = hashlib.sha256(np.ascontiguousarray(grid.cost).tobytes()).hexdigest()
        assert found == case["distance_transform"]["sha256"], case["id"]


def test_sim_cuts_out_the_active_region_and_counts_unknown_as_occupied_unless_settings_say_else():
    recipe = described("default", sim=True)
    assert list(recipe) == list(described("design-sim", sim=True)) == ["active", *INFLATED]
    assert recipe["esdf"]["unknown"] == "occupied"
    changes = ["esdf.unknown=free", "cost.inscribed_radius=0.1", "active.margin=5e-1"]
    recipe = described("nav2", sim=True, footprint=SHAPE, changes=changes)
    assert recipe["esdf"]["unknown"] == "free"
    assert (recipe["cost"]["inscribed_radius"], recipe["active"]["margin"]) == (0.1, 0.5)


def test_a_shape_goes_into_inflate_with_its_radius_or_else_into_cost():
    # by hand: 0.3 and 0.4 are the sides of a triangle of 0.5; padded 0.33, 0.44 and 0.55
    inflated = described("default", footprint=SHAPE)
    assert inflated["inflate"] == {**INFLATE, "footprint": CORNERS, "radius": pytest.approx(0.5)}
    assert inflated["cost"]["inscribed_radius"] == 0.0
    padded = Footprint.polygon([[0.3, 0.41], [0.3, -0.41], [-0.3, -0.41]]).padded(0.03)
    assert described("default", footprint=padded)["inflate"]["radius"] == pytest.approx(0.55)
    circle = described("design-real", footprint=Footprint.circle(0.25))["inflate"]
    assert (circle["radius"], circle["footprint"]) == (0.25, {"radius": 0.25})
    plain = described("nav2", footprint=SHAPE)["cost"]
    assert (plain["inscribed_radius"], plain["circumscribed_radius"]) == pytest.approx((0.3, 0.5))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("recipe", ["default", "nav2", "local", "design-real"])
def test_the_radius_that_is_recorded_is_the_one_that_acts(recipe, shape):
    """Stages without the shape, but with the recorded radius, give the same cells."""
    grid = OccupancyGrid(np.eye(12, 17, dtype=np.int8) * 100, 0.1, (1.5, -2.0, 0.4))
    by_shape = load_recipe(recipe, footprint=shape)
    settings = []
    for step in by_shape.steps:
        if step.stage.robot is not None:
            name = step.stage.robot.replaces
            settings.append(f"{step.name}.{name}={step.described()[step.name][name]!r}")
    by_radius = load_recipe(recipe, changes=settings)
    for with_shape, without in zip(by_shape.steps, by_radius.steps, strict=True):
        assert with_shape.title == without.title
        products = [step.apply(grid, Path("m")) for step in (with_shape, without)]
        np.testing.assert_array_equal(products[0].layer, products[1].layer)


def test_of_a_radius_and_a_shape_the_later_setting_counts():
    settings = ["inflate.radius=0.2", f"inflate.footprint={CORNERS}"]
    inflated = described("design-real", changes=settings)["inflate"]
    assert (inflated["radius"], inflated["kernel"]) == (0.5, "square")
    inflated = described("design-real", changes=settings[::-1])["inflate"]
    assert (inflated["radius"], inflated["footprint"]) == (0.2, None)


@pytest.mark.parametrize("shape", [SHAPE, Footprint.circle(0.3), None])
@pytest.mark.parametrize("name", ["default", "nav2", "arena"])
def test_the_stages_of_a_manifest_are_a_recipe(file, name, shape):
    steps = load_recipe(name, footprint=shape).described()
    assert load_recipe(file(json.dumps({"stages": steps}))).described() == steps


def test_a_radius_that_counts_twice_is_warned_of():
    with pytest.warns(MapdealWarning, match="twice"):
        load_recipe("default", changes=["cost.inscribed_radius=0.2"])
    model = "cost.model=layers"
    layers = "cost.layers=[static, inflation: {inscribed_radius: 0.2}, inflation]"
    message = r"inscribed_radius 0.2 m comes on top of stage inflate"
    with pytest.warns(MapdealWarning, match=message):
        load_recipe("default", changes=[model, layers])
    load_recipe("nav2")  # without a warning
    load_recipe("default", changes=[model])


def test_a_recipe_file_in_every_plan_blocks_writing(file):
    recipe = described(file(
        "stages:\n  - active\n  - inflate:\n  - esdf: {max_distance: none, strength: 5e-1}\n"
        "  - cost:\n      model: rings\n      values: [80, 40]\n"
    ))  # fmt: skip
    assert list(recipe) == ["active", *INFLATED]
    assert (recipe["esdf"]["max_distance"], recipe["esdf"]["strength"]) == (None, 0.5)
    assert recipe["cost"] == {"model": "rings", "values": [80, 40], "lethal_threshold": None}


def test_mappings_that_are_merged_give_way_to_what_stands_beside_them(file):
    text = (
        "stages:\n  - inflate: &a {lethal_threshold: &n 60}\n"
        "  - esdf: &b {lethal_threshold: 70}\n"
        "  - cost:\n      <<: [{lethal_threshold: 80, model: threshold}, *b]\n"
    )
    thresholds = [parameters["lethal_threshold"] for parameters in described(file(text)).values()]
    assert thresholds == [60, 70, 80]
    text += "      lethal_threshold: *n\n"
    assert described(file(text))["cost"]["lethal_threshold"] == 60
    with pytest.raises(ParameterError, match="appears twice, on lines 6 and 7"):
        load_recipe(file(text + "      lethal_threshold: 50\n"))


@pytest.mark.parametrize("text", [
    "- inflate: {radius: 0.3}\n- esdf\n",  # the list without its key
    "inflate: {radius: 0.3}\nesdf:\n", "", "stages:\n", "stages: esdf\n",
])  # fmt: skip
def test_the_hint_for_a_malformed_recipe_shows_a_sound_one(file, text):
    path = file(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(path)
    assert str(caught.value).startswith(f"{path}:")
    example = re.search(r'"(.*)"', caught.value.hint)[1]
    assert list(described(file(f"stages:\n{example}\n"))) == ["inflate"]


ROOM = "\n".join(
    ["#" * 30, *["#" + "." * 28 + "#"] * 4, "#" + "." * 14 + "?" + "." * 13 + "#",
     *["#..#" + "." * 25 + "#"] * 4, "#" * 30]
)  # fmt: skip
STAGES = {
    "clean": {"min_free": 0}, "window": {"size": [2.0, 0.8], "at": [3.0, -1.5]},
    "rotate": {"yaw": 0.3}, "rescale": {"resolution": 0.2, "rule": "nearest"},
    "shift": {"origin": [2.5, -1.0], "default": 100},
}  # fmt: skip


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mapdeal.write_map("room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.0)))
    return read_map("room.yaml")


def recipe_of(**stages):
    listed = [{name: values} for name, values in stages.items()]
    Path("r.yaml").write_text(json.dumps({"stages": listed}))
    return "r.yaml"


def test_each_works_on_what_the_one_before_it_made(room, command):
    expected = {"cleaned.yaml": mapdeal.clean(room, min_free=0).grid}
    for name, call in {
        "window.yaml": lambda grid: mapdeal.window(grid, size_xy=(2, 0.8), center_xy=(3, -1.5)),
        "turned.yaml": lambda grid: mapdeal.rotate(grid, 0.3),
        "rescaled.yaml": lambda grid: mapdeal.rescale(grid, 0.2, rule="nearest"),
        "shifted.yaml": lambda grid: mapdeal.shift_origin(grid, (2.5, -1.0), default=100),
        "esdf.npz": mapdeal.esdf,
    }.items():
        expected[name] = call([*expected.values()][-1])
    words = "run", "room.yaml", "-o", "out", "--recipe", recipe_of(**STAGES, esdf={})
    assert command(*words)[0] == 0
    for name, grid in expected.items():
        written = read_map(f"out/room/{name}")
        assert written.frame == grid.frame
        assert np.array_equal(written.layer, grid.layer), name
    assert "unchanged" in command(*words)[1]


def test_a_map_is_straightened_before_others_work_on_it(room):
    crooked = mapdeal.rotate(room, 0.3)
    products = mapdeal.apply_recipe(crooked, recipe_of(rotate={"straighten": True}))
    assert np.array_equal(products["rotate"].occupancy, mapdeal.straighten(crooked).occupancy)


def test_costs_and_fields_are_edited_as_the_maps_that_they_are_of(room):
    costs = mapdeal.exponential_cost(room)
    with pytest.warns(mapdeal.MapdealWarning, match="occupancy that ROS would publish"):
        products = mapdeal.apply_recipe(costs, recipe_of(rescale={"resolution": 0.2}))
    assert isinstance(products["rescale"], mapdeal.OccupancyGrid)
    with pytest.raises(ParameterError, match="window: cannot follow cost"):
        mapdeal.load_recipe(recipe_of(cost={}, window=STAGES["window"]))


def test_the_whole_extent_is_that_of_the_map_that_was_moved(room):
    recipe = recipe_of(window={"size": [9.0, 9.0], "corner": [0.0, -5.0]}, active={})
    products = mapdeal.apply_recipe(room, recipe, canvas="full")
    assert products["active"].frame == products["window"].frame
    assert products["window"].shape == (90, 90)


@pytest.mark.parametrize("more", [{}, {"inflate": {}}])
def test_a_map_that_grows_too_large_is_refused_before_it_is_made(room, more):
    recipe = recipe_of(rescale={"resolution": 0.0005}, **more)
    with pytest.raises(mapdeal.MalformedInputError, match=r"room.yaml: .* of memory"):
        mapdeal.run("room.yaml", "out", recipe, max_memory=60_000_000)


MAP = OccupancyGrid([[0, 100, 0], [0, -1, 0]], 0.25, (1.5, -2.0, 0.4))
ROUND = Footprint.circle(0.2)


def recipe(tmp_path, stages, **options):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n" + "".join(f"  - {stage}\n" for stage in stages.split()))
    return {step.name: step for step in load_recipe(str(path), **options).steps}


@pytest.mark.parametrize(("name", "grid", "message"), [
    *[(name, mapdeal.layered_cost(MAP), "contains costs") for name in ("inflate", "esdf", "cost")],
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
    recipe(tmp_path, "reach inflate", changes=[setting])  # without a warning
    recipe(tmp_path, "cost reach", changes=[setting, inscribed])
    with pytest.warns(MapdealWarning, match="cost: inscribed_radius 0.3 m comes on top of stage i"):
        recipe(tmp_path, "reach inflate cost", changes=[inscribed])


def test_only_a_stage_that_takes_costs_can_follow_cost(tmp_path):
    assert list(recipe(tmp_path, "cost reach potential")) == ["cost", "reach", "potential"]
    for stages in ("cost esdf", "cost reach esdf", "cost potential inflate"):
        with pytest.raises(ParameterError, match=rf"{stages.split()[-1]}: cannot follow cost"):
            recipe(tmp_path, stages)


@pytest.mark.parametrize(("stages", "expected"), [
    ("reach inflate esdf cost", {"reach": ROUND, "inflate": ROUND, "cost": 0.0}),
    ("reach esdf cost", {"reach": ROUND, "cost": 0.2}),
    ("reach", {"reach": ROUND}),
    ("inflate reach", {"inflate": ROUND, "reach": None}),  # no shape on top
    ("cost reach", {"cost": 0.2, "reach": ROUND}),  # costs hold obstacles, not the shape
])  # fmt: skip
def test_a_shape_goes_to_reach_and_to_the_first_other_stage(tmp_path, stages, expected):
    steps = recipe(tmp_path, stages, footprint=ROUND)
    for name, value in expected.items():
        key = "inscribed_radius" if name == "cost" else "footprint"
        assert steps[name].parameters[key] == value


def test_a_shape_sets_the_radii_and_no_warning_of_the_stage_is_repeated():
    robot = mapdeal.Footprint.parse("[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]")
    curve = mapdeal.cost_curve(0.05, footprint=robot, inflation_radius=0.1)
    assert curve.inscribed_radius == pytest.approx(0.2)
    assert curve.circumscribed_radius == pytest.approx(0.13**0.5)
    assert curve.circumscribed_cost == 0  # beyond the inflation radius
