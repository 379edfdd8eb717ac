"""Pieces of a page that cannot be anything but what they are meant to be.

All text and all values of attributes are escaped here and nowhere else, so that no name in a map,
no finding and no warning can become markup.
"""

from __future__ import annotations

import html
from collections.abc import Iterable
from dataclasses import dataclass

from mapdeal.errors import one_line

Value = str | int | float | bool | None
"""Of an attribute: True for its name alone, False and None for no attribute."""

_VOID = {"input", "meta", "br", "rect", "line", "circle", "path", "polyline", "stop"}
_RAW = {"script", "style"}


@dataclass(frozen=True, slots=True)
class Markup:
    """Markup that stands as it is. Only `element` and `joined` make it."""

    text: str


Content = str | Markup


def element(name: str, /, *content: Content, **attributes: Value) -> Markup:
    if name in _RAW:
        raise ValueError(f"no element {name} is made of parts")
    parts = [f"<{name}"]
    for key, value in attributes.items():
        parts.append(_attribute(key.rstrip("_").replace("_", "-"), value))
    if name in _VOID:
        return Markup("".join([*parts, ">" if name in ("input", "meta", "br") else "/>"]))
    return Markup("".join([*parts, ">", joined(content).text, f"</{name}>"]))


def joined(content: Iterable[Content]) -> Markup:
    """Return pieces one behind the other, text escaped."""
    return Markup("".join(one.text if isinstance(one, Markup) else escaped(one) for one in content))


def escaped(text: str) -> str:
    """Return text as markup shows it; characters that cannot be seen are spelled out."""
    # Such are control characters, those that turn the direction of what follows, and halves of
    # surrogate pairs, which names of files can hold.
    return html.escape(one_line(text), quote=True)


def _attribute(name: str, value: Value) -> str:
    if value is None or value is False:
        return ""
    if name == "style" or name.startswith("on") or name in ("src", "srcset", "action"):
        raise ValueError(f"no attribute {name} is allowed")
    if value is True:
        return f" {name}"
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    if name in ("href", "xlink:href") and not text.startswith("#"):
        raise ValueError("links lead to the page itself")
    return f' {name}="{escaped(text)}"'
