"""Times of poses of a footprint and the ways between them beside OpenCV and scipy, in one process.

Run it as ``python docs/benchmarks/robot_poses.py [--sides 1000 4000] [--threads 2] [--runs 5]``. In
72 headings, OpenCV erodes the free cells by the footprint, scipy labels what is left, and joins the
components of neighbouring headings where they overlap, on maps of at most 1000 cells a side.
"""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from make_map import RESOLUTION, office
from scipy import ndimage, sparse
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal import Footprint
from mapdeal.grid.footprint import footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.kernels.paths import open_poses
from mapdeal.kernels.polygons import Spans, paint
from mapdeal.kernels.threads import use_threads

HEADINGS = 72
ROBOT = Footprint.polygon([(0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225)])
LARGEST_OF_PEER = 1000


def contenders(blocked: np.ndarray, spans: tuple[Spans, ...]) -> dict[str, Contender]:
    space = open_poses(blocked, spans, None)
    widest = np.argwhere(space.headings == space.headings.max())
    cell = tuple(widest[len(widest) // 2].tolist())
    seed = (int(space.at(*cell).argmax()), *cell)
    kernels = [kernel_of(one) for one in spans]

    def ours() -> np.ndarray:
        return open_poses(blocked, spans, None).reach([seed], [])[0]

    def peer() -> np.ndarray:
        free = 1 - blocked.view(np.uint8)
        outside = {"borderType": cv2.BORDER_CONSTANT, "borderValue": 0}
        return joined((cv2.erode(free, kernel, **outside) for kernel in kernels), seed)

    listed: dict[str, Contender] = {
        "both": ours,
        "poses": lambda: open_poses(blocked, spans, None),
        "ways": lambda: space.reach([seed], [])[0],
    }
    if len(blocked) <= LARGEST_OF_PEER:
        assert np.array_equal(ours(), peer())
        listed["peer"] = peer
    return listed


def kernel_of(spans: Spans) -> np.ndarray:
    """Return a square of 0 and 1, the robot's cell in the middle."""
    reach = int(max(np.abs(spans.rows).max(), np.abs(spans.starts).max(), spans.stops.max()))
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
    paint(kernel, Spans(spans.rows + reach, spans.starts + reach, spans.stops + reach), 1)
    return kernel


def joined(planes: Iterable[np.ndarray], seed: Any) -> np.ndarray:
    """Return the cells that are reached, of the open ones of each heading; keeps all labels."""
    labels, pairs, start = [], [], 0
    for plane in planes:
        of_plane, count = ndimage.label(plane)
        of_plane[of_plane > 0] += start
        labels.append(of_plane)
        start += count
    for one, other in zip(labels, labels[1:] + labels[:1], strict=True):
        both = (one > 0) & (other > 0)
        pairs.append(np.unique(one[both].astype(np.int64) << 32 | other[both]))
    one, other = np.concatenate(pairs) >> 32, np.concatenate(pairs) & 0xFFFFFFFF
    graph = sparse.coo_matrix((np.ones(len(one)), (one, other)), shape=(start + 1, start + 1))
    groups = sparse.csgraph.connected_components(graph, directed=False)[1]
    is_reached = groups == groups[labels[seed[0]][seed[1], seed[2]]]
    is_reached[0] = False
    reachable = is_reached[labels[0]]
    for of_plane in labels[1:]:
        reachable |= is_reached[of_plane]
    return reachable


if __name__ == "__main__":
    given = options(__doc__, sides=[1000, 4000], threads=[2], runs=5)
    head("cells a side", "threads", "poses, ms", "ways, ms", "peer, ms (ratio)")
    for side in given.sides:
        blocked = np.ascontiguousarray(office(side)[::-1] != 254)
        spans = footprint_spans(ROBOT, Frame(side, side, RESOLUTION), HEADINGS)
        for threads in given.threads:
            cv2.setNumThreads(threads)
            with use_threads(threads):
                times = in_turns(contenders(blocked, spans), given.runs)
            ours, poses, ways, *peer = times.values()
            told = [f"{one.ms} ({ratio(ours, one)})" for one in peer] or [""]
            row(side, threads, poses.ms, ways.ms, *told)
