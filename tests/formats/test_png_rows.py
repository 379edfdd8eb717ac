"""PNG files by strips and by rows hold what Pillow makes of them as wholes."""

import io
import os
import struct
import warnings
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from mapdeal import FileAccessError, MalformedInputError, MapdealError
from mapdeal.formats import strips
from mapdeal.formats.dialects import cells_of
from mapdeal.formats.image import open_pixel_rows, open_strips, read_image
from mapdeal.formats.images import png_rows
from mapdeal.formats.map_yaml import MapMetadata
from mapdeal.formats.maps import open_map

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
KINDS = [(0, 1), (0, 2), (0, 4), (0, 8), (0, 16), (2, 8), (2, 16), (3, 1), (3, 2), (3, 4), (3, 8),
         (4, 8), (4, 16), (6, 8), (6, 16)]  # fmt: skip
MODES = ("trinary", "scale", "raw")
DIALECTS = ("nav2", "humble", "ros1")
YAML = "image: m.png\nresolution: 0.3\norigin: [1.5, -2.0, 0.4]\nnegate: 0\n"
YAML += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


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
    header = struct.pack(">IIBBBBB", width, len(rows), depth, colour_type, 0, 0, 0)
    chunks = [chunk(b"IHDR", header), *before, *(chunk(b"IDAT", one) for one in [*parts, body])]
    return b"\x89PNG\r\n\x1a\n" + b"".join([*chunks, *behind, chunk(b"IEND", b"")])


def by_pillow(data):
    """The pixels as Pillow has them: 0..255 or 0..65535, indices, or channels."""
    with Image.open(io.BytesIO(data)) as image:
        pixels = np.asarray(image)
        if image.mode == "1":
            return pixels.astype(np.uint8) * 255
        if data[25] == 4:  # grey of 16 bits with opacity becomes colours
            return pixels[..., [0, -1]]
        return pixels.astype(np.uint16) if image.mode in ("I", "I;16") else pixels


def channels_of(picture):
    """A picture's samples and opacities, as Pillow has them."""
    if picture.alpha is None or picture.alpha_from == "key":
        return picture.samples
    samples = picture.samples if picture.samples.ndim == 3 else picture.samples[..., np.newaxis]
    return np.concatenate([samples, picture.alpha[..., np.newaxis]], axis=2)


@st.composite
def images(draw):
    """PNG files of all kinds."""
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
    pieces = draw(st.lists(st.sampled_from([0, 1, 5, 40]), max_size=6))
    level, strategy = draw(st.integers(0, 9)), draw(st.sampled_from([0, 2, 3, 4]))
    return png(kind, width, rows, filters, pieces=pieces, level=level, strategy=strategy,
               before=before)  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@settings(deadline=None, max_examples=150)
@given(data=images(), strip=st.integers(1, 60), order=st.randoms(use_true_random=False))
def test_strips_and_rows_are_those_of_the_whole(tmp_path_factory, data, strip, order):
    path = tmp_path_factory.mktemp("png") / "m.png"
    path.write_bytes(data)
    expected = by_pillow(data)
    whole = read_image(path)
    assert np.array_equal(channels_of(whole), expected)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strips, "STRIP", strip)
        patch.setattr(png_rows, "STRIP", strip)
        patch.setattr(png_rows, "_INFLATER", 0)
        patch.setattr(png_rows, "_SHARE_OF_MARKS", 1)
        with open_strips(path) as opened:
            assert opened.shape == expected.shape[:2]
            parts = list(opened.pictures())
            assert np.array_equal(np.concatenate([channels_of(p) for p in parts]), expected)
        height = len(expected)
        with open_pixel_rows(path) as pixels:
            assert sum(p.shape[0] for p in pixels.strips().pictures()) == height
            for _ in range(5):
                start = order.randrange(height)
                stop = order.randrange(start, height) + 1
                part = pixels.part(slice(start, stop)).whole()
                assert np.array_equal(channels_of(part), expected[height - stop : height - start])


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_cells_by_rows_are_those_of_the_whole_picture(tmp_path, kind):
    rng = np.random.default_rng(3)
    width, height = 37, 41
    row_bytes = (width * kind[1] * CHANNELS[kind[0]] + 7) // 8
    rows = [rng.integers(190, 256, row_bytes).astype(np.uint8).tobytes() for _ in range(height)]
    before = []
    if kind[0] == 3:
        before = [chunk(b"PLTE", rng.bytes(3 << kind[1])), chunk(b"tRNS", b"\xff\x80\0"[: kind[1]])]
    elif kind[0] == 0:
        before = [chunk(b"tRNS", struct.pack(">H", (1 << kind[1]) - 1))]
    elif kind[0] == 2:
        before = [chunk(b"tRNS", bytes(6))]
    data = png(kind, width, rows, rng.integers(0, 5, height).tolist(), before=before)
    (tmp_path / "m.png").write_bytes(data)
    picture = read_image(tmp_path / "m.png")
    for mode in MODES:
        (tmp_path / "m.yaml").write_text(f"{YAML}mode: {mode}\n")
        metadata = MapMetadata("m.png", 0.3, (1.5, -2.0, 0.4), mode=mode)
        for dialect in DIALECTS:
            expected = cells_of(picture, metadata, dialect)
            with open_map(tmp_path / "m.yaml", dialect=dialect) as file:
                assert np.array_equal(file.read().grid.occupancy, expected)
                cells = file.by_rows(block_height=7).grid.occupancy
                for first in (30, 3, 0, 40):
                    found = cells[first : first + 9]
                    assert np.array_equal(found, expected[first : first + 9])


