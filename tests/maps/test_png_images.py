"""PNG files of all kinds hold the pixels that were filtered and compressed here."""

import os
import struct
import tracemalloc
import warnings
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import MalformedInputError, MapdealError, read_map
from mapdeal.files.source import use_memory
from mapdeal.maps import picture as strips
from mapdeal.maps.dialects import MapMetadata, cells_of
from mapdeal.maps.images import open_strips, read_image, read_image_size
from maps.pngs import adam7, chunk, file_of

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
KINDS = [(0, 1), (0, 2), (0, 4), (0, 8), (0, 16), (2, 8), (2, 16), (3, 1), (3, 2), (3, 4), (3, 8),
         (4, 8), (4, 16), (6, 8), (6, 16)]  # fmt: skip
MODES = ("trinary", "scale", "raw")
DIALECTS = ("nav2", "humble", "ros1")
YAML = "image: m.png\nresolution: 0.3\norigin: [1.5, -2.0, 0.4]\nnegate: 0\n"
YAML += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"


def filtered(rows, bpp, filters):
    """Rows of bytes as PNG stores them, each with one of its five filters."""
    out, above = bytearray(), bytes(len(rows[0]))
    for row, kind in zip(rows, filters, strict=True):
        out.append(kind)
        for i, value in enumerate(row):
            left = row[i - bpp] if i >= bpp else 0
            corner = above[i - bpp] if i >= bpp else 0
            up = above[i]
            paeth = left + up - corner
            nearest = min((left, up, corner), key=lambda one: abs(paeth - one))
            guess = (0, left, up, (left + up) // 2, nearest)[kind]
            out.append((value - guess) % 256)
        above = row
    return bytes(out)


def png(kind, width, rows, filters, *, pieces=(), level=6, strategy=0, before=(), behind=()):
    """A PNG file of rows of bytes, its compressed pixels cut into chunks of some lengths."""
    colour_type, depth = kind
    bpp = max(1, depth * CHANNELS[colour_type] // 8)
    deflate = zlib.compressobj(level, zlib.DEFLATED, 15, 9, strategy)
    body = deflate.compress(filtered(rows, bpp, filters)) + deflate.flush()
    parts = []
    for length in pieces:
        parts.append(body[:length])
        body = body[length:]
    pixels = [chunk(b"IDAT", one) for one in [*parts, body]]
    return file_of(width, len(rows), *before, *pixels, *behind, depth=depth,
                   colour_type=colour_type)  # fmt: skip


def pixels_of(kind, width, rows):
    """The samples in rows of bytes, bit by bit: brightness up to 255 or 65535, or indices."""
    colour_type, depth = kind
    digits = ["".join(f"{byte:08b}" for byte in row) for row in rows]
    values = [[int(row[at : at + depth], 2) for at in range(0, len(row), depth)] for row in digits]
    count = CHANNELS[colour_type]
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
    rows = [rng.integers(0, 256, row_bytes).astype(np.uint8).tobytes() for _ in range(height)]
    filters = draw(st.lists(st.integers(0, 4), min_size=height, max_size=height))
    before = []
    if kind[0] == 3:
        count = draw(st.integers(1, 1 << kind[1]))
        before.append(chunk(b"PLTE", rng.bytes(3 * count)))
        if draw(st.booleans()):
            before.append(chunk(b"tRNS", rng.bytes(draw(st.integers(1, count)))))
    elif kind[0] in (0, 2) and draw(st.booleans()):  # a transparent colour, which may be there
        size = 2 if kind[0] == 0 else 6
        before.append(chunk(b"tRNS", draw(st.sampled_from([bytes(size), b"\0\1" * (size // 2)]))))
    pieces = draw(st.lists(st.sampled_from([0, 1, 5, 40]), max_size=6))
    level, strategy = draw(st.integers(0, 9)), draw(st.sampled_from([0, 2, 3, 4]))
    data = png(kind, width, rows, filters, pieces=pieces, level=level, strategy=strategy,
               before=before)  # fmt: skip
    return kind, width, rows, data


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@settings(deadline=None, max_examples=150)
@given(images(), st.integers(1, 60), st.sampled_from(MODES), st.sampled_from(DIALECTS))
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
        path.with_name("m.yaml").write_text(f"{YAML}mode: {mode}\n")
        found = read_map(path.with_name("m.yaml"), dialect=dialect).occupancy
    metadata = MapMetadata("m.png", 0.3, (1.5, -2.0, 0.4), mode=mode)
    assert np.array_equal(found, cells_of(read_image(path), metadata, dialect))


def blank(height=40, width=30, **options):
    """A PNG whose filters make each row depend on all before it."""
    rows = [bytes([k % 251] * width) for k in range(height)]
    return png((0, 8), width, rows, [2 + k % 3 for k in range(height)], **options)


def said_of(path):
    """What is said on reading a map: warnings, and an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read_map(path)
        except MapdealError as error:
            return [*(str(one.message) for one in caught), str(error)], type(error)
    return [str(one.message) for one in caught], None


def orientation(value):
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, value, 0)
    return chunk(b"eXIf", b"MM" + struct.pack(">HIH", 42, 8, 1) + entry + bytes(4))


STREAM = zlib.compress(b"".join(bytes([0, *range(5)]) for _ in range(3)))


def of_stream(stream):
    """A PNG of 5 x 3 pixels with some compressed bytes."""
    return file_of(5, 3, chunk(b"IDAT", stream))


def flipped(data, place):
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


SAID = {
    "sound": (blank(), None),
    "orientation before the pixels": (blank(before=[orientation(6)]), "orientation"),
    "orientation behind the pixels": (blank(behind=[orientation(3)]), "orientation"),
    "checksum of the first pixels": (flipped(blank(), 41), "IDAT"),
    "checksum of the last chunk with pixels": (
        flipped(blank(pieces=[9, 0, 30]), len(blank(pieces=[9, 0, 30])) - 13), "IDAT",
    ),
    "checksum behind the pixels": (
        flipped(blank(behind=[chunk(b"tEXt", b"a\0b")]), len(blank()) + 2), "tEXt",
    ),
    "no end": (blank()[:-12], "the image is damaged: "),
    "pixels end early": (of_stream(STREAM[:-8]), "the image is damaged: "),
    "no compressed bytes": (of_stream(b""), "the image is damaged: "),
    "no pixels": (png((0, 8), 5, [b"12345"], [0])[:33] + chunk(b"IEND", b""), "holds no pixels"),
    "no palette": (png((3, 8), 5, [b"12345"], [0]), "has no palette"),
    "wrong sum of the pixels": (of_stream(STREAM[:-1] + b"\0"), "the image is damaged: "),
    "damaged pixels": (of_stream(b"\0\0" + STREAM[2:]), "the image is damaged: "),
    "unknown filter": (
        of_stream(zlib.compress(b"".join(bytes([5, *range(5)]) for _ in range(3)))),
        "the image is damaged: ",
    ),
    "more than the pixels": (of_stream(zlib.compress(zlib.decompress(STREAM) + bytes(99))), None),
    "bytes behind the stream": (of_stream(STREAM + b"abc"), None),
}  # fmt: skip


@pytest.mark.parametrize("name", SAID)
def test_what_is_wrong_is_said_in_one_line(tmp_path, name):
    data, expected = SAID[name]
    (tmp_path / "m.png").write_bytes(data)
    (tmp_path / "m.yaml").write_text(YAML)
    said, kind = said_of(tmp_path / "m.yaml")
    if expected is None:
        assert said == []
        return
    assert len(said) == 1
    assert said[0].startswith(f"{tmp_path / 'm.png'}: ")
    assert expected in said[0]
    assert "\n" not in said[0]
    assert kind is (None if expected == "orientation" else MalformedInputError)


@pytest.mark.slow
def test_interlaced_pictures_are_read_as_wholes(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (19, 23), dtype=np.uint8)
    data = adam7(pixels)
    (tmp_path / "m.png").write_bytes(data)
    assert np.array_equal(read_image(tmp_path / "m.png").samples, pixels)
    for end in range(len(data) - 4):  # the last four are the checksum of an empty chunk
        (tmp_path / "m.png").write_bytes(data[:end])
        with pytest.raises(MalformedInputError):
            read_image(tmp_path / "m.png")


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("key", "opaque"), [((0, 0, 0), [[0, 255]]), ((7, 8, 9), [[255, 255]])])
def test_of_transparent_colours_only_black_is_one(tmp_path, key, opaque):
    """As OpenCV has it, which compares the key with samples of 16 bits."""
    before = [chunk(b"tRNS", struct.pack(">HHH", *key))]
    data = png((2, 8), 2, [bytes([0, 0, 0, 7, 8, 9])], [0], before=before)
    (tmp_path / "m.png").write_bytes(data)
    assert read_image(tmp_path / "m.png").alpha.tolist() == opaque


@pytest.mark.parametrize(("depth", "row", "key", "samples"), [
    (1, [0b01100000], 1, [0, 255, 255, 0]),
    (1, [0b01100000], 0, [0, 255, 255, 0]),
    (2, [0b00011011], 2, [0, 85, 170, 255]),
    (4, [0x03, 0x5F], 3, [0, 51, 85, 255]),
    (8, [0, 205, 254, 255], 205, [0, 205, 254, 255]),
    (16, [0, 7, 1, 2, 0, 8, 2, 1], 258, [7, 258, 8, 513]),
])  # fmt: skip
def test_a_grey_key_is_a_sample_of_the_files_own_bits(tmp_path, depth, row, key, samples):
    before = [chunk(b"tRNS", struct.pack(">H", key))]
    data = png((0, depth), 4, [bytes(row)], [0], before=before)
    (tmp_path / "m.png").write_bytes(data)
    picture = read_image(tmp_path / "m.png")
    full = 65535 if depth == 16 else 255
    clear = {1: 255 * key, 2: 85 * key, 4: 17 * key}.get(depth, key)
    assert picture.samples.tolist() == [samples]
    assert picture.alpha.tolist() == [[0 if one == clear else full for one in samples]]


@pytest.mark.parametrize("opacities", [b"\xff\x80\x00", b"\x00"])
def test_opacities_of_a_palette_are_by_its_indices(tmp_path, opacities):
    before = [chunk(b"PLTE", bytes(range(12))), chunk(b"tRNS", opacities)]
    (tmp_path / "m.png").write_bytes(png((3, 2), 4, [b"\x1b"], [0], before=before))
    palette = read_image(tmp_path / "m.png").palette
    assert palette[:4, :3].tolist() == np.arange(12).reshape(4, 3).tolist()
    assert palette[:, 3].tolist() == [*opacities, *[255] * (256 - len(opacities))]


def test_what_is_said_of_showing_a_picture_is_kept_and_texts_are_not(tmp_path):
    before = [
        chunk(b"gAMA", struct.pack(">I", 45455)),
        chunk(b"iCCP", b"p\0\0" + zlib.compress(b"profile")),
        *(chunk(b"tEXt", name + b"\0text") for name in (b"Comment", b"transparency")),
    ]
    (tmp_path / "m.png").write_bytes(png((0, 8), 4, [bytes(4)], [0], before=before))
    picture = read_image(tmp_path / "m.png")
    assert picture.display == ("a gamma of 0.45455", "a colour profile")
    assert picture.alpha is None


@pytest.mark.parametrize("read", [read_image, read_image_size])
def test_a_chunk_of_more_bytes_than_the_memory_is_refused_unread(tmp_path, read):
    data = png((0, 8), 4, [bytes(4)], [0])
    length = 1 << 30
    with (tmp_path / "m.png").open("wb") as file:
        file.write(data[:33] + struct.pack(">I4s", length, b"tEXt"))
        file.truncate(len(data) + length)
    tracemalloc.start()
    with use_memory(200_000_000), pytest.raises(MalformedInputError, match="may be used"):
        read(tmp_path / "m.png")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16_000_000


def test_files_may_give_fewer_bytes_than_they_are_asked_for(tmp_path, monkeypatch):
    """As those of other machines do."""
    data = png((0, 8), 4, [b"\1\2\3\4", b"\5\6\7\x08"], [0, 2])
    (tmp_path / "m.png").write_bytes(data)
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, count, at: pread(file, min(count, 7), at))
    assert read_image(tmp_path / "m.png").samples.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
