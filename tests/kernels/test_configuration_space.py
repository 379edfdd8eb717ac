"""Open poses and ways between them against a search pose by pose."""

import gc
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import oracles
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.paths import ConfigurationSpace
from mapdeal.kernels.polygons import Spans
from mapdeal.kernels.threads import thread_count

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("each_engine")]


def as_spans(runs):
    return Spans(*np.array(runs, dtype=np.int64).T)


def covered(runs):
    """The cells of runs (row, first column, the one behind the last)."""
    return {(row, col) for row, start, stop in runs for col in range(start, stop)}


def check(blocked, footprints, seeds, cells):
    """Hold a space to the search, for footprints as lists of runs."""
    space = ConfigurationSpace(blocked, [as_spans(runs) for runs in footprints])
    opened = oracles.open_poses(blocked, [covered(runs) for runs in footprints])
    reached = oracles.reached_poses(opened, seeds)
    np.testing.assert_array_equal(space.headings, opened.sum(axis=0))
    assert space.headings.dtype == np.uint8
    for row, col in cells:
        np.testing.assert_array_equal(space.open_headings(row, col), opened[:, row, col])
    for _ in range(2):
        found = space.reach(seeds, cells)
        np.testing.assert_array_equal(found.reachable, reached.any(axis=0))
        expected = np.array([reached[:, row, col] for row, col in cells], dtype=bool)
        np.testing.assert_array_equal(found.headings, expected.reshape(-1, len(footprints)))


@st.composite
def spaces(draw, longest):
    """A map, of which most is free, footprints of a few runs anywhere, and poses and cells."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    blocked = rng.random((height, width)) < draw(st.sampled_from([0.0, 0.02, 0.1, 0.4, 1.0]))
    longest_run = draw(st.sampled_from([1, 2, 9, longest]))
    run = st.builds(
        lambda row, start, length: (row, start, start + length), st.integers(-3, 3),
        st.integers(-longest_run, longest_run), st.integers(1, longest_run),
    )  # fmt: skip
    footprint = st.lists(run, min_size=1, max_size=draw(st.sampled_from([1, 5])))
    footprints = draw(st.lists(footprint, min_size=1, max_size=9))
    row, col = st.integers(0, height - 1), st.integers(0, width - 1)
    heading = st.integers(0, len(footprints) - 1)
    seeds = draw(st.lists(st.tuples(heading, row, col), max_size=4))
    return blocked, footprints, seeds, draw(st.lists(st.tuples(row, col), max_size=3))


@given(spaces(longest=12))
def test_the_ways_of_any_footprint_are_those_of_a_search(case):
    check(*case)


@settings(max_examples=15)
@given(spaces(longest=150))
def test_the_ways_on_grids_wider_than_a_word_are_those_of_a_search(case):
    check(*case)


@pytest.mark.parametrize(
    "footprint",
    [
        [(0, 0, 71)],
        [(0, -(2**40), -(2**40) + 1), (2**40, 0, 1)],
        [(10**6, 0, 1)],
        [(0, 80, 90)],
        [(-3, 0, 1), (0, 0, 1)],
    ],
)
def test_a_footprint_that_fits_nowhere_is_open_nowhere(footprint):
    space = ConfigurationSpace(np.zeros((3, 70), dtype=bool), [as_spans(footprint)] * 2)
    assert not space.headings.any()
    assert not space.reach([(0, 1, 1)], [(1, 1)]).reachable.any()


@pytest.mark.parametrize("count", [1, 2, 3, 255])
def test_any_count_of_headings_up_to_a_byte(count):
    blocked = np.random.default_rng(count).random((9, 80)) < 0.1
    space = ConfigurationSpace(blocked, [as_spans([(0, 0, 2)])] * count)
    np.testing.assert_array_equal(space.headings, count * (space.headings > 0))
    opened = oracles.open_poses(blocked, [{(0, 0), (0, 1)}])[0]
    np.testing.assert_array_equal(space.headings > 0, opened)


@pytest.mark.parametrize(
    "footprints",
    [[], [as_spans([(0, 0, 1)])] * 256, [as_spans([(0, 2, 2)])], [Spans(*[np.zeros(0)] * 3)]],
)
def test_what_is_no_set_of_headings_is_refused(footprints):
    with pytest.raises(ValueError, match=r"heading|footprint"):
        ConfigurationSpace(np.zeros((3, 7), dtype=bool), footprints)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [5, 40])
def test_it_takes_the_memory_that_it_says(count):
    shape = (400, 500)
    blocked = np.zeros(shape, dtype=bool)
    robot = as_spans([(-5, -9, 10), (0, -20, 19)])
    ndimage.label(blocked)  # modules take memory, too
    gc.collect()
    tracemalloc.start()
    try:
        space = ConfigurationSpace(blocked, [robot] * count)
        found = space.reach([(0, 200, 300)])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.reachable.any()
    height, width = shape
    if engine_name() == "compiled":
        # planes, the cells that are blocked and reached with the slots of tiles, and what waits or
        # the areas that rows of poses are made in
        tiles = height * -(-width // 64)
        areas = thread_count() * (32 + 39) * (6 + 1) * (16 + 1 + 39 // 64) * 8
        waiting = max(1024, tiles // 64) * (8 * count + 4 + 8)
        said = tiles * (8 * count + 13) + height * (width // 8 + 1) + max(waiting, areas)
    else:
        # planes, and then dilations or three headings' labels, with pairs of those that touch
        planes = count * height * (width // 8 + 1)
        said = planes + height * width * max(6 + 3, 3 * 4 + 3 * 8 + 6)
    said += 2 * height * width
    assert 0.5 * said < peak <= said
