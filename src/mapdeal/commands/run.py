"""``mapdeal run``: maps through a whole recipe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

from mapdeal import errors, records
from mapdeal.command import AT_LEAST_1, Output, Result, Words, command
from mapdeal.commands.reach import RobotOption, StartOption, chosen_goals, goals_or_names
from mapdeal.compatibility import Unpack
from mapdeal.files.source import absolute_path, claim
from mapdeal.grid.footprint import Footprint, FootprintLike
from mapdeal.grid.frame import CloudFrame
from mapdeal.grid.reach import Goal, robot_text
from mapdeal.grid.values import count_text
from mapdeal.maps.listing import list_maps
from mapdeal.pictures.overlay import DEFAULT_EXTENT, DEFAULT_IMAGE_MAX, ImageExtent
from mapdeal.pipeline import batch, inputs, recipe as recipes, run as pipeline
from mapdeal.pipeline.folder import differences_from_golden, step_line, store_golden
from mapdeal.pipeline.settings import Canvas, Settings

if TYPE_CHECKING:
    from mapdeal.commands.report import GoalAnswer, RunChecks, WrittenReport
    from mapdeal.pipeline.local import Around

_PAGE_BYTES = 20_000_000  # of libraries and pictures for a page of the results

File = str | PathLike[str]


@overload
def run(path: File, output: File, *more: Any, **options: Any) -> pipeline.RunReport: ...
@overload
def run(
    path: list[File] | tuple[File, ...], output: File, *more: Any, **options: Any
) -> list[pipeline.RunReport]: ...
def run(
    path: File | list[File] | tuple[File, ...], output: str | PathLike[str],
    recipe: recipes.RecipeLike = recipes.DEFAULT,
    changes: Mapping[str, object] | Sequence[str] | None = None, *,
    footprint: FootprintLike | None = None, sim: bool = False, canvas: Canvas = "crop",
    images: bool = True, image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = DEFAULT_EXTENT, force: bool = False, strict: bool = False,
    threads: int | None = None, mask: File | None = None, robot_radius: float | None = None,
    **reading: Unpack[inputs.Reading],
) -> pipeline.RunReport | list[pipeline.RunReport]:  # fmt: skip
    """Run a recipe on a map and write the results to a folder, like ``mapdeal run MAP -o DIR``.

    Parameters
    ----------
    path : path or str, or a sequence of them
        A map_server ``.yaml``, a ``.pbm`` with its ``.yaml`` next to it, or an ``.npz``.
    output : path or str
        Output folder; the results are written to a subfolder named after the map.
    recipe, changes, footprint, sim, robot_radius
        As for `load_recipe`.
    canvas : {'crop', 'full'}
        Extent of the outputs: the cells that the stages computed, or the full map extent.
    images : bool
        Whether to write a picture of each product.
    image_max, image_extent
        As for `draw_picture`.
    force : bool
        Whether to replace existing outputs.
    strict : bool
        Whether to turn warnings into an error before anything is written.
    threads : int, optional
        Number of threads to compute and write with; by default one per core.
    mask : path or str, optional
        Keepout mask, a map, over the costs, as for `apply_keepout_mask`.
    **reading
        As for `read_map`: dialect and max_cells. With max_memory, bytes, by default half of the
        free memory, larger maps are processed in blocks of rows, with the same result, or refused.

    Returns
    -------
    RunReport, or a list of them
        Output folder, whether the outputs were already up to date, and the figures of each stage;
        of a sequence of maps one each.

    Raises
    ------
    FileAccessError
        If a file cannot be read or written, or different outputs already exist.
    MalformedInputError
        If the map is malformed, or needs too much memory.
    ParameterError
        If the recipe or a parameter is invalid.
    FindingError
        If `strict` is true and there is a warning.

    Warns
    -----
    MapdealWarning
        If a choice had to be made while reading, or a product carries no information.

    Notes
    -----
    Outputs appear together, the manifest last; after an error nothing has changed.
    """
    paths = list(path) if isinstance(path, list | tuple) else [path]
    for each in paths:
        if not isinstance(each, str | PathLike):
            hint = "apply_recipe takes a grid, write_map writes it to a file"
            raise errors.ParameterError("takes the path of a map", place="run", got=each, hint=hint)
    inputs.need_folder(Path(output))
    sources = list(map(Path, paths))
    if len({source.stem for source in sources}) < len(sources):
        raise errors.ParameterError("must have different names", place="path")
    settings = Settings(
        force=force, strict=strict, threads=threads, images=images, image_max=image_max,
        image_extent=image_extent, canvas=canvas, mask=None if mask is None else Path(mask),
        **reading,
    )  # fmt: skip
    reports = []
    for source in sources:
        with errors.strict_warnings(strict, source):
            shape: Any = {"footprint": footprint, "robot_radius": robot_radius}
            loaded = recipes.load_recipe(recipe, changes, sim=sim, **shape)
            settings = records.replace(settings, mask=pipeline.used_mask(loaded, settings.mask))
            if not loaded.is_smaller:
                settings = records.replace(settings, canvas="crop")  # manifests contain this value
            reports.append(pipeline.run_map(source, Path(output) / source.stem, loaded, settings))
    return reports if isinstance(path, list | tuple) else reports[0]


@command(
    name="run",
    group="Maps, distance fields, costmaps",
    output=Output("DIR", "Output folder, with a subfolder for each map.", streams=False),
    shared=("robot", "mask", "image_max", "image_extent", "no_images", "dialect", "resolution",
            "origin", "max_cells", "force", "threads", "max_memory"),
    texts={
        "threads": "Threads of each job.  [default: all cores, shared between jobs]",
        "max_memory": "Memory for each job, such as 4G or 500M; maps that need more are "
                      "processed in blocks of rows.  [default: half of the free memory, shared "
                      "between jobs]",
    },
    makes_costs=lambda own: own["recipe"] is None,
    example="""\
