"""Drawing on maps and costmaps, against recordings of costmap_2d and by hand."""

import json
import math
import re
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import cells, grid_from_text
from mapdeal import (
    BitMap,
    Circle,
    Costmap,
    FindingError,
    Frame,
    Line,
    MapdealWarning,
    OccupancyGrid,
    Polygon,
    draw,
)

EMPTY = "......\n......\n......\n......"


def turned(grid, points):
    """Points given in cells (column, row) of a grid, in the map frame."""
    x, y, yaw = grid.origin
    cos, sin = math.cos(yaw), math.sin(yaw)
    step = grid.resolution
    return [(x + step * (u * cos - v * sin), y + step * (u * sin + v * cos)) for u, v in points]


def peers(folder):
    about = json.loads((folder / "expected" / "peers.json").read_text())
    with np.load(folder / "expected" / "peers.npz") as arrays:
        for key, case in about.items():
            if key.startswith("polygon/"):
                yield key, case, arrays[f"{key}/out"]


def test_convex_polygons_are_those_of_costmap_2d_cell_for_cell(real_maps):
    refused = 0
    for key, case, expected in peers(real_maps):
        shape = (case["height"], case["width"])
        untouched = np.full(shape, 7, np.uint8)
        costmap = Costmap(untouched, case["resolution"], (*case["origin"], 0.0))
        polygon = Polygon(case["polygon"])
        if not case["ok"]:
            refused += 1
            with pytest.raises(FindingError, match="map"):
                draw(costmap, polygon, value=case["cost"], strict=True)
            assert np.array_equal(expected, untouched), key
            continue
        drawn = draw(costmap, polygon, value=case["cost"], strict=True)
        assert np.array_equal(drawn.cost, expected), key
    assert refused == 7


def test_what_costmap_2d_refuses_is_the_part_inside_of_a_larger_map(real_maps):
    for key, case, _ in peers(real_maps):
        if case["ok"]:
            continue
        height, width, resolution = case["height"], case["width"], case["resolution"]
        x, y = case["origin"]
        margin = 2000
        large = Costmap(
            np.zeros((height + 2 * margin, width + 2 * margin), np.uint8),
            resolution,
            (x - margin * resolution, y - margin * resolution, 0.0),
        )
        small = Costmap(np.zeros((height, width), np.uint8), resolution, (x, y, 0.0))
        polygon = Polygon(case["polygon"])
        whole = draw(large, polygon, value=200, strict=True).cost
        with pytest.warns(MapdealWarning, match="map"):
            clipped = draw(small, polygon, value=200).cost
        inner = slice(margin, margin + height), slice(margin, margin + width)
        assert np.array_equal(clipped, whole[inner]), key


@pytest.mark.parametrize("yaw", [0.0, 0.4, math.pi / 2, -2.5])
def test_shapes_are_drawn_on_the_turned_map(yaw):
    grid = grid_from_text(EMPTY, 0.25, (1.5, -2.0, yaw))
    polygon = Polygon(turned(grid, [(1.5, 0.5), (4.5, 0.5), (4.5, 2.5), (1.5, 2.5)]))
    drawn = draw(grid, polygon, value=100)
    assert np.array_equal(drawn.occupancy, cells("......\n.####.\n.####.\n.####."))
    assert (drawn.resolution, drawn.origin) == (grid.resolution, grid.origin)
    line = Line(turned(grid, [(0.5, 3.5), (2.5, 3.5)]))
    assert np.array_equal(
        draw(grid, line, value=100).occupancy, cells("###...\n......\n......\n......")
    )
    circle = Circle(turned(grid, [(2.5, 1.5)])[0], 0.25)
    expected = cells("......\n..#...\n.###..\n..#...")
    assert np.array_equal(draw(grid, circle, value=100).occupancy, expected)


def test_what_of_a_hole_lies_outside_means_nothing():
    grid = OccupancyGrid(np.zeros((9, 9), np.int8), 0.25, (1.5, -2.0, 0.4))
    outer = turned(grid, [(1.5, 1.5), (5.5, 1.5), (5.5, 5.5), (1.5, 5.5)])
    plain = draw(grid, Polygon(outer), value=100).occupancy
    away = turned(grid, [(6.5, 6.5), (8.5, 6.5), (8.5, 8.5), (6.5, 8.5)])
    assert np.array_equal(draw(grid, Polygon(outer, [away]), value=100).occupancy, plain)
    half = turned(grid, [(3.5, 2.5), (8.5, 2.5), (8.5, 4.5), (3.5, 4.5)])
    drawn = draw(grid, Polygon(outer, [half, half]), value=100).occupancy
    assert (drawn <= plain).all()
    assert np.argwhere(drawn != plain).tolist() == [[3, 4], [3, 5]]


