"""Recognition of mapdeal's JSON documents by their keys."""

from __future__ import annotations

from typing import Any

SHAPES, MANIFEST, SUMMARY = "shapes", "manifest", "summary"
ROUTE, REACH, LINT, DIFF, COMPARISON = "route", "reach", "lint", "diff", "comparison"
SCORE, ALIGNMENT = "score", "alignment"

COMPARISON_FORMAT = "mapdeal-comparison/1"
SCORE_FORMAT = "mapdeal-score/1"
ALIGNMENT_FORMAT = "mapdeal-alignment/1"
_BY_FORMAT = {
    COMPARISON_FORMAT: COMPARISON, SCORE_FORMAT: SCORE, ALIGNMENT_FORMAT: ALIGNMENT
}  # fmt: skip
_GEOMETRIES = (
    "FeatureCollection", "Feature", "GeometryCollection", "Polygon", "LineString", "Point",
    "MultiPolygon", "MultiLineString", "MultiPoint",
)  # fmt: skip


def document_kind(value: Any) -> str | None:
    """Return what a JSON value is; None if it is nothing that is known.

    Examples
    --------
    >>> document_kind({"maps": [], "errors": 0, "suppressed": 0})
    'lint'
    """
    if not isinstance(value, dict):
        return None
    if value.get("type") in _GEOMETRIES:
        return SHAPES
    if isinstance(value.get("outputs"), dict) and isinstance(value.get("stages"), list):
        return MANIFEST
    maps = value.get("maps")
    if isinstance(maps, list) and {"errors", "suppressed"} <= value.keys():
        return LINT
    if isinstance(maps, list) and all(isinstance(one, dict) and "status" in one for one in maps):
        return SUMMARY
    if "reached" in value and isinstance(value.get("points"), list):
        return ROUTE
    if "reachable_m2" in value and isinstance(value.get("passages"), list):
        return REACH
    if {"confusion", "walls"} <= value.keys():
        return DIFF
    return _BY_FORMAT.get(str(value.get("format")))
