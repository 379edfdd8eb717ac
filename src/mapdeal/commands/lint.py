"""Lint on any number of maps, in this process or in several, by the rules of each project."""

from __future__ import annotations

import contextlib
from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mapdeal.checks.facts import PairFacts, RoomFacts, gather
from mapdeal.checks.findings import CHECKS, Finding
from mapdeal.checks.formats import LintReport, MapReport
from mapdeal.checks.lint import LEFT_OUT, checks_of, lint_file
from mapdeal.checks.map_checks import RUN_FOLDERS
from mapdeal.checks.repair import repaired, yaml_repair
from mapdeal.checks.selection import (
    IgnoreComment,
    LintConfig,
    Selection,
    find_lint_config,
    read_ignore_comments,
    read_lint_config,
    selection_of,
)
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealError,
    ParameterError,
    kept_warnings,
    refusal_of_the_system,
)
from mapdeal.files.budget import SHARE_OF_JOB
from mapdeal.files.source import (
    BIT_MAP,
    YAML,
    check_state,
    contents_of,
    exists,
    head_of,
    identity_of,
    is_folder,
    is_same_file,
    normal_path,
    real_path,
    state_of,
)
from mapdeal.files.transaction import Transaction
from mapdeal.files.yaml_text import edited, parse_mapping, read_mapping
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import reach_radius
from mapdeal.inputs.listing import MapListing, list_maps
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.map_server import image_places, write_map_image
from mapdeal.maps.map_yaml import MapMetadata, metadata_of
from mapdeal.maps.reading import MapFile, open_map, output_paths, write_grid
from mapdeal.pipeline.inputs import errors_named, outputs_of
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings
from mapdeal.ros.robot import CostmapName
from mapdeal.version import __version__

if TYPE_CHECKING:  # what only several processes need
    from mapdeal.pipeline.batch import Job

T = TypeVar("T")

_NOT_CHECKED = "lint.not-checked"
_NO_ACCESS = "file.access"

_LARGEST_PARAMETERS = 1 << 20
"""Bytes of a robot's parameter file."""

_CELLS_OF_ANY = 250_000
"""Cells that are checked in the time that a file takes, however small it is."""

_LOOKED_AT = 16
"""Maps of which the size is looked at; the others are taken to be like them."""

_CELLS_WORTH_WORKERS = 500_000_000
"""Checked in two or three seconds: of fewer, two processes save less than they take to start."""


@dataclass(frozen=True)
class LintRules:
    """Rules that decide which findings count."""

    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    strict: bool = False
    config: Path | None = None
    is_isolated: bool = False


class _Selections:
    """The selection for each map, every file of configuration read once."""

    def __init__(self, rules: LintRules) -> None:
        self._rules = rules
        self._of_folder: dict[Path, Selection] = {}
        self._of_source: dict[Path | None, Selection] = {}
        if rules.config is not None and rules.is_isolated:
            raise ParameterError("cannot be given together with --no-config", source="--config")
        self._config = None if rules.config is None else _read_config(rules.config)
        self._make(self._config)  # so that wrong names are told of before any work

    def of(self, path: Path) -> Selection:
        """Return the selection for a map, or for a folder."""
        folder = normal_path(path if is_folder(path) else path.parent)
        if folder not in self._of_folder:
            config = self._config
            if config is None and not self._rules.is_isolated:
                config = find_lint_config(folder)
            self._of_folder[folder] = self._make(config)
        return self._of_folder[folder]

    def _make(self, config: LintConfig | None) -> Selection:
        source = None if config is None else config.source
        if source not in self._of_source:
            rules = self._rules
            self._of_source[source] = selection_of(
                rules.select, rules.ignore, strict=rules.strict, config=config
            )
        return self._of_source[source]


def _read_config(path: Path) -> LintConfig:
    config = read_lint_config(path)
    if config is None:
        table = "[tool.mapdeal.lint]" if path.name == "pyproject.toml" else "[lint]"
        raise ParameterError(f"has no table {table}", source=path)
    return config


@dataclass(frozen=True)
class ParameterFiles:
    """A robot's parameter files, and what to look at in them."""

    paths: tuple[Path, ...]
    costmap: CostmapName | None = None
    namespace: str | None = None


@dataclass(frozen=True)
class _Found:
    """Findings and comments of a map before rules are applied."""

    findings: tuple[Finding, ...]
    comments: tuple[IgnoreComment, ...] = ()


