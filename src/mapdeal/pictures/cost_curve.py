"""The picture of a cost curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.frame import RADIUS_TOLERANCE
from mapdeal.grid.values import INSCRIBED_INFLATED_OBSTACLE
from mapdeal.kernels.arrays import Floats
from mapdeal.pictures import canvas, colours, overlay, styles

_FAR = 2.5  # largest reach that is shown, relative to all other distances
_FARTHEST = 1e9  # metres; largest distance in a picture


class ZoneKind(Enum):
    OBSTACLE = "obstacle", colours.LETHAL
    COLLISION = "collision at any heading", colours.INSCRIBED
    HEADING = "collision at some headings", (249, 190, 110)
    CLEAR = "no collision, with a cost", (255, 238, 170)
    COST = "with a cost", (255, 238, 170)
    FREE = "no collision, no cost", colours.RVIZ_FREE
    NO_COST = "no cost", colours.RVIZ_FREE
    UNSEEN_COLLISION = "collision at any heading, no cost", colours.REMOVED
    UNSEEN_HEADING = "collision at some headings, no cost", (255, 130, 150)

    def __init__(self, text: str, colour: colours.Colour) -> None:
        self.text, self.colour = text, colour


class Zone(NamedTuple):
    kind: ZoneKind
    start: float
    end: float
    costs: tuple[int, int] | None


def zones_of(curve: CostCurve, end: float) -> list[Zone]:
    # Beyond the inscribed radius, zones mention collisions only if the robot's shape is known.
    half = curve.resolution / 2
    inscribed, circumscribed = curve.inscribed_radius or 0.0, curve.circumscribed_radius or 0.0
    places = sorted({p for p in (inscribed, circumscribed, curve.end) if half < p < end})
    starts, ends = [half, *places], [*places, end]
    zones = [Zone(ZoneKind.OBSTACLE, -half, half, (int(curve.cost[0]), int(curve.cost[0])))]
    for start, stop in zip(starts, ends, strict=True):
        kind = _kind_at((start + stop) / 2, curve)
        if kind is zones[-1].kind:  # a radius that makes no difference
            start = zones.pop().start
        zones.append(Zone(kind, start, stop, _costs_between(curve, start, stop)))
    return zones


def _kind_at(metres: float, curve: CostCurve) -> ZoneKind:
    has_cost = metres <= curve.end
    if metres <= (curve.inscribed_radius or 0.0):
        return ZoneKind.COLLISION if has_cost else ZoneKind.UNSEEN_COLLISION
    if curve.circumscribed_radius is None:
        return ZoneKind.COST if has_cost else ZoneKind.NO_COST
    if metres <= curve.circumscribed_radius:
        return ZoneKind.HEADING if has_cost else ZoneKind.UNSEEN_HEADING
    return ZoneKind.CLEAR if has_cost else ZoneKind.FREE


def _costs_between(curve: CostCurve, start: float, end: float) -> tuple[int, int] | None:
    distance = curve.distance - RADIUS_TOLERANCE
    # a float32 resolution may put a cell slightly beyond its nominal radius
    beyond = (curve.inscribed_radius or 0.0) + RADIUS_TOLERANCE
    np.maximum(distance, beyond, out=distance, where=curve.cost < INSCRIBED_INFLATED_OBSTACLE)
    inside = curve.cost[(distance > start) & (distance <= end)]
    if end > curve.reach:  # cells beyond the reach cost 0
        inside = np.append(inside, 0)
    return (int(inside.max()), int(inside.min())) if len(inside) else None


def described(zone: Zone, end: float) -> str:
    if zone.kind is ZoneKind.OBSTACLE:
        return f"cost {zone.costs[0]}" if zone.costs else ""
    where = "beyond" if zone.end >= end else f"up to {zone.end:.4g} m"
    if zone.costs is None:
        return f"{where}: no cell"
    high, low = zone.costs
    return f"{where}: {high}" if high == low else f"{where}: {high} .. {low}"


def end_of(curve: CostCurve) -> float:
    radii = curve.inscribed_radius or 0.0, curve.circumscribed_radius or 0.0
    marks = (metres for _, metres in curve.marks)
    near = max(curve.end, *radii, 2 * curve.resolution, *marks)
    far = max(near, curve.reach, curve.inflation_radius or 0.0)
    return 1.18 * min(far if far <= _FAR * near else near, _FARTHEST) + curve.resolution / 2


def marks_of(curve: CostCurve) -> list[tuple[float, str]]:
    """Return distances with their labels, the nearest first."""
    inscribed, circumscribed = curve.inscribed_radius, curve.circumscribed_radius
    named = list(curve.marks)
    if inscribed and circumscribed is not None and math.isclose(inscribed, circumscribed):
        named.append(("inscribed and circumscribed radius", inscribed))
    else:
        named += [("inscribed radius", inscribed)] if inscribed else []
        named += [] if circumscribed is None else [("circumscribed radius", circumscribed)]
    inflation, name = curve.inflation_radius, "reach"
    if inflation is not None and math.isclose(inflation, curve.reach):
        name = "inflation radius"
    elif inflation is not None:
        named.append(("inflation radius", inflation))
    marks = [(metres, f"{label}: {metres:.4g} m") for label, metres in named]
    cells = "1 cell" if curve.reach_cells == 1 else f"{curve.reach_cells:.6g} cells"
    then = f", cost {curve.cost_at_reach}, then 0" if curve.cost_at_reach else ""
    reach = f"{curve.reach:.4g} m, {cells}{then}" if curve.reach_cells else "0 m, no cost spreads"
    return sorted([*marks, (curve.reach, f"{name}: {reach}")], key=lambda mark: mark[0])


_SIZE = 16  # pixels per em of the text
_WIDTH = 960  # pixels of the plot
_PER_COST = {"costmap2d": 2, "occupancy": 5}  # pixels of its height
_LINE, _ROW = int(1.45 * _SIZE), int(1.6 * _SIZE)
_BAND = 10
_TINT = (255, 228, 232)
_DOT = 4.0  # pixels, radius
_ROOM = 7.0  # least pixels per cell at which dots are drawn
_TICKS = {"costmap2d": (0, 50, 100, 150, 200, 254), "occupancy": (0, 20, 40, 60, 80, 100)}
_AXES = {
    "euclidean": "distance from the nearest obstacle, centre to centre",
    "chebyshev": "distance from the nearest obstacle, the longer of row and column",
}


class _Drawing:
    def __init__(self, curve: CostCurve) -> None:
        self.curve, self.half = curve, curve.resolution / 2
        self.palette = styles.CostPalette.of(curve.scale)
        self.end, self.marks = end_of(curve), marks_of(curve)
        self.zones = zones_of(curve, self.end)
        self.ticks, self.per_cost = _TICKS[curve.scale], _PER_COST[curve.scale]
        self.has_dots = _WIDTH * curve.resolution / (self.end + self.half) >= _ROOM
        self.pen = canvas.Pen(_SIZE)
        self.left_x = _SIZE + canvas.text_width("254", _SIZE) + int(1.6 * _SIZE)
        self.band_top = _SIZE + int(3.4 * _SIZE) + _LINE
        self.top = self.band_top + _BAND + 1 + int(_ROW * len(self.marks) + 0.4 * _SIZE)
        self.bottom = self.top + self.palette.lethal_cost * self.per_cost
        self.right = self.left_x + _WIDTH

    def formula(self, count: int) -> tuple[Floats, Floats] | None:
        """Return `count` distances and their costs by the formula, if it can be drawn."""
        if self.curve.formula is None or self.curve.reach <= self.half:
            return None
        metres = np.linspace(self.half, min(self.curve.reach, self.end), count)
        return metres, np.minimum(self.curve.formula(metres), self.palette.lethal_cost - 1.0)

    def image(self, title: str) -> canvas.Image:
        pen, legend = self.pen, self._legend_lines()
        legend_width = int(1.9 * _SIZE) + max(canvas.text_width(line, _SIZE) for _, line in legend)
        end_of_legend = self.band_top + len(legend) * _LINE + 4 * _SIZE
        width = self.right + 3 * _SIZE + legend_width
        pen.open(width, max(self.bottom + int(4.4 * _SIZE), end_of_legend))
        limit = width - 2 * _SIZE
        pen.text(_SIZE, _SIZE, title, limit=limit, large=True)
        note = f"; {self.curve.note}" if self.curve.note else ""
        text = "cost over the distance from the nearest obstacle, on cells of "
        text += f"{self.curve.resolution:.6g} m{note}"
        pen.text(_SIZE, _SIZE + int(1.55 * _SIZE), text, limit=limit)
        self._draw_costs()
        self._draw_marks()
        self._draw_curve()
        self._axes()
        self._draw_band()
        self._legend(self.right + 2 * _SIZE, legend)
        zones = [kind.colour for kind in ZoneKind]
        return pen.image(np.vstack([self.palette.colours, zones, [_TINT]]))

    def _places(self, metres: ArrayLike, costs: ArrayLike) -> Floats:
        share = (np.asarray(metres) + self.half) / (self.end + self.half)
        rows = self.bottom - np.asarray(costs, dtype=np.float64) * self.per_cost
        return np.stack([self.left_x + _WIDTH * share, rows], axis=-1)

    def _column(self, metres: float) -> int:
        return round(float(self._places(metres, 0)[0]))

    def _draw_costs(self) -> None:
        """Draw bars of costs, and tint distances at which the robot may collide at no cost."""
        curve, sheet = self.curve, self.pen.sheet
        metres = (np.arange(_WIDTH) + 0.5) / _WIDTH * (self.end + self.half) - self.half
        costs = curve.cost_near(np.maximum(metres / curve.resolution, 0.0))
        if curve.metric == "euclidean":
            costs[metres > max(curve.reach, self.half)] = 0
        for column, cost in enumerate(costs.tolist()):
            top = self.bottom - cost * self.per_cost
            sheet[top : self.bottom, self.left_x + column] = self.palette.by_value[cost]
        for zone in self.zones:
            if zone.kind in (ZoneKind.UNSEEN_COLLISION, ZoneKind.UNSEEN_HEADING):
                a, b = (self._column(x) for x in (zone.start, zone.end))
                under = sheet[self.top : self.bottom, a:b]
                under[under == canvas.WHITE] = len(self.palette.colours) + len(ZoneKind)
        for cost in self.ticks[1:]:  # grid lines
            row = sheet[self.bottom - cost * self.per_cost, self.left_x : self.right]
            row[row == canvas.WHITE] = canvas.WHITE - 2

    def _draw_curve(self) -> None:
        """Draw the formula, and dots for the costs of cells along a row."""
        brush = overlay.Brush(self.pen.sheet)
        if (line := self.formula(2 * _WIDTH)) is not None:
            brush.polyline(self._places(*line), canvas.BLACK, thickness=2)
        curve = self.curve
        if curve.circumscribed_radius is not None and curve.circumscribed_cost:
            at = self._places(curve.circumscribed_radius, curve.circumscribed_cost)
            self._draw_contour_dot(at)
        dots = self.has_dots & (curve.distance <= self.end) & (curve.cells == np.floor(curve.cells))
        for place in self._places(curve.distance[dots], curve.cost[dots]):
            brush.dot(place, canvas.WHITE, radius=_DOT + 1.2)
            brush.dot(place, canvas.BLACK, radius=_DOT)

    def _draw_contour_dot(self, place: Floats) -> None:
        brush = overlay.Brush(self.pen.sheet)
        brush.dot(place, canvas.BLACK, radius=8.0)
        brush.dot(place, self.palette.contour, radius=6.0)

    def _draw_marks(self) -> None:
        sheet = self.pen.sheet
        for row, (distance, text) in enumerate(self.marks):
            middle = self.band_top + _BAND + 1 + int(0.9 * _SIZE) + row * _ROW
            is_beyond = distance > self.end
            label = canvas.fitting(text, _WIDTH - 2 * _SIZE, _SIZE) + " >" * is_beyond
            last = self.right - canvas.text_width(label, _SIZE) - 4
            if is_beyond:
                self._boxed(last, middle, label)
                continue
            x, rows = self._column(distance), np.arange(middle - _SIZE // 2, self.bottom)
            dashes = rows[rows % 8 < 5]
            is_cost = sheet[dashes, x] < len(self.palette.colours)
            sheet[dashes, x] = np.where(is_cost, canvas.WHITE, canvas.GREY)
            self._boxed(min(x + 6, last), middle, label)

    def _boxed(self, x: int, middle: int, label: str) -> None:
        half, width = int(0.6 * _SIZE), canvas.text_width(label, _SIZE)
        self.pen.sheet[middle - half : middle + half, x - 2 : x + width + 2] = canvas.WHITE
        self.pen.label(x, middle, label)

    def _axes(self) -> None:
        pen, under_band = self.pen, self.band_top + _BAND + 1
        pen.frame(self.left_x, under_band, _WIDTH, self.bottom - under_band)
        for cost in self.ticks:
            y = self.bottom - cost * self.per_cost
            pen.fill(self.left_x - 6, y, self.left_x - 2, y)
            pen.label(self.left_x - 10 - canvas.text_width(str(cost), _SIZE), y, str(cost))
        x = self.left_x - 10 - canvas.text_width("cost", _SIZE)
        pen.label(x, self.top - int(1.4 * _SIZE), "cost")
        scale = (self.end + self.half) / _WIDTH
        for pixel, label in canvas.ticks_between(-self.half, _WIDTH, scale, _SIZE):
            if not label.startswith("-"):
                x = self.left_x + pixel
                pen.fill(x, self.bottom + 1, x, self.bottom + 6)
                x -= canvas.text_width(label, _SIZE) // 2
                pen.label(x, self.bottom + 6 + int(0.8 * _SIZE), label)
        text = f"{_AXES[self.curve.metric]}, metres"
        x = self.left_x + (_WIDTH - canvas.text_width(text, _SIZE)) // 2
        pen.label(x, self.bottom + int(2.8 * _SIZE), text)

    def _draw_band(self) -> None:
        band = self.pen.sheet[self.band_top : self.band_top + _BAND]
        for zone in self.zones:
            a, b = (self._column(x) for x in (zone.start, zone.end))
            band[:, a:b] = self._index_of(zone)
            if b < self.right:
                band[:, b] = canvas.WHITE
            text = zone.kind.text
            width = canvas.text_width(text, _SIZE)
            if width <= b - a - 4:
                self.pen.label((a + b - width) // 2, self.band_top - int(0.8 * _SIZE), text)
        self.pen.frame(self.left_x, self.band_top, _WIDTH, _BAND)

    def _index_of(self, zone: Zone) -> int:
        return len(self.palette.colours) + list(ZoneKind).index(zone.kind)

    def _legend_lines(self) -> list[tuple[int | str | None, str]]:
        lines: list[tuple[int | str | None, str]] = []
        for zone in self.zones:
            lines += [(self._index_of(zone), zone.kind.text), (None, described(zone, self.end))]
        lines += [(None, "")]
        lines += [("dot", "distances along a row")] if self.has_dots else []
        lines += [("line", "the formula")] if self.formula(2) is not None else []
        cost = self.curve.circumscribed_cost
        return [*lines, ("contour", f"circumscribed cost {cost}")] if cost else lines

    def _legend(self, x: int, lines: Sequence[tuple[int | str | None, str]]) -> None:
        y, brush = self.band_top, overlay.Brush(self.pen.sheet)
        side = int(1.2 * _SIZE)
        for sign, text in lines:
            middle = y + int(0.6 * _SIZE)
            if isinstance(sign, int):
                y += 4
                middle += 4
                self.pen.sheet[middle - side // 2 : middle + side // 2, x : x + side] = sign
                self.pen.frame(x, middle - side // 2, side, side // 2 * 2)
            elif sign == "line":
                self.pen.fill(x, middle, x + side, middle + 1)
            elif sign == "contour":
                self._draw_contour_dot(np.array([x + side / 2, middle + 0.5]))
            elif sign == "dot":
                brush.dot(np.array([x + side / 2, middle + 0.5]), canvas.BLACK, radius=_DOT)
            self.pen.label(x + 1.8 * _SIZE, middle, text)
            y += _LINE


def curve_text(curve: CostCurve) -> str:
    end = end_of(curve)
    zones = "; ".join(f"{zone.kind.text} {described(zone, end)}" for zone in zones_of(curve, end))
    marks = "; ".join(label for _, label in marks_of(curve))
    return f"Cost over the distance from the nearest obstacle. {zones}. {marks}."


def cost_curve_image(curve: CostCurve, *, title: str) -> canvas.Image:
    return _Drawing(curve).image(title)
