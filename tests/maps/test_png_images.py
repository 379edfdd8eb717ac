"""PNG files of all kinds hold the pixels that were written, and what else is said of them."""

import io
import os
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, strategies as st
from PIL import Image

from bad_maps import yaml_text
from mapdeal import MalformedInputError, MapdealWarning, read_map
from mapdeal.files.source import use_memory
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import picture as strips, png as png_module
from mapdeal.maps.dialects import DIALECTS, MapMetadata, cells_of
from mapdeal.maps.images import open_image, read_image_size
from mapdeal.maps.png import PART, deflated, pieces
from maps.pictures import adam7, chunk, file_of, pixels_in, read_image
from strategies import examples
from traced_memory import memory_below

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
KINDS = [(0, 1), (0, 2), (0, 4), (0, 8), (0, 16), (2, 8), (2, 16), (3, 1), (3, 2), (3, 4), (3, 8),
         (4, 8), (4, 16), (6, 8), (6, 16)]  # fmt: skip
PIXELS = np.tile(np.arange(5, dtype=np.uint8), (3, 1))
MODES = st.sampled_from(["trinary", "scale", "raw"])


def png(kind, width, rows, *before):
    pixels = chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows)))
    colour_type, depth = kind
    facts = {"depth": depth, "colour_type": colour_type}
    return file_of(width, len(rows), *before, pixels, **facts)


