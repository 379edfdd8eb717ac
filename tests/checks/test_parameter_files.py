"""Findings of lint in parameter files, with the expected ones in ``cases/*.yaml``."""

from pathlib import Path

import pytest

from mapdeal.checks.findings import CHECKS
from mapdeal.checks.parameter_checks import lint_parameters
from mapdeal.grid.frame import Frame
from recorded_cases import RecordedCases

CASES = RecordedCases(Path(__file__).with_name("cases"))


def describe_lint(paths, maps=(), **options):
    frames = [(name, Frame(200, 300, side)) for name, side in maps]
    by_file = lint_parameters(paths, map_frames=frames, **options)
    findings = [finding for path in paths for finding in by_file[path]]
    assert len(findings) == sum(map(len, by_file.values()))
    assert all(finding.severity == CHECKS[finding.check].severity for finding in findings)
    lines = [f"{f.check} at {Path(f.file).name}:{f.line}: {f.message}" for f in findings]
    return [line.replace(f"{paths[0].parent}/", "") for line in lines]


@pytest.mark.parametrize(("kind", "name"), CASES.names)
def test_files_have_the_recorded_findings(files, kind, name):
    CASES.check(kind, name, files, describe_lint)
