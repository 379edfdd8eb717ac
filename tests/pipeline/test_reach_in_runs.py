"""The stage reach in recipes: files, manifests, golden runs, and where a robot's shape goes."""

import json
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import Footprint, MapdealWarning, read_map
from mapdeal.pipeline.recipe import load_recipe

ROOT = Path(__file__).parents[2]
RECIPE = "examples/recipes/reach.yaml"
OFFICE = "examples/maps/office.yaml"
FILES = {"reach.json", "reach.npz", "reach.png"}
DOOR = ["--point", "0.9,-0.825", "--point", "2.2,-0.825", "--value", "100"]
"""Across the kitchen's door."""


@pytest.fixture
def office(tmp_path, monkeypatch):
    """A folder with the example map and its recipe."""
    monkeypatch.chdir(tmp_path)
    for name in (RECIPE, OFFICE, OFFICE.replace(".yaml", ".pgm")):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, name)
    return tmp_path


@pytest.fixture
def run(command, office):
    """Run the recipe; return exit code, lines, and the manifest if there is one."""

    def ran(*words, source=OFFICE, folder="out"):
        code, out, err = command("run", source, "-o", folder, "--recipe", RECIPE, *words)
        path = Path(folder) / "office" / "manifest.json"
        return code, out + err, json.loads(path.read_text()) if path.exists() else None

    return ran


def test_the_example_reaches_its_goals(run):
    code, said, manifest = run()
    assert code == 0, said
    assert "; 3 of 3 goals; " in said
    assert FILES | {"cost.npz", "inflated.pgm"} <= set(manifest["outputs"])
    assert manifest["figures"]["reach"]["goals"] == dict.fromkeys(["kitchen", "lab", "store"], True)
    answer = json.loads(Path("out/office/reach.json").read_text())
    assert [goal["reachable"] for goal in answer["goals"]] == [True] * 3
    with np.load("out/office/reach.npz") as layers:
        area = np.count_nonzero(layers["reachable"]) * 0.05**2
    assert answer["reachable_m2"] == pytest.approx(area)
    assert manifest["figures"]["reach"]["reachable_m2"] == pytest.approx(area)
    # it only looks: the rest is what it is without it
    inflated = read_map("out/office/inflated.yaml").occupancy
    expected = mapdeal.inflate(read_map(OFFICE), radius=0.3).occupancy
    np.testing.assert_array_equal(inflated == 100, expected == 100)


def test_what_is_there_is_not_made_again_and_shows_how_it_was_made(run, command):
    run("--no-images")
    assert "unchanged" in run("--no-images")[1]
    code, out, _ = command("info", "out/office/reach.npz")
    assert code == 0
    assert "made by     reach: start" in out
    assert command("lint", "out")[0] == 0
    assert "office" in run("--dry-run", folder="new")[1]
    assert not Path("new").exists()


def test_ci_sees_that_the_kitchen_is_no_longer_reachable(run, command):
    golden = ["--golden", "gold", "--no-images"]
    assert run(*golden, "--update-golden")[0] == 0
    assert run(*golden, folder="same")[0] == 0
    code, _, err = command("edit", "line", OFFICE, "-o", "new/office.yaml", *DOOR)
    assert code == 0, err
    code, said, manifest = run(*golden, source="new/office.yaml", folder="changed")
    assert code == 1
    (line,) = (line for line in said.splitlines() if line.startswith("office: reach: "))
    told = "office: reach: reach.json, reach.npz differ: kitchen no longer reachable, reachable_m2 "
    assert line.startswith(told)
    assert manifest["figures"]["reach"]["goals"] == {"kitchen": False, "lab": True, "store": True}


def test_a_goal_that_is_not_reached_is_warned_of(run):
    words = ["--set", "reach.goals={cupboard: [9, 3], lift: [-7, 3]}", "--no-images"]
    code, said, manifest = run(*words)
    assert code == 0
    told = "reach: not reachable: cupboard (its cell is unknown)"
    assert said.count(told) == 1
    assert [text.endswith(told) for text in manifest["warnings"]] == [True]
    assert run(*words, "--strict", folder="strict")[0] == 1


def test_goals_are_set_on_the_command_line(run):
    goals = "reach.goals={lift: [-7, 3], 'room 2': [7.5, -4.5]}"
    code, said, manifest = run("--set", goals, "--set", "reach.start=-8,0", "--no-images")
    assert code == 0, said
    assert manifest["figures"]["reach"]["goals"] == {"lift": True, "room 2": True}
    code, said, _ = run("--set", "reach.goals={lift: [-7]}", folder="none")
    assert (code, said.count("\n")) == (2, 1)
    assert "--set: reach.goals lift: must be 2 numbers" in said


