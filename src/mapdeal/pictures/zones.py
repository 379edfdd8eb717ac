"""Pictures of the zones of costmap filters on their map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.filters import FilterInfo
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.pictures import colours as palette
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.layers import occupancy_image
from mapdeal.pictures.overlay import Overlay, Surface, inner_outline

_BINARY = (140, 92, 200)
_SLOW_TO_FAST = [palette.CLOSED_PASSAGE, palette.TIGHT_PASSAGE, palette.CHANGED]
_MOST_LIMITS = 12  # colours of limits; further limits share them


@dataclass(frozen=True, eq=False)
class _ColouredCells:
    """The cells of a speed limit or of another filter, with their colour."""

    cells: NDArray[np.bool_]
    colour: palette.Colour
    label: str


@dataclass(frozen=True, eq=False)
class ZonesOverlay(Overlay):
    """Zones over a map: filled where it is free or unknown, with an outline."""

    grid: OccupancyGrid
    masks: Sequence[tuple[OccupancyGrid, FilterInfo]]

    @cached_property
    def _coloured_cells(self) -> list[_ColouredCells]:
        return [zone for grid, info in self.masks for zone in _coloured_cells_in(grid, info)]

    @property
    def colours(self) -> list[palette.Colour]:
        colours: list[palette.Colour] = []
        for zone in self._coloured_cells:
            colour = np.array([zone.colour])
            free, unknown = (
                palette.mixed(colour, (255, 255, 255), 0.55),
                palette.mixed(colour, palette.RVIZ_UNKNOWN, 0.6),
            )
            colours += [tuple(map(int, each[0])) for each in (free, unknown, colour)]  # type: ignore[misc]
        return colours

    def draw(self, on: Surface, first_index: int) -> list[palette.Swatch]:
        values = np.asarray(self.grid.occupancy)
        free = on.raster.enlarged(on.raster.largest(values) <= FREE)
        unknown = on.raster.enlarged(on.raster.largest(values) == UNKNOWN)
        swatches = []
        for number, zone in enumerate(self._coloured_cells):
            index = first_index + 3 * number
            cells = on.raster.enlarged(on.raster.largest(zone.cells))
            on.pixels[cells & free] = index
            on.pixels[cells & unknown] = index + 1
            on.pixels[inner_outline(cells)] = index + 2
            swatches.append(palette.Swatch(index, zone.label))
        return swatches


def _coloured_cells_in(grid: OccupancyGrid, info: FilterInfo) -> Iterator[_ColouredCells]:
    values = np.asarray(grid.occupancy)
    if info.kind != "speed":
        colour = palette.KEEPOUT if info.kind == "keepout" else _BINARY
        yield _ColouredCells(values > FREE, colour, info.kind)
        return
    found = np.flatnonzero(histogram(values)[FREE + 1 : OCCUPIED + 1]) + 1
    limits = sorted((info.limit_of(v) or 0.0, v) for v in found.tolist())
    scale = palette.interpolated(_SLOW_TO_FAST, min(max(len(limits), 2), _MOST_LIMITS))
    for number, (limit, value) in enumerate(limits):
        colour = scale[number * (len(scale) - 1) // max(len(limits) - 1, 1)].tolist()
        label = f"{limit:.4g} {info.sign}" if limit else "no limit"
        yield _ColouredCells(values == value, (colour[0], colour[1], colour[2]), label)


def zones_image(
    grid: OccupancyGrid, masks: Sequence[tuple[OccupancyGrid, FilterInfo]], *, title: str,
    **look: Any,
) -> Image:  # fmt: skip
    return occupancy_image(grid, title=title, **look | {"overlay": ZonesOverlay(grid, masks)})
