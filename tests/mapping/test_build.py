"""Method tsdf as design document 004 lists it, against a walk through that listing."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
import oracles
from drawn import cells as drawn_cells
from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal import MalformedInputError, MapBuilder, ParameterError, Scans, build_map
from mapdeal.grid.frame import Frame
from mapdeal.mapping import evidence
from mapdeal.mapping.build import frame_of
from mapping.conftest import cell_of
from oracles import line

METHODS, TSDF = ["log-odds", "counting", "tsdf"], {"method": "tsdf"}
RES = 0.25
GRID = {"resolution": RES, "size": (2.75, 2.0), "origin": (-0.5, 1.25)}
SHAPE = (8, 11)
SHAPES = st.sampled_from([(8, 11), (11, 8), (1, 9), (9, 1), (1, 1), (6, 6)])
LIMITS = st.sampled_from(
    [{}, {"range_min": 0.5}, {"clear_max": 3.0}, {"range_max": 5.0, "clear_max": 2},
     {"range_max": 2.0, "clear_max": 80.0}]
)  # fmt: skip
ODDS = st.sampled_from(
    [(-1, 2, 0, 100), (-30, 40, 10, 90), (-0.4, 0.85, 0, 100), (-50, 50, 0, 100)]
)
BEHIND = st.sampled_from([(1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (2.0, 0.5), (3.5, 0.4), (1.0, 2.6)])


def walk(run, *, range_min=0.0, range_max=30.0, clear_max=0.0, beyond=0.0):
    """Follow each beam in plain Python: cells that it passes, its range if it hits, its sensor."""
    for (x, y, yaw), row in zip(run[0], run[2], strict=True):
        for angle, r in zip(run[1] + yaw, row, strict=True):
            hit = r > 0 and range_min <= r < range_max
            if hit or (r >= range_max and clear_max > 0):
                reach = r + beyond if hit else min(clear_max, range_max)
                end = x + reach * math.cos(angle), y + reach * math.sin(angle)
                cells = line(cell_of(x, y, GRID["origin"]), cell_of(*end, GRID["origin"]))
                yield cells, (r if hit else None), (x, y)


@st.composite
def runs(draw):
    """Some scans in and around a small grid, of all kinds of readings."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scans, beams = draw(st.integers(1, 4)), draw(st.integers(1, 7))
    poses = np.column_stack([rng.uniform(-4, 7, (scans, 2)), rng.uniform(-7, 7, scans)])
    angles = np.sort(rng.uniform(-3, 3, beams))
    odd = [math.nan, math.inf, -1.0, 0.0, 40.0, 0.4, -math.inf]
    ranges = np.where(
        rng.random((scans, beams)) < 0.3, rng.choice(odd, (scans, beams)),
        rng.uniform(0.1, 9, (scans, beams)),
    )  # fmt: skip
    return poses, angles, ranges


def inside(cell):
    return 0 <= cell[0] < SHAPE[0] and 0 <= cell[1] < SHAPE[1]


@given(run=runs(), limits=LIMITS, ratio=st.sampled_from([0.0, 0.25, 0.3, 0.5]))
def test_counting_is_counting(each_engine, run, limits, ratio):
    built = build_map(*run, method="counting", ratio=ratio, **GRID, **limits)
    hits, misses = np.zeros((2, *SHAPE), dtype=int)
    for cells, r, _ in walk(run, **limits):
        for cell in filter(inside, cells[:-1]):
            misses[cell] += 1
        if r is not None and inside(cells[-1]):
            hits[cells[-1]] += 1
    np.testing.assert_array_equal(built.layers["hits"], hits)
    np.testing.assert_array_equal(built.layers["misses"], misses)
    for cell in np.ndindex(SHAPE):
        n = hits[cell] + misses[cell]
        expected = -1 if n == 0 else 100 if hits[cell] > ratio * n else 0
        assert built.grid.occupancy[cell] == expected


