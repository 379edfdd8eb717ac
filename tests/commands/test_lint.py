"""Findings from Python: those of the command, as values."""

import dataclasses
import json

import numpy as np
import pytest

import mapdeal


@pytest.fixture
def maps(tmp_path):
    """A sound map and one with traps, as files."""
    values = np.full((6, 9), -1, np.int8)
    values[1:5, 1:8] = 0
    values[2, 3] = 100
    grid = mapdeal.OccupancyGrid(values, 0.25, (1.5, -2.0, 0.4))
    mapdeal.write_map(tmp_path / "sound.yaml", grid)
    mapdeal.write_map(tmp_path / "odd.yaml", grid)
    odd = tmp_path / "odd.yaml"
    lines = [line for line in odd.read_text().splitlines() if not line.startswith("negate")]
    odd.write_text("\n".join(lines).replace("0.196", "0.9") + "\n")
    return tmp_path


def test_findings_are_those_of_the_command(maps, command):
    paths = [maps / "sound.yaml", maps / "odd.yaml", maps / "missing.yaml"]
    report = mapdeal.lint(paths)
    _, out, _ = command("lint", *paths, "--format", "json")
    listed = {one["file"]: one["findings"] for one in json.loads(out)["maps"]}
    found_in = {one.file: one.findings for one in report.maps}
    assert list(found_in) == list(listed)
    for file, found in found_in.items():
        for finding, expected in zip(found, listed[file], strict=True):
            for key in ("check", "severity", "message", "line"):
                assert getattr(finding, key) == expected[key]
            assert finding.file == file
    _, out, _ = command("lint", *paths)
    assert [str(finding) for finding in report] == out.splitlines()[: len(report)]


def test_a_report_is_a_sequence_of_findings(maps):
    sound = mapdeal.lint(maps / "sound.yaml")
    assert [one.file for one in sound.maps] == [str(maps / "sound.yaml")]
    assert not sound.errors
    assert sound.passes
    report = mapdeal.lint(str(maps / "odd.yaml"))
    assert report
    assert len(report) == len(list(report))
    assert report[0] == next(iter(report))
    assert report[-1] in report.maps[0].findings
    assert {finding.check for finding in report} >= {"yaml.defaults"}
    assert len(report.errors) + len(report.warnings) + len(report.notes) == len(report)
    assert all(finding.severity == "error" for finding in report.errors)
    with pytest.raises(dataclasses.FrozenInstanceError):
        report[0].message = "other"
    with pytest.raises(IndexError):
        report[len(report)]


def test_a_missing_file_is_a_finding_with_its_line_of_text(tmp_path):
    (finding,) = mapdeal.lint(tmp_path / "missing.yaml")
    assert (finding.check, finding.severity, finding.line) == ("file.access", "error", None)
    assert str(finding).startswith(f"{tmp_path / 'missing.yaml'}: error: file.access: ")
    found = mapdeal.Finding("area.name", "note", "a\nb.yaml", "says\tso", 7)
    assert str(found) == "a\\nb.yaml:7: note: area.name: says\\tso"


def test_folders_patterns_and_rules_are_those_of_the_command(maps, command):
    _, out, _ = command("lint", maps, "--format", "json", "--ignore", "yaml", "--strict")
    expected = json.loads(out)["maps"]
    for paths in (maps, f"{maps}/*.yaml", [maps / "odd.yaml", str(maps / "sound.yaml")]):
        report = mapdeal.lint(paths, ignore="yaml", strict=True)
        assert [(one.file, len(one.findings)) for one in report.maps] == [
            (one["file"], len(one["findings"])) for one in expected
        ]
    assert all(not finding.check.startswith("yaml.") for finding in report)
    only = mapdeal.lint(maps, select=["yaml.defaults"])
    assert [finding.check for finding in only] == ["yaml.defaults"]
    assert only.passes
    assert not mapdeal.lint(maps, select=["yaml.defaults"], strict=True).passes


def test_parameter_files_are_linted_with_and_without_maps(maps):
    (maps / "robot.yaml").write_text("robot_radius: 0.3\nstatic_map: 1\n")
    report = mapdeal.lint(params_file=maps / "robot.yaml")
    assert ("params.silent-default", 2) in [(one.check, one.line) for one in report]
    assert [one.is_parameters for one in report.maps] == [True]
    report = mapdeal.lint(maps / "sound.yaml", params_file=[maps / "robot.yaml"], costmap="local")
    assert [one.is_parameters for one in report.maps] == [True, False]