def blank(height=40, width=30, **options):
    """A PNG whose filters make each row depend on all before it."""
    rows = [bytes([k % 251] * width) for k in range(height)]
    return png((0, 8), width, rows, [2 + k % 3 for k in range(height)], **options)


def told(read, *arguments):
    """What is said on reading: warnings, and an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read(*arguments)
        except MapdealError as error:
            return [str(one.message) for one in caught], type(error), str(error)
    return [str(one.message) for one in caught], None, None


def read_by_rows(path):
    with open_map(path) as file:
        if file.shape_by_rows is None:
            file.read()
        else:
            file.by_rows(block_height=8)


def read_whole(path):
    with open_map(path) as file:
        file.read()


def orientation(value):
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, value, 0)
    return chunk(b"eXIf", b"MM" + struct.pack(">HIH", 42, 8, 1) + entry + bytes(4))


STREAM = zlib.compress(b"".join(bytes([0, *range(5)]) for _ in range(3)))


def of_stream(stream):
    """A PNG of 5 x 3 pixels with some compressed bytes."""
    header = struct.pack(">IIBBBBB", 5, 3, 8, 0, 0, 0, 0)
    chunks = [chunk(b"IHDR", header), chunk(b"IDAT", stream), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def flipped(data, place):
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


SAID = {
    "sound": (blank(), None),
    "orientation before the pixels": (blank(before=[orientation(6)]), "orientation"),
    "orientation behind the pixels": (blank(behind=[orientation(3)]), "orientation"),
    "checksum of the first pixels": (flipped(blank(), 41), "chunk IDAT: wrong checksum"),
    "checksum of the last chunk with pixels": (
        flipped(blank(pieces=[9, 0, 30]), len(blank(pieces=[9, 0, 30])) - 13),
        "chunk IDAT: wrong checksum",
    ),
    "checksum behind the pixels": (
        flipped(blank(behind=[chunk(b"tEXt", b"a\0b")]), len(blank()) + 2),
        "wrong checksum",
    ),
    "no end": (blank()[:-12], "the PNG file ends early"),
    "pixels end early": (of_stream(STREAM[:-8]), "the pixels end early: expected 18 bytes"),
    "no pixels": (of_stream(b""), "the pixels end early: expected 18 bytes, got 0"),
    "wrong sum of the pixels": (of_stream(STREAM[:-1] + b"\0"), "incorrect data check"),
    "no sum of the pixels": (of_stream(STREAM[:-4]), "their checksum is missing"),
    "damaged pixels": (of_stream(b"\0\0" + STREAM[2:]), "unknown compression method"),
    "unknown filter": (
        of_stream(zlib.compress(b"".join(bytes([5, *range(5)]) for _ in range(3)))),
        "a row has a filter that PNG does not know, got 5",
    ),
    "more than the pixels": (of_stream(zlib.compress(zlib.decompress(STREAM) + bytes(99))), None),
    "bytes behind the stream": (of_stream(STREAM + b"abc"), None),
}  # fmt: skip


@pytest.mark.parametrize("name", SAID)
def test_the_same_is_said_however_it_is_read(tmp_path, name):
    data, expected = SAID[name]
    (tmp_path / "m.png").write_bytes(data)
    (tmp_path / "m.yaml").write_text(YAML)
    whole, rows = (told(read, tmp_path / "m.yaml") for read in (read_whole, read_by_rows))
    assert rows == whole
    remarks, _, error = whole
    if expected is None:
        assert whole == ([], None, None)
    else:
        assert any(expected in text for text in [*remarks, error or ""])
    assert len(remarks) <= 1


def test_a_file_that_changes_between_two_rows_is_an_error(tmp_path):
    (tmp_path / "m.png").write_bytes(blank(level=0))
    (tmp_path / "m.yaml").write_text(YAML)
    with open_map(tmp_path / "m.yaml") as file:
        cells = file.by_rows(block_height=8).grid.occupancy
        cells[0:8]
        (tmp_path / "m.png").write_bytes(blank(level=0)[:-1] + b"\0")
        with pytest.raises(FileAccessError, match="changed while it was read"):
            cells[8:16]


@pytest.mark.slow
def test_interlaced_pictures_are_read_as_wholes(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (19, 23), dtype=np.uint8)
    data = adam7(pixels)
    (tmp_path / "m.png").write_bytes(data)
    with open_pixel_rows(tmp_path / "m.png") as rows:
        assert rows is None
    assert np.array_equal(read_image(tmp_path / "m.png").samples, pixels)
    for end in range(len(data)):
        (tmp_path / "m.png").write_bytes(data[:end])
        with pytest.raises(MalformedInputError):
            read_image(tmp_path / "m.png")


def adam7(pixels):
    """An interlaced PNG of grey pixels."""
    rows = b""
    for col, row, across, down in [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4),
                                   (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]:  # fmt: skip
        rows += b"".join(b"\0" + part.tobytes() for part in pixels[row::down, col::across])
    height, width = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 1)
    chunks = [chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("key", "opaque"), [((0, 0, 0), [[0, 255]]), ((7, 8, 9), [[255, 255]])])
def test_of_transparent_colours_only_black_is_one(tmp_path, key, opaque):
    """As OpenCV has it, which compares the key with samples of 16 bits."""
    before = [chunk(b"tRNS", struct.pack(">HHH", *key))]
    data = png((2, 8), 2, [bytes([0, 0, 0, 7, 8, 9])], [0], before=before)
    (tmp_path / "m.png").write_bytes(data)
    assert read_image(tmp_path / "m.png").alpha.tolist() == opaque


def test_a_grey_key_is_a_sample_of_the_files_own_bits(tmp_path):
    data = png((0, 4), 4, [bytes([0x03, 0x5F])], [0], before=[chunk(b"tRNS", b"\0\x03")])
    (tmp_path / "m.png").write_bytes(data)
    picture = read_image(tmp_path / "m.png")
    assert picture.samples.tolist() == [[0, 51, 85, 255]]
    assert picture.alpha.tolist() == [[255, 0, 255, 255]]


TWO_PARTS = png((0, 8), 4, [bytes(4)], [0], pieces=[5])
SECOND = TWO_PARTS.index(b"IDAT", TWO_PARTS.index(b"IDAT") + 1) - 4


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (TWO_PARTS[:SECOND] + chunk(b"tEXt", b"a\0b") + TWO_PARTS[SECOND:],
         "chunk IDAT: other chunks stand between the pixels"),
        (png((3, 8), 1, [b"\0"], [0], before=[chunk(b"PLTE", bytes(4))]),
         "chunk PLTE: a palette of 1 to 256 colours must be there"),
        (png((0, 8), 1, [b"\0"], [0], behind=[chunk(b"tRNS", b"\0\0")]),
         "chunk tRNS: must stand before the pixels"),
    ],
)  # fmt: skip
def test_chunks_out_of_their_place_or_size_are_refused(tmp_path, data, match):
    (tmp_path / "m.png").write_bytes(data)
    with pytest.raises(MalformedInputError, match=match):
        read_image(tmp_path / "m.png")


def test_files_may_give_fewer_bytes_than_they_are_asked_for(tmp_path, monkeypatch):
    """As those of other machines do."""
    data = png((0, 8), 4, [b"\1\2\3\4", b"\5\6\7\x08"], [0, 2])
    (tmp_path / "m.png").write_bytes(data)
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, count, at: pread(file, min(count, 7), at))
    assert read_image(tmp_path / "m.png").samples.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
