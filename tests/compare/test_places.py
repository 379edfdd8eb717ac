"""Candidates for a place: correlations, turns by walls, and steps towards walls."""

import math

import numpy as np
import pytest

from compare.buildings import WALLS, drawn
from mapdeal.compare.align import Near, moved, places_of, refined, walls_of, yaws_by_walls
from mapdeal.grid.frame import Transform

TURN = 0.7


def two_maps(resolution=0.25, place=None):
    return walls_of(drawn(WALLS, resolution)), walls_of(drawn(WALLS, resolution, place))


def pose_between(first, second, place):
    """yaw, x, y along the cells of both maps."""
    lattice = second.map_from_cells().inverse().after(place).after(first.map_from_cells())
    return np.array([lattice.yaw, lattice.x, lattice.y])


def off_by(pose, true, walls):
    """How far the middle and the corners of a map come to lie apart."""
    width, height = walls.frame.size_xy
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    apart = moved(pose[None], corners)[0] - moved(true[None], corners)[0]
    return np.hypot(*apart.T).max()


@pytest.mark.parametrize("turn", [0.0, TURN, -2.0])
def test_the_best_shift_at_the_right_turn_is_the_right_one(turn):
    place = Transform(-8.0, 3.0, turn)
    first, second = two_maps(place=place)
    true = pose_between(first, second, place)
    found = places_of(first, second, np.array([true[0]]), side=200, offered=4, kept=3)
    assert off_by(found.poses[0], true, first) < 1.5 * found.cell
    assert found.cell >= 0.25


def test_among_several_turns_the_right_one_is_best_and_places_are_apart():
    place = Transform(2.0, -7.0, TURN)
    first, second = two_maps(place=place)
    true = pose_between(first, second, place)
    yaws = true[0] + np.arange(8) * math.pi / 4
    found = places_of(first, second, yaws, side=200, offered=4, kept=5)
    assert found.poses[0, 0] == pytest.approx(true[0])
    middles = moved(found.poses[:5], first.middle_xy[None])[:, 0]
    for i in range(5):
        for k in range(i):
            is_near = np.hypot(*(middles[i] - middles[k])) < 2 * found.cell
            assert not (is_near and found.poses[i, 0] == found.poses[k, 0])


def test_only_places_near_a_given_one_are_found():
    place = Transform(2.0, -7.0, TURN)
    first, second = two_maps(place=place)
    near = Near(pose_between(first, second, Transform(6.0, -3.0, TURN)), 2.0)
    found = places_of(first, second, near.pose[:1], side=200, offered=6, kept=6, near=near)
    assert len(found.poses)
    middle = moved(near.pose[None], first.middle_xy[None])[0, 0]
    off = moved(found.poses, first.middle_xy[None])[:, 0] - middle
    assert np.hypot(*off.T).max() <= 2.0 + 2 * found.cell
    far = Near(pose_between(first, second, Transform(900.0, 0.0, TURN)), 2.0)
    nowhere = places_of(first, second, far.pose[:1], side=200, offered=6, kept=6, near=far)
    assert nowhere.poses.shape == (0, 3)


def test_turns_by_walls_are_the_right_one_and_its_quarters():
    place = Transform(2.0, -7.0, TURN)
    first, second = two_maps(0.15, place)
    true = pose_between(first, second, place)[0]
    found = yaws_by_walls(first, second)
    assert np.diff(found)[::2] == pytest.approx(math.pi)
    off = [math.degrees(abs(math.remainder(yaw - true, math.pi / 2))) for yaw in found]
    assert max(off[:4]) < 0.5  # the right way round and the other, along and across
    assert min(off[6:]) > 0.7  # and what lies beside these
    assert max(off[6:]) < 1.7
    assert min(abs(math.remainder(yaw - true, 2 * math.pi)) for yaw in found) < math.radians(0.5)


def test_candidates_are_moved_to_where_walls_lie_on_walls():
    place = Transform(2.0, -7.0, TURN)
    first, second = two_maps(0.15, place)
    true = pose_between(first, second, place)
    rng = np.random.default_rng(2)
    middle = first.middle_xy
    starts = []
    for _ in range(6):
        yaw = true[0] + rng.uniform(-0.04, 0.04)
        turned = np.array([yaw, 0.0, 0.0])
        shift = moved(true[None], middle[None])[0, 0] + rng.uniform(-0.35, 0.35, 2)
        starts.append([yaw, *(shift - moved(turned[None], middle[None])[0, 0])])
    found = refined(first, second, np.array(starts), [0.5] * 5 + [0.2] * 6, 600)
    before = [off_by(np.array(start), true, first) for start in starts]
    after = [off_by(pose, true, first) for pose in found]
    assert min(before) > 0.1
    assert max(after) < 0.08
