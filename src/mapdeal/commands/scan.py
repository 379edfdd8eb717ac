"""``mapdeal scan``: the laser log that a robot would record on a map."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextvars import copy_context
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal import command as definitions, records
from mapdeal.command import ABOVE_0, AT_LEAST_0, AT_LEAST_1, METRES, POSE, RADIANS, Condition, Words
from mapdeal.commands.graph import graph_of
from mapdeal.commands.reach import RobotOption, StartOption
from mapdeal.compatibility import Unpack
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning, strict_warnings
from mapdeal.files.json_values import read_document
from mapdeal.files.source import claim
from mapdeal.grid import reach, values
from mapdeal.grid.footprint import FootprintLike
from mapdeal.mapping import evidence, transforms
from mapdeal.mapping.scanner import Scanner, Surroundings, noisy_odometry
from mapdeal.maps.listing import list_maps
from mapdeal.maps.npz import write_arrays
from mapdeal.pictures import canvas, layers
from mapdeal.pictures.overlay import RouteOverlay
from mapdeal.pipeline import batch, inputs
from mapdeal.planning.graph_drafts import GraphOptions
from mapdeal.planning.tours import driven, tour_of
from mapdeal.sensors.points import read_poses
from mapdeal.sensors.scans import ScanArrays, carmen_lines

LogFormat = Literal["npz", "log", "mcap", "db3"]

_BAGS = (".mcap", ".db3")
_PER_CELL = 24.0  # bytes for each cell of distances and of walls that are seen
_PER_READING = 9
_COVER = 1.5  # metres from each place that the robot reaches to a possible viewpoint
_TURN = 1.0  # radians that a robot turns at least at viewpoints: its beams sweep all gaps
_BETWEEN = 1.0  # metres between the places from which all visible walls are looked for
_FIELD = Condition("at most a full turn, 6.2832", lambda value: value <= 2 * math.pi + 1e-3)
_RATE = Condition("between 0.001 and 10000", lambda value: 0.001 <= value <= 10_000)
_BEAMS = Condition("between 2 and 99999", lambda value: 2 <= value <= 99_999)
_MOUNT = Words("X,Y,YAW", lambda text: inputs.numbers_of(text, "X,Y,YAW"))
_SHARE = Condition("between 0 and 1", lambda value: 0 <= value <= 1)


def _paths(output: Path) -> Iterable[Path]:
    if output.suffix in _BAGS:
        from mapdeal.bags.bag import bag_paths, import_rosbags

        import_rosbags(output, "rosbags.typesys", "rosbags.rosbag2")
        return bag_paths(output)
    if output.suffix not in (".npz", ".log"):
        rule = "must end in .npz, .log, .mcap or .db3"
        raise ParameterError(rule, source="--output", got=str(output))
    return [output]


@records.dataclass(frozen=True, eq=False, repr=False)
class SimulatedScans(definitions.Result):
    """Scans of a simulated laser scanner on a map, and the run that they are from.

    Parameters
    ----------
    map : MapInput
        The map.
    scans : Scans
        Poses of the scanner, angles and ranges, which `build_map` takes.
    robot_poses : numpy.ndarray of float64, shape (N, 3)
        x, y (metres) and yaw (radians) of the robot at each scan.
    scanner : Scanner
        The scanner.
    rate : float
        Scans per second; the first is made after one period.
    odom_noise : float
        Standard deviation of the odometry after one metre and after one radian.
    visible_count, seen_count : int, optional
        For a tour: number of wall cells in sight of where the robot gets, and of those seen.
    """

    map: inputs.MapInput
    scans: evidence.Scans
    robot_poses: NDArray[np.float64]
    scanner: Scanner
    rate: float
    odom_noise: float
    visible_count: int | None = None
    seen_count: int | None = None

    @property
    def length(self) -> float:
        """Length of the way, metres."""
        return float(np.hypot(*np.diff(self.robot_poses[:, :2], axis=0).T).sum())

    def document(self) -> dict[str, Any]:
        ranges, count = self.scans.ranges, len(self.robot_poses)
        hits, no_return = int(np.isfinite(ranges).sum()), int(np.isposinf(ranges).sum())
        return {
            "scans": count, "beams": ranges.size, "hits": hits, "no_return": no_return,
            "too_near": ranges.size - hits - no_return, "length_m": round(self.length, 3),
            "duration_s": round(count / self.rate, 3),
            "visible_wall_cells": self.visible_count, "seen_wall_cells": self.seen_count,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        figures = self.document()
        text = f"{values.count_text(figures['scans'], 'scan')} of {self.scanner.beams} beams along "
        text += f"{self.length:.2f} m in {figures['duration_s']:g} s: {figures['hits']} hits, "
        yield f"{text}{figures['no_return']} without return, {figures['too_near']} too near"
        if self.visible_count is not None:
            share = 100 * (self.seen_count or 0) / max(self.visible_count, 1)
            yield f"  sees {share:.2f} % of {self.visible_count} visible wall cells"

    def summary(self, output: Path) -> Iterator[str]:
        first, *more = self.lines()
        yield from (f"{output}: {first}", *more)

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        """Return the robot's way over the map."""
        line = self.robot_poses[:, :2]
        start, goal = ((float(x), float(y)) for x, y in line[[0, -1]])
        overlay = RouteOverlay(reach.Route("graph", True, start, goal, line, self.length))
        look |= {"title": title or f"{self.map.title}: simulated scans", "overlay": overlay}
        return layers.occupancy_image(self.map.occupancy, **look)

    def write(self, transaction: Any, output: Path) -> None:
        """Write the log: .npz, a CARMEN .log, or a bag of ROS 2."""
        scans, scanner = self.scans, self.scanner
        if output.suffix == ".npz":
            fields = {"poses": scans.poses, "angles": scans.angles, "ranges": scans.ranges}
            transaction.write(output, lambda file: write_arrays(file, fields))
        elif output.suffix == ".log":
            times = np.arange(1, len(self.robot_poses) + 1) / self.rate
            arrays = ScanArrays(scans.poses, scans.angles, scans.ranges)
            lines = carmen_lines(arrays, times, self.robot_poses, scanner.range_max)
            transaction.write_parts(output, lines)
        else:
            from mapdeal.bags.messages import SimulatedRun, write_run

            run = SimulatedRun(
                self.map.occupancy, self.rate, *noisy_odometry(self.robot_poses, self.odom_noise),
                scanner.mount, scanner.first_angle, scanner.step, scans.ranges,
                (scanner.range_min, scanner.range_max),
            )  # fmt: skip
            write_run(transaction, output, run)


