"""Workers for jobs: processes of this machine, or of a dask.distributed cluster."""

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
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import connection, resource_tracker, util
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from mapdeal.errors import FileAccessError, MapdealError, ParameterError
from mapdeal.files import source, transaction
from mapdeal.kernels import engine, threads
from mapdeal.pipeline.batch import TOO_LARGE, Job, Outcome, Submit, Work, WorkerDiedError
from mapdeal.version import __version__

_T = TypeVar("_T")
_SECONDS_TO_CLEAN_UP = 10.0
_POLL_INTERVAL = 0.1
_STOPPED = 128 + signal.SIGTERM

# bytes of the longest temporary folder in which the names of sockets still fit
_LONGEST_FOLDER = 107 - len("/pymp-12345678/listener-12345678")

# modules that every run needs: the server from which workers are forked imports them once
_PRELOADED = (
    "mapdeal.pipeline.worker_server",
    "mapdeal.pipeline.batch", "mapdeal.pipeline.workers", "mapdeal.pictures.layers",
    "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont", "PIL.PngImagePlugin", "tokenize",
)  # fmt: skip


class ProcessWorkers:
    # Each worker reads from a pipe whose writing end only this process has. A worker stops when
    # that end is closed, deliberately or because this process has died. An exception then unwinds
    # its job and removes temporary files.

    def __init__(self, size: int) -> None:
        self.size = size

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:
        with ExitStack() as stack:
            with _start_errors_converted():
                context = _context()
                lifeline, writing_end = multiprocessing.Pipe(duplex=False)
                stack.callback(lifeline.close)
                stack.callback(writing_end.close)
                executor = ProcessPoolExecutor(
                    size, context, initializer=_set_up,
                    initargs=(lifeline, os.environ.get(engine.VARIABLE)),
                )  # fmt: skip
                stack.callback(_shut_down, executor)

            is_lost = threading.Event()

            def note_loss(future: Future[Outcome]) -> None:
                if not future.cancelled() and isinstance(future.exception(), BrokenExecutor):
                    is_lost.set()

            def submit(job: Job) -> Future[Outcome]:
                try:
                    future = _submit(executor, _stoppable, work, job)
                except (OSError, EOFError, BrokenExecutor) as error:  # no process can start
                    is_lost.set()
                    raise BrokenExecutor(str(error)) from None
                future.add_done_callback(note_loss)
                return future

            try:
                with _start_errors_converted():
                    _wait_for_first(executor)
                yield submit
            except BaseException:
                writing_end.close()
                raise
            if is_lost.is_set():
                # A pool that has lost a process ends the others, except one that is just starting;
                # without this it would wait for that one forever.
                writing_end.close()


@contextmanager
def _start_errors_converted() -> Iterator[None]:
    try:
        yield
    except (OSError, EOFError, RuntimeError, ImportError, NotImplementedError) as error:
        # the pool or the server fails when the system refuses a resource
        why = getattr(error, "strerror", None) or "the system has no resources left"
        rule = f"cannot be started: {why}"
        hint = "--jobs 1 needs none; ulimit -a shows the limits"
        raise FileAccessError(rule, source="worker processes", hint=hint) from None


def _submit(executor: ProcessPoolExecutor, function: Callable[..., _T], *values: Any) -> Future[_T]:
    """Submit work to a pool, which may start a process; Ctrl-C must not interrupt that."""
    with transaction.signals_deferred(), _terminal_signals_blocked():
        return executor.submit(function, *values)


def _shut_down(executor: ProcessPoolExecutor) -> None:
    with suppress(RuntimeError):  # the pool's own thread could not be started
        executor.shutdown(cancel_futures=True)


def _wait_for_first(executor: ProcessPoolExecutor) -> None:
    """Wait until the first process and the pool's own threads have started."""
    failures: list[object] = []
    before, threading.excepthook = threading.excepthook, failures.append
    try:
        try:
            first = _submit(executor, int)
        except ConnectionRefusedError:  # the server of workers has just died; this starts another
            time.sleep(_POLL_INTERVAL)
            first = _submit(executor, int)
        while not first.done():  # without its threads the pool would never run it
            if failures:
                raise RuntimeError
            wait([first], timeout=_POLL_INTERVAL)
        first.result()
    finally:
        threading.excepthook = before


