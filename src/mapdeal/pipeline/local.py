"""Local maps from files of point clouds, through a recipe, into folders."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, ParameterError
from mapdeal.formats.budget import holding
from mapdeal.formats.clouds.reader import CLOUD_SUFFIXES, cloud_chunks
from mapdeal.formats.file_state import FileState
from mapdeal.formats.listing import list_files, numbered_folders
from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import as_occupancy, open_map
from mapdeal.formats.poses import read_poses
from mapdeal.formats.source import (
    check_state,
    is_same_file,
    real_path,
    sha256_of,
    state_of,
    sums_of_reads,
)
from mapdeal.grid.coordinates import cells_to_cover
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import MOST_CELLS
from mapdeal.grid.resample import frames_overlap
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.local_map import LocalMap, LocalMapper, LocalOptions, local_map
from mapdeal.mapping.poses import Pose
from mapdeal.pipeline.files import errors_named
from mapdeal.pipeline.folder import OutputFolder, Product
from mapdeal.pipeline.memory import bytes_of, check_fits
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import RunReport, products_of
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.render.pose import PoseOverlay
from mapdeal.stages.definition import Stage

LOCAL_RECIPE = "local"
_DIGITS = 4


_LOCAL = Stage(
    local_map,
    name="local",
    summary="Make maps around a robot from point clouds.",
    title=lambda _: "local map",
    memory=6.0,
)
"""What comes before the recipe: it takes a cloud, so that no recipe can hold it."""


@dataclass(frozen=True)
class GlobalMap:
    """A map whose obstacles local maps take over, and the files it came from."""

    grid: OccupancyGrid
    files: tuple[Path, ...]
    sums: dict[str, str]
    dialect: Dialect


@dataclass(frozen=True)
class LocalCommon:
    """What all local maps of a command have in common.

    Parameters
    ----------
    options : LocalOptions
        How they are made of clouds.
    recipe : Recipe
        What is made of them.
    settings : Settings
        How to compute, draw and write.
    global_map : GlobalMap, optional
        Whose obstacles are taken over.
    require_points : bool
        Whether a cloud without a point in the window is an error.
    """

    options: LocalOptions
    recipe: Recipe
    settings: Settings
    global_map: GlobalMap | None = None
    require_points: bool = False


def read_global_map(path: Path, settings: Settings) -> GlobalMap:
    """Return the map in a file, as `LocalCommon` takes it."""
    with (
        sums_of_reads() as sums,
        open_map(path, dialect=settings.dialect, max_cells=settings.max_cells) as file,
    ):
        source = file.read()
        named = file.sums_by_name(sums)
    return GlobalMap(as_occupancy(source.grid, str(path)), source.files, named, settings.dialect)


def local_from_cloud(
    cloud: Path, pose: Sequence[float], folder: Path, common: LocalCommon, *, skip: bool = False
) -> RunReport:
    """Make a local map of a cloud, apply the recipe and write everything into a folder.

    Parameters
    ----------
    cloud : Path
        The cloud.
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame.
    folder : Path
        Where outputs go; it is made if missing. They appear together, the manifest last.
    common : LocalCommon
        The rest.
    skip : bool
        Whether nothing is done if the manifest shows that the folder holds all this already.

    Raises
    ------
    MapdealError
        If the cloud cannot be read or processed, or outputs exist; nothing is changed then.

    Warns
    -----
    MapdealWarning
        If no point marks a cell.
    """
    known = common.global_map
    with ExitStack() as stack:
        stack.enter_context(common.settings.memory())
        if known is not None:
            stack.enter_context(holding(bytes_of(known.grid)))
        _check_window(cloud, common)
    mapper = LocalMapper(
        pose,
        common.options,
        None if known is None else known.grid,
        lethal_threshold=_threshold_of(common.recipe),
    )
    parameters = {"pose": mapper.pose, **asdict(common.options)}
    first = Step(_LOCAL, {**parameters, "require_points": common.require_points})
    state = state_of(cloud)  # of what its checksum is of, and then its points
    target = OutputFolder(
        folder,
        (first, *common.recipe.steps),
        {cloud.name: sha256_of(cloud), **(known.sums if known is not None else {})},
        {
            **({"dialect": known.dialect} if known is not None else {}),
            **common.settings.picture_options,
        },
        common.settings,
    )
    files = (cloud, *(known.files if known is not None else ()))
    target.check_inputs(files)
    figures = target.unchanged_figures() if skip and not common.settings.force else None
    if figures is not None:
        target.repeat_warnings(cloud)
        return RunReport(folder, "unchanged", figures)
    with use_threads(common.settings.threads):
        figures = target.fill(
            _products(first, cloud, state, mapper, common),
            stem=cloud.stem,
            files=files,
            overlay=PoseOverlay(mapper.pose),
        )
    return RunReport(folder, "done", figures)


def _check_window(cloud: Path, common: LocalCommon) -> None:
    """Refuse a window that takes too much memory; one of too many cells is never made."""
    options = common.options
    width, height = (cells_to_cover(length, options.resolution) for length in options.size)
    if height * width <= MOST_CELLS:
        steps = (Step(_LOCAL, {}), *common.recipe.steps)
        check_fits(cloud, (height, width), steps, common.settings.picture_size)


def _threshold_of(recipe: Recipe) -> int:
    """Return what the first stage that looks for obstacles takes for one."""
    given = (step.parameters.get("lethal_threshold") for step in recipe.steps)
    return next((int(value) for value in given if value is not None), DEFAULT_LETHAL_THRESHOLD)


def _products(
    first: Step, cloud: Path, state: FileState, mapper: LocalMapper, common: LocalCommon
) -> Iterator[Product]:
    with errors_named(cloud):
        for points in cloud_chunks(cloud):
            mapper.add(points)
    check_state(cloud, state)
    made = mapper.result()
    _check_points(made, cloud, required=common.require_points)
    known = common.global_map
    if known is not None and not frames_overlap(made.grid.frame, known.grid.frame):
        x, y = made.pose[:2]
        text = f"{known.files[0]}: the map does not reach into the window around {x:.10g}, {y:.10g}"
        warnings.warn(text, MapdealWarning, stacklevel=2)
    yield Product(first, made.grid, _figures_of(made, has_map=known is not None))
    for product in products_of(common.recipe, made.grid, cloud):
        if product.step.stage.robot is not None and isinstance(product.grid, OccupancyGrid):
            _check_robot(product.grid, made, cloud)
        yield product


def _check_points(made: LocalMap, cloud: Path, *, required: bool) -> None:
    """Raise, or warn, if no point marks a cell."""
    counts = made.counts
    if counts.marking:
        return
    named = {
        "are not finite": counts.not_finite,
        "are beyond the height limits": counts.beyond_height,
        "are beyond the range limits": counts.beyond_range,
        "lie outside of the window": counts.outside,
    }
    parts = [f"{count} {what}" for what, count in named.items() if count]
    why = f"of {counts.points} points {', '.join(parts)}" if parts else "it holds no points"
    if required:
        raise MalformedInputError(f"no point marks a cell: {why}", source=cloud)
    warnings.warn(f"{cloud}: no point marks a cell: {why}", MapdealWarning, stacklevel=2)


def _check_robot(inflated: OccupancyGrid, made: LocalMap, cloud: Path) -> None:
    """Warn if the robot's own cell is an obstacle: all of its routes are closed then."""
    (cell,), (inside,) = inflated.frame.bounded_rowcol_from_xy([made.pose[:2]])
    if not inside or not inflated.occupied()[tuple(cell)]:
        return
    text = "the robot's own cell is an obstacle once inflated"
    if made.counts.marking:
        text += "; --min-range drops points of the robot itself"
    warnings.warn(f"{cloud}: {text}", MapdealWarning, stacklevel=2)


