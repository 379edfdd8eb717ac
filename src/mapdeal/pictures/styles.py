"""Legends and palettes of each type of grid, for pictures and report pages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np

from mapdeal.grid import values
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, PotentialField
from mapdeal.grid.reach import Reach
from mapdeal.kernels import blocks, components, lookup, threads
from mapdeal.kernels.arrays import Bytes, Floats, Mask
from mapdeal.pictures import canvas, colours
from mapdeal.pictures.colours import Colour, ColourBar, Colours, LayerStyle, Scale, Swatch
from mapdeal.records import dataclass

COST_LEVELS = 200  # colours of graded costs, the first of a palette


@dataclass(frozen=True, eq=False)
class CostPalette:
    by_value: Bytes
    colours: Colours
    highest_graded: int
    lethal_cost: int
    free: int = COST_LEVELS
    inscribed: int = COST_LEVELS + 1
    lethal: int = COST_LEVELS + 2
    unknown: int = COST_LEVELS + 3
    contour: int = COST_LEVELS + 4

    @classmethod
    def of(cls, scale: values.CostScale) -> CostPalette:
        on_byte_scale = scale == "costmap2d"
        top = values.INSCRIBED_INFLATED_OBSTACLE - 1 if on_byte_scale else values.OCCUPIED - 1
        by_value = np.full(256, cls.lethal, dtype=np.uint8)
        by_value[0] = cls.free
        by_value[1 : top + 1] = (np.arange(top) * COST_LEVELS) // top
        if on_byte_scale:
            by_value[values.INSCRIBED_INFLATED_OBSTACLE] = cls.inscribed
        by_value[values.NO_INFORMATION] = cls.unknown  # -1 on the occupancy scale
        special = [colours.RVIZ_FREE, colours.INSCRIBED, colours.LETHAL, colours.RVIZ_UNKNOWN]
        graded = colours.interpolated(colours.COST_ANCHORS, COST_LEVELS)
        palette = colours.palette_of(graded, [*special, colours.CONTOUR])
        lethal_cost = values.LETHAL_OBSTACLE if on_byte_scale else values.OCCUPIED
        return cls(by_value, palette, top, lethal_cost)


_NUMBER_LEVELS = 200
POTENTIAL_LEVELS = 100
_ABOUT_LINES = 20  # of equal length to the goal
_HIGHEST_NORMALISED = 10.0
# palette indices after those of the scale of a potential, and of its faded scale
POTENTIAL_OBSTACLE, POTENTIAL_ARROW, POTENTIAL_GOAL, POTENTIAL_NOWHERE, POTENTIAL_LINE = range(
    2 * POTENTIAL_LEVELS, 2 * POTENTIAL_LEVELS + 5
)

_KINDS_OF_DIFFERENCE = (
    ("only in one map", colours.OUTSIDE), ("unknown", colours.RVIZ_UNKNOWN),
    ("free", colours.RVIZ_FREE), ("free in one, unknown in the other", colours.CHANGED),
    ("wall", colours.RVIZ_OCCUPIED), ("wall removed", colours.REMOVED),
    ("wall added", colours.ADDED),
)  # fmt: skip


def occupancy_style() -> LayerStyle:
    """Return the greys of RViz's scheme "map" for cells as bytes; unknown is 255."""
    unknown = values.OCCUPIED + 1
    ramp = np.rint(255 - 255 * np.arange(values.OCCUPIED + 1) / values.OCCUPIED).astype(np.uint8)
    by_value = np.full(256, unknown, dtype=np.uint8)
    by_value[: values.OCCUPIED + 1] = np.arange(values.OCCUPIED + 1)
    ticks = [(value / values.OCCUPIED, str(value)) for value in (0, 25, 50, 75, values.OCCUPIED)]
    return LayerStyle(
        colours.palette_of(np.repeat(ramp[:, np.newaxis], 3, axis=1), [colours.RVIZ_UNKNOWN]),
        by_value=by_value,
        swatches=tuple(map(Swatch, (values.OCCUPIED, 0, unknown), ("occupied", "free", "unknown"))),
        bar=ColourBar(range(values.OCCUPIED + 1), ticks, "occupancy"),
        labels={0: "free", values.OCCUPIED: "occupied", 255: "unknown"},
    )


