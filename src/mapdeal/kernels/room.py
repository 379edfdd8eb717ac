"""Room in the address space for what would hang, or end the process, where it finds none."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # the module typing takes longer than the rest of this one
if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec

_OPENBLAS = 80 << 20
"""Bytes that numpy and scipy each map until OpenBLAS is loaded, with its buffer of 32 MB."""

_LOADED = {"scipy.linalg._fblas", "scipy.special._ufuncs"}
"""Modules of scipy that load it first."""

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
