"""Bad images and npz files: their refusals, and the maps that odd ones are read as."""

import io
import os
import struct
import subprocess
import sys
import zipfile
import zlib

import numpy as np
import pytest
from PIL import Image

from bad_maps import DRAWING, PGM, PIXELS, cells_of, named, write_map, yaml_text
from drawn import cells
from maps.pictures import chunk, file_of
from traced_memory import memory_below


def encoded(picture, image_format, **options):
    file = io.BytesIO()
    picture.save(file, image_format, **options)
    return file.getvalue()


ROWS = chunk(b"IDAT", zlib.compress(b"\0" + PIXELS[:3] + b"\0" + PIXELS[3:]))


def with_chunk(name, body):
    """A grey PNG with one chunk more before its pixels."""
    return file_of(3, 2, chunk(name, body), ROWS)


PAGE = Image.fromarray(np.array([[0, 254, 205], [254, 254, 0]], dtype=np.uint8))
HUGE_BMP = b"BM" + struct.pack("<IHHI", 70, 0, 0, 54) + struct.pack(
    "<IiiHHIIiiII", 40, 100_000, 100_000, 1, 8, 0, 0, 0, 0, 0, 0
)  # fmt: skip


BAD_IMAGES = [
    ("I2-zero-bytes", b"", "empty"),
    ("I2-html", b"<!DOCTYPE html>\n<html><body>404</body></html>\n", "image"),
    ("I2-lfs-pointer", b"version https://git-lfs.github.com/spec/v1\nsize 6\n", "Git LFS"),
    ("I3-truncated", PGM[:-1], "expected 6 bytes, got 5"),
    ("I4-crlf-in-pixels", b"P5\r\n3 2\r\n255\r\n\0\r\n" + PIXELS[2:], "CRLF-damaged"),
    ("I11-long-text", with_chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(5_000_000))), "m.pgm"),
    ("I11-animated", with_chunk(b"acTL", struct.pack(">II", 2, 0)), "m.pgm"),
    ("I15-two-tiff-pages", encoded(PAGE, "TIFF", save_all=True, append_images=[PAGE]),
     "more than one picture"),
]  # fmt: skip


@pytest.fixture
def image_refused(refused):
    """Return a function that checks that two commands refuse the image of m.yaml."""

    def check(exit_code, *named, hint="", options=()):
        for words in (["info", "m.yaml"], ["run", "m.yaml", "-o", "out"]):
            refused([*words, *options], exit_code, *named, hint=hint)

    return check


@pytest.fixture
def read_cells(folder, accepted):
    def read(image, **keys):
        write_map(folder, yaml_text(**keys), image)
        _, warned = accepted("convert", "m.yaml", "-o", "o.npz", "--force")
        return cells_of("o.npz"), warned

    return read


@pytest.mark.parametrize(("image", "place"), named(BAD_IMAGES))
def test_a_bad_image_is_refused(folder, image_refused, image, place):
    write_map(folder, image=image)
    image_refused(3, "m.pgm", place)


@pytest.mark.parametrize(("image", "size", "options"), [
    (b"P5\n30000 30000\n255\n", 99, []),
    (file_of(14_000, 14_000, ROWS), 99, []),
    (HUGE_BMP, 99, []),
    (b"P5\n20000 10000\n255\n", 200_000_019, ["--max-cells", "1000"]),
], ids=["pgm", "png", "bmp", "large file"])  # fmt: skip
def test_an_image_above_the_limit_is_refused_unread(folder, image_refused, image, size, options):
    write_map(folder, image=image)
    os.truncate(folder / "m.pgm", size)
    with memory_below(16_000_000):
        image_refused(3, "m.pgm", options=options)


@pytest.mark.parametrize(("make", "message"), [
    (lambda path: os.truncate(path, 1 << 40), ""),
    (lambda path: (path.unlink(), os.mkfifo(path)), "not a regular file"),
    (lambda path: (path.unlink(), path.symlink_to("/dev/zero")), "not a regular file"),
    (lambda path: (path.unlink(), path.mkdir()), "directory"),
], ids=["sparse tebibyte", "pipe", "device", "folder"])  # fmt: skip
def test_what_is_no_file_of_pixels_is_refused_unread(folder, image_refused, make, message):
    make(folder / "m.pgm")
    image_refused(4, "m.pgm", message)


@pytest.mark.parametrize("name", ["elsewhere.txt", "M.PGM", "m.png", "map.pgm"])
def test_a_missing_image_is_refused_with_the_nearest_names(folder, image_refused, name):
    (folder / "m.pgm").rename(folder / name)
    image_refused(4, "m.yaml", "m.pgm", hint="" if name.endswith("txt") else name)


