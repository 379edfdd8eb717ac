import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

from bad_maps import tree
from mapdeal import OccupancyGrid, write_map
from oracles import exponential_cost, static_layer_cost

NAV2 = """\
global_costmap:
  global_costmap:
    ros__parameters:
      footprint: "[[0.3, 0.15], [0.3, -0.15], [-0.2, -0.15], [-0.2, 0.15]]"
      footprint_padding: 0.05
      track_unknown_space: true
      plugins: ["static_layer", "obstacle_layer", "inflation_layer"]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
      obstacle_layer: {plugin: "nav2_costmap_2d::ObstacleLayer"}
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
        inflation_radius: 0.85
        cost_scaling_factor: 2.5
"""
INSCRIBED = float(np.float32(0.15)) + float(np.float32(0.05))
CIRCUMSCRIBED = math.hypot(float(np.float32(0.3)) + float(np.float32(0.05)), INSCRIBED)

COMMON = "footprint: [[0.3, 0.15], [0.3, -0.15], [-0.2, -0.15], [-0.2, 0.15]]\n"
COMMON += "footprint_padding: 0.05\ninflation: {inflation_radius: 0.85, cost_scaling_factor: 2.5}\n"
GLOBAL = """\
global_costmap:
  plugins:
    - {name: static, type: "costmap_2d::StaticLayer"}
    - {name: sonar, type: "range_sensor_layer::RangeSensorLayer"}
    - {name: inflation, type: "costmap_2d::InflationLayer"}
"""


HALL = np.zeros((17, 29), np.int8)
HALL[4:, 12] = 100
HALL[2, 20:24] = 50
HALL[9:13, 18:22] = -1


@pytest.fixture(autouse=True)
def nav2(here):
    """The map of a hall, parameters of both kinds, and a function that writes others."""
    write_map("hall.npz", OccupancyGrid(HALL, 0.15, (1.5, -2.0, 0.4)))
    Path("common.yaml").write_text(COMMON)
    Path("ours.yaml").write_text(GLOBAL)
    Path("nav2.yaml").write_text(NAV2)
    return Path("nav2.yaml").write_text


def costs_of(name, *, inflation=0.85, factor=2.5, lookup="nav2", inscribed=INSCRIBED, base=None):
    """A file has the costs that costmap_2d makes; return those."""
    if base is None:
        layer = {"trinary": True, "track_unknown": True, "inscribed": 99}
        table = np.array([static_layer_cost(v, 100, **layer) for v in range(256)], np.uint8)
        base = table[HALL.view(np.uint8)]
    figures = 0.15, inscribed, inflation, factor, False, False
    expected = exponential_cost(base, *figures, lookup=lookup, float32=True)
    np.testing.assert_array_equal(np.load(name)["cost"], expected)
    return expected


def manifest_of(folder):
    return json.loads(Path(folder, "manifest.json").read_text())


FILE = "--params-file nav2.yaml"
COST, RUN = f"cost hall.npz -o c.npz {FILE}", f"run hall.npz -o out {FILE} --no-images"
OF_RUN = "out/hall/cost.npz"
IGNORED = (
    "nav2.yaml: ignored: obstacle_layer (no observations)\nwarning: hall.npz: the robot's costmap "
    "ignores the yaw of the map, so places on it differ; rotate --yaw 0 turns the cells instead\n"
)


def test_costs_are_those_of_the_robots_own_parameters(sh):
    # the circumscribed radius, 0.4 m, lies well within the inflation radius
    assert sh(COST)[::2] == (0, IGNORED)
    costs_of("c.npz")


def test_a_run_makes_field_and_costs_and_keeps_the_robot_in_its_manifest(sh):
    assert sh.err(RUN) == IGNORED
    costs_of(OF_RUN)
    manifest = manifest_of("out/hall")
    assert [list(stage) for stage in manifest["stages"]] == [["esdf"], ["cost"]]
    robot = manifest["robot"]
    sha256 = hashlib.sha256(NAV2.encode()).hexdigest()
    assert robot["files"] == [{"name": "nav2.yaml", "sha256": sha256}]
    assert robot["node"] == "/global_costmap/global_costmap"
    assert robot["inscribed_radius"] == pytest.approx(INSCRIBED, abs=1e-12)
    assert robot["circumscribed_radius"] == pytest.approx(CIRCUMSCRIBED, abs=1e-12)
    by_name = {layer["name"]: layer for layer in robot["layers"]}
    assert by_name["inflation_layer"]["cost_scaling_factor"] == 2.5
    assert by_name["obstacle_layer"]["needs"] == "observations"
    line = "/global_costmap/global_costmap of nav2.yaml, inscribed_radius 0.2 m"
    assert f"  robot       {line}" in sh("info out/hall")[1]


