import numpy as np
import pytest
from hypothesis import given, strategies as st

from drawn import grid_from_text
from mapdeal import MapdealWarning, OccupancyGrid, clean, read_map
from oracles import AROUND, EDGES, groups
from strategies import examples, occupancies


def around(values, group, steps=AROUND):
    """The values of the cells around a component, -1 beyond the edges of the map."""
    walled = np.pad(values, 1, constant_values=-1).tolist()
    return {walled[r + i + 1][c + j + 1] for r, c in group for i, j in steps
            if (r + i, c + j) not in group}  # fmt: skip


def cleaned_by_floods(values, min_obstacle, min_hole, min_free):
    """Clean a map step by step, component by component; return it and the counts."""
    values, counts = values.copy(), {}

    def change(name, groups, value):
        counts[name] = (len(groups), sum(map(len, groups)))
        for group in groups:
            for cell in group:
                values[cell] = value

    def holes(ring):
        small = [g for g in sorted(groups(values == -1, AROUND), key=min) if len(g) < min_hole]
        return [g for g in small if around(values, g) == {ring}]

    change("free_holes", holes(0), 0)
    free = sorted(groups(values == 0, EDGES), key=min)
    areas = [group for group in free if around(values, group, EDGES) <= {-1, 100}]
    largest = max(areas, key=len, default=None)
    change("islands", [a for a in areas if a is not largest and len(a) < min_free], -1)
    change("wall_holes", holes(100), 100)
    specks = [g for g in sorted(groups(values == 100, AROUND), key=min) if len(g) < min_obstacle]
    change("specks", [g for g in specks if around(values, g) == {0}], 0)
    return values, counts


SIZES = st.sampled_from([0, 1, 2, 3, 6, 9, 200])
limits_drawn = st.fixed_dictionaries(dict.fromkeys(("min_obstacle", "min_hole", "min_free"), SIZES))


@st.composite
def rooms(draw):
    """Maps in which each step has something to do: large parts of one value, and noise on them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = np.full(rng.integers(1, 15, 2), draw(st.sampled_from([0, 0, -1, 100])), dtype=np.int8)
    for _ in range(draw(st.integers(0, 8))):
        (r, c), (h, w) = rng.integers(0, values.shape), rng.integers(1, 6, 2)
        values[r : r + h, c : c + w] = rng.choice([0, 0, 100, 100, -1])
        if h > 2 and w > 2 and rng.random() < 0.7:
            values[r + 1 : r + h - 1, c + 1 : c + w - 1] = rng.choice([0, -1])
    noise = rng.random(values.shape) < draw(st.sampled_from([0, 0.05, 0.15]))
    values[noise] = rng.choice([0, 100, -1, 50], p=[0.3, 0.4, 0.25, 0.05], size=noise.sum())
    return values


@pytest.mark.usefixtures("mapdeal_warnings")
@given(st.one_of(rooms(), occupancies()), limits_drawn)
@examples(120)
def test_a_map_is_cleaned_as_floods_clean_it(values, limits):
    cleaned = clean(OccupancyGrid(values, 0.05, (1.5, -2.0, 0.4)), **limits)
    expected, counts = cleaned_by_floods(values, **limits)
    assert np.array_equal(cleaned.grid.occupancy, expected)
    assert {name: tuple(step) for name, step in cleaned.counts.steps().items()} == counts
    assert cleaned.counts.changed == np.count_nonzero(values != expected)
    assert (cleaned.grid.resolution, cleaned.grid.origin) == (0.05, (1.5, -2.0, 0.4))


def test_the_defaults_leave_the_leg_of_a_table_and_any_whole_number_will_do():
    found = clean(grid_from_text("......\n.##...\n......\n.###..\n......"))
    assert found.counts.specks == (1, 2)
    assert found.grid.occupancy[1].tolist() == [0, 100, 100, 100, 0, 0]
    found = clean(grid_from_text("...#."), min_free=10**30, min_hole=np.int16(3))
    assert found.grid.occupancy.tolist() == [[0, 0, 0, 100, -1]]


def test_a_map_that_is_clean_is_warned_of():
    grid = grid_from_text("....\n..+.\n....")
    with pytest.warns(MapdealWarning, match="nothing has changed; 1 cell of 1..99 stay") as caught:
        found = clean(grid)
    assert caught[0].filename == __file__
    assert found.grid.occupancy.tolist() == grid.occupancy.tolist()
    with pytest.warns(MapdealWarning, match="nothing has changed$"):
        clean(grid_from_text("...#"), min_obstacle=0, min_hole=0, min_free=0)


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("name", ["WPI-RAIL__rail_maps/maps/ilab", "align/PRBonn__tmcl/GMap/GMap"])
def test_real_maps_are_cleaned_and_stay_so(real_maps, name):
    grid = read_map(real_maps / f"{name}.yaml")
    once = clean(grid)
    assert once.counts.changed
    assert not clean(once.grid).counts.changed
    middle = grid.occupancy[grid.shape[0] // 2 :, grid.shape[1] // 2 :][:80, :80]
    expected, _ = cleaned_by_floods(middle, 3, 10, 100)
    assert np.array_equal(clean(OccupancyGrid(middle, 0.05)).grid.occupancy, expected)
