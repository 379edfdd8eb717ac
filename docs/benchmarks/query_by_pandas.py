"""What ``mapdeal query`` answers, by pandas and scipy, without its checks.

Run it as ``python query_by_pandas.py FIELD.npz POINTS.csv OUT.jsonl``. The gradient is two keys,
and numbers have all digits.
"""

import math
import sys

import numpy as np
import pandas as pd
from scipy import ndimage


def places_of(points: np.ndarray, origin: tuple[float, ...], resolution: float) -> np.ndarray:
    """Return rows and columns, with fractions, from the centre of the first cell."""
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    turn = np.array([[-sin, cos], [cos, sin]])
    return ((points - origin[:2]) @ turn).T / resolution - 0.5


def interpolated(distance: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return distances, and how they change from row to row and from column to column."""

    def at(row: float, col: float) -> np.ndarray:
        shifted = places + np.array([[row], [col]])
        return ndimage.map_coordinates(distance, shifted, order=1, mode="nearest")

    return at(0, 0), at(0.5, 0) - at(-0.5, 0), at(0, 0.5) - at(0, -0.5)


def main(source: str, points: str, output: str) -> None:
    layers = np.load(source)
    distance, occupancy = layers["distance"], layers["occupancy"]
    origin, resolution = layers["origin"], float(layers["resolution"])
    frame = pd.read_csv(points)
    places = places_of(frame[["x", "y"]].to_numpy(), origin, resolution)
    cells = np.floor(places + 0.5).astype(int)
    height, width = distance.shape
    row, col = np.clip(cells, 0, [[height - 1], [width - 1]])
    here, across, along = interpolated(distance, places)
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    frame["inside"] = ((cells >= 0) & (cells < [[height], [width]])).all(axis=0)
    frame["row"], frame["col"] = row, col
    frame["state"] = np.where(occupancy[row, col] >= 65, "occupied", "free")
    frame["distance"] = here
    frame["gradient_x"] = (along * cos - across * sin) / resolution
    frame["gradient_y"] = (along * sin + across * cos) / resolution
    frame["cell_distance"] = distance[row, col]
    frame.to_json(output, orient="records", lines=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
