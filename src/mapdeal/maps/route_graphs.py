"""Route graphs as GeoJSON, as Nav2's route server reads them.

References
----------
nav2_route of navigation2 a3a97043ee93: ``GeoJsonGraphFileLoader``, the edge scorers and operations.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mapdeal import errors
from mapdeal.files.json_values import ROUTE_GRAPH, JsonValue, is_route_graph, read_document
from mapdeal.files.transaction import Transaction
from mapdeal.grid.route_graph import RouteEdge, RouteGraph, RouteNode
from mapdeal.maps.kinds import recognised

_MOST_ID = (1 << 32) - 1  # the server's ids are unsigned int
FRAME = "map"  # the server's route_frame, and the default frame of nodes


class GraphProblem(NamedTuple):
    """A reason why the server refuses a file, or a value that it reads in an unexpected way."""

    check: str  # name of lint's check without ``graph.``
    text: str
    point: tuple[float, float] | None = None  # place on the map


class GraphFile(NamedTuple):
    """The readable part of a graph, without edges that lack an end, and the file's problems."""

    graph: RouteGraph
    problems: tuple[GraphProblem, ...] = ()


def read_route_graph(path: Path | str) -> RouteGraph:
    """Read a route graph as Nav2's route server does.

    Parameters
    ----------
    path : path or str
        A GeoJSON file: Points are nodes, LineStrings and MultiLineStrings edges.

    Returns
    -------
    RouteGraph
        Nodes and directed edges.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If the file is malformed or the server refuses it, as where the end of an edge is missing.

    Notes
    -----
    Of several nodes with one id the last one counts, as for the server's edges.
    """
    path = Path(path)
    found = read_graph_file(path)
    for problem in found.problems:
        if problem.check in REFUSED:
            raise errors.MalformedInputError(problem.text, source=path)
    return found.graph


REFUSED = ("refused", "missing-end")  # checks whose findings make the server refuse a file


def read_graph_file(path: Path) -> GraphFile:
    with recognised(path, "a route graph (GeoJSON)", ROUTE_GRAPH):
        return parsed_graph(read_document(path))


def parsed_graph(document: JsonValue) -> GraphFile:
    if not is_route_graph(document.value):
        rule = "is no route graph: none of its features has a startid and an endid"
        raise errors.MalformedInputError(rule, source=document.source)
    try:
        return _Reader().read(document)
    except RecursionError:
        raise errors.MalformedInputError("nested too deep", source=document.source) from None


class _Reader:
    def __init__(self) -> None:
        self.problems: list[GraphProblem] = []
        self.nodes: dict[int, RouteNode] = {}
        self.edges: list[RouteEdge] = []
        self._kinds_by_id: dict[int, set[str]] = {}

    def read(self, document: JsonValue) -> GraphFile:
        lines = []
        for feature in document["features"].items():
            kind = feature["geometry"]["type"].text()
            if kind == "Point":
                self._node(feature)
            elif kind in ("LineString", "MultiLineString"):
                lines.append(feature)  # the nodes at their ends may follow later
        for feature in lines:
            self._edge(feature)
        for kind_name, found in (("node", self.nodes), ("edge", self.edges)):
            if not found:
                self._report("refused", f"the graph has no {kind_name}")
        self._check_scorer_metadata()
        graph = RouteGraph(tuple(self.nodes.values()), tuple(self.edges))
        return GraphFile(graph, tuple(self.problems))

    def _report(self, check: str, text: str, point: tuple[float, float] | None = None) -> None:
        self.problems.append(GraphProblem(check, text, point))

    def _properties(self, feature: JsonValue) -> JsonValue:
        place = f"{feature.place}.properties"
        return feature.get("properties") or JsonValue(feature.source, {}, place)

    def _id(self, properties: JsonValue, key: str, owner: str) -> int | None:
        if (found := properties.get(key)) is None:
            self._report("refused", f"{owner} ({properties.place}) has no {key}")
            return None
        value = found.value
        if type(value) is not int or not 0 <= value <= _MOST_ID:
            rule = f"{key} must be a whole number from 0 on, got {found.json_text()}"
            self._report("refused", f"{owner} ({found.place}): {rule}")
            return None
        return int(value)

    def _note_id(self, number: int, kind: str, point: tuple[float, float] | None) -> None:
        kinds = self._kinds_by_id.setdefault(number, set())
        if kind in kinds:
            self._report("double-id", f"two {kind}s have the id {number}", point)
        elif kinds:
            self._report("shared-id", f"a node and an edge have the id {number}", point)
        kinds.add(kind)

    def _node(self, feature: JsonValue) -> None:
        properties = self._properties(feature)
        coordinates = feature["geometry"]["coordinates"].items()
        if len(coordinates) not in (2, 3):
            raise feature["geometry"]["coordinates"].error("must be two numbers [x, y]")
        x, y = (coordinate.number() for coordinate in coordinates[:2])
        if (number := self._id(properties, "id", "a node")) is None:
            return
        self._note_id(number, "node", (x, y))
        frame = properties.get("frame")
        name = FRAME if frame is None else frame.text()
        self.nodes[number] = RouteNode(number, x, y, name, _metadata(properties))

    def _edge(self, feature: JsonValue) -> None:
        properties = self._properties(feature)
        numbers = [self._id(properties, key, "an edge") for key in ("id", "startid", "endid")]
        if None in numbers:
            return
        number, start, end = (number for number in numbers if number is not None)
        ends = [self.nodes[node_id] for node_id in (start, end) if node_id in self.nodes]
        at = (ends[0].x, ends[0].y) if ends else None
        self._note_id(number, "edge", at)
        for verb, node_id in (("starts", start), ("ends", end)):
            if node_id not in self.nodes:
                text = f"edge {number} {verb} at node {node_id}, which does not exist"
                self._report("missing-end", text, at)
        if len(ends) < 2:
            return
        cost, overridable = properties.get("cost"), properties.get("overridable")
        self.edges.append(RouteEdge(
            number, start, end, 0.0 if cost is None else cost.number(),
            True if overridable is None else overridable.flag(), _metadata(properties),
        ))  # fmt: skip

    def _check_scorer_metadata(self) -> None:
        index = {node.id: (node.x, node.y) for node in self.nodes.values()}
        for edge in self.edges:
            for key in FLOATS:
                value = edge.metadata.get(key)
                if type(value) is int:
                    text = (f"edge {edge.id}: {key} {value} is a whole number, on which the scorer "
                            f"throws; write {value}.0")  # fmt: skip
                    self._report("whole-number", text, index[edge.start])
        with_limit = [edge for edge in self.edges if "speed_limit" in edge.metadata]
        if 0 < len(with_limit) < len(self.edges):
            text = (f"{len(with_limit)} of {len(self.edges)} edges have a speed_limit: "
                    "DistanceScorer divides their lengths by it, so it must stand on all or none; "
                    "100.0 is no limit")  # fmt: skip
            self._report("mixed-limits", text, index[with_limit[0].start])


