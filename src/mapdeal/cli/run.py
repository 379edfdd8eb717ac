"""``mapdeal run``: maps through a whole recipe."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import run_around as around
from mapdeal.cli import run_options as run_opt
from mapdeal.cli import terminal
from mapdeal.cli.many_maps import jobs_at_once, say_listing
from mapdeal.cli.robot_options import say_queue
from mapdeal.cli.run_batch import run_batch, run_single, say_plans
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import FindingError, ParameterError, emit_warning, one_line
from mapdeal.files.source import absolute_path
from mapdeal.grid.display import count_text
from mapdeal.grid.footprint import Footprint
from mapdeal.inputs.listing import list_maps
from mapdeal.pipeline.batch import MapRun, Workers, jobs_of
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import LOCAL_RECIPE, around_in, output_folder
from mapdeal.pipeline.settings import Canvas, Settings
from mapdeal.ros.robot import RobotParameters

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options(
    "robot", "image_max", "image_extent", "no_images", "pose", "cloud", "frame", "local_recipe",
    "local_changes",
    "golden", "update_golden", "dialect", "max_cells", "jobs",
    "scheduler", "dry_run", "force", "threads", "max_memory",
    help_texts={
        "threads": "Threads of each job.  [default: all cores, shared between jobs]",
        "max_memory": "Memory for each job, such as 4G or 500M; maps that need more are "
                      "processed in blocks of rows.  [default: half of the free memory, shared "
                      "between jobs]",
    },
    makes_costs=lambda own: own["recipe"] is None
)  # fmt: skip
def run(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="MAP...", help="Maps, folders, quoted patterns, or @LIST.txt."),
    ],
    output: Annotated[
        Path, opt.output_argument("DIR", "Output folder, with a subfolder for each map.")
    ],
    recipe: run_opt.RunRecipe = None,
    sim: bool = False,
    changes: run_opt.Changes = None,
    canvas: Canvas = "crop",
    golden: Path | None = None,
    update_golden: bool = False,
    jobs: Annotated[
        int | None,
        opt.jobs_option(
            "Number of maps to run at the same time, each in a process.  [default: the cores]"
        ),
    ] = None,
    scheduler: str | None = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n")] = False,
    report: bool = False,
    pose: around.PoseOption = None,
    cloud: around.CloudOption = None,
    frame: around.FrameOption = None,
    local_recipe: around.LocalRecipe = None,
    local_changes: around.LocalChanges = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
    robot: RobotParameters | None,
) -> None:
    """Run maps through a recipe: inflation, distance field, costmap.

    Each map gets its own folder: a pgm, yaml and png file of every stage, npz files of field and
    costs, and a manifest. Maps whose manifest shows no change are skipped.

    A MAP is a map_server .yaml, a .pbm with its .yaml, or an .npz; a folder, for all such .yaml
    files in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt, a file with one
    such name per line (@- reads standard input). Maps of folders, patterns and lists keep their
    path below DIR.

    With --params-file the maps get the costs of a robot, as its own Nav2 or ROS 1 parameters
    define them; options on the command line win over the file. A --recipe takes only its shape.

    With --pose, a single map also gets the local map around a robot there, with or without a point
    cloud (--cloud).

    If a map fails, the others continue: the exit code is 5, and DIR/summary.json has the outcome
    of each. A map that --strict refuses counts as failed.

    Options
    -------
    --sim: Map of a simulated world: cut out its active region first, and treat unknown cells as
        obstacles.
    --canvas: Extent of the outputs: the active region (crop), or the full map extent (full),
        unknown outside the region. Stages compute on the region in either case, unless
        active.canvas=full is --set.
    --golden DIR: Compare each stage with a stored run; exit with 1 if any differs.
    --update-golden: Store the runs in --golden instead of comparing.
    --scheduler tcp://HOST:PORT: Have the workers of this dask scheduler run the maps.  [needs
        mapdeal[cluster]]
    --report: Write a page of all that was made, too: DIR/report.html.
    --dry-run: Say what would be read, written, skipped and refused, and the memory it takes.
    """
    if update_golden and golden is None:
        raise ParameterError("needs --golden DIR", source="--update-golden")
    if "-" in sources:
        rule = "standard input has no name for a folder of outputs"
        hint = "mapdeal convert - -o FILE.npz keeps it under a name; @- takes names of maps"
        raise ParameterError(rule, source="-", hint=hint)
    around.refuse_in_set(changes or [])
    loaded = load_recipe(recipe, sim=sim, footprint=footprint, robot=robot, settings=changes or [])
    for one in loaded.steps:
        terminal.detail(opt.described(one.name, one.described()[one.name]))
    if canvas == "full" and not loaded.is_smaller:
        emit_warning("--canvas full: has no effect, no stage of the recipe crops the map")
        canvas = "crop"
    # progress: of a single map alone, see `run_single`
    settings = replace(settings, canvas=canvas, progress=None)
    if footprint is None and robot is not None:
        footprint = robot.footprint
    standing = around.around_of(pose, cloud, frame, local_recipe, local_changes, footprint)
    if standing is not None and scheduler is not None:
        raise ParameterError("cannot be given together with --scheduler", source="--pose")
    if scheduler is not None:
        output = absolute_path(output)
    listing = list_maps(sources, output, terminal.input_chunks)
    names = {path.name for path in output_folder(output, {}, loaded, settings).outputs()}
    all_jobs = jobs_of(listing.maps, output, names)
    say_listing(listing, "run")
    is_batch = listing.is_set or len(all_jobs) > 1
    if standing is not None and len(all_jobs) > 1:
        raise ParameterError(f"takes one map, there are {len(all_jobs)}", source="--pose")
    map_run = MapRun(loaded, settings, standing)
    if scheduler is not None:
        all_jobs = [replace(job, path=absolute_path(job.path)) for job in all_jobs]
    size = None if scheduler is not None else jobs_at_once(jobs, len(all_jobs))
    if size is not None:
        map_run = map_run.sharing(size)
    page = _page_of(output) if report else None
    if dry_run:
        say_plans(all_jobs, map_run, size, is_batch=is_batch, output=output, page=page)
        return
    with ExitStack() as stack:
        workers: Workers | None = None
        if scheduler is not None:
            from mapdeal.pipeline.cluster import ClusterWorkers, connected, shared_folders

            client = stack.enter_context(connected(scheduler, shared_folders(all_jobs[0])))
            workers = cluster = ClusterWorkers(client, scheduler, jobs)
            map_run = map_run.within(cluster.memory_of_each())
        elif size is not None and size > 1:
            from mapdeal.pipeline.workers import ProcessWorkers  # slow to import

            workers = ProcessWorkers(size)
        if page is not None:
            from mapdeal.commands.report import reported

            made = [output] if is_batch else [all_jobs[0].folder]
            maps = [job.path for job in all_jobs]
            stack.enter_context(
                reported(
                    page,
                    made,
                    maps,
                    settings,
                    on_made=lambda one: terminal.summary([f"{one.path}: {one.text}"]),
                )
            )
        if is_batch:
            run_batch(all_jobs, output, map_run, workers)
        else:
            run_single(all_jobs[0], map_run, workers)
            if robot is not None and workers is None:
                say_queue(all_jobs[0].path, loaded.steps, settings)
    runs = [(job.folder, job.place) for job in all_jobs]
    if standing is not None:
        runs += [(around_in(folder), f"{place}/{LOCAL_RECIPE}") for folder, place in runs]
    _compare_with_golden(runs, golden, update=update_golden)


def _page_of(output: Path) -> Path:
    """Return where the report goes, which no other file may be."""
    from mapdeal.commands.report_draft import REPORT, check_replaceable

    page = output / REPORT
    check_replaceable(page)
    return page


def _compare_with_golden(
    runs: list[tuple[Path, str]], golden: Path | None, *, update: bool
) -> None:  # fmt: skip
    """Store the runs, or tell what differs from those that are stored."""
    if golden is None:
        return
    from mapdeal.pipeline.folder import differences_from_golden, store_golden

    if update:
        stored = [store_golden(folder, golden, place) for folder, place in runs]
        terminal.summary([f"{path}: stored" for path in stored])
        return
    lines = [
        line for folder, place in runs for line in differences_from_golden(folder, golden, place)
    ]
    for line in lines:
        terminal.result(one_line(line))
    if lines:
        verb = "differs" if len(lines) == 1 else "differ"
        rule = f"{count_text(len(lines), 'stage')} {verb} from the golden run"
        raise FindingError(rule, source=golden, hint="--update-golden accepts them")
    terminal.summary([f"{golden}: all stages as stored"])
