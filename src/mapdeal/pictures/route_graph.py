"""Route graphs over the picture of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.route_graph import RouteGraph
from mapdeal.grid.values import count_text
from mapdeal.pictures.colours import GOAL, MINIMUM, ROUTE, RVIZ_FREE, Colour, Swatch
from mapdeal.pictures.overlay import Brush, Overlay, Surface
from mapdeal.pictures.reach import Captions

_NODE: Colour = (0, 35, 120)
_BELOW: Colour = (60, 72, 88)
_CAPTION = 20  # largest text size of a name, pixels


@dataclass(frozen=True, eq=False)
class GraphOverlay(Overlay):
    """Edges as lines, with an arrow if they are one-way, and nodes as dots.

    Below a route, the graph has one colour.
    """

    graph: RouteGraph
    is_below: bool = False

    @property
    def colours(self) -> tuple[Colour, ...]:
        if self.is_below:
            return (_BELOW, _BELOW, _BELOW, _BELOW, RVIZ_FREE)
        return (ROUTE, _NODE, MINIMUM, GOAL, RVIZ_FREE)

    @property
    def text(self) -> str:
        nodes, edges = (count_text(len(items), word) for items, word in
                        ((self.graph.nodes, "node"), (self.graph.edges, "edge")))  # fmt: skip
        return f"{nodes}, {edges}"

    @property
    def places_xy(self) -> NDArray[np.float64]:
        return self.graph.points_xy

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        line, node, door, goal, paper = (first_index + k for k in range(5))
        brush, graph = Brush(on.pixels), self.graph
        places = on.places(graph.points_xy)
        thickness = max(2, round(on.side / 700))
        ends = graph.ends
        brush.segments(places[ends[:, 0]], places[ends[:, 1]], line, thickness=thickness)
        self._draw_arrows(brush, places, line, length=max(10.0, 6.0 * thickness))
        radius = max(3.0, on.side / 320)
        kinds = [graph_node.metadata.get("kind") for graph_node in graph.nodes]
        for place, kind in zip(places, kinds, strict=True):
            if kind not in ("door", "goal"):
                brush.dot(place, node, radius=radius)
        captions = Captions(on.pixels, int(min(_CAPTION, max(11, on.side / 70))))
        for special, index in (("door", door), ("goal", goal)):
            for place, kind in zip(places, kinds, strict=True):
                if kind == special:
                    brush.dot(place, paper, radius=1.4 * radius + 1)
                    brush.dot(place, index, radius=1.4 * radius)
                    captions.kept_free.dot(place, 1, radius=2 * radius)
        for place, graph_node in zip(places, graph.nodes, strict=True):
            if graph_node.metadata.get("kind") == "goal":
                name = str(graph_node.metadata.get("name", graph_node.id))
                captions.write(name, place, goal, away=2.5 * radius)
        if self.is_below:
            return [Swatch(line, "route graph")]
        legend: Sequence[tuple[bool, int, str]] = (
            (bool(len(ends)), line, "edge"), (True, node, "node"), ("door" in kinds, door, "door"),
            ("goal" in kinds, goal, "goal"),
        )  # fmt: skip
        return [Swatch(index, label) for is_there, index, label in legend if is_there]

    def _draw_arrows(
        self, brush: Brush, places: NDArray[np.float64], index: int, *, length: float
    ) -> None:
        arcs = {(start, end) for start, end in self.graph.ends.tolist()}
        single_arcs = [ends for ends in arcs if ends[::-1] not in arcs]
        if not single_arcs:
            return
        starts, ends = places[np.array(sorted(single_arcs)).T]
        directions = ends - starts
        lengths = np.hypot(*directions.T)
        is_long = lengths > 1.5 * length  # room for an arrow
        middles = (starts + ends)[is_long] / 2
        directions = directions[is_long] / lengths[is_long, np.newaxis]
        for middle, direction in zip(middles, directions, strict=True):
            brush.dart(middle, direction, index, length=length)
