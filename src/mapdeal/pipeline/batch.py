"""Many maps: their jobs, one after the other or at the same time, and the summary."""

from __future__ import annotations

import re
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, TypeVar

from mapdeal import command, compatibility, errors, records
from mapdeal.files.source import exists, ignores_case, is_same_file, size_text, sums_of_reads
from mapdeal.files.transaction import Transaction, make_folder
from mapdeal.grid.values import count_text, table_lines
from mapdeal.kernels.threads import available_threads
from mapdeal.maps.listing import ListedMap
from mapdeal.pipeline.inputs import MemoryPlan, Terminal, memory_budget, need_of, opened_input
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import LocalOfRun, RunReport, cells_text, output_folder, run_map
from mapdeal.pipeline.settings import Settings

SUMMARY = "summary.json"
_MOST_PER_PROCESSOR, _LEAST_CAP = 4, 8
_LONGEST_REASON = 100


@records.dataclass(frozen=True)
class Job:
    path: Path
    folder: Path
    name: str
    place: str
    is_new: bool = False
    error: errors.MapdealError | None = None  # why there is no map to run


@records.dataclass(frozen=True)
class Outcome:
    result: Any
    warnings: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        if self.result is None:
            return "interrupted"
        if isinstance(self.result, errors.MapdealError):
            return "failed"
        local = getattr(self.result, "local", None)
        return "done" if local is not None and local.status == "done" else str(self.result.status)

    def document(self, job: Job) -> dict[str, Any]:
        document: dict[str, Any] = {"status": self.status}
        if isinstance(self.result, errors.MapdealError):
            error = text_of(str(self.result), job)
            document |= {"exit_code": self.result.exit_code, "error": error}
        elif self.result is not None:
            document |= self.result.document()
        texts = [text_of(text, job) for text in self.warnings]
        return {**document, "warnings": texts} if texts else document


