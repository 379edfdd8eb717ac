"""What each cell is to a robot that goes through a map, and the colours of that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.reach import Reach
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import for_rows
from mapdeal.render import colours
from mapdeal.render.style import LayerStyle, Swatch

_MOST_AREAS = 6
"""Cut-off areas that have a colour of their own."""
_LEAST_SHARE = 0.001
"""Of the open cells: what such an area must have."""

# In the order in which the cells that share a pixel take precedence.
_UNKNOWN, _NARROW, _REACHED, _NO_TURN, _REACHED_UNKNOWN, _CUT_OFF = range(6)
UNKNOWN_CODE = _UNKNOWN
_AREAS = range(_CUT_OFF + 1, _CUT_OFF + 1 + _MOST_AREAS)
_OBSTACLE = _AREAS.stop
CLOSED, TIGHT, START, ROBOT, GOAL, MISSED = range(_OBSTACLE + 1, _OBSTACLE + 7)
"""Palette indices of what is drawn over the cells."""

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


def reach_codes(reach: Reach) -> tuple[NDArray[np.uint8], LayerStyle]:
    codes = _codes(reach)
    areas = _colour_areas(codes)
    counts = histogram(codes)
    by_value = np.zeros(256, dtype=np.uint8)
    by_value[: len(_COLOURS)] = np.arange(len(_COLOURS))
    turns = bool(counts[_NO_TURN])
    style = LayerStyle(
        np.array(_COLOURS, dtype=np.uint8),
        by_value=by_value,
        swatches=tuple(_swatches(counts, areas, reach.cell_area)),
        labels={code: name for code, name, _ in _names(areas, turns) if counts[code]},
    )
    return codes, style


def area_text(area: float) -> str:
    """Return square metres in three digits, or as many as there are before the point."""
    return f"{area:.3g} m2" if area < 999.5 else f"{area:.0f} m2"


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


def _colour_areas(codes: NDArray[np.uint8]) -> int:
    """Give the largest cut-off areas codes of their own, in place; return how many."""
    counts = histogram(codes)
    if not counts[_CUT_OFF]:
        return 0
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
    return len(largest)


def _names(areas: int, turns: bool) -> list[tuple[int, str, bool]]:
    room = ", room to turn" if turns else ""
    smaller = "smaller" if areas else "small"
    return [
        (_REACHED, f"reachable{room}", True),
        (_NO_TURN, "reachable, no room to turn", True),
        (_REACHED_UNKNOWN, "reachable, unknown", True),
        *((code, "cut off", True) for code in _AREAS[:areas]),
        (_CUT_OFF, f"{smaller} cut-off areas", True),
        (_NARROW, "no room for the robot", True),
        (_OBSTACLE, "obstacle", False),
        (_UNKNOWN, "unknown", False),
    ]


def _swatches(counts: NDArray[np.integer], areas: int, cell_area: float) -> list[Swatch]:
    return [
        Swatch(code, f"{name} {area_text(int(counts[code]) * cell_area)}" if is_area else name)
        for code, name, is_area in _names(areas, bool(counts[_NO_TURN]))
        if counts[code]
    ]
