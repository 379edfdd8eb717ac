"""What documents say, as parts of a page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.selection import ADDED, REMOVED, Difference
from mapdeal.commands.report_answers import (
    Answer,
    ComparisonAnswer,
    DiffAnswer,
    LintedFile,
    ReachAnswer,
    RouteAnswer,
    Severity,
    ShapesAnswer,
    ToldFinding,
)
from mapdeal.errors import one_line
from mapdeal.files.json_values import NamedMap
from mapdeal.grid.display import count_text
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Point
from mapdeal.grid.reach import GoalReach, Passage, robot_text
from mapdeal.grid.route import Route
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.kernels.components import touching_groups
from mapdeal.pipeline.documents import AlignmentAnswer
from mapdeal.report.document import Item, Table, Tone

_MOST = 50
"""Groups that are listed of new walls, and of those that are gone."""


def difference_items(found: Difference) -> list[Item]:
    """Return groups of cells that touch where a wall is new, and where one is gone."""
    # The largest come first. A group is placed at that of its cells which is nearest to its middle.
    return [*_groups_of(found, ADDED, "wall added"), *_groups_of(found, REMOVED, "wall removed")]


def _groups_of(found: Difference, kind: int, what: str) -> list[Item]:
    cells, groups = touching_groups(found.changes == kind)
    if not len(cells):
        return []
    sizes = np.bincount(groups)
    items = []
    for group in np.argsort(-sizes, kind="stable")[:_MOST].tolist():
        x, y = found.frame.xy_from_rowcol([_middle_of_lines(cells[groups == group])])[0].tolist()
        text = f"{what}: {count_text(int(sizes[group]), 'cell')} at {x:.6g}, {y:.6g}"
        items.append(Item("finding", text, "warning", (x, y)))
    left = len(sizes) - _MOST
    if left > 0:
        items.append(Item("finding", f"{what}: {count_text(left, 'smaller group')} not listed"))
    return items


def _middle_of_lines(cells: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> tuple[int, int]:
    """Return the cell that is nearest to the middle of some."""
    away = np.square(cells - cells.mean(axis=0)).sum(axis=1)
    row, col = cells[int(np.argmin(away))].tolist()
    return row, col


MOST_ITEMS = 1000
"""Of one kind: nobody looks through more, and a page with a million of them opens nowhere."""

MOST_POINTS = 20_000
"""Of a route on a page, which would grow by some megabytes for a million of them."""

_LONGEST = 400
_CORNERS_OF_CIRCLE = 64


def items_of(answer: Answer) -> list[Item]:
    """Return what a document has to show on a map; of lint use `finding_items`, file by file."""
    if isinstance(answer, ReachAnswer):
        return reach_items(answer)
    if isinstance(answer, RouteAnswer):
        return route_items(answer)
    return shape_items(answer.shapes) if isinstance(answer, ShapesAnswer) else []


def tables_of(answer: Answer) -> list[Table]:
    """Return the figures of a document; of lint use `lint_table`, file by file."""
    if isinstance(answer, ReachAnswer):
        return [reach_table(answer)]
    if isinstance(answer, RouteAnswer):
        return [route_table(answer)]
    if isinstance(answer, DiffAnswer):
        return diff_tables(answer)
    if isinstance(answer, AlignmentAnswer):
        return [alignment_table(answer)]
    return comparison_tables(answer) if isinstance(answer, ComparisonAnswer) else []


def finding_items(file: LintedFile) -> list[Item]:
    return _shortened((item for told in file.findings for item in _of_finding(told)), "finding")


def _of_finding(found: ToldFinding) -> Iterator[Item]:
    line = f" (line {found.line})" if found.line is not None else ""
    text = _text(f"{found.check}: {found.message}{line}")
    yield Item("finding", text, found.severity, found.places[0] if found.places else None)
    for index, place in enumerate(found.places[1:], start=2):
        text = _text(f"{found.check}: place {index} of {len(found.places)}")
        yield Item("finding", text, found.severity, place)


def lint_table(file: LintedFile) -> Table:
    counts = Counter(found.severity for found in file.findings)
    severities = get_args(Severity)
    rows = [(f"{severity}s", str(counts[severity])) for severity in severities]
    rows.append(("suppressed", str(file.suppressed)))
    rows += [(f"repair {number}", _text(one)) for number, one in enumerate(file.repairs, start=1)]
    return Table("Lint", tuple(rows))


def reach_items(answer: ReachAnswer) -> list[Item]:
    """Return the start, the goals and the passages of what a robot can reach."""
    return [
        start_item(answer.start, answer.robot),
        *goal_items(answer.goals, answer.robot, answer.heading_count),
        *passage_items(answer.passages),
    ]


def start_item(start: Sequence[float], robot: Footprint | None) -> Item:
    """Return where a robot starts, given x, y and perhaps a yaw."""
    x, y, *yaw = start
    heading = f", yaw {yaw[0]:.4g}" if yaw else ""
    text = f"start at {_at((x, y))}{heading}: {robot_text(robot)}"
    return Item("start", text, place=(x, y), label="start")


def goal_items(
    goals: Iterable[GoalReach], robot: Footprint | None, heading_count: int
) -> list[Item]:
    items = []
    for one in goals:
        place = one.goal.x, one.goal.y
        text = f"goal {one.goal.label}: {'reachable' if one.reachable else 'not reachable'}"
        if one.reachable and robot is not None and robot.vertices:
            text += f" in {one.heading_count} of {count_text(heading_count, 'heading')}"
        if one.reason is not None:
            text += f": {one.stopped_by}"
        elif one.widest_radius == 0:
            text += "; by no robot, however small"
        elif math.isfinite(one.widest_radius):
            text += f"; a round robot gets there with a radius below {_metres(one.widest_radius)}"
        limit = one.limited_by
        if one.reason is None and limit is not None and math.isfinite(limit.width):
            text += f": {limit.text}"
        tone: Tone = "good" if one.reachable else "error"
        items.append(Item("goal", _text(text), tone, place, label=_text(one.goal.name or "goal")))
    return _shortened(items, "goal")


def passage_items(passages: Iterable[Passage]) -> list[Item]:
    """Return passages, each a line between the obstacles on both sides of it."""
    items = []
    for one in passages:
        width, area = _metres(one.width), f"{one.cut_off:.4g} m2"
        text = f"closed passage of {width}, cuts off {area}"
        tone: Tone = "error"
        if one.is_open:
            text, tone = f"narrow passage of {width}, {area} behind it", "warning"
        line = np.array(one.ends, dtype=np.float64)
        label = f"{100 * one.width:.0f} cm" if one.width < 1 else width
        items.append(Item("passage", text, tone, (one.x, one.y), (line,), label))
    return _shortened(items, "passage")


def reach_table(answer: ReachAnswer) -> Table:
    closed = sum(not one.is_open for one in answer.passages)
    reached = sum(one.reachable for one in answer.goals)
    rows = [
        ("robot", robot_text(answer.robot)),
        ("headings", str(answer.heading_count)),
        ("unknown cells", "open" if answer.through_unknown else "closed"),
        ("reachable", f"{answer.reachable_area:.6g} m2"),
        ("open to the robot", f"{answer.open_area:.6g} m2"),
        ("free", f"{answer.free_area:.6g} m2"),
        ("reachable share of free", f"{100 * answer.share:.4g} %"),
        ("goals reached", f"{reached} of {len(answer.goals)}"),
        ("passages", f"{len(answer.passages)}, {closed} of them closed"),
    ]
    return Table("What the robot can reach", tuple(rows))


def route_items(answer: RouteAnswer) -> list[Item]:
    route = answer.route
    tone: Tone = "good" if route.reached else "error"
    label = "goal" if route.reached else "goal, not reached"
    ends = [
        Item("start", f"start at {_at(route.start)}", place=route.start, label="start"),
        Item("goal", f"{label}, at {_at(route.goal)}", tone, route.goal, label=label),
    ]
    if not len(route.points_xy):
        return [*ends, Item("route", _told(route), tone)]
    x, y = route.points_xy[len(route.points_xy) // 2].tolist()
    return [*ends, Item("route", _told(route), tone, (x, y), (_thinned(route.points_xy),))]


def _thinned(points_xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return not too many of some points, evenly chosen, with the first and the last."""
    if len(points_xy) <= MOST_POINTS:
        return points_xy
    return points_xy[np.linspace(0, len(points_xy) - 1, MOST_POINTS).astype(np.int64)]


