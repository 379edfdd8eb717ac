"""A report as one JSON document."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from mapdeal.checks.finding import Finding
from mapdeal.checks.reports.report import LintReport, MapReport


def json_lines(report: LintReport) -> list[str]:
    """Return the maps, each with its findings, and the numbers of all."""
    files = [one for one in report.maps if one.is_parameters]
    document = {
        **({"parameter_files": [_map(one) for one in files]} if files else {}),
        "maps": [_map(one) for one in report.maps if not one.is_parameters],
        **{f"{severity}s": count for severity, count in report.counts.items()},
        "suppressed": report.suppressed,
    }
    return [json.dumps(document, indent=2)]


def _map(one: MapReport) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "file": one.file,
        "findings": [_finding(found) for found in one.findings],
        "suppressed": one.suppressed,
    }
    return {**entry, "repairs": list(one.repairs)} if one.repairs else entry


def _finding(found: Finding) -> dict[str, Any]:
    entry = asdict(found)
    del entry["file"]
    return entry
