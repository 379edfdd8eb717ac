"""Pixels that are not in a file are an error, in every format and compression."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from mapdeal import MalformedInputError
from mapdeal.maps.images import read_image

HEIGHT, WIDTH = 21, 19
PLACES, ENDS = 12, 8
RANDOM = np.random.default_rng(5)
GREY = np.where(
    RANDOM.random((HEIGHT, WIDTH)) < 0.4, 254, RANDOM.choice([0, 0, 205, 254], (HEIGHT, WIDTH))
).astype(np.uint8)
BITS = RANDOM.random((HEIGHT, WIDTH)) < 0.4
DEEP = GREY.astype(np.uint16) * 257
COLOUR = np.stack([GREY, GREY[::-1], GREY[:, ::-1]], axis=2)
PALETTE = Image.fromarray(GREY // 64)
PALETTE.putpalette([0, 0, 9, 90, 9, 9, 205, 9, 205, 254, 254, 9])
WITH_ALPHA = Image.fromarray(np.dstack([COLOUR, GREY]))
PICTURES = {
    "bits": Image.fromarray(BITS),
    "grey": Image.fromarray(GREY),
    "deep": Image.fromarray(DEEP),
    "colour": Image.fromarray(COLOUR),
    "palette": PALETTE,
    "alpha": WITH_ALPHA,
}
FAXES = ("tiff_ccitt", "group3", "group4", "tiff_raw_16")
COMPRESSIONS = ("tiff_lzw", "tiff_adobe_deflate", "tiff_deflate", "packbits", "lzma", "zstd")
STRIP_OFFSETS, ROWS_PER_STRIP, STRIP_SIZES, TILE_OFFSETS, TILE_SIZES = 273, 278, 279, 324, 325

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]


def saved(picture, name, **options):
    file = io.BytesIO()
    PICTURES[picture].save(file, name, **options)
    return file.getvalue()


def cases():
    """Return name and arguments of `saved` for all that Pillow writes and maps may have."""
    kinds = [(picture, "PNG", {}) for picture in PICTURES]
    kinds += [(picture, "BMP", {}) for picture in ("bits", "grey", "colour", "palette", "alpha")]
    kinds += [(picture, "PPM", {}) for picture in ("bits", "grey", "deep", "colour")]
    for picture in ("grey", "colour"):
        kinds += [(picture, "JPEG", {}), (picture, "JPEG", {"progressive": True}),
                  (picture, "JPEG", {"optimize": True, "quality": 95}),
                  (picture, "JPEG", {"restart_marker_blocks": 2}),
                  (picture, "JPEG", {"progressive": True, "restart_marker_rows": 1})]  # fmt: skip
        kinds += [
            (picture, "TIFF", {"compression": "jpeg"}),
            (picture, "TIFF", {"compression": "jpeg", "tiffinfo": {ROWS_PER_STRIP: 8}}),
        ]
    kinds += [(picture, "TIFF", {}) for picture in PICTURES]
    for strip in (HEIGHT, 4):
        options = {"tiffinfo": {ROWS_PER_STRIP: strip}}
        kinds += [("bits", "TIFF", {"compression": fax, **options}) for fax in FAXES]
        kinds += [(picture, "TIFF", {"compression": one, **options})
                  for picture in ("bits", "colour") for one in COMPRESSIONS]  # fmt: skip
        kinds += [(picture, "TIFF", options) for picture in ("bits", "grey", "colour")]
    return [
        pytest.param(*kind, id="-".join([kind[0], kind[1], *map(str, kind[2].values())]))
        for kind in kinds
    ]


every_case = pytest.mark.parametrize(("picture", "name", "options"), cases())


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
    ends = {*range(min(ENDS, count)), *range(max(0, count - ENDS), count)}
    return sorted({*ends, *np.linspace(0, max(0, count - 1), PLACES).astype(int).tolist()})


@every_case
def test_a_file_that_is_cut_is_refused_or_still_the_same_picture(read, picture, name, options):
    data = saved(picture, name, **options)
    whole = read(data)
    assert whole is not None
    refused = 0
    for end in some(len(data)):
        found = read(data[:end])
        assert found is None or np.array_equal(found, whole), end
        refused += found is None
    assert refused > PLACES // 2


def tags_of(data):
    """Return offset of the entry, type, count and value of each tag of a TIFF of Pillow's."""
    (directory,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, directory)
    entries = [directory + 2 + 12 * index for index in range(count)]
    facts = [(at, *struct.unpack_from("<HHII", data, at)) for at in entries]
    return {tag: (at, kind, n, value) for at, tag, kind, n, value in facts}


