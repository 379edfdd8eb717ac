"""``mapdeal window``: a part of a map, or more than the map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.edit import change_file
from mapdeal.editing.window import window as window_of
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import region_of
from mapdeal.maps.npz import Grid
from mapdeal.pipeline.inputs import frame_of_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def window(
    source: opt.MapArgument,
    output: opt.GridOutput,
    size: str | None = None,
    at: opt.At = None,
    corner: opt.Corner = None,
    like: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP",
            help="Map with the same cells whose extent to use, instead of a size and a place.",
        ),
        FROM_STDIN,
    ] = None,
    default: int | None = None,
    *,
    settings: Settings,
) -> None:
    """Copy a part of a map, or an area larger than the map.

    Cells beyond the map are unknown; beyond a distance field there is no distance. The window lies
    along the map's own axes and begins with the cell that contains its lower left corner, so that
    cells keep their places.

    Options
    -------
    --size WX,WY: Extent along columns and rows, metres.
    --default V: Value of cells beyond the map.  [default: unknown: -1 for a map, 255 for costs]
    """
    region: dict[str, Any] = {}
    inputs: tuple[Path, ...] = ()
    if like is None:
        if size is None:
            raise ParameterError("one of the two is required", source="--size, --like")
        region = opt.region(size, at, corner)
    elif (size, at, corner) != (None, None, None):
        raise ParameterError(
            "cannot be given together with --size, --at, --corner", source="--like"
        )
    else:
        terminal.detail(f"region: the extent of {like}")
        region["frame"], inputs = frame_of_file(like, settings)

    def cells(grid: Grid) -> int:
        if "frame" in region:
            return int(region["frame"].height * region["frame"].width)
        return region_of(grid.frame, **region).cells

    figures = change_file(
        source,
        output,
        settings,
        lambda grid: window_of(grid, default=default, **region),
        what="window",
        inputs=inputs,
        cells=cells,
    )
    say_written(output, figures, with_origin=True)