@records.dataclass(frozen=True)
class BatchWork:
    """Work on each map of a batch with its settings, sent to workers and called with a job."""

    settings: Settings

    def sharing(self, jobs: int) -> compatibility.Self:
        """Return a copy limited to a job's share of threads and memory, unless these were set."""
        if jobs == 1:
            return self
        threads = self.settings.threads or max(1, available_threads() // jobs)
        shared = records.replace(self, settings=records.replace(self.settings, threads=threads))
        return shared.within(memory_budget(self.settings.max_memory, jobs))

    def within(self, memory: int | None) -> compatibility.Self:
        if memory is None or self.settings.max_memory is not None:
            return self
        settings = records.replace(self.settings, max_memory=memory, memory_is_chosen=False)
        return records.replace(self, settings=settings)


@records.dataclass(frozen=True)
class MapRun(BatchWork):
    recipe: Recipe
    around: LocalOfRun | None = None

    def __call__(self, job: Job) -> RunReport:
        if job.error is not None:
            raise job.error
        settings = records.replace(self.settings, force=self.settings.force or job.is_new)
        with settings.reading(anew=True), errors.strict_warnings(settings.strict, job.path):
            return run_map(job.path, job.folder, self.recipe, settings, self.around)


def jobs_at_once(requested: int | None, maps: int, terminal: Terminal) -> int:
    processors = available_threads()
    most = max(_LEAST_CAP, _MOST_PER_PROCESSOR * processors)
    if requested is not None and requested > most:
        note = f"note: --jobs {requested}: using {most}, as there are {processors} cores"
        terminal.remark([note])
    return min(requested or processors, maps, most)


def attempt(run_job: Callable[[Any], Any], job: Job) -> Outcome:
    with errors.capture_warnings() as warnings:
        try:
            result = run_job(job)
        except errors.MapdealError as error:
            result = error
        except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
            result = errors.refusal_of_the_system(problem, job.path) or internal_error(job, problem)
    return Outcome(result, tuple(errors.one_line(str(warning)) for warning in warnings))


def internal_error(job: Job, problem: BaseException) -> errors.MapdealError:
    text = f"internal error: {type(problem).__name__}: {problem}"
    return errors.MapdealError(text, source=job.path, hint="this is a bug in mapdeal")


def jobs_of(maps: Sequence[ListedMap], output: Path, outputs: Collection[str]) -> list[Job]:
    jobs: dict[Path, Job] = {}
    in_order: list[Job] = []
    for listed in maps:
        name = listed.name
        if listed.error is not None:
            in_order.append(Job(listed.path, output / name, name, name, error=listed.error))
            continue
        place = listed.place
        odd = [part for part in place.parts if part in ("", ".", "..")]
        if odd or not place.name:
            rule = "the map's name cannot be the name of a folder"
            raise errors.ParameterError(rule, source=listed.path, got=odd[0] if odd else place.name)
        if len(maps) > 1 and place.parts[0] == SUMMARY:
            rule = f"would write into the place of {SUMMARY}"
            raise errors.ParameterError(rule, source=listed.path)
        if place in jobs:
            rule = f"would write into {output / place}, as {jobs[place].path} does"
            sources = "maps of a folder, a quoted pattern or @LIST.txt"
            hint = f"{sources} keep their path below the output"
            raise errors.ParameterError(rule, source=listed.path, hint=hint)
        jobs[place] = Job(listed.path, output / place, name, place.as_posix())
        in_order.append(jobs[place])
    for place, job in jobs.items():
        # the folder of one run may lie in that of another, but not in the place of its files
        for above in place.parents:
            if above in jobs and place.relative_to(above).parts[0] in outputs:
                rule = f"would write into the place of a file of {jobs[above].path}"
                raise errors.ParameterError(rule, source=job.path)
    by_folded_name: dict[str, Job] = {}
    for place, job in jobs.items():
        first_job = by_folded_name.setdefault(place.as_posix().casefold(), job)
        if first_job is not job and ignores_case(output):
            rule = f"would write into {job.folder}, as {first_job.path} does: the disk ignores case"
            raise errors.ParameterError(rule, source=job.path)
    return in_order


@records.dataclass(frozen=True)
class Plan:
    job: Job
    status: Literal["new", "replace", "unchanged", "refused", "failed"]
    height: int = 0
    width: int = 0
    need: MemoryPlan | None = None
    reads: tuple[Path, ...] = ()
    writes: tuple[Path, ...] = ()
    error: errors.MapdealError | None = None

    @property
    def row(self) -> tuple[str, ...]:
        size = f"{self.width} x {self.height}"
        if self.error is not None:
            status = f"{self.status} ({self.error.exit_code})"
            return status, "-", size if self.height else "-", "-", _failure(self.error, self.job)
        memory = "-"
        if self.need is not None:
            memory = size_text(self.need.needed) + " in blocks" * (self.need.blocks is not None)
        where = f"{self.job.name} -> {self.job.folder}"
        return self.status, str(len(self.writes) or "-"), size, memory, where

    def document(self) -> dict[str, Any]:
        document: dict[str, Any] = {"map": self.job.name, "folder": self.job.place}
        document |= {"status": self.status, "width": self.width, "height": self.height}
        if self.need is not None:
            document["memory"] = self.need.needed
            document["in_blocks"] = self.need.blocks is not None
        document |= {"reads": list(map(str, self.reads)), "writes": list(map(str, self.writes))}
        if self.error is None:
            return document
        return document | {"exit_code": self.error.exit_code, "error": str(self.error)}


def plan_of(job: Job, run: MapRun) -> Plan:
    settings, size = run.settings, (0, 0)
    if job.error is not None:
        return Plan(job, "failed", *size, error=job.error)
    try:  # without warnings, which the run itself gives
        opened = opened_input(job.path, settings)
        with errors.capture_warnings(), sums_of_reads() as sums, opened as file:
            size, files = file.shape(), file.files
            named = {} if settings.force else file.sums_by_name(sums)
            need = need_of(file, size, run.recipe.steps, settings)
            folders = [output_folder(job.folder, named, run.recipe, settings)]
            if run.around is not None:
                cell_size = file.frame().resolution
                folders.append(run.around.folder(job.folder, named, cell_size, settings))
                files = (*files, *run.around.files)
        for target in folders:
            target.check_inputs(files)
        new = [folder for folder in folders if settings.force or folder.unchanged_figures() is None]
    except errors.MapdealError as error:
        return Plan(job, "failed", *size, error=error)
    if not new:
        return Plan(job, "unchanged", *size, reads=files)
    existing = [path for target in new for path in target.existing()]
    outputs = tuple(path for target in new for path in target.outputs())
    inputs = [path for path in existing if any(is_same_file(path, file) for file in files)]
    refused = partial(Plan, job, "refused", *size, reads=files)
    if inputs:
        return refused(error=errors.FileAccessError("the output is the input", source=inputs[0]))
    if existing and not settings.force:
        rule, hint = "the output exists", "--force replaces it"
        return refused(error=errors.FileAccessError(rule, source=existing[0], hint=hint))
    return Plan(job, "replace" if existing else "new", *size, need, files, outputs)


@records.dataclass(frozen=True, repr=False)
class Plans(command.Result):
    plans: Sequence[Plan]
    at_once: int | None  # number of jobs, None on a cluster
    also_written: Sequence[Path]

    def document(self) -> dict[str, Any]:
        return {
            "dry_run": True,
            "maps": [plan.document() for plan in self.plans],
            "also_writes": list(map(str, self.also_written)),
        }

    def lines(self) -> Iterator[str]:
        ordered = sorted(self.plans, key=lambda plan: plan.error is not None)
        head = ("what", "files", "cells", "memory", "map -> folder")
        yield from table_lines([head, *(plan.row for plan in ordered)])
        counts = Counter(plan.status for plan in self.plans)
        running, failing = counts["new"] + counts["replace"], counts["refused"] + counts["failed"]
        also = f", and {' and '.join(map(str, self.also_written))}" if self.also_written else ""
        text = f"{count_text(len(self.plans), 'map')}: {running} to run, {counts['unchanged']} "
        text += f"unchanged, {failing} that would fail; "
        yield f"{text}{sum(len(plan.writes) for plan in self.plans)} files to write{also}"
        needed = sorted((plan.need.needed for plan in self.plans if plan.need), reverse=True)
        if needed:
            at_once = min(self.at_once or 1, len(needed))
            text = f"memory: about {size_text(needed[0])} for the map that needs most"
            if at_once > 1:
                text += f", {size_text(sum(needed[:at_once]))} at most with {at_once} jobs"
            yield text if self.at_once else f"{text}, on a worker"
        yield "nothing was written: this was --dry-run"

    def details(self) -> Iterator[str]:
        for plan in self.plans:
            yield from (f"{plan.job.name}: read {path}" for path in plan.reads)
            yield from (f"{plan.job.name}: write {path}" for path in plan.writes)

    def check(self) -> None:
        if failing := sum(plan.error is not None for plan in self.plans):
            rule = f"{failing} of {count_text(len(self.plans), 'map')} would fail"
            raise errors.BatchError(rule, source="--dry-run")


Work = Callable[[Job], Outcome]
Submit = Callable[[Job], Future[Outcome]]
TOO_LARGE = "it may have run out of memory: mapdeal run --dry-run shows what a map needs"


class WorkerDiedError(errors.MapdealError):
    exit_code = errors.BatchError.exit_code


class Workers(Protocol):
    size: int  # jobs that are done at the same time

    def started(self, size: int, work: Work) -> AbstractContextManager[Submit]:
        """Run `size` workers within a ``with`` block; yield a function that sends them a job."""
        # An exception that leaves the block stops them. A future raises `BrokenExecutor` if it is
        # unknown which worker died, and why.


def dispatch(
    count: int, job_of: Callable[[int], Job], work: Work, workers: Workers,
    on_outcome: Callable[[int, Outcome], None],
) -> None:  # fmt: skip
    # When a process dies, its pool is lost, and any of the jobs that were under way may be why.
    # Each of them is tried again, alone; it has failed if that kills its process, too.
    def until_broken(waiting: deque[int], size: int) -> list[int]:
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
                        except errors.MapdealError as error:
                            on_outcome(index, Outcome(error))
                    finished, _ = wait(under_way, return_when=FIRST_COMPLETED)
                    for future in sorted(finished, key=under_way.__getitem__):
                        index = under_way[future]
                        if (outcome := _outcome_of(future, job_of(index))) is None:
                            suspects.append(index)
                        else:
                            on_outcome(index, outcome)
                        del under_way[future]
        except KeyboardInterrupt:  # report the jobs that have finished
            for future, index in under_way.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    on_outcome(index, future.result())
            raise
        return sorted(suspects)

    waiting = deque(range(count))
    while waiting:
        for suspect in until_broken(waiting, workers.size):
            if until_broken(deque([suspect]), 1):
                rule = "the worker process died, and again with this map alone"
                error = WorkerDiedError(rule, source=job_of(suspect).path, hint=TOO_LARGE)
                on_outcome(suspect, Outcome(error))


def _outcome_of(future: Future[Outcome], job: Job) -> Outcome | None:
    try:
        return future.result()
    except BrokenExecutor:
        return None
    except errors.MapdealError as error:
        return Outcome(error)
    except Exception as problem:  # noqa: BLE001 - such as a result that cannot be sent
        return Outcome(internal_error(job, problem))


@records.dataclass(frozen=True, eq=False, repr=False)
class Batch(command.Result):
    noun: ClassVar[str] = "map"
    is_brief: ClassVar[bool] = False  # only the first line of a job is printed, warnings unchanged
    resuming: ClassVar[str] = "run the same command to continue"

    output: Path
    jobs: Sequence[Job]
    outcomes: Sequence[Outcome]
    seconds: float

    def document(self) -> dict[str, Any]:
        maps = [
            {self.noun: job.name, "folder": job.place, **outcome.document(job)}
            for job, outcome in zip(self.jobs, self.outcomes, strict=True)
        ]
        return {"maps": maps}

    def count(self, status: str) -> int:
        return sum(outcome.status == status for outcome in self.outcomes)

    def done_paths(self) -> list[Path]:
        outcomes = zip(self.jobs, self.outcomes, strict=True)
        return [job.path for job, outcome in outcomes if outcome.status in ("done", "unchanged")]

    def lines(self) -> Iterator[str]:
        rows, failed = [("status", "cells", "map")], []
        for job, result in zip(self.jobs, (found.result for found in self.outcomes), strict=True):
            if isinstance(result, errors.MapdealError):
                failed.append((f"failed ({result.exit_code})", "-", job.name))  # its error is above
            elif result is not None:
                size = cells_text(next(iter(result.figures.values())))
                rows.append((result.status, size, job.name))
        yield from table_lines([*rows, *failed])
        counts = [f"{self.count(status)} {status}" for status in ("done", "unchanged", "failed")]
        yield f"{count_text(len(self.jobs), self.noun)}: {', '.join(counts)}"

    def check(self) -> None:
        if failed := self.count("failed"):
            rule = f"{failed} of {len(self.jobs)} {self.noun}s failed"
            raise errors.BatchError(rule, source=self.output / SUMMARY)
        missing = sum(bool(getattr(found.result, "missed_goals", ())) for found in self.outcomes)
        if missing:
            rule = f"on {missing} of {len(self.jobs)} maps the robot does not reach every goal"
            raise errors.FindingError(rule, source=self.output / SUMMARY)

    @classmethod
    def printed(cls, job: Job, warning: str) -> str:
        is_named = cls.is_brief or warning.startswith(str(job.path.with_suffix("")))
        return warning if is_named else f"{job.path}: {warning}"


B = TypeVar("B", bound=Batch)


def run_all(
    jobs: Sequence[Job], output: Path, run_job: Callable[[Job], command.Result],
    on_done: Callable[[Job, Outcome], None], kind: type[B], *, workers: Workers | None = None,
) -> B:  # fmt: skip
    marked: dict[int, Job] = {}
    outcomes: dict[int, Outcome] = {}
    started = time.perf_counter()

    def job_of(index: int) -> Job:
        if index not in marked:  # a retry finds the folder of the first attempt
            marked[index] = records.replace(jobs[index], is_new=not exists(jobs[index].folder))
        return marked[index]

    def record(index: int, outcome: Outcome) -> None:
        outcomes[index] = outcome
        on_done(jobs[index], outcome)

    def summarised() -> B:
        found = [outcomes.get(index, Outcome(None)) for index in range(len(jobs))]
        batch = kind(output, jobs, found, time.perf_counter() - started)
        with Transaction([output / SUMMARY], force=True) as transaction:
            transaction.write_json(output / SUMMARY, batch.document())
        return batch

    errors.refuse_warnings()
    make_folder(output)
    try:
        if workers is None:
            for index in range(len(jobs)):
                record(index, attempt(run_job, job_of(index)))
        else:
            dispatch(len(jobs), job_of, partial(attempt, run_job), workers, record)
    except KeyboardInterrupt:
        summarised()
        progress = f"{len(outcomes)} of {len(jobs)} {kind.noun}s are done"
        raise KeyboardInterrupt(f"{progress}, {kind.resuming}") from None
    except errors.MapdealError:
        if outcomes:
            summarised()
        raise
    return summarised()


def run_and_report(
    jobs: Sequence[Job], output: Path, run_job: Callable[[Job], command.Result], kind: type[B],
    terminal: Terminal, *, workers: Workers | None = None,
) -> B:  # fmt: skip
    hint = f"{output / SUMMARY} has them all"
    with terminal.counted(len(jobs), kind.noun) as advance, terminal.few_warnings(hint) as warn:

        def report(job: Job, outcome: Outcome) -> None:
            for text in outcome.warnings:
                warn(kind.printed(job, text))
            if isinstance(outcome.result, errors.MapdealError):
                terminal.error(outcome.result)
            elif outcome.result is not None:
                lines = list(outcome.result.lines())
                for line in lines[:1] if kind.is_brief else lines:
                    terminal.detail(line)
            advance(failed=outcome.status == "failed")

        return run_all(jobs, output, run_job, report, kind, workers=workers)


def _failure(error: errors.MapdealError, job: Job) -> str:
    text = text_of(str(error), job)
    for source in (job.name, str(job.path)):
        text = text.removeprefix(f"{errors.one_line(source)}: ")
    is_short = len(text) <= _LONGEST_REASON
    return f"{job.name}: {text if is_short else text[: _LONGEST_REASON - 3] + '...'}"


def text_of(text: str, job: Job) -> str:
    """Return a message with files named as the summary names them, wherever one stands."""
    for path, name in ((job.folder, job.place), (job.path.parent, Path(job.name).parent)):
        if str(path) not in (".", path.anchor):
            shown = "" if str(name) == "." else f"{name}/"
            text = shown.join(re.split(rf"(?<![\w./-]){re.escape(f'{path}/')}", text))
    return text
