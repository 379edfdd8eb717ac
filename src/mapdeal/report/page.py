"""The page: one file of HTML that holds all it needs, and may ask for nothing else.

The data come before what describes them, so that a page is written as its tiles are made.
"""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from string import Template
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.compare.difference import ChangeKind
from mapdeal.errors import one_line
from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.values import count_text, place_text
from mapdeal.maps.png import write_png
from mapdeal.pictures.colours import ColourBar, LayerStyle
from mapdeal.pictures.cost_curve import cost_curve_image, curve_text
from mapdeal.records import asdict, dataclass
from mapdeal.report import verdict as verdicts
from mapdeal.report.document import Claim, Entry, Item, PageLayer, Report, State, Table
from mapdeal.report.tiles import TILE, encoded
from mapdeal.report.verdict import MOST_CLAIMS, most_urgent, shared_by, state_of, verdicts_of

Value = str | int | float | bool | None  # of an attribute: True writes its name, False omits it

_PNG = "data:image/png;base64,"
_VOID = {"input", "meta", "br", "wbr", "img", "rect", "line", "circle", "path", "polyline", "stop"}
_RAW = {"script", "style"}
_BAR_WIDTH, _BAR, _LABEL = 288, 12, 11  # of a colour bar, in pixels of the panel
_BAR_LETTER = 6.5  # pixels at most that a character takes
_CLOSE = 2.0  # levels that a gradient may differ from the palette
_KINDS = {  # what items are called, in the order in which they are listed
    "added": "Added", "removed": "Removed", "closed": "Now closed", "opened": "No longer closed",
    "unknown": "Now unknown", "known": "No longer unknown", "rose": "Higher cost",
    "fell": "Lower cost", "passage": "Passages", "start": "Starts", "goal": "Goals",
    "route": "Routes", "trajectory": "Trajectories", "graph": "Route graphs",
    "finding": "Findings", "shape": "Shapes",
}  # fmt: skip
_IN_ONE_LIST = dict.fromkeys(get_args(ChangeKind), "Largest changes")
# states of a verdict, which also have colours: no reader depends on these
_STATES = {"error": "Problem", "warning": "Check", "unknown": "Not checked", "good": "OK"}
_MODES = {"layers": "Layers", "swipe": "Swipe", "beside": "Side by side", "blink": "Blink"}
_COUNTS = ("Errors", "Warnings")
_HEADS = {"cells": "Cells", "m per cell": "Cell, m"}
_MOST_NOTES = 3  # kinds of notes that a list shows one by one
_PLACE = "place "  # what the text of a further place of a finding begins with
_FAILED = "failed"
_IN_SIZE_TEXT = ("cells", "m per cell")
_MOST_NAMED = 3  # maps that a line of the verdict on several maps names
SCRIPTS = (
    "start.js", "decode.js", "geometry.js", "tiles.js", "draw.js", "readout.js", "overlay.js",
    "viewer.js", "zones.js", "main.js",
)  # fmt: skip
_HEADER_SHARE = 0.02  # of the room for tiles: their offsets, which the header contains


@dataclass(frozen=True, slots=True)
class Markup:
    """Markup that stands as it is. Only `element` and `joined` make it."""

    text: str


Content = str | Markup


def element(name: str, /, *content: Content, **attributes: Value) -> Markup:
    if name in _RAW:
        raise ValueError(f"no element {name} is made of parts")
    parts = (_attribute(k.rstrip("_").replace("_", "-"), v) for k, v in attributes.items())
    start = f"<{name}{''.join(parts)}"
    if name in _VOID:
        return Markup(f"{start}{'>' if name in ('input', 'meta', 'br', 'wbr', 'img') else '/>'}")
    return Markup(f"{start}>{joined(content).text}</{name}>")


def joined(content: Iterable[Content]) -> Markup:
    texts = (piece.text if isinstance(piece, Markup) else escaped(piece) for piece in content)
    return Markup("".join(texts))


def escaped(text: str) -> str:
    """Return text as markup, with control, bidirectional and surrogate characters spelled out."""
    return html.escape(one_line(text), quote=True)


