"""Make the example maps.

Run it as ``python examples/maps/make_examples.py``.

A simulated laser scanner drives through a floor plan and through an arena; what it sees is
saved the way that gmapping's map_saver and Cartographer save their maps. Seeded: the files
come out the same every time.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parent
RESOLUTION = 0.05  # metres per cell
RANGE_MAX = 10.0  # metres
RAYS = 1440

Grid = np.ndarray


class Plan:
    """A floor plan: True where something solid stands. Row 0 is the south."""

    def __init__(self, width: float, height: float) -> None:
        self.solid = np.zeros((round(height / RESOLUTION), round(width / RESOLUTION)), dtype=bool)
        self.rows, self.cols = np.indices(self.solid.shape)

    def box(self, x: float, y: float, width: float, height: float, *, solid: bool = True) -> None:
        """Fill (or, with solid=False, open) a rectangle, corner and size in metres."""
        first = (round(y / RESOLUTION), round(x / RESOLUTION))
        size = (max(1, round(height / RESOLUTION)), max(1, round(width / RESOLUTION)))
        self.solid[first[0] : first[0] + size[0], first[1] : first[1] + size[1]] = solid

    def disc(self, x: float, y: float, radius: float) -> None:
        """Fill a disc, centre and radius in metres."""
        distance = np.hypot(self.cols - x / RESOLUTION, self.rows - y / RESOLUTION)
        self.solid |= distance * RESOLUTION <= radius

    def wall_polygon(self, corners: list[tuple[float, float]], thickness: float) -> None:
        """Draw the closed outline through the corners."""
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
            for share in np.linspace(0, 1, 800):
                self.disc_at(ax + (bx - ax) * share, ay + (by - ay) * share, thickness / 2)

    def disc_at(self, x: float, y: float, radius: float) -> None:
        """Fill a small disc without looking at the whole plan."""
        reach = round(radius / RESOLUTION) + 1
        row, col = round(y / RESOLUTION), round(x / RESOLUTION)
        window = np.s_[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        distance = np.hypot(self.cols[window] - col, self.rows[window] - row)
        self.solid[window] |= distance * RESOLUTION <= radius + 1e-9


def office() -> Plan:
    """Return an office floor: a corridor, rooms with doors on both sides, furniture."""
    plan = Plan(21.0, 13.0)
    wall = 0.15
    for x, y, width, height in [(0.5, 0.5, 20, wall), (0.5, 12.35, 20, wall)]:
        plan.box(x, y, width, height)
    for x in (0.5, 20.35):
        plan.box(x, 0.5, wall, 12)
    plan.box(0.5, 5.4, 20, wall)
    plan.box(0.5, 7.6, 20, wall)
    for x in (4.5, 8.5, 14.0):
        plan.box(x, 0.5, wall, 5)
    for x in (6.0, 11.0, 15.5):
        plan.box(x, 7.6, wall, 4.9)
    for x in (2.0, 6.2, 11.0, 16.8):
        plan.box(x, 5.3, 1.0, 0.4, solid=False)
    for x in (3.0, 8.0, 12.6, 17.4):
        plan.box(x, 7.5, 1.0, 0.4, solid=False)
    for x, y in [(1.2, 1.2), (5.2, 1.0), (15.2, 3.4), (17.6, 3.4), (7.0, 10.6), (1.3, 10.8)]:
        plan.box(x, y, 1.4, 0.7)
    for x, y in [(9.4, 1.2), (9.4, 3.2), (11.8, 1.2), (11.8, 3.2)]:  # tables seen as their legs
        for dx, dy in [(0, 0), (1.5, 0), (0, 0.8), (1.5, 0.8)]:
            plan.box(x + dx, y + dy, 0.1, 0.1)
    for x in (5.0, 10.0, 15.0):
        plan.disc(x, 6.55, 0.2)
    plan.disc(13.2, 10.2, 0.6)
    plan.box(16.4, 11.7, 3.4, 0.5)
    plan.box(18.6, 8.3, 0.5, 1.6)
    return plan


def arena() -> Plan:
    """Return a hexagonal arena with posts and crates, as simulators have them."""
    plan = Plan(16.0, 14.0)
    angles = np.radians([0, 60, 120, 180, 240, 300])
    corners = [(8 + 7 * np.cos(a), 7 + 7 * np.sin(a) * 0.95) for a in angles]
    plan.wall_polygon(corners, 0.2)
    for x in (5.0, 8.0, 11.0):
        for y in (4.0, 7.0, 10.0):
            plan.disc(x, y, 0.3)
    plan.box(6.0, 5.2, 1.0, 0.6)
    plan.box(9.2, 8.3, 0.5, 1.1)
    plan.box(3.2, 6.6, 0.8, 0.8)
    return plan


def drive(plan: Plan, waypoints: list[tuple[float, float]], rng: np.random.Generator) -> tuple:
    """Return how often each cell was hit and passed by a scanner on its way."""
    hits = np.zeros(plan.solid.shape, dtype=np.int32)
    passes = np.zeros(plan.solid.shape, dtype=np.int32)
    for (ax, ay), (bx, by) in pairwise(waypoints):
        for share in np.arange(0, 1, 0.5 / max(np.hypot(bx - ax, by - ay), 0.5)):
            scan(plan, ax + (bx - ax) * share, ay + (by - ay) * share, hits, passes, rng)
    return hits, passes


def scan(
    plan: Plan, x: float, y: float, hits: Grid, passes: Grid, rng: np.random.Generator
) -> None:
    """Add one full turn of the scanner at (x, y) to the counts."""
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False) + rng.uniform(0, 0.004)
    steps = np.arange(0, RANGE_MAX / RESOLUTION, 0.5)
    cols = np.floor(x / RESOLUTION + np.outer(np.cos(angles), steps)).astype(int)
    rows = np.floor(y / RESOLUTION + np.outer(np.sin(angles), steps)).astype(int)
    height, width = plan.solid.shape
    inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    blocked = np.where(inside, plan.solid[rows % height, cols % width], True)
    first = np.where(blocked.any(axis=1), blocked.argmax(axis=1), steps.size - 1)
    seen = (np.arange(steps.size) < first[:, np.newaxis]) & inside
    np.add.at(passes, (rows[seen], cols[seen]), 1)
    # Range noise of up to a cell, and now and then a beam that is lost.
    kept = blocked.any(axis=1) & (rng.random(RAYS) > 0.02)
    ends = np.clip(first + rng.choice([0, 0, 0, 0, 0, 0, 1], RAYS), 0, steps.size - 1)
    ray = np.flatnonzero(kept)
    row, col = rows[ray, ends[ray]], cols[ray, ends[ray]]
    valid = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    np.add.at(hits, (row[valid], col[valid]), 3)


def gmapping_pixels(hits: Grid, passes: Grid) -> Grid:
    """Return pixels as map_saver writes them: 0 occupied, 254 free, 205 unknown."""
    pixels = np.full(hits.shape, 205, dtype=np.uint8)
    visited = hits + passes > 0
    ratio = hits / np.maximum(hits + passes, 1)
    pixels[visited] = 254
    pixels[visited & (ratio > 0.25)] = 0
    return pixels


def cartographer_pixels(hits: Grid, passes: Grid) -> Grid:
    """Return pixels as Cartographer writes a probability grid: grey levels, unknown 128."""

    def logit(p: Grid | float) -> Grid | float:
        return np.log(p / (1 - p))

    odds = hits / 3 * logit(0.55) * 3 + passes * logit(0.47)
    bound = logit(0.9)
    value = np.rint((np.clip(odds, -bound, bound) + bound) * 254 / (2 * bound)) + 1
    delta = 128 - value
    grey = np.where(delta > 0, 128 + delta, 128.0)
    opaque = np.where(delta < 0, -delta, 0) / 255
    grey = np.where(delta < 0, 128 * (1 - opaque) ** 2, grey)  # two submaps lie over each other
    grey[(hits + passes) == 0] = 128
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def on_canvas(pixels: Grid, width: int, height: int, unknown: int, row: int, col: int) -> Grid:
    """Return pixels (row 0 south) in a larger canvas, their first cell at (row, col)."""
    canvas = np.full((height, width), unknown, dtype=np.uint8)
    canvas[row : row + pixels.shape[0], col : col + pixels.shape[1]] = pixels
    return canvas


def save(name: str, pixels: Grid, comment: str, origin: tuple[float, float], suffix: str) -> None:
    """Write a map_server pair; pixels have row 0 in the south, images in the north."""
    image = np.ascontiguousarray(pixels[::-1])
    path = HERE / f"{name}{suffix}"
    if suffix == ".pgm":
        height, width = image.shape
        path.write_bytes(f"P5\n# {comment}\n{width} {height}\n255\n".encode() + image.tobytes())
    else:
        Image.fromarray(image).save(path, optimize=True)
    (HERE / f"{name}.yaml").write_text(
        f"image: {path.name}\n"
        f"resolution: {RESOLUTION:.6f}\n"
        f"origin: [{origin[0]:.6f}, {origin[1]:.6f}, 0.000000]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"
    )


def main() -> None:
    """Write all examples beside this script."""
    rng = np.random.default_rng(2026)
    corridor = [(1.5, 6.9), (9.0, 6.9), (14.0, 6.1), (19.5, 6.5)]
    rooms = [
        *[(2.5, 6.5), (2.5, 3.0), (2.5, 6.5)],
        *[(6.7, 6.5), (6.7, 3.0), (6.7, 6.9)],
        *[(11.5, 6.9), (11.5, 2.6), (11.5, 6.9)],
        *[(17.3, 6.5), (17.3, 2.4), (17.3, 6.5)],
        *[(17.9, 10.5), (17.9, 6.5)],
        *[(13.1, 6.9), (13.1, 8.9), (13.1, 6.9)],
        *[(8.5, 6.9), (8.5, 9.8)],
    ]
    hits, passes = drive(office(), corridor + rooms, rng)
    gmapping = on_canvas(gmapping_pixels(hits, passes), 544, 544, 205, 150, 60)
    comment = f"CREATOR: map_saver.cpp {RESOLUTION:.3f} m/pix"
    save("office", gmapping, comment, (-13.0, -13.8), ".pgm")

    known = np.argwhere(hits + passes > 0)
    low, high = known.min(axis=0), known.max(axis=0) + 1
    cropped = np.s_[low[0] : high[0], low[1] : high[1]]
    shape = high - low
    cartographer = on_canvas(
        cartographer_pixels(hits[cropped], passes[cropped]), shape[1] + 10, shape[0] + 10, 128, 5, 5
    )
    comment = f"Cartographer map; {RESOLUTION:g} m/pixel"
    save("office_cartographer", cartographer, comment, (-10.2341, -6.60975), ".pgm")

    loop = [(8.0, 2.5), (12.8, 5.0), (12.5, 9.0), (8.0, 11.8), (3.8, 9.0), (2.6, 5.6), (8.0, 2.5),
            (6.5, 7.0), (9.5, 6.4)]  # fmt: skip
    hits, passes = drive(arena(), loop, rng)
    canvas = on_canvas(gmapping_pixels(hits, passes), 1984, 1984, 205, 860, 840)
    save("arena", canvas, "", (-50.0, -50.0), ".png")


if __name__ == "__main__":
    main()
