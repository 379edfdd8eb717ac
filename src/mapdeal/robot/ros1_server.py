"""ROS 1's parameter server as launch files fill it, and reading it as roscpp does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Literal, TypeVar

from mapdeal.errors import MalformedInputError
from mapdeal.formats.ros_parameters.problem import Problem
from mapdeal.formats.ros_parameters.ros1 import (
    ROOT,
    UNSENDABLE,
    Path1,
    Ros1File,
    Ros1Namespace,
    merge,
    read_ros1_parameters,
)
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.records import dataclass
from mapdeal.robot.parameters import CostmapName

COSTMAPS = ("global_costmap", "local_costmap")
_NODE = "move_base"
_SUBSTITUTION = "$("
_KINDS = {
    "bool": "true or false", "int": "a whole number", "double": "a number", "string": "text",
}  # fmt: skip

Value = TypeVar("Value", bool, int, float, str)


@dataclass
class Ros1Server:
    """The parameters of one robot, and what was found wrong while they were read."""

    node: Path1
    costmap: CostmapName
    files: tuple[Ros1File, ...] = ()
    root: Ros1Namespace = field(default_factory=Ros1Namespace)
    problems: list[Problem] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The costmap's own namespace, as ROS prints it."""
        return "/" + "/".join(self.path)

    @property
    def path(self) -> Path1:
        """The costmap's own namespace."""
        return (*self.node, f"{self.costmap}_costmap")

    def find(self, *below: str) -> ParameterValue | None:
        """Return a parameter below the costmap; namespaces are none."""
        found = self.root.get((*self.path, *below))
        return found if isinstance(found, ParameterValue) else None

    def has(self, *below: str) -> bool:
        """Return whether there is a parameter or a namespace of this name below the costmap."""
        return self.root.get((*self.path, *below)) is not None

    def search(self, name: str) -> tuple[Path1, ParameterValue | Ros1Namespace] | None:
        """Return what ``searchParam`` finds: in the costmap's namespace, or the nearest above."""
        for depth in range(len(self.path), -1, -1):
            place = self.path[:depth]
            found = self.root.get((*place, name))
            if found is not None:
                return place, found
        return None

    def boolean(self, default: bool, *below: str) -> bool:
        """Return a parameter as ``param(name, bool, default)`` does: other types leave that."""
        return self._typed(default, "bool", below)

    def double(self, default: float, *below: str, unit: str = "") -> float:
        """Return a number as ``param(name, double, default)`` does: whole numbers are numbers."""
        return self._typed(default, "double", below, unit)

    def integer(self, default: int, *below: str) -> int:
        """Return a whole number as ``param(name, int, default)`` does: others are rounded."""
        value = self.find(*below)
        if value is None or value.kind != "double" or not math.isfinite(value.value):
            return self._typed(default, "int", below)
        number = float(value.value)
        # roscpp's own rounding: fmod of a number below 0 is never 0.5 or more
        whole: int = math.floor(number) if math.fmod(number, 1.0) < 0.5 else math.ceil(number)
        if whole != number:
            text = f"must be a whole number; roscpp rounds it to {whole}"
            self.problem("params.silent-default", "warning", text, value, below)
        return whole

    def _typed(self, default: Value, kind: str, below: Path1, unit: str = "") -> Value:
        value = self.find(*below)
        if value is None:
            return default
        fits = ("double", "int") if kind == "double" else (kind,)
        if value.kind == UNSENDABLE:
            return default
        if isinstance(value.value, float) and not math.isfinite(value.value):
            self.problem("params.not-finite", "refused", "must be finite", value, below)
            return default
        if value.kind in fits:
            return type(default)(value.value)
        self._wrong_type(value, kind, below, f"{shown_default(default)}{unit}")
        return default

    def _wrong_type(self, value: ParameterValue, kind: str, below: Path1, default: str) -> None:
        if value.kind == "string" and _SUBSTITUTION in value.value:
            text = f"must be {_KINDS[kind]}, which a launch file would replace"
            hint = "write the value itself, in this file or in one that comes after it"
            self.problem("params.substitution", "refused", text, value, below, hint)
            return
        text = f"must be {_KINDS[kind]}; roscpp silently uses its default, {default}"
        self.problem("params.silent-default", "warning", text, value, below, type_hint(value, kind))

    def problem(
        self,
        check: str,
        level: Literal["refused", "warning", "note"],
        text: str,
        value: ParameterValue | Ros1Namespace | None = None,
        below: Path1 = (),
        hint: str | None = None,
    ) -> None:
        """Add a problem, at the place of a value."""
        got = value.text if isinstance(value, ParameterValue) else None
        source, line = (None, None) if value is None else (value.source, value.line or None)
        if source is None and self.files:
            source = self.files[-1].source
        self.problems.append(
            Problem(check, level, text, "/".join(below), source, line, got or None, hint)
        )


