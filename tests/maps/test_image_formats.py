import io
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bad_maps import yaml_text
from drawn import cells
from mapdeal import MalformedInputError, read_map
from mapdeal.maps import picture as strips
from mapdeal.maps.images import IMAGE_FORMATS, IMAGE_SUFFIXES, read_image_size
from mapdeal.maps.map_server import costs_of
from maps.pictures import read_image

ROOT = Path(__file__).parents[2]
DRAWING = "#?...\n.#?#."
HEIGHT, WIDTH = 7, 11
PIXELS = np.array([[0, 128, 254, 254, 254], [254, 0, 128, 0, 254]], dtype=np.uint8)


def by_pillow(name, **options):
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, name, **options)
    return file.getvalue()


# Format, a file of it, and by how much decoding may differ.
PGM = b"P5\n# by hand\n5 2\n255\n" + PIXELS.tobytes()
CASES = [
    ("PNM", PGM, 0), ("PNG", by_pillow("PNG"), 0), ("BMP", by_pillow("BMP"), 0),
    ("TIFF", by_pillow("TIFF"), 0), ("JPEG", by_pillow("JPEG", quality=100), 2),
]  # fmt: skip

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]
every_case = pytest.mark.parametrize(
    ("name", "data", "tolerance"), CASES, ids=[case[0] for case in CASES]
)


def test_the_documentation_lists_every_format():
    page = (ROOT / "docs" / "formats.md").read_text()
    rows = re.findall(r"^\| (\w+) \| (`\.[^|]+) \| ([0-9e]+) \|", page, re.MULTILINE)
    listed = [(name, re.findall(r"`(.+?)`", ends), float(most)) for name, ends, most in rows]
    formats = [(name, [*each.suffixes], each.max_cells) for name, each in IMAGE_FORMATS.items()]
    assert sorted(listed) == sorted(formats)


@every_case
def test_a_picture_is_read_as_it_was_written_row_0_in_the_north(tmp_path, name, data, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(data)
    picture = read_image(path)
    assert (picture.file_format, picture.shape) == (name, PIXELS.shape)
    greys = picture.samples.reshape(*PIXELS.shape, -1) * (255 / picture.maxval)  # of each channel
    assert np.abs(greys - PIXELS[..., np.newaxis]).max() <= tolerance
    assert picture.alpha is None or picture.alpha.min() == picture.maxval
    assert read_image_size(path) == PIXELS.shape
    (tmp_path / "m.yaml").write_text(yaml_text(image="m.image"))
    assert np.array_equal(read_map(tmp_path / "m.yaml").occupancy, cells(DRAWING))


@every_case
def test_max_cells_is_the_largest_size_that_is_read(tmp_path, name, data, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(data)
    for read in (read_image, read_image_size):
        read(path, max_cells=PIXELS.size)
        with pytest.raises(MalformedInputError, match="above the limit of 9") as caught:
            read(path, max_cells=PIXELS.size - 1)
        assert "--max-cells" in caught.value.hint


def test_a_blank_picture_expands_by_the_bits_of_its_samples(tmp_path, monkeypatch):
    monkeypatch.setattr("mapdeal.files.source._HARMLESS", 0)  # bytes that any file may expand to
    image = Image.new("P", (800, 800))
    image.putpalette([0] * 3 + [254] * 3)
    image.save(tmp_path / "m.png", bits=1)
    assert read_image(tmp_path / "m.png").shape == (800, 800)


@pytest.mark.parametrize("suffix", [suffix for suffix in IMAGE_SUFFIXES if suffix != ".pbm"])
def test_an_image_alone_is_refused_by_its_name(tmp_path, suffix):
    (tmp_path / f"m{suffix}").write_bytes(b"")
    with pytest.raises(MalformedInputError, match="looks like an image"):
        read_map(tmp_path / f"m{suffix}")


def test_pillow_is_not_loaded_for_pnm(tmp_path):
    (tmp_path / "m.pgm").write_bytes(PGM)
    (tmp_path / "m.yaml").write_text(yaml_text(image="m.pgm"))
    code = "import sys, mapdeal; mapdeal.read_map('m.yaml'); sys.exit('PIL' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


@pytest.mark.parametrize("pixels", [
    np.array([[[0, 255], [254, 9]]], np.uint8),
    np.array([[[0, 0, 0], [254, 254, 1]]], np.uint8),
    np.array([[0, 60_000]], np.uint16),
], ids=["LA", "RGB", "I;16"])  # fmt: skip
def test_an_image_of_costs_has_one_grey_channel_of_8_bits(tmp_path, pixels):
    path = tmp_path / "c.png"
    Image.fromarray(pixels).save(path)
    with pytest.raises(MalformedInputError, match="one 8-bit grey channel"):
        costs_of(read_image(path), path)
    Image.fromarray(np.array([[0, 254]], np.uint8)).save(path)
    assert costs_of(read_image(path), path).tolist() == [[0, 254]]


def bmp(bits, pixels, palette, *, is_top_down, gap):
    """The bytes of a file: indices, or blue, green, red and so on, row 0 in the north."""
    rows = [(np.packbits(row) if bits == 1 else row).tobytes() for row in pixels]
    rows = [row + bytes(-len(row) % 4) for row in rows]
    table = b"".join(bytes(entry) + b"\0" for entry in palette)
    height = -HEIGHT if is_top_down else HEIGHT
    header = struct.pack("<IiiHHIIiiII", 40, WIDTH, height, 1, bits, 0, 0, 0, 0, 0, 0)
    body = b"".join(rows if is_top_down else rows[::-1])
    start = 14 + len(header) + len(table) + gap
    first = struct.pack("<2sIHHI", b"BM", start + len(body), 0, 0, start)
    return first + header + table + bytes(gap) + body


@pytest.mark.parametrize("gap", [0, 6])
@pytest.mark.parametrize("is_top_down", [False, True])
@pytest.mark.parametrize("bits", [1, 8, 24, 32])
def test_pixels_of_a_bmp_are_those_that_were_written(tmp_path, monkeypatch, bits, is_top_down, gap):
    rng = np.random.default_rng(bits)
    count, channels = (1 << bits, 1) if bits <= 8 else (0, bits // 8)
    palette = rng.integers(0, 256, (count, 3)).astype(np.uint8)  # blue, green, red
    if bits == 1 and gap:  # which Pillow reads as a picture without a palette
        palette = np.uint8([[0] * 3, [255] * 3])
    pixels = rng.integers(0, count or 256, (HEIGHT, WIDTH, channels)).astype(np.uint8)
    expected = palette[pixels[..., 0]] if count else pixels
    path = tmp_path / "m.bmp"
    path.write_bytes(bmp(bits, pixels, palette, is_top_down=is_top_down, gap=gap))
    monkeypatch.setattr(strips, "STRIP", 3 * WIDTH * channels)
    picture = read_image(path)
    colours = picture.palette[picture.samples, :3] if count else picture.samples
    assert np.array_equal(colours, expected[..., 2::-1])
    if bits == 32:
        assert np.array_equal(picture.alpha, pixels[..., 3])
