"""Lines, polygons and discs of cells against loops over all cells."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from hypothesis.extra import numpy as arrays

import oracles
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels import polygons
from mapdeal.kernels.polygons import Lattice, costs_at_poses
from strategies import examples

HEIGHT, WIDTH = 7, 11
CELLS = st.tuples(st.integers(-9, 16), st.integers(-9, 20))
POSITIONS = st.tuples(st.floats(-5, 12), st.floats(-5, 16))
PARTS = st.sampled_from([3, 1 << 20])
RINGS = st.lists(CELLS, min_size=3, max_size=7)
RANGES = st.tuples(st.integers(-5, 45), st.integers(0, 60))


def painted(parts):
    """The cells of spans as a set of (x, y)."""
    values = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    for spans in [parts] if isinstance(parts, polygons.Spans) else parts:
        polygons.paint(values, spans, 1)
    return {(x, y) for y, x in np.argwhere(values).tolist()}


def inside(cells):
    return {(x, y) for x, y in cells if 0 <= x < WIDTH and 0 <= y < HEIGHT}


def swapped(cells):
    return [(b, a) for a, b in cells]


def test_a_recorded_line_and_its_way_back():
    ahead, back = [(0, 0), (1, 1), (2, 1), (3, 2), (4, 2)], [(4, 2), (3, 1), (2, 1), (1, 0), (0, 0)]
    for cells in (ahead, back):
        assert oracles.line(cells[0], cells[-1]) == cells
        ends = polygons.edges_through(swapped([cells[0], cells[-1]]))
        assert painted(polygons.line_spans(ends, (HEIGHT, WIDTH))) == set(cells)


def test_a_line_to_the_farthest_cell_stays_exact():
    # Slope 1/2 from (0, 0): after i steps n // 2 + i * minor is still exact at 2^61.
    far = polygons.FARTHEST_CELL
    (spans,) = polygons.line_spans(polygons.edges_through([(0, 0), (far, far // 2)]), (5, 9))
    assert [column.tolist() for column in spans] == [
        [0, 1, 2, 3, 4], [0, 1, 1, 2, 2], [1, 2, 2, 3, 3],
    ]  # fmt: skip
    (spans,) = polygons.line_spans(polygons.edges_through([(-far, -far), (far, far)]), (3, 9))
    assert [column.tolist() for column in spans] == [[0, 1, 2], [0, 1, 2], [1, 2, 3]]


@given(st.lists(CELLS, min_size=2, max_size=6), PARTS)
def test_lines_visit_the_cells_of_costmap_2d_clipped(cells, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", together)
        parts = list(polygons.line_spans(polygons.edges_through(cells), (HEIGHT, WIDTH)))
    expected = {c for a, b in itertools.pairwise(swapped(cells)) for c in oracles.line(a, b)}
    assert painted(parts) == inside(expected)


@given(RINGS, st.lists(RINGS, max_size=3), PARTS)
@example([(0, 0), (0, 0), (0, 0)], [], 3)
@example([(2, 3), (5, 9), (2, 3)], [], 3)
def test_a_ring_is_outline_and_inside_and_holes_leave_out_their_inside(ring, holes, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", together)
        found = painted(polygons.polygon_spans([ring, *holes], (HEIGHT, WIDTH)))
    solid = oracles.ring_fill([swapped(ring)], WIDTH, HEIGHT)
    rims = {c for hole in holes for c in oracles.outline(swapped(hole))}
    hollow = {c for hole in holes for c in oracles.ring_fill([swapped(hole)], WIDTH, HEIGHT)}
    assert found == solid - (hollow - rims)


@st.composite
def convex_polygons(draw):
    """Points in convex position and in order, in cells: some of a turned ellipse."""
    angles = draw(st.lists(st.floats(0, 6.28), min_size=3, max_size=9, unique=True))
    (row, col), turn = draw(POSITIONS), draw(st.floats(0, 3))
    long, short = draw(st.floats(0.1, 12)), draw(st.floats(0.01, 12))
    cos, sin = math.cos(turn), math.sin(turn)
    sides = [(long * math.cos(angle), short * math.sin(angle)) for angle in sorted(angles)]
    return [(row + u * cos - v * sin, col + u * sin + v * cos) for u, v in sides]


@pytest.mark.slow
@given(convex_polygons())
@examples(120)
def test_convex_polygons_are_filled_as_costmap_2d_fills_columns(points):
    ring = [(math.floor(row), math.floor(col)) for row, col in points]
    expected = inside(oracles.convex_fill(swapped(ring)))
    assert painted(polygons.polygon_spans([ring], (HEIGHT, WIDTH))) == expected


@given(POSITIONS, POSITIONS, st.floats(0, 9))
@example((3.5, 5.5), (3.5, 5.5), 0.0)
@example((3.5, 5.5), (3.5, 5.5), 2.0)
@example((2.5, 2.5), (2.5, 8.5), 1.0)
@example((2.5, 2.5), (6.5, 2.5), 1.0)
@example((2.0, 3.0), (2.0000000000000004, 9.0), 1.5)
@example((1.5, 1.5), (4.5, 5.5), 2.5)
def test_a_capsule_holds_the_centres_within_its_radius(start, stop, radius):
    found = painted(polygons.capsule_spans(start, stop, radius, (HEIGHT, WIDTH)))
    for x in range(WIDTH):
        for y in range(HEIGHT):
            distance = oracles.distance_to_segment((y + 0.5, x + 0.5), start, stop)
            if abs(distance - radius) > 1e-7:
                assert ((x, y) in found) == (distance < radius)
            elif abs(distance - radius) < 1e-12:
                assert (x, y) in found


@given(st.lists(RANGES, min_size=1, max_size=30), st.integers(1, 50))
def test_bands_hold_all_rows_and_not_too_many_at_once(ranges, most):
    height = 40
    starts = np.array([first for first, _ in ranges])
    stops = starts + [count for _, count in ranges]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", most)
        found = list(polygons.bands(starts, stops, height))
    rows = [row for first, stop in found for row in range(first, stop)]
    used = {r for a, b in zip(starts, stops, strict=True) for r in range(max(a, 0), min(b, height))}
    assert len(rows) == len(set(rows))
    assert used <= set(rows) <= set(range(height))
    for first, stop in found:
        per_row = [int(((starts <= r) & (r < stops)).sum()) for r in range(first, stop)]
        assert sum(per_row) <= most + max(per_row)


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


def cost_of_cells(costs, cells, *, filled):
    """What the kernel says of a robot whose corners lie in these cells (x, y)."""
    corners = np.array(cells) + 0.5
    lattice, here = Lattice(1.0, 0.0, 0.0, 0.0), np.zeros((1, 3))
    (cost,), (inside,) = costs_at_poses(costs, lattice, corners, here, filled=filled)
    assert inside
    return cost


FOUND_BY = ((False, oracles.footprint_cost), (True, oracles.full_footprint_cost))


@given(COSTS, CORNERS, st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.4, -2.9]))
def test_costs_are_those_that_are_found_cell_by_cell(each_engine, costs, corners, seed, yaw):
    lattice = Lattice(0.5, -1.0, 2.0, yaw)
    shares = np.random.default_rng(seed).uniform((-0.1, -0.1, -7), (1.1, 1.1, 7), (12, 3))
    poses = np.array([pose_of(lattice, *(share[:2] * costs.shape), share[2]) for share in shares])
    corners = np.array(corners) / 4
    for filled, cost_of in FOUND_BY:
        found, inside = costs_at_poses(costs, lattice, corners, poses, filled=filled)
        for pose, cost, is_inside in zip(poses.tolist(), found, inside, strict=True):
            cells = oracles.corner_cells(lattice, costs.shape, corners.tolist(), pose)
            assert is_inside == (cells is not None)
            assert cost == (cost_of(costs.tolist(), cells) if is_inside else 254)


@given(COSTS, st.data())
def test_costs_of_any_cells_are_those_that_are_found_cell_by_cell(each_engine, costs, data):
    cell = st.tuples(st.integers(0, costs.shape[1] - 1), st.integers(0, costs.shape[0] - 1))
    cells = data.draw(st.lists(cell, min_size=1, max_size=7))
    for filled, cost_of in FOUND_BY:
        assert cost_of_cells(costs, cells, filled=filled) == cost_of(costs.tolist(), cells)


def test_a_corner_outside_is_a_collision_wherever_it_is(each_engine):
    costs = np.zeros((8, 8), np.uint8)
    corners = np.array([[0.4, 0.4], [0.4, -0.4], [-0.4, -0.4], [-0.4, 0.4]])
    places = [(4, 4), (0.7, 4), (7.3, 4), (4, 0.7), (4, 7.3), (1e9, 4), (4, -1e300)]
    poses = [pose_of(LATTICE, row, col, 0.4) for row, col in places]
    poses += [(*poses[0][:k], n, *poses[0][k + 1 :]) for k in range(3) for n in (np.nan, np.inf)]
    for filled in (False, True):
        found, inside = costs_at_poses(costs, LATTICE, corners, np.array(poses), filled=filled)
        assert inside.tolist() == [True] + [False] * 12
        assert found.tolist() == [0] + [254] * 12


def test_upper_edges_belong_to_no_cell(each_engine):
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [-5e-324, 0.0, 0.0]])
    costs = np.array([[3, 8]], np.uint8)
    for resolution, expected in ((0.5, [True, False, False, False]), (1e6, [True] * 3 + [False])):
        lattice = Lattice(resolution, 0.0, 0.0, 0.0)
        found, inside = costs_at_poses(costs, lattice, np.zeros((3, 2)), poses, filled=False)
        assert inside.tolist() == expected
        assert found.tolist() == np.where(expected, 3, 254).tolist()


@needs_compiled
@examples(12)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([7, 50, 1 << 18]))
def test_engines_threads_and_parts_do_not_matter(seed, filled, together):
    rng = np.random.default_rng(seed)
    costs = rng.choice(np.array([0, 50, 254, 255], np.uint8), (40, 60), p=[0.9, 0.06, 0.02, 0.02])
    shares = rng.uniform((0, 0, -1e3), (40, 60, 1e3), (100, 3))
    poses = np.array([pose_of(LATTICE, *share) for share in shares])

    def found():
        costs_and_inside = costs_at_poses(costs, LATTICE, L_SHAPE, poses, filled=filled)
        return [part.tobytes() for part in costs_and_inside]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(polygons, "_CELLS_TOGETHER", together)
        first, *repeated = by_each_engine(found, threads=(1, 3))
    assert repeated == [first, first]