def _told(route: Route) -> str:
    text = f"route by {route.method}"
    if not len(route.points_xy):
        return f"{text}: no way"
    text += f" of {_metres(route.length)}"
    if math.isfinite(route.min_clearance):
        text += f", at least {_metres(route.min_clearance)} from obstacles"
    if math.isfinite(route.cost):
        text += f", cost {route.cost:.4g}"
    if route.local_minimum is not None:
        text += f"; it ends in a local minimum at {_at(route.local_minimum)}"
    elif not route.reached:
        text += "; it does not reach the goal"
    return text


def route_table(answer: RouteAnswer) -> Table:
    route = answer.route
    rows = [
        ("method", route.method),
        ("reached", "yes" if route.reached else "no"),
        ("start", _at(route.start)),
        ("goal", _at(route.goal)),
        ("length", _metres(route.length)),
        ("least clearance", _metres(route.min_clearance)),
        ("mean clearance", _metres(route.mean_clearance)),
        ("cost", f"{route.cost:.6g}" if math.isfinite(route.cost) else "-"),
        ("cells expanded", "-" if route.expanded is None else str(route.expanded)),
        ("certainly the cheapest", "yes" if route.optimal else "no"),
    ]
    return Table("Route", tuple(rows))


def shape_items(shapes: Iterable[Shape]) -> list[Item]:
    """Return shapes, each with its outline; a circle as a polygon."""
    return _shortened((_shape_item(one) for one in shapes), "shape")


