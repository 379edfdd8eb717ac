"""Locks on folders, and what is written through to the disk."""

import fcntl
import os
from contextlib import contextmanager

import pytest

from mapdeal.formats.temporary import locked, sync_folder


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
