"""Cleaned maps, by hand and against floods in plain Python."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drawn import cells, grid_from_text
from mapdeal import (
    Cleaned,
    Costmap,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    clean,
    esdf,
    field_view,
    read_map,
)
from strategies import occupancies

EDGES = [(0, 1), (1, 0), (0, -1), (-1, 0)]
AROUND = [*EDGES, (1, 1), (1, -1), (-1, 1), (-1, -1)]
OFF = {"min_obstacle": 0, "min_hole": 0, "min_free": 0}


def components(values, value, steps):
    """The components of cells of a value as sets of cells, the first cell of each in order."""
    left = {cell for cell in np.ndindex(values.shape) if values[cell] == value}
    found = []
    for start in np.ndindex(values.shape):
        if start not in left:
            continue
        left.discard(start)
        group, edge = set(), [start]
        while edge:
            r, c = edge.pop()
            group.add((r, c))
            for i, j in steps:
                if (r + i, c + j) in left:
                    left.discard((r + i, c + j))
                    edge.append((r + i, c + j))
        found.append(group)
    return found


def around(values, group, steps=AROUND):
    """The values of the cells around a component, -1 beyond the edges of the map."""
    height, width = values.shape
    cells_around = {(r + i, c + j) for r, c in group for i, j in steps} - group
    return {
        int(values[r, c]) if 0 <= r < height and 0 <= c < width else -1 for r, c in cells_around
    }


def is_between(value):
    return 0 < value < 100


def cleaned_by_floods(values, min_obstacle, min_hole, min_free):
    """Clean a map step by step, component by component; return it and the counts."""
    values, counts = values.copy(), {}

    def change(name, groups, value):
        counts[name] = (len(groups), sum(map(len, groups)))
        for group in groups:
            for cell in group:
                values[cell] = value

    def holes(ring):
        small = [g for g in components(values, -1, AROUND) if len(g) < min_hole]
        return [g for g in small if around(values, g) == {ring}]

    change("free_holes", holes(0), 0)
    areas = [
        group
        for group in components(values, 0, EDGES)
        if not any(map(is_between, around(values, group, EDGES)))
    ]
    largest = max(areas, key=len, default=None)
    change("islands", [a for a in areas if a is not largest and len(a) < min_free], -1)
    change("wall_holes", holes(100), 100)
    specks = [g for g in components(values, 100, AROUND) if len(g) < min_obstacle]
    change("specks", [g for g in specks if around(values, g) == {0}], 0)
    return values, counts


def quietly(grid, **limits):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        return clean(grid, **limits)


limits_drawn = st.fixed_dictionaries(
    {
        "min_obstacle": st.sampled_from([0, 1, 2, 3, 6, 200]),
        "min_hole": st.sampled_from([0, 1, 2, 3, 6, 200]),
        "min_free": st.sampled_from([0, 1, 2, 4, 9, 200]),
    }
)


@st.composite
def rooms(draw):
    """Maps in which each step has something to do: large parts of one value, and noise on them."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    height, width = draw(st.integers(1, 14)), draw(st.integers(1, 14))
    values = np.full((height, width), draw(st.sampled_from([0, 0, -1, 100])), dtype=np.int8)
    for _ in range(draw(st.integers(0, 8))):
        r, c = rng.integers(0, height), rng.integers(0, width)
        h, w = rng.integers(1, 6, 2)
        values[r : r + h, c : c + w] = rng.choice([0, 0, 100, 100, -1])
        if h > 2 and w > 2 and rng.random() < 0.7:
            values[r + 1 : r + h - 1, c + 1 : c + w - 1] = rng.choice([0, -1])
    noise = rng.random(values.shape) < draw(st.sampled_from([0, 0.05, 0.15]))
    values[noise] = rng.choice([0, 100, -1, 50], p=[0.3, 0.4, 0.25, 0.05], size=noise.sum())
    return values


maps = st.one_of(rooms(), occupancies())


