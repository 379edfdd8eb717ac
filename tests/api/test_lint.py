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
    assert {file: len(found) for file, found in report.found.items()} == {
        file: len(found) for file, found in listed.items()
    }
    for file, found in report.found.items():
        for finding, expected in zip(found, listed[file], strict=True):
            for key in ("check", "severity", "message", "line"):
                assert getattr(finding, key) == expected[key]
            assert finding.file == file
    _, out, _ = command("lint", *paths)
    assert [str(finding) for finding in report] == out.splitlines()[: len(report)]


def test_a_report_is_a_sequence_of_findings(maps):
    sound = mapdeal.lint(maps / "sound.yaml")
    assert list(sound.found) == [str(maps / "sound.yaml")]
    assert not sound.errors
    report = mapdeal.lint(str(maps / "odd.yaml"))
    assert report
    assert len(report) == len(list(report))
    assert report[0] == next(iter(report))
    assert report[-1] in report.found[str(maps / "odd.yaml")]
    assert {finding.check for finding in report} >= {"yaml.defaults"}
    assert len(report.errors) + len(report.warnings) + len(report.notes) == len(report)
    assert all(finding.severity == "error" for finding in report.errors)
    with pytest.raises(dataclasses.FrozenInstanceError):
        report[0].message = "other"
    assert not mapdeal.lint([])
    with pytest.raises(IndexError):
        mapdeal.lint([])[0]


def test_a_missing_file_is_a_finding_with_its_line_of_text(tmp_path):
    (finding,) = mapdeal.lint(tmp_path / "missing.yaml")
    assert (finding.check, finding.severity, finding.line) == ("file.access", "error", None)
    assert str(finding).startswith(f"{tmp_path / 'missing.yaml'}: error: file.access: ")
    found = mapdeal.Finding("area.name", "note", "a\nb.yaml", "says\tso", 7)
    assert str(found) == "a\\nb.yaml:7: note: area.name: says\\tso"


def test_numbers_that_are_not_allowed_are_refused(tmp_path):
    with pytest.raises(mapdeal.ParameterError, match="max_cells: must be a whole number"):
        mapdeal.lint(tmp_path / "a.yaml", max_cells=0)


@pytest.mark.parametrize("name", ["willow", "depot"])
def test_real_maps_are_looked_at(real_maps, name):
    found = sorted(real_maps.rglob(f"*{name}*.yaml"))
    if not found:
        pytest.skip(f"there is no {name}")
    report = mapdeal.lint(found)
    assert list(report.found) == [str(path) for path in found]
    assert "\n" not in repr(report)
