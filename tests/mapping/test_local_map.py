import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from kernels.conftest import by_each_engine
from mapdeal import LocalMapper, LocalOptions, OccupancyGrid, local_map as make
from mapdeal.mapping.transforms import CoveredAngles


def cells(grid):
    """The obstacle cells as (column, row)."""
    return sorted((int(col), int(row)) for row, col in np.argwhere(grid.occupied()))


NOTHING = np.empty((0, 2))
ANGLES = st.lists(st.floats(-20, 20), min_size=1, max_size=9)


@pytest.mark.parametrize(("yaw_of_known", "pose", "size", "resolution", "origin", "shape"), [
    (None, (1e6, -5e6, 0), (20, 20), 0.05, (999990, -5000010, 0), (400, 400)),
    (None, (0.3, 0.3, 0), (0.01, 0.01), 0.1, (0.2, 0.2, 0), (1, 1)),
    (0.0, (0.5, 0.5, 0), (0.6, 0.4), 0.1, (0.13, 0.24, 0.0), (4, 6)),
    (0.0, (0.5, 0.5, 0), (0.6, 0.4), 0.05, (0.18, 0.29, 0.0), (8, 12)),
    (0.3, (0.5, 0.5, 0), (0.6, 0.4), 0.1, (0.2, 0.3, 0.0), (4, 6)),  # no lattice to share
])  # fmt: skip
def test_the_window_lies_on_the_lattice_of_the_resolution_or_the_global_map(
    yaw_of_known, pose, size, resolution, origin, shape
):
    options = {}
    if yaw_of_known is not None:
        values = np.zeros((4, 5), np.int8)
        options["global_map"] = OccupancyGrid(values, 0.1, (0.03, -0.06, yaw_of_known))
    grid = make(NOTHING, pose, size=size, resolution=resolution, **options)
    assert (grid.origin, grid.shape) == (origin, shape)
    assert not grid.occupied().any()


def test_a_turned_global_map_of_another_resolution_loses_no_obstacle():
    rng = np.random.default_rng(3)
    known = OccupancyGrid((rng.random((30, 40)) < 0.1).astype(np.int8) * 100, 0.13, (-2, 1, 0.6))
    pose = tuple(known.frame.xy_from_rowcol([[15, 20]])[0])
    grid = make(NOTHING, (*pose, 0.0), size=(8, 8), resolution=0.05, global_map=known)
    places = np.argwhere(known.occupied())[:, np.newaxis] + rng.random((1, 50, 2))
    points = known.frame.xy_from_continuous_rowcol(places.reshape(-1, 2))
    hit, inside = grid.frame.bounded_rowcol_from_xy(points)
    assert inside.all()
    assert grid.occupied()[tuple(hit.T)].all()
    # and every occupied cell lies within a cell of an obstacle
    row_col = known.frame.continuous_rowcol_from_xy(
        grid.frame.xy_from_rowcol(np.argwhere(grid.occupied()))
    )
    centres = np.argwhere(known.occupied()) + 0.5
    off = np.abs(row_col[:, np.newaxis] - centres).max(axis=2).min(axis=1)
    assert off.max() < 0.5 + 0.05 / 0.13


@pytest.mark.parametrize("yaw", [2 * math.pi, -2 * math.pi, 1e-17])
def test_a_whole_turn_is_no_turn(yaw):
    known = OccupancyGrid((np.indices((40, 40))[0] % 9 == 0) * 100, 0.1, (-2.03, -2.03, 0.0))
    turned = OccupancyGrid(known.occupancy, 0.1, (-2.03, -2.03, yaw))
    grids = [make(NOTHING, (0, 0, 0), size=(2, 2), resolution=0.1, global_map=global_map)
             for global_map in (known, turned)]  # fmt: skip
    assert grids[0].origin == grids[1].origin
    assert np.array_equal(grids[0].occupancy, grids[1].occupancy)


def test_what_neither_the_map_nor_the_cloud_has_seen_is_unknown():
    """A robot in the map's north-west corner, a point beyond it; beams pass unknown cells."""
    known = OccupancyGrid([[0, 0, -1, 0], [-1, 0, 60, 100]], 0.5, (-1.0, -0.5, 0.0))
    pose, options = (-0.25, 0.25, 0.0), {"size": (3.0, 2.0), "resolution": 0.5}
    grid = make([[1.7, 0.0]], pose, global_map=known, **options)
    assert grid.origin == (-2.0, -1.0, 0.0)
    assert grid.occupancy.tolist() == [
        [-1, -1, -1, -1, -1, -1],
        [-1, -1, 0, 0, -1, 0],
        [-1, -1, -1, 0, 0, 100],
        [-1, -1, -1, -1, -1, -1],
    ]
    occupancy = make([[-1.2, 0.0], [0.0, 0.6]], pose, global_map=known, **options).occupancy
    assert occupancy[2].tolist() == [-1, 100, 0, 0, 0, 100]
    assert occupancy[3].tolist() == [-1, -1, -1, 100, -1, -1]
    free = make([[1.7, 0.0]], pose, global_map=known, unknown="free", **options).occupancy
    assert np.array_equal(free, np.where(grid.occupancy == -1, 0, grid.occupancy))


