"""``mapdeal unpack``: maps of one bit a cell as ordinary ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mapdeal.command import Output, Words, command
from mapdeal.commands.pack import GridResult, read_bits
from mapdeal.maps.reading import output_paths
from mapdeal.pipeline.inputs import InShell


@command(
    group="Formats",
    output=Output(
        "OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz.", paths=output_paths
    ),
    shared=("image", "max_cells", "force", "threads", "max_memory"),
    example="""\
mapdeal pack examples/maps/office.yaml -o out/office.pbm
mapdeal unpack out/office.pbm -o out/unpacked.yaml""",
)
def unpack(source: Annotated[Path, Words("IN.pbm")], *, work: InShell) -> GridResult:
    """Convert a bit map to an ordinary map: 1 is occupied, 0 free.

    Parameters
    ----------
    source : path
        A bit map, with its .yaml in the same folder.
    """
    bits, extra = read_bits(source, work)
    return GridResult(bits.to_occupancy(), source.stem, extra)
