"""Legends and palettes of each type of grid.

Pictures, and pages that show the same layers, draw with these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    CostScale,
)
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.canvas import round_length
from mapdeal.render.colours import Colour, Colours, palette_of
from mapdeal.render.style import ColourBar, LayerStyle, Scale, Swatch

COST_LEVELS = 200
"""Colours of graded costs, the first of a palette."""


@dataclass(frozen=True, eq=False)
class CostPalette:
    """Palette indices of the costs of a scale."""

    by_value: NDArray[np.uint8]
    colours: Colours
    highest_graded: int
    lethal_cost: int
    free: int = COST_LEVELS
    inscribed: int = COST_LEVELS + 1
    lethal: int = COST_LEVELS + 2
    unknown: int = COST_LEVELS + 3
    contour: int = COST_LEVELS + 4

    @classmethod
    def of(cls, scale: CostScale) -> CostPalette:
        """Return the palette of a scale of costs."""
        on_byte_scale = scale == "costmap2d"
        top = INSCRIBED_INFLATED_OBSTACLE - 1 if on_byte_scale else OCCUPIED - 1
        by_value = np.full(256, cls.lethal, dtype=np.uint8)
        by_value[0] = cls.free
        by_value[1 : top + 1] = (np.arange(top) * COST_LEVELS) // top
        if on_byte_scale:
            by_value[INSCRIBED_INFLATED_OBSTACLE] = cls.inscribed
        by_value[NO_INFORMATION] = cls.unknown  # -1 on the occupancy scale
        palette = np.vstack([
            colours.interpolated(colours.COST_ANCHORS, COST_LEVELS),
            [colours.RVIZ_FREE, colours.INSCRIBED, colours.LETHAL, colours.RVIZ_UNKNOWN,
             colours.CONTOUR],
        ])  # fmt: skip
        lethal_cost = LETHAL_OBSTACLE if on_byte_scale else OCCUPIED
        return cls(by_value, palette.astype(np.uint8), top, lethal_cost)


_NUMBER_LEVELS = 200

POTENTIAL_LEVELS = 100
_HIGHEST_NORMALISED = 10.0
POTENTIAL_OBSTACLE, POTENTIAL_ARROW, POTENTIAL_GOAL, POTENTIAL_NOWHERE = range(
    2 * POTENTIAL_LEVELS, 2 * POTENTIAL_LEVELS + 4
)
"""Of a potential: indices beside those of its scale and of the same, faded."""

_KINDS_OF_DIFFERENCE = (
    ("only in one map", colours.OUTSIDE),
    ("unknown", colours.RVIZ_UNKNOWN),
    ("free", colours.RVIZ_FREE),
    ("free in one, unknown in the other", colours.CHANGED),
    ("wall", colours.RVIZ_OCCUPIED),
    ("wall removed", colours.REMOVED),
    ("wall added", colours.ADDED),
)


def occupancy_style() -> LayerStyle:
    """Return the greys of RViz's scheme "map", of cells as bytes: unknown ones are 255."""
    unknown = OCCUPIED + 1
    ramp = np.rint(255 - 255 * np.arange(OCCUPIED + 1) / OCCUPIED).astype(np.uint8)
    by_value = np.full(256, unknown, dtype=np.uint8)
    by_value[: OCCUPIED + 1] = np.arange(OCCUPIED + 1)
    ticks = [(value / OCCUPIED, str(value)) for value in (0, 25, 50, 75, OCCUPIED)]
    return LayerStyle(
        palette_of(np.repeat(ramp[:, np.newaxis], 3, axis=1), [colours.RVIZ_UNKNOWN]),
        by_value=by_value,
        swatches=(Swatch(OCCUPIED, "occupied"), Swatch(0, "free"), Swatch(unknown, "unknown")),
        bar=ColourBar(range(OCCUPIED + 1), ticks, "occupancy"),
        labels={0: "free", OCCUPIED: "occupied", 255: "unknown"},
    )


def cost_style(costmap: Costmap) -> LayerStyle:
    """Return the even scale of a costmap's graded costs; those that mean something stand apart."""
    # The legend has an entry for the contour of the circumscribed cost if the costmap knows it.
    own = CostPalette.of(costmap.scale)
    swatches = [Swatch(own.lethal, f"lethal {own.lethal_cost}")]
    labels = {0: "free", own.lethal_cost: "lethal", NO_INFORMATION: "unknown"}
    if costmap.scale == "costmap2d":
        swatches.append(Swatch(own.inscribed, f"inscribed {INSCRIBED_INFLATED_OBSTACLE}"))
        labels[INSCRIBED_INFLATED_OBSTACLE] = "inscribed"
    swatches += [Swatch(own.free, "free 0"), Swatch(own.unknown, "unknown")]
    if bounds_circumscribed(costmap):
        swatches.append(Swatch(own.contour, f"circumscribed {costmap.circumscribed_cost}"))
    top = own.highest_graded
    ticks = [(value / top, f"{value:g}") for value in (1, *round_values(top, 5), top)]
    return LayerStyle(
        own.colours,
        by_value=own.by_value,
        swatches=tuple(swatches),
        bar=ColourBar(range(COST_LEVELS), ticks, "cost"),
        labels=labels,
    )


