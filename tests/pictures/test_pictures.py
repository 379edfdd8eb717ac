import io
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from drawn import grid_from_text
from mapdeal import (
    Costmap,
    Frame,
    OccupancyGrid,
    Route,
    esdf,
    exponential_cost,
    inflate,
    potential,
    shortest_route,
)
from mapdeal.maps.png import write_indexed_png
from mapdeal.pictures.canvas import corner_of, frame_text, ticks_between
from mapdeal.pictures.colours import (
    ARROW,
    COST_ANCHORS,
    FREE_ANCHORS,
    GOAL,
    LETHAL,
    MINIMUM,
    OBSTACLE_ANCHORS,
    ROUTE,
    START,
    interpolated,
)
from mapdeal.pictures.layers import cost_image, field_image, occupancy_image, potential_image
from mapdeal.pictures.overlay import Raster, RouteOverlay, inner_outline

BLACK, RVIZ_UNKNOWN = (0, 0, 0), (112, 137, 134)


def rgb(image):
    """Return the picture as a decoder sees it, shape (H, W, 3)."""
    buffer = io.BytesIO()
    write_indexed_png(buffer, image.indices, image.palette)
    return np.asarray(Image.open(buffer).convert("RGB"))


def count(pixels, colour):
    return int(np.all(pixels == colour, axis=2).sum())


@given(st.integers(1, 5000), st.integers(1, 5000), st.sampled_from([2048, 600, 50]))
def test_small_maps_grow_by_a_whole_factor_and_large_ones_fit(height, width, image_max):
    raster = Raster.fitting((height, width), image_max)
    assert min(raster.enlarge, raster.reduce) == 1
    side = max(height, width)
    shown = -(-side // raster.reduce) * raster.enlarge
    assert shown <= image_max
    if image_max >= 1200:
        assert shown >= min(side, 600)


def test_zero_means_a_pixel_per_cell():
    assert Raster.fitting((5, 3), 0) == Raster.fitting((9000, 3), 0) == Raster()


@given(st.integers(0, 2**32 - 1), st.integers(2, 7))
def test_no_obstacle_vanishes_when_cells_share_a_pixel(seed, reduce):
    rng = np.random.default_rng(seed)
    layer = (rng.random((23, 31)) < 0.02).astype(np.int8)
    small = Raster(reduce=reduce).largest(layer)
    for row, col in np.argwhere(layer).tolist():
        assert small[row // reduce, col // reduce] == 1
    assert small.sum() <= layer.sum()


def test_a_single_obstacle_of_a_large_map_is_seen():
    occupancy = np.zeros((900, 1300), np.int8)
    occupancy[450, 701] = 100
    grid = OccupancyGrid(occupancy, 0.05)
    empty = OccupancyGrid(np.zeros_like(occupancy), 0.05)
    for draw in (lambda g: occupancy_image(g, title="t", image_max=200),):
        assert count(rgb(draw(grid)), BLACK) > count(rgb(draw(empty)), BLACK)


def test_the_north_is_on_top_and_unknown_has_rviz_s_grey():
    pixels = rgb(occupancy_image(grid_from_text("###\n???\n..."), title="t"))
    middle = pixels[:, 120]
    rows = {c: np.flatnonzero(np.all(middle == c, axis=1)).mean() for c in (BLACK, RVIZ_UNKNOWN)}
    assert rows[BLACK] < rows[RVIZ_UNKNOWN]
    assert count(pixels, RVIZ_UNKNOWN) > 3 * 200 * 200


def test_cells_are_sharp_squares():
    # 3 cells enlarged by 200: the occupied one is exactly 200 x 200 black pixels and some text.
    pixels = rgb(occupancy_image(grid_from_text(".#."), title=""))
    runs = np.all(pixels == BLACK, axis=2).sum(axis=1)
    assert np.count_nonzero(runs >= 200) == 200


@pytest.mark.parametrize("drawing", [".", "#", "?", "....\n....", "####", "????", "." * 400])
def test_every_kind_of_map_has_pictures(drawing):
    grid = grid_from_text(drawing)
    for image in (
        occupancy_image(grid, title="x" * 300),
        field_image(esdf(grid), title="field"),
        cost_image(exponential_cost(grid), title="cost"),
    ):
        height, width = image.indices.shape
        assert height > 100
        assert 100 < width < 2000
        assert image.palette.shape == (256, 3)


def test_the_edge_of_obstacles_is_drawn_in_the_field():
    grid = grid_from_text(".....\n.###.\n.###.\n.###.\n.....")
    with_edge = count(rgb(field_image(esdf(grid), title="")), BLACK)
    without = count(rgb(field_image(esdf(grid_from_text(".....\n" * 5)), title="")), BLACK)
    # An outline one pixel wide around a square of three cells of 120 pixels.
    assert with_edge - without >= 4 * 360 - 4 - 200


def test_inner_outline_of_a_mask_that_touches_the_border():
    mask = np.ones((4, 5), dtype=bool)
    assert not inner_outline(mask).any()
    mask[0, 0] = False
    assert np.argwhere(inner_outline(mask)).tolist() == [[0, 1], [1, 0]]


@pytest.mark.parametrize("anchors", [COST_ANCHORS, FREE_ANCHORS, OBSTACLE_ANCHORS])
def test_scales_fall_evenly_in_lightness(anchors):
    colours = interpolated(anchors, 40) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) < 0).all()


