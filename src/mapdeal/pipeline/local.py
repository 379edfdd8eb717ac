"""Local maps from point clouds and a global map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import Stage
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealError,
    ParameterError,
    emit_warning,
)
from mapdeal.files.budget import claim, holding
from mapdeal.files.json_values import json_of
from mapdeal.files.source import (
    FileState,
    check_state,
    is_same_file,
    real_path,
    sha256_of,
    state_of,
    sums_of_reads,
)
from mapdeal.grid.frame import MOST_CELLS, cells_to_cover
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import frames_overlap
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD
from mapdeal.inputs.listing import list_files, numbered_folders
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.local_map import LocalMap, LocalMapper, LocalOptions, RollingMapper, local_map
from mapdeal.mapping.transforms import Pose
from mapdeal.maps.reading import Source, as_occupancy, open_map
from mapdeal.pictures.overlay import PoseOverlay
from mapdeal.pipeline.folder import Filling, OutputFolder, Product, fill_together
from mapdeal.pipeline.inputs import bytes_of, check_fits, errors_named
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import RunReport, around_in, products_of
from mapdeal.pipeline.settings import Settings, heard
from mapdeal.pipeline.step import Step
from mapdeal.sensors.clouds import CLOUD_SUFFIXES, cloud_chunks
from mapdeal.sensors.points import read_poses

if TYPE_CHECKING:
    from mapdeal.pipeline.bag_sensors import BagClouds

Points = NDArray[np.float64]


@dataclass(frozen=True)
class SummedCloud:
    """A cloud as it was when its checksum was made."""

    cloud: Cloud
    sums: Mapping[str, str]
    options: Mapping[str, str]
    states: Mapping[Path, FileState]

    def points(self) -> Iterator[Points]:
        """Yield the points, some at a time; an error names the cloud, also if it was replaced."""
        with errors_named(self.cloud.path):
            yield from self.cloud.chunks()
        for path, state in self.states.items():
            check_state(path, state)

    @property
    def identity(self) -> list[str]:
        return [*self.sums.values(), *self.options.values()]


class Cloud(ABC):
    """A cloud that can be read more than once."""

    @property
    @abstractmethod
    def path(self) -> Path:
        """What errors and pictures name."""

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.path,)

    @property
    def name(self) -> str:
        """What summaries call it."""
        return self.path.name

    @abstractmethod
    def summed(self) -> SummedCloud:
        """Return the cloud with its checksum."""

    @abstractmethod
    def chunks(self) -> Iterator[Points]:
        """Yield the points, shape (N, 2) or (N, 3), some at a time."""


@dataclass(frozen=True)
class FileCloud(Cloud):
    """A cloud in a file of its own."""

    file: Path

    @property
    def path(self) -> Path:
        return self.file

    def summed(self) -> SummedCloud:
        """Return the cloud with its checksum; see `Cloud`."""
        state = state_of(self.path)  # of what its sum is of, and then its points
        return SummedCloud(self, {self.path.name: sha256_of(self.path)}, {}, {self.path: state})

    def chunks(self) -> Iterator[Points]:
        """Yield the points; see `Cloud`."""
        return cloud_chunks(self.path)


_DIGITS = 4

Keep = int | Literal["all"]

OF_WINDOWS = ("size", "resolution", "unknown")
"""Fields of `LocalOptions` that apply without a cloud."""


_LOCAL = Stage(
    local_map,
    name="local",
    summary="Make maps around a robot from point clouds.",
    title=lambda _: "local map",
    memory=12.0,
)
"""What comes before the recipe: it takes a cloud, so that no recipe can hold it."""


@dataclass(frozen=True)
class GlobalMap:
    """A map that local maps take over, the files it came from, and what reading them warned of."""

    grid: OccupancyGrid
    files: tuple[Path, ...]
    sums: Mapping[str, str]
    heard: Sequence[str] = ()


@dataclass(frozen=True)
class LocalCommon:
    """What all local maps of a command have in common."""

    options: LocalOptions
    recipe: Recipe
    settings: Settings
    global_map: GlobalMap | None = None
    require_points: bool = False
    keep: Keep | None = None

    @property
    def lethal_threshold(self) -> int:
        """What is an obstacle of the global map: as the first stage that looks for them has it."""
        given = (step.parameters.get("lethal_threshold") for step in self.recipe.steps)
        return next((int(value) for value in given if value is not None), DEFAULT_LETHAL_THRESHOLD)


@dataclass(frozen=True)
class LocalJob:
    """A local map that is to be made."""

    cloud: Cloud | None
    pose: Sequence[float]
    folder: Path

    def source(self, common: LocalCommon) -> Path:
        """Return the file that messages and pictures name: the cloud, or the global map."""
        if self.cloud is not None:
            return self.cloud.path
        if common.global_map is None:
            raise ParameterError("a cloud or a global map must be given", place="cloud")
        return common.global_map.files[0]


def read_global_map(path: Path, settings: Settings) -> GlobalMap:
    """Return the map in a file, as `LocalCommon` takes it."""
    texts: list[str] = []
    with (
        heard(texts),
        sums_of_reads() as sums,
        open_map(path, dialect=settings.dialect, max_cells=settings.max_cells) as file,
    ):
        source = file.read()
        named = file.sums_by_name(sums)
        grid = as_occupancy(source.grid, path)
    return GlobalMap(grid, source.files, named, texts)


def make_local(job: LocalJob, common: LocalCommon, *, skip: bool = False) -> RunReport:
    """Make a local map of a cloud, apply the recipe and write everything into a folder."""
    with common.settings.memory(), holding_map(common.global_map):
        filling = local_filling(job, common)
    return filled(filling, job.source(common), common.settings, skip=skip)


def filled(filling: Filling, source: Path, settings: Settings, *, skip: bool) -> RunReport:
    """Fill the folder of a local map, unless it is to be skipped if it holds all this already."""
    folder = filling.folder
    folder.check_inputs(filling.files)
    figures = folder.unchanged_figures() if skip and not settings.force else None
    if figures is not None:
        folder.repeat_warnings(filling)
        return RunReport(folder.path, "unchanged", figures, source)
    with use_threads(settings.threads):
        (figures,) = fill_together([filling])
    return RunReport(folder.path, "done", figures, source)


@contextmanager
def holding_map(known: GlobalMap | None) -> Iterator[None]:
    """Count the memory of a map that was read as taken within a ``with`` block."""
    with holding(0 if known is None else bytes_of(known.grid)):
        yield


def local_filling(job: LocalJob, common: LocalCommon) -> Filling:
    """Return what goes into the folder of a local map; it is made when it is asked for."""
    known = common.global_map
    check_window(job.source(common), common)
    mapper = LocalMapper(
        job.pose,
        common.options,
        None if known is None else known.grid,
        lethal_threshold=common.lethal_threshold,
    )
    if job.cloud is None:
        return filling_of(job, mapper.pose, {}, common, mapper.result)
    summed = job.cloud.summed()

    def made() -> LocalMap:
        with errors_named(summed.cloud.path):
            for points in summed.points():
                mapper.add(points)
        return mapper.result()

    return filling_of(job, mapper.pose, summed.sums, common, made, summed.options)


def filling_of(
    job: LocalJob,
    pose: Pose,
    sums: Mapping[str, str],
    common: LocalCommon,
    make: Callable[[], LocalMap],
    options: Mapping[str, str] | None = None,
) -> Filling:
    """Return what goes into the folder of a local map, which is made by a function."""
    # `sums` is of the clouds that were read; `options` is what else shapes the products.
    known = common.global_map
    named = {**sums, **(known.sums if known is not None else {})}
    folder = local_folder(job.folder, pose, named, common, options, has_map=known is not None)
    clouds = () if job.cloud is None else job.cloud.files
    files = (*clouds, *(known.files if known is not None else ()))
    products = _products(folder.steps[0], job, make, common)
    # not the map, which is another one's
    subject = job.folder if job.cloud is None else job.cloud.path
    return Filling(
        folder, products, job.source(common).stem, (*files, *common.recipe.files), subject,
        PoseOverlay(pose),
        heard=(*common.recipe.remarks, *(() if known is None else known.heard)),
    )  # fmt: skip


def local_folder(
    folder: Path,
    pose: Pose,
    sums: Mapping[str, str],
    common: LocalCommon,
    options: Mapping[str, str] | None = None,
    *,
    has_map: bool,
) -> OutputFolder:
    parameters = {
        "pose": pose,
        **asdict(common.options),
        "require_points": common.require_points,
        "keep": common.keep,
    }
    return OutputFolder(
        folder,
        (Step(_LOCAL, parameters), *common.recipe.steps),
        sums,
        {
            **({"dialect": common.settings.dialect} if has_map else {}),
            **common.settings.picture_options,
            **(options or {}),
        },
        common.settings,
        None if common.recipe.robot is None else common.recipe.robot.described(),
    )


def check_window(source: Path, common: LocalCommon) -> None:
    """Refuse a window that takes too much memory; one of too many cells is never made."""
    options = common.options
    width, height = (cells_to_cover(length, options.resolution) for length in options.size)
    if height * width <= MOST_CELLS:
        steps = (Step(_LOCAL, {}), *common.recipe.steps)
        check_fits(source, (height, width), steps, common.settings.picture_size)


def _products(
    first: Step, job: LocalJob, make: Callable[[], LocalMap], common: LocalCommon
) -> Iterator[Product]:
    made, known, source = make(), common.global_map, job.source(common)
    if job.cloud is not None:
        _check_points(made, job.cloud.path, required=common.require_points)
    if known is not None and not frames_overlap(made.grid.frame, known.grid.frame):
        x, y = made.pose[:2]
        text = f"{known.files[0]}: the map does not reach into the window around {x:.10g}, {y:.10g}"
        emit_warning(text, stacklevel=2)
    yield Product(first, made.grid, _figures_of(made, job, common))
    for product in products_of(common.recipe, made.grid, source):
        if product.step.stage.robot is not None and isinstance(product.grid, OccupancyGrid):
            _check_robot(product.grid, made, source)
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
    emit_warning(f"{cloud}: no point marks a cell: {why}", stacklevel=2)


def _check_robot(inflated: OccupancyGrid, made: LocalMap, cloud: Path) -> None:
    """Warn if the robot's own cell is an obstacle: all of its routes are closed then."""
    (cell,), (inside,) = inflated.frame.bounded_rowcol_from_xy([made.pose[:2]])
    if not inside or not inflated.occupied()[tuple(cell)]:
        return
    text = "the robot's own cell is an obstacle once inflated"
    if made.counts.marking:
        text += "; a larger min_range drops points of the robot itself"
    emit_warning(f"{cloud}: {text}", stacklevel=2)


