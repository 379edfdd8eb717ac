"""Good files of every kind, a few cells each: what mutants are made of.

What libraries compress comes from the folder ``seeds``, since its bytes differ from version to
version; ``python tests/robustness/seeds.py`` has written those files, and adds new ones. All
others are made here, byte by byte.
"""

import io
import json
import re
import struct
import sys
import zlib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from clouds import pcd, ply

STORED = Path(__file__).with_name("seeds")

WIDTH, HEIGHT = 8, 6
_GREYS = (0, 205, 254, 128, 255, 100, 254)
PIXELS = bytes(_GREYS[(3 * row + 5 * col) % 7] for row in range(HEIGHT) for col in range(WIDTH))

MAP_YAML = b"image: m.pgm\nresolution: 0.05\norigin: [-1.5, 2.0, 0.1]\nnegate: 0\n"
MAP_PGM = b"P5\n8 6\n255\n" + PIXELS
TURNED_POINTS = [[0.5, -1.25, 0.0], [2.0, 3.5, 0.25], [-3.75, 0.0, 1e-3], [7.0, 7.0, 7.0]]


def stored(*names):
    """Return the stored files of these names."""
    return [(STORED / name).read_bytes() for name in names]


def pnm_files():
    """Return the pixels as P1 to P6, with comments, DOS line ends and odd largest values."""
    greys = [value * 100 // 255 for value in PIXELS]
    bits = [int(value < 128) for value in PIXELS]
    rows = [bits[k : k + WIDTH] for k in range(0, len(bits), WIDTH)]
    packed = bytes(int("".join(map(str, row)), 2) for row in rows)
    colours = bytes(channel for value in PIXELS[:12] for channel in (value, value, 255 - value))
    return [
        MAP_PGM,
        b"P5\n# CREATOR: by hand\n8 # wide\n6\n255\n" + PIXELS,
        b"P5 8 6 100\n" + bytes(greys),
        b"P5\r\n8 6\r\n255\r\n" + PIXELS,
        b"P5\n4 6\n65535\n" + PIXELS,
        b"P2\n8 6\n255\n" + _lines(PIXELS, WIDTH),
        b"P2\n# low\n8 6\n100\n" + _lines(greys, WIDTH),
        b"P1\n8 6\n" + b"".join(bytes(row).translate(_BIT_DIGITS) for row in rows) + b"\n",
        b"P4\n8 6\n" + packed,
        b"P4\n5 6\n" + packed,
        b"P3\n4 3\n255\n" + _lines(colours, 12),
        b"P6\n4 3\n255\n" + colours,
    ]


_BIT_DIGITS = bytes([48, 49, *range(2, 256)])


def _lines(values, count):
    rows = (values[k : k + count] for k in range(0, len(values), count))
    return b"".join(b" ".join(b"%d" % value for value in row) + b"\n" for row in rows)


def png_files():
    """Return pictures of every colour type and depth, interlaced ones and odd chunks among them."""
    palette = (b"PLTE", bytes(range(0, 252, 21)))
    return [
        *(png(depth, 0) for depth in (1, 2, 4, 8, 16)),
        *(png(depth, 3, palette) for depth in (1, 2, 4, 8)),
        png(8, 2), png(16, 2), png(8, 4), png(16, 4), png(8, 6), png(16, 6),
        png(8, 0, interlaced=True), png(2, 3, palette, interlaced=True),
        png(16, 6, interlaced=True),
        png(8, 0, (b"tRNS", b"\0\xcd")), png(8, 2, (b"tRNS", b"\0\0\0\0\0\0")),
        png(4, 3, palette, (b"tRNS", b"\xff\0\x80")),
        png(8, 0, (b"gAMA", b"\0\0\xb1\x8f"), (b"pHYs", b"\0\0\0\1\0\0\0\1\1")),
        png(8, 0, (b"tEXt", b"Comment\0by hand"), (b"iCCP", b"p\0\0" + _zlib(b"p"))),
        png(8, 0, (b"eXIf", b"II*\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0\6\0\0\0\0\0\0\0")),
    ]  # fmt: skip


def png(depth, colour, *chunks, interlaced=False):
    """Return a PNG whose rows hold a pattern; every filter is used."""
    bits = depth * {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]
    passes = [(0, 0, 1, 1)]
    if interlaced:
        passes = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4),
                  (1, 0, 2, 2), (0, 1, 1, 2)]  # fmt: skip
    rows = b""
    for first_col, first_row, col_step, row_step in passes:
        cols = -(-(WIDTH - first_col) // col_step)
        for row in range(first_row, HEIGHT, row_step):
            length = (cols * bits + 7) // 8
            rows += bytes([row % 5]) + (PIXELS * 2)[row : row + length]
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, depth, colour, 0, 0, int(interlaced))
    parts = [(b"IHDR", header), *chunks, (b"IDAT", _zlib(rows)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in parts
    )


def with_checksums(data):
    """Return a PNG with the checksums that its chunks should have: so damage gets further in."""
    text, at = bytearray(data), 8
    while at + 12 <= len(text):
        end = at + 8 + int.from_bytes(text[at : at + 4])
        if end + 4 > len(text):
            break
        struct.pack_into(">I", text, end, zlib.crc32(memoryview(text)[at + 4 : end]))
        at = end + 4
    return bytes(text)


def bmp_files():
    """Return bit maps of 1, 4, 8, 24 and 32 bits, from the top down, too, and run lengths."""
    table = b"".join(struct.pack("<BBBB", k, k, k, 0) for k in range(0, 256, 17))
    runs = b"".join(b"\x04\x02\x04\x05\0\0" for _ in range(HEIGHT)) + b"\0\1"
    return [
        bmp(1, b"\0\0\0\0\xff\xff\xff\0", b"\xa5\0\0\0" * HEIGHT),
        bmp(4, table, b"\x01\x23\x45\x67" * HEIGHT),
        bmp(8, table, bytes(value // 17 for value in PIXELS)),
        bmp(8, table, bytes(value // 17 for value in PIXELS), top_down=True),
        bmp(8, table, runs, compression=1),
        bmp(24, b"", bytes(value for value in PIXELS for _ in range(3))),
        bmp(32, b"", bytes(channel for value in PIXELS for channel in (value, value, value, 255))),
    ]


def bmp(bits, palette, pixels, *, compression=0, top_down=False):
    start = 54 + len(palette)
    return (
        b"BM" + struct.pack("<IHHI", start + len(pixels), 0, 0, start)
        + struct.pack("<IiiHHIIiiII", 40, WIDTH, -HEIGHT if top_down else HEIGHT, 1, bits,
                      compression, len(pixels), 2835, 2835, len(palette) // 4, 0)
        + palette + pixels
    )  # fmt: skip


def tiff_files():
    """Return uncompressed pictures made here, and what libtiff has compressed."""
    colours = bytes(value for value in PIXELS[:16] for _ in range(3))
    return [
        tiff("<", PIXELS),
        tiff(">", PIXELS),
        tiff("<", PIXELS, strips=3),
        tiff("<", PIXELS, white_is_zero=True),
        tiff(">", PIXELS, bits=16, width=4),
        tiff("<", PIXELS[:6], bits=1),
        tiff("<", colours, samples=3, width=4, height=4),
        *stored("lzw.tiff", "deflate.tiff", "packbits.tiff", "group4.tiff", "jpeg.tiff", "big.tiff",
                "palette.tiff", "rgba.tiff"),
    ]  # fmt: skip


def tiff(order, pixels, *, bits=8, samples=1, width=WIDTH, height=HEIGHT, strips=1,
         white_is_zero=False):  # fmt: skip
    """Return a TIFF whose directory stands before its pixels."""
    photometric = 2 if samples == 3 else int(not white_is_zero)
    rows = height // strips
    step = len(pixels) // strips
    entries = [(256, 3, [width]), (257, 3, [height]), (258, 3, [bits] * samples), (259, 3, [1]),
               (262, 3, [photometric]), (273, 4, [0] * strips), (277, 3, [samples]),
               (278, 3, [rows]), (279, 4, [step] * strips)]  # fmt: skip
    lists = 8 + 2 + 12 * len(entries) + 4
    sizes = {3: "H", 4: "I"}
    start = lists + sum(
        struct.calcsize(f"{len(values)}{sizes[kind]}")
        for _, kind, values in entries
        if struct.calcsize(f"{len(values)}{sizes[kind]}") > 4
    )
    directory, behind = struct.pack(f"{order}H", len(entries)), b""
    for tag, kind, values in entries:
        if tag == 273:
            values = [start + k * step for k in range(strips)]
        packed = struct.pack(f"{order}{len(values)}{sizes[kind]}", *values)
        directory += struct.pack(f"{order}HHI", tag, kind, len(values))
        if len(packed) > 4:
            directory += struct.pack(f"{order}I", lists + len(behind))
            behind += packed
        else:
            directory += packed.ljust(4, b"\0")
    mark = b"II*\0" if order == "<" else b"MM\0*"
    return mark + struct.pack(f"{order}I", 8) + directory + b"\0\0\0\0" + behind + pixels


def jpeg_files():
    return stored("grey.jpg", "colour.jpg", "progressive.jpg", "exif.jpg")


def pcd_files():
    fields = [("x", "f4", 1), ("y", "f8", 1), ("z", "f4", 1), ("i", "u1", 2)]
    rows = [[[x], [y], [z], [1, 2]] for x, y, z in TURNED_POINTS]
    flat = [("y", "f4", 1), ("x", "i2", 1)]
    return [
        *(pcd(fields, rows, kind) for kind in ("ascii", "binary", "binary_compressed")),
        pcd(flat, [[[1.5], [2]], [[-3.0], [4]]], "ascii"),
        pcd(flat, [[[1.5], [2]], [[-3.0], [4]]] * 20, "binary_compressed"),
    ]


def ply_files():
    axes = [("x", "f4"), ("y", "f8"), ("z", "f4")]
    flat = [("nx", "u1"), ("y", "i2"), ("x", "i2")]
    kinds = ("ascii", "binary_little_endian", "binary_big_endian")
    before = "element camera 2\nproperty uchar a\nproperty short b"
    faces = "element face 1\nproperty list uchar int vertex_indices"
    return [
        *(ply(axes, TURNED_POINTS, kind) for kind in kinds),
        ply(flat, [[1, 2, 3], [4, 5, 6]], kinds[0], before=b"1 2\n3 4\n", before_head=before),
        ply(flat, [[1, 2, 3], [4, 5, 6]], kinds[1], before=b"\1\2\0\3\4\0", before_head=before),
        ply(flat, [[1, 2, 3]], kinds[2], after=b"\3\0\0\0\0", after_head=faces),
    ]


def text_clouds():
    return [
        b"0.5 -1.25 0\n2 3.5 0.25\n-3.75 0 1e-3\n",
        b"# a cloud\n0.5,-1.25,0\n\n2,3.5,0.25\n",
        b"//X Y Z R\n0.5 -1.25 0 7\n2 3.5 0.25 8\n",
        b'\xef\xbb\xbf"i","y","x"\n1,0.5,2\n2,3.5,nan\n',
        b"0.5;-1.25\r\n2;3.5\r\n",
    ]


def npy_files():
    """Return tables of three columns, one stored by columns, and records, in three versions."""
    points = struct.pack("<12d", *(value for point in TURNED_POINTS for value in point))
    records = b"".join(struct.pack("<Bfd", 7, x, y) for x, y, _ in TURNED_POINTS)
    named = "[('i', '|u1'), ('x', '<f4'), ('y', '<f8')]"
    return [
        npy("'<f8'", "(4, 3)", points),
        npy("'<f8'", "(4, 3)", points, is_fortran=True),
        npy("'>i2'", "(6, 2)", bytes(range(24)), version=2),
        npy(named, "(4,)", records, version=3),
    ]


def npy(kind, shape, data, *, is_fortran=False, version=1):
    """Return an npy file with a short header."""
    head = f"{{'descr': {kind}, 'fortran_order': {is_fortran}, 'shape': {shape}, }}\n".encode()
    return (
        b"\x93NUMPY" + bytes([version, 0])
        + struct.pack("<H" if version == 1 else "<I", len(head)) + head + data
    )  # fmt: skip


def npy_members(file):
    """Return the members of an npz as one text that can be damaged: names, and bare bytes."""
    import zipfile

    with zipfile.ZipFile(io.BytesIO(file)) as archive:
        return b"".join(b"\n@@%s@@\n" % name.encode() + archive.read(name)
                        for name in archive.namelist())  # fmt: skip


def zipped(text):
    """Return the zip file of such a text, its checksums right: so damage gets further in."""
    words = re.split(rb"\n@@([^@]*)@@\n", text)
    names, bodies = words[1::2], words[2::2]
    front, directory = b"", b""
    for name, body in zip(names, bodies, strict=True):
        facts = struct.pack("<HHHHHIIIHH", 20, 0, 0, 0, 33, zlib.crc32(body), len(body), len(body),
                            len(name), 0)  # fmt: skip
        directory += b"PK\1\2\x14\0" + facts + b"\0" * 10 + struct.pack("<I", len(front)) + name
        front += b"PK\3\4" + facts + name + body
    end = struct.pack("<HHHHIIH", 0, 0, len(names), len(names), len(directory), len(front), 0)
    return front + directory + b"PK\5\6" + end


def carmen_logs():
    """Return logs with all kinds of lines."""
    wide = " ".join(str(k % 7) for k in range(180))
    flaser = f"FLASER 180 {wide} 1 2 0.3 1 2 0.3 1.5 host 1.5\n"
    short = "0.5 1.25 2 81 3.5 0.1"
    robot = "\n".join(
        f"ROBOTLASER1 0 -0.5 1.0 0.2 80 0.01 0 6 {short} 0 {t} 2 0.3 1 2 0.3 0 0 0 0 0 {t}.5 h 2.0"
        for t in range(3)
    )
    raw = "ODOM 1 2 0.3 0 0 0 1.0 host 1.0\n" + "".join(
        f"RAWLASER1 0 -0.5 1.0 0.2 80 0.01 0 6 {short} 2 7 8 {t}.0 host 3.0\n" for t in (3, 4)
    )
    logs = [f"# a log\nPARAM robot_width 0.3 nohost 0\n{flaser}", f"{robot}\n", raw, robot + raw]
    return [log.encode() for log in logs]


def gzipped(data):
    """Return a gzip file that stores data as they are."""
    check = struct.pack("<II", zlib.crc32(data), len(data))
    return b"\x1f\x8b\x08" + b"\0" * 6 + b"\xff" + _stored(data) + check


def _zlib(data):
    return b"\x78\x01" + _stored(data) + struct.pack(">I", zlib.adler32(data))


def _stored(data):
    """Return a deflate stream that compresses nothing: others depend on the library."""
    blocks = [data[k : k + 65535] for k in range(0, len(data), 65535)] or [b""]
    heads = (struct.pack("<BHH", k + 1 == len(blocks), len(block), 65535 - len(block))
             for k, block in enumerate(blocks))  # fmt: skip
    return b"".join(head + block for head, block in zip(heads, blocks, strict=True))


def scan_texts():
    """Return poses, angles and ranges, which fit."""
    return {
        "poses.txt": b"0,0,0.1\n1,0.5,-3\n1,2,9\n",
        "angles.txt": b"-1.5,-0.5,0.5,1.5\n",
        "ranges.txt": b"1,2.5,inf,0\n3,nan,4,5\n1,1,1,1e3\n",
    }


def pose_files():
    return [
        b"0.5 -1 0.1\n2 3 -3\n",
        b"x,y,yaw\n0.5,-1,0.1\n# end\n2,3,7\n",
        b"1 2 3 4 0 0 0 1\n2.5 2 3 4 0 0 0.6 0.8\n",
        b"\xef\xbb\xbf0.5;-1;0.1\r\n2;3;-3\r\n",
    ]


def point_files():
    return [
        b"0.5,-1\n2,3e-1\n",
        b'x,y\n# some\n0.5, -1\n[2, 3.5]\n{"x": 1, "y": -2}\n',
        b"0.5,-1\r\n2,3\r\n7,8",
        b"[1, 2]\n\nnan,1\n[1e400, 2]\n",
    ]


def named_point_files():
    return [
        b"kitchen=0.5,-1\n2,3e-1\na b = 1,2\n",
        b'x,y\n# some\n{"name": "hall", "x": 1, "y": -2}\n[2, 3.5]\n=1,2\n',
        b'dock=0.5\r\n{"name": 3, "x": 1, "y": 2}\r\na=b=1,2',
    ]


def pose_line_files():
    return [
        b"0.5,-1,0.1\n2,3e-1,-3\n",
        b'x y theta\n# some\n0.5 -1 2\n[2, 3.5, 1]\n{"x": 1, "y": -2, "yaw": 0.5}\n',
        b"0.5;-1;1\r\n5 1 2 0 0 0 0.6 0.8\r\n7,8,9",
        b"[1, 2, 3]\n\nnan,1,2\n5 1 2 0 0 0 0 0\n5 1 2 0 0.6 0 0 0.8\n[1e400, 2, 0]\n",
    ]


def pair_files():
    return [
        b"0.5,-1,2,3e-1\n1,2,3,4\n",
        b'from_x,from_y,to_x,to_y\n# some\n0.5, -1, 2, 3\n[[2, 3.5], {"x": 1, "y": -2}]\n',
        b'{"from": [1, 2], "to": [3, 4]}\r\n2,3,7,8',
        b"[[1, 2], [3, 4]]\n\nnan,1,1,1\n[[1e400, 2], [1, 1]]\n",
    ]


SHAPES_YAML = [
    b"shapes:\n- {type: polygon, points: [[0, 0], [1, 0], [1, 2.5]], value: 100}\n",
    b"shapes: [{type: circle, center: [1, 2], radius: 0.5}]\n",
    b"shapes:\n- type: line\n  points: [[0, 1], [2, 1e1]]\n  thickness: .5\n  value: -1\n",
    b"shapes: [{type: polygon, points: [[0,0],[9,0],[9,9]], holes: [[[2,2],[3,2],[3,3]]]}]\n",
]


def geojson_files():
    square = [[0, 0], [4, 0], [4, 3.5], [0, 3.5], [0, 0]]
    hole = [[1, 1], [2, 1], [2, 2], [1, 1]]
    point = {"type": "Point", "coordinates": [1, 2, 3]}
    line = {"type": "MultiLineString", "coordinates": [[[0, 0], [1, 1]], [[2, 2], [3, 1]]]}
    features = [
        {"type": "Feature", "properties": {"value": 100},
         "geometry": {"type": "Polygon", "coordinates": [square, hole]}},
        {"type": "Feature", "properties": {"radius": 0.5, "value": 0}, "geometry": point},
        {"type": "Feature", "properties": {"thickness": 0.2}, "geometry": line},
        {"type": "Feature", "properties": {"radius": 1},
         "geometry": {"type": "GeometryCollection", "geometries": [point, point]}},
    ]  # fmt: skip
    whole = {"type": "FeatureCollection", "features": features}
    shapes = [whole, *features, {"type": "MultiPolygon", "coordinates": [[square], [hole]]}]
    return [json.dumps(shape).encode() for shape in shapes]


TRANSFORMS = [
    b'{"x": 1.5, "y": -2, "yaw": 0.25}',
    json.dumps(
        {
            "first": {"file": "a.yaml", "sha256": {"a.yaml": "0" * 64, "a.pgm": "1" * 64}},
            "second": {"file": "b.yaml", "sha256": {"b.yaml": "a" * 64}},
            "same_place": True,
            "transform": {"x": -12.25, "y": 3.5, "yaw": 1.5},
        }
    ).encode(),
]
ANSWERS = {
    "lint": {
        "parameter_files": [{"file": "nav2.yaml", "findings": [], "suppressed": 0}],
        "maps": [
            {
                "file": "a<b>.yaml",
                "findings": [
                    {"check": "map.islands", "severity": "warning", "line": None,
                     "message": "<img onerror=1>\n\x07", "places": [[1.5, -2], [0, 3]]},
                    {"check": "yaml.origin-yaw", "severity": "note", "line": 3,
                     "message": "turned", "places": []},
                ],
                "suppressed": 2,
                "repairs": ["free_thresh 0.196"],
            }
        ],
        "errors": 0, "warnings": 1, "notes": 1, "suppressed": 2,
    },
    "reach": {
        "robot": {"footprint": [[0.3, 0.2], [0.3, -0.2], [-0.3, 0]], "inscribed_radius": 0.1,
                  "circumscribed_radius": 0.36, "headings": 16},
        "start": {"x": 1.5, "y": -2, "yaw": 0.5},
        "through_unknown": False,
        "reachable_m2": 8.5, "open_m2": 12, "free_m2": 20.25, "share": 0.42,
        "goals": [
            {"name": "dock", "x": 3, "y": 4, "reachable": True, "heading_count": 7,
             "widest_radius_m": None, "limited_by": None, "reason": None, "nearest_open": None},
            {"x": -3, "y": 4, "reachable": False, "heading_count": 0, "widest_radius_m": 0.31,
             "limited_by": {"x": -2, "y": 1, "width_m": 0.62, "at": "passage"},
             "reason": "unknown", "nearest_open": {"x": -3, "y": 4.5}},
        ],
        "passages": [{"x": -2, "y": 1, "width_m": 0.62, "cuts_off_m2": 12.3, "open": False,
                      "ends": [[-2, 0.7], [-2, 1.3]]}],
    },
    "route": {
        "method": "descent", "reached": False, "start": [0, 1], "goal": [2.5, 1], "length_m": 1.0,
        "min_clearance_m": 0.4, "mean_clearance_m": None, "cost": 1.25, "expanded": None,
        "optimal": False, "local_minimum": [1, 1], "points": [[0, 1], [1, 1]],
    },
    "diff": {
        "first": {"file": "a.yaml", "sha256": {"a.yaml": "ab" * 32, "a.pgm": "0" * 64}},
        "second": None,
        "equal": False,
        "geometry": {"width": [3, 4], "origin": [[0, 0, 0], [1, 0, 0.5]]},
        "metadata": {"mode": ["trinary", "scale"]},
        "common_cells": 12, "differing": 3, "beyond_tolerance": 2, "known_only_in_first": 1,
        "confusion": {"free": {"free": 9, "occupied": 3}},
        "symmetry": "transposed",
        "walls": {"first_to_second": {"largest": 0.5, "percentile_95": 0.4, "mean": 0.1},
                  "second_to_first": None},
        "bounds": {"max_shift": {"allowed": 0.1, "found": None, "holds": False}},
        "passes": False,
    },
    "comparison": {
        "format": "mapdeal-comparison/1", "version": "0.1", "inputs": ["a.log"], "limits": {},
        "width": 4, "height": 3, "resolution": 0.1, "origin": [1, 2, 0],
        "methods": {"tsdf": {"parameters": {"k": 1}, "occupied": 3, "mean_thickness_m": None,
                             "vanished": [{"x": 1.25, "y": 2.5, "cells": 4}]}},
        "pairs": [{"first": "tsdf", "second": "beams", "differing": 5, "cells": {}}],
    },
    "alignment": {
        "format": "mapdeal-alignment/1",
        "first": {"file": "a<b>.yaml", "sha256": {"a<b>.yaml": "ab" * 32}}, "second": None,
        "same_place": False, "reason": "another <place> fits", "score": 3.5, "runner_up": 3.25,
        "transform": {"x": 1.5, "y": -2, "yaw": 0.25, "yaw_deg": 14.3},
        "runner_up_transform": None, "overlap": 0.5, "agreement": 1,
    },
    "score": {
        "format": "mapdeal-score/1",
        "map": {"file": "a<b>.yaml", "sha256": {"a<b>.yaml": "ab" * 32}}, "truth": None,
        "transform": {"x": 1.5, "y": -2, "yaw": 0.25, "yaw_deg": 14.3, "by": "align"},
        "lattice": {"width": 4, "height": 3, "resolution": 0.25, "origin": [1, 2, 0]},
        "values": {"cells": [3, 4], "coverage": 0.9, "ssim_gauss": None,
                   "dist_est_to_truth_m": {"n": 7, "mean": 0.5}},
        "bounds": [{"name": "coverage", "side": "min", "allowed": 0.8, "found": 0.9, "holds": True},
                   {"name": "ssim_gauss", "side": "max", "allowed": 1, "found": None,
                    "holds": False}],
        "passes": False,
    },
}  # fmt: skip
"""What mapdeal writes as JSON."""

RECIPES = [
    b"stages:\n  - inflate:\n  - esdf:\n  - cost:\n",
    b"stages: [inflate: {kernel: square, radius: 0.5}, esdf: {unknown: free, view: per-map}]\n",
    b"stages:\n  - active\n  - esdf: {max_distance: 2}\n  - cost: {model: rings}\n",
    b"stages: [{cost: {inscribed_radius: 0.22, inflation_radius: .7, cost_scaling_factor: 3.0}}]\n",
    b"stages:\n- cost:\n    model: layers\n    layers: [static, inflation: {lookup: nav2}]\n",
]

LINT_CONFIGS = [
    b'[lint]\nselect = ["image", "yaml.origin-yaw"]\nignore = ["image.greys"]\nstrict = true\n',
    b'[tool.mapdeal.lint]\nseverity = {"map" = "note"}\nper-file-ignores = {"old/*" = ["all"]}\n',
    b'[lint]\nselect = ["all"]\n\n[lint.severity]\nmap = "note"\n',
]

ROS1_PARAMETERS = [
    (b"footprint: [[-0.2, -0.1], [-0.2, 0.1], [0.3, 0.1]]\nstatic_map: true\nmap_type: voxel\n"
     b"inflation_radius: 0.8\nlethal_cost_threshold: 60.5\nx: deg(90)\n"),
    (b"move_base:\n  global_costmap: &g\n    robot_radius: 0.2\n    plugins:\n"
     b"      - {name: static_layer, type: 'costmap_2d::StaticLayer'}\n"
     b"      - {name: inflation_layer, type: 'costmap_2d::InflationLayer'}\n"
     b"    static_layer: {enabled: true, track_unknown_space: no, unknown_cost_value: -1}\n"
     b"    inflation_layer: {inflation_radius: 1, cost_scaling_factor: 3.0}\n"
     b"  local_costmap: {<<: *g, footprint: '[[1, 1], [-1, 1], [0, -1]]', width: 4}\n"),
]  # fmt: skip

ROS2_PARAMETERS = [
    (b"global_costmap:\n  global_costmap:\n    ros__parameters:\n      robot_radius: 0.22\n"
     b"      width: 3\n      track_unknown_space: True\n"
     b"      plugins: [\"static_layer\", \"inflation_layer\"]\n"
     b"      static_layer: {plugin: \"nav2_costmap_2d::StaticLayer\"}\n"
     b"      inflation_layer:\n        plugin: \"nav2_costmap_2d::InflationLayer\"\n"
     b"        inflation_radius: 0.55\n        cost_scaling_factor: 3.0\n"),
    (b"/**:\n  ros__parameters: {use_sim_time: yes, n: 010}\n/o: {ros__parameters: {e: []}}\n"
     b"/r/local_costmap:\n"
     b"  local_costmap: {ros__parameters: {footprint: '[[1, 1], [-1, 1], [0, -1]]',\n"
     b"      footprint_padding: !!float 1, filters: [k], k.plugin: x::KeepoutFilter}}\n"),
]  # fmt: skip

MANIFEST = {
    "mapdeal": "1.0", "inputs": {"m.pgm": "00aa", "m.yaml": "11aa"}, "options": {"sim": False},
    "stages": [{"inflate": {"radius": 0.3, "kernel": "disc"}}, {"esdf": {"unknown": "free"}}],
    "figures": {"inflate": {"occupied": 7, "free": 41}, "esdf": {"lowest": -0.5, "highest": None}},
    "outputs": {"inflated.pgm": "2222", "esdf.npz": "33aa", "esdf.png": "44aa"},
}  # fmt: skip

SHOWN_RUN = {
    **MANIFEST, "version": "1.0", "warnings": ["m.yaml: is odd"],
    "stages": [{"esdf": {"unknown": "free"}}, {"cost": {"inflation_radius": 0.5}}],
    "figures": {
        "esdf": {"width": 8, "height": 6, "resolution": 0.5, "obstacles": 7, "free": 41},
        "cost": {"width": 8, "height": 6, "resolution": 0.5, "lethal": 7, "highest_distance": 2.5},
    },
    "outputs": {"esdf.npz": "33aa", "cost.npz": "44aa", "reach.json": "55aa", "cost.png": "66aa"},
}  # fmt: skip
SUMMARY = {
    "maps": [
        {"map": "a/m.yaml", "folder": "a/m", "status": "done", "figures": {}, "local": {}},
        {"map": "b.yaml", "folder": "b", "status": "failed", "error": "b.yaml: is empty"},
    ]
}

LAYER_SETTINGS = [
    b"[static, {inflation: {inflation_radius: 0.7, lookup: nav2}}]",
    b"[{static: {name: a, track_unknown_space: no, unknown_cost_value: -1}}]",
]

FOOTPRINTS = [
    b"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]",
    b"[[.5,0],[-1e-1,+.3],[-0.1,-.3]]",
    b"[ [1, 0] , [0, 1] , [-1, -1] ]",
]

PARAMETERS = [
    b"0.3", b"1e-3", b"90,70,50", b"yes", b"none", b"per-map", b"square", b"254", b"1.5,-2",
    b"[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]",
]  # fmt: skip

SETTINGS = [b"cost.cost_scaling_factor=3", b"inflate.radius = .5", b"esdf.unknown=free"]
PAIRS = [b"1.5,-2e3", b"0, .5"]
SIZES = [b"500M", b"4GiB", b"1.5 kB", b"4096", b"0.5g", b"2TB"]


def bag_metadata(file, storage):
    """Return the metadata of a folder with one file."""
    return (
        f"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n"
        f"  relative_file_paths: [{file}]\n  topics_with_message_count:\n"
        "  - topic_metadata: {name: /map, type: nav_msgs/msg/OccupancyGrid, "
        "serialization_format: cdr}\n    message_count: 1\n"
        '  compression_format: ""\n  compression_mode: ""\n'
    ).encode()


def stored_bags():
    """Return a small bag in each container: a map, costs, two scans, transforms, and a cloud."""
    import sqlite3
    import tempfile

    import numpy as np
    from mcap.writer import CompressionType

    from bags import making

    def maker(*, has_costs):
        made = making.Maker()
        grid = making.occupancy(making.START, [[-1, 0, 100], [0, 50, 0]], 0.25, (1.0, 2.0, 0.3))
        made.add("/map", "nav_msgs/msg/OccupancyGrid", making.START, grid)
        if has_costs:
            costs = making.costmap(making.START, [[0, 253, 255]], 0.25, (1.0, 2.0, 0.0))
            made.add("/costs", "nav2_msgs/msg/Costmap", making.START, costs)
        mount = ("base_link", "laser", (0.2, 0, 0.5), (0, 0, 0, 1))
        made.add("/tf_static", "tf2_msgs/msg/TFMessage", making.START,
                 making.tf(making.START, mount))  # fmt: skip
        for k in range(2):
            time = making.START + k * 1000
            move = ("map", "base_link", (k / 4, 1, 0), (0, 0, 0, 1))
            made.add("/tf", "tf2_msgs/msg/TFMessage", time, making.tf(time, move))
            seen = making.scan(time, [1.0, 2.0, np.inf, 0.5], step=0.5)
            made.add("/scan", "sensor_msgs/msg/LaserScan", time, seen)
            made.add("/odom", "nav_msgs/msg/Odometry", time, making.odometry(time, k, 1, 0.1))
        points = np.array([[1, 0.5, 0], [2, np.nan, 1]], "<f4").tobytes()
        fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
        cloud = making.cloud(making.START, points, fields, width=2, step=12)
        made.add("/points", "sensor_msgs/msg/PointCloud2", making.START, cloud)
        return made

    files = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for form, called in (("ros1", "plain.bag"), ("ros1-lz4", "lz4.bag")):
            path = maker(has_costs=False).write(folder, form)
            files[called] = path.read_bytes()
            path.unlink()
        maker_ = maker(has_costs=True)
        for kind in (CompressionType.NONE, CompressionType.ZSTD):
            path = maker_._write_mcap(folder / f"{kind.name}.mcap", kind)
            files[f"{kind.name.lower()}.mcap"] = path.read_bytes()
        path = maker_.write(folder, "sqlite3") / "bag.db3"
        db = sqlite3.connect(path)
        db.execute("PRAGMA page_size = 512")
        db.execute("VACUUM")
        db.close()
        files["bag.db3"] = path.read_bytes()
    return files


def write_stored():
    """Write the files that libraries compress, those that are not there yet."""
    import numpy as np
    from PIL import Image

    from mapdeal import Costmap, Footprint, OccupancyGrid, Reach, esdf, potential
    from mapdeal.maps.npz import write_npz

    grey = Image.frombytes("L", (WIDTH, HEIGHT), PIXELS)

    def saved(image, kind, **options):
        file = io.BytesIO()
        image.save(file, kind, **options)
        return file.getvalue()

    def npz(grid, **more):
        file = io.BytesIO()
        write_npz(file, grid, more=more)
        return file.getvalue()

    def arrays(**named):
        file = io.BytesIO()
        np.savez_compressed(file, **named)
        return file.getvalue()

    values = np.array([-1, 0, 100, 0, 50])[np.arange(12).reshape(3, 4) % 5]
    grid = OccupancyGrid(values, 0.25, (1.0, 2.0, 0.3))
    costs = np.arange(12, dtype=np.uint8).reshape(3, 4) * 23
    reached = Reach(
        values == 0, (values == 0) * 8, np.abs(values) / 8.0, (values == 0) / 4.0, values, 0.25,
        (1.0, 2.0, 0.3), start=(1.3, 2.3, 0.5), heading_count=8,
        robot=Footprint.polygon([(0.2, 0.1), (-0.1, 0.1), (-0.1, -0.1)]),
    )  # fmt: skip
    exif = Image.Exif()
    exif[0x0112] = 6
    files = {
        "lzw.tiff": saved(grey, "TIFF", compression="tiff_lzw"),
        "deflate.tiff": saved(grey, "TIFF", compression="tiff_adobe_deflate"),
        "packbits.tiff": saved(grey, "TIFF", compression="packbits"),
        "group4.tiff": saved(grey.convert("1"), "TIFF", compression="group4"),
        "jpeg.tiff": saved(grey, "TIFF", compression="jpeg"),
        "big.tiff": saved(grey, "TIFF", big_tiff=True),
        "palette.tiff": saved(grey.quantize(4), "TIFF"),
        "rgba.tiff": saved(grey.convert("RGBA"), "TIFF"),
        "grey.jpg": saved(grey, "JPEG"),
        "colour.jpg": saved(grey.convert("RGB"), "JPEG"),
        "progressive.jpg": saved(grey, "JPEG", progressive=True, optimize=True),
        "exif.jpg": saved(grey, "JPEG", exif=exif, optimize=True),
        "occupancy.npz": npz(grid),
        "field.npz": npz(esdf(grid)),
        "costs.npz": npz(Costmap(costs, 0.25, (1.0, 2.0, 0.3), circumscribed_cost=99)),
        "potential.npz": npz(potential(grid, goal=(1.3, 2.3))),
        "reach.npz": npz(reached),
        "odds.npz": npz(grid, log_odds=np.arange(12.0).reshape(3, 4) * 7 + 20),
        "hits.npz": npz(grid, hits=np.int32(costs // 23), misses=np.int32(costs % 7)),
        "points.npz": arrays(points=np.array(TURNED_POINTS)),
        "scans.npz": arrays(
            poses=np.arange(9.0).reshape(3, 3), angles=np.array([-1.0, 0.0, 1.0, 2.0]),
            ranges=np.arange(12.0).reshape(3, 4),
        ),
        **stored_bags(),
    }  # fmt: skip
    STORED.mkdir(exist_ok=True)
    for name, data in files.items():
        if not (STORED / name).exists():
            (STORED / name).write_bytes(data)


if __name__ == "__main__":
    write_stored()
