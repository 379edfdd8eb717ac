"""Exports of maps: outlines in GeoJSON and SVG, walls as boxes in SDF or one mesh in STL or OBJ.

Worlds and meshes are in the map frame, with its origin and yaw, so that a simulated robot localises
on the map.

References
----------
RFC 7946, "The GeoJSON Format": outer rings run anticlockwise, and come before holes. Coordinates
are metres of the map frame here, not degrees.
Scalable Vector Graphics (SVG) 1.1, W3C Recommendation.
SDFormat 1.7, which Gazebo 11 and all releases of Gazebo since read.
"StL Format Specification", binary, 3D Systems; "Object Files (.obj)", Wavefront.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from html import escape
from itertools import islice, pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from mapdeal.errors import ParameterError, one_line
from mapdeal.files.text import decimal_without_zeros
from mapdeal.grid.frame import Frame
from mapdeal.kernels.arrays import Floats, Integers
from mapdeal.kernels.outlines import Polygons, Rectangles, Surface

Area = Literal["free", "obstacles"]
_Rings = list[list[list[float]]]

_DECIMALS = 6  # micrometres
_MM = 1000.0
_MARGIN = 4  # cells around a drawing
_AT_ONCE = 1 << 12
FREE_FILL, REACHABLE_FILL = "#ffffff", "#b7e4d8"
WALL_FILL, UNKNOWN_FILL = "#000000", "#d9d9d9"
_number = partial(decimal_without_zeros, decimals=_DECIMALS)


class Outlines(NamedTuple):  # of the areas of a set of cells
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


WORLD_ENDINGS = (".sdf", ".stl", ".obj")

_exact = partial(decimal_without_zeros, decimals=9)  # so that volumes are exact
_FLOOR_MARGIN = 1.0  # metres of floor around the map
_ROWS_AT_ONCE = 1 << 14
_LARGEST_ERROR = 0.1  # of a cell, by which float32 may move corners

_BEGIN = """\
<?xml version="1.0"?>
<sdf version="1.7">
<world name="{name}">
<gravity>0 0 -9.8</gravity>
<magnetic_field>5.5645e-6 22.8758e-6 -42.3884e-6</magnetic_field>
<atmosphere type="adiabatic"/>
<physics type="ode">
<max_step_size>0.001</max_step_size>
<real_time_factor>1</real_time_factor>
<real_time_update_rate>1000</real_time_update_rate>
</physics>
<scene>
<ambient>0.5 0.5 0.5 1</ambient>
<background>0.8 0.8 0.8 1</background>
<shadows>true</shadows>
</scene>
<light name="sun" type="directional">
<cast_shadows>true</cast_shadows>
<pose>0 0 10 0 0 0</pose>
<diffuse>0.8 0.8 0.8 1</diffuse>
<specular>0.2 0.2 0.2 1</specular>
<direction>-0.5 0.1 -0.9</direction>
</light>
<model name="floor">
<static>true</static>
<pose>{centre} 0 0 0 {yaw}</pose>
<link name="link">
<collision name="collision"><geometry><plane><normal>0 0 1</normal><size>{size}</size></plane>\
</geometry></collision>
<visual name="visual"><geometry><plane><normal>0 0 1</normal><size>{size}</size></plane>\
</geometry><material><ambient>0.6 0.6 0.6 1</ambient><diffuse>0.6 0.6 0.6 1</diffuse></material>\
</visual>
</link>
</model>
<model name="walls">
<static>true</static>
<pose>{origin} 0 0 0 {yaw}</pose>
<link name="link">
"""
_END = "</link>\n</model>\n</world>\n</sdf>\n"


class Mesh(NamedTuple):
    """Corners of a surface in the map frame, shape (N, 3), metres, and its triangles, (M, 3)."""

    corners: Floats
    triangles: Integers


def mesh_of(surface: Surface, frame: Frame, wall_height: float) -> Mesh:
    corners = np.empty((len(surface.corners), 3))
    corners[:, :2] = frame.xy_from_continuous_rowcol(surface.corners)
    corners[:, 2] = surface.levels * (wall_height / 2)
    return Mesh(corners, surface.triangles)


def sdf_parts(boxes: Rectangles, frame: Frame, wall_height: float, name: str) -> Iterator[bytes]:
    """Yield an SDF world with a floor, a sun, and a static model of boxes for the walls."""
    cell = frame.resolution
    x, y, yaw = frame.origin
    centre = frame.xy_from_continuous_rowcol([[frame.height / 2, frame.width / 2]])[0]
    floor = (frame.width * cell + 2 * _FLOOR_MARGIN, frame.height * cell + 2 * _FLOOR_MARGIN)
    yield _BEGIN.format(
        name=escape(one_line(name)), centre=_exact_numbers(centre), yaw=_exact(yaw),
        size=_exact_numbers(floor), origin=_exact_numbers((x, y)),
    ).encode()  # fmt: skip
    rows = np.stack([boxes.first_row, boxes.end_row], axis=1) * cell
    cols = np.stack([boxes.first_col, boxes.end_col], axis=1) * cell
    table = np.column_stack([cols.mean(axis=1), rows.mean(axis=1), np.diff(cols), np.diff(rows)])
    middle, height = _exact(wall_height / 2), _exact(wall_height)
    for first in range(0, len(table), _ROWS_AT_ONCE):
        text = ""
        walls = table[first : first + _ROWS_AT_ONCE].tolist()
        for number, (centre_x, centre_y, length_x, length_y) in enumerate(walls, first):
            box = (
                f"<pose>{_exact(centre_x)} {_exact(centre_y)} {middle} 0 0 0</pose>"
                f"<geometry><box><size>{_exact(length_x)} {_exact(length_y)} {height}</size>"
                "</box></geometry>"
            )
            text += f'<collision name="c{number}">{box}</collision>'
            text += f'<visual name="v{number}">{box}</visual>\n'
        yield text.encode()
    yield _END.encode()


def stl_parts(mesh: Mesh, source: Path, resolution: float) -> Iterator[bytes]:
    """Yield a binary STL file; refuse corners that its float32 would merge, or move visibly."""
    title = f"mapdeal {source.stem}, metres, z up".encode("ascii", "replace")[:80]
    yield title.ljust(80) + len(mesh.triangles).to_bytes(4, "little")
    for first in range(0, len(mesh.triangles), _ROWS_AT_ONCE):
        corners = np.take(mesh.corners, mesh.triangles[first : first + _ROWS_AT_ONCE], axis=0)
        rounded = corners.astype(np.float32).astype(np.float64)
        error = np.abs(rounded - corners).max()
        if error > _LARGEST_ERROR * resolution or not _area_vectors(rounded).any(axis=1).all():
            rule = f"is too far from 0 for .stl, whose float32 moves walls by up to {error:.2g} m"
            hint = f"mapdeal convert {source} -o {source.stem}.obj keeps all digits"
            raise ParameterError(rule, source=source, place="origin", hint=hint)
        normals = _area_vectors(corners)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        numbers = np.concatenate([normals, corners.reshape(-1, 9)], axis=1).astype("<f4")
        records = np.zeros((len(corners), 50), dtype=np.uint8)  # the last two bytes are 0
        records[:, :48] = numbers.view(np.uint8)
        yield records.tobytes()


def _area_vectors(corners: Floats) -> Floats:
    """Return the normals of triangles, shape (N, 3), as long as twice their areas."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def obj_parts(mesh: Mesh, name: str) -> Iterator[bytes]:
    # A backslash at the end of a line would join it with the next one.
    title = one_line("_".join(name.split())).replace("\\", "_")
    yield f"# mapdeal, metres, z up\no {title}\n".encode()
    for first in range(0, len(mesh.corners), _ROWS_AT_ONCE):
        rows = mesh.corners[first : first + _ROWS_AT_ONCE].tolist()
        yield "".join(f"v {_exact_numbers(corner)}\n" for corner in rows).encode()
    for first in range(0, len(mesh.triangles), _ROWS_AT_ONCE):
        rows = (mesh.triangles[first : first + _ROWS_AT_ONCE] + 1).tolist()
        yield "".join(f"f {a} {b} {c}\n" for a, b, c in rows).encode()


def _exact_numbers(values: Iterable[float]) -> str:
    return " ".join(map(_exact, values))
