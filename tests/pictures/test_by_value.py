"""What stands where in pictures, in which colour, read off their pixels."""

import itertools
import math
from functools import partial

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import (
    Costmap,
    Footprint,
    Frame,
    OccupancyGrid,
    Route,
    cost_curve,
    esdf,
    exponential_cost,
    potential,
)
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.reach import Goal, GoalReach, Passage, Reach
from mapdeal.pictures import canvas as pen
from mapdeal.pictures import colours
from mapdeal.pictures.canvas import Pen, capital_height, sheet, text_width
from mapdeal.pictures.colours import ColourBar, Swatch, interpolated, mixed
from mapdeal.pictures.comparisons import difference_image, merge_image
from mapdeal.pictures.cost_curve import cost_curve_image
from mapdeal.pictures.layers import cost_image, field_image, occupancy_image, potential_image
from mapdeal.pictures.overlay import PoseOverlay, Raster, RouteOverlay
from mapdeal.pictures.reach import reach_image


@pytest.fixture
def asked(monkeypatch):
    """What the picture asked of the sheet, after a call."""
    seen = {}

    def record(pixels, palette, **rest):
        seen.update(rest, pixels=pixels, palette=palette)
        return sheet(pixels, palette, **rest)

    monkeypatch.setattr("mapdeal.pictures.canvas.sheet", record)
    return seen


def colours_of(seen):
    """The map's colours, one a cell, row 0 in the south, of maps that are enlarged."""
    return seen["palette"][seen["pixels"]]


def cell_colours(seen, shape):
    step = seen["pixels"].shape[0] // shape[0]
    middle = step // 2
    return colours_of(seen)[middle::step, middle::step][: shape[0], : shape[1]]


def legend(seen):
    return {
        swatch.label: tuple(seen["palette"][swatch.index].tolist()) for swatch in seen["swatches"]
    }


def test_changes_have_the_colours_that_their_legend_says(asked):
    kinds = np.arange(7, dtype=np.uint8)[np.newaxis]
    difference_image(kinds, Frame(7, 1, 0.25), title="t")
    expected = {
        "only in one map": (225, 225, 225),
        "unknown": (112, 137, 134),
        "free": (255, 255, 255),
        "free in one, unknown in the other": (250, 220, 130),
        "wall": (0, 0, 0),
        "wall removed": (225, 30, 60),
        "wall added": (0, 120, 220),
    }
    assert legend(asked) == expected
    assert [tuple(c) for c in cell_colours(asked, (1, 7))[0].tolist()] == list(expected.values())
    assert asked["swatches"][0].label == "wall added"


MERGED = OccupancyGrid(np.array([[-1, 0, 50, 100, 100, 100, 100]], np.int8), 0.25)
CONFLICTS = np.array([[0, 0, 0, 0, 1, 2, 3]], np.uint8)


def test_conflicts_of_two_merged_maps_have_a_colour_each(asked):
    merge_image(MERGED, CONFLICTS, title="t", names=["hall", "later"])
    greys = [(112, 137, 134), (255,) * 3, (128,) * 3, (0,) * 3]
    shown = [tuple(c) for c in cell_colours(asked, (1, 7))[0].tolist()]
    assert shown == [*greys, (225, 30, 60), (0, 120, 220), (225, 30, 60)]
    assert legend(asked) == {
        "occupied in hall, free in later": (225, 30, 60),
        "free in hall, occupied in later": (0, 120, 220),
        "occupied": (0, 0, 0), "free": (255, 255, 255), "unknown": (112, 137, 134),
    }  # fmt: skip
    assert asked["swatches"][0].label == "occupied in hall, free in later"


def test_conflicts_of_more_maps_have_one_colour(asked):
    merge_image(MERGED, CONFLICTS, title="t", names=["hall", "later", "now"])
    shown = [tuple(c) for c in cell_colours(asked, (1, 7))[0].tolist()]
    assert shown[3:] == [(0,) * 3, *[(225, 30, 60)] * 3]
    assert next(iter(legend(asked))) == "occupied in one map, free in another"
    assert len(legend(asked)) == 4


def test_a_conflict_shows_where_cells_share_a_pixel(asked):
    values, conflicts = np.zeros((2, 10, 400))
    values[3, 7], values[6, 300], conflicts[3, 6] = 100, 100, 2
    grid = OccupancyGrid(values, 0.25, (1.5, -2.0, 0.4))
    merge_image(grid, conflicts.astype(np.uint8), title="t", names="ab", image_max=200)
    shown = colours_of(asked)
    assert shown.shape == (5, 200, 3)
    assert tuple(shown[1, 3]) == (0, 120, 220)
    assert tuple(shown[3, 150]) == (0, 0, 0)


