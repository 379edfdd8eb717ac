"""Maps of clouds: against solids measured cell by cell, and a naive rule on levelled points."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks import clouds
from benchmarks.clouds import Solid, World, box, ground, ours, post, room, scores, table
from hypothesis import example, given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

import mapdeal
from mapdeal import CloudMapper, Frame, cloud_map
from mapdeal.mapping import cloud_floor, voxels
from mapdeal.mapping.cloud_floor import Limits, Patches, _lacks_room, _links_of, _nearest
from mapdeal.mapping.cloud_map import _closed, _drop_lone
from mapdeal.mapping.voxels import Tilt, Voxels, _cell_keys, _spacing, levelled
from strategies import examples

EXAMPLES = Path(__file__).parents[2] / "examples"
RAMP = EXAMPLES / "clouds" / "ramp.pcd"
SLOTS, PITCH = (3, 4), 12  # places for blocks, and the cells from one to the next
LEAST = {"rooms": (0.6, 0.93), "ramp of 10 degrees": (0.5, 0.93), "drops": (0.6, 0.9)}


def small(world: World, **more) -> World:
    """Return a world that is scanned from fewer places."""
    for name, value in {"steps": 20, "azimuths": 360, **more}.items():
        setattr(world, name, value)
    return world


@cache
def points_of(name: str) -> np.ndarray:
    return small(clouds.WORLDS[name]()).cloud()


@examples(15)
@given(
    st.lists(st.just(0.0) | st.floats(0.25, 1.6), min_size=12, max_size=12),
    st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.floats(-30, 30),
    st.sampled_from([0.05, 0.1]), st.tuples(st.floats(-400, 400), st.floats(-400, 400)),
)  # fmt: skip
def test_heights_are_above_a_sloping_floor(heights, along_x, along_y, base, cell, corner):
    height, width = (PITCH * (slots + 1) for slots in SLOTS)
    rows, cols = np.indices((height, width))
    stands = np.zeros((height, width))
    for k, block_height in enumerate(heights):
        row, col = PITCH * (k // SLOTS[1] + 1), PITCH * (k % SLOTS[1] + 1)
        stands[row : row + 3, col : col + 3] = block_height
    x, y = (corner[0] + (cols + 0.5) * cell, corner[1] + (rows + 0.5) * cell)
    floor = base + along_x * (cols - width / 2) * cell + along_y * (rows - height / 2) * cell
    is_block = stands > 0
    layers = [np.stack([x, y, floor], -1).reshape(-1, 3)] * 3
    layers += [np.stack([x, y, floor + stands], -1)[is_block]] * 4
    frame = Frame(height, width, cell, (*corner, 0.0))
    points = np.concatenate(layers)
    points[:, 2] += np.random.default_rng(3).normal(0, 0.005, len(points))
    result = cloud_map(points, frame=frame, climb=0.06, robot_height=1.0)
    # each cell has its own height, in steps of a centimetre and a half
    surely = (stands > 0) & (stands < 0.95)
    maybe = (stands >= 0.95) & (stands < 1.05)
    occupied = result.grid.occupancy == 100
    assert occupied[surely].all()
    assert not occupied[~surely & ~maybe].any()
    assert (result.grid.occupancy[~occupied] == 0).all()
    assert np.nanmax(np.abs(result.layers["floor_height"] - floor)) < 0.06
    assert np.abs(result.layers["obstacle_height"][surely] - stands[surely]).max(initial=0) < 0.08
    rise = np.hypot(along_x, along_y)
    inner = result.layers["slope"][PITCH:-PITCH, PITCH:-PITCH]
    # below objects about as high as the robot, only some points are floor
    assert np.abs(inner - rise).max() < 0.3 * rise + 0.08 or maybe.any()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] * (name != "rooms")) for name in LEAST]
)
def test_maps_are_those_of_the_world_and_better_than_a_band_of_heights(monkeypatch, name):
    monkeypatch.setattr(clouds, "SAMPLES", 3)  # in each cell of the true map
    world, points = small(clouds.WORLDS[name]()), points_of(name)
    truth = world.truth()
    found = scores(ours(world, points, truth), truth)
    usual = scores(clouds.peer(points, truth), truth)
    assert np.greater(found, [LEAST[name], usual]).all()


def hall(*solids: Solid, **more) -> World:
    path = [(1, 1, 0.6), (4, 1, 0.6), (4, 3, 0.6), (1, 3, 0.6)]
    world = World([ground(0, 5, 0, 4), *room(0, 5, 0, 4), *solids], path)
    return small(world, **{"steps": 6, **more})


def state_at(result, x, y):
    (cell,) = result.grid.frame.unbounded_rowcol_from_xy([[x, y]])
    return int(result.grid.occupancy[tuple(cell)])


LAMP = box(2.3, 2.7, 1.8, 2.2, 1.3, 1.4)
PLACES = {
    "floor": ([], {}, 0),
    "a post": ([post(2.51, 2.01, 0.05, 0.5)], {}, 100),
    "a table's middle": (table(2.5, 2.0), {}, 100),
    "a table above a low robot": (table(2.5, 2.0), {"robot_height": 0.5}, 0),
    "a lamp above the robot": ([LAMP], {}, 0),
    "a lamp that a tall robot meets": ([LAMP], {"robot_height": 1.6}, 100),
    "a mat that it climbs": ([box(2.3, 2.7, 1.8, 2.2, 0, 0.025)], {}, 0),
}


@pytest.mark.parametrize(("solids", "options", "state"), PLACES.values(), ids=PLACES)
def test_obstacles_are_what_the_robot_meets(solids, options, state):
    result = cloud_map(hall(*solids).cloud(), **options)
    assert state_at(result, 2.51 + 0.013, 2.01 + 0.021) == state


@pytest.mark.parametrize(("drops", "state"), [("occupied", 100), ("unknown", -1)])
def test_drops_are_never_free(drops, state):
    result = cloud_map(points_of("drops"), drops=drops)
    assert state_at(result, 2.7, 2.7) == state  # the pit
    assert state_at(result, 5.3, 4.7) == 0


def test_what_was_not_seen_is_unknown():
    points = hall().cloud()
    hole = (np.abs(points[:, 0] - 2.5) < 0.4) & (np.abs(points[:, 1] - 2.0) < 0.4)
    seen = points[~hole | (points[:, 2] > 1.5)]
    for cloud, options, state in ((seen, {}, -1), (points, {}, 0), (seen, {"fill": 1e308}, 0)):
        assert state_at(cloud_map(cloud, **options), 2.5, 2.0) == state


@pytest.mark.parametrize(("rise", "lacking"), [
    (0.1, []), (0.11, [2, 6, 8, 10, 14]), (1.0, [2, 6, 8, 10, 14]), (1.01, []),
])  # fmt: skip
def test_floors_under_a_slab_lack_room_but_at_its_corners(rise, lacking):
    row, col = np.divmod(np.arange(9).repeat(2), 3)
    patches = Patches(row - 7, col + 4, np.tile([0.0, rise], 9), *np.zeros((3, 18)))
    found = _lacks_room(patches, Limits(climb=0.1, robot_height=1.0, max_slope=10.0, steps=0.0))
    assert np.flatnonzero(found).tolist() == lacking


@pytest.mark.parametrize(("tiles", "slopes", "rise", "links"), [
    (1, (0.0, 0.3), 0.0375, [(0, 1)]), (1, (0.0, 0.3), 0.11, []),
    (2, (0.0, 0.3), 0.075, []), (2, (0.3, 0.3), 0.15, [(0, 1)]),
])  # fmt: skip
def test_neighbours_may_bend_but_over_a_gap_slopes_are_equal(tiles, slopes, rise, links):
    patches = Patches(np.zeros(2, int), np.array([5, 5 + tiles]), np.array([-2.0, rise - 2.0]),
                      np.array(slopes), *np.zeros((2, 2)))  # fmt: skip
    assert [(int(a), int(b)) for a, b in zip(*_links_of(patches, 0.25, 0.06), strict=True)] == links


@pytest.mark.parametrize(
    ("every", "expected"), [(1, 0.0), (2, math.sqrt(2)), (4, 2.0), (1.2, math.sqrt(1.2))]
)
def test_the_spacing_of_points_is_that_of_their_share_of_cells(every, expected):
    row, col = np.indices((16, 16)).reshape(2, -1)
    chosen = {1: row >= 0, 2: (row + col) % 2 == 0, 4: (row % 2 == 0) & (col % 2 == 0)}
    chosen[1.2] = chosen[2] | ~np.isin(col, (2, 3, 12, 13))  # next to the rim
    cells = np.stack([row, col, 0 * row])[:, chosen[every]]
    assert _spacing(_cell_keys(cells, 1), _cell_keys(cells, 2), 1) == pytest.approx(expected)


@cache
def storeys() -> np.ndarray:
    solids = [ground(0, 5, 0, 4), box(0, 5, 0, 4, 2.5, 2.8), *room(0, 5, 0, 4, 5.3, ceiling=False)]
    path = [(1, 1, 0.6), (4, 3, 0.6), (1, 1, 3.4), (4, 3, 3.4)]
    return small(World(solids, path)).cloud()


def test_the_floor_is_that_under_the_robot():
    points, heights = storeys(), []
    for z in (0.6, 3.4):
        mapper = CloudMapper()
        mapper.add(points)
        mapper.add_place([1.0, 1.0, z])
        heights.append(float(np.nanmedian(mapper.result().layers["floor_height"])))
    assert heights == pytest.approx([0.0, 2.8], abs=0.03)
    result = cloud_map(points)
    assert np.nanmedian(result.layers["floor_height"]) == pytest.approx(0.0, abs=0.03)
    assert result.storeys == pytest.approx((2.8,), abs=0.03)


@pytest.mark.parametrize("cloud", [lambda: points_of("drops"), storeys])
def test_a_cloud_that_is_moved_or_turned_has_the_same_map(cloud):
    # sums with binary fractions are exact, and none of these points lies on the edge of a cell
    points = np.floor(cloud() * 1024) / 1024 + 1 / 2048
    expected = cloud_map(points, resolution=1 / 16)
    for shift in ((64, -32, 8), (-128, 16, -8)):
        moved = cloud_map(points + np.array(shift), resolution=1 / 16)
        assert np.array_equal(moved.grid.occupancy, expected.grid.occupancy)
        assert moved.grid.origin[:2] == tuple(np.add(expected.grid.origin, shift)[:2])
        floors = (result.layers["floor_height"] for result in (moved, expected))
        assert np.nanmax(np.abs(np.subtract(*floors) - shift[2])) < 1e-5
    turned = cloud_map(points[:, [1, 0, 2]] * [-1, 1, 1], resolution=1 / 16)
    assert np.array_equal(turned.grid.occupancy, np.rot90(expected.grid.occupancy, -1))


def test_beams_clear_people_that_walked_on_and_nothing_else():
    trail = [
        Solid(solid.normals, solid.offsets, only_in=(0.2 + k / 40, 0.22 + k / 40))
        for k in range(8)
        for solid in [post(1.0 + 0.3 * k, 2.0, 0.2, 1.7)]
    ]
    world = hall(*trail, *table(3.0, 3.2), post(1.7, 3.3, 0.03, 1.2), steps=40)
    truth = world.truth()
    without = ours(world, world.cloud(), truth)
    posed = clouds.ours_with_poses(world, clouds.frame_of(truth)).occupancy
    ends = clouds.frame_of(truth).unbounded_rowcol_from_xy([(0.8, 2.0), (3.5, 2.0)])
    (row, first), (_, last) = ends.tolist()
    path = slice(row - 5, row + 5), slice(first, last)
    assert (without[path] == 100).sum() > 50
    assert (posed[path] == 100).sum() < 5
    elsewhere = np.ones(without.shape, bool)
    elsewhere[path] = False
    in_both = (posed == 100) & (without == 100) & elsewhere
    assert in_both.sum() > 0.95 * ((without == 100) & elsewhere).sum()


@settings(max_examples=3)
@example(4.0, 0.05)
@given(st.floats(0, 2 * np.pi), st.floats(0, np.radians(25)))
def test_the_tilt_of_a_cloud_is_found(azimuth, angle):
    points = points_of("rooms")[::4]
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    cos, sin = np.cos(angle), np.sin(angle)
    along = (points @ axis)[:, np.newaxis] * axis
    turned = points * cos + np.cross(axis, points) * sin + along * (1 - cos)
    tilt = Tilt()
    for part in np.array_split(turned, 3):
        tilt.add(part)
    up, true_up = tilt.up(), np.cross(axis, [0, 0, 1]) * sin + [0, 0, cos]
    assert np.degrees(np.arccos(min(1.0, up @ true_up))) < 0.02
    assert np.abs(levelled(turned, up) - points).max() < 0.003


def test_a_direction_is_refined_to_the_normal_of_the_plane():
    places = np.random.default_rng(1).uniform(-4, 4, (500, 3))
    places[:, 2] = 0.01 * places[:, 0] + 0.02 * places[:, 1]
    found = voxels._refined(np.array([0.0, 0.0, 1.0]), places, np.ones(500))
    assert found == pytest.approx(np.array([-0.01, -0.02, 1.0]) / math.sqrt(1.0005), abs=1e-9)


@examples(20)
@given(st.integers(1, 5000), st.sampled_from([0.03, 0.05, 0.4]), st.booleans())
def test_voxels_are_counted_as_one_by_one(piece, cell, is_shifted):
    points = points_of("rooms")[:16_000:4] + np.multiply(is_shifted, [5e5, 4.5e6, -80.0])
    points[7, 2] = np.nan
    counted = Voxels(cell, 0.025, corner=(0.0, 0.0))
    for first in range(0, len(points), piece):
        counted.add(points[first : first + piece])
    keys = np.floor(np.delete(points, 7, axis=0) / [cell, cell, 0.025] + 1e-9).astype(int)
    finest = counted.columns()
    for columns, times in ((finest, 1), (finest.coarser(3), 3)):
        places = keys[:, [1, 0, 2]] // [times, times, 1]
        expected, counts = np.unique(places, axis=0, return_counts=True)
        whose = columns.of_voxels()
        levels = np.round(columns.heights / 0.025 - 0.5).astype(int)
        found = np.stack([columns.row[whose], columns.col[whose], levels], axis=1)
        assert np.array_equal(found, expected)
        assert np.array_equal(columns.counts, counts)
    assert (counted.points, counted.not_finite) == (4000, 1)


@pytest.mark.parametrize("level", [False, True])
def test_no_map_depends_on_how_much_is_worked_on_at_once(monkeypatch, level):
    points = points_of("rooms")[::12]
    expected = cloud_map(points, level=level)
    monkeypatch.setattr(voxels, "AT_ONCE", 100)
    monkeypatch.setattr(voxels, "_SORTED_AT_ONCE", 1000)
    monkeypatch.setattr(cloud_floor, "AT_ONCE", 100)
    result = cloud_map(points, level=level)
    assert result.figures() == expected.figures()
    assert np.array_equal(result.grid.occupancy, expected.grid.occupancy)
    for name, layer in expected.layers.items():
        assert np.array_equal(result.layers[name], layer, equal_nan=True)


MARKED = st.tuples(st.integers(1, 20), st.integers(1, 20)).flatmap(
    lambda shape: arrays(np.bool_, shape, elements=st.booleans())
)


@examples(100)
@given(MARKED, st.integers(1, 25))
def test_gaps_are_closed_as_scipy_does(marked, wide):
    expected = ndimage.binary_closing(np.pad(marked, wide), np.ones((wide + 1, wide + 1)))
    assert np.array_equal(_closed(marked, wide), expected[wide:-wide, wide:-wide])


@examples(100)
@given(MARKED, st.integers(1, 9))
def test_the_nearest_tiles_are_those_of_scipy(known, reach):
    known[0, 0] = True
    known = np.pad(known, reach)
    far, (rows, cols) = ndimage.distance_transform_edt(~known, return_indices=True)
    near = far <= reach
    away, *found = _nearest(known, reach)
    assert np.array_equal(away, np.where(near, far, np.inf))
    for indices, expected in zip(found, (rows, cols), strict=True):
        assert np.array_equal(indices[near], expected[near])


@examples(100)
@given(MARKED, st.integers(0, 2**32))
def test_groups_of_a_few_cells_are_dropped_if_little_was_seen_of_them(marked, seed):
    counts, on_floor = np.random.default_rng(seed).integers(1, 9, (2, *marked.shape)).astype("i4")
    groups, count = ndimage.label(marked, np.ones((3, 3)))
    expected = marked.copy()
    floor = ndimage.convolve(on_floor, np.ones((3, 3), "i4"), mode="constant")
    for cells in (groups == k + 1 for k in range(count)):
        least = min(max(9, sum(floor[cells] / 9)), 3 + seed % 20)
        if cells.sum() <= 4 and counts[cells].sum() < least:
            expected[cells] = False
    _drop_lone(marked, counts, on_floor, 9, 3 + seed % 20)
    assert np.array_equal(marked, expected)


def test_the_resolution_is_that_of_a_voxel_filter_even_if_its_lattice_is_that_of_cells():
    points = hall(noise=0.0, outliers=0.0).cloud()
    jitter = np.random.default_rng(2).normal(0, 1e-7, (1, 3))
    filtered = np.unique(np.round(points / 0.1), axis=0) * 0.1
    result = cloud_map(filtered + jitter * np.sign(filtered))
    assert result.grid.resolution == pytest.approx(0.1)
    assert (result.grid.occupancy[10:30, 10:40] == 0).mean() > 0.9
    assert cloud_map(points).grid.resolution == 0.05


def test_low_pallets_remain_in_dense_clouds_and_in_those_of_one_centroid_per_voxel():
    points = points_of("warehouse")
    _, whose = np.unique(np.floor(points / 0.05), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(whose.ravel(), values) for values in points.T], axis=1)
    for cloud in (points, sums / np.bincount(whose.ravel())[:, np.newaxis]):
        result = cloud_map(cloud)
        places = [(x / 20, y / 20) for x in range(245, 256) for y in range(25, 41)]
        assert {state_at(result, *place) for place in places} <= {100, -1}


def rows_of(line):
    return "".join(line(i, k) for i in range(99) for k in range(99))


@pytest.mark.parametrize(("text", "message"), [
    ("1,2\n3,4\n", "the cloud has no heights"),
    (rows_of(lambda i, k: f"{i / 10},{k / 10},0\n"), "all points lie at one height"),
    ("x,y,z\n", "holds no points"),
    ("x,y,z\nnan,1,2\n1,inf,2\n", "holds no points that are finite"),
    ("1e308,0,0\n1,1e308,2\n0,1,-1e308\n", "are far apart"),
    ("1e300,0,0\n" * 9, "9 of 9 points are far apart"),
    (rows_of(lambda i, k: f"{0.02 * i},1,{0.02 * k}\n"), "no floor found"),
    (rows_of(lambda i, k: f"{40 * i},{40 * k},0\n{40 * i},{40 * k},2500\n"), "in millimetres?"),
    (rows_of(lambda i, k: f"{i / 3e4},{k / 3e4},{i % 2}\n"), "are its coordinates in metres?"),
], ids=lambda parameter: parameter[:12])  # fmt: skip
def test_bad_clouds_are_refused_in_one_line(tmp_path, build, text, message):
    (tmp_path / "cloud.csv").write_text(text)
    code, _, err = build(tmp_path / "cloud.csv")
    assert (code, message in err) == (3, True), err
    assert len([line for line in err.splitlines() if line.startswith("error")]) == 1
    assert "Warning" not in err
    assert not (tmp_path / "map.yaml").exists()


@pytest.mark.parametrize(("words", "why"), [
    (["--cloud", RAMP, "--method", "tsdf"], "applies to laser scans"),
    (["--cloud", RAMP, "--range-max", "9"], "--range-max: applies to laser scans"),
    (["--cloud", RAMP, "--topic", "/points"], "needs a bag"),
    (["--cloud", RAMP, "--climb", "2"], "must be above climb"),
    (["--cloud", RAMP, "--size", "3,3"], "must be given together"),
    (["--cloud", RAMP, "--layers", "out.csv"], "must end in .npz"),
    ([EXAMPLES / "logs" / "office.log", "--climb", "0.1"], "it needs --cloud"),
])  # fmt: skip
def test_options_that_do_not_fit_are_refused(tmp_path, command, words, why):
    code, _, err = command("build", *words, "-o", tmp_path / "map.yaml")
    assert (code, why in err) == (2, True), err


def test_the_command_makes_the_map_of_python(tmp_path, build):
    layers, image = tmp_path / "layers.npz", tmp_path / "map.png"
    code, text, err = build(RAMP, "--layers", layers, "--image", image, "--json")
    assert code == 0, err
    document = json.loads(text)
    result = mapdeal.build_map_from_clouds(RAMP)
    assert np.array_equal(mapdeal.read_map(tmp_path / "map.yaml").occupancy, result.grid.occupancy)
    assert document["points"] == 21444
    shares = [document[f"{state}_share"] for state in ("floor", "obstacle", "unknown")]
    assert sum(shares) == pytest.approx(1.0, abs=1e-5)
    rise = document["floor_height_max"] - document["floor_height_min"]
    assert rise == pytest.approx(0.36, abs=0.07)
    with np.load(layers) as stored:
        for name, layer in result.layers.items():
            assert np.array_equal(stored[name], layer, equal_nan=True)
    assert image.read_bytes().startswith(b"\x89PNG")


def test_a_bag_makes_the_map_of_its_clouds_where_its_transforms_place_them(tmp_path):
    pytest.importorskip("rosbags")
    from bags.making import START, Maker, cloud as message, tf

    maker, every = Maker(), []
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    move = (0.1, 0.0, 0.35)  # of the lidar on a robot that turns
    maker.add("/tf_static", "tf2_msgs/msg/TFMessage", START,
              tf(START, ("base_link", "lidar", move, (0, 0, 0, 1))))  # fmt: skip
    for k, scan in enumerate(hall(*table(3.0, 3.2)).scan()):
        time, yaw = START + k * 10**8, 0.3 * k
        cos, sin = np.cos(yaw), np.sin(yaw)
        x, y = scan.points[:, :2].T
        points = np.stack([x * cos + y * sin, y * cos - x * sin, scan.points[:, 2]], axis=1)
        data = points.astype("<f4")
        every.append(clouds.placed(scan))
        base = scan.pose[:3] - np.array([cos * move[0], sin * move[0], move[2]])
        turn = (0, 0, np.sin(yaw / 2), np.cos(yaw / 2))
        maker.add("/tf", "tf2_msgs/msg/TFMessage", time, tf(time, ("map", "base_link", base, turn)))
        maker.add("/points", "sensor_msgs/msg/PointCloud2", time,
                  message(time, data.tobytes(), fields, width=len(data), step=12,
                          frame="lidar"))  # fmt: skip
    result = mapdeal.build_map_from_clouds(maker.write(tmp_path, "mcap"))
    expected = cloud_map(np.concatenate(every))
    assert result.points == expected.points
    assert result.grid.shape == expected.grid.shape
    assert result.grid.origin == pytest.approx(expected.grid.origin)
    assert (result.grid.occupancy == expected.grid.occupancy).mean() > 0.98


def test_a_tilted_floor_is_warned_of_and_levelled():
    points = hall(tilt=(1, 0.5, 3)).cloud()
    result, tilted = cloud_map(points, level=True), cloud_map(points)
    assert result.tilt == pytest.approx(3.0, abs=0.3)
    assert tilted.tilt == pytest.approx(3.0, abs=0.5)
    coarse = np.column_stack([points[:, :2], points[:, 2].round(1)])  # its tiles are level
    assert cloud_map(coarse).tilt == pytest.approx(3.0, abs=0.5)
    flat, steep = (np.nanstd(found.layers["floor_height"]) for found in (result, tilted))
    assert flat < 0.015 < steep


@pytest.mark.parametrize("split", [6.0, 8.5, 10.0])
def test_two_levels_and_a_ramp_between_them_are_no_tilt(split):
    draw = np.random.default_rng(1)
    x, y = draw.uniform(0, 20, 40000), draw.uniform(0, 10, 40000)
    floor = np.clip((x - split) / 3, 0, 1) * 0.3 + draw.normal(0, 0.005, len(x))
    wall = np.column_stack([x, np.zeros(len(x)), floor + draw.uniform(0, 2, len(x))])[::10]
    assert cloud_map(np.concatenate([np.column_stack([x, y, floor]), wall])).tilt < 0.5


def test_a_cloud_of_which_few_planes_are_level_is_levelled_as_well_as_may_be():
    result = mapdeal.build_map_from_clouds(EXAMPLES / "clouds" / "corridor3.pcd", level=True)
    assert 0 <= result.tilt < 45
    assert np.isfinite(result.layers["floor_height"]).any()


def test_a_real_building_is_mapped(real_maps):
    result = mapdeal.build_map_from_clouds(real_maps / "KevinLADLee__invs_bringup" / "dufomap.pcd")
    assert result.grid.resolution == pytest.approx(0.1)
    figures = result.figures()
    assert 330 < figures["floor_m2"] < 420
    assert 200 < figures["obstacle_m2"] < 280
