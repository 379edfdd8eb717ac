"""Maps of laser scans in files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.formats.scans.reader import open_log
from mapdeal.formats.scans.source import DEFAULT_MAX_BAD
from mapdeal.grid.coordinates import Point
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.beams import BeamLimits
from mapdeal.mapping.build import BuiltMap, Method
from mapdeal.pipeline.build import BuildSettings, build
from mapdeal.pipeline.settings import Settings


def build_map_from_log(
    path: str | PathLike[str],
    *,
    method: Method = "log-odds",
    resolution: float = 0.05,
    size: Point | None = None,
    origin: Point | None = None,
    range_min: float = 0.0,
    range_max: float = 30.0,
    clear_max: float = 0.0,
    max_bad: int = DEFAULT_MAX_BAD,
    max_memory: int | None = None,
    threads: int | None = None,
    **parameters: Any,
) -> BuiltMap:
    """Make a map of the laser scans in a log, as ``mapdeal build LOG`` does.

    Parameters
    ----------
    path : path or str
        A CARMEN log, also ``.gz``, or an ``.npz`` of ``poses``, ``angles`` and ``ranges``. It is
        read some scans at a time, and twice if the grid is to size itself.
    method, resolution, size, origin, range_min, range_max, clear_max, **parameters
        As of `build_map`.
    max_bad : int
        Lines of a log that may be wrong.
    max_memory : int, optional
        Bytes of memory that may be used; half of what is free if not given.
    threads : int, optional
        Threads to compute with; all processors if not given.

    Returns
    -------
    BuiltMap
        The map, the evidence, and the counts of the beams.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the log cannot be read, has no scans, or makes no map.
    ParameterError
        If a parameter is not allowed.

    Warns
    -----
    MapdealWarning
        If the map is unknown everywhere, or lacks groups of cells that were hit often, and of
        what reading the log had to choose.
    """
    settings = Settings(max_memory=max_memory, threads=threads)
    limits = BeamLimits(range_min, range_max, clear_max)
    how = BuildSettings({method: parameters}, limits, resolution, size, origin)
    with settings.memory(), use_threads(settings.threads):
        return build(open_log(Path(path), max_bad=max_bad), how, settings)
