"""JSON files, written the same way every time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError
from mapdeal.formats.budget import OF_JSON, claim
from mapdeal.formats.source import read_file

_LARGEST_FILE = 1 << 26


def json_of(value: Any) -> bytes:
    """Return `value` as indented JSON in UTF-8; it must not hold nan or infinity."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    try:
        return f"{text}\n".encode()
    except UnicodeEncodeError:  # a file name that is not UTF-8
        return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> Any:
    """Return the value in a JSON file, or None if there is none or it is damaged."""
    try:
        data = read_file(path, limit=_LARGEST_FILE)
        claim(path, OF_JSON * len(data))
        return json.loads(data)
    except (FileAccessError, ValueError, RecursionError):
        return None
