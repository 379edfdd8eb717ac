import cmath
import json
import math
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from engines import ENGINES
from mapdeal import Costmap, Footprint, MapdealWarning, OccupancyGrid, footprint_costs, read_map
from mapdeal.grid.footprint import footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import cost_from_occupancy, static_layer_cost_from_occupancy
from mapdeal.kernels import engine
from mapdeal.kernels.paths import open_poses

ROBOT = Footprint.polygon([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]])


@pytest.fixture(scope="module")
def recorded(real_maps):
    """What Nav2's own code said: costs of maps, footprints, poses, and their costs."""
    folder = real_maps / "expected"
    recorded = json.loads((folder / "params.json").read_text())["footprint_poses"]
    cases = []
    with (
        np.load(folder / "footprint_poses.npz") as poses,
        np.load(folder / "params_costmaps.npz") as costmaps,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", MapdealWarning)
        for case in recorded:
            grid = read_map(real_maps / case["map"])
            name = case["costmap"].removeprefix("the case ")
            if name == case["costmap"]:
                costs = Costmap.from_static_layer(grid)
            else:
                cells = costmaps[name.replace(" (distance_transform)", "|distance_transform")]
                costs = Costmap(cells, grid.resolution, grid.origin)
            key = case["key"]
            arrays = (poses[f"{key}_{name}"] for name in ("footprint", "poses", "cost"))
            cases.append((key, costs, *arrays))
    return cases


@pytest.mark.parametrize("name", ENGINES)
def test_all_recorded_costs_of_nav2_are_equal(recorded, monkeypatch, mapdeal_warnings, name):
    monkeypatch.setenv(engine.VARIABLE, name)
    some = 4 if name == "scipy" else 1  # it is slow
    count = 0
    for key, costs, corners, poses, expected in recorded:
        robot = Footprint(tuple(map(tuple, corners.tolist())))
        found = footprint_costs(costs, robot, poses[::some])
        assert found.dtype == np.uint8
        assert np.array_equal(found, expected[::some]), key
        count += len(found)
    assert count == 50_000 // some


@pytest.mark.parametrize("yaw", [0.4, -2.9, np.pi / 2])
def test_the_yaw_of_a_map_turns_nothing_but_the_frame(yaw):
    values = np.array([0, 60, 253, 254, 255], np.uint8)
    cells = np.random.default_rng(3).choice(values, (40, 60), p=[0.8, 0.1, 0.05, 0.03, 0.02])
    level = Costmap(cells, 0.1, (1.5, -2.0, 0.0))
    turned = Costmap(level.cost, level.resolution, (1.5, -2.0, yaw))
    poses = np.random.default_rng(5).uniform((1.5, -2.0, -3), (7.5, 2.0, 3), (3000, 3))
    places = level.frame.continuous_rowcol_from_xy(poses[:, :2])
    moved = np.column_stack([turned.frame.xy_from_continuous_rowcol(places), poses[:, 2] + yaw])
    expected = footprint_costs(level, ROBOT, poses)
    # the side of a cell is a float32 in here, and corners may lie on edges up to rounding
    assert (footprint_costs(turned, ROBOT, moved) != expected).mean() < 0.001
    assert len(np.unique(expected)) == 5
    shapes = Footprint.circle(0.3), Footprint.sixteen_gon(0.3)
    circle, polygon = (footprint_costs(level, shape, poses[:500]) for shape in shapes)
    assert circle.tolist() == polygon.tolist()
    assert Footprint.sixteen_gon(0.3).vertices[0] == (0.3, 0.0)


def test_the_side_of_a_cell_is_the_float32_of_a_map_message():
    costs = Costmap(np.arange(200, dtype=np.uint8).reshape(1, 200), 0.05)
    robot = Footprint(((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)))
    # 8.0 / 0.05 is 160 on paper; of ROS's 0.0500000007 it is 159.9999976
    poses = [[8.0, 0.0, 0.0], [8.000001, 0.0, 0.0], [10.0, 0.0, 0.0]]
    assert footprint_costs(costs, robot, poses).tolist() == [159, 160, 199]


@pytest.mark.parametrize(("shape", "inscribed", "circumscribed"), [
    # edges at x = 0.4, -0.2 and y = +-0.25; the farthest corner is (0.4, 0.25)
    (Footprint.polygon([[0.4, 0.25], [0.4, 0.25], [0.4, -0.25], [-0.2, -0.25], [-0.2, 0.25]]),
     0.2, math.hypot(0.4, 0.25)),
    (Footprint.circle(0.25).padded(0.05).padded(0.0), 0.3, 0.3),
    (Footprint.sixteen_gon(0.5), 0.5 * math.cos(math.pi / 16), 0.5),
])  # fmt: skip
def test_radii_by_hand(shape, inscribed, circumscribed):
    assert shape.inscribed_radius == pytest.approx(inscribed)
    assert shape.circumscribed_radius == pytest.approx(circumscribed)


def test_padding_moves_each_coordinate_by_its_sign_and_leaves_zero():
    shape = Footprint.polygon([[0.3, 0.0], [-0.2, 0.2], [-0.2, -0.2]]).padded(0.01)
    assert shape.vertices == ((0.31, 0.0), (-0.21000000000000002, 0.21000000000000002),
                              (-0.21000000000000002, -0.21000000000000002))  # fmt: skip


@pytest.mark.usefixtures("mapdeal_warnings")
def test_radii_are_those_of_costmap_2d(real_maps):
    peers = json.loads((real_maps / "expected" / "peers.json").read_text())["footprints"]
    assert len(peers) == 12
    for case in peers:
        shape = Footprint.polygon(case["polygon"])
        radii = shape.inscribed_radius, shape.circumscribed_radius
        expected = [case["result"][name] for name in ("inscribed", "circumscribed")]
        assert radii == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("space", ["", " ", "\r\n", "\x1c", "\x85", "\u2003"])
def test_white_space_of_any_kind_may_stand_between_numbers(space):
    text = " [ [ 1 , +.5 ] , [ -1e0 , 1 ] , [ 0 , -1 ] ] ".replace(" ", space)
    assert Footprint.parse(text).vertices == ((1, 0.5), (-1, 1), (0, -1))


SHAPES = [
    ((0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225)),
    ((0.5, 0.3), (-0.2, 0.25), (0.0, 0.0), (-0.2, -0.25), (0.5, -0.3)),  # concave
    ((0.9, 0.3), (0.4, 0.25), (0.7, -0.3)),  # the centre lies outside
    ((0.01, 0.02), (0.01, -0.02), (-0.01, 0.0)),  # smaller than a cell
    ((0.0, 0.8), (0.0, -0.7), (0.001, 0.0)),  # a line
]


def drawn(spans):
    """The cells (x, y) of runs, which must not overlap."""
    runs = zip(*(column.tolist() for column in spans), strict=True)
    cells = [(col, row) for row, start, stop in runs for col in range(start, stop)]
    assert len(cells) == len(set(cells))
    return set(cells)


def cells_of(corners, turn, resolution):
    """The cells (x, y) of a polygon around the middle of cell (0, 0), one by one."""
    turned = [complex(*corner) * cmath.exp(1j * turn) / resolution for corner in corners]
    shift = 22
    ring = [tuple(math.floor(0.5 + v + 1e-9) + shift for v in (p.real, p.imag)) for p in turned]
    return {(x - shift, y - shift) for x, y in oracles.ring_fill([ring], 2 * shift, 2 * shift)}


@pytest.mark.usefixtures("mapdeal_warnings")
@given(
    corners=st.sampled_from([None, *SHAPES]), count=st.integers(1, 24),
    resolution=st.sampled_from([0.05, 0.3, 0.0504]),
    yaw=st.sampled_from([0.0, 0.4, -3.0, math.pi / 2]), heading=st.integers(0, 23),
)  # fmt: skip
def test_the_cells_are_those_of_costmap_2d_drawn_one_by_one(
    corners, count, resolution, yaw, heading
):
    frame = Frame(200, 300, resolution, (1.5, -2.0, yaw))
    robot = Footprint.polygon(corners) if corners else Footprint.circle(0.4)
    headings = footprint_spans(robot, frame, count)
    assert len(headings) == count
    k = heading % count
    turn = 2 * math.pi * k / count - yaw
    corners = corners or Footprint.sixteen_gon(0.4).vertices
    assert drawn(headings[k]) == cells_of(corners, turn, resolution)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_ways_on_a_large_map_are_those_of_a_search_in_all_72_headings(seed):
    blocked = np.random.default_rng(seed).random((64, 61)) < 0.004
    blocked[20, :50] = blocked[40, 12:] = True
    blocked[20, 9:17] = blocked[40, 30:38] = False
    corners = [(0.45, 0.16), (0.45, -0.16), (-0.35, -0.16), (-0.35, 0.16)]
    frame = Frame(*blocked.shape, 0.1, (1.5, -2.0, 0.4))
    space = open_poses(blocked, footprint_spans(Footprint.polygon(corners), frame, 72), None)
    turns = [2 * math.pi * k / 72 - 0.4 for k in range(72)]
    covered = [{(y, x) for x, y in cells_of(corners, turn, 0.1)} for turn in turns]
    opened = oracles.open_poses(blocked, covered)
    seeds = [(heading, 9, 9) for heading in range(0, 72, 5)]
    reached = oracles.reached_poses(opened, seeds)
    reachable, headings = space.reach(seeds, [(9, 9)])
    np.testing.assert_array_equal(space.headings, opened.sum(axis=0))
    np.testing.assert_array_equal(reachable, reached.any(axis=0))
    np.testing.assert_array_equal(headings[0], reached[:, 9, 9])
    assert reached[:, 21:].any()  # it gets through the first door


def test_figures_count_each_cell_once():
    costmap = Costmap([[0, 0, 0, 1, 252], [253, 253, 254, 255, 7]], 0.5, circumscribed_cost=61)
    assert costmap.figures() == {
        "width": 5, "height": 2, "resolution": 0.5, "origin": [0.0, 0.0, 0.0],
        "cost_scale": "costmap2d", "free": 3, "lethal": 1, "inscribed": 2, "unknown": 1,
        "circumscribed_cost": 61, "graded": 3, "most_common": {"cost": 0, "share": 0.5},
    }  # fmt: skip
    figures = Costmap([[0, 0, 0, 1, 99], [100, 100, 98, -1, 7]], 0.5, scale="occupancy").figures()
    assert [figures[name] for name in ("free", "lethal", "unknown", "graded")] == [3, 2, 1, 4]
    assert "inscribed" not in figures


@pytest.fixture(scope="module")
def peers(real_maps):
    with np.load(real_maps / "expected" / "peers.npz") as file:
        yield file


@given(st.integers(0, 100), st.none() | st.integers(0, 100), st.booleans(), st.booleans())
def test_costs_of_static_layers_are_those_of_interpret_value(
    threshold, inscribed, trinary, track_unknown
):
    grid = OccupancyGrid([range(-1, 101)], 0.2, (1.0, 2.0, 0.5))
    rules = {"trinary": trinary, "track_unknown": track_unknown}
    costs = Costmap.from_static_layer(
        grid, lethal_threshold=threshold, inscribed_value=inscribed, **rules
    )
    for value, cost in enumerate(costs.cost[0].tolist(), -1):
        assert cost == oracles.static_layer_cost(value, threshold, inscribed=inscribed, **rules)
    assert costs.cost.shape == (1, 102)
    assert (costs.scale, costs.origin) == ("costmap2d", grid.origin)


@pytest.mark.parametrize(("name", "options"), [
    ("trinary", {}), ("scaled", {"trinary": False}), ("no_unknown", {"track_unknown": False}),
])  # fmt: skip
def test_the_static_layer_reads_every_byte_as_ros_does(peers, name, options):
    values = peers["occ_values"][0]
    assert sorted(values.tolist()) == list(range(-128, 128))
    table = static_layer_cost_from_occupancy(**options)
    assert np.array_equal(table[values.view(np.uint8)], peers[f"static/{name}"][0])


def test_costs_are_published_and_masks_become_costs_as_in_ros(peers):
    grid = Costmap(np.arange(256, dtype=np.uint8)[np.newaxis], 0.2, (1, 2, 0.5)).to_occupancy()
    assert np.array_equal(grid.occupancy, peers["to_occ"])
    assert (grid.resolution, grid.origin) == (0.2, (1, 2, 0.5))
    values = np.arange(-1, 101, dtype=np.int8)
    assert np.array_equal(cost_from_occupancy()[values.view(np.uint8)], peers["from_occ"][0])


def test_masks_of_a_map():
    grid = OccupancyGrid([[-1, 0, 1], [50, 99, 100]], 0.05)
    assert grid.unknown().tolist() == [[True, False, False], [False, False, False]]
    assert grid.occupied().tolist() == [[False, False, False], [False, False, True]]
    assert grid.occupied(50).tolist() == [[False, False, False], [True, True, True]]
    assert grid.as_amcl_sees_it().occupancy.tolist() == [[-1, 0, -1], [-1, -1, 100]]
    assert grid.amcl_states().tolist() == [[0, -1, 0], [0, 0, 1]]
