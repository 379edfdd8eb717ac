"""JPEG images, read by Pillow."""

from __future__ import annotations

import io
from pathlib import Path

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.jpeg_scans import check_scans
from mapdeal.formats.images.memory import claim_pixels
from mapdeal.formats.images.pillow import load, open_image, picture_of, size_by_pillow, warn
from mapdeal.formats.picture import Picture


def read_jpeg(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a JPEG file, see `ImageFormat.read`.

    Warns
    -----
    MapdealWarning
        Always: compression moves greys.
    """
    with open_image(io.BytesIO(data), "JPEG", path, max_cells) as image:
        claim_pixels(image, data, path, is_decoded_twice=True)
        load(image, path)
        check_scans(data, path, image)
        text = "JPEG is lossy: greys may have moved across the thresholds"
        warn(path, text, "image.lossy")
        return picture_of(image, "JPEG", path)


JPEG = ImageFormat(
    name="JPEG",
    suffixes=(".jpg", ".jpeg"),
    recognises=lambda head: head.startswith(b"\xff\xd8\xff"),
    read=read_jpeg,
    size=size_by_pillow("JPEG"),
    size_is_in_head=False,
)
