"""`mapdeal run --scheduler` on a real scheduler with worker processes, all on this machine."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError, Future
from pathlib import Path

import numpy as np
import pytest

import batch_work
from mapdeal import FileAccessError, OccupancyGrid, ParameterError, write_map
from mapdeal.maps.listing import ListedMap
from mapdeal.pipeline import workers as cluster
from mapdeal.pipeline.batch import Batch, Job, jobs_of, run_all

pytest.importorskip("distributed")

PATH = [path for path in [os.environ.get("PYTHONPATH")] if path]
RUN = [sys.executable, "-m", "mapdeal", "run"]


class Cluster:
    """A scheduler and its workers, as somebody starts them by hand."""

    def __init__(self, folder):
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0")
        self.workers = []
        self.address = self._wait(lambda: json.loads(self.file.read_text())["address"])

    def _start(self, kind, *words, path=Path(batch_work.__file__).parent):
        command = [sys.executable, "-m", "distributed.cli.dask_" + kind, *words,
                   "--scheduler-file", str(self.file)]  # fmt: skip
        with (self.folder / f"{kind}.log").open("ab") as log:
            return subprocess.Popen(
                [*command, *(["--no-dashboard"] if kind == "worker" else ["--no-show"])],
                stdout=log, stderr=log, cwd=self.folder,
                env={**os.environ, "PYTHONPATH": os.pathsep.join([str(path), *PATH])},
            )  # fmt: skip

    def start_workers(self, count, **more):
        """Start workers; there is nobody who starts them again when they die."""
        words = f"--no-nanny --nthreads 1 --host 127.0.0.1 --local-directory {self.folder}"
        self.workers += [self._start("worker", *words.split(), **more) for _ in range(count)]

    def wait_for_workers(self, count):
        """Wait until the scheduler knows that many."""

        def are_enough():
            if (self.folder / "worker.log").read_text().count("Registered to") < count:
                raise ValueError(count)

        self._wait(are_enough)

    def _wait(self, ask):
        end = time.monotonic() + 120
        while time.monotonic() < end:
            with contextlib.suppress(OSError, ValueError):
                return ask()
            time.sleep(0.05)
        raise AssertionError((self.folder / "scheduler.log").read_text())

    def end(self):
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()


@pytest.fixture
def dask(tmp_path):
    folder = tmp_path / "dask"
    folder.mkdir()
    started = Cluster(folder)
    try:
        started.start_workers(2)
        yield started
    finally:
        started.end()


@pytest.fixture
def maps(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maps" / "deep").mkdir(parents=True)
    for seed in range(8):
        cells = np.where(np.random.default_rng(seed).random((500, 700)) < 0.02, 100, 0)
        write_map(
            tmp_path / "maps" / ("deep" if seed % 2 else "") / f"{seed}.yaml",
            OccupancyGrid(cells.astype(np.int8), 0.05, (seed, 2.0, 0.3)),
        )
    (tmp_path / "maps" / "bad.yaml").write_text("image: none.pgm\n")
    return tmp_path


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.thorough
def test_files_and_summary_are_those_of_this_machine(dask, maps):
    words = [*RUN, "maps", "--no-images", "-o"]
    far = subprocess.run(
        [*words, "far", "--scheduler", dask.address], capture_output=True, text=True
    )
    assert (far.returncode, far.stderr.count("error: ")) == (5, 2)  # one map's, and the batch's
    assert far.stdout.splitlines()[-1] == "9 maps: 8 done, 0 unchanged, 1 failed"
    here = subprocess.run([*words, "near", "-j", "1"], capture_output=True, text=True)
    assert here.returncode == 5
    assert contents(maps / "far") == contents(maps / "near")

    only_one = subprocess.run(  # which ends as it does without a cluster
        [*RUN, "maps/0.yaml", "-o", "one", "--no-images", "--scheduler", dask.address],
        capture_output=True, text=True,
    )  # fmt: skip
    assert (only_one.returncode, only_one.stderr) == (0, "")
    assert contents(maps / "one" / "0") == contents(maps / "near" / "0")
    assert not (maps / "one" / "summary.json").exists()


@pytest.mark.thorough
def test_a_job_that_kills_its_worker_is_done_by_another_which_may_replace_what_it_left(
    dask, tmp_path
):
    maps = [ListedMap(tmp_path / f"{name}.yaml", name) for name in ("a", "once", "bad", "b")]
    jobs = jobs_of(maps, tmp_path / "o", [])
    with cluster.connected(dask.address, cluster.shared_folders(jobs[0])) as client:
        workers = cluster.ClusterWorkers(client, dask.address)
        outcomes = run_all(
            jobs, tmp_path / "o", batch_work.do, lambda *_: None, Batch, workers=workers
        ).outcomes
        assert [outcome.status for outcome in outcomes] == ["done", "done", "failed", "done"]
        assert str(outcomes[2].result) == f"{tmp_path}/bad.yaml: key: is bad, got [1]"
        assert sorted(process.poll() is None for process in dask.workers) == [False, True]
        dask.scheduler.kill()
        slow = jobs_of([ListedMap(tmp_path / "slow.yaml", "slow")], tmp_path / "o", [])
        outcomes = run_all(
            slow, tmp_path / "o", batch_work.do, lambda *_: None, Batch, workers=workers
        ).outcomes
    assert [outcome.status for outcome in outcomes] == ["failed"]
    assert "scheduler" in str(outcomes[0].result)


@pytest.mark.thorough
def test_workers_of_another_version_are_refused(dask, maps, tmp_path):
    package = tmp_path / "other" / "mapdeal"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "version.py").write_text("__version__ = '0.0.1'")
    words = [*RUN, "maps", "-o", "o", "--scheduler", dask.address]
    dask.start_workers(1, path=package.parent)
    dask.wait_for_workers(3)
    completed = subprocess.run(words, capture_output=True, text=True)
    assert completed.returncode == 2
    lines = completed.stderr.splitlines()
    assert len(lines) == 2
    assert "has mapdeal 0.0.1, here it is " in lines[0]
    assert lines[1].startswith("hint: ")


@pytest.mark.parametrize("is_missing", [False, True])
def test_a_missing_scheduler_or_extra_is_one_line(sh, maps, monkeypatch, is_missing):
    monkeypatch.setattr(cluster, "_TIMEOUT", 0.5)
    exit_code, start = 4, "error: tcp://127.0.0.1:9: the scheduler does not answer: "
    if is_missing:
        monkeypatch.setitem(sys.modules, "distributed", None)
        exit_code, start = (
            2,
            "error: --scheduler: needs dask.distributed: pip install 'distributed>=2024.8'\n",
        )
    code, out, err = sh("run maps -o o --scheduler tcp://127.0.0.1:9")
    assert (code, out, err[: len(start)], err.count("\n")) == (exit_code, "", start, 1)
    assert not (maps / "o").exists()


@contextlib.contextmanager
def other_server(reply):
    """Yield the port of a server that sends each client some bytes, and then nothing more."""
    clients = []

    def serve():
        with contextlib.suppress(OSError):  # the listener is closed
            while True:
                clients.append(listener.accept()[0])
                clients[-1].sendall(reply)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            for client in clients:
                client.close()
    thread.join(timeout=60)


@pytest.mark.parametrize(("reply", "message"), [
    (b"", "the scheduler does not answer: no reply within 1.5 s"),
    (b"HTTP/1.1 400 Bad Request\r\n\r\n", "does not answer as a dask scheduler"),
    (bytes(1000), "does not answer as a dask scheduler"),
])  # fmt: skip
def test_servers_of_other_programs_are_refused_in_time(sh, maps, monkeypatch, reply, message):
    assert cluster._TIMEOUT + cluster._SECONDS_TO_ANSWER == 10
    monkeypatch.setattr(cluster, "_TIMEOUT", 0.5)
    with other_server(reply) as port:
        begin = time.monotonic()
        code, out, err = sh(f"run maps/0.yaml -o o --scheduler tcp://127.0.0.1:{port}")
        assert time.monotonic() - begin < 9
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert err.startswith(f"error: tcp://127.0.0.1:{port}: {message}")
    assert not (maps / "o").exists()


@pytest.mark.parametrize(
    "address",
    [*(f"tcp://h:{port}" for port in (0, 65536, 99999, -1, "abc", "", "\u0669", "80/", "8 0")),
     "inproc://h:1", "foo://h:1", "h:1", "tcp://h", "tcp://:1", "tcp://::1:1", "tcp://a:b:1", ""],
)  # fmt: skip
def test_impossible_addresses_are_refused_before_a_connection(address):
    with (
        pytest.raises(ParameterError, match="must be tcp://HOST:PORT with a port fr") as refusal,
        cluster.connected(address, []),
    ):
        pass
    assert refusal.value.hint.endswith(": tcp://127.0.0.1:8786")


@pytest.mark.parametrize("scheme", ["tls", "ucx"])
def test_schemes_that_are_not_set_up_are_refused_with_a_hint(sh, maps, monkeypatch, scheme):
    monkeypatch.setattr(cluster, "_TIMEOUT", 4.0)
    code, out, err = sh(f"run maps/0.yaml -o o --scheduler {scheme}://127.0.0.1:9")
    error, hint = err.splitlines()
    assert (code, out) == (2, "")
    assert error.startswith(f"error: --scheduler: {scheme} is not set up on this machine: ")
    assert hint == f"hint: {cluster._SET_UPS[scheme]}"
    assert not (maps / "o").exists()


def test_workers_that_do_not_answer_are_refused_in_time(monkeypatch):
    monkeypatch.setattr(cluster, "_TIMEOUT", 0.1)
    has_ended = threading.Event()

    class SilentClient:
        def run(self, *_, **__):
            has_ended.wait(timeout=60)

    try:
        with pytest.raises(FileAccessError, match="the workers do not answer: no reply wit"):
            cluster.ClusterWorkers(SilentClient(), "tcp://h:1").memory_of_each()
    finally:
        has_ended.set()


def test_jobs_that_a_closed_client_refuses_have_failed(tmp_path):
    class ClosedClient:
        status = "running"

        def get_executor(self, **_):
            return self

        def submit(self, *_):
            raise Exception("it has closed")

        def shutdown(self, **_):
            pass

    jobs = jobs_of([ListedMap(tmp_path / "m.yaml", "m")], tmp_path / "o", [])
    workers = cluster.ClusterWorkers(ClosedClient(), "tcp://h:1")
    (outcome,) = run_all(
        jobs, tmp_path / "o", batch_work.do, lambda *_: None, Batch, workers=workers
    ).outcomes
    assert str(outcome.result).endswith("m.yaml: was not started: it has closed")
    assert outcome.result.exit_code == 5


def test_failures_of_a_cluster_are_outcomes_of_their_map():
    from distributed import KilledWorker

    job = Job(Path("/d/m.yaml"), Path("/d/o"), "m.yaml", "m")
    for problem, text in (
        (KilledWorker("task", None, 3), "/d/m.yaml: every worker that tried this map died"),
        (CancelledError(), "/d/m.yaml: was lost: the scheduler is gone or has dropped it"),
        (ZeroDivisionError("x"), "/d/m.yaml: was lost: x"),
    ):
        sent = Future()
        future = cluster._with_own_errors(sent, job)
        if isinstance(problem, CancelledError):
            sent.cancel()
            sent.set_running_or_notify_cancel()
        else:
            sent.set_exception(problem)
        assert str(future.exception(timeout=120)) == text


def test_a_worker_that_comes_later_with_another_version_does_no_job(tmp_path):
    job = Job(tmp_path / "m.yaml", tmp_path / "o", "m.yaml", "m")
    outcome = cluster._work_on_cluster(batch_work.do, "0.0.1", job)
    assert outcome.status == "failed"
    assert "0.0.1" in str(outcome.result)
    assert not (tmp_path / "o").exists()
