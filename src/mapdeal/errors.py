"""Errors and warnings of mapdeal.

Each class has the exit code of the command line. Other exceptions are bugs, with exit code 70.
"""

from __future__ import annotations

import errno
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
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


_Listener = tuple[list[MapdealWarning], bool]  # of a block, and whether outer blocks are skipped
_LISTENERS: ContextVar[tuple[_Listener, ...]] = ContextVar("mapdeal_listeners", default=())
_REWORD: ContextVar[Callable[[str], str]] = ContextVar("mapdeal_reword", default=str)
_STRICT: ContextVar[tuple[list[MapdealWarning], ...]] = ContextVar("mapdeal_strict", default=())


def is_called_by_user(above: int = 0) -> bool:
    """Return whether code other than mapdeal's called the function that asks, or one above it."""
    frame: FrameType | None = sys._getframe(2 + above)  # noqa: SLF001
    while frame is not None and frame.f_globals.get("__name__") == "dataclasses":  # replace
        frame = frame.f_back
    return frame is None or not _is_own(frame)


def _is_own(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).partition(".")[0] == "mapdeal"


def emit_warning(message: str | MapdealWarning) -> None:
    """Emit a warning at the caller of mapdeal, also to enclosing blocks that collect warnings."""
    warning = MapdealWarning(_REWORD.get()(message)) if isinstance(message, str) else message
    for collected, captures in reversed(_LISTENERS.get()):
        collected.append(warning)
        if captures:
            return
    outermost, depth, frame = 1, 1, sys._getframe().f_back  # noqa: SLF001
    while frame is not None:
        depth += 1
        if _is_own(frame):
            outermost = depth
        frame = frame.f_back
    warnings.warn(warning, stacklevel=outermost + 1)


@contextmanager
def reworded(reword: Callable[[str], str]) -> Iterator[None]:
    """Change the words of warnings and errors, such as options to parameters of a function."""
    before = _REWORD.set(reword)
    try:
        yield
    except MapdealError as error:
        for part in ("source", "place", "rule", "hint"):
            if isinstance(text := getattr(error, part), str):
                setattr(error, part, reword(text))
        raise
    finally:
        _REWORD.reset(before)


@contextmanager
def collect_warnings(*, captures: bool = False) -> Iterator[list[MapdealWarning]]:
    """Collect the warnings of the block, and of the threads that share its work, in a list."""
    collected: list[MapdealWarning] = []
    before = _LISTENERS.set((*_LISTENERS.get(), (collected, captures)))
    try:
        yield collected
    finally:
        _LISTENERS.reset(before)


def capture_warnings() -> AbstractContextManager[list[MapdealWarning]]:
    """Capture the warnings of the block and of threads that share its work, unseen outside."""
    # `warnings.catch_warnings` changes the filters of the process, also for other threads.
    return collect_warnings(captures=True)


@contextmanager
def strict_warnings(is_strict: bool = True, source: Path | str | None = None) -> Iterator[None]:
    """Turn warnings of the block into a FindingError about `source`; no output appears then."""
    if not is_strict:
        yield
        return
    with collect_warnings() as collected:
        before = _STRICT.set((*_STRICT.get(), collected))
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
    """Raise FindingError if an enclosing `strict_warnings` block has collected a warning."""
    if count := max((len(set(map(str, collected))) for collected in _STRICT.get()), default=0):
        text = "1 warning" if count == 1 else f"{count} warnings"
        raise FindingError(f"{text}, and --strict allows none{consequence}")


