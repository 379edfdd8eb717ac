import pytest

from mapdeal.kernels import engine

NO_KERNELS = "the compiled kernels were not built"
needs_compiled = pytest.mark.skipif(engine.compiled_module() is None, reason=NO_KERNELS)
ENGINES = [pytest.param("compiled", marks=needs_compiled),
           pytest.param("scipy", marks=pytest.mark.slow)]  # fmt: skip
