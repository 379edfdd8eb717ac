"""All checks on one file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

# The modules of checks: importing one adds its checks to the list.
from mapdeal.checks import (  # noqa: F401
    image_checks,
    layer_checks,
    map_checks,
    parameter_problems,
    robot_checks,
    yaml_checks,
)
from mapdeal.checks.facts import PairFacts, gather
from mapdeal.checks.finding import CHECKS, SEVERITIES, Check, Finding, Remark
from mapdeal.checks.run_checks import lint_run
from mapdeal.formats.source import is_folder


def lint_file(path: Path, *, max_cells: int | None = None) -> list[Finding]:
    """Return what all checks find in a map or a folder of outputs, the worst first.

    Parameters
    ----------
    path : Path
        A map_server YAML, a ``.pbm``, which stands for the YAML beside it, an npz, or a folder
        that a run has written.
    max_cells : int, optional
        Cells up to which an image is read.
    """
    if is_folder(path):
        return lint_run(path)
    pair, cells, findings = gather(path, max_cells=max_cells)
    path = path if pair is None else pair.path
    facts_by_type = {type(facts): facts for facts in (pair, cells) if facts is not None}
    for check in CHECKS.values():
        if check.facts in facts_by_type:
            findings += _findings_of(check, facts_by_type[check.facts], path, pair)
    return sorted(dict.fromkeys(findings), key=lambda found: SEVERITIES.index(found.severity))


def _findings_of(check: Check, facts: Any, path: Path, pair: PairFacts | None) -> Iterator[Finding]:
    for found in check.run(facts) if check.run is not None else ():
        remark = found if isinstance(found, Remark) else Remark(found)
        line = None
        if remark.key is not None and pair is not None and remark.key in pair.entries:
            line = pair.entries[remark.key].node.start_mark.line + 1
        yield Finding(check.name, check.severity, str(path), remark.message, line)
