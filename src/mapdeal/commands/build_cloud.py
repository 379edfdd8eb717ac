"""``mapdeal build --cloud``: maps from point clouds, a part of ``mapdeal build``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.commands.pack import GridResult
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import check_state, claim, is_same_file, state_of
from mapdeal.grid.frame import Figures, Point
from mapdeal.grid.values import OCCUPIED, decimal_text
from mapdeal.kernels.rotations import from_yaw, rotated
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.build import frame_of
from mapdeal.mapping.cloud_map import CloudMap, CloudMapper, CloudOptions
from mapdeal.mapping.transforms import FrameOptions
from mapdeal.mapping.voxels import FINEST, Tilt, away_from_sensor, upright
from mapdeal.maps.kinds import is_bag
from mapdeal.maps.listing import list_files
from mapdeal.maps.npz import check_ends_in_npz, write_npz
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pipeline.inputs import Work, errors_named, refuse
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.clouds import CLOUD_SUFFIXES, cloud_chunks
from mapdeal.sensors.points import has_times, read_poses, read_trajectory

Points = NDArray[np.float64]
Advance = Callable[[int], object]

_TILTED = 1.0  # degrees of tilt that are worth a warning
_COARSE = 3.0  # times the climb: clearance that is worth a warning
_KIB, _OF_POINT = 1024, 16  # bytes that a point has in most files: for the progress
_OF_SCAN = 200  # bytes for each point of a cloud whose beams are followed
_LIBRARIES = 8_000_000  # bytes of parts of scipy


class _Placed(NamedTuple):
    """One cloud, and where the sensor was: a translation and a quaternion, if that is known."""

    chunks: Callable[[Advance], Iterator[Points]]
    move: Points | None
    turn: Points | None

    def points(self, range_min: float, advance: Advance) -> Iterator[tuple[Points, int]]:
        """Yield points in the frame of the map, and how many were too near to the sensor."""
        for chunk in self.chunks(advance):
            if chunk.shape[1] < 3:
                raise MalformedInputError("the cloud has no heights: points need x, y and z")
            points = away_from_sensor(chunk[:, :3], range_min)
            if self.move is not None and self.turn is not None:
                with np.errstate(invalid="ignore", over="ignore"):
                    points = rotated(self.turn, points) + self.move
            yield points, len(chunk) - len(points)


class _Clouds(NamedTuple):
    named: Path
    files: tuple[Path, ...]
    steps: int  # of one pass, for the progress
    placed: Callable[[], Iterator[_Placed]]
    places: Points | None = None  # of a robot, if clouds have no places of their own
    has_places: bool = False


def _of_files(names: Sequence[str], poses: Path | None) -> _Clouds:
    paths = list_files(names, CLOUD_SUFFIXES, not_in_folders=(".txt",))
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
            turns = from_yaw(planar[:, 2])
        if len(paths) == 1:
            places = moves  # of the robot in a map
        elif len(moves) != len(paths):
            rule = f"must have a pose for each of {len(paths)} clouds"
            raise MalformedInputError(rule, source=poses, got=len(moves))
        else:
            sensors = list(zip(moves, turns, strict=True))
    states = {path: state_of(path) for path in paths}

    def read(path: Path, advance: Advance) -> Iterator[Points]:
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

    def read(number: int, advance: Advance) -> Iterator[Points]:
        yield bag.points(number)
        advance(1)

    def placed() -> Iterator[_Placed]:
        for number in numbers.tolist():
            move, turn = posed.translations[number], posed.quaternions[number]
            yield _Placed(partial(read, number), move, turn)

    return _Clouds(path, bag.files, len(numbers), placed, has_places=True)


def _mapped(
    clouds: _Clouds, options: CloudOptions, resolution: float | None,
    size: Point | None, origin: Sequence[float] | None, range_min: float, advance: Advance,
) -> CloudMap:  # fmt: skip
    frame = frame_of(size, origin, FINEST if resolution is None else resolution)

    def claim_for_map(count: int, text: str) -> None:
        claim(clouds.named, _LIBRARIES + count, what=text, hint="--size and --origin bound the map")

    mapper = CloudMapper(options, resolution=resolution, frame=frame, claim=claim_for_map)
    with errors_named(clouds.named):
        if options.level:
            tilt = Tilt()
            for cloud in clouds.placed():
                for points, _ in cloud.points(range_min, advance):
                    tilt.add(upright(points, options.up))
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
    for text in _warnings_on(cloud_map, options):
        emit_warning(f"{clouds.named}: {text}")
    return cloud_map


def _warnings_on(cloud_map: CloudMap, options: CloudOptions) -> Iterator[str]:
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


def _notes_on(figures: Figures) -> Iterator[str]:
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
    if len(names) == 1 and is_bag(Path(names[0])):
        return _of_bag(Path(names[0]), topics, frames, stack)
    return _of_files(names, frames.poses)


def build_from_clouds(
    names: Sequence[str], output: Path, work: Work, *, options: CloudOptions,
    resolution: float | None, size: Point | None, origin: Sequence[float] | None,
    layers: Path | None, range_min: float, poses: Path | None, topics: Sequence[str],
    frames: dict[str, Any],
) -> GridResult:  # fmt: skip
    frame_of(size, origin, resolution or FINEST)  # checks the options before anything is read
    if layers is not None:
        check_ends_in_npz(layers)
    if not (len(names) == 1 and is_bag(Path(names[0]))):
        refuse("needs a bag for --cloud", topics=tuple(topics), **frames)
    with ExitStack() as stack:
        clouds = _clouds_of(names, topics, FrameOptions(poses=poses, **frames), stack)
        work.outputs += [*output_paths(output), *([layers] if layers is not None else [])]
        transaction = work.begin(clouds.files)
        with work.counted((1 + options.level + clouds.has_places) * clouds.steps) as advance:
            cloud_map = _mapped(clouds, options, resolution, size, origin, range_min, advance)
    write_grid(transaction, output, cloud_map.grid)
    if layers is not None:
        transaction.write(layers, partial(write_npz, grid=cloud_map.grid, more=cloud_map.layers))
    title, figures = f"{output.stem}: map of a cloud", cloud_map.figures()
    return GridResult(cloud_map.grid, title, figures=figures, notes=[*_notes_on(figures)])


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
        If a cloud cannot be read, has no heights, or no floor is found in it.

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
    pose_file = None if poses is None else Path(poses)
    with settings.reading(), use_threads(settings.threads), ExitStack() as stack:
        clouds = _clouds_of(names, topics, FrameOptions(poses=pose_file), stack)
        return _mapped(clouds, cloud_options, resolution, size, origin, range_min, lambda _: None)
