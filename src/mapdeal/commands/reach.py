"""``mapdeal reach``: where a robot can go on a map or on costs, and what stops it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.command import Output, Words, command
from mapdeal.files.json_values import JsonValue, read_document
from mapdeal.grid import frame, occupancy
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal, GoalReach, Reach, reach_radius
from mapdeal.grid.values import FREE, LETHAL_OBSTACLE, OCCUPIED, UNKNOWN, decimal_text
from mapdeal.maps import npz, reading
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.overlay import KeepoutOverlay
from mapdeal.pipeline import folder, inputs, recipe
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.cost import closed_by
from mapdeal.stages.reach import reach

COSTS_PER_CELL = 8.0  # bytes for each cell that the costs of a robot's own layers take


@records.dataclass(frozen=True, eq=False, repr=False)
class Reachability(folder.Spread):
    spread = ("goals", "passages")
    map: inputs.MapInput
    reach: Reach
    title: str
    keepout: NDArray[np.bool_] | None = None
    robot: RobotParameters | None = None

    @property
    def passes(self) -> bool:  # type: ignore[override]
        return all(goal.reachable for goal in self.reach.goals)

    def document(self) -> dict[str, Any]:
        described = {} if self.robot is None else self.robot.described()
        costmap = {key: described[key] for key in ("costmap", "files") if described} or None
        return {"map": self.map.document(), "costmap": costmap, **folder.reach_document(self.reach)}

    def summary(self, output: Path) -> Iterator[str]:
        yield f"{output}: {folder.summary_of(self.reach.figures())}"

    def lines(self) -> Iterator[str]:
        yield f"{self.map.name}, {self.title}: {folder.summary_of(self.reach.figures())}"
        for result in self.reach.goals:
            goal, limit = result.goal, result.limited_by
            name = "goal" if goal.name is None else f"goal {goal.name}"
            text = f"  {name} {goal.x + 0.0:.10g},{goal.y + 0.0:.10g}: "
            text += "reached" if result.reachable else "not reached"
            yield text + ("" if limit is None else f"; {limit.text}")
        for door in self.reach.passages:
            state = "open" if door.is_open else "closed"
            text = f"  passage {door.x + 0.0:.4g},{door.y + 0.0:.4g}: {door.width:.4g} m wide, "
            yield text + f"{state}, {decimal_text(door.cut_off)} m2 behind it"

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        from mapdeal.pictures.reach import reach_image

        title = title or f"{self.map.title}: {self.title}"
        overlay = None if self.keepout is None else KeepoutOverlay(self.keepout)
        return reach_image(self.reach, title=title, overlay=overlay, **look)

    def check(self) -> None:
        if self.passes:
            return
        first, *more = (goal for goal in self.reach.goals if not goal.reachable)
        rule = not_reachable_text(first, self.reach)
        if more:
            verb = "is" if len(more) == 1 else "are"
            rule += f"; {len(more)} more of {len(self.reach.goals)} goals {verb} not reachable"
        hint = None if inputs.settings_of().image else "--image shows where the robot can go"
        if first.nearest_open is not None:
            x, y = (round(value, 6) + 0.0 for value in first.nearest_open)
            row, col = self.reach.frame.unbounded_rowcol_from_xy([first.nearest_open])[0]
            hint = f"the nearest open cell is at {x:.10g},{y:.10g}"
            hint += "" if self.reach.reachable[row, col] else ", but it is not reachable either"
        elif first.limited_by is None and self.keepout is not None:
            hint = "the cells of the keepout mask are closed"
        elif first.limited_by is None and not self.reach.through_unknown:
            has_unknown = (self.reach.occupancy == UNKNOWN).any()
            hint = "unknown cells are closed; --through-unknown opens them" if has_unknown else hint
        raise errors.FindingError(rule, source=self.map.name, hint=hint)


def not_reachable_text(missed: GoalReach, found: Reach) -> str:
    goal = missed.goal
    name = "" if goal.name is None else f" ({goal.name})"
    text = f"goal {goal.x + 0.0:.10g},{goal.y + 0.0:.10g}{name} is not reachable"
    if missed.reason is not None:
        return f"{text}: {missed.stopped_by}"
    limit = missed.limited_by
    if limit is None:
        return f"{text} by any robot, however small: no way leads there"
    needs = 2 * reach_radius(found.robot)
    if limit.width <= needs + 2 * frame.RADIUS_TOLERANCE:
        closed = sum(not passage.is_open for passage in found.passages)
        more = f", one of {closed} closed passages" if closed > 1 else ""
        return f"{text}: {limit.text}{more}; the robot needs more than {needs:.4g} m"
    text += f" with this footprint, though a round robot up to {limit.width:.4g} m wide gets there"
    cell = found.resolution
    return f"{text}; poses are tried at cell centres, so up to {cell:.4g} m of width is lost"


def start_of(text: str) -> tuple[float, ...]:
    return inputs.numbers_of(text, "X,Y,YAW" if text.count(",") > 1 else "X,Y")


def goals_of(texts: Sequence[str]) -> list[Goal]:
    goals = []
    for text in texts:
        name, equals, place = text.rpartition("=")
        x, y = inputs.numbers_of(place, "X,Y")
        if "," in name:  # several goals that are joined by commas would be one with an odd name
            rule = "must be [NAME=]X,Y, and a name has no comma"
            hint = "several goals are separated by blanks: --to kitchen=3,-4 lab=9,4"
            raise errors.ParameterError(rule, got=text, hint=hint)
        goals.append(Goal(x, y, name if equals else None))
    return goals


def goals_or_names(texts: Sequence[str]) -> list[Goal | str]:
    return [goal for text in texts for goal in (goals_of([text]) if "," in text else [text])]


RobotOption = Annotated[RobotParameters | None, Words()]
StartOption = Annotated[tuple[float, ...] | None, Words("X,Y[,YAW]", start_of, "from")]
GoalOption = Annotated[Sequence[Goal], Words("[NAME=]X,Y", goals_of, "to", is_repeated=True)]


def chosen_goals(goals: Sequence[Goal | str], points: Path | None) -> list[Goal]:
    """Return goals and those of a file: its points of the given names, or else all of them."""
    listed = [] if points is None else goals_in(points)
    names = [goal for goal in goals if isinstance(goal, str)]
    by_name = {goal.name: goal for goal in listed if goal.name is not None}
    unknown = [name for name in names if name not in by_name]
    if unknown:
        rule, hint = "must be [NAME=]X,Y", "a name alone is that of a point in --points FILE"
        if points is not None:
            rule = f"{points} has no such name"
            known = ", ".join(by_name) or "no point"
            hint = errors.nearest_hint(unknown[0], by_name) or f"it names {known}"
        raise errors.ParameterError(rule, place="goals", got=unknown[0], hint=hint)
    chosen = [by_name[goal] if isinstance(goal, str) else goal for goal in goals]
    return chosen if names else [*chosen, *listed]


def _named_points(path: Path) -> Iterator[Goal]:
    for feature in read_document(path)["features"].items():
        geometry = feature["geometry"]
        geometry["type"].word("Point")
        place = geometry["coordinates"]
        if len(place.items()) < 2:
            raise place.error("must be [x, y]")
        x, y = (number.number() for number in place.items()[:2])
        name = feature.optional("properties", lambda own: own.optional("name", JsonValue.text))
        yield Goal(x, y, name)


def goals_in(path: Path) -> list[Goal]:
    from mapdeal.sensors.points import read_named_points  # slow to import

    found = list(_named_points(path)) if path.suffix == ".geojson" else []
    chunks, name = ([], path) if path.suffix == ".geojson" else inputs.text_in(path)
    for line, point, goal_name, error in read_named_points(chunks, name):
        if point is None:
            raise errors.MalformedInputError(error or "", source=name, place=f"line {line}")
        found.append(Goal(*point, goal_name))
    if not found:
        raise errors.MalformedInputError("holds no points", source=name)
    return found


@command(
    name="reach",  # mapdeal.reach is the stage
    group="Questions about a map",
    output=Output("OUT.json", "Write the result to a file.", is_required=False, streams=False),
    json="default",
    shared=("robot", "mask", "files"),
    also={"": reach},
    words={
        "start": Words("X,Y[,YAW]", start_of, "from"),
        "goals": Words("[NAME=]X,Y|NAME", goals_or_names, "to", is_repeated=True),
    },
    example="""\
