import contextlib
import functools
import gc
import json
import os
import shutil
import signal
import sys
import threading
import warnings
from pathlib import Path

import pytest
import typer
from hypothesis import settings

from mapdeal import MapdealWarning
from mapdeal.cli.main import main
from mapdeal.kernels import threads

ROOT = Path(__file__).parents[1]

# Otherwise each of the many processes compiles the package and the tests again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A first call imports and warms up; how long a case takes says nothing about it.
settings.register_profile("mapdeal", deadline=None, max_examples=20)
settings.register_profile("ci", deadline=None, max_examples=60)
settings.register_profile("quick", deadline=None, max_examples=10)
settings.register_profile("thorough", deadline=None, max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "mapdeal"))

OF_WHOLE_COMMANDS = frozenset({"command", "project", "real_maps", "running"})
"""Fixtures that run whole commands, pages, real maps and browsers."""
OF_WHOLES = {ROOT / "tests" / name for name in ("commands", "cli", "pipeline", "report")}

# Real maps, logs and bags of public repositories: docs/test_data.md describes them.
TEST_DATA = Path(os.environ.get("MAPDEAL_TEST_DATA", ROOT.parent / "shared" / "data"))
NO_TEST_DATA = "needs files of public repositories in MAPDEAL_TEST_DATA: docs/test_data.md"


MEMORY_DISK = Path("/dev/shm")  # noqa: S108 - pytest makes a private folder there


def has_memory_disk():
    return MEMORY_DISK.is_dir() and shutil.disk_usage(MEMORY_DISK).free > 4 << 30


def pytest_configure(config):
    """Answer signals, and try fewer examples where only quick tests are asked for."""
    defaults = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL}
    for name, default in {**defaults, "SIGHUP": signal.SIG_DFL}.items():
        number = getattr(signal, name, None)
        # ignored in jobs that shells run behind, and by nohup
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, default)
    if "not slow" in config.option.markexpr:
        settings.load_profile("quick")
    # Files of thorough tests are too large to be kept in memory.
    if "not thorough" in config.option.markexpr and has_memory_disk():
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY_DISK))


def pytest_ignore_collect(collection_path, config):
    """Import none of the modules all of whose tests are slow, where only quick ones are wanted."""
    if "not slow" not in config.option.markexpr:
        return None
    is_module = collection_path.suffix == ".py"
    all_slow = is_module and "\npytestmark = pytest.mark.slow\n" in collection_path.read_text()
    return True if all_slow or collection_path in OF_WHOLES else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark as slow all thorough tests, and those that run more than a part of the program."""
    for item in items:
        is_whole = not OF_WHOLES.isdisjoint(item.path.parents) or OF_WHOLE_COMMANDS & set(
            getattr(item, "fixturenames", ())
        )
        if is_whole or item.get_closest_marker("thorough"):
            item.add_marker("slow")


def pytest_collection_finish():
    """Exclude the tests themselves from every search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_the_disk():
    """Replace fsync in this process; processes of their own still wait for the disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)  # fstat refuses closed descriptors, too
        yield


@pytest.fixture(scope="session", autouse=True)
def _built_commands():
    """Build each command once; a process of its own builds only the command that it runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", functools.cache(typer.main.get_command))
        yield


@pytest.fixture(scope="session")
def real_maps():
    """The folder of real maps, or a skip where there is none."""
    if not TEST_DATA.is_dir():
        pytest.skip(NO_TEST_DATA)
    return TEST_DATA


@pytest.fixture
def command(capsys):
    """Run the command line in this process; return exit code, stdout and stderr."""

    def run(*words):
        with warnings.catch_warnings():  # a command sets how warnings are shown
            code = main([str(word) for word in words])
        captured = capsys.readouterr()
        if code in (0, 1, 5) and captured.out.startswith("{") and "sarif" not in words:
            check_documents(str(words[0]), captured.out)
        return code, captured.out, captured.err

    return run


def documents_in(text):
    """Return one JSON document, or those of the first lines."""
    with contextlib.suppress(json.JSONDecodeError):
        return [json.loads(text)]
    return [json.loads(line) for line in text.splitlines()[:40]]


def check_documents(name, text):
    """Check what a command has printed by the schema that the site publishes for it."""
    import jsonschema

    import schemas

    for document in documents_in(text) if name in schemas.DOCUMENTS else ():
        jsonschema.Draft202012Validator(schemas.DOCUMENTS[name]).validate(document)


@pytest.fixture
def mapdeal_warnings():
    """Ignore mapdeal's warnings in tests of other behaviour."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        yield


@pytest.fixture
def one_core(monkeypatch):
    """Work in this process and thread, as other tests have the other cores."""
    for module in ("kernels.threads", "pipeline.batch"):
        monkeypatch.setattr(f"mapdeal.{module}.available_threads", lambda: 1)


@pytest.fixture
def scarce_threads(monkeypatch):
    """Return what lets only so many threads be started from then on."""
    available = [0]

    def limited(start):
        def start_if_any(*arguments):
            if available[0] == 0:
                raise RuntimeError("can't start new thread")
            available[0] -= 1
            return start(*arguments)

        return start_if_any

    def allow(count):
        available[0] = count
        for owner, name in ((threading.Thread, "start"), (threads, "start_new_thread")):
            monkeypatch.setattr(owner, name, limited(getattr(owner, name)))

    return allow


@pytest.fixture
def files(tmp_path):
    """Return a function that writes texts or bytes to ``0.yaml``, ``1.yaml``, ..."""

    def write(*texts):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return paths

    return write
