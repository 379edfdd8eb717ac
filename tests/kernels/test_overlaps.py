"""Values on other lattices by hand; `tests/grid/test_resample.py` has the polygons."""

import math

import numpy as np
import pytest

from mapdeal.kernels.lookup import Lattice, largest_under, nearest_under

VALUES = np.array([[1, 0, 9], [4, 0, 0]], np.uint8)


def test_cells_along_the_axes_by_hand():
    half_a_cell_on = Lattice(0.5, 0.5, 1.0)
    assert largest_under(VALUES, (3, 3), half_a_cell_on).tolist() == [[4, 9, 9], [4, 0, 0], [0] * 3]
    fine = Lattice(-0.25, 1.75, 0.5)
    assert largest_under(VALUES, (2, 4), fine).tolist() == [[9, 9, 9, 0], [9, 9, 9, 0]]
    coarse = Lattice(-2.0, -2.0, 4.0)
    assert largest_under(VALUES, (1, 2), coarse).tolist() == [[4, 9]]


def test_a_cell_on_its_corner_by_hand():
    """A square of side 1 on its corner reaches sqrt(1/2) = 0.707 to each side."""
    values = np.zeros((5, 5), np.uint8)
    values[2, 1], values[4, 2], values[1, 1] = 5, 7, 9
    turn = math.pi / 4
    # to the left it reaches column 1.793, and there the cells that end at 2 up to 0.207 around it
    for centre, expected in ((2.1, 9), (2.5, 5), (3.2, 5), (3.25, 0), (3.3, 7)):
        lattice = Lattice(centre - math.sqrt(0.5), 2.5, 1.0, turn)
        assert largest_under(values, (1, 1), lattice).tolist() == [[expected]]


@pytest.mark.parametrize("side", [0.4, 1.0, 2.0, 2.1, 9.0])
def test_one_value_is_spread_over_all_of_its_area_and_not_far(side):
    values = np.zeros((40, 30), np.uint8)
    values[23, 11] = 200
    shape = (math.ceil(60 / side), math.ceil(60 / side))
    lattice = Lattice(-15.0, 5.0, side, 0.5)
    found = largest_under(values, shape, lattice)
    cells = np.argwhere(found == 200) + 0.5
    assert len(cells)
    cos, sin = math.cos(0.5), math.sin(0.5)
    rows = -15.0 + side * (cells[:, 0] * cos + cells[:, 1] * sin)
    cols = 5.0 + side * (cells[:, 1] * cos - cells[:, 0] * sin)
    distances = np.hypot(rows - 23.5, cols - 11.5)
    assert distances.max() < (1 + side) * math.sqrt(0.5)
    # whatever lies within the incircles of both overlaps for sure
    assert len(cells) >= np.floor(1 / side**2)
    assert distances.min() < side * math.sqrt(0.5) + 1e-9
    assert set(np.unique(found)) == {0, 200}


def test_views_and_empty_arrays():
    turned = np.rot90(np.repeat(VALUES, 2, axis=0)[::2])
    assert largest_under(turned, turned.shape, Lattice(0, 0, 1.0)).tolist() == turned.tolist()
    one = largest_under(turned, (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    other = largest_under(np.ascontiguousarray(turned), (4, 4), Lattice(-0.5, -0.5, 1.0, 0.3))
    assert one.tolist() == other.tolist()
    for values, shape in ((np.zeros((0, 3), np.uint8), (2, 2)), (VALUES, (0, 4))):
        assert not largest_under(values, shape, Lattice(0, 0, 1.0, 0.3)).any()
        assert not nearest_under(values, shape, Lattice(0, 0, 1.0, 0.3))[1].any()


@pytest.mark.parametrize("turn", [0.0, 1e-12])
def test_a_centre_on_a_border_belongs_to_the_cell_after_it(turn):
    found, inside = nearest_under(VALUES, (1, 4), Lattice(-0.5, -0.5, 1.0, turn, 1e-9))
    assert found.tolist() == [[1, 0, 9, 0]]
    assert inside.tolist() == [[True, True, True, False]]
