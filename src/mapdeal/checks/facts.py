"""What checks look at: a map's files, read once, for all readers."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.finding import CHECKS, Finding
from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning
from mapdeal.formats.bit_map_names import BIT_MAP, find_bits, yaml_beside
from mapdeal.formats.budget import claim
from mapdeal.formats.dialects import DIALECTS, cells_of
from mapdeal.formats.image import read_image
from mapdeal.formats.images.catalogue import IMAGE_FORMATS
from mapdeal.formats.kinds import MAP, recognised
from mapdeal.formats.map_remarks import count_of_lost, remark_on_lost
from mapdeal.formats.map_server import find_image
from mapdeal.formats.map_yaml import Dialect, MapMetadata, metadata_of
from mapdeal.formats.npz import read_npz
from mapdeal.formats.picture import Picture
from mapdeal.formats.source import head_of
from mapdeal.formats.yaml_text import Entry, read_mapping
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED

MAP_SAVER_UNKNOWN = 205
"""The grey that map_saver writes for unknown cells."""

_HEAD = 1 << 16
_PER_CELL, _PER_CELL_OF_COLOURS = 20, 44
"""Bytes for each cell that what is read and its checks take."""


@dataclass(frozen=True, eq=False)
class GridFacts:
    """The cells of a map, of whatever file.

    Parameters
    ----------
    grid : OccupancyGrid
        As dialect nav2 reads it.
    """

    grid: OccupancyGrid

    @property
    def frame(self) -> Frame:
        """Its geometry."""
        return self.grid.frame

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many cells there are of each kind."""
        return counts_of(self.grid.occupancy)


@dataclass(frozen=True, eq=False)
class PairFacts:
    """A map_server pair.

    Parameters
    ----------
    path : Path
        The YAML file.
    entries : dict of str to Entry
        Its keys.
    metadata : MapMetadata
        What they mean.
    image_path : Path
        The image.
    picture : Picture
        Its pixels, row 0 in the north.
    readings : dict of str to numpy.ndarray
        The occupancy, row 0 in the south, as each reader has it; none of a costmap.
    comments : list of str
        Those in the header of the image.
    """

    path: Path
    entries: dict[str, Entry]
    metadata: MapMetadata
    image_path: Path
    picture: Picture
    readings: dict[Dialect, NDArray[np.int8]] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)

    @cached_property
    def greys(self) -> dict[int, int]:
        """How many pixels there are of each grey, of 8-bit grey images; else empty."""
        if self.picture.colour != "grey" or self.picture.maxval != 255:
            return {}
        counts = np.bincount(self.picture.samples.reshape(-1), minlength=256)
        return {grey: int(counts[grey]) for grey in np.flatnonzero(counts).tolist()}


def counts_of(occupancy: NDArray[np.int8]) -> dict[str, int]:
    """Return how many cells are occupied, free, unknown and between."""
    occupied, free = (int(np.count_nonzero(occupancy == v)) for v in (OCCUPIED, 0))
    unknown = int(np.count_nonzero(occupancy < 0))
    between = occupancy.size - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}


def gather(
    path: Path, *, max_cells: int | None = None
) -> tuple[PairFacts | None, GridFacts | None, list[Finding]]:
    """Return what there is to check of a file, and what was found while it was read.

    Parameters
    ----------
    path : Path
        A map_server YAML, a ``.pbm`` beside its YAML, or an npz.
    max_cells : int, optional
        Cells up to which an image is read.

    Returns
    -------
    pair : PairFacts or None
        Of a YAML that could be read.
    cells : GridFacts or None
        Of any map that could be read; None for costs.
    findings : list of Finding
        Warnings and errors of the readers.
    """
    findings: list[Finding] = []
    pair: PairFacts | None = None
    cells: GridFacts | None = None
    try:
        bits = path if path.suffix.lower() == BIT_MAP else None
        path = path if bits is None else yaml_beside(bits)
        with _warnings_as_findings(findings, path):
            if path.suffix.lower() == ".npz":
                grid = read_npz(path, max_cells=max_cells)
                claim(path, sum(getattr(grid, name).nbytes for name in grid.layer_names)
                      + _PER_CELL * grid.shape[0] * grid.shape[1])  # fmt: skip
                if not isinstance(grid, Costmap):
                    own = grid if isinstance(grid, OccupancyGrid) else grid.grid
                    cells = GridFacts(own)
            else:
                pair = _read_pair(path, max_cells, bits)
                if pair.readings:
                    own = OccupancyGrid(
                        pair.readings["nav2"], pair.metadata.resolution, pair.metadata.origin
                    )
                    cells = GridFacts(own)
    except (FileAccessError, MalformedInputError) as error:
        name = "file.access" if isinstance(error, FileAccessError) else "file.malformed"
        text = str(error) + (f" ({error.hint})" if error.hint else "")
        findings.append(_finding(name, path, text.removeprefix(f"{path}: ")))
    return pair, cells, findings


def _per_cell(picture: Picture) -> int:
    is_wide = picture.colour == "rgb" or picture.maxval > 255 or picture.alpha is not None
    return _PER_CELL_OF_COLOURS if is_wide else _PER_CELL


def _read_pair(path: Path, max_cells: int | None, bits: Path | None) -> PairFacts:
    """Return the facts of a YAML file, which must name the bit map that was asked for, if any."""
    with recognised(path, "a map", MAP):
        entries = read_mapping(path)
        metadata = metadata_of(entries, path, mend=True)
    image_path = (
        find_image(path, metadata.image) if bits is None else find_bits(bits, path, metadata)
    )
    picture = read_image(image_path, max_cells=max_cells)
    comments = IMAGE_FORMATS[picture.file_format].comments(head_of(image_path, _HEAD))
    height, width = picture.shape
    claim(path, picture.samples.nbytes + _per_cell(picture) * height * width)
    readings: dict[Dialect, NDArray[np.int8]] = {}
    if metadata.cost_scale is None:
        lost = count_of_lost(picture) if metadata.mode == "raw" else 0
        if lost:
            text = f"{image_path}: {remark_on_lost(lost)}"
            warnings.warn(MapdealWarning(text, "image.raw-values"), stacklevel=2)
        readings = {dialect: cells_of(picture, metadata, dialect) for dialect in DIALECTS}
    return PairFacts(path, entries, metadata, image_path, picture, readings, comments)


@contextmanager
def _warnings_as_findings(findings: list[Finding], path: Path) -> Iterator[None]:
    """Turn mapdeal's warnings in the block into findings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MapdealWarning)
        try:
            yield
        finally:
            for one in caught:
                name = getattr(one.message, "check", None)
                if name is None:
                    raise TypeError(f"a warning of the readers has no check: {one.message}")
                findings.append(_finding(name, path, str(one.message).removeprefix(f"{path}: ")))


def _finding(name: str, path: Path, text: str) -> Finding:
    return Finding(name, CHECKS[name].severity, str(path), text)
