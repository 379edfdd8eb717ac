"""Maps of laser scans in files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.commands.build import BuildSettings, build
from mapdeal.grid.frame import Point
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.beams import BeamLimits
from mapdeal.mapping.build import BuiltMap, Method
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.scans import DEFAULT_MAX_BAD, open_log


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
    """Build a map from the laser scans in a log, like ``mapdeal build LOG``.

    Parameters
    ----------
    path : path or str
        A CARMEN log, optionally ``.gz``, or an ``.npz`` with ``poses``, ``angles`` and
        ``ranges``. It is read in batches of scans, and twice if `size` is not given.
    method, resolution, size, origin, range_min, range_max, clear_max, **parameters
        As for `build_map`.
    max_bad : int
        Maximum number of malformed lines in a log.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.
    threads : int, optional
        Number of threads; by default one per core.

    Returns
    -------
    BuiltMap
        The map, its evidence and the beam counts.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the log cannot be read, has no scans, or no map can be built from it.
    ParameterError
        If a parameter is invalid.

    Warns
    -----
    MapdealWarning
        If the map is unknown everywhere or lacks groups of cells that were hit often, or a
        choice had to be made while reading the log.
    """
    settings = Settings(max_memory=max_memory, threads=threads)
    limits = BeamLimits(range_min, range_max, clear_max)
    how = BuildSettings({method: parameters}, limits, resolution, size, origin)
    with settings.memory(), use_threads(settings.threads):
        return build(open_log(Path(path), max_bad=max_bad), how, settings)
