"""What the costs of a map say of a robot's whole shape at poses."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import as_float32
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import check_choice
from mapdeal.kernels.footprints import Lattice, costs_at_poses

FootprintRule = Literal["outline", "full"]
"""Which cells count: those of the outline, as in Nav2, or those inside of it, too."""


class PoseSamples(NamedTuple):
    """What a footprint costs at poses.

    Parameters
    ----------
    cost : numpy.ndarray of uint8, shape (N,)
        As `footprint_costs` returns them.
    inside : numpy.ndarray of bool, shape (N,)
        Whether the map holds all corners.
    """

    cost: NDArray[np.uint8]
    inside: NDArray[np.bool_]


def footprint_costs(
    costmap: Costmap, footprint: Footprint, poses: ArrayLike, *, rule: FootprintRule = "outline"
) -> NDArray[np.uint8]:
    """Return what Nav2's collision checker says of a robot at poses.

    Parameters
    ----------
    costmap : Costmap
        Costs on scale ``costmap2d``; of a map those that `Costmap.from_static_layer` makes.
    footprint : Footprint
        The robot's shape. A circle is taken as Nav2 takes it, as `Footprint.sixteen_gon`.
    poses : array_like of float, shape (N, 3)
        x, y (metres) and yaw (radians) of the robot's centre in the map frame, or a single one.
    rule : {'outline', 'full'}
        ``outline`` is Nav2's rule: the cells of the outline count, what lies inside of it does
        not. ``full`` counts both.

    Returns
    -------
    numpy.ndarray of uint8, shape (N,)
        The largest cost of these cells: below 254 nothing is hit; 254 if an obstacle is hit, a
        corner is outside of the map, or a number is not finite; 255 if unknown cells are met.

    Raises
    ------
    ParameterError
        If `poses` has another shape, the costs are on another scale, or the rule is not known.

    Notes
    -----
    By ``outline`` 255 may hide 254, as in Nav2: lines lead from corner to corner, and the first
    that meets 254 ends the search, unless one before it has met 255. By ``full`` 254 anywhere is
    the cost.

    The side of a cell is the float32 of a map message, as in every ROS costmap: a resolution of
    0.05 is 0.0500000007 there. Where a corner lies on the edge between two cells on paper, that
    decides. Costmaps of ROS have no yaw; the yaw of this one is honoured.

    References
    ----------
    ``FootprintCollisionChecker::footprintCostAtPose`` in Nav2.

    Examples
    --------
    >>> costmap = Costmap([[0, 0, 0, 7, 254], [0, 0, 0, 7, 254], [0, 0, 0, 7, 254]], 0.5)
    >>> robot = Footprint.polygon([[0.4, 0.1], [0.4, -0.1], [-0.4, -0.1], [-0.4, 0.1]])
    >>> footprint_costs(costmap, robot, [[0.75, 0.75, 0], [1.25, 0.75, 0], [1.25, 0.75, 1.5708]])
    array([0, 7, 0], dtype=uint8)
    """
    return sample_poses(costmap, footprint, poses, rule=rule).cost


def sample_poses(
    costmap: Costmap, footprint: Footprint, poses: ArrayLike, *, rule: FootprintRule = "outline"
) -> PoseSamples:
    """Return what `footprint_costs` does, and where the map holds all corners."""
    check_choice(rule, FootprintRule, "rule")
    if costmap.scale != "costmap2d":
        text = "footprints are checked against costs on scale costmap2d"
        hint = (
            "published costs, and those of rings and thresholds, do not show what a footprint hits"
        )
        raise ParameterError(text, place="cost scale", got=costmap.scale, hint=hint)
    places = np.asarray(poses, dtype=np.float64)
    if places.shape == (3,):
        places = places.reshape(1, 3)
    if places.ndim != 2 or places.shape[1] != 3:
        text = "poses must be an array of x, y, yaw, shape (N, 3)"
        raise ParameterError(text, got=places.shape)
    shape = footprint if footprint.vertices else Footprint.sixteen_gon(footprint.radius)
    resolution = as_float32(costmap.resolution)
    costs = np.asarray(costmap.cost).view(np.uint8)
    results, inside = costs_at_poses(
        costs,
        Lattice(resolution, *costmap.origin),
        np.array(shape.vertices),
        places,
        filled=rule == "full",
    )
    return PoseSamples(results, inside)
