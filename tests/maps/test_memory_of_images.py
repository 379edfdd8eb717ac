"""A run keeps to its memory whatever its image, or says before that it cannot.

Processes of their own are measured, since a peak is never taken back.
"""

from pathlib import Path

import pytest

from files.large_files import IMAGES
from mapdeal.kernels.engine import engine_name
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.inputs import bytes_to_read
from measuring import measured

SLACK = 1.1

NAMES = [
    "grey.png", "opacity.png", "palette.png", "wide.png", "interlaced.png", "opacity.bmp",
    "progressive.jpg", "raw.tif", "colours.tif", "fax.tif", "p6.ppm",
]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's own figures")
@pytest.mark.skipif(engine_name() != "compiled", reason="takes minutes without compiled kernels")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("allowed", [125, 160])
def test_a_run_keeps_to_the_memory(tmp_path, name, allowed):
    IMAGES[name](tmp_path / name)
    path = (tmp_path / name).with_suffix(".yaml")
    with open_map(path) as file:
        needed = bytes_to_read(file.memory_to_read())
    words = ["run", path, "-o", "out", "-q", "--no-images", "--max-memory", f"{allowed}MB"]
    code, _, memory = measured(tmp_path, *words, "--threads", "2")
    is_possible = name == "p6.ppm" or needed < allowed * 1_000_000  # which is read by strips
    assert code == (0 if is_possible else 3)
    assert memory < SLACK * allowed * 1_000_000
