"""Shapes from GeoJSON (RFC 7946), its coordinates taken as metres in the map frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.formats.json_values import JsonValue, read_document
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape

_PARTS = {
    "MultiPolygon": "Polygon",
    "MultiLineString": "LineString",
    "MultiPoint": "Point",
}


def read_geojson(path: Path) -> list[Shape]:
    """Return the shapes of a GeoJSON file, in its order.

    A Polygon is one, its inner rings are holes; a LineString is a line with the thickness that
    property ``thickness`` says; a Point is a circle with the radius that property ``radius``
    says. Property ``value`` is what they are drawn with. Other properties mean nothing.
    """
    return geojson_shapes(read_document(path))


def geojson_shapes(document: JsonValue) -> list[Shape]:
    """Return the shapes of a document that was read already, as `read_geojson` does."""
    try:
        return _Reader(document.source).shapes(document.value)
    except RecursionError:
        raise MalformedInputError("nested too deep", source=document.source) from None


class _Reader:
    """Shapes from the nested parts of a file; errors name the file and the feature."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def error(self, rule: str, place: str, **more: object) -> MalformedInputError:
        return MalformedInputError(rule, source=self._path, place=place, **more)  # type: ignore[arg-type]

    def shapes(self, document: Any) -> list[Shape]:
        """Return all shapes of the file."""
        if not isinstance(document, dict):
            raise self.error("must be an object with a type", "the file")
        if document.get("type") != "FeatureCollection":
            return list(self.feature(document, "feature 1"))
        features = self._list(document.get("features"), "features")
        return [
            shape
            for index, feature in enumerate(features)
            for shape in self.feature(feature, f"feature {index + 1}")
        ]

    def feature(self, feature: Any, place: str) -> Iterator[Shape]:
        """Return the shapes of a Feature, or of a bare geometry."""
        if not isinstance(feature, dict):
            raise self.error("must be an object with a type", place)
        if feature.get("type") != "Feature":
            yield from self._geometry(feature, {}, place)
            return
        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise self.error("properties must be an object", place)
        if feature.get("geometry") is None:
            text = f"{self._path}: {place}: has no geometry, it was left out"
            emit_warning(text, stacklevel=2)
            return
        yield from self._geometry(feature["geometry"], properties, place)

    def _geometry(
        self, geometry: Any, properties: Mapping[str, Any], place: str
    ) -> Iterator[Shape]:
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind == "GeometryCollection":
            for part in self._list(geometry.get("geometries"), f"{place}: geometries"):
                yield from self._geometry(part, properties, place)
            return
        if not isinstance(kind, str) or kind not in (*_PARTS, *_PARTS.values()):
            kinds = ("Feature", *_PARTS.values(), *_PARTS, "GeometryCollection")
            rule = f"type must be one of {', '.join(kinds)}"
            raise self.error(rule, place, got=kind)
        coordinates = self._list(geometry.get("coordinates"), f"{place}: coordinates")
        for part in coordinates if kind in _PARTS else [coordinates]:
            yield self._shape(_PARTS.get(kind, kind), part, properties, place)

    def _shape(self, kind: str, part: Any, properties: Mapping[str, Any], place: str) -> Shape:
        value = self._number(properties, "value", place)
        if value is not None and value % 1:
            raise self.error("must be a whole number", f"{place}: value", got=value)
        whole = None if value is None else int(value)
        source = f"{self._path}: {place}"
        try:
            if kind == "Polygon":
                rings = [
                    self._ring(ring, f"{place}: ring {index + 1}")
                    for index, ring in enumerate(self._list(part, place))
                ]
                if not rings:
                    raise self.error("a Polygon needs a ring of coordinates", place)
                return Polygon(rings[0], rings[1:], whole, source)
            if kind == "LineString":
                thickness = self._number(properties, "thickness", place) or 0.0
                return Line(self._points(part, place), thickness, whole, source)
            radius = self._number(properties, "radius", place)
            if radius is None:
                rule = "a Point needs a property radius, in metres, to be a circle"
                raise self.error(rule, place)
            return Circle(self._points([part], place)[0], radius, whole, source)
        except ParameterError as error:
            raise error.in_file(self._path, place) from None

    def _ring(self, ring: Any, place: str) -> list[Any]:
        points = self._points(ring, place)
        closed = len(points) > 1 and points[0] == points[-1]
        return points[:-1] if closed else points

    def _points(self, points: Any, place: str) -> list[Any]:
        """Return pairs of numbers; a height behind them is left out."""
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
