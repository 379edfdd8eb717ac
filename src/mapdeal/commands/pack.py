"""``mapdeal pack`` and ``mapdeal unpack``: maps in one bit a cell, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from mapdeal.command import LethalThreshold, Output, Result, Words, command
from mapdeal.errors import ParameterError, emit_warning, one_line
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.framed import Figures
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.maps.map_server import Encoding, bit_map_paths, read_bit_map_pair, write_bit_map_pair
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pipeline.folder import files_of, summary_of, written_line
from mapdeal.pipeline.inputs import Map, Work, claim_cells, claim_work, opened

PER_CELL = 3.0
"""Bytes for each cell of a bit map: a mask, the cells, and what is written."""


@dataclass(frozen=True, eq=False, repr=False)
class Made(Result):
    """A grid or bit map to be written, with further keys for the YAML."""

    grid: Grid | BitMap
    title: str
    extra: Mapping[str, Any] = field(default_factory=dict)
    encoding: Encoding = "occupancy"

    def document(self) -> Figures:
        """Return the figures of the grid."""
        return self.grid.figures()

    def lines(self) -> Iterator[str]:
        """Yield what the grid holds."""
        yield summary_of(self.document())

    def summary(self, output: Path) -> Iterator[str]:
        """Yield what commands print of a grid that they have written."""
        yield written_line(output, self.document())

    def drawn(self, **look: Any) -> Image:
        """Return the picture of the grid."""
        grid = self.grid.to_occupancy() if isinstance(self.grid, BitMap) else self.grid
        draw = files_of(type(grid)).draw
        return draw(grid, title=one_line(self.title), overlay=None, **look)

    def write(self, transaction: Any, output: Path) -> None:
        """Write a bit map and its YAML, or a map as the ending says."""
        if isinstance(self.grid, BitMap):
            write_bit_map_pair(transaction, output, self.grid, extra=self.extra)
        else:
            extra = dict(self.extra)
            write_grid(transaction, output, self.grid, encoding=self.encoding, extra=extra)


def read_bits(
    path: Path, work: Work, *, also: Sequence[Path] = ()
) -> tuple[BitMap, Mapping[str, Any]]:  # fmt: skip
    """Return a bit map, if it can be worked on, and the keys of its YAML that nobody knows."""
    with work.settings.memory():
        bits, metadata, files = read_bit_map_pair(path, max_cells=work.settings.max_cells)
        claim_work(path, bits, PER_CELL)
    work.begin([*files, *also])
    return bits, metadata.extra


@command(
    group="Drawing and packing",
    output=Output(
        "OUT.pbm",
        "Bit map to write, with its .yaml.",
        streams=False,
        paths=lambda path: list(bit_map_paths(path)),
    ),
    json="never",
    example="mapdeal pack examples/maps/office.yaml -o out/office.pbm",
)
def pack(source: Map, *, lethal_threshold: LethalThreshold | None = None) -> Made:
    """Write the obstacles of a map as a bit map (PBM P4).

    Parameters
    ----------
    source : path, str or grid
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal. Of a field, the
        obstacles are the cells that it counts as such.
    lethal_threshold : int, optional
        Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.

    Warns
    -----
    MapdealWarning
        If there are unknown cells, which are free in a bit map.
    """
    (read,) = opened(source, names=("map",))
    claim_cells(read, PER_CELL)
    if isinstance(read.grid, (DistanceField, PotentialField)):
        if lethal_threshold is not None:
            rule = "a field has its own"
            raise ParameterError(rule, source=read.name, place="lethal_threshold")
        field, obstacles = read.grid, read.grid.obstacles()
        bits = BitMap.from_mask(obstacles, field.resolution, field.origin)
        values = np.where(obstacles, np.int8(0), field.occupancy)
    else:
        values = read.occupancy.occupancy
        bits = BitMap.from_occupancy(read.occupancy, lethal_threshold or DEFAULT_LETHAL_THRESHOLD)
    lost = int(histogram(values)[UNKNOWN])
    if lost:
        emit_warning(f"{read.name}: {lost} unknown cells are free in a bit map", stacklevel=2)
    return Made(bits, f"{read.title}: bit map")


@command(
    group="Drawing and packing",
    output=Output(
        "OUT",
        "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz.",
        paths=lambda path: list(output_paths(path)),
    ),
    shared=("image", "max_cells", "force", "threads", "max_memory"),
    json="never",
    example="""\
mapdeal pack examples/maps/office.yaml -o out/office.pbm
mapdeal unpack out/office.pbm -o out/unpacked.yaml""",
)
def unpack(source: Annotated[Path, Words("IN.pbm")]) -> Made:
    """Convert a bit map to an ordinary map: 1 is occupied, 0 free.

    Parameters
    ----------
    source : path
        A bit map, with its .yaml in the same folder.
    """
    bits, extra = read_bits(source, Work.in_shell())
    return Made(bits.to_occupancy(), source.stem, extra)