def scan(
    map: inputs.Map,  # noqa: A002 - what it is
    *,
    poses: Annotated[Any, Words("FILE", typed=Path)] = None,
    route: Annotated[Any, Words("ROUTE.json", typed=Path)] = None,
    tour: bool = False,
    start: StartOption = None,
    speed: Annotated[float, ABOVE_0, Words("M/S")] = 0.5,
    rate: Annotated[float, _RATE, Words("HZ")] = 10.0,
    range_max: Annotated[float, ABOVE_0, METRES] = 30.0,
    range_min: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    fov: Annotated[float, ABOVE_0, _FIELD, RADIANS] = 2 * math.pi,
    beams: Annotated[int, _BEAMS, Words("N")] = 360,
    sensor_at: Annotated[tuple[float, ...], POSE, _MOUNT] = (0.0, 0.0, 0.0),
    noise: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    dropout: Annotated[float, _SHARE, Words("P")] = 0.0,
    odom_noise: Annotated[float, AT_LEAST_0, Words("SIGMA")] = 0.0,
    through_unknown: bool = False,
    footprint: FootprintLike | None = None,
    robot: RobotOption = None,
    **reading: Unpack[inputs.Reading],
) -> SimulatedScans:
    """Simulate the laser scans of a robot that drives through a map, as ``mapdeal scan`` does.

    Parameters
    ----------
    map : path, str or grid
        The map.
    poses : path, str or array of shape (N, 3), optional
        File of the robot's poses, one per scan: x y yaw, or t x y z qx qy qz qw, t being unused.
    route : path, str or Route, optional
        Route to drive along, as the command route writes it.
    tour : bool
        Drive along a closed tour past all visible walls.
    start : tuple of float, optional
        With a tour: start, from which the robot reaches the area to tour, metres; by default from
        the widest place of the largest free area.
    speed : float
        Speed along a route or tour, metres per second.
    rate : float
        Scans per second.
    range_max : float
        Range from which beams have no return, metres.
    range_min : float
        Range below which readings are too near, metres.
    fov : float
        Field of view, ahead in its middle, radians. [default: a full turn]
    beams : int
        Beams of a scan.
    sensor_at : tuple of float
        Pose of the scanner on the robot, metres and radians.
    noise : float
        Standard deviation of ranges, metres.
    dropout : float
        Share of beams that are lost, from 0 to 1.
    odom_noise : float
        In bags: standard deviation of the odometry after one metre, and after one radian; it grows
        with the square root of the distance.
    through_unknown : bool
        Beams and tours may pass unknown cells; by default beams end there without a return.
    footprint, robot : Footprint, RobotParameters, optional
        With a tour: the robot's shape and own parameters.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to a file.

    Returns
    -------
    SimulatedScans
        The scans, as `SimulatedScans.scans`, and the poses of the robot.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read, or no pose lies in free space.
    ParameterError
        If not exactly one of poses, route and tour is given, or range_max is not above range_min.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> room = OccupancyGrid([[100] * 9, *[[100] + [0] * 7 + [100]] * 5, [100] * 9], 0.25)
    >>> found = scan(room, poses=[[1.0, 1.0, 0.0]], beams=720)
    >>> round(float(found.scans.ranges[0, 360]), 6)  # straight ahead
    1.0
    >>> found.scans.poses.shape, found.scans.angles.shape
    ((1, 3), (720,))
    """
    sources = {"poses": poses is not None, "route": route is not None, "tour": tour}
    if sum(sources.values()) != 1:
        hint = "--tour drives past all visible walls"
        raise ParameterError("exactly one of these is needed", place=", ".join(sources), hint=hint)
    kinds = {"poses": (poses, Sized, "poses"), "route": (route, reach.Route, "a Route")}
    for key, (value, kind, noun) in kinds.items():
        if value is not None and not isinstance(value, (str, PathLike, kind)):
            raise ParameterError(f"must be a file or {noun}", place=key, got=value)
    if not tour:
        inputs.refuse("applies to a tour", start=start, footprint=footprint, robot=robot)
    numbers = {
        "speed": speed, "rate": rate, "range_min": range_min, "range_max": range_max, "fov": fov,
        "beams": beams, "noise": noise, "dropout": dropout, "odom_noise": odom_noise,
    }  # fmt: skip
    for key, value in numbers.items():
        definitions.parameters_of(scan)[key].accept(value)
    evidence.BeamLimits(range_min, range_max)
    mount = transforms.check_pose(sensor_at, "sensor_at")
    scanner = Scanner(range_min, range_max, fov, beams, noise, dropout, mount)
    files = [Path(file) for file in (poses, route) if isinstance(file, (str, PathLike))]
    also = [*files, *(robot.paths if robot else ())]
    (source,) = inputs.open_inputs(map, names=("map",), also=also, **reading)
    inputs.claim_cells(source, _PER_CELL, measures=True)
    around = Surroundings(source.occupancy, through_unknown)
    is_hit, is_visible = np.zeros((2, around.cells), dtype=np.bool_)
    if poses is not None:
        if files:
            robot_poses = read_poses(files[0])
        else:
            robot_poses = evidence.Scans(poses, np.empty(0), np.empty((len(poses), 0))).poses.copy()
        robot_poses[:, 2] = np.unwrap(robot_poses[:, 2])
    elif tour:
        planned = graph_of(
            source, GraphOptions(cover=_COVER), start=start, through_unknown=through_unknown,
            footprint=footprint, robot=robot,
        )  # fmt: skip
        cells = around.cells
        # walls that beams only graze can be lost in a map: viewpoints also cover all the faces
        sights = around.sights(planned.graph.points_xy, range_max)
        in_sight = [np.concatenate([walls, faces + cells]) for walls, faces in sights]
        step = max(1, round(_BETWEEN / source.grid.resolution))
        reachable = np.argwhere(planned.reach.reachable[::step, ::step]) * step
        places = planned.reach.frame.xy_from_rowcol(reachable)
        for walls in (*in_sight, *(walls for walls, _ in around.sights(places, range_max))):
            is_visible[walls[walls < cells]] = True
        tour_line = tour_of(planned.graph, in_sight, 2 * cells)
        pace: Any = {"speed": speed, "rate": rate, "turn": max(_TURN, 2 * math.pi - fov)}
        robot_poses = driven(*tour_line, **pace)
    else:
        line = read_document(files[0])["points"].points() if files else route.points_xy
        if not len(line):
            rule = "has no points: its goal is not reached"
            raise MalformedInputError(rule, source=files[0] if files else "route", place="points")
        robot_poses = driven(line, np.zeros(len(line), np.bool_), speed=speed, rate=rate)
    count = len(robot_poses) * beams
    with source.settings.reading():
        claim(source.name, _PER_READING * count, what=f"{count} readings of scans")
    blocked = np.flatnonzero(~around.is_open(scanner.poses_of(robot_poses)))
    if len(blocked):
        name, rule = files[0] if files else source.name, "poses of the scanner lie in obstacles"
        text = f"{len(blocked)} of {len(robot_poses)} {rule}, in unknown cells or outside the map"
        if len(blocked) == len(robot_poses):
            raise MalformedInputError(text, source=name)
        text += f", the first of them pose {blocked[0] + 1}: they see nothing"
        emit_warning(f"{name}: {text}")
    scans = scanner.scans(around, robot_poses, is_hit if tour else None)
    counts = [int(mask.sum()) for mask in (is_visible | is_hit, is_hit)] if tour else []
    return SimulatedScans(source, scans, robot_poses, scanner, rate, odom_noise, *counts)


