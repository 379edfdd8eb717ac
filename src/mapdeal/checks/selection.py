"""Which checks are asked for, and bounds that a map must keep."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from numbers import Real
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.findings import CHECKS, SEVERITIES, Finding, Severity
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.files.source import exists, normal_path, read_file
from mapdeal.files.yaml_text import OF_MAPS
from mapdeal.grid.frame import MOST_CELLS, Frame, Region, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import sampled
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.dilation import within_distance

OWN_FILE, PYPROJECT = "mapdeal.toml", "pyproject.toml"

_LARGEST = 1 << 20
_SEVERITIES = ("error", "warning", "note")

_IGNORE = re.compile(r"(?:^|(?<=\s))#[ \t]{0,9}mapdeal:[ \t]{0,9}ignore(?![\w-]):?")
_NAME = re.compile(r"[ \t]*([\w.-]+)[ \t]*")

Names = tuple[str, ...]


@dataclass(frozen=True)
class LintConfig:
    source: Path
    table: str
    select: Names | None = None
    ignore: Names | None = None
    strict: bool = False
    per_file_ignores: tuple[tuple[str, Names], ...] = field(default=())
    severity: tuple[tuple[str, str], ...] = field(default=())


def find_lint_config(folder: Path) -> LintConfig | None:
    """Return what the nearest file says, in a folder or one above it; None if there is none."""
    # A ``mapdeal.toml`` comes before a ``pyproject.toml`` beside it; one of the latter without the
    # table ``[tool.mapdeal.lint]`` is passed over.
    start = normal_path(folder)
    for place in (start, *start.parents):
        if exists(place / OWN_FILE):
            return read_lint_config(place / OWN_FILE) or LintConfig(place / OWN_FILE, "lint")
        if exists(place / PYPROJECT):
            found = read_lint_config(place / PYPROJECT)
            if found is not None:
                return found
    return None


def read_lint_config(path: Path) -> LintConfig | None:
    """Return what a file says of lint; None if it has no such table."""
    document = _document_of(path)
    if path.name == PYPROJECT:
        tool = document.get("tool", {})
        ours = tool.get("mapdeal", {}) if isinstance(tool, dict) else {}
        table, ours_at = "tool.mapdeal.lint", "tool.mapdeal."
    else:
        ours, table, ours_at = document, "lint", ""
    if not isinstance(ours, dict):
        raise ParameterError("must be a table", source=path, place="tool.mapdeal", got=ours)
    _check_keys(ours, ("lint",), path, ours_at)
    if "lint" not in ours:
        return None
    entries = ours["lint"]
    if not isinstance(entries, dict):
        raise ParameterError("must be a table", source=path, place=table, got=entries)
    _check_keys(entries, tuple(_KEYS), path, f"{table}.")
    values = {
        name: _KEYS[key](entries[key], path, f"{table}.{key}")
        for key, name in ((key, key.replace("-", "_")) for key in entries)
    }
    return LintConfig(path, table, **values)


def _document_of(path: Path) -> dict[str, Any]:
    import tomllib

    data = read_file(path, limit=_LARGEST)
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    except RecursionError:
        raise MalformedInputError("not valid TOML: nested too deeply", source=path) from None
    except ValueError as error:  # of tomllib, or numbers of many thousand digits
        raise MalformedInputError(f"not valid TOML: {error}", source=path) from None


def _check_keys(
    table: Mapping[str, Any], known: Iterable[str], path: Path, prefix: str
) -> None:  # fmt: skip
    for key in table:
        if key not in known:
            import difflib

            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(known)}"
            if key in _KEYS:  # of the table that it stands above
                hint = f"it belongs in the table [{prefix}lint]"
            raise ParameterError("unknown key", source=path, place=f"{prefix}{key}", hint=hint)


def _names(value: Any, path: Path, place: str) -> Names:
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise ParameterError("must be a list of names", source=path, place=place, got=value)
    return tuple(value)


def _flag(value: Any, path: Path, place: str) -> bool:
    if not isinstance(value, bool):
        raise ParameterError("must be true or false", source=path, place=place, got=value)
    return value


def _per_file(value: Any, path: Path, place: str) -> tuple[tuple[str, Names], ...]:
    if not isinstance(value, dict):
        rule = "must be a table of patterns and lists of names"
        raise ParameterError(rule, source=path, place=place, got=value)
    return tuple(
        (pattern, _names(names, path, f'{place}."{pattern}"')) for pattern, names in value.items()
    )


def _severity(value: Any, path: Path, place: str) -> tuple[tuple[str, str], ...]:
    if not isinstance(value, dict):
        raise ParameterError("must be a table of names", source=path, place=place, got=value)
    for name, severity in value.items():
        if severity not in _SEVERITIES:
            rule = f"must be {', '.join(_SEVERITIES[:-1])} or {_SEVERITIES[-1]}"
            raise ParameterError(rule, source=path, place=f'{place}."{name}"', got=severity)
    return tuple(value.items())


_KEYS: dict[str, Callable[[Any, Path, str], Any]] = {
    "select": _names,
    "ignore": _names,
    "strict": _flag,
    "per-file-ignores": _per_file,
    "severity": _severity,
}
"""Reader of the value of each key."""


@dataclass(frozen=True)
class IgnoreComment:
    """A comment ``# mapdeal: ignore ID[, ID]``."""

    line: int
    names: Names


