"""``mapdeal build --world``: maps of simulated worlds, a part of ``mapdeal build``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.commands.pack import Made
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.source import claim
from mapdeal.grid.frame import Figures, Frame, Point, check_origin
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.build import frame_of
from mapdeal.mapping.cloud_map import CloudOptions
from mapdeal.mapping.voxels import upright
from mapdeal.mapping.world_map import WorldOptions, map_of_world
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pipeline.folder import written_line
from mapdeal.pipeline.inputs import Work, errors_named, refuse
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.worlds import World, read_world

_NOT_OF_WORLDS = ("min_points", "fill", "level")
_OF_ROBOTS = ("climb", "max_slope", "drops", "floor")
_LEAST_ELSEWHERE = 1.0  # m2 of free space behind walls that are worth a warning


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WorldBuild(Made):
    """A map made of a simulated world."""

    world: World

    def document(self) -> Figures:
        world = self.world
        own = {"solids": world.solid_count, "triangles": len(world.triangles)}
        return {**super().document(), **own, "moving": world.moving, "files": len(world.files)}

    def summary(self, output: Path) -> Iterator[str]:
        figures = self.document()
        yield written_line(output, figures, with_origin=True)
        text = f"  {count_text(figures['solids'], 'solid')}, {figures['triangles']} triangles"
        moving = self.world.moving
        yield text + (f"; {count_text(moving, 'model')} that can move left out" if moving else "")


def _mapped(
    path: Path, options: WorldOptions, of_robot: dict[str, Any], model_path: Sequence[Path],
    resolution: float, size: Point | None, origin: Sequence[float] | None,
) -> tuple[World, OccupancyGrid]:  # fmt: skip
    frame = frame_of(size, None if origin is None else origin[:2], resolution)
    if frame is not None and origin is not None and len(origin) > 2:
        frame = Frame(*frame.shape, frame.resolution, check_origin(origin))
    refuse("does not apply to worlds", **{n: of_robot.get(n) for n in _NOT_OF_WORLDS})
    if (options.height is None) == ("robot_height" not in of_robot):
        rule = "needs exactly one of --height (what a lidar sees) and --robot-height"
        raise ParameterError(rule, source="--world")
    if options.height is not None:
        rule = "applies to --robot-height, not to --height"
        refuse(rule, **{name: of_robot.get(name) for name in _OF_ROBOTS})

    def claimed(count: int, text: str) -> None:
        claim(path, count, what=text, hint="--size and --origin bound the map")

    with errors_named(path):
        floor = CloudOptions(floor=of_robot.get("floor")).floor
        of_cloud = CloudOptions(**{n: value for n, value in of_robot.items() if n != "floor"})
        world = read_world(
            path, model_path=model_path, visual=options.visual, static_only=options.static_only,
            floor=floor,
        )  # fmt: skip
        claim(path, 3 * world.triangles.nbytes, what=f"{len(world.triangles)} triangles")
        triangles = upright(world.triangles.reshape(-1, 3), of_cloud.up).reshape(-1, 3, 3)
        grid, elsewhere_m2 = map_of_world(
            triangles, world.solids, of_cloud, options, resolution=resolution, frame=frame,
            claim=claimed,
        )  # fmt: skip
    if elsewhere_m2 >= _LEAST_ELSEWHERE:
        text = f"{path}: {decimal_text(elsewhere_m2, 3)} m2 of free space behind walls are unknown"
        emit_warning(f"{text}: --at X,Y,Z maps the space at a place", stacklevel=2)
    return world, grid


def build_from_world(path: Path, output: Path, work: Work, **settings: Any) -> WorldBuild:
    """Make a map of a world in the shell."""
    work.outputs += output_paths(output)
    transaction = work.begin([path])
    world, grid = _mapped(path, **settings)
    write_grid(transaction, output, grid)
    return WorldBuild(grid, f"{output.stem}: map of a world", world=world)


def build_map_from_world(
    path: str | PathLike[str], *, model_path: Sequence[str | PathLike[str]] = (),
    resolution: float = 0.05, size: Point | None = None, origin: Sequence[float] | None = None,
    height: float | None = None, solid: bool = False, visual: bool = False,
    static_only: bool = False, max_memory: int | None = None, threads: int | None = None,
    **robot: Any,
) -> OccupancyGrid:  # fmt: skip
    """Build the map of a simulated world, like ``mapdeal build --world``.

    Parameters
    ----------
    path : path or str
        A world, model, robot or mesh: .sdf, .world, .urdf, .stl, .obj or .dae.
    model_path : sequence of path or str
        Folders with the models that the world includes.
    resolution : float
        Side of a cell, metres.
    size, origin : tuple of float, optional
        Extent and lower left corner of the map, metres, and its yaw, radians; by default what
        contains all solids.
    height, solid, visual, static_only
        As in `WorldOptions`.
    max_memory, threads
        As for `run`.
    **robot
        ``robot_height``, ``climb``, ``max_slope``, ``drops``, ``floor``, ``at`` and ``up`` of
        `CloudOptions`.

    Returns
    -------
    OccupancyGrid
        The map: 100 where solids are, 0 in free space, -1 elsewhere.

    Raises
    ------
    ParameterError
        If not exactly one of ``height`` and ``robot_height`` is given, or an option is invalid.
    FileAccessError, MalformedInputError
        If a file is missing or malformed, or has unsupported shapes, or a floor is missing.

    Warns
    -----
    MapdealWarning
        If there is free space elsewhere, behind walls.
    """
    settings = Settings(max_memory=max_memory, threads=threads)
    options = WorldOptions(height=height, solid=solid, visual=visual, static_only=static_only)
    with settings.reading(), use_threads(settings.threads):
        folders = [Path(folder) for folder in model_path]
        return _mapped(Path(path), options, robot, folders, resolution, size, origin)[1]