def test_a_line_through_several_points_joins_them():
    grid = grid_from_text(EMPTY)
    line = Line(turned(grid, [(0.5, 0.5), (3.5, 0.5), (3.5, 3.5)]))
    assert np.array_equal(
        draw(grid, line, value=100).occupancy, cells("...#..\n...#..\n...#..\n####..")
    )


@given(
    st.tuples(st.floats(-1, 8), st.floats(-1, 6)), st.tuples(st.floats(-1, 8), st.floats(-1, 6)),
    st.floats(0.05, 4), st.floats(-3, 3),
)  # fmt: skip
def test_round_shapes_by_distance_in_the_map_frame(a, b, size, yaw):
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, yaw))
    (ax, ay), (bx, by) = turned(grid, [a, b])
    size *= grid.resolution
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        circle = draw(grid, Circle((ax, ay), size), value=100).occupancy
        line = draw(grid, Line([(ax, ay), (bx, by)], thickness=size), value=100).occupancy
    thin = {
        (y, x)
        for x, y in oracles.line(*[tuple(map(math.floor, np.array(p) + 1e-9)) for p in (a, b)])
    }
    for row, col in np.ndindex(grid.shape):
        centre = grid.frame.xy_from_rowcol([[row, col]])[0]
        if abs(math.dist(centre, (ax, ay)) - size) > 1e-9:
            within = math.dist(centre, (ax, ay)) < size
            own = (row, col) == tuple(math.floor(v + 1e-9) for v in a[::-1])
            assert (circle[row, col] == 100) == (within or own)
        distance = oracles.distance_to_segment(centre, (ax, ay), (bx, by))
        if abs(distance - size / 2) > 1e-9:
            within = distance < size / 2 and size > grid.resolution  # up to a cell: single cells
            assert (line[row, col] == 100) == (within or (row, col) in thin)


@given(
    st.tuples(st.floats(-1, 8), st.floats(-1, 6)),
    st.sampled_from([0.0, 0.3, 1.0]),
    st.floats(-3, 3),
)
def test_a_circle_of_radius_0_and_a_point_of_a_line_are_the_cell_that_holds_them(at, cells, yaw):
    """Drawn on maps and on bits; by hand, the floor of the coordinates."""
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, yaw))
    (point,) = turned(grid, [at])
    expected = np.zeros(grid.shape, dtype=bool)
    row, col = (math.floor(v + 1e-9) for v in at[::-1])
    if 0 <= row < 5 and 0 <= col < 7:
        expected[row, col] = True
    bits = BitMap.from_occupancy(grid)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        for shape in (Circle(point, 0.0), Line([point, point], thickness=cells * 0.25)):
            drawn = draw(grid, shape, value=100).occupancy
            assert np.array_equal(drawn == 100, expected)
            assert np.array_equal(draw(bits, shape, value=1).to_mask(), expected)
    assert np.array_equal(bits.circle(point, 0).to_mask(), expected)
    assert np.array_equal(bits.line([point, point]).to_mask(), expected)


def test_a_line_of_a_cell_s_thickness_is_that_of_single_cells_and_clips_nothing():
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), 0.25, (1.5, -2.0, 0.4))
    ends = turned(grid, [(0.1, 0.1), (6.9, 3.2)])
    thin = draw(grid, Line(ends), value=100).occupancy
    for thickness in (0.1, 0.25):
        line = Line(ends, thickness=thickness)
        assert np.array_equal(draw(grid, line, value=100, strict=True).occupancy, thin)
    with pytest.raises(FindingError, match="its thickness"):
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


def test_bits_with_overlays():
    bits = BitMap.from_mask([[0, 1, 0, 1]], 0.5, (1.0, 2.0, 0.0))
    line = Line([(1.25, 2.25), (2.25, 2.25)])
    cases = [("max", 1, [1, 1, 1, 1]), ("max", 0, [0, 1, 0, 1])]
    cases += [("min", 1, [0, 1, 0, 1]), ("min", 0, [0, 0, 0, 1])]
    for overlay, value, expected in cases:
        drawn = draw(bits, line, value=value, overlay=overlay)
        assert drawn.to_mask()[0].tolist() == expected


