"""Numbers with the noise of rounding."""

from __future__ import annotations

import numpy as np


def without_rounding_noise(value: float) -> float | None:
    """Return the decimal that a value stands for; None if it has no noise of rounding.

    The noise is that of a 32-bit or 64-bit float.

    Examples
    --------
    >>> without_rounding_noise(0.05000000074505806)
    0.05
    >>> without_rounding_noise(0.05)
    """
    plain = float(f"{value:.6g}")
    if plain != value and float(np.float32(plain)) == float(np.float32(value)):
        return plain
    return None
