"""What is drawn over a map: routes, robots, poses, zones."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, Region, turned, xy_ahead
from mapdeal.grid.route import Route
from mapdeal.grid.values import LETHAL_OBSTACLE, OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import Layer, gathered, made_by_rows
from mapdeal.kernels.lookup import histogram
from mapdeal.pictures.colours import (
    GOAL,
    KEEPOUT,
    MINIMUM,
    REMOVED,
    ROBOT,
    ROBOT_OUTLINE,
    ROUTE,
    RVIZ_FREE,
    START,
    Colour,
    Swatch,
)
from mapdeal.pictures.raster import Raster

_FARTHEST = 2.0**20  # pixels; beyond, Pillow's coordinates overflow
_MOST_PIXELS = 1 << 24
"""Of a picture, that are copied to be drawn on, unless a single shape takes more."""


class Overlay(Protocol):
    """Something that is drawn over the picture of a layer."""

    @property
    def colours(self) -> Sequence[Colour]:
        """What a palette needs for it, one after the other."""

    @property
    def text(self) -> str:
        return ""

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """What a picture has to show of it, shape (N, 2), metres in the map frame."""
        return np.empty((0, 2))

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw on the palette indices of a map, row 0 in the south, in place; return the legend.

        `colours` begin at `first_index` of the palette.
        """


@dataclass(frozen=True)
class Overlays(Overlay):
    """Several things that are drawn over the same picture, one over the other."""

    overlays: tuple[Overlay, ...]

    @property
    def colours(self) -> list[Colour]:
        return [colour for overlay in self.overlays for colour in overlay.colours]

    @property
    def text(self) -> str:
        return "; ".join(overlay.text for overlay in self.overlays if overlay.text)

    @property
    def places_xy(self) -> NDArray[np.float64]:
        return np.concatenate([np.reshape(one.places_xy, (-1, 2)) for one in self.overlays])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        swatches = []
        for overlay in self.overlays:
            swatches += overlay.draw(pixels, frame, raster, first_index)
            first_index += len(overlay.colours)
        return swatches


def place_of(points_xy: ArrayLike, frame: Frame, raster: Raster) -> NDArray[np.float64]:
    """Return the pixel coordinates (column, row) of points in the map frame."""
    places = frame.continuous_rowcol_from_xy(points_xy)[:, ::-1]
    return places * (raster.enlarge / raster.reduce)


class Brush:
    """Draws on pixels whose row 0 is the south; coordinates are in pixels, (column, row)."""

    def __init__(self, pixels: NDArray[np.uint8]) -> None:
        self._pixels = pixels

    def polyline(self, points: NDArray[np.float64], index: int, *, thickness: int) -> None:
        """Draw a line through points, shape (N, 2), with round corners."""
        if len(points) > 1:
            self.segments(points[:-1], points[1:], index, thickness=thickness)

    def segments(
        self, starts: NDArray[np.float64], ends: NDArray[np.float64], index: int, *,
        thickness: int,
    ) -> None:  # fmt: skip
        """Draw lines between points, shape (N, 2) each, with round ends."""
        self._draw(index, np.stack([starts, ends], axis=1), thickness=thickness)
        if thickness > 2:
            points = np.unique(np.concatenate([starts, ends]), axis=0)
            self._draw(index, points[:, np.newaxis], radius=thickness / 2)

    def dot(self, centre: NDArray[np.float64], index: int, *, radius: float) -> None:
        self._draw(index, centre[np.newaxis, np.newaxis], radius=radius)

    def arrows(
        self, centres: NDArray[np.float64], directions: NDArray[np.float64], index: int, *,
        length: float, thickness: int,
    ) -> None:  # fmt: skip
        """Draw arrows around points, shape (N, 2), along unit vectors."""
        along, across = directions * length, _left_of(directions) * length
        tip, tail, neck = centres + along / 2, centres - along / 2, centres + along * 0.1
        self._draw(index, np.stack([tail, neck], axis=1), thickness=thickness)
        self._draw(index, np.stack([tip, neck + across * 0.22, neck - across * 0.22], axis=1))

    def dart(
        self, centre: NDArray[np.float64], direction: NDArray[np.float64], index: int, *,
        length: float,
    ) -> None:  # fmt: skip
        """Draw an arrowhead around a point, along a unit vector."""
        along, across = direction * length, _left_of(direction) * length
        tip, notch = centre + along * 0.6, centre - along * 0.2
        left, right = (centre - along * 0.4 + side * across * 0.35 for side in (1, -1))
        self._draw(index, np.array([[tip, left, notch, right]]))

    def _draw(
        self, index: int, shapes: NDArray[np.float64], *, thickness: int = 0, radius: float = 0.0
    ) -> None:
        """Draw shapes of some points each, shape (N, K, 2): discs, lines, or filled corners."""
        from PIL import Image, ImageDraw

        if not len(shapes):
            return
        height, width = self._pixels.shape
        shapes = np.clip(shapes, -_FARTHEST, _FARTHEST)
        reach = radius + thickness + 1
        low = np.clip(shapes.min(axis=(0, 1)) - reach, 0, (width, height)).astype(int)
        high = np.clip(shapes.max(axis=(0, 1)) + reach, 0, (width, height)).astype(int)
        under = self._pixels[low[1] : high[1], low[0] : high[0]]
        if under.size > _MOST_PIXELS and len(shapes) > 1:
            for half in np.array_split(shapes, 2):
                self._draw(index, half, thickness=thickness, radius=radius)
            return
        if not under.size:
            return
        image = Image.fromarray(under)
        draw = ImageDraw.Draw(image)
        for points in shapes - low:
            if radius:
                first, last = _edge(points[0] - radius), _edge(points[0] + radius) - 1
                draw.ellipse([*first, *np.maximum(first, last)], fill=index)
            elif thickness:
                middle = _edge(points - thickness / 2) + (thickness - 1) // 2
                draw.line(middle.ravel().tolist(), fill=index, width=thickness)
            else:
                draw.polygon(np.floor(points).ravel().tolist(), fill=index)
        under[:] = np.asarray(image)


