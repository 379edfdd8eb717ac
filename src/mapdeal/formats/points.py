"""Points, and pairs of them, as lines of text: CSV or JSON lines, read as they come."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, shown
from mapdeal.grid.coordinates import Point

_LONGEST_LINE = 1 << 16
_IN_PAIR = 4
_NO_NUMBERS = (ValueError, TypeError, LookupError, OverflowError, RecursionError)


@dataclass(frozen=True, eq=False)
class PointLines:
    """Points of some lines.

    Parameters
    ----------
    points_xy : numpy.ndarray of float64, shape (N, 2)
        A point for each line; nan where the line holds none.
    lines : list of int
        The number of each line, from 1 on; 0 of points that come from elsewhere.
    errors : dict of int to str
        By index, what is wrong with a line that holds no finite point.
    """

    points_xy: NDArray[np.float64]
    lines: list[int]
    errors: dict[int, str]


@dataclass(frozen=True)
class PairLine:
    """A start and a goal, or what is wrong with the line that should hold them.

    Parameters
    ----------
    line : int
        The number of the line, from 1 on.
    start, goal : tuple of float
        x and y, finite; None if there is an error.
    error : str, optional
        What is wrong.
    """

    line: int
    start: Point | None = None
    goal: Point | None = None
    error: str | None = None


def read_points(chunks: Iterable[bytes], source: Path | str) -> Iterator[PointLines]:
    """Yield the points of a text, those of each chunk as soon as its lines are complete.

    Parameters
    ----------
    chunks : iterable of bytes
        The text, cut anywhere. Each line holds ``x,y``, ``[x, y]`` or ``{"x": x, "y": y}``. A
        first line ``x,y`` of words and lines that begin with ``#`` are skipped.
    source : Path or str
        What to call it in an error.

    Raises
    ------
    MalformedInputError
        If a line is longer than 65,536 bytes: that is no text with points.
    """
    for lines, first in _complete_lines(chunks, source):
        yield _parsed(lines, first)


def read_pairs(chunks: Iterable[bytes], source: Path | str) -> Iterator[PairLine]:
    """Yield pairs of points, each as soon as its line is complete.

    Parameters
    ----------
    chunks : iterable of bytes
        The text, cut anywhere. Each line holds ``x,y,x,y``, ``[[x, y], [x, y]]`` or
        ``{"from": [x, y], "to": [x, y]}``, in which a point may be ``{"x": x, "y": y}``, too. A
        first line of four words and lines that begin with ``#`` are skipped.
    source : Path or str
        What to call it in an error.

    Raises
    ------
    MalformedInputError
        As `read_points`.
    """
    for lines, first in _complete_lines(chunks, source):
        for number, raw in enumerate(lines, first):
            text = _text_of(raw)
            if not (text.startswith("#") or (number == 1 and _is_header_of_pairs(text))):
                yield _pair_line(number, text)


def _complete_lines(
    chunks: Iterable[bytes], source: Path | str
) -> Iterator[tuple[list[bytes], int]]:
    """Yield the lines that each chunk completes, and the number of the first of them."""
    rest, line = b"", 1
    for chunk in chunks:
        *lines, rest = (rest + chunk).split(b"\n")
        short = list(takewhile(_is_short, lines))
        if short:
            yield _unmarked(short, line), line
            line += len(short)
        if len(short) < len(lines) or not _is_short(rest):
            rule = f"a line must not be longer than {_LONGEST_LINE} bytes"
            raise MalformedInputError(rule, source=source, place=f"line {line}")
    if rest:
        yield _unmarked([rest], line), line


def _is_short(line: bytes) -> bool:
    return len(line) <= _LONGEST_LINE


def _unmarked(lines: list[bytes], first: int) -> list[bytes]:
    """Return lines of a text without its mark of byte order."""
    if first == 1:
        lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
    return lines


def _text_of(line: bytes) -> str:
    return line.decode("utf-8", errors="replace").strip()


def _parsed(lines: list[bytes], first: int) -> PointLines:
    numbers = _parsed_at_once(lines)
    if numbers is not None:
        return PointLines(numbers, list(range(first, first + len(lines))), {})
    points: list[tuple[float, float]] = []
    kept: list[int] = []
    errors: dict[int, str] = {}
    for index, raw in enumerate(lines):
        text = _text_of(raw)
        if text.startswith("#") or (first + index == 1 and _is_header(text)):
            continue
        try:
            points.append(_point_of(text))
        except _NO_NUMBERS:
            form = '{"x": x, "y": y} or [x, y]' if text[:1] in ("{", "[") else "two numbers x,y"
            errors[len(points)] = f"must be {form}, got {shown(text)}" if text else "empty line"
            points.append((math.nan, math.nan))
        else:
            if not all(map(math.isfinite, points[-1])):
                errors[len(points) - 1] = f"must be finite, got {shown(text)}"
        kept.append(first + index)
    return PointLines(np.array(points, dtype=np.float64).reshape(-1, 2), kept, errors)


def _parsed_at_once(lines: list[bytes]) -> NDArray[np.float64] | None:
    """Return the numbers of lines that all are plain CSV; None if one is anything else."""
    text = b"\n".join(lines)
    if text.translate(None, b"0123456789+-.eE, \t\r\n") or not text.strip():
        return None
    try:
        numbers = np.loadtxt(io.BytesIO(text), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    # it passes over empty lines, and 1e999 is infinite
    is_plain = numbers.shape == (len(lines), 2) and np.isfinite(numbers).all()
    return numbers if is_plain else None


def _is_header(text: str) -> bool:
    return text.lower().replace(" ", "").replace('"', "") == "x,y"


def _point_of(text: str) -> tuple[float, float]:
    if text[:1] in ("{", "["):
        return _point_of_json(json.loads(text))
    x, y = _numbers_of(text)
    return x, y


def _point_of_json(value: Any) -> Point:
    x, y = (value["x"], value["y"]) if isinstance(value, dict) else value
    if type(x) not in (int, float) or type(y) not in (int, float):  # bools are ints, too
        raise ValueError
    return float(x), float(y)


def _numbers_of(text: str) -> list[float]:
    if not text.isascii() or "_" in text:  # which Python reads as digits, too
        raise ValueError
    return [float(part) for part in text.split(",")]


def _pair_line(number: int, text: str) -> PairLine:
    try:
        start, goal = _pair_of(text)
    except _NO_NUMBERS:
        form = "four numbers x,y,x,y"
        if text[:1] in ("{", "["):
            form = '{"from": [x, y], "to": [x, y]} or [[x, y], [x, y]]'
        error = f"must be {form}, got {shown(text)}" if text else "empty line"
        return PairLine(number, error=error)
    if not all(map(math.isfinite, (*start, *goal))):
        return PairLine(number, error=f"must be finite, got {shown(text)}")
    return PairLine(number, start, goal)


def _pair_of(text: str) -> tuple[Point, Point]:
    if text[:1] in ("{", "["):
        value = json.loads(text)
        start, goal = (value["from"], value["to"]) if isinstance(value, dict) else value
        return _point_of_json(start), _point_of_json(goal)
    start_x, start_y, goal_x, goal_y = _numbers_of(text)
    return (start_x, start_y), (goal_x, goal_y)


def _is_header_of_pairs(text: str) -> bool:
    words = [word.strip(' "') for word in text.split(",")]
    return len(words) == _IN_PAIR and all(
        word.isidentifier() and word.lower() not in ("nan", "inf", "infinity") for word in words
    )