def list_sources(
    names: Iterable[str], standard_input: Callable[[], Iterable[bytes]]
) -> MapListing:  # fmt: skip
    """Return the maps, and folders of runs, that names stand for; see `list_maps`."""
    return list_maps(names, None, standard_input, whole_folders=RUN_FOLDERS)


def lint_maps(
    paths: Sequence[Path],
    rules: LintRules,
    settings: Settings = DEFAULT_SETTINGS,
    *,
    parameters: ParameterFiles | None = None,
    footprint: Footprint | None = None,
    jobs: int = 1,
    done: Callable[[int], object] = lambda _: None,
) -> LintReport:
    selections = _Selections(rules)
    wanted = [selections.of(path) for path in paths]
    reports = [] if parameters is None else _reports_of(parameters, paths, selections, settings)
    radius = _radius_of(footprint, parameters) if paths else None
    of_robot = checks_of(RoomFacts)
    radii = {
        path: radius
        for path, selection in zip(paths, wanted, strict=True)
        if radius is not None and not selection.checks.isdisjoint(of_robot)
    }
    found: dict[int, _Found] = {}

    def take(index: int, one: _Found) -> None:
        found[index] = one
        done(1)

    if jobs > 1 and _are_worth_workers(paths, settings):
        _lint_in_processes(paths, settings, radii, min(jobs, len(paths)), take)
    else:
        for index, path in enumerate(paths):
            take(index, _lint_one(path, settings, radii.get(path)))
    for index, (path, selection) in enumerate(zip(paths, wanted, strict=True)):
        is_left_out = any(one.check == LEFT_OUT for one in found[index].findings)
        without = of_robot if is_left_out or path not in radii else ()
        findings, suppressed = selection.judged(
            path, found[index].findings, found[index].comments, without=without
        )
        reports.append(
            MapReport(str(path), findings, suppressed, selection.strict, is_folder(path))
        )
    return LintReport(tuple(reports), __version__)


def _radius_of(footprint: Footprint | None, parameters: ParameterFiles | None) -> float | None:
    """Return the inscribed radius of the robot whose shape, or whose files, are given."""
    if footprint is not None:
        return reach_radius(footprint)
    if parameters is None:
        return None
    from mapdeal.checks.parameter_checks import robot_in  # few calls look at any

    robot = robot_in(parameters.paths, costmap=parameters.costmap, namespace=parameters.namespace)
    return None if robot is None else reach_radius(robot.footprint)


def repair_maps(
    paths: Sequence[Path],
    rules: LintRules,
    settings: Settings = DEFAULT_SETTINGS,
    *,
    jobs: int = 1,
    done: Callable[[int], object] = lambda _: None,
) -> tuple[LintReport, list[MapdealError]]:
    """Repair maps in their own files; return what is left to be said of them."""
    # Only findings that count are mended: neither those of checks that are not wanted, nor
    # suppressed ones.

    before = lint_maps(paths, rules, settings, jobs=jobs, done=done)
    users: ImageUsers = {}
    reports, problems = list(before.maps), []
    for index, (path, one) in enumerate(zip(paths, before.maps, strict=True)):
        wanted = {found.check for found in one.findings}
        if one.is_folder or not wanted:
            continue
        try:
            repairs = repair_in_place(path, wanted, settings, users)
        except MapdealError as error:
            problems.append(error)
            continue
        if repairs:
            (after,) = lint_maps([path], rules, settings).maps
            reports[index] = replace(after, repairs=tuple(repairs))
    return replace(before, maps=tuple(reports)), problems


def _reports_of(
    parameters: ParameterFiles, maps: Sequence[Path], selections: _Selections, settings: Settings
) -> list[MapReport]:
    reports = []
    for path, findings in _lint_parameters(parameters, maps, settings).items():
        selection = selections.of(path)
        counted, suppressed = selection.judged(
            path, findings, read_ignore_comments(path, _LARGEST_PARAMETERS)
        )
        reports.append(
            MapReport(str(path), counted, suppressed, selection.strict, is_parameters=True)
        )
    return reports


def _lint_parameters(
    parameters: ParameterFiles, maps: Sequence[Path], settings: Settings
) -> dict[Path, list[Finding]]:
    from mapdeal.checks.parameter_checks import lint_parameters  # few calls look at any

    try:
        return lint_parameters(
            parameters.paths,
            costmap=parameters.costmap,
            namespace=parameters.namespace,
            map_resolutions=[
                (path.name, found)
                for path in maps
                if (found := _of_header(path, settings, lambda file: file.frame().resolution))
            ],
        )
    except FileAccessError as error:
        faulty = Path(error.source) if error.source is not None else parameters.paths[-1]
        text = str(error).removeprefix(f"{faulty}: ")
        finding = Finding(_NO_ACCESS, CHECKS[_NO_ACCESS].severity, str(faulty), text)
        return {path: [finding] if path == faulty else [] for path in parameters.paths}