def _attribute(name: str, value: Value) -> str:
    if value is None or value is False:
        return ""
    is_picture = name == "src" and str(value).startswith(_PNG)
    if (name in ("style", "src", "srcset", "action") and not is_picture) or name.startswith("on"):
        raise ValueError(f"no attribute {name} is allowed")
    if value is True:
        return f" {name}"
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    if name in ("href", "xlink:href") and not text.startswith("#"):
        raise ValueError("links lead to the page itself")
    return f' {name}="{escaped(text)}"'


def legend_of(style: LayerStyle, key: str) -> Markup:
    parts = [] if style.bar is None else [_bar(style, style.bar, key)]
    if style.swatches:
        colours = style.colours
        swatches = [element("li", swatch(colours[shown.index]), " ", shown.label)
                    for shown in style.swatches]  # fmt: skip
        parts.append(element("ul", *swatches, class_="swatches"))
    return joined(parts)


def swatch(colour: Iterable[int]) -> Markup:
    square = element("rect", x=0.5, y=0.5, width=13, height=13, fill=hex_of(colour), class_="edge")
    return element("svg", square, width=14, height=14, aria_hidden="true", class_="swatch")


def hex_of(colour: Iterable[int]) -> str:
    return "#" + "".join(f"{int(channel):02x}" for channel in colour)


def _bar(style: LayerStyle, bar: ColourBar, key: str) -> Markup:
    colours = style.colours[np.asarray(bar.indices, dtype=np.intp)]
    last = len(colours) - 1
    stops = [element("stop", offset=round(k / max(last, 1), 4), stop_color=hex_of(colours[k]))
             for k in _stops(colours.astype(np.float64))]  # fmt: skip
    gradient = element("linearGradient", *stops, id=key)
    box: Any = {"x": 0.5, "y": 0.5, "width": _BAR_WIDTH - 1, "height": _BAR}
    area = element("rect", **box, fill=f"url(#{key})", class_="edge")
    label = f"{bar.unit}: " + ", ".join(text for _, text in sorted(bar.ticks))
    bar_drawn = element(
        "svg", element("defs", gradient), area, *_ticks(bar.ticks),
        viewBox=f"0 0 {_BAR_WIDTH} {_BAR + 22}", class_="bar", role="img", aria_label=label,
    )  # fmt: skip
    return element("figure", element("figcaption", bar.unit), bar_drawn)


def _stops(colours: NDArray[np.float64]) -> list[int]:
    """Return few places between which the colours change evenly, near enough."""

    def between(first: int, last: int) -> list[int]:
        share = np.linspace(0.0, 1.0, last - first + 1)[:, np.newaxis]
        line = colours[first] * (1 - share) + colours[last] * share
        off = np.abs(colours[first : last + 1] - line).max(axis=1)
        if off.max() <= _CLOSE:
            return []
        middle = first + int(np.argmax(off))
        return [*between(first, middle), middle, *between(middle, last)]

    last = len(colours) - 1
    return [0, *between(0, last), last] if last > 0 else [0]


def _ticks(ticks: Sequence[tuple[float, str]]) -> list[Markup]:
    used_ranges: list[tuple[float, float]] = []
    parts = []
    for share, text in sorted(ticks, key=lambda tick: (0 < tick[0] < 1, tick[0])):
        x, width = 0.5 + share * (_BAR_WIDTH - 1), _BAR_LETTER * len(text)
        start = min(max(x - width / 2, 0.0), _BAR_WIDTH - width)
        if any(start < end + 4 and begin < start + width + 4 for begin, end in used_ranges):
            continue
        used_ranges.append((start, start + width))
        anchor = "start" if start == 0 else "end" if start == _BAR_WIDTH - width else "middle"
        at = {"start": 0.0, "end": float(_BAR_WIDTH), "middle": x}[anchor]
        parts.append(element("line", x1=x, x2=x, y1=_BAR, y2=_BAR + 4, stroke="currentColor"))
        parts.append(element("text", text, x=round(at, 2), y=_BAR + 4 + _LABEL, text_anchor=anchor))
    return parts


