"""``mapdeal convert``: a map, costmap or field in another format or on another scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np

from mapdeal.bags.bag import BAG_OUTPUTS, bag_paths
from mapdeal.command import AT_LEAST_0, METRES, Condition, Output, Result, Words, command
from mapdeal.commands.pack import GridResult
from mapdeal.commands.reach import RobotOption, StartOption
from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.files.transaction import Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, FieldView, PotentialField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, count_text, decimal_text
from mapdeal.kernels import arrays, outlines
from mapdeal.maps import dialects, exports, kinds, map_file, map_server, reading
from mapdeal.maps.formats import or_other_formats, output_format
from mapdeal.maps.npz import Grid
from mapdeal.pictures.overlay import TrajectoriesOverlay
from mapdeal.pipeline import inputs
from mapdeal.pipeline.recipe import planned_shape
from mapdeal.records import dataclass
from mapdeal.stages.esdf import field_view
from mapdeal.stages.reach import reach

ReadAs = Literal["map", "costs"]
Scale = Literal["occupancy", "costmap2d", "amcl"]

AREA_ENDINGS = (".geojson", ".svg")
SHAPE_ENDINGS = (*AREA_ENDINGS, *exports.WORLD_ENDINGS)

_PER_CELL, _PER_CORNER, _PER_RUN = 16.0, 240, 1500
"""Bytes of labels and masks for each cell; of points and lists for each corner, or run of walls."""
_OUTLINE_LIBRARIES = 20_000_000  # bytes of parts of scipy
_REACH_PER_CELL = 40.0
_MANY_BOXES = 3000
_HEIGHT = Condition("between 0.001 and 10000", lambda value: 0.001 <= value <= 10_000)
_CELLS = {"free": "free", "obstacles": "occupied", "known": "known", "reachable": "reachable"}


@dataclass(frozen=True, repr=False)
class Written(Result):
    output: Path
    figures: dict[str, Any]
    text: str

    def document(self) -> dict[str, Any]:
        return self.figures

    def lines(self) -> Iterator[str]:
        yield f"{self.output}: {self.text}"


def convert_area(
    source: Path, read: reading.Source, output: Path, transaction: Transaction, *,
    of: exports.Area | None = None, tolerance: Annotated[float, AT_LEAST_0, METRES] | None = None,
    start: StartOption = None, footprint: Footprint | None = None,
) -> Written:  # fmt: skip
    """Write the outlines of areas of a map.

    Parameters
    ----------
    of : {'free', 'obstacles'}, optional
        Areas to outline: free space or obstacles; with a robot's shape or --from, free space is
        what the robot's centre can reach. [default: free; a drawing has both]
    tolerance : float, optional
        Distance by which outlines may be moved to have fewer corners, up to half a cell; 0 to
        follow the cells exactly. [default: half a cell]
    start : tuple of float, optional
        Start of the robot, metres and radians.
    footprint : Footprint, optional
        The robot's shape.
    """
    grid = reading.as_occupancy(read.grid, source)
    most = outlines.MOST_TOLERANCE * grid.resolution
    tolerance = most if tolerance is None else tolerance
    if tolerance > most * (1 + 1e-9):
        rule = f"must be at most half a cell, {most:g} m, beyond which outlines might cross"
        hint = "mapdeal rescale makes a coarser map"
        raise ParameterError(rule, place="tolerance", got=tolerance, hint=hint)
    is_drawing = output.suffix.lower() == ".svg"
    if of == "obstacles":
        inputs.refuse("applies to free space", footprint=footprint, start=start)
    inputs.claim_work(source, grid, _PER_CELL, besides=_OUTLINE_LIBRARIES)
    values = np.asarray(grid.occupancy)
    areas: list[tuple[str, arrays.Mask, str]] = []
    has_all = is_drawing and of is None
    if has_all:  # known cells in the colour of free ones; walls are drawn over them
        areas.append(("known", values != UNKNOWN, exports.FREE_FILL))
    if start is not None or footprint is not None:
        inputs.claim_work(source, grid, _REACH_PER_CELL)
        reached = reach(grid, start=start, footprint=footprint).reachable
        areas.append(("reachable", reached.view(np.bool_), exports.REACHABLE_FILL))
    elif of != "obstacles" and not has_all:
        areas.append(("free", values == FREE, exports.FREE_FILL))
    if has_all or of == "obstacles":
        areas.append(("obstacles", values == OCCUPIED, exports.WALL_FILL))
    corners = sum(outlines.corner_count(cells) for _, cells, _ in areas)
    inputs.claim_work(source, grid, _PER_CELL, besides=_OUTLINE_LIBRARIES + _PER_CORNER * corners)
    most_cells = tolerance / grid.resolution
    layers = [(exports.Outlines(outlines.outlines(cells, most_cells), grid.frame, name), fill)
              for name, cells, fill in areas]  # fmt: skip
    shown = layers[0][0]
    if not len(shown.polygons):
        raise MalformedInputError(f"has no {_CELLS[shown.name]} cell", source=source)
    parts = exports.geojson_parts(shown)
    if is_drawing:
        background = exports.UNKNOWN_FILL if of is None else None
        parts = exports.svg_parts(layers, grid.frame, title=source.stem, background=background)
    transaction.write_parts(output, parts)
    texts, figures = [], {}
    for layer, _ in layers:
        area, count, corners = layer.area, len(layer.polygons), len(layer.polygons.corners)
        figures[layer.name] = {"area_m2": area, "polygons": count, "corners": corners}
        text = f"{layer.name} {decimal_text(area)} m2 in {count_text(count, 'polygon')}"
        texts.append(f"{text}, {count_text(corners, 'corner')}")
    return Written(output, {"file": str(output), **figures}, "; ".join(texts))


def convert_world(
    source: Path, read: reading.Source, output: Path, transaction: Transaction, *,
    wall_height: Annotated[float, _HEIGHT, METRES] = 2.0,
    unknown: Literal["free", "occupied"] = "free",
) -> Written:  # fmt: skip
    """Write the walls of a map as solids.

    Parameters
    ----------
    wall_height : float
        Height of the walls, metres.
    unknown : {'free', 'occupied'}
        Whether unknown cells are left out or are walls.
    """
    grid = reading.as_occupancy(read.grid, source)
    values = np.asarray(grid.occupancy)
    walls = values == OCCUPIED
    if unknown == "occupied":
        walls |= values == UNKNOWN
    if not (count := int(np.count_nonzero(walls))):
        raise MalformedInputError("has no occupied cell: there are no walls", source=source)
    besides = _OUTLINE_LIBRARIES + _PER_RUN * outlines.run_count(walls)
    inputs.claim_work(source, grid, _PER_CELL, besides=besides)
    volume = count * grid.resolution**2 * wall_height
    figures: dict[str, Any] = {"file": str(output), "cells": count}
    figures |= {"volume_m3": volume, "wall_height": wall_height}
    if output.suffix.lower() == ".sdf":
        boxes = outlines.rectangles(walls)
        figures["boxes"] = len(boxes.first_row)
        parts = exports.sdf_parts(boxes, grid.frame, wall_height, source.stem)
        text = "1 box" if figures["boxes"] == 1 else f"{figures['boxes']} boxes"
        if figures["boxes"] > _MANY_BOXES:
            text += ", which simulators load slowly; as .stl or .obj it is one mesh"
    else:
        mesh = exports.mesh_of(outlines.surface(walls), grid.frame, wall_height)
        figures["triangles"] = len(mesh.triangles)
        if output.suffix.lower() == ".stl":
            parts = exports.stl_parts(mesh, source, grid.resolution)
        else:
            parts = exports.obj_parts(mesh, source.stem)
        text = count_text(figures["triangles"], "triangle")
    transaction.write_parts(output, parts)
    return Written(output, figures, f"walls of {volume:.6g} m3, {wall_height:g} m high, {text}")


@command(
    group="Formats",
    output=Output(
        "OUT",
        f"{or_other_formats('The result: .yaml or .pgm (a pgm pair), .png (a png pair)')}; for a "
        "bag to replay .mcap, .db3 (a folder of ROS 2) or .bag (ROS 1); polygons .geojson or .svg; "
        "a world for simulators .sdf, .stl or .obj; poses of a .pbstream .txt; "
        "with --all a folder.",
    ),
    shared=("robot", "files"),
    makes_costs=lambda _: False,
    also={
        "With --static-layer": Costmap.from_static_layer,
        "With .geojson or .svg": convert_area,
        "With .sdf, .stl or .obj": convert_world,
    },
    words={
        "lethal_threshold": Words("N"),
        "trinary": Words(name="trinary-costmap"),
        "inscribed_value": Words("N|none"),
    },
    example="""\
