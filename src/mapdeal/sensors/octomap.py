"""OctoMap's files of octrees: ``.bt`` and ``.ot``, whose occupied voxels are points.

References
----------
OctoMap's ``OccupancyOcTreeBase::readBinaryNode`` and ``OcTreeBaseImpl::readNodesRecurs``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.files.source import claim

_DEPTH = 16  # levels of all of OctoMap's trees
_MIDDLE = 1 << (_DEPTH - 1)  # key of the voxel whose lower corner is the origin
_SLOTS = np.arange(8)  # bit 0 of a child's number is x, bit 1 y and bit 2 z
_MOST_LINES = 100
_PER_NODE = 200  # bytes that a node takes while the tree is read, at most
_PER_POINT = 120
_TOGETHER = 1 << 17

_BINARY = np.dtype("<u2")
_RECORDS = {
    "OcTree": np.dtype([("value", "<f4"), ("children", "u1")]),
    "OcTreeStamped": np.dtype([("value", "<f4"), ("children", "u1")]),
    "ColorOcTree": np.dtype([("value", "<f4"), ("colour", "u1", 3), ("children", "u1")]),
}
"""What is stored of each node of a tree in a ``.ot`` file."""


class OctreeHeader(NamedTuple):
    is_binary: bool
    tree: str
    resolution: float


def read_octree_header(file: BinaryIO) -> OctreeHeader:
    """Read the header, and leave the file at the data."""
    first = file.readline(256)
    entries: dict[str, str] = {}
    for _ in range(_MOST_LINES):
        line = file.readline(4096).decode("latin-1").strip()
        if line == "data":
            break
        key, _, value = line.partition(" ")
        entries[key] = value.strip()
    else:
        raise MalformedInputError("the header of an OctoMap file does not end")
    tree = entries.get("id", "")
    if tree not in _RECORDS:
        rule = f"must be one of {', '.join(_RECORDS)}"
        raise MalformedInputError(rule, place="id", got=tree)
    try:
        resolution = float(entries.get("res", ""))
    except ValueError:
        resolution = math.nan
    if not 1e-4 <= resolution <= 1e3:
        rule = "must be the side of a voxel, metres"
        raise MalformedInputError(rule, place="res", got=entries.get("res", ""))
    return OctreeHeader(b"binary" in first, tree, resolution)


def octree_points(file: BinaryIO, path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the centres of all occupied voxels, some at a time."""
    header = read_octree_header(file)
    record: np.dtype[Any] = _BINARY if header.is_binary else _RECORDS[header.tree]
    size = os.fstat(file.fileno()).st_size - file.tell()
    claim(path, _PER_NODE * (size // record.itemsize), what="the nodes of an octree")
    data = file.read(size)
    whole = data[: len(data) // record.itemsize * record.itemsize]
    nodes: NDArray[Any] = np.frombuffer(whole, record)
    if not len(nodes):
        return
    if header.is_binary:
        has_free, has_occupied = ((nodes[:, np.newaxis] >> 2 * _SLOTS + k) & 1 for k in (0, 1))
        leaves = (has_occupied > has_free), (has_occupied & has_free).astype(np.bool_)
        keys, heights = _occupied_leaves(*leaves)
    else:
        inner = ((nodes["children"][:, np.newaxis] >> _SLOTS) & 1).astype(np.bool_)
        keys, heights = _occupied_nodes(inner, nodes["value"] >= 0)
    counts = 8**heights
    claim(path, _PER_POINT * int(counts.sum()), what=f"{counts.sum()} voxels")
    for height in np.unique(heights).tolist():
        side = np.arange(1 << height)
        within = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
        corners = keys[heights == height]
        together = max(1, _TOGETHER // len(within))
        for start in range(0, len(corners), together):
            voxels = corners[start : start + together, np.newaxis] + within
            yield (voxels.reshape(-1, 3) - _MIDDLE + 0.5) * header.resolution


def _levels(inner: NDArray[np.bool_]) -> Iterator[tuple[int, NDArray[Any], NDArray[Any]]]:
    """Yield height, places and keys of the nodes of each level; `inner`: their stored children.

    Nodes are stored depth first. A node's subtree ends where the number of nodes that are still
    to come falls below what it was before the node.
    """
    pending = np.cumsum(inner.sum(axis=1, dtype=np.int64) - 1)
    if pending[-1] > -1:
        raise MalformedInputError("ends within its tree")
    count = len(pending)
    order = np.argsort(pending, kind="stable")
    ranked = pending[order] * count + order
    places, keys = np.zeros(1, np.int64), np.zeros((1, 3), np.int64)
    for height in range(_DEPTH, -1, -1):
        yield height, places, keys
        if not len(places):
            return
        following, next_places, next_keys = places + 1, [], []
        for slot in _SLOTS.tolist():
            has = inner[places, slot]
            child = following[has]
            if height == 0 and len(child):
                raise MalformedInputError(f"a tree must have {_DEPTH} levels at most")
            next_places.append(child)
            corner = np.array([slot & 1, slot >> 1 & 1, slot >> 2]) << max(height - 1, 0)
            next_keys.append(keys[has] + corner)
            wanted = (pending[child - 1] - 1) * count + child
            following[has] = order[np.searchsorted(ranked, wanted)] + 1
        places, keys = np.concatenate(next_places), np.concatenate(next_keys)


def _occupied_leaves(
    occupied: NDArray[np.bool_], inner: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return corners and heights of the occupied leaves that nodes of a ``.bt`` file name."""
    found, heights = [], []
    for height, places, keys in _levels(inner):
        whose, slot = np.nonzero(occupied[places])
        corner = np.stack([slot & 1, slot >> 1 & 1, slot >> 2], axis=1) << max(height - 1, 0)
        found.append(keys[whose] + corner)
        heights.append(np.full(len(whose), height - 1, np.int64))
    return np.concatenate(found), np.concatenate(heights)


def _occupied_nodes(
    inner: NDArray[np.bool_], is_occupied: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return corners and heights of the occupied leaves of a ``.ot`` file."""
    is_leaf = ~inner.any(axis=1) & is_occupied
    found, heights = [], []
    for height, places, keys in _levels(inner):
        chosen = is_leaf[places]
        found.append(keys[chosen])
        heights.append(np.full(int(chosen.sum()), height, np.int64))
    return np.concatenate(found), np.concatenate(heights)
