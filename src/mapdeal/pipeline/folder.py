"""A folder with the products of some stages, and the manifest that tells what they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mapdeal.formats.json_text import json_of, read_json
from mapdeal.formats.npz import AnyGrid
from mapdeal.formats.source import exists, holds
from mapdeal.formats.transaction import Transaction, remove_if_unchanged
from mapdeal.pipeline.figures import Figures, figures_of
from mapdeal.pipeline.products import paths_of, write_products
from mapdeal.pipeline.progress import passes_of, written
from mapdeal.pipeline.settings import ProgressCallback
from mapdeal.pipeline.stage_list import Step
from mapdeal.render.overlay import Overlay
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.version import __version__

MANIFEST = "manifest.json"
_FORMAT = "mapdeal-run/1"


@dataclass(frozen=True)
class Pictures:
    """Which pictures a folder gets.

    Parameters
    ----------
    images : bool
        Whether it gets any.
    image_max : int
        Longest side in pixels; 0 for one pixel per cell.
    """

    images: bool = True
    image_max: int = DEFAULT_IMAGE_MAX


@dataclass(frozen=True)
class Product:
    """What a step has made.

    Parameters
    ----------
    step : Step
        The step.
    grid : OccupancyGrid, Costmap, DistanceField, PotentialField or a large one
        Its result.
    figures : mapping
        What to tell of it beside the figures that every grid has.
    """

    step: Step
    grid: AnyGrid
    figures: Figures = field(default_factory=dict)


@dataclass(frozen=True)
class OutputFolder:
    """A folder, and what is to be in it.

    Parameters
    ----------
    path : Path
        Where it is, or will be.
    steps : sequence of Step
        Those whose products it gets.
    inputs : mapping of str to str
        The name of each file that was read, and its sha256.
    options : mapping
        What shaped the products beside the parameters of the steps, as JSON can hold it.
    pictures : Pictures
        Which pictures it gets.
    """

    path: Path
    steps: tuple[Step, ...]
    inputs: Mapping[str, str]
    options: Mapping[str, Any]
    pictures: Pictures

    def existing(self) -> list[Path]:
        """Return the files that `fill` would write and that are there already."""
        return [path for path in self.outputs() if exists(path)]

    def unchanged_figures(self) -> dict[str, Figures] | None:
        """Return the figures of each step, if the folder holds all this already."""
        old = read_json(self.path / MANIFEST)
        if not isinstance(old, dict) or not isinstance(old.get("figures"), dict):
            return None
        if any(old.get(key) != value for key, value in self._manifest().items()):
            return None
        outputs = old.get("outputs")
        if not isinstance(outputs, dict):
            return None
        same = all(holds(self.path / Path(name).name, str(sum_)) for name, sum_ in outputs.items())
        figures: dict[str, Figures] = old["figures"]
        return figures if same else None

    def fill(
        self,
        products: Iterable[Product],
        *,
        stem: str,
        files: Iterable[Path],
        force: bool,
        overlay: Overlay | None = None,
        watch: ProgressCallback | None = None,
    ) -> dict[str, Figures]:
        """Write all files, together, the manifest last; return the figures of each step.

        Parameters
        ----------
        products : iterable of Product
            One for each of `steps`, made while others are being written.
        stem : str
            What pictures call the input.
        files : iterable of Path
            All that was read: none of it may be written.
        force : bool
            Whether outputs that exist are replaced.
        overlay : Overlay, optional
            What is drawn over each picture.
        watch : callable, optional
            Told how far the writing is of grids that are too large for memory.
        """
        old = read_json(self.path / MANIFEST)
        hint = "--force replaces it"
        if isinstance(old, dict) and self.unchanged_figures() is None:
            hint += "; the run in this folder had other inputs, parameters, or its files were"
            hint += " changed"
        elif isinstance(old, dict):
            hint += "; this folder holds the same already"
        figures: dict[str, Figures] = {}
        passes = sum(passes_of(step, path.suffix) for step in self.steps
                     for path in self._outputs_of(step))  # fmt: skip
        with (
            written(watch, passes) as progress,
            Transaction(
                self.outputs(), inputs=tuple(files), force=force, hint=hint, checksums=True
            ) as transaction,
        ):
            for product in products:
                step, grid = product.step, product.grid
                figures[step.name] = {**figures_of(grid), **product.figures}
                write_products(
                    transaction,
                    step,
                    progress.watched(grid),
                    self.path,
                    stem=stem,
                    images=self.pictures.images,
                    image_max=self.pictures.image_max,
                    overlay=overlay,
                )
            sums = {path.name: digest for path, digest in transaction.checksums().items()}
            document = json_of({**self._manifest(), "figures": figures, "outputs": sums})
            transaction.write_bytes(self.path / MANIFEST, document)
        if isinstance(old, dict):
            self._remove_left_over(old)
        return figures

    def _manifest(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "version": __version__,
            "inputs": dict(self.inputs),
            "options": dict(self.options),
            "stages": [step.described() for step in self.steps],
        }

    def outputs(self) -> list[Path]:
        """Return the files that `fill` writes, the manifest last."""
        paths = [path for step in self.steps for path in self._outputs_of(step)]
        return [*paths, self.path / MANIFEST]

    def _outputs_of(self, step: Step) -> list[Path]:
        return paths_of(step, self.path, images=self.pictures.images)

    def _remove_left_over(self, old: dict[str, Any]) -> None:
        """Remove outputs of the replaced run that are not made any more, if nobody changed them."""
        current = {path.name for path in self.outputs()}
        outputs = old.get("outputs")
        for name, digest in outputs.items() if isinstance(outputs, dict) else ():
            path = self.path / Path(str(name)).name
            if path.name not in current:
                remove_if_unchanged(path, str(digest))
