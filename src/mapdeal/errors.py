"""The errors and the warning that mapdeal raises on purpose.

Each error class owns the exit code that the command line ends with, so that no
other place has to decide it. Anything else that escapes is a bug (exit 70).
"""

from __future__ import annotations

import errno
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import ClassVar

from mapdeal.compatibility import Self

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN)
_MISSING = object()
_HINT = "hint: "


class MapdealWarning(UserWarning):
    """Warning about a choice that mapdeal had to make, or about a pitfall in the input.

    Parameters
    ----------
    text : str
        Message, one line.
    check : str, optional
        Name of the ``mapdeal lint`` check that reports the same problem, ``area.name``.
    """

    def __init__(self, text: str, check: str | None = None) -> None:
        super().__init__(text)
        self.check = check


_LISTENERS: ContextVar[tuple[tuple[list[MapdealWarning], bool], ...]] = ContextVar(
    "mapdeal_listeners", default=()
)
"""Where the enclosing blocks collect warnings, and whether nobody further out gets them."""

_STRICT: ContextVar[tuple[list[MapdealWarning], ...]] = ContextVar("mapdeal_strict", default=())


def emit_warning(message: str | MapdealWarning, *, stacklevel: int = 1) -> None:
    """Emit a warning like `warnings.warn`, also to enclosing blocks that listen to warnings."""
    warning = MapdealWarning(message) if isinstance(message, str) else message
    for heard, keeps in reversed(_LISTENERS.get()):
        heard.append(warning)
        if keeps:
            return
    while sys._getframe(stacklevel).f_code.co_name == "checked_call":  # noqa: SLF001
        stacklevel += 1  # the wrapper around public functions is not whom a warning is for
    warnings.warn(warning, stacklevel=stacklevel + 1)


@contextmanager
def heard_warnings(*, keep: bool = False) -> Iterator[list[MapdealWarning]]:
    """Collect the warnings of the block, and of the threads that share its work, in a list."""
    heard: list[MapdealWarning] = []
    before = _LISTENERS.set((*_LISTENERS.get(), (heard, keep)))
    try:
        yield heard
    finally:
        _LISTENERS.reset(before)


def kept_warnings() -> AbstractContextManager[list[MapdealWarning]]:
    """Keep the warnings of the block, and of the threads that share its work, in a list.

    Python's own means change the filters of the whole process: of two threads that read maps at
    once, one would receive the warnings of the other, and both would leave wrong filters behind.
    """
    return heard_warnings(keep=True)


@contextmanager
def strict_warnings(is_strict: bool = True, source: Path | str | None = None) -> Iterator[None]:
    """Turn warnings of the block into a FindingError about `source`; no output appears then."""
    if not is_strict:
        yield
        return
    with heard_warnings() as heard:
        before = _STRICT.set((*_STRICT.get(), heard))
        try:
            yield
            refuse_warnings("")
        except FindingError as error:
            if source is not None:
                error.found_in(source)
            raise
        finally:
            _STRICT.reset(before)


def refuse_warnings(consequence: str = "; nothing was written") -> None:
    """Raise FindingError if an enclosing `strict_warnings` block has been warned of something."""
    count = max((len(set(map(str, heard))) for heard in _STRICT.get()), default=0)
    if count:
        told = "1 warning" if count == 1 else f"{count} warnings"
        raise FindingError(f"{told}, and --strict allows none{consequence}")


