"""Common code of the formats that Pillow decodes.

Pillow is imported by the functions that need it: most maps are PNM.
"""

from __future__ import annotations

import logging
import struct
import threading
import warnings
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, emit_warning
from mapdeal.formats.images.image_format import OtherContentsError
from mapdeal.formats.picture import Picture, check_size
from mapdeal.formats.strips import Strips, rows_of_strip

_EXIF_ORIENTATION = 0x0112
_COMPARED_TOGETHER = 1 << 20  # pixels
_PILLOW_LOG = logging.NullHandler()

# Pillow's limit, the filters of warnings and the terminal that libtiff writes to belong to the
# whole process: two threads that put them aside and back at once would leave them aside.
_LOCK = threading.RLock()
_OF_PILLOW = r"PIL\.|mapdeal\.formats\.images\.pillow$"

_DAMAGE = (
    OSError,  # Pillow's own word for data that end early or cannot be decoded
    SyntaxError,  # and for headers that break their format's rules
    EOFError,  # a header without the frame that it announces
    LookupError,  # tables that are shorter than others say, tags that are not there
    TypeError,  # tags of another type than theirs, None for what is missing
    AttributeError,  # the same, where the missing is asked for more
    ValueError,  # numbers out of range; text that is no text (UnicodeDecodeError)
    ArithmeticError,  # numbers too large for C; rationals over 0; images 0 bytes wide
    AssertionError,  # what Pillow takes for granted of files
    RuntimeError,  # decoders that cannot be set up; directories nested without end
    MemoryError,  # lengths that a file claims and nobody has
    struct.error,  # records that end early
    zlib.error,  # compressed text and profiles
)
"""All that Pillow's readers raise on bytes that are no image."""


def open_image(file: BinaryIO, name: str, path: Path, max_cells: int) -> Any:
    """Return Pillow's image of a file, its header read and checked, its pixels not yet decoded."""
    from PIL import Image, UnidentifiedImageError

    with damage_refused(path):
        try:
            image = Image.open(file, formats=(name,))
        except UnidentifiedImageError:
            raise OtherContentsError from None
        frames = getattr(image, "n_frames", 1)
    check_size(path, image.width, image.height, max_cells)
    if frames > 1:
        raise MalformedInputError("holds more than one picture", source=path)
    return image


def load(image: Any, path: Path, *, around: AbstractContextManager[None] | None = None) -> None:
    """Decode the pixels of an image, within a context if one is given."""
    with damage_refused(path), around or nullcontext():
        image.load()
        orientation = image.getexif().get(_EXIF_ORIENTATION, 1)
    if orientation != 1:
        warn(path, "the EXIF orientation was not applied, as in ROS", "image.orientation")


def strips_of_image(image: Any, to_picture: Callable[[Any], Picture]) -> Strips:
    """Return the strips of a decoded image, which are copied out of Pillow's memory one by one."""
    width, height = image.width, image.height
    step = rows_of_strip(width, 4 * width)

    def parts() -> Iterator[Picture]:
        for top in range(0, height, step):
            yield to_picture(image.crop((0, top, width, min(top + step, height))))

    return Strips((height, width), parts)


def size_by_pillow(name: str) -> Callable[[bytes, Path, int], tuple[int, int]]:
    """Return the `size` function of a format that Pillow reads."""

    def size(_head: bytes, path: Path, max_cells: int) -> tuple[int, int]:
        try:
            with path.open("rb") as file, open_image(file, name, path, max_cells) as image:
                return image.height, image.width
        except OSError as error:
            rule = f"cannot be read: {error.strerror or error}"
            raise FileAccessError(rule, source=path) from None

    return size


def picture_of(image: Any, name: str, path: Path) -> Picture:
    """Return the samples of a decoded image."""
    mode = image.mode
    if mode == "1":
        return Picture(name, "grey", np.asarray(image, dtype=np.uint8) * np.uint8(255))
    if mode == "L":
        return Picture(name, "grey", np.asarray(image))
    if mode.startswith("I;16"):
        return wide_grey(image, name)
    if mode == "P":
        return Picture(name, "palette", np.asarray(image), palette=_palette(image))
    if mode == "RGB":
        return Picture(name, "rgb", np.asarray(image))
    if mode == "LA":
        return grey_and_alpha(image, name)
    if mode == "RGBA":
        pixels = np.asarray(image)
        return Picture(name, "rgb", pixels[..., :3], alpha=pixels[..., 3])
    raise MalformedInputError("pixels of this kind make no map", source=path, got=mode)


def wide_grey(image: Any, name: str) -> Picture:
    """Return the 16-bit samples of a grey image."""
    return Picture(name, "grey", np.asarray(image).astype(np.uint16), maxval=65535)


def grey_and_alpha(image: Any, name: str) -> Picture:
    """Return the first and the last channel of an image as brightness and opacity."""
    pixels = np.asarray(image)
    return Picture(name, "grey", pixels[..., 0], alpha=pixels[..., -1])


def have_same_pixels(one: Any, other: Any) -> bool:
    """Return whether two decoded images are equal; looks at some rows at a time."""
    if (one.mode, one.size) != (other.mode, other.size):
        return False
    height = max(1, _COMPARED_TOGETHER // one.width)
    boxes = ((0, top, one.width, min(top + height, one.height))
             for top in range(0, one.height, height))  # fmt: skip
    return all(one.crop(box).tobytes() == other.crop(box).tobytes() for box in boxes)


def warn(path: Path, text: str, check: str) -> None:
    """Warn of a file, in the name of a check of lint."""
    emit_warning(MapdealWarning(f"{path}: {text}", check), stacklevel=4)


def _palette(image: Any) -> NDArray[np.uint8]:
    """Return red, green, blue, opacity of all 256 indices; those not defined are black."""
    colours = np.array(image.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), dtype=np.uint8)
    table[:, 3] = 255
    table[: len(colours), :3] = colours
    return table


def one_at_a_time() -> AbstractContextManager[Any]:
    """Return a context that one thread at a time is in."""
    return _LOCK


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Turn whatever damage leads Pillow's readers to into one clear error.

    Around calls of Pillow alone: in code of ours the same exceptions are bugs.
    """
    from PIL import Image, UnidentifiedImageError

    # Pillow warns of odd tags and logs what it cannot decode; neither decides anything here.
    logging.getLogger("PIL").addHandler(_PILLOW_LOG)
    try:
        with one_at_a_time(), _no_size_limit(), warnings.catch_warnings():
            # by module: warnings of other threads must pass
            warnings.filterwarnings("ignore", module=_OF_PILLOW)
            yield
    except (*_DAMAGE, Image.DecompressionBombError) as error:  # if others set the limit meanwhile
        if isinstance(error, OSError) and error.errno is not None:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None
        told = str(error) or type(error).__name__
        if isinstance(error, UnidentifiedImageError):  # it names an address in memory
            told = "a part of it is not an image"
        raise MalformedInputError(f"the image is damaged: {told}", source=path) from None


@contextmanager
def _no_size_limit() -> Iterator[None]:
    """Put Pillow's own, lower limit aside: ours is checked before anything is decoded."""
    from PIL import Image

    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = before
