"""Layers of small parameter files on a map of one row, and in windows around the robot."""

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import Frame, MapdealWarning, ObstacleLayer, OccupancyGrid, StaticLayer, layered_cost
from mapdeal.layers.catalogue import LAYERS
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.keepout import cells_at_centres
from mapdeal.layers.range_sensor import RangeSensorLayer
from mapdeal.layers.stack import CostmapLayers

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")

ROW = "#...??."
STATIC = 's: {plugin: "nav2_costmap_2d::StaticLayer"}'


def nav2(plugins, *sections, costmap="global", **parameters):
    lines = [f"{costmap}_costmap:", f"  {costmap}_costmap:", "    ros__parameters:"]
    lines += [f"      {name}: {value}" for name, value in parameters.items()]
    lines += [f"      {section}" for section in (f"plugins: [{', '.join(plugins)}]", *sections)]
    return "\n".join(lines) + "\n"


def ros1(types, *sections, costmap="global", **parameters):
    lines = [f"{costmap}_costmap:", *(f"  {name}: {value}" for name, value in parameters.items())]
    lines += ["  plugins:", *(f'    - {{name: {n}, type: "{t}"}}' for n, t in types.items())]
    return "\n".join([*lines, *(f"  {section}" for section in sections)]) + "\n"


@pytest.fixture
def cost(tmp_path, command):
    """Write a parameter file, run ``cost`` with it on a map, and return costs and messages."""

    def run(text, *options, drawing=ROW, expected=0, origin=(1.0, -2.0, 0.0)):
        mapdeal.write_map(tmp_path / "m.npz", grid_from_text(drawing, 0.1, origin), force=True)
        (tmp_path / "p.yaml").write_text(text)
        code, _, err = command(
            "cost", tmp_path / "m.npz", "-o", tmp_path / "c.npz", "--force",
            "--params-file", tmp_path / "p.yaml", *options,
        )  # fmt: skip
        assert code == expected, err
        return (None if code else mapdeal.read_map(tmp_path / "c.npz")), err

    return run


OBSTACLES = {"s": "costmap_2d::StaticLayer", "o": "costmap_2d::ObstacleLayer"}


@pytest.mark.parametrize(("text", "options", "expected"), [
    # ROS 1: an obstacle layer that does not track unknown space frees it
    (ros1(OBSTACLES, robot_radius=0.01), ["--dialect", "ros1"], [254, 0, 0, 0, 0, 0, 0]),
    (ros1(OBSTACLES, robot_radius=0.01, track_unknown_space="true"), ["--dialect", "ros1"],
     [254, 0, 0, 0, 255, 255, 0]),
    # the costmap's own parameter overrides that of an obstacle layer, but not of a voxel layer
    (ros1(OBSTACLES, "o: {track_unknown_space: false}", robot_radius=0.01,
          track_unknown_space="true"), [], [254, 0, 0, 0, 255, 255, 0]),
    (ros1(OBSTACLES | {"o": "costmap_2d::VoxelLayer"}, "o: {track_unknown_space: false}",
          robot_radius=0.01, track_unknown_space="true"), [], [254, 0, 0, 0, 0, 0, 0]),
    # ROS 1's reconfiguration limits the method of a voxel layer alone: -1 becomes 0
    (ros1(OBSTACLES | {"o": "costmap_2d::VoxelLayer"}, "o: {combination_method: -1}",
          robot_radius=0.01), [], [0] * 7),
    (ros1(OBSTACLES, "o: {combination_method: -1}", robot_radius=0.01), [],
     [254, 0, 0, 0, 255, 255, 0]),
    # combination_method 0 erases the map
    (nav2("so", STATIC, 'o: {plugin: "nav2_costmap_2d::ObstacleLayer", combination_method: 0}',
          robot_radius=0.01), [], [0] * 7),
    (nav2("so", STATIC, 'o: {plugin: "nav2_costmap_2d::ObstacleLayer", combination_method: 0}',
          robot_radius=0.01, track_unknown_space="true"), [], [254, 0, 0, 0, 255, 255, 0]),
    # a rolling static layer of older releases compares bytes
    (nav2("s", STATIC, costmap="local", robot_radius=0.01, rolling_window="true",
          use_maximum="true", track_unknown_space="true"),
     ["--costmap", "local", "--dialect", "humble"], [255] * 7),
    (nav2("s", STATIC, costmap="local", robot_radius=0.01, rolling_window="true",
          use_maximum="true", track_unknown_space="true"),
     ["--costmap", "local"], [254, 0, 0, 0, 255, 255, 0]),
    # sonars act without readings if their thresholds say so, else they have no effect
    (nav2("sr", STATIC, 'r: {plugin: "nav2_costmap_2d::RangeSensorLayer"}', robot_radius=0.01,
          track_unknown_space="true"), [], [254, 0, 0, 0, 255, 255, 0]),
    (nav2("sr", STATIC, 'r: {plugin: "nav2_costmap_2d::RangeSensorLayer", clear_threshold: 0.6}',
          robot_radius=0.01, track_unknown_space="true"), [], [254, 0, 0, 0, 0, 0, 0]),
    (nav2("sr", STATIC, 'r: {plugin: "nav2_costmap_2d::RangeSensorLayer", mark_threshold: 0.4}',
          robot_radius=0.01, track_unknown_space="true"), [], [254] * 7),
])  # fmt: skip
def test_layers_without_observations_act_on_the_master_grid(cost, text, options, expected):
    assert cost(text, *options)[0].cost.tolist() == [expected]


