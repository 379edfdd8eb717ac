"""Metadata of a map's YAML file, and the occupancy that map_server's readers give its pixels.

Every rule depends only on a small integer, a grey level or a sum of samples, and is computed in
the exact precision of its reader, for all grey levels in one table.

References
----------
Read off and checked against the readers of ROS 1 (``map_server/image_loader.cpp``), of Nav2
humble and of Nav2 jazzy and later (``nav2_map_server/map_io.cpp`` with GraphicsMagick).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.files.yaml_text import Entry, read_mapping, yaml_document
from mapdeal.grid.field import ESDF_VIEW, View, ViewScale
from mapdeal.grid.frame import Origin, check_origin, check_resolution
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, CostScale
from mapdeal.kernels.arrays import Bytes, Floats
from mapdeal.maps.picture import Picture, Samples, by_sample, opaque_greys, to_16_bit, warn_of

Mode = Literal["trinary", "scale", "raw"]
Dialect = Literal["nav2", "humble", "ros1"]

_REQUIRED = ("image", "resolution", "origin")
_KNOWN = (*_REQUIRED, "mode", "negate", "occupied_thresh", "free_thresh", "cost_scale")
_LEGACY_MODES = ("trinary", "scale", "raw")
_NO, _YES = ("0", "false", "no", "off"), ("1", "true", "yes", "on")
_VIEW_KEYS = ("layer", "view", "view_range", "farthest", "deepest")


@records.dataclass(frozen=True)
class MapMetadata:
    image: str
    resolution: float
    origin: Origin
    mode: Mode = "trinary"
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196
    cost_scale: CostScale | None = None
    view: ViewScale | None = None
    extra: Mapping[str, Any] = records.field(default_factory=lambda: MappingProxyType({}))


def read_metadata(path: Path, *, dialect: Dialect = "nav2") -> MapMetadata:
    return metadata_of(read_mapping(path), path, dialect=dialect)


def metadata_of(
    entries: dict[str, Entry], path: Path, *, dialect: Dialect = "nav2", mend: bool = False
) -> MapMetadata:
    if missing := [key for key in _REQUIRED if key not in entries]:
        rule = f"missing key{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
        raise errors.MalformedInputError(rule, source=path, hint=_typo_hint(missing, entries))
    defaults = {"negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196"}
    if absent := {key: value for key, value in defaults.items() if key not in entries}:
        them = "them" if len(absent) > 1 else "it"
        text = f"{', '.join(absent)} (ROS requires {them}); assuming {', '.join(absent.values())}"
        warn_of(path, f"missing: {text}", "yaml.defaults")
    occupied_thresh = _threshold(entries, "occupied_thresh", 0.65)
    free_thresh = _threshold(entries, "free_thresh", 0.196)
    if free_thresh > occupied_thresh:
        raise _crossed_thresholds(path, entries, occupied_thresh, free_thresh)
    if free_thresh == occupied_thresh:
        text = f"equals occupied_thresh; read as dialect {dialect} does"
        warn_of(path, f"free_thresh: {text}", "thresholds.equal")
    mode = _mode(path, entries, dialect)
    view = _view(entries, mode)
    known = (*_KNOWN, *_LEGACY_MODES, *(_VIEW_KEYS if view is not None else ()))
    return MapMetadata(
        image=_image(entries["image"]), resolution=_resolution(entries["resolution"]),
        origin=_origin(entries["origin"], mend), mode=mode, negate=_negate(path, entries, dialect),
        occupied_thresh=occupied_thresh, free_thresh=free_thresh, cost_scale=_cost_scale(entries),
        view=view, extra={k: e.printable_value() for k, e in entries.items() if k not in known},
    )  # fmt: skip


def _crossed_thresholds(
    path: Path, entries: dict[str, Entry], occupied: float, free: float
) -> errors.MalformedInputError:
    if "free_thresh" not in entries:
        missing, relation = "free_thresh", f"{free:g} exceeds occupied_thresh {occupied:g}"
    elif "occupied_thresh" not in entries:
        missing, relation = "occupied_thresh", f"{occupied:g} is below free_thresh {free:g}"
    else:
        rule = f"must not be larger than occupied_thresh ({occupied:g})"
        return errors.MalformedInputError(rule, source=path, place="free_thresh", got=free)
    rule, hint = f"is missing and its default {relation}", f"write {missing}"
    return errors.MalformedInputError(rule, source=path, place=missing, hint=hint)


def yaml_of(metadata: MapMetadata) -> bytes:
    """Return the YAML file of `metadata`: keys in ROS's order, floats in shortest form."""
    keys = ("image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    document = {key: getattr(metadata, key) for key in keys}
    document |= {"origin": [float(v) for v in metadata.origin], "negate": int(metadata.negate)}
    if metadata.cost_scale is not None:
        document["cost_scale"] = metadata.cost_scale
    if metadata.view is not None:
        document |= {"layer": ESDF_VIEW, **metadata.view.entries()}
    document.update(metadata.extra)
    return yaml_document(document)


def _typo_hint(missing: list[str], entries: dict[str, Entry]) -> str | None:
    import difflib  # only mistakes need it

    for key in missing:
        similar = difflib.get_close_matches(key, [k for k in entries if k not in _KNOWN], n=1)
        if similar:
            return f"is {similar[0]} meant to be {key}?"
    return None


def _number(entry: Entry) -> float:
    value = entry.number()
    if entry.is_yaml_1_1_text:
        text = f"{entry.text()!r} is text to YAML 1.1 readers; read as {value:g}"
        warn_of(entry.source, f"{entry.place}: {text}", "yaml.number-as-text")
    return value


def _resolution(entry: Entry) -> float:
    try:
        return check_resolution(_number(entry))
    except errors.ParameterError as error:
        raise entry.error(error.rule) from None


def _origin(entry: Entry, mend: bool) -> Origin:
    items = entry.items()
    if len(items) != 3:
        raise entry.error(f"must be three numbers [x, y, yaw], has {len(items)}")
    try:
        if mend and items[2].text().lower().lstrip("+-.") == "nan":
            text = f"yaw {items[2].text()}, a fault of some map savers: must be 0"
            warn_of(entry.source, f"{entry.place}: {text}", "yaml.nan-yaw")
            return check_origin([*(_number(item) for item in items[:2]), 0.0])
        origin = check_origin([_number(item) for item in items])
        if abs(origin[2]) > 2 * math.pi:
            text = f"a yaw of {origin[2]:.6g} rad is more than a turn; is it in degrees?"
            warn_of(entry.source, f"{entry.place}: {text}", "yaml.yaw-in-degrees")
        return origin
    except errors.ParameterError as error:
        raise entry.error(error.rule) from None


def _threshold(entries: dict[str, Entry], key: str, default: float) -> float:
    if key not in entries:
        return default
    value = _number(entries[key])
    if not 0 <= value <= 1:
        raise entries[key].error("must lie between 0 and 1")
    return value


def _negate(path: Path, entries: dict[str, Entry], dialect: Dialect) -> bool:
    if (entry := entries.get("negate")) is None:
        return False
    word = entry.text().lower()
    if word not in (*_NO, *_YES) or (getattr(entry.node, "style", None) and not word.isdigit()):
        raise entry.error("must be 0 or 1")
    value = word in _YES
    if dialect == "ros1" and not word.isdigit():
        remark = f"{entry.text()} is refused by ROS 1; read as {value:d}"
        warn_of(path, f"{entry.place}: {remark}", "yaml.negate-word")
    return value


def _mode(path: Path, entries: dict[str, Entry], dialect: Dialect) -> Mode:
    if (entry := entries.get("mode")) is None:
        if not (legacy := [key for key in _LEGACY_MODES if key in entries]):
            return "trinary"
        text = "old key; its meaning is written mode: trinary, scale or raw"
        warn_of(path, f"{legacy[0]}: {text}", "yaml.legacy-mode")
        chosen = [key for key in legacy if entries[key].text().lower() in ("true", "1")]
        return chosen[0] if chosen else "trinary"  # type: ignore[return-value]
    text = entry.text()
    if text.lower() not in get_args(Mode):
        raise entry.error("must be trinary, scale or raw")
    if dialect == "ros1" and text != text.lower():
        remark = f"{text} is refused by ROS 1; read as {text.lower()}"
        warn_of(path, f"{entry.place}: {remark}", "yaml.mode-case")
    return text.lower()  # type: ignore[return-value]


def _cost_scale(entries: dict[str, Entry]) -> CostScale | None:
    if "cost_scale" not in entries:
        return None
    if entries["cost_scale"].text() != "costmap2d":
        raise entries["cost_scale"].error("must be costmap2d")
    return "costmap2d"


def _view(entries: dict[str, Entry], mode: Mode) -> ViewScale | None:
    if "layer" not in entries or entries["layer"].text() != ESDF_VIEW:
        return None
    layer = entries["layer"]
    if mode != "raw" or "cost_scale" in entries:
        raise layer.error("needs mode raw, and no cost_scale")
    if "view" not in entries:
        raise layer.error("needs key view")
    view: View = entries["view"].text()  # type: ignore[assignment]
    if view not in get_args(View):
        raise entries["view"].error("must be metric or per-map")
    keys = ViewScale.keys_of(view)
    if missing := [key for key in keys if key not in entries]:
        rule = f"needs key{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
        raise layer.error(rule, hint=f"a view {view} is described by {', '.join(keys)}")
    numbers = {key: _number(entries[key]) for key in keys}
    try:
        return ViewScale(view, **numbers)
    except errors.ParameterError as error:
        raise entries[str(error.place)].error(error.rule) from None


def _image(entry: Entry) -> str:
    text = entry.text()
    if not text.strip():
        raise entry.error("must name an image file")
    if "$(" in text:
        hint = "roslaunch expands it; write the path that it stands for"
        raise entry.error("must be a path", hint=hint)
    return text


Occupancy = NDArray[np.int8]  # shape (H, W), row 0 in the north unless another is named
Reader = Callable[[Picture, MapMetadata], Occupancy]
_PIXELS_AT_ONCE = 1 << 17


def _as_nav2(picture: Picture, metadata: MapMetadata) -> Occupancy:
    """Read as Nav2 since jazzy: luma, float32, inclusive thresholds, transparent is unknown."""
    by_grey = _by_grey_level(metadata)
    alpha = picture.alpha
    if picture.palette is not None:
        occupancy = by_sample(by_grey[_grey_of_rgb(picture.palette[:, :3], 255)], picture.samples)
        if (picture.palette[:, 3] < 255).any():
            alpha = picture.palette[:, 3][picture.samples]
    elif picture.colour == "rgb":
        occupancy = by_grey[_grey_of_rgb(picture.samples, picture.maxval)]
    else:
        occupancy = by_sample(by_grey[to_16_bit(picture.maxval) // 257], picture.samples)
    if alpha is not None and metadata.mode != "raw":
        opaque = to_16_bit(picture.maxval) // 257 == 255
        occupancy[~opaque[alpha]] = UNKNOWN
    return occupancy


def _grey_of_rgb(rgb: Bytes | NDArray[np.uint16], maxval: int) -> NDArray[np.integer[Any]]:
    """Return the grey level 0..255: a rounded 16-bit luma, then truncated to 8 bits."""
    red, green, blue = (to_16_bit(maxval).astype(np.int64)[rgb[..., c]] for c in range(3))
    return (299 * red + 587 * green + 114 * blue + 500) // 1000 // 257


def _by_grey_level(metadata: MapMetadata) -> Occupancy:
    grey = np.arange(256)
    if metadata.mode == "raw":
        return _raw(grey)
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


def _as_humble(picture: Picture, metadata: MapMetadata) -> Occupancy:
    """Read as Nav2 humble and iron: mean of the channels in float64, strict thresholds."""
    wide = to_16_bit(picture.maxval).astype(np.int32)
    if picture.palette is not None:
        colours, opacities = picture.palette[:, :3], picture.palette[:, 3]
        opacity = wide[opacities] if (opacities < 255).any() else None
        return by_sample(_humble_occupancy(_sum(wide, colours), opacity, metadata), picture.samples)
    opacity = None if picture.alpha is None else wide[picture.alpha]
    if picture.colour == "rgb":
        return _humble_occupancy(_sum(wide, picture.samples), opacity, metadata)
    if opacity is None:
        return by_sample(_humble_occupancy(3 * wide, None, metadata), picture.samples)
    if picture.alpha_from == "channel" and picture.file_format == "PNG":
        # This reader loses the opacities of such a PNG, but remembers that there were some.
        opacity = np.full_like(opacity, _OPAQUE)
    return _humble_occupancy(3 * wide[picture.samples], opacity, metadata)


def _sum(wide: NDArray[np.int32], rgb: Samples) -> NDArray[np.int32]:
    return wide[rgb[..., 0]] + wide[rgb[..., 1]] + wide[rgb[..., 2]]


def _humble_occupancy(
    total: NDArray[np.int32], opacity: NDArray[np.int32] | None, metadata: MapMetadata
) -> Occupancy:
    """Return the occupancy for sums of three 16-bit samples, and for an opacity if there is one."""
    if metadata.mode == "trinary" and opacity is not None:
        return _of_sum(total + opacity, 4, metadata)
    occupancy = _of_sum(total, 3, metadata)
    if metadata.mode == "scale" and opacity is not None:
        occupancy[opacity != _OPAQUE] = UNKNOWN
    return occupancy


def _of_sum(sums: NDArray[np.int32], channels: int, metadata: MapMetadata) -> Occupancy:
    shade = sums / channels / 65535
    if metadata.mode == "raw":
        return _raw(np.floor(shade * 255 + 0.5))
    darkness = shade if metadata.negate else 1 - shade
    return _by_darkness(darkness, metadata, lambda share: np.rint(share * 100))


def _raw(grey: NDArray[Any]) -> Occupancy:
    return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)


def _by_darkness(
    darkness: Floats, metadata: MapMetadata, scaled: Callable[[Floats], Floats] | None = None
) -> Occupancy:
    """Return the occupancy by the strict thresholds of the older readers."""
    # In mode scale `scaled` maps the position between the thresholds, 0..1, to a value.
    occupied_thresh, free_thresh = metadata.occupied_thresh, metadata.free_thresh
    values = np.full(darkness.shape, UNKNOWN, dtype=np.int8)
    if scaled is not None and metadata.mode == "scale":
        between = (darkness >= free_thresh) & (darkness <= occupied_thresh)
        if free_thresh == occupied_thresh:
            values[between] = FREE  # 0 / 0 in these readers
        else:
            span = occupied_thresh - free_thresh
            values[between] = scaled((darkness[between] - free_thresh) / span)
    values[darkness < free_thresh] = FREE
    values[darkness > occupied_thresh] = OCCUPIED
    return values


def _as_ros1(picture: Picture, metadata: MapMetadata) -> Occupancy:
    """Read as ROS 1: mean of the channels, alpha averaged in, palettes read as indices."""
    # Two bugs of the reader are reproduced, since people adjust maps to its results: a palette
    # index counts as a grey level, and in mode scale a pixel between the thresholds is unknown if
    # its last byte is 0 (opacity, blue, or red in a BMP). Raw values above 100 do not wrap here.
    samples, alpha = _as_stored(picture)
    if samples.ndim == 2 and alpha is None:
        # a single byte per pixel: the reader tests no last byte
        return by_sample(_by_sum(1, metadata), samples)
    if samples.ndim == 2 and alpha is not None:  # brightness, and opacity from a key
        return _ros1_occupancy([samples, alpha], alpha, metadata)
    channels = [samples[..., c] for c in range(3)]
    last = samples[..., 0 if picture.file_format == "BMP" else 2] if alpha is None else alpha
    if alpha is not None and metadata.mode == "trinary":
        return _ros1_occupancy([*channels, alpha], last, metadata)
    return _ros1_occupancy(channels, last, metadata)


def _as_stored(picture: Picture) -> tuple[Bytes, Bytes | None]:
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
        alpha = np.full(picture.shape, 255, dtype=np.uint8) if alpha is None else alpha
        premultiplied = (samples.astype(np.int32) * alpha[..., np.newaxis] + 127) // 255
        samples = premultiplied.astype(np.uint8)
    return samples, alpha


def _to_8_bit(samples: Samples, picture: Picture) -> Bytes:
    if picture.maxval == 255:
        return samples.astype(np.uint8, copy=False)
    if picture.file_format == "PNM":
        table = np.arange(picture.maxval + 1, dtype=np.int64) * 255 // picture.maxval
        return table.astype(np.uint8)[samples]
    return (samples >> 8).astype(np.uint8)


def _palette_as_stored(picture: Picture, palette: Bytes) -> tuple[Bytes, Bytes | None]:
    indices = picture.samples.astype(np.uint8, copy=False)
    opacities = palette[:, 3]
    one_key = np.count_nonzero(opacities == 0) == 1 and np.count_nonzero(opacities < 255) == 1
    if picture.file_format != "TIFF" and (one_key or (opacities == 255).all()):
        return indices, None
    colours = palette[indices]
    return colours[..., :3], colours[..., 3]


def _ros1_occupancy(channels: list[Bytes], last: Bytes, metadata: MapMetadata) -> Occupancy:
    total = np.zeros(channels[0].shape, dtype=np.int32)
    for channel in channels:
        total += channel
    occupancy = _by_sum(len(channels), metadata)[total]
    if metadata.mode == "scale":
        decided = _by_sum(len(channels), metadata, decided_only=True)[total] != UNKNOWN
        occupancy[(last == 0) & ~decided] = UNKNOWN
    return occupancy


def _by_sum(channels: int, metadata: MapMetadata, *, decided_only: bool = False) -> Occupancy:
    """Return the occupancy of each possible sum of `channels` 8-bit samples."""
    # With `decided_only`, values between the thresholds stay unknown even in mode scale.
    average = np.arange(channels * 255 + 1) / channels
    average = 255 - average if metadata.negate else average
    if metadata.mode == "raw":
        return _raw(np.trunc(average))
    darkness = (255 - average) / 255.0
    if decided_only:
        return _by_darkness(darkness, metadata)
    return _by_darkness(darkness, metadata, lambda share: np.trunc(1 + 98 * share))


DIALECTS: dict[Dialect, Reader] = {"nav2": _as_nav2, "humble": _as_humble, "ros1": _as_ros1}


def cells_of(
    picture: Picture, metadata: MapMetadata, dialect: Dialect, *, out: Occupancy | None = None
) -> Occupancy:
    """Return the occupancy that a reader gives each cell, shape (H, W), row 0 in the south."""
    picture = picture[::-1]
    is_byte = picture.samples.dtype == np.uint8 and picture.samples.ndim == 2
    # All readers look the bytes of a PNM up in a table. Colours and opacities become wide numbers,
    # so fewer rows of them are converted at once.
    is_looked_up = is_byte and picture.file_format == "PNM"
    most_pixels = 8 * _PIXELS_AT_ONCE if is_looked_up else _PIXELS_AT_ONCE
    cells = np.empty(picture.shape, dtype=np.int8) if out is None else out
    read = reader_of(picture, metadata, dialect)
    first = 0
    for band in picture.bands(most_pixels):
        cells[first : first + band.shape[0]] = read(band)
        first += band.shape[0]
    return cells


def reader_of(
    kind: Picture, metadata: MapMetadata, dialect: Dialect
) -> Callable[[Picture], Occupancy]:
    """Return a function that reads pictures of one kind, such as the strips of a picture."""
    # Few pixels of a map are coloured or transparent, so grey opaque ones go through a table that
    # the reader has filled.
    read = DIALECTS[dialect]
    if kind.samples.ndim == 2 and kind.alpha is None:
        return lambda picture: read(picture, metadata)
    by_grey = read(opaque_greys(kind), metadata)[0]

    def occupancy(picture: Picture) -> Occupancy:
        grey, exceptions = picture.greys_and_exceptions()
        values: Occupancy = by_sample(by_grey, np.ascontiguousarray(grey))
        if exceptions.any():
            values[exceptions] = read(picture.only(exceptions), metadata)[0]
        return values

    return occupancy
