"""A map from files of laser scans."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import MalformedInputError, MapdealWarning, ParameterError
from mapdeal.formats.budget import claim
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.npz import write_npz
from mapdeal.formats.scans.source import ScanSource
from mapdeal.formats.source import check_state, is_regular, state_of
from mapdeal.grid.coordinates import Point
from mapdeal.grid.framed import Figures
from mapdeal.mapping.beams import BeamLimits, Scans
from mapdeal.mapping.build import BuiltMap, Extent, MapBuilder, Method, frame_of, reach_behind
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of
from mapdeal.pipeline.settings import Settings

_PER_CELL: dict[Method, int] = {"log-odds": 22, "counting": 22, "tsdf": 43}
"""Bytes for each cell: the evidence, and the map that is made of it."""

Advance = Callable[[int], object]


@dataclass(frozen=True)
class BuildSettings:
    """How a map is made of scans.

    Parameters
    ----------
    method : {'log-odds', 'counting', 'tsdf'}
        How evidence becomes a map.
    limits : BeamLimits
        Which ranges are hits.
    resolution : float
        Side of a cell, metres.
    size, origin : tuple of float, optional
        Width and height, and the corner of cell (0, 0), metres; both or none.
    parameters : mapping
        Those of the method.
    """

    method: Method
    limits: BeamLimits
    resolution: float
    size: Point | None
    origin: Point | None
    parameters: Mapping[str, Any]

    def __post_init__(self) -> None:
        if (self.size is None) != (self.origin is None):
            raise ParameterError("must be given together", source="--size, --origin")
        # what is wrong with a parameter is said before anything is read
        reach_behind(self.method, self.resolution, self.parameters)
        if self.size is not None and self.origin is not None:
            frame_of(self.size, self.origin, self.resolution)

    @property
    def sizes_itself(self) -> bool:
        """Whether the grid is to hold all that beams reach: scans are then read twice."""
        return self.size is None


def build_file(
    source: ScanSource,
    output: Path,
    settings: BuildSettings,
    options: Settings,
    *,
    layers: Path | None = None,
    advance: Advance = lambda _: None,
) -> Figures:
    """Make a map of scans in files, and write it, and its evidence if `layers` is given.

    Parameters
    ----------
    source : ScanSource
        The scans.
    output : Path
        Where the map goes: ``.yaml``, ``.pgm``, ``.png`` or ``.npz``.
    settings : BuildSettings
        How it is made.
    options : Settings
        How files are written.
    layers : Path, optional
        An ``.npz`` for the map with its evidence.
    advance : callable
        Told how many scans more were read, each time that they are.

    Returns
    -------
    dict
        The figures of the map, and the counts of its beams.

    Raises
    ------
    MapdealError
        If the scans cannot be read or make no map, or outputs exist; nothing is changed then.
    """
    if layers is not None and layers.suffix != ".npz":
        raise ParameterError("layers are written as .npz", source=layers)
    outputs = [*output_paths(output), *([layers] if layers is not None else [])]
    # All files are read twice, or one after the other; a pipe can be read but once.
    states = {path: state_of(path) for path in source.files if is_regular(path)}
    with outputs_of(outputs, source.files, options) as transaction:
        try:
            with errors_named(source.named):
                built = _built(source, settings, options, advance)
        finally:
            source.warn()  # what was passed over may be why there is no map
        for path, state in states.items():
            check_state(path, state)
        _check(built, source.named)
        write_grid(transaction, output, built.grid)
        if layers is not None:
            transaction.write(layers, lambda file: write_npz(file, built.grid, more=built.layers))
        title = f"{output.stem}: map, {settings.method}"
        add_picture(transaction, options, built.grid, title)
    return {**built.grid.figures(), **asdict(built.counts)}


def _built(
    source: ScanSource, settings: BuildSettings, options: Settings, advance: Advance
) -> BuiltMap:
    is_told = False
    if settings.size is not None and settings.origin is not None:
        frame = frame_of(settings.size, settings.origin, settings.resolution)
    else:
        behind = reach_behind(settings.method, settings.resolution, settings.parameters)
        extent = Extent(settings.limits, behind)
        for scans in _scans(source, advance):
            extent.add(scans)
        frame = extent.frame(settings.resolution)
        is_told = True
    with options.memory():
        cells = frame.height * frame.width
        what = f"{frame.width} x {frame.height} cells"
        hint = "a pose may be wrong; --size and --origin bound the map"
        claim(source.named, _PER_CELL[settings.method] * cells, what=what, hint=hint)
    builder = MapBuilder(frame, settings.method, settings.limits, **settings.parameters)
    for scans in _scans(source, advance, is_told=is_told):
        builder.add(scans)
    return builder.result()


def _scans(source: ScanSource, advance: Advance, *, is_told: bool = False) -> Iterator[Scans]:
    for arrays in source.scans():
        if not is_told and np.abs(arrays.angles).max(initial=0.0) > 2 * math.pi:
            is_told = True
            largest = np.abs(arrays.angles).max()
            text = f"{source.named}: angles of up to {largest:.6g} rad: are they in degrees?"
            warnings.warn(text, MapdealWarning, stacklevel=2)
        yield Scans(*arrays)
        advance(len(arrays.poses))


def _check(built: BuiltMap, path: Path) -> None:
    counts = built.counts
    if not counts.scans:
        raise MalformedInputError("holds no scans", source=path)
    if not np.any(built.grid.occupancy >= 0):
        text = f"{path}: no beam reaches the grid: the map is unknown everywhere"
        warnings.warn(text, MapdealWarning, stacklevel=2)
