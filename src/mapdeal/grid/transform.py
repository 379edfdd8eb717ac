"""The transform from one map frame to another: a rotation and a translation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import FARTHEST, turned
from mapdeal.grid.display import OneLine
from mapdeal.grid.frame import Frame


@dataclass(frozen=True, slots=True, repr=False)
class Transform(OneLine):
    """A rigid transform from one map frame to another: p_to = R(yaw) p_from + (x, y).

    Parameters
    ----------
    x, y : float
        Translation in the target frame, metres.
    yaw : float
        Rotation, anticlockwise, normalised to -pi..pi, radians.

    Raises
    ------
    ParameterError
        If a number is not finite, or larger than 1e12.

    Examples
    --------
    >>> quarter = Transform(1.0, 2.0, math.pi / 2)
    >>> quarter.points([[3.0, 0.0]]).round(9).tolist()
    [[1.0, 5.0]]
    >>> quarter.inverse().points([[1.0, 5.0]]).round(9).tolist()
    [[3.0, 0.0]]
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            value = float(getattr(self, name))
            if not abs(value) <= FARTHEST:  # refuses nan too
                raise ParameterError("must be a finite number", place=name, got=value)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "yaw", math.remainder(self.yaw, 2 * math.pi))

    def _told(self) -> Iterator[str]:
        yield f"x {self.x:.10g} m"
        yield f"y {self.y:.10g} m"
        yield f"yaw {self.yaw:.10g} rad"

    @property
    def pose(self) -> tuple[float, float, float]:
        """Translation and rotation as x, y (metres) and yaw (radians)."""
        return self.x, self.y, self.yaw

    @classmethod
    def from_pose(cls, pose: Sequence[float]) -> Transform:
        """Create the transform from the frame whose origin is at a pose x, y, yaw."""
        x, y, yaw = pose
        return cls(x, y, yaw)

    def points(self, points_xy: ArrayLike) -> NDArray[np.float64]:
        """Transform points, shape (N, 2), metres."""
        points = np.asarray(points_xy, dtype=np.float64).reshape(-1, 2)
        moved = turned(points, self.yaw)
        moved += (self.x, self.y)
        return moved

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        x, y = turned(np.array([[-self.x, -self.y]]), -self.yaw)[0]
        return Transform(x, y, -self.yaw)

    def after(self, first: Transform) -> Transform:
        """Return the transform that applies `first` and then this one.

        Examples
        --------
        >>> shift, turn = Transform(1.0, 0.0), Transform(yaw=math.pi / 2)
        >>> turn.after(shift).points([[0.0, 0.0]]).round(9).tolist()
        [[0.0, 1.0]]
        """
        x, y = self.points([[first.x, first.y]])[0]
        return Transform(x, y, first.yaw + self.yaw)

    def frame(self, frame: Frame) -> Frame:
        """Transform the frame of a grid.

        The cells stay the same; their corner is moved and their axes are rotated.
        """
        if self.pose == (0.0, 0.0, 0.0):
            return frame
        x, y = self.points([frame.origin[:2]])[0]
        yaw = math.remainder(frame.origin[2] + self.yaw, 2 * math.pi)
        return Frame(*frame.shape, frame.resolution, (float(x), float(y), yaw))
