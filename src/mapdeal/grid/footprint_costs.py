"""Costs of a robot's whole footprint at poses on a costmap."""

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
    """Costs of a footprint at poses."""

    cost: NDArray[np.uint8]
    inside: NDArray[np.bool_]


def footprint_costs(
    costmap: Costmap, footprint: Footprint, poses: ArrayLike, *, rule: FootprintRule = "outline"
) -> NDArray[np.uint8]:
    """Return the costs that Nav2's collision checker computes for a robot at poses.

    Parameters
    ----------
    costmap : Costmap
        Costs on scale ``costmap2d``; use `Costmap.from_static_layer` for a map.
    footprint : Footprint
        Robot shape. A circle is treated as `Footprint.sixteen_gon`, as in Nav2.
    poses : array_like of float, shape (N, 3)
        Poses of the robot's centre in the map frame, or a single pose: x, y (metres) and yaw
        (radians).
    rule : {'outline', 'full'}
        Cells that count: those of the outline only, as in Nav2, or all cells of the footprint.

    Returns
    -------
    numpy.ndarray of uint8, shape (N,)
        Largest cost of these cells: below 254 there is no collision; 254 if an obstacle is hit, a
        corner is outside the map, or a number is not finite; 255 if unknown cells are touched.

    Raises
    ------
    ParameterError
        If `poses` has another shape, the costs are on another scale, or the rule is unknown.

    Notes
    -----
    With ``outline``, 255 may hide 254, as in Nav2: the edges are traced from corner to corner, and
    the first one that meets 254 ends the search, unless an earlier one has met 255. With ``full``,
    254 in any cell gives 254.

    The resolution is rounded to float32, as in a map message and every ROS costmap: 0.05 becomes
    0.0500000007. This matters if a corner lies nominally on the edge between two cells. ROS
    costmaps have no yaw; the yaw of this one is taken into account.

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
    """Return the result of `footprint_costs`, and whether all corners lie on the map."""
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
