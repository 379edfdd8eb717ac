"""Pixels that are not in a file are an error, in every format and compression."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from mapdeal import MalformedInputError
from maps.pictures import read_image

HEIGHT, WIDTH = 21, 19
PLACES, ENDS = 12, 8
RANDOM = np.random.default_rng(5)
GREY = np.where(
    RANDOM.random((HEIGHT, WIDTH)) < 0.4, 254, RANDOM.choice([0, 0, 205, 254], (HEIGHT, WIDTH))
).astype(np.uint8)
COLOUR = np.stack([GREY, GREY[::-1], GREY[:, ::-1]], axis=2)
PALETTE = Image.fromarray(GREY // 64)
PALETTE.putpalette([0, 0, 9, 90, 9, 9, 205, 9, 205, 254, 254, 9])
ARRAYS = {"bits": RANDOM.random((HEIGHT, WIDTH)) < 0.4, "grey": GREY, "colour": COLOUR,
          "deep": GREY.astype(np.uint16) * 257, "alpha": np.dstack([COLOUR, GREY])}  # fmt: skip
PICTURES = {name: Image.fromarray(array) for name, array in ARRAYS.items()}
PICTURES["palette"] = PALETTE
FAXES = ("tiff_ccitt", "group3", "group4", "tiff_raw_16")
STRIP_OFFSETS, ROWS_PER_STRIP, STRIP_SIZES, TILE_OFFSETS, TILE_SIZES = 273, 278, 279, 324, 325
STRIPS_OF_8 = ({}, {"tiffinfo": {ROWS_PER_STRIP: 8}})
JPEGS = ({}, {"progressive": True}, {"optimize": True, "quality": 95}, {"restart_marker_blocks": 2},
         {"progressive": True, "restart_marker_rows": 1})  # fmt: skip

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]


def saved(picture, name, **options):
    if name == "by hand":
        return BY_HAND[picture]
    file = io.BytesIO()
    PICTURES[picture].save(file, name, **options)
    return file.getvalue()


BY_HAND = {
    "P1": b"P1\n4 3\n0 1 1 0\n1001\n0 1 1 1\n",
    "P2": b"P2 # grey\n4 3\n255\n0 205 254 254\n0 0 0 9\n254 254 254 0\n",
    "P3": b"P3\n2 2\n255\n0 1 2  3 4 5\n6 7 8  9 10 0\n",
    "P5-wide": b"P5\n4 3\n999\n" + bytes([1, 2] * 12),
}


def cases():
    """Return name and arguments of `saved` for all that Pillow writes and maps may have."""
    kinds = [(picture, "PNG", {}) for picture in PICTURES]
    kinds += [(name, "by hand", {}) for name in BY_HAND]
    kinds += [(picture, "BMP", {}) for picture in PICTURES if picture != "deep"]
    kinds += [(picture, "PPM", {}) for picture in ("bits", "grey", "deep", "colour")]
    for picture in ("grey", "colour"):
        kinds += [(picture, "JPEG", options) for options in JPEGS]
        kinds += [(picture, "TIFF", {"compression": "jpeg", **options}) for options in STRIPS_OF_8]
    kinds += [(picture, "TIFF", {}) for picture in PICTURES]
    for height in (HEIGHT, 4):
        strips = {"tiffinfo": {ROWS_PER_STRIP: height}}
        kinds += [("bits", "TIFF", {"compression": fax, **strips}) for fax in FAXES]
        for name in ("tiff_lzw", "tiff_adobe_deflate", "tiff_deflate", "packbits", "lzma", "zstd"):
            options = {"compression": name, **strips}
            kinds += [(picture, "TIFF", options) for picture in ("bits", "colour")]
        kinds += [(picture, "TIFF", strips) for picture in ("bits", "grey", "colour")]
    return kinds


def in_words(value):
    return "-".join(map(str, value.values())) or "plain" if isinstance(value, dict) else value


@pytest.fixture
def read(tmp_path):
    """Return the samples of an image, None if it is refused in one line that names the file."""
    path = tmp_path / "m.image"

    def samples(data):
        path.write_bytes(data)
        try:
            return read_image(path).samples
        except MalformedInputError as error:
            assert error.source in (path, str(path))
            assert "\n" not in str(error)
            return None

    return samples


def some(count):
    """Return numbers up to `count`: all near its ends, and some between."""
    between = np.linspace(0, max(0, count - 1), PLACES).astype(int).tolist()
    return sorted({*range(count)[:ENDS], *range(count + 1)[-ENDS - 1 :], *between})


@pytest.mark.parametrize(("picture", "name", "options"), cases(), ids=in_words)
def test_a_file_that_is_cut_is_refused_or_still_the_same_picture(read, picture, name, options):
    data = saved(picture, name, **options)
    complete = read(data)
    assert complete is not None
    refused = 0
    for end in some(len(data)):
        found = read(data[:end])
        assert found is None or np.array_equal(found, complete), end
        refused += found is None
    assert refused > PLACES // 2


def with_last_size(data, size):
    """Return a TIFF of Pillow's that says another number of bytes of its last strip."""
    (directory,) = struct.unpack_from("<I", data, 4)
    at = data.index(struct.pack("<H", STRIP_SIZES), directory)
    _, kind, count, value = struct.unpack_from("<HHII", data, at)
    width, form = {3: (2, "<H"), 4: (4, "<I")}[kind]
    start = at + 8 if width * count <= 4 else value
    changed = bytearray(data)
    struct.pack_into(form, changed, start + width * (count - 1), size)
    return bytes(changed)


