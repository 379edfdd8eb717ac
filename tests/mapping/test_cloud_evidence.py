"""Clouds that do not show what a map needs: refused, or mapped with what the user states."""

import json
import re
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from clouds import SampledRoom, box_points
from mapdeal import CloudMapper, CloudOptions, Frame, MalformedInputError, ParameterError, cloud_map
from mapdeal.mapping.cloud_floor import Levels, Limits, patches_of
from mapdeal.mapping.voxels import Voxels, away_from_sensor, upright
from strategies import examples

SEEDS = st.integers(0, 10_000)


def map_in_frame(room, points, **options):
    result = cloud_map(points, frame=room.frame(), **options)
    return np.asarray(result.grid.occupancy), room.truth(), result


def near(marked):
    return np.lib.stride_tricks.sliding_window_view(np.pad(marked, 1), (3, 3)).any(axis=(2, 3))


def check_walls(values, truth):
    """All true walls are found and no others, within one cell to each side."""
    occupied, walls = values == 100, truth == 100
    assert (occupied & near(walls)).sum() > 0.97 * occupied.sum()
    assert (walls & near(occupied)).sum() > 0.97 * walls.sum()


def sliced(room, low, high):
    points = room.points()
    return points[(points[:, 2] > low) & (points[:, 2] < high)]


def layered(room, heights):
    points = room.points("solids")[:, :2]
    return np.c_[points, np.random.default_rng(2).choice(heights, len(points))]


@pytest.mark.parametrize("points_of", [
    lambda room: layered(room, [0.09, 0.11]),
    lambda room: layered(room, [0.2, 0.6, 1.1]),
    lambda room: sliced(room, 0.3, 0.4),
    lambda room: sliced(room, 0.3, 1.2),
    lambda room: sliced(room, 0.15, 9.0),  # walls and a ceiling
    lambda room: np.r_[room.points("solids"), room.points("floor") * [0.4, 1, 1] + [0, 0, 0.6]],
    lambda room: room.points() * [1, -1, -1],
    lambda room: room.points()[:, [0, 2, 1]] * [1, 1, -1],
    lambda room: room.points()[:, [0, 2, 1]],  # another handedness
    lambda room: room.points()[:, [2, 0, 1]],
])  # fmt: skip
@settings(max_examples=2)
@given(seed=SEEDS)
def test_clouds_without_a_floor_are_refused(points_of, seed):
    room = SampledRoom(seed, wall_height=2.0)
    with pytest.raises(MalformedInputError, match=r"no floor found|z does not seem to") as caught:
        cloud_map(points_of(room))
    assert 'up="' in caught.value.hint
    assert "m2" in caught.value.rule


@settings(max_examples=5)
@given(SEEDS)
def test_a_stated_floor_shows_obstacles_and_leaves_the_rest_unknown(seed):
    room = SampledRoom(seed, ceiling=False)
    values, truth, result = map_in_frame(room, sliced(room, 0.15, 9.0), floor=0.0)
    check_walls(values, truth)
    assert not (values == 0).any()
    assert np.nanmax(result.layers["floor_height"]) == 0.0


def test_beams_make_places_free_above_a_stated_floor():
    room = SampledRoom(3)
    points, frame = sliced(room, 0.15, 9.0), room.frame()
    mapper = CloudMapper(CloudOptions(floor=0.0), frame=frame)
    place = [room.width - 0.4, room.depth - 0.4, 0.5]
    mapper.add(points)
    mapper.settle(follows_beams=True)
    for _ in range(3):
        mapper.clear(points, place)
    values, truth = np.asarray(mapper.result().grid.occupancy), room.truth()
    assert ((values == 0) & (truth == 0)).sum() > 0.3 * (truth == 0).sum()
    assert ((values == 0) & (truth == -1) & ~near(truth != -1)).sum() == 0


@settings(max_examples=3)
@given(SEEDS, st.sampled_from([25, 31, 62, 400]))
def test_sparse_floors_are_found_below_dense_ceilings(seed, density):
    room = SampledRoom(seed, floor_density=density, density=1500)
    values, truth, result = map_in_frame(room, room.points())
    check_walls(values, truth)
    compared = truth != SampledRoom.HIDDEN
    found, free = (values == 0) & compared, (truth == 0) & compared
    assert (found & free).sum() > 0.95 * (found | free).sum()
    assert abs(np.nanmedian(result.layers["floor_height"])) < 0.02


