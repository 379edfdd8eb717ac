"""``mapdeal local``: local maps from point clouds."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import run_options as run_opt
from mapdeal.cli import terminal
from mapdeal.cli.run_batch import lines_of_stages
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import BatchError, MapdealError, ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures
from mapdeal.mapping.local_map import CloudFrame, LocalOptions
from mapdeal.mapping.poses import check_pose
from mapdeal.pipeline.batch import run_all
from mapdeal.pipeline.jobs import SUMMARY, Job, Outcome
from mapdeal.pipeline.local import (
    LOCAL_RECIPE,
    LocalCommon,
    local_from_cloud,
    only_cloud,
    other_folders,
    read_global_map,
    sequence_of,
)
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import RunReport
from mapdeal.pipeline.settings import Settings

_ALL_AROUND = 2 * math.pi - 0.1
"""Radians: with gaps as short as this there is no direction that a cloud does not cover."""

app = typer.Typer(rich_markup_mode=None, add_completion=False)


def _limit(help_text: str) -> Any:
    return typer.Option(metavar="M", help=help_text)


@app.command()
@shared_options(
    "robot", "image_max", "no_images", "dialect", "max_cells", "force", "threads", "max_memory"
)
def local(
    clouds: Annotated[
        list[str],
        typer.Option(
            "--cloud",
            metavar="FILE",
            help="A cloud: .pcd, .ply, .xyz, .txt, .csv, .asc, .npy, .npz. With --poses it can be "
            "repeated, or a folder, or a quoted pattern.",
        ),
    ],
    output: Annotated[
        Path, opt.output_argument("DIR", "Where the maps go; those of a sequence to DIR/0000, ...")
    ],
    pose: Annotated[
        str | None,
        typer.Option(metavar="X,Y,YAW", help="Where the robot stands, metres and radians."),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A pose for each cloud, a line each: x y yaw, or TUM's."),
    ] = None,
    frame: Annotated[
        CloudFrame,
        typer.Option(help="What the points' coordinates are: the robot's, or the map's already."),
    ] = "robot",
    offset: Annotated[
        str, typer.Option(metavar="DX,DY", help="Taken off the points' map coordinates.")
    ] = "0,0",
    size: Annotated[
        str, typer.Option(metavar="WX,WY", help="Metres along x and y, the robot in the middle.")
    ] = "20,20",
    resolution: Annotated[float, typer.Option(metavar="R", help="Metres per cell.")] = 0.05,
    global_map: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="GLOBAL", help="A map whose obstacles in the window are taken over."
        ),
    ] = None,
    min_height: Annotated[float | None, _limit("Drop points whose z is less.")] = None,
    max_height: Annotated[float | None, _limit("Drop points whose z is more.")] = None,
    min_range: Annotated[float | None, _limit("Drop points nearer to the robot.")] = None,
    max_range: Annotated[float | None, _limit("Drop points farther from the robot.")] = None,
    require_points: Annotated[
        bool,
        typer.Option("--require-points", help="Fail (3) if no point of a cloud marks a cell."),
    ] = False,
    recipe: run_opt.Recipe = LOCAL_RECIPE,
    changes: run_opt.Changes = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
) -> None:
    """Make maps around a robot from point clouds.

    Cells with a point are occupied, others free. Then come the stages of the recipe: inflation,
    field, rings of costs. A sequence, given by --poses, gets a numbered folder for each cloud;
    one whose manifest shows that nothing has changed is skipped.
    """
    if pose is None and poses is None:
        raise ParameterError("--pose or --poses must be given", source="--pose")
    if pose is not None and poses is not None:
        raise ParameterError("cannot be given together with --poses", source="--pose")
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
        ),
        load_recipe(recipe, footprint=footprint, settings=changes or []),
        settings,
        None if global_map is None else read_global_map(global_map, settings),
        require_points,
    )
    for one in common.recipe.steps:
        terminal.detail(opt.described(one.name, one.described()[one.name]))
    if poses is None:
        place = check_pose(opt.numbers(pose or "", 3, "X,Y,YAW", "--pose"), "--pose")
        cloud = only_cloud(clouds)
        terminal.summary(_lines(cloud, local_from_cloud(cloud, place, output, common)))
    else:
        _run_sequence(clouds, poses, output, common)


def _run_sequence(
    clouds: list[str], poses_file: Path, output: Path, common: LocalCommon
) -> None:  # fmt: skip
    sequence = sequence_of(clouds, poses_file, output)
    poses = {job.folder: job.pose for job in sequence}
    started = time.perf_counter()

    def run_one(job: Job) -> RunReport:
        return local_from_cloud(job.path, poses[job.folder], job.folder, common, skip=True)

    with (
        terminal.progress(len(sequence), what="cloud") as bar,
        terminal.few_warnings(f"{output / SUMMARY} has them all") as warn,
    ):

        def say(job: Job, outcome: Outcome) -> None:
            for text in outcome.warnings:
                warn(text)
            if isinstance(outcome.result, MapdealError):
                terminal.error(outcome.result)
            elif outcome.result is not None:
                terminal.detail(_lines(job.path, outcome.result)[0])
            bar.advance(failed=outcome.status == "failed")

        jobs = [Job(job.cloud, job.folder, job.cloud.name, job.folder.name) for job in sequence]
        outcomes = run_all(jobs, output, run_one, say, what="cloud")
    failed = sum(outcome.status == "failed" for outcome in outcomes)
    unchanged = sum(outcome.status == "unchanged" for outcome in outcomes)
    done = len(outcomes) - failed - unchanged
    text = f"{output}: {done} done, {unchanged} unchanged, {failed} failed"
    if done == len(outcomes):
        text += f", {done / (time.perf_counter() - started):.3g} maps a second"
    others = other_folders(sequence, output)
    if others:
        terminal.warn(f"{len(others)} folders are not of this sequence, such as {others[0]}")
    terminal.summary([text])
    if failed:
        raise BatchError(f"{failed} of {len(outcomes)} clouds failed")


def _lines(cloud: Path, report: RunReport) -> list[str]:
    local = report.figures["local"]
    head = f"{cloud} -> {report.folder}: "
    if report.status == "unchanged":
        return [f"{head}unchanged"]
    return [f"{head}{_summary_of(local)}", *lines_of_stages(report)]


def _summary_of(local: Figures) -> str:
    text = f"{local['marking']} of {local['points']} points in the window"
    dropped = {
        "not finite": local["not_finite"],
        "by height": local["beyond_height"],
        "by range": local["beyond_range"],
    }
    parts = [f"{count} {why}" for why, count in dropped.items() if count]
    if parts:
        text += f" (dropped: {', '.join(parts)})"
    if "from_map" in local:
        text += f", {local['from_map']} cells from the map"
    if local["angle_min"] is not None:
        around = local["angle_max"] - local["angle_min"] > _ALL_AROUND
        ends = f"from {local['angle_min']:.4g} to {local['angle_max']:.4g} rad of its heading"
        text += f", seen {'all around' if around else ends}"
    return f"{text}, rear heading {local['rear_heading']:.4g} rad"
