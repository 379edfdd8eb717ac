"""Outlines and solids of cells, held against shapely and trimesh."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy import ndimage

from mapdeal.kernels import outlines as kernel
from mapdeal.kernels.engine import VARIABLE
from mapdeal.kernels.outlines import corner_count, rectangles, run_count, surface
from strategies import masks

shapely = pytest.importorskip("shapely")


class Outline(NamedTuple):
    shell: np.ndarray
    holes: list
    cells: int
    area: float

    @property
    def rings(self):
        return [self.shell, *self.holes]


def outlines(mask, tolerance=0.0):
    found = kernel.outlines(mask, tolerance)
    rings = np.split(found.corners, found.ring_ends[:-1])
    bounds = pairwise([*found.shells, len(found.ring_ends)])
    parts = [(rings[start], rings[start + 1 : end]) for start, end in bounds]
    sizes = zip(found.cells, found.areas, strict=True)
    return [Outline(*part, *size) for part, size in zip(parts, sizes, strict=True)]


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
    counts = [outline.cells for outline in found]
    assert counts == sorted(counts, reverse=True)
    corners = sum(len(ring) for outline in found for ring in outline.rings)
    assert corners <= corner_count(mask) <= 4 * mask.sum()


@example(ndimage.gaussian_filter(np.random.default_rng(5).random((30, 40)), 1.5) > 0.5, 0.5)
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
        assert shapely.hausdorff_distance(together.boundary, exact, densify=0.1) <= tolerance + 1e-9


def test_slanted_lines_become_straight_and_rooms_keep_their_corners(each_engine):
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
    (outline,) = outlines(np.array([[1, 1, 1], [1, 0, 1], [1, 1, 0]], bool))
    assert [len(ring) for ring in outline.rings] == [6, 4]
    assert polygon(outline).is_valid
    assert outlines(np.zeros((3, 4), bool), 0.5) == []


def next_corner(mask, at, step):
    """Walk along a ring, the marked cells on its left, to where it turns; return the new step."""
    cells = np.pad(mask, 1)

    def is_marked(row, col, side):  # the cell ahead of a lattice point, left or right of a step
        up, right = step
        side_up, side_right = (right, -up) if side == "left" else (-right, up)
        return cells[row + (1 + up + side_up) // 2, col + (1 + right + side_right) // 2]

    while True:
        at = at[0] + step[0], at[1] + step[1]
        if not is_marked(*at, "left"):
            return at, (step[1], -step[0])
        if is_marked(*at, "right"):
            return at, (-step[1], step[0])


@given(masks(12))
def test_rings_are_those_of_a_walk_along_the_cells(mask):
    steps = set()  # unit steps of all walks, each begun at the lower side of a cell
    padded = np.pad(mask, 1)
    for row, col in np.argwhere(padded[1:-1, 1:-1] & ~padded[:-2, 1:-1]).tolist():
        if ((row, col), (row, col + 1)) in steps:
            continue
        at, step = (row, col), (0, 1)
        while True:
            corner, turned = next_corner(mask, at, step)
            length = abs(corner[0] - at[0]) + abs(corner[1] - at[1])
            points = [(at[0] + k * step[0], at[1] + k * step[1]) for k in range(length + 1)]
            if set(pairwise(points)) <= steps:
                break
            steps |= set(pairwise(points))
            at, step = corner, turned
    found = set()
    for ring in (ring for outline in outlines(mask) for ring in outline.rings):
        corners = [tuple(map(int, corner)) for corner in ring]
        assert len(set(corners)) == len(corners)  # no point twice
        for (row, col), (to_row, to_col) in pairwise([*corners, corners[0]]):
            length = abs(to_row - row) + abs(to_col - col)
            step = (to_row - row) // length, (to_col - col) // length
            points = [(row + k * step[0], col + k * step[1]) for k in range(length + 1)]
            assert found.isdisjoint(pairwise(points))
            found |= set(pairwise(points))
    assert found == steps


@given(masks(24), st.sampled_from([0.0, 0.2, 0.5]))
def test_both_engines_make_the_same_polygons(mask, tolerance):
    with pytest.MonkeyPatch.context() as patch:
        results = []
        for engine in ("compiled", "scipy"):
            patch.setenv(VARIABLE, engine)
            results.append(kernel.outlines(mask, tolerance))
    for name in ("corners", "ring_ends", "shells", "cells"):
        assert getattr(results[0], name).tobytes() == getattr(results[1], name).tobytes()


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
    assert np.transpose(rectangles(mask)).tolist() == [[2, 18, 4, 6], [12, 13, 10, 29]]
