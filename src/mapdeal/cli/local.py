"""``mapdeal local``: local maps from point clouds, and windows of a global map."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import bag_options as bag_opt
from mapdeal.cli import options as opt
from mapdeal.cli import run_options as run_opt
from mapdeal.cli import terminal
from mapdeal.cli.run_batch import lines_of_local
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import BatchError, MapdealError, ParameterError, emit_warning, strict_warnings
from mapdeal.grid.footprint import Footprint
from mapdeal.inputs.kinds import is_bag
from mapdeal.mapping.local_map import CloudFrame, LocalOptions, Unknown
from mapdeal.mapping.transforms import Pose, check_pose
from mapdeal.pipeline.batch import SUMMARY, Job, Outcome, run_all
from mapdeal.pipeline.local import (
    Keep,
    LocalCommon,
    LocalJob,
    RollingRun,
    make_local,
    only_cloud,
    other_folders,
    read_global_map,
    sequence_of,
    sequence_of_bag,
)
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import LOCAL_RECIPE, RunReport
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import has_times

app = typer.Typer(rich_markup_mode=None, add_completion=False)


def _limit(help_text: str) -> Any:
    return typer.Option(metavar="M", help=help_text)


@app.command()
@shared_options(
    "robot", "image_max", "image_extent", "no_images", "dialect", "max_cells", "force", "threads",
    "max_memory",
    makes_costs=lambda _: False
)  # fmt: skip
def local(
    output: Annotated[
        Path, opt.output_argument("DIR", "Output folder; maps of a sequence go to DIR/0000, ...")
    ],
    clouds: Annotated[list[str] | None, typer.Option("--cloud")] = None,
    pose: str | None = None,
    poses: Path | None = None,
    topics: bag_opt.Topics = None,
    index: Annotated[int | None, bag_opt.index_option("With a bag")] = None,
    takes_all: Annotated[bool, typer.Option("--all")] = False,
    fixed_frame: bag_opt.FixedFrame = None,
    base_frame: bag_opt.BaseFrame = None,
    odometry: bag_opt.Odometry = None,
    mount: bag_opt.Mount = None,
    frame: CloudFrame = "robot",
    offset: str = "0,0",
    size: str = "20,20",
    resolution: float | None = None,
    global_map: Annotated[Path | None, typer.Option("--map")] = None,
    min_height: Annotated[float | None, _limit("Drop points with a smaller z, metres.")] = None,
    max_height: Annotated[float | None, _limit("Drop points with a larger z, metres.")] = None,
    min_range: Annotated[float | None, _limit("Drop points nearer to the robot, metres.")] = None,
    max_range: Annotated[
        float | None, _limit("Drop points farther from the robot, metres.")
    ] = None,
    raytrace_range: Annotated[
        float | None,
        _limit(
            "Range up to which beams clear cells, metres.  [default: --max-range, else up "
            "to the point]"
        ),
    ] = None,
    unknown: Unknown | None = None,
    keep: str | None = None,
    require_points: bool = False,
    recipe: run_opt.Recipe = LOCAL_RECIPE,
    changes: run_opt.Changes = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
    robot: RobotParameters | None,
) -> None:
    """Make maps around a robot from point clouds, a global map, or both.

    With a bag, the last cloud is used, or with --all each; points are transformed to the robot's
    frame.

    Cells with a point are occupied, others free; with --map, cells that neither the map nor a beam
    has seen stay unknown. The stages of the recipe follow: inflation, field, rings of costs. A
    sequence, given by --poses, gets a numbered folder for each cloud; clouds whose manifest shows
    no change are skipped.

    Options
    -------
    --pose X,Y,YAW: Pose of the robot, metres and radians.  [default: from a bag's transforms]
    --poses FILE: Text file with one pose per cloud: x y yaw, or TUM format.
    --frame: Frame of the points: the robot's, or already the map's.
    --offset DX,DY: Offset subtracted from the points' map coordinates, metres.
    --size WX,WY: Extent along x and y, metres, the robot in the middle.
    --resolution R: Side of a cell, metres.  [default: 0.05; without a cloud, the map's]
    --unknown: With --map or --keep: whether cells that nothing has seen stay unknown (keep) or
        become free.  [default: keep]
    --keep N|all: With --poses, or a bag: number of clouds to remember. Their obstacles stay until
        a beam passes them.
    --require-points: Exit with 3 if no point of a cloud marks a cell.
    --cloud FILE: A cloud: .pcd, .ply, .xyz, .txt, .csv, .asc, .npy, .npz, or a bag of ROS 1 or ROS
        2. With --poses it can be repeated, or a folder, or a quoted pattern. Without it the window
        of --map is taken.
    --all: With a bag: make a map of each message, as of a sequence.
    --map GLOBAL: Global map, whose obstacles and free cells in the window are copied.
    """
    bag = Path(clouds[0]) if clouds and len(clouds) == 1 and is_bag(Path(clouds[0])) else None
    of_bag = bag_opt.BagWords(topics, fixed_frame, base_frame, odometry, mount)
    if bag is None:
        of_bag.refuse("needs a bag for --cloud")
        for name, value in (("--index", index), ("--all", takes_all or None)):
            if value is not None:
                raise ParameterError("needs a bag for --cloud", source=name)
    elif index is not None and (takes_all or poses is not None or keep is not None):
        raise ParameterError("applies to one cloud, not to a sequence", source="--index")
    if pose is None and poses is None and bag is None:
        raise ParameterError("--pose or --poses is required", source="--pose")
    if pose is not None and poses is not None:
        raise ParameterError("cannot be given together with --poses", source="--pose")
    if not clouds:
        _check_window_of_map(
            global_map,
            {
                "--poses": poses,
                "--frame": None if frame == "robot" else frame,
                "--offset": None if offset == "0,0" else offset,
                "--min-height": min_height,
                "--max-height": max_height,
                "--min-range": min_range,
                "--max-range": max_range,
                "--raytrace-range": raytrace_range,
                "--require-points": require_points or None,
            },
        )
    is_sequence = poses is not None or (bag is not None and (takes_all or keep is not None))
    if is_sequence and pose is not None:
        raise ParameterError("applies to one cloud, not to a sequence", source="--pose")
    kept = _number_of_clouds(keep, is_sequence=is_sequence)
    if unknown == "keep" and global_map is None and kept is None:
        emit_warning(
            "--unknown keep has no effect without --map or --keep: cells without points are free"
        )
    known = None if global_map is None else read_global_map(global_map, settings)
    if resolution is None:
        resolution = known.grid.resolution if known is not None and not clouds else 0.05
    common = LocalCommon(
        LocalOptions(
            frame,
            opt.pair(offset, "--offset"),
            opt.pair(size, "--size"),
            resolution,
            min_height,
            max_height,
            min_range,
            max_range,
            raytrace_range,
            unknown or "keep",
        ),
        load_recipe(recipe, footprint=footprint, robot=robot, settings=changes or []),
        settings,
        known,
        require_points,
        kept,
    )
    for one in common.recipe.steps:
        terminal.detail(opt.described(one.name, one.described()[one.name]))
    if bag is not None:
        trajectory = poses if poses is not None and has_times(poses) else None
        with of_bag.clouds(
            bag,
            trajectory,
            has_poses=pose is not None or (poses is not None and trajectory is None),
            is_raw=frame == "map",
        ) as source:
            with terminal.counted(source.preparation) as advance:
                source.prepare(advance)
            if is_sequence:
                sequence = sequence_of_bag(source, None if trajectory else poses, output)
                _run_sequence(sequence, output, common)
                return
            number = source.number(index)
            place = source.pose(number) if pose is None else _pose(pose)
            job = LocalJob(source.cloud(number), place, output)
            terminal.summary(lines_of_local(job.source(common), make_local(job, common)))
    elif poses is None:
        place = _pose(pose or "")
        job = LocalJob(only_cloud(clouds) if clouds else None, place, output)
        terminal.summary(lines_of_local(job.source(common), make_local(job, common)))
    else:
        _run_sequence(sequence_of(clouds or [], poses, output), output, common)


def _pose(text: str) -> Pose:
    return check_pose(opt.numbers(text, 3, "X,Y,YAW", "--pose"), "--pose")


def _check_window_of_map(global_map: Path | None, given: dict[str, object]) -> None:
    if global_map is None:
        raise ParameterError("a cloud or --map is required", source="--cloud")
    for name, value in given.items():
        if value is not None:
            raise ParameterError("applies to clouds: it needs --cloud", source=name)


def _number_of_clouds(text: str | None, *, is_sequence: bool) -> Keep | None:
    if text is None:
        return None
    if not is_sequence:
        raise ParameterError("applies to a sequence: it needs --poses", source="--keep")
    if text == "all":
        return "all"
    if not (text.isascii() and text.isdigit() and int(text[:9]) > 0 and len(text) < 10):
        rule = "must be a number of clouds, at least 1, or all"
        raise ParameterError(rule, source="--keep", got=text)
    return int(text)


def _run_sequence(sequence: list[LocalJob], output: Path, common: LocalCommon) -> None:
    others = other_folders(sequence, output)
    if others:
        emit_warning(f"{len(others)} folders are not of this sequence, such as {others[0]}")
    numbers = {job.folder: number for number, job in enumerate(sequence)}
    rolling = None if common.keep is None else RollingRun(sequence, common)
    started = time.perf_counter()

    def run_one(job: Job) -> RunReport:
        number = numbers[job.folder]
        with strict_warnings(common.settings.strict, job.path):
            if rolling is not None:
                return rolling(number)
            return make_local(sequence[number], common, skip=True)

    with (
        terminal.Progress(len(sequence), what="cloud") as bar,
        terminal.few_warnings(f"{output / SUMMARY} has them all") as warn,
    ):

        def say(job: Job, outcome: Outcome) -> None:
            for text in outcome.warnings:
                warn(text)
            if isinstance(outcome.result, MapdealError):
                terminal.error(outcome.result)
            elif outcome.result is not None:
                terminal.detail(lines_of_local(job.path, outcome.result)[0])
            bar.advance(failed=outcome.status == "failed")

        jobs = [
            Job(cloud.path, job.folder, cloud.name, job.folder.name)
            for job in sequence
            if (cloud := job.cloud) is not None
        ]
        outcomes = run_all(jobs, output, run_one, say, what="cloud")
    failed = sum(outcome.status == "failed" for outcome in outcomes)
    unchanged = sum(outcome.status == "unchanged" for outcome in outcomes)
    done = len(outcomes) - failed - unchanged
    text = f"{output}: {done} done, {unchanged} unchanged, {failed} failed"
    if done == len(outcomes):
        text += f", {done / (time.perf_counter() - started):.3g} maps a second"
    terminal.summary([text])
    if failed:
        raise BatchError(f"{failed} of {len(outcomes)} clouds failed")
