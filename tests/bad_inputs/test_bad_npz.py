"""Damaged and hostile npz files (row S16)."""

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from numpy.lib import format as npy_format

from bad_maps import PGM

OCCUPANCY = np.array([[0, 0, 100], [100, 0, -1]], dtype=np.int8)
GEOMETRY = {
    "format": "mapdeal/1",
    "resolution": np.float64(0.05),
    "origin": np.array([1.5, -2.0, 0.4]),
}
MAP = {**GEOMETRY, "occupancy": OCCUPANCY}
FIELD = {
    **MAP,
    "distance": np.ones((2, 3), np.float32),
    "convention": "fast-planner",
    "strength": np.float64(1),
    "max_distance": np.float64(np.inf),
    "lethal_threshold": np.int64(100),
    "unknown": "free",
}
POTENTIAL = {
    **MAP,
    "repulsive": np.ones((2, 3)),
    "goal": np.array([1.52, -1.98]),
    "attractive_gain": np.float64(1),
    "repulsive_gain": np.float64(1),
    "repulsive_cap": np.float64(1e5),
}
COSTS = {**GEOMETRY, "cost": np.zeros((2, 3), np.uint8), "cost_scale": "costmap2d"}


def npy(value):
    """The bytes of one array of an npz; bytes are taken as they are."""
    if isinstance(value, bytes):
        return value
    file = io.BytesIO()
    npy_format.write_array(file, np.asanyarray(value), allow_pickle=True)
    return file.getvalue()


def npy_header(text):
    header = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def layer_header(shape, dtype="|i1"):
    return npy_header(f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}")


def write_npz(path, entries, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, value in entries.items():
            file.writestr(f"{name}.npy", npy(value))


BAD_ARRAYS = [
    ("object-layer", MAP, "occupancy", np.array([[None, 1]], dtype=object)),
    ("object-number", MAP, "resolution", np.array({"a": 1}, dtype=object)),
    ("missing-format", MAP, "format", None),
    ("missing-resolution", MAP, "resolution", None),
    ("missing-origin", MAP, "origin", None),
    ("missing-occupancy", MAP, "occupancy", None),
    ("missing-strength", FIELD, "strength", None),
    ("missing-cost-scale", COSTS, "cost_scale", None),
    ("other-format", MAP, "format", "mapdeal/99"),
    ("format-of-bytes", MAP, "format", np.bytes_(b"mapdeal/1")),
    ("float-occupancy", MAP, "occupancy", OCCUPANCY.astype(float)),
    ("flat-occupancy", MAP, "occupancy", OCCUPANCY[0]),
    ("occupancy-above-100", MAP, "occupancy", OCCUPANCY + np.int8(1)),
    ("text-resolution", MAP, "resolution", "0.05"),
    ("nan-resolution", MAP, "resolution", np.float64(np.nan)),
    ("negative-resolution", MAP, "resolution", np.float64(-0.05)),
    ("inf-origin", MAP, "origin", np.array([np.inf, 0, 0])),
    ("origin-of-two", MAP, "origin", np.array([1.5, -2.0])),
    ("nan-distance", FIELD, "distance", np.full((2, 3), np.nan, np.float32)),
    ("nan-in-a-known-cell", FIELD, "distance", np.array([[np.nan, 1, 1], [np.nan, 1, 1]],
                                                        np.float32)),
    ("nan-in-the-middle", FIELD, "distance", np.array([[1, np.nan, 1], [1, 1, 1]], np.float32)),
    ("nan-threshold", FIELD, "lethal_threshold", np.float64(np.nan)),
    ("inf-threshold", FIELD, "lethal_threshold", np.float64(np.inf)),
    ("nan-strength", FIELD, "strength", np.float64(np.nan)),
    ("nan-max-distance", FIELD, "max_distance", np.float64(np.nan)),
    ("field-occupancy-above-100", FIELD, "occupancy", OCCUPANCY + np.int8(1)),
    ("potential-occupancy-above-100", POTENTIAL, "occupancy", OCCUPANCY + np.int8(1)),
    ("potential-without-gain", POTENTIAL, "repulsive_gain", None),
    ("nan-repulsive", POTENTIAL, "repulsive", np.full((2, 3), np.nan)),
    ("huge-repulsive", POTENTIAL, "repulsive", np.full((2, 3), 1e308)),
    ("float32-repulsive", POTENTIAL, "repulsive", np.ones((2, 3), np.float32)),
    ("goal-of-three", POTENTIAL, "goal", np.zeros(3)),
    ("nan-goal", POTENTIAL, "goal", np.array([np.nan, 0])),
    ("huge-gain", POTENTIAL, "attractive_gain", np.float64(1e308)),
    ("negative-gain", POTENTIAL, "repulsive_gain", np.float64(-1)),
    ("cap-0", POTENTIAL, "repulsive_cap", np.float64(0)),
    ("unknown-convention", FIELD, "convention", "middle"),
    ("unknown-cost-scale", COSTS, "cost_scale", "percent"),
    ("nan-circumscribed-cost", COSTS, "circumscribed_cost", np.float64(np.nan)),
    ("pebibyte-header", MAP, "occupancy", layer_header((1 << 25, 1 << 25)) + b"\0" * 6),
    ("overflowing-header", MAP, "occupancy", layer_header((1 << 70, 1)) + b"\0" * 6),
    ("negative-header", MAP, "occupancy", layer_header((-2, -3)) + b"\0" * 6),
    ("header-beyond-its-data", MAP, "occupancy", layer_header((2, 4)) + b"\0" * 6),
    ("header-of-brackets", MAP, "occupancy", npy_header("(" * 5000)),
    ("header-with-empty-type", MAP, "occupancy",
     npy_header("{'descr': (), 'fortran_order': False, 'shape': (2, 3), }") + b"\0" * 6),
    ("header-with-empty-dict", MAP, "occupancy", npy_header("{}")),
    ("no-array", MAP, "occupancy", b"not an array"),
    ("empty-array-file", MAP, "format", b""),
]  # fmt: skip


@pytest.mark.parametrize(
    ("entries", "name", "value"), [pytest.param(*case, id=f"S16-{r}") for r, *case in BAD_ARRAYS]
)
def test_an_npz_with_a_bad_array_is_refused(folder, refused, entries, name, value):
    changed = {key: v for key, v in {**entries, name: value}.items() if v is not None}
    write_npz(folder / "n.npz", changed)
    refused(["info", "n.npz"], 3, "n.npz", name)
    refused(["cost", "n.npz", "-o", "o.npz"], 3, "n.npz", name)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"occupancy": np.zeros((0, 3), np.int8)}, id="S16-no-cells"),
        pytest.param({**FIELD, "distance": np.ones((3, 2), np.float32)}, id="S16-two-shapes"),
    ],
)
def test_layers_that_make_no_grid_are_refused(folder, refused, changes):
    write_npz(folder / "n.npz", {**MAP, **changes})
    refused(["info", "n.npz"], 3, "n.npz", "layers")
    refused(["run", "n.npz", "-o", "out"], 3, "n.npz", "layers")


