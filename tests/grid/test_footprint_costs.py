"""What a robot costs at poses."""

import json
import math
import warnings

import numpy as np
import pytest

from engines import ENGINES
from mapdeal import Costmap, Footprint, MapdealWarning, Polygon, draw, footprint_costs, read_map
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


def test_radii_of_a_rectangle_off_its_centre():
    # Edges at x = 0.4, -0.2 and y = +-0.25; the farthest corner is (0.4, 0.25).
    shape = Footprint.polygon([[0.4, 0.25], [0.4, -0.25], [-0.2, -0.25], [-0.2, 0.25]])
    assert shape.inscribed_radius == pytest.approx(0.2)
    assert shape.circumscribed_radius == pytest.approx(math.hypot(0.4, 0.25))


def test_a_repeated_corner_does_no_harm():
    shape = Footprint.polygon([[0.3, 0.2], [0.3, 0.2], [-0.3, 0.2], [0.0, -0.4]])
    assert math.isfinite(shape.inscribed_radius)


def test_either_sense_of_rotation_gives_the_same_radii():
    corners = [(0.3, 0.1), (-0.1, 0.3), (-0.2, -0.3)]
    one, other = Footprint.polygon(corners), Footprint.polygon(corners[::-1])
    assert one.inscribed_radius == pytest.approx(other.inscribed_radius)
    assert one.circumscribed_radius == other.circumscribed_radius


def test_padding_moves_each_coordinate_by_its_sign_and_leaves_zero():
    shape = Footprint.polygon([[0.3, 0.0], [-0.2, 0.2], [-0.2, -0.2]]).padded(0.01)
    assert shape.vertices == ((0.31, 0.0), (-0.21000000000000002, 0.21000000000000002),
                              (-0.21000000000000002, -0.21000000000000002))  # fmt: skip


def test_a_circle_is_a_circle_and_no_polygon():
    shape = Footprint.circle(0.25).padded(0.05)
    assert shape.inscribed_radius == shape.circumscribed_radius == pytest.approx(0.3)


def test_radii_are_those_of_costmap_2d(real_maps):
    peers = json.loads((real_maps / "expected" / "peers.json").read_text())["footprints"]
    assert len(peers) == 12
    for case in peers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            shape = Footprint.polygon(case["polygon"])
        assert shape.inscribed_radius == pytest.approx(case["result"]["inscribed"], rel=1e-12)
        expected = case["result"]["circumscribed"]
        assert shape.circumscribed_radius == pytest.approx(expected, rel=1e-12)


def test_the_sixteen_gon_of_costmap_2d_is_a_little_smaller_than_its_circle():
    shape = Footprint.sixteen_gon(0.5)
    assert len(shape.vertices) == 16
    assert shape.vertices[0] == (0.5, 0.0)
    assert shape.vertices[4] == pytest.approx((0.0, 0.5))
    assert shape.circumscribed_radius == pytest.approx(0.5)
    assert shape.inscribed_radius == pytest.approx(0.98079 * 0.5, rel=1e-5)


@pytest.mark.parametrize("space", ["", " ", "\r\n", "\x1c", "\x85", "\u2003"])
def test_white_space_of_any_kind_may_stand_between_numbers(space):
    text = " [ [ 1 , +.5 ] , [ -1e0 , 1 ] , [ 0 , -1 ] ] ".replace(" ", space)
    assert Footprint.parse(text).vertices == ((1, 0.5), (-1, 1), (0, -1))


def test_a_robot_beside_its_centre_is_warned_of():
    with pytest.warns(MapdealWarning, match="outside"):
        Footprint.polygon([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])
