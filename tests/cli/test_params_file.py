"""``--params-file``: the robot's own parameters in the commands that take its shape."""

import hashlib
import json
import math

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
TWO = NAV2.replace('"inflation_layer"]', '"inflation_layer", "wide"]') + (
    '      wide: {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 1.4, '
    "cost_scaling_factor: 0.7}\n"
)


@pytest.fixture
def hall(tmp_path):
    occupancy = np.zeros((17, 29), np.int8)
    occupancy[4:, 12] = 100
    occupancy[2, 20:24] = 50
    occupancy[9:13, 18:22] = -1
    write_map(tmp_path / "hall.npz", OccupancyGrid(occupancy, 0.15, (1.5, -2.0, 0.4)))
    return tmp_path / "hall.npz"


@pytest.fixture
def nav2(tmp_path):
    path = tmp_path / "nav2_params.yaml"
    path.write_text(NAV2)
    return path


@pytest.fixture
def ros1(tmp_path):
    (tmp_path / "common.yaml").write_text(COMMON)
    (tmp_path / "ours.yaml").write_text(GLOBAL)
    return ["--params-file", tmp_path / "common.yaml", "--params-file", tmp_path / "ours.yaml"]


def _expected(hall, *, inflation=0.85, factor=2.5, lookup="nav2", inscribed=INSCRIBED):
    occupancy = np.load(hall)["occupancy"]
    table = [
        static_layer_cost(value, 100, trinary=True, track_unknown=True, inscribed=99)
        for value in range(256)
    ]
    base = np.array(table, np.uint8)[occupancy.view(np.uint8)]
    return exponential_cost(
        base, 0.15, inscribed, inflation, factor, False, False, lookup=lookup, float32=True
    )


def _costs(path):
    return np.load(path)["cost"]


def test_costs_are_those_of_the_robots_own_parameters(command, hall, nav2, tmp_path):
    code, out, err = command("cost", hall, "-o", tmp_path / "c.npz", "--params-file", nav2)
    assert (code, out.count("\n")) == (0, 1)
    # the circumscribed radius, 0.4 m, lies well within the inflation radius
    assert err == f"{nav2}: ignored: obstacle_layer (reads sensors)\n"
    np.testing.assert_array_equal(_costs(tmp_path / "c.npz"), _expected(hall))
    assert not np.array_equal(_expected(hall), _expected(hall, lookup="exact"))


def test_a_run_makes_field_and_costs_and_keeps_the_robot_in_its_manifest(
    command, hall, nav2, tmp_path
):
    code, _, err = command("run", hall, "-o", tmp_path / "out", "--params-file", nav2)
    assert code == 0
    assert err == f"{nav2}: ignored: obstacle_layer (reads sensors)\n"
    folder = tmp_path / "out" / "hall"
    np.testing.assert_array_equal(_costs(folder / "cost.npz"), _expected(hall))
    manifest = json.loads((folder / "manifest.json").read_text())
    assert [list(one) for one in manifest["stages"]] == [["esdf"], ["cost"]]
    robot = manifest["robot"]
    sha256 = hashlib.sha256(NAV2.encode()).hexdigest()
    assert robot["files"] == [{"name": "nav2_params.yaml", "sha256": sha256}]
    assert robot["node"] == "/global_costmap/global_costmap"
    assert robot["inscribed_radius"] == pytest.approx(INSCRIBED, abs=1e-12)
    assert robot["circumscribed_radius"] == pytest.approx(CIRCUMSCRIBED, abs=1e-12)
    by_name = {one["name"]: one for one in robot["layers"]}
    assert by_name["inflation_layer"]["cost_scaling_factor"] == 2.5
    assert by_name["obstacle_layer"]["ignored"] == "reads sensors"
    info = command("info", folder)[1]
    robot_of_info = (
        "  robot       /global_costmap/global_costmap of nav2_params.yaml, inscribed_radius 0.2 m"
    )
    assert robot_of_info in info


