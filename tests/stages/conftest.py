from kernels.conftest import each_engine  # noqa: F401 - a fixture