def test_without_a_map_cells_without_points_are_free():
    for unknown in ("keep", "free"):
        grid = make([[0.3, 0.1]], (0, 0, 0), size=(2, 1), resolution=0.5, unknown=unknown)
        assert grid.occupancy.tolist() == [[0, 0, 0, 0], [0, 0, 100, 0]]


def test_a_cell_of_another_lattice_is_free_if_all_of_it_is():
    known = OccupancyGrid([[0, 0, -1, 0, 0]], 0.5, (0.0, 0.0, 0.0))
    grid = make(NOTHING, (1.0, 0.2, 0), size=(2.8, 0.4), resolution=0.4, global_map=known)
    assert grid.origin[0] == pytest.approx(-0.4)
    # -0.4..0, 0..0.4, 0.4..0.8, 0.8..1.2, 1.2..1.6, 1.6..2.0, 2.0..2.4
    assert grid.occupancy[0].tolist() == [-1, 0, 0, -1, -1, 0, 0]


LIMITS = {"min_height": -0.5, "max_height": 1.0, "min_range": 0.5, "max_range": 3.0}
CLOUD = {
    "marking": [(1.0, 0.0, 0.0), (1.0, 0.1, -0.5), (1.0, 0.2, 1.0), (0.0, -0.5, 0.0)],
    "outside": [(3.0, 0.0, 0.0)],
    "beyond_range": [(0.0, 0.49, 0.0), (3.01, 0.0, 0.0), (1e300, 1e300, 0.0)],
    "beyond_height": [(1.0, 0.0, 1.001), (1.0, 0.0, -0.51), (9.0, 0.0, 9.0)],
    "not_finite": [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (1.0, 1.0, math.nan)],
}


@pytest.mark.parametrize(("frame", "pose"), [("robot", (0, 0, 0)), ("map", (7.0, -3.0, 2.0))])
def test_each_point_is_counted_once(frame, pose):
    points = np.add(np.concatenate([*CLOUD.values()]), [*pose[:2], 0])
    mapper = LocalMapper(pose, LocalOptions(frame, size=(4, 4), **LIMITS))
    mapper.add(points[:5])
    mapper.add(points[5:])
    counts = mapper.result().counts
    assert counts.points == len(points)
    for name, counted in CLOUD.items():
        assert getattr(counts, name) == len(counted), name


COORDINATES = st.floats(-3, 3) | st.integers(-60, 60).map(lambda k: k * 0.05)
FRAMES = st.sampled_from(["robot", "map"])


@given(
    points=st.lists(st.tuples(*[COORDINATES | st.just(math.nan)] * 2), max_size=12),
    pose=st.tuples(COORDINATES, COORDINATES), quarter=st.integers(-2, 2), frame=FRAMES,
    offset=st.sampled_from([(0.0, 0.0), (0.5, -0.25)]),
    resolution=st.sampled_from(["0.05", "0.1", "0.25"]),
    size=st.tuples(st.integers(1, 50), st.integers(1, 50)),
)  # fmt: skip
def test_cells_are_those_of_exact_arithmetic(
    points, pose, quarter, frame, offset, resolution, size
):
    """Quarter turns are exact in fractions; points within a rounding of a border are left out."""
    step, tolerance = Fraction(resolution), Fraction(1, 10**9)
    width, height = (Fraction(k, 20) for k in size)
    corner = [
        math.floor((Fraction(p) - length / 2) / step + tolerance)
        for p, length in zip(pose, (width, height), strict=True)
    ]
    columns, rows = (math.ceil(length / step - tolerance) for length in (width, height))
    expected, in_window = set(), []
    cos, sin = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter % 4]
    for x, y in points:
        if math.isnan(x) or math.isnan(y):
            in_window.append((x, y))
            continue
        a, b = Fraction(x), Fraction(y)
        if frame == "robot":
            a, b = cos * a - sin * b + Fraction(pose[0]), sin * a + cos * b + Fraction(pose[1])
        a, b = a - Fraction(offset[0]), b - Fraction(offset[1])
        places = [c / step - first + tolerance for c, first in zip((a, b), corner, strict=True)]
        if min(abs(p - round(p)) for p in places) < tolerance / 100:
            continue
        in_window.append((x, y))
        col, row = map(math.floor, places)
        if 0 <= col < columns and 0 <= row < rows:
            expected.add((col, row))
    local = by_each_engine(lambda: make(
        np.array(in_window).reshape(-1, 2), (*pose, quarter * math.pi / 2), frame=frame,
        offset=offset, size=tuple(k / 20 for k in size), resolution=float(step),
    ))  # fmt: skip
    for grid in local:
        assert grid.shape == (rows, columns)
        assert grid.origin[:2] == tuple(float(k * step) for k in corner)
        assert set(cells(grid)) == expected


