"""All forms of a report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from mapdeal.checks.reports.as_github import github_lines
from mapdeal.checks.reports.as_json import json_lines
from mapdeal.checks.reports.as_junit import junit_lines
from mapdeal.checks.reports.as_sarif import sarif_lines
from mapdeal.checks.reports.as_text import text_lines
from mapdeal.checks.reports.report import LintReport

ReportForm = Literal["text", "json", "github", "sarif", "junit"]

REPORTS: dict[ReportForm, Callable[[LintReport], list[str]]] = {
    "text": text_lines,
    "json": json_lines,
    "github": github_lines,
    "sarif": sarif_lines,
    "junit": junit_lines,
}
"""Functions that make the lines of a report, by format name on the command line."""
