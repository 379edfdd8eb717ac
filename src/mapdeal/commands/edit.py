"""Grids in files, changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mapdeal.commands.pack import OccupancyBits, edit_bits
from mapdeal.editing.resampling import (
    cells_when_turned,
    rescale,
    rescaled_frame,
    rotate,
    turn_of,
    yaw_to_straighten,
)
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.source import BIT_MAP
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import MOST_CELLS, Transform, check_resolution
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import ResamplingRule
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pipeline.inputs import add_picture, claim_work, errors_named, outputs_of, read_input
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
    """Read a map or costmap, change it, and write it; return its figures."""
    # Costs that were read as costmap_2d's bytes are written as such; keys of the YAML that
    # map_server does not know are kept.

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


_TO_STRAIGHTEN = 6.0
"""Bytes for each cell while directions of walls are searched for: masks, and the edges of walls."""


def rotate_file(
    path: Path,
    output: Path,
    options: Settings,
    yaw: float | None,
    *,
    rule: ResamplingRule = "area",
    inputs: Sequence[Path] = (),
) -> tuple[Figures, Transform | None]:
    """Turn a map or costmap as `rotate` does; return its figures, and how points turn with it."""
    turn = None if yaw is None else turn_of(yaw)

    def cells(grid: Editable) -> int:
        nonlocal turn
        if turn is None:
            claim_work(path, grid, _TO_STRAIGHTEN)
            angle = yaw_to_straighten(grid)
            if angle is None:
                emit_warning(f"{path}: no direction of walls stands out, the map is not turned")
                return grid.shape[0] * grid.shape[1]
            turn = turn_of(angle)
        return cells_when_turned(grid.frame, turn.yaw)

    def change(grid: Editable) -> Editable:
        return grid if turn is None else rotate(grid, turn.yaw, rule=rule)

    figures = edit_file(path, output, options, change, what="turned", inputs=inputs, cells=cells)
    return figures, turn


def rescale_file(
    path: Path,
    output: Path,
    options: Settings,
    resolution: float,
    *,
    rule: ResamplingRule = "area",
    inputs: Sequence[Path] = (),
) -> Figures:
    """Bring a map or costmap to another resolution, as `rescale` does; return its figures."""
    check_resolution(resolution)

    def cells(grid: Editable) -> int:
        frame = rescaled_frame(grid.frame, resolution)
        return max(frame.height * frame.width, grid.shape[0] * grid.shape[1])

    return edit_file(
        path,
        output,
        options,
        lambda grid: rescale(grid, resolution, rule=rule),
        what=f"at {resolution:g} m",
        inputs=inputs,
        cells=cells,
    )
