"""Signals that end a command, at any moment: the old or the new outputs, and nothing else."""

import contextlib
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mapdeal import read_map, write_map
from mapdeal.files.transaction import Temporary, Transaction

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
OFFICE = EXAMPLES / "maps" / "office.yaml"
COMMANDS = {
    "run {map} -o o --force --set inflate.radius={}": ("0.1", "0.3"),
    "run {maps} -o o --force --no-images --jobs 2 --set inflate.radius={}": ("0.1", "0.3"),
    "inflate - -o o.npz --force --radius {}": ("0.1", "0.3"),
    "convert {map} -o o.db3 --force --frame-id {}": ("map", "odom"),
    "build {bag} -o o.yaml --force --resolution {}": ("0.1", "0.2"),
    "merge {map} {map} -o o.yaml --force --by {}": ("frames", "align"),
}


def session(leader):
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[3]) == leader and fields[0] != "Z":
                yield stat.parent.name


def sets(folder):
    """The checksums of outputs, those of each map of a batch by themselves, without its summary."""
    parts = {}
    for path in folder.rglob("*"):
        if path.is_file() and path.name != "summary.json":
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            parts.setdefault(str(path.parent.relative_to(folder)), {})[path.name] = digest
    return parts


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
@pytest.mark.parametrize("words", COMMANDS)
def test_a_signal_at_any_moment_leaves_one_set_and_nothing_else(tmp_path, words):
    if "{bag}" in words:
        zstandard = pytest.importorskip("zstandard")
        bag = (EXAMPLES / "bags" / "office.mcap").read_bytes()
        (tmp_path / "office.mcap.zstd").write_bytes(zstandard.compress(bag))
    write_map(tmp_path / "in.npz", read_map(OFFICE))
    places = {"map": OFFICE, "maps": EXAMPLES / "maps", "bag": tmp_path / "office.mcap.zstd"}

    def start(folder, value):
        (tmp_path / "temporary").mkdir(exist_ok=True)
        folder.mkdir(exist_ok=True)
        with (tmp_path / "in.npz").open("rb") as stdin:
            return subprocess.Popen(
                [sys.executable, "-m", "mapdeal", *words.format(value, **places).split()],
                cwd=folder, stdin=stdin, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                text=True, start_new_session=True,
                env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
            )  # fmt: skip

    old, new = COMMANDS[words]
    known = []
    for value in (old, new):
        begun, process = time.monotonic(), start(tmp_path / value, value)
        _, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        duration = time.monotonic() - begun
        known.append(sets(tmp_path / value))
    moments = random.Random(words)
    for _ in range(10):
        shutil.rmtree(tmp_path / "here", ignore_errors=True)
        shutil.copytree(tmp_path / old, tmp_path / "here")
        sent = moments.choice([signal.SIGTERM, signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
        process = start(tmp_path / "here", new)
        time.sleep(moments.uniform(0.3, 1.0) * duration)
        for _ in range(moments.choice([1, 2])):  # as timeout(1) does
            if process.poll() is None:
                moments.choice([os.kill, os.killpg])(process.pid, sent)
        _, err = process.communicate(timeout=300)
        lines = [line for line in err.splitlines() if not line.startswith("warning: ")]
        if process.returncode:
            assert process.returncode == 128 + sent, err
            ending = "interrupted" if sent == signal.SIGINT else f"terminated by {sent.name}"
            assert len(lines) == 1
            assert lines[0].startswith(f"error: {ending}")
        end = time.monotonic() + 60
        while list(session(process.pid)) and time.monotonic() < end:
            time.sleep(0.05)
        assert not list(session(process.pid))
        assert not list((tmp_path / "temporary").iterdir())
        for place, files in sets(tmp_path / "here").items():
            assert files in [known_files.get(place) for known_files in known]


def test_who_writes_in_a_thread_stops_when_the_outputs_are_dropped(tmp_path):
    written = []

    def write_for_ever(file):
        while True:
            written.append(file.write(bytes(1000)))

    with pytest.raises(KeyboardInterrupt), Transaction([tmp_path / "a"]) as transaction:
        transaction.write(tmp_path / "a", write_for_ever)
        while not written:
            time.sleep(0.001)
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_before_a_block_can_clean_up_leaves_nothing(tmp_path, sent):
    """Python may raise at the first instruction of `__exit__`, which then does nothing."""
    code = f"""
import signal, sys
from mapdeal.cli.process import run_process
from mapdeal.files.transaction import Transaction

def interrupted(*_):
    signal.raise_signal({int(sent)})
Transaction.__exit__ = interrupted
sys.argv = ["mapdeal", "inflate", {str(OFFICE)!r}, "-o", {str(tmp_path / "new" / "o.yaml")!r}]
run_process()
"""
    words = [sys.executable, "-c", code]
    completed = subprocess.run(words, capture_output=True, text=True, check=False)
    ending = "interrupted" if sent == signal.SIGINT else f"terminated by {sent.name}"
    assert (completed.returncode, completed.stderr) == (128 + sent, f"error: {ending}\n")
    assert not list(tmp_path.iterdir())


def test_signals_that_are_ignored_stay_ignored(tmp_path):
    words = [sys.executable, "-m", "mapdeal", "inflate", "-", "-o", str(tmp_path / "o.npz")]
    write_map(tmp_path / "in.npz", read_map(OFFICE))
    ignored = f"trap '' HUP TERM; exec {' '.join(words)}"
    process = subprocess.Popen(["sh", "-c", ignored], stdin=subprocess.PIPE)
    time.sleep(0.5)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    process.communicate((tmp_path / "in.npz").read_bytes(), timeout=120)
    assert process.returncode == 0


def test_only_a_command_that_writes_removes_what_a_killed_one_has_left(tmp_path, command):
    shutil.copy(OFFICE, tmp_path / "m.yaml")
    shutil.copy(OFFICE.with_suffix(".pgm"), tmp_path / "office.pgm")
    stale = tmp_path / ".mapdeal-0123456789ab.tmp"
    stale.write_text("of a killed process")
    locked = Temporary(tmp_path / "other")
    locked.open()
    for words in (["info"], ["lint"], ["query", "--at", "0,0"]):
        assert command(*words, tmp_path / "m.yaml")[0] == 0
        assert stale.exists()
    assert command("inflate", tmp_path / "m.yaml", "-o", tmp_path / "o.yaml")[0] == 0
    assert not stale.exists()
    assert locked.path.exists()
    locked.remove()
