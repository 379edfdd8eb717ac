"""A recipe applied to a grid: the product of each step, and the report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from mapdeal.formats.npz import Grid
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.display import OneLine
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.pipeline.folder import Product
from mapdeal.pipeline.recipe import Recipe
from mapdeal.records import dataclass

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
