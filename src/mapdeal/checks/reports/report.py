"""What lint has found in some maps."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

from mapdeal.checks.finding import SEVERITIES, Finding


@dataclass(frozen=True)
class MapReport:
    """What was found in a map, or in the folder of a run.

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
    """

    file: str
    findings: tuple[Finding, ...]
    suppressed: int = 0
    strict: bool = False
    is_folder: bool = False
    repairs: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[Finding, ...]:
        """The findings that make the exit code 1."""
        failing = ("error", "warning") if self.strict else ("error",)
        return tuple(found for found in self.findings if found.severity in failing)


@dataclass(frozen=True)
class LintReport:
    """What was found in some maps.

    Parameters
    ----------
    maps : tuple of MapReport
        In the order of the names that were given.
    version : str
        That of mapdeal.
    """

    maps: tuple[MapReport, ...]
    version: str

    @property
    def findings(self) -> list[Finding]:
        """Those of all maps."""
        return [found for one in self.maps for found in one.findings]

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many findings there are of each severity."""
        found = Counter(finding.severity for finding in self.findings)
        return {severity: found[severity] for severity in SEVERITIES}

    @property
    def suppressed(self) -> int:
        """How many findings comments and configuration suppress."""
        return sum(one.suppressed for one in self.maps)

    @property
    def passes(self) -> bool:
        """Whether no map has a finding that makes the exit code 1."""
        return not any(one.failures for one in self.maps)
