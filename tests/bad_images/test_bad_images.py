"""Bad images (rows I): what each is refused with, and what the others are read as."""

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

from bad_maps import DRAWING, PGM, PIXELS
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
    ("I2-text", b"not an image\n", "image"),
    ("I2-html", b"<!DOCTYPE html>\n<html><body>404</body></html>\n", "image"),
    ("I2-lfs-pointer", b"version https://git-lfs.github.com/spec/v1\nsize 6\n", "Git LFS"),
    ("I3-truncated", PGM[:-1], "expected 6 bytes, got 5"),
    ("I3-header-only", b"P5\n3 2\n255\n", "expected 6 bytes, got 0"),
    ("I3-half-a-header", b"P5\n3", "header height"),
    ("I3-no-space-behind-maxval", b"P5\n3 2\n255", "header"),
    ("I4-crlf-in-pixels", b"P5\r\n3 2\r\n255\r\n" + bytes([0, 13, 10, 205, 254, 254, 0]),
     "CRLF-damaged"),
    ("I6-width-0", b"P5\n0 2\n255\n", "width"),
    ("I6-height-0", b"P5\n3 0\n255\n", "height"),
    ("I6-negative-width", b"P5\n-3 2\n255\n" + PIXELS, "width"),
    ("I6-fraction", b"P5\n3.5 2\n255\n" + PIXELS, "width"),
    ("I7-maxval-0", b"P5\n3 2\n0\n" + PIXELS, "maxval"),
    ("I7-maxval-70000", b"P5\n3 2\n70000\n" + PIXELS * 2, "maxval"),
    ("I8-too-few", b"P2\n3 2\n255\n0 254 205\n254 254\n", "pixel 5"),
    ("I8-too-many", b"P2\n3 2\n255\n0 254 205\n254 254 0 7\n", "pixel 6"),
    ("I8-not-a-number", b"P2\n3 2\n255\n0 254 x\n254 254 0\n", "pixel 2"),
    ("I8-negative", b"P2\n3 2\n255\n0 254 205\n-1 254 0\n", "pixel 3"),
    ("I8-above-maxval", b"P2\n3 2\n200\n0 200 150\n100 201 0\n", "pixel 4"),
    ("I8-binary-above-maxval", b"P5\n3 2\n200\n" + bytes([0, 200, 150, 100, 201, 0]), "pixel 4"),
    ("I8-bit-of-2", b"P1\n3 2\n1 0 2\n0 0 1\n", "pixel 2"),
    ("I9-pfm", b"Pf\n3 2\n-1.0\n" + bytes(24), "PFM"),
    ("I9-colour-pfm", b"PF\n3 2\n-1.0\n" + bytes(72), "PFM"),
    ("I10-palette-missing", png(3, 2, 8, 3, bytes(8)), "m.pgm"),
    ("I10-short-transparent-colour",
     png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"tRNS", b"a")), "tRNS"),
    ("I10-palette-behind-the-pixels",
     png(3, 2, 8, 3, bytes(8))[:-12] + png_chunk(b"PLTE", b"abc") + GREY_PNG[-12:], "m.pgm"),
    ("I10-no-bits", png(3, 2, 0, 0, GREY_ROWS), "not an image"),
    ("I10-three-bits", png(3, 2, 3, 0, GREY_ROWS), "not an image"),
    ("I10-colour-of-4-bits", png(3, 2, 4, 2, bytes(12)), "not an image"),
    ("I10-colour-type-1", png(3, 2, 8, 1, GREY_ROWS), "not an image"),
    ("I10-interlaced-otherwise", png(3, 2, 8, 0, GREY_ROWS, interlaced=2), "damaged"),
    ("I6-png-of-width-0", png(0, 2, 8, 0, GREY_ROWS), "not an image"),
    ("I6-png-of-height-0", png(3, 0, 8, 0, GREY_ROWS), "not an image"),
    ("I11-two-headers-one-short", with_chunk(b"IHDR", b"abc"), "IHDR"),
    ("I11-short-header-behind-the-pixels",
     GREY_PNG[:-12] + png_chunk(b"IHDR", b"abc") + GREY_PNG[-12:], "IHDR"),
    ("I11-short-gamma", with_chunk(b"gAMA", b"abc"), "gAMA"),
    ("I11-short-frame-control", with_chunk(b"fcTL", b"abc"), "m.pgm"),
    ("I11-no-exif", with_chunk(b"eXIf", b"junk"), "m.pgm"),
    ("I11-empty-profile", with_chunk(b"iCCP", b""), "m.pgm"),
    ("I11-text-of-5-megabytes", with_chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(5_000_000))),
     "m.pgm"),
    ("I11-unknown-filter", png(3, 2, 8, 0, b"\x09" + GREY_ROWS[1:]), "m.pgm"),
    ("I11-truncated-png", GREY_PNG[:-20], "m.pgm"),
    ("I11-png-without-its-end", GREY_PNG[:-12], "damaged"),
    ("I11-bad-checksum", GREY_PNG[:-13] + bytes([GREY_PNG[-13] ^ 1]) + GREY_PNG[-12:],
     "IDAT"),
    ("I11-animated", ANIMATED, "m.pgm"),
    ("I13-ten-thousand-million-pixels", b"P5\n100000 100000\n255\n", "above the limit"),
    ("I13-bits", b"P4\n100000 100000\n", "above the limit"),
    ("I13-png-above-the-limit", png(20_000, 10_001, 8, 0, b""), "above the limit"),
    ("I13-bmp-above-the-limit", HUGE_BMP, "above the limit"),
    ("I13-width-of-many-digits", b"P5\n" + b"9" * 5000 + b" 2\n255\n", "width"),
    ("I13-endless-comment", b"P5\n#" + b"x" * 200_000, "header"),
    ("I15-two-pnm-pictures", PGM + PGM, "more than one picture"),
    ("I15-two-tiff-pages", two_page_tiff(), "more than one picture"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("image", "place"), [pytest.param(*case, id=row) for row, *case in BAD_IMAGES]
)
def test_a_bad_image_is_refused(write_map, refused, image, place):
    write_map(image)
    refused(3, "m.pgm", place)


