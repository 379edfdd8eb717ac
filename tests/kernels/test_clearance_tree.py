"""Clearance trees beside floods and merges cell by cell, on each engine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

import oracles
from mapdeal import read_map
from mapdeal.kernels.distance import squared_distance, unreachable
from mapdeal.kernels.paths import (
    basin_areas,
    clearance_metres,
    clearance_tree,
    rooted,
    widest_metres,
)


def widest_from(tree, squared, start):
    """Return the squares of the widest ways, below a million, from their lengths in cells."""
    cells = widest_metres(tree, squared, start, 1.0).astype(np.float64)
    widest = np.full(squared.shape, unreachable(squared), squared.dtype)
    widest[np.isfinite(cells)] = np.rint(cells[np.isfinite(cells)] ** 2)
    return widest


pytestmark = pytest.mark.usefixtures("each_engine")


@st.composite
def grids(draw, longest=12):
    """Squares and a mask of traversable cells; often distances, sometimes any, with many ties."""
    shape = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    occupied = rng.random(shape) < draw(st.sampled_from([0.0, 0.02, 0.1, 0.3, 0.6, 1.0]))
    squared = squared_distance(occupied)
    if draw(st.integers(0, 3)) == 0:
        squared = rng.integers(0, draw(st.sampled_from([2, 4, 1000])), shape).astype(np.int32)
    if draw(st.booleans()):
        squared = np.where(squared == unreachable(squared), 2**63 - 1, squared.astype(np.int64))
    known = rng.random(shape) < draw(st.sampled_from([1.0, 1.0, 0.9, 0.5]))
    return squared, known & (squared > 0)


def some_cell(mask, choice):
    listed = np.argwhere(mask)
    return tuple(listed[choice % len(listed)].tolist())


@given(grids(), st.integers(0, 10**6))
def test_widest_ways_are_those_of_floods_at_every_square(grid, choice):
    squared, is_open = grid
    tree = clearance_tree(squared, is_open)
    assert np.array_equal(tree.basins >= 0, is_open)
    if is_open.any():
        start = some_cell(is_open, choice)
        widest = widest_from(tree, squared, start)
        assert np.array_equal(widest, oracles.widest_by_flooding(squared, is_open, start))


@pytest.mark.parametrize(
    ("shape", "share"), [((64, 41), 0.01), ((64, 41), 0.35), ((37, 64), 0.1), ((1, 64), 0.1)]
)
def test_widest_ways_on_larger_grids(shape, share):
    rng = np.random.default_rng(5)
    occupied = rng.random(shape) < share
    occupied[0, 0] = False
    occupied[shape[0] // 3, : shape[1] * 2 // 3] = shape[0] > 1 and share == 0.01  # a wall
    squared = squared_distance(occupied)
    tree = clearance_tree(squared, ~occupied)
    for start in [(0, 0), some_cell(~occupied, 1234), some_cell(~occupied, 987_654)]:
        widest = widest_from(tree, squared, start)
        assert np.array_equal(widest, oracles.widest_by_flooding(squared, ~occupied, start))


@given(grids())
def test_basins_and_edges_are_those_that_appear_as_cells_are_added(grid):
    squared, is_open = grid
    tree = clearance_tree(squared, is_open)
    basin, merges = oracles.merged_basins(squared, is_open)
    at = [divmod(cell, squared.shape[1]) for cell in tree.peak_cells.tolist()]
    assert at == sorted(set(basin.values()))
    assert tree.peaks.tolist() == [squared[cell] for cell in at]
    assert all(at[tree.basins[cell]] == peak for cell, peak in basin.items())
    edges = zip(tree.squares, tree.cells, tree.one, tree.other, strict=True)
    width = squared.shape[1]
    assert [(s, divmod(c, width), at[one], at[other]) for s, c, one, other in edges] == merges
    assert (tree.basins.dtype, tree.peaks.dtype) == (np.int32, np.int64)
    assert {tree.one.dtype, tree.other.dtype} == {np.dtype(np.int32)}
    assert {tree.squares.dtype, tree.cells.dtype, tree.peak_cells.dtype} == {np.dtype(np.int64)}


@given(grids(24), st.integers(0, 10**6))
def test_a_rooted_tree_leads_from_each_basin_to_the_root(grid, choice):
    squared, is_open = grid
    tree = clearance_tree(squared, is_open)
    if not len(tree.peaks):
        return
    root = choice % len(tree.peaks)
    seen = rooted(tree, root)
    assert seen.order[0] == root
    assert seen.parent_edges[root] == -1
    assert seen.bottlenecks[root] == tree.peaks[root]
    depths = {root: 0}
    for basin in seen.order[1:].tolist():
        edge = seen.parent_edges[basin]
        ends = {int(tree.one[edge]), int(tree.other[edge])}
        (parent,) = ends - {basin}
        assert seen.bottlenecks[basin] == min(seen.bottlenecks[parent], tree.squares[edge])
        depths[basin] = depths[parent] + 1
    assert list(depths.values()) == sorted(depths.values())
    beyond = np.delete(np.arange(len(tree.peaks)), seen.order)
    assert len(beyond) == len(tree.peaks) - len(depths)
    assert (seen.parent_edges[beyond] == -1).all()
    assert (seen.bottlenecks[beyond] == -1).all()
    labels = ndimage.label(is_open)[0].reshape(-1)[tree.peak_cells]
    assert set(depths) == set(np.flatnonzero(labels == labels[root]).tolist())


def metres_of(squared, resolution):
    """Metres of each square, as float32 has them."""
    endless = unreachable(squared)
    listed = [math.inf if s == endless else math.sqrt(s) * resolution for s in squared.flat]
    return np.array(listed, dtype=np.float32).reshape(squared.shape)


@given(grids(), st.integers(0, 10**6), st.floats(1e-3, 10), st.booleans())
def test_metres_are_roots_of_squares_times_the_resolution(grid, choice, resolution, in_place):
    squared, is_open = grid
    expected = metres_of(squared, resolution)
    tree = clearance_tree(squared, is_open)
    if is_open.any():
        start = some_cell(is_open, choice)
        widest = widest_from(tree, squared, start)
        metres = widest_metres(tree, squared, start, resolution, in_place=in_place)
        assert metres.dtype == np.float32
        assert np.array_equal(metres, metres_of(widest, resolution))
        assert np.shares_memory(metres, tree.basins) == in_place
    metres = clearance_metres(squared, resolution, in_place=in_place)
    assert metres.dtype == np.float32
    assert np.array_equal(metres, expected)
    assert np.shares_memory(metres, squared) == (in_place and squared.dtype == np.int32)


@given(grids(), st.integers(-2, 12))
def test_areas_are_counts_of_cells(grid, above):
    squared, is_open = grid
    tree = clearance_tree(squared, is_open)
    areas = basin_areas(tree, squared, above)
    assert areas.dtype == np.int64
    counted = [((tree.basins == k) & (squared > above)).sum() for k in range(len(tree.peaks))]
    assert areas.tolist() == counted


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(
    "name",
    [
        "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
        "turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10.yaml",
        "mit-racecar__racecar_simulator/maps/building_31.yaml",
    ],
)
def test_widest_ways_through_real_buildings_are_those_of_labels(real_maps, name):
    """From the widest place: what robots reach that are as wide as some passages, or wider."""
    values = read_map(real_maps / name).occupancy
    is_free = values == 0
    squared = squared_distance(values == 100)
    tree = clearance_tree(squared, is_free)
    start = divmod(int(tree.peak_cells[np.argmax(tree.peaks)]), squared.shape[1])
    widest = widest_from(tree, squared, start)
    some = tree.squares[:: max(1, len(tree.squares) // 12)].tolist()
    for square in {least for one in some for least in (one, one + 1)}:
        labels, _ = ndimage.label(is_free & (squared >= square))
        assert np.array_equal(widest >= square, (labels == labels[start]) & (labels > 0))


def test_metres_do_not_take_memory_that_is_not_theirs_alone():
    squared = np.arange(24, dtype=np.int32).reshape(4, 6)
    locked = squared.copy()
    locked.flags.writeable = False
    for part in (squared[:, ::2], locked):
        before = part.copy()
        assert not np.shares_memory(clearance_metres(part, 0.3, in_place=True), part)
        assert np.array_equal(part, before)
