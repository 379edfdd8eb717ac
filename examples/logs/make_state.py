"""Write office.pbstream: the office of examples/maps as a state of Cartographer.

Run it as ``python examples/logs/make_state.py``. Two submaps hold the western and the eastern part
of the map, which overlap, and one trajectory passes through both.
"""

import math
import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER.parents[1] / "tests"))

import mapdeal  # noqa: E402
import states  # noqa: E402 - its folder is only known now


def main():
    office = mapdeal.read_map(FOLDER.parent / "maps" / "office.yaml")
    known = np.argwhere(office.occupancy >= 0)
    (south, west), (north, east) = known.min(axis=0), known.max(axis=0) + 1
    # values of costs, 1 - probability: high where it is free
    values = np.select([office.occupancy > 50, office.occupancy == 0], [3_000, 30_000], 0)
    middle, overlap = (west + east) // 2, 40
    parts = {(0, 0): (west, middle + overlap), (0, 1): (middle - overlap, east)}
    poses, submaps = {}, []
    for key, (first, stop) in parts.items():
        corner = office.frame.xy_from_continuous_rowcol([(north, stop)])[0]
        # rows of a grid run along -x, from the upper corner, and columns along -y
        cells = values[south:north, first:stop][::-1, ::-1].T
        poses[key] = (corner[0], corner[1], 0.0)
        submaps.append(states.submap(cells, key=key, corner=(0, 0)))
    path = [(0, 0.5 * k, -8.5 + 0.1 * k, -0.3 + 0.1 * math.sin(k / 9), 0.0) for k in range(90)]
    nodes = [states.message((4, states.message((1, states.message((2, k)))))) for k in range(90)]
    data = states.state(states.pose_graph(poses, path), *submaps, *nodes)
    (FOLDER / "office.pbstream").write_bytes(data)


if __name__ == "__main__":
    main()
