"""Solids of simulated worlds, in one frame: SDF, URDF, and single meshes.

References
----------
SDFormat 1.11, "Pose Frame Semantics" and "Model composition"; Gazebo Classic 11, for ``<state>``
and the environment variables of its models; "XML Robot Description Format (URDF)", ROS.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning, nearest_hint
from mapdeal.files.source import absolute_path, claim, contents_of, exists, is_folder, is_regular
from mapdeal.grid.frame import FARTHEST
from mapdeal.kernels.arrays import Floats, Integers
from mapdeal.kernels.rotations import product, rotated
from mapdeal.maps.kinds import WORLD, recognised
from mapdeal.records import dataclass, field
from mapdeal.sensors import meshes
from mapdeal.sensors.meshes import MESH_ENDINGS, Part, malformed, matrix_of, numbers_in

_VARIABLES = (
    "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH",
    "GAZEBO_RESOURCE_PATH", "ROS_PACKAGE_PATH",
)  # fmt: skip
_OF_GAZEBO = ("sun", "ground_plane")  # models that worlds include and simulators fetch
_PARENTS = 5  # folders above a file that may hold its models
_CHORD = 0.0002  # metres between a curve and the chords that stand for it
_BESIDE = 1.0  # metres of a plane around everything else
_MOST_MODELS = 1 << 16
_TRUE = ("1", "true")
_CLOSED = 1e-6  # of the area of a solid: largest sum of its vectors of area
_DEEPEST = 32  # files that include each other


@dataclass(frozen=True)
class World:
    """Surfaces of a world, metres: triangles, shape (N, 3, 3), and the solid of each."""

    triangles: Floats
    solids: Integers
    files: tuple[Path, ...]
    solid_count: int
    moving: int  # models that were left out because they can move


@dataclass
class _Scope:
    """A model or world: poses of its frames, relative to others, and the models in it."""

    element: Element
    folder: Path
    path: Path
    place: str
    is_static: bool
    frames: dict[str, tuple[str, Floats]] = field(default_factory=dict)
    models: dict[str, _Scope] = field(default_factory=dict)

    def pose_of(self, name: str) -> Floats:
        pose, passed = np.eye(4), set()
        while name not in ("", "__model__", "world", "__root__"):
            head, _, tail = name.partition("::")
            if name not in self.frames and head in self.models:
                name, relative = head, self.models[head].pose_of(tail)
            elif name in self.frames and name not in passed:
                passed.add(name)
                name, relative = self.frames[name]
            else:
                rule = "depends on itself" if name in passed else "must be a frame here"
                hint = None if name in passed else nearest_hint(name, self.frames)
                raise malformed(self.path, rule, f"{self.place}: relative_to", got=name, hint=hint)
            pose = product(relative, pose)
        return pose


class _Reader:
    def __init__(self, folders: Sequence[Path], tag: str, *, static_only: bool) -> None:
        variables = (os.environ.get(name, "") for name in _VARIABLES)
        known = [Path(part) for text in variables for part in text.split(os.pathsep) if part]
        shares = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        known += [Path(part) / "share" for part in shares if part]
        self.folders = [*folders, *known]
        self.tag, self.static_only = tag, static_only
        self.files: dict[Path, None] = {}
        self.roots: dict[Path, Element] = {}
        self.meshes: dict[Path, list[Part]] = {}
        self.shapes: list[tuple[Floats, int]] = []
        self.planes: list[tuple[Floats, Floats, int]] = []
        self.count = self.moving = self.bytes = 0
        self.skipped: list[str] = []
        self._open: list[Path] = []

    def root_of(self, path: Path) -> Element:
        if path in self.roots:
            return self.roots[path]
        self.files[path] = None
        root = self.roots[path] = meshes.read_xml(path)
        for element in root.iter():
            texts = (element.text or "", *element.attrib.values())
            is_open = any(mark in text for text in texts for mark in ("${", "$("))
            if is_open or element.tag.startswith("xacro:"):
                hint = f"xacro {path} > expanded.urdf expands it"
                raise malformed(path, "is xacro that is not expanded", element.tag, hint=hint)
        return root

    def read_sdf(self, path: Path, root: Element) -> None:
        world = root.find("world")
        if len(root.findall("world")) > 1:
            raise malformed(path, "must have one world", "sdf")
        scope = self._scope(root if world is None else world, path, "", is_static=False)
        for state in scope.element.iterfind("state/model"):  # in worlds that Gazebo has saved
            name = state.get("name", "")
            place = f"state: model {name}"
            if name not in scope.models or state.find("pose") is None:
                continue
            pose, frames = self._pose(state, path, place)[1], scope.models[name].frames
            scope.frames[name] = "", pose
            for link in state.iterfind("link"):  # their poses are those in the world
                if link.get("name") in frames and link.find("pose") is not None:
                    moved_link = self._pose(link, path, f"{place}: link {link.get('name')}")[1]
                    frames[link.get("name", "")] = "", product(_inverse(pose), moved_link)
            if (self._numbers(state, "scale", path, place, 3, "1 1 1") != 1).any():
                self.skipped.append(f"{place}: scale")
            inner = state.iterfind(".//model")
            self.skipped += [f"{place}: model {part.get('name')}" for part in inner]
        for part in scope.element.iterfind("state/insertions/*"):
            self.skipped.append(f"state: inserted {part.tag} {part.get('name')}")
        self._add_links(scope, np.eye(4))

    def _scope(self, element: Element, path: Path, place: str, *, is_static: bool) -> _Scope:
        scope = _Scope(element, path.parent, path, place or element.tag, is_static)
        joint_names = set()
        for child in element:
            name = child.get("name", "")
            here = f"{place}: {child.tag} {name}" if place else f"{child.tag} {name}"
            if child.tag == "joint" and name in scope.frames:
                continue  # old models name joints like links
            if child.tag in ("link", "joint", "frame"):
                if child.tag == "joint":
                    joint_names.add(name)
                elif not name or (name in scope.frames and name not in joint_names):
                    # poses are relative to names
                    raise malformed(path, "must have a name that no other element has", here)
                else:  # it replaces a joint of the same name
                    joint_names.discard(name)
                relative_to, pose = self._pose(child, path, here)
                default = child.findtext("child") or "" if child.tag == "joint" else ""
                default = child.get("attached_to") or default.strip()
                scope.frames[name] = relative_to or default, pose
            elif child.tag == "model":
                own = child.findtext("static", "").strip() in _TRUE
                inner = self._scope(child, path, here, is_static=is_static or own)
                self._place_model(scope, inner, name, child, here)
            elif child.tag == "include":
                self._include(scope, child, here)
            elif child.tag in ("actor", "population", "road"):
                self.skipped.append(here)
        return scope

    def _place_model(
        self, scope: _Scope, inner: _Scope, name: str, element: Element, place: str
    ) -> None:
        relative_to, pose = self._pose(element, scope.path, place)
        frame = element.get("placement_frame") or element.findtext("placement_frame", "").strip()
        if frame:
            pose = product(pose, _inverse(inner.pose_of(frame)))
        if not name or name in scope.frames:  # Gazebo renames included models of one name
            name = f"{name}_{self.count}"
        scope.frames[name], scope.models[name] = (relative_to, pose), inner
        self.count += 1
        if self.count > _MOST_MODELS:
            raise malformed(scope.path, f"must have at most {_MOST_MODELS} models", place)

    def _include(self, scope: _Scope, include: Element, place: str) -> None:
        uri = (include.findtext("uri") or "").strip()
        place = f"{place.rstrip()} {uri[:200]}"
        try:
            path = self._file_of(uri, scope.path, place)
        except FileAccessError:
            name = uri.rpartition("/")[2].lower().replace(" ", "_")
            if name not in _OF_GAZEBO:
                raise
            if name == "ground_plane":
                _, pose = self._pose(include, scope.path, place)
                self.add_plane(pose[:3, 3], pose[:3, 2], 100.0)
            return
        if is_folder(path):
            path = self._file_in_model(path, scope.path, place)
        if path in self._open or len(self._open) >= _DEEPEST:
            raise malformed(scope.path, "includes itself", place)
        root = self.root_of(path)
        if root.tag == "robot":
            raise malformed(path, "must be SDF: build the map of a URDF by itself", place)
        model = root.find("model")
        parts = [part for part in root if part.tag in ("model", "actor") and part is not model]
        self.skipped += [f"{place}: {part.tag} {part.get('name')}" for part in parts]
        if model is None:
            if not parts and root.find("light") is None:
                raise malformed(path, "has no model", root.tag)
            return
        name = (include.findtext("name") or model.get("name") or "").strip()
        own = (include.findtext("static") or model.findtext("static") or "").strip()
        is_static = scope.is_static or own in _TRUE
        self._open.append(path)
        inner = self._scope(model, path, f"model {name}", is_static=is_static)
        self._open.pop()
        # a pose of the include replaces that of the model
        is_placed = include.find("pose") is not None or include.find("placement_frame") is not None
        self._place_model(scope, inner, name, include if is_placed else model, place)
        if include.get("merge") in _TRUE:
            for frame in inner.frames:
                scope.frames.setdefault(frame, (name, inner.pose_of(frame)))

    def _file_in_model(self, folder: Path, source: Path, place: str) -> Path:
        """Return the SDF of a model's folder: the newest that its model.config lists."""
        config, names = folder / "model.config", []
        if is_regular(config):
            listed = sorted(
                ([int(word) for word in re.findall(r"[0-9]+", sdf.get("version", ""))], sdf.text)
                for sdf in self.root_of(config).iter("sdf") if sdf.text
            )  # fmt: skip
            names = [name.strip() for _, name in listed[::-1]]
        names += ["model.sdf", *(n for n in contents_of(folder)[1] if n.endswith(".sdf"))]
        for name in names:
            if is_regular(folder / name):
                return folder / name
        raise FileAccessError(f"{folder} has no .sdf", source=source, place=place)

    def _add_links(self, scope: _Scope, matrix: Floats) -> None:
        for link in scope.element.iterfind("link"):
            for shape in link.iterfind(self.tag):
                place = f"{scope.place}: link {link.get('name')}: {self.tag} {shape.get('name')}"
                relative_to, pose = self._pose(shape, scope.path, place)
                at = product(scope.pose_of(relative_to or link.get("name", "")), pose)
                self._add_geometry(shape, product(matrix, at), scope.path, place)
        for name, model in scope.models.items():
            if self.static_only and not model.is_static:
                self.moving += 1
            else:
                self._add_links(model, product(matrix, scope.pose_of(name)))

    def _pose(self, element: Element, path: Path, place: str) -> tuple[str, Floats]:
        """Return the frame that a pose is relative to, and the pose as a matrix."""
        if (pose := element.find("pose")) is None:
            return "", np.eye(4)
        relative_to = pose.get("relative_to") or pose.get("frame") or ""
        if not (pose.text or "").strip():
            return relative_to, np.eye(4)
        count = 7 if pose.get("rotation_format") == "quat_xyzw" else 6
        numbers = numbers_in(pose.text, path, f"{place}: pose", count)
        if pose.get("degrees") in _TRUE:
            numbers[3:] = np.radians(numbers[3:])
        return relative_to, _placed(numbers[:3], numbers[3:])

    def read_urdf(self, path: Path, root: Element) -> None:
        joints = {}
        links = {link.get("name", "") for link in root.iterfind("link")}
        for joint in root.iterfind("joint"):
            place = f"joint {joint.get('name')}"
            parent, child = (
                element.get("link", "") if (element := joint.find(tag)) is not None else ""
                for tag in ("parent", "child")
            )
            for tag, name in (("parent", parent), ("child", child)):
                if name not in links:
                    hint, where = nearest_hint(name, links), f"{place}: {tag}"
                    raise malformed(path, "must be a link here", where, got=name, hint=hint)
            if child in joints:
                raise malformed(path, "must be the only joint of its child", place, got=child)
            joints[child] = parent, self._origin(joint, path, place)
        if len(roots := sorted(links - joints.keys())) > 1:
            got = ", ".join(roots[:8])
            raise malformed(path, "must have one link without a parent", "robot", got=got)
        poses: dict[str, Floats] = {}
        for link in root.iterfind("link"):
            name, chain = link.get("name", ""), {}
            while name in joints and name not in poses:
                if name in chain:
                    raise malformed(path, "depends on itself", f"link {name}")
                parent, chain[name] = joints[name]
                name = parent
            matrix = poses.get(name, np.eye(4))
            for name, pose in reversed(chain.items()):
                matrix = poses[name] = product(matrix, pose)
            for number, shape in enumerate(link.iterfind(self.tag)):
                place = f"link {link.get('name')}: {self.tag} {shape.get('name') or number}"
                at = product(matrix, self._origin(shape, path, place))
                self._add_geometry(shape, at, path, place)

    def _origin(self, element: Element, path: Path, place: str) -> Floats:
        if (origin := element.find("origin")) is None:
            return np.eye(4)
        move, angles = (
            numbers_in(origin.get(key, "0 0 0"), path, f"{place}: origin: {key}", 3)
            for key in ("xyz", "rpy")
        )
        return _placed(move, angles)

    def _add_geometry(self, shape: Element, matrix: Floats, path: Path, place: str) -> None:
        geometry = shape.find("geometry")
        for child in () if geometry is None else geometry:
            here = f"{place}: {child.tag}"
            if child.tag in ("empty", "polyline"):
                continue
            if child.tag == "mesh":
                self._add(self._mesh(child, path, here), matrix)
            elif child.tag == "plane":
                normal = self._numbers(child, "normal", path, here, 3, "0 0 1")
                if not normal.any():
                    raise malformed(path, "must not be 0 0 0", here)
                size = self._numbers(child, "size", path, here, 2, "1 1")
                turned = np.einsum("ij,j->i", matrix[:3, :3], normal / np.linalg.norm(normal))
                self.add_plane(matrix[:3, 3], turned, float(size.max()))
            elif child.tag in _SHAPES:
                keys, make = _SHAPES[child.tag]
                values = [self._numbers(child, key, path, here, n) for key, n in keys.items()]
                if np.concatenate(values).min() <= 0:
                    raise malformed(path, "must be above 0", here)
                self._add(make(*values), matrix)
            else:
                known = ", ".join([*_SHAPES, "plane", "polyline", "mesh"])
                hint = nearest_hint(child.tag, known.split(", ")) or f"shapes are {known}"
                rule = "is not supported" if child.tag in ("heightmap", "image") else "is no shape"
                raise malformed(path, rule, here, hint=hint)
        lines = [] if geometry is None else geometry.findall("polyline")
        if lines:
            self._add(self._polylines(lines, path, f"{place}: polyline"), matrix)

    def _add(self, triangles: Floats, matrix: Floats) -> None:
        if len(self.shapes) > meshes.MOST_INSTANCES:
            raise MalformedInputError(f"has more than {meshes.MOST_INSTANCES} shapes")
        self.bytes += triangles.nbytes
        claim(next(iter(self.files)), 3 * self.bytes, what="its triangles")
        number = len(self.shapes) + len(self.planes)
        self.shapes.append((meshes.transform_triangles(matrix, triangles), number))

    def add_plane(self, point: Floats, normal: Floats, side: float) -> None:
        self.planes.append((np.append(point, side), normal, len(self.shapes) + len(self.planes)))

    def _numbers(
        self, shape: Element, key: str, path: Path, place: str, count: int, default: str = ""
    ) -> Floats:
        """Return numbers of a shape: an element in SDF, an attribute in URDF."""
        text = shape.get(key) or shape.findtext(key) or default
        return numbers_in(text, path, f"{place}: {key}", count)

    def _polylines(self, lines: list[Element], path: Path, place: str) -> Floats:
        """Return the walls and caps of an outline, and the walls of holes in it."""
        rings, triangles = [], []
        height = self._numbers(lines[0], "height", path, place, 1, "1")[0]
        for line in lines:
            texts = [point.text for point in line.iterfind("point")]
            points = np.array([numbers_in(text, path, f"{place}: point", 2) for text in texts])
            if len(points) < 3:
                raise malformed(path, "must have 3 points or more", place, got=len(points))
            rings.append(np.insert(points, 2, height, axis=1))
        for ring in rings:
            depth = sum(_holds(outer, ring[0]) for outer in rings if outer is not ring)
            x, y, after = *ring[:, :2].T, np.roll(ring, -1, axis=0)
            runs_left = (x * after[:, 1] - y * after[:, 0]).sum() > 0
            begin, end = (ring, after) if runs_left == (depth % 2 == 0) else (after, ring)
            low, low_end = (upper * [1, 1, 0] for upper in (begin, end))
            sides = (low, low_end, end), (low, end, begin)
            triangles += [np.stack(corners, axis=1) for corners in sides]
        cap = meshes.strips_of(rings, path)
        return np.concatenate([*triangles, cap, cap[:, ::-1] * [1, 1, 0]])

    def _mesh(self, mesh: Element, path: Path, place: str) -> Floats:
        uri = (mesh.get("filename") or mesh.findtext("uri") or "").strip()
        file = self._file_of(uri, path, f"{place} {uri[:200]}")
        if file not in self.meshes:
            self.meshes[file] = self.read_parts(file)
        if mesh.get("optimization"):  # into convex parts
            self.skipped.append(f"{place}: optimization")
        parts, submesh = self.meshes[file], mesh.find("submesh")
        if submesh is not None:
            name = (submesh.findtext("name") or "").strip()
            known = sorted({part_name for part in parts for part_name in part.names if part_name})
            if not (parts := [part for part in parts if name in part.names]):
                hint = nearest_hint(name, known)
                place += ": submesh"
                raise malformed(path, f"must be a part of {file}", place, got=name, hint=hint)
        triangles = np.concatenate([part.triangles for part in parts])
        if submesh is not None and (submesh.findtext("center") or "").strip() in _TRUE:
            triangles = triangles - (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2
        scale = self._numbers(mesh, "scale", path, place, 3, "1 1 1")
        return meshes.transform_triangles(np.diag([*scale, 1.0]), triangles)

    def read_parts(self, file: Path) -> list[Part]:
        if file.suffix.lower() not in MESH_ENDINGS:
            raise MalformedInputError(f"must be a mesh: {', '.join(MESH_ENDINGS)}", source=file)
        self.files[file] = None
        with recognised(file, "a mesh", WORLD):
            return meshes.read_mesh(file)

    def _file_of(self, uri: str, source: Path, place: str) -> Path:
        scheme, mark, name = uri.partition("://")
        if not mark:
            scheme, name = "", uri
        elif scheme in ("http", "https"):  # of a model on Fuel, which may be on this machine too
            scheme = "model"
            name = re.sub(r"^([^/]*)/\w+/files/", r"\1/", name.partition("/models/")[2])
        above = list(absolute_path(source).parents)[:_PARENTS]
        near = [folder / part for folder in above for part in ("", "models")]
        bases = [source.parent, *self.folders, *near]
        if not name or scheme not in ("", "file", "model", "package"):
            rule = "must name a file by model://, package://, file:// or its path"
            hint = f"--model-path DIR finds models by model://{Path(name).name}"
            raise FileAccessError(rule, source=source, place=place, hint=hint)
        if scheme in ("model", "package"):
            bases = bases[1:]
        for base in bases:
            for path in (base / name, base / unquote(name)):
                if exists(path):  # an absolute path replaces the folder
                    return path
        first = name.lstrip("/").partition("/")[0]
        hint = f"--model-path DIR names the folder in which {first[:200]} is"
        raise FileAccessError("there is no such file", source=source, place=place, hint=hint)

    def world(self) -> World:
        if not self.shapes and not self.planes:
            hint = "--visual takes what is seen" if self.tag == "collision" else None
            raise MalformedInputError(f"has no {self.tag} shapes", hint=hint)
        parts = list(self.shapes)
        everything = [triangles.reshape(-1, 3) for triangles, _ in self.shapes]
        for (*point, side), normal, number in self.planes:
            around = everything or [np.array([point]) + np.array([[-side], [side]]) / 2]
            low = np.min([points.min(axis=0) for points in around], axis=0) - _BESIDE
            high = np.max([points.max(axis=0) for points in around], axis=0) + _BESIDE
            parts.append((_patch(np.array(point), normal, low, high), number))
        solids = np.repeat([number for _, number in parts], [len(part) for part, _ in parts])
        triangles, count = np.concatenate([part for part, _ in parts]), len(np.unique(solids))
        if not np.abs(triangles).max() <= FARTHEST:  # refuses nan too
            raise MalformedInputError(f"must lie within {FARTHEST:g} m")
        # closed solids that are inside out are turned
        a, b, c = (triangles - triangles.mean(axis=(0, 1))).transpose(1, 0, 2)
        areas = np.cross(b - a, c - a)
        lengths = np.bincount(solids, np.sqrt((areas**2).sum(axis=1)))
        sums = np.stack([np.bincount(solids, areas[:, axis]) for axis in range(3)])
        is_closed = np.abs(sums).max(axis=0) <= _CLOSED * lengths
        is_inverted = (is_closed & (np.bincount(solids, (a * areas).sum(axis=1)) < 0))[solids]
        triangles = np.where(is_inverted[:, np.newaxis, np.newaxis], triangles[:, ::-1], triangles)
        return World(triangles, solids, tuple(self.files), count, self.moving)


def _placed(move: Floats, angles: Floats) -> Floats:
    """Return the matrix of a pose: roll, pitch and yaw in radians, or a quaternion x, y, z, w."""
    if len(angles) == 3:
        (sr, sp, sy), (cr, cp, cy) = np.sin(angles / 2).tolist(), np.cos(angles / 2).tolist()
        x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
        angles = np.array([x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy])
    return matrix_of(rotated(angles / (np.linalg.norm(angles) or 1.0), np.eye(3)).T, move)


def _inverse(pose: Floats) -> Floats:
    turn = pose[:3, :3].T
    return matrix_of(turn, -(turn * pose[:3, 3]).sum(axis=1))


def _patch(point: Floats, normal: Floats, low: Floats, high: Floats) -> Floats:
    """Return a plane as far as a box: a rectangle of two triangles."""
    if abs(normal[2]) > 0.5:  # a floor
        x = np.array([low[0], high[0], high[0], low[0]])
        y = np.array([low[1], low[1], high[1], high[1]])
        z = point[2] - ((x - point[0]) * normal[0] + (y - point[1]) * normal[1]) / normal[2]
        corners = np.stack([x, y, z], axis=1)
    else:
        along = np.array([-normal[1], normal[0], 0.0]) / math.hypot(normal[0], normal[1])
        up, half = np.cross(normal, along), float(np.linalg.norm(high - low)) / 2
        middle = (low + high) / 2
        middle = middle - normal * float(((middle - point) * normal).sum())
        corners = middle + half * np.array([-along - up, along - up, along + up, up - along])
    return np.asarray(corners[[[0, 1, 2], [0, 2, 3]]])


def _holds(ring: Floats, point: Floats) -> bool:
    after = np.roll(ring, -1, axis=0)
    crosses = (ring[:, 1] > point[1]) != (after[:, 1] > point[1])
    begin, end = ring[crosses], after[crosses]
    share = (point[1] - begin[:, 1]) / (end[:, 1] - begin[:, 1])
    return bool((begin[:, 0] + share * (end[:, 0] - begin[:, 0]) > point[0]).sum() % 2)


def _chord_count(radius: float) -> int:
    return 4 * min(256, max(4, math.ceil(math.pi / 4 * math.sqrt(radius) / math.sqrt(2 * _CHORD))))


def _revolved(profile: Sequence[tuple[float, float]], sides: int) -> Floats:
    """Return the surface of revolution of radii and heights, from the lowest to the highest."""
    angles = np.arange(sides) * (2 * math.pi / sides)
    radii, heights = np.array(profile).T[:, :, np.newaxis]
    radii = radii * (2 / (1 + math.cos(math.pi / sides)))  # chords as far inside as corners outside
    x, y = radii * np.cos(angles), radii * np.sin(angles)
    rings = np.stack([x, y, np.broadcast_to(heights, x.shape)], axis=2)
    after = np.roll(rings, -1, axis=1)
    quads = np.stack([rings[:-1], after[:-1], after[1:], rings[1:]], axis=2).reshape(-1, 4, 3)
    triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    first, second, third = triangles.transpose(1, 0, 2)
    is_flat = [(a == b).all(axis=1) for a, b in ((first, second), (second, third), (third, first))]
    return np.asarray(triangles[~np.any(is_flat, axis=0)])


def _ball(radius: float, length: float = 0.0) -> Floats:
    """Return a ball, or a capsule whose cylinder has a length."""
    angles = np.linspace(0.0, math.pi / 2, _chord_count(radius) // 4 + 1)
    radii, heights = radius * np.cos(angles), radius * np.sin(angles) + length / 2
    radii[-1] = 0.0
    lower, upper = zip(radii[::-1], -heights[::-1], strict=True), zip(radii, heights, strict=True)
    return _revolved([*lower, *upper], _chord_count(radius))


_FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def _box(size: Floats) -> Floats:
    corners = np.stack([np.arange(8) & 1, np.arange(8) >> 1 & 1, np.arange(8) >> 2], axis=1) - 0.5
    return np.asarray((corners * size)[np.array(_FACES)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)])


def _cone(radius: float, length: float, upper: float = 0.0) -> Floats:
    rows = [(0, -length / 2), (radius, -length / 2), (upper, length / 2), (0, length / 2)]
    return _revolved(rows, _chord_count(radius))


_SHAPES: dict[str, tuple[dict[str, int], Callable[..., Floats]]] = {
    "box": ({"size": 3}, _box),
    "cylinder": ({"radius": 1, "length": 1}, lambda r, length: _cone(r[0], length[0], r[0])),
    "sphere": ({"radius": 1}, lambda radius: _ball(radius[0])),
    "capsule": ({"radius": 1, "length": 1}, lambda radius, length: _ball(radius[0], length[0])),
    "ellipsoid": ({"radii": 3}, lambda radii: _ball(radii.max()) * radii / radii.max()),
    "cone": ({"radius": 1, "length": 1}, lambda radius, length: _cone(radius[0], length[0])),
}


def read_world(
    path: Path, *, model_path: Sequence[Path] = (), visual: bool = False, static_only: bool = False,
    floor: float | None = None,
) -> World:  # fmt: skip
    """Return the solids of a world, and with a floor a horizontal plane at its height."""
    reader = _Reader(model_path, "visual" if visual else "collision", static_only=static_only)
    if path.suffix.lower() in MESH_ENDINGS:
        for part in reader.read_parts(path):
            reader.shapes.append((part.triangles, 0))
    else:
        with recognised(path, "a world", WORLD):
            root = reader.root_of(path)
        if root.tag == "robot":
            reader.read_urdf(path, root)
        elif root.tag == "sdf":
            reader.read_sdf(path, root)
        else:
            raise malformed(path, "must be sdf or robot (URDF)", "first element", got=root.tag)
    if floor is not None:
        reader.add_plane(np.array([0.0, 0.0, floor]), np.array([0.0, 0.0, 1.0]), 1.0)
    if reader.skipped:
        text = ", ".join(reader.skipped[:3]) + (", ..." if len(reader.skipped) > 3 else "")
        emit_warning(f"{path}: {len(reader.skipped)} not modelled: {text}")
    return reader.world()
