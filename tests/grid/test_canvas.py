"""Grids on a larger canvas, held to `numpy.pad`, and fields that have numbers in a box alone."""

import dataclasses
import itertools
from copy import copy

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import DistanceField, OccupancyGrid, ParameterError, PotentialField, Reach
from mapdeal.grid.canvas import frames_overlap, on_canvas
from mapdeal.grid.frame import Frame
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.stages.catalogue import STAGES
from strategies import RESOLUTIONS, examples, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")
OUTSIDE = {"i": -1, "u": 255, "f": np.nan}
"""Values around a grid by the type of a layer's numbers: the rule of the contract."""
NOT_REACHED = {"reachable": 0, "headings": 0, "widest": 0.0, "cost_to_go": np.inf}
WALL = grid_from_text("#...?\n#....\n##..#", 0.25, (1.5, -2.0, 0.4))


def padded(array, margins, outside=None):
    south, north, west, east = margins
    axes = [(0, 0)] * (array.ndim - 2) + [(south, north), (west, east)]
    value = OUTSIDE[array.dtype.kind] if outside is None else outside
    return np.pad(array, axes, constant_values=value)


def arrays_of(grid):
    return {k: v for k, v in grid.entries().items() if np.shape(v)[-2:] == grid.shape}


def assert_padded(extended, part, margins):
    assert type(extended) is type(part)
    layers = arrays_of(part)
    assert arrays_of(extended).keys() == layers.keys()
    for name, layer in layers.items():
        found = np.asarray(arrays_of(extended)[name])
        assert found.dtype == layer.dtype
        expected = padded(np.asarray(layer), margins, NOT_REACHED.get(name))
        np.testing.assert_array_equal(found, expected, err_msg=name)
    for name in (*part.parameter_names, "convention", "scale", "circumscribed_cost", "goal"):
        assert getattr(extended, name, None) == getattr(part, name, None)


def kinds_of(grid, goal=(1.6, -1.9)):
    yield grid
    field = mapdeal.esdf(grid, unknown="occupied", strength=1.5)
    yield field
    yield mapdeal.exponential_cost(field, inscribed_radius=0.1, circumscribed_radius=0.3)
    yield mapdeal.ring_cost(grid)
    yield PotentialField(np.abs(field.distance).astype(float).clip(0, 9), grid.occupancy,
                         grid.resolution, grid.origin, goal=goal)  # fmt: skip
    yield PotentialField(np.ones(grid.shape), grid.occupancy, grid.resolution, grid.origin)
    some, metres = (grid.occupancy == 0).astype(np.uint8), np.abs(field.distance).clip(0, 9)
    yield Reach(some, 7 * some, metres, metres * some, grid.occupancy, grid.resolution,
                grid.origin, start=goal, heading_count=7)  # fmt: skip


MARGINS = st.tuples(*[st.integers(0, 5)] * 4)


@given(occupancies(longest=7), RESOLUTIONS, st.sampled_from([0.0, 0.4, -2.5]), MARGINS)
def test_every_kind_of_grid_is_padded(occupancy, resolution, yaw, margins):
    frame = margins_of(Frame(*occupancy.shape, resolution, (1.5, -2.0, yaw)), margins)
    part = frame.window(margins[0], margins[2], *occupancy.shape)
    kinds = list(kinds_of(OccupancyGrid(occupancy, resolution, part.origin)))
    assert {type(grid) for grid in kinds} == {stage.product_type for stage in STAGES}
    for grid in kinds:
        extended = on_canvas(grid, frame)
        assert (extended.frame, extended.origin) == (frame, frame.origin)
        assert_padded(extended, grid, margins)


