"""The type of a single value in a file of ROS 2 parameters, as ``rcl_yaml_param_parser`` sees it.

References
----------
``get_value`` of ros2/rcl, rcl_yaml_param_parser/src/parse.c. A value in quotes is a string; else
it is the first of bool, integer (``strtoll`` with base 0), double (``strtod``) and string that
takes the whole of it. Tags as in the parser that Nav2's main branch is built with; releases up
to Kilted know ``!!str`` alone.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
from typing import Any

_TRUE = frozenset(["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_TAG = "tag:yaml.org,2002:"

_SPACES = " \t\n\v\f\r"  # what C's functions skip in front of a number
_INTEGER = re.compile(r"([-+]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))", re.ASCII)
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_HEXADECIMAL = re.compile(
    r"[-+]?0[xX](?:[0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?|\.[0-9a-fA-F]+)(?:[pP][-+]?[0-9]+)?", re.ASCII
)
_SPECIAL = re.compile(r"[-+]?(?:inf(?:inity)?|nan(?:\([0-9a-z_]*\))?)", re.ASCII | re.IGNORECASE)
_YAML_SPECIAL = frozenset(
    [f".{word}" for word in ("nan", "NaN", "NAN")]
    + [f"{sign}.{word}" for sign in ("", "+", "-") for word in ("inf", "Inf", "INF")]
)
_MOST_DIGITS = 400  # of a number that may still fit a double; Python refuses to read many more


class TagError(ValueError):
    """A tag that the parser does not know, or that the value does not fit."""


def typed_scalar(text: str, *, is_quoted: bool, tag: str | None) -> tuple[str, Any]:
    """Return the type of a value, as ROS 2 calls it, and the value."""
    text = text.partition("\0")[0]  # C's strings end there
    if tag is not None:
        return _tagged(text, tag)
    if not is_quoted:
        for kind, read in _PLAIN:
            value = read(text)
            if value is not None:
                return kind, value
    return "string", text


def _tagged(text: str, tag: str) -> tuple[str, Any]:
    name = tag.removeprefix(_TAG)
    if name == "str":
        return "string", text
    if name == "binary":
        try:
            return "byte_array", base64.b64decode(text, validate=True)
        except binascii.Error:
            raise TagError("is not in base64, as its tag says") from None
    for kind, read in _PLAIN:
        if name == _TAG_OF[kind]:
            value = read(text)
            if value is None:
                raise TagError(f"is not a value of its tag !!{name}")
            return kind, value
    shown = f"!!{name}" if name != tag else tag
    raise TagError(f"has a tag that ROS 2 does not know, {shown}")


def _bool(text: str) -> bool | None:
    return True if text in _TRUE else False if text in _FALSE else None


def _integer(text: str) -> int | None:
    """Return what ``strtoll(text, end, 0)`` makes of the whole text, unless it overflows."""
    match = _INTEGER.fullmatch(text.lstrip(_SPACES))
    if not match:
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    digits = hexadecimal or octal or decimal
    if len(digits.lstrip("0")) > 25:  # 2^63 has 22 digits in octal
        return None
    value = int(digits, 16 if hexadecimal else 8 if octal else 10)
    value = -value if sign == "-" else value
    return value if -(1 << 63) <= value < 1 << 63 else None


def _double(text: str) -> float | None:
    """Return what ``strtod`` makes of the whole text, unless it is out of range."""
    if text in _YAML_SPECIAL:
        return float(text.replace(".", ""))
    text = text.lstrip(_SPACES)
    if _SPECIAL.fullmatch(text):
        return float(text.partition("(")[0])
    if _HEXADECIMAL.fullmatch(text):
        return _from_hexadecimal(text)
    if not _DECIMAL.fullmatch(text):
        return None
    value = float(text)
    mantissa = re.split("[eE]", text)[0]
    is_zero = not mantissa.strip("+-0.")
    return value if is_zero or _is_normal(value) else None


def _from_hexadecimal(text: str) -> float | None:
    if len(text) > _MOST_DIGITS:
        return None
    try:
        value = float.fromhex(text)
        is_zero = not re.split("[pP]", text)[0].lower().lstrip("+-").removeprefix("0x").strip("0.")
        if is_zero or _is_normal(value):
            return value
        mantissa, _, exponent = text.lower().partition("p")  # exact ones set no errno
        scaled = float.fromhex(f"{mantissa}p{int(exponent or 0) + 200}")
    except (OverflowError, ValueError):
        return None
    return value if value and scaled == math.ldexp(value, 200) else None


def _is_normal(value: float) -> bool:
    """Return whether ``strtod`` is content: infinite and subnormal results set ``errno``."""
    return math.isfinite(value) and abs(value) >= 2.0**-1022


_PLAIN = (("bool", _bool), ("integer", _integer), ("double", _double))
_TAG_OF = {"bool": "bool", "integer": "int", "double": "float"}