@pytest.mark.usefixtures("mapdeal_warnings")
def test_on_a_larger_canvas_it_is_what_it_is_on_the_active_region(office, command):
    stages = "stages:\n  - active:\n  - esdf:\n  - reach: {start: [-8, 0], radius: 0.3}\n"
    Path("r.yaml").write_text(stages)
    words = ("run", OFFICE, "--recipe", "r.yaml", "--no-images")
    assert command(*words, "-o", "crop")[0] == command(*words, "-o", "full", "--canvas", "full")[0]
    figures = [
        json.loads(Path(f"{name}/office/manifest.json").read_text())["figures"]["reach"]
        for name in ("crop", "full")
    ]
    assert figures[1]["width"] == 544 > figures[0]["width"]
    for name in ("reachable_m2", "open_m2", "free_m2", "share"):
        assert figures[0][name] == pytest.approx(figures[1][name])
    with np.load("full/office/reach.npz") as file:
        full = file["reachable"]
    assert full.shape == (544, 544)
    assert full.sum() * 0.05**2 == pytest.approx(figures[0]["reachable_m2"])


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_with_the_robot_s_files_reaches_what_the_command_does(run, command):
    robot(threshold=65)
    code, said, manifest = run("--params-file", "p.yaml", "--no-images")
    assert code == 0, said
    code, out, err = command("reach", OFFICE, "--params-file", "p.yaml", "--from", "-8,0",
                             "--to", "kitchen=3,-4", "--layers", "l.npz")  # fmt: skip
    assert code == 0, err
    found = json.loads(out)
    assert manifest["figures"]["reach"]["reachable_m2"] == pytest.approx(found["reachable_m2"])
    with np.load("l.npz") as one, np.load("out/office/reach.npz") as other:
        for name in ("reachable", "headings", "clearance", "widest"):
            np.testing.assert_array_equal(one[name], other[name])


REACH_FIRST = "recipe.yaml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a recipe, where reach comes first."""
    monkeypatch.chdir(tmp_path)
    text = "stages:\n  - reach: {start: [-8, 0], radius: 0.3}\n  - inflate:\n  - esdf:\n  - cost:\n"
    Path(REACH_FIRST).write_text(text)


@pytest.mark.filterwarnings("error")
def test_a_shape_goes_to_reach_and_to_inflate(folder):
    shape = Footprint.circle(0.2)
    reach, inflate, _, cost = load_recipe(REACH_FIRST, footprint=shape).steps
    assert (reach.parameters["footprint"], reach.parameters["radius"]) == (shape, 0.2)
    assert (inflate.parameters["footprint"], inflate.parameters["radius"]) == (shape, 0.2)
    assert cost.parameters["inscribed_radius"] == 0.0
    later = load_recipe(REACH_FIRST, footprint=shape, changes=["reach.radius=0.5"]).steps[0]
    assert (later.parameters["footprint"], later.parameters["radius"]) == (None, 0.5)


def test_after_inflation_the_radius_would_count_twice(folder):
    Path("r.yaml").write_text("stages:\n  - inflate:\n  - reach: {start: [-8, 0]}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, reach = load_recipe("r.yaml", footprint=Footprint.circle(0.2)).steps
    assert reach.parameters["radius"] == 0.0
    with pytest.warns(MapdealWarning, match=r"reach: radius 0.2 m comes on top of stage inflate"):
        load_recipe("r.yaml", changes=["reach.radius=0.2"])


def test_it_looks_at_the_lethal_cells_of_costs(folder):
    """After cost as in front of it: inscribed costs are no obstacles.

    They cover unknown cells, so that smaller robots, and `widest`, may find other ways.
    """
    Path("r.yaml").write_text("stages:\n  - cost: {inscribed_radius: 0.3}\n  - reach\n")
    settings = ["reach.start=-8,0", "reach.radius=0.3"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recipe = load_recipe("r.yaml", changes=settings)
        made = mapdeal.apply_recipe(read_map(ROOT / OFFICE), recipe)
    alone = mapdeal.reach(read_map(ROOT / OFFICE), start=(-8, 0), radius=0.3)
    for name in ("reachable", "headings", "clearance"):
        np.testing.assert_array_equal(getattr(made["reach"], name), getattr(alone, name))


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
def test_it_takes_the_map_as_the_robot_does(folder):
    own = robot(threshold=65)
    reach = load_recipe(REACH_FIRST, robot=own).steps[0]
    assert reach.parameters["lethal_threshold"] == own.static_layers[-1].lethal_cost_threshold == 65
    assert not reach.parameters["through_unknown"]
    # round as the planner has it, whose circle lies within the polygon of 16 corners
    assert reach.parameters["footprint"] == Footprint.circle(own.inscribed_radius)
    free = load_recipe(REACH_FIRST, robot=robot(track="false")).steps[0].parameters
    assert (free["through_unknown"], free["lethal_threshold"]) == (True, None)
    corners = "footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]'"
    polygon = load_recipe(REACH_FIRST, robot=robot(corners)).steps[0].parameters["footprint"]
    assert len(polygon.vertices) == 4


@pytest.mark.usefixtures("mapdeal_warnings")
def test_what_the_recipe_says_itself_stays(folder):
    Path("r.yaml").write_text("stages:\n  - reach: {through_unknown: no, lethal_threshold: 90}\n")
    reach = load_recipe("r.yaml", robot=robot(threshold=65, track="false")).steps[0]
    assert not reach.parameters["through_unknown"]
    assert reach.parameters["lethal_threshold"] == 90
    Path("r.yaml").write_text("stages:\n  - esdf: {lethal_threshold: 65}\n  - reach\n")
    reach = load_recipe("r.yaml", robot=robot(threshold=65)).steps[1]
    assert reach.parameters["lethal_threshold"] is None  # the field knows