def curve_figure(curve: CostCurve) -> Markup:
    image, file = cost_curve_image(curve, title="Cost curve"), io.BytesIO()
    write_png(file, image.indices, image.palette)
    source = f"{_PNG}{base64.b64encode(file.getvalue()).decode()}"
    picture = element("img", src=source, alt=curve_text(curve))
    plot = element("div", picture, class_="wide", tabindex=0, role="group", aria_label="Plot")
    return element("figure", plot, class_="curve")


def body_of(report: Report) -> Markup:
    several = len(report.entries) > 1
    parts = [_maps(report.entries)] if several else []
    parts += [_entry(entry, k, several=several) for k, entry in enumerate(report.entries)]
    return joined(parts)


def subtitle_of(report: Report) -> str:
    entries = report.entries
    if len(entries) > 1:
        shared = shared_by(entries)
        errors, warnings = map(sum, zip(*map(_counts, entries), strict=True))
        counts = {
            "failed": sum(entry.status == _FAILED for entry in entries),
            "without layers": sum(not e.layers for e in entries if e.status != _FAILED),
            "sound": sum(state_of(entry, shared) == "good" for entry in entries),
        }
        texts = [count_text(len(entries), "map")]
        texts += [count_text(errors, "error"), count_text(warnings, "warning")]
        texts += [f"{count} {words}" for words, count in counts.items() if count]
        return ", ".join(texts)
    figures = [_figure(k, v) for k, v in entries[0].figures.items() if k not in _IN_SIZE_TEXT]
    return ", ".join([_size_text(entries[0]), *figures])


def _figure(name: str, value: str | float) -> str:
    words, _, unit = name.rpartition(" ")
    is_unit = words and unit in ("%", "m", "m2", "m\u00b2")
    return f"{words} {_text(value)} {unit}" if is_unit else f"{name} {_text(value)}"


def _size_text(entry: Entry) -> str:
    if not entry.layers:
        return "no layers"
    frame = entry.layers[-1].frame
    across, along = (f"{metres:.4g}" for metres in frame.size_xy)
    cells = f"{frame.width} \u00d7 {frame.height} cells of {frame.resolution:.6g} m"
    return f"{cells}, {across} \u00d7 {along} m"


def _text(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:,.6g}"


def _counts(entry: Entry) -> tuple[int, int]:
    errors = sum(item.tone == "error" for item in entry.items)
    warnings = sum(item.tone == "warning" for item in entry.items)
    if entry.status == _FAILED:  # its warnings are the reasons
        return errors or max(1, len(entry.warnings)), warnings
    return errors, warnings + len(entry.warnings)


def _verdict(claims: Iterable[Content], command: str) -> Markup:
    parts = [element("ul", *claims)]
    if command:
        code = element("code", verdicts.portable_command(command))
        parts.append(element("p", "Next: ", code, class_="next"))
    return element("section", *parts, class_="verdict", aria_label="Verdict")


def _claim(state: State, *content: Content) -> Markup:
    sign = element("b", _STATES[state], class_=f"sign {state}")
    return element("li", sign, " ", element("span", *content), class_=f"claim {state}")


def _verdict_on(entry: Entry, number: int) -> Markup:
    places = {table.title: (f"table-{number}-{k}", table.title)
              for k, table in enumerate(entry.tables)}  # fmt: skip
    for k, (title, kinds) in enumerate(_lists(entry)):
        places |= dict.fromkeys(kinds, (f"list-{number}-{k}", title))
    claims: list[Content] = []
    for claim in sorted(entry.claims, key=lambda claim: get_args(State).index(claim.state)):
        text: list[Content] = [f"{claim.text}."]
        if claim.evidence in places:
            place, title = places[claim.evidence]
            text += [" ", element("a", title, href=f"#{place}", class_="evidence")]
        claims.append(_claim(claim.state, *text))
    return _verdict(claims, entry.next_command)


