"""What cannot be merged or aligned."""

import math

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import OccupancyGrid, ParameterError, Transform, esdf, field_view, merge
from mapdeal.compare.align import placed

GRID = grid_from_text("..#\n...")
COSTS = mapdeal.exponential_cost(GRID, inscribed_radius=0.1, inflation_radius=0.3)
ROW = OccupancyGrid([[100, 0]], 0.5)
EVIDENCE = np.array([[1, 2]])


@pytest.mark.parametrize(("maps", "options", "message"), [
    ([], {}, "^maps: takes two maps or more, got "),
    ([GRID], {}, "^maps: takes two maps or more, got "),
    *[([GRID, odd], {}, "^map 2: is not a map")
      for odd in (COSTS, esdf(GRID), field_view(esdf(GRID)))],
    ([GRID, np.zeros((2, 3))], {}, "takes files or grids"),
    ([GRID, GRID], {"rule": "oldest"}, "^rule: must be one of occupied, newest, evidence"),
    ([GRID, GRID], {"transforms": [None] * 2}, "^transforms: must be 1, one for each map except"),
    ([GRID, GRID], {"transforms": [Transform(1e12, 1e12, 0.3)]}, "must be a finite number"),
    ([GRID, GRID.with_values(GRID.occupancy, (1e9, 0.0, 0.0))], {},
     "^map 1: origin: the maps lie too far apart: "),
    ([ROW, ROW], {"evidence": [None, None]}, "^evidence: is for rule evidence alone"),
    ([ROW, ROW], {"rule": "evidence", "evidence": [None]},
     "^evidence: must be 2, one for each map, got 1"),
    *[([ROW, ROW], {"rule": "evidence", "evidence": [None, layers]}, f"^map 2: {message}")
      for layers, message in [
          ({"log_odds": np.zeros((2, 1))}, "log_odds: must be of the map's 2 x 1 cells"),
          ({"hits": EVIDENCE}, "misses: is missing"),
          ({"hits": EVIDENCE, "misses": -EVIDENCE}, r"misses: must lie in 0..1e\+09, got -1"),
          ({"hits": EVIDENCE * np.nan, "misses": EVIDENCE}, "hits: must lie in .*, got nan"),
          ({"log_odds": EVIDENCE * np.inf}, "log_odds: must lie in .*, got inf"),
          ({"log_odds": np.array([["a", "b"]])}, "log_odds: must be numbers, got '<U1'"),
      ]],
])  # fmt: skip
def test_what_cannot_be_merged_is_refused(maps, options, message):
    with pytest.raises(ParameterError, match=message):
        merge(maps, **options)


@pytest.mark.parametrize("rotations", [[], [math.nan], [math.inf]])
def test_invalid_rotations_are_refused(rotations):
    with pytest.raises(ParameterError, match="rotations"):
        placed(GRID, GRID, rotations=rotations)
