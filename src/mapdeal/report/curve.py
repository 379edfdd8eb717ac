"""A cost curve as inline SVG: what the picture of it shows, in text that can be read aloud."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mapdeal.grid.cost_curve import CostCurve
from mapdeal.render.cost_palette import CostPalette
from mapdeal.render.cost_zones import Zone, ZoneKind, described, end_of, marks_of, zones_of
from mapdeal.report.legends import hex_of, swatch
from mapdeal.report.markup import Markup, element

_LEFT, _RIGHT, _WIDTH = 44, 16, 700  # pixels
_MARK, _PLOT, _BELOW = 18, 220, 40
_COLUMNS = 700
_LETTER = 6.4
_TICKS = {"costmap2d": (0, 50, 100, 150, 200, 254), "occupancy": (0, 20, 40, 60, 80, 100)}
_ZONE_COLOURS = {
    ZoneKind.OBSTACLE: "#101014",
    ZoneKind.COLLISION: "#00bec8",
    ZoneKind.HEADING: "#f9be6e",
    ZoneKind.CLEAR: "#ffeeaa",
    ZoneKind.COST: "#ffeeaa",
    ZoneKind.FREE: "#ffffff",
    ZoneKind.NO_COST: "#ffffff",
    ZoneKind.UNSEEN_COLLISION: "#e11e3c",
    ZoneKind.UNSEEN_HEADING: "#ff8296",
}
_AXES = {
    "euclidean": "distance from the nearest obstacle, centre to centre, m",
    "chebyshev": "distance from the nearest obstacle, the longer of row and column, m",
}


def curve_figure(curve: CostCurve) -> Markup:
    """Return a figure of a curve: the plot, and its zones as a list."""
    plot = _Plot(curve)
    zones = [_zone_row(zone, plot.end) for zone in plot.zones]
    caption = f"Cells of {curve.resolution:.6g} m" + (f"; {curve.note}" if curve.note else "")
    return element(
        "figure",
        element("div", plot.drawn(), class_="wide", tabindex=0, role="group", aria_label="Plot"),
        element("figcaption", caption),
        element("ul", *zones, class_="zones"),
        class_="curve",
    )


def _zone_row(zone: Zone, end: float) -> Markup:
    return element(
        "li",
        swatch(_ZONE_COLOURS[zone.kind]),
        " ",
        element("b", zone.kind.value),
        " ",
        described(zone, end),
    )


class _Plot:
    """Where metres and costs lie on the drawing."""

    def __init__(self, curve: CostCurve) -> None:
        self.curve = curve
        self.palette = CostPalette.of(curve.scale)
        self.end = end_of(curve)
        self.zones = zones_of(curve, self.end)
        self.marks = [mark for mark in marks_of(curve) if mark.distance <= self.end]
        self.half = curve.resolution / 2
        self.top = 14 + _MARK * len(self.marks)
        self.bottom = self.top + _PLOT

    def x(self, metres: float) -> float:
        """Return the pixel of a distance."""
        share = (metres + self.half) / (self.end + self.half)
        return round(_LEFT + share * (_WIDTH - _LEFT - _RIGHT), 2)

    def y(self, cost: float) -> float:
        """Return the pixel of a cost."""
        return round(self.bottom - _PLOT * cost / self.palette.lethal_cost, 2)

    def drawn(self) -> Markup:
        """Return the drawing."""
        return element(
            "svg",
            *self._bars(), *self._axes(), *self._formula(), *self._dots(), *self._marks(),
            viewBox=f"0 0 {_WIDTH} {self.bottom + _BELOW}", role="img", aria_label=self._told(),
        )  # fmt: skip

    def _told(self) -> str:
        zones = "; ".join(f"{zone.kind.value} {described(zone, self.end)}" for zone in self.zones)
        return f"Cost over the distance from the nearest obstacle. {zones}."

    def _bars(self) -> list[Markup]:
        """Return the area below the curve, in the colours of costs."""
        curve = self.curve
        edges = np.linspace(-self.half, self.end, _COLUMNS + 1)
        middles = np.maximum((edges[1:] + edges[:-1]) / 2, 0.0)
        costs = curve.cost_near(middles / curve.resolution)
        starts = np.flatnonzero(np.diff(costs, prepend=-1))
        parts = []
        for first, last in pairwise([*starts.tolist(), _COLUMNS]):
            cost = int(costs[first])
            if cost == 0:
                continue
            left, right = self.x(edges[first]), self.x(edges[last])
            colour = hex_of(self.palette.colours[self.palette.by_value[cost]])
            parts.append(
                element(
                    "rect", x=left, y=self.y(cost), width=round(right - left, 2),
                    height=round(self.bottom - self.y(cost), 2), fill=colour,
                )
            )  # fmt: skip
        return parts

    def _axes(self) -> list[Markup]:
        parts = []
        left, right = self.x(-self.half), self.x(self.end)
        for cost in _TICKS[self.curve.scale]:
            y = self.y(cost)
            parts.append(element("line", x1=left, x2=right, y1=y, y2=y, class_="rule"))
            parts.append(element("text", str(cost), x=left - 6, y=y + 4, text_anchor="end"))
        step = _round_step(self.end / 8)
        for k in range(int(self.end / step) + 1):
            x = self.x(k * step)
            line = element("line", x1=x, x2=x, y1=self.bottom, y2=self.bottom + 5, class_="tick")
            text = f"{k * step:.6g}"
            parts += [line, element("text", text, x=x, y=self.bottom + 18, text_anchor="middle")]
        parts.append(
            element("line", x1=left, x2=right, y1=self.bottom, y2=self.bottom, class_="tick")
        )
        middle, low = (left + right) / 2, self.bottom + 35
        axis = _AXES[self.curve.metric]
        parts.append(element("text", axis, x=middle, y=low, text_anchor="middle"))
        parts.append(element("text", "cost", x=left - 6, y=self.top - 10, text_anchor="end"))
        return parts

    def _formula(self) -> list[Markup]:
        curve = self.curve
        if curve.formula is None or curve.reach <= self.half:
            return []
        metres = np.linspace(self.half, min(curve.reach, self.end), 200)
        costs = np.minimum(curve.formula(metres), self.palette.lethal_cost - 1.0)
        pairs = zip(metres.tolist(), costs.tolist(), strict=True)
        points = " ".join(f"{self.x(m):g},{self.y(c):g}" for m, c in pairs)
        return [element("polyline", points=points, class_="formula")]

    def _dots(self) -> list[Markup]:
        """Return a dot for each whole number of cells, as long as there is room for them."""
        curve = self.curve
        if (_WIDTH - _LEFT - _RIGHT) * curve.resolution / (self.end + self.half) < 6:
            return []
        shown = (curve.cells == np.floor(curve.cells)) & (curve.distance <= self.end)
        pairs = zip(curve.distance[shown].tolist(), curve.cost[shown].tolist(), strict=True)
        return [element("circle", cx=self.x(m), cy=self.y(c), r=3, class_="dot") for m, c in pairs]

    def _marks(self) -> list[Markup]:
        parts = []
        for row, mark in enumerate(self.marks):
            x, y = self.x(mark.distance), 12 + row * _MARK
            parts.append(element("line", x1=x, x2=x, y1=y - 8, y2=self.bottom, class_="mark"))
            fits = x + 6 + _LETTER * len(mark.label) <= _WIDTH
            anchor = "start" if fits else "end"
            parts.append(
                element("text", mark.label, x=x + 5 if fits else x - 5, y=y, text_anchor=anchor)
            )
        return parts


def _round_step(about: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at least `about`."""
    power = 10.0 ** np.floor(np.log10(about))
    return next(float(factor * power) for factor in (1, 2, 5, 10) if factor * power >= about)
