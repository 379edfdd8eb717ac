"""Points, pairs of them, and poses as lines of text: CSV or JSON lines, read as they come."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, shown
from mapdeal.formats.poses import TUM, planar_pose
from mapdeal.formats.text_rows import delimiter_of, is_number
from mapdeal.grid.frame import Point
from mapdeal.records import dataclass

_LONGEST_LINE = 1 << 16
_LINE_FEED = ord("\n")
_IN_PAIR = 4
_Found = TypeVar("_Found", bound=tuple[Any, ...])
_NO_NUMBERS = (ValueError, TypeError, LookupError, OverflowError, RecursionError)


@dataclass(frozen=True, eq=False)
class NumberLines:
    """Numbers of some lines, shape (N, 2) of points, (N, 3) of poses."""

    numbers: NDArray[np.float64]
    lines: Sequence[int]
    errors: dict[int, str]


@dataclass(frozen=True)
class PairLine:
    """A start and a goal, or what is wrong with the line that should hold them."""

    line: int
    start: Point | None = None
    goal: Point | None = None
    error: str | None = None


@dataclass(frozen=True)
class NamedPointLine:
    """A point with a name if it has one, or what is wrong with the line that should hold it."""

    line: int
    point: Point | None = None
    name: str | None = None
    error: str | None = None


def read_points(chunks: Iterable[bytes], source: Path | str) -> Iterator[NumberLines]:
    """Yield the points of a text, those of each chunk as soon as its lines are complete."""
    for text, first in _complete_lines(chunks, source):
        yield _parsed(text, first, _POINT)


def read_pose_lines(chunks: Iterable[bytes], source: Path | str) -> Iterator[NumberLines]:
    """Yield the poses of a text, those of each chunk as soon as its lines are complete."""
    for text, first in _complete_lines(chunks, source):
        yield _parsed(text, first, _POSE)


def read_pairs(chunks: Iterable[bytes], source: Path | str) -> Iterator[PairLine]:
    """Yield pairs of points, each as soon as its line is complete."""
    json_form = '{"from": [x, y], "to": [x, y]} or [[x, y], [x, y]]'
    for number, text in _told_lines(chunks, source, _is_header_of_pairs):
        found, error = _line_of(text, _pair_of, "four numbers x,y,x,y", json_form)
        start, goal = found or (None, None)
        yield PairLine(number, start, goal, error)


def read_named_points(chunks: Iterable[bytes], source: Path | str) -> Iterator[NamedPointLine]:
    """Yield points that may have names, each as soon as its line is complete."""
    json_form = '{"x": x, "y": y}, with a "name" if it has one, or [x, y]'
    for number, text in _told_lines(chunks, source, _POINT.is_header):
        found, error = _line_of(text, _named_point_of, "x,y or NAME=x,y", json_form)
        point, name = found or (None, None)
        yield NamedPointLine(number, point, name, error)


def _told_lines(
    chunks: Iterable[bytes], source: Path | str, is_header: Callable[[str], bool]
) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that are no comment, nor a header in the first place."""
    for some, first in _complete_lines(chunks, source):
        for number, raw in enumerate(some.split(b"\n"), first):
            text = _text_of(raw)
            if not (text.startswith("#") or (number == 1 and is_header(text))):
                yield number, text


def _complete_lines(chunks: Iterable[bytes], source: Path | str) -> Iterator[tuple[bytes, int]]:
    """Yield the lines that each chunk completes, without the last end, and the first's number."""
    rest, line = b"", 1
    for chunk in chunks:
        text = rest + chunk
        end = text.rfind(b"\n")
        rest = text[end + 1 :]
        long = _first_long_line(text)
        short = text[:end] if long is None else text[: max(0, long - 1)]
        if end >= 0 and long != 0:
            yield _unmarked(short, line), line
            line += _line_count(short)
        if long is not None:
            rule = f"a line must not be longer than {_LONGEST_LINE} bytes"
            raise MalformedInputError(rule, source=source, place=f"line {line}")
    if rest:
        yield _unmarked(rest, line), line


def _line_count(text: bytes) -> int:
    # bytes.count is made for what is rare
    return 1 + int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == _LINE_FEED))


def _first_long_line(text: bytes) -> int | None:
    start = 0
    while len(text) - start > _LONGEST_LINE:
        end = text.rfind(b"\n", start, start + _LONGEST_LINE + 1)
        if end < 0:
            return start
        start = end + 1  # the lines before it are all shorter than what was looked at
    return None


def _unmarked(text: bytes, first: int) -> bytes:
    """Return lines of a text without its mark of byte order."""
    return text.removeprefix(b"\xef\xbb\xbf") if first == 1 else text


def _text_of(line: bytes) -> str:
    return line.decode("utf-8", errors="replace").strip()


class _Form(NamedTuple):
    names: tuple[str, ...]
    how_many: str
    more: str = ""

    def rule(self, text: str) -> str:
        """Return what a line that begins as `text` must be."""
        if text[:1] not in ("{", "["):
            return f"{self.how_many} numbers {','.join(self.names)}{self.more}"
        keys = ", ".join(f'"{name}": {name}' for name in self.names)
        return f"{{{keys}}} or [{', '.join(self.names)}]"

    def delimiter(self, text: str) -> str | None:
        """Return what stands between numbers; white space is None."""
        return delimiter_of(text) if self.more else ","

    def is_header(self, text: str) -> bool:
        """Return whether a line has the names of its columns."""
        words = [word.strip(' "') for word in text.lower().split(self.delimiter(text))]
        if self.more:  # as files of poses: people write theta, too
            return len(words) in (len(self.names), len(TUM)) and not any(map(is_number, words))
        return words == [*self.names]


