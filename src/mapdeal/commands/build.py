"""``mapdeal build``: maps from laser scans, point clouds and simulated worlds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, BinaryIO, NamedTuple

import numpy as np

from mapdeal.command import AT_LEAST_0, METRES, Output, Result, Words, command, parameters_of
from mapdeal.commands.pack import GridResult
from mapdeal.compare.difference import STATES, changes_of, confusion_of, states_of
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning, one_line
from mapdeal.files.json_values import encode_json
from mapdeal.files.source import check_state, claim, is_regular, is_same_file, state_of
from mapdeal.grid.frame import Figures, Frame, Point, check_origin
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, count_text, decimal_text
from mapdeal.kernels import components, rotations
from mapdeal.kernels.arrays import Bytes, Floats
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping import build as mapping, voxels
from mapdeal.mapping.cloud_map import CloudMap, CloudMapper, CloudOptions
from mapdeal.mapping.evidence import NEAR, OFTEN, BeamLimits, Beams, Scans, beams_of
from mapdeal.mapping.transforms import FrameOptions, Topics, check_pose
from mapdeal.mapping.world_map import WorldOptions, map_of_world
from mapdeal.maps import kinds, listing, png, reading
from mapdeal.maps.npz import check_ends_in_npz, write_npz
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.overlay import RingOverlay
from mapdeal.pipeline.folder import write_picture
from mapdeal.pipeline.inputs import InShell, Work, errors_named, need_folder, pop_parameters, refuse
from mapdeal.pipeline.settings import Settings
from mapdeal.records import asdict, dataclass
from mapdeal.sensors.clouds import CLOUD_SUFFIXES, cloud_chunks
from mapdeal.sensors.points import has_times, read_poses, read_trajectory
from mapdeal.sensors.scans import DEFAULT_MAX_BAD, ScanSource, ScanTexts, open_log
from mapdeal.sensors.worlds import World, read_world
from mapdeal.version import __version__

# Bytes per cell: the evidence and the map made from it.
_BYTES_PER_CELL: dict[mapping.Method, int] = {"log-odds": 22, "counting": 22, "tsdf": 43}
_COMPARE_BYTES_PER_CELL = 60  # the evidence of all methods, and the map of one method
_CACHED_BYTES = 1 << 26  # of beams; more are read twice

DOCUMENT = "comparison.json"
_FORMAT = "mapdeal-comparison/1"
_MOST_VANISHED = 100  # groups of hits whose places a document lists
_STATES = STATES[:3]  # states of a cell; values 1..99 have none because only states are compared
_CLOUDS_ONLY = ("min_points", "fill", "level")
_ROBOTS_ONLY = ("climb", "max_slope", "drops", "floor")
_LEAST_ENCLOSED = 1.0  # m2 of free space behind walls that deserve a warning
_TILTED = 1.0  # degrees of tilt of a cloud that are worth a warning
_COARSE = 3.0  # times the climb: clearance that is worth a warning
_KIB, _OF_POINT = 1024, 16  # bytes that a point has in most files: for the progress
_OF_SCAN = 200  # bytes for each point of a cloud whose beams are followed
_LIBRARIES = 8_000_000  # bytes of parts of scipy, for clouds

Advance = Callable[[int], object]
_Part = tuple[Beams, int]  # beams, and the number of scans read so far


@dataclass(frozen=True)
class _Building:
    methods: Mapping[mapping.Method, Mapping[str, Any]]
    limits: BeamLimits
    resolution: float
    frame: Frame | None  # None if it is to contain all beams

    def __post_init__(self) -> None:
        self.reach_behind()  # checks the parameters before anything is read

    def reach_behind(self) -> float:
        """Return the largest distance behind hits that a method changes, metres."""
        cell, methods = self.resolution, self.methods.items()
        return max(mapping.reach_behind(method, cell, options) for method, options in methods)


def _built(
    source: ScanSource, building: _Building, *, with_layers: bool = True,
    advance: Advance = lambda _: None,
) -> mapping.BuiltMap:  # fmt: skip
    (method,) = building.methods
    builder = _builders(source, building, _BYTES_PER_CELL[method], advance)[0][method]
    built = builder.result(with_layers=with_layers)
    _warn_if_unknown(built.grid, source.named)
    if vanished := built.vanished:
        x, y = vanished.middles_xy(built.grid.frame)[0]
        largest = "it" if len(vanished) == 1 else "the largest"
        text = f"{count_text(len(vanished), 'group')} of cells hit {OFTEN} times and more left "
        text += f"nothing occupied within {NEAR} cells; {largest} has {vanished.sizes[0]} cells, "
        text += f"around {x:.2f}, {y:.2f}; {builder.advice(vanished)}"
        emit_warning(f"{source.named}: {text}; --compare shows what each method loses")
    return built


def _builders(
    source: ScanSource, building: _Building, per_cell: int, advance: Advance
) -> tuple[dict[mapping.Method, mapping.MapBuilder], dict[mapping.Method, float]]:
    """Return a builder with all scans for each method, and the seconds that each took."""
    # Files may be read twice, so they must not change meanwhile; a pipe can be read only once.
    states = {path: state_of(path) for path in source.files if is_regular(path)}
    try:
        with errors_named(source.named):
            source.prepare(advance)
            parts: Iterable[_Part] | None = None
            if (frame := building.frame) is None:
                frame, parts = _extent(source, building, advance)
            size = f"{frame.width} x {frame.height} cells"
            hint = "a pose may be wrong; --size and --origin bound the map"
            claim(source.named, per_cell * frame.height * frame.width, what=size, hint=hint)
            builders = {
                method: mapping.MapBuilder(frame, method, building.limits, **parameters)
                for method, parameters in building.methods.items()
            }
            seconds = dict.fromkeys(builders, 0.0)
            if parts is None:
                parts = _parts(source, building.limits, is_reported=building.frame is None)
            for beams, scans in parts:
                for method, builder in builders.items():
                    started = time.perf_counter()
                    builder.add_beams(beams)
                    seconds[method] += time.perf_counter() - started
                advance(scans)
    finally:
        source.warn()  # even if no map results: the warnings may explain why
    for path, state in states.items():
        check_state(path, state)
    if not next(iter(builders.values())).counts.scans:
        raise MalformedInputError("holds no scans", source=source.named)
    return builders, seconds


def _extent(
    source: ScanSource, building: _Building, advance: Advance
) -> tuple[Frame, list[_Part] | None]:
    """Return the frame of all beams, and the beams unless they are too many to cache."""
    extent = mapping.Extent(building.limits, building.reach_behind())
    parts: list[_Part] | None = []
    cached_bytes = 0
    for beams, scans in _parts(source, building.limits):
        extent.add_beams(beams)
        cached_bytes += beams.nbytes
        if cached_bytes > _CACHED_BYTES:
            parts = None
        elif parts is not None:
            parts.append((beams, scans))
        advance(scans)
    return extent.frame(building.resolution), parts


def _parts(source: ScanSource, limits: BeamLimits, *, is_reported: bool = False) -> Iterator[_Part]:
    """Yield the beams of scans in parts; warn once of angles beyond a turn."""
    for arrays in source.scans():
        if not is_reported and (largest := np.abs(arrays.angles).max(initial=0.0)) > 2 * math.pi:
            is_reported = True
            emit_warning(f"{source.named}: angles of up to {largest:.6g} rad: are they in degrees?")
        for scans in Scans(*arrays).parts():
            yield beams_of(scans, limits), scans.count


def _warn_if_unknown(grid: OccupancyGrid, path: Path) -> None:
    if not np.any(grid.occupancy >= 0):
        emit_warning(f"{path}: no beam reaches the grid: the whole map is unknown")


@contextmanager
def _opened(
    log: Path, topics: Sequence[str], frames: Mapping[str, Any], *, deskew: bool, max_bad: int
) -> Iterator[ScanSource]:
    if kinds.is_bag(log):
        from mapdeal.pipeline.bag_maps import BagScans, from_bag  # only for bags

        with from_bag(log, BagScans, topics, FrameOptions(**frames), deskew=deskew) as scans:
            yield scans
    else:
        refuse("needs a bag for LOG", topics=topics, **frames, deskew=deskew)
        yield open_log(log, max_bad=max_bad)


def build_map_from_log(
    path: str | PathLike[str], topics: Sequence[str] = (), *, method: mapping.Method = "log-odds",
    resolution: float = 0.05, size: Point | None = None, origin: Point | None = None,
    range_min: float = 0.0, range_max: float = 30.0, clear_max: float = 0.0, deskew: bool = False,
    max_bad: int = DEFAULT_MAX_BAD, max_memory: int | None = None, threads: int | None = None,
    **more: Any,
) -> mapping.BuiltMap:  # fmt: skip
    """Build a map from the laser scans in a log or a bag, like ``mapdeal build LOG``.

    Parameters
    ----------
    path : path or str
        A CARMEN log, optionally ``.gz``, an ``.npz`` with ``poses``, ``angles`` and ``ranges``, or
        a bag: a ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topics : sequence of str
        Of a bag: topics of type sensor_msgs/LaserScan; can be omitted if it has only one.
    method, resolution, size, origin, range_min, range_max, clear_max
        As for `build_map`.
    deskew : bool
        Of a bag: whether to use the pose at the time of each beam rather than of each scan.
    max_bad : int
        Maximum number of malformed lines in a log.
    max_memory, threads
        As for `run`.
    **more
        Parameters of the method, and for a bag fixed_frame, base_frame, odometry, mount and poses:
        the options of the command.

    Returns
    -------
    BuiltMap
        The map, its evidence and the beam counts.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the log cannot be read or has no scans, or its sensor lacks transforms.
    ParameterError
        If a parameter is invalid, or a bag needs the extra ``bags``.

    Warns
    -----
    MapdealWarning
        If the map lacks groups of cells that were hit often, scans were skipped, or a choice had to
        be made.
    """
    settings = Settings(max_memory=max_memory, threads=threads)
    frames = pop_parameters(more, FrameOptions)
    if frames.get("mount") is not None:
        frames["mount"] = check_pose(frames["mount"], "mount")
    limits = BeamLimits(range_min, range_max, clear_max)
    frame = mapping.frame_of(size, origin, resolution)
    building = _Building({method: more}, limits, resolution, frame)
    opened = _opened(Path(path), topics, frames, deskew=deskew, max_bad=max_bad)
    with settings.reading(), use_threads(settings.threads), opened as source:
        return _built(source, building)


def _beams_line(figures: Figures) -> str:
    text = f"  {figures['scans']} scans, {figures['beams']} beams: {figures['hits']} hits, "
    return text + f"{figures['no_return']} without return, {figures['bad']} bad"


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    figures: Figures
    folder: Path

    def document(self) -> Figures:
        return self.figures

    def lines(self) -> Iterator[str]:
        figures = self.figures
        x, y, _ = figures["origin"]
        yield f"{self.folder}: {figures['width']} x {figures['height']} cells at {x:.10g}, {y:.10g}"
        yield _beams_line(figures)
        hit = f"  {figures['cells_hit_three_times']} cells hit three times and more, with "
        yield f"{hit}{figures['groups_hit_three_times']} groups of three cells and more"
        row = "  {:<10}{:>10}{:>10}{:>10}{:>15}{:>8}{:>17}{:>14}{:>9}"
        yield row.format("method", *_STATES, "one cell wide", "mean", "groups vanished",
                         "bytes a cell", "seconds")  # fmt: skip
        for method, results in figures["methods"].items():
            share, mean = results["one_cell_wide_share"], results["mean_thickness_cells"]
            share_text = "-" if share is None else f"{100 * share:.1f} %"
            mean_text = "-" if mean is None else f"{mean:.2f}"
            states = [results[state] for state in _STATES]
            yield row.format(method, *states, share_text, mean_text, results["vanished_groups"],
                             results["bytes_per_cell"], f"{results['seconds']:.2f}")  # fmt: skip
        for pair in figures["pairs"]:
            first, second, cells = pair["first"], pair["second"], pair["cells"]
            only_first = sum(cells["occupied"][state] for state in ("free", "unknown"))
            only_second = sum(cells[state]["occupied"] for state in ("free", "unknown"))
            text = f"  {first}, {second}: {pair['differing']} cells differ, {only_first} occupied"
            yield f"{text} only by {first}, {only_second} only by {second}"


def _map_of_world(
    path: Path, options: WorldOptions, robot_options: dict[str, Any], model_path: Sequence[Path],
    resolution: float, size: Point | None, origin: Sequence[float] | None,
) -> tuple[World, OccupancyGrid]:  # fmt: skip
    frame = mapping.frame_of(size, None if origin is None else origin[:2], resolution)
    if frame is not None and origin is not None and len(origin) > 2:
        frame = Frame(*frame.shape, frame.resolution, check_origin(origin))
    refuse("does not apply to worlds", **{name: robot_options.get(name) for name in _CLOUDS_ONLY})
    if (options.height is None) == ("robot_height" not in robot_options):
        rule = "needs exactly one of --height (what a lidar sees) and --robot-height"
        raise ParameterError(rule, source="--world")
    if options.height is not None:
        rule = "applies to --robot-height, not to --height"
        refuse(rule, **{name: robot_options.get(name) for name in _ROBOTS_ONLY})

    def claim_for_map(count: int, text: str) -> None:
        claim(path, count, what=text, hint="--size and --origin bound the map")

    with errors_named(path):
        floor = CloudOptions(floor=robot_options.get("floor")).floor
        robot = CloudOptions(**{**robot_options, "floor": None})
        world = read_world(path, model_path=model_path, floor=floor, visual=options.visual,
                           static_only=options.static_only)  # fmt: skip
        claim(path, 3 * world.triangles.nbytes, what=f"{len(world.triangles)} triangles")
        triangles = voxels.upright(world.triangles.reshape(-1, 3), robot.up).reshape(-1, 3, 3)
        grid, enclosed_m2 = map_of_world(triangles, world.solids, robot, options, frame=frame,
                                         resolution=resolution, claim=claim_for_map)  # fmt: skip
    if enclosed_m2 >= _LEAST_ENCLOSED:
        text = f"{path}: {decimal_text(enclosed_m2, 3)} m2 of free space behind walls are unknown"
        emit_warning(f"{text}: --at X,Y,Z maps the space at a place")
    return world, grid


def build_from_world(path: Path, output: Path, work: Work, **settings: Any) -> GridResult:
    work.outputs += reading.output_paths(output)
    transaction = work.begin([path])
    world, grid = _map_of_world(path, **settings)
    reading.write_grid(transaction, output, grid)
    figures = {"solids": world.solid_count, "triangles": len(world.triangles)}
    figures |= {"moving": world.moving, "files": len(world.files)}
    note = f"  {count_text(world.solid_count, 'solid')}, {len(world.triangles)} triangles"
    note += f"; {count_text(world.moving, 'model')} that can move left out" if world.moving else ""
    return GridResult(grid, f"{output.stem}: map of a world", figures=figures, notes=[note])


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
        Extent, metres, lower left corner and yaw of the map; by default what contains all solids.
    height, solid, visual, static_only
        As in `WorldOptions`.
    max_memory, threads
        As for `run`.
    **robot
        Of `CloudOptions`: robot_height, climb, max_slope, drops, floor, at and up.

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
        If there is more free space behind walls.
    """
    settings = Settings(max_memory=max_memory, threads=threads)
    options = WorldOptions(height=height, solid=solid, visual=visual, static_only=static_only)
    with settings.reading(), use_threads(settings.threads):
        folders = [Path(folder) for folder in model_path]
        return _map_of_world(Path(path), options, robot, folders, resolution, size, origin)[1]


