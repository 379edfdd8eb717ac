"""Bad images: what each is refused with, and what odd ones are read as."""

import io
import os
import struct
import subprocess
import sys
import tracemalloc
import zlib

import numpy as np
import pytest
from PIL import Image

from bad_maps import DRAWING, PGM, PIXELS, cells_of, tree, write_map, yaml_text
from drawn import cells


def encoded(pixels, image_format, **options):
    file = io.BytesIO()
    array = pixels if isinstance(pixels, Image.Image) else Image.fromarray(np.array(pixels))
    array.save(file, image_format, **options)
    return file.getvalue()


def png_chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(width, height, bit_depth, colour_type, rows, *, interlaced=0, before_data=b""):
    header = struct.pack(">IIBBBBB", width, height, bit_depth, colour_type, 0, 0, interlaced)
    return (
        b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", header) + before_data
        + png_chunk(b"IDAT", zlib.compress(rows)) + png_chunk(b"IEND", b"")
    )  # fmt: skip


GREY_ROWS = b"\0" + PIXELS[:3] + b"\0" + PIXELS[3:]
GREY_PNG = png(3, 2, 8, 0, GREY_ROWS)
ANIMATED = png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"acTL", struct.pack(">II", 2, 0)))


def with_chunk(name, body):
    """The grey picture with one chunk more behind its header."""
    return png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(name, body))


HUGE_BMP = b"BM" + struct.pack("<IHHI", 70, 0, 0, 54) + struct.pack(
    "<IiiHHIIiiII", 40, 100_000, 100_000, 1, 8, 0, 0, 0, 0, 0, 0
)  # fmt: skip


def tiff(bits=8, bad_tag=False):
    """A grey 3 x 2 TIFF; a bad tag has its text far behind the file's end."""
    tags = [(256, 3), (257, 2), (258, bits), (259, 1), (262, 1), (273, 8), (277, 1), (278, 2),
            (279, 6)]  # fmt: skip
    entries = [struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags]
    if bad_tag:
        entries.insert(5, struct.pack("<HHII", 270, 2, 1000, 99_999))
    count = struct.pack("<H", len(entries))
    return b"II*\0" + struct.pack("<I", 14) + PIXELS + count + b"".join(entries) + bytes(4)


def two_page_tiff():
    page = Image.fromarray(np.array([[0, 254, 205], [254, 254, 0]], dtype=np.uint8))
    return encoded(page, "TIFF", save_all=True, append_images=[page])


BAD_IMAGES = [
    ("I2-zero-bytes", b"", "empty"),
    ("I2-html", b"<!DOCTYPE html>\n<html><body>404</body></html>\n", "image"),
    ("I2-lfs-pointer", b"version https://git-lfs.github.com/spec/v1\nsize 6\n", "Git LFS"),
    ("I3-truncated", PGM[:-1], "expected 6 bytes, got 5"),
    ("I4-crlf-in-pixels", b"P5\r\n3 2\r\n255\r\n" + bytes([0, 13, 10, 205, 254, 254, 0]),
     "CRLF-damaged"),
    ("I10-short-transparent-colour",
     png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"tRNS", b"a")), "tRNS"),
    ("I10-palette-behind-the-pixels",
     png(3, 2, 8, 3, bytes(8))[:-12] + png_chunk(b"PLTE", b"abc") + GREY_PNG[-12:], "m.pgm"),
    ("I10-three-bits", png(3, 2, 3, 0, GREY_ROWS), "not an image"),
    ("I10-colour-type-1", png(3, 2, 8, 1, GREY_ROWS), "not an image"),
    ("I10-interlaced-otherwise", png(3, 2, 8, 0, GREY_ROWS, interlaced=2), "damaged"),
    ("I6-png-of-width-0", png(0, 2, 8, 0, GREY_ROWS), "not an image"),
    ("I11-two-headers-one-short", with_chunk(b"IHDR", b"abc"), "IHDR"),
    ("I11-short-header-behind-the-pixels",
     GREY_PNG[:-12] + png_chunk(b"IHDR", b"abc") + GREY_PNG[-12:], "IHDR"),
    ("I11-short-frame-control", with_chunk(b"fcTL", b"abc"), "m.pgm"),
    ("I11-text-of-5-megabytes", with_chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(5_000_000))),
     "m.pgm"),
    ("I11-bad-checksum", GREY_PNG[:-13] + bytes([GREY_PNG[-13] ^ 1]) + GREY_PNG[-12:],
     "IDAT"),
    ("I11-animated", ANIMATED, "m.pgm"),
    ("I15-two-tiff-pages", two_page_tiff(), "more than one picture"),
]  # fmt: skip