def cost_style(costmap: Costmap) -> LayerStyle:
    # The legend includes the contour of the circumscribed cost if the costmap has one.
    palette = CostPalette.of(costmap.scale)
    swatches = [Swatch(palette.lethal, f"lethal {palette.lethal_cost}")]
    labels = {0: "free", palette.lethal_cost: "lethal", values.NO_INFORMATION: "unknown"}
    if costmap.scale == "costmap2d":
        inscribed = values.INSCRIBED_INFLATED_OBSTACLE
        swatches.append(Swatch(palette.inscribed, f"inscribed {inscribed}"))
        labels[inscribed] = "inscribed"
    swatches += [Swatch(palette.free, "free 0"), Swatch(palette.unknown, "unknown")]
    if bounds_circumscribed(costmap):
        swatches.append(Swatch(palette.contour, f"circumscribed {costmap.circumscribed_cost}"))
    top = palette.highest_graded
    step = canvas.round_length(top / 5 * 1.5)  # no label is close to the end
    marked = [step * k for k in range(1, math.ceil(top / step)) if top - step * k > 0.35 * step]
    ticks = [(value / top, f"{value:g}") for value in (1, *marked, top)]
    return LayerStyle(
        palette.colours, palette.by_value, swatches=tuple(swatches),
        bar=ColourBar(range(COST_LEVELS), ticks, "cost"), labels=labels,
    )  # fmt: skip


def bounds_circumscribed(costmap: Costmap) -> bool:
    # A round robot has none: its circumscribed cost is that of the inscribed radius.
    cost = costmap.circumscribed_cost
    return bool(cost) and cast("int", cost) < values.INSCRIBED_INFLATED_OBSTACLE


