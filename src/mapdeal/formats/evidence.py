"""The layers of evidence that ``build`` writes beside a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.npz_reader import NpzReader
from mapdeal.formats.picture import LARGEST_CELLS

_TYPES: dict[str, type[np.generic]] = {
    "log_odds": np.float64, "hits": np.int32, "misses": np.int32
}  # fmt: skip


def read_evidence(path: Path, *, max_cells: int | None = None) -> dict[str, NDArray[Any]]:
    """Return the layers of an ``.npz`` that say what beams have hit; none if it has none."""
    with NpzReader(path, LARGEST_CELLS if max_cells is None else max_cells) as reader:
        there = reader.names()
        return {name: reader.layer(name, kind) for name, kind in _TYPES.items() if name in there}