def shown_default(value: object) -> str:
    """Return a default as YAML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, float) else str(value)


def type_hint(value: ParameterValue, kind: str) -> str | None:
    """Return what makes a value of the type that is wanted, if that is plain."""
    if kind in ("int", "double") and value.kind == "string":
        try:
            number = float(value.value)
        except ValueError:
            return None
        if not math.isfinite(number):
            return None
        quoted = value.text[:1] in ("'", '"')
        why = "" if quoted else "; YAML 1.1 takes this for text"
        written = repr(number)
        if "." not in written:  # 1e-05 is text, too
            written = written.replace("e", ".0e")
        return f"write {written}{', without quotes' if quoted else why}"
    if kind == "bool" and value.value in (0, 1, "true", "false", "True", "False"):
        return f"write {'true' if value.value in (1, 'true', 'True') else 'false'}"
    return None


def load_server(
    paths: Sequence[Path], costmap: CostmapName, namespace: str | None
) -> tuple[Ros1Server, bool]:
    """Return the parameter server after files were loaded, and whether the robot is in it."""
    files, problems = [], []
    for path in paths:
        try:
            one = read_ros1_parameters(path)
        except MalformedInputError as error:
            problems.append(_of_error(error, path))
            continue
        problems += one.faults
        files.append(one)
    owners = [_nodes_in(one.parameters) for one in files]
    node, why_not = _chosen_node([node for found in owners for node in found], namespace)
    server = Ros1Server(node, costmap, tuple(files), problems=problems)
    if why_not is not None:
        server.problems.append(why_not)
        return server, False
    for one, found in zip(files, owners, strict=True):
        if not found and len(files) > 1 and costmap_of_name(one.source) not in (None, costmap):
            text = "is left out: by its name it is a file of the other costmap; "
            text += f"{costmap} was requested"
            hint = "pass it with the files of its own costmap only, or rename it"
            server.problems.append(
                Problem("params.other-costmap", "warning", text, source=one.source, hint=hint)
            )
            continue
        merge(server.root, _place_of(found, node, costmap), _without_root(one.parameters))
        absolute = one.parameters.members.get(ROOT)
        if isinstance(absolute, Ros1Namespace):
            merge(server.root, (), absolute)
    return server, len(files) == len(paths)


def costmap_of_name(path: Path) -> CostmapName | None:
    """Return the costmap that a file is of by its name, where nothing else shows it."""
    names: tuple[CostmapName, CostmapName] = ("global", "local")
    found = [name for name in names if name in path.stem.lower()]
    return found[0] if len(found) == 1 else None


def costmaps_named(files: Sequence[Ros1File]) -> tuple[CostmapName, ...]:
    """Return the costmaps that files are of, by what they hold or by their names."""
    named: set[str] = set()
    for one in files:
        own = {path[-1] for path, _ in one.parameters.namespaces()} & set(COSTMAPS)
        of_name = None if own else costmap_of_name(one.source)
        named |= own or ({f"{of_name}_costmap"} if of_name else set())
    names: tuple[CostmapName, CostmapName] = ("global", "local")
    return tuple(name for name in names if f"{name}_costmap" in named)


def _without_root(namespace: Ros1Namespace) -> Ros1Namespace:
    members = {name: one for name, one in namespace.members.items() if name != ROOT}
    return Ros1Namespace(namespace.line, namespace.source, members)


def _nodes_in(namespace: Ros1Namespace) -> list[Path1]:
    """Return the names above a costmap's in a file, those nearest to its top alone."""
    found = [
        path[:-1]
        for path, value in (*namespace.namespaces(), *namespace.values())
        if path[-1] in COSTMAPS
    ]
    nearest = min((len(path) for path in found), default=0)
    return list(dict.fromkeys(path for path in found if len(path) == nearest))


def _chosen_node(
    found: Sequence[Path1], namespace: str | None
) -> tuple[Path1, Problem | None]:  # fmt: skip
    """Return the name of the node that has the costmaps, and why it is not known."""
    plain = {tuple(name for name in path if name != ROOT) for path in found}
    longest = [
        path for path in sorted(plain)
        if path and not any(len(o) > len(path) and o[-len(path) :] == path for o in plain)
    ]  # fmt: skip
    asked = tuple(part for part in (namespace or "").split("/") if part)
    spaces = {path[:-1] for path in longest}
    if namespace is not None:
        if any(asked == space for space in spaces):
            longest = [path for path in longest if path[:-1] == asked]
        elif spaces - {()}:
            names = ", ".join("/".join(space) or "/" for space in sorted(spaces))
            text = f"no robot has the namespace {'/'.join(asked) or '/'}"
            return (*asked, _NODE), Problem("params.namespace", "refused", text,
                                            hint=f"namespaces are {names}")  # fmt: skip
        else:
            longest = [(*asked, *path) for path in longest]
    if len(longest) > 1:
        names = ", ".join("/".join(path) for path in longest)
        text = f"costmaps stand below several names: {names}"
        hint = f"choose one with --namespace {'/'.join(longest[0][:-1])}" if spaces - {()} else None
        return longest[0], Problem("params.namespace", "refused", text, hint=hint)
    return (longest[0] if longest else (*asked, _NODE)), None


def _place_of(found: Sequence[Path1], node: Path1, costmap: CostmapName) -> Path1:
    """Return the namespace that a file is loaded into."""
    if not found:
        return (*node, f"{costmap}_costmap")
    for path in found:
        below = tuple(name for name in path if name != ROOT)
        if len(below) <= len(node) and node[len(node) - len(below) :] == below:
            return node[: len(node) - len(below)]
    return ()  # it names other robots alone


def _of_error(error: MalformedInputError, path: Path) -> Problem:
    """Return an error of the reader as a problem, with its line if it names one."""
    place = error.place or ""
    digits = place.removeprefix("line ").partition(",")[0]
    line = int(digits) if place.startswith("line ") and digits.isdigit() else None
    text = error.rule if line is not None or not place else f"{place}: {error.rule}"
    return Problem("params.syntax", "refused", text, source=path, line=line, hint=error.hint)