def test_the_same_run_is_unchanged_until_the_parameters_change(command, hall, nav2, tmp_path):
    words = ["run", hall, "-o", tmp_path / "out", "--params-file", nav2, "--no-images", "-q"]
    assert command(*words)[0] == 0
    before = tree(tmp_path / "out")
    code, _, err = command(*words)
    assert (code, err) == (0, "")
    assert tree(tmp_path / "out") == before
    nav2.write_text(NAV2 + "# a remark\n")
    code, _, err = command(*words)
    assert code == 4
    assert "had other inputs, parameters" in err
    code, _, err = command("run", hall, "-o", tmp_path / "out", "--no-images", "-q")
    assert code == 4  # neither is a run without the robot the same


@pytest.mark.parametrize(
    ("options", "changes"),
    [
        (["--inflation-radius", 1.2], {"inflation": 1.2}),
        (["--cost-scaling-factor", 6], {"factor": 6.0}),
        (["--lookup", "exact"], {"lookup": "exact"}),
        (["--dialect", "humble"], {"lookup": "exact"}),
        (["--robot-radius", 0.6], {"inscribed": 0.6}),
    ],
)
def test_options_win_over_the_file(command, hall, nav2, tmp_path, options, changes):
    made = tmp_path / "c.npz"
    assert command("cost", hall, "-o", made, "--params-file", nav2, *options)[0] == 0
    np.testing.assert_array_equal(_costs(made), _expected(hall, **changes))
    if options[0] in ("--robot-radius", "--dialect"):
        run = options
    else:
        run = ["--set", f"cost.{options[0][2:]}={options[1]}"]
    assert command("run", hall, "-o", tmp_path / "out", "--params-file", nav2, *run)[0] == 0
    np.testing.assert_array_equal(
        _costs(tmp_path / "out" / "hall" / "cost.npz"), _expected(hall, **changes)
    )


def test_another_model_says_what_it_takes_of_the_file(command, hall, nav2, tmp_path):
    words = ["cost", hall, "-o", tmp_path / "c.npz", "--force", "--params-file", nav2, "--model"]
    code, _, err = command(*words, "rings")
    assert code == 0
    assert "warning: --params-file: model rings takes no shape and no costs" in err
    code, _, err = command(*words, "layers")
    assert (code, "warning" in err) == (0, False)
    np.testing.assert_array_equal(_costs(tmp_path / "c.npz"), _expected(hall))


def test_the_files_of_ros_1_are_taken_together(command, hall, ros1, tmp_path):
    code, _, err = command("cost", hall, "-o", tmp_path / "c.npz", *ros1)
    assert code == 0
    assert "sonar" in err
    expected = _expected(hall, lookup="exact")
    # ROS 1 pads by a double
    np.testing.assert_array_equal(_costs(tmp_path / "c.npz"), expected)


def test_two_inflation_layers_are_applied_one_after_the_other(command, hall, nav2, tmp_path):
    nav2.write_text(TWO)
    code, _, err = command("run", hall, "-o", tmp_path / "out", "--params-file", nav2)
    assert code == 0, err
    first = _expected(hall)
    both = exponential_cost(
        first, 0.15, INSCRIBED, 1.4, 0.7, False, False, lookup="nav2", float32=True
    )
    np.testing.assert_array_equal(_costs(tmp_path / "out" / "hall" / "cost.npz"), both)
    assert not np.array_equal(first, both)
    words = ["cost", hall, "-o", tmp_path / "c.npz", "--params-file", nav2]
    assert command(*words)[0] == 0
    np.testing.assert_array_equal(_costs(tmp_path / "c.npz"), both)
    code, _, err = command(*words, "--inflation-radius", 1, "--force")
    assert code == 2
    assert "there must be one inflation layer" in err


