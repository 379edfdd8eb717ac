"""Which engine the kernels run on: compiled code, or numpy and scipy.

Both give the same bytes. The compiled module is built at installation where there is a C
compiler.
"""

from __future__ import annotations

import os
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import Literal

from mapdeal.errors import ParameterError

Engine = Literal["compiled", "scipy"]

VARIABLE = "MAPDEAL_KERNELS"
"""Name of the environment variable that chooses the engine."""

_BESIDE = ("_clearance_tree", "_clouds", "_configuration_space", "_dilation", "_rays")


def engine_name() -> Engine:
    """Return the engine's name, without importing scipy."""
    asked = os.environ.get(VARIABLE) or None
    if asked not in (None, "compiled", "scipy"):
        raise ParameterError("must be compiled or scipy", place=VARIABLE, got=asked)
    if asked == "scipy":
        return "scipy"
    if compiled_module() is not None:
        return "compiled"
    if asked == "compiled":
        rule = "the compiled kernels are not part of this installation, or cannot be loaded"
        hint = "install again where there is a C compiler"
        raise ParameterError(rule, place=VARIABLE, got=asked, hint=hint)
    return "scipy"


@cache
def compiled_module() -> ModuleType | None:
    """Return the compiled module of distances; None where it is not, or does not load."""
    # One engine does everything: there is none either if a module beside it is missing. Those are
    # imported where they are needed.
    if not all(find_spec(f"mapdeal.kernels.{name}") for name in _BESIDE):
        return None
    try:
        from mapdeal.kernels import _compiled  # type: ignore[attr-defined,unused-ignore]
    except ImportError:
        return None
    module: ModuleType = _compiled
    return module


def version_text() -> str:
    """Return what ``mapdeal --version`` prints."""
    from mapdeal.version import __version__

    return f"mapdeal {__version__} (kernels: {engine_name()})"
