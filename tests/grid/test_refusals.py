import math

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Circle, Costmap, Footprint, Frame, Line, ParameterError, Polygon, draw
from mapdeal.grid.canvas import on_canvas, resampled
from mapdeal.grid.frame import Transform, check_point, region_of
from mapdeal.grid.values import static_layer_cost_from_occupancy

MAP = grid_from_text("#...?\n#....\n##..#")
BITS = mapdeal.BitMap.from_mask(np.zeros((2, 9)), 0.25)
COSTS, PUBLISHED = Costmap([[0, 1]], 0.5), Costmap([[0, 1]], 0.5, scale="occupancy")
ROBOT, DOT = Footprint.circle(0.2), Circle((0.5, 0.5), 0.1)
UPRIGHT = Frame(5, 8, 0.5, (1.0, -2.0, 0.0))


@pytest.mark.parametrize(
    ("value", "call", "words"),
    [
        (value, call, words)
        for call, words, values in [
            (BITS.get, "cell", [[[0, 9]], [[-1, 0]], [[2, 0]], [[0.5, 0]], [[1, 2, 3]]]),
            (BITS.set, "cell", [[[0, 9]], [[0]]]),
            (BITS.accept_value, "0 or 1", [2]),
            (lambda arguments: mapdeal.BitMap(*arguments, 0.25), None,
             [([[0, 0]], 8), ([[0]], 9), ([[0]], 0), ([0], 8), ([[256]], 8)]),
            (lambda frame: on_canvas(MAP, frame), "not aligned",
             [Frame(9, 9, 0.2, MAP.origin), Frame(9, 9, 0.25, (1.5, -2.0, 0.5)),
              Frame(9, 9, 0.25, (1.4, -2.0, 0.4))]),
            (lambda frame: on_canvas(MAP, frame), "the whole grid",
             [MAP.frame.window(0, 0, 2, 9), MAP.frame.window(1, -1, 9, 9)]),
            (lambda cells: mapdeal.OccupancyGrid(cells, 0.05), None,
             [[[101]], [[-2]], [[0.5]], [[]], [0, 1], [[300]]]),
            (lambda side: mapdeal.OccupancyGrid([[0]], side), "resolution",
             [math.nan, 0.99e-6, 1.01e6]),
            (lambda at: mapdeal.OccupancyGrid([[0]], 1.0, at), "origin must be",
             [(1.01e12, 0, 0), (0, -1.01e12, 0)]),
            (lambda at: check_point(at, "goal"), "goal", [(1.01e12, 0), (0, -1.01e12)]),
            (lambda cost: Costmap(cost, 0.2), None, [[[-1]], [[256]]]),
            (lambda cost: Costmap(cost, 0.2, scale="occupancy"), r"must lie in -1..100",
             [[[-2, 0]], [[0, 101]]]),
            (COSTS.accept_value, "whole number", [-1, 256, 2.5, math.nan]),
            (PUBLISHED.accept_value, "whole number", [-2, 101]),
            (mapdeal.esdf(MAP).query, "shape", [[1.0, 2.0, 3.0], [[1.0, 2.0, 3.0]], 1.0]),
            (lambda options: mapdeal.ViewScale(**options), None,
             [{"view": "polar"}, {"view_range": 0.0}, {"farthest": -1.0}, {"deepest": math.inf}]),
            *[(rowcol, "finite", [[(0, 0), (math.nan, 0)], [(1e13, 0)]])
              for rowcol in (MAP.frame.unbounded_rowcol_from_xy, MAP.frame.clamped_rowcol_from_xy)],
            (lambda size: region_of(UPRIGHT, size, corner_xy=(1.0, 1.0)), None,
             [(0.0, 1.0), (1.0, 0.0)]),
            (lambda place: region_of(UPRIGHT, (1.0, 1.0), **place), None,
             [{}, {"corner_xy": (1.0, 1.0), "center_xy": (1.0, 1.0)}]),
            (lambda rule: resampled(MAP, MAP.frame, rule=rule), "one of area, nearest", ["median"]),
            (lambda options: static_layer_cost_from_occupancy(**options), "0 to 100",
             [{"lethal_threshold": 101}, {"lethal_threshold": -1}, {"lethal_threshold": 65.5},
              {"inscribed_value": 101}]),
            (lambda options: Transform(**options), "(x|y|yaw): must be a finite number",
             [{"x": 1e13}, {"y": math.inf}, {"yaw": -1e13}]),
            (lambda cells: mapdeal.OccupancyGrid(cells, 0.05), "must not have masked cells",
             [np.ma.masked_equal([[0, 100]], 100)]),
            (lambda value: draw(MAP, DOT, value=value), "-1 to 100", [101, -2]),
            (lambda value: draw(MAP, DOT, value=value), "needs a value", [None]),
            (lambda shapes: draw(MAP, shapes, value=100), "shapes: must be Polygon, Line or Circle",
             [[(0, 0), (1, 1)], "circle", [None]]),
            (lambda word: draw(BITS, DOT, value=1, overlay=word), "overlay", ["add"]),
            (lambda poses: mapdeal.footprint_costs(COSTS, ROBOT, poses),
             "poses must be an array of x, y", [[[1, 2]], [1, 2], [[[1, 2, 3]]], 5]),
            (lambda rule: mapdeal.footprint_costs(COSTS, ROBOT, [[0, 0, 0]], rule=rule),
             "rule: must be one of outline, full, got 'inside'", ["inside"]),
            (lambda costs: mapdeal.footprint_costs(costs, ROBOT, [[0, 0, 0]]),
             "cost scale: .* costmap2d, got 'occupancy'", [PUBLISHED]),
            (lambda shape: shape.spans(Frame(4, 5, 0.05)),  # too many cells to be counted
             "(polygon vertex 3|line vertex 2|circle radius)",
             [Polygon([(0, 0), (1, 0), (0, 1e9)]), Line([(0, 0), (-1e9, 0)]), Circle((0, 0), 1e9)]),
        ]
        for value in values
    ],
    ids=lambda parameter: None if callable(parameter) else repr(parameter)[:40],
)  # fmt: skip
def test_values_that_are_none_are_refused(value, call, words):
    with pytest.raises(ParameterError, match=words):
        call(value)


