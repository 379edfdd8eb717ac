"""The page: one file of HTML that holds all it needs, and may ask for nothing else.

The data come before what describes them, so that a page is written as its tiles are made.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import one_line
from mapdeal.grid.costmap import CostCurve
from mapdeal.pictures.colours import ColourBar, Colours, LayerStyle
from mapdeal.pictures.cost_curve import Zone, ZoneKind, described, end_of, marks_of, zones_of
from mapdeal.pictures.styles import CostPalette
from mapdeal.report.document import Entry, Item, PageLayer, Report, Table
from mapdeal.report.tiles import TILE, encoded

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


_BAR_WIDTH, _BAR, _LABEL = 288, 12, 11  # of a colour bar, in pixels of the panel
_BAR_LETTER = 6.5  # pixels at most that a character takes
_CLOSE = 2.0  # levels that a gradient may differ from the palette


def legend_of(style: LayerStyle, key: str) -> Markup:
    """Return swatches and colour bar of a style; `key` tells it from others on the page."""
    parts: list[Content] = []
    if style.bar is not None:
        parts.append(_bar(style, style.bar, key))
    if style.swatches:
        swatches = [
            element("li", swatch(hex_of(style.colours[one.index])), " ", one.label)
            for one in style.swatches
        ]
        parts.append(element("ul", *swatches, class_="swatches"))
    return joined(parts)


def swatch(colour: str) -> Markup:
    square = element("rect", x=0.5, y=0.5, width=13, height=13, fill=colour, class_="edge")
    return element("svg", square, width=14, height=14, aria_hidden="true", class_="swatch")


def hex_of(colour: NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in colour)


def _bar(style: LayerStyle, bar: ColourBar, key: str) -> Markup:
    colours = style.colours[np.asarray(bar.indices, dtype=np.intp)]
    last = len(colours) - 1
    stops = [
        element("stop", offset=round(k / max(last, 1), 4), stop_color=hex_of(colours[k]))
        for k in _stops(colours.astype(np.float64))
    ]
    gradient = element("linearGradient", *stops, id=key)
    area = element(
        "rect", x=0.5, y=0.5, width=_BAR_WIDTH - 1, height=_BAR, fill=f"url(#{key})", class_="edge"
    )
    label = f"{bar.unit}: " + ", ".join(text for _, text in sorted(bar.ticks))
    return element(
        "figure",
        element("figcaption", bar.unit),
        element(
            "svg", element("defs", gradient), area, *_ticks(bar.ticks),
            viewBox=f"0 0 {_BAR_WIDTH} {_BAR + 22}", class_="bar", role="img", aria_label=label,
        ),
    )  # fmt: skip


def _stops(colours: NDArray[np.float64]) -> list[int]:
    """Return few places between which the colours change evenly, near enough."""

    def between(first: int, last: int) -> list[int]:
        share = np.linspace(0.0, 1.0, last - first + 1)[:, np.newaxis]
        line = colours[first] * (1 - share) + colours[last] * share
        off = np.abs(colours[first : last + 1] - line).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] <= _CLOSE:
            return []
        middle = first + worst
        return [*between(first, middle), middle, *between(middle, last)]

    last = len(colours) - 1
    return [0, *between(0, last), last] if last > 0 else [0]


def _ticks(ticks: Sequence[tuple[float, str]]) -> list[Markup]:
    """Return ticks and labels; the ends come first, others where there is room."""
    taken: list[tuple[float, float]] = []
    parts = []
    for share, text in sorted(ticks, key=lambda tick: (0 < tick[0] < 1, tick[0])):
        x = 0.5 + share * (_BAR_WIDTH - 1)
        width = _BAR_LETTER * len(text)
        start = min(max(x - width / 2, 0.0), _BAR_WIDTH - width)
        if any(start < end + 4 and begin < start + width + 4 for begin, end in taken):
            continue
        taken.append((start, start + width))
        anchor = "start" if start == 0 else "end" if start == _BAR_WIDTH - width else "middle"
        at = {"start": 0.0, "end": float(_BAR_WIDTH), "middle": x}[anchor]
        parts.append(element("line", x1=x, x2=x, y1=_BAR, y2=_BAR + 4, stroke="currentColor"))
        parts.append(element("text", text, x=round(at, 2), y=_BAR + 4 + _LABEL, text_anchor=anchor))
    return parts


_LEFT, _RIGHT, _WIDTH = 44, 16, 700  # pixels
_MARK, _PLOT, _BELOW = 18, 220, 40
_COLUMNS = 700
_LETTER = 6.4
_TICKS = {"costmap2d": (0, 50, 100, 150, 200, 254), "occupancy": (0, 20, 40, 60, 80, 100)}
_ZONE_COLOURS = {
    ZoneKind.OBSTACLE: "#101014",
    ZoneKind.COLLISION: "#00bec8",
    ZoneKind.HEADING: "#f9be6e",
    ZoneKind.CLEAR: "#ffeeaa",
    ZoneKind.COST: "#ffeeaa",
    ZoneKind.FREE: "#ffffff",
    ZoneKind.NO_COST: "#ffffff",
    ZoneKind.UNSEEN_COLLISION: "#e11e3c",
    ZoneKind.UNSEEN_HEADING: "#ff8296",
}
_AXES = {
    "euclidean": "distance from the nearest obstacle, centre to centre, m",
    "chebyshev": "distance from the nearest obstacle, the longer of row and column, m",
}


def curve_figure(curve: CostCurve) -> Markup:
    plot = _Plot(curve)
    zones = [_zone_row(zone, plot.end) for zone in plot.zones]
    caption = f"Cells of {curve.resolution:.6g} m" + (f"; {curve.note}" if curve.note else "")
    return element(
        "figure",
        element("div", plot.drawn(), class_="wide", tabindex=0, role="group", aria_label="Plot"),
        element("figcaption", caption),
        element("ul", *zones, class_="zones"),
        class_="curve",
    )


def _zone_row(zone: Zone, end: float) -> Markup:
    return element(
        "li",
        swatch(_ZONE_COLOURS[zone.kind]),
        " ",
        element("b", zone.kind.value),
        " ",
        described(zone, end),
    )


class _Plot:
    """Where metres and costs lie on the drawing."""

    def __init__(self, curve: CostCurve) -> None:
        self.curve = curve
        self.palette = CostPalette.of(curve.scale)
        self.end = end_of(curve)
        self.zones = zones_of(curve, self.end)
        self.marks = [mark for mark in marks_of(curve) if mark.distance <= self.end]
        self.half = curve.resolution / 2
        self.top = 14 + _MARK * len(self.marks)
        self.bottom = self.top + _PLOT

    def x(self, metres: float) -> float:
        share = (metres + self.half) / (self.end + self.half)
        return round(_LEFT + share * (_WIDTH - _LEFT - _RIGHT), 2)

    def y(self, cost: float) -> float:
        return round(self.bottom - _PLOT * cost / self.palette.lethal_cost, 2)

    def drawn(self) -> Markup:
        return element(
            "svg",
            *self._bars(), *self._axes(), *self._formula(), *self._dots(), *self._marks(),
            viewBox=f"0 0 {_WIDTH} {self.bottom + _BELOW}", role="img", aria_label=self._told(),
        )  # fmt: skip

    def _told(self) -> str:
        zones = "; ".join(f"{zone.kind.value} {described(zone, self.end)}" for zone in self.zones)
        return f"Cost over the distance from the nearest obstacle. {zones}."

    def _bars(self) -> list[Markup]:
        """Return the area below the curve, in the colours of costs."""
        curve = self.curve
        edges = np.linspace(-self.half, self.end, _COLUMNS + 1)
        middles = np.maximum((edges[1:] + edges[:-1]) / 2, 0.0)
        costs = curve.cost_near(middles / curve.resolution)
        starts = np.flatnonzero(np.diff(costs, prepend=-1))
        parts = []
        for first, last in pairwise([*starts.tolist(), _COLUMNS]):
            cost = int(costs[first])
            if cost == 0:
                continue
            left, right = self.x(edges[first]), self.x(edges[last])
            colour = hex_of(self.palette.colours[self.palette.by_value[cost]])
            parts.append(
                element(
                    "rect", x=left, y=self.y(cost), width=round(right - left, 2),
                    height=round(self.bottom - self.y(cost), 2), fill=colour,
                )
            )  # fmt: skip
        return parts

    def _axes(self) -> list[Markup]:
        parts = []
        left, right = self.x(-self.half), self.x(self.end)
        for cost in _TICKS[self.curve.scale]:
            y = self.y(cost)
            parts.append(element("line", x1=left, x2=right, y1=y, y2=y, class_="rule"))
            parts.append(element("text", str(cost), x=left - 6, y=y + 4, text_anchor="end"))
        step = _round_step(self.end / 8)
        for k in range(int(self.end / step) + 1):
            x = self.x(k * step)
            line = element("line", x1=x, x2=x, y1=self.bottom, y2=self.bottom + 5, class_="tick")
            text = f"{k * step:.6g}"
            parts += [line, element("text", text, x=x, y=self.bottom + 18, text_anchor="middle")]
        parts.append(
            element("line", x1=left, x2=right, y1=self.bottom, y2=self.bottom, class_="tick")
        )
        middle, low = (left + right) / 2, self.bottom + 35
        axis = _AXES[self.curve.metric]
        parts.append(element("text", axis, x=middle, y=low, text_anchor="middle"))
        parts.append(element("text", "cost", x=left - 6, y=self.top - 10, text_anchor="end"))
        return parts

    def _formula(self) -> list[Markup]:
        curve = self.curve
        if curve.formula is None or curve.reach <= self.half:
            return []
        metres = np.linspace(self.half, min(curve.reach, self.end), 200)
        costs = np.minimum(curve.formula(metres), self.palette.lethal_cost - 1.0)
        pairs = zip(metres.tolist(), costs.tolist(), strict=True)
        points = " ".join(f"{self.x(m):g},{self.y(c):g}" for m, c in pairs)
        return [element("polyline", points=points, class_="formula")]

    def _dots(self) -> list[Markup]:
        """Return a dot for each whole number of cells, as long as there is room for them."""
        curve = self.curve
        if (_WIDTH - _LEFT - _RIGHT) * curve.resolution / (self.end + self.half) < 6:
            return []
        shown = (curve.cells == np.floor(curve.cells)) & (curve.distance <= self.end)
        pairs = zip(curve.distance[shown].tolist(), curve.cost[shown].tolist(), strict=True)
        return [element("circle", cx=self.x(m), cy=self.y(c), r=3, class_="dot") for m, c in pairs]

    def _marks(self) -> list[Markup]:
        parts = []
        for row, mark in enumerate(self.marks):
            x, y = self.x(mark.distance), 12 + row * _MARK
            parts.append(element("line", x1=x, x2=x, y1=y - 8, y2=self.bottom, class_="mark"))
            fits = x + 6 + _LETTER * len(mark.label) <= _WIDTH
            anchor = "start" if fits else "end"
            parts.append(
                element("text", mark.label, x=x + 5 if fits else x - 5, y=y, text_anchor=anchor)
            )
        return parts


def _round_step(about: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at least `about`."""
    power = 10.0 ** np.floor(np.log10(about))
    return next(float(factor * power) for factor in (1, 2, 5, 10) if factor * power >= about)


