"""All checks on maps and a robot's parameter files, and reports of what they find.

References
----------
Static Analysis Results Interchange Format (SARIF) Version 2.1.0 Plus Errata 01, OASIS Standard.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from html import escape
from pathlib import Path, PurePath
from typing import Any, Literal, overload
from urllib.parse import quote_from_bytes

from mapdeal.checks.facts import MaskFacts, RoomFacts, gather, gather_rooms
from mapdeal.checks.findings import (
    CHECKS,
    SEVERITIES,
    Finding,
    IgnoreComment,
    Severity,
    declare_check,
    read_ignore_comments,
)
from mapdeal.checks.map_checks import lint_run
from mapdeal.checks.mask_checks import filter_topic as _  # noqa: F401 - they are listed
from mapdeal.checks.parameter_checks import lint_parameters
from mapdeal.command import Result
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealError,
    ParameterError,
    one_line,
    refusal_of_the_system,
)
from mapdeal.files.source import BIT_MAP, absolute_path, is_folder, normal_path
from mapdeal.grid.values import OneLine, count_text
from mapdeal.ros.robot import CostmapName

LEFT_OUT = "lint.left-out"

declare_check(LEFT_OUT, "note", "a check that takes more memory than it may was left out")

_LARGEST_PARAMETERS = 1 << 20  # bytes of a robot's parameter file


def lint_file(
    path: Path, *, max_cells: int | None = None, radius: float | None = None
) -> list[Finding]:
    """Return what all checks find in a map or a folder of outputs, the worst first."""
    if is_folder(path):
        return lint_run(path)
    pair, cells, findings = gather(path, max_cells=max_cells)
    path = path if pair is None else pair.path
    facts_by_type: dict[type, Any] = {
        type(facts): facts for facts in (pair, cells) if facts is not None
    }
    if radius is not None and cells is not None:
        try:
            facts_by_type[RoomFacts] = gather_rooms(path, radius, max_cells=max_cells)
        except MalformedInputError as error:  # which reading by strips is not: there is too little
            text = f"{', '.join(checks_of(RoomFacts))}: {error.rule}"
            findings.append(CHECKS[LEFT_OUT].finding(path, text.removeprefix(f"{path}: ")))
    entries = {} if pair is None else pair.entries
    for check in CHECKS.values():
        if check.facts in facts_by_type:
            for remark in check.remarks(facts_by_type[check.facts]):
                line = None
                if remark.key is not None and remark.key in entries:
                    line = entries[remark.key].node.start_mark.line + 1
                findings.append(check.finding(path, remark.message, line, remark.places))
    return sorted(dict.fromkeys(findings), key=lambda found: SEVERITIES.index(found.severity))


def lint_mask(path: Path, facts: MaskFacts) -> Iterator[Finding]:
    """Yield what checks find in the mask of a costmap filter that is for some map."""
    entries = {} if facts.pair is None else facts.pair.entries
    for check in CHECKS.values():
        if check.facts is MaskFacts:
            for remark in check.remarks(facts):
                line = entries[remark.key].line if remark.key in entries else None
                yield check.finding(path, remark.message, line, remark.places)


def checks_of(facts: type) -> list[str]:
    return [check.name for check in CHECKS.values() if check.facts is facts]


@dataclass(frozen=True)
class Found:
    """Findings and comments of a file before rules are applied."""

    findings: tuple[Finding, ...]
    comments: tuple[IgnoreComment, ...] = ()


def found_in(path: Path, max_cells: int | None, radius: float | None = None) -> Found:
    """Return what is found in a map, also if it cannot be checked."""
    try:
        findings = lint_file(path, max_cells=max_cells, radius=radius)
    except MapdealError as error:
        return not_checked(path, str(error))
    except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
        text = f"internal error: {type(problem).__name__}: {problem}; this is a bug in mapdeal"
        return not_checked(path, str(refusal_of_the_system(problem) or text))
    has_comments = not is_folder(path) and path.suffix.lower() not in (".npz", BIT_MAP)
    return Found(tuple(findings), tuple(read_ignore_comments(path) if has_comments else ()))


def not_checked(path: Path, text: str) -> Found:
    return Found((CHECKS["lint.not-checked"].finding(path, text.removeprefix(f"{path}: ")),))


def found_in_parameters(
    paths: Sequence[Path], costmap: CostmapName | None, namespace: str | None,
    map_resolutions: Sequence[tuple[str, float]],
) -> dict[Path, Found]:  # fmt: skip
    try:
        found = lint_parameters(
            paths, costmap=costmap, namespace=namespace, map_resolutions=map_resolutions
        )
    except FileAccessError as error:
        faulty = Path(error.source) if error.source is not None else paths[-1]
        finding = CHECKS["file.access"].finding(faulty, str(error).removeprefix(f"{faulty}: "))
        found = {path: [finding] if path == faulty else [] for path in paths}
    return {
        path: Found(tuple(findings), tuple(read_ignore_comments(path, _LARGEST_PARAMETERS)))
        for path, findings in found.items()
    }


ReportForm = Literal["text", "json", "github", "sarif", "junit"]


@dataclass(frozen=True, repr=False)
class MapReport(OneLine):
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
        findings = [
            {k: v for k, v in asdict(found).items() if k != "file" or v != self.file}
            for found in self.findings
        ]
        entry = {"file": self.file, "findings": findings, "suppressed": self.suppressed}
        return {**entry, "repairs": list(self.repairs)} if self.repairs else entry

    @property
    def failures(self) -> tuple[Finding, ...]:
        """Findings that set the exit code to 1."""
        failing = ("error", "warning") if self.strict else ("error",)
        return tuple(found for found in self.findings if found.severity in failing)


@dataclass(frozen=True, repr=False)
class LintReport(Result, Sequence[Finding]):
    """Findings in one or more maps, as a sequence, map by map.

    A report without findings is empty and therefore false.

    Parameters
    ----------
    maps : tuple of MapReport
        One report per map, in the order in which the maps were given; a robot's parameter files
        come first.
    version : str
        Version of mapdeal.
    form : {'text', 'json', 'github', 'sarif', 'junit'}
        Format of its `lines`.
    problems : tuple of MapdealError
        Why maps could not be repaired.
    output : path, optional
        Repaired copy that was written instead of a report.
    """

    maps: tuple[MapReport, ...]
    version: str
    form: ReportForm = "text"
    problems: tuple[MapdealError, ...] = ()
    output: Path | None = None

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
        return self._of("error")

    @property
    def warnings(self) -> list[Finding]:
        """Findings of severity ``warning``: traps."""
        return self._of("warning")

    @property
    def notes(self) -> list[Finding]:
        """Findings of severity ``note``: worth knowing."""
        return self._of("note")

    def _of(self, severity: Severity) -> list[Finding]:
        return [found for found in self.findings if found.severity == severity]

    def _repr_parts(self) -> Iterator[str]:
        yield self.summary()

    def summary(self, _output: Path | None = None) -> str:
        """Return the number of maps and of findings, in one line."""
        folders = sum(one.is_folder for one in self.maps)
        files = sum(one.is_parameters for one in self.maps)
        maps = len(self.maps) - folders - files
        kinds = [count_text(files, "parameter file")] if files else []
        kinds += [count_text(maps, "map")] if maps or not (folders or files) else []
        kinds += [count_text(folders, "folder")] if folders else []
        parts = [counts_text(self.counts, self.suppressed)]
        repaired = sum(bool(one.repairs) for one in self.maps)
        if repaired:
            parts.append(f"{repaired} repaired")
        return f"{', '.join(kinds)}: {', '.join(parts)}"

    @property
    def findings(self) -> list[Finding]:
        return [found for one in self.maps for found in one.findings]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of findings of each severity."""
        return counts_of(self.findings)

    @property
    def suppressed(self) -> int:
        """Number of findings suppressed by comments or configuration."""
        return sum(one.suppressed for one in self.maps)

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether no finding sets the exit code to 1."""
        return not any(one.failures for one in self.maps)

    def check(self) -> None:
        """Raise the error of the first map that could not be repaired."""
        for problem in self.problems:
            raise problem

    def document(self) -> dict[str, Any]:
        """Return the report as the dict that ``mapdeal lint --format json`` prints."""
        files = [one.document() for one in self.maps if one.is_parameters]
        return {
            **({"parameter_files": files} if files else {}),
            "maps": [one.document() for one in self.maps if not one.is_parameters],
            **{f"{severity}s": count for severity, count in self.counts.items()},
            "suppressed": self.suppressed,
        }

    def parts(self) -> Iterable[str]:
        if self.form not in ("text", "json"):
            rule = "cannot be given together with --json"
            raise ParameterError(rule, source="--format", got=self.form)
        return super().parts()

    def lines(self) -> Iterator[str]:
        """Yield what ``mapdeal lint`` prints in its format."""
        if self.output is None:
            yield from (line for text in REPORTS[self.form](self) for line in text.split("\n"))

    def closing(self) -> Iterator[str]:
        """Yield what ``mapdeal lint`` prints in the end: a sum, or what has been repaired."""
        for one in self.maps if self.output is not None else ():
            yield f"{one.file} -> {self.output}"
            yield from (f"  {line}" for line in one.repairs)
        if self.output is None and self.form == "text":
            yield self.summary()


def counts_of(findings: Iterable[Finding]) -> dict[str, int]:
    found = Counter(finding.severity for finding in findings)
    return {severity: found[severity] for severity in SEVERITIES}


def counts_text(counts: Mapping[str, int], suppressed: int) -> str:
    parts = [count_text(count, severity) for severity, count in counts.items()]
    return ", ".join([*parts, *([f"{suppressed} suppressed"] if suppressed else [])])


_COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}


def _annotation(found: Finding) -> str:
    place = f"file={_escaped(found.file, more=True)}"
    if found.line is not None:
        place += f",line={found.line}"
    title = _escaped(found.check, more=True)
    return f"::{_COMMANDS[found.severity]} {place},title={title}::{_escaped(found.message)}"


def _escaped(text: str, *, more: bool = False) -> str:
    for mark, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(mark, code)
    return text.replace(":", "%3A").replace(",", "%2C") if more else text


def repair_lines(report: LintReport) -> list[str]:
    return [
        one_line(f"{one.file}: repaired: {told}") for one in report.maps for told in one.repairs
    ]


def _junit_lines(report: LintReport) -> list[str]:
    # A failing map has one failure, whose text lists all that makes it fail, since some readers
    # show no more than the first; what else was found is its output. Times are left out, so that
    # equal maps give equal bytes.
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
        texts = "\n".join(escape(str(found)) for found in one.failures)
        lines.append(f'      <failure type="{first.check}" message={message}>{texts}</failure>')
    if others:
        texts = "\n".join(escape(str(found)) for found in others)
        lines.append(f"      <system-out>{texts}</system-out>")
    return [*lines, "    </testcase>"]


def _attribute(text: str) -> str:
    return f'"{escape(one_line(text))}"'


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


def _sarif_lines(report: LintReport) -> list[str]:
    # Files below the working directory have relative URIs, as services expect it of the root of a
    # repository; others absolute ones. A finding without a line gets line 1.
    indices = {name: index for index, name in enumerate(sorted(CHECKS))}
    results = [
        _result(found, indices[found.check], one) for one in report.maps for found in one.findings
    ]
    driver = {
        "name": "mapdeal lint",
        "semanticVersion": report.version,
        "rules": [_rule(name) for name in sorted(CHECKS)],
    }
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
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


REPORTS: dict[ReportForm, Callable[[LintReport], list[str]]] = {
    "text": lambda report: [*repair_lines(report), *map(str, report.findings)],
    "json": lambda report: [json.dumps(report.document(), indent=2)],
    "github": lambda report: [_annotation(found) for found in report.findings],
    "sarif": _sarif_lines,
    "junit": _junit_lines,
}
"""Functions that make the lines of a report, by format name on the command line."""
