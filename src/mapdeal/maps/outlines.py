"""Outlines of a map's areas as GeoJSON, and as drawings in SVG.

References
----------
RFC 7946, "The GeoJSON Format": outer rings run anticlockwise, and come before holes. Coordinates
are metres of the map frame here, not degrees.
Scalable Vector Graphics (SVG) 1.1, W3C Recommendation.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import one_line
from mapdeal.grid.frame import Frame
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.outlines import Outline, outlines

Area = Literal["free", "obstacles"]
DrawingUnit = Literal["mm", "m"]

_DECIMALS = 6  # micrometres
_MM = 1000.0
_MARGIN = 4  # cells around a drawing
_TOGETHER = 1 << 12  # polygons
FREE_FILL, REACHABLE_FILL = "#ffffff", "#b7e4d8"
WALL_FILL, UNKNOWN_FILL = "#000000", "#d9d9d9"


@dataclass(frozen=True, eq=False)
class Outlines:
    """Polygons around some cells of a frame."""

    polygons: list[Outline]
    frame: Frame
    name: str = ""

    @property
    def area(self) -> float:
        """Area of the polygons, square metres."""
        return sum(one.area for one in self.polygons) * self.frame.resolution**2

    @property
    def corners(self) -> int:
        return sum(len(ring) for one in self.polygons for ring in one.rings)

    def points(self) -> Iterator[list[NDArray[np.float64]]]:
        """Yield the rings of each polygon in the map frame, shape (N, 2) each, metres."""
        for first in range(0, len(self.polygons), _TOGETHER):  # one by one takes ten times as long
            some = [one.rings for one in self.polygons[first : first + _TOGETHER]]
            rings = [ring for many in some for ring in many]
            at = self.frame.xy_from_continuous_rowcol(np.concatenate(rings))
            parts = np.split(np.round(at, _DECIMALS) + 0.0, np.cumsum([*map(len, rings)])[:-1])
            found = iter(parts)
            for many in some:
                yield list(islice(found, len(many)))


def outlines_of(cells: Mask, frame: Frame, tolerance: float, name: str = "") -> Outlines:
    """Return the polygons around some cells, moved by at most a tolerance in metres."""
    return Outlines(outlines(cells, tolerance / frame.resolution), frame, name)


def geojson_parts(found: Outlines) -> Iterator[bytes]:
    """Yield a FeatureCollection of one polygon for each area, the largest first, one a line."""
    yield b'{"type": "FeatureCollection", "features": [\n'
    for number, (one, points) in enumerate(zip(found.polygons, found.points(), strict=True)):
        rings = [ring.tolist() for ring in points]
        feature = {
            "type": "Feature",
            "properties": {
                "name": f"{found.name} {number + 1}".strip(),
                "area": round(one.area * found.frame.resolution**2, _DECIMALS),
            },
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]] for ring in rings]},
        }
        yield (b",\n" if number else b"") + json.dumps(feature).encode()
    yield b"\n]}\n"


def svg_parts(
    layers: Sequence[tuple[Outlines, str]], frame: Frame, *, title: str, unit: DrawingUnit,
    background: str | None = None,
) -> Iterator[bytes]:  # fmt: skip
    """Yield a drawing of layers, each in one colour, the first at the bottom, as large as they are.

    A metre of the map is a metre of the drawing; user units are millimetres or metres.
    """
    shells = np.concatenate([one.shell for found, _ in layers for one in found.polygons])
    at = frame.xy_from_continuous_rowcol(shells)
    left, bottom = np.round(at.min(axis=0) - _MARGIN * frame.resolution, _DECIMALS)
    right, top = np.round(at.max(axis=0) + _MARGIN * frame.resolution, _DECIMALS)
    width, height = right - left, top - bottom
    sheet = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    scale = _MM if unit == "mm" else 1.0

    def path(rings: Sequence[NDArray[np.float64]]) -> str:
        text = ""
        for points in rings:
            places = (points - (left, bottom)) * (scale, -scale) + (0, height * scale)
            numbers = (f"{_number(x)} {_number(y)}" for x, y in places.tolist())
            text += f"M{' L'.join(numbers)}Z"
        return text

    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" version="1.1" '
        f'width="{_number(width * _MM)}mm" height="{_number(height * _MM)}mm" '
        f'viewBox="0 0 {_number(width * scale)} {_number(height * scale)}">\n'
        f"<title>{escape(one_line(title))}</title>\n"
        f"<desc>Scale 1:1, in {unit}. In the map frame, (0, 0) is {_number(left)}, "
        f"{_number(bottom + height)} m, and y points up.</desc>\n"
    ).encode()
    if background is not None:
        yield f'<path fill="{background}" d="{path([sheet])}"/>\n'.encode()
    for found, fill in layers:
        yield f'<g id="{escape(found.name)}" fill="{fill}" fill-rule="evenodd">\n'.encode()
        for rings in found.points():
            yield f'<path d="{path(rings)}"/>\n'.encode()
        yield b"</g>\n"
    yield b"</svg>\n"


def _number(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
