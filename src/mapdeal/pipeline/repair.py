"""Repairs of maps, in a copy or in their own files."""

from __future__ import annotations

import contextlib
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapdeal.checks.facts import PairFacts, gather
from mapdeal.checks.repair import repaired, yaml_repair
from mapdeal.errors import FileAccessError, MalformedInputError, MapdealError, kept_warnings
from mapdeal.formats.endings import YAML
from mapdeal.formats.map_server import image_places
from mapdeal.formats.map_writer import write_map_image
from mapdeal.formats.map_yaml import MapMetadata, metadata_of
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.source import (
    check_state,
    contents_of,
    exists,
    head_of,
    identity_of,
    is_same_file,
    real_path,
    state_of,
)
from mapdeal.formats.transaction import Transaction
from mapdeal.formats.yaml_text import edited, parse_mapping, read_mapping
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.files import errors_named, outputs_of
from mapdeal.pipeline.settings import Settings

ImageUsers = dict[Path, list[tuple[tuple[int, int], Path]]]
"""The images that the YAML files of a folder name, and those files: each folder is read once."""

_WRITTEN = (".pgm", ".png")
"""Formats of images that can be written as they were."""

_COPY = "mapdeal lint MAP --fix -o OUT writes a repaired copy"


def repair_file(path: Path, output: Path, options: Settings) -> list[str]:
    """Write a map without the traps that can be taken out of it; return what was changed."""
    outputs = output_paths(output)
    pair, cells, findings = gather(path, max_cells=options.max_cells)
    if cells is None:
        errors = (found.message for found in findings if found.severity == "error")
        rule = next(errors, "holds costs, which are not repaired")
        raise MalformedInputError(rule, source=path)
    inputs = [path, *([pair.path, pair.image_path] if pair is not None else [])]
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            grid, done = repaired(path, pair, max_cells=options.max_cells)
        write_grid(transaction, output, grid)
    if pair is not None:
        done += [found.message for found in findings if found.check == "yaml.nan-yaw"]
        done.append(f"image {outputs[0].name}, usual thresholds")
    return done


def repair_in_place(
    path: Path, wanted: Collection[str], settings: Settings, users: ImageUsers
) -> list[str]:
    """Repair a map in its own files; return what was changed, a line each."""
    # In the YAML file the values that are traps are replaced where they stand, so that comments,
    # order and other keys stay. The image is written only if the map is turned. It keeps its name
    # if it is a pgm or png of this map alone; else there is a new one, and the old one stays.
    states = {path: state_of(path)}  # before anything is read
    pair, cells, _ = gather(path, max_cells=settings.max_cells)
    if pair is None:
        return []
    repair = yaml_repair(pair, None if cells is None else cells.frame, wanted)
    if not repair:
        return []
    states[pair.image_path] = state_of(pair.image_path)
    values, done = dict(repair.values), list(repair.done)
    target = real_path(pair.path)
    outputs = [target]
    if repair.needs_cells:
        image, told = _image_for(pair, users)
        outputs.insert(0, image)
        done.append(told)
    with (
        use_threads(settings.threads),
        errors_named(pair.path),
        Transaction(outputs, force=True) as transaction,
    ):
        if repair.needs_cells:
            grid, told_of_cells = repaired(pair.path, pair, max_cells=settings.max_cells)
            done = [*told_of_cells, *done]
            new: dict[str, Any] = {
                "mode": write_map_image(transaction, image, grid),
                "resolution": grid.resolution,
                "origin": tuple(grid.origin),
                "negate": 0,
                "occupied_thresh": 0.65,
                "free_thresh": 0.196,
            }
            if image != real_path(pair.image_path):
                new["image"] = image.name
            values |= {key: one for key, one in new.items() if getattr(pair.metadata, key) != one}
        mark = head_of(pair.path, len(BOM_UTF8)) == BOM_UTF8
        data = (BOM_UTF8 if mark else b"") + edited(pair.entries, values)
        if _metadata_in(data, pair.path) != replace(pair.metadata, **values):
            rule = "its YAML is written in a way that cannot be edited"
            raise MalformedInputError(rule, source=pair.path, hint=_COPY)
        transaction.write_bytes(target, data)
        for one, state in states.items():
            check_state(one, state)
    return done


def _metadata_in(data: bytes, path: Path) -> MapMetadata | None:
    # warnings that stay are found again
    with kept_warnings(), contextlib.suppress(MalformedInputError):
        return metadata_of(parse_mapping(path, data), path)
    return None


def _image_for(pair: PairFacts, users: ImageUsers) -> tuple[Path, str]:
    """Return where the image of new cells goes, and what is said of that."""
    other = _other_user(pair, users)
    if other is None and pair.image_path.suffix in _WRITTEN:
        return real_path(pair.image_path), f"{pair.image_path.name} written anew"
    new = real_path(pair.path).with_suffix(".pgm")
    why = "whose format is only read" if other is None else f"which {other.name} also uses"
    if exists(new):
        rule = f"its image {pair.image_path.name}, {why}, would become {new.name}, which exists"
        raise FileAccessError(rule, source=pair.path, hint=_COPY)
    return new, f"{new.name} written beside {pair.image_path.name}, {why}"


def _other_user(pair: PairFacts, users: ImageUsers) -> Path | None:
    """Return a map beside the image, or beside this map, that uses the image, too."""
    identity = identity_of(pair.image_path)
    for folder in (pair.image_path.parent, pair.path.parent):
        if folder not in users:
            users[folder] = list(_images_of(folder))
        for named, path in users[folder]:
            if named == identity and not is_same_file(path, pair.path):
                return path
    return None


def _images_of(folder: Path) -> Iterator[tuple[tuple[int, int], Path]]:
    """Yield what images the YAML files in a folder name; who cannot be read names none."""
    try:
        _, names = contents_of(folder)
    except FileAccessError:
        return
    for path in (folder / name for name in names):
        if path.suffix.lower() not in YAML:
            continue
        with contextlib.suppress(MapdealError):
            entries = read_mapping(path)
            places = image_places(folder, entries["image"].text()) if "image" in entries else []
            if identity := next(filter(None, map(identity_of, places)), None):
                yield identity, path
