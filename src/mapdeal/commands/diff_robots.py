"""Parts of ``mapdeal diff``: what two versions of a robot's parameters change on one map."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, cast

import numpy as np

from mapdeal.command import POSE, Result
from mapdeal.commands import two_maps
from mapdeal.commands.diff_costs import costs_document, costs_image, costs_lines
from mapdeal.commands.reach import COSTS_PER_CELL, reach_on_input
from mapdeal.compare.costs import CostDifference, compare_costmaps
from mapdeal.compatibility import Unpack
from mapdeal.errors import ParameterError, one_line
from mapdeal.files.json_values import ROBOT_DIFF_FORMAT
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.reach import GoalReach, Passage, Reach, reach_radius
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.pictures.canvas import Image
from mapdeal.pipeline.folder import format_value, passage_document, reach_document, rounded
from mapdeal.pipeline.inputs import Map, MapInput, Reading, claim_cells, opened
from mapdeal.pipeline.recipe import planned_shape, step_for
from mapdeal.pipeline.step import make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.structured import Goals

_PER_CELL = 175.0
"""Bytes for each cell of a map that both costmaps, their difference and one reach take."""

Pair = tuple[Any, Any]


@dataclass(frozen=True, eq=False, repr=False)
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
    """

    map: MapInput
    robots: tuple[RobotParameters, RobotParameters]
    parameters: dict[str, Pair]
    costs: CostDifference
    costmaps: tuple[Costmap, Costmap]
    reaches: tuple[Reach, Reach]
    closed: tuple[Passage, ...]
    opened: tuple[Passage, ...]
    lost: tuple[GoalReach, ...]
    gained: tuple[GoalReach, ...]

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
        counts = (
            (self.closed, "passage", "closes", "close"), (self.opened, "passage", "opens", "open"),
            (self.lost, "goal", "is lost", "are lost"),
            (self.gained, "goal", "is gained", "are gained"),
        )  # fmt: skip
        texts = [
            f"{count_text(len(places), noun)} {singular if len(places) == 1 else plural}"
            for places, noun, singular, plural in counts
            if places
        ]
        return ", ".join(texts) or "no passage closes or opens"

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints."""
        first, second = self.reaches
        return {
            "format": ROBOT_DIFF_FORMAT,
            "map": self.map.document(),
            "robots": [
                {
                    "files": [{"file": str(file.path), "sha256": file.sha256}
                              for file in robot.files],
                    "costmap": robot.costmap, "namespace": robot.namespace,
                }
                for robot in self.robots
            ],
            "parameters": {name: list(pair) for name, pair in self.parameters.items()},
            "costs": costs_document(self.costs),
            "start": list(first.start),
            "reachable_m2": [rounded(first.reachable_area), rounded(second.reachable_area)],
            "passages": {
                "closed": [passage_document(passage) for passage in self.closed],
                "opened": [passage_document(passage) for passage in self.opened],
            },
            "goals": {
                "lost": [result.goal.label for result in self.lost],
                "gained": [result.goal.label for result in self.gained],
            },
            "reach": [reach_document(first), reach_document(second)],
            "passes": self.passes,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        yield f"{self.map.name}, {' -> '.join(self.names)}: {self.verdict}"
        for name, pair in self.parameters.items():
            yield f"  parameter {name} {' -> '.join(map(value_text, pair))}"
        yield from costs_lines(self.costs)
        yield f"  reach     {self.reach_text()}"
        for word, passages in (("closes", self.closed), ("opens", self.opened)):
            for passage in passages:
                yield f"  {word:<9} passage {passage_text(passage)}"
        for word, text in self.goal_rows():
            yield f"  {word:<9} goal {text}"

    def goal_rows(self) -> Iterator[tuple[str, str]]:
        """Yield for each goal that is lost or gained this word, its name, and why it is lost."""
        for result in self.lost:
            reason = result.stopped_by or "no way leads there"
            yield "lost", f"{result.goal.label}: {reason}"
        for result in self.gained:
            yield "gained", result.goal.label

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

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        """Return the picture of the changes of the costs."""
        shown = title or f"{self.map.title}, {' and '.join(self.names)}: {self.verdict}"
        return costs_image(self.costs, title=one_line(shown), before=self.reach_text(), **look)


def passage_text(passage: Passage) -> str:
    place = f"{passage.x + 0.0:.4g},{passage.y + 0.0:.4g}"
    return f"at {place}, {passage.width:.4g} m wide, {decimal_text(passage.cut_off)} m2 behind it"


def value_text(value: Any) -> str:
    """Return a parameter with its numbers rounded: ROS's float32 has 0.19 as 0.1899999976."""
    if isinstance(value, list):
        return f"[{','.join(map(value_text, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else format_value(value)


