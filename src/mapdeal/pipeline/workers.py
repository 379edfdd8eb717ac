"""Workers that do jobs: processes of this machine, or those of a cluster of dask.distributed."""

from __future__ import annotations

import atexit
import errno
import logging
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import resource_tracker, util
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from mapdeal.errors import FileAccessError, MapdealError, ParameterError
from mapdeal.files.source import exists
from mapdeal.files.transaction import folder_for_sockets, signals_deferred
from mapdeal.kernels.engine import VARIABLE
from mapdeal.kernels.threads import ThreadPool, Worker, use_threads
from mapdeal.pipeline.batch import TOO_LARGE, Job, Outcome, Submit, Work, WorkerDiedError
from mapdeal.version import __version__

_T = TypeVar("_T")

_SECONDS_TO_CLEAN_UP = 10.0
_SECONDS_BETWEEN_LOOKS = 0.1
_STOPPED = 128 + signal.SIGTERM

_LONGEST_FOLDER = 107 - len("/pymp-12345678/listener-12345678")
"""Bytes that the name of the folder for temporary files may have, so that of a socket fits."""

_PRELOADED = (
    "mapdeal.pipeline.worker_server",
    "mapdeal.pipeline.batch", "mapdeal.pipeline.workers", "mapdeal.pictures.layers",
    "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont", "PIL.PngImagePlugin", "tokenize",
)  # fmt: skip
"""Modules that runs import: the server that workers are forked from imports them once."""


class ProcessWorkers:
    # They hold the reading end of a pipe of which this process alone has the other end. When that
    # end is closed, on purpose or because the process is gone, a worker stops: an exception unwinds
    # its job, so that temporary files are removed.

    def __init__(self, size: int) -> None:
        self.size = size

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:
        """Run processes within a ``with`` block, stopped early if an exception leaves it."""
        with ExitStack() as stack:
            with _start_errors():
                context = _context()
                lifeline, held_end = multiprocessing.Pipe(duplex=False)
                stack.callback(lifeline.close)
                stack.callback(held_end.close)
                executor = ProcessPoolExecutor(
                    size, context, initializer=_set_up,
                    initargs=(lifeline, os.environ.get(VARIABLE)),
                )  # fmt: skip
                stack.callback(_shut_down, executor)

            is_lost = threading.Event()

            def look_at(future: Future[Outcome]) -> None:
                if not future.cancelled() and isinstance(future.exception(), BrokenProcessPool):
                    is_lost.set()

            def submit(job: Job) -> Future[Outcome]:
                try:
                    future = _sent(executor, _stoppable, work, job)
                except (OSError, EOFError, BrokenProcessPool) as error:  # of a process it needs
                    is_lost.set()
                    raise BrokenProcessPool(str(error)) from None
                future.add_done_callback(look_at)
                return future

            try:
                with _start_errors():
                    _wait_for_first(executor)
                yield submit
            except BaseException:
                held_end.close()
                raise
            if is_lost.is_set():
                # A pool that has lost a process ends the others, but not one that is started at
                # that moment, and would wait for it for ever.
                held_end.close()


@contextmanager
def _start_errors() -> Iterator[None]:
    """Replace errors of the system at the start of processes by one error."""
    try:
        yield
    except (OSError, EOFError, RuntimeError, ImportError, NotImplementedError) as error:
        # a pool breaks, and a server ends, when the system refuses them a resource
        why = getattr(error, "strerror", None) or "the system has no more to give"
        rule = f"cannot be started: {why}"
        hint = "--jobs 1 needs none; ulimit -a shows the limits"
        raise FileAccessError(rule, source="worker processes", hint=hint) from None


def _sent(executor: ProcessPoolExecutor, function: Callable[..., _T], *values: Any) -> Future[_T]:
    """Send work to a pool, which may start a process for it, not to be lost by a Ctrl-C."""
    with signals_deferred(), _terminal_blocked():
        return executor.submit(function, *values)


def _shut_down(executor: ProcessPoolExecutor) -> None:
    with suppress(RuntimeError):  # the pool's own thread could not be started
        executor.shutdown(cancel_futures=True)


