"""Bit maps on disk: a PBM file, P4, and a map_server YAML beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.budget import use_memory
from mapdeal.formats.endings import BIT_MAP, YAML
from mapdeal.formats.map_server import find_bits, yaml_beside
from mapdeal.formats.map_yaml import MapMetadata, read_metadata, yaml_of
from mapdeal.formats.picture import LARGEST_CELLS
from mapdeal.formats.pnm import decode_pbm, write_pbm
from mapdeal.formats.source import read_file
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.bit_map import BitMap


def read_bit_map(
    path: Path | str, *, max_cells: int | None = None, max_memory: int | None = None
) -> BitMap:
    """Read a bit map without expanding it to one byte per cell.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file with its ``.yaml`` next to it.
    max_cells : int, optional
        Largest number of cells to read, 1e9 by default.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    BitMap
        Black pixels are obstacles, 1; with ``negate: 1`` in the YAML file, white ones are.

    Raises
    ------
    FileAccessError
        If one of the files cannot be read.
    MalformedInputError
        If one of the files is malformed, or they do not belong together.
    """
    with use_memory(max_memory):
        return read_bit_map_pair(Path(path), max_cells=max_cells)[0]


def read_bit_map_pair(
    path: Path, *, max_cells: int | None = None
) -> tuple[BitMap, MapMetadata, tuple[Path, Path]]:
    """Return a bit map, what its YAML says, and the files it came from, see `read_bit_map`."""
    if path.suffix.lower() != BIT_MAP:
        rule = "a bit map must be a .pbm"
        hint = "pass the .pbm that the YAML names" if path.suffix in YAML else None
        raise ParameterError(rule, source=path, got=path.suffix, hint=hint)
    yaml_path = yaml_beside(path)
    metadata = read_metadata(yaml_path)
    find_bits(path, yaml_path, metadata)
    if metadata.cost_scale is not None:
        rule = "a bit map cannot hold costs"
        raise MalformedInputError(rule, source=yaml_path, place="cost_scale")
    if metadata.mode == "raw":
        rule = "must be trinary for a bit map"
        raise MalformedInputError(rule, source=yaml_path, place="mode", got=metadata.mode)
    limit = LARGEST_CELLS if max_cells is None else max_cells
    packed, width = decode_pbm(read_file(path), path, max_cells=limit)
    packed = packed[::-1]  # image rows run from the north, grid rows from the south
    packed = ~packed if metadata.negate else packed
    bits = BitMap(packed, width, metadata.resolution, metadata.origin)
    return bits, metadata, (path, yaml_path)


def bit_map_paths(output: Path) -> tuple[Path, Path]:
    """Return the files that writing a bit map to `output` makes, the picture first."""
    if output.suffix != BIT_MAP:
        raise ParameterError("a bit map must end in .pbm", source=output, got=output.suffix)
    return output, output.with_suffix(".yaml")


def write_bit_map_pair(
    transaction: Transaction, output: Path, bits: BitMap, *, extra: Mapping[str, Any] | None = None
) -> None:
    """Write a bit map as PBM P4 and its YAML, which any map_server reads as a trinary map."""
    # `extra` are further keys for the YAML.
    picture, yaml_path = bit_map_paths(output)
    metadata = MapMetadata(
        image=picture.name, resolution=bits.resolution, origin=bits.origin, extra=extra or {}
    )
    transaction.write(picture, lambda file: write_pbm(file, bits.packed[::-1], bits.width))
    transaction.write_bytes(yaml_path, yaml_of(metadata))


def write_bit_map(path: Path | str, bits: BitMap, *, force: bool = False) -> None:
    """Write a bit map.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file; its ``.yaml`` is written next to it. Missing folders are created.
    bits : BitMap
        Bit map to write.
    force : bool
        Whether to replace existing files.

    Raises
    ------
    FileAccessError
        If a file exists and `force` is not set, or a file cannot be written; nothing is changed
        then.
    """
    output = Path(path)
    with Transaction(bit_map_paths(output), force=force) as transaction:
        write_bit_map_pair(transaction, output, bits)
