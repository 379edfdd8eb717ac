"""What differs between two maps, given as files or as grids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.api.maps import Map, occupancy_of
from mapdeal.checks.selection import Bound, Bounds, WallShift, compare
from mapdeal.commands.diff import DiffReport as FoundByFiles
from mapdeal.commands.diff import diff_files
from mapdeal.grid.display import Drawn
from mapdeal.grid.frame import Frame
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pipeline.settings import Settings


@dataclass(frozen=True, eq=False, repr=False)
class DiffReport(Drawn):
    """Differences between two maps, A and B.

    Parameters
    ----------
    is_equal : bool
        Whether the maps are the same, within the tolerance.
    passes : bool
        Whether all bounds hold; the same as `is_equal` if there are no bounds.
    bounds : tuple of Bound
        Result for each bound that was given.
    geometry : dict
        Pairs of values for each of width, height, resolution and origin that differs.
    metadata : dict
        Pairs of values for each of mode, negate, thresholds and cost_scale that differs between
        the YAML files; empty for grids.
    common_cells : int
        Number of cells that both maps cover.
    differing : int
        Number of common cells with different values.
    beyond_tolerance : int
        Number of differing cells that the tolerance does not explain.
    confusion : dict of dict of int
        Number of common cells by state in A, then by state in B; the states are occupied, free,
        unknown and between (1..99). ``confusion["free"]["occupied"]`` counts new obstacles.
    first_to_second, second_to_first : WallShift or None
        Distances, metres, from the obstacles of A in the common area to the nearest obstacle of
        B, and from those of B to A; None if either map has no obstacles to compare.
    symmetry : str, optional
        Rotation or reflection of B that makes it much more similar to A; None if there is none.
    tolerance : float
        Tolerance that was given, cells of A.
    frame : Frame
        Geometry of the part of A's lattice that covers both maps.
    changes : numpy.ndarray of uint8, shape of `frame`
        State of each cell: 0 outside one of the maps, 1 unknown in both, 2 free or 1..99 in both,
        3 different but occupied in neither, 4 occupied in both, 5 occupied only in A, 6 occupied
        only in B.
    title : str
        Title of its picture.
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
        """Return the report as the JSON-serialisable dict that ``mapdeal diff --json`` prints.

        The entries ``first`` and ``second``, paths with checksums, are None unless both maps were
        given as files.
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
    """Compare two maps, which may differ in size, origin, yaw and resolution.

    Parameters
    ----------
    first, second : path, str or grid
        Maps A and B: ``.yaml``, ``.pbm`` or ``.npz`` files, as for `read_map`, or grids. Fields
        and costs are compared as the maps that ROS would publish.
    tolerance : float
        Distance within which differences are ignored, cells of A. A cell whose states differ is
        ignored if each map has a cell with the other map's state within this distance.
    max_shift : float, optional
        Maximum distance from an obstacle of either map in the common area to the nearest obstacle
        of the other map, metres. It decides `DiffReport.passes`.
    max_differing : float, optional
        Maximum share of the common cells that differ beyond the tolerance, percent. It decides
        `DiffReport.passes`.
    dialect, max_cells, max_memory
        As for `read_map`; they apply to files.

    Returns
    -------
    DiffReport
        Differences on A's lattice; B is sampled at the centres of the cells. Notebooks show the
        report as a picture; `draw_picture` draws it.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If the tolerance is not in 0..1000, a bound is invalid, or the maps are too far apart for
        one grid to cover both.

    Warns
    -----
    MapdealWarning
        If a choice had to be made while reading a file, costs are compared, or files are compared
        within bounds and B does not cover all of A.

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