def _wait_for_first(executor: ProcessPoolExecutor) -> None:
    """Wait until the first process has started, and the threads that serve the pool."""
    failures: list[object] = []
    before, threading.excepthook = threading.excepthook, failures.append
    try:
        first = _sent(executor, int)
        while not first.done():  # without its threads a pool never comes to do it
            if failures:
                raise RuntimeError
            wait_for([first], timeout=_SECONDS_BETWEEN_LOOKS)
        first.result()
    finally:
        threading.excepthook = before


def _end_helpers() -> None:
    """End the server that workers are forked from, and multiprocessing's tracker of semaphores."""
    server: Any = getattr(sys.modules.get("multiprocessing.forkserver"), "_forkserver", None)
    tracker: Any = resource_tracker._resource_tracker  # noqa: SLF001
    with suppress(ProcessLookupError, ChildProcessError):  # they have ended
        if server is not None and server._forkserver_pid is not None:  # noqa: SLF001
            os.kill(server._forkserver_pid, signal.SIGKILL)  # noqa: SLF001 - it holds no state
            os.waitpid(server._forkserver_pid, 0)  # noqa: SLF001
        tracker._stop()  # noqa: SLF001


def _context() -> BaseContext:
    # Left alone, helpers notice only later that this process has ended. The number makes this the
    # last thing that multiprocessing does at its end, after it has removed the server's socket.
    util.Finalize(None, _end_helpers, exitpriority=-101)
    # Never from this one: it may have threads, whose locks a fork would copy as they are. Where the
    # server cannot have its socket, as the folder for temporary files has too long a name or is
    # none, each process starts afresh.
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing import forkserver

        # Ctrl-C goes to all processes of a terminal. Here it is this one's to answer; a worker
        # that is only starting would print a traceback. It inherits that the signal is blocked.
        # The tracker comes first, since its start unblocks it again; it ignores all but SIGHUP.
        with _terminal_blocked():
            resource_tracker.ensure_running()
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_PRELOADED))
        try:
            if len(os.fsencode(folder_for_sockets())) > _LONGEST_FOLDER:
                raise OSError("AF_UNIX path too long")  # before a folder is made, to be left there
            with _terminal_blocked():
                forkserver.ensure_running()
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM):
                raise
        else:
            return context
    return multiprocessing.get_context("spawn")


