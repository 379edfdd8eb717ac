"""Make the example cloud of a hall with a ramp, a table and a ceiling.

Run it as ``python examples/clouds/make_ramp.py``.

A robot with a spinning lidar drives up a ramp of 8 degrees to a platform, and back. Its points come
as SLAM leaves them: around the place where it started, with the sensor at height 0, and one point
for each voxel of 9 cm. Seeded: the file comes out the same every time.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
SENSOR_HEIGHT, NOISE, VOXEL = 0.5, 0.01, 0.09  # metres
PLATFORM = 0.35  # metres above the floor
RAMP = (3.0, 3.0 + PLATFORM / math.tan(math.radians(8)))  # from where to where along x
HALL = (8.5, 5.0, 2.6)  # metres
PLACES = [
    (1.2, 2.5, 0.0),
    (2.4, 4.0, 0.0),
    (2.6, 1.0, 0.0),
    (4.2, 2.5, 0.17),
    (5.6, 2.4, PLATFORM),
    (7.4, 2.6, PLATFORM),
    (5.0, 0.8, 0.0),
    (5.0, 4.2, 0.0),
    (7.8, 0.9, 0.0),
    (7.6, 4.2, 0.0),
]


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> np.ndarray:
    """Return the planes of a box: normals, and how far they are from the origin."""
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    return np.column_stack([normals, [x1, y1, z1, -x0, -y0, -z0]])


def solids() -> list[np.ndarray]:
    """Return what stands in the hall, and the hall itself, as convex solids."""
    length, width, height = HALL
    rise = PLATFORM / (RAMP[1] - RAMP[0])
    ramp = np.vstack([box(*RAMP, 1.6, 3.4, 0, 1), [-rise, 0, 1, -rise * RAMP[0]]])
    found = [
        ramp,
        box(RAMP[1], length, 1.6, 3.4, 0, PLATFORM),
        box(0, length, 0, width, -0.1, 0),
        box(0, length, 0, width, height, height + 0.1),
        box(-0.1, 0, 0, width, 0, height),
        box(length, length + 0.1, 0, width, 0, height),
        box(0, length, -0.1, 0, 0, height),
        box(0, length, width, width + 0.1, 0, height),
        box(0.5, 1.7, 3.6, 4.3, 0.71, 0.75),  # the table, and its legs
        box(3.5, 3.9, 4.2, 4.8, 2.0, 2.1),  # a lamp
        box(6.5, 7.3, 0.0, 0.5, 0, 1.2),  # a cupboard
    ]
    return found + [
        box(x, x + 0.06, y, y + 0.06, 0, 0.71) for x in (0.5, 1.64) for y in (3.6, 4.24)
    ]


def ranges(place: np.ndarray, rays: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Return how far away each ray enters a solid, metres; inf for none."""
    along, gap = rays @ solid[:, :3].T, solid[:, 3] - solid[:, :3] @ place
    with np.errstate(divide="ignore", invalid="ignore"):
        at = gap / along
    enters = np.where(along < 0, at, -np.inf).max(axis=1)
    leaves = np.where(along > 0, at, np.inf).min(axis=1)
    misses = ((along == 0) & (gap < 0)).any(axis=1) | (enters >= leaves) | (enters <= 0)
    return np.where(misses, np.inf, enters)


def cloud() -> np.ndarray:
    """Return the points, shape (N, 3), float32."""
    random = np.random.default_rng(8)
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(0, 360, 0.6)), np.radians(np.linspace(-50, 60, 90))
    )
    flat = np.cos(elevation)
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)
    rays = rays.reshape(-1, 3)
    parts = []
    for x, y, floor in PLACES:
        place = np.array([x, y, floor + SENSOR_HEIGHT])
        found = np.min([ranges(place, rays, solid) for solid in solids()], axis=0)
        found = found + random.normal(0, NOISE, len(found))
        parts.append(place + found[:, np.newaxis] * rays)
    x, y, floor = PLACES[0]
    points = np.concatenate(parts) - np.array([x, y, floor + SENSOR_HEIGHT])
    voxels = np.floor(points / VOXEL)
    _, whose, counts = np.unique(voxels, axis=0, return_inverse=True, return_counts=True)
    means = [np.bincount(whose.ravel(), one) / counts for one in points.T]
    return np.stack(means, axis=1)[counts >= 2].astype("<f4")


def main() -> None:
    """Write the cloud as binary PCD."""
    points = cloud()
    header = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
        "DATA binary\n"
    )
    (HERE / "ramp.pcd").write_bytes(header.encode() + points.tobytes())


if __name__ == "__main__":
    main()
