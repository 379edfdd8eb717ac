"""What a run leaves when things go wrong, and that its bytes depend on nothing but its input."""

import os
import resource
import shutil
import subprocess
import sys

import numpy as np
import pytest

from bad_maps import tree
from mapdeal import OccupancyGrid, write_map
from mapdeal.cli.main import main
from robustness.kill_runs import kill_all

pytestmark = pytest.mark.slow

RECIPE = """stages:
- active
- inflate: {radius: 0.15}
- esdf
- potential: {goal: [2.9, 1.27]}
- cost: {inscribed_radius: 0.0}
"""


@pytest.fixture
def folder(tmp_path):
    occupancy = np.where(np.random.default_rng(0).random((90, 120)) < 0.03, 100, 0).astype(np.int8)
    occupancy[:7], occupancy[:, :9] = -1, -1
    occupancy[38:52, 53:67] = 0  # around the goal
    write_map(tmp_path / "m.yaml", OccupancyGrid(occupancy, 0.05, (1.0, -2.0, 0.4)))
    (tmp_path / "r.yaml").write_text(RECIPE)
    return tmp_path


def words(folder, out, *more):
    start = [sys.executable, "-m", "mapdeal", "run", str(folder / "m.yaml"), "--recipe"]
    return [*start, str(folder / "r.yaml"), "-o", str(out), *more]


WIDER = ("--force", "--set", "inflate.radius=0.2")


def run(folder, out, *more, **options):
    return subprocess.run(
        words(folder, folder / out, *more), capture_output=True, text=True, check=False, **options
    )


@pytest.mark.thorough
def test_the_bytes_of_a_run_depend_on_its_input_alone(folder):
    (folder / "elsewhere").mkdir()
    for name in ("m.yaml", "m.pgm", "r.yaml"):
        shutil.copy(folder / name, folder / "elsewhere")
    bare = {"PATH": os.environ["PATH"], "LC_ALL": "C", "TERM": "dumb", "TZ": "Mars/Olympus",
            "SOURCE_DATE_EPOCH": "never",
            "MAPDEAL_KERNELS": os.environ.get("MAPDEAL_KERNELS", "")}  # fmt: skip
    cases = [
        (folder, [], os.environ),
        (folder, ["--threads", "1"], os.environ),
        (folder, ["--threads", "2"], {**os.environ, "MAPDEAL_KERNELS": "scipy"}),
        (folder / "elsewhere", ["--threads", "3"], {**os.environ, "TZ": "Asia/Tokyo"}),
        (folder, [], bare),  # which has no HOME
    ]
    found = []
    for source, more, environment in cases:
        before = {path.name for path in source.iterdir()}
        completed = run(source, "out", *more, "--force", cwd=source, env=environment)
        assert (completed.returncode, completed.stderr) == (0, "")
        assert {path.name for path in source.iterdir()} == before | {"out"}
        found.append(tree(source / "out" / "m"))
        shutil.rmtree(source / "out")
    assert len(found[0]) == 18
    assert found[1:] == found[:1] * 4


def test_a_full_disk_leaves_the_old_outputs(folder):
    """A limit on the size of files stands for the disk: the npz files are larger."""
    assert main(words(folder, folder / "out")[3:]) == 0
    before = tree(folder / "out" / "m")
    limit = (resource.RLIMIT_FSIZE, (30_000, 30_000))
    completed = run(folder, "out", *WIDER, preexec_fn=lambda: resource.setrlimit(*limit))
    assert (completed.returncode, completed.stderr[:7]) == (4, "error: ")
    assert "Traceback" not in completed.stderr
    assert tree(folder / "out" / "m") == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_run_into_a_read_only_folder_is_one_line(folder):
    (folder / "locked").mkdir(mode=0o555)
    completed = run(folder, "locked")
    assert completed.returncode == 4
    assert len(completed.stderr.splitlines()) == 1
    assert not list((folder / "locked").iterdir())


@pytest.mark.thorough
def test_a_run_that_is_killed_leaves_whole_files_and_the_next_cleans_up(folder):
    found, problems = kill_all(folder, 8)
    assert problems == []
    assert sum(found.values()) == 8
