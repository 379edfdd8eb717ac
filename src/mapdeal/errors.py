"""The errors and the warning that mapdeal raises on purpose.

Each error class owns the exit code that the command line ends with, so that no
other place has to decide it. Anything else that escapes is a bug (exit 70).
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import ClassVar, Self

from mapdeal.records import dataclass

__all__ = [
    "BatchError",
    "FileAccessError",
    "FindingError",
    "MalformedInputError",
    "MapdealError",
    "MapdealWarning",
    "ParameterError",
]

_MISSING = object()
_HINT = "hint: "


class MapdealWarning(UserWarning):
    """A choice that the tool had to make, or a trap in the input, that users should know of.

    Parameters
    ----------
    text : str
        What it is, in one line.
    check : str, optional
        The name of the check of ``mapdeal lint`` that finds it, ``area.name``.
    """

    def __init__(self, text: str, check: str | None = None) -> None:
        super().__init__(text)
        self.check = check


@dataclass(frozen=True)
class KeptWarning:
    """A warning that has not been given yet.

    Parameters
    ----------
    message : MapdealWarning
        The warning.
    filename : str
        The file of the code that it is about, as Python's filters know it.
    line : int
        The line in it.
    """

    message: MapdealWarning
    filename: str
    line: int

    def emit(self) -> None:
        """Give it, to whoever keeps warnings, else to Python's filters."""
        kept = _KEPT.get()
        if kept is None:
            warnings.warn_explicit(self.message, MapdealWarning, self.filename, self.line)
        else:
            kept.append(self)


_KEPT: ContextVar[list[KeptWarning] | None] = ContextVar("mapdeal_kept_warnings", default=None)


def emit_warning(message: str | MapdealWarning, *, stacklevel: int = 1) -> None:
    """Warn of something, as `warnings.warn` does, unless `kept_warnings` is to hear of it."""
    kept = _KEPT.get()
    warning = MapdealWarning(message) if isinstance(message, str) else message
    if kept is None:
        warnings.warn(warning, stacklevel=stacklevel + 1)
        return
    try:
        code = sys._getframe(stacklevel)  # noqa: SLF001 - as `warnings` itself does
        kept.append(KeptWarning(warning, code.f_code.co_filename, code.f_lineno))
    except ValueError:  # the stack is not as deep
        kept.append(KeptWarning(warning, "sys", 1))


@contextmanager
def kept_warnings() -> Iterator[list[KeptWarning]]:
    """Keep the warnings of the block, and of the threads that share its work, in a list.

    Python's own means change the filters of the whole process: of two threads that read maps at
    once, one would receive the warnings of the other, and both would leave wrong filters behind.
    """
    kept: list[KeptWarning] = []
    before = _KEPT.set(kept)
    try:
        yield kept
    finally:
        _KEPT.reset(before)


class MapdealError(Exception):
    """Base of all errors that are the input's or the user's, not the program's.

    Parameters
    ----------
    rule : str
        What is allowed or what went wrong, in one line.
    source : path or str, optional
        The file (or option) that is at fault.
    place : str, optional
        The key, line or cell inside it.
    got : object, optional
        The value that was found.
    hint : str, optional
        What to do about it, one line.
    """

    exit_code: ClassVar[int] = 70

    def __init__(
        self,
        rule: str,
        *,
        source: Path | str | None = None,
        place: str | None = None,
        got: object = _MISSING,
        hint: str | None = None,
    ) -> None:
        self.rule = rule
        self.source = source
        self.place = place
        self.hint = hint
        # The text, not the value: an error crosses from process to process as it is shown.
        self._got = None if got is _MISSING else shown(got)
        super().__init__(rule)

    @property
    def hint(self) -> str | None:
        """What to do about it; Python shows it below the error, as a note."""
        return self._hint

    @hint.setter
    def hint(self, text: str | None) -> None:
        notes = [note for note in getattr(self, "__notes__", ()) if not note.startswith(_HINT)]
        self.__notes__ = [*notes, _HINT + text] if text else notes
        self._hint = text

    def found_in(self, source: Path | str) -> Self:
        """Return the error with the file it belongs to, unless it names one already."""
        if self.source is None:
            self.source = source
        return self

    def __str__(self) -> str:
        """Return ``SOURCE: PLACE: rule, got VALUE`` on one line, control characters escaped."""
        parts = [] if self.source is None else [str(self.source)]
        parts += [_short(part) for part in (self.place, self.rule) if part is not None]
        text = ": ".join(parts)
        if self._got is not None:
            text += f", got {self._got}"
        return one_line(text)


class FindingError(MapdealError):
    """What a check was asked to look for and has found: the input is well-formed."""

    exit_code = 1


class ParameterError(MapdealError, ValueError):
    """A parameter, recipe or usage that is not allowed."""

    # The only one with a built-in base: an "except OSError" around file access must never
    # swallow a FileAccessError.

    exit_code = 2

    def in_file(self, source: Path | str, place: str | None = None) -> MalformedInputError:
        """Return the error as one about what a file holds, at a place in it."""
        self.place = ": ".join(part for part in (place, self.place) if part) or None
        return MalformedInputError(str(self), source=source, hint=self.hint)


class MalformedInputError(MapdealError):
    """An input file whose contents break its format's rules."""

    exit_code = 3


class FileAccessError(MapdealError):
    """A file that cannot be read or written, or an output that exists already."""

    exit_code = 4
    is_missing = False
    """Whether there is no such file."""


class BatchError(MapdealError):
    """A batch that finished although some of its inputs failed."""

    exit_code = 5


def _short(text: str, limit: int = 400) -> str:
    """Return a text that may quote a file, cut where nobody reads on."""
    return text if len(text) <= limit else f"{text[:limit]}..."


def one_line(text: str) -> str:
    """Return `text` with control characters escaped, so that it stays on its line."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown(value: object, limit: int = 60) -> str:
    """Return a value as an error message shows it: short, text in quotes."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print numbers of many thousand digits
        text = f"a very long {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."
