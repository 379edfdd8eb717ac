"""Output of commands: results on stdout, messages on stderr."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from mapdeal.errors import FileAccessError, MapdealError, MapdealWarning, ParameterError, one_line

_CHUNK = 1 << 18
_FEW = 10
_CLEAR = "\r\x1b[K"
_WIDTH = 80  # of a terminal that does not report its own
PROGRESS_SECONDS = 10.0  # seconds between two lines of progress where there is no bar
_LINE_AFTER, _LINE_EVERY = 1.0, 0.5  # seconds until the first line of activity, and between two
_stdout_problem: str | None = None
_writing = threading.RLock()  # held while text is written, so that a line of progress cannot mix
_has_line = _has_bar = _stdout_dropped = _is_for_data = False
_quiet = _verbose = _strict = False
_called: dict[str, str] = {}
_warned: set[str] = set()


def configure(*, quiet: bool, verbose: bool, strict: bool = False) -> None:
    global _quiet, _verbose, _strict, _stdout_dropped, _is_for_data
    _quiet, _verbose, _strict = quiet, verbose, strict
    _stdout_dropped = _is_for_data = False
    _called.clear()
    _warned.clear()


def has_reader() -> bool:
    """Return whether results go to somebody's terminal, not to a file or a program."""
    return sys.stdout.isatty()


def leave_stdout_to_data(*, is_text: bool) -> None:
    """Send all text to stderr, because a file goes to stdout."""
    global _is_for_data
    if has_reader() and not is_text:
        hint = "pipe it into another command, or name a file"
        raise ParameterError("is a terminal, and an npz is not text", source="-o -", hint=hint)
    _is_for_data = True


def need_stdout() -> None:
    if _is_for_data:
        rule = "cannot be given together with -o -: both go to standard output"
        raise ParameterError(rule, source="--json", hint="name a file with -o")


def refuse_keyboard() -> None:
    if sys.stdin is not None and sys.stdin.isatty():
        hint = "mapdeal convert MAP -o - | mapdeal ... - takes a map from another command"
        raise ParameterError("is a terminal, and an npz is not text", source="-", hint=hint)


def call_file(path: Path, name: str) -> None:
    """Print `name` in place of the path of a file."""
    from urllib.parse import quote

    _called[path.as_uri()] = quote(name)
    _called[str(path)] = _called[json.dumps(str(path))[1:-1]] = name
    with contextlib.suppress(OSError):  # some reports use it from the working folder
        _called[quote(os.path.relpath(path))] = quote(name)


def _write_bytes(chunk: bytes) -> None:
    sys.stdout.buffer.write(chunk)


def send(path: Path) -> None:
    from mapdeal.files.source import chunks_of

    for chunk in chunks_of(path):
        if _stdout_dropped:
            return
        _to_stdout(partial(_write_bytes, chunk))
        _to_stdout(sys.stdout.buffer.flush)


def result(text: str) -> None:
    if _is_for_data:
        _print_message(text)
    else:
        _to_stdout(lambda: print(_as_called(text)))  # noqa: T201


def input_chunks() -> Iterator[bytes]:
    if sys.stdin is None:
        raise ParameterError("is closed", source="standard input")
    try:
        while chunk := os.read(sys.stdin.fileno(), _CHUNK):
            yield chunk
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source="standard input") from None


def stream(parts: Iterable[str]) -> None:
    for part in parts:
        result(part)
        _to_stdout(sys.stdout.flush)
        if _stdout_dropped:
            return


def warn(text: str) -> None:
    if _strict or not _quiet:
        _print_message(f"warning: {one_line(text)}")


@contextlib.contextmanager
def few_warnings(hint: str) -> Iterator[Callable[[str], None]]:
    count = 0

    def show(text: str) -> None:
        nonlocal count
        count += 1
        _warned.add(text)
        if count <= _FEW:
            warn(text)

    yield show
    if (more := count - _FEW) > 0:
        warn(f"{more} more warning{'s' * (more > 1)}; {hint}")


