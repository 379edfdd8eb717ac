"""Maps of any size, all seeded; ``python make_map.py SIDE_CELLS OUT.yaml`` writes an office's."""

import sys
from pathlib import Path

import numpy as np

from mapdeal import OccupancyGrid

RESOLUTION = 0.05


def office(side: int) -> np.ndarray:
    """Return a map of `side` x `side` pixels: walls, specks, and a tenth of it unknown."""
    rng = np.random.default_rng(side)
    pixels = np.full((side, side), 254, np.uint8)
    for _ in range(side // 10):
        row, col = rng.integers(0, side, 2)
        length, thickness = int(rng.integers(20, 300)), int(rng.integers(1, 5))
        if rng.random() < 0.5:
            pixels[row : row + thickness, col : col + length] = 0
        else:
            pixels[row : row + length, col : col + thickness] = 0
    for band in np.array_split(pixels, max(1, side // 1000)):  # random floats take eight times that
        band[rng.random(band.shape) < 0.0003] = 0
    border = side // 10
    pixels[:border] = 205
    pixels[:, :border] = 205
    return pixels


def sparse(side: int) -> np.ndarray:
    """Return 1,500 obstacles of a cell in the open."""
    pixels = np.full(side * side, 254, np.uint8)
    pixels[np.random.default_rng(side).choice(side * side, 1500, replace=False)] = 0
    return pixels.reshape(side, side)


def noise(side: int) -> np.ndarray:
    """Return a map of which every twentieth cell is an obstacle."""
    is_obstacle = np.random.default_rng(side).random((side, side)) < 0.05
    return np.where(is_obstacle, 0, 254).astype(np.uint8)


MAPS = {"office": office, "sparse": sparse, "noise": noise}


def cells_of_map(side: int, name: str = "office") -> np.ndarray:
    """Return the mask of a map's obstacles, row 0 in the south."""
    return np.ascontiguousarray(MAPS[name](side)[::-1] == 0)


def grid_of(occupied: np.ndarray, origin: tuple[float, float, float] = (0, 0, 0)) -> OccupancyGrid:
    """Return the grid of a mask, without unknown cells."""
    return OccupancyGrid(occupied.astype(np.int8) * 100, RESOLUTION, origin)


def make_map(side: int, path: Path) -> None:
    """Write an office's map as a pgm and its yaml."""
    pixels = office(side)
    with path.with_suffix(".pgm").open("wb") as file:
        file.write(b"P5\n%d %d\n255\n" % (side, side))
        file.write(pixels.data)
    half = side * RESOLUTION / 2
    path.write_text(
        f"image: {path.stem}.pgm\nresolution: {RESOLUTION}\norigin: [-{half}, -{half}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


if __name__ == "__main__":
    make_map(int(sys.argv[1]), Path(sys.argv[2]))
