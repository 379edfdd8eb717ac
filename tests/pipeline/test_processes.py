"""Worker processes where the system has little to give, and what they leave."""

import errno
import os
import resource
import subprocess
import sys
import threading
from concurrent.futures import process, wait
from multiprocessing import forkserver, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

import batch_work
from mapdeal import FileAccessError
from mapdeal.pipeline.batch import Job
from mapdeal.pipeline.workers import ProcessWorkers

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "maps" / "office.yaml"
JOB = Job(Path("a.yaml"), Path("o"), "a.yaml", "a")


def done_by_a_worker():
    with ProcessWorkers(1).started(1, batch_work.do) as submit:
        return submit(JOB).result(timeout=60)


@pytest.mark.parametrize("module", [forkserver, resource_tracker])
@pytest.mark.parametrize("number", [errno.EAGAIN, errno.EMFILE, errno.ENOMEM])
def test_a_system_without_processes_or_descriptors_is_one_error(monkeypatch, module, number):
    def refuse():
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(module, "ensure_running", refuse)
    with pytest.raises(FileAccessError) as caught:
        done_by_a_worker()
    assert str(caught.value) == f"worker processes: cannot be started: {os.strerror(number)}"
    assert "--jobs 1" in caught.value.hint


@pytest.mark.parametrize("available", [0, 1])
def test_a_pool_that_cannot_have_its_threads_is_one_error_and_does_not_wait_for_ever(
    scarce_threads, available, capfd
):
    scarce_threads(available)
    with pytest.raises(FileAccessError, match="worker processes: cannot be started"):
        done_by_a_worker()
    assert capfd.readouterr() == ("", "")


def test_a_process_that_a_lost_pool_forgets_to_end_is_not_waited_for(monkeypatch):
    """As one is that is started at the moment in which another dies."""

    def forget(*_):
        pass

    monkeypatch.setattr(process._ExecutorManagerThread, "shutdown_workers", forget)
    monkeypatch.setattr(BaseProcess, "terminate", forget)

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


@pytest.fixture
def batch(tmp_path):
    """Run two maps in two processes; return what came of it and what is left in TMPDIR."""
    text = EXAMPLE.read_text().replace("office.pgm", str(EXAMPLE.with_suffix(".pgm")))
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text(text)

    def run(folder="T", **limits):
        temporary = tmp_path / folder
        temporary.mkdir()

        def limit():
            for name, value in limits.items():
                resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (value, value))

        told = subprocess.run(
            [sys.executable, "-m", "mapdeal", "run", "a.yaml", "b.yaml", "-o", "o", "-j", "2"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "TMPDIR": str(temporary)},
            preexec_fn=limit,
        )
        return told, list(temporary.iterdir())

    return run


@pytest.mark.parametrize("folder", ["T", "T" * 120])
def test_a_batch_leaves_nothing_among_temporary_files_however_long_their_folder(batch, folder):
    told, left = batch(folder)
    assert (told.returncode, told.stderr, left) == (0, "", [])


@pytest.mark.parametrize("descriptors", [8, 12])
def test_a_batch_without_descriptors_ends_with_one_line_and_leaves_nothing(batch, descriptors):
    told, left = batch(NOFILE=descriptors)
    assert (told.returncode, told.stdout, left) == (4, "", [])
    error, hint = told.stderr.splitlines()
    assert error.startswith("error: worker processes: cannot be started: ")
    assert hint.startswith("hint: --jobs 1 ")
