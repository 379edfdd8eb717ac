"""A report for people: a line a finding, and a sum."""

from __future__ import annotations

from mapdeal.checks.finding import Finding
from mapdeal.checks.reports.report import LintReport
from mapdeal.errors import one_line


def text_lines(report: LintReport) -> list[str]:
    """Return what was repaired and what was found, as a compiler would say it."""
    lines = []
    for one in report.maps:
        lines += [one_line(f"{one.file}: repaired: {told}") for told in one.repairs]
        lines += [line_of(found) for found in one.findings]
    return lines


def line_of(found: Finding) -> str:
    """Return a finding as one line."""
    place = found.file if found.line is None else f"{found.file}:{found.line}"
    return one_line(f"{place}: {found.severity}: {found.check}: {found.message}")


def sum_of(report: LintReport) -> str:
    """Return how many maps there were, and how much was found."""
    folders = sum(one.is_folder for one in report.maps)
    maps = len(report.maps) - folders
    kinds = [_counted(maps, "map")] if maps or not folders else []
    kinds += [_counted(folders, "folder")] if folders else []
    parts = [_counted(count, severity) for severity, count in report.counts.items()]
    if report.suppressed:
        parts.append(f"{report.suppressed} suppressed")
    repaired = sum(bool(one.repairs) for one in report.maps)
    if repaired:
        parts.append(f"{repaired} repaired")
    return f"{', '.join(kinds)}: {', '.join(parts)}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"
