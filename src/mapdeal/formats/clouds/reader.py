"""Reading a point cloud by its file's name, and those that are text: a point a line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.budget import PIECES, claim, use_memory
from mapdeal.formats.clouds.arrays import npy_points, npz_points
from mapdeal.formats.clouds.pcd import pcd_points
from mapdeal.formats.clouds.ply import ply_points
from mapdeal.formats.kinds import CLOUD, NUMBERS, recognised
from mapdeal.formats.source import check_readable
from mapdeal.formats.text_rows import delimiter_of, first_line, is_number, read_rows

Points = NDArray[np.float64]


def text_points(file: BinaryIO, path: Path) -> Iterator[Points]:
    """Yield the points of a text, shape (n, 2) or (n, 3), some at a time."""
    # Numbers are separated by white space, commas or semicolons, as the first line of them shows;
    # they are x, y and z, or what a line of names above says. Lines that begin with # are skipped.
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


_IN_A_FILE: dict[str, Callable[[BinaryIO, Path], Iterator[Points]]] = {
    ".pcd": pcd_points,
    ".ply": ply_points,
    ".xyz": text_points,
    ".txt": text_points,
    ".csv": text_points,
    ".asc": text_points,
}
_BY_NAME: dict[str, Callable[[Path], Iterator[Points]]] = {".npy": npy_points, ".npz": npz_points}

CLOUD_SUFFIXES = (*_IN_A_FILE, *_BY_NAME)
"""Suffixes of point clouds."""


def cloud_chunks(path: Path) -> Iterator[Points]:
    with recognised(path, "a point cloud", CLOUD, NUMBERS):
        check_readable(path)
        suffix = path.suffix.lower()
        if suffix not in CLOUD_SUFFIXES:
            rule = f"a cloud must end in {', '.join(CLOUD_SUFFIXES)}"
            raise MalformedInputError(rule, source=path, got=path.suffix)
        try:
            if suffix in _BY_NAME:
                yield from _BY_NAME[suffix](path)
            else:
                with path.open("rb") as file:
                    yield from _IN_A_FILE[suffix](file, path)
        except OSError as error:
            rule = f"cannot be read: {error.strerror or error}"
            raise FileAccessError(rule, source=path) from None


def read_cloud(path: Path | str, *, max_memory: int | None = None) -> Points:
    """Read a point cloud.

    Parameters
    ----------
    path : path or str
        PCD (ascii, binary, binary_compressed), PLY (ascii, binary of either byte order), text
        (``.xyz``, ``.txt``, ``.csv``, ``.asc``), ``.npy``, or ``.npz``.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    numpy.ndarray of float64, shape (N, 2) or (N, 3)
        x, y and, if the file has it, z of each point, metres; values that are not finite are kept.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If the file is malformed or of another type.
    """
    path, chunks, taken = Path(path), [], 0
    with use_memory(max_memory):
        for chunk in cloud_chunks(path):
            taken += chunk.nbytes
            claim(path, 2 * taken + PIECES)  # parts, and the whole that they make
            chunks.append(chunk)
    return np.concatenate(chunks) if chunks else np.empty((0, 3))
