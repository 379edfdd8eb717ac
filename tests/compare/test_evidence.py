"""Evidence of several maps, against the map that all beams make together; refusals of merge."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import BeamLimits, MapBuilder, OccupancyGrid, ParameterError, Scans, Transform, merge
from mapdeal.compare.align import placed
from mapdeal.grid.frame import Frame
from strategies import examples

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")

FRAME = Frame(14, 17, 0.25, (1.5, -2.0, 0.0))


def scans(seed, count=6, beams=9):
    rng = np.random.default_rng(seed)
    poses = np.stack([
        rng.uniform(1.6, 5.6, count), rng.uniform(-1.9, 1.4, count), rng.uniform(-4, 4, count)
    ], axis=1)  # fmt: skip
    return Scans(poses, np.linspace(-2, 2, beams), rng.uniform(0.2, 2.0, (count, beams)))


def built(method, *parts):
    # of 216 beams at most, none of which weighs so much that the bounds 0 and 100 are reached
    small = {"log_free": -0.125, "log_occ": 0.25} if method == "log-odds" else {}
    builder = MapBuilder(FRAME, method, BeamLimits(), **small)
    for part in parts:
        builder.add(part)
    return builder.result()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["log-odds", "counting"])
@given(st.lists(st.integers(0, 999), min_size=2, max_size=4))
@examples(12)
def test_maps_of_some_scans_each_merge_into_the_map_of_all(method, seeds):
    parts = [scans(seed) for seed in seeds]
    each = [built(method, part) for part in parts]
    together = built(method, *parts)
    maps, layers = [built.grid for built in each], [built.layers for built in each]
    merged = merge(maps, rule="evidence", evidence=layers)
    sums = merged.log_odds
    # An even sum is a matter of taste: where the maps differ, an obstacle is kept.
    even = sums == 50
    np.testing.assert_array_equal(merged.grid.occupancy[~even], together.grid.occupancy[~even])
    largest = np.max([built.grid.occupancy for built in each], axis=0)
    np.testing.assert_array_equal(merged.grid.occupancy[even], largest[even])
    assert np.array_equal(np.isnan(sums), merged.grid.occupancy == -1)
    if method == "log-odds":
        known = ~np.isnan(sums)
        np.testing.assert_array_equal(sums[known], together.layers["log_odds"][known])


@given(
    hits=st.lists(st.integers(0, 40), min_size=2, max_size=5),
    misses=st.lists(st.integers(0, 99), min_size=5, max_size=5),
    order=st.randoms(),
)
def test_hits_decide_above_the_share_that_counting_has(hits, misses, order):
    layers = [
        {"hits": np.array([[hit]]), "misses": np.array([[miss]])}
        for hit, miss in zip(hits, misses, strict=False)
    ]
    order.shuffle(layers)
    known = [0 if layer["hits"] + layer["misses"] else -1 for layer in layers]
    maps = [OccupancyGrid([[state]], 0.3, (1.0, 2.0, 0.7)) for state in known]
    value = merge(maps, rule="evidence", evidence=layers).grid.occupancy[0, 0]
    all_hits, visits = sum(hits), sum(hits) + sum(misses[: len(hits)])
    if not visits:
        assert value == -1
    else:
        assert value == (100 if Fraction(all_hits, visits) > Fraction(3, 10) else 0)


def test_evidence_moves_with_its_map():
    """A quarter turn: the layers of the second map are read where its cells come to lie."""
    first = OccupancyGrid([[0, 0, 0], [0, 0, 0]], 0.5, (1.0, 2.0, 0.0))
    odds = np.array([[10.0, 20.0], [np.nan, 90.0], [30.0, 55.0]])
    second = OccupancyGrid([[0, 0], [-1, 100], [0, 100]], 0.5, (0.0, 0.0, 0.0))
    # the second map's x points to the first's y, and its corner lies at (2.5, 2)
    merged = merge(
        [first, second], transforms=[Transform(2.5, 2.0, np.pi / 2).inverse()], rule="evidence",
        evidence=[{"log_odds": np.full((2, 3), 50.0)}, {"log_odds": odds}],
    )  # fmt: skip
    assert merged.grid.origin == first.origin
    assert merged.log_odds.tolist() == [[30.0, 50.0, 10.0], [55.0, 90.0, 20.0]]
    assert merged.grid.occupancy.tolist() == [[0, 0, 0], [100, 100, 0]]


def test_layers_without_hits_are_votes():
    grids = [OccupancyGrid([[100, 0]], 0.5), OccupancyGrid([[0, 0]], 0.5)]
    evidence = [{"tsdf": np.zeros((1, 2))}, {"log_odds": [[49.5, 49.5]]}]
    with pytest.warns(match="map 1: has no evidence layers"):
        merged = merge(grids, rule="evidence", evidence=evidence)
    assert merged.log_odds.tolist() == [[50.5, 48.5]]


GRID = grid_from_text("..#\n...")
COSTS = mapdeal.exponential_cost(GRID, inscribed_radius=0.1, inflation_radius=0.3)
ROW = OccupancyGrid([[100, 0]], 0.5)
EVIDENCE = np.array([[1, 2]])


@pytest.mark.parametrize(("maps", "options", "message"), [
    ([], {}, "^maps: takes two maps or more, got "),
    ([GRID], {}, "^maps: takes two maps or more, got "),
    *[([GRID, odd], {}, "^map 2: is not a map")
      for odd in (COSTS, mapdeal.esdf(GRID), mapdeal.field_view(mapdeal.esdf(GRID)))],
    ([GRID, np.zeros((2, 3))], {}, "^map 2: must be a file or a grid"),
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
