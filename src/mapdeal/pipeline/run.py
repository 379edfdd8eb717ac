"""A run: one map through one recipe into one folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from mapdeal.formats.large_maps import LargeSource
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import Source
from mapdeal.formats.npz import AnyGrid
from mapdeal.formats.source import sha256_of
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.figures import Figures
from mapdeal.pipeline.folder import OutputFolder, Pictures, Product
from mapdeal.pipeline.large import opened_source
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import ProgressCallback, Settings
from mapdeal.render.raster import DEFAULT_IMAGE_MAX


@dataclass(frozen=True)
class RunOptions:
    """What shapes a run beside its recipe, and is part of its manifest.

    Parameters
    ----------
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading of the image to follow.
    images : bool
        Whether pictures are written.
    image_max : int
        Longest side of a picture in pixels; 0 for one pixel per cell.
    """

    dialect: Dialect = "nav2"
    images: bool = True
    image_max: int = DEFAULT_IMAGE_MAX

    @property
    def picture_size(self) -> int | None:
        """`image_max`, None if there are no pictures."""
        return self.image_max if self.images else None


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
    path: Path,
    folder: Path,
    recipe: Recipe,
    *,
    options: RunOptions = RunOptions(),
    force: bool = False,
    threads: int | None = None,
    max_cells: int | None = None,
    max_memory: int | None = None,
    watch: ProgressCallback | None = None,
) -> RunReport:
    """Read a map, apply a recipe and write everything into a folder.

    Parameters
    ----------
    path : Path
        The map.
    folder : Path
        Where outputs go; it is made if missing. They appear together, the manifest last.
    recipe : Recipe
        The stages.
    options : RunOptions
        How to read and draw.
    force : bool
        Whether outputs that exist are replaced.
    threads : int, optional
        Threads to compute and write with; all processors if not given.
    max_cells : int, optional
        Cells up to which the map is read.
    max_memory : int, optional
        Bytes of memory that may be taken; half of what is free if not given. A map that needs
        more is worked on by slabs of rows, with the same result.
    watch : callable, optional
        Told how far that is.

    Raises
    ------
    MapdealError
        If the map cannot be read or processed, or outputs exist that the manifest does not
        show to be these; nothing is changed then.
    """
    reading = Settings(options.dialect, max_cells, max_memory=max_memory)
    with (
        use_threads(threads),
        opened_source(path, recipe.steps, reading, image_max=options.picture_size) as source,
    ):
        return _run(source, folder, recipe, options, force, watch)


def _run(
    source: Source | LargeSource, folder: Path, recipe: Recipe, options: RunOptions, force: bool,
    watch: ProgressCallback | None,
) -> RunReport:  # fmt: skip
    target = output_folder(folder, source.files, recipe, options)
    figures = None if force else target.unchanged_figures()
    if figures is not None:
        return RunReport(folder, "unchanged", figures)
    path = source.files[0]
    figures = target.fill(
        products_of(recipe, source.grid, path),
        stem=path.stem,
        files=source.files,
        force=force,
        watch=watch if isinstance(source, LargeSource) else None,
    )
    return RunReport(folder, "done", figures)


def output_folder(
    folder: Path, files: Sequence[Path], recipe: Recipe, options: RunOptions
) -> OutputFolder:
    """Return the folder of a run, given the files that hold its map."""
    return OutputFolder(
        folder,
        recipe.steps,
        {file.name: sha256_of(file) for file in files},
        asdict(options),
        Pictures(options.images, options.image_max),
    )


def products_of(recipe: Recipe, grid: AnyGrid, path: Path) -> Iterator[Product]:
    """Yield what each step of a recipe makes of a grid; errors name the file it came from."""
    for step in recipe.steps:
        made = step.apply(grid, path)
        yield Product(step, made)
        if step.hands_on:
            grid = made
