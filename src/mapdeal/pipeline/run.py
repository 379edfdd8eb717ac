"""A run: one map through one recipe into one folder."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from mapdeal.formats.json_text import json_of, read_json
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import Source, read_source
from mapdeal.formats.source import holds, sha256_of
from mapdeal.formats.transaction import Transaction, remove_if_unchanged
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.figures import Figures, figures_of
from mapdeal.pipeline.products import paths_of, write_products
from mapdeal.pipeline.recipe import Recipe
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.version import __version__

MANIFEST = "manifest.json"
_FORMAT = "mapdeal-run/1"


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

    Raises
    ------
    MapdealError
        If the map cannot be read or processed, or outputs exist that the manifest does not
        show to be these; nothing is changed then.
    """
    with use_threads(threads):
        return _run_map(path, folder, recipe, options, force, max_cells)


def _run_map(
    path: Path,
    folder: Path,
    recipe: Recipe,
    options: RunOptions,
    force: bool,
    max_cells: int | None,
) -> RunReport:
    source = read_source(path, dialect=options.dialect, max_cells=max_cells)
    manifest: dict[str, Any] = {
        "format": _FORMAT,
        "version": __version__,
        "inputs": {file.name: sha256_of(file) for file in source.files},
        "options": asdict(options),
        "stages": recipe.described(),
    }
    old = read_json(folder / MANIFEST)
    if not force and _is_unchanged(old, manifest, folder):
        return RunReport(folder, "unchanged", old["figures"])
    hint = "--force replaces it"
    if isinstance(old, dict):
        hint += "; the run in this folder had other inputs, parameters, or its files were changed"
    outputs = _outputs(folder, recipe, options)
    with Transaction(outputs, inputs=source.files, force=force, hint=hint) as transaction:
        figures = _compute(transaction, source, folder, recipe, options, manifest)
    if isinstance(old, dict):
        _remove_left_over(old, folder, recipe, options)
    return RunReport(folder, "done", figures)


def _compute(
    transaction: Transaction,
    source: Source,
    folder: Path,
    recipe: Recipe,
    options: RunOptions,
    manifest: dict[str, Any],
) -> dict[str, Figures]:
    grid = source.grid
    figures: dict[str, Figures] = {}
    for step in recipe.steps:
        made = step.apply(grid, source.files[0])
        figures[step.name] = figures_of(made)
        write_products(
            transaction,
            step,
            made,
            folder,
            stem=source.files[0].stem,
            images=options.images,
            image_max=options.image_max,
        )
        if step.hands_on:
            grid = made
    sums = {path.name: digest for path, digest in transaction.checksums().items()}
    document = json_of({**manifest, "figures": figures, "outputs": sums})
    transaction.write_bytes(folder / MANIFEST, document)
    return figures


def _outputs(folder: Path, recipe: Recipe, options: RunOptions) -> list[Path]:
    paths = [p for step in recipe.steps for p in paths_of(step, folder, images=options.images)]
    return [*paths, folder / MANIFEST]


def _is_unchanged(old: Any, manifest: dict[str, Any], folder: Path) -> bool:
    """Return whether an old manifest is of the same run, and its outputs are still its own."""
    if not isinstance(old, dict) or not isinstance(old.get("figures"), dict):
        return False
    if any(old.get(key) != value for key, value in manifest.items()):
        return False
    outputs = old.get("outputs")
    if not isinstance(outputs, dict):
        return False
    return all(holds(folder / Path(name).name, str(sum_)) for name, sum_ in outputs.items())


def _remove_left_over(
    old: dict[str, Any], folder: Path, recipe: Recipe, options: RunOptions
) -> None:
    """Remove outputs of the replaced run that this one does not make, if nobody changed them."""
    current = {path.name for path in _outputs(folder, recipe, options)}
    outputs = old.get("outputs")
    for name, digest in outputs.items() if isinstance(outputs, dict) else ():
        path = folder / Path(str(name)).name
        if path.name not in current:
            remove_if_unchanged(path, str(digest))
