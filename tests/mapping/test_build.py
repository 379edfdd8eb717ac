import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import cells as drawn_cells
from engines import needs_compiled
from mapdeal import MapBuilder, Scans, build_map
from mapdeal.grid.frame import Frame
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.build import frame_of
from mapdeal.mapping.evidence import BeamLimits, beams_of, hit_groups, vanished_groups
from oracles import line

RES = 0.25


def cell_of(x, y, origin, resolution=RES):
    return (math.floor((y - origin[1]) / resolution + 1e-9),
            math.floor((x - origin[0]) / resolution + 1e-9))  # fmt: skip


def walk(
    poses, angles, ranges, origin, *, range_min=0.0, range_max=30.0, clear_max=0.0, beyond=0.0
):
    """Follow each beam in plain Python: cells that it passes, and the cell that it hits or None."""
    for (x, y, yaw), row in zip(poses, ranges, strict=True):
        for angle, r in zip(angles, row, strict=True):
            hit = r > 0 and range_min <= r < range_max
            if not hit and not (r >= range_max and clear_max > 0):
                continue
            reach = r + beyond if hit else clear_max
            end = cell_of(
                x + reach * math.cos(yaw + angle), y + reach * math.sin(yaw + angle), origin
            )
            cells = line(cell_of(x, y, origin), end)
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


GRID = {"resolution": RES, "size": (2.75, 2.0), "origin": (-0.5, 1.25)}
SHAPE = (8, 11)


def inside(cell):
    return 0 <= cell[0] < SHAPE[0] and 0 <= cell[1] < SHAPE[1]


LIMITS = st.sampled_from(
    [{}, {"range_min": 0.5}, {"clear_max": 3.0}, {"range_max": 5.0, "clear_max": 2}]
)


ODDS = st.sampled_from(
    [(-1, 2, 0, 100), (-30, 40, 10, 90), (-0.4, 0.85, 0, 100), (-50, 50, 0, 100)]
)


@given(run=runs(), limits=LIMITS, ratio=st.sampled_from([0.0, 0.25, 0.3, 0.5]))
def test_counting_is_counting(each_engine, run, limits, ratio):
    built = build_map(*run, method="counting", ratio=ratio, **GRID, **limits)
    hits, misses = np.zeros((2, *SHAPE), dtype=int)
    for cells, r, _ in walk(*run, GRID["origin"], **limits):
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
    names = ("log_free", "log_occ", "log_min", "log_max")
    options = dict(zip(names, odds, strict=True))
    built = build_map(*run, **options, **GRID, **limits)
    as_values = build_map(*run, **options, values=True, **GRID, **limits)
    free, occ, least, most = odds
    values, seen = np.full(SHAPE, 50.0), np.zeros(SHAPE, bool)
    for cells, r, _ in walk(*run, GRID["origin"], **limits):
        added = [(cell, free) for cell in cells[:-1]] + [(cells[-1], occ)] * (r is not None)
        for cell, change in added:
            if inside(cell):
                values[cell] = min(max(values[cell] + change, least), most)
                seen[cell] = True
    np.testing.assert_allclose(built.layers["log_odds"][seen], values[seen], atol=2e-4)
    assert np.isnan(built.layers["log_odds"][~seen]).all()
    exact = np.round(values, 3)
    expected = np.where(exact < 50, 0, np.where(exact > 50, 100, -1))
    np.testing.assert_array_equal(built.grid.occupancy, np.where(seen, expected, -1))
    off = np.abs(as_values.grid.occupancy - np.where(seen, values, -1))
    assert off.max() <= 0.501


