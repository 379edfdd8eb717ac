"""What `convert` makes of a map for other programs: polygons, drawings, and worlds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from mapdeal.command import AT_LEAST_0, METRES, Condition, Result, Words
from mapdeal.commands.reach import start_of
from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.files.transaction import Transaction
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, count_text, decimal_text
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.outlines import MOST_TOLERANCE, corner_count
from mapdeal.kernels.solids import rectangles, run_count, surface
from mapdeal.maps import outlines
from mapdeal.maps.reading import Source, as_occupancy
from mapdeal.maps.world import WORLD_ENDINGS, mesh_of, obj_parts, sdf_parts, stl_parts
from mapdeal.pipeline.inputs import claim_work
from mapdeal.stages.reach import reach

AREA_ENDINGS = (".geojson", ".svg")
SHAPE_ENDINGS = (*AREA_ENDINGS, *WORLD_ENDINGS)

_PER_CELL, _PER_CORNER, _PER_RUN = 16.0, 240, 1500
"""Bytes of labels and masks for each cell; of points and lists for each corner, or run of walls."""

_REACH_PER_CELL = 40.0
_MANY_BOXES = 3000
_HEIGHT = Condition("between 0.001 and 10000", lambda value: 0.001 <= value <= 10_000)
_CELLS = {"free": "free", "obstacles": "occupied", "known": "known", "reachable": "reachable"}


@dataclass(frozen=True, repr=False)
class Shapes(Result):
    """What was written for another program, in words and in numbers."""

    output: Path
    figures: dict[str, Any]
    text: str

    def document(self) -> dict[str, Any]:
        return {"file": str(self.output), **self.figures}

    def lines(self) -> Iterator[str]:
        yield f"{self.output}: {self.text}"


def convert_area(
    source: Path, read: Source, output: Path, transaction: Transaction, *,
    of: outlines.Area | None = None,
    tolerance: Annotated[float, AT_LEAST_0, METRES] | None = None,
    unit: outlines.DrawingUnit = "mm",
    start: Annotated[tuple[float, ...] | None, Words("X,Y[,YAW]", start_of, "from")] = None,
    footprint: Footprint | None = None,
) -> Shapes:  # fmt: skip
    """Write the outlines of areas of a map.

    Parameters
    ----------
    source, read : path, Source
        The map, and its file.
    output : path
        File to write, .geojson or .svg.
    transaction : Transaction
        What writes it.
    of : {'free', 'obstacles'}, optional
        Areas to outline: free space or obstacles; with a robot's shape or --from, free space is
        what the robot's centre can reach. [default: free; a drawing has both]
    tolerance : float, optional
        Distance by which outlines may be moved to have fewer corners, up to half a cell; 0 for
        those of the cells. [default: half a cell]
    unit : {'mm', 'm'}
        Unit of coordinates in a drawing, which is to scale 1:1.
    start : tuple of float, optional
        Start of the robot, metres and radians.
    footprint : Footprint, optional
        The robot's shape.
    """
    grid = as_occupancy(read.grid, source)
    cell = grid.resolution
    most = MOST_TOLERANCE * cell
    if tolerance is None:
        tolerance = most
    if tolerance > most * (1 + 1e-9):
        rule = f"must be at most half a cell, {most:g} m, beyond which outlines might cross"
        hint = "mapdeal rescale makes a coarser map"
        raise ParameterError(rule, place="tolerance", got=tolerance, hint=hint)
    is_drawing = output.suffix.lower() == ".svg"
    if not is_drawing and unit != "mm":
        raise ParameterError("applies to .svg; GeoJSON is in metres", place="unit")
    of_robot = start is not None or footprint is not None
    if of == "obstacles" and of_robot:
        place = "footprint" if footprint is not None else "start"
        raise ParameterError("applies to free space", place=place)
    values = np.asarray(grid.occupancy)
    wanted: list[tuple[str, Mask, str]] = []
    has_all = is_drawing and of is None
    if has_all:  # what is free lies between the unknown below and the walls above
        wanted.append(("known", values != UNKNOWN, outlines.FREE_FILL))
    if of_robot:
        cells = _reached(source, grid, start, footprint)
        wanted.append(("reachable", cells, outlines.REACHABLE_FILL))
    elif of != "obstacles" and not has_all:
        wanted.append(("free", values == FREE, outlines.FREE_FILL))
    if has_all or of == "obstacles":
        wanted.append(("obstacles", values == OCCUPIED, outlines.WALL_FILL))
    corners = sum(corner_count(cells) for _, cells, _ in wanted)
    claim_work(source, grid, _PER_CELL, besides=_PER_CORNER * corners)
    layers = [
        (outlines.outlines_of(cells, grid.frame, tolerance, name), fill)
        for name, cells, fill in wanted
    ]
    shown = layers[0][0]
    if not len(shown.polygons):
        raise MalformedInputError(f"has no {_CELLS[shown.name]} cell", source=source)
    if is_drawing:
        background = outlines.UNKNOWN_FILL if of is None else None
        parts = outlines.svg_parts(
            layers, grid.frame, title=source.stem, unit=unit, background=background
        )
    else:
        parts = outlines.geojson_parts(shown)
    transaction.write_parts(output, parts)
    told = [
        f"{one.name} {decimal_text(one.area)} m2 in {count_text(len(one.polygons), 'polygon')}, "
        f"{count_text(one.corners, 'corner')}"
        for one, _ in layers
    ]
    figures = {
        one.name: {"area_m2": one.area, "polygons": len(one.polygons), "corners": one.corners}
        for one, _ in layers
    }
    return Shapes(output, figures, "; ".join(told))


def _reached(
    source: Path, grid: OccupancyGrid, start: tuple[float, ...] | None, robot: Footprint | None
) -> Mask:
    claim_work(source, grid, _REACH_PER_CELL)
    found = reach(grid, start=start, footprint=robot)
    cells: Mask = found.reachable.view(np.bool_)
    return cells


def convert_world(
    source: Path, read: Source, output: Path, transaction: Transaction, *,
    wall_height: Annotated[float, _HEIGHT, METRES] = 2.0,
    unknown: Literal["free", "occupied"] = "free",
) -> Shapes:  # fmt: skip
    """Write the walls of a map as solids.

    Parameters
    ----------
    source, read : path, Source
        The map, and its file.
    output : path
        File to write, .sdf, .stl or .obj.
    transaction : Transaction
        What writes it.
    wall_height : float
        Height of the walls, metres.
    unknown : {'free', 'occupied'}
        Whether unknown cells are left out or are walls.
    """
    grid = as_occupancy(read.grid, source)
    values = np.asarray(grid.occupancy)
    walls = values == OCCUPIED
    if unknown == "occupied":
        walls |= values == UNKNOWN
    count = int(np.count_nonzero(walls))
    if not count:
        raise MalformedInputError("has no occupied cell: there are no walls", source=source)
    claim_work(source, grid, _PER_CELL, besides=_PER_RUN * run_count(walls))
    volume = count * grid.resolution**2 * wall_height
    figures: dict[str, Any] = {"cells": count, "volume_m3": volume, "wall_height": wall_height}
    if output.suffix.lower() == ".sdf":
        boxes = rectangles(walls)
        figures["boxes"] = len(boxes.first_row)
        parts = sdf_parts(boxes, grid.frame, wall_height, source.stem)
        text = "1 box" if figures["boxes"] == 1 else f"{figures['boxes']} boxes"
        if figures["boxes"] > _MANY_BOXES:
            text += ", which simulators load slowly; as .stl or .obj it is one mesh"
    else:
        mesh = mesh_of(surface(walls), grid.frame, wall_height)
        figures["triangles"] = len(mesh.triangles)
        if output.suffix.lower() == ".stl":
            parts = stl_parts(mesh, source, grid.resolution)
        else:
            parts = obj_parts(mesh, source.stem)
        text = count_text(figures["triangles"], "triangle")
    transaction.write_parts(output, parts)
    return Shapes(output, figures, f"walls of {volume:.6g} m3, {wall_height:g} m high, {text}")
