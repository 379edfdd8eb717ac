"""Inputs that are replaced while they are read: a result is of the old ones or of the new ones.

Never of both, and always with the checksums of the very files that were read. The moments are
the calls to the system that a command makes, so they are the same on every machine.
"""

import os
import shutil
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.kernels.blocks import CacheBudget
from mapdeal.pipeline import inputs as memory

pytestmark = pytest.mark.slow

FEW, MOMENTS = 9, 50
ROWS = 7  # of a block


def grid(seed, shape=(41, 30)):
    """A map of obstacles, and unknown cells in half of it, so that two differ everywhere."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random(shape) < 0.05, 100, 0).astype(np.int8)
    cells[rng.random(shape) < 0.2] = -1
    return OccupancyGrid(cells, 0.3 + seed / 10, (1.5, -2.0 - seed, 0.4))


def log(seed):
    pose, beams = f"{seed} 2 0.3", " ".join(["FLASER 180", *[f"{seed + 3}.5"] * 180])
    return "".join(f"{beams} {pose} {pose} {k} host {k}\n" for k in range(100))


def cloud(seed):
    return "".join(f"{1 + k % 20 / 10} {seed + k // 20 / 10} 0.5\n" for k in range(200))


@pytest.fixture
def pairs(tmp_path, monkeypatch):
    """Two maps of one name and size, the old one in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name, seed in (("old", 1), ("new", 2), (".", 1)):
        write_map(tmp_path / name / "m.yaml", grid(seed))
        write_map(tmp_path / name / "m.npz", grid(seed))
        (tmp_path / name / "m.log").write_text(log(seed))
        (tmp_path / name / "m.txt").write_text(cloud(seed))
    return tmp_path


def put_new(folder, name="m.pgm"):
    shutil.copy(folder / "new" / name, folder / "next")
    (folder / "next").replace(folder / name)


def overwrite_picture(folder):
    (folder / "m.pgm").write_bytes((folder / "new" / "m.pgm").read_bytes())


def replace_pair(folder):
    """Write the new map over the old one, as mapdeal does it."""
    write_map(folder / "m.yaml", grid(2), force=True)


REPLACEMENTS = [put_new, overwrite_picture, replace_pair]


def by_rows(file, *_):
    """Read few rows at a time, where the file as it is can be read so."""
    file.shape()
    if file.shape_by_rows is None:
        return file.read()
    return file.by_rows(block_height=ROWS, budget=CacheBudget(0))


@pytest.fixture
def moments(monkeypatch):
    """Counts calls to the system, and does something at one of them."""
    state = SimpleNamespace(count=0, at=None, action=None)

    def counted(call):
        def counting(*arguments, **options):
            state.count += 1
            if state.count == state.at:
                state.action()
            return call(*arguments, **options)

        return counting

    for name in ("open", "pread", "read", "stat", "fstat", "lstat", "scandir"):
        monkeypatch.setattr(os, name, counted(getattr(os, name)))
    return state


def contents(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes()
            for p in folder.rglob("*") if p.is_file()}  # fmt: skip


COMMANDS = {
    "run": "run m.yaml -o out/set --no-images",
    "run by rows": "run m.yaml -o out/set --no-images",
    "run of an npz": "run m.npz -o out/set --no-images",
    "esdf": "esdf m.yaml -o out/o.npz",
    "esdf by rows": "esdf m.yaml -o out/o.npy",
    "batch": "run m.yaml other/m2.yaml -o out/set -j 1 --no-images",
    "build": "build m.log -o out/o.npz",
    "local": "local --cloud m.txt --pose 1,2,0.3 -o out --no-images",
    "local on a map": "run m.yaml --cloud m.txt --pose 1,2,0.3 -o out/set --no-images",
}


@pytest.mark.parametrize(("name", "count"), [
    *((name, FEW) for name in ("run", "esdf by rows", "build")),
    *(pytest.param(name, MOMENTS, marks=pytest.mark.thorough) for name in COMMANDS),
])  # fmt: skip
def test_a_result_is_of_the_old_inputs_or_of_the_new_ones(
    pairs, command, monkeypatch, moments, name, count
):
    words = [*COMMANDS[name].split(), "--threads", "1", "-q"]
    if "by rows" in name:
        monkeypatch.setattr(memory, "_read", by_rows)
    write_map(pairs / "other" / "m2.yaml", grid(3))
    outputs = pairs / "out"

    def begin():
        shutil.rmtree(outputs, ignore_errors=True)
        outputs.mkdir()
        for file in (pairs / "old").iterdir():
            shutil.copy(file, pairs / file.name)

    def act(replace=put_new):
        replace(pairs)
        for name in ("m.npz", "m.log", "m.txt"):
            put_new(pairs, name)

    known = []
    for action in (lambda: None, act, partial(act, replace_pair)):
        begin()
        action()
        assert command(*words)[0] == 0
        known.append(contents(outputs))
    assert known[0] not in known[1:]

    begin()
    moments.count = 0
    command(*words)
    calls = moments.count
    assert calls > 2 * FEW
    outcomes = []
    for index in range(count):
        begin()
        moments.action = partial(act, REPLACEMENTS[index % len(REPLACEMENTS)])
        moments.count, moments.at = 0, 1 + index * calls // count
        code, _, err = command(*words)
        moments.at = None
        if code == 0:
            assert contents(outputs) in known, index
            outcomes.append(known.index(contents(outputs)))
        elif name == "batch" and code == 5:
            assert "changed while it was read" in err
            assert not (outputs / "set" / "m").exists()
        else:
            assert (code, "changed while it was read" in err) == (4, True), (index, err)
            assert contents(outputs) == {}
            outcomes.append(None)
    assert len(set(outcomes)) >= 2, outcomes  # the moments were such that it mattered
