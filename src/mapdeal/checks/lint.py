"""All checks on one map, or on a robot's parameter files, whatever befalls them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The modules of checks: importing one adds its checks to the list.
from mapdeal.checks import map_checks as map_checks
from mapdeal.checks.facts import PairFacts, RoomFacts, gather, gather_rooms
from mapdeal.checks.findings import CHECKS, SEVERITIES, Check, Finding, Remark, declare_check
from mapdeal.checks.map_checks import lint_run
from mapdeal.checks.parameter_checks import lint_parameters
from mapdeal.checks.selection import IgnoreComment, read_ignore_comments
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealError,
    refusal_of_the_system,
)
from mapdeal.files.source import BIT_MAP, is_folder
from mapdeal.ros.robot import CostmapName

LEFT_OUT = "lint.left-out"

declare_check(LEFT_OUT, "note", "a check that takes more memory than it may was left out")

_LARGEST_PARAMETERS = 1 << 20
"""Bytes of a robot's parameter file."""


def lint_file(
    path: Path, *, max_cells: int | None = None, radius: float | None = None
) -> list[Finding]:
    """Return what all checks find in a map or a folder of outputs, the worst first."""
    if is_folder(path):
        return lint_run(path)
    pair, cells, findings = gather(path, max_cells=max_cells)
    path = path if pair is None else pair.path
    facts_by_type: dict[type, Any] = {
        type(facts): facts for facts in (pair, cells) if facts is not None
    }
    if radius is not None and cells is not None:
        try:
            facts_by_type[RoomFacts] = gather_rooms(path, radius, max_cells=max_cells)
        except MalformedInputError as error:  # which reading by strips is not: there is too little
            text = f"{', '.join(checks_of(RoomFacts))}: {error.rule}"
            findings.append(_finding(LEFT_OUT, path, text))
    for check in CHECKS.values():
        if check.facts in facts_by_type:
            findings += _findings_of(check, facts_by_type[check.facts], path, pair)
    return sorted(dict.fromkeys(findings), key=lambda found: SEVERITIES.index(found.severity))


def checks_of(facts: type) -> list[str]:
    return [check.name for check in CHECKS.values() if check.facts is facts]


def _findings_of(check: Check, facts: Any, path: Path, pair: PairFacts | None) -> Iterator[Finding]:
    for found in check.run(facts) if check.run is not None else ():
        remark = found if isinstance(found, Remark) else Remark(found)
        line = None
        if remark.key is not None and pair is not None and remark.key in pair.entries:
            line = pair.entries[remark.key].node.start_mark.line + 1
        yield Finding(check.name, check.severity, str(path), remark.message, line, remark.places)


def _finding(name: str, path: Path, text: str) -> Finding:
    return Finding(name, CHECKS[name].severity, str(path), text.removeprefix(f"{path}: "))


@dataclass(frozen=True)
class Found:
    """Findings and comments of a file before rules are applied."""

    findings: tuple[Finding, ...]
    comments: tuple[IgnoreComment, ...] = ()


def found_in(path: Path, max_cells: int | None, radius: float | None = None) -> Found:
    """Return what is found in a map, also if it cannot be checked."""
    try:
        findings = lint_file(path, max_cells=max_cells, radius=radius)
    except MapdealError as error:
        return not_checked(path, str(error))
    except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
        text = f"internal error: {type(problem).__name__}: {problem}; this is a bug in mapdeal"
        return not_checked(path, str(refusal_of_the_system(problem) or text))
    has_comments = not is_folder(path) and path.suffix.lower() not in (".npz", BIT_MAP)
    return Found(tuple(findings), tuple(read_ignore_comments(path) if has_comments else ()))


def not_checked(path: Path, text: str) -> Found:
    return Found((_finding("lint.not-checked", path, text),))


def found_in_parameters(
    paths: Sequence[Path], costmap: CostmapName | None, namespace: str | None,
    map_resolutions: Sequence[tuple[str, float]],
) -> dict[Path, Found]:  # fmt: skip
    """Return what is found in a robot's parameter files, beside maps of some resolutions."""
    try:
        found = lint_parameters(
            paths, costmap=costmap, namespace=namespace, map_resolutions=map_resolutions
        )
    except FileAccessError as error:
        faulty = Path(error.source) if error.source is not None else paths[-1]
        finding = _finding("file.access", faulty, str(error))
        found = {path: [finding] if path == faulty else [] for path in paths}
    return {
        path: Found(tuple(findings), tuple(read_ignore_comments(path, _LARGEST_PARAMETERS)))
        for path, findings in found.items()
    }
