"""Transforms between map frames in JSON files, as ``mapdeal align`` writes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapdeal.errors import emit_warning
from mapdeal.formats.json_values import JsonValue, read_document
from mapdeal.grid.transform import Transform
from mapdeal.records import dataclass


@dataclass(frozen=True)
class TransformFile:
    """A transform that was read, and which maps it is between."""

    transform: Transform
    first: Mapping[str, str]
    second: Mapping[str, str]


def transform_document(transform: Transform) -> dict[str, Any]:
    """Return a transform as JSON can hold it."""
    degrees = round(math.degrees(transform.yaw), 9)
    return {"x": transform.x, "y": transform.y, "yaw": transform.yaw, "yaw_deg": degrees}


def read_transform(path: Path) -> TransformFile:
    """Return the transform in a JSON file.

    The file is what ``mapdeal align`` has written, or an object with x, y (metres) and yaw
    (radians) written by hand.
    """
    document = read_document(path)
    place = document.get("transform")
    own = document if place is None else place
    sure = document.get("same_place")
    if sure is not None and not sure.flag():
        text = f"{path}: align was uncertain about this transform; it is used as it is"
        emit_warning(text, stacklevel=2)
    x, y, yaw = (own[key].number() for key in ("x", "y", "yaw"))
    return TransformFile(
        Transform(x, y, yaw), _sums_of(document, "first"), _sums_of(document, "second")
    )


def _sums_of(document: JsonValue, key: str) -> dict[str, str]:
    told = document.get(key)
    sums = None if told is None or told.is_null else told.get("sha256")
    if sums is None:
        return {}
    return {name: value.sha256() for name, value in sums.fields().items()}
