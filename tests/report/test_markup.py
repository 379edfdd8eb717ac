from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.report.page import Markup, element, escaped, joined


class Reader(HTMLParser):
    """What Python's own parser finds: elements with their attributes, and text."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.tags, self.text = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)


def read(markup):
    reader = Reader()
    reader.feed(markup.text)
    reader.close()
    return reader.tags, "".join(reader.text)


NASTY = st.text(
    st.sampled_from("<>&\"'/=!-[] \n\t\x00\x1b\u2028\u202e\ud800aimgscrpt"), max_size=30
)


@given(NASTY, NASTY)
def test_text_and_attributes_stay_what_they_are(text, value):
    tags, found = read(element("p", text, title=value))
    assert [tag for tag, _ in tags] == ["p"]
    visible = all(character.isprintable() for character in text + value)
    if visible:
        assert found == text
        assert tags[0][1] == {"title": value}
    else:
        assert all(character.isprintable() for character in found)


@given(st.text())
def test_what_is_written_is_utf_8_without_markup(text):
    assert not set("<>\"'") & set(escaped(text))
    escaped(text).encode("utf-8")


def test_characters_that_cannot_be_seen_are_spelled_out():
    assert escaped("a\u202eb\x00c\ud800") == "a\\u202eb\\x00c\\ud800"


def test_pieces_are_joined_as_they_are_and_text_is_not():
    assert joined([element("b", "1"), "<", element("br")]).text == "<b>1</b>&lt;<br>"


def test_attributes_may_be_names_alone_or_left_out():
    made = element("input", checked=True, hidden=False, value=None, max=0.5, aria_label="x")
    assert made == Markup('<input checked max="0.5" aria-label="x">')


@pytest.mark.parametrize("name", ["style", "onclick", "onerror", "src", "srcset", "action"])
def test_attributes_that_run_or_load_are_refused(name):
    with pytest.raises(ValueError, match=name):
        element("p", **{name: "x"})


@pytest.mark.parametrize("link", ["https://example.org", "javascript:alert(1)", " #a", ""])
def test_links_lead_to_the_page_itself(link):
    assert element("a", href="#a").text == '<a href="#a"></a>'
    with pytest.raises(ValueError, match="page itself"):
        element("a", href=link)


@pytest.mark.parametrize("name", ["script", "style"])
def test_nothing_is_put_where_text_would_be_code(name):
    with pytest.raises(ValueError, match=name):
        element(name, "x")
