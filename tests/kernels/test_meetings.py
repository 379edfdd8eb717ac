import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels.components import joined, saddles_between, sums_behind


@st.composite
def forests(draw):
    """A forest whose edges are in any order, and what its nodes are."""
    count = draw(st.integers(1, 25))
    linked = [node for node in range(1, count) if draw(st.integers(0, 9))]
    edges = draw(st.permutations([(node, draw(st.integers(0, node - 1))) for node in linked]))
    pairs = np.array(edges, dtype=np.int32).reshape(-1, 2)
    is_large = np.array(draw(st.lists(st.booleans(), min_size=count, max_size=count)))
    return count, pairs[:, 0], pairs[:, 1], is_large


def kruskal(count, one, other, is_large):
    """Return the nodes in sets, and the edges at which two sets with a large node met."""
    sets = [{node} for node in range(count)]
    meetings = []
    for edge, (a, b) in enumerate(zip(one, other, strict=True)):
        if any(is_large[node] for node in sets[a]) and any(is_large[node] for node in sets[b]):
            meetings.append(edge)
            continue
        both = sets[a] | sets[b]
        for node in both:
            sets[node] = both
    return sets, meetings


@given(forests())
def test_small_nodes_are_joined_as_kruskal_does(forest):
    count, one, other, is_large = forest
    labels, meetings = joined(count, one, other, is_large)
    sets, expected = kruskal(*forest)
    assert meetings.tolist() == expected
    for node in range(count):
        assert set(np.flatnonzero(labels == labels[node]).tolist()) == sets[node]
        assert labels[node] in sets[node]
        large = [other for other in sets[node] if is_large[other]]
        assert large in ([], [labels[node]])


@given(forests())
def test_without_large_nodes_all_that_is_connected_is_joined(forest):
    count, one, other, _ = forest
    labels, meetings = joined(count, one, other)
    sets, _ = kruskal(count, one, other, np.zeros(count, dtype=bool))
    assert not len(meetings)
    assert len(set(labels.tolist())) == len({min(found) for found in sets}) == count - len(one)


def test_a_long_chain_is_joined():
    count = 5000
    nodes = np.arange(count)
    labels, meetings = joined(count, nodes[:-1], nodes[1:])
    assert len(set(labels.tolist())) == 1
    is_large = np.zeros(count, dtype=bool)
    is_large[[0, 1000, 4999]] = True
    labels, meetings = joined(count, nodes[:-1], nodes[1:], is_large)
    assert len(meetings) == 2
    assert sorted(np.bincount(labels)[[0, 1000, 4999]].tolist()) == [1, 1000, 3999]


@given(forests(), st.data())
def test_what_lies_behind_an_edge_is_what_is_lost_without_it(forest, data):
    count, one, other, _ = forest
    root = data.draw(st.integers(0, count - 1))
    values = np.arange(count, dtype=np.float64)[:, np.newaxis] + 1
    sums, near, far = sums_behind(one, other, root, values)

    def connected(edges):
        found = {root}
        for _ in range(count):
            for edge in edges:
                pair = {int(one[edge]), int(other[edge])}
                if pair & found:
                    found |= pair
        return found

    every = connected(range(len(one)))
    for edge in range(len(one)):
        before = connected([k for k in range(len(one)) if k != edge])
        lost = every - before
        if not lost:
            assert np.isnan(sums[edge]).all()
            assert near[edge] == far[edge] == -1
            continue
        assert sums[edge, 0] == sum(node + 1 for node in lost)
        assert near[edge] in before
        assert far[edge] in lost


@pytest.mark.parametrize("count", [1, 3])
def test_there_may_be_no_edges(count):
    nothing = np.zeros(0, dtype=np.int32)
    labels, meetings = joined(count, nothing, nothing)
    assert labels.tolist() == list(range(count))
    assert not len(meetings)


def test_each_unbroken_border_between_regions_is_a_door():
    # basins 0 and 1 meet in two places, basin 2 meets both in a third one
    basins = np.array(
        [
            [0, 0, 1, 1],
            [0, -1, -1, 1],
            [0, 0, 1, 1],
            [0, 0, 1, 1],
            [0, -1, -1, 1],
            [0, 2, 2, 1],
        ],
        dtype=np.int32,
    )
    squared = np.where(basins < 0, 0, 9).astype(np.int32)
    squared[0, 1], squared[2, 1], squared[3, 2], squared[5, 1] = 4, 2, 5, 3
    found = saddles_between(squared, basins, np.arange(3))
    assert found.tolist() == [[22, 1, 2], [14, 0, 1], [1, 0, 1], [21, 0, 2]]
    assert saddles_between(squared, basins, np.array([0, 0, 0])).tolist() == []
    # one region: both doors between the others stay
    assert saddles_between(squared, basins, np.array([0, 1, 1])).tolist() == [
        [14, 0, 1], [1, 0, 1], [21, 0, 1]
    ]  # fmt: skip
