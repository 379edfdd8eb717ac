"""A report as JUnit XML: a test case a map, which fails if its findings make the exit code 1."""

from __future__ import annotations

from html import escape  # of the same marks; xml.sax takes ten times as long to import
from pathlib import PurePath

from mapdeal.checks.reports.as_text import line_of
from mapdeal.checks.reports.report import LintReport, MapReport
from mapdeal.errors import one_line


def junit_lines(report: LintReport) -> list[str]:
    """Return one suite of the maps.

    Notes
    -----
    A failing map has one failure, whose text lists all that makes it fail, since some readers
    show no more than the first; what else was found is its output. Times are left out, so that
    equal maps give equal bytes.
    """
    failing = sum(bool(one.failures) for one in report.maps)
    counts = f'tests="{len(report.maps)}" failures="{failing}" errors="0"'
    cases = [line for one in report.maps for line in _case(one)]
    return [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<testsuites name="mapdeal lint" {counts}>',
        f'  <testsuite name="mapdeal lint" {counts} skipped="0">',
        *cases,
        "  </testsuite>",
        "</testsuites>",
    ]


def _case(one: MapReport) -> list[str]:
    path = PurePath(one.file)
    name = f"name={_attribute(path.name or one.file)} classname={_attribute(str(path.parent))}"
    others = [found for found in one.findings if found not in one.failures]
    if not one.findings:
        return [f"    <testcase {name}/>"]
    lines = [f"    <testcase {name}>"]
    if one.failures:
        first = one.failures[0]
        more = f" (and {len(one.failures) - 1} more)" if len(one.failures) > 1 else ""
        message = _attribute(f"{first.message}{more}")
        texts = "\n".join(escape(line_of(found)) for found in one.failures)
        lines.append(f'      <failure type="{first.check}" message={message}>{texts}</failure>')
    if others:
        texts = "\n".join(escape(line_of(found)) for found in others)
        lines.append(f"      <system-out>{texts}</system-out>")
    return [*lines, "    </testcase>"]


def _attribute(text: str) -> str:
    """Return a text in quotes; XML has no way to write control characters."""
    return f'"{escape(one_line(text))}"'
