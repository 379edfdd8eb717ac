"""A simulated laser scanner, against clipping of its beams with all cells."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drawn import grid_from_text
from mapdeal import OccupancyGrid
from mapdeal.mapping.scanner import Scanner, Surroundings, noisy_odometry
from oracles import beam_lengths

ROOM = grid_from_text("""
    ############
    #....#.....#
    #..........#
    #......?...#
    #.##......+#
    ############
""")
POSES = ROOM.frame.xy_from_continuous_rowcol([[2.3, 3.6], [3.2, 8.9], [1.5, 1.2]])
POSES = np.column_stack([POSES, [0.3, -2.0, 9.0]])


def scanner(range_min=0.0, range_max=9.0, fov=2 * math.pi, beams=90, **more):
    return Scanner(range_min, range_max, fov, beams, **more)


@pytest.mark.parametrize("through_unknown", [False, True])
@pytest.mark.parametrize("range_max", [9.0, 0.6])
def test_beams_end_at_the_first_obstacle(through_unknown, range_max):
    values = np.where(ROOM.occupancy == 50, 0, ROOM.occupancy)
    values[(values < 0) & through_unknown] = 0
    angles = np.linspace(-3, 3, 70)
    lengths = Surroundings(ROOM, through_unknown).lengths(POSES, angles, range_max)
    starts = ROOM.frame.continuous_rowcol_from_xy(POSES[:, :2])
    headings = POSES[:, 2:] + angles - ROOM.origin[2]
    expected = beam_lengths(values, starts, headings, range_max / 0.25) * 0.25
    np.testing.assert_allclose(lengths, expected, rtol=0, atol=1e-6)
    assert np.isinf(lengths).any() == (range_max < 1 or not through_unknown)


def test_beams_that_begin_in_closed_cells_or_outside_have_no_return():
    places = ROOM.frame.xy_from_continuous_rowcol([[0.5, 0.5], [2.5, 7.5], [-9.0, 4.0]])
    around, poses = Surroundings(ROOM), np.column_stack([places, [0.0, 1.0, 2.0]])
    assert not around.is_open(poses).any()
    assert np.isinf(around.lengths(poses, np.linspace(-3, 3, 40), 9.0)).all()


def test_the_walls_in_sight_are_those_that_many_beams_hit():
    around = Surroundings(ROOM)
    angles = np.linspace(-math.pi, math.pi, 20_000, endpoint=False)
    for pose, (cells, _) in zip(POSES, around.sights(POSES[:, :2], 9.0), strict=True):
        many = around.lengths(pose[np.newaxis], angles, 9.0)
        expected = around.hit_cells(pose[np.newaxis], angles, many)
        assert set(cells) <= set(expected)
        assert len(cells) >= 0.8 * len(expected)  # cells of which a corner is in sight


def test_walls_are_faced_up_to_an_angle():
    corridor = OccupancyGrid(np.pad(np.zeros((20, 400), np.int8), 1, constant_values=100), 0.05)
    ((_, facing),) = Surroundings(corridor).sights(np.array([[10.05, 0.55]]), 30.0)
    cols = facing[facing < 402] % 402  # of the lower wall, half a metre away
    farthest = np.abs((cols + 0.5) * 0.05 - 10.05).max()
    assert farthest == pytest.approx(0.5 / math.tan(0.25), abs=0.2)


@pytest.mark.parametrize(("fov", "beams", "last"), [
    (2 * math.pi, 4, math.pi / 2), (math.pi, 3, math.pi / 2), (1.0, 101, 0.5),
])  # fmt: skip
def test_beams_are_even_over_the_field_of_view(fov, beams, last):
    angles = scanner(fov=fov, beams=beams).angles
    np.testing.assert_allclose([angles[0], angles[-1]], [-fov / 2, last], atol=1e-6)
    np.testing.assert_allclose(np.diff(angles), (last + fov / 2) / (beams - 1), atol=1e-6)


def test_noise_dropouts_and_limits():
    around, poses = Surroundings(ROOM, through_unknown=True), np.repeat(POSES, 300, axis=0)
    exact = scanner().scans(around, poses).ranges
    noisy, again = (scanner(noise=0.05, dropout=0.25).scans(around, poses).ranges for _ in range(2))
    assert noisy.tobytes() == again.tobytes()
    lost = np.isinf(noisy) & (noisy > 0)
    assert lost.mean() == pytest.approx(0.25, abs=0.01)
    errors = (noisy - exact)[np.isfinite(noisy) & (exact > 0.3)]
    assert (errors.mean(), errors.std()) == pytest.approx((0, 0.05), abs=0.002)
    limited = scanner(range_min=0.4, range_max=0.9).scans(around, poses).ranges
    expected = np.where(exact < 0.4, -np.inf, np.where(exact < 0.9, exact, np.inf))
    np.testing.assert_array_equal(limited, expected)


def matrices(poses):
    found = np.tile(np.eye(3), (len(poses), 1, 1))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(poses[:, 2])
    found[:, 1, 0], found[:, 0, 1] = np.sin(poses[:, 2]), -np.sin(poses[:, 2])
    found[:, :2, 2] = poses[:, :2]
    return found


@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1]))
def test_frames_odometry_and_mount_compose_to_the_true_poses(seed, noise):
    poses = np.cumsum(np.random.default_rng(seed).normal(0, 1, (30, 3)), axis=0)
    odometry, frames = noisy_odometry(poses, noise)
    np.testing.assert_allclose(matrices(frames) @ matrices(odometry), matrices(poses), atol=1e-9)
    assert (odometry[0] == 0).all()
    is_fixed = np.allclose(matrices(frames), matrices(poses[:1]), atol=1e-9)
    assert is_fixed == (noise == 0)
    mount = np.array([[0.3, -0.2, 1.0]])
    posed = matrices(scanner(mount=tuple(mount[0])).poses_of(poses))
    np.testing.assert_allclose(posed, matrices(poses) @ matrices(mount), atol=1e-12)


def test_the_error_of_odometry_grows_with_the_root_of_the_way():
    line = np.column_stack([np.linspace(0, 900, 90_001), np.zeros((90_001, 2))])
    odometry, _ = noisy_odometry(line, 0.1)
    assert np.diff(odometry[:, 2]).std() == pytest.approx(0.1 * math.sqrt(0.01), rel=0.02)