def test_inflate_takes_the_shape_and_what_is_lethal(command, hall, nav2, tmp_path):
    nav2.write_text(NAV2.replace("track_unknown", "lethal_cost_threshold: 50\n      track_unknown"))
    code, _, _ = command("inflate", hall, "-o", tmp_path / "i.npz", "--params-file", nav2)
    assert code == 0
    occupancy, grown = np.load(hall)["occupancy"], np.load(tmp_path / "i.npz")["occupancy"]
    rows, cols = np.nonzero(occupancy >= 50)
    row, col = np.indices(occupancy.shape)
    nearest = np.min([np.hypot(row - r, col - c) for r, c in zip(rows, cols, strict=True)], axis=0)
    np.testing.assert_array_equal(grown == 100, nearest * 0.15 <= CIRCUMSCRIBED)


def test_routes_go_through_the_robots_costs(command, hall, nav2, tmp_path):
    with np.load(hall) as layers:
        occupancy, (x, y, yaw) = layers["occupancy"], layers["origin"]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    # the costs know of no walls outside of the map, where the robot cannot go
    corner = turn @ np.array([-0.15, -0.15]) + [x, y]
    walled = OccupancyGrid(np.pad(occupancy, 1, constant_values=100), 0.15, (*corner, yaw))
    write_map(tmp_path / "walled.npz", walled)
    words = ["--params-file", nav2, "--to", "3.0,0.0"]
    start = ",".join(map(repr, (turn @ [1.5, 0.05] + [x, y]).tolist()))
    at_the_edge = command("route", hall, *words, "--from", start)
    assert at_the_edge[0] == 2
    assert "lies in a closed cell (cost 253)" in at_the_edge[2]
    hall = tmp_path / "walled.npz"
    command("cost", hall, "-o", tmp_path / "c.npz", "--params-file", nav2, "-q")
    ends = [
        ",".join(map(repr, (turn @ np.array(p) * 0.15 + [x, y]).tolist()))
        for p in ((3.5, 1.5), (25.5, 14.5))
    ]
    words = ["--from", ends[0], "--to", ends[1]]
    with_file = command("route", hall, *words, "--params-file", nav2)
    with_costs = command("route", tmp_path / "c.npz", *words)
    plain = command("route", hall, *words)
    assert with_file[0] == with_costs[0] == 0
    assert with_file[1] == with_costs[1] != plain[1]
    code, _, err = command("route", tmp_path / "c.npz", *words, "--params-file", nav2)
    assert code == 2
    assert "--params-file: applies to maps: these costs are already computed" in err


@pytest.mark.parametrize("option", [["--costmap", "local"], ["--namespace", "robot1"]])
def test_options_of_parameter_files_need_one(command, hall, tmp_path, option):
    code, _, err = command("cost", hall, "-o", tmp_path / "c.npz", *option)
    assert (code, err) == (2, f"error: {option[0]}: needs --params-file\n")


@pytest.mark.parametrize("name", ["run", "cost", "inflate", "route"])
def test_parameters_that_the_node_refuses_write_nothing(command, hall, nav2, tmp_path, name):
    nav2.write_text(NAV2.replace("inflation_radius: 0.85", "inflation_radius: 1"))
    words = [] if name == "route" else ["-o", tmp_path / "out.npz"]
    words += ["--from", "0,0", "--to", "1,1"] if name == "route" else []
    before = tree(tmp_path)
    code, out, err = command(name, hall, *words, "--params-file", nav2)
    assert (code, out) == (3, "")
    assert err.startswith(f"error: {nav2}: ")
    assert "line 12" in err
    assert "1.0" in err.splitlines()[-1]
    assert tree(tmp_path) == before


def _without_a_costmap(kind):
    if kind == "others":
        return (
            "amcl: {ros__parameters: {alpha1: 0.2}}\ncontroller_server: {ros__parameters: {x: 1}}\n"
        )
    if kind == "one level":
        return NAV2.replace("  global_costmap:\n", "")
    return "amcl:\n  ros__parameters:\n    # alpha1: 0.2\n" + NAV2


