"""Clouds that do not show what a map needs: refused, or mapped with what the user states."""

import json
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
    padded = np.pad(marked, 1)
    return np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).any(axis=(2, 3))


def check_walls(values, truth):
    """All true walls are found and no others, within one cell to each side."""
    occupied, walls = values == 100, truth == 100
    assert (occupied & near(walls)).sum() > 0.97 * occupied.sum()
    assert (walls & near(occupied)).sum() > 0.97 * walls.sum()


def free_overlap(values, truth):
    compared = truth != SampledRoom.HIDDEN
    ours, expected = (values == 0) & compared, (truth == 0) & compared
    return (ours & expected).sum() / (ours | expected).sum()


def sliced(room, low, high):
    points = room.points()
    return points[(points[:, 2] > low) & (points[:, 2] < high)]


def layered(room, heights):
    points = room.points("solids")
    points[:, 2] = np.random.default_rng(2).choice(heights, len(points))
    return points


NO_FLOOR = {
    "two layers of walls": lambda room: layered(room, [0.09, 0.11]),
    "layers far apart": lambda room: layered(room, [0.2, 0.6, 1.1]),
    "a thin slice": lambda room: sliced(room, 0.3, 0.4),
    "a thick slice": lambda room: sliced(room, 0.3, 1.2),
    "walls and a ceiling": lambda room: sliced(room, 0.15, 9.0),
    "z down": lambda room: room.points() * [1, -1, -1],
    "y up": lambda room: room.points()[:, [0, 2, 1]] * [1, 1, -1],
    "y up, another handedness": lambda room: room.points()[:, [0, 2, 1]],
    "x up": lambda room: room.points()[:, [2, 0, 1]],
}


@pytest.mark.parametrize("name", NO_FLOOR)
@settings(max_examples=2)
@given(seed=SEEDS)
def test_clouds_without_a_floor_are_refused(name, seed):
    room = SampledRoom(seed, wall_height=2.0)
    with pytest.raises(MalformedInputError, match=r"no floor found|z does not seem to") as caught:
        cloud_map(NO_FLOOR[name](room))
    assert "--up" in caught.value.hint
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


@settings(max_examples=4)
@given(SEEDS, st.sampled_from([25, 31, 62, 400]))
def test_sparse_floors_are_found_below_dense_ceilings(seed, density):
    room = SampledRoom(seed, floor_density=density, density=1500)
    values, truth, result = map_in_frame(room, room.points())
    check_walls(values, truth)
    assert free_overlap(values, truth) > 0.95
    assert abs(np.nanmedian(result.layers["floor_height"])) < 0.02


def test_floors_of_hardly_any_points_are_refused():
    room = SampledRoom(1, floor_density=2, density=1500)
    with pytest.raises(MalformedInputError, match="no floor found"):
        cloud_map(room.points())


@settings(max_examples=4)
@given(SEEDS, st.sampled_from(["z", "-z", "y", "-y", "x", "-x"]))
def test_turned_clouds_make_the_map_of_upright_ones(seed, up):
    points = SampledRoom(seed).points()
    # the turn that takes z to the axis, from where that takes the axis to z
    turn = upright(np.eye(3), up)
    turned = points @ turn.T
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert np.allclose(upright(turned, up), points)
    result, expected = cloud_map(turned, up=up), cloud_map(points)
    assert np.array_equal(result.grid.occupancy, expected.grid.occupancy)
    assert not expected.may_be_upside_down


def test_upside_down_rooms_with_walls_up_to_the_ceiling_are_doubted(tmp_path, command):
    room = SampledRoom(4)
    np.save(tmp_path / "room.npy", room.points() * [1, -1, -1])
    words = ["build", "--cloud", tmp_path / "room.npy", "-o", tmp_path / "map.yaml", "--force"]
    assert "--up -z turns the cloud" in command(*words)[2]
    for up in ("z", "-z"):
        code, _, err = command(*words, "--up", up)
        assert (code, err) == (0, "")


