import base64
import hashlib
import json

import numpy as np

from drawn import grid_from_text
from mapdeal.report.document import Claim, Entry, Item, Report, Table
from mapdeal.report.page import page_of, script_text
from report.made import entry_of, layers_of
from report.test_markup import Reader

GRID = grid_from_text("""
    ?.....#?
    ?..#...?
    #......?
    """)

ATTACKS = (
    "<img src=x onerror=alert(1)>", "</script><script>alert(1)</script>", "a&amp;b", "\"'`",
    "\u2028x", "tab\tbell\x07", "\u202egnp.exe", "<!--", "]]>", "$policy ${script}",
)  # fmt: skip


def page_bytes(report, size=25_000_000):
    return b"".join(page_of(report, size=size))


def parsed(report):
    return Reader(page_bytes(report).decode())


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
        shown = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode() for c in attack
        )
        assert text.count(shown) >= len(ATTACKS)


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
    items = [
        Item("finding", text, "warning", (0.1 * k, 0.25), group="x.y")
        for k, text in enumerate(texts)
    ]
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