class _Placed(NamedTuple):
    """One cloud, and where the sensor was: a translation and a quaternion, if that is known."""

    chunks: Callable[[Advance], Iterator[Floats]]
    move: Floats | None
    turn: Floats | None

    def points(self, range_min: float, advance: Advance) -> Iterator[tuple[Floats, int]]:
        """Yield points in the frame of the map, and how many were too near to the sensor."""
        for chunk in self.chunks(advance):
            if chunk.shape[1] < 3:
                raise MalformedInputError("the cloud has no heights: points need x, y and z")
            points = voxels.away_from_sensor(chunk[:, :3], range_min)
            if self.move is not None and self.turn is not None:
                with np.errstate(invalid="ignore", over="ignore"):
                    points = rotations.rotated(self.turn, points) + self.move
            yield points, len(chunk) - len(points)


class _Clouds(NamedTuple):
    named: Path
    files: tuple[Path, ...]
    steps: int  # of one pass, for the progress
    placed: Callable[[], Iterator[_Placed]]
    places: Floats | None = None  # of a robot, if clouds have no places of their own
    has_places: bool = False


def _of_files(names: Sequence[str], poses: Path | None) -> _Clouds:
    paths = listing.list_files(names, CLOUD_SUFFIXES, not_in_folders=(".txt",))
    if poses is not None:
        paths = [path for path in paths if not is_same_file(path, poses)]
    if not paths:
        raise MalformedInputError("there are no clouds", source=names[0])
    sensors: list[tuple[Any, Any]] = [(None, None)] * len(paths)  # moves and turns of clouds
    places = None
    if poses is not None:
        if has_times(poses):
            _, moves, quaternions = read_trajectory(poses)
            turns = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        else:
            planar = read_poses(poses)
            moves = np.column_stack([planar[:, :2], np.zeros(len(planar))])
            turns = rotations.from_yaw(planar[:, 2])
        if len(paths) == 1:
            places = moves  # of the robot in a map
        elif len(moves) != len(paths):
            rule = f"must have a pose for each of {len(paths)} clouds"
            raise MalformedInputError(rule, source=poses, got=len(moves))
        else:
            sensors = list(zip(moves, turns, strict=True))
    states = {path: state_of(path) for path in paths}

    def read(path: Path, advance: Advance) -> Iterator[Floats]:
        remaining = states[path].size // _KIB
        for points in cloud_chunks(path):
            yield points
            step = min(remaining, len(points) * _OF_POINT // _KIB)
            remaining -= step
            advance(step)
        check_state(path, states[path])
        advance(remaining)

    def placed() -> Iterator[_Placed]:
        for path, (move, turn) in zip(paths, sensors, strict=True):
            yield _Placed(partial(read, path), move, turn)

    steps = sum(state.size // _KIB for state in states.values())
    named = paths[0] if len(paths) == 1 else Path(f"{paths[0]} and {len(paths) - 1} more")
    files = (*paths, *([] if poses is None else [poses]))
    has_places = poses is not None and places is None
    return _Clouds(named, files, steps, placed, places, has_places)


def _of_bag(path: Path, topics: Sequence[str], frames: FrameOptions, stack: ExitStack) -> _Clouds:
    from mapdeal.pipeline.bag_maps import BagClouds, from_bag  # of use to bags alone

    opened = from_bag(path, BagClouds, topics, frames, has_poses=False, is_raw=True)
    bag = stack.enter_context(opened)
    bag.prepare(lambda _: None)
    posed = bag.sensors()
    numbers = np.flatnonzero(posed.known)
    if not len(numbers):
        raise MalformedInputError("of no cloud it is known where the sensor was", source=path)
    if missing := len(posed.known) - len(numbers):
        text = f"{path}: {missing} of {len(posed.known)} clouds are left out: where the sensor was"
        emit_warning(f"{text} is not known")

    def read(number: int, advance: Advance) -> Iterator[Floats]:
        yield bag.points(number)
        advance(1)

    def placed() -> Iterator[_Placed]:
        for number in numbers.tolist():
            move, turn = posed.translations[number], posed.quaternions[number]
            yield _Placed(partial(read, number), move, turn)

    return _Clouds(path, bag.files, len(numbers), placed, has_places=True)


def _map_clouds(
    clouds: _Clouds, options: CloudOptions, resolution: float | None, frame: Frame | None,
    range_min: float, advance: Advance,
) -> CloudMap:  # fmt: skip
    def claim_for_map(count: int, text: str) -> None:
        claim(clouds.named, _LIBRARIES + count, what=text, hint="--size and --origin bound the map")

    mapper = CloudMapper(options, resolution=resolution, frame=frame, claim=claim_for_map)
    with errors_named(clouds.named):
        if options.level:
            tilt = voxels.Tilt()
            for cloud in clouds.placed():
                for points, _ in cloud.points(range_min, advance):
                    tilt.add(voxels.upright(points, options.up))
            mapper.turn(tilt)
        for cloud in clouds.placed():
            mapper.add_place(cloud.move)
            for points, dropped in cloud.points(range_min, advance):
                mapper.at_sensor += dropped
                mapper.add(points)
        for place in () if clouds.places is None else clouds.places:
            mapper.add_place(place)
        mapper.settle(follows_beams=clouds.has_places)
        for cloud in clouds.placed() if clouds.has_places else ():
            parts = [points for points, _ in cloud.points(range_min, advance)]
            count = sum(map(len, parts))
            claim(clouds.named, _OF_SCAN * count, what=f"a cloud of {count} points")
            if cloud.move is not None and parts:
                mapper.clear(np.concatenate(parts), cloud.move)
        cloud_map = mapper.result()
    for text in _cloud_warnings(cloud_map, options):
        emit_warning(f"{clouds.named}: {text}")
    return cloud_map


def _cloud_warnings(cloud_map: CloudMap, options: CloudOptions) -> Iterator[str]:
    if cloud_map.tilt > _TILTED and not options.level:
        yield f"the floor is tilted by {cloud_map.tilt:.1f} degrees: --level turns the cloud"
    rounded = sorted({round(height, 2) + 0.0 for height in cloud_map.storeys})
    heights = ", ".join(f"{height:.2f}" for height in rounded)
    if cloud_map.overlaid_m2 > 0:
        text = f"floors lie above each other on {decimal_text(cloud_map.overlaid_m2, 3)} m2"
        yield text + (f": --at X,Y,Z shows another storey, at {heights} m" if heights else "")
    elif heights:
        yield f"other floors are not on the map: --at X,Y,Z shows one, at {heights} m"
    if cloud_map.may_be_upside_down:
        text = "much hangs from the ceiling, for what stands on the floor: is z down?"
        yield f"{text} --up -z turns the cloud, --up z keeps it"
    if not (np.asarray(cloud_map.grid.occupancy) == OCCUPIED).any():
        text = "nothing stands on the floor: the map has no obstacles"
        yield f"{text}; if walls were cut off, --floor Z states the floor"
    if cloud_map.clearance > _COARSE * options.climb:
        text = "heights are coarse or noisy: obstacles and drops of less than"
        yield f"{text} {cloud_map.clearance:.2f} m look like floor"
    if cloud_map.beyond:
        yield f"{cloud_map.beyond} points are too far from the others, and are ignored"


def _cloud_notes(figures: Figures) -> Iterator[str]:
    floor, obstacle = (f"{100 * figures[name]:.1f} %" for name in ("floor_share", "obstacle_share"))
    text = f"  {figures['points']} points: floor {figures['floor_m2']:.5g} m2 ({floor}), "
    yield f"{text}obstacles {figures['obstacle_m2']:.5g} m2 ({obstacle})"
    low, high = figures["floor_height_min"], figures["floor_height_max"]
    if figures["at_sensor"]:
        yield f"  {figures['at_sensor']} points at the sensor are left out"
    text = f"  floor at {low:.2f} to {high:.2f} m, tilted by {figures['tilt_deg']:.2f} degrees; "
    text += f"noise {figures['noise']:.3f} m, "
    yield f"{text}obstacles from {figures['clearance']:.2f} m above it"


def _clouds_of(
    names: Sequence[str], topics: Sequence[str], frames: FrameOptions, stack: ExitStack
) -> _Clouds:
    if len(names) == 1 and kinds.is_bag(Path(names[0])):
        return _of_bag(Path(names[0]), topics, frames, stack)
    return _of_files(names, frames.poses)


def build_from_clouds(
    names: Sequence[str], output: Path, work: Work, *, options: CloudOptions,
    resolution: float | None, size: Point | None, origin: Sequence[float] | None,
    layers: Path | None, range_min: float, poses: Path | None, topics: Sequence[str],
    frames: dict[str, Any],
) -> GridResult:  # fmt: skip
    frame = mapping.frame_of(size, origin, voxels.FINEST if resolution is None else resolution)
    if layers is not None:
        check_ends_in_npz(layers)
    if not (len(names) == 1 and kinds.is_bag(Path(names[0]))):
        refuse("needs a bag for --cloud", topics=tuple(topics), **frames)
    with ExitStack() as stack:
        clouds = _clouds_of(names, topics, FrameOptions(poses=poses, **frames), stack)
        work.outputs += [*reading.output_paths(output), *([layers] if layers is not None else [])]
        transaction = work.begin(clouds.files)
        with work.counted((1 + options.level + clouds.has_places) * clouds.steps) as advance:
            cloud_map = _map_clouds(clouds, options, resolution, frame, range_min, advance)
    reading.write_grid(transaction, output, cloud_map.grid)
    if layers is not None:
        transaction.write(layers, partial(write_npz, grid=cloud_map.grid, more=cloud_map.layers))
    title, figures = f"{output.stem}: map of a cloud", cloud_map.figures()
    return GridResult(cloud_map.grid, title, figures=figures, notes=[*_cloud_notes(figures)])


def build_map_from_clouds(
    paths: str | PathLike[str] | Sequence[str | PathLike[str]], *,
    poses: str | PathLike[str] | None = None, topics: Sequence[str] = (),
    resolution: float | None = None, size: Point | None = None, origin: Point | None = None,
    range_min: float = 0.0, max_memory: int | None = None, threads: int | None = None,
    **options: Any,
) -> CloudMap:  # fmt: skip
    """Build a map from point clouds in files, like ``mapdeal build --cloud``.

    Parameters
    ----------
    paths : path, str or sequence of them
        Clouds, folders of them, patterns, or one bag.
    poses : path or str, optional
        Poses of the clouds, one each: x y yaw, or t x y z qx qy qz qw. For a single cloud, any
        number of places at which the robot was. For a bag, the robot's poses with their times.
    topics : sequence of str
        Topic of a bag that has several.
    resolution : float, optional
        Side of a cell, metres; by default 0.05, or the distance between points if that is larger.
    size, origin : tuple of float, optional
        Extent and lower left corner of the map, metres; by default what contains all that is known.
    range_min : float
        Points nearer to the sensor are left out, metres, as are those at the sensor itself.
    max_memory, threads
        As for `run`.
    **options
        Fields of `CloudOptions`.

    Returns
    -------
    CloudMap
        The map, and the heights of the floor and of obstacles.

    Raises
    ------
    ParameterError
        If an option is invalid.
    FileAccessError, MalformedInputError
        If a cloud cannot be read, or lacks heights or a floor.

    Warns
    -----
    MapdealWarning
        If the floor is tilted or lies above itself, or points or clouds were left out.
    """
    cloud_options = CloudOptions(**options)
    names = [str(paths)] if isinstance(paths, (str, PathLike)) else [str(path) for path in paths]
    if not names:
        raise ParameterError("names no cloud", place="paths", got=paths)
    settings = Settings(max_memory=max_memory, threads=threads)
    frame = mapping.frame_of(size, origin, voxels.FINEST if resolution is None else resolution)
    pose_file = None if poses is None else Path(poses)
    with settings.reading(), use_threads(settings.threads), ExitStack() as stack:
        clouds = _clouds_of(names, topics, FrameOptions(poses=pose_file), stack)
        return _map_clouds(clouds, cloud_options, resolution, frame, range_min, lambda _: None)


@command(
    group="Laser scans and point clouds",
    output=Output("OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz; with "
                  "--compare a folder."),
    shared=("image", "force", "threads", "max_memory"),
    also={"With a bag": FrameOptions, **mapping.METHODS, "With --cloud": CloudOptions,
          "With --world": WorldOptions},
    example="""\
mapdeal build examples/logs/office.log -o out/scanned.yaml --method counting
mapdeal build examples/logs/office.log --compare -o out/methods
mapdeal build examples/bags/office.mcap -o out/corridor.yaml
mapdeal build --cloud examples/clouds/ramp.pcd -o out/ramp.yaml
mapdeal build --world examples/worlds/storage.sdf -o out/w.yaml --height 0.2""",
)  # fmt: skip
def build(
    log: Annotated[Path | None, Words("LOG")] = None, *, work: InShell, output: Path,
    clouds: Annotated[list[str] | None, Words("FILE", name="cloud")] = None,
    world: Annotated[Path | None, Words("FILE")] = None,
    model_path: Annotated[Sequence[Path], Words("DIR", typed=list[Path])] = (),
    poses: Annotated[Path | None, Words("FILE")] = None,
    angles: Annotated[Path | None, Words("FILE")] = None,
    ranges: Annotated[Path | None, Words("FILE")] = None, flip_y: bool = False, topics: Topics = (),
    deskew: bool = False, method: mapping.Method | None = None, compare: bool = False,
    resolution: Annotated[float | None, Words("R")] = None,
    size: Annotated[Point | None, Words("WX,WY")] = None,
    origin: Annotated[tuple[float, ...] | None, Words("X,Y[,YAW]")] = None,
    range_min: Annotated[float, METRES] = 0.0, range_max: Annotated[float, METRES] = 30.0,
    clear_max: Annotated[float, METRES] = 0.0, as_written: bool = False,
    layers: Annotated[Path | None, Words("OUT.npz")] = None,
    max_bad: Annotated[int, AT_LEAST_0, Words("N")] = DEFAULT_MAX_BAD, **more: Any,
) -> GridResult | Comparison:  # fmt: skip
    """Make a map from laser scans with known poses, from point clouds, or from a simulated world.

    With a bag, the poses come from its transforms or its odometry.

    Cells that a beam passes become free, and cells where a beam ends become occupied; cells that
    no beam reaches stay unknown. --compare shows the map that each method makes from a log.

    With --cloud the floor of a point cloud, with ramps and low steps, becomes free, and objects on
    it, up to the height of the robot, become occupied.

    With --world the map shows the solids of a simulated world: at --height, as a lidar sees them,
    or as far as a robot of --robot-height hits them.

    Parameters
    ----------
    log : path, optional
        A CARMEN log (also .gz), an .npz of scans, or a bag of ROS 1 or ROS 2.
    clouds : list of str, optional
        A cloud instead of a LOG: .pcd, .ply, .xyz, .txt, .csv, .asc, .npy, .npz, or a bag; can be
        repeated, or a folder, or a quoted pattern.
    world : path, optional
        A world, model or mesh instead of a LOG: .sdf, .world, .urdf, .stl, .obj or .dae.
    model_path : sequence of path
        With --world: folder with the models that it includes; can be repeated.
    poses : path, optional
        Text file with one x,y,yaw per scan; with a bag, the robot's poses, one t x y z qx qy qz
        qw per line, instead of transforms; with --cloud, either of them, for each cloud.
    angles : path, optional
        Text file with the angles of the beams, radians.
    ranges : path, optional
        Text file with the ranges of one scan per line, metres.
    flip_y : bool
        With --poses: the y axis of the poses points to the right.
    topics : sequence of str
        With a bag: topic to read, if there are several; can be repeated.
    deskew : bool
        With a bag: use the pose at the time of each beam (time_increment).
    method : {'log-odds', 'counting', 'tsdf'}, optional
        How evidence becomes a map. [default: log-odds]
    compare : bool
        Run all methods on one grid, and compare maps and figures, with pictures.
    resolution : float, optional
        Side of a cell, metres. [default: 0.05; with --cloud the spacing of its points, if larger]
    size : tuple of float, optional
        Extent along x and y, metres. [default: what contains all scans]
    origin : tuple of float, optional
        With --size: the lower left corner, metres; with --world also the yaw, radians.
    range_min : float
        Shorter readings are ignored, metres; with --cloud, points nearer to the sensor.
    range_max : float
        Readings at or above this range have hit nothing, metres.
    clear_max : float
        Range up to which beams without a hit clear cells, metres; 0 clears none.
    as_written : bool
        tsdf: make the map of design document 004: only walls, where the distance changes its sign
        along y; beams continue 3 truncation distances behind a hit.
    layers : path, optional
        Also write the map with its evidence.
    max_bad : int
        Malformed lines of a log to tolerate.
    **more
        Parameters of the method, and of `FrameOptions`, `CloudOptions` and `WorldOptions`.
    """
    cell_size = 0.05 if resolution is None else resolution
    frames, cloud_options = pop_parameters(more, FrameOptions), pop_parameters(more, CloudOptions)
    world_options = pop_parameters(more, WorldOptions)
    beam_options = {"range_max": (range_max, 30.0), "clear_max": (clear_max, 0.0),
                    "max_bad": (max_bad, DEFAULT_MAX_BAD)}  # fmt: skip
    changed = {name: value for name, (value, default) in beam_options.items() if value != default}
    if world is not None:
        refuse("does not apply to worlds", log=log, cloud=clouds, poses=poses, angles=angles,
               ranges=ranges, flip_y=flip_y, topics=topics, deskew=deskew, method=method,
               compare=compare, as_written=as_written, layers=layers, **frames, **more,
               range_min=range_min or None, **changed)  # fmt: skip
        return build_from_world(world, output, work, options=WorldOptions(**world_options),
                                robot_options=cloud_options, model_path=model_path,
                                resolution=cell_size, size=size, origin=origin)  # fmt: skip
    refuse("applies to worlds: it needs --world", model_path=model_path, **world_options)
    if clouds:
        refuse("applies to laser scans, not to clouds", log=log, angles=angles, ranges=ranges,
               flip_y=flip_y, deskew=deskew, method=method, compare=compare, as_written=as_written,
               **changed, **more)  # fmt: skip
        return build_from_clouds(clouds, output, work, options=CloudOptions(**cloud_options),
                                 resolution=resolution, size=size, origin=origin, layers=layers,
                                 range_min=range_min, poses=poses, topics=topics,
                                 frames=frames)  # fmt: skip
    refuse("applies to clouds: it needs --cloud", **cloud_options)
    chosen: dict[mapping.Method, dict[str, Any]] = {method or "log-odds": more}
    if compare:
        refuse("cannot be given together with --compare", method=method,
               values=more.get("values"), layers=layers, image=work.settings.image)  # fmt: skip
        chosen = {method: {name: more[name] for name in parameters_of(kind) if name in more}
                  for method, kind in mapping.METHODS.items()}  # fmt: skip
    if as_written:
        chosen["tsdf" if compare else next(iter(chosen))]["as_written"] = True
    limits = BeamLimits(range_min, range_max, clear_max)
    building = _Building(chosen, limits, cell_size, mapping.frame_of(size, origin, cell_size))
    with ExitStack() as stack:
        if log is not None:
            texts = {"angles": angles, "ranges": ranges, "flip_y": flip_y}
            if kinds.is_bag(log):
                refuse("does not apply to bags", **texts)
                frames["poses"] = poses
            else:
                refuse("cannot be given together with a LOG", poses=poses, **texts)
            opened = _opened(log, topics, frames, deskew=deskew, max_bad=max_bad)
            source = stack.enter_context(opened)
        else:
            refuse("needs a bag for LOG", topics=topics, **frames, deskew=deskew)
            if poses is None or angles is None or ranges is None:
                rule = "must be given, or all of --poses, --angles and --ranges"
                raise ParameterError(rule, source="LOG")
            source = ScanTexts(poses, angles, ranges, flip_y=flip_y)
        passes = 2 if size is None else 1
        advance = stack.enter_context(work.counted(source.preparation + passes * source.count))
        if compare:
            return _compared(source, output, building, work, advance)
        if layers is not None:
            check_ends_in_npz(layers)
        work.outputs += [*reading.output_paths(output), *([layers] if layers is not None else [])]
        transaction = work.begin(source.files)
        built = _built(source, building, with_layers=layers is not None, advance=advance)
    reading.write_grid(transaction, output, built.grid)
    if layers is not None:
        transaction.write(layers, lambda file: write_npz(file, built.grid, more=built.layers))
    (method,) = building.methods
    title, figures = f"{output.stem}: map, {method}", asdict(built.counts)
    return GridResult(built.grid, title, figures=figures, notes=[_beams_line(figures)])


def _compared(
    source: ScanSource, folder: Path, building: _Building, work: Work, advance: Advance
) -> Comparison:
    need_folder(folder)
    methods = combinations(building.methods, 2)
    pairs = {(first, second): folder / f"{first}_{second}.png" for first, second in methods}
    maps = {method: folder / f"{method}.yaml" for method in building.methods}
    for path in maps.values():
        work.outputs += [*reading.output_paths(path), path.with_suffix(".png")]
    work.outputs += [*pairs.values(), folder / DOCUMENT]
    transaction = work.begin(source.files)
    builders, seconds = _builders(source, building, _COMPARE_BYTES_PER_CELL, advance)
    first_builder = next(iter(builders.values()))
    counts, (hit_cells, groups) = first_builder.counts, first_builder.hit_groups()
    del first_builder  # which would keep its memory
    bytes_per_cell = {method: builder.bytes_per_cell for method, builder in builders.items()}
    results: dict[mapping.Method, mapping.BuiltMap] = {}
    # the method with the largest evidence comes first, so that its memory is free for the others
    for method in sorted(builders, key=lambda method: -bytes_per_cell[method]):
        started = time.perf_counter()
        results[method] = builders.pop(method).result(with_layers=False)
        seconds[method] += time.perf_counter() - started
    results = {method: results[method] for method in bytes_per_cell}
    grid = next(iter(results.values())).grid
    _warn_if_unknown(grid, source.named)
    name = Path(source.named.name.removesuffix(".gz")).stem
    for method, built in results.items():
        reading.write_grid(transaction, maps[method], built.grid)
        label = f"{count_text(len(built.vanished), 'group')} of hits vanished"
        rings = RingOverlay(built.vanished.middles_xy(grid.frame), "hits that vanished", label)
        path, title = maps[method].with_suffix(".png"), one_line(f"{name}: {method}")
        write_picture(transaction, path, built.grid, title, work.settings, rings)
    pair_figures = []
    for pair, path in pairs.items():
        first, second = (states_of(results[method].grid.occupancy) for method in pair)
        table = confusion_of(first, second)[:3, :3]
        rows = (dict(zip(_STATES, row, strict=True)) for row in table.tolist())
        named: Figures = {"first": pair[0], "second": pair[1]}
        named |= {"differing": int(table.sum() - table.trace())}
        pair_figures.append({**named, "cells": dict(zip(_STATES, rows, strict=True))})
        title = one_line(f"{name}: {pair[0]} and {pair[1]}")
        look = {"title": title, "image_extent": work.settings.image_extent, "only_in": pair}
        transaction.write(path, partial(_draw_changes, first, second, grid.frame, look))
    document = {
        "format": _FORMAT, "version": __version__, "inputs": [file.name for file in source.files],
        "limits": asdict(building.limits), "width": grid.shape[1], "height": grid.shape[0],
        "resolution": grid.resolution, "origin": list(grid.origin), **asdict(counts),
        "cells_hit_three_times": hit_cells, "groups_hit_three_times": len(groups),
        "methods": {
            method: {"parameters": mapping.all_parameters(method, building.methods[method]),
                     **_method_figures(built, bytes_per_cell[method])}
            for method, built in results.items()
        },
        "pairs": pair_figures,
    }  # fmt: skip
    transaction.write_bytes(folder / DOCUMENT, encode_json(document))
    for method, figures in document["methods"].items():
        figures["seconds"] = round(seconds[method], 4)  # not in the file, which is the same again
    return Comparison(document, folder)


def _draw_changes(first: Bytes, second: Bytes, frame: Frame, look: Any, file: BinaryIO) -> None:
    changes = changes_of(first, second, np.ones(first.shape, dtype=np.bool_))
    image = difference_image(changes, frame, **look)
    png.write_png(file, image.indices, image.palette)


def _method_figures(built: mapping.BuiltMap, bytes_per_cell: int) -> Figures:
    grid, vanished = built.grid, built.vanished
    middles = vanished.middles_xy(grid.frame)[:_MOST_VANISHED].tolist()
    counts = grid.figures()
    thickness = components.thickness_of(grid.occupancy == OCCUPIED)
    one_wide = int(np.count_nonzero(thickness == 1))
    share = mean = mean_m = None
    if len(thickness):
        share = round(one_wide / len(thickness), 6)
        exact = float(thickness.mean())
        mean, mean_m = round(exact, 6), round(exact * grid.resolution, 6)
    figures: Figures = {state: counts[state] for state in _STATES}
    figures |= {"one_cell_wide": one_wide, "one_cell_wide_share": share}
    figures |= {"mean_thickness_cells": mean, "mean_thickness_m": mean_m}
    figures |= {"vanished_groups": len(vanished), "vanished_cells": len(vanished.cells)}
    figures["vanished"] = [
        {"x": round(x, 4), "y": round(y, 4), "cells": cells}
        for (x, y), cells in zip(middles, vanished.sizes.tolist(), strict=False)
    ]
    size = bytes_per_cell * grid.occupancy.size
    return {**figures, "bytes_per_cell": bytes_per_cell, "memory_bytes": size}