def car_park(storeys=2, height=2.8, is_open=True):
    """Return points of storeys joined by ramps, with a car on each, and a gap in the scan."""
    random, parts = np.random.default_rng(5), []

    def surface(count, x, y, z):
        return np.column_stack([random.uniform(*side, count) for side in (x, y, z)])

    for storey in range(storeys):
        base = storey * height
        floor = surface(90_000, (0, 24), (0, 12), (base, base))
        on_ramp = (floor[:, 0] > 2) & (floor[:, 0] < 20) & (floor[:, 1] > 9)
        car = (floor[:, 0] > 12) & (floor[:, 0] < 16) & (floor[:, 1] > 3) & (floor[:, 1] < 5)
        if storey:
            floor = floor[~on_ramp & ~car]
        else:
            hidden = (np.abs(floor[:, 0] - 6) < 1) & (np.abs(floor[:, 1] - 6) < 1)
            floor = floor[~car & ~hidden & (is_open | ~on_ramp)]
        parts += [floor, box_points(random, 300, (12, 16, 3, 5, base, base + 1.4))]
        slab = surface(90_000, (0, 24), (0, 12), (base + height - 0.25, base + height - 0.25))
        parts.append(slab[~((slab[:, 0] > 2) & (slab[:, 0] < 20) & (slab[:, 1] > 9))])
        walls = box_points(random, 300, (0, 24, 0, 12, base, base + height - 0.3), has_top=False)
        parts.append(walls)
        if storey + 1 < storeys:
            ramp = surface(16_000, (2, 20), (9, 12), (0, 0))
            ramp[:, 2] = base + (ramp[:, 0] - 2) / 18 * height
            parts.append(ramp)
    points = np.concatenate(parts)
    return points + random.normal(0, 0.01, points.shape)


@pytest.mark.parametrize("is_open", [True, False])
def test_one_storey_of_a_car_park_is_mapped(is_open):
    points = car_park(is_open=is_open)
    result = cloud_map(points)
    heights = result.layers["floor_height"]
    rows, cols = result.grid.frame.unbounded_rowcol_from_xy(
        [[6, 6], [14, 3.01], [20, 2], [22, 10.5], [10, 7]]
    ).T
    values = result.grid.occupancy[rows, cols]
    assert values.tolist() == [-1, 100, 0, 0, 0]
    off_ramp = heights[: rows[0] + 40]
    assert np.nanmax(np.abs(off_ramp[np.isfinite(off_ramp)])) < 0.1
    assert result.storeys == pytest.approx((2.8,), abs=0.05)
    assert result.overlaid_m2 > 200
    upper = cloud_map(points, at=(20.0, 2.0, 2.9))
    assert np.nanmedian(upper.layers["floor_height"]) == pytest.approx(2.8, abs=0.02)
    (row, col), (car_row, car_col) = upper.grid.frame.unbounded_rowcol_from_xy([[20, 2], [14, 4]])
    assert (upper.grid.occupancy[row - 8 : row + 8, col - 8 : col + 8] == 0).all()
    # the ceiling of the storey below is no floor under a car
    assert (upper.grid.occupancy[car_row - 8 : car_row + 8, car_col - 8 : car_col + 8] != 0).all()


def test_a_place_without_a_storey_is_refused():
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
    levels = Levels(patches_of(voxels.columns(), 5, limits), 0.25, limits)
    for label in np.unique(levels.label):
        own = levels.label == label
        for tile in np.unique(levels.tile[own]):
            assert np.ptp(levels.patches.z[own & (levels.tile == tile)]) <= room + 1e-9
    largest = np.bincount(levels.label).max()
    assert largest > 0.25 * len(levels.label)


@pytest.mark.parametrize(("leaf", "has_ceiling"), [(0.15, True), (0.5, False)])
def test_cells_are_no_finer_than_a_voxel_filter(leaf, has_ceiling):
    room = SampledRoom(7, ceiling=has_ceiling, density=1500, floor_density=1500)
    sampled = room.points()
    keys, whose = np.unique(np.floor(sampled / leaf), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(whose.ravel(), axis) for axis in sampled.T], axis=1)
    centroids = sums / np.bincount(whose.ravel())[:, np.newaxis]
    for points in (centroids, (keys + 0.5) * leaf):
        result = cloud_map(points)
        assert (
            result.grid.resolution > (0.45 if leaf < 0.2 else 0.8) * leaf
        )  # a filter can leave pairs of points
        assert result.grid.resolution < 1.5 * leaf + 1e-9
        assert (result.grid.occupancy == 0).mean() > 0.4


