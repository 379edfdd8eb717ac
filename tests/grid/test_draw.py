"""Drawing on maps and costmaps, against recordings of costmap_2d and by hand."""

import cmath
import json
import math
import re
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
import oracles
from mapdeal import Circle, Costmap, Line, MapdealWarning, OccupancyGrid, Polygon, draw


def turned(grid, points):
    """Points given in cells (column, row) of a grid, in the map frame."""
    x, y, yaw = grid.origin
    moved = complex(x, y) + grid.resolution * cmath.exp(1j * yaw) * (np.array(points) @ [1, 1j])
    return [(place.real, place.imag) for place in moved.tolist()]


def cells_of(points):
    return [tuple(math.floor(v + 1e-9) for v in point) for point in points]


@pytest.fixture(scope="module")
def peers(real_maps):
    """Polygons that costmap_2d has drawn: the cells, or None where it refused."""
    about = json.loads((real_maps / "expected" / "peers.json").read_text())
    polygons = {key: case for key, case in about.items() if key.startswith("polygon/")}
    with np.load(real_maps / "expected" / "peers.npz") as arrays:
        return [(case, arrays[f"{k}/out"] if case["ok"] else None) for k, case in polygons.items()]


def costs_of(case, margin, value):
    shape = (case["height"] + 2 * margin, case["width"] + 2 * margin)
    x, y = (place - margin * case["resolution"] for place in case["origin"])
    return Costmap(np.full(shape, value, np.uint8), case["resolution"], (x, y, 0.0))


def test_convex_polygons_are_those_of_costmap_2d_cell_for_cell(peers):
    refused = 0
    for case, expected in peers:
        small, polygon = costs_of(case, 0, 7), Polygon(case["polygon"])
        if expected is not None:
            drawn = draw(small, polygon, value=case["cost"], strict=True)
            assert np.array_equal(drawn.cost, expected), case
            continue
        # a polygon that it refuses equals the part of one inside of a larger map
        refused += 1
        with pytest.raises(mapdeal.FindingError, match="map"):
            draw(small, polygon, value=200, strict=True)
        with pytest.warns(MapdealWarning, match="map"):
            clipped = draw(small, polygon, value=200).cost
        in_larger_map = draw(costs_of(case, 2000, 7), polygon, value=200, strict=True).cost
        assert np.array_equal(clipped, in_larger_map[2000:-2000, 2000:-2000]), case
    assert refused == 7


def off_tolerance(coordinate):
    """Whether rounding cannot move a coordinate across the tolerance of an edge of cells."""
    return abs(coordinate + 1e-9 - round(coordinate + 1e-9)) > 1e-12


POINTS = st.tuples(*(st.floats(-1, most).filter(off_tolerance) for most in (8, 6)))
SIZES = st.floats(0.05, 4) | st.sampled_from([0.0, 0.3, 1.0])


@pytest.mark.usefixtures("mapdeal_warnings")
@given(st.lists(POINTS, min_size=3, max_size=3), POINTS, st.floats(0.1, 3), st.floats(-3, 3))
def test_polygons_by_the_cells_of_their_corners_on_the_turned_map(corners, hole_from, side, yaw):
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, yaw))
    u, v = hole_from
    hole = [(u, v), (u + side, v), (u, v + side)]
    solid, hollow = (oracles.ring_fill([cells_of(ring)], 7, 5) for ring in (corners, hole))
    drawn = draw(grid, Polygon(turned(grid, corners), [turned(grid, hole)]), value=100)
    assert (drawn.resolution, drawn.origin) == (grid.resolution, grid.origin)
    cells = {(x, y) for y, x in np.argwhere(drawn.occupancy).tolist()}
    assert cells == solid - (hollow - set(oracles.outline(cells_of(hole))))