BEHIND = st.sampled_from([(1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (2.0, 0.5), (3.5, 0.4), (1.0, 2.6)])


@given(run=runs(), limits=LIMITS, numbers=BEHIND)
def test_tsdf_is_the_mean_of_distances_along_the_beams(each_engine, run, limits, numbers):
    truncation, behind = numbers
    options = {"truncation": truncation, "truncation_behind": behind}
    built = build_map(*run, method="tsdf", **options, **GRID, **limits)
    sums, weights = np.zeros(SHAPE), np.zeros(SHAPE, int)
    left, bottom = GRID["origin"]
    cut = truncation * RES
    for cells, r, sensor in walk(*run, GRID["origin"], beyond=behind * cut, **limits):
        for row, col in filter(inside, cells):
            centre = (left + (col + 0.5) * RES, bottom + (row + 0.5) * RES)
            share = 1.0 if r is None else (r - math.dist(centre, sensor)) / cut
            if share >= -behind:
                sums[row, col] += max(min(share, 1.0), -1.0)
                weights[row, col] += 1
    np.testing.assert_array_equal(built.layers["weight"], weights)
    field = built.layers["tsdf"]
    seen = weights > 0
    np.testing.assert_allclose(field[seen], sums[seen] / weights[seen], atol=2e-6)
    assert np.isnan(field[~seen]).all()
    _check_surface(built, sums, weights)


def _check_surface(built, sums, weights):
    """Walls part both signs, but where thinning has let a block be; free is what is positive."""
    grid = built.grid.occupancy
    wall = grid == 100
    assert not (wall[1:, 1:] & wall[1:, :-1] & wall[:-1, 1:] & wall[:-1, :-1]).any()
    clear = np.abs(sums) > 1e-4 * np.maximum(weights, 1)
    np.testing.assert_array_equal((grid == 0)[clear], ((sums > 0) & ~wall)[clear])
    assert (weights[wall] > 0).all()
    sign = np.sign(sums) * (weights > 0)
    changes = (sign[1:] * sign[:-1] < 0).sum() + (sign[:, 1:] * sign[:, :-1] < 0).sum()
    zeros = ((sums == 0) & (weights > 0)).sum()
    unclear = (~clear & (weights > 0)).sum()  # cells whose sign is a matter of rounding
    assert abs(len(built.layers["surface"]) - int(changes) - int(zeros)) <= 4 * unclear


def test_each_reading_is_counted_once_s8():
    ranges = [[1.0, 0.49, 0.5, 29.999, 30.0, math.inf, math.nan, -1.0, 0.0, -math.inf]]
    beams = beams_of(Scans([[0, 0, 0]], np.zeros(10), ranges), BeamLimits(range_min=0.5))
    counts = beams.counts
    assert (counts.beams, counts.hits, counts.no_return, counts.bad) == (10, 3, 2, 5)
    assert beams.ranges.tolist() == [1.0, 0.5, 29.999]
    cleared = beams_of(Scans([[0, 0, 0]], np.zeros(10), ranges), BeamLimits(0.5, 30.0, 7.0))
    assert cleared.ranges.tolist() == [1.0, 0.5, 29.999, 7.0, 7.0]
    assert cleared.is_hit.tolist() == [True] * 3 + [False] * 2
    assert cleared.counts == counts


def test_the_grid_holds_all_that_beams_reach_with_a_margin_of_two_cells():
    built = build_map([[1.1, -2.3, math.pi / 2]], [0.0, math.pi / 2], [[3.0, 2.0]], resolution=0.5)
    # the hits are at 1.1, 0.7 and at -0.9, -2.3
    assert built.grid.origin == (-2.0, -3.5, 0.0)
    assert built.grid.shape == (7 + 4, 5 + 4)
    behind = build_map([[1.1, -2.3, 0.0]], [0.0], [[1.0]], resolution=0.5, method="tsdf")
    assert behind.grid.shape == (1 + 4, 5 + 4)  # two cells more behind the hit, to 3.1
    behind = build_map([[1.1, -2.3, 0.0]], [0.0], [[1.0]], resolution=0.5, method="tsdf",
                       truncation=1.5, truncation_behind=3.0)  # fmt: skip
    assert behind.grid.shape == (1 + 4, 7 + 4)  # 4.5 cells more, to 4.35


def test_beams_too_far_to_be_followed_are_outside():
    poses = [[0.25, 0.25, 0.0], [9e10, 0.25, 0.0], [-1e11, -1e11, 0.0]]
    for method in ("log-odds", "counting", "tsdf"):
        built = build_map(poses, [0.0], [[1.0]] * 3, resolution=0.5, size=(2, 0.5), origin=(0, 0),
                          method=method)  # fmt: skip
        assert built.counts.hits == 3
        assert built.grid.occupancy.tolist()[0][:3] == [0, 0, 100]


def test_clearing_ends_at_range_max():
    built = build_map([[0.5, 0.5, 0.0]], [0.0], [[35.0]], range_max=4.0, clear_max=80.0,
                      resolution=1.0, size=(8, 1), origin=(0, 0))  # fmt: skip
    assert built.grid.occupancy.tolist() == [[0] * 4 + [-1] * 4]


def test_a_share_of_hits_that_is_the_ratio_is_not_above_it():
    """63 of 180 is 0.35 exactly; 0.35 * 180 is 62.999999999999993."""
    poses = np.array([[0.5, 0.5, 0.0]])
    for hits, expected in ((63, 0), (64, 100)):
        ranges = np.array([[1.0] * hits + [2.0] * (180 - hits)])
        built = build_map(poses, np.zeros(180), ranges, method="counting", ratio=0.35,
                          resolution=1.0, size=(3, 1), origin=(0, 0))  # fmt: skip
        assert built.grid.occupancy[0, 1] == expected


def room(count=40):
    """A run in a rectangular room with a pillar, exact ranges; and whether a point is solid."""
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(1, 2.4, count), rng.uniform(1, 3.5, count),
                             rng.uniform(-3, 3, count)])  # fmt: skip
    angles = np.radians(np.arange(-135, 135.5, 0.5))
    ranges = np.empty((count, len(angles)))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + angles), np.sin(yaw + angles)
        with np.errstate(divide="ignore"):
            walls = np.minimum(np.where(c > 0, (6.02 - x) / c, (0.03 - x) / c),
                               np.where(s > 0, (5.01 - y) / s, (0.02 - y) / s))  # fmt: skip
        along = (4 - x) * c + (2.5 - y) * s
        away = (4 - x) ** 2 + (2.5 - y) ** 2 - along**2
        with np.errstate(invalid="ignore"):
            pillar = np.where((away < 0.25) & (along > 0), along - np.sqrt(0.25 - away), np.inf)
        ranges[k] = np.minimum(walls, pillar)
    return poses, angles, ranges


