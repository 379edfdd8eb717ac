"""What a run would do, without doing it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from mapdeal.errors import FileAccessError, MapdealError, kept_warnings
from mapdeal.formats.maps import MapFile, open_map
from mapdeal.formats.source import is_same_file, sums_of_reads
from mapdeal.pipeline.jobs import Job, MapRun
from mapdeal.pipeline.memory import Need, need_of
from mapdeal.pipeline.run import output_folder
from mapdeal.records import dataclass


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
            cells = resolution_of(file) if run.around is not None else 0.0
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


def resolution_of(file: MapFile) -> float:
    """Return the side of a map's cells, metres, as its YAML says it; an npz must be read."""
    if file.metadata is not None:
        return file.metadata.resolution
    return file.read().grid.resolution


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