def test_a_header_above_the_limit_is_refused_before_memory_is_taken_i13(write_map, refused):
    for image in (b"P5\n30000 30000\n255\n", png(14_000, 14_000, 8, 0, b""), HUGE_BMP):
        write_map(image)
        tracemalloc.start()
        try:
            refused(3, "m.pgm")
            assert tracemalloc.get_traced_memory()[1] < 16_000_000
        finally:
            tracemalloc.stop()


def test_a_large_file_above_max_cells_is_refused_before_it_is_read_i13(write_map, folder, refused):
    write_map(b"P5\n20000 10000\n255\n")
    os.truncate(folder / "m.pgm", 19 + 200_000_000)
    tracemalloc.start()
    try:
        refused(3, "m.pgm", "above the limit", options=["--max-cells", "1000"])
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("image", [PGM, GREY_PNG, tiff()], ids=["I13-pgm", "I13-png", "I13-tiff"])
def test_max_cells_is_the_largest_size_that_is_read(write_map, refused, read_cells, image):
    write_map(image)
    refused(3, "m.pgm", "limit of 5", options=["--max-cells", "5"], hint="--max-cells")
    assert read_cells("--max-cells", "6")[0] == cells(DRAWING).tolist()


def test_a_sparse_file_of_a_tebibyte_is_refused_i16(write_map, folder, refused):
    write_map(PGM)
    os.truncate(folder / "m.pgm", 1 << 40)
    refused(4, "m.pgm")


def test_a_pipe_is_refused_without_waiting_for_it_i16(write_map, folder, refused):
    write_map()
    os.mkfifo(folder / "m.pgm")
    refused(4, "m.pgm", "no regular file")


def test_a_device_is_refused_without_reading_it_i16(write_map, folder, refused):
    write_map()
    (folder / "m.pgm").symlink_to("/dev/zero")
    refused(4, "m.pgm", "no regular file")


