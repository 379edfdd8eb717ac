"""What there is to know of a file."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.formats.map_yaml import Dialect
from mapdeal.pipeline.inspect import describe_file
from mapdeal.pipeline.settings import Settings


def info(
    path: str | PathLike[str],
    *,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> dict[str, Any]:
    """Return what there is to know of a map, a field, costs, or the folder of a run.

    Parameters
    ----------
    path : path or str
        A ``.yaml``, ``.pbm`` or ``.npz``, or a folder with a manifest.
    dialect, max_cells, max_memory
        As of `read_map`.

    Returns
    -------
    dict of str to object
        As ``mapdeal info --json`` prints it: size, origin, counts of cells, checksum, and of
        files of a run the stages that made them.

    Raises
    ------
    FileAccessError, MalformedInputError
        If it cannot be read.
    """
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    with settings.memory():
        return describe_file(Path(path), dialect=settings.dialect, max_cells=settings.max_cells)