def _shape_item(shape: Shape) -> Item:
    lines: tuple[NDArray[np.float64], ...] = ()
    text = shape.kind
    if isinstance(shape, Polygon):
        lines = tuple(_closed(ring) for ring in (shape.points_xy, *shape.holes_xy))
        text = f"polygon with {len(shape.points_xy)} corners"
        text += f" and {count_text(len(shape.holes_xy), 'hole')}" if shape.holes_xy else ""
    elif isinstance(shape, Line):
        lines = (np.array(shape.points_xy, dtype=np.float64),)
        text = f"line through {len(shape.points_xy)} points"
        text += f", {_metres(shape.thickness)} thick" if shape.thickness else ""
    elif isinstance(shape, Circle):
        lines = (_around(shape),)
        text = f"circle of radius {_metres(shape.radius)}"
    text += "" if shape.value is None else f", value {shape.value}"
    return Item("shape", text, place=_middle(lines), lines=lines)


def _closed(ring: Sequence[Point]) -> NDArray[np.float64]:
    return np.array([*ring, ring[0]], dtype=np.float64)


def _around(circle: Circle) -> NDArray[np.float64]:
    angles = np.arange(_CORNERS_OF_CIRCLE + 1) % _CORNERS_OF_CIRCLE * (2 * np.pi)
    angles /= _CORNERS_OF_CIRCLE
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.array(circle.center_xy, dtype=np.float64) + circle.radius * unit


def _middle(lines: Sequence[NDArray[np.float64]]) -> Point | None:
    if not lines:
        return None
    x, y = ((lines[0].min(axis=0) + lines[0].max(axis=0)) / 2).tolist()
    return x, y


def alignment_table(answer: AlignmentAnswer) -> Table:
    """Return where a map lies on another, and how sure that is."""
    x, y, yaw = answer.transform.pose
    rows = [
        ("same place", "yes" if answer.same_place else f"not sure: {_text(answer.reason or '')}")
    ]
    rows += [
        ("transform", f"x {x:.4g} m, y {y:.4g} m, yaw {math.degrees(yaw):.4g} degrees"),
        ("score", f"{answer.score:.2f}"),
        ("best score elsewhere", f"{answer.runner_up:.2f}"),
        ("overlap", f"{100 * answer.overlap:.0f} %"),
        ("walls in common that agree", f"{100 * answer.agreement:.0f} %"),
    ]
    return Table("Alignment", tuple(rows))


