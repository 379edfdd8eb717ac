"""A run: one map through one recipe into one folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mapdeal.formats.npz import Grid
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.folder import Filling, OutputFolder, Product, fill_together
from mapdeal.pipeline.memory import opened_map
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings


@dataclass(frozen=True)
class RunReport:
    """What a run did.

    Parameters
    ----------
    folder : Path
        Where its outputs are.
    status : {'done', 'unchanged'}
        ``unchanged``: the manifest shows that everything was there already.
    figures : dict
        The figures of each stage by its name.
    """

    folder: Path
    status: Literal["done", "unchanged"]
    figures: dict[str, Figures]


def run_map(
    path: Path, folder: Path, recipe: Recipe, settings: Settings = DEFAULT_SETTINGS
) -> RunReport:  # fmt: skip
    """Read a map, apply a recipe and write everything into a folder.

    Parameters
    ----------
    path : Path
        The map.
    folder : Path
        Where outputs go; it is made if missing. They appear together, the manifest last.
    recipe : Recipe
        The stages.
    settings : Settings
        How to read, compute, draw and write.

    Raises
    ------
    MapdealError
        If the map cannot be read or processed, or outputs exist that the manifest does not
        show to be these; nothing is changed then.
    """
    with (
        use_threads(settings.threads),
        opened_map(
            path, recipe.steps, settings, image_max=settings.picture_size, with_sums=True
        ) as source,
    ):
        target = output_folder(folder, source.sums, recipe, settings)
        target.check_inputs(source.files)
        figures = None if settings.force else target.unchanged_figures()
        if figures is not None:
            target.repeat_warnings(path)
            return RunReport(folder, "unchanged", figures)
        canvas = source.grid.frame if settings.canvas == "full" else None
        products = products_of(recipe, source.grid, path, canvas=canvas)
        (figures,) = fill_together(
            [Filling(target, products, path.stem, source.files)],
            progress=settings.progress if source.grid.is_lazy else None,
        )
        return RunReport(folder, "done", figures)


def output_folder(
    folder: Path, sums: Mapping[str, str], recipe: Recipe, settings: Settings
) -> OutputFolder:
    """Return the folder of a run, given the names and sums of the files that hold its map."""
    options = {
        "dialect": settings.dialect, **settings.picture_options, "canvas": settings.canvas
    }  # fmt: skip
    return OutputFolder(folder, recipe.steps, sums, options, settings)


def products_of(
    recipe: Recipe, grid: Grid, path: Path, *, canvas: Frame | None = None
) -> Iterator[Product]:
    """Yield what each step of a recipe makes of a grid; errors name the file it came from.

    With a canvas, each product is put onto it. That changes nothing of what steps compute.
    """
    for step in recipe.steps:
        made = step.apply(grid, path)
        yield Product(step, made if canvas is None else on_canvas(made, canvas))
        if step.stage.hands_on:
            grid = made
