"""Checks of what a robot of some size can reach in a map."""

from __future__ import annotations

from collections.abc import Iterator

from mapdeal.checks.check import check
from mapdeal.checks.facts import RoomFacts
from mapdeal.checks.finding import Remark, places_of

_ROOM = 4.0
"""Square metres of places for the robot's centre that are worth a warning: two metres by two. What
is smaller is a niche, a shaft, or the floor below a desk between the marks of its legs."""

_SHOWN, _MOST_PLACES = 10, 20


@check(
    "map.disconnected",
    "warning",
    "areas that only a passage too narrow for the robot joins; with a robot's shape alone",
)
def disconnected(facts: RoomFacts) -> Iterator[Remark]:
    """Look for the passages that cut a room or more off, the one that costs most first."""
    from mapdeal.grid.passages import disconnected as passages_between

    needed = 2 * facts.radius
    found = passages_between(facts.grid, facts.radius, _ROOM)
    found.sort(key=lambda one: -one.cut_off)
    for one in found[:_SHOWN]:
        x, y = round(one.x, 2) + 0.0, round(one.y, 2) + 0.0
        text = (
            f"{one.cut_off:.4g} m2 are cut off by a passage of {one.width:.3g} m at {x:.10g}, "
            f"{y:.10g}; the robot needs more than {needed:.3g} m"
        )
        yield Remark(text, places=places_of([(one.x, one.y)]))
    rest = found[_SHOWN:]
    if rest:
        text = f"{len(rest)} more passages cut off {rest[0].cut_off:.4g} m2 or less each"
        yield Remark(text, places=places_of((one.x, one.y) for one in rest[:_MOST_PLACES]))
