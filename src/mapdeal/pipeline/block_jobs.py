"""A distance field worked out by workers that share a folder, each some blocks of rows at a time.

The two passes of a distance field, as jobs that know nothing of each other: first
the runs of equal cells at each block's borders, which are joined here; then the distances of each
block, which its worker writes into their place in the output.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import FileAccessError, MapdealError, ParameterError
from mapdeal.formats.file_state import CHANGED, FileState
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import MapFile, Source, open_map
from mapdeal.formats.npy import begin_npy, write_rows
from mapdeal.formats.yaml_text import yaml_document
from mapdeal.grid.field import DistanceRange, range_figures, range_of
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.column_runs import BlockRuns, Halo, halos_of, runs_of
from mapdeal.pipeline.cluster import ClusterWorkers, connected, shared_folders
from mapdeal.pipeline.dispatch import dispatch
from mapdeal.pipeline.files import outputs_of
from mapdeal.pipeline.jobs import Job, Outcome, attempt
from mapdeal.pipeline.memory import bytes_of_block, cells_of_block, too_large
from mapdeal.pipeline.products import geometry_of_npy
from mapdeal.pipeline.progress import report_nothing
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.records import dataclass
from mapdeal.stages.definition import RowsAlone

_CELLS = 1 << 24
"""Of a job's block: enough for all that comes with a job to be little beside it."""

_MOST_ROWS = (1 << 16) - 1
_DISTANCE = np.dtype(np.float32)


@dataclass(frozen=True)
class BlockJob(Job):
    """Some rows of a map."""

    first: int = 0
    end: int = 0
    halo: Halo | None = None
    target: Path | None = None
    offset: int = 0
    states: Mapping[Path, FileState] = field(default_factory=dict)


@dataclass(frozen=True)
class BlockWork:
    """What a worker does with rows of a map; it is sent along with each job."""

    rule: RowsAlone
    dialect: Dialect
    max_cells: int | None

    def runs(self, job: BlockJob) -> BlockRuns:
        """Return what other blocks must know of this one."""
        return runs_of(self.rule.obstacles(self._rows(job)))

    def distances(self, job: BlockJob) -> DistanceRange:
        """Write the distances into the target; return how far they reach."""
        if job.target is None:
            raise ValueError("a job of the first pass has no target")
        grid = self._rows(job)
        obstacles = self.rule.obstacles(grid)
        distance = self.rule.distance(obstacles, grid.resolution, job.halo)
        write_rows(job.target, job.offset, distance)
        return range_of(distance, obstacles)

    def _rows(self, job: BlockJob) -> OccupancyGrid:
        with open_map(job.path, dialect=self.dialect, max_cells=self.max_cells) as file:
            for path, state in file.states.items():
                if job.states.get(path) != state:
                    raise FileAccessError(CHANGED, source=path)
            source = _by_rows(file, job.end - job.first)
            return source.grid.part(slice(job.first, job.end))  # type: ignore[return-value]


def apply_by_workers(
    path: Path, output: Path, step: Step, settings: Settings, scheduler: str
) -> Figures:
    """Compute a distance field on workers into an ``.npy`` file; return its figures."""
    if step.stage.rows_alone is None:
        raise ParameterError("is computed on one machine", source="--scheduler", got=step.name)
    if output.suffix != ".npy" or settings.image is not None:
        rule = "workers write a field as .npy, without a picture"
        raise ParameterError(rule, source="--scheduler", got=output.name)
    work = BlockWork(step.stage.rows_alone(step.parameters), settings.dialect, settings.max_cells)
    whole = BlockJob(path, output, path.name, output.name)
    with (
        connected(scheduler, shared_folders(whole)) as client,
        open_map(path, dialect=settings.dialect, max_cells=settings.max_cells) as file,
    ):
        workers = ClusterWorkers(client, scheduler)
        grid, files = _by_rows(file, 1).grid, file.files
        whole = replace(whole, states=file.states)
        jobs = _blocks(whole, grid.shape, settings.max_memory or workers.memory_of_each())
        parts: list[DistanceRange] = []

        def fill(target: Path) -> None:
            """Go through both passes; the target is the output under another name."""
            start = begin_npy(target, grid.shape, _DISTANCE)
            runs: list[BlockRuns] = _done(jobs, work.runs, workers, tell)
            row = grid.shape[1] * _DISTANCE.itemsize
            known = zip(jobs, halos_of(runs), strict=True)
            parts.extend(_done(
                [replace(job, halo=halo, target=target, offset=start + job.first * row)
                 for job, halo in known],
                work.distances, workers, tell,
            ))  # fmt: skip

        outputs = [output, output.with_suffix(".yaml")]
        with (
            (settings.progress or report_nothing)(2 * len(jobs)) as tell,
            outputs_of(outputs, files, settings) as transaction,
        ):
            transaction.fill_in_place(output, fill)
            document = yaml_document(geometry_of_npy(grid, work.rule, output))
            transaction.write_bytes(outputs[1], document)
    return {**grid.frame_figures(), **range_figures(parts, work.rule.convention)}


def _by_rows(file: MapFile, block_height: int) -> Source:
    # of a compressed image each job would decode all that lies before its rows
    if file.shape_by_rows is None or file.is_compressed:
        rule = "workers read maps with a binary .pgm, .ppm or .pbm image, or an uncompressed .bmp"
        hint = "mapdeal convert makes a .pgm of any map"
        file.check_unchanged()  # an image that is being written has no rows
        raise ParameterError(rule, source=file.path, hint=hint)
    return file.by_rows(block_height=block_height, warns_of_values=False)


def _blocks(whole: BlockJob, shape: tuple[int, int], memory: int | None) -> list[BlockJob]:
    """Return jobs for all rows of a map, none of which takes more memory than a worker has."""
    height, width = shape
    cells = _CELLS if memory is None else min(_CELLS, cells_of_block(memory))
    rows = min(cells // width, _MOST_ROWS)
    if rows < 1:
        raise too_large(whole.path, shape, bytes_of_block(width), memory or 0)
    return [
        replace(whole, first=first, end=min(first + rows, height))
        for first in range(0, height, rows)
    ]


def _done(
    jobs: Sequence[BlockJob], run_one: Callable[[BlockJob], Any], workers: ClusterWorkers,
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
