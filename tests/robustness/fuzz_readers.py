"""Feed damaged files to every reader.

Run it as ``python tests/robustness/fuzz_readers.py [--inputs 100000] [--seed 0]``. Good files of
each kind are mutated: bytes flipped, cut, repeated, numbers replaced by odd ones. A reader may
raise nothing but mapdeal's own errors, must end within 5 s, and has 4 GiB of address space. Prints
what it saw; ends with exit code 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import gzip
import io
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from clouds import pcd, ply
from mapdeal import OccupancyGrid, esdf, read_cloud, read_map, read_poses, read_shapes
from mapdeal.errors import MapdealError
from mapdeal.formats.npz import write_npz
from mapdeal.formats.scans.reader import open_log

LONGEST = 5.0  # seconds
ODD = [
    b"0",
    b"-1",
    b"1e308",
    b"nan",
    b"inf",
    b"99999999999",
    b"4294967296",
    b"0x10",
    b"",
    b"1e-320",
]

Reader = Callable[[Path], object]


def main() -> int:
    """Fuzz, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    started = time.perf_counter()
    found, problems, slowest = fuzz(options.inputs, options.seed)
    seconds = time.perf_counter() - started
    print(f"{options.inputs} inputs, seed {options.seed}, {seconds:.0f} s")
    print("| reader | read | refused |\n|---|---|---|")
    for kind in sorted({kind for kind, _ in found}):
        print(f"| {kind} | {found[kind, 'read']} | {found[kind, 'refused']} |")
    print(f"slowest: {slowest:.2f} s, problems: {len(problems)}")
    for problem in problems[:20]:
        print(problem)
    return bool(problems)


