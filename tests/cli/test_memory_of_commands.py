"""Commands take no more memory than they were allowed, and refuse in time what would take more.

Processes of their own are measured, since a peak is never taken back.
"""

import re
import struct
import subprocess
import sys
import zipfile
import zlib

import numpy as np
import pytest
from numpy.lib import format as npy_format

from mapdeal import (
    BitMap,
    Costmap,
    OccupancyGrid,
    PotentialField,
    esdf,
    read_map,
    write_bit_map,
    write_map,
)
from mapdeal.grid.canvas import on_canvas
from mapdeal.kernels.engine import engine_name
from mapdeal.maps.npz import write_npz

pytestmark = pytest.mark.thorough

IS_COMPILED = engine_name() == "compiled"
MOST = 100  # MB that bombs may take, the program's own included
SLACK = 1.05
GEOMETRY = {
    "format": np.array("mapdeal/1"),
    "resolution": np.float64(0.05),
    "origin": np.array([1.5, -2.0, 0.4]),
}

# The peak of a process begins with that of its parent: this one is small.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, *sys.argv[1:]])
_, status, usage = os.wait4(process.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def measured(folder, *words):
    """Exit code, what it said and peak bytes of a command."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, "-m", "mapdeal", *map(str, words)],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    *out, peak = done.stdout.splitlines()
    return done.returncode, "\n".join(out) + done.stderr, int(peak) * 1024


def yaml_of(path, image):
    thresholds = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    path.write_text(f"image: {image}\nresolution: 0.05\norigin: [1.5, -2.0, 0.4]\n{thresholds}")


def sparse(path, head, size):
    """A file whose pixels are zeros that take no room on the disk."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(len(head) + size)


def zeros_npz(path, small, **arrays):
    """An npz with arrays of zeros, given shape and type: a thousandth of their size."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, value in small.items():
            with archive.open(f"{name}.npy", "w") as file:
                npy_format.write_array(file, np.asarray(value))
        for name, (shape, dtype, *rest) in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                facts = {"descr": dtype, "fortran_order": bool(rest), "shape": shape}
                npy_format.write_array_header_1_0(file, facts)
                left = int(np.prod(shape)) * np.dtype(dtype).itemsize
                while left:
                    file.write(bytes(min(left, 1 << 22)))
                    left -= min(left, 1 << 22)


def lzf_cloud(path, points):
    """A cloud whose compressed bytes are one zero and copies of it."""
    copies = 3 * points // 264
    data = b"\0\0" + b"\xe0\xff\x00" * copies
    size = 1 + 264 * copies
    while size % 3:
        data, size = data + b"\0\0", size + 1
    head = "VERSION .7\nFIELDS x y z\nSIZE 1 1 1\nTYPE U U U\nCOUNT 1 1 1\n"
    head += f"WIDTH {size // 3}\nHEIGHT 1\nPOINTS {size // 3}\nDATA binary_compressed\n"
    path.write_bytes(head.encode() + struct.pack("<II", len(data), size) + data)


def tiny_tiff(path, side):
    """A TIFF that claims rows for which it has no bytes."""
    tags = [
        (256, 4, side), (257, 4, side), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 134),
        (277, 3, 1), (278, 4, side), (279, 4, 100),
    ]  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    data = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", 0)
    path.write_bytes(data.ljust(134, b"\0") + bytes(186))


def tile_tiff(path, side):
    """A TIFF of a few pixels in one large tile."""
    tags = [
        (256, 4, 10), (257, 4, 10), (258, 3, 8), (259, 3, 5), (262, 3, 1), (277, 3, 1),
        (322, 4, side), (323, 4, side), (324, 4, 200), (325, 4, 1000),
    ]  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    data = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", 0)
    path.write_bytes(data.ljust(1200, b"\0"))


def long_header(path):
    """An npz of which the header of an array is blanks."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "points.npy", b"\x93NUMPY\2\0" + struct.pack("<I", 1 << 27) + b" " * (1 << 27)
        )


def blank_png(path, side):
    """A PNG of one grey."""

    def chunk(name, body):
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    row = bytes(side + 1)
    pixels = zlib.compressobj(9)
    body = b"".join(pixels.compress(row) for _ in range(side)) + pixels.flush()
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    png = chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + png)