@given(run=runs(), limits=LIMITS, odds=ODDS)
def test_log_odds_are_added_and_clamped_beam_by_beam(each_engine, run, limits, odds):
    free, occ, least, most = odds
    options = {"log_free": free, "log_occ": occ, "log_min": least, "log_max": most, **limits}
    built = build_map(*run, **options, **GRID)
    as_values = build_map(*run, **options, values=True, **GRID)
    values, is_known = np.full(SHAPE, 50.0), np.zeros(SHAPE, bool)
    for cells, r, _ in walk(run, **limits):
        added = [(cell, free) for cell in cells[:-1]] + [(cells[-1], occ)] * (r is not None)
        for cell, change in added:
            if inside(cell):
                values[cell] = min(max(values[cell] + change, least), most)
                is_known[cell] = True
    np.testing.assert_allclose(built.layers["log_odds"][is_known], values[is_known], atol=2e-4)
    assert np.isnan(built.layers["log_odds"][~is_known]).all()
    exact = np.round(values, 3)
    expected = np.where(exact < 50, 0, np.where(exact > 50, 100, -1))
    np.testing.assert_array_equal(built.grid.occupancy, np.where(is_known, expected, -1))
    assert np.abs(as_values.grid.occupancy - np.where(is_known, values, -1)).max() <= 0.501


@given(run=runs(), limits=LIMITS, numbers=BEHIND)
def test_tsdf_is_the_mean_of_distances_along_the_beams(each_engine, run, limits, numbers):
    truncation, behind = numbers
    options = {"truncation": truncation, "truncation_behind": behind}
    built = build_map(*run, method="tsdf", **options, **GRID, **limits)
    sums, weights = np.zeros(SHAPE), np.zeros(SHAPE, int)
    origin_x, bottom = GRID["origin"]
    cut = truncation * RES
    for cells, r, sensor in walk(run, beyond=behind * cut, **limits):
        for row, col in filter(inside, cells):
            centre = (origin_x + (col + 0.5) * RES, bottom + (row + 0.5) * RES)
            share = 1.0 if r is None else (r - math.dist(centre, sensor)) / cut
            if share >= -behind:
                sums[row, col] += max(min(share, 1.0), -1.0)
                weights[row, col] += 1
    np.testing.assert_array_equal(built.layers["weight"], weights)
    field = built.layers["tsdf"]
    is_known = weights > 0
    np.testing.assert_allclose(field[is_known], sums[is_known] / weights[is_known], atol=2e-6)
    assert np.isnan(field[~is_known]).all()
    _check_surface(built, sums, weights)


def blocks_of(wall):
    return wall[1:, 1:] & wall[1:, :-1] & wall[:-1, 1:] & wall[:-1, :-1]


def _check_surface(built, sums, weights):
    """Walls separate both signs, except in blocks that thinning keeps; positive cells are free."""
    grid = built.grid.occupancy
    wall = grid == 100
    assert not blocks_of(wall).any()
    clear = np.abs(sums) > 1e-4 * np.maximum(weights, 1)
    np.testing.assert_array_equal((grid == 0)[clear], ((sums > 0) & ~wall)[clear])
    assert (weights[wall] > 0).all()
    sign = np.sign(sums) * (weights > 0)
    changes = (sign[1:] * sign[:-1] < 0).sum() + (sign[:, 1:] * sign[:, :-1] < 0).sum()
    zeros = ((sums == 0) & (weights > 0)).sum()
    unclear = (~clear & (weights > 0)).sum()  # cells whose sign is a matter of rounding
    assert abs(len(built.layers["surface"]) - int(changes) - int(zeros)) <= 4 * unclear


