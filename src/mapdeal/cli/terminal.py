"""What commands say, and to which stream: results on stdout, everything else on stderr."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable
from typing import TextIO

from mapdeal.errors import MapdealError, MapdealWarning, one_line

_quiet = False
_verbose = False


def configure(*, quiet: bool, verbose: bool) -> None:
    """Set how much is said: quiet leaves errors and asked-for results only."""
    global _quiet, _verbose
    _quiet, _verbose = quiet, verbose


def result(text: str) -> None:
    """Print a result that the user asked for, quiet or not."""
    print(text)  # noqa: T201


def summary(lines: Iterable[str]) -> None:
    """Print what was done, unless quiet."""
    if not _quiet:
        for line in lines:
            print(one_line(line))  # noqa: T201


def detail(text: str) -> None:
    """Print what only a verbose command says."""
    if _verbose:
        print(one_line(text), file=sys.stderr)  # noqa: T201


def error(problem: MapdealError) -> None:
    """Print an error: one line, and its hint on a second."""
    print(f"error: {problem}", file=sys.stderr)  # noqa: T201
    if problem.hint:
        print(f"hint: {one_line(problem.hint)}", file=sys.stderr)  # noqa: T201


def show_warnings() -> None:
    """Have mapdeal's warnings printed as one line each, every time they occur."""
    warnings.simplefilter("always", MapdealWarning)
    original = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if not issubclass(category, MapdealWarning):
            original(message, category, filename, lineno, file, line)
        elif not _quiet:
            print(f"warning: {one_line(str(message))}", file=sys.stderr)  # noqa: T201

    warnings.showwarning = show


def close_stdout() -> None:
    """Point stdout at nothing after its reader has gone, so that no flush complains."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
