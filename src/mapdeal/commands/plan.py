"""``mapdeal plan``: whether the robot's own planner finds a path, and else what must change."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from mapdeal import errors
from mapdeal.command import POSE, Output, Words, command
from mapdeal.commands.plan_changes import Change, PlannerOnMap, changes_for, is_cut_off, margins_of
from mapdeal.commands.reach import start_of
from mapdeal.compatibility import Unpack
from mapdeal.files.json_values import PLAN_FORMAT, JsonValue, read_document
from mapdeal.grid import costmap, values
from mapdeal.mapping.transforms import check_pose
from mapdeal.maps import dialects, npz
from mapdeal.maps.listing import list_maps
from mapdeal.maps.reading import write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.layers import cost_image
from mapdeal.pictures.overlay import PlanOverlay
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.folder import Spread, rounded, rounded_place
from mapdeal.planners.planner import Plan, Pose, no_plan
from mapdeal.records import dataclass, field, replace
from mapdeal.ros.load import error_of
from mapdeal.ros.planners import PLANNER_SERVER, ListedPlanner, has_server, planners_of
from mapdeal.ros.robot import RobotParameters
from mapdeal.ros.ros2_files import Ros2Parameters, read_ros2
from mapdeal.sensors.points import NumberLines, read_pose_pairs

Robot = RobotParameters | str | PathLike[str] | Sequence[str | PathLike[str]]

_PER_CELL = 70.0  # bytes for each cell, those of the costmaps of changed parameters included
_SAME = 1e-6  # metres between lengths of a plan and of an expected one


def _at(point: Sequence[float]) -> str:
    x, y = (round(value, 3) + 0.0 for value in point)
    return f"{x:.10g},{y:.10g}"


@dataclass(frozen=True)
class PlanGoal:
    """A goal: x and y, metres, yaw, radians, and its name, if it has one."""

    x: float
    y: float
    yaw: float = 0.0
    name: str | None = None

    @property
    def pose(self) -> Pose:
        return check_pose((self.x, self.y, self.yaw), "goals")

    @property
    def label(self) -> str:
        place = _at((self.x, self.y))
        return place if self.name is None else f"{self.name} {place}"


@dataclass(frozen=True, eq=False, repr=False)
class GoalPlan(values.OneLineRepr):
    """The plan to a goal, and the changes that make one, or the margins before it is lost.

    Parameters
    ----------
    goal : PlanGoal
        The goal.
    plan : Plan
        The planner's answer.
    changes : sequence of dict, optional
        Without a plan: single changes that each make one, by parameter, or place on the map.
    margins : sequence of dict
        With a plan: the last values of parameters that keep it.
    clearance : float
        Smallest distance from a pose to the centre of a lethal cell, metres.
    narrowest : tuple of float, optional
        Where that is.
    stopped_at : tuple of float, optional
        Without a plan: the place nearest to the goal that a search can reach.
    """

    goal: PlanGoal
    plan: Plan
    changes: Sequence[Change] | None = None
    margins: Sequence[Change] = ()
    clearance: float = math.nan
    narrowest: tuple[float, float] | None = None
    stopped_at: tuple[float, float] | None = None

    def _repr_parts(self) -> Iterator[str]:
        yield from (repr(self.goal), self.verdict)

    def document(self) -> dict[str, Any]:
        goal, plan = self.goal, self.plan
        document: dict[str, Any] = {} if goal.name is None else {"name": goal.name}
        document |= {"x": rounded(goal.x), "y": rounded(goal.y), "yaw": rounded(goal.yaw)}
        document |= plan_entries(plan)
        if plan.found:
            narrowest = rounded_place(*(self.narrowest or (math.nan, math.nan)))
            document |= {"clearance_m": rounded(self.clearance), "narrowest": narrowest}
            document["margins"] = list(self.margins)
        elif self.changes is not None:
            changes = [{**change, "text": change_text(change)} for change in self.changes]
            document["changes"] = changes
        if self.stopped_at is not None:
            document["stopped_at"] = dict(zip("xy", self.stopped_at, strict=True))
        return {**document, "points": plan.poses.tolist()}

    @property
    def verdict(self) -> str:
        if not self.plan.found:
            return f"no path, {self.plan.reason}" if self.plan.is_known else "not known"
        text = f"{self.plan.length:.2f} m"
        if self.narrowest is not None and math.isfinite(self.clearance):
            text += f", at least {self.clearance:.2f} m from obstacles, at {_at(self.narrowest)}"
        return text

    @property
    def best_change(self) -> str | None:
        """The first change that makes a path, in words; those with a note come last."""
        changes = sorted(self.changes or (), key=lambda change: "note" in change)
        return change_text(changes[0]) if changes else None

    def lines(self) -> Iterator[str]:
        plan = self.plan
        yield f"  goal {self.goal.label}: {self.verdict}"
        for margin in self.margins:
            verb = "needs" if margin["to"] is True else "stays up to"
            yield f"    it {verb} {change_text(margin)}"
        if plan.detail is not None:
            yield f"    {plan.detail}"
        if self.stopped_at is not None:
            yield f"    a search from the start comes no nearer than {_at(self.stopped_at)}"
        if self.changes:
            yield "    each of these alone makes a path:"
            yield from ("      " + change_text(change) for change in self.changes)
        elif self.changes is not None and "OutsideMap" not in (plan.reason or ""):
            yield "    no single change of those tried makes a path"


def plan_entries(plan: Plan) -> dict[str, Any]:
    entries: dict[str, Any] = {"found": plan.found if plan.is_known else None}
    entries |= {"reason": plan.reason} | ({} if plan.detail is None else {"detail": plan.detail})
    entries["length_m"] = rounded(plan.length) if plan.found else None
    return entries | ({} if plan.cost is None else {"cost": rounded(plan.cost)})


def change_text(change: Change) -> str:
    place = _at((change["x"], change["y"])) if "map" in change else ""
    if change.get("map") == "passage":
        text = f"the passage at {place}, {change['from']:.4g} m wide, "
        text += f"cleared over a width of {change['width']:g} m"
    elif place:
        text = f"without the obstacle at {place}, {change['area']:.4g} m2"
    elif "scale" in change:
        text = f"{change['parameter']} of {100 * change['scale']:.0f} % of its size"
    else:
        was, value = (f"{number:.10g}" if isinstance(number, float)
                      else json.dumps(number) if isinstance(number, bool) else str(number)
                      for number in (change["from"], change["to"]))  # fmt: skip
        text = f"{change['parameter']} {value} (now {was})"
    text += f"; {change['note']}" if "note" in change else ""
    return text + ("" if change.get("monotonic", True) else "; some values beyond fail again")


def _refuse_differences(differences: Sequence[str] | None, source: str | None = None) -> None:
    if differences:
        rule = f"the plans differ from those expected: {differences[0]}"
        raise errors.FindingError(rule, source=source)


@dataclass(frozen=True, eq=False, repr=False)
class PlanReport(Spread):
    """The plans of a robot's planner from one start to some goals.

    Parameters
    ----------
    work : PlannerOnMap
        The map, the robot and its planner.
    start : tuple of float
        x, y and yaw.
    goals : tuple of GoalPlan
        The plans.
    differences : tuple of str, optional
        Differences from an expected result, if one was given.
    """

    spread = ("goals",)
    work: PlannerOnMap
    start: Pose
    goals: tuple[GoalPlan, ...]
    differences: tuple[str, ...] | None = None

    @property
    def missed(self) -> list[GoalPlan]:
        return [goal for goal in self.goals if goal.plan.is_known and not goal.plan.found]

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether all goals have plans; with an expected result, whether it is met."""
        if self.differences is not None:
            return not self.differences
        return all(goal.plan.found for goal in self.goals)

    def document(self) -> dict[str, Any]:
        listed, robot = self.work.listed, self.work.robot
        return {
            "format": PLAN_FORMAT, "map": self.work.source.document(),
            "files": [{"name": file.path.name, "sha256": file.sha256} for file in robot.files],
            "planner": {"name": listed.name, "plugin": listed.plugin,
                        "parameters": dict(listed.settings)},
            "start": [rounded(value) for value in self.start],
            "goals": [goal.document() for goal in self.goals],
            **({} if self.differences is None else {"differences": list(self.differences)}),
        }  # fmt: skip

    @property
    def rows(self) -> list[tuple[str, ...]]:
        head = self.work.source.name, str(self.work.robot.paths[-1])
        plans = ((plan.goal.label, plan.verdict, plan.best_change or "-") for plan in self.goals)
        return [(*head, *row) for row in plans]

    def lines(self) -> Iterator[str]:
        listed, parameters = self.work.listed, self.work.robot.paths[-1]
        head = f"{self.work.source.name}, {parameters}: {listed.name}, {listed.plugin}"
        yield f"{head}, from {_at(self.start[:2])}"
        for goal in self.goals:
            yield from goal.lines()
        yield from (f"  differs: {text}" for text in self.differences or ())

    def summary(self, output: Path) -> Iterator[str]:
        found = sum(goal.plan.found for goal in self.goals)
        yield f"{output}: paths to {found} of {values.count_text(len(self.goals), 'goal')}"
        yield from self.lines()

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        """Return the costmap with the paths, and the changes that make one."""
        found = [goal for goal in self.goals if goal.plan.found]
        changes = [change for goal in self.missed for change in goal.changes or ()]
        overlay = PlanOverlay(
            [goal.plan.poses[:, :2] for goal in found], self.start[:2],
            [(goal.goal.x, goal.goal.y) for goal in found],
            [(goal.goal.x, goal.goal.y) for goal in self.missed],
            [goal.stopped_at for goal in self.missed if goal.stopped_at is not None],
            [(change["x"], change["y"], change.get("width", 0.0) / 2)
             for change in changes if "map" in change],
        )  # fmt: skip
        title = title or f"{self.work.source.title}: {self.work.listed.name}"
        return cost_image(self.work.costmap, title=title, overlay=overlay, **look)

    def check(self) -> None:
        _refuse_differences(self.differences, self.work.source.name)
        if self.passes:
            return
        first, *more = [goal for goal in self.goals if not goal.plan.found]
        verdict = "no path" if first.plan.is_known else "not known whether a path leads"
        rule = f"{verdict} to goal {first.goal.label}: {first.plan.detail or first.plan.reason}"
        rule += f"; {len(more)} more without a path" if more else ""
        hint = f"this makes one: {first.best_change}" if first.changes else None
        raise errors.FindingError(rule, source=self.work.source.name, hint=hint)