@pytest.mark.parametrize("clear_max", [0.0, 7.0])
def test_each_reading_is_counted_once(clear_max):
    ranges = [[1.0, 0.49, 0.5, 29.999, 30.0, math.inf, math.nan, -1.0, 0.0, -math.inf]]
    limits = evidence.BeamLimits(0.5, 30.0, clear_max)
    beams = evidence.beams_of(Scans([[0, 0, 0]], np.zeros(10), ranges), limits)
    counts = beams.counts
    assert (counts.beams, counts.hits, counts.no_return, counts.bad) == (10, 3, 2, 5)
    cleared = 2 * (clear_max > 0)
    assert beams.ranges.tolist() == [1.0, 0.5, 29.999] + [7.0] * cleared
    assert beams.is_hit.tolist() == [True] * 3 + [False] * cleared


def test_the_grid_holds_all_that_beams_reach_with_a_margin_of_two_cells():
    built = build_map([[1.1, -2.3, math.pi / 2]], [0.0, math.pi / 2], [[3.0, 2.0]], resolution=0.5)
    # the hits are at 1.1, 0.7 and at -0.9, -2.3
    assert built.grid.origin == (-2.0, -3.5, 0.0)
    assert built.grid.shape == (7 + 4, 5 + 4)
    # of a tsdf two cells more behind the hit, to 3.1, or 4.5 more, to 4.35
    for options, columns in (({}, 5), ({"truncation": 1.5, "truncation_behind": 3.0}, 7)):
        behind = build_map([[1.1, -2.3, 0.0]], [0.0], [[1.0]], resolution=0.5, **TSDF, **options)
        assert behind.grid.shape == (1 + 4, columns + 4)


def strip(length, poses, ranges, resolution=1.0, **options):
    """What beams along a strip of cells from the origin on make of it."""
    options |= {"resolution": resolution, "size": (length * resolution, resolution)}
    built = build_map(poses, np.zeros(len(ranges[0])), ranges, origin=(0, 0), **options)
    return built.grid.occupancy[0].tolist()


@pytest.mark.parametrize("method", METHODS)
def test_beams_too_far_to_be_followed_are_outside(method):
    poses = [[0.25, 0.25, 0.0], [9e10, 0.25, 0.0], [-1e11, -1e11, 0.0]]
    assert strip(4, poses, [[1.0]] * 3, 0.5, method=method)[:3] == [0, 0, 100]


@pytest.mark.parametrize(("hits", "expected"), [(63, 0), (64, 100)])
def test_a_share_of_hits_that_is_the_ratio_is_not_above_it(hits, expected):
    """63 of 180 is 0.35 exactly; 0.35 * 180 is 62.999999999999993."""
    ranges = [[1.0] * hits + [2.0] * (180 - hits)]
    assert strip(3, [[0.5, 0.5, 0.0]], ranges, method="counting", ratio=0.35)[1] == expected


def scanned(poses, angles, box, centre, radius):
    """A run in a box (x, y, x, y) with a round pillar in it, exact ranges."""
    ranges = np.empty((len(poses), len(angles)))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + angles), np.sin(yaw + angles)
        with np.errstate(divide="ignore"):
            walls = np.minimum(np.where(c > 0, box[2] - x, box[0] - x) / c,
                               np.where(s > 0, box[3] - y, box[1] - y) / s)  # fmt: skip
        along = (centre[0] - x) * c + (centre[1] - y) * s
        away = (centre[0] - x) ** 2 + (centre[1] - y) ** 2 - along**2
        reach = along - np.sqrt(np.maximum(radius**2 - away, 0))
        ranges[k] = np.where((away < radius**2) & (along > 0), reach, walls)
    return poses, angles, ranges


BOX, PILLAR = (0.03, 0.02, 6.02, 5.01), (4, 2.5)


def room(count):
    poses = np.random.default_rng(2).uniform((1, 1, -3), (2.4, 3.5, 3), (count, 3))
    return scanned(poses, np.radians(np.arange(-135, 135.5, 0.5)), BOX, PILLAR, 0.5)