SAID = {
    "others": "holds no parameter of /global_costmap/global_costmap; it has /amcl, ",
    "one level": "line 2: applies to no node: Nav2's costmap is /global_costmap/global_costmap",
    "no value": "line 2: ros__parameters of amcl holds no parameters, and ROS 2 refuses the whole",
}


@pytest.mark.parametrize("kind", SAID)
def test_files_without_a_costmap_are_refused_by_all_commands(command, hall, tmp_path, kind):
    path = tmp_path / "others.yaml"
    path.write_text(_without_a_costmap(kind))
    before, given = tree(tmp_path), ("--params-file", path)
    for name, *rest in (
        ("run", hall, "-o", tmp_path / "out"),
        ("inflate", hall, "-o", tmp_path / "o.npz"),
        ("cost", hall, "-o", tmp_path / "o.npz"),
        ("route", hall, "-o", tmp_path / "o.json", "--from", "2,-1", "--to", "3,-1"),
        ("reach", hall, "-o", tmp_path / "o.json", "--from", "2,-1"),
        ("query", hall, "--at", "2,-1,0"),
    ):
        code, out, err = command(name, *rest, *given)
        assert (code, out) == (3, ""), name
        assert SAID[kind] in err
        assert err.startswith(f"error: {path}: ")
        assert "hint: " in err
    assert command("info", path)[0] == 3
    code, out, _ = command("lint", *given)
    assert code == 1
    assert SAID[kind].removeprefix("line 2: ") in out
    assert out.count(": error: ") == 1
    assert tree(tmp_path) == before


def test_no_output_replaces_the_parameter_file(command, hall, nav2, tmp_path):
    words = ["--params-file", nav2, "--force"]
    code, _, err = command("cost", hall, "-o", nav2, *words)
    assert code == 4, err
    assert nav2.read_text() == NAV2
    folder = tmp_path / "out" / "hall"
    folder.mkdir(parents=True)
    (folder / "nav2.yaml").write_text(NAV2)
    code, _, err = command("run", hall, "-o", tmp_path / "out", "--params-file",
                           folder / "nav2.yaml", "--force")  # fmt: skip
    assert code == 4
    assert "where the outputs go" in err


def test_warnings_of_the_parameters_are_kept_and_end_strict_runs(command, hall, nav2, tmp_path):
    lonely = NAV2.replace('["static_layer", "obstacle_layer", ', "[")
    nav2.write_text(lonely)
    words = ["run", hall, "-o", tmp_path / "out", "--params-file", nav2]
    code, _, err = command(*words, "--strict")
    assert code == 1
    assert not (tmp_path / "out").exists()
    code, _, err = command(*words)
    assert code == 0
    assert "no static layer" in err
    folder = tmp_path / "out" / "hall"
    assert set(np.unique(_costs(folder / "cost.npz"))) == {255}
    manifest = json.loads((folder / "manifest.json").read_text())
    assert any("no static layer" in text for text in manifest["warnings"])
    assert not any(str(tmp_path) in text for text in manifest["warnings"])
    assert [list(one) for one in manifest["stages"]] == [["cost"]]


def test_a_recipe_takes_the_shape_alone(command, hall, nav2, tmp_path):
    words = ["run", hall, "-o", tmp_path / "a", "--recipe", "default", "-q"]
    assert command(*words, "--params-file", nav2)[0] == 0
    stages = json.loads((tmp_path / "a" / "hall" / "manifest.json").read_text())["stages"]
    assert [list(one) for one in stages] == [["inflate"], ["esdf"], ["cost"]]
    assert stages[0]["inflate"]["radius"] == pytest.approx(CIRCUMSCRIBED, abs=1e-12)
    assert stages[2]["cost"]["inflation_radius"] == 0.55