def _verdict_on_all(entries: tuple[Entry, ...]) -> Markup:
    shared = shared_by(entries)
    numbers_by_state: dict[State, list[int]] = {state: [] for state in get_args(State)}
    for number in _by_urgency(entries, shared):
        numbers_by_state[state_of(entries[number], shared)].append(number)
    claims = [_claim_on(state, numbers, entries) for state, numbers in numbers_by_state.items()
              if numbers and state in ("error", "warning")]  # fmt: skip
    claims += [_claim(claim.state, f"All maps: {claim.text}.") for claim in shared]
    good, unknown = len(numbers_by_state["good"]), len(numbers_by_state["unknown"])
    counts = [f"{good} {'is' if good == 1 else 'are'} sound"] if good else []
    counts += [f"{unknown} {'was' if unknown == 1 else 'were'} not checked"] if unknown else []
    if counts:
        claims.append(_claim("good" if good else "unknown", f"{', '.join(counts)}."))
    return _verdict(claims[:MOST_CLAIMS], most_urgent(verdicts_of(entries)))


def _claim_on(state: State, numbers: Sequence[int], entries: tuple[Entry, ...]) -> Markup:
    verb = "should be checked"
    if state == "error":
        verb = "has a problem" if len(numbers) == 1 else "have a problem"
        failed = sum(entry.status == _FAILED for entry in entries)
        verb += f" ({failed} failed)" if failed else ""
    text = f"{len(numbers)} of {count_text(len(entries), 'map')} {verb}: "
    return _claim(state, text, *_links(numbers, entries))


def _links(numbers: Sequence[int], entries: tuple[Entry, ...]) -> Iterator[Content]:
    for index, number in enumerate(numbers[:_MOST_NAMED]):
        yield ", " if index else ""
        yield element("a", *_with_line_breaks(entries[number].name), href=f"#entry-{number}")
    yield f" and {len(numbers) - _MOST_NAMED} more." if len(numbers) > _MOST_NAMED else "."


def _with_line_breaks(path: str) -> Iterator[Content]:
    first, *names = path.split("/")
    yield first
    for name in names:
        yield from ("/", element("wbr"), name)


def _maps(entries: tuple[Entry, ...]) -> Markup:
    columns: dict[tuple[object, ...], str] = {}  # without those that repeat another
    for name in dict.fromkeys(name for entry in entries for name in entry.figures):
        columns.setdefault(tuple(entry.figures.get(name) for entry in entries), name)
    names = list(columns.values())
    cells = [_head(name, entries) for name in ["Map", "Verdict", "Errors", "Warnings", *names]]
    shared = shared_by(entries)
    rows = [_row(entries[k], k, names, shared) for k in _by_urgency(entries, shared)]
    field = element("input", type="search", id="filter", autocomplete="off")
    count = element("span", f"{len(entries)} maps", id="count", role="status")
    by_title: Any = {"aria_labelledby": "maps-title"}
    table = _with_heads(cells, rows)
    return element(
        "section", _verdict_on_all(entries), element("h2", "Maps", id="maps-title", tabindex=-1),
        element("p", element("label", "Filter ", field), " ", count, class_="search"),
        element("div", table, class_="wide", tabindex=0, role="group", **by_title),
        id="maps", **by_title,
    )  # fmt: skip


def _by_urgency(entries: tuple[Entry, ...], shared: Sequence[Claim]) -> list[int]:
    def urgency(number: int) -> tuple[bool, int, int, int]:
        entry = entries[number]
        errors, warnings = _counts(entry)
        state = list(_STATES).index(state_of(entry, shared))
        return entry.status != _FAILED, state, -errors, -warnings

    return sorted(range(len(entries)), key=urgency)


def _with_heads(heads: list[Markup], rows: list[Markup]) -> Markup:
    head = element("thead", element("tr", element("td"), *heads))
    return element("table", head, element("tbody", *rows))


def _section(heading: str, *content: Content, label: str = "", **attributes: Value) -> Markup:
    attributes["aria_label"] = label or heading
    return element("section", element("h3", heading), *content, **attributes)


