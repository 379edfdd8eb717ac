"""Warnings about the cells of a map, in the same words for all readers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MapdealWarning, emit_warning
from mapdeal.grid.costmap import UNIFORM_SHARE, Costmap
from mapdeal.grid.framed import Figures
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.blocks import Layer, holds_everywhere
from mapdeal.maps.dialects import cells_of
from mapdeal.maps.map_yaml import Dialect, MapMetadata
from mapdeal.maps.picture import Picture, by_sample

MAP_SAVER_UNKNOWN = 205
"""The grey that map_saver writes for unknown cells."""

USUAL_FREE_THRESH = 0.196
"""Default of free_thresh in ROS: just below the shade of that grey."""

FREED_SHARE = 0.001
"""Share of the cells from which on this grey is map_saver's, and not the blur of some edges.

Anti-aliasing spreads a few percent of the cells over all greys.
"""

_HALF_WAY = 50
"""A cost that is low on either scale."""

NOTHING_KNOWN = "every cell is unknown; are the thresholds, mode and negate right?"


class FreedCells:
    """Counts the cells of map_saver's grey for unknown that a reader takes for free."""

    def __init__(self, metadata: MapMetadata, dialect: Dialect) -> None:
        self.count = 0
        self.stay_free = False
        """Whether some are free with the usual free_thresh, too."""
        self._metadata = metadata
        self._usual = replace(
            metadata, free_thresh=min(USUAL_FREE_THRESH, metadata.free_thresh)
        )  # fmt: skip
        self._dialect: Dialect = dialect
        self._byte_is_free: bool | None = None

    def add(
        self, picture: Picture, occupancy: NDArray[np.int8], times: NDArray[np.int64] | None = None
    ) -> None:
        """Count those of some rows."""
        if not self.are_possible(picture):
            return
        mask = of_map_saver_unknown(picture) & (occupancy[::-1] == FREE)
        count = _count(mask, times)
        if count and not self.stay_free:
            alpha = None if picture.alpha is None else picture.alpha[mask][np.newaxis]
            row = replace(picture, samples=picture.samples[mask][np.newaxis], alpha=alpha)
            self.stay_free = bool((cells_of(row, self._usual, self._dialect) == FREE).any())
        self.count += count

    def are_possible(self, picture: Picture) -> bool:
        """Return whether there can be any; of opaque bytes, one pixel stands for all."""
        if picture.maxval != 255 or picture.alpha is not None or picture.palette is not None:
            return True
        if self._byte_is_free is None:
            grey = np.full((1, 1, *picture.samples.shape[2:]), MAP_SAVER_UNKNOWN, dtype=np.uint8)
            cells = cells_of(replace(picture, samples=grey), self._metadata, self._dialect)
            self._byte_is_free = bool(cells[0, 0] == FREE)
        return self._byte_is_free


def of_map_saver_unknown(picture: Picture) -> NDArray[np.bool_]:
    """Return which pixels have the grey that map_saver writes for unknown, shape (H, W)."""
    # They have its very brightness, 205 / 255, whatever their maxval: greys beside it may be free
    # with the usual thresholds, which is nobody's mistake.
    if picture.palette is not None:
        of_index = (picture.palette[:, :3] == MAP_SAVER_UNKNOWN).all(axis=1)
        mask: NDArray[np.bool_] = by_sample(of_index, picture.samples)
        return mask
    if picture.maxval == 255:
        mask = picture.samples == MAP_SAVER_UNKNOWN
    else:
        of_sample = np.arange(picture.maxval + 1) * 255 == MAP_SAVER_UNKNOWN * picture.maxval
        mask = by_sample(of_sample, picture.samples)
    if picture.colour == "rgb":
        mask = mask[..., 0] & mask[..., 1] & mask[..., 2]
    return mask


def remark_on_freed(
    freed: Mapping[Dialect, FreedCells], cells: int, metadata: MapMetadata
) -> str | None:
    """Return what to say of map_saver's unknown cells that are read as free, None if few are."""
    counts = {dialect: one.count for dialect, one in freed.items() if one.count}
    most = max(counts.values(), default=0)
    if most == 0 or most < FREED_SHARE * cells:
        return None
    told = f"{most} cells ({percent(most, cells)}) of grey {MAP_SAVER_UNKNOWN}"
    text = f"{told}, which map_saver writes for unknown, are read as free"
    if len(freed) > 1:
        text += f" by {_listed([name for name, count in counts.items() if count == most])}"
    for other in sorted(set(counts.values()) - {most}, reverse=True):
        names = _listed([name for name, count in counts.items() if count == other])
        text += f", {other} ({percent(other, cells)}) by {names}"
    return f"{text}; {_advice(freed, metadata)}"