def diff_tables(answer: DiffAnswer) -> list[Table]:
    """Return what differs between two maps: figures, cells by their states, and what is set."""
    rows = [
        ("equal", "yes" if answer.is_equal else "no"),
        ("passes", "yes" if answer.passes else "no"),
        *_of_map("first map", answer.first),
        *_of_map("second map", answer.second),
        ("common cells", str(answer.common_cells)),
        ("differing", str(answer.differing)),
        ("beyond the tolerance", str(answer.beyond_tolerance)),
        ("known in the first alone", str(answer.known_only_in_first)),
    ]
    if answer.symmetry is not None:
        rows.append(("the second is much more like it", f"if it is {_text(answer.symmetry)}"))
    for what, shift in zip(("first to second", "second to first"), answer.walls, strict=True):
        told = "no obstacles" if shift is None else (
            f"{_metres(shift['largest'])}; 95 % within {_metres(shift['percentile_95'])}, "
            f"mean {_metres(shift['mean'])}"
        )  # fmt: skip
        rows.append((f"directed Hausdorff distance, {what}", told))
    for name, (allowed, found, holds) in answer.bounds.items():
        told = "nothing to compare" if found is None else f"found {found:.9g}"
        verdict = "holds" if holds else "missed"
        rows.append((_text(name), f"at most {allowed:g}: {verdict}, {told}"))
    tables = [Table("What differs", tuple(rows))]
    differing = {**answer.geometry, **answer.metadata}
    if differing:
        pairs = ((_text(key), _text(f"{a} → {b}")) for key, (a, b) in differing.items())
        tables.append(Table("Geometry and metadata, first → second", tuple(pairs)))
    cells = [
        (_text(f"{state} → {other}"), str(count))
        for state, row in answer.confusion.items()
        for other, count in row.items()
        if count
    ]
    return [*tables, Table("Cells, first → second", tuple(cells))]


def _of_map(what: str, named: NamedMap | None) -> Iterator[tuple[str, str]]:
    if named is not None:
        yield what, _text(named.file)


def comparison_items(answer: ComparisonAnswer, method: str) -> list[Item]:
    """Return where groups of hits are that a method of mapping has nothing of."""
    items = [
        Item("finding", _text(f"{method}: {count_text(cells, 'cell')} with hits vanished"),
             "note", (x, y))
        for x, y, cells in answer.methods[method].vanished
    ]  # fmt: skip
    return _shortened(items, "group of hits")


def comparison_tables(answer: ComparisonAnswer) -> list[Table]:
    """Return the figures of each method of mapping, and how many cells differ between two."""
    tables = [
        Table(
            _text(f"Method {name}"),
            tuple(
                (_text(key.replace("_", " ")), "-" if value is None else f"{value:.9g}")
                for key, value in method.figures.items()
            ),
        )
        for name, method in answer.methods.items()
    ]
    pairs = ((_text(f"{a}, {b}"), str(count)) for (a, b), count in answer.differing.items())
    return [*tables, Table("Differing cells", tuple(pairs))]


def _shortened(items: Iterable[Item], what: str) -> list[Item]:
    rest = iter(items)
    listed = list(islice(rest, MOST_ITEMS))
    left = sum(1 for _ in rest)
    if left:
        text = f"{count_text(left, f'more {what}')} not listed"
        listed.append(Item(listed[0].kind, text, "note"))
    return listed


def _text(text: str) -> str:
    """Return a text that may come from anywhere as one short line."""
    line = one_line(text)
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


def _metres(value: float) -> str:
    return f"{value:.4g} m" if math.isfinite(value) else "-"


def _at(point: Sequence[float]) -> str:
    x, y = point
    return f"{x + 0.0:.6g}, {y + 0.0:.6g}"
