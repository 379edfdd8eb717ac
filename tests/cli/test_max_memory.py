"""Commands on maps that are taken to be too large for memory: outputs have the same bytes."""

import re
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest

from mapdeal import OccupancyGrid, read_map, write_map
from mapdeal.errors import ParameterError
from mapdeal.files import source as budget
from mapdeal.files.source import size_of
from mapdeal.kernels.engine import engine_name
from mapdeal.maps.reading import MapFile
from mapdeal.pipeline import inputs as memory
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import apply_to_file, run_map
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step

pytestmark = pytest.mark.slow

IS_COMPILED = engine_name() == "compiled"
BASE = 50 if IS_COMPILED else 100  # MB that are taken anyhow
PLENTY = "100GB"
LITTLE, LESS = ("58.5MB", "57.5MB") if IS_COMPILED else ("110MB", "109MB")


@pytest.fixture(scope="module")
def building(tmp_path_factory):
    """A map with walls, clutter, unknown margins and values in between, 613 x 701 cells."""
    rng = np.random.default_rng(3)
    values = np.where(rng.random((613, 701)) < 0.002, 100, 0).astype(np.int8)
    values[rng.random(values.shape) < 0.01] = 30
    values[::97, 40:600] = 100
    values[100:105, 200:320] = 100
    values[:40] = -1
    values[:, 660:] = -1
    path = tmp_path_factory.mktemp("maps") / "building.yaml"
    write_map(path, OccupancyGrid(values, 0.1, (1.5, -2.0, 0.4)))
    return path


@pytest.fixture
def blocks_used(monkeypatch):
    """The heights of blocks of all maps that are opened to be processed in blocks."""
    used = []
    real = MapFile.by_rows

    def watched(file, *, block_height, **options):
        used.append(block_height)
        return real(file, block_height=block_height, **options)

    monkeypatch.setattr(MapFile, "by_rows", watched)
    return used


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("memory", [LITTLE, LESS])
@pytest.mark.parametrize(
    "recipe", ["default", "nav2", "design-real", "design-sim", "design-sim --canvas full"]
)
def test_run(command, building, tmp_path, blocks_used, recipe, memory):
    told = []
    for name, size in (("whole", PLENTY), ("blocks", memory)):
        code, out, err = command(
            "run", building, "-o", tmp_path / name, "--recipe", *recipe.split(), "--threads", 2,
            "--max-memory", size,
        )  # fmt: skip
        told.append(err)
        assert (code, err.count("\n"), "the open cells cost 99" in err) == (
            (0, 1, True) if recipe == "design-real" else (0, 0, False)
        )
        assert out.replace(str(tmp_path / name), "") != out
        assert bool(blocks_used) == (name == "blocks")
    assert blocks_used[0] < 100
    assert told[0] == told[1]
    whole, blocks = contents(tmp_path / "whole"), contents(tmp_path / "blocks")
    assert whole.keys() == blocks.keys()
    assert [name for name in whole if whole[name] != blocks[name]] == []


STAGES = [
    ("active", ".yaml", []),
    ("inflate", ".yaml", ["--radius", "0.5"]),
    ("inflate", ".npz", ["--radius", "0.5", "--kernel", "square"]),
    ("esdf", ".npy", []),
    ("esdf", ".npz", ["--convention", "border", "--max-distance", "2"]),
    ("esdf", ".yaml", ["--view", "per-map"]),
    ("cost", ".yaml", []),
    ("cost", ".npz", ["--model", "rings"]),
    ("cost", ".yaml", ["--model", "threshold"]),
    ("cost", ".yaml", ["--encoding", "costmap2d"]),
]


@pytest.mark.parametrize(("stage", "ending", "options"), STAGES)
def test_stages(command, building, tmp_path, blocks_used, monkeypatch, stage, ending, options):
    monkeypatch.setattr(memory, "_READ", 50.0)  # so that every stage takes more than there is
    for name, size in (("whole", PLENTY), ("blocks", LITTLE)):
        (tmp_path / name).mkdir()
        code, _, err = command(
            stage, building, "-o", tmp_path / name / f"out{ending}", *options, "--threads", 2,
            "--image", tmp_path / name / "out.png", "--max-memory", size,
        )  # fmt: skip
        assert code == 0, err
        assert bool(blocks_used) == (name == "blocks")
    assert contents(tmp_path / "whole") == contents(tmp_path / "blocks")


