"""The engines that a test can run on."""

import pytest

from mapdeal.kernels import engine

needs_compiled = pytest.mark.skipif(
    engine.compiled_module() is None, reason="the compiled kernels were not built"
)
ENGINES = [
    pytest.param("compiled", marks=needs_compiled),
    pytest.param("scipy", marks=pytest.mark.slow),
]
