"""Shapes on whole pixels: points near an edge may fall to either side."""

import itertools
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from PIL import Image

import mapdeal
from mapdeal.grid.frame import Frame, Region
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.layers import occupancy_image
from mapdeal.pictures.overlay import (
    Brush,
    KeepoutOverlay,
    Pooling,
    PoseOverlay,
    Raster,
    RobotOverlay,
    Surface,
    known_box,
    shown_part,
)
from mapdeal.pipeline.folder import robot_overlays
from mapdeal.pipeline.step import make_step

HEIGHT, WIDTH = 24, 31
PARTS = [None, Region(4, 3, 30, 21), Region(0, 0, 1, 38), Region(52, 0, 1, 1)]
places = st.integers(-8 * 4, 40 * 4).map(lambda quarter: quarter / 4)
points = st.tuples(places, places)


def to_segment(start, end, x, y):
    """Distances of points to a segment."""
    start, along = np.array(start), np.subtract(end, start)
    part = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max((along**2).sum(), 1e-12)
    part = np.clip(part, 0, 1)
    return np.hypot(x - start[0] - part * along[0], y - start[1] - part * along[1])


@given(st.lists(points, min_size=2, max_size=4), st.integers(1, 6))
def test_a_line_is_the_pixels_that_are_near_it(path, thickness):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    Brush(pixels).polyline(np.array(path), 7, thickness=thickness)
    y, x = np.indices(pixels.shape) + 0.5
    distance = np.min([to_segment(*ends, x, y) for ends in pairwise(path)], 0)
    assert set(np.unique(pixels)) <= {0, 7}
    assert (pixels[distance > thickness / 2 + 1.75] == 0).all()
    assert (pixels[distance < thickness / 2 - 2] == 7).all()


@given(points, st.integers(8, 40).map(lambda k: k / 4))
def test_a_disc_is_the_pixels_whose_centres_are_near(centre, radius):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    Brush(pixels).dot(np.array(centre), 3, radius=radius)
    rows, cols = np.indices(pixels.shape) + 0.5
    distance = np.hypot(cols - centre[0], rows - centre[1])
    assert (pixels[distance < radius - 1.1] == 3).all()
    assert (pixels[distance > radius + 1.1] == 0).all()


def test_far_away_places_do_no_harm():
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    brush = Brush(pixels)
    brush.dot(np.array([1e300, -1e300]), 1, radius=5.0)
    assert not pixels.any()
    brush.polyline(np.array([[-1e30, 12.5], [1e30, 12.5]]), 2, thickness=3)
    assert (pixels[11:14] == 2).all()
    brush.segments(np.empty((0, 2)), np.empty((0, 2)), 3, thickness=2)
    assert not (pixels == 3).any()


def test_a_route_over_a_large_picture_is_drawn_part_by_part(monkeypatch):
    path = np.array([60, 40]) + np.random.default_rng(2).normal(size=(300, 2)).cumsum(axis=0)
    at_once, parts = np.zeros((2, 90, 120), np.uint8)
    Brush(at_once).polyline(path, 5, thickness=4)
    sizes = []
    monkeypatch.setattr("mapdeal.pictures.overlay._MOST_PIXELS", 400)
    fromarray = Image.fromarray
    monkeypatch.setattr(Image, "fromarray", lambda a: (sizes.append(a.size), fromarray(a))[1])
    Brush(parts).polyline(path, 5, thickness=4)
    assert at_once.any()
    assert np.array_equal(parts, at_once)
    assert max(sizes) <= 400
    Brush(parts).polyline(np.array([[2.0, 2.0], [110.0, 80.0]]), 6, thickness=4)  # in one piece
    assert (parts == 6).any()


@pytest.mark.parametrize("block_height", [1, 4, 7, 100])
def test_lazy_layers_are_pooled_without_more_than_a_block_of_rows(block_height):
    values = np.random.default_rng(3).normal(size=(53, 38)).astype(np.float32)
    values[5:9, 3:11] = np.nan
    calls = []

    def rows_of(rows):
        calls.append(rows.stop - rows.start)
        return values[rows]

    layer = lazy_layer(values.shape, np.float32, rows_of, block_height=block_height)
    for method, choose in (("largest", np.fmax), ("smallest", np.fmin)):
        expected = [
            [choose.reduce(values[row : row + 3, col : col + 3], axis=None)
             for col in range(0, 38, 3)]
            for row in range(0, 53, 3)
        ]  # fmt: skip
        found = getattr(Raster(reduce=3), method)(layer)
        assert np.array_equal(found, np.array(expected, np.float32), equal_nan=True)
    assert max(calls) <= max(3, block_height)  # a row of pixels has three of cells under it