@dataclass(frozen=True, eq=False, repr=False)
class PlanTable(Spread):
    """The plans on several maps, or with several parameters.

    Parameters
    ----------
    reports : sequence of PlanReport or MapdealError
        The plans on each map with each of the parameters, or why a map has none.
    differences : tuple of str, optional
        Differences from an expected table, if one was given.
    """

    spread = ("plans",)
    reports: Sequence[PlanReport | errors.MapdealError]
    differences: tuple[str, ...] | None = None

    @property
    def failed(self) -> list[errors.MapdealError]:
        return [report for report in self.reports if isinstance(report, errors.MapdealError)]

    def _repr_parts(self) -> Iterator[str]:
        yield f"{values.count_text(len(self.reports), 'plan')}, {len(self.failed)} failed"

    def document(self) -> dict[str, Any]:
        plans = [report.document() if isinstance(report, PlanReport)
                 else {"exit_code": report.exit_code, "error": str(report)}
                 for report in self.reports]  # fmt: skip
        differs = {} if self.differences is None else {"differences": list(self.differences)}
        return {"plans": plans, **differs}

    def summary(self, output: Path) -> Iterator[str]:
        yield from (f"{output}:", *self.lines())

    def lines(self) -> Iterator[str]:
        found = [report.rows for report in self.reports if isinstance(report, PlanReport)]
        head = ("map", "parameters", "goal", "path", "a change that makes one")
        yield from values.table_lines([head, *(row for rows in found for row in rows)])
        for error in self.failed:
            yield f"failed ({error.exit_code}): {errors.one_line(str(error))}"
        yield from (f"differs: {text}" for text in self.differences or ())

    def check(self) -> None:
        if self.failed:
            raise errors.BatchError(f"{len(self.failed)} of {len(self.reports)} plans failed")
        _refuse_differences(self.differences)
        reports = [report for report in self.reports if isinstance(report, PlanReport)]
        missed = sum(not goal.plan.found for report in reports for goal in report.goals)
        if missed and self.differences is None:
            raise errors.FindingError(f"no path found to {values.count_text(missed, 'goal')}")


