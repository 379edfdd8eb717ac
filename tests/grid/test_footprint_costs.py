"""What a robot costs at poses."""

import json

import numpy as np
import pytest

from drawn import grid_from_text
from engines import ENGINES
from mapdeal import Costmap, Footprint, Polygon, draw, footprint_costs, read_map
from mapdeal.errors import ParameterError
from mapdeal.kernels import engine

ROBOT = Footprint.polygon([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]])


def costmap(rng, shape=(40, 60), resolution=0.1, origin=(1.5, -2.0, 0.0), **chances):
    values = np.array([0, 60, 253, 254, 255], np.uint8)
    cells = rng.choice(values, shape, p=[0.8, 0.1, 0.05, 0.03, 0.02])
    return Costmap(cells, resolution, origin)


@pytest.fixture
def recorded(real_maps, mapdeal_warnings):
    """What Nav2's own code said: costs of maps, footprints, poses, and their costs."""
    folder = real_maps / "expected"
    told = json.loads((folder / "params.json").read_text())["footprint_poses"]
    with (
        np.load(folder / "footprint_poses.npz") as poses,
        np.load(folder / "params_costmaps.npz") as costmaps,
    ):
        cases = []
        for case in told:
            grid = read_map(real_maps / case["map"])
            name = case["costmap"].removeprefix("the case ")
            if name == case["costmap"]:
                costs = Costmap.from_static_layer(grid)
            else:
                cells = costmaps[name.replace(" (distance_transform)", "|distance_transform")]
                costs = Costmap(cells, grid.resolution, grid.origin)
            key = case["key"]
            arrays = [poses[f"{key}_{what}"] for what in ("footprint", "poses", "cost")]
            cases.append((key, costs, *arrays))
    return cases


@pytest.mark.parametrize("name", ENGINES)
def test_all_recorded_costs_of_nav2_are_equal(recorded, monkeypatch, name):
    monkeypatch.setenv(engine.VARIABLE, name)
    count = 0
    for key, costs, corners, poses, expected in recorded:
        found = footprint_costs(costs, Footprint(tuple(map(tuple, corners.tolist()))), poses)
        assert found.dtype == np.uint8
        assert np.array_equal(found, expected), key
        count += len(found)
    assert count == 50_000


def test_a_full_footprint_is_never_better_than_its_outline(recorded):
    worse = 0
    for _, costs, corners, poses, outline in recorded:
        robot = Footprint(tuple(map(tuple, corners.tolist())))
        full = footprint_costs(costs, robot, poses, rule="full").astype(int)
        order = [np.where(one == 254, 256, one) for one in (outline.astype(int), full)]
        assert (order[1] >= order[0]).all()
        worse += int((order[1] > order[0]).sum())
    assert worse > 1000


def test_a_full_footprint_meets_all_cells_that_drawing_it_covers():
    rng = np.random.default_rng(3)
    costs = costmap(rng)
    blank = Costmap(np.zeros(costs.shape, np.uint8), costs.resolution, costs.origin)
    seen = set()
    for _ in range(300):
        x, y = rng.uniform((2.3, -1.3), (6.6, 1.2))
        yaw = rng.uniform(-4, 4)
        cos, sin = np.cos(yaw), np.sin(yaw)
        corners = np.array(ROBOT.vertices) @ [[cos, sin], [-sin, cos]] + [x, y]
        covered = costs.cost[draw(blank, [Polygon(corners.tolist(), value=1)]).cost == 1]
        assert len(covered) > 20
        expected = 254 if 254 in covered else covered.max()
        cost = footprint_costs(costs, ROBOT, (x, y, yaw), rule="full")[0]
        outline = footprint_costs(costs, ROBOT, (x, y, yaw))[0]
        assert cost in (expected, outline)  # whose last line may meet a cell more
        seen.add((expected, cost == expected))
    assert {(cost, True) for cost in (60, 253, 254, 255)} <= seen


@pytest.mark.parametrize("yaw", [0.4, -2.9, np.pi / 2])
def test_the_yaw_of_a_map_turns_nothing_but_the_frame(yaw):
    rng = np.random.default_rng(5)
    level = costmap(rng)
    turned = Costmap(level.cost, level.resolution, (1.5, -2.0, yaw))
    poses = rng.uniform((1.5, -2.0, -3), (7.5, 2.0, 3), (3000, 3))
    places = level.frame.continuous_rowcol_from_xy(poses[:, :2])
    moved = np.column_stack([turned.frame.xy_from_continuous_rowcol(places), poses[:, 2] + yaw])
    expected = footprint_costs(level, ROBOT, poses)
    # the side of a cell is a float32 in here, and corners may lie on edges up to rounding
    assert (footprint_costs(turned, ROBOT, moved) != expected).mean() < 0.001
    assert len(np.unique(expected)) == 5


def test_the_side_of_a_cell_is_the_float32_of_a_map_message():
    costs = Costmap(np.arange(200, dtype=np.uint8).reshape(1, 200), 0.05)
    robot = Footprint(((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)))
    # 8.0 / 0.05 is 160 on paper; of ROS's 0.0500000007 it is 159.9999976
    assert footprint_costs(costs, robot, [[8.0, 0.0, 0.0], [8.000001, 0.0, 0.0]]).tolist() == [
        159,
        160,
    ]
    assert footprint_costs(costs, robot, (10.0, 0.0, 0.0)).tolist() == [199]


def test_a_round_robot_is_the_polygon_of_16_corners():
    rng = np.random.default_rng(6)
    costs = costmap(rng)
    poses = rng.uniform((1.5, -2.0, -3), (7.5, 2.0, 3), (500, 3))
    round_one = footprint_costs(costs, Footprint.circle(0.3), poses)
    assert round_one.tolist() == footprint_costs(costs, Footprint.sixteen_gon(0.3), poses).tolist()
    assert len(np.unique(round_one)) > 3


def test_costs_of_a_map_are_those_of_its_static_layer():
    grid = grid_from_text("......\n......\n...?..\n#.....", 0.25, (0.0, 0.0, 0.0))
    costs = Costmap.from_static_layer(grid)
    robot = Footprint.polygon([[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]])
    poses = [[0.7, 0.75, 0], [0.25, 0.25, 0], [0.8, 0.4, 0], [1.45, 0.5, 0]]
    assert footprint_costs(costs, robot, poses).tolist() == [0, 254, 255, 254]


def test_what_is_not_allowed_is_refused():
    costs = Costmap([[0, 1]], 0.5)
    for poses in ([[1, 2]], [1, 2], [[[1, 2, 3]]], 5):
        with pytest.raises(ParameterError, match="poses must be an array of x, y, yaw"):
            footprint_costs(costs, ROBOT, poses)
    with pytest.raises(ParameterError, match="rule: must be one of outline, full, got 'inside'"):
        footprint_costs(costs, ROBOT, [[0, 0, 0]], rule="inside")
    published = Costmap([[0, 1]], 0.5, scale="occupancy")
    with pytest.raises(ParameterError, match=r"cost scale: .* costmap2d, got 'occupancy'"):
        footprint_costs(published, ROBOT, [[0, 0, 0]])
    assert footprint_costs(costs, ROBOT, np.empty((0, 3))).shape == (0,)