class MapdealError(Exception):
    """Base class of all errors caused by the input or the user rather than by a bug.

    Parameters
    ----------
    rule : str
        Rule that was broken, or the problem, one line.
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
        self, rule: str, *, source: Path | str | None = None, place: str | None = None,
        got: object = _MISSING, hint: str | None = None,
    ) -> None:  # fmt: skip
        self.rule = rule
        self.source = source
        self.place = place
        self.hint = hint
        # text instead of the value, because errors are pickled between processes
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

    # The only class with a built-in base besides Exception: an "except OSError" around file access
    # must never catch a FileAccessError.

    exit_code = 2

    def in_file(self, source: Path | str, place: str | None = None) -> MalformedInputError:
        """Return the error as a `MalformedInputError` about a place in a file."""
        self.place = ": ".join(part for part in (place, self.place) if part) or None
        return MalformedInputError(str(self), source=source, hint=self.hint)


def require(holds: bool, rule: str, place: str | None = None, *, got: object) -> None:
    if not holds:
        raise ParameterError(rule, place=place, got=got)


class MalformedInputError(MapdealError):
    """The contents of an input file violate its format."""

    exit_code = 3


class FileAccessError(MapdealError):
    """A file cannot be read or written, or an output already exists."""

    exit_code = 4
    is_missing = False  # whether there is no such file


class BatchError(MapdealError):
    """A batch finished, but some of its inputs failed."""

    exit_code = 5


_OUT_OF_MEMORY = (
    "without exception set", "without setting an exception", "without raising an exception",
    "raised unreported exception",
)  # fmt: skip
"""Texts of Python's SystemError if there is no memory for an exception object."""


def refusal_of_the_system(error: Exception, source: Path | None = None) -> MapdealError | None:
    """Return the error to report if the system lacks a resource or a library cannot be loaded."""
    hint = "ulimit -a shows the limits of processes, memory and open files"
    is_out = isinstance(error, SystemError) and any(text in str(error) for text in _OUT_OF_MEMORY)
    if is_out or isinstance(error, MemoryError):
        return MalformedInputError("not enough memory for a map of this size", source=source)
    if isinstance(error, OSError) and error.errno in _EXHAUSTED:
        rule = f"a system resource is exhausted: {error.strerror}"
        return FileAccessError(rule, source=source, hint=hint)
    if isinstance(error, ImportError) and not (error.name or "").startswith("mapdeal"):
        first: BaseException = error
        while first.__cause__ is not None:  # numpy wraps it in long advice
            first = first.__cause__
        return FileAccessError(f"a library cannot be loaded: {first}", source=source, hint=hint)
    return None


def _short(text: str, limit: int = 400) -> str:
    return text if len(text) <= limit else f"{text[:limit]}..."


def one_line(text: str) -> str:
    """Return `text` on one line, with control characters escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown(value: object, limit: int = 60) -> str:
    """Return a value for error messages: shortened, texts in quotes."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print numbers of many thousand digits
        text = f"a very long {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."


BRITISH_AND_AMERICAN = (("centre", "center"), ("disc", "disk"))  # choices accept both
_SIMILAR = 0.75  # least difflib ratio of words with other first letters, as nflate and inflate


def _plain(word: str) -> str:
    plain = word.lower().replace("_", "-")
    for british, american in BRITISH_AND_AMERICAN:
        plain = plain.replace(british, american)
    return plain


def as_known(word: str, known: Iterable[str]) -> str:
    """Return the known word with another spelling of `word`, or else `word` itself."""
    names = list(known)
    if word in names:
        return word
    return next((name for name in names if _plain(name) == _plain(word)), word)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the most similar known word, or the only one that `word` abbreviates, if any."""
    import difflib  # only mistakes need it

    names, start = {_plain(name): name for name in reversed(list(known))}, _plain(word)
    for plain in difflib.get_close_matches(start, names):
        if plain[0] == start[0] or difflib.SequenceMatcher(None, plain, start).ratio() >= _SIMILAR:
            return names[plain]
    longer = [name for plain, name in names.items() if len(start) > 2 and plain.startswith(start)]
    return longer[0] if len(longer) == 1 else None


def nearest_hint(word: str, known: Iterable[str]) -> str | None:
    near = nearest(word, known)
    return None if near is None else f"did you mean {near}?"
