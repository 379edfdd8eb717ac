import dataclasses
import json
from pathlib import Path

import pytest

import mapdeal
from drawn import grid_from_text


@pytest.fixture(autouse=True)
def maps(here):
    """A sound map and one with traps, as files."""
    for name in ("sound", "odd"):
        mapdeal.write_map(f"maps/{name}.yaml", grid_from_text("?????\n?...?\n?.#.?\n?????"))
    odd = Path("maps/odd.yaml")
    lines = [line for line in odd.read_text().splitlines() if not line.startswith("negate")]
    odd.write_text("\n".join(lines).replace("0.196", "0.9") + "\n")


@pytest.mark.parametrize(("paths", "words", "options"), [
    (["maps/sound.yaml", "maps/odd.yaml", "maps/missing.yaml"], [], {}),
    (["maps"], ["--ignore", "yaml", "--strict"], {"ignore": "yaml", "strict": True}),
    (["maps/*.yaml"], ["--select", "yaml.defaults"], {"select": ["yaml.defaults"]}),
], ids=["files", "folder", "pattern"])  # fmt: skip
def test_findings_are_those_of_the_command(command, paths, words, options):
    report = mapdeal.lint(paths, **options)
    code, out, _ = command("lint", *paths, *words, "--format", "json")
    assert report.passes == (code == 0)
    document = json.loads(out)["maps"]
    assert [part.file for part in report.maps] == [part["file"] for part in document]
    for part, expected in zip(report.maps, document, strict=True):
        for finding, entry in zip(part.findings, expected["findings"], strict=True):
            for key in ("check", "severity", "message", "line"):
                assert getattr(finding, key) == entry[key]
        assert {finding.file for finding in part.findings} <= {part.file}
    out = command("lint", *paths, *words)[1]
    assert [str(finding) for finding in report] == out.splitlines()[: len(report)]


def test_a_report_is_a_sequence_of_findings():
    sound = mapdeal.lint(Path("maps/sound.yaml"))
    assert [part.file for part in sound.maps] == ["maps/sound.yaml"]
    assert (list(sound.errors), sound.passes) == ([], True)
    report = mapdeal.lint("maps/odd.yaml")
    assert len(report) == len(list(report)) > 0
    assert report[0] == next(iter(report))
    assert report[-1] in report.maps[0].findings
    assert len(report.errors) + len(report.warnings) + len(report.notes) == len(report)
    assert all(finding.severity == "error" for finding in report.errors)
    with pytest.raises(dataclasses.FrozenInstanceError):
        report[0].message = "other"
    with pytest.raises(IndexError):
        report[len(report)]


def test_a_finding_is_its_line_of_text():
    (missing,) = mapdeal.lint("missing.yaml")
    assert (missing.check, missing.severity, missing.line) == ("file.access", "error", None)
    assert str(missing).startswith("missing.yaml: error: file.access: ")
    found = mapdeal.Finding("area.name", "note", "a\nb.yaml", "says\tso", 7)
    assert str(found) == "a\\nb.yaml:7: note: area.name: says\\tso"


def test_parameter_files_are_linted_with_and_without_maps():
    Path("robot.yaml").write_text("robot_radius: 0.3\nstatic_map: 1\n")
    report = mapdeal.lint(params_file="robot.yaml")
    assert ("params.silent-default", 2) in [(finding.check, finding.line) for finding in report]
    assert [part.is_parameters for part in report.maps] == [True]
    report = mapdeal.lint("maps/sound.yaml", params_file=[Path("robot.yaml")], costmap="local")
    assert [part.is_parameters for part in report.maps] == [True, False]
