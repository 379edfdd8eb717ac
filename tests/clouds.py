"""Clouds written by hand, as the formats' descriptions have it, and LZF by the simplest means."""

import struct

KINDS = {"f4": ("F", 4, "f"), "f8": ("F", 8, "d"), "i2": ("I", 2, "h"), "u1": ("U", 1, "B"),
         "i4": ("I", 4, "i"), "u8": ("U", 8, "Q")}  # fmt: skip
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
    kinds = [KINDS[kind] for _, kind, _ in fields]
    lines = [
        "# .PCD v.7 - Point Cloud Data file format",
        "VERSION .7",
        "FIELDS " + " ".join(name for name, _, _ in fields),
        "SIZE " + " ".join(str(size) for _, size, _ in kinds),
        "TYPE " + " ".join(letter for letter, _, _ in kinds),
        "COUNT " + " ".join(str(n) for _, _, n in fields),
        f"WIDTH {count if width is None else width}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        f"DATA {data}",
    ]
    return "".join(f"{line}\n" for line in lines).encode()


def pcd(fields, rows, data="binary", *, padding=b""):
    """Return a PCD file; each row has a list of numbers for every field."""
    head = pcd_header(fields, len(rows), data)
    if data == "ascii":
        lines = [" ".join(repr(v) for values in row for v in values) for row in rows]
        return head + "".join(f"{line}\n" for line in lines).encode() + padding
    codes = [KINDS[kind][2] for _, kind, _ in fields]
    if data == "binary":
        body = b"".join(
            struct.pack(f"<{len(values)}{code}", *values)
            for row in rows
            for code, values in zip(codes, row, strict=True)
        )
        return head + body + padding
    columns = b"".join(
        struct.pack(f"<{len(row[k])}{code}", *row[k])
        for k, code in enumerate(codes)
        for row in rows
    )
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
        codes = order + "".join(KINDS[kind][2] for _, kind in fields)
        body = b"".join(struct.pack(codes, *row) for row in rows)
    return head + before + body + after
