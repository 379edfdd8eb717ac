"""Locks on folders, signals put off, and what is written through to the disk."""

import fcntl
import os
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.files import transaction as temporary
from mapdeal.files.transaction import Temporary, locked, signals_put_off, sync_folder


@contextmanager
def _tried(folder):
    """Try to lock a folder as another process would."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


def test_folders_are_locked_all_of_them_and_no_longer_than_needed(tmp_path):
    folders = [tmp_path / name for name in "ba"]
    for folder in folders:
        folder.mkdir()
    with locked(folders):
        for folder in folders:
            with pytest.raises(BlockingIOError), _tried(folder):
                pass
        with _tried(tmp_path):
            pass
    for folder in folders:
        with _tried(folder):
            pass


def test_locks_are_given_back_after_an_error(tmp_path):
    with pytest.raises(RuntimeError), locked([tmp_path]):
        raise RuntimeError
    with _tried(tmp_path):
        pass


def test_the_names_of_a_folder_are_written_through(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor)))
    sync_folder(tmp_path)
    assert [one.st_ino for one in synced] == [tmp_path.stat().st_ino]


def test_signals_are_answered_after_the_block_and_their_handlers_are_back():
    reached = False
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), signals_put_off():
        signal.raise_signal(signal.SIGINT)
        reached = True
    assert reached
    assert signal.getsignal(signal.SIGINT) is before


def test_ignored_signals_stay_ignored_and_other_threads_are_left_alone():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_put_off():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    handlers = []

    def look():
        with signals_put_off():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert handlers == [signal.getsignal(signal.SIGINT)]


@pytest.fixture
def as_on_windows(monkeypatch):
    """There are no locks, and no open file can be renamed or removed."""

    def is_open(path):
        links = (Path("/proc/self/fd") / one for one in os.listdir("/proc/self/fd"))  # noqa: PTH208
        return any(os.path.realpath(one) == os.path.realpath(path) for one in links)

    def refusing(done):
        def do(path, *words, **options):
            if is_open(path):
                raise PermissionError(13, "used by another process")
            return done(path, *words, **options)

        return do

    monkeypatch.setattr(temporary, "fcntl", None)
    for name in ("replace", "rename", "unlink"):
        monkeypatch.setattr(Path, name, refusing(getattr(Path, name)))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux's /proc")
def test_no_open_file_is_renamed_or_removed_where_that_is_refused(tmp_path, as_on_windows):
    with pytest.raises(PermissionError), (tmp_path / "open").open("w"):
        (tmp_path / "open").unlink()
    for value in (0, 100):
        grid = OccupancyGrid(np.full((3, 5), value, np.int8), 0.25, (1.0, 2.0, 0.5))
        write_map(tmp_path / "m.yaml", grid, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.pgm", "m.yaml", "open"]
    assert (tmp_path / "m.pgm").read_bytes().endswith(bytes(15))
    given_up = Temporary(tmp_path / "n.yaml")
    given_up.open()
    given_up.remove()
    assert not given_up.path.exists()
