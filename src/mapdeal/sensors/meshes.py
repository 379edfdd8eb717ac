"""Triangles in STL, OBJ and COLLADA files, and XML without entities.

References
----------
"StL Format Specification", 3D Systems; "Object Files (.obj)", Wavefront; "COLLADA - Digital Asset
Schema Release 1.4.1", Khronos Group.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.files.source import claim, read_file
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask
from mapdeal.kernels.polygons import enumerated
from mapdeal.kernels.rotations import product, rotated
from mapdeal.kernels.sensing import decimals_in

MESH_ENDINGS = (".stl", ".obj", ".dae")

_LARGEST_XML = 1 << 28
_MOST_ELEMENTS, _DEEPEST = 1 << 22, 200
_VERTEX = re.compile(rb"vertex[ \t]([^\n\r]*)")
_PIECE = 1 << 20  # bytes of text that are parsed together
_MOST_CORNERS = 2000  # of a face that is divided into strips
MOST_INSTANCES = 1 << 20  # small files can refer to one shape any number of times


class Part(NamedTuple):
    """A part of a mesh: its names and its triangles, shape (N, 3, 3), anticlockwise outside."""

    names: tuple[str, ...]
    triangles: Floats


def read_mesh(path: Path) -> list[Part]:
    """Return the parts of a mesh, in metres and with z up if the file states its units and axes."""
    parts = [part for part in _READERS[path.suffix.lower()](path) if len(part.triangles)]
    if not all(np.isfinite(part.triangles).all() for part in parts):
        raise MalformedInputError("has coordinates that are not finite", source=path)
    if not parts:
        raise MalformedInputError("has no triangles", source=path)
    return parts


def read_xml(path: Path) -> Element:
    """Parse XML; refuse entities, which can expand without bound or name other files."""
    data = read_file(path, limit=_LARGEST_XML)
    claim(path, 4 * len(data))
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.buffer_text = True
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > _DEEPEST or count > _MOST_ELEMENTS:
            raise refusal(f"must have at most {_MOST_ELEMENTS} elements, {_DEEPEST} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refusal(rule: str) -> MalformedInputError:
        return MalformedInputError(rule, source=path, place=f"line {parser.CurrentLineNumber}")

    def refuse_entity(name: str, *_: object) -> None:
        raise refusal(f"must not declare entities, got {name!r}")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, refuse_entity
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError) as error:  # the latter of unknown encodings
        raise MalformedInputError(f"is not well-formed XML: {error}", source=path) from None
    return builder.close()


def malformed(path: Path, rule: str, place: str, **details: Any) -> MalformedInputError:
    return MalformedInputError(rule, source=path, place=place, **details)


def numbers_in(
    text: str | None, path: Path, place: str, count: int | None = None, kind: type = float
) -> Array:
    rule = f"must be {'' if count is None else f'{count} '}{'finite' if kind is float else 'whole'}"
    try:
        values = decimals_in((text or "").encode())
    except ValueError:
        values = np.array([np.nan])
    is_valid = np.isfinite(values)
    if kind is int:
        is_valid &= (values == np.floor(values)) & (np.abs(values) < 1 << 53)
    if not is_valid.all() or count not in (None, len(values)):
        raise malformed(path, f"{rule} numbers", place, got=text)
    return values if kind is float else values.astype(np.int64)


def _rows(text: bytes, count: int, *, with_slashes: bool = False) -> tuple[Floats, Integers]:
    """Return numbers of rows that begin with v, and where these begin; raise ValueError."""
    numbers = decimals_in(text, with_slashes=with_slashes)
    begins = np.flatnonzero(np.isnan(numbers))
    if len(begins) != count or np.diff(begins, append=len(numbers)).min(initial=4) < 4:
        raise ValueError
    return numbers, begins


def _points(text: bytes, count: int) -> Floats:
    numbers, begins = _rows(text, count)
    return np.asarray(numbers[begins[:, np.newaxis] + [1, 2, 3]])


def transform_triangles(matrix: Floats, triangles: Floats) -> Floats:
    """Return triangles transformed by a matrix, shape (4, 4); mirrored ones keep their outside."""
    # einsum: BLAS would reserve 32 MB per thread
    points = np.einsum("ij,nkj->nki", matrix[:3, :3], triangles) + matrix[:3, 3]
    a, b, c = matrix[:3, :3]
    return np.asarray(points[:, ::-1] if (np.cross(a, b) * c).sum() < 0 else points)


def _stl_parts(path: Path) -> list[Part]:
    data = read_file(path)
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    if len(data) == 84 + 50 * count:
        claim(path, 2 * len(data), what=f"{count} triangles")
        records = np.frombuffer(data, np.uint8, offset=84).reshape(-1, 50)[:, 12:48]
        numbers = np.ascontiguousarray(records).view("<f4").astype(np.float64)
    elif re.match(rb"\s*solid\b", data[:512].lower()) and b"facet" in data[:4096].lower():
        claim(path, 2 * len(data))
        data = data if b"vertex" in data else data.lower()
        try:
            rows = map(_VERTEX.findall, _pieces_of_whole_lines(data))
            numbers = np.concatenate([_points(b" v ".join([b"", *row]), len(row)) for row in rows])
        except ValueError:
            raise malformed(path, "must be 3 finite numbers", "vertex") from None
        if len(numbers) % 3 or b"endsolid" not in data[-4096:]:
            raise MalformedInputError("ends within a triangle or before endsolid", source=path)
    else:
        rule = f"must be 84 bytes and 50 for each of its {count} triangles"
        raise MalformedInputError(rule, source=path, got=len(data))
    return [Part((), numbers.reshape(-1, 3, 3))]


def _pieces_of_whole_lines(data: bytes) -> Iterator[bytes]:
    first = 0
    while first < len(data):
        end = data.rfind(b"\n", first, first + _PIECE) + 1
        end = end if end > first else len(data)
        yield data[first:end]
        first = end


class _ObjLines(NamedTuple):
    corners: Floats
    indices: Integers  # the corners of all faces, one face after the other
    counts: Integers  # the number of corners of each face
    name_numbers: Integers  # the number of name lines before each face
    names: list[tuple[str, ...]]


def _obj_lines(text: bytes, corners_before: int) -> _ObjLines:
    text = re.sub(rb"\n +", b"\n", b"\n" + text) + b"\n\n\n"
    codes = np.frombuffer(text, np.uint8)
    starts = np.flatnonzero(codes[:-2] == ord("\n"))
    kinds = np.where(codes[starts + 2] <= ord(" "), codes[starts + 1], 0)

    def lines_of(kind: Mask) -> bytes:
        ends = starts[np.flatnonzero(np.diff(kind, prepend=False))].reshape(-1, 2).tolist()
        lines = b"".join([text[first:end] for first, end in ends])
        return re.sub(b"#.*", b"", lines) if b"#" in lines else lines

    is_corner = kinds == ord("v")
    is_face = kinds == ord("f")
    has_names = np.isin(kinds, [ord("g"), ord("o")])
    face_lines = lines_of(is_face).replace(b"\nf", b"\nv")
    numbers, begins = _rows(face_lines, int(is_face.sum()), with_slashes=True)
    counts = np.diff(begins, append=len(numbers)) - 1
    earlier = np.repeat(corners_before + np.cumsum(is_corner)[is_face], counts)
    numbers = np.delete(numbers, begins)
    numbers = np.where(numbers > 0, numbers - 1, earlier + numbers)  # negative: from the end
    if ((numbers < 0) | (numbers >= earlier) | (numbers != np.floor(numbers))).any():
        raise ValueError
    name_lines = lines_of(has_names).decode("latin-1").split("\n")[1:]
    return _ObjLines(
        corners=_points(lines_of(is_corner), int(is_corner.sum())),
        indices=numbers.astype(np.int64),
        counts=counts,
        name_numbers=np.cumsum(has_names, dtype=np.int64)[is_face],
        names=[tuple(line.split()[1:]) for line in name_lines],
    )


def _obj_parts(path: Path) -> list[Part]:
    data = read_file(path)
    for code, meaning in ((b"\r\n", b"\n"), (b"\r", b"\n"), (b"\\\n", b" "), (b"\t", b" ")):
        data = data.replace(code, meaning)
    claim(path, 8 * len(data))
    corner_count = line_count = 0
    pieces: list[tuple[Array, ...]] = [_obj_lines(b"", 0)[:4]]
    names: list[tuple[str, ...]] = [()]  # faces before the first name have none
    for text in _pieces_of_whole_lines(data):
        try:
            lines = _obj_lines(text, corner_count)
        except ValueError:
            _refuse_bad_line(text, corner_count, line_count, path)
            raise
        name_numbers = lines.name_numbers + len(names) - 1
        pieces.append((lines.corners, lines.indices, lines.counts, name_numbers))
        names += lines.names
        corner_count += len(lines.corners)
        line_count += text.count(b"\n")
    corners, indices, counts, name_numbers = map(np.concatenate, zip(*pieces, strict=True))
    triangles, faces = triangulate(corners, indices, counts, path)
    order = np.argsort(name_numbers[faces], kind="stable")
    ends = np.searchsorted(name_numbers[faces][order], np.arange(len(names) + 1))
    return [Part(name, triangles[order[ends[k] : ends[k + 1]]]) for k, name in enumerate(names)]


def _refuse_bad_line(text: bytes, corner_count: int, line_count: int, path: Path) -> None:
    for number, line in enumerate(text.splitlines(), line_count + 1):
        try:
            corner_count += len(_obj_lines(line, corner_count).corners)
        except ValueError:
            rule = "must be v and 3 finite numbers, or f and 3 or more earlier corners"
            words = line[:80].decode("latin-1").strip()
            raise malformed(path, rule, f"line {number}", got=words) from None


def triangulate(
    corners: Floats, indices: Integers, counts: Integers, path: Path
) -> tuple[Floats, Integers]:
    """Return the triangles of faces, shape (N, 3, 3), and the face of each triangle."""
    starts = np.cumsum(counts) - counts
    triangles, faces = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for count in np.unique(counts[counts >= 3]).tolist():
        numbers = np.flatnonzero(counts == count)
        points = corners.take(indices[starts[numbers][:, np.newaxis] + np.arange(count)], axis=0)
        if count > 3:
            spokes, edges = points - points[:, :1], np.roll(points, -1, axis=1) - points
            normals = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
            turns = np.einsum("nkj,nj->nk", np.cross(np.roll(edges, 1, axis=1), edges), normals)
            # a fan of a concave face would cover its notches, such as doors
            is_concave = (turns < -1e-9 * np.abs(turns).max(axis=1, keepdims=True)).any(axis=1)
            for k in np.flatnonzero(is_concave).tolist():
                axis = int(np.abs(normals[k]).argmax())
                strips = strips_of([points[k]], path, axis)
                triangles.append(strips if normals[k, axis] > 0 else strips[:, ::-1])
                faces.append(np.full(len(strips), numbers[k]))
            numbers, points = numbers[~is_concave], points[~is_concave]
        triangles.append(points[:, [[0, k, k + 1] for k in range(1, count - 1)]].reshape(-1, 3, 3))
        faces.append(np.repeat(numbers, count - 2))
    return np.concatenate(triangles), np.concatenate(faces)


def strips_of(rings: Sequence[Floats], path: Path, axis: int = 2) -> Floats:
    """Return triangles, anticlockwise as seen along an axis, of the area between closed rings."""
    x, y = (axis + 1) % 3, (axis + 2) % 3
    count = sum(map(len, rings))
    if count > _MOST_CORNERS:
        raise malformed(path, f"must have at most {_MOST_CORNERS} corners", "face", got=count)
    begin = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    is_up = begin[:, y : y + 1] <= end[:, y : y + 1]
    low, high = np.where(is_up, begin, end), np.where(is_up, end, begin)
    levels = np.unique(begin[:, y])  # no side of the area begins or ends inside a strip
    side, strip = enumerated(*(np.searchsorted(levels, ends[:, y]) for ends in (low, high)))
    slope = (high - low)[side] / (high - low)[side, y : y + 1]
    bottom, top = (
        low[side] + slope * (levels[strip + k] - low[side, y])[:, np.newaxis] for k in (0, 1)
    )
    # in a strip, the area lies between sides 1 and 2, 3 and 4, etc., counted from the left
    order = np.lexsort(((bottom + top)[:, x], strip))
    bottom, top = (ends[order].reshape(-1, 2, 3) for ends in (bottom, top))
    quads = np.concatenate([bottom, top[:, ::-1]], axis=1)
    return np.asarray(quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3))


_UP = {"X_UP": [[0, -1, 0], [0, 0, -1], [1, 0, 0]], "Y_UP": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}
_NO_SURFACE = ("source", "vertices", "lines", "linestrips", "extra")


class _Collada:
    def __init__(self, path: Path) -> None:
        self.path, self.root = path, read_xml(path)
        self.by_id = {element.get("id"): element for element in self.root.iter()}
        self.parts: list[Part] = []
        self._geometries: dict[str, list[Part]] = {}
        self._instances = self._bytes = 0
        self._open: list[Element] = []

    def read(self) -> list[Part]:
        unit = self.root.find("asset/unit")
        metre = "1" if unit is None else unit.get("meter", "1")
        scale = numbers_in(metre, self.path, "asset: unit: meter", 1)[0]
        up = (self.root.findtext("asset/up_axis") or "").strip()
        matrix = matrix_of(np.array(_UP.get(up, np.eye(3))) * scale, 0.0)
        if (scene := self.root.find("scene/instance_visual_scene")) is not None:
            self._add_nodes(self._target(scene, "visual_scene"), matrix, ())
        else:
            for geometry in self.root.iterfind("library_geometries/geometry"):
                self._add(geometry, matrix, ())
        return self.parts

    def _target(self, element: Element, kind: str, key: str = "url") -> Element:
        target = self.by_id.get(element.get(key, "").removeprefix("#"))
        if target is None or target.tag != kind:
            place, rule = f"{element.tag}: {key}", f"must refer to a {kind} of this file"
            raise malformed(self.path, rule, place, got=element.get(key))
        return target

    def _add_nodes(self, parent: Element, matrix: Floats, names: tuple[str, ...]) -> None:
        if parent in self._open or len(self._open) > _DEEPEST:
            raise malformed(self.path, "must not contain itself", f"node {parent.get('id')}")
        self._open.append(parent)
        self._count()
        for child in parent:
            if child.tag in ("lookat", "skew", "instance_controller"):
                raise malformed(self.path, "is not supported", child.tag)
            if child.tag in _TRANSFORMS:
                count, to_matrix = _TRANSFORMS[child.tag]
                numbers = numbers_in(child.text, self.path, child.tag, count)
                matrix = product(matrix, to_matrix(numbers))
            elif child.tag == "node":
                child_names = child.get("id", ""), child.get("name", "")
                self._add_nodes(child, matrix, (*names, *child_names))
            elif child.tag == "instance_node":
                self._add_nodes(self._target(child, "node"), matrix, names)
            elif child.tag == "instance_geometry":
                self._add(self._target(child, "geometry"), matrix, names)
        self._open.pop()

    def _add(self, geometry: Element, matrix: Floats, names: tuple[str, ...]) -> None:
        key = geometry.get("id", "")
        if geometry.find("convex_mesh") is not None:
            raise malformed(self.path, "is not supported", f"geometry {key}: convex_mesh")
        if key not in self._geometries:
            shapes = geometry.iterfind("mesh/*")
            surfaces = [shape for shape in shapes if shape.tag not in _NO_SURFACE]
            self._geometries[key] = [self._part(f"geometry {key}: {s.tag}", s) for s in surfaces]
        names = (*names, key, geometry.get("name", ""))
        for part in self._geometries[key]:
            self._count()
            self._bytes += part.triangles.nbytes
            claim(self.path, 2 * self._bytes, what="its triangles")
            self.parts.append(Part(names, transform_triangles(matrix, part.triangles)))

    def _count(self) -> None:
        self._instances += 1
        if self._instances > MOST_INSTANCES:
            raise malformed(self.path, f"must have at most {MOST_INSTANCES} nodes", "scene")

    def _part(self, place: str, faces: Element) -> Part:
        if faces.tag not in ("triangles", "polylist", "polygons"):
            raise malformed(self.path, "must be triangles, polylist or polygons", place)
        if faces.find("ph") is not None:
            raise malformed(self.path, "must not have holes", f"{place}: ph")
        inputs = {element.get("semantic"): element for element in faces.iterfind("input")}
        offsets = " ".join(element.get("offset", "0") for element in faces.iterfind("input"))
        step = 1 + int(self._indices_in(offsets, f"{place}: offset").max(initial=0))
        numbers, width = self._positions(place, inputs.get("VERTEX"))
        loops = [self._indices_in(p.text, f"{place}: p") for p in faces.iterfind("p")]
        if width < 3 or len(numbers) % width or any(len(loop) % step for loop in loops):
            rule = f"must be corners of {width} numbers and {step} indices"
            raise malformed(self.path, rule, place, got=len(numbers))
        corners = numbers.reshape(-1, width)[:, :3]
        offset = int(inputs["VERTEX"].get("offset", "0"))
        indices = np.concatenate([np.zeros(0, np.int64), *(loop[offset::step] for loop in loops)])
        if faces.tag == "triangles":
            counts = np.full(len(indices) // 3, 3)
        elif faces.tag == "polylist":
            counts = self._indices_in(faces.findtext("vcount"), f"{place}: vcount")
        else:
            counts = np.array([len(loop) // step for loop in loops], np.int64)
        if counts.sum() != len(indices) or (len(indices) and indices.max() >= len(corners)):
            rule = f"must have as many indices as its faces, below {len(corners)}"
            raise malformed(self.path, rule, place, got=len(indices))
        return Part((), triangulate(corners, indices, counts, self.path)[0])

    def _positions(self, place: str, vertex_input: Element | None) -> tuple[Floats, int]:
        """Return the coordinates of all corners, and how many numbers each corner has."""
        vertices: Iterable[Element] = ()
        if vertex_input is not None:
            vertices = self._target(vertex_input, "vertices", "source").iterfind("input")
        positions = [element for element in vertices if element.get("semantic") == "POSITION"]
        if len(positions) != 1:
            raise malformed(self.path, "must have one input VERTEX with POSITION", place)
        source = self._target(positions[0], "source", "source")
        accessor = source.find("technique_common/accessor")
        stride = "3" if accessor is None else accessor.get("stride", "3")
        width = int(self._indices_in(stride, f"{place}: stride", 1)[0])
        return numbers_in(source.findtext("float_array"), self.path, f"{place}: float_array"), width

    def _indices_in(self, text: str | None, place: str, count: int | None = None) -> Integers:
        values = numbers_in(text, self.path, place, count, int)
        if len(values) and values.min() < 0:
            raise malformed(self.path, "must not be negative", place)
        return values


def matrix_of(turn: Floats, move: Floats | float) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, move
    return matrix


def _axis_rotation(numbers: Floats) -> Floats:
    axis, half = numbers[:3] / (np.linalg.norm(numbers[:3]) or 1.0), math.radians(numbers[3]) / 2
    return matrix_of(rotated(np.append(math.sin(half) * axis, math.cos(half)), np.eye(3)).T, 0.0)


_TRANSFORMS: dict[str, tuple[int, Callable[[Floats], Floats]]] = {
    "matrix": (16, lambda numbers: numbers.reshape(4, 4)),
    "translate": (3, lambda numbers: matrix_of(np.eye(3), numbers)),
    "rotate": (4, _axis_rotation),
    "scale": (3, lambda numbers: np.diag([*numbers, 1.0])),
}

_READERS: dict[str, Callable[[Path], list[Part]]] = {
    ".stl": _stl_parts,
    ".obj": _obj_parts,
    ".dae": lambda path: _Collada(path).read(),
}