def test_the_same_run_is_unchanged_until_the_parameters_change(sh, here, nav2):
    line = f"{RUN} -q"
    assert sh(line)[0] == 0
    before = tree(here / "out")
    sh.ok(line)
    assert tree(here / "out") == before
    nav2(NAV2 + "# a remark\n")
    assert "had other inputs, parameters" in sh.err(line, 4)
    assert sh("run hall.npz -o out --no-images -q")[0] == 4  # nor is one without the robot the same


@pytest.mark.parametrize(("option", "value", "changes"), [
    ("--inflation-radius", 1.2, {"inflation": 1.2}),
    ("--cost-scaling-factor", 6, {"factor": 6.0}),
    ("--lookup", "exact", {"lookup": "exact"}),
    ("--dialect", "humble", {"lookup": "exact"}),
    ("--robot-radius", 0.6, {"inscribed": 0.6}),
])  # fmt: skip
def test_options_win_over_the_file(sh, option, value, changes):
    of_run = option if option in ("--robot-radius", "--dialect") else f"--set cost.{option[2:]}"
    assert sh(f"{COST} {option}={value}")[0] == sh(f"{RUN} {of_run}={value}")[0] == 0
    costs_of("c.npz", **changes)
    costs_of(OF_RUN, **changes)


def test_another_model_warns_of_what_it_ignores_of_the_file(sh):
    warning = "warning: --params-file: model rings takes no shape and no costs"
    assert warning in sh.err(f"{COST} --model rings")
    assert sh.err(f"{COST} --model layers --force") == IGNORED
    costs_of("c.npz")


def test_the_files_of_ros_1_are_taken_together(sh):
    files = "--params-file common.yaml --params-file ours.yaml"
    assert "sonar" in sh.err(f"cost hall.npz -o c.npz {files}")
    costs_of("c.npz", lookup="exact")  # ROS 1 pads by a double
    out = sh("info common.yaml ours.yaml nav2.yaml hall.npz --json")[1]
    first, *documents = [json.loads(line) for line in out.splitlines()]
    assert [document["kind"] for document in documents] == ["robot parameters", "occupancy grid"]
    assert [file["name"] for file in first["files"]] == ["common.yaml", "ours.yaml"]


def test_inflate_takes_the_shape_and_what_is_lethal(sh, nav2):
    nav2(NAV2.replace("track_unknown", "lethal_cost_threshold: 50\n      track_unknown"))
    assert sh(f"inflate hall.npz -o i.npz {FILE}")[0] == 0
    row, col = np.indices(HALL.shape)
    nearest = np.min([np.hypot(row - r, col - c) for r, c in np.argwhere(HALL >= 50)], axis=0)
    grown = np.load("i.npz")["occupancy"] == 100
    np.testing.assert_array_equal(grown, nearest * 0.15 <= CIRCUMSCRIBED)


def test_routes_go_through_the_robots_costs(sh):
    yaw = 0.4
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])

    def at(x, y):
        return ",".join(map(repr, (turn @ [x, y] + [1.5, -2.0]).tolist()))

    err = sh.err(f"route hall.npz --from {at(1.5, 0.05)} --to 3,0 {FILE}", 2)
    assert "lies in a closed cell (cost 253)" in err
    # the costs know of no walls outside of the map, where the robot cannot go
    corner = turn @ np.array([-0.15, -0.15]) + [1.5, -2.0]
    walled = np.pad(HALL, 1, constant_values=100)
    write_map("walled.npz", OccupancyGrid(walled, 0.15, (*corner, yaw)))
    sh(f"cost walled.npz -o c.npz {FILE} -q")
    ends = f"--from {at(0.525, 0.225)} --to {at(3.825, 2.175)}"
    with_file, with_costs = sh(f"route walled.npz {ends} {FILE}"), sh(f"route c.npz {ends}")
    assert with_file[0] == with_costs[0] == 0
    assert with_file[1] == with_costs[1] != sh(f"route walled.npz {ends}")[1]
    message = "--params-file: applies to maps: these costs are already computed"
    assert message in sh.err(f"route c.npz {ends} {FILE}", 2)


