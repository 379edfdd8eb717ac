"""Parts of Python 3.11 for Python 3.10, which ROS 2 Humble uses."""

from __future__ import annotations

import hashlib
import sys
from typing import Any

if sys.version_info >= (3, 11):
    from hashlib import file_digest
    from typing import Self, Unpack
else:
    from typing_extensions import Self, Unpack

    def file_digest(file: Any, name: str) -> Any:
        digest = hashlib.new(name)
        while chunk := file.read(1 << 18):
            digest.update(chunk)
        return digest


def parse_toml(text: str) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    return tomllib.loads(text)


__all__ = ["Self", "Unpack", "file_digest", "parse_toml"]
