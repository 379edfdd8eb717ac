"""The command that a verdict proposes, as it is typed in the folder where the report is made."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from mapdeal.errors import one_line
from mapdeal.files.source import absolute_path
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal
from mapdeal.report.document import About, Claim, State

_BY_URGENCY: tuple[About, ...] = ("run", "map", "goals")
_OF_TWO_MAPS: set[About] = {"obstacles", "cells", "geometry"}
_SHAPES = {"--robot-radius", "--footprint", "--params-file"}
_NAV2_RADIUS = ("--robot-radius", "0.22")  # the default of Nav2


@dataclass(frozen=True)
class ReachQuestion:
    """Start and goals of a result of reach; its robot as options."""

    start: tuple[float, ...]
    goals: tuple[Goal, ...]
    robot: tuple[str, ...]


def robot_words(footprint: Footprint | None) -> tuple[str, ...]:
    """Return the options that give a robot this shape."""
    if footprint is None:
        return ()
    if footprint.vertices:
        return ("--footprint", json.dumps([list(corner) for corner in footprint.vertices]))
    return ("--robot-radius", f"{footprint.radius:.9g}")


def typed_path(path: Path) -> str:
    """Return the name of a file from the working folder; no page shows an absolute one."""
    text = str(path)
    if path.is_absolute():
        folder = absolute_path(Path())
        has_common_folder = len({*path.parents} & {folder, *folder.parents}) > 1
        text = os.path.relpath(path) if has_common_folder else path.name
    return f"./{text}" if text.startswith("-") else text


def next_command(
    claims: Iterable[Claim], named: Path, map_path: Path | None, question: ReachQuestion | None,
    options: Sequence[str], dialect: Sequence[str],
) -> str:  # fmt: skip
    """Return the command that follows from the claims about a map; empty if there is none."""
    by_subject = {claim.about: claim for claim in claims}
    if by_subject.keys() & _OF_TWO_MAPS:
        return ""
    about_map = [by_subject[about] for about in _BY_URGENCY if about in by_subject]
    worst = min(about_map, key=lambda claim: get_args(State).index(claim.state), default=None)
    goals, robot = by_subject.get("goals"), question.robot if question else ()
    robot = robot if _SHAPES & {*robot} else (*_NAV2_RADIUS, *robot)
    if map_path is None:
        words = ["info", typed_path(named)]
    elif worst is None or (worst is not goals and worst.state != "good"):
        words = ["lint", typed_path(map_path), *options]
    elif "costmap" in by_subject and (goals is None or goals.state == "unknown"):
        words = ["run", typed_path(map_path), *options, *dialect, "-o", "nav2"]
        words += ["--recipe", "nav2", *robot, "--report"]
    else:
        start, targets = (question.start, question.goals) if question else ((), ())
        if goals is not None and not goals.evidence:  # reach refused the start
            start = ()
        is_routed = goals is not None and goals.state == "good" and bool(start and targets)
        words = ["route" if is_routed else "reach", typed_path(map_path), *options, *dialect]
        words += ["--from", _numbers(start[: 2 if is_routed else 3])] if start else []
        texts = [_numbers((targets[0].x, targets[0].y))] if is_routed else map(_goal, targets)
        words += ["--to", *texts] if targets else []
        words += robot
    line = shlex.join(["mapdeal", *words])
    return line if line == one_line(line) else ""


def _numbers(values: Iterable[float]) -> str:
    return ",".join(f"{value + 0.0:.9g}" for value in values)


def _goal(goal: Goal) -> str:
    name = "" if goal.name is None or "=" in goal.name else f"{goal.name}="
    return f"{name}{_numbers((goal.x, goal.y))}"
