"""The body of a page: all that is text, readable without a script."""

from __future__ import annotations

from collections.abc import Iterator

from mapdeal.report.curve import curve_figure
from mapdeal.report.document import Entry, Item, PageLayer, Report, Table
from mapdeal.report.legends import legend_of
from mapdeal.report.markup import Content, Markup, element, joined

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
    """Return the key figures of a report, in one line."""
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
        "table",
        element("thead", element("tr", element("td"), *cells)),
        element("tbody", *rows),
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
