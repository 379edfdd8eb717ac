"""One stage from a file to a file, as the stage commands run it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import MapdealError, ParameterError, emit_warning, kept_warnings, one_line
from mapdeal.files.budget import holding
from mapdeal.files.transaction import Transaction
from mapdeal.grid.costmap import CostCurve, Costmap, InflationLayer
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.map_yaml import MapMetadata
from mapdeal.maps.npz import Grid
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import as_occupancy, output_paths, read_source, write_grid
from mapdeal.pictures.overlay import KeepoutOverlay, Overlays
from mapdeal.pipeline.folder import (
    PICTURE,
    one_pass,
    output_of,
    passes_of,
    robot_overlays,
    write_curve,
    write_product,
)
from mapdeal.pipeline.inputs import (
    add_picture,
    bytes_of,
    claim_step,
    errors_named,
    opened_map,
    outputs_of,
    read_input,
)
from mapdeal.pipeline.settings import Settings, passes_reported
from mapdeal.pipeline.step import Step, grid_of
from mapdeal.stages.keepout import apply_keepout_mask
from mapdeal.stages.older_queue import queue_difference


@dataclass(frozen=True)
class SingleResult:
    """What one stage has made of a file, as it returns it, and the checksums of what was read."""

    figures: Figures
    made: Any
    sums: Mapping[str, str]
    curve: CostCurve | None = None


def apply_to_file(
    path: Path,
    output: Path,
    step: Step,
    settings: Settings,
    *,
    encoding: Encoding = "occupancy",
    mask: Path | None = None,
    curve: Path | None = None,
    with_curve: bool = False,
    with_sums: bool = False,
    also_read: Sequence[Path] = (),
) -> SingleResult:
    """Read a map or field, apply one stage, and write the result."""
    # A keepout mask, a map of its own, is laid over the costs that the stage makes. The picture of
    # their curve goes to `curve`, if that is given; `with_curve` asks for the curve alone, if there
    # is one. Files that were read for the parameters are no more replaced than the map is.
    stage = step.stage
    outputs = output_paths(output) if stage.edits else output_of(step, output)
    endings = [output.suffix, *([PICTURE] if settings.image is not None else [])]
    image_max = None if settings.image is None else settings.image_max
    with (
        use_threads(settings.threads),
        opened_map(path, [step], settings, image_max=image_max, with_sums=with_sums) as source,
    ):
        over = None
        if mask is not None:
            with holding(0 if source.grid.is_lazy else bytes_of(source.grid)):
                over = read_source(mask, dialect=settings.dialect, max_cells=settings.max_cells)
        inputs = [*source.files, *(over.files if over else ()), *also_read]
        progress = settings.progress if source.grid.is_lazy else None
        with (
            passes_reported(progress, passes_of(step, endings)),
            outputs_of(outputs, inputs, settings, curve=curve) as transaction,
            errors_named(path),
        ):
            taken = source.grid if stage.edits else step.taken(source.grid, path)
            if stage.moves:
                claim_step(path, taken, step)
            made = step.result_of(taken, path)
            grid = grid_of(made)
            title = step.title
            costs = None
            if curve is not None or with_curve:
                costs = step.curve_on(taken)
            if curve is not None and costs is None:
                raise step.no_curve()
            overlays = robot_overlays(step)
            if over is not None and mask is not None:
                occupancy = as_occupancy(over.grid, "the mask")
                if not isinstance(grid, Costmap):
                    raise ParameterError("a mask applies to costs only", source=mask)
                with errors_named(mask):
                    masked = apply_keepout_mask(grid, occupancy)
                overlays.insert(0, KeepoutOverlay.of(grid, masked))
                grid, title = masked, f"{title}, with {mask.name}"
            overlay = Overlays(tuple(overlays)) if overlays else None
            title = f"{path.stem}: {title}"
            with one_pass(transaction, grid) as asked:
                if stage.edits:
                    _write_edited(transaction, output, grid, source.metadata, asked=asked)
                else:
                    write_product(transaction, output, grid, step, asked=asked, encoding=encoding)
                if stage.shows_changes:
                    _add_changes(transaction, settings, taken, grid, title)
                else:
                    add_picture(transaction, settings, grid, title, overlay)
            if curve is not None and costs is not None:
                write_curve(transaction, curve, costs, f"{path.stem}: {step.title}")
            figures = grid.figures()
            remark = step.remark_on(figures)
            if remark is not None:
                emit_warning(f"{path}: {remark}", stacklevel=2)
            return SingleResult(figures, made, source.sums, costs)


def _write_edited(
    transaction: Transaction, output: Path, grid: Grid, metadata: MapMetadata | None, *, asked: Grid
) -> None:
    """Write a grid with the scale of costs and further keys of the YAML that it was read from."""
    as_bytes = metadata is not None and metadata.cost_scale is not None
    write_grid(
        transaction,
        output,
        asked if output.suffix == ".npz" else grid,
        encoding="costmap2d" if as_bytes else "occupancy",
        extra=dict(metadata.extra) if metadata else {},
    )


_FILLED = 7
"""Of the picture: unknown cells that are now free; see `cleaning_style`."""


def _add_changes(
    transaction: Transaction, settings: Settings, before: Grid, after: Grid, title: str
) -> None:
    """Draw the map with the cells that have changed in colours of their own."""
    if settings.image is None:
        return
    from mapdeal.compare.difference import STATES, changes_of, states_of
    from mapdeal.pictures.comparisons import difference_image
    from mapdeal.pictures.styles import cleaning_style

    was, now = (states_of(np.asarray(grid.layer)) for grid in (before, after))
    changes = changes_of(was, now, np.ones(before.shape, dtype=np.bool_))
    changes[(was == STATES.index("unknown")) & (now == STATES.index("free"))] = _FILLED
    image = difference_image(
        changes,
        before.frame,
        title=one_line(title),
        image_extent=settings.image_extent,
        style=cleaning_style(),
    )
    write = partial(write_indexed_png, indices=image.indices, palette=image.palette)
    transaction.write(settings.image, write)


_PER_CELL = 60.0
"""Bytes for each cell that the queue takes, measured and rounded up."""


def queue_lines(path: Path, steps: Sequence[Step], settings: Settings) -> Iterator[str]:
    """Yield how costs of exact distances differ from those of an older inflation layer's queue."""
    for step in filter(_has_queue, steps):
        try:
            with settings.memory(), kept_warnings():  # said when the costs were made
                taken: Any = step.taken(read_input(path, settings, _PER_CELL).grid)
                cells, largest = queue_difference(taken, step.parameters)
        except MapdealError as error:
            text = f"the queue of older inflation layers is not compared: {error.rule}"
        else:
            known = {0: "no cell differs", 1: "1 cell differs"}
            differ = known.get(cells, f"{cells} cells differ")
            text = f"{differ} from the queue of older inflation layers"
            text += f", by {largest} at most" if cells else ""
        yield f"{step.name}: {text}"


def _has_queue(step: Step) -> bool:
    layers = step.parameters.get("layers")
    if layers is None:
        return step.parameters.get("lookup") == "exact"
    return any(isinstance(one, InflationLayer) and one.lookup == "exact" for one in layers)
