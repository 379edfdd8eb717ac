"""Outlines of a map's areas as GeoJSON, and as drawings in SVG.

References
----------
RFC 7946, "The GeoJSON Format": outer rings run anticlockwise, and come before holes. Coordinates
are metres of the map frame here, not degrees.
Scalable Vector Graphics (SVG) 1.1, W3C Recommendation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from html import escape
from itertools import islice, pairwise
from typing import Literal

import numpy as np

from mapdeal.errors import one_line
from mapdeal.files.text import decimal_without_zeros
from mapdeal.grid.frame import Frame
from mapdeal.kernels.arrays import Floats, Mask
from mapdeal.kernels.outlines import Polygons, outlines
from mapdeal.records import dataclass

Area = Literal["free", "obstacles"]
_Rings = list[list[list[float]]]

_DECIMALS = 6  # micrometres
_MM = 1000.0
_MARGIN = 4  # cells around a drawing
_AT_ONCE = 1 << 12
FREE_FILL, REACHABLE_FILL = "#ffffff", "#b7e4d8"
WALL_FILL, UNKNOWN_FILL = "#000000", "#d9d9d9"
_number = partial(decimal_without_zeros, decimals=_DECIMALS)


@dataclass(frozen=True, eq=False)
class Outlines:  # of the areas of a set of cells
    polygons: Polygons
    frame: Frame
    name: str

    @property
    def area(self) -> float:
        return float(self.polygons.areas.sum()) * self.frame.resolution**2

    def points(
        self, transform: Callable[[Floats], Floats] = lambda points: points
    ) -> Iterator[list[_Rings]]:
        """Yield the rings of some polygons at a time in the map frame, metres."""
        polygons = self.polygons
        ring_bounds = [0, *polygons.ring_ends.tolist()]
        polygon_bounds = [*polygons.shells.tolist(), len(polygons.ring_ends)]
        for first in range(0, len(polygons), _AT_ONCE):  # one by one takes ten times as long
            bounds = polygon_bounds[first : first + _AT_ONCE + 1]
            first_ring, end_ring = bounds[0], bounds[-1]
            corner_bounds = ring_bounds[first_ring : end_ring + 1]
            corners = polygons.corners[corner_bounds[0] : corner_bounds[-1]]
            rounded = np.round(self.frame.xy_from_continuous_rowcol(corners), _DECIMALS) + 0.0
            points = iter(transform(rounded).tolist())
            rings = [list(islice(points, end - start)) for start, end in pairwise(corner_bounds)]
            yield [rings[start - first_ring : end - first_ring] for start, end in pairwise(bounds)]


def outlines_of(cells: Mask, frame: Frame, tolerance: float, name: str) -> Outlines:
    """Return the polygons around cells, simplified by at most a tolerance in metres."""
    return Outlines(outlines(cells, tolerance / frame.resolution), frame, name)


def geojson_parts(layer: Outlines) -> Iterator[bytes]:
    """Yield a FeatureCollection with one polygon per area, the largest first, one per line."""
    yield b'{"type": "FeatureCollection", "features": [\n'
    areas = iter((layer.polygons.areas * layer.frame.resolution**2).tolist())
    number = 0
    for polygons in layer.points():
        closed = [[[*ring, ring[0]] for ring in rings] for rings in polygons]
        texts = json.dumps(closed)[4:-4].split("]]], [[[")  # all at once: three times as fast
        features = [
            f'{{"type": "Feature", "properties": {{"name": "{layer.name} {number + index}", '
            f'"area": {round(area, _DECIMALS)}}}, '
            f'"geometry": {{"type": "Polygon", "coordinates": [[[{text}]]]}}}}'
            for index, (text, area) in enumerate(zip(texts, areas, strict=False), 1)
        ]
        yield (",\n" * bool(number) + ",\n".join(features)).encode()
        number += len(features)
    yield b"\n]}\n"


def svg_parts(
    layers: Sequence[tuple[Outlines, str]], frame: Frame, *, title: str, background: str | None
) -> Iterator[bytes]:
    """Yield an SVG drawing of layers at scale 1:1, each in one colour, the first at the bottom."""
    # User units are millimetres.
    corners = np.concatenate([layer.polygons.corners for layer, _ in layers])
    points = frame.xy_from_continuous_rowcol(corners)
    west, south = np.round(points.min(axis=0) - _MARGIN * frame.resolution, _DECIMALS)
    east, north = np.round(points.max(axis=0) + _MARGIN * frame.resolution, _DECIMALS)
    width, height = east - west, north - south
    sheet = np.array([[west, south], [east, south], [east, north], [west, north]])

    def on_sheet(points: Floats) -> Floats:
        return np.asarray((points - (west, south)) * (_MM, -_MM) + (0, height * _MM))

    def path(rings: _Rings) -> str:
        paths = (" L".join(f"{_number(x)} {_number(y)}" for x, y in ring) for ring in rings)
        return "".join(f"M{path}Z" for path in paths)

    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" version="1.1" '
        f'width="{_number(width * _MM)}mm" height="{_number(height * _MM)}mm" '
        f'viewBox="0 0 {_number(width * _MM)} {_number(height * _MM)}">\n'
        f"<title>{escape(one_line(title))}</title>\n"
        f"<desc>Scale 1:1, in mm. In the map frame, (0, 0) is {_number(west)}, "
        f"{_number(south + height)} m, and y points up.</desc>\n"
    ).encode()
    if background is not None:
        yield f'<path fill="{background}" d="{path([on_sheet(sheet).tolist()])}"/>\n'.encode()
    for layer, fill in layers:
        yield f'<g id="{escape(layer.name)}" fill="{fill}" fill-rule="evenodd">\n'.encode()
        for polygons in layer.points(on_sheet):
            yield "".join(f'<path d="{path(rings)}"/>\n' for rings in polygons).encode()
        yield b"</g>\n"
    yield b"</svg>\n"
