"""``mapdeal pack``: maps in one bit a cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.command import LethalThreshold, Output, Result, command
from mapdeal.errors import ParameterError, emit_warning, one_line
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.field import DistanceField, PotentialField
from mapdeal.grid.frame import Figures
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.maps import npz, reading
from mapdeal.maps.map_server import Encoding, bit_map_paths, read_bit_map_pair, write_bit_map_pair
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.overlay import Overlay
from mapdeal.pipeline import folder, inputs
from mapdeal.records import dataclass, field

PER_CELL = 3.0  # bytes for each cell of a bit map: mask, cells and output


@dataclass(frozen=True, eq=False, repr=False)
class GridResult(Result):
    """A grid or bit map to write, with further keys of its YAML and the scale of its values."""

    grid: npz.Grid | BitMap
    title: str
    extra: Mapping[str, Any] = field(default_factory=dict)
    encoding: Encoding = "occupancy"
    overlay: Overlay | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)  # besides those of the grid
    notes: Sequence[str] = ()  # lines on what the grid was made of

    def document(self) -> Figures:
        return {**self.grid.figures(), **self.figures}

    def lines(self) -> Iterator[str]:
        yield from (folder.summary_of(self.document()), *self.notes)

    def summary(self, output: Path) -> Iterator[str]:
        yield folder.written_line(output, self.document(), with_origin=bool(self.notes))
        yield from self.notes

    def drawn(self, **look: Any) -> Image:
        grid = self.grid.to_occupancy() if isinstance(self.grid, BitMap) else self.grid
        title = one_line(self.title)
        return folder.files_of(type(grid)).draw(grid, title=title, overlay=self.overlay, **look)

    def write(self, transaction: Any, output: Path) -> None:
        extra = dict(self.extra)
        if isinstance(self.grid, BitMap):
            write_bit_map_pair(transaction, output, self.grid, extra=extra)
        else:
            reading.write_grid(transaction, output, self.grid, encoding=self.encoding, extra=extra)


def read_bits(
    path: Path, work: inputs.Work, *, also: Sequence[Path] = ()
) -> tuple[BitMap, Mapping[str, Any]]:  # fmt: skip
    with work.settings.reading():
        bits, metadata, files = read_bit_map_pair(path, max_cells=work.settings.max_cells)
        inputs.claim_work(path, bits, PER_CELL)
    work.begin([*files, *also])
    return bits, metadata.extra


@command(
    group="Formats",
    output=Output(
        "OUT.pbm", "Bit map to write, with its .yaml.", streams=False, paths=bit_map_paths,
    ),
    example="mapdeal pack examples/maps/office.yaml -o out/office.pbm",
)  # fmt: skip
def pack(source: inputs.Map, *, lethal_threshold: LethalThreshold | None = None) -> GridResult:
    """Write the obstacles of a map as a bit map (PBM P4).

    Parameters
    ----------
    source : path, str or grid
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal. Of a field, the
        obstacles are the cells that it counts as such.
    lethal_threshold : int, optional
        Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.
    """
    (read,) = inputs.open_inputs(source, names=("map",))
    inputs.claim_cells(read, PER_CELL)
    if isinstance(read.grid, (DistanceField, PotentialField)):
        if lethal_threshold is not None:
            raise ParameterError("a field has its own", source=read.name, place="lethal_threshold")
        obstacles = read.grid.obstacles()
        bits = BitMap.from_mask(obstacles, read.grid.resolution, read.grid.origin)
        values = np.where(obstacles, np.int8(0), read.grid.occupancy)
    else:
        values = read.occupancy.occupancy
        bits = BitMap.from_occupancy(read.occupancy, lethal_threshold or DEFAULT_LETHAL_THRESHOLD)
    lost = int(histogram(values)[UNKNOWN])
    if lost:
        emit_warning(f"{read.name}: {lost} unknown cells are free in a bit map")
    return GridResult(bits, f"{read.title}: bit map")