_KINDS = {
    "passage": "Passages",
    "start": "Starts",
    "goal": "Goals",
    "route": "Routes",
    "finding": "Findings",
    "shape": "Shapes",
}

_FAILED = "failed"
_TOLD_BY_SIZE = ("cells", "m per cell")


def body_of(report: Report) -> Markup:
    """Return what stands in the body of a page before its data."""
    several = len(report.entries) > 1
    parts = [_maps(report.entries)] if several else []
    parts += [_entry(entry, k, several=several) for k, entry in enumerate(report.entries)]
    return joined(parts)


def subtitle_of(report: Report) -> str:
    if len(report.entries) > 1:
        counts = [_counts(entry) for entry in report.entries]
        told = [
            _counted(sum(count[k] for count in counts), name)
            for k, name in enumerate(("error", "warning"))
        ]
        failed = sum(entry.status == _FAILED for entry in report.entries)
        bare = sum(not entry.layers for entry in report.entries if entry.status != _FAILED)
        told += [f"{failed} failed"] if failed else []
        told += [f"{bare} without layers"] if bare else []
        return ", ".join([f"{len(report.entries)} maps", *told])
    entry = report.entries[0]
    figures = [_figure(k, v) for k, v in entry.figures.items() if k not in _TOLD_BY_SIZE]
    return ", ".join([_size_text(entry), *figures])


