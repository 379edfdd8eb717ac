"""Which engine is taken."""

import pytest

from mapdeal import ParameterError
from mapdeal.kernels import engine


@pytest.mark.parametrize(
    ("asked", "is_built", "name"),
    [
        ("scipy", True, "scipy"),
        ("scipy", False, "scipy"),
        ("compiled", True, "compiled"),
        ("", True, "compiled"),
        ("", False, "scipy"),
        (None, True, "compiled"),
        (None, False, "scipy"),
    ],
)
def test_the_engine_is_the_one_that_is_asked_for(monkeypatch, asked, is_built, name):
    monkeypatch.setattr(engine, "compiled_module", lambda: engine if is_built else None)
    if asked is None:
        monkeypatch.delenv(engine.VARIABLE, raising=False)
    else:
        monkeypatch.setenv(engine.VARIABLE, asked)
    assert engine.engine_name() == name


@pytest.mark.parametrize("asked", ["compiled", "numpy", "SCIPY"])
def test_an_engine_that_there_is_not_is_refused(monkeypatch, asked):
    monkeypatch.setattr(engine, "compiled_module", lambda: None)
    monkeypatch.setenv(engine.VARIABLE, asked)
    with pytest.raises(ParameterError, match=engine.VARIABLE):
        engine.engine_name()
