"""The stage reach in recipes: files, manifests, golden runs, and the robot's parameters."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import Footprint, read_map
from mapdeal.pipeline.recipe import load_recipe

ROOT = Path(__file__).parents[2]
RECIPE = "examples/recipes/reach.yaml"
OFFICE = "examples/maps/office.yaml"
FILES = {"reach.json", "reach.npz", "reach.png"}
REACH_FIRST = "{start: [-8, 0], radius: 0.3}\n  - inflate:\n  - esdf:\n  - cost:"
PARAMETERS = """
global_costmap: {{global_costmap: {{ros__parameters: {{
  {shape}, footprint_padding: 0.0, plugins: [static_layer],
  static_layer: {{plugin: "nav2_costmap_2d::StaticLayer"}},
  lethal_cost_threshold: {threshold}, track_unknown_space: {track}}}}}}}
"""

pytestmark = pytest.mark.usefixtures("office")


@pytest.fixture
def office(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in (RECIPE, OFFICE, OFFICE.replace(".yaml", ".pgm")):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, name)


@pytest.fixture
def run(command, office):
    """Return a function that runs the recipe: exit code, output, and the manifest if any."""

    def run_recipe(*words, source=OFFICE, folder="out", recipe=RECIPE):
        words = "--recipe", recipe, "--no-images", *words
        code, out, err = command("run", source, "-o", folder, *words)
        path = Path(folder) / "office" / "manifest.json"
        return code, out + err, json.loads(path.read_text()) if path.exists() else None

    return run_recipe


def robot(shape="robot_radius: 0.25", threshold=100, track="true"):
    Path("p.yaml").write_text(PARAMETERS.format(shape=shape, threshold=threshold, track=track))
    return mapdeal.read_robot_parameters("p.yaml")


def reach_of(stages, **options):
    Path("r.yaml").write_text(f"stages:\n  - {stages}\n")
    steps = load_recipe("r.yaml", **options).steps
    return next(step.parameters for step in steps if step.name == "reach")


def test_the_example_reaches_its_goals(command):
    code, output, err = command("run", OFFICE, "-o", "out", "--recipe", RECIPE)
    assert code == 0, err
    assert "; 3 of 3 goals; " in output
    manifest = json.loads(Path("out/office/manifest.json").read_text())
    assert FILES | {"cost.npz", "inflated.pgm"} <= set(manifest["outputs"])
    assert manifest["figures"]["reach"]["goals"] == dict.fromkeys(["kitchen", "lab", "store"], True)
    answer = json.loads(Path("out/office/reach.json").read_text())
    assert [goal["reachable"] for goal in answer["goals"]] == [True] * 3
    with np.load("out/office/reach.npz") as layers:
        area = np.count_nonzero(layers["reachable"]) * 0.05**2
    assert answer["reachable_m2"] == pytest.approx(area)
    assert manifest["figures"]["reach"]["reachable_m2"] == pytest.approx(area)
    # the stage changes nothing: the other outputs are those of a run without it
    inflated = read_map("out/office/inflated.yaml").occupancy
    expected = mapdeal.inflate(read_map(OFFICE), radius=0.3).occupancy
    np.testing.assert_array_equal(inflated == 100, expected == 100)


def test_a_golden_run_fails_if_the_kitchen_is_no_longer_reachable(run, command):
    golden = ["--golden", "gold"]
    assert run(*golden, "--update-golden")[0] == 0
    assert run(*golden, folder="same")[0] == 0
    door = ["--point", "0.9,-0.825", "--point", "2.2,-0.825", "--value", "100"]
    assert command("edit", "line", OFFICE, "-o", "new/office.yaml", *door)[0] == 0
    code, output, manifest = run(*golden, source="new/office.yaml", folder="changed")
    assert code == 1
    (line,) = (line for line in output.splitlines() if line.startswith("office: reach: "))
    change = "reach.json, reach.npz differ: kitchen no longer reachable, reachable_m2 "
    assert line.startswith(f"office: reach: {change}")
    assert manifest["figures"]["reach"]["goals"] == {"kitchen": False, "lab": True, "store": True}


def test_a_goal_that_is_not_reached_gives_a_warning(run):
    words = ["--set", "reach.goals={cupboard: [9, 3], lift: [-7, 3]}"]
    code, output, manifest = run(*words)
    assert code == 1
    assert manifest["figures"]["reach"]["goals"] == {"cupboard": False, "lift": True}
    message = "reach: not reachable: cupboard (its cell is unknown)"
    assert output.count(message) == 1
    assert [text.endswith(message) for text in manifest["warnings"]] == [True]
    assert run(*words, "--strict", folder="strict")[0] == 1


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_run_with_params_file_reaches_the_cells_of_the_command(run, command):
    robot(threshold=65)
    code, output, manifest = run("--params-file", "p.yaml")
    assert code == 0, output
    words = "--from", "-8,0", "--to", "kitchen=3,-4", "--layers", "l.npz"
    code, out, err = command("reach", OFFICE, "--params-file", "p.yaml", *words)
    assert code == 0, err
    found = json.loads(out)["reachable_m2"]
    assert manifest["figures"]["reach"]["reachable_m2"] == pytest.approx(found)
    with np.load("l.npz") as by_command, np.load("out/office/reach.npz") as by_run:
        for name in ("reachable", "headings", "clearance", "widest"):
            np.testing.assert_array_equal(by_command[name], by_run[name])


@pytest.mark.usefixtures("mapdeal_warnings")
def test_threshold_shape_and_unknown_space_are_those_of_the_robot():
    own = robot(threshold=65)
    reach = reach_of(f"reach: {REACH_FIRST}", robot=own)
    assert reach["lethal_threshold"] == own.static_layers[-1].lethal_cost_threshold == 65
    assert not reach["through_unknown"]
    # planners use the circle inside the polygon of 16 corners
    assert reach["footprint"] == Footprint.circle(own.inscribed_radius)
    free = reach_of(f"reach: {REACH_FIRST}", robot=robot(track="false"))
    assert (free["through_unknown"], free["lethal_threshold"]) == (True, None)
    corners = "footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]'"
    assert len(reach_of(f"reach: {REACH_FIRST}", robot=robot(corners))["footprint"].vertices) == 4


@pytest.mark.usefixtures("mapdeal_warnings")
def test_parameters_in_the_recipe_override_the_robot():
    own = robot(threshold=65, track="false")
    reach = reach_of("reach: {through_unknown: no, lethal_threshold: 90}", robot=own)
    assert (reach["through_unknown"], reach["lethal_threshold"]) == (False, 90)
    reach = reach_of("esdf: {lethal_threshold: 65}\n  - reach", robot=robot(threshold=65))
    assert reach["lethal_threshold"] is None  # the field has its own