@examples(20)
@given(occupancies(longest=9), MARGINS, st.integers(1, 5), st.integers(1, 6))
def test_lazy_layers_are_padded_rows_by_rows(occupancy, margins, block_height, step):
    part = OccupancyGrid(occupancy, 0.1, (1.5, -2.0, 0.4))
    layer = lazy_layer(part.shape, np.int8, occupancy.__getitem__, block_height=block_height)
    frame = margins_of(part.frame, margins)
    known = mapdeal.esdf(part, unknown="occupied")
    field = mapdeal.esdf(OccupancyGrid(layer, 0.1, part.origin), unknown="occupied")
    costs = [mapdeal.exponential_cost(source, inscribed_radius=0.1) for source in (field, known)]
    for lazy, whole_part in ((field, known), costs):
        extended = on_canvas(lazy, frame)
        assert extended.is_lazy
        for name in whole_part.layer_names:
            rows = [getattr(extended, name)[k : k + step] for k in range(0, frame.height, step)]
            expected = padded(np.asarray(getattr(whole_part, name)), margins)
            np.testing.assert_array_equal(np.vstack(rows), expected)
        assert extended.figures() == on_canvas(whole_part, frame).figures()
    extended = on_canvas(field, frame)
    mask = padded(np.isin(occupancy, (-1, 100)).astype(np.int8), margins, outside=0)
    np.testing.assert_array_equal(np.asarray(extended.obstacles()), mask == 1)
    expected = padded(np.asarray(mapdeal.field_view(field).occupancy), margins)
    np.testing.assert_array_equal(np.asarray(mapdeal.field_view(extended).occupancy), expected)


def test_another_value_around_a_map():
    extended = on_canvas(WALL, margins_of(WALL.frame, (0, 1, 2, 0)), fill=100)
    assert extended.occupancy[-1].tolist() == [100] * 7
    assert extended.occupancy[0].tolist() == [100, 100, 100, 100, 0, 0, 100]


