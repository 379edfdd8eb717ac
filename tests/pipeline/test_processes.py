"""Worker processes where the system is short of resources, and the files that remain."""

import contextlib
import errno
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import process, wait
from multiprocessing import forkserver, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

import batch_work
from mapdeal import FileAccessError, write_map
from mapdeal.pipeline.batch import Job
from mapdeal.pipeline.workers import ProcessWorkers
from pipeline.reported import rooms_grid

pytestmark = pytest.mark.slow

CANNOT = "worker processes: cannot be started: "


def done_by_a_worker():
    with ProcessWorkers(1).started(1, batch_work.do) as submit:
        return submit(Job(Path("a.yaml"), Path("o"), "a.yaml", "a")).result(timeout=60)


@pytest.mark.parametrize(("module", "number"), [
    (forkserver, errno.EAGAIN), (forkserver, errno.EMFILE), (resource_tracker, errno.ENOMEM),
])  # fmt: skip
def test_a_system_without_processes_or_descriptors_is_one_error(monkeypatch, module, number):
    def refuse():
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(module, "ensure_running", refuse)
    with pytest.raises(FileAccessError) as caught:
        done_by_a_worker()
    assert str(caught.value) == f"{CANNOT}{os.strerror(number)}"
    assert "--jobs 1" in caught.value.hint


@pytest.mark.parametrize("available", [0, 1])
def test_a_pool_that_cannot_have_its_threads_is_one_error_and_does_not_wait_for_ever(
    scarce_threads, available, capfd
):
    scarce_threads(available)
    with pytest.raises(FileAccessError, match=CANNOT):
        done_by_a_worker()
    assert capfd.readouterr() == ("", "")


def test_a_process_that_a_lost_pool_forgets_to_end_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(process._ExecutorManagerThread, "shutdown_workers", lambda *_: None)
    monkeypatch.setattr(BaseProcess, "terminate", lambda *_: None)

    def lose():
        with ProcessWorkers(2).started(2, batch_work.do) as submit:
            jobs = [Job(Path(f"{name}.yaml"), Path("o"), name, name) for name in ("slow", "term")]
            wait([submit(job) for job in jobs])

    thread = threading.Thread(target=lose, daemon=True)
    thread.start()
    thread.join(timeout=60)
    assert not thread.is_alive()


def test_processes_without_a_server_start_afresh(monkeypatch):
    def refuse():
        raise OSError("AF_UNIX path too long")

    monkeypatch.setattr(forkserver, "ensure_running", refuse)
    assert done_by_a_worker().status == "done"


def test_a_server_that_dies_when_it_is_needed_is_started_again(monkeypatch):
    connect, errors = forkserver.connect_to_new_process, [ConnectionRefusedError()]

    def refuse_once(descriptors):
        if errors:
            raise errors.pop()
        return connect(descriptors)

    monkeypatch.setattr(forkserver, "connect_to_new_process", refuse_once)
    assert done_by_a_worker().status == "done"


def started_batch(tmp_path, folder="T", second_map="b.yaml", limit=None):
    """Start a batch of two maps in two processes, in a session and with a TMPDIR of its own.

    It writes to files, since whoever reads from pipes waits for all processes that hold them.
    """
    for name in ("a", "b"):
        write_map(tmp_path / f"{name}.yaml", rooms_grid())
    (tmp_path / folder).mkdir()
    words = ["-m", "mapdeal", "run", "a.yaml", second_map, "-o", "o", "-j", "2", "--no-images"]
    limited = limit and (lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit)))
    with open(tmp_path / "out", "w") as out, open(tmp_path / "err", "w") as err:
        return subprocess.Popen(
            [sys.executable, *words], cwd=tmp_path, start_new_session=True, stdout=out, stderr=err,
            env={**os.environ, "TMPDIR": str(tmp_path / folder)}, preexec_fn=limited,
        )  # fmt: skip


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")


@needs_proc
@pytest.mark.parametrize("folder", [pytest.param("T", marks=pytest.mark.thorough), "T" * 120])
def test_a_batch_leaves_no_process_and_no_temporary_files(tmp_path, folder):
    command = started_batch(tmp_path, folder)
    assert command.wait(timeout=60) == 0
    assert processes_of_session(command.pid) == list((tmp_path / folder).iterdir()) == []
    assert (tmp_path / "err").read_text() == ""


def processes_of_session(number):
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
            if int(session) == number and state != "Z":
                found.append(int(stat.parent.name))
    return found


@needs_proc
@pytest.mark.parametrize(("second_map", "code"), [("bad.yaml", 5), ("b.yaml", 130)])
def test_no_process_outlives_a_batch_that_fails_or_is_interrupted(tmp_path, second_map, code):
    (tmp_path / "bad.yaml").write_text("image: none.pgm\n")
    command, end = started_batch(tmp_path, second_map=second_map), time.monotonic() + 60
    while code == 130 and len(processes_of_session(command.pid)) < 3:
        assert command.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    if code == 130:
        os.killpg(command.pid, signal.SIGINT)
    assert command.wait(timeout=60) == code
    assert processes_of_session(command.pid) == []


@pytest.mark.parametrize("descriptors", [8, 12])
def test_a_batch_without_descriptors_ends_with_one_line_and_leaves_nothing(tmp_path, descriptors):
    command = started_batch(tmp_path, limit=descriptors)
    assert (command.wait(timeout=60), list((tmp_path / "T").iterdir())) == (4, [])
    assert (tmp_path / "out").read_text() == ""
    error, hint = (tmp_path / "err").read_text().splitlines()
    assert error.startswith(f"error: {CANNOT}")
    assert hint.startswith("hint: --jobs 1 ")
