"""One stage from a file to a file, as the stage commands run it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mapdeal.errors import ParameterError, one_line
from mapdeal.formats.map_writer import Encoding, in_trinary
from mapdeal.formats.map_yaml import Dialect, Mode
from mapdeal.formats.maps import output_paths, read_source, write_grid
from mapdeal.formats.npz import Grid, write_npy
from mapdeal.formats.transaction import Transaction
from mapdeal.formats.yaml_text import yaml_document
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.figures import Figures, figures_of
from mapdeal.pipeline.products import title_of, write_picture
from mapdeal.pipeline.stage_list import Step
from mapdeal.stages.esdf import field_view


@dataclass(frozen=True)
class FileOptions:
    """How a command reads its input and writes its outputs.

    Parameters
    ----------
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading of the image to follow.
    max_cells : int, optional
        Cells up to which the input is read.
    force : bool
        Whether outputs that exist are replaced.
    threads : int, optional
        Threads to compute and write with; all processors if not given.
    image : Path, optional
        Where a picture of the result goes.
    """

    dialect: Dialect = "nav2"
    max_cells: int | None = None
    force: bool = False
    threads: int | None = None
    image: Path | None = None


def apply_to_file(
    path: Path,
    output: Path,
    step: Step,
    options: FileOptions,
    *,
    encoding: Encoding = "occupancy",
) -> Figures:
    """Read a map or field, apply one stage, and write the result; return its figures."""
    with use_threads(options.threads):
        return _apply_to_file(path, output, step, options, encoding)


def _apply_to_file(
    path: Path, output: Path, step: Step, options: FileOptions, encoding: Encoding
) -> Figures:
    endings = (".yaml", ".yml", ".npz", *([".npy"] if step.name == "esdf" else []))
    if output.suffix not in endings:
        hint = "--image writes a picture" if output.suffix == ".png" else None
        rule = f"the output must end in {' or '.join(e for e in endings if e != '.yml')}"
        raise ParameterError(rule, source=output, hint=hint)
    source = read_source(path, dialect=options.dialect, max_cells=options.max_cells)
    outputs = _with_image(_paths(output), options)
    with Transaction(outputs, inputs=source.files, force=options.force) as transaction:
        grid = step.apply(source.grid, path)
        _write(transaction, output, grid, step, encoding)
        if options.image is not None:
            write_picture(
                transaction, options.image, grid, one_line(f"{path.stem}: {title_of(step)}")
            )
    return figures_of(grid)


def convert_file(
    path: Path,
    output: Path,
    options: FileOptions,
    *,
    encoding: Encoding | None = None,
    mode: Mode | None = None,
) -> Figures:
    """Read a grid and write it in another format; return its figures.

    A costmap is written in `encoding`; if none is given, as occupancy. A field becomes its
    0..100 view where the output is an image.
    """
    with use_threads(options.threads):
        return _convert_file(path, output, options, encoding, mode)


def _convert_file(
    path: Path,
    output: Path,
    options: FileOptions,
    encoding: Encoding | None,
    mode: Mode | None,
) -> Figures:
    outputs = _with_image(list(output_paths(output)), options)
    source = read_source(path, dialect=options.dialect, max_cells=options.max_cells)
    grid: Grid = source.grid
    if encoding == "costmap2d" and not isinstance(grid, Costmap):
        rule = "only costs can be written as costmap2d bytes; this is no costmap"
        raise ParameterError(rule, source=path, place="encoding")
    with Transaction(outputs, inputs=source.files, force=options.force) as transaction:
        if isinstance(grid, DistanceField) and output.suffix != ".npz":
            grid, mode = field_view(grid), mode or "raw"
        if isinstance(grid, OccupancyGrid) and mode == "trinary":
            grid = in_trinary(grid)
        extra = dict(source.metadata.extra) if source.metadata else {}
        write_grid(
            transaction, output, grid, mode=mode, encoding=encoding or "occupancy", extra=extra
        )
        if options.image is not None:
            write_picture(transaction, options.image, grid, one_line(path.stem))
    return figures_of(grid)


def _with_image(outputs: list[Path], options: FileOptions) -> list[Path]:
    if options.image is None:
        return outputs
    if options.image.suffix != ".png":
        raise ParameterError("a picture must end in .png", place="--image", got=str(options.image))
    if options.image in outputs:
        raise ParameterError("is an output already", place="--image", got=str(options.image))
    return [*outputs, options.image]


def _paths(output: Path) -> list[Path]:
    if output.suffix == ".npy":
        return [output, output.with_suffix(".yaml")]
    return list(output_paths(output))


def _write(
    transaction: Transaction, output: Path, grid: Grid, step: Step, encoding: Encoding
) -> None:
    if not isinstance(grid, DistanceField):
        write_grid(transaction, output, grid, encoding=encoding)
    elif output.suffix == ".npz":
        write_grid(transaction, output, grid)
    elif output.suffix == ".npy":
        document = yaml_document(_geometry_of(grid, output))
        transaction.write(output, lambda file: write_npy(file, grid.distance))

        def write_geometry(file: Any) -> None:
            file.write(document)

        transaction.write(output.with_suffix(".yaml"), write_geometry)
    else:
        write_grid(transaction, output, field_view(grid, **step.view), mode="raw")


def _geometry_of(field: DistanceField, output: Path) -> dict[str, Any]:
    return {
        "distance": output.name,
        "resolution": field.resolution,
        "origin": list(field.origin),
        "convention": field.convention,
        "strength": field.strength,
        "max_distance": field.max_distance,
        "lethal_threshold": field.lethal_threshold,
        "unknown": field.unknown,
    }