def test_maps_that_are_no_p5_are_read_whole_and_processed_block_by_block(
    command, building, tmp_path, monkeypatch
):
    made = []
    real = memory.lazy_layer

    def watched(*arguments, **options):
        made.append(real(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(memory, "lazy_layer", watched)
    code, _, _ = command("inflate", building, "-o", tmp_path / "in.npz", "--radius", 0)
    assert (code, made) == (0, [])
    outputs = []
    for size in (PLENTY, LITTLE):
        folder = tmp_path / size
        command("run", tmp_path / "in.npz", "-o", folder, "--threads", 2, "--max-memory", size)
        outputs.append(contents(folder))
        assert bool(made) == (size == LITTLE)
    assert outputs[0] == outputs[1] != {}


def test_bits_are_read_row_by_row(command, building, tmp_path, blocks_used):
    bits = tmp_path / "bits.pbm"
    assert command("pack", building, "-o", bits)[0] == 0
    for name, size in (("whole", PLENTY), ("blocks", LITTLE)):
        words = ["-o", tmp_path / name, "--threads", 2, "--max-memory", size]
        assert command("run", bits, *words)[0] == 0
        assert bool(blocks_used) == (name == "blocks")
    assert contents(tmp_path / "whole") == contents(tmp_path / "blocks") != {}


@pytest.mark.parametrize(
    ("words", "memory"),
    [(["run"], f"{BASE + 5} MB"), (["esdf"], f"{BASE} MB"), (["potential"], f"{BASE + 20} MB")],
)
def test_too_little_memory_is_one_line_that_tells_how_much_it_takes(
    command, building, tmp_path, words, memory
):
    output = tmp_path / ("out" if words == ["run"] else "out.npz")
    code, out, err = command(
        *words, building, "-o", output, "--threads", 2, "--max-memory", memory
    )  # fmt: skip
    assert (code, out) == (3, "")
    first, hint = err.splitlines()
    assert first.startswith(f"error: {building}: 701 x 613 cells need ")
    assert first.endswith(f" of memory, {memory} may be used")
    assert "--max-memory" in hint
    assert not output.exists()


@pytest.mark.parametrize("memory", ["1MB", f"{BASE + 5}MB"])
def test_the_memory_that_is_asked_for_is_enough(command, building, tmp_path, memory):
    words = ("run", building, "-o", tmp_path, "--threads", 2, "--max-memory")
    _, _, err = command(*words, memory)
    needed = re.search(r"need ([0-9.]+ MB)", err)[1]
    assert command(*words, needed)[0] == 0


@pytest.mark.parametrize("memory", [PLENTY, f"{BASE + (12 if IS_COMPILED else 18)}MB"])
def test_pictures_count_as_memory(command, tmp_path, memory):
    write_map(tmp_path / "wide.yaml", OccupancyGrid(np.zeros((100, 9000), np.int8), 0.1))
    words = ("run", tmp_path / "wide.yaml", "-o", tmp_path / "out", "--threads", 1,
             "--max-memory", memory, "--force")  # fmt: skip
    assert command(*words)[0] == 0
    code, _, err = command(*words, "--image-max", 0)
    assert (code == 0) == (memory == PLENTY)
    assert ("9000 x 100 cells need" in err) == (memory != PLENTY)


def test_groups_of_cells_need_the_whole_map(command, building, tmp_path):
    code, _, err = command(
        "active", building, "-o", tmp_path / "out.yaml", "--min-component", 5, "--threads", 2,
        "--max-memory", f"{BASE + 0.5}MB",
    )  # fmt: skip
    assert code != 0
    assert "memory" in err
    assert list(tmp_path.iterdir()) == []


class Watched:
    """Collects what is told of progress."""

    def __init__(self):
        self.total, self.steps = None, []

    @contextmanager
    def __call__(self, total):
        self.total = total
        yield self.steps.append


@pytest.mark.parametrize("images", [True, False])
@pytest.mark.parametrize(
    ("recipe", "canvas"),
    [("default", "crop"), ("design-real", "crop"), ("design-sim", "crop"), ("design-sim", "full")],
)
@pytest.mark.usefixtures("mapdeal_warnings")
def test_progress_of_a_run_ends_with_its_end(building, tmp_path, recipe, canvas, images):
    for size in (10**12, size_of(LITTLE, "") if images else size_of(LITTLE, "") - 4 * 10**6):
        watch = Watched()
        run_map(
            building, tmp_path, load_recipe(recipe),
            Settings(force=True, threads=2, max_memory=size, images=images, progress=watch,
                     canvas=canvas),
        )  # fmt: skip
        if size == 10**12:
            assert watch.total is None
        else:
            assert len(watch.steps) > 20
            assert sum(watch.steps) == watch.total


@pytest.mark.parametrize(("stage", "ending"), sorted({case[:2] for case in STAGES}))
@pytest.mark.parametrize("parameters", [{}, {"view": "per-map"}])
def test_progress_of_a_stage_ends_with_its_end(
    building, tmp_path, monkeypatch, stage, ending, parameters
):
    monkeypatch.setattr(memory, "_READ", 50.0)
    watch = Watched()
    options = Settings(
        threads=2, image=tmp_path / "out.png", max_memory=size_of(LITTLE, ""), progress=watch
    )  # fmt: skip
    one = make_step(stage, parameters if stage == "esdf" else {})
    apply_to_file(building, tmp_path / f"out{ending}", one, options)
    assert sum(watch.steps) == watch.total > 0


# The peak of a process begins with that of its parent: this one is small.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, *sys.argv[1:]])
_, status, usage = os.wait4(process.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


@pytest.mark.thorough
@pytest.mark.skipif(not IS_COMPILED, reason="takes minutes without compiled kernels")
@pytest.mark.parametrize(
    ("words", "most"), [(["cost", "-o", "cost.yaml"], 120), (["run", "-o", "out"], 150)]
)
def test_memory_stays_within_the_budget_i14(tmp_path, words, most):
    values = np.zeros((5000, 6001), np.int8)
    values[::50, 7::70] = 100
    values[:, -500:] = -1
    write_map(tmp_path / "site.yaml", OccupancyGrid(values, 0.05, (1.5, -2.0, 0.4)))
    measured = subprocess.run(
        [sys.executable, "-c", MEASURE, "-m", "mapdeal", words[0], "site.yaml", *words[1:], "-q",
         "--threads", "2", "--max-memory", f"{most}MB"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert (measured.returncode, measured.stderr) == (0, "")
    assert int(measured.stdout) * 1024 < most * 1_000_000  # in memory: 170 and 440 MB


def test_a_mask(command, sh, building, tmp_path, monkeypatch, blocks_used):
    monkeypatch.setattr(memory, "_READ", 50.0)
    sh(f"edit circle {building} --blank --background -1 --point 12,9 --radius 5 --value 60 -o"
       f" {tmp_path}/mask.yaml")  # fmt: skip
    for name, size in (("whole", PLENTY), ("blocks", LITTLE)):
        code, _, err = command(
            "cost", building, "-o", tmp_path / name / "out.npz", "--mask", tmp_path / "mask.yaml",
            "--threads", 2, "--max-memory", size,
        )  # fmt: skip
        assert (code, err) == (0, "")
        assert bool(blocks_used) == (name == "blocks")
    assert contents(tmp_path / "whole") == contents(tmp_path / "blocks")
    cost = read_map(tmp_path / "whole" / "out.npz")
    row, col = cost.frame.bounded_rowcol_from_xy([(12.0, 9.0)])[0][0]
    assert cost.cost[row, col] >= 152


@pytest.mark.parametrize(
    ("free", "jobs", "most"),
    [
        (10_000, 1, 5_000), (400, 1, 256), (200, 1, 200), (5, 1, 128), (10_000, 4, 1_250),
        (10_000, 64, 128),
    ],
)  # fmt: skip
def test_the_default_is_half_of_what_is_free_or_all_of_little(monkeypatch, free, jobs, most):
    monkeypatch.setattr(budget, "free_memory", lambda: free * 1_000_000)
    assert memory.memory_budget(None, jobs) == most * 1_000_000
    assert memory.memory_budget(123, jobs) == 123


def test_without_knowledge_of_free_memory_all_is_in_memory(monkeypatch):
    monkeypatch.setattr(budget, "free_memory", lambda: None)
    assert memory.memory_budget(None) > 10**15


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("4G", 4 * 2**30), ("500M", 500 * 2**20), ("1.5GiB", 3 * 2**29), ("4GB", 4 * 10**9),
        ("64 kB", 64_000), ("12", 12), ("2t", 2**41), ("7B", 7),
    ],
)  # fmt: skip
def test_sizes(text, size):
    assert size_of(text, "--max-memory") == size


@pytest.mark.parametrize("text", ["", "G", "-4G", "4X", "four", "0", "1e9", "4G4", "nan", "٤G"])
def test_sizes_that_are_none(text):
    with pytest.raises(ParameterError, match="--max-memory"):
        size_of(text, "--max-memory")
