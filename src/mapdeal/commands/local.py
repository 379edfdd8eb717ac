"""``mapdeal local``: local maps from point clouds, and windows of a global map."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from mapdeal.command import POINT, Output, Words, command
from mapdeal.commands.route import route_document, warn_of_border
from mapdeal.errors import FindingError, ParameterError, emit_warning, strict_warnings
from mapdeal.files.transaction import Transaction
from mapdeal.grid import frame, reach
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.mapping.local_map import LocalOptions
from mapdeal.mapping.transforms import FrameOptions, Topics, check_pose
from mapdeal.maps import kinds, reading
from mapdeal.pictures.overlay import Overlay, RouteOverlay, StepsOverlay
from mapdeal.pipeline import batch, local as local_maps, run
from mapdeal.pipeline.folder import rounded, rounded_place, step_line, write_picture
from mapdeal.pipeline.inputs import InShell, Work, pop_parameters, refuse
from mapdeal.pipeline.local import LocalCommon, LocalJob
from mapdeal.pipeline.recipe import Changes, RecipeName, load_recipe
from mapdeal.pipeline.settings import adding_warnings
from mapdeal.planning.routes import Terrain, route_in_window, shortest_over
from mapdeal.records import dataclass
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import has_times

ROUTE, PICTURE, STEPS = "route.json", "route.png", "routes.json"


class LocalMaps(batch.Batch):
    noun = "cloud"
    is_brief = True

    def lines(self) -> Iterator[str]:
        done, unchanged = self.count("done"), self.count("unchanged")
        text = f"{self.output}: {done} done, {unchanged} unchanged, {self.count('failed')} failed"
        rate = f", {done / self.seconds:.3g} maps a second" if done == len(self.jobs) else ""
        yield text + rate


class Costmaps(LocalMaps):
    noun = "costmap"


def _nanoseconds(text: str) -> int:
    number = Decimal(text) if re.fullmatch(r"[0-9]{1,10}(\.[0-9]{0,9})?", text) else Decimal(0)
    if number <= 0:
        raise ParameterError("must be a time in seconds, above 0, with up to 9 decimals", got=text)
    return int(number * 10**9)


def _keep(text: str) -> local_maps.Keep:
    if text == "all":
        return "all"
    if not (text.isascii() and text.isdigit() and int(text[:9]) > 0 and len(text) < 10):
        raise ParameterError("must be a number of clouds, at least 1, or all", got=text)
    return int(text)


@dataclass(frozen=True, eq=False)
class WindowPlanner:
    """Plans the shortest route from a robot in its local map to a goal, in it or beyond it."""

    goal: frame.Point
    common: LocalCommon
    known: Terrain | None

    @classmethod
    def for_goal(cls, goal: frame.Point, common: LocalCommon) -> WindowPlanner:
        steps, known = common.recipe.steps, None
        if not steps or steps[-1].stage.product_type is not Costmap:
            raise ParameterError("needs a recipe that ends in costs", place="route_to")
        if common.global_map is not None:
            grid: Any = common.global_map.grid
            for step in steps:
                grid = step.apply(grid, common.global_map.files[0])
            known = Terrain.of(grid)
        return cls(frame.check_point(goal, "route_to"), common, known)

    def plan(self, job: LocalJob, number: int = 0, *, is_last: bool = True) -> reach.Route:
        """Plan on the costs in the job's folder, and write the route and its picture there."""
        folder, costs = job.folder, self.costs_in(job.folder)
        terrain, start, known = Terrain.of(costs), (job.pose[0], job.pose[1]), self.known
        find = partial(shortest_over, terrain)
        route = route_in_window(terrain, find, start, self.goal, by_length=True, known=known)
        title = f"route {number}: {'reached' if route.reached else 'to the border'}"
        files = folder / ROUTE, folder / PICTURE
        self.write(files, route_document(route), costs, title, RouteOverlay(route))
        if is_last:
            warn_of_border(route, costs)
        return route

    def plan_steps(self, jobs: Sequence[LocalJob], output: Path) -> str:
        """Plan at each pose; write all routes and the path driven, and return a line about them."""
        routes = [self.plan(job, k, is_last=job is jobs[-1]) for k, job in enumerate(jobs)]
        driven = np.array([job.pose[:2] for job in jobs])
        length = float(np.hypot(*np.diff(driven, axis=0).T).sum())
        steps = [{"folder": job.folder.name, **route_document(route)}
                 for job, route in zip(jobs, routes, strict=True)]  # fmt: skip
        document: dict[str, Any] = {"goal": rounded_place(*self.goal), "driven_m": rounded(length)}
        document |= {"driven": driven.tolist(), "steps": steps}
        files, overlay = (output / STEPS, output / "routes.png"), StepsOverlay(routes, driven)
        self.write(files, document, self._canvas(jobs), f"{len(jobs)} steps", overlay)
        reached, beyond = (sum(getattr(route, name) for route in routes)
                           for name in ("reached", "beyond_window"))  # fmt: skip
        if reached + beyond < len(routes):
            rule = f"no route leads on from {len(routes) - reached - beyond} of {len(routes)} poses"
            raise FindingError(rule, source=output / STEPS)
        text = f"{output / STEPS}: {len(routes)} routes, {reached} to the goal"
        return f"{text}, driven {length:.2f} m"

    def _canvas(self, jobs: Sequence[LocalJob]) -> Costmap:
        """Return what all steps are drawn on: the costs of the global map, or of all windows."""
        if self.known is not None:
            return self.known.costmap
        costs = [self.costs_in(job.folder) for job in jobs]
        side, yaw = costs[0].resolution, costs[0].origin[2]
        lows = np.array([window.origin[:2] for window in costs])
        shapes = np.array([window.shape for window in costs])
        places = np.rint((lows - lows.min(axis=0)) / side).astype(int)[:, ::-1]
        extent = (places + shapes).max(axis=0)
        values: Any = np.full(extent, costs[0].unknown_value, costs[0].cost.dtype)
        for window, (row, col), (height, width) in zip(costs, places, shapes, strict=True):
            values[row : row + height, col : col + width] = window.cost
        return Costmap(values, side, (*lows.min(axis=0).tolist(), yaw), costs[0].scale)

    def costs_in(self, folder: Path) -> Costmap:
        with adding_warnings([]):  # the run that wrote these costs has shown its warnings
            file = folder / f"{self.common.recipe.steps[-1].stage.product}.npz"
            return cast("Costmap", reading.read_map(file))

    def write(
        self, files: tuple[Path, Path], document: Any, costs: Costmap, title: str, overlay: Overlay
    ) -> None:
        settings = self.common.settings
        with Transaction(files[: 1 + settings.images], force=True) as transaction:
            transaction.write_json(files[0], document)
            if settings.images:
                write_picture(transaction, files[1], costs, title, settings, overlay)


