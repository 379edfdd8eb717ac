"""What there is to know of a file."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.commands.info import describe_file
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pipeline.settings import Settings


def info(
    path: str | PathLike[str],
    *,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> dict[str, Any]:
    """Describe a map, distance field, costmap or run folder.

    Parameters
    ----------
    path : path or str
        A ``.yaml``, ``.pbm`` or ``.npz`` file, or a folder with a manifest.
    dialect, max_cells, max_memory
        As for `read_map`.

    Returns
    -------
    dict of str to object
        The description that ``mapdeal info --json`` prints: size, origin, cell counts, checksum
        and, for the outputs of a run, the stages that made them.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the file or folder cannot be read.
    """
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    with settings.memory():
        return describe_file(Path(path), dialect=settings.dialect, max_cells=settings.max_cells)
