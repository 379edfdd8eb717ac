"""Lines, polygons and discs of cells against loops over all cells."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import oracles
from mapdeal.kernels.polygons import (
    FARTHEST_CELL,
    Spans,
    bands,
    capsule_spans,
    edges_through,
    line_spans,
    paint,
    polygon_spans,
)

HEIGHT, WIDTH = 7, 11
CELLS = st.tuples(st.integers(-9, 16), st.integers(-9, 20))
POSITIONS = st.tuples(st.floats(-5, 12), st.floats(-5, 16))


def painted(parts, shape=(HEIGHT, WIDTH)):
    """The cells of spans as a set of (x, y)."""
    values = np.zeros(shape, dtype=np.uint8)
    for spans in [parts] if isinstance(parts, Spans) else parts:
        paint(values, spans, 1)
    return {(x, y) for y, x in np.argwhere(values).tolist()}


def inside(cells):
    return {(x, y) for x, y in cells if 0 <= x < WIDTH and 0 <= y < HEIGHT}


def swapped(cells):
    return [(b, a) for a, b in cells]


@given(CELLS, CELLS)
def test_a_line_visits_the_cells_of_costmap_2d_clipped(start, stop):
    spans = line_spans(edges_through([start, stop]), (HEIGHT, WIDTH))
    assert painted(spans) == inside(oracles.line(*swapped([start, stop])))


@pytest.mark.parametrize(
    ("start", "stop", "cells"),
    [
        ((0, 0), (4, 2), [(0, 0), (1, 1), (2, 1), (3, 2), (4, 2)]),
        ((4, 2), (0, 0), [(4, 2), (3, 1), (2, 1), (1, 0), (0, 0)]),
        ((3, 3), (3, 3), [(3, 3)]),
    ],
)
def test_recorded_lines(start, stop, cells):
    assert oracles.line(start, stop) == cells
    assert painted(line_spans(edges_through([start[::-1], stop[::-1]]), (HEIGHT, WIDTH))) == set(
        cells
    )


def test_a_line_to_the_farthest_cell_stays_exact():
    # Slope 1/2 from (0, 0): after i steps n // 2 + i * minor is still exact at 2^61.
    far = FARTHEST_CELL
    (spans,) = line_spans(edges_through([(0, 0), (far, far // 2)]), (5, 9))
    assert [column.tolist() for column in spans] == [
        [0, 1, 2, 3, 4], [0, 1, 1, 2, 2], [1, 2, 2, 3, 3],
    ]  # fmt: skip
    (spans,) = line_spans(edges_through([(-far, -far), (far, far)]), (3, 9))
    assert [column.tolist() for column in spans] == [[0, 1, 2], [0, 1, 2], [1, 2, 3]]


@given(st.lists(CELLS, min_size=2, max_size=6))
def test_several_lines_in_small_parts_are_the_same(cells):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", 3)
        parts = list(line_spans(edges_through(cells), (HEIGHT, WIDTH)))
    ends = swapped(cells)
    expected = {c for a, b in itertools.pairwise(ends) for c in oracles.line(a, b)}
    assert painted(parts) == inside(expected)


@st.composite
def rings(draw, least=3, most=7):
    return draw(st.lists(CELLS, min_size=least, max_size=most))


@given(rings())
@example([(0, 0), (0, 0), (0, 0)])
@example([(2, 3), (5, 9), (2, 3)])
def test_any_ring_is_outline_and_inside(ring):
    expected = oracles.ring_fill([swapped(ring)], WIDTH, HEIGHT)
    assert painted(polygon_spans([ring], (HEIGHT, WIDTH))) == expected


@given(rings(), st.lists(rings(3, 4), max_size=3), st.sampled_from([2, 1 << 20]))
def test_holes_leave_out_their_inside_but_not_their_edge(ring, holes, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", together)
        found = painted(polygon_spans([ring, *holes], (HEIGHT, WIDTH)))
    solid = oracles.ring_fill([swapped(ring)], WIDTH, HEIGHT)
    rims = {c for hole in holes for c in oracles.outline(swapped(hole))}
    hollow = {c for hole in holes for c in oracles.ring_fill([swapped(hole)], WIDTH, HEIGHT)}
    assert found == solid - (hollow - rims)


@st.composite
def convex_polygons(draw):
    """Points in convex position and in order, in cells: some of a turned ellipse."""
    angles = draw(st.lists(st.floats(0, 6.28), min_size=3, max_size=9, unique=True))
    middle, turn = draw(POSITIONS), draw(st.floats(0, 3))
    long, short = draw(st.floats(0.1, 12)), draw(st.floats(0.01, 12))
    points = []
    for angle in sorted(angles):
        u, v = long * math.cos(angle), short * math.sin(angle)
        points.append((
            middle[0] + u * math.cos(turn) - v * math.sin(turn),
            middle[1] + u * math.sin(turn) + v * math.cos(turn),
        ))  # fmt: skip
    return points


@pytest.mark.slow
@given(convex_polygons())
@settings(max_examples=500)
def test_convex_polygons_are_filled_as_costmap_2d_fills_columns(points):
    ring = [(math.floor(row), math.floor(col)) for row, col in points]
    expected = inside(oracles.convex_fill(swapped(ring)))
    assert painted(polygon_spans([ring], (HEIGHT, WIDTH))) == expected


@given(POSITIONS, POSITIONS, st.floats(0, 9))
@example((3.5, 5.5), (3.5, 5.5), 0.0)
@example((3.5, 5.5), (3.5, 5.5), 2.0)
@example((2.5, 2.5), (2.5, 8.5), 1.0)
@example((2.5, 2.5), (6.5, 2.5), 1.0)
@example((2.0, 3.0), (2.0000000000000004, 9.0), 1.5)
@example((1.5, 1.5), (4.5, 5.5), 2.5)
def test_a_capsule_holds_the_centres_within_its_radius(start, stop, radius):
    found = painted(capsule_spans(start, stop, radius, (HEIGHT, WIDTH)))
    for x in range(WIDTH):
        for y in range(HEIGHT):
            distance = oracles.distance_to_segment((y + 0.5, x + 0.5), start, stop)
            if abs(distance - radius) > 1e-7:
                assert ((x, y) in found) == (distance < radius)
            elif abs(distance - radius) < 1e-12:
                assert (x, y) in found


@given(
    st.lists(st.tuples(st.integers(-5, 45), st.integers(0, 60)), min_size=1, max_size=30),
    st.integers(1, 50),
)
def test_bands_hold_all_rows_and_not_too_many_at_once(ranges, most):
    height = 40
    starts = np.array([first for first, _ in ranges])
    stops = starts + [count for _, count in ranges]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.kernels.polygons.MOST_TOGETHER", most)
        found = list(bands(starts, stops, height))
    rows = [row for first, stop in found for row in range(first, stop)]
    used = {r for a, b in zip(starts, stops, strict=True) for r in range(max(a, 0), min(b, height))}
    assert len(rows) == len(set(rows))
    assert used <= set(rows) <= set(range(height))
    for first, stop in found:
        per_row = [int(((starts <= r) & (r < stops)).sum()) for r in range(first, stop)]
        assert sum(per_row) <= most + max(per_row)
