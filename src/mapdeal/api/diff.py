"""What differs between two maps, given as files or as grids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.api.maps import Map, occupancy_of
from mapdeal.checks.bounds import Bound, Bounds
from mapdeal.checks.difference import WallShift, compare
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.display import Drawn
from mapdeal.grid.frame import Frame
from mapdeal.pipeline.diff import DiffReport as FoundByFiles
from mapdeal.pipeline.diff import diff_files
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass


@dataclass(frozen=True, eq=False, repr=False)
class DiffReport(Drawn):
    """What differs between two maps, A and B.

    Parameters
    ----------
    is_equal : bool
        Whether they are the same, within the tolerance.
    passes : bool
        Whether all bounds hold; without any, `is_equal`.
    bounds : tuple of Bound
        Each bound that was given, what was found, and whether it holds.
    geometry : dict
        Those of width, height, resolution and origin that differ: both values.
    metadata : dict
        The same of mode, negate, thresholds and cost_scale in the YAML files; empty of grids.
    common_cells : int
        Cells that both maps have.
    differing : int
        Common cells with different values.
    beyond_tolerance : int
        Those of them that the tolerance does not explain.
    confusion : dict of dict of int
        How many common cells are each of occupied, free, unknown and between (1..99) in A, and
        of those, how many in B: ``confusion["free"]["occupied"]`` are new obstacles.
    first_to_second, second_to_first : WallShift or None
        How far the obstacles of A in the common area are from the nearest of B, and those of B
        from A, metres; None if one of the two has none.
    symmetry : str, optional
        How B is to be turned or mirrored to be much more like A; None if it is best as it is.
    tolerance : float
        Cells of A, as it was given.
    frame : Frame
        Cells of A's lattice around both maps.
    changes : numpy.ndarray of uint8, shape of `frame`
        What each cell of it is: 0 outside of one map, 1 unknown and 2 free in both, 3 free or
        unknown in one of them, 4 a wall in both, 5 a wall that is gone, 6 a new one.
    title : str
        What stands above its picture.
    """

    is_equal: bool
    passes: bool
    bounds: tuple[Bound, ...]
    geometry: dict[str, tuple[Any, Any]]
    metadata: dict[str, tuple[Any, Any]]
    common_cells: int
    differing: int
    beyond_tolerance: int
    confusion: dict[str, dict[str, int]]
    first_to_second: WallShift | None
    second_to_first: WallShift | None
    symmetry: str | None
    tolerance: float
    frame: Frame
    changes: NDArray[np.uint8]
    title: str
    _document: dict[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return the report as JSON can hold it, as ``mapdeal diff --json`` prints it.

        Its `first` and `second`, the files and their checksums, are None unless both are files.
        """
        return dict(self._document)

    def _told(self) -> Iterator[str]:
        yield "equal" if self.is_equal else "different"
        if self.bounds:
            yield "within the bounds" if self.passes else "beyond the bounds"
        for name, (a, b) in {**self.geometry, **self.metadata}.items():
            yield f"{name} {a} -> {b}"
        yield f"{self.differing} of {self.common_cells} common cells differ"
        if self.tolerance:
            yield f"{self.beyond_tolerance} beyond a tolerance of {self.tolerance:g} cells"
        if self.symmetry is not None:
            yield f"B is much more like A if it is {self.symmetry}"
        for name, shift in (("A to B", self.first_to_second), ("B to A", self.second_to_first)):
            if shift is not None:
                yield f"directed Hausdorff distance {name}: {shift.largest:.4g} m"


def diff(
    first: Map,
    second: Map,
    *,
    tolerance: float = 0.0,
    max_shift: float | None = None,
    max_differing: float | None = None,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> DiffReport:
    """Compare two maps, whatever their size, origin, yaw and resolution.

    Parameters
    ----------
    first, second : path, str or grid
        A and B: ``.yaml``, ``.pbm`` or ``.npz`` files as of `read_map`, or grids. Of fields and
        costs the map that ROS would have is compared.
    tolerance : float
        Cells of A. A cell that is something else in the other map does not count if that map
        has a cell of its state so near, and the other way round.
    max_shift : float, optional
        Metres: `DiffReport.passes` if no obstacle of either map is farther than this from those
        of the other in the common area.
    max_differing : float, optional
        Percent of the common cells that may differ, beyond the tolerance, for it to pass.
    dialect, max_cells, max_memory
        As of `read_map`, for files.

    Returns
    -------
    DiffReport
        Cells are those of A's lattice; of B the value at their centre is taken. Notebooks show
        its picture, and `draw_picture` draws it.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If the tolerance is not 0..1000, a bound is not allowed, or the maps lie so far apart that
        no grid holds both.

    Warns
    -----
    MapdealWarning
        Of what reading a file had to choose, and if costs are compared.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> before = OccupancyGrid([[100, 0, 0, 0]], 0.5)
    >>> after = OccupancyGrid([[0, 100, 0, 0]], 0.5)
    >>> diff(before, after, tolerance=1)  # doctest: +NORMALIZE_WHITESPACE
    DiffReport(equal, 2 of 4 common cells differ, 0 beyond a tolerance of 1 cells,
               directed Hausdorff distance A to B: 0.5 m, directed Hausdorff distance B to A: 0.5 m)
    >>> diff(before, after).confusion["free"]["occupied"]
    1
    """
    bounds = Bounds(max_shift, max_differing)
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    if isinstance(first, str | PathLike) and isinstance(second, str | PathLike):
        paths = Path(first), Path(second)
        found = diff_files(*paths, settings, tolerance=tolerance, bounds=bounds)
        title = f"{paths[0].stem} and {paths[1].stem}: what differs"
        return _report(found, tolerance, title)
    grids = [
        occupancy_of(one, settings, place="diff", name=f"map {name}")
        for one, name in ((first, "A"), (second, "B"))
    ]
    between = compare(*grids, tolerance=tolerance)
    found = FoundByFiles(between, {}, bounds.judged(between))
    return _report(found, tolerance, "what differs")


def _report(report: FoundByFiles, tolerance: float, title: str) -> DiffReport:
    found, document = report.found, report.document()
    return DiffReport(
        is_equal=found.is_equal,
        passes=report.passes,
        bounds=report.bounds,
        geometry=dict(found.geometry),
        metadata=dict(report.metadata),
        common_cells=found.common,
        differing=found.differing,
        beyond_tolerance=found.beyond,
        confusion=document["confusion"],
        first_to_second=found.walls[0],
        second_to_first=found.walls[1],
        symmetry=found.symmetry,
        tolerance=tolerance,
        frame=found.frame,
        changes=found.changes,
        title=title,
        _document=document,
    )