@pytest.mark.parametrize("leaf", [0.3, 0.5])
def test_coarse_voxels_show_posts_and_aisles(leaf):
    random, resolution = np.random.default_rng(1), leaf * 1.1
    floor = np.column_stack([random.uniform(0, 12, (60_000, 2)), random.normal(0, 0.01, 60_000)])
    posts = [(1.3 + 2 * k, 10.2, 0.15) for k in range(5)]
    boxes = [(x - half, x + half, y - half, y + half, 0, 1.5) for x, y, half in posts]
    boxes += [(2, 10, y, y + 2, 0, 1.5) for y in (2, 4 + 2.5 * leaf)]
    points = np.concatenate([floor, *(box_points(random, 600, box) for box in boxes)])
    voxels = (np.unique(np.floor(points / leaf), axis=0) + 0.5) * leaf
    result = cloud_map(voxels)
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


def test_points_at_the_sensor_are_left_out_and_counted(tmp_path, command):
    room = SampledRoom(2)
    place, lines = np.array([1.0, 1.0, 0.4]), []
    for k in range(8):
        sensor = place + np.array([0.2 * k, 0, 0])
        scan = np.concatenate([room.points() - sensor, np.zeros((50, 3))])
        near_it = np.random.default_rng(k).normal(0, 0.1, (30, 3))
        np.save(tmp_path / f"scan{k}.npy", np.concatenate([scan, near_it]))
        lines.append(f"{k} {' '.join(map(str, sensor))} 0 0 0 1\n")
    (tmp_path / "poses.txt").write_text("".join(lines))
    words = ["build", "--cloud", tmp_path, "--poses", tmp_path / "poses.txt",
             "-o", tmp_path / "map.yaml", "--force", "--json"]  # fmt: skip
    code, text, err = command(*words)
    assert code == 0, err
    assert json.loads(text)["at_sensor"] == 8 * 50
    code, text, err = command(*words, "--range-min", "0.6")
    assert code == 0, err
    assert json.loads(text)["at_sensor"] >= 8 * 79


@examples(20)
@given(st.lists(st.tuples(*[st.sampled_from([0.0, 0.5, -2.0, np.nan])] * 3), min_size=1),
       st.sampled_from([0.0, 1.0]))  # fmt: skip
def test_points_away_from_the_sensor_are_those_of_a_loop(points, range_min):
    expected = [p for p in points if any(p) and not np.linalg.norm(p) < range_min]
    found = away_from_sensor(np.array(points), range_min)
    assert np.array_equal(found, np.array(expected).reshape(-1, 3), equal_nan=True)


def test_one_pose_names_a_place_and_moves_nothing(tmp_path, command):
    np.save(tmp_path / "room.npy", SampledRoom(2).points())
    (tmp_path / "pose.txt").write_text("1 1 0\n")
    maps = []
    for more in ((), ("--poses", tmp_path / "pose.txt")):
        code, _, err = command("build", "--cloud", tmp_path / "room.npy", *more,
                               "-o", tmp_path / "map.npz", "--force")  # fmt: skip
        assert code == 0, err
        with np.load(tmp_path / "map.npz") as stored:
            maps.append((stored["occupancy"], stored["origin"]))
    assert all(np.array_equal(*pair) for pair in zip(*maps, strict=True))


def test_huge_coordinates_are_refused_without_a_warning_of_python(tmp_path, command):
    (tmp_path / "far.csv").write_text("x,y,z\n1e308,0,0\n1,1e308,2\n0,1,-1e308\n")
    code, _, err = command("build", "--cloud", tmp_path / "far.csv", "-o", tmp_path / "m.yaml")
    assert code == 3
    assert "Warning" not in err


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


CASES = {
    "ceiling-taken-as-floor/nofloor_ceiling.npy": "no floor found",
    "lightning-upside-down/upside_down.npy": "no floor found",
    "walls-slice-becomes-free/two_layers.npy": "no floor found",
}


@pytest.mark.parametrize("name", CASES)
def test_reported_clouds_are_refused(real_maps, name):
    with pytest.raises(MalformedInputError, match=CASES[name]):
        cloud_map(np.load(real_maps / "cases" / name))


def test_a_reported_voxel_cloud_is_mapped(real_maps):
    result = cloud_map(np.load(real_maps / "cases" / "voxel-0.3-resolution" / "vx0.3.npy"))
    assert result.grid.resolution == pytest.approx(0.3)
    assert (result.grid.occupancy == 0).mean() > 0.8
