"""How commands that work from file to file read their input and announce their outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from mapdeal.errors import MapdealError, ParameterError, emit_warning, one_line
from mapdeal.formats.budget import holding
from mapdeal.formats.maps import Source, open_map, read_source
from mapdeal.formats.npz import Grid
from mapdeal.formats.source import sums_of_reads
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.field import FieldView
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.folder import write_picture
from mapdeal.pipeline.memory import bytes_of, claim_work
from mapdeal.pipeline.settings import Settings
from mapdeal.render.overlay import Overlay


def read_input(path: Path, settings: Settings, per_cell: float | None = None) -> Source:
    """Return the grid in a file, unless what is done with each cell takes too much memory."""
    with settings.memory(), use_threads(settings.threads):
        source = read_source(path, dialect=settings.dialect, max_cells=settings.max_cells)
        if per_cell is not None:
            claim_work(path, source.grid, per_cell)
        return source


def read_summed(
    path: Path, settings: Settings, per_cell: float | None = None, besides: int = 0
) -> Source:  # fmt: skip
    """Return the grid in a file as `read_input` does, with the checksums of what was read."""
    with (
        settings.memory(),
        use_threads(settings.threads),
        sums_of_reads() as sums,
        open_map(path, dialect=settings.dialect, max_cells=settings.max_cells) as file,
    ):
        source = file.read()
        if per_cell is not None:
            claim_work(path, source.grid, per_cell, besides=besides)
        return replace(source, sums=file.sums_by_name(sums))


def read_together(paths: Sequence[Path], settings: Settings) -> list[Source]:
    """Return the grids in files as `read_summed` does, each counted while the next is read."""
    sources: list[Source] = []
    with ExitStack() as stack:
        stack.enter_context(settings.memory())
        for path in paths:
            sources.append(read_summed(path, settings))
            stack.enter_context(holding(bytes_of(sources[-1].grid)))
    return sources


def frame_of_file(path: Path, settings: Settings) -> tuple[Frame, tuple[Path, ...]]:
    """Return where the grid in a file lies, and the files whose headers were read for it."""
    with settings.memory(), open_map(path, max_cells=settings.max_cells) as file:
        return file.frame(), file.files


@contextmanager
def outputs_of(
    outputs: Sequence[Path],
    inputs: Sequence[Path],
    settings: Settings,
    *,
    curve: Path | None = None,
) -> Iterator[Transaction]:
    """Write `outputs`, the picture, and that of a cost curve together, or not at all."""
    all_outputs = list(outputs)
    for option, picture in (("--image", settings.image), ("--curve", curve)):
        if picture is None:
            continue
        if picture.suffix != ".png":
            raise ParameterError("a picture must end in .png", place=option, got=str(picture))
        if picture in all_outputs:
            raise ParameterError("is an output already", place=option, got=str(picture))
        all_outputs.append(picture)
    with (
        use_threads(settings.threads),
        Transaction(all_outputs, inputs=inputs, force=settings.force) as transaction,
    ):
        yield transaction


def add_picture(
    transaction: Transaction,
    settings: Settings,
    grid: Grid,
    title: str,
    overlay: Overlay | None = None,
) -> None:
    if settings.image is not None:
        write_picture(
            transaction,
            settings.image,
            grid,
            one_line(title),
            image_extent=settings.image_extent,
            overlay=overlay,
        )


def warn_of_potential(grid: Grid, path: Path) -> None:
    if isinstance(grid, PotentialField):
        text = f"{path}: is a potential field; its map is used, its goal and gains are not"
        emit_warning(text, stacklevel=2)


def warn_of_published_costs(source: Source, path: Path) -> None:
    """Warn that of a map whose values may be published costs only obstacles are used."""
    grid, metadata = source.grid, source.metadata
    is_view = isinstance(grid, FieldView)  # which is warned of, or refused, by this name
    if isinstance(grid, OccupancyGrid) and metadata and metadata.mode == "raw" and not is_view:
        between = histogram(grid.occupancy)[FREE + 1 : OCCUPIED].sum()
        if between:
            text = f"{path}: {between} cells of 1..99 are not obstacles; costs are read from an npz"
            emit_warning(text, stacklevel=2)


@contextmanager
def errors_named(path: Path) -> Iterator[None]:
    """Add the file of the grid to errors that do not name a file already."""
    try:
        yield
    except MapdealError as error:
        raise error.found_in(path) from None
