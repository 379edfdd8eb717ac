"""Route graphs of real maps: size, coverage, detour, clearance and time, beside a skeleton's.

Run it as ``python docs/benchmarks/route_graphs.py MAP... [--pairs 200] [--peer]``; with `--peer` it
needs scikit-image, of the extra ``bench``. A detour is the length of the way over the graph, with
straight legs to nodes in sight at both ends, divided by that of ``mapdeal route`` between the same
two cells, drawn at random and at least 3 m apart. Every edge is tried again at half cells by
`footprint_costs`. The peer is skimage's skeletonize of the reached cells, traced between crossings
as sknw does, with an edge as long as its line. Prints a table in Markdown; fails on nothing.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import mapdeal
from mapdeal.commands.graph import PlannedGraph
from mapdeal.commands.route import route
from mapdeal.grid.route_graph import Sweeps, closed_costs
from mapdeal.kernels.skeleton import STRAIGHT, lengths_from
from mapdeal.planning.routes import Terrain, route_over

BOX = "[[0.254,0.216],[0.254,-0.216],[-0.254,-0.216],[-0.254,0.216]]"
ROBOTS = {
    "round, 0.105 m": mapdeal.Footprint.circle(0.105),
    "round, 0.22 m": mapdeal.Footprint.circle(0.22),
    "0.51 x 0.43 m": mapdeal.Footprint.parse(BOX),
}
LEAST_APART = 3.0  # metres
Links = list[tuple[int, int, float]]


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("maps", nargs="+", type=Path)
    words.add_argument("--pairs", type=int, default=200)
    words.add_argument("--peer", action="store_true")
    given = words.parse_args()
    warnings.simplefilter("ignore")
    print(
        "| map | robot | by | nodes | edges | m2 a node | covered | detour | clearance | hit | s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for path in given.maps:
        for name, robot in ROBOTS.items():
            begun = time.perf_counter()
            found = mapdeal.graph(path, footprint=robot)
            seconds = time.perf_counter() - begun
            graph = found.graph
            links = [(*ends, length) for ends, length in
                     zip(graph.ends.tolist(), graph.lengths.tolist(), strict=True)]  # fmt: skip
            rows = [("mapdeal", graph.points_xy, links, seconds)]
            if given.peer:
                begun = time.perf_counter()
                points, links = skeleton_graph(found)
                rows.append(("skeleton", points, links, time.perf_counter() - begun))
            pairs = list(drawn_pairs(found, given.pairs))
            for by, points, links, taken in rows:
                figures = measured(found, points, links, pairs)
                head = f"| {path.parent.name}/{path.stem} | {name} | {by}"
                print(f"{head} | {figures} | {taken:.2f} |", flush=True)


def drawn_pairs(found: PlannedGraph, count: int) -> Any:
    """Yield pairs of reached cells, as points, and the length of the route between them."""
    reach = found.reach
    cells = np.argwhere(reach.reachable > 0)
    points = reach.frame.xy_from_rowcol(cells)
    first = tuple(points[0].tolist())
    costs = route(reach.grid, start=first, goal=first, footprint=reach.robot).costs
    terrain = Terrain.of(costs)
    drawn = np.random.default_rng(1)
    left, tries = count, 0
    while left and tries < 20 * count:
        tries += 1
        start, goal = points[drawn.integers(len(points), size=2)]
        if math.dist(start, goal) < LEAST_APART:
            continue
        try:
            way = route_over(terrain, tuple(start), tuple(goal))
        except mapdeal.ParameterError:  # closed for costs, though a corner may stand there
            continue
        if way.reached:
            left -= 1
            yield start, goal, way.length


def measured(found: PlannedGraph, points: NDArray[Any], links: Links, pairs: Any) -> str:
    reach = found.reach
    frame, occupancy = reach.frame, reach.occupancy
    costs = closed_costs(occupancy == 100, occupancy == -1)
    plain = mapdeal.Costmap(costs, frame.resolution, frame.origin)
    is_open = reach.reachable > 0
    sweeps = Sweeps(is_open, costs, np.zeros(costs.shape, np.int32), frame, None)
    count = len(points)
    links_of = np.array(links).reshape(-1, 3)
    ends = links_of[:, :2].astype(int)
    weights = csr_array((links_of[:, 2], tuple(ends.T)), shape=(count, count))
    lengths = dijkstra(weights, directed=True)
    detours = [
        over_graph(sweeps, points, lengths, start, goal) / length for start, goal, length in pairs
    ]
    hits, clearance = 0, math.inf
    for start, end in points[ends]:
        steps = math.ceil(math.dist(start, end) / frame.resolution * 2) + 1
        yaw = math.atan2(end[1] - start[1], end[0] - start[0])
        poses = np.column_stack([np.linspace(start, end, steps), np.full(steps, yaw)])
        hits += bool((mapdeal.footprint_costs(plain, reach.robot, poses) == 254).any())
        cells, _ = frame.bounded_rowcol_from_xy(poses[:, :2])
        clearance = min(clearance, float(reach.clearance[cells[:, 0], cells[:, 1]].min()))
    cells = frame.unbounded_rowcol_from_xy(points)
    limit = int(found.cover / frame.resolution * STRAIGHT)
    near = lengths_from(is_open, cells[:, 0] * is_open.shape[1] + cells[:, 1], limit=limit)
    covered = np.count_nonzero(near[is_open] >= 0) / np.count_nonzero(is_open)
    finite = np.isfinite(detours)
    detour = f"{np.mean(np.array(detours)[finite]):.3f}" if finite.any() else "-"
    detour += "" if finite.all() else f", none for {np.count_nonzero(~finite)}"
    area = reach.reachable_area / count
    return (f"{count} | {len(links)} | {area:.2f} | {100 * covered:.2f} % | {detour} | "
            f"{clearance:.2f} m | {hits}")  # fmt: skip


def over_graph(
    sweeps: Sweeps, points: NDArray[Any], lengths: NDArray[Any], start: Any, goal: Any
) -> float:
    """Return the length of the shortest way over the graph, from and to nodes in sight."""
    best = []
    for place in (start, goal):
        away = np.hypot(*(points - place).T)
        near = np.argsort(away, kind="stable")[:12]
        at = sweeps.frame.continuous_rowcol_from_xy([place, *points[near]])
        is_seen, _ = sweeps.along(np.repeat(at[:1], len(near), axis=0), at[1:], touches=False)
        is_seen[0] |= not is_seen.any()
        best.append([(node, away[node]) for node in near[is_seen].tolist()])
    ways = [leg + lengths[a, b] + other for a, leg in best[0] for b, other in best[1]]
    return float(min(ways))


def skeleton_graph(found: PlannedGraph) -> tuple[NDArray[Any], Links]:
    """Return crossings and ends of skimage's skeleton, and the lines between them."""
    from skimage.morphology import skeletonize

    lines = skeletonize(found.reach.reachable > 0)
    cells = [tuple(one) for one in np.argwhere(lines).tolist()]
    index = set(cells)
    steps = [(row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col]
    beside = {one: [two for row, col in steps if (two := (one[0] + row, one[1] + col)) in index]
              for one in cells}  # fmt: skip
    nodes = {one: number for number, one in
             enumerate(one for one in cells if len(beside[one]) != 2)}  # fmt: skip
    links: Links = []
    scale = found.reach.resolution
    for node in nodes:
        for following in beside[node]:
            way = [node, following]
            while way[-1] not in nodes:
                onward = [one for one in beside[way[-1]] if one not in way[-2:]]
                if not onward:
                    break
                way.append(onward[0])
            if way[-1] in nodes:
                length = sum(math.dist(*ends) for ends in pairwise(way)) * scale
                links.append((nodes[node], nodes[way[-1]], length))
    return found.reach.frame.xy_from_rowcol(list(nodes)), links


if __name__ == "__main__":
    main()