TIFFS = [(picture, options) for picture, name, options in cases() if name == "TIFF"]
EXACT_TIFFS = [case for case in TIFFS if case[1].get("compression") not in ("jpeg", *FAXES)]


@pytest.mark.parametrize(("picture", "options"), EXACT_TIFFS, ids=in_words)
def test_a_tiff_whose_last_strip_ends_early_is_refused(read, picture, options):
    data = saved(picture, "TIFF", **options)
    complete = read(data)
    tags = TiffImagePlugin.TiffImageFile(io.BytesIO(data)).tag_v2
    start, size = tags[STRIP_OFFSETS][-1], tags[STRIP_SIZES][-1]
    for missing in some(size)[1:]:
        end = start + size - missing
        cut = data[:end] + bytes(missing) + data[start + size :]
        found = read(with_last_size(cut, size - missing))
        assert found is None or np.array_equal(found, complete), missing


def tiff(parts, *, tags, tiled=False):
    """Return a TIFF file of grey pixels whose strips or tiles are `parts`."""
    starts = np.cumsum([8, *map(len, parts)]).tolist()
    names = (TILE_OFFSETS, TILE_SIZES) if tiled else (STRIP_OFFSETS, STRIP_SIZES)
    lists = {256: [WIDTH], 257: [HEIGHT], 258: [8], 259: [1], 262: [1], 277: [1]}
    lists |= {names[0]: starts[:-1], names[1]: [len(part) for part in parts]}
    lists |= {tag: value if isinstance(value, list) else [value] for tag, value in tags.items()}
    body, entries = b"".join(parts), []
    for tag, values in sorted(lists.items()):
        packed = struct.pack(f"<{len(values)}I", *values)
        if len(values) != 1:
            body, packed = body + packed, struct.pack("<I", 8 + len(body))
        entries.append(struct.pack("<HHI", tag, 4, len(values)) + packed)
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
    return b"II*\0" + struct.pack("<I", 8 + len(body)) + body + directory


TILED = {322: 16, 323: 16}


@pytest.mark.parametrize("compression", [1, 8])
def test_tiles_must_cover_the_picture(read, compression):
    padded = np.zeros((32, 32), np.uint8)
    padded[:HEIGHT, :WIDTH] = GREY
    corners = [(0, 0), (0, 16), (16, 0), (16, 16)]
    tiles = [padded[row : row + 16, col : col + 16].tobytes() for row, col in corners]
    tiles = [zlib.compress(tile) for tile in tiles] if compression == 8 else tiles
    tags = {**TILED, 259: compression}
    assert np.array_equal(read(tiff(tiles, tags=tags, tiled=True)), GREY)
    for parts in (*(tiles[:count] for count in range(4)), [*tiles[:3], tiles[3][:-9]]):
        assert read(tiff(parts, tags=tags, tiled=True)) is None
    sizes = [len(tiles[0])] * 3, [0, *map(len, tiles[1:])], [1 << 30] * 4
    offsets = [8] * 3, [1 << 31] * 4
    for changes in (*({TILE_SIZES: o} for o in sizes), *({TILE_OFFSETS: o} for o in offsets)):
        assert read(tiff(tiles, tags={**tags, **changes}, tiled=True)) is None


STRIPS = [GREY[:10].tobytes(), GREY[10:20].tobytes(), GREY[20:].tobytes()]


@pytest.mark.parametrize("tags", [
    {STRIP_SIZES: [190, 190]}, {STRIP_OFFSETS: [8, 198]}, {STRIP_OFFSETS: 8, STRIP_SIZES: 190},
    *({ROWS_PER_STRIP: count} for count in (0, 5, 21)),
    {257: HEIGHT + 1}, {257: HEIGHT + 10}, {256: WIDTH + 1},
    {258: 16},  # bits
    {277: 3},  # samples
    {259: 6}, {259: 50001},  # compressions: old JPEG, WebP
    {TILE_OFFSETS: 8, **TILED},
    {STRIP_OFFSETS: [8, 198, 1 << 20]},  # beyond the file
], ids=str)  # fmt: skip
@pytest.mark.parametrize("compression", [1, 8])
def test_tables_of_strips_that_do_not_fit_are_refused(read, tags, compression):
    strips = [zlib.compress(strip) for strip in STRIPS] if compression == 8 else STRIPS
    good = {ROWS_PER_STRIP: 10, 259: compression}
    assert np.array_equal(read(tiff(strips, tags=good)), GREY)
    assert read(tiff(strips, tags={**good, **tags})) is None
