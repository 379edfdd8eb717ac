"""The files of a run: products, checksums, the manifest last.

What draws pictures that few runs have is imported when one is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeGuard

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    ParameterError,
    emit_warning,
    one_line,
)
from mapdeal.files.json_values import json_of, read_json
from mapdeal.files.source import MAPS, YAML, exists, holds, is_same_file, real_path, status_of
from mapdeal.files.transaction import Begun, PutRows, RowsWriter, Transaction
from mapdeal.files.yaml_text import yaml_document
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.display import count_text
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures, Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reach import Reach
from mapdeal.kernels.blocks import blocks_of, gathered, made_by_rows, report_rows
from mapdeal.kernels.lookup import histogram
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.npz import Grid, write_npy
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.layers import (
    CostDrawing,
    Drawing,
    FieldDrawing,
    OccupancyDrawing,
    cost_image,
    field_image,
    occupancy_image,
)
from mapdeal.pictures.overlay import (
    DEFAULT_EXTENT,
    ImageExtent,
    KnownLines,
    OtherThan,
    Overlay,
    Overlays,
)
from mapdeal.pictures.raster import DEFAULT_IMAGE_MAX
from mapdeal.pipeline.settings import (
    ProgressCallback,
    Settings,
    heard_from,
    located,
    passes_reported,
    portable,
)
from mapdeal.pipeline.step import Step
from mapdeal.stages.catalogue import models_of
from mapdeal.version import __version__

_SHOWN_GOALS = 3
_DEEPEST = 3
"""Mappings in mappings whose entries are listed one by one."""
_COST_SHARES = ["lethal", "inscribed", "graded", "free", "unknown"]
_OCCUPANCY_SHARES = ["occupied", "between", "free", "unknown"]
_SHOWN_AS = {"between": "values 1..99", "graded": "intermediate"}
"""What people read for names of figures that say too little."""


def summary_of(figures: Figures) -> str:
    cells = figures["width"] * figures["height"]

    def share(name: str) -> str:
        percent = 100 * figures[name] / cells
        return f"{_SHOWN_AS.get(name, name)} {percent:.2f} %"

    around = ""  # of fields on a larger canvas than they were computed on
    if "without_value" in figures:
        around = f", {100 * figures['without_value'] / cells:.2f} % of the cells without a value"
    if "lowest_distance" in figures:
        least, most = figures["lowest_distance"], figures["highest_distance"]
        if least is None or most is None:
            what = "no obstacle" if figures["obstacles"] == 0 else "nothing but obstacles"
            return what + around
        return f"{least + 0.0:.4g} .. {most:.4g} m, convention {figures['convention']}{around}"
    if "lowest_potential" in figures:
        least, most = figures["lowest_potential"], figures["highest_potential"]
        x, y = figures["goal"] or (None, None)
        what = "no goal, repulsion" if x is None else f"goal {x:.10g}, {y:.10g}, potential"
        text = f"{what} {least:.5g} .. {most:.5g}"
        return f"{text}, gradient up to {figures['steepest_gradient']:.5g} per metre{around}"
    if "reachable_m2" in figures:
        return _summary_of_reach(figures)
    if "lethal" in figures:
        names = [name for name in _COST_SHARES if name in figures]
        text = ", ".join(share(name) for name in names)
        if figures.get("circumscribed_cost") is not None:
            text += f", circumscribed_cost {figures['circumscribed_cost']}"
        return text
    names = [name for name in _OCCUPANCY_SHARES if figures[name] or name != "between"]
    return ", ".join(share(name) for name in names)


def written_line(output: Path, figures: Figures, *, with_origin: bool = False) -> str:
    """Return what commands print of a grid that they have written."""
    text = f"{output}: {figures['width']} x {figures['height']} cells"
    if with_origin:
        x, y, yaw = figures["origin"]
        text += f" at {x:.10g}, {y:.10g}" + (f", yaw {yaw:.6g}" if yaw else "")
    return f"{text}, {summary_of(figures)}"


def _summary_of_reach(figures: Figures) -> str:
    x, y, *_ = figures["start"]
    reached, room = figures["reachable_m2"], figures["open_m2"]
    parts = [f"from {x:.10g}, {y:.10g} the robot reaches {reached:.4g} of {room:.4g} m2 open to it"]
    goals = dict(figures.get("goals", {}))
    missed = [name for name, is_reached in goals.items() if not is_reached]
    if goals:
        parts.append(f"{len(goals) - len(missed)} of {count_text(len(goals), 'goal')}")
    if missed:
        parts[-1] += f", not {_named(missed)}"
    if figures.get("passages"):
        text = count_text(figures["passages"], "passage")
        parts.append(f"{text}, {figures['closed_passages']} closed")
    return "; ".join(parts)


def _named(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN_GOALS
    return ", ".join(names[:_SHOWN_GOALS]) + f" and {more} more" * (more > 0)


def changes_between(old: Figures, new: Figures) -> list[str]:
    """Return what differs between the figures of two runs, a text each."""
    # Goals that are not reached any more come first. Of what differs within a mapping each entry is
    # listed by its own name.
    texts = []
    before, after = (figures.get("goals") for figures in (old, new))
    if are_goals(before) and are_goals(after) and set(before) == set(after):
        for is_reached, words in ((False, "no longer reachable"), (True, "reachable now")):
            turned = [name for name in after if after[name] is is_reached is not before[name]]
            if turned:
                texts.append(f"{_named(turned)} {words}")
        old, new = ({**figures, "goals": None} for figures in (old, new))
    return [*texts, *_changed_entries(old, new, "", _DEEPEST)]


def are_goals(value: object) -> TypeGuard[dict[str, bool]]:
    return isinstance(value, dict) and all(isinstance(one, bool) for one in value.values())


def _changed_entries(old: Figures, new: Figures, place: str, depth: int) -> list[str]:
    texts = []
    for name in {**old, **new}:
        one, other = old.get(name), new.get(name)
        if isinstance(one, dict) and isinstance(other, dict) and depth:
            texts += _changed_entries(one, other, f"{place}{name}.", depth - 1)
        elif one != other:
            texts.append(f"{place}{name} {one} -> {other}")
    return texts


def are_figures_of(stored: object, stages: Sequence[str]) -> TypeGuard[dict[str, Figures]]:
    """Return whether what a manifest says are figures of exactly these stages, with sizes."""
    if not isinstance(stored, dict) or set(stored) != set(stages):
        return False
    return all(
        isinstance(figures, dict) and all(_is_size(figures.get(k)) for k in ("width", "height"))
        for figures in stored.values()
    )


def _is_size(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def said(value: object) -> str:
    """Return a value of a parameter, option or figure as a recipe would have it."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {said(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(said, value))}]"
    return str(value)


