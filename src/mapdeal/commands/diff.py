"""``mapdeal diff``: what differs between two maps."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from mapdeal.command import AT_LEAST_0, CELLS, METRES, PERCENT, Result, Words, accepted_by, command
from mapdeal.commands import two_maps
from mapdeal.commands.diff_costs import compare_robots, costmaps_compared, robots_compared
from mapdeal.commands.reach import goals_in, goals_of, start_of
from mapdeal.compare import score as scoring
from mapdeal.compare.difference import STATES, Bound, Difference, WallShift, compare, frame_around
from mapdeal.compatibility import Unpack
from mapdeal.errors import MalformedInputError, ParameterError, one_line
from mapdeal.files.source import bytes_of_lines
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, count_text
from mapdeal.kernels.lookup import histogram
from mapdeal.maps.kinds import PARAMETERS, readable_kind
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pipeline import inputs
from mapdeal.records import asdict, dataclass
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import transform_document

File = str | PathLike[str]

_LIBRARIES = 37_000_000  # bytes that parts of scipy take
_PER_CELL, _PER_WALL, _PER_LINE = 32, 120, 24  # bytes per cell, occupied cell, row and column
_SHOWN, _LISTED = 5, 20  # changes in the text and in the document
_TWO_ROBOTS = "mapdeal diff MAP --params-file A --against B compares two robots"
_METADATA = ("mode", "negate", "occupied_thresh", "free_thresh", "cost_scale")


@dataclass(frozen=True, eq=False, repr=False)
class DiffReport(Difference, Result):
    """Differences between two maps, A and B.

    Parameters
    ----------
    geometry : dict
        Pairs of values for each of width, height, resolution and origin that differs.
    common_cells, differing, beyond_tolerance : int
        Numbers of cells: covered by both maps, different, and different beyond the tolerance.
    not_compared : int
        Number of known cells of A that B does not cover.
    confusion : dict of dict of int
        Number of common cells by state in A, then by state in B: occupied, free, unknown or
        between (1..99). ``confusion["free"]["occupied"]`` counts new obstacles.
    first_to_second, second_to_first : WallShift or None
        Distances, metres, from the obstacles of A in the common area to the nearest obstacle of
        B, and from those of B to A; None if a map lacks obstacles.
    symmetry : str, optional
        Rotation or reflection of B that makes it much more similar to A, if any.
    tolerance : float
        Tolerance that was given, cells of A.
    frame : Frame
        Geometry of the part of A's lattice that covers both maps.
    changes : numpy.ndarray of uint8, shape of `frame`
        State of each cell: 0 outside one of the maps, 1 unknown in both, 2 free or 1..99 in both,
        3 different but occupied in neither, 4 occupied in both, 5 only in A, 6 only in B.
    bounds : tuple of Bound
        Result for each bound that was given.
    beyond : numpy.ndarray of bool, shape of `frame`
        Cells that differ beyond the tolerance.
    maps : tuple of MapInput
        The two maps.
    transform : Transform, optional
        From A's frame to B's, by which they were compared; None if as they lie.
    faults : tuple of Fault
        Faults of B, taking A as the truth, as in `score`; the worst first.
    """

    bounds: tuple[Bound, ...]
    maps: tuple[inputs.MapInput, inputs.MapInput]
    transform: Transform | None = None
    faults: tuple[scoring.Fault, ...] = ()

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether all bounds hold; the same as `is_equal` if there are no bounds."""
        return all(bound.holds for bound in self.bounds) if self.bounds else self.is_equal

    @property
    def metadata(self) -> dict[str, tuple[Any, Any]]:
        """Pairs of values of mode, negate, thresholds and cost_scale that differ in YAML files."""
        a, b = (source.metadata for source in self.maps)
        if a is None or b is None:
            return {}
        pairs = {name: (getattr(a, name), getattr(b, name)) for name in _METADATA}
        return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}

    @property
    def title(self) -> str:
        return f"{self.maps[0].title} and {self.maps[1].title}: what differs"

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints; ``first`` and ``second`` are None for grids."""
        shifts = {"first_to_second": self.first_to_second, "second_to_first": self.second_to_first}
        return {
            "first": self.maps[0].document(), "second": self.maps[1].document(),
            "equal": self.is_equal,
            "geometry": {name: list(pair) for name, pair in self.geometry.items()},
            "metadata": {name: list(pair) for name, pair in self.metadata.items()},
            "common_cells": self.common_cells, "differing": self.differing,
            "beyond_tolerance": self.beyond_tolerance, "tolerance": self.tolerance,
            "known_only_in_first": self.not_compared,
            "confusion": {state: dict(row) for state, row in self.confusion.items()},
            "symmetry": self.symmetry, "faults": scoring.document_of(self.faults),
            "transform": self.transform and transform_document(self.transform),
            "changes": [{"kind": record.kind, "area_m2": record.area, "x": record.x, "y": record.y}
                        for record in self.largest_changes(_LISTED)[0]],
            "walls": {name: shift and asdict(shift) for name, shift in shifts.items()},
            "bounds": {bound.name.replace("-", "_"): bound.document() for bound in self.bounds},
            "passes": self.passes,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        yield f"{self.maps[0].name}, {self.maps[1].name}: {', '.join(self._verdict())}"
        for heading, pairs in (("geometry", self.geometry), ("metadata", self.metadata)):
            yield from (f"  {heading:<9} {name} {a} -> {b}" for name, (a, b) in pairs.items())
        cells = f"  cells     {self.common_cells} in both, {self.differing} differ"
        if self.tolerance:
            cells += f", {self.beyond_tolerance} beyond a tolerance of {self.tolerance:g} cells"
        yield f"{cells}; rows: A, columns: B" if self.differing else cells
        if self.differing:
            yield from self._confusion_matrix()
        if self.symmetry is not None:
            yield f"  symmetry  B is much more like A if it is {self.symmetry}"
        if self.transform is not None:
            yield two_maps.moved_line(self.transform)
        for number, fault in enumerate(self.faults):
            yield f"  {'and' if number else 'B has':<9} {fault.text}"
        largest, unlisted = self.largest_changes(_SHOWN)
        yield from (f"  {change.kind:<9} {change.place}" for change in largest)
        if unlisted:
            yield f"  {'':<9} and {count_text(unlisted, 'smaller change')}"
        yield f"  walls     {_shift_text('A to B', self.first_to_second)}"
        yield f"  walls     {_shift_text('B to A', self.second_to_first)}"
        yield from (f"  bound     {bound.text}" for bound in self.bounds)

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        """Return the picture of `changes`."""
        shown = one_line(title or self.title)
        return difference_image(self.changes, self.frame, title=shown, **look)

    def _verdict(self) -> Iterator[str]:
        yield "equal" if self.is_equal else "different"
        if self.bounds:
            yield "within the bounds" if self.passes else "beyond the bounds"

    def _confusion_matrix(self) -> Iterator[str]:
        table = self.confusion
        shown = {
            state: "1..99" if state == "between" else state
            for state in STATES
            if any(table[state].values()) or any(row[state] for row in table.values())
        }
        yield " " * 24 + "".join(f"{name:>12}" for name in shown.values())
        for state, name in shown.items():
            yield f"{name:>24}" + "".join(f"{table[state][second]:>12}" for second in shown)

    def _repr_parts(self) -> Iterator[str]:
        yield from self._verdict()
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


def _shift_text(name: str, shift: WallShift | None) -> str:
    if shift is None:
        return f"{name}: no obstacles"
    text = f"directed Hausdorff distance {name}: {shift.largest:.4g} m; 95 % within "
    return text + f"{shift.percentile_95:.4g} m, mean {shift.mean:.4g} m"


def diff(
    first: Annotated[inputs.Map, Words("A")], second: Annotated[inputs.Map, Words("B")], *,
    tolerance: Annotated[float, AT_LEAST_0, CELLS] = 0.0,
    max_shift: Annotated[float | None, AT_LEAST_0, METRES] = None,
    max_differing: Annotated[float | None, PERCENT, Words("PERCENT")] = None, align: bool = False,
    by: Annotated[File | Transform | Sequence[float] | None, Words("FILE", typed=Path)] = None,
    **reading: Unpack[inputs.Reading],
) -> DiffReport:  # fmt: skip
    """Compare two maps of one place.

    Size, origin, yaw and resolution may differ: cells are compared in the common area.

    Parameters
    ----------
    first : path, str or grid
        A map: .yaml, .pbm or .npz, or a grid. Fields are compared as their maps, and costs with a
        map as the map that ROS would publish; `compare_costmaps` compares costs with costs.
    second : path, str or grid
        Another map.
    tolerance : float
        Ignore differences with a matching cell in the other map within this distance, cells of A:
        cells whose states differ, if each map has a cell with the other map's state there.
    max_shift : float, optional
        Pass if the directed Hausdorff distances between the obstacles, both ways, are at most
        this, metres. They are the largest distances from an obstacle of either map in the common
        area to the nearest obstacle of the other map.
    max_differing : float, optional
        Pass if at most this share of the common cells differs beyond the tolerance, percent.
    align : bool
        Align A with B by their walls before comparing.
    by : path, Transform or tuple of float, optional
        Or apply a transform from A's frame to B's, as align writes it; in Python also x, y, yaw.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to files.

    Returns
    -------
    DiffReport
        Differences on A's lattice; B is sampled at the centres of the cells.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If a number is out of bounds, the maps are too far apart, or both are costs.

    Warns
    -----
    MapdealWarning
        If a choice had to be made while reading a file, costs are compared, or bounds are given
        and B does not cover all of A.

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
    values = {"tolerance": tolerance, "max_shift": max_shift, "max_differing": max_differing}
    limits = accepted_by(diff, values)
    maps, move = two_maps.opened_in_one_frame(first, second, align=align, by=by, **reading)
    if two_maps.are_costs(maps):
        hint = "compare_costmaps compares costs"
        raise ParameterError("are both costs", place="first, second", hint=hint)
    return _maps_compared(maps, move, limits, reading)


