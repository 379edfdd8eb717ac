"""BMP files hold what was written, whichever way up and with whatever header."""

import struct

import numpy as np
import pytest

from mapdeal.maps import picture as strips
from mapdeal.maps.images import read_image

HEIGHT, WIDTH = 7, 11
KINDS = [
    (bits, is_os2, top_down)
    for bits in (1, 4, 8, 24, 32)
    for is_os2, top_down in ((False, False), (False, True), (True, False))
    if (bits, is_os2) != (32, True)
]


def bmp(bits, pixels, palette, *, top_down=False, is_os2=False, colours=0, gap=0):
    """The bytes of a file: indices, or blue, green, red and so on, row 0 in the north."""
    rows = []
    for row in pixels:
        if bits <= 8:
            digits = "".join(f"{int(value):0{bits}b}" for value in row)
            digits += "0" * (-len(digits) % 8)
            data = bytes(int(digits[i : i + 8], 2) for i in range(0, len(digits), 8))
        else:
            data = row.tobytes()
        rows.append(data + bytes(-len(data) % 4))
    table = b"".join(bytes(entry) + (b"" if is_os2 else b"\0") for entry in palette)
    if is_os2:
        header = struct.pack("<IHHHH", 12, WIDTH, HEIGHT, 1, bits)
    else:
        height = -HEIGHT if top_down else HEIGHT
        header = struct.pack("<IiiHHIIiiII", 40, WIDTH, height, 1, bits, 0, 0, 0, 0, colours, 0)
    body = b"".join(rows if top_down else rows[::-1])
    start = 14 + len(header) + len(table) + gap
    size = start + len(body)
    return struct.pack("<2sIHHI", b"BM", size, 0, 0, start) + header + table + bytes(gap) + body


def colours_of(picture):
    """Red, green and blue of each pixel."""
    return picture.samples if picture.palette is None else picture.palette[picture.samples, :3]


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0, 6])
@pytest.mark.parametrize(("bits", "is_os2", "top_down"), KINDS)
def test_pixels_are_those_that_were_written(tmp_path, monkeypatch, bits, is_os2, top_down, gap):
    rng = np.random.default_rng(bits)
    count = 1 << bits if bits <= 8 else 0
    palette = rng.integers(0, 256, (count, 3)).astype(np.uint8)  # blue, green, red
    if bits <= 8:
        pixels = rng.integers(0, count, (HEIGHT, WIDTH))
        expected = palette[pixels][..., ::-1]
    else:
        pixels = rng.integers(0, 256, (HEIGHT, WIDTH, bits // 8)).astype(np.uint8)
        expected = pixels[..., 2::-1]
    path = tmp_path / "m.bmp"
    path.write_bytes(bmp(bits, pixels, palette, top_down=top_down, is_os2=is_os2, gap=gap))
    monkeypatch.setattr(strips, "STRIP", 3 * WIDTH * max(1, bits // 8))
    picture = read_image(path)
    assert np.array_equal(colours_of(picture), expected)
    if bits == 32:
        assert np.array_equal(picture.alpha, pixels[..., 3])
