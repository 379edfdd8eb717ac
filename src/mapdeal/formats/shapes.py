"""Shapes to draw, from a YAML or a GeoJSON file, in metres in the map frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.geojson import read_geojson
from mapdeal.formats.kinds import SHAPES, recognised
from mapdeal.formats.yaml_text import OF_SHAPES, Entry, read_mapping
from mapdeal.grid.coordinates import Point
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.spelling import as_known, meant

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
        shapes = read_geojson(path) if is_json else list(_shapes_of(path))
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
        rule = f"type must be one of {', '.join(_KEYS)}"
        raise (fields["type"] if kind else entry).error(rule)
    fields = _as_known(fields, kind)

    def required(key: str) -> Entry:
        if key not in fields:
            raise entry.error(f"a {kind} needs {key}")
        return fields[key]

    value = _whole(fields["value"]) if "value" in fields else None
    source = f"{entry.source}: {entry.place}"
    with _found_at(entry):
        if kind == "circle":
            center, radius = _point(required("center")), required("radius").number()
            return Circle(center, radius, value, source)
        points = _points(required("points"))
        if kind == "line":
            thickness = fields["thickness"].number() if "thickness" in fields else 0.0
            return Line(points, thickness, value, source)
        holes = fields["holes"].items() if "holes" in fields else []
        return Polygon(points, [_points(hole) for hole in holes], value, source)


def _as_known(fields: dict[str, Entry], kind: str) -> dict[str, Entry]:
    """Return the entries of a shape by the names that its keys are known by."""
    known = _KEYS[kind]
    named: dict[str, Entry] = {}
    for key, field in fields.items():
        name = as_known(key, known)
        if name not in known:
            rule, hint = f"unknown key of a {kind}", meant(key, known)
            raise MalformedInputError(rule, source=field.source, place=field.place, got=key,
                                      hint=hint or f"known: {', '.join(known)}")  # fmt: skip
        if name in named:
            raise field.error(f"is given twice, as {name} and as {key}")
        named[name] = field
    return named


def _points(entry: Entry) -> list[Point]:
    return [_point(item) for item in entry.items()]


def _point(entry: Entry) -> Point:
    numbers = entry.items()
    if len(numbers) != 2:
        raise entry.error("must be two numbers [x, y]")
    return numbers[0].number(), numbers[1].number()


def _whole(entry: Entry) -> int:
    number = entry.number()
    if number % 1:
        raise entry.error("must be a whole number")
    return int(number)


@contextmanager
def _found_at(entry: Entry) -> Iterator[None]:
    """Turn what is wrong with a shape into an error about its place in the file."""
    try:
        yield
    except ParameterError as error:
        raise error.in_file(entry.source, entry.place) from None