def test_a_folder_is_refused_i16(write_map, folder, refused):
    write_map()
    (folder / "m.pgm").mkdir()
    refused(4, "m.pgm", "directory")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        pytest.param("elsewhere.txt", "", id="I1-missing"),
        pytest.param("M.PGM", "M.PGM", id="I1-other-case"),
        pytest.param("m.png", "m.png", id="I1-other-ending"),
        pytest.param("map.pgm", "map.pgm", id="I1-similar-name"),
    ],
)
def test_a_missing_image_is_refused_with_the_nearest_names(write_map, folder, refused, name, hint):
    write_map(PGM)
    (folder / "m.pgm").rename(folder / name)
    refused(4, "m.yaml", "m.pgm", hint=hint)


def test_a_file_that_changes_while_it_is_read_is_refused_i17(
    write_map, folder, command, monkeypatch
):
    write_map(PGM)
    original = os.pread

    def append_and_read(*arguments):
        with (folder / "m.pgm").open("ab") as file:
            file.write(b"\0")
        return original(*arguments)

    monkeypatch.setattr(os, "pread", append_and_read)
    code, out, err = command("run", "m.yaml", "-o", "out")
    assert code == 4
    assert out == ""
    assert "m.pgm" in err
    assert "changed" in err
    assert not (folder / "out").exists()


COLOURS = bytes([0, 0, 0, 254, 254, 254, 0, 255, 0, 255, 255, 255, 254, 254, 254, 0, 0, 0])
DEEP = struct.pack(">6H", 0, 65535, 52685, 65535, 65535, 0)
PALETTE = png_chunk(b"PLTE", bytes([254, 254, 254, 0, 0, 0, 205, 205, 205]))
INDEXED = png(3, 2, 8, 3, bytes([0, 1, 0, 2, 0, 0, 0, 1]), before_data=PALETTE)
ALPHA_ROWS = bytes([0, 0, 255, 254, 255, 254, 128, 0, 254, 255, 254, 255, 0, 255])
COLOUR_ALPHA = [
    [[0, 0, 0, 255], [254, 254, 254, 255], [254, 254, 254, 128]],
    [[254, 254, 254, 255], [254, 254, 254, 255], [0, 0, 0, 255]],
]
# The passes of Adam7 that a 3 x 2 picture has: 1, 4, 6 and 7.
INTERLACED_ROWS = bytes([0, 0]) + bytes([0, 205]) + bytes([0, 254]) + b"\0" + PIXELS[3:]

