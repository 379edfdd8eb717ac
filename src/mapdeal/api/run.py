"""A map through a recipe, from file to folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

from mapdeal.api.recipe import RecipeLike, load_recipe
from mapdeal.errors import ParameterError
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.applied import RunReport
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Canvas, Settings
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.render.shown import DEFAULT_EXTENT, ImageExtent


def run(
    path: str | PathLike[str],
    output: str | PathLike[str],
    recipe: RecipeLike = "default",
    changes: Mapping[str, object] | None = None,
    *,
    footprint: Footprint | None = None,
    sim: bool = False,
    canvas: Canvas = "crop",
    images: bool = True,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = DEFAULT_EXTENT,
    force: bool = False,
    strict: bool = False,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
    threads: int | None = None,
) -> RunReport:
    """Run a map through a recipe into a folder, as ``mapdeal run MAP -o DIR`` does.

    Parameters
    ----------
    path : path or str
        A map_server ``.yaml``, a ``.pbm`` with its ``.yaml`` beside it, or an ``.npz``.
    output : path or str
        DIR: the outputs go into a folder in it that is called as the map.
    recipe, changes, footprint, sim
        As of `load_recipe`.
    canvas : {'crop', 'full'}
        Whether outputs cover what stages have computed, or the whole map.
    images : bool
        Whether there is a picture of each product.
    image_max : int
        Longest side of the maps in pictures, pixels; 0 for one pixel per cell.
    image_extent : {'known', 'all'}
        Whether pictures show the known cells and a margin, or all of the map.
    force : bool
        Whether outputs that exist are replaced.
    strict : bool
        Whether there is an error, before anything is written, if there is anything to warn of.
    dialect, max_cells
        As of `read_map`.
    max_memory : int, optional
        Bytes of memory that may be used; half of what is free if not given. A map that needs
        more is processed in blocks of rows, with the same result, or refused.
    threads : int, optional
        Threads to compute and write with; all processors if not given.

    Returns
    -------
    RunReport
        The folder, whether everything was there already, and the figures of each stage.

    Raises
    ------
    FileAccessError
        If a file cannot be read or written, or outputs exist that are not these.
    MalformedInputError
        If the map is malformed, or needs too much memory.
    ParameterError
        If the recipe or a parameter is not allowed.
    FindingError
        If there is anything to warn of, and the run is strict.

    Warns
    -----
    MapdealWarning
        Of what reading had to choose, and of products that say nothing.

    Notes
    -----
    Outputs appear together, the manifest last; after an error nothing has changed. One map a
    call: for folders of maps, several at a time, the command line is made.
    """
    if not isinstance(path, str | PathLike):
        hint = "apply_recipe takes a grid, write_map writes it to a file"
        raise ParameterError("takes the path of a map", place="run", got=path, hint=hint)
    source = Path(path)
    settings = Settings(
        dialect=dialect,
        max_cells=max_cells,
        force=force,
        strict=strict,
        threads=threads,
        max_memory=max_memory,
        images=images,
        image_max=image_max,
        image_extent=image_extent,
        canvas=canvas,
    )
    loaded = load_recipe(recipe, changes, footprint=footprint, sim=sim)
    if settings.canvas == "full" and not loaded.is_smaller:
        settings = replace(settings, canvas="crop")  # the same, as manifests tell it
    return run_map(source, Path(output) / source.stem, loaded, settings)