KEEPOUT = 'k: {plugin: "nav2_costmap_2d::KeepoutFilter", filter_info_topic: info}'
INFLATION = 'i: {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 0.3, '
INFLATION += "cost_scaling_factor: 3.0}"
ASYMMETRIC = INFLATION.replace("i: {", "j: {").replace("d::", "d::Asymmetric")
ASYMMETRIC = ASYMMETRIC.replace("factor: 3.0", "factor_left: 3.0, cost_scaling_factor_right: 3.0")
INFLATED = [122, 164, 222, 254, 222, 164, 122]
MASK_ALONE = [0, 0, 0, 254, 0, 0, 0]


@pytest.mark.parametrize(("plugins", "more", "parameters", "expected"), [
    ("ski", [], {}, INFLATED),
    ("skj", [ASYMMETRIC], {}, INFLATED),
    ("sik", [], {}, MASK_ALONE),
    ("si", ["filters: [k]"], {}, MASK_ALONE),
    ("si", ["other: 1"], {}, MASK_ALONE),  # no filter is listed
    ("ski", ["filters: [f]", KEEPOUT.replace("k:", "f:")], {}, INFLATED),
    ("ksi", [], {}, [0] * 7),  # the static layer overwrites the mask
    ("ksi", [], {"use_maximum": "true"}, INFLATED),
])  # fmt: skip
def test_keepout_filters_act_where_they_are(cost, tmp_path, plugins, more, parameters, expected):
    mask = OccupancyGrid([[0, 0, 0, 100, 0, 0, 0]], 0.1, (1.0, -2.0, 0.0))
    mapdeal.write_map(tmp_path / "k.npz", mask)
    text = nav2(plugins, STATIC, KEEPOUT, INFLATION, *more, robot_radius=0.05,
                track_unknown_space="true", **parameters)  # fmt: skip
    found, err = cost(text, "--mask", tmp_path / "k.npz", drawing=".......")
    assert found.cost.tolist() == [expected]
    assert ("params.mask-unused" in err) == (expected == [0] * 7)


def test_a_mask_without_use_is_warned_of(cost, tmp_path):
    mask = OccupancyGrid([[100] * 7], 0.1, (1.0, -2.0, 0.0))
    mapdeal.write_map(tmp_path / "k.npz", mask)
    text = nav2("s", STATIC, "filters: [k]", KEEPOUT[:-1] + ", enabled: false}", robot_radius=0.1)
    found, err = cost(text, "--mask", tmp_path / "k.npz")
    assert found.cost.tolist() == [[254, 0, 0, 0, 0, 0, 0]]
    assert "the keepout mask has no effect: k is switched off (params.mask-unused)" in err
    cost(text, "--mask", tmp_path / "k.npz", "--strict", expected=1)
    grid = mapdeal.read_map(tmp_path / "m.npz")
    robot = mapdeal.read_robot_parameters(tmp_path / "p.yaml")
    with pytest.warns(MapdealWarning, match=r"params\.mask-unused"):
        products = mapdeal.apply_recipe(grid, robot, mask=mask)
    assert products["cost"].cost.tolist() == found.cost.tolist()


def test_reach_sees_a_mask_that_is_inflated(cost, tmp_path, command):
    """The gap beside the zone is wider than the robot, but not once the zone is inflated."""
    drawing = "\n".join(["." * 40] * 16)
    mask = np.zeros((16, 40), np.int8)
    mask[:6, 20] = 100
    mapdeal.write_map(tmp_path / "k.npz", OccupancyGrid(mask, 0.1, (1.0, -2.0, 0.0)))
    ask = ["reach", tmp_path / "m.npz", "--from", "1.8,-1.2", "--to", "4.2,-1.2", "--json",
           "--params-file", tmp_path / "p.yaml", "--mask", tmp_path / "k.npz"]  # fmt: skip
    for plugins, is_reached in (("sik", True), ("ski", False)):
        cost(nav2(plugins, STATIC, KEEPOUT, INFLATION, robot_radius=0.52), drawing=drawing)
        code, out, _ = command(*ask)
        assert json.loads(out)["goals"][0]["reachable"] is is_reached
        assert code == (0 if is_reached else 1)


