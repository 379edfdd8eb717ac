"""``mapdeal edit``: shapes drawn into a map or costmap, and regions reset."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options, with_shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import TO_STDOUT
from mapdeal.commands.edit import Drawable, draw_on_file
from mapdeal.editing.draw import draw
from mapdeal.editing.window import blank as blank_of
from mapdeal.editing.window import reset_region
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Point
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import OverlayType
from mapdeal.maps.shapes import read_shapes
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)

Output = Annotated[
    Path,
    opt.output_argument(
        "OUT",
        "The result: .yaml or .pgm (a pgm pair), .png (a pair), .npz, or of a .pbm also .pbm. "
        + opt.OR_STDOUT,
    ),
    TO_STDOUT,
]
Points = Annotated[
    list[str] | None, typer.Option("--point", metavar="X,Y", help="Point, metres; more may follow.")
]
Value = Annotated[
    int | None,
    typer.Option(
        metavar="V",
        help="Value to draw, on the map's own scale: -1..100, or 0..255 for costmap_2d's "
        "costs, or 0 or 100 for a .pbm.",
    ),
]
File = Annotated[
    Path | None,
    typer.Option(
        metavar="SHAPES",
        help="Draw all shapes of a YAML or GeoJSON file, whatever their kind, in order.",
    ),
]
OverlayOption = Annotated[
    OverlayType,
    typer.Option(
        help="Which value wins in a cell: the later (seq), the larger (max) or the smaller one "
        "(min). Any value replaces unknown."
    ),
]
Blank = Annotated[bool, typer.Option("--blank", help="Start from 0 everywhere, to draw a mask.")]
Background = Annotated[
    int | None,
    typer.Option(
        metavar="V",
        help="With --blank: start from V instead, such as -1 (unknown) for a mask without "
        "effect outside its shapes.",
    ),
]


@app.callback()
def edit() -> None:
    """Draw into a map or costmap, or reset a part of it.

    Points are in metres in the map frame; the yaw of the map is honoured.
    """


def _drawing(shapes_of: Callable[..., list[Shape]]) -> None:
    """Add a command that draws the shapes which a function makes of its own options."""

    def command(
        *,
        source: opt.MapArgument,
        output: Output,
        file: File = None,
        value: Value = None,
        overlay: OverlayOption = "seq",
        blank: Blank = False,
        background: Background = None,
        settings: Settings,
        **own: Any,
    ) -> None:
        shapes = shapes_of(**own)
        if not shapes and file is None:
            raise ParameterError("one of the two is required", source="--point, --file")
        shapes = [*([] if file is None else read_shapes(file)), *shapes]
        start = _start(blank, background)
        for shape in shapes:
            number = shape.value if shape.value is not None else value
            name = ": ".join(part for part in (shape.source, shape.kind) if part)
            if number is None:
                hint = f"{name} has no value of its own" if shape.source else None
                raise ParameterError("is needed to draw with", source="--value", hint=hint)
            terminal.detail(f"{name}: value {number}")

        def change(grid: Drawable) -> Drawable:
            return draw(start(grid), shapes, value=value, overlay=overlay)

        what = f"{', '.join(dict.fromkeys(shape.kind for shape in shapes))} drawn"
        inputs = [] if file is None else [file]
        figures = draw_on_file(source, output, settings, change, what=what, inputs=inputs)
        say_written(output, figures)

    command.__name__, command.__doc__ = shapes_of.__name__, shapes_of.__doc__
    source, output, *others = signature(command, eval_str=True).parameters.values()
    own = signature(shapes_of, eval_str=True).parameters.values()
    parameters = [source, output, *own, *others[:-2]]
    app.command()(with_shared_options(command, parameters, ["files"]))


@_drawing
def polygon(point: Points = None) -> list[Shape]:
    """Draw a filled polygon, or the shapes of a file.

    A convex polygon gets the cells that costmap_2d's setConvexPolygonCost sets.
    """
    return [Polygon(_points(point))] if point else []


@_drawing
def line(
    point: Points = None,
    thickness: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Thickness of the line, metres; up to the side of a cell the line is one cell "
            "wide.  [default: one cell]",
        ),
    ] = None,
) -> list[Shape]:
    """Draw a line through points, or the shapes of a file."""
    _refuse_without_points("--thickness", thickness, point)
    return [Line(_points(point), thickness or 0.0)] if point else []


@_drawing
def circle(
    point: Points = None,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Radius of the circle around each point, metres; 0 for its cell alone.",
        ),
    ] = None,
) -> list[Shape]:
    """Draw filled circles around points, or the shapes of a file."""
    _refuse_without_points("--radius", radius, point)
    if point and radius is None:
        raise ParameterError("is needed for a circle", source="--radius")
    return [Circle(center, radius or 0.0) for center in _points(point)]


@app.command()
@shared_options("files")
def reset(
    source: opt.MapArgument,
    output: Output,
    size: opt.Size,
    at: opt.At = None,
    corner: opt.Corner = None,
    value: int | None = None,
    blank: Blank = False,
    background: Background = None,
    *,
    settings: Settings,
) -> None:
    """Set all cells of a rectangle along the map's axes to one value.

    Options
    -------
    --value V: Value of the cells.  [default: unknown: -1 for a map, 255 for costs]
    """
    region = opt.region(size, at, corner)
    start = _start(blank, background)

    def change(grid: Drawable) -> Drawable:
        return reset_region(start(grid), value=value, **region)

    say_written(output, draw_on_file(source, output, settings, change, what="region reset"))


def _points(texts: list[str] | None) -> list[Point]:
    return [opt.pair(text, "--point") for text in texts or ()]


def _refuse_without_points(name: str, given: float | None, points: list[str] | None) -> None:
    if given is not None and not points:
        rule = "needs --point: the shapes of a file have their own"
        raise ParameterError(rule, source=name)


def _start(blank: bool, background: int | None) -> Callable[[Drawable], Drawable]:
    if background is not None and not blank:
        raise ParameterError("needs --blank", source="--background")
    if not blank:
        return lambda grid: grid
    return lambda grid: blank_of(grid, background or 0)
