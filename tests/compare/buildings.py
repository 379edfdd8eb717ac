"""Buildings to align, drawn from their walls at any turn, resolution and origin."""

import math

import numpy as np

from mapdeal.grid.frame import Frame, Transform
from mapdeal.grid.occupancy import OccupancyGrid

WALLS = [
    ((0, 0), (24, 0)), ((24, 0), (24, 15)), ((24, 15), (0, 15)), ((0, 15), (0, 0)),
    ((0, 6), (7, 6)), ((9, 6), (16, 6)), ((17.5, 6), (24, 6)), ((8, 6), (8, 11)),
    ((8, 13), (8, 15)), ((16, 9), (16, 15)), ((16, 9), (20, 9)), ((5, 0), (5, 4)),
    ((12, 2), (12, 6)), ((19, 0), (19, 2.5)), ((3, 9), (5, 9)), ((11, 10), (13, 10)),
]  # fmt: skip
"""Of a building of 24 x 15 m, in metres: rooms of different sizes, doors, a table, a shelf."""

OTHER_WALLS = [
    ((0, 0), (18, 0)), ((18, 0), (18, 21)), ((18, 21), (0, 21)), ((0, 21), (0, 0)),
    ((4, 0), (4, 8)), ((4, 10), (4, 21)), ((14, 3), (14, 21)), ((4, 12), (9, 12)),
    ((10.5, 12), (14, 12)), ((4, 17), (14, 17)), ((7, 4), (7, 7)), ((10, 4), (10, 7)),
]  # fmt: skip
"""Of another building."""

HALL = [((0, 0), (20, 0)), ((20, 0), (20, 9)), ((20, 9), (0, 9)), ((0, 9), (0, 0))]
"""Of a hall that looks the same from both of its ends."""


def drawn(walls, resolution, place=None, origin_yaw=0.0, thickness=0.12, margin=0.7):
    """A map of a building at a place in the map frame; its inside is free, all else unknown."""
    place, ends = place or Transform(), np.array(walls, dtype=float).reshape(-1, 2)
    corners = [[x, y] for x in (0, ends[:, 0].max()) for y in (0, ends[:, 1].max())]
    lattice = Transform(yaw=origin_yaw)
    inside = lattice.inverse().points(place.points(corners))
    low = inside.min(axis=0) - margin
    width, height = np.ceil((inside.max(axis=0) + margin - low) / resolution).astype(int)
    x, y = lattice.points([low])[0]
    frame = Frame(int(height), int(width), resolution, (float(x), float(y), origin_yaw))
    rows, cols = np.indices(frame.shape).reshape(2, -1)
    points = place.inverse().points(frame.xy_from_rowcol(np.stack([rows, cols], axis=-1)))
    values = np.full(len(points), -1, dtype=np.int8)
    values[((points > 0) & (points < ends.max(axis=0))).all(axis=1)] = 0
    reach = max(thickness / 2, resolution * 0.71)
    for start, end in walls:
        values[_distances(points, np.array(start, float), np.array(end, float)) <= reach] = 100
    return OccupancyGrid(values.reshape(frame.shape), resolution, frame.origin)


def cut(grid, place, keep):
    """A map that knows a building only where `keep(x)` is true, x along the building."""
    cells = np.argwhere(np.ones(grid.shape, dtype=bool))
    x = place.inverse().points(grid.frame.xy_from_rowcol(cells))[:, 0].reshape(grid.shape)
    return grid.with_values(np.where(keep(x), grid.occupancy, -1).astype(np.int8))


def between(first, second):
    """The transform from one map's frame to the other's, given the places of both."""
    return second.after(first.inverse())


def errors(found, true, grid):
    """How far walls of a map are from where they should be, on average, and the turn's error."""
    walls = grid.frame.xy_from_rowcol(np.argwhere(grid.occupied()))
    off = np.hypot(*(found.points(walls) - true.points(walls)).T).mean()
    return float(off), abs(math.degrees(math.remainder(found.yaw - true.yaw, 2 * math.pi)))


def _distances(points, start, end):
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0, 1)
    return np.hypot(*(points - start - share[:, None] * along).T)
