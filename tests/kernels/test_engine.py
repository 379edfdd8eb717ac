"""Which engine is taken."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.kernels import engine


@pytest.mark.parametrize(
    ("requested", "is_built", "name"),
    [("scipy", True, "scipy"), ("scipy", False, "scipy"), ("compiled", True, "compiled"),
     ("", True, "compiled"), ("", False, "scipy"), (None, True, "compiled")],
)  # fmt: skip
def test_the_engine_is_that_of_the_variable(monkeypatch, requested, is_built, name):
    monkeypatch.setattr(engine, "compiled_module", lambda: engine if is_built else None)
    if requested is None:
        monkeypatch.delenv(engine.VARIABLE, raising=False)
    else:
        monkeypatch.setenv(engine.VARIABLE, requested)
    assert engine.engine_name() == name


@pytest.mark.parametrize("requested", ["compiled", "numpy", "SCIPY"])
def test_an_unknown_engine_is_refused(monkeypatch, requested):
    monkeypatch.setattr(engine, "compiled_module", lambda: None)
    monkeypatch.setenv(engine.VARIABLE, requested)
    with pytest.raises(ParameterError, match=engine.VARIABLE):
        engine.engine_name()


@needs_compiled
@given(
    st.sampled_from([0.05, 0.1, 0.25, 1 / 3]),
    st.tuples(*[st.floats(-1e6, 1e6)] * 2, st.floats(-4, 4)),
    st.lists(st.tuples(*[st.integers(-400, 400).map(lambda k: k / 8)] * 2), min_size=1),
)
def test_both_engines_find_the_same_cells_on_edges_too(resolution, origin, places):
    frame = Frame(3, 5, resolution, origin)
    points = frame.xy_from_continuous_rowcol(places)
    compiled, by_numpy = by_each_engine(lambda: frame.unbounded_rowcol_from_xy(points))
    assert compiled.tolist() == by_numpy.tolist()
    assert compiled.dtype == by_numpy.dtype
