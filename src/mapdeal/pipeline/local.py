"""Local maps from point clouds and a global map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from mapdeal import command, errors
from mapdeal.files import json_values, source as sources
from mapdeal.grid import canvas, frame, occupancy, values
from mapdeal.kernels.arrays import Floats
from mapdeal.mapping.local_map import LocalMap, LocalMapper, LocalOptions, RollingMapper, local_map
from mapdeal.mapping.transforms import Pose
from mapdeal.maps import listing, reading
from mapdeal.pictures.overlay import PoseOverlay
from mapdeal.pipeline import inputs, run
from mapdeal.pipeline.folder import Filling, OutputFolder, Product
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import Settings, adding_warnings
from mapdeal.pipeline.step import Step
from mapdeal.records import asdict, dataclass, replace
from mapdeal.sensors.clouds import CLOUD_SUFFIXES, cloud_chunks
from mapdeal.sensors.points import read_poses


@dataclass(frozen=True)
class SummedCloud:
    cloud: Cloud
    sums: Mapping[str, str]
    options: Mapping[str, str]
    states: Mapping[Path, sources.FileState]

    def points(self) -> Iterator[Floats]:
        """Yield the points, some at a time; refuse files that were replaced meanwhile."""
        yield from self.cloud.chunks()
        for path, state in self.states.items():
            sources.check_state(path, state)


@dataclass(frozen=True)
class Cloud(ABC):
    path: Path  # what errors and pictures name
    name: str  # what summaries call it
    files: tuple[Path, ...]

    @abstractmethod
    def summed(self) -> SummedCloud: ...

    @abstractmethod
    def chunks(self) -> Iterator[Floats]:
        """Yield the points, shape (N, 2) or (N, 3), some at a time."""


class FileCloud(Cloud):
    @classmethod
    def of(cls, path: Path) -> FileCloud:
        return cls(path, path.name, (path,))

    def summed(self) -> SummedCloud:
        states = {self.path: sources.state_of(self.path)}  # of what its sum is of, then its points
        return SummedCloud(self, {self.path.name: sources.sha256_of(self.path)}, {}, states)

    def chunks(self) -> Iterator[Floats]:
        return cloud_chunks(self.path)


Keep = int | Literal["all"]
OF_WINDOWS = ("size", "resolution", "unknown")  # the `LocalOptions` that apply without a cloud
_DIGITS = 4
_LOCAL = command.Stage(  # before the recipe: its input is a cloud, so recipes cannot list it
    local_map, name="local", summary="Make maps around a robot from point clouds.",
    title=lambda _: "local map", memory=12.0,
)  # fmt: skip


@dataclass(frozen=True)
class GlobalMap:
    grid: occupancy.OccupancyGrid
    files: tuple[Path, ...]
    sums: Mapping[str, str]
    warnings: Sequence[str] = ()


@dataclass(frozen=True)
class LocalCommon:
    options: LocalOptions
    recipe: Recipe
    settings: Settings
    global_map: GlobalMap | None = None
    require_points: bool = False
    keep: Keep | None = None

    @property
    def lethal_threshold(self) -> int:
        """Least occupancy of an obstacle of the global map: that of the first stage with one."""
        thresholds = (step.parameters.get("lethal_threshold") for step in self.recipe.steps)
        return next((int(v) for v in thresholds if v is not None), values.DEFAULT_LETHAL_THRESHOLD)


@dataclass(frozen=True)
class LocalJob:
    cloud: Cloud | None
    pose: Sequence[float]
    folder: Path

    def source(self, common: LocalCommon) -> Path:
        """Return the file that messages and pictures name: the cloud, or the global map."""
        if self.cloud is not None:
            return self.cloud.path
        if common.global_map is None:
            raise errors.ParameterError("a cloud or a global map must be given", place="cloud")
        return common.global_map.files[0]


def read_global_map(path: Path, settings: Settings) -> GlobalMap:
    texts: list[str] = []
    with adding_warnings(texts):
        source = inputs.read_input(path, settings, with_sums=True)
        grid = reading.as_occupancy(source.grid, path)
    return GlobalMap(grid, source.files, source.sums, texts)


def make_local(job: LocalJob, common: LocalCommon, *, skip: bool = False) -> run.RunReport:
    with common.settings.reading(), holding_map(common.global_map):
        filling = local_filling(job, common)
    return run.fill(job.source(common), [filling], common.settings, skip=skip)[0]


def holding_map(known: GlobalMap | None) -> AbstractContextManager[None]:
    return sources.holding(0 if known is None else inputs.bytes_of(known.grid))


def local_filling(job: LocalJob, common: LocalCommon) -> Filling:
    """Return what goes into the folder of a local map; it is made when it is asked for."""
    known = common.global_map
    check_window(job.source(common), common)
    grid = None if known is None else known.grid
    mapper = LocalMapper(job.pose, common.options, grid, lethal_threshold=common.lethal_threshold)
    summed = None if job.cloud is None else job.cloud.summed()

    def make() -> LocalMap:
        if summed is not None:
            with inputs.errors_named(summed.cloud.path):
                for points in summed.points():
                    mapper.add(points)
        return mapper.result()

    return filling_of(job, mapper.pose, summed, common, make)


def filling_of(
    job: LocalJob, pose: Pose, summed: SummedCloud | None, common: LocalCommon,
    make: Callable[[], LocalMap], more_options: Mapping[str, str] | None = None,
) -> Filling:  # fmt: skip
    known, cloud = common.global_map, job.cloud
    sums = {**(summed.sums if summed else {}), **(known.sums if known else {})}
    options = {**(more_options or {}), **(summed.options if summed else {})}
    files = (*(cloud.files if cloud else ()), *(known.files if known else ()))
    folder = local_folder(job.folder, pose, sums, common, options, has_map=known is not None)
    subject = job.folder if cloud is None else cloud.path  # not the map, which is another one's
    warnings = (*common.recipe.remarks, *(known.warnings if known else ()))
    return Filling(folder, _products(folder.steps[0], job, make, common), job.source(common).stem,
                   (*files, *common.recipe.files), subject, PoseOverlay(pose),
                   warnings=warnings)  # fmt: skip


def local_folder(
    folder: Path, pose: Pose, sums: Mapping[str, str], common: LocalCommon,
    more_options: Mapping[str, str] | None = None, *, has_map: bool,
) -> OutputFolder:  # fmt: skip
    of_cloud = {"require_points": common.require_points, "keep": common.keep}
    first = Step(_LOCAL, {"pose": pose, **asdict(common.options), **of_cloud})
    recipe, settings = common.recipe, common.settings
    options: dict[str, Any] = {"dialect": settings.dialect} if has_map else {}
    options |= {**settings.picture_options, **(more_options or {})}
    robot = None if recipe.robot is None else recipe.robot.described()
    return OutputFolder(folder, (first, *recipe.steps), sums, options, settings, robot)


def check_window(source: Path, common: LocalCommon) -> None:
    options = common.options
    width, height = (frame.cells_to_cover(length, options.resolution) for length in options.size)
    if height * width <= frame.MOST_CELLS:
        steps = (Step(_LOCAL, {}), *common.recipe.steps)
        inputs.check_fits(source, (height, width), steps, common.settings.picture_size)


def _products(
    first: Step, job: LocalJob, make: Callable[[], LocalMap], common: LocalCommon
) -> Iterator[Product]:
    local, known, source = make(), common.global_map, job.source(common)
    if job.cloud is not None:
        _check_points(local, job.cloud.path, required=common.require_points)
    if known is not None and not canvas.frames_overlap(local.grid.frame, known.grid.frame):
        window = "the window around {:.10g}, {:.10g}".format(*local.pose[:2])
        errors.emit_warning(f"{known.files[0]}: the map does not reach into {window}")
    yield Product(first, local.grid, _figures_of(local, job, common))
    for product in run.products_of(common.recipe, local.grid, source):
        grid = product.grid
        if product.step.stage.robot is not None and isinstance(grid, occupancy.OccupancyGrid):
            (cell,), (inside,) = grid.frame.bounded_rowcol_from_xy([local.pose[:2]])
            if inside and grid.occupied()[tuple(cell)]:
                text = f"{source}: the robot's own cell is an obstacle once inflated"
                hint = "; a larger min_range drops points of the robot itself"
                errors.emit_warning(text + hint * bool(local.counts.marking))
        yield product


def _check_points(local: LocalMap, cloud: Path, *, required: bool) -> None:
    counts = local.counts
    if counts.marking:
        return
    named = (
        (counts.not_finite, "are not finite"), (counts.beyond_angle, "are beyond the angles"),
        (counts.beyond_height, "are beyond the height limits"),
        (counts.beyond_range, "are beyond the range limits"),
        (counts.outside, "lie outside of the window"),
    )  # fmt: skip
    parts = [f"{count} {reason}" for count, reason in named if count]
    why = f"of {counts.points} points {', '.join(parts)}" if parts else "it holds no points"
    if required:
        raise errors.MalformedInputError(f"no point marks a cell: {why}", source=cloud)
    errors.emit_warning(f"{cloud}: no point marks a cell: {why}")


def _figures_of(local: LocalMap, job: LocalJob, common: LocalCommon) -> frame.Figures:
    figures: frame.Figures = {"pose": list(local.pose)}
    if job.cloud is not None:
        first, last = local.angles or (None, None)
        figures |= {**asdict(local.counts), "angle_min": first, "angle_max": last}
        if common.options.angle_min is None:
            del figures["beyond_angle"]
    if common.global_map is not None:
        figures["from_map"] = local.from_map
    if common.keep is not None:
        figures |= {"clouds": local.clouds, "from_earlier": local.from_earlier}
    return {**figures, "rear_heading": local.rear_heading}


def other_folders(sequence: Sequence[LocalJob], output: Path) -> list[Path]:
    used = {job.folder for job in sequence}
    return [folder for folder in listing.numbered_folders(output) if folder not in used]


def sequence_of(names: Sequence[str], poses_file: Path, output: Path) -> list[LocalJob]:
    # Without clouds, each pose has the window of the global map around it.
    if not names:
        windows = read_poses(poses_file).tolist()
        return numbered_jobs([None] * len(windows), windows, output)
    clouds = [cloud for cloud in _clouds_of(names) if not sources.is_same_file(cloud, poses_file)]
    poses = poses_for(len(clouds), poses_file)
    jobs = numbered_jobs(list(map(FileCloud.of, clouds)), poses, output)
    places = set(map(sources.real_path, [output, *(job.folder for job in jobs)]))
    for path in (poses_file, *clouds):
        if sources.real_path(path).parent in places:
            rule = "lies where outputs go; they need a folder of their own"
            raise errors.FileAccessError(rule, source=path)
    return jobs


def poses_for(count: int, path: Path) -> list[Pose]:
    poses = [(x, y, yaw) for x, y, yaw in read_poses(path).tolist()]
    if len(poses) != count:
        rule = f"must have a pose for each of {count} clouds"
        raise errors.MalformedInputError(rule, source=path, got=len(poses))
    return poses


def numbered_jobs(
    clouds: Sequence[Cloud | None], poses: Sequence[Sequence[float]], output: Path
) -> list[LocalJob]:
    digits = max(_DIGITS, len(str(len(clouds) - 1)))
    return [
        LocalJob(cloud, tuple(pose), output / f"{k:0{digits}}")
        for k, (cloud, pose) in enumerate(zip(clouds, poses, strict=True))
    ]


def _clouds_of(names: Sequence[str]) -> list[Path]:
    # text files beside clouds are often their poses
    return listing.list_files(names, CLOUD_SUFFIXES, not_in_folders=(".txt",))


def only_cloud(names: Sequence[str]) -> FileCloud:
    clouds = _clouds_of(names)
    if len(clouds) > 1:
        rule, hint = f"applies to one cloud, there are {len(clouds)}", "--poses FILE gives one each"
        raise errors.ParameterError(rule, source="--pose", hint=hint)
    return FileCloud.of(clouds[0])


_PER_CELL = 10  # bytes for each cell that is remembered: while the cells move, twice


class RollingRun:
    # A map is a function of the last clouds and their poses: those that are there already are
    # skipped, and their clouds read only once a later map needs them.

    def __init__(self, jobs: Sequence[LocalJob], common: LocalCommon) -> None:
        if common.keep is None:
            raise errors.ParameterError("must be given", place="keep")
        known = common.global_map
        self._jobs, self._common = jobs, common
        self._keep = None if common.keep == "all" else common.keep
        self._mapper = RollingMapper(
            [job.pose for job in jobs], common.options, keep=self._keep,
            global_map=None if known is None else known.grid,
            lethal_threshold=common.lethal_threshold,
        )  # fmt: skip
        with common.settings.reading(), holding_map(known):
            source, most = jobs[0].source(common), self._mapper.remembered
            check_window(source, common)
            cells, hint = f"{most.width} x {most.height} cells", "a smaller --keep takes less"
            sources.claim(source, _PER_CELL * most.cells, what=f"{cells} to remember", hint=hint)
        self._summed: dict[int, SummedCloud] = {}  # those that can be read

    def __call__(self, index: int) -> run.RunReport:
        """Make the map of a cloud; each is asked for after those before it, once."""
        job = self._jobs[index]
        if job.cloud is None:
            raise errors.ParameterError("must be given", place="cloud")
        summed = job.cloud.summed()
        first = 0 if self._keep is None else max(0, index + 1 - self._keep)
        before = [self._summed.get(earlier) for earlier in range(first, index)]
        parts = [
            [*([None] if cloud is None else (*cloud.sums.values(), *cloud.options.values())), *pose]
            for cloud, pose in zip(before, self._mapper.poses[first:index], strict=True)
        ]
        before_it = {"clouds_before": sha256(json_values.encode_json(parts)).hexdigest()}
        make = partial(self._make_map, index, before.count(None))
        pose = self._mapper.poses[index]
        filling = filling_of(job, pose, summed, self._common, make, before_it)
        self._summed[index] = summed
        return run.fill(self._cloud(index), [filling], self._common.settings)[0]

    def _cloud(self, index: int) -> Path:
        return self._jobs[index].source(self._common)

    def _make_map(self, index: int, missing: int) -> LocalMap:
        while self._mapper.turn < index:  # those before it, if it or a later one needs them
            turn = self._mapper.turn
            is_forgotten = self._keep is not None and turn + self._keep <= index
            if is_forgotten or turn not in self._summed:
                self._mapper.skip()
            else:
                self._add(turn)
        self._add(index)
        if missing:
            text = f"{missing} of the clouds before it could not be read: the map is without them"
            errors.emit_warning(f"{self._cloud(index)}: {text}")
        return self._mapper.result()

    def _add(self, turn: int) -> None:
        try:
            with inputs.errors_named(self._cloud(turn)):
                self._mapper.add_in_parts(self._summed[turn].points())
        except errors.MapdealError:
            del self._summed[turn]
            self._mapper.skip()
            raise


@dataclass(frozen=True)
class Around:
    pose: Pose
    recipe: Recipe
    options: LocalOptions
    cloud: Path | None = None  # else the window of the map, in its cells

    @property
    def files(self) -> tuple[Path, ...]:
        return () if self.cloud is None else (self.cloud,)

    def filling(
        self, folder: Path, source: reading.Source, settings: Settings, warnings: Sequence[str]
    ) -> Filling:
        # `warnings` are those of reading the map.
        grid = reading.as_occupancy(source.grid, source.files[0])
        known = GlobalMap(grid, source.files, dict(source.sums), warnings)
        common = self._common(settings, known.grid.resolution, known)
        cloud = None if self.cloud is None else FileCloud.of(self.cloud)
        with holding_map(None if known.grid.is_lazy else known):
            return local_filling(LocalJob(cloud, self.pose, folder / run.LOCAL_RECIPE), common)

    def folder(
        self, folder: Path, sums: Mapping[str, str], resolution: float, settings: Settings
    ) -> OutputFolder:
        cloud = {} if self.cloud is None else {self.cloud.name: sources.sha256_of(self.cloud)}
        common = self._common(settings, resolution)
        check_window(self.cloud or folder, common)
        target = folder / run.LOCAL_RECIPE
        return local_folder(target, self.pose, {**cloud, **sums}, common, has_map=True)

    def _common(
        self, settings: Settings, resolution: float, known: GlobalMap | None = None
    ) -> LocalCommon:
        options = self.options if self.cloud else replace(self.options, resolution=resolution)
        return LocalCommon(options, self.recipe, settings, known)
