"""Choice of the engine of the kernels: compiled code, or numpy and scipy.

Both compute the same bytes. Installation builds the compiled modules if it finds a C compiler.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Literal

from mapdeal.errors import ParameterError

if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec

VARIABLE = "MAPDEAL_KERNELS"  # name of the environment variable that chooses the engine
_COMPILED_MODULES = (
    "_clearance_tree", "_clouds", "_configuration_space", "_dilation", "_planners", "_rays",
    "_smac", "_updates",
)  # fmt: skip
_OPENBLAS = 80 << 20  # bytes that numpy and scipy each map for it, with its buffer of 32 MB
_LOADERS = {"scipy.linalg._fblas", "scipy.special._ufuncs"}  # scipy's first users of OpenBLAS
_EPOCH_DIGITS = 11  # up to the year 5138


def engine_name() -> Literal["compiled", "scipy"]:
    requested = os.environ.get(VARIABLE) or None
    if requested not in (None, "compiled", "scipy"):
        raise ParameterError("must be compiled or scipy", place=VARIABLE, got=requested)
    if requested == "scipy":
        return "scipy"
    if compiled_module() is not None:
        return "compiled"
    if requested == "compiled":
        rule = "the compiled kernels are not part of this installation, or cannot be loaded"
        hint = "install again where there is a C compiler"
        raise ParameterError(rule, place=VARIABLE, got=requested, hint=hint)
    return "scipy"


@cache
def compiled_module() -> ModuleType | None:
    # All kernels run on the same engine. The other compiled modules are imported where needed.
    if not all(find_spec(f"mapdeal.kernels.{name}") for name in _COMPILED_MODULES):
        return None
    try:
        from mapdeal.kernels import _compiled  # type: ignore[attr-defined,unused-ignore]
    except ImportError:
        return None
    return _compiled


def version_text() -> str:
    from mapdeal.version import __version__

    return f"mapdeal {__version__} (kernels: {engine_name()})"


def check_room(size: int) -> None:
    """Raise an OSError if the system cannot map so many bytes."""
    import mmap

    mmap.mmap(-1, size).close()


class _MemoryGuard:
    """Refuses to load OpenBLAS without room for its buffer: it would loop for ever, or exit."""

    @staticmethod
    def find_spec(name: str, *_: object) -> ModuleSpec | None:
        is_part = name.startswith("scipy") and name.count(".") <= 1
        if name == "numpy" or (is_part and _LOADERS.isdisjoint(sys.modules)):
            check_room(_OPENBLAS)
        return None


def prepare_libraries() -> None:
    """Set how mapdeal's own processes load numpy and scipy."""
    # OpenBLAS would start a thread per processor without any use.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # scipy cannot be imported with an invalid SOURCE_DATE_EPOCH; mapdeal writes no times
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    if not epoch.isdecimal() or len(epoch) > _EPOCH_DIGITS:
        del os.environ["SOURCE_DATE_EPOCH"]
    sys.meta_path.insert(0, _MemoryGuard)