def scans(path, poses):
    angles = np.zeros(3)
    np.savez(path, poses=poses, angles=angles, ranges=np.ones((len(poses), 3)))


@pytest.fixture(scope="module")
def bombs(tmp_path_factory):
    """Files that ask for much more memory than they are long."""
    folder = tmp_path_factory.mktemp("bombs")
    layer = (9000, 9000)
    zeros_npz(folder / "log.npz", {"angles": np.zeros(3)}, poses=((12_000_000, 3), "|i1"),
              ranges=((12_000_000, 3), "|i1"))  # fmt: skip
    numbers = {"attractive_gain": 1.0, "repulsive_gain": 1.0, "repulsive_cap": 1e5,
               "goal": np.array([2.0, 2.0])}  # fmt: skip
    zeros_npz(folder / "potential.npz", GEOMETRY | numbers, occupancy=((3000, 3000), "|i1"),
              repulsive=((3000, 3000), "<f8"))  # fmt: skip
    zeros_npz(folder / "field.npz", GEOMETRY | {"convention": "fast-planner", "strength": 1.0,
              "max_distance": 1.0, "lethal_threshold": 100, "unknown": "free"},
              distance=((4000, 4000), "<f4"), occupancy=((4000, 4000), "|i1"))  # fmt: skip
    zeros_npz(folder / "cost.npz", GEOMETRY | {"cost_scale": "costmap2d"}, cost=(layer, "|u1"))
    zeros_npz(folder / "map.npz", GEOMETRY, occupancy=(layer, "|i1"))
    zeros_npz(folder / "columns.npz", {}, points=((5_000_000, 3), "<f8", "by columns"))
    lzf_cloud(folder / "lzf.pcd", 40_000_000)
    long_header(folder / "header.npz")
    head = b"\x93NUMPY\2\0" + struct.pack("<I", 1 << 28)
    sparse(folder / "header.npy", head, 1 << 28)
    tile_tiff(folder / "tile.tif", 20_000)
    tiny_tiff(folder / "tiny.tif", 14_000)
    blank_png(folder / "blank.png", 9000)
    sparse(folder / "grey.pgm", b"P5\n9000 9000\n255\n", 9000 * 9000)
    sparse(folder / "wide.pgm", b"P5\n6000 6000\n65535\n", 2 * 6000 * 6000)
    sparse(folder / "colour.ppm", b"P6\n6000 6000\n255\n", 3 * 6000 * 6000)
    sparse(folder / "bits.pbm", b"P4\n16000 16000\n", 2000 * 16000)
    sparse(folder / "bits8.pbm", b"P4\n16000 16000\n", 2000 * 16000)
    (folder / "text.pgm").write_bytes(b"P2\n5000 5000\n255\n" + b"0 " * 25_000_000)
    images = ("tiny.tif", "tile.tif", "blank.png", "grey.pgm", "wide.pgm", "colour.ppm",
              "bits.pbm", "bits8.pbm", "text.pgm")  # fmt: skip
    for image in images:
        yaml_of(folder / f"{image.split('.')[0]}.yaml", image)
    grid = OccupancyGrid(np.zeros((20, 30), np.int8), 0.05, (1.5, -2.0, 0.4))
    write_map(folder / "small.yaml", grid)
    write_map(folder / "far.yaml", OccupancyGrid(grid.occupancy, 0.05, (200.0, 200.0, 0.4)))
    scans(folder / "far-scans.npz", np.array([[0.0, 0, 0], [200, 200, 0]]))
    np.save(folder / "cloud.npy", np.ones((10, 3)))
    (folder / "shapes.geojson").write_text(
        '{"type": "Feature", "properties": [' + "{}," * 9_000_000
    )
    return folder