@records.dataclass(frozen=True)
class _ScanRun(batch.BatchWork):
    log_format: LogFormat
    parameters: Mapping[str, Any]

    def __call__(self, job: batch.Job) -> _Log:
        if job.error is not None:
            raise job.error
        return copy_context().run(self._write, job)  # because it changes the context

    def _write(self, job: batch.Job) -> _Log:
        settings, robot = self.settings, self.parameters.get("robot")
        inputs.Work.current.set(None)  # the shell's settings apply to the batch, not to a map
        output = job.folder.with_name(f"{job.folder.name}.{self.log_format}")
        files = [job.path, *(robot.paths if robot else ())]
        with (
            settings.reading(anew=True),
            strict_warnings(settings.strict, job.path),
            inputs.outputs_of([*_paths(output)], files, settings) as transaction,
        ):
            limits: Any = {"dialect": settings.dialect, "max_cells": settings.max_cells}
            scans = scan(job.path, **self.parameters, **limits)
            scans.write(transaction, output)
        return _Log(scans.document(), [*scans.summary(output)])


@records.dataclass(frozen=True)
class _Log(definitions.Result):
    figures: dict[str, Any]
    texts: list[str]
    status: ClassVar[str] = "done"

    def document(self) -> dict[str, Any]:
        return {"scan": self.figures}

    def lines(self) -> list[str]:
        return self.texts


