"""Draw into a map or costmap, or reset a part of it.

Points are in metres in the map frame; the yaw of the map is honoured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from mapdeal import errors, records
from mapdeal.command import METRES, VALUE, Output, Words, command
from mapdeal.commands.pack import GridResult, read_bits
from mapdeal.files.source import BIT_MAP
from mapdeal.grid import costmap, occupancy
from mapdeal.grid.bit_map import BitMap, blank as blank_of, draw, reset_region
from mapdeal.grid.frame import Point
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import FREE, OCCUPIED, OverlayType
from mapdeal.maps import map_server, reading
from mapdeal.maps.shapes import read_shapes
from mapdeal.pipeline import inputs
from mapdeal.pipeline.inputs import InShell, Work, numbers_of, refuse

_PER_CELL = 6.0  # bytes: 5 for each cell of costs, and one more while they are written
_FOR_POINTS = "needs --point: the shapes of a file have their own"

Source = Annotated[Path, Words("MAP", streams=True)]
Points = Annotated[
    Sequence[Point],
    Words("X,Y", lambda texts: [numbers_of(text, "X,Y") for text in texts], is_repeated=True),
]
Pair = partial(Words, read=lambda text: numbers_of(text, "X,Y"))


@records.dataclass(frozen=True, eq=False)
class _OccupancyBits(BitMap):
    """A bit map to draw on with the values of a map: 0 free, 100 occupied."""

    def accept_value(self, value: float, name: str = "value") -> int:
        if value not in (FREE, OCCUPIED):
            rule = f"must be {FREE} or {OCCUPIED}: cells of a bit map are free or occupied"
            hint = "write to a .yaml or .npz for other values"
            raise errors.ParameterError(rule, place=name, got=value, hint=hint)
        return int(value)


_edits = partial(command, group="Changing a map", output=Output(
    "OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), .npz, or of a .pbm also .pbm.",
    paths=lambda path: (map_server.bit_map_paths(path) if path.suffix == BIT_MAP
                        else reading.output_paths(path, (BIT_MAP,))),
))  # fmt: skip


def _edited(
    source: Path, change: Callable[[Any], Any], title: str, work: Work, also: Sequence[Path] = ()
) -> GridResult:
    encoding: map_server.Encoding = "occupancy"
    if any(path.suffix == BIT_MAP for path in work.outputs):
        if source.suffix.lower() != BIT_MAP:
            rule, hint = "only an edited .pbm can be written as one", "mapdeal pack makes a bit map"
            raise errors.ParameterError(rule, source=work.outputs[0], hint=f"{hint} of a map")
        bits, extra = read_bits(source, work, also=also)
        grid: Any = _OccupancyBits(bits.packed, bits.width, bits.resolution, bits.origin)
    else:
        (read,) = inputs.open_inputs(source, names=("map",), also=also)
        inputs.claim_cells(read, _PER_CELL)
        grid, extra = read.grid, {}
        if read.metadata is not None:
            extra = read.metadata.extra
            encoding = "occupancy" if read.metadata.cost_scale is None else "costmap2d"
    with inputs.errors_named(source):
        if not isinstance(grid, occupancy.OccupancyGrid | costmap.Costmap | BitMap):
            rule = "is a field, which cannot be edited"
            raise errors.ParameterError(rule, hint="edit the map, then run esdf or potential on it")
        return GridResult(change(grid), f"{source.stem}: {title}", extra, encoding)


def _start(blank: bool, background: int | None) -> Callable[[Any], Any]:
    if background is not None and not blank:
        raise errors.ParameterError("needs --blank", place="background")
    return (lambda grid: blank_of(grid, background or 0)) if blank else lambda grid: grid


def _drawn(
    source: Path, shapes: Sequence[Shape], *, work: InShell,
    file: Annotated[Path | None, Words("SHAPES")] = None,
    value: Annotated[int, VALUE] | None = None, overlay: OverlayType = "seq", blank: bool = False,
    background: Annotated[int, VALUE] | None = None,
) -> GridResult:  # fmt: skip
    """Draw the shapes of a file, then others.

    Parameters
    ----------
    source : path
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal.
    file : path, optional
        Draw all shapes of a YAML or GeoJSON file, whatever their kind, in order.
    value : int, optional
        Value to draw, on the map's own scale: -1..100, 0..255 for costs, or 0 or 100 for a .pbm.
    overlay : {'seq', 'max', 'min'}
        Which value wins in a cell: the later, the larger or the smaller; any replaces unknown.
    blank : bool
        Start from 0 everywhere, to draw a mask.
    background : int, optional
        With --blank: start from V instead; -1 (unknown) has no effect outside the shapes of a mask.
    """
    if not shapes and file is None:
        raise errors.ParameterError("one of the two is required", place="point, file")
    shapes = [*([] if file is None else read_shapes(file)), *shapes]
    start = _start(blank, background)
    for shape in shapes:
        number = value if shape.value is None else shape.value
        name = f"{shape.source}: {shape.kind}" if shape.source else shape.kind
        if number is None:
            hint = f"{name} has no value of its own" if shape.source else None
            raise errors.ParameterError("is needed to draw with", place="value", hint=hint)
        work.terminal.detail(f"{name}: value {number}")
    return _edited(source, lambda grid: draw(start(grid), shapes, value=value, overlay=overlay),
                   f"{', '.join(dict.fromkeys(shape.kind for shape in shapes))} drawn", work,
                   also=[] if file is None else [file])  # fmt: skip


@_edits(
    name="edit polygon",
    example="""\