@settings(max_examples=4)
@given(SEEDS, st.sampled_from(["z", "-z", "y", "-y", "x", "-x"]))
def test_turned_clouds_make_the_map_of_upright_ones(seed, up):
    points = SampledRoom(seed, density=200).points()
    # the turn that takes z to the axis, from where that takes the axis to z
    turn = upright(np.eye(3), up)
    turned = points @ turn.T
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert np.allclose(upright(turned, up), points)
    result, expected = cloud_map(turned, up=up), cloud_map(points)
    assert np.array_equal(result.grid.occupancy, expected.grid.occupancy)
    assert not expected.may_be_upside_down


def test_upside_down_rooms_with_walls_up_to_the_ceiling_are_doubted(tmp_path, build):
    np.save(tmp_path / "room.npy", SampledRoom(4).points() * [1, -1, -1])
    assert "--up -z turns the cloud" in build(tmp_path / "room.npy")[2]
    for up in ("z", "-z"):
        assert build(tmp_path / "room.npy", "--up", up)[::2] == (0, "")


def car_park(height=2.8, is_open=True):
    """Return points of two storeys with a car on each, a ramp, and a gap in the scan below."""
    random, parts = np.random.default_rng(5), []

    def level(count, z, x=(0, 24), y=(0, 12)):
        return np.column_stack([random.uniform(*side, count) for side in (x, y, (z, z))])

    def within(points, x0, x1, y0, y1):
        x, y = points[:, :2].T
        return (x > x0) & (x < x1) & (y > y0) & (y < y1)

    for base in (0, height):
        floor, slab = level(50_000, base), level(50_000, base + height - 0.25)
        floor = floor[~within(floor, 12, 16, 3, 5)]
        if base or not is_open:
            floor = floor[~within(floor, 2, 20, 9, 12)]
        if not base:
            floor = floor[~within(floor, 5, 7, 5, 7)]
        parts += [
            floor, slab[~within(slab, 2, 20, 9, 12)],
            box_points(random, 200, (12, 16, 3, 5, base, base + 1.4)),
            box_points(random, 200, (0, 24, 0, 12, base, base + height - 0.3), has_top=False),
        ]  # fmt: skip
    ramp = level(11_000, 0, (2, 20), (9, 12))
    ramp[:, 2] = (ramp[:, 0] - 2) / 18 * height
    points = np.concatenate([*parts, ramp])
    return points + random.normal(0, 0.01, points.shape)


@pytest.mark.parametrize("is_open", [True, False])
def test_one_storey_of_a_car_park_is_mapped(is_open):
    points = car_park(is_open=is_open)
    result = cloud_map(points)
    places = [[6, 6], [14, 3.01], [20, 2], [22, 10.5], [10, 7]]
    assert result.grid.query(places).values.tolist() == [-1, 100, 0, 0, 0]
    ((row, _),) = result.grid.frame.unbounded_rowcol_from_xy(places[:1])
    off_ramp = result.layers["floor_height"][: row + 40]
    assert np.nanmax(np.abs(off_ramp[np.isfinite(off_ramp)])) < 0.1
    assert result.storeys == pytest.approx((2.8,), abs=0.05)
    assert result.overlaid_m2 > 200
    upper = cloud_map(points, at=(20.0, 2.0, 2.9))
    assert np.nanmedian(upper.layers["floor_height"]) == pytest.approx(2.8, abs=0.02)
    (row, col), (car_row, car_col) = upper.grid.frame.unbounded_rowcol_from_xy([[20, 2], [14, 4]])
    assert (upper.grid.occupancy[row - 8 : row + 8, col - 8 : col + 8] == 0).all()
    # the ceiling of the storey below is no floor under a car
    assert (upper.grid.occupancy[car_row - 8 : car_row + 8, car_col - 8 : car_col + 8] != 0).all()


@pytest.mark.parametrize("rise", [-0.8, 0.5, 1.2])
def test_a_floor_beside_the_mapped_one_is_named(tmp_path, build, rise):
    room = SampledRoom(1)
    move = np.array([room.width + 1.0, 0.0, rise])
    np.save(tmp_path / "beside.npy", np.concatenate([room.points(), room.points() + move]))
    _, _, err = build(tmp_path / "beside.npy")
    others = re.search(r"other floors are not on the map: .* at (-?[0-9.]+) m", err)[1]
    assert float(others) in (pytest.approx(rise, abs=0.03), pytest.approx(0.0, abs=0.03))


