"""A folder with the products of some stages, and the manifest that describes them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, emit_warning, one_line
from mapdeal.formats.json_text import json_of, read_json
from mapdeal.formats.npz import Grid
from mapdeal.formats.source import exists, holds, is_same_file, real_path
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures
from mapdeal.pipeline.figures import are_figures_of
from mapdeal.pipeline.heard import heard_from, located, portable
from mapdeal.pipeline.products import (
    figures_of,
    passes_of,
    paths_of,
    robot_overlays,
    write_picture,
    write_products,
)
from mapdeal.pipeline.progress import passes_reported
from mapdeal.pipeline.settings import ProgressCallback, Settings
from mapdeal.pipeline.step import Step
from mapdeal.records import dataclass
from mapdeal.render.overlay import Overlay, Overlays
from mapdeal.version import __version__

MANIFEST = "manifest.json"
INPUT_PICTURE = "input.png"
_FORMAT = "mapdeal-run/1"
_PASSES_OF_INPUT = 2
"""Of a map that is processed block by block, for its picture: others have no progress."""


@dataclass(frozen=True)
class Product:
    """What a step has made."""

    step: Step
    grid: Grid
    figures: Figures = field(default_factory=dict)


@dataclass(frozen=True)
class OutputFolder:
    """A folder, and what is to be in it."""

    path: Path
    steps: tuple[Step, ...]
    inputs: Mapping[str, str]
    options: Mapping[str, Any]
    settings: Settings
    robot: Mapping[str, Any] | None = None
    shows_input: bool = False

    def existing(self) -> list[Path]:
        """Return the files that would be written and that are there already."""
        return [path for path in self.outputs() if exists(path)]

    def check_inputs(self, files: Iterable[Path]) -> None:
        """Refuse inputs that lie in the folder.

        They would be taken for its products one day, replaced by others or removed with them.
        """
        for file in files:
            if any(is_same_file(one.parent, self.path) for one in (file, real_path(file))):
                rule = f"lies in {self.path}, where the outputs go"
                hint = "move it, or name another folder for the outputs"
                raise FileAccessError(rule, source=file, hint=hint)

    def unchanged_figures(self) -> dict[str, Figures] | None:
        """Return the figures of each step, if the folder holds all this already."""
        old = read_json(self.path / MANIFEST)
        if not isinstance(old, dict):
            return None
        if any(old.get(key) != value for key, value in self._manifest().items()):
            return None
        if self.robot is None and "robot" in old:
            return None
        outputs, stored = old.get("outputs"), old.get("figures")
        wanted = {path.name for path in self.outputs()} - {MANIFEST}
        if not isinstance(outputs, dict) or set(outputs) != wanted:
            return None
        if not are_figures_of(stored, [step.name for step in self.steps]):
            return None
        same = all(holds(self.path / Path(name).name, str(sum_)) for name, sum_ in outputs.items())
        figures: dict[str, Figures] = stored
        return figures if same else None

    def repeat_warnings(self, filling: Filling) -> None:
        """Warn of what the run that has written the folder has warned of.

        What reading has warned of, this time, too, is not said twice.
        """
        old = read_json(self.path / MANIFEST)
        remarks = old.get("warnings") if isinstance(old, dict) else None
        texts = [str(remark) for remark in remarks] if isinstance(remarks, list) else []
        for text in located(texts, filling.named):
            if text not in filling.heard:
                emit_warning(text, stacklevel=2)

    def passes(self) -> int:
        """Return how often the rows of lazy products are gone through to write them."""
        of_input = _PASSES_OF_INPUT * len(self._input_picture())
        return of_input + sum(
            passes_of(step, [path.suffix for path in self._outputs_of(step)]) for step in self.steps
        )

    def hint(self) -> str:
        """Return what to do about outputs that are there already."""
        hint = "--force replaces it"
        old = read_json(self.path / MANIFEST)
        if not isinstance(old, dict):
            return hint
        if self.unchanged_figures() is not None:
            return f"{hint}; this folder holds the same already"
        why = "the run in this folder had other inputs, parameters, or its files were changed"
        return f"{hint}; {why}"

    def write(self, transaction: Transaction, filling: Filling) -> dict[str, Figures]:
        """Write all files within a transaction, the manifest last; return each step's figures."""
        old = read_json(self.path / MANIFEST)
        figures: dict[str, Figures] = {}
        texts = list(filling.heard)
        if filling.read is not None:
            for path in self._input_picture():
                write_picture(
                    transaction,
                    path,
                    filling.read,
                    one_line(f"{filling.stem}: map as read"),
                    image_max=self.settings.image_max,
                    image_extent=self.settings.image_extent,
                )
        for product in heard_from(filling.products, texts):
            step, grid = product.step, product.grid
            figures[step.name] = {
                **figures_of(grid, box_of_known=self._shows_known), **product.figures
            }  # fmt: skip
            remark = step.remark_on(figures[step.name])
            if remark is not None:
                texts.append(f"{filling.subject}: {remark}")
                emit_warning(texts[-1], stacklevel=2)
            write_products(
                transaction,
                step,
                grid,
                self.path,
                stem=filling.stem,
                images=self.settings.images,
                image_max=self.settings.image_max,
                image_extent=self.settings.image_extent,
                overlay=_together(filling.overlay, robot_overlays(step, filling.robot)),
            )
        remarks = portable(texts, filling.named)
        made = transaction.checksums()
        sums = {path.name: digest for path, digest in made.items() if path.parent == self.path}
        document = json_of(
            {**self._manifest(), "figures": figures, "warnings": remarks, "outputs": sums}
        )
        transaction.write_bytes(self.path / MANIFEST, document)
        if isinstance(old, dict):
            self._remove_left_over(transaction, old)
        return figures

    @property
    def _shows_known(self) -> bool:
        """Whether there are pictures, of the known cells."""
        return self.settings.images and self.settings.image_extent == "known"

    def _manifest(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "version": __version__,
            "inputs": dict(self.inputs),
            "options": dict(self.options),
            **({} if self.robot is None else {"robot": dict(self.robot)}),
            "stages": [step.described() for step in self.steps],
        }

    def outputs(self) -> list[Path]:
        """Return the files that are written, the manifest last."""
        paths = [path for step in self.steps for path in self._outputs_of(step)]
        return [*self._input_picture(), *paths, self.path / MANIFEST]

    def _input_picture(self) -> list[Path]:
        return [self.path / INPUT_PICTURE] if self.shows_input and self.settings.images else []

    def _outputs_of(self, step: Step) -> list[Path]:
        return paths_of(step, self.path, images=self.settings.images)

    def _remove_left_over(self, transaction: Transaction, old: dict[str, Any]) -> None:
        """Remove outputs of the replaced run that are not made any more, if nobody changed them."""
        current = {path.name for path in self.outputs()}
        outputs = old.get("outputs")
        for name, digest in outputs.items() if isinstance(outputs, dict) else ():
            path = self.path / Path(str(name)).name
            if path.name not in current:
                transaction.remove_if_unchanged(path, str(digest))


