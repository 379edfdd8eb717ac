"""NavFn, Smac 2D and Theta*: both engines, and an independent search."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels import searches as nav2_searches
from mapdeal.kernels.searches import UNREACHED, cost_table, potentials, traced_path


def blobs(draw, lengths):
    """Return a costmap of blobs, and its random numbers."""
    shape = draw(lengths), draw(lengths)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    smooth = ndimage.gaussian_filter(rng.random(shape), draw(st.sampled_from([0.5, 1.5, 3])))
    ranks = smooth.ravel().argsort().argsort().reshape(shape) / smooth.size
    return np.clip((ranks - 0.3) * 360, 0, 255).astype(np.uint8), rng


@st.composite
def searches(draw):
    """A costmap of blobs, a start, a target, and whether unknown cells are open."""
    costs, rng = blobs(draw, st.integers(3, 40))
    start, target = (tuple(rng.integers(0, costs.shape[::-1]).tolist()) for _ in range(2))
    return costs, start, target, draw(st.booleans())


def searched(search, is_astar):
    costs, start, target, allow_unknown = search
    found = potentials(costs, start, target, allow_unknown=allow_unknown, is_astar=is_astar)
    return found, *traced_path(found, start, target, turns=4 * max(costs.shape))


@needs_compiled
@example((np.pad(np.full((3, 1), 254, np.uint8), ((3, 3), (6, 6))), (2, 4), (10, 4), True), False)
@given(searches(), st.booleans())
def test_both_engines_give_the_same_bytes(search, is_astar):
    def as_bytes():
        found, path, outcome = searched(search, is_astar)
        return found.tobytes(), path.tobytes(), outcome

    compiled, twin = by_each_engine(as_bytes)
    assert compiled == twin


@given(searches(), st.booleans())
def test_cells_are_reached_only_where_open_cells_lead_to_them(each_engine, search, is_astar):
    costs, start, _, allow_unknown = search
    found, path, outcome = searched(search, is_astar)
    is_open = cost_table(allow_unknown)[costs] < 254
    is_open[[0, -1]] = is_open[:, [0, -1]] = False
    is_open[start[::-1]] = True
    labels = ndimage.label(is_open)[0]
    is_reached = found < UNREACHED
    assert not (is_reached & (labels != labels[start[::-1]])).any()
    if outcome == "found":
        assert (path[-1] == start).all()
        assert np.hypot(*np.diff(path, axis=0).T).max(initial=0) < 3


def test_a_path_in_the_open_is_straight(each_engine):
    costs = np.zeros((9, 31), np.uint8)
    found = potentials(costs, (3, 4), (20, 4), allow_unknown=True, is_astar=False)
    assert found[4, 20] == 17 * 50
    path, outcome = traced_path(found, (3, 4), (20, 4), turns=124)
    assert outcome == "found"
    assert path[[0, -1]].tolist() == [[20, 4], [3, 4]]
    assert np.ptp(path[:, 1]) == 0


@st.composite
def grid_searches(draw):
    """A costmap of blobs, a start, a goal, and whether unknown cells are open."""
    costs, rng = blobs(draw, st.integers(2, 30))
    start, goal = rng.integers(0, costs.size, 2).tolist()
    return costs, start, goal, draw(st.booleans())


def grid_searched(search, tolerance=0.0, most=2**31 - 1, near=2**31 - 1):
    costs, start, goal, allow_unknown = search
    steps = nav2_searches.grid_step_costs(1.0, allow_unknown=allow_unknown)
    goal_xy = (float(np.float32(goal % costs.shape[1] + 0.4)), float(goal // costs.shape[1]))
    return nav2_searches.grid_path(
        costs, steps, start, goal, goal_xy, tolerance=tolerance, most_iterations=most,
        most_near_goal=near,
    )  # fmt: skip


def theta_searched(search, corners=8):
    costs, start, goal, allow_unknown = search
    tables = nav2_searches.theta_costs(2.0, allow_unknown=allow_unknown)
    return nav2_searches.theta_path(
        costs, tables, start, goal, corners=corners, distance_weight=1.0
    )


@needs_compiled
@example((np.zeros((20, 27), np.uint8), 0, 537, True), 0.0, 200, 20)
@given(grid_searches(), st.sampled_from([0.0, 2.5]), st.sampled_from([9, 200]), st.integers(1, 20))
def test_both_engines_find_the_same_paths(search, tolerance, most, near):
    def results():
        cells, iterations = grid_searched(search, tolerance, most, near)
        path = np.random.default_rng(3).random((6, 2))
        change = nav2_searches.smooth_once(path.copy(), path, 0.2, 0.3)
        return (cells.tolist(), iterations, theta_searched(search), theta_searched(search, 4),
                change, path.tolist())  # fmt: skip

    compiled, twin = by_each_engine(results)
    assert compiled == twin


def least_cost(costs, start, goal, steps):
    """Return the cost by scipy's Dijkstra: an independent search over all steps."""
    numbers, edges = np.arange(costs.size).reshape(costs.shape), []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows, left = slice(0, costs.shape[0] - dy), slice(max(-dx, 0), costs.shape[1] - max(dx, 0))
        a = numbers[rows, left]
        b = numbers[dy:, max(dx, 0) : costs.shape[1] + min(dx, 0)]
        for near, far in ((a, b), (b, a)):
            weights = steps[int(dx != 0 and dy != 0)][costs.ravel()[far.ravel()]]
            keep = np.isfinite(weights)
            edges.append((weights[keep], near.ravel()[keep], far.ravel()[keep]))
    weights, near, far = (np.concatenate(parts) for parts in zip(*edges, strict=True))
    graph = sparse.csr_array((weights, (near, far)), (costs.size,) * 2)
    return csgraph.dijkstra(graph, indices=start)[goal]


