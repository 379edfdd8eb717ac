"""The page: one file of HTML that holds all it needs, and may ask for nothing else.

The data come before what describes them, so that a page is written as its tiles are made.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import one_line
from mapdeal.render.colours import Colours
from mapdeal.render.style import LayerStyle
from mapdeal.report.body import body_of, subtitle_of
from mapdeal.report.document import Entry, Item, PageLayer, Report
from mapdeal.report.markup import escaped
from mapdeal.report.tiles import TILE, encoded
from mapdeal.resources import packaged

SCRIPTS = (
    "start.js", "decode.js", "geometry.js", "tiles.js", "draw.js", "readout.js", "overlay.js",
    "viewer.js", "main.js",
)  # fmt: skip
"""Parts of a page's script, in order."""


_HEADER = 0.02
"""Of the room for tiles: what may go to the header, which has the place where each of them
begins."""


def page_of(report: Report, *, size: int) -> Iterator[bytes]:
    """Yield a page in pieces, the same bytes for the same report."""
    script, style = script_text(), _part("page.css")
    before, between, after = _part("page.html").split("<!-- split -->\n")
    fields = {
        "policy": _policy(script, style),
        "title": escaped(report.title),
        "subtitle": escaped(subtitle_of(report)),
        "version": escaped(report.version),
        "style": style,
        "body": body_of(report).text,
    }
    head = Template(before).substitute(fields).encode()
    yield head
    layers = [layer for entry in report.entries for layer in entry.layers]
    without_tiles = _json(_header(report, [{} for _ in layers]))
    room = int((1 - _HEADER) * (size - len(head) - len(without_tiles) - len(script)))
    pictures = encoded(layers, size=max(room, 0))
    yield from pictures.data
    yield between.encode()
    yield _json(_header(report, pictures.layers)).encode()
    yield Template(after).substitute(script=script).encode()


def _header(report: Report, tiles: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the script knows: all but the tiles themselves, of which it knows the places."""
    styles: dict[str, int] = {}
    places = iter(tiles)
    entries = []
    for entry in report.entries:
        layers = []
        areas = [layer.frame for layer in entry.layers]
        for layer in entry.layers:
            style = styles.setdefault(_json(_style(layer.style)), len(styles))
            more = {"style": style, "area": areas.index(layer.frame)}
            layers.append(_layer(layer) | more | next(places))
        entries.append(_entry(entry) | {"layers": layers})
    looks = [json.loads(style) for style in styles]
    return {"tile": TILE, "styles": looks, "entries": entries}


def script_text() -> str:
    """Return the script of every page; comments and empty lines stay at home."""
    lines = "\n".join(_part(name) for name in SCRIPTS).splitlines()
    return "\n".join(line for line in lines if line.strip() and not line.lstrip().startswith("//"))


def _part(name: str) -> str:
    return packaged("mapdeal.report", f"page/{name}").decode()


def _policy(script: str, style: str) -> str:
    return (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(value: object) -> str:
    """Return JSON that no parser of HTML takes for markup."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def _bytes(values: NDArray[np.uint8]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=np.uint8).tobytes()).decode()


def _pixels(colours: Colours) -> NDArray[np.uint8]:
    """Return colours as pixels, red to alpha; the last one is no colour at all."""
    pixels = np.zeros((len(colours) + 1, 4), dtype=np.uint8)
    pixels[:-1, :3] = colours
    pixels[:-1, 3] = 255
    return pixels


def _style(style: LayerStyle) -> dict[str, Any]:
    scale = style.scale
    return {
        "pixels": _bytes(_pixels(style.colours)),
        "byValue": None if style.by_value is None else _bytes(style.by_value),
        "scale": None
        if scale is None
        else {
            "low": scale.low,
            "factor": scale.levels / ((scale.high - scale.low) or 1.0),
            "first": scale.first,
            "levels": scale.levels,
        },
        "nowhere": len(style.colours) if style.nowhere is None else style.nowhere,
        "line": style.line,
        "fadedBy": style.faded_by or 0,
        "labels": {str(value): one_line(label) for value, label in sorted(style.labels.items())},
    }


def _layer(layer: PageLayer) -> dict[str, Any]:
    frame = layer.frame
    x, y, yaw = frame.origin
    return {
        "name": one_line(layer.name),
        "unit": one_line(layer.unit),
        "frame": {
            "width": frame.width,
            "height": frame.height,
            "resolution": frame.resolution,
            "x": x,
            "y": y,
            "yaw": yaw,
        },
        "states": layer.states,
        "convention": layer.convention,
        "lethal": layer.lethal_threshold,
        "pooled": layer.pooled,
        "opaque": layer.is_bytes or layer.style.nowhere is not None,
    }


def _entry(entry: Entry) -> dict[str, Any]:
    corners = [
        layer.frame.xy_from_continuous_rowcol(
            [(row, col) for row in (0, layer.frame.height) for col in (0, layer.frame.width)]
        )
        for layer in entry.layers
    ]
    whole = _box(np.vstack(corners)) if corners else None
    return {
        "name": one_line(entry.name),
        "whole": whole,
        "extent": whole if entry.extent is None else list(entry.extent),
        "items": [_item(item) for item in entry.items],
    }


def _box(points: NDArray[np.float64]) -> list[float]:
    """Return the left, low, right and high end of points."""
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def _item(item: Item) -> dict[str, Any]:
    places = [] if item.place is None else [np.array([item.place], dtype=np.float64)]
    points = [one for one in (*places, *item.lines) if len(one)]
    return {
        "kind": item.kind,
        "tone": item.tone,
        "place": None if item.place is None else [float(part) for part in item.place],
        "lines": [np.round(line, 4).tolist() for line in item.lines],
        "label": one_line(item.label),
        "box": _box(np.vstack(points)) if points else None,
    }
