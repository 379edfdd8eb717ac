"""What the picture of a cost curve shows: the zones of distances, and the marks between them."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.frame import RADIUS_TOLERANCE
from mapdeal.grid.values import INSCRIBED_INFLATED_OBSTACLE
from mapdeal.records import dataclass

_FAR = 2.5
"""Times everything else that a reach may be before it is left out of the picture."""

_FARTHEST = 1e9
"""Metres that a picture shows at most."""


class ZoneKind(Enum):
    """What holds in a zone, in words."""

    OBSTACLE = "obstacle"
    COLLISION = "collision at any heading"
    HEADING = "collision at some headings"
    CLEAR = "no collision, with a cost"
    FREE = "no collision, no cost"
    COST = "with a cost"
    NO_COST = "no cost"
    UNSEEN_COLLISION = "collision at any heading, no cost"
    UNSEEN_HEADING = "collision at some headings, no cost"


@dataclass(frozen=True)
class Zone:
    """Distances of which the same is true."""

    kind: ZoneKind
    start: float
    end: float
    costs: tuple[int, int] | None


def zones_of(curve: CostCurve, end: float) -> list[Zone]:
    """Return the zones of a curve, from the obstacle's cell up to `end` metres."""
    # Where the shape of the robot is not known, beyond the inscribed radius nothing is said of
    # collisions.
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
    # float32 resolutions may put a cell beyond the radius that it lies at on paper
    beyond = (curve.inscribed_radius or 0.0) + RADIUS_TOLERANCE
    np.maximum(distance, beyond, out=distance, where=curve.cost < INSCRIBED_INFLATED_OBSTACLE)
    inside = curve.cost[(distance > start) & (distance <= end)]
    if end > curve.reach:  # cells beyond the reach cost 0
        inside = np.append(inside, 0)
    return (int(inside.max()), int(inside.min())) if len(inside) else None


@dataclass(frozen=True)
class Mark:
    """A distance of note, in metres, and what to call it."""

    distance: float
    label: str


def described(zone: Zone, end: float) -> str:
    """Return how far a zone goes, and its costs; `end` is that of the picture."""
    if zone.kind is ZoneKind.OBSTACLE:
        return f"cost {zone.costs[0]}" if zone.costs else ""
    where = "beyond" if zone.end >= end else f"up to {zone.end:.4g} m"
    if zone.costs is None:
        return f"{where}: no cell"
    high, low = zone.costs
    return f"{where}: {high}" if high == low else f"{where}: {high} .. {low}"


def end_of(curve: CostCurve) -> float:
    """Return the metres at which the picture ends: beyond all that is of note, unless it is far."""
    near = max(
        curve.end,
        curve.inscribed_radius or 0.0,
        curve.circumscribed_radius or 0.0,
        2 * curve.resolution,
        *(metres for _, metres in curve.marks),
    )
    far = max(near, curve.reach, curve.inflation_radius or 0.0)
    shown = min(far if far <= _FAR * near else near, _FARTHEST)
    return 1.18 * shown + curve.resolution / 2


def marks_of(curve: CostCurve) -> list[Mark]:
    """Return the distances of note, near to far; radii that are the same share a mark."""
    marks = [Mark(metres, f"{name}: {metres:.4g} m") for name, metres in curve.marks]
    inscribed, circumscribed = curve.inscribed_radius, curve.circumscribed_radius
    if inscribed and circumscribed is not None and math.isclose(inscribed, circumscribed):
        marks.append(Mark(inscribed, f"inscribed and circumscribed radius: {inscribed:.4g} m"))
    else:
        if inscribed:
            marks.append(Mark(inscribed, f"inscribed radius: {inscribed:.4g} m"))
        if circumscribed is not None:
            text = f"circumscribed radius: {circumscribed:.4g} m"
            marks.append(Mark(circumscribed, text))
    inflation = curve.inflation_radius
    if inflation is None or math.isclose(inflation, curve.reach):
        name = "reach" if inflation is None else "inflation radius"
        marks.append(Mark(curve.reach, f"{name}: {_reach(curve)}"))
    else:
        marks.append(Mark(inflation, f"inflation radius: {inflation:.4g} m"))
        marks.append(Mark(curve.reach, f"reach: {_reach(curve)}"))
    return sorted(marks, key=lambda mark: mark.distance)


def _reach(curve: CostCurve) -> str:
    if not curve.reach_cells:
        return "0 m, no cost spreads"
    cells = "1 cell" if curve.reach_cells == 1 else f"{curve.reach_cells:.6g} cells"
    then = f", cost {curve.cost_at_reach}, then 0" if curve.cost_at_reach else ""
    return f"{curve.reach:.4g} m, {cells}{then}"
