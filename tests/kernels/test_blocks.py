"""Blocks of rows, and rotations against scipy's."""

import math
import threading
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from mapdeal.kernels import blocks, rotations
from mapdeal.kernels.threads import use_threads

ALL_ROWS = np.arange(23 * 4).reshape(23, 4).astype(np.uint8)
POINTS = st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=12)


def lazy(block_height=5, keep=0, requested=None, make=ALL_ROWS.__getitem__, **options):
    """Return a lazy layer of ALL_ROWS that appends the rows it makes to `requested`."""

    def listed(rows):
        if requested is not None:
            requested.append((rows.start, rows.stop))
        return make(rows)

    options |= {"block_height": block_height, "keep": keep}
    return blocks.LazyLayer(ALL_ROWS.shape, np.uint8, listed, **options)


@given(st.integers(-30, 30), st.integers(-30, 30), st.integers(1, 30), st.integers(0, 3))
def test_any_slice_is_that_of_the_array(first, end, block_height, keep):
    layer = lazy(block_height, keep)
    assert np.array_equal(layer[first:end], ALL_ROWS[first:end])
    assert layer[first:end].dtype == ALL_ROWS.dtype


def test_kept_blocks_are_made_whole_and_once():
    requested = []
    layer = lazy(keep=2, requested=requested)
    layer[3:7], layer[4:6], layer[9:10]
    assert requested == [(0, 5), (5, 10)]
    layer[22:]
    layer[0:1]  # gone: two are kept, and two others were asked for since
    assert requested == [(0, 5), (5, 10), (20, 23), (0, 5)]


def test_a_block_that_two_threads_ask_for_is_made_once():
    begun, may_end, requested = threading.Event(), threading.Event(), []

    def make(rows):
        begun.set()
        assert may_end.wait(120)
        return ALL_ROWS[rows]

    layer = lazy(23, keep=1, requested=requested, make=make)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(lambda: layer[0:3])
        assert begun.wait(120)
        second = pool.submit(lambda: layer[2:9])
        may_end.set()
        assert np.array_equal(first.result(), ALL_ROWS[0:3])
        assert np.array_equal(second.result(), ALL_ROWS[2:9])
    assert requested == [(0, 23)]


def test_an_error_is_raised_to_each_caller_and_not_cached():
    layer = lazy(23, keep=1, make=mock.Mock(side_effect=[OSError("gone"), ALL_ROWS]))
    with pytest.raises(OSError, match="gone"):
        layer[0:3]
    assert np.array_equal(layer[0:3], ALL_ROWS[0:3])


def test_a_lazy_layer_can_be_had_whole_and_is_never_compared_by_accident():
    layer = lazy(keep=1)
    assert np.array_equal(np.asarray(layer), ALL_ROWS)
    assert np.asarray(layer, dtype=np.int64).dtype == np.int64
    for use in (lambda: layer == 3, lambda: layer > 3, lambda: layer + ALL_ROWS, lambda: layer[3]):
        with pytest.raises((TypeError, AttributeError)):
            use()


@given(st.integers(1, 30), st.integers(0, 30))
def test_a_window_has_its_halo_and_gives_its_rows(block_height, halo):
    def largest_around(layer):
        def change(rows):
            part = layer[rows].astype(np.int64)
            reached = [part[max(k - halo, 0) : k + halo + 1].max(axis=0) for k in range(len(part))]
            return np.array(reached)

        return change

    layer = lazy(block_height)
    expected = np.array([ALL_ROWS[max(k - halo, 0) : k + halo + 1].max(axis=0) for k in range(23)])
    for source in (ALL_ROWS, layer):
        product = blocks.made_by_windows(source, np.int64, largest_around(source), halo=halo)
        assert blocks.is_lazy(product) == (source is layer)
        assert np.array_equal(product[:], expected)
        assert np.array_equal(product[4:9], expected[4:9])