@pytest.mark.parametrize(
    ("name", "dtype", "shape"),
    [
        pytest.param("occupancy", "|i1", (8192, 8192), id="S16-bomb-of-a-layer"),
        pytest.param("resolution", "<U16777216", (), id="S16-bomb-of-a-number"),
        pytest.param("format", "<U16777216", (), id="S16-bomb-of-a-text"),
    ],
)
def test_a_zip_bomb_is_refused_before_memory_is_taken(folder, refused, name, dtype, shape):
    bomb = layer_header(shape, dtype) + bytes(1 << 26)
    write_npz(folder / "n.npz", {**MAP, name: bomb})
    tracemalloc.start()
    try:
        refused(["info", "n.npz", "--max-cells", "1000000"], 3, "n.npz", name)
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(bytes(7), id="S16-a-byte-too-many"),
        pytest.param(bytes(5), id="S16-a-byte-too-few"),
    ],
)
def test_a_layer_that_does_not_fill_its_entry_is_refused(folder, refused, body):
    write_npz(folder / "n.npz", {**MAP, "occupancy": layer_header((2, 3)) + body})
    refused(["info", "n.npz"], 3, "n.npz", "occupancy")


def test_a_header_that_claims_more_than_the_entry_has_takes_no_memory_s16(folder, refused):
    claim = layer_header((30_000, 30_000)) + bytes(6)
    write_npz(folder / "n.npz", {**MAP, "occupancy": claim})
    tracemalloc.start()
    try:
        refused(["info", "n.npz"], 3, "n.npz", "occupancy")
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


def test_a_file_that_is_no_zip_is_refused_s16(folder, refused):
    for contents in (b"", b"\x93NUMPY\x01\x00", b"PK\x03\x04" + b"\0" * 60, PGM):
        (folder / "n.npz").write_bytes(contents)
        refused(["run", "n.npz", "-o", "out"], 3, "n.npz")


def test_a_truncated_npz_is_refused_s16(folder, refused):
    write_npz(folder / "n.npz", MAP)
    data = (folder / "n.npz").read_bytes()
    for size in (10, len(data) // 2, len(data) - 1):
        (folder / "n.npz").write_bytes(data[:size])
        refused(["info", "n.npz"], 3, "n.npz")


def test_a_zip_of_a_later_version_is_refused_s16(folder, refused):
    write_npz(folder / "n.npz", MAP)
    data = bytearray((folder / "n.npz").read_bytes())
    data[data.index(b"PK\x01\x02") + 6] = 99  # version needed to extract
    (folder / "n.npz").write_bytes(data)
    refused(["info", "n.npz"], 3, "n.npz")


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(zipfile.ZIP_DEFLATED, id="S16-deflate"),
    ],
)
def test_damaged_compressed_data_are_refused(folder, refused, method):
    write_npz(folder / "n.npz", MAP, method)
    data = bytearray((folder / "n.npz").read_bytes())
    start = data.index(b"occupancy.npy") + len(b"occupancy.npy")
    data[start + 12 : start + 40] = b"\xff" * 28
    (folder / "n.npz").write_bytes(data)
    refused(["info", "n.npz"], 3, "n.npz", "occupancy")


@pytest.mark.parametrize("is_large", [False, True], ids=["zip", "zip64"])
def test_a_list_of_entries_that_is_long_is_not_read(folder, refused, is_large):
    """The list alone is what costs memory: entries of nothing, all at one place."""
    count = 70_000 if is_large else 20_000
    name = b"a" * 40 + b".npy"
    local = b"PK\3\4" + struct.pack("<HHHHHIIIHH", 20, 0, 0, 0, 33, 0, 0, 0, len(name), 0) + name
    entry = b"PK\1\2" + struct.pack(
        "<HHHHHHIIIHHHHHII", 20, 20, 0, 0, 0, 33, 0, 0, 0, len(name), 0, 0, 0, 0, 0, 0
    )
    directory = (entry + name) * count
    start, size = len(local), len(directory)
    end = b""
    if is_large:
        end += b"PK\6\6" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, count, count, size, start)
        end += b"PK\6\7" + struct.pack("<IQI", 0, start + size, 1)
        count = 0xFFFF
        size = start = 0xFFFFFFFF
    end += b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, count, count, size, start, 0)
    (folder / "n.npz").write_bytes(local + directory + end)
    refused(["info", "n.npz"], 3, "n.npz", "too many arrays")