FLOATS = ("speed_limit", "abs_speed_limit", "penalty")  # in metadata of edges, for scorers


def _metadata(properties: JsonValue) -> Mapping[str, Any]:
    fields = properties.optional("metadata", JsonValue.fields) or {}
    return {key: field.value for key, field in fields.items()}


def write_route_graph(path: Path | str, graph: RouteGraph, *, force: bool = False) -> None:
    """Write a route graph as GeoJSON, for Nav2's route server and `route`.

    Parameters
    ----------
    path : path or str
        File to write.
    graph : RouteGraph
        The graph, such as ``mapdeal.graph(...).graph``.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    FileAccessError
        If the file exists and `force` is not set, or it cannot be written.
    """
    with Transaction([Path(path)], force=force) as transaction:
        write_graph(transaction, Path(path), graph)


def write_graph(transaction: Transaction, output: Path, graph: RouteGraph) -> None:
    transaction.write_parts(output, (f"{line}\n".encode() for line in graph_text(graph)))


def graph_text(graph: RouteGraph) -> Iterator[str]:
    last = len(graph.nodes) + len(graph.edges)
    yield '{"type": "FeatureCollection", "name": "route_graph", "features": ['
    for number, (properties, kind, coordinates) in enumerate(_features(graph), start=1):
        geometry = f'{{"type": "{kind}", "coordinates": {coordinates}}}'
        feature = f'{{"type": "Feature", "properties": {{{properties}}}, "geometry": {geometry}}}'
        yield feature + ("," if number < last else "")
    yield "]}"


def _features(graph: RouteGraph) -> Iterator[tuple[str, str, str]]:
    """Yield the properties, kind and coordinates of each feature as JSON text."""
    # formatting features by hand takes half the time of json.dumps
    encode = json.JSONEncoder(ensure_ascii=False, check_circular=False).encode
    places = {node.id: encode([node.x, node.y]) for node in graph.nodes}
    for node in graph.nodes:
        metadata = f', "metadata": {encode(dict(node.metadata))}' if node.metadata else ""
        properties = f'"id": {node.id}, "frame": {encode(node.frame)}{metadata}'
        yield properties, "Point", places[node.id]
    last_metadata, metadata = None, ""  # edges there and back have the same metadata
    for edge in graph.edges:
        if edge.metadata is not last_metadata:
            last_metadata = edge.metadata
            metadata = f', "metadata": {encode(dict(last_metadata))}' if last_metadata else ""
        properties = f'"id": {edge.id}, "startid": {edge.start}, "endid": {edge.end}, '
        properties += f'"cost": {float(edge.cost)!r}, "overridable": {encode(edge.overridable)}'
        line = f"[[{places[edge.start]}, {places[edge.end]}]]"
        yield properties + metadata, "MultiLineString", line