READABLE = [
    ("I3-trailing-bytes", PGM + b"\nbye", "nav2", DRAWING),
    ("I4-crlf-header-only", b"P5\r\n3 2\r\n255\r\n" + PIXELS, "nav2", DRAWING),
    ("I5-comments-everywhere", b"P5 # a\n#b\n3# c\n\n#\n2 #d\n#e\n255\n" + PIXELS, "nav2", DRAWING),
    ("I5-comment-behind-the-magic", b"P5#a\n3 2\n255\n" + PIXELS, "nav2", DRAWING),
    ("I5-comment-at-the-end", b"P5\n3 2\n255# end\n" + PIXELS, "nav2", DRAWING),
    ("I5-carriage-returns", b"P5\r# a\r3 2\r255\r" + PIXELS, "nav2", DRAWING),
    ("I5-lone-cr-and-pixel-of-10", b"P5\n3 2\n255\r\n" + PIXELS[1:], "nav2", "#.?\n..#"),
    ("I5-first-pixels-like-a-comment", b"P5\n3 2\n255\n##" + PIXELS[2:], "nav2", "##?\n..#"),
    ("I5-plain-with-comments", b"P2 3 2 255\n0 254 # no 7\n205 254\n254 0", "nav2", DRAWING),
    ("I6-one-row", b"P5\n6 1\n255\n" + PIXELS, "nav2", "#.?..#"),
    ("I6-one-column", b"P5\n1 6\n255\n" + PIXELS, "nav2", "#\n.\n?\n.\n.\n#"),
    ("I7-maxval-100", b"P5\n3 2\n100\n" + bytes([0, 100, 80, 100, 100, 0]), "nav2", DRAWING),
    ("I7-maxval-65535", b"P5\n3 2\n65535\n" + DEEP, "nav2", DRAWING),
    ("I7-plain-maxval-65535", b"P2\n3 2\n65535\n0 65535 52685 65535 65535 0", "nav2", DRAWING),
    ("I9-P1", b"P1\n3 2\n100\n001\n", "nav2", "#..\n..#"),
    ("I9-P4", b"P4\n3 2\n" + bytes([0b10000000, 0b00100000]), "nav2", "#..\n..#"),
    ("I9-P6-nav2-weighs-the-channels", b"P6\n3 2\n255\n" + COLOURS, "nav2", DRAWING),
    ("I9-P6-humble-takes-their-mean", b"P6\n3 2\n255\n" + COLOURS, "humble", "#.#\n..#"),
    ("I9-P6-ros1-takes-their-mean", b"P6\n3 2\n255\n" + COLOURS, "ros1", "#.#\n..#"),
    ("I9-P3", b"P3\n3 2\n255\n" + " ".join(map(str, COLOURS)).encode(), "nav2", DRAWING),
    ("I10-palette-has-colours-in-nav2", INDEXED, "nav2", DRAWING),
    ("I10-palette-is-indices-in-ros1", INDEXED, "ros1", "###\n###"),
    ("I10-grey-and-alpha", png(3, 2, 8, 4, ALPHA_ROWS), "nav2", DRAWING),
    ("I10-colour-and-alpha", encoded(np.array(COLOUR_ALPHA, np.uint8), "PNG"), "nav2", DRAWING),
    ("I10-1-bit", png(3, 2, 1, 0, bytes([0, 0b01000000, 0, 0b11000000])), "nav2", "#.#\n..#"),
    ("I10-16-bit", png(3, 2, 16, 0, b"\0" + DEEP[:6] + b"\0" + DEEP[6:]), "nav2", DRAWING),
    ("I10-interlaced", png(3, 2, 8, 0, INTERLACED_ROWS, interlaced=1), "nav2", DRAWING),
    ("I10-gamma", png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"gAMA", b"\0\0\xb1\x8f")),
     "nav2", DRAWING),
    ("I10-damaged-icc-profile",
     png(3, 2, 8, 0, GREY_ROWS, before_data=png_chunk(b"iCCP", b"p\0\0junk")), "nav2", DRAWING),
    ("I11-exif-rotation", encoded(np.array([[0, 254, 205], [254, 254, 0]], np.uint8), "PNG",
     exif=b"Exif\0\0MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"), "nav2", DRAWING),
    ("I15-one-tiff-page", tiff(), "nav2", DRAWING),
]  # fmt: skip


@pytest.mark.parametrize(
    ("image", "dialect", "drawing"), [pytest.param(*case, id=row) for row, *case in READABLE]
)
def test_an_odd_image_is_read_for_what_it_holds(write_map, read_cells, image, dialect, drawing):
    write_map(image)
    assert read_cells("--dialect", dialect)[0] == cells(drawing).tolist()


def test_a_header_with_dos_line_ends_is_warned_of_i4(write_map, read_cells):
    write_map(b"P5\r\n3 2\r\n255\r\n" + PIXELS)
    _, warned = read_cells()
    assert len(warned) == 1
    assert "m.pgm" in warned[0]


def test_a_jpeg_named_pgm_is_read_with_a_warning_i12(write_map, read_cells):
    write_map(encoded(np.full((2, 3), 255, np.uint8), "JPEG"))
    occupancy, warned = read_cells()
    assert occupancy == [[0, 0, 0], [0, 0, 0]]
    assert any("lossy" in line for line in warned)


def test_a_tiff_with_a_bad_tag_says_so_in_lines_of_ours_i11(write_map, command):
    write_map(tiff(bad_tag=True))
    code, _, err = command("info", "m.yaml")
    assert code in (0, 3)
    assert all(line.startswith(("error: ", "hint: ", "warning: ")) for line in err.splitlines())


def test_a_damaged_compressed_tiff_has_one_line_on_the_real_stderr_i11(write_map, folder):
    # The decoder writes to the process's stderr behind Python's back.
    image = encoded(np.arange(35, dtype=np.uint8).reshape(5, 7), "TIFF",
                    compression="tiff_adobe_deflate")  # fmt: skip
    start = image.index(b"\x78")
    write_map(image[: start + 2] + b"\xff" * 12 + image[start + 14 :])
    words = [sys.executable, "-m", "mapdeal", "info", "m.yaml"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.startswith("error: m.pgm: ")
    assert len(done.stderr.splitlines()) == 1
