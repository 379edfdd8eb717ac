"""Files of shapes, and zones for costmap filters: shapes with a kind, and masks drawn from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal import errors, records
from mapdeal.errors import MalformedInputError, ParameterError, as_known, emit_warning, nearest_hint
from mapdeal.files.json_values import JsonValue, read_document
from mapdeal.files.yaml_text import OF_SHAPES, Entry, read_mapping
from mapdeal.grid import frame, occupancy
from mapdeal.grid.bit_map import blank, draw
from mapdeal.grid.filters import KINDS, FilterInfo, FilterKind, SpeedUnit, info_for
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.maps.kinds import SHAPES, recognised

_PARTS = {"MultiPolygon": "Polygon", "MultiLineString": "LineString", "MultiPoint": "Point"}


def geojson_shapes(document: JsonValue) -> list[Shape]:
    # The inner rings of a Polygon are holes; a LineString is a line with the thickness in property
    # ``thickness``; a Point is a circle with the radius in property ``radius``. Shapes are drawn
    # with the value in property ``value``. Other properties are ignored.
    return [shape for _, shapes in geojson_features(document) for shape in shapes]


def geojson_features(document: JsonValue) -> list[tuple[Mapping[str, Any], list[Shape]]]:
    try:
        return _Reader(document.source).features(document.value)
    except RecursionError:
        raise MalformedInputError("nested too deep", source=document.source) from None


class _Reader:
    """Reader of the nested parts of a GeoJSON file; errors name the file and the feature."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def error(self, rule: str, place: str, **more: object) -> MalformedInputError:
        return MalformedInputError(rule, source=self._path, place=place, **more)  # type: ignore[arg-type]

    def features(self, document: Any) -> list[tuple[Mapping[str, Any], list[Shape]]]:
        if not isinstance(document, dict):
            raise self.error("must be an object with a type", "the file")
        if document.get("type") != "FeatureCollection":
            return [self._feature(document, "feature 1")]
        features = self._list(document.get("features"), "features")
        return [self._feature(item, f"feature {k}") for k, item in enumerate(features, 1)]

    def _feature(self, feature: Any, place: str) -> tuple[Mapping[str, Any], list[Shape]]:
        if not isinstance(feature, dict):
            raise self.error("must be an object with a type", place)
        if feature.get("type") != "Feature":
            return {}, list(self._geometry(feature, {}, place))
        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise self.error("properties must be an object", place)
        if feature.get("geometry") is None:
            emit_warning(f"{self._path}: {place}: has no geometry, it was left out")
            return properties, []
        return properties, list(self._geometry(feature["geometry"], properties, place))

    def _geometry(self, geometry: Any, properties: dict[str, Any], place: str) -> Iterator[Shape]:
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind == "GeometryCollection":
            for part in self._list(geometry.get("geometries"), f"{place}: geometries"):
                yield from self._geometry(part, properties, place)
            return
        if not isinstance(kind, str) or kind not in (*_PARTS, *_PARTS.values()):
            kinds = ("Feature", *_PARTS.values(), *_PARTS, "GeometryCollection")
            raise self.error(f"type must be one of {', '.join(kinds)}", place, got=kind)
        coordinates = self._list(geometry.get("coordinates"), f"{place}: coordinates")
        for part in coordinates if kind in _PARTS else [coordinates]:
            yield self._shape(_PARTS.get(kind, kind), part, properties, place)

    def _shape(self, kind: str, part: Any, properties: Mapping[str, Any], place: str) -> Shape:
        value = self._number(properties, "value", place)
        if value is not None and value % 1:
            raise self.error("must be a whole number", f"{place}: value", got=value)
        cell_value = None if value is None else int(value)
        source = f"{self._path}: {place}"
        try:
            if kind == "Polygon":
                numbered = enumerate(self._list(part, place), 1)
                rings = [self._ring(ring, f"{place}: ring {number}") for number, ring in numbered]
                if not rings:
                    raise self.error("a Polygon needs a ring of coordinates", place)
                return Polygon(rings[0], rings[1:], cell_value, source)
            if kind == "LineString":
                thickness = self._number(properties, "thickness", place) or 0.0
                return Line(self._points(part, place), thickness, cell_value, source)
            if (radius := self._number(properties, "radius", place)) is None:
                rule = "a Point needs a property radius, in metres, to be a circle"
                raise self.error(rule, place)
            return Circle(self._points([part], place)[0], radius, cell_value, source)
        except ParameterError as error:
            raise error.in_file(self._path, place) from None

    def _ring(self, ring: Any, place: str) -> list[Any]:
        points = self._points(ring, place)
        return points[:-1] if len(points) > 1 and points[0] == points[-1] else points

    def _points(self, points: Any, place: str) -> list[Any]:
        found = []
        for index, point in enumerate(self._list(points, place)):
            numbers = point if isinstance(point, list) else []
            if len(numbers) not in (2, 3) or not all(_is_number(v) for v in numbers):
                rule = "must be two numbers [x, y]"
                raise self.error(rule, f"{place}: position {index + 1}", got=point)
            found.append(tuple(numbers[:2]))
        return found

    def _number(self, properties: Mapping[str, Any], name: str, place: str) -> float | None:
        value = properties.get(name)
        if value is not None and not _is_number(value):
            raise self.error("must be a number", f"{place}: {name}", got=value)
        return value

    def _list(self, value: Any, place: str) -> list[Any]:
        if not isinstance(value, list):
            raise self.error("must be a list", place, got=value)
        return value


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