mapdeal reach examples/maps/office.yaml --from -8,0 --to kitchen=3,-4 lab=9,4 \\
    --robot-radius 0.28 -o out/reach.json --image out/reach.png""",
)
def reachability(
    map: inputs.Map,  # noqa: A002 - what it is
    *,
    work: inputs.InShell,
    points: Annotated[Path | None, Words("FILE|-")] = None,
    layers: Annotated[Path | None, Words("OUT.npz")] = None,
    footprint: Footprint | None = None,
    robot: RobotOption = None,
    **parameters: Any,
) -> Reachability:
    """Show where a robot can go from a start, and which passages stop it.

    A round robot fits where the nearest obstacle is farther away than its radius; a robot with
    corners is tried in many headings. Unknown cells and all that lies outside the map are closed.
    Without -o the result is printed, on a terminal as lines, elsewhere as JSON: areas; for each
    goal, whether it can be reached, by how wide a robot, and what limits it; and the passages that
    stop the robot, or nearly do. Exit code 1 if a goal cannot be reached.

    Parameters
    ----------
    map : path, str or grid
        A map, a distance field of one, or costs (.npz).
    start : tuple of float, optional
        Start, metres and radians; without a yaw, every heading that is free there; by default the
        widest place of the largest free area.
    goals : sequence of Goal, optional
        Goal, metres, or the name of one in --points; more may follow.
    points : path, optional
        File of goals: x,y, NAME,x,y, NAME=x,y or a JSON object per line, or points in .geojson; -
        reads standard input. With names in --to only these.
    layers : path, optional
        Write reachable, headings, clearance and widest for every cell.
    footprint : Footprint, optional
        The robot's shape, instead of that of `robot`.
    **parameters
        As for the stage `reach`.
    """
    if footprint is None and robot is None:
        text = "no robot is given, by --robot-radius, --footprint or --params-file: the result is "
        text += "that of a point; widest_radius_m is the radius of the largest round robot"
        errors.emit_warning(text)
    inputs.need_ending(".json")
    if layers is not None:
        npz.check_ends_in_npz(layers)
        work.outputs.append(layers)
    parameters["goals"] = tuple(chosen_goals(parameters.get("goals", ()), points))
    parameters["footprint"] = recipe.planned_shape(robot, footprint)
    step = make_step("reach", parameters)
    mask = inputs.mask_of(work.settings.mask, work.settings)
    also = [*(robot.paths if robot else ()), *([points] if points else ())]
    also += mask.files if mask else ()
    (map_read,) = inputs.open_inputs(map, names=("map",), also=also)
    if robot is not None and not isinstance(map_read.grid, Costmap):
        inputs.warn_of_robot(map_read.name, map_read.grid, robot)
    found = reach_on_input(map_read, step, robot, mask)
    if "start" not in parameters:
        at = ",".join(f"{coordinate:.10g}" for coordinate in found.start[:2])
        text = f"no start is given: it is {at}, the widest place of the largest open area"
        errors.emit_warning(text)
    if layers is not None:
        reading.write_grid(work.begin(), layers, found)
    closed = None if mask is None else closed_by(mask.grid, found.frame)
    return Reachability(map_read, found, step.title, closed, robot)


def reach_on_input(
    map_read: inputs.MapInput, step: Step, robot: RobotParameters | None,
    mask: inputs.KeepoutMask | None,
) -> Reach:  # fmt: skip
    """Return what the stage finds on a map, or on the costs that a robot's layers make of it."""
    per_cell = step.memory + COSTS_PER_CELL * (robot is not None)
    with (
        map_read.settings.reading(),
        inputs.claiming_work(map_read.name, map_read.grid, per_cell),
        inputs.errors_named(map_read.name),
    ):
        grid = map_read.grid
        if not isinstance(grid, Costmap):
            inputs.warn_of_values(map_read)
            if robot is not None:
                grid = lethal_costs(robot, map_read)
                if mask is not None and robot.inflates_keepout:
                    grid, mask = mask.over(grid), None
        found = step.apply(grid, map_read.path, mask=None if mask is None else mask.grid)
    return cast("Reach", found)