def test_occupancy_is_grey_by_value(asked):
    grid = OccupancyGrid(np.array([[0, 25, 50, 100, -1]], np.int8), 0.25)
    occupancy_image(grid, title="t")
    shown = [tuple(c) for c in cell_colours(asked, (1, 5))[0].tolist()]
    assert shown == [(255,) * 3, (191,) * 3, (128,) * 3, (0,) * 3, (112, 137, 134)]
    assert legend(asked) == {
        "occupied": (0, 0, 0), "free": (255, 255, 255), "unknown": (112, 137, 134)
    }  # fmt: skip
    bar = asked["bar"]
    assert bar.ticks == [(0.0, "0"), (0.25, "25"), (0.5, "50"), (0.75, "75"), (1.0, "100")]
    assert list(bar.indices) == list(range(101))
    occupancy_image(grid_from_text("#."), title="t")
    assert asked["bar"] is None


def test_costs_go_from_pale_yellow_to_dark_purple(asked):
    costmap = Costmap([[1, 64, 127, 189, 252]], 0.25)
    cost_image(costmap, title="t")
    shown = cell_colours(asked, (1, 5))[0].astype(int)
    anchors = [(255, 247, 188), (254, 196, 79), (236, 112, 20), (190, 30, 70), (92, 12, 92)]
    assert abs(shown - anchors).max() <= 4
    assert tuple(shown[0]) == anchors[0]
    assert asked["bar"].ticks[0] == (1 / 252, "1")
    assert asked["bar"].ticks[-1] == (1.0, "252")
    assert [(round(252 * place), label) for place, label in asked["bar"].ticks] == [
        (1, "1"), (50, "50"), (100, "100"), (150, "150"), (200, "200"), (252, "252")
    ]  # fmt: skip
    assert asked["bar"].unit == "cost"
    assert list(asked["bar"].indices) == list(range(200))


def test_costs_that_mean_something_have_their_colours(asked):
    cost_image(Costmap([[0, 252, 253, 254, 255]], 0.25), title="t")
    shown = [tuple(c) for c in cell_colours(asked, (1, 5))[0].tolist()]
    assert shown[0] == (255, 255, 255)
    assert shown[2:] == [(0, 190, 200), (16, 16, 20), (112, 137, 134)]
    assert list(legend(asked)) == ["lethal 254", "inscribed 253", "free 0", "unknown"]
    cost_image(
        Costmap(np.array([[-1, 0, 50, 99, 100]], np.int8), 0.25, scale="occupancy"), title="t"
    )
    shown = [tuple(c) for c in cell_colours(asked, (1, 5))[0].tolist()]
    assert (shown[0], shown[1], shown[4]) == ((112, 137, 134), (255, 255, 255), (16, 16, 20))
    assert legend(asked)["lethal 100"] == (16, 16, 20)
    assert asked["bar"].ticks[-1] == (1.0, "99")


def test_the_highest_cost_shows_where_cells_share_a_pixel(asked):
    costs = np.zeros((1, 400), np.uint8)
    costs[0, 0], costs[0, 1], costs[0, 2], costs[0, 4:6] = 100, 254, 255, (255, 7)
    cost_image(Costmap(costs, 0.25), title="t", image_max=200)
    shown = [tuple(c) for c in colours_of(asked)[0, :3].tolist()]
    assert shown[0] == (16, 16, 20)
    assert shown[1] == (255, 255, 255)  # a known cost before an unknown one
    assert shown[2] not in ((112, 137, 134), (255, 255, 255))


def test_the_circumscribed_line_bounds_the_cells_at_or_above_it(asked):
    ramp = np.tile(np.arange(100, 130, dtype=np.uint8), (9, 1))
    costmap = Costmap(ramp, 0.25, circumscribed_cost=115)
    cost_image(costmap, title="t", image_max=0)
    line = np.all(colours_of(asked) == colours.CONTOUR, axis=2)
    assert np.flatnonzero(line[4]).tolist() == [15, 16]
    assert legend(asked)["circumscribed 115"] == colours.CONTOUR


