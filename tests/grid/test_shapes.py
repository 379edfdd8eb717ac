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
        (lambda: Circle((0, 0), 0), "radius"),
        (lambda: Circle((0, 0), math.inf), "radius"),
    ],
)
def test_shapes_that_are_none_are_refused_by_name(make, named):
    with pytest.raises(ParameterError, match=named):
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
    spans = Polygon([(-1e6, -1e6), (1e6, -1e6), (1e6, 1e6), (-1e6, 1e6)]).spans(frame)
    assert int((spans.stops - spans.starts).sum()) == 20
    bent = Polygon([(-1e6, -1e6), (1e6, -1e6), (0, -1e5), (1e6, 1e6), (-1e6, 1e6)])
    values = np.zeros((4, 5), dtype=np.uint8)
    spans = bent.spans(frame)
    for row, start, stop in zip(*(column.tolist() for column in spans), strict=True):
        values[row, start:stop] = 1
    assert values.all()
