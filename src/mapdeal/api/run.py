"""A map through a recipe, from file to folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

from mapdeal.api.recipe import RecipeLike, load_recipe
from mapdeal.errors import ParameterError, strict_warnings
from mapdeal.grid.footprint import Footprint
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pictures.overlay import DEFAULT_EXTENT, ImageExtent
from mapdeal.pictures.raster import DEFAULT_IMAGE_MAX
from mapdeal.pipeline.run import RunReport, run_map
from mapdeal.pipeline.settings import Canvas, Settings


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
    """Run a recipe on a map and write the results to a folder, like ``mapdeal run MAP -o DIR``.

    Parameters
    ----------
    path : path or str
        A map_server ``.yaml``, a ``.pbm`` with its ``.yaml`` next to it, or an ``.npz``.
    output : path or str
        Output folder; the results are written to a subfolder named after the map.
    recipe, changes, footprint, sim
        As for `load_recipe`.
    canvas : {'crop', 'full'}
        Extent of the outputs: the cells that the stages computed, or the full map extent.
    images : bool
        Whether to write a picture of each product.
    image_max : int
        Longest side of the maps in pictures, pixels; 0 for one pixel per cell.
    image_extent : {'known', 'all'}
        Area shown in pictures: the known cells with a margin, or the whole map.
    force : bool
        Whether to replace existing outputs.
    strict : bool
        Whether to turn warnings into an error before anything is written.
    dialect, max_cells
        As for `read_map`.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory. A map that needs more is
        processed in blocks of rows, with the same result, or refused.
    threads : int, optional
        Number of threads to compute and write with; by default one per core.

    Returns
    -------
    RunReport
        Output folder, whether the outputs were already up to date, and the figures of each stage.

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
    Outputs appear together, the manifest last; after an error nothing has changed. Each call
    processes one map; use the command line for folders of maps, several at a time.
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
    with strict_warnings(strict, source):
        loaded = load_recipe(recipe, changes, footprint=footprint, sim=sim)
        if settings.canvas == "full" and not loaded.is_smaller:
            settings = replace(settings, canvas="crop")  # the same, as manifests tell it
        return run_map(source, Path(output) / source.stem, loaded, settings)