def test_floors_of_hardly_any_points_and_places_without_a_storey_are_refused():
    with pytest.raises(MalformedInputError, match="no floor found"):
        cloud_map(SampledRoom(1, floor_density=2, density=1500).points())
    with pytest.raises(MalformedInputError, match="no level is at or below -7 m there"):
        cloud_map(SampledRoom(1).points(), at=(1.0, 1.0, -7.0))
    with pytest.raises(ParameterError, match="cannot be given together with floor"):
        cloud_map(SampledRoom(1).points(), at=(1.0, 1.0, 0.0), floor=0.0)


@settings(max_examples=5)
@given(SEEDS, st.floats(0.5, 3.0))
def test_levels_lie_above_each_place_once(seed, room):
    random = np.random.default_rng(seed)
    # helical ramps: all hangs together, and lies above itself
    turns = random.uniform(0, 2.5, 60_000)
    angle, radius = 2 * np.pi * turns, np.sqrt(random.uniform(1.5**2, 4**2, len(turns)))
    rise = random.uniform(room + 0.3, room + 2.0)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rise * turns])
    voxels = Voxels(0.05, 0.0125)
    voxels.add(points)
    limits = Limits(0.05, room, 40.0, 0.0)
    levels = Levels(patches_of(voxels.columns(), 5, limits), 5, 0.05, limits)
    for label in np.unique(levels.label):
        own = levels.label == label
        for tile in np.unique(levels.tile[own]):
            assert np.ptp(levels.patches.z[own & (levels.tile == tile)]) <= room + 1e-9
    assert np.bincount(levels.label).max() > 0.25 * len(levels.label)


@pytest.mark.parametrize(("leaf", "has_ceiling"), [(0.15, True), (0.5, False)])
def test_cells_are_no_finer_than_a_voxel_filter(leaf, has_ceiling):
    room = SampledRoom(7, ceiling=has_ceiling, density=800, floor_density=800)
    sampled = room.points()
    keys, whose = np.unique(np.floor(sampled / leaf), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(whose.ravel(), axis) for axis in sampled.T], axis=1)
    centroids = sums / np.bincount(whose.ravel())[:, np.newaxis]
    for points in (centroids, (keys + 0.5) * leaf):
        result = cloud_map(points)
        # a filter can leave pairs of points
        assert (0.45 if leaf < 0.2 else 0.8) * leaf < result.grid.resolution < 1.5 * leaf + 1e-9
        assert (result.grid.occupancy == 0).mean() > 0.4


@pytest.mark.parametrize("leaf", [0.3, 0.5])
def test_coarse_voxels_show_posts_and_aisles(leaf):
    random, resolution = np.random.default_rng(1), leaf * 1.1
    floor = np.column_stack([random.uniform(0, 12, (60_000, 2)), random.normal(0, 0.01, 60_000)])
    posts = [(1.3 + 2 * k, 10.2, 0.15) for k in range(5)]
    boxes = [(x - half, x + half, y - half, y + half, 0, 1.5) for x, y, half in posts]
    boxes += [(2, 10, y, y + 2, 0, 1.5) for y in (2, 4 + 2.5 * leaf)]
    points = np.concatenate([floor, *(box_points(random, 600, box) for box in boxes)])
    result = cloud_map((np.unique(np.floor(points / leaf), axis=0) + 0.5) * leaf)
    assert result.grid.resolution == pytest.approx(resolution, rel=0.15)
    frame, values = result.grid.frame, result.grid.occupancy
    for row, col in frame.unbounded_rowcol_from_xy([post[:2] for post in posts]).tolist():
        assert (values[row - 1 : row + 2, col - 1 : col + 2] == 100).any()
    aisle = frame.unbounded_rowcol_from_xy([(x, 4 + 1.25 * leaf) for x in (4, 6, 8)])
    assert (values[tuple(aisle.T)] == 0).all()


def test_sparse_floors_of_corridors_do_not_make_them_lie_on_their_sides():
    random, hall = np.random.default_rng(1), (0, 20, 0, 2.2, 0, 2.6)
    floor, ceiling = (random.uniform(0, 1, (count, 3)) for count in (1100, 40_000))
    points = np.concatenate([floor * [20, 2.2, 0], ceiling * [20, 2.2, 0] + [0, 0, 2.6],
                             box_points(random, 1000, hall, has_top=False),
                             box_points(random, 1000, (4, 4.8, 0, 0.4, 0, 0.9))])  # fmt: skip
    result = cloud_map(points)
    assert (result.grid.occupancy == 0).mean() > 0.7
    assert not result.may_be_upside_down
    assert cloud_map(points * [1, -1, -1]).may_be_upside_down
    cupboards = [box_points(random, 1000, (x, x + 0.8, 0, 0.5, 0, 1.9)) for x in (6, 8, 10, 12)]
    assert not cloud_map(np.concatenate([points, *cupboards])).may_be_upside_down


