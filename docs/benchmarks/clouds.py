"""How well maps of point clouds agree with the worlds that they are of, and how fast they come.

Run it as ``python docs/benchmarks/clouds.py [--only worlds|speed] [--world NAME] [--images DIR]``.

`WORLDS` are made of convex solids. `World.scan` follows the beams of a spinning lidar along a path
and returns clouds with noise and drift; `World.truth` measures the solids in each cell, and knows
nothing of beams or points. Seeded: the same every time.

The peer is the usual way from a cloud to a map, as in pcd2pgm: the points of a fixed band of
heights, without those that have few others around them, are obstacles, and all other cells are
free. It has its default numbers once, and once the band that is best for each cloud. Prints tables
in Markdown; fails on nothing.
"""

from __future__ import annotations

import argparse
import itertools
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.mapping.cloud_map import CloudMapper, cloud_map
from mapdeal.maps.reading import read_map
from mapdeal.sensors.clouds import read_cloud

RAMP = Path(__file__).parents[2] / "examples" / "clouds" / "ramp.pcd"
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
SAMPLES = 6  # a side, in each cell of a true map, with its edges
SHIFT = np.array([0.013, 0.021])  # of all worlds: no wall lies on the edges of cells


@dataclass(frozen=True)
class Solid:
    """A convex solid: the points p with normals p <= offsets."""

    normals: np.ndarray
    offsets: np.ndarray
    is_floor: bool = False  # a robot drives on it
    is_drop: bool = False  # a robot falls onto it
    clear: float = 0.0  # share of beams that pass through, as through glass
    only_in: tuple[float, float] = (0.0, 1.0)  # part of the run during which it is there
    ball: tuple[float, float, float, float] | None = None  # centre and radius around it

    def enter(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Return the range at which each ray enters; inf for none."""
        if self.ball is not None:
            *centre, radius = self.ball
            to = np.array(centre) - origin
            rest = to @ to - radius * radius
            if rest > 0:
                near = rays @ to >= math.sqrt(rest)
                found = np.full(len(rays), np.inf)
                found[near] = replace(self, ball=None).enter(origin, rays[near])
                return found
        along, gap = rays @ self.normals.T, self.offsets - self.normals @ origin
        with np.errstate(divide="ignore", invalid="ignore"):
            at = gap / along
        enters = np.where(along < 0, at, -np.inf).max(axis=1)
        leaves = np.where(along > 0, at, np.inf).min(axis=1)
        misses = ((along == 0) & (gap < 0)).any(axis=1) | (enters >= leaves) | (enters <= 0)
        return np.where(misses, np.inf, enters)

    def heights(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return between which heights it is over points; the first is larger where it is not."""
        low, high = np.full(x.shape, -np.inf), np.full(x.shape, np.inf)
        for (a, b, c), offset in zip(self.normals, self.offsets, strict=True):
            rest = offset - a * x - b * y
            if c > 1e-12:
                high = np.minimum(high, rest / c)
            elif c < -1e-12:
                low = np.maximum(low, rest / c)
            else:
                low = np.where(rest < 0, np.inf, low)
        return low, high


def box(x0, x1, y0, y1, z0, z1, **more) -> Solid:
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = np.array([x1, y1, z1, -x0, -y0, -z0], dtype=float)
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)
    radius = math.dist((x0, y0, z0), (x1, y1, z1)) / 2
    return Solid(normals, offsets, ball=(*middle, radius), **more)


def ramp(x0, x1, y0, y1, low, high) -> Solid:
    """Return a wedge whose top rises along x from one height to the other."""
    base = box(x0, x1, y0, y1, min(low, high) - 0.3, max(low, high) + 1)
    rise = (high - low) / (x1 - x0)
    top = np.array([-rise, 0.0, 1.0])
    normals = np.concatenate([base.normals, [top]])
    return Solid(normals, np.append(base.offsets, low - rise * x0), is_floor=True)


def post(x, y, radius, height, base=0.0) -> Solid:
    angles = np.arange(8) * math.pi / 4
    sides = np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], axis=1)
    normals = np.concatenate([sides, [[0, 0, 1], [0, 0, -1]]])
    offsets = np.append(sides @ np.array([x, y, 0]) + radius, [base + height, -base])
    ball = (x, y, base + height / 2, height / 2 + 1.1 * radius)
    return Solid(normals, offsets, ball=ball)