@needs_compiled
@pytest.mark.parametrize(
    "options", [*({"method": method} for method in METHODS), {"method": "tsdf", "as_written": True}]
)
def test_engines_threads_and_parts_give_the_same_bytes(options):
    scans = room(6)

    def build_both_ways():
        built = build_map(*scans, **options)
        in_parts = added_in_parts(MapBuilder(built.grid.frame, **options), *scans).result()
        assert in_parts.counts == built.counts
        return [
            [layer.tobytes() for layer in (result.grid.occupancy, *result.layers.values())]
            for result in (built, in_parts)
        ]

    (first, same), *repeated = by_each_engine(build_both_ways, threads=(1, 3))
    assert same == first
    assert repeated == [[first, first]] * 2


def added_in_parts(builder, poses, angles, ranges):
    for k in range(0, len(poses), 2):
        builder.add(Scans(poses[k : k + 2], angles, ranges[k : k + 2]))
    return builder


def peer_run(real_maps, run, peer):
    """Scans, and a recorded map of 440 x 440 cells that others make of them."""
    with np.load(real_maps / "expected" / "peers.npz") as peers:
        names = ("poses", "angles", "ranges", peer)
        *scans, expected = (peers[f"mapping/{run}/{name}"] for name in names)
    return scans, expected


# their cell (20, 20) begins at the world's origin
OF_PEERS = {"size": (22, 22), "origin": (-1, -1)}


@pytest.mark.parametrize(("method", "peer"), [("log-odds", "logodds"), ("counting", "count")])
@pytest.mark.parametrize("run", ["0", "1"])
def test_an_independent_implementation_agrees(real_maps, run, method, peer):
    scans, expected = peer_run(real_maps, run, peer)
    found = build_map(*scans, method=method, **OF_PEERS)
    both = (found.grid.occupancy >= 0) & (expected >= 0)
    assert both.sum() > 20_000
    assert (found.grid.occupancy == expected)[both].mean() > 0.999


