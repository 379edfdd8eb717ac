"""Traps taken out of a map: out of its cells, or out of its YAML file alone."""

from __future__ import annotations

import contextlib
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.checks.facts import PairFacts, gather, without_rounding_noise
from mapdeal.errors import FileAccessError, MalformedInputError, MapdealError, kept_warnings
from mapdeal.files.budget import PIECES, claim
from mapdeal.files.source import (
    YAML,
    check_state,
    contents_of,
    exists,
    head_of,
    identity_of,
    is_same_file,
    real_path,
    state_of,
)
from mapdeal.files.transaction import Transaction
from mapdeal.files.yaml_text import edited, parse_mapping, read_mapping
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import is_turned, resampled
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.dialects import cells_of
from mapdeal.maps.images import open_strips
from mapdeal.maps.map_server import image_places, write_map_image
from mapdeal.maps.map_yaml import Dialect, MapMetadata, metadata_of
from mapdeal.maps.npz import read_npz
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.maps.remarks import USUAL_FREE_THRESH, FreedCells, remark_on_freed
from mapdeal.pipeline.inputs import errors_named, outputs_of
from mapdeal.pipeline.settings import Settings

_COSTS = "holds costs, which are not repaired"

_NUMBERS = ("resolution", "origin", "occupied_thresh", "free_thresh")

_PER_CELL = 3
"""Bytes: the cells, and what they become while they are written."""

_PER_CELL_OF_TURNED, _PER_NEW_CELL = 5, 3
"""Bytes, of a turned map that is resampled and of the new one."""


def repaired(
    path: Path, pair: PairFacts | None, *, max_cells: int | None = None
) -> tuple[OccupancyGrid, list[str]]:
    """Return a map as it should be, and what was changed, a line each."""
    done: list[str] = []
    with kept_warnings():  # all was told when it was read first
        grid = _read_again(path, pair, max_cells, done)
    claim(path, _PER_CELL * grid.occupancy.size)
    resolution = without_rounding_noise(grid.resolution) or grid.resolution
    x, y, yaw = (without_rounding_noise(value) or value for value in grid.origin)
    if (resolution, (x, y, yaw)) != (grid.resolution, grid.origin):
        done.append(f"resolution {resolution!r}, origin {x!r}, {y!r}, {yaw!r} without noise")
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, yaw))
    if is_turned(grid.frame):
        done.append(f"yaw {yaw:g} rad is in the cells now")
        grid = _without_yaw(grid, path)
    elif yaw:
        grid = OccupancyGrid(grid.occupancy, resolution, (x, y, 0.0))
    return grid, done


def _read_again(
    path: Path, pair: PairFacts | None, max_cells: int | None, done: list[str]
) -> OccupancyGrid:
    if pair is not None:
        return _map_of_pair(pair, max_cells, done)
    grid = read_npz(path, max_cells=max_cells)
    if isinstance(grid, Costmap):
        raise MalformedInputError(_COSTS, source=path)
    return grid if isinstance(grid, OccupancyGrid) else grid.grid


def _map_of_pair(pair: PairFacts, max_cells: int | None, done: list[str]) -> OccupancyGrid:
    """Read a map again, with a lower free_thresh if map_saver's unknown is free."""
    if pair.metadata.cost_scale is not None:
        raise MalformedInputError(_COSTS, source=pair.path)
    given = mended = pair.metadata
    freed: dict[Dialect, FreedCells] = {"nav2": pair.pixels.freed["nav2"]}
    if remark_on_freed(freed, pair.pixels.size, given) is not None:
        mended = replace(given, free_thresh=min(USUAL_FREE_THRESH, given.free_thresh))
    changed = 0
    with open_strips(pair.image_path, max_cells=max_cells) as strips:
        occupancy = np.empty(strips.shape, dtype=np.int8)
        for rows, picture in strips.placed():
            cells_of(picture, mended, "nav2", out=occupancy[rows])
            if mended is not given:
                before = cells_of(picture, given, "nav2")
                changed += int(np.count_nonzero(before != occupancy[rows]))
    if changed:
        cells = "1 cell is" if changed == 1 else f"{changed} cells are"
        done.append(f"{cells} now unknown instead of free: map_saver's grey for unknown")
    return OccupancyGrid(occupancy, given.resolution, given.origin)


def _without_yaw(grid: OccupancyGrid, path: Path) -> OccupancyGrid:
    """Return a map on a lattice along the axes, with every obstacle of the turned one."""
    lattice = Frame(1, 1, grid.resolution)
    region = region_around(lattice, grid.frame)
    cells = _PER_CELL_OF_TURNED * grid.occupancy.size + _PER_NEW_CELL * region.cells
    claim(path, cells + PIECES)
    return resampled(grid, region.frame_in(lattice))


@dataclass(frozen=True)
class YamlRepair:
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


ImageUsers = dict[Path, list[tuple[tuple[int, int], Path]]]
"""The images that the YAML files of a folder name, and those files: each folder is read once."""

_WRITTEN = (".pgm", ".png")
"""Formats of images that can be written as they were."""

_COPY = "mapdeal lint MAP --fix -o OUT writes a repaired copy"


def repair_copy(path: Path, output: Path, settings: Settings) -> list[str]:
    """Write a map without the traps that can be taken out of it; return what was changed."""
    outputs = output_paths(output)
    pair, cells, findings = gather(path, max_cells=settings.max_cells)
    if cells is None:
        errors = (found.message for found in findings if found.severity == "error")
        rule = next(errors, "holds costs, which are not repaired")
        raise MalformedInputError(rule, source=path)
    inputs = [path, *([pair.path, pair.image_path] if pair is not None else [])]
    with outputs_of(outputs, inputs, settings) as transaction:
        with errors_named(path):
            grid, done = repaired(path, pair, max_cells=settings.max_cells)
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
