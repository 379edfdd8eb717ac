"""Evidence for and against obstacles, summed over maps on one lattice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.editing.conflicts import FREE, OCCUPIED, States
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame
from mapdeal.kernels.threads import for_rows

Layers = Mapping[str, ArrayLike]
"""By the names that `build_map` gives them."""

ChosenLayers = Mapping[str, NDArray[Any]]
"""Layers with evidence about hits, checked."""

EVEN = 50.0
"""Of ``log_odds``: as much for as against an obstacle."""

_PASS = 3 << 16
"""Of a beam that passes, in whole numbers: sums are exact, in whatever order they are made."""

_HIT = 7 << 16
"""Of a beam that hits: 0.7 to 0.3, as for the share of hits above which a cell is occupied."""

_MOST = 1e9
"""Bounds what a layer may hold, so that sums of many fit 64 bits."""

_LOG_ODDS, _HITS, _MISSES = "log_odds", "hits", "misses"


def chosen_layers(layers: Layers, shape: tuple[int, int]) -> ChosenLayers:
    """Return those of a map's layers that say what beams have hit; none if there are none."""
    if _LOG_ODDS in layers:
        wanted: tuple[str, ...] = (_LOG_ODDS,)
    elif _HITS in layers or _MISSES in layers:
        wanted = (_HITS, _MISSES)
    else:
        return {}
    chosen = {}
    for key in wanted:
        if key not in layers:
            raise ParameterError("is missing", place=key)
        layer = np.asarray(layers[key])
        if layer.shape != shape:
            raise ParameterError(f"must be of the map's {shape[1]} x {shape[0]} cells", place=key)
        chosen[key] = _checked(layer, key)
    return chosen


def _checked(layer: NDArray[Any], key: str) -> NDArray[Any]:
    if layer.dtype.kind not in "fiu":
        raise ParameterError("must be numbers", place=key, got=str(layer.dtype))
    least = -_MOST if key == _LOG_ODDS else 0.0
    odd = (layer < least) | (layer > _MOST)  # which nan is not: no beam has been there
    if key != _LOG_ODDS and layer.dtype.kind == "f":
        odd |= np.isnan(layer)
    if odd.any():
        rule = f"must lie in {least:g}..{_MOST:g}"
        raise ParameterError(rule, place=key, got=layer[odd][0].item())
    return layer


def evidence_of(
    lattice: Frame,
    states: Sequence[States],
    frames: Sequence[Frame],
    layers: Sequence[ChosenLayers],
) -> NDArray[np.int64]:
    """Return the summed evidence of maps, in cells of a lattice."""
    total = np.zeros(lattice.shape, dtype=np.int64)
    for state, frame, own in zip(states, frames, layers, strict=True):
        if own:
            _add_layers(total, lattice, own, frame)
        else:
            total[state == OCCUPIED] += _PASS
            total[state == FREE] -= _PASS
    return total


def in_beams(evidence: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return evidence in beams that pass."""
    return evidence / _PASS


def _add_layers(
    total: NDArray[np.int64], lattice: Frame, layers: ChosenLayers, source: Frame
) -> None:
    """Add what the layers of a map say at the centres of cells."""

    def add(part: slice) -> None:
        numbers = np.arange(part.start, part.stop)
        cells = np.stack(np.meshgrid(numbers, np.arange(lattice.width), indexing="ij"), axis=-1)
        centres = lattice.xy_from_rowcol(cells.reshape(-1, 2))
        at, inside = source.bounded_rowcol_from_xy(centres)
        row, col = at[inside].T
        rows = total[part].reshape(-1)  # a view: rows are whole
        rows[inside] += _weighed({name: layer[row, col] for name, layer in layers.items()})

    for_rows(add, lattice.shape)


def _weighed(values: ChosenLayers) -> NDArray[np.int64]:
    """Return what the values of layers at some cells come to."""
    if _LOG_ODDS in values:
        units = np.rint((values[_LOG_ODDS].astype(np.float64) - EVEN) * _PASS)
        return np.where(np.isnan(units), 0.0, units).astype(np.int64)
    hits, misses = (values[name].astype(np.int64) for name in (_HITS, _MISSES))
    weighed: NDArray[np.int64] = hits * _HIT - misses * _PASS
    return weighed
