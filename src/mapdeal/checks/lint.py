"""Run all checks on maps and a robot's parameter files, and report their findings.

References
----------
Static Analysis Results Interchange Format (SARIF) Version 2.1.0 Plus Errata 01, OASIS Standard.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from html import escape
from pathlib import Path, PurePath
from textwrap import TextWrapper
from typing import Any, Literal, overload
from urllib.parse import quote_from_bytes

from mapdeal import command, errors, records
from mapdeal.checks import map_checks, parameter_checks
from mapdeal.checks.facts import MaskFacts, RoomFacts, gather, gather_rooms
from mapdeal.checks.findings import CHECKS, SEVERITIES, Check, Finding, Severity, findings_on
from mapdeal.files.json_values import point_document
from mapdeal.files.source import absolute_path, is_folder, normal_path, read_file
from mapdeal.files.yaml_text import OF_MAPS
from mapdeal.grid import frame, values
from mapdeal.maps.formats import format_of
from mapdeal.ros.robot import CostmapName

LEFT_OUT = "lint.left-out"
_LARGEST_PARAMETERS = 1 << 20  # bytes of a robot's parameter file
_IGNORE = re.compile(r"(?:^|(?<=\s))#[ \t]{0,9}mapdeal:[ \t]{0,9}ignore(?![\w-]):?")
_NAME = re.compile(r"[ \t]*([\w.-]+)[ \t]*")


def lint_file(
    path: Path, *, max_cells: int | None = None, radius: float | None = None
) -> list[Finding]:
    if is_folder(path):
        return map_checks.lint_run(path)
    pair, cells, findings = gather(path, max_cells=max_cells)
    path = path if pair is None else pair.path
    facts_by_type: dict[type, Any] = {type(facts): facts for facts in (pair, cells) if facts}
    if radius is not None and cells is not None:
        try:
            facts_by_type[RoomFacts] = gather_rooms(path, radius, max_cells=max_cells)
        except errors.MalformedInputError as error:  # too little memory; other checks read strips
            text = f"{', '.join(checks_of(RoomFacts))}: {error.rule}"
            findings.append(CHECKS[LEFT_OUT].finding(path, text.removeprefix(f"{path}: ")))
    findings += findings_on(facts_by_type, path, {} if pair is None else pair.entries)
    return sorted(dict.fromkeys(findings), key=lambda finding: SEVERITIES.index(finding.severity))


def lint_mask(path: Path, facts: MaskFacts) -> Iterator[Finding]:
    return findings_on({MaskFacts: facts}, path, facts.pair.entries if facts.pair else {})


def checks_of(facts: type) -> list[str]:
    return [check.name for check in CHECKS.values() if check.facts is facts]


@records.dataclass(frozen=True)
class Findings:
    findings: tuple[Finding, ...]  # in a file, before a selection is applied
    ignored_names: tuple[str, ...] = ()  # in its comments


def read_ignored_names(path: Path, limit: int = OF_MAPS.bytes) -> tuple[str, ...]:
    # No YAML parser: comments count in malformed files, too. They begin a line or follow a space.
    try:
        data = read_file(path, limit=limit)
    except (errors.FileAccessError, errors.MalformedInputError):
        return ()
    lines = data.decode("utf-8-sig", "replace").splitlines()
    names = []
    for comment in filter(None, map(_IGNORE.search, lines)):
        for part in comment.string[comment.end() :].split(","):
            name = _NAME.match(part)
            names += [name[1]] if name else []
            if not name or name.end() < len(part):
                break
    return tuple(names)


def check_map(path: Path, max_cells: int | None, radius: float | None = None) -> Findings:
    try:
        findings = lint_file(path, max_cells=max_cells, radius=radius)
    except errors.MapdealError as error:
        return not_checked(path, str(error))
    except Exception as error:  # noqa: BLE001 - a bug must not stop the checks of other maps
        text = f"internal error: {type(error).__name__}: {error}; this is a bug in mapdeal"
        return not_checked(path, str(errors.refusal_of_the_system(error) or text))
    has_comments = not is_folder(path) and format_of(path).is_yaml
    return Findings(tuple(findings), read_ignored_names(path) if has_comments else ())


def not_checked(path: Path, text: str) -> Findings:
    return Findings((CHECKS["lint.not-checked"].finding(path, text.removeprefix(f"{path}: ")),))


def check_parameters(
    paths: Sequence[Path], costmap: CostmapName | None, namespace: str | None,
    map_frames: Sequence[tuple[str, frame.Frame]],
) -> dict[Path, Findings]:  # fmt: skip
    try:
        by_file = parameter_checks.lint_parameters(paths, costmap, namespace, map_frames)
    except errors.FileAccessError as error:
        faulty = Path(error.source) if error.source is not None else paths[-1]
        by_file = {path: [] for path in paths}
        by_file[faulty] = [Check.error_finding(error, faulty)]
    return {
        path: Findings(tuple(findings), read_ignored_names(path, _LARGEST_PARAMETERS))
        for path, findings in by_file.items()
    }


ReportForm = Literal["text", "json", "github", "sarif", "junit"]


@records.dataclass(frozen=True, repr=False)
class MapReport(values.OneLineRepr):
    """Findings in one map, in the folder of a run, or in a robot's parameter file.

    Parameters
    ----------
    file : str
        Name of the file or folder.
    findings : tuple of Finding
        Findings that are not suppressed, most severe first.
    suppressed : int
        Number of findings suppressed by a comment or by the project's configuration.
    strict : bool
        Whether warnings count as failures.
    is_folder : bool
        Whether `file` is the folder of a run.
    repairs : tuple of str
        Changes made to its files, one line each.
    is_parameters : bool
        Whether `file` is a robot's parameter file rather than a map.
    """

    file: str
    findings: tuple[Finding, ...]
    suppressed: int = 0
    strict: bool = False
    is_folder: bool = False
    repairs: tuple[str, ...] = ()
    is_parameters: bool = False

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.file}: {counts_text(counts_of(self.findings), self.suppressed)}"

    def document(self) -> dict[str, Any]:
        """Return its entry in what ``mapdeal lint --format json`` prints."""
        findings = []
        for finding in self.findings:
            fields = records.asdict(finding) | {"places": list(map(point_document, finding.places))}
            findings.append({k: v for k, v in fields.items() if k != "file" or v != self.file})
        entry = {"file": self.file, "findings": findings, "suppressed": self.suppressed}
        return {**entry, "repairs": list(self.repairs)} if self.repairs else entry

    @property
    def failures(self) -> tuple[Finding, ...]:
        """Findings that set the exit code to 1."""
        failing = ("error", "warning") if self.strict else ("error",)
        return tuple(finding for finding in self.findings if finding.severity in failing)


@records.dataclass(frozen=True, repr=False)
class LintReport(command.Result, Sequence[Finding]):
    """Findings in one or more maps, as a sequence, map by map.

    A report without findings is empty and therefore false.

    Parameters
    ----------
    maps : tuple of MapReport
        One report per map, in the order of the maps given; a robot's parameter files come first.
    version : str
        Version of mapdeal.
    form : {'text', 'json', 'github', 'sarif', 'junit'}
        Format of its `lines`.
    problems : tuple of MapdealError
        Why maps could not be repaired.
    output : path, optional
        Repaired copy that was written instead of a report.
    only_counts : bool
        Whether lines and document have the number of findings of each check instead of findings.
    explained : tuple of Check
        Checks that lines and document explain, instead of findings.
    """

    maps: tuple[MapReport, ...]
    version: str
    form: ReportForm = "text"
    problems: tuple[errors.MapdealError, ...] = ()
    output: Path | None = None
    only_counts: bool = False
    explained: tuple[Check, ...] = ()

    def __len__(self) -> int:
        return len(self.findings)

    @overload
    def __getitem__(self, index: int) -> Finding: ...

    @overload
    def __getitem__(self, index: slice) -> list[Finding]: ...

    def __getitem__(self, index: int | slice) -> Finding | list[Finding]:
        return self.findings[index]

    @property
    def errors(self) -> list[Finding]:
        """Findings of severity ``error``: wrong or unsafe for some reader."""
        return self._with_severity("error")

    @property
    def warnings(self) -> list[Finding]:
        """Findings of severity ``warning``: traps."""
        return self._with_severity("warning")

    @property
    def notes(self) -> list[Finding]:
        """Findings of severity ``note``: worth knowing."""
        return self._with_severity("note")

    def _with_severity(self, severity: Severity) -> list[Finding]:
        return [finding for finding in self.findings if finding.severity == severity]

    def _repr_parts(self) -> Iterator[str]:
        yield self.summary()

    def summary(self, _output: Path | None = None) -> str:
        """Return the number of maps and of findings, in one line."""
        folders = sum(report.is_folder for report in self.maps)
        files = sum(report.is_parameters for report in self.maps)
        maps = len(self.maps) - folders - files
        kinds = [values.count_text(files, "parameter file")] if files else []
        kinds += [values.count_text(maps, "map")] if maps or not (folders or files) else []
        kinds += [values.count_text(folders, "folder")] if folders else []
        parts = [counts_text(self.counts, self.suppressed)]
        repaired = sum(bool(report.repairs) for report in self.maps)
        if repaired:
            parts.append(f"{repaired} repaired")
        return f"{', '.join(kinds)}: {', '.join(parts)}"

    @property
    def findings(self) -> list[Finding]:
        return [finding for report in self.maps for finding in report.findings]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of findings of each severity."""
        return counts_of(self.findings)

    @cached_property
    def statistics(self) -> dict[str, int]:
        """Number of findings of each check, most frequent first."""
        counts = Counter(finding.check for finding in self.findings)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def suppressed(self) -> int:
        """Number of findings suppressed by comments or configuration."""
        return sum(report.suppressed for report in self.maps)

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether no finding sets the exit code to 1."""
        return not any(report.failures for report in self.maps)

    def check(self) -> None:
        """Raise the error of the first map that could not be repaired."""
        for problem in self.problems:
            raise problem

    def document(self) -> dict[str, Any]:
        """Return the report as the dict that ``mapdeal lint --format json`` prints."""
        if self.explained:
            checks = [
                {"check": c.name, "severity": c.severity, "on_request": c.on_request}
                | records.asdict(c.explanation)
                for c in self.explained
            ]
            return {"checks": checks}
        content: dict[str, Any] = {}
        if self.only_counts:
            content["statistics"] = [
                {"check": name, "severity": CHECKS[name].severity, "count": count}
                for name, count in self.statistics.items()
            ]
        else:
            files = [report.document() for report in self.maps if report.is_parameters]
            content |= {"parameter_files": files} if files else {}
            content["maps"] = [r.document() for r in self.maps if not r.is_parameters]
        content |= {f"{severity}s": count for severity, count in self.counts.items()}
        return {**content, "suppressed": self.suppressed}

    def parts(self) -> Iterable[str]:
        if self.form not in ("text", "json"):
            rule = "cannot be given together with --json"
            raise errors.ParameterError(rule, source="--format", got=self.form)
        return super().parts()

    def lines(self) -> Iterator[str]:
        """Yield the lines that ``mapdeal lint`` prints in its format."""
        if self.output is None:
            yield from (line for text in REPORTS[self.form](self) for line in text.split("\n"))

    def closing(self) -> Iterator[str]:
        """Yield the last lines of ``mapdeal lint``: the totals, or the repairs."""
        for report in self.maps if self.output is not None else ():
            yield f"{report.file} -> {self.output}"
            yield from (f"  {line}" for line in report.repairs)
        if self.output is None and self.form == "text" and not self.explained:
            yield self.summary()


def counts_of(findings: Iterable[Finding]) -> dict[str, int]:
    counts = Counter(finding.severity for finding in findings)
    return {severity: counts[severity] for severity in SEVERITIES}


def counts_text(counts: Mapping[str, int], suppressed: int) -> str:
    parts = [values.count_text(count, severity) for severity, count in counts.items()]
    return ", ".join([*parts, *([f"{suppressed} suppressed"] if suppressed else [])])


_COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}
_ESCAPES = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A"})
_ESCAPES_OF_PROPERTIES = _ESCAPES | str.maketrans({":": "%3A", ",": "%2C"})


def _annotation(finding: Finding) -> str:
    place = f"file={finding.file.translate(_ESCAPES_OF_PROPERTIES)}"
    if finding.line is not None:
        place += f",line={finding.line}"
    message = finding.message.translate(_ESCAPES)
    return f"::{_COMMANDS[finding.severity]} {place},title={finding.check}::{message}"


def repair_lines(report: LintReport) -> list[str]:
    lines = (f"{m.file}: repaired: {repair}" for m in report.maps for repair in m.repairs)
    return list(map(errors.one_line, lines))


def _junit_lines(report: LintReport) -> list[str]:
    # A failing map has one failure with all failing findings, since some readers show only the
    # first; other findings are its output. Without times, equal maps produce equal bytes.
    failing = sum(bool(map_report.failures) for map_report in report.maps)
    counts = f'tests="{len(report.maps)}" failures="{failing}" errors="0"'
    return [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<testsuites name="mapdeal lint" {counts}>',
        f'  <testsuite name="mapdeal lint" {counts} skipped="0">',
        *[line for map_report in report.maps for line in _test_case(map_report)],
        "  </testsuite>",
        "</testsuites>",
    ]


def _test_case(report: MapReport) -> list[str]:
    path = PurePath(report.file)
    name = f"name={_attribute(path.name or report.file)} classname={_attribute(str(path.parent))}"
    passing = [finding for finding in report.findings if finding not in report.failures]
    if not report.findings:
        return [f"    <testcase {name}/>"]
    lines = [f"    <testcase {name}>"]
    if report.failures:
        first, count = report.failures[0], len(report.failures)
        suffix = f" (and {count - 1} more)" if count > 1 else ""
        message, text = _attribute(f"{first.message}{suffix}"), _joined(report.failures)
        lines.append(f'      <failure type="{first.check}" message={message}>{text}</failure>')
    if passing:
        lines.append(f"      <system-out>{_joined(passing)}</system-out>")
    return [*lines, "    </testcase>"]


def _joined(findings: Iterable[Finding]) -> str:
    return "\n".join(escape(str(finding)) for finding in findings)


def _attribute(text: str) -> str:
    return f'"{escape(errors.one_line(text))}"'


_SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
_ROOT = "%SRCROOT%"


def _sarif_lines(report: LintReport) -> list[str]:
    # Files below the working directory get relative URIs, which services resolve against the root
    # of a repository; other files get absolute ones. A finding without a line gets line 1.
    indices = {name: index for index, name in enumerate(sorted(CHECKS))}
    results = [_result(found, indices[found.check], m) for m in report.maps for found in m.findings]
    rules = list(map(_rule, sorted(CHECKS)))
    driver = {"name": "mapdeal lint", "semanticVersion": report.version, "rules": rules}
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    return [json.dumps({"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2)]


def _rule(name: str) -> dict[str, Any]:
    check, texts = CHECKS[name], CHECKS[name].explanation
    return {
        "id": name,
        "shortDescription": {"text": texts.about},
        "help": {"text": f"{texts.about} {texts.why} Example: {texts.example} Fix: {texts.fix}"},
        "defaultConfiguration": {"level": check.severity, "enabled": not check.on_request},
        "properties": {"tags": [name.partition(".")[0]]},
    }


def _result(finding: Finding, index: int, report: MapReport) -> dict[str, Any]:
    location: Any = {"artifactLocation": _location(finding.file, is_folder=report.is_folder)}
    if not report.is_folder:
        location["region"] = {"startLine": finding.line or 1}
    places = list(map(point_document, finding.places))
    return {
        "ruleId": finding.check,
        "ruleIndex": index,
        "level": finding.severity,
        "message": {"text": errors.one_line(finding.message)},
        "locations": [{"physicalLocation": location}],
        **({"properties": {"places": places}} if places else {}),
    }


def _location(name: str, *, is_folder: bool) -> dict[str, str]:
    """Return a file's URI, relative to the working directory if the file is below it."""
    path = Path(name)
    with suppress(errors.FileAccessError):  # without a working directory, the name as it is
        path, folder = normal_path(path), absolute_path(Path())
        path = path.relative_to(folder) if path.is_relative_to(folder) else path
    uri = quote_from_bytes(os.fsencode(path.as_posix())) + "/" * is_folder
    if path.is_absolute():
        return {"uri": f"file://{'' if uri.startswith('/') else '/'}{uri}"}
    return {"uri": uri, "uriBaseId": _ROOT}


def _text_lines(report: LintReport) -> list[str]:
    lines: list[str] = []
    for check in report.explained:
        texts = check.explanation
        lines.append(f"{check.name} ({check.severity}{', on request' if check.on_request else ''})")
        for text in (texts.about, texts.why, f"Example: {texts.example}", f"Fix: {texts.fix}"):
            lines += _FILLED.wrap(text)
        lines.append("")
    if lines:
        return lines
    if not report.only_counts:
        return [*repair_lines(report), *map(str, report.findings)]
    width = max(map(len, report.statistics), default=0)
    return [
        f"{count:6}  {name:{width}}  {CHECKS[name].severity:7}  {CHECKS[name].explanation.about}"
        for name, count in report.statistics.items()
    ]


_FILLED = TextWrapper(
    88, initial_indent="  ", subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
)

REPORTS: dict[ReportForm, Callable[[LintReport], list[str]]] = {
    "text": _text_lines,
    "json": lambda report: [json.dumps(report.document(), indent=2)],
    "github": lambda report: [_annotation(found) for found in report.findings],
    "sarif": _sarif_lines,
    "junit": _junit_lines,
}
"""Functions that make the lines of a report, by the format's name on the command line."""