def _counted(count: int, name: str) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def _figure(name: str, value: str | float) -> str:
    """Return a figure in words: a unit at the end of its name goes behind the value.

    Examples
    --------
    >>> _figure("occupied %", 13.66), _figure("recipe", "nav2")
    ('occupied 13.66 %', 'recipe nav2')
    """
    words, _, unit = name.rpartition(" ")
    if words and unit in ("%", "m", "m2", "m\u00b2"):
        return f"{words} {_text(value)} {unit}"
    return f"{name} {_text(value)}"


def _size_text(entry: Entry) -> str:
    if not entry.layers:
        return "no layers"
    frame = entry.layers[-1].frame
    across, along = frame.size_xy
    return (
        f"{frame.width} \u00d7 {frame.height} cells of {frame.resolution:.6g} m, "
        f"{across:.4g} \u00d7 {along:.4g} m"
    )


def _text(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:,.6g}"


def _counts(entry: Entry) -> tuple[int, int]:
    """Return how many errors and how many warnings an entry has."""
    errors = sum(item.tone == "error" for item in entry.items)
    warnings = sum(item.tone == "warning" for item in entry.items)
    if entry.status == _FAILED:  # what is listed as a warning is why
        return errors + max(1, len(entry.warnings)), warnings
    return errors, warnings + len(entry.warnings)