def _end_fork_server_and_tracker() -> None:
    server: Any = getattr(sys.modules.get("multiprocessing.forkserver"), "_forkserver", None)
    tracker: Any = resource_tracker._resource_tracker  # noqa: SLF001
    with suppress(ProcessLookupError, ChildProcessError):  # already ended
        if server is not None and server._forkserver_pid is not None:  # noqa: SLF001
            os.kill(server._forkserver_pid, signal.SIGKILL)  # noqa: SLF001 - it holds no state
            os.waitpid(server._forkserver_pid, 0)  # noqa: SLF001
        tracker._stop()  # noqa: SLF001


def _context() -> multiprocessing.context.BaseContext:
    # By themselves, helper processes notice late that this process has ended. With priority -101
    # they are ended last, after multiprocessing has removed the server's socket.
    util.Finalize(None, _end_fork_server_and_tracker, exitpriority=-101)
    # Workers are never forked from this process: a fork copies locks that its threads hold. If the
    # temporary folder cannot hold the server's socket, each worker is a new interpreter ("spawn").
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing import forkserver

        # A terminal sends Ctrl-C to all its processes, but only this one responds. Workers inherit
        # the blocked signal; otherwise a starting worker would print a traceback. The tracker
        # starts first because its start unblocks the signal; it ignores all signals except SIGHUP.
        with _terminal_signals_blocked():
            resource_tracker.ensure_running()
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_PRELOADED))
        try:
            if len(os.fsencode(transaction.folder_for_sockets())) > _LONGEST_FOLDER:
                raise OSError("AF_UNIX path too long")  # before multiprocessing creates a folder
            with _terminal_signals_blocked():
                forkserver.ensure_running()
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM):
                raise
        else:
            return context
    return multiprocessing.get_context("spawn")


@contextmanager
def _terminal_signals_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _StoppedError(BaseException):
    """Raised in a worker that must stop; handlers of Exception do not catch it."""


_is_busy = _is_stopping = False


def _set_up(lifeline: connection.Connection, chosen_engine: str | None) -> None:
    if chosen_engine is not None:  # the server may have an outdated environment
        os.environ[engine.VARIABLE] = chosen_engine
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if not threads.Worker(partial(_watch, lifeline)).start():
        os._exit(_STOPPED)  # unwatched, it could outlive the command


def _watch(lifeline: connection.Connection) -> NoReturn:
    connection.wait([lifeline])
    with suppress(OSError):
        if hasattr(signal, "pthread_kill"):  # the main thread may wait in a system call
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            time.sleep(_SECONDS_TO_CLEAN_UP)
    os._exit(_STOPPED)


def _stop(*_: object) -> None:
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
        # removes remaining temporary files, as multiprocessing does
        atexit._run_exitfuncs()  # noqa: SLF001
        os._exit(_STOPPED)


_TIMEOUT = 9.0  # seconds to connect, to reconnect, and for the first worker
_SECONDS_TO_ANSWER = 1.0  # added to `_TIMEOUT`, because dask waits for replies without a limit
_MOST_SUBMITTED = 1000  # jobs at the scheduler at the same time: enough for a growing cluster
_ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://(?:\[[^/\s\[\]]+\]|[^/:\s\[\]]+):([0-9]{1,5})")
_TLS = (
    "export DASK_DISTRIBUTED__COMM__TLS__CA_FILE=ca.pem"
    " DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT=cert.pem"
    " DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY=key.pem"
)
_SET_UPS = {"tls": _TLS, "wss": _TLS, "ucx": "pip install distributed-ucxx-cu12"}