@pytest.fixture
def image_refused(folder, refused):
    """Write an image into the map, or leave what is there; hold two commands to its refusal."""

    def check(image, exit_code, *named, hint="", options=()):
        if image is not None:
            write_map(folder, image=image)
        for words in (["info", "m.yaml"], ["run", "m.yaml", "-o", "out"]):
            refused([*words, *options], exit_code, *named, hint=hint)

    return check


@pytest.fixture
def read_cells(folder, accepted):
    """The cells of m.yaml with an image after a conversion, and the warnings it made."""

    def read(image, *options, **keys):
        write_map(folder, yaml_text(**keys), image)
        _, warned = accepted("convert", "m.yaml", "-o", "o.npz", "--force", *options)
        return cells_of("o.npz"), warned

    return read


@pytest.mark.parametrize(("image", "place"), [pytest.param(*c, id=row) for row, *c in BAD_IMAGES])
def test_a_bad_image_is_refused(image_refused, image, place):
    image_refused(image, 3, "m.pgm", place)


@pytest.mark.parametrize(("image", "size", "options"), [
    (b"P5\n30000 30000\n255\n", None, []),
    (png(14_000, 14_000, 8, 0, b""), None, []),
    (HUGE_BMP, None, []),
    (b"P5\n20000 10000\n255\n", 200_000_019, ["--max-cells", "1000"]),
], ids=["pgm", "png", "bmp", "large file"])  # fmt: skip
def test_an_image_above_the_limit_is_refused_before_memory_is_taken(
    folder, image_refused, image, size, options
):
    write_map(folder, image=image)
    if size:
        os.truncate(folder / "m.pgm", size)
    tracemalloc.start()
    try:
        image_refused(None, 3, "m.pgm", options=options)
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("image", [PGM, GREY_PNG, tiff()], ids=["pgm", "png", "tiff"])
def test_max_cells_is_the_largest_size_that_is_read(image_refused, read_cells, image):
    words = {"options": ["--max-cells", "5"], "hint": "--max-cells"}
    image_refused(image, 3, "m.pgm", "limit of 5", **words)
    assert read_cells(image, "--max-cells", "6")[0] == cells(DRAWING).tolist()


@pytest.mark.parametrize(("make", "told"), [
    (lambda path: os.truncate(path, 1 << 40), ""),
    (lambda path: (path.unlink(), os.mkfifo(path)), "no regular file"),
    (lambda path: (path.unlink(), path.symlink_to("/dev/zero")), "no regular file"),
    (lambda path: (path.unlink(), path.mkdir()), "directory"),
], ids=["sparse tebibyte", "pipe", "device", "folder"])  # fmt: skip
def test_what_is_no_file_of_pixels_is_refused_unread(folder, image_refused, make, told):
    make(folder / "m.pgm")
    image_refused(None, 4, "m.pgm", told)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("elsewhere.txt", ""), ("M.PGM", "M.PGM"), ("m.png", "m.png"), ("map.pgm", "map.pgm")],
)
def test_a_missing_image_is_refused_with_the_nearest_names(folder, image_refused, name, hint):
    (folder / "m.pgm").rename(folder / name)
    image_refused(None, 4, "m.yaml", "m.pgm", hint=hint)


def test_a_file_that_changes_while_it_is_read_is_refused(folder, command, monkeypatch):
    original = os.pread

    def append_and_read(*arguments):
        with (folder / "m.pgm").open("ab") as file:
            file.write(b"\0")
        return original(*arguments)

    monkeypatch.setattr(os, "pread", append_and_read)
    code, out, err = command("run", "m.yaml", "-o", "out")
    assert (code, out) == (4, "")
    assert "m.pgm" in err
    assert "changed" in err
    assert not (folder / "out").exists()


