"""Rasters from cells to pixels, and overlays on them: routes, robots, poses, zones.

Cells are scaled to pixels by integer factors only, so edges stay sharp and no obstacle vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid import canvas, costmap, values as codes
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, Region, turned, xy_ahead
from mapdeal.grid.reach import Route
from mapdeal.kernels import blocks, distance, threads
from mapdeal.kernels.arrays import Bytes, Floats, Mask
from mapdeal.kernels.lookup import histogram, pooled
from mapdeal.pictures import colours as palette
from mapdeal.pictures.colours import Colour, Swatch
from mapdeal.records import dataclass

_SMALL_SIDE = 600  # approximate long side of enlarged small maps, pixels
DEFAULT_IMAGE_MAX = 2048


@dataclass(frozen=True)
class Raster:
    """Scale of a picture: `enlarge` pixels per cell, or `reduce` cells per pixel."""

    enlarge: int = 1
    reduce: int = 1
    part: Region | None = None  # cells in the picture, inside of the map; None for all

    @classmethod
    def fitting(
        cls, shape: tuple[int, int], image_max: int, *, small_side: int = _SMALL_SIDE,
        part: Region | None = None,
    ) -> Raster:  # fmt: skip
        """Return the raster for a map or a part of it with at most `image_max` pixels per side."""
        # With 0, a pixel per cell. Small maps are enlarged to `small_side` pixels or slightly more.
        side = max(shape if part is None else (part.height, part.width))
        if image_max == 0:
            return cls(part=part)
        if side > image_max:
            return cls(reduce=math.ceil(side / image_max), part=part)
        return cls(enlarge=max(1, min(math.ceil(small_side / side), image_max // side)), part=part)

    def frame_of(self, frame: Frame) -> Frame:
        return frame if self.part is None else self.part.frame_in(frame)

    def metres_per_pixel(self, resolution: float) -> float:
        return resolution * self.reduce / self.enlarge

    def largest(self, layer: blocks.Layer) -> NDArray[Any]:
        """Return the largest value of the cells under each pixel, before enlarging."""
        # A pixel is nan only if all its cells are.
        return Pooling(self, layer, np.fmax).all()

    def smallest(self, layer: blocks.Layer) -> NDArray[Any]:
        """Return the smallest value of the cells under each pixel, before enlarging."""
        return Pooling(self, layer, np.fmin).all()

    def enlarged(self, pixels: NDArray[Any]) -> NDArray[Any]:
        if self.enlarge == 1:
            return pixels
        return np.repeat(np.repeat(pixels, self.enlarge, axis=1), self.enlarge, axis=0)


class Pooling:
    """Reduces cells to pixels, band by band."""

    def __init__(self, raster: Raster, layer: blocks.Layer, choose: np.ufunc) -> None:
        self._step = raster.reduce
        self._first = 0 if raster.part is None else raster.part.row
        self._layer = layer if raster.part is None else canvas.cut_out(layer, raster.part)
        self._choose = choose
        self.pixels: NDArray[Any]  # before enlarging, once all rows have been taken in order

    def all(self) -> NDArray[Any]:
        for rows in blocks.blocks_of(self._layer):
            self.take(slice(rows.start + self._first, rows.stop + self._first))
        return self.pixels

    def take(self, rows: slice) -> None:
        height = self._layer.shape[0]
        first, end = (min(max(row - self._first, 0), height) for row in (rows.start, rows.stop))
        if first == end:
            return
        cells = self._layer[first:end]
        if self._step == 1 and len(cells) == height:
            self.pixels = cells
            return
        if first == 0:
            size = (math.ceil(length / self._step) for length in self._layer.shape)
            self.pixels = np.empty(tuple(size), dtype=self._layer.dtype)
        under_last = min(-first % self._step, len(cells))
        if under_last:  # remaining cells of the last row of pixels
            row = self.pixels[first // self._step]
            self._choose(row, pooled(cells[:under_last], self._step, self._choose)[0], out=row)
        full_rows, pixels = cells[under_last:], self.pixels[-(-first // self._step) :]

        def pool(rows: slice) -> None:
            under = full_rows[rows.start * self._step : rows.stop * self._step]
            pixels[rows] = pooled(under, self._step, self._choose)

        # the number of cells, not of pixels, decides about threads
        threads.for_rows(pool, (math.ceil(len(full_rows) / self._step), full_rows.shape[1]))


def inner_outline(mask: Mask) -> Mask:
    return distance.beside(~mask) & mask


_FARTHEST = 2.0**20  # pixels; beyond, Pillow's coordinates overflow
_MOST_PIXELS = 1 << 24  # that are copied for drawing, unless one shape needs more


@dataclass(frozen=True, eq=False)
class Surface:
    """Palette indices of a map to draw on, row 0 in the south, with their frame."""

    pixels: Bytes
    frame: Frame
    raster: Raster

    @property
    def side(self) -> int:
        return int(max(self.pixels.shape))

    def places(self, points_xy: ArrayLike) -> Floats:
        places = self.frame.continuous_rowcol_from_xy(points_xy)[:, ::-1]
        return places * (self.raster.enlarge / self.raster.reduce)


class Overlay(Protocol):
    @property
    def colours(self) -> Sequence[Colour]:
        """Colours that the palette needs, in order."""

    @property
    def text(self) -> str:
        return ""

    @property
    def places_xy(self) -> Floats:
        """Points that the picture must show, shape (N, 2), metres in the map frame."""
        return np.empty((0, 2))

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        """Draw with `colours`, from `first_index` of the palette on; return the legend."""


@dataclass(frozen=True)
class Overlays(Overlay):
    overlays: tuple[Overlay, ...]

    @property
    def colours(self) -> list[Colour]:
        return [colour for overlay in self.overlays for colour in overlay.colours]

    @property
    def text(self) -> str:
        return "; ".join(overlay.text for overlay in self.overlays if overlay.text)

    @property
    def places_xy(self) -> Floats:
        return np.concatenate([np.reshape(overlay.places_xy, (-1, 2)) for overlay in self.overlays])

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        swatches = []
        for overlay in self.overlays:
            swatches += overlay.draw(on, first_index)
            first_index += len(overlay.colours)
        return swatches


class Brush:
    """Draws on pixels with row 0 in the south; coordinates are pixels, (column, row)."""

    def __init__(self, pixels: Bytes) -> None:
        self._pixels = pixels

    def polyline(self, points: Floats, index: int, *, thickness: int) -> None:
        if len(points) > 1:
            self._lines(np.stack([points[:-1], points[1:]], axis=1), points, index, thickness)

    def segments(self, starts: Floats, ends: Floats, index: int, *, thickness: int) -> None:
        points = np.unique(np.concatenate([starts, ends]), axis=0)
        self._lines(np.stack([starts, ends], axis=1), points, index, thickness)

    def _lines(self, lines: NDArray[Any], points: NDArray[Any], index: int, thickness: int) -> None:
        self._draw(index, lines, thickness=thickness)
        if thickness > 2:
            self._draw(index, points[:, np.newaxis], radius=thickness / 2)

    def dot(self, centre: Floats, index: int, *, radius: float) -> None:
        self._draw(index, centre[np.newaxis, np.newaxis], radius=radius)

    def arrows(
        self, centres: Floats, directions: Floats, index: int, *, length: float, thickness: int
    ) -> None:
        along, across = directions * length, _left_of(directions) * length
        tip, tail, neck = centres + along / 2, centres - along / 2, centres + along * 0.1
        self._draw(index, np.stack([tail, neck], axis=1), thickness=thickness)
        self._draw(index, np.stack([tip, neck + across * 0.22, neck - across * 0.22], axis=1))

    def dart(self, centre: Floats, direction: Floats, index: int, *, length: float) -> None:
        along, across = direction * length, _left_of(direction) * length
        tip, notch = centre + along * 0.6, centre - along * 0.2
        left_wing, right_wing = (centre - along * 0.4 + side * across * 0.35 for side in (1, -1))
        self._draw(index, np.array([[tip, left_wing, notch, right_wing]]))

    def _draw(self, index: int, shapes: Floats, *, thickness: int = 0, radius: float = 0.0) -> None:
        """Draw shapes with K points each, shape (N, K, 2): discs, lines, or filled polygons."""
        from PIL import Image, ImageDraw

        if not len(shapes):
            return
        height, width = self._pixels.shape
        shapes, reach = np.clip(shapes, -_FARTHEST, _FARTHEST), radius + thickness + 1
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


def _edge(places: Floats) -> Floats:
    return np.floor(places + 0.5)  # half a pixel always rounds up


def _left_of(direction: Floats) -> Floats:
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def circle(radius: float, corners: int) -> Floats:
    """Return a closed circle around (0, 0), shape (corners + 1, 2)."""
    turns = np.linspace(0, 2 * math.pi, corners + 1)
    return radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)


@dataclass(frozen=True, eq=False)
class RingOverlay:
    places_xy: Floats
    label: str
    text: str

    colours = (palette.REMOVED,)

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        if not len(self.places_xy):
            return []
        ring, thickness = circle(max(6.0, on.side / 80), 32), max(2, round(on.side / 400))
        for place in on.places(self.places_xy):
            Brush(on.pixels).polyline(place + ring, first_index, thickness=thickness)
        return [Swatch(first_index, self.label)]


@dataclass(frozen=True)
class PoseOverlay(Overlay):
    pose: tuple[float, float, float]

    colours = (palette.ROBOT,)

    @property
    def text(self) -> str:
        x, y, yaw = self.pose
        return f"robot at {x:.10g}, {y:.10g}, yaw {yaw:.4g}"

    @property
    def places_xy(self) -> Floats:
        return np.array([self.pose[:2]])

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        centre, tip = on.places([self.pose[:2], xy_ahead(self.pose, on.frame.resolution)])
        direction = (tip - centre) / np.hypot(*(tip - centre))
        Brush(on.pixels).dart(centre, direction, first_index, length=max(10.0, on.side / 25))
        return [Swatch(first_index, "robot")]


@dataclass(frozen=True)
class RouteOverlay(Overlay):
    route: Route

    colours = (palette.ROUTE, palette.START, palette.GOAL, palette.MINIMUM)

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
    def places_xy(self) -> Floats:
        return np.concatenate([self.route.points_xy, [self.route.start, self.route.goal]])

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        route, brush = self.route, Brush(on.pixels)
        line, start, goal, minimum = (first_index + k for k in range(4))
        swatches = [Swatch(start, "start"), Swatch(goal, "goal")]
        if len(route.points_xy):
            brush.polyline(on.places(route.points_xy), line, thickness=max(3, round(on.side / 250)))
            swatches.insert(0, Swatch(line, "route"))
        ends = [(route.goal, goal), (route.start, start)]
        if route.local_minimum is not None:
            ends.append((route.local_minimum, minimum))
            swatches.append(Swatch(minimum, "local minimum"))
        for point, index in ends:
            brush.dot(on.places([point])[0], index, radius=max(4.0, on.side / 110))
        return swatches


@dataclass(frozen=True, eq=False)
class PlanOverlay(Overlay):
    """Paths of a planner from one start, goals without a path, and places that a change clears."""

    paths_xy: Sequence[Floats]
    start: tuple[float, float]
    goals: Sequence[tuple[float, float]]
    missed: Sequence[tuple[float, float]]
    stops: Sequence[tuple[float, float]]
    cleared: Sequence[tuple[float, float, float]]  # x, y and radius

    colours = (
        palette.ROUTE, palette.START, palette.NOW_CLOSED, palette.GOAL, palette.MINIMUM,
        palette.CLOSED_IN_BOTH,
    )  # fmt: skip

    @property
    def text(self) -> str:
        return f"{len(self.paths_xy)} of {len(self.goals) + len(self.missed)} goals have a path"

    @property
    def places_xy(self) -> Floats:
        return np.concatenate([*self.paths_xy, [self.start, *self.goals, *self.missed]])

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        brush, dot = Brush(on.pixels), max(4.0, on.side / 110)
        route, start, reached, missed, cleared, stopped = (first_index + k for k in range(6))
        for path in self.paths_xy:
            brush.polyline(on.places(path), route, thickness=max(3, round(on.side / 250)))
        for x, y, radius in self.cleared:
            centre, edge = on.places([(x, y), (x + radius, y)])
            ring = circle(max(float(np.hypot(*(edge - centre))), 1.6 * dot), 48)
            brush.polyline(centre + ring, cleared, thickness=max(2, round(on.side / 400)))
        dots = (
            (self.stops, stopped), (self.goals, reached), (self.missed, missed),
            ([self.start], start),
        )  # fmt: skip
        for places, index in dots:
            for place in on.places(np.reshape(places, (-1, 2))):
                brush.dot(place, index, radius=dot)
        legend = [
            (self.paths_xy, route, "path"), ([self.start], start, "start"),
            (self.goals, reached, "goal"), (self.missed, missed, "goal without a path"),
            (self.stops, stopped, "nearest place to it that is reached"),
            (self.cleared, cleared, "clearing this makes a path"),
        ]  # fmt: skip
        return [Swatch(index, label) for places, index, label in legend if len(places)]


@dataclass(frozen=True)
class TrajectoriesOverlay(Overlay):
    lines_xy: Sequence[Floats]

    colours = (palette.ROUTE,)

    @property
    def places_xy(self) -> Floats:
        return np.concatenate(self.lines_xy)

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        for line in self.lines_xy:
            Brush(on.pixels).polyline(on.places(line), first_index, thickness=2)
        return [Swatch(first_index, "trajectory")]


@dataclass(frozen=True)
class StepsOverlay(Overlay):
    """The routes planned at each pose of a path to a goal, and the path through all poses."""

    routes: Sequence[Route]
    driven_xy: Floats

    colours = (palette.ROUTE, palette.ROBOT, palette.START, palette.GOAL)

    @property
    def places_xy(self) -> Floats:
        return np.concatenate([self.driven_xy, *(route.points_xy for route in self.routes)])

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        brush, thickness = Brush(on.pixels), max(1, round(on.side / 500))
        for route in self.routes:
            brush.polyline(on.places(route.points_xy), first_index, thickness=thickness)
        brush.polyline(on.places(self.driven_xy), first_index + 1, thickness=3 * thickness)
        start, goal = on.places([self.driven_xy[0], self.routes[-1].goal])
        for place, number in ((goal, 3), (start, 2)):
            brush.dot(place, first_index + number, radius=max(4.0, on.side / 110))
        names = ("routes of all steps", "driven", "start", "goal")
        return [Swatch(first_index + number, name) for number, name in enumerate(names)]


_EDGE_DISTANCE = 10  # pixels between the shape and the edges
_LEAST_SIZE, _LARGEST_SHARE = 4, 0.4  # pixels of a drawn shape, and of the picture's sides


def outline_of(robot: Footprint, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Floats:
    """Return the closed outline of a robot at a pose, shape (N, 2), in the frame of the pose."""
    closed = [*robot.vertices, *robot.vertices[:1]]
    corners = np.array(closed) if closed else circle(robot.radius, 48)
    return np.asarray(turned(corners, pose[2]) + np.array(pose[:2]))


@dataclass(frozen=True)
class RobotOverlay(Overlay):
    """A robot's shape, true to scale, in the emptiest corner of a picture."""

    robot: Footprint
    label: str = "robot, to scale"

    colours = (palette.ROBOT_OUTLINE, palette.RVIZ_FREE)

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        outline = outline_of(self.robot) / on.raster.metres_per_pixel(on.frame.resolution)
        outline -= outline.min(axis=0)
        size = np.ceil(outline.max(axis=0)) + 2 * _EDGE_DISTANCE  # columns and rows
        height, width = on.pixels.shape
        if outline.max() < _LEAST_SIZE or (size > _LARGEST_SHARE * np.array([width, height])).any():
            return []
        cols, rows = size.astype(int).tolist()
        corners = [(left_x, low) for low in (0, height - rows) for left_x in (width - cols, 0)]
        parts = (on.pixels[low : low + rows, left_x : left_x + cols] for left_x, low in corners)
        evenness = [int(histogram(np.ascontiguousarray(part)).max()) for part in parts]
        left_x, low = corners[evenness.index(max(evenness))]
        outline += np.array([left_x, low]) + _EDGE_DISTANCE
        for index, thickness in ((first_index + 1, 4), (first_index, 2)):
            Brush(on.pixels).polyline(outline, index, thickness=thickness)
        return [Swatch(first_index, self.label)]


