"""Maps from laser scans with known poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mapdeal import command, errors, records
from mapdeal.grid import frame as frames, occupancy
from mapdeal.grid.values import Drawn, check_choice, count_text
from mapdeal.mapping import evidence
from mapdeal.mapping.evidence import Evidence

Method = Literal["log-odds", "counting", "tsdf"]
EvidenceMaker = Callable[..., Evidence]
METHODS: dict[Method, EvidenceMaker] = {
    "log-odds": evidence.LogOdds, "counting": evidence.Counting, "tsdf": evidence.Tsdf
}  # fmt: skip
MARGIN = 2
"""Cells around all that beams reach in a grid without a requested size."""


class Extent:
    """The bounding box of sensors, hits, and ends of clearing beams."""

    def __init__(self, limits: evidence.BeamLimits, beyond: float = 0.0) -> None:
        self._limits, self._beyond = limits, beyond
        self._least, self._most = np.full(2, np.inf), np.full(2, -np.inf)
        self._counts = evidence.BeamCounts()

    def add_beams(self, beams: evidence.Beams) -> None:
        self._counts += beams.counts
        if not len(beams.ranges):
            return
        for points in (beams.sensors_xy, beams.ends_xy(self._beyond)):
            for axis, values in enumerate(points.T):  # faster than numpy along short rows
                self._least[axis] = min(self._least[axis], values.min())
                self._most[axis] = max(self._most[axis], values.max())

    def frame(self, resolution: float) -> frames.Frame:
        """Return a grid around the box, on the lattice of the resolution, with a margin."""
        checked = frames.check_resolution(resolution)
        if not np.isfinite(self._least).all():
            counts = self._counts
            rule = f"no beam hits anything: of {counts.beams} readings {counts.no_return} are"
            rule += f" without return, {counts.bad} bad"
            hint = f"readings are hits below range_max, {self._limits.range_max:g} m"
            raise errors.MalformedInputError(rule, hint=hint)
        lattice = frames.Frame(1, 1, checked)
        first, last = lattice.unbounded_rowcol_from_xy([self._least, self._most])
        height, width = (last - first + 1 + 2 * MARGIN).tolist()
        if height * width > frames.MOST_CELLS:
            x, y, u, v = (*self._least, *self._most)
            rule = f"beams reach from {x:.6g}, {y:.6g} to {u:.6g}, {v:.6g}: too far for a map"
            hint = "a pose may be wrong; --size and --origin bound the map"
            raise errors.MalformedInputError(rule, hint=hint)
        row, col = (first - MARGIN).tolist()
        return frames.Region(row, col, height, width).frame_in(lattice)


def frame_of(
    size: Sequence[float] | None, origin: Sequence[float] | None, resolution: float
) -> frames.Frame | None:
    if size is None and origin is None:
        return None
    if size is None or origin is None:
        raise errors.ParameterError("must be given together", place="size, origin")
    x, y = frames.check_point(origin, "origin")
    size_xy = width, height = frames.check_point(size, "size")
    errors.require(min(size_xy) > 0, "must be two numbers of metres above 0", "size", got=size_xy)
    checked = frames.check_resolution(resolution)
    rows, cols = (max(1, frames.cells_to_cover(length, checked)) for length in (height, width))
    return frames.Region(0, 0, rows, cols).frame_in(frames.Frame(1, 1, checked, (x, y, 0.0)))


@records.dataclass(frozen=True, eq=False, repr=False)
class BuiltMap(Drawn):
    """Map built from laser scans, with its evidence.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    layers : dict of str to numpy.ndarray
        Evidence: ``log_odds``; ``hits`` and ``misses``; or ``tsdf``, ``weight`` and ``surface``.
    counts : BeamCounts
        Number of beams of each kind.
    vanished : HitGroups
        Groups of cells that were hit three or more times but are missing from the map.
    """

    grid: occupancy.OccupancyGrid
    layers: evidence.Layers
    counts: evidence.BeamCounts
    vanished: evidence.HitGroups

    def _repr_parts(self) -> Iterator[str]:
        yield repr(self.grid)
        yield f"layers {' '.join(self.layers)}" if self.layers else "no layers"
        yield f"{count_text(self.counts.hits, 'hit')} of {count_text(self.counts.beams, 'beam')}"
        yield f"{count_text(len(self.vanished), 'group')} of hits vanished"


class MapBuilder:
    """Builder of a map from laser scans that are added in order.

    Parameters
    ----------
    frame : Frame
        Geometry of the map.
    method : {'log-odds', 'counting', 'tsdf'}
        How evidence becomes a map.
    limits : BeamLimits
        Limits that decide which ranges are hits.
    **parameters
        Parameters of `LogOdds`, `Counting` or `Tsdf`; ``as_written=True`` for `TsdfAsWritten`.

    Raises
    ------
    ParameterError
        If the method is unknown, or a parameter does not belong to it or is out of range.
    """

    def __init__(
        self, frame: frames.Frame, method: Method = "log-odds",
        limits: evidence.BeamLimits | None = None, **parameters: Any,
    ) -> None:  # fmt: skip
        self._evidence = _evidence(frame, method, parameters)
        self._limits = limits or evidence.BeamLimits()
        self.counts = evidence.BeamCounts()

    def add(self, scans: evidence.Scans) -> None:
        """Add the beams of scans."""
        for part in scans.parts():
            self.add_beams(evidence.beams_of(part, self._limits))

    def add_beams(self, beams: evidence.Beams) -> None:
        """Add beams that were made with the same limits."""
        self._evidence.add(beams)
        self.counts += beams.counts

    def result(self, *, with_layers: bool = True) -> BuiltMap:
        """Return the map of all scans so far; `BuiltMap.layers` is empty without `with_layers`."""
        grid = self._evidence.grid()
        vanished = self._evidence.vanished_from(grid)
        return BuiltMap(grid, self._evidence.layers() if with_layers else {}, self.counts, vanished)

    @property
    def bytes_per_cell(self) -> int:
        """Memory that the evidence takes per cell, bytes."""
        return self._evidence.bytes_per_cell

    def hit_groups(self) -> tuple[int, evidence.HitGroups]:
        """Return the number of cells that were hit three or more times, and their groups."""
        often_hit = self._evidence.often_hit()
        return int(np.count_nonzero(often_hit)), evidence.hit_groups(often_hit)

    def advice(self, vanished: evidence.HitGroups) -> str:
        """Return advice on how to keep the vanished groups of hits on the map."""
        return self._evidence.advice(vanished)


def _evidence(frame: frames.Frame, method: Method, parameters: Mapping[str, Any]) -> Evidence:
    check_choice(method, Method, "method")
    kind, chosen = _kind_of(method, dict(parameters))
    known = command.parameters_of(kind)
    for name in chosen:
        if name not in known:
            raise errors.ParameterError(f"does not apply to method {method}", place=name)
    return kind(frame, **{name: known[name].accept(value) for name, value in chosen.items()})


def _kind_of(method: Method, chosen: dict[str, Any]) -> tuple[EvidenceMaker, dict[str, Any]]:
    is_as_written = method == "tsdf" and chosen.pop("as_written", False)
    return evidence.TsdfAsWritten if is_as_written else METHODS[method], chosen


def all_parameters(method: Method, parameters: Mapping[str, Any]) -> dict[str, Any]:
    kind, _ = _kind_of(method, dict(parameters))
    return {**(kind.__init__.__kwdefaults__ or {}), **parameters}


def reach_behind(method: Method, resolution: float, parameters: Mapping[str, Any]) -> float:
    """Return the distance behind hits up to which a method has an effect, metres."""
    frame = frames.Frame(1, 1, frames.check_resolution(resolution))
    return _evidence(frame, method, parameters).reach_behind * frame.resolution


def build_map(
    poses: ArrayLike, angles: ArrayLike, ranges: ArrayLike, *, method: Method = "log-odds",
    resolution: float = 0.05, size: frames.Point | None = None, origin: frames.Point | None = None,
    range_min: float = 0.0, range_max: float = 30.0, clear_max: float = 0.0, **parameters: Any,
) -> BuiltMap:  # fmt: skip
    """Build a map from laser scans with known poses.

    Parameters
    ----------
    poses : array_like of float, shape (N, 3)
        x, y (metres) and yaw (radians) of the sensor in the map frame.
    angles : array_like of float, shape (M,)
        Angles of the beams from the sensor's heading, anticlockwise, radians.
    ranges : array_like of float, shape (N, M)
        Measured ranges, metres; inf for a beam without return, nan for an invalid beam.
    method : {'log-odds', 'counting', 'tsdf'}
        How evidence becomes a map: `LogOdds`, `Counting` or `Tsdf`.
    resolution : float
        Side of a cell, metres.
    size, origin : tuple of float, optional
        Width and height of the map, and its corner, metres; by default all that beams reach.
    range_min, range_max, clear_max : float
        As in `BeamLimits`, metres.
    **parameters
        Parameters of the method.

    Returns
    -------
    BuiltMap
        The map, its evidence, and the counts of the beams.

    Raises
    ------
    ParameterError
        If a parameter or an array is not allowed.
    MalformedInputError
        Without a `size`, if no beam hits anything or the beams reach too far for a map.

    Notes
    -----
    A beam passes the cells of costmap_2d's line from the sensor's cell to that of its end, which it
    hits instead. Beams that leave the grid count inside it.

    Examples
    --------
    >>> built = build_map([[0.0, 0.0, 0.0]], [0.0, 0.5], [[1.0, 1.2]], resolution=0.25)
    >>> built.grid.origin, built.counts.hits
    ((-0.5, -0.5, 0.0), 2)
    """
    scans = evidence.Scans(poses, angles, ranges)  # type: ignore[arg-type]
    limits = evidence.BeamLimits(range_min, range_max, clear_max)
    frame = frame_of(size, origin, resolution)
    if frame is None:
        extent = Extent(limits, reach_behind(method, resolution, parameters))
        for part in scans.parts():
            extent.add_beams(evidence.beams_of(part, limits))
        frame = extent.frame(resolution)
    builder = MapBuilder(frame, method, limits, **parameters)
    builder.add(scans)
    return builder.result()
