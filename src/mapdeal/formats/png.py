"""PNG files, written by Pillow from arrays."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

_COMPRESSION_LEVEL = 3


def write_grey_png(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    """Write 8-bit grey pixels, shape (H, W), row 0 in the north."""
    from PIL import Image

    Image.fromarray(pixels).save(file, format="PNG", compress_level=_COMPRESSION_LEVEL)


def write_rgba_png(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    """Write pixels with opacity, shape (H, W, 4), row 0 in the north."""
    from PIL import Image

    Image.fromarray(pixels).save(file, format="PNG", compress_level=_COMPRESSION_LEVEL)


def write_indexed_png(
    file: BinaryIO, indices: NDArray[np.uint8], palette: NDArray[np.uint8]
) -> None:
    """Write indices into a palette, shapes (H, W) and (256, 3), row 0 in the north."""
    from PIL import Image

    image = Image.fromarray(indices)
    image.putpalette(palette.tobytes())
    image.save(file, format="PNG", compress_level=_COMPRESSION_LEVEL)
