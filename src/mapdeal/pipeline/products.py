"""Output files of each type of grid, and how they are written.

What draws pictures that few runs have is imported when one is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

from mapdeal.errors import ParameterError, one_line
from mapdeal.formats.map_writer import Encoding
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.npy import write_npy
from mapdeal.formats.npz import Grid
from mapdeal.formats.png import write_indexed_png
from mapdeal.formats.transaction import PutRows, RowsWriter, Transaction
from mapdeal.formats.yaml_text import yaml_document
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.field_view import FieldView
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures, Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reach import Reach
from mapdeal.kernels.blocks import gathered
from mapdeal.kernels.lookup import histogram
from mapdeal.pipeline.one_pass import one_pass
from mapdeal.pipeline.step import Step
from mapdeal.records import dataclass
from mapdeal.render.layers import (
    CostDrawing,
    Drawing,
    FieldDrawing,
    OccupancyDrawing,
    cost_image,
    field_image,
    occupancy_image,
)
from mapdeal.render.overlay import Overlay
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.render.shown import DEFAULT_EXTENT, ImageExtent, KnownLines, OtherThan

PICTURE = ".png"

_FARTHEST = 100.0
"""Metres: a radius beyond that is of no robot, and would fit no picture."""


@dataclass(frozen=True)
class GridFiles:
    """Output files for one type of grid."""

    metavar: str
    about: str
    endings: tuple[str, ...]
    in_folder: tuple[str, ...]
    draw: Callable[..., Image]
    drawing: type[Drawing] | None = None


def _potential_image(grid: PotentialField, **how: Any) -> Image:
    from mapdeal.render.potential import potential_image

    return potential_image(grid, **how)


def _reach_image(grid: Reach, **how: Any) -> Image:
    from mapdeal.render.reach import reach_image

    return reach_image(grid, **how)


_FILES: dict[type[Any], GridFiles] = {
    OccupancyGrid: GridFiles(
        "OUT", "The result: .yaml (with .pgm) or .npz.",
        (".yaml", ".yml", ".npz"), (".pgm", ".yaml"), occupancy_image, OccupancyDrawing,
    ),
    FieldView: GridFiles(
        "OUT", "The view: .yaml (with .pgm) or .npz.",
        (".yaml", ".yml", ".npz"), (".pgm", ".yaml"), occupancy_image, OccupancyDrawing,
    ),
    Costmap: GridFiles(
        "OUT", "The costs: .yaml (with .pgm) or .npz.",
        (".yaml", ".yml", ".npz"), (".npz", ".pgm", ".yaml"), cost_image, CostDrawing,
    ),
    DistanceField: GridFiles(
        "OUT", "The field as .npz, as a bare .npy, or its 0..100 view as .yaml (with .pgm).",
        (".yaml", ".yml", ".npz", ".npy"), (".npz", ".pgm", ".yaml"), field_image, FieldDrawing,
    ),
    PotentialField: GridFiles(
        "OUT.npz", "The field, with all its layers.",
        (".npz",), (".npz",), _potential_image,
    ),
    Reach: GridFiles(
        "OUT", "The answer as .json, or its layers as .npz.",
        (".json", ".npz"), (".npz", ".json"), _reach_image,
    ),
}  # fmt: skip


def files_of(made: type[Any]) -> GridFiles:
    """Return how grids of a type are written."""
    if made not in _FILES:
        raise TypeError(f"it is not known how a {made.__name__} is written")
    return _FILES[made]


def paths_of(step: Step, folder: Path, *, images: bool) -> list[Path]:
    """Return the files that a step of a run writes into `folder`, in the order of writing."""
    endings = [*files_of(step.stage.makes).in_folder, *([PICTURE] if images else [])]
    return [folder / f"{step.stage.product}{ending}" for ending in endings]


def passes_of(step: Step, endings: Iterable[str]) -> int:
    """Return how often lazy layers are gone through for a step and some files of its product.

    Once for its figures and once for the files; besides that by the stage, and by its view.
    """
    has_view = step.stage.view is not None and not {".pgm", ".yaml", ".yml"}.isdisjoint(endings)
    return 2 + step.stage.passes + (step.stage.view_passes(step.view) if has_view else 0)


def figures_of(grid: Grid, *, box_of_known: bool) -> Figures:
    """Return the figures of a grid."""
    if box_of_known and isinstance(grid, (OccupancyGrid, Costmap)) and grid.is_lazy:
        gathered(grid.layer, histogram, KnownLines(OtherThan(grid.unknown_value)))
    return grid.figures()


def output_of(step: Step, output: Path) -> list[Path]:
    """Return the files that a step's product becomes if it is written to `output`."""
    endings = files_of(step.stage.makes).endings
    if output.suffix not in endings:
        hint = "--image writes a picture" if output.suffix == PICTURE else None
        rule = f"the output must end in {' or '.join(e for e in endings if e != '.yml')}"
        raise ParameterError(rule, source=output, hint=hint)
    if output.suffix == ".npy":
        return [output, output.with_suffix(".yaml")]
    return list(output_paths(output))