def step_line(step: Step) -> str:
    """Return a stage with its parameters as a verbose command says them."""
    values = step.described()[step.name].items()
    return f"{step.name}: {', '.join(f'{name}={said(value)}' for name, value in values)}"


@contextmanager
def one_pass(transaction: Transaction, grid: Grid) -> Iterator[Grid]:
    """Write all files of a grid within a ``with`` block in one pass."""
    # Its rows are then made once for all of them, where layers have no room to be kept. Files of a
    # grid in memory are written as ever, at the same time.
    if not grid.is_lazy:
        yield grid
        return
    rows = _Pass(grid)
    with transaction.together(rows.write_all):
        yield rows.asked


class _Pass:
    """A pass through the rows of a grid, from the first to the last."""

    def __init__(self, grid: Grid) -> None:
        layer = grid.layer

        def handed_on(rows: slice) -> NDArray[np.generic]:
            values = layer[rows]
            self._hand_on(rows)
            return values

        self._layer = layer
        self._next = 0
        self._puts: list[tuple[Path, PutRows]] = []
        self.asked: Grid = grid.with_layer(made_by_rows(layer, layer.dtype, handed_on))

    def write_all(self, files: Sequence[Begun]) -> None:
        finishes = []
        for path, file, writer in files:
            if isinstance(writer, RowsWriter):
                with _failing_at(path):
                    put, finish = writer.begin(file)
                self._puts.append((path, put))
                finishes.append((path, finish))
        for path, file, writer in files:
            if not isinstance(writer, RowsWriter):
                with _failing_at(path):
                    writer(file)
        for block in blocks_of(self._layer):
            if block.stop > self._next:
                self._hand_on(slice(self._next, block.stop))
        for path, finish in finishes:
            with _failing_at(path):
                finish()

    def _hand_on(self, rows: slice) -> None:
        if rows.start != self._next:  # asked for once more
            return
        for path, put in self._puts:
            with _failing_at(path):
                put(rows)
        self._next = rows.stop
        report_rows(self._layer, rows)


