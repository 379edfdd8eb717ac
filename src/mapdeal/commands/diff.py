"""``mapdeal diff``: differences of two maps, two costmaps, or two versions of a robot."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from mapdeal import records
from mapdeal.command import AT_LEAST_0, CELLS, METRES, PERCENT, Result, Words, accepted_by, command
from mapdeal.commands import two_maps
from mapdeal.commands.reach import COSTS_PER_CELL, StartOption, goals_in, goals_of, reach_on_input
from mapdeal.compare import difference, score as scoring
from mapdeal.compatibility import Unpack
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning, one_line
from mapdeal.files.json_values import COST_DIFF_FORMAT, ROBOT_DIFF_FORMAT
from mapdeal.files.source import bytes_of_lines
from mapdeal.grid import costmap, occupancy
from mapdeal.grid.frame import Transform
from mapdeal.grid.reach import GoalReach, Passage, Reach, reach_radius
from mapdeal.grid.values import OCCUPIED, count_text, decimal_text
from mapdeal.kernels import arrays, lookup, threads
from mapdeal.maps.kinds import PARAMETERS, readable_kind
from mapdeal.pictures import canvas, comparisons, styles
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.folder import format_value, passage_document, reach_document, rounded
from mapdeal.pipeline.step import make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import transform_document
from mapdeal.stages.structured import Goals

_LIBRARIES = 37_000_000  # bytes that parts of scipy take
_PER_CELL, _PER_WALL, _PER_LINE = 32, 120, 24  # bytes per cell, occupied cell, row and column
_COST_LIBRARIES = 18_000_000  # bytes of scipy.ndimage
_PER_COST_CELL, _PER_COST_LINE = 30, 12  # bytes for each cell, row and column around both costmaps
_PER_CELL_OF_ROBOTS = 175.0  # bytes of both costmaps, their difference and one reach
_SHOWN, _LISTED = 5, 20  # changes in the text and in the document
_TWO_ROBOTS = "mapdeal diff MAP --params-file A --against B compares two robots"
_METADATA = ("mode", "negate", "occupied_thresh", "free_thresh", "cost_scale")
_WORDS = {"closed": "now 253 or more", "opened": "no longer 253 or more", "unknown": "now unknown",
          "known": "no longer unknown", "rose": "cost more", "fell": "cost less"}  # fmt: skip


@records.dataclass(frozen=True, eq=False, repr=False)
class DiffReport(difference.Difference, Result):
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

    bounds: tuple[difference.Bound, ...]
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
            "walls": {name: shift and records.asdict(shift) for name, shift in shifts.items()},
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

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        shown = one_line(title or self.title)
        return comparisons.difference_image(self.changes, self.frame, title=shown, **look)

    def _verdict(self) -> Iterator[str]:
        yield "equal" if self.is_equal else "different"
        if self.bounds:
            yield "within the bounds" if self.passes else "beyond the bounds"

    def _confusion_matrix(self) -> Iterator[str]:
        table = self.confusion
        shown = {
            state: "1..99" if state == "between" else state
            for state in difference.STATES
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


def _shift_text(name: str, shift: difference.WallShift | None) -> str:
    if shift is None:
        return f"{name}: no obstacles"
    text = f"directed Hausdorff distance {name}: {shift.largest:.4g} m; 95 % within "
    return text + f"{shift.percentile_95:.4g} m, mean {shift.mean:.4g} m"


def diff(
    first: Annotated[inputs.Map, Words("A")], second: Annotated[inputs.Map, Words("B")], *,
    tolerance: Annotated[float, AT_LEAST_0, CELLS] = 0.0,
    max_shift: Annotated[float | None, AT_LEAST_0, METRES] = None,
    max_differing: Annotated[float | None, PERCENT, Words("PERCENT")] = None, align: bool = False,
    by: Annotated[two_maps.TransformLike, Words("FILE", typed=Path)] = None,
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
    return _maps_compared(maps, move, limits)


def _maps_compared(
    maps: Sequence[inputs.MapInput], move: Transform | None, limits: Mapping[str, Any]
) -> DiffReport:
    a, b = maps
    advice = "--align places the first map by its walls" if move is None else ""
    found = compared(maps, tolerance=limits["tolerance"], move=move, advice=advice)
    bounds = found.bounds_of(limits["max_shift"], limits["max_differing"])
    two_maps.warn_of_uncovered(maps, bounds, found.not_compared)
    faults: tuple[scoring.Fault, ...] = ()
    if not found.is_equal:
        truth = a.occupancy
        estimate = scoring.states_on(truth.frame, b.occupancy, move and move.inverse())
        faults = scoring.faults_of(estimate, scoring.states_of(truth.occupancy), truth.frame)
    return DiffReport(**vars(found), bounds=bounds, maps=(a, b), transform=move, faults=faults)


def change_text(change: difference.CostChange) -> str:
    text = f"{count_text(change.cells, 'cell')} ({decimal_text(change.area)} m2) "
    text += _WORDS[change.kind]
    if change.by_size:
        sizes = (f"{count} by {size}" for size, count in change.by_size.items() if count)
        text += f": {', '.join(sizes)}"
    return f"{text}; {count_text(change.regions, 'region')}, the largest {change.largest[0].place}"


def costs_document(found: difference.CostDifference) -> dict[str, Any]:
    return {
        "cost_scale": found.scale, "common_cells": found.common_cells,
        "differing": found.differing,
        "differing_m2": rounded(found.differing * found.frame.resolution**2),
        "known_only_in_first": found.not_compared,
        "changes": {
            change.kind: {
                "cells": change.cells, "area_m2": rounded(change.area),
                **({"by_size": change.by_size} if change.by_size else {}),
                "regions": change.regions, "largest": [
                    {"x": rounded(region.x), "y": rounded(region.y), "cells": len(region.cells),
                     "area_m2": rounded(region.area)}
                    for region in change.largest
                ],
            }
            for change in found.changes.values()
        },
    }  # fmt: skip


def costs_lines(found: difference.CostDifference) -> Iterator[str]:
    counts = f"{found.common_cells} cells in both, {found.differing} differ"
    yield f"  costs     {counts} ({decimal_text(found.differing * found.frame.resolution**2)} m2)"
    for kind, change in found.changes.items():
        if change.cells:
            yield f"  {kind:<9} {change_text(change)}"


def costs_image(found: difference.CostDifference, **look: Any) -> canvas.Image:
    look["style"] = styles.cost_change_style()
    return comparisons.difference_image(change_codes(found), found.frame, **look)


def change_codes(found: difference.CostDifference) -> Any:
    costs = found.first_costs, found.second_costs
    return styles.cost_change_codes(*costs, found.is_common, found.masks)


@records.dataclass(frozen=True, eq=False, repr=False)
class CostmapDiff(Result):
    costs: difference.CostDifference
    bounds: tuple[difference.Bound, ...]
    maps: Sequence[inputs.MapInput]
    transform: Transform | None = None

    @property
    def passes(self) -> bool:  # type: ignore[override]
        return all(bound.holds for bound in self.bounds) if self.bounds else self.costs.is_equal

    def document(self) -> dict[str, Any]:
        return {
            "format": COST_DIFF_FORMAT, "first": self.maps[0].document(),
            "second": self.maps[1].document(), "equal": self.costs.is_equal,
            "geometry": {name: list(pair) for name, pair in self.costs.geometry.items()},
            **costs_document(self.costs),
            "transform": self.transform and transform_document(self.transform),
            "bounds": {bound.name.replace("-", "_"): bound.document() for bound in self.bounds},
            "passes": self.passes,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        verdict = "equal costs" if self.costs.is_equal else "different costs"
        if self.bounds:
            verdict += f", {'within' if self.passes else 'beyond'} the bounds"
        yield f"{self.maps[0].name}, {self.maps[1].name}: {verdict}"
        yield from (f"  geometry  {key} {a} -> {b}" for key, (a, b) in self.costs.geometry.items())
        yield from costs_lines(self.costs)
        if self.transform is not None:
            yield two_maps.moved_line(self.transform)
        yield from (f"  bound     {bound.text}" for bound in self.bounds)

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        names = two_maps.names_of_two(*(Path(source.name) for source in self.maps))
        shown = title or f"{' and '.join(names)}: costs that differ"
        return costs_image(self.costs, title=one_line(shown), **look)


def costmaps_compared(
    maps: Sequence[inputs.MapInput], move: Transform | None, max_differing: float | None
) -> CostmapDiff:
    for source in maps:
        if not isinstance(source.grid, costmap.Costmap):
            raise ParameterError("holds no costs", source=source.name)
    first, second = (cast("costmap.Costmap", source.grid) for source in maps)
    if move is not None:
        second = second.with_values(second.cost, move.inverse().frame(second.frame).origin)
    if first.scale != second.scale:
        rule = "has costs on the occupancy scale: both are compared as ROS publishes them"
        emit_warning(f"{maps[first.scale == 'costmap2d'].name}: {rule}")
    with inputs.errors_named(maps[1].name):
        frame = difference.frame_around(first.frame, second.frame)
        size = f"{frame.width} x {frame.height} cells"
        needed = _COST_LIBRARIES + _PER_COST_CELL * frame.height * frame.width
        needed += bytes_of_lines(frame.shape, _PER_COST_LINE)

        def claim_with(changes: int) -> None:
            inputs.claim_for(maps, needed + changes, size)

        claim_with(0)
        with threads.tables_claimed(claim_with):
            found = difference.compare_costmaps(first, second)
    bounds: tuple[difference.Bound, ...] = ()
    if max_differing is not None:
        bounds = (difference.Bound.on_share(max_differing, found.differing, found.common_cells),)
    two_maps.warn_of_uncovered(maps, bounds, found.not_compared)
    return CostmapDiff(found, bounds, maps, move)


@records.dataclass(frozen=True, eq=False, repr=False)
class RobotDiff(Result):
    """What changes for a robot on one map between two versions of its parameters, A and B.

    Parameters
    ----------
    map : MapInput
        The map.
    robots : tuple of RobotParameters
        Both versions.
    parameters : dict
        Pairs of values of the resolved parameters that differ in six digits, by layer and name.
    costs : CostDifference
        Differences between the costmaps.
    costmaps : tuple of Costmap
        Both costmaps.
    reaches : tuple of Reach
        Where the robot gets from the same start.
    closed, opened : tuple of Passage
        Passages that stop the robot of B, but not that of A, and the other way round.
    lost, gained : tuple of GoalReach
        Goals that only the robot of A reaches, as they are for B; and those that only B reaches.
    mask : KeepoutMask, optional
        The keepout mask.
    """

    map: inputs.MapInput
    robots: tuple[RobotParameters, RobotParameters]
    parameters: dict[str, tuple[Any, Any]]
    costs: difference.CostDifference
    costmaps: tuple[costmap.Costmap, costmap.Costmap]
    reaches: tuple[Reach, Reach]
    closed: tuple[Passage, ...]
    opened: tuple[Passage, ...]
    lost: tuple[GoalReach, ...]
    gained: tuple[GoalReach, ...]
    mask: inputs.KeepoutMask | None = None

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether all passages stay open, and all goals stay within reach."""
        return not self.closed and not self.lost

    @property
    def names(self) -> list[str]:
        """Names of the last parameter files that only one of the versions has."""
        first, second = (robot.paths for robot in self.robots)
        only_first = [path for path in first if path not in second] or first
        only_second = [path for path in second if path not in first] or second
        return two_maps.names_of_two(only_first[-1], only_second[-1])

    @property
    def verdict(self) -> str:
        """What opens, closes, is gained and lost, in words."""
        counts = ((self.closed, "passage", "closes", "close"),
                  (self.opened, "passage", "opens", "open"),
                  (self.lost, "goal", "is lost", "are lost"),
                  (self.gained, "goal", "is gained", "are gained"))  # fmt: skip
        texts = [f"{count_text(len(places), noun)} {singular if len(places) == 1 else plural}"
                 for places, noun, singular, plural in counts if places]  # fmt: skip
        return ", ".join(texts) or "no passage closes or opens"

    def document(self) -> dict[str, Any]:
        first, second = self.reaches
        return {
            "format": ROBOT_DIFF_FORMAT, "map": self.map.document(),
            "mask": self.mask and self.mask.document(),
            "robots": [
                {"files": [{"file": str(file.path), "sha256": file.sha256} for file in robot.files],
                 "costmap": robot.costmap, "namespace": robot.namespace}
                for robot in self.robots
            ],
            "parameters": {name: list(pair) for name, pair in self.parameters.items()},
            "costs": costs_document(self.costs), "start": list(first.start),
            "reachable_m2": [rounded(first.reachable_area), rounded(second.reachable_area)],
            "passages": {"closed": [*map(passage_document, self.closed)],
                         "opened": [*map(passage_document, self.opened)]},
            "goals": {"lost": [result.goal.label for result in self.lost],
                      "gained": [result.goal.label for result in self.gained]},
            "reach": [reach_document(first), reach_document(second)], "passes": self.passes,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        yield f"{self.map.name}, {' -> '.join(self.names)}: {self.verdict}"
        for name, pair in self.parameters.items():
            yield f"  parameter {name} {' -> '.join(map(value_text, pair))}"
        yield from costs_lines(self.costs)
        yield f"  reach     {self.reach_text()}"
        for word, passages in (("closes", self.closed), ("opens", self.opened)):
            yield from (f"  {word:<9} passage {passage_text(passage)}" for passage in passages)
        yield from (f"  {word:<9} goal {text}" for word, text in self.goal_rows())

    def goal_rows(self) -> Iterator[tuple[str, str]]:
        """Yield "lost" or "gained" and the goal's name, with the reason if it is lost."""
        for result in self.lost:
            yield "lost", f"{result.goal.label}: {result.stopped_by or 'no way leads there'}"
        yield from (("gained", result.goal.label) for result in self.gained)

    def reach_text(self) -> str:
        """Return the areas that both versions reach, and how many goals."""
        first, second = self.reaches
        x, y = first.start[:2]
        areas = f"{decimal_text(first.reachable_area)} -> {decimal_text(second.reachable_area)} m2"
        text = f"from {x:.6g},{y:.6g}: {areas}"
        if first.goals:
            counts = [sum(goal.reachable for goal in reach.goals) for reach in self.reaches]
            text += f"; {counts[0]} -> {counts[1]} of {count_text(len(first.goals), 'goal')}"
        return text

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        shown = title or f"{self.map.title}, {' and '.join(self.names)}: {self.verdict}"
        return costs_image(self.costs, title=one_line(shown), before=self.reach_text(), **look)


def passage_text(passage: Passage) -> str:
    text = f"at {passage.x + 0.0:.4g},{passage.y + 0.0:.4g}, {passage.width:.4g} m wide, "
    return f"{text}{decimal_text(passage.cut_off)} m2 behind it"


def value_text(value: Any) -> str:
    """Return a parameter with its numbers rounded: ROS's float32 has 0.19 as 0.1899999976."""
    if isinstance(value, list):
        return f"[{','.join(map(value_text, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else format_value(value)


def compare_robots(
    map: inputs.Map, first: RobotParameters, second: RobotParameters, *,  # noqa: A002 - what it is
    start: StartOption = None,
    goals: Annotated[Goals, Words("[NAME=]X,Y", goals_of, "to", is_repeated=True)] = (),
    mask: Annotated[inputs.Map | None, Words()] = None, **reading: Unpack[inputs.Reading],
) -> RobotDiff:  # fmt: skip
    """Compare the costs and reach of two versions of a robot's parameters on a map.

    Parameters
    ----------
    map : path, str or grid
        The map.
    first, second : RobotParameters
        Both versions, A and B, from `read_robot_parameters`.
    start : tuple of float, optional
        Start, metres and radians; by default the widest place of the largest area of the wider one.
    goals : sequence of Goal, optional
        Goal, metres; more may follow.
    mask : path or grid, optional
        Keepout mask over both costmaps, as for `apply_keepout_mask`.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to files.

    Returns
    -------
    RobotDiff
        Parameters and costs that differ, and their effect on reachable area, passages and goals.

    Raises
    ------
    FileAccessError, MalformedInputError
        If the map cannot be read, or a robot cannot stand anywhere.
    ParameterError
        If the input is costs, or a robot cannot stand at the start.

    Notes
    -----
    A passage closes if it stops the robot of B, and that of A reaches both of its sides, or if A
    passes it and B neither fits nor gets there. Passages behind one that closes are not listed if B
    fits into them. Passages are the same if their middles are within half their width or two cells.
    """
    (source,) = inputs.open_inputs(map, names=("the map",), **reading)
    keepout = inputs.mask_of(mask, inputs.settings_of(**reading), source.grid)
    return robots_compared(source, (first, second), start, goals, keepout)


def robots_compared(
    source: inputs.MapInput, robots: tuple[RobotParameters, RobotParameters],
    start: tuple[float, ...] | None, goals: Goals, mask: inputs.KeepoutMask | None,
) -> RobotDiff:  # fmt: skip
    if isinstance(source.grid, costmap.Costmap):
        raise ParameterError("holds costs; parameters are compared on a map", source=source.name)
    inputs.claim_cells(source, COSTS_PER_CELL + _PER_CELL_OF_ROBOTS)
    inputs.warn_of_robot(source.name, source.grid, *robots)
    masks = [inputs.used_mask(mask, robot) for robot in robots]
    steps = [recipe.step_for("cost", robot, {}) for robot in robots]
    costs = [keepout.costs_of(step, source.grid, source.path)[1] if keepout
             else cast("costmap.Costmap", step.apply(source.grid, source.path))
             for step, keepout in zip(steps, masks, strict=True)]  # fmt: skip
    before, after = _reaches(source, robots, start, goals, masks)
    pairs = list(zip(before.goals, after.goals, strict=True))
    first, second = map(_parameters_of, robots)
    parameters = {
        name: (value, second[name])
        for name, value in first.items()
        if name in second and value_text(value) != value_text(second[name])
    }
    return RobotDiff(
        source, robots, parameters, difference.compare_costmaps(*costs),
        (costs[0], costs[1]), (before, after), _closing(before, after), _closing(after, before),
        tuple(result for earlier, result in pairs if earlier.reachable and not result.reachable),
        tuple(result for earlier, result in pairs if result.reachable and not earlier.reachable),
        mask,
    )  # fmt: skip


def _reaches(
    source: inputs.MapInput, robots: Sequence[RobotParameters], start: tuple[float, ...] | None,
    goals: Goals, masks: Sequence[inputs.KeepoutMask | None],
) -> tuple[Reach, Reach]:  # fmt: skip
    """Return where both robots get from one start; by default one that suits the wider robot."""
    shapes = [recipe.planned_shape(robot) for robot in robots]
    wider = sorted((0, 1), key=lambda index: -reach_radius(shapes[index]))

    def reaches_in(order: Sequence[int]) -> dict[int, Reach]:
        found: dict[int, Reach] = {}
        place = start
        for index in order:
            step = make_step("reach", {"start": place, "goals": goals, "footprint": shapes[index]})
            found[index] = reach_on_input(source, step, robots[index], masks[index])
            place = found[index].start
        return found

    try:
        reaches = reaches_in(wider)
    except ParameterError:
        if start is not None:
            raise
        reaches = reaches_in(wider[::-1])  # only the wider robot may cross unknown cells
    return reaches[0], reaches[1]


def _closing(before: Reach, after: Reach) -> tuple[Passage, ...]:
    stops = [p for p in after.passages if not p.is_open and _is_passed(p, before)]
    vanished = [p for p in before.passages if p.is_open and not _is_passed(p, after)
                and not any(_is_same(p, q, after) for q in after.passages)]  # fmt: skip
    # If the robot fits into a passage but does not get there, an earlier passage has closed.
    closed = stops + [p for p in vanished if not _near(p, after, after.headings)]
    return tuple(closed or vanished)


def _is_passed(passage: Passage, reach: Reach) -> bool:
    for known in reach.passages:
        if _is_same(known, passage, reach):
            return known.is_open
    return _near(passage, reach, reach.reachable)


def _near(passage: Passage, reach: Reach, layer: arrays.Bytes) -> bool:
    ((row, col),) = reach.frame.unbounded_rowcol_from_xy([(passage.x, passage.y)]).tolist()
    return bool(np.any(layer[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]))


def _is_same(first: Passage, second: Passage, reach: Reach) -> bool:
    nearest = max(2 * reach.resolution, max(first.width, second.width) / 2)
    return math.dist((first.x, first.y), (second.x, second.y)) <= nearest


def _parameters_of(robot: RobotParameters) -> dict[str, Any]:
    described = robot.described()
    layers = described.pop("layers")
    del described["files"]
    if robot.robot_radius is not None:
        described["footprint"] = None  # its sixteen corners follow from the radius
    own = {f"{layer['name']}.{key}": value for layer in layers
           for key, value in layer.items() if key != "name"}  # fmt: skip
    return described | {"layers": [layer["name"] for layer in layers]} | own


@command(
    name="diff",
    also={"": diff, "With --against": compare_robots},
    shared=("params_file", "costmap", "namespace", "against", "mask", "files"),
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
        return _maps_compared(maps, move, limits)
    of_maps = {"max_shift": limits["max_shift"], "tolerance": limits["tolerance"] or None}
    inputs.refuse("applies to maps, and both are costs", **of_maps)
    return costmaps_compared(maps, move, limits["max_differing"])


def compared(
    maps: Sequence[inputs.MapInput], *, tolerance: float = 0.0, move: Transform | None = None,
    advice: str = "",
) -> difference.Difference:  # fmt: skip
    # With `advice`, maps that do not lie in one frame are warned of.
    grids = [source.occupancy for source in maps]
    if move is not None:
        frame = move.inverse().frame(grids[1].frame)
        grids[1] = occupancy.OccupancyGrid(grids[1].occupancy, frame.resolution, frame.origin)
    with inputs.errors_named(maps[1].name):
        frame = difference.frame_around(*(grid.frame for grid in grids))
        walls = sum(int(lookup.histogram(grid.occupancy)[OCCUPIED]) for grid in grids)
        needed = _LIBRARIES + _PER_CELL * frame.height * frame.width + _PER_WALL * walls
        needed += bytes_of_lines(frame.shape, _PER_LINE)
        inputs.claim_for(maps, needed, f"{frame.width} x {frame.height} cells")
        if advice:
            two_maps.warn_of_frames(maps, advice)
        return difference.compare(*grids, tolerance=tolerance)