@dataclass(frozen=True, eq=False, repr=False)
class PairedPlans(Spread):
    """The plans of many pairs of poses, computed as the pairs are read."""

    work: PlannerOnMap
    pairs: Iterable[NumberLines]
    pairs_in: Path | str
    has_changes: bool
    counts: Counter[str] = field(default_factory=Counter)

    def entries(self) -> Iterator[dict[str, Any]]:
        for line, numbers, problem in chain.from_iterable(map(NumberLines.rows, self.pairs)):
            self.counts["pairs"] += 1
            number = {"pair": self.counts["pairs"]}
            try:
                if problem is not None:
                    raise errors.ParameterError(problem)
                start, goal = check_pose(numbers[:3], "start"), check_pose(numbers[3:], "goal")
            except errors.ParameterError as error:
                self.counts["failed"] += 1
                yield {**number, "line": line, "error": str(error)}
                continue
            plan = plan_on(self.work, start, goal)
            self.counts["found"] += plan.found
            entry = {**number, **plan_entries(plan), "poses": len(plan.poses)}
            if self.has_changes and not plan.found and plan.is_known:
                entry["changes"] = changes_for(self.work, start, goal, plan)
            yield entry
        if not self.counts["pairs"]:
            raise errors.MalformedInputError("holds no pairs of poses", source=self.pairs_in)

    def parts(self) -> Iterator[str]:
        return map(json.dumps, self.entries())

    def document(self) -> dict[str, Any]:
        return {"plans": list(self.entries())}

    def summary(self, output: Path) -> Iterator[str]:
        yield f"{output}: {self.counts['pairs']} pairs, {self.counts['found']} with a plan"

    def lines(self) -> Iterator[str]:
        for entry in self.entries():
            text = entry.get("error") or f"no path, {entry['reason']}"
            if entry.get("found"):
                text = f"{entry['length_m']} m, {entry['poses']} poses"
            yield f"pair {entry['pair']}: {text}"

    def check(self) -> None:
        if failed := self.counts["failed"]:
            rule = f"{failed} of {self.counts['pairs']} lines are no pairs of poses"
            raise errors.BatchError(rule, source=self.pairs_in)


