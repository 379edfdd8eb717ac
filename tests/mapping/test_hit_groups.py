import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import cells
from mapdeal import MapBuilder, Scans, build_map
from mapdeal.grid.frame import Frame
from mapdeal.mapping.build import frame_of
from mapdeal.mapping.evidence import hit_groups, vanished_groups


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


def test_one_occupied_cell_near_one_end_keeps_the_whole_group():
    often = cells("""
        .........####
        .########....
        .............
        .............
        .............
    """)
    near = cells("""
        .............
        .............
        ............#
        .............
        .............
    """)
    beyond = np.roll(near, -1, axis=0)  # a row farther south
    assert len(vanished_groups(often == 100, near == 100)) == 0
    assert vanished_groups(often == 100, beyond == 100).sizes.tolist() == [12]


def test_middles_are_in_the_map_frame():
    groups = hit_groups(cells("..##\n..#.\n....") == 100)
    frame = Frame(3, 4, 0.25, (1.5, -2.0, 0.4))
    centres = [(2.5, 2.5), (3.5, 2.5), (2.5, 1.5)]  # column and row of the cells' centres
    x, y = np.mean(centres, axis=0) * 0.25
    expected = [1.5 + x * np.cos(0.4) - y * np.sin(0.4), -2.0 + x * np.sin(0.4) + y * np.cos(0.4)]
    np.testing.assert_allclose(groups.middles_xy(frame), [expected], atol=1e-12)
    assert hit_groups(np.zeros((2, 3), dtype=bool)).middles_xy(frame).shape == (0, 2)


GRID = {"resolution": 0.5, "size": (6, 4.5), "origin": (-0.5, 0.25)}
FAR_WALL = 5.4


def pole(hits, passes):
    """A pole three cells long, hit from the left by few of the beams that go by to a wall."""
    poses = [[-0.25, 1.5 + 0.5 * k, 0.0] for k in range(3)] * (hits + passes)
    ranges = [[2.0]] * (3 * hits) + [[FAR_WALL]] * (3 * passes)
    return np.array(poses), np.zeros(1), np.array(ranges)


@pytest.mark.parametrize("method", ["log-odds", "counting", "tsdf"])
def test_a_pole_that_is_mostly_seen_through_vanishes_and_is_told(method):
    built = build_map(*pole(3, 9), method=method, **GRID)
    assert built.vanished.sizes.tolist() == [3]
    # x -0.25 + 2 m and y 1.5, 2 and 2.5
    assert built.vanished.cells.tolist() == [[2, 4], [3, 4], [4, 4]]
    # two hits are not three
    assert len(build_map(*pole(2, 9), method=method, **GRID).vanished) == 0
    # and a map that has it has not lost it
    assert len(build_map(*pole(9, 3), method=method, **GRID).vanished) == 0


def test_the_values_of_log_odds_lose_nothing():
    assert len(build_map(*pole(3, 9), values=True, **GRID).vanished) == 0


def test_hits_are_counted_over_all_parts_of_a_run():
    poses, angles, ranges = pole(3, 9)
    builder = MapBuilder(build_map(poses, angles, ranges, **GRID).grid.frame)
    for k in range(len(poses)):
        builder.add(Scans(poses[k : k + 1], angles, ranges[k : k + 1]))
    assert builder.result().vanished.sizes.tolist() == [3]


@pytest.mark.parametrize(("hits", "passes"), [(3, 9), (3, 7), (3, 97), (4, 396), (3, 897)])
def test_the_ratio_that_is_advised_keeps_the_groups_and_is_the_largest_percent(hits, passes):
    frame = frame_of(GRID["size"], GRID["origin"], GRID["resolution"])
    builder = MapBuilder(frame, "counting")
    builder.add(Scans(*pole(hits, passes)))
    advice = builder.advice(builder.result().vanished)
    assert advice.startswith("--ratio ")
    assert advice.endswith(" keeps it")
    ratio = float(advice.split()[1])
    kept, lost = (
        build_map(*pole(hits, passes), method="counting", ratio=r, **GRID).vanished
        for r in (ratio, ratio + 0.01)
    )
    assert (len(kept), len(lost)) == (0, 1)
