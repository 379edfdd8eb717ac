"""Conversion of pixels to occupancy by the three map_server readers in use.

Every rule depends on a small integer only, a grey level or a sum of samples, and is worked out
in exactly the precision of its reader: in a table where there are few of them.

References
----------
Read off and checked against the readers of ROS 1 (``map_server/image_loader.cpp``), of Nav2
humble and of Nav2 jazzy and later (``nav2_map_server/map_io.cpp`` with GraphicsMagick).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.maps.map_yaml import Dialect, MapMetadata
from mapdeal.maps.picture import Picture, Samples, by_sample, opaque_greys, to_16_bit

Reader = Callable[[Picture, MapMetadata], NDArray[np.int8]]
"""From a picture to occupancy, shape (H, W), int8, row 0 in the north."""

_PIXELS_TOGETHER = 1 << 17


def _as_nav2(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Read as Nav2 from jazzy on: luma, float32, inclusive thresholds, transparent is unknown."""
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


_OPAQUE = 65535


def _as_humble(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Read as Nav2 humble and iron: mean of the channels in float64, strict thresholds."""
    wide = to_16_bit(picture.maxval).astype(np.int32)
    if picture.palette is not None:
        colours, opacities = picture.palette[:, :3], picture.palette[:, 3]
        opacity = wide[opacities] if (opacities < 255).any() else None
        by_index = _humble_occupancy(_sum(wide, colours), opacity, metadata)
        return by_sample(by_index, picture.samples)
    if picture.alpha is None:
        if picture.colour == "grey":
            by_grey = _humble_occupancy(3 * wide, None, metadata)
            return by_sample(by_grey, picture.samples)
        return _humble_occupancy(_sum(wide, picture.samples), None, metadata)
    opacity = wide[picture.alpha]
    if picture.colour == "rgb":
        return _humble_occupancy(_sum(wide, picture.samples), opacity, metadata)
    if picture.alpha_from == "channel" and picture.file_format == "PNG":
        # This reader loses the opacities of such a PNG, but remembers that there were some.
        opacity = np.full_like(opacity, _OPAQUE)
    return _humble_occupancy(3 * wide[picture.samples], opacity, metadata)


def _sum(wide: NDArray[np.int32], rgb: Samples) -> NDArray[np.int32]:
    return wide[rgb[..., 0]] + wide[rgb[..., 1]] + wide[rgb[..., 2]]


def _humble_occupancy(
    total: NDArray[np.int32], opacity: NDArray[np.int32] | None, metadata: MapMetadata
) -> NDArray[np.int8]:
    """Return the occupancy for sums of three 16-bit samples and, if there is one, the opacity."""
    if metadata.mode == "trinary" and opacity is not None:
        return _of_sum(total + opacity, 4, metadata)
    occupancy = _of_sum(total, 3, metadata)
    if metadata.mode == "scale" and opacity is not None:
        occupancy[opacity != _OPAQUE] = UNKNOWN
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


def _as_ros1(picture: Picture, metadata: MapMetadata) -> NDArray[np.int8]:
    """Read as ROS 1: mean of the channels, alpha averaged in, palettes read as indices."""
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
        return _ros1_occupancy([samples, alpha], 2, alpha, metadata)
    channels = [samples[..., c] for c in range(3)]
    last = samples[..., 0 if picture.file_format == "BMP" else 2] if alpha is None else alpha
    if alpha is not None and trinary:
        return _ros1_occupancy([*channels, alpha], 4, last, metadata)
    return _ros1_occupancy(channels, 3, last, metadata)


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


def _ros1_occupancy(
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


DIALECTS: dict[Dialect, Reader] = {
    "nav2": _as_nav2,
    "humble": _as_humble,
    "ros1": _as_ros1,
}


def cells_of(
    picture: Picture, metadata: MapMetadata, dialect: Dialect, *,
    out: NDArray[np.int8] | None = None,
) -> NDArray[np.int8]:  # fmt: skip
    """Return the occupancy of each cell as a reader has it, shape (H, W), row 0 in the south."""
    picture = picture.from_the_south()
    if _is_plain(picture):
        values = DIALECTS[dialect](picture, metadata)
        if out is None:
            return np.ascontiguousarray(values)
        out[:] = values
        return out
    # colours and opacities become wide numbers on the way: not those of all pixels at once
    cells = np.empty(picture.shape, dtype=np.int8) if out is None else out
    read = reader_of(picture, metadata, dialect)
    first = 0
    for band in picture.bands(_PIXELS_TOGETHER):
        stop = first + band.shape[0]
        cells[first:stop] = read(band)
        first = stop
    return cells


def reader_of(
    kind: Picture, metadata: MapMetadata, dialect: Dialect
) -> Callable[[Picture], NDArray[np.int8]]:
    """Return a reader's way to read pictures of one kind, such as strips of a picture."""
    # Images of maps with colours and opacities have few of them: what is grey and opaque is looked
    # up in a table that the reader has made.
    read = DIALECTS[dialect]
    if kind.samples.ndim == 2 and kind.alpha is None:
        return lambda picture: read(picture, metadata)
    by_grey = read(opaque_greys(kind), metadata)[0]

    def occupancy(picture: Picture) -> NDArray[np.int8]:
        grey, others = picture.greys_and_others()
        values: NDArray[np.int8] = by_sample(by_grey, np.ascontiguousarray(grey))
        if others.any():
            values[others] = read(picture.only(others), metadata)[0]
        return values

    return occupancy


def _is_plain(picture: Picture) -> bool:
    """Return whether pixels are bytes that all readers look up in a table."""
    is_byte = picture.samples.dtype == np.uint8 and picture.samples.ndim == 2
    is_opaque = picture.alpha is None and (
        picture.palette is None or bool((picture.palette[:, 3] == 255).all())
    )
    return is_byte and is_opaque and picture.file_format == "PNM"