@given(maps, limits_drawn)
@settings(max_examples=200)
def test_a_map_is_cleaned_as_floods_clean_it(values, limits):
    grid = OccupancyGrid(values, 0.05, (1.5, -2.0, 0.4))
    cleaned = quietly(grid, **limits)
    expected, counts = cleaned_by_floods(values, **limits)
    assert np.array_equal(cleaned.grid.occupancy, expected)
    assert {name: tuple(step) for name, step in cleaned.counts.steps().items()} == counts
    assert cleaned.counts.changed == np.count_nonzero(values != expected)
    assert (cleaned.grid.resolution, cleaned.grid.origin) == (0.05, (1.5, -2.0, 0.4))


@pytest.mark.slow
@given(maps, limits_drawn)
@settings(max_examples=200)
def test_a_second_pass_changes_nothing(values, limits):
    once = quietly(OccupancyGrid(values, 0.05), **limits).grid
    twice = quietly(once, **limits)
    assert np.array_equal(once.occupancy, twice.grid.occupancy)
    assert not any(cells_of for _, cells_of in twice.counts.steps().values())


@given(maps, limits_drawn)
@settings(max_examples=200)
def test_no_wall_is_opened(values, limits):
    after = quietly(OccupancyGrid(values, 0.05), **limits).grid.occupancy
    height, width = values.shape
    large = {
        cell
        for group in components(values, 100, AROUND)
        for cell in group
        if len(group) >= limits["min_obstacle"]
    }
    for r, c in np.ndindex(values.shape):
        if after[r, c] == 0 and values[r, c] != 0:  # what has become free lies in free space
            assert around(after, {(r, c)}) == {0}
            assert (r, c) not in large
        if is_between(values[r, c]):
            assert after[r, c] == values[r, c]
        for i, j in EDGES:  # free and unknown cells share an edge only where they did
            q = (r + i, c + j)
            if after[r, c] == 0 and 0 <= q[0] < height and 0 <= q[1] < width and after[q] == -1:
                assert (values[r, c], values[q]) == (0, -1)


@given(maps, limits_drawn)
def test_what_is_large_enough_stays(values, limits):
    after = quietly(OccupancyGrid(values, 0.05), **limits).grid.occupancy
    areas = components(values, 0, EDGES)
    stay = [all(after[cell] == 0 for cell in group) for group in areas]
    sizes = [len(group) for group in areas]
    assert all(kept for kept, size in zip(stay, sizes, strict=True) if size >= limits["min_free"])
    if areas:  # of several that are largest one stays
        assert any(kept for kept, size in zip(stay, sizes, strict=True) if size == max(sizes))
    for group in components(values, 100, AROUND):
        if len(group) >= limits["min_obstacle"]:
            assert all(after[cell] == 100 for cell in group)
    for group in components(values, -1, AROUND):
        if len(group) >= limits["min_hole"]:
            assert all(after[cell] == -1 for cell in group)


def test_each_step_by_hand():
    before = """
        ?????????????
        ?##########??
        ?#........#.?
        ?#.#...?..###
        ?#....??..#?#
        ?#........###
        ?##########??
    """
    after = """
        ?????????????
        ?##########??
        ?#........#??
        ?#........###
        ?#........###
        ?#........###
        ?##########??
    """
    found = clean(grid_from_text(before), min_obstacle=2, min_hole=4, min_free=2)
    assert found.grid.occupancy.tolist() == cells(after).tolist()
    counts = found.counts
    assert (counts.islands, counts.free_holes) == ((1, 1), (1, 3))
    assert (counts.wall_holes, counts.specks, counts.changed) == ((1, 1), (1, 1), 6)


@pytest.mark.parametrize(
    "speck",
    ["....\n.#..\n..?.", "#...\n....", "....\n.#..\n..#?\n....", "....\n.#+.\n....", "...\n.#."],
    ids=["unknown at a corner", "in the corner", "through its other cell", "graded", "at an edge"],
)
def test_an_obstacle_that_does_not_stand_in_free_space_stays(speck):
    grid = grid_from_text(speck)
    found = quietly(grid, min_obstacle=9, min_hole=0)
    assert found.grid.occupancy.tolist() == grid.occupancy.tolist()
    assert found.counts.specks == (0, 0)


def test_the_hollow_of_a_pillar_is_filled_and_a_small_pillar_goes():
    pillar = "......\n.###..\n.#?#..\n.###..\n......"
    filled = clean(grid_from_text(pillar), min_obstacle=9)
    assert filled.grid.occupancy.tolist() == cells(pillar.replace("?", "#")).tolist()
    gone = clean(grid_from_text(pillar), min_obstacle=10)
    assert not gone.grid.occupancy.any()
    assert gone.counts.changed == 9