def summary(lines: Iterable[str], *, is_asked_for: bool = False) -> None:
    for line in lines if is_asked_for or not _quiet else ():
        result(_coloured(one_line(line), sys.stdout))


def remark(lines: Iterable[str]) -> None:
    for line in () if _quiet else lines:
        _print_message(one_line(line))


def detail(text: str) -> None:
    if _verbose:
        _print_message(one_line(text))


@contextlib.contextmanager
def activity_shown(command: str) -> Iterator[None]:
    """Show the work under way and its duration in a line of the terminal, then erase it."""
    if _quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield
        return
    from mapdeal.kernels.blocks import activities

    started, has_ended, names = time.monotonic(), threading.Event(), list[str]()

    def show() -> None:
        pause = _LINE_AFTER
        while not has_ended.wait(pause):
            pause = _LINE_EVERY
            doing = one_line(": ".join(dict.fromkeys([command, *names[-1:]])))
            with _writing:
                if not (has_ended.is_set() or _has_bar):
                    _show_line(f"{doing}, {time.monotonic() - started:.0f} s")

    token = activities.set(names)
    with contextlib.suppress(RuntimeError):  # the system allows no further thread
        threading.Thread(target=show, daemon=True).start()
    try:
        yield
    finally:
        activities.reset(token)
        has_ended.set()
        _show_line("")


def _show_line(text: str) -> None:
    global _has_line
    with _writing, contextlib.suppress(OSError):
        if text or _has_line:
            width = os.get_terminal_size(sys.stderr.fileno()).columns or _WIDTH
            _has_line = bool(text)
            print(f"{_CLEAR}{text[: width - 1]}", end="", file=sys.stderr, flush=True)  # noqa: T201


@contextlib.contextmanager
def counted(steps: int, noun: str | None = None) -> Iterator[Callable[..., object]]:
    """Yield a function that shows progress: in a bar, or in lines about things with a noun."""
    global _has_bar
    bar: Any = None
    steps_done = failures = 0
    printed_at = time.monotonic()

    def failures_text(_: object = None) -> str | None:
        return f"{failures} failed" if failures else None

    def advance(count: int = 1, *, failed: bool = False) -> None:
        nonlocal steps_done, failures, printed_at
        steps_done += count
        failures += failed
        if bar is not None:
            with contextlib.suppress(OSError):
                bar.update(count)
        elif noun and not _quiet and time.monotonic() > printed_at + PROGRESS_SECONDS:
            printed_at = time.monotonic()
            text = f"{steps_done} of {steps} {noun}s done"
            _print_message(", ".join(filter(None, [text, failures_text()])))

    if not steps or _quiet or not sys.stderr.isatty():
        yield advance
        return
    import typer

    bar = typer.progressbar(
        length=steps, file=sys.stderr, show_pos=noun is not None, info_sep=", ",
        bar_template="[%(bar)s] %(info)s", item_show_func=failures_text,
    )  # fmt: skip
    with _writing:
        _show_line("")
        _has_bar = True
    bar.__enter__()
    try:
        yield advance
    finally:
        _has_bar = False
        with contextlib.suppress(OSError):
            bar.__exit__(None, None, None)


@contextlib.contextmanager
def blocks_done(steps: int) -> Iterator[Callable[[int], object]]:
    detail("processed in blocks of rows")
    with counted(steps) as advance:
        yield advance


def error(problem: MapdealError) -> None:
    _print_message(f"error: {problem}")
    if problem.hint:
        _print_message(f"hint: {one_line(problem.hint)}")


def prepare() -> None:
    """Print warnings on one line each, and escape characters that a stream cannot encode."""
    configure(quiet=False, verbose=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # files have any names
    warnings.simplefilter("always", MapdealWarning)
    original = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *details: Any) -> None:
        if not issubclass(category, MapdealWarning):
            original(message, category, *details)
        elif (text := str(message)) not in _warned:  # a map may be read more than once
            _warned.add(text)
            warn(text)

    warnings.showwarning = show  # type: ignore[assignment]