def table(x, y, long=1.2, wide=0.7, height=0.75, base=0.0) -> list[Solid]:
    legs = [
        post(x + i * (long / 2 - 0.05), y + j * (wide / 2 - 0.05), 0.025, height - 0.04, base)
        for i in (-1, 1)
        for j in (-1, 1)
    ]
    top = (base + height - 0.04, base + height)
    return [*legs, box(x - long / 2, x + long / 2, y - wide / 2, y + wide / 2, *top)]


def shelf(x, y, long, deep, levels=(0.15, 0.7, 1.3, 1.9)) -> list[Solid]:
    boards = [box(x, x + long, y, y + deep, z, z + 0.04) for z in levels]
    uprights = [
        box(x + i * (long - 0.06), x + i * (long - 0.06) + 0.06, y + j * (deep - 0.06),
            y + j * (deep - 0.06) + 0.06, 0, 2.0)
        for i in (0, 1) for j in (0, 1)
    ]  # fmt: skip
    return boards + uprights


def room(x0, x1, y0, y1, height=2.6, ceiling=True, floor=0.0, thick=0.13) -> list[Solid]:
    walls = [
        box(x0 - thick, x1 + thick, y0 - thick, y0, floor - 0.3, height),
        box(x0 - thick, x1 + thick, y1, y1 + thick, floor - 0.3, height),
        box(x0 - thick, x0, y0, y1, floor - 0.3, height),
        box(x1, x1 + thick, y0, y1, floor - 0.3, height),
    ]
    return walls + ([box(x0, x1, y0, y1, height, height + 0.2)] if ceiling else [])


def wall_with_door(x, y0, y1, door, width=0.9, height=2.6, lintel=2.05) -> list[Solid]:
    """Return a wall along y with a door, and what is above it."""
    return [
        box(x, x + 0.13, y0, door - width / 2, 0, height),
        box(x, x + 0.13, door + width / 2, y1, 0, height),
        box(x, x + 0.13, door - width / 2, door + width / 2, lintel, height),
    ]


def ground(x0, x1, y0, y1, z=0.0) -> Solid:
    return box(x0, x1, y0, y1, -0.3, z, is_floor=True)


class Truth(NamedTuple):
    """The true map, and the cells in which a beam without noise ends."""

    values: np.ndarray
    is_seen: np.ndarray
    origin: tuple[float, float]
    resolution: float


class Scan(NamedTuple):
    points: np.ndarray  # in the frame of the sensor
    pose: np.ndarray  # x, y, z of the sensor, and its yaw, as SLAM has them