def test_table_tops_of_voxels_whose_centres_are_above_the_robot_are_obstacles():
    side = np.arange(0, 6, 0.05) + 0.025
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    floor = np.column_stack([x, y, np.full(len(x), 0.025)])
    table = floor[(np.abs(x - 3) < 0.5) & (np.abs(y - 3) < 0.5)] + [0, 0, 1.0]
    wall = np.concatenate([floor[x < 0.05] + [0, 0, 0.05 * k] for k in range(40)])
    result = cloud_map(np.concatenate([floor, table, wall]))
    (cell,) = result.grid.frame.unbounded_rowcol_from_xy([[3.0, 3.0]])
    assert result.grid.occupancy[tuple(cell)] == 100


def test_points_at_the_sensor_are_left_out_and_counted(tmp_path, build):
    room, lines = SampledRoom(2).points(), []
    for k in range(3):
        sensor = np.array([1 + 0.2 * k, 1.0, 0.4])
        near_it = np.random.default_rng(k).normal(0, 0.1, (30, 3))
        scan = np.concatenate([room[k::2] - sensor, np.zeros((50, 3)), near_it])
        np.save(tmp_path / f"scan{k}.npy", scan)
        lines.append(f"{k} {' '.join(map(str, sensor))} 0 0 0 1\n")
    (tmp_path / "poses.txt").write_text("".join(lines))
    counts = []
    for more in ((), ("--range-min", "0.6")):
        code, text, err = build(tmp_path, "--poses", tmp_path / "poses.txt", "--json", *more)
        assert code == 0, err
        counts.append(json.loads(text)["at_sensor"])
    assert counts[0] == 3 * 50
    assert counts[1] >= 3 * 79


@examples(20)
@given(st.lists(st.tuples(*[st.sampled_from([0.0, 0.5, -2.0, np.nan])] * 3), min_size=1),
       st.sampled_from([0.0, 1.0]))  # fmt: skip
def test_points_away_from_the_sensor_are_those_of_a_loop(points, range_min):
    expected = [p for p in points if any(p) and not np.linalg.norm(p) < range_min]
    found = away_from_sensor(np.array(points), range_min)
    assert np.array_equal(found, np.array(expected).reshape(-1, 3), equal_nan=True)


def test_one_pose_names_a_place_and_moves_nothing(tmp_path, build):
    np.save(tmp_path / "room.npy", SampledRoom(2).points())
    (tmp_path / "pose.txt").write_text("1 1 0\n")
    maps = []
    for more in ((), ("--poses", tmp_path / "pose.txt")):
        code, _, err = build(tmp_path / "room.npy", *more)
        assert code == 0, err
        maps.append([(tmp_path / name).read_bytes() for name in ("map.yaml", "map.pgm")])
    assert maps[0] == maps[1]


@pytest.mark.parametrize("size", ["20000,0.05", "0.05,20000"])
def test_long_windows_take_no_more_memory_than_is_claimed(tmp_path, size):
    width, height = (round(float(side) / 0.05) for side in size.split(","))
    claimed = []
    mapper = CloudMapper(frame=Frame(height, width, 0.05, (0.0, 0.0, 0.0)),
                         claim=lambda count, _: claimed.append(count))  # fmt: skip
    mapper.add(SampledRoom(1).points())
    tracemalloc.start()
    mapper.result()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < max(claimed) + 30_000_000


@pytest.mark.parametrize("name", [
    "ceiling-taken-as-floor/nofloor_ceiling", "lightning-upside-down/upside_down",
    "walls-slice-becomes-free/two_layers",
])  # fmt: skip
def test_reported_clouds_are_refused(real_maps, name):
    with pytest.raises(MalformedInputError, match="no floor found"):
        cloud_map(np.load(real_maps / "cases" / f"{name}.npy"))


def test_a_reported_voxel_cloud_is_mapped(real_maps):
    result = cloud_map(np.load(real_maps / "cases" / "voxel-0.3-resolution" / "vx0.3.npy"))
    assert result.grid.resolution == pytest.approx(0.3)
    assert (result.grid.occupancy == 0).mean() > 0.8
