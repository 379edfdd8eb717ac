"""Which engine the kernels run on: compiled code, or numpy and scipy.

Both give the same bytes. The compiled module is built at installation where there is a C
compiler.
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
_BESIDE = ("_clearance_tree", "_clouds", "_configuration_space", "_dilation", "_rays")


def engine_name() -> Literal["compiled", "scipy"]:
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
    from mapdeal.version import __version__

    return f"mapdeal {__version__} (kernels: {engine_name()})"


_OPENBLAS = 80 << 20
"""Bytes that numpy and scipy each map until OpenBLAS is loaded, with its buffer of 32 MB."""

_LOADED = {"scipy.linalg._fblas", "scipy.special._ufuncs"}  # modules of scipy that load it first
_EPOCH_DIGITS = 11  # up to the year 5138


def check_room(size: int) -> None:
    """Raise an OSError if the system does not give so many bytes."""
    import mmap

    mmap.mmap(-1, size).close()


class _RoomFirst:
    """Refuses to load a copy of OpenBLAS that would try for ever to get its buffer, or exit."""

    @staticmethod
    def find_spec(name: str, *_: object) -> ModuleSpec | None:
        """Find nothing, but raise an OSError if there is no room for the library."""
        is_part = name.startswith("scipy") and name.count(".") <= 1
        if name == "numpy" or (is_part and _LOADED.isdisjoint(sys.modules)):
            check_room(_OPENBLAS)
        return None


def prepare_libraries() -> None:
    """Set how a process that is mapdeal's own loads numpy and scipy."""
    # OpenBLAS would start a thread per processor, for nothing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # scipy fails to import on one that is no time; no output of ours holds a time
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    if not epoch.isdecimal() or len(epoch) > _EPOCH_DIGITS:
        del os.environ["SOURCE_DATE_EPOCH"]
    sys.meta_path.insert(0, _RoomFirst)
