"""JSON documents of mapdeal: writing, checked reading, and recognition of their kinds."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.files.source import OF_JSON, claim, read_file
from mapdeal.grid.frame import FARTHEST, Point
from mapdeal.records import dataclass

T = TypeVar("T")
_LARGEST_FILE = 1 << 22  # a manifest has some kilobytes


def encode_json(value: Any) -> bytes:
    """Return `value` as indented JSON in UTF-8; it must not hold nan or infinity."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    try:
        return f"{text}\n".encode()
    except UnicodeEncodeError:  # a file name that is not UTF-8
        return f"{json.dumps(value, indent=2, allow_nan=False)}\n".encode()


def read_json(
    path: Path, *, limit: int = _LARGEST_FILE, parse_float: Callable[[str], Any] | None = None
) -> Any:
    """Return the value in a JSON file, or None if there is none, or it is damaged or too large."""
    try:
        data = read_file(path, limit=limit)
    except (FileAccessError, MalformedInputError):
        return None
    claim(path, OF_JSON * len(data))
    try:
        return json.loads(data, parse_constant=_refuse_constant, parse_float=parse_float or _finite)
    # ValueError: numbers of many thousand digits, and text in another encoding than UTF-8
    except (ValueError, RecursionError):
        return None


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):  # JSON could not represent it
        raise ValueError(f"{text} is too large")
    return value


def finite_or_text(text: str) -> float | str:
    """Return a JSON number, or its text if it is too large to be written as a number again."""
    value = float(text)
    return value if math.isfinite(value) else text


LARGEST_DOCUMENT = 1 << 26
_LARGEST_INTEGER = 1 << 53  # the largest up to which floats are exact in all readers of JSON


@dataclass(frozen=True, eq=False)
class JsonValue:
    source: Path
    value: Any
    place: str = ""

    def error(self, rule: str) -> MalformedInputError:
        place = self.place or "the document"
        return MalformedInputError(rule, source=self.source, place=place, got=self.value)

    def __getitem__(self, key: str) -> JsonValue:
        if (value := self.get(key)) is None:
            rule = f"must have a key {key}"
            raise MalformedInputError(rule, source=self.source, place=self.place or "the document")
        return value

    def get(self, key: str) -> JsonValue | None:
        fields = self._fields()
        place = f"{self.place}.{key}" if self.place else key
        return JsonValue(self.source, fields[key], place) if key in fields else None

    def optional(self, key: str, read: Callable[[JsonValue], T]) -> T | None:
        """Read the value of a key; None if it is missing or null."""
        value = self.get(key)
        return None if value is None else value.or_none(read)

    def items_of(self, key: str) -> list[JsonValue]:
        return self.optional(key, JsonValue.items) or []

    def fields(self) -> dict[str, JsonValue]:
        return {key: self[key] for key in self._fields()}

    def items(self) -> list[JsonValue]:
        source, place, values = self.source, self.place, self._value_of(list, "a list")
        return [JsonValue(source, item, f"{place}[{k}]") for k, item in enumerate(values)]

    @property
    def is_null(self) -> bool:
        return self.value is None

    def or_none(self, read: Callable[[JsonValue], T]) -> T | None:
        return None if self.is_null else read(self)

    def number(self, *, least: float = -FARTHEST, most: float = FARTHEST) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error("must be a number")
        if not least <= self.value <= most:
            raise self.error(f"must be a number from {least:g} to {most:g}")
        return float(self.value)

    def number_or(self, default: float) -> float:
        return default if self.is_null else self.number(least=0.0)

    def integer(self, least: int = 0, most: int = _LARGEST_INTEGER) -> int:
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self.error("must be a whole number")
        if not least <= self.value <= most:
            raise self.error(f"must be a whole number from {least} to {most}")
        return self.value

    def flag(self) -> bool:
        return self._value_of(bool, "true or false")

    def text(self) -> str:
        return self._value_of(str, "a text")

    def word(self, *allowed: str) -> str:
        if (text := self.text()) not in allowed:
            raise self.error(f"must be one of {', '.join(allowed)}")
        return text

    def sha256(self) -> str:
        text = self.text()
        if len(text) != 64 or not set(text) <= set("0123456789abcdef"):
            raise self.error("must be the 64 hexadecimal digits of a sha256")
        return text

    def json_text(self) -> str:
        return json.dumps(self.value, ensure_ascii=False)

    def point(self) -> Point:
        """Return the two numbers of {"x": x, "y": y} or [x, y], metres."""
        if isinstance(self.value, dict):
            return self["x"].number(), self["y"].number()
        numbers = self.items()
        if len(numbers) != 2:
            raise self.error('must be {"x": x, "y": y} or two numbers [x, y]')
        return numbers[0].number(), numbers[1].number()

    def points(self) -> NDArray[np.float64]:
        """Return a list of points [x, y] as an array, shape (N, 2), metres."""
        return np.array([item.point() for item in self.items()], dtype=np.float64).reshape(-1, 2)

    def _fields(self) -> dict[str, Any]:
        return self._value_of(dict, "an object")

    def _value_of(self, kind: type[T], noun: str) -> T:
        if not isinstance(self.value, kind):
            raise self.error(f"must be {noun}")
        return self.value


