"""What a run leaves when things go wrong, and that its bytes depend on nothing but its input."""

import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.checks.lint import lint_file

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
    rng = np.random.default_rng(0)
    occupancy = np.where(rng.random((90, 120)) < 0.03, 100, 0).astype(np.int8)
    occupancy[:7], occupancy[:, :9] = -1, -1
    occupancy[38:52, 53:67] = 0  # around the goal
    write_map(tmp_path / "m.yaml", OccupancyGrid(occupancy, 0.05, (1.0, -2.0, 0.4)))
    (tmp_path / "r.yaml").write_text(RECIPE)
    return tmp_path


def words(folder, out, *more):
    start = [sys.executable, "-m", "mapdeal", "run", str(folder / "m.yaml"), "--recipe"]
    return [*start, str(folder / "r.yaml"), "-o", str(out), *more]


def sums(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()
    }  # fmt: skip


@pytest.mark.thorough
def test_the_bytes_of_a_run_depend_on_its_input_alone(folder):
    """Not on threads, the engine, the working directory, the input's path, or when it is run."""
    (folder / "elsewhere").mkdir()
    for name in ("m.yaml", "m.pgm", "r.yaml"):
        shutil.copy(folder / name, folder / "elsewhere")
    cases = [
        (folder, [], {}),
        (folder, ["--threads", "1"], {}),
        (folder, ["--threads", "2"], {"MAPDEAL_KERNELS": "scipy"}),
        (folder / "elsewhere", ["--threads", "3"], {"TZ": "Asia/Tokyo", "LC_ALL": "C"}),
    ]
    found = []
    for number, (source, more, environment) in enumerate(cases):
        subprocess.run(
            words(source, folder / f"out{number}", *more), check=True, capture_output=True,
            cwd=source, env={**os.environ, **environment},
        )  # fmt: skip
        found.append(sums(folder / f"out{number}" / "m"))
    assert len(found[0]) == 18
    assert found[1:] == found[:1] * 3


def test_a_full_disk_leaves_the_old_outputs_f4(folder):
    """A limit on the size of files stands for the disk: the npz files are larger."""
    subprocess.run(words(folder, folder / "out"), check=True, capture_output=True)
    before = sums(folder / "out" / "m")

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))

    done = subprocess.run(
        words(folder, folder / "out", "--force", "--set", "inflate.radius=0.2"),
        capture_output=True, text=True, preexec_fn=limit,
        check=False,
    )  # fmt: skip
    assert done.returncode == 4
    assert done.stderr.splitlines()[0].startswith("error: ")
    assert "Traceback" not in done.stderr
    assert sums(folder / "out" / "m") == before


@pytest.mark.thorough
def test_two_runs_into_one_folder_do_not_mix_f6(folder):
    radii = ("0.1", "0.2")
    known = []
    for radius in radii:
        more = ["--set", f"inflate.radius={radius}"]
        subprocess.run(words(folder, folder / radius, *more), check=True, capture_output=True)
        known.append(sums(folder / radius / "m"))
    for _ in range(5):
        running = [
            subprocess.Popen(
                words(folder, folder / "out", "--force", "--set", f"inflate.radius={radius}"),
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            )
            for radius in radii
        ]  # fmt: skip
        for process in running:
            _, stderr = process.communicate(timeout=120)
            assert process.returncode == 0, stderr
        found = sums(folder / "out" / "m")
        assert found in known
        assert lint_file(folder / "out" / "m") == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_f2(folder):
    (folder / "locked").mkdir(mode=0o555)
    done = subprocess.run(
        words(folder, folder / "locked"), capture_output=True, text=True, check=False
    )
    assert done.returncode == 4
    assert len(done.stderr.splitlines()) == 1
    assert not list((folder / "locked").iterdir())


@pytest.mark.thorough
def test_odd_environments_change_nothing_f14_f15(folder):
    """No HOME, another locale, a dumb terminal, a clock far away: the same bytes, and no cache."""
    subprocess.run(words(folder, folder / "usual"), check=True, capture_output=True)
    environment = {
        "PATH": os.environ["PATH"], "LC_ALL": "C", "TERM": "dumb", "TZ": "Mars/Olympus",
        "SOURCE_DATE_EPOCH": "never", "MAPDEAL_KERNELS": os.environ.get("MAPDEAL_KERNELS", ""),
    }  # fmt: skip
    before = sorted(path.name for path in folder.iterdir())
    done = subprocess.run(
        words(folder, folder / "odd"), env=environment, cwd=folder, capture_output=True, check=True
    )
    assert done.stderr == b""
    assert sums(folder / "odd" / "m") == sums(folder / "usual" / "m")
    assert sorted(path.name for path in folder.iterdir()) == sorted([*before, "odd"])


def test_a_replaced_file_keeps_its_permissions_f20(folder):
    subprocess.run(words(folder, folder / "out"), check=True, capture_output=True)
    target = folder / "out" / "m" / "cost.pgm"
    target.chmod(0o640)
    more = ["--force", "--set", "inflate.radius=0.2"]
    subprocess.run(
        words(folder, folder / "out", *more), check=True, capture_output=True, umask=0o077
    )
    assert target.stat().st_mode & 0o777 == 0o640


@pytest.mark.thorough
@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_stopped_leaves_the_old_set_and_the_next_cleans_up_f5(folder, sent):
    subprocess.run(words(folder, folder / "out"), check=True, capture_output=True)
    left = folder / "out" / "m"
    before = sums(left)
    more = ["--force", "--set", "inflate.radius=0.2"]
    process = subprocess.Popen(words(folder, folder / "out", *more), stderr=subprocess.PIPE)
    deadline = time.monotonic() + 120
    while not list(left.glob(".mapdeal-*")) and time.monotonic() < deadline:
        time.sleep(0.001)
    process.send_signal(sent)
    _, stderr = process.communicate(timeout=120)
    if process.returncode == 0:
        pytest.skip("the run was faster than the signal")
    found = sums(left)
    if sent == signal.SIGKILL:
        found = {name: digest for name, digest in found.items() if not name.startswith(".")}
    else:
        assert process.returncode == 128 + sent
        assert stderr.startswith(b"error: ")
        assert stderr.count(b"\n") == 1
    assert found == before
    subprocess.run(words(folder, folder / "out", *more), check=True, capture_output=True)
    assert not list(left.glob(".mapdeal-*"))
    assert lint_file(left) == []
