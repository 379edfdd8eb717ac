"""All checks on one file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

# The modules of checks: importing one adds its checks to the list.
from mapdeal.checks import map_checks as map_checks
from mapdeal.checks import parameter_checks as parameter_checks
from mapdeal.checks.facts import PairFacts, RoomFacts, gather, gather_rooms
from mapdeal.checks.findings import CHECKS, SEVERITIES, Check, Finding, Remark, declare_check
from mapdeal.checks.map_checks import lint_run
from mapdeal.errors import MalformedInputError
from mapdeal.files.source import is_folder

LEFT_OUT = "lint.left-out"

declare_check(LEFT_OUT, "note", "a check that takes more memory than it may was left out")


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
            findings.append(Finding(LEFT_OUT, CHECKS[LEFT_OUT].severity, str(path), text))
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
