"""A run: one map through one recipe into one folder, and what is around a robot into another."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from mapdeal.errors import emit_warning
from mapdeal.formats.json_values import read_json
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.applied import RunReport, around_in, products_of
from mapdeal.pipeline.folder import MANIFEST, Filling, OutputFolder, fill_together
from mapdeal.pipeline.heard import heard
from mapdeal.pipeline.memory import opened_map
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings

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
