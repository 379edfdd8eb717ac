"""Rolling maps, and a simulated scanner against clipping of its beams."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drawn import grid_from_text
from mapdeal import LocalOptions, OccupancyGrid, ParameterError, RollingMapper
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.scanner import Scanner, Surroundings, noisy_odometry
from mapping.conftest import cell_of
from oracles import beam_lengths, line


def replayed(clouds, poses, size, *, offset=(0, 0), least=0.0, most=math.inf, reach=math.inf):
    """What some clouds, each anew on a map of nothing, leave in the last one's window."""

    def cell_at(place):
        return cell_of(place.real, place.imag, resolution=0.3)

    state = {}
    for points, (x, y, yaw) in zip(clouds, poses, strict=True):
        sensor, marks = complex(x - offset[0], y - offset[1]), set()
        for px, py in points:
            r = math.hypot(px, py)
            if r < least:
                continue
            beam = complex(px, py) * complex(math.cos(yaw), math.sin(yaw))
            share = min(1.0, reach / r) if r else 1.0
            for cell in line(cell_at(sensor), cell_at(sensor + share * beam))[:-1]:
                state[cell] = 0
            if r <= most:
                marks.add(cell_at(sensor + beam))
        state |= dict.fromkeys(marks, 100)
    row, col = cell_of(*np.array(poses[-1][:2]) - np.array(size) / 2, resolution=0.3)
    width, height = (math.ceil(length / 0.3 - 1e-9) for length in size)
    rows, cols = range(row, row + height), range(col, col + width)
    return np.array([[state.get((r, c), -1) for c in cols] for r in rows])


@st.composite
def sequences(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(1, 6))
    poses = rng.uniform((-2, -1, -3), (3, 1, 3), (count, 3))
    return [rng.uniform(-3, 3, (draw(st.integers(0, 8)), 2)) for _ in range(count)], poses.tolist()


LIMITS = st.sampled_from(
    [{}, {"min_range": 0.8}, {"max_range": 2.0}, {"max_range": 2.5, "raytrace_range": 1.5},
     {"max_range": 1.5, "raytrace_range": 2.5}, {"raytrace_range": 0.0}, {"offset": (0.5, -0.2)}]
)  # fmt: skip


@pytest.mark.slow
@given(
    run=sequences(), keep=st.sampled_from([1, 2, 3, None]), limits=LIMITS,
    size=st.sampled_from([(2.0, 1.5), (0.9, 3.0)]),
)  # fmt: skip
def test_each_map_is_a_replay_of_the_last_clouds(each_engine, run, keep, limits, size):
    clouds, poses = run
    mapper = RollingMapper(poses, LocalOptions(size=size, resolution=0.3, **limits), keep=keep)
    most = limits.get("max_range", math.inf)
    reach = limits.get("raytrace_range", most)
    least, offset = limits.get("min_range", 0.0), limits.get("offset", (0, 0))
    oracle = {"offset": offset, "least": least, "most": most, "reach": reach}
    for k, points in enumerate(clouds):
        mapper.add(points)
        first = 0 if keep is None else max(0, k + 1 - keep)
        result = mapper.result()
        expected = replayed(clouds[first : k + 1], poses[first : k + 1], size, **oracle)
        np.testing.assert_array_equal(result.grid.occupancy, expected)
        assert result.clouds == k + 1 - first
        corner = np.array(result.grid.origin[:2]) / 0.3  # of all windows on one lattice
        np.testing.assert_allclose(corner, np.round(corner), atol=1e-9)
        alone = replayed([clouds[k]], [poses[k]], size, **oracle)
        assert result.from_earlier == np.count_nonzero((expected == 100) & (alone != 100))


def test_the_map_s_obstacles_are_not_cleared_and_its_free_cells_are_known():
    known = OccupancyGrid([[0, 0, 100, -1, -1, -1]], 0.5, (-1.1, 0.2, 0.0))
    mapper = RollingMapper([[-0.85, 0.45, 0.0]] * 2, LocalOptions(size=(7, 0.5), resolution=0.5),
                           keep=1, global_map=known)  # fmt: skip
    mapper.add([[1.7, 0.0]])  # at 0.85, behind the map's obstacle
    result = mapper.result()
    ((row, col),) = known.frame.continuous_rowcol_from_xy([result.grid.origin[:2]])
    assert (row, col) == pytest.approx((0, round(col)), abs=1e-9)  # one lattice
    shown = result.grid.occupancy[0, -round(col) :]
    assert shown[:6].tolist() == [0, 0, 100, 100, -1, -1]
    assert result.from_map == 1


