"""The picture of each kind of layer: which colour each value takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
)
from mapdeal.render import colours
from mapdeal.render.canvas import ColourBar, Image, Swatch, sheet, size_text
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster, inner_outline

_FREE_LEVELS, _OBSTACLE_LEVELS, _COST_LEVELS = 80, 30, 200


def occupancy_image(
    grid: OccupancyGrid, *, title: str, image_max: int = DEFAULT_IMAGE_MAX
) -> Image:
    """Return a map in the greys of RViz's scheme "map".

    Where cells share a pixel the most occupied one shows.
    """
    raster = Raster.fitting(grid.shape, image_max)
    values = raster.largest(grid.occupancy)
    unknown_index = OCCUPIED + 1
    ramp = np.rint(255 - 255 * np.arange(OCCUPIED + 1) / OCCUPIED).astype(np.uint8)
    palette = np.vstack([np.repeat(ramp[:, np.newaxis], 3, axis=1), [colours.RVIZ_UNKNOWN]])
    pixels = np.where(values == UNKNOWN, unknown_index, values).astype(np.uint8)
    swatches = [
        Swatch(OCCUPIED, "occupied"),
        Swatch(0, "free"),
        Swatch(unknown_index, "unknown"),
    ]
    if ((grid.occupancy > 0) & (grid.occupancy < OCCUPIED)).any():
        swatches.insert(1, Swatch(OCCUPIED // 2, "in between"))
    return sheet(
        raster.enlarged(pixels),
        palette.astype(np.uint8),
        title=title,
        subtitle=size_text(grid.shape, grid.resolution),
        metres_per_pixel=raster.metres_per_pixel(grid.resolution),
        swatches=swatches,
    )


def field_image(
    field: DistanceField, *, title: str, image_max: int = DEFAULT_IMAGE_MAX
) -> Image:  # fmt: skip
    """Return a distance field in a diverging scale, obstacles red, free space blue.

    The outermost obstacle cells, where the field of convention seed is 0, are drawn black.
    Unknown cells are washed out. Where cells share a pixel the smallest distance shows. The
    scale's upper end is the largest distance of a known cell.
    """
    raster = Raster.fitting(field.shape, image_max)
    distance = raster.smallest(field.distance)
    obstacles = raster.largest(field.obstacles())
    unknown = raster.smallest(field.occupancy == UNKNOWN)
    far, deep = _range_of(field)
    levels = _FREE_LEVELS + _OBSTACLE_LEVELS
    indices = np.empty(distance.shape, dtype=np.uint8)
    indices[:] = _OBSTACLE_LEVELS + _level(distance, far, _FREE_LEVELS)
    inside = _OBSTACLE_LEVELS - 1 - _level(-distance, deep, _OBSTACLE_LEVELS)
    np.copyto(indices, inside, where=obstacles, casting="unsafe")
    indices[unknown] += levels
    pixels = raster.enlarged(indices)
    line_index = 2 * levels
    pixels = pixels.copy() if pixels is indices else pixels
    pixels[inner_outline(raster.enlarged(obstacles))] = line_index

    known_side = np.vstack([
        colours.obstacle_side(_OBSTACLE_LEVELS)[::-1], colours.free_side(_FREE_LEVELS)
    ])  # fmt: skip
    palette = np.vstack(
        [known_side, colours.mixed(known_side, colours.RVIZ_UNKNOWN, 0.6), [colours.LINE]]
    )
    swatches = [Swatch(line_index, "obstacle edge")]
    if unknown.any():
        swatches.append(Swatch(_OBSTACLE_LEVELS + levels, "unknown"))
    strength = "" if field.strength == 1.0 else f", strength {field.strength:g}"
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle=f"{size_text(field.shape, field.resolution)}; {field.convention}{strength}",
        metres_per_pixel=raster.metres_per_pixel(field.resolution),
        bar=_field_bar(field, far, deep),
        swatches=swatches,
    )


def cost_image(
    costmap: Costmap, *, title: str, image_max: int = DEFAULT_IMAGE_MAX
) -> Image:  # fmt: skip
    """Return a costmap in an even scale; lethal, inscribed, unknown and free stand apart.

    Where cells share a pixel the highest cost shows. If the circumscribed cost is known, a
    line bounds the cells of that cost and more.
    """
    raster = Raster.fitting(costmap.shape, image_max)
    on_byte_scale = costmap.scale == "costmap2d"
    values = costmap.cost.astype(np.int16)
    if on_byte_scale:
        values[values == NO_INFORMATION] = UNKNOWN
    values = raster.largest(values)
    top = INSCRIBED_INFLATED_OBSTACLE - 1 if on_byte_scale else OCCUPIED - 1
    free, inscribed, lethal, unknown, contour = (_COST_LEVELS + k for k in range(5))
    by_value = np.full(LETHAL_OBSTACLE + 1, lethal, dtype=np.uint8)
    by_value[0] = free
    by_value[1 : top + 1] = (np.arange(top) * _COST_LEVELS) // top
    if on_byte_scale:
        by_value[INSCRIBED_INFLATED_OBSTACLE] = inscribed
    pixels = np.where(values == UNKNOWN, unknown, by_value[values]).astype(np.uint8)
    pixels = raster.enlarged(pixels)
    palette = np.vstack([
        colours.cost_scale(_COST_LEVELS),
        [colours.RVIZ_FREE, colours.INSCRIBED, colours.LETHAL, colours.RVIZ_UNKNOWN,
         colours.CONTOUR],
    ])  # fmt: skip
    swatches = [Swatch(lethal, f"lethal {LETHAL_OBSTACLE if on_byte_scale else OCCUPIED}")]
    if on_byte_scale:
        swatches.append(Swatch(inscribed, f"inscribed {INSCRIBED_INFLATED_OBSTACLE}"))
    swatches += [Swatch(free, "free 0"), Swatch(unknown, "unknown")]
    if costmap.circumscribed_cost:
        above = raster.enlarged(values >= costmap.circumscribed_cost)
        pixels = pixels.copy()
        pixels[inner_outline(above)] = contour
        label = f"circumscribed {costmap.circumscribed_cost}"
        swatches.append(Swatch(contour, label))
    ticks = [(value / top, str(value)) for value in _round_values(top)]
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle=size_text(costmap.shape, costmap.resolution),
        metres_per_pixel=raster.metres_per_pixel(costmap.resolution),
        bar=ColourBar(range(_COST_LEVELS), ticks, "cost"),
        swatches=swatches,
    )


def _round_values(top: int) -> list[int]:
    step = 50 if top > OCCUPIED else 20
    return [1, *range(step, top - step // 2, step), top]


def _level(distance: NDArray[np.float32], end: float, levels: int) -> NDArray[np.uint8]:
    """Return the level 0 .. levels - 1 of distances 0 .. `end`; others take the nearest."""
    share = np.clip(distance * np.float32(1 / end), 0, 1)
    level: NDArray[np.uint8] = np.minimum(share * np.float32(levels), levels - 1).astype(np.uint8)
    return level


def _range_of(field: DistanceField) -> tuple[float, float]:
    """Return the largest distance in known free space and the largest depth, finite, above 0."""
    known = field.occupancy != UNKNOWN
    shown = field.distance[known] if known.any() else field.distance
    finite = shown[np.isfinite(shown)]
    far = float(finite.max(initial=0.0))
    deep = -float(finite.min(initial=0.0))
    return max(far, field.resolution), max(deep, field.resolution)


def _field_bar(field: DistanceField, far: float, deep: float) -> ColourBar:
    middle = 0.3
    steps = 200
    positions = np.linspace(0, 1, steps)
    below = _OBSTACLE_LEVELS * positions / middle
    above = _OBSTACLE_LEVELS + _FREE_LEVELS * (positions - middle) / (1 - middle)
    last = _OBSTACLE_LEVELS + _FREE_LEVELS - 1
    indices = np.where(positions < middle, below, np.minimum(above, last)).astype(int)
    if not np.isfinite(field.distance).any():
        sign = "+inf" if field.distance.flat[0] > 0 else "-inf"
        return ColourBar(indices.tolist(), [(middle, sign)], "distance, m")
    ticks = [(0.0, f"-{deep:.3g}"), (middle / 2, f"-{deep / 2:.3g}"), (middle, "0")]
    ticks += [(middle + (1 - middle) * k / 4, f"{far * k / 4:.3g}") for k in (1, 2, 3, 4)]
    return ColourBar(indices.tolist(), ticks, "distance, m")
