"""ROS 1 map_server: mean of the channels, alpha averaged in, palettes read as indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.map_yaml import MapMetadata
from mapdeal.formats.picture import Picture, Samples, by_sample
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN


def occupancy_of(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Return the occupancy of each pixel, shape (H, W), int8, row 0 in the north."""
    # Two slips of the reader are kept, since maps are made by looking at what it does: an index
    # into a palette counts as a grey level, and in mode scale a pixel between the thresholds is
    # unknown if the last byte of its memory is 0, be that opacity, blue, or red in a BMP. One is
    # not: raw values above 100 are unknown here, the reader lets them wrap.
    samples, alpha = _as_stored(picture)
    trinary = metadata.mode == "trinary"
    if samples.ndim == 2 and alpha is None:
        # One byte: no test of a last byte, whatever the mode.
        return by_sample(_by_sum(1, metadata), samples)
    if samples.ndim == 2 and alpha is not None:  # brightness, and opacity from a key
        return _occupancy([samples, alpha], 2, alpha, metadata)
    channels = [samples[..., c] for c in range(3)]
    last = samples[..., 0 if picture.file_format == "BMP" else 2] if alpha is None else alpha
    if alpha is not None and trinary:
        return _occupancy([*channels, alpha], 4, last, metadata)
    return _occupancy(channels, 3, last, metadata)


def _as_stored(picture: Picture) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the 8-bit samples and opacities that this reader's image library stores."""
    samples = _to_8_bit(picture.samples, picture)
    alpha = None if picture.alpha is None else _to_8_bit(picture.alpha, picture)
    if picture.palette is not None:
        samples, alpha = _palette_as_stored(picture, picture.palette)
    elif picture.alpha_from == "key" and picture.colour == "rgb":
        alpha = None
    elif picture.alpha_from == "channel" and samples.ndim == 2 and (
        alpha is not None or picture.file_format in ("TIFF", "JPEG")
    ):  # fmt: skip
        samples = np.repeat(samples[..., np.newaxis], 3, axis=2)
    if picture.file_format == "TIFF":
        if samples.ndim == 2 and alpha is None:
            samples = np.repeat(samples[..., np.newaxis], 3, axis=2)
        opaque = np.full(picture.shape, 255, dtype=np.uint8)
        alpha = opaque if alpha is None else alpha
        premultiplied = (samples.astype(np.int32) * alpha[..., np.newaxis] + 127) // 255
        samples = premultiplied.astype(np.uint8)
    return samples, alpha


def _to_8_bit(samples: Samples, picture: Picture) -> NDArray[np.uint8]:
    if picture.maxval == 255:
        return samples.astype(np.uint8, copy=False)
    if picture.file_format == "PNM":
        table = np.arange(picture.maxval + 1, dtype=np.int64) * 255 // picture.maxval
        return table.astype(np.uint8)[samples]
    return (samples >> 8).astype(np.uint8)


def _palette_as_stored(
    picture: Picture, palette: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    indices = picture.samples.astype(np.uint8, copy=False)
    opacities = palette[:, 3]
    one_key = np.count_nonzero(opacities == 0) == 1 and np.count_nonzero(opacities < 255) == 1
    if picture.file_format != "TIFF" and (one_key or (opacities == 255).all()):
        return indices, None
    colours = palette[indices]
    return colours[..., :3], colours[..., 3]


def _occupancy(
    channels: list[NDArray[np.uint8]], divisor: int, last: NDArray[np.uint8], metadata: MapMetadata
) -> NDArray[np.int8]:
    total = np.zeros(channels[0].shape, dtype=np.int32)
    for channel in channels:
        total += channel
    occupancy = _by_sum(divisor, metadata)[total]
    if metadata.mode == "scale":
        decided = _by_sum(divisor, metadata, decided_only=True)[total] != UNKNOWN
        occupancy[(last == 0) & ~decided] = UNKNOWN
    return occupancy


def _by_sum(
    channels: int, metadata: MapMetadata, *, decided_only: bool = False
) -> NDArray[np.int8]:  # fmt: skip
    """Return the occupancy of each possible sum of `channels` 8-bit samples."""
    # With `decided_only` values between the thresholds are left unknown in mode scale too.
    average = np.arange(channels * 255 + 1) / channels
    if metadata.negate:
        average = 255 - average
    if metadata.mode == "raw":
        grey = np.trunc(average)
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    darkness = (255 - average) / 255.0
    occupied_thresh, free_thresh = metadata.occupied_thresh, metadata.free_thresh
    values = np.full(average.shape, UNKNOWN, dtype=np.int8)
    if metadata.mode == "scale" and not decided_only:
        between = (darkness >= free_thresh) & (darkness <= occupied_thresh)
        if free_thresh == occupied_thresh:
            values[between] = FREE  # 0 / 0 in this reader
        else:
            span = occupied_thresh - free_thresh
            values[between] = np.trunc(1 + 98 * ((darkness[between] - free_thresh) / span))
    values[darkness < free_thresh] = FREE
    values[darkness > occupied_thresh] = OCCUPIED
    return values