def compare_robots(
    map: Map,  # noqa: A002 - what it is
    first: RobotParameters,
    second: RobotParameters,
    *,
    start: Annotated[tuple[float, ...], POSE] | None = None,
    goals: Goals = (),
    **reading: Unpack[Reading],
) -> RobotDiff:
    """Compare what two versions of a robot's parameters make of one map.

    Parameters
    ----------
    map : path, str or grid
        The map.
    first, second : RobotParameters
        Both versions, A and B, from `read_robot_parameters`.
    start : tuple of float, optional
        Start, metres and radians. By default the widest place of the largest area that is free for
        the wider robot.
    goals : sequence of Goal, optional
        Goal, metres; more may follow.
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
    A passage closes if it stops the robot of B, and that of A reaches both of its sides. Passages
    of the two are the same if their middles are closer than half their width or two cells.
    """
    (source,) = opened(map, names=("the map",), **reading)
    return robots_compared(source, first, second, start, goals, **reading)


def robots_compared(
    source: MapInput, first: RobotParameters, second: RobotParameters,
    start: tuple[float, ...] | None, goals: Goals, **reading: Unpack[Reading],
) -> RobotDiff:  # fmt: skip
    if isinstance(source.grid, Costmap):
        raise ParameterError("holds costs; parameters are compared on a map", source=source.name)
    claim_cells(source, COSTS_PER_CELL + _PER_CELL, **reading)
    robots = first, second
    steps = [step_for("cost", robot, {}) for robot in robots]
    costs = [cast("Costmap", step.apply(source.grid, source.path)) for step in steps]
    before, after = _reaches(source, robots, start, goals)
    pairs = list(zip(before.goals, after.goals, strict=True))
    return RobotDiff(
        source, robots, _differing_parameters(*robots), compare_costmaps(*costs),
        (costs[0], costs[1]), (before, after), _closing(before, after), _closing(after, before),
        tuple(result for earlier, result in pairs if earlier.reachable and not result.reachable),
        tuple(result for earlier, result in pairs if result.reachable and not earlier.reachable),
    )  # fmt: skip


def _reaches(
    source: MapInput, robots: Sequence[RobotParameters], start: tuple[float, ...] | None,
    goals: Goals,
) -> tuple[Reach, Reach]:  # fmt: skip
    """Return where both robots get from one start; by default one that suits the wider robot."""
    shapes = [planned_shape(robot) for robot in robots]
    wider = sorted((0, 1), key=lambda index: -reach_radius(shapes[index]))

    def reaches_in(order: Sequence[int]) -> dict[int, Reach]:
        found: dict[int, Reach] = {}
        place = start
        for index in order:
            step = make_step("reach", {"start": place, "goals": goals, "footprint": shapes[index]})
            found[index] = reach_on_input(source, step, robots[index], None)
            place = found[index].start
        return found

    try:
        reaches = reaches_in(wider)
    except ParameterError:
        if start is not None:
            raise
        reaches = reaches_in(wider[::-1])  # unknown cells may be open to the wider robot alone
    return reaches[0], reaches[1]


def _closing(before: Reach, after: Reach) -> tuple[Passage, ...]:
    return tuple(
        passage for passage in after.passages
        if not passage.is_open and _is_passed(passage, before)
    )  # fmt: skip


def _is_passed(passage: Passage, reach: Reach) -> bool:
    """Return whether a robot gets through a passage that was found for another robot."""
    middle = passage.x, passage.y
    for known in reach.passages:
        nearest = max(2 * reach.resolution, max(known.width, passage.width) / 2)
        if math.dist((known.x, known.y), middle) <= nearest:
            return known.is_open
    ((row, col),) = reach.frame.unbounded_rowcol_from_xy([middle]).tolist()
    rows, cols = slice(max(row - 1, 0), row + 2), slice(max(col - 1, 0), col + 2)
    return bool(np.any(reach.reachable[rows, cols]))


def _differing_parameters(first: RobotParameters, second: RobotParameters) -> dict[str, Pair]:
    values = _parameters_of(second)
    return {
        name: (value, values[name])
        for name, value in _parameters_of(first).items()
        if name in values and value_text(value) != value_text(values[name])
    }


def _parameters_of(robot: RobotParameters) -> dict[str, Any]:
    """Return the resolved parameters by name, those of a layer behind its name."""
    described = robot.described()
    layers = described.pop("layers")
    del described["files"]
    if robot.robot_radius is not None:
        described["footprint"] = None  # its sixteen corners follow from the radius
    own = {
        f"{layer['name']}.{key}": value
        for layer in layers for key, value in layer.items() if key != "name"
    }  # fmt: skip
    return described | {"layers": [layer["name"] for layer in layers]} | own