@st.composite
def hits_and_maps(draw):
    """Cells hit often, some of them occupied, and occupied cells elsewhere."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.tuples(st.integers(1, 14), st.integers(1, 17)))
    often = rng.random(shape) < draw(st.sampled_from([0.1, 0.25, 0.5]))
    occupied = rng.random(shape) < draw(st.sampled_from([0.0, 0.01, 0.05]))
    return often, occupied | often & (rng.random(shape) < draw(st.sampled_from([0.0, 0.1])))


def as_sets(groups):
    parts = np.split(groups.cells, np.cumsum(groups.sizes)[:-1]) if len(groups) else []
    return [{tuple(cell) for cell in part.tolist()} for part in parts]


def in_order(found):
    return sorted(found, key=lambda group: (-len(group), min(group)))


@given(hits_and_maps())
def test_groups_that_vanish_are_those_with_nothing_occupied_near_any_cell(drawn):
    often, occupied = drawn
    walls = np.argwhere(occupied).tolist()
    large = [group for group in oracles.groups(often) if len(group) >= 3]

    def is_near_a_wall(group):
        return any(max(abs(r - y), abs(c - x)) <= 2 for r, c in group for y, x in walls)

    lost = [group for group in large if not is_near_a_wall(group)]
    assert as_sets(evidence.hit_groups(often)) == in_order(large)
    assert as_sets(evidence.vanished_groups(often, occupied)) == in_order(lost)


def test_middles_are_in_the_map_frame():
    groups = evidence.hit_groups(drawn_cells("..##\n..#.\n....") == 100)
    frame = Frame(3, 4, 0.25, (1.5, -2.0, 0.4))
    centres = [(2.5, 2.5), (3.5, 2.5), (2.5, 1.5)]  # column and row of the cells' centres
    x, y = np.mean(centres, axis=0) * 0.25
    expected = [1.5 + x * np.cos(0.4) - y * np.sin(0.4), -2.0 + x * np.sin(0.4) + y * np.cos(0.4)]
    np.testing.assert_allclose(groups.middles_xy(frame), [expected], atol=1e-12)
    assert evidence.hit_groups(np.zeros((2, 3), dtype=bool)).middles_xy(frame).shape == (0, 2)


AROUND_POLE = {"resolution": 0.5, "size": (6, 4.5), "origin": (-0.5, 0.25)}
FAR_WALL = 5.4


def pole(hits, passes):
    """A pole three cells long, hit from the left by few of the beams that go by to a wall."""
    poses = [[-0.25, 1.5 + 0.5 * k, 0.0] for k in range(3)] * (hits + passes)
    ranges = [[2.0]] * (3 * hits) + [[FAR_WALL]] * (3 * passes)
    return np.array(poses), np.zeros(1), np.array(ranges)


@pytest.mark.parametrize("method", METHODS)
def test_a_pole_that_most_beams_pass_vanishes_with_a_warning(method):
    built = build_map(*pole(3, 9), method=method, **AROUND_POLE)
    assert built.vanished.sizes.tolist() == [3]
    # x -0.25 + 2 m and y 1.5, 2 and 2.5
    assert built.vanished.cells.tolist() == [[2, 4], [3, 4], [4, 4]]
    for hits, passes in ((2, 9), (9, 3)):  # few hits, and a map that has it
        built = build_map(*pole(hits, passes), method=method, **AROUND_POLE)
        assert len(built.vanished) == 0


@pytest.mark.parametrize(("hits", "passes"), [(3, 9), (3, 7), (4, 396)])
def test_the_ratio_that_is_advised_keeps_the_groups_and_is_the_largest_percent(hits, passes):
    frame = frame_of(AROUND_POLE["size"], AROUND_POLE["origin"], AROUND_POLE["resolution"])
    builder = added_in_parts(MapBuilder(frame, "counting"), *pole(hits, passes))
    advice = builder.advice(builder.result().vanished)
    assert advice.startswith("--ratio ")
    assert advice.endswith(" keeps it")
    ratio = float(advice.split()[1])
    on_map, lost = (
        build_map(*pole(hits, passes), method="counting", ratio=r, **AROUND_POLE).vanished
        for r in (ratio, ratio + 0.01)
    )
    assert (len(on_map), len(lost)) == (0, 1)


def legs(diameter, noise):
    around = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    poses = np.column_stack([1.3 * np.cos(around), 1.1 * np.sin(around), around + math.pi])
    # those that pass by the leg
    angles, box = np.radians(np.arange(-30, 30.5, 0.5)), (-2.03, -2.04, 2.02, 2.01)
    *run, ranges = scanned(poses, angles, box, (0.013, 0.017), diameter / 2)
    return *run, ranges + np.random.default_rng(5).normal(0, noise, ranges.shape)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("diameter", "noise"), [(0.04, 0.0), (0.04, 0.01), (0.1, 0.01)])
def test_no_method_takes_a_thin_leg_for_free_space(method, diameter, noise):
    grid = build_map(*legs(diameter, noise), method=method).grid
    ((row, col),) = grid.frame.unbounded_rowcol_from_xy([[0.013, 0.017]]).tolist()
    wall = grid.occupied()
    assert wall[row - 1 : row + 2, col - 1 : col + 2].any()
    if method == "tsdf":
        assert not blocks_of(wall).any()


def test_the_surface_of_a_tsdf_is_found_in_parts_of_cells():
    x, y = build_map(*room(15), method="tsdf").layers["surface"].T
    walls = np.min([x - BOX[0], BOX[2] - x, y - BOX[1], BOX[3] - y], axis=0)
    off = np.abs(np.minimum(walls, np.hypot(x - PILLAR[0], y - PILLAR[1]) - 0.5))
    assert np.median(off) < 0.004  # a twelfth of a cell
    assert np.quantile(off, 0.9) < 0.03


DIRECTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # of a cell (row, col): along x first


def listed(poses, angles, ranges, shape, origin):
    """The walls, the mean distances and their counts, beam by beam and cell by cell."""
    means, counts = np.zeros(shape), np.zeros(shape, int)

    def cell_at(x, y, angle, reach):
        return cell_of(x + reach * math.cos(angle), y + reach * math.sin(angle), origin)

    def holds(cell):
        return 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1]

    for (x, y, yaw), row in zip(poses, ranges, strict=True):
        for angle, r in zip(angles, row, strict=True):
            if not 0 < r < 30 or not holds(hit := cell_at(x, y, yaw + angle, r)):
                continue
            cut, sensor = 2 * RES, cell_at(x, y, 0.0, 0.0)
            far = cell_at(x, y, yaw + angle, r + 3 * cut)
            for cell in filter(holds, line(sensor, far if holds(far) else hit)[:-1]):
                away = math.sqrt((cell[1] - sensor[1]) ** 2 + (cell[0] - sensor[0]) ** 2)
                share = max(-1.0, min(1.0, (r - away * RES) / cut))
                means[cell] = (counts[cell] * means[cell] + share) / (counts[cell] + 1)
                counts[cell] += 1
    return searched(means), means, counts


def searched(means):
    """The walls that a search through the neighbours finds; its first cell is not marked."""
    walls, visited = np.zeros((2, *means.shape), bool)
    queue = deque([(0, 0)])
    while queue:
        node = queue.popleft()
        for down, right in DIRECTIONS:
            cell = node[0] + down, node[1] + right
            if min(cell) < 0 or cell[0] >= means.shape[0] or cell[1] >= means.shape[1]:
                continue
            if not visited[cell]:
                if means[cell] * means[node] < 0:
                    walls[cell if abs(means[cell]) < abs(means[node]) else node] = True
                visited[cell] = True
                queue.append(cell)
    return walls


@st.composite
def runs_along_axes(draw):
    """Scans in and around a small grid along its axes, so that values are equal."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scans, beams = draw(st.integers(1, 5)), draw(st.integers(1, 9))
    quarters, at = rng.integers(0, 4, scans), rng.integers(-4, 16, (scans, 2))
    poses = np.column_stack([at * RES, quarters * math.pi / 2])
    ranges = rng.integers(1, 14, (scans, beams)) * RES / 2
    ranges[rng.random(ranges.shape) < 0.1] = math.nan
    return poses, rng.integers(0, 4, beams) * math.pi / 2, ranges


