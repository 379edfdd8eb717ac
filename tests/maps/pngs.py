"""PNG files by hand."""

import struct
import zlib

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
    rows = b"".join(
        b"\0" + part.tobytes()
        for col, row, across, down in PASSES
        for part in pixels[row::down, col::across]
        if part.size
    )
    height, width = pixels.shape
    return file_of(width, height, chunk(b"IDAT", zlib.compress(rows, 1)), interlaced=1)