@dataclass(frozen=True, eq=False)
class KeepoutOverlay(Overlay):
    """Cells that are lethal only because of a mask."""

    closed: blocks.Layer

    @classmethod
    def of(cls, before: costmap.Costmap, after: costmap.Costmap) -> KeepoutOverlay:
        lethal = codes.LETHAL_OBSTACLE if after.scale == "costmap2d" else codes.OCCUPIED

        def closed(rows: slice) -> Mask:
            return np.asarray((after.cost[rows] == lethal) & (before.cost[rows] != lethal))

        return cls(blocks.made_by_rows(after.cost, bool, closed))

    colours = (palette.KEEPOUT,)

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        closed = on.raster.enlarged(on.raster.largest(self.closed))
        on.pixels[closed] = first_index
        return [Swatch(first_index, "keepout")] if closed.any() else []


ImageExtent = Literal["known", "all"]
DEFAULT_EXTENT: ImageExtent = "known"
_MARGIN, _LEAST_MARGIN = 0.05, 10  # around the known cells: share of their longer side, and cells
_LARGEST_CROP = 0.95  # largest share of a side of the map to which a picture is cut


@dataclass(frozen=True)
class KnownLines:
    """Function for `known_box`: which rows and which columns have a known cell."""

    unknown: int

    def __call__(self, values: NDArray[Any]) -> tuple[Mask, Mask]:
        known = values != self.unknown
        return np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))


