"""Zones for costmap filters: GeoJSON features with a kind, and masks drawn from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal import errors
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.json_values import read_document
from mapdeal.grid.bit_map import blank, draw
from mapdeal.grid.filters import KINDS, FilterInfo, FilterKind, SpeedUnit, info_for
from mapdeal.grid.frame import Point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.shapes import Circle, Line, Shape
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.maps.kinds import SHAPES, recognised
from mapdeal.maps.shapes import geojson_features
from mapdeal.records import dataclass, replace


@dataclass(frozen=True)
class Zone:
    """A zone of a costmap filter: its shapes in the map frame, and its speed limit."""

    name: str
    kind: FilterKind
    shapes: tuple[Shape, ...]
    speed: float | None = None
    source: str = ""

    def shapes_with(self, value: int) -> list[Shape]:
        """Return the shapes with a value; shapes of keepout zones may have a cost of their own."""
        own = self.kind == "keepout"
        return [s if own and s.value else replace(s, value=value) for s in self.shapes]

    def is_near(self, xy: Point, margin: float) -> bool:
        """Return whether a point lies in the box of a shape, or within a margin in metres of it."""
        for shape in self.shapes:
            points = [shape.center_xy] if isinstance(shape, Circle) else shape.points_xy
            radius = shape.radius if isinstance(shape, Circle) else 0.0
            reach = margin + (shape.thickness if isinstance(shape, Line) else radius)
            sides = zip(zip(*points, strict=True), xy, strict=True)
            if all(min(side) - reach <= place <= max(side) + reach for side, place in sides):
                return True
        return False


def read_zones(path: Path, kind: FilterKind | None = None) -> list[Zone]:
    """Read zones from GeoJSON: features with the properties ``kind``, ``name`` and ``speed``."""
    # Features without a kind count as the requested one; by default all kinds are returned.
    with recognised(path, "a file of zones", SHAPES):
        features = geojson_features(read_document(path))
    numbered = enumerate(features, 1)
    zones = [_zone(path, number, *feature, kind) for number, feature in numbered if feature[1]]
    if not (found := [zone for zone in zones if kind in (None, zone.kind)]):
        rule = "holds no zone" if kind is None else f"holds no {kind} zone"
        kinds = ", ".join(dict.fromkeys(zone.kind for zone in zones))
        hint = f"its zones are of the kind {kinds}" if kinds else None
        raise MalformedInputError(rule, source=path, hint=hint)
    return found


def _zone(
    path: Path, number: int, properties: Mapping[str, Any], shapes: Sequence[Shape],
    default_kind: FilterKind | None,
) -> Zone:  # fmt: skip
    name = properties.get("name")
    name = f"zone {number}" if name in (None, "") else str(name)
    place = f"feature {number} ({name})"
    speed, kind = properties.get("speed"), properties.get("kind")
    if kind is None:
        kind = "speed" if speed is not None else default_kind
    if kind not in KINDS:
        rule = f"needs a property kind: {', '.join(KINDS)}"
        hint = (
            "or choose one with --kind" if kind is None else errors.nearest_hint(str(kind), KINDS)
        )
        raise MalformedInputError(rule, source=path, place=place, got=kind, hint=hint)
    if kind == "speed":
        speed = _speed(path, place, speed)
    return Zone(name, kind, tuple(shapes), speed if kind == "speed" else None, f"{path}: {place}")


def _speed(path: Path, place: str, speed: object) -> float:
    if isinstance(speed, bool) or not isinstance(speed, int | float):
        rule = "a speed zone needs a property speed, a number"
        raise MalformedInputError(rule, source=path, place=place, got=speed)
    if not speed > 0:
        rule = "speed must be above 0: to Nav2, 0 is no limit"
        hint = "a zone that nobody may enter is of the kind keepout"
        raise MalformedInputError(rule, source=path, place=place, got=speed, hint=hint)
    return float(speed)


def filter_mask(
    grid: OccupancyGrid, kind: FilterKind, zones: Sequence[Zone], *,
    unit: SpeedUnit = "percent", base: float | None = None, multiplier: float | None = None,
) -> tuple[OccupancyGrid, FilterInfo]:  # fmt: skip
    """Return the mask of zones of one kind on a map's cells, and how the filter reads it."""
    # Outside of the zones the mask is 0, or for keepout -1: 0 would make unknown cells free.
    speeds = [zone.speed for zone in zones if zone.speed is not None]
    info = info_for(kind, speeds, unit=unit, base=base, multiplier=multiplier)
    shapes = [shape for zone in zones for shape in zone.shapes_with(_value_of(zone, info))]
    # Where zones overlap the lower limit counts: the smaller value, if values grow with speed.
    is_reversed = kind == "speed" and info.multiplier > 0
    values = draw(blank(grid, UNKNOWN), shapes, overlay="min" if is_reversed else "max").occupancy
    if kind != "keepout":
        values = np.where(values == UNKNOWN, np.int8(FREE), values)
    return OccupancyGrid(values, grid.resolution, grid.origin), info


def _value_of(zone: Zone, info: FilterInfo) -> int:
    if zone.speed is None:
        return OCCUPIED
    if info.unit == "percent" and zone.speed == OCCUPIED and info.base == OCCUPIED:
        emit_warning(f"{zone.source}: speed 100 % is no limit")
        return FREE
    try:
        value, is_exact = info.value_of(zone.speed)
    except ParameterError as error:
        raise error.found_in(zone.source) from None
    if not is_exact:
        limit = info.base + value * info.multiplier
        text = f"{zone.source}: speed {zone.speed:g} becomes {limit:.6g} {info.sign}"
        emit_warning(f"{text}, the next lower value of the mask")
    return value


def name_at(zones: Sequence[Zone], grid: OccupancyGrid, xy: Point) -> str | None:
    row, col = grid.frame.unbounded_rowcol_from_xy([xy])[0].tolist()
    margin = 3 * grid.resolution  # a drawn cell may lie beyond the shape by its own diagonal
    for zone in (zone for zone in zones if zone.is_near(xy, margin)):
        with errors.capture_warnings():  # drawing the mask has already emitted these
            drawn = draw(blank(grid, FREE), zone.shapes_with(OCCUPIED)).occupancy
        if drawn[row, col]:
            return zone.name
    return None
