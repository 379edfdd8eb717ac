"""States of Cartographer (.pbstream), written by a small writer of protobuf."""

import gzip
import math
import struct

import numpy as np

MAGIC = struct.pack("<Q", 0x7B1D1F7B5BF501DB)
START = 638_000_000_000_000_000  # ticks


def varint(value):
    value &= (1 << 64) - 1
    head = b""
    while value > 127:
        head, value = head + bytes([value & 127 | 128]), value >> 7
    return head + bytes([value])


def message(*fields):
    """Return the bytes of fields (number, value): int, float, bytes, or a list, which is packed."""
    data = b""
    for number, value in fields:
        if isinstance(value, int):
            data += varint(number << 3) + varint(value)
        elif isinstance(value, float):
            data += varint(number << 3 | 1) + struct.pack("<d", value)
        else:
            body = b"".join(map(varint, value)) if isinstance(value, list) else value
            data += varint(number << 3 | 2) + varint(len(body)) + body
    return data


def pose(x=0.0, y=0.0, yaw=0.0):
    turn = message((3, math.sin(yaw / 2)), (4, math.cos(yaw / 2)))
    return message((1, message((1, float(x)), (2, float(y)))), (2, turn))


def grid(cells, *, resolution=0.05, corner=(1.0, 2.0), box=None, packed=True, kind=4, more=()):
    """Return a grid of cells, shape (H, W), and around the known ones a box: l, t, r, b."""
    height, width = cells.shape
    left, top, right, bottom = box or (0, 0, width - 1, height - 1)
    size = message((1, width), (2, height))
    upper = message((1, float(corner[0])), (2, float(corner[1])))
    values = [(2, cells.ravel().tolist())] if packed else [(2, int(v)) for v in cells.ravel()]
    known = message((1, right), (2, bottom), (3, left), (4, top))
    limits = message((1, float(resolution)), (2, upper), (3, size))
    return message((1, limits), *values, (3, known), (kind, b""), *more)


def submap(cells, *, key=(0, 0), local=(0, 0, 0), finished=1, field=2, **options):
    """Return the message of a submap."""
    own = message((1, pose(*local)), (2, 9), (3, finished), (4, grid(cells, **options)))
    return message((3, message((1, message((1, key[0]), (2, key[1]))), (field, own))))


def pose_graph(poses, nodes=()):
    """Return the message of poses of submaps by (trajectory, index), and of nodes of trajectories.

    Nodes are (trajectory, seconds, x, y, yaw).
    """
    graph = b""
    for number in sorted({key[0] for key in poses} | {node[0] for node in nodes}):
        entries = [
            (2, message((2, key[1]), (1, pose(*placed)))) for key, placed in poses.items()
            if key[0] == number
        ]  # fmt: skip
        path = [
            (1, message((7, index), (1, START + round(1e7 * seconds)), (5, pose(*placed))))
            for index, (owner, seconds, *placed) in enumerate(nodes) if owner == number
        ]  # fmt: skip
        graph += message((4, message(*path, *entries, *([(3, number)] if number else []))))
    return message((1, graph))


def state(*messages, version=2):
    """Return the bytes of a file."""
    blocks = [gzip.compress(data, mtime=0) for data in (message((1, version)), *messages)]
    return MAGIC + b"".join(struct.pack("<Q", len(block)) + block for block in blocks)


def random_cells(height, width, seed=0, known=0.7):
    rng = np.random.default_rng(seed)
    values = rng.integers(1, 32768, (height, width)) | rng.integers(0, 2, (height, width)) << 15
    return np.where(rng.random((height, width)) < known, values, 0)
