"""Runs and recipes from Python: the folders of the command, and the same in memory."""

import hashlib

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

DRAWING = """
    ??????????
    ?......#.?
    ?...#....?
    ?........?
    ??????????
"""


CORNERS = [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]


@pytest.fixture
def room(tmp_path):
    path = tmp_path / "room.yaml"
    mapdeal.write_map(path, grid_from_text(DRAWING))
    return path


def _sums(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.iterdir())
    }


@pytest.mark.parametrize(("words", "arguments"), [
    ([], {}),
    (["--recipe", "nav2"], {"recipe": "nav2"}),
    (["--set", "inflate.radius=0.4"], {"changes": {"inflate.radius": 0.4}}),
    (
        ["--recipe", "design-real", "--sim", "--canvas", "full", "--no-images"],
        {"recipe": "design-real", "sim": True, "canvas": "full", "images": False},
    ),
    (
        ["--recipe", "nav2", "--footprint", str(CORNERS)],
        {"recipe": "nav2", "footprint": mapdeal.Footprint.polygon(CORNERS)},
    ),
    (["--image-max", "100", "--dialect", "ros1"], {"image_max": 100, "dialect": "ros1"}),
], ids=['default', 'nav2', 'changes', 'full canvas', 'footprint', 'options'])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_writes_the_files_of_the_command(room, tmp_path, command, words, arguments):
    code, _, err = command("run", room, "-o", tmp_path / "by_command", *words)
    assert code == 0, err
    report = mapdeal.run(room, tmp_path / "by_python", **arguments)
    assert report.folder == tmp_path / "by_python" / "room"
    assert report.status == "done"
    assert _sums(report.folder) == _sums(tmp_path / "by_command" / "room")
    assert mapdeal.run(str(room), str(tmp_path / "by_command"), **arguments).status == "unchanged"


@pytest.mark.parametrize("canvas", ["crop", "full"])
@pytest.mark.parametrize("name", ["default", "nav2", "design-sim", "local", "arena"])
@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_recipe_in_memory_makes_what_a_run_writes(room, tmp_path, name, canvas):
    report = mapdeal.run(room, tmp_path / "out", name, canvas=canvas, images=False)
    made = mapdeal.apply_recipe(mapdeal.read_map(room), name, canvas=canvas)
    assert list(made) == list(report.figures)
    for stage, grid in made.items():
        assert grid.figures() == report.figures[stage]
    for stage, layer in (("esdf", "distance"), ("cost", "cost")):
        written = mapdeal.read_map(report.folder / f"{stage}.npz")
        assert made[stage].origin == written.origin
        assert np.array_equal(
            getattr(made[stage], layer), getattr(written, layer), equal_nan=stage == "esdf"
        )


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_that_fails_leaves_nothing(room, tmp_path):
    blank = tmp_path / "blank.yaml"
    mapdeal.write_map(blank, mapdeal.OccupancyGrid(np.full((2, 3), -1, np.int8), 0.5))
    with pytest.raises(mapdeal.MapdealError, match=r"blank\.yaml"):
        mapdeal.run(blank, tmp_path / "out", "design-sim")
    assert not (tmp_path / "out").exists()


def test_changes_are_values_of_python_and_numpy():
    recipe = mapdeal.load_recipe(
        "default",
        {
            "inflate.radius": np.float32(0.5),
            "inflate.lethal_threshold": np.int64(80),
            "inflate.inflate_unknown": False,
            "esdf.max_distance": None,
            "cost.inflation_radius": 1,
        },
    )
    inflate, esdf, cost = recipe.described()
    assert inflate["inflate"]["radius"] == 0.5
    assert inflate["inflate"]["lethal_threshold"] == 80
    assert inflate["inflate"]["inflate_unknown"] is False
    assert esdf["esdf"]["max_distance"] is None
    assert cost["cost"]["inflation_radius"] == 1.0
    assert repr(recipe) == "Recipe(inflate -> esdf -> cost exponential)"


def test_changes_are_those_of_set():
    by_text = mapdeal.load_recipe("local", {"cost.values": "80,40", "inflate.radius": "0.2"})
    assert by_text == mapdeal.load_recipe("local", {"cost.values": (80, 40), "inflate.radius": 0.2})
    assert by_text.described()[-1]["cost"]["values"] == [80, 40]


def test_a_recipe_file_is_loaded_by_its_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("stages:\n  - inflate: {radius: 0.4}\n  - esdf\n")
    recipe = mapdeal.load_recipe(path, {"inflate.kernel": "square"})
    inflate = recipe.described()[0]["inflate"]
    assert (inflate["radius"], inflate["kernel"]) == (0.4, "square")
    grid = grid_from_text(DRAWING)
    assert list(mapdeal.apply_recipe(grid, recipe)) == ["inflate", "esdf"]


def test_a_loaded_recipe_is_taken_as_it_is_or_refused(room, tmp_path):
    recipe = mapdeal.load_recipe("nav2", {"cost.inflation_radius": 0.8})
    assert mapdeal.load_recipe(recipe) is recipe
    report = mapdeal.run(room, tmp_path / "out", recipe)
    assert list(report.figures) == ["esdf", "cost"]


def test_a_recipe_warns_of_costs_that_say_nothing():
    free = mapdeal.OccupancyGrid(np.zeros((9, 12), np.int8), 0.25, (1.5, -2.0, 0.4))
    with pytest.warns(mapdeal.MapdealWarning, match=r"cost: .*%"):
        mapdeal.apply_recipe(free, "design-real")


def test_info_is_what_the_command_says(room, command):
    import json

    _, out, _ = command("info", room, "--json")
    assert mapdeal.info(room) == json.loads(out)
    assert mapdeal.info(str(room))["occupied"] == 2
    assert mapdeal.info(room, dialect="humble")["dialect"] == "humble"


def test_settings_of_a_run_may_be_numpys(room, tmp_path):
    ours, numpys = tmp_path / "ours", tmp_path / "numpys"
    mapdeal.run(room, ours, images=True, image_max=50, threads=1)
    mapdeal.run(room, numpys, images=np.True_, image_max=np.int64(50), threads=np.int8(1))
    assert _sums(numpys / "room") == _sums(ours / "room")
