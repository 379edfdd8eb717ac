"""Pictures in memory of every kind that readers distinguish, and PNG files by hand."""

import struct
import zlib
from dataclasses import replace

import numpy as np

from mapdeal.maps.images import open_image
from mapdeal.maps.picture import Picture

SHAPE = (11, 13)
PALETTE = np.array([[k, k, k, 255] for k in range(256)], np.uint8)
PALETTE[[100, 101, 128]] = [[205, 205, 205, 255], [205, 204, 205, 255], [0, 9, 0, 9]]


def picture_of_each_kind(values):
    """One of each kind, of some values up to 255: grey for the most part, and opaque."""
    rng = np.random.default_rng(11)

    def greys(factor=1.0):
        samples = rng.choice(values, SHAPE) * factor
        return samples.astype(np.uint8 if factor <= 1 else np.uint16)

    def rgb(*factor):
        colours = np.repeat(greys(*factor)[..., np.newaxis], 3, axis=2)
        colours[2:4, 1:7, 2] //= 3
        return colours

    def opacity(full=255):
        some = rng.choice(np.array([0, full // 3, full - 1, full, full, full, full]), SHAPE)
        return {"alpha": some.astype(np.uint8 if full < 256 else np.uint16), "maxval": full}

    return {
        "grey": Picture("PNM", "grey", greys()),
        "16 bit": Picture("PNG", "grey", greys(257), maxval=65535),
        "16 bit beside the grey": Picture("PNG", "grey", greys(256), maxval=65535),
        "10 bit": Picture("PNM", "grey", greys(4), maxval=1023),
        "low maxval": Picture("PNM", "grey", greys(1 / 5), maxval=51),
        "grey, opacity": Picture("PNG", "grey", greys(), **opacity()),
        "grey, key": Picture("PNG", "grey", greys(), **opacity(), alpha_from="key"),
        "wide grey, opacity": Picture("PNG", "grey", greys(257), **opacity(65535)),
        "rgb": Picture("PNG", "rgb", rgb()),
        "rgba": Picture("PNG", "rgb", rgb(), **opacity()),
        "rgb, key": Picture("PNG", "rgb", rgb(), **opacity(), alpha_from="key"),
        "10 bit rgb": Picture("PNM", "rgb", rgb(3.9), maxval=999),
        "rgb, low maxval": Picture("PNM", "rgb", rgb(1 / 17), maxval=15),
        "wide rgba": Picture("PNG", "rgb", rgb(257), **opacity(65535)),
        "see-through": Picture("PNG", "rgb", rgb(), alpha=np.zeros(SHAPE, np.uint8)),
        "palette": Picture("PNG", "palette", greys(), palette=PALETTE),
        "tiff": Picture("TIFF", "grey", greys()),
        "tiff, rgba": Picture("TIFF", "rgb", rgb(), **opacity()),
        "bmp": Picture("BMP", "rgb", rgb()),
    }


def joined(strips):
    parts = list(strips.pictures())
    alpha = parts[0].alpha
    if alpha is not None:
        alpha = np.concatenate([part.alpha for part in parts])
    return replace(parts[0], samples=np.concatenate([p.samples for p in parts]), alpha=alpha)


def read_image(path, **options):
    with open_image(path, **options) as image, image.strips() as strips:
        return joined(strips)


SIGNATURE = b"\x89PNG\r\n\x1a\n"
PASSES = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
          (0, 1, 1, 2)]  # fmt: skip


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def file_of(width, height, *chunks, depth=8, colour_type=0, interlaced=0):
    """The chunks stand between the header and the end."""
    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, interlaced)
    return SIGNATURE + chunk(b"IHDR", header) + b"".join(chunks) + chunk(b"IEND", b"")


def pixels_in(data):
    """The uncompressed pixels of a PNG, whose checksum must be right."""
    at, stream = len(SIGNATURE), b""
    while at < len(data):
        (length, name), body = struct.unpack_from(">I4s", data, at), at + 8
        stream += data[body : body + length] if name == b"IDAT" else b""
        at = body + length + 4
    return zlib.decompress(stream)


def adam7(pixels):
    """An interlaced PNG of grey pixels."""
    parts = [part for col, row, *step in PASSES for part in pixels[row :: step[1], col :: step[0]]]
    rows = b"".join(b"\0" + part.tobytes() for part in parts if part.size)
    height, width = pixels.shape
    return file_of(width, height, chunk(b"IDAT", zlib.compress(rows, 1)), interlaced=1)
