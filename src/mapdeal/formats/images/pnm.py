"""PNM images, P1 to P6, which `mapdeal.formats.pnm` parses: most maps have one."""

from __future__ import annotations

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.picture import LARGEST_CELLS
from mapdeal.formats.pnm import decode_pnm, is_pnm, pnm_comments, pnm_size

PNM = ImageFormat(
    name="PNM",
    suffixes=(".pgm", ".pbm", ".ppm", ".pnm"),
    recognises=is_pnm,
    read=decode_pnm,
    size=pnm_size,
    max_cells=LARGEST_CELLS,
    suggested=("pgm", "pbm", "ppm"),
    comments=pnm_comments,
)
