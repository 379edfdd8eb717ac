"""A distance field worked out by workers that share a folder, each some slabs of rows at a time.

The two passes of `mapdeal.stages.large.large_esdf`, as jobs that know nothing of each other: first
the runs of equal cells at each slab's borders, which are joined here; then the distances of each
slab, which its worker writes into their place in the output.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import MapdealError, ParameterError
from mapdeal.formats.large_maps import LargeSource, open_pair
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.npy import begin_npy, write_rows
from mapdeal.formats.yaml_text import yaml_document
from mapdeal.grid.large import LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.column_runs import Beside, SlabRuns, joined, runs_of
from mapdeal.pipeline.cluster import ClusterWorkers, connected, shared_folders
from mapdeal.pipeline.dispatch import dispatch
from mapdeal.pipeline.figures import Extent, Figures, extent_of, field_figures, frame_figures
from mapdeal.pipeline.files import outputs_of
from mapdeal.pipeline.jobs import Job, Outcome, attempt
from mapdeal.pipeline.large import bytes_of_slab, cells_of_slab, too_large
from mapdeal.pipeline.progress import nobody
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.single import geometry_of_npy
from mapdeal.pipeline.stage_list import Step
from mapdeal.stages.esdf import Measuring

_CELLS = 1 << 24
"""Of a job's slab: enough for all that comes with a job to be little beside it."""

_MOST_ROWS = (1 << 16) - 1
_DISTANCE = np.dtype(np.float32)


@dataclass(frozen=True)
class SlabJob(Job):
    """Some rows of a map.

    Parameters
    ----------
    first, end : int
        The rows, from the south.
    beside : Beside, optional
        What lies before and after them.
    target : Path, optional
        The file that their distances go into.
    offset : int
        Where in that file.
    """

    first: int = 0
    end: int = 0
    beside: Beside | None = None
    target: Path | None = None
    offset: int = 0


@dataclass(frozen=True)
class SlabWork:
    """What a worker does with rows of a map; it is sent along with each job.

    Parameters
    ----------
    measuring : Measuring
        How distances are made.
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading of the image to follow.
    max_cells : int, optional
        Cells up to which the map is read.
    """

    measuring: Measuring
    dialect: Dialect
    max_cells: int | None

    def runs(self, job: SlabJob) -> SlabRuns:
        """Return what other slabs must know of this one."""
        return runs_of(self.measuring.obstacles(self._rows(job)))

    def distances(self, job: SlabJob) -> Extent:
        """Write the distances into the target; return how far they reach."""
        if job.target is None:
            raise ValueError("a job of the first pass has no target")
        grid = self._rows(job)
        obstacles = self.measuring.obstacles(grid)
        distance = self.measuring.distance(obstacles, grid.resolution, job.beside)
        write_rows(job.target, job.offset, distance)
        return extent_of(distance, obstacles)

    def _rows(self, job: SlabJob) -> OccupancyGrid:
        with open_pair(
            job.path, together=job.end - job.first, dialect=self.dialect,
            max_cells=self.max_cells, is_read=False,
        ) as source:  # fmt: skip
            return _large(source, job.path).part(slice(job.first, job.end))


def esdf_by_workers(
    path: Path, output: Path, step: Step, options: Settings, scheduler: str
) -> Figures:
    """Have workers compute the distance field of a map into an ``.npy``; return its figures.

    Parameters
    ----------
    path, output : Path
        The map, a pair with a P5 image, and the field, both absolute: workers open them, too.
    step : Step
        The stage ``esdf``.
    options : Settings
        How the map is read and the output written.
    scheduler : str
        The address of the workers' scheduler.

    Raises
    ------
    ParameterError
        If the map or the output is of another kind.
    MapdealError
        If the map cannot be read, or a worker has failed; no output is left then.
    """
    if output.suffix != ".npy" or options.image is not None:
        rule = "workers write a field as .npy, without a picture"
        raise ParameterError(rule, source="--scheduler", got=output.name)
    work = SlabWork(Measuring(**step.parameters), options.dialect, options.max_cells)
    whole = SlabJob(path, output, path.name, output.name)
    with (
        connected(scheduler, shared_folders(whole)) as client,
        open_pair(
            path, together=1, dialect=options.dialect, max_cells=options.max_cells, is_read=False
        ) as source,
    ):
        workers = ClusterWorkers(client, scheduler)
        grid = _large(source, path)
        files = source.files if source else ()
        jobs = _slabs(whole, grid.shape, options.max_memory or workers.memory_of_each())
        parts: list[Extent] = []

        def fill(target: Path) -> None:
            """Go through both passes; the target is the output under another name."""
            start = begin_npy(target, grid.shape, _DISTANCE)
            runs: list[SlabRuns] = _done(jobs, work.runs, workers, tell)
            row = grid.shape[1] * _DISTANCE.itemsize
            known = zip(jobs, joined(runs), strict=True)
            parts.extend(_done(
                [replace(job, beside=beside, target=target, offset=start + job.first * row)
                 for job, beside in known],
                work.distances, workers, tell,
            ))  # fmt: skip

        outputs = [output, output.with_suffix(".yaml")]
        with (
            (options.progress or nobody)(2 * len(jobs)) as tell,
            outputs_of(outputs, files, options) as transaction,
        ):
            transaction.fill_in_place(output, fill)
            document = yaml_document(geometry_of_npy(grid, work.measuring, output))
            transaction.write_bytes(outputs[1], document)
    return {**frame_figures(grid), **field_figures(parts, work.measuring.convention)}


def _large(source: LargeSource | None, path: Path) -> LargeMap:
    if source is None:
        rule = "workers read maps with a binary .pgm image of 8 bits"
        raise ParameterError(rule, source=path)
    return source.grid


def _slabs(whole: SlabJob, shape: tuple[int, int], memory: int | None) -> list[SlabJob]:
    """Return jobs for all rows of a map, none of which takes more memory than a worker has."""
    height, width = shape
    cells = _CELLS if memory is None else min(_CELLS, cells_of_slab(memory))
    rows = min(cells // width, _MOST_ROWS)
    if rows < 1:
        raise too_large(whole.path, shape, bytes_of_slab(width), memory or 0)
    return [
        replace(whole, first=first, end=min(first + rows, height))
        for first in range(0, height, rows)
    ]


def _done(
    jobs: Sequence[SlabJob], run_one: Callable[[SlabJob], Any], workers: ClusterWorkers,
    tell: Callable[[int], object],
) -> list[Any]:  # fmt: skip
    """Return what workers have made of jobs, in their order; the first failure ends all."""
    results: dict[int, Any] = {}

    def done(index: int, outcome: Outcome) -> None:
        if isinstance(outcome.result, MapdealError):
            raise outcome.result
        results[index] = outcome.result
        tell(1)

    dispatch(len(jobs), jobs.__getitem__, partial(attempt, run_one), workers, done)
    return [results[index] for index in range(len(jobs))]
