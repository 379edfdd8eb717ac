"""A run: one map through one recipe into one folder, and what is around a robot into another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from mapdeal.errors import emit_warning
from mapdeal.files.json_values import read_json
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.display import OneLine
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.npz import Grid
from mapdeal.pipeline.folder import MANIFEST, Filling, OutputFolder, Product, fill_together
from mapdeal.pipeline.inputs import opened_map
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings, heard

LOCAL_RECIPE = "local"
"""The recipe for local maps, and the folder of the one that a run makes."""


def around_in(folder: Path) -> Path:
    """Return where the local map of a run goes, given the run's folder."""
    return folder / LOCAL_RECIPE


@dataclass(frozen=True, repr=False)
class RunReport(OneLine):
    """Report of a run.

    Parameters
    ----------
    folder : Path
        Folder of the outputs.
    status : {'done', 'unchanged'}
        ``unchanged`` if the manifest shows that all outputs existed already.
    figures : dict
        Figures of each stage, by the name of the stage.
    local : RunReport, optional
        Report of the local map, if one was requested.
    """

    folder: Path
    status: Literal["done", "unchanged"]
    figures: dict[str, Figures]
    local: RunReport | None = None

    def _told(self) -> Iterator[str]:
        yield str(self.folder)
        yield self.status
        yield f"stages {' '.join(self.figures)}"
        if self.local is not None:
            yield f"local map {self.local!r}"


def products_of(
    recipe: Recipe, grid: Grid, path: Path | None, *, canvas: Frame | None = None
) -> Iterator[Product]:
    """Yield the product of each step of a recipe; errors name the file of the grid, if any."""
    # With a canvas, each product is extended to it, which does not change what the steps compute.
    for step in recipe.steps:
        made = step.apply(grid, path)
        yield Product(step, made if canvas is None else on_canvas(made, canvas))
        if step.stage.hands_on:
            grid = made


if TYPE_CHECKING:  # only runs around a robot need what it imports
    from mapdeal.pipeline.local import Around


def run_map(
    path: Path,
    folder: Path,
    recipe: Recipe,
    settings: Settings = DEFAULT_SETTINGS,
    around: Around | None = None,
) -> RunReport:
    """Read a map, apply a recipe and write everything into a folder."""
    texts: list[str] = []
    with ExitStack() as stack:
        stack.enter_context(use_threads(settings.threads))
        with heard(texts):
            source = stack.enter_context(
                opened_map(
                    path, recipe.steps, settings, image_max=settings.picture_size, with_sums=True
                )
            )
        remarks = [*recipe.remarks, *texts]
        target = output_folder(folder, source.sums, recipe, settings)
        canvas = source.grid.frame if settings.canvas == "full" else None
        products = products_of(recipe, source.grid, path, canvas=canvas)
        fillings = [
            Filling(
                target,
                products,
                path.stem,
                (*source.files, *recipe.files),
                path,
                by_blocks=source.grid.is_lazy,
                heard=remarks,
                read=source.grid,
                robot=None if recipe.robot is None else recipe.robot.footprint,
            )
        ]
        if around is not None:
            fillings.append(around.filling(folder, source, settings, texts))
        return _filled(fillings, settings)


def _filled(fillings: list[Filling], settings: Settings) -> RunReport:
    """Fill the folders that do not hold all this already, together."""
    found = []
    for filling in fillings:
        filling.folder.check_inputs(filling.files)
        found.append(None if settings.force else filling.folder.unchanged_figures())
    new = [filling for filling, old in zip(fillings, found, strict=True) if old is None]
    for filling, old in zip(fillings, found, strict=True):
        if old is not None:
            filling.folder.repeat_warnings(filling)
    if len(fillings) == 1 and new:
        _warn_of_another(around_in(new[0].folder.path))
    made = iter(fill_together(new, progress=settings.progress) if new else [])
    reports = [
        RunReport(filling.folder.path, "done", next(made))
        if old is None
        else RunReport(filling.folder.path, "unchanged", old)
        for filling, old in zip(fillings, found, strict=True)
    ]
    run, *local = reports
    return RunReport(run.folder, run.status, run.figures, local[0]) if local else run


def _warn_of_another(folder: Path) -> None:
    """Warn of a local map that an earlier run has left beside what this one has made."""
    manifest = read_json(folder / MANIFEST)
    stages = manifest.get("stages") if isinstance(manifest, dict) else None
    if isinstance(stages, list) and stages and isinstance(stages[0], dict) and "local" in stages[0]:
        text = f"{folder}: holds the local map of an earlier run, which is left as it is"
        emit_warning(text, stacklevel=2)


def output_folder(
    folder: Path, sums: Mapping[str, str], recipe: Recipe, settings: Settings
) -> OutputFolder:
    """Return the folder of a run, given the names and sums of the files that hold its map."""
    options = {
        "dialect": settings.dialect, **settings.picture_options, "canvas": settings.canvas
    }  # fmt: skip
    robot = None if recipe.robot is None else recipe.robot.described()
    return OutputFolder(folder, recipe.steps, sums, options, settings, robot, shows_input=True)