FIELD_STAGES = [stage for stage in STAGES if DistanceField in stage.takes]
INFLATED = {"inflate_unknown": True, "inflate_around_unknown": True}
CHOSEN = {
    "exponential": {"inscribed_radius": 0.3, **INFLATED}, "rings": {"values": (90, 70, 50)},
    "threshold": {"view": "per-map", "down": 10, "up": 40}, "potential": {"goal": (9.5, -7.0)},
    "layers": {"layers": ["static", {"inflation": {"inflation_radius": 0.8}}]},
    "reach": {"radius": 0.2, "min_area": 0.1},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("stage", FIELD_STAGES, ids=lambda stage: f"{stage.name} {stage.model}")
@examples(20)
@given(occupancies(longest=8), MARGINS, st.fixed_dictionaries({
    "unknown": st.sampled_from(["free", "occupied"]), "strength": st.just(2.0),
    "convention": st.sampled_from(["fast-planner", "border"]),
}))  # fmt: skip
def test_a_stage_makes_of_it_what_it_makes_of_the_box(stage, occupancy, margins, about):
    frame = margins_of(Frame(*occupancy.shape, 0.25, (1.5, -2.0, 0.4)), margins)
    origin = frame.window(margins[0], margins[2], *occupancy.shape).origin
    field = mapdeal.esdf(OccupancyGrid(occupancy, 0.25, origin), **about)
    extended = on_canvas(field, frame)
    # as a file has it: nothing but arrays
    layers = np.array(extended.distance), np.array(extended.occupancy)
    again = DistanceField(*layers, extended.resolution, extended.origin, **about)
    chosen = CHOSEN[stage.model or stage.name]
    assume(stage.name != "reach" or (not field.obstacles().all() and (occupancy == 0).any()))
    product = stage.function(field, **chosen)
    view = mapdeal.field_view(field, view="per-map").occupancy
    for grid in (extended, again):
        assert_padded(stage.function(grid, **chosen), product, margins)
        found = mapdeal.field_view(grid, view="per-map").occupancy
        np.testing.assert_array_equal(found, padded(view, margins))
        obstacles = padded(field.obstacles().astype(np.int8), margins)
        np.testing.assert_array_equal(grid.obstacles(), obstacles == 1)


@given(occupancies(longest=6), MARGINS, st.integers(0, 2**32 - 1))
def test_points_in_the_box_are_answered_as_if_there_were_nothing_else(occupancy, margins, seed):
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    field = mapdeal.esdf(grid)
    extended = on_canvas(field, margins_of(grid.frame, margins))
    places = np.random.default_rng(seed).random((50, 2)) * (12, 12) - 3
    points = grid.frame.xy_from_continuous_rowcol(places)
    expected, found = field.query(points), extended.query(points)
    in_box = ((places >= 0) & (places < grid.shape)).all(axis=1)
    for name in ("distance", "gradient"):
        values = getattr(found, name)
        np.testing.assert_allclose(values, getattr(expected, name), atol=1e-6)
        assert np.isnan(values[~in_box]).all()
    south, north, west, east = margins
    low, high = (-south, -west), (grid.shape[0] + north, grid.shape[1] + east)
    np.testing.assert_array_equal(found.inside, ((places >= low) & (places < high)).all(axis=1))


def test_figures_are_of_the_cells_that_have_a_distance():
    field = mapdeal.esdf(WALL)
    extended = on_canvas(field, margins_of(WALL.frame, (1, 2, 3, 4)))
    own = {"width": 12, "height": 6, "origin": list(extended.origin)}
    assert extended.figures() == {**field.figures(), **own, "without_value": 6 * 12 - 3 * 5}
    free = mapdeal.esdf(grid_from_text("..\n..", 0.5))
    figures = on_canvas(free, margins_of(free.frame, (1, 0, 0, 0))).figures()
    assert (figures["lowest_distance"], figures["without_value"]) == (None, 2)


@pytest.mark.parametrize(("distance", "occupancy", "message"), [
    ("nnn nnn", "??? ???", "nan everywhere"),
    ("n12 123", "?.. ...", "around one box"), ("1n2 123", ".?. ...", "around one box"),
    *[("nnn n12", f"??{cell} ?..", "where the map is unknown") for cell in ".#"],
])  # fmt: skip
def test_nan_anywhere_else_is_refused(distance, occupancy, message):
    values = [[np.nan if v == "n" else float(v) for v in row] for row in distance.split()]
    known = [[{"?": -1, ".": 0, "#": 100}[v] for v in row] for row in occupancy.split()]
    with pytest.raises(ParameterError, match=f"distance .*{message}"):
        DistanceField(values, known, 0.1)
    with pytest.raises(ParameterError, match=f"repulsive .*{message}"):
        PotentialField(values, known, 0.1)


def test_parts_of_a_field_know_their_part_of_the_box():
    distance = np.full((5, 4), np.nan, np.float32)
    distance[1:3, 1:3] = [[1.0, 2.0], [3.0, 4.0]]
    occupancy = np.where(np.isnan(distance), -1, 0).astype(np.int8)
    field = DistanceField(distance, occupancy, 0.5, (1.0, 2.0, 0.4))
    assert field.cropped.shape == (2, 2)  # what the whole keeps is not its rows'
    for first, end in itertools.combinations(range(6), 2):
        part = field.part(slice(first, end))
        rows = [row for row in (1, 2) if first <= row < end]
        assert part.region[1:] == (1, len(rows), 2)
        if rows:
            assert part.region.row == rows[0] - first
            assert np.array_equal(part.cropped.distance, distance[rows][:, 1:3])
            place = field.frame.window(rows[0], 1, len(rows), 2)
            assert part.cropped.origin == pytest.approx(place.origin, abs=1e-12)
    assert field.with_layer(2 * distance).cropped.distance.tolist() == [[2.0, 4.0], [6.0, 8.0]]


def test_grids_side_by_side_share_no_area_whatever_the_rounding():
    turned = Frame(3, 11, 1.0, (1.5, -2.0, 0.4))
    above = Frame(2, 30, 1.0, (0.3317449730740485, 0.7631829820086553, 0.4))  # begins at row 3
    assert not frames_overlap(turned, above)
    assert frames_overlap(turned, Frame(2, 30, 1.0, (0.33, 0.75, 0.4)))


def margins_of(frame, margins):
    south, north, west, east = margins
    height, width = frame.height + south + north, frame.width + west + east
    return frame.window(-south, -west, height, width)


@given(occupancies(), RESOLUTIONS)
@examples(60)
def test_grids_equal_what_would_be_written_the_same(occupancy, resolution):
    """Also around a box of numbers, where nan equals nan; another value or place differs."""
    grids = list(kinds_of(OccupancyGrid(occupancy, resolution)))
    for index, grid in enumerate(grids):
        assert grid.equals(copy(grid))
        extended = [on_canvas(grid, grid.frame.window(-1, 0, *np.add(grid.shape, 2))) for _ in "ab"]
        assert extended[0].equals(extended[1])
        assert not grid.equals(extended[0])
        assert not grid.equals(grid.layer)
        assert not grid.equals(dataclasses.replace(grid, resolution=resolution + 1))
        assert not any(grid.equals(other) for other in grids[:index])
