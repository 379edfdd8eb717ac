"""Nav2 humble and iron: mean of the channels in float64, strict thresholds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.map_yaml import MapMetadata
from mapdeal.formats.picture import Picture, Samples, by_sample, to_16_bit
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN

_FULL = 65535


def occupancy_of(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Return the occupancy of each pixel, shape (H, W), int8, row 0 in the north."""
    wide = to_16_bit(picture.maxval).astype(np.int32)
    if picture.palette is not None:
        colours, opacities = picture.palette[:, :3], picture.palette[:, 3]
        opacity = wide[opacities] if (opacities < 255).any() else None
        by_index = _occupancy(_sum(wide, colours), opacity, metadata)
        return by_sample(by_index, picture.samples)
    if picture.alpha is None:
        if picture.colour == "grey":
            by_grey = _occupancy(3 * wide, None, metadata)
            return by_sample(by_grey, picture.samples)
        return _occupancy(_sum(wide, picture.samples), None, metadata)
    opacity = wide[picture.alpha]
    if picture.colour == "rgb":
        return _occupancy(_sum(wide, picture.samples), opacity, metadata)
    if picture.alpha_from == "channel" and picture.file_format == "PNG":
        # This reader loses the opacities of such a PNG, but remembers that there were some.
        opacity = np.full_like(opacity, _FULL)
    return _occupancy(3 * wide[picture.samples], opacity, metadata)


def _sum(wide: NDArray[np.int32], rgb: Samples) -> NDArray[np.int32]:
    return wide[rgb[..., 0]] + wide[rgb[..., 1]] + wide[rgb[..., 2]]


def _occupancy(
    total: NDArray[np.int32], opacity: NDArray[np.int32] | None, metadata: MapMetadata
) -> NDArray[np.int8]:
    """Return the occupancy for sums of three 16-bit samples and, if there is one, the opacity."""
    if metadata.mode == "trinary" and opacity is not None:
        return _of_sum(total + opacity, 4, metadata)
    occupancy = _of_sum(total, 3, metadata)
    if metadata.mode == "scale" and opacity is not None:
        occupancy[opacity != _FULL] = UNKNOWN
    return occupancy


def _of_sum(
    sums: NDArray[np.int32], channels: int, metadata: MapMetadata
) -> NDArray[np.int8]:  # fmt: skip
    """Return the occupancy for sums of `channels` 16-bit samples."""
    shade = sums / channels / 65535
    if metadata.mode == "raw":
        grey = np.floor(shade * 255 + 0.5)
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    darkness = shade if metadata.negate else 1 - shade
    occupied_thresh, free_thresh = metadata.occupied_thresh, metadata.free_thresh
    values = np.full(sums.shape, UNKNOWN, dtype=np.int8)
    if metadata.mode == "scale":
        between = (darkness >= free_thresh) & (darkness <= occupied_thresh)
        if free_thresh == occupied_thresh:
            values[between] = FREE  # 0 / 0 in this reader
        else:
            span = occupied_thresh - free_thresh
            values[between] = np.rint((darkness[between] - free_thresh) / span * 100)
    values[darkness < free_thresh] = FREE
    values[occupied_thresh < darkness] = OCCUPIED
    return values