@given(run=runs() | runs_along_axes(), shape=SHAPES)
def test_maps_and_layers_are_those_of_the_listing(run, shape):
    place = {"resolution": RES, "size": (shape[1] * RES, shape[0] * RES), "origin": (-0.5, 0.75)}
    built = build_map(*run, as_written=True, **TSDF, **place)
    walls, means, counts = listed(*run, shape, place["origin"])
    np.testing.assert_array_equal(built.layers["weight"], counts)
    expected = np.where(counts > 0, means, np.nan).astype(np.float32)
    np.testing.assert_array_equal(built.layers["tsdf"], expected)
    np.testing.assert_array_equal(built.grid.occupancy, np.where(walls, 100, -1))


@pytest.mark.parametrize("run", ["0", "1"])
def test_an_independent_implementation_of_the_listing_agrees(real_maps, run):
    """It compares all neighbours, and its line is another one."""
    scans, expected = peer_run(real_maps, run, "tsdf")
    built = build_map(*scans, method="tsdf", as_written=True, **OF_PEERS)
    field = np.nan_to_num(built.layers["tsdf"])
    walls = np.zeros(field.shape, bool)
    for lower, upper in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        changes = field[lower] * field[upper] < 0
        is_upper = np.abs(field[upper]) < np.abs(field[lower])
        walls[upper] |= changes & is_upper
        walls[lower] |= changes & ~is_upper
    assert np.count_nonzero(walls != (expected == 100)) <= 45 < 0.05 * walls.sum()
    assert set(np.unique(expected)) == set(np.unique(built.grid.occupancy)) == {-1, 100}
    assert not ((built.grid.occupancy == 100) & ~walls).any()