@needs_compiled
@pytest.mark.parametrize("method", ["log-odds", "counting", "tsdf"])
def test_both_engines_and_any_threads_give_the_same_bytes(method, monkeypatch):
    found = []
    for engine, threads in (("compiled", 1), ("compiled", 2), ("scipy", 1)):
        monkeypatch.setenv("MAPDEAL_KERNELS", engine)
        with use_threads(threads):
            built = build_map(*room(6), method=method)
        found.append(
            [built.grid.occupancy.tobytes(), *(v.tobytes() for v in built.layers.values())]
        )
    assert found[0] == found[1] == found[2]


def test_scans_may_come_in_parts():
    poses, angles, ranges = room(6)
    whole = build_map(poses, angles, ranges)
    builder = MapBuilder(whole.grid.frame)
    for k in range(0, 6, 2):
        builder.add(Scans(poses[k : k + 2], angles, ranges[k : k + 2]))
    assert np.array_equal(builder.result().grid.occupancy, whole.grid.occupancy)
    assert builder.result().counts == whole.counts


@pytest.mark.parametrize(("method", "peer"), [("log-odds", "logodds"), ("counting", "count")])
@pytest.mark.parametrize("run", ["0", "1"])
def test_an_independent_implementation_agrees(real_maps, run, method, peer):
    """Recorded maps of 440 x 440 cells, whose cell (20, 20) begins at the world's origin."""
    with np.load(real_maps / "expected" / "peers.npz") as peers:
        poses, angles, ranges, expected = (
            peers[f"mapping/{run}/{name}"] for name in ("poses", "angles", "ranges", peer)
        )
    found = build_map(poses, angles, ranges, method=method, size=(22, 22), origin=(-1, -1))
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
    lost = [
        group
        for group in large
        if all(max(abs(r - y), abs(c - x)) > 2 for r, c in group for y, x in walls)
    ]
    assert as_sets(hit_groups(often)) == in_order(large)
    assert as_sets(vanished_groups(often, occupied)) == in_order(lost)


def test_middles_are_in_the_map_frame():
    groups = hit_groups(drawn_cells("..##\n..#.\n....") == 100)
    frame = Frame(3, 4, 0.25, (1.5, -2.0, 0.4))
    centres = [(2.5, 2.5), (3.5, 2.5), (2.5, 1.5)]  # column and row of the cells' centres
    x, y = np.mean(centres, axis=0) * 0.25
    expected = [1.5 + x * np.cos(0.4) - y * np.sin(0.4), -2.0 + x * np.sin(0.4) + y * np.cos(0.4)]
    np.testing.assert_allclose(groups.middles_xy(frame), [expected], atol=1e-12)
    assert hit_groups(np.zeros((2, 3), dtype=bool)).middles_xy(frame).shape == (0, 2)


AROUND_POLE = {"resolution": 0.5, "size": (6, 4.5), "origin": (-0.5, 0.25)}
FAR_WALL = 5.4


def pole(hits, passes):
    """A pole three cells long, hit from the left by few of the beams that go by to a wall."""
    poses = [[-0.25, 1.5 + 0.5 * k, 0.0] for k in range(3)] * (hits + passes)
    ranges = [[2.0]] * (3 * hits) + [[FAR_WALL]] * (3 * passes)
    return np.array(poses), np.zeros(1), np.array(ranges)


