"""Groups of touching cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def drop_small_groups(marked: NDArray[np.bool_], min_cells: int) -> NDArray[np.bool_]:
    """Return `marked` without its 8-connected groups of fewer than `min_cells` cells."""
    if min_cells <= 1:
        return marked
    from scipy import ndimage

    groups, _ = ndimage.label(marked, structure=np.ones((3, 3), dtype=bool))
    sizes = np.bincount(groups.ravel())
    keep = sizes >= min_cells
    keep[0] = False
    kept: NDArray[np.bool_] = keep[groups]
    return kept
