"""Sums of inverse distances to all marked cells, by convolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.threads import thread_count


def sum_of_inverse_distances(
    marked: NDArray[np.bool_], *, scale: float = 1.0, least: float = 0.0
) -> NDArray[np.float64]:
    """Return for each cell the sum of 1 / distance over all marked cells."""
    # The sum is the convolution of the mask with 1 / distance, taken as a product of Fourier
    # transforms: H W log(H W) steps rather than H W times the number of marked cells. 1 / distance
    # is symmetric along both axes, so that its transform is a real cosine transform of a quarter of
    # it. What rounding adds is about 1e-16 of the largest values.
    if not marked.any():
        return np.zeros(marked.shape)
    # scipy.fft takes longer to import than most maps to transform
    from scipy import fft

    workers = thread_count()
    height, width = marked.shape
    # The periods must leave room for the farthest offsets on both sides, to be apart.
    half_height, half_width = (int(fft.next_fast_len(length, real=True)) for length in marked.shape)
    rows = np.arange(half_height + 1, dtype=np.float64)[:, np.newaxis]
    inverse = np.hypot(rows, np.arange(half_width + 1, dtype=np.float64))
    inverse *= scale
    far = inverse > least  # never so for a cell and itself
    np.divide(1.0, inverse, out=inverse, where=far)
    inverse[~far] = 0.0
    try:
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    except RuntimeError:  # no threads to be had: it has not begun
        workers = 1
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    del inverse, far
    spectrum = fft.rfft2(
        marked.astype(np.float64), s=(2 * half_height, 2 * half_width), workers=workers
    )
    spectrum[: half_height + 1] *= response
    spectrum[half_height + 1 :] *= response[half_height - 1 : 0 : -1]
    del response  # the peak of memory is that of what follows
    total: NDArray[np.float64] = fft.irfft2(
        spectrum, s=(2 * half_height, 2 * half_width), overwrite_x=True, workers=workers
    )
    # no sum is negative; rounding may make it so, far from everything
    return np.maximum(total[:height, :width], 0.0)