def test_bit_maps_are_drawn_on_as_maps_are():
    rng = np.random.default_rng(5)
    mask = rng.random((9, 21)) < 0.3
    bits = BitMap.from_mask(mask, 0.25, (1.5, -2.0, 0.4))
    grid = bits.to_occupancy()
    shapes = [
        Polygon(turned(grid, [(2, 2), (18, 3), (9, 8)])),
        Line(turned(grid, [(1.5, 7.5), (19.5, 1.5)]), thickness=0.6),
    ]
    drawn = draw(bits, shapes, value=1).to_occupancy().occupancy
    assert np.array_equal(drawn, draw(grid, shapes, value=100).occupancy)
    circle = Circle(turned(grid, [(10, 4)])[0], 0.8)
    cleared = draw(bits, circle, value=0).to_occupancy().occupancy
    assert np.array_equal(cleared, draw(grid, circle, value=0).occupancy)


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        (
            Polygon([(9, 9), (10, 9), (9, 10)]),
            "polygon: vertex 1, (9, 9), lies outside of the map",
        ),
        (Polygon([(0, 0), (1.25, 0), (0, 0.9)]), "vertex 2, (1.25, 0) (upper edges belong to no"),
        (
            Polygon([(0.5, 0.5), (9, 0.5), (0.5, 0.9)]),
            "(9, 0.5), lies outside of the map; the sh",
        ),
        (
            Polygon([(0.2, 0.2), (0.6, 0.6), (0.9, 0.9)]),
            "polygon: has no area, its corners lie on a",
        ),
        (Line([(0.5, 0.5), (3.0, 0.5)]), "line: vertex 2, (3, 0.5), lies"),
        (Line([(0.5, 0.5), (0.6, 0.5)], thickness=2.0), "line: its thickness lies"),
        (Circle((0.5, 0.5), 0.6), "circle: its rim lies"),
        (Circle((1.1, 0.5), 0.2), "its rim lies"),
        (Circle((0.5, 0.9), 0.2), "its rim lies"),
        (Circle((-0.1, 0.5), 0.05), "circle: its center lies outside of the map; nothing"),
    ],
)
def test_what_cannot_be_drawn_as_meant_is_a_warning_or_with_strict_a_finding(shape, text):
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.25)
    with pytest.warns(MapdealWarning, match=re.escape(text)):
        draw(grid, shape, value=100)
    with pytest.raises(FindingError, match=re.escape(text.split(";")[0])) as caught:
        draw(grid, [Circle((0.5, 0.5), 0.1), shape], value=100, strict=True)
    assert caught.value.exit_code == 1
    assert str(caught.value).startswith("shape 2, ")
    assert str(caught.value).endswith("nothing was drawn")


def test_a_polygon_without_area_is_drawn_as_a_line():
    grid = grid_from_text(EMPTY)
    with pytest.warns(MapdealWarning, match="no area"):
        drawn = draw(grid, Polygon(turned(grid, [(0.5, 1.5), (3.5, 1.5), (1.5, 1.5)])), value=100)
    assert np.array_equal(drawn.occupancy, cells("......\n......\n####..\n......"))


def test_a_shape_that_just_fits_is_none_of_these():
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.25, (1.0, 2.0, 0.0))
    shapes = [Circle((1.5, 2.5), 0.5), Polygon([(1.0, 2.0), (2.24, 2.0), (2.24, 2.99)])]
    assert draw(grid, shapes, value=100, strict=True).occupancy.any()


def test_a_polygon_that_touches_itself_does_not_cross_itself():
    # (0.27, 0.24) lies on the first edge, in decimals.
    Polygon([(0, 0), (0.9, 0.8), (0.1, 1.7), (0.27, 0.24), (-0.8, 0.9)])
    # Points along a straight side, collinear up to rounding.
    Polygon([(-0.03270609045458613, -0.8725950306968094), (-0.030782202780786947,
            -0.8212659112440559), (-0.013467213716594291, -0.35930383616927447),
            (-0.011543326042795106, -0.30797471671652094)])  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("middle", [0.0, 1e3, 5e5])
def test_turned_rectangles_with_many_points_a_side_are_simple(middle):
    rng = np.random.default_rng(4)
    side = np.linspace(0, 1, 100, endpoint=False)
    u = np.concatenate([side, np.ones(100), 1 - side, np.zeros(100)]) * 3
    v = np.concatenate([np.zeros(100), side, np.ones(100), 1 - side])
    for turn in rng.uniform(0, 7, 30):
        x, y = middle + u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
        Polygon(np.c_[x, y].tolist())


def test_a_shape_of_a_thousand_kilometres_is_clipped_in_no_time():
    frame = Frame(4, 5, 0.05)
    (spans,) = Polygon([(-1e6, -1e6), (1e6, -1e6), (1e6, 1e6), (-1e6, 1e6)]).spans(frame)
    assert int((spans.stops - spans.starts).sum()) == 20
    bent = Polygon([(-1e6, -1e6), (1e6, -1e6), (0, -1e5), (1e6, 1e6), (-1e6, 1e6)])
    values = np.zeros((4, 5), dtype=np.uint8)
    (spans,) = bent.spans(frame)
    for row, start, stop in zip(*(column.tolist() for column in spans), strict=True):
        values[row, start:stop] = 1
    assert values.all()