_POINT = _Form(("x", "y"), "two")
_POSE = _Form(("x", "y", "yaw"), "three", f", or TUM's {' '.join(TUM)}")


def _parsed(text: bytes, first: int, form: _Form) -> NumberLines:
    if first == 1:
        head, end, others = text.partition(b"\n")
        if end and form.is_header(_text_of(head)):
            text, first = others, 2
    at_once = _parsed_at_once(text, first, form)
    if at_once is not None:
        return NumberLines(*at_once, {})
    rows: list[Sequence[float]] = []
    kept: list[int] = []
    errors: dict[int, str] = {}
    for number, raw in enumerate(text.split(b"\n"), first):
        line = _text_of(raw)
        if line.startswith("#") or (number == 1 and form.is_header(line)):
            continue
        try:
            rows.append(_row_of(line, form))
        except MalformedInputError as error:
            errors[len(rows)] = f"{error.rule}, got {shown(line)}"
        except _NO_NUMBERS:
            rule = f"must be {form.rule(line)}, got {shown(line)}"
            errors[len(rows)] = rule if line else "empty line"
        else:
            if not all(map(math.isfinite, rows[-1])):
                errors[len(rows) - 1] = f"must be finite, got {shown(line)}"
        if len(rows) == len(kept):
            rows.append([math.nan] * len(form.names))
        kept.append(number)
    numbers = np.array(rows, dtype=np.float64).reshape(-1, len(form.names))
    return NumberLines(numbers, kept, errors)


def _parsed_at_once(
    text: bytes, first: int, form: _Form
) -> tuple[NDArray[np.float64], Sequence[int]] | None:
    """Return the numbers of lines, and which these are, if all are plain numbers."""
    # numpy takes more characters for blanks, and warns of a text without numbers
    if text.translate(None, b"0123456789+-.eE, \t\r\n") or not text.strip():
        return None
    delimiter = form.delimiter("," if b"," in text else " ")
    try:
        numbers = np.loadtxt(io.BytesIO(text), delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    lines = range(first, first + _line_count(text))
    # empty lines were passed over, and 1e999 is infinite
    is_plain = numbers.shape == (len(lines), len(form.names))
    return (numbers, lines) if is_plain and np.isfinite(numbers).all() else None


def _row_of(text: str, form: _Form) -> Sequence[float]:
    if text[:1] in ("{", "["):
        return _row_of_json(json.loads(text), form)
    numbers = _numbers_of(text, form.delimiter(text))
    if form.more and len(numbers) == len(TUM):
        return planar_pose(numbers)
    if len(numbers) != len(form.names):
        raise ValueError
    return numbers


def _row_of_json(value: Any, form: _Form) -> Sequence[float]:
    row = [value[name] for name in form.names] if isinstance(value, dict) else list(value)
    if len(row) != len(form.names) or any(type(one) not in (int, float) for one in row):
        raise ValueError  # bools are ints, too
    return [float(one) for one in row]


def _point_of_json(value: Any) -> Point:
    x, y = _row_of_json(value, _POINT)
    return x, y


def _numbers_of(text: str, delimiter: str | None = ",") -> list[float]:
    if not text.isascii() or "_" in text:  # which Python reads as digits, too
        raise ValueError
    return [float(part) for part in text.split(delimiter)]


def _line_of(
    text: str, parse: Callable[[str], _Found], form: str, json_form: str
) -> tuple[_Found | None, str | None]:
    try:
        found = parse(text)
    except _NO_NUMBERS:
        rule = json_form if text[:1] in ("{", "[") else form
        return None, f"must be {rule}, got {shown(text)}" if text else "empty line"
    places = (place for place in found if isinstance(place, tuple))
    if not all(math.isfinite(number) for place in places for number in place):
        return None, f"must be finite, got {shown(text)}"
    return found, None


def _pair_of(text: str) -> tuple[Point, Point]:
    if text[:1] in ("{", "["):
        value = json.loads(text)
        start, goal = (value["from"], value["to"]) if isinstance(value, dict) else value
        return _point_of_json(start), _point_of_json(goal)
    start_x, start_y, goal_x, goal_y = _numbers_of(text)
    return (start_x, start_y), (goal_x, goal_y)


def _named_point_of(text: str) -> tuple[Point, str | None]:
    if text[:1] in ("{", "["):
        value = json.loads(text)
        name = value.get("name") if isinstance(value, dict) else None
        if name is not None and not (isinstance(name, str) and name.strip()):
            raise ValueError
        return _point_of_json(value), name
    name, equals, place = text.rpartition("=")
    if equals and (not name.strip() or "," in name):
        raise ValueError
    x, y = _numbers_of(place)
    return (x, y), name.strip() or None


def _is_header_of_pairs(text: str) -> bool:
    words = [word.strip(' "') for word in text.split(",")]
    return len(words) == _IN_PAIR and all(
        word.isidentifier() and word.lower() not in ("nan", "inf", "infinity") for word in words
    )