@pytest.mark.usefixtures("mapdeal_warnings")
@given(POINTS, st.none() | POINTS, SIZES, st.floats(-3, 3))
def test_round_shapes_by_distance_in_the_map_frame(a, b, size, yaw):
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, yaw))
    bits = mapdeal.BitMap.from_occupancy(grid)
    own = cells_of([a, b or a])
    start, end = turned(grid, [a, b or a])
    size *= grid.resolution
    line_reach = size / 2 if size > grid.resolution else -1.0  # up to a cell: single cells
    circle, line = Circle(start, size), Line([start, end], thickness=size)
    for shape, on_bits, far, reach, single in (
        (circle, bits.circle(start, size), start, size, own[:1]),
        (line, bits.line([start, end], thickness=size), end, line_reach, oracles.line(*own)),
    ):
        drawn = draw(grid, shape, value=100).occupied()
        assert np.array_equal(draw(bits, shape, value=1).to_mask(), drawn)
        assert np.array_equal(on_bits.to_mask(), drawn)
        for row, col in np.ndindex(grid.shape):
            centre = grid.frame.xy_from_rowcol([[row, col]])[0]
            distance = oracles.distance_to_segment(centre, start, far)
            if abs(distance - reach) > 1e-9:
                assert drawn[row, col] == (distance < reach or (col, row) in single)


CORNERS = st.lists(st.tuples(st.integers(-9, 24), st.integers(-9, 24)), min_size=3, max_size=3)


@given(
    st.lists(st.tuples(CORNERS, st.integers(-1, 100), st.booleans()), max_size=9),
    st.sampled_from(["seq", "max", "min"]), st.integers(1, 40), st.integers(-1, 100),
)  # fmt: skip
def test_many_shapes_are_those_drawn_one_by_one(drawn, overlay, together, background):
    grid = OccupancyGrid(np.full((12, 15), background, np.int8), 0.5, (1.0, -2.0, 0.7))
    shapes = [
        Line(turned(grid, points), value=value) if is_line
        else Polygon(turned(grid, np.add(points, 0.5)), value=value)
        for points, value, is_line in drawn
    ]  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.grid.shapes._ROWS_TOGETHER", together)
        at_once, texts = drawn_with_warnings(grid, shapes, overlay=overlay)
    expected, texts_alone = grid.occupancy.copy(), []
    for shape in shapes:
        blank = OccupancyGrid(np.zeros_like(expected), 0.5, grid.origin)
        drawn_alone, more = drawn_with_warnings(blank, replaced(shape), value=100, overlay="max")
        texts_alone += more
        own, old = shape.value, expected[drawn_alone.occupied()]
        wins = own > old if overlay == "max" else own < old
        wins = (own != -1) & (wins | (old == -1)) if overlay != "seq" else np.full(old.shape, True)
        expected[drawn_alone.occupied()] = np.where(wins, own, old)
    assert np.array_equal(at_once.occupancy, expected)
    assert sorted(texts) == sorted(texts_alone)


def drawn_with_warnings(*arguments, **options):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        drawn = draw(*arguments, **options)
    return drawn, [str(warning.message).split(": ", 1)[1] for warning in found]


def replaced(shape):
    """Return a shape with the value 100; a polygon with a hole far away, so drawn by itself."""
    if isinstance(shape, Line):
        return Line(shape.points_xy, value=100)
    return Polygon(shape.points_xy, [[(900, 900), (901, 900), (900, 901)]], value=100)


@pytest.mark.parametrize("count", [5, 16, 17, 30])
def test_edges_that_cross_are_refused_however_many_there_are(count):
    angles = 2 * np.pi * np.arange(count) / count
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert Polygon(np.add(points, [1e3, 3e6]).tolist()).has_extent()  # however far away
    points[[2, 3]] = points[[3, 2]]
    with pytest.raises(mapdeal.ParameterError, match="crosses the one that starts at vertex 4"):
        Polygon(points.tolist())


def test_a_line_of_a_cell_s_thickness_clips_nothing():
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, 0.4))
    ends = turned(grid, [(0.1, 0.1), (6.9, 3.2)])
    assert draw(grid, Line(ends, thickness=0.25), value=100, strict=True).occupied().any()
    with pytest.raises(mapdeal.FindingError, match="its thickness"):
        draw(grid, Line(ends, thickness=0.26), value=100, strict=True)


def test_the_last_shape_is_on_top_and_its_own_value_counts_first():
    grid = Costmap(np.full((3, 4), 7, np.uint8), 0.5, (1.0, 2.0, 0.0))
    wide = Polygon([(1.1, 2.1), (2.9, 2.1), (2.9, 3.4), (1.1, 3.4)], value=253)
    drawn = draw(grid, iter([wide, Circle((1.75, 2.75), 0.2)]), value=0)
    assert drawn.cost.tolist() == [[253] * 4, [253, 0, 253, 253], [253] * 4]
    assert grid.cost.tolist() == [[7] * 4] * 3


