"""Maps that are placed by their walls, one on another."""

import numpy as np
import pytest

from compare.buildings import OTHER_WALLS, WALLS, between, cut, drawn, errors
from mapdeal import FindingError, Transform, merge

PLACES = [Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2), Transform(-8.0, 3.0, 1.1)]


def part(number, keep):
    place = PLACES[number]
    return cut(drawn(WALLS, 0.15, place), place, keep)


@pytest.mark.slow
def test_a_map_that_only_overlaps_another_one_is_placed_by_that():
    west, whole, east = (
        part(0, lambda x: x < 11),
        part(1, lambda x: np.isfinite(x)),
        part(2, lambda x: x > 13),
    )
    found = merge([west, east, whole], transforms="align").transforms
    for transform, number, grid in zip(found[1:], (2, 1), (east, whole), strict=True):
        off, turn = errors(transform, between(PLACES[0], PLACES[number]), west)
        assert off < 0.15
        assert turn < 0.5
        assert grid.occupied().any()


@pytest.mark.slow
def test_a_map_of_another_place_is_named():
    grids = [drawn(WALLS, 0.15, PLACES[0]), drawn(WALLS, 0.15, PLACES[1]), drawn(OTHER_WALLS, 0.15)]
    with pytest.raises(FindingError, match=r"^map 3: its placement on map 1 or on another"):
        merge(grids, transforms="align")
