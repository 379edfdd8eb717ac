import io
import zlib

import numpy as np
import pytest
from PIL import Image

from mapdeal.maps.png import PART, write_grey_png, write_indexed_png, write_rgba_png

ROWS, COLUMNS = 2 * PART // 1300, 1300  # more than one band
SHAPES = [(1, 1), (3, 5), (ROWS, COLUMNS)]


def decoded(write, *arrays):
    buffer = io.BytesIO()
    write(buffer, *arrays)
    assert buffer.getvalue().endswith(b"IEND\xaeB`\x82")
    buffer.seek(0)
    image = Image.open(buffer)
    image.load()  # decoders check the sums of chunks, and that of the whole
    return image


@pytest.mark.parametrize("shape", SHAPES)
def test_pixels_come_back(shape):
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 256, shape, np.uint8)
    assert np.array_equal(decoded(write_grey_png, grey), grey)
    rgba = rng.integers(0, 256, (*shape, 4), np.uint8)
    assert np.array_equal(decoded(write_rgba_png, rgba), rgba)
    palette = rng.integers(0, 256, (256, 3), np.uint8)
    image = decoded(write_indexed_png, grey, palette)
    assert np.array_equal(image, grey)
    assert np.array_equal(image.convert("RGB"), palette[grey])


def test_the_sum_over_all_rows_is_the_last_part_of_the_stream():
    grey = np.random.default_rng(2).integers(0, 256, (ROWS, COLUMNS), np.uint8)
    buffer = io.BytesIO()
    write_grey_png(buffer, grey)
    data, stream, at = buffer.getvalue(), b"", 8
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert int.from_bytes(data[at + 8 + length : at + 12 + length], "big") == zlib.crc32(
            name + body
        )
        stream += body if name == b"IDAT" else b""
        at += 12 + length
    assert len(zlib.decompress(stream)) == ROWS * (COLUMNS + 1)  # it checks the sum
