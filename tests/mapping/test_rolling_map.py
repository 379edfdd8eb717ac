import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal import LocalMapper, LocalOptions, OccupancyGrid, ParameterError, RollingMapper
from mapdeal.kernels.threads import use_threads
from oracles import line

pytestmark = pytest.mark.slow


def cell_of(x, y, resolution, corner=(0.0, 0.0)):
    return (math.floor((y - corner[1]) / resolution + 1e-9),
            math.floor((x - corner[0]) / resolution + 1e-9))  # fmt: skip


def placed(points, pose):
    """Points of the robot as points of the map."""
    x, y, yaw = pose
    return [
        (px * math.cos(yaw) - py * math.sin(yaw) + x, px * math.sin(yaw) + py * math.cos(yaw) + y)
        for px, py in points
    ]


def replayed(clouds, poses, size, resolution, *, least=0.0, most=math.inf, reach=math.inf):
    """What some clouds, each anew on a map of nothing, leave in the last one's window."""
    state = {}
    for points, pose in zip(clouds, poses, strict=True):
        start = cell_of(pose[0], pose[1], resolution)
        marks = set()
        for (px, py), (x, y) in zip(points, placed(points, pose), strict=True):
            r = math.hypot(px, py)
            if r < least:
                continue
            share = min(1.0, reach / r) if r else 1.0
            end = (pose[0] + (x - pose[0]) * share, pose[1] + (y - pose[1]) * share)
            for cell in line(start, cell_of(*end, resolution))[:-1]:
                state[cell] = 0
            if r <= most:
                marks.add(cell_of(x, y, resolution))
        for cell in marks:
            state[cell] = 100
    row, col = cell_of(poses[-1][0] - size[0] / 2, poses[-1][1] - size[1] / 2, resolution)
    height, width = (math.ceil(length / resolution - 1e-9) for length in (size[1], size[0]))
    return [[state.get((row + r, col + c), -1) for c in range(width)] for r in range(height)]


@st.composite
def sequences(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(1, 6))
    poses = np.column_stack(
        [rng.uniform(-2, 3, count), rng.uniform(-1, 1, count), rng.uniform(-3, 3, count)]
    )
    clouds = [rng.uniform(-3, 3, (draw(st.integers(0, 8)), 2)) for _ in range(count)]
    return clouds, poses.tolist()


LIMITS = st.sampled_from(
    [{}, {"min_range": 0.8}, {"max_range": 2.0}, {"max_range": 2.5, "raytrace_range": 1.5},
     {"max_range": 1.5, "raytrace_range": 2.5}, {"raytrace_range": 0.0}]
)  # fmt: skip


@given(
    run=sequences(), keep=st.sampled_from([1, 2, 3, None]), limits=LIMITS,
    size=st.sampled_from([(2.0, 1.5), (0.9, 3.0)]),
)  # fmt: skip
@settings(deadline=None)
def test_each_map_is_a_replay_of_the_last_clouds(run, keep, limits, size):
    clouds, poses = run
    options = LocalOptions(size=size, resolution=0.3, **limits)
    mapper = RollingMapper(poses, options, keep=keep)
    most = limits.get("max_range", math.inf)
    oracle = {
        "least": limits.get("min_range", 0.0), "most": most,
        "reach": limits.get("raytrace_range", most),
    }  # fmt: skip
    for k, points in enumerate(clouds):
        mapper.add(points)
        first = 0 if keep is None else max(0, k + 1 - keep)
        made = mapper.result()
        expected = replayed(clouds[first : k + 1], poses[first : k + 1], size, 0.3, **oracle)
        assert made.grid.occupancy.tolist() == expected
        assert made.clouds == k + 1 - first
        alone = replayed([clouds[k]], [poses[k]], size, 0.3, **oracle)
        earlier = sum(
            both == 100 and one != 100
            for row, own in zip(expected, alone, strict=True)
            for both, one in zip(row, own, strict=True)
        )
        assert made.from_earlier == earlier


def test_the_map_s_obstacles_are_not_cleared_and_its_free_cells_are_known():
    known = OccupancyGrid([[0, 0, 100, -1, -1, -1]], 0.5, (-1.0, 0.0, 0.0))
    mapper = RollingMapper([[-0.75, 0.25, 0.0]] * 2, LocalOptions(size=(7, 0.5), resolution=0.5),
                           keep=1, global_map=known)  # fmt: skip
    mapper.add([[1.7, 0.0]])  # at 0.95, behind the map's obstacle
    made = mapper.result()
    (first,) = known.frame.unbounded_rowcol_from_xy(made.grid.frame.xy_from_rowcol([[0, 0]]))
    shown = made.grid.occupancy[0, -first[1] :]
    assert shown[:6].tolist() == [0, 0, 100, 100, -1, -1]
    assert made.from_map == 1


