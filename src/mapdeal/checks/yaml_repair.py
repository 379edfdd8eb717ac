"""Repairs of a map's YAML file: other values in the places of those that are traps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from mapdeal.checks.facts import PairFacts
from mapdeal.checks.rounding import without_rounding_noise
from mapdeal.formats.map_remarks import USUAL_FREE_THRESH
from mapdeal.grid.frame import Frame
from mapdeal.grid.resample import is_turned
from mapdeal.records import dataclass

_NUMBERS = ("resolution", "origin", "occupied_thresh", "free_thresh")


@dataclass(frozen=True)
class YamlRepair:
    """Changes to make in a YAML file."""

    values: Mapping[str, Any]
    done: tuple[str, ...]
    needs_cells: bool = False

    def __bool__(self) -> bool:
        return bool(self.values) or self.needs_cells


def yaml_repair(
    pair: PairFacts, frame: Frame | None, wanted: Collection[str]
) -> YamlRepair:  # fmt: skip
    """Return what takes traps out of a map's YAML file."""
    metadata, entries = pair.metadata, pair.entries
    values: dict[str, Any] = {}
    if "yaml.defaults" in wanted:
        filled_in = {
            "negate": int(metadata.negate),
            "occupied_thresh": metadata.occupied_thresh,
            "free_thresh": metadata.free_thresh,
        }
        values |= {key: value for key, value in filled_in.items() if key not in entries}
    if "yaml.number-as-text" in wanted:
        values |= {key: getattr(metadata, key) for key in _NUMBERS if _has_text(pair, key)}
    if "thresholds.unknown-becomes-free" in wanted and metadata.free_thresh > USUAL_FREE_THRESH:
        values["free_thresh"] = USUAL_FREE_THRESH
    if "yaml.resolution-noise" in wanted:
        values["resolution"] = _plain(metadata.resolution)
    needs_cells = False
    x, y, yaw = metadata.origin
    if "yaml.origin-noise" in wanted:
        x, y, yaw = (_plain(value) for value in (x, y, yaw))
    if "yaml.origin-yaw" in wanted and frame is not None:
        needs_cells = is_turned(frame)
        yaw = yaw if needs_cells else 0.0
    if (x, y, yaw) != metadata.origin or "yaml.nan-yaw" in wanted:
        values["origin"] = (x, y, yaw)
    if {"yaml.mode-case", "yaml.legacy-mode"} & set(wanted):
        values["mode"] = metadata.mode
    image = _image_name(pair, wanted)
    if image is not None:
        values["image"] = image
    geometry = {"resolution", "origin"} if needs_cells else set()  # of new cells: not known yet
    done = tuple(f"{key} {_shown(value)}" for key, value in values.items() if key not in geometry)
    return YamlRepair(values, done, needs_cells)


def _has_text(pair: PairFacts, key: str) -> bool:
    """Return whether a number, or one of a list, is text to YAML 1.1."""
    if key not in pair.entries:
        return False
    entry = pair.entries[key]
    return any(one.is_yaml_1_1_text for one in (entry.items() if key == "origin" else [entry]))


def _plain(value: float) -> float:
    plain = without_rounding_noise(value)
    return value if plain is None else plain


def _image_name(pair: PairFacts, wanted: Collection[str]) -> str | None:
    """Return a relative name of an image that lies in the folder of its map, or below."""
    if "yaml.image-unquoted" in wanted:
        return pair.metadata.image
    if not {"image.absolute-path", "image.foreign-path"} & set(wanted):
        return None
    folder = pair.path.parent
    if folder not in pair.image_path.parents and folder != Path():
        return None
    if pair.image_path.is_absolute() and not folder.is_absolute():
        return None
    relative = pair.image_path.relative_to(folder)
    return None if ".." in relative.parts else relative.as_posix()


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(repr(one) for one in value)
    return str(value)
