"""Stages ``rotate`` and ``rescale``: a grid turned, or with larger or smaller cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Generic, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from mapdeal.command import ABOVE_0, METRES, RADIANS, Parameters, check_one_of, stage
from mapdeal.errors import emit_warning, require
from mapdeal.grid import canvas, costmap, frame as frames, values
from mapdeal.kernels import arrays, distance
from mapdeal.records import dataclass

_QUARTER = math.pi / 2
_TOLERANCE = 2e-5  # radians; makes 1.5708 and 4.7124 quarter turns, and is 2 mm over 100 m
_THICKEST_WALL = 5  # cells of a wall that count, from its open side
V = TypeVar("V", bound=frames.ValueGrid)
_angles: WeakKeyDictionary[frames.ValueGrid, float | None] = WeakKeyDictionary()
"""Results of `yaw_to_straighten`, which a turn needs twice: for its memory and for its cells."""


@dataclass(frozen=True, eq=False)
class Turned(Generic[V]):
    """A turned map, and the transform of its points; None if the map is unchanged."""

    grid: V
    transform: frames.Transform | None
    baked_yaw: float = 0.0  # of the origin, which the cells have now

    def lines(self) -> Iterator[str]:
        if self.transform is None:
            return
        if self.baked_yaw:
            yield f"the yaw of the origin, {_angle_text(self.baked_yaw)}, is now in the cells"
        if self.transform.yaw:
            yield f"turned by {_angle_text(self.transform.yaw)} about x 0, y 0"
        else:
            yield "all walls stay where they are"


def _angle_text(yaw: float) -> str:
    return f"{yaw:.10g} rad ({math.degrees(yaw):.6g} degrees)"


def _cells_to_turn(grid: frames.ValueGrid, parameters: Parameters) -> Iterator[int]:
    yaw, count = parameters["yaw"], math.prod(grid.shape)
    if yaw is None:
        yield count
        yaw = yaw_to_straighten(grid)
    new_count = count if yaw is None else cells_when_turned(grid.frame, yaw)
    if new_count <= frames.MOST_CELLS:  # the turn refuses more
        yield new_count + min(new_count, count)


@stage(
    name="rotate",
    group="Changing a map",
    example="""\