def _head(name: str, entries: tuple[Entry, ...]) -> Markup:
    words = _HEADS.get(name, f"{name[:1].upper()}{name[1:]}")
    button = element("button", words, type="button", data_sort=True)
    values = [entry.figures[name] for entry in entries if name in entry.figures]
    css = _css(number=_is_number(name, values), more=bool(values))
    return element("th", button, scope="col", class_=css)


def _is_number(name: str, values: Sequence[object]) -> bool:
    return name in (*_COUNTS, "cells") or any(not isinstance(value, str) for value in values)


def _css(**classes: bool) -> str | None:
    return " ".join(name for name, is_given in classes.items() if is_given) or None


def _row(entry: Entry, number: int, names: list[str], shared: Sequence[Claim]) -> Markup:
    look: Any = {"role": "img", "aria_label": f"Thumbnail of {entry.name}"}
    canvas = element("canvas", width=144, height=108, data_entry=number, **look)
    state, is_failed = state_of(entry, shared), entry.status == _FAILED
    sign = element("b", "Failed" if is_failed else _STATES[state], class_=f"sign {state}")
    rank = list(_STATES).index(state) - is_failed
    cells = [element("td", canvas if entry.layers else "", class_="thumb")]
    cells += [_row_head(entry, number, shared), element("td", sign, data_value=str(rank))]
    cells += [
        element("td", str(count), class_=_css(number=True, none=not count), data_count=name)
        for name, count in zip(_COUNTS, _counts(entry), strict=True)
    ]
    for name in names:
        value = entry.figures.get(name, "")
        data = value if isinstance(value, str) else repr(float(value))
        css = _css(number=_is_number(name, [value]), more=True)
        cells.append(element("td", _text(value), data_value=data, class_=css))
    return element("tr", *cells)


def _row_head(entry: Entry, number: int, shared: Sequence[Claim]) -> Markup:
    parts = [element("a", *_with_line_breaks(entry.name), href=f"#entry-{number}")]
    claims = [claim for claim in entry.claims if claim not in shared]
    worst = min(claims, key=lambda claim: get_args(State).index(claim.state), default=None)
    if worst is not None and worst.state in ("error", "warning"):
        # the text on findings without the counts, which the row has
        reason = worst.text.partition(": ")[2] if worst.about == "map" else worst.text
        parts.append(element("span", reason, class_="reason"))
    return element("th", *parts, scope="row", data_value=entry.name)


def _entry(entry: Entry, number: int, *, several: bool) -> Markup:
    parts: list[Content] = []
    if several:
        parts.append(element("p", element("a", "\u2190 All maps", href="#maps"), class_="back"))
        parts.append(element("h2", *_with_line_breaks(entry.name), tabindex=-1))
        size = _size_text(entry) if entry.layers or not entry.status else ""
        parts.append(element("p", ", ".join(filter(None, (entry.status, size))), class_="subtitle"))
    else:
        parts.append(element("h2", entry.name, class_="unseen"))  # between headings 1 and 3
    parts += [_verdict_on(entry, number)] if entry.claims or entry.next_command else []
    if entry.warnings and not (entry.status == _FAILED and entry.claims):  # then claims name them
        lines = element("ul", *(element("li", text) for text in entry.warnings))
        noun = "error" if entry.status == _FAILED else "warning"
        title = count_text(len(entry.warnings), noun)
        parts.append(_section(title, lines, class_=f"warnings {noun}"))
    tables = [_table(table, f"table-{number}-{k}") for k, table in enumerate(entry.tables)]
    if entry.curve is not None:
        figure = curve_figure(entry.curve)
        tables.insert(0, _section("Costs over distance", figure, label="Cost curve"))
    below = element("div", *tables, class_="rest")
    if entry.layers:
        slot = element("div", class_="slot")
        parts.append(element("div", slot, _panels(entry, number), below, class_="work"))
    else:
        parts.append(element("p", "This map has no layer to show.", class_="notice"))
        parts += [_items(entry, number), below]
    return element("section", *parts, class_="entry", id=f"entry-{number}", aria_label=entry.name)


