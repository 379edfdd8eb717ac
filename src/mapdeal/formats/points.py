"""Points as lines of text: CSV ``x,y`` or JSON lines, read as they come."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, shown

_LONGEST_LINE = 1 << 16


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
    rest, line = b"", 1
    for chunk in chunks:
        *lines, rest = (rest + chunk).split(b"\n")
        short = list(takewhile(_is_short, lines))
        if short:
            yield _parsed(short, line)
            line += len(short)
        if len(short) < len(lines) or not _is_short(rest):
            rule = f"a line must not be longer than {_LONGEST_LINE} bytes"
            raise MalformedInputError(rule, source=source, place=f"line {line}")
    if rest:
        yield _parsed([rest], line)


def _is_short(line: bytes) -> bool:
    return len(line) <= _LONGEST_LINE


def _parsed(lines: list[bytes], first: int) -> PointLines:
    if first == 1:
        lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
    numbers = _parsed_at_once(lines)
    if numbers is not None:
        return PointLines(numbers, list(range(first, first + len(lines))), {})
    points: list[tuple[float, float]] = []
    kept: list[int] = []
    errors: dict[int, str] = {}
    for index, raw in enumerate(lines):
        text = raw.decode("utf-8", errors="replace").strip()
        if text.startswith("#") or (first + index == 1 and _is_header(text)):
            continue
        try:
            points.append(_point_of(text))
        except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
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
        value = json.loads(text)
        x, y = (value["x"], value["y"]) if isinstance(value, dict) else value
        if type(x) not in (int, float) or type(y) not in (int, float):  # bools are ints, too
            raise ValueError
        return float(x), float(y)
    if not text.isascii() or "_" in text:  # which Python reads as digits, too
        raise ValueError
    first, second = text.split(",")
    return float(first), float(second)