def known_box(layer: blocks.Layer, unknown: int) -> Region | None:
    # Each row of a lazy layer is computed once, in order.
    (parts,) = blocks.gathered(layer, KnownLines(unknown))
    in_rows = np.concatenate([in_rows for in_rows, _ in parts])
    return Region.spanning(in_rows, np.logical_or.reduce([in_cols for _, in_cols in parts]))


def shown_part(
    layer: blocks.Layer, frame: Frame, extent: ImageExtent, *, unknown: int = codes.UNKNOWN,
    overlay: Overlay | None = None, places_xy: ArrayLike = (),
) -> Region | None:  # fmt: skip
    """Return the part of a map that a picture shows: known cells and places; None for all."""
    box = None if extent == "all" else known_box(layer, unknown)
    if box is None:
        return None
    low, high = np.array(box[:2]), np.array(box[:2]) + box[2:]
    both = places_xy, () if overlay is None else overlay.places_xy
    points = np.concatenate([np.reshape(np.asarray(xy, np.float64), (-1, 2)) for xy in both])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        places = frame.continuous_rowcol_from_xy(points)
        low = np.clip(np.floor(places.min(axis=0)), 0, low)
        high = np.clip(np.ceil(places.max(axis=0)), high, frame.shape)
    margin = max(_LEAST_MARGIN, round(_MARGIN * float((high - low).max())))
    first = np.clip(low - margin, 0, frame.shape).astype(int)
    size = np.clip(high + margin, 0, frame.shape).astype(int) - first
    if (size <= 0).any() or (size > _LARGEST_CROP * np.array(frame.shape)).all():
        return None
    return Region(*first.tolist(), *size.tolist())