def pose_of(numbers: Sequence[float], name: str) -> Pose:
    return check_pose((*numbers, 0.0) if len(numbers) == 2 else numbers, name)


def plan_on(work: PlannerOnMap, start: Pose, goal: Pose) -> Plan:
    """Return the planner's answer; without a model, only whether closed cells prevent a path."""
    if work.listed.planner is not None:
        return work.planner.plan(work.grid, start, goal)
    text = f"{work.listed.plugin} is not modelled"
    if is_cut_off(work.listed, work.grid, start, goal):
        text += "; cells closed to the robot's centre separate start and goal for every planner"
        return no_plan("NoValidPathCouldBeFound", text)
    return Plan(False, detail=f"{text}; mapdeal reach shows whether the footprint gets there")


def _robot_of(robot: Robot, dialect: dialects.Dialect, namespace: str | None) -> RobotParameters:
    if isinstance(robot, RobotParameters):
        return robot
    return recipe.read_robot_parameters(robot, dialect=dialect, namespace=namespace)


def goals_of(texts: Sequence[str]) -> list[PlanGoal]:
    goals = []
    for text in texts:
        name, equals, place = text.rpartition("=")
        goals.append(PlanGoal(*pose_of(start_of(place), "goals"), name if equals else None))
    return goals


def _places_of(goals: Any) -> list[PlanGoal]:
    if isinstance(goals, Mapping):
        return [PlanGoal(*pose_of(place, f"goals {key}"), key) for key, place in goals.items()]
    if len(goals) in (2, 3) and all(isinstance(number, Real) for number in goals):
        goals = [goals]
    return [goal if isinstance(goal, PlanGoal) else PlanGoal(*pose_of(goal, "goals"))
            for goal in goals]  # fmt: skip