@command(
    group="Laser scans and point clouds",
    output=Output("DIR", "Output folder; maps of a sequence go to DIR/0000, ...", streams=False),
    shared=("robot", "image_max", "image_extent", "no_images", "dialect", "max_cells", "force",
            "threads", "max_memory"),
    also={"With a bag": FrameOptions, "": LocalOptions},
    makes_costs=lambda values: values.get("bag") is not None,
    example="""\
mapdeal local --cloud examples/clouds/corridor2.pcd --pose -1,0.35,0.3 \\
    --map examples/maps/office.yaml --size 12,8 -o out/local
mapdeal local --cloud 'examples/clouds/corridor*.pcd' \\
    --poses examples/clouds/corridor_poses.txt -o out/corridor""",
)  # fmt: skip
def local(
    bag: Annotated[Path | None, Words("BAG")] = None, *, work: InShell, output: Path,
    clouds: Annotated[list[str] | None, Words("FILE", name="cloud")] = None,
    pose: Annotated[tuple[float, float, float] | None, Words("X,Y,YAW")] = None,
    poses: Annotated[Path | None, Words("FILE")] = None, topics: Topics = (),
    index: Annotated[int | None, Words("N")] = None,
    takes_all: Annotated[bool, Words(name="all")] = False,
    global_map: Annotated[Path | None, Words("GLOBAL", name="map")] = None,
    keep: Annotated[local_maps.Keep | None, Words("N|all", _keep)] = None,
    require_points: bool = False, recipe: RecipeName = run.LOCAL_RECIPE, changes: Changes = None,
    route_to: Annotated[tuple[float, float] | None, POINT] = None,
    until: Annotated[int | None, Words("T", _nanoseconds)] = None,
    every: Annotated[int | None, Words("S", _nanoseconds)] = None,
    why: Annotated[tuple[float, float] | None, POINT] = None, footprint: Footprint | None = None,
    robot: Annotated[RobotParameters | None, Words()] = None, **more: Any,
) -> run.RunReport | LocalMaps:  # fmt: skip
    """Make maps around a robot from point clouds, a global map, or both, or replay its costmap.

    With --cloud BAG, the last cloud is used, or with --all each; points are transformed to the
    robot's frame. BAG alone replays the obstacle and voxel layers of --params-file: the costmap is
    updated with each message of their sensors, as Nav2 and ROS 1 do.

    Cells with a point are occupied, others free; with --map, cells that neither the map nor a beam
    has seen stay unknown. The stages of the recipe follow: inflation, field, rings of costs. A
    sequence, given by --poses, gets a numbered folder for each cloud; unchanged ones are skipped.

    Parameters
    ----------
    bag : path, optional
        Bag from which to replay the costmap of --params-file; --map gives its static layer.
    clouds : list of str, optional
        A cloud: .pcd, .ply, .xyz, .txt, .csv, .asc, .npy, .npz, or a bag; with --poses it can be
        repeated, or a folder, or a quoted pattern. [default: the window of --map]
    pose : tuple of float, optional
        Pose of the robot, metres and radians. [default: from a bag's transforms]
    poses : path, optional
        Text file with one pose per cloud, or window of --map: x y yaw, or TUM format.
    topics : sequence of str
        With a bag: topic to read, if there are several; can be repeated.
    index : int, optional
        With a bag: index of the message, from 0, or from the end, -1. [default: the last]
    takes_all : bool
        With a bag: make a map of each message, as of a sequence.
    resolution : float, optional
        Side of a cell, metres. [default: 0.05; without a cloud, the map's]
    global_map : path, optional
        Global map, whose obstacles and free cells in the window are copied.
    unknown : {'keep', 'free'}, optional
        With --map or --keep: whether cells that nothing has seen stay unknown or become free.
    keep : int or 'all', optional
        With --poses, or a bag: clouds to remember; obstacles stay until a beam passes them.
    require_points : bool
        Exit with 3 if no point of a cloud marks a cell.
    recipe : str
        One of default, nav2, local, arena, design-real, design-sim, design-local, or a file.
    changes : list of str, optional
        Set a parameter of a stage; can be repeated.
    route_to : tuple of float, optional
        Also plan the shortest route over the costs to this point, metres: route.json and route.png;
        of a sequence also routes.json and routes.png, with all routes and the path driven. To a
        point beyond the window, the route ends at the border cell nearest to it, by the route so
        far and the rest on --map, or else in a straight line.
    until : int, optional
        Replay up to this time, seconds since 1970.  [default: the whole bag]
    every : int, optional
        Replay: write a costmap every S seconds, to DIR/0000, ...
    why : tuple of float, optional
        Replay: also explain what marked or cleared the cell at this place, metres.
    robot : RobotParameters, optional
        The robot's own parameters; without a bag to replay, its shape is taken.
    **more
        Fields of `LocalOptions` and of `FrameOptions`.
    """
    frames = pop_parameters(more, FrameOptions)
    if bag is not None:
        rule = "applies to clouds, not to the replay of a bag"
        refuse(rule, clouds=clouds, pose=pose, poses=poses, topic=topics, **frames, index=index,
               all=takes_all, keep=keep, require_points=require_points, set=changes,
               route_to=route_to, footprint=footprint, recipe=recipe != run.LOCAL_RECIPE,
               **more)  # fmt: skip
        return _replay(bag, output, robot, global_map, work, until=until, every=every, why=why)
    refuse("applies to the replay of a bag, BAG", until=until, every=every, why=why)
    bag = Path(clouds[0]) if clouds and len(clouds) == 1 and kinds.is_bag(Path(clouds[0])) else None
    is_sequence = poses is not None or (bag is not None and (takes_all or keep is not None))
    if bag is None:
        refuse("needs a bag for --cloud", topics=topics, **frames, index=index, takes_all=takes_all)
        if pose is None and poses is None:
            raise ParameterError("--pose or --poses is required", place="pose")
    elif is_sequence:
        refuse("applies to one cloud, not to a sequence", index=index)
    if poses is not None:
        refuse("cannot be given together with --poses", pose=pose)
    if not clouds:
        if global_map is None:
            raise ParameterError("a cloud or --map is required", place="clouds")
        own = {name: value for name, value in more.items() if name not in local_maps.OF_WINDOWS}
        changed = {name: own[name] for name in own if own[name] != getattr(LocalOptions, name)}
        rule = "applies to clouds: it needs --cloud"
        refuse(rule, keep=keep, **changed, require_points=require_points)
    if pose is not None:
        pose = check_pose(pose, "--pose")
    if is_sequence:
        refuse("applies to one cloud, not to a sequence", pose=pose)
    else:
        refuse("applies to a sequence: it needs --poses", keep=keep)
    if more.get("unknown") == "keep" and global_map is None and keep is None:
        text = "--unknown keep has no effect without --map or --keep: cells without points are free"
        emit_warning(text)
    known = None if global_map is None else local_maps.read_global_map(global_map, work.settings)
    if known is not None and not clouds:
        more.setdefault("resolution", known.grid.resolution)
    loaded = load_recipe(recipe, changes, footprint=footprint, robot=robot)
    options = LocalOptions(**more)
    common = LocalCommon(options, loaded, work.settings, known, require_points, keep)
    planner = None if route_to is None else WindowPlanner.for_goal(route_to, common)
    for step in loaded.steps:
        work.terminal.detail(step_line(step))
    if bag is None and poses is not None:
        jobs = local_maps.sequence_of(clouds or [], poses, output)
        return _sequence(jobs, output, common, work, planner)
    if bag is None:
        cloud = local_maps.only_cloud(clouds) if clouds else None
        return _single(LocalJob(cloud, pose or (), output), common, work, planner)
    from mapdeal.pipeline import bag_maps  # few commands read bags

    trajectory = poses if poses is not None and has_times(poses) else None
    frame_options, is_raw = FrameOptions(poses=trajectory, **frames), options.frame == "map"
    has_poses = pose is not None or (poses is not None and trajectory is None)
    reader = partial(bag_maps.BagClouds, has_poses=has_poses, is_raw=is_raw)
    with bag_maps.from_bag(bag, reader, topics, frame_options) as source:
        with work.counted(source.preparation) as advance:
            source.prepare(advance)
        if is_sequence:
            jobs = bag_maps.sequence_of_bag(source, None if trajectory else poses, output)
            return _sequence(jobs, output, common, work, planner)
        number = source.number(index)
        place = source.pose(number) if pose is None else pose
        return _single(LocalJob(source.cloud(number), place, output), common, work, planner)


