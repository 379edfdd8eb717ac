"""What readers say they take of memory is what they take, and too much is refused."""

import io
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mapdeal import (
    Costmap,
    OccupancyGrid,
    PotentialField,
    esdf,
    read_bit_map,
    read_cloud,
    read_map,
    write_map,
)
from mapdeal.errors import MalformedInputError
from mapdeal.files import source as budget
from mapdeal.files.source import check_expansion, claim, holding, memory_limit, use_memory
from mapdeal.maps.npz import write_npz

MB = 1_000_000
SHAPE = (2000, 2500)
POINTS = 600_000


@pytest.fixture
def free(monkeypatch):
    """Set how much memory is free."""

    def set_free(count):
        monkeypatch.setattr(budget, "free_memory", lambda: count)

    return set_free


def test_what_fits_is_allowed_and_what_does_not_is_told_with_both_figures():
    with use_memory(100 * MB):
        claim("a.npz", 50 * MB)
        with pytest.raises(MalformedInputError) as caught:
            claim("a.npz", 51 * MB, what="7 x 5 cells")
    assert str(caught.value) == "a.npz: 7 x 5 cells need 101 MB of memory, 100 MB may be used"
    assert caught.value.hint.startswith("--max-memory 101MB allows more")


def test_a_little_is_always_allowed():
    with use_memory(1):
        claim("a.npz", 4 * MB)
        with pytest.raises(MalformedInputError):
            claim("a.npz", 5 * MB)


def test_the_default_is_said_to_depend_on_what_is_free(free):
    free(1000 * MB)
    with pytest.raises(MalformedInputError, match=r"500 MB may be used \(by default half of what"):
        claim("a.npz", 451 * MB)
    claim("a.npz", 449 * MB)


def test_a_share_of_a_job_is_said_to_be_one():
    with use_memory(100 * MB, is_chosen=False), pytest.raises(MalformedInputError, match="share"):
        claim("a.npz", 90 * MB)


def test_the_default_is_worked_out_once(free):
    free(1000 * MB)
    with use_memory(None):
        free(10_000 * MB)
        with use_memory(None):
            assert memory_limit()[0] == 500 * MB
        with use_memory(None, anew=True):
            assert memory_limit()[0] == 5000 * MB
        with use_memory(7 * MB):
            assert memory_limit() == (7 * MB, "")
        assert memory_limit()[0] == 500 * MB


def test_what_is_held_counts():
    with use_memory(100 * MB), holding(30 * MB):
        claim("a.npz", 20 * MB)
        with holding(10 * MB), pytest.raises(MalformedInputError, match="110 MB of memory"):
            claim("a.npz", 20 * MB)
        claim("a.npz", 20 * MB)


def test_without_knowledge_of_free_memory_there_is_no_limit_but_of_expansion(free):
    free(None)
    claim("a.npz", 10**15)
    with pytest.raises(MalformedInputError, match="100 bytes would expand to 100000000"):
        check_expansion("a.npz", 100, 100 * MB)


@pytest.mark.parametrize(
    ("stored", "expanded"), [(100, 40 * MB), (30_000, 40 * MB), (10**6, 1001 * MB)]
)
def test_what_expands_too_much_is_refused_unless_the_memory_was_chosen(stored, expanded):
    with pytest.raises(MalformedInputError, match="more than 1000 times as many") as caught:
        check_expansion("a.npz", stored, expanded)
    assert "--max-memory" in caught.value.hint
    with use_memory(4 * MB, is_chosen=False), pytest.raises(MalformedInputError):
        check_expansion("a.npz", stored, expanded)
    with use_memory(4 * MB):
        check_expansion("a.npz", stored, expanded)


@pytest.mark.parametrize(("stored", "expanded"), [(1, 32 * MB), (10**6, 1000 * MB)])
def test_what_expands_little_or_no_more_than_files_do_is_allowed(stored, expanded):
    check_expansion("a.npz", stored, expanded)


