"""``mapdeal run``: maps through a whole recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import run_options as run_opt
from mapdeal.cli import terminal
from mapdeal.errors import BatchError, FindingError, MapdealError, ParameterError, one_line
from mapdeal.pipeline.batch import SUMMARY, folders_of, run_all
from mapdeal.pipeline.figures import summary_of
from mapdeal.pipeline.golden import differences_from_golden, store_golden
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import RunOptions, RunReport, run_map
from mapdeal.render.raster import DEFAULT_IMAGE_MAX

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
def run(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="MAP...", help="map_server .yaml files, or .npz of mapdeal's."),
    ],
    output: Annotated[
        Path, opt.output_argument("DIR", "Where the folder of each map goes, named as the map.")
    ],
    recipe: run_opt.Recipe = "default",
    sim: Annotated[
        bool,
        typer.Option(
            "--sim", help="The map is of a simulated world: cut out its active region first."
        ),
    ] = False,
    settings: run_opt.Settings = None,
    footprint: opt.FootprintText = None,
    robot_radius: opt.RobotRadius = None,
    footprint_padding: opt.FootprintPadding = 0.0,
    robot_16_gon: opt.Robot16Gon = False,
    image_max: run_opt.ImageMax = DEFAULT_IMAGE_MAX,
    no_images: run_opt.NoImages = False,
    golden: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Compare each stage with a stored run; exit 1 if any differs."
        ),
    ] = None,
    update_golden: Annotated[
        bool, typer.Option("--update-golden", help="Store the runs in --golden instead.")
    ] = False,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    max_memory: opt.MaxMemory = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Run maps through a recipe: inflate, field, costmap.

    Each map gets a folder of its own: a pgm, yaml and png file of every stage, npz files of
    field and costs, and a manifest. A map whose manifest shows that nothing has changed is skipped.
    """
    opt.start(quiet=quiet, verbose=verbose)
    if update_golden and golden is None:
        raise ParameterError("needs --golden DIR", source="--update-golden")
    shape = opt.robot_shape(footprint, robot_radius, footprint_padding, as_16_gon=robot_16_gon)
    loaded = load_recipe(recipe, sim=sim, footprint=shape, settings=settings or [])
    for one in loaded.steps:
        terminal.detail(opt.described(one.name, one.described()[one.name]))
    run_options = RunOptions(dialect.value, images=not no_images, image_max=image_max)
    folders = folders_of(sources, output)
    memory = None if max_memory is None else opt.size_of(max_memory, "--max-memory")

    def run_one(path: Path, folder: Path) -> RunReport:
        report = run_map(
            path,
            folder,
            loaded,
            options=run_options,
            force=force,
            threads=threads,
            max_cells=max_cells,
            max_memory=memory,
        )
        terminal.summary(_lines(path, report))
        return report

    if len(sources) == 1:
        run_one(sources[0], folders[0])
        _compare_with_golden(folders, golden, update=update_golden)
        return
    jobs = list(zip(sources, folders, strict=True))
    with terminal.few_warnings(f"{output / SUMMARY} has them all") as warn:
        results = run_all(jobs, output, run_one, terminal.error, warn)
    failed = sum(isinstance(result, MapdealError) for result in results)
    unchanged = sum(isinstance(r, RunReport) and r.status == "unchanged" for r in results)
    done = len(results) - failed - unchanged
    terminal.summary([f"{done} done, {unchanged} unchanged, {failed} failed"])
    if failed:
        raise BatchError(f"{failed} of {len(results)} maps failed")
    _compare_with_golden(folders, golden, update=update_golden)


def _compare_with_golden(folders: list[Path], golden: Path | None, *, update: bool) -> None:
    """Store the runs, or tell what differs from those that are stored."""
    if golden is None:
        return
    if update:
        stored = [store_golden(folder, golden) for folder in folders]
        terminal.summary([f"{path}: stored" for path in stored])
        return
    lines = [line for folder in folders for line in differences_from_golden(folder, golden)]
    for line in lines:
        terminal.result(one_line(line))
    if lines:
        rule = f"{len(lines)} stages differ from the golden run"
        raise FindingError(rule, source=golden, hint="--update-golden takes them over")
    terminal.summary([f"{golden}: all stages as stored"])


def _lines(path: Path, report: RunReport) -> list[str]:
    if report.status == "unchanged":
        return [f"{path} -> {report.folder}: unchanged"]
    lines = [f"{path} -> {report.folder}"]
    for stage, figures in report.figures.items():
        size = f"{figures['width']} x {figures['height']}"
        lines.append(f"  {stage:<8} {size} cells, {summary_of(figures)}")
    return lines