def _edge(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.floor(places + 0.5)  # half a pixel always to the same side


def _left_of(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


_CORNERS = 32


@dataclass(frozen=True, eq=False)
class RingOverlay:
    """Rings around places."""

    places_xy: NDArray[np.float64]
    label: str
    text: str

    colours = (REMOVED,)

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        if not len(self.places_xy):
            return []
        side = max(pixels.shape)
        radius, thickness = max(6.0, side / 80), max(2, round(side / 400))
        turns = np.linspace(0, 2 * math.pi, _CORNERS + 1)
        circle = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        brush = Brush(pixels)
        for place in place_of(self.places_xy, frame, raster):
            brush.polyline(place + circle, first_index, thickness=thickness)
        return [Swatch(first_index, self.label)]


@dataclass(frozen=True)
class PoseOverlay(Overlay):
    """An arrowhead where a robot stands, along its heading."""

    pose: tuple[float, float, float]

    colours = (ROBOT,)

    @property
    def text(self) -> str:
        x, y, yaw = self.pose
        return f"robot at {x:.10g}, {y:.10g}, yaw {yaw:.4g}"

    @property
    def places_xy(self) -> NDArray[np.float64]:
        return np.array([self.pose[:2]])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        ahead = xy_ahead(self.pose, frame.resolution)
        centre, tip = place_of([self.pose[:2], ahead], frame, raster)
        direction = (tip - centre) / np.hypot(*(tip - centre))
        length = max(10.0, max(pixels.shape) / 25)
        Brush(pixels).dart(centre, direction, first_index, length=length)
        return [Swatch(first_index, "robot")]


@dataclass(frozen=True)
class RouteOverlay(Overlay):
    """A route with its ends, and the local minimum that it may have stopped in."""

    route: Route

    colours = (ROUTE, START, GOAL, MINIMUM)

    @property
    def text(self) -> str:
        route = self.route
        if not len(route.points_xy):
            return "no route"
        text = f"{route.length:.4g} m"
        if math.isfinite(route.min_clearance):
            text += f", clearance {route.min_clearance:.3g} m"
        return text if route.reached else f"stopped after {text}"

    @property
    def places_xy(self) -> NDArray[np.float64]:
        return np.concatenate([self.route.points_xy, [self.route.start, self.route.goal]])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        route = self.route
        line, start, goal, minimum = (first_index + k for k in range(4))
        side = max(pixels.shape)
        radius = max(4.0, side / 110)
        swatches = []
        brush = Brush(pixels)
        if len(route.points_xy):
            path = place_of(route.points_xy, frame, raster)
            brush.polyline(path, line, thickness=max(3, round(side / 250)))
            swatches.append(Swatch(line, "route"))
        ends = [(route.goal, goal), (route.start, start)]
        swatches += [Swatch(start, "start"), Swatch(goal, "goal")]
        if route.local_minimum is not None:
            ends.append((route.local_minimum, minimum))
            swatches.append(Swatch(minimum, "local minimum"))
        for point, index in ends:
            brush.dot(place_of([point], frame, raster)[0], index, radius=radius)
        return swatches


_CORNERS_OF_CIRCLE = 48
_AWAY = 10
"""Pixels between the shape and the edges."""
_LEAST, _LARGEST_SHARE = 4, 0.4
"""Of a shape that is drawn: pixels, and its part of the picture's sides."""


def outline_of(
    robot: Footprint, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Return the closed outline of a robot at a pose, shape (N, 2), in the frame of the pose."""
    if robot.vertices:
        corners = np.array([*robot.vertices, robot.vertices[0]])
    else:
        turns = np.linspace(0, 2 * math.pi, _CORNERS_OF_CIRCLE + 1)
        corners = robot.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    x, y, yaw = pose
    outline: NDArray[np.float64] = turned(corners, yaw) + np.array([x, y])
    return outline


@dataclass(frozen=True)
class RobotOverlay(Overlay):
    """A robot's shape, true to scale, in the corner of a picture where least is to be seen."""

    robot: Footprint
    label: str = "robot, to scale"

    colours = (ROBOT_OUTLINE, RVIZ_FREE)

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        outline = outline_of(self.robot) / raster.metres_per_pixel(frame.resolution)
        outline -= outline.min(axis=0)
        size = np.ceil(outline.max(axis=0)) + 2 * _AWAY  # columns and rows
        height, width = pixels.shape
        if outline.max() < _LEAST or (size > _LARGEST_SHARE * np.array([width, height])).any():
            return []
        cols, rows = size.astype(int).tolist()
        corners = [(left, low) for low in (0, height - rows) for left in (width - cols, 0)]
        left, low = max(corners, key=lambda at: _evenness(pixels, at, (cols, rows)))
        outline += np.array([left, low]) + _AWAY
        brush = Brush(pixels)
        for index, thickness in ((first_index + 1, 4), (first_index, 2)):
            brush.polyline(outline, index, thickness=thickness)
        return [Swatch(first_index, self.label)]


def _evenness(pixels: NDArray[np.uint8], corner: tuple[int, int], size: tuple[int, int]) -> int:
    """Return how many pixels of a box, columns and rows, have the colour that most have."""
    (left, low), (width, height) = corner, size
    part = np.ascontiguousarray(pixels[low : low + height, left : left + width])
    return int(histogram(part).max())


@dataclass(frozen=True, eq=False)
class KeepoutOverlay(Overlay):
    """Cells that are lethal by a mask alone."""

    closed: Layer

    @classmethod
    def of(cls, before: Costmap, after: Costmap) -> KeepoutOverlay:
        """Return what a mask has closed, given the costs without it and with it."""
        lethal = LETHAL_OBSTACLE if after.scale == "costmap2d" else OCCUPIED

        def closed(rows: slice) -> NDArray[np.bool_]:
            found: NDArray[np.bool_] = after.cost[rows] == lethal
            found &= before.cost[rows] != lethal
            return found

        return cls(made_by_rows(after.cost, bool, closed))

    colours = (KEEPOUT,)

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        del frame
        closed = raster.enlarged(raster.largest(self.closed))
        pixels[closed] = first_index
        return [Swatch(first_index, "keepout")] if closed.any() else []


ImageExtent = Literal["known", "all"]

DEFAULT_EXTENT: ImageExtent = "known"

_MARGIN, _LEAST_MARGIN = 0.05, 10
"""Around the known cells: of their longer side, and cells."""

_WORTH = 0.95
"""Of both sides of the map: what a part must be below, on one, for a picture to be of it alone."""

IsKnown = Callable[[NDArray[Any]], NDArray[np.bool_]]


@dataclass(frozen=True)
class OtherThan:
    """Which values differ from one that stands for unknown cells."""

    value: int

    def __call__(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        known: NDArray[np.bool_] = values != self.value
        return known


_IS_KNOWN = OtherThan(UNKNOWN)
"""Of occupancy."""


@dataclass(frozen=True)
class KnownLines:
    """What rows, and what columns, have a known cell: what `known_box` gathers."""

    is_known: IsKnown

    def __call__(self, values: NDArray[Any]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return a mask of rows and a mask of columns."""
        known = self.is_known(values)
        return np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))


def known_box(layer: Layer, is_known: IsKnown) -> Region | None:
    """Return the box of the known cells of a layer; None if there are none."""
    # Rows are looked at once, from the first to the last, and those of a lazy layer not again.
    (parts,) = gathered(layer, KnownLines(is_known))
    with_known = np.flatnonzero(np.concatenate([rows for rows, _ in parts]))
    columns = np.flatnonzero(np.logical_or.reduce([cols for _, cols in parts]))
    if not len(with_known):
        return None
    row, col = int(with_known[0]), int(columns[0])
    return Region(row, col, int(with_known[-1]) - row + 1, int(columns[-1]) - col + 1)


def shown_part(
    layer: Layer,
    frame: Frame,
    extent: ImageExtent,
    *,
    is_known: IsKnown = _IS_KNOWN,
    overlay: Overlay | None = None,
    places_xy: ArrayLike = (),
) -> Region | None:
    if extent == "all":
        return None
    box = known_box(layer, is_known)
    if box is None:
        return None
    low, high = np.array(box[:2]), np.array(box[:2]) + box[2:]
    points = np.concatenate([
        np.reshape(places_xy, (-1, 2)).astype(np.float64),
        np.empty((0, 2)) if overlay is None else np.reshape(overlay.places_xy, (-1, 2)),
    ])  # fmt: skip
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        places = frame.continuous_rowcol_from_xy(points)
        low = np.clip(np.floor(places.min(axis=0)), 0, low)
        high = np.clip(np.ceil(places.max(axis=0)), high, frame.shape)
    margin = max(_LEAST_MARGIN, round(_MARGIN * float((high - low).max())))
    first = np.clip(low - margin, 0, frame.shape).astype(int)
    size = np.clip(high + margin, 0, frame.shape).astype(int) - first
    if (size <= 0).any() or (size > _WORTH * np.array(frame.shape)).all():
        return None
    return Region(int(first[0]), int(first[1]), int(size[0]), int(size[1]))