def _figures_of(made: LocalMap, job: LocalJob, common: LocalCommon) -> Figures:
    first, last = made.angles or (None, None)
    seen = {**asdict(made.counts), "angle_min": first, "angle_max": last}
    return {
        "pose": list(made.pose),
        **(seen if job.cloud is not None else {}),
        **({"from_map": made.from_map} if common.global_map is not None else {}),
        **(
            {"clouds": made.clouds, "from_earlier": made.from_earlier}
            if common.keep is not None
            else {}
        ),
        "rear_heading": made.rear_heading,
    }


def other_folders(sequence: Sequence[LocalJob], output: Path) -> list[Path]:
    """Return numbered folders in `output` that are not of a sequence: of a longer one before."""
    used = {job.folder for job in sequence}
    return [folder for folder in numbered_folders(output) if folder not in used]


def sequence_of(names: Sequence[str], poses_file: Path, output: Path) -> list[LocalJob]:
    """Return the jobs of a sequence: its clouds in order, a pose and a numbered folder for each."""
    clouds = [cloud for cloud in _clouds_of(names) if not is_same_file(cloud, poses_file)]
    poses = read_poses(poses_file)
    if len(poses) != len(clouds):
        rule = f"must have a pose for each of {len(clouds)} clouds"
        raise MalformedInputError(rule, source=poses_file, got=len(poses))
    jobs = numbered_jobs(list(map(FileCloud, clouds)), poses.tolist(), output)
    places = {real_path(output), *(real_path(job.folder) for job in jobs)}
    for path in (poses_file, *clouds):
        if real_path(path).parent in places:
            rule = "lies where outputs go; they need a folder of their own"
            raise FileAccessError(rule, source=path)
    return jobs


