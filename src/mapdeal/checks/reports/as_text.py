"""A report for people: a line a finding, and a sum."""

from __future__ import annotations

from mapdeal.checks.finding import Finding
from mapdeal.checks.reports.report import LintReport
from mapdeal.errors import one_line


def text_lines(report: LintReport) -> list[str]:
    """Return what was repaired and what was found, as a compiler would say it."""
    return [*repair_lines(report), *map(line_of, report.findings)]


def repair_lines(report: LintReport) -> list[str]:
    """Return what was changed in the files of maps."""
    return [
        one_line(f"{one.file}: repaired: {told}") for one in report.maps for told in one.repairs
    ]


def line_of(found: Finding) -> str:
    """Return a finding as one line."""
    return str(found)


def sum_of(report: LintReport) -> str:
    """Return how many maps there were, and how much was found."""
    return report.summary()
