"""OctoMap's octrees, ``.bt`` and ``.ot``: the centres of their occupied voxels are points.

References
----------
OctoMap's ``OccupancyOcTreeBase::readBinaryNode`` and ``OcTreeBaseImpl::readNodesRecurs``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.files.source import claim
from mapdeal.files.text import is_number
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask

_DEPTH = 16  # levels of all of OctoMap's trees
_MIDDLE = 1 << (_DEPTH - 1)  # key of the voxel whose lower corner is the origin
_SLOTS = np.arange(8)
_CORNERS = np.stack([_SLOTS & 1, _SLOTS >> 1 & 1, _SLOTS >> 2], axis=1)  # of children: x, y, z
_MOST_LINES = 100
_BYTES_PER_NODE, _BYTES_PER_POINT = 200, 120  # peak memory
_POINTS_AT_ONCE = 1 << 17

_FIELDS: list[tuple[Any, ...]] = [("value", "<f4"), ("children", "u1")]
_RECORDS = {
    "OcTree": np.dtype(_FIELDS),
    "OcTreeStamped": np.dtype(_FIELDS),
    "ColorOcTree": np.dtype([_FIELDS[0], ("colour", "u1", 3), _FIELDS[1]]),
}
"""Layout of the nodes in a ``.ot`` file; in a ``.bt`` file each child has two bits."""


def read_octree_header(file: BinaryIO) -> tuple[bool, str, float]:
    """Return whether a tree is binary, its kind, and the side of its voxels in metres."""
    first, entries = file.readline(256), {"id": "", "res": ""}
    for _ in range(_MOST_LINES):
        key, _, value = file.readline(4096).decode("latin-1").strip().partition(" ")
        if key == "data":
            break
        entries[key] = value.strip()
    else:
        raise MalformedInputError("the header of an OctoMap file does not end")
    tree, side = entries["id"], entries["res"]
    if tree not in _RECORDS:
        raise MalformedInputError(f"must be one of {', '.join(_RECORDS)}", place="id", got=tree)
    if not is_number(side) or not 1e-4 <= float(side) <= 1e3:
        raise MalformedInputError("must be the side of a voxel, metres", place="res", got=side)
    return b"binary" in first, tree, float(side)


def octree_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    is_binary, tree, resolution = read_octree_header(file)
    record = np.dtype("<u2") if is_binary else _RECORDS[tree]
    size = os.fstat(file.fileno()).st_size - file.tell()
    claim(path, _BYTES_PER_NODE * (size // record.itemsize), what="the nodes of an octree")
    data = file.read(size)
    nodes: Array = np.frombuffer(data, record, len(data) // record.itemsize)
    if not len(nodes):
        return
    leaves_by_height = list(_leaves_of_binary(nodes) if is_binary else _leaves_of_full(nodes))
    count = sum(len(corners) << 3 * height for height, corners in leaves_by_height)
    claim(path, _BYTES_PER_POINT * count, what=f"{count} voxels")
    for height, corners in leaves_by_height:
        side = np.arange(1 << height if len(corners) else 1)
        within = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
        batch_size = max(1, _POINTS_AT_ONCE // len(within))
        for start in range(0, len(corners), batch_size):
            voxels = corners[start : start + batch_size, np.newaxis] + within
            centres = voxels.reshape(-1, 3) - (_MIDDLE - 0.5)
            yield np.asarray(centres * resolution, dtype=np.float64)


def _leaves_of_binary(nodes: Array) -> Iterator[tuple[int, Integers]]:
    """Yield the height and the corners, in voxels, of the occupied leaves of each level.

    A ``.bt`` file has no nodes for leaves: two bits of the parent describe each child.
    """
    free, occupied = ((nodes[:, np.newaxis] >> 2 * _SLOTS + bit) & 1 == 1 for bit in (0, 1))
    for height, indices, keys in _levels(has_child=free & occupied):
        if height:
            parents, slots = np.nonzero((occupied & ~free)[indices])
            yield height - 1, keys[parents] + (_CORNERS << height - 1)[slots]


def _leaves_of_full(nodes: Array) -> Iterator[tuple[int, Integers]]:
    """Yield the same for a ``.ot`` file, in which each leaf has a node."""
    has_child = (nodes["children"][:, np.newaxis] >> _SLOTS) & 1 == 1
    is_occupied_leaf = ~has_child.any(axis=1) & (nodes["value"] >= 0)
    for height, indices, keys in _levels(has_child):
        yield height, keys[is_occupied_leaf[indices]]


def _levels(has_child: Mask) -> Iterator[tuple[int, Integers, Integers]]:
    """Yield the height of each level, and the indices and the corners, in voxels, of its nodes.

    `has_child` marks the children of each node that have nodes of their own. Nodes are stored depth
    first: the subtree of a node ends where fewer nodes are pending than before it.
    """
    pending = np.cumsum(has_child.sum(axis=1, dtype=np.int64) - 1)
    if pending[-1] > -1:
        raise MalformedInputError("ends within its tree")
    order = np.argsort(pending, kind="stable")
    ranks = pending[order] * len(pending) + order
    indices, keys = np.zeros(1, np.int64), np.zeros((1, 3), np.int64)
    for height in range(_DEPTH, -1, -1):
        yield height, indices, keys
        next_children = indices + 1  # index of the next child of each node
        children, corners = [], []
        for slot, step in enumerate(_CORNERS << max(height - 1, 0)):
            is_parent = has_child[indices, slot]
            child = next_children[is_parent]
            children.append(child)
            corners.append(keys[is_parent] + step)
            end = (pending[child - 1] - 1) * len(pending) + child
            next_children[is_parent] = order[np.searchsorted(ranks, end)] + 1
        indices, keys = np.concatenate(children), np.concatenate(corners)
    if len(indices):
        raise MalformedInputError(f"a tree must have {_DEPTH} levels at most")
