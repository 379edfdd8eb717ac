"""Tables of basins and poses are claimed before they are made, with their true lengths."""

import numpy as np
import pytest

from mapdeal import MalformedInputError
from mapdeal.files.source import claimed, use_memory
from mapdeal.kernels.components import BYTES_OF_BASIN
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.paths import clearance_tree, open_poses
from mapdeal.kernels.polygons import Spans
from mapdeal.kernels.threads import claim_tables, tables_claimed


def claims_of(work):
    sizes = []
    with tables_claimed(sizes.append):
        work()
    return sizes


CHECKERBOARD = np.indices((9, 14)).sum(axis=0) % 2 == 0
CORRIDOR = np.arange(3)[:, np.newaxis].repeat(40, axis=1) != 1


@pytest.mark.parametrize(("closed", "count"), [(CHECKERBOARD, 9 * 7), (CORRIDOR, 1)])
def test_each_free_cell_of_a_checkerboard_is_a_basin_and_a_corridor_is_one(closed, count):
    squared = squared_distance(closed)
    (size,) = claims_of(lambda: clearance_tree(squared, ~closed))
    assert size == BYTES_OF_BASIN * count


@pytest.mark.skipif(engine_name() != "compiled", reason="scipy's planes are of bytes")
def test_poses_of_narrow_maps_are_claimed_in_words():
    point = Spans(np.array([0]), np.array([0]), np.array([1]))
    sizes = claims_of(lambda: open_poses(np.zeros((50, 4), np.bool_), [point] * 8, None))
    assert sizes == [50 * 8 * 8 - 8 * 50 * 4 // 8]  # words of 64 cells, less a bit for each cell


def test_tables_count_beside_what_was_claimed_before():
    with use_memory(60_000_000), claimed("m.yaml", 6_000_000, what="cells"):
        claim_tables(3_000_000)
        with pytest.raises(MalformedInputError, match=r"cells need 61 MB .* 60 MB may be used"):
            claim_tables(5_000_000)
    claim_tables(1 << 60)  # nobody limits them any more