OUT = ["-o", "out.yaml", "-q"]
BOMBS = {
    "scans": ["build", "log.npz", *OUT],
    "potential": ["info", "potential.npz"],
    "field": ["info", "field.npz"],
    "costs": ["convert", "cost.npz", *OUT],
    "map": ["pack", "map.npz", "-o", "out.pbm"],
    "cloud by columns": ["local", "--cloud", "columns.npz", "--pose", "0,0,0", "-o", "out"],
    "cloud by LZF": ["local", "--cloud", "lzf.pcd", "--pose", "0,0,0", "-o", "out"],
    "TIFF": ["info", "tiny.yaml"],
    "TIFF of a tile": ["info", "tile.yaml"],
    "PNG": ["info", "blank.yaml"],
    "PNG in a run": ["run", "blank.yaml", "-o", "out"],
    "P5": ["info", "grey.yaml"],
    "P5 of 16 bits": ["info", "wide.yaml"],
    "P6": ["convert", "colour.yaml", *OUT],
    "P4": ["info", "bits.yaml"],
    "P2": ["info", "text.yaml"],
    "bit map": ["unpack", "bits8.pbm", *OUT],
    "edited bit map": ["edit", "circle", "bits8.pbm", "--point", "5,5", "--radius", "1",
                       "--value", "100", "-q", "-o", "out.pbm"],
    "costs of a map": ["query", "grey.yaml", "--at", "1,1"],
    "costs of obstacles": ["query", "grey.yaml", "--robot-radius", "1", "--at", "1,1,0"],
    "window": ["window", "small.yaml", "--corner", "0,0", "--size", "500,500", *OUT],
    "rescale": ["rescale", "small.yaml", "--resolution", "0.0001", *OUT],
    "built map": ["build", "far-scans.npz", *OUT],
    "compared maps": ["build", "far-scans.npz", "--compare", "-o", "out", "-q"],
    "built map of a size": ["build", "far-scans.npz", "--size", "99,99", "--origin", "0,0", *OUT],
    "local map": ["local", "--cloud", "cloud.npy", "--pose", "0,0,0", "--size", "500,500",
                  "-o", "out"],
    "difference": ["diff", "small.yaml", "far.yaml"],
    "merged maps": ["merge", "small.yaml", "far.yaml", *OUT],
    "mask": ["cost", "small.yaml", "--mask", "map.npz", *OUT],
    "shapes": ["edit", "circle", "small.yaml", "--file", "shapes.geojson", *OUT],
}  # fmt: skip


@pytest.mark.parametrize("words", BOMBS.values(), ids=BOMBS)
def test_what_would_take_too_much_is_refused_before(bombs, words):
    before = sorted(path.name for path in bombs.iterdir())
    code, err, peak = measured(bombs, *words, "--max-memory", f"{MOST}MB")
    assert code == 3, err
    first, hint = err.splitlines()
    told = rf"error: .*needs? ([0-9.]+) [MG]B of memory, {MOST} MB may be used"
    assert re.fullmatch(told, first)
    assert "--max-memory" in hint
    assert peak < (MOST + 50) * 1_000_000
    assert sorted(path.name for path in bombs.iterdir()) == before


@pytest.mark.parametrize("name", ["header.npz", "header.npy"])
def test_headers_of_arrays_are_not_read_at_any_length(bombs, name):
    words = ["local", "--cloud", name, "--pose", "0,0,0", "-o", "out"]
    code, told, peak = measured(bombs, *words, "--max-memory", "1GB")
    assert code == 3
    assert re.search(r"array header, expected \d+ bytes", told)
    assert peak < (MOST + 50) * 1_000_000


def test_lint_tells_of_it_as_of_every_file_that_cannot_be_read(bombs):
    code, told, peak = measured(bombs, "lint", "map.npz", "--max-memory", f"{MOST}MB")
    assert code == 1
    assert re.search(rf"error: file.malformed: needs .* of memory, {MOST} MB may be used", told)
    assert peak < (MOST + 50) * 1_000_000


@pytest.mark.parametrize("name", ["scans", "potential", "TIFF"])
def test_what_expands_as_no_honest_file_does_is_refused_whatever_is_free(bombs, name):
    code, err, peak = measured(bombs, *BOMBS[name])
    assert code == 3
    first, hint = err.splitlines()
    assert re.search(r"\d+ bytes would expand to \d+, more than 1[04]00 times as many", first)
    assert "--max-memory" in hint
    assert peak < (MOST + 50) * 1_000_000


def test_a_memory_that_was_chosen_reads_what_expands(bombs):
    code, told, _ = measured(bombs, "info", "potential.npz", "--max-memory", "2GB")
    assert code == 0, told


