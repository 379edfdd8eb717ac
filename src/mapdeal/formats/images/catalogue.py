"""The image formats that maps may have.

To add one, write a module with its `ImageFormat` and import that here.
"""

# ruff: noqa: F401 - what is imported is listed

from __future__ import annotations

from mapdeal.formats.images.image_format import ImageFormat

# Messages name formats in this order.
# isort: off
from mapdeal.formats.images.pnm import PNM
from mapdeal.formats.images.png import PNG
from mapdeal.formats.images.bmp import BMP
from mapdeal.formats.images.tiff import TIFF
from mapdeal.formats.images.jpeg import JPEG
# isort: on


def _by_name(imported: list[object]) -> dict[str, ImageFormat]:
    formats: dict[str, ImageFormat] = {}
    for entry in imported:
        if isinstance(entry, ImageFormat):
            if entry.name in formats:
                raise ValueError(f"two image formats are called {entry.name}")
            formats[entry.name] = entry
    return formats


IMAGE_FORMATS = _by_name(list(globals().values()))
"""The formats by name, in the order of their imports."""

IMAGE_SUFFIXES = tuple(suffix for entry in IMAGE_FORMATS.values() for suffix in entry.suffixes)
"""The endings of their file names."""


def recognised(head: bytes) -> ImageFormat | None:
    """Return the format of a file with these first bytes, None if it is none of the list."""
    return next((entry for entry in IMAGE_FORMATS.values() if entry.recognises(head)), None)