class ScanLogs(batch.Batch):
    is_brief = True
    resuming = "--force replaces their logs"

    def lines(self) -> Iterator[str]:
        for outcome in self.outcomes:
            if outcome.status == "done":
                yield from outcome.result.lines()
        yield f"{self.output}: {self.count('done')} done, {self.count('failed')} failed"


@definitions.command(
    name="scan",
    group="Laser scans and point clouds",
    output=definitions.Output(
        "LOG", "Where to write the scans: .npz, .log (CARMEN), .mcap, or a folder .db3; for "
        "several maps a folder.", streams=False,
    ),
    shared=("robot", "files"),
    also={"": scan},
    example="""\
mapdeal scan examples/maps/office.yaml --tour --robot-radius 0.22 \\
    --range-max 8 -o out/scans.npz --image out/scans.png
mapdeal scan examples/maps/office.yaml --tour --robot-radius 0.22 --rate 2 \\
    --noise 0.01 --odom-noise 0.02 -o out/scans.mcap""",
)  # fmt: skip
def scan_maps(
    sources: Annotated[Sequence[Path], Words("MAP...", typed=list[Path], streams=True)], *,
    work: inputs.InShell, output: Path,
    log_format: Annotated[LogFormat | None, Words(name="format")] = None,
    jobs: Annotated[int | None, AT_LEAST_1, Words("N", short="j")] = None, **parameters: Any,
) -> SimulatedScans | ScanLogs:  # fmt: skip
    """Simulate the laser scans of a robot that drives through a map.

    Beams are exact: they end where they enter an obstacle. The poses come from a file, a route, or
    a tour: a closed path along the robot's route graph past viewpoints that see all walls visible
    from its nodes, if possible not at grazing angles. The seed of the noise is fixed. Bags have
    /scan, /tf (map, odom, base_link, laser), /odom and /map.

    Several maps, or those of a folder, a quoted pattern or @LIST.txt, get a tour and a log each.

    Parameters
    ----------
    sources : sequence of path
        Maps, folders, quoted patterns, or @LIST.txt.
    log_format : {'npz', 'log', 'mcap', 'db3'}, optional
        Format of the logs of several maps. [default: npz]
    jobs : int, optional
        Number of maps to scan at the same time, each in a process. [default: the cores]
    **parameters
        As for `scan`.
    """
    listing = list_maps(map(str, sources), output, work.terminal.input_chunks, lists_empty=True)
    if not listing.is_set and len(listing.maps) == 1:
        inputs.refuse("applies to several maps", log_format=log_format, jobs=jobs)
        work.outputs += _paths(output)
        scans = scan(listing.maps[0].path, **parameters)
        scans.write(work.begin(), output)
        return scans
    if "tour" not in parameters:
        rule = "is required for several maps: poses and routes are those of one"
        raise ParameterError(rule, source="--tour")
    inputs.refuse("applies to one map", image=work.settings.image)
    inputs.need_folder(output)
    listing.print_notes(work.terminal, "scanned")
    scan_jobs = batch.jobs_of(listing.maps, output, ())
    size = batch.jobs_at_once(jobs, len(scan_jobs), work.terminal)
    run = _ScanRun(work.settings, log_format or "npz", parameters).sharing(size)
    workers: batch.Workers | None = None
    if size > 1:
        from mapdeal.pipeline.workers import ProcessWorkers  # slow to import

        workers = ProcessWorkers(size)
    return batch.run_and_report(scan_jobs, output, run, ScanLogs, work.terminal, workers=workers)