DEEP = struct.pack(">6H", 0, 65535, 52685, 65535, 65535, 0)

COLOUR_ALPHA = np.repeat(np.uint8([[0, 254, 254], [254, 254, 0]])[..., np.newaxis], 4, axis=2)
COLOUR_ALPHA[..., 3] = [[255, 255, 128], [255, 255, 255]]
READABLE = [
    ("I3-trailing-bytes", PGM + b"\nbye", "nav2", DRAWING),
    ("I4-crlf-header-only", b"P5\r\n3 2\r\n255\r\n" + PIXELS, "nav2", DRAWING),
    ("I5-first-pixels-like-a-comment", b"P5\n3 2\n255\n##" + PIXELS[2:], "nav2", "##?\n..#"),
    ("I7-maxval-100", b"P5\n3 2\n100\n" + bytes([0, 100, 80, 100, 100, 0]), "nav2", DRAWING),
    ("I10-colour-and-alpha", encoded(COLOUR_ALPHA, "PNG"), "nav2", DRAWING),
    ("I7-maxval-65535", b"P5\n3 2\n65535\n" + DEEP, "nav2", DRAWING),
    ("I9-P4", b"P4\n3 2\n" + bytes([0b10000000, 0b00100000]), "nav2", "#..\n..#"),
    ("I10-damaged-icc-profile",
     png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"iCCP", b"p\0\0junk")), "nav2", DRAWING),
    ("I11-exif-rotation", encoded(np.array([[0, 254, 205], [254, 254, 0]], np.uint8), "PNG",
     exif=b"Exif\0\0MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"), "nav2", DRAWING),
    ("I15-one-tiff-page", tiff(), "nav2", DRAWING),
]  # fmt: skip


@pytest.mark.parametrize(
    ("image", "dialect", "drawing"), [pytest.param(*case, id=row) for row, *case in READABLE]
)
def test_an_odd_image_is_read_for_what_it_holds(read_cells, image, dialect, drawing):
    assert read_cells(image, "--dialect", dialect)[0] == cells(drawing).tolist()


@pytest.mark.parametrize(("image", "told", "unlike"), [
    (b"P5\r\n3 2\r\n255\r\n" + PIXELS, "m.pgm", None),
    (encoded(np.full((2, 3), 255, np.uint8), "JPEG"), "lossy", "...\n..."),
], ids=["DOS line ends", "JPEG named pgm"])  # fmt: skip
def test_an_image_that_is_no_longer_what_it_was_is_warned_of(read_cells, image, told, unlike):
    occupancy, warned = read_cells(image)
    assert occupancy == cells(unlike or DRAWING).tolist()
    assert any(told in line for line in warned)


def test_a_tiff_with_a_bad_tag_says_so_in_lines_of_ours(folder, command):
    write_map(folder, image=tiff(bad_tag=True))
    code, _, err = command("info", "m.yaml")
    assert code in (0, 3)
    assert all(line.startswith(("error: ", "hint: ", "warning: ")) for line in err.splitlines())