def numbered_jobs(
    clouds: Sequence[Cloud], poses: Sequence[Sequence[float]], output: Path
) -> list[LocalJob]:
    """Return the jobs of clouds with their poses, in folders ``0000``, ``0001`` and so on."""
    digits = max(_DIGITS, len(str(len(clouds) - 1)))
    return [
        LocalJob(cloud, tuple(pose), output / f"{k:0{digits}}")
        for k, (cloud, pose) in enumerate(zip(clouds, poses, strict=True))
    ]


def sequence_of_bag(source: BagClouds, poses_file: Path | None, output: Path) -> list[LocalJob]:
    numbers = range(len(source))
    if poses_file is None:
        poses = source.poses(numbers)
    else:
        poses = [(x, y, yaw) for x, y, yaw in read_poses(poses_file).tolist()]
        if len(poses) != len(source):
            rule = f"must have a pose for each of {len(source)} clouds"
            raise MalformedInputError(rule, source=poses_file, got=len(poses))
    known = [(source.cloud(k), pose) for k, pose in zip(numbers, poses, strict=True)
             if pose is not None]  # fmt: skip
    if not known:
        raise MalformedInputError("of no cloud it is known where the robot was",
                                  source=source.bag.path)  # fmt: skip
    return numbered_jobs([cloud for cloud, _ in known], [pose for _, pose in known], output)