@pytest.mark.parametrize(("unknown", "value"), [("keep", -1), ("free", 0)])
def test_cells_that_nothing_has_seen(unknown, value):
    mapper = RollingMapper([[0, 0, 0]], LocalOptions(size=(2, 1), resolution=0.5, unknown=unknown))
    mapper.add([[0.7, 0.1]])
    assert mapper.result().grid.occupancy.tolist() == [[value] * 4, [value, value, 0, 100]]


def test_a_cloud_that_is_skipped_counts_as_one_of_the_last():
    mapper = RollingMapper([[0, 0, 0]] * 4, LocalOptions(size=(2, 1), resolution=0.5), keep=2)
    mapper.add([[0.7, 0.1]])
    mapper.skip()
    with pytest.raises(ParameterError, match="no cloud"):
        mapper.result()
    mapper.add([[-0.7, 0.1]])
    made = mapper.result()
    assert made.grid.occupancy[1].tolist() == [100, 0, 0, -1]
    assert made.clouds == 1


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


def test_parts_of_a_cloud_are_one_cloud():
    """A beam of a later part does not clear what an earlier part has marked."""
    one, two = (RollingMapper([[0, 0, 0]], LocalOptions(size=(3, 1), resolution=0.5)) for _ in "ab")
    one.add([[0.7, 0.1], [1.3, 0.1]])
    two.add_in_parts([[[0.7, 0.1]], [[1.3, 0.1]]])
    assert one.result().grid.occupancy[1].tolist() == [-1, -1, -1, 0, 100, 100]
    np.testing.assert_array_equal(one.result().grid.occupancy, two.result().grid.occupancy)


def test_beams_begin_where_an_offset_moves_the_cloud():
    options = LocalOptions(size=(4, 0.5), resolution=0.5, offset=(0.5, 0.0))
    mapper = RollingMapper([[0.75, 0.25, 0.0]], options)
    mapper.add([[1.0, 0.0]])  # seen from 0.25, at 1.25
    shown = mapper.result().grid
    assert shown.origin[0] == -1.5
    assert shown.occupancy[0].tolist() == [-1, -1, -1, 0, 0, 100, -1, -1]


def test_points_that_are_far_away_clear_inside():
    mapper = RollingMapper([[0.25, 0.25, 0.0]], LocalOptions(size=(2, 0.5), resolution=0.5))
    mapper.add([[1e6, 0.0], [-1e9, 0.0], [1e300, 0.0], [math.nan, 0.0], [math.inf, 0.0]])
    assert mapper.result().grid.occupancy[0].tolist() == [-1, -1, 0, 0]


def test_points_beyond_the_height_limits_clear_nothing():
    options = LocalOptions(size=(3, 0.5), resolution=0.5, min_height=0.1, max_height=1.0)
    mapper = RollingMapper([[0.25, 0.25, 0.0]], options)
    mapper.add([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.5]])
    assert mapper.result().grid.occupancy[0].tolist() == [-1, 100, 0, 0, -1, -1]


@needs_compiled
def test_engines_and_threads_agree(monkeypatch):
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(-3, 3, (5, 2)), rng.uniform(-3, 3, 5)])
    clouds = [rng.normal(0, 3, (300, 2)) for _ in poses]
    found = []
    for engine, threads in (("compiled", 1), ("compiled", 3), ("scipy", 1)):
        monkeypatch.setenv("MAPDEAL_KERNELS", engine)
        with use_threads(threads):
            mapper = RollingMapper(poses, LocalOptions(size=(7, 6), resolution=0.07), keep=3)
            for points in clouds:
                mapper.add(points)
            found.append(mapper.result().grid.occupancy.tobytes())
    assert found[0] == found[1] == found[2]


def test_all_windows_lie_on_one_lattice():
    known = OccupancyGrid(np.zeros((4, 5), np.int8), 0.1, (0.03, -0.06, 0.0))
    poses = [[0.013 * k, 0.027 * k, 0.3 * k] for k in range(9)]
    mapper = RollingMapper(poses, LocalOptions(size=(0.6, 0.4), resolution=0.1), global_map=known)
    for _ in poses:
        mapper.add(np.empty((0, 2)))
        x, y, yaw = mapper.result().grid.origin
        assert (x - 0.03) / 0.1 == pytest.approx(round((x - 0.03) / 0.1), abs=1e-9)
        assert (y + 0.06) / 0.1 == pytest.approx(round((y + 0.06) / 0.1), abs=1e-9)
        assert yaw == 0


def test_one_cloud_alone_marks_as_a_local_map_does():
    points = np.random.default_rng(5).uniform(-3, 3, (80, 2))
    options = LocalOptions(size=(4, 3), resolution=0.1, offset=(0.3, -0.2))
    mapper, single = RollingMapper([[1, 2, 0.5]], options), LocalMapper([1, 2, 0.5], options)
    for one in (mapper, single):
        one.add(points)
    np.testing.assert_array_equal(
        mapper.result().grid.occupied(), single.result().grid.occupied()
    )  # fmt: skip
    assert mapper.result().counts == single.result().counts