@contextmanager
def _failing_at(path: Path) -> Iterator[None]:
    """Name the file that cannot be written, for instance on a full disk."""
    try:
        yield
    except OSError as error:
        rule = f"cannot be written: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


PICTURE = ".png"

_FARTHEST = 100.0
"""Metres: a radius beyond that is of no robot, and would fit no picture."""


@dataclass(frozen=True)
class GridFiles:
    """Output files for one type of grid."""

    metavar: str
    about: str
    endings: tuple[str, ...]
    in_folder: tuple[str, ...]
    draw: Callable[..., Image]
    drawing: type[Drawing] | None = None


def _potential_image(grid: PotentialField, **how: Any) -> Image:
    from mapdeal.pictures.layers import potential_image

    return potential_image(grid, **how)


def _reach_image(grid: Reach, **how: Any) -> Image:
    from mapdeal.pictures.reach import reach_image

    return reach_image(grid, **how)


_FILES: dict[type[Any], GridFiles] = {
    OccupancyGrid: GridFiles(
        "OUT", "The result: .yaml (with .pgm) or .npz.",
        MAPS, (".pgm", ".yaml"), occupancy_image, OccupancyDrawing,
    ),
    FieldView: GridFiles(
        "OUT", "The view: .yaml (with .pgm) or .npz.",
        MAPS, (".pgm", ".yaml"), occupancy_image, OccupancyDrawing,
    ),
    Costmap: GridFiles(
        "OUT", "The costs: .yaml (with .pgm) or .npz.",
        MAPS, (".npz", ".pgm", ".yaml"), cost_image, CostDrawing,
    ),
    DistanceField: GridFiles(
        "OUT", "The field as .npz, as a bare .npy, or its 0..100 view as .yaml (with .pgm).",
        (*MAPS, ".npy"), (".npz", ".pgm", ".yaml"), field_image, FieldDrawing,
    ),
    PotentialField: GridFiles(
        "OUT.npz", "The field, with all its layers.",
        (".npz",), (".npz",), _potential_image,
    ),
    Reach: GridFiles(
        "OUT", "The answer as .json, or its layers as .npz.",
        (".json", ".npz"), (".npz", ".json"), _reach_image,
    ),
}  # fmt: skip


def files_of(made: type[Any]) -> GridFiles:
    if made not in _FILES:
        raise TypeError(f"it is not known how a {made.__name__} is written")
    return _FILES[made]


def paths_of(step: Step, folder: Path, *, images: bool) -> list[Path]:
    """Return the files that a step of a run writes into `folder`, in the order of writing."""
    endings = [*files_of(step.stage.makes).in_folder, *([PICTURE] if images else [])]
    return [folder / f"{step.stage.product}{ending}" for ending in endings]


def passes_of(step: Step, endings: Iterable[str]) -> int:
    """Return how often lazy layers are gone through for a step and some files of its product.

    Once for its figures and once for the files; besides that by the stage, and by its view.
    """
    has_view = step.stage.view is not None and not {".pgm", *YAML}.isdisjoint(endings)
    return 2 + step.stage.passes + (step.stage.view_passes(step.view) if has_view else 0)


def figures_of(grid: Grid, *, box_of_known: bool) -> Figures:
    if box_of_known and isinstance(grid, (OccupancyGrid, Costmap)) and grid.is_lazy:
        gathered(grid.layer, histogram, KnownLines(OtherThan(grid.unknown_value)))
    return grid.figures()


def output_of(step: Step, output: Path) -> list[Path]:
    """Return the files that a step's product becomes if it is written to `output`."""
    endings = files_of(step.stage.makes).endings
    if output.suffix not in endings:
        hint = "--image writes a picture" if output.suffix == PICTURE else None
        rule = f"the output must end in {' or '.join(e for e in endings if e != '.yml')}"
        raise ParameterError(rule, source=output, hint=hint)
    if output.suffix == ".npy":
        return [output, output.with_suffix(".yaml")]
    return list(output_paths(output))


def write_product(
    transaction: Transaction,
    output: Path,
    grid: Grid,
    step: Step,
    *,
    asked: Grid,
    encoding: Encoding = "occupancy",
) -> None:
    """Write a step's product to a file, and the other one of a pair."""
    # Within a pass; `asked` is the grid that `one_pass` gives.
    if isinstance(asked, DistanceField) and output.suffix == ".npy":
        transaction.write(output, lambda file: write_npy(file, asked.distance))
        document = yaml_document(_geometry_of_npy(grid, output))
        transaction.write_bytes(output.with_suffix(".yaml"), document)
    elif isinstance(grid, Reach) and output.suffix == ".json":
        from mapdeal.pipeline.documents import reach_json

        transaction.write_bytes(output, f"{reach_json(grid)}\n".encode())
    elif isinstance(grid, DistanceField) and output.suffix != ".npz":
        write_grid(transaction, output, step.view_of(grid), mode="raw")
    else:
        made = asked if output.suffix == ".npz" else grid
        write_grid(transaction, output, made, encoding=encoding)


