"""Cells of points: compiled code beside numpy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal.grid.frame import Frame
from mapdeal.kernels import engine

pytestmark = needs_compiled


@given(
    st.sampled_from([0.05, 0.1, 0.25, 1 / 3]),
    st.tuples(*[st.floats(-1e6, 1e6)] * 2, st.floats(-4, 4)),
    st.lists(st.tuples(*[st.integers(-400, 400).map(lambda k: k / 8)] * 2), min_size=1),
)
def test_both_engines_find_the_same_cells_on_edges_too(resolution, origin, places):
    frame = Frame(3, 5, resolution, origin)
    points = frame.xy_from_continuous_rowcol(places)
    compiled = frame.unbounded_rowcol_from_xy(points)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(engine.VARIABLE, "scipy")
        by_numpy = frame.unbounded_rowcol_from_xy(points)
    assert compiled.tolist() == by_numpy.tolist()
    assert compiled.dtype == by_numpy.dtype
