"""What lint has found in some maps."""

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
    """What was found in a map, in the folder of a run, or in a robot's parameter file.

    Parameters
    ----------
    file : str
        Its name.
    findings : tuple of Finding
        Those that count, the worst first.
    suppressed : int
        How many more a comment or the project's configuration suppresses.
    strict : bool
        Whether warnings, too, are failures.
    is_folder : bool
        Whether it is a folder.
    repairs : tuple of str
        What was changed in its files, a line each.
    is_parameters : bool
        Whether it is a file of a robot's parameters, and no map.
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
        """The findings that make the exit code 1."""
        failing = ("error", "warning") if self.strict else ("error",)
        return tuple(found for found in self.findings if found.severity in failing)


@dataclass(frozen=True, repr=False)
class LintReport(OneLine, Sequence[Finding]):
    """What was found in some maps: as a sequence, the findings, map by map.

    Empty, and so false, if there are none.

    Parameters
    ----------
    maps : tuple of MapReport
        In the order of the names that were given; files of a robot's parameters come first.
    version : str
        That of mapdeal.
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
        """What makes a map wrong or unsafe for some reader."""
        return self._of("error")

    @property
    def warnings(self) -> list[Finding]:
        """Traps."""
        return self._of("warning")

    @property
    def notes(self) -> list[Finding]:
        """What is good to know."""
        return self._of("note")

    def _of(self, severity: Severity) -> list[Finding]:
        return [found for found in self.findings if found.severity == severity]

    def _told(self) -> Iterator[str]:
        yield self.summary()

    def summary(self) -> str:
        """Return how many maps there were, and how much was found, in one line."""
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
        """Those of all maps."""
        return [found for one in self.maps for found in one.findings]

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many findings there are of each severity."""
        return counts_of(self.findings)

    @property
    def suppressed(self) -> int:
        """How many findings comments and configuration suppress."""
        return sum(one.suppressed for one in self.maps)

    @property
    def passes(self) -> bool:
        """Whether no map has a finding that makes the exit code 1."""
        return not any(one.failures for one in self.maps)


def counts_of(findings: Iterable[Finding]) -> dict[str, int]:
    """Return how many findings there are of each severity."""
    found = Counter(finding.severity for finding in findings)
    return {severity: found[severity] for severity in SEVERITIES}


def counts_text(counts: Mapping[str, int], suppressed: int) -> str:
    """Return the counts of findings in words, and how many were suppressed."""
    parts = [count_text(count, severity) for severity, count in counts.items()]
    return ", ".join([*parts, *([f"{suppressed} suppressed"] if suppressed else [])])