def potential_style(field: PotentialField) -> LayerStyle:
    scale = colours.interpolated(colours.POTENTIAL_ANCHORS, POTENTIAL_LEVELS)
    special = [colours.LETHAL, colours.ARROW, colours.GOAL, colours.RVIZ_UNKNOWN, colours.ROUTE]
    faded = Swatch(POTENTIAL_LEVELS + POTENTIAL_LEVELS // 4, "unknown: faded")
    swatches = [Swatch(POTENTIAL_OBSTACLE, "obstacle"), faded, Swatch(POTENTIAL_ARROW, "downhill")]
    if field.goal is not None:
        swatches.append(Swatch(POTENTIAL_GOAL, "goal"))
    if field.region is not None:
        swatches.append(Swatch(POTENTIAL_NOWHERE, "no potential"))
    if field.cost_to_go is not None:
        spacing = length_between_lines(field.cost_to_go)
        unit = "weighted m" if field.cost_travel_multiplier else "m"
        swatches.append(Swatch(POTENTIAL_LINE, f"every {spacing:g} {unit} to go"))
    ticks = [(value / _HIGHEST_NORMALISED, f"{value}") for value in range(0, 11, 2)]
    return LayerStyle(
        colours.palette_of(scale, colours.mixed(scale, colours.RVIZ_UNKNOWN, 0.6), special),
        scale=Scale(0.0, _HIGHEST_NORMALISED, 0, POTENTIAL_LEVELS),
        swatches=tuple(swatches), bar=ColourBar(range(POTENTIAL_LEVELS), ticks, "normalised"),
        nowhere=POTENTIAL_NOWHERE, faded_by=POTENTIAL_LEVELS,
    )  # fmt: skip


def length_between_lines(lengths: Floats) -> float:
    """Return a round distance between lines, about a twentieth of the longest finite length."""
    longest = float(lengths.max(where=np.isfinite(lengths), initial=0.0))
    return canvas.round_length(longest / _ABOUT_LINES) if longest > 0 else 1.0


def difference_style(only_in: tuple[str, str] | None = None) -> LayerStyle:
    if only_in is None:
        return _style_of_kinds(_KINDS_OF_DIFFERENCE)
    names = ["free by one of them, unknown by the other", "wall"]
    return _style_of_kinds(_differences(*names, *(f"wall only by {name}" for name in only_in)))


def _differences(*names: str) -> list[tuple[str, Colour]]:
    """Return the kinds of a difference with other names for all but the first three."""
    same, renamed = _KINDS_OF_DIFFERENCE[:3], _KINDS_OF_DIFFERENCE[3:]
    return [*same, *((name, colour) for name, (_, colour) in zip(names, renamed, strict=True))]


_CHANGE_LEVELS = 100  # colours for lower costs, and as many for higher costs
_LARGEST_CHANGE = values.LETHAL_OBSTACLE
_FIRST_CHANGE = 4  # index of the smallest change, behind those of the kinds of unchanged cells
_FIRST_KIND = _FIRST_CHANGE + 2 * _CHANGE_LEVELS
_KINDS_OF_COSTS = (
    ("only in one costmap", colours.OUTSIDE), ("unknown in both", colours.RVIZ_UNKNOWN),
    ("equal", colours.RVIZ_FREE), ("closed in both", colours.CLOSED_IN_BOTH),
)  # fmt: skip
_KINDS_OF_COST_CHANGES = (
    ("no longer unknown", colours.NOW_KNOWN), ("now unknown", colours.NOW_UNKNOWN),
    ("no longer closed", colours.NOW_OPEN), ("now closed", colours.NOW_CLOSED),
)  # fmt: skip


def cost_change_codes(
    first: Bytes, second: Bytes, is_common: Mask, masks: Mapping[Any, Mask]
) -> Bytes:
    """Return the palette index of each cell of two costmaps; a larger change has a larger one."""
    rise = second.astype(np.int16) - first
    levels = (np.abs(rise) - 1) * _CHANGE_LEVELS // _LARGEST_CHANGE
    codes = np.where(rise == 0, 2, _FIRST_CHANGE + 2 * levels + (rise > 0)).astype(np.uint8)
    codes[(rise == 0) & (first >= values.INSCRIBED_INFLATED_OBSTACLE)] = 3
    codes[(rise == 0) & (first == values.NO_INFORMATION)] = 1
    codes[~is_common] = 0
    for code, kind in enumerate(("known", "unknown", "opened", "closed"), _FIRST_KIND):
        codes[masks[kind]] = code
    return codes


def cost_change_style() -> LayerStyle:
    fell = colours.interpolated(colours.FREE_ANCHORS[1:], _CHANGE_LEVELS)
    rose = colours.interpolated(colours.OBSTACLE_ANCHORS, _CHANGE_LEVELS)
    kinds = [*enumerate(_KINDS_OF_COSTS), *enumerate(_KINDS_OF_COST_CHANGES, _FIRST_KIND)]
    labels = {code: name for code, (name, _) in kinds}
    ends = [-(-level * _LARGEST_CHANGE // _CHANGE_LEVELS) for level in range(_CHANGE_LEVELS + 1)]
    codes = range(_FIRST_CHANGE, _FIRST_KIND, 2)
    for code, (below, most) in zip(codes, pairwise(ends), strict=True):
        by = f"by {below + 1} to {most}"
        labels |= {code: f"fell {by}", code + 1: f"rose {by}"}
    indices = [*range(_FIRST_KIND - 2, 2, -2), 2, *range(_FIRST_CHANGE + 1, _FIRST_KIND, 2)]
    ticks = [(0.5 + share / 2, f"{share * _LARGEST_CHANGE:+.0f}") for share in (-1, -0.5, 0.5, 1)]
    graded = np.stack([fell, rose], axis=1).reshape(-1, 3)
    equal = [colour for _, colour in _KINDS_OF_COSTS]
    changed = [colour for _, colour in _KINDS_OF_COST_CHANGES]
    palette = colours.palette_of(equal, graded, changed)
    return LayerStyle(
        palette, by_value=np.minimum(np.arange(256), len(palette) - 1).astype(np.uint8),
        swatches=tuple(Swatch(code, name) for code, (name, _) in reversed(kinds)),
        bar=ColourBar(indices, [*ticks, (0.5, "0")], "change of the cost"), labels=labels,
    )  # fmt: skip


def cleaning_style() -> LayerStyle:
    # The kinds are those of a difference, and 7 for unknown cells that became free.
    kinds = _differences("free, now unknown", "wall", "wall, now free", "unknown, now wall")
    return _style_of_kinds([*kinds, ("unknown, now free", colours.FILLED)])


def alignment_style(names: tuple[str, str]) -> LayerStyle:
    _, unknown, free, _, wall, first, second = (colour for _, colour in _KINDS_OF_DIFFERENCE)
    kinds = [("outside of both", unknown), ("unknown", unknown), ("free in one of them", free)]
    kinds += [(f"wall of {names[0]}", first), (f"wall of {names[1]}", second)]
    return _style_of_kinds([*kinds, ("wall of both", wall)])


def _style_of_kinds(kinds: Sequence[tuple[str, Colour]]) -> LayerStyle:
    labels = {kind: name for kind, (name, _) in enumerate(kinds)}
    return LayerStyle(
        colours.palette_of([colour for _, colour in kinds]), by_value=_codes_below(len(kinds)),
        swatches=tuple(Swatch(*label) for label in reversed(labels.items())), labels=labels,
    )  # fmt: skip


def _codes_below(count: int) -> Bytes:
    """Return each byte below a count as its own palette index, and 0 for all others."""
    return np.where(np.arange(256) < count, np.arange(256), 0).astype(np.uint8)


def number_style(low: float, high: float, unit: str) -> LayerStyle:
    if high <= low:
        high = low + 1.0
    ticks = [((value - low) / (high - low), f"{value:g}") for value in ticks_of(low, high, 6)]
    blues = colours.interpolated(colours.FREE_ANCHORS, _NUMBER_LEVELS)
    return LayerStyle(
        colours.palette_of(blues, [colours.RVIZ_UNKNOWN]),
        scale=Scale(low, high, 0, _NUMBER_LEVELS), nowhere=_NUMBER_LEVELS,
        swatches=(Swatch(_NUMBER_LEVELS, "no value"),),
        bar=ColourBar(range(_NUMBER_LEVELS), ticks, unit),
    )  # fmt: skip


def ticks_of(low: float, high: float, about: int) -> list[float]:
    step = canvas.round_length((high - low) / about * 1.5)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    decimals = max(0, -math.floor(math.log10(step)))
    return [round(k * step, decimals) + 0.0 for k in range(first, last + 1)]


FIELD_LEVELS = 119  # colours of known cells; unknown cells have as many faded colours
LINE = 2 * FIELD_LEVELS
NOWHERE = LINE + 1  # the outline of obstacles, and cells without a distance
_LEAST_GAP = 0.08  # between two labels of a bar, relative to its height


@dataclass(frozen=True)
class FieldEnds:
    """Extremes of a field: over known cells (0 for none) and over all cells."""

    far: float
    deep: float
    highest: float
    lowest: float

    @classmethod
    def of(cls, field: DistanceField) -> FieldEnds:
        """Return the extremes of a field; without known cells, unknown cells count."""
        ends = EndsByRows(field.cropped)
        for rows in blocks.blocks_of(field.cropped.distance):
            ends.take(rows)
        return ends.found()


class EndsByRows:
    def __init__(self, field: DistanceField) -> None:
        self._field = field
        self._known: list[tuple[float, float]] = []
        self._all_cells: list[tuple[float, float]] = []

    def take(self, rows: slice) -> None:
        distances, occupancies = self._field.distance[rows], self._field.occupancy[rows]

        def collect(rows: slice) -> None:
            distance, occupancy = distances[rows], occupancies[rows]
            self._all_cells.append((float(distance.max()), float(distance.min())))
            is_known = occupancy != values.UNKNOWN
            if is_known.any():
                finite = np.where(is_known & np.isfinite(distance), distance, np.float32(0))
                self._known.append((float(finite.max()), float(finite.min())))

        threads.for_rows(collect, distances.shape)

    def found(self) -> FieldEnds:
        known, all_cells = self._known, self._all_cells
        highest, lowest = max(end[0] for end in all_cells), min(end[1] for end in all_cells)
        if known:
            return FieldEnds(max(e[0] for e in known), -min(e[1] for e in known), highest, lowest)
        finite = [end if math.isfinite(end) else 0.0 for end in (highest, lowest)]
        return FieldEnds(max(finite[0], 0.0), -min(finite[1], 0.0), highest, lowest)


def field_style(field: DistanceField, ends: FieldEnds) -> LayerStyle:
    # A step of colour has the same length on both sides of zero, which lies between two steps. Each
    # side uses all its shades even if it is short, so thin walls stay red.
    step = (ends.far + ends.deep) / (FIELD_LEVELS - 1) or 1.0
    below = min(max(1, math.ceil(ends.deep / step - 1e-9)), FIELD_LEVELS - 1)
    scale = Scale(-below * step, (FIELD_LEVELS - below) * step, 0, FIELD_LEVELS)
    # The palest shade is left out, so that a side with one step is not white.
    inside = colours.interpolated(colours.OBSTACLE_ANCHORS, below + 1)[:0:-1]
    outside = colours.interpolated(colours.FREE_ANCHORS, FIELD_LEVELS - below + 1)[1:]
    known = np.vstack([inside, outside])
    special = [colours.LINE, colours.RVIZ_UNKNOWN]
    swatches = [Swatch(LINE, "obstacle edge")]
    bar = None
    if math.isfinite(ends.highest) and math.isfinite(ends.lowest):
        bar, more = _bar(scale, ends)
        swatches += [*more, Swatch(faded_index(below, outside=True), "unknown: faded")]
    else:
        free = Swatch(FIELD_LEVELS - 1, "+inf: no obstacle")
        swatches.append(free if ends.highest > 0 else Swatch(0, "-inf: nothing free"))
    if field.region is not None:
        swatches.append(Swatch(NOWHERE, "no distance"))
    return LayerStyle(
        colours.palette_of(known, colours.mixed(known, colours.RVIZ_UNKNOWN, 0.6), special),
        scale=scale, swatches=tuple(swatches), bar=bar, nowhere=NOWHERE, line=LINE,
        faded_by=FIELD_LEVELS,
    )  # fmt: skip


def faded_index(below: int, *, outside: bool) -> int:
    """Return a typical index of unknown cells, outside or inside obstacles."""
    return FIELD_LEVELS + (below + (FIELD_LEVELS - below) // 3 if outside else below // 2)


def _bar(scale: Scale, ends: FieldEnds) -> tuple[ColourBar, list[Swatch]]:
    """Return the bar, and legend entries for ends too close to zero for a label."""
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
        if all(abs(place - shown) >= _LEAST_GAP for shown, _ in ticks):
            ticks.append((place, f"{value:g}"))
    return ColourBar(range(FIELD_LEVELS), sorted(ticks), "distance, m"), swatches


_MOST_AREAS = 6  # cut-off areas that have a colour of their own
_LEAST_SHARE = 0.001  # of the open cells that such an area must have

# In order of precedence among the cells of a pixel.
UNKNOWN_CODE, _NARROW, _REACHED, _NO_TURN, _REACHED_UNKNOWN, _CUT_OFF = range(6)
_AREAS = range(_CUT_OFF + 1, _CUT_OFF + 1 + _MOST_AREAS)
_OBSTACLE = _AREAS.stop
CLOSED, TIGHT, START, ROBOT, GOAL, MISSED = range(_OBSTACLE + 1, _OBSTACLE + 7)
"""Palette indices of marks over the cells."""
_COLOURS = [
    colours.RVIZ_UNKNOWN, colours.TOO_NARROW, colours.REACHABLE, colours.NO_TURN,
    colours.REACHABLE_UNKNOWN, colours.CUT_OFF, *colours.CUT_OFF_AREAS, colours.RVIZ_OCCUPIED,
    colours.CLOSED_PASSAGE, colours.TIGHT_PASSAGE, colours.REACH_START, colours.ROBOT_OUTLINE,
    colours.GOAL_REACHED, colours.GOAL_MISSED,
]  # fmt: skip


def reach_codes(reach: Reach) -> tuple[Bytes, LayerStyle]:
    codes = _codes(reach)
    areas = _colour_areas(codes)
    counts = lookup.histogram(codes)  # after the areas have their own codes
    swatches, labels = [], {}
    names = [
        (_REACHED, f"reachable{', room to turn' if counts[_NO_TURN] else ''}"),
        (_NO_TURN, "reachable, no room to turn"), (_REACHED_UNKNOWN, "reachable, unknown"),
        *((code, "cut off") for code in _AREAS[:areas]),
        (_CUT_OFF, f"{'smaller' if areas else 'small'} cut-off areas"),
        (_NARROW, "no room for the robot"), (_OBSTACLE, "obstacle"), (UNKNOWN_CODE, "unknown"),
    ]  # fmt: skip
    for code, name in names:
        if counts[code]:
            labels[code] = name
            area = f" {area_text(int(counts[code]) * reach.cell_area)}"
            swatches.append(Swatch(code, name + area * (code not in (_OBSTACLE, UNKNOWN_CODE))))
    palette, by_value = colours.palette_of(_COLOURS), _codes_below(len(_COLOURS))
    return codes, LayerStyle(palette, by_value, swatches=tuple(swatches), labels=labels)


def area_text(area: float) -> str:
    return f"{area:.3g} m2" if area < 999.5 else f"{area:.0f} m2"


def _codes(reach: Reach) -> Bytes:
    code_of_byte = np.full(256, _NARROW, dtype=np.uint8)
    code_of_byte[values.OCCUPIED], code_of_byte[values.UNKNOWN] = _OBSTACLE, UNKNOWN_CODE
    codes = np.empty(reach.shape, dtype=np.uint8)
    occupancies = reach.occupancy.view(np.uint8)

    def fill(rows: slice) -> None:
        occupancy, headings, part = occupancies[rows], reach.headings[rows], codes[rows]
        np.take(code_of_byte, occupancy, out=part)
        is_reached = reach.reachable[rows] != 0
        part[(headings != 0) & ~is_reached] = _CUT_OFF
        part[is_reached] = _REACHED
        part[is_reached & (headings < reach.heading_count)] = _NO_TURN
        if reach.through_unknown:
            part[is_reached & (occupancy == code_of_byte.size + values.UNKNOWN)] = _REACHED_UNKNOWN

    threads.for_rows(fill, reach.shape)
    return codes


def _colour_areas(codes: Bytes) -> int:
    """Assign codes to the largest cut-off areas, in place; return their number."""
    counts = lookup.histogram(codes)
    if not counts[_CUT_OFF]:
        return 0
    areas = components.labelled(codes == _CUT_OFF, corners=False)
    sizes = areas.sizes
    least = _LEAST_SHARE * counts[[_REACHED, _NO_TURN, _REACHED_UNKNOWN, _CUT_OFF]].sum()
    order = np.argsort(-sizes, kind="stable")[:_MOST_AREAS]
    largest = [label for label in order.tolist() if sizes[label] >= max(least, 1)]
    code_of = np.full(len(sizes), _CUT_OFF, dtype=np.uint8)
    code_of[largest] = _AREAS[: len(largest)]

    def colour(rows: slice) -> None:
        part = codes[rows]
        np.copyto(part, code_of[areas.cells[rows]], where=part == _CUT_OFF)

    threads.for_rows(colour, codes.shape)
    return len(largest)