def planner_of(robot: RobotParameters, planner: str | None) -> tuple[Ros2Parameters, ListedPlanner]:
    if robot.flavour != "nav2":
        rule = "contains no parameters of ROS 2, and only Nav2's planners are modelled"
        raise errors.ParameterError(rule, source=robot.paths[-1])
    if robot.costmap != "global":
        rule = "planners use the global costmap"
        raise errors.ParameterError(rule, place="robot", got=robot.node)
    parameters = read_ros2(robot.paths)
    listed, problems = planners_of(robot, parameters)
    if refused := next((problem for problem in problems if problem.level == "refused"), None):
        raise error_of(refused, robot.paths)
    if not has_server(parameters):
        text = f"has no {PLANNER_SERVER}; Nav2's default planner is taken, NavFn"
        errors.emit_warning(f"{robot.paths[-1]}: {text}")
    by_name = {entry.name: entry for entry in listed}
    if planner is not None and planner not in by_name:
        known = f"the file lists {', '.join(by_name) or 'none'}"
        raise errors.ParameterError("no such planner", place="planner", got=planner, hint=known)
    if not listed:
        raise errors.MalformedInputError("lists no planner", source=robot.paths[-1])
    chosen = listed[0] if planner is None else by_name[planner]
    if chosen.planner is None:
        errors.emit_warning(f"{robot.paths[-1]}: {chosen.plugin} is not modelled")
    return parameters, chosen


def check_map(source: inputs.MapInput, *robots: RobotParameters) -> None:
    """Refuse costs, and maps that take too much memory; warn of what planners ignore."""
    if isinstance(source.grid, costmap.Costmap):
        raise errors.ParameterError("holds costs; planners are tried on a map", source=source.name)
    inputs.warn_of_values(source)
    inputs.claim_cells(source, _PER_CELL, measures=True)
    inputs.warn_of_robot(source.name, source.occupancy, *robots)


