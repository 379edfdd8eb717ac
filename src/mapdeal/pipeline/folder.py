"""The files of a run: products, documents, pictures, and the manifest last, with checksums.

What draws pictures that few runs have is imported when one is drawn.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, TypeGuard

from mapdeal import command, errors, records, version
from mapdeal.files import json_values, yaml_text
from mapdeal.files.source import YAML, access_to, exists, holds, is_same_file, real_path, status_of
from mapdeal.files.transaction import OpenOutput, PutRows, RowsWriter, Transaction
from mapdeal.grid import costmap, footprint, frame
from mapdeal.grid.field import DistanceField, FieldView, PotentialField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import GoalReach, Passage, Reach
from mapdeal.grid.values import count_text, decimal_text, few_text, join_words
from mapdeal.kernels import arrays, blocks, lookup
from mapdeal.maps import dialects, map_server, npz, png, reading
from mapdeal.maps.formats import named, output_format, written_endings
from mapdeal.pictures import canvas, layers
from mapdeal.pictures.overlay import KnownLines, Overlay, Overlays, RobotOverlay
from mapdeal.pipeline.settings import Settings, collected_from, passes_reported, portable, renamed
from mapdeal.pipeline.step import Step
from mapdeal.stages import catalogue, esdf

_SHOWN = 3  # names and changes in a text
_DEEPEST = 3  # mappings in mappings whose entries are listed one by one
_COST_SHARES = ["lethal", "inscribed", "graded", "free", "unknown"]
_OCCUPANCY_SHARES = ["occupied", "between", "free", "unknown"]
_SHOWN_AS = {"between": "values 1..99", "graded": "intermediate"}


def remark_on(step: Step, figures: frame.Figures, steps: Sequence[Step]) -> str | None:
    """Return the remark on the product of one of several steps; without obstacles that of costs."""
    remark = step.remark_on(figures)
    is_repeated = remark == f"{step.name}: {command.NO_OBSTACLE}" and step.name != "cost"
    return None if is_repeated and "cost" in [each.name for each in steps] else remark


def summary_of(figures: frame.Figures) -> str:
    cells = figures["width"] * figures["height"]

    def share(name: str) -> str:
        return f"{_SHOWN_AS.get(name, name)} {100 * figures[name] / cells:.2f} %"

    around = ""  # of fields on a larger canvas than they were computed on
    if "without_value" in figures:
        around = f", {100 * figures['without_value'] / cells:.2f} % of the cells without a value"
    if "lowest_distance" in figures:
        least, most = figures["lowest_distance"], figures["highest_distance"]
        if least is None or most is None:
            return ("nothing but obstacles" if figures["obstacles"] else "no obstacle") + around
        return f"{least + 0.0:.4g} .. {most:.4g} m, convention {figures['convention']}{around}"
    if "lowest_potential" in figures:
        least, most = figures["lowest_potential"], figures["highest_potential"]
        x, y = figures["goal"] or (None, None)
        goal_words = "no goal, repulsion" if x is None else f"goal {x:.10g}, {y:.10g}, potential"
        slope = f"gradient up to {figures['steepest_gradient']:.5g} per metre"
        if "cost_to_go_of" in figures:
            slope += f", cost to go of {figures['cost_to_go_of']}"
        return f"{goal_words} {least:.5g} .. {most:.5g}, {slope}{around}"
    if "reachable_m2" in figures:
        return _summary_of_reach(figures)
    names = [name for name in _OCCUPANCY_SHARES if figures.get(name) or name != "between"]
    if "lethal" in figures:
        names = [name for name in _COST_SHARES if name in figures]
    parts = list(map(share, names))
    if figures.get("circumscribed_cost") is not None:
        parts.append(f"circumscribed_cost {figures['circumscribed_cost']}")
    return ", ".join(parts)


def written_line(output: Path, figures: frame.Figures, *, with_origin: bool = False) -> str:
    text = f"{output}: {figures['width']} x {figures['height']} cells"
    if with_origin:
        x, y, yaw = figures["origin"]
        text += f" at {x:.10g}, {y:.10g}" + (f", yaw {yaw:.6g}" if yaw else "")
    return f"{text}, {summary_of(figures)}"


def _summary_of_reach(figures: frame.Figures) -> str:
    x, y, *_ = figures["start"]
    reached, room = (decimal_text(figures[key]) for key in ("reachable_m2", "open_m2"))
    parts = [f"from {x:.10g}, {y:.10g} the robot reaches {reached} of {room} m2 open to it"]
    goals = figures.get("goals", {})
    missed = [name for name, is_reached in goals.items() if not is_reached]
    if goals:
        unreached = f" (not {few_text(missed, _SHOWN)})" if missed else ""
        parts.append(f"{len(goals) - len(missed)} of {count_text(len(goals), 'goal')}{unreached}")
    if figures.get("passages"):
        text = count_text(figures["passages"], "passage")
        parts.append(f"{text}, {figures['closed_passages']} closed")
    elif "passages" in figures:
        parts.append("no narrow passages")
    return "; ".join(parts)


def _is_dict_of(value: object, kind: type[Any]) -> TypeGuard[dict[str, Any]]:
    return isinstance(value, dict) and all(isinstance(item, kind) for item in value.values())


def _changed_entries(
    old: frame.Figures, new: frame.Figures, place: str = "", depth: int = _DEEPEST
) -> Iterator[str]:
    for name in {**old, **new}:
        before, after = old.get(name), new.get(name)
        if isinstance(before, dict) and isinstance(after, dict) and depth:
            yield from _changed_entries(before, after, f"{place}{name}.", depth - 1)
        elif before != after:
            yield f"{place}{name} {before} -> {after}"


def format_value(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {format_value(item)}" for key, item in value.items()) + "}"
    return f"[{', '.join(map(format_value, value))}]" if isinstance(value, list) else str(value)


def step_line(step: Step) -> str:
    values = step.described()[step.name].items()
    return f"{step.name}: {', '.join(f'{name}={format_value(value)}' for name, value in values)}"


@contextmanager
def one_pass(transaction: Transaction, grid: npz.Grid) -> Iterator[npz.Grid]:
    # The rows of lazy layers are computed once for all files, those in memory written in parallel.
    if not grid.is_lazy:
        yield grid
        return
    rows = _Pass(grid.layer)
    with transaction.together(rows.write_all):
        yield grid.with_layer(blocks.made_by_rows(grid.layer, grid.layer.dtype, rows.handed_on))


class _Pass:
    def __init__(self, layer: Any) -> None:
        self._layer, self._next = layer, 0
        self._row_writers: list[tuple[Path, PutRows]] = []

    def handed_on(self, rows: slice) -> arrays.Array:
        values: arrays.Array = self._layer[rows]
        self._hand_on(rows)
        return values

    def write_all(self, files: Sequence[OpenOutput]) -> None:
        finishes = []
        # those that take rows first
        for path, file, writer in sorted(files, key=lambda f: not isinstance(f[2], RowsWriter)):
            with access_to(path, "written"):
                if isinstance(writer, RowsWriter):
                    put_rows, finish = writer.begin(file)
                    self._row_writers.append((path, put_rows))
                    finishes.append((path, finish))
                else:
                    writer(file)
        for block in blocks.blocks_of(self._layer):
            if block.stop > self._next:
                self._hand_on(slice(self._next, block.stop))
        for path, finish in finishes:
            with access_to(path, "written"):
                finish()
        self._row_writers.clear()  # they refer to this pass

    def _hand_on(self, rows: slice) -> None:
        if rows.start != self._next:  # a second request of the same rows
            return
        for path, put_rows in self._row_writers:
            with access_to(path, "written"):
                put_rows(rows)
        self._next = rows.stop
        blocks.report_rows(self._layer, rows)


def rounded(value: float) -> float | None:
    # further decimals of metres are rounding errors of binary fractions
    return round(float(value), 9) + 0.0 if math.isfinite(value) else None


def spread_json(document: Mapping[str, Any], *spread: str) -> str:
    """Return a document as JSON text, one entry a line, and one item a line of entries `spread`."""
    lines = []
    for key, value in document.items():
        text = json.dumps(value)
        if key in spread and value:
            items = ",\n".join(f"    {json.dumps(item)}" for item in value)
            text = f"[\n{items}\n  ]"
        lines.append(f'  "{key}": {text}')
    return "{\n" + ",\n".join(lines) + "\n}"


class Spread(command.Result):
    """A result whose document is written in parts, each as soon as it is computed."""

    spread: ClassVar[Sequence[str]] = ()  # keys of lists with one item a line

    def parts(self) -> Iterator[str]:
        yield spread_json(self.document(), *self.spread)

    def summary(self, output: Path) -> Iterator[str]:
        yield f"{output}: {'; '.join(self.lines())}"

    def write(self, transaction: Any, output: Path) -> None:
        transaction.write_parts(output, (f"{part}\n".encode() for part in self.parts()))


def reach_document(reach: Reach) -> dict[str, Any]:
    robot = reach.robot
    shape: dict[str, Any] = {"radius": 0.0 if robot is None else robot.radius}
    if isinstance(robot, footprint.Footprint) and robot.vertices:
        shape = {"footprint": [list(corner) for corner in robot.vertices]}
        shape["inscribed_radius"] = rounded(robot.inscribed_radius)
        shape["circumscribed_radius"] = rounded(robot.circumscribed_radius)
    x, y, *yaw = reach.start
    return {
        "robot": {**shape, "headings": reach.heading_count},
        "start": {**rounded_place(x, y), "yaw": rounded(yaw[0]) if yaw else None},
        "through_unknown": reach.through_unknown,
        "reachable_m2": rounded(reach.reachable_area),
        "open_m2": rounded(reach.open_area),
        "free_m2": rounded(reach.free_area),
        "share": rounded(reach.share),
        "goals": [_goal(goal) for goal in reach.goals],
        "passages": [passage_document(passage) for passage in reach.passages],
    }


def _goal(reach: GoalReach) -> dict[str, Any]:
    narrowest = reach.limited_by
    return {
        **({} if reach.goal.name is None else {"name": reach.goal.name}),
        **rounded_place(reach.goal.x, reach.goal.y),
        "reachable": reach.reachable,
        "heading_count": reach.heading_count,
        "widest_radius_m": rounded(reach.widest_radius),
        "limited_by": None if narrowest is None else {
            **rounded_place(narrowest.x, narrowest.y),
            "width_m": rounded(narrowest.width),
            "at": narrowest.at,
        },
        "reason": reach.reason,
        "nearest_open": None if reach.nearest_open is None else rounded_place(*reach.nearest_open),
    }  # fmt: skip


def passage_document(passage: Passage) -> dict[str, Any]:
    return {
        **rounded_place(passage.x, passage.y),
        "width_m": rounded(passage.width),
        "cuts_off_m2": rounded(passage.cut_off),
        "open": passage.is_open,
        "ends": [rounded_place(*end) for end in passage.ends],
    }


def rounded_place(x: float, y: float) -> dict[str, Any]:
    return {"x": rounded(x), "y": rounded(y)}


PICTURE = ".png"
_FARTHEST = 100.0  # metres: larger radii are not drawn


@records.dataclass(frozen=True)
class GridFiles:
    metavar: str
    about: str
    endings: tuple[str, ...]
    in_folder: tuple[str, ...]
    draw: Callable[..., canvas.Image]
    drawing: type[layers.Drawing] | None = None


def _reach_image(grid: Reach, **options: Any) -> canvas.Image:
    from mapdeal.pictures.reach import reach_image

    return reach_image(grid, **options)


def _written(kind: type[Any], besides: Iterable[str] = ()) -> str:
    endings = (ending for ending in named(written_endings(kind)) if ending not in besides)
    return join_words(ending.replace(".yaml", ".yaml (with .pgm)") for ending in endings)


_FILES: dict[type[Any], GridFiles] = {
    OccupancyGrid: GridFiles(
        "OUT", f"The result: {_written(OccupancyGrid)}.", written_endings(OccupancyGrid),
        (".pgm", ".yaml"), layers.occupancy_image, layers.OccupancyDrawing),
    FieldView: GridFiles(
        "OUT", f"The view: {_written(FieldView)}.", written_endings(FieldView),
        (".pgm", ".yaml"), layers.occupancy_image, layers.OccupancyDrawing),
    costmap.Costmap: GridFiles(
        "OUT", f"The costs: {_written(costmap.Costmap)}.", written_endings(costmap.Costmap),
        (".npz", ".pgm", ".yaml"), layers.cost_image, layers.CostDrawing),
    DistanceField: GridFiles(
        "OUT", "The field as .npz, as a bare .npy, or its 0..100 view as "
        f"{_written(FieldView, written_endings(DistanceField))}.",
        (*written_endings(FieldView), ".npy"), (".npz", ".pgm", ".yaml"),
        layers.field_image, layers.FieldDrawing),
    PotentialField: GridFiles("OUT.npz", "The field, with all its layers.",
                              npz.NPZ.endings, npz.NPZ.endings, layers.potential_image),
    Reach: GridFiles("OUT", "The answer as .json, or its layers as .npz.",
                     (".json", *npz.NPZ.endings), (*npz.NPZ.endings, ".json"), _reach_image),
}  # fmt: skip


def files_of(kind: type[Any]) -> GridFiles:
    if kind not in _FILES:
        raise TypeError(f"it is not known how a {kind.__name__} is written")
    return _FILES[kind]


def passes_of(step: Step, endings: Iterable[str]) -> int:
    # one for its figures and one for the files, then those of the stage and of its view
    has_view = step.stage.view is not None and not {".pgm", *YAML}.isdisjoint(endings)
    return 2 + step.stage.passes + (step.stage.view_passes(step.view) if has_view else 0)


def output_of(step: Step, output: Path) -> list[Path]:
    endings = files_of(step.stage.product_type).endings
    if output.suffix not in endings:
        hint = "--image writes a picture" if output.suffix == PICTURE else None
        rule = f"the output must end in {join_words(named(endings))}"
        raise errors.ParameterError(rule, source=output, hint=hint)
    if output.suffix == ".npy":
        return [output, output.with_suffix(".yaml")]
    return list(reading.output_paths(output))


def write_product(
    transaction: Transaction, output: Path, grid: npz.Grid, step: Step, *, pass_grid: npz.Grid,
    encoding: map_server.Encoding = "occupancy",
) -> None:  # fmt: skip
    # Within a pass; `pass_grid` is the grid from `one_pass`.
    if isinstance(pass_grid, DistanceField) and output.suffix == ".npy":
        transaction.write(output, lambda file: npz.write_npy(file, pass_grid.distance))
        names = ("convention", "strength", "max_distance", "lethal_threshold", "unknown")
        document = {
            "distance": output.name,
            "resolution": grid.resolution,
            "origin": list(grid.origin),
            **{name: getattr(grid, name) for name in names},
        }
        transaction.write_bytes(output.with_suffix(".yaml"), yaml_text.yaml_document(document))
    elif isinstance(grid, Reach) and output.suffix == ".json":
        text = spread_json(reach_document(grid), "goals", "passages")
        transaction.write_bytes(output, f"{text}\n".encode())
    elif isinstance(grid, DistanceField) and not output_format(output).can_hold(DistanceField):
        mode: dialects.Mode | None = "raw" if output_format(output).images else None
        view = (step.stage.view or esdf.field_view)(grid, **step.view)
        reading.write_grid(transaction, output, view, mode=mode)
    else:
        written = pass_grid if output_format(output).requests_rows else grid
        reading.write_grid(transaction, output, written, encoding=encoding)


def write_picture(
    transaction: Transaction, path: Path, grid: npz.Grid, title: str, settings: Settings,
    overlay: Overlay | None = None,
) -> None:  # fmt: skip
    files, title = files_of(type(grid)), errors.one_line(title)
    options: dict[str, Any] = {"image_max": settings.image_max, "overlay": overlay}
    options["image_extent"] = settings.image_extent
    if (make_drawing := files.drawing) is None:
        write_image(transaction, path, lambda: files.draw(grid, title=title, **options))
        return

    def begin(file: BinaryIO) -> tuple[PutRows, Callable[[], object]]:
        drawing = make_drawing(grid, **options)
        return drawing.take, lambda: _encode(file, drawing.image(title))

    transaction.write(path, RowsWriter(grid.layer, begin))


def write_image(transaction: Transaction, path: Path, draw: Callable[[], canvas.Image]) -> None:
    transaction.write(path, lambda file: _encode(file, draw()))


def _encode(file: BinaryIO, image: canvas.Image) -> None:
    png.write_png(file, image.indices, image.palette)


def robot_overlays(step: Step, robot: footprint.Footprint | None = None) -> list[Overlay]:
    shape = step.stage.robot
    if shape is None or step.stage.product_type is Reach:  # whose picture has it at its start
        return []
    shapes = [step.parameters.get(name) for name in (*shape.sets, shape.replaces)]
    known = next((item for item in shapes if isinstance(item, footprint.Footprint)), robot)
    radius = step.parameters[shape.replaces]
    if known is None and radius and radius <= _FARTHEST:
        is_round = step.parameters.get("circumscribed_radius") in (None, radius)
        label = {} if is_round else {"label": "the robot's inscribed circle"}
        return [RobotOverlay(footprint.Footprint.circle(radius), **label)]
    return [] if known is None or not radius else [RobotOverlay(known)]


MANIFEST, INPUT_PICTURE = "manifest.json", "input.png"
_FORMAT = "mapdeal-run/1"


@records.dataclass(frozen=True)
class Product:
    step: Step
    grid: npz.Grid
    figures: frame.Figures = records.field(default_factory=dict)
    mask: str | None = None  # the name of a keepout mask that has been laid over it
    overlay: Overlay | None = None


@records.dataclass(frozen=True)
class OutputFolder:
    path: Path
    steps: tuple[Step, ...]
    inputs: Mapping[str, str]
    options: Mapping[str, Any]
    settings: Settings
    robot: Mapping[str, Any] | None = None
    mask: Mapping[str, str] | None = None
    shows_input: bool = False

    def existing(self) -> list[Path]:
        return [path for path in self.outputs() if exists(path)]

    def check_inputs(self, files: Iterable[Path]) -> None:
        """Refuse inputs in the folder: a later run might replace or remove them as products."""
        for file in files:
            if any(is_same_file(path.parent, self.path) for path in (file, real_path(file))):
                rule = f"lies in {self.path}, where the outputs go"
                hint = "move it, or name another folder for the outputs"
                raise errors.FileAccessError(rule, source=file, hint=hint)

    def unchanged_figures(self) -> dict[str, frame.Figures] | None:
        old, own = stored_manifest(self.path), self._manifest()
        results = ("figures", "warnings", "outputs")
        if {key: value for key, value in old.items() if key not in results} != own:
            return None
        outputs, figures = old["outputs"], old["figures"]
        if set(outputs) != {path.name for path in self.outputs()} - {MANIFEST}:
            return None
        sizes = [entry.get(name) for entry in figures.values() for name in ("width", "height")]
        has_sizes = all(type(size) is int and size > 0 for size in sizes)
        if set(figures) != {step.name for step in self.steps} or not has_sizes:
            return None
        is_same = all(holds(self.path / Path(name).name, sum_) for name, sum_ in outputs.items())
        return figures if is_same else None

    def repeat_warnings(self, filling: Filling) -> None:
        paths = {file.name: str(file) for file in filling.named}
        for text in renamed(warnings_in(stored_manifest(self.path)), paths):
            if text not in filling.warnings:
                errors.emit_warning(text)

    def passes(self) -> int:
        endings = ([path.suffix for path in self._outputs_of(step)] for step in self.steps)
        return 2 * len(self._input_picture()) + sum(map(passes_of, self.steps, endings))

    def hint(self) -> str:
        hint = "--force replaces it"
        if not stored_manifest(self.path):
            return hint
        if self.unchanged_figures() is not None:
            return f"{hint}; this folder holds the same already"
        return f"{hint}; the run in this folder had other inputs, parameters, or was changed"

    def write(self, transaction: Transaction, filling: Filling) -> dict[str, frame.Figures]:
        before = stored_manifest(self.path).get("outputs", {})
        figures: dict[str, frame.Figures] = {}
        texts, settings = list(filling.warnings), self.settings
        shows_known = settings.images and settings.image_extent == "known"
        if filling.read is not None:
            for path in self._input_picture():
                title = f"{filling.stem}: map as read"
                write_picture(transaction, path, filling.read, title, settings)
        for product in collected_from(filling.products, texts):
            step, grid = product.step, product.grid
            if shows_known and isinstance(grid, (OccupancyGrid, costmap.Costmap)) and grid.is_lazy:
                # one pass finds the box of known cells and the counts of the figures
                blocks.gathered(grid.layer, lookup.histogram, KnownLines(grid.unknown_value))
            figures[step.name] = {**grid.figures(), **product.figures}
            if remark := remark_on(step, figures[step.name], self.steps):
                texts.append(f"{filling.subject}: {remark}")
                errors.emit_warning(texts[-1])
            below = filter(None, (filling.overlay, product.overlay))
            overlay = together([*below, *robot_overlays(step, filling.robot)])
            mask = "" if product.mask is None else f", with {product.mask}"
            title = f"{filling.stem}: {step.title}{mask}"
            with one_pass(transaction, grid) as pass_grid:
                for path in self._outputs_of(step):
                    if path.suffix == PICTURE:
                        write_picture(transaction, path, grid, title, settings, overlay)
                    elif path.suffix != ".pgm":  # it is written with its YAML
                        write_product(transaction, path, grid, step, pass_grid=pass_grid)
        written = transaction.wait()
        sums = {path.name: digest for path, digest in written.items() if path.parent == self.path}
        found = {"figures": figures, "warnings": portable(texts, filling.named), "outputs": sums}
        transaction.write_json(self.path / MANIFEST, {**self._manifest(), **found})
        # remove unchanged outputs of an earlier run that this one does not write
        current = {path.name for path in self.outputs()}
        for name, digest in before.items():
            if Path(name).name not in current:
                transaction.remove_if_unchanged(self.path / Path(name).name, digest)
        return figures

    def _manifest(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "version": version.__version__,
            "inputs": dict(self.inputs),
            "options": dict(self.options),
            **({} if self.robot is None else {"robot": dict(self.robot)}),
            **({} if self.mask is None else {"mask": dict(self.mask)}),
            "stages": [step.described() for step in self.steps],
        }

    def outputs(self) -> list[Path]:
        paths = [path for step in self.steps for path in self._outputs_of(step)]
        return [*self._input_picture(), *paths, self.path / MANIFEST]

    def _input_picture(self) -> list[Path]:
        return [self.path / INPUT_PICTURE] if self.shows_input and self.settings.images else []

    def _outputs_of(self, step: Step) -> list[Path]:
        endings = files_of(step.stage.product_type).in_folder
        endings += (PICTURE,) if self.settings.images else ()
        return [self.path / f"{step.stage.product}{ending}" for ending in endings]


@records.dataclass(frozen=True)
class Filling:
    folder: OutputFolder
    products: Iterable[Product]
    stem: str
    files: tuple[Path, ...]
    subject: Path
    overlay: Overlay | None = None
    by_blocks: bool = False
    warnings: Sequence[str] = ()
    read: npz.Grid | None = None
    robot: footprint.Footprint | None = None

    @property
    def named(self) -> tuple[Path, ...]:
        return (*self.files, self.subject)


def together(overlays: Sequence[Overlay]) -> Overlay | None:
    return Overlays(tuple(overlays)) if overlays else None


def fill_together(fillings: Sequence[Filling]) -> list[dict[str, frame.Figures]]:
    read = tuple(dict.fromkeys(file for filling in fillings for file in filling.files))
    for filling in fillings:
        filling.folder.check_inputs(read)
    folders = [filling.folder for filling in fillings]
    force = all(folder.settings.force for folder in folders)
    occupied = next((folder for folder in folders if folder.existing()), folders[0])
    passes = sum(filling.folder.passes() for filling in fillings if filling.by_blocks)
    outputs = [path for folder in folders for path in folder.outputs()]
    hint = "" if force else occupied.hint()
    with (
        passes_reported(folders[0].settings.progress if passes else None, passes),
        Transaction(outputs, inputs=read, force=force, hint=hint, checksums=True) as transaction,
    ):
        return [filling.folder.write(transaction, filling) for filling in fillings]


def stored_manifest(folder: Path) -> dict[str, Any]:
    manifest = json_values.read_json(folder / MANIFEST)
    return manifest if _is_manifest(manifest) else {}


def manifest_in(folder: Path) -> dict[str, Any]:
    manifest = stored_manifest(folder)
    if not manifest:
        raise errors.MalformedInputError("is not the manifest of a run", source=folder / MANIFEST)
    return manifest


def warnings_in(manifest: Mapping[str, Any]) -> list[str]:
    warnings = manifest.get("warnings")
    return [*map(str, warnings)] if isinstance(warnings, list) else []


def stages_behind(name: str, folder: Path, sums: Mapping[str, str]) -> list[dict[str, Any]] | None:
    manifest, stem = stored_manifest(folder), Path(name).stem
    if not manifest or not sums.items() <= manifest["outputs"].items():
        return None
    stages: list[dict[str, Any]] = manifest["stages"]
    products = [product_of(next(iter(stage))) for stage in stages]
    return stages[: products.index(stem) + 1] if stem in products else None


def product_of(stage: str) -> str:
    own_name = "cost" if stage == "replay" else stage  # which is no stage of recipes
    models = catalogue.models_of(stage).values()
    return next((model.product for model in models), own_name)


def _is_manifest(value: object) -> TypeGuard[dict[str, Any]]:
    # No stage runs twice, see `Recipe`.
    if not isinstance(value, dict):
        return False
    figures, outputs, stages = (value.get(key) for key in ("figures", "outputs", "stages"))
    return (
        _is_dict_of(figures, dict)
        and _is_dict_of(outputs, str)
        and isinstance(stages, list)
        and all(_is_dict_of(stage, dict) and len(stage) == 1 for stage in stages)
        and len({name for stage in stages for name in stage}) == len(stages)
    )


def store_golden(folder: Path, golden: Path, place: str | None = None) -> Path:
    target = golden / (place or folder.name) / MANIFEST
    with Transaction([target], force=True) as transaction:
        transaction.write_json(target, manifest_in(folder))
    return target


def differences_from_golden(folder: Path, golden: Path, place: str | None = None) -> list[str]:
    name = place or folder.name
    stored = golden / name / MANIFEST
    try:
        status_of(stored)
    except errors.FileAccessError as error:
        rule, hint = f"no golden run: {error.rule}", "--update-golden stores it"
        raise errors.FileAccessError(rule, source=stored, hint=hint) from None
    new, old = manifest_in(folder), manifest_in(stored.parent)
    stages = dict.fromkeys([*old["figures"], *new["figures"]])
    found = ((stage, _difference(stage, old, new)) for stage in stages)
    return [f"{name}: {stage}: {text}" for stage, text in found if text is not None]


def _difference(stage: str, old: dict[str, Any], new: dict[str, Any]) -> str | None:
    for manifest, words in ((old, "is new"), (new, "is missing")):
        if stage not in manifest["figures"]:
            return words
    parameters: list[dict[str, Any]] = [
        next((entry[stage] for entry in manifest["stages"] if stage in entry), {})
        for manifest in (old, new)
    ]
    if changes := changes_between(*parameters):
        return f"other parameters: {changes}"
    changed = sorted({name for name, _ in old["outputs"].items() ^ new["outputs"].items()})
    data = [Path(name) for name in changed if Path(name).suffix != PICTURE]
    differing = [str(path) for path in data if path.stem == product_of(stage)]
    if not differing:
        return None
    changes = changes_between(old["figures"][stage], new["figures"][stage])
    return f"{', '.join(differing)} differ" + (f": {changes}" if changes else "")


def changes_between(old: frame.Figures, new: frame.Figures) -> str:
    texts = []
    before, after = old.get("goals"), new.get("goals")
    if _is_dict_of(before, bool) and _is_dict_of(after, bool) and set(before) == set(after):
        for is_reached, words in ((False, "no longer reachable"), (True, "reachable now")):
            turned = [name for name in after if after[name] is is_reached is not before[name]]
            texts += [f"{few_text(turned, _SHOWN)} {words}"] if turned else []
        old, new = {**old, "goals": None}, {**new, "goals": None}
    texts += _changed_entries(old, new)
    return errors.one_line(few_text(texts, _SHOWN))
