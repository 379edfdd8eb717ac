"""Shared fixtures."""

import os
import threading
import warnings
from pathlib import Path

import pytest
from hypothesis import settings

from mapdeal import MapdealWarning
from mapdeal.cli.main import main

# A first call imports and warms up; how long a case takes says nothing about it.
settings.register_profile("mapdeal", deadline=None)
settings.load_profile("mapdeal")

ROOT = Path(__file__).parents[1]
# Real maps of public repositories; they are not part of the project.
SHARED = Path(os.environ.get("MAPDEAL_SHARED", ROOT.parent / "shared"))


@pytest.fixture(scope="session")
def real_maps():
    """The folder of real maps, or a skip where it is not at hand."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("the real maps are not here")
    return folder


@pytest.fixture
def command(capsys):
    """Run the command line in this process; return exit code, stdout and stderr."""

    def run(*words):
        with warnings.catch_warnings():  # a command sets how warnings are shown
            code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def mapdeal_warnings():
    """Let mapdeal's warnings pass, where a test is about something else."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        yield


@pytest.fixture
def scarce_threads(monkeypatch):
    """Return what lets only so many threads be started from then on."""
    left = [0]
    start = threading.Thread.start

    def start_if_any(thread):
        if left[0] == 0:
            raise RuntimeError("can't start new thread")
        left[0] -= 1
        start(thread)

    def allow(count):
        left[0] = count
        monkeypatch.setattr(threading.Thread, "start", start_if_any)

    return allow
