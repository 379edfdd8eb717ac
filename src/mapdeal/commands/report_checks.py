"""Checks of ``run --report``: findings of lint on its maps, and where the robot can go."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from mapdeal.checks.lint import LintReport
from mapdeal.commands.lint import lint
from mapdeal.commands.reach import Reachability, reach_on_input
from mapdeal.commands.report_documents import Results, results_of, short
from mapdeal.commands.report_entries import Draft
from mapdeal.commands.report_next import ReachQuestion, robot_words, typed_path
from mapdeal.errors import MapdealError, one_line
from mapdeal.files.json_values import JsonValue, json_of
from mapdeal.files.source import holding
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal, Reach
from mapdeal.pipeline.folder import reach_document
from mapdeal.pipeline.inputs import KeepoutMask, Work, map_input, mask_of, read_input
from mapdeal.pipeline.recipe import planned_shape
from mapdeal.pipeline.settings import Settings, adding_warnings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.report.document import Claim, PageLayer, State, page_layers
from mapdeal.report.verdict import on_no_robot
from mapdeal.ros.robot import RobotParameters


@dataclass(frozen=True)
class GoalAnswer:
    path: Path
    lines: Sequence[str]
    document: Mapping[str, Any]
    problem: str | None = None


@dataclass(frozen=True)
class RunChecks:
    """Who is to go where on the maps of a run, of which each is in the folder that names it."""

    settings: Settings
    footprint: Footprint | None = None
    robot: RobotParameters | None = None
    start: tuple[float, ...] | None = None
    goals: Sequence[Goal] = field(default=())
    map_of_folder: Mapping[Path, Path] = field(default_factory=dict)
    _answered: set[int] = field(default_factory=set)

    @property
    def has_goals(self) -> bool:
        return bool(self.goals) or self.start is not None

    @property
    def _shape(self) -> Footprint | None:
        if self.footprint is None and self.robot is not None:
            return planned_shape(self.robot)
        return self.footprint

    @property
    def question(self) -> ReachQuestion:
        robot, words = self.robot, [*robot_words(self.footprint)]
        if robot is not None:
            words += [text for path in robot.paths for text in ("--params-file", typed_path(path))]
            words += [] if robot.costmap == "global" else ["--costmap", robot.costmap]
            namespace, _, node = robot.node.partition(f"/{robot.costmap}_costmap/")
            words += ["--namespace", namespace] if namespace and node else []
        mask = self.settings.mask
        words += [] if mask is None else ["--mask", typed_path(mask)]
        return ReachQuestion(tuple(self.start or ()), tuple(self.goals), tuple(words))

    @cached_property
    def _mask(self) -> KeepoutMask | None:
        return mask_of(self.settings.mask, self.settings)

    @cached_property
    def _step(self) -> Step:
        start = {} if self.start is None else {"start": self.start}
        return make_step(
            "reach", {**start, "goals": tuple(self.goals), "footprint": self._shape}
        )  # fmt: skip

    def findings(self, paths: Sequence[Path]) -> Results:
        def linted() -> LintReport:
            Work.current.set(None)  # lint is not the command under way
            settings = self.settings
            return lint(
                paths, footprint=self._shape, max_cells=settings.max_cells,
                max_memory=settings.max_memory,
            )  # fmt: skip

        document = json.loads(json_of(copy_context().run(linted).document()))
        return results_of(JsonValue(Path("lint"), document))

    def reachability(self, path: Path) -> Reachability:
        source = map_input(read_input(path, self.settings), path)
        found = reach_on_input(source, self._step, self.robot, self._mask)
        return Reachability(source, found, self._step.title)

    def answer(self, path: Path) -> GoalAnswer:
        lines: list[str] = []
        document: dict[str, Any] = {}
        try:
            found = self.reachability(path)
            with_goals = islice(found.lines(), 1 + len(found.reach.goals))  # without passages
            lines, document = list(with_goals), found.document()
            found.check()
        except MapdealError as error:
            return GoalAnswer(path, lines, document, str(error.found_in(path)))
        return GoalAnswer(path, lines, document)

    def add_reach(self, draft: Draft, path: Path, *, with_layer: bool, grid_bytes: int) -> None:
        """Add where the robot can go on a map to its draft, unless its own recipe has asked."""
        has_asked = any(claim.about == "goals" for claim in draft.claims)
        if has_asked and (not self.has_goals or id(draft) in self._answered):
            return
        self._answered.add(id(draft))
        if self._shape is None and not self.has_goals:
            draft.claims.append(on_no_robot())
            return
        texts: list[str] = []
        try:
            with adding_warnings(texts), holding(grid_bytes):
                found = self.reachability(path).reach
        except MapdealError as error:
            is_too_large = error.hint is not None and "--max-memory" in error.hint
            state: State = "unknown" if is_too_large else "error"
            if is_too_large:
                draft.lacks("where the robot can go", path, error)
            rule = ": ".join(filter(None, (error.place, error.rule)))
            words = f"Where the robot can go was not found: {rule}"
            draft.claims.append(Claim("goals", state, short(one_line(words))))
            return
        draft.warn(texts, [path])
        draft.add(results_of(JsonValue(path, reach_document(found))))
        if with_layer:
            draft.layers += _layers_of(found, draft.free_name("reach"), self._step.title)


def _layers_of(found: Reach, name: str, title: str) -> list[PageLayer]:
    return page_layers(found, name, title[:1].upper() + title[1:])[-1:]
