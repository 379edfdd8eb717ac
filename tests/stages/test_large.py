"""Stages on maps by slabs give, cell by cell, what they give on maps in memory.

Those have oracles of their own. Slabs have any height, and layers are asked for in pieces of any
other height.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mapdeal
from drawn import cells
from mapdeal import MapdealError, MapdealWarning, OccupancyGrid, ParameterError
from mapdeal.grid.large import LargeField, LargeMap
from mapdeal.kernels.rows import MadeRows
from mapdeal.stages import large
from strategies import occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")

ACTIVE = {"margin": 0.0, "canvas": "crop", "min_component": 1}
INFLATE = {
    "radius": 0.3, "footprint": None, "kernel": "disc", "lethal_threshold": 100,
    "inflate_unknown": True,
}  # fmt: skip
ESDF = {
    "unknown": "free", "convention": "seed", "max_distance": None, "lethal_threshold": 100,
    "strength": 1.0,
}  # fmt: skip
EXPONENTIAL = {
    "inscribed_radius": 0.2, "inflation_radius": 0.55, "cost_scaling_factor": 10.0,
    "inflate_unknown": False, "inflate_around_unknown": False, "lethal_threshold": None,
    "circumscribed_radius": 0.4,
}  # fmt: skip
THRESHOLD = {
    "down": 40.0, "up": 60.0, "down_factor": 0.5, "up_factor": 1.5, "view": "seed",
    "view_range": 2.0, "lethal_threshold": None,
}  # fmt: skip


def by_slabs(grid, together):
    def make(first, end):
        return grid.occupancy[first:end]

    layer = MadeRows(grid.shape, np.int8, make, together=together)
    return LargeMap(layer, grid.resolution, grid.origin)


def assert_same(whole, slabs, step):
    assert (whole.shape, whole.resolution, whole.origin) == (
        slabs.shape, slabs.resolution, slabs.origin
    )  # fmt: skip
    names = [name for name in ("occupancy", "distance", "cost") if hasattr(whole, name)]
    assert names
    for name in names:
        expected, layer = getattr(whole, name), getattr(slabs, name)
        pieces = [layer[first : first + step] for first in range(0, whole.shape[0], step)]
        assert np.vstack(pieces).dtype == expected.dtype
        assert np.array_equal(np.vstack(pieces), expected), name


def outcome(function, *arguments, **parameters):
    try:
        return function(*arguments, **parameters)
    except MapdealError as error:
        return str(error)


@st.composite
def cases(draw):
    """A map, how it is cut, and how its layers are asked for."""
    occupancy = draw(occupancies(longest=24))
    grid = OccupancyGrid(occupancy, draw(st.sampled_from([0.05, 0.25, 1.0])), (1.5, -2.0, 0.4))
    return grid, draw(st.integers(1, 26)), draw(st.integers(1, 26))


def changed(base, **changes):
    """Parameters with some of them drawn."""
    return st.fixed_dictionaries(
        {**{k: st.just(v) for k, v in base.items()},
         **{k: st.sampled_from(v) for k, v in changes.items()}}
    )  # fmt: skip


@given(cases(), changed(ACTIVE, margin=[0.0, 0.3], canvas=["crop", "full"]))
def test_active(case, parameters):
    grid, together, step = case
    whole = outcome(mapdeal.active_region, grid, **parameters)
    slabs = outcome(large.large_active_region, by_slabs(grid, together), **parameters)
    if isinstance(whole, str):
        assert slabs == whole
    else:
        assert_same(whole, slabs, step)


@given(
    cases(),
    changed(
        INFLATE,
        radius=[0.0, 0.3, 1.0, 50.0],
        kernel=["disc", "square"],
        lethal_threshold=[50, 100],
        inflate_unknown=[True, False],
    ),
)
def test_inflate(case, parameters):
    grid, together, step = case
    whole = mapdeal.inflate(grid, **parameters)
    assert_same(whole, large.large_inflate(by_slabs(grid, together), **parameters), step)


FIELDS = changed(
    ESDF,
    unknown=["free", "occupied"],
    convention=["seed", "center", "border"],
    max_distance=[None, 0.5, 3.0],
    lethal_threshold=[50, 100],
    strength=[1.0, 2.5],
)


@given(cases(), FIELDS, st.sampled_from(["seed", "metric"]))
def test_field_and_its_view(case, parameters, view):
    grid, together, step = case
    whole = mapdeal.esdf(grid, **parameters)
    slabs = large.large_esdf(by_slabs(grid, together), **parameters)
    assert_same(whole, slabs, step)
    assert_same(
        mapdeal.field_view(whole, view=view, view_range=2.0),
        large.large_field_view(slabs, view=view, view_range=2.0),
        step,
    )


COSTS = {
    "exponential": (
        mapdeal.exponential_cost,
        large.large_exponential_cost,
        changed(
            EXPONENTIAL,
            inflation_radius=[0.2, 0.55, 3.0],
            cost_scaling_factor=[0.0, 1.0, 10.0],
            inflate_unknown=[True, False],
            inflate_around_unknown=[True, False],
        ),
    ),
    "rings": (
        mapdeal.ring_cost,
        large.large_ring_cost,
        changed({"lethal_threshold": None}, values=[(60,), (90, 70, 50, 30, 10)]),
    ),
    "threshold": (
        mapdeal.threshold_cost,
        large.large_threshold_cost,
        changed(THRESHOLD, view=["seed", "metric"], down=[20.0, 40.0]),
    ),
}


@pytest.mark.parametrize(("in_memory", "in_slabs", "parameters"), COSTS.values(), ids=COSTS)
@settings(max_examples=60)
@given(data=st.data())
def test_costs_of_maps_and_of_fields(in_memory, in_slabs, parameters, data):
    grid, together, step = data.draw(cases())
    chosen = data.draw(parameters)
    source, slabs = grid, by_slabs(grid, together)
    if data.draw(st.booleans()):
        of_field = data.draw(FIELDS)
        source, slabs = mapdeal.esdf(source, **of_field), large.large_esdf(slabs, **of_field)
    whole = outcome(in_memory, source, **chosen)
    cut = outcome(in_slabs, slabs, **chosen)
    if isinstance(whole, str):
        assert cut == whole
    else:
        assert_same(whole, cut, step)
        assert getattr(whole, "scale", None) == getattr(cut, "scale", None)
        if in_memory is mapdeal.exponential_cost:
            assert cut.circumscribed_cost == whole.circumscribed_cost


@settings(max_examples=40)
@given(cases(), FIELDS)
def test_a_chain_of_all_stages(case, of_field):
    grid, together, step = case
    whole, slabs = grid, by_slabs(grid, together)
    if (grid.occupancy == -1).all():
        return
    whole = mapdeal.active_region(whole, **ACTIVE)
    slabs = large.large_active_region(slabs, **ACTIVE)
    whole, slabs = mapdeal.inflate(whole, **INFLATE), large.large_inflate(slabs, **INFLATE)
    whole, slabs = mapdeal.esdf(whole, **of_field), large.large_esdf(slabs, **of_field)
    assert_same(whole, slabs, step)
    costs = outcome(mapdeal.exponential_cost, whole, **EXPONENTIAL)
    in_slabs = outcome(large.large_exponential_cost, slabs, **EXPONENTIAL)
    if isinstance(costs, str):  # the field is clipped below their reach
        assert in_slabs == costs
    else:
        assert_same(costs, in_slabs, step)


def test_parts_of_a_field_know_its_parameters():
    slabs = by_slabs(OccupancyGrid(cells("..#\n?..\n...\n..+"), 0.5), 3)
    field = large.large_esdf(slabs, **{**ESDF, "unknown": "occupied", "lethal_threshold": 50})
    assert isinstance(field, LargeField)
    part = field.part(slice(0, 2))
    assert (part.unknown, part.lethal_threshold) == ("occupied", 50)
    assert np.array_equal(field.obstacles()[0:4], cells("..#\n#..\n...\n..#") == 100)
    assert field.frame.shape == (4, 3)


def test_groups_of_cells_cannot_be_counted_by_slabs():
    with pytest.raises(ParameterError, match="does not fit into memory"):
        large.large_active_region(
            by_slabs(OccupancyGrid(cells("..#"), 0.5), 1), **{**ACTIVE, "min_component": 4}
        )


@pytest.mark.parametrize(
    ("drawing", "parameters", "text"),
    [("..#..\n.....\n.....", {"radius": 0.1}, "no effect"), ("..#\n...", {"radius": 9.0}, "free")],
)
def test_warnings_are_those_of_maps_in_memory(drawing, parameters, text):
    grid = OccupancyGrid(cells(drawing), 0.5)
    texts = []
    for stage, source in ((mapdeal.inflate, grid), (large.large_inflate, by_slabs(grid, 1))):
        with pytest.warns(MapdealWarning, match=text) as caught:
            stage(source, **{**INFLATE, **parameters})
        texts.append([str(one.message) for one in caught])
    assert texts[0] == texts[1]
