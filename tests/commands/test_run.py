import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from bad_maps import tree
from drawn import grid_from_text

DRAWING = """
    ??????????
    ?......#.?
    ?...#....?
    ?........?
    ??????????
"""
CORNERS = [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]


@pytest.fixture(autouse=True)
def room(here):
    mapdeal.write_map("room.yaml", grid_from_text(DRAWING))


@pytest.mark.parametrize(("words", "arguments"), [
    ([], {}),
    (["--set", "inflate.radius=0.4"], {"changes": {"inflate.radius": 0.4}}),
    (["--recipe", "design-real", "--sim", "--canvas", "full", "--no-images"],
     {"recipe": "design-real", "sim": True, "canvas": "full", "images": np.False_}),
    (["--recipe", "nav2", "--footprint", str(CORNERS)],
     {"recipe": "nav2", "footprint": mapdeal.Footprint.polygon(CORNERS)}),
    (["--image-max", "100", "--dialect", "ros1", "--threads", "1"],
     {"image_max": np.int64(100), "dialect": "ros1", "threads": np.int8(1)}),
], ids=["default", "changes", "full canvas", "footprint", "options"])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_writes_the_files_of_the_command(command, words, arguments):
    code, _, err = command("run", "room.yaml", "-o", "by_command", *words)
    assert code == 0, err
    report = mapdeal.run(Path("room.yaml"), Path("by_python"), **arguments)
    assert (report.folder, report.status) == (Path("by_python/room"), "done")
    assert tree(report.folder) == tree(Path("by_command/room"))
    assert mapdeal.run("room.yaml", "by_command", **arguments).status == "unchanged"


@pytest.mark.parametrize("canvas", ["crop", "full"])
@pytest.mark.parametrize("name", ["default", "nav2", "design-sim", "local", "arena"])
@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_recipe_in_memory_makes_what_a_run_writes(name, canvas):
    report = mapdeal.run("room.yaml", "out", name, canvas=canvas, images=False)
    products = mapdeal.apply_recipe(mapdeal.read_map("room.yaml"), name, canvas=canvas)
    assert list(products) == list(report.figures)
    for stage, grid in products.items():
        assert grid.figures() == report.figures[stage]
    for stage, layer in (("esdf", "distance"), ("cost", "cost")):
        written = mapdeal.read_map(report.folder / f"{stage}.npz")
        assert products[stage].origin == written.origin
        np.testing.assert_array_equal(getattr(products[stage], layer), getattr(written, layer))


def test_changes_are_values_of_python_and_numpy_or_texts():
    changes = {
        "inflate.radius": np.float32(0.5), "inflate.lethal_threshold": np.int64(80),
        "inflate.inflate_unknown": False, "esdf.max_distance": None, "cost.inflation_radius": "1",
    }  # fmt: skip
    recipe = mapdeal.load_recipe("default", changes)
    inflate, esdf, cost = (next(iter(stage.values())) for stage in recipe.described())
    assert (inflate["radius"], inflate["lethal_threshold"]) == (0.5, 80)
    assert inflate["inflate_unknown"] is False
    assert (esdf["max_distance"], cost["inflation_radius"]) == (None, 1.0)
    assert repr(recipe) == "Recipe(inflate -> esdf -> cost exponential)"
    by_text = mapdeal.load_recipe("local", {"cost.values": "80,40"})
    assert by_text == mapdeal.load_recipe("local", {"cost.values": (80, 40)})
    assert by_text.described()[-1]["cost"]["values"] == [80, 40]


def test_a_recipe_file_is_loaded_by_its_path():
    Path("mine.yaml").write_text("stages:\n  - inflate: {radius: 0.4}\n  - esdf\n")
    recipe = mapdeal.load_recipe(Path("mine.yaml"), {"inflate.kernel": "square"})
    inflate = recipe.described()[0]["inflate"]
    assert (inflate["radius"], inflate["kernel"]) == (0.4, "square")
    assert list(mapdeal.apply_recipe(grid_from_text(DRAWING), recipe)) == ["inflate", "esdf"]
    assert mapdeal.load_recipe(recipe) is recipe
    assert list(mapdeal.run("room.yaml", "out", recipe).figures) == ["inflate", "esdf"]


def test_a_recipe_warns_of_costs_that_say_nothing():
    free = mapdeal.OccupancyGrid(np.zeros((9, 12), np.int8), 0.25, (1.5, -2.0, 0.4))
    with pytest.warns(mapdeal.MapdealWarning, match=r"cost: .*%"):
        mapdeal.apply_recipe(free, "design-real")


def test_info_is_what_the_command_says(command):
    assert mapdeal.info("room.yaml") == json.loads(command("info", "room.yaml", "--json")[1])
    assert mapdeal.info(Path("room.yaml"))["occupied"] == 2
    assert mapdeal.info("room.yaml", dialect="humble")["dialect"] == "humble"


def test_several_maps_are_run_into_a_folder_each():
    mapdeal.write_map("other.yaml", grid_from_text(DRAWING))
    first, second = mapdeal.run(["room.yaml", "other.yaml"], "out", robot_radius=0.5)
    assert (first.folder, second.folder) == (Path("out/room"), Path("out/other"))


EXAMPLES = Path(__file__).parents[2] / "examples"
NAV2 = EXAMPLES / "robots" / "nav2_params.yaml"
OFFICE = EXAMPLES / "maps" / "office.yaml"


def test_a_run_for_a_robot_is_the_commands(command, tmp_path):
    robot = mapdeal.read_robot_parameters(NAV2)
    report = mapdeal.run(OFFICE, tmp_path / "python", robot, images=False)
    words = ["--params-file", NAV2, "--no-images", "-q"]
    assert command("run", OFFICE, "-o", tmp_path / "command", *words)[0] == 0
    assert tree(tmp_path / "python") == tree(tmp_path / "command")
    assert json.loads((report.folder / "manifest.json").read_text())["robot"] == robot.described()


def test_a_grid_gets_the_costs_of_a_robot_and_changes_of_them():
    robot = mapdeal.read_robot_parameters([NAV2])
    grid = mapdeal.read_map(OFFICE)
    products = mapdeal.apply_recipe(grid, robot)
    assert list(products) == ["esdf", "cost"]
    # by hand: 252 exp(-4 (0.30 - 0.19)) at six cells of float32(0.05) m
    costs = products["cost"].cost
    assert {253, 162} <= set(np.unique(costs).tolist())
    wider = mapdeal.apply_recipe(grid, robot, {"cost.inflation_radius": 0.9})["cost"].cost
    assert (wider > 0).sum() > (costs > 0).sum()
    round_ = mapdeal.load_recipe(robot, footprint=mapdeal.Footprint.circle(0.3))
    assert round_.described()[-1]["cost"]["inscribed_radius"] == 0.3


def test_the_local_costmap_and_older_inflation_can_be_asked_for():
    local = mapdeal.read_robot_parameters(NAV2, costmap="local")
    assert local.rolling_window
    assert [layer.name for layer in local.static_layers] == ["injected_static"]
    assert [layer.lookup for layer in local.inflation_layers] == ["nav2"]
    older = mapdeal.read_robot_parameters(NAV2, dialect="humble")
    assert [layer.lookup for layer in older.inflation_layers] == ["exact"]
