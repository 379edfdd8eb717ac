"""JSON files, written the same way every time."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.budget import OF_JSON, claim
from mapdeal.formats.source import read_file

_LARGEST_FILE = 1 << 22  # a manifest has some kilobytes


def json_of(value: Any) -> bytes:
    """Return `value` as indented JSON in UTF-8; it must not hold nan or infinity."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    try:
        return f"{text}\n".encode()
    except UnicodeEncodeError:  # a file name that is not UTF-8
        return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> Any:
    """Return the value in a JSON file, or None if there is none, or it is damaged or too large."""
    try:
        data = read_file(path, limit=_LARGEST_FILE)
    except (FileAccessError, MalformedInputError):
        return None
    claim(path, OF_JSON * len(data))
    try:
        return json.loads(data, parse_constant=_refuse_constant, parse_float=_finite)
    # numbers of many thousand digits are ValueErrors, as is text that is not UTF-8
    except (ValueError, RecursionError):
        return None


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    """Return a number; one too large for a float is refused, since it could not be written."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is too large")
    return value