@pytest.mark.parametrize(("size", "times"), [(23 * 4 * 8, 1), (23 * 4 * 8 - 1, 2)])
def test_a_layer_is_kept_whole_if_the_budget_has_room(size, times):
    requested = []
    source = lazy(requested=requested, budget=blocks.CacheBudget(size))
    with use_threads(1):
        layer = blocks.made_by_rows(source, np.int64, lambda rows: source[rows] + 0, is_cached=True)
    for _ in range(2):
        pieces = [layer[first : first + 3] for first in range(0, 23, 3)]
        assert np.array_equal(np.vstack(pieces), ALL_ROWS)
    assert [first for first, _ in requested] == [0, 5, 10, 15, 20] * times
    assert (layer.block_height, layer.dtype) == (5, np.int64)


def test_passes_through_lazy_layers_report_rows_that_are_done():
    reports = []
    with blocks.rows_reported(lambda rows, height: reports.append((rows, height))):
        for rows in blocks.swept(lazy()):
            assert sum(count for count, _ in reports) == rows.start
        for _ in blocks.swept(ALL_ROWS):
            pass
    assert reports == [(5, 23)] * 4 + [(3, 23)]
    for _ in blocks.swept(lazy()):
        pass
    assert len(reports) == 5


def test_the_budget_is_shared_by_all_layers_of_a_map():
    budget = blocks.CacheBudget(23 * 4 + 23 * 3 + 1)
    layer = blocks.made_by_rows(lazy(budget=budget), np.uint8, ALL_ROWS.__getitem__, is_cached=True)
    narrow = blocks.made_by_rows(layer, np.int8, lambda rows: ALL_ROWS[rows, :3], shape=(23, 3))
    blocks.made_by_rows(narrow, np.int8, lambda rows: ALL_ROWS[rows, :3], is_cached=True)
    assert budget.take(1)
    assert not budget.take(1)


parts = st.floats(-1, 1, allow_subnormal=False)
axes = st.tuples(parts, parts, parts).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(axes, st.floats(-12, 3.1).map(lambda x: 10**x if x < 0 else x), st.floats(0, 1))
def test_slerp_turns_at_constant_speed(axis, angle, share):
    start, axis = Rotation.from_rotvec([0.3, -1.1, 0.7]), np.array(axis) / np.linalg.norm(axis)
    end = start * Rotation.from_rotvec(axis * angle)
    expected = start * Rotation.from_rotvec(axis * angle * share)
    for sign in (1, -1):  # a quaternion and its negative are one rotation
        quats = start.as_quat()[None], sign * end.as_quat()[None]
        found = rotations.slerp(*quats, np.array([share]))[0]
        assert np.linalg.norm(found) == pytest.approx(1, abs=1e-15)
        assert (Rotation.from_quat(found) * expected.inv()).magnitude() < 1e-11


@pytest.mark.parametrize("shape", [(), (1,), (2, 3)])
def test_arrays_of_rotations_equal_single_rotations_of_scipy(shape):
    rng = np.random.default_rng(7)
    quats, second_quats = rotations.normalised(rng.normal(size=(2, *shape, 4)))
    vectors, moves = rng.normal(size=(2, *shape, 3))
    first, second = (Rotation.from_quat(q.reshape(-1, 4)) for q in (quats, second_quats))
    flat, flat_moves = vectors.reshape(-1, 3), moves.reshape(-1, 3)

    def assert_close(found, expected):
        np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=1e-14)

    assert_close(rotations.rotated(quats, vectors), first.apply(flat))
    inverse = rotations.undone((vectors, quats))[1]
    assert_close(rotations.rotated(inverse, vectors), first.inv().apply(flat))
    product = Rotation.from_quat(rotations.multiplied(quats, second_quats).reshape(-1, 4))
    assert_close(product.as_matrix(), (first * second).as_matrix())
    move, turn = rotations.composed((moves, quats), (vectors, second_quats))
    assert_close(move, first.apply(flat) + flat_moves)
    assert_close(turn, rotations.multiplied(quats, second_quats))
    move, turn = rotations.composed(rotations.undone((moves, quats)), (moves, quats))
    assert_close(move, np.zeros_like(flat))
    assert_close(turn, np.broadcast_to([0.0, 0.0, 0.0, 1.0], quats.shape).reshape(-1, 4))


