import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels import sensing
from mapdeal.kernels.sensing import DISTANCE_UNIT, Odds, count_rays, measure_rays, weigh_rays

FAR = st.tuples(st.integers(-9, 20) | st.integers(-(2**30), 2**30), st.integers(-9, 20))


@needs_compiled
@settings(max_examples=60)
@given(
    shape=st.tuples(st.integers(1, 11), st.integers(1, 13)),
    rays=st.lists(st.tuples(FAR, FAR, st.booleans()), min_size=1, max_size=25),
)
def test_rays_from_and_to_far_away_take_no_longer(shape, rays):
    """Lines of 2^31 cells are clipped before they are walked, on both engines alike."""
    starts, ends, is_hit = (np.array(some) for some in zip(*rays, strict=True))

    def counts():
        hits, misses = np.zeros((2, *shape), dtype=np.int32)
        count_rays(starts, ends, is_hit, hits, misses)
        return hits.tolist(), misses.tolist()

    compiled, twin = by_each_engine(counts)
    assert compiled == twin


@pytest.mark.slow
@pytest.mark.usefixtures("each_engine")
@pytest.mark.parametrize("length", [65_534, 65_535, 65_536, 131_071])
@pytest.mark.parametrize("minor", [0, 1, 7, 21_845, 32_767, 65_534])
@pytest.mark.parametrize("is_upright", [False, True])
def test_long_lines_move_where_their_equation_says(length, minor, is_upright):
    shape = (16, length)  # which holds the beginning of the line, or its end
    step = np.arange(length)
    for low in {0, max(0, minor - 15)}:
        moves = (length // 2 + step * minor) // length - low
        is_within = (moves >= 0) & (moves < 16)
        expected = np.zeros(shape, dtype=np.int32)
        expected[moves[is_within], step[is_within]] = 1
        start, end = (-low, 0), (minor - low, length)
        if is_upright:
            start, end, expected = start[::-1], end[::-1], expected.T
        hits, misses = np.zeros((2, *expected.shape), dtype=np.int32)
        count_rays(np.array([start]), np.array([end]), np.array([True]), hits, misses)
        np.testing.assert_array_equal(misses, expected)


@pytest.mark.thorough
@needs_compiled
def test_many_rays_give_the_same_bytes_on_both_engines_and_any_threads():
    """More cells than the twin takes together."""
    rng = np.random.default_rng(4)
    count, shape = 60_000, (300, 260)
    starts = rng.integers(-20, 320, (count, 2))
    ends = starts + rng.integers(-150, 150, (count, 2))
    is_hit = rng.random(count) < 0.7
    sensors, ranges = starts + rng.random((count, 2)), np.abs(rng.normal(0, 90, count))

    def layers():
        hits, misses, values, weights = np.zeros((4, *shape), dtype=np.int32)
        touched, sums = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.int64)
        count_rays(starts, ends, is_hit, hits, misses)
        weigh_rays(starts, ends, is_hit, Odds(-1, 2, -40, 50), values, touched)
        measure_rays(starts, ends, sensors, ranges, 2.5, 1.7, sums, weights)
        assert misses.sum() > sensing._CELLS_TOGETHER
        return [layer.tobytes() for layer in (hits, misses, values, touched, sums, weights)]

    first, *repeated = by_each_engine(layers, threads=(1, 3))
    assert repeated == [first, first]


@pytest.mark.usefixtures("each_engine")
@pytest.mark.parametrize(("behind", "behind_cells"), [(0.5, 1), (1.0, 2), (2.0, 4)])
def test_a_cell_so_many_truncations_behind_the_surface_is_measured_the_next_is_not(
    behind, behind_cells
):
    sums, weights = np.zeros((1, 10), np.int64), np.zeros((1, 10), np.int32)
    # from the centre of cell 0 to a surface 3 cells on; a truncation of 2 cells
    measure_rays(
        np.array([[0, 0]]), np.array([[0, 9]]), np.array([[0.5, 0.5]]), np.array([3.0]),
        2.0, behind, sums, weights,
    )  # fmt: skip
    measured = [1, 1, 0.5, 0, -0.5, -1, -1, -1][: 4 + behind_cells]
    assert (sums[0] / DISTANCE_UNIT).tolist() == measured + [0] * (6 - behind_cells)
    assert weights[0].tolist() == [1] * (4 + behind_cells) + [0] * (6 - behind_cells)
