"""What there is to warn of in the cells of a map: the same words for all who read it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MapdealWarning
from mapdeal.formats.dialects import cells_of
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture, by_sample, to_16_bit
from mapdeal.grid.costmap import UNIFORM_SHARE, Costmap
from mapdeal.grid.framed import Figures
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.blocks import Layer, holds_everywhere

MAP_SAVER_UNKNOWN = 205
"""The grey that map_saver writes for unknown cells."""

USUAL_FREE_THRESH = 0.196
"""What ROS has for free_thresh by default: just below the shade of that grey."""

FREED_SHARE = 0.001
"""Share of the cells from which on this grey is map_saver's, and not the blur of some edges.

Anti-aliasing spreads a few percent of the cells over all greys.
"""

_HALF_WAY = 50
"""A cost that is low on either scale."""

NOTHING_KNOWN = "every cell is unknown; are the thresholds, mode and negate right?"


class FreedCells:
    """Counts the cells of map_saver's grey for unknown that a reader takes for free.

    Parameters
    ----------
    metadata : MapMetadata
        What the YAML file says.
    dialect : {'nav2', 'humble', 'ros1'}
        The reader.
    """

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

    def add(self, picture: Picture, occupancy: NDArray[np.int8]) -> None:
        """Count those of some rows.

        Parameters
        ----------
        picture : Picture
            The pixels, row 0 in the north.
        occupancy : numpy.ndarray of int8
            What the reader makes of them, row 0 in the south.
        """
        if not self.are_possible(picture):
            return
        mask = of_map_saver_unknown(picture) & (occupancy[::-1] == FREE)
        count = int(np.count_nonzero(mask))
        if count and not self.stay_free:
            alpha = None if picture.alpha is None else picture.alpha[mask][np.newaxis]
            row = replace(picture, samples=picture.samples[mask][np.newaxis], alpha=alpha)
            self.stay_free = bool((cells_of(row, self._usual, self._dialect) == FREE).any())
        self.count += count

    def are_possible(self, picture: Picture) -> bool:
        """Return whether there can be any; of opaque bytes, one pixel tells of all."""
        if picture.maxval != 255 or picture.alpha is not None or picture.palette is not None:
            return True
        if self._byte_is_free is None:
            grey = np.full((1, 1, *picture.samples.shape[2:]), MAP_SAVER_UNKNOWN, dtype=np.uint8)
            cells = cells_of(replace(picture, samples=grey), self._metadata, self._dialect)
            self._byte_is_free = bool(cells[0, 0] == FREE)
        return self._byte_is_free


def of_map_saver_unknown(picture: Picture) -> NDArray[np.bool_]:
    """Return which pixels have the grey that map_saver writes for unknown, shape (H, W)."""
    if picture.palette is not None:
        of_index = (picture.palette[:, :3] == MAP_SAVER_UNKNOWN).all(axis=1)
        mask: NDArray[np.bool_] = by_sample(of_index, picture.samples)
        return mask
    of_sample = to_16_bit(picture.maxval) // 257 == MAP_SAVER_UNKNOWN
    mask = by_sample(of_sample, picture.samples)
    if picture.colour == "rgb":
        mask = mask[..., 0] & mask[..., 1] & mask[..., 2]
    return mask


def remark_on_freed(
    freed: Mapping[Dialect, FreedCells], cells: int, metadata: MapMetadata
) -> str | None:
    """Return what to say of map_saver's unknown cells that are read as free, None if few are.

    Parameters
    ----------
    freed : mapping of str to FreedCells
        Those of one reader or several.
    cells : int
        All cells of the map.
    metadata : MapMetadata
        What the YAML file says.
    """
    most = max(one.count for one in freed.values())
    if most < FREED_SHARE * cells:
        return None
    told = ", ".join(
        f"{one.count} cells ({100 * one.count / cells:.3g} %)"
        + (f" by {dialect}" if len(freed) > 1 else "")
        for dialect, one in freed.items()
        if one.count
    )
    text = f"grey {MAP_SAVER_UNKNOWN}, map_saver's unknown, is read as free in {told}"
    if any(one.stay_free for one in freed.values()):
        return f"{text}: opacity counts as brightness there, so that no free_thresh mends it"
    return (
        f"{text}: free_thresh is {metadata.free_thresh:.6g}; {USUAL_FREE_THRESH} keeps it unknown"
    )


class PixelRemarks:
    """What there is to warn of in the pixels of a map, found strip by strip.

    Parameters
    ----------
    metadata : MapMetadata
        What the YAML file says.
    dialect : {'nav2', 'humble', 'ros1'}
        The reader.
    """

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
        """Warn of what was found in all strips."""
        if self._reads_indices:
            text = "ROS 1 reads indices of the palette, not colours"
            _warn(image, text, "image.palette")
        if self._lost:
            _warn(image, remark_on_lost(self._lost), "image.raw-values")
        remark = remark_on_freed({self._dialect: self._freed}, self._cells, self._metadata)
        if remark is not None:
            _warn(yaml_path, remark, "thresholds.unknown-becomes-free")


def count_of_lost(picture: Picture) -> int:
    """Return how many pixels of mode raw hold no value of a map; of 8-bit grey alone."""
    if picture.colour != "grey" or picture.maxval != 255:
        return 0
    return int(np.count_nonzero((picture.samples > OCCUPIED) & (picture.samples < 255)))


def remark_on_lost(count: int) -> str:
    """Return what to say of so many pixels of mode raw that hold no value of a map."""
    return f"{count} pixels of mode raw hold 101..254, read as unknown"


def warn_of_nothing_known(path: Path, occupancy: Layer) -> None:
    """Warn of a map without any known cell; of a lazy one, rows are looked at up to the first."""
    if holds_everywhere(occupancy, lambda values: values < 0):
        _warn(path, NOTHING_KNOWN, "map.all-unknown")


def warn_of_one_cost(path: Path, costmap: Costmap) -> None:
    """Warn of costs that say nothing: one for nearly all cells that are open, or none open."""
    figures = costmap.figures()
    common = figures["most_common"]
    if common is None:
        if figures["unknown"] == costmap.cost.size:
            _warn(path, "every cell is unknown", "run.uniform-cost")
        else:
            _warn(path, "every known cell is lethal or inscribed", "run.uniform-cost")
    elif common["share"] > UNIFORM_SHARE:
        told = f"{100 * common['share']:.4g} % of the open cells cost {common['cost']}"
        _warn(path, f"{told}: {_advice(figures)}", "run.uniform-cost")


def _advice(figures: Figures) -> str:
    """Return what to change of costs of which nobody knows how they were made."""
    if not figures["lethal"]:
        return "there is no obstacle"
    if figures["most_common"]["cost"] < _HALF_WAY:
        return "a larger inflation_radius, or lower up and down, grade more of them"
    return "a higher cost_scaling_factor, or the metric view, grades more of them"


def _warn(path: Path, text: str, check: str) -> None:
    warnings.warn(MapdealWarning(f"{path}: {text}", check), stacklevel=4)
