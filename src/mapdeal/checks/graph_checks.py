"""Checks of a route graph on its map, for a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from mapdeal.checks.findings import CHECKS, Check, Finding
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.grid import reach, reaching, values
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.route_graph import RouteGraph, Sweeps, closed_costs
from mapdeal.kernels import arrays, components
from mapdeal.maps.route_graphs import FRAME, read_graph_file

_MOST = 20  # of one check; further ones are summarised


def check_graph(path: Path, grid: OccupancyGrid, robot: Footprint | None) -> list[Finding]:
    try:
        file = read_graph_file(path)
    except (MalformedInputError, FileAccessError) as error:
        return [Check.error_finding(error, path)]
    facts = _GraphFacts(path, file.graph, grid, robot)
    findings = [facts.finding(p.check, p.text, [p.point] if p.point else []) for p in file.problems]
    findings += facts.findings()
    by_check = ([found for found in findings if found.check == name] for name in CHECKS)
    return [finding for group in by_check for finding in _shortened(group)]


def _shortened(findings: Sequence[Finding]) -> Iterator[Finding]:
    yield from findings[:_MOST]
    omitted = findings[_MOST:]
    if omitted:
        places = tuple(place for finding in omitted for place in finding.places)
        text = f"{len(omitted)} more of the same, the first of them: {omitted[0].message}"
        yield CHECKS[omitted[0].check].finding(omitted[0].file, text, places=places)


class _GraphFacts:
    def __init__(
        self, path: Path, graph: RouteGraph, grid: OccupancyGrid, robot: Footprint | None
    ) -> None:
        self.path, self.graph, self.frame, self.robot = path, graph, grid.frame, robot
        occupancy = np.asarray(grid.occupancy)
        occupied, unknown = occupancy == values.OCCUPIED, occupancy == values.UNKNOWN
        closed = reaching.largest_closed_square(reach.reach_radius(robot), grid.frame)
        is_open = (reaching.squares_to(occupied) > closed) & ~unknown
        squared = reaching.squares_to(occupied | unknown)
        self.sweeps = Sweeps(is_open, closed_costs(occupied, unknown), squared, grid.frame, robot)
        self.occupied, self.unknown = occupied, unknown
        self.cells, self.inside = grid.frame.bounded_rowcol_from_xy(graph.points_xy)

    def finding(self, check: str, text: str, points: Iterable[Sequence[float]]) -> Finding:
        return CHECKS[f"graph.{check}"].finding(self.path, text, places=points)

    def findings(self) -> Iterator[Finding]:
        if not len(self.graph.nodes):
            return
        frames = ", ".join(sorted({node.frame for node in self.graph.nodes} - {FRAME}))
        if frames:
            text = f"nodes have the frame {frames}: the server transforms them to {FRAME}"
            yield self.finding("other-frame", text, ())
        outside = int(np.count_nonzero(~self.inside))
        if 2 * outside > len(self.inside):  # other findings would repeat this for each node
            low, high = self.graph.points_xy.min(axis=0), self.graph.points_xy.max(axis=0)
            rows, cols = self.frame.shape
            ends = [[0, 0], [0, cols], [rows, 0], [rows, cols]]
            corners = self.frame.xy_from_continuous_rowcol(ends)
            first, last = corners.min(axis=0), corners.max(axis=0)
            extent = f"x {low[0]:.4g} .. {high[0]:.4g}, y {low[1]:.4g} .. {high[1]:.4g}"
            limits = f"x {first[0]:.4g} .. {last[0]:.4g}, y {first[1]:.4g} .. {last[1]:.4g}"
            text = f"{outside} of {len(self.inside)} nodes lie outside of the map: they cover "
            text += f"{extent}, the map {limits}; coordinates must be metres in the frame {FRAME}, "
            yield self.finding("other-frame", f"{text}whatever crs says", ())
            return
        row, col = self.cells.T
        is_closed = ~(self.inside & self.sweeps.is_open[row, col])
        for node in np.flatnonzero(is_closed).tolist():
            place = self.graph.points_xy[[node]].tolist()
            yield self.finding("node-closed", self._closed_text(node), place)
        yield from self._blocked(is_closed)
        yield from self._connections()

    def _closed_text(self, node: int) -> str:
        number = self.graph.nodes[node].id
        row, col = self.cells[node].tolist()
        if not self.inside[node]:
            (cell,) = self.frame.unbounded_rowcol_from_xy(self.graph.points_xy[node : node + 1])
            row, col = cell.tolist()
            position = "outside of the map"
        elif self.occupied[row, col]:
            position = "in an obstacle"
        elif self.unknown[row, col]:
            position = "in unknown space"
        else:
            distance, radius = self._distance(row, col), reach.reach_radius(self.robot)
            position = f"{distance:.3g} m from an obstacle, too near for a radius of {radius:.3g} m"
        nearest = reaching.nearest_marked(self.sweeps.is_open, (row, col))
        if nearest is None:
            return f"node {number} lies {position}"
        x, y = (self.frame.xy_from_rowcol([nearest])[0].round(3) + 0.0).tolist()
        return f"node {number} lies {position}; the nearest open cell is at {x:.10g},{y:.10g}"

    def _blocked(self, is_closed: arrays.Mask) -> Iterator[Finding]:
        graph, ends = self.graph, self.graph.ends
        candidates = np.flatnonzero(~is_closed[ends].any(axis=1))
        ends_rowcol = self.frame.continuous_rowcol_from_xy(graph.points_xy)
        starts, stops = ends_rowcol[ends[candidates, 0]], ends_rowcol[ends[candidates, 1]]
        # for a round robot, the costmap's rule concerns its centre only
        touches = self.robot is not None and bool(self.robot.vertices)
        is_clear, _ = self.sweeps.along(starts, stops, touches=touches)
        by_ends: dict[tuple[int, int], list[int]] = {}
        for index in candidates[~is_clear].tolist():
            start, stop = sorted(ends[index].tolist())
            by_ends.setdefault((start, stop), []).append(index)
        for indices in by_ends.values():
            edge = graph.edges[indices[0]]
            start, stop = ends_rowcol[ends[indices[0]]]
            worst = self.sweeps.worst_place(start, stop, touches=touches)
            x, y = (self.frame.xy_from_continuous_rowcol([worst])[0].round(3) + 0.0).tolist()
            names = " and ".join(str(graph.edges[index].id) for index in indices)
            text = f"edge{'s' * (len(indices) > 1)} {names} from node {edge.start} to {edge.end}: "
            text += f"the robot cannot pass at {x:.10g},{y:.10g}{self._reason(worst)}; "
            text += "put a node beside it and lead the edge around, or remove it"
            yield self.finding("edge-blocked", text, [(x, y)])

    def _reason(self, place: arrays.Floats) -> str:
        row, col = np.clip(np.floor(place).astype(np.int64), 0, np.array(self.frame.shape) - 1)
        if self.occupied[row, col]:
            return " (an obstacle)"
        if self.unknown[row, col]:
            return " (unknown)"
        return f", {self._distance(row, col):.3g} m from an obstacle or unknown space"

    def _distance(self, row: int, col: int) -> float:
        return float(np.sqrt(self.sweeps.squared[row, col])) * self.frame.resolution

    def _connections(self) -> Iterator[Finding]:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import breadth_first_order, connected_components

        ends = self.graph.ends
        count = len(self.graph.nodes)
        weak = components.joined(count, ends[:, 0], ends[:, 1])[0]
        sizes = np.bincount(weak, minlength=count)
        largest = int(sizes.argmax())
        for part in np.flatnonzero(sizes).tolist():
            if part != largest:
                nodes = np.flatnonzero(weak == part).tolist()
                text = f"{self._ids(nodes)} not connected with the rest"
                yield self.finding("parts", text, self.graph.points_xy[nodes].tolist())
        links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
        _, strong = connected_components(links.tocsr(), directed=True, connection="strong")
        main = int(np.bincount(strong[weak == largest]).argmax())
        trapped: dict[bool, list[int]] = {True: [], False: []}
        first = int(np.argmax(strong == main))
        upstream = breadth_first_order(links.T.tocsr(), first, return_predecessors=False)
        for node in np.flatnonzero((weak == largest) & (strong != main)).tolist():
            trapped[node in upstream].append(node)
        for can_leave, nodes in trapped.items():
            if nodes:
                word = "left, but not entered" if can_leave else "entered, but not left"
                text = f"{self._ids(nodes)} can be {word}; add edges in the other direction"
                yield self.finding("one-way", text, self.graph.points_xy[nodes].tolist())

    def _ids(self, nodes: Sequence[int]) -> str:
        ids = ", ".join(str(self.graph.nodes[node].id) for node in nodes[:5])
        return f"{values.count_text(len(nodes), 'node')} ({ids}{', ...' * (len(nodes) > 5)})"