@given(angles=ANGLES)
def test_the_arc_leaves_out_the_largest_gap(angles):
    covered = CoveredAngles()
    for angle in angles:
        covered.add(np.array([angle]))
    first, last = covered.arc()
    assert -math.pi < first <= math.pi
    assert first <= last < first + 2 * math.pi
    turn = 2 * math.pi
    ordered = sorted(math.remainder(angle, turn) for angle in angles)
    gaps = [b - a for a, b in zip(ordered, [*ordered[1:], ordered[0] + turn], strict=True)]
    assert turn - (last - first) == pytest.approx(max(gaps), abs=1e-12)
    for angle in angles:
        assert (angle - first + 1e-12) % turn <= last - first + 2e-12


@pytest.mark.parametrize(("parts", "arc"), [
    ([[0.00030, 0.00031, 0.00025, 0.00028], [0.00029]], (0.00025, 0.00031)),  # of one bin
    ([[np.nextafter(-math.pi, 0)]], (math.pi, math.pi)),  # that rounding moves across pi
])  # fmt: skip
def test_an_arc_is_kept_to_the_last_digit(parts, arc):
    covered = CoveredAngles()
    for angles in parts:
        covered.add(np.array(angles))
    assert covered.arc() == pytest.approx(arc, abs=1e-12)


def test_angles_across_pi_and_below_zero():
    def angles_of(points, **options):
        mapper = LocalMapper((1.0, 2.0, -2.0), LocalOptions(**options))
        mapper.add(np.array(points, dtype=float))
        return mapper.result().angles

    def at(angle, r=2.0):
        return [r * math.cos(angle), r * math.sin(angle)]

    assert angles_of([at(3.0), at(-3.1), at(3.1)]) == pytest.approx((3.0, 2 * math.pi - 3.1))
    assert angles_of([at(-2.0), at(-0.5)]) == pytest.approx((-2.0, -0.5))
    assert angles_of([at(0.7)]) == pytest.approx((0.7, 0.7))
    assert angles_of([[0.0, 0.0]]) is None
    assert angles_of(np.empty((0, 3))) is None
    # of points in the map, the angles are the robot's, too: ahead is -2 there
    ahead = [1.0 + math.cos(-1.8), 2.0 + math.sin(-1.8)]
    assert angles_of([ahead], frame="map") == pytest.approx((0.2, 0.2))
    # excluded points have no effect
    assert angles_of([at(0.1), at(1.0, 9)], max_range=5.0) == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize("yaw", [0.0, math.pi, -math.pi, 1.0, -1.0, 5.0])
def test_the_rear_heading(yaw):
    expected = math.remainder(yaw + math.pi, 2 * math.pi)
    assert LocalMapper((0, 0, yaw), LocalOptions()).result().rear_heading == pytest.approx(expected)


@given(st.floats(-3.2, 3.2), st.floats(-3.2, 3.2), FRAMES, st.booleans())
def test_points_beyond_the_angles_are_left_out(first, last, frame, has_map):
    assume(first != last)
    points, pose = np.random.default_rng(7).uniform(-3, 3, (60, 2)), (0.3, -0.2, 0.7)
    options = {"size": (8, 8), "resolution": 0.5, "frame": frame}
    if has_map:
        options["global_map"] = OccupancyGrid(np.full((20, 20), -1, np.int8), 0.5, (-5, -5, 0))
    x, y, turn = (0.0, 0.0, 0.0) if frame == "robot" else pose
    headings = np.arctan2(points[:, 1] - y, points[:, 0] - x) - turn
    end = last - first if last > first else last - first + 2 * math.pi
    used = points[(headings - first) % (2 * math.pi) <= end]
    found = make(points, pose, angle_min=first, angle_max=last, **options)
    assert (found.occupancy == make(used, pose, **options).occupancy).all()
