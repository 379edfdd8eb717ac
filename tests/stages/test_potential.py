"""The potential, and what the field says of itself."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from robots import write_robot
from strategies import RESOLUTIONS, examples, occupancies

FRAME = (0.25, (1.5, -2.0, 0.4))


def test_the_design_s_case_by_hand():
    occupancy = np.diag([0, *[100] * 4, *[0] * 5]).astype(np.int8)
    golden = mapdeal.potential(mapdeal.OccupancyGrid(occupancy, 1.0), goal=(5.5, 5.5))
    near = sum(1 / (cells * math.sqrt(2)) for cells in range(1, 5))
    far = sum(1 / math.hypot(9 - cell, cell) for cell in range(1, 5))
    found = [golden.repulsive[cell] for cell in ((0, 0), (5, 5), (0, 9), (9, 0))]
    assert found == pytest.approx([near, near, far, far])
    assert golden.potential[0, 9] == pytest.approx(far + math.hypot(5, 4))
    assert (golden.normalised.min(), golden.normalised.max()) == (0.0, 10.0)


@pytest.mark.usefixtures("mapdeal_warnings")
@given(occupancies(longest=8), RESOLUTIONS, st.sampled_from([0.0, 0.4, -3.0, 2.0]), st.booleans(),
       st.sampled_from([(3.0, 0.5), (0.0, 2.0), (2.0, 0.0)]),
       st.sampled_from([1e5, 9.5]))  # fmt: skip
def test_the_parts_and_their_slopes_are_those_of_the_formulas(
    occupancy, resolution, yaw, has_goal, gains, cap
):
    grid = mapdeal.OccupancyGrid(occupancy, resolution, (1.5, -2.0, yaw))
    goal = tuple(grid.frame.xy_from_rowcol([[-2, 1]])[0].tolist()) if has_goal else None
    options = {"attractive_gain": gains[0], "repulsive_gain": gains[1], "repulsive_cap": cap}
    field = mapdeal.potential(grid, goal=goal, **options)
    direct = oracles.sum_of_inverse_distances(occupancy == 100, resolution, 0.001)
    values = repulsive = np.minimum(direct, cap)
    assert field.repulsive == pytest.approx(repulsive, rel=1e-9, abs=1e-12)
    if has_goal:
        rows, cols = np.indices(occupancy.shape)
        away = np.hypot(rows + 2, cols - 1) * resolution
        assert field.attractive == pytest.approx(away)
        values = gains[0] * away + gains[1] * repulsive
    else:
        assert field.attractive is None
    assert field.potential == pytest.approx(values, rel=1e-9, abs=1e-12)
    spread = field.potential.max() - field.potential.min()
    normalised = 10 * (field.potential - field.potential.min()) / (spread or 1)
    assert field.normalised == pytest.approx(normalised)
    expected = oracles.slopes_along_map_axes(values.tolist(), resolution, yaw)
    noise = 1e-9 * (1 + values.max()) / resolution
    entries = field.entries()
    assert entries["gradient"] == pytest.approx(np.array(expected), rel=1e-9, abs=noise)
    steepness = np.hypot(*expected)
    assert entries["gradient_magnitude"] == pytest.approx(steepness, rel=1e-9, abs=noise)
    steepest = field.figures()["steepest_gradient"]
    assert steepest == pytest.approx(steepness.max(), rel=1e-9, abs=noise)


@pytest.mark.parametrize("yaw", [0.4, -3.0])
def test_downhill_leads_to_the_goal_whatever_the_yaw(yaw):
    grid = mapdeal.OccupancyGrid(np.zeros((30, 40), np.int8), 0.25, (1.5, -2.0, yaw))
    goal = grid.frame.xy_from_rowcol([[10, 12]])[0]
    field = mapdeal.potential(grid, goal=tuple(goal))
    for cell in [(25, 30), (2, 3), (20, 5), (5, 33)]:
        ahead = goal - grid.frame.xy_from_rowcol([cell])[0]
        expected = ahead / np.hypot(*ahead)
        assert field.downhill()[(slice(None), *cell)] == pytest.approx(expected, abs=0.01)
    assert not mapdeal.potential(grid_from_text("...")).downhill().any()


@pytest.mark.parametrize(("side", "near"), [(0.001, 0.0), (0.0011, 1 / 0.0011)])
def test_distances_up_to_a_millimetre_are_left_out(side, near):
    field = mapdeal.potential(mapdeal.OccupancyGrid([[100, 0, 0]], side))
    assert field.repulsive == pytest.approx(np.array([[0, near, 0.5 / side]]))


def test_obstacles_are_those_of_the_field_or_of_the_threshold():
    grid = grid_from_text("..?\n+..")
    assert not mapdeal.potential(grid).obstacles().any()
    assert mapdeal.potential(grid, lethal_threshold=50).obstacles().sum() == 1
    field = mapdeal.esdf(grid, unknown="occupied", lethal_threshold=50)
    assert mapdeal.potential(field).obstacles().sum() == 2
    assert np.array_equal(mapdeal.potential(field).obstacles(), field.obstacles())


def test_a_lone_obstacle_is_no_pit_to_go_downhill_into():
    field = mapdeal.potential(grid_from_text(".....\n..#..\n.....", 0.25, (0.0, 0.0, 0.0)))
    assert field.potential[1, 2] < field.potential[1, 1]
    surface = field.downhill_surface()
    assert surface[1, 2] > surface[1, 1]
    assert surface[1, 2] == pytest.approx(2 / 0.25)
    grid = field.grid
    assert mapdeal.potential(grid, repulsive_gain=7.0).downhill_surface()[1, 2] == pytest.approx(8)
    pulled = mapdeal.potential(grid, goal=(0.1, 0.1), repulsive_gain=7.0)
    raised = pulled.downhill_surface() - pulled.potential
    assert raised == pytest.approx(np.where(field.obstacles(), 56.0, 0.0))
    assert field.downhill()[0, 1, 1] < 0 < field.downhill()[0, 1, 3]


@pytest.mark.parametrize("goal", [None, (1.7, -1.9)])
def test_a_file_holds_every_layer_and_gives_the_field_back(tmp_path, goal):
    field = mapdeal.potential(grid_from_text(".#.?\n...."), goal=goal, attractive_gain=3.0)
    mapdeal.write_map(tmp_path / "p.npz", field)
    layers = {"repulsive", "normalised", "gradient", "gradient_magnitude"}
    with np.load(tmp_path / "p.npz") as entries:
        if goal:
            layers |= {"attractive", "potential"}
            assert entries["goal"].tolist() == list(goal)
        assert {n for n in entries.files if entries[n].dtype == np.float64} >= layers
        assert ("potential" in entries.files) == (goal is not None)
        assert np.array_equal(entries["gradient_magnitude"], field.gradient_magnitude)
    again = mapdeal.read_map(tmp_path / "p.npz")
    assert isinstance(again, mapdeal.PotentialField)
    for name in ("goal", "origin", "resolution", "attractive_gain", "repulsive_cap"):
        assert getattr(again, name) == getattr(field, name)
    for name in ("potential", "gradient", "occupancy"):
        assert np.array_equal(getattr(again, name), getattr(field, name))


@given(occupancies(longest=9), st.sampled_from([0.0, 0.4]), st.booleans(), st.sampled_from("prc"))
def test_lengths_to_the_goal_are_finite_where_reach_gets_to(occupancy, yaw, through_unknown, shape):
    grid = mapdeal.OccupancyGrid(occupancy, 0.25, (1.5, -2.0, yaw))
    corners = mapdeal.Footprint([(0.3, 0.1), (0.3, -0.1), (-0.2, -0.1), (-0.2, 0.1)])
    robot = {"p": {}, "r": {"radius": 0.3}, "c": {"footprint": corners}}[shape]
    robot["through_unknown"] = through_unknown
    cell = tuple((np.array(occupancy.shape) // 2).tolist())
    assume(occupancy[cell] != 100)
    goal = tuple((grid.frame.xy_from_rowcol([cell])[0] + 0.01).tolist())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", mapdeal.MapdealWarning)
        field = mapdeal.potential(grid, goal=goal, **robot)
    try:
        reached = mapdeal.reach(grid, start=goal, **robot).reachable.astype(bool)
    except mapdeal.MapdealError:  # closed there, or everywhere
        reached = np.zeros(grid.shape, bool)
        assert "cost_to_go is inf everywhere" in str(caught[0].message)
    assert (np.isfinite(field.cost_to_go) == reached).all()
    assert (np.isfinite(field.cost_to_go_gradient) == reached).all()
    away = grid.frame.xy_from_rowcol(np.argwhere(reached)) - goal
    assert (field.cost_to_go[reached] >= np.hypot(*away.T) * (1 - 1e-9)).all()


def test_gradients_of_lengths_lead_away_from_the_goal_in_the_map_frame():
    grid = mapdeal.OccupancyGrid(np.zeros((41, 31), np.int8), 0.25, (1.5, -2.0, 0.4))
    goal = tuple(grid.frame.xy_from_rowcol([[20, 15]])[0].tolist())
    field = mapdeal.potential(grid, goal=goal)
    away = grid.frame.xy_from_rowcol(np.argwhere(np.ones(grid.shape))) - goal
    length = np.hypot(*away.T)
    is_far = length > 1.0
    expected = away[is_far] / length[is_far, np.newaxis]
    assert field.cost_to_go_gradient.reshape(2, -1).T[is_far] == pytest.approx(expected, abs=0.12)
    assert field.cost_to_go[20, 17] == pytest.approx(0.5)
    assert mapdeal.potential(grid).cost_to_go is None


@examples(40)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["costmap2d", "occupancy"]), st.booleans())
def test_weighted_costs_lie_between_eight_way_sums_and_their_largest_excess(
    each_engine, seed, scale, through_unknown
):
    """Ways over eight neighbours are at most 1.0824 times as long as those in any direction."""
    rng = np.random.default_rng(seed)
    graded, unknown = (252, 255) if scale == "costmap2d" else (98, -1)
    costs = rng.choice([0, 30, 70, graded, graded + 1, graded + 2, unknown], rng.integers(2, 7, 2))
    row, col = rng.integers(0, costs.shape)
    costs[row, col] = 30
    costmap = mapdeal.Costmap(costs.astype("u1" if graded > 99 else "i1"), *FRAME, scale=scale)
    goal = tuple(costmap.frame.xy_from_rowcol([[row, col]])[0].tolist())
    options = {"cost_travel_multiplier": 3.0, "through_unknown": through_unknown}
    field = mapdeal.potential(costmap, goal=goal, **options)
    weights = np.where(costs == unknown, 4.0 * through_unknown, 1 + 3 * costs / graded)
    weights[(costs > graded) & (costs != unknown)] = 0
    for cell, found in np.ndenumerate(field.cost_to_go / FRAME[0]):
        by_steps = oracles.lowest_cost(weights, (row, col), cell) if weights[cell] else None
        if by_steps is None:
            assert found == math.inf
        else:
            assert by_steps / 1.0824 - 1e-9 <= found <= by_steps + 1e-9


def test_a_constant_cost_scales_lengths_and_the_file_says_the_unit(each_engine, tmp_path):
    walls = np.random.default_rng(1).random((30, 20)) < 0.2
    walls[15, 10] = False
    costmap = mapdeal.Costmap(np.where(walls, 254, 126).astype(np.uint8), *FRAME)
    goal = tuple(costmap.frame.xy_from_rowcol([[15, 10]])[0].tolist())
    plain, doubled = (
        mapdeal.potential(costmap, goal=goal, cost_travel_multiplier=k) for k in (0.0, 2.0)
    )
    assert (2 * plain.cost_to_go).tobytes() == doubled.cost_to_go.tobytes()
    assert np.isinf(plain.cost_to_go[walls]).all()
    mapdeal.write_map(tmp_path / "p.npz", doubled)
    again = mapdeal.read_map(tmp_path / "p.npz")
    assert again.figures()["cost_to_go_unit"] == "m * (1 + 2 * cost / highest open cost)"
    assert "cost_to_go_unit" not in plain.figures()
    with pytest.raises(mapdeal.ParameterError, match="needs costs"):
        mapdeal.potential(doubled.grid, goal=goal, cost_travel_multiplier=1.0)
    with pytest.raises(mapdeal.ParameterError, match="weighted potential field"):
        mapdeal.route(tmp_path / "p.npz", start=goal, goal=goal, method="geodesic")


def test_a_robot_s_costs_of_a_map_weigh_its_ways(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    write_robot("r.yaml", 0.3)
    robot = ["--params-file", "r.yaml"]
    mapdeal.write_map("m.yaml", grid_from_text("......#....\n" * 3 + "...........\n" * 5, *FRAME))
    assert command("cost", "m.yaml", "-o", "costs.npz", *robot)[0] == 0
    options = ["--goal", "2.3,-0.7", *robot, "--cost-travel-multiplier", "2"]
    for source in ("m.yaml", "costs.npz"):
        assert command("potential", source, "-o", f"{source[0]}.npz", *options)[0] == 0
    of_map, of_costs = (mapdeal.read_map(f"{name}.npz").cost_to_go for name in "mc")
    assert of_map.tobytes() == of_costs.tobytes()
    assert np.isfinite(of_map).sum() > 20