def with_last_size(data, size):
    """Return a TIFF that says another number of bytes of its last strip."""
    at, kind, count, value = tags_of(data)[STRIP_SIZES]
    width, form = {3: (2, "<H"), 4: (4, "<I")}[kind]
    start = at + 8 if width * count <= 4 else value
    changed = bytearray(data)
    struct.pack_into(form, changed, start + width * (count - 1), size)
    return bytes(changed)


@pytest.mark.parametrize(("picture", "name", "options"), [
    case
    for case in cases()
    if case.values[1] == "TIFF" and case.values[2].get("compression") not in ("jpeg", *FAXES)
])  # fmt: skip
def test_a_tiff_whose_last_strip_ends_early_is_refused_though_its_tables_fit(
    read, picture, name, options
):
    data = saved(picture, name, **options)
    whole = read(data)
    tags = TiffImagePlugin.TiffImageFile(io.BytesIO(data)).tag_v2
    start, size = tags[STRIP_OFFSETS][-1], tags[STRIP_SIZES][-1]
    for missing in some(size)[1:]:
        end = start + size - missing
        cut = data[:end] + bytes(missing) + data[start + size :]
        found = read(with_last_size(cut, size - missing))
        assert found is None or np.array_equal(found, whole), missing


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate", "group4", "jpeg"])
@pytest.mark.parametrize("table", [STRIP_OFFSETS, STRIP_SIZES])
@pytest.mark.parametrize("strips", [1, 2])
def test_a_tiff_with_fewer_strips_than_rows_is_refused(read, compression, table, strips):
    picture = "bits" if compression == "group4" else "grey"
    options = {ROWS_PER_STRIP: 8}
    data = bytearray(saved(picture, "TIFF", compression=compression, tiffinfo=options))
    at, kind, count, value = tags_of(data)[table]
    assert count == 3
    width = {3: 2, 4: 4}[kind]
    if width * strips <= 4:  # few values stand in the entry itself
        data[at + 8 : at + 8 + width * strips] = data[value : value + width * strips]
    struct.pack_into("<I", data, at + 4, strips)
    assert read(bytes(data)) is None


def test_a_tiff_with_more_rows_than_its_strips_is_refused(read):
    for compression in ("raw", "tiff_adobe_deflate"):
        for tag, value in ((257, HEIGHT + 1), (256, WIDTH + 1), (ROWS_PER_STRIP, HEIGHT - 1)):
            data = bytearray(saved("grey", "TIFF", compression=compression))
            at, kind, _, _ = tags_of(data)[tag]
            struct.pack_into({3: "<H", 4: "<I"}[kind], data, at + 8, value)
            assert read(bytes(data)) is None


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


def tiles(size=16):
    padded = np.zeros((32, 32), np.uint8)
    padded[:HEIGHT, :WIDTH] = GREY
    corners = [(row, col) for row in (0, size) for col in (0, size)]
    return [padded[row : row + size, col : col + size].tobytes() for row, col in corners]


TILED = {322: 16, 323: 16}


@pytest.mark.parametrize("compression", [1, 8])
def test_tiles_must_cover_the_picture(read, compression):
    whole = [zlib.compress(tile) if compression == 8 else tile for tile in tiles()]
    tags = {**TILED, 259: compression}
    assert np.array_equal(read(tiff(whole, tags=tags, tiled=True)), GREY)
    for count in range(4):
        assert read(tiff(whole[:count], tags=tags, tiled=True)) is None
    short = [*whole[:3], whole[3][:-9]]
    assert read(tiff(short, tags=tags, tiled=True)) is None
    for sizes in ([len(whole[0])] * 3, [0, *map(len, whole[1:])], [1 << 30] * 4):
        assert read(tiff(whole, tags={**tags, TILE_SIZES: sizes}, tiled=True)) is None
    for offsets in ([8] * 3, [1 << 31] * 4):
        assert read(tiff(whole, tags={**tags, TILE_OFFSETS: offsets}, tiled=True)) is None


