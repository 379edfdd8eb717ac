"""Solids of cells, held against trimesh."""

import numpy as np
import pytest
from hypothesis import given

from mapdeal.kernels.solids import rectangles, run_count, surface
from strategies import masks

trimesh = pytest.importorskip("trimesh")


@given(masks(12))
def test_the_surface_is_closed_and_has_no_face_inside(mask):
    product = surface(mask)
    if not mask.any():
        assert len(product.triangles) == 0
        return
    corners = np.column_stack([product.corners[:, ::-1], product.levels * 0.75])
    mesh = trimesh.Trimesh(corners, product.triangles, process=True)  # which joins equal corners
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(1.5 * mask.sum(), rel=1e-12)
    assert mesh.area_faces.min() > 0
    padded = np.pad(mask, 1)
    sides = (padded[1:] != padded[:-1]).sum() + (padded[:, 1:] != padded[:, :-1]).sum()
    assert mesh.area == pytest.approx(2 * mask.sum() + 1.5 * sides, rel=1e-12)


@given(masks(12))
def test_rectangles_cover_each_cell_once(mask):
    found = rectangles(mask)
    covered = np.zeros(mask.shape, int)
    for first_row, end_row, first_col, end_col in zip(*found, strict=True):
        covered[first_row:end_row, first_col:end_col] += 1
    assert np.array_equal(covered, mask)
    assert len(found.first_row) <= run_count(mask)


def test_walls_along_either_axis_are_one_rectangle_each():
    mask = np.zeros((20, 30), bool)
    mask[2:18, 4:6] = True
    mask[12, 10:29] = True
    assert [rectangle.tolist() for rectangle in rectangles(mask)] == [
        [2, 12],
        [18, 13],
        [4, 10],
        [6, 29],
    ]