def test_layers_that_are_not_modelled_are_named_whatever_their_class_is_called(cost):
    zone = "my_layers::OrangeZoneLayer"
    text = nav2("sz", STATIC, f'z: {{plugin: "{zone}"}}', robot_radius=0.1)
    assert f"{zone} is not modelled: its costs are left out" in cost(text)[1]
    cost(text, "--strict", expected=1)
    zones = "costmap_prohibition_layer_namespace::CostmapProhibitionLayer"
    text = ros1({"s": "costmap_2d::StaticLayer", "z": zones}, robot_radius=0.1)
    assert f"z ({zones}) is not modelled: its costs are left out" in cost(text)[1]
    cost(text, "--strict", expected=1)


ROBOT1 = "robot1:\n" + "".join(
    f"  {line}\n" for line in nav2("s", STATIC, track_unknown_space="true").splitlines()
)


def test_a_wildcard_beside_a_robot_in_a_namespace_does_not_hide_it(cost):
    wildcard = "/**:\n  ros__parameters:\n    robot_radius: 0.3\n"
    found, err = cost(wildcard + ROBOT1)
    assert found.cost.tolist() == [[254, 0, 0, 0, 255, 255, 0]]
    assert "uses the namespace robot1, the only one with such a node" in err
    err = cost(wildcard + ROBOT1 + ROBOT1.replace("robot1", "robot2"), expected=3)[1]
    assert "holds several robots, in the namespaces robot1, robot2" in err
    found, err = cost(wildcard + ROBOT1, "--namespace", "/")  # the root node: default layers
    assert found.cost[0, 4] != 255
    assert "robot1" not in err
    err = cost(wildcard + ROBOT1, "--costmap", "local", expected=3)[1]
    assert "--costmap global selects the costmap that the files have" in err
    err = cost(ROBOT1, "--namespace", "/")[1]
    assert "no parameters of /global_costmap/global_costmap: it has Nav2's defaults" in err


def window(**parameters):
    return nav2("s", STATIC, costmap="local", rolling_window="true", width=1, height=1,
                resolution=0.25, robot_radius=0.01, track_unknown_space="true",
                **parameters)  # fmt: skip


POSE = ["--costmap", "local", "--pose"]
DRAWING = "\n".join(["#...", "....", "..??", ".#.."])


def test_a_window_holds_the_cells_around_the_robot(cost):
    """Cells of 0.25 m over a map of 0.1 m: the value is that below each centre."""
    text = window(global_frame="map")
    for origin, step in (((1.0, -2.0, 0.0), 1), ((1.5, -1.5, np.pi), -1)):
        found, _ = cost(text, *POSE, "1.3,-1.8,0", drawing=DRAWING, origin=origin)
        assert found.resolution == 0.25
        # the corner is at 0.8, -2.3, and has moved from 0 by whole cells
        assert found.origin == (0.75, -2.25, 0.0)
        # centres at 0.875, 1.125, 1.375, 1.625 and -2.125, -1.875, -1.625, -1.375
        expected = [[255] * 4, [255, 0, 255, 255], [255, 0, 0, 255], [255] * 4]
        assert found.cost[::step, ::step].tolist() == expected


def test_sizes_of_older_windows_end_in_the_middle_of_the_last_cell(cost):
    of_map = window(global_frame="map")
    for text, x, dialect, origin in (
        (of_map, 1.6, "nav2", 1.0), (of_map, 1.6, "humble", 1.0), (window(), 1.63, "humble", 1.0),
        (window(), 1.7, "humble", 1.25), (window(), 1.7, "nav2", 1.0),
    ):  # fmt: skip
        found, _ = cost(text, *POSE, f"{x},-1.8,0", "--dialect", dialect, drawing=DRAWING)
        assert found.origin[0] == origin


