import pytest

from engines import ENGINES
from mapdeal.kernels import engine


@pytest.fixture(params=ENGINES, scope="module")
def each_engine(request):
    """Run the tests of a module on each engine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(engine.VARIABLE, request.param)
        yield request.param
