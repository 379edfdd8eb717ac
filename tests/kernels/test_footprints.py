"""Costs of footprints at poses, by both engines."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import oracles
from engines import needs_compiled
from mapdeal.kernels import engine
from mapdeal.kernels import polygons as footprints
from mapdeal.kernels.polygons import Lattice, costs_at_poses
from mapdeal.kernels.threads import use_threads

COSTS = arrays.arrays(
    np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 11)),
    elements=st.sampled_from([0, 0, 0, 7, 99, 253, 254, 255]),
)  # fmt: skip
POINTS = st.tuples(st.floats(-4, 4), st.floats(-4, 4))
CORNERS = st.lists(POINTS, min_size=3, max_size=7)
LATTICE = Lattice(0.5, -1.0, 2.0, 0.4)
L_SHAPE = np.array([[1.0, 0.6], [1.0, -0.6], [-0.8, -0.6], [-0.8, 0.0], [0.2, 0.0], [0.2, 0.6]])


def pose_of(lattice, row, col, yaw=0.0):
    """The pose at a place in the grid."""
    east, north = col * lattice.resolution, row * lattice.resolution
    cos, sin = math.cos(lattice.yaw), math.sin(lattice.yaw)
    return (lattice.x + east * cos - north * sin, lattice.y + east * sin + north * cos, yaw)


def cells_at_the_origin(cells):
    """Corners that lie in the middle of cells (x, y) if the robot stands at (0, 0)."""
    return np.array([(x + 0.5, y + 0.5) for x, y in cells])


def cost_of_cells(costs, cells, *, filled=False):
    """What the kernel says of a robot whose corners lie in these cells (x, y)."""
    corners, here = cells_at_the_origin(cells), np.zeros((1, 3))
    (cost,), (inside,) = costs_at_poses(
        np.array(costs, np.uint8), Lattice(1.0, 0.0, 0.0, 0.0), corners, here, filled=filled
    )
    assert inside
    return cost


@given(COSTS, CORNERS, st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.4, -2.9]))
def test_costs_are_those_that_are_found_cell_by_cell(each_engine, costs, corners, seed, yaw):
    lattice = Lattice(0.5, -1.0, 2.0, yaw)
    shares = np.random.default_rng(seed).uniform((-0.1, -0.1, -7), (1.1, 1.1, 7), (12, 3))
    poses = np.array([pose_of(lattice, *(share[:2] * costs.shape), share[2]) for share in shares])
    corners = np.array(corners) / 4
    for filled, cost_of in ((False, oracles.footprint_cost), (True, oracles.full_footprint_cost)):
        found, inside = costs_at_poses(costs, lattice, corners, poses, filled=filled)
        for pose, cost, held in zip(poses.tolist(), found, inside, strict=True):
            cells = oracles.corner_cells(lattice, costs.shape, corners.tolist(), pose)
            assert held == (cells is not None)
            assert cost == (cost_of(costs.tolist(), cells) if held else 254)


@given(COSTS, st.data())
def test_costs_of_any_cells_are_those_that_are_found_cell_by_cell(each_engine, costs, data):
    cell = st.tuples(st.integers(0, costs.shape[1] - 1), st.integers(0, costs.shape[0] - 1))
    cells = data.draw(st.lists(cell, min_size=1, max_size=7))
    listed = costs.tolist()
    assert cost_of_cells(costs, cells) == oracles.footprint_cost(listed, cells)
    expected = oracles.full_footprint_cost(listed, cells)
    assert cost_of_cells(costs, cells, filled=True) == expected


def test_a_corner_outside_is_a_collision_wherever_it_is(each_engine):
    costs = np.zeros((8, 8), np.uint8)
    corners = np.array([[0.4, 0.4], [0.4, -0.4], [-0.4, -0.4], [-0.4, 0.4]])
    places = [(0.7, 4), (7.3, 4), (4, 0.7), (4, 7.3), (4, 4), (1e9, 4), (4, -1e300)]
    poses = np.array([pose_of(LATTICE, row, col, 0.4) for row, col in places])
    for filled in (False, True):
        found, inside = costs_at_poses(costs, LATTICE, corners, poses, filled=filled)
        assert inside.tolist() == [False] * 4 + [True, False, False]
        assert found.tolist() == [254] * 4 + [0, 254, 254]


def test_upper_edges_belong_to_no_cell(each_engine):
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [-5e-324, 0.0, 0.0]])
    lattice, costs = Lattice(0.5, 0.0, 0.0, 0.0), np.array([[3, 8]], np.uint8)
    found, inside = costs_at_poses(costs, lattice, np.zeros((3, 2)), poses, filled=False)
    assert found.tolist() == [3, 254, 254, 254]
    assert inside.tolist() == [True, False, False, False]
    lattice = Lattice(1e6, 0.0, 0.0, 0.0)
    assert not costs_at_poses(costs, lattice, np.zeros((3, 2)), poses[3:], filled=False)[1].any()


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_outside(each_engine, number):
    poses = np.array([pose_of(LATTICE, 4, 4)] * 4)
    poses[[0, 1, 2], [0, 1, 2]] = number
    costs, inside = costs_at_poses(np.zeros((9, 9), np.uint8), LATTICE, L_SHAPE, poses, filled=True)
    assert costs.tolist() == [254, 254, 254, 0]
    assert inside.tolist() == [False, False, False, True]


@needs_compiled
@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([7, 1 << 18]))
def test_both_engines_give_the_same_bytes(seed, filled, together):
    rng = np.random.default_rng(seed)
    costs = rng.choice(np.array([0, 50, 254, 255], np.uint8), (40, 60), p=[0.9, 0.06, 0.02, 0.02])
    shares = rng.uniform((0, 0, -1e3), (40, 60, 1e3), (200, 3))
    poses = np.array([pose_of(LATTICE, *share) for share in shares])
    results = []
    for name in ("compiled", "scipy"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(engine.VARIABLE, name)
            patch.setattr(footprints, "_CELLS_TOGETHER", together)
            found = costs_at_poses(costs, LATTICE, L_SHAPE, poses, filled=filled)
            results.append([part.tobytes() for part in found])
    assert results[0] == results[1]


def test_threads_and_parts_do_not_matter(each_engine, monkeypatch):
    rng = np.random.default_rng(1)
    costs = rng.integers(0, 256, (30, 30)).astype(np.uint8)
    poses = np.array([pose_of(LATTICE, *share) for share in rng.uniform(0, 30, (500, 3))])
    whole = costs_at_poses(costs, LATTICE, L_SHAPE, poses, filled=True)
    monkeypatch.setattr(footprints, "_CELLS_TOGETHER", 50)
    with use_threads(3):
        parts = costs_at_poses(costs, LATTICE, L_SHAPE, poses, filled=True)
    assert [part.tobytes() for part in parts] == [part.tobytes() for part in whole]
