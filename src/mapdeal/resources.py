"""Files that are parts of this package, also within an archive of modules.

`importlib.resources` does more, and its import takes longer than what is read by it.
"""

from __future__ import annotations

import os
import sys
from typing import Any


def packaged(package: str, name: str) -> bytes:
    module = sys.modules[package]
    loader: Any = module.__spec__.loader if module.__spec__ is not None else None
    path = os.path.join(os.path.dirname(str(module.__file__)), *name.split("/"))  # noqa: PTH118, PTH120 - as loaders take it
    data: bytes = loader.get_data(path)
    return data