@pytest.mark.parametrize(("shape", "points", "words"), [
    (Polygon, [(0, 0), (1, 1)], "three vertices"),
    (Polygon, [(0, 0), (1, 1), (math.nan, 0)], "polygon vertex 3"),
    (Polygon, [(0, 0), (math.inf, 1), (0, 2)], "polygon vertex 2"),
    (Polygon, [(0, 0), (1, 1), (1, 2, 3)], "polygon vertex 3"),
    (Polygon, [(0, 0), (2, 2), (2, 0), (0, 2)], "polygon vertex 1.*vertex 3"),
    (Polygon, [(0, 0), (1, 1), (1, 0), (0, 1e-6)], "vertex 1"),
    (Polygon, [(5e5, 0), (5e5 + 1, 1), (5e5 + 1, 0), (5e5, 0.01)], "crosses"),
    (lambda hole: Polygon([(0, 0), (9, 0), (0, 9)], [hole]), [(1, 1), (2, 2)], "hole"),
    (Polygon, None, "list of vertices"),
    (Polygon, [(0, 0), (1, 1), None], "pair of numbers"),
    (Line, [(0, 0)], "two vertices"),
    *[(lambda width: Line([(0, 0), (1, 1)], thickness=width), width, "thickness")
      for width in (-1, math.nan, "a")],
    (lambda center: Circle(center, 1), (0, math.nan), "circle vertex 1"),
    (lambda center: Circle(center, 1), 3, "pair of numbers"),
    *[(lambda radius: Circle((0, 0), radius), radius, "radius")
      for radius in (-0.1, math.inf, None)],
    (Footprint.sixteen_gon, 0.0, "radius"),
], ids=lambda parameter: None if callable(parameter) else repr(parameter)[:40])  # fmt: skip
def test_shapes_that_are_none_are_refused_by_name(shape, points, words):
    with pytest.raises(ParameterError, match=words):
        shape(points)


def test_vertices_of_all_holes_are_counted(monkeypatch):
    monkeypatch.setattr("mapdeal.grid.shapes._MOST_VERTICES", 8)
    triangle = [(0, 0), (9, 0), (0, 9)]
    Polygon(triangle, [triangle])
    with pytest.raises(ParameterError, match="hole 2 has at most 2 vertices"):
        Polygon(triangle, [triangle, triangle])


@pytest.mark.parametrize(("words", "text"), [
    ("three", "[[0.1, 0.2], [0.3, 0.4]]"),
    ("vertex 3", "[[0.1, 0.2], [0.3, 0.4], [0.5]]"),
    ("vertex 2", "[[0.1, 0.2], [nan, 0.4], [0.5, 0.1]]"),
    ("vertex 3", "[[0.1, 0.2], [0.3, 0.4], [1e9, 0.1]]"),
    ("vertex 1", "[[1,1],[-1,-1],[1,-1],[-1,1]]"),
    *[("look like", text) for text in [
        "", "0.3", "[]", "[[]]", "[" * 500, "[[" + "1" * 300, "[[" + "1." * 200 + "]]",
        "[[1,1]" + " " * 500, "[[1,1],[2,2],[3,1]", "[1,1],[2,2],[3,1]]", "[[[1,1],[2,2],[3,1]]]",
        "[[1,1] [2,2],[3,1]]", "[[1,1],[2,2],[3,1],]", "[[1,1],[2,2],[3,1]]x", "[[1,1],[2,2],[]]",
        "[[1,1],[2,2],[3,]]", "[[1,1],[2,2],[3 1]]", "[[1,1],[2,2],[3,1_0]]",
        "[[1,1],[2,2],[3,\x1b[31m1]]",
    ]],
])  # fmt: skip
def test_footprints_as_text_are_refused_at_once_in_printable_words(words, text):
    with pytest.raises(ParameterError, match=words) as caught:
        Footprint.parse(text)
    assert str(caught.value).isprintable()
