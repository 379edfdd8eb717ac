"""A run: one map through one recipe into one folder, and what is around a robot into another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mapdeal.command import Result
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.json_values import read_json
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.display import count_text
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.npz import Grid
from mapdeal.pipeline.folder import (
    MANIFEST,
    Filling,
    OutputFolder,
    Product,
    fill_together,
    summary_of,
)
from mapdeal.pipeline.inputs import claim_step, opened_map
from mapdeal.pipeline.recipe import DEFAULT, Recipe, RecipeLike, load_recipe
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Canvas, Settings, heard

_LEAST_COLUMN = 8
_ALL_AROUND = 2 * math.pi - 0.1
"""Radians: with gaps as short as this there is no direction that a cloud does not cover."""

LOCAL_RECIPE = "local"
"""The recipe for local maps, and the folder of the one that a run makes."""


def around_in(folder: Path) -> Path:
    """Return where the local map of a run goes, given the run's folder."""
    return folder / LOCAL_RECIPE


@dataclass(frozen=True, repr=False)
class RunReport(Result):
    """Report of a run.

    Parameters
    ----------
    folder : Path
        Folder of the outputs.
    status : {'done', 'unchanged'}
        ``unchanged`` if the manifest shows that all outputs existed already.
    figures : dict
        Figures of each stage, by the name of the stage.
    source : Path
        File that was processed: a map, or the cloud of a local map.
    local : RunReport, optional
        Report of the local map, if one was requested.
    """

    folder: Path
    status: Literal["done", "unchanged"]
    figures: dict[str, Figures]
    source: Path
    local: RunReport | None = None

    def document(self) -> dict[str, Any]:
        """Return the figures as the summary of a batch holds them."""
        local = {} if self.local is None else {"local": self.local.figures}
        return {"figures": self.figures, **local}

    def lines(self) -> Iterator[str]:
        """Yield what ``mapdeal run`` prints."""
        head = f"{self.source} -> {self.folder}"
        if self.status == "unchanged":
            yield f"{head}: unchanged"
        else:
            local = self.figures.get(LOCAL_RECIPE)
            yield head if local is None else f"{head}: {_summary_of_local(local)}"
            width = max(_LEAST_COLUMN, *map(len, self.figures))
            for stage, figures in self.figures.items():
                yield f"  {stage:<{width}} {size_text(figures)} cells, {summary_of(figures)}"
        if self.local is not None:
            yield from self.local.lines()

    def _told(self) -> Iterator[str]:
        yield str(self.folder)
        yield self.status
        yield f"stages {' '.join(self.figures)}"
        if self.local is not None:
            yield f"local map {self.local!r}"


def size_text(figures: Figures) -> str:
    return f"{figures['width']} x {figures['height']}"


def _summary_of_local(local: Figures) -> str:
    parts = []
    if "points" in local:
        reasons = {
            "not finite": local["not_finite"],
            "by height": local["beyond_height"],
            "by range": local["beyond_range"],
        }
        dropped = ", ".join(f"{count} {why}" for why, count in reasons.items() if count)
        text = f"{local['marking']} of {local['points']} points in the window"
        parts.append(text + (f" (dropped: {dropped})" if dropped else ""))
    if "from_map" in local:
        parts.append(f"{local['from_map']} cells from the map")
    if "clouds" in local:
        clouds = count_text(local["clouds"], "cloud")
        parts.append(f"of {clouds}, {local['from_earlier']} cells from earlier ones")
    if local.get("angle_min") is not None:
        around = local["angle_max"] - local["angle_min"] > _ALL_AROUND
        ends = f"from {local['angle_min']:.4g} to {local['angle_max']:.4g} rad of its heading"
        parts.append(f"seen {'all around' if around else ends}")
    return ", ".join([*parts, f"robot's back at {local['rear_heading']:.4g} rad"])


def products_of(
    recipe: Recipe, grid: Grid, path: Path | None, *, canvas: Frame | None = None
) -> Iterator[Product]:
    """Yield the product of each step of a recipe; errors name the file of the grid, if any."""
    # With a canvas, each product is extended to it, which does not change what the steps compute. A
    # stage that moves the map makes a new canvas.
    is_elsewhere = False
    for step in recipe.steps:
        is_elsewhere = is_elsewhere or step.stage.moves
        if is_elsewhere and path is not None:
            claim_step(path, grid, step)
        made = step.apply(grid, path)
        if canvas is not None and step.stage.moves:
            canvas = made.frame
        yield Product(step, made if canvas is None else on_canvas(made, canvas))
        if step.stage.hands_on:
            grid = made


def apply_recipe(
    grid: Grid,
    recipe: RecipeLike = DEFAULT,
    changes: Mapping[str, object] | Sequence[str] | None = None,
    *,
    footprint: Footprint | None = None,
    sim: bool = False,
    canvas: Canvas = "crop",
) -> dict[str, Grid]:
    """Apply a recipe to a grid in memory; the counterpart of `run` without files.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        Map to process. A costmap is processed as the map that ROS would publish, a field as the
        map that it was computed from.
    recipe, changes, footprint, sim
        As for `load_recipe`.
    canvas : {'crop', 'full'}
        Extent of the products: the cells that the stages computed, or the full map extent.

    Returns
    -------
    dict of str to grid
        Product of each stage by stage name, in order: a `DistanceField` for ``esdf``, a `Costmap`
        for ``cost``, an `OccupancyGrid` for ``inflate`` and ``active``.

    Raises
    ------
    ParameterError
        As for `load_recipe`, and if a stage cannot be applied to the grid.
    FileAccessError
        If the recipe file cannot be read.

    Warns
    -----
    MapdealWarning
        If a product carries no information, such as the same cost in all cells.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> made = apply_recipe(OccupancyGrid([[100, 0, 0]], 0.5), "nav2", {"cost.inflation_radius": 1})
    >>> list(made), made["cost"].cost.tolist()
    (['esdf', 'cost'], [[254, 110, 24]])
    """
    if not isinstance(grid, Grid):
        hint = "mapdeal.run takes the path of a map, read_map reads it"
        raise ParameterError("takes a grid", place="apply_recipe", got=grid, hint=hint)
    canvas = Settings(canvas=canvas).canvas
    loaded = load_recipe(recipe, changes, footprint=footprint, sim=sim)
    made = {}
    whole = grid.frame if canvas == "full" else None
    for product in products_of(loaded, grid, None, canvas=whole):
        made[product.step.name] = product.grid
        remark = product.step.remark_on(product.grid.figures())
        if remark is not None:
            emit_warning(remark, stacklevel=2)
    return made


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
        return _filled(path, fillings, settings)


def _filled(path: Path, fillings: list[Filling], settings: Settings) -> RunReport:
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
        RunReport(filling.folder.path, "done", next(made), path)
        if old is None
        else RunReport(filling.folder.path, "unchanged", old, path)
        for filling, old in zip(fillings, found, strict=True)
    ]
    run, *local = reports
    return replace(run, local=local[0]) if local else run


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