_KEYS = {
    "polygon": ("type", "points", "holes", "value"),
    "line": ("type", "points", "thickness", "value"),
    "circle": ("type", "center", "radius", "value"),
}
_FORM = "a file of shapes has a list: shapes: [{type: polygon, points: [[x, y], ...]}, ...]"


def read_shapes(path: Path | str) -> list[Shape]:
    """Read the shapes in a file, in order.

    Parameters
    ----------
    path : path or str
        A GeoJSON file (``.json`` or ``.geojson``), or a YAML file with a list ``shapes``. Each
        item has ``type: polygon``, ``points`` and optionally ``holes``; ``type: line``,
        ``points`` and optionally ``thickness``; or ``type: circle``, ``center`` and ``radius``.
        Each may have a ``value``. Lengths are in metres, points are [x, y] in the map frame.

    Returns
    -------
    list of Polygon, Line or Circle
        The shapes, with their values.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If the file is malformed or contains no shape; the error names the shape and the line.
    """
    path = Path(path)
    with recognised(path, "a file of shapes", SHAPES):
        is_json = path.suffix.lower() in (".json", ".geojson")
        shapes = geojson_shapes(read_document(path)) if is_json else list(_shapes_of(path))
    if not shapes:
        raise MalformedInputError("holds no shape", source=path)
    return shapes


def _shapes_of(path: Path) -> Iterator[Shape]:
    try:
        entries = read_mapping(path, OF_SHAPES)
    except MalformedInputError as error:
        error.hint = _FORM
        raise
    if "shapes" not in entries:
        raise MalformedInputError("missing key shapes", source=path, hint=_FORM)
    for key, entry in entries.items():
        if key != "shapes":
            raise entry.error("unknown key: a file of shapes has only shapes")
    for index, entry in enumerate(entries["shapes"].items()):
        yield _shape_of(Entry(path, f"shape {index + 1}", entry.node))


def _shape_of(entry: Entry) -> Shape:
    fields = entry.fields()
    kind = fields["type"].text() if "type" in fields else None
    if kind not in _KEYS:
        raise (fields["type"] if kind else entry).error(f"type must be one of {', '.join(_KEYS)}")
    fields = _with_known_keys(fields, kind)

    def required(key: str) -> Entry:
        if key not in fields:
            raise entry.error(f"a {kind} needs {key}")
        return fields[key]

    value = _whole_number(fields["value"]) if "value" in fields else None
    source = f"{entry.source}: {entry.place}"
    try:
        if kind == "circle":
            center, radius = _point(required("center")), required("radius").number()
            return Circle(center, radius, value, source)
        points = list(map(_point, required("points").items()))
        if kind == "line":
            thickness = fields["thickness"].number() if "thickness" in fields else 0.0
            return Line(points, thickness, value, source)
        holes = fields["holes"].items() if "holes" in fields else []
        return Polygon(points, [list(map(_point, hole.items())) for hole in holes], value, source)
    except ParameterError as error:
        raise error.in_file(entry.source, entry.place) from None


def _with_known_keys(fields: dict[str, Entry], kind: str) -> dict[str, Entry]:
    """Return the entries of a shape, with spelling variants of keys replaced by the known keys."""
    known = _KEYS[kind]
    named: dict[str, Entry] = {}
    for key, field in fields.items():
        name = as_known(key, known)
        if name not in known:
            rule = f"unknown key of a {kind}"
            hint = nearest_hint(key, known) or f"known: {', '.join(known)}"
            raise MalformedInputError(rule, source=field.source, place=field.place, got=key,
                                      hint=hint)  # fmt: skip
        if name in named:
            raise field.error(f"is given twice, as {name} and as {key}")
        named[name] = field
    return named


def _point(entry: Entry) -> frame.Point:
    numbers = entry.items()
    if len(numbers) != 2:
        raise entry.error("must be two numbers [x, y]")
    return numbers[0].number(), numbers[1].number()


def _whole_number(entry: Entry) -> int:
    number = entry.number()
    if number % 1:
        raise entry.error("must be a whole number")
    return int(number)


@records.dataclass(frozen=True)
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
        return [s if own and s.value else records.replace(s, value=value) for s in self.shapes]

    def is_near(self, xy: frame.Point, margin: float) -> bool:
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
        hint = "or choose one with --kind" if kind is None else nearest_hint(str(kind), KINDS)
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
    grid: occupancy.OccupancyGrid, kind: FilterKind, zones: Sequence[Zone], *,
    unit: SpeedUnit = "percent", base: float | None = None, multiplier: float | None = None,
) -> tuple[occupancy.OccupancyGrid, FilterInfo]:  # fmt: skip
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
    return occupancy.OccupancyGrid(values, grid.resolution, grid.origin), info


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


def name_at(zones: Sequence[Zone], grid: occupancy.OccupancyGrid, xy: frame.Point) -> str | None:
    row, col = grid.frame.unbounded_rowcol_from_xy([xy])[0].tolist()
    margin = 3 * grid.resolution  # a drawn cell may lie beyond the shape by its own diagonal
    for zone in (zone for zone in zones if zone.is_near(xy, margin)):
        with errors.capture_warnings():  # drawing the mask has already emitted these
            drawn = draw(blank(grid, FREE), zone.shapes_with(OCCUPIED)).occupancy
        if drawn[row, col]:
            return zone.name
    return None