def fuzz(inputs: int, seed: int) -> tuple[Counter[tuple[str, str]], list[str], float]:
    """Return how many files were read and refused, what went wrong, and the longest time."""
    rng = random.Random(seed)
    found: Counter[tuple[str, str]] = Counter()
    problems: list[str] = []
    slowest = 0.0
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        seeds = good_files()
        for number in range(inputs):
            kind, file_name, data, read = seeds[number % len(seeds)]
            damaged = mutated(data, rng)
            path = folder / file_name
            path.write_bytes(damaged)
            if kind == "map image":
                (folder / "m.yaml").write_bytes(YAML.replace(b"m.pgm", file_name.encode()))
                path = folder / "m.yaml"
            elif kind == "map yaml":
                (folder / "m.pgm").write_bytes(PGM)
            started = time.perf_counter()
            try:
                read(path)
                found[kind, "read"] += 1
            except (MapdealError, MemoryError) as error:
                found[kind, "refused"] += 1
                if isinstance(error, MemoryError):
                    problems.append(f"{number} {kind}: out of memory")
            except Exception:  # noqa: BLE001 - what is sought
                last = traceback.format_exc().splitlines()[-3:]
                problems.append(f"{number} {kind}: {' | '.join(last)}")
            seconds = time.perf_counter() - started
            slowest = max(slowest, seconds)
            if seconds > LONGEST:
                problems.append(f"{number} {kind}: took {seconds:.1f} s")
    return found, problems, slowest


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a file with some damage."""
    text = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not text:
            break
        at = rng.randrange(len(text))
        kind = rng.randrange(7)
        if kind == 0:
            text[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            text[at] = rng.randrange(256)
        elif kind == 2:
            del text[at : at + rng.randrange(1, 40)]
        elif kind == 3:
            text[at:at] = text[max(0, at - rng.randrange(1, 60)) : at]
        elif kind == 4:
            del text[at:]
        elif kind == 5:
            text[at:at] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 9)))
        else:
            replace_number(text, at, rng)
    return bytes(text)


def replace_number(text: bytearray, at: int, rng: random.Random) -> None:
    """Replace the first number behind a place by an odd one."""
    start = at
    while start < len(text) and not chr(text[start]).isdigit():
        start += 1
    end = start
    while end < len(text) and chr(text[end]) in "0123456789.eE+-":
        end += 1
    text[start:end] = rng.choice(ODD)


YAML = (
    b"image: m.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.0, 0.1]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
PIXELS = np.random.default_rng(0).choice([0, 205, 254], (9, 11)).astype(np.uint8)
PGM = b"P5\n# made by hand\n11 9\n255\n" + PIXELS.tobytes()


def good_files() -> list[tuple[str, str, bytes, Reader]]:
    """Return files of every kind: what they are, their name, their bytes, and their reader."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-3, 3, (12, 3)).round(2).tolist()
    fields = [("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1), ("i", "u1", 2)]
    rows = [[[x], [y], [z], [1, 2]] for x, y, z in points]
    axes = [("x", "f4"), ("y", "f8"), ("z", "f4")]
    images = [("m.pgm", PGM), ("m.pgm", plain_pgm()), *pillow_images()]
    grid = OccupancyGrid(rng.choice([0, 100, -1], (7, 5)), 0.1, (1.0, 2.0, 0.3))
    log = carmen_log(rng)
    scans = {"poses": rng.random((3, 3)), "angles": rng.random(4), "ranges": rng.random((3, 4))}
    clouds = [
        ("c.pcd", pcd(fields, rows, kind)) for kind in ("ascii", "binary", "binary_compressed")
    ]
    clouds += [
        ("c.ply", ply(axes, points, kind))
        for kind in ("ascii", "binary_little_endian", "binary_big_endian")
    ]
    clouds += [("c.csv", csv(points)), ("c.npy", saved(np.save, np.array(points)))]
    clouds += [("c.npz", saved(np.savez_compressed, points=np.array(points)))]
    shapes = b"shapes:\n- {type: polygon, points: [[0, 0], [1, 0], [1, 2.5]], value: 100}\n"
    return [
        *[("map image", name, data, read_map) for name, data in images],
        *[("map yaml", "m.yaml", YAML, read_map)] * 3,
        *[("npz", "g.npz", npz_of(one), read_map) for one in (grid, esdf(grid))],
        *[("cloud", name, data, read_cloud) for name, data in clouds],
        ("scans", "a.log", log, read_log),
        ("scans", "a.log", log, read_log),
        ("scans", "a.log.gz", gzip.compress(log), read_log),
        ("scans", "s.npz", saved(np.savez, **scans), read_log),
        ("poses", "p.txt", csv(points), read_poses),
        ("poses", "p.txt", b"1 2 3 4 0 0 0 1\n2 2 3 4 0 0 0.6 0.8\n", read_poses),
        ("shapes", "s.yaml", shapes, read_shapes),
    ]


def read_log(path: Path) -> object:
    """Read all scans of a log."""
    return list(open_log(path, max_bad=3).scans())


def carmen_log(rng: np.random.Generator) -> bytes:
    """Return a log with all kinds of lines."""
    ranges = " ".join(f"{r:.2f}" for r in rng.uniform(0.1, 9, 180))
    short = " ".join(f"{r:.2f}" for r in rng.uniform(0.1, 9, 6))
    lines = [
        "# a log", "PARAM robot_width 0.3 nohost 0", "ODOM 1 2 0.3 0 0 0 1.0 host 1.0",
        f"FLASER 180 {ranges} 1 2 0.3 1 2 0.3 1.5 host 1.5",
        f"ROBOTLASER1 0 -0.5 1.0 0.2 80 0.01 0 6 {short} 0 1 2 0.3 1 2 0.3 0 0 0 0 0 2.0 host 2.0",
        f"RAWLASER1 0 -0.5 1.0 0.2 80 0.01 0 6 {short} 2 7 8 3.0 host 3.0",
        f"FLASER 180 {ranges} 1.1 2 0.4 1 2 0.3 4.5 host 4.5",
    ]  # fmt: skip
    return "\n".join(lines).encode()


def csv(points: list[list[float]]) -> bytes:
    """Return points as text."""
    return "".join(",".join(map(str, point)) + "\n" for point in points).encode()


def plain_pgm() -> bytes:
    """Return the image as a P2."""
    rows = "\n".join(" ".join(map(str, row)) for row in PIXELS.tolist())
    return f"P2\n11 9\n255\n{rows}\n".encode()


def pillow_images() -> list[tuple[str, bytes]]:
    """Return the image in other formats and modes."""
    found = []
    for mode, kind in (("L", "PNG"), ("RGBA", "PNG"), ("P", "PNG"), ("L", "BMP"), ("L", "TIFF")):
        file = io.BytesIO()
        Image.fromarray(PIXELS).convert(mode).save(file, kind)
        found.append((f"m.{kind.lower()}", file.getvalue()))
    return found


def saved(save: Callable[..., None], *args: object, **kwargs: object) -> bytes:
    """Return the bytes that numpy writes."""
    file = io.BytesIO()
    save(file, *args, **kwargs)
    return file.getvalue()


def npz_of(grid: object) -> bytes:
    """Return the bytes of a grid's npz."""
    file = io.BytesIO()
    write_npz(file, grid)  # type: ignore[arg-type]
    return file.getvalue()


if __name__ == "__main__":
    sys.exit(main())