def _replay(
    bag: Path, output: Path, robot: RobotParameters | None, global_map: Path | None, work: Work, *,
    until: int | None, every: int | None, why: tuple[float, float] | None,
) -> run.RunReport | LocalMaps:  # fmt: skip
    if robot is None:
        raise ParameterError("is required to replay a bag", source="--params-file")
    if every is not None:
        refuse("applies to one costmap, not to a sequence", why=why)
    from mapdeal.bags.reader import open_bag  # few commands read bags
    from mapdeal.pipeline.replay import BagReplay, CellWatch, message_counts, write_replay

    settings = work.settings
    known = None if global_map is None else local_maps.read_global_map(global_map, settings)
    with local_maps.holding_map(known), open_bag(bag) as opened:
        replay = BagReplay(opened, robot, None if known is None else known.grid)
        counts = message_counts(replay, until=until, every=every)
        if every is None:
            replay.watch = None if why is None else CellWatch(replay, why)
            with work.counted(counts[-1]) as replay.advance:
                return write_replay(replay, output, counts[-1], known, settings)
        folders = {output / f"{k:04}": count for k, count in enumerate(counts)}
        jobs = [batch.Job(bag, path, f"message {k - 1}", path.name) for path, k in folders.items()]

        def write(job: batch.Job) -> run.RunReport:
            with strict_warnings(settings.strict, bag):
                return write_replay(replay, job.folder, folders[job.folder], known, settings)

        return batch.run_and_report(jobs, output, write, Costmaps, work.terminal)


