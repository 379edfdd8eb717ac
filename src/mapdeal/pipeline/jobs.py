"""The jobs of a batch, and what becomes of each: what goes to a worker, and what comes back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mapdeal.errors import (
    MapdealError,
    ParameterError,
    kept_warnings,
    one_line,
    refusal_of_the_system,
    strict_warnings,
)
from mapdeal.formats.map_listing import ListedMap
from mapdeal.formats.source import ignores_case
from mapdeal.kernels.threads import available_threads
from mapdeal.pipeline.applied import RunReport
from mapdeal.pipeline.memory import memory_budget
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings
from mapdeal.records import dataclass

if TYPE_CHECKING:  # only runs around a robot need what it imports
    from mapdeal.pipeline.around import Around

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
        """Run the map of a job into its folder."""
        settings = replace(self.settings, force=self.settings.force or job.is_new)
        with settings.memory(anew=True), strict_warnings(settings.strict, job.path):
            return run_map(job.path, job.folder, self.recipe, settings, self.around)


def attempt(run_one: Callable[[Any], Any], job: Job) -> Outcome:
    """Do a job; whatever it raises or warns of is part of the outcome."""
    with _recorded_warnings() as texts:
        result = _result_of(run_one, job)
    return Outcome(result, tuple(texts))


def _result_of(run_one: Callable[[Any], Any], job: Job) -> Any:
    try:
        return run_one(job)
    except MapdealError as error:
        return error
    except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
        return refusal_of_the_system(problem, job.path) or internal_error(job, problem)


def internal_error(job: Job, problem: BaseException) -> MapdealError:
    """Return the failure of a job that met a bug."""
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
    """Return a job for each map."""
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