@st.composite
def fields(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    field = rng.uniform(-1, 1, shape).round(1)
    if draw(st.booleans()):  # smooth, as fields of scans are
        rows, cols = np.indices(shape)
        field = (rows * rng.uniform(-1, 1) + cols * rng.uniform(-1, 1) + rng.uniform(-4, 4)) / 4
    field[rng.random(shape) < draw(st.sampled_from([0.0, 0.3]))] = np.nan
    return field


def pairs(field):
    """Neighbours of different sign, as pairs of cells."""
    for down, right in DIRECTIONS[:2]:
        first, second = field[: len(field) - down, : field.shape[1] - right], field[down:, right:]
        for row, col in np.argwhere(first * second < 0).tolist():
            yield (row, col), (row + down, col + right)


@given(field=fields())
def test_places_are_where_a_line_between_two_cells_is_zero(field):
    expected = [(row + 0.5, col + 0.5) for (row, col), v in np.ndenumerate(field) if v == 0]
    for a, b in pairs(field):
        share = field[a] / (field[a] - field[b])
        expected.append(tuple(p + 0.5 + share * (q - p) for p, q in zip(a, b, strict=True)))
    found = evidence.crossings_of(field).places()
    assert len(found) == len(expected)
    if expected:  # in whatever order: sums that round otherwise would sort otherwise
        apart = np.abs(found[:, np.newaxis] - np.array(expected)).max(axis=2) > 1e-12
        assert not apart.all(axis=0).any()
        assert not apart.all(axis=1).any()


@given(field=fields())
def test_a_surface_is_made_of_the_nearer_cells_and_has_no_gap(field):
    """All cells that are nearer to zero than a neighbour of the other sign, but for spare ones."""
    nearer = field == 0
    for a, b in pairs(field):
        nearer[min((a, b), key=lambda cell: (abs(field[cell]), field[cell]))] = True
    found = evidence.thin_surface(field, evidence.crossings_of(field))
    assert not (found & ~nearer).any()
    in_block = np.zeros(field.shape, bool)
    for row, col in np.argwhere(blocks_of(nearer)).tolist():
        in_block[row : row + 2, col : col + 2] = True
    for a, b in pairs(field):  # no gap, but where blocks were thinned
        assert found[a] or found[b] or in_block[a] or in_block[b]
    assert found.any() == nearer.any()
    assert found[field == 0].sum() >= (field == 0).sum() - in_block.sum()


@given(seed=st.integers(0, 2**32 - 1), density=st.sampled_from([0.3, 0.5, 0.7, 0.9]))
def test_thinned_blocks_are_as_connected_as_before(seed, density):
    rng = np.random.default_rng(seed)
    before = rng.random((8, 9)) < density
    after = before.copy()
    evidence.thin_blocks(after, rng.random(before.shape))
    assert not (after & ~before).any()
    walls = [len(list(oracles.groups(mask))) for mask in (before, after)]
    assert walls[0] == walls[1]
    # and open areas stay separate: no rooms merge, with the outside as one of them
    opened = [np.pad(~mask, 1, constant_values=True) for mask in (before, after)]
    rooms = [len(list(oracles.groups(mask, oracles.EDGES))) for mask in opened]
    assert rooms[0] == rooms[1]


def test_spare_cells_are_left_out_the_farthest_from_zero_on_any_side_of_its_partners():
    block = np.ones((2, 2), bool)
    evidence.thin_blocks(block, np.array([[0.1, 0.4], [0.2, 0.3]]))
    assert block.tolist() == [[True, False], [True, True]]
    row = np.array([[0.1, -0.2, 0.3]])
    for field in (row, row[:, ::-1], row.T, row.T[::-1]):
        found = evidence.thin_surface(field, evidence.crossings_of(field))
        assert np.array_equal(found, field == -0.2)


NAN, INF, HUGE = math.nan, math.inf, 10**400
COUNTING = {"method": "counting"}


def each(name, *values, **more):
    """Return options with each of some values, which are refused with the option's name."""
    return [({**more, name: value}, name) for value in values]


@pytest.mark.parametrize(("options", "message"), [
    *each("method", "voting"), *each("ratio", 0.5), *each("ratio", 1.0, NAN, "x", **COUNTING),
    *each("log_free", 0.0, -1e308, HUGE), *each("log_occ", -1.0, 1e308, INF, "x"),
    *each("log_min", 49.999999), ({"log_min": 80.0, "log_max": 20.0}, "log_min"),
    *each("log_max", 101.0, 50.000001), *each("truncation", None, 0.5, NAN, **TSDF),
    ({**TSDF, "truncation_behind": 0.4}, "truncation_behind: must be 0.5 to 500 trunc"),
    *each("truncation_behind", 501, NAN, "x", **TSDF), *each("truncation_behind", 3, **COUNTING),
    ({**COUNTING, "as_written": True}, "as_written: does not apply to method counting"),
    *each("range_min", -1.0), *each("range_max", 0.0, "x", HUGE),
    *each("range_max", 2.0, range_min=3.0), *each("clear_max", INF), *each("resolution", 0.0),
    *each("size", (1.0, 1.0)), *each("size", (0.0, 1.0), (1.0, -1.0), origin=(0, 0)),
    ({"size": (1e5, 1e5), "origin": (0, 0)}, "cells"),
])  # fmt: skip
def test_options_of_built_maps_that_cannot_be_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        build_map([[0.0, 0.0, 0.0]], [0.0], [[1.0]], **options)


@pytest.mark.parametrize(("poses", "angles", "ranges", "error", "message"), [
    ([[0, 0]], [0], [[1]], ParameterError, "poses"),
    ([[0, 0, NAN]], [0], [[1]], ParameterError, "poses"),
    ([[0, 0, 0]], [[0]], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], [INF], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], ["a"], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], [0], [[1, 2]], ParameterError, "ranges"),
    ([[0, 0, 0], [0, 0, 0]], [0, 1], [[1, 2], [3]], ParameterError, "ranges"),
    ([[0, 0, 0], [1e7, 0, 0]], [0, 1], np.ones((2, 2)), MalformedInputError, "too far for a m"),
    ([[0, 0, 0]], [0.0, 0.1], [[NAN, 50.0]], MalformedInputError, "no beam hits"),
])  # fmt: skip
def test_scans_that_do_not_fit_or_make_no_map_are_refused(poses, angles, ranges, error, message):
    with pytest.raises(error, match=message):
        build_map(poses, angles, ranges)