@command(
    group="Questions about a map",
    output=Output(
        "PLAN.json", "Write the result to a file, with --pairs a .jsonl; by default it is printed, "
        "on a terminal as lines, elsewhere as JSON.", is_required=False, streams=False,
    ),
    json="default",
    shared=("params_file", "namespace", "mask", "files"),
    example="""\
mapdeal plan examples/maps/office.yaml \\
    --params-file examples/robots/nav2_params.yaml --from -8,0 \\
    --to kitchen=3,-4 lab=9,4 -o out/plan.json --image out/plan.png""",
)  # fmt: skip
def plan(
    map: Annotated[  # noqa: A002 - what it is
        inputs.Map | Sequence[inputs.Map], Words("MAP...", typed=list[Path], streams=True)
    ],
    *, robot: Annotated[Robot | None, Words()] = None,
    start: Annotated[Sequence[float] | None, POSE, Words("X,Y[,YAW]", start_of, "from")] = None,
    goals: Annotated[
        Sequence[PlanGoal | Sequence[float]] | Mapping[str, Sequence[float]],
        Words("[NAME=]X,Y[,YAW]", goals_of, "to", is_repeated=True),
    ] = (),
    pairs: Annotated[Path | None, Words("FILE|-")] = None, planner: str | None = None,
    no_changes: bool = False, layers: Annotated[Path | None, Words("OUT.npz")] = None,
    expect: Annotated[Path | None, Words("PLAN.json")] = None,
    against: Annotated[
        Sequence[Robot],
        Words("FILE", lambda sets: [[*map(Path, t.split(","))] for t in sets], is_repeated=True),
    ] = (),
    mask: Annotated[inputs.Map | None, Words()] = None, **reading: Unpack[inputs.Reading],
) -> PlanReport | PlanTable | PairedPlans:  # fmt: skip
    """Show whether the robot's own planner finds a path, or the smallest change that lets it.

    Computes on the robot's costmap of the map what Nav2's planner computes. If it finds no path,
    single parameters and places of the map are changed until it does: each printed change was
    tried, and one step less was not enough. Exit code 1 if a goal has no path; with
    --expect, if the plans differ from the stored ones. Several maps, folders of maps, or parameters
    make one table; if a map fails, the others continue, and the exit code is 5.

    Parameters
    ----------
    map : path, str or grid, or a sequence of them
        A map; more may follow.
    robot : RobotParameters or path
        The robot's parameters, or its Nav2 parameter file.
    start : tuple of float
        Start, metres and radians.
    goals : sequence of PlanGoal or tuple of float, or dict of str to tuple of float
        Goal, metres and radians; more may follow.
    pairs : path, optional
        File of starts and goals, one x,y,yaw,x,y,yaw per line, instead of both; - reads stdin.
    planner : str, optional
        Name of the planner in planner_plugins; the first by default.
    no_changes : bool
        Skip the search for changes and margins.
    layers : path, optional
        For a single goal, write the costs and NavFn's potential.
    expect : path, optional
        Compare with the result of an earlier call with as many maps and parameters.
    against : sequence of RobotParameters or path
        Plan with other parameters as well; repeatable, files joined by commas are one set.
    mask : path or grid, optional
        Keepout mask over the costs, as for `apply_keepout_mask`.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to a file.

    Returns
    -------
    PlanReport, PlanTable or PairedPlans
        The plans, see `PlanReport.goals`; of several maps, `PlanTable.reports`; with pairs, those
        of all of them, computed as their `parts` are read.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read, or Nav2 would not start with the parameters.
    ParameterError
        If parameters do not go together.

    Examples
    --------
    >>> found = plan("examples/maps/office.yaml", robot="examples/robots/nav2_narrow_door.yaml",
    ...              start=(3, 0), goals=[(1.5, 0.2)])
    >>> found.goals[0].plan.found, round(found.goals[0].plan.length, 2)
    (True, 1.6)
    """
    settings = inputs.settings_of(**reading)
    if robot is None:
        raise errors.ParameterError("is required: the robot's Nav2 parameters", place="robot")
    robots = [_robot_of(robot, settings.dialect, None)]
    robots += [_robot_of(file, settings.dialect, robots[0].namespace) for file in against]
    if pairs is not None:
        of_one: dict[str, Any] = {"start": start, "goals": tuple(goals), "layers": layers}
        of_one |= {"expect": expect, "against": tuple(against), "image": settings.image}
        inputs.refuse("applies to one start, not to pairs", **of_one)
    elif start is None or not goals:
        rule = "both are required, unless pairs are given"
        raise errors.ParameterError(rule, place="start, goals")
    first = pose_of((0.0, 0.0) if start is None else start, "start")
    places = _places_of(goals)
    work = inputs.Work.current.get()
    maps: Sequence[Any] = [map] if isinstance(map, str | PathLike | npz.Grid) else map
    if work is not None:
        listing = list_maps([str(path) for path in maps], None, work.terminal.input_chunks)
        listing.print_notes(work.terminal, "planned on")
        maps = [listed.path for listed in listing.maps]
    if not maps:
        raise errors.ParameterError("needs at least one", place="map")
    is_table = len(maps) * len(robots) > 1
    if is_table:
        rule = "applies to one map and one --params-file"
        inputs.refuse(rule, pairs=pairs, layers=layers, image=settings.image)
    over = inputs.mask_of(mask, settings)
    files = [path for parameters in robots for path in parameters.paths]
    files += [path for path in (pairs, expect) if path is not None and path != Path("-")]
    inputs.need_ending(".json" if pairs is None else ".jsonl")
    if layers is not None:
        npz.check_ends_in_npz(layers)
        if work is None:
            raise errors.ParameterError("is written on the command line alone", place="layers")
        work.outputs.append(layers)
    also = [*files, *(over.files if over else ())]
    also += [Path(source) for source in maps if isinstance(source, str | PathLike)]
    planners = [planner_of(own, planner) for own in robots]

    def works_on(source: inputs.Map) -> list[PlannerOnMap]:
        (opened,) = inputs.open_inputs(source, names=("map",), also=also, **reading)
        check_map(opened, *robots)
        up_to_kilted, pairs = settings.dialect != "nav2", zip(robots, planners, strict=True)
        return [PlannerOnMap(opened, own, *chosen, over, up_to_kilted) for own, chosen in pairs]

    if is_table:
        reports: list[PlanReport | errors.MapdealError] = []
        for source in maps:
            try:
                found = [report_on(own, first, places, not no_changes) for own in works_on(source)]
            except errors.MapdealError as error:
                reports.append(error)
            else:  # without their costmaps
                reports += [replace(report, work=replace(report.work)) for report in found]
        return PlanTable(reports, None if expect is None else (*_differences(reports, expect),))
    (planned,) = works_on(maps[0])
    if pairs is not None:
        chunks, name = inputs.text_in(pairs)
        return PairedPlans(planned, read_pose_pairs(chunks, name), name, not no_changes)
    if layers is not None and work is not None:
        with inputs.errors_named(planned.source.name):
            potential = _potential(planned, first, places)
        write_grid(work.begin(), layers, planned.costmap, more={"potential": potential})
    report = report_on(planned, first, places, not no_changes)
    differences = None if expect is None else tuple(_differences([report], expect))
    return replace(report, differences=differences)


