"""Checks of a route graph on its map, for a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.findings import CHECKS, Finding, places_of
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import reach_radius
from mapdeal.grid.reaching import largest_closed_square, nearest_marked, squares_to
from mapdeal.grid.route_graph import RouteGraph, Sweeps, closed_costs
from mapdeal.grid.values import OCCUPIED, UNKNOWN, count_text
from mapdeal.kernels.components import joined
from mapdeal.maps.route_graphs import FRAME, read_graph_file

_MOST = 20  # findings of one check that are told of one by one


def found_in_graph(path: Path, grid: OccupancyGrid, robot: Footprint | None) -> list[Finding]:
    """Return what is wrong with a route graph on a map, for a robot or a point."""
    try:
        file = read_graph_file(path)
    except (MalformedInputError, FileAccessError) as error:
        name = "file.access" if isinstance(error, FileAccessError) else "file.malformed"
        return [CHECKS[name].finding(path, str(error).removeprefix(f"{path}: "))]
    found = [
        CHECKS[f"graph.{one.check}"].finding(
            path, one.text, places=places_of([one.point] if one.point else [])
        )
        for one in file.problems
    ]
    found += _Facts(path, file.graph, grid, robot).findings()
    return [one for name in CHECKS for one in _few([it for it in found if it.check == name])]


def _few(found: Sequence[Finding]) -> Iterator[Finding]:
    """Yield findings of one check; of many the last one stands for all that are left out."""
    yield from found[:_MOST]
    if len(found) > _MOST:
        last, places = found[_MOST], tuple(place for one in found[_MOST:] for place in one.places)
        text = f"{len(found) - _MOST} more of the same, the first of them: {last.message}"
        yield CHECKS[last.check].finding(last.file, text, places=places)


class _Facts:
    def __init__(
        self, path: Path, graph: RouteGraph, grid: OccupancyGrid, robot: Footprint | None
    ) -> None:
        self.path, self.graph, self.frame, self.robot = path, graph, grid.frame, robot
        occupancy = np.asarray(grid.occupancy)
        occupied, unknown = occupancy == OCCUPIED, occupancy == UNKNOWN
        closed = largest_closed_square(reach_radius(robot), grid.frame)
        is_open = (squares_to(occupied) > closed) & ~unknown
        squared = squares_to(occupied | unknown)
        self.sweeps = Sweeps(is_open, closed_costs(occupied, unknown), squared, grid.frame, robot)
        self.occupied, self.unknown = occupied, unknown
        self.cells, self.inside = grid.frame.bounded_rowcol_from_xy(graph.points_xy)

    def finding(self, check: str, text: str, points: Iterable[Sequence[float]]) -> Finding:
        return CHECKS[f"graph.{check}"].finding(self.path, text, places=places_of(points))

    def findings(self) -> Iterator[Finding]:
        if not len(self.graph.nodes):
            return
        frames = sorted({node.frame for node in self.graph.nodes} - {FRAME})
        if frames:
            text = (
                f"nodes have the frame {', '.join(frames)}: the server transforms them to {FRAME}"
            )
            yield self.finding("other-frame", text, ())
        outside = int(np.count_nonzero(~self.inside))
        if 2 * outside > len(self.inside):  # all else would say so again and again
            yield self.finding("other-frame", self._outside_text(outside), ())
            return
        is_closed = np.array([not self._is_open(k) for k in range(len(self.cells))])
        for node in np.flatnonzero(is_closed).tolist():
            yield self.finding("node-closed", self._closed_text(node), [self._point(node)])
        yield from self._blocked(is_closed)
        yield from self._connections()

    def _point(self, node: int) -> Point:
        x, y = self.graph.points_xy[node].tolist()
        return x, y

    def _is_open(self, node: int) -> bool:
        row, col = self.cells[node].tolist()
        return bool(self.inside[node]) and bool(self.sweeps.is_open[row, col])

    def _outside_text(self, outside: int) -> str:
        low, high = self.graph.points_xy.min(axis=0), self.graph.points_xy.max(axis=0)
        height, width = self.frame.shape
        corners = self.frame.xy_from_continuous_rowcol(
            [[0, 0], [0, width], [height, 0], [height, width]]
        )
        first, last = corners.min(axis=0), corners.max(axis=0)
        of_graph = f"x {low[0]:.4g} .. {high[0]:.4g}, y {low[1]:.4g} .. {high[1]:.4g}"
        of_map = f"x {first[0]:.4g} .. {last[0]:.4g}, y {first[1]:.4g} .. {last[1]:.4g}"
        return (
            f"{outside} of {len(self.inside)} nodes lie outside of the map: they cover {of_graph}, "
            f"the map {of_map}; coordinates must be metres in the frame {FRAME}, whatever crs says"
        )

    def _closed_text(self, node: int) -> str:
        number = self.graph.nodes[node].id
        row, col = self.cells[node].tolist()
        if not self.inside[node]:
            (at,) = self.frame.unbounded_rowcol_from_xy(self.graph.points_xy[node : node + 1])
            row, col = at.tolist()
            what = "outside of the map"
        elif self.occupied[row, col]:
            what = "in an obstacle"
        elif self.unknown[row, col]:
            what = "in unknown space"
        else:
            away = float(np.sqrt(self.sweeps.squared[row, col])) * self.frame.resolution
            radius = reach_radius(self.robot)
            what = f"{away:.3g} m from an obstacle, too near for a radius of {radius:.3g} m"
        nearest = nearest_marked(self.sweeps.is_open, (row, col))
        if nearest is None:
            return f"node {number} lies {what}"
        x, y = (self.frame.xy_from_rowcol([nearest])[0].round(3) + 0.0).tolist()
        return f"node {number} lies {what}; the nearest open cell is at {x:.10g},{y:.10g}"

    def _blocked(self, is_closed: NDArray[np.bool_]) -> Iterator[Finding]:
        """Yield edges between open nodes that cannot be driven along, both directions as one."""
        graph = self.graph
        ends = graph.ends
        asked = np.flatnonzero(~is_closed[ends].any(axis=1))
        places = self.frame.continuous_rowcol_from_xy(graph.points_xy)
        starts, stops = places[ends[asked, 0]], places[ends[asked, 1]]
        # of a round robot the costmap's rule is about its centre alone
        touches = self.robot is not None and bool(self.robot.vertices)
        is_clear, _ = self.sweeps.along(starts, stops, touches=touches)
        by_ends: dict[tuple[int, int], list[int]] = {}
        for index in asked[~is_clear].tolist():
            start, stop = sorted(ends[index].tolist())
            by_ends.setdefault((start, stop), []).append(index)
        for indices in by_ends.values():
            edge = graph.edges[indices[0]]
            start, stop = places[ends[indices[0]]]
            hit = self.sweeps.worst_place(start, stop, touches=touches)
            x, y = (self.frame.xy_from_continuous_rowcol([hit])[0].round(3) + 0.0).tolist()
            names = " and ".join(str(graph.edges[index].id) for index in indices)
            word = "edge" if len(indices) == 1 else "edges"
            text = f"{word} {names} from node {edge.start} to {edge.end}: "
            text += f"the robot cannot pass at {x:.10g},{y:.10g}{self._why(hit)}; "
            text += "put a node beside it and lead the edge around, or remove it"
            yield self.finding("edge-blocked", text, [(x, y)])

    def _why(self, place: NDArray[np.float64]) -> str:
        row, col = np.clip(np.floor(place).astype(np.int64), 0, np.array(self.frame.shape) - 1)
        if self.occupied[row, col]:
            return " (an obstacle)"
        if self.unknown[row, col]:
            return " (unknown)"
        away = float(np.sqrt(self.sweeps.squared[row, col])) * self.frame.resolution
        return f", {away:.3g} m from an obstacle or unknown space"

    def _connections(self) -> Iterator[Finding]:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        graph, count = self.graph, len(self.graph.nodes)
        ends = graph.ends
        weak = joined(count, ends[:, 0], ends[:, 1])[0]
        sizes = np.bincount(weak, minlength=count)
        largest = int(sizes.argmax())
        for part in np.flatnonzero(sizes).tolist():
            if part != largest:
                nodes = np.flatnonzero(weak == part).tolist()
                count_of = count_text(len(nodes), "node")
                text = f"{count_of} ({self._ids(nodes)}) not connected with the rest"
                yield self.finding("parts", text, map(self._point, nodes))
        links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
        _, strong = connected_components(links.tocsr(), directed=True, connection="strong")
        main = int(np.bincount(strong[weak == largest]).argmax())
        trapped: dict[bool, list[int]] = {True: [], False: []}
        leaves = self._reaching(ends, strong == main)
        for node in np.flatnonzero((weak == largest) & (strong != main)).tolist():
            trapped[bool(leaves[node])].append(node)
        for can_leave, nodes in trapped.items():
            if nodes:
                word = "left, but not entered" if can_leave else "entered, but not left"
                text = f"{count_text(len(nodes), 'node')} ({self._ids(nodes)}) can be {word}; "
                text += "add the edges back: each leads one way"
                yield self.finding("one-way", text, map(self._point, nodes))

    def _reaching(self, ends: NDArray[np.int64], target: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which nodes have a way to some."""
        found = target.copy()
        while True:
            more = found.copy()
            more[ends[found[ends[:, 1]], 0]] = True
            if np.array_equal(more, found):
                return found
            found = more

    def _ids(self, nodes: Sequence[int]) -> str:
        ids = ", ".join(str(self.graph.nodes[node].id) for node in nodes[:5])
        return f"{ids}, ..." if len(nodes) > 5 else ids