def point_document(point: Iterable[float]) -> dict[str, float]:
    x, y = point
    return {"x": x, "y": y}


def read_document(path: Path) -> JsonValue:
    data = read_file(path, limit=LARGEST_DOCUMENT)
    claim(path, OF_JSON * len(data))
    try:
        value = json.loads(
            data.decode("utf-8-sig"), parse_constant=_refuse_constant,
            object_pairs_hook=_refuse_duplicates,
        )  # fmt: skip
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise MalformedInputError(f"invalid JSON: {error.msg}", source=path, place=place) from None
    except RecursionError:
        raise MalformedInputError("nested too deep", source=path) from None
    except ValueError as error:
        raise MalformedInputError(f"invalid JSON: {error}", source=path) from None
    return JsonValue(path, value)


def _refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        name = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise ValueError(f"key {name!r} appears twice")
    return members


SHAPES, MANIFEST, SUMMARY = "shapes", "manifest", "summary"
ROUTE, REACH, LINT, DIFF, COMPARISON = "route", "reach", "lint", "diff", "comparison"
SCORE, ALIGNMENT, PLAN, ROUTE_GRAPH = "score", "alignment", "plan", "route graph"
COST_DIFF, ROBOT_DIFF = "difference of costs", "difference of robots"
COMPARISON_FORMAT, SCORE_FORMAT = "mapdeal-comparison/1", "mapdeal-score/1"
ALIGNMENT_FORMAT, COST_DIFF_FORMAT = "mapdeal-alignment/1", "mapdeal-cost-difference/1"
ROBOT_DIFF_FORMAT, PLAN_FORMAT = "mapdeal-robot-difference/1", "mapdeal-plan/1"
_BY_FORMAT = {
    COMPARISON_FORMAT: COMPARISON, SCORE_FORMAT: SCORE, ALIGNMENT_FORMAT: ALIGNMENT,
    COST_DIFF_FORMAT: COST_DIFF, ROBOT_DIFF_FORMAT: ROBOT_DIFF, PLAN_FORMAT: PLAN,
}  # fmt: skip
_GEOMETRIES = (
    "FeatureCollection", "Feature", "GeometryCollection", "Polygon", "LineString", "Point",
    "MultiPolygon", "MultiLineString", "MultiPoint",
)  # fmt: skip


def is_route_graph(value: Any) -> bool:
    features = value.get("features") if isinstance(value, dict) else None
    return isinstance(features, list) and any(
        isinstance(feature, dict)
        and isinstance(feature.get("properties"), dict)
        and {"startid", "endid"} <= feature["properties"].keys()
        for feature in features
    )


def document_kind(value: Any) -> str | None:
    if not isinstance(value, dict):
        return None
    if is_route_graph(value):
        return ROUTE_GRAPH
    if value.get("type") in _GEOMETRIES:
        return SHAPES
    if isinstance(value.get("outputs"), dict) and isinstance(value.get("stages"), list):
        return MANIFEST
    maps = value.get("maps")
    if isinstance(maps, list) and {"errors", "suppressed"} <= value.keys():
        return LINT
    if isinstance(maps, list) and all(isinstance(row, dict) and "status" in row for row in maps):
        return SUMMARY
    if "reached" in value and isinstance(value.get("points"), list):
        return ROUTE
    if "reachable_m2" in value and isinstance(value.get("passages"), list):
        return REACH
    if {"confusion", "walls"} <= value.keys():
        return DIFF
    return _BY_FORMAT.get(str(value.get("format")))


@dataclass(frozen=True)
class NamedMap:
    file: str
    sha256: Mapping[str, str]


def named_map(document: JsonValue) -> NamedMap | None:
    if document.is_null:
        return None
    sums = {name: digest.sha256() for name, digest in document["sha256"].fields().items()}
    return NamedMap(document["file"].text(), sums)
