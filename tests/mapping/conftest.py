import math

import pytest

from kernels.conftest import each_engine  # noqa: F401 - a fixture


def cell_of(x, y, corner=(0.0, 0.0), resolution=0.25):
    """The row and column of a place on a lattice; borders are within a rounding of the next."""
    return tuple(
        math.floor((c - first) / resolution + 1e-9)
        for c, first in zip((y, x), corner[1::-1], strict=True)
    )


@pytest.fixture
def build(command, tmp_path):
    """Return a function that builds map.yaml of a cloud: exit code, stdout and stderr."""
    output = "-o", tmp_path / "map.yaml", "--force"
    return lambda cloud, *words: command("build", "--cloud", cloud, *words, *output)
