import io
import zipfile
import zlib

import numpy as np
import pytest
from PIL import Image

from mapdeal import DistanceField, OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.npz import write_npz
from mapdeal.maps.png import (
    PART,
    deflated,
    pieces,
    write_grey_png,
    write_indexed_png,
    write_rgba_png,
)

SIZES = [0, 1, PART - 1, PART, PART + 1, 3 * PART + 12_345]


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
    whole = b"".join(deflated(pieces(data)))
    assert len(whole) < 1.3 * (len(block) + len(data) // 258 * 3)


def encoded(write, *arrays):
    file = io.BytesIO()
    write(file, *arrays)
    assert file.getvalue().endswith(b"IEND\xaeB`\x82")
    return file


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (1100, 1003), (3, 700_000)])
def test_pictures_are_those_that_a_reader_sees(shape):
    pixels, palette = noise(shape[0] * shape[1]).reshape(shape), noise(768).reshape(256, 3)
    rgba = noise(4 * shape[0] * shape[1]).reshape(*shape, 4)
    with Image.open(encoded(write_grey_png, pixels[::-1])) as image:
        assert image.mode == "L"
        assert np.array_equal(image, pixels[::-1])
    with Image.open(encoded(write_indexed_png, pixels, palette)) as image:
        assert np.array_equal(image, pixels)
        assert np.array_equal(image.convert("RGB"), palette[pixels])
    with Image.open(encoded(write_rgba_png, rgba)) as image:
        assert image.mode == "RGBA"
        assert np.array_equal(image, rgba)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(2, 3), (1500, 1300)])
def test_an_npz_is_one_for_zipfile_and_for_numpy(shape):
    rng = np.random.default_rng(1)
    occupancy = rng.choice(np.array([-1, 0, 100], dtype=np.int8), shape)
    distance = rng.random(shape, dtype=np.float32)
    file = io.BytesIO()
    write_npz(file, DistanceField(distance, occupancy, 0.05, (1.0, -2.0, 0.3)))
    with zipfile.ZipFile(file) as archive:
        assert archive.testzip() is None
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_DEFLATED}
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        assert np.array_equal(arrays["distance"], distance)
        assert arrays["distance"].dtype == np.float32
        assert np.array_equal(arrays["occupancy"], occupancy)
        assert arrays["resolution"].shape == ()
        assert str(arrays["format"]) == "mapdeal/1"


def test_what_repeats_itself_becomes_small():
    file = io.BytesIO()
    write_npz(file, OccupancyGrid(np.zeros((2000, 2000), np.int8), 0.05))
    assert len(file.getvalue()) < 40_000


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_more_parts_are_taken_than_threads_are_busy_with(threads):
    taken = 0

    def parts():
        nonlocal taken
        for _ in range(12):
            taken += 1
            yield noise(PART).data

    with use_threads(threads):
        stream = deflated(parts())
        next(stream)
        assert taken <= threads + 1
        next(stream)
        assert taken <= threads + 2


def test_a_picture_of_several_bands_has_the_checksums_of_each_and_of_all():
    pixels = noise(1100 * 1003).reshape(1100, 1003)
    data = encoded(write_grey_png, pixels).getvalue()
    stream, at = b"", 8
    while at < len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        assert int.from_bytes(data[end : end + 4], "big") == zlib.crc32(data[at + 4 : end])
        stream += data[at + 8 : end] if data[at + 4 : at + 8] == b"IDAT" else b""
        at = end + 4
    rows = zlib.decompress(stream)  # which refuses a wrong checksum
    assert rows == b"".join(b"\0" + row.tobytes() for row in pixels)
