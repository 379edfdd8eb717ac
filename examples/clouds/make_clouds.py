"""Make the example clouds.

Run it as ``python examples/clouds/make_clouds.py``.

A robot with a laser scanner of some rings drives along the corridor of the example office, past a
person who is not on the map. Seeded: the files come out the same every time.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

import mapdeal

HERE = Path(__file__).parent
POSES = [(-2.0, 0.3, 0.0), (-1.5, 0.3, 0.1), (-1.0, 0.35, 0.3), (-0.5, 0.5, 0.2)]
PERSON = (1.2, 0.9, 0.25)  # x, y, radius, metres
SENSOR_HEIGHT, WALL_HEIGHT = 0.4, 2.5  # metres
ELEVATIONS = np.radians([-15.0, -5.0, 0.0, 5.0, 12.0])
AZIMUTHS = np.radians(np.arange(-135.0, 135.0, 1.0))
RANGE_MAX, STEP = 12.0, 0.01  # metres


def ranges(office: mapdeal.OccupancyGrid, pose: tuple[float, float, float]) -> np.ndarray:
    """Return the distance to the first obstacle along each azimuth, metres; inf for none."""
    x, y, yaw = pose
    along = np.arange(STEP, RANGE_MAX, STEP)
    rays = np.stack([np.cos(AZIMUTHS + yaw), np.sin(AZIMUTHS + yaw)], axis=-1)
    points = np.array([x, y]) + along[:, np.newaxis, np.newaxis] * rays
    cells, inside = office.frame.bounded_rowcol_from_xy(points.reshape(-1, 2))
    solid = (inside & office.occupied()[cells[:, 0], cells[:, 1]]).reshape(points.shape[:2])
    solid |= np.hypot(points[..., 0] - PERSON[0], points[..., 1] - PERSON[1]) <= PERSON[2]
    return np.where(solid.any(axis=0), along[solid.argmax(axis=0)], np.inf)


def cloud(office: mapdeal.OccupancyGrid, pose: tuple[float, float, float]) -> np.ndarray:
    """Return what the scanner sees: x, y, z in the robot's frame, float32."""
    walls = ranges(office, pose)
    parts = []
    for elevation in ELEVATIONS:
        slope = math.tan(elevation)
        ground = -SENSOR_HEIGHT / slope if slope < 0 else np.inf
        distance = np.minimum(walls, ground)
        height = SENSOR_HEIGHT + distance * slope
        seen = np.isfinite(distance) & (height <= WALL_HEIGHT)
        level = distance[seen]
        turned = AZIMUTHS[seen]
        parts.append(
            np.stack([level * np.cos(turned), level * np.sin(turned), height[seen]], axis=1)
        )
    points = np.concatenate(parts)
    points += np.random.default_rng(round(pose[0] * 10) + 100).normal(0, 0.005, points.shape)
    return points.astype("<f4")


def main() -> None:
    """Write the clouds as binary PCD, and the poses."""
    office = mapdeal.read_map(HERE.parent / "maps" / "office.yaml")
    lines = ["# x y yaw"]
    for number, pose in enumerate(POSES):
        points = cloud(office, pose)
        header = (
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
            "DATA binary\n"
        )
        (HERE / f"corridor{number}.pcd").write_bytes(header.encode() + points.tobytes())
        lines.append(" ".join(str(value) for value in pose))
    (HERE / "corridor_poses.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