def read_ignore_comments(path: Path, limit: int = OF_MAPS.bytes) -> list[IgnoreComment]:
    """Return the comments of a file that name checks of lint which are to be ignored."""
    # A comment is recognised by its text, at the beginning of a line or behind white space. So it
    # counts in a file, too, that is no YAML.
    try:
        data = read_file(path, limit=limit)
    except (FileAccessError, MalformedInputError):
        return []
    lines = data.decode("utf-8-sig", "replace").splitlines()
    found = ((number, line, _IGNORE.search(line)) for number, line in enumerate(lines, start=1))
    return [IgnoreComment(number, _listed(line[one.end() :])) for number, line, one in found if one]


def _listed(text: str) -> Names:
    names = []
    for part in text.split(","):
        name = _NAME.match(part)
        names += [name[1]] if name else []
        if not name or name.end() < len(part):
            break
    return tuple(names)


STATES = ("occupied", "free", "unknown", "between")
"""States of a cell; ``between`` stands for the values 1..99."""

SYMMETRIES: dict[str, Callable[[NDArray[np.int8]], NDArray[np.int8]]] = {
    "mirrored upside down": np.flipud,
    "mirrored left to right": np.fliplr,
    "turned by 180 degrees": lambda cells: cells[::-1, ::-1],
    "turned by 90 degrees": np.rot90,
    "turned by -90 degrees": lambda cells: np.rot90(cells, -1),
    "transposed": np.transpose,
    "transposed and turned by 180 degrees": lambda cells: cells.T[::-1, ::-1],
}
"""Ways in which the cells of a map are often confused."""

# What a cell of the comparison shows; where cells share a pixel the largest does.
OUTSIDE, BOTH_UNKNOWN, BOTH_FREE, CHANGED, COMMON, REMOVED, ADDED = range(7)

_MOST_TOLERANCE = 1000.0


@dataclass(frozen=True)
class WallShift:
    """Distances from the obstacles of one map to the nearest of the other, metres."""

    largest: float
    percentile_95: float
    mean: float


@dataclass(frozen=True, eq=False)
class Difference:
    """Differences between two maps."""

    geometry: dict[str, tuple[Any, Any]]
    common: int
    confusion: NDArray[np.int64]
    differing: int
    beyond: int
    not_compared: int
    walls: tuple[WallShift | None, WallShift | None]
    symmetry: str | None
    frame: Frame
    changes: NDArray[np.uint8]

    @property
    def is_equal(self) -> bool:
        """Whether the maps have the same geometry and cells, within the tolerance."""
        return not self.geometry and self.beyond == 0


def compare(first: OccupancyGrid, second: OccupancyGrid, *, tolerance: float = 0.0) -> Difference:
    if not 0 <= tolerance <= _MOST_TOLERANCE:  # refuses nan too
        rule = f"must be 0 to {_MOST_TOLERANCE:g} cells"
        raise ParameterError(rule, place="tolerance", got=tolerance)
    frame = frame_around(first.frame, second.frame)
    a, in_a = sampled(frame, first.occupancy, first.frame)
    b, in_b = sampled(frame, second.occupancy, second.frame)
    both = in_a & in_b
    state_a, state_b = states_of(a), states_of(b)
    confusion = confusion_of(state_a[both], state_b[both])
    differs = both & (a != b)
    beyond = differs.copy()
    if tolerance > 0:
        beyond &= _is_beyond(state_a, state_b, both, math.floor(tolerance**2))
    return Difference(
        _geometry(first, second), int(np.count_nonzero(both)), confusion,
        int(np.count_nonzero(differs)), int(np.count_nonzero(beyond)),
        int(np.count_nonzero(first.occupancy >= 0) - np.count_nonzero(both & (a >= 0))),
        _wall_shifts(first, second, frame, (a == OCCUPIED) & both, (b == OCCUPIED) & both),
        _better_symmetry(first.occupancy, second.occupancy), frame,
        changes_of(state_a, state_b, both),
    )  # fmt: skip


