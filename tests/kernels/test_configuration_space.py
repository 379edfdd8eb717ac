"""Open poses and ways between them against a search pose by pose."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.grid.footprint import Footprint, footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.kernels.paths import open_poses
from mapdeal.kernels.polygons import Spans
from strategies import examples

pytestmark = pytest.mark.slow


def as_spans(runs):
    return Spans(*np.array(runs, dtype=np.int64).T)


def covered(runs):
    """The cells of runs (row, first column, the one behind the last)."""
    return {(row, col) for row, start, stop in runs for col in range(start, stop)}


def check(blocked, footprints, seeds, cells):
    space = open_poses(blocked, [as_spans(runs) for runs in footprints], None)
    opened = oracles.open_poses(blocked, [covered(runs) for runs in footprints])
    reached = oracles.reached_poses(opened, seeds)
    np.testing.assert_array_equal(space.headings, opened.sum(axis=0))
    assert space.headings.dtype == np.uint8
    for row, col in cells:
        np.testing.assert_array_equal(space.at(row, col), opened[:, row, col])
    for _ in range(2):
        reachable, headings = space.reach(seeds, cells)
        np.testing.assert_array_equal(reachable, reached.any(axis=0))
        expected = np.array([reached[:, row, col] for row, col in cells], dtype=bool)
        np.testing.assert_array_equal(headings, expected.reshape(-1, len(footprints)))


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
    seeds = draw(st.lists(st.tuples(st.integers(0, len(footprints) - 1), row, col), max_size=4))
    return blocked, footprints, seeds, draw(st.lists(st.tuples(row, col), max_size=3))


@given(spaces(longest=12))
def test_the_ways_of_any_footprint_are_those_of_a_search(each_engine, case):
    check(*case)


@examples(12)
@given(spaces(longest=130))
def test_the_ways_on_grids_wider_than_a_word_are_those_of_a_search(each_engine, case):
    check(*case)


FAR = 2**40
NOWHERE = [[(0, 0, 71)], [(0, -FAR, 1 - FAR), (FAR, 0, 1)], [(0, 80, 90)], [(-3, 0, 1), (0, 0, 1)]]


@pytest.mark.parametrize("footprint", NOWHERE)
def test_a_footprint_that_fits_nowhere_is_open_nowhere(each_engine, footprint):
    space = open_poses(np.zeros((3, 70), dtype=bool), [as_spans(footprint)] * 2, None)
    assert not space.headings.any()
    assert not space.reach([(0, 1, 1)], [(1, 1)])[0].any()


@pytest.mark.parametrize("count", [1, 3, 255])
def test_any_count_of_headings_up_to_a_byte(each_engine, count):
    blocked = np.random.default_rng(count).random((9, 80)) < 0.1
    space = open_poses(blocked, [as_spans([(0, 0, 2)])] * count, None)
    np.testing.assert_array_equal(space.headings, count * (space.headings > 0))
    opened = oracles.open_poses(blocked, [{(0, 0), (0, 1)}])[0]
    np.testing.assert_array_equal(space.headings > 0, opened)


def random_case(rng, shape):
    """Rooms with a few doors and rubbish in them, and rectangles turned a little."""
    blocked = rng.random(shape) < 0.01
    blocked[:: shape[0] // 3] = blocked[:, :: shape[1] // 5] = True
    for row, col in rng.integers(0, shape, (60, 2)):
        blocked[row : row + 9, col : col + 9] = False
    robot = Footprint.polygon([[0.3, 0.1], [0.3, -0.1], [-0.2, -0.1], [-0.2, 0.1]])
    spans = footprint_spans(robot, Frame(*shape, 0.05, (0.0, 0.0, 0.3)), int(rng.integers(4, 30)))
    seeds = rng.integers(0, (len(spans), *shape), (40, 3)).tolist()
    return blocked, spans, [tuple(seed) for seed in seeds]


@needs_compiled
@pytest.mark.parametrize("shape", [(97, 300), (33, 1100), (200, 64), (65, 2048)])
def test_both_engines_give_the_same_bytes_with_any_threads(shape):
    blocked, spans, seeds = random_case(np.random.default_rng(7), shape)
    cells = [(row, col) for _, row, col in seeds]

    def contents():
        space = open_poses(blocked, spans, None)
        opened = np.array([space.at(*cell) for cell in cells])
        reachable, headings = space.reach(seeds, cells)
        assert 0 < reachable.sum() < reachable.size
        arrays = space.headings, opened, reachable, headings
        return [(array.dtype, array.tolist()) for array in arrays]

    first, *repeated = by_each_engine(contents, threads=(1, 3))
    assert repeated == [first, first]


@pytest.fixture
def rounds(monkeypatch):
    """Limit the words of cells that wait at a time; return how often the limit was reached."""
    from mapdeal.kernels import compiled

    counted, flood = [], compiled.flood

    def counting(*words):
        counted.append(flood(*words))

    monkeypatch.setattr(compiled, "_FEWEST_WAITING", 4)
    monkeypatch.setattr(compiled, "_SHARE_WAITING", 1 << 30)
    monkeypatch.setattr(compiled, "flood", counting)
    monkeypatch.setenv("MAPDEAL_KERNELS", "compiled")
    return counted


@needs_compiled
def test_what_finds_no_room_to_wait_is_not_lost(rounds, monkeypatch):
    blocked, spans, seeds = random_case(np.random.default_rng(5), (60, 1500))
    compiled, _ = open_poses(blocked, spans, None).reach(seeds, [])
    assert rounds[0] > 0
    monkeypatch.setenv("MAPDEAL_KERNELS", "scipy")
    np.testing.assert_array_equal(compiled, open_poses(blocked, spans, None).reach(seeds, [])[0])


@needs_compiled
@pytest.mark.parametrize("along", [False, True])
def test_combs_are_reached_to_the_tips(rounds, along):
    blocked = np.zeros((150, 1500), dtype=bool)
    teeth = blocked if along else blocked.T
    teeth[1::2, 1:] = True
    a_cell = Spans(*np.array([[0], [0], [1]]))
    reachable, _ = open_poses(blocked, [a_cell] * 5, None).reach([(2, 0, 0)], [])
    np.testing.assert_array_equal(reachable, ~blocked)
    assert rounds[0] > 0
