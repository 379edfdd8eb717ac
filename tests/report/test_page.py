import base64
import hashlib
import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal.report.document import Claim, Entry, Item, Report, Table, page_layers
from mapdeal.report.page import Markup, curve_figure, element, escaped, joined, page_of, script_text

GRID = grid_from_text("""
    ?.....#?
    ?..#...?
    #......?
    """)

ATTACKS = (
    "<img src=x onerror=alert(1)>", "</script><script>alert(1)</script>", "a&amp;b", "\"'`",
    "\u2028x", "tab\tbell\x07", "\u202egnp.exe", "<!--", "]]>", "$policy ${script}",
)  # fmt: skip


def layers_of(grid):
    """Return the map, its distance field and its costs, as the page takes them."""
    field = mapdeal.esdf(grid)
    costs = mapdeal.exponential_cost(grid, inscribed_radius=0.2, inflation_radius=0.8)
    states = page_layers(grid, "occupancy", "Map")[-1]
    metres = replace(page_layers(field, "esdf", "Signed distance")[-1], states="occupancy")
    return (states, metres, page_layers(costs, "cost", "Cost")[-1]), field, costs


def entry_of(grid, name="office", **more):
    layers, _, _ = layers_of(grid)
    return Entry(name, layers, **more)


def parsed(report):
    return Reader(b"".join(page_of(report, size=25_000_000)).decode())


def report_saying(*texts):
    items = tuple(Item("finding", text, "warning", (0.0, 0.0), (), text) for text in texts)
    more = {"items": items, "warnings": texts}
    more["tables"] = (Table(texts[0], tuple((text, text) for text in texts)),)
    entries = tuple(
        entry_of(GRID, text, status=text, figures={f"{text} {k}": text}, **more)
        for k, text in enumerate(texts)
    )
    return Report(texts[1], entries, texts[0])


def nasty_report():
    return report_saying(*ATTACKS)


def test_the_policy_allows_what_the_page_holds_and_nothing_else():
    page = parsed(Report("office", (entry_of(GRID),), "1.0"))
    sliders = [attrs for _, attrs in page.tags if "Opacity" in (attrs.get("aria-label") or "")]
    assert {(a["min"], a["max"], a["value"]) for a in sliders} == {("0", "100", "100")}
    policy = next(
        attrs["content"] for tag, attrs in page.tags
        if tag == "meta" and attrs.get("http-equiv") == "Content-Security-Policy"
    )  # fmt: skip
    hashes = {}
    for tag, attrs, text in page.raw:
        if attrs.get("type") is None:
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            hashes.setdefault(tag, []).append(f"'sha256-{digest}'")
    assert {tag: len(found) for tag, found in hashes.items()} == {"style": 1, "script": 1}
    assert policy.split("; ") == [
        "default-src 'none'", f"script-src {hashes['script'][0]}",
        f"style-src {hashes['style'][0]}", "img-src data:", "base-uri 'none'",
        "form-action 'none'",
    ]  # fmt: skip
    for _, attrs in page.tags:
        assert not {name for name in attrs if name.startswith("on") or name in ("style", "src")}
        assert attrs.get("href", "#").startswith("#")


def test_markup_in_names_adds_no_element():
    nasty, tame = nasty_report(), report_saying(*["plain/words"] * len(ATTACKS))
    page = parsed(nasty)
    counts = [[tag for tag, _ in parser.tags] for parser in (page, parsed(tame))]
    assert set(counts[0]) == set(counts[1])
    for tag in ("script", "style", "input", "li", "tr", "h2"):
        assert counts[0].count(tag) == counts[1].count(tag)
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    text = "".join(page.text)
    for attack in ATTACKS:
        escapes = {c: c.encode("unicode_escape").decode() for c in attack if not c.isprintable()}
        assert text.count(attack.translate(str.maketrans(escapes))) >= len(ATTACKS)