@pytest.mark.parametrize(("options", "message"), [
    *each("frame", "odom"), *each("offset", (1.0, NAN)), *each("resolution", 0.0),
    *each("size", (0.0, 1.0), (1.0, INF), (1e6, 1e6)), *each("min_range", -1.0),
    *each("max_range", NAN), *each("min_height", 2.0, max_height=1.0),
    ({"max_height": 1.0}, "heights"), *each("unknown", "occupied"), *each("raytrace_range", -0.1),
    *each("pose", (0, 0), (0, 0, NAN), (INF, 0, 0), (1e13, 0, 0), "abc"),
    *each("points", [1.0, 2.0], [[1.0]], np.zeros((2, 2, 2))),
    ({"angle_min": 0.3}, "must both be given, and differ"),
])  # fmt: skip
def test_options_of_local_maps_that_cannot_be_are_refused(options, message):
    arguments = {"points": [[1.0, 2.0]], "pose": (0.0, 0.0, 0.0), **options}
    with pytest.raises(ParameterError, match=message):
        mapdeal.local_map(arguments.pop("points"), arguments.pop("pose"), **arguments)


def test_rolling_maps_keep_some_clouds_and_have_a_pose_for_each():
    with pytest.raises(ParameterError, match="keep"):
        mapdeal.RollingMapper([[0, 0, 0]], mapdeal.LocalOptions(), keep=0)
    mapper = mapdeal.RollingMapper([[0, 0, 0]], mapdeal.LocalOptions())
    mapper.add([[1.0, 0.0]])
    with pytest.raises(ParameterError, match="a pose for each cloud"):
        mapper.add([[1.0, 0.0]])
