"""Pieces of markup, and the curve of the costs, as a parser reads them."""

import base64
from html.parser import HTMLParser

import pytest
from hypothesis import given, strategies as st

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
    *[("img", {"src": link}, "src") for link in ("a.png", "data:text/html,x", "//example.org")],
    *[("a", {"href": link}, "page itself")
      for link in ("https://example.org", "javascript:alert(1)", " #a", "")],
    ("script", {}, "script"), ("style", {}, "style"),
])  # fmt: skip
def test_what_runs_loads_or_leads_elsewhere_is_refused(name, attributes, message):
    with pytest.raises(ValueError, match=message):
        element(name, "x", **attributes)


CURVE = mapdeal.cost_curve(0.05, inscribed_radius=0.2, inflation_radius=0.6)


def test_a_cost_curve_is_the_picture_that_the_command_writes():
    tags, _ = read(curve_figure(CURVE))
    (image,) = (attributes for tag, attributes in tags if tag == "img")
    data = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"))
    assert data == mapdeal.draw_picture(CURVE, title="Cost curve").png()


def test_a_cost_curve_is_told_in_words_too():
    tags, _ = read(curve_figure(CURVE))
    (text,) = (attributes["alt"] for tag, attributes in tags if tag == "img")
    for words in (
        "inscribed radius: 0.2 m", "inflation radius: 0.6 m", "obstacle cost 254",
        "collision at any heading up to 0.2 m: 253",
    ):  # fmt: skip
        assert words in text