@pytest.mark.parametrize(("text", "place", "message"), [
    (NAV2.replace("us: 0.85", "us: 1"), "line 12", ": must be a double, is an integer"),
    (NAV2.replace("  global_costmap:\n", ""), "line 2", "applies to no node: Nav2's cost"),
    (f"amcl:\n  ros__parameters:\n    # x: 1\n{NAV2}", "line 2", "holds no parameters, a"),
    ("amcl: {ros__parameters: {alpha1: 0.2}}\ncontroller_server: {ros__parameters: {x: 1}}\n", "",
     "holds no parameter of /global_costmap/global_costmap; it has /amcl, "),
], ids=["type", "level", "none", "others"])  # fmt: skip
def test_what_the_node_refuses_is_refused_by_all_commands(sh, here, nav2, text, place, message):
    nav2(text)
    before = tree(here)
    for line in (
        "run hall.npz -o out", "inflate hall.npz -o o.npz", "cost hall.npz -o o.npz",
        "route hall.npz -o o.json --from 2,-1 --to 3,-1", "reach hall.npz -o o.json --from 2,-1",
        "query hall.npz --at 2,-1,0",
    ):  # fmt: skip
        code, out, err = sh(f"{line} {FILE}")
        assert (code, out) == (3, ""), line
        assert err.startswith("error: nav2.yaml: ")
        assert all(text in err for text in (place, message, "hint: "))
    assert sh("info nav2.yaml")[0] == 3
    code, out, _ = sh(f"lint {FILE}")
    assert (code, out.count(": error: "), message in out) == (1, 1, True)
    assert tree(here) == before


def test_warnings_of_the_parameters_are_kept_and_end_strict_runs(sh, here, nav2):
    nav2(NAV2.replace('["static_layer", "obstacle_layer", ', "["))
    assert sh(f"{RUN} --strict")[0] == 1
    assert not Path("out").exists()
    assert "no static layer" in sh.err(RUN)
    assert set(np.unique(np.load(OF_RUN)["cost"])) == {255}
    manifest = manifest_of("out/hall")
    assert any("no static layer" in text for text in manifest["warnings"])
    assert not any(str(here) in text for text in manifest["warnings"])
    assert [list(stage) for stage in manifest["stages"]] == [["cost"]]
    for before, after, text in (
        ("inflation_radius", "inflation_raduis", "12: no parameter is called inflation_layer.inf"),
        ("0.15", "30.0", "4: footprint: 30.05 m from the centre to a corner is unusual"),
    ):
        nav2(NAV2.replace(before, after))
        err = sh.err(f"{COST} --strict", 1)
        assert (f"nav2.yaml:{text}" in err, "inscribed radius" in err) == (True, False)


def test_a_recipe_takes_the_shape_alone_and_says_nothing_of_layers(sh, nav2):
    """The map is inflated, so no warning may call it all free, nor name layers."""
    nav2(NAV2.replace('["static_layer", "obstacle_layer", ', '["obstacle_layer", '))
    sh.ok(f"inflate hall.npz -o i.npz {FILE}")
    assert "layer" not in sh.err(f"{RUN} --recipe default")
    inflate, _, cost = manifest_of("out/hall")["stages"]
    assert inflate["inflate"]["radius"] == pytest.approx(CIRCUMSCRIBED, abs=1e-12)
    assert cost["cost"]["inflation_radius"] == 0.55
    err = sh.err(f"{RUN} --strict --force", 1)
    assert "no static layer" in err
    assert "ignored: obstacle_layer" in err


def test_info_says_what_a_file_comes_to_on_a_map(sh):
    # ceil(0.85 / float32(0.15)) = 6
    line = "on the map    hall.npz: inflation_layer reaches 6 cells, 0.9 m"
    assert line in sh.ok("info nav2.yaml --map hall.npz")
    report = sh.json("info nav2.yaml --json")
    assert (report["kind"], "on_map" in report) == ("robot parameters", False)
    assert report["inscribed_radius"] == pytest.approx(INSCRIBED, abs=1e-12)


def test_a_local_costmap_without_a_static_layer_gets_the_map_in_front(sh, nav2):
    nav2(NAV2 + NAV2.replace("global", "local").replace('"static_layer", ', ""))
    message = "nav2.yaml: the local costmap has no static layer; the map is put in front"
    assert message in sh.err(f"{COST} --costmap local")
    costs_of("c.npz")