def test_windows_lie_in_the_frame_of_the_costmap(cost):
    text = window(global_frame="odom")
    turned, err = cost(text, *POSE, "0.3,0.2,0", "--map-to-odom", "1.2,-1.9,0", drawing=DRAWING)
    assert "map_to_odom" not in err
    assert turned.origin == (0.0, -0.25, 0.0)  # of odom
    assert turned.cost[1].tolist() == [0, 255, 255, 255]
    err = cost(text, *POSE, "1.3,-1.8,0", drawing=DRAWING)[1]
    assert "global_frame is odom, and map_to_odom is not given" in err
    err = cost(window(), *POSE, "1.3,-1.8,0", "--map-to-odom", "0,0,1", drawing=DRAWING)[1]
    assert "map_to_odom has no effect" in err
    err = cost(text, "--costmap", "local", "--map-to-odom", "0,0,1", expected=2)[1]
    assert "needs pose" in err


def test_a_window_gets_no_static_layer_that_its_file_does_not_list(cost):
    text = nav2("o", 'o: {plugin: "nav2_costmap_2d::ObstacleLayer"}', costmap="local",
                rolling_window="true", robot_radius=0.1, width=1, height=1)  # fmt: skip
    assert not cost(text, *POSE, "1.3,-1.8,0", drawing=DRAWING)[0].cost.any()
    assert cost(text, "--costmap", "local", drawing=DRAWING)[0].cost.any()


def test_the_robot_frees_what_it_covers_where_its_pose_is_known(cost):
    obstacles = 'o: {plugin: "nav2_costmap_2d::ObstacleLayer", combination_method: 0}'
    corners = '"[[0.04, 0.04], [0.04, -0.04], [-0.14, -0.04], [-0.14, 0.04]]"'
    text = nav2("so", STATIC, obstacles, track_unknown_space="true", footprint_padding="0.0",
                footprint=corners)  # fmt: skip
    drawing = "\n".join(["#####"] * 3)
    assert (cost(text, drawing=drawing)[0].cost == 254).all()
    found = cost(text, "--pose", "1.25,-1.85,0", drawing=drawing)[0]
    assert found.cost.tolist() == [[254] * 5, [254, 0, 0, 254, 254], [254] * 5]
    assert (cost(text, "--pose", "5,5,0", drawing=drawing)[0].cost == 254).all()


def test_a_costmap_of_ros_1_without_a_map_has_the_size_of_its_parameters(cost):
    text = ros1({"o": "costmap_2d::ObstacleLayer"}, robot_radius=0.1, width=3, height=2,
                resolution=0.5, origin_x=-1.5, origin_y=4.0)  # fmt: skip
    found, err = cost(text)
    assert (found.shape, found.origin, found.resolution) == ((4, 6), (-1.5, 4.0, 0.0), 0.5)
    assert "no static layer" in err


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer.key)
def test_every_layer_goes_through_recipes_and_describes_its_effect(layer):
    default = layer()
    grid = grid_from_text("#..?", resolution=0.5)
    costs = layered_cost(grid, layers=["static", {layer.key: {"name": "mine"}}, default])
    same = layered_cost(grid, layers=["static", default.described(), default])
    assert np.array_equal(costs.cost, same.cost)
    assert layer.about
    assert default.effect()
    assert {"plugin", "enabled"} <= layer.known_parameters("")
    assert layer.nav2_plugins


@given(st.floats(-3.0, 3.0), st.sampled_from([0.06, 0.1, 0.25]))
def test_a_mask_is_read_at_the_centres_of_cells(turn, side):
    costs, mask = Frame(7, 9, 0.1, (1.53, -2.04, 0.4)), Frame(40, 50, side, (0.2, -3.0, 0.4 + turn))
    places = costs.xy_from_rowcol(list(np.ndindex(costs.shape))[18:54])
    expected = mask.unbounded_rowcol_from_xy(places).reshape(4, 9, 2)
    for axis, cells in enumerate(cells_at_centres(costs, mask, slice(2, 6))):
        assert np.array_equal(np.broadcast_to(cells, (4, 9)), expected[..., axis])


@pytest.mark.parametrize(("clear", "unknown"), [(0.2, [False, True]), (0.6, [False, False])])
def test_sonars_without_readings_keep_cells_unknown_unless_they_free_all(clear, unknown):
    layer = RangeSensorLayer(clear_threshold=clear)
    assert [layer.unknown_after(is_unknown) for is_unknown in (False, True)] == unknown


def test_layers_below_one_that_overwrites_all_are_left_out():
    erasing = ObstacleLayer(combination_method=0)
    layers = CostmapLayers((StaticLayer(), InflationLayer(), erasing, InflationLayer("last")))
    assert layers.effective == (erasing, InflationLayer("last"))
    tracking = ObstacleLayer(track_unknown_space=True)
    layers = CostmapLayers((StaticLayer(track_unknown_space=False), tracking, ObstacleLayer()))
    assert layers.effective == (StaticLayer(track_unknown_space=False),)
