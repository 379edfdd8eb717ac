"""Good files of every kind, a few cells each: what mutants are made of.

They lie in the folder ``seeds``, by kind; a new one is a new file there. They are small, and read
as bytes: their line ends and checksums matter.
"""

import gzip
import io
import json
import re
import struct
import warnings
import zipfile
import zlib
from pathlib import Path

import states

STORED = Path(__file__).with_name("seeds")

WIDTH, HEIGHT = 8, 6
_GREYS = (0, 205, 254, 128, 255, 100, 254)
PIXELS = bytes(_GREYS[(3 * row + 5 * col) % 7] for row in range(HEIGHT) for col in range(WIDTH))
"""The cells of most pictures, from the top."""

MAP_YAML = b"image: m.pgm\nresolution: 0.05\norigin: [-1.5, 2.0, 0.1]\nnegate: 0\n"
MAP_PGM = b"P5\n8 6\n255\n" + PIXELS


def files_of(folder, *names):
    """Return the files of a folder in the order of their names, or those that are named."""
    paths = [STORED / folder / name for name in names] or sorted((STORED / folder).iterdir())
    return [path.read_bytes() for path in paths]


def documents_of(folder):
    """Return the JSON documents of a folder by their names: what mapdeal itself writes."""
    paths = sorted((STORED / folder).iterdir())
    return {path.stem: json.loads(path.read_bytes()) for path in paths}


ANSWERS = documents_of("answers")


# Files around damaged parts, with checksums that are right: so damage gets further in.


def with_checksums(data):
    """Return a PNG with the checksums that its chunks should have."""
    text, at = bytearray(data), 8
    while at + 12 <= len(text):
        end = at + 8 + int.from_bytes(text[at : at + 4])
        if end + 4 > len(text):
            break
        struct.pack_into(">I", text, end, zlib.crc32(memoryview(text)[at + 4 : end]))
        at = end + 4
    return bytes(text)


def npy_members(file):
    """Return the members of an npz as one text that can be damaged: names, and bare bytes."""
    with zipfile.ZipFile(io.BytesIO(file)) as archive:
        return b"".join(b"\n@@%s@@\n" % name.encode() + archive.read(name)
                        for name in archive.namelist())  # fmt: skip


def zipped(text):
    """Return the zip file of such a text, whatever its names, of which two may be the same."""
    words, file = re.split(rb"\n@@([^@]*)@@\n", text), io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w") as archive:
        warnings.simplefilter("ignore")
        for name, body in zip(words[1::2], words[2::2], strict=True):
            archive.writestr(zipfile.ZipInfo(name.decode("latin-1")), body)
    return file.getvalue()


_BETWEEN = b"\n@@ message @@\n"


def messages_of(file):
    """Return the messages of a state of Cartographer as one text that can be damaged."""
    parts, at = [], 8
    while at < len(file):
        end = at + 8 + int.from_bytes(file[at : at + 8], "little")
        parts.append(gzip.decompress(file[at + 8 : end]))
        at = end
    return _BETWEEN.join(parts)


def as_state(text):
    blocks = map(gzipped, text.split(_BETWEEN))
    return states.MAGIC + b"".join(struct.pack("<Q", len(data)) + data for data in blocks)


def states_of_two():
    cells = states.random_cells(6, 5)
    graph = states.pose_graph({(0, 0): (1, 2, 0.3), (1, 0): (0, 0, -2)}, [(0, 1, 1, 1, 0)])
    box = (1, 1, 3, 4)
    submaps = (states.submap(cells, key=(k, 0), box=box, packed=bool(k)) for k in (0, 1))
    return states.state(graph, *submaps)


def gzipped(data):
    """Return a gzip file that stores data as they are: what compresses differs by version."""
    stored = struct.pack("<BHH", 1, len(data), 65535 - len(data)) + data
    check = struct.pack("<II", zlib.crc32(data), len(data))
    return b"\x1f\x8b\x08" + b"\0" * 6 + b"\xff" + stored + check
