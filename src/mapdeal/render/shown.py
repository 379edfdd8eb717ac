"""Which part of a map a picture shows: the known cells and a margin, or all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.frame import Frame, Region
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import Layer, gathered
from mapdeal.render.overlay import Overlay

ImageExtent = Literal["known", "all"]

DEFAULT_EXTENT: ImageExtent = "known"

_MARGIN, _LEAST_MARGIN = 0.05, 10
"""Around the known cells: of their longer side, and cells."""

_WORTH = 0.95
"""Of both sides of the map: what a part must be below, on one, for a picture to be of it alone."""

IsKnown = Callable[[NDArray[Any]], NDArray[np.bool_]]


@dataclass(frozen=True)
class OtherThan:
    """Which values differ from one that stands for unknown cells."""

    value: int

    def __call__(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        known: NDArray[np.bool_] = values != self.value
        return known


_IS_KNOWN = OtherThan(UNKNOWN)
"""Of occupancy."""


@dataclass(frozen=True)
class KnownLines:
    """What rows, and what columns, have a known cell: what `known_box` gathers."""

    is_known: IsKnown

    def __call__(self, values: NDArray[Any]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return a mask of rows and a mask of columns."""
        known = self.is_known(values)
        return np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))


def known_box(layer: Layer, is_known: IsKnown) -> Region | None:
    """Return the box of the known cells of a layer; None if there are none."""
    # Rows are looked at once, from the first to the last, and those of a lazy layer not again.
    (parts,) = gathered(layer, KnownLines(is_known))
    with_known = np.flatnonzero(np.concatenate([rows for rows, _ in parts]))
    columns = np.flatnonzero(np.logical_or.reduce([cols for _, cols in parts]))
    if not len(with_known):
        return None
    row, col = int(with_known[0]), int(columns[0])
    return Region(row, col, int(with_known[-1]) - row + 1, int(columns[-1]) - col + 1)


def shown_part(
    layer: Layer,
    frame: Frame,
    extent: ImageExtent,
    *,
    is_known: IsKnown = _IS_KNOWN,
    overlay: Overlay | None = None,
    places_xy: ArrayLike = (),
) -> Region | None:
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
