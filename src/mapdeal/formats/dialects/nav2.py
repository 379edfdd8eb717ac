"""Nav2 from jazzy on: luma, float32, inclusive thresholds, transparent is unknown."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.map_yaml import MapMetadata
from mapdeal.formats.picture import Picture, by_sample, to_16_bit
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN


def occupancy_of(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Return the occupancy of each pixel, shape (H, W), int8, row 0 in the north."""
    by_grey = _by_grey_level(metadata)
    alpha = picture.alpha
    if picture.palette is not None:
        occupancy = by_sample(by_grey[_grey_of_rgb(picture.palette[:, :3], 255)], picture.samples)
        if (picture.palette[:, 3] < 255).any():
            alpha = picture.palette[:, 3][picture.samples]
    elif picture.colour == "rgb":
        occupancy = by_grey[_grey_of_rgb(picture.samples, picture.maxval)]
    else:
        grey = to_16_bit(picture.maxval) // 257
        occupancy = by_sample(by_grey[grey], picture.samples)
    if alpha is not None and metadata.mode != "raw":
        opaque = to_16_bit(picture.maxval) // 257 == 255
        occupancy[~opaque[alpha]] = UNKNOWN
    return occupancy


def _grey_of_rgb(
    rgb: NDArray[np.uint8] | NDArray[np.uint16], maxval: int
) -> NDArray[np.integer[Any]]:
    """Return the grey level 0..255: a rounded 16-bit luma, then truncated to 8 bits."""
    if maxval == 255:  # 257 times as much in 16 bits: all that follows fits 32
        red, green, blue = (rgb[..., c].astype(np.uint32) for c in range(3))
        red *= np.uint32(299 * 257)
        green *= np.uint32(587 * 257)
        blue *= np.uint32(114 * 257)
        red += green
        red += blue
        red += np.uint32(500)
        return red // np.uint32(1000 * 257)
    wide = [to_16_bit(maxval)[rgb[..., c]].astype(np.int64) for c in range(3)]
    return (299 * wide[0] + 587 * wide[1] + 114 * wide[2] + 500) // 1000 // 257


def _by_grey_level(metadata: MapMetadata) -> NDArray[np.int8]:
    """Return the occupancy of each of the 256 grey levels, opaque."""
    grey = np.arange(256)
    if metadata.mode == "raw":
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    brightness = grey.astype(np.float32) / np.float32(255)
    darkness = brightness if metadata.negate else np.float32(1) - brightness
    occupied_thresh = np.float32(metadata.occupied_thresh)
    free_thresh = np.float32(metadata.free_thresh)
    values = np.full(256, UNKNOWN, dtype=np.int8)
    if metadata.mode == "scale":
        span = np.float32(metadata.occupied_thresh - metadata.free_thresh)
        between = (darkness > free_thresh) & (darkness < occupied_thresh)
        scaled = (darkness[between] - free_thresh) / span * np.float32(100)
        values[between] = np.floor(scaled + np.float32(0.5)).astype(np.int8)
    values[darkness >= occupied_thresh] = OCCUPIED
    values[darkness <= free_thresh] = FREE  # comes last: free wins where the two overlap
    return values