def test_a_damaged_compressed_tiff_has_one_line_on_the_real_stderr(folder):
    # The decoder writes to the process's stderr behind Python's back.
    image = encoded(np.arange(35, dtype=np.uint8).reshape(5, 7), "TIFF",
                    compression="tiff_adobe_deflate")  # fmt: skip
    start = image.index(b"\x78")
    write_map(folder, image=image[: start + 2] + b"\xff" * 12 + image[start + 14 :])
    words = [sys.executable, "-m", "mapdeal", "info", "m.yaml"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.startswith("error: m.pgm: ")
    assert len(done.stderr.splitlines()) == 1


# Good, but odd.


def drawn_pgm(drawing):
    rows = drawing.split()
    pixels = bytes({"#": 0, ".": 254, "?": 205}[c] for c in "".join(rows))
    return f"P5\n{len(rows[0])} {len(rows)}\n255\n".encode() + pixels


@pytest.mark.parametrize(("drawing", "unknown", "distances", "cost"), [
    ("...\n...", "free", [[np.inf] * 3] * 2, 0),
    ("###\n###", "free", [[-np.inf] * 3] * 2, 254),
    ("???\n???", "free", [[np.inf] * 3] * 2, 255),
    ("???\n???", "occupied", [[-np.inf] * 3] * 2, 255),
    ("#", "free", [[-np.inf]], 254),
    (".", "free", [[np.inf]], 0),
    ("#..", "free", [[0, 0.05, 0.1]], None),
    ("#\n.\n.", "free", [[0.1], [0.05], [0]], None),
    ("#.\n..", "free", [[0.05, 0.05 * 2**0.5], [0, 0.05]], None),
])  # fmt: skip
def test_maps_of_one_kind_of_cell_and_the_smallest_ones(
    folder, accepted, drawing, unknown, distances, cost
):
    write_map(folder, image=drawn_pgm(drawing))
    accepted("esdf", "m.yaml", "-o", "o.npz", "--unknown", unknown, "--image", "p.png")
    assert cells_of("o.npz", "distance") == np.array(distances, np.float32).tolist()
    with Image.open("p.png") as picture:
        assert picture.width >= len(distances[0])
    accepted("run", "m.yaml", "-o", "out")
    costs = np.array(cells_of("out/m/cost.npz", "cost"))
    assert costs.shape == np.shape(distances)
    assert cost is None or (costs == cost).all()
    names = {path.name for path in (folder / "out" / "m").iterdir()}
    assert {"cost.pgm", "cost.png", "esdf.npz", "inflated.pgm", "manifest.json"} <= names


@pytest.mark.parametrize("words", [
    ["active", "m.yaml", "-o", "new/o.yaml", "--image", "p.png"],
    ["run", "m.yaml", "-o", "out", "--sim"],
    ["run", "m.yaml", "-o", "new/out", "--recipe", "design-sim"],
], ids=" ".join)  # fmt: skip
def test_a_map_without_a_known_cell_has_no_active_region(folder, command, words):
    write_map(folder, image=drawn_pgm("???\n???"))
    before = tree(folder)
    code, out, err = command(*words)
    assert (code, out) == (3, "")
    (error,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert "no active cells" in error
    assert "m.yaml" in error
    assert tree(folder) == before


@pytest.mark.parametrize(("drawing", "words", "expected"), [
    ("????\n?.??\n.#??", ["active", "--margin", "0.05"], "???\n?.?\n.#?"),
    ("....#\n.....\n.....", ["inflate", "--radius", "0.05"], "...##\n....#\n....."),
])  # fmt: skip
def test_nothing_goes_beyond_the_border(folder, accepted, drawing, words, expected):
    write_map(folder, image=drawn_pgm(drawing))
    accepted(words[0], "m.yaml", "-o", "o.npz", *words[1:])
    assert cells_of("o.npz") == cells(expected).tolist()
    assert cells_of("o.npz", "origin") == [1.5, -2.0, 0.4]


def test_bit_rows_that_fill_no_byte_keep_their_columns(read_cells):
    rows = bytes([0b00000000, 0b00100000, 0b10000000, 0b01000000])
    found, _ = read_cells(b"P4\n11 2\n" + rows)
    assert found == cells("..........#\n#........#.").tolist()


def test_raw_values_above_100_are_unknown_and_counted(read_cells):
    pixels = bytes([0, 100, 101, 254, 255, 42])
    occupancy, warned = read_cells(b"P5\n3 2\n255\n" + pixels, mode="raw")
    assert occupancy == [[-1, -1, 42], [0, 100, -1]]
    assert any("m.pgm" in line and " 2 " in line for line in warned)


def test_grey_levels_of_a_drawing_program_are_read_by_the_thresholds(read_cells):
    # Darkness 0.647, 0.651, 0.2, 0.196 (one grey level each side of both thresholds).
    found, _ = read_cells(b"P5\n4 1\n255\n" + bytes([90, 89, 204, 206]))
    assert found == [[-1, 100, -1, 0]]
