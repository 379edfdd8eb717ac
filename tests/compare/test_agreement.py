"""How far maps agree at a place, counted by hand; walls on coarser cells."""

import math
import tracemalloc

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal.compare.align import TOLERANCES, Agreement, agreement_at, walls_of
from mapdeal.compare.walls import pooled
from mapdeal.grid.occupancy import OccupancyGrid


def strip(columns, width=60, resolution=0.5):
    """Free space with a wall of one cell by ten at each of some columns."""
    values = np.zeros((16, width), dtype=np.int8)
    values[3:13, columns] = 100
    return walls_of(OccupancyGrid(values, resolution, (2.0, 1.0, 0.4)))


def agreement(first, second, shift=0.0):
    return agreement_at(first, second, np.array([[0.0, shift, 0.0]]), 10_000)


def test_walls_on_walls_agree_and_walls_in_free_space_contradict():
    found = agreement(strip([10, 30]), strip([10, 50]))
    # of each map one wall of ten cells, 5 m, agrees, and the other one lies in free space
    np.testing.assert_allclose(found.agreeing, 5.0)
    np.testing.assert_allclose(found.contradicting, 5.0)
    np.testing.assert_allclose(found.shares, 0.5)
    assert found.overlap[0] == pytest.approx(1.0)
    assert found.piece == pytest.approx(0.015 * 10.0)


def test_a_wall_agrees_within_the_tolerance_not_beyond_and_maps_apart_share_none():
    for shift, agrees in [(0.0, 1), (0.5, 1), (1.0, 0)]:  # each tolerance is a cell, 0.5 m
        np.testing.assert_allclose(agreement(strip([20]), strip([20]), shift).shares[0], agrees)
    fine = strip([200], 600, 0.05)
    shares = agreement(fine, fine, 0.2).shares[0]
    np.testing.assert_allclose(shares, [tolerance > 0.2 for tolerance in TOLERANCES])
    found = agreement(strip([20]), strip([20]), 900.0)
    assert found.agreeing.max() == found.contradicting.max() == found.overlap[0] == 0
    assert found.evidence(found.by_chance()).tolist() == [0.0]


def test_a_wall_with_free_space_on_the_other_side_does_not_agree():
    values = np.zeros((10, 12), dtype=np.int8)
    values[:, -1] = 100
    west, east = (walls_of(OccupancyGrid(cells, 0.5)) for cells in (values, values[:, ::-1]))
    # the wall of the first map comes to lie on that of the second, back to back
    np.testing.assert_allclose(agreement(west, east, -5.5).agreeing, 0.0)
    assert agreement(west, west).agreeing[0, 0] == pytest.approx(5.0)


def test_evidence_is_the_divergence_from_chance_times_the_pieces_of_wall():
    agreeing = np.array([[18.0] * 4, [5.0] * 4, [2.0] * 4])
    contradicting = np.array([[2.0] * 4, [5.0] * 4, [18.0] * 4])
    found = Agreement(agreeing, contradicting, np.array([1.0, 0.1, 1.0]), 2.0)
    chance = np.full(4, 0.4)

    def divergence(share):
        return share * math.log(share / 0.4) + (1 - share) * math.log((1 - share) / 0.6)

    expected = [10 * divergence(0.9), 0.5 * 5 * divergence(0.5), 0.0]  # little overlap, no more
    np.testing.assert_allclose(found.evidence(chance), expected)


def test_chance_is_the_mean_of_wrong_places_that_have_much_in_common():
    agreeing = np.array([[90.0] * 4, [60.0] * 4, [30.0] * 4, [1.0] * 4])
    contradicting = np.array([[10.0] * 4, [20.0] * 4, [10.0] * 4, [0.0] * 4])
    found = Agreement(agreeing, contradicting, np.ones(4), 2.0)
    wrong = np.array([False, True, True, True])
    np.testing.assert_allclose(found.by_chance(wrong), 90 / 120)  # the last one has too little
    least = found.by_chance()
    assert (least < 0.75).all()
    np.testing.assert_allclose(found.by_chance(np.zeros(4, bool)), least)
    low = Agreement(contradicting[:1], agreeing[:1] + 1, np.ones(1), 2.0)
    np.testing.assert_allclose(low.by_chance(np.ones(1, bool)), least)  # never less


ROOM = """
    ?#######??
    ?#.....###
    ?###...+.#
    ??????????
"""


def test_faces_are_the_obstacles_beside_free_cells_with_their_distances():
    walls = walls_of(grid_from_text(ROOM))
    padded = np.pad(walls.free, 1)
    faces = [
        (row, col)
        for row, col in np.argwhere(walls.known & ~walls.free).tolist()
        if padded[row : row + 3, col : col + 3].any()
    ]
    cells = np.rint(walls.faces_xy[:, ::-1] / walls.resolution - 0.5).astype(int)
    assert sorted(map(tuple, cells.tolist())) == faces
    assert walls.wall_length == len(faces) * 0.25
    for cell in np.ndindex(walls.frame.shape):
        nearest = min(math.dist(cell, face) for face in faces) * 0.25
        assert walls.distance[cell] == pytest.approx(nearest, abs=1e-6)


def test_normals_point_to_free_space():
    values = np.full((9, 12), -1, dtype=np.int8)
    values[3, :] = 100
    values[4:, :] = 0  # the north is free
    walls = walls_of(OccupancyGrid(values, 0.4, (3.0, -1.0, 0.7)))
    inner = (walls.faces_xy[:, 0] > 1) & (walls.faces_xy[:, 0] < 3.8)
    np.testing.assert_allclose(walls.normals_xy[inner], [[0.0, 1.0]] * inner.sum(), atol=1e-6)
    np.testing.assert_allclose(np.hypot(*walls.normals_xy.T), 1.0, atol=1e-6)


def test_large_maps_are_put_on_coarser_cells_without_losing_an_obstacle():
    values = np.random.default_rng(5).choice(np.array([-1, 0, 0, 0, 100], np.int8), (23, 41))
    values[0, 0] = values[-1, -1] = 100
    walls = walls_of(OccupancyGrid(values, 0.1, (1.0, 2.0, 0.3)), most=11)
    assert walls.resolution == pytest.approx(0.4)
    assert walls.frame.shape == (6, 11)
    assert walls.frame.origin == (1.0, 2.0, 0.3)
    for row, col in np.ndindex(walls.frame.shape):
        block = values[4 * row : 4 * row + 4, 4 * col : 4 * col + 4]
        is_occupied = bool((block == 100).any())
        assert (walls.known & ~walls.free)[row, col] == is_occupied
        assert walls.free[row, col] == (not is_occupied and (block == 0).sum() >= 8)


@pytest.mark.parametrize("shape", [(7, 11), (1, 9), (9, 1), (4, 8)])
@pytest.mark.parametrize("factor", [1, 3, 4, 20])
def test_pooled_counts_the_marked_cells_of_each_block(shape, factor):
    marked = np.random.default_rng(5).random(shape) < 0.4
    rows, cols = (range(0, side, factor) for side in shape)
    counts = [[marked[r : r + factor, c : c + factor].sum() for c in cols] for r in rows]
    np.testing.assert_array_equal(pooled(marked, factor), counts)


@pytest.mark.parametrize("shape", [(1, 100_000), (100_000, 1)])
def test_pooling_a_line_of_cells_takes_memory_for_its_cells_alone(shape):
    marked = np.ones(shape, np.bool_)
    tracemalloc.start()
    try:
        pooled(marked, 1000)  # squares of cells would be 100 MB
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 3 * marked.size
