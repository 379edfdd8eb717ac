"""Jobs sent to a cluster of dask.distributed, through its interface of concurrent.futures.

The machines must share the folders of inputs and outputs under the same paths. When a worker
dies, the scheduler gives what it had to others; only a job that takes several with it has failed.
"""

from __future__ import annotations

import logging
import re
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, MapdealError, ParameterError
from mapdeal.files.source import exists
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.batch import Job, Outcome, Submit, Work, WorkerDiedError
from mapdeal.version import __version__

_SECONDS = 10.0
"""For the scheduler to answer, for the first worker to come, and for a lost connection."""

_AT_ONCE = 1000
"""Jobs that the scheduler is given at the same time: enough for a cluster that grows."""

_ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://[^/\s]+:\d{1,5}")
_VERSION = "mapdeal.version.__version__"


class ClusterWorkers:
    """The workers of a cluster."""

    def __init__(self, client: Any, address: str, size: int | None = None) -> None:
        self.size = size or _AT_ONCE
        self._client = client
        self._address = address

    def memory_of_each(self) -> int | None:
        try:
            found = self._client.run(_memory_limit, on_error="ignore").values()
        except Exception:  # noqa: BLE001 - then each looks what is free
            return None
        limits = [limit for limit in found if limit]
        return min(limits) // 2 if limits else None

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:  # noqa: ARG002 - they are there
        """Yield a function that sends jobs; jobs not begun are dropped after the ``with`` block."""
        # the same job may be sent twice, in two batches: its result is never an old one
        executor = self._client.get_executor(pure=False)
        on_worker = _OnWorker(work, __version__)

        def submit(job: Job) -> Future[Outcome]:
            self._wait_for_scheduler(job)
            return _told_as_ours(executor.submit(on_worker, job), job)

        try:
            yield submit
        finally:
            executor.shutdown(wait=False)

    def _wait_for_scheduler(self, job: Job) -> None:
        """Wait while the client tries to find a scheduler again that it has lost."""
        end = time.monotonic() + 2 * _SECONDS
        while self._client.status == "connecting" and time.monotonic() < end:
            time.sleep(0.1)
        if self._client.status != "running":
            rule = f"was not started: the scheduler {self._address} is gone"
            raise WorkerDiedError(rule, source=job.path)


@contextmanager
def connected(address: str, shared: Sequence[Path]) -> Iterator[Any]:
    """Connect to a scheduler within a ``with`` block; give the client."""
    if _ADDRESS.fullmatch(address) is None:
        raise ParameterError("must be tcp://HOST:PORT", source="--scheduler", got=address)
    client = _client(address)
    try:
        _check_workers(client, address, shared)
        yield client
    finally:
        with suppress(Exception):  # it is gone, or goes by itself
            client.close(timeout=_SECONDS)


def shared_folders(job: Job) -> list[Path]:
    """Return folders that are there and that the workers of a job must see, too."""
    above = next(folder for folder in job.folder.parents if exists(folder))
    return [folder for folder in (job.path.parent, above) if exists(folder)]


def _client(address: str) -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        rule = "needs dask.distributed: pip install 'mapdeal[cluster]'"
        raise ParameterError(rule, source="--scheduler") from None
    _silence_logs()
    client_type: Any = distributed.Client
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # such as that versions of Python differ
            return client_type(address, timeout=_SECONDS, set_as_default=False, name="mapdeal")
    except (OSError, ValueError, RuntimeError) as error:
        rule = f"the scheduler does not answer: {_first_line(error)}"
        raise FileAccessError(rule, source=address) from None


def _silence_logs() -> None:
    """Drop the logs of dask's libraries: what they have to say ends up in our errors."""
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _check_workers(client: Any, address: str, shared: Sequence[Path]) -> None:
    """Refuse a cluster that has no workers, or some that cannot do this work."""
    try:
        client.wait_for_workers(1, timeout=_SECONDS)
    except OSError:
        hint = f"dask worker {address} --nthreads 1 starts one"
        rule = "the scheduler has no workers"
        raise FileAccessError(rule, source=address, hint=hint) from None
    # Functions of the standard library, since a worker may lack ours.
    hint = f"pip install mapdeal=={__version__} on the workers"
    for worker, found in _asked(client, address, "pydoc", "locate", _VERSION):
        if found is None:
            raise ParameterError("has no mapdeal", source=f"worker {worker}", hint=hint)
        if found != __version__:
            rule = f"has mapdeal {found}, here it is {__version__}"
            raise ParameterError(rule, source=f"worker {worker}", hint=hint)
    for path in shared:
        for worker, found in _asked(client, address, "os.path", "exists", str(path)):
            if not found:
                rule = f"does not exist for worker {worker}"
                hint = "workers must see inputs and outputs under the same paths"
                raise FileAccessError(rule, source=path, hint=hint)


def _asked(client: Any, address: str, module: str, name: str, text: str) -> list[tuple[str, Any]]:
    """Return what a function of the standard library says on each worker."""
    function = getattr(__import__(module, fromlist=[name]), name)
    try:
        found = client.run(function, text, on_error="ignore")
    except Exception as error:  # noqa: BLE001 - of the network, of pickles, of the event loop
        rule = f"the workers do not answer: {_first_line(error)}"
        raise FileAccessError(rule, source=address) from None
    return sorted(found.items())


def _memory_limit(dask_worker: Any) -> int | None:
    return getattr(getattr(dask_worker, "memory_manager", None), "memory_limit", None)


def _told_as_ours(sent: Future[Outcome], job: Job) -> Future[Outcome]:
    """Return a future whose exceptions are ours, where the cluster is to blame."""
    told: Future[Outcome] = Future()
    told.set_running_or_notify_cancel()

    def pass_on(done: Future[Outcome]) -> None:
        try:
            told.set_result(done.result())
        except CancelledError:
            rule = "was lost: the scheduler is gone or has dropped it"
            told.set_exception(WorkerDiedError(rule, source=job.path))
        except Exception as error:  # noqa: BLE001 - whatever it is, somebody waits for it
            told.set_exception(_ours(error, job))

    sent.add_done_callback(pass_on)
    return told


def _ours(error: Exception, job: Job) -> Exception:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        rule = "every worker that tried this map died"
        hint = "it may have run out of memory: mapdeal run --dry-run shows what a map needs"
        return WorkerDiedError(rule, source=job.path, hint=hint)
    return error


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class _OnWorker:
    """Function that does a job on a worker."""

    work: Work
    version: str

    def __call__(self, job: Job) -> Outcome:
        if self.version != __version__:
            rule = f"a worker has mapdeal {__version__}, it was sent by {self.version}"
            return Outcome(MapdealError(rule, source=job.path))
        # Python's warnings belong to the process, so a worker's threads take turns.
        with _one_at_a_time, use_threads(_threads_of_worker()):
            return self.work(job)


def _threads_of_worker() -> int:
    from distributed import get_worker

    return int(get_worker().state.nthreads)
