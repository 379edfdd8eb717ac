"""``mapdeal edit``: shapes drawn into a map or costmap, and regions reset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.stage_command import file_options, say_written
from mapdeal.editing.draw import draw
from mapdeal.editing.window import blank as blank_of
from mapdeal.editing.window import reset_region
from mapdeal.errors import ParameterError
from mapdeal.formats.shapes import read_shapes
from mapdeal.grid.outline import Point
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.pipeline.edit import Editable, edit_file
from mapdeal.pipeline.files import FileOptions

app = typer.Typer(rich_markup_mode=None, add_completion=False)

Output = Annotated[Path, opt.output_argument("OUT", "The result: .yaml (with .pgm) or .npz.")]
Points = Annotated[
    list[str] | None,
    typer.Option("--point", metavar="X,Y", help="A point, metres; repeat it for each."),
]
Value = Annotated[
    int | None,
    typer.Option(
        metavar="V",
        help="What to draw with, on the map's own scale: -1..100, of costmap_2d's costs 0..255.",
    ),
]
File = Annotated[
    Path | None,
    typer.Option(
        metavar="SHAPES", help="Draw the shapes of a YAML or GeoJSON file, of whatever kind."
    ),
]
Blank = Annotated[bool, typer.Option("--blank", help="Start from 0 everywhere, to draw a mask.")]
Background = Annotated[
    int | None,
    typer.Option(
        metavar="V",
        help="With --blank: start from V instead, such as -1, unknown, for a mask that says "
        "nothing outside of its shapes.",
    ),
]
Strict = Annotated[
    bool,
    typer.Option("--strict", help="Draw nothing, exit code 1, if anything has to be clipped."),
]


@app.callback()
def edit() -> None:
    """Draw into a map or costmap, or reset a part of it.

    Points are in metres in the map frame; the yaw of the map is honoured.
    """


@app.command()
def polygon(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    file: File = None,
    value: Value = None,
    blank: Blank = False,
    background: Background = None,
    strict: Strict = False,
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Draw a filled polygon, or the shapes of a file.

    A convex polygon gets the cells that costmap_2d's setConvexPolygonCost sets.
    """
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(dialect, max_cells, force, threads, image)

    def shapes(points: list[Point]) -> list[Shape]:
        return [Polygon(points)]

    start = _start(blank, background)
    _draw(source, output, files, shapes, point, file, value, start, strict=strict)


@app.command()
def line(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    thickness: Annotated[
        float,
        typer.Option(metavar="M", help="Thickness; 0 for a line of single cells."),
    ] = 0.0,
    file: File = None,
    value: Value = None,
    blank: Blank = False,
    background: Background = None,
    strict: Strict = False,
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Draw a line through points, or the shapes of a file."""
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(dialect, max_cells, force, threads, image)

    def shapes(points: list[Point]) -> list[Shape]:
        return [Line(points, thickness)]

    start = _start(blank, background)
    _draw(source, output, files, shapes, point, file, value, start, strict=strict)


@app.command()
def circle(
    source: opt.MapArgument,
    output: Output,
    point: Points = None,
    radius: Annotated[
        float | None, typer.Option(metavar="M", help="Radius of the circle around each point.")
    ] = None,
    file: File = None,
    value: Value = None,
    blank: Blank = False,
    background: Background = None,
    strict: Strict = False,
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Draw filled circles around points, or the shapes of a file."""
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(dialect, max_cells, force, threads, image)

    def shapes(points: list[Point]) -> list[Shape]:
        if radius is None:
            raise ParameterError("is needed for a circle", source="--radius")
        return [Circle(center, radius) for center in points]

    start = _start(blank, background)
    _draw(source, output, files, shapes, point, file, value, start, strict=strict)


@app.command()
def reset(
    source: opt.MapArgument,
    output: Output,
    size: opt.Size,
    at: opt.At = None,
    corner: opt.Corner = None,
    value: Annotated[
        int | None,
        typer.Option(
            metavar="V",
            help="What the cells become.  [default: unknown, -1 of a map, 255 of costs]",
        ),
    ] = None,
    blank: Blank = False,
    background: Background = None,
    strict: Strict = False,
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Give a rectangle along the map's axes one value."""
    opt.start(quiet=quiet, verbose=verbose)
    region = opt.region(size, at, corner)
    files = file_options(dialect, max_cells, force, threads, image)

    start = _start(blank, background)

    def change(grid: Editable) -> Editable:
        return reset_region(start(grid), value=value, strict=strict, **region)

    say_written(output, edit_file(source, output, files, change, what="region reset"))


def _draw(
    source: Path,
    output: Path,
    files: FileOptions,
    shapes_at: Callable[[list[Point]], list[Shape]],
    points: list[str] | None,
    file: Path | None,
    value: int | None,
    start: Callable[[Editable], Editable],
    *,
    strict: bool,
) -> None:
    """Draw the shapes of a file, if there is one, and over them the one of the points."""
    if not points and file is None:
        raise ParameterError("one of the two is needed", source="--point, --file")
    shapes = [] if file is None else read_shapes(file)
    if points:
        shapes += shapes_at([opt.pair(text, "--point") for text in points])
    if value is None and any(shape.value is None for shape in shapes):
        hint = "some shapes of the file have no value of their own" if file else None
        raise ParameterError("is needed to draw with", source="--value", hint=hint)

    def change(grid: Editable) -> Editable:
        return draw(start(grid), shapes, value=value, strict=strict)

    for index, shape in enumerate(shapes):
        number = shape.value if shape.value is not None else value
        terminal.detail(f"shape {index + 1}: {shape.kind}, value {number}")
    kinds = dict.fromkeys(shape.kind for shape in shapes)
    what = f"{', '.join(kinds)} drawn"
    say_written(output, edit_file(source, output, files, change, what=what))


def _start(blank: bool, background: int | None) -> Callable[[Editable], Editable]:
    """Return what makes of a map the grid that is drawn on."""
    if background is not None and not blank:
        raise ParameterError("needs --blank", source="--background")
    if not blank:
        return lambda grid: grid
    return lambda grid: blank_of(grid, background or 0)
