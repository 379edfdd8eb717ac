"""Commands on maps that are taken to be too large for memory: outputs have the same bytes."""

import re
from contextlib import contextmanager

import numpy as np
import pytest

from mapdeal import OccupancyGrid, read_map, write_map
from mapdeal.errors import ParameterError
from mapdeal.files.source import size_of
from mapdeal.kernels.engine import engine_name
from mapdeal.pipeline import inputs as memory
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import apply_to_file, run_map
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step

pytestmark = pytest.mark.slow

IS_COMPILED = engine_name() == "compiled"
BASE = 50 if IS_COMPILED else 100  # MB that are taken anyhow
PLENTY = "100GB"
LITTLE, LESS = ("69.5MB", "68.5MB") if IS_COMPILED else ("121MB", "120MB")


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


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def twice(command, building, tmp_path):
    def run(words, output="", memory=LITTLE, *, source=building):
        warnings = []
        for name, size in (("whole", PLENTY), ("blocks", memory)):
            folder = tmp_path / name
            folder.mkdir()
            line = [word.replace("FOLDER", str(folder)) for word in words.split()]
            line += ["-o", folder / output, "--threads", 2, "--max-memory", size, "-v"]
            code, _, err = command(line[0], source, *line[1:])
            assert code == 0, err
            assert ("processed in blocks of rows\n" in err) == (name == "blocks")
            lines = err.replace(str(folder), "").splitlines()
            warnings.append([line for line in lines if line.startswith("warning: ")])
        assert warnings[0] == warnings[1]
        unlimited, blocks = contents(tmp_path / "whole"), contents(tmp_path / "blocks")
        assert unlimited.keys() == blocks.keys() != set()
        assert [name for name in unlimited if unlimited[name] != blocks[name]] == []
        return warnings[0]

    return run


@pytest.mark.parametrize(("recipe", "memory"), [
    ("default", LITTLE), ("nav2", LESS), ("design-real", LITTLE),
    ("design-sim --canvas full", LITTLE),
])  # fmt: skip
def test_run(twice, recipe, memory):
    warnings = twice(f"run --recipe {recipe}", memory=memory)
    is_uniform = ["the open cells cost 99" in warning for warning in warnings]
    assert is_uniform == [True] * (recipe == "design-real")


STAGES = [
    ("active", ".yaml", ""), ("inflate", ".npz", "--radius 0.5 --kernel square"),
    ("esdf", ".npy", ""),
    ("esdf", ".npz", "--convention border --max-distance 2"),
    ("esdf", ".yaml", "--view per-map"), ("cost", ".npz", "--model rings"),
    ("cost", ".yaml", "--encoding costmap2d"),
]  # fmt: skip


@pytest.mark.parametrize(("stage", "ending", "options"), STAGES)
def test_stages(twice, monkeypatch, stage, ending, options):
    monkeypatch.setattr(memory, "_BYTES_PER_CELL_READ", 50.0)  # no stage fits the memory
    twice(f"{stage} {options} --image FOLDER/out.png", f"out{ending}")


@pytest.mark.parametrize("line", ["inflate -o in.npz --radius 0", "pack -o bits.pbm"])
def test_maps_in_formats_besides_p5_are_processed_in_blocks_too(twice, sh, building, line):
    assert sh(f"{line} {building}")[0] == 0
    twice("run", source=line.split()[2])