@pytest.mark.parametrize("ending", [".npz", ".png", ".yaml"])
def test_an_empty_map_of_mapdeals_own_is_no_bomb(tmp_path, ending):
    grid = OccupancyGrid(np.zeros((9000, 9000), np.int8), 0.05)
    path = tmp_path / f"empty{ending}"
    write_map(path, grid)
    source = path if ending == ".npz" else path.with_suffix(".yaml")
    assert read_map(source).occupancy.shape == grid.shape


def test_an_empty_png_of_another_program_is_no_bomb(bombs):
    assert (bombs / "blank.png").stat().st_size * 1000 < 9000**2
    code, told, _ = measured(bombs, "info", "blank.yaml")
    assert code == 0, told


def site(folder, side):
    """Files of a site that is as ordinary as can be."""
    values = np.zeros((side, side + 100), np.int8)
    values[::50, 7::7] = 100
    values[:, -100:] = -1
    grid = OccupancyGrid(values, 0.05, (1.5, -2.0, 0.0))
    write_map(folder / "site.yaml", grid)
    write_map(folder / "site.npz", grid)
    turned = (folder / "site.yaml").read_text().replace("-2.0, 0.0]", "-2.0, 0.4]")
    (folder / "turned.yaml").write_text(turned)
    write_map(folder / "site-png.png", grid)
    with (folder / "odds.npz").open("wb") as file:
        write_npz(file, grid, more={"log_odds": np.where(values == 100, 60.0, 40.0)})
    shifted = np.roll(values, 3, axis=0)
    write_map(folder / "other.yaml", OccupancyGrid(shifted, 0.05, (2.5, -2.0, 0.0)))
    write_map(folder / "cost.npz", Costmap((values == 100).astype(np.uint8) * 254, 0.05))
    write_bit_map(folder / "bits.pbm", BitMap.from_occupancy(grid))
    write_map(folder / "esdf.npz", esdf(grid))
    around = grid.frame.window(-1, -2, side + 3, side + 105)
    write_map(folder / "canvas.npz", on_canvas(esdf(grid), around))
    repulsive = np.random.default_rng(4).random(values.shape)
    write_map(folder / "potential.npz", PotentialField(repulsive, values, 0.05, goal=(1.0, 2.0)))
    scans(folder / "scans.npz", np.zeros((100, 3)))
    np.save(folder / "cloud.npy", np.ones((10, 3)))
    (folder / "pairs.csv").write_text("0.1,0.1,70.1,70.1\n")


