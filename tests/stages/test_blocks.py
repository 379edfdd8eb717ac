"""Stages on maps in blocks of any height give, cell by cell, the results on maps in memory."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from mapdeal import Footprint, MapdealError, OccupancyGrid
from mapdeal.grid.canvas import frames_overlap
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pipeline.step import grid_of
from mapdeal.stages.catalogue import STAGES
from strategies import occupancies

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]
SPREADS = {"inflation": {"inscribed_radius": 0.2, "inflate_around_unknown": True}}

# The parameters that are drawn, for each stage and model.
DRAWN = {
    ("active", None): {"margin": [0.0, 0.3], "canvas": ["crop", "full"], "min_component": [0, 3]},
    ("clean", None): {"min_obstacle": [0, 3], "min_hole": [1, 10], "min_free": [0, 100]},
    ("window", None): {
        "size_xy": [(1.0, 0.5), (30.0, 2.0)], "corner_xy": [(1.5, -2.0), (0.3, 1.1), (99.0, 0.0)],
        "default": [None, 7],
    },
    ("shift", None): {"origin_xy": [(1.5, -2.0), (1.8, -1.0), (99.0, 0.0)], "default": [None, 7]},
    ("rotate", None): {"yaw": [0.0, 0.3, 1.5708], "rule": ["area", "nearest"]},
    ("rescale", None): {"resolution": [0.5, 0.07], "rule": ["area", "nearest"]},
    ("inflate", None): {
        "radius": [0.0, 0.3, 1.0, 50.0], "kernel": ["disc", "square"],
        "lethal_threshold": [50, 100], "inflate_unknown": [True, False],
    },
    ("esdf", None): {
        "unknown": ["free", "occupied"], "convention": ["fast-planner", "center", "border"],
        "max_distance": [None, 0.5, 3.0], "lethal_threshold": [50, 100], "strength": [1.0, 2.5],
    },
    ("potential", None): {"goal": [None, (1.5, -2.0)], "lethal_threshold": [None, 50]},
    ("cost", "exponential"): {
        "inscribed_radius": [0.2], "circumscribed_radius": [0.4],
        "inflation_radius": [0.2, 0.55, 3.0], "cost_scaling_factor": [0.0, 1.0, 10.0],
        "inflate_unknown": [True, False], "inflate_around_unknown": [True, False],
        "trinary_costmap": [True, False], "track_unknown_space": [True, False],
        "inscribed_obstacle_cost_value": [None, 50, 99], "lookup": ["exact", "nav2"],
        "float32_resolution": [None, True],
    },
    ("cost", "threshold"): {
        "down": [20.0, 40.0], "up": [60.0], "down_factor": [0.5], "view": ["per-map", "metric"],
    },
    ("cost", "layers"): {
        "layers": [(), ("static", "inflation"), ("static", SPREADS, SPREADS),
                   (SPREADS, {"static": {"use_maximum": True}}, SPREADS)],
        "default_cost": [0, 255], "circumscribed_radius": [0.4],
    },
    ("reach", None): {
        "start": [None, (1.5, -2.0)], "radius": [0.0, 0.3], "headings": [8],
        "footprint": [None, Footprint.polygon([[0.3, 0.1], [-0.2, 0.1], [-0.2, -0.1]])],
        "through_unknown": [True, False], "lethal_threshold": [None, 50], "min_area": [0.1],
    },
    ("cost", "rings"): {"values": [(60,), (90, 70, 50, 30, 10)]},
}  # fmt: skip
FIELDS = DRAWN["esdf", None]


def in_blocks(grid, block_height):
    values = grid.occupancy
    layer = lazy_layer(grid.shape, np.int8, values.__getitem__, block_height=block_height)
    return OccupancyGrid(layer, grid.resolution, grid.origin)


def assert_same(expected, blocks, step):
    assert (type(expected), expected.frame) == (type(blocks), blocks.frame)
    assert expected.figures() == blocks.figures()
    for name in expected.layer_names:
        rows, layer = getattr(expected, name), getattr(blocks, name)
        pieces = [layer[first : first + step] for first in range(0, len(rows), step)]
        assert np.vstack(pieces).dtype == rows.dtype
        assert np.array_equal(np.vstack(pieces), rows), name


def outcome(function, *arguments, **parameters):
    try:
        return function(*arguments, **parameters)
    except MapdealError as error:
        return str(error)


@st.composite
def cases(draw):
    """A map, how it is cut, and how its layers are asked for."""
    occupancy = draw(occupancies(longest=24))
    if draw(st.booleans()):  # walls: what a stage does to them depends on more than neighbours
        rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        for value in (100, 100, 0, 100, -1):
            row, col = rng.integers(0, occupancy.shape)
            occupancy[row : row + rng.integers(1, 9), col : col + rng.integers(1, 9)] = value
    grid = OccupancyGrid(occupancy, draw(st.sampled_from([0.05, 0.25, 1.0])), (1.5, -2.0, 0.4))
    return grid, draw(st.integers(1, 26)), draw(st.integers(1, 26))


def drawn(choices):
    return st.fixed_dictionaries({name: st.sampled_from(some) for name, some in choices.items()})


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: f"{stage.name} {stage.model or ''}")
@given(data=st.data())
def test_every_stage_on_maps_and_fields(stage, data):
    grid, block_height, step = data.draw(cases())
    chosen = data.draw(drawn(DRAWN[stage.name, stage.model]))
    in_memory, blocks = grid, in_blocks(grid, block_height)
    if mapdeal.DistanceField in stage.takes and data.draw(st.booleans()):
        of_field = data.draw(drawn(FIELDS))
        in_memory, blocks = (mapdeal.esdf(source, **of_field) for source in (in_memory, blocks))
    expected, found = (outcome(stage.function, source, **chosen) for source in (in_memory, blocks))
    if isinstance(expected, str):
        assert found == expected
        return
    expected, found = grid_of(expected), grid_of(found)
    assert found.is_lazy != stage.is_whole({**dict.fromkeys(stage.parameters), **chosen}) or (
        stage.name == "active"  # only the search for its box needs all rows
        or (stage.moves and not frames_overlap(grid.frame, found.frame))
        or found is blocks
    )
    assert_same(expected, found, step)
    assert getattr(expected, "scale", None) == getattr(found, "scale", None)
    assert getattr(expected, "circumscribed_cost", 0) == getattr(found, "circumscribed_cost", 0)


@given(cases(), drawn(FIELDS), st.sampled_from(["per-map", "metric"]), occupancies(longest=9))
def test_views_of_fields_and_keepout_masks(case, parameters, view, values):
    grid, block_height, step = case
    sources = grid, in_blocks(grid, block_height)
    mask = OccupancyGrid(values, 2 * grid.resolution, (1.6, -1.9, 0.3))
    for make in (
        lambda source: mapdeal.field_view(mapdeal.esdf(source, **parameters), view=view),
        lambda source: mapdeal.apply_keepout_mask(mapdeal.exponential_cost(source), mask),
        lambda source: mapdeal.apply_keepout_mask(mapdeal.ring_cost(source), mask),
    ):
        assert_same(*map(make, sources), step)