def report_on(
    work: PlannerOnMap, start: Pose, goals: Sequence[PlanGoal], has_changes: bool
) -> PlanReport:
    plans = []
    with inputs.errors_named(work.source.name):
        for goal in goals:
            answer = plan_on(work, start, goal.pose)
            if answer.found:
                margins = margins_of(work, start, goal.pose) if has_changes else []
                plans.append(GoalPlan(goal, answer, None, margins, *work.least_clearance(answer)))
                continue
            changes = changes_for(work, start, goal.pose, answer) if has_changes else None
            stopped_at = None
            if not answer.detail:
                stopped_at, detail = work.stop_of(start, goal.pose)
                answer = replace(answer, detail=detail)
            plans.append(GoalPlan(goal, answer, changes, stopped_at=stopped_at))
    return PlanReport(work, start, tuple(plans))


def _potential(work: PlannerOnMap, start: Pose, goals: Sequence[PlanGoal]) -> Any:
    if len(goals) != 1:
        raise errors.ParameterError("needs one goal", place="layers")
    potential = getattr(work.listed.planner, "potential", None)
    if potential is None:
        rule = f"are those of NavFn, and {work.listed.name} is {work.listed.plugin}"
        raise errors.ParameterError(rule, place="layers")
    if (potentials := potential(work.grid, start, goals[0].pose)) is None:
        rule = "the start lies in the last half cell: Nav2's search has no place"
        raise errors.ParameterError(rule)
    return potentials


def _differences(reports: Sequence[PlanReport | errors.MapdealError], path: Path) -> Iterator[str]:
    document = read_document(path)
    stored = [document] if len(reports) == 1 else document["plans"].items()
    if len(stored) != len(reports):
        yield f"{len(reports)} plans, expected {len(stored)}"
        return
    for report, expected in zip(reports, stored, strict=True):
        if isinstance(report, PlanReport):
            where = f"{', '.join(report.rows[0][:2])}: " if len(reports) > 1 else ""
            yield from (where + text for text in _differences_of(report, expected))


def _differences_of(report: PlanReport, document: JsonValue) -> Iterator[str]:
    if document.get("error") is not None:
        yield "plans, expected an error"
        return
    document["format"].word(PLAN_FORMAT)
    expected = document["goals"].items()
    if len(expected) != len(report.goals):
        yield f"{len(report.goals)} goals, expected {len(expected)}"
        return
    for goal, stored in zip(report.goals, expected, strict=True):
        now, label = goal.document(), f"goal {goal.goal.label}"
        for key, read in (("found", JsonValue.flag), ("reason", JsonValue.text)):
            before = stored[key].or_none(read)
            if before != now[key]:
                yield f"{label}: {key} {now[key]}, expected {before}"
        before = stored["length_m"].or_none(JsonValue.number)
        length = now["length_m"]
        if before is not None and length is not None and abs(before - length) > _SAME:
            yield f"{label}: {length:.6g} m, expected {before:.6g} m"