@given(st.lists(st.integers(1, 52), max_size=9), st.sampled_from(PARTS), st.integers(1, 9))
def test_rows_may_be_cut_anywhere_on_their_way_to_pixels(cuts, part, reduce):
    values = np.random.default_rng(4).integers(0, 99, (53, 38)).astype(np.int8)
    row, col, height, width = (0, 0, 53, 38) if part is None else part
    shown = values[row : row + height, col : col + width]
    expected = [[shown[y : y + reduce, x : x + reduce].max() for x in range(0, width, reduce)]
                for y in range(0, height, reduce)]  # fmt: skip
    pooling = Pooling(Raster(reduce=reduce, part=part), values, np.fmax)
    for first, end in itertools.pairwise([0, *sorted(set(cuts)), 53]):
        pooling.take(slice(first, end))
    assert pooling.pixels.tolist() == expected


LONG = mapdeal.Footprint.polygon([(0.6, 0.2), (0.6, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
FRAME = Frame(80, 120, 0.05, (1.0, -2.0, 0.3))


def drawn(overlay, pixels, raster):
    (*swatches,) = overlay.draw(Surface(pixels, FRAME, raster), 7)
    return [(swatch.index, swatch.label) for swatch in swatches], np.argwhere(pixels == 7)


@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_it_stands_in_the_corner_where_least_is_to_be_seen(corner):
    noise = np.random.default_rng(1).integers(0, 5, (320, 480)).astype(np.uint8)
    at = [slice(half * length // 2, (half + 1) * length // 2)
          for half, length in zip(corner, (320, 480), strict=True)]  # fmt: skip
    noise[tuple(at)] = 3
    _, cells = drawn(RobotOverlay(LONG), noise, Raster(enlarge=4))
    assert all((cells[:, axis] >= at[axis].start).all() for axis in (0, 1))
    assert all((cells[:, axis] < at[axis].stop).all() for axis in (0, 1))


@pytest.mark.parametrize("robot", [mapdeal.Footprint.circle(0.01), mapdeal.Footprint.circle(2.0)])
def test_what_is_too_small_or_too_large_is_left_out(robot):
    pixels = np.zeros((80, 120), np.uint8)
    assert drawn(RobotOverlay(robot), pixels, Raster())[0] == []
    assert not pixels.any()


@pytest.mark.parametrize(("stage", "parameters", "robot", "label"), [
    ("inflate", {"radius": 0.3}, None, ("robot, to scale", 0.3)),
    ("inflate", {"radius": 0.0}, None, None),
    ("inflate", {"footprint": LONG}, None, ("robot, to scale", LONG)),
    ("cost", {"inscribed_radius": 0.2}, None, ("robot, to scale", 0.2)),
    ("cost", {}, None, None),
    ("cost", {"inscribed_radius": 0.2, "circumscribed_radius": 0.6}, None,
     ("the robot's inscribed circle", 0.2)),
    ("cost", {"inscribed_radius": 0.2, "circumscribed_radius": 0.6}, LONG,
     ("robot, to scale", LONG)),
    ("esdf", {}, LONG, None),
    ("reach", {"radius": 0.3}, None, None),
])  # fmt: skip
def test_pictures_of_what_is_about_a_robot_show_it(stage, parameters, robot, label):
    found = robot_overlays(make_step(stage, parameters), robot)
    if label is None:
        assert found == []
        return
    (drawn,) = found
    shape = label[1] if label[1] is LONG else mapdeal.Footprint.circle(label[1])
    assert (drawn.label, drawn.robot) == (label[0], shape)


@pytest.mark.parametrize(
    ("scale", "kind", "lethal"), [("costmap2d", np.uint8, 254), ("occupancy", np.int8, 100)]
)
@pytest.mark.parametrize("is_lazy", [True, False])
def test_cells_that_a_mask_alone_has_closed(scale, kind, lethal, is_lazy):
    maps = []
    for listed in ([[0, 30, lethal], [50, 0, 0]], [[0, lethal, lethal], [60, 0, lethal]]):
        layer = cells = np.array(listed, kind)
        if is_lazy:
            layer = lazy_layer(cells.shape, kind, cells.__getitem__, block_height=1)
        maps.append(mapdeal.Costmap(layer, 0.25, (1.0, 2.0, 0.4), scale=scale))
    overlay = KeepoutOverlay.of(*maps)
    pixels = np.zeros((4, 6), np.uint8)
    surface = Surface(pixels, maps[0].frame, Raster(enlarge=2))
    assert [(swatch.index, swatch.label) for swatch in overlay.draw(surface, 9)] == [(9, "keepout")]
    assert (pixels[::2, ::2] == 9).tolist() == [[False, True, False], [False, False, True]]
    assert overlay.draw(Surface(np.zeros((2, 3), np.uint8), maps[0].frame, Raster()), 9)
    assert KeepoutOverlay.of(maps[1], maps[1]).draw(surface, 9) == []


def test_the_picture_of_masked_costs_has_them(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = mapdeal.OccupancyGrid(np.zeros((6, 20), np.int8), 0.1, (1.0, 2.0, 0.0))
    mapdeal.write_map("m.yaml", grid)
    mapdeal.write_map("mask.yaml", grid.with_values(np.eye(6, 20, dtype=np.int8) * 100))
    words = "cost", "m.yaml", "-o", "c.npz", "--mask", "mask.yaml", "--image", "c.png"
    assert command(*words)[0] == 0
    with Image.open("c.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    assert (pixels == (40, 100, 245)).all(axis=-1).any()


BOX = Region(40, 70, 20, 30)


def canvas(height=120, width=160, box=BOX):
    cells = np.full((height, width), -1, np.int8)
    known = np.random.default_rng(1).choice(np.array([-1, 0, 100], np.int8), box[2:])
    known[0, 0] = known[-1, -1] = 0
    cells[box.row : box.row + box.height, box.col : box.col + box.width] = known
    return mapdeal.OccupancyGrid(cells, 0.25, (2.0, -3.0, 0.4))


@given(
    st.integers(1, 9), st.integers(1, 9),
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), max_size=4), st.booleans(),
)  # fmt: skip
def test_the_box_of_known_cells(height, width, places, is_lazy):
    cells = np.full((height, width), -1, np.int8)
    for row, col in places:
        cells[row % height, col % width] = 50
    layer = cells
    if is_lazy:
        layer = lazy_layer(cells.shape, np.int8, cells.__getitem__, block_height=2)
    rows, cols = np.nonzero(cells >= 0)
    expected = None
    if places:
        expected = (rows.min(), cols.min(), np.ptp(rows) + 1, np.ptp(cols) + 1)
    assert known_box(layer, -1) == expected


@pytest.mark.parametrize(("size", "box", "shown"), [
    ((120, 160), BOX, (30, 60, 40, 50)),  # a margin of ten cells
    ((1000, 900), Region(300, 200, 400, 300), (280, 180, 440, 340)),  # or of a twentieth
    ((120, 160), Region(3, 150, 20, 10), (0, 140, 33, 20)),  # as far as the map goes
    ((120, 160), Region(0, 0, 120, 160), None),  # all of it, or nearly
    ((120, 160), Region(8, 8, 105, 144), None),
])  # fmt: skip
def test_the_known_cells_are_shown_with_a_margin(size, box, shown):
    grid = canvas(*size, box)
    assert shown_part(grid.occupancy, grid.frame, "known") == shown
    assert shown_part(grid.occupancy, grid.frame, "all") is None
    assert shown_part(np.full(size, -1, np.int8), grid.frame, "known") is None


def test_what_is_drawn_over_the_map_lies_in_the_picture():
    grid = canvas()
    x, y = grid.frame.xy_from_rowcol([(100, 20)])[0].tolist()
    pose = PoseOverlay((x, y, 0.3))
    # from the robot's cell to the far end of the known box, and ten cells
    assert shown_part(grid.occupancy, grid.frame, "known", overlay=pose) == (30, 10, 81, 100)
    outside = shown_part(grid.occupancy, grid.frame, "known", places_xy=[(900.0, 900.0)])
    assert outside == (30, 60, 90, 100)  # up to the corner of the map that is nearest to it
    assert shown_part(grid.occupancy, grid.frame, "known", places_xy=[(np.nan, 0)]) == (
        30, 60, 40, 50
    )  # fmt: skip


def test_lazy_maps_have_the_same_picture():
    grid = canvas()
    layer = lazy_layer(grid.shape, np.int8, grid.occupancy.__getitem__, block_height=7)
    pictures = [occupancy_image(map_, title="a", image_extent="known")
                for map_ in (grid, grid.with_values(layer))]  # fmt: skip
    assert np.array_equal(pictures[0].indices, pictures[1].indices)
