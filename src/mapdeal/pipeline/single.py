"""One stage from a file to a file, as the stage commands run it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.formats.budget import holding
from mapdeal.formats.map_writer import Encoding
from mapdeal.formats.maps import as_occupancy, read_source
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of
from mapdeal.pipeline.folder import (
    PICTURE,
    one_pass,
    output_of,
    passes_of,
    robot_overlays,
    write_curve,
    write_product,
)
from mapdeal.pipeline.memory import bytes_of, opened_map
from mapdeal.pipeline.progress import passes_reported
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.records import dataclass
from mapdeal.render.overlay import KeepoutOverlay, Overlays
from mapdeal.stages.keepout import apply_keepout_mask


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
