"""The colours of a distance field: one even scale of metres, through zero."""

from __future__ import annotations

import math

import numpy as np

from mapdeal.grid.field import DistanceField
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import blocks_of
from mapdeal.kernels.threads import for_rows
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import palette_of
from mapdeal.render.style import ColourBar, LayerStyle, Scale, Swatch
from mapdeal.render.styles import ticks_of

FIELD_LEVELS = 119
"""Of known cells; the palette has them again, faded, for unknown ones."""
LINE = 2 * FIELD_LEVELS
NOWHERE = LINE + 1
"""The outline of obstacles, and cells without a distance."""

_LEAST_GAP = 0.08
"""Between two labels of a bar, of its height."""


@dataclass(frozen=True)
class FieldEnds:
    """How far a field goes: over known cells, 0 for none, and over all."""

    far: float
    deep: float
    highest: float
    lowest: float

    @property
    def are_finite(self) -> bool:
        return math.isfinite(self.highest) and math.isfinite(self.lowest)

    @classmethod
    def of(cls, field: DistanceField) -> FieldEnds:
        """Return the ends of a field; where nothing is known, its unknown cells count."""
        ends = EndsByRows(field.cropped)
        for rows in blocks_of(field.cropped.distance):
            ends.take(rows)
        return ends.found()


class EndsByRows:
    """The ends of a field of which some rows are looked at at a time."""

    def __init__(self, field: DistanceField) -> None:
        self._field = field
        self._known: list[tuple[float, float]] = []
        self._every: list[tuple[float, float]] = []

    def take(self, rows: slice) -> None:
        """Look at some rows."""
        distances, occupancies = self._field.distance[rows], self._field.occupancy[rows]

        def look(rows: slice) -> None:
            distance, occupancy = distances[rows], occupancies[rows]
            self._every.append((float(distance.max()), float(distance.min())))
            is_known = occupancy != UNKNOWN
            if is_known.any():
                finite = np.where(is_known & np.isfinite(distance), distance, np.float32(0))
                self._known.append((float(finite.max()), float(finite.min())))

        for_rows(look, distances.shape)

    def found(self) -> FieldEnds:
        """Return the ends, once all rows were looked at."""
        known, every = self._known, self._every
        highest, lowest = max(end[0] for end in every), min(end[1] for end in every)
        if known:
            return FieldEnds(max(e[0] for e in known), -min(e[1] for e in known), highest, lowest)
        finite = [end if math.isfinite(end) else 0.0 for end in (highest, lowest)]
        return FieldEnds(max(finite[0], 0.0), -min(finite[1], 0.0), highest, lowest)


def field_style(field: DistanceField, ends: FieldEnds) -> LayerStyle:
    """Return the scale of a distance field: obstacles red, free space blue, even in metres."""
    # A step of colour is the same length on both sides of zero, and zero lies between two steps.
    # Each side goes through all its shades, however short it is, so that thin walls stay red.
    scale, below = _scale(ends)
    # One shade more, of which the palest is left out: a side of one step is not white.
    known = np.vstack([
        colours.interpolated(colours.OBSTACLE_ANCHORS, below + 1)[:0:-1],
        colours.interpolated(colours.FREE_ANCHORS, FIELD_LEVELS - below + 1)[1:],
    ])  # fmt: skip
    special = [colours.LINE, colours.RVIZ_UNKNOWN]
    swatches = [Swatch(LINE, "obstacle edge")]
    bar = None
    if ends.are_finite:
        bar, more = _bar(scale, ends)
        swatches += [*more, Swatch(faded_index(below, outside=True), "unknown: faded")]
    else:
        is_free = ends.highest > 0
        label = "+inf: no obstacle" if is_free else "-inf: nothing free"
        swatches.append(Swatch(FIELD_LEVELS - 1 if is_free else 0, label))
    if field.region is not None:
        swatches.append(Swatch(NOWHERE, "no distance"))
    return LayerStyle(
        palette_of(known, colours.mixed(known, colours.RVIZ_UNKNOWN, 0.6), special),
        scale=scale,
        swatches=tuple(swatches),
        bar=bar,
        nowhere=NOWHERE,
        line=LINE,
        faded_by=FIELD_LEVELS,
    )


def steps_below_zero(scale: Scale) -> int:
    """Return how many steps of a field's scale are negative distances."""
    return round(-scale.low / (scale.high - scale.low) * scale.levels)


def faded_index(below: int, *, outside: bool) -> int:
    """Return an index that shows what unknown cells look like, out of obstacles or in them."""
    typical = below + (FIELD_LEVELS - below) // 3 if outside else below // 2
    return FIELD_LEVELS + typical


def _scale(ends: FieldEnds) -> tuple[Scale, int]:
    """Return the scale, and how many of its steps are below zero: at least one on each side."""
    step = (ends.far + ends.deep) / (FIELD_LEVELS - 1) or 1.0
    below = min(max(1, math.ceil(ends.deep / step - 1e-9)), FIELD_LEVELS - 1)
    return Scale(-below * step, (FIELD_LEVELS - below) * step, 0, FIELD_LEVELS), below


def _bar(scale: Scale, ends: FieldEnds) -> tuple[ColourBar, list[Swatch]]:
    """Return the bar, and a legend entry for an end that is too near to zero to be labelled."""
    length = scale.high - scale.low
    lowest = f"{'<' if ends.lowest < -ends.deep else ''}-{ends.deep:.3g}"
    highest = f"{'>' if ends.highest > ends.far else ''}{ends.far:.3g}"
    zero, low, high = ((value - scale.low) / length for value in (0.0, -ends.deep, ends.far))
    ticks, swatches = [(zero, "0")], []
    if zero - low >= _LEAST_GAP:
        ticks.append((low, lowest))
    elif ends.deep > 0:
        swatches.append(Swatch(0, f"obstacle, to {lowest} m"))
    if high - zero >= _LEAST_GAP:
        ticks.append((high, highest))
    elif ends.far > 0:
        swatches.append(Swatch(FIELD_LEVELS - 1, f"free, to {highest} m"))
    for value in ticks_of(scale.low, scale.high, 6):
        place = (value - scale.low) / length
        if all(abs(place - taken) >= _LEAST_GAP for taken, _ in ticks):
            ticks.append((place, f"{value:g}"))
    return ColourBar(range(FIELD_LEVELS), sorted(ticks), "distance, m"), swatches