def _of_header(path: Path, settings: Settings, take: Callable[[MapFile], T]) -> T | None:
    """Return what a function takes from the header of a map; None if there is none to read."""
    if is_folder(path):
        return None
    with (
        kept_warnings(),  # reading itself warns
        suppress(MapdealError),
        open_map(path, max_cells=settings.max_cells) as file,
    ):
        return take(file)
    return None


def _lint_one(path: Path, settings: Settings, radius: float | None = None) -> _Found:
    """Return what is found in a map, also if it cannot be checked."""
    try:
        findings = lint_file(path, max_cells=settings.max_cells, radius=radius)
    except MapdealError as error:
        return _not_checked(path, str(error))
    except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
        text = f"internal error: {type(problem).__name__}: {problem}; this is a bug in mapdeal"
        return _not_checked(path, str(refusal_of_the_system(problem) or text))
    has_comments = not is_folder(path) and path.suffix.lower() not in (".npz", BIT_MAP)
    comments = read_ignore_comments(path) if has_comments else []
    return _Found(tuple(findings), tuple(comments))


def _not_checked(path: Path, text: str) -> _Found:
    severity = CHECKS[_NOT_CHECKED].severity
    return _Found((Finding(_NOT_CHECKED, severity, str(path), text.removeprefix(f"{path}: ")),))