def bounds_circumscribed(costmap: Costmap) -> bool:
    """Return whether there is a contour to draw where the circumscribed cost begins."""
    # Between the radii of a round robot there is nothing to bound: its cost is inscribed.
    cost = costmap.circumscribed_cost
    return bool(cost) and cast("int", cost) < INSCRIBED_INFLATED_OBSTACLE


def potential_style(field: PotentialField) -> LayerStyle:
    """Return the even scale of a normalised potential, 0 to 10; unknown cells are faded."""
    scale = colours.interpolated(colours.POTENTIAL_ANCHORS, POTENTIAL_LEVELS)
    special = [colours.LETHAL, colours.ARROW, colours.GOAL, colours.RVIZ_UNKNOWN]
    swatches = [
        Swatch(POTENTIAL_OBSTACLE, "obstacle"),
        Swatch(POTENTIAL_LEVELS + POTENTIAL_LEVELS // 4, "unknown: faded"),
        Swatch(POTENTIAL_ARROW, "downhill"),
    ]
    if field.goal is not None:
        swatches.append(Swatch(POTENTIAL_GOAL, "goal"))
    if field.region is not None:
        swatches.append(Swatch(POTENTIAL_NOWHERE, "no potential"))
    ticks = [(value / _HIGHEST_NORMALISED, f"{value}") for value in range(0, 11, 2)]
    return LayerStyle(
        palette_of(scale, colours.mixed(scale, colours.RVIZ_UNKNOWN, 0.6), special),
        scale=Scale(0.0, _HIGHEST_NORMALISED, 0, POTENTIAL_LEVELS),
        swatches=tuple(swatches),
        bar=ColourBar(range(POTENTIAL_LEVELS), ticks, "normalised"),
        nowhere=POTENTIAL_NOWHERE,
        faded_by=POTENTIAL_LEVELS,
    )


def difference_style(only_in: tuple[str, str] | None = None) -> LayerStyle:
    """Return the colours of the seven kinds of cells of a difference, 0 to 6."""
    kinds = list(_KINDS_OF_DIFFERENCE)
    if only_in is not None:
        names = ["free by one of them, unknown by the other", "wall"]
        names += [f"wall only by {name}" for name in only_in]
        kinds[3:] = [(name, colour) for name, (_, colour) in zip(names, kinds[3:], strict=True)]
    return _style_of_kinds(kinds)


def cleaning_style() -> LayerStyle:
    """Return the colours of the kinds of cells of a cleaned map, 0 to 7."""
    # They are those of a difference, and 7 for unknown cells that have become free.
    kinds = list(_KINDS_OF_DIFFERENCE)
    names = ["free, now unknown", "wall", "wall, now free", "unknown, now wall"]
    kinds[3:] = [(name, colour) for name, (_, colour) in zip(names, kinds[3:], strict=True)]
    return _style_of_kinds([*kinds, ("unknown, now free", colours.FILLED)])


def alignment_style(names: tuple[str, str]) -> LayerStyle:
    """Return the colours of the kinds of cells of two maps laid over each other, 0 to 5."""
    _, unknown, free, _, wall, first, second = (colour for _, colour in _KINDS_OF_DIFFERENCE)
    kinds = [("outside of both", unknown), ("unknown", unknown), ("free in one of them", free)]
    kinds += [(f"wall of {names[0]}", first), (f"wall of {names[1]}", second)]
    return _style_of_kinds([*kinds, ("wall of both", wall)])


def _style_of_kinds(kinds: Sequence[tuple[str, Colour]]) -> LayerStyle:
    """Return the colours of kinds of cells, whose values are 0, 1, ..."""
    count = len(kinds)
    by_value = np.zeros(256, dtype=np.uint8)
    by_value[:count] = np.arange(count)
    names = [name for name, _ in kinds]
    return LayerStyle(
        np.array([colour for _, colour in kinds], dtype=np.uint8),
        by_value=by_value,
        swatches=tuple(Swatch(kind, names[kind]) for kind in reversed(range(count))),
        labels=dict(enumerate(names)),
    )


def number_style(low: float, high: float, unit: str, *, nowhere: str = "no value") -> LayerStyle:
    """Return an even scale from pale to dark blue, of a layer of plain numbers."""
    if high <= low:
        high = low + 1.0
    ticks = [((value - low) / (high - low), f"{value:g}") for value in ticks_of(low, high, 6)]
    return LayerStyle(
        palette_of(
            colours.interpolated(colours.FREE_ANCHORS, _NUMBER_LEVELS), [colours.RVIZ_UNKNOWN]
        ),
        scale=Scale(low, high, 0, _NUMBER_LEVELS),
        swatches=(Swatch(_NUMBER_LEVELS, nowhere),),
        bar=ColourBar(range(_NUMBER_LEVELS), ticks, unit),
        nowhere=_NUMBER_LEVELS,
    )


def ticks_of(low: float, high: float, about: int) -> list[float]:
    """Return the multiples of a round length from `low` to `high`, about so many."""
    step = round_length((high - low) / about * 1.5)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    decimals = max(0, -math.floor(math.log10(step)))
    return [round(k * step, decimals) + 0.0 for k in range(first, last + 1)]


def round_values(end: float, about: int) -> list[float]:
    """Return round numbers between 0 and `end`, both excluded, none close to the end."""
    step = round_length(end / about * 1.5)
    return [step * k for k in range(1, math.ceil(end / step)) if end - step * k > 0.35 * step]
