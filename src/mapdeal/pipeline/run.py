"""A run: one map through one recipe into one folder, and perhaps a local map into another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from mapdeal import command, records
from mapdeal.errors import FindingError, ParameterError, emit_warning, one_line
from mapdeal.files.json_values import encode_json
from mapdeal.files.transaction import Transaction
from mapdeal.grid import occupancy, values
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.footprint import FootprintLike
from mapdeal.grid.frame import Figures, Frame, Framed
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import formats, reading
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.npz import Grid
from mapdeal.pictures.overlay import KeepoutOverlay
from mapdeal.pipeline import folder as folders, inputs, recipe as recipes
from mapdeal.pipeline.settings import Canvas, Settings, adding_warnings, passes_reported
from mapdeal.pipeline.step import Step, grid_of
from mapdeal.ros.robot import CostmapName, RobotParameters

_LEAST_COLUMN = 8
_ALL_AROUND = 2 * math.pi - 0.1  # radians from which on a cloud counts as covering all directions
LOCAL_RECIPE = "local"  # the recipe for local maps, and the folder of the one that a run makes


@records.dataclass(frozen=True, repr=False)
class RunReport(command.Result):
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
        local = {} if self.local is None else {"local": self.local.figures}
        return {"figures": self.figures, **local}

    def lines(self) -> Iterator[str]:
        head = f"{self.source} -> {self.folder}"
        if self.status == "unchanged":
            yield f"{head}: unchanged"
        else:
            local = self.figures.get(LOCAL_RECIPE)
            yield head if local is None else f"{head}: {_summary_of_local(local)}"
            width = max(_LEAST_COLUMN, *map(len, self.figures))
            for stage, figures in self.figures.items():
                text = folders.summary_of(figures)
                yield f"  {stage:<{width}} {cells_text(figures)} cells, {text}"
        if self.local is not None:
            yield from self.local.lines()

    @property
    def missed_goals(self) -> list[str]:
        """Names of the goals of the stage ``reach`` that the robot does not reach."""
        goals = self.figures.get("reach", {}).get("goals", {})
        missed = [name for name, is_reached in goals.items() if not is_reached]
        return missed if self.local is None else [*missed, *self.local.missed_goals]

    def check(self) -> None:
        if self.missed_goals:
            rule = f"the robot does not reach {', '.join(self.missed_goals)}"
            raise FindingError(rule, source=self.source)

    def _repr_parts(self) -> Iterator[str]:
        yield str(self.folder)
        yield self.status
        yield f"stages {' '.join(self.figures)}"
        if self.local is not None:
            yield f"local map {self.local!r}"


def cells_text(figures: Figures) -> str:
    return f"{figures['width']} x {figures['height']}"


def _summary_of_local(local: Figures) -> str:
    parts = []
    if "points" in local:
        reasons = {"not_finite": "not finite", "beyond_height": "by height",
                   "beyond_range": "by range"}  # fmt: skip
        dropped = ", ".join(f"{local[key]} {why}" for key, why in reasons.items() if local[key])
        text = f"{local['marking']} of {local['points']} points in the window"
        parts.append(f"{text} (dropped: {dropped})" if dropped else text)
    if "from_map" in local:
        parts.append(f"{local['from_map']} cells from the map")
    if "clouds" in local:
        clouds = values.count_text(local["clouds"], "cloud")
        parts.append(f"of {clouds}, {local['from_earlier']} cells from earlier ones")
    if local.get("angle_min") is not None:
        around = local["angle_max"] - local["angle_min"] > _ALL_AROUND
        ends = f"from {local['angle_min']:.4g} to {local['angle_max']:.4g} rad of its heading"
        parts.append(f"seen {'all around' if around else ends}")
    return ", ".join([*parts, f"robot's back at {local['rear_heading']:.4g} rad"])


class LocalOfRun(Protocol):
    @property
    def files(self) -> tuple[Path, ...]: ...
    def filling(
        self, folder: Path, source: reading.Source, settings: Settings, warnings: Sequence[str]
    ) -> folders.Filling: ...
    def folder(
        self, folder: Path, sums: Mapping[str, str], resolution: float, settings: Settings
    ) -> folders.OutputFolder: ...


def products_of(
    recipe: recipes.Recipe, grid: Grid, path: Path | None, *, canvas: Frame | None = None,
    mask: inputs.KeepoutMask | None = None,
) -> Iterator[folders.Product]:  # fmt: skip
    # With a canvas, each product is extended to it, which does not change what the steps compute. A
    # stage that moves the map makes a new canvas. A mask is laid over costs as they are written;
    # steps after them work on the costs without it, because closed cells are not obstacles, unless
    # the costs are inflated around it.
    is_elsewhere = False
    for step in recipe.steps:
        is_elsewhere = is_elsewhere or step.moves
        if is_elsewhere and path is not None:
            inputs.claim_step(path, grid, step)
        if mask is not None and step.stage.product_type is Costmap:
            without, costs = mask.costs_of(step, grid, path)
            product: Grid = costs if step.accepts_mask else without
            if canvas is not None:
                canvas = costs.frame if step.moves else canvas
                without, costs = on_canvas(without, canvas), on_canvas(costs, canvas)
            overlay = KeepoutOverlay.of(without, costs)
            yield folders.Product(step, costs, mask=Path(mask.path).name, overlay=overlay)
        else:
            product = step.apply(grid, path, mask=None if mask is None else mask.grid)
            if canvas is not None and step.moves:
                canvas = product.frame
            yield folders.Product(step, product if canvas is None else on_canvas(product, canvas))
        if step.stage.passes_output_on:
            grid = product


def apply_recipe(
    grid: Grid, recipe: recipes.RecipeLike = recipes.DEFAULT,
    changes: Mapping[str, object] | Sequence[str] | None = None, *,
    footprint: FootprintLike | None = None, sim: bool = False, canvas: Canvas = "crop",
    mask: occupancy.OccupancyGrid | None = None, robot_radius: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Apply a recipe to a grid in memory; the counterpart of `run` without files.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        Map to process. A costmap is processed as the map that ROS would publish, a field as the
        map that it was computed from.
    recipe, changes, footprint, sim, robot_radius
        As for `load_recipe`.
    canvas : {'crop', 'full'}
        Extent of the products: the cells that the stages computed, or the full map extent.
    mask : OccupancyGrid, optional
        Keepout mask over the costs, as for `apply_keepout_mask`.

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
        rule, hint = "takes a grid", command.grid_hint(grid)
        raise ParameterError(rule, place="apply_recipe", got=grid, hint=hint)
    settings = Settings(canvas=canvas)
    loaded = recipes.load_recipe(
        recipe, changes, footprint=footprint, sim=sim, robot_radius=robot_radius
    )
    products = {}
    full_frame = grid.frame if canvas == "full" else None
    keepout = inputs.mask_of(used_mask(loaded, mask), settings)
    for product in products_of(loaded, grid, None, canvas=full_frame, mask=keepout):
        products[product.step.name] = product.grid
        if remark := folders.remark_on(product.step, product.grid.figures(), loaded.steps):
            emit_warning(remark)
    return products


def costmap(
    map: Grid | str | PathLike[str],  # noqa: A002 - the word that users expect
    robot: RobotParameters | str | PathLike[str] | Sequence[str | PathLike[str]] | None = None, *,
    robot_radius: float | None = None, footprint: FootprintLike | None = None,
    costmap: CostmapName = "global", namespace: str | None = None,
    mask: occupancy.OccupancyGrid | None = None, inflation_radius: float | None = None,
    cost_scaling_factor: float | None = None,
) -> Costmap:  # fmt: skip
    """Compute the costmap that a robot has of a map.

    Parameters
    ----------
    map : grid, path or str
        Map, or its file.
    robot : path, str, sequence of them or RobotParameters, optional
        The robot's Nav2 parameter file or ROS 1 files. By default Nav2's own layers with its
        default inflation are used, and a radius or a footprint is required.
    robot_radius : float, optional
        Radius of a round robot, metres.
    footprint : Footprint, sequence or str, optional
        Shape of any other robot: ``[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]``.
    costmap : {'global', 'local'}
        Costmap of the parameter files to compute.
    namespace : str, optional
        Namespace of the robot, if the files describe several.
    mask : OccupancyGrid, optional
        Keepout mask.
    inflation_radius, cost_scaling_factor : float, optional
        Those of the inflation layer, without parameter files; by default 0.7 m and 3.

    Returns
    -------
    Costmap
        Costs 0..255 of costmap_2d.

    Raises
    ------
    ParameterError
        If no robot is given, or an argument has a wrong value.
    FileAccessError, MalformedInputError
        If a file cannot be read or is malformed.

    Examples
    --------
    >>> costs = costmap("examples/maps/office.yaml", robot_radius=0.2)
    >>> int((costs.cost >= 253).sum())
    228233
    """
    grid = reading.read_map(map) if isinstance(map, str | PathLike) else map
    if not isinstance(grid, Grid):
        rule = "takes a grid or its file"
        raise ParameterError(rule, place="costmap", got=map, hint=command.grid_hint(map))
    own = {"inflation_radius": inflation_radius, "cost_scaling_factor": cost_scaling_factor}
    changes = {f"cost.{name}": value for name, value in own.items() if value is not None}
    if changes and robot is not None:
        rule, hint = "cannot be given together with robot", "its files have the value"
        raise ParameterError(rule, place=next(iter(changes)).removeprefix("cost."), hint=hint)
    if robot is None and robot_radius is None and footprint is None:
        hint = "robot_radius=0.2, or the robot's own parameter file"
        raise ParameterError("needs a robot", place="costmap", hint=hint)
    recipe: Any = "nav2" if robot is None else robot
    if not isinstance(robot, RobotParameters | None):
        recipe = recipes.read_robot_parameters(robot, costmap=costmap, namespace=namespace)
    if isinstance(recipe, RobotParameters) and isinstance(grid, Framed):
        inputs.warn_of_robot("the map" if grid is map else str(map), grid, recipe)
    shape: Any = footprint
    products = apply_recipe(
        grid, recipe, changes, footprint=shape, robot_radius=robot_radius, mask=mask, canvas="full"
    )
    costs = next((item for item in products.values() if isinstance(item, Costmap)), None)
    if costs is None:
        raise ParameterError("makes no costs", place="robot", got=recipe)
    return costs


def run_map(
    path: Path, folder: Path, recipe: recipes.Recipe, settings: Settings,
    around: LocalOfRun | None = None,
) -> RunReport:  # fmt: skip
    texts: list[str] = []
    image_max = settings.picture_size
    opened = inputs.opened_map(path, recipe.steps, settings, image_max=image_max, with_sums=True)
    with ExitStack() as stack:
        stack.enter_context(use_threads(settings.threads))
        with adding_warnings(texts):
            source = stack.enter_context(opened)
            mask = inputs.mask_of(settings.mask, settings, source.grid)
            if recipe.robot is not None:
                inputs.warn_of_robot(path, source.grid, recipe.robot)
        target = output_folder(folder, source.sums, recipe, settings)
        canvas = source.grid.frame if settings.canvas == "full" else None
        products = products_of(recipe, source.grid, path, canvas=canvas, mask=mask)
        files = (*source.files, *recipe.files, *(() if mask is None else mask.files))
        filling = folders.Filling(
            target, products, path.stem, files, path, by_blocks=source.grid.is_lazy,
            warnings=[*recipe.remarks, *texts], read=source.grid,
            robot=None if recipe.robot is None else recipe.robot.footprint,
        )  # fmt: skip
        local_fillings = [around.filling(folder, source, settings, texts)] if around else []
        run, *local = fill(path, [filling, *local_fillings], settings)
        return records.replace(run, local=local[0]) if local else run


def fill(
    source: Path, fillings: Sequence[folders.Filling], settings: Settings, *, skip: bool = True
) -> list[RunReport]:
    """Write the folders in one pass; skip those that are up to date."""
    reports: dict[Path, RunReport] = {}
    for filling in fillings:
        filling.folder.check_inputs(filling.files)
        figures = filling.folder.unchanged_figures() if skip and not settings.force else None
        if figures is not None:
            folder = filling.folder.path
            reports[folder] = RunReport(folder, "unchanged", figures, source)
    for filling in fillings:
        if filling.folder.path in reports:
            filling.folder.repeat_warnings(filling)
    new = [filling for filling in fillings if filling.folder.path not in reports]
    if len(fillings) == 1 and new and new[0].folder.shows_input:
        folder = new[0].folder.path / LOCAL_RECIPE
        if any("local" in stage for stage in folders.stored_manifest(folder).get("stages", ())):
            emit_warning(f"{folder}: holds the local map of an earlier run, which is left as it is")
    with use_threads(settings.threads):
        written = folders.fill_together(new) if new else []
    for filling, figures in zip(new, written, strict=True):
        folder = filling.folder.path
        reports[folder] = RunReport(folder, "done", figures, source)
    return [reports[filling.folder.path] for filling in fillings]


def output_folder(
    folder: Path, sums: Mapping[str, str], recipe: recipes.Recipe, settings: Settings
) -> folders.OutputFolder:
    options = {"dialect": settings.dialect, **settings.picture_options, "canvas": settings.canvas}
    if settings.resolution is not None:
        options |= {"resolution": settings.resolution, "origin": list(settings.origin)}
    robot = None if recipe.robot is None else recipe.robot.described()
    mask = None
    if settings.mask is not None:
        with inputs.opened_input(settings.mask, settings) as file:
            mask = file.sums_by_name({})
    return folders.OutputFolder(
        folder, recipe.steps, sums, options, settings, robot, mask, shows_input=True
    )


def used_mask(recipe: recipes.Recipe, mask: inputs.AnyMask) -> inputs.AnyMask | None:
    makes_costs = (step.stage.product_type is Costmap or step.accepts_mask for step in recipe.steps)
    if mask is not None and not any(makes_costs):
        rule = "the recipe makes no costs, which alone a mask applies to"
        raise ParameterError(rule, place="mask")
    return inputs.used_mask(mask, recipe.robot)


@records.dataclass(frozen=True, repr=False)
class SingleResult(command.Result):
    source: Path
    output: Path
    step: Step
    figures: Figures
    result: Any
    sums: Mapping[str, str]
    curve: CostCurve | None = None

    def document(self) -> dict[str, Any]:
        if hasattr(self.result, "document"):
            file = {"file": str(self.source), "sha256": self.sums}
            return {"map": file, **self.result.document()}
        document = {"parameters": self.step.described()[self.step.name], "figures": self.figures}
        if self.step.stage.product_type is not Costmap:
            return document
        return {**document, **({"curve": None} if self.curve is None else self.curve.document())}

    def parts(self) -> Iterator[str]:
        yield encode_json(self.document()).decode().removesuffix("\n")

    def lines(self) -> Iterator[str]:
        yield folders.written_line(self.output, self.figures, with_origin=self.step.moves)
        yield from getattr(self.result, "lines", tuple)()


def apply_to_file(
    path: Path, output: Path, step: Step, settings: Settings, *, encoding: Encoding = "occupancy",
    curve: Path | None = None, with_curve: bool = False, with_sums: bool = False,
    also_read: Sequence[Path] = (), before: Sequence[Step] = (),
    robot: RobotParameters | None = None,
) -> SingleResult:  # fmt: skip
    # The keepout mask of the settings is laid over the costs that the stage makes. The picture of
    # their curve goes to `curve`, if that is given; `with_curve` asks for the curve alone, if there
    # is one. Files that were read for the parameters are no more replaced than the map is. A map,
    # not costs, goes through the steps `before` first.
    stage = step.stage
    outputs = reading.output_paths(output) if stage.edits else folders.output_of(step, output)
    endings = [output.suffix, *([folders.PICTURE] if settings.image is not None else [])]
    image_max = None if settings.image is None else settings.image_max
    steps = [*before, step]
    opened = inputs.opened_map(path, steps, settings, image_max=image_max, with_sums=with_sums)
    with use_threads(settings.threads), opened as source:
        if robot is not None:
            inputs.warn_of_robot(path, source.grid, robot)
        keepout = inputs.mask_of(settings.mask, settings, source.grid)
        read = [*source.files, *(keepout.files if keepout else ()), *also_read]
        progress = settings.progress if source.grid.is_lazy else None
        reported = passes_reported(progress, folders.passes_of(step, endings))
        opened_outputs = inputs.outputs_of(outputs, read, settings, curve=curve)
        with reported, opened_outputs as transaction, inputs.errors_named(path):
            accepted = source.grid
            for earlier in () if isinstance(accepted, Costmap) else before:
                accepted = earlier.apply(accepted, path)
            accepted = accepted if stage.edits else step.input_of(accepted, path)
            if step.moves:
                inputs.claim_step(path, accepted, step)
            masked: Costmap | None = None
            if keepout is not None and stage.product_type is Costmap:
                result, masked = keepout.costs_of(step, accepted, path)
            else:
                result = step.result_of(accepted, path)
            grid, title = grid_of(result), step.title
            costs = step.curve_on(accepted) if curve is not None or with_curve else None
            if curve is not None and costs is None:
                raise step.no_curve()
            overlays, title = folders.robot_overlays(step), f"{path.stem}: {title}"
            if keepout is not None and masked is not None and isinstance(grid, Costmap):
                overlays.insert(0, KeepoutOverlay.of(grid, masked))
                grid, title = masked, f"{title}, with {Path(keepout.path).name}"
            with folders.one_pass(transaction, grid) as pass_grid:
                if stage.edits:
                    # with the scale of costs and further keys of the YAML that it was read from
                    metadata = source.metadata
                    as_bytes = metadata is not None and metadata.cost_scale is not None
                    scale: Encoding = "costmap2d" if as_bytes else "occupancy"
                    extra = dict(metadata.extra) if metadata else {}
                    edited = pass_grid if formats.output_format(output).requests_rows else grid
                    reading.write_grid(transaction, output, edited, encoding=scale, extra=extra)
                else:
                    folders.write_product(
                        transaction, output, grid, step, pass_grid=pass_grid, encoding=encoding
                    )
                picture = settings.image
                if picture is not None and stage.shows_changes:
                    _add_changes(transaction, picture, settings, accepted, grid, title)
                elif picture is not None:
                    overlay = folders.together(overlays)
                    folders.write_picture(transaction, picture, grid, title, settings, overlay)
            if curve is not None and costs is not None:
                from mapdeal.pictures.cost_curve import cost_curve_image  # few ask

                title = one_line(f"{path.stem}: {step.title}")
                folders.write_image(
                    transaction, curve, lambda: cost_curve_image(costs, title=title)
                )
            figures = grid.figures()
            if remark := step.remark_on(figures):
                emit_warning(f"{path}: {remark}")
            return SingleResult(path, output, step, figures, result, source.sums, costs)


def _add_changes(
    transaction: Transaction, path: Path, settings: Settings, before: Grid, after: Grid, title: str
) -> None:
    from mapdeal.compare.difference import STATES, changes_of, states_of
    from mapdeal.pictures.comparisons import difference_image
    from mapdeal.pictures.styles import cleaning_style

    was, now = (states_of(np.asarray(grid.layer)) for grid in (before, after))
    changes = changes_of(was, now, np.ones(before.shape, dtype=np.bool_))
    filled = 7  # of the picture: unknown cells that are now free; see `cleaning_style`
    changes[(was == STATES.index("unknown")) & (now == STATES.index("free"))] = filled
    look: Any = {"image_extent": settings.image_extent, "style": cleaning_style()}
    image = difference_image(changes, before.frame, title=one_line(title), **look)
    folders.write_image(transaction, path, lambda: image)