@pytest.fixture(scope="module")
def ordinary(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    site(folder, 1600)
    return folder


COMMANDS = {
    "info map": ["info", "site.yaml"],
    "info field": ["info", "esdf.npz"],
    "info field on a canvas": ["info", "canvas.npz"],
    "info potential": ["info", "potential.npz"],
    "lint": ["lint", "site.yaml", "-q"],
    "lint npz": ["lint", "site.npz", "-q"],
    "lint for a robot": ["lint", "site.yaml", "-q", "--robot-radius", "0.04"],
    "repair": ["lint", "site.yaml", "--fix", *OUT],
    "convert": ["convert", "site.yaml", "-o", "out.npz"],
    "convert field": ["convert", "esdf.npz", *OUT],
    "convert field on a canvas": ["convert", "canvas.npz", *OUT],
    "convert potential": ["convert", "potential.npz", "-o", "out.npz", "-q"],
    "edit": ["edit", "circle", "site.yaml", "--point", "5,5", "--radius", "1", "--value", "100",
             *OUT],
    "edit bits": ["edit", "circle", "bits.pbm", "--point", "5,5", "--radius", "1", "--value", "100",
                  "-q", "-o", "out.pbm"],
    "window": ["window", "site.yaml", "--corner", "0,0", "--size", "100,100", *OUT],
    "rotate": ["rotate", "site.yaml", "--yaw", "0.5", *OUT],
    "straighten": ["rotate", "turned.yaml", "--straighten", *OUT],
    "rescale": ["rescale", "site.yaml", "--resolution", "0.07", *OUT],
    "rescale finer": ["rescale", "site.yaml", "--resolution", "0.02", *OUT],
    "rescale coarser": ["rescale", "site.yaml", "--resolution", "0.3", *OUT],
    "window of a field": ["window", "esdf.npz", "--corner", "-9,-9", "--size", "100,100", "-q",
                          "-o", "out.npz"],
    "costs of a field on a canvas": ["cost", "canvas.npz", "-q", "-o", "out.npz"],
    "pack": ["pack", "site.yaml", "-o", "out.pbm"],
    "diff": ["diff", "site.yaml", "other.yaml"],
    "merge": ["merge", "site.yaml", "other.yaml", *OUT],
    "merge turned": ["merge", "site.yaml", "turned.yaml", "other.yaml", *OUT, "--image", "o.png"],
    "merge by evidence": ["merge", "odds.npz", "turned.yaml", "--rule", "evidence", "-q",
                          "-o", "out.npz"],
    "clean": ["clean", "site.yaml", "--min-obstacle", "1", *OUT],
    "align": ["align", "site.yaml", "other.yaml"],
    "align drawn": ["align", "site.yaml", "other.yaml", "--image", "o.png", "--force"],
    "score": ["score", "site.yaml"],
    "score against a truth": ["score", "site.yaml", "--truth", "other.yaml"],
    "score drawn": ["score", "site.yaml", "--truth", "other.yaml", "--image", "score.png",
                    "--force"],
    "query": ["query", "site.yaml", "--at", "2,2"],
    "query field on a canvas": ["query", "canvas.npz", "--at", "2,2"],
    "query field": ["query", "esdf.npz", "--at", "2,2"],
    "query poses of a map": ["query", "site.yaml", "--robot-radius", "20", "--at", "30,30,0",
                             "--rule", "full"],
    "query poses": ["query", "cost.npz", "--robot-radius", "1", "--at", "2,2,0"],
    "route": ["route", "cost.npz", "--from", "0.1,0.1", "--to", "70.1,70.1"],
    "route by the field": ["route", "cost.npz", "--from", "0.1,0.1", "--to", "70.1,70.1",
                           "--heuristic", "field", "--field-weight", "1"],
    "pairs": ["route", "cost.npz", "--pairs", "pairs.csv", "-q"],
    "reach": ["reach", "site.yaml", "--robot-radius", "0.04", "-q",
              "-o", "out.json", "--layers", "out.npz"],
    "reach of costs": ["reach", "cost.npz", "--from", "0.1,0.1", "-q", "-o", "out.json"],
    "reach with corners": ["reach", "site.yaml", "--footprint",
                           "[[0.2,0.1],[0.2,-0.1],[-0.2,-0.1],[-0.2,0.1]]", "-q",
                           "-o", "out.json"],
    "descent": ["route", "cost.npz", "--from", "0.1,0.1", "--to", "9.1,9.1", "--method",
                "descent"],
    "log-odds": ["build", "scans.npz", "--size", "100,100", "--origin", "0,0", *OUT],
    "tsdf": ["build", "scans.npz", "--size", "100,100", "--origin", "0,0", *OUT,
             "--method", "tsdf"],
    "comparison": ["build", "scans.npz", "--size", "100,100", "--origin", "0,0", "-o", "compared",
                   "-q", "--compare"],
    "local": ["local", "--cloud", "cloud.npy", "--pose", "0,0,0", "--size", "100,100",
              "-o", "out"],
}  # fmt: skip


@pytest.mark.skipif(not IS_COMPILED, reason="the figures are of the compiled kernels")
@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_the_memory_that_a_command_asks_for_is_enough_and_not_much_too_much(ordinary, words):
    force = ["--force"] if "-o" in words else []
    allowed, needed = 0.0, 51.0
    while needed > allowed:  # reading may ask for less than what follows
        allowed = needed
        code, told, peak = measured(ordinary, *words, *force, "--max-memory", f"{allowed}MB")
        more = re.search(r"needs? ([0-9.]+) MB of memory", told)
        needed = float(more[1]) if more else allowed
    assert code in (0, 1), told  # 1: they differ, no way leads there
    assert peak < SLACK * allowed * 1_000_000
    assert allowed < 3 * peak / 1_000_000


def test_a_repair_that_turns_a_large_map_is_refused_before_it_begins(ordinary):
    words = ["lint", "turned.yaml", "--fix", *OUT, "--force"]
    code, told, _ = measured(ordinary, *words, "--max-memory", "80MB")
    assert (code, "turned.yaml: needs" in told) == (3, True), told