def test_the_header_describes_what_the_data_hold():
    layers, _, _ = layers_of(GRID)
    item = Item("route", "r", "plain", None, (np.array([[0.1, 0.2], [0.30004, 4]]),), "<l>")
    report = Report("office", (Entry("office", layers, (item,), compared=("esdf", "cost")),), "1.0")
    page = parsed(report)
    header = json.loads(page.script("report"))
    assert "<" not in page.script("report")
    (entry,) = header["entries"]
    corners = [[row, col] for row in (0, 3) for col in (0, 8)]
    xs, ys = GRID.frame.xy_from_continuous_rowcol(corners).T.tolist()
    assert entry["whole"] == entry["extent"] == [min(xs), min(ys), max(xs), max(ys)]
    assert entry["items"] == [
        {"kind": "route", "tone": "plain", "place": None, "lines": [[[0.1, 0.2], [0.3, 4.0]]],
         "label": "<l>", "box": [0.1, 0.2, 0.30004, 4.0]}
    ]  # fmt: skip
    assert [layer["name"] for layer in entry["layers"]] == ["occupancy", "esdf", "cost"]
    frame = {"width": 8, "height": 3, "resolution": 0.25, "x": 1.5, "y": -2.0, "yaw": 0.4}
    assert entry["layers"][1]["frame"] == frame
    data = page.script("data").strip()
    levels = [level for layer in entry["layers"] for level in layer["levels"]]
    assert max(sum(tile) for level in levels for tile in level["tiles"]) == len(data)
    # equal styles appear once
    entries = (entry_of(GRID, "a"), entry_of(GRID, "b"))
    header = json.loads(parsed(Report("two", entries, "1.0")).script("report"))
    assert len(header["styles"]) == 3
    used = [[layer["style"] for layer in entry["layers"]] for entry in header["entries"]]
    assert used == [[0, 1, 2], [0, 1, 2]]


def test_an_entry_without_layers_and_a_page_without_its_script_have_words():
    text = "".join(parsed(Report("broken", (Entry("broken", warnings=("no",)),), "1.0")).text)
    for words in ("This map has no layer to show.", "1 warning", "The maps are drawn by a script"):
        assert words in text


def test_findings_of_a_kind_are_one_line_with_their_places_behind_it():
    texts = ["x.y: 20 specks", *(f"x.y: place {k} of 20" for k in range(2, 21))]
    group = {"group": "x.y"}
    items = [Item("finding", t, "warning", (k / 10, 0.25), **group) for k, t in enumerate(texts)]
    items += [Item("finding", "a.b: alone", "error", (0.0, 0.0), group="a.b")]
    items += [Item("finding", f"c.d: door {k}", "error", (0.0, 0.0), group="c.d") for k in "ab"]
    page = parsed(Report("one", (entry_of(GRID, items=tuple(items)),), "1.0"))
    text = "".join(page.text)
    assert (text.count("20 specks"), text.count("alone")) == (1, 1)
    assert "(20 places)" in text
    assert "place 1 at 0, 0.25place 2 of 20 at 0.1, 0.25" in text
    numbers = [attrs["data-item"] for _, attrs in page.tags if "data-item" in attrs]
    assert numbers == [str(k) for k in range(23)]  # each can be gone to
    assert "c.d: door a (2 findings)door adoor b" in text


def test_a_claim_leads_to_its_evidence():
    items = (Item("goal", "g", "good", (0.0, 0.0)), Item("finding", "f", "error"))
    claims = (
        Claim("map", "error", "A", "finding"), Claim("costmap", "good", "B", "Robot"),
        Claim("goals", "unknown", "C", "goal"), Claim("cells", "good", "D", "nothing"),
    )  # fmt: skip
    tables = (Table("Run", (("a", "b"),)), Table("Robot", (("a", "b"),)))
    entry = entry_of(GRID, items=items, claims=claims, tables=tables)
    page = parsed(Report("one", (entry,), "1.0"))
    links = [attrs["href"][1:] for tag, attrs in page.tags if attrs.get("class") == "evidence"]
    by_id = {attrs["id"]: (tag, attrs) for tag, attrs in page.tags if "id" in attrs}
    assert [by_id[link][0] for link in links] == ["ul", "ul", "details"]
    labels = [by_id[link][1].get("aria-label") for link in links]
    assert labels == ["Findings", "Goals", None]  # the worst first
    text = " ".join("".join(page.text).split())
    for words in ("Problem A.", "OK B.", "Not checked C.", "OK D."):  # never colour alone
        assert words in text