STRIPS = [GREY[:10].tobytes(), GREY[10:20].tobytes(), GREY[20:].tobytes()]


def test_strips_are_read_in_their_order(read):
    assert np.array_equal(read(tiff(STRIPS, tags={ROWS_PER_STRIP: 10})), GREY)


@pytest.mark.parametrize("tags", [
    {ROWS_PER_STRIP: 0},
    {ROWS_PER_STRIP: 10, STRIP_SIZES: [190, 190]},
    {ROWS_PER_STRIP: 5},
    {ROWS_PER_STRIP: 21},
    {ROWS_PER_STRIP: 10, 258: 16},  # bits
    {ROWS_PER_STRIP: 10, 277: 3},  # samples
    {ROWS_PER_STRIP: 10, 259: 6},  # old JPEG compression
    {ROWS_PER_STRIP: 10, 259: 50001},  # WebP compression
    {ROWS_PER_STRIP: 10, TILE_OFFSETS: 8, **TILED},
    {ROWS_PER_STRIP: 10, STRIP_OFFSETS: [8, 198, 1 << 20]},  # beyond the file
], ids=str)  # fmt: skip
def test_tables_of_strips_that_do_not_fit_are_refused(read, tags):
    assert read(tiff(STRIPS, tags=tags)) is None


def bmp(codes, bits=8, start=None):
    """Return a BMP of 4 x 3 pixels, run-length encoded."""
    palette = b"".join(bytes([grey, grey, 9, 0]) for grey in (0, 205, 254, 90))
    header = struct.pack("<IiiHHIIiiII", 40, 4, 3, 1, bits, 1 if bits == 8 else 2, len(codes),
                         0, 0, 4, 0)  # fmt: skip
    start = 14 + 40 + len(palette) if start is None else start
    return b"BM" + struct.pack("<IHHI", 0, 0, 0, start) + header + palette + codes


RUNS = bytes([4, 1, 0, 0, 0, 3, 1, 2, 3, 0, 1, 0, 0, 0, 2, 3, 2, 2, 0, 1])
NARROW_RUNS = bytes([4, 0x11, 0, 0, 0, 3, 0x12, 0x30, 1, 0, 0, 0, 2, 0x33, 2, 0x22, 0, 1])
INDICES = [[3, 3, 2, 2], [1, 2, 3, 0], [1, 1, 1, 1]]


@pytest.mark.parametrize(("bits", "codes"), [(8, RUNS), (4, NARROW_RUNS)])
def test_run_lengths_are_read_and_refused_where_they_are_cut(read, bits, codes):
    whole = read(bmp(codes, bits))
    assert whole.tolist() == INDICES
    for end in range(len(codes) - 2):
        for behind in (b"", b"\0\1") if end % 2 == 0 else (b"",):
            found = read(bmp(codes[:end] + behind, bits))
            assert found is None or found.tolist() == INDICES


NETPBM = {
    "P1": b"P1\n4 3\n0 1 1 0\n1001\n0 1 1 1\n",
    "P2": b"P2 # grey\n4 3\n255\n0 205 254 254\n0 0 0 9\n254 254 254 0\n",
    "P3": b"P3\n2 2\n255\n0 1 2  3 4 5\n6 7 8  9 10 0\n",
    "P4": b"P4\n11 3\n" + bytes([1, 2, 3, 4, 5, 64]),
    "P5": b"P5\n4 3\n255\n" + bytes(range(12)),
    "P5-wide": b"P5\n4 3\n999\n" + bytes([1, 2] * 12),
    "P6": b"P6\n2 2\n255\n" + bytes(range(12)),
}


@pytest.mark.parametrize("data", NETPBM.values(), ids=NETPBM)
def test_a_netpbm_file_that_is_cut_is_refused(read, data):
    whole = read(data)
    assert whole is not None
    for end in range(len(data)):
        found = read(data[:end])
        assert found is None or np.array_equal(found, whole), end
