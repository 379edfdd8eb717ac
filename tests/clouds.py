"""Clouds written by hand, as the formats' descriptions have it, and LZF by the simplest means."""

import struct

import numpy as np

from mapdeal import Frame

CODES = {"f4": "f", "f8": "d", "i1": "b", "i2": "h", "i4": "i", "i8": "q",
         "u1": "B", "u2": "H", "u4": "I", "u8": "Q"}  # fmt: skip
PLY_TYPES = {"f4": "float", "f8": "double", "i2": "short", "u1": "uchar", "i4": "int32"}


def lzf_compressed(data):
    """Compress greedily, searching the last 8 KiB for the longest match."""
    out, literals, k = bytearray(), bytearray(), 0

    def flush():
        while literals:
            run = literals[:32]
            out.append(len(run) - 1)
            out.extend(run)
            del literals[:32]

    while k < len(data):
        best, back = 0, 0
        for start in range(max(0, k - 8192), k):
            n = 0
            while n < 264 and k + n < len(data) and data[start + n] == data[k + n]:
                n += 1
            if n > best:
                best, back = n, k - start - 1
        if best < 3:
            literals.append(data[k])
            k += 1
            continue
        flush()
        length = best - 2
        if length < 7:
            out.append(length << 5 | back >> 8)
        else:
            out.extend([7 << 5 | back >> 8, length - 7])
        out.append(back & 255)
        k += best
    flush()
    return bytes(out)


def pcd_header(fields, count, data, *, width=None):
    """Return a header; `fields` are (name, kind, count)."""
    lines = [
        "# .PCD v.7 - Point Cloud Data file format",
        "VERSION .7",
        "FIELDS " + " ".join(name for name, _, _ in fields),
        "SIZE " + " ".join(kind[1:] for _, kind, _ in fields),
        "TYPE " + " ".join(kind[0].upper() for _, kind, _ in fields),
        "COUNT " + " ".join(str(n) for _, _, n in fields),
        f"WIDTH {count if width is None else width}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        f"DATA {data}",
    ]
    return "".join(f"{line}\n" for line in lines).encode()


def _packed(code, values):
    return struct.pack(f"<{len(values)}{code}", *values)


def pcd(fields, rows, data="binary", *, padding=b""):
    """Return a PCD file; each row has a list of numbers for every field."""
    head = pcd_header(fields, len(rows), data)
    if data == "ascii":
        lines = [" ".join(repr(v) for values in row for v in values) for row in rows]
        return head + "".join(f"{line}\n" for line in lines).encode() + padding
    codes = [CODES[kind] for _, kind, _ in fields]
    if data == "binary":
        body = b"".join(b"".join(map(_packed, codes, row)) for row in rows)
        return head + body + padding
    columns = b"".join(_packed(code, row[k]) for k, code in enumerate(codes) for row in rows)
    packed = lzf_compressed(columns)
    return head + struct.pack("<II", len(packed), len(columns)) + packed + padding


def ply(fields, rows, encoding, *, before=b"", before_head="", after=b"", after_head=""):
    """Return a PLY file with vertices; `fields` are (name, kind)."""
    lines = ["ply", f"format {encoding} 1.0", "comment made by hand", *before_head.splitlines(),
             f"element vertex {len(rows)}",
             *(f"property {PLY_TYPES[kind]} {name}" for name, kind in fields),
             *after_head.splitlines(), "end_header"]  # fmt: skip
    head = "".join(f"{line}\n" for line in lines).encode()
    if encoding == "ascii":
        body = "".join(" ".join(repr(v) for v in row) + "\n" for row in rows).encode()
    else:
        order = "<" if "little" in encoding else ">"
        codes = order + "".join(CODES[kind] for _, kind in fields)
        body = b"".join(struct.pack(codes, *row) for row in rows)
    return head + before + body + after


