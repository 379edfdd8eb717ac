"""Pieces of markup, and the curve of the costs, as a parser reads them."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapdeal
from mapdeal.report.page import Markup, curve_figure, element, escaped, joined


class Reader(HTMLParser):
    """What Python's own parser finds: elements, text, and each script and style."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.raw, self.text = [], [], []
        self._open = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._open = [tag, dict(attrs), ""]

    def handle_endtag(self, tag):
        if self._open and tag == self._open[0]:
            self.raw.append(self._open)
            self._open = None

    def handle_data(self, data):
        if self._open:
            self._open[2] += data
        else:
            self.text.append(data)

    def script(self, name):
        return next(text for _, attrs, text in self.raw if attrs.get("id") == name)


def read(markup):
    reader = Reader(markup.text)
    return reader.tags, "".join(reader.text)


NASTY = st.text(
    st.sampled_from("<>&\"'/=!-[] \n\t\x00\x1b\u2028\u202e\ud800aimgscrpt"), max_size=30
)


@given(NASTY, NASTY)
def test_texts_and_attributes_are_read_back(text, value):
    tags, found = read(element("p", text, title=value))
    assert [tag for tag, _ in tags] == ["p"]
    if (text + value).isprintable():
        assert (found, tags[0][1]) == (text, {"title": value})
    else:
        assert found.isprintable()


@given(st.text())
def test_what_is_written_is_utf_8_without_markup(text):
    assert not set("<>\"'") & set(escaped(text))
    escaped(text).encode("utf-8")


def test_characters_that_cannot_be_seen_are_spelled_out():
    assert escaped("a\u202eb\x00c\ud800") == "a\\u202eb\\x00c\\ud800"


def test_pieces_are_joined_as_they_are_and_text_is_not():
    assert joined([element("b", "1"), "<", element("br")]).text == "<b>1</b>&lt;<br>"
    assert element("a", href="#a").text == '<a href="#a"></a>'  # links lead to the page itself


def test_attributes_may_be_names_alone_or_left_out():
    markup = element("input", checked=True, hidden=False, value=None, max=0.5, aria_label="x")
    assert markup == Markup('<input checked max="0.5" aria-label="x">')


@pytest.mark.parametrize(("name", "attributes", "message"), [
    *[("p", {name: "x"}, name)
      for name in ("style", "onclick", "onerror", "src", "srcset", "action")],
    *[("a", {"href": link}, "page itself")
      for link in ("https://example.org", "javascript:alert(1)", " #a", "")],
    ("script", {}, "script"), ("style", {}, "style"),
])  # fmt: skip
def test_what_runs_loads_or_leads_elsewhere_is_refused(name, attributes, message):
    with pytest.raises(ValueError, match=message):
        element(name, "x", **attributes)


CURVE = mapdeal.cost_curve(0.05, inscribed_radius=0.2, inflation_radius=0.6)


def test_dots_stand_at_each_whole_cell_with_its_cost():
    markup = curve_figure(CURVE).text
    number = r'"([\d.]+)"'
    below = re.findall(rf'<text x={number} y="[\d.]+" text-anchor="middle">([\d.]+)<', markup)
    beside = re.findall(rf'<text x="[\d.]+" y={number} text-anchor="end">(\d+)<', markup)
    label = {float(metres): float(x) for x, metres in below}
    rows = {float(cost): float(y) - 4 for y, cost in beside}
    (m0, x0), (m1, x1) = min(label.items()), max(label.items())
    circles = re.findall(rf"<circle cx={number} cy={number}", markup)
    dots = [(float(x), float(y)) for x, y in circles]
    metres = [m0 + (x - x0) / (x1 - x0) * (m1 - m0) for x, _ in dots]
    costs = [(rows[0.0] - y) / (rows[0.0] - rows[254.0]) * 254 for _, y in dots]
    is_integer = CURVE.cells == np.floor(CURVE.cells)
    assert metres == pytest.approx((CURVE.cells[is_integer] * 0.05).tolist(), abs=1e-3)
    assert costs == pytest.approx(CURVE.cost[is_integer].tolist(), abs=0.05)


def test_zones_and_marks_are_described_in_words_and_colours_are_attributes():
    tags, text = read(curve_figure(CURVE))
    for words in ("inscribed radius: 0.2 m", "inflation radius: 0.6 m"):
        assert words in text
    figure = next(attrs for tag, attrs in tags if tag == "svg" and attrs.get("role") == "img")
    for place in (text, figure["aria-label"]):
        assert "collision at any heading" in place
    assert not [attrs for _, attrs in tags if "style" in attrs]
    assert {attrs["fill"] for tag, attrs in tags if tag == "rect"} >= {"#101014", "#00bec8"}
    # and the costs of occupancy end at 100
    _, text = read(curve_figure(mapdeal.cost_curve(0.05, model="threshold")))
    assert ("254" in text, "100" in text) == (False, True)