class MapdealError(Exception):
    """Base class of all errors caused by the input or the user rather than by a bug.

    Parameters
    ----------
    rule : str
        Description of what is allowed or what went wrong, one line.
    source : path or str, optional
        File (or option) at fault.
    place : str, optional
        Key, line or cell within the source.
    got : object, optional
        Value that was found.
    hint : str, optional
        Suggestion for the user, one line.
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
        """Suggestion for the user; Python shows it below the error, as a note."""
        return self._hint

    @hint.setter
    def hint(self, text: str | None) -> None:
        notes = [note for note in getattr(self, "__notes__", ()) if not note.startswith(_HINT)]
        self.__notes__ = [*notes, _HINT + text] if text else notes
        self._hint = text

    def found_in(self, source: Path | str) -> Self:
        """Return the error with its file set to `source`, unless it already has one."""
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
    """A requested check failed, although the input is well-formed."""

    exit_code = 1


class ParameterError(MapdealError, ValueError):
    """A parameter, recipe or usage is invalid."""

    # The only one with a built-in base: an "except OSError" around file access must never
    # swallow a FileAccessError.

    exit_code = 2

    def in_file(self, source: Path | str, place: str | None = None) -> MalformedInputError:
        """Return the error as a `MalformedInputError` about a place in a file."""
        self.place = ": ".join(part for part in (place, self.place) if part) or None
        return MalformedInputError(str(self), source=source, hint=self.hint)


class MalformedInputError(MapdealError):
    """The contents of an input file violate its format."""

    exit_code = 3


class FileAccessError(MapdealError):
    """A file cannot be read or written, or an output already exists."""

    exit_code = 4
    is_missing = False
    """Whether there is no such file."""


class BatchError(MapdealError):
    """A batch finished, but some of its inputs failed."""

    exit_code = 5


_UNSAID = (
    "without exception set", "without setting an exception", "without raising an exception",
    "raised unreported exception",
)  # fmt: skip
"""What Python's SystemError says where there was no memory for the exception itself."""


def refusal_of_the_system(error: Exception, source: Path | None = None) -> MapdealError | None:
    """Return what to report if the system has no more to give, or a library cannot be loaded.

    Such errors can come from anywhere, also from imports within libraries.
    """
    hint = "ulimit -a shows the limits of processes, memory and open files"
    is_out = isinstance(error, SystemError) and any(words in str(error) for words in _UNSAID)
    if is_out or isinstance(error, MemoryError):
        return MalformedInputError("not enough memory for a map of this size", source=source)
    if isinstance(error, OSError) and error.errno in _EXHAUSTED:
        rule = f"the system has no more to give: {error.strerror}"
        return FileAccessError(rule, source=source, hint=hint)
    if isinstance(error, ImportError) and not (error.name or "").startswith("mapdeal"):
        first: BaseException = error
        while first.__cause__ is not None:  # numpy wraps it into advice of many lines
            first = first.__cause__
        return FileAccessError(f"a library cannot be loaded: {first}", source=source, hint=hint)
    return None


def _short(text: str, limit: int = 400) -> str:
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


BRITISH_AND_AMERICAN = (("centre", "center"), ("disc", "disk"))
"""Spellings of one word, in choices and in names: either is as good."""

_ALIKE = 0.75
"""From this ratio on words with different first letters are alike: nflate and inflate."""


def _plain(word: str) -> str:
    plain = word.lower().replace("_", "-")
    for british, american in BRITISH_AND_AMERICAN:
        plain = plain.replace(british, american)
    return plain


def as_known(word: str, known: Iterable[str]) -> str:
    """Return the known word that `word` is another spelling of; `word` itself if there is none."""
    names = list(known)
    if word in names:
        return word
    return next((name for name in names if _plain(name) == _plain(word)), word)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that `word` is most like, or alone begins with it; None if none is.

    What begins with another letter must be more alike.
    """
    import difflib  # of use to mistakes alone

    plain, asked = {_plain(name): name for name in reversed(list(known))}, _plain(word)
    for near in difflib.get_close_matches(asked, plain):
        if near[0] == asked[0] or difflib.SequenceMatcher(None, near, asked).ratio() >= _ALIKE:
            return plain[near]
    begun = [name for near, name in plain.items() if len(asked) > 2 and near.startswith(asked)]
    return begun[0] if len(begun) == 1 else None


def meant(word: str, known: Iterable[str]) -> str | None:
    """Return the hint that asks for the nearest known word, if there is one."""
    near = nearest(word, known)
    return None if near is None else f"did you mean {near}?"
