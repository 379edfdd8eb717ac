"""Which part of a map a picture shows: the known cells and a margin, or all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.region import Region
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import Layer, blocks_of
from mapdeal.render.overlay import Overlay

ImageExtent = Literal["known", "all"]

DEFAULT_EXTENT: ImageExtent = "known"

_MARGIN, _LEAST_MARGIN = 0.05, 10
"""Around the known cells: of their longer side, and cells."""

_WORTH = 0.95
"""Of both sides of the map: what a part must be below, on one, for a picture to be of it alone."""

IsKnown = Callable[[NDArray[Any]], NDArray[np.bool_]]


def is_known_occupancy(values: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Return which cells of a map are known."""
    known: NDArray[np.bool_] = values != UNKNOWN
    return known


def known_box(layer: Layer, is_known: IsKnown) -> Region | None:
    """Return the box of the known cells of a layer; None if there are none.

    Rows are looked at once, from the first to the last.
    """
    rows: list[NDArray[np.int64]] = []
    cols = np.zeros(layer.shape[1], dtype=np.bool_)
    for block in blocks_of(layer):
        known = is_known(layer[block])
        rows.append(block.start + np.flatnonzero(known.any(axis=1)))
        cols |= known.any(axis=0)
    with_known, columns = np.concatenate(rows), np.flatnonzero(cols)
    if not len(with_known):
        return None
    row, col = int(with_known[0]), int(columns[0])
    return Region(row, col, int(with_known[-1]) - row + 1, int(columns[-1]) - col + 1)


def shown_part(
    layer: Layer,
    frame: Frame,
    extent: ImageExtent,
    *,
    is_known: IsKnown = is_known_occupancy,
    overlay: Overlay | None = None,
    places_xy: ArrayLike = (),
) -> Region | None:
    """Return the part of a map that its picture shows, None for all of it.

    Parameters
    ----------
    layer : Layer, shape of `frame`
        What tells which cells are known.
    frame : Frame
        The map's geometry.
    extent : {'known', 'all'}
        What was asked for.
    is_known : callable
        Returns which values of the layer are of known cells.
    overlay : Overlay, optional
        What is drawn over it: it is to lie in the picture.
    places_xy : array_like of float, shape (N, 2)
        Other places that are to lie in it, as far as they lie on the map; metres.

    Returns
    -------
    Region, optional
        The known cells and a margin of a twentieth of their longer side, at least ten cells,
        inside of the map. None if nothing is known, or the part is hardly smaller than the map.
    """
    if extent == "all":
        return None
    box = known_box(layer, is_known)
    if box is None:
        return None
    low, high = np.array(box[:2]), np.array(box[:2]) + box[2:]
    points = np.concatenate([
        np.reshape(places_xy, (-1, 2)).astype(np.float64),
        np.empty((0, 2)) if overlay is None else np.reshape(overlay.places_xy, (-1, 2)),
    ])  # fmt: skip
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        places = frame.continuous_rowcol_from_xy(points)
        low = np.clip(np.floor(places.min(axis=0)), 0, low)
        high = np.clip(np.ceil(places.max(axis=0)), high, frame.shape)
    margin = max(_LEAST_MARGIN, round(_MARGIN * float((high - low).max())))
    first = np.clip(low - margin, 0, frame.shape).astype(int)
    size = np.clip(high + margin, 0, frame.shape).astype(int) - first
    if (size <= 0).any() or (size > _WORTH * np.array(frame.shape)).all():
        return None
    return Region(int(first[0]), int(first[1]), int(size[0]), int(size[1]))