def test_cells_without_a_number_are_grey_and_all_else_as_if_there_were_none(asked):
    grid = grid_from_text("....#...?\n.........")
    frame = grid.frame.window(-1, -2, 4, 12)
    nowhere = np.ones((4, 12), dtype=bool)
    nowhere[1:3, 2:11] = False
    for draw, field in (
        (field_image, esdf(grid)),
        (field_image, esdf(grid_from_text(".........\n.........", 0.25))),
        (potential_image, potential(grid, goal=(2.0, -1.5))),
    ):
        whole = on_canvas(field, frame)
        draw(field, title="t")
        alone, bar, own = cell_colours(asked, (2, 9)), asked["bar"], legend(asked)
        draw(whole, title="t")
        shown = cell_colours(asked, (4, 12))
        assert (shown[nowhere] == (112, 137, 134)).all()
        if draw is field_image:  # arrows stand elsewhere on a larger canvas
            np.testing.assert_array_equal(shown[1:3, 2:11], alone)
        assert (bar.ticks if bar else None) == (asked["bar"].ticks if bar else None)
        what = "no distance" if draw is field_image else "no potential"
        assert legend(asked) == {**own, what: (112, 137, 134)}


def test_a_pixel_has_a_number_if_one_of_its_cells_has(asked):
    field = esdf(grid_from_text("." * 399 + "#"))
    whole = on_canvas(field, field.frame.window(0, -1, 1, 402))
    field_image(whole, title="t", image_max=201)
    shown = colours_of(asked)
    assert tuple(shown[0, 0]) != (112, 137, 134)  # a cell without, and the first with
    assert tuple(shown[0, 200]) != (112, 137, 134)
    whole = on_canvas(field, field.frame.window(0, -2, 1, 404))
    field_image(whole, title="t", image_max=202)
    grey = np.all(colours_of(asked) == (112, 137, 134), axis=2)
    assert np.flatnonzero(grey[0]).tolist() == [0, 201]


def test_distances_are_blue_outside_and_red_inside(asked):
    field = esdf(grid_from_text("....." + "#" * 9 + "......"))
    field_image(field, title="t")
    shown = cell_colours(asked, (1, 20))[0].astype(int)
    assert shown[19, 2] > shown[19, 0] + 40  # the farthest free cell: dark blue
    assert shown[19].sum() < shown[16].sum() < shown[14].sum()
    assert shown[9, 0] > shown[9, 2] + 40  # the deepest one: red
    assert shown[9].sum() < shown[6].sum()
    far, deep = float(field.distance.max()), float(-field.distance.min())
    step = (far + deep) / 118  # of 119: zero lies between two of them
    below = math.ceil(deep / step)
    low, high = -below * step, (119 - below) * step
    assert low <= -deep
    assert far <= high
    places = {label: place for place, label in asked["bar"].ticks}
    assert len(places) >= 5
    assert {"0", f"{far:.3g}", f"-{deep:.3g}"} <= set(places)
    for label, place in places.items():
        assert place == pytest.approx((float(label) - low) / (high - low), abs=0.003)
    assert list(asked["bar"].indices) == list(range(119))


def test_the_smallest_distance_shows_where_cells_share_a_pixel(asked):
    grid = grid_from_text("#" + "." * 399)
    field = esdf(grid)
    field_image(field, title="t", image_max=100)
    pixels = asked["pixels"][0]
    nearest = field.distance[0, ::4]
    levels = 1 + (nearest / field.distance.max() * 118).astype(int)  # one below zero
    assert np.count_nonzero(pixels[1:] == levels[1:]) >= 97  # of 99: some hinge on rounding


def test_unknown_cells_are_faded(asked):
    field = esdf(grid_from_text("#...??"))
    field_image(field, title="t")
    shown = cell_colours(asked, (1, 6))[0].astype(int)
    assert abs(shown[5] - np.array(colours.RVIZ_UNKNOWN)).max() < 60
    assert "unknown: faded" in legend(asked)
    assert mixed([(0, 100, 200)], (100, 100, 100), 0.6).tolist() == [[60, 100, 140]]


