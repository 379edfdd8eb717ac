"""What Pillow raises and changes in the process stays behind one boundary."""

import os
import struct
import warnings
import zlib
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from mapdeal import FileAccessError, MalformedInputError
from mapdeal.maps import images as pillow_images
from mapdeal.maps.images import read_image_size
from maps.pictures import adam7, read_image

PIXELS = np.array([[0, 128, 254, 254, 254], [254, 0, 128, 0, 254]], dtype=np.uint8)
FORMATS = [("PNG", {}), ("BMP", {}), ("TIFF", {}), ("TIFF", {"compression": "tiff_lzw"}),
           ("TIFF", {"compression": "jpeg"}), ("JPEG", {})]  # fmt: skip
RAISED = [
    OSError("broken data stream"), SyntaxError("not this"), EOFError("ended"), KeyError(273),
    LookupError("unknown encoding"), TypeError("NoneType"), AttributeError("NoneType"),
    ValueError("bad size"), OverflowError("too large"), AssertionError(), RuntimeError("gone"),
    MemoryError(), struct.error("unpack requires 4 bytes"), zlib.error("Error -3"),
    Image.DecompressionBombError("too many pixels"), ZeroDivisionError("by zero"),
]  # fmt: skip

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


@pytest.fixture
def path(tmp_path):
    return saved(tmp_path / "m.tif", "TIFF", compression="tiff_lzw")


def saved(path, name, **options):
    Image.fromarray(PIXELS).save(path, name, **options)
    return path


@pytest.fixture(params=FORMATS, ids=lambda kind: "-".join([kind[0], *kind[1].values()]))
def every_path(tmp_path, request):
    name, options = request.param
    return saved(tmp_path / "m.image", name, **options)


@pytest.mark.slow
@pytest.mark.parametrize("raised", RAISED, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("at", ["open", "load"])
@pytest.mark.parametrize("kind", ["tif", "interlaced png"])
def test_whatever_pillow_raises_is_one_line(path, monkeypatch, capfd, raised, at, kind):
    if kind == "interlaced png":
        path.write_bytes(adam7(PIXELS))

    def fail(*_, **__):
        os.write(2, b"a message of libtiff" * ((kind, at) == ("tif", "load")))
        raise raised

    monkeypatch.setattr(Image if at == "open" else Image.Image, at, fail)
    with pytest.raises(MalformedInputError) as caught:
        read_image(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: the image is damaged: ")
    assert line.rpartition(": ")[2]
    assert "\n" not in line
    assert capfd.readouterr() == ("", "")


def test_trouble_of_the_disk_is_no_damage(path, monkeypatch):
    monkeypatch.setattr(Image, "open", Mock(side_effect=OSError(5, "Input/output error")))
    for read in (read_image, read_image_size):
        with pytest.raises(FileAccessError, match=r"cannot be read: Input/output error"):
            read(path)


def test_pillows_own_limit_does_not_count_and_is_kept(every_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        assert read_image(every_path).shape == read_image_size(every_path) == PIXELS.shape
    assert Image.MAX_IMAGE_PIXELS == 3


def state_of_the_process():
    return Image.MAX_IMAGE_PIXELS, list(warnings.filters), os.fstat(2)


def test_warnings_from_elsewhere_pass(path):
    with pytest.warns(UserWarning, match="from elsewhere"), pillow_images.damage_refused(path):
        warnings.warn("from elsewhere", UserWarning, stacklevel=1)


def test_many_threads_read_the_same_and_leave_the_process_as_it_was(every_path):
    before, expected = state_of_the_process(), read_image(every_path).samples
    with ThreadPoolExecutor(8) as pool:
        found = [picture.samples for picture in pool.map(read_image, [every_path] * 40)]
    assert all(np.array_equal(samples, expected) for samples in found)
    assert state_of_the_process() == before


def test_a_tiff_is_read_without_a_standard_error(path):
    terminal = os.dup(2)
    try:
        os.close(2)
        assert np.array_equal(read_image(path).samples, PIXELS)
        with pytest.raises(OSError, match="descriptor"):
            os.fstat(2)
    finally:
        os.dup2(terminal, 2)
        os.close(terminal)
