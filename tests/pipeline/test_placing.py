"""Maps that are placed by their walls, one on another."""

import numpy as np
import pytest

from compare.buildings import OTHER_WALLS, WALLS, between, cut, drawn, errors
from mapdeal import FindingError, Transform, merge

pytestmark = pytest.mark.slow
PLACES = [Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2), Transform(-8.0, 3.0, 1.1)]


def part(place, keep=np.isfinite):
    return cut(drawn(WALLS, 0.2, place), place, keep)


def test_a_map_that_only_overlaps_another_one_is_placed_by_that():
    west, middle, east = PLACES
    parts = [part(west, lambda x: x < 11), part(east, lambda x: x > 13), part(middle)]
    found = merge(parts, transforms="align").transforms
    for transform, place in zip(found[1:], (east, middle), strict=True):
        off, turn = errors(transform, between(west, place), parts[0])
        assert off < 0.15
        assert turn < 0.5


def test_a_map_of_another_place_is_named():
    grids = [part(PLACES[0]), part(PLACES[1]), drawn(OTHER_WALLS, 0.2)]
    with pytest.raises(FindingError, match=r"^map 3: its placement on map 1 or on another"):
        merge(grids, transforms="align")