@given(grid_searches())
def test_smac_finds_a_path_exactly_where_there_is_one_of_nearly_the_least_cost(each_engine, search):
    costs, start, goal, allow_unknown = search
    if start == goal:
        return
    steps = nav2_searches.grid_step_costs(1.0, allow_unknown=allow_unknown).astype(float)
    least = least_cost(costs, start, goal, steps)
    cells, _ = grid_searched(search)
    assert (len(cells) > 0) == np.isfinite(least)
    if len(cells):
        rows, columns = np.divmod(cells, costs.shape[1])
        is_diagonal = (np.diff(rows) != 0) & (np.diff(columns) != 0)
        assert np.abs([np.diff(rows), np.diff(columns)]).max() == 1
        assert (cells[0], cells[-1]) == (start, goal)
        cost = steps[is_diagonal.astype(int), costs.ravel()[cells[1:]]].sum()
        assert least - 1e-3 <= cost <= least + 0.8  # the heuristic exceeds distances by up to 0.4


@given(grid_searches())
def test_theta_star_finds_a_path_only_between_connected_cells(each_engine, search):
    costs, start, goal, allow_unknown = search
    steps, _ = nav2_searches.theta_costs(2.0, allow_unknown=allow_unknown)
    is_open = np.isfinite(steps)[costs]
    if start == goal or not (is_open.ravel()[start] and is_open.ravel()[goal]):
        return
    labels = ndimage.label(is_open, np.ones((3, 3)))[0].ravel()
    cells = theta_searched(search)
    if cells:
        assert (cells[0], cells[-1]) == (start, goal)
        assert is_open.ravel()[cells].all()
        assert len(set(labels[cells])) == 1


def test_a_point_between_two_is_pulled_to_both():
    raw = np.array([[0.0, 0], [1, 1], [2, 0]])
    path = raw.copy()
    assert nav2_searches.smooth_once(raw, path, 0.2, 0.3) == pytest.approx(0.6)
    assert path[1].tolist() == pytest.approx([1, 0.4])