def _panels(entry: Entry, number: int) -> Markup:
    count = len(entry.layers)
    on = (count - 1,) if entry.is_sequence else (0, count - 1)
    rows = [_layer(entry.layers[k], k, number, k in on) for k in reversed(range(count))]
    parts = [_section("Layers", element("ul", *rows), class_="layers")]
    if entry.is_sequence:
        slider = _slider(count - 1, "Time of the costmap", name="time")
        parts.insert(0, _section("Time", slider, class_="time scripted-only"))
    below = [_readout(entry.layers), _items(entry, number)]
    parts += below if entry.compared is None or entry.opens_swiped else below[::-1]
    parts += [_compare(entry, number)] if count > 1 else []
    return element("div", *parts, class_="panels")


def _layer(layer: PageLayer, k: int, number: int, is_on: bool) -> Markup:
    box = element("input", type="checkbox", checked=is_on, autocomplete="off")
    slider, label = _slider(100, f"Opacity of {layer.title}"), f"Show only {layer.title}"
    look: Any = {"type": "button", "data_only": k, "class_": "only", "aria_label": label}
    only = element("button", "only", **look)
    head = element("div", element("label", box, " ", layer.title), slider, only, class_="head")
    legend = element("div", legend_of(layer.style, f"bar-{number}-{k}"), class_="legend")
    return element("li", head, legend, class_="layer", data_layer=k)


def _slider(largest: int, label: str, **name: Value) -> Markup:
    ends: Any = {"min": 0, "max": largest, "value": largest, "autocomplete": "off"}
    return element("input", type="range", **name, **ends, aria_label=label)


def _compare(entry: Entry, number: int) -> Markup:
    names = [layer.name for layer in entry.layers]
    pair = entry.compared or (names[-2], names[-1])
    selects = []
    for side, chosen in zip(("Left", "Right"), pair, strict=True):
        options = [element("option", layer.title, value=k, selected=k == names.index(chosen))
                   for k, layer in enumerate(entry.layers)]  # fmt: skip
        select = element("select", *options, autocomplete="off")
        selects.append(element("label", f"{side} ", select))
    first = "swipe" if entry.compared is not None and entry.opens_swiped else "layers"
    modes = []
    look: Any = {"type": "radio", "name": f"view-{number}"}
    for mode, text in _MODES.items():
        button = element("input", **look, value=mode, autocomplete="off", checked=mode == first)
        modes.append(element("label", button, f" {text}", class_="toggle"))
    row = element("p", *modes, class_="toggles modes", role="group", aria_label="View")
    return _section("Compare", row, *selects, class_="compare scripted-only")


def _readout(layers: tuple[PageLayer, ...]) -> Markup:
    names = ["x, y [m]", "row, column", *(layer.title for layer in layers)]
    cells = element("td"), element("td")
    rows = [element("tr", element("th", name, scope="row"), *cells) for name in names]
    heads = [element("th", name, scope="col") for name in ("Pointer", "Pinned")]
    return _section("Values", _with_heads(heads, rows), class_="readout scripted-only")


def _lists(entry: Entry) -> list[tuple[str, list[str]]]:
    lists: dict[str, list[str]] = {}
    for kind in sorted({item.kind for item in entry.items}, key=list(_KINDS).index):
        lists.setdefault(_IN_ONE_LIST.get(kind, _KINDS[kind]), []).append(kind)
    return list(lists.items())


