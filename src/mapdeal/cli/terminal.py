"""What commands say, and to which stream: results on stdout, everything else on stderr."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TextIO

from mapdeal.errors import FileAccessError, MapdealError, MapdealWarning, ParameterError, one_line

_CHUNK = 1 << 18
_FEW = 10

_stdout_problem: str | None = None
_stdout_dropped = False
_bar_is_shown = False
_quiet = False
_verbose = False


def configure(*, quiet: bool, verbose: bool) -> None:
    """Set how much is said: quiet leaves errors and asked-for results only."""
    global _quiet, _verbose, _stdout_dropped
    _quiet, _verbose, _stdout_dropped = quiet, verbose, False


def result(text: str) -> None:
    """Print a result that the user asked for, quiet or not."""
    _print_result(text)


def flush() -> None:
    """Let whoever reads the results have those that are there."""
    _to_stdout(sys.stdout.flush)


def is_read() -> bool:
    """Return whether results still reach somebody, so that more of them make sense."""
    return not _stdout_dropped


def input_chunks() -> Iterator[bytes]:
    """Yield what comes in on stdin, as soon as it comes.

    Raises
    ------
    ParameterError
        If there is none.
    FileAccessError
        If it cannot be read.
    """
    if sys.stdin is None:  # the process was started without
        raise ParameterError("is closed", source="standard input")
    try:
        while chunk := os.read(sys.stdin.fileno(), _CHUNK):
            yield chunk
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source="standard input") from None


def warn(text: str) -> None:
    """Print a warning, unless quiet."""
    if not _quiet:
        _say(f"warning: {one_line(text)}")


@contextmanager
def few_warnings(hint: str) -> Iterator[Callable[[str], None]]:
    """Give what prints warnings: the first few, and in the end how many more there were."""
    count = 0

    def show(text: str) -> None:
        nonlocal count
        count += 1
        if count <= _FEW:
            warn(text)

    yield show
    if count > _FEW:
        warn(f"{count - _FEW} more warnings; {hint}")


def summary(lines: Iterable[str]) -> None:
    """Print what was done, unless quiet."""
    if not _quiet:
        for line in lines:
            _print_result(one_line(line))


def detail(text: str) -> None:
    """Print what only a verbose command says."""
    if _verbose:
        _say(one_line(text))


@contextmanager
def progress(length: int) -> Iterator[Callable[[int], object]]:
    """Show a bar of `length` steps where stderr is a terminal; give what takes some of them."""
    if _quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    import typer

    global _bar_is_shown
    with typer.progressbar(length=length, file=sys.stderr, show_pos=True) as bar:
        _bar_is_shown = True
        try:
            yield bar.update
        finally:
            _bar_is_shown = False


def error(problem: MapdealError) -> None:
    """Print an error: one line, and its hint on a second."""
    _say(f"error: {problem}")
    if problem.hint:
        _say(f"hint: {one_line(problem.hint)}")


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
        else:
            warn(str(message))

    warnings.showwarning = show


def finish() -> None:
    """Write out what stdout still holds.

    Raises
    ------
    FileAccessError
        If it, or anything before, could not be written, other than because its reader has gone.
    """
    global _stdout_problem
    _to_stdout(sys.stdout.flush)
    problem, _stdout_problem = _stdout_problem, None
    if problem is not None:
        raise FileAccessError(f"cannot be written: {problem}", source="standard output")


def _print_result(text: str) -> None:
    _to_stdout(lambda: print(text))  # noqa: T201


def _to_stdout(write: Callable[[], None]) -> None:
    """Write, unless that has failed before; the work goes on, `finish` tells."""
    global _stdout_problem
    try:
        write()
    except BrokenPipeError:  # the reader has seen enough
        _drop_stdout()
    except OSError as error:
        _stdout_problem = error.strerror or str(error)
        _drop_stdout()


def _drop_stdout() -> None:
    """Point stdout at nothing, so that no later line and no flush complains."""
    global _stdout_dropped
    _stdout_dropped = True
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say(text: str) -> None:
    # What nobody can read on stderr must not change what is done, nor the exit code.
    with contextlib.suppress(OSError):
        clear = "\r\x1b[K" if _bar_is_shown else ""  # it is drawn again with the next step
        print(f"{clear}{text}", file=sys.stderr)  # noqa: T201
