"""Times of the stages from a map to a field and costs beside OpenCV and plain copies.

Run it as ``python docs/benchmarks/stages.py [--sides 4000] [--threads 1 2] [--runs 9]``. Costs and
views of a field that is there already are compared with the time in which numpy copies 10 bytes a
cell: what they read and write is half of that.
"""

import numpy as np
from shapes import Pair, compare
from turns import options

from kernels import FACTOR, INSCRIBED, REACH, costs_by_opencv, field_by_opencv
from mapdeal import OccupancyGrid, esdf, exponential_cost, field_view, threshold_cost


def works_of(grid: OccupancyGrid) -> dict[str, Pair]:
    field = esdf(grid)
    source = np.ones(10 * grid.occupancy.size, np.uint8)
    target = np.empty_like(source)

    def cells() -> np.ndarray:
        return (grid.occupancy >= 100).view(np.uint8)

    def costs() -> np.ndarray:
        return exponential_cost(
            grid, inscribed_radius=INSCRIBED, inflation_radius=REACH, cost_scaling_factor=FACTOR
        ).cost

    def copied() -> None:
        np.copyto(target, source)

    between_centres = esdf(grid, convention="center").distance
    assert np.allclose(field_by_opencv(cells()), between_centres, rtol=1e-4, atol=1e-6)
    return {
        "signed field": (lambda: esdf(grid).distance, lambda: field_by_opencv(cells())),
        "exponential costs, 1.75 m": (costs, lambda: costs_by_opencv(cells())),
        "threshold costs of a field": (lambda: threshold_cost(field).cost, copied),
        "view, metric": (lambda: field_view(field, view="metric").occupancy, copied),
        "view, relative": (lambda: field_view(field).occupancy, copied),
    }


if __name__ == "__main__":
    given = options(__doc__, sides=[4000], threads=[1, 2], runs=9)
    compare([(n, name) for n in given.sides for name in ("office", "noise")], works_of, given)