def _items(entry: Entry, number: int) -> Markup:
    items = entry.items
    if not items:
        return joined([])
    boxes = []
    for kind in (kind for _, kinds in _lists(entry) for kind in kinds):
        box = element("input", type="checkbox", value=kind, checked=True, autocomplete="off")
        of_kind = [item for item in items if item.kind == kind]
        if kind in _IN_ONE_LIST:  # without the line about changes that are left out
            of_kind = [item for item in of_kind if item.place is not None]
        boxes.append(element("label", box, f" {_KINDS[kind]} ({len(of_kind)})"))
    lists = []
    for index, (title, kinds) in enumerate(_lists(entry)):
        groups: dict[object, list[int]] = {}
        for k, item in enumerate(items):
            if item.kind in kinds:
                groups.setdefault(item.group or k, []).append(k)
        rows, name = _fold_notes(items, groups.values()), f"list-{number}-{index}"
        lists.append(element("ul", *rows, aria_label=title, id=name, tabindex=-1))
    return _section("On the map", element("p", *boxes, class_="kinds"), *lists, class_="items")


def _fold_notes(items: Sequence[Item], groups: Iterable[Sequence[int]]) -> list[Markup]:
    """Return groups of items as rows of a list; more than a few notes become one row that opens."""
    rows: list[Markup] = []
    notes: list[Markup] = []
    for group in groups:
        first = items[group[0]]
        is_note = first.kind == "finding" and first.tone == "note"
        (notes if is_note else rows).append(_group(items, group))
    if len(notes) > _MOST_NOTES:
        head = element("summary", element("b", f"{len(notes)} notes", class_="tone note"))
        notes = [element("li", element("details", head, element("ul", *notes), class_="notes"))]
    return rows + notes


def _group(items: Sequence[Item], group: Sequence[int]) -> Markup:
    first = items[group[0]]
    if len(group) == 1:
        return _item(first, group[0], first.text)
    texts = [items[k].text.partition(": ")[2] or items[k].text for k in group]
    findings = sum(not text.startswith(_PLACE) for text in texts)  # each at its first place
    count = count_text(len(group), "place") if findings == 1 else count_text(findings, "finding")
    if texts[1].startswith(_PLACE):
        texts[0] = f"{_PLACE}1"  # the line above has its text
    rows = []
    for k, text in zip(group, texts, strict=True):
        place = items[k].place
        if place is not None and text.startswith(_PLACE):
            text = f"{text} at {place_text(place)}"
        rows.append(_item(items[k], k, text, has_tone=False))
    head = element("summary", _with_tone(first, first.text), " ", element("i", f"({count})"))
    css = _css(notes=first.tone == "note")
    return element("li", element("details", head, element("ul", *rows), class_=css))


def _item(item: Item, number: int, words: str, *, has_tone: bool = True) -> Markup:
    text: Content = _with_tone(item, words) if has_tone else words
    if item.place is None and not item.lines:
        return element("li", element("span", text))
    return element("li", element("button", text, type="button", data_item=number))


def _with_tone(item: Item, words: str) -> Content:
    tone = item.kind if item.kind in _IN_ONE_LIST else item.tone
    if tone in ("good", "plain"):
        return words
    return joined([element("b", tone, class_=f"tone {tone}"), " ", words])


def _table(table: Table, name: str) -> Markup:
    rows = [element("tr", element("th", key, scope="row"), element("td", value))
            for key, value in table.rows]  # fmt: skip
    body = element("table", element("tbody", *rows))
    return element("details", element("summary", table.title), body, id=name)


def page_of(report: Report, *, size: int) -> Iterator[bytes]:
    """Yield a page in pieces, the same bytes for the same report."""
    script, style = script_text(), _part("page.css")
    before, between, after = _part("page.html").split("<!-- split -->\n")
    policy = f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
    fields = {
        "policy": f"{policy}img-src data:; base-uri 'none'; form-action 'none'",
        "title": escaped(report.title), "subtitle": escaped(subtitle_of(report)),
        "version": escaped(report.version), "style": style, "body": body_of(report).text,
    }  # fmt: skip
    head = Template(before).substitute(fields).encode()
    yield head
    layers = [layer for entry in report.entries for layer in entry.layers]
    without_tiles = _json(_header(report, [{} for _ in layers]))
    room = int((1 - _HEADER_SHARE) * (size - len(head) - len(without_tiles) - len(script)))
    pictures = encoded(layers, size=max(room, 0))
    yield from pictures.data
    yield between.encode()
    yield _json(_header(report, pictures.layers)).encode()
    yield Template(after).substitute(script=script).encode()


