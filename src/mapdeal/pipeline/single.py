"""One stage from a file to a file, as the stage commands run it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mapdeal.errors import ParameterError, emit_warning, kept_warnings
from mapdeal.files.budget import holding
from mapdeal.grid.costmap import CostCurve, Costmap, InflationLayer
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.reading import as_occupancy, read_source
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
    errors_named,
    opened_map,
    outputs_of,
    read_input,
)
from mapdeal.pipeline.settings import Settings, passes_reported
from mapdeal.pipeline.step import Step
from mapdeal.stages.keepout import apply_keepout_mask
from mapdeal.stages.older_queue import queue_difference


@dataclass(frozen=True)
class SingleResult:
    """What one stage has made of a file."""

    figures: Figures
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
    also_read: Sequence[Path] = (),
) -> SingleResult:
    """Read a map or field, apply one stage, and write the result."""
    # A keepout mask, a map of its own, is laid over the costs that the stage makes. The picture of
    # their curve goes to `curve`, if that is given; `with_curve` asks for the curve alone, if there
    # is one. Files that were read for the parameters are no more replaced than the map is.
    outputs = output_of(step, output)
    endings = [output.suffix, *([PICTURE] if settings.image is not None else [])]
    image_max = None if settings.image is None else settings.image_max
    with (
        use_threads(settings.threads),
        opened_map(path, [step], settings, image_max=image_max) as source,
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
            taken = step.taken(source.grid, path)
            grid = step.apply(taken, path)
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
            with one_pass(transaction, grid) as asked:
                write_product(transaction, output, grid, step, asked=asked, encoding=encoding)
                add_picture(transaction, settings, grid, f"{path.stem}: {title}", overlay)
            if curve is not None and costs is not None:
                write_curve(transaction, curve, costs, f"{path.stem}: {step.title}")
            figures = grid.figures()
            remark = step.remark_on(figures)
            if remark is not None:
                emit_warning(f"{path}: {remark}", stacklevel=2)
            return SingleResult(figures, costs)


_PER_CELL = 60.0
"""Bytes for each cell that the queue takes, measured and rounded up."""


def told_of_queue(path: Path, step: Step, settings: Settings) -> str | None:
    """Return how costs of exact distances differ from those of an older inflation layer's queue."""
    if not _has_queue(step):
        return None
    with settings.memory(), kept_warnings():  # all of it was said when the costs were made
        taken: Any = step.taken(read_input(path, settings, _PER_CELL).grid)
        cells, largest = queue_difference(taken, step.parameters)
    if not cells:
        return f"{step.name}: no cell differs from the queue of older inflation layers"
    differ = "1 cell differs" if cells == 1 else f"{cells} cells differ"
    return f"{step.name}: {differ} from the queue of older inflation layers, by {largest} at most"


def _has_queue(step: Step) -> bool:
    layers = step.parameters.get("layers")
    if layers is None:
        return step.parameters.get("lookup") == "exact"
    return any(isinstance(one, InflationLayer) and one.lookup == "exact" for one in layers)