@pytest.mark.parametrize("scale", ["costmap2d", "occupancy"])
@pytest.mark.parametrize(("overlay", "wins"), [("max", max), ("min", min)])
def test_the_larger_or_the_smaller_value_wins_and_unknown_gives_way(scale, overlay, wins):
    unknown, top = (255, 254) if scale == "costmap2d" else (-1, 100)
    values = [unknown, *range(top + 1)]
    dtype = np.uint8 if scale == "costmap2d" else np.int8
    grid = Costmap(np.array([values], dtype), 0.5, (1.0, 2.0, 0.0), scale)
    line = Line([(1.25, 2.25), (0.75 + 0.5 * len(values), 2.25)])
    for value in (0, 50, top):
        drawn = draw(grid, line, value=value, overlay=overlay).cost[0].tolist()
        assert drawn == [value, *(wins(old, value) for old in values[1:])]
    assert (draw(grid, line, value=unknown).cost == unknown).all()
    assert np.array_equal(draw(grid, line, value=unknown, overlay=overlay).cost, grid.cost)


@pytest.mark.parametrize(("shape", "text"), [
    (Polygon([(9, 9), (10, 9), (9, 10)]), "polygon: vertex 1, (9, 9), lies outside of the map"),
    (Polygon([(0, 0), (1.25, 0), (0, 0.9)]), "vertex 2, (1.25, 0) (upper edges belong to no"),
    (Polygon([(0.5, 0.5), (9, 0.5), (0.5, 0.9)]), "(9, 0.5), lies outside of the map; the sh"),
    (Polygon([(0.2, 0.2), (0.6, 0.6), (0.9, 0.9)]), "no area, its corners lie on a"),
    (Line([(0.5, 0.5), (3.0, 0.5)]), "line: vertex 2, (3, 0.5), lies"),
    (Line([(0.5, 0.5), (0.6, 0.5)], thickness=2.0), "line: its thickness lies"),
    (Circle((0.5, 0.5), 0.6), "circle: its rim lies"),
    (Circle((1.1, 0.5), 0.2), "its rim lies"),
    (Circle((0.5, 0.9), 0.2), "its rim lies"),
    (Circle((-0.1, 0.5), 0.05), "circle: its center lies outside of the map; nothing"),
], ids=lambda parameter: parameter.split()[0] if isinstance(parameter, str) else None)  # fmt: skip
def test_what_cannot_be_drawn_as_meant_is_a_warning_or_with_strict_a_finding(shape, text):
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.25)
    with pytest.warns(MapdealWarning, match=re.escape(text)):
        draw(grid, shape, value=100)
    with pytest.raises(mapdeal.FindingError, match=re.escape(text.split(";")[0])) as caught:
        draw(grid, [Circle((0.5, 0.5), 0.1), shape], value=100, strict=True)
    assert caught.value.exit_code == 1
    assert re.fullmatch(r"shape 2, .*nothing was drawn", str(caught.value))


def test_a_shape_that_just_fits_is_none_of_these():
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.25, (1.0, 2.0, 0.0))
    shapes = [Circle((1.5, 2.5), 0.5), Polygon([(1.0, 2.0), (2.24, 2.0), (2.24, 2.99)])]
    assert draw(grid, shapes, value=100, strict=True).occupancy.any()


@pytest.mark.parametrize("middle", [0.0, 1e3, 5e5])
def test_outlines_that_touch_themselves_do_not_cross_themselves(middle):
    # (0.27, 0.24) lies on the first edge, in decimals
    Polygon([(0, 0), (0.9, 0.8), (0.1, 1.7), (0.27, 0.24), (-0.8, 0.9)])
    # many points along the straight sides of a turned square, collinear up to rounding
    side = np.linspace(0, 3, 15, endpoint=False)
    square = np.concatenate([side, 3 + 1j * side, 3 + 3j - side, 3j - 1j * side])
    for turn in (0.1, 0.8, 2.0, 4.4):
        corners = square * np.exp(1j * turn) + middle
        Polygon(np.c_[corners.real, corners.imag].tolist())


def test_a_shape_of_a_thousand_kilometres_is_clipped_in_no_time():
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.05)
    square = [(-1e6, -1e6), (1e6, -1e6), (1e6, 1e6), (-1e6, 1e6)]
    for corners in (square, [*square[:2], (0, -1e5), *square[2:]]):
        with pytest.warns(MapdealWarning, match="outside"):
            assert (draw(grid, Polygon(corners), value=100).occupancy == 100).all()
