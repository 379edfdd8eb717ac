"""Layers of a page for each type of grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reach import Reach
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.blocks import Layer, counts_of, mapped
from mapdeal.records import dataclass
from mapdeal.render.field_style import FieldEnds, field_style
from mapdeal.render.reach_style import reach_codes
from mapdeal.render.style import LayerStyle, Scale
from mapdeal.render.styles import (
    POTENTIAL_OBSTACLE,
    cost_style,
    number_style,
    occupancy_style,
    potential_style,
)
from mapdeal.report.document import PageLayer

MAP = "map"
"""The ending of the name of a layer with the map that a field was made of."""


@dataclass(frozen=True)
class LayerKind:
    """One of the layers that grids of a type become."""

    ending: str
    title: str
    values: Callable[[Any], Layer]
    about: Callable[[Any], dict[str, Any]]

    def of(self, grid: Any, name: str, title: str) -> PageLayer:
        """Return the layer of a grid that is called `name`, with a title.

        Its legend is of cells alone: what pictures draw over them, pages do not.
        """
        about = self.about(grid)
        about["style"] = _of_cells(about["style"])
        made_of = isinstance(grid, (DistanceField, PotentialField)) and self.ending != MAP
        return PageLayer(
            f"{name}-{self.ending}" if self.ending else name,
            f"{title}: {self.title}" if self.title else title,
            grid.frame,
            self.values(grid),
            states=f"{name}-{MAP}" if made_of else None,
            **about,
        )


def kinds_of(grid: Any) -> tuple[LayerKind, ...]:
    if type(grid) not in _KINDS:
        raise TypeError(f"it is not known how a page shows a {type(grid).__name__}")
    return _KINDS[type(grid)]


def page_layers(grid: Any, name: str, title: str) -> list[PageLayer]:
    return [kind.of(grid, name, title) for kind in kinds_of(grid)]


def _of_cells(style: LayerStyle) -> LayerStyle:
    """Return a style without the swatches of colours that no value takes."""
    taken = _indices_of(style) if style.by_value is None else set(style.by_value.tolist())
    kept = tuple(swatch for swatch in style.swatches if swatch.index in taken)
    return replace(style, swatches=kept)


def _indices_of(style: LayerStyle) -> set[int | None]:
    scale = cast("Scale", style.scale)
    levels = range(scale.first, scale.first + scale.levels)
    faded = [] if style.faded_by is None else [level + style.faded_by for level in levels]
    return {*levels, *faded, style.nowhere, style.line}


def _as_bytes(layer: Layer) -> Layer:
    return mapped(layer, np.uint8, lambda values: values.view(np.uint8))


_ABOVE_UNKNOWN = (np.arange(256) + 1).astype(np.uint8)
"""Where cells share a pixel, the rank of each value: unknown, 255, shows last."""
_ABOVE_UNKNOWN.flags.writeable = False


def _map_of(grid: Any) -> dict[str, Any]:
    threshold = getattr(grid, "lethal_threshold", OCCUPIED)
    style = occupancy_style()
    if not counts_of(grid.occupancy)[FREE + 1 : OCCUPIED].any():  # black and white need no scale
        style = replace(style, bar=None)
    return {"style": style, "rank": _ABOVE_UNKNOWN, "lethal_threshold": threshold}


def _cost(costmap: Costmap) -> dict[str, Any]:
    return {"style": cost_style(costmap), "rank": _ABOVE_UNKNOWN}


def _field(field: DistanceField) -> dict[str, Any]:
    return {
        "style": field_style(field, FieldEnds.of(field)),
        "unit": "m",
        "pooled": "smallest",
        "convention": field.convention,
        "lethal_threshold": field.lethal_threshold,
        "strength": field.strength,
    }


def _potential(field: PotentialField) -> dict[str, Any]:
    return {"style": replace(potential_style(field), line=POTENTIAL_OBSTACLE)}


def _metres(name: str, title: str) -> LayerKind:
    def values(grid: Any) -> Layer:
        layer: Layer = getattr(grid, name)
        return layer

    def about(grid: Any) -> dict[str, Any]:
        finite = values(grid)[np.isfinite(values(grid))]
        high = float(finite.max()) if finite.size else 0.0
        return {"style": number_style(0.0, high, "m"), "unit": "m"}

    return LayerKind(name, title, values, about)


_OCCUPANCY = LayerKind("", "", lambda grid: _as_bytes(grid.occupancy), _map_of)
_ITS_MAP = LayerKind(MAP, "its map", lambda grid: _as_bytes(grid.occupancy), _map_of)
_KINDS: dict[type[Any], tuple[LayerKind, ...]] = {
    OccupancyGrid: (_OCCUPANCY,),
    FieldView: (_OCCUPANCY,),
    Costmap: (LayerKind("", "", lambda costmap: _as_bytes(costmap.cost), _cost),),
    DistanceField: (_ITS_MAP, LayerKind("", "", lambda field: field.distance, _field)),
    PotentialField: (
        _ITS_MAP,
        LayerKind("", "", lambda field: field.normalised.astype(np.float32), _potential),
    ),
    Reach: (
        _metres("clearance", "distance to the nearest obstacle"),
        _metres("widest", "radius of the largest round robot that gets here"),
        LayerKind(
            "",
            "",
            lambda reach: reach_codes(reach)[0],
            lambda reach: {"style": reach_codes(reach)[1]},
        ),
    ),
}
