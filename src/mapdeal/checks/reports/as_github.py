"""A report as workflow commands: annotations that GitHub shows beside the files."""

from __future__ import annotations

from mapdeal.checks.finding import Finding
from mapdeal.checks.reports.report import LintReport

_COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}


def github_lines(report: LintReport) -> list[str]:
    """Return a workflow command for each finding."""
    return [_annotation(found) for found in report.findings]


def _annotation(found: Finding) -> str:
    place = f"file={_escaped(found.file, more=True)}"
    if found.line is not None:
        place += f",line={found.line}"
    title = _escaped(found.check, more=True)
    return f"::{_COMMANDS[found.severity]} {place},title={title}::{_escaped(found.message)}"


def _escaped(text: str, *, more: bool = False) -> str:
    for mark, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(mark, code)
    return text.replace(":", "%3A").replace(",", "%2C") if more else text