def _clouds_of(names: Sequence[str]) -> list[Path]:
    # beside clouds there often lie texts that are none, such as their poses
    return list_files(names, CLOUD_SUFFIXES, not_in_folders=(".txt",))


def only_cloud(names: Sequence[str]) -> FileCloud:
    clouds = _clouds_of(names)
    if len(clouds) > 1:
        rule = f"applies to one cloud, there are {len(clouds)}"
        hint = "--poses FILE takes a pose for each"
        raise ParameterError(rule, source="--pose", hint=hint)
    return FileCloud(clouds[0])


_PER_CELL = 10
"""Bytes for each cell that is remembered: while the cells move, twice."""


class RollingRun:
    """Makes the rolling maps of a sequence, in its order."""

    # A map is a function of the last clouds and their poses: those that are there already are
    # skipped, and their clouds read only once a later map needs them.

    def __init__(self, jobs: Sequence[LocalJob], common: LocalCommon) -> None:
        if common.keep is None:
            raise ParameterError("must be given", place="keep")
        known = common.global_map
        self._jobs = jobs
        self._common = common
        self._keep = None if common.keep == "all" else common.keep
        self._mapper = RollingMapper(
            [job.pose for job in jobs],
            common.options,
            keep=self._keep,
            global_map=None if known is None else known.grid,
            lethal_threshold=common.lethal_threshold,
        )
        with common.settings.memory(), holding_map(known):
            source = jobs[0].source(common)
            check_window(source, common)
            most = self._mapper.remembered
            claim(
                source,
                _PER_CELL * most.cells,
                what=f"{most.width} x {most.height} cells to remember",
                hint="a smaller --keep takes less",
            )
        self._summed: list[SummedCloud | None] = []

    def __call__(self, index: int) -> RunReport:
        """Make the map of a cloud; each is asked for after those before it, once."""
        job = self._jobs[index]
        self._summed.append(None)  # unless it can be read
        if job.cloud is None:
            raise ParameterError("must be given", place="cloud")
        summed = job.cloud.summed()
        first = 0 if self._keep is None else max(0, index + 1 - self._keep)
        before = self._summed[first:index]
        missing = sum(one is None for one in before)
        filling = filling_of(
            job,
            self._mapper.poses[index],
            summed.sums,
            self._common,
            lambda: self._made(index, missing),
            {"clouds_before": self._sum_before(first, index), **summed.options},
        )
        self._summed[index] = summed
        return filled(filling, self._cloud(index), self._common.settings, skip=True)

    def _cloud(self, index: int) -> Path:
        return self._jobs[index].source(self._common)

    def _sum_before(self, first: int, index: int) -> str:
        """Return one checksum of the earlier clouds of a map, and of their poses."""
        parts = [
            [*([None] if one is None else one.identity), *pose]
            for one, pose in zip(
                self._summed[first:index], self._mapper.poses[first:index], strict=True
            )
        ]
        return sha256(json_of(parts)).hexdigest()

    def _made(self, index: int, missing: int) -> LocalMap:
        while self._mapper.turn < index:
            self._catch_up(index)
        self._add(index)
        if missing:
            text = f"{missing} of the clouds before it could not be read: the map is without them"
            emit_warning(f"{self._cloud(index)}: {text}", stacklevel=2)
        return self._mapper.result()

    def _catch_up(self, index: int) -> None:
        """Add the cloud whose turn it is, if the map of a later one needs it."""
        turn = self._mapper.turn
        forgotten = self._keep is not None and turn + self._keep <= index
        if forgotten or self._summed[turn] is None:
            self._mapper.skip()
        else:
            self._add(turn)

    def _add(self, turn: int) -> None:
        """Add a cloud; one that cannot be read is left out of the maps after it."""
        known = self._summed[turn]
        if known is None:
            raise ParameterError("was not read", source=self._cloud(turn))
        try:
            with errors_named(self._cloud(turn)):
                self._mapper.add_in_parts(known.points())
        except MapdealError:
            self._summed[turn] = None
            self._mapper.skip()
            raise


