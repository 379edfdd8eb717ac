import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.cli import terminal
from mapdeal.files import source as budget
from mapdeal.kernels.engine import engine_name
from mapdeal.pipeline import batch
from mapdeal.pipeline.settings import Settings

pytestmark = pytest.mark.slow

RUN = [sys.executable, "-m", "mapdeal", "run"]


def make_map(path, seed, side=40):
    """A map with walls by chance, its resolution, origin and yaw of its own."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((side, side + 7)) < 0.02, 100, 0).astype(np.int8)
    cells[: side // 8] = -1
    path.parent.mkdir(parents=True, exist_ok=True)
    write_map(path, OccupancyGrid(cells, 0.05 + seed / 100, (seed, -1.5, 0.3)), force=True)


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """A folder with five maps, one of which is broken, and another YAML file."""
    monkeypatch.chdir(tmp_path)
    for seed, name in enumerate(["a/m.yaml", "a/b/m.yaml", "b/m.yaml", "b/n.yaml"]):
        make_map(tmp_path / "maps" / name, seed)
    (tmp_path / "maps" / "a" / "bad.yaml").write_text("image: none.pgm\n")
    (tmp_path / "maps" / "params.yaml").write_text("amcl:\n  x: 1\n")
    return tmp_path / "maps"


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_folder_is_run_with_any_number_of_jobs_as_its_maps_alone(sh, maps, tmp_path):
    found = {}
    for jobs in (1, 3):
        code, out, err = sh(f"run maps -o o{jobs} --jobs {jobs} --no-images")
        assert (code, err.count("error: ")) == (5, 2)
        assert out.splitlines()[-1] == "5 maps: 4 done, 0 unchanged, 1 failed"
        assert "1 YAML file without the key image was left out: maps/params.yaml" in err
        found[jobs] = contents(tmp_path / f"o{jobs}")
    assert found[1] == found[3]
    for name in ("a/m", "a/b/m", "b/m", "b/n"):
        sh.ok(f"run maps/{name}.yaml -o single/{name}/.. --no-images")
        assert contents(tmp_path / "single" / name) == contents(tmp_path / "o3" / name)
    summary = json.loads(Path("o3/summary.json").read_text())
    states = [(entry["map"], entry["folder"], entry["status"]) for entry in summary["maps"]]
    names = ["a/b/m", "a/bad", "a/m", "b/m", "b/n"]
    exceptions = {"a/bad": "failed"}
    assert states == [(f"{name}.yaml", name, exceptions.get(name, "done")) for name in names]


def test_what_is_unchanged_is_skipped_unless_forced(sh, maps, tmp_path):
    line = "run maps/b -o o --no-images"
    assert sh(line)[0] == 0
    before = contents(tmp_path / "o")
    make_map(maps / "b" / "n.yaml", 9)
    code, out, err = sh(line)
    assert (code, out.splitlines()[-1]) == (5, "2 maps: 0 done, 1 unchanged, 1 failed")
    assert "exists" in err
    code, out, _ = sh(f"{line} --force")
    assert (code, out.splitlines()[-1]) == (0, "2 maps: 2 done, 0 unchanged, 0 failed")
    after = contents(tmp_path / "o")
    changed = {path.parts[0] for path in before if before[path] != after[path]}
    assert changed == {"n", "summary.json"}


LITTLE = "61M" if engine_name() == "compiled" else "112M"


@pytest.mark.parametrize("more", ["-j 2", "--force", f"--max-memory {LITTLE}"])
def test_a_dry_run_lists_what_the_run_then_does_and_writes_nothing(sh, maps, tmp_path, more):
    make_map(maps / "large.yaml", 3, side=1200 if LITTLE in more else 50)
    assert sh("run maps/b -o o/b --no-images")[0] == 0
    make_map(maps / "b" / "n.yaml", 9)  # its outputs are there, and not this map's
    before = contents(tmp_path)
    line = f"run maps -o o --no-images {more}"
    code, out, err = sh(f"{line} --dry-run -v")
    assert (code, contents(tmp_path)) == (5, before)
    written = {line.rpartition(" write ")[2] for line in err.splitlines() if " write " in line}
    rows = [line.split() for line in out.splitlines()[1:] if " -> " in line]  # others would fail
    words_of = {"new": "done", "replace": "done", "unchanged": "unchanged"}
    assert sh(line)[0] == 5
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())["maps"]
    found = {entry["map"]: entry["status"] for entry in summary if entry["status"] != "failed"}
    assert found == {row[-3]: words_of[row[0]] for row in rows}
    after = contents(tmp_path)
    changed = {str(path) for path in after if before.get(path) != after[path]} - {"o/summary.json"}
    assert changed <= written
    assert changed == written or more != "-j 2"  # then files are replaced by equal ones
    assert ("in blocks" in out) == (LITTLE in more)


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.usefixtures("maps")
def test_a_folder_without_a_map_fails_alone(sh, jobs):
    for name in ("empty", "o.json"):  # an existing folder may be named like a file
        Path(name).mkdir()
    odd = Path("maps/b/m.yaml")
    odd.write_text(odd.read_text().replace("negate: 0\n", ""))
    line = f"run empty maps/b none/*.yaml -o o.json -j{jobs} --no-images --report --robot-radius 1"
    code, out, err = sh(line)
    assert (code, out.count("failed (")) == (5, 2)
    assert "error: empty: is a directory without a map" in err
    assert ("without a map" in out, err.count("missing: negate")) == (False, 1)
    entries = json.loads(Path("o.json/summary.json").read_text())["maps"]
    assert [(entry["map"], entry["status"]) for entry in entries] == [
        ("empty", "failed"), ("m.yaml", "done"), ("n.yaml", "done"), ("*.yaml", "failed")
    ]  # fmt: skip
    assert sh(f"{line} --dry-run")[0] == 5
    assert [sh(f"run {name} -o alone")[0] for name in ("empty", "none/*.yaml")] == [4, 2]


@pytest.mark.usefixtures("maps")
def test_a_dry_run_of_one_map_ends_as_its_run_would(sh):
    line = "run maps/a/bad.yaml -o o"
    assert sh(f"{line} -n")[::2] == sh(line)[::2]
    assert sh("run maps/a/m.yaml -o o -n")[0] == 0
    assert not Path("o").exists()


def test_jobs_share_out_threads_and_memory(monkeypatch):
    monkeypatch.setattr(batch, "available_threads", lambda: 8)
    monkeypatch.setattr(budget, "free_memory", lambda: 16_000_000_000)
    run = batch.BatchWork(Settings())
    shared = run.sharing(3)
    assert (shared.settings.threads, shared.settings.max_memory) == (2, 8_000_000_000 // 3)
    assert not shared.settings.memory_is_chosen
    assert run.sharing(1) == run
    chosen = batch.BatchWork(Settings(threads=5, max_memory=10**9))
    assert chosen.sharing(3) == chosen


# four a processor, but eight at least
@pytest.mark.parametrize(("requested", "maps", "processors", "size", "most"), [
    (None, 20, 3, 3, None), (None, 2, 3, 2, None), (1, 20, 3, 1, None), (12, 20, 3, 12, None),
    (13, 20, 3, 12, 12), (8, 20, 1, 8, None), (9, 20, 1, 8, 8), (99, 2, 3, 2, 12),
])  # fmt: skip
def test_jobs_are_bounded(monkeypatch, capsys, requested, maps, processors, size, most):
    terminal.configure(quiet=False, verbose=False)
    monkeypatch.setattr(batch, "available_threads", lambda: processors)
    assert batch.jobs_at_once(requested, maps, terminal) == size
    note = f"note: --jobs {requested}: using {most}, as there are {processors} cores\n"
    assert capsys.readouterr().err == ("" if most is None else note)


@pytest.mark.usefixtures("maps")
def test_without_a_terminal_a_line_tells_now_and_then_how_far_it_is(sh, monkeypatch):
    monkeypatch.setattr(terminal, "PROGRESS_SECONDS", 0)
    err = sh.err("run maps -o o -j 2 --no-images", 5)
    lines = [line for line in err.splitlines() if " maps done" in line]
    assert [line.split(",")[0] for line in lines] == [f"{k} of 5 maps done" for k in range(1, 6)]
    assert lines[-1] == "5 of 5 maps done, 1 failed"
    assert "maps done" not in sh.err("run maps -o q --no-images -q", 5)


@pytest.mark.usefixtures("maps")
def test_on_a_terminal_there_is_a_bar_with_counts(shown_on_terminal):
    shown = shown_on_terminal("run maps -o o -j 2 --no-images")
    assert b"] 5/5, 1 failed" in shown
    assert b"\x1b[K\x1b[31;1merror:" in shown


@pytest.fixture
def large_maps(tmp_path, monkeypatch):
    """Maps that keep two processes busy for some seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    for seed in range(8):
        make_map(tmp_path / "maps" / f"{seed}.yaml", seed, side=1000)
    return tmp_path


def temporary_files(folder):
    return [path for path in folder.rglob(".mapdeal-*") if path.exists()]


def both_write(folder):
    return len({path.parent for path in temporary_files(folder)}) >= 2


def start(folder, *more, until=both_write):
    """Start a run in a session of its own; return when its workers are so far."""
    words = [*RUN, "maps", "-o", "o", "-j", "2", *more]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, start_new_session=True, **streams)
    end = time.monotonic() + 120
    while not until(folder):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.005)
    return process


def members(group):
    """Yield the processes of a session, except those that have ended as zombies."""
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
            if os.getsid(int(folder.name)) == group and state != "Z":
                yield folder


def wait_for_end_of(group):
    end = time.monotonic() + 120
    while list(members(group)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not list(members(group))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux's /proc")
def test_workers_whose_parent_is_gone_clean_up_and_end(large_maps):
    process = start(large_maps)
    process.kill()
    process.communicate(timeout=120)
    assert process.returncode == -signal.SIGKILL
    wait_for_end_of(process.pid)
    assert [*temporary_files(large_maps), *(large_maps / "temporary").iterdir()] == []
