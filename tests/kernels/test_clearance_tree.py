"""Clearance trees beside floods and merges cell by cell, and each engine beside the other."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

import oracles
from engines import needs_compiled
from mapdeal import read_map
from mapdeal.kernels import paths, scipy_twins
from mapdeal.kernels.arrays import unreachable
from mapdeal.kernels.distance import squared_distance

CHOICES = st.integers(0, 10**6)
RESOLUTIONS = st.floats(1e-3, 10)


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


def metres_of(squared, resolution):
    """Metres of each square, as float32 has them."""
    endless = unreachable(squared)
    listed = [math.inf if s == endless else math.sqrt(s) * resolution for s in squared.flat]
    return np.array(listed, dtype=np.float32).reshape(squared.shape)


@given(grids(), CHOICES, RESOLUTIONS)
def test_widest_ways_are_those_of_floods(each_engine, grid, choice, resolution):
    squared, is_open = grid
    tree = paths.clearance_tree(squared, is_open)
    assert np.array_equal(tree.basins >= 0, is_open)
    if is_open.any():
        cells = np.argwhere(is_open).tolist()
        start = tuple(cells[choice % len(cells)])
        expected = oracles.widest_by_flooding(squared, is_open, start).astype(squared.dtype)
        rooted = paths.rooted(tree, int(tree.basins[start]))
        metres = paths.widest_metres(tree, rooted, squared, start, resolution)
        assert metres.dtype == np.float32
        assert np.array_equal(metres, metres_of(expected, resolution))
        assert np.shares_memory(metres, tree.basins)


@given(grids(), RESOLUTIONS)
def test_metres_are_roots_of_squares_times_the_resolution(each_engine, grid, resolution):
    squared, _ = grid
    expected = metres_of(squared, resolution)
    metres = paths.clearance_metres(squared, resolution)
    assert metres.dtype == np.float32
    assert np.array_equal(metres, expected)
    assert np.shares_memory(metres, squared) == (squared.dtype == np.int32)


def test_metres_do_not_take_memory_that_is_not_theirs_alone(each_engine):
    squared = np.arange(24, dtype=np.int32).reshape(4, 6)
    locked = squared.copy()
    locked.flags.writeable = False
    for part in (squared[:, ::2], locked):
        before = part.copy()
        assert not np.shares_memory(paths.clearance_metres(part, 0.3), part)
        assert np.array_equal(part, before)


@given(grids(), st.integers(-2, 12))
def test_basins_and_edges_are_those_that_appear_as_cells_are_added(each_engine, grid, above):
    squared, is_open = grid
    tree = paths.clearance_tree(squared, is_open)
    basin, merges = oracles.merged_basins(squared, is_open)
    at = [divmod(cell, squared.shape[1]) for cell in tree.peak_cells.tolist()]
    assert at == sorted(set(basin.values()))
    assert tree.peaks.tolist() == [squared[cell] for cell in at]
    assert all(at[tree.basins[cell]] == peak for cell, peak in basin.items())
    edges = zip(tree.squares, tree.cells, tree.firsts, tree.seconds, strict=True)
    width = squared.shape[1]
    assert [(s, divmod(c, width), at[first], at[second]) for s, c, first, second in edges] == merges
    areas = paths.basin_areas(tree, squared, above)
    counted = [((tree.basins == k) & (squared > above)).sum() for k in range(len(tree.peaks))]
    assert areas.tolist() == counted
    assert (tree.basins.dtype, tree.peaks.dtype, areas.dtype) == (np.int32, np.int64, np.int64)
    assert {tree.firsts.dtype, tree.seconds.dtype} == {np.dtype(np.int32)}
    assert {tree.squares.dtype, tree.cells.dtype, tree.peak_cells.dtype} == {np.dtype(np.int64)}


@given(grids(24), st.integers(0, 10**6))
def test_a_rooted_tree_leads_from_each_basin_to_the_root(each_engine, grid, choice):
    squared, is_open = grid
    tree = paths.clearance_tree(squared, is_open)
    if not len(tree.peaks):
        return
    root = choice % len(tree.peaks)
    rooted = paths.rooted(tree, root)
    assert rooted.order[0] == root
    assert rooted.parent_edges[root] == -1
    assert rooted.bottlenecks[root] == tree.peaks[root]
    depths = {root: 0}
    for basin in rooted.order[1:].tolist():
        edge = rooted.parent_edges[basin]
        (parent,) = {int(tree.firsts[edge]), int(tree.seconds[edge])} - {basin}
        assert rooted.bottlenecks[basin] == min(rooted.bottlenecks[parent], tree.squares[edge])
        depths[basin] = depths[parent] + 1
    assert list(depths.values()) == sorted(depths.values())
    beyond = np.delete(np.arange(len(tree.peaks)), rooted.order)
    assert len(beyond) == len(tree.peaks) - len(depths)
    assert (rooted.parent_edges[beyond] == -1).all()
    assert (rooted.bottlenecks[beyond] == -1).all()
    labels = ndimage.label(is_open)[0].reshape(-1)[tree.peak_cells]
    assert set(depths) == set(np.flatnonzero(labels == labels[root]).tolist())


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("name", [
    "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
    "turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10.yaml",
    "mit-racecar__racecar_simulator/maps/building_31.yaml",
])  # fmt: skip
def test_widest_ways_through_real_buildings_are_those_of_labels(each_engine, real_maps, name):
    values = read_map(real_maps / name).occupancy
    is_free = values == 0
    squared = squared_distance(values == 100)
    tree = paths.clearance_tree(squared, is_free)
    start = divmod(int(tree.peak_cells[np.argmax(tree.peaks)]), squared.shape[1])
    rooted = paths.rooted(tree, int(tree.basins[start]))
    widest = np.rint(paths.widest_metres(tree, rooted, squared, start, 1.0).astype(float) ** 2)
    some = tree.squares[:: max(1, len(tree.squares) // 12)].tolist()
    for square in {limit for peak in some for limit in (peak, peak + 1)}:
        labels, _ = ndimage.label(is_free & (squared >= square))
        assert np.array_equal(widest >= square, (labels == labels[start]) & (labels > 0))


def check(squared, is_open, resolution=0.05, choice=0):
    """All that the compiled code makes of a grid is that of numpy and scipy, to the last byte."""
    from mapdeal.kernels import compiled

    assert compiled.fits(squared)
    results_of_engines = []
    for engine in (compiled, scipy_twins):
        tree = engine.clearance_tree(squared, is_open)
        results = [getattr(tree, name) for name in tree.__dataclass_fields__]
        if len(tree.peaks):
            rooted = engine.rooted(tree, choice % len(tree.peaks))
            results += [getattr(rooted, name) for name in rooted.__dataclass_fields__]
            results.append(engine.basin_areas(tree.basins, squared, 3, len(tree.peaks)))
            limits = np.concatenate([[0], np.maximum(rooted.bottlenecks, 0)])
            widest, metres = np.empty((2, *squared.shape), np.float32)
            engine.widest_metres(tree.basins, squared, limits, resolution, widest)
            engine.clearance_metres(squared, resolution, metres)
            results += [widest, metres]
        results_of_engines.append([(a.shape, a.dtype, a.tobytes()) for a in results])
    assert results_of_engines[0] == results_of_engines[1]


@pytest.mark.slow
@needs_compiled
@given(grids(40), CHOICES, RESOLUTIONS)
def test_both_engines_give_the_same_bytes(grid, choice, resolution):
    check(*grid, resolution, choice)


@pytest.mark.slow
@needs_compiled
def test_both_engines_agree_on_many_bands_of_rows():
    for shape, density in (((700, 600), 0.0005), ((30, 9000), 0.05), ((9000, 1), 0.05)):
        occupied = np.random.default_rng(7).random(shape) < density
        check(squared_distance(occupied), ~occupied, choice=11)
    winding = np.zeros((600, 600), np.int32)
    for k in range(300):
        cells = np.arange(601 * k + 1, 601 * (k + 1))
        winding[:, 2 * k] = cells if k % 2 == 0 else cells[::-1]
        winding[-1 if k % 2 == 0 else 0, 2 * k + 1] = 601 * (k + 1)
    for turned in (winding, winding[::-1].copy()):
        check(turned, turned > 0)


@needs_compiled
def test_squares_that_do_not_fit_are_left_to_the_twin():
    from mapdeal.kernels import compiled

    large = np.array([[2**31 - 2, 5, 2**63 - 1]])
    assert compiled.fits(large)
    large[0, 0] += 1
    assert not compiled.fits(large)
    assert not compiled.fits(np.zeros((0, 4), np.int32))