def write_products(
    transaction: Transaction,
    step: Step,
    grid: Grid,
    folder: Path,
    *,
    stem: str,
    images: bool,
    **how: Any,
) -> None:
    """Write all files of a step's product, those of `paths_of`."""
    with one_pass(transaction, grid) as asked:
        for path in paths_of(step, folder, images=images):
            if path.suffix == PICTURE:
                title = one_line(f"{stem}: {step.title}")
                write_picture(transaction, path, grid, title, **how)
            elif path.suffix != ".pgm":  # it is written with its YAML
                write_product(transaction, path, grid, step, asked=asked)


def write_picture(
    transaction: Transaction,
    path: Path,
    grid: Grid,
    title: str,
    *,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = DEFAULT_EXTENT,
    overlay: Overlay | None = None,
) -> None:
    """Write the picture of a grid; it is drawn in the thread that writes it."""
    files = files_of(type(grid))
    how: dict[str, Any] = {
        "image_max": image_max, "image_extent": image_extent, "overlay": overlay
    }  # fmt: skip

    def write(file: BinaryIO, image: Image) -> None:
        write_indexed_png(file, image.indices, image.palette)

    if files.drawing is None:
        transaction.write(path, lambda file: write(file, files.draw(grid, title=title, **how)))
        return
    make_drawing = files.drawing

    def begin(file: BinaryIO) -> tuple[PutRows, Callable[[], object]]:
        drawing = make_drawing(grid, **how)
        return drawing.take, lambda: write(file, drawing.image(title))

    transaction.write(path, RowsWriter(grid.layer, begin))


def robot_overlays(step: Step, robot: Footprint | None = None) -> list[Overlay]:
    """Return what the picture of a step's product shows of the robot that the step is about."""
    shape = step.stage.robot
    if shape is None or step.stage.makes is Reach:  # whose picture has it at its start
        return []
    from mapdeal.pictures.overlay import RobotOverlay

    given = [step.parameters.get(name) for name in (*shape.sets, shape.replaces)]
    known = next((one for one in given if isinstance(one, Footprint)), robot)
    radius = step.parameters[shape.replaces]
    if known is None and radius and radius <= _FARTHEST:
        around = step.parameters.get("circumscribed_radius")
        is_round = around is None or around == radius
        label = {} if is_round else {"label": "the robot's inscribed circle"}
        return [RobotOverlay(Footprint.circle(radius), **label)]
    return [] if known is None or not radius else [RobotOverlay(known)]


def write_curve(transaction: Transaction, path: Path, curve: CostCurve, title: str) -> None:
    """Write the picture of a cost curve; it is drawn in the thread that writes it."""
    from mapdeal.pictures.cost_curve import cost_curve_image

    def write(file: object) -> None:
        image = cost_curve_image(curve, title=one_line(title))
        write_indexed_png(file, image.indices, image.palette)  # type: ignore[arg-type]

    transaction.write(path, write)


def _geometry_of_npy(grid: Framed, output: Path) -> dict[str, Any]:
    """Return what the YAML beside a bare ``.npy`` says of the field: geometry and parameters."""
    names = ("convention", "strength", "max_distance", "lethal_threshold", "unknown")
    return {
        "distance": output.name,
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        **{name: getattr(grid, name) for name in names},
    }


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
        """Refuse inputs that lie in the folder."""
        # They would be taken for its products one day, replaced by others or removed with them.
        for file in files:
            if any(is_same_file(one.parent, self.path) for one in (file, real_path(file))):
                rule = f"lies in {self.path}, where the outputs go"
                hint = "move it, or name another folder for the outputs"
                raise FileAccessError(rule, source=file, hint=hint)

    def unchanged_figures(self) -> dict[str, Figures] | None:
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
        """Warn of what the run that has written the folder has warned of."""
        # What reading has warned of, this time, too, is not said twice.
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
        shows_known = self.settings.images and self.settings.image_extent == "known"
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
                **figures_of(grid, box_of_known=shows_known), **product.figures
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
        return (*self.files, self.subject)


