import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal.kernels import sensing
from mapdeal.kernels.sensing import DISTANCE_UNIT, Odds, count_rays, measure_rays, weigh_rays
from mapdeal.kernels.threads import use_threads
from oracles import line

pytestmark = pytest.mark.usefixtures("each_engine")

CELLS = st.tuples(st.integers(-9, 20), st.integers(-9, 20))
FAR = st.one_of(CELLS, st.tuples(st.integers(-(2**30), 2**30), st.integers(-9, 20)))
SHAPES = st.tuples(st.integers(1, 11), st.integers(1, 13))


def inside(cell, shape):
    return 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1]


def beams(draw_of=CELLS):
    return st.lists(st.tuples(draw_of, draw_of, st.booleans()), max_size=25)


def arrays(rays):
    starts = np.array([ray[0] for ray in rays], dtype=np.int64).reshape(-1, 2)
    ends = np.array([ray[1] for ray in rays], dtype=np.int64).reshape(-1, 2)
    return starts, ends, np.array([ray[2] for ray in rays], dtype=bool)


@given(shape=SHAPES, rays=beams(), threads=st.integers(1, 3))
def test_counts_are_those_of_walking_along_each_line(shape, rays, threads):
    hits, misses = np.zeros((2, *shape), dtype=np.int32)
    with use_threads(threads):
        count_rays(*arrays(rays), hits, misses)
    expected_hits, expected_misses = np.zeros((2, *shape), dtype=int)
    for start, end, is_hit in rays:
        *passed, last = line(start, end)
        assert last == end
        for cell in passed:
            if inside(cell, shape):
                expected_misses[cell] += 1
        if is_hit and inside(last, shape):
            expected_hits[last] += 1
    np.testing.assert_array_equal(hits, expected_hits)
    np.testing.assert_array_equal(misses, expected_misses)


ODDS = st.sampled_from(
    [Odds(-1, 2, 0, 100), Odds(-3, 5, -4, 6), Odds(-7, 7, 0, 10), Odds(2, -3, 0, 9)]
)


@given(
    shape=SHAPES,
    rays=beams(),
    odds=ODDS.map(lambda o: Odds(*o)),
    start=st.integers(0, 6),
    threads=st.integers(1, 3),
)
def test_values_are_clamped_after_each_ray(shape, rays, odds, start, threads):
    """Few cells and tight bounds, so that the order of the rays matters."""
    values, seen = np.full(shape, start, dtype=np.int32), np.zeros(shape, dtype=np.uint8)
    with use_threads(threads):
        weigh_rays(*arrays(rays), odds, values, seen)
    expected, observed = np.full(shape, start), np.zeros(shape, dtype=bool)
    hits = np.zeros(shape, dtype=int)
    for first, end, is_hit in rays:
        *passed, last = line(first, end)
        steps = [(cell, odds.on_miss) for cell in passed] + [(last, odds.on_hit)] * is_hit
        for cell, added in steps:
            if inside(cell, shape):
                expected[cell] = min(max(expected[cell] + added, odds.lowest), odds.highest)
                observed[cell] = True
        if is_hit and inside(last, shape):
            hits[last] += 1
    np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(seen, observed + 2 * np.minimum(hits, 3))


@given(
    shape=SHAPES,
    rays=beams(),
    seed=st.integers(0, 999),
    truncation=st.sampled_from([0.7, 2.0, 5.0]),
    behind=st.sampled_from([0.5, 1.0, 3.0]),
)
def test_distances_are_those_from_the_sensor_to_the_centres(shape, rays, seed, truncation, behind):
    starts, ends, is_hit = arrays(rays)
    rng = np.random.default_rng(seed)
    sensors = starts + rng.random((len(rays), 2))
    ranges = np.where(is_hit, rng.uniform(0, 25, len(rays)), np.inf)
    sums, weights = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int32)
    measure_rays(starts, ends, sensors, ranges, truncation, behind, sums, weights)
    expected, counts = np.zeros(shape), np.zeros(shape, dtype=int)
    for k, (first, end, _) in enumerate(rays):
        for row, col in line(first, end):
            away = math.dist((row + 0.5, col + 0.5), sensors[k])
            share = (ranges[k] - away) / truncation
            if inside((row, col), shape) and share >= -behind:
                expected[row, col] += max(min(share, 1.0), -1.0)
                counts[row, col] += 1
    np.testing.assert_array_equal(weights, counts)
    np.testing.assert_allclose(sums / DISTANCE_UNIT, expected, atol=1e-6 * max(1, len(rays)))


def test_a_ray_to_the_sensor_s_own_cell_is_a_hit_alone():
    hits, misses = np.zeros((2, 3, 3), dtype=np.int32)
    count_rays(
        np.array([[1, 1]] * 2), np.array([[1, 1]] * 2), np.array([True, False]), hits, misses
    )
    assert hits.sum() == hits[1, 1] == 1
    assert not misses.any()


@settings(max_examples=60)
@given(shape=SHAPES, rays=beams(FAR))
def test_rays_from_and_to_far_away_take_no_longer(shape, rays):
    """Lines of 2^31 cells are clipped before they are walked: equal to those of the twin."""
    starts, ends, is_hit = arrays(rays)
    hits, misses, twin_hits, twin_misses = np.zeros((4, *shape), dtype=np.int32)
    count_rays(starts, ends, is_hit, hits, misses)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAPDEAL_KERNELS", "scipy")
        count_rays(starts, ends, is_hit, twin_hits, twin_misses)
    np.testing.assert_array_equal(hits, twin_hits)
    np.testing.assert_array_equal(misses, twin_misses)