def _are_worth_workers(paths: Sequence[Path], settings: Settings) -> bool:
    """Return whether sharing maps out saves more time than starting processes takes."""
    if len(paths) < 2:
        return False
    cells = _CELLS_OF_ANY * len(paths)
    step = -(-len(paths) // _LOOKED_AT)  # to look at all of many small ones is what takes long
    for path in paths[::step]:
        if cells >= _CELLS_WORTH_WORKERS:
            return True
        height, width = _of_header(path, settings, lambda file: file.shape()) or (0, 0)
        cells += step * height * width
    return cells >= _CELLS_WORTH_WORKERS


def _lint_in_processes(
    paths: Sequence[Path],
    settings: Settings,
    radii: Mapping[Path, float],
    jobs: int,
    done: Callable[[int, _Found], None],
) -> None:
    from mapdeal.pipeline.batch import Job, Outcome, attempt, dispatch
    from mapdeal.pipeline.inputs import memory_budget
    from mapdeal.pipeline.workers import ProcessWorkers

    def take(index: int, outcome: Outcome) -> None:
        found = outcome.result
        if not isinstance(found, _Found):
            found = _not_checked(paths[index], str(found))
        elif any(SHARE_OF_JOB in one.message for one in found.findings):
            found = _lint_one(
                paths[index], settings, radii.get(paths[index])
            )  # alone it may have all of it
        done(index, found)

    work = _LintJob(
        replace(
            settings,
            max_memory=memory_budget(settings.max_memory, jobs),
            memory_is_chosen=settings.max_memory is not None,
        ),
        radii,
    )
    all_jobs = [Job(path, path, str(path), str(path)) for path in paths]
    dispatch(len(paths), all_jobs.__getitem__, partial(attempt, work), ProcessWorkers(jobs), take)


@dataclass(frozen=True)
class _LintJob:
    """Lint with its options, as it is sent to workers."""

    settings: Settings
    radii: Mapping[Path, float]

    def __call__(self, job: Job) -> _Found:
        with self.settings.memory(anew=True):
            return _lint_one(job.path, self.settings, self.radii.get(job.path))


ImageUsers = dict[Path, list[tuple[tuple[int, int], Path]]]
"""The images that the YAML files of a folder name, and those files: each folder is read once."""

_WRITTEN = (".pgm", ".png")
"""Formats of images that can be written as they were."""

_COPY = "mapdeal lint MAP --fix -o OUT writes a repaired copy"


def repair_file(path: Path, output: Path, options: Settings) -> list[str]:
    """Write a map without the traps that can be taken out of it; return what was changed."""
    outputs = output_paths(output)
    pair, cells, findings = gather(path, max_cells=options.max_cells)
    if cells is None:
        errors = (found.message for found in findings if found.severity == "error")
        rule = next(errors, "holds costs, which are not repaired")
        raise MalformedInputError(rule, source=path)
    inputs = [path, *([pair.path, pair.image_path] if pair is not None else [])]
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            grid, done = repaired(path, pair, max_cells=options.max_cells)
        write_grid(transaction, output, grid)
    if pair is not None:
        done += [found.message for found in findings if found.check == "yaml.nan-yaw"]
        done.append(f"image {outputs[0].name}, usual thresholds")
    return done


def repair_in_place(
    path: Path, wanted: Collection[str], settings: Settings, users: ImageUsers
) -> list[str]:
    """Repair a map in its own files; return what was changed, a line each."""
    # In the YAML file the values that are traps are replaced where they stand, so that comments,
    # order and other keys stay. The image is written only if the map is turned. It keeps its name
    # if it is a pgm or png of this map alone; else there is a new one, and the old one stays.
    states = {path: state_of(path)}  # before anything is read
    pair, cells, _ = gather(path, max_cells=settings.max_cells)
    if pair is None:
        return []
    repair = yaml_repair(pair, None if cells is None else cells.frame, wanted)
    if not repair:
        return []
    states[pair.image_path] = state_of(pair.image_path)
    values, done = dict(repair.values), list(repair.done)
    target = real_path(pair.path)
    outputs = [target]
    if repair.needs_cells:
        image, told = _image_for(pair, users)
        outputs.insert(0, image)
        done.append(told)
    with (
        use_threads(settings.threads),
        errors_named(pair.path),
        Transaction(outputs, force=True) as transaction,
    ):
        if repair.needs_cells:
            grid, told_of_cells = repaired(pair.path, pair, max_cells=settings.max_cells)
            done = [*told_of_cells, *done]
            new: dict[str, Any] = {
                "mode": write_map_image(transaction, image, grid),
                "resolution": grid.resolution,
                "origin": tuple(grid.origin),
                "negate": 0,
                "occupied_thresh": 0.65,
                "free_thresh": 0.196,
            }
            if image != real_path(pair.image_path):
                new["image"] = image.name
            values |= {key: one for key, one in new.items() if getattr(pair.metadata, key) != one}
        mark = head_of(pair.path, len(BOM_UTF8)) == BOM_UTF8
        data = (BOM_UTF8 if mark else b"") + edited(pair.entries, values)
        if _metadata_in(data, pair.path) != replace(pair.metadata, **values):
            rule = "its YAML is written in a way that cannot be edited"
            raise MalformedInputError(rule, source=pair.path, hint=_COPY)
        transaction.write_bytes(target, data)
        for one, state in states.items():
            check_state(one, state)
    return done


def _metadata_in(data: bytes, path: Path) -> MapMetadata | None:
    # warnings that stay are found again
    with kept_warnings(), contextlib.suppress(MalformedInputError):
        return metadata_of(parse_mapping(path, data), path)
    return None


def _image_for(pair: PairFacts, users: ImageUsers) -> tuple[Path, str]:
    """Return where the image of new cells goes, and what is said of that."""
    other = _other_user(pair, users)
    if other is None and pair.image_path.suffix in _WRITTEN:
        return real_path(pair.image_path), f"{pair.image_path.name} written anew"
    new = real_path(pair.path).with_suffix(".pgm")
    why = "whose format is only read" if other is None else f"which {other.name} also uses"
    if exists(new):
        rule = f"its image {pair.image_path.name}, {why}, would become {new.name}, which exists"
        raise FileAccessError(rule, source=pair.path, hint=_COPY)
    return new, f"{new.name} written beside {pair.image_path.name}, {why}"


def _other_user(pair: PairFacts, users: ImageUsers) -> Path | None:
    """Return a map beside the image, or beside this map, that uses the image, too."""
    identity = identity_of(pair.image_path)
    for folder in (pair.image_path.parent, pair.path.parent):
        if folder not in users:
            users[folder] = list(_images_of(folder))
        for named, path in users[folder]:
            if named == identity and not is_same_file(path, pair.path):
                return path
    return None


def _images_of(folder: Path) -> Iterator[tuple[tuple[int, int], Path]]:
    """Yield what images the YAML files in a folder name; who cannot be read names none."""
    try:
        _, names = contents_of(folder)
    except FileAccessError:
        return
    for path in (folder / name for name in names):
        if path.suffix.lower() not in YAML:
            continue
        with contextlib.suppress(MapdealError):
            entries = read_mapping(path)
            places = image_places(folder, entries["image"].text()) if "image" in entries else []
            if identity := next(filter(None, map(identity_of, places)), None):
                yield identity, path
