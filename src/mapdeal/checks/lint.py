"""All checks on one file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mapdeal.checks import image_checks, map_checks, yaml_checks
from mapdeal.checks.facts import GridFacts, PairFacts, gather
from mapdeal.checks.finding import CHECKS, SEVERITIES, Check, Finding, Told
from mapdeal.checks.run_checks import lint_run

_OF_CELLS = map_checks.__name__
_MODULES = (yaml_checks, image_checks, map_checks)  # importing them lists their checks


def lint_file(path: Path, *, max_cells: int | None = None) -> list[Finding]:
    """Return what all checks find in a map or a folder of outputs, the worst first.

    Parameters
    ----------
    path : Path
        A map_server YAML, an npz, or a folder that a run has written.
    max_cells : int, optional
        Cells up to which an image is read.
    """
    if path.is_dir():
        return lint_run(path)
    pair, cells, findings = gather(path, max_cells=max_cells)
    for one in CHECKS.values():
        if one.run is None:
            continue
        facts: PairFacts | GridFacts | None = cells if one.run.__module__ == _OF_CELLS else pair
        if facts is not None:
            findings += _findings_of(one, facts, path, pair)
    return sorted(dict.fromkeys(findings), key=lambda found: SEVERITIES.index(found.severity))


def _findings_of(
    one: Check, facts: Any, path: Path, pair: PairFacts | None
) -> Iterator[Finding]:  # fmt: skip
    for told in one.run(facts) if one.run is not None else ():
        said = told if isinstance(told, Told) else Told(told)
        line = None
        if said.key is not None and pair is not None and said.key in pair.entries:
            line = pair.entries[said.key].node.start_mark.line + 1
        yield Finding(one.name, one.severity, str(path), said.message, line)