class ClusterWorkers:
    # All machines must see inputs and outputs under the same paths. When a worker dies, the
    # scheduler repeats its jobs elsewhere; a job fails only if several workers died with it.

    def __init__(self, client: Any, address: str, size: int | None = None) -> None:
        self.size = size or _MOST_SUBMITTED
        self._client, self._address = client, address

    def memory_of_each(self) -> int | None:
        answers = _answers(self._client, self._address, _memory_limit)
        return min((limit // 2 for _, limit in answers if limit), default=None)

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:  # noqa: ARG002 - they run already
        """Yield a function that submits jobs; waiting jobs are dropped after the ``with`` block."""
        # pure=False: a job of a later batch must not reuse the result of an equal one
        executor = self._client.get_executor(pure=False)
        on_worker = partial(_work_on_cluster, work, __version__)

        def submit(job: Job) -> Future[Outcome]:
            self._wait_for_scheduler(job)
            try:
                return _with_own_errors(executor.submit(on_worker, job), job)
            except Exception as error:  # noqa: BLE001 - if the connection was just lost
                rule = f"was not started: {_first_line(error)}"
                raise WorkerDiedError(rule, source=job.path) from None

        try:
            yield submit
        finally:
            executor.shutdown(wait=False)

    def _wait_for_scheduler(self, job: Job) -> None:
        end = time.monotonic() + 2 * _TIMEOUT
        while self._client.status == "connecting" and time.monotonic() < end:
            time.sleep(_POLL_INTERVAL)
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
        with suppress(Exception):  # the connection is already closed
            client.close(timeout=_TIMEOUT)


def shared_folders(job: Job) -> list[Path]:
    existing = next(folder for folder in job.folder.parents if source.exists(folder))
    return [folder for folder in (job.path.parent, existing) if source.exists(folder)]


def _client(address: str) -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        rule = "needs dask.distributed: pip install 'distributed>=2024.8'"
        raise ParameterError(rule, source="--scheduler") from None
    for name in list(logging.root.manager.loggerDict):  # mapdeal's errors repeat these messages
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    client_type: Any = distributed.Client
    client = client_type.__new__(client_type)
    connect = partial(client.__init__, timeout=_TIMEOUT, set_as_default=False, name="mapdeal")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # such as different Python versions
            _within_timeout(connect, address)
        return client
    except Exception as error:  # noqa: BLE001 - any type if another program answers
        # A client without a connection that only the garbage collector closes blocks its own
        # event loop until a timeout, and with it the next client.
        with suppress(Exception):
            client.close(timeout=_TIMEOUT)
        scheme, why = address.partition(":")[0], _first_line(error)
        is_silent = isinstance(error, OSError | distributed.TimeoutError)  # two in Python 3.10
        if is_silent or scheme not in _SET_UPS:
            rule = "the scheduler does not answer"
            rule = rule if is_silent else "does not answer as a dask scheduler of this version"
            raise FileAccessError(f"{rule}: {why}", source=address) from None
        rule = f"{scheme} is not set up on this machine: {why}"
        raise ParameterError(rule, source="--scheduler", hint=_SET_UPS[scheme]) from None


def _within_timeout(request: Callable[..., _T], *arguments: Any, **options: Any) -> _T:
    seconds = _TIMEOUT + _SECONDS_TO_ANSWER
    thread = threads.ThreadPool(1)
    reply = thread.submit(request, *arguments, **options)
    thread.shutdown(wait=False)
    if not wait([reply], timeout=seconds).done:
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
    # Only functions of the standard library: mapdeal may be missing on a worker.
    hint = f"install mapdeal {__version__} on the workers"
    for worker, found in _answers(client, address, pydoc.locate, "mapdeal.version.__version__"):
        if found != __version__:
            rule = f"has mapdeal {found}, here it is {__version__}" if found else "has no mapdeal"
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
    except Exception as error:  # noqa: BLE001 - of the network, pickle or the event loop
        rule = f"the workers do not answer: {_first_line(error)}"
        raise FileAccessError(rule, source=address) from None
    return sorted(answers.items())


def _memory_limit(dask_worker: Any) -> int | None:
    return getattr(getattr(dask_worker, "memory_manager", None), "memory_limit", None)


def _with_own_errors(submitted: Future[Outcome], job: Job) -> Future[Outcome]:
    from distributed import KilledWorker

    relayed: Future[Outcome] = Future()
    relayed.set_running_or_notify_cancel()
    died = partial(WorkerDiedError, source=job.path)

    def pass_on(finished: Future[Outcome]) -> None:
        try:
            relayed.set_result(finished.result())
        except CancelledError:
            relayed.set_exception(died("was lost: the scheduler is gone or has dropped it"))
        except KilledWorker:
            relayed.set_exception(died("every worker that tried this map died", hint=TOO_LARGE))
        except Exception as error:  # noqa: BLE001 - not of the work, which raises none
            relayed.set_exception(died(f"was lost: {_first_line(error)}"))

    submitted.add_done_callback(pass_on)
    return relayed


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


_warnings_lock = threading.Lock()


def _work_on_cluster(work: Work, version: str, job: Job) -> Outcome:
    if version != __version__:
        rule = f"a worker has mapdeal {__version__}, it was sent by {version}"
        return Outcome(MapdealError(rule, source=job.path))
    from distributed import get_worker

    # The threads of a worker take turns, because Python's warnings belong to the process.
    with _warnings_lock, threads.use_threads(int(get_worker().state.nthreads)):
        return work(job)