def test_a_batch_begins_with_what_failed_and_names_what_holds_for_all_once():
    shared = Claim("costmap", "warning", "nobody's costs", "cost: parameters")
    sound, bad = Claim("map", "good", "sound"), Claim("map", "error", "1 error: a hole")
    entries = (
        entry_of(GRID, "a/good", claims=(sound, shared), figures={"x": 1.0, "y": 1.0, "z": 2.0}),
        entry_of(GRID, "a/bad", claims=(bad, shared), figures={"x": 3.0, "y": 3.0, "z": 2.0}),
        Entry("a/f", status="failed", claims=(Claim("run", "error", "no image"),)),
    )
    page = parsed(Report("three", entries, "1.0"))
    text = " ".join("".join(page.text).split())
    table = text[text.index("Filter") :]
    assert table.index("a/f") < table.index("a/bad") < table.index("a/good")
    assert "Problem 2 of 3 maps have a problem (1 failed): a/f, a/bad." in text
    assert "Check All maps: nobody's costs." in text
    assert "Failed" in table
    assert "a hole" in table[: table.index("a/good")]
    assert {"X", "Z"} <= set(page.text)
    assert "Y" not in page.text  # which is X
    assert any(tag == "wbr" for tag, _ in page.tags)
    links = {attrs["href"] for tag, attrs in page.tags if tag == "a"}
    assert {"#maps", *(f"#entry-{k}" for k in range(3))} <= links
    assert links <= {f"#{attrs.get('id')}" for _, attrs in page.tags}


def test_the_script_never_makes_markup_or_code_of_text():
    words = "innerHTML", "outerHTML", "insertAdjacent", "document.write", "eval(", "Function("
    assert [word for word in words if word in script_text()] == []


def test_the_line_below_the_title_tells_the_figures_once_with_their_units():
    figures = {"cells": "8 x 3", "m per cell": 0.25, "occupied %": 12.5, "recipe": "design-real"}
    page = parsed(Report("one", (entry_of(GRID, figures=figures),), "1.0"))
    expected = "8 \u00d7 3 cells of 0.25 m, 2 \u00d7 0.75 m, occupied 12.5 %, recipe design-real"
    assert expected in page.text
    items = (Item("finding", "x", "error"), Item("finding", "y", "warning"))
    failed = Entry("c", status="failed", warnings=("c.yaml: the image does not exist",))
    entries = (entry_of(GRID, "a", items=items, warnings=("w",)), Entry("b"), failed)
    page = parsed(Report("three", entries, "1.0"))
    assert "3 maps, 2 errors, 2 warnings, 1 failed, 1 without layers" in page.text
    assert "Status" not in "".join(parsed(Report("two", entries[:2], "1.0")).text)


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


ODD_CHARACTERS = "<>&\"'/=!-[] \n\t\x00\x1b\u2028\u202e\ud800aimgscrpt"
NASTY = st.text(st.sampled_from(ODD_CHARACTERS), max_size=30)


@given(NASTY, NASTY)
def test_texts_and_attributes_are_read_back(text, value):
    tags, found = read(element("p", text, title=value))
    assert [tag for tag, _ in tags] == ["p"]
    if (text + value).isprintable():
        assert (found, tags[0][1]) == (text, {"title": value})
    else:
        assert found.isprintable()


@given(st.lists(st.integers(0, 0x10FFFF).map(chr)).map("".join))
def test_what_is_written_is_utf_8_without_markup(text):
    assert not set("<>\"'") & set(escaped(text))
    escaped(text).encode("utf-8")


def test_markup_is_what_it_is_written_to_be():
    assert escaped("a\u202eb\x00c\ud800") == "a\\u202eb\\x00c\\ud800"
    assert joined([element("b", "1"), "<", element("br")]).text == "<b>1</b>&lt;<br>"
    assert element("a", href="#a").text == '<a href="#a"></a>'  # links lead to the page itself
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
