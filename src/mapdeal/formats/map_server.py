"""A map_server pair, yaml and image: the place where rows are flipped."""

from __future__ import annotations

import os
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, emit_warning
from mapdeal.formats.dialects import cells_of
from mapdeal.formats.endings import YAML
from mapdeal.formats.image import open_strips
from mapdeal.formats.map_remarks import PixelRemarks
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture
from mapdeal.formats.pnm import BinaryRows
from mapdeal.formats.source import contents_of, exists, is_same_file, status_of, yaml_at
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.blocks import CacheBudget, Layer, lazy_layer


def read_cells(
    yaml_path: Path, metadata: MapMetadata, image_path: Path, *, dialect: Dialect = "nav2",
    max_cells: int | None = None,
) -> OccupancyGrid | Costmap:  # fmt: skip
    with open_strips(image_path, max_cells=max_cells) as strips:
        if metadata.cost_scale is not None:
            cost = np.empty(strips.shape, dtype=np.uint8)
            for rows, picture in strips.placed():
                cost[rows] = costs_of(picture, image_path)[::-1]
            return Costmap(cost, metadata.resolution, metadata.origin)
        occupancy = np.empty(strips.shape, dtype=np.int8)
        remarks = PixelRemarks(metadata, dialect)
        for rows, picture in strips.placed():
            cells_of(picture, metadata, dialect, out=occupancy[rows])
            remarks.add(picture, occupancy[rows])
    remarks.warn(yaml_path, image_path)
    return _grid_of(occupancy, metadata)


def lazy_cells(
    metadata: MapMetadata, pixels: BinaryRows, *, block_height: int,
    budget: CacheBudget | None = None, dialect: Dialect = "nav2",
) -> OccupancyGrid:  # fmt: skip
    """Return the map in an image whose rows are read when they are asked for."""
    # It gives, cell by cell, what `read_cells` gives.

    def occupancy(rows: slice) -> NDArray[np.int8]:
        part = pixels.part(rows)
        cells = np.empty(part.shape, dtype=np.int8)
        for where, picture in part.placed():
            cells_of(picture, metadata, dialect, out=cells[where])
        return cells

    layer = lazy_layer(
        pixels.shape, np.int8, occupancy, block_height=block_height, budget=budget
    )  # fmt: skip
    return _grid_of(layer, metadata)


def check_rows(
    yaml_path: Path, metadata: MapMetadata, pixels: BinaryRows, dialect: Dialect = "nav2"
) -> None:
    """Go through an image that is read by rows for pixels that `read_cells` warns of."""
    remarks = PixelRemarks(metadata, dialect)
    for _, picture in pixels.strips().placed():
        if not remarks.are_possible(picture):
            break
        remarks.add(picture, cells_of(picture, metadata, dialect))
    remarks.warn(yaml_path, pixels.image)


def _grid_of(occupancy: Layer, metadata: MapMetadata) -> OccupancyGrid:
    """Return the map of some values, or the view of a field if the YAML file calls them one."""
    if metadata.view is not None:
        return FieldView(occupancy, metadata.resolution, metadata.origin, metadata.view)
    return OccupancyGrid(occupancy, metadata.resolution, metadata.origin)


def find_image(yaml_path: Path, image: str) -> Path:
    """Return the image file that a map's YAML names."""
    # Relative names are relative to the YAML file. A name that only makes sense elsewhere, an
    # absolute path of another machine or one with backslashes, falls back to what it must mean
    # here, with a warning.
    if _expanded(image) != image:
        _warn_path(yaml_path, f"{image} was expanded; map_server does not")
    path, *others = image_places(yaml_path.parent, image)
    if exists(path):
        return path
    for other in others:
        if exists(other):
            _warn_path(yaml_path, f"{image} does not exist here; using {other}")
            return other
    hint = _nearest_name(path)
    raise FileAccessError(
        "the image does not exist", source=yaml_path, place="image", got=image, hint=hint
    )


def yaml_beside(path: Path) -> Path:
    """Return the YAML file beside a ``.pbm``."""
    found = yaml_at(path)
    if found is None:
        status_of(path)
        rule = f"has no {path.with_suffix('.yaml').name} beside it, which gives its place"
        hint = "a bit map is two files, as mapdeal pack writes them"
        raise FileAccessError(rule, source=path, hint=hint)
    return found


def find_bits(path: Path, yaml_path: Path, metadata: MapMetadata) -> Path:
    """Return the image that the YAML file beside a ``.pbm`` names, which must be that one."""
    status_of(path)
    image = find_image(yaml_path, metadata.image)
    if not is_same_file(image, path):
        rule = f"names another image than {path.name}"
        raise MalformedInputError(rule, source=yaml_path, place="image", got=metadata.image)
    return image


def image_places(folder: Path, image: str) -> list[Path]:
    """Return where the image may be that a YAML file in a folder names: the first there counts."""
    name = _expanded(image)
    path = folder / name
    places = [path]
    if "\\" in image:
        places.append(folder / image.replace("\\", "/"))
    if path.is_absolute() and not name.startswith(str(folder)):
        places.append(folder / path.name)
    windows_path = PureWindowsPath(image)
    if windows_path.is_absolute():
        places.append(folder / windows_path.name)
    return places


def _expanded(image: str) -> str:
    """Return the name with a leading ``~`` replaced by the home folder, if there is one."""
    try:
        return os.path.expanduser(image) if image.startswith("~") else image  # noqa: PTH111
    except ValueError:
        return image


def _warn_path(yaml_path: Path, text: str) -> None:
    warning = MapdealWarning(f"{yaml_path}: image: {text}", "image.foreign-path")
    emit_warning(warning, stacklevel=3)


def _nearest_name(path: Path) -> str | None:
    """Return a hint that names the files most like `path`, other case or ending included."""
    try:
        names = contents_of(path.parent)[1]
    except FileAccessError:
        return None
    import difflib

    images = [n for n in names if n != path.name and not n.endswith(YAML)]
    lower = {n.lower(): n for n in images}
    near = [n for n in images if Path(n).stem.lower() == path.stem.lower()]
    near += [
        lower[n] for n in difflib.get_close_matches(path.name.lower(), lower, n=3, cutoff=0.75)
    ]
    unique = list(dict.fromkeys(near))
    return f"the folder has {', '.join(unique)}" if unique else None


def costs_of(picture: Picture, path: Path) -> NDArray[np.uint8]:
    """Return the costs in a picture, row 0 in the north."""
    if picture.colour != "grey" or picture.maxval != 255 or picture.alpha is not None:
        rule = "an image of costs must have one 8-bit grey channel"
        raise MalformedInputError(rule, source=path, got=picture.colour)
    return picture.samples.astype(np.uint8, copy=False)
