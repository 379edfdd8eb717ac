"""Operations on square neighbourhoods: growing masks, groups of touching cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def dilate_square(marked: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return the cells within `reach` cells of a marked one along both axes.

    Parameters
    ----------
    marked : numpy.ndarray of bool, shape (H, W)
        The cells to grow.
    reach : int
        Chebyshev distance, cells; at least 0. Nothing wraps around the borders.

    Returns
    -------
    numpy.ndarray of bool, shape (H, W)

    Examples
    --------
    >>> dilate_square(np.array([[0, 0, 0, 1]], dtype=bool), 2).astype(int)
    array([[0, 1, 1, 1]])
    """
    by_columns = _widened(marked, reach)
    return _widened(by_columns.T, reach).T


def _widened(marked: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return `marked` grown along its first axis."""
    reach = min(reach, len(marked))
    grown, covered = marked.copy(), 0
    while covered < reach:
        # at a border, where one side is cut off, c cells leave no gap when moved by c + 1
        step = min(covered + 1, reach - covered)
        before = grown.copy()
        grown[step:] |= before[:-step]
        grown[:-step] |= before[step:]
        covered += step
    return grown


def drop_small_groups(marked: NDArray[np.bool_], min_cells: int) -> NDArray[np.bool_]:
    """Return `marked` without its 8-connected groups of fewer than `min_cells` cells.

    Examples
    --------
    >>> cells = np.array([[1, 0, 0, 0], [0, 1, 0, 1]], dtype=bool)
    >>> drop_small_groups(cells, 2).astype(int)
    array([[1, 0, 0, 0],
           [0, 1, 0, 0]])
    """
    if min_cells <= 1:
        return marked
    from scipy import ndimage

    groups, _ = ndimage.label(marked, structure=np.ones((3, 3), dtype=bool))
    sizes = np.bincount(groups.ravel())
    keep = sizes >= min_cells
    keep[0] = False
    kept: NDArray[np.bool_] = keep[groups]
    return kept
