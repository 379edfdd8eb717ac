"""``mapdeal rotate``: a map turned in its frame, on a lattice without yaw."""

from __future__ import annotations

import math

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.edit import rotate_file
from mapdeal.errors import ParameterError
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def rotate(
    source: opt.MapArgument,
    output: opt.GridOutput,
    yaw: float | None = None,
    straighten: bool = False,
    rule: opt.Rule = "area",
    *,
    settings: Settings,
) -> None:
    """Rotate a map or costmap, and bake the yaw of its origin into the cells.

    The result has yaw 0 and covers the whole rotated map; cells outside it are unknown. With --yaw
    0 all walls stay where they are in the map frame. Otherwise poses change as well, by the
    transform that is printed. Quarter turns copy the cells unchanged.

    Options
    -------
    --yaw A: Rotation, radians, anticlockwise about the origin of the map frame; 0 only bakes the
        yaw of the map's origin into the cells.
    --straighten: Or rotate by the smallest angle that aligns the main direction of the walls with
        the axes.
    """
    if straighten and yaw is not None:
        raise ParameterError("cannot be given together with --straighten", source="--yaw")
    if not straighten and yaw is None:
        raise ParameterError("one of the two is required", source="--yaw, --straighten")
    terminal.detail(
        f"rotate: {'straighten' if yaw is None else f'yaw {yaw:.10g} rad'}, rule {rule}"
    )
    figures, turn = rotate_file(source, output, settings, yaw, rule=rule)
    say_written(output, figures, with_origin=True)
    if turn is not None:
        degrees = f"{math.degrees(turn.yaw):.6g} degrees"
        terminal.summary([f"turned by {turn.yaw:.10g} rad ({degrees}) about x 0, y 0"])