ALPHA = Image.fromarray(np.uint8([[255, 255, 128], [255, 255, 255]]))
SEE_THROUGH = Image.merge("RGBA", [PAGE, PAGE, PAGE, ALPHA])
TURNED = b"Exif\0\0MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"
READABLE = [
    ("I5-first-pixels-like-a-comment", b"P5\n3 2\n255\n##" + PIXELS[2:], "##?\n..#"),
    ("I10-colour-and-alpha", encoded(SEE_THROUGH, "PNG"), DRAWING),
    ("I10-damaged-icc-profile", with_chunk(b"iCCP", b"p\0\0junk"), DRAWING),
    ("I11-exif-rotation", encoded(PAGE, "PNG", exif=TURNED), DRAWING),
]  # fmt: skip


@pytest.mark.parametrize(("image", "drawing"), named(READABLE))
def test_odd_images_are_read_as_their_pixels(read_cells, image, drawing):
    assert read_cells(image)[0] == cells(drawing).tolist()


def test_a_jpeg_named_pgm_is_warned_of(read_cells):
    occupancy, warned = read_cells(encoded(Image.new("L", (3, 2), 255), "JPEG"))
    assert occupancy == [[0, 0, 0], [0, 0, 0]]
    assert any("lossy" in line for line in warned)


def test_a_damaged_compressed_tiff_has_one_line_on_the_real_stderr(folder):
    # The decoder writes to the process's stderr behind Python's back.
    image = encoded(PAGE.resize((7, 5)), "TIFF", compression="tiff_adobe_deflate")
    start = image.index(b"\x78")
    write_map(folder, image=image[: start + 2] + b"\xff" * 12 + image[start + 14 :])
    words = [sys.executable, "-m", "mapdeal", "info", "m.yaml"]
    completed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert completed.returncode == 3
    assert completed.stderr.startswith("error: m.pgm: ")
    assert len(completed.stderr.splitlines()) == 1


def drawn_pgm(drawing):
    rows = drawing.split()
    pixels = bytes({"#": 0, ".": 254, "?": 205}[c] for c in "".join(rows))
    return f"P5\n{len(rows[0])} {len(rows)}\n255\n".encode() + pixels


@pytest.mark.parametrize("words", [
    "active m.yaml -o new/o.yaml --image p.png", "run m.yaml -o out --sim",
    "run m.yaml -o new/out --recipe design-sim",
])  # fmt: skip
def test_a_map_without_a_known_cell_has_no_active_region(folder, refused, words):
    write_map(folder, image=drawn_pgm("???\n???"))
    refused(words.split(), 3, "no active cells", "m.yaml")


def test_raw_values_above_100_are_unknown_and_counted(read_cells):
    pixels = bytes([0, 100, 101, 254, 255, 42])
    occupancy, warned = read_cells(b"P5\n3 2\n255\n" + pixels, mode="raw")
    assert occupancy == [[-1, -1, 42], [0, 100, -1]]
    assert any("m.pgm" in line and " 2 " in line for line in warned)


@pytest.mark.parametrize("drawing", ["...\n...", "###\n###", "???\n???", "#", "."])
def test_maps_of_one_kind_of_cell_and_the_smallest_ones(folder, accepted, drawing):
    write_map(folder, image=drawn_pgm(drawing))
    accepted("run", "m.yaml", "-o", "out")
    names = {path.name for path in (folder / "out" / "m").iterdir()}
    assert {"cost.pgm", "cost.png", "esdf.npz", "inflated.pgm", "manifest.json"} <= names


OCCUPANCY = np.array([[0, 0, 100], [100, 0, -1]], dtype=np.int8)
GEOMETRY = {"format": "mapdeal/1", "resolution": 0.05, "origin": [1.5, -2.0, 0.4]}
MAP = {**GEOMETRY, "occupancy": OCCUPANCY}
FIELD = {
    **MAP, "distance": np.ones((2, 3), np.float32), "convention": "fast-planner", "strength": 1.0,
    "max_distance": np.inf, "lethal_threshold": 100, "unknown": "free",
}  # fmt: skip
POTENTIAL = {
    **MAP, "repulsive": np.ones((2, 3)), "goal": [1.52, -1.98], "attractive_gain": 1.0,
    "repulsive_gain": 1.0, "repulsive_cap": 1e5,
}  # fmt: skip


def npy(value):
    """The bytes of one array of an npz; bytes are taken as they are."""
    if isinstance(value, bytes):
        return value
    file = io.BytesIO()
    np.save(file, value)
    return file.getvalue()