mapdeal rotate examples/maps/office.yaml -o out/turned.yaml --yaw 0.3
mapdeal rotate out/turned.yaml -o out/straight.yaml --straighten""",
    product="turned",
    summary="Rotate a map or costmap, and bake the yaw of its origin into the cells.",
    details="The result has yaw 0 and covers the whole rotated map; cells outside it are unknown. "
    "With --yaw 0 all walls stay where they are in the map frame. Otherwise poses change as well, "
    "by the transform that is printed. Quarter turns copy the cells unchanged.",
    title=lambda _: "turned",
    memory=6.0,
    cells=_cells_to_turn,
    is_whole=lambda _: True,
    edits=True,
    moves=lambda _: True,
    derived=lambda parameters: check_one_of(parameters, "yaw", "straighten"),
)
def turned(
    grid: V,
    *,
    yaw: Annotated[float, RADIANS] | None = None,
    straighten: bool = False,
    rule: canvas.ResamplingRule = "area",
) -> Turned[V]:
    """Rotate a map or costmap as `rotate` or `straighten` does.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rotate.
    yaw : float, optional
        Rotation, radians, anticlockwise about the origin of the map frame; 0 only bakes the yaw of
        the map's origin into the cells.
    straighten : bool
        Or rotate by the smallest angle that aligns the main direction of the walls with the axes.
    rule : {'area', 'nearest'}
        Value of a new cell: the largest of all overlapped cells (area), so that no obstacle is
        lost, or the value at its centre (nearest).
    """
    if straighten:
        yaw = yaw_to_straighten(grid)
    if yaw is None:
        emit_warning("rotate: no direction of walls stands out, the map is not turned")
        return Turned(grid, None)
    return Turned(rotate(grid, yaw, rule=rule), turn_of(yaw), grid.origin[2])


def rotate(grid: V, yaw: float = 0.0, *, rule: canvas.ResamplingRule = "area") -> V:
    """Rotate a map or costmap about the origin of the map frame, onto a lattice without yaw.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rotate. The yaw of its origin is baked into the cells, so that every wall stays
        in place in the map frame if `yaw` is 0.
    yaw : float
        Angle, anticlockwise, radians. Points move with the map by ``Transform(0, 0, yaw)``.
    rule : {'area', 'nearest'}
        Value of a cell where old and new cells do not coincide; see Notes.

    Returns
    -------
    OccupancyGrid or Costmap
        Grid of the same kind and resolution, with yaw 0, that covers all cells of `grid` and is
        unknown elsewhere. The edges of its cells lie at multiples of the resolution, except after
        quarter turns, which copy every cell. Angles within 2e-5 rad of a quarter turn, such as
        1.5708, count as one.

    Raises
    ------
    ParameterError
        If the angle is not finite, the rule is unknown, or the result would have too many cells.

    Notes
    -----
    With ``area``, a cell gets the largest value above 0 that it overlaps, or else the free or
    unknown one at its centre. No wall opens, but walls get thicker by less than a cell's diagonal.
    With ``nearest``, a cell gets the value at its centre, and thin walls may get gaps.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 100, -1]], 0.5, (1.0, 0.0, 0.0))
    >>> turned = rotate(grid, math.pi / 2)
    >>> turned.occupancy.tolist(), turned.origin
    ([[0], [100], [-1]], (-0.5, 1.0, 0.0))
    >>> crooked = OccupancyGrid([[0, 100, -1]], 0.5, (1.0, 0.0, 0.3))
    >>> rotate(crooked).occupancy.tolist()
    [[-1, 100, 100, -1], [-1, 100, 100, -1]]
    """
    canvas.check_values(grid)
    frame, quarters = _turned(grid.frame, yaw)
    if quarters is not None:
        values.check_choice(rule, canvas.ResamplingRule, "rule")
        return grid.with_values(np.rot90(grid.values, -quarters), frame.origin)
    lattice = frames.Frame(1, 1, frame.resolution)
    region = frames.region_around(lattice, frame)
    text = f"the turned map must not have more than {frames.MOST_CELLS} cells"
    require(region.cells <= frames.MOST_CELLS, text, "yaw", got=(region.width, region.height))
    there = grid.with_values(grid.values, frame.origin)
    return canvas.resampled(there, region.frame_in(lattice), rule=rule)


def straighten(grid: V, *, rule: canvas.ResamplingRule = "area") -> V:
    """Rotate a map or costmap so that its walls run along the axes; see `rotate`.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rotate, by the result of `yaw_to_straighten`.
    rule : {'area', 'nearest'}
        As in `rotate`.

    Returns
    -------
    OccupancyGrid or Costmap
        Grid rotated by the result of `yaw_to_straighten`.

    Warns
    -----
    MapdealWarning
        If the walls have no main direction; the grid is returned unchanged.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> wall = np.zeros((9, 40), dtype=np.int8)
    >>> wall[3, 2:38] = 100
    >>> straighten(OccupancyGrid(wall, 0.05, (1.0, 2.0, 0.3))).origin[2]
    0.0
    """
    return turned(grid, straighten=True, rule=rule).grid


def yaw_to_straighten(grid: frames.ValueGrid) -> float | None:
    """Return the angle by which `rotate` aligns a map's walls with the axes of the map frame.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid whose occupied or lethal cells are the walls.

    Returns
    -------
    float or None
        Smallest such angle, -pi/4..pi/4, anticlockwise, radians. None if there are no walls, or
        they have no main direction. For a map that is straight to within a cell, the angle only
        undoes the yaw of its origin.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> wall = np.zeros((9, 40), dtype=np.int8)
    >>> wall[3, 2:38] = 100
    >>> yaw_to_straighten(OccupancyGrid(wall, 0.05, (1.0, 2.0, 0.3)))
    -0.3
    """
    from mapdeal.kernels.rotations import main_direction

    if grid not in _angles:
        direction = main_direction(_walls_of(grid))
        _angles[grid] = None
        if direction is not None:
            _angles[grid] = 0.0 - math.remainder(grid.origin[2] + direction, _QUARTER)  # never -0.0
    return _angles[grid]


def turn_of(yaw: float) -> frames.Transform:
    transform = frames.Transform(0.0, 0.0, yaw)
    quarters = _quarters_of(transform.yaw)
    return transform if quarters is None else frames.Transform(0.0, 0.0, quarters * _QUARTER)


def cells_when_turned(frame: frames.Frame, yaw: float) -> int:
    turned, quarters = _turned(frame, yaw)
    if quarters is not None:
        return math.prod(frame.shape)
    return frames.region_around(frames.Frame(1, 1, frame.resolution), turned).cells


def _turned(frame: frames.Frame, yaw: float) -> tuple[frames.Frame, int | None]:
    """Return the frame of a turned grid; for quarter turns without yaw, and with their number."""
    turn = turn_of(yaw)
    x, y, total = turn.frame(frame).origin
    quarters_of_turn = _quarters_of(turn.yaw)
    if quarters_of_turn is not None:  # exact, because the cosine of a right angle is not 0
        x, y = frame.origin[:2]
        x, y = ((x, y), (-y, x), (-x, -y), (y, -x))[quarters_of_turn % 4]
    quarters = _quarters_of(total)
    if quarters is None:
        return frames.Frame(*frame.shape, frame.resolution, (x, y, total)), None
    height, width = frame.shape
    row, col = ((0, 0), (0, -height), (-height, -width), (-width, 0))[quarters % 4]
    shape = (width, height) if quarters % 2 else (height, width)
    straight = frames.Frame(1, 1, frame.resolution, (x + 0.0, y + 0.0, 0.0))
    return straight.window(row, col, *shape), quarters


def _quarters_of(yaw: float) -> int | None:
    quarters = round(yaw / _QUARTER)
    return quarters if abs(yaw - quarters * _QUARTER) <= _TOLERANCE else None


def _walls_of(grid: frames.ValueGrid) -> arrays.Mask:
    """Return the obstacle cells near open space, or all obstacle cells without open space."""
    # A map that was turned before may be occupied around its old outline, which is not a wall.
    canvas.check_values(grid)
    obstacles: arrays.Mask = grid.values >= values.DEFAULT_LETHAL_THRESHOLD
    if isinstance(grid, costmap.Costmap):
        obstacles = grid.to_occupancy().occupied(values.OCCUPIED)
    near = ~obstacles & (grid.values != grid.unknown_value)
    for _ in range(_THICKEST_WALL):
        near |= distance.beside(near) & obstacles
    near &= obstacles
    return near if near.any() else obstacles


def _cells_to_rescale(grid: frames.ValueGrid, parameters: Parameters) -> Iterator[int]:
    frame = rescaled_frame(grid.frame, parameters["resolution"])
    count, new_count = math.prod(grid.shape), math.prod(frame.shape)
    yield max(count, new_count) + count


@stage(
    name="rescale",
    group="Changing a map",
    example="mapdeal rescale examples/maps/office.yaml -o out/coarse.yaml --resolution 0.1",
    product="rescaled",
    summary="Write a map or costmap with larger or smaller cells.",
    details="Origin and yaw stay, and the new cells cover the whole map. With the rule area no "
    "obstacle is lost in a coarser map; nearest takes the value at the centre of each new cell.",
    title=lambda parameters: f"at {parameters['resolution']:g} m",
    memory=6.0,
    cells=_cells_to_rescale,
    is_whole=lambda _: True,
    edits=True,
    moves=lambda _: True,
    derived=lambda parameters: {"resolution": frames.check_resolution(parameters["resolution"])},
)
def rescale(
    grid: V, resolution: Annotated[float, ABOVE_0, METRES], *, rule: canvas.ResamplingRule = "area"
) -> V:
    """Resample a map or costmap to another resolution.

    Parameters
    ----------
    grid : OccupancyGrid or Costmap
        Grid to rescale.
    resolution : float
        Side of the new cells, metres.
    rule : {'area', 'nearest'}
        Value of a new cell: the largest of all overlapped cells (area), so that no obstacle is
        lost, or the value at its centre (nearest). With ``area``, a cell that overlaps no value
        above 0 is free or unknown, as the grid is at its centre. With ``nearest``, in a coarser
        map, thin walls may get gaps or vanish.

    Returns
    -------
    OccupancyGrid or Costmap
        Grid of the same kind, origin and yaw. Its cells cover all of `grid`; cells that extend
        beyond it are unknown unless they overlap an obstacle or have their centre in `grid`. If
        an old cell is a whole number of new ones, these are copies of it.

    Raises
    ------
    ParameterError
        If the resolution is not allowed, the rule unknown, or the result would have too many cells.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> grid = OccupancyGrid([[0, 0, 0, 100], [0, 0, -1, -1]], 0.05, (1.0, 2.0, 0.3))
    >>> rescale(grid, 0.1).occupancy.tolist()
    [[0, 100]]
    >>> rescale(grid, 0.025).shape
    (4, 8)
    """
    values.check_choice(rule, canvas.ResamplingRule, "rule")
    canvas.check_values(grid)
    frame = rescaled_frame(grid.frame, resolution)
    return grid if frame == grid.frame else canvas.resampled(grid, frame, rule=rule)


def rescaled_frame(frame: frames.Frame, resolution: float) -> frames.Frame:
    side = frames.check_resolution(resolution)
    if side == frame.resolution:
        return frame
    width, height = (max(1, frames.cells_to_cover(length, side)) for length in frame.size_xy)
    text = f"the result must not have more than {frames.MOST_CELLS} cells"
    require(height * width <= frames.MOST_CELLS, text, "resolution", got=(width, height))
    return frames.Frame(height, width, side, frame.origin)