def lost() -> FileAccessError | None:
    """Flush stdout; return an error if results have been lost."""
    global _stdout_problem
    _to_stdout(sys.stdout.flush)
    problem, _stdout_problem = _stdout_problem, None
    if problem is None:
        return None
    return FileAccessError(f"cannot be written: {problem}", source="standard output")


def _as_called(text: str) -> str:
    for path, name in _called.items():
        text = text.replace(path, name)
    return text


def _to_stdout(write: Callable[[], object]) -> None:
    """Write to stdout; after a failure, which `lost` reports, discard all further output."""
    global _stdout_problem, _stdout_dropped
    try:
        with _writing:
            _show_line("")
            write()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):  # the reader has closed the pipe
            _stdout_problem = error.strerror or str(error)
        _stdout_dropped = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


_COLOURS = {"error": "31;1", "warning": "33", "note": "34", "hint": "36"}
_SEVERITY = re.compile(r"(^|: )(error|warning|note|hint):")


def _print_message(text: str) -> None:
    # A closed stderr must not change the outputs or the exit code.
    with _writing, contextlib.suppress(OSError):
        _show_line("")
        text = _coloured(_as_called(text), sys.stderr)
        print(f"{_CLEAR if _has_bar else ''}{text}", file=sys.stderr)  # noqa: T201


def _coloured(text: str, stream: TextIO) -> str:
    """Colour the severity at the start of a line or after a file's name, on a terminal."""
    if not _has_colours(stream):
        return text
    return _SEVERITY.sub(lambda found: f"{found[1]}\x1b[{_COLOURS[found[2]]}m{found[2]}:\x1b[0m",
                         text, count=1)  # fmt: skip


def bold(title: str) -> str:
    return f"\x1b[1m{title}\x1b[0m" if _has_colours(sys.stdout) else title


def _has_colours(stream: TextIO) -> bool:
    is_plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return stream.isatty() and not is_plain


DASH = Path("-")  # the word ``-``; the file of this name is ``./-``, which is made an absolute path


@contextlib.contextmanager
def piped(
    values: Mapping[str, Any], streams: Mapping[str, bool], *, ending: str = ".npz"
) -> Iterator[dict[str, Any]]:
    """Yield values with files in place of standard streams; at the end send the output's."""
    dashed = [name for name in values if name != "output" and _dashes(values[name])]
    inputs = [name for name in dashed if not streams.get(name)]
    streamed_inputs = [name for name in inputs if name in streams]
    output = next((n for n, is_output in streams.items() if is_output and values[n] == DASH), None)
    if not streamed_inputs and output is None:
        yield dict(values)
        return
    if streamed_inputs and values.get("in_place"):
        rule = "is standard input, which cannot be repaired in place"
        raise ParameterError(rule, source="-", hint="--fix -o OUT writes a repaired map")
    if sum(_dashes(values[name]) for name in inputs) > 1 and streamed_inputs:
        rule = "can be used for one input only: standard input is one file"
        raise ParameterError(rule, source="-")
    from mapdeal.files.transaction import temporary_folder
    from mapdeal.maps.kinds import STDOUT, save_npz

    if output is not None:
        leave_stdout_to_data(is_text=ending != ".npz")
    if streamed_inputs:
        refuse_keyboard()
    with temporary_folder() as folder:
        call_file(folder / f"{STDOUT}{ending}", STDOUT)
        files = dict(values)
        for name in streamed_inputs:
            npz_path = save_npz(input_chunks(), folder)
            call_file(npz_path, "standard input")
            files[name] = _replaced(values[name], npz_path)
        if output is not None:
            files[output] = folder / f"{STDOUT}{ending}"
        yield files
        if output is not None:
            send(files[output])


def _dashes(value: object) -> int:
    return sum(str(item) == "-" for item in (value if isinstance(value, list) else [value]))


def _replaced(value: Any, path: Path) -> Any:
    if isinstance(value, list):
        return [_replaced(item, path) if _dashes(item) else item for item in value]
    return str(path) if isinstance(value, str) else path