def _figures_of(made: LocalMap, *, has_map: bool) -> Figures:
    first, last = made.angles or (None, None)
    return {
        "pose": list(made.pose),
        **asdict(made.counts),
        **({"from_map": made.from_map} if has_map else {}),
        "angle_min": first,
        "angle_max": last,
        "rear_heading": made.rear_heading,
    }


@dataclass(frozen=True)
class CloudJob:
    """A cloud of a sequence: its file, where the robot stood, and where its map goes."""

    cloud: Path
    pose: Pose
    folder: Path


def other_folders(sequence: Sequence[CloudJob], output: Path) -> list[Path]:
    """Return numbered folders in `output` that are not of a sequence: of a longer one before."""
    used = {job.folder for job in sequence}
    return [folder for folder in numbered_folders(output) if folder not in used]


def sequence_of(names: Sequence[str], poses_file: Path, output: Path) -> list[CloudJob]:
    """Return the jobs of a sequence: its clouds in order, a pose and a numbered folder for each.

    Parameters
    ----------
    names : sequence of str
        Files, folders and patterns.
    poses_file : Path
        A pose a line, in the order of the clouds.
    output : Path
        Where the folders go: ``0000``, ``0001``, ...

    Raises
    ------
    MapdealError
        If a name stands for nothing, the poses cannot be read, or there is not one for each.
    """
    clouds = [cloud for cloud in _clouds_of(names) if not is_same_file(cloud, poses_file)]
    poses = read_poses(poses_file)
    if len(poses) != len(clouds):
        rule = f"must have a pose for each of {len(clouds)} clouds"
        raise MalformedInputError(rule, source=poses_file, got=len(poses))
    digits = max(_DIGITS, len(str(len(clouds) - 1)))
    jobs = [
        CloudJob(cloud, (x, y, yaw), output / f"{k:0{digits}}")
        for k, (cloud, (x, y, yaw)) in enumerate(zip(clouds, poses.tolist(), strict=True))
    ]
    places = {real_path(output), *(real_path(job.folder) for job in jobs)}
    for path in (poses_file, *clouds):
        if real_path(path).parent in places:
            rule = "lies where outputs go; they need a folder of their own"
            raise FileAccessError(rule, source=path)
    return jobs


def _clouds_of(names: Sequence[str]) -> list[Path]:
    # beside clouds there often lie texts that are none, such as their poses
    return list_files(names, CLOUD_SUFFIXES, not_in_folders=(".txt",))


def only_cloud(names: Sequence[str]) -> Path:
    """Return the one cloud that names stand for.

    Raises
    ------
    ParameterError
        If there are more: each then needs a pose.
    """
    clouds = _clouds_of(names)
    if len(clouds) > 1:
        rule = f"is for one cloud, there are {len(clouds)}"
        hint = "--poses FILE takes a pose for each"
        raise ParameterError(rule, source="--pose", hint=hint)
    return clouds[0]