def test_a_potential_is_coloured_by_its_normalised_value(asked):
    grid = grid_from_text("\n".join(["." * 30] * 11 + ["#" + "." * 29]), 0.5, (0.0, 0.0, 0.0))
    field = potential(grid)
    potential_image(field, title="t")
    step = asked["pixels"].shape[1] // 30
    row = asked["pixels"][0, 0::step]  # arrows begin farther up
    expected = np.minimum(field.normalised[0] / 10 * 100, 99).astype(int)
    assert row[0] == 200  # the obstacle
    assert np.array_equal(row[1:], expected[1:])
    assert asked["bar"].ticks == [(k / 10, str(k)) for k in range(0, 11, 2)]
    assert tuple(asked["palette"][0].tolist()) == (250, 250, 235)
    assert tuple(asked["palette"][99].tolist()) == (35, 45, 95)
    assert legend(asked)["downhill"] == (214, 120, 84)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, 2.5])
def test_a_robot_s_tip_is_ahead_of_it(asked, yaw):
    costmap = Costmap(np.zeros((40, 60), np.uint8), 0.5, (3.0, -1.0, 0.4))
    place = costmap.frame.xy_from_rowcol([[20, 30]])[0]
    overlay = PoseOverlay((*place, yaw + 0.4))
    cost_image(costmap, title="t", overlay=overlay)
    marked = np.argwhere(np.all(colours_of(asked) == colours.ROBOT, axis=2))[:, ::-1] + 0.5
    scale = asked["pixels"].shape[1] / 60
    centre = np.array([30.5, 20.5]) * scale
    ahead = (marked - centre) @ [math.cos(yaw), math.sin(yaw)]
    length = max(10.0, max(asked["pixels"].shape) / 25)
    assert ahead.max() == pytest.approx(0.6 * length, abs=2.5)
    assert ahead.min() == pytest.approx(-0.4 * length, abs=1.5)
    aside = (marked - centre) @ [-math.sin(yaw), math.cos(yaw)]
    assert (aside.max(), -aside.min()) == pytest.approx((0.35 * length,) * 2, abs=1.5)
    assert legend(asked)["robot"] == (0, 175, 60)
    assert asked["subtitle"].endswith(overlay.text)


def test_a_robot_stands_in_its_place_on_a_reduced_picture(asked):
    costmap = Costmap(np.zeros((900, 1200), np.uint8), 0.5, (3.0, -1.0, 0.4))
    place = costmap.frame.xy_from_rowcol([[600, 300]])[0]
    cost_image(costmap, title="t", overlay=PoseOverlay((*place, 0.4)), image_max=400)
    marked = np.argwhere(np.all(colours_of(asked) == colours.ROBOT, axis=2))
    assert marked.mean(axis=0) == pytest.approx((200, 100), abs=3)


def test_a_pixel_of_a_field_is_an_obstacle_s_with_one_such_cell_and_unknown_with_all(asked):
    drawing = np.full((40, 400), ".")
    drawing[10, 100], drawing[20:22, 200:202], drawing[30, 300] = "#", "?", "?"
    grid = grid_from_text("\n".join("".join(row) for row in drawing[::-1]))
    field_image(esdf(grid), title="t", image_max=200)
    pixels = asked["pixels"]
    assert np.argwhere(pixels == 238).tolist() == [[5, 50]]  # the obstacle's own outline
    assert np.argwhere((pixels >= 119) & (pixels < 238)).tolist() == [[10, 100]]


@pytest.mark.parametrize(("reduce", "enlarge"), [(1, 1), (5, 1), (1, 4)])
def test_a_pixel_s_side_in_metres(reduce, enlarge):
    raster = Raster(enlarge=enlarge, reduce=reduce)
    assert raster.metres_per_pixel(0.05) == pytest.approx(0.05 * reduce / enlarge)


