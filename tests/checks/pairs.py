"""A small valid map_server pair with optional changes."""

import io

import numpy as np
from PIL import Image

from bad_maps import yaml_text

ROOM = np.full((12, 15), 205, np.uint8)
ROOM[1:-1, 1:-1] = 0
ROOM[2:-2, 2:-2] = 254


def pgm(pixels, *, comment="", maxval=255, newline=b"\n"):
    height, width = pixels.shape
    note = f"# {comment}".encode() + newline if comment else b""
    sizes = b"%d %d" % (width, height) + newline + b"%d" % maxval + newline
    return b"P5" + newline + note + sizes + pixels.tobytes()


def png(pixels, **options):
    file = io.BytesIO()
    image = pixels if isinstance(pixels, Image.Image) else Image.fromarray(pixels)
    image.save(file, "PNG", **options)
    return file.getvalue()


def painted(row, col, value):
    pixels = ROOM.copy()
    pixels[row, col] = value
    return pixels


def good_yaml(**changes):
    return yaml_text(**{"origin": "[-1.5, 2.0, 0.0]", **changes})


def write_pair(folder, image=None, *, name="m.pgm", text=None, **changes):
    """Write m.yaml, with changed keys or another text, and an image given as bytes or pixels."""
    data = ROOM if image is None else image
    if not isinstance(data, bytes):
        data = png(data) if name.endswith("png") else pgm(data)
    (folder / name).write_bytes(data)
    path = folder / "m.yaml"
    path.write_text(good_yaml(**{"image": name, **changes}) if text is None else text)
    return path