@dataclass(frozen=True)
class Around:
    """Where a robot stands on the map of a run, and how its local map is made."""

    pose: Pose
    recipe: Recipe
    options: LocalOptions
    cloud: Path | None = None
    takes_cells: bool = False

    @property
    def files(self) -> tuple[Path, ...]:
        return () if self.cloud is None else (self.cloud,)

    def filling(
        self, folder: Path, source: Source, settings: Settings, heard: Sequence[str]
    ) -> Filling:
        """Return what goes into the local map's folder, given that of the run and its map."""
        # `heard` is what reading the map has warned of.
        grid = as_occupancy(source.grid, source.files[0])
        known = GlobalMap(grid, source.files, dict(source.sums), heard)
        common = self._common(settings, known.grid.resolution, known)
        cloud = None if self.cloud is None else FileCloud(self.cloud)
        with holding_map(None if known.grid.is_lazy else known):
            return local_filling(LocalJob(cloud, self.pose, around_in(folder)), common)

    def folder(
        self, folder: Path, sums: Mapping[str, str], resolution: float, settings: Settings
    ) -> OutputFolder:
        """Return the local map's folder, given the run's, and sums and cells of its map."""
        cloud = {} if self.cloud is None else {self.cloud.name: sha256_of(self.cloud)}
        common = self._common(settings, resolution)
        check_window(self.cloud or folder, common)
        return local_folder(around_in(folder), self.pose, {**cloud, **sums}, common, has_map=True)

    def _common(
        self, settings: Settings, resolution: float, known: GlobalMap | None = None
    ) -> LocalCommon:
        options = replace(self.options, resolution=resolution) if self.takes_cells else self.options
        return LocalCommon(options, self.recipe, settings, known)
