"""Content of a report: maps with their layers, and results about them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, get_args

import numpy as np

from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.field import DistanceField, FieldView, PotentialField
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import CloudLayers, OccupancyGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.values import FREE, OCCUPIED, Convention
from mapdeal.kernels import arrays, outlines
from mapdeal.kernels.blocks import Layer, counts_of, mapped
from mapdeal.pictures import colours, styles
from mapdeal.pictures.styles import FieldEnds
from mapdeal.records import dataclass, field, replace

# Severity of an item: its colour on the page, never the only sign of it.
Tone = Literal["error", "warning", "note", "good", "plain"]

ItemKind = Literal[
    "finding", "passage", "start", "goal", "route", "trajectory", "graph", "shape", "added",
    "removed", "closed", "opened", "unknown", "known", "rose", "fell",
]  # fmt: skip

# What a claim comes to, the worst first; unknown if nobody has looked.
State = Literal["error", "warning", "unknown", "good"]
About = Literal["run", "map", "costmap", "goals", "obstacles", "cells", "geometry"]
MAP = "map"  # the ending of the name of a layer with the map that a field was made of


@dataclass(frozen=True)
class Claim:
    """One sentence of a verdict; `evidence` is the kind of items, or the table, that shows why."""

    about: About
    state: State
    text: str
    evidence: str = ""


def worst_of(states: Iterable[State]) -> State | None:
    return min(states, key=get_args(State).index, default=None)


@dataclass(frozen=True, eq=False)
class PageLayer:
    name: str
    title: str
    frame: Frame
    values: Layer  # uint8 or float32, of the shape of the frame
    style: colours.LayerStyle
    unit: str = ""
    pooled: Literal["largest", "smallest"] = "largest"
    rank: arrays.Bytes | None = None
    states: str | None = None
    convention: Convention | None = None
    lethal_threshold: int = 100
    strength: float = 1.0

    @property
    def is_bytes(self) -> bool:
        return bool(self.values.dtype == np.uint8)


@dataclass(frozen=True)
class Zone:
    kind: str
    speed: float | None = None  # percent of the robot's maximum
    name: str = ""


@dataclass(frozen=True, eq=False)
class Item:
    """Something to be listed beside the map and, if it has a place, to be shown on it."""

    # Items of one kind and `group` are one line of the list, which opens to show each of them.
    kind: ItemKind
    text: str
    tone: Tone = "plain"
    place: tuple[float, float] | None = None
    lines: tuple[arrays.Floats, ...] = ()
    label: str = ""
    group: str = ""
    zone: Zone | None = None


@dataclass(frozen=True)
class Table:
    title: str
    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class Entry:
    name: str
    layers: tuple[PageLayer, ...] = ()
    items: tuple[Item, ...] = ()
    tables: tuple[Table, ...] = ()
    warnings: tuple[str, ...] = ()
    status: str = ""
    figures: Mapping[str, str | float] = field(default_factory=dict)
    curve: CostCurve | None = None
    compared: tuple[str, str] | None = None
    extent: tuple[float, float, float, float] | None = None
    claims: tuple[Claim, ...] = ()
    opens_swiped: bool = True  # where two layers are compared
    next_command: str = ""  # as it is typed
    is_sequence: bool = False  # whether the layers are one grid at several times


@dataclass(frozen=True)
class Verdict:
    name: str
    state: State
    claims: tuple[Claim, ...]
    next_command: str = ""


@dataclass(frozen=True, eq=False)
class Report:
    title: str
    entries: tuple[Entry, ...]
    version: str


@dataclass(frozen=True)
class LayerKind:
    ending: str
    title: str
    values: Callable[[Any], Layer]
    about: Callable[[Any], dict[str, Any]]

    def of(self, grid: Any, name: str, title: str) -> PageLayer:
        about = self.about(grid)
        about["style"] = _without_unused_swatches(about["style"])  # pages do not draw over them
        made_of = isinstance(grid, (DistanceField, PotentialField)) and self.ending != MAP
        states = f"{name}-{MAP}" if made_of else None
        if self.ending:
            name, title = f"{name}-{self.ending}", f"{title}: {self.title}"
        return PageLayer(name, title, grid.frame, self.values(grid), states=states, **about)


def kinds_of(grid: Any) -> tuple[LayerKind, ...]:
    return _KINDS[type(grid)]


def page_layers(grid: Any, name: str, title: str) -> list[PageLayer]:
    return [kind.of(grid, name, title) for kind in kinds_of(grid)]


def _without_unused_swatches(style: colours.LayerStyle) -> colours.LayerStyle:
    used: set[int | None] = set() if style.by_value is None else set(style.by_value.tolist())
    if style.scale is not None:
        levels = range(style.scale.first, style.scale.first + style.scale.levels)
        used = {*levels, style.nowhere, style.line}
        used |= {level + style.faded_by for level in levels if style.faded_by is not None}
    return replace(style, swatches=tuple(shown for shown in style.swatches if shown.index in used))


def _as_bytes(layer: Layer) -> Layer:
    return mapped(layer, np.uint8, lambda values: values.view(np.uint8))


# Where cells share a pixel, the rank of each value: unknown, 255, shows last.
_ABOVE_UNKNOWN = (np.arange(256) + 1).astype(np.uint8)
_ABOVE_UNKNOWN.flags.writeable = False


def _map_of(grid: Any) -> dict[str, Any]:
    threshold = getattr(grid, "lethal_threshold", OCCUPIED)
    style = styles.occupancy_style()
    if not counts_of(grid.occupancy)[FREE + 1 : OCCUPIED].any():  # black and white need no scale
        style = replace(style, bar=None)
    return {"style": style, "rank": _ABOVE_UNKNOWN, "lethal_threshold": threshold}


def _cost(costmap: Costmap) -> dict[str, Any]:
    return {"style": styles.cost_style(costmap), "rank": _ABOVE_UNKNOWN}


def _field(field: DistanceField) -> dict[str, Any]:
    return {
        "style": styles.field_style(field, FieldEnds.of(field)), "unit": "m", "pooled": "smallest",
        "convention": field.convention, "lethal_threshold": field.lethal_threshold,
        "strength": field.strength,
    }  # fmt: skip


def _potential(field: PotentialField) -> dict[str, Any]:
    return {"style": replace(styles.potential_style(field), line=styles.POTENTIAL_OBSTACLE)}


def _numbers(name: str, title: str, unit: str = "m", *, is_from_0: bool = True) -> LayerKind:
    def values(grid: Any) -> Layer:
        return np.asarray(getattr(grid, name), np.float32)

    def about(grid: Any) -> dict[str, Any]:
        finite = values(grid)[np.isfinite(values(grid))]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        return {"style": styles.number_style(0.0 if is_from_0 else low, high, unit), "unit": unit}

    return LayerKind(name, title, values, about)


_OCCUPANCY = LayerKind("", "", lambda grid: _as_bytes(grid.occupancy), _map_of)
_ITS_MAP = LayerKind(MAP, "its map", lambda grid: _as_bytes(grid.occupancy), _map_of)
_KINDS: dict[type[Any], tuple[LayerKind, ...]] = {
    OccupancyGrid: (_OCCUPANCY,),
    FieldView: (_OCCUPANCY,),
    Costmap: (LayerKind("", "", lambda costmap: _as_bytes(costmap.cost), _cost),),
    DistanceField: (_ITS_MAP, LayerKind("", "", lambda field: field.distance, _field)),
    PotentialField: (
        _ITS_MAP,
        LayerKind("", "", lambda field: field.normalised.astype(np.float32), _potential),
    ),
    CloudLayers: (
        _ITS_MAP, _numbers("points", "points", "points"), _numbers("slope", "slope", "m/m"),
        _numbers("obstacle_height", "highest obstacle"),
        _numbers("floor_height", "floor height", is_from_0=False),
    ),
    Reach: (
        _numbers("clearance", "distance to the nearest obstacle"),
        _numbers("widest", "radius of the largest round robot that gets here"),
        LayerKind(
            "", "", lambda reach: styles.reach_codes(reach)[0],
            lambda reach: {"style": styles.reach_codes(reach)[1]},
        ),
    ),
}  # fmt: skip


def outlines_of(cells: arrays.Integers, frame: Frame) -> list[arrays.Floats]:
    """Return the borders of cells, shape (N, 2), each line closed, corners in metres."""
    low = cells.min(axis=0)
    marked = np.zeros(tuple(cells.max(axis=0) - low + 1), dtype=np.bool_)
    marked[tuple((cells - low).T)] = True
    found = outlines.outlines(marked, 0.0)
    points = frame.xy_from_continuous_rowcol(found.corners + low)
    return [np.vstack([line, line[:1]]) for line in np.split(points, found.ring_ends[:-1])]
