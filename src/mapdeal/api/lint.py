"""What is wrong with maps, as a value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from mapdeal.checks.finding import SEVERITIES, Finding, Severity
from mapdeal.checks.lint import lint_file
from mapdeal.grid.display import OneLine, count_text
from mapdeal.pipeline.settings import Settings


@dataclass(frozen=True, repr=False)
class LintReport(OneLine):
    """What checks have found in some maps: as a sequence, the findings, map by map.

    Empty, and so false, if there are none.

    Parameters
    ----------
    found : dict of str to tuple of Finding
        The findings of each file or folder that was looked at, the worst first; empty of those
        without any.
    """

    found: dict[str, tuple[Finding, ...]]

    def __iter__(self) -> Iterator[Finding]:
        return (finding for findings in self.found.values() for finding in findings)

    def __len__(self) -> int:
        return sum(map(len, self.found.values()))

    def __getitem__(self, index: int) -> Finding:
        return tuple(self)[index]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """What makes a map wrong or unsafe for some reader."""
        return self._of("error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Traps."""
        return self._of("warning")

    @property
    def notes(self) -> tuple[Finding, ...]:
        """What is good to know."""
        return self._of("note")

    def _of(self, severity: Severity) -> tuple[Finding, ...]:
        return tuple(finding for finding in self if finding.severity == severity)

    def _told(self) -> Iterator[str]:
        counts = (count_text(len(self._of(severity)), severity) for severity in SEVERITIES)
        yield f"{count_text(len(self.found), 'map')}: {', '.join(counts)}"


def lint(
    paths: str | PathLike[str] | Iterable[str | PathLike[str]],
    *,
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> LintReport:
    """Say what is wrong with maps, by named checks, as the command does.

    Parameters
    ----------
    paths : path or str, or several
        Files: map_server ``.yaml``, ``.pbm`` with its YAML beside it, ``.npz``; or folders of
        runs.
    max_cells : int, optional
        Cells up to which a file is read; by default 2e8 for compressed images, 1e9 for others.
    max_memory : int, optional
        Bytes of memory that may be taken; by default half of what is free.

    Returns
    -------
    LintReport
        The findings. A file that cannot be read is one of them, and no error.

    Examples
    --------
    In a script for CI::

        report = mapdeal.lint(Path("maps").glob("*.yaml"))
        for finding in report:
            print(finding)
        sys.exit(1 if report.errors else 0)
    """
    several = [paths] if isinstance(paths, str | PathLike) else paths
    settings = Settings(max_cells=max_cells, max_memory=max_memory)
    with settings.memory():
        found = {str(path): _findings(Path(path), settings) for path in several}
    return LintReport(found)


def _findings(path: Path, settings: Settings) -> tuple[Finding, ...]:
    return tuple(lint_file(path, max_cells=settings.max_cells))
