"""What Pillow raises and changes in the process stays behind one boundary."""

import io
import os
import struct
import threading
import warnings
import zlib

import numpy as np
import pytest
from PIL import Image

from mapdeal import FileAccessError, MalformedInputError
from mapdeal.maps import images as pillow_images
from mapdeal.maps.images import read_image, read_image_size
from maps.pngs import adam7

PIXELS = np.array([[0, 128, 254, 254, 254], [254, 0, 128, 0, 254]], dtype=np.uint8)
FORMATS = [("PNG", {}), ("BMP", {}), ("TIFF", {}), ("TIFF", {"compression": "tiff_lzw"}),
           ("TIFF", {"compression": "jpeg"}), ("JPEG", {})]  # fmt: skip
RAISED = [
    OSError("broken data stream"), SyntaxError("not this"), EOFError("ended"), KeyError(273),
    LookupError("unknown encoding"), TypeError("NoneType"), AttributeError("NoneType"),
    ValueError("bad size"), UnicodeDecodeError("ascii", b"\xff", 0, 1, "not in range"),
    OverflowError("too large"), AssertionError(), RuntimeError("no decoder"), RecursionError(),
    MemoryError(), struct.error("unpack requires 4 bytes"), zlib.error("Error -3"),
    Image.DecompressionBombError("too many pixels"), ZeroDivisionError("by zero"),
]  # fmt: skip

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


@pytest.fixture(params=FORMATS, ids=lambda kind: "-".join([kind[0], *kind[1].values()]))
def path(tmp_path, request):
    name, options = request.param
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, name, **options)
    path = tmp_path / "m.image"
    path.write_bytes(file.getvalue())
    return path


@pytest.mark.slow
@pytest.mark.parametrize("raised", RAISED, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("at", ["open", "load"])
def test_whatever_pillow_raises_is_one_line_about_the_file(
    path, monkeypatch, capfd, raised, at
):  # fmt: skip
    def fail(*_args, **_options):
        raise raised

    if at == "open":
        monkeypatch.setattr(Image, "open", fail)
    else:
        if path.read_bytes().startswith(b"\x89PNG"):  # Pillow is to load it
            path.write_bytes(adam7(PIXELS))
        monkeypatch.setattr(Image.Image, "load", fail)
    with pytest.raises(MalformedInputError) as caught:
        read_image(path)
    assert str(caught.value).startswith(f"{path}: the image is damaged: ")
    assert len(str(caught.value)) > len(f"{path}: the image is damaged: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_trouble_of_the_disk_is_no_damage(path, monkeypatch):
    def fail(*_args, **_options):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Image, "open", fail)
    for read in (read_image, read_image_size):
        with pytest.raises(FileAccessError, match=r"cannot be read: Input/output error"):
            read(path)


def test_pillows_own_limit_does_not_count_and_is_kept(path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        assert read_image(path).shape == read_image_size(path) == PIXELS.shape
    assert Image.MAX_IMAGE_PIXELS == 3


def state_of_the_process():
    return Image.MAX_IMAGE_PIXELS, list(warnings.filters), os.fstat(2)


def test_many_threads_read_the_same_and_leave_the_process_as_it_was(path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pillow_images.damage_refused(path):
            warnings.warn("from elsewhere", UserWarning, stacklevel=1)
    assert [str(one.message) for one in caught] == ["from elsewhere"]
    before = state_of_the_process()
    found, expected = [], read_image(path).samples

    def read():
        found.extend(np.array_equal(read_image(path).samples, expected) for _ in range(5))

    threads = [threading.Thread(target=read) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert found == [True] * 40
    assert state_of_the_process() == before


@pytest.mark.slow
def test_only_one_thread_at_once_changes_the_process(path):
    inside, leave, second_is_inside = threading.Event(), threading.Event(), threading.Event()

    def first():
        with pillow_images.damage_refused(path):
            inside.set()
            leave.wait(60)

    def second():
        inside.wait(60)
        with pillow_images.damage_refused(path):
            second_is_inside.set()

    threads = [threading.Thread(target=target) for target in (first, second)]
    for thread in threads:
        thread.start()
    assert inside.wait(60)
    assert not second_is_inside.wait(0.1)
    leave.set()
    for thread in threads:
        thread.join(60)
    assert second_is_inside.is_set()


def test_a_tiff_is_read_without_a_standard_error(tmp_path):
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, "TIFF", compression="tiff_lzw")
    (tmp_path / "m.tif").write_bytes(file.getvalue())
    saved = os.dup(2)
    try:
        os.close(2)
        assert np.array_equal(read_image(tmp_path / "m.tif").samples, PIXELS)
        with pytest.raises(OSError, match="descriptor"):
            os.fstat(2)
    finally:
        os.dup2(saved, 2)
        os.close(saved)
