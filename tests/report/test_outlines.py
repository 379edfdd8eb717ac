"""Outlines of cells: they enclose these cells and no others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapdeal.grid.frame import Frame
from mapdeal.report.document import outlines_of

FRAME = Frame(7, 9, 0.25, (1.5, -2.0, 0.4))


def encloses(lines, x, y):
    """Return whether a ray to the right crosses the lines an odd number of times."""
    crossings = 0
    for line in lines:
        for (x0, y0), (x1, y1) in zip(line[:-1].tolist(), line[1:].tolist(), strict=True):
            if (y0 > y) != (y1 > y):
                crossings += x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x
    return crossings % 2 == 1


def area_of(line):
    x, y = line[:, 0], line[:, 1]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)


@given(arrays(bool, FRAME.shape, elements=st.booleans()))
def test_outlines_enclose_their_cells_alone(marked):
    if not marked.any():
        return
    lines = outlines_of(np.argwhere(marked), FRAME)
    assert all((line[0] == line[-1]).all() for line in lines)
    area = sum(map(area_of, lines))
    assert area == pytest.approx(np.count_nonzero(marked) * FRAME.resolution**2)
    every = [(row, col) for row in range(FRAME.height) for col in range(FRAME.width)]
    for cell, (x, y) in zip(every, FRAME.xy_from_rowcol(every).tolist(), strict=True):
        assert encloses(lines, x, y) == marked[cell], cell


def test_a_rectangle_has_four_corners():
    rows, cols = np.mgrid[1:4, 2:8]
    (line,) = outlines_of(np.stack([rows.ravel(), cols.ravel()], axis=1), FRAME)
    assert len(line) == 5