def test_commands_that_take_the_shape_say_nothing_of_layers(command, hall, nav2, tmp_path):
    """An inflated map is none that "is all free", and no layer could have had a part in it."""
    nav2.write_text(NAV2.replace('["static_layer", "obstacle_layer", ', '["obstacle_layer", '))
    file = ["--params-file", nav2]
    code, _, err = command("inflate", hall, "-o", tmp_path / "i.npz", *file)
    assert (code, err) == (0, "")
    words = ["run", hall, "-o", tmp_path / "out", *file, "--strict"]
    code, _, err = command(*words, "--recipe", "default")
    assert (code, "layer" in err) == (0, False)
    code, _, err = command(*words, "--force")
    assert code == 1
    assert "no static layer" in err
    assert "ignored: obstacle_layer" in err


def test_info_says_what_a_file_comes_to_on_a_map(command, hall, nav2):
    code, out, err = command("info", nav2, "--map", hall)
    assert (code, err) == (0, "")
    assert "costmap       global, /global_costmap/global_costmap" in out
    assert "inscribed     0.2 m" in out
    assert "obstacle_layer (ObstacleLayer)    ignored: reads sensors" in out
    # ceil(0.85 / float32(0.15)) = 6
    assert "on the map    hall.npz: inflation_layer reaches 6 cells, 0.9 m" in out
    code, out, _ = command("info", nav2, "--json")
    report = json.loads(out)
    assert report["kind"] == "robot parameters"
    assert "on_map" not in report
    assert report["inscribed_radius"] == pytest.approx(INSCRIBED, abs=1e-12)


def test_info_takes_the_files_of_ros_1_as_one_robot(command, ros1, hall, nav2):
    files = ros1[1::2]
    code, out, _ = command("info", *files, nav2, hall, "--json")
    assert code == 0
    kinds = [json.loads(line)["kind"] for line in out.splitlines()]
    assert kinds == ["robot parameters", "robot parameters", "occupancy grid"]
    first = json.loads(out.splitlines()[0])
    assert [file["name"] for file in first["files"]] == ["common.yaml", "ours.yaml"]


def test_verbose_says_how_many_cells_the_older_queue_makes_different(command, real_maps, tmp_path):
    """Recorded: 28 cells, by 15, of the husky's costs on this map; and 10, by 5, of Nav2's."""
    husky = real_maps / "params" / "husky__husky" / "husky_navigation" / "config"
    ground = real_maps / "turtlebot__turtlebot_simulator/turtlebot_gazebo/maps/playground.yaml"
    files = ["costmap_common.yaml", "costmap_global_static.yaml"]
    words = [word for name in files for word in ("--params-file", husky / name)]
    told = "from the queue of older inflation layers, by"
    _, _, err = command("cost", ground, "-o", tmp_path / "a.npz", *words, "-v")
    assert f"cost: 28 cells differ {told} 15 at most" in err
    own = "ros-navigation__navigation2/nav2_bringup"
    words = ["--params-file", real_maps / "params" / own / "params/nav2_params.yaml"]
    depot = real_maps / own / "maps/depot.yaml"
    _, _, err = command("run", depot, "-o", tmp_path, *words, "--dialect", "humble", "-v",
                        "--no-images")  # fmt: skip
    assert f"cost: 10 cells differ {told} 5 at most" in err
    assert err.count("of grey 205") == 1
    for more in (["-v"], ["--dialect", "humble"]):  # Nav2 has no queue any more; or nobody asks
        words_ = ["cost", depot, "-o", tmp_path / "b.npz", "--force", *words, *more]
        assert "queue" not in command(*words_)[2]


def test_a_local_costmap_without_a_static_layer_gets_the_map_in_front(
    command, hall, nav2, tmp_path
):
    nav2.write_text(NAV2 + NAV2.replace("global", "local").replace('"static_layer", ', ""))
    words = ["cost", hall, "-o", tmp_path / "c.npz", "--params-file", nav2, "--costmap", "local"]
    code, _, err = command(*words)
    assert code == 0
    assert f"{nav2}: the local costmap has no static layer; the map is put in front" in err
    np.testing.assert_array_equal(_costs(tmp_path / "c.npz"), _expected(hall))