@pytest.mark.parametrize("method", ["log-odds", "counting", "tsdf"])
def test_a_pole_that_is_mostly_seen_through_vanishes_and_is_told(method):
    built = build_map(*pole(3, 9), method=method, **AROUND_POLE)
    assert built.vanished.sizes.tolist() == [3]
    # x -0.25 + 2 m and y 1.5, 2 and 2.5
    assert built.vanished.cells.tolist() == [[2, 4], [3, 4], [4, 4]]
    # two hits are not three
    assert len(build_map(*pole(2, 9), method=method, **AROUND_POLE).vanished) == 0
    # and a map that has it has not lost it
    assert len(build_map(*pole(9, 3), method=method, **AROUND_POLE).vanished) == 0


def test_the_values_of_log_odds_lose_nothing():
    assert len(build_map(*pole(3, 9), values=True, **AROUND_POLE).vanished) == 0


def test_hits_are_counted_over_all_parts_of_a_run():
    poses, angles, ranges = pole(3, 9)
    builder = MapBuilder(build_map(poses, angles, ranges, **AROUND_POLE).grid.frame)
    for k in range(len(poses)):
        builder.add(Scans(poses[k : k + 1], angles, ranges[k : k + 1]))
    assert builder.result().vanished.sizes.tolist() == [3]


@pytest.mark.parametrize(("hits", "passes"), [(3, 9), (3, 7), (4, 396)])
def test_the_ratio_that_is_advised_keeps_the_groups_and_is_the_largest_percent(hits, passes):
    frame = frame_of(AROUND_POLE["size"], AROUND_POLE["origin"], AROUND_POLE["resolution"])
    builder = MapBuilder(frame, "counting")
    builder.add(Scans(*pole(hits, passes)))
    advice = builder.advice(builder.result().vanished)
    assert advice.startswith("--ratio ")
    assert advice.endswith(" keeps it")
    ratio = float(advice.split()[1])
    kept, lost = (
        build_map(*pole(hits, passes), method="counting", ratio=r, **AROUND_POLE).vanished
        for r in (ratio, ratio + 0.01)
    )
    assert (len(kept), len(lost)) == (0, 1)


def legs(diameter, noise=0.0):
    """Scans from all around of a room with a round leg in its middle."""
    rng = np.random.default_rng(5)
    around = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    poses = np.column_stack([1.3 * np.cos(around), 1.1 * np.sin(around), around + math.pi])
    angles = np.radians(np.arange(-90, 90.5, 0.5))
    centre, radius = np.array([0.013, 0.017]), diameter / 2
    ranges = np.empty((len(poses), len(angles)))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + angles), np.sin(yaw + angles)
        with np.errstate(divide="ignore"):
            walls = np.minimum(np.where(c > 0, 2.02 - x, -2.03 - x) / c,
                               np.where(s > 0, 2.01 - y, -2.04 - y) / s)  # fmt: skip
        along = (centre[0] - x) * c + (centre[1] - y) * s
        away = (centre[0] - x) ** 2 + (centre[1] - y) ** 2 - along**2
        reach = along - np.sqrt(np.maximum(radius**2 - away, 0))
        ranges[k] = np.where((away < radius**2) & (along > 0), reach, walls)
    return poses, angles, ranges + rng.normal(0, noise, ranges.shape)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("diameter", [0.04, 0.1])
def test_no_method_takes_a_thin_leg_for_free_space(diameter, noise):
    for method in ("log-odds", "counting", "tsdf"):
        built = build_map(*legs(diameter, noise), method=method)
        (cell,) = built.grid.frame.unbounded_rowcol_from_xy([[0.013, 0.017]])
        row, col = cell.tolist()
        assert built.grid.occupied()[row - 1 : row + 2, col - 1 : col + 2].any(), method
    wall = built.grid.occupied()
    assert not (wall[1:, 1:] & wall[1:, :-1] & wall[:-1, 1:] & wall[:-1, :-1]).any()


def distance_to_walls(points):
    """Of points to the nearest surface of the room, metres, positive in the open."""
    x, y = points.T
    box = np.minimum(np.minimum(x - 0.03, 6.02 - x), np.minimum(y - 0.02, 5.01 - y))
    return np.minimum(box, np.hypot(x - 4, y - 2.5) - 0.5)


def test_the_surface_of_a_tsdf_is_found_in_parts_of_cells():
    surface = build_map(*room(), method="tsdf").layers["surface"]
    off = np.abs(distance_to_walls(surface))
    assert np.median(off) < 0.004  # a twelfth of a cell
    assert np.quantile(off, 0.9) < 0.03
