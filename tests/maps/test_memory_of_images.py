"""Reading an image takes what its header told, and netpbm maps take little more than their cells.

Processes of their own are measured, since a peak is never taken back.
"""

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mapdeal.kernels.engine import engine_name
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.inputs import bytes_to_read

SIDE = 3000
CELLS = SIDE * SIDE
SLACK = 1.1
ROWS = np.tile(np.repeat(np.array([254, 0, 205], np.uint8), SIDE // 3), (SIDE, 1))
ROWS[::7, ::11] = 0

# The peak of a process begins with that of its parent: this one is small.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, *sys.argv[1:]], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def peak(folder, *words):
    """Bytes that a command takes at its peak."""
    taken, code = peak_and_code(folder, *words)
    assert code == 0
    return taken


def peak_and_code(folder, *words):
    """Bytes that a command takes at its peak, and its exit code."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, "-m", "mapdeal", *map(str, words)],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    return int(done.stdout) * 1024, done.returncode


def saved(mode, name, **options):
    """What writes the map's picture in one of Pillow's modes."""

    def write(path):
        grey = Image.fromarray(ROWS)
        if mode == "I;16":
            grey = Image.fromarray(ROWS.astype(np.uint16) * 257)
        elif mode == "P":
            grey = Image.fromarray(np.dstack([ROWS] * 3)).quantize(4)
        elif mode != "L":
            grey = grey.convert(mode)
        grey.save(path, name, **options)

    return write


def interlaced(path):
    """Pillow writes no such pictures."""
    rows = b"".join(
        b"\0" + part.tobytes()
        for col, row, across, down in [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4),
                                       (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]
        for part in ROWS[row::down, col::across]
    )  # fmt: skip
    header = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 1)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(rows, 1)), (b"IEND", b"")]
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for name, body in chunks:
            checksum = zlib.crc32(name + body)
            file.write(struct.pack(">I", len(body)) + name + body + struct.pack(">I", checksum))


def netpbm(path):
    path.write_bytes(b"P6\n%d %d\n255\n" % (SIDE, SIDE) + np.dstack([ROWS] * 3).tobytes())


STREAMED = {"colours.ppm": netpbm}
WHOLE = {
    "grey.png": saved("L", "PNG", compress_level=1),
    "colours.png": saved("RGB", "PNG", compress_level=1),
    "opacity.png": saved("RGBA", "PNG", compress_level=1),
    "both.png": saved("LA", "PNG", compress_level=1),
    "palette.png": saved("P", "PNG", compress_level=1),
    "wide.png": saved("I;16", "PNG", compress_level=1),
    "colours.bmp": saved("RGB", "BMP"),
    "opacity.bmp": saved("RGBA", "BMP"),
    "interlaced.png": interlaced,
    "grey.jpg": saved("L", "JPEG"),
    "progressive.jpg": saved("RGB", "JPEG", progressive=True),
    "raw.tif": saved("L", "TIFF"),
    "lzw.tif": saved("RGB", "TIFF", compression="tiff_lzw"),
    "fax.tif": saved("1", "TIFF", compression="group4"),
}


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Write the map with a picture of some name; return the name of its YAML file."""
    folder = tmp_path_factory.mktemp("images")

    def write(name):
        (STREAMED | WHOLE)[name](folder / name)
        path = folder / f"{name}.yaml"
        path.write_text(
            f"image: {name}\nresolution: 0.05\norigin: [1.5, -2.0, 0.4]\n"
            "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        )
        return path

    return write


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Bytes of a command on a map of next to no cells, whose picture Pillow reads."""
    folder = tmp_path_factory.mktemp("base")
    Image.fromarray(ROWS[:8, :8]).save(folder / "m.png")
    (folder / "m.yaml").write_text("image: m.png\nresolution: 0.05\norigin: [0, 0, 0]\n")
    return peak(folder, "convert", "m.yaml", "-o", "out.pgm", "-q")


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's own figures")
@pytest.mark.parametrize("name", [*STREAMED, *WHOLE])
def test_reading_takes_what_the_header_told(pair, base, tmp_path, name):
    path = pair(name)
    taken = peak(tmp_path, "convert", path, "-o", "out.pgm", "-q", "--max-memory", "4GB")
    with open_map(path) as file:
        told = bytes_to_read(file.memory_to_read())
    assert taken < told
    if name in STREAMED:
        assert taken - base < 3 * CELLS


@pytest.mark.thorough
@pytest.mark.skipif(engine_name() != "compiled", reason="takes minutes without compiled kernels")
@pytest.mark.parametrize("name", [*STREAMED, *WHOLE])
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