mapdeal run examples/maps/office.yaml -o out
mapdeal run examples/maps -o out/all --recipe nav2 --report
mapdeal run examples/maps/office.yaml -o out/robot \\
    --params-file examples/robots/nav2_params.yaml""",
)  # fmt: skip
def run_maps(
    sources: Annotated[list[str], Words("MAP...")],
    *,
    work: inputs.InShell,
    output: Path,
    recipe: recipes.RecipeName = None,
    sim: bool = False,
    changes: recipes.Changes = None,
    canvas: Canvas = "crop",
    pose: Annotated[tuple[float, float, float] | None, Words("X,Y,YAW")] = None,
    cloud: Annotated[str | None, Words("FILE")] = None,
    frame: CloudFrame | None = None,
    local_recipe: recipes.RecipeName = None,
    golden: Annotated[Path | None, Words("DIR")] = None,
    update_golden: bool = False,
    jobs: Annotated[int | None, AT_LEAST_1, Words("N", short="j")] = None,
    scheduler: Annotated[str | None, Words("tcp://HOST:PORT")] = None,
    report: bool = False,
    start: StartOption = None,
    goals: Annotated[
        Sequence[Goal | str], Words("[NAME=]X,Y|NAME", goals_or_names, "to", is_repeated=True)
    ] = (),
    points: Annotated[Path | None, Words("FILE|-")] = None,
    dry_run: Annotated[bool, Words(short="n")] = False,
    footprint: Footprint | None = None,
    robot: RobotOption = None,
) -> RunAnswer:
    """Run maps through a recipe: inflation, distance field, costmap.

    Each map gets its own folder: a pgm, yaml and png file of every stage, npz files of field and
    costs, and a manifest. Maps whose manifest shows no change are skipped.

    A MAP is a map_server .yaml, a .pbm with its .yaml, or an .npz; a folder, for all such .yaml
    files in it and below; a quoted pattern such as "maps/**/*.yaml"; or @LIST.txt, a file with one
    such name per line (@- reads standard input). Maps of several keep their path below DIR.

    With --params-file the maps get the costs of a robot, as its own Nav2 or ROS 1 parameters define
    them; options on the command line override the file. With --recipe, only its shape is used.

    With --pose, a single map also gets the local map around a robot there, with or without --cloud.

    If a map fails, the others continue: the exit code is 5, and DIR/summary.json has the outcome
    of each. A map that --strict refuses counts as failed. If the robot does not reach a goal, or
    the verdict of --report is a problem, everything is written and the exit code is 1.

    Parameters
    ----------
    sources : list of str
        Maps, folders, quoted patterns, or @LIST.txt.
    recipe : str, optional
        One of default, nav2, local, arena, design-real, design-sim, design-local, or a file.
        [default: default; with --params-file the robot's costmap]
    sim : bool
        Map of a simulated world: use its active region, and treat unknown cells as obstacles.
    changes : list of str, optional
        Set a parameter of a stage; can be repeated.
    canvas : {'crop', 'full'}
        Extent of the outputs: the active region, or the whole map, unknown outside the region;
        stages compute on the region in either case, unless active.canvas=full is --set.
    pose : tuple of float, optional
        Also make the local map around a robot at this pose, as `mapdeal local` does, in the
        subfolder local of the map's folder.
    cloud : str, optional
        The point cloud that the robot at --pose sees. [default: a window of the map]
    frame : {'robot', 'map'}, optional
        The frame of the cloud's coordinates. [default: robot]
    local_recipe : str, optional
        Recipe of the local map, as for --recipe. [default: local]
    golden : path, optional
        Compare each stage with a stored run; exit with 1 if any differs.
    update_golden : bool
        Store the runs in --golden instead of comparing.
    jobs : int, optional
        Number of maps to run at the same time, each in a process. [default: number of cores]
    scheduler : str, optional
        Run the maps on the workers of this dask scheduler. [needs the package distributed]
    report : bool
        Also write a page of all results, with a verdict on each map, to DIR/report.html, and the
        verdicts to DIR/report.json. Lint checks the maps, and reach, if there is a robot or a goal.
    start : tuple of float, optional
        Where the robot starts, metres and radians, as for `mapdeal reach`.
    goals : sequence of Goal
        Goal that the robot must reach, metres, or the name of one in --points; more may follow;
        exit with 1 if it is not reached.
    points : path, optional
        File of goals, as for `reach`; - reads standard input.
    dry_run : bool
        Only list the files to read and write, the maps to skip and to refuse, and the memory.
    """
    terminal = work.terminal
    if update_golden and golden is None:
        raise errors.ParameterError("needs --golden DIR", place="update_golden")
    if "-" in sources:
        rule = "standard input has no name for a folder of outputs"
        hint = "mapdeal convert - -o FILE.npz keeps it under a name; @- takes names of maps"
        raise errors.ParameterError(rule, source="-", hint=hint)
    if output == Path("-"):
        hint = "standard output takes one file: mapdeal cost MAP -o -"
        raise errors.ParameterError("must be a folder", place="-o", got="-", hint=hint)
    loaded = recipes.load_recipe(recipe, changes, footprint=footprint, sim=sim, robot=robot)
    pipeline.used_mask(loaded, work.settings.mask)
    for step in loaded.steps:
        terminal.detail(step_line(step))
    if canvas == "full" and not loaded.is_smaller:
        errors.emit_warning("--canvas full: has no effect, no stage of the recipe crops the map")
        canvas = "crop"
    settings = records.replace(work.settings, canvas=canvas, progress=None)
    around = None
    if pose is None:
        inputs.refuse("needs --pose", cloud=cloud, frame=frame, local_recipe=local_recipe)
    else:
        shape = robot.footprint if footprint is None and robot is not None else footprint
        around = _around(pose, cloud, frame, local_recipe, shape)
    if scheduler is not None:
        inputs.refuse("cannot be given together with --scheduler", pose=pose)
        output = absolute_path(output)
    listing = list_maps(sources, output, terminal.input_chunks, lists_empty=True)
    names = {path.name for path in pipeline.output_folder(output, {}, loaded, settings).outputs()}
    all_jobs = batch.jobs_of(listing.maps, output, names)
    listing.print_notes(terminal, "run")
    is_batch = listing.is_set or len(all_jobs) > 1
    if around is not None and len(all_jobs) > 1:
        raise errors.ParameterError(f"takes one map, there are {len(all_jobs)}", place="pose")
    shows_progress = not is_batch and scheduler is None  # where one map is run here
    progress = work.settings.progress if shows_progress else None
    map_run = batch.MapRun(records.replace(settings, progress=progress), loaded, around)
    size = None
    if scheduler is not None:
        all_jobs = [records.replace(job, path=absolute_path(job.path)) for job in all_jobs]
        mask = settings.mask and absolute_path(settings.mask)
        map_run = records.replace(map_run, settings=records.replace(settings, mask=mask))
    else:
        size = batch.jobs_at_once(jobs, len(all_jobs), terminal)
        map_run = map_run.sharing(size)
    page: Path | None = None
    goal_check: RunChecks | None = None
    if report or start is not None or goals or points is not None:
        from mapdeal.commands.report import VERDICT, RunChecks, page_in, written

        page = page_in(output) if report else None
        if page:
            with settings.reading():
                claim(page, _PAGE_BYTES, what="pages of results")
        map_of_folder = {job.folder: job.path for job in all_jobs if job.error is None}
        listed = chosen_goals(goals, points)
        goal_check = RunChecks(settings, footprint, robot, start, listed, map_of_folder)
    if dry_run:
        also_written = [output / batch.SUMMARY] if is_batch else []
        also_written += [page, output / VERDICT] if page else []
        plans = batch.Plans([batch.plan_of(job, map_run) for job in all_jobs], size, also_written)
        if not is_batch and plans.plans[0].error is not None:
            raise plans.plans[0].error
        return RunAnswer(plans)
    workers: batch.Workers | None = None
    is_default = recipe is None and robot is None
    assumed = list(_assumed(loaded, changes or [], footprint)) if is_default else []
    with ExitStack() as stack:
        if scheduler is not None:
            from mapdeal.pipeline.workers import ClusterWorkers, connected, shared_folders

            client = stack.enter_context(connected(scheduler, shared_folders(all_jobs[0])))
            workers = cluster = ClusterWorkers(client, scheduler, jobs)
            map_run = map_run.within(cluster.memory_of_each())
        elif size is not None and size > 1:
            from mapdeal.pipeline.workers import ProcessWorkers  # slow to import

            workers = ProcessWorkers(size)
        if is_batch:
            place: Any = all_jobs, output, map_run, batch.Batch, terminal
            answer = RunAnswer(batch.run_and_report(*place, workers=workers), assumed)
        else:
            (job,) = all_jobs
            run_report = _on_cluster(job, map_run, workers, terminal) if workers else map_run(job)
            answer = RunAnswer(run_report, assumed if run_report.status == "done" else [], job)
    if goal_check is not None:
        if page is not None:
            folders = [output] if is_batch else [all_jobs[0].folder]
            shown = written(page, folders, records.replace(settings, force=True), goal_check)
            answer = records.replace(answer, page=shown)
        else:
            paths = [job.path for job in all_jobs]
            if isinstance(answer.outcome, batch.Batch):
                paths = answer.outcome.done_paths()
            answer = records.replace(answer, goals=[goal_check.answer(path) for path in paths])
        errors.refuse_warnings("; the maps are written")
    outcome = answer.outcome
    if golden is None or (isinstance(outcome, batch.Batch) and outcome.count("failed")):
        return answer
    runs = [(job.folder, job.place) for job in all_jobs]
    if around is not None:
        local = pipeline.LOCAL_RECIPE
        runs += [(folder / local, f"{place}/{local}") for folder, place in runs]
    if update_golden:
        stored = [f"{store_golden(folder, golden, place)}: stored" for folder, place in runs]
        return records.replace(answer, stored=stored)
    found = (differences_from_golden(folder, golden, place) for folder, place in runs)
    return records.replace(answer, golden=golden, differing=[*chain.from_iterable(found)])


@records.dataclass(frozen=True, repr=False)
class RunAnswer(Result):
    outcome: pipeline.RunReport | batch.Batch | batch.Plans
    assumed: Sequence[str] = ()
    job: batch.Job | None = None  # if there is one map
    page: WrittenReport | None = None
    golden: Path | None = None
    stored: Sequence[str] = ()
    differing: Sequence[str] = ()
    goals: Sequence[GoalAnswer] = ()  # empty if a page has them

    def document(self) -> dict[str, Any]:
        document = self.outcome.document()
        if self.job is not None:
            head = {"map": self.job.name, "folder": self.job.place}
            document = {"maps": [{**head, **batch.Outcome(self.outcome).document(self.job)}]}
        if self.page is not None:
            document["report"] = self.page.document()
        if self.goals:
            named = ({"map": {"file": str(goal.path)}, **goal.document} for goal in self.goals)
            document["reach"] = list(named)
        if self.golden is not None:
            document["differing"] = list(self.differing)
        return document

    def lines(self) -> Iterator[str]:
        lines = [self.assumed, self.outcome.lines()]  # the last line of a batch counts its maps
        yield from chain.from_iterable(lines if self.job is None else reversed(lines))
        if self.page is not None:
            yield from self.page.lines()
        yield from chain.from_iterable(answer.lines for answer in self.goals)
        yield from self.stored
        if self.golden is not None and not self.differing:
            yield f"{self.golden}: all stages as stored"

    def details(self) -> Iterable[str]:
        return self.outcome.details()

    def found(self) -> Iterable[str]:
        return self.differing

    def check(self) -> None:
        if self.differing:
            verb = "differs" if len(self.differing) == 1 else "differ"
            rule = f"{count_text(len(self.differing), 'stage')} {verb} from the golden run"
            raise errors.FindingError(rule, source=self.golden, hint="--update-golden accepts them")
        self.outcome.check()
        if self.page is not None:
            self.page.check()
        problems = [answer.problem for answer in self.goals if answer.problem is not None]
        if problems:
            more = f"; {len(problems) - 1} more of {len(self.goals)} maps have problems"
            hint = "--report also writes a page that shows where the robot can go"
            raise errors.FindingError(problems[0] + more * (len(problems) > 1), hint=hint)


def _assumed(
    recipe: recipes.Recipe, changes: Sequence[str], footprint: Footprint | None
) -> Iterator[str]:
    radii = [step.parameters["radius"] for step in recipe.steps if step.name == "inflate"]
    advice = "--params-file FILE, or --recipe nav2"
    if radii and footprint is not None:
        shape = "--footprint F" if footprint.vertices else f"--robot-radius {footprint.radius:g}"
        text = f"recipe default: walls are inflated by {radii[0]:g} m for {robot_text(footprint)}, "
        yield f"{text}in place of inscribed costs; {advice} {shape}, makes the costmap of Nav2"
    elif radii and not any(text.strip().startswith("inflate.") for text in changes):
        text = f"no robot is given: walls are inflated by {radii[0]:g} m; {advice}"
        yield f"{text} --robot-radius R, makes the costmap of a robot"


def _around(
    pose: Sequence[float], cloud: str | None, frame: CloudFrame | None, recipe: str | None,
    footprint: Footprint | None,
) -> Around:  # fmt: skip
    from mapdeal.mapping.local_map import LocalOptions
    from mapdeal.mapping.transforms import check_pose
    from mapdeal.pipeline.local import Around, only_cloud  # of use to few runs

    if cloud is None:
        inputs.refuse("needs --cloud", frame=frame)
    try:
        place = check_pose(pose, "--pose")
        name = pipeline.LOCAL_RECIPE if recipe is None else recipe
        loaded = recipes.load_recipe(name, footprint=footprint)
        cloud_path = None if cloud is None else only_cloud([cloud]).path
        return Around(place, loaded, LocalOptions(frame or "robot"), cloud_path)
    except errors.ParameterError as error:
        if error.place == "recipe":
            error.place = "local_recipe"
        raise


def _on_cluster(
    job: batch.Job, run: batch.MapRun, workers: batch.Workers, terminal: inputs.Terminal
) -> pipeline.RunReport:  # fmt: skip
    outcomes: dict[int, batch.Outcome] = {}
    batch.dispatch(1, lambda _: job, partial(batch.attempt, run), workers, outcomes.__setitem__)
    for text in outcomes[0].warnings:
        terminal.warn(text)
    report: pipeline.RunReport | errors.MapdealError = outcomes[0].result
    if isinstance(report, errors.MapdealError):
        raise report
    return report