def states_of(values: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the states of cells, as indices into `STATES`."""
    table = np.full(256, STATES.index("between"), dtype=np.uint8)
    table[OCCUPIED] = STATES.index("occupied")
    table[0] = STATES.index("free")
    table[128:] = STATES.index("unknown")
    return table[values.view(np.uint8)]


def confusion_of(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the number of cells by state in one map (rows) and in the other, shape (4, 4)."""
    pairs = first.ravel().astype(np.int64) * len(STATES) + second.ravel()
    return np.bincount(pairs, minlength=len(STATES) ** 2).reshape(len(STATES), -1)


def frame_around(first: Frame, second: Frame) -> Frame:
    """Return the cells of the first lattice that both maps lie in."""
    other = region_around(first, second)
    row, col = min(other.row, 0), min(other.col, 0)
    height = max(other.row + other.height, first.height) - row
    width = max(other.col + other.width, first.width) - col
    if height * width > MOST_CELLS:
        rule = f"the maps lie too far apart: {width} x {height} cells hold both"
        raise ParameterError(rule, place="origin")
    return Region(row, col, height, width).frame_in(first)


def _is_beyond(
    first: NDArray[np.uint8], second: NDArray[np.uint8], both: NDArray[np.bool_], square: int
) -> NDArray[np.bool_]:
    """Return cells of which one of the maps has no like within a distance in the other."""
    beyond = np.zeros(both.shape, dtype=np.bool_)
    for state in range(len(STATES)):
        of_first, of_second = (first == state) & both, (second == state) & both
        for own, other in ((of_first, of_second), (of_second, of_first)):
            if own.any():
                beyond |= own & ~within_distance(other, square)
    return beyond


def _geometry(first: OccupancyGrid, second: OccupancyGrid) -> dict[str, tuple[Any, Any]]:
    pairs = {
        "width": (first.shape[1], second.shape[1]),
        "height": (first.shape[0], second.shape[0]),
        "resolution": (first.resolution, second.resolution),
        "origin": (list(first.origin), list(second.origin)),
    }
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _better_symmetry(first: NDArray[np.int8], second: NDArray[np.int8]) -> str | None:
    """Return the symmetry that makes at least half of the differing cells agree, if any."""
    if first.shape not in (second.shape, second.shape[::-1]):
        return None
    as_it_is = int((first == second).sum()) if first.shape == second.shape else 0
    best, most = None, as_it_is + (first.size - as_it_is) // 2
    for name, turn in SYMMETRIES.items():
        turned = turn(second)
        if turned.shape == first.shape:
            agreeing = int((first == turned).sum())
            if agreeing > most:
                best, most = name, agreeing
    return best


def _wall_shifts(
    first: OccupancyGrid, second: OccupancyGrid, frame: Frame, walls_a: NDArray[np.bool_],
    walls_b: NDArray[np.bool_],
) -> tuple[WallShift | None, WallShift | None]:  # fmt: skip
    points = [grid.frame.xy_from_rowcol(np.argwhere(grid.occupied())) for grid in (first, second)]
    common = [frame.xy_from_rowcol(np.argwhere(walls)) for walls in (walls_a, walls_b)]
    return _shift(common[0], points[1]), _shift(common[1], points[0])


def _shift(walls: NDArray[np.float64], others: NDArray[np.float64]) -> WallShift | None:
    if not len(walls) or not len(others):
        return None
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(others).query(walls)
    clean = np.where(distance < 1e-9, 0.0, distance)
    return WallShift(float(clean.max()), float(np.percentile(clean, 95)), float(clean.mean()))


def changes_of(
    first: NDArray[np.uint8], second: NDArray[np.uint8], both: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Return what each cell shows, `OUTSIDE` to `ADDED`, given its states and if both have it."""
    occupied, unknown = STATES.index("occupied"), STATES.index("unknown")
    changes = np.where(first == second, np.uint8(BOTH_FREE), np.uint8(CHANGED))
    changes[(first == unknown) & (second == unknown)] = BOTH_UNKNOWN
    changes[(first == occupied) & (second == occupied)] = COMMON
    changes[(first == occupied) & (second != occupied)] = REMOVED
    changes[(first != occupied) & (second == occupied)] = ADDED
    changes[~both] = OUTSIDE
    return changes


UNUSED = "lint.unused-ignore"
EVERYTHING = "all"


@dataclass(frozen=True)
class Selection:
    """Selection of the findings that count, and their severities."""

    checks: frozenset[str]
    strict: bool = False
    folder: Path | None = None
    per_file: tuple[tuple[str, frozenset[str]], ...] = ()
    severity: Mapping[str, Severity] = field(default_factory=dict)

    def judged(
        self, file: Path, findings: Iterable[Finding], comments: Sequence[IgnoreComment] = (), *,
        without: Iterable[str] = (),
    ) -> tuple[tuple[Finding, ...], int]:  # fmt: skip
        """Return the findings of a map that count, the worst first, and how many were suppressed.

        Notes
        -----
        Suppressed are findings of checks that are wanted, by a comment or a pattern. A comment
        that ignores nothing is a finding itself, which no comment ignores.
        """
        findings = list(findings)
        spared = self._spared(file)
        wanted = [found for found in findings if found.check in self.checks]
        ignored = {name for one in comments for text in one.names for name in _matching(text)}
        ignored.discard(UNUSED)
        kept = [found for found in wanted if found.check not in ignored | spared]
        unused = []
        if UNUSED in self.checks - spared:
            unused = list(_unused(file, comments, {*without, *(found.check for found in findings)}))
        weighed = [
            replace(found, severity=self.severity.get(found.check, found.severity))
            for found in [*kept, *unused]
        ]
        weighed.sort(key=lambda found: SEVERITIES.index(found.severity))
        return tuple(weighed), len(wanted) - len(kept)

    def _spared(self, file: Path) -> frozenset[str]:
        if not self.per_file or self.folder is None:
            return frozenset()
        path, folder = normal_path(file), normal_path(self.folder)
        if folder not in path.parents:
            return frozenset()
        below = PurePosixPath(path.relative_to(folder).as_posix())
        names = [path.name, *map(str, (below, *below.parents[:-1]))]
        matching = (
            checks
            for pattern, checks in self.per_file
            if any(fnmatchcase(name, pattern.removesuffix("/")) for name in names)
        )
        return frozenset().union(*matching)


def selection_of(
    select: Sequence[str] = (), ignore: Sequence[str] = (), *, strict: bool = False,
    config: LintConfig | None = None,
) -> Selection:  # fmt: skip
    everything = frozenset(CHECKS)
    checks = everything
    per_file: tuple[tuple[str, frozenset[str]], ...] = ()
    severity: dict[str, Severity] = {}
    if config is not None:
        source, table = config.source, config.table
        checks = _chosen(
            checks,
            _ranked(config.select or (), source, f"{table}.select"),
            _ranked(config.ignore or (), source, f"{table}.ignore"),
            selects=config.select is not None,
        )
        per_file = tuple(
            (pattern, frozenset(_ranked(names, source, f'{table}.per-file-ignores."{pattern}"')))
            for pattern, names in config.per_file_ignores
        )
        ranks: dict[str, int] = {}
        for text, level in config.severity:
            for name, rank in _ranked([text], source, f"{table}.severity").items():
                if rank >= ranks.get(name, 0):
                    ranks[name] = rank
                    severity[name] = level  # type: ignore[assignment]
    checks = _chosen(
        checks, _ranked(select, "--select"), _ranked(ignore, "--ignore"), selects=bool(select)
    )
    return Selection(
        checks, strict=strict or (config is not None and config.strict),
        folder=None if config is None else config.source.parent, per_file=per_file,
        severity=severity,
    )  # fmt: skip


def _chosen(
    before: frozenset[str], select: Mapping[str, int], ignore: Mapping[str, int], *, selects: bool
) -> frozenset[str]:
    """Return checks after a choice, given how precisely each is selected and ignored."""
    ranks = select if selects else dict.fromkeys(before, -1)
    return frozenset(name for name, rank in ranks.items() if rank > ignore.get(name, -2))


def _ranked(names: Iterable[str], source: Path | str, place: str | None = None) -> dict[str, int]:
    """Return how precisely each check is named, at best: 0 by all, 1 by its area, 2 by itself."""
    ranks: dict[str, int] = {}
    for text in names:
        matching = _matching(text)
        if not matching:
            raise ParameterError(
                "unknown check", source=source, place=place, got=text, hint=hint_for(text)
            )
        for name, rank in matching.items():
            ranks[name] = max(rank, ranks.get(name, 0))
    return ranks


def _matching(text: str) -> dict[str, int]:
    """Return the checks that a name stands for, and how precisely; none of one that is none."""
    if text in CHECKS:
        return {text: 2}
    if text.lower() == EVERYTHING:
        return dict.fromkeys(CHECKS, 0)
    area = text.removesuffix(".")
    return dict.fromkeys((name for name in CHECKS if name.partition(".")[0] == area), 1)


def hint_for(text: str) -> str:
    """Return which check, or area of checks, a name may be meant to be."""
    import difflib

    areas = dict.fromkeys(name.partition(".")[0] for name in CHECKS)
    near = difflib.get_close_matches(text.lower(), [*CHECKS, *areas], n=1)
    if not near:  # a check's name without its area
        near = [name for name in CHECKS if name.partition(".")[2] == text.lower()][:1]
    return f"did you mean {near[0]}?" if near else f"areas are {', '.join(areas)}"


def _unused(file: Path, comments: Iterable[IgnoreComment], found: set[str]) -> Iterator[Finding]:
    """Yield what is wrong with comments, given the checks that have found something."""
    for comment in comments:
        messages = [] if comment.names else ["names no check: write # mapdeal: ignore AREA.NAME"]
        for text in comment.names:
            matching = _matching(text)
            if not matching:
                messages.append(f"unknown check {text}; {hint_for(text)}")
            elif found.isdisjoint(matching) or text == UNUSED:
                messages.append(f"{text} ignores nothing here")
        for message in messages:
            yield Finding(UNUSED, CHECKS[UNUSED].severity, str(file), message, comment.line)


_ROUNDING = 1e-9
"""Of distances: six cells of 0.05 m are 0.30000000000000004 m."""


@dataclass(frozen=True)
class Bound:
    """Bound on the difference between two maps, and the value found.

    Parameters
    ----------
    name : str
        Option that sets the bound, without the leading dashes.
    unit : str
        Unit of both values.
    allowed : float
        Largest value allowed.
    found : float
        Value found; infinite if one map has obstacles to compare and the other has none, nan if
        the maps have no common cell.
    """

    name: str
    unit: str
    allowed: float
    found: float

    @property
    def holds(self) -> bool:
        """Whether the value found is within the bound, allowing for floating-point rounding."""
        return self.found <= self.allowed * (1 + _ROUNDING)  # never true of nan


@dataclass(frozen=True)
class Bounds:
    """Bounds on the difference between two maps."""

    max_shift: float | None = None
    max_differing: float | None = None

    def __post_init__(self) -> None:
        if self.max_shift is not None and not _lies_in(self.max_shift, 0, sys.float_info.max):
            rule = "must be a finite number of metres, 0 or more"
            raise ParameterError(rule, place="max_shift", got=self.max_shift)
        if self.max_differing is not None and not _lies_in(self.max_differing, 0, 100):
            rule = "must be 0 to 100 percent"
            raise ParameterError(rule, place="max_differing", got=self.max_differing)

    def __bool__(self) -> bool:
        return self.max_shift is not None or self.max_differing is not None

    def judged(self, found: Difference) -> tuple[Bound, ...]:
        # Only the common area is judged, whatever the geometry of the maps.
        bounds = []
        if self.max_shift is not None:
            bounds.append(Bound("max-shift", "m", self.max_shift, largest_shift(found)))
        if self.max_differing is not None:
            share = 100 * found.beyond / found.common if found.common else math.nan
            bounds.append(Bound("max-differing", "%", self.max_differing, share))
        return tuple(bounds)


def largest_shift(found: Difference) -> float:
    """Return the largest distance of an obstacle of either map from those of the other, metres."""
    # Infinite if only one of the maps has obstacles, nan if they have no common cell.
    if not found.common:
        return math.nan
    occupied = STATES.index("occupied")
    in_common = np.array([found.confusion[occupied].sum(), found.confusion[:, occupied].sum()])
    shifts = [
        0.0 if not count else math.inf if shift is None else shift.largest
        for count, shift in zip(in_common, found.walls, strict=True)
    ]
    return max(shifts)


def _lies_in(number: object, lowest: float, highest: float) -> bool:
    return isinstance(number, Real) and lowest <= float(number) <= highest