def test_yaws_turn_the_x_axis():
    yaws = np.array([[-3.0, -0.4, 0.0], [0.7, 1.9, 3.1]])
    ahead = rotations.rotated(rotations.from_yaw(yaws), np.array([1.0, 0.0, 0.0]))
    expected = np.stack([np.cos(yaws), np.sin(yaws), np.zeros_like(yaws)], axis=-1)
    np.testing.assert_allclose(ahead, expected, atol=1e-15)
    half = rotations.slerp(rotations.from_yaw([0.0]), rotations.from_yaw([np.pi]), np.array([0.5]))
    assert abs(Rotation.from_quat(half[0]).magnitude() - np.pi / 2) < 1e-12


@pytest.mark.parametrize("shape", [(), (1,), (4, 5)])
def test_a_matrix_times_its_inverse_is_one(shape):
    matrices = np.random.default_rng(3).normal(size=(*shape, 3, 3)) + 3 * np.eye(3)
    product = np.einsum("...ij,...jk", matrices, rotations.inverse_matrices(matrices))
    assert product == pytest.approx(np.broadcast_to(np.eye(3), product.shape), abs=1e-12)


def energy_by_strips(points, angle, width):
    """Sum squared counts of strips; each point counts for the two nearest ones."""
    counts = defaultdict(float)
    for x, y in points - points.mean(axis=0):
        place = (y * math.cos(angle) - x * math.sin(angle)) / width
        lower = math.floor(place)
        counts[lower] += lower + 1 - place
        counts[lower + 1] += place - lower
    return sum(count**2 for count in counts.values())


@given(POINTS, st.floats(-4, 4), st.floats(0.3, 3))
def test_the_spectrum_counts_points_in_strips(points, angle, width):
    found = rotations.hough_spectrum(np.array(points), np.array([angle, angle + math.pi]), width)
    assert found[0] == pytest.approx(energy_by_strips(np.array(points), angle, width))
    assert found[1] == pytest.approx(found[0])


def rooms(turn, shape=(260, 340)):
    """A building of four rooms with open doors, its walls two cells thick, turned anticlockwise."""
    rows, cols = np.mgrid[: shape[0], : shape[1]].reshape(2, -1).astype(float)
    x, y = cols - shape[1] / 2, rows - shape[0] / 2
    x, y = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    inside = (abs(x) < 101) & (abs(y) < 61)
    outline = inside & ~((abs(x) < 99) & (abs(y) < 59))
    across = inside & (abs(y - 7.3) < 1) & ((abs(x) < 30) | (abs(x) > 55))
    along = inside & (abs(x + 21.7) < 1) & (abs(y) > 9)
    return (outline | across | along).reshape(shape)


@pytest.mark.parametrize("degrees", [0.0, 0.4, -17.8, 44.5, 45.5, -100.0])
def test_the_main_direction_is_that_of_a_turned_building(degrees):
    found = rotations.main_direction(rooms(math.radians(degrees)))
    error = math.degrees(math.remainder(found - math.radians(degrees), math.pi / 2))
    assert abs(error) < (0.1 if degrees else 1e-300)  # a straight map gives exactly 0
    assert abs(found) <= math.pi / 4 + 1e-9


def test_circles_noise_and_nothing_have_no_main_direction():
    rows, cols = np.mgrid[:150, :210]
    circle = abs(np.hypot(rows - 70, cols - 100) - 60) < 1.5
    noise = np.random.default_rng(3).random((150, 210)) < 0.1
    for occupied in (circle, noise, np.zeros((30, 40), bool), np.ones((30, 40), bool)):
        assert rotations.main_direction(occupied) is None


@pytest.mark.parametrize("turns", [(2,), (1, 2, 3), ()])
def test_symmetric_maps_coincide_at_their_quarter_turns(turns):
    rng = np.random.default_rng(3)
    walls = np.zeros((41, 41 if turns == (1, 2, 3) else 57), dtype=bool)
    walls[rng.integers(0, walls.shape[0], 60), rng.integers(0, walls.shape[1], 60)] = True
    for k in turns:
        walls |= np.rot90(walls, k)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    inside = np.pad(~walls, ((5, 0), (0, 9)))  # the centres of map and array differ
    found = rotations.coincidences(np.pad(walls, ((5, 0), (0, 9))), inside, tolerance=1)
    assert [k for k, shares in enumerate(found, 1) if min(shares) > 0.9] == list(turns)
    assert all(found[k - 1] == (1.0, 1.0) for k in turns), found