def _together(first: Overlay | None, others: Sequence[Overlay]) -> Overlay | None:
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


def manifest_in(folder: Path) -> dict[str, Any]:
    manifest = _manifest_or_none(folder)
    if manifest is None:
        raise MalformedInputError("is not the manifest of a run", source=folder / MANIFEST)
    return manifest


def stages_behind(name: str, folder: Path, sums: Mapping[str, str]) -> list[dict[str, Any]] | None:
    manifest = _manifest_or_none(folder)
    if manifest is None or any(manifest["outputs"].get(key) != sums[key] for key in sums):
        return None
    stages: list[dict[str, Any]] = manifest["stages"]
    products = [product_of(next(iter(one))) for one in stages]
    stem = Path(name).stem
    return stages[: products.index(stem) + 1] if stem in products else None


def product_of(stage: str) -> str:
    """Return what the files of a stage are called; of one that is no recipe's, its name."""
    return next((one.product for one in models_of(stage).values()), stage)


def _manifest_or_none(folder: Path) -> dict[str, Any] | None:
    value = read_json(folder / MANIFEST)
    return value if _is_manifest(value) else None


def _is_manifest(value: object) -> bool:
    """Return whether figures, outputs and stages are there in the shape that a run gives them."""
    # No stage runs twice, see `Recipe`.
    if not isinstance(value, dict):
        return False
    figures, outputs, stages = (value.get(key) for key in ("figures", "outputs", "stages"))
    return (
        isinstance(figures, dict)
        and all(isinstance(one, dict) for one in figures.values())
        and isinstance(outputs, dict)
        and all(isinstance(digest, str) for digest in outputs.values())
        and isinstance(stages, list)
        and all(isinstance(stage, dict) and len(stage) == 1 for stage in stages)
        and all(isinstance(one, dict) for stage in stages for one in stage.values())
        and len({name for stage in stages for name in stage}) == len(stages)
    )


_SHOWN = 3


def store_golden(folder: Path, golden: Path, place: str | None = None) -> Path:
    """Copy the manifest of a run into a folder of golden runs."""
    manifest = manifest_in(folder)
    target = golden / (place or folder.name) / MANIFEST
    with Transaction([target], force=True) as transaction:
        transaction.write_bytes(target, json_of(manifest))
    return target


def differences_from_golden(folder: Path, golden: Path, place: str | None = None) -> list[str]:
    """Return what differs between a run and its golden run, a line each stage."""
    stored = golden / (place or folder.name) / MANIFEST
    try:
        status_of(stored)
    except FileAccessError as error:
        rule, hint = f"no golden run: {error.rule}", "--update-golden stores it"
        raise FileAccessError(rule, source=stored, hint=hint) from None
    new, old = manifest_in(folder), manifest_in(stored.parent)
    lines = []
    for stage in dict.fromkeys([*old["figures"], *new["figures"]]):
        told = _difference(stage, old, new)
        if told is not None:
            lines.append(f"{place or folder.name}: {stage}: {told}")
    return lines


def _difference(stage: str, old: dict[str, Any], new: dict[str, Any]) -> str | None:
    for one, other in ((old, "is new"), (new, "is missing")):
        if stage not in one["figures"]:
            return other
    parameters = [_parameters(manifest, stage) for manifest in (old, new)]
    changed = _changes(*parameters)
    if changed:
        return f"other parameters: {changed}"
    files = [_files(manifest, stage) for manifest in (old, new)]
    differing = [
        name for name in sorted({*files[0], *files[1]}) if files[0].get(name) != files[1].get(name)
    ]
    if not differing:
        return None
    told = _changes(old["figures"][stage], new["figures"][stage])
    return f"{', '.join(differing)} differ" + (f": {told}" if told else "")


def _parameters(manifest: dict[str, Any], stage: str) -> dict[str, Any]:
    found: dict[str, Any] = next((s[stage] for s in manifest["stages"] if stage in s), {})
    return found


def _files(manifest: dict[str, Any], stage: str) -> dict[str, str]:
    stem = product_of(stage)
    return {
        name: str(digest)
        for name, digest in manifest["outputs"].items()
        if Path(name).stem == stem and Path(name).suffix != PICTURE
    }


def _changes(old: Figures, new: Figures) -> str:
    texts = changes_between(old, new)
    shown = one_line(", ".join(texts[:_SHOWN]))
    return shown + (f" and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else "")
