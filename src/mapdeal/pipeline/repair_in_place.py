"""Repairs of maps in their own files: no more is written than has to be."""

from __future__ import annotations

import contextlib
from codecs import BOM_UTF8
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from mapdeal.checks.facts import PairFacts, gather
from mapdeal.checks.repair import repaired
from mapdeal.checks.yaml_repair import yaml_repair
from mapdeal.errors import FileAccessError, MalformedInputError, kept_warnings
from mapdeal.formats.image_users import ImageUsers
from mapdeal.formats.map_writer import write_map_image
from mapdeal.formats.map_yaml import MapMetadata, metadata_of
from mapdeal.formats.source import check_state, exists, head_of, real_path, state_of
from mapdeal.formats.transaction import Transaction
from mapdeal.formats.yaml_text import edited, parse_mapping
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import errors_named
from mapdeal.pipeline.settings import Settings

_WRITTEN = (".pgm", ".png")
"""Formats of images that can be written as they were."""

_COPY = "mapdeal lint MAP --fix -o OUT writes a repaired copy"


def repair_in_place(
    path: Path, wanted: Collection[str], settings: Settings, users: ImageUsers
) -> list[str]:
    """Repair a map in its own files; return what was changed, a line each.

    Notes
    -----
    In the YAML file the values that are traps are replaced where they stand, so that comments,
    order and other keys stay. The image is written only if the map is turned. It keeps its name
    if it is a pgm or png of this map alone; else there is a new one, and the old one stays.
    """
    states = {path: state_of(path)}  # before anything is read
    pair, cells, _ = gather(path, max_cells=settings.max_cells)
    if pair is None:
        return []
    repair = yaml_repair(pair, None if cells is None else cells.frame, wanted)
    if not repair:
        return []
    states[pair.image_path] = state_of(pair.image_path)
    values, done = dict(repair.values), list(repair.done)
    image: Path | None = None
    if repair.needs_cells:
        image, told = _image_for(pair, users)
        done.append(told)
    target = real_path(pair.path)
    outputs = [target] if image is None else [image, target]
    with (
        use_threads(settings.threads),
        errors_named(pair.path),
        Transaction(outputs, force=True) as transaction,
    ):
        if image is not None:
            more, told_of_cells = _write_cells(transaction, image, pair, settings)
            values |= more
            done = [*told_of_cells, *done]
        mark = head_of(pair.path, len(BOM_UTF8)) == BOM_UTF8
        data = (BOM_UTF8 if mark else b"") + edited(pair.entries, values)
        _check(pair, data, values)
        transaction.write_bytes(target, data)
        for one, state in states.items():
            check_state(one, state)
    return done


def _image_for(pair: PairFacts, users: ImageUsers) -> tuple[Path, str]:
    """Return where the image of new cells goes, and what is said of that."""
    others = users.others(pair.image_path, pair.path)
    if not others and pair.image_path.suffix in _WRITTEN:
        return real_path(pair.image_path), f"{pair.image_path.name} written anew"
    new = real_path(pair.path).with_suffix(".pgm")
    why = f"which {others[0].name} also uses" if others else "whose format is only read"
    if exists(new):
        rule = f"its image {pair.image_path.name}, {why}, would become {new.name}, which exists"
        raise FileAccessError(rule, source=pair.path, hint=_COPY)
    return new, f"{new.name} written beside {pair.image_path.name}, {why}"


def _write_cells(
    transaction: Transaction, image: Path, pair: PairFacts, settings: Settings
) -> tuple[dict[str, Any], list[str]]:
    """Write the cells of a turned map along the axes; return what its YAML file has to say."""
    grid, done = repaired(pair.path, pair, max_cells=settings.max_cells)
    mode = write_map_image(transaction, image, grid)
    values: dict[str, Any] = {
        "mode": mode,
        "resolution": grid.resolution,
        "origin": tuple(grid.origin),
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    if image != real_path(pair.image_path):
        values["image"] = image.name
    changed = {key: new for key, new in values.items() if getattr(pair.metadata, key) != new}
    return changed, done


def _check(pair: PairFacts, data: bytes, values: Mapping[str, Any]) -> None:
    """Raise MalformedInputError if an edited YAML file does not state what it is meant to."""
    found: MapMetadata | None = None
    # warnings that stay are found again
    with kept_warnings(), contextlib.suppress(MalformedInputError):
        found = metadata_of(parse_mapping(pair.path, data), pair.path)
    if found is None or not _says(found, pair.metadata, values):
        rule = "its YAML is written in a way that cannot be edited"
        raise MalformedInputError(rule, source=pair.path, hint=_COPY)


def _says(found: MapMetadata, before: MapMetadata, values: Mapping[str, Any]) -> bool:
    return all(
        getattr(found, name) == values.get(name, getattr(before, name))
        for name in ("image", "resolution", "origin", "mode", "negate", "occupied_thresh",
                     "free_thresh", "cost_scale", "view", "extra")
    )  # fmt: skip
