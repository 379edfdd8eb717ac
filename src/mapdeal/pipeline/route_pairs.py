"""Routes of many pairs of points, by several methods, beside each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mapdeal.errors import BatchError, FindingError, MalformedInputError, ParameterError
from mapdeal.formats.points import PairLine
from mapdeal.formats.routes import failed_line, route_line
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.route import Route
from mapdeal.pipeline.files import errors_named, outputs_of, read_input
from mapdeal.pipeline.memory import claim_work
from mapdeal.pipeline.route import HEURISTIC_WEIGHT, PLACES_OF_FIELD, costs_of
from mapdeal.pipeline.settings import Settings
from mapdeal.planning.astar import route_over, surcharges_near_obstacles
from mapdeal.planning.terrain import Terrain
from mapdeal.records import dataclass
from mapdeal.robot.parameters import RobotParameters

FIELD_WEIGHT = 1.0
"""Of method ``cost``, if none is given: at an obstacle a metre costs one more."""

_PER_CELL = 60.0
"""Bytes for each cell, those of the recipe included."""

_AVERAGED = ("mean_clearance", "min_clearance", "length", "cost", "expanded")


@dataclass(frozen=True)
class PairsReport:
    """What has become of pairs of points."""

    pairs: int
    failed: int
    unreached: int
    means: dict[str, dict[str, float]]

    @property
    def reached(self) -> int:
        """Pairs with routes that reach the goal."""
        return self.pairs - self.failed - self.unreached

    def check(self, source: Path | str) -> None:
        """Raise an error if a pair has no routes, or its goal was not reached."""
        if self.failed:
            raise BatchError(f"{self.failed} of {self.pairs} pairs have no routes", source=source)
        if self.unreached:
            rule = f"no route leads from start to goal in {self.unreached} of {self.pairs} pairs"
            raise FindingError(rule, source=source)


class _Tally:
    """Counts and sums of routes, whose points are not kept: there may be any number of pairs."""

    def __init__(self, methods: Iterable[str]) -> None:
        self._sums = {method: dict.fromkeys(_AVERAGED, 0.0) for method in methods}
        self._failed = self._reached = self._unreached = 0

    def add(self, found: Mapping[str, Route]) -> None:
        """Count a pair by what each method has found; nothing if it could not be planned."""
        if not found:
            self._failed += 1
        elif not all(route.reached for route in found.values()):
            self._unreached += 1
        else:
            self._reached += 1
            for method, route in found.items():
                for name in _AVERAGED:
                    self._sums[method][name] += getattr(route, name)

    def report(self) -> PairsReport:
        """Return what was counted."""
        pairs = self._failed + self._reached + self._unreached
        means = {
            method: {name: value / self._reached for name, value in sums.items()}
            for method, sums in self._sums.items()
            if self._reached
        }
        return PairsReport(pairs, self._failed, self._unreached, means)


def compare_pairs(
    path: Path,
    asked: Iterable[PairLine],
    output: Path | None,
    options: Settings,
    *,
    asked_from: Path | str,
    methods: Sequence[str] = PLACES_OF_FIELD,
    footprint: Footprint | None = None,
    robot: RobotParameters | None = None,
    weights: Mapping[str, Any] | None = None,
    field_weight: float = FIELD_WEIGHT,
    heuristic_weight: float = HEURISTIC_WEIGHT,
    show: Callable[[str], object] = lambda _: None,
) -> PairsReport:
    """Find routes of pairs of points by each method, and write a line of JSON for each."""
    if output is not None and output.suffix != ".jsonl":
        raise ParameterError("routes of pairs are written as .jsonl", source=output)
    if not methods or not set(methods) <= set(PLACES_OF_FIELD):
        rule = f"must be some of {', '.join(PLACES_OF_FIELD)}"
        raise ParameterError(rule, source="--compare", got=",".join(methods))
    if options.image is not None:
        raise ParameterError("applies to one route, not to --pairs", source="--image")
    source = read_input(path, options)
    with options.memory():
        claim_work(path, source.grid, _PER_CELL)
    outputs = [] if output is None else [output]
    inputs = [*source.files, *(robot.paths if robot else ())]
    inputs += [asked_from] if isinstance(asked_from, Path) else []
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            terrain = Terrain.of(costs_of(source, path, footprint, robot), **(weights or {}))
            searches = {
                method: _search_of(method, terrain, field_weight, heuristic_weight)
                for method in dict.fromkeys(methods)
            }
        tally = _Tally(searches)
        lines = _lines_of(asked, terrain, searches, tally)
        if output is None:
            for line in lines:
                show(line)
        else:
            transaction.write_parts(output, (f"{line}\n".encode() for line in lines))
        report = tally.report()
        if report.pairs == 0:
            raise MalformedInputError("holds no pairs of points", source=asked_from)
    return report


def _search_of(
    method: str, terrain: Terrain, field_weight: float, heuristic_weight: float
) -> dict[str, Any]:
    """Return what a method hands to `route_over`."""
    if method == "cost":
        return {"weights": terrain.weights_near_obstacles(field_weight)}
    if method == "heuristic":
        return {"surcharges": surcharges_near_obstacles(terrain, heuristic_weight)}
    return {}


def _lines_of(
    asked: Iterable[PairLine],
    terrain: Terrain,
    searches: Mapping[str, Mapping[str, Any]],
    tally: _Tally,
) -> Iterator[str]:
    """Yield the lines of each pair once it is planned, and counted."""
    for pair, one in enumerate(asked, 1):
        found, texts = _answer(pair, one, terrain, searches)
        tally.add(found)
        yield from texts


def _answer(
    pair: int,
    asked: PairLine,
    terrain: Terrain,
    searches: Mapping[str, Mapping[str, Any]],
) -> tuple[dict[str, Route], list[str]]:
    """Return the route of each method between two points, and the lines that describe them."""
    if asked.start is None or asked.goal is None:
        return {}, [failed_line(asked, pair=pair, error=str(asked.error))]
    try:
        found = {
            method: route_over(terrain, asked.start, asked.goal, **search)
            for method, search in searches.items()
        }
    except ParameterError as error:
        return {}, [failed_line(asked, pair=pair, error=str(error), hint=error.hint)]
    return found, [route_line(route, pair=pair, method=method) for method, route in found.items()]
