import pytest

from engines import ENGINES
from mapdeal.kernels import engine
from mapdeal.kernels.threads import use_threads


@pytest.fixture(params=ENGINES, scope="module")
def each_engine(request):
    """Run the tests of a module on each engine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(engine.VARIABLE, request.param)
        yield request.param


def by_each_engine(work, threads=(1,)):
    """What the compiled kernels make of some work, with so many threads each, and their twins."""
    if engine.compiled_module() is None:
        pytest.skip("the compiled kernels were not built")
    products = []
    for name, count in [*(("compiled", count) for count in threads), ("scipy", 1)]:
        with pytest.MonkeyPatch.context() as patch, use_threads(count):
            patch.setenv(engine.VARIABLE, name)
            products.append(work())
    return products
