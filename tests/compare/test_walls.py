"""What is made of a map before it is aligned, against drawings and brute force."""

import math

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal.compare.align import pooled, walls_of
from mapdeal.grid.occupancy import OccupancyGrid

ROOM = """
    ??????????
    ?#######??
    ?#.....#??
    ?#.....###
    ?###...+.#
    ??????????
"""


def test_rows_and_columns_that_know_nothing_are_cut_off_and_cells_keep_their_places():
    grid = grid_from_text(ROOM)
    walls = walls_of(grid)
    assert walls.frame.shape == (4, 9)
    np.testing.assert_allclose(
        walls.frame.xy_from_rowcol([[0, 0], [3, 8]]), grid.frame.xy_from_rowcol([[1, 1], [4, 9]])
    )
    assert walls.free.sum() == 14
    assert walls.known.sum() == 14 + 17  # a graded cell is neither


def test_faces_are_the_obstacles_beside_free_cells_with_their_distances():
    walls = walls_of(grid_from_text(ROOM))
    occupied = walls.known & ~walls.free
    faces = {
        (row, col)
        for row, col in np.argwhere(occupied).tolist()
        if walls.free[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2].any()
    }
    cells = walls.faces_xy / walls.resolution - 0.5
    assert {(row, col) for col, row in np.rint(cells).astype(int).tolist()} == faces
    assert walls.wall_length == len(faces) * 0.25
    for row, col in np.ndindex(walls.frame.shape):
        nearest = min(math.hypot(row - r, col - c) for r, c in faces) * 0.25
        assert walls.distance[row, col] == pytest.approx(nearest, abs=1e-6)


def test_normals_point_to_free_space():
    values = np.full((9, 12), -1, dtype=np.int8)
    values[3, :] = 100
    values[4:, :] = 0  # the north is free
    walls = walls_of(OccupancyGrid(values, 0.4, (3.0, -1.0, 0.7)))
    inner = (walls.faces_xy[:, 0] > 1) & (walls.faces_xy[:, 0] < 3.8)
    np.testing.assert_allclose(walls.normals_xy[inner], [[0.0, 1.0]] * inner.sum(), atol=1e-6)
    np.testing.assert_allclose(np.hypot(*walls.normals_xy.T), 1.0, atol=1e-6)


def test_maps_of_walls_alone_have_free_space_around_them():
    values = np.full((7, 8), -1, dtype=np.int8)
    values[1, 1:7] = values[1:6, 1] = 100
    walls = walls_of(OccupancyGrid(values, 0.5))
    assert walls.frame.shape == (5, 6)
    assert walls.free.sum() == 30 - 10
    assert walls.known.all()


def test_large_maps_are_put_on_coarser_cells_without_losing_an_obstacle():
    rng = np.random.default_rng(5)
    values = rng.choice(np.array([-1, 0, 0, 0, 100], np.int8), (23, 41))
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


def test_what_is_beyond_the_last_block_is_not_set():
    cells = np.ones((3, 5), dtype=bool)
    assert pooled(cells, 2).tolist() == [[4, 4, 2], [2, 2, 1]]


def test_a_map_without_obstacles_has_no_walls():
    assert walls_of(OccupancyGrid([[0, -1, 50]], 0.1)) is None


def test_faces_are_chosen_evenly():
    walls = walls_of(grid_from_text(ROOM))
    faces, normals = walls.some_faces(5)
    assert len(faces) == len(normals) == 5
    which = [k * len(walls.faces_xy) // 5 for k in range(5)]
    np.testing.assert_array_equal(faces, walls.faces_xy[which])
    assert len(walls.some_faces(1000)[0]) == len(walls.faces_xy)