def _advice(freed: Mapping[Dialect, FreedCells], metadata: MapMetadata) -> str:
    """Return how such cells become unknown again."""
    # To readers that average the opacity into the grey it is lighter, and free with the usual
    # free_thresh, too. Digits are not rounded: 0.1960785 must not look like 0.196.
    by_opacity = [dialect for dialect, one in freed.items() if one.stay_free]
    parts = []
    if metadata.free_thresh > USUAL_FREE_THRESH:
        parts.append(f"lower free_thresh from {metadata.free_thresh!r} to {USUAL_FREE_THRESH}")
    if by_opacity:
        verb = "averages" if len(by_opacity) == 1 else "average"
        who = f"{_listed(by_opacity)} {verb} the opacity into the grey"
        parts.append(f"save the image as a PGM, since {who}")
    return ", and ".join(parts)


def _listed(names: Sequence[str]) -> str:
    """Return names as a sentence lists them.

    Examples
    --------
    >>> _listed(["a"]), _listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def percent(count: int, whole: int) -> str:
    """Return a share for messages, which is neither none nor all unless it is exactly that."""
    share = 100 * count / whole
    if 0 < share < 0.001:
        return "below 0.001 %"
    if 99.9 < share < 100:
        return "above 99.9 %"
    return f"{share:.3g} %"


class PixelRemarks:
    """Warnings about the pixels of a map, found strip by strip."""

    def __init__(self, metadata: MapMetadata, dialect: Dialect) -> None:
        self._metadata = metadata
        self._dialect: Dialect = dialect
        self._freed = FreedCells(metadata, dialect)
        self._cells = self._lost = 0
        self._reads_indices = False

    def are_possible(self, picture: Picture) -> bool:
        """Return whether pixels like those of a strip can be worth a warning."""
        return self._metadata.mode == "raw" or self._freed.are_possible(picture)

    def add(self, picture: Picture, occupancy: NDArray[np.int8]) -> None:
        """Look at some rows, see `FreedCells.add`."""
        self._cells += occupancy.size
        self._reads_indices = self._dialect == "ros1" and picture.colour == "palette"
        if self._metadata.mode == "raw":
            self._lost += count_of_lost(picture)
        else:
            self._freed.add(picture, occupancy)

    def warn(self, yaml_path: Path, image: Path) -> None:
        if self._reads_indices:
            text = "ROS 1 reads indices of the palette, not colours"
            _warn(image, text, "image.palette")
        if self._lost:
            _warn(image, remark_on_lost(self._lost), "image.raw-values")
        remark = remark_on_freed({self._dialect: self._freed}, self._cells, self._metadata)
        if remark is not None:
            _warn(yaml_path, remark, "thresholds.unknown-becomes-free")


def count_of_lost(picture: Picture, times: NDArray[np.int64] | None = None) -> int:
    """Return how many pixels of mode raw hold no value of a map; of 8-bit grey alone."""
    # `times` says how often each of them occurs, see `FreedCells.add`.
    if picture.colour != "grey" or picture.maxval != 255:
        return 0
    return _count((picture.samples > OCCUPIED) & (picture.samples < 255), times)


def _count(mask: NDArray[np.bool_], times: NDArray[np.int64] | None) -> int:
    return int(np.count_nonzero(mask) if times is None else times[mask].sum())


def remark_on_lost(count: int) -> str:
    """Return what to say of so many pixels of mode raw that hold no value of a map."""
    return f"{count} pixels of mode raw hold 101..254, read as unknown"


def warn_of_nothing_known(path: Path, occupancy: Layer, *, has_pixels: bool = True) -> None:
    """Warn of a map without any known cell; of a lazy one, rows are looked at up to the first."""
    if holds_everywhere(occupancy, lambda values: values < 0):
        _warn(path, NOTHING_KNOWN if has_pixels else "every cell is unknown", "map.all-unknown")


def warn_of_one_cost(path: Path, costmap: Costmap) -> None:
    """Warn of costs that say nothing: one for nearly all cells that are open, or none open."""
    warn_of_cost_figures(path, costmap.figures())


def warn_of_cost_figures(path: Path, figures: Figures) -> None:
    common = figures["most_common"]
    if common is None:
        if not figures["lethal"] + figures.get("inscribed", 0):
            _warn(path, "every cell is unknown", "run.uniform-cost")
        else:
            _warn(path, "every known cell is lethal or inscribed", "run.uniform-cost")
    elif common["share"] > UNIFORM_SHARE:
        told = f"{100 * common['share']:.4g} % of the open cells cost {common['cost']}"
        _warn(path, f"{told}: {_advice_on_costs(figures)}", "run.uniform-cost")


def _advice_on_costs(figures: Figures) -> str:
    if not figures["lethal"]:
        return "there is no obstacle"
    if figures["most_common"]["cost"] < _HALF_WAY:
        return "a larger inflation_radius, or lower up and down, grade more of them"
    return "a higher cost_scaling_factor, or the metric view, grades more of them"


def _warn(path: Path, text: str, check: str) -> None:
    emit_warning(MapdealWarning(f"{path}: {text}", check), stacklevel=4)