def box_points(random, density, box, *, has_top=True):
    """Return points on the sides of a box, and on its top: x0, x1, y0, y1, z0, z1."""
    x0, x1, y0, y1, z0, z1 = box
    sides = [((x0, x1), (y, y), (z0, z1), (x1 - x0) * (z1 - z0)) for y in (y0, y1)]
    sides += [((x, x), (y0, y1), (z0, z1), (y1 - y0) * (z1 - z0)) for x in (x0, x1)]
    sides += [((x0, x1), (y0, y1), (z1, z1), (x1 - x0) * (y1 - y0))] * has_top
    return np.concatenate([
        np.column_stack([random.uniform(*axis, int(density * area)) for axis in axes])
        for *axes, area in sides
    ])  # fmt: skip


class SampledRoom:
    """Points on the surfaces of a room with boxes and a wall, and its true map."""

    HIDDEN = -2  # in the true map: the inside of boxes that are higher than a robot
    SHIFT = (0.013, 0.021)  # no wall lies on the edges of cells

    def __init__(
        self, seed, *, floor_density=400, density=400, ceiling=True, wall_height=None, noise=0.01
    ):
        self.random = random = np.random.default_rng(seed)
        self.width, self.depth = random.uniform(5, 12), random.uniform(5, 9)
        self.height = random.uniform(2.4, 3.4)
        walls = wall_height or self.height
        self.boxes = []
        for k in range(3):
            x, y = self.width * (0.15 + 0.3 * k), self.depth * random.uniform(0.5, 0.7)
            wide, deep, tall = random.uniform(0.5, 1.2), random.uniform(0.5, 1.2), 0.5 + 0.45 * k
            self.boxes.append((x, x + wide, y, y + deep, 0, tall))
        parts = [box_points(random, density, box) for box in self.boxes]
        room = (0, self.width, 0, self.depth, 0, walls)
        parts.append(box_points(random, density, room, has_top=False))
        wall = (self.width / 2, self.width / 2 + 0.1, 0, self.depth * 0.4, 0, walls)
        self.boxes.append(wall)
        parts.append(box_points(random, density, wall))
        floor = self._level(floor_density, 0)
        for x0, x1, y0, y1, *_ in self.boxes:
            is_below = (floor[:, 0] > x0) & (floor[:, 0] < x1)
            floor = floor[~(is_below & (floor[:, 1] > y0) & (floor[:, 1] < y1))]
        self.parts = {"floor": floor, "solids": np.concatenate(parts),
                      "ceiling": self._level(density * ceiling, self.height)}  # fmt: skip
        for name, part in self.parts.items():
            self.parts[name] = part + random.normal(0, noise, part.shape) + [*self.SHIFT, 0]

    def _level(self, density, z):
        count = int(density * self.width * self.depth)
        sides = ((0, self.width), (0, self.depth), (z, z))
        return np.column_stack([self.random.uniform(*side, count) for side in sides])

    def points(self, *names):
        return np.concatenate([self.parts[name] for name in names or self.parts])

    def frame(self):
        height, width = int(self.depth / 0.05) + 12, int(self.width / 0.05) + 12
        return Frame(height, width, 0.05, (-0.3, -0.3, 0))

    def truth(self, robot_height=1.0):
        rows, cols = np.indices(self.frame().shape)
        x = -0.3 + (cols + 0.5) * 0.05 - self.SHIFT[0]
        y = -0.3 + (rows + 0.5) * 0.05 - self.SHIFT[1]

        def within(box, margin):
            x0, x1, y0, y1, *_ = box
            inside = (x > x0 - margin) & (x < x1 + margin)
            return inside & (y > y0 - margin) & (y < y1 + margin)

        half, room = 0.025, (0, self.width, 0, self.depth)
        values = np.where(within(room, half), 100, -1)
        values[within(room, -half)] = 0
        for box in self.boxes:
            values[within(box, half)] = 100
            if box[5] > robot_height - 0.05:
                values[within(box, -half)] = self.HIDDEN
        return values
