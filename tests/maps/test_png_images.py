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
    pieces = draw(st.lists(st.sampled_from([0, 1, 5, 40]), max_size=6))
    level, strategy = draw(st.integers(0, 9)), draw(st.sampled_from([0, 2, 3, 4]))
    data = png(kind, width, rows, filters, pieces=pieces, level=level, strategy=strategy,
               before=before)  # fmt: skip
    return kind, width, rows, data


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@settings(deadline=None, max_examples=150)
@given(image=images(), strip=st.integers(1, 60))
def test_pixels_are_those_that_were_written(tmp_path_factory, image, strip):
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


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_cells_of_a_map_are_those_of_the_whole_picture(tmp_path, monkeypatch, kind):
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
    monkeypatch.setattr(strips, "STRIP", 7 * 4 * width)
    for mode in MODES:
        (tmp_path / "m.yaml").write_text(f"{YAML}mode: {mode}\n")
        metadata = MapMetadata("m.png", 0.3, (1.5, -2.0, 0.4), mode=mode)
        for dialect in DIALECTS:
            expected = cells_of(picture, metadata, dialect)
            found = read_map(tmp_path / "m.yaml", dialect=dialect).occupancy
            assert np.array_equal(found, expected)


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
    remarks, kind, error = told(read_map, tmp_path / "m.yaml")
    said = [*remarks, *filter(None, [error])]
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


@pytest.mark.parametrize(
    ("depth", "row", "key", "samples"),
    [
        (1, [0b01100000], 1, [0, 255, 255, 0]),
        (1, [0b01100000], 0, [0, 255, 255, 0]),
        (2, [0b00011011], 2, [0, 85, 170, 255]),
        (4, [0x03, 0x5F], 3, [0, 51, 85, 255]),
        (8, [0, 205, 254, 255], 205, [0, 205, 254, 255]),
        (16, [0, 7, 1, 2, 0, 8, 2, 1], 258, [7, 258, 8, 513]),
    ],
)
def test_a_grey_key_is_a_sample_of_the_files_own_bits(tmp_path, depth, row, key, samples):
    before = [chunk(b"tRNS", struct.pack(">H", key))]
    data = png((0, depth), 4, [bytes(row)], [0], before=before)
    (tmp_path / "m.png").write_bytes(data)
    picture = read_image(tmp_path / "m.png")
    full = 65535 if depth == 16 else 255
    clear = {1: 255 * key, 2: 85 * key, 4: 17 * key}.get(depth, key)
    assert picture.samples.tolist() == [samples]
    assert picture.alpha.tolist() == [[0 if one == clear else full for one in samples]]


@pytest.mark.parametrize("opacities", [b"\xff\x80\x00", b"\xff\x00", b"\xff\xff", b"\x00"])
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
    try:
        with use_memory(200_000_000), pytest.raises(MalformedInputError, match="may be used"):
            read(tmp_path / "m.png")
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


def test_files_may_give_fewer_bytes_than_they_are_asked_for(tmp_path, monkeypatch):
    """As those of other machines do."""
    data = png((0, 8), 4, [b"\1\2\3\4", b"\5\6\7\x08"], [0, 2])
    (tmp_path / "m.png").write_bytes(data)
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, count, at: pread(file, min(count, 7), at))
    assert read_image(tmp_path / "m.png").samples.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
