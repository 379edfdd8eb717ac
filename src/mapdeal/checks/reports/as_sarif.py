"""A report as SARIF 2.1.0, which code scanning services and editors read.

References
----------
Static Analysis Results Interchange Format (SARIF) Version 2.1.0 Plus Errata 01, OASIS Standard.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote_from_bytes

from mapdeal.checks.finding import CHECKS, Finding
from mapdeal.checks.reports.report import LintReport, MapReport
from mapdeal.errors import FileAccessError, one_line
from mapdeal.formats.source import absolute_path, normal_path

_SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
_ROOT = "%SRCROOT%"
_MEANINGS = {
    "error": "An error: the map is wrong, or unsafe for some reader.",
    "warning": "A warning: a trap.",
    "note": "A note: good to know.",
}
_OF_PARAMETERS = "params."
_WRONG_PARAMETERS = "An error: ROS refuses the files, or the robot is unsafe with them."


def sarif_lines(report: LintReport) -> list[str]:
    """Return one run of the tool, with all checks as its rules.

    Notes
    -----
    Files below the working directory have relative URIs, as services expect it of the root of a
    repository; others absolute ones. A finding without a line gets line 1.
    """
    indices = {name: index for index, name in enumerate(CHECKS)}
    results = [
        _result(found, indices[found.check], one) for one in report.maps for found in one.findings
    ]
    driver = {
        "name": "mapdeal lint",
        "semanticVersion": report.version,
        "rules": [_rule(name) for name in CHECKS],
    }
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "results": results,
    }
    document = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return [json.dumps(document, indent=2)]


def _rule(name: str) -> dict[str, Any]:
    check = CHECKS[name]
    about = f"{check.about[:1].upper()}{check.about[1:]}."
    meaning = _MEANINGS[check.severity]
    if check.severity == "error" and name.startswith(_OF_PARAMETERS):
        meaning = _WRONG_PARAMETERS
    text = f"{about} {meaning}"
    return {
        "id": name,
        "shortDescription": {"text": about},
        "help": {"text": f"{text} mapdeal's docs/lint.md lists all checks."},
        "defaultConfiguration": {"level": check.severity},
        "properties": {"tags": [name.partition(".")[0]]},
    }


def _result(found: Finding, index: int, one: MapReport) -> dict[str, Any]:
    location = {
        "artifactLocation": _location(found.file, is_folder=one.is_folder),
        "region": {"startLine": found.line or 1},
    }
    if one.is_folder:  # a folder has no lines
        del location["region"]
    return {
        "ruleId": found.check,
        "ruleIndex": index,
        "level": found.severity,
        "message": {"text": one_line(found.message)},
        "locations": [{"physicalLocation": location}],
        **({"properties": {"places": found.places}} if found.places else {}),
    }


def _location(name: str, *, is_folder: bool) -> dict[str, str]:
    """Return where a file is: its URI, relative to the working directory if it is below that."""
    path = Path(name)
    try:
        path = normal_path(path).relative_to(absolute_path(Path()))
    except ValueError:
        path = normal_path(path)
    except FileAccessError:  # without a working directory, names are all there is
        pass
    uri = quote_from_bytes(os.fsencode(path.as_posix())) + "/" * is_folder
    if path.is_absolute():
        return {"uri": f"file://{'' if uri.startswith('/') else '/'}{uri}"}
    return {"uri": uri, "uriBaseId": _ROOT}
