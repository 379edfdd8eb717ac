"""A grid from one format or scale to another, file to file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from mapdeal.errors import ParameterError
from mapdeal.formats.map_writer import in_trinary
from mapdeal.formats.map_yaml import Mode
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.npz import Grid
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.field_view import FieldView
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of, read_input
from mapdeal.pipeline.memory import claim_work
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.esdf import field_view

Scale = Literal["occupancy", "costmap2d", "amcl"]


def convert_file(
    path: Path,
    output: Path,
    options: Settings,
    *,
    encoding: Scale | None = None,
    mode: Mode | None = None,
    static_layer: Mapping[str, Any] | None = None,
) -> Figures:
    """Read a grid and write it in another format; return its figures.

    Parameters
    ----------
    path, output : Path
        The files.
    options : Settings
        How they are read and written.
    encoding : {'occupancy', 'costmap2d', 'amcl'}, optional
        The scale to convert values to. If none is given, an npz keeps the scale of its source,
        and the pixels of costs hold what ROS would publish.
    mode : {'trinary', 'scale', 'raw'}, optional
        How values become pixels.
    static_layer : mapping, optional
        Parameters of `mapdeal.Costmap.from_static_layer`, which then turns a map into costs.
    """
    outputs = output_paths(output)
    if static_layer is not None and encoding != "costmap2d":
        raise ParameterError("needs --encoding costmap2d", place="--static-layer")
    source = read_input(path, options)
    with options.memory():
        claim_work(path, source.grid, _per_cell(source.grid, mode, drawn=options.image is not None))
    with outputs_of(outputs, source.files, options) as transaction:
        with errors_named(path):
            grid = _converted(source.grid, encoding, static_layer)
        if isinstance(grid, DistanceField) and output.suffix != ".npz":
            grid, mode = field_view(grid), mode or "raw"
        if isinstance(grid, FieldView) and mode not in (None, "raw"):
            grid = grid.as_map()
        if isinstance(grid, OccupancyGrid) and mode == "trinary":
            grid = in_trinary(grid)
        extra = dict(source.metadata.extra) if source.metadata else {}
        pixels: Literal["occupancy", "costmap2d"] = (
            "costmap2d" if encoding == "costmap2d" else "occupancy"
        )
        more = None
        if encoding == "amcl" and isinstance(grid, OccupancyGrid):
            more = {"amcl": grid.amcl_states()}
        write_grid(transaction, output, grid, mode=mode, encoding=pixels, extra=extra, more=more)
        add_picture(transaction, options, grid, path.stem)
    return grid.figures()


def _per_cell(grid: Grid, mode: Mode | None, *, drawn: bool) -> float:
    """Return the bytes for each cell that writing takes besides the grid."""
    if isinstance(grid, PotentialField):  # most of its layers are made when they are written
        return 130.0 if drawn else 76.0
    return 12.0 if mode == "scale" else 5.0


def _converted(
    grid: Grid, encoding: Scale | None, static_layer: Mapping[str, Any] | None
) -> Grid:  # fmt: skip
    """Return the grid with its values on another scale."""
    if encoding is None or (encoding == "occupancy" and not isinstance(grid, Costmap)):
        return grid
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        rule = f"a field has no values of {encoding}"
        raise ParameterError(rule, place="encoding", hint="mapdeal cost makes costs of a map")
    if encoding == "amcl":
        occupancy = grid.to_occupancy() if isinstance(grid, Costmap) else grid
        return occupancy.as_amcl_sees_it()
    if encoding == "occupancy":
        return _published(grid)
    if isinstance(grid, Costmap) and grid.scale == "costmap2d":
        if static_layer is not None:
            rule = "reads maps, and these are costs on its own scale already"
            raise ParameterError(rule, place="--static-layer")
        return grid
    occupancy = grid.to_occupancy() if isinstance(grid, Costmap) else grid
    if static_layer is not None:
        return Costmap.from_static_layer(occupancy, **static_layer)
    return Costmap.from_occupancy(occupancy)


def _published(grid: Grid) -> Grid:
    """Return costs as ROS would publish them; they stay costs."""
    if not isinstance(grid, Costmap) or grid.scale == "occupancy":
        return grid
    published = grid.to_occupancy()
    return Costmap(published.occupancy, grid.resolution, grid.origin, "occupancy")
