"""A robot's own parameters from Python."""

import json
from pathlib import Path

import numpy as np

import mapdeal
from bad_maps import tree

EXAMPLES = Path(__file__).parents[2] / "examples"
NAV2 = EXAMPLES / "robots" / "nav2_params.yaml"
OFFICE = EXAMPLES / "maps" / "office.yaml"


def test_a_run_for_a_robot_is_the_commands(command, tmp_path):
    robot = mapdeal.read_robot_parameters(NAV2)
    report = mapdeal.run(OFFICE, tmp_path / "python", robot, images=False)
    words = ["--params-file", NAV2, "--no-images", "-q"]
    assert command("run", OFFICE, "-o", tmp_path / "command", *words)[0] == 0
    assert tree(tmp_path / "python") == tree(tmp_path / "command")
    manifest = json.loads((report.folder / "manifest.json").read_text())
    assert manifest["robot"] == robot.described()


def test_a_grid_gets_the_costs_of_a_robot_and_changes_of_them():
    robot = mapdeal.read_robot_parameters([NAV2])
    grid = mapdeal.read_map(OFFICE)
    made = mapdeal.apply_recipe(grid, robot)
    assert list(made) == ["esdf", "cost"]
    # by hand: 252 exp(-4 (0.30 - 0.19)) at six cells of float32(0.05) m
    costs = made["cost"].cost
    assert {253, 162} <= set(np.unique(costs).tolist())
    wider = mapdeal.apply_recipe(grid, robot, {"cost.inflation_radius": 0.9})["cost"].cost
    assert (wider > 0).sum() > (costs > 0).sum()
    round_ = mapdeal.load_recipe(robot, footprint=mapdeal.Footprint.circle(0.3))
    assert round_.described()[-1]["cost"]["inscribed_radius"] == 0.3


def test_the_local_costmap_and_older_inflation_can_be_asked_for():
    local = mapdeal.read_robot_parameters(NAV2, costmap="local")
    assert local.rolling_window
    assert [layer.name for layer in local.static_layers] == ["injected_static"]
    assert [one.lookup for one in local.inflation_layers] == ["nav2"]
    older = mapdeal.read_robot_parameters(NAV2, dialect="humble")
    assert [one.lookup for one in older.inflation_layers] == ["exact"]