def test_areas_that_meet_at_a_corner_are_two():
    found = clean(grid_from_text("...#.\n...#.\n###..\n...##"), min_free=5)
    assert found.grid.occupancy.tolist() == cells("...#?\n...#?\n###??\n???##").tolist()
    assert found.counts.islands == (2, 7)


def test_beams_that_a_hole_parts_are_joined_before_islands_are_looked_for():
    found = clean(grid_from_text("......\n..?...\n.?.?..\n..?...\n......"), min_free=3)
    assert not found.grid.occupancy.any()
    assert (found.counts.free_holes, found.counts.islands) == ((1, 4), (0, 0))


def test_of_areas_of_one_size_one_stays_and_an_area_beside_graded_cells_too():
    found = clean(grid_from_text("..#..#.+"), min_free=100)
    (row,) = found.grid.occupancy.tolist()
    assert row in ([0, 0, 100, -1, -1, 100, 0, 50], [-1, -1, 100, 0, 0, 100, 0, 50])


def test_the_defaults_leave_the_leg_of_a_table():
    values = np.zeros((20, 30), dtype=np.int8)
    values[5, 5:7] = values[10, 10:13] = 100
    found = clean(OccupancyGrid(values, 0.05, (1.0, 2.0, 0.3)))
    assert found.counts.specks == (1, 2)
    assert np.flatnonzero(found.grid.occupancy[10]).tolist() == [10, 11, 12]


def test_a_map_that_is_clean_is_warned_of():
    grid = grid_from_text("....\n..+.\n....")
    with pytest.warns(MapdealWarning, match="nothing has changed; 1 cell of 1..99 stay") as caught:
        found = clean(grid)
    assert caught[0].filename == __file__
    assert found.grid.occupancy.tolist() == grid.occupancy.tolist()
    with pytest.warns(MapdealWarning, match="nothing has changed$"):
        clean(grid_from_text("...#"), **OFF)


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ({"min_obstacle": -1}, "min_obstacle: must be a whole number, at least 0, got -1"),
        ({"min_hole": 2.5}, "min_hole: .* got 2.5"),
        ({"min_free": True}, "min_free: .* got True"),
        ({"min_free": "few"}, "min_free: .* got 'few'"),
    ],
)
def test_numbers_that_count_no_cells_are_refused(limits, told):
    with pytest.raises(ParameterError, match=told):
        clean(grid_from_text("...#"), **limits)


def test_any_whole_number_will_do():
    found = clean(grid_from_text("...#."), min_free=10**30, min_hole=np.int16(3))
    assert found.grid.occupancy.tolist() == [[0, 0, 0, 100, -1]]


def test_costs_and_fields_are_refused():
    grid = grid_from_text("...#")
    costs = Costmap(np.zeros((2, 3), dtype=np.uint8), 0.5)
    for other in (costs, esdf(grid), field_view(esdf(grid))):
        with pytest.raises(ParameterError, match="clean: takes a map with free"):
            clean(other)


def test_the_result_is_frozen_and_told_in_a_line():
    found = clean(grid_from_text("...#."))
    assert isinstance(found, Cleaned)
    with pytest.raises(AttributeError):
        found.grid = None
    assert repr(found) == (
        "Cleaned(1 cell changed, 0 free_holes, 1 islands, 0 wall_holes, 0 specks)"
    )


@pytest.mark.parametrize(
    "name",
    ["WPI-RAIL__rail_maps/maps/ilab.yaml", "align/PRBonn__tmcl/GMap/GMap.yaml",
     "ros-navigation__navigation2/nav2_bringup/maps/depot_speed.yaml"],
)  # fmt: skip
def test_real_maps_are_cleaned_and_stay_so(real_maps, name):
    before = read_map(real_maps / name)
    once = clean(before)
    assert once.counts.changed
    twice = quietly(once.grid)
    assert not twice.counts.changed
    if "ilab" in name:  # the smallest, by floods
        expected, _ = cleaned_by_floods(before.occupancy, 3, 10, 100)
        assert np.array_equal(once.grid.occupancy, expected)
