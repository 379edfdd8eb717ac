import io
import zlib

import numpy as np
import pytest
from PIL import Image

from mapdeal.kernels.threads import use_threads
from mapdeal.maps import png
from mapdeal.maps.png import PART, deflated, pieces
from maps.pictures import pixels_in, read_image

SIZES = [0, 1, PART - 1, PART, PART + 1, 2 * PART + 12_345]


def noise(size, levels=256):
    return np.random.default_rng(size).integers(0, levels, size, dtype=np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_stream_gives_the_data_back_and_is_the_same_by_any_number_of_threads(size):
    data, streams = noise(size, levels=4), []
    for threads in (1, 2, 5):
        with use_threads(threads):
            streams.append(b"".join(deflated(pieces(data))))
    assert streams[0] == streams[1] == streams[2]
    reader = zlib.decompressobj(-15)
    assert reader.decompress(streams[0]) == data.tobytes()
    assert reader.eof
    assert reader.unused_data == b""


def test_parts_know_the_end_of_the_one_before():
    block = noise(1 << 14)
    data = np.tile(block, 2 * PART // len(block))
    stream = b"".join(deflated(pieces(data)))
    assert len(stream) < 1.3 * (len(block) + len(data) // 258 * 3)


def encoded(write, *arrays):
    file = io.BytesIO()
    write(file, *arrays)
    assert file.getvalue().endswith(b"IEND\xaeB`\x82")
    return file


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (1100, 1003), (3, 400_000)])
def test_pictures_are_those_that_readers_see(tmp_path, shape):
    pixels, palette = noise(shape[0] * shape[1]).reshape(shape), noise(768).reshape(256, 3)
    rgba = noise(4 * shape[0] * shape[1]).reshape(*shape, 4)
    grey = encoded(png.write_grey_png, pixels[::-1])
    (tmp_path / "m.png").write_bytes(grey.getvalue())
    assert np.array_equal(read_image(tmp_path / "m.png").samples, pixels[::-1])  # with checksums
    assert len(pixels_in(grey.getvalue())) == shape[0] * (1 + shape[1])
    with Image.open(grey) as image:
        assert (image.mode, np.array_equal(image, pixels[::-1])) == ("L", True)
    with Image.open(encoded(png.write_indexed_png, pixels, palette)) as image:
        assert np.array_equal(image, pixels)
        assert np.array_equal(image.convert("RGB"), palette[pixels])
    with Image.open(encoded(png.write_rgba_png, rgba)) as image:
        assert (image.mode, np.array_equal(image, rgba)) == ("RGBA", True)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_more_parts_are_taken_than_threads_are_busy_with(threads):
    count = 0

    def parts():
        nonlocal count
        for _ in range(12):
            count += 1
            yield noise(PART).data

    with use_threads(threads):
        stream = deflated(parts())
        next(stream)
        assert count <= threads + 1
        next(stream)
        assert count <= threads + 2