def pixels_of(kind, width, rows, key):
    """Return samples, bit by bit, and opacities if there is a transparent colour.

    The samples are brightness up to 255 or 65535, or indices.
    """
    colour_type, depth = kind
    bits = [np.unpackbits(np.frombuffer(row, np.uint8)) for row in rows]
    weights, count = 2 ** np.arange(depth)[::-1], CHANNELS[colour_type]
    values = [row[: len(row) // depth * depth].reshape(-1, depth) @ weights for row in bits]
    pixels = values = np.array([row[: width * count] for row in values])
    if colour_type == 0 and depth < 8:
        pixels = pixels * 255 // ((1 << depth) - 1)
    elif count > 1:
        pixels = pixels.reshape(len(rows), width, count) // (1 << depth - 8)
    if key is None:
        return pixels, None
    if count == 1:  # a sample of the file's own bits
        return pixels, np.where(values == key, 0, 65535 if depth == 16 else 255)
    # OpenCV compares the key with samples of 16 bits: of coloured ones only black is one
    return pixels, np.where(pixels.any(axis=2) | any(key), 255, 0)


def channels_of(picture):
    """A picture's samples and opacities, as the file has them."""
    if picture.alpha is None or picture.alpha_from == "key":
        return picture.samples
    samples = picture.samples if picture.samples.ndim == 3 else picture.samples[..., np.newaxis]
    return np.concatenate([samples, picture.alpha[..., np.newaxis]], axis=2)


@st.composite
def images(draw, kind):
    width, height = draw(st.integers(1, 23)), draw(st.integers(1, 12))
    row_bytes = (width * kind[1] * CHANNELS[kind[0]] + 7) // 8
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    rows = [rng.bytes(row_bytes) if rng.random() < 0.7 else bytes(row_bytes) for _ in range(height)]
    before, palette, key = [], None, None
    if kind[0] == 3:
        colours = rng.integers(0, 256, (draw(st.integers(1, 1 << kind[1])), 4)).astype(np.uint8)
        colours[:, 3] = rng.choice([0, 128, 255], len(colours))
        palette = np.full((256, 4), (0, 0, 0, 255), np.uint8)
        palette[: len(colours), :3] = colours[:, :3]
        before.append(chunk(b"PLTE", colours[:, :3].tobytes()))
        if count := draw(st.integers(0, len(colours))):
            palette[:count, 3] = colours[:count, 3]
            before.append(chunk(b"tRNS", colours[:count, 3].tobytes()))
    elif kind[0] in (0, 2) and draw(st.booleans()):
        largest = draw(st.sampled_from([0, (1 << kind[1]) - 1]))
        key = rng.integers(0, largest + 1, CHANNELS[kind[0]])
        if kind[0] == 0:  # one that is there
            key = rng.choice(pixels_of(kind, width, rows, key)[0].ravel(), 1)
            key = key if kind[1] >= 8 else key * ((1 << kind[1]) - 1) // 255
        before.append(chunk(b"tRNS", key.astype(">u2").tobytes()))
    return (width, rows, key), palette, png(kind, width, rows, *before)


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("kind", KINDS)
@examples(20)
@given(st.data(), st.integers(1, 60), MODES, st.sampled_from(list(DIALECTS)))
def test_pixels_are_those_that_were_written(tmp_path_factory, kind, data, strip, mode, dialect):
    written, palette, file = data.draw(images(kind))
    path = tmp_path_factory.mktemp("png") / "m.png"
    path.write_bytes(file)
    expected, opacities = pixels_of(kind, *written)
    picture = read_image(path)
    assert np.array_equal(channels_of(picture), expected)
    assert opacities is None or np.array_equal(picture.alpha, opacities)
    assert palette is None or np.array_equal(picture.palette, palette)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strips, "STRIP", strip)
        with open_image(path) as image, image.strips() as opened:
            assert opened.shape == expected.shape[:2]
            parts = list(opened.pictures())
            assert np.array_equal(np.concatenate([channels_of(p) for p in parts]), expected)
        path.with_name("m.yaml").write_text(yaml_text(image="m.png", mode=mode))
        found = read_map(path.with_name("m.yaml"), dialect=dialect).occupancy
    metadata = MapMetadata("m.png", 0.3, (1.5, -2.0, 0.4), mode=mode)
    assert np.array_equal(found, cells_of(picture, metadata, dialect))


def of_stream(stream, *behind):
    """A PNG of 5 x 3 pixels with some compressed bytes."""
    return file_of(5, 3, chunk(b"IDAT", stream), *behind)


ROWS = 3 * bytes([0, *range(5)])
STREAM = zlib.compress(ROWS)
TURNED = chunk(b"eXIf", b"MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6" + bytes(6))
SOUND, TEXT = of_stream(STREAM), of_stream(STREAM, chunk(b"tEXt", b"a\0b"))
DAMAGED = {
    "checksum of the pixels": (SOUND[:42] + b"x" + SOUND[43:], "IDAT"),
    "checksum behind the pixels": (TEXT[:-13] + b"x" + TEXT[-12:], "tEXt"),
    "no end": (SOUND[:-12], "damaged: "),
    "pixels end early": (of_stream(STREAM[:-8]), "damaged: "),
    "wrong sum of the pixels": (of_stream(STREAM[:-1] + b"\0"), "damaged: "),
    "no compressed bytes": (of_stream(b""), "damaged: "),
    "unknown filter": (of_stream(zlib.compress(3 * bytes([5, *range(5)]))), "damaged: "),
    "no pixels": (file_of(5, 1), "holds no pixels"),
    "no palette": (png((3, 8), 5, [b"12345"]), "has no palette"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_one_line(tmp_path, name):
    data, message = DAMAGED[name]
    (tmp_path / "m.png").write_bytes(data)
    with pytest.raises(MalformedInputError, match=message) as caught:
        read_image(tmp_path / "m.png")
    assert str(caught.value).startswith(f"{tmp_path / 'm.png'}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [
    SOUND, of_stream(zlib.compress(ROWS + bytes(99))), of_stream(STREAM + b"abc"), adam7(PIXELS),
], ids=["sound", "more than the pixels", "bytes behind", "interlaced"])  # fmt: skip
def test_what_can_be_read_is_read_without_a_word(tmp_path, recwarn, data):
    (tmp_path / "m.png").write_bytes(data)
    assert np.array_equal(read_image(tmp_path / "m.png").samples, PIXELS)
    assert not recwarn.list


@pytest.mark.parametrize("data", [file_of(5, 3, TURNED, chunk(b"IDAT", STREAM)),
                                  of_stream(STREAM, TURNED)], ids=["before", "behind"])  # fmt: skip
def test_an_orientation_is_warned_of_wherever_it_stands(tmp_path, data):
    (tmp_path / "m.png").write_bytes(data)
    with pytest.warns(MapdealWarning, match="orientation was not applied"):
        read_image(tmp_path / "m.png")


@pytest.mark.slow
def test_interlaced_pictures_that_are_cut_are_refused(tmp_path):
    data = adam7(PIXELS)
    for end in range(len(data) - 4):  # the last four are the checksum of an empty chunk
        (tmp_path / "m.png").write_bytes(data[:end])
        with pytest.raises(MalformedInputError):
            read_image(tmp_path / "m.png")


@pytest.mark.parametrize("read", [read_image, read_image_size])
def test_a_chunk_of_more_bytes_than_the_memory_is_refused_unread(tmp_path, read):
    with (tmp_path / "m.png").open("wb") as file:
        file.write(file_of(4, 1)[:33] + struct.pack(">I4s", 1 << 30, b"tEXt"))
        file.truncate(99 + (1 << 30))
    is_refused = pytest.raises(MalformedInputError, match="may be used")
    with memory_below(16_000_000), use_memory(200_000_000), is_refused:
        read(tmp_path / "m.png")


def test_files_may_give_fewer_bytes_than_requested(tmp_path, monkeypatch):
    (tmp_path / "m.png").write_bytes(SOUND)
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, count, at: pread(file, min(count, 7), at))
    assert np.array_equal(read_image(tmp_path / "m.png").samples, PIXELS)


SIZES = [0, 1, PART - 1, PART, PART + 1, 2 * PART + 12_345]


def noise(size, levels=256):
    return np.random.default_rng(size).integers(0, levels, size, dtype=np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_stream_gives_the_data_back_and_is_the_same_by_any_number_of_threads(size):
    data, streams = noise(size, levels=4), []
    for threads in (1, 5):
        with use_threads(threads):
            streams.append(b"".join(deflated(pieces(data))))
    assert streams[0] == streams[1]
    reader = zlib.decompressobj(-15)
    assert reader.decompress(streams[0]) == data.tobytes()
    assert reader.eof
    assert reader.unused_data == b""


def test_parts_know_the_end_of_the_one_before():
    block = noise(1 << 14)
    data = np.tile(block, 2 * PART // len(block))
    assert len(b"".join(deflated(pieces(data)))) < 1.3 * (len(block) + len(data) // 258 * 3)


def encoded(write, *arrays):
    file = io.BytesIO()
    write(file, *arrays)
    assert file.getvalue().endswith(b"IEND\xaeB`\x82")
    return file


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (1100, 1003), (3, 400_000)])
def test_pictures_are_those_that_readers_see(tmp_path, shape):
    pixels, palette = noise(shape[0] * shape[1]).reshape(shape), noise(768).reshape(256, 3)
    rgba = noise(4 * shape[0] * shape[1]).reshape(*shape, 4)
    grey = encoded(png_module.write_png, pixels[::-1])
    (tmp_path / "m.png").write_bytes(grey.getvalue())
    assert np.array_equal(read_image(tmp_path / "m.png").samples, pixels[::-1])  # with checksums
    assert len(pixels_in(grey.getvalue())) == shape[0] * (1 + shape[1])
    with Image.open(grey) as image:
        assert (image.mode, np.array_equal(image, pixels[::-1])) == ("L", True)
    with Image.open(encoded(png_module.write_png, pixels, palette)) as image:
        assert np.array_equal(image, pixels)
        assert np.array_equal(image.convert("RGB"), palette[pixels])
    with Image.open(encoded(png_module.write_png, rgba)) as image:
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