def _maps(entries: tuple[Entry, ...]) -> Markup:
    names = list(dict.fromkeys(name for entry in entries for name in entry.figures))
    has_status = any(entry.status for entry in entries)
    heads = ["Map", *(["Status"] if has_status else []), "Errors", "Warnings", *names]
    cells = [_head(name, entries) for name in heads]
    rows = [_row(entry, k, names, has_status=has_status) for k, entry in enumerate(entries)]
    search = element(
        "label", "Filter ", element("input", type="search", id="filter", autocomplete="off")
    )
    count = element("span", f"{len(entries)} maps", id="count", role="status")
    table = element(
        "table", element("thead", element("tr", element("td"), *cells)), element("tbody", *rows)
    )
    return element(
        "section",
        element("h2", "Maps", id="maps-title", tabindex=-1),
        element("p", search, " ", count, class_="search"),
        element(
            "div", table, class_="wide", tabindex=0, role="group", aria_labelledby="maps-title"
        ),
        id="maps",
        aria_labelledby="maps-title",
    )


def _head(name: str, entries: tuple[Entry, ...]) -> Markup:
    button = element("button", name, type="button", data_sort=True)
    values = [entry.figures[name] for entry in entries if name in entry.figures]
    is_number = name in ("Errors", "Warnings") or any(not isinstance(v, str) for v in values)
    return element("th", button, scope="col", class_="number" if is_number else None)


