"""Maps into bit maps and back, file to file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.source import BIT_MAP
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.framed import Figures
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.map_server import bit_map_paths, read_bit_map_pair, write_bit_map_pair
from mapdeal.maps.reading import as_occupancy, output_paths, write_grid
from mapdeal.pipeline.inputs import add_picture, claim_work, errors_named, outputs_of, read_input
from mapdeal.pipeline.settings import Settings

_PER_CELL = 3.0
"""Bytes for each cell: a mask, the cells, and what is written."""


@dataclass(frozen=True, eq=False)
class OccupancyBits(BitMap):
    """A bit map that is drawn on with values of a map: 0 free, 100 occupied."""

    def accept_value(self, value: float, name: str = "value") -> int:
        """Return `value`, which must be 0 or 100."""
        if value not in (FREE, OCCUPIED):
            rule = f"must be {FREE} or {OCCUPIED}: cells of a bit map are free or occupied"
            hint = "write to a .yaml or .npz for other values"
            raise ParameterError(rule, place=name, got=value, hint=hint)
        return int(value)


def edit_bits(
    path: Path,
    output: Path,
    options: Settings,
    change: Callable[[OccupancyBits], OccupancyBits],
    *,
    what: str,
    inputs: Sequence[Path] = (),
) -> Figures:
    """Read a bit map, change it, and write it as one, as `edit_file` does; return its figures."""
    outputs = bit_map_paths(output)
    if path.suffix.lower() != BIT_MAP:
        rule = "only an edited .pbm can be written as one"
        raise ParameterError(rule, source=output, hint="mapdeal pack makes a bit map of a map")
    with options.memory(), use_threads(options.threads):
        found, metadata, files = read_bit_map_pair(path, max_cells=options.max_cells)
        claim_work(path, found, _PER_CELL)
    bits = OccupancyBits(found.packed, found.width, found.resolution, found.origin)
    with outputs_of(outputs, [*files, *inputs], options) as transaction:
        with errors_named(path):
            bits = change(bits)
        write_bit_map_pair(transaction, output, bits, extra=metadata.extra)
        if options.image is not None:
            add_picture(transaction, options, bits.to_occupancy(), f"{path.stem}: {what}")
    return bits.figures()


def pack_file(
    path: Path, output: Path, options: Settings, *, lethal_threshold: int | None = None
) -> Figures:
    """Write the obstacles of a map as a bit map; return its figures."""
    # Of a field those are the cells that it counts as obstacles.
    outputs = bit_map_paths(output)
    source = read_input(path, options, _PER_CELL)
    with outputs_of(outputs, source.files, options) as transaction:
        if isinstance(source.grid, (DistanceField, PotentialField)):
            if lethal_threshold is not None:
                rule = "a field has its own"
                raise ParameterError(rule, source=path, place="lethal_threshold")
            field, obstacles = source.grid, source.grid.obstacles()
            bits = BitMap.from_mask(obstacles, field.resolution, field.origin)
            values = np.where(obstacles, np.int8(0), field.occupancy)
        else:
            grid = as_occupancy(source.grid, path)
            bits = BitMap.from_occupancy(grid, lethal_threshold or DEFAULT_LETHAL_THRESHOLD)
            values = grid.occupancy
        lost = int(histogram(values)[UNKNOWN])
        if lost:
            text = f"{path}: {lost} unknown cells are free in a bit map"
            emit_warning(text, stacklevel=2)
        write_bit_map_pair(transaction, output, bits)
        if options.image is not None:
            add_picture(transaction, options, bits.to_occupancy(), f"{path.stem}: bit map")
    return bits.figures()


def unpack_file(path: Path, output: Path, options: Settings) -> Figures:
    """Write a bit map as a map; return its figures."""
    outputs = output_paths(output)
    with options.memory():
        bits, metadata, files = read_bit_map_pair(path, max_cells=options.max_cells)
        claim_work(path, bits, _PER_CELL)
    with outputs_of(outputs, files, options) as transaction:
        grid = bits.to_occupancy()
        write_grid(transaction, output, grid, extra=dict(metadata.extra))
        add_picture(transaction, options, grid, path.stem)
    return grid.figures()
