"""Large files of every kind that is read, for measures of memory."""

import struct

import numpy as np
from PIL import Image

from bad_maps import yaml_text
from mapdeal import Costmap, OccupancyGrid, PotentialField, esdf, write_map
from maps.pictures import adam7

SHAPE = H, W = 2000, 2500
POINTS = 600_000
GREYS = np.tile(np.arange(250, dtype=np.uint8), (H, W // 250))


def yaml_for(image):
    image.with_suffix(".yaml").write_text(yaml_text(image=image.name))


def pillow(mode, **options):
    def write(path):
        if mode == "I;16":
            image = Image.fromarray(GREYS.astype(np.uint16) * 257)
        else:
            image = Image.fromarray(np.dstack([GREYS] * 3)).convert(mode)
        image.save(path, **options)
        yaml_for(path)

    return write


def by_function(make):
    def write(path):
        path.write_bytes(make())
        yaml_for(path)

    return write


def text(per_row):
    return (H // 2) * (b" ".join(b"%d" % (k % 250) for k in range(per_row)) + b"\n")


MODES = {
    "grey.png": "L", "colours.png": "RGB", "opacity.png": "RGBA", "both.png": "LA",
    "palette.png": "P", "bits.png": "1", "wide.png": "I;16", "raw.tif": "L", "grey.bmp": "L",
    "colours.bmp": "RGB", "opacity.bmp": "RGBA", "grey.jpg": "L", "colours.jpg": "RGB",
}  # fmt: skip
IMAGES = {
    **{name: pillow(mode) for name, mode in MODES.items()},
    "interlaced.png": by_function(lambda: adam7(GREYS)),
    "grey.tif": pillow("L", compression="tiff_adobe_deflate"),
    "colours.tif": pillow("RGB", compression="tiff_lzw"),
    "fax.tif": pillow("1", compression="group4"),
    "progressive.jpg": pillow("RGB", progressive=True),
    "p1.pbm": by_function(lambda: b"P1\n%d %d\n" % (W, H) + b"0 1 " * (H * W // 2)),
    "p2.pgm": by_function(lambda: b"P2\n%d %d\n255\n" % (W, H // 2) + text(W)),
    "p3.ppm": by_function(lambda: b"P3\n%d %d\n255\n" % (W, H // 2) + text(3 * W)),
    "p4.pbm": by_function(lambda: b"P4\n%d %d\n" % (8 * (W // 8), H) + bytes(W // 8 * H)),
    "p5.pgm": by_function(lambda: b"P5\n%d %d\n255\n" % (W, H) + bytes(W * H)),
    "p5-wide.pgm": by_function(lambda: b"P5\n%d %d\n999\n" % (W, H) + bytes(2 * W * H)),
    "p6.ppm": by_function(lambda: b"P6\n%d %d\n255\n" % (W, H) + bytes(3 * W * H)),
}


def npz(make):
    def write(path):
        cells = np.zeros(SHAPE, np.int8)
        cells[::50, ::7] = 100
        write_map(path, make(OccupancyGrid(cells, 0.05)))

    return write


GRIDS = {
    "map.npz": npz(lambda grid: grid),
    "cost.npz": npz(lambda grid: Costmap(grid.occupancy.astype(np.uint8), 0.05)),
    "field.npz": npz(esdf),
    "potential.npz": npz(lambda grid: PotentialField(
        np.ones(SHAPE), grid.occupancy, 0.05, goal=(1.0, 2.0))),
}  # fmt: skip


def compressed_pcd(path):
    """Literal runs of 32 bytes."""
    count = POINTS // 8 * 8
    raw = np.ones((3, count), "<f4").tobytes()
    runs = np.full((len(raw) // 32, 33), 31, np.uint8)
    runs[:, 1:] = np.frombuffer(raw, np.uint8).reshape(-1, 32)
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    head += f"WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA binary_compressed\n"
    path.write_bytes(head.encode() + struct.pack("<II", runs.size, len(raw)) + runs.tobytes())


def arrays(**arrays):
    return lambda path: np.savez(path, **arrays)


def lines(line, count):
    return lambda path: path.write_text("".join(line.format(k) for k in range(count)))


OTHER_READERS = {
    "columns.npz": arrays(points=np.ones((POINTS, 3), order="F")),
    "compressed.pcd": compressed_pcd,
    "all.npz": arrays(points=np.ones((POINTS, 3), np.int8)),
    "poses.txt": lines("1 2 0.5\n", POINTS // 3),
    "tum.txt": lines("{} 1 2 0 0 0 0 1\n", POINTS // 6),
    "log.npz": arrays(poses=np.ones((POINTS, 3)), angles=np.ones(2), ranges=np.ones((POINTS, 2))),
}