@pytest.mark.slow
@pytest.mark.parametrize("length", [65_534, 65_535, 65_536, 131_071])
@pytest.mark.parametrize("minor", [0, 1, 7, 40, 21_845, 32_767, 65_533, 65_534])
@pytest.mark.parametrize("is_upright", [False, True])
def test_long_lines_move_where_their_equation_says(length, minor, is_upright):
    shape = (16, length)  # which holds the beginning of the line, or its end
    step = np.arange(length)
    for low in {0, max(0, minor - 15)}:
        moves = (length // 2 + step * minor) // length - low
        kept = (moves >= 0) & (moves < 16)
        expected = np.zeros(shape, dtype=np.int32)
        expected[moves[kept], step[kept]] = 1
        start, end = (-low, 0), (minor - low, length)
        if is_upright:
            start, end, expected = start[::-1], end[::-1], expected.T
        hits, misses = np.zeros((2, *expected.shape), dtype=np.int32)
        count_rays(np.array([start]), np.array([end]), np.array([True]), hits, misses)
        np.testing.assert_array_equal(misses, expected)


def test_a_far_line_passes_where_its_equation_says():
    """From (-2^29, 5) to (2^29, 7): near row 0 it has moved by half, to column 6."""
    hits, misses = np.zeros((2, 4, 9), dtype=np.int32)
    far = 2**29
    count_rays(np.array([[-far, 5]]), np.array([[far, 7]]), np.array([True]), hits, misses)
    assert np.argwhere(misses).tolist() == [[row, 6] for row in range(4)]


@pytest.mark.thorough
@needs_compiled
def test_many_rays_give_the_same_bytes_on_both_engines_and_any_threads(monkeypatch):
    """More cells than the twin takes together."""
    rng = np.random.default_rng(4)
    count, shape = 60_000, (300, 260)
    starts = rng.integers(-20, 320, (count, 2))
    ends = starts + rng.integers(-150, 150, (count, 2))
    is_hit = rng.random(count) < 0.7
    sensors, ranges = starts + rng.random((count, 2)), np.abs(rng.normal(0, 90, count))
    found = []
    for engine, threads in (("compiled", 1), ("compiled", 3), ("scipy", 1)):
        monkeypatch.setenv("MAPDEAL_KERNELS", engine)
        hits, misses, values, weights = np.zeros((4, *shape), dtype=np.int32)
        seen, sums = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.int64)
        with use_threads(threads):
            count_rays(starts, ends, is_hit, hits, misses)
            weigh_rays(starts, ends, is_hit, Odds(-1, 2, -40, 50), values, seen)
            measure_rays(starts, ends, sensors, ranges, 2.5, 1.7, sums, weights)
        found.append([layer.tobytes() for layer in (hits, misses, values, seen, sums, weights)])
    assert found[0] == found[1] == found[2]
    assert misses.sum() > sensing._CELLS_TOGETHER


@needs_compiled
def test_arrays_of_other_shapes_are_refused():
    from mapdeal.kernels import _rays

    cells, hit = np.zeros((2, 2), np.int64), np.zeros(2, np.uint8)
    layer, other = np.zeros((3, 4), np.int32), np.zeros((3, 5), np.int32)
    with pytest.raises(ValueError, match="shape"):
        _rays.count(cells, cells, hit, layer, other, 0, 3)
    with pytest.raises(ValueError, match="beams"):
        _rays.count(cells, cells, hit[:1], layer, layer, 0, 3)
    with pytest.raises(IndexError):
        _rays.count(cells, cells, hit, layer, layer, 0, 4)


@pytest.mark.usefixtures("each_engine")
@pytest.mark.parametrize(
    ("behind", "expected"),
    [
        (0.5, [1, 1, 0.5, 0, -0.5]),
        (1.0, [1, 1, 0.5, 0, -0.5, -1]),
        (2.0, [1, 1, 0.5, 0, -0.5, -1, -1, -1]),
    ],
)
def test_a_cell_so_many_truncations_behind_the_surface_is_measured_the_next_is_not(
    behind, expected
):
    sums, weights = np.zeros((1, 10), np.int64), np.zeros((1, 10), np.int32)
    # from the centre of cell 0 to a surface 3 cells on; a truncation of 2 cells
    measure_rays(
        np.array([[0, 0]]), np.array([[0, 9]]), np.array([[0.5, 0.5]]), np.array([3.0]),
        2.0, behind, sums, weights,
    )  # fmt: skip
    count = len(expected)
    assert (sums[0] / DISTANCE_UNIT).tolist() == expected + [0] * (10 - count)
    assert weights.tolist() == [[1] * count + [0] * (10 - count)]


@needs_compiled
@pytest.mark.parametrize(("start", "end"), [((1, 3), (1, 2)), ((1, 2), (1, 3)), ((1, 1), (1, 1))])
def test_cells_of_rays_have_two_numbers_each(start, end):
    from mapdeal.kernels import _rays

    hits, misses = np.zeros((2, 2, 4), np.int32)
    with pytest.raises(ValueError, match="cells have two columns"):
        _rays.count(
            np.zeros(start, np.int64), np.zeros(end, np.int64), np.zeros(1, np.uint8),
            hits, misses, 0, 2,
        )  # fmt: skip