@dataclass(frozen=True)
class Filling:
    """What goes into a folder."""

    folder: OutputFolder
    products: Iterable[Product]
    stem: str
    files: tuple[Path, ...]
    subject: Path
    overlay: Overlay | None = None
    by_blocks: bool = False
    heard: Sequence[str] = ()
    read: Grid | None = None
    robot: Footprint | None = None

    @property
    def named(self) -> tuple[Path, ...]:
        """All that warnings may be about."""
        return (*self.files, self.subject)


def _together(first: Overlay | None, others: Sequence[Overlay]) -> Overlay | None:
    """Return what is drawn over a picture, as one."""
    overlays = (*([] if first is None else [first]), *others)
    return Overlays(overlays) if overlays else None


def fill_together(
    fillings: Sequence[Filling], *, progress: ProgressCallback | None = None
) -> list[dict[str, Figures]]:
    """Write the files of some folders: all appear, or none; return the figures of each."""
    read = tuple(dict.fromkeys(file for filling in fillings for file in filling.files))
    for filling in fillings:
        filling.folder.check_inputs(read)
    folders = [filling.folder for filling in fillings]
    force = all(folder.settings.force for folder in folders)
    taken = next((folder for folder in folders if folder.existing()), folders[0])
    passes = sum(filling.folder.passes() for filling in fillings if filling.by_blocks)
    with (
        passes_reported(progress if passes else None, passes),
        Transaction(
            [path for folder in folders for path in folder.outputs()],
            inputs=read,
            force=force,
            hint="" if force else taken.hint(),
            checksums=True,
        ) as transaction,
    ):
        return [filling.folder.write(transaction, filling) for filling in fillings]