mapdeal convert examples/maps/office.yaml -o out/office.png
mapdeal convert examples/maps/office.yaml -o out/office.mcap --topic /map
mapdeal convert examples/bags/office.mcap -o out/from_bag.yaml
mapdeal convert examples/maps/office.yaml -o out/area.geojson --robot-radius 0.2
mapdeal convert examples/maps/office.yaml -o out/office.sdf --wall-height 2.5""",
)
def convert(
    source: Annotated[Path, Words("MAP", streams=True)], *, work: inputs.InShell, output: Path,
    topic: Annotated[str | None, Words("TOPIC")] = None,
    index: Annotated[int | None, Words("N")] = None,
    takes_all: Annotated[bool, Words(name="all")] = False, read_as: ReadAs | None = None,
    frame_id: Annotated[str | None, Words("FRAME")] = None, encoding: Scale | None = None,
    mode: dialects.Mode | None = None, static_layer: bool = False,
    footprint: Footprint | None = None, robot: RobotOption = None, **more: Any,
) -> GridResult | Written:  # fmt: skip
    """Convert a map to another format or scale, from or to a bag, to polygons or to a world.

    Parameters
    ----------
    source : path
        A map_server .yaml, a .pbm with its .yaml, an .npz of mapdeal, a .pbstream, or a bag.
    topic : str, optional
        With a bag: topic to read, if there are several, or to write. [default: /map or /costmap]
    index : int, optional
        Reading a bag: index of the message, from 0, or from the end, -1. [default: the last]
    takes_all : bool
        Reading a bag: write all messages into a folder.
    read_as : {'map', 'costs'}, optional
        Reading a bag: what an OccupancyGrid contains. [default: costs in a topic named costmap]
    frame_id : str, optional
        Writing a bag: frame_id of the header. [default: map]
    encoding : {'occupancy', 'costmap2d', 'amcl'}, optional
        Scale of the values: what ROS publishes, costmap_2d's bytes, or the map as amcl sees it.
        [default: an .npz keeps its own, pixels of costs are occupancy]
    mode : {'trinary', 'scale', 'raw'}, optional
        How values become pixels. [default: raw if there are values 1..99, else trinary]
    static_layer : bool
        With --encoding costmap2d: costs as of costmap_2d's static layer, not round(2.54 v).
    footprint : Footprint, optional
        The robot's shape, instead of that of `robot`.
    **more
        As for `Costmap.from_static_layer`, `convert_area` and `convert_world`.
    """
    if output.suffix == ".txt" and not takes_all:
        return _convert_poses_to_tum(source, output, work)
    areas = inputs.pop_parameters(more, convert_area)
    worlds = inputs.pop_parameters(more, convert_world)
    layer, ending = more, "" if takes_all else output.suffix.lower()
    if ending not in AREA_ENDINGS:
        inputs.refuse("applies to .geojson and .svg", footprint=footprint, robot=robot, **areas)
    if ending not in exports.WORLD_ENDINGS:
        inputs.refuse("applies to .sdf, .stl and .obj", **worlds)
    if ending in SHAPE_ENDINGS:
        inputs.refuse("applies to maps", mode=mode, encoding=encoding, static_layer=static_layer)
        inputs.refuse("has no picture of its own", image=work.settings.image)
    if layer and not static_layer:
        raise ParameterError("needs --static-layer", place=next(iter(layer)))
    not_with_all = "cannot be given together with --all"
    if takes_all:
        inputs.need_folder(output)
        inputs.refuse(not_with_all, mode=mode, static_layer=static_layer, image=work.settings.image)
        inputs.refuse(not_with_all, encoding=encoding == "amcl")
    reads_bag, writes_bag = kinds.is_bag(source), output.suffix in BAG_OUTPUTS and not takes_all
    if writes_bag:
        work.outputs += bag_paths(output)
    elif ending in SHAPE_ENDINGS:
        work.outputs.append(output)
    elif not takes_all:
        work.outputs += reading.output_paths(output, (*SHAPE_ENDINGS, *BAG_OUTPUTS))
    if not reads_bag:
        inputs.refuse("applies to reading bags", index=index, read_as=read_as)
    if not writes_bag:
        inputs.refuse("applies to writing bags", frame_id=frame_id)
    if not (reads_bag or writes_bag):
        inputs.refuse("applies to bags", topic=topic)
    if takes_all:
        inputs.refuse(not_with_all, index=index)
        of_maps = cast("map_server.Encoding | None", encoding)
        return _convert_all(source, output, topic, read_as, of_maps, work)
    if writes_bag:
        inputs.refuse("applies to pixels, not to bags", mode=mode)
    if static_layer and encoding != "costmap2d":
        raise ParameterError("needs --encoding costmap2d", place="static_layer")
    painted = overlay = None
    if reads_bag:
        read = _read_bag(source, topic, -1 if index is None else index, read_as)
    else:
        with inputs.opened_input(source, work.settings) as file:
            read = file.read()
            if mode is None and encoding is None:
                painted = file.painting()
            if work.settings.image is not None and (trajectories := file.trajectories()):
                lines = [trajectory.poses[:, :2] for trajectory in trajectories.values()]
                overlay = TrajectoriesOverlay(lines)
    if ending in SHAPE_ENDINGS:
        transaction = work.begin([*read.files, *(robot.paths if robot else ())])
        if ending in exports.WORLD_ENDINGS:
            return convert_world(source, read, output, transaction, **worlds)
        return convert_area(
            source, read, output, transaction, footprint=planned_shape(robot, footprint), **areas
        )
    per_cell = 12.0 if mode == "scale" else 5.0
    if isinstance(read.grid, PotentialField):  # most of its layers are made when they are written
        per_cell = 76.0 if work.settings.image is None else 130.0
    inputs.claim_work(source, read.grid, per_cell)
    transaction = work.begin(read.files)
    with inputs.errors_named(source):
        grid = _converted(read.grid, encoding, layer if static_layer else None)
    if writes_bag:
        _write_bag(transaction, output, grid, topic, frame_id)
        return GridResult(grid, source.stem)
    if isinstance(grid, DistanceField) and not output_format(output).can_hold(DistanceField):
        grid, mode = field_view(grid), mode or ("raw" if output_format(output).images else None)
    if isinstance(grid, FieldView) and mode not in (None, "raw"):
        grid = grid.as_map()
    if isinstance(grid, OccupancyGrid) and mode == "trinary":
        grid = map_server.in_trinary(grid)
    states = None
    if encoding == "amcl" and isinstance(grid, OccupancyGrid):
        states = {"amcl": grid.amcl_states()}
    scale: map_server.Encoding = "costmap2d" if encoding == "costmap2d" else "occupancy"
    extra = dict(read.metadata.extra) if read.metadata else {}
    written: Any = {"encoding": scale, "more": states, "painted": painted, "extra": extra}
    reading.write_grid(transaction, output, grid, mode=mode, **written)
    return GridResult(grid, source.stem, overlay=overlay)


def _convert_poses_to_tum(source: Path, output: Path, work: inputs.Work) -> Written:
    with inputs.opened_input(source, work.settings) as file:
        trajectories = file.trajectories()
        if not trajectories:
            raise ParameterError("has no trajectory to write as .txt", source=source)
        paths = {key: output.with_stem(f"{output.stem}_{key}") for key in trajectories}
        if len(paths) == 1:
            paths = dict.fromkeys(paths, output)
        work.outputs += paths.values()
        transaction = work.begin(file.files)
        for key, trajectory in trajectories.items():
            transaction.write_bytes(paths[key], "".join(trajectory.tum_lines()).encode())
    count = sum(len(trajectory.ticks) for trajectory in trajectories.values())
    names = ", ".join(path.name for path in paths.values())
    return Written(output.with_name(names), {"count": count}, f"{count} poses of {source}")


def _convert_all(
    path: Path, folder: Path, topic: str | None, read_as: ReadAs | None,
    encoding: map_server.Encoding | None, work: inputs.Work,
) -> Written:  # fmt: skip
    """Write all maps or costmaps of a topic into a folder: 0000.yaml, 0001.yaml and so on."""
    from mapdeal.pipeline.bag_maps import GridTopic, from_bag  # not loaded for maps

    with from_bag(path, GridTopic, topic, read_as) as found:
        digits = max(4, len(str(len(found) - 1)))
        names = [folder / f"{number:0{digits}}.yaml" for number in range(len(found))]
        work.outputs += [path for name in names for path in reading.output_paths(name)]
        transaction = work.begin(found.files)
        with work.counted(len(found)) as advance:
            for number, name in enumerate(names):
                grid = _converted(found.read(number), encoding, None)
                reading.write_grid(transaction, name, grid, encoding=encoding or "occupancy")
                transaction.wait()
                advance(1)
        return Written(folder, {"count": len(found)}, f"{len(found)} of {path}")


def _read_bag(path: Path, topic: str | None, index: int, read_as: ReadAs | None) -> reading.Source:
    from mapdeal.pipeline.bag_maps import GridTopic, from_bag  # not loaded for maps

    with from_bag(path, GridTopic, topic, read_as) as found:
        grid, files = found.read(index), found.files
    if isinstance(grid, Costmap):
        map_file.warn_of_cost_figures(path, grid.figures())
    else:
        map_file.warn_of_nothing_known(path, grid.occupancy, has_pixels=False)
    return reading.Source(grid, files)


def _write_bag(
    transaction: Transaction, output: Path, grid: Grid, topic: str | None, frame: str | None
) -> None:
    from mapdeal.bags.messages import FRAME, write_bag

    if isinstance(grid, FieldView):
        grid = grid.as_map()
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        hint = "mapdeal cost makes costs of it, which ROS has"
        raise ParameterError(f"ROS has no message for a {grid.kind}", source=output, hint=hint)
    write_bag(transaction, output, grid, topic=topic, frame=FRAME if frame is None else frame)


def _converted(grid: Grid, encoding: Scale | None, static_layer: Mapping[str, Any] | None) -> Grid:
    if encoding is None or (encoding == "occupancy" and not isinstance(grid, Costmap)):
        return grid
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        rule = f"a field has no values of {encoding}"
        raise ParameterError(rule, place="encoding", hint="mapdeal cost makes costs of a map")
    if isinstance(grid, Costmap) and encoding == grid.scale:
        if static_layer is not None:
            rule = "applies to maps, and these are already costs on its own scale"
            raise ParameterError(rule, place="static_layer")
        return grid
    occupancy = grid.to_occupancy() if isinstance(grid, Costmap) else grid
    if encoding == "amcl":
        return occupancy.as_amcl_sees_it()
    if encoding == "occupancy":  # as ROS would publish them
        return Costmap(occupancy.occupancy, grid.resolution, grid.origin, "occupancy")
    if static_layer is not None:
        return Costmap.from_static_layer(occupancy, **static_layer)
    return Costmap.from_occupancy(occupancy)