def test_a_mask(twice, sh, building, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_BYTES_PER_CELL_READ", 50.0)
    mask = tmp_path / "mask.yaml"
    shape = "--point 12,9 --radius 5 --value 60"
    sh(f"edit circle {building} --blank --background -1 {shape} -o {mask}")
    assert twice(f"cost --inscribed-radius 0 --mask {mask}", "out.npz") == []
    cost = read_map(tmp_path / "whole" / "out.npz")
    row, col = cost.frame.bounded_rowcol_from_xy([(12.0, 9.0)])[0][0]
    assert cost.cost[row, col] >= 152


@pytest.mark.parametrize(("name", "output", "memory"), [
    ("run", "out", f"{BASE + 5} MB"), ("esdf", "o.npz", f"{BASE} MB"),
    ("potential", "o.npz", f"{BASE + 20} MB"),
])  # fmt: skip
def test_too_little_memory_is_one_line(command, building, tmp_path, name, output, memory):
    words = [name, building, "-o", tmp_path / output, "--threads", 2, "--max-memory"]
    code, out, err = command(*words, memory)
    assert (code, out) == (3, "")
    message = re.escape(f"error: {building}: 701 x 613 cells need ") + r"([0-9.]+ MB) of memory, "
    first, hint = err.splitlines()
    needed = re.fullmatch(f"{message}{memory} may be used", first)[1]
    assert "--max-memory" in hint
    assert list(tmp_path.iterdir()) == []
    if name == "run":
        assert command(*words, needed)[0] == 0  # which is enough


@pytest.mark.parametrize("memory", [PLENTY, f"{BASE + (23 if IS_COMPILED else 29)}MB"])
def test_pictures_count_as_memory(command, tmp_path, memory):
    write_map(tmp_path / "wide.yaml", OccupancyGrid(np.zeros((100, 9000), np.int8), 0.1))
    words = ("run", tmp_path / "wide.yaml", "-o", tmp_path / "out", "--threads", 1,
             "--max-memory", memory, "--force")  # fmt: skip
    assert command(*words)[0] == 0
    code, _, err = command(*words, "--image-max", 0)
    assert (code == 0) == (memory == PLENTY)
    assert ("9000 x 100 cells need" in err) == (memory != PLENTY)


def test_groups_of_cells_need_the_whole_map(command, building, tmp_path):
    words = ["--min-component", 5, "--threads", 2, "--max-memory", f"{BASE + 0.5}MB"]
    code, _, err = command("active", building, "-o", tmp_path / "out.yaml", *words)
    assert (code != 0, "memory" in err) == (True, True)
    assert list(tmp_path.iterdir()) == []


class Watched:
    """Collects the reports of progress."""

    def __init__(self):
        self.total, self.steps = None, []

    @contextmanager
    def __call__(self, total):
        self.total = total
        yield self.steps.append


@pytest.mark.parametrize(("recipe", "canvas", "images"), [
    ("default", "crop", True), ("design-real", "crop", False), ("design-sim", "full", True),
])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_progress_of_a_run_ends_with_its_end(building, tmp_path, recipe, canvas, images):
    little = size_of(LITTLE, "") if images else size_of(LITTLE, "") - 15 * 10**6
    options = {"force": True, "threads": 2, "images": images, "canvas": canvas}
    for size in (10**12, little) if recipe == "default" else (little,):
        watch = Watched()
        settings = Settings(max_memory=size, progress=watch, **options)
        run_map(building, tmp_path, load_recipe(recipe), settings)
        assert (watch.total is None) == (size != little)
        assert size != little or len(watch.steps) > 20
        assert sum(watch.steps) == (watch.total or 0)


@pytest.mark.parametrize("name", ["inflate.npz", "esdf.npy", "esdf.yaml", "cost.yaml"])
def test_progress_of_a_stage_ends_with_its_end(building, tmp_path, monkeypatch, name):
    monkeypatch.setattr(memory, "_BYTES_PER_CELL_READ", 50.0)
    watch = Watched()
    limits = {"threads": 2, "max_memory": size_of(LITTLE, "")}
    options = Settings(image=tmp_path / "out.png", progress=watch, **limits)
    step = make_step(name.partition(".")[0], {"view": "per-map"} if name == "esdf.yaml" else {})
    apply_to_file(building, tmp_path / name, step, options)
    assert sum(watch.steps) == watch.total > 0


@pytest.mark.parametrize(("text", "size"), [
    ("4G", 4 * 2**30), ("500M", 500 * 2**20), ("1.5GiB", 3 * 2**29), ("4GB", 4 * 10**9),
    ("64 kB", 64_000), ("12", 12), ("2t", 2**41), ("7B", 7),
])  # fmt: skip
def test_sizes(text, size):
    assert size_of(text, "--max-memory") == size


@pytest.mark.parametrize("text", ["", "G", "-4G", "4X", "0", "1e9", "4G4", "nan", "٤G"])
def test_invalid_sizes_are_refused(text):
    with pytest.raises(ParameterError, match="--max-memory"):
        size_of(text, "--max-memory")


def test_a_limit_below_what_the_program_itself_takes_is_refused(command, building):
    for words in (("info", building), ("lint", building), ("report", building, "-o", "o.html")):
        code, out, err = command(*words, "--max-memory", "49MB")
        rule = "must be at least 50 MB, which mapdeal itself takes"
        assert (code, out, err) == (2, "", f"error: --max-memory: {rule}, got '49MB'\n")
