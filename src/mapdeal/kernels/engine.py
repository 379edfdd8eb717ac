"""Which engine the kernels run on: compiled code, or numpy and scipy.

Both give the same bytes. The compiled module is built at installation where there is a C
compiler.
"""

from __future__ import annotations

import os
from types import ModuleType
from typing import Literal

from mapdeal.errors import ParameterError

Engine = Literal["compiled", "scipy"]

VARIABLE = "MAPDEAL_KERNELS"
"""Name of the environment variable that chooses the engine."""


def engine_name() -> Engine:
    """Return the engine's name, without importing scipy.

    Raises
    ------
    ParameterError
        If the environment variable asks for an engine that there is not.
    """
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


def compiled_module() -> ModuleType | None:
    """Return the compiled module, or None where it, or one beside it, is not or does not load."""
    try:
        from mapdeal.kernels import (  # type: ignore[attr-defined,unused-ignore]
            _clearance_tree,  # noqa: F401 - whoever asks for the one may import the others
            _compiled,
            _configuration_space,  # noqa: F401 - as above
            _dilation,  # noqa: F401 - as above
            _rays,  # noqa: F401 - as above
        )
    except ImportError:
        return None
    module: ModuleType = _compiled
    return module