def _row(entry: Entry, number: int, names: list[str], *, has_status: bool) -> Markup:
    thumb = element(
        "canvas", width=144, height=108, data_entry=number, role="img",
        aria_label=f"Thumbnail of {entry.name}",
    )  # fmt: skip
    link = element("a", entry.name, href=f"#entry-{number}")
    cells = [element("td", thumb), element("th", link, scope="row")]
    cells += [element("td", entry.status)] if has_status else []
    cells += [
        element("td", str(count), class_="number" if count else "number none")
        for count in _counts(entry)
    ]
    for name in names:
        value = entry.figures.get(name, "")
        is_number = not isinstance(value, str)
        data = repr(float(value)) if is_number else value
        css = "number" if is_number else None
        cells.append(element("td", _text(value), data_value=data, class_=css))
    return element("tr", *cells)


def _entry(entry: Entry, number: int, *, several: bool) -> Markup:
    parts: list[Content] = []
    if several:
        parts.append(element("p", element("a", "\u2190 All maps", href="#maps"), class_="back"))
        parts.append(element("h2", entry.name, tabindex=-1))
        parts.append(element("p", _status_line(entry), class_="subtitle"))
    if entry.warnings:
        parts.append(_warnings(entry.warnings))
    rest = element("div", *_below(entry), class_="rest")
    if entry.layers:
        slot = element("div", class_="slot")
        parts.append(element("div", slot, _panels(entry, number), rest, class_="work"))
    else:
        parts.append(element("p", "This map has no layer to show.", class_="notice"))
        parts += [_items(entry.items), rest]
    return element("section", *parts, class_="entry", id=f"entry-{number}", aria_label=entry.name)


def _below(entry: Entry) -> Iterator[Markup]:
    if entry.curve is not None:
        heading = element("h3", "Costs over distance")
        yield element("section", heading, curve_figure(entry.curve), aria_label="Cost curve")
    for table in entry.tables:
        yield _table(table)


def _status_line(entry: Entry) -> str:
    return ", ".join(part for part in (entry.status, _size_text(entry)) if part)


def _warnings(warnings: tuple[str, ...]) -> Markup:
    title = "1 warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    lines = [element("li", text) for text in warnings]
    return element(
        "section", element("h3", title), element("ul", *lines), class_="warnings", aria_label=title
    )


def _panels(entry: Entry, number: int) -> Markup:
    parts = [_layers(entry.layers, number)]
    if len(entry.layers) > 1:
        parts.append(_compare(entry))
    parts += [_readout(entry.layers), _items(entry.items)]
    return element("div", *parts, class_="panels")


def _layers(layers: tuple[PageLayer, ...], number: int) -> Markup:
    rows = [_layer(layers[k], k, number, len(layers)) for k in reversed(range(len(layers)))]
    return element(
        "section", element("h3", "Layers"), element("ul", *rows), class_="layers",
        aria_label="Layers",
    )  # fmt: skip


def _layer(layer: PageLayer, k: int, number: int, count: int) -> Markup:
    is_on = k in (0, count - 1)
    box = element("input", type="checkbox", checked=is_on, autocomplete="off")
    slider = element(
        "input", type="range", min=0, max=100, value=100, autocomplete="off",
        aria_label=f"Opacity of {layer.title}",
    )  # fmt: skip
    only = element(
        "button",
        "only",
        type="button",
        data_only=k,
        class_="only",
        aria_label=f"Show only {layer.title}",
    )
    head = element("div", element("label", box, " ", layer.title), slider, only, class_="head")
    legend = element("div", legend_of(layer.style, f"bar-{number}-{k}"), class_="legend")
    return element("li", head, legend, class_="layer", data_layer=k)


