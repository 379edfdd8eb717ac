"""Which files a stage's result becomes, and how they are written."""

from __future__ import annotations

from pathlib import Path

from mapdeal.errors import one_line
from mapdeal.formats.map_writer import write_pair
from mapdeal.formats.maps import write_grid
from mapdeal.formats.npz import AnyGrid
from mapdeal.formats.png import write_indexed_png
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.large import LargeCosts, LargeField, LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.pipeline.stage_list import Step
from mapdeal.render.canvas import Image
from mapdeal.render.layers import cost_image, field_image, occupancy_image
from mapdeal.render.overlay import Overlay
from mapdeal.render.potential import potential_image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.stages.esdf import field_view
from mapdeal.stages.large import large_field_view

_NAMES = {
    "local": "local",
    "active": "active",
    "inflate": "inflated",
    "esdf": "esdf",
    "potential": "potential",
    "cost": "cost",
}


def product_name(stage: str) -> str:
    """Return what the files of a stage are called, without their endings."""
    return _NAMES.get(stage, stage)


def paths_of(step: Step, folder: Path, *, images: bool) -> list[Path]:
    """Return the files that a step of a run writes into `folder`, in the order of writing."""
    name = _NAMES[step.name]
    endings = [".npz"] if step.name in ("esdf", "potential", "cost") else []
    endings += [] if step.name == "potential" else [".pgm", ".yaml"]
    endings += [".png"] if images else []
    return [folder / f"{name}{ending}" for ending in endings]


def write_products(
    transaction: Transaction,
    step: Step,
    grid: AnyGrid,
    folder: Path,
    *,
    stem: str,
    images: bool = True,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> None:
    """Write all files of a step's result, those of `paths_of`."""
    base = folder / _NAMES[step.name]
    if step.name in ("esdf", "potential", "cost"):
        write_grid(transaction, base.with_suffix(".npz"), grid)
    pair = base.with_suffix(".yaml")
    if isinstance(grid, (DistanceField, LargeField)):
        write_pair(transaction, pair, view_of(grid, step), mode="raw")
    elif not isinstance(grid, PotentialField):
        write_pair(transaction, pair, grid)
    if images:
        title = one_line(f"{stem}: {title_of(step)}")
        path = base.with_suffix(".png")
        write_picture(transaction, path, grid, title, image_max=image_max, overlay=overlay)


def view_of(field: DistanceField | LargeField, step: Step) -> OccupancyGrid | LargeMap:
    """Return the 0..100 view that a step asks for."""
    if isinstance(field, LargeField):
        return large_field_view(field, **step.view)
    return field_view(field, **step.view)


def write_picture(
    transaction: Transaction,
    path: Path,
    grid: AnyGrid,
    title: str,
    *,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> None:
    """Write the picture of a grid; it is drawn in the thread that writes it."""

    def draw() -> Image:
        if isinstance(grid, (DistanceField, LargeField)):
            return field_image(grid, title=title, image_max=image_max, overlay=overlay)
        if isinstance(grid, (Costmap, LargeCosts)):
            return cost_image(grid, title=title, image_max=image_max, overlay=overlay)
        if isinstance(grid, PotentialField):
            return potential_image(grid, title=title, image_max=image_max)
        return occupancy_image(grid, title=title, image_max=image_max, overlay=overlay)

    def write(file: object) -> None:
        image = draw()
        write_indexed_png(file, image.indices, image.palette)  # type: ignore[arg-type]

    transaction.write(path, write)


def title_of(step: Step) -> str:
    """Return what a step has done, as a picture's title says it."""
    parameters = step.parameters
    if step.name == "local":
        return "local map"
    if step.name == "active":
        return "active region"
    if step.name == "inflate":
        footprint = parameters["footprint"]
        radius = footprint.circumscribed_radius if footprint else parameters["radius"]
        return f"inflated by {radius:.4g} m ({parameters['kernel']})"
    if step.name == "esdf":
        return "signed distance field"
    if step.name == "potential":
        return "potential field" if parameters["goal"] else "repulsive field"
    if step.model == "exponential":
        return (
            f"cost, inscribed {parameters['inscribed_radius']:.4g} m, "
            f"inflation {parameters['inflation_radius']:.4g} m, "
            f"factor {parameters['cost_scaling_factor']:.4g}"
        )
    if step.model == "rings":
        return f"cost, rings {', '.join(str(value) for value in parameters['values'])}"
    return f"cost, thresholds {parameters['down']:g} and {parameters['up']:g}, {parameters['view']}"
