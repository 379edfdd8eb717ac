"""Changes to a map or costmap, file to file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.formats.map_server import BIT_MAP
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.npz import Grid
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import MOST_CELLS
from mapdeal.pipeline.bits import OccupancyBits, edit_bits
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of, read_input
from mapdeal.pipeline.memory import claim_work
from mapdeal.pipeline.settings import Settings

_PER_CELL = 6.0
"""Bytes for each cell of the new grid: of a field 5, and a byte more while it is written."""

Editable = OccupancyGrid | Costmap
Drawable = Editable | OccupancyBits


def draw_on_file(
    path: Path,
    output: Path,
    options: Settings,
    change: Callable[[Drawable], Drawable],
    *,
    what: str,
    inputs: Sequence[Path] = (),
) -> Figures:
    """Do what `edit_file` does; a ``.pbm`` can also be written as one."""
    do: Callable[..., Figures] = edit_bits if output.suffix == BIT_MAP else edit_file
    return do(path, output, options, change, what=what, inputs=inputs)


def edit_file(
    path: Path,
    output: Path,
    options: Settings,
    change: Callable[[Editable], Editable],
    *,
    what: str,
    inputs: Sequence[Path] = (),
    cells: Callable[[Editable], int] | None = None,
) -> Figures:
    """Read a map or costmap, change it, and write it; return its figures.

    Costs that were read as costmap_2d's bytes are written as such; keys of the YAML that
    map_server does not know are kept.
    """

    def editable(grid: Grid) -> Editable:
        if not isinstance(grid, (OccupancyGrid, Costmap)):
            rule = "is a field, which cannot be edited"
            raise ParameterError(rule, hint="edit the map, then run esdf or potential on it")
        return grid

    def count(grid: Grid) -> int:
        with errors_named(path):
            given = editable(grid)
            return given.values.size if cells is None else cells(given)

    return change_file(
        path,
        output,
        options,
        lambda grid: change(editable(grid)),
        what=what,
        inputs=inputs,
        cells=None if cells is None else count,
    )


def change_file(
    path: Path,
    output: Path,
    options: Settings,
    change: Callable[[Grid], Grid],
    *,
    what: str,
    inputs: Sequence[Path] = (),
    cells: Callable[[Grid], int] | None = None,
) -> Figures:
    """Do what `edit_file` does, with fields, too; `cells` are those of the new grid."""
    outputs = output_paths(output)
    source = read_input(path, options)
    with options.memory():
        count = None if cells is None else cells(source.grid)
        height, width = source.grid.shape
        if count is None or count <= MOST_CELLS:  # more are refused by whoever makes them
            both = None if count is None else count + min(count, height * width)
            claim_work(path, source.grid, _PER_CELL, cells=both)  # what they share is cut out first
    with outputs_of(outputs, [*source.files, *inputs], options) as transaction:
        with errors_named(path):
            grid = change(source.grid)
        metadata = source.metadata
        as_bytes = metadata is not None and metadata.cost_scale is not None
        write_grid(
            transaction,
            output,
            grid,
            encoding="costmap2d" if as_bytes else "occupancy",
            extra=dict(metadata.extra) if metadata else {},
        )
        add_picture(transaction, options, grid, f"{path.stem}: {what}")
    return grid.figures()
