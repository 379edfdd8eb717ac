"""Alignment against the places at which buildings were drawn."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from compare.buildings import HALL, OTHER_WALLS, WALLS, between, cut, drawn, errors
from mapdeal.compare.align import placed as align
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.stages.resample import rotate

pytestmark = pytest.mark.slow

HERE = Transform(-3.2, 11.7, 0.3)


def first_map():
    return drawn(WALLS, 0.2, HERE, origin_yaw=0.2)


@pytest.mark.parametrize("degrees", [3.3, -137.6, 180.0])
@pytest.mark.parametrize(("resolution", "origin_yaw"), [(0.2, 0.0), (0.27, 0.7)])
def test_a_building_is_found_wherever_it_lies(degrees, resolution, origin_yaw):
    place = Transform(40.0, -7.5, math.radians(degrees))
    first, second = first_map(), drawn(WALLS, resolution, place, origin_yaw)
    found = align(first, second)
    off, turn = errors(found.transform, between(HERE, place), first)
    assert found.same_place
    assert off < 0.1
    assert turn < 0.3
    assert found.overlap > 0.9
    assert found.agreement > 0.95


@settings(max_examples=6, deadline=None)
@given(st.floats(-math.pi, math.pi), st.sampled_from(["area", "nearest"]))
@example(1.573087632505973, "area")  # half a degree off, if the last scale is half a cell
@example(3.140625, "area")
@example(1.5668168507634066, "area")
def test_a_map_and_its_own_copy_turned_by_any_angle(angle, rule):
    first = drawn(WALLS, 0.25, HERE)
    found = align(first, rotate(first, angle, rule=rule))
    assert found.same_place
    off, turn = errors(found.transform, Transform(0.0, 0.0, angle), first)
    # Where a wall hardly turns, "area" makes it a cell thicker: that is play, over its length.
    assert turn < (0.3 if rule == "nearest" else math.degrees(0.25 / 20))
    assert off < 0.125


def test_parts_that_have_a_third_in_common():
    there = Transform(-8.0, 3.0, 1.1)
    western = cut(drawn(WALLS, 0.1, HERE), HERE, lambda x: x < 16)
    eastern = cut(drawn(WALLS, 0.1, there), there, lambda x: x > 8)
    found = align(western, eastern)
    off, turn = errors(found.transform, between(HERE, there), western)
    assert found.same_place
    assert off < 0.1
    assert turn < 0.3
    assert 0.3 < found.overlap < 0.7


def test_another_building_is_not_the_same_place():
    found = align(first_map(), drawn(OTHER_WALLS, 0.2, Transform(1.0, 1.0, 0.4)))
    assert not found.same_place
    assert found.reason


def test_a_hall_that_looks_the_same_from_both_ends_is_not_sure():
    found = align(drawn(HALL, 0.2), drawn(HALL, 0.2, Transform(3.0, 1.0, 0.5)))
    assert not found.same_place
    assert "another place fits nearly as well" in found.reason
    turn = found.runner_up_transform.yaw - found.transform.yaw
    assert abs(math.remainder(turn, 2 * math.pi)) == pytest.approx(math.pi, abs=0.02)


def test_a_prior_decides_what_the_maps_do_not():
    first, second = drawn(HALL, 0.2), drawn(HALL, 0.2, Transform(3.0, 1.0, 0.5))
    other_way = Transform(3.0, 1.0, 0.5).after(Transform(20.0, 9.0, math.pi))
    for true in (Transform(3.0, 1.0, 0.5), other_way):
        prior = Transform(true.x + 0.9, true.y - 0.4, true.yaw - 0.2)
        found = align(first, second, prior=prior)
        assert found.same_place
        assert errors(found.transform, true, first)[0] < 0.1


def test_only_turns_that_were_given_are_looked_for():
    first, second = first_map(), drawn(WALLS, 0.2, Transform(0.0, 0.0, 0.3 + math.pi / 2))
    quarters = [0.0, math.pi / 2, math.pi, -math.pi / 2]
    found = align(first, second, rotations=quarters)
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
    assert not align(tiny, first_map()).same_place


def test_results_do_not_depend_on_threads():
    first, second = first_map(), drawn(WALLS, 0.27, Transform(5.0, 2.0, 2.2))
    with use_threads(1):
        alone = align(first, second)
    with use_threads(3):
        assert align(first, second) == alone


def test_maps_of_walls_alone_are_aligned_as_if_all_else_were_free():
    there = Transform(40.0, -7.5, 2.0)
    grids = [drawn(WALLS, 0.2, HERE), drawn(WALLS, 0.2, there)]
    walls = [grid.with_values(np.where(grid.occupied(), 100, -1)) for grid in grids]
    found = align(*walls)
    assert found.same_place
    assert errors(found.transform, between(HERE, there), grids[0])[0] < 0.1
    assert align(walls[0], grids[1]).same_place
