"""The picture of what a robot can reach."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import count_text
from mapdeal.grid.frame import Frame
from mapdeal.grid.reach import GoalReach, Passage, Reach
from mapdeal.pictures.canvas import (
    WHITE,
    Image,
    Pen,
    ascent,
    capital_height,
    on_sheet,
    printable,
    text_width,
)
from mapdeal.pictures.colours import Swatch
from mapdeal.pictures.overlay import Brush, ImageExtent, Overlay, outline_of, place_of, shown_part
from mapdeal.pictures.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.pictures.styles import (
    CLOSED,
    GOAL,
    MISSED,
    ROBOT,
    START,
    TIGHT,
    UNKNOWN_CODE,
    area_text,
    reach_codes,
)

_DIRECTIONS = 16
_DISTANCES = (1.0, 1.7, 2.8, 4.5)
_FIRST_WITH_A_LINE = 1
"""From this distance on a line leads from the text to its place."""

Box = tuple[int, int, int, int]
"""First column and row, and those after the last."""


class Captions:
    """Writes texts on the pixels of a map, each in a box of its own."""

    def __init__(self, pixels: NDArray[np.uint8], size: int) -> None:
        self._pixels = pixels
        self._size = size
        self._taken = np.zeros_like(pixels)
        self.kept_free = Brush(self._taken)
        """Draws, with any index but 0, where no text may be."""

    def write(
        self, text: str, place: NDArray[np.float64], index: int, *, away: float,
        towards: Sequence[float] = (1.0, 0.0),
    ) -> bool:  # fmt: skip
        letters = self._letters(text)
        height, width = letters.shape
        found = self._free_box(place, width, height, away, towards)
        if found is None:
            return False
        box, distance = found
        left, bottom, right, top = box
        if distance >= _FIRST_WITH_A_LINE:
            nearest = np.clip(place, (left, bottom), (right, top))
            Brush(self._pixels).polyline(np.array([place, nearest]), index, thickness=2)
        self._pixels[bottom:top, left:right] = index
        self._pixels[bottom + 1 : top - 1, left + 1 : right - 1] = letters[::-1][1:-1, 1:-1]
        self._taken[bottom:top, left:right] = 1
        return True

    def _letters(self, text: str) -> NDArray[np.uint8]:
        """Return a text on white, row 0 at the top."""
        pad = max(2, self._size // 5)
        capitals = capital_height(self._size)
        pen = Pen(self._size)
        line = printable(text)
        below = (
            max(pad, ascent(self._size) // 4) if any(c in "gjpqy,;()[]|/" for c in line) else pad
        )
        pen.open(text_width(line, self._size) + 2 * pad + 1, capitals + pad + below + 2)
        pen.write(pad + 1, capitals + pad + 1, line, self._size)
        return pen.sheet

    def _free_box(
        self, place: NDArray[np.float64], width: int, height: int, away: float,
        towards: Sequence[float],
    ) -> tuple[Box, int] | None:  # fmt: skip
        """Return a box that lies on the map and on no other, and how many steps away it is."""
        first = math.atan2(towards[1], towards[0])
        turns = [(k + 1) // 2 * (-1) ** k for k in range(_DIRECTIONS)]  # to both sides by turns
        angles = [first + 2 * math.pi * turn / _DIRECTIONS for turn in turns]
        for step, factor in enumerate(_DISTANCES):
            for angle in angles:
                x, y = math.cos(angle), math.sin(angle)
                reach = away * factor + abs(x) * width / 2 + abs(y) * height / 2
                left = math.floor(place[0] + x * reach - width / 2 + 0.5)
                bottom = math.floor(place[1] + y * reach - height / 2 + 0.5)
                box = (left, bottom, left + width, bottom + height)
                if self._is_free(box):
                    return box, step
        return None

    def _is_free(self, box: Box) -> bool:
        left, bottom, right, top = box
        height, width = self._pixels.shape
        if left < 0 or bottom < 0 or right > width or top > height:
            return False
        return not self._taken[bottom:top, left:right].any()


_MOST_WIDTHS = 300
"""Passages whose width is written: those that cut off most."""

_CORNERS_OF_CIRCLE = 48


def reach_image(
    reach: Reach,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "all",
    overlay: Overlay | None = None,
) -> Image:
    """Return a map with the area that a robot reaches, and what cuts off the rest."""
    # The largest areas that are open to the robot, but out of its reach, have a colour each.
    # Passages are bars across the door with their width beside them, red where the robot is
    # stopped; the robot's outline at the start is true to scale. Where cells share a pixel an
    # obstacle shows before a cut-off area, and that before the reachable one.
    codes, style = reach_codes(reach)
    part = shown_part(
        codes,
        reach.frame,
        image_extent,
        is_known=lambda some: some != UNKNOWN_CODE,
        overlay=overlay,
        places_xy=[reach.start[:2], *((one.goal.x, one.goal.y) for one in _goals_on(reach))],
    )
    raster = Raster.fitting(reach.shape, image_max, part=part)
    pixels = np.array(raster.enlarged(raster.largest(codes)))
    marks = _Marks(pixels, raster.frame_of(reach.frame), raster)
    swatches = [*style.swatches, *marks.draw(reach)]
    return on_sheet(
        pixels,
        style.colours,
        reach.frame,
        raster,
        title=title,
        before=_summary(reach),
        swatches=swatches,
        overlay=overlay,
    )


def _summary(reach: Reach) -> str:
    reached, whole = area_text(reach.reachable_area), area_text(reach.open_area)
    text = f"reaches {reached.removesuffix(' m2')} of {whole}"
    closed = sum(not passage.is_open for passage in reach.passages)
    if closed:
        text += f"; {count_text(closed, 'closed passage')}"
    if len(reach.passages) > closed:
        text += f"; {count_text(len(reach.passages) - closed, 'tight passage')}"
    return text


def _goals_on(reach: Reach) -> list[GoalReach]:
    return [one for one in reach.goals if reach.frame.contains([(one.goal.x, one.goal.y)])[0]]


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
        goals = _goals_on(reach)
        for goal in goals:
            self._goal(goal)
        for goal in goals:
            if goal.goal.name is not None:
                index = GOAL if goal.reachable else MISSED
                place = self._place((goal.goal.x, goal.goal.y))
                self._captions.write(goal.goal.name, place, index, away=1.4 * self._dot)
        most = sorted(reach.passages, key=lambda one: (one.is_open, -one.cut_off))
        for passage in most[:_MOST_WIDTHS]:
            self._width(passage)
        closed = [passage for passage in reach.passages if not passage.is_open]
        shown = [
            (closed, CLOSED, "closed passage"),
            (len(reach.passages) > len(closed), TIGHT, "open, but tight"),
            (any(goal.reachable for goal in goals), GOAL, "goal, reached"),
            (any(not goal.reachable for goal in goals), MISSED, "goal, not reached"),
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
            (self._brush, is_open, TIGHT, 0),
            (self._brush, ~is_open, CLOSED, 0),
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
            TIGHT if passage.is_open else CLOSED,
            away=2 * self._thickness + 2,
            towards=towards,
        )

    def _goal(self, goal: GoalReach) -> None:
        place = self._place((goal.goal.x, goal.goal.y))
        index = GOAL if goal.reachable else MISSED
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
        self._brush.dot(place, START, radius=self._dot)
        self._captions.kept_free.dot(place, 1, radius=self._dot + 3)
        swatches = [Swatch(START, "start")]
        if reach.robot is not None:
            outline = place_of(
                outline_of(reach.robot, (x, y, yaw or 0.0)), self._frame, self._raster
            )
            for index, thickness in ((WHITE, 4), (ROBOT, 2)):
                self._brush.polyline(outline, index, thickness=thickness)
            self._captions.kept_free.polyline(outline, 1, thickness=4)
            swatches.append(Swatch(ROBOT, "robot, to scale"))
        if yaw is not None:
            ahead = self._place((x + math.cos(yaw), y + math.sin(yaw))) - place
            direction = ahead / math.hypot(*ahead)
            self._brush.dart(place, direction, WHITE, length=1.5 * self._dot)
        return swatches