def _header(report: Report, tiles: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the page's data for the script: all but the tiles, which it refers to by offset."""
    styles: dict[str, int] = {}
    tiles_of_layers = iter(tiles)
    entries = []
    for entry in report.entries:
        layers, areas = [], [layer.frame for layer in entry.layers]
        for layer in entry.layers:
            style = styles.setdefault(_json(_style(layer.style)), len(styles))
            references = {"style": style, "area": areas.index(layer.frame)}
            layers.append(_page_layer(layer) | references | next(tiles_of_layers))
        entries.append(_page_entry(entry) | {"layers": layers})
    return {"tile": TILE, "styles": [json.loads(style) for style in styles], "entries": entries}


def script_text() -> str:
    lines = "\n".join(_part(name) for name in SCRIPTS).splitlines()
    return "\n".join(line for line in lines if line.strip() and not line.lstrip().startswith("//"))


def _part(name: str) -> str:
    module: Any = sys.modules["mapdeal.report"]
    path = os.path.join(os.path.dirname(module.__file__), "page", name)  # noqa: PTH118, PTH120 - as loaders take it
    return str(module.__spec__.loader.get_data(path), "utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _bytes(values: NDArray[np.uint8]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=np.uint8).tobytes()).decode()


def _style(style: LayerStyle) -> dict[str, Any]:
    pixels = np.zeros((len(style.colours) + 1, 4), dtype=np.uint8)  # the last is no colour at all
    pixels[:-1, :3] = style.colours
    pixels[:-1, 3] = 255
    scale = None
    if style.scale is not None:
        low, high, levels = style.scale.low, style.scale.high, style.scale.levels
        factor = levels / ((high - low) or 1.0)
        scale = {"low": low, "factor": factor, "first": style.scale.first, "levels": levels}
    return {
        "pixels": _bytes(pixels),
        "byValue": None if style.by_value is None else _bytes(style.by_value),
        "scale": scale,
        "nowhere": len(style.colours) if style.nowhere is None else style.nowhere,
        "line": style.line,
        "fadedBy": style.faded_by or 0,
        "labels": {str(value): one_line(label) for value, label in sorted(style.labels.items())},
    }


def _page_layer(layer: PageLayer) -> dict[str, Any]:
    frame = {key: getattr(layer.frame, key) for key in ("width", "height", "resolution")}
    return {
        **{name: one_line(getattr(layer, name)) for name in ("name", "title", "unit")},
        "frame": frame | dict(zip(("x", "y", "yaw"), layer.frame.origin, strict=True)),
        "states": layer.states, "convention": layer.convention, "lethal": layer.lethal_threshold,
        "pooled": layer.pooled, "opaque": layer.is_bytes or layer.style.nowhere is not None,
    }  # fmt: skip


def _page_entry(entry: Entry) -> dict[str, Any]:
    corners = []
    for frame in (layer.frame for layer in entry.layers):
        ends = [(row, col) for row in (0, frame.height) for col in (0, frame.width)]
        corners.append(frame.xy_from_continuous_rowcol(ends))
    full_box = _box(np.vstack(corners)) if corners else None
    return {
        "name": one_line(entry.name),
        "whole": full_box,
        "extent": full_box if entry.extent is None else list(entry.extent),
        "items": [_page_item(item) for item in entry.items],
    }


def _box(points: NDArray[np.float64]) -> list[float]:
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def _page_item(item: Item) -> dict[str, Any]:
    place = [] if item.place is None else [np.array([item.place], dtype=np.float64)]
    points = [line for line in (*place, *item.lines) if len(line)]
    return {
        "kind": item.kind,
        "tone": item.tone,
        "place": None if item.place is None else [float(value) for value in item.place],
        "lines": [np.round(line, 4).tolist() for line in item.lines],
        "label": one_line(item.label),
        **({} if item.zone is None else {"zone": asdict(item.zone)}),
        "box": _box(np.vstack(points)) if points else None,
    }
