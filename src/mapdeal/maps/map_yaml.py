"""The YAML half of a map_server pair: reading with all its traps, writing exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from mapdeal.errors import MalformedInputError, MapdealWarning, ParameterError, emit_warning
from mapdeal.files.yaml_text import Entry, read_mapping, yaml_document
from mapdeal.grid.field import ESDF_VIEW, View, ViewScale
from mapdeal.grid.frame import Origin, check_origin, check_resolution
from mapdeal.grid.values import CostScale

Mode = Literal["trinary", "scale", "raw"]
Dialect = Literal["nav2", "humble", "ros1"]

_REQUIRED = ("image", "resolution", "origin")
_KNOWN = (*_REQUIRED, "mode", "negate", "occupied_thresh", "free_thresh", "cost_scale")
_LEGACY_MODES = ("trinary", "scale", "raw")
_VIEW_KEYS = ("layer", "view", "view_range", "farthest", "deepest")


@dataclass(frozen=True)
class MapMetadata:
    """Content of a map's YAML file."""

    image: str
    resolution: float
    origin: Origin
    mode: Mode = "trinary"
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196
    cost_scale: CostScale | None = None
    view: ViewScale | None = None
    extra: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


def read_metadata(path: Path, *, dialect: Dialect = "nav2", mend: bool = False) -> MapMetadata:
    """Return what a map's YAML file says, checked."""
    return metadata_of(read_mapping(path), path, dialect=dialect, mend=mend)


def metadata_of(
    entries: dict[str, Entry], path: Path, *, dialect: Dialect = "nav2", mend: bool = False
) -> MapMetadata:
    """Return what the entries of a map's YAML file say, checked; see `read_metadata`."""
    missing = [key for key in _REQUIRED if key not in entries]
    if missing:
        rule = f"missing key{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
        raise MalformedInputError(rule, source=path, hint=_typo_hint(missing, entries))
    _warn_of_absent(path, entries)
    occupied_thresh = _threshold(entries, "occupied_thresh", 0.65)
    free_thresh = _threshold(entries, "free_thresh", 0.196)
    if free_thresh > occupied_thresh:
        rule = f"must not be larger than occupied_thresh ({occupied_thresh:g})"
        raise MalformedInputError(rule, source=path, place="free_thresh", got=free_thresh)
    if free_thresh == occupied_thresh:
        text = f"equals occupied_thresh; read as dialect {dialect} does"
        _warn(path, "free_thresh", text, "thresholds.equal")
    mode = _mode(path, entries, dialect)
    view = _view(entries, mode)
    known = (*_KNOWN, *_LEGACY_MODES, *(_VIEW_KEYS if view is not None else ()))
    return MapMetadata(
        image=_image(entries["image"]), resolution=_resolution(entries["resolution"]),
        origin=_origin(entries["origin"], mend), mode=mode, negate=_negate(entries),
        occupied_thresh=occupied_thresh, free_thresh=free_thresh, cost_scale=_cost_scale(entries),
        view=view, extra={k: e.printable_value() for k, e in entries.items() if k not in known},
    )  # fmt: skip


def yaml_of(metadata: MapMetadata) -> bytes:
    """Return the YAML file of `metadata`: keys in ROS's order, floats in shortest form."""
    document: dict[str, Any] = {
        "image": metadata.image,
        "mode": metadata.mode,
        "resolution": metadata.resolution,
        "origin": [float(v) for v in metadata.origin],
        "negate": int(metadata.negate),
        "occupied_thresh": metadata.occupied_thresh,
        "free_thresh": metadata.free_thresh,
    }
    if metadata.cost_scale is not None:
        document["cost_scale"] = metadata.cost_scale
    if metadata.view is not None:
        document |= {"layer": ESDF_VIEW, **metadata.view.entries()}
    document.update(metadata.extra)
    return yaml_document(document)


def _warn(path: Path, place: str, text: str, check: str) -> None:
    emit_warning(MapdealWarning(f"{path}: {place}: {text}", check), stacklevel=3)


def _typo_hint(missing: list[str], entries: dict[str, Entry]) -> str | None:
    for key in missing:
        import difflib

        near = difflib.get_close_matches(key, [k for k in entries if k not in _KNOWN], n=1)
        if near:
            return f"is {near[0]} meant to be {key}?"
    return None


