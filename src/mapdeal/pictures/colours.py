"""Colour scales whose steps look even, interpolated in the OKLab space.

References
----------
Bjoern Ottosson, "A perceptual color space for image processing", 2020: the matrices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.kernels.arrays import Bytes, Floats
from mapdeal.kernels.rotations import inverse_matrices
from mapdeal.records import dataclass, field

Colours = NDArray[np.uint8]
Colour = tuple[int, int, int]

# Occupancy, by RViz's colour scheme "map".
RVIZ_FREE = (255, 255, 255)
RVIZ_OCCUPIED = (0, 0, 0)
RVIZ_UNKNOWN = (112, 137, 134)
INSCRIBED = (0, 190, 200)  # cyan, as in RViz's scheme "costmap"
LETHAL = (16, 16, 20)
LINE = (0, 0, 0)
CONTOUR = (120, 255, 70)
KEEPOUT = (40, 100, 245)
ARROW = (214, 120, 84)
GOAL = (225, 30, 60)
START = (20, 170, 70)
MINIMUM = (255, 120, 0)
ROUTE = (0, 100, 255)
ROBOT = (0, 175, 60)
ADDED = (0, 120, 220)
REMOVED = (225, 30, 60)
CHANGED = (250, 220, 130)
FILLED = (110, 200, 90)
OUTSIDE = (225, 225, 225)
CLOSED_IN_BOTH = (96, 96, 100)
NOW_CLOSED = (170, 0, 170)
NOW_OPEN = (0, 150, 90)
NOW_UNKNOWN = (120, 90, 30)
NOW_KNOWN = (240, 215, 120)

# Reach of a robot; people with colour blindness can distinguish these, too.
REACHABLE = (110, 215, 190)
NO_TURN = (172, 230, 208)
REACHABLE_UNKNOWN = (80, 178, 150)
TOO_NARROW = (246, 246, 242)
CUT_OFF = (166, 162, 156)
CUT_OFF_AREAS = [
    (255, 224, 96), (146, 168, 250), (206, 118, 190), (255, 176, 124), (140, 92, 200),
    (158, 98, 84),
]  # fmt: skip
CLOSED_PASSAGE = (200, 0, 30)
TIGHT_PASSAGE = (235, 125, 0)
REACH_START = (0, 60, 200)
ROBOT_OUTLINE = (0, 40, 110)
GOAL_REACHED = (0, 110, 90)
GOAL_MISSED = (130, 0, 110)

# From low to high: cost, pale yellow to dark purple, and potential, ivory to dark blue; from near
# to far: free space, white to dark blue, and inside of obstacles, pale to dark red.
COST_ANCHORS = [(255, 247, 188), (254, 196, 79), (236, 112, 20), (190, 30, 70), (92, 12, 92)]
POTENTIAL_ANCHORS = [
    (250, 250, 235), (200, 228, 190), (110, 190, 170), (40, 125, 150), (35, 45, 95)
]  # fmt: skip
FREE_ANCHORS = [(247, 247, 245), (171, 210, 232), (72, 147, 198), (24, 79, 140), (8, 36, 84)]
OBSTACLE_ANCHORS = [(252, 219, 199), (228, 130, 104), (178, 34, 48), (96, 6, 30)]
_LMS_FROM_RGB = np.array([
    [0.4122214708, 0.5363325363, 0.0514459929],
    [0.2119034982, 0.6806995451, 0.1073969566],
    [0.0883024619, 0.2817188376, 0.6299787005],
])  # fmt: skip
_LAB_FROM_LMS = np.array([
    [0.2104542553, 0.7936177850, -0.0040720468],
    [1.9779984951, -2.4285922050, 0.4505937099],
    [0.0259040371, 0.7827717662, -0.8086757660],
])  # fmt: skip


def mixed(colours: ArrayLike, tint: tuple[int, int, int], share: float) -> Colours:
    base = np.asarray(colours, dtype=np.float64)
    return np.rint(base * (1 - share) + np.array(tint) * share).astype(np.uint8)


def palette_of(*parts: ArrayLike) -> Colours:
    return np.vstack([np.asarray(part) for part in parts]).astype(np.uint8)


def interpolated(anchors: list[tuple[int, int, int]], levels: int) -> Colours:
    """Return `levels` colours through the anchors, at even steps in OKLab."""
    lab = _oklab_from_rgb(np.array(anchors, dtype=np.float64) / 255)
    steps = np.linspace(0, len(anchors) - 1, levels)
    columns = [np.interp(steps, np.arange(len(anchors)), lab[:, c]) for c in range(3)]
    return np.rint(np.clip(_rgb_from_oklab(np.stack(columns, axis=1)), 0, 1) * 255).astype(np.uint8)


def _oklab_from_rgb(rgb: Floats) -> Floats:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return _product(_LAB_FROM_LMS, np.cbrt(_product(_LMS_FROM_RGB, linear)))


def _rgb_from_oklab(lab: Floats) -> Floats:
    lms = _product(inverse_matrices(_LAB_FROM_LMS), lab) ** 3
    linear = np.clip(_product(inverse_matrices(_LMS_FROM_RGB), lms), 0, None)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def _product(matrix: Floats, vectors: Floats) -> Floats:
    return np.asarray((vectors[:, np.newaxis] * matrix).sum(axis=-1))


@dataclass(frozen=True)
class Swatch:
    """A legend entry: a palette index and its meaning."""

    index: int
    label: str


@dataclass(frozen=True)
class ColourBar:
    """A scale: palette indices from bottom to top, and labels at heights 0..1."""

    indices: Sequence[int]
    ticks: Sequence[tuple[float, str]]
    unit: str


@dataclass(frozen=True)
class Scale:
    """An even scale from `low` to `high`: `levels` palette indices from `first` on, clipped."""

    low: float
    high: float
    first: int
    levels: int

    @property
    def factor(self) -> float:
        return self.levels / (self.high - self.low)

    def indices(self, values: NDArray[np.floating]) -> Bytes:
        steps = (values - np.float32(self.low)) * np.float32(self.factor)
        indices = np.clip(steps, 0, self.levels - 1).astype(np.uint8)
        return np.asarray(indices + np.uint8(self.first))


@dataclass(frozen=True, eq=False)
class LayerStyle:
    colours: Colours
    by_value: Bytes | None = None
    scale: Scale | None = None
    swatches: tuple[Swatch, ...] = ()
    bar: ColourBar | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    nowhere: int | None = None
    line: int | None = None
    faded_by: int | None = None
