"""Many maps: their jobs, one after the other or at the same time, and the summary."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from mapdeal.errors import (
    BatchError,
    FileAccessError,
    MapdealError,
    ParameterError,
    kept_warnings,
    one_line,
    refusal_of_the_system,
    refuse_warnings,
    strict_warnings,
)
from mapdeal.files.json_values import json_of
from mapdeal.files.source import exists, ignores_case, is_same_file, sums_of_reads
from mapdeal.files.transaction import Transaction, make_folder
from mapdeal.inputs.listing import ListedMap
from mapdeal.kernels.threads import available_threads
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.inputs import Need, memory_budget, need_of
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import RunReport, output_folder, run_map
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings

if TYPE_CHECKING:
    from mapdeal.pipeline.local import Around

SUMMARY = "summary.json"


@dataclass(frozen=True)
class Job:
    """One input of a batch, and where what is made of it goes."""

    path: Path
    folder: Path
    name: str
    place: str
    is_new: bool = False


@dataclass(frozen=True)
class Outcome:
    """Outcome of a job."""

    result: Any
    warnings: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """One of ``done``, ``unchanged``, ``failed``, ``interrupted``."""
        if self.result is None:
            return "interrupted"
        if isinstance(self.result, MapdealError):
            return "failed"
        local = getattr(self.result, "local", None)
        return "done" if local is not None and local.status == "done" else str(self.result.status)


@dataclass(frozen=True)
class MapRun:
    """A run with all its options, as it is sent to workers: called with a job it does it."""

    recipe: Recipe
    settings: Settings = DEFAULT_SETTINGS
    around: Around | None = None

    def sharing(self, jobs: int) -> MapRun:
        """Return it with a job's part of processors and memory, where there is no other rule."""
        if jobs == 1:
            return self
        threads = self.settings.threads or max(1, available_threads() // jobs)
        return replace(self, settings=replace(self.settings, threads=threads)).within(
            memory_budget(self.settings.max_memory, jobs)
        )

    def within(self, memory: int | None) -> MapRun:
        """Return it with the memory that a job may take, unless somebody chose that."""
        if memory is None or self.settings.max_memory is not None:
            return self
        settings = replace(self.settings, max_memory=memory, memory_is_chosen=False)
        return replace(self, settings=settings)

    def __call__(self, job: Job) -> RunReport:
        settings = replace(self.settings, force=self.settings.force or job.is_new)
        with settings.memory(anew=True), strict_warnings(settings.strict, job.path):
            return run_map(job.path, job.folder, self.recipe, settings, self.around)


def attempt(run_one: Callable[[Any], Any], job: Job) -> Outcome:
    """Do a job; whatever it raises or warns of is part of the outcome."""
    with _recorded_warnings() as texts:
        try:
            result = run_one(job)
        except MapdealError as error:
            result = error
        except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
            result = refusal_of_the_system(problem, job.path) or internal_error(job, problem)
    return Outcome(result, tuple(texts))


def internal_error(job: Job, problem: BaseException) -> MapdealError:
    text = f"internal error: {type(problem).__name__}: {problem}"
    return MapdealError(text, source=job.path, hint="this is a bug in mapdeal")


@contextmanager
def _recorded_warnings() -> Iterator[list[str]]:
    """Fill a list with the texts of mapdeal's warnings in the block, when it ends."""
    texts: list[str] = []
    with kept_warnings() as kept:
        try:
            yield texts
        finally:
            texts += [one_line(str(one)) for one in kept]


def jobs_of(maps: Sequence[ListedMap], output: Path, outputs: Collection[str]) -> list[Job]:
    jobs: dict[Path, Job] = {}
    for one in maps:
        place = one.place
        odd = [part for part in place.parts if part in ("", ".", "..")]
        if odd or not place.name:
            rule = "the map's name cannot be the name of a folder"
            raise ParameterError(rule, source=one.path, got=odd[0] if odd else place.name)
        if len(maps) > 1 and place.parts[0] == SUMMARY:
            raise ParameterError(f"would write into the place of {SUMMARY}", source=one.path)
        if place in jobs:
            rule = f"would write into {output / place}, as {jobs[place].path} does"
            hint = (
                "maps of a folder, a quoted pattern or @LIST.txt keep their path below the output"
            )
            raise ParameterError(rule, source=one.path, hint=hint)
        jobs[place] = Job(one.path, output / place, one.name, place.as_posix())
    for place, job in jobs.items():
        # the folder of one run may lie in that of another, but not in the place of its files
        for above in place.parents:
            if above in jobs and place.relative_to(above).parts[0] in outputs:
                rule = f"would write into the place of a file of {jobs[above].path}"
                raise ParameterError(rule, source=job.path)
    _check_case(jobs, output)
    return list(jobs.values())


def _check_case(jobs: dict[Path, Job], output: Path) -> None:
    """Refuse folders that are one to a disk that ignores case."""
    alike: dict[str, Job] = {}
    for place, job in jobs.items():
        other = alike.setdefault(place.as_posix().casefold(), job)
        if other is not job and ignores_case(output):
            rule = f"would write into {job.folder}, as {other.path} does: the disk ignores case"
            raise ParameterError(rule, source=job.path)


@dataclass(frozen=True)
class Plan:
    """What a run would do with a map."""

    job: Job
    what: Literal["new", "replace", "unchanged", "refused", "failed"]
    height: int = 0
    width: int = 0
    need: Need | None = None
    reads: tuple[Path, ...] = ()
    writes: tuple[Path, ...] = ()
    error: MapdealError | None = None


def plan_of(job: Job, run: MapRun) -> Plan:
    """Return what a run would do with a map, from headers, checksums and the manifest."""
    settings, steps = run.settings, run.recipe.steps
    size = (0, 0)
    try:
        with (
            kept_warnings(),  # the run itself warns
            sums_of_reads() as sums,
            open_map(job.path, dialect=settings.dialect, max_cells=settings.max_cells) as file,
        ):
            size, files = file.shape(), file.files
            named = {} if settings.force else file.sums_by_name(sums)
            cells = 0.0
            if run.around is not None:  # metres, as a YAML says it; an npz must be read
                cells = (file.metadata or file.read().grid).resolution
            need = need_of(file, size, steps, settings, image_max=settings.picture_size)
        folders = [output_folder(job.folder, named, run.recipe, settings)]
        if run.around is not None:
            folders.append(run.around.folder(job.folder, named, cells, settings))
            files = (*files, *run.around.files)
        for target in folders:
            target.check_inputs(files)
        new = [one for one in folders if settings.force or one.unchanged_figures() is None]
    except MapdealError as error:
        return Plan(job, "failed", *size, error=error)
    if not new:
        return Plan(job, "unchanged", *size, reads=files)
    existing = [path for target in new for path in target.existing()]
    outputs = tuple(path for target in new for path in target.outputs())
    refusal = _refusal(existing, files, force=settings.force)
    if refusal is not None:
        return Plan(job, "refused", *size, reads=files, error=refusal)
    what: Literal["new", "replace"] = "replace" if existing else "new"
    return Plan(job, what, *size, need, files, outputs)


def _refusal(
    existing: list[Path], files: tuple[Path, ...], *, force: bool
) -> MapdealError | None:  # fmt: skip
    """Return why the outputs that are there cannot be replaced, if they cannot."""
    for path in existing:
        if any(is_same_file(path, file) for file in files):
            return FileAccessError("the output is the input", source=path)
    if existing and not force:
        return FileAccessError("the output exists", source=existing[0], hint="--force replaces it")
    return None


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
        """Run `size` workers within a ``with`` block; yield a function that sends them a job."""
        # An exception that leaves the block stops what they do. A future raises `BrokenExecutor` if
        # it is not known which worker died, and of what.


def dispatch(
    count: int, job_of: Callable[[int], Job], work: Work, workers: Workers,
    done: Callable[[int, Outcome], None],
) -> None:  # fmt: skip
    """Distribute jobs among workers."""
    # When a process dies, its pool is lost, and any of the jobs that were under way may be why.
    # Each of them is tried again, alone. If that kills its process, too, it has failed; all others
    # go on.
    waiting = deque(range(count))
    while waiting:
        for suspect in _until_broken(waiting, workers.size, job_of, work, workers, done):
            if _until_broken(deque([suspect]), 1, job_of, work, workers, done):
                done(suspect, Outcome(died(job_of(suspect))))


def died(job: Job) -> WorkerDiedError:
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
    try:
        return future.result()
    except BrokenExecutor:
        return None
    except MapdealError as error:
        return Outcome(error)
    except Exception as problem:  # noqa: BLE001 - such as a result that cannot be sent
        return Outcome(internal_error(job, problem))


def run_all(
    jobs: Sequence[Job],
    output: Path,
    run_one: Callable[[Job], RunReport],
    on_done: Callable[[Job, Outcome], None],
    *,
    workers: Workers | None = None,
    what: str = "map",
) -> list[Outcome]:
    """Run every job, none stopped by another's failure, and write ``summary.json``."""
    marked: dict[int, Job] = {}
    outcomes: dict[int, Outcome] = {}

    def job_of(index: int) -> Job:
        """Return the job, as it was when its turn came first."""
        if index not in marked:
            job = jobs[index]
            marked[index] = replace(job, is_new=not exists(job.folder))
        return marked[index]

    def done(index: int, outcome: Outcome) -> None:
        outcomes[index] = outcome
        on_done(jobs[index], outcome)

    refuse_warnings()
    make_folder(output)
    try:
        if workers is None:
            for index in range(len(jobs)):
                done(index, attempt(run_one, job_of(index)))
        else:
            dispatch(len(jobs), job_of, partial(attempt, run_one), workers, done)
    except KeyboardInterrupt:
        _write_summary(jobs, outcomes, output, what)
        told = f"{len(outcomes)} of {len(jobs)} {what}s are done, run the same command to continue"
        raise KeyboardInterrupt(told) from None
    except MapdealError:
        if outcomes:
            _write_summary(jobs, outcomes, output, what)
        raise
    _write_summary(jobs, outcomes, output, what)
    return [outcomes[index] for index in range(len(jobs))]


def _write_summary(
    jobs: Sequence[Job], outcomes: dict[int, Outcome], output: Path, what: str
) -> None:
    entries = [
        _entry(job, outcomes.get(index, Outcome(None)), what) for index, job in enumerate(jobs)
    ]
    summary = output / SUMMARY
    with Transaction([summary], force=True) as transaction:
        transaction.write_bytes(summary, json_of({"maps": entries}))


def _entry(job: Job, outcome: Outcome, what: str) -> dict[str, Any]:
    result = outcome.result
    entry: dict[str, Any] = {what: job.name, "folder": job.place, "status": outcome.status}
    if isinstance(result, MapdealError):
        entry |= {"exit_code": result.exit_code, "error": text_of(str(result), job)}
    elif result is not None:
        entry["figures"] = result.figures
        if getattr(result, "local", None) is not None:
            entry["local"] = result.local.figures
    texts = [text_of(text, job) for text in outcome.warnings]
    return {**entry, "warnings": texts} if texts else entry


def text_of(text: str, job: Job) -> str:
    """Return a message with files named as the summary names them, wherever one stands."""
    for path, name in ((job.folder, job.place), (job.path.parent, Path(job.name).parent)):
        if str(path) not in (".", path.anchor):
            shown = "" if str(name) == "." else f"{name}/"
            parts = re.split(rf"(?<![\w./-]){re.escape(f'{path}/')}", text)
            text = shown.join(parts)
    return text