@pytest.mark.parametrize(
    ("count", "text"),
    [(1, "0.000001 MB"), (123, "0.000123 MB"), (70 * MB, "70 MB"), (70 * MB + 1, "70.1 MB"),
     (999_900_000, "1 GB"), (1_234_000_001, "1.24 GB"), (10**18, "1000000000 GB")],
)  # fmt: skip
def test_sizes_in_messages_are_never_too_small(count, text):
    assert budget.size_text(count) == text


def test_expansion_of_own_maps_is_far_from_the_limit():
    file = io.BytesIO()
    write_npz(file, OccupancyGrid(np.full((5000, 5000), -1, np.int8), 0.05))
    with zipfile.ZipFile(file) as archive:
        for entry in archive.infolist():
            assert entry.file_size < 0.9 * budget.MOST_EXPANSION * entry.compress_size


def yaml_for(image):
    image.with_suffix(".yaml").write_text(
        f"image: {image.name}\nresolution: 0.05\norigin: [1.5, -2.0, 0.4]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def pillow(mode, **options):
    """What writes a picture of a mode."""

    def write(path):
        cells = np.tile(np.arange(250, dtype=np.uint8), (SHAPE[0], SHAPE[1] // 250))
        if mode == "I;16":
            image = Image.fromarray(cells.astype(np.uint16) * 257)
        else:
            image = Image.fromarray(np.dstack([cells] * 3)).convert(mode)
        image.save(path, **options)
        yaml_for(path)

    return write


def netpbm(head, body):
    def write(path):
        path.write_bytes(head + body())
        yaml_for(path)

    return write


def text(per_row):
    rows = SHAPE[0] // 2
    line = b" ".join(b"%d" % (k % 250) for k in range(per_row)) + b"\n"
    return line * rows


def npz(make):
    def write(path):
        cells = np.zeros(SHAPE, np.int8)
        cells[::50, ::7] = 100
        write_map(path, make(OccupancyGrid(cells, 0.05)))

    return write


def cloud(points, order="C"):
    return lambda path: np.savez(path, points=np.asarray(points, order=order))


def compressed_pcd(path):
    """Literal runs of 32 bytes."""
    count = POINTS // 8 * 8
    raw = np.ones((3, count), "<f4").tobytes()
    runs = np.full((len(raw) // 32, 33), 31, np.uint8)
    runs[:, 1:] = np.frombuffer(raw, np.uint8).reshape(-1, 32)
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    head += f"WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA binary_compressed\n"
    path.write_bytes(head.encode() + struct.pack("<II", runs.size, len(raw)) + runs.tobytes())


def potential_of(grid):
    return PotentialField(np.ones(SHAPE), grid.occupancy, 0.05, goal=(1.0, 2.0))


def costs_of(grid):
    return Costmap(grid.occupancy.astype(np.uint8), 0.05)


H, W = SHAPE
PAIR = "read_map(path.with_suffix('.yaml'))"
MAP = "read_map(path)"
CHUNKS = "[None for _ in cloud_chunks(path)]"
LOG = "[None for _ in open_log(path).scans()]"
READERS = {
    "grey.png": (pillow("L"), PAIR),
    "colours.png": (pillow("RGB"), PAIR),
    "opacity.png": (pillow("RGBA"), PAIR),
    "both.png": (pillow("LA"), PAIR),
    "palette.png": (pillow("P"), PAIR),
    "bits.png": (pillow("1"), PAIR),
    "wide.png": (pillow("I;16"), PAIR),
    "grey.tif": (pillow("L", compression="tiff_adobe_deflate"), PAIR),
    "colours.tif": (pillow("RGB", compression="tiff_lzw"), PAIR),
    "fax.tif": (pillow("1", compression="group4"), PAIR),
    "grey.bmp": (pillow("L"), PAIR),
    "colours.bmp": (pillow("RGB"), PAIR),
    "grey.jpg": (pillow("L"), PAIR),
    "colours.jpg": (pillow("RGB"), PAIR),
    "p1.pbm": (netpbm(b"P1\n%d %d\n" % (W, H), lambda: b"0 1 " * (H * W // 2)), PAIR),
    "p2.pgm": (netpbm(b"P2\n%d %d\n255\n" % (W, H // 2), lambda: text(W)), PAIR),
    "p3.ppm": (netpbm(b"P3\n%d %d\n255\n" % (W, H // 2), lambda: text(3 * W)), PAIR),
    "p4.pbm": (netpbm(b"P4\n%d %d\n" % (8 * (W // 8), H), lambda: bytes(W // 8 * H)), PAIR),
    "p5.pgm": (netpbm(b"P5\n%d %d\n255\n" % (W, H), lambda: bytes(W * H)), PAIR),
    "p5-wide.pgm": (netpbm(b"P5\n%d %d\n999\n" % (W, H), lambda: bytes(2 * W * H)), PAIR),
    "p6.ppm": (netpbm(b"P6\n%d %d\n255\n" % (W, H), lambda: bytes(3 * W * H)), PAIR),
    "map.npz": (npz(lambda grid: grid), MAP),
    "cost.npz": (npz(costs_of), MAP),
    "field.npz": (npz(esdf), MAP),
    "potential.npz": (npz(potential_of), MAP),
    "columns.npz": (cloud(np.ones((POINTS, 3)), order="F"), CHUNKS),
    "compressed.pcd": (compressed_pcd, CHUNKS),
    "all.npz": (cloud(np.ones((POINTS, 3), np.int8)), "read_cloud(path)"),
    "poses.txt": (lambda path: path.write_text("1 2 0.5\n" * (POINTS // 3)), "read_poses(path)"),
    "tum.txt": (
        lambda path: path.write_text("".join(f"{k} 1 2 0 0 0 0 1\n" for k in range(POINTS // 6))),
        "read_poses(path)",
    ),
    "log.npz": (
        lambda path: np.savez(
            path, poses=np.ones((POINTS, 3)), angles=np.ones(2), ranges=np.ones((POINTS, 2))
        ),
        LOG,
    ),
}

MEASURE = """
import sys, tokenize, warnings
from pathlib import Path
from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin
from mapdeal import read_cloud, read_map
from mapdeal.checks.lint import lint_file
from mapdeal.files.source import _budget
from mapdeal.sensors.clouds import cloud_chunks
from mapdeal.sensors.points import read_poses
from mapdeal.sensors.scans import open_log

warnings.simplefilter("ignore")
claims = [0]
for module in list(sys.modules.values()):
    if module.__name__.startswith("mapdeal.") and hasattr(module, "claim"):
        module.claim = lambda path, count, **_: claims.append(count + _budget().held)

def peak():
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024

path = Path(sys.argv[1])
before = peak()
for code in sys.argv[2:]:
    claims[:] = [0]
    kept = eval(code)
    print(peak() - before, max(claims))
"""


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's own figures")
@pytest.mark.parametrize("name", READERS)
def test_readers_and_lint_take_what_they_say_before(tmp_path, name):
    write, code = READERS[name]
    write(tmp_path / name)
    # lint comes first, as a peak is never taken back: it keeps no cells
    lint = [code.replace("read_map", "lint_file")] if code == PAIR else []
    for told in taken_and_said(tmp_path / name, [*lint, code]):
        check_claims(told)


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's own figures")
def test_lint_of_an_npz_takes_what_its_reader_says_before(tmp_path):
    READERS["map.npz"][0](tmp_path / "map.npz")
    (told,) = taken_and_said(tmp_path / "map.npz", ["lint_file(path)"])
    check_claims(told)


def check_claims(told):
    taken, said = map(int, told.split())
    assert taken < 1.05 * said + 6 * MB  # for what belongs to no file, such as pieces of it
    assert said < 3 * taken + 8 * MB


def taken_and_said(path, codes):
    """Bytes at the peak of each, and the most that was claimed, a line each."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(path), *codes],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("read", "name", "write"),
    [
        (read_map, "a.npz", npz(lambda grid: grid)),
        (read_bit_map, "p1.pbm", READERS["p1.pbm"][0]),
        (read_cloud, "all.npz", READERS["all.npz"][0]),
    ],
)
def test_readers_of_python_take_a_budget(tmp_path, free, read, name, write):
    write(tmp_path / name)
    free(100 * MB)
    with pytest.raises(MalformedInputError, match="of memory, 40 MB may be used"):
        read(tmp_path / name, max_memory=40 * MB)
    read(tmp_path / name, max_memory=1000 * MB)
