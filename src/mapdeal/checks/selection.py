"""Which checks are asked for, and bounds that a map must keep."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from fnmatch import fnmatchcase
from numbers import Real
from pathlib import Path, PurePosixPath

import numpy as np

from mapdeal.checks.difference import STATES, Difference
from mapdeal.checks.finding import CHECKS, SEVERITIES, Finding, Severity
from mapdeal.errors import ParameterError
from mapdeal.formats.lint_config import IgnoreComment, LintConfig
from mapdeal.formats.source import normal_path
from mapdeal.records import dataclass

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
