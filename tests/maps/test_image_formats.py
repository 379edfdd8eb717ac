"""What holds for every image format that maps may have."""

import ast
import io
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drawn import cells
from mapdeal import FileAccessError, MalformedInputError, read_map
from mapdeal.maps.images import IMAGE_FORMATS, IMAGE_SUFFIXES, read_image, read_image_size
from mapdeal.maps.map_server import costs_of
from sources import MODULES, tree_of

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


def test_every_format_has_a_case():
    assert [name for name, *_ in CASES] == list(IMAGE_FORMATS)


def test_the_documentation_lists_every_format():
    page = (ROOT / "docs" / "formats.md").read_text()
    rows = re.findall(r"^\| (\w+) \| (`\.[^|]+) \| ([0-9e]+) \|", page, re.MULTILINE)
    listed = {name: (re.findall(r"`(.+?)`", endings), float(most)) for name, endings, most in rows}
    assert listed == {
        name: (list(entry.suffixes), entry.max_cells) for name, entry in IMAGE_FORMATS.items()
    }


def test_suffixes_are_of_one_format_each_and_lower_case():
    assert len(set(IMAGE_SUFFIXES)) == len(IMAGE_SUFFIXES)
    assert all(re.fullmatch(r"\.[a-z0-9]+", suffix) for suffix in IMAGE_SUFFIXES)


@every_case
def test_a_file_is_recognised_by_its_own_format_alone(name, encoded, tolerance):
    head = encoded(PIXELS)
    assert [entry.name for entry in IMAGE_FORMATS.values() if entry.recognises(head)] == [name]
    assert not IMAGE_FORMATS[name].recognises(b"")


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


@every_case
def test_a_map_has_the_cells_of_its_image(tmp_path, name, encoded, tolerance):
    (tmp_path / "m.image").write_bytes(encoded(PIXELS))
    (tmp_path / "m.yaml").write_text(YAML.format("m.image"))
    assert np.array_equal(read_map(tmp_path / "m.yaml").occupancy, cells(DRAWING))


@every_case
def test_a_file_cut_anywhere_is_refused_or_still_the_same_picture(
    tmp_path, name, encoded, tolerance
):
    path = tmp_path / "m.image"
    data = encoded(PIXELS)
    path.write_bytes(data)
    whole = read_image(path).samples
    refused = 0
    for end in range(len(data)):
        path.write_bytes(data[:end])
        try:
            assert np.array_equal(read_image(path).samples, whole), end
        except MalformedInputError as error:
            assert error.source == path
            refused += 1
    assert refused > len(data) // 2


@every_case
def test_max_cells_is_the_largest_size_that_is_read(tmp_path, name, encoded, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(encoded(PIXELS))
    for read in (read_image, read_image_size):
        read(path, max_cells=PIXELS.size)
        with pytest.raises(MalformedInputError, match="above the limit of 9") as caught:
            read(path, max_cells=PIXELS.size - 1)
        assert "--max-cells" in caught.value.hint


@every_case
def test_the_default_limit_is_the_formats_own(tmp_path, monkeypatch, name, encoded, tolerance):
    path = tmp_path / "m.image"
    path.write_bytes(encoded(PIXELS))
    entry = IMAGE_FORMATS[name]
    limits = []

    def watched(file, limit):
        limits.append(limit)
        return entry.open(file, limit)

    monkeypatch.setitem(IMAGE_FORMATS, name, replace(entry, open=watched))
    read_image(path)
    read_image_size(path)
    assert limits == [entry.max_cells] * 2


@pytest.mark.parametrize("suffix", [one for one in IMAGE_SUFFIXES if one != ".pbm"])
def test_an_image_alone_is_refused_by_its_name(tmp_path, suffix):
    (tmp_path / f"m{suffix}").write_bytes(b"")
    with pytest.raises(MalformedInputError, match="looks like an image"):
        read_map(tmp_path / f"m{suffix}")


def test_a_pbm_stands_for_the_yaml_beside_it(tmp_path):
    (tmp_path / "m.pbm").write_bytes(b"P4\n1 1\n\x00")
    with pytest.raises(FileAccessError, match=r"has no m\.yaml beside it"):
        read_map(tmp_path / "m.pbm")


@pytest.mark.parametrize("read", [read_image, read_image_size])
@pytest.mark.parametrize(
    "data",
    [
        pytest.param(b"GIF89a" + bytes(9), id="no signature that is known"),
        pytest.param(b"\x89PNG\r\n\x1a\n" + bytes(30), id="nothing but a signature"),
    ],
)
def test_a_file_of_another_format_is_refused_with_those_that_are_known(tmp_path, read, data):
    path = tmp_path / "m.pgm"
    path.write_bytes(data)
    with pytest.raises(MalformedInputError) as caught:
        read(path)
    known = "pgm, pbm, ppm, png, bmp, tiff"
    assert str(caught.value) == f"{path}: is not an image in a supported format: {known}"


def test_formats_that_the_code_names_are_listed():
    named = set()
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Compare) and getattr(node.left, "attr", "") == "file_format":
                named |= {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
    assert named
    assert named <= set(IMAGE_FORMATS)


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


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "I;16"])
def test_an_image_of_costs_has_one_grey_channel_of_8_bits(tmp_path, mode):
    pixels = {
        "L": np.array([[0, 254]], np.uint8), "LA": np.array([[[0, 255], [254, 9]]], np.uint8),
        "RGB": np.array([[[0, 0, 0], [254, 254, 1]]], np.uint8),
        "I;16": np.array([[0, 60_000]], np.uint16),
    }[mode]  # fmt: skip
    Image.fromarray(pixels).save(tmp_path / "c.png")
    picture = read_image(tmp_path / "c.png")
    if mode == "L":
        assert costs_of(picture, tmp_path / "c.png").tolist() == [[0, 254]]
        return
    with pytest.raises(MalformedInputError, match="one 8-bit grey channel"):
        costs_of(picture, tmp_path / "c.png")
