"""Reading an image takes what its header told, and netpbm maps take little more than their cells.

Processes of their own are measured, since a peak is never taken back.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from files.large_files import GREYS, IMAGES, H, W
from mapdeal.kernels.engine import engine_name
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.inputs import bytes_to_read

CELLS = H * W
SLACK = 1.1

# The peak of a process begins with that of its parent: this one is small.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, *sys.argv[1:]], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def peak_and_code(folder, *words):
    """Bytes that a command takes at its peak, and its exit code."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, "-m", "mapdeal", *map(str, words)],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    return int(done.stdout) * 1024, done.returncode


STREAMED = {"p6.ppm"}
NAMES = [
    "grey.png", "colours.png", "opacity.png", "both.png", "palette.png", "wide.png",
    "interlaced.png", "colours.bmp", "opacity.bmp", "grey.jpg", "progressive.jpg", "raw.tif",
    "colours.tif", "fax.tif", "p6.ppm",
]  # fmt: skip


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Write the map with a picture of some name; return the name of its YAML file."""
    folder = tmp_path_factory.mktemp("images")

    def write(name):
        IMAGES[name](folder / name)
        return (folder / name).with_suffix(".yaml")

    return write


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Bytes of a command on a map of next to no cells, whose picture Pillow reads."""
    folder = tmp_path_factory.mktemp("base")
    Image.fromarray(GREYS[:8, :8]).save(folder / "m.png")
    (folder / "m.yaml").write_text("image: m.png\nresolution: 0.05\norigin: [0, 0, 0]\n")
    return peak_and_code(folder, "convert", "m.yaml", "-o", "out.pgm", "-q")[0]


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's own figures")
@pytest.mark.parametrize("name", NAMES)
def test_reading_takes_what_the_header_told(pair, base, tmp_path, name):
    path = pair(name)
    words = ["convert", path, "-o", "out.pgm", "-q", "--max-memory", "4GB"]
    taken, code = peak_and_code(tmp_path, *words)
    assert code == 0
    with open_map(path) as file:
        told = bytes_to_read(file.memory_to_read())
    assert taken < told
    if name in STREAMED:
        assert taken - base < 3 * CELLS


@pytest.mark.thorough
@pytest.mark.skipif(engine_name() != "compiled", reason="takes minutes without compiled kernels")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("allowed", [125, 160])
def test_a_run_keeps_to_the_memory(pair, tmp_path, name, allowed):
    """What must be decoded as a whole may be too much, which is said before."""
    path = pair(name)
    with open_map(path) as file:
        is_possible = name in STREAMED or bytes_to_read(file.memory_to_read()) < allowed * 1_000_000
    words = ["run", path, "-o", "out", "-q", "--no-images", "--max-memory", f"{allowed}MB"]
    taken, code = peak_and_code(tmp_path, *words, "--threads", "2")
    assert code == (0 if is_possible else 3)
    assert taken < SLACK * allowed * 1_000_000