@pytest.mark.parametrize(("unknown", "value"), [("keep", -1), ("free", 0)])
def test_cells_that_nothing_has_seen(unknown, value):
    mapper = RollingMapper([[0, 0, 0]], LocalOptions(size=(2, 1), resolution=0.5, unknown=unknown))
    mapper.add([[0.7, 0.1]])
    assert mapper.result().grid.occupancy.tolist() == [[value] * 4, [value, value, 0, 100]]


def row_of(*clouds, length=3, keep=None, add="add", **options):
    """The one row of cells that some clouds leave, seen from one place."""
    options = LocalOptions(size=(length, 0.5), resolution=0.5, **options)
    mapper = RollingMapper([(0.25, 0.25, 0.0)] * len(clouds), options, keep=keep)
    for cloud in clouds:
        mapper.skip() if cloud is None else getattr(mapper, add)(cloud)
    return mapper.result().grid.occupancy[0].tolist()


def test_a_cloud_that_is_skipped_or_comes_in_parts_counts_as_one():
    with pytest.raises(ParameterError, match="no cloud"):
        row_of([[0.7, 0.0]], None, None, keep=2)
    assert row_of([[0.7, 0.0]], None, [[-0.7, 0.0]], keep=2) == [-1, -1, 100, 0, -1, -1]
    # a beam of a later part does not clear what an earlier part has marked
    expected = [-1, -1, -1, 0, 100, 100]
    assert row_of([[0.7, 0.1], [1.0, 0.1]]) == expected
    assert row_of([[[0.7, 0.1]], [[1.0, 0.1]]], add="add_in_parts") == expected


def test_a_cloud_that_breaks_off_adds_nothing():
    def parts():
        yield np.array([[0.7, 0.1]])
        raise ValueError("the file ends here")

    mapper = RollingMapper([[0, 0, 0]] * 2, LocalOptions(size=(2, 1), resolution=0.5))
    with pytest.raises(ValueError, match="ends here"):
        mapper.add_in_parts(parts())
    mapper.skip()
    mapper.add(np.empty((0, 2)))
    assert (mapper.result().grid.occupancy == -1).all()


def test_points_far_away_clear_inside_and_those_beyond_the_height_limits_nothing():
    far = [[1e6, 0.0], [-1e9, 0.0], [1e300, 0.0], [math.nan, 0.0], [math.inf, 0.0]]
    assert row_of(far, length=2) == [-1, -1, 0, 0]
    points = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.5]]
    assert row_of(points, min_height=0.1, max_height=1.0) == [-1, 100, 0, 0, -1, -1]


def test_threads_do_not_matter():
    rng = np.random.default_rng(2)
    poses, clouds, found = rng.uniform(-3, 3, (5, 3)), rng.normal(0, 3, (5, 300, 2)), []
    for threads in (1, 3):
        mapper = RollingMapper(poses, LocalOptions(size=(7, 6), resolution=0.07), keep=3)
        with use_threads(threads):
            for points in clouds:
                mapper.add(points)
            found.append(mapper.result().grid.occupancy.tobytes())
    assert found[0] == found[1]


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
    assert np.abs((cols + 0.5) * 0.05 - 10.05).max() == pytest.approx(0.5 / math.tan(0.25), abs=0.2)


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
    assert (np.isinf(noisy) & (noisy > 0)).mean() == pytest.approx(0.25, abs=0.01)
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
    assert np.allclose(matrices(frames), matrices(poses[:1]), atol=1e-9) == (noise == 0)
    mount = np.array([[0.3, -0.2, 1.0]])
    posed = matrices(scanner(mount=tuple(mount[0])).poses_of(poses))
    np.testing.assert_allclose(posed, matrices(poses) @ matrices(mount), atol=1e-12)


def test_the_error_of_odometry_grows_with_the_root_of_the_way():
    line = np.column_stack([np.linspace(0, 900, 90_001), np.zeros((90_001, 2))])
    odometry, _ = noisy_odometry(line, 0.1)
    steps = np.diff(odometry[:, 0] + 1j * odometry[:, 1]) * np.exp(-1j * odometry[:-1, 2])
    covariance = np.cov(steps.real, np.diff(odometry[:, 2]))  # the errors are independent
    np.testing.assert_allclose(covariance, np.eye(2) * 0.1**2 * 0.01, atol=4e-6)
