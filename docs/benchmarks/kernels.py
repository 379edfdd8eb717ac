"""Times of the distance kernels beside OpenCV, edt and scipy, in one process.

Run it as ``python docs/benchmarks/kernels.py [--sides 4000] [--threads 1 2] [--runs 5]``, with
MAPDEAL_KERNELS=scipy as without a compiler.
"""

import cv2
import edt
import numpy as np
from make_map import RESOLUTION, cells_of_map
from scipy import ndimage
from turns import Contender, head, in_turns, options, ratio, row

from mapdeal.kernels.distance import bytes_by_distance, signed_distance, squared_distance
from mapdeal.kernels.threads import use_threads
from mapdeal.layers.inflation import CostProfile, InflationLayer

INSCRIBED, FACTOR, REACH = 0.3, 3.0, 1.75  # metres, 1 / metre, metres


def transform(cells: np.ndarray) -> np.ndarray:
    return cv2.distanceTransform(cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def field_by_opencv(cells: np.ndarray) -> np.ndarray:
    """Return a signed field in metres, float32, of cells of 0 and 1."""
    field = cv2.subtract(transform(1 - cells), transform(cells))
    return cv2.multiply(field, RESOLUTION, dst=field)


def costs_by_opencv(cells: np.ndarray) -> np.ndarray:
    """Return exponential costs out to `REACH`, of cells of 0 and 1."""
    metres = cv2.multiply(transform(1 - cells), RESOLUTION)
    cost = cv2.exp(cv2.multiply(cv2.subtract(metres, INSCRIBED), -FACTOR))
    costs = cv2.multiply(cost, 252.0, dtype=cv2.CV_8U)
    costs[metres <= INSCRIBED] = 253
    costs[metres > REACH] = 0
    costs[cells > 0] = 254
    return costs


def tasks(occupied: np.ndarray, threads: int) -> dict[str, dict[str, Contender]]:
    cells = occupied.view(np.uint8)
    free = 1 - cells

    def field_by_scipy() -> np.ndarray:
        outside, inside = map(ndimage.distance_transform_edt, (free, cells))
        return ((outside - inside) * RESOLUTION).astype(np.float32)

    def costs() -> np.ndarray:
        layer = InflationLayer(inscribed_radius=INSCRIBED, cost_scaling_factor=FACTOR)
        return bytes_by_distance(occupied, CostProfile(layer, occupied.shape, RESOLUTION).table)

    return {
        "signed field": {
            "mapdeal": lambda: signed_distance(occupied, scale=RESOLUTION),
            "OpenCV": lambda: field_by_opencv(cells),
            "edt": lambda: -edt.sdf(occupied, anisotropy=(RESOLUTION,) * 2, parallel=threads),
            "scipy": field_by_scipy,
        },
        "unsigned": {
            "mapdeal": lambda: squared_distance(occupied),
            "OpenCV": lambda: transform(free),
            "edt": lambda: edt.edtsq(free, parallel=threads),
            "scipy": lambda: ndimage.distance_transform_edt(free),
        },
        "costs to 1.75 m": {"mapdeal": costs, "OpenCV": lambda: costs_by_opencv(cells)},
    }


if __name__ == "__main__":
    given = options(__doc__, sides=[4000], threads=[1, 2], runs=5)
    head("cells a side", "threads", "task", "mapdeal, ms", "OpenCV", "edt", "scipy")
    for side in given.sides:
        occupied = cells_of_map(side)
        for threads in given.threads:
            cv2.setNumThreads(threads)
            for task, contenders in tasks(occupied, threads).items():
                with use_threads(threads):
                    if task == "signed field":
                        ours, *others = (make() for make in contenders.values())
                        # float32 squares and roots: 1e-4 tells a wrong cell from rounding
                        assert all(np.allclose(one, ours, rtol=1e-4, atol=1e-6) for one in others)
                    times = in_turns(contenders, given.runs)
                ours = times.pop("mapdeal")
                peers = [f"{ratio(ours, theirs)} ({theirs.ms})" for theirs in times.values()]
                row(side, threads, task, ours.ms, *peers, *[""] * (3 - len(peers)))
