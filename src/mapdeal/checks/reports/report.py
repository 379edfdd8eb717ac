"""Findings of lint in one or more maps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import overload

from mapdeal.checks.finding import SEVERITIES, Finding, Severity
from mapdeal.grid.display import OneLine, count_text
from mapdeal.records import dataclass


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

    def _told(self) -> Iterator[str]:
        yield f"{self.file}: {counts_text(counts_of(self.findings), self.suppressed)}"

    @property
    def failures(self) -> tuple[Finding, ...]:
        """Findings that set the exit code to 1."""
        failing = ("error", "warning") if self.strict else ("error",)
        return tuple(found for found in self.findings if found.severity in failing)


@dataclass(frozen=True, repr=False)
class LintReport(OneLine, Sequence[Finding]):
    """Findings in one or more maps, as a sequence, map by map.

    A report without findings is empty and therefore false.

    Parameters
    ----------
    maps : tuple of MapReport
        One report per map, in the order in which the maps were given; a robot's parameter files
        come first.
    version : str
        Version of mapdeal.
    """

    maps: tuple[MapReport, ...]
    version: str

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

    def _told(self) -> Iterator[str]:
        yield self.summary()

    def summary(self) -> str:
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
        """Findings of all maps."""
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
    def passes(self) -> bool:
        """Whether no finding sets the exit code to 1."""
        return not any(one.failures for one in self.maps)


def counts_of(findings: Iterable[Finding]) -> dict[str, int]:
    """Return the number of findings of each severity."""
    found = Counter(finding.severity for finding in findings)
    return {severity: found[severity] for severity in SEVERITIES}


def counts_text(counts: Mapping[str, int], suppressed: int) -> str:
    """Return the counts of findings, and of suppressed ones, in words."""
    parts = [count_text(count, severity) for severity, count in counts.items()]
    return ", ".join([*parts, *([f"{suppressed} suppressed"] if suppressed else [])])