def npy_header(text):
    header = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def layer_header(shape, dtype="|i1"):
    return npy_header(f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}")


def write_npz(path, entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, value in entries.items():
            file.writestr(f"{name}.npy", npy(value))


BAD_ARRAYS = [
    ("object-layer", MAP, "occupancy", np.array([[None, 1]], dtype=object)),
    ("object-number", MAP, "resolution", np.array({"a": 1}, dtype=object)),
    ("format-of-bytes", MAP, "format", np.bytes_(b"mapdeal/1")),
    ("float-occupancy", MAP, "occupancy", OCCUPANCY.astype(float)),
    ("occupancy-above-100", MAP, "occupancy", OCCUPANCY + np.int8(1)),
    ("inf-origin", MAP, "origin", [np.inf, 0, 0]),
    ("nan-distance", FIELD, "distance", np.full((2, 3), np.nan, np.float32)),
    ("nan-in-a-known-cell", FIELD, "distance", np.float32([[np.nan, 1, 1], [np.nan, 1, 1]])),
    ("nan-threshold", FIELD, "lethal_threshold", np.nan),
    ("goal-of-three", POTENTIAL, "goal", np.zeros(3)),
    ("potential-without-gain", POTENTIAL, "repulsive_gain", None),
    ("nan-repulsive", POTENTIAL, "repulsive", np.full((2, 3), np.nan)),
    ("pebibyte-header", MAP, "occupancy", layer_header((1 << 25, 1 << 25)) + b"\0" * 6),
    ("overflowing-header", MAP, "occupancy", layer_header((1 << 70, 1)) + b"\0" * 6),
    ("negative-header", MAP, "occupancy", layer_header((-2, -3)) + b"\0" * 6),
    ("header-beyond-its-data", MAP, "occupancy", layer_header((2, 4)) + b"\0" * 6),
    ("header-of-brackets", MAP, "occupancy", npy_header("(" * 5000)),
    ("header-with-empty-type", MAP, "occupancy",
     npy_header("{'descr': (), 'fortran_order': False, 'shape': (2, 3), }") + b"\0" * 6),
    ("a-byte-too-many", MAP, "occupancy", layer_header((2, 3)) + bytes(7)),
    ("a-byte-too-few", MAP, "occupancy", layer_header((2, 3)) + bytes(5)),
    ("no-array", MAP, "occupancy", b"not an array"),
    ("empty-array-file", MAP, "format", b""),
]  # fmt: skip


@pytest.mark.parametrize(("entries", "name", "value"), named(BAD_ARRAYS))
def test_an_npz_with_a_bad_array_is_refused(folder, refused, entries, name, value):
    changed = {key: v for key, v in {**entries, name: value}.items() if v is not None}
    write_npz(folder / "n.npz", changed)
    refused(["info", "n.npz"], 3, "n.npz", name)


@pytest.mark.parametrize(("name", "head", "zeros"), [
    ("occupancy", layer_header((8192, 8192)), 1 << 26),
    ("resolution", layer_header((), "<U16777216"), 1 << 26),
    ("format", layer_header((), "<U16777216"), 1 << 26),
    ("occupancy", layer_header((30_000, 30_000)), 6),  # more than the entry has
], ids=["layer", "number", "text", "claim"])  # fmt: skip
def test_a_zip_bomb_is_refused_before_memory_is_taken(folder, refused, name, head, zeros):
    write_npz(folder / "n.npz", {**MAP, name: head + bytes(zeros)})
    with memory_below(16_000_000):
        refused(["info", "n.npz", "--max-cells", "1000000000"], 3, "n.npz", name)


@pytest.mark.parametrize("is_large", [False, True], ids=["zip", "zip64"])
def test_a_list_of_entries_that_is_long_is_not_read(folder, refused, is_large):
    """The list alone is what costs memory: entries of nothing, all at one place."""
    count, name = 70_000 if is_large else 20_000, b"a" * 40 + b".npy"
    facts = struct.pack("<HHHHHIIIHH", 20, 0, 0, 0, 33, 0, 0, 0, len(name), 0)
    local = b"PK\3\4" + facts + name
    directory = count * (b"PK\1\2\x14\0" + facts + bytes(14) + name)
    start, size, end = len(local), len(directory), b""
    if is_large:
        end += b"PK\6\6" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, count, count, size, start)
        end += b"PK\6\7" + struct.pack("<IQI", 0, start + size, 1)
        count, size, start = 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF
    end += b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, count, count, size, start, 0)
    (folder / "n.npz").write_bytes(local + directory + end)
    refused(["info", "n.npz"], 3, "n.npz", "too many arrays")
