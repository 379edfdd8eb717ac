"""The picture of what a robot can reach."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import count_text
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.grid.reach import GoalReach, Passage, Reach
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import for_rows
from mapdeal.render import colours
from mapdeal.render.canvas import corner_of, frame_text, sheet
from mapdeal.render.captions import Captions
from mapdeal.render.overlay import Brush, Overlay, place_of
from mapdeal.render.pen import WHITE, Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.render.style import Swatch

_MOST_AREAS = 6
"""Cut-off areas that have a colour of their own."""
_LEAST_SHARE = 0.001
"""Of the open cells: what such an area must have."""
_MOST_WIDTHS = 300
"""Passages whose width is written: those that cut off most."""

# In the order in which the cells that share a pixel take precedence.
_UNKNOWN, _NARROW, _REACHED, _NO_TURN, _REACHED_UNKNOWN, _CUT_OFF = range(6)
_AREAS = range(_CUT_OFF + 1, _CUT_OFF + 1 + _MOST_AREAS)
_OBSTACLE = _AREAS.stop
_CLOSED, _TIGHT, _START, _ROBOT, _GOAL, _MISSED = range(_OBSTACLE + 1, _OBSTACLE + 7)

_CORNERS_OF_CIRCLE = 48


def reach_image(
    reach: Reach,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> Image:
    """Return a map with the area that a robot reaches, and what cuts off the rest.

    The largest areas that are open to the robot, but out of its reach, have a colour each. Passages
    are bars across the door with their width beside them, red where the robot is stopped; the
    robot's outline at the start is true to scale. Where cells share a pixel an obstacle shows
    before a cut-off area, and that before the reachable one. An overlay is drawn over all.
    """
    frame = reach.frame
    raster = Raster.fitting(reach.shape, image_max)
    codes = _codes(reach)
    areas = _colour_areas(codes)
    pixels = np.array(raster.enlarged(raster.largest(codes)))
    swatches = _swatches_of_areas(codes, areas, reach)
    marks = _Marks(pixels, frame, raster)
    swatches += marks.draw(reach)
    palette = np.array(_COLOURS)
    texts = [_summary(reach), frame_text(frame)]
    if overlay is not None:
        swatches += overlay.draw(pixels, frame, raster, len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts.append(overlay.text)
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle="; ".join(texts),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution),
        corner_xy=corner_of(frame),
        swatches=swatches,
    )


def _codes(reach: Reach) -> NDArray[np.uint8]:
    """Return what each cell is; all cut-off areas are one yet."""
    of_occupancy = np.full(256, _NARROW, dtype=np.uint8)
    of_occupancy[OCCUPIED], of_occupancy[UNKNOWN] = _OBSTACLE, _UNKNOWN
    codes = np.empty(reach.shape, dtype=np.uint8)
    occupancies = reach.occupancy.view(np.uint8)

    def fill(rows: slice) -> None:
        occupancy, headings = occupancies[rows], reach.headings[rows]
        part = codes[rows]
        np.take(of_occupancy, occupancy, out=part)
        is_reached = reach.reachable[rows] != 0
        part[(headings != 0) & ~is_reached] = _CUT_OFF
        part[is_reached] = _REACHED
        part[is_reached & (headings < reach.heading_count)] = _NO_TURN
        if reach.through_unknown:
            part[is_reached & (occupancy == of_occupancy.size + UNKNOWN)] = _REACHED_UNKNOWN

    for_rows(fill, reach.shape)
    return codes


def _colour_areas(codes: NDArray[np.uint8]) -> list[int]:
    """Give the largest cut-off areas codes of their own, in place; return their sizes in cells."""
    counts = histogram(codes)
    if not counts[_CUT_OFF]:
        return []
    from scipy import ndimage

    labels, count = ndimage.label(codes == _CUT_OFF)
    sizes = np.zeros(count + 1, dtype=np.int64)
    for row in range(0, len(labels), 256):
        sizes += np.bincount(labels[row : row + 256].ravel(), minlength=count + 1)
    sizes[0] = 0
    least = _LEAST_SHARE * counts[[_REACHED, _NO_TURN, _REACHED_UNKNOWN, _CUT_OFF]].sum()
    order = np.argsort(-sizes, kind="stable")[:_MOST_AREAS]
    largest = [label for label in order.tolist() if sizes[label] >= max(least, 1)]
    code_of = np.full(count + 1, _CUT_OFF, dtype=np.uint8)
    code_of[largest] = _AREAS[: len(largest)]

    def colour(rows: slice) -> None:
        part = codes[rows]
        np.copyto(part, code_of[labels[rows]], where=part == _CUT_OFF)

    for_rows(colour, codes.shape)
    return [int(size) for size in sizes[largest]]


def _swatches_of_areas(codes: NDArray[np.uint8], areas: list[int], reach: Reach) -> list[Swatch]:
    counts = histogram(codes)

    def area(code: int) -> str:
        return _area_text(int(counts[code]) * reach.cell_area)

    room = ", room to turn" if counts[_NO_TURN] else ""
    swatches = [
        Swatch(_REACHED, f"reachable{room} {area(_REACHED)}"),
        Swatch(_NO_TURN, f"reachable, no room to turn {area(_NO_TURN)}"),
        Swatch(_REACHED_UNKNOWN, f"reachable, unknown {area(_REACHED_UNKNOWN)}"),
        *(Swatch(code, f"cut off {area(code)}") for code in _AREAS[: len(areas)]),
        Swatch(_CUT_OFF, f"{'smaller' if areas else 'small'} cut-off areas {area(_CUT_OFF)}"),
        Swatch(_NARROW, f"no room for the robot {area(_NARROW)}"),
        Swatch(_OBSTACLE, "obstacle"),
        Swatch(_UNKNOWN, "unknown"),
    ]
    return [swatch for swatch in swatches if counts[swatch.index]]


def _area_text(area: float) -> str:
    """Return square metres in three digits, or as many as there are before the point."""
    return f"{area:.3g} m2" if area < 999.5 else f"{area:.0f} m2"


def _summary(reach: Reach) -> str:
    reached, whole = _area_text(reach.reachable_area), _area_text(reach.open_area)
    text = f"reaches {reached.removesuffix(' m2')} of {whole}"
    closed = sum(not passage.is_open for passage in reach.passages)
    if closed:
        text += f"; {count_text(closed, 'closed passage')}"
    if len(reach.passages) > closed:
        text += f"; {count_text(len(reach.passages) - closed, 'tight passage')}"
    return text


class _Marks:
    """Draws what there is to see besides areas, on the pixels of a map."""

    def __init__(self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster) -> None:
        self._pixels, self._frame, self._raster = pixels, frame, raster
        self._brush = Brush(pixels)
        side = max(pixels.shape)
        self._thickness = max(3, round(side / 350))
        self._dot = max(5.0, side / 130)
        self._captions = Captions(pixels, int(min(32, max(12, side / 62))))

    def draw(self, reach: Reach) -> list[Swatch]:
        """Draw passages, goals, the start and the robot; return the legend."""
        self._bars(reach.passages)
        swatches = self._robot(reach)
        for goal in reach.goals:
            self._goal(goal)
        for goal in reach.goals:
            if goal.goal.name is not None:
                index = _GOAL if goal.reachable else _MISSED
                place = self._place((goal.goal.x, goal.goal.y))
                self._captions.write(goal.goal.name, place, index, away=1.4 * self._dot)
        most = sorted(reach.passages, key=lambda one: (one.is_open, -one.cut_off))
        for passage in most[:_MOST_WIDTHS]:
            self._width(passage)
        closed = [passage for passage in reach.passages if not passage.is_open]
        shown = [
            (closed, _CLOSED, "closed passage"),
            (len(reach.passages) > len(closed), _TIGHT, "open, but tight"),
            (any(goal.reachable for goal in reach.goals), _GOAL, "goal, reached"),
            (any(not goal.reachable for goal in reach.goals), _MISSED, "goal, not reached"),
        ]
        return swatches + [Swatch(index, label) for is_there, index, label in shown if is_there]

    def _place(self, point: Sequence[float]) -> NDArray[np.float64]:
        place: NDArray[np.float64] = place_of([point], self._frame, self._raster)[0]
        return place

    def _bars(self, passages: Sequence[Passage]) -> None:
        """Draw a bar between the ends of each passage, visible at any scale."""
        if not passages:
            return
        ends = np.array([passage.ends for passage in passages]).reshape(-1, 2)
        starts, stops = place_of(ends, self._frame, self._raster).reshape(-1, 2, 2).swapaxes(0, 1)
        middles, halves = (starts + stops) / 2, (stops - starts) / 2
        lengths = np.maximum(np.hypot(halves[:, 0], halves[:, 1]), 1e-9)
        halves *= np.maximum(1.5 * self._thickness / lengths, 1)[:, np.newaxis]
        starts, stops = middles - halves, middles + halves
        is_open = np.array([passage.is_open for passage in passages])
        for brush, which, index, more in (
            (self._captions.kept_free, slice(None), 1, 6),
            (self._brush, slice(None), WHITE, 4),
            (self._brush, is_open, _TIGHT, 0),
            (self._brush, ~is_open, _CLOSED, 0),
        ):
            thickness = self._thickness + more
            brush.segments(starts[which], stops[which], index, thickness=thickness)

    def _width(self, passage: Passage) -> None:
        ends = place_of(passage.ends, self._frame, self._raster)
        along = ends[1] - ends[0]
        towards = (abs(float(along[1])), -float(along[0]) * math.copysign(1, along[1]))
        self._captions.write(
            f"{100 * passage.width:.0f} cm",
            ends.mean(axis=0),
            _TIGHT if passage.is_open else _CLOSED,
            away=2 * self._thickness + 2,
            towards=towards,
        )

    def _goal(self, goal: GoalReach) -> None:
        place = self._place((goal.goal.x, goal.goal.y))
        index = _GOAL if goal.reachable else _MISSED
        self._brush.dot(place, WHITE, radius=self._dot + 2)
        self._brush.dot(place, index, radius=self._dot)
        if not goal.reachable:
            arm = 0.5 * self._dot
            for across in ((arm, arm), (arm, -arm)):
                cross = np.array([place - across, place + across])
                self._brush.polyline(cross, WHITE, thickness=max(2, round(self._dot / 3)))
        self._captions.kept_free.dot(place, 1, radius=self._dot + 3)

    def _robot(self, reach: Reach) -> list[Swatch]:
        x, y = reach.start[:2]
        yaw = reach.start[2] if len(reach.start) > 2 else None
        place = self._place((x, y))
        self._brush.dot(place, WHITE, radius=self._dot + 2)
        self._brush.dot(place, _START, radius=self._dot)
        self._captions.kept_free.dot(place, 1, radius=self._dot + 3)
        swatches = [Swatch(_START, "start")]
        if reach.robot is not None:
            outline = place_of(_outline(reach.robot, (x, y, yaw or 0.0)), self._frame, self._raster)
            for index, thickness in ((WHITE, 4), (_ROBOT, 2)):
                self._brush.polyline(outline, index, thickness=thickness)
            self._captions.kept_free.polyline(outline, 1, thickness=4)
            swatches.append(Swatch(_ROBOT, "robot, to scale"))
        if yaw is not None:
            ahead = self._place((x + math.cos(yaw), y + math.sin(yaw))) - place
            direction = ahead / math.hypot(*ahead)
            self._brush.dart(place, direction, WHITE, length=1.5 * self._dot)
        return swatches


def _outline(robot: Footprint, pose: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the closed outline of a robot at a pose, in the map frame."""
    if robot.vertices:
        corners = np.array([*robot.vertices, robot.vertices[0]])
    else:
        turns = np.linspace(0, 2 * math.pi, _CORNERS_OF_CIRCLE + 1)
        corners = robot.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    outline: NDArray[np.float64] = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return outline


_COLOURS = [
    colours.RVIZ_UNKNOWN,
    colours.TOO_NARROW,
    colours.REACHABLE,
    colours.NO_TURN,
    colours.REACHABLE_UNKNOWN,
    colours.CUT_OFF,
    *colours.CUT_OFF_AREAS,
    colours.RVIZ_OCCUPIED,
    colours.CLOSED_PASSAGE,
    colours.TIGHT_PASSAGE,
    colours.REACH_START,
    colours.ROBOT_OUTLINE,
    colours.GOAL_REACHED,
    colours.GOAL_MISSED,
]
