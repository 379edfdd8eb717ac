"""Outlines of cells, held against shapely."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels.outlines import corner_count, outlines
from strategies import masks

shapely = pytest.importorskip("shapely")


def polygon(outline):
    return shapely.Polygon(outline.shell[:, ::-1], [hole[:, ::-1] for hole in outline.holes])


def union_of_cells(mask):
    return shapely.union_all([shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(mask)])


@given(masks(18))
def test_exact_outlines_are_the_union_of_the_cells(mask):
    found = outlines(mask)
    polygons = [polygon(outline) for outline in found]
    assert all(polygon.is_valid and shapely.is_ccw(polygon.exterior) for polygon in polygons)
    assert all(not shapely.is_ccw(ring) for polygon in polygons for ring in polygon.interiors)
    assert sum(polygon.area for polygon in polygons) == mask.sum()
    cells = union_of_cells(mask)
    assert shapely.equals(shapely.union_all(polygons), cells)
    own = list(cells.geoms) if hasattr(cells, "geoms") else [cells] * bool(mask.any())
    assert sorted(outline.cells for outline in found) == sorted(outline.area for outline in own)
    assert [outline.cells for outline in found] == sorted(
        (outline.cells for outline in found), reverse=True
    )
    corners = sum(len(ring) for outline in found for ring in outline.rings)
    assert corners <= corner_count(mask) <= 4 * mask.sum()


@given(masks(18), st.sampled_from([0.1, 0.36, 0.5]))
def test_simpler_outlines_stay_near_valid_and_as_large(mask, tolerance):
    found = outlines(mask, tolerance)
    polygons = [polygon(outline) for outline in found]
    together = shapely.MultiPolygon(polygons)
    assert together.is_valid, shapely.is_valid_reason(together)
    for shape, own in zip(polygons, found, strict=True):
        assert abs(shape.area - own.cells) <= 0.01 * own.cells
        assert own.area == pytest.approx(shape.area)
        assert shapely.is_ccw(shape.exterior)
    if polygons:
        exact = union_of_cells(mask).boundary
        distance = shapely.hausdorff_distance(together.boundary, exact, densify=0.1)
        assert distance <= tolerance + 1e-9


def test_slanted_lines_become_straight_and_rooms_keep_their_corners():
    rows, cols = np.indices((60, 90))
    (slanted,) = outlines(rows < cols + 10, 0.5)
    (exact,) = outlines(rows < cols + 10)
    assert len(slanted.shell) <= 8 < 100 < len(exact.shell)
    (gentle,) = outlines(rows < cols * 0.4 + 10, 0.5)
    assert len(gentle.shell) <= 40
    room = np.zeros((30, 40), bool)
    room[5:25, 3:35] = True
    room[10:20, 15:16] = False  # a wall
    (found,) = outlines(room, 0.5)
    assert sorted(map(tuple, found.shell.tolist())) == [(5, 3), (5, 35), (25, 3), (25, 35)]
    assert [len(hole) for hole in found.holes] == [4]


def test_a_ring_that_touches_itself_is_an_outline_and_a_hole():
    mask = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 0]], bool)
    (outline,) = outlines(mask)
    assert [len(ring) for ring in outline.rings] == [6, 4]
    assert polygon(outline).is_valid
    assert outlines(np.zeros((3, 4), bool), 0.5) == []
