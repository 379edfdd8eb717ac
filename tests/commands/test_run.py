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


@pytest.mark.parametrize(
    ("words", "arguments"),
    [
        ([], {}),
        (["--recipe", "nav2"], {"recipe": "nav2"}),
        (["--set", "inflate.radius=0.4"], {"changes": {"inflate.radius": 0.4}}),
        (
            ["--recipe", "design-real", "--sim", "--canvas", "full", "--no-images"],
            {"recipe": "design-real", "sim": True, "canvas": "full", "images": False},
        ),
        (
            ["--recipe", "nav2", "--footprint", "[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]"],
            {
                "recipe": "nav2",
                "footprint": mapdeal.Footprint.polygon(
                    [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)]
                ),
            },
        ),
        (["--recipe", "nav2", "--canvas", "full"], {"recipe": "nav2", "canvas": "full"}),
        (["--image-max", "100", "--dialect", "ros1"], {"image_max": 100, "dialect": "ros1"}),
    ],
    ids=["default", "nav2", "changes", "full canvas", "footprint", "no crop", "options"],
)
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


def test_an_unchanged_run_is_told_and_another_one_refused(room, tmp_path):
    first = mapdeal.run(room, tmp_path / "out")
    again = mapdeal.run(room, tmp_path / "out")
    assert (first.status, again.status) == ("done", "unchanged")
    assert first.figures == again.figures
    with pytest.raises(mapdeal.FileAccessError, match="exists"):
        mapdeal.run(room, tmp_path / "out", changes={"inflate.radius": 0.4})
    forced = mapdeal.run(room, tmp_path / "out", changes={"inflate.radius": 0.4}, force=True)
    assert forced.status == "done"


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_that_fails_leaves_nothing(room, tmp_path):
    blank = tmp_path / "blank.yaml"
    mapdeal.write_map(blank, mapdeal.OccupancyGrid(np.full((2, 3), -1, np.int8), 0.5))
    with pytest.raises(mapdeal.MapdealError, match=r"blank\.yaml"):
        mapdeal.run(blank, tmp_path / "out", "design-sim")
    assert not (tmp_path / "out").exists()


def test_a_strict_run_ends_at_a_warning_before_it_writes(room, tmp_path):
    room.write_text(room.read_text().replace("negate: 0\n", ""))
    with (
        pytest.warns(mapdeal.MapdealWarning, match="negate"),
        pytest.raises(mapdeal.FindingError, match=r"room\.yaml"),
    ):
        mapdeal.run(room, tmp_path / "out", strict=True)
    assert not (tmp_path / "out").exists()
    with pytest.warns(mapdeal.MapdealWarning, match="negate"):
        assert mapdeal.run(room, tmp_path / "out").status == "done"


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
    assert (
        recipe.described()[0]["inflate"] | {"radius": 0.4, "kernel": "square"}
        == (recipe.described()[0]["inflate"])
    )
    grid = grid_from_text(DRAWING)
    assert list(mapdeal.apply_recipe(grid, recipe)) == ["inflate", "esdf"]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"inflate.radis": 1}, "inflate.radis: no such parameter"),
        ({"inflate.radius": -1}, "inflate.radius: must be a finite number, at least 0, got -1"),
        ({"inflate.radius": float("nan")}, "inflate.radius: must be a finite number"),
        ({"inflate.radius": True}, "inflate.radius: must be a finite number"),
        ({"inflation_radius": 1}, r"changes: must look like \{'stage.parameter': value\}"),
        ({"inflate": {"radius": 1}}, r"changes: must look like \{'stage.parameter': value\}"),
        ({"infalte.radius": 1}, "changes: no such stage, got 'infalte'"),
        ({"active.margin": 1}, "recipe default has no stage active, got 'active.margin'"),
    ],
)
def test_changes_that_are_not_allowed_are_refused(changes, match):
    with pytest.raises(mapdeal.ParameterError, match=match):
        mapdeal.load_recipe("default", changes)


def test_a_loaded_recipe_is_taken_as_it_is_or_refused(room, tmp_path):
    recipe = mapdeal.load_recipe("nav2", {"cost.inflation_radius": 0.8})
    assert mapdeal.load_recipe(recipe) is recipe
    report = mapdeal.run(room, tmp_path / "out", recipe)
    assert list(report.figures) == ["esdf", "cost"]
    with pytest.raises(mapdeal.ParameterError, match="cannot be changed"):
        mapdeal.apply_recipe(mapdeal.read_map(room), recipe, {"cost.inflation_radius": 1})
    with pytest.raises(mapdeal.ParameterError, match="no such recipe, got 'nav'"):
        mapdeal.load_recipe("nav")
    with pytest.raises(mapdeal.ParameterError, match="must be the name of a recipe"):
        mapdeal.load_recipe(["inflate"])


def test_paths_and_grids_are_not_mistaken_for_each_other(room, tmp_path):
    with pytest.raises(mapdeal.ParameterError, match="run: takes the path of a map"):
        mapdeal.run(mapdeal.read_map(room), tmp_path / "out")
    with pytest.raises(mapdeal.ParameterError, match="apply_recipe: takes a grid"):
        mapdeal.apply_recipe(room)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"canvas": "whole"}, "canvas: must be one of crop, full"),
        ({"dialect": "ros2"}, "dialect: must be one of nav2, humble, ros1"),
        ({"threads": 0}, "threads: must be a whole number, at least 1"),
        ({"threads": True}, "threads: must be a whole number"),
        ({"max_memory": -1}, "max_memory: must be"),
        ({"image_max": -1}, "image_max: must be"),
    ],
)
def test_arguments_that_are_not_allowed_are_refused(room, tmp_path, arguments, match):
    with pytest.raises(mapdeal.ParameterError, match=match):
        mapdeal.run(room, tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("footprint", [0.3, [(0.3, 0.2), (0.3, -0.2), (-0.3, 0)], "circle"])
def test_a_footprint_that_is_none_is_refused(room, tmp_path, footprint):
    for call in (
        lambda: mapdeal.load_recipe("nav2", footprint=footprint),
        lambda: mapdeal.apply_recipe(mapdeal.read_map(room), "nav2", footprint=footprint),
        lambda: mapdeal.run(room, tmp_path / "out", footprint=footprint),
    ):
        with pytest.raises(
            mapdeal.ParameterError, match="footprint: must be a Footprint"
        ) as caught:
            call()
        assert "Footprint.circle(radius)" in caught.value.hint


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
    with pytest.raises(mapdeal.FileAccessError):
        mapdeal.info(room.with_name("missing.yaml"))
    with pytest.raises(mapdeal.ParameterError, match="dialect"):
        mapdeal.info(room, dialect="ros2")


def test_changes_that_are_no_mapping_are_refused():
    with pytest.raises(mapdeal.ParameterError, match="changes: must be values by name, got"):
        mapdeal.load_recipe("default", [("inflate.radius", 1)])


def test_settings_of_a_run_may_be_numpys(room, tmp_path):
    ours, numpys = tmp_path / "ours", tmp_path / "numpys"
    mapdeal.run(room, ours, images=True, image_max=50, threads=1)
    mapdeal.run(room, numpys, images=np.True_, image_max=np.int64(50), threads=np.int8(1))
    assert _sums(numpys / "room") == _sums(ours / "room")