def _warn_of_absent(path: Path, entries: dict[str, Entry]) -> None:
    defaults = {"negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196"}
    absent = {key: value for key, value in defaults.items() if key not in entries}
    if absent:
        them = "them" if len(absent) > 1 else "it"
        text = f"{', '.join(absent)} (ROS requires {them}); assuming {', '.join(absent.values())}"
        _warn(path, "missing", text, "yaml.defaults")


def _number(entry: Entry) -> float:
    value = entry.number()
    if entry.is_yaml_1_1_text:
        text = f"{entry.text()!r} is text to YAML 1.1 readers; read as {value:g}"
        _warn(entry.source, entry.place, text, "yaml.number-as-text")
    return value


def _resolution(entry: Entry) -> float:
    try:
        return check_resolution(_number(entry))
    except ParameterError as error:
        raise entry.error(error.rule) from None


def _origin(entry: Entry, mend: bool) -> Origin:
    items = entry.items()
    if len(items) != 3:
        raise entry.error(f"must be three numbers [x, y, yaw], has {len(items)}")
    try:
        if mend and items[2].text().lower().lstrip("+-.") == "nan":
            text = f"yaw {items[2].text()}, a fault of some map savers: must be 0"
            _warn(entry.source, entry.place, text, "yaml.nan-yaw")
            return check_origin([*(_number(item) for item in items[:2]), 0.0])
        return check_origin([_number(item) for item in items])
    except ParameterError as error:
        raise entry.error(error.rule) from None


def _threshold(entries: dict[str, Entry], key: str, default: float) -> float:
    if key not in entries:
        return default
    value = _number(entries[key])
    if not 0 <= value <= 1:
        raise entries[key].error("must lie between 0 and 1")
    return value


def _negate(entries: dict[str, Entry]) -> bool:
    if "negate" not in entries:
        return False
    entry = entries["negate"]
    words = {"0": False, "false": False, "no": False, "off": False,
             "1": True, "true": True, "yes": True, "on": True}  # fmt: skip
    word = entry.text().lower()
    quoted_word = getattr(entry.node, "style", None) and not word.isdigit()
    if word not in words or quoted_word:
        raise entry.error("must be 0 or 1")
    return words[word]


def _mode(path: Path, entries: dict[str, Entry], dialect: Dialect) -> Mode:
    if "mode" not in entries:
        legacy = [key for key in _LEGACY_MODES if key in entries]
        if not legacy:
            return "trinary"
        text = "old key; its meaning is written mode: trinary, scale or raw"
        _warn(path, legacy[0], text, "yaml.legacy-mode")
        chosen = [key for key in legacy if entries[key].text().lower() in ("true", "1")]
        return chosen[0] if chosen else "trinary"  # type: ignore[return-value]
    entry = entries["mode"]
    text = entry.text()
    if text.lower() not in ("trinary", "scale", "raw"):
        raise entry.error("must be trinary, scale or raw")
    if dialect == "ros1" and text != text.lower():
        told = f"{text} is refused by ROS 1; read as {text.lower()}"
        _warn(path, entry.place, told, "yaml.mode-case")
    return text.lower()  # type: ignore[return-value]


def _cost_scale(entries: dict[str, Entry]) -> CostScale | None:
    if "cost_scale" not in entries:
        return None
    if entries["cost_scale"].text() != "costmap2d":
        raise entries["cost_scale"].error("must be costmap2d")
    return "costmap2d"


def _view(entries: dict[str, Entry], mode: Mode) -> ViewScale | None:
    """Return what the values stand for, if they are the view of a distance field."""
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
    missing = [key for key in ViewScale.keys_of(view) if key not in entries]
    if missing:
        hint = f"a view {view} is described by {', '.join(ViewScale.keys_of(view))}"
        raise layer.error(f"needs key{'s' if len(missing) > 1 else ''} {', '.join(missing)}",
                          hint=hint)  # fmt: skip
    numbers = {key: _number(entries[key]) for key in ViewScale.keys_of(view)}
    try:
        return ViewScale(view, **numbers)
    except ParameterError as error:
        raise entries[str(error.place)].error(error.rule) from None


def _image(entry: Entry) -> str:
    text = entry.text()
    if not text.strip():
        raise entry.error("must name an image file")
    if "$(" in text:
        hint = "roslaunch expands it; write the path that it stands for"
        raise entry.error("must be a path", hint=hint)
    return text
