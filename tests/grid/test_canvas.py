"""Grids on a larger canvas, held to `numpy.pad`, and fields that have numbers in a box alone."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import DistanceField, OccupancyGrid, ParameterError, PotentialField, Reach
from mapdeal.grid.canvas import frames_overlap, on_canvas
from mapdeal.grid.frame import Frame
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.stages.catalogue import STAGES
from strategies import RESOLUTIONS, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")

OUTSIDE = {"i": -1, "u": 255, "f": np.nan}
"""What is written around a grid, by the kind of number of a layer: the rule of the contract."""

NOT_REACHED = {"reachable": 0, "headings": 0, "widest": 0.0}
"""What says of a cell that no robot gets there."""

WALL = grid_from_text("#...?\n#....\n##..#", 0.25, (1.5, -2.0, 0.4))


def padded(array, margins, outside=None):
    """Pad the last two axes of an array by hand: south, north, west, east."""
    south, north, west, east = margins
    axes = [(0, 0)] * (array.ndim - 2) + [(south, north), (west, east)]
    value = OUTSIDE[array.dtype.kind] if outside is None else outside
    return np.pad(array, axes, constant_values=value)


def larger(frame, margins):
    south, north, west, east = margins
    height, width = frame.height + south + north, frame.width + west + east
    return frame.window(-south, -west, height, width)


def arrays_of(grid):
    return {k: v for k, v in grid.entries().items() if np.shape(v)[-2:] == grid.shape}


def assert_padded(whole, part, margins):
    """Hold a grid to the hand-padded layers of another, all that an npz has of it."""
    assert type(whole) is type(part)
    layers = arrays_of(part)
    assert arrays_of(whole).keys() == layers.keys()
    for name, layer in layers.items():
        found = np.asarray(arrays_of(whole)[name])
        assert found.dtype == layer.dtype
        expected = padded(np.asarray(layer), margins, NOT_REACHED.get(name))
        np.testing.assert_array_equal(found, expected, err_msg=name)
    for name in (*part.parameter_names, "convention", "scale", "circumscribed_cost", "goal"):
        assert getattr(whole, name, None) == getattr(part, name, None)


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


@settings(max_examples=60)
@given(occupancies(longest=7), RESOLUTIONS, st.sampled_from([0.0, 0.4, -2.5]), MARGINS)
def test_every_kind_of_grid_is_padded(occupancy, resolution, yaw, margins):
    frame = larger(Frame(*occupancy.shape, resolution, (1.5, -2.0, yaw)), margins)
    south, _, west, _ = margins
    part = frame.window(south, west, *occupancy.shape)
    for grid in kinds_of(OccupancyGrid(occupancy, resolution, part.origin)):
        whole = on_canvas(grid, frame)
        assert (whole.frame, whole.origin) == (frame, frame.origin)
        assert_padded(whole, grid, margins)


@settings(max_examples=40)
@given(occupancies(longest=9), MARGINS, st.integers(1, 5), st.integers(1, 6))
def test_lazy_layers_are_padded_rows_by_rows(occupancy, margins, block_height, step):
    part = OccupancyGrid(occupancy, 0.1, (1.5, -2.0, 0.4))
    layer = lazy_layer(part.shape, np.int8, occupancy.__getitem__, block_height=block_height)
    frame = larger(part.frame, margins)
    field = mapdeal.esdf(OccupancyGrid(layer, 0.1, part.origin), unknown="occupied")
    for lazy, known in (
        (field, mapdeal.esdf(part, unknown="occupied")),
        (mapdeal.exponential_cost(field, inscribed_radius=0.1),
         mapdeal.exponential_cost(mapdeal.esdf(part, unknown="occupied"), inscribed_radius=0.1)),
    ):  # fmt: skip
        whole = on_canvas(lazy, frame)
        assert whole.is_lazy
        for name in known.layer_names:
            rows = [getattr(whole, name)[k : k + step] for k in range(0, frame.height, step)]
            np.testing.assert_array_equal(
                np.vstack(rows), padded(np.asarray(getattr(known, name)), margins)
            )
        assert whole.figures() == on_canvas(known, frame).figures()
    whole = on_canvas(field, frame)
    south, _, west, _ = margins
    mask = np.zeros(frame.shape, dtype=bool)
    mask[south:, west:][: part.shape[0], : part.shape[1]] = occupancy != 0
    mask &= padded(occupancy, margins) != 50
    np.testing.assert_array_equal(np.asarray(whole.obstacles()), mask)
    view = mapdeal.field_view(whole)
    expected = padded(np.asarray(mapdeal.field_view(field).occupancy), margins)
    np.testing.assert_array_equal(np.asarray(view.occupancy), expected)


def test_another_value_around_a_map():
    whole = on_canvas(WALL, larger(WALL.frame, (0, 1, 2, 0)), fill=100)
    assert whole.occupancy[-1].tolist() == [100] * 7
    assert whole.occupancy[0].tolist() == [100, 100, 100, 100, 0, 0, 100]


# What is made of a field with numbers in a box alone.

FIELD_STAGES = [stage for stage in STAGES if DistanceField in stage.takes]
CHOSEN = {
    "exponential": {"inscribed_radius": 0.3, "inflate_unknown": True,
                    "inflate_around_unknown": True},
    "threshold": {"view": "per-map", "down": 10, "up": 40},
    "rings": {"values": (90, 70, 50)},
    "layers": {"layers": ["static", {"inflation": {"inflation_radius": 0.8}}]},
    "potential": {"goal": (9.5, -7.0)},
    "reach": {"radius": 0.2, "min_area": 0.1},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("stage", FIELD_STAGES, ids=lambda stage: f"{stage.name} {stage.model}")
@settings(max_examples=40)
@given(
    occupancies(longest=8), MARGINS, st.sampled_from(["free", "occupied"]),
    st.sampled_from(["fast-planner", "border"]),
)  # fmt: skip
def test_a_stage_makes_of_it_what_it_makes_of_the_box(
    stage, occupancy, margins, unknown, convention
):
    south, _, west, _ = margins
    frame = larger(Frame(*occupancy.shape, 0.25, (1.5, -2.0, 0.4)), margins)
    grid = OccupancyGrid(occupancy, 0.25, frame.window(south, west, *occupancy.shape).origin)
    field = mapdeal.esdf(grid, unknown=unknown, convention=convention, strength=2.0)
    whole = on_canvas(field, frame)
    # as a file has it: nothing but arrays
    again = DistanceField(
        np.array(whole.distance), np.array(whole.occupancy), whole.resolution, whole.origin,
        convention=convention, strength=2.0, unknown=unknown,
    )  # fmt: skip
    chosen = CHOSEN[stage.model or stage.name]
    assume(stage.name != "reach" or (not field.obstacles().all() and (occupancy == 0).any()))
    made = stage.function(field, **chosen)
    for one in (whole, again):
        assert_padded(stage.function(one, **chosen), made, margins)
        view = mapdeal.field_view(one, view="per-map").occupancy
        expected = mapdeal.field_view(field, view="per-map").occupancy
        np.testing.assert_array_equal(view, padded(expected, margins))
        np.testing.assert_array_equal(
            one.obstacles(), padded(field.obstacles().astype(np.int8), margins) == 1
        )


@given(occupancies(longest=6), MARGINS, st.integers(0, 2**32 - 1))
def test_points_in_the_box_are_answered_as_if_there_were_nothing_else(occupancy, margins, seed):
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    field = mapdeal.esdf(grid)
    whole = on_canvas(field, larger(grid.frame, margins))
    places = np.random.default_rng(seed).random((50, 2)) * (12, 12) - 3
    points = grid.frame.xy_from_continuous_rowcol(places)
    expected, found = field.query(points), whole.query(points)
    np.testing.assert_allclose(found.distance, expected.distance, atol=1e-6)
    np.testing.assert_allclose(found.gradient, expected.gradient, atol=1e-6)
    in_box = ((places >= 0) & (places < grid.shape)).all(axis=1)
    assert np.isnan(found.distance[~in_box]).all()
    assert np.isnan(found.gradient[~in_box]).all()
    south, north, west, east = margins
    low, high = (-south, -west), (grid.shape[0] + north, grid.shape[1] + east)
    np.testing.assert_array_equal(found.inside, ((places >= low) & (places < high)).all(axis=1))


def test_figures_are_of_the_cells_that_have_a_distance():
    field = mapdeal.esdf(WALL)
    whole = on_canvas(field, larger(WALL.frame, (1, 2, 3, 4)))
    assert whole.figures() == {
        **field.figures(), "width": 12, "height": 6, "origin": list(whole.origin),
        "without_value": 6 * 12 - 3 * 5,
    }  # fmt: skip
    free = mapdeal.esdf(grid_from_text("..\n..", 0.5))
    figures = on_canvas(free, larger(free.frame, (1, 0, 0, 0))).figures()
    assert (figures["lowest_distance"], figures["without_value"]) == (None, 2)


NAN = np.nan
BOX = [[NAN, NAN, NAN], [NAN, 1.0, 2.0]]


@pytest.mark.parametrize(
    ("distance", "occupancy", "said"),
    [
        ([[NAN, NAN, NAN]] * 2, [[-1] * 3] * 2, "nan everywhere"),
        ([[NAN, 1.0, 2.0], [1.0, 2.0, 3.0]], [[-1, 0, 0], [0, 0, 0]], "around one box"),
        ([[1.0, NAN, 2.0], [1.0, 2.0, 3.0]], [[0, -1, 0], [0, 0, 0]], "around one box"),
        (BOX, [[-1, -1, 0], [-1, 0, 0]], "where the map is unknown"),
        (BOX, [[-1, -1, 100], [-1, 0, 0]], "where the map is unknown"),
    ],
)
def test_nan_anywhere_else_is_refused(distance, occupancy, said):
    with pytest.raises(ParameterError, match=f"distance .*{said}"):
        DistanceField(distance, occupancy, 0.1)
    with pytest.raises(ParameterError, match=f"repulsive .*{said}"):
        PotentialField(distance, occupancy, 0.1)


def test_rows_of_a_field_know_their_part_of_the_box():
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


def test_every_kind_of_grid_is_here():
    assert {type(grid) for grid in itertools.islice(kinds_of(WALL), 9)} == {
        stage.makes for stage in STAGES
    }


def test_a_field_with_another_layer_has_that_one_in_its_box_too():
    distance = np.full((3, 4), np.nan, np.float32)
    distance[1, 1:3] = 1.0
    occupancy = np.where(np.isnan(distance), -1, 0).astype(np.int8)
    field = DistanceField(distance, occupancy, 0.5)
    assert field.cropped.distance.tolist() == [[1.0, 1.0]]
    assert field.with_layer(2 * distance).cropped.distance.tolist() == [[2.0, 2.0]]


def test_grids_side_by_side_share_no_area_whatever_the_rounding():
    one = Frame(3, 11, 1.0, (1.5, -2.0, 0.4))
    above = Frame(2, 30, 1.0, (0.3317449730740485, 0.7631829820086553, 0.4))  # begins at row 3
    assert not frames_overlap(one, above)
    assert frames_overlap(one, Frame(2, 30, 1.0, (0.33, 0.75, 0.4)))