def write_product(
    transaction: Transaction,
    output: Path,
    grid: Grid,
    step: Step,
    *,
    asked: Grid,
    encoding: Encoding = "occupancy",
) -> None:
    """Write a step's product to a file, and the other one of a pair.

    Within a pass; `asked` is the grid that `one_pass` gives.
    """
    if isinstance(asked, DistanceField) and output.suffix == ".npy":
        transaction.write(output, lambda file: write_npy(file, asked.distance))
        document = yaml_document(_geometry_of_npy(grid, output))
        transaction.write_bytes(output.with_suffix(".yaml"), document)
    elif isinstance(grid, Reach) and output.suffix == ".json":
        from mapdeal.formats.reach_json import reach_json

        transaction.write_bytes(output, f"{reach_json(grid)}\n".encode())
    elif isinstance(grid, DistanceField) and output.suffix != ".npz":
        write_grid(transaction, output, step.view_of(grid), mode="raw")
    else:
        made = asked if output.suffix == ".npz" else grid
        write_grid(transaction, output, made, encoding=encoding)


def write_products(
    transaction: Transaction,
    step: Step,
    grid: Grid,
    folder: Path,
    *,
    stem: str,
    images: bool = True,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = DEFAULT_EXTENT,
    overlay: Overlay | None = None,
) -> None:
    """Write all files of a step's product, those of `paths_of`."""
    with one_pass(transaction, grid) as asked:
        for path in paths_of(step, folder, images=images):
            if path.suffix == PICTURE:
                title = one_line(f"{stem}: {step.title}")
                write_picture(
                    transaction,
                    path,
                    grid,
                    title,
                    image_max=image_max,
                    image_extent=image_extent,
                    overlay=overlay,
                )
            elif path.suffix != ".pgm":  # it is written with its YAML
                write_product(transaction, path, grid, step, asked=asked)


def write_picture(
    transaction: Transaction,
    path: Path,
    grid: Grid,
    title: str,
    *,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = DEFAULT_EXTENT,
    overlay: Overlay | None = None,
) -> None:
    """Write the picture of a grid; it is drawn in the thread that writes it."""
    files = files_of(type(grid))
    how: dict[str, Any] = {
        "image_max": image_max, "image_extent": image_extent, "overlay": overlay
    }  # fmt: skip

    def write(file: BinaryIO, image: Image) -> None:
        write_indexed_png(file, image.indices, image.palette)

    if files.drawing is None:
        transaction.write(path, lambda file: write(file, files.draw(grid, title=title, **how)))
        return
    make_drawing = files.drawing

    def begin(file: BinaryIO) -> tuple[PutRows, Callable[[], object]]:
        drawing = make_drawing(grid, **how)
        return drawing.take, lambda: write(file, drawing.image(title))

    transaction.write(path, RowsWriter(grid.layer, begin))


def robot_overlays(step: Step, robot: Footprint | None = None) -> list[Overlay]:
    """Return what the picture of a step's product shows of the robot that the step is about."""
    shape = step.stage.robot
    if shape is None or step.stage.makes is Reach:  # whose picture has it at its start
        return []
    from mapdeal.render.robot import RobotOverlay

    given = [step.parameters.get(name) for name in (*shape.sets, shape.replaces)]
    known = next((one for one in given if isinstance(one, Footprint)), robot)
    radius = step.parameters[shape.replaces]
    if known is None and radius and radius <= _FARTHEST:
        around = step.parameters.get("circumscribed_radius")
        is_round = around is None or around == radius
        label = {} if is_round else {"label": "the robot's inscribed circle"}
        return [RobotOverlay(Footprint.circle(radius), **label)]
    return [] if known is None or not radius else [RobotOverlay(known)]


def write_curve(transaction: Transaction, path: Path, curve: CostCurve, title: str) -> None:
    """Write the picture of a cost curve; it is drawn in the thread that writes it."""
    from mapdeal.render.cost_curve import cost_curve_image

    def write(file: object) -> None:
        image = cost_curve_image(curve, title=one_line(title))
        write_indexed_png(file, image.indices, image.palette)  # type: ignore[arg-type]

    transaction.write(path, write)


def _geometry_of_npy(grid: Framed, output: Path) -> dict[str, Any]:
    """Return what the YAML beside a bare ``.npy`` says of the field: geometry and parameters."""
    names = ("convention", "strength", "max_distance", "lethal_threshold", "unknown")
    return {
        "distance": output.name,
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        **{name: getattr(grid, name) for name in names},
    }
