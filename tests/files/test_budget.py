"""Readers claim the memory that they allocate, and claims above the limit are refused."""

import subprocess
import sys
from pathlib import Path

import pytest

from files.large_files import GRIDS, IMAGES, OTHER_READERS
from mapdeal import read_bit_map, read_cloud, read_map
from mapdeal.errors import MalformedInputError
from mapdeal.files import source as budget
from mapdeal.files.source import check_expansion, claim, current_budget, holding, use_memory

MB = 1_000_000


@pytest.fixture
def free(monkeypatch):
    def set_free(count):
        monkeypatch.setattr(budget, "free_memory", lambda: count)

    return set_free


@pytest.mark.parametrize(("name", "expected"), [
    ("office", "office.yaml"), ("ofice.pgm", "office.pgm"), ("OFFICE.pgm", "office.pgm"),
    ("hall", None), ("office.yaml", None),
])  # fmt: skip
def test_a_similar_file_is_suggested(tmp_path, name, expected):
    for file in ("office.yaml", "office.pgm"):
        (tmp_path / file).touch()
    hint = None if expected is None else f"did you mean {tmp_path / expected}?"
    assert budget.similar_file_hint(str(tmp_path / name), [".pcd", ".yaml"]) == hint


def test_claims_above_the_limit_are_refused_with_both_figures():
    with use_memory(100 * MB):
        claim("a.npz", 50 * MB)
        with pytest.raises(MalformedInputError) as caught:
            claim("a.npz", 51 * MB, what="7 x 5 cells")
    assert str(caught.value) == "a.npz: 7 x 5 cells need 101 MB of memory, 100 MB may be used"
    assert caught.value.hint.startswith("--max-memory 101MB allows more")
    with use_memory(100 * MB, is_chosen=False), pytest.raises(MalformedInputError, match="share"):
        claim("a.npz", 90 * MB)
    with use_memory(1):  # a little is always allowed
        claim("a.npz", 4 * MB)
        with pytest.raises(MalformedInputError):
            claim("a.npz", 5 * MB)


def test_the_default_is_half_of_what_is_free_and_worked_out_once(free):
    free(1000 * MB)
    claim("a.npz", 449 * MB)
    with pytest.raises(MalformedInputError, match=r"500 MB may be used \(by default half of what"):
        claim("a.npz", 451 * MB)
    with use_memory(None):
        free(10_000 * MB)
        with use_memory(None):
            assert current_budget().limit == 500 * MB
        with use_memory(None, anew=True):
            assert current_budget().limit == 5000 * MB
        with use_memory(7 * MB):
            assert (current_budget().limit, current_budget().origin) == (7 * MB, "")
        assert current_budget().limit == 500 * MB


def is_allowed(stored, expanded):
    try:
        check_expansion("a.npz", stored, expanded)
    except MalformedInputError as error:
        assert f"{stored} bytes would expand to {expanded}, more than 1000 times" in str(error)
        assert "--max-memory" in error.hint
        return False
    return True


@pytest.mark.parametrize(("stored", "expanded", "expected"), [
    (1, 32 * MB, True), (1, 34 * MB, False), (30_000, 40 * MB, False),
    (10**6, 1000 * MB, True), (10**6, 1001 * MB, False),
])  # fmt: skip
def test_what_expands_too_much_needs_a_chosen_memory(free, stored, expanded, expected):
    free(None)  # which allows any memory
    claim("a.npz", 10**15)
    assert is_allowed(stored, expanded) == expected
    with use_memory(4 * MB, is_chosen=False):
        assert is_allowed(stored, expanded) == expected
    with use_memory(4 * MB):
        assert is_allowed(stored, expanded)


def test_what_is_held_counts():
    with use_memory(100 * MB), holding(30 * MB):
        claim("a.npz", 20 * MB)
        with holding(10 * MB), pytest.raises(MalformedInputError, match="110 MB of memory"):
            claim("a.npz", 20 * MB)
        claim("a.npz", 20 * MB)


@pytest.mark.parametrize(("count", "text"), [
    (1, "0.000001 MB"), (123, "0.000123 MB"), (70 * MB, "70 MB"), (70 * MB + 1, "70.1 MB"),
    (999_900_000, "1 GB"), (1_234_000_001, "1.24 GB"), (10**18, "1000000000 GB"),
])  # fmt: skip
def test_sizes_in_messages_are_never_too_small(count, text):
    assert budget.size_text(count) == text


PAIR = "path.with_suffix('.yaml')"
CHUNKS = ["[None for _ in cloud_chunks(path)]"]
# Lint comes first, as a peak is never taken back: of images it keeps no cells.
READERS = [
    *((name, [f"lint_file({PAIR})", f"read_map({PAIR})"]) for name in IMAGES),
    *((name, ["read_map(path)"]) for name in GRIDS),
    ("map.npz", ["lint_file(path)"]),
    *((name, CHUNKS) for name in ("columns.npz", "compressed.pcd")),
    ("all.npz", ["read_cloud(path)"]),
    *((name, ["read_poses(path)"]) for name in ("poses.txt", "tum.txt")),
    ("log.npz", ["[None for _ in open_log(path).scans()]"]),
]

MEASURE = """
import sys, tokenize, warnings
from pathlib import Path
from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin
from mapdeal import read_cloud, read_map
from mapdeal.checks.lint import lint_file
from mapdeal.files.source import current_budget
from mapdeal.sensors.clouds import cloud_chunks
from mapdeal.sensors.points import read_poses
from mapdeal.sensors.scans import open_log

warnings.simplefilter("ignore")
claims = [0]
for module in list(sys.modules.values()):
    if module.__name__.startswith("mapdeal.") and hasattr(module, "claim"):
        module.claim = lambda path, count, **_: claims.append(count + current_budget().used)

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
@pytest.mark.parametrize(("name", "codes"), READERS)
def test_readers_and_lint_take_what_they_say_before(tmp_path, name, codes):
    path = tmp_path / name
    {**IMAGES, **GRIDS, **OTHER_READERS}[name](path)
    words = [sys.executable, "-c", MEASURE, str(path), *codes]
    process = subprocess.run(words, capture_output=True, text=True, check=True)
    for line in process.stdout.splitlines():
        measured, claimed = map(int, line.split())
        assert measured < 1.05 * claimed + 6 * MB  # for pieces of the file
        assert claimed < 3 * measured + 8 * MB


@pytest.mark.parametrize(
    ("read", "name"), [(read_map, "map.npz"), (read_bit_map, "p1.pbm"), (read_cloud, "all.npz")]
)
def test_readers_of_python_take_a_budget(tmp_path, free, read, name):
    {**IMAGES, **GRIDS, **OTHER_READERS}[name](tmp_path / name)
    free(100 * MB)
    with pytest.raises(MalformedInputError, match="of memory, 40 MB may be used"):
        read(tmp_path / name, max_memory=40 * MB)
    read(tmp_path / name, max_memory=1000 * MB)
