"""Worlds for simulators: the walls of a map as boxes in SDF, or as one mesh in STL or OBJ.

All are in the map frame, with its origin and yaw, so that a simulated robot localises on the map.

References
----------
SDFormat 1.7, which Gazebo 11 and all releases of Gazebo since read.
"StL Format Specification", binary, 3D Systems; "Object Files (.obj)", Wavefront.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from html import escape
from pathlib import Path

import numpy as np

from mapdeal.errors import ParameterError, one_line
from mapdeal.files.text import decimal_without_zeros
from mapdeal.grid.frame import Frame
from mapdeal.kernels.arrays import Floats, Integers
from mapdeal.kernels.outlines import Rectangles, Surface
from mapdeal.records import dataclass

WORLD_ENDINGS = (".sdf", ".stl", ".obj")

_DECIMALS = 9  # so that volumes are exact
_number = partial(decimal_without_zeros, decimals=_DECIMALS)
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


@dataclass(frozen=True, eq=False)
class Mesh:
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
        name=escape(one_line(name)), centre=_numbers(centre), yaw=_number(yaw),
        size=_numbers(floor), origin=_numbers((x, y)),
    ).encode()  # fmt: skip
    rows = np.stack([boxes.first_row, boxes.end_row], axis=1) * cell
    cols = np.stack([boxes.first_col, boxes.end_col], axis=1) * cell
    table = np.column_stack([cols.mean(axis=1), rows.mean(axis=1), np.diff(cols), np.diff(rows)])
    middle, height = _number(wall_height / 2), _number(wall_height)
    for first in range(0, len(table), _ROWS_AT_ONCE):
        text = ""
        walls = table[first : first + _ROWS_AT_ONCE].tolist()
        for number, (centre_x, centre_y, length_x, length_y) in enumerate(walls, first):
            box = (
                f"<pose>{_number(centre_x)} {_number(centre_y)} {middle} 0 0 0</pose>"
                f"<geometry><box><size>{_number(length_x)} {_number(length_y)} {height}</size>"
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
        yield "".join(f"v {_numbers(corner)}\n" for corner in rows).encode()
    for first in range(0, len(mesh.triangles), _ROWS_AT_ONCE):
        rows = (mesh.triangles[first : first + _ROWS_AT_ONCE] + 1).tolist()
        yield "".join(f"f {a} {b} {c}\n" for a, b, c in rows).encode()


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))
