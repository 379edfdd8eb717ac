import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import ParameterError, RouteEdge, RouteGraph, RouteNode
from mapdeal.planning.tours import _shorten_tour, driven, tour_of

SEEDS = st.integers(0, 2**32)


def random_graph(rng, count):
    """Return a graph of nodes in two parts, the larger one first."""
    nodes = [RouteNode(k, *rng.uniform(-9, 9, 2).tolist()) for k in range(count)]
    pairs = [(k, int(rng.integers(k))) for k in range(1, count - 1)]
    pairs += [tuple(pair) for pair in rng.integers(count - 1, size=(count, 2)) if len({*pair}) > 1]
    both = [*pairs, *(pair[::-1] for pair in pairs)]
    edges = [RouteEdge(count + k, *map(int, pair)) for k, pair in enumerate(both)]
    return RouteGraph(tuple(nodes), tuple(edges))


@given(SEEDS, st.integers(3, 30))
def test_a_tour_is_closed_follows_edges_and_its_viewpoints_see_everything(seed, count):
    rng = np.random.default_rng(seed)
    graph = random_graph(rng, count)
    seen = [np.flatnonzero(rng.random(50) < 0.1) for _ in range(count)]
    line, is_viewpoint = tour_of(graph, seen, 50)
    index = {tuple(point): k for k, point in enumerate(graph.points_xy.tolist())}
    nodes = [index[tuple(point)] for point in line.tolist()]
    edges = set(map(tuple, graph.ends.tolist()))
    assert nodes[0] == nodes[-1]
    assert all(pair in edges for pair in itertools.pairwise(nodes))
    viewpoints = {node for node, is_one in zip(nodes, is_viewpoint, strict=True) if is_one}
    in_part = set(np.concatenate(seen[:-1]).tolist())  # the last node is on its own
    assert set(np.concatenate([seen[node] for node in viewpoints]).tolist()) == in_part


@given(SEEDS, st.integers(4, 12))
def test_no_exchange_of_two_edges_shortens_a_tour(seed, count):
    points = np.random.default_rng(seed).random((count, 2))
    lengths = np.hypot(*(points[:, np.newaxis] - points).transpose(2, 0, 1))

    def length(order):
        return sum(lengths[a, b] for a, b in itertools.pairwise([*order, order[0]]))

    order = _shorten_tour(np.arange(count), lengths)
    assert sorted(order) == list(range(count))
    for first, last in itertools.combinations(range(1, count), 2):
        exchanged = [*order[:first], *order[first : last + 1][::-1], *order[last + 1 :]]
        assert length(exchanged) > length(order) - 1e-6


@given(SEEDS, st.floats(0.1, 3), st.floats(0.5, 30))
def test_a_robot_stays_on_its_line_and_within_its_speeds(seed, speed, rate):
    line = np.cumsum(np.random.default_rng(seed).normal(0, 1, (6, 2)), axis=0)
    line = np.concatenate([line, line[-2::-1]])  # there and back
    poses = driven(line, np.isin(np.arange(11), [3, 7]), speed=speed, rate=rate, turn=2.0)
    moves = np.diff(poses, axis=0)
    assert (np.hypot(*moves[:, :2].T) <= speed / rate + 1e-9).all()
    assert (np.abs(moves[:, 2]) <= 1 / rate + 1e-9).all()
    starts, along = line[:-1], np.diff(line, axis=0)
    offsets = poses[:, np.newaxis, :2] - starts
    shares = np.clip((offsets * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    distances = np.linalg.norm(offsets - shares[..., np.newaxis] * along, axis=2)
    assert distances.min(axis=1).max() < 0.011  # half a step cuts corners


def test_a_robot_looks_ahead_turns_at_viewpoints_and_at_dead_ends():
    line = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [2.0, 0.0]])
    poses = driven(line, np.array([False, True, False, False]), speed=1.0, rate=20.0, turn=1.5)
    near = {x: poses[np.abs(poses[:, 0] - x) < 0.02, 2] for x in (1.0, 2.0, 3.0, 4.0)}
    assert np.ptp(near[1.0]) < 1e-9
    assert np.ptp(near[2.0]) == pytest.approx(1.5, abs=0.1)
    assert np.ptp(near[3.0]) == pytest.approx(math.pi)
    assert len(poses) / 20 == pytest.approx(6.0 + 2 * 1.5 + math.pi, abs=0.2)


def test_too_many_poses_are_refused():
    with pytest.raises(ParameterError, match="scans are too many"):
        driven(np.array([[0.0, 0.0], [9.0, 0.0]]), np.zeros(2, bool), speed=1e-4, rate=1e3, turn=0)
