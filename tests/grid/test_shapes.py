import math

import numpy as np
import pytest

from mapdeal import Circle, Frame, Line, ParameterError, Polygon


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Polygon([(0, 0), (1, 1)]), "three vertices"),
        (lambda: Polygon([(0, 0), (1, 1), (math.nan, 0)]), "polygon vertex 3"),
        (lambda: Polygon([(0, 0), (math.inf, 1), (0, 2)]), "polygon vertex 2"),
        (lambda: Polygon([(0, 0), (1, 1), (1, 2, 3)]), "polygon vertex 3"),
        (lambda: Polygon([(0, 0), (2, 2), (2, 0), (0, 2)]), "polygon vertex 1.*vertex 3"),
        (lambda: Polygon([(0, 0), (9, 0), (0, 9)], [[(1, 1), (2, 2)]]), "hole"),
        (lambda: Line([(0, 0)]), "two vertices"),
        (lambda: Line([(0, 0), (1, 1)], thickness=-1), "thickness"),
        (lambda: Line([(0, 0), (1, 1)], thickness=math.nan), "thickness"),
        (lambda: Circle((0, math.nan), 1), "circle vertex 1"),
        (lambda: Circle((0, 0), -0.1), "radius"),
        (lambda: Circle((0, 0), math.inf), "radius"),
    ],
)
def test_shapes_that_are_none_are_refused_by_name(make, named):
    with pytest.raises(ParameterError, match=named):
        make()


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


def test_crossings_are_found_beside_touches():
    with pytest.raises(ParameterError, match="vertex 1"):
        Polygon([(0, 0), (1, 1), (1, 0), (0, 1e-6)])
    with pytest.raises(ParameterError, match="crosses"):
        Polygon([(5e5, 0), (5e5 + 1, 1), (5e5 + 1, 0), (5e5, 0.01)])


@pytest.mark.slow
@pytest.mark.parametrize(
    "make",
    [
        lambda: Polygon(None),
        lambda: Polygon("abc"),
        lambda: Polygon([(0, 0), (1, 1), None]),
        lambda: Line([(0, 0), (1, 1)], thickness="a"),
        lambda: Circle((0, 0), None),
        lambda: Circle(3, 1),
        lambda: Polygon([(0, 0), (9, 0), (0, 9)], [[(k, 0), (k, 1), (0, 1)] for k in range(4000)]),
    ],
)
def test_what_is_no_shape_at_all_is_a_parameter_error(make):
    with pytest.raises(ParameterError):
        make()


@pytest.mark.parametrize(
    ("shape", "named"),
    [
        (Polygon([(0, 0), (1, 0), (0, 1e9)]), "polygon vertex 3"),
        (Line([(0, 0), (-1e9, 0)]), "line vertex 2"),
        (Circle((0, 0), 1e9), "circle radius"),
    ],
)
def test_shapes_that_go_on_for_ever_are_refused_not_counted(shape, named):
    with pytest.raises(ParameterError, match=named):
        shape.spans(Frame(4, 5, 0.05))


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