def lethal_costs(robot: RobotParameters, map_read: inputs.MapInput) -> Costmap:
    """Return a map with only its lethal and unknown cells, as the robot's costmap has them."""
    # Inscribed costs would cover unknown cells.
    grid = map_read.grid
    for step in recipe.load_recipe(None, robot=robot.without_inflation()).steps:
        grid = step.apply(grid, map_read.path)
    costs = cast("Costmap", grid)
    is_unknown = costs.cost == costs.unknown_value
    layers = (layer for layer in robot.inflation_layers if layer.inflation_radius > 0)
    if not any(layer.inflate_around_unknown for layer in layers):
        return costs
    return costs.with_values(np.where(is_unknown, LETHAL_OBSTACLE, costs.cost).astype(np.uint8))


def lethal_cells(robot: RobotParameters, map_read: inputs.MapInput) -> occupancy.OccupancyGrid:
    """Return the map as a robot has it: occupied where it is lethal, unknown where that is kept."""
    grid = lethal_costs(robot, map_read)
    free = np.where(grid.cost == grid.unknown_value, np.int8(UNKNOWN), np.int8(FREE))
    cells = np.where(grid.cost == LETHAL_OBSTACLE, np.int8(OCCUPIED), free)
    return occupancy.OccupancyGrid(cells, grid.resolution, grid.origin)
