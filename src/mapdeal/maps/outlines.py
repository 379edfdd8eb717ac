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
_AT_ONCE = 1 << 12
FREE_FILL, REACHABLE_FILL = "#ffffff", "#b7e4d8"
WALL_FILL, UNKNOWN_FILL = "#000000", "#d9d9d9"


@dataclass(frozen=True, eq=False)
class Outlines:
    """Polygons around a set of cells."""

    polygons: list[Outline]
    frame: Frame
    name: str = ""

    @property
    def area(self) -> float:
        """Area of the polygons, square metres."""
        return sum(polygon.area for polygon in self.polygons) * self.frame.resolution**2

    @property
    def corners(self) -> int:
        return sum(len(ring) for polygon in self.polygons for ring in polygon.rings)

    def points(self) -> Iterator[list[NDArray[np.float64]]]:
        """Yield the rings of each polygon in the map frame, shape (N, 2) each, metres."""
        for first in range(0, len(self.polygons), _AT_ONCE):
            polygons = self.polygons[first : first + _AT_ONCE]
            rings = [ring for polygon in polygons for ring in polygon.rings]
            xy = self.frame.xy_from_continuous_rowcol(np.concatenate(rings))
            parts = np.split(np.round(xy, _DECIMALS) + 0.0, np.cumsum([*map(len, rings)])[:-1])
            ring_points = iter(parts)
            for polygon in polygons:
                yield list(islice(ring_points, len(polygon.rings)))


def outlines_of(cells: Mask, frame: Frame, tolerance: float, name: str = "") -> Outlines:
    """Return the polygons around cells, simplified by at most `tolerance` metres."""
    return Outlines(outlines(cells, tolerance / frame.resolution), frame, name)


def geojson_parts(areas: Outlines) -> Iterator[bytes]:
    """Yield a FeatureCollection with one polygon per area, the largest first, one per line."""
    yield b'{"type": "FeatureCollection", "features": [\n'
    pairs = zip(areas.polygons, areas.points(), strict=True)
    for number, (polygon, points) in enumerate(pairs):
        rings = [ring.tolist() for ring in points]
        feature = {
            "type": "Feature",
            "properties": {
                "name": f"{areas.name} {number + 1}".strip(),
                "area": round(polygon.area * areas.frame.resolution**2, _DECIMALS),
            },
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]] for ring in rings]},
        }
        yield (b",\n" if number else b"") + json.dumps(feature).encode()
    yield b"\n]}\n"


def svg_parts(
    layers: Sequence[tuple[Outlines, str]], frame: Frame, *, title: str, unit: DrawingUnit,
    background: str | None = None,
) -> Iterator[bytes]:  # fmt: skip
    """Yield an SVG drawing of layers at scale 1:1, each in one colour, the first at the bottom.

    User units are millimetres or metres.
    """
    shells = np.concatenate([area.shell for layer, _ in layers for area in layer.polygons])
    shells_xy = frame.xy_from_continuous_rowcol(shells)
    west, south = np.round(shells_xy.min(axis=0) - _MARGIN * frame.resolution, _DECIMALS)
    east, north = np.round(shells_xy.max(axis=0) + _MARGIN * frame.resolution, _DECIMALS)
    width, height = east - west, north - south
    sheet = np.array([[west, south], [east, south], [east, north], [west, north]])
    scale = _MM if unit == "mm" else 1.0

    def path(rings: Sequence[NDArray[np.float64]]) -> str:
        text = ""
        for points in rings:
            places = (points - (west, south)) * (scale, -scale) + (0, height * scale)
            numbers = (f"{_number(x)} {_number(y)}" for x, y in places.tolist())
            text += f"M{' L'.join(numbers)}Z"
        return text

    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" version="1.1" '
        f'width="{_number(width * _MM)}mm" height="{_number(height * _MM)}mm" '
        f'viewBox="0 0 {_number(width * scale)} {_number(height * scale)}">\n'
        f"<title>{escape(one_line(title))}</title>\n"
        f"<desc>Scale 1:1, in {unit}. In the map frame, (0, 0) is {_number(west)}, "
        f"{_number(south + height)} m, and y points up.</desc>\n"
    ).encode()
    if background is not None:
        yield f'<path fill="{background}" d="{path([sheet])}"/>\n'.encode()
    for layer, fill in layers:
        yield f'<g id="{escape(layer.name)}" fill="{fill}" fill-rule="evenodd">\n'.encode()
        for rings in layer.points():
            yield f'<path d="{path(rings)}"/>\n'.encode()
        yield b"</g>\n"
    yield b"</svg>\n"


def _number(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
