"""PNG files of all kinds hold the pixels that were written, and what else is said of them."""

import os
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bad_maps import yaml_text
from mapdeal import MalformedInputError, MapdealWarning, read_map
from mapdeal.files.source import use_memory
from mapdeal.maps import picture as strips
from mapdeal.maps.dialects import DIALECTS, MapMetadata, cells_of
from mapdeal.maps.images import open_strips, read_image, read_image_size
from maps.pngs import adam7, chunk, file_of
from taken import memory_below

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
KINDS = [(0, 1), (0, 2), (0, 4), (0, 8), (0, 16), (2, 8), (2, 16), (3, 1), (3, 2), (3, 4), (3, 8),
         (4, 8), (4, 16), (6, 8), (6, 16)]  # fmt: skip
PIXELS = np.tile(np.arange(5, dtype=np.uint8), (3, 1))
MODES = st.sampled_from(["trinary", "scale", "raw"])


def png(kind, width, rows, *before):
    """A PNG file of rows of bytes."""
    pixels = chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows)))
    colour_type, depth = kind
    facts = {"depth": depth, "colour_type": colour_type}
    return file_of(width, len(rows), *before, pixels, **facts)


def pixels_of(kind, width, rows):
    """The samples in rows of bytes, bit by bit: brightness up to 255 or 65535, or indices."""
    colour_type, depth = kind
    bits = [np.unpackbits(np.frombuffer(row, np.uint8)) for row in rows]
    weights, count = 2 ** np.arange(depth)[::-1], CHANNELS[colour_type]
    values = [row[: len(row) // depth * depth].reshape(-1, depth) @ weights for row in bits]
    pixels = np.array([row[: width * count] for row in values]).reshape(len(rows), width, count)
    if colour_type == 0 and depth < 8:
        pixels = pixels * 255 // ((1 << depth) - 1)
    elif count > 1 and depth == 16:
        pixels = pixels // 256
    return pixels if count > 1 else pixels[..., 0]


def channels_of(picture):
    """A picture's samples and opacities, as the file has them."""
    if picture.alpha is None or picture.alpha_from == "key":
        return picture.samples
    samples = picture.samples if picture.samples.ndim == 3 else picture.samples[..., np.newaxis]
    return np.concatenate([samples, picture.alpha[..., np.newaxis]], axis=2)


@st.composite
def images(draw):
    """Kind, width and rows of PNG files of all kinds, and the files."""
    kind = draw(st.sampled_from(KINDS))
    width, height = draw(st.integers(1, 23)), draw(st.integers(1, 12))
    row_bytes = (width * kind[1] * CHANNELS[kind[0]] + 7) // 8
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    rows = [rng.bytes(row_bytes) for _ in range(height)]
    before = []
    if kind[0] == 3:
        count = draw(st.integers(1, 1 << kind[1]))
        before.append(chunk(b"PLTE", rng.bytes(3 * count)))
        if draw(st.booleans()):
            before.append(chunk(b"tRNS", rng.bytes(draw(st.integers(1, count)))))
    elif kind[0] in (0, 2) and draw(st.booleans()):  # a transparent colour, which may be there
        size = 2 if kind[0] == 0 else 6
        before.append(chunk(b"tRNS", draw(st.sampled_from([bytes(size), b"\0\1" * (size // 2)]))))
    return kind, width, rows, png(kind, width, rows, *before)


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@settings(max_examples=80)
@given(images(), st.integers(1, 60), MODES, st.sampled_from(list(DIALECTS)))
def test_pixels_are_those_that_were_written(tmp_path_factory, image, strip, mode, dialect):
    *written, data = image
    path = tmp_path_factory.mktemp("png") / "m.png"
    path.write_bytes(data)
    expected = pixels_of(*written)
    assert np.array_equal(channels_of(read_image(path)), expected)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strips, "STRIP", strip)
        with open_strips(path) as opened:
            assert opened.shape == expected.shape[:2]
            parts = list(opened.pictures())
            assert np.array_equal(np.concatenate([channels_of(p) for p in parts]), expected)
        path.with_name("m.yaml").write_text(yaml_text(image="m.png", mode=mode))
        found = read_map(path.with_name("m.yaml"), dialect=dialect).occupancy
    metadata = MapMetadata("m.png", 0.3, (1.5, -2.0, 0.4), mode=mode)
    assert np.array_equal(found, cells_of(read_image(path), metadata, dialect))


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
    data, told = DAMAGED[name]
    (tmp_path / "m.png").write_bytes(data)
    with pytest.raises(MalformedInputError, match=told) as caught:
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
def test_an_orientation_is_told_wherever_it_stands(tmp_path, data):
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


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("key", "opaque"), [((0, 0, 0), [[0, 255]]), ((7, 8, 9), [[255, 255]])])
def test_of_transparent_colours_only_black_is_one(tmp_path, key, opaque):
    """As OpenCV has it, which compares the key with samples of 16 bits."""
    transparent = chunk(b"tRNS", struct.pack(">HHH", *key))
    row = bytes([0, 0, 0, 7, 8, 9])
    (tmp_path / "m.png").write_bytes(png((2, 8), 2, [row], transparent))
    assert read_image(tmp_path / "m.png").alpha.tolist() == opaque


@pytest.mark.parametrize(("depth", "row", "key", "samples", "clear"), [
    (1, [0b01100000], 1, [0, 255, 255, 0], 255),
    (1, [0b01100000], 0, [0, 255, 255, 0], 0),
    (2, [0b00011011], 2, [0, 85, 170, 255], 170),
    (4, [0x03, 0x5F], 3, [0, 51, 85, 255], 51),
    (8, [0, 205, 254, 255], 205, [0, 205, 254, 255], 205),
    (16, [0, 7, 1, 2, 0, 8, 2, 1], 258, [7, 258, 8, 513], 258),
])  # fmt: skip
def test_a_grey_key_is_a_sample_of_the_files_own_bits(tmp_path, depth, row, key, samples, clear):
    transparent = chunk(b"tRNS", struct.pack(">H", key))
    (tmp_path / "m.png").write_bytes(png((0, depth), 4, [bytes(row)], transparent))
    picture = read_image(tmp_path / "m.png")
    full = 65535 if depth == 16 else 255
    assert picture.samples.tolist() == [samples]
    assert picture.alpha.tolist() == [[0 if one == clear else full for one in samples]]


@pytest.mark.parametrize("opacities", [b"\xff\x80\0", b"\0"])
def test_colours_and_opacities_of_a_palette_are_by_its_indices(tmp_path, opacities):
    before = chunk(b"PLTE", bytes(range(12))), chunk(b"tRNS", opacities)
    (tmp_path / "m.png").write_bytes(png((3, 2), 4, [b"\x1b"], *before))
    palette = read_image(tmp_path / "m.png").palette
    assert palette[:4, :3].tolist() == np.arange(12).reshape(4, 3).tolist()
    assert palette[:, 3].tolist() == [*opacities, *[255] * (256 - len(opacities))]


@pytest.mark.parametrize("read", [read_image, read_image_size])
def test_a_chunk_of_more_bytes_than_the_memory_is_refused_unread(tmp_path, read):
    with (tmp_path / "m.png").open("wb") as file:
        file.write(file_of(4, 1)[:33] + struct.pack(">I4s", 1 << 30, b"tEXt"))
        file.truncate(99 + (1 << 30))
    is_refused = pytest.raises(MalformedInputError, match="may be used")
    with memory_below(16_000_000), use_memory(200_000_000), is_refused:
        read(tmp_path / "m.png")


def test_files_may_give_fewer_bytes_than_they_are_asked_for(tmp_path, monkeypatch):
    """As those of other machines do."""
    (tmp_path / "m.png").write_bytes(SOUND)
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, count, at: pread(file, min(count, 7), at))
    assert np.array_equal(read_image(tmp_path / "m.png").samples, PIXELS)