def _single(
    job: LocalJob, common: LocalCommon, work: Work, planner: WindowPlanner | None
) -> run.RunReport:
    report = local_maps.make_local(job, common)
    if planner is not None:
        route = planner.plan(job)
        path = job.folder / ROUTE
        if not (route.reached or route.beyond_window):
            raise FindingError("no route leads to the goal, nor to the border", source=path)
        ending = "to the goal" if route.reached else "to the border, the goal is beyond it"
        work.terminal.summary([f"{path}: {route.length:.2f} m {ending}"])
    return report


def _sequence(
    sequence: Sequence[LocalJob], output: Path, common: LocalCommon, work: Work,
    planner: WindowPlanner | None,
) -> LocalMaps:  # fmt: skip
    if unrelated := local_maps.other_folders(sequence, output):
        emit_warning(f"{len(unrelated)} folders are not of this sequence, such as {unrelated[0]}")
    numbers = {job.folder: number for number, job in enumerate(sequence)}
    rolling = None if common.keep is None else local_maps.RollingRun(sequence, common)

    def run_one(job: batch.Job) -> run.RunReport:
        number = numbers[job.folder]
        with strict_warnings(common.settings.strict, job.path):
            if rolling is not None:
                return rolling(number)
            return local_maps.make_local(sequence[number], common, skip=True)

    jobs = []
    for number, job in enumerate(sequence):
        name = f"pose {number}" if job.cloud is None else job.cloud.name
        jobs.append(batch.Job(job.source(common), job.folder, name, job.folder.name))
    report = batch.run_and_report(jobs, output, run_one, LocalMaps, work.terminal)
    if planner is not None:
        report.check()
        work.terminal.summary([planner.plan_steps(sequence, output)])
    return report
