"""Which engine the kernels run on."""

from __future__ import annotations


def engine_name() -> str:
    """Return the engine's name, without importing it."""
    return "scipy"
