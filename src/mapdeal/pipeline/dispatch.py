"""Jobs sent to workers, few at a time, so that it is known which ones a dead worker had."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager
from typing import Protocol

from mapdeal.errors import BatchError, MapdealError
from mapdeal.pipeline.jobs import Job, Outcome, internal_error

Work = Callable[[Job], Outcome]
Submit = Callable[[Job], Future[Outcome]]


class WorkerDiedError(MapdealError):
    """A job was lost with the workers that had it."""

    exit_code = BatchError.exit_code


class Workers(Protocol):
    """Where jobs are done: processes of this machine, or a cluster."""

    size: int
    """Jobs that are done at the same time."""

    def started(self, size: int, work: Work) -> AbstractContextManager[Submit]:
        """Run `size` workers within a ``with`` block; yield a function that sends them a job.

        An exception that leaves the block stops what they do. A future raises `BrokenExecutor`
        if it is not known which worker died, and of what.
        """


def dispatch(
    count: int, job_of: Callable[[int], Job], work: Work, workers: Workers,
    done: Callable[[int, Outcome], None],
) -> None:  # fmt: skip
    """Distribute jobs among workers.

    Notes
    -----
    When a process dies, its pool is lost, and any of the jobs that were under way may be why.
    Each of them is tried again, alone. If that kills its process, too, it has failed; all
    others go on.
    """
    waiting = deque(range(count))
    while waiting:
        for suspect in _until_broken(waiting, workers.size, job_of, work, workers, done):
            if _until_broken(deque([suspect]), 1, job_of, work, workers, done):
                done(suspect, Outcome(died(job_of(suspect))))


def died(job: Job) -> WorkerDiedError:
    """Return the failure of a job whose workers die."""
    rule = "the worker process died, and again with this map alone"
    hint = "it may have run out of memory: mapdeal run --dry-run shows what a map needs"
    return WorkerDiedError(rule, source=job.path, hint=hint)


def _until_broken(
    waiting: deque[int], size: int, job_of: Callable[[int], Job], work: Work, workers: Workers,
    done: Callable[[int, Outcome], None],
) -> list[int]:  # fmt: skip
    """Do jobs until none waits or the pool is lost; return those that were under way then."""
    under_way: dict[Future[Outcome], int] = {}
    suspects: list[int] = []
    try:
        with workers.started(min(size, len(waiting)), work) as submit:
            while under_way or (waiting and not suspects):
                while waiting and not suspects and len(under_way) < size:
                    index = waiting.popleft()
                    try:
                        under_way[submit(job_of(index))] = index
                    except BrokenExecutor:
                        suspects.append(index)
                    except MapdealError as error:
                        done(index, Outcome(error))
                finished, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in sorted(finished, key=under_way.__getitem__):
                    index = under_way[future]
                    outcome = _outcome_of(future, job_of(index))
                    if outcome is None:
                        suspects.append(index)
                    else:
                        done(index, outcome)
                    del under_way[future]
    except KeyboardInterrupt:  # what was finished all the same is told
        for future, index in under_way.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                done(index, future.result())
        raise
    return sorted(suspects)


def _outcome_of(future: Future[Outcome], job: Job) -> Outcome | None:
    """Return what became of a job, None if its pool was lost."""
    try:
        return future.result()
    except BrokenExecutor:
        return None
    except MapdealError as error:
        return Outcome(error)
    except Exception as problem:  # noqa: BLE001 - such as a result that cannot be sent
        return Outcome(internal_error(job, problem))
