"""Pictures of a robot's reach, and of route graphs over a map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mapdeal.grid import route_graph, values
from mapdeal.grid.reach import GoalReach, Passage, Reach
from mapdeal.kernels.arrays import Bytes, Floats
from mapdeal.pictures import canvas, overlay as overlays, styles
from mapdeal.pictures.colours import GOAL, MINIMUM, ROUTE, RVIZ_FREE, Colour, Swatch
from mapdeal.records import dataclass

_DIRECTIONS = 16
_DISTANCES = (1.0, 1.7, 2.8, 4.5)
_FIRST_WITH_A_LINE = 1  # first distance with a line from the text to its place
Box = tuple[int, int, int, int]  # first column and row, and those after the last


class Captions:
    """Writer of texts on the pixels of a map, in boxes that do not overlap."""

    def __init__(self, pixels: Bytes, size: int) -> None:
        self._pixels, self._size = pixels, size
        self._occupied = np.zeros_like(pixels)
        self.kept_free = overlays.Brush(self._occupied)  # marks pixels for which texts make room

    def write(
        self, text: str, place: Floats, index: int, *, away: float,
        towards: Sequence[float] = (1.0, 0.0),
    ) -> bool:  # fmt: skip
        letters = self._letters(text)
        height, width = letters.shape
        placed = self._free_box(place, width, height, away, towards)
        if placed is None:
            return False
        (left_x, bottom, right, top), distance = placed
        if distance >= _FIRST_WITH_A_LINE:
            nearest = np.clip(place, (left_x, bottom), (right, top))
            overlays.Brush(self._pixels).polyline(np.array([place, nearest]), index, thickness=2)
        self._pixels[bottom:top, left_x:right] = index
        self._pixels[bottom + 1 : top - 1, left_x + 1 : right - 1] = letters[::-1][1:-1, 1:-1]
        self._occupied[bottom:top, left_x:right] = 1
        return True

    def _letters(self, text: str) -> Bytes:
        pad, capitals = max(2, self._size // 5), canvas.capital_height(self._size)
        pen, line = canvas.Pen(self._size), canvas.printable(text)
        descends = not set("gjpqy,;()[]|/").isdisjoint(line)
        below = max(pad, canvas.ascent(self._size) // 4) if descends else pad
        pen.open(canvas.text_width(line, self._size) + 2 * pad + 1, capitals + pad + below + 2)
        pen.write(pad + 1, capitals + pad + 1, line, self._size)
        return pen.sheet

    def _free_box(
        self, place: Floats, width: int, height: int, away: float, towards: Sequence[float]
    ) -> tuple[Box, int] | None:
        first = math.atan2(towards[1], towards[0])
        turns = [(k + 1) // 2 * (-1) ** k for k in range(_DIRECTIONS)]  # alternating sides
        angles = [first + 2 * math.pi * turn / _DIRECTIONS for turn in turns]
        for step, factor in enumerate(_DISTANCES):
            for angle in angles:
                x, y = math.cos(angle), math.sin(angle)
                reach = away * factor + abs(x) * width / 2 + abs(y) * height / 2
                left_x = math.floor(place[0] + x * reach - width / 2 + 0.5)
                bottom = math.floor(place[1] + y * reach - height / 2 + 0.5)
                box = (left_x, bottom, left_x + width, bottom + height)
                if self._is_free(box):
                    return box, step
        return None

    def _is_free(self, box: Box) -> bool:
        left_x, bottom, right, top = box
        height, width = self._pixels.shape
        is_inside = left_x >= 0 and bottom >= 0 and right <= width and top <= height
        return is_inside and not self._occupied[bottom:top, left_x:right].any()


_MOST_WIDTHS = 300  # most passages with a written width: those that cut off most


def reach_image(
    reach: Reach, *, title: str, image_max: int = overlays.DEFAULT_IMAGE_MAX,
    image_extent: overlays.ImageExtent = "all", overlay: overlays.Overlay | None = None,
) -> canvas.Image:  # fmt: skip
    # Of several cells in a pixel an obstacle shows first, then a cut-off area, then reached cells.
    codes, style = styles.reach_codes(reach)
    goals = [answer.goal for answer in _goals_on(reach)]
    places = [reach.start[:2], *((goal.x, goal.y) for goal in goals)]
    part = overlays.shown_part(
        codes, reach.frame, image_extent, unknown=styles.UNKNOWN_CODE, overlay=overlay,
        places_xy=places,
    )  # fmt: skip
    raster = overlays.Raster.fitting(reach.shape, image_max, part=part)
    pixels = np.array(raster.enlarged(raster.largest(codes)))
    marks = _Marks(overlays.Surface(pixels, raster.frame_of(reach.frame), raster))
    return canvas.on_sheet(
        pixels, style, reach.frame, raster, title=title, before=_summary(reach),
        swatches=[*style.swatches, *marks.draw(reach)], overlay=overlay,
    )  # fmt: skip


def _summary(reach: Reach) -> str:
    reached, total = styles.area_text(reach.reachable_area), styles.area_text(reach.open_area)
    text = f"reaches {reached.removesuffix(' m2')} of {total}"
    closed = sum(not passage.is_open for passage in reach.passages)
    if closed:
        text += f"; {values.count_text(closed, 'closed passage')}"
    if len(reach.passages) > closed:
        text += f"; {values.count_text(len(reach.passages) - closed, 'tight passage')}"
    return text


def _goals_on(reach: Reach) -> list[GoalReach]:
    is_on_map = reach.frame.contains([(answer.goal.x, answer.goal.y) for answer in reach.goals])
    return [answer for answer, is_inside in zip(reach.goals, is_on_map, strict=True) if is_inside]


class _Marks:
    def __init__(self, on: overlays.Surface) -> None:
        self._on, self._brush = on, overlays.Brush(on.pixels)
        self._thickness, self._dot = max(3, round(on.side / 350)), max(5.0, on.side / 130)
        self._captions = Captions(on.pixels, int(min(32, max(12, on.side / 62))))

    def draw(self, reach: Reach) -> list[Swatch]:
        self._bars(reach.passages)
        swatches, goals = self._robot(reach), _goals_on(reach)
        for goal in goals:
            self._goal(goal)
        for goal in goals:
            if goal.goal.name is not None:
                index = styles.GOAL if goal.reachable else styles.MISSED
                place = self._place((goal.goal.x, goal.goal.y))
                self._captions.write(goal.goal.name, place, index, away=1.4 * self._dot)
        for passage in sorted(reach.passages, key=lambda p: (p.is_open, -p.cut_off))[:_MOST_WIDTHS]:
            self._width(passage)
        closed = [passage for passage in reach.passages if not passage.is_open]
        legend = [
            (closed, styles.CLOSED, "closed passage"),
            (len(reach.passages) > len(closed), styles.TIGHT, "open, but tight"),
            (any(goal.reachable for goal in goals), styles.GOAL, "goal, reached"),
            (any(not goal.reachable for goal in goals), styles.MISSED, "goal, not reached"),
        ]
        return swatches + [Swatch(index, label) for is_there, index, label in legend if is_there]

    def _place(self, point: Sequence[float]) -> Floats:
        return np.asarray(self._on.places([point])[0])

    def _bars(self, passages: Sequence[Passage]) -> None:
        if not passages:
            return
        ends = np.array([passage.ends for passage in passages]).reshape(-1, 2)
        starts, stops = self._on.places(ends).reshape(-1, 2, 2).swapaxes(0, 1)
        middles, halves = (starts + stops) / 2, (stops - starts) / 2
        lengths = np.maximum(np.hypot(halves[:, 0], halves[:, 1]), 1e-9)
        halves *= np.maximum(1.5 * self._thickness / lengths, 1)[:, np.newaxis]
        starts, stops = middles - halves, middles + halves
        is_open = np.array([passage.is_open for passage in passages])
        for brush, mask, index, extra in (
            (self._captions.kept_free, slice(None), 1, 6),
            (self._brush, slice(None), canvas.WHITE, 4),
            (self._brush, is_open, styles.TIGHT, 0),
            (self._brush, ~is_open, styles.CLOSED, 0),
        ):
            brush.segments(starts[mask], stops[mask], index, thickness=self._thickness + extra)

    def _width(self, passage: Passage) -> None:
        ends = self._on.places(passage.ends)
        along = ends[1] - ends[0]
        towards = (abs(float(along[1])), -float(along[0]) * math.copysign(1, along[1]))
        index = styles.TIGHT if passage.is_open else styles.CLOSED
        text, away = f"{100 * passage.width:.0f} cm", 2 * self._thickness + 2
        self._captions.write(text, ends.mean(axis=0), index, away=away, towards=towards)

    def _ringed_dot(self, place: Floats, index: int) -> None:
        self._brush.dot(place, canvas.WHITE, radius=self._dot + 2)
        self._brush.dot(place, index, radius=self._dot)
        self._captions.kept_free.dot(place, 1, radius=self._dot + 3)

    def _goal(self, goal: GoalReach) -> None:
        place = self._place((goal.goal.x, goal.goal.y))
        self._ringed_dot(place, styles.GOAL if goal.reachable else styles.MISSED)
        arm, thickness = 0.5 * self._dot, max(2, round(self._dot / 3))
        for across in () if goal.reachable else ((arm, arm), (arm, -arm)):
            cross = np.array([place - across, place + across])
            self._brush.polyline(cross, canvas.WHITE, thickness=thickness)

    def _robot(self, reach: Reach) -> list[Swatch]:
        x, y = reach.start[:2]
        yaw = reach.start[2] if len(reach.start) > 2 else None
        place = self._place((x, y))
        self._ringed_dot(place, styles.START)
        swatches = [Swatch(styles.START, "start")]
        if reach.robot is not None:
            outline = self._on.places(overlays.outline_of(reach.robot, (x, y, yaw or 0.0)))
            for index, thickness in ((canvas.WHITE, 4), (styles.ROBOT, 2)):
                self._brush.polyline(outline, index, thickness=thickness)
            self._captions.kept_free.polyline(outline, 1, thickness=4)
            swatches.append(Swatch(styles.ROBOT, "robot, to scale"))
        if yaw is not None:
            ahead = self._place((x + math.cos(yaw), y + math.sin(yaw))) - place
            direction = ahead / math.hypot(*ahead)
            self._brush.dart(place, direction, canvas.WHITE, length=1.5 * self._dot)
        return swatches


_NODE: Colour = (0, 35, 120)
_BELOW: Colour = (60, 72, 88)
_CAPTION = 20  # largest text size of a name, pixels


@dataclass(frozen=True, eq=False)
class GraphOverlay(overlays.Overlay):
    graph: route_graph.RouteGraph
    is_below: bool = False

    @property
    def colours(self) -> tuple[Colour, ...]:
        marks = (_BELOW,) * 4 if self.is_below else (ROUTE, _NODE, MINIMUM, GOAL)
        return (*marks, RVIZ_FREE)

    @property
    def text(self) -> str:
        nodes, edges = (values.count_text(len(items), word) for items, word in
                        ((self.graph.nodes, "node"), (self.graph.edges, "edge")))  # fmt: skip
        return f"{nodes}, {edges}"

    @property
    def places_xy(self) -> Floats:
        return self.graph.points_xy

    def draw(self, on: overlays.Surface, first_index: int) -> list[Swatch]:
        line, node, door, goal, paper = (first_index + k for k in range(5))
        brush, graph = overlays.Brush(on.pixels), self.graph
        places = on.places(graph.points_xy)
        thickness, ends = max(2, round(on.side / 700)), graph.ends
        brush.segments(places[ends[:, 0]], places[ends[:, 1]], line, thickness=thickness)
        self._draw_arrows(brush, places, line, length=max(10.0, 6.0 * thickness))
        radius = max(3.0, on.side / 320)
        kinds = [graph_node.metadata.get("kind") for graph_node in graph.nodes]
        for place, kind in zip(places, kinds, strict=True):
            if kind not in ("door", "goal"):
                brush.dot(place, node, radius=radius)
        captions = Captions(on.pixels, int(min(_CAPTION, max(11, on.side / 70))))
        for special, index in (("door", door), ("goal", goal)):
            for place, kind in zip(places, kinds, strict=True):
                if kind == special:
                    brush.dot(place, paper, radius=1.4 * radius + 1)
                    brush.dot(place, index, radius=1.4 * radius)
                    captions.kept_free.dot(place, 1, radius=2 * radius)
        for place, graph_node in zip(places, graph.nodes, strict=True):
            if graph_node.metadata.get("kind") == "goal":
                name = str(graph_node.metadata.get("name", graph_node.id))
                captions.write(name, place, goal, away=2.5 * radius)
        if self.is_below:
            return [Swatch(line, "route graph")]
        legend: Sequence[tuple[bool, int, str]] = (
            (bool(len(ends)), line, "edge"), (True, node, "node"), ("door" in kinds, door, "door"),
            ("goal" in kinds, goal, "goal"),
        )  # fmt: skip
        return [Swatch(index, label) for is_there, index, label in legend if is_there]

    def _draw_arrows(
        self, brush: overlays.Brush, places: Floats, index: int, *, length: float
    ) -> None:
        arcs = {(start, end) for start, end in self.graph.ends.tolist()}
        single_arcs = [ends for ends in arcs if ends[::-1] not in arcs]
        if not single_arcs:
            return
        starts, ends = places[np.array(sorted(single_arcs)).T]
        directions = ends - starts
        lengths = np.hypot(*directions.T)
        is_long = lengths > 1.5 * length  # room for an arrow
        middles = (starts + ends)[is_long] / 2
        directions = directions[is_long] / lengths[is_long, np.newaxis]
        for middle, direction in zip(middles, directions, strict=True):
            brush.dart(middle, direction, index, length=length)
