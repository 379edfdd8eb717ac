"""Alignment against the places at which buildings were drawn."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from compare.buildings import HALL, OTHER_WALLS, WALLS, between, cut, drawn, errors
from mapdeal.compare.align import SearchArea, candidates_at, placed as align, refined, yaws_by_walls
from mapdeal.compare.walls import moved, walls_of
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.stages.resample import rotate

pytestmark = pytest.mark.slow

HERE = Transform(-3.2, 11.7, 0.3)


def first_map():
    return drawn(WALLS, 0.2, HERE, origin_yaw=0.2)


def is_found(found, true, grid):
    off, turn = errors(found.transform, true, grid)
    return found.same_place and off < 0.1 and turn < 0.3


@pytest.mark.parametrize(
    ("degrees", "resolution", "origin_yaw"),
    [(3.3, 0.27, 0.7), (-137.6, 0.2, 0.0), (-137.6, 0.27, 0.7), (180.0, 0.2, 0.0)],
)
def test_a_building_is_found_wherever_it_lies(degrees, resolution, origin_yaw):
    place = Transform(40.0, -7.5, math.radians(degrees))
    first, second = first_map(), drawn(WALLS, resolution, place, origin_yaw)
    found = align(first, second)
    assert is_found(found, between(HERE, place), first)
    assert found.overlap > 0.9
    assert found.agreement > 0.95


@settings(max_examples=2)
@given(st.floats(-math.pi, math.pi), st.sampled_from(["area", "nearest"]))
@example(1.573087632505973, "area")  # half a degree off, if the last scale is half a cell
@example(3.140625, "area")
@example(1.5668168507634066, "area")
@example(3.1359155921778408, "nearest")
def test_a_map_and_its_own_copy_turned_by_any_angle(angle, rule):
    first = drawn(WALLS, 0.25, HERE)
    found = align(first, rotate(first, angle, rule=rule))
    assert found.same_place
    off, turn = errors(found.transform, Transform(0.0, 0.0, angle), first)
    # Where a wall hardly turns, its cells stay with "nearest" up to half a cell at its end, and
    # "area" makes it a cell thicker: that is play, over its length.
    assert turn < math.degrees((0.125 if rule == "nearest" else 0.25) / 20)
    assert off < 0.125


def test_parts_that_have_a_third_in_common():
    there = Transform(-8.0, 3.0, 1.1)
    western = cut(drawn(WALLS, 0.15, HERE), HERE, lambda x: x < 16)
    found = align(western, cut(drawn(WALLS, 0.15, there), there, lambda x: x > 8))
    assert is_found(found, between(HERE, there), western)
    assert 0.3 < found.overlap < 0.7


def test_another_building_is_not_the_same_place():
    found = align(first_map(), drawn(OTHER_WALLS, 0.2, Transform(1.0, 1.0, 0.4)))
    assert not found.same_place
    assert "of 4.5 at least" in found.reason  # as so little is shared


def test_a_prior_decides_where_a_hall_looks_the_same_from_both_ends():
    there = Transform(3.0, 1.0, 0.5)
    first, second = drawn(HALL, 0.2), drawn(HALL, 0.2, there)
    found = align(first, second)
    assert not found.same_place
    assert "another place fits nearly as well" in found.reason
    turn = found.runner_up_transform.yaw - found.transform.yaw
    assert abs(math.remainder(turn, 2 * math.pi)) == pytest.approx(math.pi, abs=0.02)
    for true in (there, there.after(Transform(20.0, 9.0, math.pi))):
        prior = Transform(true.x + 0.9, true.y - 0.4, true.yaw - 0.2)
        assert is_found(align(first, second, prior=prior), true, first)
    near, far = (align(first, second, prior=Transform(x, 1.0, 0.5)).score for x in (3.0, 5.0))
    assert near - far == pytest.approx(0.5, abs=0.01)  # (2.5 * 2 m / 5 m) ** 2 / 2


def test_only_turns_that_were_given_are_looked_for():
    first, second = first_map(), drawn(WALLS, 0.2, Transform(0.0, 0.0, 0.3 + math.pi / 2))
    found = align(first, second, rotations=[0.0, math.pi / 2, math.pi, -math.pi / 2])
    assert found.same_place
    assert found.transform.yaw == pytest.approx(math.pi / 2, abs=math.radians(0.3))
    assert not align(first, second, rotations=[0.0, math.pi]).same_place


def test_maps_without_obstacles_are_not_sure():
    empty = OccupancyGrid(np.zeros((5, 9), np.int8), 0.1)
    assert align(empty, first_map()).reason == "the first map has no obstacle"
    assert align(first_map(), empty).reason == "the second map has no obstacle"
    assert align(empty, empty, prior=HERE).transform == HERE


@pytest.mark.parametrize("cells", [[[100]], [[100, 0]], [[-1, 100], [0, 100], [100, 100]]])
def test_maps_of_few_cells_are_never_sure(cells):
    tiny = OccupancyGrid(cells, 0.05, (1.0, 2.0, 0.4))
    assert not align(tiny, tiny).same_place
    assert not align(tiny, drawn(WALLS, 0.5, HERE)).same_place
    for finer in (tiny, OccupancyGrid([[100, 0, 100]], 1e-3)):  # smaller than a block of scores
        assert not align(finer, tiny, rotations=[0.0]).same_place


def test_maps_of_walls_alone_are_aligned_as_if_all_else_were_free_with_any_threads():
    there = Transform(40.0, -7.5, 2.0)
    grids = [drawn(WALLS, 0.2, HERE), drawn(WALLS, 0.2, there)]
    walls = [grid.with_values(np.where(grid.occupied(), 100, -1)) for grid in grids]
    found = align(*walls)
    assert is_found(found, between(HERE, there), grids[0])
    with use_threads(1):
        assert align(*walls) == found
    assert align(walls[0], grids[1]).same_place


TURN = 0.7


def two_maps(resolution=0.25, place=None):
    return walls_of(drawn(WALLS, resolution)), walls_of(drawn(WALLS, resolution, place))


def pose_between(first, second, place):
    """yaw, x, y along the cells of both maps."""
    lattice = second.map_from_cells().inverse().after(place).after(first.map_from_cells())
    return np.array([lattice.yaw, lattice.x, lattice.y])


def off_by(pose, true, walls):
    width, height = walls.frame.size_xy
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    return np.hypot(*(moved(pose[None], corners)[0] - moved(true[None], corners)[0]).T).max()


PLACE = Transform(2.0, -7.0, TURN)


def middles_of(poses, walls):
    return moved(np.atleast_2d(poses), walls.middle_xy[None])[:, 0]


@pytest.mark.parametrize("turn", [TURN, -2.0])
def test_the_right_shift_at_the_right_turn_is_best_and_places_are_apart(turn):
    place = Transform(-8.0, 3.0, turn)
    first, second = two_maps(place=place)
    true = pose_between(first, second, place)
    yaws = true[0] + np.arange(8) * math.pi / 4
    poses, cell = candidates_at(first, second, yaws, side=200, most_per_yaw=4, most=5)
    assert off_by(poses[0], true, first) < 1.5 * cell
    assert cell >= 0.25
    middles = middles_of(poses[:5], first)
    for i, k in itertools.combinations(range(5), 2):
        assert poses[i, 0] != poses[k, 0] or np.hypot(*(middles[i] - middles[k])) >= 2 * cell


@pytest.mark.parametrize(("x", "is_any"), [(6.0, True), (900.0, False)])
def test_only_places_near_a_given_one_are_found(x, is_any):
    first, second = two_maps(place=PLACE)
    area = SearchArea(pose_between(first, second, Transform(x, -3.0, TURN)), 2.0)
    yaws, most = area.pose[:1], {"most_per_yaw": 6, "most": 6}
    poses, cell = candidates_at(first, second, yaws, side=200, area=area, **most)
    assert (len(poses) > 0) == is_any
    off = middles_of(poses, first) - middles_of(area.pose, first)
    assert np.hypot(*off.T).max(initial=0) <= 2.0 + 2 * cell


def test_turns_by_walls_are_the_right_one_and_its_quarters():
    first, second = two_maps(0.15, PLACE)
    true, found = pose_between(first, second, PLACE)[0], yaws_by_walls(first, second)
    assert np.diff(found)[::2] == pytest.approx(math.pi)
    off = [math.degrees(abs(math.remainder(yaw - true, math.pi / 2))) for yaw in found]
    assert max(off[:4]) < 0.5  # the true turn and its quarters
    assert min(off[6:]) > 0.7  # the turns next to these
    assert max(off[6:]) < 1.7
    assert min(abs(math.remainder(yaw - true, 2 * math.pi)) for yaw in found) < math.radians(0.5)


def test_candidates_are_moved_to_where_walls_lie_on_walls():
    first, second = two_maps(0.15, PLACE)
    true = pose_between(first, second, PLACE)
    rng, starts = np.random.default_rng(2), []
    for _ in range(6):
        yaw = true[0] + rng.uniform(-0.04, 0.04)
        shift = middles_of(true, first) + rng.uniform(-0.35, 0.35, 2)
        starts.append([yaw, *(shift - middles_of([yaw, 0.0, 0.0], first))[0]])
    found = refined(first, second, np.array(starts), [0.5] * 5 + [0.2] * 6, 600)
    before = [off_by(np.array(start), true, first) for start in starts]
    after = [off_by(pose, true, first) for pose in found]
    assert min(before) > 0.1
    assert max(after) < 0.08