def longest_black_run(image):
    """Return the length of the longest black run of pixels in a row."""
    black = np.pad(image.indices == pen.MOST_COLOURS, ((0, 0), (1, 1)))
    edges = np.flatnonzero(np.diff(black.ravel().astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max())


@pytest.mark.parametrize(("side", "image_max"), [(300, 2048), (1500, 500), (1500, 0)])
def test_the_scale_bar_is_as_long_as_it_says(monkeypatch, side, image_max):
    labels = []
    write = Pen.label
    monkeypatch.setattr(
        Pen, "label", lambda own, x, y, text: (labels.append(text), write(own, x, y, text))
    )
    grid = OccupancyGrid(np.zeros((side // 3, side), np.int8), 0.05, (0.0, 0.0, 0.3))
    image = occupancy_image(grid, title="", image_max=image_max)
    metres = next(float(t.removesuffix(" m")) for t in labels if t.endswith(" m"))
    raster = Raster.fitting(grid.shape, image_max)
    length = longest_black_run(image)
    pixels = metres / raster.metres_per_pixel(0.05)
    assert pixels + 1 <= length <= pixels + 1 + 20  # and the end's own thickness
    assert length - pixels - 1 == max(2, 14 // 6) // 2 or side == 1500
    width = side // raster.reduce * raster.enlarge
    assert 0.15 * width < pixels <= 0.4 * width + 1


def test_a_colour_bar_has_its_first_colour_at_the_bottom_and_ticks_beside_their_colours():
    bar = ColourBar(range(100), [(0.0, "0"), (0.25, "5"), (1.0, "20")], "unit")
    palette = np.stack([np.arange(100), np.arange(100), np.full(100, 255)], axis=1).astype(np.uint8)
    image = sheet(np.full((600, 600), 99, np.uint8), palette, title="", subtitle="",
                  metres_per_pixel=0.05, bar=bar)  # fmt: skip
    column = np.flatnonzero((image.indices == 50).any(axis=0))
    strip = image.indices[:, column[0]]
    rows = np.flatnonzero(strip < 100)
    assert strip[rows[-1]] == 0
    assert strip[rows[0]] == 99
    assert (np.diff(strip[rows].astype(int)) <= 0).all()
    beside = image.indices[:, column[-1] + 3]
    ticks = np.flatnonzero(beside == pen.MOST_COLOURS)
    ticks = ticks[(ticks >= rows[0]) & (ticks <= rows[-1])]
    assert ticks.tolist() == [rows[0], rows[0] + round(0.75 * (len(rows) - 1)), rows[-1]]


def test_coordinates_stand_beside_the_pixels_that_they_name(monkeypatch):
    texts = []
    monkeypatch.setattr(Pen, "write", lambda _, x, y, text, __: texts.append((text, x, y)))
    pixels = np.zeros((600, 300), np.uint8)
    image = sheet(pixels, np.full((1, 3), 200, np.uint8), title="", subtitle="",
                  metres_per_pixel=0.01, corner_xy=(-1.0, 10.0))  # fmt: skip
    rows, cols = np.nonzero(image.indices == 0)
    bottom, left = rows.max() + 1, cols.min()
    below = np.flatnonzero(image.indices[bottom + 2] == pen.MOST_COLOURS)
    beside = np.flatnonzero(image.indices[:, left - 3] == pen.MOST_COLOURS)
    named = {text: (x, y) for text, x, y in texts}
    for label in ("-1", "0", "1", "2") if "0" in named else ("-1.0", "0.0", "1.0", "2.0"):
        place = left + round((float(label) + 1.0) / 0.01)
        assert place in below
        assert named[label][0] < place
    upward = [t for t in named if t.replace(".", "").isdigit() and float(t) >= 10]
    assert len(upward) >= 5
    for label in upward:
        place = bottom - round((float(label) - 10.0) / 0.01)
        assert place in beside
        assert abs(named[label][1] - place) <= 8
        assert named[label][0] < left - 5


@pytest.mark.parametrize("shape", [(600, 300), (400, 700), (1000, 2000)])
@pytest.mark.parametrize("corner", [(-1.0, 10.0), (-12345.5, 0.25), None])
def test_axes_are_named_beside_coordinates_and_no_text_covers_another(monkeypatch, shape, corner):
    texts = {}
    monkeypatch.setattr(
        Pen, "write", lambda _, x, y, text, size: texts.update({(text, x, y): size})
    )
    image = sheet(np.zeros(shape, np.uint8), np.full((2, 3), 200, np.uint8), title="Title",
                  subtitle="and more", metres_per_pixel=0.01, corner_xy=corner,
                  swatches=[Swatch(1, "a rather long label")] * 5)  # fmt: skip
    named = {text: (x, y) for text, x, y in texts if text in ("x [m]", "y [m]")}
    assert set(named) == (set() if corner is None else {"x [m]", "y [m]"})
    boxes = [
        (x, x + text_width(text, size), y - capital_height(size), y)
        for (text, x, y), size in texts.items()
    ]
    for (a, b, c, d), (e, f, g, h) in itertools.combinations(boxes, 2):
        assert b <= e or f <= a or d <= g or h <= c
    assert all(0 <= a < b <= image.indices.shape[1] for a, b, _, _ in boxes)
    assert all(0 <= c < d < image.indices.shape[0] for *_, c, d in boxes)
    if corner is not None:
        rows, cols = np.nonzero(image.indices == 0)
        assert named["y [m]"][1] < rows.min()
        assert named["y [m]"][0] < cols.max()
        assert named["x [m]"][1] > rows.max()


def test_a_legend_s_boxes_stand_below_each_other():
    swatches = [Swatch(1, "one"), Swatch(2, "two")]
    image = sheet(np.zeros((300, 300), np.uint8), np.full((3, 3), 9, np.uint8), title="",
                  subtitle="", metres_per_pixel=0.1, swatches=swatches)  # fmt: skip
    boxes = [np.argwhere(image.indices == index) for index in (1, 2)]
    assert [len(box) for box in boxes] == [int(1.1 * 14) * int(1.2 * 14)] * 2
    assert (boxes[1].min(axis=0) - boxes[0].min(axis=0)).tolist() == [int(1.6 * 14), 0]


def test_the_map_is_framed_and_the_north_is_on_top():
    pixels = np.zeros((60, 200), np.uint8)
    pixels[-1] = 1
    image = sheet(pixels, np.full((2, 3), 9, np.uint8), title="", subtitle="", metres_per_pixel=0.1)
    top, left = np.argwhere(image.indices == 1).min(axis=0)
    assert np.array_equal(image.indices[top : top + 60, left : left + 200], pixels[::-1])
    grey = pen.MOST_COLOURS + 5
    assert (image.indices[top - 1, left - 1 : left + 201] == grey).all()
    assert (image.indices[top + 60, left - 1 : left + 201] == grey).all()
    assert (image.indices[top - 1 : top + 61, left - 1] == grey).all()
    assert (image.indices[top - 1 : top + 61, left + 200] == grey).all()


@pytest.mark.parametrize("levels", [*range(2, 121), 200])
def test_no_colour_hinges_on_how_a_library_rounds(levels, monkeypatch):
    exact = []
    rint = np.rint
    monkeypatch.setattr("numpy.rint", lambda x: (exact.append(x), rint(x))[1])
    for anchors in (colours.COST_ANCHORS, colours.POTENTIAL_ANCHORS, colours.FREE_ANCHORS,
                    colours.OBSTACLE_ANCHORS):  # fmt: skip
        interpolated(anchors, levels)
    for values in exact:
        assert abs(values % 1 - 0.5).min() > 1e-9


def test_a_scale_passes_through_its_anchors():
    anchors = [(255, 0, 0), (0, 255, 0), (0, 0, 255)]
    assert interpolated(anchors, 5)[::2].tolist() == [list(anchor) for anchor in anchors]


def test_every_kind_of_picture_shows_its_title_and_the_colours_of_its_cells():
    grid = grid_from_text("#..?\n....\n..##", 0.25, (1.5, -2.0, 0.0))
    robot = PoseOverlay((2.0, -1.6, 0.7))
    route = Route("descent", False, (1.6, -1.6), (2.3, -1.4), [[1.6, -1.6], [2.1, -1.5]], 0.51,
                  0.51, 1.0, local_minimum=(2.1, -1.5))  # fmt: skip
    pictures = {
        "K\u00fcche 5 \u00d7 7 m\u00b2 \u5009": partial(occupancy_image, grid),
        "Field": partial(field_image, esdf(grid)),
        "Cost": partial(cost_image, exponential_cost(grid), overlay=robot),
        "Route": partial(occupancy_image, grid, overlay=RouteOverlay(route)),
        "Curve": partial(
            cost_curve_image, cost_curve(0.05, inscribed_radius=0.2, circumscribed_radius=0.36)
        ),
        "Rings": partial(cost_curve_image, cost_curve(0.05, model="rings")),
        "Reach": partial(reach_image, reach_of_three_rooms()),
    }
    for title, draw in pictures.items():
        image, untitled = draw(title=title), draw(title="")
        written = image.indices[:36, : untitled.indices.shape[1]]
        without = untitled.indices[:36, : image.indices.shape[1]]
        inked = np.flatnonzero((written != without).any(axis=0))
        expected = max(text_width(title, size) for size in (18, 20))  # of 14 or 16 below them
        assert 0.7 * expected < inked[-1] - inked[0] + 1 <= expected + 2
        assert (image.indices < pen.MOST_COLOURS).any()
        assert np.array_equal(image.palette, untitled.palette)


def reach_of_three_rooms():
    drawn = np.array([list("########"), list("#..#.#.#"), list("#....#.#"), list("########")])
    occupancy = np.where(drawn == "#", 100, 0).astype(np.int8)
    headings = np.where(drawn == ".", 8, 0).astype(np.uint8)
    headings[2, 3] = 0
    reachable = (headings > 0) & (np.arange(8) < 3)
    headings[2, 1] = 3
    passage = Passage(1.375, -1.375, 0.2, 0.125, False, ((1.375, -1.625), (1.375, -1.125)))
    return Reach(
        reachable.astype(np.uint8), headings, occupancy * 0.0, occupancy * 0.0, occupancy, 0.25,
        (0.5, -2.0, 0.0), (0.9, -1.6, 0.7), Footprint.polygon([(0.2, 0.1), (-0.2, 0.1), (0, -0.2)]),
        8, goals=(GoalReach(Goal(2.1, -1.4, "Caf\u00e9"), False, 0, 0.0),), passages=(passage,),
    )  # fmt: skip


def test_a_scale_says_where_unknown_cells_go_beyond_it(asked):
    field_image(esdf(grid_from_text("##..." + "?" * 20)), title="t")
    assert asked["bar"].ticks[-1][1] == ">0.75"
    field_image(esdf(grid_from_text("##...")), title="t")
    assert asked["bar"].ticks[-1][1] == "0.75"
    assert asked["bar"].ticks[0][1] == "-0.25"
    field_image(esdf(grid_from_text("?" * 9 + "##..."), unknown="occupied"), title="t")
    assert asked["bar"].ticks[0][1].startswith("<-")


@pytest.mark.parametrize(
    ("drawing", "label"), [("...", "+inf: no obstacle"), ("###", "-inf: nothing free")]
)
def test_a_field_without_an_end_says_which(asked, drawing, label):
    field_image(esdf(grid_from_text(drawing)), title="t")
    assert list(legend(asked)) == [label]
    assert asked["bar"] is None


def test_a_pixel_of_a_potential_shows_the_highest_and_is_unknown_with_all_its_cells(asked):
    drawing = np.full((40, 400), ".")
    drawing[10, 100], drawing[20:22, 200:202], drawing[30, 300] = "#", "?", "?"
    grid = grid_from_text("\n".join("".join(row) for row in drawing[::-1]), origin=(0.0, 0.0, 0.0))
    field = potential(grid)
    potential_image(field, title="t", image_max=200)
    pixels = asked["pixels"]
    assert pixels[5, 50] == 200
    assert np.argwhere((pixels >= 100) & (pixels < 200)).tolist() == [[10, 100]]
    highest = field.normalised.reshape(20, 2, 200, 2).max(axis=(1, 3))
    free = pixels < 100
    assert np.array_equal(pixels[free], np.minimum(highest[free] / 10 * 100, 99).astype(int))


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi / 2])
def test_arrows_stand_on_their_cells_and_lead_downhill(asked, yaw):
    grid = OccupancyGrid(np.zeros((8, 12), np.int8), 0.5, (1.0, 2.0, yaw))
    goal = tuple(grid.frame.xy_from_rowcol([[3, 11]])[0])  # at the right edge
    potential_image(potential(grid, goal=goal), title="t")
    arrows = np.argwhere(np.all(colours_of(asked) == colours.ARROW, axis=2))
    step = asked["pixels"].shape[0] // 8
    cell = arrows[(arrows // step == [3, 5]).all(axis=1)] - np.array([3, 5]) * step + 0.5
    assert cell[:, 0].mean() == pytest.approx(step / 2, abs=1.5)  # level
    assert (cell[:, 1].min() + cell[:, 1].max()) / 2 == pytest.approx(step / 2, abs=1.5)
    rows_of_last, rows_of_first = (
        np.ptp(cell[abs(cell[:, 1] - cell[:, 1].mean() - away) < 2, 0]) for away in (2, -12)
    )
    assert rows_of_last > rows_of_first  # the head is on the goal's side


def test_a_new_wall_shows_where_cells_share_a_pixel_and_small_maps_do_not_shrink(asked):
    changes = np.full((10, 400), 2, np.uint8)
    changes[3, 7] = 6
    difference_image(changes, Frame(400, 10, 0.25), title="t", image_max=200)
    assert np.argwhere(asked["pixels"] == 6).tolist() == [[1, 3]]
    difference_image(changes, Frame(400, 10, 0.25), title="t")
    assert asked["pixels"].shape == (20, 800)