def test_special_costs_stand_apart():
    costmap = Costmap([[0, 1, 252, 253, 254, 255]], 0.25)
    pixels = rgb(cost_image(costmap, title=""))
    row = pixels[2 * len(pixels) // 5]
    seen = [tuple(row[k].tolist()) for k in range(30, 600, 2)]
    blocks = [c for c, before in zip(seen[1:], seen, strict=False) if c != before]
    colours = {seen[0], *blocks}
    assert len(colours) >= 6
    for one in colours:
        for other in colours - {one}:
            assert sum(abs(a - b) for a, b in zip(one, other, strict=True)) > 20


def test_the_circumscribed_cost_is_drawn_as_a_line():
    grid = inflate(grid_from_text("." * 21 + "\n" + "." * 10 + "#" + "." * 10), radius=0.0)
    plain = exponential_cost(grid, inflation_radius=2.0, cost_scaling_factor=1.0)
    shaped = exponential_cost(
        grid, inflation_radius=2.0, cost_scaling_factor=1.0, circumscribed_radius=1.0
    )
    contour = (120, 255, 70)
    assert count(rgb(cost_image(plain, title="")), contour) == 0
    assert count(rgb(cost_image(shaped, title="")), contour) > 100


def test_fields_without_a_finite_distance_have_a_legend_instead_of_a_scale():
    endless = field_image(esdf(grid_from_text("....")), title="")
    finite = field_image(esdf(grid_from_text("#...")), title="")
    assert len(np.unique(endless.indices)) < len(np.unique(finite.indices)) - 50


@pytest.mark.parametrize("shape", [(7, 11), (12, 4), (1, 5), (301, 1103)])
@pytest.mark.parametrize("reduce", [1, 2, 3, 5])
def test_a_pixel_shows_the_extreme_of_all_its_cells(shape, reduce):
    layer = np.random.default_rng(reduce).integers(-1, 101, shape).astype(np.int8)
    raster = Raster(reduce=reduce)
    for pooled, extreme in ((raster.largest(layer), max), (raster.smallest(layer), min)):
        assert pooled.shape == (-(-shape[0] // reduce), -(-shape[1] // reduce))
        for row, col in np.ndindex(pooled.shape):
            y, x = row * reduce, col * reduce
            assert pooled[row, col] == extreme(layer[y : y + reduce, x : x + reduce].flat)
            if row > 40:
                break


@given(
    st.floats(-1e7, 1e7),
    st.integers(1, 4000),
    st.sampled_from([1e-6, 0.003, 0.05, 0.0504, 1.0, 20.0, 1e6]),
    st.integers(14, 40),
)
def test_coordinates_stand_where_they_belong_and_apart(start, pixels, metres_per_pixel, size):
    ticks = ticks_between(start, pixels, metres_per_pixel, size)
    for pixel, label in ticks:
        assert 0 <= pixel <= pixels
        off = abs(start + pixel * metres_per_pixel - float(label))
        assert off <= 0.51 * metres_per_pixel + 1e-6 * abs(float(label)) + 1e-9
    places = [pixel for pixel, _ in ticks]
    widest = max((len(label) for _, label in ticks), default=0)
    assert all(b - a >= 0.5 * size * widest for a, b in itertools.pairwise(places))
    if pixels > 60 * size and metres_per_pixel > 1e-3:
        assert len(ticks) >= 2


def test_only_maps_that_are_not_turned_have_coordinates():
    assert corner_of(Frame(2, 3, 0.5, (1.25, -2.0, 0.0))) == (1.25, -2.0)
    assert corner_of(Frame(2, 3, 0.5, (1.25, -2.0, 0.4))) is None
    straight, turned = (
        occupancy_image(grid_from_text("..\n..", 0.1, (1.5, -2.0, yaw)), title="").indices
        for yaw in (0.0, 0.4)
    )
    # Labels below the map make the sheet taller.
    assert straight.shape[0] > turned.shape[0]


def test_a_turned_map_tells_its_corner_and_yaw():
    assert frame_text(Frame(2, 3, 0.5, (1.25, -2.0, 0.4))).endswith(
        "1.5 x 1 m, from 1.25, -2 at yaw 0.4 (not turned here)"
    )


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_a_potential_has_its_obstacles_its_goal_and_arrows(yaw):
    grid = OccupancyGrid(np.zeros((8, 12), np.int8), 0.5, (1.0, 2.0, yaw))
    goal = tuple(grid.frame.xy_from_rowcol([[4, 10]])[0])
    pixels = rgb(potential_image(potential(grid, goal=goal), title="t"))
    assert count(pixels, GOAL) > 50
    assert not count(pixels, LETHAL)
    assert count(pixels, ARROW) > 500
    walled = OccupancyGrid(np.where(np.eye(8, 12) > 0, 100, 0).astype(np.int8), 0.5)
    assert count(rgb(potential_image(potential(walled), title="t")), LETHAL) > 8 * 20 * 20


def test_arrows_turn_with_the_grid_s_own_axes():
    images = []
    for yaw in (0.0, 0.7):
        grid = OccupancyGrid(np.zeros((8, 12), np.int8), 0.5, (0.0, 0.0, yaw))
        goal = tuple(grid.frame.xy_from_rowcol([[4, 10]])[0])
        pixels = rgb(potential_image(potential(grid, goal=goal), title="t"))
        arrows = np.argwhere(np.all(pixels == ARROW, axis=2))
        images.append(arrows - arrows.min(axis=0))
    # but for pixels that rounding has moved, the picture of the map is the same
    first, second = ({tuple(p) for p in image.tolist()} for image in images)
    assert len(first & second) > 0.97 * max(len(first), len(second))


def test_a_route_is_drawn_where_it_leads():
    costmap = Costmap(np.zeros((10, 20), np.uint8), 0.5, (3.0, -1.0, 0.4))
    ends = costmap.frame.xy_from_rowcol([[2, 2], [2, 17]])
    route = shortest_route(costmap, tuple(ends[0]), tuple(ends[1]))
    pixels = rgb(cost_image(costmap, title="t", overlay=RouteOverlay(route)))
    plain = rgb(cost_image(costmap, title="t"))
    assert not count(plain, ROUTE)
    drawn = np.argwhere(np.all(pixels == ROUTE, axis=2))
    start, goal = (np.argwhere(np.all(pixels == c, axis=2)) for c in (START, GOAL))
    height, width = pixels.shape[:2]
    on_map = drawn[drawn[:, 1] < 0.7 * width]
    assert np.ptp(on_map[:, 0]) <= 4  # a level line
    assert start[:, 1].min() < on_map[:, 1].min() < on_map[:, 1].max() < goal[:, 1].max()
    assert on_map[:, 0].mean() > height / 2  # in the south


def test_the_place_of_a_local_minimum_is_marked():
    costmap = Costmap(np.zeros((10, 20), np.uint8), 0.5)
    stopped = Route("descent", False, (1.0, 1.0), (9.0, 4.0), [[1.0, 1.0], [5.0, 2.0]], 4.1, 4.1,
                    1.0, local_minimum=(5.0, 2.0))  # fmt: skip
    assert count(rgb(cost_image(costmap, title="t", overlay=RouteOverlay(stopped))), MINIMUM) > 50