def _compare(entry: Entry) -> Markup:
    names = [layer.name for layer in entry.layers]
    pair = entry.compared or (names[-2], names[-1])
    chosen = [names.index(name) for name in pair]
    selects = [
        element("label", f"{side} ", _select(entry.layers, at))
        for side, at in zip(("Left", "Right"), chosen, strict=True)
    ]
    toggles = [
        element(
            "label",
            element(
                "input", type="checkbox", name=name, autocomplete="off",
                checked=name == "compare" and entry.compared is not None,
            ),
            f" {text}",
            class_="toggle",
        )
        for text, name in (("Side by side", "compare"), ("Blink", "blink"))
    ]  # fmt: skip
    heading = element("h3", "Compare")
    row = element("p", *toggles, class_="toggles")
    return element(
        "section", heading, *selects, row, class_="compare scripted-only", aria_label="Compare"
    )


def _select(layers: tuple[PageLayer, ...], chosen: int) -> Markup:
    options = [
        element("option", layer.title, value=k, selected=k == chosen)
        for k, layer in enumerate(layers)
    ]
    return element("select", *options, autocomplete="off")


def _readout(layers: tuple[PageLayer, ...]) -> Markup:
    names = ["x, y [m]", "row, column", *(layer.name for layer in layers)]
    rows = [
        element("tr", element("th", name, scope="row"), element("td"), element("td"))
        for name in names
    ]
    heads = [element("th", name, scope="col") for name in ("Pointer", "Pinned")]
    table = element(
        "table", element("thead", element("tr", element("td"), *heads)), element("tbody", *rows)
    )
    heading = element("h3", "Values")
    return element("section", heading, table, class_="readout scripted-only", aria_label="Values")


def _items(items: tuple[Item, ...]) -> Markup:
    if not items:
        return joined([])
    kinds = [kind for kind in _KINDS if any(item.kind == kind for item in items)]
    boxes = [
        element(
            "label",
            element("input", type="checkbox", value=kind, checked=True, autocomplete="off"),
            f" {_KINDS[kind]} ({sum(item.kind == kind for item in items)})",
        )
        for kind in kinds
    ]
    lists = list(_lists(items, kinds))
    return element(
        "section", element("h3", "On the map"), element("p", *boxes, class_="kinds"), *lists,
        class_="items", aria_label="On the map",
    )  # fmt: skip


def _lists(items: tuple[Item, ...], kinds: list[str]) -> Iterator[Markup]:
    for kind in kinds:
        rows = [_item(item, k) for k, item in enumerate(items) if item.kind == kind]
        yield element("ul", *rows, aria_label=_KINDS[kind], data_kind=kind)


def _item(item: Item, number: int) -> Markup:
    text: Content = item.text
    if item.tone in ("error", "warning", "note"):
        text = joined([element("b", item.tone, class_=f"tone {item.tone}"), " ", item.text])
    if item.place is None and not item.lines:
        return element("li", element("span", text))
    return element("li", element("button", text, type="button", data_item=number))


def _table(table: Table) -> Markup:
    rows = [
        element("tr", element("th", name, scope="row"), element("td", value))
        for name, value in table.rows
    ]
    return element(
        "details", element("summary", table.title), element("table", element("tbody", *rows))
    )


def packaged(package: str, name: str) -> bytes:
    module = sys.modules[package]
    loader: Any = module.__spec__.loader if module.__spec__ is not None else None
    path = os.path.join(os.path.dirname(str(module.__file__)), *name.split("/"))  # noqa: PTH118, PTH120 - as loaders take it
    data: bytes = loader.get_data(path)
    return data


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
            layers.append(_page_layer(layer) | more | next(places))
        entries.append(_page_entry(entry) | {"layers": layers})
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


def _page_layer(layer: PageLayer) -> dict[str, Any]:
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


def _page_entry(entry: Entry) -> dict[str, Any]:
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
        "items": [_page_item(item) for item in entry.items],
    }


def _box(points: NDArray[np.float64]) -> list[float]:
    """Return the left, low, right and high end of points."""
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def _page_item(item: Item) -> dict[str, Any]:
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