@dataclass
class World:
    solids: list[Solid]
    path: list[tuple[float, float, float]]  # x, y, z of the sensor
    noise: float = 0.015
    drift: float = 0.0
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)  # axis x, y; angle in degrees
    outliers: float = 0.001
    steps: int = 45
    rings: Sequence[float] = field(default_factory=lambda: np.linspace(-35, 25, 32).tolist())
    azimuths: int = 600

    def rays(self) -> np.ndarray:
        azimuth = np.arange(self.azimuths) * (2 * math.pi / self.azimuths)
        elevation = np.radians(np.array(self.rings))[:, np.newaxis]
        flat = np.cos(elevation)
        up = np.broadcast_to(np.sin(elevation), (len(self.rings), self.azimuths))
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], -1).reshape(-1, 3)

    def places(self) -> np.ndarray:
        corners = np.array(self.path)
        lengths = np.append(0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
        at = np.linspace(0, lengths[-1], self.steps)
        return np.stack([np.interp(at, lengths, one) for one in corners.T], axis=1)

    def scan(self, seed: int = 1, *, exact: bool = False) -> Iterator[Scan]:
        """Yield a cloud for each place on the path."""
        random = np.random.default_rng(seed)
        places, rays = self.places(), self.rays()
        walk = np.cumsum(random.normal(0, 1, (self.steps, 4)), axis=0)
        walk -= np.linspace(0, 1, self.steps)[:, np.newaxis] * walk[-1]
        walk *= self.drift / max(float(np.abs(walk).max()), 1e-9)
        for k, place in enumerate(places):
            turn = random.uniform(0, 2 * math.pi / self.azimuths)
            cos, sin = math.cos(turn), math.sin(turn)
            turned = np.stack(
                [rays[:, 0] * cos - rays[:, 1] * sin, rays[:, 0] * sin + rays[:, 1] * cos,
                 rays[:, 2]], axis=1,
            )  # fmt: skip
            ranges = np.full(len(rays), np.inf)
            for solid in self.solids:
                first, last = solid.only_in
                if not first <= k / self.steps <= last:
                    continue
                hit = solid.enter(place, turned)
                if solid.clear:
                    hit = np.where(random.random(len(rays)) < solid.clear, np.inf, hit)
                ranges = np.minimum(ranges, hit)
            seen = ranges < 25.0
            ranges, turned = ranges[seen], turned[seen]
            if not exact:
                ranges = ranges + random.normal(0, self.noise, len(ranges))
                odd = random.random(len(ranges)) < self.outliers
                ranges = np.where(odd, ranges * random.uniform(0.3, 1.0, len(ranges)), ranges)
            pose = np.array([*(place[:2] + SHIFT), place[2], 0.0])
            if not exact:
                pose = pose + walk[k] * np.array([1, 1, 1, 0.05])
            yield Scan(ranges[:, np.newaxis] * turned, pose)

    def cloud(self, seed: int = 1, *, exact: bool = False) -> np.ndarray:
        """Return the points of all scans in the frame of the map."""
        points = np.concatenate([placed(scan) for scan in self.scan(seed, exact=exact)])
        return points if exact else self.tilted(points)

    def tilted(self, points: np.ndarray) -> np.ndarray:
        x, y, degrees = self.tilt
        if not degrees:
            return points
        angle, axis = math.radians(degrees), np.array([x, y, 0.0]) / math.hypot(x, y)
        cos, sin = math.cos(angle), math.sin(angle)
        along = (points @ axis)[:, np.newaxis] * axis
        return points * cos + np.cross(axis, points) * sin + along * (1 - cos)

    def truth(self, resolution=0.05, climb=0.05, robot_height=1.0) -> Truth:
        """Return the true map on the lattice of the resolution."""
        x0, y0, x1, y1 = self.extent()
        first = np.floor(np.array([x0, y0]) / resolution - 1e-9).astype(int) - 4
        last = np.ceil(np.array([x1, y1]) / resolution + 1e-9).astype(int) + 4
        width, height = (last - first).tolist()
        within = np.linspace(0, 1, SAMPLES)
        at, up = ((np.arange(n)[:, np.newaxis] + within).ravel() for n in (width, height))
        x, y = np.meshgrid((first[0] + at) * resolution, (first[1] + up) * resolution)
        floor = np.full(x.shape, -np.inf)
        always = [one for one in self.solids if one.only_in == (0.0, 1.0)]
        for one in always:
            if one.is_floor:
                low, high = one.heights(x - SHIFT[0], y - SHIFT[1])
                floor = np.where(low < high, np.maximum(floor, high), floor)
        stands, is_drop = np.zeros(x.shape, bool), np.zeros(x.shape, bool)
        for one in always:
            low, high = one.heights(x - SHIFT[0], y - SHIFT[1])
            if one.is_drop:
                is_drop |= (low < high) & ~np.isfinite(floor)
            elif not one.is_floor:
                base = np.where(np.isfinite(floor), floor, 0.0)
                stands |= (low < high) & (high > base + climb) & (low < base + robot_height)

        def blocks(values):
            return values.reshape(height, SAMPLES, width, SAMPLES).transpose(0, 2, 1, 3)

        of_floor = blocks(floor).reshape(height, width, -1)
        with np.errstate(invalid="ignore"):
            is_ledge = of_floor.max(axis=2) - of_floor.min(axis=2) > climb
        is_ledge &= np.isfinite(of_floor).all(axis=2)
        occupied = blocks(stands).any(axis=(2, 3)) | blocks(is_drop).any(axis=(2, 3)) | is_ledge
        free = np.isfinite(of_floor).all(axis=2) & ~occupied
        values = np.where(occupied, OCCUPIED, np.where(free, FREE, UNKNOWN))
        seen = np.zeros(values.shape, bool)
        points = self.cloud(7, exact=True)
        cells = np.floor(points[:, :2] / resolution).astype(int) - first
        inside = ((cells >= 0) & (cells < [width, height])).all(axis=1)
        cells, z = cells[inside], points[inside, 2]
        base = of_floor.max(axis=2)[cells[:, 1], cells[:, 0]]
        low = z < np.where(np.isfinite(base), base, 0.0) + robot_height
        seen[cells[low, 1], cells[low, 0]] = True
        return Truth(values, seen, tuple((first * resolution).tolist()), resolution)

    def extent(self) -> tuple[float, float, float, float]:
        sides = [one.offsets for one in self.solids if len(one.offsets) == 6]
        x1, y1 = (max(float(one[k]) for one in sides) for k in (0, 1))
        x0, y0 = (min(-float(one[3 + k]) for one in sides) for k in (0, 1))
        return x0, y0, x1, y1


def placed(scan: Scan) -> np.ndarray:
    x, y, z, yaw = scan.pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    points = scan.points
    turned = np.stack([points[:, 0] * cos - points[:, 1] * sin,
                       points[:, 0] * sin + points[:, 1] * cos, points[:, 2]], axis=1)  # fmt: skip
    return turned + np.array([x, y, z])


def rooms(**more) -> World:
    """Return two rooms with a door, tables, a lamp, a cupboard, thin posts, a door's lintel."""
    solids = [ground(0, 10, 0, 6), *room(0, 10, 0, 6), *wall_with_door(5.02, 0, 6, 3.1)]
    solids += [*table(2.03, 4.62), *table(7.8, 1.3), *table(8.3, 4.9, 1.6, 0.8)]
    solids += [box(0.0, 0.42, 1.0, 2.23, 0, 1.9), box(6.2, 7.13, 5.57, 6, 0, 0.9)]
    solids += [post(3.71, 2.22, 0.03, 1.4), post(6.43, 3.21, 0.04, 2.6)]
    solids += [box(2, 2.6, 2, 2.6, 2.2, 2.3), box(7, 7.6, 3, 3.6, 1.8, 1.9)]
    return World(solids, [(1.2, 3.2, 0.6), (4, 3.1, 0.6), (6, 3.1, 0.6), (8.8, 3.0, 0.6),
                          (6.8, 4.4, 0.6), (6, 3.1, 0.6), (3.2, 3.1, 0.6), (3, 1.2, 0.6)],
                 **more)  # fmt: skip


def ramps(degrees: float) -> World:
    """Return a hall with a ramp up to a platform, which has a table and open edges."""
    rise = 0.5
    x1 = 3.02 + rise / math.tan(math.radians(degrees))
    x2 = x1 + 4.0
    solids = [ground(0, 3.02, 0, 6), ground(3.02, x2, 0, 1.52), ground(3.02, x2, 3.53, 6)]
    solids += [ramp(3.02, x1, 1.52, 3.53, 0.0, rise), ground(x1, x2, 1.52, 3.53, rise)]
    solids += [*room(0, x2, 0, 6, 3.2), *table(x1 + 2.2, 2.53, base=rise), *table(1.7, 4.8)]
    solids += [post(x1 - 0.5, 1.9, 0.04, 1.2, rise * (1 - 0.5 / (x1 - 3.02)) - 0.02)]
    path = [(1, 2.5, 0.6), (3.0, 2.5, 0.6), (x1, 2.5, 0.6 + rise), (x2 - 1, 2.1, 0.6 + rise),
            (x1, 2.5, 0.6 + rise), (3.0, 2.5, 0.6), (2.5, 0.8, 0.6), (x2 - 1, 0.8, 0.6),
            (2.5, 0.8, 0.6), (2.5, 4.6, 0.6), (x2 - 1, 4.5, 0.6)]  # fmt: skip
    return World(solids, path, steps=60)


def steps() -> World:
    """Return rooms with a threshold that a robot climbs, a kerb that it does not, and stairs."""
    solids = [ground(0, 8.5, 0, 5), *room(0, 8.5, 0, 5), *wall_with_door(4.02, 0, 5, 2.5)]
    solids += [box(3.9, 4.25, 2.05, 2.95, -0.1, 0.03, is_floor=True)]
    solids += [box(6.52, 7.13, 0, 1.52, 0, 0.12), box(7.13, 7.74, 0, 1.52, 0, 0.28)]
    solids += [box(7.74, 8.5, 0, 1.52, 0, 0.44), box(1.02, 2.53, 3.53, 5, 0, 0.15)]
    return World(solids, [(1, 2, 0.6), (3, 2.5, 0.6), (5, 2.5, 0.6), (7.5, 3, 0.6),
                          (5, 1, 0.6), (5, 2.5, 0.6), (3, 2.5, 0.6), (2, 1, 0.6)])  # fmt: skip


def warehouse() -> World:
    """Return racks of shelves, pallets and posts under a high ceiling."""
    solids = [ground(0, 14, 0, 8), *room(0, 14, 0, 8, 5.0)]
    for y in (1.52, 4.03, 6.51):
        for x in (2.03, 5.04, 8.53):
            solids += shelf(x, y, 2.7, 0.6)
    solids += [box(12.2, 13.4, 1.23, 2.03, 0, 0.14), box(12.3, 13.1, 5.02, 5.83, 0, 0.6)]
    solids += [post(1.03, 3.02, 0.04, 1.1), post(11.72, 3.63, 0.06, 5), box(4, 10, 2, 2.2, 3, 3.3)]
    path = [(1, 0.8, 0.5), (11.7, 0.8, 0.5), (11.5, 3.0, 0.5), (1.2, 3.5, 0.5), (1.2, 5.6, 0.5),
            (11.6, 5.6, 0.5), (12.8, 4, 0.5), (12.5, 7.3, 0.5), (1, 7.5, 0.5)]  # fmt: skip
    return World(solids, path, steps=60)


def glass() -> World:
    """Return a hall whose wall is of glass in part, with a corridor behind it."""
    solids = [ground(0, 9, 0, 7), *room(0, 9, 0, 7)]
    solids += [box(0, 3.02, 4.52, 4.65, 0, 2.6), box(6.03, 7.5, 4.52, 4.65, 0, 2.6)]
    solids += [box(3.02, 6.03, 4.57, 4.59, 0, 2.6, clear=0.85)]
    solids += [*table(2, 2.4), *table(6.7, 1.6), box(8.3, 9, 0, 1.1, 0, 1.2)]
    return World(solids, [(1, 1, 0.6), (4.5, 3.2, 0.6), (8, 3, 0.6), (8.2, 5.6, 0.6),
                          (1, 5.8, 0.6)])  # fmt: skip


def levels() -> World:
    """Return two floors 1.2 m apart, one beside the other, joined by a ramp; a low beam."""
    solids = [ground(0, 6, 0, 6), ground(6, 14.03, 2.53, 6), ramp(6, 14.03, 0, 2.53, 0, 1.2)]
    solids += [ground(14.03, 19, 0, 6, 1.2), *room(0, 19, 0, 6, 4.0)]
    solids += [box(6, 14.03, 2.53, 2.63, 0, 1.4)]
    solids += [*table(3, 4.5), *table(17, 4.2, base=1.2), box(4.52, 4.8, 0, 6, 1.6, 1.9)]
    solids += [box(8.02, 8.63, 4.02, 4.83, 0, 0.8), box(15.02, 15.13, 3.53, 6, 1.2, 3.0)]
    path = [(1, 3, 0.6), (5, 1.3, 0.6), (6, 1.3, 0.6), (14, 1.3, 1.8), (17.5, 2, 1.8),
            (14.6, 1.5, 1.8), (14, 1.3, 1.8), (6, 1.3, 0.6), (5.5, 3.5, 0.6), (12.5, 3.6, 0.6),
            (9, 5.3, 0.6)]  # fmt: skip
    return World(solids, path, steps=60)


def drops() -> World:
    """Return a loading dock: a floor that ends at a drop, and a pit in it."""
    solids = [ground(0, 6.02, 0, 6), *room(0, 10, 0, 6, 3.0, floor=-0.6)]
    solids[0] = ground(0, 6.02, 0, 2.02)
    solids += [ground(0, 2.03, 2.02, 3.53), ground(3.52, 6.02, 2.02, 3.53),
               ground(0, 6.02, 3.53, 6)]  # fmt: skip
    solids += [box(2.03, 3.52, 2.02, 3.53, -0.5, -0.25, is_drop=True)]
    solids += [box(6.02, 10, 0, 6, -0.9, -0.6, is_drop=True), *table(1.2, 5)]
    return World(solids, [(1, 1, 0.6), (5, 1, 0.6), (5.3, 4.7, 0.6), (2.6, 4.7, 0.6),
                          (1.2, 3, 0.6), (3, 1, 0.6)])  # fmt: skip


def people() -> World:
    """Return the rooms, through which people walk while they are mapped."""
    world = rooms(steps=90)
    for k in range(24):
        x, y = 0.9 + 0.33 * k, 3.75 + 0.3 * math.sin(k)
        walker = post(x, y, 0.22, 1.7)
        world.solids.append(replace(walker, only_in=(0.3 + k / 90, 0.3 + (k + 0.9) / 90)))
    return world


WORLDS: dict[str, Callable[[], World]] = {
    "rooms": rooms,
    "ramp of 5 degrees": lambda: ramps(5),
    "ramp of 10 degrees": lambda: ramps(10),
    "steps": steps,
    "warehouse": warehouse,
    "glass": glass,
    "two levels": levels,
    "drops": drops,
    "tilted by 4 degrees": lambda: rooms(tilt=(1, 0.6, 4)),
    "drift of 3 cm": lambda: rooms(drift=0.03),
    "noise of 3 cm": lambda: rooms(noise=0.03),
    "people": people,
}
"""What makes each world."""


BAND, RADIUS, NEIGHBOURS = (0.2, 2.0), 0.5, 10
"""Defaults of pcd2pgm: heights, and the points that must lie around each."""

LOWS = (-0.5, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.3)
HIGHS = (0.3, 0.5, 0.8, 1.0, 1.2, 1.5, 2.0, 2.2)


def peer(points: np.ndarray, truth: Truth, band=BAND, radius=RADIUS, least=NEIGHBOURS):
    """Return the map that the usual way makes."""
    low, high = band
    kept = points[(points[:, 2] >= low) & (points[:, 2] <= high)]
    if len(kept) and least:
        # more than enough points are enough, and voxels of 2 cm keep the search short
        _, first = np.unique(np.floor(kept / 0.02).astype(int), axis=0, return_index=True)
        kept = kept[first]
        away, _ = cKDTree(kept).query(kept, k=[min(least, len(kept))], distance_upper_bound=radius)
        kept = kept[np.isfinite(away[:, 0])]
    values = np.full(truth.values.shape, FREE)
    cells = np.floor((kept[:, :2] - truth.origin) / truth.resolution + 1e-9).astype(int)
    height, width = values.shape
    inside = ((cells >= 0) & (cells < [width, height])).all(axis=1)
    values[cells[inside, 1], cells[inside, 0]] = OCCUPIED
    # the map ends where the points end, and beyond it nothing is said
    for axis, size in ((0, width), (1, height)):
        place = np.floor((points[:, axis] - truth.origin[axis]) / truth.resolution).astype(int)
        outside = np.ones(size, bool)
        outside[max(place.min(), 0) : place.max() + 1] = False
        values[(slice(None), outside) if axis == 0 else (outside, slice(None))] = -1
    return values


def best_peer(points: np.ndarray, truth: Truth) -> tuple[tuple[float, float], float, float]:
    """Return the best that any band comes to, for obstacles and for free space on its own."""
    every = [
        (band, scores(peer(points, truth, band, least=0), truth))
        for band in itertools.product(LOWS, HIGHS)
        if band[0] < band[1]
    ]
    band = max(every, key=lambda one: sum(one[1]))[0]
    every.append((band, scores(peer(points, truth, band), truth)))
    return band, max(one[1][0] for one in every), max(one[1][1] for one in every)


def scores(values: np.ndarray, truth: Truth) -> tuple[float, float]:
    """Return intersection over union of obstacles and of free space."""
    # Nothing is asked about what no beam could see: the inside of solids, floor behind them.
    seen = np.pad(truth.is_seen, 1)
    around = np.lib.stride_tricks.sliding_window_view(seen, (3, 3)).any(axis=(2, 3))
    is_open = truth.values == FREE
    is_solid = truth.values == OCCUPIED
    counts = ~(is_open & ~around) & ~(is_solid & ~truth.is_seen)
    found = []
    for state in (OCCUPIED, FREE):
        ours, theirs = (values == state) & counts, (truth.values == state) & counts
        found.append(float((ours & theirs).sum() / max((ours | theirs).sum(), 1)))
    return found[0], found[1]


def frame_of(truth: Truth) -> Frame:
    height, width = truth.values.shape
    return Frame(height, width, truth.resolution, (*truth.origin, 0.0))


def ours(world: World, points: np.ndarray, truth: Truth) -> np.ndarray:
    made = cloud_map(points, frame=frame_of(truth), level=bool(world.tilt[2]))
    return np.asarray(made.grid.occupancy)


def ours_with_poses(world: World, frame: Frame | None = None) -> OccupancyGrid:
    mapper = CloudMapper(frame=frame)
    for scan in world.scan():
        mapper.add(placed(scan))
        mapper.add_place(scan.pose[:3])
    mapper.settle(follows_beams=True)
    for scan in world.scan():
        mapper.clear(placed(scan), scan.pose[:3])
    return mapper.result().grid


def drawn(values: np.ndarray) -> Image.Image:
    shades = np.full(values.shape, 205, np.uint8)
    shades[values == FREE], shades[values == OCCUPIED] = 254, 0
    return Image.fromarray(shades[::-1]).resize((values.shape[1] * 3, values.shape[0] * 3), 0)


def print_worlds(names: list[str], images: Path | None) -> None:
    print("| world | points | band, default | best band | mapdeal | mapdeal with poses |")
    print("|---|---|---|---|---|---|")
    for name in names:
        world = WORLDS[name]()
        points, truth = world.cloud(), world.truth()
        default = peer(points, truth)
        band, *best = best_peer(points, truth)
        made = ours(world, points, truth)
        cells = [scores(default, truth), best, scores(made, truth)]
        posed = None
        if not world.tilt[2]:
            posed = np.asarray(ours_with_poses(world, frame_of(truth)).occupancy)
            cells.append(scores(posed, truth))
        told = " | ".join(f"{occupied:.2f} / {free:.2f}" for occupied, free in cells)
        print(f"| {name} | {len(points)} | {told} |{'' if posed is not None else ' |'}", flush=True)
        if images is not None:
            images.mkdir(parents=True, exist_ok=True)
            shown = {"truth": truth.values, "peer": peer(points, truth, band), "ours": made}
            shown |= {} if posed is None else {"posed": posed}
            for what, values in shown.items():
                drawn(values).save(images / f"{name.replace(' ', '_')}_{what}.png")


def hall(count: int) -> np.ndarray:
    """Return points of a hall whose area grows with their number: floor, walls, racks, ceiling."""
    random = np.random.default_rng(1)
    side = 20.0 * (count / 1_000_000) ** 0.5
    points = random.random((count, 3)) * [side, side, 2.8]
    kind = random.random(count)
    points[kind < 0.5, 2] = 0.0
    points[kind > 0.8, 2] = 2.8
    stands = (kind >= 0.5) & (kind <= 0.8)
    points[stands, 0] = np.round(points[stands, 0] / 4) * 4
    return points + random.normal(0, 0.01, points.shape)


def print_speed(counts: list[int]) -> None:
    print("| points | numpy.lexsort, CPU s | mapdeal build --cloud, CPU s | peak MiB | cells |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "hall.npy", Path(folder) / "map.yaml"
        # the small one shows what start-up takes
        for points in itertools.chain([read_cloud(RAMP)], map(hall, counts)):
            count, points = len(points), points.astype(np.float32)
            np.save(path, points)
            started = time.process_time()
            np.lexsort(points.T)
            sorted_in = time.process_time() - started
            del points
            command = [sys.executable, "-c", _MEASURED, str(path), str(out)]
            told: Any = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            seconds, peak = map(float, told.split())
            height, width = read_map(out).shape
            print(f"| {count} | {sorted_in:.2f} | {seconds:.2f} | {peak / 1024:.0f} "
                  f"| {width}x{height} |", flush=True)  # fmt: skip


_MEASURED = """
import resource, subprocess, sys
cloud, out = sys.argv[1:]
command = ["build", "--cloud", cloud, "-o", out, "--force", "--quiet"]
subprocess.run([sys.executable, "-m", "mapdeal", *command], check=True)
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
"""  # in a small process, as its memory counts as that of the command that it starts


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("worlds", "speed"))
    parser.add_argument("--world", action="append", choices=list(WORLDS))
    parser.add_argument("--images", type=Path)
    parser.add_argument("--points", type=int, nargs="+", default=[10**6, 10**7, 5 * 10**7])
    options = parser.parse_args()
    if options.only != "speed":
        print_worlds(options.world or list(WORLDS), options.images)
    if options.only != "worlds":
        print_speed(options.points)


if __name__ == "__main__":
    main()
