"""Damaged and hostile npz files (row S16)."""

import io
import struct
import zipfile

import numpy as np
import pytest

from bad_maps import named
from traced_memory import memory_below

OCCUPANCY = np.array([[0, 0, 100], [100, 0, -1]], dtype=np.int8)
GEOMETRY = {"format": "mapdeal/1", "resolution": 0.05, "origin": [1.5, -2.0, 0.4]}
MAP = {**GEOMETRY, "occupancy": OCCUPANCY}
FIELD = {
    **MAP, "distance": np.ones((2, 3), np.float32), "convention": "fast-planner", "strength": 1.0,
    "max_distance": np.inf, "lethal_threshold": 100, "unknown": "free",
}  # fmt: skip
POTENTIAL = {
    **MAP, "repulsive": np.ones((2, 3)), "goal": [1.52, -1.98], "attractive_gain": 1.0,
    "repulsive_gain": 1.0, "repulsive_cap": 1e5,
}  # fmt: skip


def npy(value):
    """The bytes of one array of an npz; bytes are taken as they are."""
    if isinstance(value, bytes):
        return value
    file = io.BytesIO()
    np.save(file, value)
    return file.getvalue()


def npy_header(text):
    header = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def layer_header(shape, dtype="|i1"):
    return npy_header(f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}")


def write_npz(path, entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, value in entries.items():
            file.writestr(f"{name}.npy", npy(value))


BAD_ARRAYS = [
    ("object-layer", MAP, "occupancy", np.array([[None, 1]], dtype=object)),
    ("object-number", MAP, "resolution", np.array({"a": 1}, dtype=object)),
    ("format-of-bytes", MAP, "format", np.bytes_(b"mapdeal/1")),
    ("float-occupancy", MAP, "occupancy", OCCUPANCY.astype(float)),
    ("occupancy-above-100", MAP, "occupancy", OCCUPANCY + np.int8(1)),
    ("inf-origin", MAP, "origin", [np.inf, 0, 0]),
    ("nan-distance", FIELD, "distance", np.full((2, 3), np.nan, np.float32)),
    ("nan-in-a-known-cell", FIELD, "distance", np.float32([[np.nan, 1, 1], [np.nan, 1, 1]])),
    ("nan-threshold", FIELD, "lethal_threshold", np.nan),
    ("goal-of-three", POTENTIAL, "goal", np.zeros(3)),
    ("potential-without-gain", POTENTIAL, "repulsive_gain", None),
    ("nan-repulsive", POTENTIAL, "repulsive", np.full((2, 3), np.nan)),
    ("pebibyte-header", MAP, "occupancy", layer_header((1 << 25, 1 << 25)) + b"\0" * 6),
    ("overflowing-header", MAP, "occupancy", layer_header((1 << 70, 1)) + b"\0" * 6),
    ("negative-header", MAP, "occupancy", layer_header((-2, -3)) + b"\0" * 6),
    ("header-beyond-its-data", MAP, "occupancy", layer_header((2, 4)) + b"\0" * 6),
    ("header-of-brackets", MAP, "occupancy", npy_header("(" * 5000)),
    ("header-with-empty-type", MAP, "occupancy",
     npy_header("{'descr': (), 'fortran_order': False, 'shape': (2, 3), }") + b"\0" * 6),
    ("a-byte-too-many", MAP, "occupancy", layer_header((2, 3)) + bytes(7)),
    ("a-byte-too-few", MAP, "occupancy", layer_header((2, 3)) + bytes(5)),
    ("no-array", MAP, "occupancy", b"not an array"),
    ("empty-array-file", MAP, "format", b""),
]  # fmt: skip


@pytest.mark.parametrize(("entries", "name", "value"), named(BAD_ARRAYS))
def test_an_npz_with_a_bad_array_is_refused(folder, refused, entries, name, value):
    changed = {key: v for key, v in {**entries, name: value}.items() if v is not None}
    write_npz(folder / "n.npz", changed)
    refused(["info", "n.npz"], 3, "n.npz", name)


BOMBS = [
    ("occupancy", layer_header((8192, 8192)) + bytes(1 << 26)),
    ("resolution", layer_header((), "<U16777216") + bytes(1 << 26)),
    ("format", layer_header((), "<U16777216") + bytes(1 << 26)),
    ("occupancy", layer_header((30_000, 30_000)) + bytes(6)),  # more than the entry has
]


@pytest.mark.parametrize(("name", "bomb"), BOMBS, ids=["layer", "number", "text", "claim"])
def test_a_zip_bomb_is_refused_before_memory_is_taken(folder, refused, name, bomb):
    write_npz(folder / "n.npz", {**MAP, name: bomb})
    with memory_below(16_000_000):
        refused(["info", "n.npz", "--max-cells", "1000000000"], 3, "n.npz", name)


@pytest.mark.parametrize("is_large", [False, True], ids=["zip", "zip64"])
def test_a_list_of_entries_that_is_long_is_not_read(folder, refused, is_large):
    """The list alone is what costs memory: entries of nothing, all at one place."""
    count, name = 70_000 if is_large else 20_000, b"a" * 40 + b".npy"
    facts = struct.pack("<HHHHHIIIHH", 20, 0, 0, 0, 33, 0, 0, 0, len(name), 0)
    local = b"PK\3\4" + facts + name
    directory = count * (b"PK\1\2\x14\0" + facts + bytes(14) + name)
    start, size, end = len(local), len(directory), b""
    if is_large:
        end += b"PK\6\6" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, count, count, size, start)
        end += b"PK\6\7" + struct.pack("<IQI", 0, start + size, 1)
        count, size, start = 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF
    end += b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, count, count, size, start, 0)
    (folder / "n.npz").write_bytes(local + directory + end)
    refused(["info", "n.npz"], 3, "n.npz", "too many arrays")
