"""Clouds as text: a point a line, with or without a line of names above."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.formats.text_rows import delimiter_of, first_line, is_number, read_rows


def text_points(file: BinaryIO, path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the points of a text, shape (n, 2) or (n, 3), some at a time.

    Numbers are separated by white space, commas or semicolons, as the first line of them shows;
    they are x, y and z, or what a line of names above says. Lines that begin with # are skipped.
    """
    number, start, line = first_line(file)
    if not line:
        return
    delimiter = delimiter_of(line)
    # CloudCompare puts two slashes before its names
    words = [word.strip().strip('"') for word in line.removeprefix("//").split(delimiter)]
    if words and is_number(words[0]):
        if len(words) < 2:
            rule = "must have 2 numbers or more"
            raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
        columns = list(range(min(3, len(words))))
        file.seek(start)
    else:
        columns = _columns_of(words, line, path, number)
        number += 1
    yield from read_rows(file, columns, path=path, first_line=number, delimiter=delimiter)


def _columns_of(words: list[str], line: str, path: Path, number: int) -> list[int]:
    names = [word.lower() for word in words]
    if not {"x", "y"} <= set(names):
        rule = "must be numbers, or names with x and y among them"
        raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
    return [names.index(name) for name in ("x", "y", "z") if name in names]