@contextmanager
def _terminal_blocked() -> Iterator[None]:
    """Block what a terminal sends to all its processes, here and in processes started within."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _StoppedError(BaseException):
    """The worker must stop; handlers of Exception do not catch it."""


_is_busy = False
_is_stopping = False


def _set_up(lifeline: Connection, engine: str | None) -> None:
    if engine is not None:  # the server's environment may be older
        os.environ[VARIABLE] = engine
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if not Worker(partial(_watch, lifeline)).start():
        os._exit(_STOPPED)  # rather than outlive the command


def _watch(lifeline: Connection) -> NoReturn:
    wait([lifeline])
    with suppress(OSError):
        if hasattr(signal, "pthread_kill"):  # the main thread may wait in a system call
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            time.sleep(_SECONDS_TO_CLEAN_UP)
    os._exit(_STOPPED)


def _stop(*_: object) -> None:
    """End at once, or unwind the job in progress."""
    global _is_stopping
    if not _is_busy:
        os._exit(_STOPPED)
    if not _is_stopping:
        _is_stopping = True
        raise _StoppedError


def _stoppable(work: Work, job: Job) -> Outcome:
    global _is_busy
    try:
        _is_busy = True
        try:
            return work(job)
        finally:
            _is_busy = False
    except _StoppedError:
        # removes temporary files that the exception left behind, as multiprocessing itself does
        atexit._run_exitfuncs()  # noqa: SLF001
        os._exit(_STOPPED)


_TIMEOUT = 9.0  # for a connection, for the first worker to come, and for a lost connection
_SECONDS_TO_ANSWER = 1.0
"""Added to `_TIMEOUT`: dask itself waits without a limit for the reply to a message."""

_AT_ONCE = 1000
"""Jobs that the scheduler is given at the same time: enough for a cluster that grows."""

_ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://(?:\[[^/\s\[\]]+\]|[^/:\s\[\]]+):([0-9]{1,5})")
_UNENCRYPTED = ("tcp", "ws")
_TLS = (
    "export DASK_DISTRIBUTED__COMM__TLS__CA_FILE=ca.pem"
    " DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT=cert.pem"
    " DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY=key.pem"
)
_SET_UPS = {"tls": _TLS, "wss": _TLS, "ucx": "pip install distributed-ucxx-cu12"}
_VERSION = "mapdeal.version.__version__"


class ClusterWorkers:
    # The machines must share the folders of inputs and outputs under the same paths. When a worker
    # dies, the scheduler gives its jobs to others; a job fails only if several workers died of it.

    def __init__(self, client: Any, address: str, size: int | None = None) -> None:
        self.size = size or _AT_ONCE
        self._client = client
        self._address = address

    def memory_of_each(self) -> int | None:
        limits_by_worker = _answers(self._client, self._address, _memory_limit)
        limits = [limit for _, limit in limits_by_worker if limit]
        return min(limits) // 2 if limits else None

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:  # noqa: ARG002 - they are there
        """Yield a function that sends jobs; jobs not begun are dropped after the ``with`` block."""
        # the same job may be sent twice, in two batches: its result is never an old one
        executor = self._client.get_executor(pure=False)
        on_worker = _OnWorker(work, __version__)

        def submit(job: Job) -> Future[Outcome]:
            self._wait_for_scheduler(job)
            try:
                return _with_own_errors(executor.submit(on_worker, job), job)
            except Exception as error:  # noqa: BLE001 - dask raises plain ones if it has just lost it
                rule = f"was not started: {_first_line(error)}"
                raise WorkerDiedError(rule, source=job.path) from None

        try:
            yield submit
        finally:
            executor.shutdown(wait=False)

    def _wait_for_scheduler(self, job: Job) -> None:
        """Wait while the client tries to find a scheduler again that it has lost."""
        end = time.monotonic() + 2 * _TIMEOUT
        while self._client.status == "connecting" and time.monotonic() < end:
            time.sleep(0.1)
        if self._client.status != "running":
            rule = f"was not started: the scheduler {self._address} is gone"
            raise WorkerDiedError(rule, source=job.path)


@contextmanager
def connected(address: str, shared: Sequence[Path]) -> Iterator[Any]:
    match = _ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[2]) <= 65535:
        rule = "must be tcp://HOST:PORT with a port from 1 to 65535"
        hint = "dask scheduler listens on port 8786 by default: tcp://127.0.0.1:8786"
        raise ParameterError(rule, source="--scheduler", got=address, hint=hint)
    client = _client(address)
    try:
        _check_workers(client, address, shared)
        yield client
    finally:
        with suppress(Exception):  # it is gone, or goes by itself
            client.close(timeout=_TIMEOUT)


def shared_folders(job: Job) -> list[Path]:
    above = next(folder for folder in job.folder.parents if exists(folder))
    return [folder for folder in (job.path.parent, above) if exists(folder)]


def _client(address: str) -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        rule = "needs dask.distributed: pip install 'distributed>=2024.8'"
        raise ParameterError(rule, source="--scheduler") from None
    for name in list(logging.root.manager.loggerDict):  # errors repeat their messages
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    client_type: Any = distributed.Client
    connect = partial(client_type, timeout=_TIMEOUT, set_as_default=False, name="mapdeal")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # such as that versions of Python differ
            return _within_timeout(connect, address)
    except Exception as error:  # noqa: BLE001 - of any type where another program answers
        scheme = address.partition(":")[0]
        if isinstance(error, OSError | distributed.TimeoutError):  # not one of Python 3.10
            rule = f"the scheduler does not answer: {_first_line(error)}"
            raise FileAccessError(rule, source=address) from None
        if scheme in _UNENCRYPTED:
            rule = f"does not answer as a dask scheduler of this version: {_first_line(error)}"
            raise FileAccessError(rule, source=address) from None
        rule = f"{scheme} is not set up on this machine: {_first_line(error)}"
        raise ParameterError(rule, source="--scheduler", hint=_SET_UPS[scheme]) from None


def _within_timeout(request: Callable[..., _T], *arguments: Any, **options: Any) -> _T:
    """Return what a request to the cluster returns, or raise a TimeoutError."""
    seconds = _TIMEOUT + _SECONDS_TO_ANSWER
    thread = ThreadPool(1)
    reply = thread.submit(request, *arguments, **options)
    thread.shutdown(wait=False)
    if not wait_for([reply], timeout=seconds).done:
        raise TimeoutError(f"no reply within {seconds:g} s")
    return reply.result()


def _check_workers(client: Any, address: str, shared: Sequence[Path]) -> None:
    import pydoc  # slow to import

    try:
        _within_timeout(client.wait_for_workers, 1, timeout=_TIMEOUT)
    except Exception as error:  # noqa: BLE001 - its class depends on the version of Python
        rule = f"the scheduler has no workers: {_first_line(error)}"
        hint = f"dask worker {address} --nthreads 1 starts one"
        raise FileAccessError(rule, source=address, hint=hint) from None
    # Functions of the standard library, since a worker may lack ours.
    hint = f"install mapdeal {__version__} on the workers"
    for worker, found in _answers(client, address, pydoc.locate, _VERSION):
        if found is None:
            raise ParameterError("has no mapdeal", source=f"worker {worker}", hint=hint)
        if found != __version__:
            rule = f"has mapdeal {found}, here it is {__version__}"
            raise ParameterError(rule, source=f"worker {worker}", hint=hint)
    for path in shared:
        for worker, found in _answers(client, address, os.path.exists, str(path)):
            if not found:
                rule = f"does not exist for worker {worker}"
                hint = "workers must see inputs and outputs under the same paths"
                raise FileAccessError(rule, source=path, hint=hint)


def _answers(client: Any, address: str, function: Any, *arguments: str) -> list[tuple[str, Any]]:
    try:
        answers = _within_timeout(client.run, function, *arguments, on_error="ignore")
    except Exception as error:  # noqa: BLE001 - of the network, of pickles, of the event loop
        rule = f"the workers do not answer: {_first_line(error)}"
        raise FileAccessError(rule, source=address) from None
    return sorted(answers.items())


def _memory_limit(dask_worker: Any) -> int | None:
    return getattr(getattr(dask_worker, "memory_manager", None), "memory_limit", None)


def _with_own_errors(sent: Future[Outcome], job: Job) -> Future[Outcome]:
    from distributed import KilledWorker

    relayed: Future[Outcome] = Future()
    relayed.set_running_or_notify_cancel()

    def pass_on(finished: Future[Outcome]) -> None:
        try:
            relayed.set_result(finished.result())
        except CancelledError:
            rule = "was lost: the scheduler is gone or has dropped it"
            relayed.set_exception(WorkerDiedError(rule, source=job.path))
        except KilledWorker:
            rule = "every worker that tried this map died"
            relayed.set_exception(WorkerDiedError(rule, source=job.path, hint=TOO_LARGE))
        except Exception as error:  # noqa: BLE001 - the work itself raises none
            rule = f"was lost: {_first_line(error)}"
            relayed.set_exception(WorkerDiedError(rule, source=job.path))

    sent.add_done_callback(pass_on)
    return relayed


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class _OnWorker:
    work: Work
    version: str

    def __call__(self, job: Job) -> Outcome:
        if self.version != __version__:
            rule = f"a worker has mapdeal {__version__}, it was sent by {self.version}"
            return Outcome(MapdealError(rule, source=job.path))
        from distributed import get_worker

        # Python's warnings belong to the process, so a worker's threads take turns.
        with _one_at_a_time, use_threads(int(get_worker().state.nthreads)):
            return self.work(job)