def _maps_compared(
    maps: Sequence[inputs.MapInput], move: Transform | None, limits: Mapping[str, Any],
    reading: inputs.Reading,
) -> DiffReport:  # fmt: skip
    a, b = maps
    advice = "--align places the first map by its walls" if move is None else ""
    found = compared(maps, tolerance=limits["tolerance"], move=move, advice=advice, **reading)
    bounds = found.bounds_of(limits["max_shift"], limits["max_differing"])
    two_maps.warn_of_uncovered(maps, bounds, found.not_compared)
    faults: tuple[scoring.Fault, ...] = ()
    if not found.is_equal:
        truth = a.occupancy
        estimate = scoring.states_on(truth.frame, b.occupancy, move and move.inverse())
        faults = scoring.faults_of(estimate, scoring.states_of(truth.occupancy), truth.frame)
    return DiffReport(**vars(found), bounds=bounds, maps=(a, b), transform=move, faults=faults)


@command(
    name="diff",
    also={"": diff, "With --against": compare_robots},
    shared=("params_file", "costmap", "namespace", "against", "mask", "files"),
    words={
        "start": Words("X,Y[,YAW]", start_of, "from"),
        "goals": Words("[NAME=]X,Y", goals_of, "to", is_repeated=True),
    },
    group="Two maps of one place",
    example="""\
mapdeal edit line examples/maps/office.yaml -o out/new.yaml \\
    --point 1,-0.8 1.5,-0.8 --value 100
mapdeal diff examples/maps/office.yaml out/new.yaml --tolerance 1
mapdeal diff examples/maps/office.yaml \\
    --params-file examples/robots/nav2_params.yaml \\
    --against examples/robots/nav2_params.yaml \\
    --against examples/robots/nav2_wider.yaml""",
)
def differences(
    first: Annotated[inputs.Map, Words("A")],
    second: Annotated[inputs.Map | None, Words("[B]")] = None, *,
    points: Annotated[Path | None, Words("FILE|-")] = None,
    robot: Annotated[RobotParameters | None, Words()] = None,
    against: Annotated[RobotParameters | None, Words()] = None,
    mask: Annotated[inputs.Map | None, Words()] = None, **parameters: Any,
) -> Result:  # fmt: skip
    """Compare two maps, two costmaps, or a robot's parameters on a map.

    Size, origin, yaw and resolution may differ: cells are compared in the common area. Exit code 0
    if the maps are equal within the tolerance, 1 if not. With --max-shift or --max-differing the
    exit code is 0 if the differences in the common area stay within these bounds, whatever the
    geometry of the maps. For two costmaps, the costs are compared, on costmap_2d's scale. With
    --params-file and --against both costmaps are computed on one map; the exit code is 1 if a
    passage closes or a goal is lost.

    Parameters
    ----------
    first : path
        A map or costs: .yaml, .pbm or .npz. Costs are compared with a map as the map that ROS would
        publish, and fields as their maps.
    second : path, optional
        Another map, or other costs; omitted with --against.
    points : path, optional
        With --against: file of goals, one [NAME=]x,y or JSON object per line; - reads stdin.
    robot, against : RobotParameters, optional
        Two versions of a robot's parameters.
    """
    start, goals = parameters.pop("start", None), parameters.pop("goals", ())
    if robot is not None and against is not None and second is None:
        inputs.refuse("applies to two files", **parameters)
        goals = (*goals, *(() if points is None else goals_in(points)))
        keepout = inputs.mask_of(mask, inputs.settings_of())
        also = [*robot.paths, *against.paths, *([] if points is None else [points])]
        also += keepout.files if keepout else ()
        (source,) = inputs.open_inputs(first, names=("the map",), also=also)
        return robots_compared(source, (robot, against), start, goals, keepout)
    if second is None:
        hint = f"mapdeal diff A B compares two files, {_TWO_ROBOTS}"
        raise ParameterError("needs two files, or --params-file and --against", hint=hint)
    of_one = {"robot": robot, "against": against, "mask": mask, "start": start, "goals": goals}
    inputs.refuse("applies to one map", _TWO_ROBOTS, **of_one, points=points)
    align, by = parameters.pop("align", False), parameters.pop("by", None)
    limits = accepted_by(diff, parameters)
    try:
        maps, move = two_maps.opened_in_one_frame(first, second, align=align, by=by)
    except MalformedInputError as error:
        files = [Path(item) for item in (first, second) if isinstance(item, str | PathLike)]
        kinds = [kind.name for kind in map(readable_kind, files) if kind is not None]
        if kinds == [PARAMETERS] * 2:
            names = [shlex.quote(str(file)) for file in files]
            error.hint = f"mapdeal diff MAP --params-file {names[0]} --against {names[1]}"
        raise
    if not two_maps.are_costs(maps):
        return _maps_compared(maps, move, limits, {})
    of_maps = {"max_shift": limits["max_shift"], "tolerance": limits["tolerance"] or None}
    inputs.refuse("applies to maps, and both are costs", **of_maps)
    return costmaps_compared(maps, move, limits["max_differing"])


def compared(
    maps: Sequence[inputs.MapInput], *, tolerance: float = 0.0, move: Transform | None = None,
    advice: str = "", **reading: Unpack[inputs.Reading],
) -> Difference:  # fmt: skip
    # With `advice`, maps that do not lie in one frame are warned of.
    grids = [source.occupancy for source in maps]
    if move is not None:
        frame = move.inverse().frame(grids[1].frame)
        grids[1] = OccupancyGrid(grids[1].occupancy, frame.resolution, frame.origin)
    with inputs.errors_named(maps[1].name):
        frame = frame_around(*(grid.frame for grid in grids))
        walls = sum(int(histogram(grid.occupancy)[OCCUPIED]) for grid in grids)
        needed = _LIBRARIES + _PER_CELL * frame.height * frame.width + _PER_WALL * walls
        needed += bytes_of_lines(frame.shape, _PER_LINE)
        inputs.claim_for(maps, needed, f"{frame.width} x {frame.height} cells", **reading)
        if advice:
            two_maps.warn_of_frames(maps, advice)
        return compare(*grids, tolerance=tolerance)
