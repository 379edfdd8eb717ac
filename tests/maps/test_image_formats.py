"""What holds for every image format that maps may have."""

import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drawn import cells
from mapdeal import FileAccessError, MalformedInputError, read_map
from mapdeal.maps.images import IMAGE_FORMATS, IMAGE_SUFFIXES, read_image, read_image_size
from mapdeal.maps.map_server import costs_of

ROOT = Path(__file__).parents[2]
PIXELS = np.array([[0, 128, 254, 254, 254], [254, 0, 128, 0, 254]], dtype=np.uint8)
DRAWING = "#?...\n.#?#."
YAML = (
    "image: {}\nresolution: 0.25\norigin: [1.5, -2.0, 0.4]\nnegate: 0\noccupied_thresh: 0.65\n"
    "free_thresh: 0.196\n"
)


def pgm(pixels):
    height, width = pixels.shape
    return b"P5\n# by hand\n%d %d\n255\n" % (width, height) + pixels.tobytes()


def by_pillow(name, **options):
    def encoded(pixels):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, name, **options)
        return file.getvalue()

    return encoded


# Format, how an array of 8-bit greys becomes a file of it, and by how much decoding may differ.
CASES = [
    ("PNM", pgm, 0),
    ("PNG", by_pillow("PNG"), 0),
    ("BMP", by_pillow("BMP"), 0),
    ("TIFF", by_pillow("TIFF"), 0),
    ("JPEG", by_pillow("JPEG", quality=100), 2),
]

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]
every_case = pytest.mark.parametrize(
    ("name", "encoded", "tolerance"), [pytest.param(*case, id=case[0]) for case in CASES]
)


def test_the_documentation_lists_every_format():
    page = (ROOT / "docs" / "formats.md").read_text()
    rows = re.findall(r"^\| (\w+) \| (`\.[^|]+) \| ([0-9e]+) \|", page, re.MULTILINE)
    listed = {name: (re.findall(r"`(.+?)`", endings), float(most)) for name, endings, most in rows}
    assert listed == {
        name: (list(entry.suffixes), entry.max_cells) for name, entry in IMAGE_FORMATS.items()
    }


@every_case
def test_a_picture_is_read_as_it_was_written_row_0_in_the_north(tmp_path, name, encoded, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(encoded(PIXELS))
    picture = read_image(path)
    assert (picture.file_format, picture.shape) == (name, PIXELS.shape)
    greys = picture.samples.reshape(*PIXELS.shape, -1) * (255 / picture.maxval)  # of each channel
    assert np.abs(greys - PIXELS[..., np.newaxis]).max() <= tolerance
    assert picture.alpha is None or picture.alpha.min() == picture.maxval
    assert read_image_size(path) == PIXELS.shape
    (tmp_path / "m.yaml").write_text(YAML.format("m.image"))
    assert np.array_equal(read_map(tmp_path / "m.yaml").occupancy, cells(DRAWING))


@every_case
def test_max_cells_is_the_largest_size_that_is_read(tmp_path, name, encoded, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(encoded(PIXELS))
    for read in (read_image, read_image_size):
        read(path, max_cells=PIXELS.size)
        with pytest.raises(MalformedInputError, match="above the limit of 9") as caught:
            read(path, max_cells=PIXELS.size - 1)
        assert "--max-cells" in caught.value.hint


def test_an_image_alone_is_refused_by_its_name(tmp_path):
    for suffix in IMAGE_SUFFIXES:
        if suffix != ".pbm":
            (tmp_path / f"m{suffix}").write_bytes(b"")
            with pytest.raises(MalformedInputError, match="looks like an image"):
                read_map(tmp_path / f"m{suffix}")


def test_a_pbm_stands_for_the_yaml_beside_it(tmp_path):
    (tmp_path / "m.pbm").write_bytes(b"P4\n1 1\n\x00")
    with pytest.raises(FileAccessError, match=r"has no m\.yaml beside it"):
        read_map(tmp_path / "m.pbm")


@pytest.mark.parametrize("read", [read_image, read_image_size])
@pytest.mark.parametrize("data", [b"GIF89a" + bytes(9), b"\x89PNG\r\n\x1a\n" + bytes(30)])
def test_a_file_of_another_format_is_refused_with_those_that_are_known(tmp_path, read, data):
    (tmp_path / "m.pgm").write_bytes(data)
    known = "is not an image in a supported format: pgm, pbm, ppm, png, bmp, tiff"
    with pytest.raises(MalformedInputError, match=known):
        read(tmp_path / "m.pgm")


def test_pillow_is_not_loaded_for_pnm(tmp_path):
    (tmp_path / "m.pgm").write_bytes(pgm(PIXELS))
    (tmp_path / "m.yaml").write_text(YAML.format("m.pgm"))
    code = (
        "import sys, mapdeal; mapdeal.read_map('m.yaml'); "
        "print([m for m in sys.modules if m.split('.')[0] == 'PIL'])"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


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
