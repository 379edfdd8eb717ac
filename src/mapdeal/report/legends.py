"""The legend of a layer, as inline SVG: the colours of its style, as pictures have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.render.style import ColourBar, LayerStyle
from mapdeal.report.markup import Content, Markup, element, joined

_WIDTH, _BAR, _LABEL = 288, 12, 11  # of a colour bar, in pixels of the panel
_LETTER = 6.5  # pixels at most that a character takes
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
    """Return a small square of a colour."""
    square = element("rect", x=0.5, y=0.5, width=13, height=13, fill=colour, class_="edge")
    return element("svg", square, width=14, height=14, aria_hidden="true", class_="swatch")


def hex_of(colour: NDArray[np.uint8]) -> str:
    """Return a colour as SVG has it."""
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
        "rect", x=0.5, y=0.5, width=_WIDTH - 1, height=_BAR, fill=f"url(#{key})", class_="edge"
    )
    label = f"{bar.unit}: " + ", ".join(text for _, text in sorted(bar.ticks))
    return element(
        "figure",
        element("figcaption", bar.unit),
        element(
            "svg", element("defs", gradient), area, *_ticks(bar.ticks),
            viewBox=f"0 0 {_WIDTH} {_BAR + 22}", class_="bar", role="img", aria_label=label,
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
        x = 0.5 + share * (_WIDTH - 1)
        width = _LETTER * len(text)
        start = min(max(x - width / 2, 0.0), _WIDTH - width)
        if any(start < end + 4 and begin < start + width + 4 for begin, end in taken):
            continue
        taken.append((start, start + width))
        anchor = "start" if start == 0 else "end" if start == _WIDTH - width else "middle"
        at = {"start": 0.0, "end": float(_WIDTH), "middle": x}[anchor]
        parts.append(element("line", x1=x, x2=x, y1=_BAR, y2=_BAR + 4, stroke="currentColor"))
        parts.append(element("text", text, x=round(at, 2), y=_BAR + 4 + _LABEL, text_anchor=anchor))
    return parts
