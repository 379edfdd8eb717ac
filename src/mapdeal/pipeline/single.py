"""One stage from a file to a file, as the stage commands run it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.errors import ParameterError
from mapdeal.formats.large_maps import LargeSource
from mapdeal.formats.map_writer import Encoding
from mapdeal.formats.maps import Source, as_occupancy, output_paths, write_grid
from mapdeal.formats.npy import write_npy
from mapdeal.formats.npz import AnyGrid
from mapdeal.formats.transaction import Transaction
from mapdeal.formats.yaml_text import yaml_document
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.large import LargeCosts, LargeField, LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.figures import Figures, figures_of
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of, read_input
from mapdeal.pipeline.large import opened_source
from mapdeal.pipeline.products import title_of, view_of
from mapdeal.pipeline.progress import passes_of, written
from mapdeal.pipeline.settings import ProgressCallback, Settings
from mapdeal.pipeline.stage_list import Step
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.stages.esdf import Measuring
from mapdeal.stages.keepout import apply_keepout_mask


def apply_to_file(
    path: Path,
    output: Path,
    step: Step,
    options: Settings,
    *,
    encoding: Encoding = "occupancy",
    mask: Path | None = None,
) -> Figures:
    """Read a map or field, apply one stage, and write the result; return its figures.

    A keepout mask, a map of its own, is laid over the costs that the stage makes.
    """
    endings: tuple[str, ...] = (".yaml", ".yml", ".npz")
    if step.name == "esdf":
        endings += (".npy",)
    elif step.name == "potential":
        endings = (".npz",)
    if output.suffix not in endings:
        hint = "--image writes a picture" if output.suffix == ".png" else None
        rule = f"the output must end in {' or '.join(e for e in endings if e != '.yml')}"
        raise ParameterError(rule, source=output, hint=hint)
    image_max = None if options.image is None else DEFAULT_IMAGE_MAX
    with (
        use_threads(options.threads),
        opened_source(path, [step], options, image_max=image_max) as source,
    ):
        over = None if mask is None else read_input(mask, options)
        inputs = [*source.files, *(over.files if over else ())]
        with (
            written(_watch_of(source, options), _passes(output, step, options)) as progress,
            outputs_of(_paths(output), inputs, options) as transaction,
            errors_named(path),
        ):
            grid = step.apply(source.grid, path)
            title = title_of(step)
            if over is not None and mask is not None:
                grid = _masked(grid, as_occupancy(over.grid, "the mask"), mask)
                title += f", with {mask.name}"
            watched = progress.watched(grid)
            _write(transaction, output, watched, step, encoding)
            add_picture(transaction, options, watched, f"{path.stem}: {title}")
            return figures_of(grid)


def _watch_of(source: Source | LargeSource, options: Settings) -> ProgressCallback | None:
    return options.progress if isinstance(source, LargeSource) else None


def _passes(output: Path, step: Step, options: Settings) -> int:
    suffixes = [output.suffix, *([".png"] if options.image is not None else [])]
    return sum(passes_of(step, suffix) for suffix in suffixes)


def _masked(grid: AnyGrid, mask: OccupancyGrid, path: Path) -> Costmap:
    if isinstance(grid, LargeCosts):
        rule = "is for maps that fit into memory"
        hint = "raise --max-memory if there is more"
        raise ParameterError(rule, place="mask", got=path.name, hint=hint)
    if not isinstance(grid, Costmap):
        raise ParameterError("only costs take a mask", source=path)
    with errors_named(path):
        return apply_keepout_mask(grid, mask)


def _paths(output: Path) -> list[Path]:
    if output.suffix == ".npy":
        return [output, output.with_suffix(".yaml")]
    return list(output_paths(output))


def _write(
    transaction: Transaction, output: Path, grid: AnyGrid, step: Step, encoding: Encoding
) -> None:
    if not isinstance(grid, (DistanceField, LargeField)):
        write_grid(transaction, output, grid, encoding=encoding)
    elif output.suffix == ".npz":
        write_grid(transaction, output, grid)
    elif output.suffix == ".npy":
        transaction.write(output, lambda file: write_npy(file, grid.distance))
        document = yaml_document(geometry_of_npy(grid, grid, output))
        transaction.write_bytes(output.with_suffix(".yaml"), document)
    else:
        write_grid(transaction, output, view_of(grid, step), mode="raw")


def geometry_of_npy(
    grid: LargeMap | DistanceField | LargeField,
    measuring: Measuring | DistanceField | LargeField,
    output: Path,
) -> dict[str, Any]:
    """Return what the YAML beside a bare ``.npy`` says of the field: geometry and parameters."""
    return {
        "distance": output.name,
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "convention": measuring.convention,
        "strength": measuring.strength,
        "max_distance": measuring.max_distance,
        "lethal_threshold": measuring.lethal_threshold,
        "unknown": measuring.unknown,
    }
