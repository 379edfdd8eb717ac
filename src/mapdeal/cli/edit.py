"""``mapdeal edit``: shapes drawn into a map or costmap, and regions reset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import TO_STDOUT
from mapdeal.editing.draw import draw
from mapdeal.editing.window import blank as blank_of
from mapdeal.editing.window import reset_region
from mapdeal.errors import ParameterError
from mapdeal.formats.shapes import read_shapes
from mapdeal.grid.frame import Point
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import OverlayType
from mapdeal.pipeline.edit import Drawable, draw_on_file
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass

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


@app.command()
@shared_options("files")
def polygon(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    file: File = None,
    value: Value = None,
    overlay: OverlayOption = "seq",
    blank: Blank = False,
    background: Background = None,
    *,
    settings: Settings,
) -> None:
    """Draw a filled polygon, or the shapes of a file.

    A convex polygon gets the cells that costmap_2d's setConvexPolygonCost sets.
    """
    own: list[Shape] = [Polygon(_points(point))] if point else []
    drawing = _Drawing(_gathered(file, own), value, overlay)
    _draw(source, output, settings, drawing, _start(blank, background), file)


@app.command()
@shared_options("files")
def line(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    thickness: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Thickness of the line, metres; up to the side of a cell the line is one cell "
            "wide.  [default: one cell]",
        ),
    ] = None,
    file: File = None,
    value: Value = None,
    overlay: OverlayOption = "seq",
    blank: Blank = False,
    background: Background = None,
    *,
    settings: Settings,
) -> None:
    """Draw a line through points, or the shapes of a file."""
    _refuse_without_points("--thickness", thickness, point)
    own: list[Shape] = [Line(_points(point), thickness or 0.0)] if point else []
    drawing = _Drawing(_gathered(file, own), value, overlay)
    _draw(source, output, settings, drawing, _start(blank, background), file)


@app.command()
@shared_options("files")
def circle(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Radius of the circle around each point, metres; 0 for its cell alone.",
        ),
    ] = None,
    file: File = None,
    value: Value = None,
    overlay: OverlayOption = "seq",
    blank: Blank = False,
    background: Background = None,
    *,
    settings: Settings,
) -> None:
    """Draw filled circles around points, or the shapes of a file."""
    _refuse_without_points("--radius", radius, point)
    if point and radius is None:
        raise ParameterError("is needed for a circle", source="--radius")
    own: list[Shape] = [Circle(center, radius or 0.0) for center in _points(point)]
    drawing = _Drawing(_gathered(file, own), value, overlay)
    _draw(source, output, settings, drawing, _start(blank, background), file)


@app.command()
@shared_options("files")
def reset(
    source: opt.MapArgument,
    output: Output,
    size: opt.Size,
    at: opt.At = None,
    corner: opt.Corner = None,
    value: Annotated[
        int | None,
        typer.Option(
            metavar="V", help="Value of the cells.  [default: unknown: -1 for a map, 255 for costs]"
        ),
    ] = None,
    blank: Blank = False,
    background: Background = None,
    *,
    settings: Settings,
) -> None:
    """Set all cells of a rectangle along the map's axes to one value."""
    region = opt.region(size, at, corner)

    start = _start(blank, background)

    def change(grid: Drawable) -> Drawable:
        return reset_region(start(grid), value=value, **region)

    say_written(output, draw_on_file(source, output, settings, change, what="region reset"))


@dataclass(frozen=True)
class _Drawing:
    """What is to be drawn, and how."""

    shapes: list[Shape]
    value: int | None
    overlay: OverlayType


def _points(texts: list[str] | None) -> list[Point]:
    return [opt.pair(text, "--point") for text in texts or ()]


def _refuse_without_points(name: str, given: float | None, points: list[str] | None) -> None:
    if given is not None and not points:
        rule = "needs --point: the shapes of a file have their own"
        raise ParameterError(rule, source=name)


def _gathered(file: Path | None, own: list[Shape]) -> list[Shape]:
    """Return the shapes of a file, if there is one, and over them those of the points."""
    if not own and file is None:
        raise ParameterError("one of the two is required", source="--point, --file")
    return [*([] if file is None else read_shapes(file)), *own]


def _draw(
    source: Path,
    output: Path,
    settings: Settings,
    drawing: _Drawing,
    start: Callable[[Drawable], Drawable],
    file: Path | None,
) -> None:
    for shape in drawing.shapes:
        number = shape.value if shape.value is not None else drawing.value
        name = ": ".join(part for part in (shape.source, shape.kind) if part)
        if number is None:
            hint = f"{name} has no value of its own" if shape.source else None
            raise ParameterError("is needed to draw with", source="--value", hint=hint)
        terminal.detail(f"{name}: value {number}")

    def change(grid: Drawable) -> Drawable:
        return draw(start(grid), drawing.shapes, value=drawing.value, overlay=drawing.overlay)

    kinds = dict.fromkeys(shape.kind for shape in drawing.shapes)
    what = f"{', '.join(kinds)} drawn"
    inputs = [] if file is None else [file]
    say_written(output, draw_on_file(source, output, settings, change, what=what, inputs=inputs))


def _start(blank: bool, background: int | None) -> Callable[[Drawable], Drawable]:
    if background is not None and not blank:
        raise ParameterError("needs --blank", source="--background")
    if not blank:
        return lambda grid: grid
    return lambda grid: blank_of(grid, background or 0)