mapdeal edit polygon examples/maps/office.yaml -o out/shelf.yaml \\
    --point 9,-5 10.2,-5 10.2,-3 9,-3 --value 100
mapdeal edit polygon examples/maps/office.yaml -o out/mask.yaml --blank \\
    --file examples/shapes/office_zones.yaml""",
    also={"": _drawn},
)
def polygon(source: Source, *, point: Points = (), **drawing: Any) -> GridResult:
    """Draw a filled polygon, or the shapes of a file.

    A convex polygon gets the cells that costmap_2d's setConvexPolygonCost sets.

    Parameters
    ----------
    point : list of points
        Point, metres; more may follow.
    """
    return _drawn(source, [Polygon(point)] if point else [], **drawing)


@_edits(
    name="edit line",
    example="""\
mapdeal edit line examples/maps/office.yaml -o out/door.yaml \\
    --point -7.0,1.4 -5.9,1.4 --thickness 0.1 --value 100""",
    also={"": _drawn},
)
def line(
    source: Source, *, point: Points = (), thickness: Annotated[float, METRES] | None = None,
    **drawing: Any,
) -> GridResult:  # fmt: skip
    """Draw a line through points, or the shapes of a file.

    Parameters
    ----------
    point : list of points
        Point, metres; more may follow.
    thickness : float, optional
        Thickness of the line, metres; up to the side of a cell it is one cell. [default: one cell]
    """
    if not point:
        refuse(_FOR_POINTS, thickness=thickness)
    return _drawn(source, [Line(point, thickness or 0.0)] if point else [], **drawing)


@_edits(
    name="edit circle",
    example="""\
mapdeal edit circle examples/maps/office.yaml -o out/ghost.yaml \\
    --point 5.0,0.3 --radius 0.5 --value 0""",
    also={"": _drawn},
)
def circle(
    source: Source, *, point: Points = (), radius: Annotated[float, METRES] | None = None,
    **drawing: Any,
) -> GridResult:  # fmt: skip
    """Draw filled circles around points, or the shapes of a file.

    Parameters
    ----------
    point : list of points
        Point, metres; more may follow.
    radius : float, optional
        Radius of the circle around each point, metres; 0 for its cell alone.
    """
    if not point:
        refuse(_FOR_POINTS, radius=radius)
    elif radius is None:
        raise errors.ParameterError("is needed for a circle", place="radius")
    return _drawn(source, [Circle(center, radius or 0.0) for center in point], **drawing)


@_edits(
    name="edit reset",
    example="""\
mapdeal edit reset examples/maps/office.yaml -o out/forgotten.yaml \\
    --corner -9.4,-5.7 --size 3.9,4.8""",
)
def reset(
    source: Source, *, work: InShell, size: Annotated[Point, Pair("WX,WY")],
    at: Annotated[Point | None, Pair("X,Y")] = None,
    corner: Annotated[Point | None, Pair("X,Y")] = None, value: Annotated[int, VALUE] | None = None,
    blank: bool = False, background: Annotated[int, VALUE] | None = None,
) -> GridResult:  # fmt: skip
    """Set all cells of a rectangle along the map's axes to one value.

    Parameters
    ----------
    source : path
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal.
    size : tuple of float
        Extent along columns and rows, metres.
    at : tuple of float, optional
        Centre of the rectangle, map frame, metres.
    corner : tuple of float, optional
        Or the corner at its first cell, map frame, metres: the lower left one of a map without yaw.
    value : int, optional
        Value of the cells. [default: unknown: -1 for a map, 255 for costs]
    blank : bool
        Start from 0 everywhere, to draw a mask.
    background : int, optional
        With --blank: start from V instead, such as -1 (unknown) for a mask without effect outside.
    """
    start = _start(blank, background)
    if (at is None) == (corner is None):
        rule = "one of the two is required" if at is None else "cannot be given together"
        raise errors.ParameterError(rule, place="at, corner")

    change = partial(reset_region, size_xy=size, center_xy=at, corner_xy=corner, value=value)
    return _edited(source, lambda grid: change(start(grid)), "region reset", work)
